"""What does a short training cost, and is it enough? 300,000 double steps, then 1,000 goals.

    python tests/studies/budget.py [--mujoco] [--ship]

Learning is everything but simulation. (After an interruption it is measured from there on.)
"""

import common
import kept

DURATION = {"pymunk": "about 5 minutes on two cores", "mujoco": "about 7 minutes on two cores"}
STEPS = 300_000  # double steps of the training
SETS = 2  # of 500 goals
env, ppo = kept.env, kept.ppo

def train(sim):
    """The folder of the training; cost.json in it holds minutes and learning [ms per step]."""
    cfg, fits = ppo.PPOConfig(), env.fingerprint(sim)
    name = common.digest(fits, env.Task(), common.robot_model.RobotModel(), cfg, STEPS)
    out = common.work(sim, f"budget_{name}")
    if not (out / "cost.json").is_file():
        with common.timed(env.FootstepVectorEnv, "step") as simulation:
            _, rows = kept.learn(
                out, cfg, lambda n: env.FootstepVectorEnv(n, sim, noise=True), STEPS, seed=0,
                about={"fits": fits, "imu": False, "noise": True})
        cost = {"minutes": round(rows[-1]["minutes"], 2), "cores": common.robot_model.CORES}
        cost["learning_ms"] = learning_ms(simulation, cfg)
        common.write(out / "cost.json", common.as_json(cost))
    return out

def learning_ms(simulation, cfg):
    """Learning per double step [ms], from the first to the last one; None after too few."""
    steps = cfg.num_envs * (simulation.calls - cfg.rollout)  # the last rollout is not learned from
    if steps <= 0:
        return None
    return round(1000 * (simulation.last - simulation.first - simulation.seconds) / steps, 4)

def study(sim):
    """The final policy of the short training, without noise."""
    folder, trials = train(sim), kept.Trials(sim)
    own = trials.run(*kept.policy(folder / "policy.pt", sim), False, count=SETS)
    trials.close()
    row = kept.row_of(own, "policy", False) | common.read_json(folder / "cost.json")
    head = ["simulator", "double steps", f"minutes on {row['cores']} cores",
            "learning [ms per double step]", "success [95 % interval]", "time [s]"]
    line = [sim, f"{STEPS:,}", f"{row['minutes']:.1f}", common.number(row["learning_ms"], 3),
            common.with_interval(row, "success"), common.number(row["time_mean"], 2)]
    return common.Findings(row, common.markdown(head, [line]))

if __name__ == "__main__":
    common.main(__file__)
