"""PPO without a robot: the learner of stage 4 swings up a pendulum and holds it.

    python tests/exercises/starters/pendulum.py [--steps N] [--seed S] [--out DIR] [--resume]

Pendulum-v1 of Gymnasium: a rod hangs on a motor that is too weak to lift it at once. An action is
the motor's torque. Every step costs: most where the rod hangs, nearly nothing where it stands. An
episode is cut off after 200 steps, and nothing ends it before, so the critic has to bootstrap.

Writes policy.pt, learning_curve.csv and learning_curve.png to runs/Pendulum-v1/. Rewards and
returns are a tenth of Pendulum's own (see `gym_envs`): in 150,000 steps (25 seconds) the return
rises from −125 to about −16.
"""

import argparse
import sys
from importlib import import_module
from pathlib import Path

import gymnasium as gym
import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[3]))  # where the stages are
robot_model, ppo = import_module("01_robot_model"), import_module("04_ppo")
TASK = "Pendulum-v1"  # or another one whose actions are a bounded Box [n]
CONFIG = ppo.PPOConfig(num_envs=16, rollout=128, minibatch=256)  # our choice


def gym_envs(num_envs):
    """Copies of the task for `train`: flat observations, actions in [0, 1]."""

    def adapted(one):
        one = gym.wrappers.RescaleAction(one, *np.float32([0, 1]))
        # A tenth: `improve` limits the gradients of actor and critic together. With large rewards
        # those of the critic would be so long that little of the actor's is left.
        one = gym.wrappers.TransformReward(one, lambda reward: np.float32(0.1) * np.float32(reward))
        return gym.wrappers.FlattenObservation(one)

    return gym.make_vec(TASK, num_envs, "sync", {"autoreset_mode": "SameStep"}, (adapted,))


def plot(rows, path):
    """Draws four columns of the log. (Only in every second update or so does an episode end.)"""
    figure = robot_model.Figure(figsize=(13, 3.2))
    columns = "return", "entropy", "clip_fraction", "explained_variance"
    for axes, name in zip(figure.subplots(1, 4), columns):
        known = [(row["steps"] / 1000, row[name]) for row in rows if np.isfinite(row[name])]
        axes.plot(*np.transpose(known), ".-")
        axes.set(title=name.replace("_", " "), xlabel="steps [thousands]")
    robot_model.save_figure(figure, path)


def main(argv=None):
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--steps", type=int, default=150_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--resume", action="store_true")
    parser.set_defaults(sim=TASK)
    args = parser.parse_args(argv)
    if args.steps < 1:
        parser.error("--steps from 1 on")
    out = robot_model.output_folder(args)
    _, rows = ppo.train(CONFIG, gym_envs, out, args.steps, args.seed, args.resume)
    plot(rows, out / "learning_curve.png")
    print(f"the last return: {rows[-1]['return']:.1f}")
    print("policy.pt, learning_curve.csv and learning_curve.png are in", out)


if __name__ == "__main__":
    robot_model.start(main)
