"""How does a walk look, and how does the robot walk at the beginning of a training?

    python tests/studies/film.py [--mujoco] [--policy FILE] [--out FOLDER]

Writes two films. In animation.gif the robot walks to three goals, and is pushed on the way. In
learning.gif the robot walks to one goal with three policies, at twice its speed. Two of them are from
the beginning of a training (results/<sim>/film/), the last one is the shipped policy.
"""

from importlib import import_module
from itertools import count, islice, zip_longest
from pathlib import Path

import common
import numpy as np
from common import RESULTS, env, evaluate, ppo, robot_model
from PIL import Image
from tqdm import tqdm

DURATION = "a minute"
GOALS = [[0.9, 0.5, 1.6], [-0.3, 0.35, 3.0], [0.55, -0.25, 0.0]]  # x, y [m], yaw [rad]; our choice
WINDOW = -0.8, 1.63, -0.41, 1.0  # what is seen: from left to right, from below to above [m]
TITLE = f"Yellow: the two footsteps just chosen. Goal {{}} of {len(GOALS)}"


def walk(axes, planner, sim, goals, title):
    """Lets a robot walk to these goals, one after the other, without noise, and yields after every
    picture. On the way to the second goal it is pushed. Ends early if the robot falls."""
    world = common.world(sim, num_robots=1, noise=False)
    world.reset([0], [env.stream("evaluation", 0, 0)])
    planner.reset(1)
    # To the right in the picture; on the plane ahead [m/s]
    push = robot_model.turned([0.6, 0], np.pi / 6 * (not world.engine.planar))
    feet = []
    for k, goal in enumerate(goals, 1):
        world.set_goal([0], goal)
        for step in count():
            more = feet, push * (k == 2 and step == 2), title.format(k), WINDOW
            for result in evaluate.pictures(axes, world, planner, *more):
                yield result
            if result["fall"][0] or result["timeout"][0]:
                return
            if result["success"][0]:
                break


def training(panels, sim):
    """Lets a robot walk to one goal with three policies, side by side: every second picture of 16 s
    at most, each until its walk ends."""
    films = []
    for axes, name in zip(panels, ("film/1,024.pt", "film/25,600.pt", "policy.pt")):
        model, about = ppo.load_policy(RESULTS / sim / name)
        planner, title = evaluate.PolicyPlanner(model), f"{about['steps']:,} double steps"
        films.append(walk(axes, planner, sim, evaluate.FIGURE_GOALS[:1], title))
    return islice(zip_longest(*films), 0, 200, 2)


def save(figure, pictures, path):
    """Films what the figure shows after each of the pictures, for 0.08 s (eight ticks)."""
    frames = [robot_model.pixels(figure) for _ in tqdm(pictures, unit=" pictures", leave=False)]
    # All frames share 128 colours: so what stands still is stored once.
    colors = Image.fromarray(np.concatenate(frames[::4])).quantize(128, Image.Quantize.FASTOCTREE)
    first, *others = [Image.fromarray(frame).quantize(palette=colors, dither=0) for frame in frames]
    film = {"save_all": True, "append_images": others, "duration": 80, "loop": 0}
    robot_model.atomic_write(path, lambda file: first.save(file, **film))


def main(argv=None):
    policy = {"type": Path, "help": "that of animation.gif (default: the shipped one)"}
    args = common.arguments(import_module("film"), argv, policy=policy)
    planner = common.policy(args.policy or RESULTS / args.sim / "policy.pt", args.sim)
    scene, axes = common.subplots(figsize=(8, 4))
    row, panels = common.subplots(1, 3, figsize=(12, 3))
    films = {
        "animation.gif": (scene, walk(axes, planner, args.sim, GOALS, TITLE)),
        "learning.gif": (row, training(panels, args.sim)),
    }
    for name, film in films.items():
        save(*film, args.out / name)
    print("Look at", *films, "in", args.out)


if __name__ == "__main__":
    robot_model.start(main)
