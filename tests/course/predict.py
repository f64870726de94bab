"""The small experiments of predict.md; each prints a few numbers. Write down your guess first.

Run from the root of the repository:

    python tests/course/predict.py sway --mujoco        how far a walking robot sways
    python tests/course/predict.py circle               the return of walking in a circle
    python tests/course/predict.py concentration        mode and mean of a Beta distribution
    python tests/course/predict.py reflex --mujoco      other gains of the ankles' reflex
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

sys.path.insert(1, str(Path(__file__).resolve().parents[1] / "studies"))  # before others' common.py
from common import env, robot_model, walk_engine


def sway(sim):
    """How far the centre of mass sways in the plan of a straight walk."""
    engine, _ = walk_engine.walkers(sim, 1)
    for _ in range(2):  # the second double step; the first one starts from standing
        plan = engine.plan([walk_engine.WALKS["forward"]], [0])
    joints = robot_model.joints_for_feet(engine.robot, plan.trunk[0], plan.feet[0])
    mass = robot_model.centre_of_mass(engine.robot, plan.trunk[0], joints)  # [T + 1, 3]
    share = mass[:, 1].max() / (engine.parameters.foot_distance / 2)
    print(f"in the plan the centre of mass sways {share:.2f} of the distance to the support foot")


def circle(sim):
    """Sums of the three progress rewards on a circle, 2 m across, that passes the start again."""
    angle = np.linspace(0, 2 * np.pi, 41)  # [rad] forty double steps, from the start to the start
    poses = np.stack([np.sin(angle), 1 - np.cos(angle), angle], -1)  # [41, 3] of the robot
    goals = robot_model.relative(poses, [3.0, 0.0, 0.0])  # [41, 3] seen from it
    nothing = np.zeros((40, 6))
    terms = env.reward_terms(goals[:-1], goals[1:], nothing, nothing, 0.0, 0.0)
    for gamma in (1.0, 0.95, 0.9):
        factors = gamma ** np.arange(40)
        sums = {name: (factors * terms[name]).sum() for name in ("r_d", "r_a", "r_o")}
        print(
            f"γ = {gamma:4.2f}: " + ", ".join(f"{k} {v + 0:6.3f}" for k, v in sums.items()),
            f"  all terms {(factors * sum(terms.values())).sum():6.3f}",
        )


def concentration(sim):
    """Mean and spread of Beta(1 + (c − 2)·m, 1 + (c − 2)·(1 − m))."""
    for mode in (0.5, 1.0):
        for c in (10.0, 40.0):
            ends = 1 + (c - 2) * torch.tensor([mode, 1 - mode])  # α, β
            beta = torch.distributions.Beta(*ends)
            print(
                f"mode {mode}: c = {c:2.0f}  mean {beta.mean:.3f}, "
                f"standard deviation {beta.stddev:.3f}"
            )


def reflex(sim):
    """How many of 96 robots fall after a push forward, by the gain of the reflex."""
    for gain in (0.0, 0.05, 0.2, 0.4):
        answers = replace(walk_engine.TUNED[sim], reflex=gain)
        alone = replace(answers, capture=0.0, wait=0.0)
        falls = [walk_engine.pushed(sim, each, 0.7, 96)[1].sum() for each in (alone, answers)]
        print(f"gain {gain:.2f} s: {falls[0]} of 96 fall, with capture steps {falls[1]}")


EXPERIMENTS = {
    "sway": sway,
    "circle": circle,
    "concentration": concentration,
    "reflex": reflex,
}


def main():
    parser = robot_model.stage_parser(__doc__)
    parser.add_argument("name", choices=EXPERIMENTS)
    args = parser.parse_args()
    EXPERIMENTS[args.name](args.sim)


if __name__ == "__main__":
    robot_model.run_script(main)
