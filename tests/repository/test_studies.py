"""The studies' own tools, with answers that are known; the studies themselves take hours."""

from dataclasses import replace
from importlib import import_module
from operator import itemgetter
from types import SimpleNamespace
from unittest import mock

import baseline
import common
import kicks
import numpy as np
import peers
import play
import pytest
import seeds
import walk
from checks import close, equal
from common import env, evaluate, robot_model, values, walk_engine
from numpy.random import default_rng
from test_01_robot_model import mujoco_at  # pytest asserts in it, too
from test_scripts import python

ROBOT = robot_model.RobotModel()
SHORT = env.Task(time_limit=5.0)  # [s]


# ------------------------------------------------------------------------ what all studies share
def test_figures_of_the_shipped_numbers_have_something_in_every_panel():
    for path in common.RESULTS.glob("*/studies/*.json"):
        found = common.read_json(path)
        for name, (part, draw) in getattr(import_module(path.stem), "PICTURES", {}).items():
            if part in found:
                figure = draw(found, path.parts[-3])
                assert all(axes.has_data() for axes in figure.axes), name


def test_walks_are_those_of_stage_05_set_by_set():
    planner = evaluate.BaselinePlanner()
    world = common.world("pymunk", task=SHORT, num_robots=3)
    both = common.walks(planner, world, sets=2, first=5)
    second = evaluate.evaluate(planner, world, evaluate.draw_trials(6, 3))
    for name in second:
        equal(both[name][3:], second[name], name)


def test_all_candidates_of_a_search_meet_the_same_goals_floors_and_noise():
    tuned = evaluate.TUNED_BASELINE["pymunk"]
    one, slow = (evaluate.BaselinePlanner(replace(tuned, forward=v)) for v in (0.4, 0.2))
    world = common.world("pymunk", num_robots=6, task=SHORT)
    first, other, again = common.calm_and_pushed([one, slow, one], [world], 7)
    for name in first:
        equal(first[name], again[name], f"{name}: the same planner, so the same walks")
    equal(first["mu"], other["mu"])
    assert any(first["time"] != other["time"]), "both walk alike: the test sees nothing"


def test_an_evolution_strategy_comes_down_a_narrow_valley_along_no_axis():
    rng = default_rng(0)
    turn = np.linalg.qr(rng.normal(size=(6, 6)))[0]

    def costs(generation, drawn):
        assert 0 <= drawn.min() and drawn.max() <= 1, "the limits"
        steep = ((drawn - 0.6) @ turn * [100, 1, 1, 1, 1, 1]) ** 2
        return steep.sum(1) if generation < 120 else None

    found = common.cma_es(costs, [0.4] * 6, 0.1, 12, rng, 0, 1)
    close(found, 0.6, "it learns along which way to go", atol=1e-3)


def test_a_search_ends_with_its_budget_and_a_generation_shares_its_worlds():
    ended, trials = {"outcome": np.array(["success", "fall"]), "steps": np.array([1, 5])}, []

    def walked(drawn, trial):
        trials.append(trial)
        return [ended | {"sum": x.sum()} for x in drawn]

    _, rows = common.search(walked, itemgetter("sum"), [0.0, 0.0], 1, budget=100, seed=2)
    assert values(rows, "steps") == [72, 144] and values(rows, "falls") == [12, 12], "a dozen"
    assert trials[0] != trials[1], "the next generation has other worlds"


def test_of_the_planners_that_keep_the_rule_the_one_with_the_fewest_points_is_taken():
    names = "time", "timeout", "fall", "pushed", "still_near", "still_far"
    table = [
        (7.0, 0.008, 0.005, 0.02, 0.93, 0.93),  # 7 + 100 · 0.008 + 200 · 0.005 = 8.8 points
        (9.0, 0.0, 0.0, 0.0, 1.0, 1.0),
        (6.9, 0.02, 0.0, 0.0, 1.0, 1.0),
        (6.1, 0.0, 0.0, 0.0, 1.0, 0.929),  # it leaves the goal
        (6.2, 0.0, 0.0, 0.0, 0.929, 1.0),
        (5.1, 0.0, 0.0, 0.021, 1.0, 1.0),  # it falls too often
        (5.2, 0.0, 0.006, 0.0, 1.0, 1.0),
        (None, 1.0, 0.0, 0.0, None, None),  # it never arrives
    ]
    rows = [dict(zip(names, row)) for row in table]
    # If nobody keeps the rule, only falls count; if everybody falls too often, all count.
    for first, best in ((0, 7.0), (3, 6.1), (5, 5.1)):
        found = baseline.choose(rows[first:])
        assert values(found, "time", chosen=True) == [best]


# ------------------------------------------------------------------------ walk, kicks
def test_soles_are_where_mujoco_has_them():
    rng = default_rng(5)
    for torso, joints in zip(rng.uniform(-0.4, 0.4, (20, 6)), rng.uniform(-0.3, 0.3, (20, 12))):
        model, data = mujoco_at(torso, joints)
        lowest = walk.lowest(ROBOT, torso, joints)
        for name, height in zip(("left sole", "right sole"), lowest, strict=True):
            up = np.abs(data.geom(name).xmat[6:])  # of its axes
            want = data.geom(name).xpos[2] - up @ model.geom(name).size
            close(height, want, "the lowest corner")


def test_clearance_is_that_of_the_swinging_foot():
    """A robot that follows its plan, but 4 mm too high."""
    p = walk_engine.TUNED["mujoco"]
    p = replace(p, step_ticks=30, double_support=1 / 3, foot_rise=0.04)  # 20 of 30 ticks swing
    engine = walk_engine.WalkEngine(1, p)
    plan = engine.plan([[[0.08, 0, 0]] * 2], [0])
    joints = robot_model.joints_for_feet(ROBOT, plan.trunk, plan.feet)[:, 1:]
    torso = plan.trunk[:, 1:] + 0.004 * np.eye(6)[2]
    motion = SimpleNamespace(torso=torso, joints=joints, fell=np.array([False]))
    clearance = walk.clearance(engine, motion)
    # At 30 and at 70 % of its swing the foot is up by s(0.6) of its rise, minimum jerk.
    want = 0.04 * (10 * 0.6**3 - 15 * 0.6**4 + 6 * 0.6**5) + 0.004
    close(clearance, want, "the lowest amid a swing")


def test_errors_that_repeat_add_up_in_what_the_filter_expects():
    rng, plan = default_rng(0), np.array([0.1, 0.0, 0.2])
    steps = plan + [0.003, 0, 0] + rng.normal(0, 0.01, (4000, 1, 3))
    steps = steps + rng.normal(0, 0.02, (4000, 8, 3))
    poses = np.zeros((4000, 9, 3))
    for k in range(8):
        poses[:, k + 1] = robot_model.compose(poses[:, k], steps[:, k])
    mean, drift = walk.off_plan(np.tile(plan, (4000, 8, 1)), poses)
    close(mean, [0.003, 0, 0], "walked − planned, seen from where the step began", atol=1e-3)
    # Var(Σ of five) / 5 = (25·0.01² + 5·0.02²) / 5
    close(drift, (5 * 0.01**2 + 0.02**2) ** 0.5, "√(Var / 5) of the sum of five", rtol=0.04)


def test_slow_noise_is_as_large_and_stays():
    slow = [kicks.Slow(default_rng(seed)) for seed in range(3000)]
    seen = np.array([[one.normal(0, 0.05) for _ in range(3)] for one in slow])
    close(seen.std(0), 0.05, "also the first", rtol=0.08)
    close(np.corrcoef(seen.T)[0], [1, 0.9, 0.81], "0.9 a double step", atol=0.05)


# ------------------------------------------------------------------------ seeds, ladder, peers
def test_falls_of_every_training_are_compared_trial_by_trial(monkeypatch):
    trial, one = np.arange(400), np.ones(400)
    falls = {"expert": trial < 10, 0: trial < 40, 1: (5 <= trial) & (trial < 15)}

    def walks(planner, *_):
        outcome = np.where(falls[planner], "fall", "success")
        return {"outcome": outcome, "time": one, "steps": one, "still_there": one}

    monkeypatch.setattr(common, "walks", walks)
    monkeypatch.setattr(common, "world", mock.Mock())  # nobody walks there
    over = seeds.walked("pymunk", {0: 0, 1: 1}, 1, {"expert": "expert"})["over"]
    alone = [values(row["falls"], key) for row in over for key in ("only_ours", "only_theirs", "p")]
    assert alone == [[30, 5], [0, 5], [2 / 2**30, 1]] * 3, "near, far, and far with pushes"


def test_an_interval_over_trainings_is_wider_than_one_over_goals():
    """Two trainings, of 0.8 and of 1.0 times the time, on all goals: which of them is shipped?"""
    rng = default_rng(0)
    theirs = rng.uniform(3, 9, 400)

    def ratio(*ours, outcome="success"):
        walks = [{"outcome": np.broadcast_to(outcome, 400), "time": time} for time in ours]
        reference = {"outcome": np.full(400, "success"), "time": theirs}
        found = seeds.over_trainings(walks, reference)
        return found["ratio"], found["ratio_ci95"]

    found, interval = ratio(0.8 * theirs, theirs)
    close([found, *interval], [0.9, 0.8, 1.0], "each alone may have been made", atol=1e-6)
    chance = theirs + rng.normal(0, 1, 400)
    _, (low, high) = ratio(chance, chance)
    width = 2 * 1.96 / (theirs.mean() * 400**0.5)
    close(high - low, width, "of one training the goals are left", rtol=0.2)
    found, _ = ratio(chance + 90, outcome=np.where(theirs < 6, "fall", "success"))
    close(found, (chance + 90)[theirs >= 6].mean() / theirs[theirs >= 6].mean(), "both arrived")


@pytest.mark.slow
def test_our_vector_environment_is_one_of_stable_baselines3():
    pytest.importorskip("stable_baselines3", reason="only the study `peers` needs it")
    settings = {"noise": True, "task": env.Task(time_limit=3.0)}
    theirs, ours = peers.Footsteps(4, **settings), env.FootstepVectorEnv(4, **settings)
    theirs.seed(7)
    equal(theirs.reset(), ours.reset(seed=7)[0])
    for action in default_rng(0).uniform(-1, 1, (12, 4, 6)):
        obs, reward, done, told = theirs.step(action)
        want, pay, terminated, truncated, infos = ours.step((action + 1) / 2)
        close([*obs.ravel(), *reward], [*want.ravel(), *pay], atol=1e-6)
        equal(done, terminated | truncated)
        for i in np.flatnonzero(done):
            equal(told[i]["terminal_observation"], infos["final_obs"][i])
            assert told[i]["TimeLimit.truncated"] != terminated[i]


# ------------------------------------------------------------------------ the window to play with
def test_without_a_display_the_window_is_one_line(monkeypatch):
    monkeypatch.setattr(play.plt, "get_backend", lambda: "agg")
    with pytest.raises(robot_model.InputError, match="needs a display"):
        play.open_window()
    play.plt.close("all")


# ------------------------------------------------------------------------ cluster
@pytest.mark.slow
def test_a_training_over_actors_is_that_of_stage_04_bit_for_bit(tmp_path):
    """In a process of its own, since Ray leaves processes behind in this one."""
    pytest.importorskip("ray", reason="only the study `cluster` needs it")
    done = python(common.ROOT / "tests" / "studies" / "cluster.py", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = common.read_json(tmp_path / "runs" / "pymunk" / "studies" / "cluster.json")
    assert all(values(found["speed"]["rows"], "equal")), "where a robot walks changes nothing"
