"""How does the robot walk, and how did it walk at the beginning of a training?

    python tests/studies/film.py --mujoco [--policy FILE] [--out FOLDER]

Draws README's pictures (PICTURES), and writes two films. (The pictures of lessons 3 and 5, clock.png,
walks.png and landscape.png, were drawn by the film.py of commit b097353.) In animation.gif the robot
walks to three goals, and is pushed on the way. In learning.gif the robot walks to one goal with three
policies, twice as fast as it is. Two of them are from the beginning of a training
(results/mujoco/film/), the last one is the shipped policy.
"""

from importlib import import_module
from itertools import count, islice, zip_longest
from pathlib import Path

import common
import numpy as np
from common import RESULTS, env, evaluate, ppo, robot_model, walk_engine
from PIL import Image
from play import PushedWorld, pictures
from tqdm import tqdm

DURATION = "two minutes"
GOALS = [[0.9, 0.5, 1.6], [-0.3, 0.35, 3.0], [0.55, -0.25, 0.0]]  # x, y [m], yaw [rad]; our choice
PUSH = 0.52, 0.3  # to the right in the picture [m/s]
HELD = 10  # pictures that an event is shown for, 0.8 s
FOOTSTEPS = np.array([[[0.12, 0.05, 0.35], [0.1, 0.02, -0.1]]])  # of double_step.png [m, m, rad]
LOOP = {  # from the goal to the robot's motion: which stage does what
    "goal": "stage 3\n\nx, y, yaw\nmeasured\n5 cm, 3° off",
    "network": "stage 4\n\nchooses the\nnext two\nfootsteps",
    "walk engine": "stage 2\n\nturns them into\npaths of feet\nand trunk",
    "joints": "stage 1\n\n12 angles\nby inverse\nkinematics",
    "physics": "stage 1\n\nthe robot moves,\nslips, leans,\nor falls",
}


# ------------------------------------------------------------------------ pictures
def loop(sim):
    """From the goal to the robot's motion, and back."""
    figure, axes = common.subplots(figsize=(9, 2.6))
    colors = "palegreen", "plum", "khaki", "lightgray", "lightgray"
    axes.bar(LOOP.keys(), 2, 0.84, color=colors, ec="0.4")
    for x, (name, what) in enumerate(LOOP.items()):
        axes.text(x, 1.7, name, weight="bold", size="large", ha="center")
        axes.text(x, 1.5, what, ha="center", va="top")
        axes.annotate("", (x - 0.4, 1), (x - 0.6, 1), arrowprops={"arrowstyle": "->"})
    axes.plot([x + 0.42, x + 0.6, x + 0.6, -0.6, -0.6], [1, 1, -0.3, -0.3, 1], "k", lw=1)
    period = walk_engine.WalkEngine(1, walk_engine.TUNED[sim]).period
    below = f"where the robot is now: a decision every double step, {period:.1f} s"
    axes.text(2, -0.7, below, ha="center")
    axes.axis((-0.7, 4.7, -0.9, 2.1))
    axes.set_axis_off()
    return figure


def planners(sim):
    """How long the robot takes with README's planners."""
    rows = common.read_json(RESULTS / sim / "evaluation.json")["rows"]
    figure, axes = common.subplots(figsize=(9, 3.2))
    for y, name in enumerate(common.WHAT):
        near, far = common.pick(rows, planner=name, noise=True)
        for row, at, color in (near, y - 0.2, "purple"), (far, y + 0.2, "plum"):
            time, bar = row["time_mean"], 1.96 * row["time_std"] / row["episodes"] ** 0.5
            axes.barh(at, time, 0.4, xerr=bar, color=color)
            axes.text(time + 1, at, f"{time:.1f}", va="center")
    axes.legend(axes.containers[1:4:2], ("near goals", "far goals"), loc="center right")
    axes.set_yticks(range(y + 1), common.WHAT)
    axes.invert_yaxis()
    axes.set(xlim=(0, 21), xlabel="mean time to the goal with noise [s]; line: its 95 % interval")
    return figure


def draw_sole(axes, pose, side, **look):
    """Draws a sole on the floor, seen from above; pose [3] of its ankle."""
    outline = pose[:2] + robot_model.turned(env.sole(robot_model.ROBOT, side), pose[2])
    axes.fill(*outline.T, ec=robot_model.COLORS[side], lw=1.5, **look)


def double_step(sim):
    """Both footsteps of a double step, from above: each is told from its usual place, along the
    axes of the other foot."""
    engine, limits = walk_engine.WalkEngine(1, walk_engine.TUNED[sim]), env.LIMITS[sim]
    figure, panels = common.subplots(1, 2, figsize=(9, 5), sharex=True, sharey=True)
    feet = [*engine.foot_poses[0]]  # where they stand: left, right
    landings = engine.landings(feet[1][None], FOOTSTEPS)
    for side, (axes, name, (landing,)) in enumerate(zip(panels, ("left", "right"), landings)):
        color, support = robot_model.COLORS[side], feet[1 - side]
        usual = robot_model.compose(support, engine.beside[side])
        (back, inward, _), (ahead, outward, _) = limits.low, limits.high
        corners = [[back, inward, 0], [ahead, inward, 0], [ahead, outward, 0], [back, outward, 0]]
        words = [[(back + ahead) / 2, 0.9 * outward, 0]]
        seen = robot_model.compose(usual, (corners + words) * walk_engine.MIRROR[side])[:, :2]
        axes.fill(*seen[:4].T, fc="0.93", ec="0.6", ls="--", zorder=0)
        axes.text(*seen[4], "ankle may land here", color="0.4", ha="center", va="center")
        draw_sole(axes, feet[side], side, fc="none", ls=":")
        draw_sole(axes, landing, side, fc=color, alpha=0.4)
        draw_sole(axes, support, 1 - side, fc=robot_model.COLORS[1 - side], alpha=0.8)
        for end, axis in ([0.11, 0, 0], "x"), ([0, 0.11, 0], "y"):
            tip = robot_model.compose(support, np.array(end))[:2]
            look = {"arrowprops": {"arrowstyle": "<-"}, "ha": "center", "va": "center"}
            axes.annotate(axis, support[:2], tip, **look)
        arrow = {"arrowstyle": "->", "color": color, "connectionstyle": "arc3,rad=0.2"}
        axes.annotate("", landing[:2], feet[side][:2], arrowprops=arrow)
        axes.plot(*usual[:2], "k+", ms=10)
        x, y, yaw = FOOTSTEPS[0, side]
        title = f"the {name} foot, off its usual place:\n({x:+.2f} m, {y:+.2f} m, {yaw:+.2f} rad)"
        axes.set_title(title, color=color)
        axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
        feet[side] = landing
    return figure


PICTURES = loop, planners, double_step


# ------------------------------------------------------------------------ films
def walk(axes, planner, sim, goals, name, window=(-0.55, 1.4, -0.32, 0.95)):
    """Lets a robot walk to these goals, one after the other, without noise, and yields after every
    picture. On the way to the second goal it is pushed. What happens is shown for longer: a push as
    it begins, a goal as it is reached. Ends early if the robot falls. window: what is seen, from left
    to right, from below to above [m]."""
    world = common.world(sim, PushedWorld, num_robots=1, noise=False)
    world.reset([0], [env.stream("evaluation", 0, 0)])
    planner.reset(1)
    feet = []
    for k, goal in enumerate(goals, 1):
        world.set_goal([0], goal)
        for step in count():
            push = PUSH if k == step == 2 else (0, 0)
            film = pictures(axes, world, planner, feet, push, name.format(k), window)
            for picture, result in enumerate(film):
                yield from [result] * (HELD if any(push) and picture == 0 else 1)
            if result["fall"][0] or result["timeout"][0]:
                return
            if result["success"][0]:
                axes.set_title(f"{name.format(k)}\narrived: {result['time'][0]:.1f} s")
                yield from [result] * HELD
                break


def training(panels, sim):
    """Lets a robot walk to one goal with three policies, side by side: every second picture of 9 s at
    most, each until its walk ends."""
    films = []
    for axes, name in zip(panels, ("film/1,024.pt", "film/25,600.pt", "policy.pt")):
        model, about = ppo.load_policy(RESULTS / sim / name)
        how = f"{about['steps']:,} double steps of training", (-0.3, 1.35, -0.3, 0.95)
        goals = evaluate.FIGURE_GOALS[:1]
        films.append(walk(axes, evaluate.PolicyPlanner(model), sim, goals, *how))
    return islice(zip_longest(*films), 0, 112, 2)


def save(figure, film, path):
    """Films what the figure shows after each picture, for 0.08 s (eight ticks)."""
    frames = [robot_model.pixels(figure) for _ in tqdm(film, unit=" pictures", leave=False)]
    # All frames share 128 colours: so what stands still is stored once. The first one is left out:
    # while it is drawn, matplotlib makes the room that the titles need.
    colors = Image.fromarray(np.concatenate(frames[::4])).quantize(128, Image.Quantize.FASTOCTREE)
    _, first, *others = [
        Image.fromarray(frame).quantize(palette=colors, dither=0) for frame in frames
    ]
    settings = {"save_all": True, "append_images": others, "duration": 80, "loop": 0}
    robot_model.atomic_write(path, lambda file: first.save(file, **settings))


def main(argv=None):
    policy = {"type": Path, "help": "that of animation.gif (default: the shipped one)"}
    args = common.arguments(import_module("film"), argv, policy=policy)
    if args.sim != "mujoco":
        raise robot_model.InputError("the films show the robot in 3-D: add --mujoco")
    for draw in PICTURES:
        robot_model.save_figure(draw(args.sim), args.out / f"{draw.__name__}.png")
    figure, axes = common.subplots(figsize=(8.3, 5.8))
    planner = common.policy(args.policy or RESULTS / args.sim / "policy.pt", args.sim)
    film = walk(axes, planner, args.sim, GOALS, "goal {} of 3; yellow: the next two footsteps")
    save(figure, film, args.out / "animation.gif")
    figure, panels = common.subplots(1, 3, figsize=(9, 3.1))
    figure.supxlabel("2 × speed; squares of 0.25 m")
    save(figure, training(panels, args.sim), args.out / "learning.gif")
    print("Look at", args.out)


if __name__ == "__main__":
    robot_model.run_script(main)
