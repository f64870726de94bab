"""Stage 5: the baseline's equations, the statistics, the trials, planners, files, command line."""

import copy
import csv
import itertools
import json
import math
import os
import sys
import traceback
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
import torch
from matplotlib.backend_bases import MouseEvent

evaluate = import_module("05_evaluate")
env, ppo, robot_model = evaluate.env, evaluate.ppo, evaluate.robot_model
LIMITS = env.LIMITS["pymunk"]
B = evaluate.BaselineSettings()
OTHER = evaluate.BaselineSettings(0.3, 0.1, 0.2, 0.8, gain=0.5, turning_gain=2.0, far_m=0.4)
# By hand and not by the stages, which may be empty exercises when this module is imported:
HALF_STEP = 0.5 / env.walk_engine.TUNED["pymunk"].frequency  # [s]
TICK = robot_model.RobotModel().control_dt  # [s]
PERIOD = 2 * TICK * round(HALF_STEP / TICK)  # [s] a double step, in whole ticks
NEUTRAL = np.tile(np.divide(LIMITS.low, np.subtract(LIMITS.low, LIMITS.high)), 2)  # [6]

def view_of(*last_actions):
    """The View of robots that did these actions last."""
    actions = np.array(last_actions)
    return env.View(PERIOD, LIMITS, NEUTRAL.copy(), np.stack([actions, actions], 1),
                    np.zeros((len(actions), len(env.observation_table(imu=True))), np.float32))

STANDS = view_of(NEUTRAL)  # one robot

# ------------------------------------------------------------------------ the baseline's equations
def command(x, y, yaw=0.0, settings=B):
    return evaluate.velocity_command(np.array([[x, y, yaw]]), settings)[0]

def test_speed_limit_on_each_axis():
    for x, y, expected in ((5, 0, (0.12, 0)), (-5, 0, (-0.06, 0)), (0, 5, (0, 0.07)),
                           (0, -5, (0, -0.07))):
        np.testing.assert_allclose(command(x, y)[:2], expected, atol=1e-12, err_msg=(
            "forward 0.12, backward 0.06, sideways 0.07 m/s: is backward taken for forward?"))

def test_speed_far_away_is_on_the_edge_of_the_diamond():
    for beta in np.linspace(-np.pi, np.pi, 50):
        v_x, v_y, _ = command(3 * math.cos(beta), 3 * math.sin(beta))
        edge = abs(v_x) / (0.12 if v_x > 0 else 0.06) + abs(v_y) / 0.07
        assert edge == pytest.approx(1), (
            "|v_x| / x_max + |v_y| / y_max = 1: above 1 each axis is limited on its own (a box) or "
            "the limit is round (an ellipse); between the axes it is a straight line")
        turned_by = env.wrap(math.atan2(v_y, v_x) - beta)
        assert turned_by == pytest.approx(0, abs=1e-9), "limiting must not change the direction"

def test_speed_near_the_goal_is_gain_times_distance():
    hint = "v = min(gain·d, v_max): inside the limits the gain decides"
    np.testing.assert_allclose(command(0.03, -0.02), (0.03, -0.02, 0), atol=1e-12, err_msg=hint)
    half = command(0.03, -0.02, settings=replace(B, gain=0.5))
    np.testing.assert_allclose(half, (0.015, -0.01, 0), atol=1e-12, err_msg=hint)
    assert not command(0, 0).any(), "at the goal there is nothing to do"

def test_far_away_it_faces_the_goal_and_nearby_it_turns_like_the_goal():
    assert command(0, 1.01, 0.2)[2] == pytest.approx(0.3), "far: 0.3·β = 0.47 rad/s, limited to 0.3"
    assert command(1.01, 0, 0.5)[2] == pytest.approx(0), "far: the goal is straight ahead"
    assert command(1.01, -0.1, 0.5)[2] == pytest.approx(-0.3 * math.atan2(0.1, 1.01))
    assert command(0, 0.99, 0.5)[2] == pytest.approx(0.15), "near: turn to α = 0.5 rad, gain 0.3"
    assert command(0.1, 0, 3)[2] == pytest.approx(0.3), "near: limited to 0.3 rad/s"
    assert command(0.1, 0, -3)[2] == pytest.approx(-0.3), "the limit holds to both sides"
    around = command(0.1, 0, math.radians(350))[2]
    assert around == pytest.approx(0.3 * math.radians(-10)), "350° to the left are 10° to the right"

def test_speed_and_turning_follow_the_settings():
    hint = ("every limit and gain comes from `settings`, not from the default; and the gain comes "
            "before the limit: v = min(gain·d, v_max)")
    np.testing.assert_allclose(command(5, 0, settings=OTHER), (0.3, 0, 0), atol=1e-12, err_msg=hint)
    np.testing.assert_allclose(command(-5, 0, settings=OTHER)[:2], (-0.1, 0), atol=1e-12)
    np.testing.assert_allclose(command(0, 5, settings=OTHER), (0, 0.2, 0.8), atol=1e-12)
    assert command(0.3, 0, 0.2, OTHER)[2] == pytest.approx(0.4), "near: 2·α; " + hint
    assert command(0.5, 0, 0.2, OTHER)[2] == pytest.approx(0), "far begins at far_m = 0.4 m"

def test_speed_of_many_goals_is_that_of_each():
    goals = np.random.default_rng(0).normal(size=(50, 3)) * (1, 1, 2)
    together = evaluate.velocity_command(goals, OTHER)
    assert together.shape == (50, 3), "goals [n, 3] -> v_x, v_y, ω [n, 3]"
    alone = [command(*goal, settings=OTHER) for goal in goals]
    np.testing.assert_allclose(together, alone, err_msg="robots must not influence one another")

def test_the_filter_is_the_limit_of_small_steps():
    start, target, seconds, tau = 0.02, 0.12, 0.6, 1.0
    exact = evaluate.low_pass(start, target, seconds, tau)
    previous = np.inf
    for rate in (20, 200, 2000):  # [Hz] Euler steps of dv/dt = (v_cmd − v) / τ
        v = start
        for _ in range(round(seconds * rate)):
            v += (target - v) / tau / rate
        error = abs(v - exact)
        assert error < 0.2 * previous, "v ← v + (1 − exp(−t/τ))·(v_cmd − v): is the sign right?"
        previous = error
    assert error < 1e-4
    twice = evaluate.low_pass(evaluate.low_pass(start, target, 0.3, tau), target, 0.3, tau)
    assert twice == pytest.approx(exact), "two halves of a step must equal one whole step"
    assert evaluate.low_pass(start, target, seconds, 0) == target, "τ = 0: no filter, and no 1 / 0"

def test_velocities_become_mirrored_footsteps():
    velocities = np.array([[0.12, 0, 0], [0, 0.06, 0], [0, -0.06, 0], [0, 0, 0.2]])
    expected = [[[0.03, 0, 0], [0.03, 0, 0]], [[0, 0.03, 0], [0, 0, 0]],
                [[0, 0, 0], [0, 0.03, 0]], [[0, 0, 0.05], [0, 0, -0.05]]]
    ahead = "forward: half the period's way per single step, so both feet share it"
    aside = ("sideways: one foot takes it all, the left one to the left and the right one to the "
             "right, and outward is positive for both; the other one follows with 0")
    turn = "outward is positive for both feet: y and yaw of the right foot are mirrored"
    steps = evaluate.velocity_to_footsteps(velocities, period=0.5)
    assert np.shape(steps) == (4, 2, 3), "velocities [n, 3] -> footsteps [n, 2, 3]"
    for i, (want, hint) in enumerate(zip(expected, (ahead, aside, aside, turn))):
        alone = evaluate.velocity_to_footsteps(velocities[i : i + 1], period=0.5)[0]
        np.testing.assert_allclose(alone, want, atol=1e-12, err_msg=hint)
        np.testing.assert_allclose(steps[i], alone, atol=1e-12, err_msg=(
            "robots must not influence one another"))

@pytest.mark.parametrize("velocity", [(0.1, 0, 0), (-0.05, 0, 0), (0, 0.06, 0), (0, -0.06, 0),
                                      (0, 0, 0.3), (0, 0, -0.3)])
def test_planned_footsteps_move_the_feet_at_that_velocity(velocity):
    engine = env.walk_engine.WalkEngine(1, env.walk_engine.TUNED["pymunk"], planar=True)
    footsteps = evaluate.velocity_to_footsteps(np.array([velocity]), engine.period)
    for _ in range(2):  # the second double step begins where the first one ended
        _, feet = engine.plan(footsteps, np.array([0]))  # [1, T + 1, 2, 4]
    middle = feet[0][:, :, [0, 1, 3]].mean(1)  # [T + 1, 3] between the feet
    moved = (middle[-1] - middle[0]) / engine.period
    assert moved[2] == pytest.approx(velocity[2], abs=1e-9), "wrong turning rate"
    if velocity[2] == 0:
        np.testing.assert_allclose(moved, velocity, atol=1e-9, err_msg=(
            "forward: half the period's way per single step; sideways: all of it by one foot"))

def test_the_baseline_stays_within_the_step_limits():
    planner = evaluate.BaselinePlanner(evaluate.BaselineSettings(9.0, 9.0, 9.0, 9.0, gain=9.0))
    planner.reset(1)
    action = planner.act(STANDS, np.array([0]), np.array([[-3.0, -3.0, -3.0]]))
    assert action.shape == (1, 6) and (action >= 0).all() and (action <= 1).all()

def test_only_the_first_command_of_a_trial_is_not_filtered():
    planner, robot = evaluate.BaselinePlanner(), np.array([1])
    ahead, aside = np.array([[5.0, 0.0, 0.0]]), np.array([[0.0, 5.0, 0.0]])
    share = 1 - math.exp(-PERIOD / 1.0)  # τ = 1 s
    changed = (0.12 * (1 - share), 0.07 * share, 0.3 * share)
    for begins, goal, velocity, hint in (
            (True, ahead, (0.12, 0, 0), "the filter smooths changes; before the first command "
             "there is none"),
            (False, aside, changed, "the second command"),
            (True, aside, (0, 0.07, 0.3), "after a reset the last trial is forgotten")):
        if begins:
            planner.reset(2)
        planner.act(STANDS, robot, goal)
        np.testing.assert_allclose(planner.velocity[1], velocity, atol=1e-12, err_msg=hint)
        assert np.isnan(planner.velocity[0]).all(), "robot 0 was not asked, only robot 1"

# ------------------------------------------------------------------------ statistics
def test_wilson_interval():
    hint = "Wilson: (p + z²/2n ± z·√(p·(1 − p)/n + z²/4n²)) / (1 + z²/n), z = 1.96 for 95 %"
    assert evaluate.wilson(5, 10) == pytest.approx([0.2366, 0.7634], abs=1e-4), hint
    assert evaluate.wilson(490, 500) == pytest.approx([0.9636, 0.9891], abs=1e-4), hint
    low, high = evaluate.wilson(500, 500)
    assert high == pytest.approx(1) and 0.99 < low < 1, "500 of 500 does not prove 100 %"
    assert evaluate.wilson(0, 500) == pytest.approx([1 - high, 1 - low]), "not symmetric"

def trials(outcomes, times, still_there=None):
    """Without still_there: all successes are. Somebody times out who was there once, after 8 s."""
    reached, times = np.array(outcomes) == "success", np.array(times, float)
    once = np.where(reached, times, 8.0 * (np.array(outcomes) == "timeout"))
    return {"outcome": np.array(outcomes), "time": times,
            "still_there": reached if still_there is None else np.array(still_there),
            "reached_once": once > 0, "time_once": once}

FOUR = trials(["success", "success", "fall", "timeout"], [4, 6, 1, 100], [1, 0, 0, 0])

def row_of(planner, noise, std, ended=FOUR):
    return evaluate.summary(planner, noise, std, ended, env.Task())

def test_time_ratio_uses_only_goals_that_both_reached():
    ours = trials(["success", "success", "fall"], [5, 10, 1])
    theirs = trials(["success", "success", "success"], [10, 20, 100])
    ratio, (low, high), goals = evaluate.time_ratio(ours, theirs)
    assert (ratio, goals) == (0.5, 2), "a fall's time must not count as a fast success"
    assert low == high == 0.5, "paired: a goal's difficulty cancels out, resample goals, not times"
    far_ones = evaluate.time_ratio(trials(["success"] * 2, [5, 30]),
                                   trials(["success"] * 2, [10, 20]))
    assert far_ones[0] == pytest.approx(35 / 30), "a ratio of the means, not a mean of the ratios"
    fell, reached = trials(["fall"], [1]), trials(["success"], [10])
    assert evaluate.time_ratio(fell, reached) == (None, None, 0), "no goal in common: no ratio"

def test_time_ratio_s_interval_covers_the_truth():
    """90 goals with another ratio each: about 95 of 100 such samples must contain the mean."""
    rng, covered = np.random.default_rng(0), []
    for _ in range(200):
        theirs = rng.uniform(5, 30, 90)
        ours = theirs * rng.uniform(0.3, 0.7, 90)  # 0.5 on average, whatever the goal
        _, (low, high), _ = evaluate.time_ratio(trials(["success"] * 90, ours),
                                                trials(["success"] * 90, theirs), resamples=300)
        covered.append(low <= 0.5 <= high)
    assert 0.89 <= np.mean(covered) <= 0.99, "2.5 and 97.5 % of resampled ratios of the means"

def test_summary_counts_episodes_and_times_successes():
    row = row_of("policy", False, 0.5)
    assert (row["success"], row["fall"], row["timeout"]) == (0.5, 0.25, 0.25)
    assert row["success_ci95"] == [round(edge, 4) for edge in evaluate.wilson(2, 4)]
    assert (row["time_mean"], row["time_std"]) == (5, 1), "a mean over the successes only"
    assert row["still_there"] == 0.5, "a share of the successes, not of the episodes"
    assert row["reached_once"] == 0.75, "by the paper's rule: at the goal after one double step"
    assert row["time_once_mean"] == 6, "(4 + 6 + 8) / 3 s, of all who were there once"
    assert row["time_once_std"] == pytest.approx(math.sqrt(8 / 3), abs=1e-3)
    assert (row["goal_std_m"], row["episodes"]) == (0.5, 4)
    noisy = row_of("policy", True, None)
    assert "noise_m" not in row and noisy["noise_m"] == 0.05 and noisy["goal_std_m"] is None

def test_summary_without_a_success_is_valid_json():
    row = row_of("policy", True, 0.5, trials(["fall", "fall"], [1, 100]))
    assert row["success"] == row["reached_once"] == 0 and row["fall"] == 1
    for name in ("time_mean", "time_std", "time_once_mean", "time_once_std", "still_there"):
        assert row[name] is None, f"{name}: no success: no mean, and not 0 or nan"
    json.dumps(row, allow_nan=False)
    assert "none" in evaluate.table([row], [])

def test_ratios_compare_every_pair_under_the_same_noise_and_spread():
    fast, slow = trials(["success"] * 2, [4, 6]), trials(["success"] * 2, [8, 12])
    never = trials(["timeout"] * 2, [100, 100])
    runs = {("policy", False, 0.5): fast, ("mine", False, 0.5): never,
            ("baseline", False, 0.5): slow, ("policy", True, 0.5): slow,
            ("baseline", True, 0.5): slow, ("policy", False, 1.0): slow,
            ("search", False, 1.0): fast, ("policy", False, None): fast}
    found = {(r["planner"], r["reference"], r["noise"], r["goal_std_m"]): r["time_ratio"]
             for r in evaluate.compare(runs)}
    assert found == {
        ("policy", "baseline", False, 0.5): 0.5, ("baseline", "policy", False, 0.5): 2.0,
        ("policy", "baseline", True, 0.5): 1.0, ("baseline", "policy", True, 0.5): 1.0,
        ("policy", "search", False, 1.0): 2.0, ("search", "policy", False, 1.0): 0.5}, (
            "`mine` reached nothing, so it has no ratio; and nobody else met the goals of None")

def tables_in(text):
    """The cells [table, row, column] of Markdown tables, without the line below each head."""
    blocks = [block.splitlines() for block in text.split("\n\n")]
    tables = [[[cell.strip() for cell in line.strip().strip("|").split("|")] for line in lines]
              for lines in blocks if lines[0].startswith("|")]
    return [[head, *rows] for head, _, *rows in tables]

def test_table_has_the_paper_s_rows_in_a_table_of_their_own():
    near = [row_of(name, True, 0.5) for name in ("policy", "mine")]
    others = [row_of("policy", True, 1.0), row_of("policy", True, None)]
    ours, once = tables_in(evaluate.table(near + others, []))
    for table in (ours, once):
        assert len({len(line) for line in table}) == 1, "every row has a cell for every column"
    assert [line[:3] for line in ours[1:]] == [
        ["0.5 m", "yes", "policy"], ["0.5 m", "yes", "mine"], ["1.0 m", "yes", "policy"],
        ["own", "yes", "policy"]]
    assert ours[1][3:] == ["0.500 [0.150, 0.850]", "0.250", "0.250", "5.00 ± 1.00", "0.500"]
    assert "paper" not in str(ours), "its success means something else: not in the same column"
    assert once[1:] == [
        ["yes", "policy", "ours", "0.750", "0.000", "0.250", "6.00 ± 1.63"],
        ["yes", "policy", "paper", "0.978", "0.000", "0.022", "6.35 ± 2.23"]], (
            "Table II, with noise, below ours by the paper's rule; of other planners, of goals "
            "twice as far and of yours it says nothing")
    assert len(tables_in(evaluate.table(near, [], {}))) == 1
    assert len(tables_in(evaluate.table(others, []))) == 1, "no empty table"

def test_table_ends_with_the_ratios_of_the_first_planner():
    ratio = {"planner": "policy", "reference": "baseline", "noise": True, "goal_std_m": 1.0,
             "goals": 7, "time_ratio": 0.5, "time_ratio_ci95": [0.4, 0.6]}
    own = ratio | {"goal_std_m": None, "noise": False}
    other = ratio | {"planner": "baseline", "reference": "policy", "time_ratio": 2.0}
    table = tables_in(evaluate.table([row_of("policy", True, 1.0)], [ratio, own, other]))[-1]
    assert table[1:] == [
        ["1.0 m", "yes", "policy", "baseline", "0.500 [0.400, 0.600]", "7"],
        ["own", "no", "policy", "baseline", "0.500 [0.400, 0.600]", "7"]], (
            "those of the other planners are in evaluation.json")

# ------------------------------------------------------------------------ trials
class Recorder:
    """Steps on the spot and remembers what it was told."""

    def reset(self, num_robots):
        self.measured = []

    def act(self, view, robots, measured):
        self.measured.append(measured.copy())
        return np.tile(view.neutral_action, (len(robots), 1))

class Wild(Recorder):
    def act(self, view, robots, measured):
        return 0 * super().act(view, robots, measured) + [0.7, 0.3, 0.5, 0.7, 0.3, 0.5]

class Hasty(Recorder):
    """As long a step as it can, forward or backward, until it falls."""

    def act(self, view, robots, measured):
        actions = super().act(view, robots, measured)
        actions[:, [0, 3]] = measured[:, :1] > 0
        return actions

SHORT = env.Task(time_limit=2.0)  # three decisions are enough

@pytest.fixture(scope="module")
def world():
    world = env.FootstepWorld(16, cores=1, task=SHORT)
    yield world
    world.close()

def to(goals):
    """Trials with these goals [n, 3]."""
    return replace(evaluate.draw_trials(0, len(goals)), goals=np.array(goals, float))

def first_noise(planner, world, asked):
    evaluate.evaluate(planner, world, asked, noise=True)
    noise = planner.measured[0] - asked.goals
    noise[:, 2] = env.wrap(noise[:, 2])
    return noise

def bodies(world, count):
    """What makes the first robots differ: masses, gains of the motors, delays."""
    return np.column_stack([world.sim.masses, world.sim.gain, world.sim.delay])[:count]

def test_noise_of_a_goal_depends_on_neither_planner_nor_number(world):
    six, two = evaluate.draw_trials(3, 6), evaluate.draw_trials(3, 2)
    np.testing.assert_array_equal(six.goals[:2], two.goals)
    noise = first_noise(Recorder(), world, six)
    hint = "one generator per goal and one `world.measure` per decision"
    np.testing.assert_array_equal(noise, first_noise(Wild(), world, six), err_msg=hint)
    np.testing.assert_array_equal(noise[:2], first_noise(Recorder(), world, two), hint)
    assert len(np.unique(noise)) == noise.size, "goals must not share their noise"
    dice = env.stream("evaluation", 3, 0).spawn(len(env.PURPOSES))[env.PURPOSES.index("noise")]
    np.testing.assert_allclose(noise[0], dice.normal(size=3) * 0.05, err_msg=(
        "the goal is measured more than once for a decision"))
    drawn = (six.goals / [1, 1, math.pi / 2])[0]
    assert not np.allclose(noise[0] / 0.05, drawn), "goals and noise come from the same generator"
    other = first_noise(Recorder(), world, replace(six, purpose="tuning"))
    assert not np.isclose(noise, other).any(), "nobody is tuned on what will be evaluated"

def test_far_trials_are_near_ones_with_the_goal_twice_as_far(world):
    near, far = evaluate.draw_trials(3, 6), evaluate.draw_trials(3, 6, far=True)
    np.testing.assert_allclose(far.goals, near.goals * (2, 2, 1), err_msg="σ = 1 m, not 0.5 m")
    noise, body = first_noise(Recorder(), world, near), bodies(world, 6)
    ground = world.friction[:6].copy()
    np.testing.assert_allclose(first_noise(Recorder(), world, far), noise, atol=1e-12)
    np.testing.assert_array_equal(world.friction[:6], ground, "only the goal may differ")
    np.testing.assert_array_equal(bodies(world, 6), body, "only the goal may differ")
    assert len(np.unique(body[:, 0])) == 6, "every trial has a body of its own"

def test_friction_is_drawn_for_every_trial_or_the_same_for_all(world):
    drawn = evaluate.evaluate(Recorder(), world, evaluate.draw_trials(3, 6))["friction"]
    model, spread = world.engine.robot.friction, world.spread.friction
    assert len(np.unique(drawn)) == 6 and (np.abs(drawn - model) <= spread).all()
    body, asked = bodies(world, 6), evaluate.draw_trials(3, 6, friction=0.45)
    assert (evaluate.evaluate(Recorder(), world, asked)["friction"] == 0.45).all()
    ground = [shape.friction for space in world.sim.spaces[:6]
              for shape in space.shapes if type(shape).__name__ == "Segment"]
    assert ground == [0.45] * 6, "the simulator must know of it"
    np.testing.assert_array_equal(bodies(world, 6), body, "the bodies remain those that were drawn")

@pytest.mark.parametrize("noise, settings", [
    (True, {}), (False, {"far": True}), (True, {"friction": 0.9})], ids=str)
def test_lines_of_trials_csv_repeat_those_very_trials(world, tmp_path, monkeypatch, noise,
                                                      settings):
    monkeypatch.setattr(world, "task", env.Task(time_limit=7.0))  # time enough to fall
    path, asked = tmp_path / "trials.csv", evaluate.draw_trials(5, 8, **settings)
    first = evaluate.evaluate(Hasty(), world, asked, noise)
    ends = world.pose[:8].copy()
    assert len(np.unique(ends[:, 0])) == 8, "every trial should end elsewhere"
    evaluate.write_trials(path, {0.5: asked}, {(name, noise, 0.5): first for name in "ab"})
    head, *lines = path.read_text().splitlines()
    chosen = [6, 1, 2, 7]
    path.write_text("\n".join([head, *(lines[i] for i in chosen), lines[8 + 1]]))  # 1 of b, too
    again = evaluate.read_trials(path, seed=0, friction=np.nan)
    assert again.number.tolist() == chosen, "as in the file, a trial of several planners once"
    np.testing.assert_array_equal(again.goals, asked.goals[chosen], "to the last bit")
    second = evaluate.evaluate(Hasty(), world, again, noise)
    for name, values in first.items():
        np.testing.assert_array_equal(second[name], values[chosen], err_msg=(
            f"{name}: a trial is its goal, seed, number and μ, not its line in the file"))
    np.testing.assert_array_equal(world.pose[:4], ends[chosen], "to the last bit")

def test_outcomes_are_exclusive_and_deterministic(world):
    asked = to([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])  # where it stands; too far for 2 s
    one, two = (evaluate.evaluate(evaluate.BaselinePlanner(), world, asked) for _ in range(2))
    assert one["outcome"].tolist() == ["success", "timeout"]
    assert one["still_there"].tolist() == [True, False], "only a success can be still there"
    assert one["time"][0] == pytest.approx(PERIOD), "that of the first of the two at the goal"
    assert one["steps"].tolist() == [2, 3], "three double steps fit into 2 s; a fourth is late"
    for key in one:
        np.testing.assert_array_equal(one[key], two[key], err_msg="same seed, same numbers")

def test_a_planner_that_scribbles_into_its_view_changes_nothing(world):
    class Scribbler(Wild):
        def act(self, view, robots, measured):
            actions = super().act(view, robots, measured)
            for array in (view.neutral_action, view.actions, view.observation, measured, robots):
                array[:] = 0.9
            return actions

    runs = []
    for planner in (Wild(), Scribbler()):
        result = evaluate.evaluate(planner, world, to(np.zeros((4, 3))), noise=True)
        state = (world.pose, world.actions, world.goal, world.neutral_action)
        runs.append(copy.deepcopy([*result.values(), *state, *planner.measured]))
    for honest, scribbled in zip(*runs):
        np.testing.assert_array_equal(honest, scribbled, "a View holds copies, not the world")

AWAY, NEARBY, TWISTED = (0.5, 0, 0), (0.06, 0, 0), (0, 0, math.radians(11))
THERE = (0.02, -0.03, math.radians(9))  # 3.6 cm and 9° from the goal: inside
FALLS = "falls"
ENDINGS = {  # poses after each double step, seen from the goal; which one was the first inside?
    "stays": ((THERE, THERE, THERE, THERE), 1),
    "arrives later": ((AWAY, THERE, THERE, THERE, THERE), 2),
    "sways and returns": ((THERE, THERE, NEARBY, THERE), 1),
    "rolls on by 6 cm": ((THERE, THERE, THERE, NEARBY), 1),
    "turns on by 11°": ((THERE, THERE, THERE, TWISTED), 1),
    "falls afterwards": ((THERE, THERE, FALLS, THERE), 1),
    "falls at last": ((THERE, THERE, THERE, FALLS), 1),
    "passes by": ((THERE, AWAY, THERE), 1),
    "arrives too late": ((AWAY, AWAY, THERE, THERE), 3),
    "never arrives": ((AWAY, NEARBY, TWISTED, THERE), 0),
    "falls before it arrives": ((AWAY, FALLS, THERE), 0),
    "falls instead of staying": ((THERE, FALLS, THERE), 1),
    "lies at the goal": ((FALLS, THERE, THERE), 0),
}

def physics_by_heart(world, monkeypatch, endings):
    """What `evaluate` finds; (actions, robots) of every double step; the planner."""
    done, asked, planner, step = np.zeros(len(endings), int), [], Wild(), world.step

    def run(trajectory, robots):
        ends = [endings[i][done[i]] for i in robots]
        torso = np.zeros((len(robots), trajectory.joints.shape[1] - 1, 6))
        torso[:, -1, [0, 1, 5]] = [THERE if end is FALLS else end for end in ends]
        done[robots] += 1
        return robot_model.Motion(torso, trajectory.joints[:, 1:], torso[:, -1, :3],
                                  np.array([end is FALLS for end in ends]))

    def watched_step(actions, robots):
        asked.append((np.array(actions), list(robots)))
        return step(actions, robots)

    monkeypatch.setattr(world.sim, "run", run)
    monkeypatch.setattr(world, "step", watched_step)
    goals = to(np.zeros((len(endings), 3)))
    return evaluate.evaluate(planner, world, goals, noise=True), asked, planner

def test_success_is_to_be_inside_twice_in_a_row(world, monkeypatch):
    poses, first = zip(*ENDINGS.values())
    found, asked, planner = physics_by_heart(world, monkeypatch, poses)
    assert found["outcome"].tolist() == ["success"] * 7 + ["timeout"] * 3 + ["fall"] * 3
    assert found["outcome"].dtype == object, "another OUTCOME must have room for all its letters"
    assert found["steps"].tolist() == [2, 3, *[2] * 5, 3, 3, 3, 2, 2, 1], (
        "they end with the trial, not with the two double steps after it")
    first = np.array(first)  # 0: never inside
    ended = np.where(found["outcome"] == "success", first, found["steps"])
    np.testing.assert_allclose(found["time"], ended * world.engine.period, err_msg=(
        "a success has the time of the first of the two double steps"))
    np.testing.assert_array_equal(found["reached_once"], first > 0, err_msg=(
        "by the paper's rule: once inside, whatever comes then; a fall is not inside"))
    np.testing.assert_allclose(found["time_once"], first * world.engine.period)

    for name, outcome, still_there in zip(ENDINGS, found["outcome"], found["still_there"]):
        assert still_there == (name in ("stays", "arrives later", "sways and returns")), (
            f"{name}: {outcome}; inside and standing after two more double steps?")
    (first, robots), (second, standing) = asked[-2:]
    assert robots == list(range(7)), "every success is watched for two more double steps"
    assert standing == [0, 1, 2, 3, 4, 6], "who fell meanwhile does not walk on"
    for actions in (first, second):
        expected = np.tile(world.neutral_action, (len(actions), 1))
        np.testing.assert_allclose(actions, expected, err_msg="in place: the planner is not asked")
    assert len(planner.measured) == 3, "one measurement a decision, none afterwards"

def test_nobody_may_be_left_for_the_last_double_step(world, monkeypatch):
    found, asked, _ = physics_by_heart(world, monkeypatch, [(THERE, THERE, FALLS)])
    assert found["outcome"].tolist() == ["success"] and not found["still_there"].any()
    assert len(asked) == 3, "nobody stands, so nobody steps"

def test_the_recorded_walk_is_the_measured_one(world):
    walk, = evaluate.record(Recorder(), world, to([[1.0, 0.0, 0.0]]))
    steps = len(walk["feet"])
    ticks = steps * 2 * world.engine.half_ticks
    assert walk["torso"].shape == (ticks, 6) and walk["joints"].shape == (ticks, 12)
    np.testing.assert_array_equal(walk["torso"][-1, [0, 1, 5]], world.pose[0], err_msg=(
        "the picture must show the simulator's pose, not the commanded one"))

def test_recorded_feet_follow_from_measured_torso_and_joints(monkeypatch):
    """If physics does exactly what was planned, the feet are exactly where they were planned."""
    world, moved = env.FootstepWorld(1, "mujoco", cores=1, task=SHORT), np.array([0.3, -0.2, 0.5])

    def run(trajectory, robots):
        torso, place = trajectory.trunk[:, 1:].copy(), trajectory.trunk[:, 1:, [0, 1, 5]]
        torso[..., [0, 1, 5]] = robot_model.compose(np.broadcast_to(moved, place.shape), place)
        nobody = np.zeros(len(robots), bool)
        return robot_model.Motion(torso, trajectory.joints[:, 1:], np.zeros((1, 3)), nobody)

    monkeypatch.setattr(world.sim, "run", run)
    walk, = evaluate.record(Wild(), world, to([[3.0, 0.0, 0.0]]))
    world.close()
    planned = robot_model.compose(np.tile(moved, (1, 2, 1)), world.engine.feet)[0]  # [2, 3]
    np.testing.assert_allclose(walk["feet"][-1], planned, atol=1e-6, err_msg=(
        "left and right: x, y of the ankle's projection [m], yaw [rad]"))

@pytest.mark.parametrize("imu, seen", [(False, 20), (True, 25)])
def test_the_policy_does_what_its_mean_says_about_what_it_sees(imu, seen):
    torch.manual_seed(0)
    model, view = ppo.ActorCritic(seen, 6), view_of(NEUTRAL, NEUTRAL)
    view.observation[:] = np.random.default_rng(0).uniform(-1, 1, view.observation.shape)
    planner = evaluate.PolicyPlanner(model, imu)
    planner.reset(2)
    found = planner.act(view, np.arange(2), np.zeros((2, 3)))
    np.testing.assert_array_equal(found, model.decide(view.observation[:, :seen]), err_msg=(
        "the IMU's rows are the last ones"))

# ------------------------------------------------------------------------ files
def save_untrained(path, sim="pymunk", imu=False, steps=10):
    """A policy that steps on the spot whatever it sees: nearly its first one."""
    torch.manual_seed(0)
    neutral = env.to_action(np.zeros((2, 3)), env.LIMITS[sim])
    model = ppo.ActorCritic(len(env.observation_table(imu)), 6, first_action=neutral)
    path.parent.mkdir(parents=True, exist_ok=True)
    ppo.save_policy(path, model, {"fits": env.fingerprint(sim, imu), "imu": imu, "steps": steps,
                                  "minutes": 0.1, "seed": 0, "config": {"sharpest": 1.0}})
    return path

PLANNER = """
import numpy as np

class Planner:
    def reset(self, num_robots):
        pass

    def act(self, view, robots, measured):
        actions = np.tile(view.neutral_action, (len(robots), 1))
        {line}
        return actions
"""
LINE = 10  # of what is put in

def own_planner(path, line="pass"):
    """The file of a planner that steps on the spot and does something else before."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(PLANNER.format(line=line), encoding="utf-8")
    return path

@pytest.fixture
def short_trials(tmp_path, monkeypatch):
    """An empty folder but for a policy, 2 s for a trial, no figures: the command line in a second.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", sys.path[:])  # a planner's folder is put there
    monkeypatch.setattr(env, "FootstepWorld", partial(env.FootstepWorld, task=SHORT, cores=1))
    monkeypatch.setattr(evaluate, "plot_footsteps", lambda *_: None)
    save_untrained(Path("results/pymunk/policy.pt"))

def call(*arguments):
    """The script's main in this process; with evaluation.json and trials.csv in the folder out."""
    evaluate.main([*map(str, arguments), "--out", "out"])
    return json.loads(Path("out/evaluation.json").read_text(encoding="utf-8"))

def refused(capsys, *arguments):
    """The one line on stderr of a call that must be refused, before anything is written."""
    with pytest.raises(SystemExit) as stopped:
        call(*arguments)
    assert stopped.value.code == 2, "bad input ends with exit code 2"
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1, f"one clear line: {lines}"
    assert not Path("out").exists(), "check everything first, then write"
    return lines[0]

def read(path, text, friction=np.nan):
    """The Trials of a file with that text; without a column of its own the seed is 5."""
    path.write_bytes(text.encode())
    return evaluate.read_trials(path, 5, friction)

@pytest.mark.parametrize("text", [
    "", "x,y,yaw\n", "1,2,3\n", "x,y\n1,2\n", "x,y,yaw\n1,2\n", "x,y,yaw\n1,2,3,4\n",
    "x,y,yaw\n1,two,3\n", "x,y,yaw\n1,2,\n", "x,y,yaw\n1,2,3\n1,nan,3\n", "x,y,yaw\n1,2,inf\n",
    "x,y,yaw\n" + "".join(f"{i},0,0\n" for i in range(10_001)), "x,y,yaw\n\xe9\xe9,1,1\n", None],
    ids=lambda text: repr(text)[:30])
def test_a_malformed_goals_file_is_one_line(short_trials, capsys, text):
    if text is not None:
        Path("goals.csv").write_text(text, encoding="latin-1")
    message = refused(capsys, "--goals", "goals.csv")
    assert "goals.csv: needs columns x, y, yaw and finite numbers" in message

def test_plain_goals_are_trials_of_this_seed_line_by_line(tmp_path):
    found = read(tmp_path / "goals.csv", "x,y,yaw\n1,2,0.5\n1,2,0.5\n0,0,0\n")
    assert (found.seed.tolist(), found.number.tolist()) == ([5, 5, 5], [0, 1, 2]), (
        "the same goal twice is two trials, with another ground and body each")
    assert np.isnan(found.friction).all(), "to be drawn"
    spreadsheet = read(tmp_path / "goals.csv", "\ufeffX ,name,y,yaw\r\n1,a,-2.5,7\r\n\r\n")
    np.testing.assert_allclose(spreadsheet.goals, [[1, -2.5, 7 - 2 * math.pi]])

def test_lines_that_name_their_trial_are_that_trial(tmp_path):
    text = ("planner,seed,trial,x,y,yaw,mu\npolicy,3,7,1,2,0.5,0.8\npolicy,3,2,0,1,0,0.9\n"
            "baseline,3,7,1,2,0.5,0.8\nbaseline,4,7,1,2,0.5,0.8\n")
    found = read(tmp_path / "trials.csv", text)
    assert found.seed.tolist() == [3, 3, 4] and found.number.tolist() == [7, 2, 7], "each once"
    assert found.friction.tolist() == [0.8, 0.9, 0.8] and found.purpose == "evaluation"
    assert read(tmp_path / "trials.csv", text, friction=0.4).friction.tolist() == [0.4] * 3, (
        "--friction: what the user says goes before what the file says")

# ------------------------------------------------------------------------ which planners
def test_your_own_policy_goes_before_the_shipped_one(short_trials):
    save_untrained(Path("results/mujoco/policy.pt"), "mujoco")
    save_untrained(Path("runs/pymunk/policy.pt"), steps=20)
    for sim, folder, steps in (("pymunk", "runs", 20), ("mujoco", "results", 10)):
        planners, facts = evaluate.choose_planners(sim)
        assert facts == {"file": f"{folder}/{sim}/policy.pt", "imu": False, "steps": steps,
                         "minutes": 0.1, "seed": 0}
        assert list(planners) == ["policy", "baseline_tuned", "baseline"]
        assert planners["baseline"].settings == B, "those of the paper"
        assert planners["baseline_tuned"].settings == evaluate.TUNED[sim] != B

def test_rows_are_called_like_their_files(short_trials, capsys):
    policies = [save_untrained(Path(name), imu="imu" in name, steps=steps) for steps, name in
                enumerate(("first.pt", "a/policy.pt", "imu/policy.pt", "seed_1.pt"))]
    mine = [own_planner(name) for name in ("mine.py", "b/mine.py", "b/baseline.py")]
    planners, facts = evaluate.choose_planners("pymunk", policies, mine)
    assert list(planners) == ["policy", "a/policy", "imu/policy", "seed_1", "mine", "b/mine",
                              "b/baseline", "baseline_tuned", "baseline"], (
        "the first policy, then every file's name, with its folder where the name is taken")
    assert facts["file"] == "first.pt", "with --policy the shipped one is not added"
    assert [planners[name].columns for name in ("a/policy", "imu/policy")] == [20, 25]
    said = capsys.readouterr().out.splitlines()
    for steps, (line, name) in enumerate(zip(said, ("policy", "a/policy", "imu/policy"))):
        assert line.startswith(name) and f"'steps': {steps}" in line, "say which file is judged"

def test_two_planners_with_one_name_are_one_line(short_trials, capsys):
    files = [own_planner(name) for name in ("mine.py", "b/mine.py", "c/b/mine.py")]
    message = refused(capsys, "--planner", *files)
    assert str(files[2]) in message and "called b/mine" in message, message
    assert "called mine" not in refused(capsys, "--planner", *files), "b/mine is a name of its own"

@pytest.mark.parametrize("flags, mention", [
    (["--policy", "missing.pt"], "missing.pt: no such file"),
    (["--policy", "text.py"], "text.py: damaged, or not written by 04_ppo.py"),
    (["--policy", "other.pt"], "other.pt: made for another robot, walk or task: simulator is mujoco"
                               " in the file, but pymunk here"),
    (["--policy", "results/pymunk/policy.pt", "other.pt"], "simulator is mujoco"),
    (["--planner", "missing.py"], "missing.py: no such file"),
    (["--planner", "text.py"], "text.py: defines no class Planner"),
    (["--mujoco"], "results/mujoco/policy.pt: no such file")], ids=str)
def test_a_file_that_cannot_be_used_is_one_line(short_trials, capsys, flags, mention):
    save_untrained(Path("other.pt"), "mujoco")
    Path("text.py").write_text("class Other: pass")
    assert mention.replace("/", os.sep) in refused(capsys, *flags).replace("/", os.sep)

def test_a_policy_of_another_walk_is_refused(short_trials, monkeypatch, capsys):
    tuned = env.walk_engine.TUNED["pymunk"]
    monkeypatch.setitem(env.walk_engine.TUNED, "pymunk", replace(tuned, frequency=9.0))
    assert "walk parameters: frequency" in refused(capsys), "the steps would not be as learned"

# ------------------------------------------------------------------------ a planner of one's own
@pytest.mark.parametrize("line, rule", [
    ("return actions[:, :5]", r"of shape \(2, 6\)"), ("return actions[:1]", r"of shape \(2, 6\)"),
    ("return None", r"of shape \(2, 6\)"), ("actions[1, 2] = np.nan", "must be finite"),
    ("actions[0, 0] = 1.01", "must lie between 0 and 1"),
    ("actions[0, 0] = -0.01", "must lie between 0 and 1")])
def test_a_wrong_action_names_the_file_and_the_rule(world, tmp_path, line, rule):
    planner = evaluate.load_planner(own_planner(tmp_path / "mine.py", line))
    with pytest.raises(ValueError, match=f"mine.py: actions .*{rule}"):
        evaluate.evaluate(planner, world, to(np.zeros((2, 3))))

@pytest.mark.parametrize("error", ["KeyError", "OSError", "ValueError", "SystemError"])
def test_a_planner_s_own_error_keeps_its_traceback(short_trials, error):
    path = own_planner("mine.py", f"raise {error}('one of mine')")
    with pytest.raises(Exception, match="one of mine") as caught:
        call("--planner", path, "--episodes", 2)
    assert type(caught.value).__name__ == error
    last = traceback.extract_tb(caught.value.__traceback__)[-1]
    assert (Path(last.filename).name, last.lineno) == ("mine.py", LINE), "where it was raised"
    path.write_text("open('no such file of mine')")
    with pytest.raises(FileNotFoundError, match="of mine"):  # it is no bad file
        call("--planner", path)

def test_a_planner_may_import_what_lies_beside_it(short_trials, world, tmp_path):
    """From another folder, too; and it lives in the main thread, where a debugger works."""
    path = own_planner("a folder/mine.py", "import beside_mine")
    path.with_name("beside_mine.py").write_text(
        "import threading\n"
        "assert threading.current_thread() is threading.main_thread()\n")
    for place in (path, path.resolve()):
        planner = evaluate.load_planner(place)
        sys.modules.pop("beside_mine", None)
        found = evaluate.evaluate(planner, world, to(np.ones((2, 3))))
        assert found["outcome"].tolist() == ["timeout"] * 2
        del sys.path[0]

# ------------------------------------------------------------------------ from end to end
PLOT_FOOTSTEPS = evaluate.plot_footsteps  # before `short_trials` puts it aside

def test_from_a_policy_file_to_the_table(short_trials, monkeypatch, capsys):
    own_planner("mine.py")
    Path("goals.csv").write_text("x,y,yaw\n0,0,0\n0.01,0,0.05\n0,-0.01,-0.05\n")
    drawn = []
    monkeypatch.setattr(evaluate, "plot_footsteps", lambda walks, path: (
        drawn.extend(walks), PLOT_FOOTSTEPS(walks, path)))
    content = call("--noise", "--goals", "goals.csv", "--planner", "mine.py")
    shown, table = capsys.readouterr().out, Path("out/table.md").read_text(encoding="utf-8")
    assert "results/pymunk/policy.pt" in shown and table in shown
    assert drawn == ["baseline", "baseline_tuned", "mine"], "your planner goes before the policy"
    assert Path("out/footsteps.png").read_bytes().startswith(b"\x89PNG")

    assert content["sim"] == "pymunk" and content["policy"]["steps"] == 10
    assert content["goals"] == "goals.csv" and content["friction"] == "drawn"
    names = ["policy", "mine", "baseline_tuned", "baseline"]
    assert [(r["planner"], r["noise"]) for r in content["rows"]] == [
        *((name, False) for name in names), *((name, True) for name in names)]
    assert len(content["ratios"]) == 24, "four planners × the other three × two noise settings"
    assert "paper" not in table, "the paper's rows are about its goals, not about yours"
    assert evaluate.table(content["rows"], content["ratios"]) == table

    with open("out/trials.csv", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert list(lines[0]) == ["planner", "noise", "goal_std_m", "seed", "trial", "x", "y", "yaw",
                              "mu", "outcome", "time", "steps", "still_there", "reached_once",
                              "time_once"]
    assert [line["trial"] for line in lines] == ["0", "1", "2"] * len(content["rows"])
    ends = {name: [{**line, "planner": ""} for line in lines if line["planner"] == name]
            for name in names}
    assert ends["mine"] == ends["policy"], "both step on the spot, in the same worlds"
    for line in lines:
        assert line["outcome"] in evaluate.OUTCOMES and line["still_there"] in ("yes", "no")
        double_steps = int(line["steps"]) - (line["outcome"] == "success")  # the first of the two
        assert float(line["time"]) == pytest.approx(PERIOD * double_steps)
        assert line["outcome"] != "success" or line["reached_once"] == "yes"

def test_far_goals_and_the_ground_of_the_command_line_are_told(short_trials):
    content = call("--noise", "--episodes", 2, "--seed", 6, "--far", "--friction", 0.4)
    names = ["policy", "baseline_tuned", "baseline"]
    assert [(row["goal_std_m"], row["noise"], row["planner"]) for row in content["rows"]] == [
        *itertools.product((0.5, 1.0), (False, True), names)], "far goals: a block of their own"
    assert content["friction"] == 0.4 and content["seed"] == 6
    lines = Path("out/trials.csv").read_text(encoding="utf-8").splitlines()[1:]
    assert len(lines) == 2 * len(content["rows"])
    assert {(line.split(",")[3], line.split(",")[8]) for line in lines} == {("6", "0.4")}

@pytest.mark.slow
def test_gif_is_a_race_at_twice_its_speed(short_trials, monkeypatch):
    task = env.Task(time_limit=4 * PERIOD)
    monkeypatch.setattr(env, "FootstepWorld", partial(env.FootstepWorld, task=task))
    call("--gif", "--episodes", 1)
    frames, seconds = [], []
    with PIL.Image.open("out/animation.gif") as film:
        for number in range(film.n_frames):
            film.seek(number)
            frames.append(np.array(film.convert("RGB"), int))  # [height, width, 3]
            seconds.append(film.info["duration"] / 1000)
    for frame in frames:
        coloured = (np.ptp(frame, axis=-1) > 60).mean()
        assert coloured > 0.002, "neither robot nor map: is the figure cleared too late?"
    changed = [(np.abs(a - b).max(-1) > 60).mean() for a, b in zip(frames, frames[1:])]
    moved = np.array(changed) > 0.001  # [frames − 1] less is dithering
    assert moved.sum() > 10, "the robot stands still in the film"
    walk = sum(seconds[: np.flatnonzero(moved)[-1] + 1])
    assert walk == pytest.approx(2 * PERIOD, abs=0.15), "four double steps, twice as fast"
    assert sum(seconds) > walk + 1, "the end stays for a while"

# ------------------------------------------------------------------------ to play with
def play(monkeypatch, story, friction):
    """Plays until story(world, mouse) ends: every `yield` is one picture, of 0.1 s.

    mouse("press" or "release", x, y) is at a place of the map [m].
    """
    world = env.FootstepWorld(1, cores=1, spread=env.Spread(0, 0, 0, 0, 0))
    figure, axes = evaluate.plt.subplots()

    def mouse(name, x, y):
        place = axes.transData.transform((x, y))
        event = MouseEvent(f"button_{name}_event", figure.canvas, *place, 1)
        figure.canvas.callbacks.process(event.name, event)

    pictures, late = story(world, mouse), []

    def pause(seconds):
        if next(pictures, "the end") == "the end":
            late.append(seconds)
            assert len(late) < 10, "the window is closed, and it walks on"
            evaluate.plt.close(figure)

    monkeypatch.setattr(evaluate, "open_window", lambda: (figure, axes))
    monkeypatch.setattr(evaluate, "draw_walk", lambda *_: None)  # takes long
    monkeypatch.setattr(evaluate.plt, "pause", pause)
    evaluate.play(world, evaluate.BaselinePlanner(replace(OTHER, time_constant=0.0)), friction)
    world.close()
    assert late, "the story did not come to its end"

def until(done, pictures=300):
    """So many pictures at most."""
    for _ in range(pictures):
        if done():
            return
        yield
    pytest.fail(f"not after {pictures} pictures")

def there(world):
    x, y, yaw = world.relative_goal([0])[0]
    return np.hypot(x, y) < 0.05 and abs(yaw) < math.radians(10)

def test_the_robot_walks_where_the_mouse_says_until_the_window_closes(monkeypatch):
    def story(world, mouse):
        def goal_is(x, y, yaw, hint=""):
            np.testing.assert_allclose(world.goal[0], [x, y, yaw], atol=1e-3, err_msg=hint)

        yield
        assert world.friction[0] == 0.65, "--friction is there while playing, too"
        mouse("press", 0.4, 0.2)
        mouse("release", 0.4, 0.5)
        goal_is(0.4, 0.2, math.pi / 2, "pressed: the place; dragged along +y: the toes point there")
        yield from until(lambda: there(world))
        mouse("press", -0.2, 0.1)
        mouse("release", -0.2, 0.1)
        turned = world.pose[0, 2]
        goal_is(-0.2, 0.1, turned, "a click: as it is turned now")
        mouse("press", 9.0, 9.0)  # outside of the map
        mouse("release", 9.0, 1.0)
        np.testing.assert_allclose(world.goal[0, :2], [-0.2, 0.1], atol=1e-3)
        yield from until(lambda: there(world))
        walked, step = world.steps[0], world.step
        assert walked > 5, "it has walked in one go"
        monkeypatch.setattr(world, "step", lambda actions, robots: (
            step(actions, robots) | {"fall": np.array([True])}))
        yield from until(lambda: world.steps[0] > walked)
        monkeypatch.setattr(world, "step", step)
        yield from until(lambda: world.steps[0] == 1, pictures=20)
        assert np.hypot(*world.pose[0, :2]) < 0.15, "after a fall it begins anew at the origin"
        np.testing.assert_allclose(world.goal[0, :2], [-0.2, 0.1], atol=1e-3)

    play(monkeypatch, story, friction=0.65)

def test_play_is_with_the_first_planner_of_your_own(short_trials, monkeypatch):
    played = []
    monkeypatch.setattr(evaluate, "play", lambda *given: played.append(given))
    files = Path("results/pymunk/policy.pt"), save_untrained(Path("second.pt"))
    evaluate.main(["--play", "--friction", "0.5", "--policy", *map(str, files),
                   "--planner", str(own_planner("mine.py"))])
    (world, planner, friction), = played
    assert len(world.goal) == 1 and friction == 0.5
    assert type(planner).__module__ == "mine.py"

def test_play_without_a_display_is_one_line(short_trials, monkeypatch, capsys):
    def none(backend):
        raise ImportError(f"Cannot load backend {backend!r}")

    monkeypatch.setattr(evaluate.plt, "switch_backend", none)
    with pytest.raises(SystemExit) as stopped:
        evaluate.main(["--play", "--out", "out"])
    message, = capsys.readouterr().err.splitlines()
    assert stopped.value.code == 2 and "--play needs a display" in message
