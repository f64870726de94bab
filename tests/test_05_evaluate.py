"""Stage 5: the baseline's equations, the statistics, the trials, planners, files, command line."""

import argparse
import itertools
import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
import torch
from checks import BOTH, close, equal, frozen, locked
from matplotlib.figure import Figure
from numpy.random import default_rng
from test_03_env import motion

evaluate = import_module("05_evaluate")
env, ppo, robot_model = evaluate.env, evaluate.ppo, evaluate.robot_model
LIMITS = env.LIMITS["pymunk"]
SIZES = len(env.OBSERVATION), len(env.ACTION_NAMES)  # of a policy
B = evaluate.BaselineSettings()
OTHER = evaluate.BaselineSettings(0.3, 0.1, 0.2, 0.8, gain=0.5, turning_gain=2.0, far_m=0.4)
# By hand and not by the stages, which may be empty exercises when this module is imported:
ROBOT, WALK = robot_model.RobotModel(), env.walk_engine.TUNED["pymunk"]
PERIOD = 2 * ROBOT.control_dt * WALK.step_ticks  # [s] a double step


def view(goal, robots=(0,), **known):
    """A View of these goals [n, 3]; what is not known is None."""
    blank = dict.fromkeys(env.View.__dataclass_fields__) | {"period": PERIOD, "limits": LIMITS}
    return env.View(**blank | {"goal": np.array(goal), "robots": np.array(robots)} | known)


def command(x, y, yaw=0.0, settings=B):
    found = evaluate.velocity_command(np.broadcast_to([x, y, yaw + 0.0], (1, 3)), settings)
    assert np.shape(found) == (1, 3), "goals [n, 3] -> a row v_x, v_y, ω for each goal, [n, 3]"
    return found[0]


def test_speed_far_away_is_on_the_edge_of_the_diamond():
    for settings, beta in itertools.product((B, OTHER), np.linspace(-np.pi, np.pi, 50)):
        v_x, v_y, _ = command(5 * math.cos(beta), 5 * math.sin(beta), settings=settings)
        x_max = settings.forward if v_x > 0 else settings.backward
        close(
            abs(v_x) / x_max + abs(v_y) / settings.sideways,
            1,
            "|v_x| / x_max + |v_y| / y_max = 1: above 1 each axis is limited on its own (a box) or "
            "the limit is round (an ellipse); between the axes it is a straight line. Is backward "
            "taken for forward? Every limit comes from `settings`, not from the default",
            atol=1e-6,
        )
        turned_by = env.wrap(math.atan2(v_y, v_x) - beta)
        close(turned_by, 0, "limiting must not change the direction", atol=1e-6)


def test_speed_near_the_goal_is_gain_times_distance():
    hint = "v = min(gain·d, v_max): inside the limits the gain decides (for a goal at 3.6 cm)"
    close(command(0.03, -0.02)[:2], (0.03, -0.02), hint, atol=1e-6)
    close(command(0, 0), 0, "at the goal there is nothing to do")


def test_far_away_it_faces_the_goal_and_nearby_it_turns_like_the_goal():
    for goal, want, hint in (
        ((0, 1.01, 0.2), 0.3, "far: 0.3·β, limited; left: positive"),
        ((1.01, 0, 0.5), 0, "far: the goal is straight ahead"),
        ((1.01, -0.1, 0.5), -0.3 * math.atan2(0.1, 1.01), "far: 0.3·β"),
        ((0, 0.99, 0.5), 0.15, "near: turn to α = 0.5 rad, gain 0.3"),
        ((0.1, 0, 3), 0.3, "near: limited to 0.3 rad/s"),
        ((0.1, 0, -3), -0.3, "the limit holds to both sides"),
        ((0.1, 0, math.radians(350)), math.radians(-3), "350° to the left are 10° to the right"),
    ):
        close(command(*goal)[2], want, hint)


def test_speed_and_turning_follow_the_settings_robot_by_robot():
    goals = np.array([[0, 5, 0], [0.3, 0, 0.2], [0.5, 0, 0.2]])
    found = evaluate.velocity_command(goals, OTHER)
    hint = (
        "row 0: far, to the left; row 1: near, so ω = 2·α; row 2: far, which begins at 0.4 m. "
        "Every limit and gain comes from `settings`, not from the default. Gains come before limits: "
        "v = min(gain·d, v_max). Robots must not influence one another"
    )
    close(found, [[0, 0.2, 0.8], [0.15, 0, 0.4], [0.25, 0, 0]], hint)


def test_the_filter_is_solved_exactly():
    slow, fast = [0.02, 0, 0.1], [0.12, 0.2, 0.1]
    velocity, command = np.array([slow, fast]), np.array([fast, slow])  # one of them brakes
    frozen(velocity, command)
    found = evaluate.low_pass(velocity, command, 0.6, 1.5)
    left = np.array([0.1, 0.2, 0]) * math.exp(-0.4)
    hint = "v ← v + (1 − exp(−t/τ))·(v_cmd − v): is every sign right, and t above τ?"
    if np.allclose(found, velocity + 0.4 * (command - velocity)):
        hint = (
            "t/τ is a step by Euler's method, the exact share is 1 − exp(−t/τ): two half steps must "
            "equal a whole one"
        )
    close(found, command - [left, -left], hint)
    close(evaluate.low_pass(velocity, command, 0.6, 0), command, "τ = 0: no filter, v is v_cmd")


def test_velocities_become_mirrored_footsteps():
    ahead = "forward: half the period's distance per single step, so both feet share it"
    aside = (
        "sideways: one foot takes it all, the left one to the left and the right one to the "
        "right, and outward is positive for both; the other one follows with 0"
    )
    turn = (
        "turn: either foot takes its share, a half by default; outward is positive for both "
        "feet: y and yaw of the right foot are mirrored"
    )
    table = [  # velocity, footsteps of the left and of the right foot in half a second
        ([0.12, 0, 0], [[0.03, 0, 0], [0.03, 0, 0]], ahead),
        ([0, 0.06, 0], [[0, 0.03, 0], [0, 0, 0]], aside),
        ([0, -0.06, 0], [[0, 0, 0], [0, 0.03, 0]], aside),
        ([0, 0, 0.2], [[0, 0, 0.05], [0, 0, -0.05]], turn),
    ]
    velocities = np.array([velocity for velocity, *_ in table])
    frozen(velocities)
    found = evaluate.velocity_to_footsteps(velocities, period=0.5)
    assert np.shape(found) == (4, 2, 3), "velocities [n, 3] -> footsteps [n, 2, 3]"
    for steps, (velocity, want, hint) in zip(found, table):
        hint += f" (for {velocity}). Robots must not influence one another"
        close(steps, want, hint, atol=1e-6)


def test_a_shared_way_is_split_in_proportion_to_the_limits():
    """Outward 0.15 m and 0.6 rad, inward 0.04 m and 0.4 rad: shares 15/19 and 6/10."""
    limits = env.StepLimits(low=(-0.1, -0.04, -0.4), high=(0.1, 0.15, 0.6))
    planner = evaluate.BaselinePlanner(
        evaluate.BaselineSettings(
            9, 9, 9, 9, turning_gain=1.0, far_m=9.0, time_constant=0.0, share=True
        )
    )
    planner.reset(2)
    goals = [[0, 0.19, 0.5], [0, -0.095, -1.0]]  # the way within a second
    actions = planner.act(view(goals, [0, 1], period=1.0, limits=limits))
    steps = env.to_footsteps(actions, limits)
    close(
        steps,
        [[[0, 0.15, 0.3], [0, -0.04, -0.2]], [[0, -0.02, -0.4], [0, 0.075, 0.6]]],
        "the leading foot takes out / (out + in) outward, the other one the rest inward",
        atol=1e-6,
    )


@pytest.mark.filterwarnings("error")
def test_where_the_limits_leave_no_choice_the_tuned_baseline_walks_straight_ahead():
    limits = env.StepLimits(low=(-0.1, 0, 0), high=(0.1, 0, 0))
    planner = evaluate.BaselinePlanner(evaluate.TUNED_BASELINE["pymunk"])
    planner.reset(1)
    actions = planner.act(view([[5.0, 1.0, 0.5]], limits=limits))
    close(env.to_footsteps(actions, limits), [[[0.1, 0, 0]] * 2], "no share divides by 0")


def test_only_the_first_command_of_a_trial_is_not_filtered():
    planner, ahead, aside = evaluate.BaselinePlanner(), [5.0, 0.0, 0.0], [0.0, 5.0, 0.0]
    period = 0.9  # [s] the view's

    def steps_to(goal, robot=1):
        told = view([goal], [robot], period=period)
        return env.to_footsteps(planner.act(told), LIMITS)[0]

    planner.reset(2)
    steps_to(ahead)
    close(planner.velocity[1], (0.12, 0, 0), "before a first command is none")
    steps_to(aside)
    share = 1 - math.exp(-period / 1.0)  # τ = 1 s
    changed = (0.12 * (1 - share), 0.07 * share, 0.3 * share)
    close(planner.velocity[1], changed, "the filter smooths changes")
    steps_to(ahead, robot=0)
    close(planner.velocity[0], (0.12, 0, 0), "robot 0 was not asked before, only robot 1")
    planner.reset(2)
    turn = 0.3 * period / 2
    want = [[0, 0.07 * period, turn], [0, 0, -turn]]
    close(steps_to(aside), want, "of another trial, not filtered; it shares turns only")


def test_wilson_interval():
    hint = (
        "Wilson: (p + z²/(2n) ± z·√(p·(1 − p)/n + z²/(4n²))) / (1 + z²/n), z = 1.96 for 95 %; a list "
        "[low, high] of rates between 0 and 1, no percents"
    )
    z = 1.96 * math.sqrt(0.98 * 0.02 / 500)
    if np.allclose(evaluate.wilson(490, 500), [0.98 - z, 0.98 + z]):
        hint = f"this is Wald's interval, which has no width at 0 of 100. {hint}"
    close(evaluate.wilson(5, 10), [0.2366, 0.7634], hint, atol=1e-4)
    close(evaluate.wilson(490, 500), [0.9636, 0.9891], hint, atol=1e-4)
    close(evaluate.wilson(5, 10, 1.0)[0], 0.3492, "z is an argument", atol=1e-4)
    low, high = found = evaluate.wilson(500, 500)
    assert not hasattr(found, "shape"), "a list [low, high], no array: stage 5 writes it to a file"
    assert high == pytest.approx(1) and 0.99 < low < 1, "500 of 500 does not prove 100 %"
    close(evaluate.wilson(0, 500), [1 - high, 1 - low], "not symmetric")


def trials(outcomes, times, steps=None):
    """What `evaluate` returns; of the successes all but the second robot are still there. A double
    step lasts a second, unless `steps` says how many there are."""
    outcome = np.array(outcomes)
    still = (outcome == "success") & (np.arange(len(outcome)) != 1)
    steps = np.array(times if steps is None else steps)
    return {
        "outcome": outcome,
        "time": np.array(times, float),
        "steps": steps,
        "still_there": still,
    }


FOUR = trials(["success", "success", "fall", "timeout"], [4, 6, 1, 100])


def row_of(*key):
    return evaluate.summary(*key, FOUR)


def test_time_ratio_uses_only_goals_that_both_reached():
    ours = trials(["success", "success", "fall", "success"], [5, 10, 1, 80])
    theirs = trials(["success", "success", "success", "timeout"], [10, 20, 60, 100])
    row = evaluate.time_ratio(ours, theirs)
    hint = "goals that both reached: a success of both, no fall, no time-out, still there or not"
    close(row["goals"], 2, hint)
    close(row["time_ratio"], 0.5, "mean time / mean time of the reference")
    far_ones = evaluate.time_ratio(
        trials(["success"] * 4, [5, 30, 40, 8]), trials(["success"] * 4, [10, 20, 40, 10])
    )
    close(far_ones["time_ratio"], 83 / 80, "a ratio of the means, not a mean of the ratios")
    close(
        [far_ones["faster"], far_ones["equal"], far_ones["slower"]],
        [0.5, 0.25, 0.25],
        "two of four take less than the reference, one takes as long, one takes more",
    )
    waited = trials(["success"] * 4, [1.21, 1.23, 1.2, 1.8], [2, 2, 2, 3])
    row = evaluate.time_ratio(waited, trials(["success"] * 4, [1.2, 1.22, 1.8, 1.2], [2, 2, 3, 2]))
    hint = "a wait of 0.01 s is no slower walk, so count double steps, not seconds"
    close([row["faster"], row["equal"], row["slower"]], [0.25, 0.5, 0.25], hint)
    none = evaluate.time_ratio(trials(["fall"], [1]), trials(["success"], [10]))
    assert none == {}, "no goal in common: an empty dict"


def test_time_ratio_has_an_interval_from_twenty_goals_on():
    times = default_rng(0).uniform(5, 30, 21)
    few = "of few goals the resamples are alike, and the interval would be too narrow: nan"
    pairs = (
        "enough for an interval. In a paired one a goal's difficulty cancels out: resample goals, "
        "not times, with one choice for both planners"
    )
    for n, end, hint in (1, np.nan, few), (19, np.nan, few), (20, 0.5, pairs):
        ended = ["success"] * n + ["fall"]
        ours, theirs = (trials(ended, own[: n + 1]) for own in (times / 2, times))
        row = evaluate.time_ratio(ours, theirs)
        close(row["time_ratio"], 0.5, "it does not need so many")
        close(row["time_ratio_ci95"], [end, end], f"{n} goals that both reached: {hint}")


def test_time_ratio_s_bootstrap_is_that_of_theory():
    sample, seen = default_rng(1).normal(3.0, 2.0, 400), []
    evaluate.bootstrap(
        lambda drawn: seen.extend(drawn) or drawn.mean(-1), sample[:10], resamples=70
    )
    hint = "`statistic` gets arrays [resamples, n]: as many as are asked for, each of n walks"
    assert np.shape(seen) == (70, 10), hint
    hint = "each of the n walks, also the first and the last, has its chance in every new resample"
    assert len(np.unique(seen)) == 10, hint
    low, high = evaluate.bootstrap(lambda drawn: drawn.mean(1), sample)
    hint = "the interval lies around the sample's mean; `np.percentile` counts from 0 to 100"
    close((low + high) / 2, sample.mean(), hint, atol=0.03)
    close(
        high - low,
        2 * 1.96 * sample.std() / 20,
        "95 % of a normal distribution are ± 1.96 σ/√n: 2.5 and 97.5 %, of as many as there are",
        rtol=0.07,
    )
    none = evaluate.bootstrap(lambda a, b: (a - b).mean(1), sample, sample)
    close(none, 0, "what belongs together is drawn together")


def test_time_ratio_s_interval_covers_the_truth():
    """90 goals with another ratio each: about 95 of 100 such samples must contain the mean. They are
    60: a right bootstrap that is a loop must have the time."""
    rng, covered = default_rng(0), []
    for _ in range(60):
        theirs = rng.uniform(5, 30, 90)
        ours = theirs * rng.uniform(0.3, 0.7, 90) + 2  # the longer, the nearer to a half
        row = evaluate.time_ratio(trials(["success"] * 90, ours), trials(["success"] * 90, theirs))
        low, high = row["time_ratio_ci95"]
        covered.append(low <= 0.5 + 2 / 17.5 <= high)
    hint = (
        "which share of the intervals contains the truth? An interval goes from 2.5 to 97.5 % of the "
        "ratios of the means (along axis 1), not of the mean of the ratios; one call of `bootstrap` "
        "draws for both planners; goals are drawn with replacement"
    )
    close(np.mean(covered), 0.94, hint, atol=0.05)


def test_mcnemar_counts_trials_that_differ_and_tosses_coins():
    ours, theirs = np.array([[1, 1, 1, 1, 1, 1, 0, 0], [1, 0, 0, 0, 0, 0, 1, 0]], bool)
    row = evaluate.mcnemar(ours, theirs)
    counts = row["only_ours"], row["only_theirs"]
    assert counts == (5, 1), "trials in which one planner alone fell; both or none say nothing"
    close(row["p"], 14 / 64, "six tosses: 0 or 1 heads in 7 of 64 ways, as many for 0 or 1 tails")
    assert evaluate.mcnemar(ours, ours) == {"only_ours": 0, "only_theirs": 0, "p": 1}


def test_table_has_the_paper_s_rows_below_ours():
    rows = [row_of("policy", True, 0.5), row_of("policy", True, 1.0)]
    four = ["success"] * 4

    def pairs(times):  # of 4 times as many goals to which both came
        return evaluate.compare(
            {
                ("policy", True, 1.0): trials([*four, "fall"] * times, [3, 8, 12, 10, 1] * times),
                ("b", True, 1.0): trials([*four, "timeout"] * times, [10, 10, 10, 10, 9] * times),
                ("c", True, 1.0): trials(["fall"] * 5 * times, [1] * 5 * times),
                ("policy", False, 1.0): trials(["success"], [1]),  # another noise: with none
            }
        )

    text = evaluate.table(rows, pairs(7))
    assert text.endswith(evaluate.NOTE), "what the paper's rows say, and what they do not"
    parts = re.sub(" +", " ", text).strip().split("\n\n")  # columns are aligned
    said, ((pair, worst), near, far) = parts[::2], [part.splitlines()[2:] for part in parts[1::2]]
    told = "0.500 [0.150, 0.850] | 0.250 | 0.250 | 5.00 ± 1.00, 5.00, 5.90 | 0.500 |"
    assert near == [
        f"| policy | {told}",
        "| policy, paper | 0.978 | 0.000 | 0.022 | 6.35 ± 2.23 | |",
        "| baseline, paper | 0.910 | 0.078 | 0.012 | 11.43 ± 5.11 | |",
    ], "times, and those still there, are of the successes only"
    assert far == [f"| policy | {told}"], "Table II has no such row"
    assert said[2] == "Goals: σ 1.0 m; noise: yes"
    low, high = pairs(7)[0]["time_ratio_ci95"]
    interval = f"[{low:.3f}, {high:.3f}]"
    want = f"| σ 1.0 m | yes | b | 0.825 {interval} | 0.500, 0.250, 0.250 | 7, 0 | 0.016 |"
    hint = "goal by goal 0.3, 0.8, 1.2, 1: two of four are faster, one is slower; the policy alone fell"
    assert pair == want, hint
    assert worst == "| σ 1.0 m | yes | c | no goal in common | | 0, 28 | 0.000 |"
    assert "| 0.825 [ nan, nan] |" in re.sub(" +", " ", evaluate.table(rows, pairs(1)))
    exact = evaluate.table([row_of("policy", False, 0.5)], [])
    assert " 0.980 " in exact and "11.13" in exact, "Table II without noise"
    text = evaluate.table(rows, [], "--push 0.4")
    assert text.startswith("With --push 0.4\n") and "paper" not in text, "it pushed nobody"


class Recorder:
    """Steps on the spot and remembers what it was told."""

    def reset(self, num_robots):
        self.goals = []

    def act(self, view):
        self.goals.append(view.goal.copy())
        return np.tile(view.neutral_action, (len(view.robots), 1))


class Wild(Recorder):  # it also scribbles on what it is told: copies are handed out, not the world
    def act(self, view):
        actions = 0 * super().act(view) + [0.7, 0.3, 0.5, 0.7, 0.3, 0.5]
        view.robots[:] = view.goal[:] = 0
        return actions


SHORT = env.Task(time_limit=2.0)  # three decisions are enough


@pytest.fixture(scope="module")
def noisy():
    return env.FootstepWorld(16, noise=True, task=SHORT)


@pytest.fixture
def one_robot():
    return env.FootstepWorld(1, task=SHORT)


def to(goals):
    """Trials with these goals [n, 3]."""
    return evaluate.Trials(np.array(goals, float), 0)


def first_noise(planner, world, asked):
    evaluate.evaluate(planner, world, asked)
    return planner.goals[0] - asked.goals


def test_noise_of_a_goal_depends_on_neither_planner_nor_number(noisy):
    six = evaluate.draw_trials(3, 6)
    two = evaluate.Trials(six.goals[:2], 3)
    noise = first_noise(Recorder(), noisy, six)
    friction = noisy.simulator.variation.friction[:6]
    assert len(np.unique(friction)) == 6, "goals must not share their floor"
    hint = "one generator per goal and one measurement per decision"
    equal(noise, first_noise(Wild(), noisy, six), hint)
    equal(noise[:2], first_noise(Recorder(), noisy, two), hint)
    last = evaluate.Trials(six.goals[4:], 3, first=4)
    equal(noise[4:], first_noise(Recorder(), noisy, last), hint)
    # Rounded: goal + noise − goal has other last digits for every goal
    assert len(np.unique(noise.round(9))) == noise.size, "goals must not share their noise"
    far = evaluate.draw_trials(3, 6, far=True)
    close(far.goals, six.goals * (2, 2, 1), "σ = 1 m, not 0.5 m")
    close(first_noise(Recorder(), noisy, far), noise, "of a far trial only the goal differs")
    dice = env.Dice(*env.stream("evaluation", 3, 0).spawn(5)).noise
    close(noise[0], dice.normal(size=3) * 0.05, "more than one measurement for a decision")


OUT = (0.06, 0, 0)  # seen from the goal [m, m, rad]
IN = (0.02, -0.03, math.radians(9))  # 3.6 cm and 9° from the goal
FALLS = "falls"
ENDINGS = {  # after each double step; outcome, double steps, those in place after them, those of its
    # time, still there?
    "stays": ([IN, IN, IN, IN], "success", 2, 2, 1, True),
    "arrives later": ([OUT, IN, IN, IN, IN], "success", 3, 2, 2, True),
    "rolls on by 6 cm": ([IN, IN, IN, OUT], "success", 2, 2, 1, False),
    "falls afterwards": ([IN, IN, FALLS, IN], "success", 2, 1, 1, False),
    "arrives too late": ([OUT, OUT, IN], "timeout", 3, 0, 3, False),
    "falls at the goal": ([FALLS], "fall", 1, 0, 1, False),
}


def test_success_is_to_be_inside_twice_in_a_row(noisy, monkeypatch):
    poses, *columns = zip(*ENDINGS.values())
    outcome, steps, more, timed, still_there = map(np.array, columns)
    count, planner = np.zeros(len(poses), int), Wild()

    def run(robots, plan, disturbance):
        ends = [poses[i][count[i]] for i in robots]
        count[robots] += 1
        there = np.array([IN if end is FALLS else end for end in ends])
        noisy.simulator.state[robots[:, None], robot_model.GROUND] = there
        return motion(there, [end is FALLS for end in ends])

    monkeypatch.setattr(noisy.simulator, "run", run)
    found = evaluate.evaluate(planner, noisy, to(np.zeros((len(poses), 3))))
    for key, want, hint in (
        ("outcome", outcome, "a success is inside after two double steps in a row"),
        ("steps", steps, "they end with the trial, not with the two double steps after it"),
        ("still_there", still_there, "inside and standing after two more double steps"),
    ):
        equal(found[key], want, f"{key}: {hint}; of {[*ENDINGS]}")
    close(found["time"] / noisy.engine.period, timed, "of a success: to the first of two")
    equal(count, steps + more, "only successes walk on, twice; who fell meanwhile does not")
    assert len(planner.goals) == 3, "one measurement a decision, none afterwards"


@BOTH
def test_no_walk_hangs_on_the_last_bits_of_its_start(sim):
    """Other processors round a stance in another way. So soles that only just touch the floor would
    touch it elsewhere: `RobotModel.sink`."""

    def end(deeper):
        """Where noisy walks end, from a start that is so much deeper in the floor [m]."""
        world = env.FootstepWorld(8, sim, noise=True)
        torso, joints = world.simulator.standing
        world.simulator.standing = torso - [0, 0, deeper, 0, 0, 0], joints
        planner = evaluate.BaselinePlanner(evaluate.TUNED_BASELINE[sim])
        evaluate.evaluate(planner, world, evaluate.draw_trials(seed=5, count=8))
        return world.pose.copy()

    want = end(0)
    for deeper in 1e-12, -1e-12:
        close(end(deeper), want, f"after a start that is deeper by {deeper} m", atol=1e-3)


def save_untrained(path, sim="pymunk", fits=(), **settings):
    """A policy that steps on the spot whatever it sees: nearly its first one; settings: of the
    world in which it says that it was trained; fits: what it says of it besides.
    """
    torch.manual_seed(0)
    neutral = env.to_action(np.zeros((2, 3)), env.LIMITS[sim])
    model = ppo.ActorCritic(*SIZES, first_action=neutral)
    world = env.FootstepWorld(1, sim, **{"task": SHORT, **settings})
    path.parent.mkdir(parents=True, exist_ok=True)
    fits = ppo.fingerprint(world) | dict(fits)
    ppo.save_policy(path, model, fits=fits)
    return path


PLANNER = """
import numpy as np

class Planner:
    def reset(self, num_robots):
        pass

    def act(self, view):
        actions = np.tile(view.neutral_action, (len(view.robots), 1))
        {line}
        return actions
"""
LINE = 9  # of what is put in, counted from 0


def own_planner(path, line="pass"):
    """The file of a planner that steps on the spot and does something else before."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(PLANNER.format(line=line), "utf-8")
    return path


plot_footsteps = evaluate.plot_footsteps  # `short_trials` puts it aside


@pytest.fixture
def short_trials(tmp_path, monkeypatch):
    """A folder with a policy, 2 s for a trial, no figures: the command line takes a moment. What
    the figures would show."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", sys.path[:])  # a planner's folder is put there
    save_untrained(Path("results/pymunk/policy.pt"))
    monkeypatch.setattr(env, "FootstepWorld", partial(env.FootstepWorld, task=SHORT))
    figures = []
    monkeypatch.setattr(evaluate, "plot_footsteps", lambda *shown: figures.append(shown))
    return figures


def call(*arguments):
    """The script's main in this process; what is in evaluation.json of the folder out."""
    evaluate.main([*map(str, arguments), "--out", "out"])
    text = Path("out/evaluation.json").read_text("utf-8")
    return json.loads(text, parse_constant=pytest.fail)  # JSON knows no NaN


def test_your_own_policy_comes_first_and_rows_are_called_like_files(short_trials, one_robot):
    (shipped,) = evaluate.arguments([]).policy
    assert shipped.is_file(), "the one beside the stages, in whatever folder they are started"
    own = save_untrained(Path("runs/pymunk/policy.pt"))
    assert call("--episodes", 1)["policy"] == [str(own)]
    assert [*short_trials[0][1]] == ["policy", "baseline_tuned", "baseline"], "in the figure"
    files = map(Path, "first.pt a/policy.pt seed_1.pt mine.pt".split())
    policies = [save_untrained(file) for file in files]
    mine = [own_planner(name) for name in ("mine.py", "b/mine.py", "b/baseline.py")]
    planners = evaluate.choose_planners(one_robot, policies, mine)
    names = "policy a/policy.pt seed_1 mine mine.py b/mine.py b/baseline.py baseline_tuned baseline"
    assert " ".join(planners) == names, "called like the file, by its path if that is taken"


ANOTHER = {
    "walk": replace(WALK, foot_rise=0.03),
    "limits": env.StepLimits((-0.1, 0, -0.1), (0.1, 0.1, 0.1)),
    "spread": env.Spread(mass=0.2),
    "drift": (0.1, 0.0, 0.0),
    "robot": replace(ROBOT, torso=replace(ROBOT.torso, mass=4.0)),
}


@pytest.mark.parametrize("settings, said", [
    (ANOTHER, "walk, step limit, spread, drift, robot"), ({"push": 0.4}, None),
], ids=["another", "pushed"])  # fmt: skip
def test_a_policy_of_another_world_walks_and_a_note_says_what_differs(
    one_robot, tmp_path, capsys, settings, said
):
    path = save_untrained(tmp_path / "policy.pt", **settings)
    planner = evaluate.policy_planner(path, one_robot)
    printed = capsys.readouterr().out
    note = f"note: {path.as_posix()} was trained with another {said}\n"
    assert printed == (note if said else "")
    evaluate.evaluate(planner, one_robot, evaluate.draw_trials(0, 1))


OTHER_ROBOT = """
from importlib import import_module

ROBOT = import_module("01_robot_model").RobotModel(thigh_length=0.168)
WALK = import_module("02_walk_engine").TUNED["pymunk"]
LIMITS = import_module("03_env").StepLimits((-0.1, 0, -0.1), (0.1, 0.1, 0.1))
"""


@pytest.mark.parametrize("flags, mention", [
    (["--policy", "text.py"], "text.py: damaged, or not written by this 04_ppo.py"),
    (["--policy", "other.pt"], "other.pt: trained in another simulator: mujoco"),
    (["--policy", "blind.pt"], "blind.pt: (?!.*pymunk).*observ"),
    (["--policy", "pendulum.pt"], "pendulum.pt: trained in another environment"),
    (["--policy", "missing.pt"], "missing.pt: no such file"),
    (["--planner", "missing.py"], "missing.py: no such .py file"),
    (["--planner", "text.py"], "text.py: .*Planner"),
], ids=str)  # fmt: skip
def test_a_file_that_cannot_be_used_is_one_line(short_trials, flags, mention):
    save_untrained(Path("other.pt"), "mujoco")
    save_untrained(Path("blind.pt"), fits={"observation": ["all"]})
    ppo.save_policy(Path("pendulum.pt"), ppo.ActorCritic(3, 1), fits=None)
    Path("text.py").write_text("class Other: pass")
    with pytest.raises(robot_model.InputError, match=rf"\A{mention}.*\Z"):  # one line
        call(*flags)
    assert not Path("out").exists(), "check everything first, then write"


def test_another_robot_walks_by_the_numbers_of_its_file(short_trials):
    once = "\nopen('read.txt', 'a').write('once ')"
    Path("mine.py").write_text(OTHER_ROBOT + once, "utf-8")
    content = call("--robot", "mine.py", "--episodes", 1, "--friction", 0.5)
    assert content["robot"] == "mine.py"
    assert Path("read.txt").read_text() == "once ", "a file that draws numbers is one robot"
    ((world, *_),) = short_trials
    assert world.engine.robot == replace(ROBOT, thigh_length=0.168, friction=0.5)
    assert world.spread == replace(env.Spread(), friction=0.0), "all but the floor stays random"
    assert world.limits.high == (0.1, 0.1, 0.1)


@pytest.mark.parametrize(
    "line, rule",
    [
        ("return actions[:1]", r"must be finite numbers of shape \(2, 6\)"),
        ("actions[0, 0] = 1.01", "must lie between 0 and 1"),
        ("actions[0, 0] = -0.01", "must lie between 0 and 1"),
    ],
)
def test_a_wrong_action_names_the_file_and_the_rule(noisy, tmp_path, monkeypatch, line, rule):
    monkeypatch.setattr(sys, "path", sys.path[:])
    planner = evaluate.load_planner(own_planner(tmp_path / "mine.py", line))
    with pytest.raises(ValueError, match=f"mine.py: actions .*{rule}"):
        evaluate.evaluate(planner, noisy, to(np.zeros((2, 3))))


@pytest.mark.parametrize("error", [KeyError, OSError])
def test_a_planner_s_own_error_keeps_its_traceback(short_trials, error):
    path = own_planner("mine.py", f"raise {error.__name__}('one of mine')")
    with pytest.raises(error, match="one of mine") as caught:
        call("--planner", path, "--episodes", 2)
    last = caught.traceback[-1]
    assert (last.path.name, last.lineno) == ("mine.py", LINE), "where it was raised"
    with pytest.raises(robot_model.InputError, match=r"\Amine\.py: .*exit.*\Z"):
        call("--planner", own_planner("mine.py", "exit()"), "--episodes", 1)


def test_from_a_policy_file_to_the_table(short_trials, capsys, monkeypatch):
    line = "actions[:, [0, 3]] += 0.3"  # it walks past the second goal
    mine = own_planner("a/mine.py", line)  # the name is taken
    asked = evaluate.Trials(np.array([[0.0, 0, 0], [0.12, 0, 0]]), 6)
    monkeypatch.setattr(evaluate, "draw_trials", lambda *_: asked)
    flags = "--seed 6 --friction 0.4 --policy results/pymunk/policy.pt".split()
    content = call(*flags, save_untrained(Path("mine.pt")), "--planner", mine)
    said = capsys.readouterr().out
    assert Path("out/table.md").read_text("utf-8") in said, "the table is printed"
    assert "mine: mine.pt" in said, "say which file is judged"
    assert [*short_trials[0][1]][-3] == "a/mine.py", "yours is drawn, not the policy"
    plot_footsteps(*short_trials[0])
    assert Path("out/footsteps.png").read_bytes().startswith(b"\x89PNG")
    hint = "a goal is where it starts, and its mode is to step on the spot: does it explore?"
    assert content["rows"][0]["success"] > 0, hint
    _, *lines = Path("out/trials.csv").read_text("utf-8").splitlines()
    once, late = f"{PERIOD:.2f}", f"{3 * PERIOD:.2f}"  # [s]
    hint = "noise, σ, seed, trial, goal, μ of --friction, outcome, time with all its digits, steps"
    assert lines[0] == f"policy,no,0.5,6,0,0.0,0.0,0.0,0.4,success,{once},2,yes", hint
    assert lines[5] == f"a/mine.py,no,0.5,6,1,0.12,0.0,0.0,0.4,timeout,{late},3,no", hint


def test_a_file_that_another_program_keeps_open_costs_no_result(short_trials, capsys):
    said = r"\A.*evaluation.json: Access is denied\Z"
    with locked("evaluation.json"), pytest.raises(robot_model.InputError, match=said):
        call("--episodes", 1)
    assert "| baseline" in capsys.readouterr().out, "print first"


@pytest.mark.parametrize("flag", ["--push=-1", "--friction=-1"])
def test_a_flag_out_of_range_is_refused_in_one_line(capsys, flag):
    with pytest.raises(SystemExit, match="2"):
        evaluate.arguments([flag])
    assert "from 0 on" in capsys.readouterr().err.splitlines()[-1]


def test_flags_of_the_command_line_reach_the_trials_and_are_told(short_trials, monkeypatch):
    walk = mock.Mock(wraps=evaluate.evaluate)
    monkeypatch.setattr(evaluate, "evaluate", walk)
    content = call(*"--noise --episodes 2 --seed 6 --far --friction 0.4 --push 0.3".split())
    told = [(world.push, world.noise) for (_, world, _), _ in walk.call_args_list]
    hint = "every row of the table is walked with the pushes, and with the noise, that it tells of"
    assert told == [(0.3, row["noise"]) for row in content["rows"]], hint
    head, *_ = Path("out/table.md").read_text("utf-8").splitlines()
    assert head == "With --push 0.3 --friction 0.4", "the paper's robot walked without them"
    assert short_trials[0][0].push == 0, "nobody is pushed in a figure"
    rows = [(row["goal_std_m"], row["noise"], row["planner"]) for row in content["rows"]]
    names = ["policy", "baseline_tuned", "baseline"]
    assert rows == [*itertools.product((0.5, 1.0), (False, True), names)], "far: a block of its own"
    near, far = (evaluate.draw_trials(6, 2, far).goals for far in (False, True))
    goals = np.genfromtxt("out/trials.csv", delimiter=",", skip_header=1, usecols=(5, 6, 7))
    equal(goals[12:], [*far] * 6, "the far block has goals twice as far")
    equal(goals, [*near] * 6 + [*far] * 6, "with all their digits")


# ------------------------------------------------------------------------ other processes
def walked(planners, jobs):
    """Rows of planners by name, walked in so many processes."""
    goals = [0.02, 0, 0], [0, 0.01, 0.05], [0, 0.01, -0.05], [0.04, 0, 0]
    args = argparse.Namespace(noise=True, push=None, jobs=jobs, episodes=4)
    return evaluate.evaluate_all(args, {0.5: to(goals)}, planners, {"sim": "pymunk"})


class Mine(evaluate.BaselinePlanner):
    """A planner of one's own."""


def test_with_jobs_the_rows_are_the_same_and_a_planner_of_one_s_own_walks_here(monkeypatch):
    monkeypatch.setattr(evaluate, "PART", 2)  # so that other processes walk to two of four
    untrained = ppo.ActorCritic(*SIZES, first_action=env.to_action(np.zeros((2, 3)), LIMITS))
    policy, baseline = evaluate.PolicyPlanner(untrained), evaluate.BaselinePlanner()
    planners = {"policy": policy, "a": Recorder(), "b": Mine(), "baseline": baseline}
    want = walked(planners, 1)
    walk = mock.Mock(wraps=evaluate.evaluate)
    monkeypatch.setattr(evaluate, "evaluate", walk)
    found = walked(planners, 2)
    assert [*found] == [*want], "rows in the order of the table, whoever walked them"
    np.testing.assert_equal(found, want)
    here = [planner for (planner, *_), _ in walk.call_args_list]
    assert here == [planners["a"], planners["b"]] * 2


@pytest.mark.parametrize("count", [101, 250])
def test_no_robot_walks_alone_in_another_process(count):
    parts = evaluate.parts_of(evaluate.Trials(np.zeros((count, 3)), 5))
    sizes = [len(part.goals) for part in parts]
    assert sum(sizes) == count and min(sizes) > 1 and max(sizes) <= evaluate.PART


def test_a_script_lets_all_cores_walk_on_the_plane(monkeypatch):
    monkeypatch.setattr(robot_model, "CORES", 7)
    assert evaluate.arguments([]).jobs == 1, "who imports the stage may be no script"
    monkeypatch.setattr(evaluate, "__name__", "__main__")
    flags = "", "--mujoco", "--jobs 3", "--mujoco --jobs 3"
    assert [evaluate.arguments(flag.split()).jobs for flag in flags] == [7, 1, 3, 3]


@pytest.mark.skipif(sys.platform == "win32", reason="there are no process groups")
def test_ctrl_c_is_one_line_and_ends_all_processes(tmp_path):
    policy = save_untrained(tmp_path / "policy.pt")
    flags = ["--noise", "--jobs", "2", "--out", tmp_path, "--policy", policy]
    command = [sys.executable, "-u", "05_evaluate.py", *flags]
    with subprocess.Popen(
        command,
        cwd=Path(evaluate.__file__).parent,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # MuJoCo's package glfw starts a process that complains if its own parent is killed.
        env=os.environ | {"MUJOCO_GL": "disable"},
        # A test that runs in the background has inherited that Ctrl-C is ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        process.stdout.readline()  # which policy: the walks begin
        time.sleep(0.5)  # helpers begin
        os.killpg(process.pid, signal.SIGINT)  # as the terminal does
        try:  # It waits until nobody lives on who could write to these pipes.
            _, errors = process.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            pytest.fail("a process is still alive")
    assert process.returncode == 2 and errors.endswith("\n05_evaluate.py: interrupted\n")
    assert "Traceback" not in errors


# ------------------------------------------------------------------------ pictures
def test_recorded_feet_follow_from_torso_and_joints():
    """Of a robot in any place whose joints put its feet somewhere, in its frame x, y, z, yaw."""
    feet = np.array([[0.03, 0.1, 0.02, 0.2], [-0.04, -0.08, 0, -0.1]])
    trunk = np.array([0.01, 0.02, 0.36, 0.05, 0.1, 0.1])
    joints = robot_model.joints_for_feet(ROBOT, trunk, feet)
    place = np.array([0.3, -0.2, 0.5])
    ground = robot_model.GROUND
    trunk[ground] = robot_model.compose(place, trunk[ground])
    found = evaluate.foot_poses(ROBOT, trunk[None], joints[None])[0]
    close(found, robot_model.compose(place, feet[:, [0, 1, 3]]), "below the ankles, and the yaw")


def middles_of_soles(world):
    """Where the middle of the left and of the right sole is on the floor now, [2, 2]."""
    torso, joints, _ = np.split(world.simulator.state, [6, 18], -1)
    poses = evaluate.foot_poses(ROBOT, torso, joints)[0]
    ahead, outward = (ROBOT.foot_front - ROBOT.foot_back) / 2, ROBOT.foot_outward
    return poses[:, :2] + robot_model.turned([(ahead, outward), (ahead, -outward)], poses[:, 2])


@pytest.mark.skipif(sys.platform != "linux", reason="there every name is text")
def test_a_name_that_is_no_utf_8_is_told_with_a_question_mark(short_trials, one_robot):
    files = [own_planner("ada.py"), own_planner("Zo\udceb.py")]
    assert "'Zo?': " in str(evaluate.choose_planners(one_robot, files=files, policies=[]))


def test_a_footstep_plot_shows_where_feet_and_torso_were():
    panel, world = Figure().subplots(), env.FootstepWorld(1, task=replace(SHORT, success_m=0.07))
    evaluate.draw_walks(panel, world, Wild(), to([[3.0, 0.0, 0.5]]))
    *soles, disc = panel.patches
    *rim, tip, _ = disc.get_xy() - [3.0, 0.0]
    close(np.linalg.norm(rim, axis=1), 0.07, "the goal is as large as its tolerance")
    close(math.atan2(tip[1], tip[0]), 0.5, "its tip points along its yaw")
    assert len(soles) == 6, "two feet, after each of three double steps"
    places = np.array([patch.get_xy()[:4].mean(0) for patch in soles]).reshape(2, 3, 2)
    close(places[:, -1], middles_of_soles(world), "the feet at the end of the walk", atol=1e-9)
    close(panel.lines[-1].get_xydata()[-1], world.pose[0, :2], "the torso's path")
    assert panel.texts[0].get_text() == f"timeout\n{3 * PERIOD:.1f} s"
