"""Stage 5: is the learned policy better than a hand-written planner, and how sure are we?

Paper: section III (500 goals, with and without measurement noise; Table II, Fig. 3) and its
baseline [10]: a velocity controller that follows the goal like a carrot on a stick.

    python 05_evaluate.py --noise          the paper's table and footstep figure, in two minutes
    python 05_evaluate.py --noise --gif    and an animation of one walk
    python 05_evaluate.py --goals my.csv   your own goals: columns x, y, yaw in m, m, rad

(`--mujoco` in 3-D; `--imu`: the figures show the policy that feels its torso's tilt.) Without a
training of your own it judges the one in `results/<sim>/`. Prints the table and writes it with
evaluation.json, trials.csv and footsteps.png to `runs/<sim>/`. Predict: the paper's policy needs
half the baseline's time, and falls about twice as often. Does this one?

A planner has `reset(num_robots)` and `act(world, robots, measured)`, which returns actions [n, 6]
in [0, 1] for the goals [n, 3] as n robots measured them: x, y [m], yaw [rad]. All meet the same
goals, and at their k-th decision the same noise, so a difference between two rows is due to the
planners; the intervals say how much these 500 goals could mislead about others. `baseline_tuned` is
the baseline with limits made for this simulator (tests/studies/baseline.py).

Leaves out: standing up after a fall, obstacles, the spread over training seeds.

[10] Hamburg Bit-Bots, bitbots_main, https://github.com/bit-bots/bitbots_main, as of 2024-10-02.
"""

import csv
import json
import math
import os
import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.animation import FuncAnimation, PillowWriter
from tqdm import tqdm

robot_model = import_module("01_robot_model")
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
    time_constant: float = 1.0  # [s] τ of the filter

# ------------------------------------------------------------------------ the baseline
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
    return velocity + (1 - math.exp(-seconds / time_constant)) * (command - velocity)

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
        """All robots stand."""
        self.velocity = np.zeros((num_robots, 3))  # filtered: v_x, v_y [m/s], ω [rad/s]

    def act(self, world, robots, measured):
        """Actions [n, 6] of these robots; clipped to the same step limits as the policy's."""
        period, command = world.engine.period, velocity_command(measured, self.settings)
        velocity = low_pass(self.velocity[robots], command, period, self.settings.time_constant)
        self.velocity[robots] = velocity
        return env.to_action(velocity_to_footsteps(velocity, period), world.limits)

# ------------------------------------------------------------------------ the policy
class PolicyPlanner:
    """The trained policy without exploring: `ActorCritic.decide` of stage 4."""

    def __init__(self, model, imu=False):
        self.model, self.imu = model, imu

    def reset(self, num_robots):
        """It remembers nothing: the two previous actions are part of the observation."""

    def act(self, world, robots, measured):
        """Actions [n, 6] of these robots."""
        return self.model.decide(world.observe(robots, measured, self.imu))

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

# ------------------------------------------------------------------------ trials
def evaluate(planner, world, goals, seed=0, noise=False, watch=None):
    """Walk robot i to goals[i] [n, 3], all at the same time, until each trial has ended.

    Returns arrays [n]: outcome, time [s], steps, still_there. The seed is that of the noise.
    watch(robots, result) is called after every double step until then.
    """
    everybody = np.arange(len(goals))
    world.noise = noise  # from now on
    # One generator per goal: its noise depends neither on the planner nor on the other goals.
    world.reset(everybody, [env.stream("evaluation", seed, i) for i in everybody], goals)
    planner.reset(len(goals))
    outcome, walking = np.full(len(goals), "running"), everybody  # walking [m]: not ended yet
    while len(walking):
        measured = world.measure(walking)  # [m, 3] one measurement per decision
        result = world.step(planner.act(world, walking, measured), walking)
        for name in OUTCOMES:  # judged by the pose that physics made
            ended = walking[result[name]]
            outcome[ended] = name
        if watch:
            watch(walking, result)
        walking = walking[outcome[walking] == "running"]
    steps = world.steps[everybody]
    return {"outcome": outcome, "time": steps * world.engine.period, "steps": steps,
            "still_there": still_there(world, outcome == "success")}

def still_there(world, reached):
    """Which successes [n] stand inside the tolerance after two more double steps in place, [n]."""
    robots, inside = np.flatnonzero(reached), np.zeros(len(reached), bool)
    for _ in range(2):
        if len(robots):
            result = world.step(np.tile(world.neutral_action, (len(robots), 1)), robots)
            inside[robots] = result["success"]  # what counts is the second time
            robots = robots[~result["fall"]]  # who falls the first time stays outside
    return inside

def record(planner, world, goals):
    """Walk to each goal without noise and keep what physics did: a dict per goal, see below."""
    seen, walks, ankle = [[] for _ in goals], [], 2  # of hip, knee, ankle, heel, toe

    def watch(robots, result):
        for i, torso, joints in zip(robots, result["motion"].torso, result["motion"].joints):
            seen[i].append((torso, joints))

    trials = evaluate(planner, world, goals, watch=watch)
    for i, goal in enumerate(goals):
        torso, joints = (np.array(part) for part in zip(*seen[i]))  # [K, T, 6 and 12]
        # Feet at the last tick of every double step, [K, 2, 3] x, y, yaw; the others at every tick.
        points, yaw = robot_model.body_points(world.engine.robot, torso[:, -1], joints[:, -1])
        feet = np.concatenate([points[:, :, ankle, :2], yaw[..., None]], -1)
        walks.append({"goal": goal, "outcome": trials["outcome"][i], "time": trials["time"][i],
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

def summary(planner, noise, trials, task):
    """One row of the table; rates are shares of the episodes, times those of the successes."""
    n, reached = len(trials["time"]), trials["outcome"] == "success"
    row = {"planner": planner, "noise": noise, "episodes": n}
    if noise:
        row |= {"noise_m": task.noise_m, "noise_rad": task.noise_rad}
    for name in OUTCOMES:
        count = int((trials["outcome"] == name).sum())
        row[name] = round(count / n, 4)
        row[f"{name}_ci95"] = [round(edge, 4) for edge in wilson(count, n)]
    times, there = trials["time"][reached], trials["still_there"][reached]  # None: no success
    row["time_mean"] = round(float(times.mean()), 3) if len(times) else None  # [s]
    row["time_std"] = round(float(times.std()), 3) if len(times) else None
    row["still_there"] = round(float(there.mean()), 4) if len(there) else None  # of the successes
    return row

def compare(results):
    """Time ratios of every policy to every baseline; trials by (planner, noise)."""
    ratios = []
    for planner, noise in results:
        for reference in ("baseline", "baseline_tuned"):
            if not planner.startswith("policy") or (reference, noise) not in results:
                continue
            ratio, interval, goals = time_ratio(results[planner, noise], results[reference, noise])
            if goals:
                ratios.append({"planner": planner, "reference": reference, "noise": noise,
                               "goals": goals, "time_ratio": round(ratio, 4),
                               "time_ratio_ci95": [round(edge, 4) for edge in interval]})
    return ratios

def table(rows, ratios, paper=PAPER):
    """The paper's Table II in Markdown: every row of ours, and the paper's own below it."""
    cells = [("noise", "planner", "source", "success [95 % interval]", "timeout", "fall",
              "success time [s]", "still there"), ("---",) * 8]
    for row in rows:
        success = "{:.3f} [{:.3f}, {:.3f}]".format(row["success"], *row["success_ci95"])
        reached = row["time_mean"] is not None
        cells.append(("yes" if row["noise"] else "no", row["planner"], "ours", success,
                      f"{row['timeout']:.3f}", f"{row['fall']:.3f}",
                      f"{row['time_mean']:.2f} ± {row['time_std']:.2f}" if reached else "none",
                      f"{row['still_there']:.3f}" if reached else "none"))
        if (row["planner"], row["noise"]) in paper:
            *rates, mean, std = paper[row["planner"], row["noise"]]
            rates = [f"{rate:.3f}" for rate in rates]
            cells.append(("", "", "paper", *rates, f"{mean:.2f} ± {std:.2f}", ""))
    lines = ["| " + " | ".join(line) + " |" for line in cells]
    if ratios:
        lines += ["", "Mean success time relative to another planner, over goals both reached:", ""]
    for r in ratios:
        ratio = "{:.3f} [{:.3f}, {:.3f}]".format(r["time_ratio"], *r["time_ratio_ci95"])
        lines.append(f"- {r['planner']} / {r['reference']}, {'with' if r['noise'] else 'without'} "
                     f"noise: {ratio}, {r['goals']} goals")
    return "\n".join(lines) + "\n"

# ------------------------------------------------------------------------ files
class InputError(ValueError):
    """Something given by the user cannot be used; the message is one line that says why."""

def read_goals(path):
    """Goals [n, 3] of a CSV file with columns x, y [m], yaw [rad]; further columns are ignored."""
    goals, line = [], 1
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            reader.fieldnames = [name.strip().lower() for name in reader.fieldnames or ()]
            for row in reader:
                goal = row["x"], row["y"], row["yaw"]  # a KeyError here is the fault of line 1
                line = reader.line_num
                goals.append([float(text) for text in goal])
                if None in row or None in row.values() or not np.isfinite(goals[-1]).all():
                    raise ValueError("a number is not finite, or too many or too few values")
        if not goals:
            raise ValueError("there is none")
    except (OSError, UnicodeDecodeError, ValueError, TypeError, KeyError, csv.Error) as error:
        reason = f"needs columns x, y, yaw and finite numbers below them ({error})"
        raise InputError(f"{path}, line {line}: {reason}") from error
    goals = np.array(goals)
    goals[:, 2] = env.wrap(goals[:, 2])
    return goals

def read_settings(path):
    """The BaselineSettings of a file: all eight, finite."""
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))["settings"]
        return BaselineSettings(**dict(zip(stored, env.checked("", list(stored.values()), 8))))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: not written by tests/studies/baseline.py") from error

def write_text(path, text):
    """UTF-8 and plain line ends on every system; the old file or the new one, never half of one."""
    ppo.atomic_write(path, lambda temporary: temporary.write_bytes(text.encode("utf-8")))

def write_json(path, content):
    """Readable by a human, too; NaN would not be JSON."""
    write_text(path, json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n")

def write_trials(path, goals, results):
    """One line per trial. Its columns x, y, yaw suit --goals; noise belongs to a line's number."""
    lines = ["planner,noise,trial,x,y,yaw,outcome,time,steps,still_there"]
    for (planner, noise), trials in results.items():
        for i, (x, y, yaw) in enumerate(goals.tolist()):
            end, time, steps, there = (column[i] for column in trials.values())
            lines.append(f"{planner},{'yes' if noise else 'no'},{i},{x},{y},{yaw},{end},"
                         f"{time:.2f},{steps},{'yes' if there else 'no'}")
    write_text(path, "\n".join(lines) + "\n")

# ------------------------------------------------------------------------ pictures
def arrows(axes, poses, color, length=0.08, width=0.012, **kw):
    """Poses [n, 3] as arrows [m] that begin at x, y and point along yaw."""
    x, y, yaw = np.transpose(poses)
    axes.quiver(x, y, np.cos(yaw), np.sin(yaw), color=color, angles="xy", units="xy", width=width,
                scale_units="xy", scale=1 / length, headwidth=3.5, headlength=3.5, **kw)

def draw_walk(axes, walk, ticks=None):
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
    axes.plot(*path.T, color="black", lw=1, zorder=4, label="torso on the ground")
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

def plot_animation(walk, path, robot, every=10, longest=16.0):
    """A walk (its first `longest` seconds) in real time, seen from the side and from above."""
    torso, dt = walk["torso"][: round(longest / robot.control_dt)], robot.control_dt  # [M, 6]
    # The camera walks along: x is the way of the torso along its own heading, [M]; y and yaw are 0.
    way = robot_model.turned(np.diff(torso[:, :2], axis=0, prepend=0), -torso[:, 5])[:, 0].cumsum()
    beside = torso.copy()
    beside[:, 0], beside[:, 1], beside[:, 5] = way, 0, 0
    corners = np.vstack([torso[:, :2], [walk["goal"][:2]]])
    low, high = corners.min(0) - 0.3, corners.max(0) + 0.3
    figure, (side, top) = plt.subplots(1, 2, figsize=(8, 4), layout="constrained")

    def draw(tick):
        side.clear()
        top.clear()
        robot_model.draw_robot(side, robot, beside[tick], walk["joints"][tick])
        side.axhline(0, color="black", lw=1)
        side.set(xlim=(way[tick] - 0.4, way[tick] + 0.4), ylim=(-0.04, 0.76), aspect="equal",
                 xlabel="way walked [m]", ylabel="z [m]")
        ended = tick + 1 == len(walk["torso"])
        side.set_title(ending(walk) if ended else f"{(tick + 1) * dt:.1f} s")
        draw_walk(top, walk, tick + 1)
        top.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), title="from above")

    frames = list(range(0, len(torso) - 1, every)) + [len(torso) - 1] * 15  # the end stays a while
    temporary = path.with_name(path.stem + ".tmp.gif")  # Pillow wants the ending .gif
    animation = FuncAnimation(figure, draw, frames, init_func=lambda: None)
    animation.save(temporary, PillowWriter(fps=round(1 / (every * dt))), dpi=75)
    os.replace(temporary, path)
    plt.close(figure)

# ------------------------------------------------------------------------ command line
def find(sim, name):
    """runs/<sim>/<name> if you made one, else the shipped results/<sim>/<name>, else None."""
    places = [Path(folder) / sim / name for folder in ("runs", "results")]
    return next((place for place in places if place.is_file()), None)

def choose_planners(sim, chosen=None, imu=False):
    """Planners by row name, the one for the figures first, and what evaluation.json says of them.

    The first policy, the one that the user named (chosen) or asked for (imu), must fit the world;
    the other one joins if it does.
    """
    first, second = chosen or find(sim, "policy.pt"), find(sim, "imu/policy.pt")
    first, second = (second, first) if imu else (first, second)
    if first is None:
        command = "python 04_ppo.py" + " --mujoco" * (sim == "mujoco") + " --imu" * imu
        raise InputError(f"no policy for {sim} yet: train one with `{command}`, or use --policy")
    planner, facts = load_planner(first, sim)
    name = "policy_imu" if planner.imu else "policy"
    planners, about = {name: planner}, {name: facts}
    try:
        planner, facts = load_planner(second or first, sim)
        name = "policy_imu" if planner.imu else "policy"
        planners.setdefault(name, planner)
        about.setdefault(name, facts)
    except ppo.PolicyError as error:
        print(f"left out: {error}", file=sys.stderr)
    planners["baseline"], path = BaselinePlanner(), find(sim, "baseline_tuned.json")
    if path:
        planners["baseline_tuned"] = BaselinePlanner(read_settings(path))
        about["baseline_tuned"] = {"file": path.as_posix()}
    return planners, about

def run(world, goals, planners, about, args, out):
    """Every planner, with --noise once more; then the files."""
    print(*(f"{name}: {facts}" for name, facts in about.items()), sep="\n")
    results = {}
    jobs = [(name, noise) for noise in (False, True)[: 1 + args.noise] for name in planners]
    for name, noise in (bar := tqdm(jobs, unit=" rows", dynamic_ncols=True)):
        bar.set_description(f"{name}, {'with' if noise else 'without'} noise")
        results[name, noise] = evaluate(planners[name], world, goals, args.seed, noise)
    rows = [summary(name, noise, trials, world.task) for (name, noise), trials in results.items()]
    ratios, first = compare(results), next(iter(planners))
    text = table(rows, ratios, {} if args.goals else PAPER)
    print("\n" + text)  # first of all: writing may fail
    write_json(out / "evaluation.json", {
        "sim": args.sim, "policy": about[first], "planners": about, "seed": args.seed,
        "goals": args.goals or "drawn", "rows": rows, "ratios": ratios})
    write_trials(out / "trials.csv", goals, results)
    write_text(out / "table.md", text)
    walks = {name: record(planners[name], world, FIGURE_GOALS) for name in ("baseline", first)}
    plot_footsteps(walks, out / "footsteps.png")
    if args.gif:  # half a minute
        plot_animation(walks[first][0], out / "animation.gif", world.engine.robot)
    print("written: evaluation.json, trials.csv, table.md, footsteps.png in", out)

def main(argv=None):
    parser = robot_model.StageParser(__doc__, Path(__file__).name)
    parser.add_argument("--noise", action="store_true", help="add the rows with measurement noise")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--episodes", type=lambda text: robot_model.whole(text, 1), default=500,
                       help="goals (default 500)")
    which.add_argument("--goals", metavar="FILE.csv", help="columns x, y, yaw: m, m, rad")
    parser.add_argument("--policy", type=Path, metavar="FILE", help="a policy.pt of 04_ppo.py")
    parser.add_argument("--imu", action="store_true", help="show the policy with IMU in figures")
    parser.add_argument("--gif", action="store_true", help="also draw animation.gif")
    args = parser.parse(argv)
    if args.imu and args.policy:
        parser.error("--imu chooses a policy by itself, leave out --policy")
    world = None
    torch.set_num_threads(1)  # a policy this small is slower on several threads
    try:
        goals = env.draw_goals(env.stream("evaluation", args.seed), args.episodes)  # [n, 3]
        goals = read_goals(args.goals) if args.goals else goals
        planners, about = choose_planners(args.sim, args.policy, args.imu)
        out = parser.folder(args)
        world = env.FootstepWorld(max(len(goals), len(FIGURE_GOALS)), args.sim)
        run(world, goals, planners, about, args, out)
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
