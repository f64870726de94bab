"""Stage 5: is the learned policy better than other planners, and how sure are we?

Paper: section III (500 goals, with and without measurement noise; Table II, Fig. 3), its baseline
[10], a velocity controller that follows the goal like a carrot on a stick, and the classical answer
of its references [3] and [4]: search for the shortest way.

    python 05_evaluate.py --noise          the paper's table and footstep figure, in two minutes
    python 05_evaluate.py --noise --far    and a second block: goals twice as far
    python 05_evaluate.py --gif            and the baseline in a race against the policy
    python 05_evaluate.py --goals my.csv   your own goals: columns x, y, yaw in m, m, rad
    python 05_evaluate.py --friction 0.4   the same ground for all, instead of a drawn one
    python 05_evaluate.py --planner my.py  your own planner beside the others
    python 05_evaluate.py --play           click a goal and watch

(`--mujoco` in 3-D; `--imu`: the figures show the policy that feels its torso's tilt.) Without a
training of your own it judges the one in `results/<sim>/`. Prints the table and writes it with
evaluation.json, trials.csv and footsteps.png to `runs/<sim>/`; lines of trials.csv given back with
--goals repeat those very trials. Predict: the paper's policy needs half the baseline's time, and
falls about twice as often. Does this one? And what is search blind to?

A planner is a class with `reset(num_robots)` and `act(view, robots, measured)`, which returns
actions [n, 6] in [0, 1] for the goals [n, 3] as n robots measured them: x, y [m], yaw [rad]. The
view (stage 3) shows what else it may know. All meet the same goals, ground and bodies, and at their
k-th decision the same noise, so a difference between two rows is due to the planners; the intervals
say how much these 500 trials could mislead about others. `baseline` is configured as in the paper,
all settings of `baseline_tuned` and `search` are optimised for this world (tests/studies).

Leaves out: standing up after a fall, obstacles, the spread over training seeds.

[10] Hamburg Bit-Bots, bitbots_main, https://github.com/bit-bots/bitbots_main, as of 2024-10-02.
"""

import contextlib
import csv
import itertools
import json
import math
import os
import queue
import runpy
import sys
import threading
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.animation import FuncAnimation, PillowWriter
from tqdm import tqdm

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

class InputError(ValueError):
    """Something given by the user cannot be used; the message is one line that says why."""

class StaleError(InputError):
    """A file was made for another robot, walk or task."""

# ------------------------------------------------------------------------ the baseline
@dataclass(frozen=True)
class BaselineSettings:
    """[10] as its team configured it: cautious, for the real robot. Source: its public files."""
    forward: float = 0.12  # [m/s] speed limit
    backward: float = 0.06  # [m/s]
    sideways: float = 0.07  # [m/s]
    turning: float = 0.3  # [rad/s]
    gain: float = 1.0  # [1/s] speed per distance
    turning_gain: float = 0.3  # [1/s] turning speed per heading error
    far_m: float = 1.0  # [m] farther away it faces the goal's position
    time_constant: float = 1.0  # [s] τ of the filter; 0: none

def velocity_command(goal, settings):
    """Where to and how fast: goals seen from the robot [n, 3] -> v_x, v_y [m/s], ω [rad/s]."""
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
    """The filter τ·dv/dt = v_cmd − v after holding a command for some seconds, solved exactly."""
    # v ← v + (1 − exp(−t/τ))·(v_cmd − v)
    return velocity + (1 - math.exp(-seconds / max(time_constant, 1e-9))) * (command - velocity)

def velocity_to_footsteps(velocity, period):
    """v_x, v_y [m/s], ω [rad/s] of n robots [n, 3] as footsteps [n, 2, 3], outward positive.

    A footstep is seen from the other foot (stage 2), so two of them in a row add up.
    """
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

class BaselinePlanner:
    """[10], once per double step instead of 20 times a second, with the goal as the carrot."""

    def __init__(self, settings=BaselineSettings()):
        self.settings = settings

    def reset(self, num_robots):
        """Nothing has been commanded yet."""
        self.velocity = np.full((num_robots, 3), np.nan)  # filtered: v_x, v_y [m/s], ω [rad/s]

    def act(self, view, robots, measured):
        """Actions [n, 6] of these robots; clipped to the same step limits as the policy's."""
        command, last = velocity_command(measured, self.settings), self.velocity[robots]
        last = np.where(np.isnan(last), command, last)  # the first command is not filtered
        velocity = low_pass(last, command, view.period, self.settings.time_constant)
        self.velocity[robots] = velocity
        return env.to_action(velocity_to_footsteps(velocity, view.period), view.limits)

# ------------------------------------------------------------------------ search
CELL, TURN = 0.05, math.radians(10)  # [m], [rad] size of a cell of the map of poses
HALF, TURNS = 64, 36  # cells on each side of the goal (3.2 m), and around the circle
FAR = 25.5  # [double steps] what the map says where the goal is out of reach

def steps_to_go(moves, task):
    """How many double steps it takes to the goal, from every pose around it: dynamic programming.

    moves [A, 3]: what a double step does. Returns V [TURNS, 2·HALF + 1, 2·HALF + 1] over the
    robot's yaw, x and y as seen from the goal:

        V = 0 at the goal,   V(pose) = 1 + min over moves of V(pose after the move)

    repeated until nothing changes. Between the cells V is linear in x, y and yaw. It is the paper's
    A* for all starts at once, as it begins at the goal.
    """
    axis = CELL * np.arange(-HALF, HALF + 1)
    yaws = TURN * np.arange(TURNS)
    near = np.hypot(axis[:, None], axis) <= task.success_m + 1e-9
    goal = near & (np.abs(robot_model.wrap(yaws)) <= task.success_rad + 1e-9)[:, None, None]
    value = np.where(goal, 0.0, FAR).astype(np.float32)
    pad = math.ceil(np.abs(moves[:, :2]).max() * math.sqrt(2) / CELL) + 1  # cells beyond the map
    while True:
        border = np.pad(value, ((0, 0), (pad, pad), (pad, pad)), constant_values=FAR)
        best = np.full_like(value, FAR)
        for k, yaw in enumerate(yaws):
            for move, turn in zip(robot_model.turned(moves[:, :2], yaw), moves[:, 2]):
                # Seen from the goal, a move shifts all the poses of one yaw alike.
                (i, j), (u, v) = np.divmod(move / CELL, 1)  # whole cells, and what is left
                m, w = divmod(k + turn / TURN, 1)
                x, y = (slice(int(c) + pad, int(c) + pad + 2 * HALF + 2) for c in (i, j))
                part = ((1 - w) * border[int(m) % TURNS, x, y]
                        + w * border[int(m + 1) % TURNS, x, y])
                part = (1 - u) * part[:-1] + u * part[1:]
                np.minimum(best[k], (1 - v) * part[:, :-1] + v * part[:, 1:], out=best[k])
        better = np.where(goal, 0.0, np.minimum(best + 1, FAR)).astype(np.float32)
        if np.abs(better - value).max() < 0.01:
            return better
        value = better

def look_up(value, poses):
    """V [...] at poses [..., 3] (x, y [m], yaw [rad]) seen from the goal; linear between cells."""
    edge = CELL * HALF - 1e-6
    x, y = (np.clip(poses[..., k], -edge, edge) / CELL + HALF for k in (0, 1))
    i, j, k = (np.floor(c).astype(int) for c in (x, y, poses[..., 2] / TURN))
    u, v, w = x - i, y - j, poses[..., 2] / TURN - k
    total = 0.0
    for a, b, c in np.ndindex(2, 2, 2):  # the eight corners of the cell
        share = (u if a else 1 - u) * (v if b else 1 - v) * (w if c else 1 - w)
        total = total + share * value[(k + c) % TURNS, i + a, j + b]
    return total

class SearchPlanner:
    """Takes the double step after which the fewest are left. Of dynamics it knows nothing.

    change: how far an action may be from the last one, largest of six differences [share of limits]
    """

    def __init__(self, steps, moves, value, limits, change):
        self.moves, self.value, self.change = moves, value, change
        self.actions = env.to_action(steps, limits)  # [A, 6]

    def reset(self, num_robots):
        """It remembers nothing."""

    def act(self, view, robots, measured):
        """Actions [n, 6] of these robots."""
        pose = robot_model.relative(measured, np.zeros(3))  # of the robot, seen from the goal
        # From beyond the map it goes to where the map begins: a carrot again.
        edge = CELL * HALF - np.abs(self.moves[:, :2]).max() * math.sqrt(2)  # [m]
        pose[:, :2] /= np.maximum(1, np.abs(pose[:, :2]).max(-1, keepdims=True) / edge)
        left = look_up(self.value, robot_model.compose(pose[:, None], self.moves))  # [n, A]
        change = np.abs(view.actions[:, :1] - self.actions).max(-1)  # [n, A]
        # What was done last may always be done again; what differs too much costs a lot.
        left = left + 100 * np.maximum(0, change - self.change)
        return self.actions[left.argmin(1)]

# ------------------------------------------------------------------------ the policy
class PolicyPlanner:
    """The trained policy without exploring: `ActorCritic.decide` of stage 4."""

    def __init__(self, model, imu=False):
        self.model, self.imu = model, imu

    def reset(self, num_robots):
        """It remembers nothing: the two previous actions are part of the observation."""

    def act(self, view, robots, measured):
        """Actions [n, 6] of these robots."""
        seen = len(env.observation_table(self.imu))  # the rows of the IMU are the last ones
        return self.model.decide(view.observation[:, :seen])

def load_planner(path, sim):
    """The PolicyPlanner of a file and a plain description of it; PolicyError if it does not fit."""
    model, meta = ppo.load_policy(path)
    imu = meta["fits"].get("observation") == env.fingerprint(sim, imu=True)["observation"]
    wanted = {"obs_dim": len(env.observation_table(imu)), "act_dim": len(env.ACTION_NAMES),
              "fits": env.fingerprint(sim, imu)}
    mismatch = ppo.difference({key: meta[key] for key in wanted}, wanted)
    if mismatch:
        raise ppo.PolicyError(f"{path}: this policy does not fit: {mismatch}")
    trained = {key: meta.get(key) for key in ("steps", "minutes", "seed")}
    return PolicyPlanner(model, imu), {"file": Path(path).as_posix(), "imu": imu, **trained}

# ------------------------------------------------------------------------ your own planner
class OwnPlanner:
    """The class Planner of a user's file. Whatever it does wrong becomes an InputError."""

    def __init__(self, path):
        self.path, self.planner = path, None
        self.planner = self._ask(lambda: runpy.run_path(str(path))["Planner"]())

    def _ask(self, question):
        """The answer; it is thought out in a thread, for it may take longer than we wait: 10 s."""
        answer = queue.Queue()

        def think():
            try:
                answer.put((question(), None))
            except BaseException as error:  # noqa: BLE001  (even sys.exit)
                answer.put((None, " ".join(f"{type(error).__name__}: {error}".split())))

        threading.Thread(target=think, daemon=True).start()
        try:
            result, problem = answer.get(timeout=10)
        except queue.Empty:
            result, problem = None, "takes longer than 10 s"
        if problem:
            raise InputError(f"{self.path}: {problem}")
        return result

    def reset(self, num_robots):
        """See the head of this file."""
        self._ask(lambda: self.planner.reset(num_robots))

    def act(self, view, robots, measured):
        """Actions [n, 6], checked."""
        given = self._ask(lambda: self.planner.act(view, robots.copy(), measured.copy()))
        actions = self._ask(lambda: env.checked("actions", given, len(robots), 6))
        if actions.min() < 0 or actions.max() > 1:
            raise InputError(f"{self.path}: actions must lie between 0 and 1")
        return actions

# ------------------------------------------------------------------------ trials
@dataclass
class Trials:
    """Where n robots shall go, and what decides about their ground, body and noise."""
    goals: np.ndarray  # [n, 3] x, y [m], yaw [rad]
    seed: np.ndarray  # [n] of all trials
    number: np.ndarray  # [n] of each one
    friction: np.ndarray  # [n] μ of the ground; nan: as drawn
    purpose: str = "evaluation"  # a name in `STREAMS` of stage 3

def draw_trials(seed, count, far=False, friction=np.nan, purpose="evaluation"):
    """The trials 0, 1, …; a far trial is a near one with its goal twice as far."""
    goals = env.draw_goals(env.stream(purpose, seed), count, far=far)
    settings = np.full(count, seed), np.arange(count), np.full(count, friction)
    return Trials(goals, *settings, purpose)

def evaluate(planner, world, trials, noise=False, watch=None):
    """Walk robot i to the goal of trial i, all at the same time, until each trial has ended.

    Returns arrays [n]: outcome, time [s], steps, still_there; by the paper's rule reached_once and
    time_once [s]; and the friction μ. watch(robots, result) is called after every double step.
    """
    everybody = np.arange(len(trials.goals))
    world.noise = noise  # from now on
    # One generator per trial: what it draws depends neither on the planner nor on other trials.
    rngs = [env.stream(trials.purpose, *key) for key in zip(trials.seed, trials.number)]
    world.reset(everybody, rngs, trials.goals, trials.friction)
    friction = world.friction[everybody]
    planner.reset(len(everybody))
    outcome, time, once = np.full(len(rngs), "running"), np.zeros(len(rngs)), np.zeros(len(rngs))
    walking = everybody  # [m]: not ended yet
    while len(walking):
        measured = world.measure(walking)  # [m, 3] one measurement per decision
        view = world.view(walking, measured)
        result = world.step(planner.act(view, walking.copy(), measured), walking)
        for name in OUTCOMES:  # judged by the pose that physics made
            outcome[walking[result[name]]] = name
        time[walking] = result["time"]
        first = walking[result["inside"] & (once[walking] == 0)]
        once[first] = world.steps[first] * world.engine.period
        if watch:
            watch(walking, result)
        walking = walking[outcome[walking] == "running"]
    steps = world.steps[everybody]
    return {"outcome": outcome, "time": time, "steps": steps,
            "still_there": still_there(world, outcome == "success"),
            "reached_once": once > 0, "time_once": once, "friction": friction}

def still_there(world, reached):
    """Which successes [n] stand inside the tolerance after two more double steps in place, [n]."""
    robots, inside = np.flatnonzero(reached), np.zeros(len(reached), bool)
    for _ in range(2):
        if len(robots):
            result = world.step(np.tile(world.neutral_action, (len(robots), 1)), robots)
            inside[robots] = result["inside"]  # what counts is the second time
            robots = robots[~result["fall"]]  # who falls the first time stays outside
    return inside

def feet_poses(robot, torso, joints):
    """Measured feet [K, 2, 3] (x, y, yaw) for torsos [K, 6] and joints [K, 12]."""
    points, yaw = robot_model.body_points(robot, torso, joints)  # hip, knee, ankle, heel, toe
    return np.concatenate([points[:, :, 2, :2], yaw[..., None]], -1)

def record(planner, world, trials):
    """Walk without noise and keep what physics did: a dict per trial, see below."""
    seen, walks = [[] for _ in trials.goals], []

    def watch(robots, result):
        for i, torso, joints in zip(robots, result["motion"].torso, result["motion"].joints):
            seen[i].append((torso, joints))

    ended = evaluate(planner, world, trials, watch=watch)
    for i, goal in enumerate(trials.goals):
        torso, joints = (np.array(part) for part in zip(*seen[i]))  # [K, T, 6 and 12]
        # Feet at the last tick of every double step, the others at every tick.
        feet = feet_poses(world.engine.robot, torso[:, -1], joints[:, -1])
        walks.append({"goal": goal, "outcome": ended["outcome"][i], "time": ended["time"][i],
                      "feet": feet, "torso": np.concatenate(torso),
                      "joints": np.concatenate(joints)})
    return walks

# ------------------------------------------------------------------------ statistics
def wilson(count, total, z=1.96):
    """95 % interval of a rate: `count` of `total` trials; wide at 0 and 1, too (Wilson score)."""
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
    ours, theirs = trials["time"][both], reference["time"][both]  # [s], one per goal
    if not both.any():
        return None, None, 0
    # Paired bootstrap (not that of stage 4): draw goals, not times, again and again; a far goal is
    # far for both.  pick [resamples, goals]
    pick = np.random.default_rng(0).integers(len(ours), size=(resamples, len(ours)))
    ratios = ours[pick].mean(1) / theirs[pick].mean(1)  # [resamples]
    return ours.mean() / theirs.mean(), np.percentile(ratios, [2.5, 97.5]), len(ours)

def summary(planner, noise, std, trials, task):
    """One row of the table; rates are shares of the episodes, times those of the successes.

    std: of the goals' x and y [m], None for goals of one's own.
    """
    n, reached = len(trials["time"]), trials["outcome"] == "success"
    row = {"planner": planner, "noise": noise, "goal_std_m": std, "episodes": n}
    if noise:
        row |= {"noise_m": task.noise_m, "noise_rad": task.noise_rad}
    for name in OUTCOMES:
        count = int((trials["outcome"] == name).sum())
        row[name] = round(count / n, 4)
        row[f"{name}_ci95"] = [round(edge, 4) for edge in wilson(count, n)]
    row["reached_once"] = round(float(trials["reached_once"].mean()), 4)  # the paper's success
    for name in OUTCOMES[1:]:  # and what happened to the others
        others = (trials["outcome"] == name) & ~trials["reached_once"]
        row[f"{name}_once"] = round(float(others.mean()), 4)
    for name, who in (("time", reached), ("time_once", trials["reached_once"])):
        times = trials[name][who]  # None: no success
        row[f"{name}_mean"] = round(float(times.mean()), 3) if len(times) else None  # [s]
        row[f"{name}_std"] = round(float(times.std()), 3) if len(times) else None
    there = trials["still_there"][reached]
    row["still_there"] = round(float(there.mean()), 4) if len(there) else None  # of the successes
    return row

def compare(results):
    """Time ratios of every pair of planners; trials by (planner, noise, σ of the goals)."""
    ratios = []
    for (planner, *block), (reference, *other) in itertools.permutations(results, 2):
        if block == other:
            own, theirs = results[planner, *block], results[reference, *block]
            ratio, interval, goals = time_ratio(own, theirs)
            if goals:
                ratios.append({"planner": planner, "reference": reference, "noise": block[0],
                               "goal_std_m": block[1], "goals": goals,
                               "time_ratio": round(ratio, 4),
                               "time_ratio_ci95": [round(edge, 4) for edge in interval]})
    return ratios

def markdown(*rows):
    """Rows of cells as a table; the first one is its head. None: there was nothing to measure."""
    rows = rows[0], ("---",) * len(rows[0]), *rows[1:]
    shown = (["none" if cell is None else str(cell) for cell in row] for row in rows)
    return "".join("| " + " | ".join(row) + " |\n" for row in shown)

def seconds(mean, std):
    """A cell of a table."""
    return None if mean is None else f"{mean:.2f} ± {std:.2f}"

def table(rows, ratios, paper=PAPER):
    """Markdown: our rows; by the paper's rule, with the paper's own; ratios of the policies."""
    words, ours, once = ("no", "yes"), [], []
    for row in rows:
        noise, std, there = words[row["noise"]], row["goal_std_m"], row["still_there"]
        success = "{:.3f} [{:.3f}, {:.3f}]".format(row["success"], *row["success_ci95"])
        ours.append((f"{std} m" if std else "own", noise, row["planner"], success, f"{row['timeout']:.3f}",
                     f"{row['fall']:.3f}", seconds(row["time_mean"], row["time_std"]),
                     None if there is None else f"{there:.3f}"))
        if std == env.Task().goal_std_m and (row["planner"], row["noise"]) in paper:
            keys = "reached_once", "timeout_once", "fall_once", "time_once_mean", "time_once_std"
            for source, numbers in (("ours", [row[key] for key in keys]),
                                    ("paper", paper[row["planner"], row["noise"]])):
                once.append((noise, row["planner"], source, *(f"{x:.3f}" for x in numbers[:3]),
                             seconds(*numbers[3:])))
    text = markdown(("goals σ", "noise", "planner", "success [95 % interval]", "timeout", "fall",
                     "success time [s]", "still there"), *ours)
    if once:
        text += "\nBy the paper's rule, once at the goal, in two worlds:\n\n" + markdown(
            ("noise", "planner", "source", "success", "timeout", "fall", "time [s]"), *once)
    mine = [r for r in ratios if r["planner"].startswith("policy")]
    if mine:
        text += "\nMean success time relative to another planner, over goals both reached:\n\n"
    for r in mine:
        interval = "{:.3f} [{:.3f}, {:.3f}]".format(r["time_ratio"], *r["time_ratio_ci95"])
        size = f"σ {r['goal_std_m']} m" if r["goal_std_m"] else "own goals"
        text += (f"- {r['planner']} / {r['reference']}, {size}, "
                 f"{'with' if r['noise'] else 'without'} noise: {interval}, {r['goals']} goals\n")
    return text

# ------------------------------------------------------------------------ files
def read_trials(path, seed, friction):
    """The Trials of a CSV file with columns x, y [m], yaw [rad].

    Columns seed, trial and mu (μ), as in trials.csv, make them those very trials, each once;
    without them, line by line, they are trials of this seed and friction.
    """
    trials, line = {}, 1
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            reader.fieldnames = [name.strip().lower() for name in reader.fieldnames or ()]
            for row in reader:
                goal = row["x"], row["y"], row["yaw"]  # a KeyError here is the fault of line 1
                line = reader.line_num
                goal = tuple(float(text) for text in goal)
                key = int(row.get("seed", seed)), int(row.get("trial", len(trials)))
                mu = float(row.get("mu", friction)) if np.isnan(friction) else friction
                if None in row or None in row.values() or not np.isfinite(goal).all():
                    raise ValueError("a number is not finite, or too many or too few values")
                if min(key) < 0 or not 0 <= mu <= 100 and ("mu" in row or not np.isnan(mu)):
                    raise ValueError("seed, trial and mu are at least 0, mu is at most 100")
                trials[goal, key, str(mu)] = goal, key, mu
        if not trials:
            raise ValueError("there is none")
    except (OSError, UnicodeDecodeError, ValueError, TypeError, KeyError, csv.Error) as error:
        reason = f"needs columns x, y, yaw and finite numbers below them ({error})"
        raise InputError(f"{path}, line {line}: {reason}") from error
    goals, keys, mu = zip(*trials.values())
    goals = np.array(goals)
    goals[:, 2] = env.wrap(goals[:, 2])
    return Trials(goals, *map(np.array, zip(*keys)), np.array(mu))

def check_fits(path, stored, sim):
    """StaleError if what is stored in a file is not the fingerprint of stage 3."""
    mismatch = ppo.difference(stored, json.loads(json.dumps(env.fingerprint(sim))))  # as JSON
    if mismatch:
        raise StaleError(f"{path}: made for another robot, see tests/studies/: {mismatch}")

def load_baseline(path, sim):
    """The tuned BaselinePlanner of a file (all eight settings), and what to say of it."""
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
        names, values = zip(*stored["settings"].items())
        settings = BaselineSettings(**dict(zip(names, env.checked("settings", values, 8))))
        fits = dict(stored.get("fits", {}))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: not written by tests/studies/baseline.py") from error
    check_fits(path, fits, sim)
    return BaselinePlanner(settings), {"file": path.as_posix()}

def load_search(path, sim):
    """The SearchPlanner of a file, and what to say of it."""
    try:
        with np.load(path) as stored:
            about = json.loads(str(stored["about"]))
            steps, moves = stored["steps"], stored["moves"]
            # Kept are the differences along x, in twentieths of a double step.
            value = np.cumsum(stored["parts"], axis=2, dtype=np.float32) / 20
        env.checked("V", value, TURNS, 2 * HALF + 1, 2 * HALF + 1)
        env.checked("steps", steps, len(moves), 2, 3)
        env.checked("moves", moves, len(moves), 3)
        fits, facts = dict(about["fits"]), {key: float(about[key]) for key in ("factor", "change")}
        planner = SearchPlanner(steps, moves, value, walk_engine.LIMITS[sim], facts["change"])
    except Exception as error:  # numpy and zipfile raise many types
        raise InputError(f"{path}: not written by tests/studies/search.py") from error
    check_fits(path, fits, sim)
    return planner, {"file": path.as_posix(), **facts}

def write_text(path, text):
    """UTF-8 and plain line ends on every system; the old file or the new one, never half of one."""
    ppo.atomic_write(path, lambda temporary: temporary.write_bytes(text.encode("utf-8")))

def write_json(path, content):
    """Readable by a human, too; NaN would not be JSON."""
    write_text(path, json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n")

def write_trials(path, blocks, results):
    """One line per trial; blocks: Trials by the goals' σ, results by (planner, noise, σ)."""
    head = "planner,noise,goal_std_m,seed,trial,x,y,yaw,mu,outcome,time,steps,still_there"
    lines = [head + ",reached_once,time_once"]
    for (planner, noise, std), trials in results.items():
        asked, words = blocks[std], ("no", "yes")
        for i, (x, y, yaw) in enumerate(asked.goals.tolist()):
            at = {name: column[i] for name, column in trials.items()}
            lines.append(f"{planner},{words[noise]},{std or ''},{asked.seed[i]},{asked.number[i]},"
                         f"{x},{y},{yaw},{at['friction']},{at['outcome']},{at['time']:.2f},"
                         f"{at['steps']},{words[int(at['still_there'])]},"
                         f"{words[int(at['reached_once'])]},{at['time_once']:.2f}")
    write_text(path, "\n".join(lines) + "\n")

# ------------------------------------------------------------------------ pictures
def arrows(axes, poses, color, length=0.08, width=0.012, **kw):
    """Poses [n, 3] as arrows [m] that begin at x, y and point along yaw."""
    x, y, yaw = np.transpose(poses)
    axes.quiver(x, y, np.cos(yaw), np.sin(yaw), color=color, angles="xy", units="xy", width=width,
                scale_units="xy", scale=1 / length, headwidth=3.5, headlength=3.5, **kw)

def draw_walk(axes, walk, ticks=None, color="black", label="torso on the ground"):
    """Seen from above: the first `ticks` control ticks of a recorded walk (default: all)."""
    ticks, goal = ticks or len(walk["torso"]), walk["goal"]
    steps = ticks * len(walk["feet"]) // len(walk["torso"])  # whole double steps
    axes.add_patch(plt.Circle(goal[:2], env.Task().success_m, color="tab:blue", alpha=0.3, lw=0))
    for pose, marker, label in ((np.zeros(3), "o", "start"), (goal, "*", "goal, circle: 5 cm")):
        axes.plot(*pose[:2], marker, color="tab:blue", markersize=8, zorder=5, label=label)
        arrows(axes, [pose], "tab:blue", 0.2, 0.022, zorder=5)
    for side, label in enumerate(("left foot", "right foot") if steps else ()):
        arrows(axes, walk["feet"][:steps, side], robot_model.COLORS[side], zorder=3, label=label)
    path = np.vstack([[0, 0], walk["torso"][:ticks, :2]])
    axes.plot(*path.T, color=color, lw=1, zorder=4, label=label)
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axes.grid(alpha=0.3)

def ending(walk):  # in words
    words = {"success": "reached", "fall": "fell", "timeout": "not reached"}[walk["outcome"]]
    return f"{words} after {walk['time']:.1f} s, {len(walk['feet'])} double steps"

def plot_footsteps(columns, path):
    """The paper's Fig. 3 in one scale; walks by planner, a list of the same goals each."""
    figure, axes = plt.subplots(1, len(columns), figsize=(9.6, 5.2), sharex=True, sharey=True,
                                layout="constrained")
    for panel, (name, walks) in zip(axes, columns.items()):
        for number, walk in enumerate(walks, 1):
            draw_walk(panel, walk)
            x, y, _ = walk["goal"]  # its name stands on the far side of it
            panel.text(x + math.copysign(0.3, x), y, f"goal {number}", ha="center", va="center")
        lines = [f"goal {number} {ending(walk)}" for number, walk in enumerate(walks, 1)]
        panel.set_title("\n".join([name, *lines]), fontsize=10)
        panel.margins(0.3)
        panel.label_outer()
    handles, labels = axes[0].get_legend_handles_labels()
    known = dict(zip(labels, handles))  # each once
    figure.legend(known.values(), known.keys(), loc="outside lower center", ncols=5, frameon=False)
    ppo.atomic_write(path, lambda temporary: figure.savefig(temporary, dpi=130, format="png"))
    plt.close(figure)

def plot_race(walks, path, robot, every=20):
    """Walks to one goal by planner, at twice their speed; the first one also from the side."""
    name, first = next(iter(walks.items()))
    dt, lengths = robot.control_dt, {key: len(walk["torso"]) for key, walk in walks.items()}
    # The camera walks along: x is the way of the torso along its own heading, [M]; y and yaw are 0.
    torso = first["torso"]
    way = robot_model.turned(np.diff(torso[:, :2], axis=0, prepend=0), -torso[:, 5])[:, 0].cumsum()
    beside = np.column_stack([way, 0 * way, torso[:, 2:5], 0 * way])
    figure, (side, top) = plt.subplots(1, 2, figsize=(8, 4), layout="constrained")

    def draw(tick):
        side.clear()
        top.clear()
        now = min(tick, lengths[name] - 1)
        robot_model.draw_robot(side, robot, beside[now], first["joints"][now])
        side.axhline(0, color="black", lw=1)
        side.set(xlim=(way[now] - 0.4, way[now] + 0.4), ylim=(-0.04, 0.76), aspect="equal",
                 xlabel="way walked [m]", ylabel="z [m]", title=f"{name}, from the side")
        clocks = []
        for k, (key, walk) in enumerate(walks.items()):
            at = min(tick + 1, lengths[key])
            draw_walk(top, walk, at, ("black", "tab:orange")[k], key)
            done = at == lengths[key]
            clocks.append(f"{key}: {ending(walk) if done else f'{at * dt:.1f} s'}")
        top.set(xlim=(-1.3, 0.4), ylim=(-0.4, 1.0))
        top.set_title("\n".join(clocks), fontsize=10, loc="left")

    longest = max(lengths.values())
    frames = [*range(0, longest - 1, every), *[longest - 1] * 15]  # the end stays a while
    temporary = path.with_name(path.stem + ".tmp.gif")  # Pillow wants the ending .gif
    animation = FuncAnimation(figure, draw, frames, init_func=lambda: None)
    animation.save(temporary, PillowWriter(fps=2 / (every * dt)), dpi=75)
    os.replace(temporary, path)
    plt.close(figure)

# ------------------------------------------------------------------------ to play with
class Field:
    """Seen from above: press the mouse at a goal, drag to where the toes shall point, let go."""

    def __init__(self, world, planner):
        self.world, self.planner, self.pressed = world, planner, None
        self.figure, self.axes = plt.subplots(figsize=(7, 7), layout="constrained")
        self.figure.canvas.mpl_connect("button_press_event", self.press)
        self.figure.canvas.mpl_connect("button_release_event", self.release)
        self.pictures = self.live()

    def press(self, event):
        """The place of the goal."""
        self.pressed = [event.xdata, event.ydata] if event.inaxes is self.axes else None

    def release(self, event):
        """Its yaw: along the drag, or as the robot stands now."""
        if self.pressed and event.inaxes is self.axes:
            x, y = np.subtract([event.xdata, event.ydata], self.pressed)
            yaw = math.atan2(y, x) if math.hypot(x, y) > 0.05 else self.world.pose[0, 2]
            self.world.goal[0] = [*self.pressed, yaw]

    def live(self):
        """Steps for ever, and stands up again after a fall; every yield is a picture."""
        world, engine, robots = self.world, self.world.engine, np.array([0])
        while True:
            world.reset(robots, goals=np.zeros((1, 3)))
            self.planner.reset(1)
            path, fell = np.zeros((1, 6)), False
            while not fell:
                measured = world.measure(robots)
                action = self.planner.act(world.view(robots, measured), robots, measured)
                right, middle = engine.feet[:, 1], engine.feet[0].mean(0)  # in the engine's frame
                ahead = engine.landings(right, env.to_footsteps(action, world.limits))
                ahead = robot_model.relative(middle, np.concatenate(ahead))  # [2, 3]
                ahead = robot_model.compose(world.pose[0], ahead)  # in the world
                result = world.step(action, robots)
                fell = result["fall"][0]
                for torso in result["motion"].torso[0, 9::10]:  # ten times a second
                    path = np.vstack([path, torso])[-300:]
                    self.axes.clear()
                    walk = {"goal": world.goal[0], "torso": path, "feet": np.zeros((0, 2, 3))}
                    draw_walk(self.axes, walk)
                    for pose, color in zip(ahead, robot_model.COLORS):
                        arrows(self.axes, [pose], color)
                    self.axes.set(xlim=(-2, 2), ylim=(-2, 2), title="fell" if fell else "")
                    self.figure.canvas.draw_idle()
                    yield

def play(world, planner):
    """A window to play in, until it is closed."""
    for backend in ("MacOSX", "QtAgg", "TkAgg"):
        with contextlib.suppress(ImportError):
            plt.switch_backend(backend)
            field = Field(world, planner)
            timer = field.figure.canvas.new_timer(interval=100)  # [ms]
            timer.add_callback(next, field.pictures)
            timer.start()
            return plt.show()
    raise InputError("--play needs a display, and Tk or Qt")

# ------------------------------------------------------------------------ command line
def find(sim, name):
    """runs/<sim>/<name> if you made one, else the shipped results/<sim>/<name>, else None."""
    places = [Path(folder) / sim / name for folder in ("runs", "results")]
    return next((place for place in places if place.is_file()), None)

def choose_planners(sim, chosen=None, imu=False, own=None):
    """Planners by row name, the one for the figures first, and what evaluation.json says of them.

    The first policy, the one that the user named (chosen) or asked for (imu), must fit the world;
    the other ones join if they do. own: the file of a planner.
    """
    first, second = chosen or find(sim, "policy.pt"), find(sim, "imu/policy.pt")
    first, second = (second, first) if imu else (first, second)
    if first is None:
        command = "python 04_ppo.py" + " --mujoco" * (sim == "mujoco") + " --imu" * imu
        raise InputError(f"no policy for {sim} yet: train one with `{command}`, or use --policy")
    planners, about = {}, {}

    def add(name, load, path):
        try:
            planner, facts = load(path, sim)
            name = name or ("policy_imu" if planner.imu else "policy")
            if name not in planners:
                planners[name], about[name] = planner, facts
        except (StaleError, ppo.PolicyError) as error:
            if not planners:
                raise
            print(f"left out: {error}", file=sys.stderr)

    add(None, load_planner, first)
    if second:
        add(None, load_planner, second)
    planners["baseline"] = BaselinePlanner()
    for name, load, file in (("baseline_tuned", load_baseline, "baseline_tuned.json"),
                             ("search", load_search, "search.npz")):
        if find(sim, file):
            add(name, load, find(sim, file))
    if own:
        planners[own.stem], about[own.stem] = OwnPlanner(own), {"file": own.as_posix()}
    return planners, about

def run(world, blocks, planners, about, args, out):
    """Every planner in every block of Trials, with --noise once more; then the files."""
    print(*(f"{name}: {facts}" for name, facts in about.items()), sep="\n")
    results, first = {}, next(iter(planners))
    jobs = [(name, noise, std) for std in blocks for noise in (False, True)[: 1 + args.noise]
            for name in planners]
    for job in (bar := tqdm(jobs, unit=" rows", dynamic_ncols=True)):
        name, noise, std = job
        bar.set_description(f"{name}, {'with' if noise else 'without'} noise")
        results[job] = evaluate(planners[name], world, blocks[std], noise)
    rows = [summary(*job, trials, world.task) for job, trials in results.items()]
    ratios = compare(results)
    text = table(rows, ratios)
    print("\n" + text)  # first of all: writing may fail
    write_json(out / "evaluation.json", {
        "sim": args.sim, "policy": about[first], "planners": about, "seed": args.seed,
        "goals": args.goals or "drawn", "rows": rows, "ratios": ratios,
        "friction": "drawn" if np.isnan(args.friction) else args.friction})
    write_trials(out / "trials.csv", blocks, results)
    write_text(out / "table.md", text)
    shown = replace(draw_trials(args.seed, len(FIGURE_GOALS)), goals=FIGURE_GOALS)
    walks = {name: record(planners[name], world, shown) for name in ("baseline", first)}
    plot_footsteps(walks, out / "footsteps.png")
    if args.gif:  # a minute
        race = {name: walks[name][0] for name in (first, "baseline")}
        plot_race(race, out / "animation.gif", world.engine.robot)
    print("written: evaluation.json, trials.csv, table.md, footsteps.png in", out)

def parse(argv):
    """The checked arguments."""
    parser = robot_model.StageParser(__doc__, Path(__file__).name)
    parser.add_argument("--noise", action="store_true", help="add the rows with measurement noise")
    parser.add_argument("--far", action="store_true", help="a second block: goals twice as far")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--episodes", type=lambda text: robot_model.whole(text, 1), default=500,
                       help="goals (default 500)")
    which.add_argument("--goals", metavar="FILE.csv", help="columns x, y, yaw: m, m, rad")
    parser.add_argument("--friction", type=friction, metavar="MU", default=math.nan,
                        help="of the ground, for all; else drawn")
    parser.add_argument("--policy", type=Path, metavar="FILE", help="a policy.pt of 04_ppo.py")
    parser.add_argument("--planner", type=Path, metavar="FILE.py", help="a planner of your own")
    parser.add_argument("--imu", action="store_true", help="show the policy with IMU in figures")
    parser.add_argument("--gif", action="store_true", help="also draw animation.gif, a race")
    parser.add_argument("--play", action="store_true", help="click a goal, watch the robot walk")
    args = parser.parse(argv)
    if args.imu and args.policy:
        parser.error("--imu chooses a policy by itself, leave out --policy")
    if args.far and args.goals:
        parser.error("--far draws goals, --goals brings its own: leave out one of them")
    return parser, args

def friction(text):
    """A friction coefficient of the command line."""
    if not 0 <= float(text) < 100:  # nan is neither
        raise ValueError(text)
    return float(text)

def main(argv=None):
    parser, args = parse(argv)
    world, task = None, env.Task()
    torch.set_num_threads(1)  # a policy this small is slower on several threads
    try:
        if args.goals:
            blocks = {None: read_trials(args.goals, args.seed, args.friction)}
        else:  # by the spread of the goals
            blocks = {std: draw_trials(args.seed, args.episodes, far, args.friction)
                      for std, far in ((task.goal_std_m, False), (task.far_std_m, True))
                      if args.far or not far}
        planners, about = choose_planners(args.sim, args.policy, args.imu, args.planner)
        out = parser.folder(args)
        count = max(len(FIGURE_GOALS), *(len(trials.goals) for trials in blocks.values()))
        world = env.FootstepWorld(1 if args.play else count, args.sim)
        if args.play:
            play(world, [*planners.values()][-1 if args.planner else 0])
        else:
            run(world, blocks, planners, about, args, out)
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
