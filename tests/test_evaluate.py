"""Stage 5: the baseline's equations, the statistics, the trials, and the command line."""

import csv
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

evaluate = import_module("05_evaluate")
env, ppo, robot_model = evaluate.env, evaluate.ppo, evaluate.robot_model
SCRIPT = Path(evaluate.__file__)
B = evaluate.BaselineSettings()
OTHER = evaluate.BaselineSettings(0.3, 0.1, 0.2, 0.8, gain=0.5, turning_gain=2.0, far_m=0.4)


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
    hint = "every limit and gain comes from `settings`, not from the default"
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

# Solutions that look right. The tests above, `-k "speed or far_away"`, must reject every one.
RIGHT = evaluate.velocity_command

def box(goal, s):
    """Each axis is limited on its own."""
    v_x = np.clip(s.gain * goal[:, 0], -s.backward, s.forward)
    v_y = np.clip(s.gain * goal[:, 1], -s.sideways, s.sideways)
    return np.stack([v_x, v_y, RIGHT(goal, s)[:, 2]], -1)

def ellipse(goal, s):
    """The limit is round between the axes."""
    d, _, beta = env.polar(goal)
    x_max = np.where(np.cos(beta) >= 0, s.forward, s.backward)
    v = np.minimum(s.gain * d, 1 / np.hypot(np.cos(beta) / x_max, np.sin(beta) / s.sideways))
    return np.stack([v * np.cos(beta), v * np.sin(beta), RIGHT(goal, s)[:, 2]], -1)

def backward_like_forward(goal, s):
    return RIGHT(goal, replace(s, backward=s.forward))

def never_faces_it(goal, s):
    return RIGHT(goal, replace(s, far_m=math.inf))

def always_faces_it(goal, s):
    return RIGHT(goal, replace(s, far_m=0.0))

def limits_before_the_gain(goal, s):
    return RIGHT(goal, replace(s, gain=1.0)) * (s.gain, s.gain, 1)

def by_heart(goal, s):
    return RIGHT(goal, B)

def only_the_first(goal, s):
    return np.tile(RIGHT(goal[:1], s), (len(goal), 1))

def yaw_as_given(goal, s):
    """The long way round."""
    _, _, beta = env.polar(goal)
    error = np.where(np.hypot(goal[:, 0], goal[:, 1]) > s.far_m, beta, goal[:, 2])
    omega = np.clip(s.turning_gain * error, -s.turning, s.turning)
    return np.concatenate([RIGHT(goal, s)[:, :2], omega[:, None]], -1)

@pytest.mark.parametrize("wrong", [
    box, ellipse, backward_like_forward, never_faces_it, always_faces_it, limits_before_the_gain,
    by_heart, only_the_first, yaw_as_given], ids=lambda function: function.__name__)
def test_the_grading_rejects(wrong, monkeypatch):
    graders = [test for name, test in globals().items()
               if name.startswith("test_") and ("speed" in name or "far_away" in name)]
    assert len(graders) >= 6, "the tests that grade velocity_command have other names now"
    monkeypatch.setattr(evaluate, "velocity_command", wrong)
    for grade in graders:
        try:
            grade()
        except Exception:
            return
    pytest.fail(f"{wrong.__name__} passes all {len(graders)} tests of velocity_command")

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

def test_velocities_become_mirrored_footsteps():
    velocities = np.array([[0.12, 0, 0], [0, 0.06, 0], [0, -0.06, 0], [0, 0, 0.2]])
    expected = [[[0.03, 0, 0], [0.03, 0, 0]], [[0, 0.03, 0], [0, 0, 0]],
                [[0, 0, 0], [0, 0.03, 0]], [[0, 0, 0.05], [0, 0, -0.05]]]
    hint = "outward is positive for both feet: y and yaw of the right foot are mirrored"
    steps = evaluate.velocity_to_footsteps(velocities, period=0.5)  # [4, 2, 3]
    np.testing.assert_allclose(steps, expected, atol=1e-12, err_msg=hint)

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
    world = env.FootstepWorld(2, cores=1)
    planner.reset(2)
    speeds = []
    for _ in range(5):
        action = planner.act(world, np.array([1]), np.array([[-3.0, -3.0, -3.0]]))
        assert action.shape == (1, 6) and (action >= 0).all() and (action <= 1).all()
        speeds.append(np.abs(planner.velocity[1]).sum())
    world.close()
    assert np.all(np.diff(speeds) > 0), "the filtered velocity rises step by step"
    assert not planner.velocity[0].any(), "robot 0 was not asked, only robot 1"


# ------------------------------------------------------------------------ statistics
def test_wilson_interval():
    assert evaluate.wilson(5, 10) == pytest.approx([0.2366, 0.7634], abs=1e-4)
    assert evaluate.wilson(490, 500) == pytest.approx([0.9636, 0.9891], abs=1e-4)
    low, high = evaluate.wilson(500, 500)
    assert high == pytest.approx(1) and 0.99 < low < 1, "500 of 500 does not prove 100 %"
    assert evaluate.wilson(0, 500) == pytest.approx([1 - high, 1 - low]), "not symmetric"

def test_wilson_interval_covers_the_truth_95_times_in_100():
    rng, p, n = np.random.default_rng(0), 0.96, 500
    inside = [low <= p <= high for low, high in
              (evaluate.wilson(k, n) for k in rng.binomial(n, p, size=4000))]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)

def trials(outcomes, times, still_there=None):
    reached = np.array(outcomes) == "success"
    return {"outcome": np.array(outcomes), "time": np.array(times, float),
            "still_there": reached if still_there is None else np.array(still_there)}

def test_time_ratio_uses_only_goals_that_both_reached():
    ours = trials(["success", "success", "fall"], [5, 10, 1])
    theirs = trials(["success", "success", "success"], [10, 20, 100])
    ratio, (low, high), goals = evaluate.time_ratio(ours, theirs)
    assert (ratio, goals) == (0.5, 2), "a fall's time must not count as a fast success"
    assert low == high == 0.5, "paired: a goal's difficulty cancels out, resample goals, not times"
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
    row = evaluate.summary("policy", False, four, env.Task())
    assert (row["success"], row["fall"], row["timeout"]) == (0.5, 0.25, 0.25)
    assert row["success_ci95"] == [round(edge, 4) for edge in evaluate.wilson(2, 4)]
    assert (row["time_mean"], row["time_std"]) == (5, 1), "a mean over the successes only"
    assert row["still_there"] == 0.5, "a share of the successes, not of the episodes"
    assert "noise_m" not in row and evaluate.summary("p", True, four, env.Task())["noise_m"] == 0.05

def test_summary_without_a_success_is_valid_json():
    row = evaluate.summary("policy", True, trials(["fall", "timeout"], [1, 100]), env.Task())
    assert row["success"] == 0 and row["fall"] == row["timeout"] == 0.5
    assert row["time_mean"] is row["still_there"] is None, "no success: no mean, and not 0 or nan"
    json.dumps(row, allow_nan=False)
    assert "none" in evaluate.table([row], [])

def test_ratios_compare_policies_with_baselines_under_the_same_noise():
    fast, slow = trials(["success"] * 2, [4, 6]), trials(["success"] * 2, [8, 12])
    never = trials(["timeout"] * 2, [100, 100])
    runs = {("policy", False): fast, ("policy_imu", False): never, ("baseline", False): slow,
            ("baseline_tuned", False): fast, ("policy", True): slow, ("baseline", True): slow}
    found = {(r["planner"], r["reference"], r["noise"]): r["time_ratio"]
             for r in evaluate.compare(runs)}
    assert found == {("policy", "baseline", False): 0.5, ("policy", "baseline_tuned", False): 1.0,
                     ("policy", "baseline", True): 1.0}, "policy_imu reached nothing: no ratio"

def test_table_has_the_paper_s_row_below_ours():
    four = trials(["success", "success", "fall", "timeout"], [4, 6, 1, 100], [1, 0, 0, 0])
    rows = [evaluate.summary(name, True, four, env.Task()) for name in ("policy", "policy_imu")]
    lines = [line.strip("|").split("|") for line in evaluate.table(rows, []).splitlines()[:5]]
    cells = [[cell.strip() for cell in line] for line in lines]
    assert {len(line) for line in cells} == {8}, "every row has a cell for every column"
    assert [line[2] for line in cells[2:]] == ["ours", "paper", "ours"], "the paper had no IMU"
    assert cells[2] == ["yes", "policy", "ours", "0.500 [0.150, 0.850]", "0.250", "0.250",
                        "5.00 ± 1.00", "0.500"]
    assert cells[3][3:7] == ["0.978", "0.000", "0.022", "6.35 ± 2.23"], "Table II, with noise"
    assert "paper" not in evaluate.table(rows, [], {})


# ------------------------------------------------------------------------ trials
class Recorder:
    """Steps on the spot and remembers what it was told."""

    def reset(self, num_robots):
        self.measured = []

    def act(self, world, robots, measured):
        self.measured.append(measured.copy())
        return np.tile(world.neutral_action, (len(robots), 1))

class Wild(Recorder):
    """A planner that behaves differently."""

    def act(self, world, robots, measured):
        super().act(world, robots, measured)
        return np.tile([0.7, 0.3, 0.5, 0.7, 0.3, 0.5], (len(robots), 1))

SHORT = env.Task(time_limit=2.0)  # three decisions are enough

@pytest.fixture(scope="module")
def world():
    world = env.FootstepWorld(10, cores=1, task=SHORT)
    yield world
    world.close()

def first_noise(planner, world, goals):
    evaluate.evaluate(planner, world, goals, seed=3, noise=True)
    noise = planner.measured[0] - goals
    noise[:, 2] = env.wrap(noise[:, 2])
    return noise

def test_noise_of_a_goal_depends_on_neither_planner_nor_number(world):
    goals = env.draw_goals(env.stream("evaluation", 3), 6)
    np.testing.assert_array_equal(goals[:2], env.draw_goals(env.stream("evaluation", 3), 2))
    noise = first_noise(Recorder(), world, goals)
    hint = "one generator per goal and one `world.measure` per decision"
    np.testing.assert_array_equal(noise, first_noise(Wild(), world, goals), err_msg=hint)
    np.testing.assert_array_equal(noise[:2], first_noise(Recorder(), world, goals[:2]), hint)
    assert len(np.unique(noise)) == noise.size, "goals must not share their noise"
    drawn = (goals / [1, 1, math.pi / 2])[0]
    assert not np.allclose(noise[0] / 0.05, drawn), "goals and noise come from the same generator"

def test_outcomes_are_exclusive_and_deterministic(world):
    goals = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])  # where it stands; too far for 2 s
    runs = [evaluate.evaluate(evaluate.BaselinePlanner(), world, goals) for _ in range(2)]
    assert runs[0]["outcome"].tolist() == ["success", "timeout"]
    assert runs[0]["still_there"].tolist() == [True, False], "only a success can be still there"
    assert runs[0]["time"][0] == pytest.approx(world.engine.period), "a step is counted twice"
    assert runs[0]["steps"].tolist() == [1, 3], "1.68 s are three double steps; a fourth is late"
    for key in runs[0]:
        np.testing.assert_array_equal(runs[0][key], runs[1][key], err_msg="same seed, same numbers")

AWAY, NEARBY, TWISTED = (0.5, 0, 0), (0.06, 0, 0), (0, 0, math.radians(11))
THERE = (0.02, -0.03, math.radians(9))  # 3.6 cm and 9° from the goal: inside
FALLS = "falls"
ENDINGS = {  # poses after each double step, seen from the goal; is it still there?
    "stays": ((THERE, THERE, THERE), True),
    "arrives later": ((AWAY, THERE, THERE, THERE), True),
    "sways and returns": ((THERE, NEARBY, THERE), True),
    "rolls on by 6 cm": ((THERE, THERE, NEARBY), False),
    "turns on by 11°": ((THERE, THERE, TWISTED), False),
    "falls at once": ((THERE, FALLS, THERE), False),
    "falls at last": ((THERE, THERE, FALLS), False),
    "falls before it arrives": ((AWAY, FALLS, THERE), False),
    "arrives too late": ((AWAY, AWAY, AWAY, THERE), False),
    "lies at the goal": ((FALLS, THERE, THERE), False),
}

def test_still_there_means_inside_and_standing_after_two_more_double_steps(world, monkeypatch):
    """Physics by heart, and a look at every double step that the world is asked for."""
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
    found = evaluate.evaluate(planner, world, np.zeros((len(ENDINGS), 3)), noise=True)
    for i, (name, (_, still_there)) in enumerate(ENDINGS.items()):
        assert found["still_there"][i] == still_there, f"{name}: {found['outcome'][i]}"
    assert found["outcome"].tolist() == ["success"] * 7 + ["fall", "timeout", "fall"]
    assert found["steps"].tolist() == [1, 2, *[1] * 5, 2, 3, 1], (
        "steps and time end with the trial, not with the two double steps after it")
    np.testing.assert_allclose(found["time"], found["steps"] * world.engine.period)
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
        def act(self, world, robots, measured):
            return action

    with pytest.raises(ValueError, match=r"^actions must be finite .* \(2, 6\)"):
        evaluate.evaluate(Broken(), world, np.zeros((2, 3)))

def test_the_recorded_walk_is_the_measured_one(world):
    walk, = evaluate.record(Recorder(), world, np.array([[1.0, 0.0, 0.0]]))
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
    walk, = evaluate.record(Wild(), world, np.array([[3.0, 0.0, 0.0]]))
    world.close()
    planned = robot_model.compose(np.tile(moved, (1, 2, 1)), world.engine.feet)[0]  # [2, 3]
    np.testing.assert_allclose(walk["feet"][-1], planned, atol=1e-6, err_msg=(
        "left and right: x, y of the ankle's projection [m], yaw [rad]"))


# ------------------------------------------------------------------------ files
def save_untrained(path, sim="pymunk", imu=False, steps=10, **fits):
    """A policy that steps on the spot whatever it sees: nearly its first one."""
    torch.manual_seed(0)
    neutral = env.to_action(np.zeros((2, 3)), env.walk_engine.LIMITS[sim])
    model = ppo.ActorCritic(len(env.observation_table(imu)), 6, first_action=neutral)
    path.parent.mkdir(parents=True, exist_ok=True)
    ppo.save_policy(path, model, {"fits": env.fingerprint(sim, imu) | fits, "steps": steps,
                                  "minutes": 0.1, "seed": 0})
    return path

def save_tuned(path, **changed):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"sim": "pymunk", "settings": asdict(OTHER) | changed}))

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
    ("x,y,yaw\n", 1), ("x,y,yaw\n1,2,\n", 2)])
def test_a_malformed_goals_file_names_the_line(text, line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("goals.csv").write_text(text)
    message = refused(capsys, "--goals", "goals.csv")
    assert f"goals.csv, line {line}: " in message, f"{text!r}: line {line} is the wrong one"

def test_goals_file_is_read_whatever_wrote_it(tmp_path):
    path = tmp_path / "goals.csv"
    path.write_bytes("\ufeffname, X ,y,yaw\r\na,1,-2.5,7\r\n\r\n".encode())  # as a spreadsheet does
    np.testing.assert_allclose(evaluate.read_goals(path), [[1, -2.5, 7 - 2 * math.pi]])

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
    refused(capsys, "--policy", good, "--seed", "-1")
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


# ------------------------------------------------------------------------ which planners
def test_runs_win_over_results(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for steps, folder in enumerate(("results", "runs")):
        save_untrained(Path(folder, "pymunk/policy.pt"), steps=steps)
        save_untrained(Path(folder, "pymunk/imu/policy.pt"), imu=True, steps=steps)
        save_tuned(Path(folder, "pymunk/baseline_tuned.json"), forward=0.5 + steps)
        planners, about = evaluate.choose_planners("pymunk")
        assert set(about) == {"policy", "policy_imu", "baseline_tuned"}
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
    save_tuned(Path("results/mujoco/baseline_tuned.json"))
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
    monkeypatch.setattr(evaluate, "run", lambda world, goals, planners, *_: print(*planners))
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
    (tmp_path / "goals.csv").write_text("x,y,yaw\n0,0,0\n0.03,0,0.1\n0,-0.02,-0.1\n")
    arguments = ["--noise", "--goals", "goals.csv", "--out"]
    done = subprocess.run([sys.executable, SCRIPT, *arguments, "one"], capture_output=True,
                          encoding="utf-8", env=os.environ | {"PYTHONUTF8": "1"}, check=False)
    assert done.returncode == 0, done.stderr
    monkeypatch.setattr(robot_model, "CORES", 1)
    evaluate.main([*arguments, "two"])
    texts = [[Path(out, name).read_text(encoding="utf-8") for name in (
        "evaluation.json", "trials.csv", "table.md")] for out in ("one", "two")]
    assert texts[0] == texts[1], "the same seed gives the same numbers, whatever the cores"
    assert "results/pymunk/policy.pt" in done.stdout and texts[0][2] in done.stdout
    assert (tmp_path / "one/footsteps.png").read_bytes().startswith(b"\x89PNG")
    assert not list(tmp_path.rglob("*.tmp*")), "a temporary file was left behind"

    content = json.loads(texts[0][0])
    assert content["sim"] == "pymunk" and content["policy"]["steps"] == 10
    names = ["policy", "policy_imu", "baseline", "baseline_tuned"]
    assert [(r["planner"], r["noise"]) for r in content["rows"]] == [
        (name, noise) for noise in (False, True) for name in names]
    for row in content["rows"]:
        assert row["success"] + row["timeout"] + row["fall"] == pytest.approx(1, abs=2e-4)
        assert row["success_ci95"][0] <= row["success"] <= row["success_ci95"][1]
        assert ("noise_m" in row) == row["noise"]
    assert len(content["ratios"]) == 8, "two policies × two baselines × two noise settings"
    lines = list(csv.DictReader(texts[0][1].splitlines()))
    assert list(lines[0]) == ["planner", "noise", "trial", "x", "y", "yaw", "outcome", "time",
                              "steps", "still_there"]
    assert [line["trial"] for line in lines] == ["0", "1", "2"] * len(content["rows"])
    goals = {name: [line["x"] for line in lines if line["planner"] == name] for name in names}
    assert all(goal == goals["policy"] for goal in goals.values()), "the same goals for everyone"
    for line in lines:
        assert line["outcome"] in evaluate.OUTCOMES and line["still_there"] in ("yes", "no")
        assert float(line["time"]) == pytest.approx(0.56 * int(line["steps"])), "double steps"
    again = evaluate.read_goals(tmp_path / "one/trials.csv")  # failed trials can be repeated
    np.testing.assert_array_equal(again[:3], evaluate.read_goals(tmp_path / "goals.csv"))
    assert evaluate.table(content["rows"], content["ratios"], {}) == texts[0][2], (
        "the paper's rows are about its goals, not about yours")

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

def test_gif_is_a_moving_picture_in_real_time(short_trials, monkeypatch):
    task = env.Task(time_limit=1.2)  # two double steps
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
    assert walk == pytest.approx(2 * 0.56, abs=0.15), "two double steps take 1.1 s, in real time"
    assert sum(seconds) > walk + 1, "the end stays for a while"
    assert not list(Path().rglob("*.tmp*")), "a temporary file was left behind"

def test_an_interrupted_evaluation_says_so(short_trials, monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(evaluate, "run", interrupted)
    assert run_main("--episodes", 1) == 130, "the exit code of Ctrl-C"
    assert capsys.readouterr().err.strip() == "interrupted"
