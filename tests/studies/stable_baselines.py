"""Is our PPO right, and quick? The same training with Stable-Baselines3, on the same environment.

    python tests/studies/stable_baselines.py [--mujoco] [--ship]

It needs `python -m pip install stable-baselines3==2.9.2`. 100,000 double steps, three seeds each:
ours as it is; ours with a Gaussian policy, clipped, without sharpening; theirs with the same
network, first policy and settings on the same 64 robots; and theirs the way its users run it, one
robot in each of eight processes. Where they differ: ours starts all episodes anew after every 10th
update, theirs never. Then 250 near and 250 far noisy goals. If ours is right, both Gaussians agree
within the spread of their seeds: the ranges from the worst to the best seed overlap. (Two equal
ones fail that in one case of ten.) In the figure success comes in waves at first, as robots that
began together run out of time together. Simulation is all that happens in the environment's `step`
and `reset`, learning is the rest. Run it on an idle machine.
"""

from dataclasses import replace
from functools import partial
from time import perf_counter

import ablations
import common
import kept
import numpy as np
from kept import env, evaluate, ppo

try:
    import stable_baselines3
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import SubprocVecEnv, VecEnv
except ImportError:  # it is told when the study begins
    stable_baselines3, BaseCallback, SubprocVecEnv, VecEnv = None, object, object, object

DURATION = {"pymunk": "about half an hour on two cores", "mujoco": "about 50 minutes on two cores"}
STEPS, PROCESSES = 100_000, 8
GAUSSIAN = replace(ppo.PPOConfig(), sharpest=1.0)
# Told apart without red and green, and in grey (after Okabe and Ito).
KINDS = {"ours, Beta": ("#0072b2", "o"), "ours, Gaussian": ("#56b4e9", "s"),
         "SB3, the same robots": ("#d55e00", "^"), "SB3, one robot per process": ("#cc79a7", "x")}

def clocked(envs, learn):
    """What `learn` returns, the time from its first reset to its last step, and how much of that
    the environments took [s]. (So neither starting and ending processes nor the last update.)
    """
    with common.timed(envs, "step") as step, common.timed(envs, "reset") as reset:
        result = learn()
        return result, step.last - reset.first, step.seconds + reset.seconds

# ------------------------------------------------------------------------ ours
def ours(kind, sim, seed, out):
    """One training: its planner, its curve, and the two times of `clocked`."""
    cfg, make_model = GAUSSIAN, ablations.GaussianActor
    if kind == "ours, Beta":
        cfg, make_model = ppo.PPOConfig(), ppo.ActorCritic
    make_envs = partial(env.FootstepVectorEnv, sim=sim, noise=True)
    (model, log), *times = clocked(env.FootstepVectorEnv, lambda: ppo.train(
        cfg, make_envs, out, STEPS, seed, make_model=make_model))
    return evaluate.PolicyPlanner(model, False), log, *times

# ------------------------------------------------------------------------ theirs
class SameRobots(VecEnv):
    """Our vector environment as theirs: a list of infos, the last observation among them."""

    def __init__(self, envs):
        self.envs = envs
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def reset(self):
        return self.envs.reset(seed=self._seeds[0])[0]

    def step_async(self, actions):
        self.actions = actions

    def step_wait(self):
        obs, reward, terminated, truncated, info = self.envs.step(self.actions)
        infos = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(terminated | truncated):
            infos[i] = {name: info["final_info"][name][i] for name in env.ENDS}
            infos[i] |= {"terminal_observation": info["final_obs"][i],
                         "TimeLimit.truncated": bool(truncated[i])}
        return obs, reward.astype(np.float32), terminated | truncated, infos

    def close(self):
        self.envs.close()

    def get_attr(self, attr_name, indices=None):
        return [None for _ in self._get_indices(indices)]  # it asks for the render_mode

    def set_attr(self, attr_name, value, indices=None):
        raise NotImplementedError

    def env_method(self, method_name, *args, indices=None, **kwargs):
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False for _ in self._get_indices(indices)]

def one_robot(sim):
    """What each of the processes runs."""
    return env.FootstepEnv(sim, noise=True)

class Curve(BaseCallback):
    """After every rollout a row as in our log: double steps, minutes, how episodes ended."""

    def _on_training_start(self):
        self.rows, self.ended, self.started = [], [], perf_counter()

    def _on_step(self):
        both = zip(self.locals["dones"], self.locals["infos"])
        self.ended += [info for done, info in both if done]
        return True

    def _on_rollout_end(self):
        mean = lambda values: float(np.mean(values)) if len(values) else float("nan")  # noqa: E731
        row = {name: mean([info[name] for info in self.ended]) for name in ("success", "fall")}
        row["time"] = mean([info["time"] for info in self.ended if info["success"]])
        minutes = (perf_counter() - self.started) / 60
        self.rows.append({"steps": self.num_timesteps, "minutes": minutes, **row})
        self.ended = []

class Decides:
    """Their model, decisions as ours."""

    def __init__(self, model):
        self.model = model

    def decide(self, obs):
        """The mean of the normal distribution, clipped."""
        return self.model.predict(obs, deterministic=True)[0]

def theirs(kind, sim, seed, _out):
    """The same as `ours`."""
    cfg, torch = GAUSSIAN, ppo.torch
    robots = PROCESSES if kind == "SB3, one robot per process" else cfg.num_envs
    updates = -(-STEPS // (cfg.num_envs * cfg.rollout))
    torch.set_num_threads(1)  # as ours
    if robots == PROCESSES:
        envs = SubprocVecEnv([partial(one_robot, sim)] * robots, start_method="spawn")
    else:
        envs = SameRobots(env.FootstepVectorEnv(robots, sim, noise=True))
    log_std = float(-0.5 * np.log(4 * (cfg.first_concentration + 1)))  # as in GaussianActor
    model = stable_baselines3.PPO(
        "MlpPolicy", envs, n_steps=cfg.num_envs * cfg.rollout // robots, batch_size=cfg.minibatch,
        n_epochs=cfg.epochs, gamma=cfg.gamma, gae_lambda=cfg.lam, clip_range=cfg.clip,
        learning_rate=lambda left: cfg.learning_rate * (left + 1 / updates),  # left: after it
        vf_coef=cfg.value_coef, max_grad_norm=cfg.max_grad_norm, device="cpu",
        seed=ppo.random_seed(seed) % 2**31,  # near seeds would share most of their robots' worlds
        policy_kwargs={"net_arch": {"pi": list(cfg.hidden), "vf": list(cfg.hidden)},
                       "activation_fn": torch.nn.Tanh, "log_std_init": log_std})
    neutral = env.to_action(np.zeros((2, 3)), env.walk_engine.LIMITS[sim])
    model.policy.action_net.bias.data.copy_(torch.as_tensor(neutral))
    curve, timed = Curve(), SubprocVecEnv if robots == PROCESSES else env.FootstepVectorEnv
    _, *times = clocked(timed, lambda: model.learn(updates * cfg.num_envs * cfg.rollout, curve))
    envs.close()
    return evaluate.PolicyPlanner(Decides(model), False), curve.rows, *times

# ------------------------------------------------------------------------ the study
def train(kind, sim, seed):
    """One training and its trials: a row; kept."""
    key = common.digest(common.robot_model.RobotModel(), common.robot_model.Spread(),
                        env.fingerprint(sim), env.Task(), ppo.PPOConfig(), STEPS, kept.PER_SEED)
    name = "".join(filter(str.isalnum, kind))
    out = common.work(sim, "stable_baselines", f"{name}_{seed}_{key}")
    if (out / "result.json").is_file():
        return common.read_json(out / "result.json")
    print(f"{kind}, seed {seed}", flush=True)
    run = ours if kind.startswith("ours") else theirs
    planner, log, seconds, simulation = run(kind, sim, seed, out)
    keys = "steps", "minutes", "success", "fall", "time"
    curve = [{name: round(float(row[name]), 4) for name in keys} for row in log
             if np.isfinite(row["time"])]
    row = {"kind": kind, "seed": seed, "seconds": round(seconds, 1), "curve": curve,
           "simulation": round(simulation, 1),
           "learning_ms": round(1000 * (seconds - simulation) / log[-1]["steps"], 4),
           **evaluate.summary("policy", True, None, ablations.walks(planner, sim), env.Task())}
    common.write(out / "result.json", common.as_json(row))
    return row

def study(sim):
    """Seed by seed, so that a machine that slows down slows all of them."""
    if stable_baselines3 is None:
        raise common.StudyError("first: python -m pip install stable-baselines3==2.9.2")
    rows = [train(kind, sim, seed) for seed in kept.SEEDS for kind in KINDS]
    keys = {"success": 3, "fall": 3, "time_mean": 2, "seconds": 0, "simulation": 0,
            "learning_ms": 3}
    lines = [[kind, *(common.spread([row[key] for row in rows if row["kind"] == kind], digits)
                      for key, digits in keys.items())] for kind in KINDS]
    head = ["training", "success", "fall", "time [s]", "wall-clock [s]", "of it simulation [s]",
            "learning per double step [ms]"]
    checks = promises(rows)
    table = common.markdown(head, lines) + "\n" + common.markdown(
        ("is it right, is it quick?", "promised", "found", "kept"), checks)
    return common.Findings({"steps": STEPS, "goals": kept.PER_SEED, "rows": rows,
                            "promises": checks}, table, plot(rows, sim))

def promises(rows):
    """What was promised against what came out: lines of a table."""
    def of(kind, key):
        return [row[key] for row in rows if row["kind"] == kind and row[key] is not None]

    _, gaussian, same, apart = KINDS
    lines = []
    for key, what in (("success", "success"), ("fall", "falls"), ("time_mean", "time [s]")):
        own, other = of(gaussian, key), of(same, key)
        meet = own and other and max(min(own), min(other)) <= min(max(own), max(other))
        found = " and ".join(common.spread(values, 3) for values in (own, other))
        lines.append([f"Gaussian policies: {what}", "ranges overlap", found, meet])
    for what, key, kind, most in (
            ("learning per double step ÷ theirs", "learning_ms", same, 0.8),
            ("wall-clock ÷ theirs on the same robots", "seconds", same, 1.0),
            ("wall-clock ÷ theirs, one robot per process", "seconds", apart, 0.5)):
        ratio = np.mean(of(gaussian, key)) / np.mean(of(kind, key))
        lines.append([what, f"≤ {most}", f"{ratio:.2f}", ratio <= most])
    return [[*cells, "yes" if good else "no"] for *cells, good in lines]

def mean_curve(curves):
    """Where all of these curves have a point: the mean of these points."""
    after = [{point["steps"]: point for point in curve} for curve in curves]
    common_steps = sorted(set.intersection(*(set(points) for points in after)))
    return [{key: float(np.mean([points[steps][key] for points in after])) for key in curves[0][0]}
            for steps in common_steps]

def plot(rows, sim):
    """Success and falls against double steps, success against the clock; time to the goal.

    Thick: the mean over the seeds after as many double steps; thin: each of them.
    """
    figure, axes = common.plt.subplots(2, 2, figsize=(10, 7), layout="constrained")
    panels = (("steps", "success", 1000, "double steps [thousands]", "success, share [1]"),
              ("minutes", "success", 1, "wall-clock [min]", "success, share [1]"),
              ("steps", "fall", 1000, "double steps [thousands]", "falls, share [1]"),
              ("steps", "time", 1000, "double steps [thousands]", "time of successes [s]"))
    for axis, (x, y, unit, label, what) in zip(axes.flat, panels):
        for kind, (color, marker) in KINDS.items():
            curves = [row["curve"] for row in rows if row["kind"] == kind]
            if not curves:
                continue
            for curve in curves:
                axis.plot([point[x] / unit for point in curve], [point[y] for point in curve],
                          lw=0.5, alpha=0.4, color=color)
            middle = mean_curve(curves)
            axis.plot([point[x] / unit for point in middle], [point[y] for point in middle],
                      f"{marker}-", ms=4, lw=1.8, color=color, label=kind)
        axis.set(xlabel=label, ylabel=what)
        axis.grid(alpha=0.3)
    axes[1, 1].set(yscale="log", yticks=(5, 10, 20, 50, 100))
    axes[1, 1].yaxis.set_major_formatter("{x:.0f}")
    axes[1, 1].yaxis.set_minor_formatter("")
    axes[0, 0].legend(fontsize=8)
    figure.suptitle(f"While exploring: ours and Stable-Baselines3's PPO ({sim}); three seeds each")
    return figure

if __name__ == "__main__":
    common.main(__file__)
