"""Stage 5: the baseline's equations, the statistics, the trials, planners, files, command line."""

import argparse
import itertools
import json
import math
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import time
import traceback
from contextlib import closing
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
import PIL.Image
import PIL.ImageSequence
import pytest
import torch
from checks import close, equal, frozen, locked
from matplotlib.backend_bases import KeyEvent, MouseEvent
from numpy.random import default_rng
from test_03_env import motion

evaluate = import_module("05_evaluate")
env, ppo, robot_model = evaluate.env, evaluate.ppo, evaluate.robot_model
LIMITS = env.LIMITS["pymunk"]
B = evaluate.BaselineSettings()
OTHER = evaluate.BaselineSettings(0.3, 0.1, 0.2, 0.8, gain=0.5, turning_gain=2.0, far_m=0.4)
# By hand and not by the stages, which may be empty exercises when this module is imported:
TICK = robot_model.RobotModel().control_dt  # [s]
PERIOD = 2 * TICK * env.walk_engine.TUNED["pymunk"].half_ticks  # [s] a double step


def view(goal, robots=(0,), **known):
    """A View of these goals [n, 3]; what is not known is None."""
    blank = dict.fromkeys(env.View.__dataclass_fields__) | {"period": PERIOD, "limits": LIMITS}
    return env.View(**blank | {"goal": np.array(goal), "robots": np.array(robots)} | known)


plot_footsteps = evaluate.plot_footsteps  # `short_trials` puts it aside


def command(x, y, yaw=0.0, settings=B):
    return evaluate.velocity_command(np.broadcast_to([x, y, yaw + 0.0], (1, 3)), settings)[0]


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
    half = command(0.03, -0.02, settings=replace(B, gain=0.5))
    close(half[:2], (0.015, -0.01), hint, atol=1e-6)
    assert not command(0, 0).any(), "at the goal there is nothing to do"


def test_far_away_it_faces_the_goal_and_nearby_it_turns_like_the_goal():
    close(command(0, 1.01, 0.2)[2], 0.3, "far: 0.3·β, limited; left: positive")
    close(command(1.01, 0, 0.5)[2], 0, "far: the goal is straight ahead")
    close(command(1.01, -0.1, 0.5)[2], -0.3 * math.atan2(0.1, 1.01), "far: 0.3·β")
    close(command(0, 0.99, 0.5)[2], 0.15, "near: turn to α = 0.5 rad, gain 0.3")
    close(command(0.1, 0, 3)[2], 0.3, "near: limited to 0.3 rad/s")
    close(command(0.1, 0, -3)[2], -0.3, "the limit holds to both sides")
    around = command(0.1, 0, math.radians(350))[2]
    close(around, 0.3 * math.radians(-10), "350° to the left are 10° to the right")


def test_speed_and_turning_follow_the_settings():
    hint = (
        "every limit and gain comes from `settings`, not from the default; and the gain comes "
        "before the limit: v = min(gain·d, v_max)"
    )
    close(command(0, 5, settings=OTHER)[2], 0.8, "far: 0.8 rad/s to the left")
    close(command(0.3, 0, 0.2, OTHER)[2], 0.4, "near: 2·α; " + hint)
    close(command(0.5, 0, 0.2, OTHER)[2], 0, "far begins at far_m = 0.4 m")


def test_speed_of_many_goals_is_that_of_each():
    goals = default_rng(0).normal(size=(50, 3)) * (1, 1, 2)
    together = evaluate.velocity_command(goals, OTHER)
    assert together.shape == (50, 3), "goals [n, 3] -> v_x, v_y, ω [n, 3]"
    alone = [command(*goal, settings=OTHER) for goal in goals]
    close(together, alone, "robots must not influence one another", rtol=1e-5)


def test_the_filter_is_solved_exactly():
    slow, fast = [0.02, 0, 0.1], [0.12, 0.2, 0.1]
    velocity, command = np.array([slow, fast]), np.array([fast, slow])  # one of them brakes
    frozen(velocity, command)
    found = evaluate.low_pass(velocity, command, 0.6, 1.5)
    left = np.array([0.1, 0.2, 0]) * math.exp(-0.4)
    close(
        found,
        command - [left, -left],
        "v ← v + (1 − exp(−t/τ))·(v_cmd − v): is the sign right?",
    )
    close(evaluate.low_pass(velocity, command, 0.6, 0), command, "τ = 0: no filter")


def test_velocities_become_mirrored_footsteps():
    velocities = np.array([[0.12, 0, 0], [0, 0.06, 0], [0, -0.06, 0], [0, 0, 0.2]])
    frozen(velocities)
    expected = [
        [[0.03, 0, 0], [0.03, 0, 0]],
        [[0, 0.03, 0], [0, 0, 0]],
        [[0, 0, 0], [0, 0.03, 0]],
        [[0, 0, 0.05], [0, 0, -0.05]],
    ]
    ahead = "forward: half the period's way per single step, so both feet share it"
    aside = (
        "sideways: one foot takes it all, the left one to the left and the right one to the "
        "right, and outward is positive for both; the other one follows with 0"
    )
    turn = (
        "turn: either foot takes its share, a half by default; outward is positive for both "
        "feet: y and yaw of the right foot are mirrored"
    )
    steps = evaluate.velocity_to_footsteps(velocities, period=0.5)
    assert np.shape(steps) == (4, 2, 3), "velocities [n, 3] -> footsteps [n, 2, 3]"
    for i, (want, hint) in enumerate(zip(expected, (ahead, aside, aside, turn))):
        alone = evaluate.velocity_to_footsteps(velocities[i : i + 1], period=0.5)[0]
        close(alone, want, f"{hint} (for {velocities[i]})", atol=1e-6)
        close(steps[i], alone, "robots must not influence one another", atol=1e-6)


def test_a_shared_way_is_split_in_proportion_to_the_limits():
    """Outward 0.15 m and 0.6 rad, inward 0.04 m and 0.4 rad: shares 15/19 and 6/10."""
    limits = env.StepLimits(low=(-0.1, -0.04, -0.4), high=(0.1, 0.15, 0.6))
    planner = evaluate.BaselinePlanner(
        evaluate.BaselineSettings(
            9, 9, 9, 9, gain=1.0, turning_gain=1.0, far_m=9.0, time_constant=0.0, share=True
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


def test_only_the_first_command_of_a_trial_is_not_filtered():
    planner, velocities = evaluate.BaselinePlanner(), []
    ahead, aside = [[5.0, 0.0, 0.0]], [[0.0, 5.0, 0.0]]
    for goals in ([ahead, aside], [aside]):  # of two trials
        planner.reset(2)
        for goal in goals:
            actions = planner.act(view(goal, [1]))
            velocities.append(planner.velocity[1].copy())
    share = 1 - math.exp(-PERIOD / 1.0)  # τ = 1 s
    changed = (0.12 * (1 - share), 0.07 * share, 0.3 * share)
    close(
        velocities,
        [(0.12, 0, 0), changed, (0, 0.07, 0.3)],
        "the filter smooths changes; before a first command is none",
    )
    planner.act(view(ahead, [0]))
    close(planner.velocity[0], (0.12, 0, 0), "robot 0 was not asked before, only robot 1")
    steps = [[[0, 0.07 * PERIOD, 0.15 * PERIOD], [0, 0, -0.15 * PERIOD]]]
    close(env.to_footsteps(actions, LIMITS), steps, "it shares turns only")


def test_wilson_interval():
    hint = "Wilson: (p + z²/(2n) ± z·√(p·(1 − p)/n + z²/(4n²))) / (1 + z²/n), z = 1.96 for 95 %"
    close(evaluate.wilson(5, 10), [0.2366, 0.7634], hint, atol=1e-4)
    close(evaluate.wilson(490, 500), [0.9636, 0.9891], hint, atol=1e-4)
    close(evaluate.wilson(5, 10, 1.0)[0], 0.3492, "z is an argument", atol=1e-4)
    low, high = evaluate.wilson(500, 500)
    assert high == pytest.approx(1) and 0.99 < low < 1, "500 of 500 does not prove 100 %"
    close(evaluate.wilson(0, 500), [1 - high, 1 - low], "not symmetric")
    assert max(evaluate.wilson(n, n)[1] for n in range(1, 500)) <= 1, (
        "a share above 1: of (1 + z²/n) / (1 + z²/n) rounding makes more than 1"
    )


def trials(outcomes, times, still_there=None):
    """Without still_there: all successes are. Somebody times out who was there once, after 8 s."""
    reached, times = np.array(outcomes) == "success", np.array(times, float)
    once = np.where(reached, times, 8.0 * (np.array(outcomes) == "timeout"))
    return {
        "outcome": np.array(outcomes),
        "time": times,
        "still_there": reached if still_there is None else np.array(still_there),
        "reached_once": once > 0,
        "time_once": once,
    }


FOUR = trials(["success", "success", "fall", "timeout"], [4, 6, 1, 100], [1, 0, 0, 0])


def row_of(planner, noise, std, ended=FOUR):
    return evaluate.summary(planner, noise, std, ended, env.Task())


def test_time_ratio_uses_only_goals_that_both_reached():
    ours = trials(["success", "success", "fall", "success"], [5, 10, 1, 80])
    theirs = trials(["success", "success", "success", "fall"], [10, 20, 100, 1])
    row = evaluate.time_ratio(ours, theirs)
    assert row["goals"] == 2, "goals that both reached: a fall's time is none of a fast success"
    close(row["time_ratio"], 0.5, "mean time / mean time of the reference")
    close(
        [*row["time_ratio_ci95"]],
        [0.5, 0.5],
        "paired: a goal's difficulty cancels out, resample goals, not times",
    )
    far_ones = evaluate.time_ratio(
        trials(["success"] * 4, [5, 30, 40, 8]), trials(["success"] * 4, [10, 20, 40, 10])
    )
    close(far_ones["time_ratio"], 83 / 80, "a ratio of the means, not a mean of the ratios")
    close(far_ones["median"], 0.9, "of the ratios goal by goal: 0.5, 1.5, 1 and 0.8")
    close(
        [far_ones["faster"], far_ones["slower"]],
        [0.5, 0.25],
        "two of four take less than the reference, one takes more, one takes as long",
    )
    fell, reached = trials(["fall"], [1]), trials(["success"], [10])
    assert evaluate.time_ratio(fell, reached) == {}, "no goal in common: no ratio"


def test_time_ratio_s_bootstrap_is_that_of_theory():
    sample = default_rng(1).normal(3.0, 2.0, 400)
    low, high = evaluate.bootstrap(lambda drawn: drawn.mean(1), sample)
    close((low + high) / 2, sample.mean(), atol=0.03)
    close(
        high - low,
        2 * 1.96 * sample.std() / 20,
        "95 % of a normal distribution are ± 1.96 σ/√n: 2.5 and 97.5 %, of as many as there are",
        rtol=0.07,
    )
    assert [*evaluate.bootstrap(lambda a, b: (a - b).mean(1), sample, sample)] == [0, 0], (
        "what belongs together is drawn together"
    )
    seen = []
    evaluate.bootstrap(lambda drawn: seen.extend(drawn) or drawn.mean(1), sample, resamples=7)
    assert len(seen) == 7, "as many resamples as are asked for"


def test_time_ratio_s_interval_covers_the_truth():
    """90 goals with another ratio each: about 95 of 100 such samples must contain the mean."""
    rng, covered = default_rng(0), []
    for _ in range(200):
        theirs = rng.uniform(5, 30, 90)
        ours = theirs * rng.uniform(0.3, 0.7, 90) + 2  # the longer, the nearer to a half
        row = evaluate.time_ratio(trials(["success"] * 90, ours), trials(["success"] * 90, theirs))
        low, high = row["time_ratio_ci95"]
        covered.append(low <= 0.5 + 2 / 17.5 <= high)
    assert 0.89 <= np.mean(covered) <= 0.99, (
        "2.5 and 97.5 % of the ratios of the means, not of the mean of the ratios; goals are drawn "
        f"with replacement (got {np.mean(covered):.0%} of the intervals around the truth, expected "
        "95 %)"
    )


def test_summary_counts_episodes_and_times_successes():
    row = row_of("policy", False, 0.5)
    assert (row["success"], row["fall"], row["timeout"]) == (0.5, 0.25, 0.25)
    assert (row["time_mean"], row["time_std"]) == (5, 1), "a mean over the successes only"
    assert row["still_there"] == 0.5, "a share of the successes, not of the episodes"
    assert row["reached_once"] == 0.75, "by the paper's rule: at the goal after one double step"
    assert row["time_once_mean"] == 6, "(4 + 6 + 8) / 3 s, of all who were there once"
    close(row["time_once_std"], math.sqrt(8 / 3), atol=1e-3)
    late = row_of("policy", False, 0.5, FOUR | {"reached_once": FOUR["outcome"] != "timeout"})
    assert late["fall_once"] == 0, "who has been there has arrived, by its rule"


def test_summary_without_a_success_is_valid_json():
    row = row_of("policy", True, 0.5, trials(["fall", "fall"], [1, 100]))
    for name in ("time_mean", "time_std", "time_once_mean", "time_once_std", "still_there"):
        assert row[name] is None, f"{name}: no success: no mean, and not 0 or nan"
    json.dumps(row, allow_nan=False)
    assert "none" in evaluate.table([row], [])


def test_table_has_the_paper_s_rows_in_a_table_of_their_own():
    rows = [row_of("policy", True, 0.5), row_of("policy", True, 1.0), row_of("mine", True, None)]
    key = ["success"] * 3 + ["fall"]
    runs = {
        ("policy", True, None): trials(key, [3, 8, 12, 1]),
        ("b", True, None): trials(key, [10, 10, 10, 9]),
        ("policy", False, None): trials(key, [1, 1, 1, 1]),  # another noise: compared with none
    }
    text = evaluate.table(rows, evaluate.compare(runs))
    *ours, _, once, _, ratios = re.sub(" +", " ", text).split("\n\n")  # columns are aligned
    assert "paper" not in "".join(ours), "its success means something else: not in the same column"
    assert ours[4] == "Goals: own; noise: yes"
    assert ours[5].splitlines()[2:] == [
        "| mine | 0.500 [0.150, 0.850] | 0.250 | 0.250 | 5.00, 5.00, 5.90 | 0.500 |"
    ], "every kind of goals has a table"
    assert once.splitlines()[2:] == [
        "| yes | policy | ours | 0.750 | 0.000 | 0.250 | 6.00 ± 1.63 |",
        "| yes | policy | paper | 0.978 | 0.000 | 0.022 | 6.35 ± 2.23 |",
    ], "of other planners, and of goals twice as far, Table II says nothing"
    (pair,) = ratios.splitlines()[2:]
    assert pair == "| own | yes | b | 0.767 [0.300, 1.200] | 0.800 | 0.667, 0.333 | 3 |", (
        "goal by goal 0.3, 0.8, 1.2: their median; two of three are faster, one is slower"
    )
    assert "Mean success time:" not in evaluate.table(rows[1:], []), "no empty table"
    text = evaluate.table(rows, [], "--push 0.4")
    assert text.startswith("With --push 0.4\n\n") and "paper" not in text, "it pushed nobody"


def test_tables_fit_into_a_terminal_of_100_columns():
    names = "policy", "baseline_tuned"
    runs = {
        (name, noise, std): trials(["success"] * 999 + ["timeout"], np.full(1000, 99.99))
        for noise, std in itertools.product((False, True), (0.5, 1.0))
        for name in names
    }
    rows = [row_of(*key, ended) for key, ended in runs.items()]
    for line in evaluate.table(rows, evaluate.compare(runs)).splitlines():
        assert len(line) <= 100, f"{len(line)} columns: {line}"


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
    with closing(env.FootstepWorld(16, noise=True, cores=1, task=SHORT)) as world:
        yield world


def to(goals):
    """Trials with these goals [n, 3]."""
    return replace(evaluate.draw_trials(0, len(goals)), goals=np.array(goals, float))


def first_noise(planner, world, asked):
    evaluate.evaluate(planner, world, asked)
    noise = planner.goals[0] - asked.goals
    noise[:, 2] = env.wrap(noise[:, 2])
    return noise


def test_noise_of_a_goal_depends_on_neither_planner_nor_number(noisy):
    six, two = evaluate.draw_trials(3, 6), evaluate.draw_trials(3, 2)
    noise = first_noise(Recorder(), noisy, six)
    hint = "one generator per goal and one `world.look` per decision"
    equal(noise, first_noise(Wild(), noisy, six), hint)
    equal(noise[:2], first_noise(Recorder(), noisy, two), hint)
    assert len(np.unique(noise)) == noise.size, "goals must not share their noise"
    dice = env.stream("evaluation", 3, 0).spawn(6)[env.NOISE]
    close(noise[0], dice.normal(size=3) * 0.05, "more than one measurement for a decision")


def test_far_trials_are_near_ones_with_the_goal_twice_as_far(noisy):
    near, far = (evaluate.draw_trials(3, 6, far) for far in (False, True))
    close(far.goals, near.goals * (2, 2, 1), "σ = 1 m, not 0.5 m")
    noise, other = (first_noise(Recorder(), noisy, asked) for asked in (near, far))
    close(other, noise, "only the goal may differ")


OUT, TWISTED = (0.06, 0, 0), (0, 0, math.radians(11))  # seen from the goal [m, m, rad]
IN = (0.02, -0.03, math.radians(9))  # 3.6 cm and 9° from the goal
FALLS = "falls"
ENDINGS = {  # after each double step; outcome, double steps, the first one inside, still there?
    "stays": ([IN, IN, IN, IN], "success", 2, 1, True),
    "arrives later": ([OUT, IN, IN, IN, IN], "success", 3, 2, True),
    "rolls on by 6 cm": ([IN, IN, IN, OUT], "success", 2, 1, False),
    "falls afterwards": ([IN, IN, FALLS, IN], "success", 2, 1, False),
    "passes by": ([IN, OUT, IN], "timeout", 3, 1, False),
    "arrives too late": ([OUT, TWISTED, IN], "timeout", 3, 3, False),
    "falls instead of staying": ([IN, FALLS, IN], "fall", 2, 1, False),
}


def test_success_is_to_be_inside_twice_in_a_row(noisy, monkeypatch):
    poses, *columns = zip(*ENDINGS.values())
    outcome, steps, first, still_there = map(np.array, columns)
    count, planner = np.zeros(len(poses), int), Wild()

    def run(robots, plan, disturbance):
        ends = [poses[i][count[i]] for i in robots]
        count[robots] += 1
        there = [IN if end is FALLS else end for end in ends]
        return motion(there, [end is FALLS for end in ends])

    monkeypatch.setattr(noisy.simulator, "run", run)
    found = evaluate.evaluate(planner, noisy, to(np.zeros((len(poses), 3))))
    for key, want, hint in (
        ("outcome", outcome, "a success is inside after two double steps in a row"),
        ("steps", steps, "they end with the trial, not with the two double steps after it"),
        ("still_there", still_there, "inside and standing after two more double steps"),
        ("reached_once", first > 0, "once inside, whatever comes then; a fall is not inside"),
    ):
        equal(found[key], want, f"{key}: {hint}; of {[*ENDINGS]}")
    ended = np.where(outcome == "success", first, steps)
    close(found["time"] / noisy.engine.period, ended, "of a success: to the first of two")
    close(found["time_once"] / noisy.engine.period, first)
    more = [2, 2, 2, 1, 0, 0, 0]
    equal(count, steps + more, "only successes walk on, twice; who fell meanwhile does not")
    in_place = (noisy.actions[: len(more), 0] == noisy.neutral_action).all(1)
    equal(in_place, np.array(more) > 0, "no planner is asked: in place")
    assert len(planner.goals) == 3, "one measurement a decision, none afterwards"


def test_recorded_feet_follow_from_measured_torso_and_joints():
    """If physics does exactly what was planned, the feet are exactly where they were planned. Every
    double step waits for eight ticks, and physics pads it by two more."""
    world, moved = env.FootstepWorld(1, "mujoco", cores=1, task=SHORT), [0.3, -0.2, 0.5]
    needed = world.engine.period_ticks + 8

    def run(robots, plan, disturbance):
        torso, joints = (
            np.pad(path[:, 1:], ((0, 0), (0, 10), (0, 0)), "edge")
            for path in (plan.trunk, plan.joints)
        )
        place = torso[..., [0, 1, 5]]
        torso[..., [0, 1, 5]] = robot_model.compose(moved + 0 * place, place)
        ticks = np.array([needed])
        return robot_model.Motion(torso, joints, torso[:, 0, 3:], np.zeros(1, bool), ticks)

    world.simulator.run = run
    (walk,) = evaluate.record(Wild(), world, to([[3.0, 0.0, 0.0]]))
    world.close()
    ticks = len(walk["feet"]) * needed
    equal(walk["ends"], np.arange(needed, ticks + 1, needed), "the padding is cut off")
    assert (walk["torso"].shape, walk["joints"].shape) == ((ticks, 6), (ticks, 12))
    planned = robot_model.compose(np.tile(moved, (1, 2, 1)), world.engine.feet)[0]  # [2, 3]
    close(walk["feet"][-1], planned, "x, y of the ankle's projection, yaw")


def test_a_policy_sees_the_rows_it_was_trained_with():
    model, seen = ppo.ActorCritic(25, 6), np.ones((1, 25), np.float32)
    found = evaluate.PolicyPlanner(model).act(view(np.zeros((1, 3)), observation=seen))
    equal(found, model.decide(seen), "with the IMU's, which are the last ones")


def save_untrained(path, sim="pymunk", imu=False, steps=10, **settings):
    """A policy that steps on the spot whatever it sees: nearly its first one; settings: of the
    world in which it says that it was trained.
    """
    torch.manual_seed(0)
    neutral = env.to_action(np.zeros((2, 3)), env.LIMITS[sim])
    model = ppo.ActorCritic(len(env.observation_table(imu)), 6, first_action=neutral)
    world = env.FootstepWorld(1, sim, cores=1, **{"task": SHORT, **settings})
    about = {
        "fits": ppo.fingerprint(world, model.shape["obs_dim"]),
        "imu": imu,
        "steps": steps,
        "minutes": 0.1,
        "seed": 0,
    }
    world.close()
    path.parent.mkdir(parents=True, exist_ok=True)
    ppo.save_plain(path, ppo.policy_file(model, about))
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
LINE = 10  # of what is put in


def own_planner(path, line="pass"):
    """The file of a planner that steps on the spot and does something else before."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(PLANNER.format(line=line), "utf-8")
    return path


@pytest.fixture
def short_trials(tmp_path, monkeypatch):
    """A folder with a policy, 2 s for a trial, no figures: the command line takes a second."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", sys.path[:])  # a planner's folder is put there
    monkeypatch.setattr(robot_model, "CORES", 1)
    save_untrained(Path("results/pymunk/policy.pt"))
    monkeypatch.setattr(env, "FootstepWorld", partial(env.FootstepWorld, task=SHORT))
    drawn = {}  # what the figure would show

    def plot(robot, columns, path):
        drawn.update(columns)

    monkeypatch.setattr(evaluate, "plot_footsteps", plot)
    return drawn


def call(*arguments):
    """The script's main in this process; with evaluation.json and trials.csv in the folder out."""
    evaluate.main([*map(str, arguments), "--out", "out"])
    return json.loads(Path("out/evaluation.json").read_text("utf-8"))


def refused(*arguments):
    """The one line of a call that must be refused, before anything is written."""
    with pytest.raises(robot_model.InputError) as stopped:
        call(*arguments)
    (line,) = str(stopped.value).splitlines()
    assert not Path("out").exists(), "check everything first, then write"
    return line


@pytest.mark.parametrize("text, reason", [
    (None, "No such file"),
    ("", "its first line is ''"),
    ("x,y\n1,2\n", "its first line is 'x,y'"),
    ("x y yaw\n1 2 3\n", "its first line is 'xyyaw'"),
    ("x,y,yaw\n", "from 1 to 10000 lines"),
    ("x,y,yaw\n1,2\n", "line 2 has not as many cells"),
    ("x,y,yaw\n1,2,3\n1,2,3,4\n", "line 3 has not as many cells"),
    ("x,y,yaw\n1,two,3\n", "'two'"),
    ("x;y;yaw\n1.234,5;0;0\n", "'1.234.5'"),
    ("x,y,yaw\n1,2,3\n1,nan,3\n", "numbers below 1000"),
    ("x,y,yaw\n" + 10_001 * "0,0,0\n", "from 1 to 10000 lines"),
    ("x,y,yaw\n1e300,0,0\n", "numbers below 1000"),
    ("x,y,yaw\n\xe9\xe9,1,1\n", "can't decode"),
], ids=lambda text: repr(text)[:30])  # fmt: skip
def test_a_malformed_goals_file_is_one_line_that_says_what_is_wrong(short_trials, text, reason):
    if text is not None:
        Path("goals.csv").write_text(text, encoding="latin-1")
    message = refused("--goals", "goals.csv")
    assert "goals.csv: needs columns x, y, yaw and finite numbers" in message
    assert reason in message.split("(", 1)[1], "the last words name the line, or what is missing"


@pytest.mark.parametrize("text", [
    "\ufeffx,name,y,yaw\r\n1,a,-2.5,7\r\n\r\n1,a,-2.5,7",
    "x, y, yaw\n1, -2.5, 7\n 1 ,-2.5 ,7\n",
    "X,Y,Yaw\r1,-2.5,7\r1,-2.5,7\r",
    'x;y;"yaw";name\n1,0;-2,5;7;a,b\n1;-2.5;7,0;\n',
    "x\ty\tyaw\n1\t-2,5\t7\n1\t-2.5\t7\n",
    "x,y,yaw\n,,\n1,-2.5,7\n1,-2.5,7\n,,\n",
], ids=["BOM", "spaces", "capitals", "semicolons", "tabs", "empty rows"])  # fmt: skip
def test_goals_are_read_from_any_spreadsheet(tmp_path, text):
    path = tmp_path / "goals.csv"
    path.write_bytes(text.encode())
    goal = [1, -2.5, 7 - 2 * math.pi]
    close(evaluate.read_goals(path), [goal, goal], "the same goal twice is two trials")


@pytest.fixture
def one_robot():
    with closing(env.FootstepWorld(1, cores=1, task=SHORT)) as world:
        yield world


def test_your_own_policy_comes_first_and_rows_are_called_like_files(
    short_trials, one_robot, capsys
):
    save_untrained(Path("runs/pymunk/policy.pt"), steps=20)
    planners, facts, shown = evaluate.choose_planners(one_robot)
    assert (facts["file"], facts["steps"], shown) == ("runs/pymunk/policy.pt", 20, "policy")
    assert list(planners) == ["policy", "baseline_tuned", "baseline"]
    assert planners["baseline"].settings == B, "those of the paper"
    assert planners["baseline_tuned"].settings == evaluate.TUNED_BASELINE["pymunk"] != B
    files = map(Path, "first.pt a/policy.pt imu/policy.pt seed_1.pt mine.pt".split())
    policies = [save_untrained(file, imu="imu" in file.parts) for file in files]
    mine = [own_planner(name) for name in ("mine.py", "b/mine.py", "b/baseline.py")]
    capsys.readouterr()
    planners, facts, shown = evaluate.choose_planners(one_robot, policies, mine)
    names = "policy a/policy.pt imu/policy.pt seed_1 mine mine.py b/mine.py b/baseline.py"
    names += " baseline_tuned baseline"
    assert " ".join(planners) == names, "called like the file, by its path if that is taken"
    assert (facts["file"], shown) == ("first.pt", "mine.py"), "your own planner before the policies"
    assert [planners[name].columns for name in ("a/policy.pt", "imu/policy.pt")] == [20, 25]
    said = capsys.readouterr().out
    assert "note" not in said, "all of them were trained in this world"
    assert said.splitlines()[1].startswith("a/policy"), "say which file is judged"


WALK = env.walk_engine.TUNED["pymunk"]
ROBOT = robot_model.RobotModel()


@pytest.mark.parametrize("settings, said", [
    ({"walk": replace(WALK, foot_rise=0.03)}, f"walk: foot_rise 0.03, here {WALK.foot_rise}"),
    ({"walk": replace(WALK, reflex=0.0, half_ticks=30)},
     "walk: half_ticks 30, here 31; walk: reflex 0.0, here 0.05"),
    ({"spread": env.Spread(mass=0.2)}, "spread: mass 0.2, here 0.1"),
    ({"drift": (0.1, 0.0, 0.0)}, f"drift [0.1, 0.0, 0.0], here {[*env.DRIFT['pymunk']]}"),
    ({"robot": replace(ROBOT, torso=replace(ROBOT.torso, mass=4.0))},
     "robot: torso: mass 4.0, here 3.49"),
    ({"push": 0.4}, None), ({}, None)], ids=str)  # fmt: skip
def test_a_policy_of_another_world_walks_and_a_note_says_what_differs(
    one_robot, tmp_path, capsys, settings, said
):
    path = save_untrained(tmp_path / "policy.pt", **settings)
    planner, _ = evaluate.load_policy(path, one_robot)
    printed = capsys.readouterr().out
    note = f"note: {path.as_posix()} was trained with another {said}\n"
    assert printed == (note if said else "")
    evaluate.evaluate(planner, one_robot, evaluate.draw_trials(0, 1))


@pytest.mark.parametrize("flags, mention", [
    (["--policy", "text.py"], "text.py: damaged, or not written by 04_ppo.py"),
    (["--policy", "other.pt"], "other.pt: trained in mujoco; this is pymunk (with --mujoco mujoco"),
    (["--policy", "blind.pt"], "blind.pt: trained with another observation"),
    (["--planner", "missing.py"], "missing.py: no such .py file"),
    (["--planner", "text.py"], "text.py: defines no Planner"),
    (["--planner", "deaf.py"], "deaf.py: its class Planner has no method act"),
    (["--planner", "leaves.py"], "leaves.py: ends Python when it is read"),
    (["--robot", "text.py"], "text.py: defines no LIMITS"),
    (["--mujoco"], "results/mujoco/policy.pt: no such file; run stage 5 where the stages are"),
], ids=str)  # fmt: skip
def test_a_file_that_cannot_be_used_is_one_line(short_trials, flags, mention):
    save_untrained(Path("other.pt"), "mujoco")
    blind = ppo.load_plain(Path("results/pymunk/policy.pt"))
    blind["fits"]["observation"] = ["all"]
    ppo.save_plain(Path("blind.pt"), blind)
    Path("text.py").write_text("class Other: pass")
    Path("leaves.py").write_text("import sys\nsys.exit()")
    Path("deaf.py").write_text("class Planner:\n    def reset(self, num_robots): ...")
    assert mention.replace("/", os.sep) in refused(*flags).replace("/", os.sep)


@pytest.mark.parametrize(
    "line, rule",
    [
        ("return actions[:1]", r"of shape \(2, 6\)"),
        ("return None", r"of shape \(2, 6\)"),
        ("actions[1, 2] = np.nan", "must be finite"),
        ("actions[0, 0] = 1.01", "must lie between 0 and 1"),
        ("actions[0, 0] = -0.01", "must lie between 0 and 1"),
    ],
)
def test_a_wrong_action_names_the_file_and_the_rule(noisy, tmp_path, monkeypatch, line, rule):
    monkeypatch.setattr(sys, "path", sys.path[:])
    planner = evaluate.load_planner(own_planner(tmp_path / "mine.py", line))
    with pytest.raises(ValueError, match=f"mine.py: actions .*{rule}"):
        evaluate.evaluate(planner, noisy, to(np.zeros((2, 3))))


def test_a_planner_may_be_called_like_a_module_and_import_what_lies_beside_it(short_trials):
    Path("beside.py").touch()
    call("--planner", own_planner("tempfile.py", "import beside"), "--episodes", 1)


@pytest.mark.parametrize("error", ["KeyError", "OSError", "ValueError", "SystemError"])
def test_a_planner_s_own_error_keeps_its_traceback(short_trials, error):
    path = own_planner("mine.py", f"raise {error}('one of mine')")
    with pytest.raises(Exception, match="one of mine") as caught:
        call("--planner", path, "--episodes", 2)
    assert type(caught.value).__name__ == error
    last = traceback.extract_tb(caught.value.__traceback__)[-1]
    assert (Path(last.filename).name, last.lineno) == ("mine.py", LINE), "where it was raised"


def test_from_a_policy_file_to_the_table(short_trials, capsys):
    second = save_untrained(Path("second.pt"))
    mine = own_planner("mine.py", "actions[:, [0, 3]] += 0.3")  # it walks past the second goal
    Path("goals.csv").write_text("x,y,yaw\n0,0,0\n0.12,0,0\n")
    flags = "--goals goals.csv --friction 0.4 --policy results/pymunk/policy.pt".split()
    content = call(*flags, second, "--planner", mine)
    table = Path("out/table.md").read_text("utf-8")
    assert table in capsys.readouterr().out
    assert "paper" not in table, "the paper's rows are about its goals, not about yours"
    names = ["baseline", "baseline_tuned", "mine"]
    assert [*short_trials] == names, "yours goes before the policies"
    plot_footsteps(ROBOT, short_trials, Path("out/footsteps.png"))
    assert Path("out/footsteps.png").read_bytes().startswith(b"\x89PNG")
    assert (content["sim"], content["goals"], content["push"]) == ("pymunk", "goals.csv", 0.0)
    names = ["policy", "second", "mine", "baseline_tuned", "baseline"]
    pairs = [(row["planner"], row["reference"]) for row in content["ratios"]]
    assert pairs == [("policy", name) for name in names[1:] if name != "mine"], (
        "it is compared with all others that reached one of its goals"
    )
    rows = [(row["planner"], row["noise"]) for row in content["rows"]]
    assert rows == [(name, False) for name in names]
    _, *lines = Path("out/trials.csv").read_text("utf-8").splitlines()
    once, late = f"{PERIOD:.2f}", f"{3 * PERIOD:.2f}"  # [s]
    assert lines[0] == f"policy,no,,0,0,0.0,0.0,0.0,0.4,success,{once},2,yes,yes,{once}"
    assert lines[5] == f"mine,no,,0,1,0.12,0.0,0.0,0.4,timeout,{late},3,no,yes,{once}"


@pytest.mark.parametrize("name", [b"Zo\xeb.py", b"a$^$.py", b"a|b.py", b"a\nb.py"], ids=repr)
def test_a_planner_s_file_may_have_any_name(short_trials, name):
    try:
        mine = own_planner(os.fsdecode(name))
    except (OSError, UnicodeError):
        pytest.skip("there is no such name on this system")
    call("--planner", mine, "--episodes", 1)
    table = Path("out/table.md").read_text("utf-8")
    (row,) = (line for line in table.splitlines() if re.match(r"\| (Zo|a)", line))
    assert row.count("|") == 7, f"a name is one cell: {row}"
    plot_footsteps(ROBOT, short_trials, Path("out/footsteps.png"))  # a $ begins no formula


def test_a_file_that_another_program_keeps_open_costs_no_result(short_trials, capsys):
    said = r"\A.*trials\.csv: Access is denied\Z"
    with locked("trials.csv"), pytest.raises(robot_model.InputError, match=said):
        call("--episodes", 1)
    assert Path("out/table.md").read_text("utf-8") in capsys.readouterr().out, "print first"


def flags(**changes):
    """Parsed arguments, as `evaluate_all` needs them."""
    usual = {"sim": "pymunk", "noise": True, "friction": None, "push": 0.0, "robot": None}
    return argparse.Namespace(**usual | changes)


@pytest.fixture
def planners():
    """Two of ours, and one that counts as a user's own."""
    torch.manual_seed(0)
    spot = env.to_action(np.zeros((2, 3)), LIMITS)
    policy = evaluate.PolicyPlanner(ppo.ActorCritic(20, 6, first_action=spot))
    return {"policy": policy, "mine": Recorder(), "baseline": evaluate.BaselinePlanner()}


NEAR = {None: evaluate.Trials(np.array([[0.02, 0, 0], [0, 0.01, 0.05]]), 0)}


def same_results(found, want):
    assert [*found] == [*want], "rows in the order of the table, whoever walked them"
    for row, ended in want.items():
        for name, values in ended.items():
            equal(found[row][name], values, f"{row}: {name}")


def test_helpers_change_no_number_and_a_user_s_planner_walks_in_this_process(planners, capfd):
    want = evaluate.evaluate_all(flags(), NEAR, planners)
    here, worker = [], multiprocessing.get_context("spawn").Process(target=time.sleep, args=(60,))

    class Mine(Recorder):
        def reset(self, num_robots):
            here.append(os.getpid())
            super().reset(num_robots)

    worker.start()

    capfd.readouterr()
    found = evaluate.evaluate_all(flags(), NEAR, planners | {"mine": Mine()}, helpers=1)
    same_results(found, want)
    assert here == [os.getpid()] * 2
    worker.join(0.5)
    assert worker.is_alive(), "a process that a user's planner started is not ours to end"
    worker.kill()
    lines, errors = capfd.readouterr()
    assert errors == "" and len(lines.splitlines()) == 6, "a line for a row, and nothing else"
    assert lines.splitlines()[0].startswith("policy, goals own, noise no: success "), "it is first"


def test_rows_whose_helper_has_ended_are_walked_here(planners, monkeypatch):
    want = evaluate.evaluate_all(flags(), NEAR, planners)
    # It ends as soon as it begins, like one that the system kills.
    monkeypatch.setattr(evaluate, "silence", partial(os._exit, 1))
    same_results(evaluate.evaluate_all(flags(), NEAR, planners, helpers=3), want)


@pytest.mark.skipif(sys.platform == "win32", reason="there are no process groups")
# Helpers begin after half a second; after five they walk.
@pytest.mark.parametrize("seconds", [0.5, pytest.param(5.0, marks=pytest.mark.slow)])
def test_ctrl_c_is_one_line_and_ends_all_processes(tmp_path, seconds):
    command = [sys.executable, "-u", "05_evaluate.py", "--noise", "--out", str(tmp_path)]
    with subprocess.Popen(
        command,
        cwd=Path(evaluate.__file__).parent,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # A test that runs in the background has inherited that Ctrl-C is ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        process.stdout.readline()  # which policy: the walks begin
        time.sleep(seconds)
        os.killpg(process.pid, signal.SIGINT)  # as the terminal does
        _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (2, "\n05_evaluate.py: interrupted\n")
    end = time.monotonic() + 5
    with pytest.raises(ProcessLookupError):  # nobody of the group lives on
        while time.monotonic() < end:
            os.killpg(process.pid, 0)
            time.sleep(0.1)


def test_flags_of_the_command_line_reach_the_trials_and_are_told(short_trials, monkeypatch):
    pushes, evaluated = [], evaluate.evaluate

    def watched(planner, world, trials, watch=None):
        pushes.append(world.push)
        return evaluated(planner, world, trials, watch)

    monkeypatch.setattr(evaluate, "evaluate", watched)
    content = call(*"--noise --episodes 2 --seed 6 --far --friction 0.4 --push 0.3".split())
    assert pushes == [0.3] * 12 + [0.0] * 3, "twelve rows of the table, three walks of a figure"
    rows = [(row["goal_std_m"], row["noise"], row["planner"]) for row in content["rows"]]
    names = ["policy", "baseline_tuned", "baseline"]
    assert rows == [*itertools.product((0.5, 1.0), (False, True), names)], "far: a block of its own"
    assert [content[name] for name in ("seed", "friction", "push")] == [6, 0.4, 0.3]
    lines = Path("out/trials.csv").read_text("utf-8").splitlines()[1:]
    assert len(lines) == 24
    assert {(line.split(",")[3], line.split(",")[8]) for line in lines} == {("6", "0.4")}


OTHER_ROBOT = """
from importlib import import_module

ROBOT = import_module("01_robot_model").RobotModel(thigh_length=0.168)
WALK = import_module("02_walk_engine").TUNED["pymunk"]
LIMITS = import_module("03_env").StepLimits((-0.1, 0, -0.1), (0.1, 0.1, 0.1))
"""


def test_another_robot_walks_by_the_numbers_of_its_file(short_trials):
    Path("mine.py").write_text(OTHER_ROBOT, "utf-8")
    assert call("--robot", "mine.py", "--episodes", 1)["robot"] == "mine.py"
    with closing(evaluate.make_world(flags(robot=Path("mine.py"), friction=0.5), 1)) as world:
        assert world.engine.robot == replace(ROBOT, thigh_length=0.168, friction=0.5)
        assert world.limits.high == (0.1, 0.1, 0.1)


@pytest.mark.slow
def test_film_is_a_walk_in_real_time(short_trials, capfd):
    call("--gif", "--episodes", 1)
    assert " pictures/s]" in capfd.readouterr().err, "a bar"
    with PIL.Image.open("out/animation.gif") as film:
        frames, seconds = zip(*[
            (np.array(picture.convert("RGB"), np.int16), picture.info["duration"] / 1000)
            for picture in PIL.ImageSequence.Iterator(film)
        ])  # fmt: skip
    changed = (np.abs(np.diff(frames, axis=0)).max(-1) > 60).mean((1, 2))
    (moved,) = np.nonzero(changed > 0.001)  # less is dithering
    walk = sum(seconds[: moved[-1] + 1])
    close(walk, 3 * PERIOD, "three double steps", atol=0.15)
    assert sum(seconds) > walk + 1, "the end stays for a while"


def test_the_film_goes_to_three_goals_and_shows_one_push(tmp_path, monkeypatch):
    """What is drawn is left out; the time of every picture is in its title."""
    titles, pushed, goals, save = [], [], [], []

    def step(planner, world, robots, push):
        goals.append(world.goal[0].tolist())
        pushed.append(math.hypot(*push))
        arrived = np.array([len(pushed) % 4 == 0])  # after four double steps at every goal
        return double_step(planner, world, robots, push) | {"success": arrived}

    def watched(figure, pictures, path, seconds):
        save.append(seconds)
        titles.extend(figure.axes[0].get_title() for _ in pictures)

    double_step = evaluate.double_step
    monkeypatch.setattr(evaluate, "double_step", step)
    monkeypatch.setattr(evaluate, "save_film", watched)
    monkeypatch.setattr(env, "draw_scene", lambda *_: robot_model.camera_at())
    with closing(env.FootstepWorld(1, cores=1)) as world:
        evaluate.plot_tour(world, Recorder(), 0.1, tmp_path / "film.gif")
    equal(goals, np.repeat(evaluate.FILM_GOALS, 4, axis=0), "one after the other")
    close(pushed, np.eye(12)[6] * 0.1, "once, on the way to the second one")
    times = [float(re.search(r"(\d+\.\d) s", title)[1]) for title in titles]
    close(np.diff(times), save[0], "a picture is shown as long as its walk took", atol=0.11)
    close(times[-1], 12 * PERIOD, "no time is lost", atol=0.11)


@pytest.mark.parametrize("sim", ["pymunk", "mujoco"])
def test_a_picture_shows_the_chosen_footsteps_before_they_are_taken(sim):
    figure, axes = evaluate.plt.subplots()
    ahead, camera, feet = np.tile([0.06, 0.02, 0.1], (1, 2, 1)), robot_model.camera_at(), []

    class Ahead(Recorder):
        def act(self, view):
            return env.to_action(ahead, view.limits)

    with closing(env.FootstepWorld(1, sim, cores=1)) as world:
        world.reset([0], [default_rng(3)])
        for _ in range(3):
            result = evaluate.double_step(Ahead(), world, np.array([0]), [0.1, 0])
            for _ in evaluate.pictures(axes, world, feet, result["motion"], [0.1, 0]):
                bright = [p for p in axes.patches if p.get_facecolor() == (1, 1, 0, 1)]
                assert len(bright) == 2, "left and right"
        robot = world.engine.robot
        landed = robot_model.foot_poses(robot, world.torso, world.joints)[0]
        feet_of_marks = [*zip(bright, landed, (1, -1))]
        # The planar robot's legs cannot spread: its left foot lands nearer to the right one.
        for patch, pose, side in feet_of_marks[sim == "pymunk" :]:
            middle = [(robot.foot_front - robot.foot_back) / 2, side * robot.foot_outward]
            want = camera[1:, :2] @ (pose[:2] + robot_model.turned(middle, pose[2]))
            close(patch.get_xy()[:4].mean(0), want, "there the foot lands", atol=0.02)
    assert len(feet) == 3, "where the feet stood before each double step"
    evaluate.plt.close(figure)


@pytest.mark.parametrize("sim", ["pymunk", "mujoco"])
def test_a_push_and_its_arrow_have_one_direction(sim):
    """Of a robot that stands turned by 90°: on the plane it is pushed ahead, in 3-D along x."""
    figure, axes = evaluate.plt.subplots()
    pushes, robots, recorder = [], np.array([0]), Recorder()
    recorder.reset(1)
    with closing(env.FootstepWorld(1, sim, cores=1)) as world:
        run = world.simulator.run

        def watched(robots, plan, disturbance):
            pushes.append(disturbance.push[0].copy())
            return run(robots, plan, disturbance)

        world.simulator.run = watched
        motion = evaluate.double_step(recorder, world, robots, [0.2, 0])["motion"]
        motion.torso[..., 5] = np.pi / 2  # as if it were turned
        next(evaluate.pictures(axes, world, [], motion, [0.2, 0]))
    force = env.walk_engine.push_force(world.engine.robot, 0.2)
    close(pushes[0].sum(0), [5 * force, 0], "for five ticks")
    (arrow,) = axes.texts
    assert arrow.get_text() == "push: 0.2 m/s"
    way = np.subtract(arrow.xy, arrow.xyann)
    want = robot_model.camera_at()[1:, :2] @ ([0, 0.5] if sim == "pymunk" else [0.5, 0])
    close(way, want, "the arrow points where it is pushed", atol=1e-6)
    evaluate.plt.close(figure)


def test_the_robot_does_what_mouse_and_keys_say(short_trials, monkeypatch):
    figure, axes = evaluate.plt.subplots()
    world = env.FootstepWorld(1, cores=1)
    plans, falls, pictures, run = [], [], itertools.count(), world.simulator.run

    def watched(robots, plan, disturbance):  # is it pushed? with the reflex?
        plans.append((disturbance.push.any(), plan.reflex_gain.any()))
        motion = run(robots, plan, disturbance)
        return replace(motion, fell=np.array([bool(falls and falls.pop())]))

    def do(kind, name, *what):
        figure.canvas.callbacks.process(name, kind(name, figure.canvas, *what))

    def drag(start, end):
        for name, place in ("press", start), ("release", end):
            pixels = axes.transData.transform(robot_model.camera_at()[1:, :2] @ place)
            do(MouseEvent, f"button_{name}_event", *pixels, 1)

    def story():  # every `yield` is a double step
        drag((0.4, 0.2), (0.4, 0.5))
        assert (world.covariance == 1e8 * np.eye(3)).all(), (
            "what was estimated of the old goal is forgotten"
        )
        close(world.goal[0], [0.4, 0.2, math.pi / 2], "dragged along +y", atol=1e-3)
        for keys in (" r", "r", "p"):
            for key in keys:
                do(KeyEvent, "key_press_event", key)
            yield
        assert plans == [(False, True), (True, False), (False, True), (False, True)]
        assert axes.get_title().startswith("two, reflex on: "), "p: the next planner"
        drag((-0.2, 0.1), (-0.2, 0.1))
        goal = [-0.2, 0.1, world.pose[0, 2]]
        close(world.goal[0], goal, "a click: as it is turned now", atol=1e-3)
        drag((9.0, 9.0), (9.0, 9.5))
        falls.append(True)
        yield
        yield
        assert world.steps[0] == 1, "after a fall it begins anew"
        close(world.goal[0], goal, "to the same goal; off the map is none", atol=1e-3)
        evaluate.plt.close(figure)
        yield

    told = story()
    monkeypatch.setattr(world.simulator, "run", watched)
    monkeypatch.setattr(evaluate, "open_window", lambda: (figure, axes))
    # eight pictures for a double step
    monkeypatch.setattr(evaluate.plt, "pause", lambda _: next(pictures) % 8 or next(told))
    evaluate.play(world, {"one": Recorder(), "two": Recorder()}, 1e-9)
    assert not evaluate.plt.fignum_exists(figure.number), "the story did not come to its end"


def test_a_player_gets_the_world_of_the_command_line(short_trials, monkeypatch):
    def played(world, planners, speed):
        assert (world.friction[0], world.push, len(world.pose)) == (0.65, 0, 1)
        assert [*planners][0] == "mine" and speed > 0
        raise KeyboardInterrupt

    monkeypatch.setattr(evaluate, "play", played)
    with pytest.raises(KeyboardInterrupt):
        evaluate.main(["--play", "--friction", "0.65", "--planner", str(own_planner("mine.py"))])
