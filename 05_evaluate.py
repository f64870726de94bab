"""Stage 5: is the learned policy better than other planners, and how sure are we?

Paper: section III, 500 goals with and without measurement noise (Table II, Fig. 3). Its baseline
[10], by its public code, is a velocity controller: proportional to the distance, up to a limit.

    python 05_evaluate.py --noise          the paper's table and figure, with our robot: a minute
    python 05_evaluate.py --noise --far    also 500 goals twice as far, in a block of their own
    python 05_evaluate.py --friction 0.4   the same floor for all, instead of a random one
    python 05_evaluate.py --push 0.4       pushes by 0.4 m/s, every 3 s on average
    python 05_evaluate.py --planner my.py  your own planner beside the others (several, if you like)
    python 05_evaluate.py --robot my.py    another robot: ROBOT, WALK, LIMITS of your file
    python 05_evaluate.py --play           click a goal, push the robot
    python 05_evaluate.py --jobs 1         one process, for pdb and cProfile (default in 3-D)
    python 05_evaluate.py --mujoco         all of this in 3-D

The stage evaluates your own policy, in `runs/<sim>/`, or else the shipped one in `results/<sim>/`;
`--policy` names other files. A policy trained with another walk, task or robot is evaluated, too,
and a note says what differs. The stage prints tables. Their times are those of the walks that
succeed: the mean, the median, and the 95th percentile. In the paper a walk succeeds when the robot
is at the goal once. Here two double steps in a row must end there, and we count the time to the end
of the first of them. The stage writes table.md, evaluation.json, trials.csv and footsteps.png, with
walks to two goals without noise, to `runs/<sim>/`. Predict: with the paper's policy the robot takes
55 % of the baseline's time, and falls about twice as often. Is this so with our policy?

A planner is a class with `reset(num_robots)`, called before the trials of a row, and `act(view)`,
which returns actions [n, 6] in [0, 1]. `view` is the `View` of stage 3 for n robots: `view.goal`
[n, 3] is the goal as the robots know it, x, y [m], yaw [rad]. With noise it is estimated from all
measurements so far. A planner may use nothing but the view. `tests/studies/search.py` is a worked
example. All planners meet the same goals, floors, bodies and pushes, and at their k-th decision the
same noise (common random numbers). So no row has easier goals. `baseline` is the team's controller,
[10], with which the paper compares, but ours decides once per double step. `baseline_tuned` has
settings optimised for this world. It also divides sidesteps and turns between both feet, turns in
proportion to the feet's limits.

How sure are we? The true rate p is the rate in infinitely many walks, or trials. In n walks we
count the rate p̂. A 95 % interval contains all p that do not contradict p̂, |p̂ − p| ≤ 1.96·√(p·(1
− p)/n). Of 100 such intervals about 95 contain the truth. Whether two planners differ is another
question, and their two intervals do not answer it. The planners met the same trials, so we compare
trial by trial: falls with `mcnemar`, times with `bootstrap`. A far walk has the floor, the body and
the noise of a near one, and a goal twice as far. So 500 near and 500 far walks are 500 pairs, not
1,000 independent walks. Seed 0 is for trying things. Test your final choice with another `--seed`.

Read down to the line of equals signs: trials and statistics. Below it are the baseline, the rows of
the table, the tables, files, pictures, and the window to play with.

Leaves out: standing up after a fall, obstacles, the spread over training seeds.
[10] Hamburg Bit-Bots, bitbots_main, https://github.com/bit-bots/bitbots_main, as of 2024-10-02.
"""

import csv
import io
import itertools
import json
import math
import multiprocessing
import runpy
import signal
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

import matplotlib.pyplot as plt  # only for the window
import numpy as np
from tqdm import tqdm

robot_model = import_module("01_robot_model")
env = import_module("03_env")
ppo = import_module("04_ppo")
InputError = robot_model.InputError
OUTCOMES = ("success", "timeout", "fall")
FIGURE_GOALS = [[0.9, 0.5, 1.6], [-0.7, -0.6, -2.6]]  # x, y [m], yaw [rad]; our choice


# ------------------------------------------------------------------------ trials
@dataclass
class Trials:
    """Where n robots should go, and what their random floors, bodies and noise depend on."""

    goals: np.ndarray  # [n, 3] x, y [m], yaw [rad]
    seed: int  # of the random stream; trial i is number i in it
    purpose: str = "evaluation"  # a name in `STREAMS` of stage 3


def draw_trials(seed, count, far=False, purpose="evaluation"):
    """The trials 0, 1, …; a far trial is the near one of its number with the goal twice as far."""
    goals = env.draw_goals(env.stream(purpose, seed), count, far=far)
    return Trials(goals, seed, purpose)


def evaluate(planner, world, trials, watch=None):
    """Lets robot i walk to the goal of trial i, all at the same time, until each trial has ended.
    watch(robots, motion) is called after every double step. Returns arrays [n]:
        mu           of the floor
        outcome      a name in OUTCOMES
        time         [s] to the end of the first double step in a row at the goal; else all of it
        steps        double steps, all of them
        still_there  a success, and at the goal also after two more double steps in place"""
    n = len(trials.goals)
    everybody = np.arange(n)
    # One generator per trial: its numbers depend neither on the planner nor on other trials.
    rngs = [env.stream(trials.purpose, trials.seed, i) for i in range(n)]
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
    steps = world.steps[everybody]  # a copy, for two more double steps follow
    still_there = np.zeros(n, bool)
    standing = everybody[outcome == "success"]
    for _ in range(2):  # two more double steps, in place; what counts is where the second one ends
        if len(standing):
            result = world.step([world.neutral_action] * len(standing), standing)
            still_there[standing] = result["inside"]
            standing = standing[~result["fall"]]
    return {
        "mu": world.simulator.body.friction[everybody],
        "outcome": outcome,
        "time": time.round(12),
        "steps": steps,
        "still_there": still_there,
    }


def double_step(planner, world, robots, push=(0, 0)):
    """Looks, decides, walks: returns what `FootstepWorld.step` does, see there for `push`.
    Raises a ValueError that names the planner's file if its actions are not [n, 6] in [0, 1]."""
    name = f"{type(planner).__module__}: actions"  # the module of your own is its file
    actions = env.checked(name, planner.act(world.view(robots)), len(robots), 6)
    if actions.min() < 0 or actions.max() > 1:
        raise ValueError(f"{name} must lie between 0 and 1, not {actions}")
    return world.step(actions, robots, push)


# ------------------------------------------------------------------------ statistics
def wilson(count, total, z=1.96):
    """95 % interval [low, high] of a rate: `count` of `total` trials (Wilson score; it has a width
    also at 0)."""
    # (p̂ + z²/(2n) ± z·√(p̂·(1 − p̂)/n + z²/(4n²))) / (1 + z²/n)
    p, shrink = count / total, 1 + z**2 / total
    centre = p + z**2 / (2 * total)
    margin = z * math.sqrt(p * (1 - p) / total + z**2 / (4 * total**2))
    return [max(0.0, (centre - margin) / shrink), min(1.0, (centre + margin) / shrink)]


def bootstrap(statistic, *samples, resamples=2000):
    """95 % interval of a statistic of samples [n], by resampling: many times n of the n walks are
    chosen at random, with replacement. (Stage 4's bootstrapping is something else.)

    statistic: gets these choices from each of the samples, arrays [resamples, n], and returns
    [resamples] numbers."""
    count = len(samples[0])
    pick = np.random.default_rng(0).integers(count, size=(resamples, count))  # [resamples, n]
    return np.percentile(statistic(*(sample[pick] for sample in samples)), [2.5, 97.5])


def time_ratio(trials, reference):
    """Compares the times of two planners over the goals that both reached; returns a dict:
    goals                         how many these are; the dict is empty if there is none
    time_ratio, time_ratio_ci95   mean time / mean time of the reference, its interval (covers
                                  the truth in 95 %, with 20 goals in 92 %; below 20 nan)
    faster, slower                shares of the goals reached sooner, later than by the reference"""
    both = (trials["outcome"] == "success") & (reference["outcome"] == "success")
    if not both.any():
        return {}
    ours, theirs = trials["time"][both], reference["time"][both]
    interval = np.full(2, np.nan)
    if len(ours) >= 20:  # in pairs: both take long to a distant goal; this cancels in the ratio
        interval = bootstrap(lambda a, b: a.mean(1) / b.mean(1), ours, theirs)
    return {
        "goals": len(ours),
        "time_ratio": ours.mean() / theirs.mean(),
        "time_ratio_ci95": [*interval],
        "faster": np.mean(ours < theirs),
        "slower": np.mean(ours > theirs),
    }


def mcnemar(ours, theirs):
    """Compares two planners in the same trials by McNemar's exact test; ours, theirs: bool [n], did
    it happen in a trial (a fall)? Returns a dict:

    only_ours, only_theirs   trials in which it happened with one of them alone
    p                        how often chance would divide these between equals at least as unevenly
                             (of twenty p between equals at most one is below 0.05, on average)"""
    one, other = int((ours & ~theirs).sum()), int((theirs & ~ours).sum())
    # Between equals each of these trials is a toss of a coin: P(at most k of n) = Σ C(n, i) / 2ⁿ
    n, k = one + other, min(one, other)
    p = 2 * sum(math.comb(n, i) for i in range(k + 1)) / 2**n  # 2: either may have fewer
    return {"only_ours": one, "only_theirs": other, "p": min(1.0, p)}


# ==================================================================== the end of a first reading
# ------------------------------------------------------------------------ two planners
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
    share: bool = False  # do both feet share a sideways distance, and a turn by their limits? Ours


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
    leading = np.multiply(lead, way)  # of the leading foot
    left = np.where(way > 0, leading, way - leading)
    right = np.where(way > 0, way - leading, leading)
    mirrored = -right
    return np.stack([np.column_stack([forward, side]) for side in (left, mirrored)], 1)


class BaselinePlanner:
    """The controller of [10]; it decides once per double step instead of 20 times a second."""

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
            span = np.subtract(view.limits.high, view.limits.low)  # [3]
            lead = (view.limits.high / np.maximum(span, 1e-9))[1:]
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
def make_world(args, count, **settings):
    """A world as the command line asks for: with the robot of a file of your own, and with the same
    floor for all."""
    settings["robot"] = robot_model.ROBOT
    if args.robot:
        settings["robot"], settings["walk"], settings["limits"] = names_in(
            args.robot,
            ROBOT=robot_model.RobotModel,
            WALK=env.walk_engine.WalkParameters,
            LIMITS=env.StepLimits,
        )
    if args.friction is not None:
        settings["robot"] = replace(settings["robot"], friction=args.friction)
        settings["spread"] = env.Spread(friction=0.0)
    return env.FootstepWorld(count, args.sim, **settings)


def walk_row(args, planner, trials, noise):
    """What `evaluate` returns, in a world as the command line asks for."""
    world = make_world(args, len(trials.goals), push=args.push or 0, noise=noise)
    return evaluate(planner, world, trials)


def evaluate_all(args, blocks, planners):
    """Evaluates every planner in every block of Trials; with --noise a second time with noise.
    Returns what `evaluate` does, by row: (planner's name, noise, σ). blocks: Trials by the σ of
    their goals [m]. With several jobs other processes walk, but not for a user's planner."""
    jobs = {  # by row in the order of the table
        (name, noise, std): (args, planner, trials, noise)
        for std, trials in blocks.items()
        for noise in sorted({False, args.noise})
        for name, planner in planners.items()
    }
    futures = {}
    if args.jobs > 1:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # inherited: Ctrl-C is for us
        pool = ProcessPoolExecutor(args.jobs, multiprocessing.get_context("spawn"))
        for row, job in reversed(jobs.items()):  # the baseline takes longest
            if type(job[1]) in (PolicyPlanner, BaselinePlanner):
                futures[row] = pool.submit(walk_row, *job)
        signal.signal(signal.SIGINT, before)
    try:
        with tqdm(jobs.items(), leave=False) as bar:  # it ends before Ctrl-C says its line
            return {
                row: futures[row].result() if row in futures else walk_row(*job) for row, job in bar
            }
    finally:
        if futures:  # all is done, or must stop
            for process in multiprocessing.active_children():
                process.kill()


# ------------------------------------------------------------------------ tables
def compare(results):
    """Compares the policy with every other planner, see `time_ratio`, `mcnemar`; trials by
    (planner, noise, σ of the goals)."""
    rows = []
    for (name, noise, std), trials in results.items():
        ours = results["policy", noise, std]
        ratio = time_ratio(ours, trials)
        if name != "policy" and ratio:
            row = {"reference": name, "noise": noise, "goal_std_m": std}
            row |= mcnemar(ours["outcome"] == "fall", trials["outcome"] == "fall")
            rows.append(row | ratio)
    return rows


def summary(planner, noise, std, trials):
    """One row of the table; std: σ of the goals' x and y [m]. nan: there was nothing to measure."""
    outcome = trials["outcome"]
    row = {"planner": planner, "noise": noise, "goal_std_m": std, "episodes": len(outcome)}
    for name in OUTCOMES:
        count = int((outcome == name).sum())
        row |= {name: count / len(outcome), f"{name}_ci95": wilson(count, len(outcome))}
    reached = outcome == "success"
    times, still = trials["time"][reached], trials["still_there"][reached]
    if not reached.any():
        times = still = np.array([np.nan])
    return row | {
        "still_there": still.mean(),  # of the successes
        "time_mean": times.mean(),
        "time_std": times.std(),
        "time_median": np.median(times),
        "time_p95": np.quantile(times, 0.95),
    }


NOTE = """\
The paper tells neither its σ nor its noise; there, it seems, one double step at the goal suffices.
Our σ of 0.5 m was chosen so that `baseline` takes about the paper's time: that they agree proves
nothing.
"""
HEAD = """
Goals: {}; noise: {}

| planner         | success [95 %]       | timeout | fall  | mean, median, 95th [s] | still there |
| ---             | ---                  | ---     | ---   | ---                    | ---         |
"""
ROW = (
    "| {planner:15} | {success:.3f} [{low:.3f}, {high:.3f}] | {timeout:.3f}   | {fall:.3f} "
    "| {time_mean:6.2f}, {time_median:6.2f}, {time_p95:6.2f} | {still_there:.3f}       |\n"
)
PAPER = {  # Table II, without and with noise; ±: standard deviation of the times
    "no": """\
| policy, paper   | 0.980                | 0.000   | 0.020 |   6.07 ± 2.13          |             |
| baseline, paper | 0.960                | 0.032   | 0.008 |  11.13 ± 4.95          |             |
""",
    "yes": """\
| policy, paper   | 0.978                | 0.000   | 0.022 |   6.35 ± 2.23          |             |
| baseline, paper | 0.910                | 0.078   | 0.012 |  11.43 ± 5.11          |             |
""",
}
RATIO_HEAD = """
Time: mean of `policy` ÷ that of the other planner, over the goals that both reached. Falls: walks
in which the robot fell with `policy` alone, with the other planner alone.

| goals   | noise | other          | time [95 %]          | faster, slower | falls    | p     |
| ---     | ---   | ---            | ---                  | ---            | ---      | ---   |
"""
RATIO = (
    "| {0:7} | {1:5} | {reference:14} | {time_ratio:.3f} [{2:5.3f}, {3:5.3f}] "
    "| {faster:.3f}, {slower:.3f}   | {only_ours:3}, {only_theirs:3} | {p:.3f} |\n"
)


def table(rows, ratios, flags=""):
    """Tables in Markdown, 100 characters wide: our rows and the paper's, in a block for each kind
    of goals and noise; the policy's times compared with those of others. With flags, which change
    the walks, the paper's rows are left out."""
    text = f"With {flags}\n" if flags else NOTE
    for (goals, noise), block in itertools.groupby(rows, block_of):
        text += HEAD.format(goals, noise)
        for row in block:
            low, high = row["success_ci95"]
            text += ROW.format(low=low, high=high, **row)
        if row["goal_std_m"] == env.Task.goal_std_m and not flags:
            text += PAPER[noise]
    if ratios:
        text += RATIO_HEAD
    for row in ratios:
        text += RATIO.format(*block_of(row), *row["time_ratio_ci95"], **row)
    return text


def block_of(row):
    """Two texts: which goals, and whether they are measured with noise."""
    return f"σ {row['goal_std_m']} m", "yes" if row["noise"] else "no"


# ------------------------------------------------------------------------ files
def write_trials(path, blocks, results):
    """Writes a line for each trial; blocks: Trials by σ, results by (planner, noise, σ)."""
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    head = "planner noise goal_std_m seed trial x y yaw mu outcome time steps still_there"
    lines.writerow(head.split())
    yes = {True: "yes", False: "no"}
    for (planner, noise, std), ended in results.items():
        trials = blocks[std]
        for i, goal in enumerate(trials.goals):
            *walk, still = (values[i] for values in ended.values())
            lines.writerow([planner, yes[noise], std, trials.seed, i, *goal, *walk, yes[still]])
    robot_model.write_text(path, text.getvalue())


def load_policy(path, world):
    """The planner of a policy.pt. Prints what differs from its training. Raises an InputError if it
    cannot work in this world."""
    model, about = ppo.load_policy(path)
    fits, here = about.get("fits", {}), ppo.fingerprint(world)
    other = [name for name in here if fits.get(name) != here[name]]
    if {"simulator", "observation"} & {*other}:
        raise InputError(
            f"{path}: trained in {fits.get('simulator')}, this is {world.sim} (--mujoco: mujoco); "
            "or with another observation: train it again"
        )
    if other:
        print(f"note: {path.as_posix()} was trained with another {', '.join(other)}")
    return PolicyPlanner(model)


def names_in(path, **wanted):
    """What a file of your own defines: its values of these names, which must have these types.
    Errors in the file show their own traceback."""
    if path.suffix != ".py" or not path.is_file():
        raise InputError(f"{path}: no such .py file (--policy takes a policy.pt)")
    sys.path.append(str(path.resolve().parent))  # last: it may import what lies beside it
    names = runpy.run_path(str(path), run_name=path.as_posix())
    for name, kind in wanted.items():
        if not isinstance(names.get(name), kind):
            raise InputError(
                f"{path}: needs a {name} that is a {'class' if kind is type else kind.__name__}"
            )
    return [names[name] for name in wanted]


def load_planner(path):
    """The planner in a file of your own."""
    return names_in(path, Planner=type)[0]()


def choose_planners(world, policies, files=()):
    """Planners by row name for these files of policies and of planners, and the name of the one to
    show. The first policy is `policy`; the others are named by their files, or by their paths."""
    baselines = {
        "baseline_tuned": BaselinePlanner(TUNED_BASELINE[world.sim]),
        "baseline": BaselinePlanner(),
    }
    chosen, shown = {}, "policy"
    for path in (*policies, *files):
        name = path.stem if chosen else "policy"
        if name in chosen | baselines:
            name = path.as_posix()
        print(f"{name}: {path}")
        if path in files:
            chosen[name] = load_planner(path)
            shown = name if shown == "policy" else shown  # the first one
        else:
            chosen[name] = load_policy(path, world)
    return chosen | baselines, shown


# ------------------------------------------------------------------------ pictures
def plot_footsteps(world, planners, trials, path):
    """Draws the paper's Fig. 3: walks to the same goals; planners by name (three)."""
    figure = robot_model.Figure(figsize=(9, 4.2))
    axes = figure.subplots(1, 3, sharex=True, sharey=True)
    for panel, (name, planner) in zip(axes, planners.items()):
        draw_walks(panel, world, planner, trials)
        panel.set_title(name, parse_math=False)  # a $ in a name is no formula
        panel.set(aspect="equal", xlabel="x [m]")
        panel.margins(0.1, 0.35)
    axes[0].set_ylabel("y [m]")
    figure.suptitle("Two walks without noise; a goal's tip is its yaw; black: the torso's path")
    robot_model.save_figure(figure, path)


def foot_poses(robot, torso, joints):
    """Where the ankles are on the floor, and where the toes point: [K, 2, 3] x, y [m], yaw [rad];
    torso [K, 6], joints [K, 12]."""
    frames = robot_model.body_frames(robot, torso, joints)
    points, turns = (frame[:, [4, 8]] for frame in frames)  # of the feet  [K, 2, 3, …]
    yaw = np.arctan2(turns[..., 1, 0], turns[..., 0, 0])  # [K, 2]
    return np.dstack([points[..., :2], yaw])


def draw_walks(panel, world, planner, trials):
    """Draws walks from above while the robots walk, and at each goal how the walk to it ends. Of
    many footprints every second pair is drawn, or every third, …, and the last one."""
    standing = foot_poses(world.engine.robot, *(part[None] for part in world.engine.stance))
    feet = [[*standing] for _ in trials.goals]  # [K, 2, 3] of every robot

    def watch(robots, motion):
        landed = foot_poses(world.engine.robot, motion.torso[:, -1], motion.joints[:, -1])
        for i, torso, poses in zip(robots, motion.torso, landed):
            panel.plot(*torso[:, :2].T, "k", lw=1)
            feet[i].append(poses)

    end = evaluate(planner, world, trials, watch)
    for i, (x, y, yaw) in enumerate(trials.goals):
        few = feet[i][:: -1 - len(feet[i]) // 12]
        env.draw_way(panel, world, [x, y, yaw], few, robot_model.camera_at(-90, 90))
        ending = f"{end['outcome'][i]}\n{end['time'][i]:.1f} s"  # on the far side of the goal
        panel.text(x, y + math.copysign(0.45, y), ending, size=13, ha="center", va="center")


def pictures(axes, world, planner, feet, push, name, window):
    """Lets the first robot do a double step, and draws it. Yields the result of `double_step` after
    every picture, one for eight ticks. Yellow: the footsteps that were chosen, from where the right
    foot stood. feet: a list of earlier ones [2, 3]; those at the beginning are added. push [2]: see
    `FootstepWorld.step`. (The planar robot's left foot lands to the right of its mark: it cannot
    spread its legs.)"""
    engine, began = world.engine, world.ticks[0]
    result = double_step(planner, world, np.array([0]), push)
    motion = result["motion"]
    torso, joints = motion.torso[0], motion.joints[0]  # [T, 6], [T, 12]
    feet += [*foot_poses(engine.robot, torso[:1], joints[:1])]
    steps = env.to_footsteps(world.last_action[:1], world.limits)
    chosen = np.stack(engine.landings(feet[-1][None, robot_model.RIGHT], steps), 1)  # [1, 2, 3]
    for tick in range(0, motion.ticks[0], 8):
        now, goal = torso[tick], world.goal[0]
        camera = env.draw_scene(axes, world, goal, feet[-20:], now, joints[tick], chosen)
        if any(push):  # it lasts for 5 ticks, which nobody would see
            tip = now[:3] + [0, 0, 0.15]
            tail = tip - [*robot_model.turned(push, now[5] * engine.planar), 0]  # 1 m is 1 m/s
            style = {"color": "tab:red", "arrowprops": {"color": "tab:red"}, "ha": "center"}
            text = f"push: {math.hypot(*push):.1f} m/s"
            axes.annotate(text, camera[1:] @ tip, camera[1:] @ tail, **style)
        seconds = (began + tick) * engine.robot.control_dt
        axes.set_title(f"{name}, {seconds:.1f} s", parse_math=False)
        axes.axis(window)
        yield result


def open_window():
    """An empty figure on the screen, and its axes."""
    plt.rcParams["toolbar"] = "None"  # every picture sets its own axes, so nobody can zoom
    figure, axes = plt.subplots(num="Click a goal, and the robot walks there", figsize=(9, 7))
    if plt.get_backend() == "agg":  # which Matplotlib takes where it can open no window
        raise InputError("--play needs a display, and Tk or Qt (pip install pyqt6)")
    return figure, axes


def play(world, name, planner, push):
    """Lets a robot walk to where the mouse is pressed, until the window closes. Dragging gives the
    goal's heading; space is a push [2]. After a fall the robot stands at the origin again."""
    figure, axes = open_window()
    figure.supxlabel("click: a goal; drag: its heading; space: a push")
    keys, pressed, feet = [], np.zeros(2), []  # pressed: where the mouse was, x, y [m]

    def ground(event):
        """The place on the floor, x, y [m], to which the mouse points; nan: beside the picture."""
        place = [event.xdata, event.ydata] if event.inaxes else [np.nan, np.nan]
        return np.linalg.solve(robot_model.camera_at()[1:, :2], place)

    def press(event):
        pressed[:] = ground(event)

    def release(event):
        x, y = ground(event) - pressed
        if np.isfinite(x):
            world.set_goal([0], [*pressed, math.atan2(y, x)])

    figure.canvas.mpl_connect("button_press_event", press)
    figure.canvas.mpl_connect("button_release_event", release)
    figure.canvas.mpl_connect("key_press_event", lambda event: keys.append(event.key))
    world.goal[0], fell = FIGURE_GOALS[0], True
    while plt.fignum_exists(figure.number):
        if fell:
            world.reset([0], goals=world.goal[:1])
            planner.reset(1)
            feet.clear()
        pushed = push if " " in keys else (0, 0)
        keys.clear()
        for result in pictures(axes, world, planner, feet, pushed, name, (-1.7, 1.7, -1, 1.6)):
            plt.pause(0.04)  # half of the 0.08 s of eight ticks; to draw takes about the other half
            fell = result["fall"][0]


# ------------------------------------------------------------------------ command line
def arguments(argv):
    """The flags of the command line. Those without a help are told in the head of this file."""
    parser = robot_model.stage_parser(__doc__)
    add = parser.add_argument
    files = {"type": Path, "nargs": "+", "default": []}
    add("--noise", action="store_true")
    add("--far", action="store_true")
    add("--episodes", type=int, default=500, help="Walk to so many goals (default 500).")
    add("--friction", type=float)
    add("--push", type=float)
    add("--policy", **files)
    add("--planner", **files)
    add("--robot", type=Path)
    add("--play", action="store_true")
    add("--jobs", type=int)
    args = parser.parse_args(argv)
    if args.jobs is None:  # MuJoCo has threads; other processes import this script again
        script = __name__ == "__main__" and "__file__" in globals()
        args.jobs = robot_model.CORES if script and args.sim == "pymunk" else 1
    if min(args.episodes, args.jobs) < 1 or not all(
        0 <= size < 1e3 for size in (args.push or 0, args.friction or 0)
    ):
        parser.error("--episodes and --jobs from 1 on, --push and --friction from 0 on")
    places = "runs", "results", Path(robot_model.__file__).with_name("results")
    files = [Path(folder, args.sim, "policy.pt") for folder in places]
    args.policy = args.policy or [next(filter(Path.is_file, files), files[1])]
    return args


def write_results(args, blocks, results, out):
    """Prints the tables, and writes table.md, evaluation.json and trials.csv."""
    rows = [summary(*key, trials) for key, trials in results.items()]
    ratios = compare(results)
    others = "push", "friction", "robot"
    flags = [
        f"--{name} {getattr(args, name)}" for name in others if getattr(args, name) is not None
    ]
    text = table(rows, ratios, " ".join(flags))
    print(f"\n{text}")  # before files are written, which may fail
    content = json.dumps(vars(args) | {"rows": rows, "ratios": ratios}, default=str)
    content = json.loads(content, parse_constant=lambda nan: None)  # JSON knows no nan
    robot_model.write_text(out / "evaluation.json", json.dumps(content, indent=1) + "\n")
    robot_model.write_text(out / "table.md", text)
    write_trials(out / "trials.csv", blocks, results)


def main(argv=None):
    args = arguments(argv)
    try:
        run(args)
    except SystemExit as error:
        files = filter(None, [*args.planner, args.robot])
        raise InputError(
            f"{', '.join(map(str, files))}: ends Python, by exit() or main()"
        ) from error


def run(args):
    """Does what the command line asks for."""
    world = make_world(args, len(FIGURE_GOALS))  # for pictures
    planners, shown = choose_planners(world, args.policy, args.planner)
    out = robot_model.output_folder(args)
    if args.play:
        play(world, shown, planners[shown], (args.push or 0.6, 0))
        return
    blocks = {env.Task.goal_std_m: draw_trials(args.seed, args.episodes)}
    if args.far:
        blocks[env.Task.far_std_m] = draw_trials(args.seed, args.episodes, far=True)
    results = evaluate_all(args, blocks, planners)
    write_results(args, blocks, results, out)
    trio = {name: planners[name] for name in ("baseline", "baseline_tuned", shown)}
    trials = Trials(np.array(FIGURE_GOALS), args.seed)
    plot_footsteps(world, trio, trials, out / "footsteps.png")
    print("Look at footsteps.png; evaluation.json, trials.csv and table.md are beside it, in", out)


if __name__ == "__main__":
    robot_model.start(main)
