"""What does each ingredient of the learning do? Short trainings, each without one of them.

    python tests/studies/ablations.py [--mujoco] [--ship]

100,000 double steps with three seeds of every variant, one core each, then 250 near and 250 far
noisy goals. So it says how soon something is learned, not how well in the end.
"""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import common
import kept
import numpy as np
from kept import env, evaluate, ppo
from tqdm import tqdm

DURATION = {"pymunk": "less than an hour on two cores", "mujoco": "about 2 hours on two cores"}
STEPS = 100_000  # double steps of a training
VARIANTS = {  # name: what differs from the reference
    "reference": {},
    "Gaussian policy, clipped": {"model": "Gaussian"},
    "no sharpening": {"config": {"sharpest": 1.0}},
    "one previous action": {"hide": True},
    "with IMU": {"imu": True},
    **{f"without r_{k}": {"task": {f"s_{k}": 0.0}}
       for k in ("d", "a", "o", "c", "fall", "goal", "time")},
}
LATER = slice(len(env.GOAL_TABLE) + 6, len(env.GOAL_TABLE) + 12)  # the action before the last one


# ------------------------------------------------------------------------ the variants
class GaussianActor(ppo.ActorCritic):
    """The usual choice instead of the Beta: it may sample outside [0, 1].

    The environment gets the clipped action; the log-probability is that of the unclipped one.
    """

    def __init__(self, obs_dim, act_dim, hidden, first_action, concentration, normalize=False):
        super().__init__(obs_dim, act_dim, hidden)
        self.actor = ppo.mlp((obs_dim, *hidden, act_dim), last_gain=0.01)
        first = ppo.torch.as_tensor(first_action, dtype=ppo.torch.float32).expand(act_dim)
        self.actor[-1].bias.data.copy_(first)
        # σ² = 1 / (4·(c + 1)), that of a Beta with mean 0.5 and concentration c
        log_std = -0.5 * np.log(4 * (concentration + 1))
        self.log_std = ppo.nn.Parameter(ppo.torch.full((act_dim,), log_std))

    def policy(self, obs):
        std = self.log_std.exp() / self.sharpness**0.5  # p(x)^k is a normal distribution again
        normal = ppo.torch.distributions.Normal(self.actor(obs), std)
        return ppo.torch.distributions.Independent(normal, 1)

    def sample(self, obs):
        with ppo.torch.no_grad():
            return self.policy(obs).sample()

    def decide(self, obs):
        with ppo.torch.no_grad():  # mode and mean are the same
            return self.actor(ppo.torch.as_tensor(obs)).clamp(0.0, 1.0).numpy()

class HiddenEnv(env.FootstepVectorEnv):
    """The observation without the action before the last one."""

    def _observe(self, robots):
        observations = super()._observe(robots)
        observations[:, LATER] = 0
        return observations

class HiddenPlanner(evaluate.PolicyPlanner):
    """The policy to it."""

    def act(self, view, robots, measured):
        view.observation[:, LATER] = 0
        return super().act(view, robots, measured)

def ablate(sim, name, seed):
    """One training on one core and its trials: a row; kept."""
    variant = VARIANTS[name]
    cfg = ppo.PPOConfig(**variant.get("config", {}))
    task = replace(env.Task(), **variant.get("task", {}))
    imu, hide = variant.get("imu", False), variant.get("hide", False)
    fits = env.fingerprint(sim, imu)
    key = common.digest(common.robot_model.RobotModel(), common.robot_model.Spread(), fits, task,
                        cfg, variant, STEPS, kept.PER_SEED)
    out = common.work(sim, "ablations", f"{''.join(filter(str.isalnum, name))}_{seed}_{key}")
    if (out / "result.json").is_file():
        return common.read_json(out / "result.json")

    def make_envs(num_envs):
        kind = HiddenEnv if hide else env.FootstepVectorEnv
        return kind(num_envs, sim, True, imu, task=task, cores=1)

    kind = GaussianActor if variant.get("model") else ppo.ActorCritic
    model, log = kept.learn(out, cfg, make_envs, STEPS, seed, about={"fits": fits}, progress=False,
                            make_model=kind)
    ended = walks((HiddenPlanner if hide else evaluate.PolicyPlanner)(model, imu), sim)
    curve = [[row["steps"], round(row["success"], 4)] for row in log
             if not np.isnan(row["success"])]
    row = {"variant": name, "seed": seed, "curve": curve, "learned_after": learned_after(curve),
           **evaluate.summary("policy", True, None, ended, env.Task())}
    common.write(out / "result.json", common.as_json(row))
    return row

def walks(planner, sim):
    """250 near and 250 far noisy trials on one core, as arrays of `evaluate`."""
    world, parts = env.FootstepWorld(kept.PER_SEED, sim, cores=1), []
    for far in (False, True):
        asked = evaluate.draw_trials(kept.FIRST, kept.PER_SEED // 2, far)
        parts.append(evaluate.evaluate(planner, world, asked, noise=True))
    world.close()
    return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}

def learned_after(curve, share=0.8, window=3):
    """Thousands of double steps until that share of the episodes succeeds, or None.

    curve: double steps and success of the updates in which episodes ended; of three in a row the
    mean counts.
    """
    for k in range(window, len(curve) + 1):
        if np.mean([success for _, success in curve[k - window : k]]) >= share:
            return curve[k - 1][0] / 1000
    return None


# ------------------------------------------------------------------------ the study
def study(sim):
    """As many trainings at a time as there are cores."""
    jobs = [(sim, name, seed) for name in VARIANTS for seed in kept.SEEDS]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(common.robot_model.CORES, context) as pool:
        rows = list(tqdm(pool.map(ablate, *zip(*jobs)), total=len(jobs), unit=" trainings"))
    keys = {"success": 3, "fall": 3, "timeout": 3, "time_mean": 1, "learned_after": 0}
    lines = [[name, *(common.spread([row[key] for row in rows if row["variant"] == name], digits)
                      for key, digits in keys.items())] for name in VARIANTS]
    head = ["variant", "success", "fall", "timeout", "time [s]", "80 % after [1,000 steps]"]
    return common.Findings({"steps": STEPS, "goals": kept.PER_SEED, "rows": rows},
                           common.markdown(head, lines), plot(rows, sim))

def plot(rows, sim):
    """A dot for every training, a bar for the mean of a variant."""
    panels = {"success": ("success", f"share of {kept.PER_SEED} goals [1]"),
              "time_mean": ("time of the successes", "mean [s]"),
              "learned_after": ("80 % of the episodes succeed", "after double steps [thousands]")}
    figure, axes = common.plt.subplots(1, 3, figsize=(13, 5), layout="constrained", sharey=True)
    for axis, (key, (title, label)) in zip(axes, panels.items()):
        for place, name in enumerate(VARIANTS):
            own = [row[key] for row in rows if row["variant"] == name and row[key] is not None]
            color = "k" if name == "reference" else "tab:blue"
            axis.plot(own, [place] * len(own), "o", color=color, alpha=0.6)
            if own:
                axis.plot(np.mean(own), place, "|", color=color, ms=18)
        axis.set(title=title, xlabel=label)
        axis.grid(alpha=0.3)
    axes[0].set(yticks=range(len(VARIANTS)), yticklabels=VARIANTS)
    axes[0].invert_yaxis()
    figure.suptitle(f"{STEPS:,} double steps of training ({sim}); dots: training seeds, bar: their "
                    "mean; no dot: never")
    return figure

if __name__ == "__main__":
    common.main(__file__)
