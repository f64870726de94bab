"""Does our PPO learn other tasks, too? Six of Gymnasium's, beside what others have published.

    python tests/studies/tasks.py [--mujoco] [--ship]

Every training is `python 04_ppo.py --env ID --steps N --seed S`: one group of settings for all, but
γ = 0.95 for the pendulum. Judged by 100 new episodes each, decisions by the mean, observations
scaled as in the policy's file. The published numbers are of older versions of the tasks and of
other settings, each with its steps: CleanRL's from docs/benchmark/ppo_continuous_action.md and, for
Reacher, docs/rl-algorithms/rpo.md; Stable-Baselines3's from the benchmark.md of its RL Zoo. They
say what is usual, not what is possible. (--mujoco only ships it to the other folder.)

Where it fails: MountainCarContinuous. The car must swing up to a flag, 100 points, and every push
costs; noise that is drawn anew in every step cancels out long before it has swung up, so the best
that was ever seen is not to push, 0. Those who arrive draw their noise as a function of the state,
and keep it for many steps. On Pendulum scaling the observations costs: without it, seed 0 got −167.
And the three Hoppers show why one seed is none.
"""

import common
import kept
import numpy as np
from kept import ppo

DURATION = {"pymunk": "about 40 minutes on one core", "mujoco": "as without --mujoco"}
EPISODES = 100  # of every policy
JUDGED = 10**6  # seed of the first one; trainings use others
TASKS = {  # steps; what CleanRL and Stable-Baselines3 have published: return ± deviation (steps)
    "Pendulum-v1": (150_000, "", "−172 ± 104 (100,000)"),
    "InvertedPendulum-v5": (150_000, "963 ± 22 (1 million)", ""),
    "MountainCarContinuous-v0": (150_000, "", "88 ± 3 (20,000)"),
    "Reacher-v5": (500_000, "−4.7 ± 1.0 (8 million)", ""),
    "Hopper-v5": (1_000_000, "2383 ± 272 (1 million)", "2410 ± 10 (1 million)"),
    "HalfCheetah-v5": (1_000_000, "1443 ± 46 (1 million)", "5819 ± 664 (1 million)"),
}

def train(task, steps, seed):
    """The folder of a training by the command above, unless it is there."""
    cfg = ppo.PENDULUM if task == "Pendulum-v1" else ppo.FOREIGN
    out = common.work("tasks") / f"{task}_{seed}_{common.digest(cfg, steps)}"
    if not (out / "learning_curve.png").is_file():  # the last file that it writes
        flags = ["--env", task, "--steps", str(steps), "--seed", str(seed), "--out", str(out)]
        flags += ["--resume"] * (out / "checkpoint.pt").is_file()
        print("python 04_ppo.py", *flags, flush=True)
        try:
            ppo.main(flags)
        except SystemExit as stop:  # it has said why
            if stop.code == 130:
                raise KeyboardInterrupt from stop
            raise
    return out

def judge(model, task):
    """The returns of as many new episodes, side by side [EPISODES]."""
    envs = ppo.foreign_envs(task, EPISODES)
    obs, _ = envs.reset(seed=JUDGED)
    returns, running = np.zeros(EPISODES), np.ones(EPISODES, bool)
    while running.any():
        obs, reward, terminated, truncated, _ = envs.step(model.decide(obs))
        returns += reward * running
        running &= ~(terminated | truncated)
    envs.close()
    return returns

def study(_sim):
    """Every task with every seed."""
    rows = []
    for task, (steps, *_) in TASKS.items():
        for seed in kept.SEEDS:
            model, _ = ppo.load_policy(train(task, steps, seed) / "policy.pt")
            returns = judge(model, task)
            rows.append({"task": task, "steps": steps, "seed": seed,
                         "return": round(float(returns.mean()), 2),
                         "std": round(float(returns.std()), 2)})
    return common.Findings({"episodes": EPISODES, "rows": rows}, table(rows))

def table(rows):
    """A line per task: mean over the seeds, and each of them."""
    lines = []
    for task, (_, *published) in TASKS.items():
        own = [row for row in rows if row["task"] == task]
        means = np.array([row["return"] for row in own])
        lines.append([task, f"{own[0]['steps']:,}", f"{means.mean():.1f}",
                      ", ".join(f"{mean:.1f}" for mean in means), *published])
    head = ("task", "steps", "return, mean of seeds", "each seed", "CleanRL", "Stable-Baselines3")
    return common.markdown(head, lines)

if __name__ == "__main__":
    common.main(__file__)
