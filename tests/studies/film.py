"""How does the robot walk, and how did it walk at the beginning of a training?

    python tests/studies/film.py --mujoco [--out FOLDER]

Draws README's pictures (PICTURES), and films learning.gif: the robot walks to one goal with three
policies, twice as fast as it is. Two of them are from the beginning of a training
(results/mujoco/film/), the last one is the shipped policy. (The pictures of lessons 3 and 5, clock.png,
walks.png and landscape.png, were drawn by the film.py of commit b097353.)
"""

from importlib import import_module
from itertools import islice, zip_longest

import common
import numpy as np
from common import RESULTS, env, evaluate, ppo, robot_model, walk_engine
from PIL import Image
from play import PushedWorld, pictures
from tqdm import tqdm

DURATION = "two minutes"
WINDOW = -0.3, 1.35, -0.2, 0.9  # what the film shows, from left to right, from below to above [m]
FOOTSTEPS = np.array([[[0.12, 0.05, 0.35], [0.1, 0.02, -0.1]]])  # of double_step.png [m, m, rad]
LOOP = {  # from the goal to the robot's motion: which stage does what
    "goal": "stage 3\n\nx, y, yaw\nmeasured\n± 5 cm, ± 3°",
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
    axes.plot([x + 0.42, x + 0.6, x + 0.6, -0.6, -0.6], [1, 1, -0.6, -0.6, 1], "k", lw=1)
    axes.plot([x, x, 2, 2], [0, -0.2, -0.2, 0], "k^-", lw=1, markevery=[3])
    axes.text(3, -0.5, "how it leans: every 10 ms", ha="center")
    period = walk_engine.WalkEngine(1, walk_engine.TUNED[sim]).period
    below = f"where the robot is now: a decision every double step, {period:.1f} s"
    axes.text(2, -0.95, below, ha="center")
    axes.axis((-0.7, 4.7, -1.1, 2.1))
    axes.set_axis_off()
    return figure


def planners(sim):
    """How much longer the robot takes with README's other planners than with the policy."""
    ratios = common.read_json(RESULTS / sim / "evaluation.json")["ratios"]
    figure, axes = common.subplots(figsize=(9, 2.8))
    rivals = [name for name in common.WHAT if name != "policy"]
    for y, name in enumerate(rivals):
        rows, color = common.pick(ratios, reference=name, noise=True), common.COLORS[name]
        for at, goals, row in zip((y - 0.15, y + 0.15), ("near", "far"), rows):
            more, *ends = (100 / x - 100 for x in (row["time_ratio"], *row["time_ratio_ci95"]))
            axes.plot(ends, [at, at], color, lw=3)
            axes.plot(more, at, "o", color=color)
            beyond = " →" * (more > 15)  # the end of the axis
            axes.text(
                min(max(ends) + 0.2, 12.5), at, f"{goals}: +{more:.0f} %{beyond}", va="center"
            )
    axes.axvline(0, color=common.COLORS["policy"], lw=2)
    axes.text(0.1, len(rivals) - 0.6, "policy", color=common.COLORS["policy"])
    axes.set_yticks(range(len(rivals)), rivals)
    axes.set_ylim(len(rivals) - 0.5, -0.5)
    label = "time beyond that of one network, 500 goals each [%]; lines: 95 % intervals"
    axes.set(xlim=(-0.5, 15), xlabel=label)
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
    x, y, _ = np.array([limits.low, limits.high]).T  # least and most
    corners = np.column_stack([x[[0, 1, 1, 0]], y[[0, 0, 1, 1]], np.zeros(4)])
    for side, (axes, name, (landing,)) in enumerate(zip(panels, ("left", "right"), landings)):
        color, support = robot_model.COLORS[side], feet[1 - side]
        usual = robot_model.compose(support, engine.beside[side])
        allowed = robot_model.compose(usual, corners * walk_engine.MIRROR[side])
        axes.fill(*allowed.T[:2], fc="0.93", ec="0.6", ls="--", zorder=0)
        middle = np.average(allowed[:, :2], 0, [1, 1, 5, 5])
        axes.text(*middle, "ankle may\nland here", color="0.4", ha="center", va="center")
        draw_sole(axes, feet[side], side, fc="none", ls=":")
        draw_sole(axes, landing, side, fc=color, alpha=0.4)
        draw_sole(axes, support, 1 - side, fc=robot_model.COLORS[1 - side], alpha=0.8)
        for letter, end in zip("xy", 0.11 * np.eye(2, 3)):
            tip = robot_model.compose(support, end)[:2]
            look = {"arrowprops": {"arrowstyle": "<-"}, "ha": "center", "va": "center"}
            axes.annotate(letter, support[:2], tip, **look)
        arrow = {"arrowstyle": "->", "color": color}
        axes.annotate("", landing[:2], usual[:2], arrowprops=arrow)
        axes.plot(*usual[:2], "k+", ms=10)
        step = "{:+.2f} m, {:+.2f} m, {:+.2f} rad".format(*FOOTSTEPS[0, side]).replace("-", "−")
        axes.set_title(f"the {name} foot, off its usual place:\n({step})", color=color)
        axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
        feet[side] = landing
    return figure


PICTURES = loop, planners, double_step


# ------------------------------------------------------------------------ film
def walk(axes, planner, sim, name):
    """Lets a robot walk to a goal without noise, for 9 s at most, and yields after every picture."""
    task = env.Task(time_limit=9.0)
    world = common.world(sim, PushedWorld, num_robots=1, noise=False, task=task)
    world.reset([0], [env.stream("evaluation", 0, 0)])
    world.set_goal([0], evaluate.FIGURE_GOALS[0])
    planner.reset(1)
    feet, on_its_way = [], True
    while on_its_way:
        for result in pictures(axes, world, planner, feet, (0, 0), name, WINDOW):
            yield result
        on_its_way = not (result["success"] | result["fall"] | result["timeout"])[0]
    arrived = f"arrived: {result['time'][0]:.1f} s" if result["success"][0] else "not arrived"
    axes.set_title(f"{name}\n{arrived}")
    yield from 48 * [result]  # so the end stays in sight for two seconds


def training(panels, sim):
    """Lets a robot walk to one goal with three policies, side by side: every second picture."""
    films = []
    for axes, name in zip(panels, ("film/1,024.pt", "film/25,600.pt", "policy.pt")):
        model, about = ppo.load_policy(RESULTS / sim / name)
        how = f"{about['steps']:,} double steps of training"
        films.append(walk(axes, evaluate.PolicyPlanner(model), sim, how))
    return islice(zip_longest(*films), 0, None, 2)


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
    args = common.arguments(import_module("film"), argv)
    if args.sim != "mujoco":
        raise robot_model.InputError("the film shows the robot in 3-D: add --mujoco")
    for draw in PICTURES:
        robot_model.save_figure(draw(args.sim), args.out / f"{draw.__name__}.png")
    figure, panels = common.subplots(1, 3, figsize=(9, 2.6))
    save(figure, training(panels, args.sim), args.out / "learning.gif")
    print("Look at", args.out)


if __name__ == "__main__":
    robot_model.run_script(main)
