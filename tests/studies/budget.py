"""What does a short training cost, and is it enough? 250,000 double steps, then 4,000 goals.

    python tests/studies/budget.py [--mujoco] [--ship]

Enough: at least 98 % success. Simulation is all that happens in the environment's `step` and
`reset`, learning is the rest. (After an interruption it is measured from there on.)
"""

import common
import kept

DURATION = {"pymunk": "about 7 minutes on two cores", "mujoco": "about 9 minutes on two cores"}
STEPS = 61 * 4096  # double steps of the training: the most whole updates within 250,000
SETS = 2  # of 500 goals, near and far, without and with noise
ENOUGH = 0.98  # share of successes
env, ppo = kept.env, kept.ppo

def train(sim):
    """The folder of the training; cost.json in it holds minutes and learning [ms per step]."""
    cfg, fits = ppo.PPOConfig(), env.fingerprint(sim)
    name = common.digest(fits, env.Task(), common.robot_model.RobotModel(), cfg, STEPS)
    out = common.work(sim, f"budget_{name}")
    if not (out / "cost.json").is_file():
        with (common.timed(env.FootstepVectorEnv, "step") as step,
              common.timed(env.FootstepVectorEnv, "reset") as reset):
            _, rows = kept.learn(
                out, cfg, lambda n: env.FootstepVectorEnv(n, sim, noise=True), STEPS, seed=0,
                about={"fits": fits, "imu": False, "noise": True})
        cost = {"minutes": round(rows[-1]["minutes"], 2), "cores": common.robot_model.CORES}
        cost["learning_ms"] = learning_ms(step, reset, cfg)
        common.write(out / "cost.json", common.as_json(cost))
    return out

def learning_ms(step, reset, cfg):
    """Learning per double step [ms], from the first reset to the last step; None after too few."""
    steps = cfg.num_envs * (step.calls - cfg.rollout)  # the last rollout is not learned from
    if steps <= 0:
        return None
    return round(1000 * (step.last - reset.first - step.seconds - reset.seconds) / steps, 4)

def study(sim):
    """The final policy of the short training."""
    folder, trials, rows = train(sim), kept.Trials(sim), []
    planner = kept.policy(folder / "policy.pt", sim)
    for far in (False, True):
        for noise in (False, True):
            own = trials.run(*planner, noise, count=SETS, far=far)
            rows.append(kept.row_of(own, "policy", noise, far))
    trials.close()
    cost = common.read_json(folder / "cost.json")
    lines = [[f"{row['goal_std_m']} m", "yes" if row["noise"] else "no",
              common.with_interval(row, "success"), common.with_interval(row, "fall"),
              common.number(row["time_mean"], 2), "yes" if row["success"] >= ENOUGH else "no"]
             for row in rows]
    head = ["goals σ", "noise", "success [95 % interval]", "fall [95 % interval]", "time [s]",
            f"at least {ENOUGH}"]
    text = (f"{STEPS:,} double steps of training ({sim}): {cost['minutes']:.1f} minutes on "
            f"{cost['cores']} cores, learning {common.number(cost['learning_ms'], 3)} ms per "
            "double step.\n\n")
    return common.Findings({"steps": STEPS, **cost, "rows": rows},
                           text + common.markdown(head, lines))

if __name__ == "__main__":
    common.main(__file__)
