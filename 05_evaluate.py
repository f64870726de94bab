"""Stage 5: is the learned policy better than other planners, and how sure are we?

Paper: section III, 500 goals with and without measurement noise (Table II, Fig. 3). With noise its
policy takes 56 % of the baseline's time, and falls about twice as often. Does ours? Guess, then run

    python 05_evaluate.py --noise          the paper's table and figure: 1 to 3 minutes
    python 05_evaluate.py --noise --far    also 500 goals twice as far, in a block of their own
    python 05_evaluate.py --friction 0.4   the same floor for all, instead of a random one
    python 05_evaluate.py --push 0.4       pushes by 0.4 m/s, every 3 s on average
    python 05_evaluate.py --planner my.py  your own planner beside the others (or several)
    python 05_evaluate.py --robot my.py    another robot: ROBOT, WALK, LIMITS of your file
    python 05_evaluate.py --jobs 1         one process, for pdb and cProfile (default in 3-D)
    python 05_evaluate.py --mujoco         all of this in 3-D

It evaluates what `--policy` names, or else your policy in `runs/<sim>/`, or else the shipped one. To
`runs/<sim>/` go tables (with the times of successes), all trials, and two walks: footsteps.png.

All planners meet the same goals, floors, bodies and pushes, and at their k-th decision the same
noise (common random numbers). So no row has easier goals, and we may compare trial by trial: falls
with `mcnemar`, times with `bootstrap`. Test your final choice with another `--seed` than 0.

Read down to the line of equals signs. Left out: standing up after a fall, obstacles.
"""

import csv
import io
import itertools
import json
import math
import multiprocessing
import signal
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from operator import itemgetter
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

robot_model = import_module("01_robot_model")
env = import_module("03_env")
ppo = import_module("04_ppo")
InputError = robot_model.InputError
OUTCOMES = ("success", "timeout", "fall")
FIGURE_GOALS = np.array([[0.9, 0.5, 1.6], [-0.7, -0.6, -2.6]])  # x, y [m], yaw [rad]; our choice


# ------------------------------------------------------------------------ trials
@dataclass
class Trials:
    """Where n robots should go, and what their random floors, bodies and noise depend on."""

    goals: np.ndarray  # [n, 3] x, y [m], yaw [rad]
    seed: int  # of the random stream
    purpose: str = "evaluation"  # a name in `STREAMS` of stage 3
    first: int = 0  # the number of the first trial in the stream


def draw_trials(seed, count, far=False, purpose="evaluation"):
    """The trials 0, 1, …; a far trial is the near one of its number with the goal twice as far."""
    return Trials(env.draw_goals(env.stream(purpose, seed), count, far=far), seed, purpose)


def evaluate(planner, world, trials, watch=None):
    """Lets robot i walk to the goal of trial i, all at the same time, until each trial has ended.
    watch(robots, motion) is called after every double step. Returns arrays [n]:
        mu           of the floor
        outcome      a name in OUTCOMES; a success: two double steps in a row end at the goal
                     (in the paper one)
        time         [s] to the end of the first of these two; else all of it
        steps        double steps, all of them
        still_there  a success, and at the goal also after two more double steps in place"""
    n = len(trials.goals)
    everybody = np.arange(n)
    # One generator per trial: its numbers depend neither on the planner nor on other trials.
    rngs = [env.stream(trials.purpose, trials.seed, trials.first + i) for i in range(n)]
    world.reset(everybody, rngs, trials.goals)
    planner.reset(n)
    outcome = np.full(n, "running", object)
    time = np.zeros(n)  # [s]
    walking = everybody  # [k] whose trial has not ended

    while len(walking):
        result = double_step(planner, world, walking)
        for name in OUTCOMES:  # the simulated pose decides
            outcome[walking[result[name]]] = name
        time[walking] = result["time"]
        if watch:
            watch(walking, result["motion"])
        walking = walking[outcome[walking] == "running"]
    steps = world.steps[:n].copy()

    still_there = np.zeros(n, bool)
    standing = everybody[outcome == "success"]
    for _ in range(2):  # two more double steps, in place; what counts is where the second one ends
        if len(standing):
            result = world.step([world.neutral_action] * len(standing), standing)
            still_there[standing] = result["inside"]
            standing = standing[~result["fall"]]

    return {
        "mu": world.simulator.variation.friction[everybody],
        "outcome": outcome,
        "time": time.round(12),
        "steps": steps,
        "still_there": still_there,
    }


def double_step(planner, world, robots):
    """Looks, decides, walks: returns what `FootstepWorld.step` does. Raises a ValueError that names
    the planner's file if its actions are not [n, 6] in [0, 1]."""
    name = f"{type(planner).__module__}: actions"  # the module of your own is its file
    actions = env.checked(name, planner.act(world.view(robots)), len(robots), 6)
    if actions.min() < 0 or actions.max() > 1:
        raise ValueError(f"{name} must lie between 0 and 1, not {actions}")
    return world.step(actions, robots)


# ------------------------------------------------------------------------ statistics
def wilson(count, total, z=1.96):
    """95 % interval [low, high] of a rate, of which we have counted `count` of `total` trials (the
    Wilson score): all true rates p from which our p̂ is at most z standard deviations away,
    |p̂ − p| ≤ z·√(p·(1 − p)/n). Of 100 such intervals about 95 hold the truth. They say how sure we
    are of each planner alone, not whether two differ."""
    # Squared, with "=", this is a quadratic equation of p. Its solutions are the ends:
    # (p̂ + z²/(2n) ± z·√(p̂·(1 − p̂)/n + z²/(4n²))) / (1 + z²/n)
    rate = count / total  # p̂; the interval has a width also if it is 0
    middle = rate + z**2 / (2 * total)
    to_an_end = z * math.sqrt(rate * (1 - rate) / total + z**2 / (4 * total**2))
    scale = 1 + z**2 / total
    return [max(0.0, (middle - to_an_end) / scale), min(1.0, (middle + to_an_end) / scale)]


def bootstrap(statistic, *samples, resamples=2000):
    """95 % interval of a statistic of samples [n], by resampling: many times n of the n walks are
    chosen at random, with replacement. statistic: gets these choices from each of the samples,
    arrays [resamples, n], and returns [resamples] numbers."""
    count = len(samples[0])
    pick = np.random.default_rng(0).integers(count, size=(resamples, count))  # [resamples, n]
    return np.percentile(statistic(*(sample[pick] for sample in samples)), [2.5, 97.5])


def time_ratio(walks, reference):
    """Compares two planners over the goals that both reached; walks, reference: what `evaluate`
    returns of the same trials. Returns a dict, which is empty if there is no such goal:
    goals                   how many these are
    time_ratio              mean time / mean time of the reference
    time_ratio_ci95         its interval; of fewer than 20 goals nan
    faster, equal, slower   shares of the goals that took fewer, as many, more double steps (not
                            seconds: a robot that waits for 0.01 s is not a slower one)"""
    both = (walks["outcome"] == "success") & (reference["outcome"] == "success")
    if not both.any():
        return {}
    ours, theirs = walks["time"][both], reference["time"][both]  # [goals] [s]
    interval = np.full(2, np.nan)
    if len(ours) >= 20:
        # In pairs: both take long to a distant goal, and this cancels in the ratio. (Without pairs
        # our intervals would be about twice as wide.)
        interval = bootstrap(lambda a, b: a.mean(1) / b.mean(1), ours, theirs)
    more_steps = walks["steps"][both] - reference["steps"][both]  # [goals]
    return {
        "goals": len(ours),
        "time_ratio": ours.mean() / theirs.mean(),
        "time_ratio_ci95": [*interval],
        "faster": np.mean(more_steps < 0),
        "equal": np.mean(more_steps == 0),
        "slower": np.mean(more_steps > 0),
    }


def mcnemar(ours, theirs):
    """Compares two planners in the same trials by McNemar's exact test; ours, theirs: bool [n], did
    it happen in a trial (a fall)? Returns a dict:
    only_ours, only_theirs   trials in which it happened with one of them alone
    p                        how often chance would divide these trials at least as unevenly, if
                             both planners were equal"""
    one, other = int((ours & ~theirs).sum()), int((theirs & ~ours).sum())
    # Between equals each of these trials is a toss of a coin: P(at most k of n) = Σ C(n, i) / 2ⁿ
    n, k = one + other, min(one, other)
    p = 2 * sum(math.comb(n, i) for i in range(k + 1)) / 2**n  # 2: either may have fewer
    return {"only_ours": one, "only_theirs": other, "p": min(1.0, p)}


# ==================================================================== the end of a first reading
# ------------------------------------------------------------------------ two planners
# [10] Hamburg Bit-Bots, bitbots_main, https://github.com/bit-bots/bitbots_main, as of 2024-10-02.
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
    share: bool = False  # do both feet share sidesteps, too, as their limits allow? Ours


TUNED_BASELINE = {  # the same controller for this world, by `tests/studies/baseline.py`, 2026-11-28
    "pymunk": BaselineSettings(
        forward=0.4453,
        backward=0.6209,
        sideways=0.809,
        turning=0.6081,
        gain=0.9863,
        turning_gain=1.0009,
        far_m=1.3102,
        time_constant=0.0767,
        share=True,
    ),
    "mujoco": BaselineSettings(
        forward=0.4726,
        backward=0.4054,
        sideways=0.4742,
        turning=3.167,
        gain=0.9788,
        turning_gain=1.1781,
        far_m=1.4531,
        time_constant=0.0217,
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
    lead: share of a sideways distance and of a turn that the leading foot takes, outward."""
    # x: each foot lands v_x·(period/2) ahead of the other one
    # y: of the distance v_y·period the leading foot (left to the left, right to the right) takes
    #    its share, outward; the other foot follows with the rest, inward
    # yaw: the turn ω·period is shared in the same way
    forward = velocity[:, 0] * period / 2  # [n] [m]
    way = velocity[:, 1:] * period  # [n, 2] of both feet together, to the left [m, rad]
    first = way * lead  # of the leading foot
    rest = way - first  # of the other foot
    left = np.where(way > 0, first, rest)
    right = np.where(way > 0, rest, first)
    outward = left, -right
    return np.stack([np.column_stack([forward, side]) for side in outward], 1)


class BaselinePlanner:
    """The controller of the robot's team, [10], the paper's baseline: a speed in proportion to the
    distance, up to a limit. Ours decides once per double step instead of 20 times a second."""

    def __init__(self, settings=BaselineSettings()):
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
            span = np.subtract(view.limits.high, view.limits.low)[1:]  # [2] of y, of yaw
            lead = view.limits.high[1:] / np.maximum(span, 1e-9)
        return env.to_action(velocity_to_footsteps(velocity, view.period, lead), view.limits)


class PolicyPlanner:
    """The trained policy without exploring: `ActorCritic.decide` of stage 4."""

    def __init__(self, model):
        self.model = model

    def reset(self, num_robots):
        """Resets nothing: the last action is part of the observation."""

    def act(self, view):
        return self.model.decide(view.observation)


# ------------------------------------------------------------------------ all rows of the table
def world_settings(args):
    """What the command line says of every world, as arguments of `FootstepWorld`: which simulator,
    the robot of a file of your own, the same floor for all."""
    settings = {"sim": args.sim, "robot": robot_model.ROBOT}
    if args.robot:
        settings |= env.robot_settings(args.robot, args.sim)
    if args.friction is not None:
        settings["robot"] = replace(settings["robot"], friction=args.friction)
        settings["spread"] = env.Spread(friction=0.0)
    return settings


def walk(planner, trials, settings):
    """What `evaluate` returns, in a world with these settings."""
    world = env.FootstepWorld(len(trials.goals), **settings)
    with env.one_line_if_it_exits(type(planner).__module__):  # of a planner of your own: its file
        return evaluate(planner, world, trials)


PART = 100  # trials that go to another process together; with 50 all walks take 25 % longer


def parts_of(trials):
    """The same trials in parts of nearly equal size, none with one robot alone, for which PyTorch
    rounds in another way."""
    starts = range(0, len(trials.goals), PART)
    return [
        replace(trials, goals=trials.goals[own], first=own[0])
        for own in np.array_split(np.arange(len(trials.goals)), len(starts))
    ]


@contextmanager
def in_other_processes(jobs, count):
    """Lets so many other processes walk (none, if `count` is 1), but not for a user's planner;
    jobs: arguments of `walk` by row. Gives futures by row, one for each part of its trials. However
    the block ends, these processes end with it, and no others."""
    if count == 1:
        yield {}
        return
    with ProcessPoolExecutor(count, multiprocessing.get_context("spawn")) as pool:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # inherited: Ctrl-C is for us
        futures = {
            row: [pool.submit(walk, planner, part, settings) for part in parts_of(trials)]
            for row, (planner, trials, settings) in jobs.items()
            if type(planner) in (PolicyPlanner, BaselinePlanner)
        }
        signal.signal(signal.SIGINT, before)
        try:
            yield futures
        except BrokenExecutor as error:
            raise InputError("a process was killed: is the memory full? Try --jobs 1") from error
        finally:
            for process in [*pool._processes.values()]:  # as `kill_workers` of Python 3.14 does
                process.kill()


def evaluate_all(args, blocks, planners, settings):
    """What `evaluate` returns, by row: (planner's name, noise, σ), in worlds with these settings;
    blocks: Trials by the σ of their goals [m]."""
    jobs = {  # in the order of the table
        (name, noise, std): (planner, trials, settings | {"noise": noise, "push": args.push or 0})
        for std, trials in blocks.items()
        for noise in sorted({False, args.noise})
        for name, planner in planners.items()
    }
    bar = tqdm(total=args.episodes * len(jobs), unit=" walks")
    found = {}
    with bar, in_other_processes(jobs, args.jobs) as futures:  # no bar below the line of Ctrl-C
        for row, job in jobs.items():
            parts = []
            for future in futures.get(row, [None]):  # None: this process walks, all at once
                parts.append(future.result() if future else walk(*job))
                bar.update(len(parts[-1]["time"]))
            found[row] = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return found


# ------------------------------------------------------------------------ tables
def compare(results):
    """Compares the policy with every other planner, see `mcnemar` and `time_ratio`; results: what
    `evaluate` returns, by row."""
    rows = []
    for (name, noise, std), walks in results.items():
        if name != "policy":
            ours = results["policy", noise, std]
            row = {"reference": name, "noise": noise, "goal_std_m": std}
            row |= mcnemar(ours["outcome"] == "fall", walks["outcome"] == "fall")
            rows.append(row | time_ratio(ours, walks))
    return rows


def summary(planner, noise, std, walks):
    """One row of the table; std: σ of the goals' x and y [m]. nan: there was nothing to measure."""
    outcome = walks["outcome"]
    total = len(outcome)
    row = {"planner": planner, "noise": noise, "goal_std_m": std, "episodes": total}
    for name in OUTCOMES:
        count = np.sum(outcome == name)
        row |= {name: count / total, f"{name}_ci95": wilson(count, total)}
    reached = outcome == "success"
    times, still = walks["time"][reached], walks["still_there"][reached]
    if not reached.any():
        times = still = np.array([np.nan])
    return row | {
        "still_there": still.mean(),  # of the successes
        "time_mean": times.mean(),
        "time_std": times.std(),
        "time_median": np.median(times),
        "time_p95": np.quantile(times, 0.95),
    }


NOTE = """
Time: mean ± standard deviation, median, 95th percentile of the successes [s]. The paper tells
neither σ nor noise, and seems to ask for one double step at the goal. We chose σ = 0.5 m so that
`baseline` takes as long as there: that it does proves nothing.
"""
YES = {False: "no", True: "yes"}
PAPER = {  # Table II, without and with noise; ±: standard deviation of the times
    False: [
        "policy, paper | 0.980 | 0.000 | 0.020 |   6.07 ± 2.13 | ",
        "baseline, paper | 0.960 | 0.032 | 0.008 |  11.13 ± 4.95 | ",
    ],
    True: [
        "policy, paper | 0.978 | 0.000 | 0.022 |   6.35 ± 2.23 | ",
        "baseline, paper | 0.910 | 0.078 | 0.012 |  11.43 ± 5.11 | ",
    ],
}
RATIO_NOTE = """\
Is `policy` better? Time: its mean ÷ that of the other planner, over the goals that both reached.
Faster: shares of these goals, by the number of double steps. Falls: walks in which the robot fell
with `policy` alone, with the other planner alone.

"""


def markdown(head, rows):
    """A table in Markdown with aligned columns; a line is a text like "cell | cell"."""
    lines = [line.split(" | ") for line in (head, *rows)]
    lines.insert(1, ["---"] * len(lines[0]))
    widths = [max(map(len, column)) for column in zip(*lines)]
    return "".join(f"| {' | '.join(map(str.ljust, line, widths))} |\n" for line in lines)


def rate_line(row):
    """A line of the tables of rates and times."""
    low, high = row["success_ci95"]
    return (
        f"{row['planner']} | {row['success']:.3f} [{low:.3f}, {high:.3f}] "
        f"| {row['timeout']:.3f} | {row['fall']:.3f} "
        f"| {row['time_mean']:6.2f} ± {row['time_std']:.2f}, {row['time_median']:5.2f}, {row['time_p95']:5.2f} "
        f"| {row['still_there']:.3f}"
    )


def ratio_line(row):
    """A line of the table that compares the policy with another planner."""
    time, shares = "no goal in common", ""
    if "time_ratio" in row:
        low, high = row["time_ratio_ci95"]
        time = f"{row['time_ratio']:.3f} [{low:5.3f}, {high:5.3f}]"
        shares = f"{row['faster']:.3f}, {row['equal']:.3f}, {row['slower']:.3f}"
    falls = f"{row['only_ours']}, {row['only_theirs']}"
    return (
        f"σ {row['goal_std_m']} m | {YES[row['noise']]} | {row['reference']} "
        f"| {time} | {shares} | {falls} | {row['p']:.3f}"
    )


def table(rows, ratios, flags=""):
    """Tables in Markdown: the policy compared with the others; then our rows and the paper's, in a
    block for each kind of goals and noise (the paper's leave if flags change the walks)."""
    text = f"With {flags}\n" if flags else ""
    if ratios:
        head = "goals | noise | other | time [95 %] | faster, equal, slower | falls | p"
        text += RATIO_NOTE + markdown(head, map(ratio_line, ratios))
    for (std, noise), block in itertools.groupby(rows, itemgetter("goal_std_m", "noise")):
        lines = [rate_line(row) for row in block]
        if std == env.Task.goal_std_m and not flags:
            lines += PAPER[noise]
        head = "planner | success [95 %] | timeout | fall | mean ± σ, median, 95th | still there"
        text += f"\nGoals: σ {std} m; noise: {YES[noise]}\n\n{markdown(head, lines)}"
    return text if flags else text + NOTE


# ------------------------------------------------------------------------ files
def write_trials(path, blocks, results):
    """Writes a line for each trial; blocks: Trials by σ, results by (planner, noise, σ)."""
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    head = "planner noise goal_std_m seed trial x y yaw mu outcome time steps still_there"
    lines.writerow(head.split())
    for (planner, noise, std), walks in results.items():
        trials = blocks[std]
        # What `evaluate` returns has the order of the head: mu, outcome, time, steps; still_there
        for i, (goal, *walk, still) in enumerate(zip(trials.goals, *walks.values())):
            lines.writerow([planner, YES[noise], std, trials.seed, i, *goal, *walk, YES[still]])
    robot_model.write_text(path, text.getvalue())


def policy_planner(path, world):
    """The planner of a policy.pt. Prints what differs from its training. Raises an InputError if it
    cannot work in this world."""
    model, about = ppo.load_policy(path)
    here, there = ppo.fingerprint(world), about.get("fits")
    if not there:
        raise InputError(f"{path}: trained in another environment, not to choose footsteps")
    different = [name for name in here if there.get(name) != here[name]]
    for name in "simulator", "observation":
        if name in different:
            raise InputError(f"{path}: trained in another {name}: {there.get(name)} (--mujoco?)")
    if different:
        print(f"note: {path.as_posix()} was trained with another {', '.join(different)}")
    return PolicyPlanner(model)


def load_planner(path):
    """The planner in a file of your own, a class with `reset(num_robots)`, called before the trials
    of a row, and `act(view)`, which returns actions [n, 6] in [0, 1] and may use nothing but this
    View of stage 3. `tests/studies/search.py` is a worked example."""
    (planner_class,) = env.names_in(path, Planner=type)
    return planner_class()


def choose_planners(world, policies, files=()):
    """Planners by row name: of these files of policies and of planners, then both baselines. The
    first policy is `policy`; the others are named by their files, or by their paths."""
    baselines = {
        "baseline_tuned": BaselinePlanner(TUNED_BASELINE[world.sim]),
        "baseline": BaselinePlanner(),
    }
    chosen = {}
    for path in (*policies, *files):
        name = path.stem if chosen else "policy"
        if name in chosen | baselines:
            name = path.as_posix()
        name = name.encode(errors="replace").decode()  # not every file's name is UTF-8
        print(f"{name}: {path}")
        chosen[name] = load_planner(path) if path in files else policy_planner(path, world)
    return chosen | baselines


# ------------------------------------------------------------------------ pictures
def plot_footsteps(world, planners, trials, path):
    """Draws the paper's Fig. 3: walks to the same goals with the last planner that you chose, and
    with both baselines."""
    figure = Figure(figsize=(9, 4.2))
    axes = figure.subplots(1, 3, sharex=True, sharey=True)
    for panel, (name, planner) in zip(axes, [*planners.items()][-3:]):
        draw_walks(panel, world, planner, trials)
        panel.set(title=name, aspect="equal", xlabel="x [m]", ylabel="y [m]")
        panel.margins(0.1, 0.35)
    figure.suptitle("Two walks without noise; a goal's tip is its yaw; black: the torso's path")
    robot_model.save_figure(figure, path)


def foot_poses(robot, torso, joints):
    """Where the ankles are on the floor, and where the toes point: [K, 2, 3] x, y [m], yaw [rad];
    torso [K, 6], joints [K, 12]."""
    origins, turns = robot_model.link_frames(robot, torso, joints)
    toes = turns[:, [4, 8]][..., 0]  # [K, 2, 3] the x axes of the feet
    yaw = np.arctan2(toes[..., 1], toes[..., 0])  # [K, 2]
    return np.dstack([origins[:, [4, 8], :2], yaw])


def draw_walks(panel, world, planner, trials):
    """Draws walks from above, with the footprints of each double step, and how they end."""
    feet = [[] for _ in trials.goals]  # of every robot, [K, 2, 3]

    def watch(robots, motion):
        landed = foot_poses(world.engine.robot, motion.torso[:, -1], motion.joints[:, -1])
        for i, torso, poses in zip(robots, motion.torso, landed):
            panel.plot(*torso[:, :2].T, "k")
            feet[i].append(poses)

    end = evaluate(planner, world, trials, watch)
    for i, (x, y, yaw) in enumerate(trials.goals):
        env.draw_way(panel, world, [x, y, yaw], feet[i], robot_model.camera_at(-90, 90))
        ending = f"{end['outcome'][i]}\n{end['time'][i]:.1f} s"  # on the far side of the goal
        panel.text(x, y + math.copysign(0.45, y), ending, ha="center", va="center")


# ------------------------------------------------------------------------ command line
def arguments(argv, doc=__doc__):
    """The flags of the command line; the head of this file explains those without a help."""
    parser = robot_model.stage_parser(doc)
    add = parser.add_argument
    several = {"type": Path, "nargs": "+", "default": []}
    add("--noise", action="store_true")
    add("--far", action="store_true")
    add("--episodes", type=int, default=500, help="Walk to so many goals (default 500).")
    add("--push", type=float)
    add("--friction", type=float)
    add("--policy", **several)
    add("--planner", **several)
    add("--robot", type=Path)
    add("--jobs", type=int)
    args = parser.parse_args(argv)
    if args.jobs is None:  # MuJoCo has threads; other processes import this script again
        script = __name__ == "__main__" and "__file__" in globals()
        args.jobs = robot_model.CORES if script and args.sim == "pymunk" else 1
    sizes = args.push or 0, args.friction or 0
    if min(args.episodes, args.jobs) < 1 or not all(0 <= size < 1e3 for size in sizes):
        parser.error("--episodes and --jobs from 1 on, --push and --friction from 0 on")
    places = "runs", "results", Path(robot_model.__file__).with_name("results")
    files = [Path(folder, args.sim, "policy.pt") for folder in places]
    args.policy = args.policy or [next(filter(Path.is_file, files), files[1])]
    return args


def main(argv=None):
    args = arguments(argv)
    settings = world_settings(args)
    world = env.FootstepWorld(len(FIGURE_GOALS), **settings)  # for the figure
    planners = choose_planners(world, args.policy, args.planner)
    out = robot_model.output_folder(args)
    blocks = {env.Task.goal_std_m: draw_trials(args.seed, args.episodes)}
    if args.far:
        blocks[env.Task.far_std_m] = draw_trials(args.seed, args.episodes, far=True)
    results = evaluate_all(args, blocks, planners, settings)
    rows = [summary(*row, walks) for row, walks in results.items()]
    ratios = compare(results)
    flags = [
        f"--{name} {value}"
        for name, value in vars(args).items()
        if name in ("push", "friction", "robot") and value is not None
    ]
    text = table(rows, ratios, " ".join(flags))
    print(f"\n{text}")  # before files are written, which may fail
    content = json.dumps(vars(args) | {"rows": rows, "ratios": ratios}, default=str)
    content = json.loads(content, parse_constant=lambda nan: None)  # JSON knows no nan
    robot_model.write_text(out / "evaluation.json", json.dumps(content, indent=1) + "\n")
    robot_model.write_text(out / "table.md", text)
    write_trials(out / "trials.csv", blocks, results)
    plot_footsteps(world, planners, Trials(FIGURE_GOALS, args.seed), out / "footsteps.png")
    print(
        f"Two walks: footsteps.png, in {out}. To see one: python tests/studies/play.py{' --mujoco' * (args.sim == 'mujoco')}"
    )


if __name__ == "__main__":
    robot_model.run_script(main)
