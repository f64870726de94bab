"""Draws the five figures that the course has of its own.

    python tests/course/figures.py [--out FOLDER]    5 seconds, into runs/course/

Their numbers come from the model of the robot, the settings, and the shipped policies.
"""

import sys
from pathlib import Path

import numpy as np
import torch

sys.path.append(str(Path(__file__).resolve().parents[1] / "studies"))
from common import RESULTS, env, evaluate, ppo, robot_model

ROBOT = robot_model.ROBOT
POSE = [values[None] for values in robot_model.stance(ROBOT)]  # torso [1, 6], joints [1, 12]
ARROW = {"arrowstyle": "<|-", "lw": 2}
SIDE = robot_model.camera_at(-90, 0)  # from the robot's right: a picture shows x and z


def chain(panel):
    """The right leg: each link is turned by a joint against the one above."""
    robot_model.draw_ground(panel, SIDE, 0.2)
    robot_model.draw_robots(panel, ROBOT, *POSE, SIDE)
    places, turns = robot_model.link_frames(ROBOT, *POSE)
    places, frames = places[0, 6:, ::2], turns[0, 6:, ::2, ::2]  # along x and z
    panel.axis((-0.3, 0.4, -0.02, 0.46))
    angles = np.cumsum([0, *POSE[1][0, 8:10]])  # of the vertical, the thigh, the shin
    for k, (place, frame) in enumerate(zip(places, frames)):
        for letter, axis in zip("xz", frame.T):
            panel.annotate(letter, place, place + 0.07 * axis, arrowprops=ARROW)
        if k < 2:
            swept = np.linspace(*angles[k : k + 2], 31)
            arc = -np.column_stack([np.sin(swept), np.cos(swept)])
            panel.plot(*(place + 0.1 * arc).T, "k")
            panel.plot(*np.transpose([place, place + 0.13 * arc[0]]), "k--")
            panel.text(*(place + 0.12 * arc[15]), "q" + "₁₂"[k], ha="center")
            panel.text(*(places[k : k + 2].mean(0) - [0.085, 0]), "l" + "₁₂"[k])


def forces(floor):
    """What the floor can push with before a pulled robot tips or slips; what a motor can give."""
    robot_model.draw_ground(floor, SIDE, 0.3)
    robot_model.draw_robots(floor, ROBOT, *POSE, SIDE)
    x, _, z = robot_model.centre_of_mass(ROBOT, *POSE)[0]
    toe, width = ROBOT.foot_front, ROBOT.friction * z
    floor.fill([toe, toe - width, toe + width], [0, z, z], "g", alpha=0.3, zorder=0)
    floor.plot([toe, x, x, toe], [0, z, 0, 0], "ko-")
    floor.text(x - 0.04, z / 2, "h")
    floor.text(toe / 2, -0.04, "d")
    middle = (toe + x) / 2, z / 2
    floor.annotate("", middle, (toe, 0), arrowprops={"arrowstyle": "-|>", "lw": 2})
    floor.text(toe + 0.02, z / 2, "floor's\nforce")
    floor.annotate("F", (x, z), (x + 0.25, z), arrowprops=ARROW, va="center")
    floor.set_xlim(right=1)
    speed = torch.tensor([0, ROBOT.speed_limit[2]])
    motor = floor.inset_axes([0.6, 0.15, 0.4, 0.8])
    motor.plot(speed, ROBOT.torque_limit[2] - ROBOT.stiction[2] - ROBOT.damping[2] * speed)
    motor.set(xlabel="speed of the joint [rad/s]", ylabel="torque of a hip's motor [N m]")


def humps(panel):
    """The density of a footstep at three moments of a training, for one observation."""
    seen, _ = env.FootstepVectorEnv(1, "mujoco").reset(options={"goals": [[0.9, 0.5, 1.6]]})
    share = torch.linspace(0, 1, 500)
    for name in "film/1,024.pt", "film/25,600.pt", "policy.pt":
        model, about = ppo.load_policy(RESULTS / "mujoco" / name)
        beta = model.policy(torch.from_numpy(seen)).base_dist
        density = beta.log_prob(share[:, None])[:, 0].exp().detach()
        panel.plot(share, density)
        panel.text(share[density.argmax()], density.max() + 0.1, f"{about['steps']:,}")
    panel.set(xlabel="x of the left footstep, share of its limits", ylabel="density")


def ends(panel):
    """The critic's targets for a robot on the spot, if the last step ends or cuts the episode."""
    gamma = ppo.PPOConfig.gamma
    rewards = torch.full((11, 2), -env.Task.s_time)
    value = rewards / (1 - gamma)
    over = torch.arange(11)[:, None] == torch.tensor([10, 11])
    panel.plot(value + ppo.gae(rewards, value, value, over, over.flip(1), gamma, 1.0), "o-", lw=3)
    panel.text(1, -0.2, "terminated: V counts as 0")
    panel.text(1, -0.77, "truncated: V stands for the rest")
    panel.set(xlabel="double step", ylabel="target of the critic", ylim=(None, 0))


def interval(panel):
    """Sixty intervals of the same rate, each from a hundred walks: how many miss it?"""
    for k, falls in enumerate(env.stream("evaluation", 28).binomial(100, 0.1, 60)):
        low, high = evaluate.wilson(falls, 100)
        panel.vlines(k, low, high, "0.7" if low <= 0.1 <= high else "r", lw=3)
    panel.axhline(0.1)
    panel.set(xlabel="experiment", ylabel="share of falls")


def main():
    args = robot_model.stage_parser(__doc__).parse_args()
    args.sim = "course"
    for draw in chain, forces, humps, ends, interval:
        figure = robot_model.Figure(figsize=(7.5, 4.5))
        draw(figure.subplots())
        robot_model.save_figure(figure, robot_model.output_folder(args) / f"{draw.__name__}.png")


if __name__ == "__main__":
    robot_model.run_script(main)
