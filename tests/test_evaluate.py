"""Stage 5: the baseline's equations, search, the statistics, the trials, and the command line."""

import csv
import itertools
import json
import math
import os
import shutil
import subprocess
import sys
from dataclasses import asdict, replace
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
import torch
from matplotlib.backend_bases import MouseEvent

evaluate = import_module("05_evaluate")
sys.path.append(str(Path(__file__).with_name("studies")))
search = import_module("search")  # makes the file of the planner `search`
env, ppo, robot_model = evaluate.env, evaluate.ppo, evaluate.robot_model
LIMITS, FAR = env.walk_engine.LIMITS["pymunk"], evaluate.FAR
SCRIPT = Path(evaluate.__file__)
B = evaluate.BaselineSettings()
OTHER = evaluate.BaselineSettings(0.3, 0.1, 0.2, 0.8, gain=0.5, turning_gain=2.0, far_m=0.4)
# By hand and not by the stages, which may be empty exercises when this module is imported:
HALF_STEP = 0.5 / env.walk_engine.TUNED["pymunk"].frequency  # [s]
TICK = robot_model.RobotModel().control_dt  # [s]
PERIOD = 2 * TICK * round(HALF_STEP / TICK)  # [s] a double step, in whole ticks
NEUTRAL = np.tile(np.divide(LIMITS.low, np.subtract(LIMITS.low, LIMITS.high)), 2)  # [6]

def view_of(*last_actions):
    """The View of robots that did these actions last; of the goal they know what is measured."""
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

def test_the_baseline_filters_and_stays_within_the_step_limits():
    planner = evaluate.BaselinePlanner(evaluate.BaselineSettings(9.0, 9.0, 9.0, 9.0, gain=9.0))
    planner.reset(2)
    speeds = []
    for goal in [(-0.01, 0.0, -0.01), *[(-3.0, -3.0, -3.0)] * 5]:
        action = planner.act(STANDS, np.array([1]), np.array([goal]))
        assert action.shape == (1, 6) and (action >= 0).all() and (action <= 1).all()
        speeds.append(np.abs(planner.velocity[1]).sum())
    assert np.all(np.diff(speeds) > 0), "the filtered velocity rises step by step"
    assert np.isnan(planner.velocity[0]).all(), "robot 0 was not asked, only robot 1"

def test_only_the_first_command_of_a_trial_is_not_filtered():
    planner, robot = evaluate.BaselinePlanner(), np.array([0])
    ahead, aside = np.array([[5.0, 0.0, 0.0]]), np.array([[0.0, 5.0, 0.0]])
    planner.reset(1)
    planner.act(STANDS, robot, ahead)
    np.testing.assert_allclose(planner.velocity, [[0.12, 0, 0]], atol=1e-12, err_msg=(
        "the filter smooths changes of the command; before the first one there is none"))
    planner.act(STANDS, robot, aside)
    share = 1 - math.exp(-PERIOD / 1.0)  # τ = 1 s
    changed = [[0.12 * (1 - share), 0.07 * share, 0.3 * share]]
    np.testing.assert_allclose(planner.velocity, changed, atol=1e-12, err_msg="the second one")
    planner.reset(1)
    planner.act(STANDS, robot, aside)
    np.testing.assert_allclose(planner.velocity, [[0, 0.07, 0.3]], atol=1e-12, err_msg=(
        "after a reset the last trial is forgotten"))


# ------------------------------------------------------------------------ search
HERE = replace(env.Task(), success_m=0.0, success_rad=0.0)  # nothing but the goal itself

@pytest.fixture
def small_map(monkeypatch):
    """Maps of another size: (cells on each side, turns around the circle)."""
    def build(half, turns):
        for name, value in ("HALF", half), ("TURNS", turns), ("TURN", 2 * math.pi / turns):
            monkeypatch.setattr(evaluate, name, value)
    return build

def fewest_moves(moves, half):
    """By trying everything: moves [whole cells, whole cells, quarter turns] -> V [4, x, y]."""
    turned = ((1, 0, 0, 1), (0, -1, 1, 0), (-1, 0, 0, -1), (0, 1, -1, 0))

    def after(k, x, y, move):
        a, b, c, d = turned[k]
        return (k + move[2]) % 4, x + a * move[0] + b * move[1], y + c * move[0] + d * move[1]

    count, side = {(0, 0, 0): 0}, range(-half, half + 1)
    open_ones, new = set(itertools.product(range(4), side, side)), {(0, 0, 0)}
    while new:
        open_ones -= new
        new = {pose for pose in open_ones if any(after(*pose, move) in count for move in moves)}
        count.update(dict.fromkeys(new, max(count.values()) + 1))
    value = np.full((4, 2 * half + 1, 2 * half + 1), FAR)
    for (k, x, y), number in count.items():
        value[k, x + half, y + half] = number
    return value

def in_metres(moves):
    """Moves in cells and quarter turns as moves in m, m, rad."""
    return np.array(moves) * (evaluate.CELL, evaluate.CELL, math.pi / 2)

LATTICE = ((0, 0, 0), (1, 0, 0), (0, 0, 1), (2, 1, -1))  # stay, go, turn left, a right-hand curve

def test_steps_to_go_is_the_fewest_moves(small_map):
    small_map(half=5, turns=4)
    truth = fewest_moves(LATTICE, half=5)
    assert 4 < truth[truth < FAR].max() < FAR, "the brute force of this test is too easy"
    found = search.steps_to_go(in_metres(LATTICE), HERE)
    np.testing.assert_allclose(found, truth, atol=0.01, err_msg=(
        "V[yaw, x, y] of the robot seen from the goal: are x and y swapped, or the move turned by "
        "−yaw? The map ends at its edge: outside, the goal is out of reach"))

def test_steps_to_go_with_one_move_ahead(small_map):
    small_map(half=6, turns=4)
    value = search.steps_to_go(np.array([[0.05, 0.0, 0.0]]), HERE)
    line = value[0, :, 6]  # [x]: looking along +x, y = 0
    np.testing.assert_allclose(line[:7], np.arange(6, -1, -1), atol=0.01, err_msg=(
        "n cells behind the goal, n moves of 5 cm"))
    np.testing.assert_allclose(line[7:], FAR, err_msg="it cannot go back")
    assert (value < FAR).sum() == 7, "it can neither turn nor go sideways"
    tolerant = search.steps_to_go(np.array([[0.05, 0.0, 0.0]]), env.Task())
    np.testing.assert_allclose(tolerant[0, :8, 6], [5, 4, 3, 2, 1, 0, 0, 0], atol=0.01, err_msg=(
        "within 5 cm it has arrived, one move earlier"))

ODD = np.array([(0.13, 0.0, 0.0), (-0.07, 0.0, 0.0), (0.02, 0.06, 0.0), (0.02, -0.06, 0.0),
                (0.06, 0.01, 0.4), (0.06, -0.01, -0.4)])  # not in whole cells

def test_steps_to_go_obeys_its_equation(small_map):
    small_map(half=12, turns=12)
    value = search.steps_to_go(ODD, env.Task())
    k, i, j = np.meshgrid(np.arange(12), np.arange(4, 21), np.arange(4, 21), indexing="ij")
    poses = np.stack([(i - 12) * 0.05, (j - 12) * 0.05, k * math.radians(30)], -1)
    (x, y, yaw), (ahead, aside, turn) = np.moveaxis(poses[..., None, :], -1, 0), ODD.T
    moved = np.stack([x + np.cos(yaw) * ahead - np.sin(yaw) * aside,
                      y + np.sin(yaw) * ahead + np.cos(yaw) * aside, yaw + turn], -1)
    # `compose` by hand, [..., A, 3]; all within the map
    at_goal = (np.hypot(poses[..., 0], poses[..., 1]) <= 0.05 + 1e-9) & (k == 0)
    after = np.where(at_goal, 0, np.minimum(FAR, 1 + evaluate.look_up(value, moved).min(-1)))
    assert after.max() < FAR, "all of these can reach the goal: repeat until nothing changes"
    np.testing.assert_allclose(value[k, i, j], after, atol=0.02, err_msg=(
        "V = 1 + min over moves of V after the move: was it repeated until nothing changed?"))

def test_steps_to_go_of_mirrored_moves_is_mirrored(small_map):
    small_map(half=8, turns=12)
    value = search.steps_to_go(ODD, env.Task())
    mirrored = value[-np.arange(12) % 12][:, :, ::-1]  # yaw and y change their signs
    np.testing.assert_allclose(value, mirrored, atol=0.02, err_msg=(
        "left and right can do the same, so they are equally far"))

def test_look_up_is_linear_between_cells(small_map):
    small_map(half=3, turns=8)
    rng = np.random.default_rng(0)
    value = rng.uniform(0, 9, (8, 7, 7))
    poses = np.array([[(i - 3) * 0.05, (j - 3) * 0.05, k * math.pi / 4]
                      for k, i, j in np.ndindex(8, 7, 7)])
    np.testing.assert_allclose(evaluate.look_up(value, poses).reshape(8, 7, 7), value, atol=1e-3,
                               err_msg="on a cell V is that of the cell: value[yaw, x, y]")
    middle = evaluate.look_up(value, np.array([0.025, -0.025, math.pi / 8]))
    assert middle == pytest.approx(value[:2, 3:5, 2:4].mean()), "the mean of the eight corners"
    x, y = rng.uniform(-0.14, 0.14, (2, 50))
    plane = np.tile(np.arange(7)[:, None] * 2.0 - np.arange(7), (8, 1, 1))
    found = evaluate.look_up(plane, np.stack([x, y, rng.uniform(-9, 9, 50)], -1))
    np.testing.assert_allclose(found, 2 * (x / 0.05 + 3) - (y / 0.05 + 3), atol=1e-9, err_msg=(
        "a slanted plane has no corners to be cut"))

def test_look_up_closes_the_circle_of_yaws(small_map):
    small_map(half=1, turns=8)
    value = np.tile(np.arange(8.0)[:, None, None], (1, 3, 3))
    for yaw, expected in ((315, 7), (337.5, 3.5), (-22.5, 3.5), (359.9999, 0), (360, 0), (-90, 6),
                          (-45 - 720, 7)):
        found = evaluate.look_up(value, np.array([0, 0, math.radians(yaw)]))
        assert found == pytest.approx(expected, abs=1e-4), f"{yaw}°: after the last yaw, the first"

def test_double_steps_favour_no_side_and_can_be_asked_for():
    steps = search.double_steps(LIMITS)
    assert not steps[0].any(), "the first one is in place"
    twice = env.to_footsteps(env.to_action(steps, LIMITS), LIMITS)
    np.testing.assert_allclose(twice, steps, atol=1e-12, err_msg=(
        "what was searched is what will be walked: within the limits, and their sum (`within`)"))
    every = {tuple(step.ravel().round(9) + 0.0) for step in steps}
    mirrored = {tuple(step[::-1].ravel().round(9) + 0.0) for step in steps}
    assert every == mirrored, "what the left foot can, the right foot can: swap the two rows"
    assert len(every) == len(steps) == 281, "8 · 5 · 7, and in place; each once"
    sideways = steps[:, 0, 1] - steps[:, 1, 1]  # [A] [m] to the left: both feet
    assert sideways.max() == pytest.approx(LIMITS.high[1] - LIMITS.low[1]), (
        "one foot steps outward, then the other one follows inward")
    half = search.double_steps(LIMITS, 0.5)
    assert np.abs(half[..., 0]).max() == pytest.approx(0.09), "half of 18 cm"

def test_displacements_are_those_of_a_steady_walk(monkeypatch):
    """A walk by heart: twice slow, then as asked, on a curve, with delay half as far again; the
    second one falls at last, but only with delay.
    """
    moves = np.array([[0.2, 0.0, 0.3], [0.1, -0.1, 0.0]])
    delayed = moves * [1.5, 1, 1]

    def walk(sim, parameters, footsteps, body):
        assert footsteps.shape == (4, 6, 2, 3), "each double step six times, with both delays"
        assert body.delay.tolist() == [0, 0, 1, 1] and (body.stiction == 0.75).all()
        assert (body.friction == 0.7).all() and (body.mass == 1).all(), "the middle of the spread"
        poses = np.zeros((4, 7, 3))
        for k in range(6):
            poses[:, k + 1] = robot_model.compose(
                poses[:, k], np.concatenate([moves, delayed]) * (1 if k > 1 else 0.3))
        return poses, poses, np.array([6, 6, 6, 5])

    monkeypatch.setattr(env.walk_engine, "walk", walk)
    found, stood = search.displacements("pymunk", search.double_steps(LIMITS)[:2])
    np.testing.assert_allclose(found, (moves + delayed) / 2, atol=1e-12, err_msg=(
        "of both delays, from the third on, each seen from where the robot was and looked before"))
    assert stood.tolist() == [True, False]

@pytest.fixture
def lattice_planner(small_map):
    """Builds a SearchPlanner on LATTICE moves, whose actions differ by 0.2 from one to the next."""
    def build(change):
        small_map(half=9, turns=4)
        actions = NEUTRAL + 0.2 * np.arange(len(LATTICE))[:, None] * (1, 0, 0, 0, 0, 0)
        moves = in_metres(LATTICE)
        planner = evaluate.SearchPlanner(np.zeros((len(LATTICE), 2, 3)), moves,
                                         search.steps_to_go(moves, HERE), LIMITS, change)
        planner.actions = actions
        planner.reset(1)
        return planner
    return build

def decision(planner, pose, view=STANDS):
    """Which move it takes there; pose [3] of the robot seen from the goal."""
    goal = robot_model.relative(np.array([pose]), np.zeros(3))
    action, = planner.act(view, np.array([0]), goal)
    return int(np.abs(planner.actions - action).max(-1).argmin())

def test_search_arrives_after_as_many_steps_as_it_promised(lattice_planner):
    planner = lattice_planner(change=1.0)
    truth = fewest_moves(LATTICE, half=9)
    for k, x, y in itertools.product(range(4), (-4, -1, 0, 3), (-3, 0, 1, 4)):
        pose, promised = in_metres((x, y, k)), round(truth[k, x + 9, y + 9])
        for _ in range(promised):
            pose = robot_model.compose(pose, planner.moves[decision(planner, pose)])
        np.testing.assert_allclose(robot_model.compose(np.zeros(3), pose)[:2], 0, atol=1e-9,
                                   err_msg=f"not there after {promised} moves")
        assert env.wrap(pose[2]) == pytest.approx(0, abs=1e-9)

def test_search_stays_at_the_goal(lattice_planner):
    planner = lattice_planner(change=1.0)
    planner.value = search.steps_to_go(planner.moves, env.Task())  # 5 cm are enough
    assert decision(planner, (0.0, 0.0, 0.0)) == 0
    assert decision(planner, (-0.05, 0.0, 0.0)) == 0, "arrived: one more move ahead wins nothing"

def test_search_respects_the_largest_change(lattice_planner):
    behind = (-0.2, 0.0, 0.0)  # four cells, best is to go: 0.2 from standing
    assert decision(lattice_planner(change=0.25), behind) == 1
    assert decision(lattice_planner(change=0.15), behind) == 0, "too different: do as before"
    planner = lattice_planner(change=0.15)
    last = view_of(planner.actions[3])
    assert decision(planner, (0.0, 0.0, 0.0), last) == 3, "at the goal, but it cannot stop at once"
    assert decision(lattice_planner(change=1.0), (0.0, 0.0, 0.0), last) == 0

def test_search_walks_on_beyond_its_map(lattice_planner):
    planner = lattice_planner(change=1.0)
    for metres in (0.5, 1.0, 9.0):  # the map ends at 0.45 m
        assert decision(planner, (-metres, 0.0, 0.0)) in (1, 3), (
            f"the goal is {metres} m ahead, and it steps on the spot until the time is up")

def table_of_search():
    """(steps, moves, V) as large as the real ones, for a robot that does as it is told."""
    steps = search.double_steps(LIMITS)
    moves = np.stack([steps[:, :, 0].sum(1), steps[:, 0, 1] - steps[:, 1, 1],
                      steps[:, 0, 2] - steps[:, 1, 2]], -1)
    axis, yaw = 0.05 * np.arange(-64, 65), env.wrap(np.radians(10) * np.arange(36))
    value = np.hypot(axis[:, None], axis) / 0.25 + np.abs(yaw)[:, None, None] / 0.3  # [36, x, y]
    return steps, moves, np.minimum(value, FAR)

def save_search(path, sim="pymunk"):
    path.parent.mkdir(parents=True, exist_ok=True)
    search.save(path, sim, 0.75, 0.35, table_of_search())
    return path

def test_the_file_of_a_search_is_small_and_exact_enough(tmp_path):
    path, (steps, moves, value) = save_search(tmp_path / "search.npz"), table_of_search()
    assert path.stat().st_size <= 500_000, "it is shipped: half a megabyte"
    assert [file.name for file in tmp_path.iterdir()] == ["search.npz"]
    _, planner, about = evaluate.load(path, "pymunk")
    assert planner.value.shape == value.shape
    assert np.abs(planner.value - value).max() <= 0.05, "V in twentieths of a double step"
    np.testing.assert_array_equal(planner.moves, moves)
    np.testing.assert_allclose(env.to_footsteps(planner.actions, LIMITS), steps, atol=1e-12)
    assert planner.change == 0.35
    assert about == {"file": path.as_posix(), "factor": 0.75, "change": 0.35}


# ------------------------------------------------------------------------ statistics
def test_wilson_interval():
    hint = "Wilson: (p + z²/2n ± z·√(p·(1 − p)/n + z²/4n²)) / (1 + z²/n), z = 1.96 for 95 %"
    assert evaluate.wilson(5, 10) == pytest.approx([0.2366, 0.7634], abs=1e-4), hint
    assert evaluate.wilson(490, 500) == pytest.approx([0.9636, 0.9891], abs=1e-4), hint
    low, high = evaluate.wilson(500, 500)
    assert high == pytest.approx(1) and 0.99 < low < 1, "500 of 500 does not prove 100 %"
    assert evaluate.wilson(0, 500) == pytest.approx([1 - high, 1 - low]), "not symmetric"

def test_wilson_interval_covers_the_truth_95_times_in_100():
    rng, p, n = np.random.default_rng(0), 0.96, 500
    inside = [low <= p <= high for low, high in
              (evaluate.wilson(k, n) for k in rng.binomial(n, p, size=4000))]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02), "how often the truth is inside"

def trials(outcomes, times, still_there=None):
    """Without still_there: all successes are. Somebody times out who was there once, after 8 s."""
    reached, times = np.array(outcomes) == "success", np.array(times, float)
    once = np.where(reached, times, 8.0 * (np.array(outcomes) == "timeout"))
    return {"outcome": np.array(outcomes), "time": times,
            "still_there": reached if still_there is None else np.array(still_there),
            "reached_once": once > 0, "time_once": once}

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
    four = trials(["success", "success", "fall", "timeout"], [4, 6, 1, 100], [1, 0, 0, 0])
    row = evaluate.summary("policy", False, 0.5, four, env.Task())
    assert (row["success"], row["fall"], row["timeout"]) == (0.5, 0.25, 0.25)
    assert row["success_ci95"] == [round(edge, 4) for edge in evaluate.wilson(2, 4)]
    assert (row["time_mean"], row["time_std"]) == (5, 1), "a mean over the successes only"
    assert row["still_there"] == 0.5, "a share of the successes, not of the episodes"
    assert row["reached_once"] == 0.75, "by the paper's rule: at the goal after one double step"
    assert row["time_once_mean"] == 6, "(4 + 6 + 8) / 3 s, of all who were there once"
    assert row["time_once_std"] == pytest.approx(math.sqrt(8 / 3), abs=1e-3)
    assert (row["goal_std_m"], row["episodes"]) == (0.5, 4)
    noisy = evaluate.summary("policy", True, None, four, env.Task())
    assert "noise_m" not in row and noisy["noise_m"] == 0.05 and noisy["goal_std_m"] is None

def test_summary_without_a_success_is_valid_json():
    falls = trials(["fall", "fall"], [1, 100])
    row = evaluate.summary("policy", True, env.Task().goal_std_m, falls, env.Task())
    assert row["success"] == row["reached_once"] == 0 and row["fall"] == 1
    for name in ("time_mean", "time_std", "time_once_mean", "time_once_std", "still_there"):
        assert row[name] is None, f"{name}: no success: no mean, and not 0 or nan"
    json.dumps(row, allow_nan=False)
    assert "none" in evaluate.table([row], [])

def test_ratios_compare_every_pair_under_the_same_noise_and_spread():
    fast, slow = trials(["success"] * 2, [4, 6]), trials(["success"] * 2, [8, 12])
    never = trials(["timeout"] * 2, [100, 100])
    runs = {("policy", False, 0.5): fast, ("policy_imu", False, 0.5): never,
            ("baseline", False, 0.5): slow, ("search", False, 0.5): fast,
            ("policy", True, 0.5): slow, ("baseline", True, 0.5): slow,
            ("policy", False, 1.0): slow, ("search", False, 1.0): fast,
            ("policy", False, None): fast}
    found = {(r["planner"], r["reference"], r["noise"], r["goal_std_m"]): r["time_ratio"]
             for r in evaluate.compare(runs)}
    assert found == {
        ("policy", "baseline", False, 0.5): 0.5, ("baseline", "policy", False, 0.5): 2.0,
        ("policy", "search", False, 0.5): 1.0, ("search", "policy", False, 0.5): 1.0,
        ("search", "baseline", False, 0.5): 0.5, ("baseline", "search", False, 0.5): 2.0,
        ("policy", "baseline", True, 0.5): 1.0, ("baseline", "policy", True, 0.5): 1.0,
        ("policy", "search", False, 1.0): 2.0, ("search", "policy", False, 1.0): 0.5}, (
            "policy_imu reached nothing: no ratio; and nobody else met the goals of None")

FOUR = trials(["success", "success", "fall", "timeout"], [4, 6, 1, 100], [1, 0, 0, 0])

def row_of(planner, noise, std):
    return evaluate.summary(planner, noise, std, FOUR, env.Task())

def tables_in(text):
    """The cells [table, row, column] of Markdown tables, without the line below each head."""
    blocks = [block.splitlines() for block in text.split("\n\n")]
    tables = [[[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
              for lines in blocks if lines[0].startswith("|")]
    return [[head, *rows] for head, _, *rows in tables]

def test_table_has_the_paper_s_rows_in_a_table_of_their_own():
    near = [row_of(name, True, 0.5) for name in ("policy", "policy_imu")]
    others = [row_of("policy", True, 1.0), row_of("policy", True, None)]
    ours, once = tables_in(evaluate.table(near + others, []))
    for table in (ours, once):
        assert len({len(line) for line in table}) == 1, "every row has a cell for every column"
    assert [line[:3] for line in ours[1:]] == [
        ["0.5 m", "yes", "policy"], ["0.5 m", "yes", "policy_imu"], ["1.0 m", "yes", "policy"],
        ["own", "yes", "policy"]]
    assert ours[1][3:] == ["0.500 [0.150, 0.850]", "0.250", "0.250", "5.00 ± 1.00", "0.500"]
    assert "paper" not in str(ours), "its success means something else: not in the same column"
    assert once[1:] == [
        ["yes", "policy", "ours", "0.750", "0.000", "0.250", "6.00 ± 1.63"],
        ["yes", "policy", "paper", "0.978", "0.000", "0.022", "6.35 ± 2.23"]], (
            "Table II, with noise, below ours by the paper's rule; of an IMU, of goals twice as "
            "far and of yours it says nothing")
    assert len(tables_in(evaluate.table(near, [], {}))) == 1
    assert len(tables_in(evaluate.table(others, []))) == 1

def test_table_ends_with_the_ratios_of_the_policies():
    ratio = {"planner": "policy", "reference": "search", "noise": True, "goal_std_m": 1.0,
             "goals": 7, "time_ratio": 0.5, "time_ratio_ci95": [0.4, 0.6]}
    other = ratio | {"planner": "search", "reference": "policy", "time_ratio": 2.0}
    text = evaluate.table([row_of("policy", True, 1.0)], [ratio, other])
    assert tables_in(text)[-1][1:] == [
        ["1.0 m", "yes", "policy", "search", "0.500 [0.400, 0.600]", "7"]], (
            "the ratios of search are in evaluation.json")
    mine = evaluate.table([row_of("policy", True, None)], [ratio | {"goal_std_m": None}])
    assert "None" not in mine, "your own goals have no σ: say `own`, as the table above does"


# ------------------------------------------------------------------------ trials
class Recorder:
    """Steps on the spot and remembers what it was told."""

    def reset(self, num_robots):
        self.measured = []

    def act(self, view, robots, measured):
        self.measured.append(measured.copy())
        return np.tile(view.neutral_action, (len(robots), 1))

class Wild(Recorder):
    """A planner that behaves differently."""

    def act(self, view, robots, measured):
        super().act(view, robots, measured)
        return np.tile([0.7, 0.3, 0.5, 0.7, 0.3, 0.5], (len(robots), 1))

class Hasty(Recorder):
    """As long a step as it can, forward or backward to where it believes the goal, until it falls.
    """

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
    return np.column_stack([world.sim.masses, world.sim.gain, world.sim.delay])[:count].copy()

def test_noise_of_a_goal_depends_on_neither_planner_nor_number(world):
    six, two = evaluate.draw_trials(3, 6), evaluate.draw_trials(3, 2)
    np.testing.assert_array_equal(six.goals[:2], two.goals)
    noise = first_noise(Recorder(), world, six)
    hint = "one generator per goal and one `world.measure` per decision"
    np.testing.assert_array_equal(noise, first_noise(Wild(), world, six), err_msg=hint)
    np.testing.assert_array_equal(noise[:2], first_noise(Recorder(), world, two), hint)
    assert len(np.unique(noise)) == noise.size, "goals must not share their noise"
    drawn = (six.goals / [1, 1, math.pi / 2])[0]
    assert not np.allclose(noise[0] / 0.05, drawn), "goals and noise come from the same generator"
    other = first_noise(Recorder(), world, replace(six, purpose="tuning"))
    assert not np.isclose(noise, other).any(), "nobody is tuned on what will be evaluated"

def test_far_trials_are_near_ones_with_the_goal_twice_as_far(world):
    near, far = evaluate.draw_trials(3, 6), evaluate.draw_trials(3, 6, far=True)
    np.testing.assert_allclose(far.goals, near.goals * (2, 2, 1), err_msg="σ = 1 m, not 0.5 m")
    noise, body, ground = first_noise(Recorder(), world, near), bodies(world, 6), world.friction[:6]
    ground = ground.copy()
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

@pytest.mark.parametrize("noise", [False, True])
@pytest.mark.parametrize("settings", [{}, {"far": True}, {"friction": 0.9}], ids=str)
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
    runs = [evaluate.evaluate(evaluate.BaselinePlanner(), world, asked) for _ in range(2)]
    assert runs[0]["outcome"].tolist() == ["success", "timeout"]
    assert runs[0]["still_there"].tolist() == [True, False], "only a success can be still there"
    assert runs[0]["time"][0] == pytest.approx(PERIOD), "that of the first of the two at the goal"
    assert runs[0]["steps"].tolist() == [2, 3], "three double steps fit into 2 s; a fourth is late"
    for key in runs[0]:
        np.testing.assert_array_equal(runs[0][key], runs[1][key], err_msg="same seed, same numbers")

def test_a_planner_that_scribbles_into_its_view_changes_nothing(world):
    class Scribbler(Wild):
        def act(self, view, robots, measured):
            actions = super().act(view, robots, measured)
            for array in (view.neutral_action, view.actions, view.observation, measured):
                array[:] = 0.9
            return actions

    asked, runs = to(np.zeros((4, 3))), []
    for planner in (Wild(), Scribbler()):
        result = evaluate.evaluate(planner, world, asked, noise=True)
        runs.append([*result.values(), world.pose[:4].copy(), world.actions[:4].copy(),
                     world.goal[:4].copy(), world.neutral_action.copy(), *planner.measured])
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
STILL_THERE = ("stays", "arrives later", "sways and returns")

@pytest.fixture
def endings(world, monkeypatch):
    """Trials with physics by heart; and a look at every double step that the world is asked for."""
    done, asked, step = np.zeros(len(ENDINGS), int), [], world.step

    def run(trajectory, robots):
        ends = [list(ENDINGS.values())[i][0][done[i]] for i in robots]
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
    planner = Wild()
    found = evaluate.evaluate(planner, world, to(np.zeros((len(ENDINGS), 3))), noise=True)
    return found, asked, planner

def test_success_is_to_be_inside_twice_in_a_row(endings, world):
    found, _, _ = endings
    assert found["outcome"].tolist() == ["success"] * 7 + ["timeout"] * 3 + ["fall"] * 3
    assert found["steps"].tolist() == [2, 3, *[2] * 5, 3, 3, 3, 2, 2, 1], (
        "they end with the trial, not with the two double steps after it")
    first = np.array([number for _, number in ENDINGS.values()])  # 0: never inside
    ended = np.where(found["outcome"] == "success", first, found["steps"])
    np.testing.assert_allclose(found["time"], ended * world.engine.period, err_msg=(
        "a success has the time of the first of the two double steps"))
    np.testing.assert_array_equal(found["reached_once"], first > 0, err_msg=(
        "by the paper's rule: once inside, whatever comes then; a fall is not inside"))
    np.testing.assert_allclose(found["time_once"], first * world.engine.period)
    assert found["reached_once"].sum() > (found["outcome"] == "success").sum()

def test_nobody_may_be_left_for_the_last_double_step(world, monkeypatch):
    """All who arrived fall in the first of the two double steps after it."""
    done = []

    def run(trajectory, robots):
        done.append(len(robots))
        torso = np.zeros((len(robots), trajectory.joints.shape[1] - 1, 6))
        return robot_model.Motion(torso, trajectory.joints[:, 1:], torso[:, -1, :3],
                                  np.full(len(robots), len(done) == 3))

    monkeypatch.setattr(world.sim, "run", run)
    found = evaluate.evaluate(Wild(), world, to(np.zeros((1, 3))))
    assert found["outcome"].tolist() == ["success"] and not found["still_there"].any()
    assert done == [1, 1, 1], "nobody stands, so nobody steps"

def test_still_there_means_inside_and_standing_after_two_more_double_steps(endings, world):
    found, asked, planner = endings
    for name, outcome, still_there in zip(ENDINGS, found["outcome"], found["still_there"]):
        assert still_there == (name in STILL_THERE), f"{name}: {outcome}"
    (first, robots), (second, standing) = asked[-2:]
    assert robots == list(range(7)), "every success is watched for two more double steps"
    assert standing == [0, 1, 2, 3, 4, 6], "who fell meanwhile does not walk on"
    for actions in (first, second):
        expected = np.tile(world.neutral_action, (len(actions), 1))
        np.testing.assert_allclose(actions, expected, err_msg="in place: the planner is not asked")
    assert len(planner.measured) == 3, "one measurement a decision, none afterwards"

@pytest.mark.parametrize("action", [np.full((2, 6), np.nan), np.zeros((2, 5)), np.zeros((1, 6))])
def test_a_planner_that_returns_nonsense_is_told(world, action):
    class Broken(Recorder):
        def act(self, view, robots, measured):
            return action

    with pytest.raises(ValueError, match=r"^actions must be finite .* \(2, 6\)"):
        evaluate.evaluate(Broken(), world, to(np.zeros((2, 3))))

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
    with torch.no_grad():
        pi = model.policy(torch.as_tensor(view.observation[:, :seen])).base_dist
        a, b = pi.concentration1, pi.concentration0
    np.testing.assert_allclose(found, a / (a + b), atol=1e-6, err_msg=(
        "the mean of a Beta distribution: α / (α + β); the IMU's rows are the last ones"))


# ------------------------------------------------------------------------ files
def save_untrained(path, sim="pymunk", imu=False, steps=10, **fits):
    """A policy that steps on the spot whatever it sees: nearly its first one."""
    torch.manual_seed(0)
    neutral = env.to_action(np.zeros((2, 3)), env.walk_engine.LIMITS[sim])
    model = ppo.ActorCritic(len(env.observation_table(imu)), 6, first_action=neutral)
    path.parent.mkdir(parents=True, exist_ok=True)
    ppo.save_policy(path, model, {"fits": env.fingerprint(sim, imu) | fits, "steps": steps,
                                  "minutes": 0.1, "seed": 0, "config": {"sharpest": 1.0}})
    return path

def save_tuned(path, sim="pymunk", **changed):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"fits": env.fingerprint(sim), "settings": asdict(OTHER) | changed}))

def run_main(*arguments):
    """Exit code of the script, run in this process."""
    with pytest.raises(SystemExit) as stopped:
        evaluate.main([str(argument) for argument in arguments])
    return stopped.value.code

def refused(capsys, *arguments):
    """The one line on stderr of a call that must be refused."""
    assert run_main(*arguments) == 2, "bad input ends with exit code 2"
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and lines[0].startswith("05_evaluate.py: "), f"one clear line: {lines}"
    return lines[0]

@pytest.mark.parametrize("text, line", [
    ("x,y,yaw\n1,2,3\n1,two,3\n", 3), ("x,y,yaw\n1,nan,3\n", 2), ("x,y,yaw\n\n1,2,inf\n", 3),
    ("x,y,yaw\n1,2\n", 2), ("x,y,yaw\n1,2,3,4\n", 2), ("x,y\n1,2\n", 1), ("", 1), ("1,2,3\n", 1),
    ("x,y,yaw\n", 1), ("x,y,yaw\n1,2,\n", 2), ("x,y,yaw,mu\n1,2,3,1\n1,2,3,-1\n", 3),
    ("x,y,yaw,mu\n1,2,3,nan\n", 2), ("x,y,yaw,mu\n1,2,3,ice\n", 2), ("x,y,yaw,mu\n1,2,3\n", 2),
    ("x,y,yaw,trial\n1,2,3,1.5\n", 2), ("x,y,yaw,seed\n1,2,3,-1\n", 2),
    ("x,y,yaw,seed\n1,2,3,1e300\n", 2), (f"x,y,yaw,seed\n1,2,3,{2**63}\n", 2),
    (f"x,y,yaw,seed,trial\n1,2,3,1,{2**63}\n", 2), ("x,y,yaw\n1.7e308,1.7e308,1\n", 2),
    (f"x,y,yaw,trial\n1,2,3,{2**63 - 1}\n", 2), ("x,y,yaw\n1,nan,1\n", 2),
    ("x,y,yaw\n" + 12_000 * "0,0,0\n", 10_002)], ids=lambda text: repr(text)[:40])
def test_a_malformed_goals_file_names_the_line(text, line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("goals.csv").write_text(text)
    message = refused(capsys, "--goals", "goals.csv")
    assert f"goals.csv, line {line}: " in message, f"{text!r}: line {line} is the wrong one"

def read(path, text, seed=5, friction=np.nan):
    """The Trials of a file with that text."""
    path.write_bytes(text.encode())
    return evaluate.read_trials(path, seed, friction)

def test_goals_file_is_read_whatever_wrote_it(tmp_path):
    text = "\ufeffname, X ,y,yaw\r\na,1,-2.5,7\r\n\r\n"  # as a spreadsheet does
    np.testing.assert_allclose(read(tmp_path / "goals.csv", text).goals,
                               [[1, -2.5, 7 - 2 * math.pi]])

def test_plain_goals_are_trials_of_this_seed_line_by_line(tmp_path):
    found = read(tmp_path / "goals.csv", "x,y,yaw\n1,2,0.5\n1,2,0.5\n0,0,0\n")
    assert (found.seed.tolist(), found.number.tolist()) == ([5, 5, 5], [0, 1, 2]), (
        "the same goal twice is two trials, with another ground and body each")
    assert np.isnan(found.friction).all(), "to be drawn"

def test_lines_that_name_their_trial_are_that_trial(tmp_path):
    text = ("planner,seed,trial,x,y,yaw,mu\npolicy,3,7,1,2,0.5,0.8\npolicy,3,2,0,1,0,0.9\n"
            "baseline,3,7,1,2,0.5,0.8\nbaseline,4,7,1,2,0.5,0.8\n")
    found = read(tmp_path / "trials.csv", text)
    assert found.seed.tolist() == [3, 3, 4] and found.number.tolist() == [7, 2, 7], "each once"
    assert found.friction.tolist() == [0.8, 0.9, 0.8] and found.purpose == "evaluation"
    assert read(tmp_path / "trials.csv", text, friction=0.4).friction.tolist() == [0.4] * 3, (
        "--friction: what the user says goes before what the file says")

def test_bad_input_is_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert "python 04_ppo.py" in refused(capsys), "without a policy, say how to get one"
    good = save_untrained(tmp_path / "policy.pt")
    other = save_untrained(tmp_path / "other.pt", sim="mujoco")
    limits = save_untrained(tmp_path / "limits.pt", **{"step limits": {"low": [0], "high": [1]}})
    Path("text.pt").write_text("no tensors")
    Path("latin.csv").write_bytes(b"x,y,yaw\n\xe9,1,1\n")
    assert "simulator is mujoco" in refused(capsys, "--policy", other)
    assert "step limits" in refused(capsys, "--policy", limits)
    assert "text.pt" in refused(capsys, "--policy", "text.pt")
    assert "missing.pt" in refused(capsys, "--policy", "missing.pt")
    assert "missing.csv" in refused(capsys, "--policy", good, "--goals", "missing.csv")
    assert "utf-8" in refused(capsys, "--policy", good, "--goals", "latin.csv").lower()
    assert "text.pt" in refused(capsys, "--policy", good, "--out", Path("text.pt") / "below")
    for count in ("0", "-3", "many", "1.5"):
        refused(capsys, "--policy", good, "--episodes", count)
    for seed in ("-1", str(2**63), "7" * 5000):
        assert len(refused(capsys, "--policy", good, "--seed", seed)) < 200, "not all its digits"
    refused(capsys, "--policy", good, "--goals", "")  # a variable of the shell that is not set
    refused(capsys, "--policy", good, "--out", Path("text.pt") / "two\nlines")
    assert "--episodes" in refused(capsys, "--goals", "latin.csv", "--episodes", "3")
    assert "--policy" in refused(capsys, "--imu", "--policy", good), "which of the two is shown?"
    assert "04_ppo.py --imu" in refused(capsys, "--imu"), "there is none with an IMU"
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert "pip install mujoco" in refused(capsys, "--mujoco", "--policy", other)

SETTINGS = asdict(B)
DAMAGED = {
    "cut off": '{"settings": {"forward": 0.2',
    "no object": "[1, 2]",
    "no settings": '{"factor": 2.0, "turning_gain": 0.6}',
    "one setting is missing": json.dumps({"settings": {
        name: value for name, value in SETTINGS.items() if name != "forward"}}),
    "one too many": json.dumps({"settings": SETTINGS | {"speed": 1.0}}),
    "a word": json.dumps({"settings": SETTINGS | {"forward": "fast"}}),
    "a word for the filter": json.dumps({"settings": SETTINGS | {"time_constant": "slow"}}),
    "nothing": json.dumps({"settings": SETTINGS | {"turning": None}}),
    "nan": json.dumps({"settings": SETTINGS | {"gain": math.nan}}),
    "below 0": json.dumps({"settings": SETTINGS | {"gain": -1e308}}),
    "no speed": json.dumps({"settings": SETTINGS | {"sideways": 0}}),
}

@pytest.mark.parametrize("damage", DAMAGED)
def test_a_damaged_tuned_baseline_is_one_line(damage, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    save_untrained(Path("results/pymunk/policy.pt"))
    Path("results/pymunk/baseline_tuned.json").write_text(DAMAGED[damage])
    monkeypatch.setattr(evaluate, "run", lambda *_: pytest.fail(f"{damage}: accepted"))
    message = refused(capsys, "--episodes", 1, "--out", "out")
    assert "baseline_tuned.json" in message, f"{damage}: name the file: {message}"
    assert not Path("out").exists(), "check everything first, then write"

def npz(**changed):
    """A search.npz with other contents; None: without it."""
    def write(path):
        with np.load(path) as stored:
            content = dict(stored) | changed
        np.savez_compressed(path, **{key: v for key, v in content.items() if v is not None})
    return write

FITS = env.fingerprint("pymunk")
DAMAGED_SEARCH = {
    "empty": lambda path: path.write_bytes(b""),
    "a text": lambda path: path.write_text("no table"),
    "cut off": lambda path: path.write_bytes(path.read_bytes()[:20_000]),
    "no moves": npz(moves=None),
    "nothing about it": npz(about=None),
    "about is no JSON": npz(about="{"),
    "about is a list": npz(about="[]"),
    "fits is a list": npz(about='{"fits": [], "factor": 1, "change": 1}'),
    "factor is missing": npz(about=json.dumps({"fits": FITS, "change": 1})),
    "an object": npz(moves=np.array([{}], object)),
    "of another map": npz(parts=np.zeros((4, 9, 9), np.int16)),
    "fewer moves than steps": npz(moves=np.zeros((3, 3))),
    "moves to nowhere": npz(moves=np.full((281, 3), np.nan)),
    "a change in words": npz(about=json.dumps({"fits": FITS, "factor": 1, "change": "a bit"})),
}

@pytest.mark.parametrize("damage", DAMAGED_SEARCH)
def test_a_damaged_search_is_one_line(damage, tmp_path):
    path = save_search(tmp_path / "search.npz")
    DAMAGED_SEARCH[damage](path)
    with pytest.raises(evaluate.InputError, match="search.npz: not written by") as caught:
        evaluate.load(path, "pymunk")
    assert not isinstance(caught.value, evaluate.StaleError), "damaged, not made for another robot"

def test_a_search_with_a_wrong_byte_is_refused_or_harmless(tmp_path):
    path = save_search(tmp_path / "search.npz")
    data, value = path.read_bytes(), evaluate.load(path, "pymunk")[1].value
    for at in range(60, len(data), len(data) // 40):
        path.write_bytes(data[:at] + bytes([data[at] ^ 255]) + data[at + 1:])
        try:
            found = evaluate.load(path, "pymunk")[1].value
        except evaluate.InputError:
            continue
        np.testing.assert_array_equal(found, value, f"byte {at}: another map, and nobody noticed")

def test_a_damaged_search_ends_the_evaluation(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    save_untrained(Path("results/pymunk/policy.pt"))
    Path("results/pymunk/search.npz").write_text("no table")
    monkeypatch.setattr(evaluate, "run", lambda *_: pytest.fail("accepted"))
    assert "results/pymunk/search.npz" in refused(capsys, "--episodes", 1, "--out", "out")
    assert not Path("out").exists(), "check everything first, then write"

@pytest.mark.parametrize("name, save", [("baseline_tuned.json", save_tuned),
                                        ("search.npz", save_search)])
def test_what_was_made_for_another_robot_is_left_out(name, save, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    save_untrained(Path("results/pymunk/policy.pt"))
    planner, path = name.split(".", maxsplit=1)[0], Path("results/pymunk", name)
    save(path)
    assert planner in evaluate.choose_planners("pymunk")[0]
    assert not capsys.readouterr().err
    save(path, sim="mujoco")
    planners, about = evaluate.choose_planners("pymunk")
    assert planner not in planners and planner not in about
    line, = capsys.readouterr().err.strip().splitlines()
    assert line.startswith(f"left out: {path}: ") and "simulator is mujoco" in line, line
    assert "tests/studies/" in line, "say how to make a new one"


# ------------------------------------------------------------------------ which planners
def test_runs_win_over_results(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for steps, folder in enumerate(("results", "runs")):
        save_untrained(Path(folder, "pymunk/policy.pt"), steps=steps)
        save_untrained(Path(folder, "pymunk/imu/policy.pt"), imu=True, steps=steps)
        save_tuned(Path(folder, "pymunk/baseline_tuned.json"), forward=0.5 + steps)
        save_search(Path(folder, "pymunk/search.npz"))
        planners, about = evaluate.choose_planners("pymunk")
        assert set(about) == {"policy", "policy_imu", "baseline_tuned", "search"}
        for name, facts in about.items():
            assert facts["file"].startswith(f"{folder}/pymunk/"), f"{name}: your own before ours"
        assert about["policy"]["steps"] == about["policy_imu"]["steps"] == steps
        assert planners["baseline_tuned"].settings == replace(OTHER, forward=0.5 + steps), (
            "all eight numbers come from the file")
    Path("runs/pymunk/policy.pt").unlink()
    about = evaluate.choose_planners("pymunk")[1]
    assert [about[name]["file"] for name in ("policy", "policy_imu")] == [
        "results/pymunk/policy.pt", "runs/pymunk/imu/policy.pt"], "each file on its own"
    chosen = save_untrained(tmp_path / "mine.pt", steps=7)
    assert evaluate.choose_planners("pymunk", chosen)[1]["policy"]["steps"] == 7, "--policy wins"

def test_the_policy_for_the_figures_comes_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_untrained(Path("results/mujoco/policy.pt"), "mujoco")
    save_untrained(Path("results/mujoco/imu/policy.pt"), "mujoco", imu=True)
    save_tuned(Path("results/mujoco/baseline_tuned.json"), "mujoco")
    for imu, first in ((False, "policy"), (True, "policy_imu")):
        planners, about = evaluate.choose_planners("mujoco", imu=imu)
        assert next(iter(planners)) == next(iter(about)) == first
        assert set(planners) == {"policy", "policy_imu", "baseline", "baseline_tuned"}
        assert about["policy_imu"]["imu"] and not about["policy"]["imu"]
    shutil.rmtree("results/mujoco/imu")
    assert "policy" in evaluate.choose_planners("mujoco")[0], "nobody asked for the other one"
    with pytest.raises(evaluate.InputError, match="04_ppo.py --mujoco --imu"):
        evaluate.choose_planners("mujoco", imu=True)

def test_a_second_policy_that_does_not_fit_is_left_out(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    save_untrained(Path("results/pymunk/policy.pt"))
    save_untrained(Path("results/pymunk/imu/policy.pt"), "mujoco", imu=True)
    assert set(evaluate.choose_planners("pymunk")[0]) == {"policy", "baseline"}
    assert "left out: results/pymunk/imu/policy.pt" in capsys.readouterr().err, "say so"
    assert "imu/policy.pt" in refused(capsys, "--imu"), "now somebody asked for it"

def test_an_imu_policy_alone_is_not_what_was_asked_for(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    save_untrained(Path("results/pymunk/imu/policy.pt"), imu=True)
    assert "`python 04_ppo.py`" in refused(capsys, "--episodes", 1), "say how to get the other one"
    monkeypatch.setattr(robot_model, "CORES", 1)
    monkeypatch.setattr(evaluate, "run", lambda world, blocks, planners, *_: print(*planners))
    evaluate.main(["--imu", "--episodes", "1"])
    assert capsys.readouterr().out.split() == ["policy_imu", "baseline"]


# ------------------------------------------------------------------------ from end to end
def test_from_a_policy_file_to_the_table(tmp_path, monkeypatch):
    """Once on all cores in a process of its own, as a student calls it, and once on one core here.

    All files, and the same numbers.
    """
    monkeypatch.chdir(tmp_path)
    save_untrained(tmp_path / "runs/pymunk/imu/policy.pt", imu=True)
    save_untrained(tmp_path / "results/pymunk/policy.pt")
    save_tuned(tmp_path / "results/pymunk/baseline_tuned.json")
    save_search(tmp_path / "results/pymunk/search.npz")
    (tmp_path / "goals.csv").write_text("x,y,yaw\n0,0,0\n0.01,0,0.05\n0,-0.01,-0.05\n")
    arguments = ["--noise", "--goals", "goals.csv", "--out"]
    done = subprocess.run([sys.executable, SCRIPT, *arguments, "one"], capture_output=True,
                          encoding="utf-8", env=os.environ | {"PYTHONUTF8": "1"}, check=False)
    assert done.returncode == 0, done.stderr
    monkeypatch.setattr(robot_model, "CORES", 1)
    monkeypatch.setattr(evaluate, "FIGURE_GOALS", np.zeros((2, 3)))  # quickly: it has been drawn
    monkeypatch.setattr(evaluate, "plot_footsteps", lambda *_: None)
    evaluate.main([*arguments, "two"])
    texts = [[Path(out, name).read_text(encoding="utf-8") for name in (
        "evaluation.json", "trials.csv", "table.md")] for out in ("one", "two")]
    assert texts[0] == texts[1], "the same seed gives the same numbers, whatever the cores"
    assert "results/pymunk/policy.pt" in done.stdout and texts[0][2] in done.stdout
    assert (tmp_path / "one/footsteps.png").read_bytes().startswith(b"\x89PNG")
    assert not list(tmp_path.rglob("*.tmp*")), "a temporary file was left behind"

    content = json.loads(texts[0][0])
    assert content["sim"] == "pymunk" and content["policy"]["steps"] == 10
    names = ["policy", "policy_imu", "baseline_tuned", "search", "baseline"]
    assert [(r["planner"], r["noise"]) for r in content["rows"]] == [
        (name, noise) for noise in (False, True) for name in names]
    for row in content["rows"]:
        assert row["success"] + row["timeout"] + row["fall"] == pytest.approx(1, abs=2e-4)
        assert row["success_ci95"][0] <= row["success"] <= row["success_ci95"][1]
        assert row["reached_once"] >= row["success"], "to stay is more than to arrive"
        assert ("noise_m" in row) == row["noise"]
    assert content["friction"] == "drawn"
    assert len(content["ratios"]) == 40, "five planners × the other four × two noise settings"
    lines = list(csv.DictReader(texts[0][1].splitlines()))
    assert list(lines[0]) == ["planner", "noise", "goal_std_m", "seed", "trial", "x", "y", "yaw",
                              "mu", "outcome", "time", "steps", "still_there", "reached_once",
                              "time_once"]
    assert [line["trial"] for line in lines] == ["0", "1", "2"] * len(content["rows"])
    goals = {name: [line["x"] for line in lines if line["planner"] == name] for name in names}
    assert all(goal == goals["policy"] for goal in goals.values()), "the same goals for everyone"
    for line in lines:
        assert line["outcome"] in evaluate.OUTCOMES and line["still_there"] in ("yes", "no")
        double_steps = int(line["steps"]) - (line["outcome"] == "success")  # the first of the two
        assert float(line["time"]) == pytest.approx(PERIOD * double_steps)
        assert line["outcome"] != "success" or line["reached_once"] == "yes"
    assert "paper" not in texts[0][2], "the paper's rows are about its goals, not about yours"
    assert evaluate.table(content["rows"], content["ratios"], {}) == texts[0][2]

@pytest.fixture
def short_trials(tmp_path, monkeypatch):
    """A folder with both policies, and 2 s for a trial: the command line in a second."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(env, "FootstepWorld", partial(env.FootstepWorld, task=SHORT, cores=1))
    save_untrained(Path("results/pymunk/policy.pt"))
    save_untrained(Path("results/pymunk/imu/policy.pt"), imu=True)

@pytest.mark.parametrize("flags, first", [([], "policy"), (["--imu"], "policy_imu")])
def test_evaluation_names_the_policy_of_the_figures(short_trials, monkeypatch, flags, first):
    drawn = []
    monkeypatch.setattr(evaluate, "plot_footsteps", lambda walks, path: drawn.extend(walks))
    evaluate.main([*flags, "--episodes", "2", "--out", "out"])
    content = json.loads(Path("out/evaluation.json").read_text(encoding="utf-8"))
    assert drawn == ["baseline", first]
    assert content["policy"] == content["planners"][first], (
        f"with {flags or 'no flags'} the figures show {first}, and so says evaluation.json")
    assert content["policy"]["imu"] == (first == "policy_imu")
    assert {row["planner"] for row in content["rows"]} == {"policy", "policy_imu", "baseline"}

def told_trials(folder):
    """What trials.csv tells of every trial, by planner, noise, seed, number and goal."""
    with open(Path(folder, "trials.csv"), encoding="utf-8") as file:
        return {tuple(line[name] for name in ("planner", "noise", "seed", "trial", "x", "y")): {
            name: text for name, text in line.items() if name != "goal_std_m"}
            for line in csv.DictReader(file)}

@pytest.mark.parametrize("flags", [[], ["--far"], ["--friction", "0.4"]], ids=str)
def test_trials_given_back_with_goals_end_as_before(short_trials, monkeypatch, flags):
    monkeypatch.setattr(evaluate, "plot_footsteps", lambda *_: None)
    save_tuned(Path("results/pymunk/baseline_tuned.json"))
    evaluate.main(["--noise", "--episodes", "3", "--seed", "6", *flags, "--out", "one"])
    content = json.loads(Path("one/evaluation.json").read_text(encoding="utf-8"))
    spreads = [0.5, 1.0] if flags == ["--far"] else [0.5]
    names = ["policy", "policy_imu", "baseline_tuned", "baseline"]
    assert [(row["goal_std_m"], row["noise"], row["planner"]) for row in content["rows"]] == [
        *itertools.product(spreads, (False, True), names)], "far goals are a block of their own"
    first = told_trials("one")
    assert len(first) == 3 * len(content["rows"])
    friction = {float(line["mu"]) for line in first.values()}
    if "--friction" in flags:
        assert content["friction"] == 0.4 and friction == {0.4}
    else:
        assert content["friction"] == "drawn" and len(friction) == 3, "as drawn, for all the same"

    head, *lines = Path("one/trials.csv").read_text(encoding="utf-8").splitlines()
    Path("some.csv").write_text("\n".join([head, *lines[:1:-1]]))  # backwards, without two lines
    evaluate.main(["--noise", "--goals", "some.csv", "--out", "two"])
    second = told_trials("two")
    assert len(second) == len(first), "every planner meets every trial that a line is about"
    for key, line in second.items():
        assert line == first[key], f"{key}: the same μ, outcome, time and steps"

def test_an_interrupted_film_leaves_the_old_one_and_nothing_else(tmp_path, monkeypatch):
    (tmp_path / "animation.gif").write_bytes(b"the old one")
    walk = {"torso": np.zeros((30, 6)), "joints": np.zeros((30, 12)), "ending": "falls"}
    called = []

    def draw_walk(*_):
        called.append(1)
        if len(called) == 3:
            raise KeyboardInterrupt
    monkeypatch.setattr(evaluate, "draw_walk", draw_walk)
    with pytest.raises(KeyboardInterrupt):
        evaluate.plot_race({"policy": walk}, tmp_path / "animation.gif", robot_model.RobotModel())
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"the old one"]

@pytest.mark.slow
def test_gif_is_a_race_at_twice_its_speed(short_trials, monkeypatch):
    task = env.Task(time_limit=6 * PERIOD)
    monkeypatch.setattr(env, "FootstepWorld", partial(env.FootstepWorld, task=task))
    monkeypatch.setattr(evaluate, "plot_footsteps", lambda *_: None)
    evaluate.main(["--gif", "--episodes", "1", "--policy", "results/pymunk/policy.pt"])
    with PIL.Image.open("runs/pymunk/animation.gif") as film:
        frames, seconds = [], []
        for number in range(film.n_frames):
            film.seek(number)
            frames.append(np.array(film.convert("RGB"), int))  # [height, width, 3]
            seconds.append(film.info["duration"] / 1000)
    assert len(frames) > 10, f"{len(frames)} frames are not an animation"
    for frame in frames:
        coloured = (np.ptp(frame, axis=-1) > 60).mean()
        assert coloured > 0.002, "neither robot nor map: is the figure cleared too late?"
    changed = [(np.abs(a - b).max(-1) > 60).mean() for a, b in zip(frames, frames[1:])]
    moved = np.array(changed) > 0.001  # [frames − 1] less is dithering
    assert moved.sum() > 10, "the robot stands still in the film"
    walk = sum(seconds[: np.flatnonzero(moved)[-1] + 1])
    assert walk == pytest.approx(3 * PERIOD, abs=0.15), "six double steps, twice as fast"
    assert sum(seconds) > walk + 1, "the end stays for a while"
    assert not list(Path().rglob("*.tmp*")), "a temporary file was left behind"

def test_an_interrupted_evaluation_ends_its_processes(short_trials, monkeypatch):
    """And then `robot_model.run` says so in one line: tests/test_hostile.py."""
    def interrupted(world, *_):
        close = world.close
        world.close = lambda: closed.append(close())
        raise KeyboardInterrupt

    closed = []
    monkeypatch.setattr(evaluate, "run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        evaluate.main(["--episodes", "1"])
    assert len(closed) == 1


# ------------------------------------------------------------------------ a planner of one's own
PLANNER = """
import sys
import time
import numpy as np

class Planner:
    def reset(self, num_robots):
        pass

    def act(self, view, robots, measured):
        actions = np.tile(view.neutral_action, (len(robots), 1))
        {line}
        return actions
"""

def own_planner(folder, line="pass", name="mine.py"):
    """The file of a planner that steps on the spot and does something else before."""
    path = Path(folder, name)
    path.write_text(PLANNER.format(line=line))
    return path

def test_a_planner_of_one_s_own_has_a_name_that_is_none_of_ours(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    policy = save_untrained(Path("results/pymunk/policy.pt"))
    for name in ("policy", "baseline"):  # without an ending
        planners, _ = evaluate.choose_planners("pymunk", own=own_planner(".", name=name))
        assert list(planners) == [f"{name}.py", "policy", "baseline"], policy
    planners, _ = evaluate.choose_planners("pymunk", own=own_planner(".", name="a, b.py"))
    assert next(iter(planners)) == "a; b.py", "a comma ends a cell of trials.csv"

def test_a_planner_of_one_s_own_is_a_row_beside_the_others(short_trials, monkeypatch):
    monkeypatch.setattr(evaluate, "plot_footsteps", lambda *_: None)
    evaluate.main(["--planner", str(own_planner(".")), "--episodes", "2", "--out", "out"])
    content = json.loads(Path("out/evaluation.json").read_text(encoding="utf-8"))
    assert [row["planner"] for row in content["rows"]] == [
        "mine.py", "policy", "policy_imu", "baseline"], "it comes first, and so it fails early"
    assert content["policy"] == content["planners"]["policy"]
    assert content["planners"]["mine.py"] == {"file": "mine.py"}
    lines = Path("out/trials.csv").read_text(encoding="utf-8").splitlines()[1:]
    ends = [line.split(",", 1)[1] for line in lines if line.startswith(("policy,", "mine.py,"))]
    assert ends[:2] == ends[2:], "both step on the spot, in the same worlds"

@pytest.mark.parametrize("line, mention", [
    ("raise KeyError('one\\ntwo')", "KeyError"), ("return actions[:, :5]", "shape (2, 6)"),
    ("actions[1, 2] = np.nan", "finite"), ("actions[0, 0] = 1.01", "between 0 and 1"),
    ("actions[0, 0] = -0.01", "between 0 and 1"), ("return 'left'", "finite"),
    ("return None", "finite"), ("return actions.tolist()[:1]", "shape (2, 6)"),
    ("sys.exit(3)", "SystemExit(3)"), ("time.sleep(1.5)", "0.5 s"), ("}", "SyntaxError")])
def test_what_a_planner_does_wrong_is_one_line(short_trials, monkeypatch, capfd, line, mention):
    monkeypatch.setattr(evaluate, "PATIENCE", 0.5)
    path = own_planner(".", line)
    assert run_main("--planner", path, "--episodes", 2, "--out", "out") == 2, "exit code 2"
    shown = capfd.readouterr().err  # with the progress bar of the others
    message, = (text for text in shown.splitlines() if text and "rows" not in text)
    assert message.startswith("05_evaluate.py: mine.py") and mention in message, message

@pytest.mark.parametrize("text, mention", [
    ("class Other: pass", "Planner"), ("Planner = 3", "not callable"), (None, "No such file"),
    ("class Planner:\n    def reset(self, number): pass", "act"), ("class Planner: pass", "reset"),
    ("import sys; sys.exit()", "SystemExit()"), ("import time; time.sleep(1.5)", "0.5 s")])
def test_a_file_without_a_planner_is_one_line(tmp_path, monkeypatch, text, mention):
    monkeypatch.setattr(evaluate, "PATIENCE", 0.5)
    path = tmp_path / "mine.py"
    if text is not None:
        path.write_text(text)
    with pytest.raises(evaluate.InputError) as caught:
        planner = evaluate.OwnPlanner(path)
        planner.reset(1)
        planner.act(STANDS, np.array([0]), np.zeros((1, 3)))
    message = str(caught.value)
    assert message.startswith(str(path)) and mention in message and "\n" not in message, message

def test_a_mistake_in_a_planner_is_told_with_its_line(tmp_path):
    path = own_planner(tmp_path, "view.nothing")
    line = path.read_text().partition("view.nothing")[0].count("\n") + 1
    planner = evaluate.OwnPlanner(path)
    planner.reset(1)
    with pytest.raises(evaluate.InputError, match=f"mine.py, line {line}: AttributeError"):
        planner.act(STANDS, np.array([0]), np.zeros((1, 3)))

def test_a_planner_of_one_s_own_cannot_change_the_world(world, tmp_path):
    scribble = "; ".join(f"{name}[:] = 9" for name in (
        "view.neutral_action", "view.actions", "view.observation", "robots", "measured"))
    asked, runs = to(np.ones((4, 3))), []
    for line in ("pass", scribble):
        planner = evaluate.OwnPlanner(own_planner(tmp_path, line))
        ended = evaluate.evaluate(planner, world, asked, noise=True)
        runs.append([*ended.values(), world.pose[:4].copy(), world.actions[:4].copy(),
                     world.goal[:4].copy(), world.neutral_action.copy()])
    for honest, scribbled in zip(*runs):
        np.testing.assert_array_equal(honest, scribbled)


# ------------------------------------------------------------------------ to play with
@pytest.fixture(params=["pymunk", "mujoco"])
def field(request):
    """A Field on a canvas without display, with robots that have the model's own body."""
    world = env.FootstepWorld(1, request.param, cores=1, spread=robot_model.Spread(0, 0, 0, 0, 0))
    planner = evaluate.BaselinePlanner(replace(OTHER, time_constant=0.0))
    field = evaluate.Field(world, planner, friction=0.65)
    yield field
    evaluate.plt.close(field.figure)
    world.close()

def mouse(field, name, x, y):
    """The mouse at a place of the map [m]."""
    field.figure.canvas.draw()
    place = field.axes.transData.transform((x, y))
    event = MouseEvent(f"button_{name}_event", field.figure.canvas, *place, 1)
    field.figure.canvas.callbacks.process(event.name, event)

def drag(field, start, end):
    mouse(field, "press", *start)
    mouse(field, "release", *end)

def walk_until(field, pictures, done, limit=30):
    """Pictures of at most so many seconds."""
    for _ in range(10 * limit):
        next(pictures)
        if done():
            return
    pytest.fail(f"not after {limit} s: pose {field.world.pose[0]}, goal {field.world.goal[0]}")

def test_the_robot_walks_where_the_mouse_says(field):
    world, pictures = field.world, field.live()
    next(pictures)
    drag(field, (0.4, 0.2), (0.4, 0.5))
    np.testing.assert_allclose(world.goal[0], [0.4, 0.2, math.pi / 2], atol=1e-3, err_msg=(
        "pressed: the place; dragged along +y: the toes point there"))
    walk_until(field, pictures, lambda: world.inside[0])
    assert world.friction[0] == 0.65, "--friction is there while playing, too"
    drag(field, (-0.2, 0.1), (-0.21, 0.1))  # hardly moved: a click
    np.testing.assert_allclose(world.goal[0], [-0.2, 0.1, world.pose[0, 2]], atol=1e-3)
    for _ in range(5):
        next(pictures)
    drag(field, (0.1, -0.3), (0.5, -0.3))  # in mid walk
    np.testing.assert_allclose(world.goal[0], [0.1, -0.3, 0.0], atol=1e-3)
    walk_until(field, pictures, lambda: np.hypot(*(world.pose - world.goal)[0, :2]) < 0.05)
    before = world.goal[0].copy()
    drag(field, (9.0, 9.0), (1.0, 1.0))  # from outside of the map
    drag(field, (1.0, 1.0), (9.0, 9.0))
    np.testing.assert_array_equal(world.goal[0], before, err_msg="a goal lies on the map")

def test_a_fall_begins_anew(field, monkeypatch):
    world, step, pictures = field.world, field.world.step, field.live()
    next(pictures)
    drag(field, (1.0, 0.0), (1.5, 0.0))
    for _ in range(10):
        next(pictures)

    def falls(actions, robots):
        return step(actions, robots) | {"fall": np.array([True])}

    with monkeypatch.context() as patch:
        patch.setattr(world, "step", falls)
        walk_until(field, pictures, lambda: field.axes.get_title() == "fell")
    walk_until(field, pictures, lambda: "press" in field.axes.get_title(), limit=2)
    assert world.steps[0] == 1 and not world.goal[0].any(), "it stands up at the origin"
    assert np.hypot(*world.pose[0, :2]) < 0.1

def test_play_without_a_display_is_one_line(short_trials, monkeypatch, capsys):
    def none(backend):
        raise ImportError(f"Cannot load backend {backend!r}")

    monkeypatch.setattr(evaluate.plt, "switch_backend", none)
    assert "--play needs a display" in refused(capsys, "--play")

def test_play_ends_when_its_window_is_closed(short_trials, monkeypatch):
    seen = []

    def pause(seconds):
        seen.append(evaluate.plt.gcf())
        if len(seen) == 12:
            evaluate.plt.close(seen[-1])

    monkeypatch.setattr(evaluate.plt, "switch_backend", lambda backend: None)
    monkeypatch.setattr(evaluate.plt, "pause", pause)
    evaluate.main(["--play", "--planner", str(own_planner("."))])
    assert len(seen) == 12 and len(set(seen)) == 1

def test_play_with_a_bad_planner_is_one_line(short_trials, monkeypatch, capsys):
    monkeypatch.setattr(evaluate.plt, "switch_backend", lambda backend: None)
    message = refused(capsys, "--play", "--planner", own_planner(".", "raise ValueError('no')"))
    assert "mine.py, line 12: ValueError('no')" in message
