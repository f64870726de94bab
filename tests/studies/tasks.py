"""Does our PPO learn other tasks, too? Six of Gymnasium's, beside what others have published.

    python tests/studies/tasks.py [--mujoco] [--ship]

Every training is `python 04_ppo.py --env ID --steps N --seed S`: one group of settings for all, but
γ = 0.95 for the pendulum. Judged by 100 new episodes each, decisions by the mean, observations
scaled as in the policy's file. The published numbers are of other versions of the tasks, other
settings and at most 1,000,000 steps: they say what is usual, not what is possible. (--mujoco only
ships it to the other folder.)

Where it fails: MountainCarContinuous. The car must swing up to a flag, 100 points, and every push
costs; noise that is drawn anew in every step cancels out long before it has swung up, so the best
that was ever seen is not to push, 0. Those who arrive draw their noise as a function of the state,
and keep it for many steps. And the three Hoppers show why one seed is none.
"""

import common
import kept
import numpy as np
from kept import ppo

DURATION = {"pymunk": "about 40 minutes on one core", "mujoco": "as without --mujoco"}
EPISODES = 100  # of every policy
JUDGED = 10**6  # seed of the first one; trainings use others
CLEANRL = "CleanRL, docs/benchmark/ppo_continuous_action.md and docs/rl-algorithms/rpo.md"
ZOO = "RL Zoo of Stable-Baselines3, its model cards"
TASKS = {  # steps; published return ± standard deviation, and by whom
    "Pendulum-v1": (150_000, "−230 ± 143", ZOO),
    "InvertedPendulum-v5": (150_000, "963 ± 22", CLEANRL),
    "MountainCarContinuous-v0": (150_000, "94.6 ± 0.5 (exploring by state)", ZOO),
    "Reacher-v5": (500_000, "−4.7 ± 1.0", CLEANRL),
    "Hopper-v5": (1_000_000, "2383 ± 272", CLEANRL),
    "HalfCheetah-v5": (1_000_000, "1443 ± 46", CLEANRL),
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
    for task, (steps, published, source) in TASKS.items():
        for seed in kept.SEEDS:
            model, _ = ppo.load_policy(train(task, steps, seed) / "policy.pt")
            returns = judge(model, task)
            rows.append({"task": task, "steps": steps, "seed": seed, "published": published,
                         "source": source,
                         "return": round(float(returns.mean()), 2),
                         "std": round(float(returns.std()), 2)})
    return common.Findings({"episodes": EPISODES, "rows": rows}, table(rows))

def table(rows):
    """A line per task: mean over the seeds, and each of them."""
    lines = []
    for task in TASKS:
        own = [row for row in rows if row["task"] == task]
        means = np.array([row["return"] for row in own])
        lines.append([task, f"{own[0]['steps']:,}", f"{means.mean():.1f}",
                      ", ".join(f"{mean:.1f}" for mean in means), own[0]["published"],
                      own[0]["source"]])
    head = ("task", "steps", "return, mean of seeds", "each seed", "published", "by")
    return common.markdown(head, lines)

if __name__ == "__main__":
    common.main(__file__)
