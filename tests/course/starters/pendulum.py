"""PPO without a robot: the learner of stage 4 swings up a pendulum and holds it.

    python tests/course/starters/pendulum.py [--steps N] [--seed S] [--out DIR]
    python tests/course/starters/pendulum.py --stages exercises/lesson8    with your own stage 4

Pendulum-v1 of Gymnasium: a rod hangs on a motor that is too weak to lift it at once. An action is
the motor's torque. Every step costs: most where the rod hangs, nearly nothing where it stands. An
episode is cut off after 200 steps, and nothing ends it before, so the critic has to bootstrap.

Writes policy.pt, learning_curve.csv and learning_curve.png to runs/Pendulum-v1/. Rewards and
returns are a tenth of Pendulum's own (see `gym_envs`). In the picture your return is the black
line. The others are those of `tests/studies/ladder.py`: five learners, four of which lack a part.
"""

import argparse
import json
import sys
from importlib import import_module
from pathlib import Path

import gymnasium as gym
import numpy as np

ROOT = Path(__file__).resolve().parents[3]
parser = argparse.ArgumentParser(
    description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
)
parser.add_argument("--stages", type=Path, default=ROOT, help="the folder of your own 04_ppo.py")
parser.add_argument("--steps", type=int, default=60_000)
parser.add_argument("--seed", type=int, default=0)
parser.add_argument("--out", type=Path)
stages = parser.parse_args().stages if __name__ == "__main__" else ROOT
sys.path[:0] = [str(stages), str(ROOT)]
robot_model, ppo = import_module("01_robot_model"), import_module("04_ppo")
TASK = "Pendulum-v1"  # or another one whose actions are a bounded Box [n]
CONFIG = ppo.PPOConfig(num_envs=16, rollout=128, minibatch=256)  # our choice
LEARNERS = ROOT / "results" / "pymunk" / "studies" / "ladder.json"


def gym_envs(num_envs):
    """Copies of the task for `train`: flat observations, actions in [0, 1]."""

    def adapted(one):
        one = gym.wrappers.RescaleAction(one, *np.float32([0, 1]))
        # A tenth: `improve` limits the gradients of actor and critic together. With large rewards
        # those of the critic would be so long that little of the actor's is left.
        one = gym.wrappers.TransformReward(one, lambda reward: np.float32(0.1) * np.float32(reward))
        return gym.wrappers.FlattenObservation(one)

    return gym.make_vec(TASK, num_envs, "sync", {"autoreset_mode": "SameStep"}, (adapted,))


def draw_learners(axes, rows):
    """Draws the mean return of each learner over its seeds, with its 95 % interval; rows: trainings,
    dicts of learner, steps [U], return [U]."""
    axes.set_prop_cycle(
        color=[f"tab:{name}" for name in ("green", "red", "purple", "brown", "gray")]
    )
    for name in dict.fromkeys(row["learner"] for row in rows):
        own = [row for row in rows if row["learner"] == name]
        returns = np.array([row["return"] for row in own])  # [seeds, U]
        mean = returns.mean(0)
        # Student's t for five seeds
        half = 2.776 * returns.std(0, ddof=1) / len(own) ** 0.5
        steps = np.array(own[0]["steps"]) / 1000
        (line,) = axes.plot(steps, mean, label=name)
        axes.fill_between(steps, mean - half, mean + half, color=line.get_color(), alpha=0.2, lw=0)
    axes.set(xlabel="steps [thousands]", ylabel="return of an episode [1]", ylim=(-165, 0))


def plot(rows, path):
    """Draws the return over time. (Only in every second update or so does an episode end.)"""
    axes = robot_model.Figure().subplots()
    if TASK == "Pendulum-v1":
        draw_learners(axes, json.loads(LEARNERS.read_text("utf-8"))["pendulum"]["rows"])
    known = [(row["steps"] / 1000, row["return"]) for row in rows if np.isfinite(row["return"])]
    axes.plot(*np.transpose(known), "k.-", label="yours")
    axes.legend(loc="upper left")
    robot_model.save_figure(axes.figure, path)


def main(argv=None):
    parser.set_defaults(sim=TASK)
    args = parser.parse_args(argv)
    if args.steps < 1:
        parser.error("--steps from 1 on")
    out = robot_model.output_folder(args)
    _, rows = ppo.train(CONFIG, gym_envs, out, args.steps, args.seed)
    plot(rows, out / "learning_curve.png")
    print(f"the last return: {rows[-1]['return']:.1f}")
    print("policy.pt, learning_curve.csv and learning_curve.png are in", out)


if __name__ == "__main__":
    robot_model.run_script(main)
