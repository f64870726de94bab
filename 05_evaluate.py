"""Stage 5: is the learned policy better than other planners, and how sure are we?

Paper: section III (500 goals, with and without measurement noise; Table II, Fig. 3), its baseline
[10], a velocity controller that follows the goal like a carrot on a stick, and the classical answer
of its references [3] and [4]: search for the shortest way.

    python 05_evaluate.py --noise          the paper's table and footstep figure, in a minute
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

A planner is a class with `reset(num_robots)`, called before the trials, and `act(view, robots,
measured)`, which returns actions [n, 6] in [0, 1] for the goals [n, 3] as n robots measured them:
x, y [m], yaw [rad]. The view (stage 3) shows what else it may know. All meet the same goals, ground
and bodies, and at their k-th decision the same noise, so a difference between two rows is due to
the planners; the intervals say how much these 500 trials could mislead about others. `baseline` is
as in the paper, `baseline_tuned` and `search` are optimised for this world (tests/studies).

Leaves out: standing up after a fall, obstacles, the spread over training seeds.
[10] Hamburg Bit-Bots, bitbots_main, https://github.com/bit-bots/bitbots_main, as of 2024-10-02.
"""

import contextlib
import csv
import itertools
import json
import math
import runpy
import sys
import threading
import traceback
from concurrent import futures
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from tqdm import tqdm

robot_model = import_module("01_robot_model")
walk_engine = import_module("02_walk_engine")
env = import_module("03_env")
ppo = import_module("04_ppo")

OUTCOMES = {"success": "reached", "timeout": "not reached", "fall": "fell"}  # and in words
WORDS = {False: "no", True: "yes"}
PAPER = {  # Table II by (planner, noise): success, timeout, fall, success time [s] and its std
    ("policy", False): (0.980, 0.000, 0.020, 6.07, 2.13),
    ("baseline", False): (0.960, 0.032, 0.008, 11.13, 4.95),
    ("policy", True): (0.978, 0.000, 0.022, 6.35, 2.23),
    ("baseline", True): (0.910, 0.078, 0.012, 11.43, 5.11),
}
MOST = 10**4  # [trials] in a block: they take 5 GB of memory
FIGURE_GOALS = np.array([[0.9, 0.5, 1.6], [-0.7, -0.6, -2.6]])  # x, y [m], yaw [rad]; our choice
InputError = ppo.PolicyError  # of whatever the user gives: a line that says why

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
    """The filter τ·dv/dt = v_cmd − v, solved exactly, after some seconds; τ = 0: no filter."""
    # v ← v + (1 − exp(−t/τ))·(v_cmd − v)
    return velocity + (1 - math.exp(-seconds / max(time_constant, 1e-9))) * (command - velocity)

def velocity_to_footsteps(velocity, period):
    """v_x, v_y [m/s], ω [rad/s] [n, 3] as footsteps [n, 2, 3], each seen from the other foot."""
    v_x, v_y, omega = velocity.T
    half = period / 2  # [s] a single step
    # x: each foot lands v_x·(period/2) ahead of the other one
    # y: the leading foot takes the way of the whole period, left to the left, right to the right;
    #    the other one follows with y = 0
    # yaw: ω·(period/2) counter-clockwise, which is outward for the left foot only
    left = v_x * half, np.maximum(v_y, 0) * period, omega * half
    right = v_x * half, np.maximum(-v_y, 0) * period, -omega * half
    return np.moveaxis([left, right], -1, 0)

class BaselinePlanner:
    """[10], once per double step instead of 20 times a second, with the goal as the carrot."""
    def __init__(self, settings=BaselineSettings()):
        self.settings = settings

    def reset(self, num_robots):
        self.velocity = np.full((num_robots, 3), np.nan)  # filtered: v_x, v_y [m/s], ω [rad/s]

    def act(self, view, robots, measured):
        """Actions [n, 6], clipped to the same step limits as the policy's."""
        command, last = velocity_command(measured, self.settings), self.velocity[robots]
        last = np.where(np.isnan(last), command, last)  # the first command is not filtered
        velocity = low_pass(last, command, view.period, self.settings.time_constant)
        self.velocity[robots] = velocity
        return env.to_action(velocity_to_footsteps(velocity, view.period), view.limits)

# ------------------------------------------------------------------------ search, and the policy
CELL, TURN = 0.05, math.radians(10)  # [m], [rad] size of a cell of the map of poses
HALF, TURNS = 64, 36  # cells on each side of the goal (3.2 m), and around the circle
FAR = 25.5  # [double steps] what the map says where the goal is out of reach

def look_up(value, poses):
    """V [...] at poses [..., 3] (x, y [m], yaw [rad]) seen from the goal; linear between cells.

    V [TURNS, 2·HALF + 1, 2·HALF + 1], over yaw, x and y: how many double steps are left from there;
    worked out from the goal outwards, once for all poses (tests/studies/search.py).
    """
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
    """Takes the double step after which the fewest are left. Of dynamics it knows nothing."""
    def __init__(self, steps, moves, value, limits, change):
        self.moves, self.value = moves, value
        self.change = change  # [share of limits] how far an action may be from the last one
        self.actions = env.to_action(steps, limits)  # [A, 6]

    def reset(self, num_robots):
        """It remembers nothing."""

    def act(self, view, robots, measured):
        pose = robot_model.relative(measured, np.zeros(3))  # of the robot, seen from the goal
        # From beyond the map it goes to where the map begins: a carrot again.
        edge = CELL * HALF - np.abs(self.moves[:, :2]).max() * math.sqrt(2)  # [m]
        pose[:, :2] /= np.maximum(1, np.abs(pose[:, :2]).max(-1, keepdims=True) / edge)
        left = look_up(self.value, robot_model.compose(pose[:, None], self.moves))  # [n, A]
        change = np.abs(view.actions[:, :1] - self.actions).max(-1)  # [n, A]
        # What was done last may always be done again; what differs too much costs a lot.
        left = left + 100 * np.maximum(0, change - self.change)
        return self.actions[left.argmin(1)]

class PolicyPlanner:
    """The trained policy without exploring: `ActorCritic.decide` of stage 4."""
    def __init__(self, model, imu=False):
        self.model, self.imu = model, imu

    def reset(self, num_robots):
        """It remembers nothing: the two previous actions are part of the observation."""

    def act(self, view, robots, measured):
        seen = len(env.observation_table(self.imu))  # the rows of the IMU are the last ones
        return self.model.decide(view.observation[:, :seen])

# ------------------------------------------------------------------------ your own planner
PATIENCE = 10.0  # [s] for every answer of it

class OwnPlanner:
    """The class Planner of a user's file. Whatever it does wrong becomes an InputError."""
    def __init__(self, path):
        self.path = path
        self.planner = self._ask(lambda: runpy.run_path(str(path))["Planner"]())

    def _ask(self, question):
        """The answer; it is thought out in a thread, for it may take longer than we wait."""
        answer = futures.Future()

        def think():
            try:
                answer.set_result(question())
            except BaseException as error:  # a foreign class may raise anything, even SystemExit
                answer.set_exception(error)

        threading.Thread(target=think, daemon=True).start()
        if not futures.wait([answer], PATIENCE).done:
            raise InputError(f"{self.path}: no answer in {PATIENCE} s")
        if error := answer.exception():
            frames = traceback.extract_tb(error.__traceback__)
            lines = [frame.lineno for frame in frames if frame.filename == str(self.path)]
            where = f"{self.path}, line {lines[-1]}" if lines else self.path
            raise InputError(" ".join(f"{where}: {error!r}".split()))
        return answer.result()

    def reset(self, num_robots):
        self._ask(lambda: self.planner.reset(num_robots))

    def act(self, view, robots, measured):
        actions = self._ask(lambda: env.checked(
            "actions", self.planner.act(view, robots, measured), len(robots), 6))
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
    return Trials(goals, np.full(count, seed), np.arange(count), np.full(count, friction), purpose)

def evaluate(planner, world, trials, noise=False, watch=lambda robots, result: None):
    """Walk robot i to the goal of trial i, all at the same time, until each trial has ended.

    Returns arrays [n]: friction μ, outcome, time [s], steps, still_there (a success, and inside
    after two more double steps in place); by the paper's rule reached_once and time_once [s].
    watch(robots, result) is called after every double step.
    """
    everybody = np.arange(len(trials.goals))
    world.noise = noise  # from now on
    # One generator per trial: what it draws depends neither on the planner nor on other trials.
    rngs = [env.stream(trials.purpose, *key) for key in zip(trials.seed, trials.number)]
    world.reset(everybody, rngs, trials.goals, trials.friction)
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
        watch(walking, result)
        walking = walking[outcome[walking] == "running"]
    steps, inside = world.steps[everybody], np.zeros(len(rngs), bool)
    standing = everybody[outcome == "success"]  # two more double steps, in place
    for _ in range(2):
        if len(standing):
            result = world.step(np.tile(world.neutral_action, (len(standing), 1)), standing)
            inside[standing] = result["inside"]  # what counts is the second time
            standing = standing[~result["fall"]]  # who falls the first time stays outside
    return {"friction": world.friction[everybody], "outcome": outcome, "time": time,
            "steps": steps, "still_there": inside, "reached_once": once > 0, "time_once": once}

def record(planner, world, trials):
    """Walk without noise and keep what physics did, a dict per trial: torso [T, 6] and joints
    [T, 12] at every tick, feet [K, 2, 3] (x, y, yaw) after K double steps.
    """
    seen, walks = [], []
    ended = evaluate(planner, world, trials,
                     watch=lambda robots, result: seen.append((robots, result["motion"])))
    for i, goal in enumerate(trials.goals):
        torso = np.concatenate([motion.torso[robots == i] for robots, motion in seen])
        joints = np.concatenate([motion.joints[robots == i] for robots, motion in seen])
        points, turn = robot_model.body_points(world.engine.robot, torso[:, -1], joints[:, -1])
        yaw = np.arctan2(turn[..., 1, 0], turn[..., 0, 0])  # [K, 2] where the toes point
        ending = f"{OUTCOMES[ended['outcome'][i]]} after {ended['time'][i]:.1f} s"
        walks.append({"goal": goal, "ending": ending,
                      "feet": np.concatenate([points[:, :, 2, :2], yaw[..., None]], -1),
                      "torso": np.concatenate(torso), "joints": np.concatenate(joints)})
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
    """Mean time / mean time of another planner over the goals that both reached, the 95 % interval
    of this ratio, and the number of these goals; None, None, 0 without such a goal.
    """
    both = (trials["outcome"] == "success") & (reference["outcome"] == "success")
    ours, theirs = trials["time"][both], reference["time"][both]  # [s], one per goal
    if not both.any():
        return None, None, 0
    # Paired bootstrap (not that of stage 4): draw as many goals again, with replacement; a far goal
    # is far for both.  pick [resamples, goals]
    pick = np.random.default_rng(0).integers(len(ours), size=(resamples, len(ours)))
    ratios = ours[pick].mean(1) / theirs[pick].mean(1)  # [resamples]
    return ours.mean() / theirs.mean(), np.percentile(ratios, [2.5, 97.5]), len(ours)

def compare(results):
    """Time ratios of every pair of planners; trials by (planner, noise, σ of the goals)."""
    ratios = []
    for one, other in itertools.permutations(results, 2):
        if one[1:] == other[1:]:
            ratio, interval, goals = time_ratio(results[one], results[other])
            if goals:
                ratios.append({
                    "planner": one[0], "reference": other[0], "noise": one[1], "goal_std_m": one[2],
                    "goals": goals, "time_ratio": round(ratio, 4),
                    "time_ratio_ci95": [round(edge, 4) for edge in interval]})
    return ratios

def rounded(number, values, digits=4):
    """number(values), their mean for example; None: there was nothing to measure."""
    return round(float(number(values)), digits) if len(values) else None

def summary(planner, noise, std, trials, task):
    """One row of the table; std: σ of the goals' x and y [m], None for goals of one's own."""
    reached, timeout, fall = (trials["outcome"] == name for name in OUTCOMES)
    once = trials["reached_once"]
    shares = {"success": reached, "timeout": timeout, "fall": fall,  # and by the paper's rule:
              "reached_once": once, "timeout_once": timeout & ~once, "fall_once": fall & ~once,
              "still_there": trials["still_there"][reached]}  # of the successes
    row = {"planner": planner, "noise": noise, "goal_std_m": std, "episodes": len(reached)}
    if noise:
        row |= {"noise_m": task.noise_m, "noise_rad": task.noise_rad}
    row |= {name: rounded(np.mean, share) for name, share in shares.items()}
    for name in OUTCOMES:
        row[f"{name}_ci95"] = np.round(wilson(int(shares[name].sum()), len(reached)), 4).tolist()
    for name, who in (("time", reached), ("time_once", once)):
        row[f"{name}_mean"] = rounded(np.mean, trials[name][who], 3)  # [s]
        row[f"{name}_std"] = rounded(np.std, trials[name][who], 3)
    return row

def markdown(head, *rows):
    """Tuples of texts as a table."""
    return "".join("| " + " | ".join(row) + " |\n" for row in (head, ["---"] * len(head), *rows))

def cell(form, *numbers):
    """A text for the table."""
    return "none" if None in numbers else form.format(*numbers)

def table(rows, ratios, paper=PAPER):
    """Markdown: our rows; by the paper's rule, with the paper's own; ratios of the policies."""
    share, interval, seconds = "{:.3f}", "{:.3f} [{:.3f}, {:.3f}]", "{:.2f} ± {:.2f}"
    ours, once = [], []
    for row in rows:
        who, std = (WORDS[row["noise"]], row["planner"]), row["goal_std_m"]
        ours.append((
            f"{std} m" if std else "own", *who,
            interval.format(row["success"], *row["success_ci95"]),
            share.format(row["timeout"]), share.format(row["fall"]),
            cell(seconds, row["time_mean"], row["time_std"]), cell(share, row["still_there"])))
        known = paper.get((row["planner"], row["noise"]))
        if known and std == env.Task().goal_std_m:
            keys = "reached_once", "timeout_once", "fall_once", "time_once_mean", "time_once_std"
            for source, numbers in (("ours", [row[key] for key in keys]), ("paper", known)):
                shares = map(share.format, numbers[:3])
                once.append((*who, source, *shares, cell(seconds, *numbers[3:])))
    text = markdown(("goals σ", "noise", "planner", "success [95 % interval]", "timeout", "fall",
                     "success time [s]", "still there"), *ours)
    if once:
        text += "\nBy the paper's rule, once at the goal, in two worlds:\n\n" + markdown(
            ("noise", "planner", "source", "success", "timeout", "fall", "time [s]"), *once)
    mine = [(f"{r['goal_std_m']} m" if r["goal_std_m"] else "own", WORDS[r["noise"]], r["planner"],
             r["reference"], interval.format(r["time_ratio"], *r["time_ratio_ci95"]),
             str(r["goals"])) for r in ratios
            if r["planner"].startswith("policy") or r["planner"] == rows[0]["planner"]]
    if mine:
        text += "\nMean success time ÷ that of another planner, over goals both reached:\n\n"
        text += markdown(("goals σ", "noise", "planner", "÷", "ratio", "common goals"), *mine)
    return text

# ------------------------------------------------------------------------ files
def read_trials(path, seed, friction):
    """The Trials of a CSV file with columns x, y [m], yaw [rad]: line by line of this seed and
    friction; but with columns seed, trial and mu (μ), as in trials.csv, those very ones, each once.
    """
    trials, line = {}, 1
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            reader.fieldnames = [name.strip().lower() for name in reader.fieldnames or ()]
            for row in reader:
                x, y, yaw = row["x"], row["y"], row["yaw"]  # a KeyError is the fault of line 1
                line = reader.line_num
                goal = float(x), float(y), env.wrap(float(yaw))
                key = int(row.get("seed", seed)), int(row.get("trial", len(trials)))
                given = "mu" in row and np.isnan(friction)
                mu = float(row["mu"]) if given else friction
                sound = all(abs(v) < 1e9 for v in goal) and 0 <= min(key) <= max(key) < 2**63 - 1
                same = goal, key, str(mu)  # as text, for nan is not nan
                room = same in trials or len(trials) < MOST
                if None in row or not (sound and room) or given and not 0 <= mu <= 100:
                    raise ValueError("too many, too large, below 0, or mu above 100")
                trials[same] = goal, key, mu
        if not trials:
            raise ValueError("there is none")
    except (OSError, ValueError, TypeError, KeyError, csv.Error) as error:
        reason = f"needs columns x, y, yaw and finite numbers below them ({error})"
        raise InputError(f"{path}, line {line}: {reason}") from error
    goals, keys, mu = map(np.array, zip(*trials.values()))
    return Trials(goals, *keys.T, mu)

def load(path, sim):
    """Row name and planner of a file, and what evaluation.json says of it; or an InputError."""
    imu, facts = False, {}
    try:
        if path.suffix == ".json":
            stored, name = json.loads(path.read_text(encoding="utf-8")), "baseline_tuned"
            names, values = zip(*stored["settings"].items())
            settings = env.checked("settings", [v if 0 < v < 1e6 else math.nan for v in values], 8)
            planner = BaselinePlanner(BaselineSettings(**dict(zip(names, settings))))
        elif path.suffix == ".npz":
            with np.load(path) as file:
                stored, name = json.loads(str(file["about"])), "search"
                steps = env.checked("steps", file["steps"], len(file["moves"]), 2, 3)
                moves = env.checked("moves", file["moves"], len(steps), 3)
                # Kept are the differences along x, in twentieths of a double step.
                value = np.cumsum(file["parts"], axis=2, dtype=np.float32) / 20
            env.checked("V", value, TURNS, 2 * HALF + 1, 2 * HALF + 1)
            facts = {key: float(stored[key]) for key in ("factor", "change")}
            planner = SearchPlanner(steps, moves, value, walk_engine.LIMITS[sim], facts["change"])
        else:
            model, stored = ppo.load_policy(path)
            imu = stored["obs_dim"] > len(env.observation_table())
            facts = {"imu": imu, **{key: stored.get(key) for key in ("steps", "minutes", "seed")}}
            name, planner = "policy" + "_imu" * imu, PolicyPlanner(model, imu)
            env.checked("actions", model.decide(np.zeros((1, stored["obs_dim"]))), 1, 6)
        json.dumps(facts, allow_nan=False)  # it will be written
        fits = stored.get("fits", {}), env.fingerprint(sim, imu)
        if mismatch := ppo.difference(*(json.loads(json.dumps(plain)) for plain in fits)):
            raise StaleError(f"{path}: made for another robot, see tests/studies/: {mismatch}")
    except InputError:
        raise
    except Exception as error:  # numpy and zipfile raise many types
        raise InputError(f"{path}: not written by 04_ppo.py or tests/studies/") from error
    return name, planner, {"file": path.as_posix(), **facts}

def write_text(path, text):
    """UTF-8 and plain line ends on every system; the old file or the new one, never half of one."""
    robot_model.atomic_write(path, lambda file: file.write_bytes(text.encode("utf-8")))

def write_trials(path, blocks, results):
    """One line per trial; blocks: Trials by the goals' σ, results by (planner, noise, σ)."""
    lines = ["planner,noise,goal_std_m,seed,trial,x,y,yaw,mu,outcome,time,steps,still_there,"
             "reached_once,time_once"]
    for (planner, noise, std), ended in results.items():
        asked = blocks[std]
        still, once = (np.where(ended[key], "yes", "no") for key in ("still_there", "reached_once"))
        for cells in zip(asked.seed, asked.number, *asked.goals.T, ended["friction"],
                         ended["outcome"], ended["time"].round(2), ended["steps"],
                         still, once, ended["time_once"].round(2)):
            lines.append(",".join(map(str, (planner, WORDS[noise], std or "", *cells))))
    write_text(path, "\n".join(lines) + "\n")

# ------------------------------------------------------------------------ pictures
def arrows(axes, poses, color, length=0.08, width=0.012, **kw):
    """Poses [n, 3] as arrows [m] that begin at x, y and point along yaw."""
    x, y, yaw = np.transpose(poses)
    axes.quiver(x, y, np.cos(yaw), np.sin(yaw), color=color, angles="xy", units="xy", width=width,
                scale_units="xy", scale=1 / length, headwidth=3.5, headlength=3.5, **kw)

def draw_walk(axes, walk, ticks=None, color="black", alpha=1.0):
    """Seen from above: the first `ticks` control ticks of a recorded walk (default: all)."""
    ticks, goal = ticks or len(walk["torso"]), walk["goal"]
    steps = ticks * len(walk["feet"]) // len(walk["torso"])  # whole double steps
    axes.add_patch(plt.Circle(goal[:2], env.Task().success_m, color="tab:green", alpha=0.3, lw=0))
    for pose, marker, name in ((np.zeros(3), "o", "start"), (goal, "*", "goal, circle: 5 cm")):
        axes.plot(*pose[:2], marker, color="tab:green", markersize=8, zorder=5, label=name)
        arrows(axes, [pose], "tab:green", 0.2, 0.022, zorder=5)
    for side, name in enumerate(("left foot", "right foot") if steps else ()):
        arrows(axes, walk["feet"][:steps, side], robot_model.COLORS[side], zorder=3, label=name,
               alpha=alpha)
    path = np.vstack([[0, 0], walk["torso"][:ticks, :2]])
    axes.plot(*path.T, color=color, lw=1, zorder=4, label="torso on the ground")
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axes.grid(alpha=0.3)

def plot_footsteps(columns, path):
    """The paper's Fig. 3 in one scale; walks by planner, a list of the same goals each."""
    figure, axes = plt.subplots(1, len(columns), figsize=(9.6, 4.5), sharex=True, sharey=True,
                                layout="constrained")
    for panel, (name, walks) in zip(axes, columns.items()):
        lines = [name]
        for number, walk in enumerate(walks, 1):
            draw_walk(panel, walk)
            x, y, _ = walk["goal"]  # its name stands on the far side of it
            panel.text(x + math.copysign(0.3, x), y, f"goal {number}", ha="center", va="center")
            lines.append(f"goal {number} {walk['ending']}")
        panel.set_title("\n".join(lines), fontsize=10)
        panel.margins(0.3)
        panel.label_outer()
    known = dict(zip(*axes[0].get_legend_handles_labels()[::-1]))  # handles by label, each once
    figure.legend(known.values(), known.keys(), loc="outside lower center", ncols=5, frameon=False)
    robot_model.atomic_write(path, lambda file: figure.savefig(file, dpi=130))
    plt.close(figure)

def plot_race(walks, path, robot, every=10):
    """Walks to one goal by planner, at twice their speed; the first one also from the side."""
    name, first = next(iter(walks.items()))
    last, torso = max(len(walk["torso"]) for walk in walks.values()) - 1, first["torso"]
    # The camera walks along: x is the way of the torso along its own heading, [M]; y and yaw are 0.
    way = robot_model.turned(np.diff(torso[:, :2], axis=0, prepend=0), -torso[:, 5])[:, 0].cumsum()
    beside = np.column_stack([way, 0 * way, torso[:, 2:5], 0 * way])
    figure, (side, top) = plt.subplots(1, 2, figsize=(8, 4), layout="constrained")
    looks = ("black", 1.0, 0.95), ("tab:purple", 0.4, 0.89)  # color, alpha, where its clock stands

    def draw(tick):
        side.clear()
        top.clear()
        now = min(tick, len(way) - 1)
        robot_model.draw_robot(side, robot, beside[now], first["joints"][now])
        side.axhline(0, color="black", lw=1)
        side.set(xlim=(way[now] - 0.4, way[now] + 0.4), ylim=(-0.04, 0.76), aspect="equal",
                 xlabel="along its heading [m]", ylabel="z [m]", title=f"{name}, from the side")
        for (key, walk), (color, alpha, y) in zip(walks.items(), looks):
            draw_walk(top, walk, tick + 1, color, alpha)
            walks_on = tick + 1 < len(walk["torso"])
            clock = f"{(tick + 1) * robot.control_dt:.1f} s" if walks_on else walk['ending']
            top.text(0.02, y, f"{key}: {clock}", color=color, transform=top.transAxes)
        top.set(xlim=(-0.4, 1.3), ylim=(-0.4, 1.0), title="from above, goal: green")

    film = FuncAnimation(figure, draw, [*range(0, last, every), *[last] * 30])  # the end stays
    writer = PillowWriter(fps=2 / (every * robot.control_dt))
    robot_model.atomic_write(path, lambda file: film.save(file, writer, dpi=75))
    plt.close(figure)

# ------------------------------------------------------------------------ to play with
class Field:
    """Seen from above: press the mouse at a goal, drag to where the toes shall point, let go."""
    def __init__(self, world, planner, friction=np.nan):
        self.world, self.planner, self.friction, self.pressed = world, planner, friction, None
        self.figure, self.axes = plt.subplots(figsize=(7, 7), layout="constrained")
        self.figure.canvas.mpl_connect("button_press_event", self.point)
        self.figure.canvas.mpl_connect("button_release_event", self.point)

    def point(self, event):
        """Where the button goes down is the goal; it looks to where the button comes up."""
        if event.inaxes is not self.axes:
            self.pressed = None
        elif event.name == "button_press_event":
            self.pressed = event.xdata, event.ydata
        elif self.pressed:
            x, y = np.subtract([event.xdata, event.ydata], self.pressed)
            yaw = math.atan2(y, x) if math.hypot(x, y) > 0.05 else self.world.pose[0, 2]
            self.world.goal[0] = *self.pressed, yaw

    def live(self):
        """Steps for ever, and stands up again after a fall; every yield is a picture."""
        world, robots, fell = self.world, np.array([0]), True
        while True:
            if fell:
                world.reset(robots, goals=np.zeros((1, 3)), friction=self.friction)
                self.planner.reset(1)
                path = []  # of the torso
            measured = world.measure(robots)
            action = self.planner.act(world.view(robots, measured), robots.copy(), measured)
            pose, middle = world.pose[0].copy(), world.engine.feet[0].mean(0)
            result = world.step(action, robots)
            # The engine has its own frame: the new feet seen from between the old ones, [2, 3].
            ahead = robot_model.relative(middle, world.engine.feet[0])
            feet, fell = robot_model.compose(pose, ahead)[None], result["fall"][0]
            for torso in result["motion"].torso[0, 9::10]:  # ten times a second
                path.append(torso)
                self.axes.clear()
                draw_walk(self.axes, {"goal": world.goal[0], "torso": np.array(path), "feet": feet})
                title = "fell" if fell else "press at a goal, drag to where the toes shall point"
                self.axes.set(xlim=(-2, 2), ylim=(-2, 2), title=title)
                yield

def play(world, planner, friction):
    """A window to play in, until it is closed."""
    for backend in ("MacOSX", "QtAgg", "TkAgg"):
        with contextlib.suppress(ImportError):
            plt.switch_backend(backend)
            field = Field(world, planner, friction)
            for _ in field.live():
                plt.pause(0.05)  # [s] and drawing takes as long again
                if not plt.fignum_exists(field.figure.number):
                    return
    raise InputError("--play needs a display, and Tk or Qt")

# ------------------------------------------------------------------------ command line
def find(sim, name):
    """runs/<sim>/<name> if you made one, else the shipped results/<sim>/<name>, else None."""
    places = [Path(folder) / sim / name for folder in ("runs", "results")]
    return next((place for place in places if place.is_file()), None)

def choose_planners(sim, chosen=None, imu=False, own=None):
    """Planners by row name, the one for the figures first, and what evaluation.json says of them.

    The first policy, the one that the user named (chosen) or asked for (imu), must fit the world;
    the other ones join if they do. own: the file of a planner, which then comes first of all.
    """
    policies = [chosen or find(sim, "policy.pt"), find(sim, "imu/policy.pt")]
    if imu:
        policies.reverse()
    if policies[0] is None:
        command = "python 04_ppo.py" + " --mujoco" * (sim == "mujoco") + " --imu" * imu
        raise InputError(f"no policy for {sim} yet: train one with `{command}`, or use --policy")
    planners, about = {}, {}
    opponents = find(sim, "baseline_tuned.json"), find(sim, "search.npz")
    for path in filter(None, (*policies, *opponents)):
        try:
            name, planner, facts = load(path, sim)
            planners.setdefault(name, planner)
            about.setdefault(name, facts)
        except StaleError as error:
            if not planners:
                raise
            print(f"left out: {error}", file=sys.stderr)
    planners["baseline"] = BaselinePlanner()
    if own:
        name = own.stem.replace(",", ";") + ".py"  # none of ours has an ending; commas end cells
        planners, about[name] = {name: OwnPlanner(own), **planners}, {"file": own.as_posix()}
    return planners, about

def run(world, blocks, planners, about, args, out):
    """Every planner in every block of Trials, with --noise once more; then the files."""
    print(*(f"{name}: {facts}" for name, facts in about.items()), sep="\n")
    results, first = {}, next(iter(planners))
    jobs = [*itertools.product(blocks, (False, True)[: 1 + args.noise], planners)]
    for std, noise, name in (bar := tqdm(jobs, unit=" rows", dynamic_ncols=True)):
        bar.set_description(f"{name}, {'with' if noise else 'without'} noise")
        results[name, noise, std] = evaluate(planners[name], world, blocks[std], noise)
    rows = [summary(*job, trials, world.task) for job, trials in results.items()]
    ratios = compare(results)
    text = table(rows, ratios)
    print("\n" + text)  # first of all: writing may fail
    content = {"sim": args.sim, "policy": next(iter(about.values())), "planners": about,
               "seed": args.seed, "goals": args.goals or "drawn", "rows": rows, "ratios": ratios,
               "friction": "drawn" if np.isnan(args.friction) else args.friction}
    write_text(out / "evaluation.json", json.dumps(content, indent=1, allow_nan=False) + "\n")
    write_trials(out / "trials.csv", blocks, results)
    write_text(out / "table.md", text)
    shown = replace(draw_trials(args.seed, len(FIGURE_GOALS)), goals=FIGURE_GOALS)
    walks = {name: record(planners[name], world, shown) for name in ("baseline", first)}
    plot_footsteps(walks, out / "footsteps.png")
    if args.gif:  # a minute
        race = {name: walks[name][0] for name in (first, "baseline")}
        plot_race(race, out / "animation.gif", world.engine.robot)
    print("written: evaluation.json, trials.csv, table.md, footsteps.png in", out)

def main(argv=None):
    parser = robot_model.StageParser(__doc__, Path(__file__).name)
    parser.add_argument("--noise", action="store_true", help="add the rows with measurement noise")
    parser.add_argument("--far", action="store_true", help="a second block: goals twice as far")
    goals, policies = (parser.add_mutually_exclusive_group() for _ in range(2))
    goals.add_argument("--episodes", type=lambda text: robot_model.whole(text, 1, MOST),
                       default=500, help="goals (default 500)")
    goals.add_argument("--goals", metavar="FILE.csv", help="columns x, y, yaw: m, m, rad")
    parser.add_argument("--friction", type=float, metavar="MU", default=math.nan,
                        help="of the ground, for all; else drawn")
    policies.add_argument("--policy", type=Path, metavar="FILE", help="a policy.pt of 04_ppo.py")
    policies.add_argument("--imu", action="store_true", help="show the policy with IMU in figures")
    parser.add_argument("--planner", type=Path, metavar="FILE.py", help="a planner of your own")
    parser.add_argument("--gif", action="store_true", help="also draw animation.gif, a race")
    parser.add_argument("--play", action="store_true", help="click a goal, watch the robot walk")
    args, task = parser.parse(argv), env.Task()
    if args.far and args.goals is not None:
        parser.error("--far draws goals, --goals brings its own: leave out one of them")
    if args.friction is not math.nan and not 0 <= args.friction < 100:  # math.nan: not given
        parser.error(f"--friction from 0 to 100, not {args.friction}")
    try:
        blocks = {std: draw_trials(args.seed, args.episodes, std > task.goal_std_m, args.friction)
                  for std in (task.goal_std_m, task.far_std_m)[: 1 + args.far]}
        if args.goals is not None:
            blocks = {None: read_trials(args.goals, args.seed, args.friction)}
        planners, about = choose_planners(args.sim, args.policy, args.imu, args.planner)
        out = parser.folder(args)
        most = max(len(FIGURE_GOALS), *(len(trials.goals) for trials in blocks.values()))
        world = env.FootstepWorld(1 if args.play else most, args.sim, args.noise)
        with contextlib.closing(world):
            if args.play:
                play(world, next(iter(planners.values())), args.friction)
            else:
                run(world, blocks, planners, about, args, out)
    except (InputError, OSError) as error:
        parser.error(str(error))

if __name__ == "__main__":
    robot_model.run(main)
