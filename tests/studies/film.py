"""How does the robot walk, and how did it walk at the beginning of a training?

    python tests/studies/film.py --mujoco [--policy FILE] [--out FOLDER]

Draws pictures that explain the stages: double_step.png, clock.png, walks.png and landscape.png. Then it
writes two films. In animation.gif the robot walks to three goals, and is pushed on the way. In
learning.gif the robot walks to one goal with three policies, twice as fast as it is. Two of them are
from the beginning of a training (results/mujoco/film/), the last one is the shipped policy.
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

DURATION = "a minute"
GOALS = [[0.9, 0.5, 1.6], [-0.3, 0.35, 3.0], [0.55, -0.25, 0.0]]  # x, y [m], yaw [rad]; our choice
WINDOW = -0.8, 1.63, -0.41, 1.0  # what is seen: from left to right, from below to above [m]
TITLE = f"Yellow: the two footsteps just chosen. Goal {{}} of {len(GOALS)}"
HELD = 10  # pictures that an event is shown for, 0.8 s
FOOTSTEPS = np.array([[[0.12, 0.05, 0.35], [0.1, 0.02, -0.1]]])  # of double_step.png [m, m, rad]


# ------------------------------------------------------------------------ pictures
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
        color, other = robot_model.COLORS[side], robot_model.COLORS[1 - side]
        support = feet[1 - side]
        usual = robot_model.compose(support, engine.beside[side])
        (back, inward, _), (ahead, outward, _) = limits.low, limits.high
        corners = [[back, inward, 0], [ahead, inward, 0], [ahead, outward, 0], [back, outward, 0]]
        words = [[(back + ahead) / 2, 0.8 * outward, 0]]
        seen = robot_model.compose(usual, (corners + words) * walk_engine.MIRROR[side])[:, :2]
        axes.fill(*seen[:4].T, fc="0.93", ec="0.6", ls="--", zorder=0)
        axes.text(*seen[4], "ankle may\nland here", color="0.4", ha="center", va="center")
        draw_sole(axes, feet[side], side, fc="none", ls=":")
        draw_sole(axes, landing, side, fc=color, alpha=0.4)
        draw_sole(axes, support, 1 - side, fc=other, alpha=0.8)
        for end, axis in zip(0.11 * np.eye(3)[:2], "xy"):
            tip = robot_model.compose(support, end)[:2]
            look = {"arrowprops": {"arrowstyle": "<-"}, "ha": "center", "va": "center"}
            axes.annotate(axis, support[:2], tip, **look)
        arrow = {"arrowstyle": "->", "color": color, "connectionstyle": "arc3,rad=0.2"}
        axes.annotate("", landing[:2], feet[side][:2], arrowprops=arrow)
        axes.plot(*usual[:2], "k+", ms=10)
        x, y, yaw = FOOTSTEPS[0, side]
        title = f"the {name} foot, off its usual place:\n({x:+.2f} m, {y:+.2f} m, {yaw:+.2f} rad)"
        axes.set_title(title, color=color)
        axes.set(aspect="equal", xlabel="x [m]")
        feet[side] = landing
    panels[0].set_ylabel("y [m]")
    return figure


def clock(sim):
    """What happens when within a double step."""
    robot, p = robot_model.ROBOT, walk_engine.TUNED[sim]
    engine = walk_engine.WalkEngine(1, p)
    half, both = engine.step_time, engine.step_time * p.double_support
    figure, axes = common.subplots(figsize=(9, 3.6))
    for side, color in enumerate(robot_model.COLORS):
        axes.barh(-side, engine.period, color=color, alpha=0.25)
        axes.barh(-side, half - both, left=side * half + both, color=color)
        for part, word in (side, "swings"), (1 - side, "stands"):
            axes.text((part + 0.5) * half, -side, word, ha="center", va="center")
    axes.plot([0, engine.period], [1, 1], "kv")
    axes.text(0.01, 1, "the planner gets the goal, and chooses two footsteps", va="center")
    every = robot.control_dt, robot.control_dt, robot.control_dt / robot.substeps
    for row, dt in enumerate(every, 2):
        axes.eventplot(np.arange(0, engine.period + 1e-9, dt), lineoffsets=-row, linelengths=0.6)
        axes.text(engine.period + 0.01, -row, f"every {1000 * dt:.0f} ms", va="center")
    rows = "planner", "left foot", "right foot", "IMU", "joint targets", "physics"
    axes.set_yticks(range(1, -5, -1), rows)
    axes.set_xticks([0, half, engine.period])
    axes.set(xlabel="time in a double step [s]", xlim=(-0.02, engine.period + 0.11))
    axes.grid(False)
    return figure


def walks(sim):
    """Four walks of eight double steps, from above."""
    plans = [[footsteps] * 8 for footsteps in walk_engine.WALKS.values()]  # [4, 8, 2, 3]
    poses, commanded, _ = walk_engine.walk_plans(sim, walk_engine.TUNED[sim], plans)
    figure, axes = common.subplots(figsize=(9, 3.6))
    axes.plot(*commanded[:, 1:, :2].reshape(-1, 2).T, "k+")
    for name, (x, y, _) in zip(walk_engine.WALKS, poses.swapaxes(1, 2)):
        (line,) = axes.plot(x, y, ".-")
        axes.text(x[-1], y[-1] + 0.06, name, color=line.get_color(), ha="center")
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.margins(0.16)  # the names need it
    return figure


def landscape(sim):
    """What the rewards for progress add up to, from a place to the goal."""
    task, levels = env.Task(), np.arange(-2.2, 0.01, 0.2)
    x, y = np.meshgrid(np.linspace(-1.5, 1.5, 151), np.linspace(-1.2, 1.2, 121))
    scales = np.array([task.s_d, task.s_a, task.s_o])[:, None]
    figure, panels = common.subplots(1, 2, figsize=(9, 3.8), sharey=True)
    for axes, yaw, title in zip(panels, (0, np.pi / 2), ("as the goal does", "90° to its left")):
        poses = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, yaw)])
        goal = robot_model.relative(poses, np.zeros(3))
        height = (scales * env.potentials(goal, task.near_m)).sum(0).reshape(x.shape)
        filled = axes.contourf(x, y, height, levels, cmap="Purples_r")
        axes.quiver(0, 0, 1, 0, color="tab:green", scale=8)
        axes.text(0, -0.2, "goal", color="tab:green", ha="center")
        for place in (-1.2, 0), (1.1, 0), (0, -1.0), (0, 0.9):
            axes.quiver(*place, np.cos(yaw), np.sin(yaw), scale=12)
        axes.set(title=f"the robot (black) faces\n{title}", xlabel="x [m]", aspect="equal")
    panels[0].set_ylabel("y [m]")
    figure.colorbar(filled, ax=panels, label="s_d·Φ_d + s_a·Φ_a + s_o·Φ_o [1]", shrink=0.7)
    return figure


PICTURES = double_step, clock, walks, landscape


# ------------------------------------------------------------------------ films
def walk(axes, planner, sim, goals, title):
    """Lets a robot walk to these goals, one after the other, without noise, and yields after every
    picture. On the way to the second goal it is pushed. What happens is shown for longer: a push as
    it begins, a goal as it is reached. Ends early if the robot falls."""
    world = common.world(sim, PushedWorld, num_robots=1, noise=False)
    world.reset([0], [env.stream("evaluation", 0, 0)])
    planner.reset(1)
    # To the right in the picture; on the plane ahead [m/s]
    push = robot_model.turned([0.6, 0], np.pi / 6 * (not world.engine.planar))
    feet = []
    for k, goal in enumerate(goals, 1):
        world.set_goal([0], goal)
        for step in count():
            pushed = k == 2 and step == 2
            more = feet, push * pushed, title.format(k), WINDOW
            for picture, result in enumerate(pictures(axes, world, planner, *more)):
                yield from [result] * (HELD if pushed and picture == 0 else 1)
            if result["fall"][0] or result["timeout"][0]:
                return
            if result["success"][0]:
                axes.set_title(f"{title.format(k)}: arrived, {result['time'][0]:.1f} s")
                yield from [result] * HELD
                break


def training(panels, sim):
    """Lets a robot walk to one goal with three policies, side by side: every second picture of 16 s
    at most, each until its walk ends."""
    films = []
    for axes, name in zip(panels, ("film/1,024.pt", "film/25,600.pt", "policy.pt")):
        model, about = ppo.load_policy(RESULTS / sim / name)
        planner, title = (
            evaluate.PolicyPlanner(model),
            f"{about['steps']:,} double steps\nof training",
        )
        films.append(walk(axes, planner, sim, evaluate.FIGURE_GOALS[:1], title))
    return islice(zip_longest(*films), 0, 200, 2)


def save(figure, film, path):
    """Films what the figure shows after each picture, for 0.08 s (eight ticks)."""
    frames = []
    for _ in tqdm(film, unit=" pictures", leave=False):
        if not frames:
            robot_model.pixels(figure)  # makes the room that the titles need
        frames.append(robot_model.pixels(figure))
    # All frames share 128 colours: so what stands still is stored once.
    colors = Image.fromarray(np.concatenate(frames[::4])).quantize(128, Image.Quantize.FASTOCTREE)
    first, *others = [Image.fromarray(frame).quantize(palette=colors, dither=0) for frame in frames]
    settings = {"save_all": True, "append_images": others, "duration": 80, "loop": 0}
    robot_model.atomic_write(path, lambda file: first.save(file, **settings))


def main(argv=None):
    policy = {"type": Path, "help": "that of animation.gif (default: the shipped one)"}
    args = common.arguments(import_module("film"), argv, policy=policy)
    if args.sim != "mujoco":
        raise robot_model.InputError("the films show the robot in 3-D: add --mujoco")
    for draw in PICTURES:
        robot_model.save_figure(draw(args.sim), args.out / f"{draw.__name__}.png")
    planner = common.policy(args.policy or RESULTS / args.sim / "policy.pt", args.sim)
    scene, axes = common.subplots(figsize=(8, 4))
    row, panels = common.subplots(1, 3, figsize=(9, 2.6))
    row.supxlabel("squares of 0.25 m; twice as fast as the robot")
    films = {
        "animation.gif": (scene, walk(axes, planner, args.sim, GOALS, TITLE)),
        "learning.gif": (row, training(panels, args.sim)),
    }
    for name, film in films.items():
        save(*film, args.out / name)
    print("Look at", args.out)


if __name__ == "__main__":
    robot_model.run_script(main)
