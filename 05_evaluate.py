"""Stage 5: is the learned policy better than a good hand-written planner, and how sure are we?

Paper: section III (500 goals, with and without measurement noise; Table II, Fig. 3) and its
baseline [10], a carrot-following velocity controller.

    python 05_evaluate.py --noise          the paper's table and footstep figure, in two minutes
    python 05_evaluate.py --noise --gif    and an animation of one walk
    python 05_evaluate.py --noise --imu    the figures show the policy that feels its torso's tilt
    python 05_evaluate.py --goals my.csv   your own goals: columns x, y, yaw in m, m, rad
    python 05_evaluate.py --tune-baseline  a fairer opponent: faster baselines; some minutes

(all with `--mujoco` in 3-D). Without a training of your own it judges the shipped policy. Prints
the table and writes evaluation.json, trials.csv, table.md and footsteps.png to `runs/<sim>/`.
Notice: the paper's policy needs half the baseline's time, and falls twice as often. Does yours?

A planner is anything with `reset(num_robots)` and `act(world, robots, measured)`, which returns
actions [n, 6] in [0, 1] for the goals [n, 3] as n robots measured them: x, y [m], yaw [rad]. Yours
needs no more than these two methods:

    import numpy as np
    from importlib import import_module
    stage5 = import_module("05_evaluate")
    env, evaluate = stage5.env, stage5.evaluate

    class SideStepper:                             # goes sideways, whatever the goal
        def reset(self, num_robots): pass
        def act(self, world, robots, measured):    # left foot 5 cm outward, right foot beside it
            steps = np.zeros((len(robots), 2, 3))  # [n, left/right, x/y/yaw]
            steps[:, 0, 1] = 0.05
            return env.to_action(steps, world.limits)

    world = env.FootstepWorld(50, cores=1)
    trials = evaluate(SideStepper(), world, env.draw_goals(env.stream("evaluation", 0), 50))

Every planner meets the same goals, each with the same noise: a difference between two rows is due
to the planners, not to luck with the goals.

Leaves out: standing up after a fall, obstacles, the spread over training seeds.
"""

import csv
import json
import math
import os
import sys
import time
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import product
from pathlib import Path

import matplotlib
import numpy as np
import torch
from tqdm import tqdm

matplotlib.use("Agg")  # draws into files, needs no screen
import matplotlib.pyplot as plt
from matplotlib.animation import FuncAnimation, PillowWriter

# A module name may not start with a digit in an import statement, hence import_module.
robot_model = import_module("01_robot_model")
walk_engine = import_module("02_walk_engine")
env = import_module("03_env")
ppo = import_module("04_ppo")

OUTCOMES = ("success", "timeout", "fall")
PAPER = {  # Table II by (planner, noise): success, timeout, fall, success time [s] and its std
    ("policy", False): (0.980, 0.000, 0.020, 6.07, 2.13),
    ("baseline", False): (0.960, 0.032, 0.008, 11.13, 4.95),
    ("policy", True): (0.978, 0.000, 0.022, 6.35, 2.23),
    ("baseline", True): (0.910, 0.078, 0.012, 11.43, 5.11),
}
FIGURE_GOALS = np.array([[-0.7, 0.6, 2.6], [0.9, -0.6, 1.6]])  # x, y [m], yaw [rad]; our choice
FACTORS = tuple(np.arange(1.0, 4.01, 0.25).tolist())  # [-] on the speed limits, --tune-baseline
TURNING_GAINS = (0.3, 0.6, 1.0)  # [1/s]
TUNED_SUCCESS = 0.97  # [-] the tuned baseline must reach this share of its goals; our choice


@dataclass(frozen=True)
class BaselineSettings:
    """The paper's [10] as its team configured it on 2024-10-02; cautious, for the real robot."""

    forward: float = 0.12  # [m/s] speed limit; public configuration
    backward: float = 0.06  # [m/s] public configuration
    sideways: float = 0.07  # [m/s] public configuration
    turning: float = 0.3  # [rad/s] public configuration
    gain: float = 1.0  # [1/s] speed per distance; public configuration
    turning_gain: float = 0.3  # [1/s] turning speed per heading error; public configuration
    far_m: float = 1.0  # [m] farther away it faces the goal's position; public configuration
    time_constant: float = 1.0  # [s] τ of the filter; public configuration

    def tuned(self, factor, turning_gain):
        """The same controller, less cautious."""
        limits = ("forward", "backward", "sideways", "turning")
        faster = {name: factor * getattr(self, name) for name in limits}
        return replace(self, turning_gain=turning_gain, **faster)


# ---------------------------------------------------------------- the baseline's equations
def velocity_command(goal, settings):
    """Where to and how fast: goals seen from the robot [n, 3] -> v_x, v_y [m/s], ω [rad/s]."""
    d, alpha, beta = env.polar(goal)  # each [n]: distance [m], goal yaw, goal direction [rad]
    cos, sin = np.cos(beta), np.sin(beta)
    # The limits span a diamond: |v_x| / x_max + |v_y| / y_max ≤ 1, so in the direction β
    # v_max(β) = 1 / (|cos β| / x_max + |sin β| / y_max)
    x_max = np.where(cos >= 0, settings.forward, settings.backward)
    v_max = 1 / (np.abs(cos) / x_max + np.abs(sin) / settings.sideways)
    # v = min(gain·d, v_max(β))
    v = np.minimum(settings.gain * d, v_max)
    # ω = clip(turning gain·e, ±ω_max),  e = β far from the goal, α near it
    error = np.where(d > settings.far_m, beta, alpha)
    omega = np.clip(settings.turning_gain * error, -settings.turning, settings.turning)
    return np.stack([v * cos, v * sin, omega], -1)  # [n, 3]


def low_pass(velocity, command, seconds, time_constant):
    """The filter's state after holding a command for some seconds, solved exactly."""
    # v ← v + (1 − exp(−t/τ))·(v_cmd − v)
    return velocity + (1 - math.exp(-seconds / time_constant)) * (command - velocity)


def velocity_to_footsteps(velocity, period):
    """v_x, v_y [m/s], ω [rad/s] of n robots [n, 3] as footsteps [n, 2, 3], outward positive."""
    v_x, v_y, omega = velocity.T
    half = period / 2  # [s] a single step
    footsteps = np.zeros((len(velocity), 2, 3))
    # x: each foot lands v_x·(period/2) ahead of the other one
    footsteps[:, :, 0] = (v_x * half)[:, None]
    # y: the leading foot takes the way of the whole period, the other one follows with y = 0
    footsteps[:, 0, 1] = np.maximum(v_y, 0) * period  # the left foot leads to the left …
    footsteps[:, 1, 1] = np.maximum(-v_y, 0) * period  # … the right one to the right
    # yaw: ω·(period/2) counter-clockwise, which is outward for the left foot only
    footsteps[:, 0, 2], footsteps[:, 1, 2] = omega * half, -omega * half
    return footsteps


# ---------------------------------------------------------------- statistics
def wilson(count, total, z=1.96):
    """95 % interval of a rate after `count` of `total` trials; sensible at 0 and at 1, too."""
    if total == 0:
        return [0.0, 1.0]
    # (p + z²/2n ± z·√(p·(1 − p)/n + z²/4n²)) / (1 + z²/n)
    p, shrink = count / total, 1 + z**2 / total
    centre = p + z**2 / (2 * total)
    margin = z * math.sqrt(p * (1 - p) / total + z**2 / (4 * total**2))
    return [max(0.0, (centre - margin) / shrink), min(1.0, (centre + margin) / shrink)]


def time_ratio(trials, reference, resamples=2000):
    """Mean time / mean time of another planner over the goals that both reached.

    Returns the ratio, its 95 % interval (None without such a goal) and their number.
    """
    both = (trials["outcome"] == "success") & (reference["outcome"] == "success")
    ours, theirs = trials["time"][both], reference["time"][both]  # [m] goals each
    if not both.any():
        return None, None, 0
    # Paired bootstrap: draw goals, not times, again and again; a far goal is far for both.
    pick = np.random.default_rng(0).integers(len(ours), size=(resamples, len(ours)))
    ratios = ours[pick].mean(1) / theirs[pick].mean(1)  # [resamples]
    return ours.mean() / theirs.mean(), np.percentile(ratios, [2.5, 97.5]).tolist(), len(ours)


def lower_bound(goals, speed, period, task):
    """Straight to the circle around the goal at the fastest stable speed, no turning; [n] [s].

    Faster would be possible only at the risk of a fall, or by a last long step.
    """
    # t ≥ (d − 0.05 m) / v, rounded up to whole double steps
    way = np.maximum(0.0, np.hypot(goals[:, 0], goals[:, 1]) - task.success_m)
    return np.ceil(way / (speed * period)) * period


def summary(planner, noise, trials, task, bound=None):
    """One row of the table; rates are shares of the episodes, times those of the successes.

    bound [n]: the `lower_bound` of each goal [s], if known.
    """
    n, reached = len(trials["time"]), trials["outcome"] == "success"
    row = {"planner": planner, "noise": noise, "episodes": n}
    if noise:
        row |= {"noise_m": task.noise_m, "noise_rad": task.noise_rad}
    rates = {name: (int((trials["outcome"] == name).sum()), n) for name in OUTCOMES}
    rates["stays_up"] = int(trials["stays_up"].sum()), int(reached.sum())
    for name, (count, total) in rates.items():
        row[name] = round(count / total, 4) if total else None  # None: there was no success
        row[f"{name}_ci95"] = [round(edge, 4) for edge in wilson(count, total)]
    times = trials["time"][reached]  # [s]
    row["time_mean"] = round(float(times.mean()), 3) if len(times) else None
    row["time_std"] = round(float(times.std()), 3) if len(times) else None
    if bound is not None:
        row["time_bound"] = round(float(bound[reached].mean()), 3) if len(times) else None
    return row


# ---------------------------------------------------------------- planners
class BaselinePlanner:
    """Carrot following: points at the goal as at a carrot on a stick, and limits the speed."""

    def __init__(self, settings=BaselineSettings()):
        self.settings = settings

    def reset(self, num_robots):
        """All robots stand."""
        self.velocity = np.zeros((num_robots, 3))  # filtered: v_x, v_y [m/s], ω [rad/s]

    def act(self, world, robots, measured):
        """Actions [n, 6] of these robots; clipped to the same step limits as the policy's."""
        period, command = world.engine.period, velocity_command(measured, self.settings)
        velocity = low_pass(self.velocity[robots], command, period, self.settings.time_constant)
        self.velocity[robots] = velocity
        return env.to_action(velocity_to_footsteps(velocity, period), world.limits)


class PolicyPlanner:
    """The trained policy without exploring: see `beta_decision` in stage 04."""

    def __init__(self, model, imu=False):
        self.model, self.imu = model, imu

    def reset(self, num_robots):
        """It remembers nothing: the two previous actions are part of the observation."""

    def act(self, world, robots, measured):
        """Actions [n, 6] of these robots."""
        world.imu = self.imu  # what `observe` returns
        return self.model.decide(world.observe(robots, measured))


def load_planner(path, sim):
    """The PolicyPlanner of a file and a plain description of it; PolicyError if it does not fit."""
    model, meta = ppo.load_policy(path)
    imu = meta["fits"].get("observation") == env.fingerprint(sim, imu=True)["observation"]
    shape = {"obs_dim": len(env.observation_table(imu)), "act_dim": len(env.ACTION_NAMES)}
    mismatch = (ppo.difference(meta["fits"], ppo.plain(env.fingerprint(sim, imu)))
                or ppo.difference({key: meta[key] for key in shape}, shape))
    if mismatch:
        raise ppo.PolicyError(f"{path}: this policy does not fit: {mismatch}")
    trained = {key: meta.get(key) for key in ("steps", "minutes", "seed")}
    return PolicyPlanner(model, imu), {"file": Path(path).as_posix(), "imu": imu, **trained}


def decision_time(planner, world, count, repeats=100):
    """Wall-clock of one decision for `count` robots at once, from measured goal to action [µs]."""
    robots = np.arange(count)
    measured = world.relative_goal(robots)
    clock = time.perf_counter()
    for _ in range(repeats):
        planner.act(world, robots, measured)
    return 1e6 * (time.perf_counter() - clock) / repeats


# ---------------------------------------------------------------- trials
def evaluate(planner, world, goals, seed=0, noise=False, watch=None):
    """Walk robot i to goals[i] [n, 3], all at the same time, until each trial has ended.

    Returns arrays [n]: outcome, time [s], steps, stays_up (still standing after two more double
    steps in place). watch(robots, result) is called after every `world.step`.
    """
    everybody = np.arange(len(goals))
    # One generator per goal: its noise depends neither on the planner nor on the other goals.
    # i + 1, because numpy takes (seed, 0) for the same as (seed), the generator of the goals.
    world.noise = noise
    world.reset(everybody, [env.stream("evaluation", seed, i + 1) for i in everybody], goals)
    planner.reset(len(goals))
    outcome = env.walk_episodes(world, planner.act, everybody, watch)
    steps = world.steps[everybody]
    up = np.flatnonzero(outcome == "success")
    for _ in range(2):  # does it stand at the goal, or was it only falling past it?
        if len(up):
            fell = world.step(np.tile(world.neutral_action, (len(up), 1)), up)["fall"]
            up = up[~fell]
    return {"outcome": outcome, "time": steps * world.engine.period, "steps": steps,
            "stays_up": np.isin(everybody, up)}


def progress(bar):
    """A `watch` that counts the trials that have ended."""
    return lambda robots, result: bar.update(sum(int(result[name].sum()) for name in OUTCOMES))


def record(planner, world, goals, seed=0):
    """Walk to each goal without noise and keep what physics did: a dict per goal, see below."""
    seen = [[] for _ in goals]

    def watch(robots, result):
        motion = result["motion"]
        for row, i in enumerate(robots):
            seen[i].append((motion.torso[row], motion.joints[row], motion.feet[row]))

    trials = evaluate(planner, world, goals, seed, watch=watch)
    walks = []
    for i, goal in enumerate(goals):
        torso, joints, feet = zip(*seen[i], strict=True)
        walks.append({
            "goal": goal, "outcome": trials["outcome"][i], "time": trials["time"][i],
            "torso": np.concatenate(torso),  # [K·T, 6] at every control tick
            "joints": np.concatenate(joints),  # [K·T, 12]
            "feet": np.stack(feet),  # [K, 2, 3] at the end of every double step
        })
    return walks


# ---------------------------------------------------------------- files and tables
class InputError(ValueError):
    """Something given by the user cannot be used; the message is one line that says why."""


def read_goals(path):
    """Goals [n, 3] of a CSV file with columns x, y [m], yaw [rad]; further columns are ignored."""
    goals = []
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            reader.fieldnames = [name.strip().lower() for name in reader.fieldnames or ()]
            if not {"x", "y", "yaw"} <= set(reader.fieldnames):
                raise InputError("must name the columns x, y, yaw")
            for row in reader:
                if None in row or None in row.values():  # csv's way to say too many, too few
                    raise InputError(f"needs {len(reader.fieldnames)} values, as in line 1")
                goal = [float(row[name]) for name in ("x", "y", "yaw")]
                if not np.isfinite(goal).all():
                    raise InputError("contains a number that is not finite")
                goals.append(goal)
            if not goals:
                raise InputError("no goal follows")
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file in UTF-8") from error
    except (ValueError, csv.Error) as error:  # ValueError: from float()
        raise InputError(f"{path}, line {max(1, reader.line_num)}: {error}") from error
    goals = np.array(goals)
    goals[:, 2] = env.wrap(goals[:, 2])
    return goals


def compare(trials):
    """Time ratios of every policy to every baseline; trials by (planner, noise)."""
    ratios = []
    for (planner, noise), reference in product(trials, ("baseline", "baseline_tuned")):
        if planner.startswith("policy") and (reference, noise) in trials:
            ratio, interval, goals = time_ratio(trials[planner, noise], trials[reference, noise])
            entry = {"planner": planner, "reference": reference, "noise": noise, "goals": goals,
                     "time_ratio": ratio and round(ratio, 4),
                     "time_ratio_ci95": interval and [round(bound, 4) for bound in interval]}
            if (planner, reference) == ("policy", "baseline"):
                entry["paper"] = round(PAPER[planner, noise][3] / PAPER[reference, noise][3], 3)
            ratios.append(entry)
    return ratios


def table(rows, ratios, speed=None):
    """The paper's Table II in Markdown: every row of ours, and the paper's own below it.

    speed: the fastest stable speed [m/s], on which the rows' `time_bound` is based.
    """
    cells = [("noise", "planner", "source", "success [95 % interval]", "timeout", "fall",
              "success time [s]", "÷ bound", "still up"), ("---",) * 9]

    def add(first, success, timeout, fall, mean, std, bound="", up=""):
        time = "none" if mean is None else f"{mean:.2f} ± {std:.2f}"
        cells.append((*first, success, f"{timeout:.3f}", f"{fall:.3f}", time, bound, up))

    for row in rows:
        success = "{:.3f} [{:.3f}, {:.3f}]".format(row["success"], *row["success_ci95"])
        up = "none" if row["stays_up"] is None else f"{row['stays_up']:.3f}"
        bound = f"{row['time_mean'] / row['time_bound']:.2f}" if row.get("time_bound") else ""
        add(("yes" if row["noise"] else "no", row["planner"], "ours"), success,
            *(row[key] for key in ("timeout", "fall", "time_mean", "time_std")), bound, up)
        if (row["planner"], row["noise"]) in PAPER:
            success, *others = PAPER[row["planner"], row["noise"]]
            add(("", "", "paper"), f"{success:.3f}", *others)
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = ["| " + " | ".join(map(str.ljust, line, widths)) + " |" for line in cells]
    if speed:
        lines += ["", f"Bound: a straight line at the fastest stable speed, {speed:.2f} m/s."]
    lines += ["", "Mean success time relative to another planner, over the goals both reached:", ""]
    for r in ratios:
        text = "no goal was reached by both"
        if r["goals"]:
            text = "{:.3f} [{:.3f}, {:.3f}]".format(r["time_ratio"], *r["time_ratio_ci95"])
            text += f", {r['goals']} goals" + (f" (paper: {r['paper']})" if "paper" in r else "")
        noise = "with" if r["noise"] else "without"
        lines.append(f"- {r['planner']} / {r['reference']}, {noise} noise: {text}")
    return "\n".join(lines) + "\n"


def write_text(path, text):
    """UTF-8 and plain line ends on every system; the old file or the new one, never half of one."""
    ppo.atomic_write(path, lambda temporary: temporary.write_bytes(text.encode("utf-8")))


def write_json(path, content):
    """Readable by a human, too; NaN would not be JSON."""
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    write_text(path, text + "\n")


def write_trials(path, goals, trials):
    """One line per trial. Its columns x, y, yaw suit --goals: repeat only those that failed."""
    lines = ["planner,noise,x,y,yaw,outcome,time,steps"]
    for (planner, noise), t in trials.items():
        for i, (x, y, yaw) in enumerate(goals.tolist()):
            lines.append(f"{planner},{'yes' if noise else 'no'},{x},{y},{yaw},"
                         f"{t['outcome'][i]},{t['time'][i]:.2f},{t['steps'][i]}")
    write_text(path, "\n".join(lines) + "\n")


# ---------------------------------------------------------------- pictures
FEET = (("left footstep", "tab:green"), ("right footstep", "tab:red"))


def arrows(axes, poses, color, length=0.08, width=0.012, **kw):
    """Poses [n, 3] as arrows [m] that begin at x, y and point along yaw."""
    x, y, yaw = np.transpose(poses)
    axes.quiver(x, y, length * np.cos(yaw), length * np.sin(yaw), color=color, angles="xy",
                units="xy", scale_units="xy", scale=1, width=width, headwidth=3.5, headlength=3.5,
                headaxislength=3.2, **kw)


def draw_walk(axes, walk, ticks=None):
    """Seen from above: the first `ticks` control ticks of a recorded walk (default: all)."""
    per_step = len(walk["torso"]) // len(walk["feet"])  # control ticks in a double step
    ticks = ticks or len(walk["torso"])
    goal, start = walk["goal"], np.zeros(3)
    axes.add_patch(plt.Circle(goal[:2], env.Task().success_m, color="tab:blue", alpha=0.3, lw=0))
    for pose, marker in ((start, "o"), (goal, "*")):
        axes.plot(*pose[:2], marker, color="tab:blue", markersize=8, zorder=5)
        arrows(axes, [pose], "tab:blue", 0.2, 0.022, zorder=5)
    for side, (_, color) in enumerate(FEET):
        feet = walk["feet"][: ticks // per_step, side]  # [k, 3] where each foot stood, measured
        if len(feet):
            arrows(axes, feet, color, zorder=3)
    axes.plot(*np.vstack([start[:2], walk["torso"][:ticks, :2]]).T, color="black", lw=1, zorder=4)
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axes.grid(alpha=0.3)


def ending(walk):
    """How a walk ended, in words."""
    words = {"success": "reached", "fall": "fell", "timeout": "not reached"}[walk["outcome"]]
    return f"{words} after {walk['time']:.1f} s, {len(walk['feet'])} double steps"


def plot_footsteps(columns, path):
    """The paper's Fig. 3: columns = [(planner, walks to the same goals), …], in one scale."""
    figure, axes = plt.subplots(1, len(columns), figsize=(4.8 * len(columns), 5.2), sharex=True,
                                sharey=True, squeeze=False, layout="constrained")
    for panel, (name, walks) in zip(axes[0], columns, strict=True):
        for number, walk in enumerate(walks, 1):
            draw_walk(panel, walk)
            x, y, _ = walk["goal"]  # its name stands on the far side of it
            panel.text(x + math.copysign(0.3, x), y, f"goal {number}", color="tab:blue",
                       ha="center", va="center")
        low = np.minimum(0, np.min([walk["goal"][:2] for walk in walks], 0)) - 0.45  # [2]
        high = np.maximum(0, np.max([walk["goal"][:2] for walk in walks], 0)) + 0.45
        panel.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        lines = [f"goal {number} {ending(walk)}" for number, walk in enumerate(walks, 1)]
        panel.set_title("\n".join([name, *lines]), fontsize=10)
        panel.label_outer()
    styles = [(label, color, ">") for label, color in FEET] + [
        ("torso on the ground", "black", ""), ("start pose", "tab:blue", "o"),
        ("goal pose, 5 cm around it", "tab:blue", "*")]
    handles = [plt.Line2D([], [], color=color, marker=marker, label=label)
               for label, color, marker in styles]
    figure.legend(handles=handles, loc="outside lower center", ncols=5, fontsize=9, frameon=False)
    ppo.atomic_write(path, lambda temporary: figure.savefig(temporary, dpi=130, format="png"))
    plt.close(figure)


def plot_animation(walk, path, robot, every=10, longest=16.0):
    """A walk (its first `longest` seconds) in real time, seen from the side and from above."""
    torso, dt = walk["torso"][: round(longest / robot.control_dt)], robot.control_dt  # [M, 6]
    # The camera walks along: it keeps the torso's height and lean, but not its place and yaw.
    beside = torso * [0, 0, 1, 1, 1, 0]
    # How far the ground has moved past: the steps of the torso along its own heading.
    way = np.diff(torso[:, :2], axis=0, prepend=0)  # [M, 2]
    walked = np.cumsum(np.cos(torso[:, 5]) * way[:, 0] + np.sin(torso[:, 5]) * way[:, 1])  # [M]
    corners = np.vstack([torso[:, :2], [walk["goal"][:2]]])
    low, high = corners.min(0) - 0.3, corners.max(0) + 0.3
    figure, (side, top) = plt.subplots(1, 2, figsize=(8, 4))
    figure.subplots_adjust(0.08, 0.12, 0.98, 0.92)

    def draw(tick):
        side.clear()
        top.clear()
        robot_model.draw_robot(side, robot, beside[tick], walk["joints"][tick])
        side.axhline(0, color="black", lw=1)
        marks = np.arange(-0.5, 0.6, 0.1) - walked[tick] % 0.1  # every 10 cm of ground
        side.plot(marks, 0 * marks - 0.012, "|", color="black")
        side.set(xlim=(-0.4, 0.4), ylim=(-0.04, 0.76), aspect="equal", ylabel="z [m]",
                 xlabel="x, seen from the torso [m]")
        last = tick + 1 == len(walk["torso"])
        side.set_title(ending(walk) if last else f"{(tick + 1) * dt:.1f} s")
        draw_walk(top, walk, tick + 1)
        top.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), title="from above")

    frames = [*range(0, len(torso) - 1, every), *[len(torso) - 1] * 15]  # the end stays a while
    temporary = path.with_name(path.stem + ".tmp.gif")  # Pillow wants the ending .gif
    animation = FuncAnimation(figure, draw, frames, init_func=lambda: None)
    animation.save(temporary, PillowWriter(fps=round(1 / (every * dt))), dpi=75)
    os.replace(temporary, path)
    plt.close(figure)


# ---------------------------------------------------------------- command line
def find(sim, name):
    """runs/<sim>/<name> if you made one, else the shipped results/<sim>/<name>, else None."""
    places = [Path(folder) / sim / name for folder in ("runs", "results")]
    return next((place for place in places if place.is_file()), None)


def choose_planners(sim, chosen=None, imu=False):
    """Planners by row name, the one for the figures first, and what evaluation.json says of them.

    chosen: the policy file that the user named, if any; imu: the policy with IMU comes first.
    """
    plain, with_imu = chosen or find(sim, "policy.pt"), find(sim, "imu/policy.pt")
    paths = [path for path in ((with_imu, plain) if imu else (plain, with_imu)) if path]
    if not paths or (imu and not with_imu):
        command = "python 04_ppo.py" + " --mujoco" * (sim == "mujoco") + " --imu" * imu
        raise InputError(f"no policy for {sim} yet: train one with `{command}`, or use --policy")
    planners, about = {}, {}
    for path in paths:
        try:
            planner, description = load_planner(path, sim)
        except ppo.PolicyError as error:
            if path == paths[0]:
                raise
            print(f"left out: {error}", file=sys.stderr)  # nobody asked for it
            continue
        name = "policy_imu" if planner.imu else "policy"
        if name not in planners:
            planners[name], about[name] = planner, description
    planners["baseline"] = BaselinePlanner()
    path = find(sim, "baseline_tuned.json")
    if path:
        try:
            stored = json.loads(path.read_text(encoding="utf-8"))
            choice = {key: float(stored[key]) for key in ("factor", "turning_gain")}
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{path}: not written by --tune-baseline") from error
        planners["baseline_tuned"] = BaselinePlanner(BaselineSettings().tuned(**choice))
        about["baseline_tuned"] = {"file": path.as_posix(), **choice}
    return planners, about


def tune_baseline(world, goals, args, out, sim):
    """All combinations of FACTORS and TURNING_GAINS; keeps the fastest one that is safe enough."""
    grid, kept = [], ("success", "success_ci95", "timeout", "fall", "time_mean", "time_std")
    combinations = list(product(FACTORS, TURNING_GAINS))
    with tqdm(total=len(goals) * len(combinations), unit=" trials", dynamic_ncols=True) as bar:
        for factor, gain in combinations:
            bar.set_postfix(factor=factor, turning_gain=gain)
            planner = BaselinePlanner(BaselineSettings().tuned(factor, gain))
            trials = evaluate(planner, world, goals, args.seed, watch=progress(bar))
            row = summary("baseline_tuned", False, trials, world.task)
            grid.append({"factor": factor, "turning_gain": gain, **{key: row[key] for key in kept}})
    safe = [row for row in grid if row["success"] >= TUNED_SUCCESS]
    best = (min(safe, key=lambda row: row["time_mean"]) if safe else
            max(grid, key=lambda row: row["success"]))
    rule = f"the fastest with success >= {TUNED_SUCCESS}" if safe else "the highest success"
    path = out / "baseline_tuned.json"
    write_json(path, {"sim": sim, "factor": best["factor"], "turning_gain": best["turning_gain"],
                      "rule": rule, "goals": len(goals), "seed": args.seed, "grid": grid})
    print(f"{rule}: speed limits × {best['factor']}, turning gain {best['turning_gain']}: success "
          f"{best['success']:.3f} on {len(goals)} tuning goals, {best['time_mean']} s; see {path}")


def run(world, goals, planners, about, args, out, sim):
    """Every planner, without and with noise; then the files."""
    for name, facts in about.items():
        short = {k: round(v, 2) if isinstance(v, float) else v for k, v in facts.items()}
        print(f"{name}:", ", ".join(f"{key} {value}" for key, value in short.items()))
    settings = [(name, noise) for noise in (False, True)[: 1 + args.noise] for name in planners]
    trials = {}
    with tqdm(total=len(settings) * len(goals), unit=" trials", dynamic_ncols=True) as bar:
        for name, noise in settings:
            bar.set_description(f"{name}, {'with' if noise else 'without'} noise")
            trials[name, noise] = evaluate(planners[name], world, goals, args.seed, noise,
                                           progress(bar))
    speed = walk_engine.fastest_speed(sim)  # [m/s]
    bound = lower_bound(goals, speed, world.engine.period, world.task)
    rows = [summary(name, noise, t, world.task, bound) for (name, noise), t in trials.items()]
    ratios = compare(trials)
    print("\n" + table(rows, ratios, speed))  # first of all: writing may fail
    write_json(out / "evaluation.json", {
        "sim": sim, "policy": next(iter(about.values())), **about,
        "goals": args.goals or "stream evaluation", "seed": args.seed,
        "fastest_speed": round(speed, 4), "rows": rows, "ratios": ratios})
    write_trials(out / "trials.csv", goals, trials)
    write_text(out / "table.md", table(rows, ratios, speed))
    columns = [(name, record(planners[name], world, FIGURE_GOALS, args.seed))
               for name in ("baseline", next(iter(planners)))]
    plot_footsteps(columns, out / "footsteps.png")
    names = ["evaluation.json", "trials.csv", "table.md", "footsteps.png"]
    if args.gif:
        print("drawing the animation, half a minute")
        plot_animation(columns[1][1][0], out / "animation.gif", world.engine.robot)
        names.append("animation.gif")
    planner = next(iter(planners.values()))
    print("one decision of the policy takes " + ", ".join(
        f"{decision_time(planner, world, n) / n:.1f} µs per robot for {n} at a time"
        for n in (1, 64)))
    print("written:", *(out / name for name in names))


def main(argv=None):
    """Check everything first, walk, then write."""
    parser = robot_model.stage_parser(__doc__, Path(__file__).name)
    parser.add_argument("--noise", action="store_true", help="add the rows with measurement noise")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--episodes", type=ppo.positive, default=500, help="goals (default 500)")
    which.add_argument("--goals", metavar="FILE.csv", help="columns x, y, yaw: m, m, rad")
    parser.add_argument("--policy", type=Path, metavar="FILE", help="a policy.pt of 04_ppo.py")
    parser.add_argument("--imu", action="store_true", help="show the policy with IMU in figures")
    parser.add_argument("--gif", action="store_true", help="also draw animation.gif")
    parser.add_argument("--tune-baseline", action="store_true", help="write baseline_tuned.json")
    args = robot_model.parse_stage(parser, argv)
    if args.tune_baseline and (args.noise or args.goals or args.policy or args.gif or args.imu):
        parser.error("--tune-baseline goes with --episodes, --seed, --out and --mujoco only")
    if args.imu and args.policy:
        parser.error("--imu chooses a policy by itself, leave out --policy")

    sim, world = args.sim, None
    torch.set_num_threads(1)  # a policy this small is slower on several threads
    try:
        purpose = "tuning" if args.tune_baseline else "evaluation"
        drawn = env.draw_goals(env.stream(purpose, args.seed), args.episodes)
        goals = read_goals(args.goals) if args.goals else drawn  # [n, 3]
        planners, about = {}, {}
        if not args.tune_baseline:
            planners, about = choose_planners(sim, args.policy, args.imu)
        out = robot_model.output_folder(parser, args)
        world = env.FootstepWorld(max(len(goals), 64), sim)  # 64: for the decision's time
        if args.tune_baseline:
            tune_baseline(world, goals, args, out, sim)
        else:
            run(world, goals, planners, about, args, out, sim)
    except (InputError, ppo.PolicyError, OSError) as error:
        parser.error(str(error))
    except KeyboardInterrupt:
        print("\ninterrupted", file=sys.stderr)
        sys.exit(130)
    finally:
        if world:
            world.close()


if __name__ == "__main__":  # the simulator's worker processes import this file again
    main()
