"""Stage 5: is the learned policy better than other planners, and how sure are we?

Paper: section III, 500 goals with and without measurement noise (Table II, Fig. 3). Its baseline
[10] is a velocity controller: its speed is proportional to the distance, up to a limit.

    python 05_evaluate.py --noise          the paper's table and figure, with our robot: a minute
    python 05_evaluate.py --noise --far    also 500 goals twice as far, in a block of their own
    python 05_evaluate.py --gif            also a film: three goals, and a push on the way
    python 05_evaluate.py --goals my.csv   your own goals: columns x, y, yaw in m, m, rad
    python 05_evaluate.py --friction 0.4   the same floor for all, instead of a random one
    python 05_evaluate.py --push 0.4       pushes by 0.4 m/s, every 3 s on average
    python 05_evaluate.py --planner my.py  your own planner beside the others (several, if you like)
    python 05_evaluate.py --robot my.py    another robot: ROBOT, WALK, LIMITS of your file
    python 05_evaluate.py --play           click a goal, push the robot, change the planner

(`--mujoco` in 3-D.) It evaluates your own policy, in `runs/<sim>/`, or else the shipped one in
`results/<sim>/`; `--policy` names another file (or several). A policy trained with another walk,
task or robot is evaluated, too, and a note says what differs. The stage prints tables. Their times
are those of the walks that succeed: the mean, the median, and the time within which 95 % of them
arrive. It writes table.md, evaluation.json, trials.csv and footsteps.png (two walks without noise)
to `runs/<sim>/`. Predict: the paper's policy takes half of the baseline's time, and with the policy
the robot falls about twice as often as with the baseline. Is this so with our policy?

A planner is a class with `reset(num_robots)`, called before the trials, and `act(view)`, which
returns actions [n, 6] in [0, 1]. `view` is the `View` of stage 3 for n robots: `view.goal` [n, 3]
is the goal as the robots know it, x, y [m], yaw [rad]. With noise it is estimated from all
measurements so far. A planner may use nothing but the view; `tests/studies/search.py` is a worked
example. All planners meet the same goals, floors, bodies and pushes, and at their k-th decision the
same noise (common random numbers). So no row has easier goals. (Other goals and worlds would give
other numbers.)
`baseline` is the paper's, but decides once per double step. `baseline_tuned` is the same with
settings optimised for this world, and both feet share a sidestep or a turn.

How sure are we? The true rate is that of infinitely many walks (trials). A 95 % interval contains
all true rates with which the counted number is plausible; of 100 such intervals about 95 contain
the truth. A far walk has the floor, the body and the noise of a near one, and a goal twice as far.
So 500 near and 500 far walks are 500 pairs, not 1,000 independent walks. Seed 0 is for trying
things. Test your final choice with another `--seed`.

Leaves out: standing up after a fall, obstacles, the spread over training seeds.
[10] Hamburg Bit-Bots, bitbots_main, https://github.com/bit-bots/bitbots_main, as of 2024-10-02.
"""

import csv
import io
import itertools
import json
import math
import multiprocessing
import os
import runpy
import signal
import sys
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image
from tqdm import tqdm

robot_model = import_module("01_robot_model")
env = import_module("03_env")
ppo = import_module("04_ppo")

OUTCOMES = ("success", "timeout", "fall")
PAPER = {  # Table II by (planner, noise): success | timeout | fall | success time [s] ± its std
    ("policy", False): "0.980 | 0.000 | 0.020 | 6.07 ± 2.13",
    ("baseline", False): "0.960 | 0.032 | 0.008 | 11.13 ± 4.95",
    ("policy", True): "0.978 | 0.000 | 0.022 | 6.35 ± 2.23",
    ("baseline", True): "0.910 | 0.078 | 0.012 | 11.43 ± 5.11",
}
FIGURE_GOALS = np.array([[0.9, 0.5, 1.6], [-0.7, -0.6, -2.6]])  # x, y [m], yaw [rad]; our choice
FILM_GOALS = np.array([[0.9, 0.5, 1.6], [-0.3, 0.35, 3.0], [0.55, -0.25, 0.0]])  # the same


# ------------------------------------------------------------------------ the baseline
@dataclass(frozen=True)
class BaselineSettings:
    """The settings of [10] in its team's public files: cautious, for the real robot."""

    forward: float = 0.12  # [m/s] speed limit
    backward: float = 0.06  # [m/s]
    sideways: float = 0.07  # [m/s]
    turning: float = 0.3  # [rad/s]
    gain: float = 1.0  # [1/s] speed per distance
    turning_gain: float = 0.3  # [1/s] turning speed per heading error
    far_m: float = 1.0  # [m] farther away the robot turns to the goal's position
    time_constant: float = 1.0  # [s] τ of the filter; 0: none
    share: bool = False  # do both feet share a sideways distance and a turn? Ours


TUNED_BASELINE = {  # the same controller for this world, by `tests/studies/baseline.py`, 2026-11-26
    "pymunk": BaselineSettings(
        forward=0.4516,
        backward=0.5084,
        sideways=0.3044,
        turning=1.2288,
        gain=1.0051,
        turning_gain=0.8696,
        far_m=0.979,
        time_constant=0.2265,
        share=True,
    ),
    "mujoco": BaselineSettings(
        forward=0.4192,
        backward=0.3711,
        sideways=0.1965,
        turning=1.5997,
        gain=1.0042,
        turning_gain=0.8246,
        far_m=0.5153,
        time_constant=0.2825,
        share=True,
    ),
}


def velocity_command(goal, settings):
    """The speeds [n, 3] to goals seen from the robot [n, 3]: v_x, v_y [m/s], ω [rad/s]."""
    d, alpha, beta = env.polar(goal)  # each [n]: distance [m], goal yaw, goal direction [rad]
    cos, sin = np.cos(beta), np.sin(beta)
    # The limits span a diamond: |v_x| / x_max + |v_y| / y_max ≤ 1. With v_x = v·cos β and
    # v_y = v·sin β:  v_max(β) = 1 / (|cos β| / x_max + |sin β| / y_max)
    x_max = np.where(cos >= 0, settings.forward, settings.backward)
    v_max = 1 / (np.abs(cos) / x_max + np.abs(sin) / settings.sideways)
    # v = min(gain·d, v_max(β))
    v = np.minimum(settings.gain * d, v_max)
    # ω = clip(turning gain·e, ±ω_max),  e = β far from the goal, α near it
    error = np.where(d > settings.far_m, beta, alpha)
    omega = np.clip(settings.turning_gain * error, -settings.turning, settings.turning)
    return np.stack([v * cos, v * sin, omega], -1)  # [n, 3]


def low_pass(velocity, command, seconds, time_constant):
    """The filter τ·dv/dt = v_cmd − v, solved exactly, after `seconds`; τ = 0: no filter."""
    # v ← v + (1 − exp(−t/τ))·(v_cmd − v)
    return velocity + (1 - math.exp(-seconds / max(time_constant, 1e-9))) * (command - velocity)


def velocity_to_footsteps(velocity, period, lead=(1, 0.5)):
    """v_x, v_y [m/s], ω [rad/s] [n, 3] as footsteps [n, 2, 3], each seen from the other foot.

    lead: share of a sideways distance and of a turn that the leading foot takes, outward.
    """
    # x: each foot lands v_x·(period/2) ahead of the other one
    # y: of the distance v_y·period the leading foot (left to the left, right to the right) takes
    #    its share, outward; the other foot follows with the rest, inward
    # yaw: the turn ω·period is shared in the same way
    forward = velocity[:, 0] * period / 2  # [n] [m]
    way = velocity[:, 1:] * period  # [n, 2] [m, rad] to the left
    out = np.multiply(lead, way)  # of the leading foot
    rest = way - out
    left = np.where(way > 0, out, rest)
    right = -np.where(way > 0, rest, out)  # mirrored
    return np.stack([np.column_stack([forward, side]) for side in (left, right)], 1)


class BaselinePlanner:
    """The controller of [10]; it decides once per double step instead of 20 times a second."""

    def __init__(self, settings=BaselineSettings()):
        robot_model.check(settings)
        self.settings = settings

    def reset(self, num_robots):
        # Filtered: v_x, v_y [m/s], ω [rad/s]; nan: no command yet
        self.velocity = np.full((num_robots, 3), np.nan)

    def act(self, view):
        """Actions [n, 6], clipped to the same step limits as the policy's."""
        command = velocity_command(view.goal, self.settings)
        last = self.velocity[view.robots]
        last = np.where(np.isnan(last), command, last)  # the first command is not filtered
        velocity = low_pass(last, command, view.period, self.settings.time_constant)
        self.velocity[view.robots] = velocity
        lead = (1, 0.5)  # [10]: only the leading foot steps sideways; both feet turn by the same
        if self.settings.share:  # each foot in proportion to its limit: out / (out + in)
            span = np.subtract(view.limits.high, view.limits.low)  # [3]
            lead = (view.limits.high / span)[1:]
        return env.to_action(velocity_to_footsteps(velocity, view.period, lead), view.limits)


class PolicyPlanner:
    """The trained policy without exploring: `ActorCritic.decide` of stage 4."""

    def __init__(self, model):
        self.model = model
        self.columns = model.shape["obs_dim"]  # the rows of the IMU are the last ones

    def reset(self, num_robots):
        """Resets nothing: the two previous actions are part of the observation."""

    def act(self, view):
        return self.model.decide(view.observation[:, : self.columns])


# ------------------------------------------------------------------------ trials
@dataclass
class Trials:
    """Where n robots should go, and what their random floors, bodies and noise depend on."""

    goals: np.ndarray  # [n, 3] x, y [m], yaw [rad]
    seed: int  # of the random stream; trial i is number i in it
    purpose: str = "evaluation"  # a name in `STREAMS` of stage 3
    first: int = 0  # number of the first trial in the stream


def draw_trials(seed, count, far=False, purpose="evaluation"):
    """The trials 0, 1, …; a far trial is the near one of its number with the goal twice as far."""
    goals = env.draw_goals(env.stream(purpose, seed), count, far=far)
    return Trials(goals, seed, purpose)


def evaluate(planner, world, trials, watch=None):
    """Lets robot i walk to the goal of trial i, all at the same time, until each trial has ended.

    watch(robots, motion) is called after every double step. Returns arrays [n]:
        friction      μ of the floor
        outcome       a name in OUTCOMES
        time          [s] of a success: to the first of the two double steps that ended at the goal
        steps         double steps
        still_there   a success, and at the goal also after two more double steps in place
        reached_once  at the goal at least once (all that the paper asks for)
        time_once     [s] to that moment, or 0
    """
    n = len(trials.goals)
    everybody = np.arange(n)
    # One generator per trial: its numbers depend neither on the planner nor on other trials.
    rngs = [env.stream(trials.purpose, trials.seed, trials.first + i) for i in range(n)]
    world.reset(everybody, rngs, trials.goals)
    planner.reset(n)
    outcome = np.full(n, "running", object)
    time, time_once = np.zeros((2, n))  # [s] time_once: 0 as long as it was not at the goal
    walking = everybody  # [k] whose trial has not ended
    while len(walking):
        result = double_step(planner, world, walking)
        for name in OUTCOMES:  # the simulated pose decides
            outcome[walking[result[name]]] = name
        time[walking] = result["time"]
        first = result["inside"] & (time_once[walking] == 0)  # [k]
        time_once[walking[first]] = result["time"][first]
        if watch:
            watch(walking, result["motion"])
        walking = walking[outcome[walking] == "running"]
    steps = world.steps[everybody]  # a copy, for two more double steps follow
    still_there = np.zeros(n, bool)
    standing = everybody[outcome == "success"]
    for _ in range(2):  # two more double steps, in place; what counts is the second one
        if len(standing):
            result = world.step([world.neutral_action] * len(standing), standing)
            still_there[standing] = result["inside"]
            standing = standing[~result["fall"]]
    return {
        "friction": world.friction[everybody],
        "outcome": outcome,
        "time": time,
        "steps": steps,
        "still_there": still_there,
        "reached_once": time_once > 0,
        "time_once": time_once,
    }


def double_step(planner, world, robots, push=(0, 0)):
    """Looks, decides, walks: returns what `FootstepWorld.step` does. push [m/s]: of the torsos as
    the double step begins, along the world's x and y; planar: ahead.

    Raises a ValueError that names the planner's file if its actions are not [n, 6] in [0, 1].
    """
    name = f"{type(planner).__module__}: actions"  # the module of your own is its file
    actions = env.checked(name, planner.act(world.look(robots)), len(robots), 6)
    low, high = actions.min(), actions.max()
    if low < 0 or high > 1:
        raise ValueError(f"{name} must lie between 0 and 1, not from {low:.3g} to {high:.3g}")
    force = env.walk_engine.push_force(world.engine.robot, np.array(push))  # [2] [N]

    def disturb(disturbance, robots):
        disturbance.push[:, : env.walk_engine.PUSH_TICKS] += force

    return world.step(actions, robots, disturb)


def record(planner, world, trials):
    """Walks, and yields a dict for each trial: torso [T, 6] and joints [T, 12] at all T ticks of
    the walk, ends [K] of its K double steps [ticks], and the feet [K, 2, 3] (x, y, yaw) at these
    ends.
    """
    steps = [[] for _ in trials.goals]  # of every robot: torso and joints in each double step

    def watch(robots, motion):
        for i, torso, joints, ticks in zip(robots, motion.torso, motion.joints, motion.ticks):
            steps[i].append((torso[:ticks], joints[:ticks]))

    ended = evaluate(planner, world, trials, watch)
    for i, goal in enumerate(trials.goals):
        torso, joints = map(np.concatenate, zip(*steps[i]))
        ends = np.cumsum([len(torso) for torso, _ in steps[i]])
        last = torso[ends - 1], joints[ends - 1]
        yield {
            "goal": goal,
            "ending": f"{ended['outcome'][i]} after {ended['time'][i]:.1f} s",
            "friction": ended["friction"][i],
            "feet": robot_model.foot_poses(world.engine.robot, *last),
            "ends": ends,
            "torso": torso,
            "joints": joints,
        }


# ------------------------------------------------------------------------ statistics
def wilson(count, total, z=1.96):
    """95 % interval of a rate: `count` of `total` trials (Wilson score; not zero wide at 0)."""
    # (p + z²/(2n) ± z·√(p·(1 − p)/n + z²/(4n²))) / (1 + z²/n)
    p, shrink = count / total, 1 + z**2 / total
    centre = p + z**2 / (2 * total)
    margin = z * math.sqrt(p * (1 - p) / total + z**2 / (4 * total**2))
    return [max(0.0, (centre - margin) / shrink), min(1.0, (centre + margin) / shrink)]


def bootstrap(statistic, *samples, resamples=2000):
    """95 % interval of a statistic of samples [n], by resampling.

    Many times n of the samples are chosen at random, with replacement. Samples of the same walks
    are chosen together. (This has nothing to do with stage 4's bootstrapping.)

    statistic: samples [resamples, n] -> [resamples].
    """
    count = len(samples[0])
    pick = np.random.default_rng(0).integers(count, size=(resamples, count))  # [resamples, n]
    return np.percentile(statistic(*(sample[pick] for sample in samples)), [2.5, 97.5])


def time_ratio(trials, reference):
    """Compares the times of two planners over the goals that both reached; returns a dict:

    goals                         how many these are; without one the dict is empty
    time_ratio, time_ratio_ci95   mean time / mean time of the reference, its 95 % interval
    median                        of the ratios goal by goal
    faster, slower                shares of the goals that took less, more than the reference
    """
    both = (trials["outcome"] == "success") & (reference["outcome"] == "success")
    if not both.any():
        return {}
    ours, theirs = trials["time"][both], reference["time"][both]
    return {
        "goals": len(ours),
        "time_ratio": ours.mean() / theirs.mean(),
        # In pairs: both planners take long to a far goal, and this cancels in the ratio.
        "time_ratio_ci95": [*bootstrap(lambda a, b: a.mean(1) / b.mean(1), ours, theirs)],
        "median": np.median(ours / theirs),
        "faster": np.mean(ours < theirs),
        "slower": np.mean(ours > theirs),
    }


# ------------------------------------------------------------------------ pictures
def plot_footsteps(robot, columns, path):
    """Draws the paper's Fig. 3; columns: walks to the same goals, by planner (three)."""
    figure, axes = plt.subplots(1, 3, figsize=(13.2, 4.8), sharex=True, sharey=True)
    for panel, (name, walks) in zip(axes, columns.items()):
        title = f"{name}, without noise"
        for number, walk in enumerate(walks, 1):
            camera = robot_model.camera_at(-90, 90)
            robot_model.draw_way(panel, robot, walk["goal"], walk["feet"], camera)
            panel.plot(*walk["torso"][:, :2].T, "k", lw=1)
            x, y, _ = walk["goal"]  # its name stands on the far side of it
            panel.text(x, y + math.copysign(0.22, y), f"goal {number}", ha="center", va="center")
            title += f"\ngoal {number}: {walk['ending']}, μ = {walk['friction']:.2f}"
        panel.plot(0, 0, "ro")
        panel.set_title(title, parse_math=False)  # a $ in a name is no formula
        panel.set(aspect="equal", xlabel="x [m]")
        panel.margins(0.15)
    axes[0].set_ylabel("y [m]")
    left, right, *_, goal = axes[0].patches  # as `draw_way` of stage 1 drew them
    figure.legend(
        [left, right, goal, axes[0].lines[0], axes[0].lines[-1]],
        ["left foot", "right foot", "goal", "torso on the floor", "start"],
        loc="outside lower center",
        ncols=5,
    )
    robot_model.save_figure(figure, path)


def pictures(axes, world, feet, motion, push):
    """Draws what the only robot has just done, and yields the time [s] of every picture, one for
    eight ticks.

    Yellow: the footsteps that were chosen, from where the right foot stood. feet: a list of earlier
    ones [2, 3]; those at the beginning are added. push [2]: see `double_step`. (The planar robot
    cannot spread its legs: its left foot lands to the right of its mark.)
    """
    engine = world.engine
    began = world.ticks[0] - motion.ticks[0]
    feet += [*robot_model.foot_poses(engine.robot, motion.torso[:, 0], motion.joints[:, 0])]
    steps = env.to_footsteps(world.actions[:1, 0], world.limits)
    chosen = np.stack(engine.landings(feet[-1][None, robot_model.RIGHT], steps), 1)  # [1, 2, 3]
    for tick in range(0, motion.ticks[0], 8):
        torso, joints = motion.torso[0, tick], motion.joints[0, tick]
        camera = env.draw_scene(
            axes, engine.robot, world.goal[0], feet[-20:], torso, joints, chosen
        )
        if any(push) and tick < 32:  # it lasts for 5 ticks, which nobody would see
            tip, speed = torso[:3] + [0, 0, 0.15], math.hypot(*push)
            way = robot_model.turned(push, torso[5] * engine.planar)
            tail = tip - [*(0.5 / speed * way), 0]
            style = {"color": "tab:red", "arrowprops": {"color": "tab:red"}, "ha": "center"}
            axes.annotate(f"push: {speed:.1f} m/s", camera[1:] @ tip, camera[1:] @ tail, **style)
        yield (began + tick) * engine.robot.control_dt


def plot_tour(world, planner, speed, path):
    """Films the robot as it walks to FILM_GOALS, one after the other, in real time. On the way to
    the second one it is pushed at this speed [m/s]. The film ends early if the robot falls.
    """
    figure, axes = plt.subplots(figsize=(8, 4))
    # To the right in the picture; on the plane ahead
    push = robot_model.turned([speed, 0], np.pi / 6 * (not world.engine.planar))

    def walk():
        world.reset([0], [env.stream("evaluation", 0, 0)])
        planner.reset(1)
        feet = []
        for k, goal in enumerate(FILM_GOALS, 1):
            world.set_goal([0], goal)
            for step in itertools.count():
                pushed = push * (k == 2 and step == 2)
                result = double_step(planner, world, np.array([0]), pushed)
                for seconds in pictures(axes, world, feet, result["motion"], pushed):
                    title = f"Goal {k} of {len(FILM_GOALS)}, {seconds:.1f} s."
                    axes.set_title(f"{title} Yellow: the two footsteps just chosen")
                    axes.axis([-0.8, 1.6, -0.32, 0.95])
                    yield
                if result["fall"][0] or result["timeout"][0]:
                    return
                if result["success"][0]:
                    break

    save_film(figure, walk(), path, 0.08)


def save_film(figure, pictures, path, seconds):
    """Films what the figure shows after each of the pictures, for so long; the last one stays."""
    frames = []
    for _ in tqdm(pictures, unit=" pictures", leave=False):
        figure.canvas.draw()
        frames.append(np.array(figure.canvas.buffer_rgba())[..., :3])
    plt.close(figure)
    # All frames share 256 colours: so what stands still is stored once.
    colors = Image.fromarray(np.concatenate(frames[::4])).quantize(method=Image.Quantize.FASTOCTREE)
    first, *others = [Image.fromarray(frame).quantize(palette=colors, dither=0) for frame in frames]
    film = {"save_all": True, "append_images": others, "loop": 0}
    film["duration"] = [*[1000 * seconds] * len(others), 2000]  # [ms]
    robot_model.atomic_write(path, lambda file: first.save(file, **film))


# ------------------------------------------------------------------------ to play with
def open_window():
    """An empty figure on the screen, and its axes."""
    plt.rcParams["toolbar"] = "None"  # every picture sets its own axes, so nobody can zoom
    for backend in ("MacOSX", "QtAgg", "TkAgg"):
        try:
            plt.switch_backend(backend)
        except ImportError:
            continue
        figure, axes = plt.subplots(num="Click a goal, and the robot walks there", figsize=(9, 7))
        # matplotlib's own keys would move the picture
        figure.canvas.mpl_disconnect(figure.canvas.manager.key_press_handler_id)
        return figure, axes
    raise robot_model.InputError("--play needs a display, and Tk or Qt (pip install pyqt6)")


def play(world, planners, speed):
    """Lets a robot walk to where the mouse is pressed, until the window closes.

    Dragging gives the goal's heading. After a fall the robot stands at the origin again. Planners
    by name; p takes the next one, space is a push at this speed [m/s].
    """
    figure, axes = open_window()
    figure.supxlabel(
        "click: a goal; drag: its heading; space: a push; r: reflex on, off; p: another planner"
    )
    robots, engine = np.array([0]), world.engine
    walk = engine.parameters
    keys = ["p"]  # that were pressed; the first p takes the first planner
    goal = np.zeros(3)  # x, y [m], yaw [rad]
    pressed = np.zeros(2)  # x, y [m] where the mouse was
    camera = robot_model.camera_at()

    def ground(*place):
        """The place on the floor, x, y [m], that is at a place in the picture."""
        return np.linalg.solve(camera[1:, :2], place)

    def press(event):
        pressed[:] = ground(event.xdata, event.ydata) if event.inaxes else np.nan

    def release(event):
        nonlocal clock, arrived
        if event.inaxes and np.isfinite(pressed[0]):
            x, y = ground(event.xdata, event.ydata) - pressed
            yaw = math.atan2(y, x) if x or y else world.pose[0, 2]  # was it dragged?
            goal[:] = *pressed, yaw
            world.set_goal(robots, goal)
            clock, arrived = 0, False

    connect = figure.canvas.mpl_connect
    connect("button_press_event", press)
    connect("button_release_event", release)
    connect("key_press_event", lambda event: keys.append(event.key))
    names = itertools.cycle(planners)
    reflex = fell = True
    pushes = falls = 0
    while plt.fignum_exists(figure.number):
        if fell:
            world.reset(robots, goals=goal[None])
            feet = []
            clock, arrived = 0, False  # [s] since the goal was set
        if "p" in keys:
            name = next(names)
        if fell or "p" in keys:
            planners[name].reset(1)
        reflex ^= "r" in keys  # switched on or off
        engine.parameters = walk if reflex else replace(walk, reflex=0.0)
        angle = np.random.default_rng().uniform(-np.pi, np.pi) * (not engine.planar)
        push = robot_model.turned([speed, 0], angle) * (" " in keys)  # 0: none
        result = double_step(planners[name], world, robots, push)
        keys.clear()
        fell = result["fall"][0]
        pushes += push.any()
        falls += fell
        arrived |= result["success"][0]
        clock += result["seconds"][0] * (not arrived)  # to the first of two inside
        title = (
            f"{name}, reflex {'on' if reflex else 'off'}: "
            f"{'arrived after ' if arrived else ''}{clock:.1f} s\n{pushes} pushes, {falls} falls"
        )
        for _ in pictures(axes, world, feet, result["motion"], push):
            axes.set_title(title, parse_math=False)
            axes.axis([-1.7, 1.7, -1.0, 1.6])
            plt.pause(0.04)  # half of the 0.08 s of eight ticks; to draw takes about the other half


# ------------------------------------------------------------------------ tables
# From here on: tables, files and the command line.
def compare(results):
    """Compares the policy's times with those of every other planner, see `time_ratio`; trials by
    (planner, noise, σ of the goals).
    """
    ratios = []
    for (name, noise, std), trials in results.items():
        ratio = time_ratio(results["policy", noise, std], trials)
        if name != "policy" and ratio:
            row = {"planner": "policy", "noise": noise, "goal_std_m": std, "reference": name}
            ratios.append(row | ratio)
    return ratios


def summary(planner, noise, std, trials, task):
    """One row of the table; std: σ of the goals' x and y [m], None for goals of one's own."""

    def known(statistic, values):  # None: there was nothing to measure
        return float(statistic(values)) if len(values) else None

    shares = {name: trials["outcome"] == name for name in OUTCOMES}
    reached, once = shares["success"], trials["reached_once"]
    shares |= {
        "still_there": trials["still_there"][reached],  # of the successes
        "reached_once": once,  # from here on by the paper's rule
        "timeout_once": shares["timeout"] & ~once,
        "fall_once": shares["fall"] & ~once,
    }
    row = {"planner": planner, "noise": noise, "goal_std_m": std, "episodes": len(reached)}
    if noise:
        row |= {"noise_m": task.noise_m, "noise_rad": task.noise_rad}
    row |= {name: known(np.mean, share) for name, share in shares.items()}
    row["falls"] = int(shares["fall"].sum())
    for name in OUTCOMES:
        row[f"{name}_ci95"] = wilson(int(shares[name].sum()), len(reached))
    times, times_once = trials["time"][reached], trials["time_once"][once]  # [s]
    for name, values in (("time", times), ("time_once", times_once)):
        row[f"{name}_mean"] = known(np.mean, values)
        row[f"{name}_std"] = known(np.std, values)
    row["time_median"] = known(np.median, times)
    row["time_p95"] = known(lambda t: np.quantile(t, 0.95), times)
    return row


def markdown(head, rows):
    """A table in Markdown with aligned columns; a line is a text like "cell | cell"."""
    cells = [line.split(" | ") for line in (head, *rows)]
    cells.insert(1, ["---"] * len(cells[0]))
    widths = [max(map(len, column)) for column in zip(*cells)]
    return "".join(f"| {' | '.join(map(str.ljust, line, widths))} |\n" for line in cells)


def number(value, form):
    """A number as a text; None: there was nothing to measure."""
    return "none" if value is None else format(value, form)


def table(rows, ratios, special=""):
    """Three kinds of tables in Markdown, 100 columns at most: our rows, for each kind of goals;
    those that the paper has, too, by its rule; the policy's times compared with those of others.
    special: flags with which the walks differ from the paper's, which is then left out."""
    parts, once, pairs = [f"With {special}\n"] * bool(special), [], []
    for (goals, noise), same in itertools.groupby(rows, kind_of):
        ours = []
        for row in same:
            low, high = row["success_ci95"]
            mean, median, late = (
                number(row[f"time_{name}"], ".2f") for name in ("mean", "median", "p95")
            )
            ours.append(
                f"{row['planner']} | {row['success']:.3f} [{low:.3f}, {high:.3f}] "
                f"| {row['timeout']:.3f} | {row['fall']:.3f} | {mean}, {median}, {late} "
                f"| {number(row['still_there'], '.3f')}"
            )
            known = PAPER.get((row["planner"], row["noise"]))
            if known and row["goal_std_m"] == env.Task.goal_std_m and not special:
                mean, std = (number(row[f"time_once_{name}"], ".2f") for name in ("mean", "std"))
                once += [
                    f"{noise} | {row['planner']} | ours | {row['reached_once']:.3f} "
                    f"| {row['timeout_once']:.3f} | {row['fall_once']:.3f} | {mean} ± {std}",
                    f"{noise} | {row['planner']} | paper | {known}",
                ]
        head = "planner | success [95 %] | timeout | fall | time [s], median, 95 % | still there"
        parts.append(f"Goals: {goals}; noise: {noise}\n\n" + markdown(head, ours))
    for row in ratios:
        low, high = row["time_ratio_ci95"]
        pairs.append(
            f"{' | '.join(kind_of(row))} | {row['reference']} "
            f"| {row['time_ratio']:.3f} [{low:.3f}, {high:.3f}] | {row['median']:.3f} "
            f"| {row['faster']:.3f}, {row['slower']:.3f} | {row['goals']}"
        )
    if once:
        parts.append(
            "By the paper's rule (once at the goal). Its numbers are of another simulator:\n\n"
            + markdown("noise | planner | source | success | timeout | fall | time [s]", once)
        )
    if pairs:
        head = "goals | noise | other | ratio [95 %] | median | faster, slower | common goals"
        parts.append(
            "Mean success time: `policy` ÷ the other planner, over the goals that both reached:\n\n"
            + markdown(head, pairs)
        )
    return "\n".join(parts)


def kind_of(row):
    """Two texts: which goals, and whether they are measured with noise."""
    goals = f"σ {row['goal_std_m']} m" if row["goal_std_m"] else "own"
    return goals, "yes" if row["noise"] else "no"


# ------------------------------------------------------------------------ files
MOST = 10**4  # [trials] in a block: each process takes 5 GB of memory for them


def read_goals(path):
    """Goals [n, 3] from a CSV file with columns x, y [m], yaw [rad], as spreadsheets write it. Its
    separators are commas, or they are semicolons or tabs, and decimal points may be commas."""
    try:
        text = path.read_text("utf-8-sig").lower().replace(" ", "")
        head = text.partition("\n")[0]
        for separator in ";\t":
            if separator in head:
                text = text.replace(",", ".").replace(separator, ",")
        lines = csv.DictReader(io.StringIO(text))
        if not {"x", "y", "yaw"} <= {*(lines.fieldnames or ())}:
            raise ValueError(f"its first line is {head!r}")
        rows = []
        for line in lines:
            if None in line or None in line.values():  # too many cells, or too few
                raise ValueError(f"line {lines.line_num} has not as many cells as the first one")
            if any(line.values()):
                rows.append([line[name] for name in ("x", "y", "yaw")])
        goals = np.array(rows, float)
        if not 0 < len(goals) <= MOST or not (np.abs(goals) < 1000).all():
            raise ValueError(f"from 1 to {MOST} lines of numbers below 1000")
    except (OSError, ValueError, csv.Error) as error:
        raise robot_model.InputError(
            f"{path}: needs columns x, y, yaw and finite numbers below them ({error})"
        ) from error
    if (np.abs(goals[:, 2]) > 2 * np.pi).any():
        print(f"note: {path}: a yaw beyond a full turn; they are read in radians, not in degrees")
    goals[:, 2] = env.wrap(goals[:, 2])
    return goals


def write_trials(path, blocks, results):
    """Writes a line for each trial; blocks: Trials by σ, results by (planner, noise, σ)."""
    head = (
        "planner,noise,goal_std_m,seed,trial,x,y,yaw,mu,outcome,time,steps,still_there,"
        "reached_once,time_once"
    )
    lines = [head.split(",")]
    for (planner, noise, std), ended in results.items():
        trials = blocks[std]
        columns = [range(len(trials.goals)), *trials.goals.T]
        for values in ended.values():
            if values.dtype == bool:
                values = np.where(values, "yes", "no")
            columns.append(values.round(12) if values.dtype == float else values)
        first = planner, "yes" if noise else "no", std or "", trials.seed
        lines += [[*first, *cells] for cells in zip(*columns)]
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows(lines)
    robot_model.write_text(path, text.getvalue())


def load_policy(path, world):
    """The planner of a policy.pt, and what evaluation.json says of it. Prints what differs from its
    training. Raises an InputError if it cannot work in this world.
    """
    model, about = ppo.load_policy(path)
    fits, here = about["fits"], ppo.fingerprint(world, model.shape["obs_dim"])
    if (trained := fits.get("simulator")) != world.sim:
        raise robot_model.InputError(
            f"{path}: trained in {trained}; this is {world.sim} (with --mujoco mujoco, else pymunk)"
        )
    if fits["observation"] != here["observation"]:
        raise robot_model.InputError(f"{path}: trained with another observation; train it again")
    # How it was paid (s_d, s_a, …) makes no difference to a walk.
    found = [entry for entry in ppo.differences(fits, here) if not entry.startswith("task: s_")]
    if found:
        more = f"; and {len(found) - 5} more" * (len(found) > 5)
        print(f"note: {path.as_posix()} was trained with another {'; '.join(found[:5])}{more}")
    facts = {key: about.get(key) for key in ("imu", "steps", "minutes", "seed")}
    return PolicyPlanner(model), {"file": path.as_posix(), **facts}


def names_in(path, wanted=("ROBOT", "WALK", "LIMITS")):
    """What a file of your own defines, by its names in small letters; an InputError if one is
    missing. Errors in the file show their own traceback."""
    if path.suffix != ".py" or not path.is_file():
        raise robot_model.InputError(f"{path}: no such .py file (--policy takes a policy.pt)")
    sys.path.append(str(path.resolve().parent))  # last: it may import what lies beside it
    try:
        names = runpy.run_path(str(path), run_name=path.as_posix())
    except SystemExit as error:
        raise robot_model.InputError(f"{path}: ends Python when it is read") from error
    if absent := {*wanted} - {*names}:
        raise robot_model.InputError(f"{path}: defines no {min(absent)}")
    return {name.lower(): names[name] for name in wanted}


def load_planner(path):
    """The planner in a file of your own."""
    planner = names_in(path, ["Planner"])["planner"]()
    for name in ("reset", "act"):
        if not callable(getattr(planner, name, None)):
            raise robot_model.InputError(f"{path}: its class Planner has no method {name}")
    return planner


def printable(name):
    """A file's name, which may hold anything, as a cell of a table."""
    return "".join(c if c.isprintable() and c != "|" else "?" for c in name)


def default_policy(sim):
    """runs/<sim>/policy.pt if you made one, else the shipped results/<sim>/policy.pt."""
    for folder in ("runs", "results"):
        path = Path(folder, sim, "policy.pt")
        if path.is_file():
            return path
    raise robot_model.InputError(
        f"{path}: no such file; run stage 5 where the stages are, or name one by --policy"
    )


def choose_planners(world, policies=(), planners=()):
    """Planners by row name, the facts of the first policy, and the name of the planner to be shown,
    for these files of policies and of planners.

    The first policy is called `policy`, all others like their file; if two would have the same
    name, the second one is called by its path.
    """
    baselines = {
        "baseline_tuned": BaselinePlanner(TUNED_BASELINE[world.sim]),
        "baseline": BaselinePlanner(),
    }
    chosen, facts, shown = {}, None, "policy"
    for path in (*(policies or [default_policy(world.sim)]), *planners):
        name = printable(path.stem) if chosen else "policy"
        if name in chosen | baselines:
            name = printable(path.as_posix())
        if path in planners:
            chosen[name] = load_planner(path)
            shown = name if shown == "policy" else shown  # your own, the first one
        else:
            chosen[name], about = load_policy(path, world)
            facts = facts or about
            print(f"{name}: {path}, {about['steps']} double steps, seed {about['seed']}")
    return chosen | baselines, facts, shown


# ------------------------------------------------------------------------ command line
def make_world(args, count, push=0.0, cores=None):
    """A world as the command line asks for; with --friction the floor is the same for all."""
    more = names_in(args.robot) if args.robot else {"robot": robot_model.RobotModel()}
    if args.friction is not None:
        more["robot"] = replace(more["robot"], friction=args.friction)
        more["spread"] = env.Spread(friction=0.0)
    return env.FootstepWorld(count, args.sim, push=push, cores=cores, **more)


# ------------------------------------------------------------------------ all rows of the table
def walk_rows(args, jobs):
    """Returns what `evaluate` does, by row, and prints a line for each row. All are of one world.
    jobs: (planner, Trials) by row, which is (planner's name, noise, σ)."""
    results, count = {}, len([*jobs.values()][0][1].goals)
    with closing(make_world(args, count, args.push)) as world:
        for row, (planner, trials) in jobs.items():
            _, world.noise, _ = row
            results[row] = evaluate(planner, world, trials)
            report(row, results[row])
    return results


def report(row, trials):
    """Prints the successes and the mean time of a row."""
    name, noise, std = row
    goals, noise = kind_of({"goal_std_m": std, "noise": noise})
    success, time = np.mean(trials["outcome"] == "success"), np.mean(trials["time"])
    said = f"{name}, goals {goals}, noise {noise}: success {success:.3f}"
    print(f"{said}, {time:.2f} s a walk", flush=True)


def silence():
    """Lets a helper print nothing: the notes of its world have been printed once already."""
    sys.stdout = sys.stderr = open(os.devnull, "w")


def evaluate_all(args, blocks, planners, helpers=0):
    """Evaluates every planner in every block of Trials; with --noise a second time with noise.

    Returns what `evaluate` does, by row: (planner's name, noise, σ). helpers: how many other
    processes share the work. The user's own planners run in this process. blocks: Trials by the σ
    of their goals [m], the same number in each; the σ of the user's own goals is None.
    """
    jobs = {  # by row in the order of the table
        (name, noise, std): (planner, trials)
        for std, trials in blocks.items()
        for noise in sorted({False, args.noise})
        for name, planner in planners.items()
    }
    ours = [row for row in jobs if type(planners[row[0]]) in (PolicyPlanner, BaselinePlanner)]
    every = 1 + min(helpers, len(ours) - 1)
    parts = [{row: jobs[row] for row in ours[k::every]} for k in range(every)]
    here = {row: job for row, job in jobs.items() if row in parts[0] or row not in ours}
    spawn = multiprocessing.get_context("spawn")  # the same on every system
    pool = ProcessPoolExecutor(max(1, helpers), spawn, silence)
    others = multiprocessing.active_children()  # a user's planner may have processes, too
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # helpers inherit it: Ctrl-C is for us
    futures = [pool.submit(walk_rows, args, part) for part in parts[1:]]
    signal.signal(signal.SIGINT, before)
    started = [child for child in multiprocessing.active_children() if child not in others]
    try:
        results = walk_rows(args, here)
        for part, future in zip(parts[1:], futures):
            try:
                found = future.result()
                for row, trials in found.items():
                    report(row, trials)
            except BrokenExecutor:  # a helper has died: too little memory?
                found = walk_rows(args, part)
            results |= found
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for process in started:
            process.terminate()
    return {row: results[row] for row in jobs}


def main(argv=None):
    parser = robot_model.stage_parser(__doc__)
    add = parser.add_argument
    add("--noise", action="store_true", help="Walk also with noise on the measured goal.")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--far", action="store_true", help="Walk also to goals twice as far.")
    which.add_argument(
        "--goals", type=Path, help="Take the goals from a CSV file: x, y [m], yaw [rad]."
    )
    add("--episodes", type=int, default=500, help="Walk to so many goals (default 500).")
    add("--friction", type=float, help="Give every floor this μ, instead of a random one.")
    add(
        "--push",
        type=float,
        default=0.0,
        metavar="DV",
        help="Push the torso by DV m/s, every 3 s on average.",
    )
    add("--policy", type=Path, nargs="+", default=[], help="Evaluate these files of 04_ppo.py.")
    add(
        "--planner",
        type=Path,
        nargs="+",
        default=[],
        help="Evaluate the class Planner of these files, too.",
    )
    add("--robot", type=Path, help="Walk with the robot of this file: its ROBOT, WALK and LIMITS.")
    add(
        "--gif",
        action="store_true",
        help="Draw a film of a walk to three goals of ours, too (a minute).",
    )
    add("--play", action="store_true", help="Open a window: click a goal, watch the robot walk.")
    args = parser.parse_args(argv)
    if not 1 <= args.episodes <= MOST:
        parser.error(f"--episodes from 1 to {MOST}")
    if not 0 <= args.push < 1e3 or not 0 <= (args.friction or 0) < 1e3:
        parser.error("--push and --friction from 0 on")
    if args.goals is None:
        blocks = {env.Task.goal_std_m: draw_trials(args.seed, args.episodes)}
        figure_goals = FIGURE_GOALS
    else:
        blocks = {None: Trials(read_goals(args.goals), args.seed)}
        figure_goals = blocks[None].goals[:3]
    if args.far:
        blocks[env.Task.far_std_m] = draw_trials(args.seed, args.episodes, far=True)
    push = args.push or 0.6  # [m/s] in the window and in the film
    count = 1 if args.play else len(figure_goals)
    with closing(make_world(args, count, cores=1)) as world:  # for pictures: without pushes
        planners, facts, shown = choose_planners(world, args.policy, args.planner)
        out = robot_model.output_folder(args)
        if args.play:
            play(world, {shown: planners[shown]} | planners, push)
            return
        helpers = robot_model.CORES - 1
        if args.sim == "mujoco" or __name__ != "__main__" or not Path(__file__).is_file():
            # MuJoCo has threads instead. And a helper imports the script that runs. For this file
            # that is harmless, but another script that calls `main` would start from the beginning.
            helpers = 0
        results = evaluate_all(args, blocks, planners, helpers)
        rows = [summary(*key, trials, world.task) for key, trials in results.items()]
        ratios = compare(results)
        special = " ".join(
            f"--{name} {value}"
            for name in ("push", "friction", "robot")
            if (value := getattr(args, name)) != parser.get_default(name)
        )
        text = table(rows, ratios, special)
        print(f"\n{text}")  # before files are written, which may fail
        content = {
            "sim": args.sim,
            "policy": facts,
            "seed": args.seed,
            "goals": str(args.goals or "drawn"),
            "friction": "drawn" if args.friction is None else args.friction,
            "push": args.push,
            "robot": str(args.robot),
            "rows": rows,
            "ratios": ratios,
        }
        content = json.dumps(content, indent=1, allow_nan=False) + "\n"
        robot_model.write_text(out / "evaluation.json", content)
        robot_model.write_text(out / "table.md", text)
        write_trials(out / "trials.csv", blocks, results)
        trials = Trials(figure_goals, args.seed)
        names = "baseline", "baseline_tuned", shown
        walks = {name: [*record(planners[name], world, trials)] for name in names}
        plot_footsteps(world.engine.robot, walks, out / "footsteps.png")
        if args.gif:  # a minute
            plot_tour(world, planners[shown], push, out / "animation.gif")
    film = " and animation.gif" * args.gif
    print(
        f"Look at footsteps.png{film}; evaluation.json, trials.csv, table.md are beside it, in {out}"
    )


if __name__ == "__main__":
    robot_model.start(main)
