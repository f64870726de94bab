"""Stage 3, checked against the task. A failing test names the likely mistake."""

import itertools
import math
import os
import sys
from dataclasses import replace
from functools import cache
from importlib import import_module
from unittest import mock

import gymnasium as gym
import numpy as np
import pytest
from checks import BOTH, IN_3D_SLOW, close, equal, frozen
from gymnasium.utils.env_checker import check_env
from numpy.random import default_rng

env = import_module("03_env")
robot_model, walk_engine = env.robot_model, env.walk_engine
FootstepWorld, FootstepVectorEnv = env.FootstepWorld, env.FootstepVectorEnv
Spread, stream = env.Spread, env.stream
TASK = env.Task()
OTHER = env.Task(
    near_m=0.7, s_d=2, s_a=0.5, s_o=0.2, s_c=0.05, s_fall=3, s_goal=4, s_time=0.5, s_stay=6,
    goal_std_m=0.3,
)  # fmt: skip
ROBOT = robot_model.RobotModel()
WALK = walk_engine.TUNED["pymunk"]


def motion(poses, fell=False, waits=0, usual=2 * WALK.step_ticks):
    """A Motion that ends at these poses [n, 3], for a physics that does as the test says. It takes
    so many ticks more than the usual ones."""
    n = len(poses)
    torso = np.zeros((n, 1, 6))
    torso[:, 0, robot_model.GROUND] = poses
    ticks = np.full(n, usual + waits)
    return robot_model.Motion(torso, np.zeros((n, 1, 12)), np.full(n, fell), ticks)


def follow(world, poses, fell=False, waits=0):
    """From now on its physics does this, whatever is planned: see `motion`. Returns the list of the
    Disturbances that it will be told."""
    done, told = motion(poses, fell, waits, world.engine.period_ticks), []

    def run(robots, plan, disturbance):
        told.append(disturbance)
        world.simulator.state[robots, :6] = done.torso[:, -1]
        return done

    world.simulator.run = run
    return told


def related(noise):
    """The largest correlation of two of these numbers [K, ..., c], in a moment or the next one."""
    pairs = np.concatenate([noise[:-1], noise[1:]], -1).reshape(-1, 2 * noise.shape[-1])
    return np.abs(np.corrcoef(pairs.T) - np.eye(len(pairs.T))).max()


@BOTH
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.filterwarnings("error")
def test_gymnasium_finds_nothing_to_complain_about(sim):
    one = gym.make("Footsteps-v0", sim=sim, render_mode="rgb_array")
    walks = []
    for _ in range(2):
        seen, _ = one.reset(seed=3)
        walks.append([seen, one.step(np.full(6, 0.6, np.float32))[0]])
    equal(*walks, "the same seed, and another walk: a reset keeps something of the last one")
    check_env(one.unwrapped)


@BOTH
def test_robots_together_equal_robots_alone(sim):
    n, rng, task = 3, default_rng(0), replace(TASK, time_limit=2.0, push_every=1.0)
    # It answers a lean strongly: a double step may take longer.
    walk = replace(walk_engine.TUNED[sim], capture=1.0, wait=30.0)
    settings = {"sim": sim, "noise": True, "push": 1.2, "task": task, "walk": walk}  # some fall
    together = gym.make_vec("Footsteps-v0", n, **settings)
    alone = gym.make_vec("Footsteps-v0", n, "sync", {"autoreset_mode": "SameStep"}, **settings)
    equal(together.reset(seed=11)[0], alone.reset(seed=11)[0], "robot i has the seed s + i")
    fell = set()
    for _ in range(7):
        actions = together.neutral_action + rng.uniform(-0.1, 0.1, (n, 6))
        actions[:, [0, 3]] = rng.integers(0, 2, (n, 2))  # as far ahead or back as it goes
        *got, infos = together.step(actions)  # observation, reward, terminated, truncated
        *want, own = alone.step(actions)
        hint = "all is drawn by the robot's own generator, equally often"
        np.testing.assert_equal(got, want, hint)
        if "final_info" in infos:
            ended, final = own["_final_info"], infos["final_info"]
            last = [*own["final_obs"][ended]]
            equal(infos["final_obs"][ended], last, "of the old episode, not of the next one")
            final |= final.pop("reward_terms")  # one after the other
            for name, values in final.items():
                equal(values[ended], own["final_info"][name][ended], name)
            fell.update(final["fall"][ended])
    hint = "the test should see resets after falls (does a push reach the robot?) and time-outs"
    assert fell == {True, False}, hint


def test_goal_is_encoded_as_in_the_table():
    d, beta, alpha = 0.3, math.radians(120), math.radians(-45)
    goal = np.array([d * math.cos(beta), d * math.sin(beta), alpha])
    want = [0.3, -0.3, 0.5196152, -0.5, 0.8660254, 0.7071068, -0.7071068, -0.25]
    hint = (
        "d, 2d·cos β, 2d·sin β, cos β, sin β, cos α, sin α, α/π; α is not β "
        "(for 0.3 m, β = 120°, α = −45°)"
    )
    close(env.encode_goal(goal), want, hint)
    far = env.encode_goal(np.broadcast_to([4.0, -3.0, math.pi * 1.5], 3))
    close(far[:3], [2, 1, -1], "clipped: 2 m and ±1 (for a goal at (4, −3))")
    close(far[7], -0.5, "270° is −90°: wrap the angle")


@pytest.mark.parametrize("shape", [(1,), (7,), (2, 3)], ids=str)
def test_many_goals_are_encoded_each_by_itself(shape):
    goals = default_rng(6).uniform([-2, -2, -9], [2, 2, 9], (*shape, 3))
    encoded = env.encode_goal(goals)
    assert encoded.shape == (*shape, 8), "goals [..., 3] -> [..., 8]: write x as goal[..., 0]"
    alone = [env.encode_goal(goal) for goal in goals.reshape(-1, 3)]
    close(encoded.reshape(-1, 8), alone, f"goals of {shape} must not mix")


def test_the_last_action_is_observed():
    one = env.FootstepEnv()
    one.reset(seed=0)
    neutral = one.envs.world.neutral_action
    small = neutral + [0.05, 0, 0, 0, 0.02, 0]
    close(one.step(small)[0][-6:], small * 2 - 1, "of this double step")
    close(one.step(neutral)[0][-6:], neutral * 2 - 1, "of this double step")
    for much in (9, -9):  # a list
        seen = one.step([much] * 6)[0][-6:]
        close(seen, np.sign(much), "as it was asked for, clipped to [0, 1]")


SHARES = (
    "0 is low, 1 is high, 0.5 their middle, for both feet, outward positive; first the left "
    "foot's x, y, yaw, then the right foot's"
)


@BOTH
def test_actions_and_footsteps_are_inverse(sim):
    rng, narrow = default_rng(2), env.StepLimits((-0.1, 0.02, -0.3), (0.3, 0.02, 0.3))
    for limits, shape in itertools.product((narrow, env.LIMITS[sim]), [(10, 100), ()]):
        low, high = np.tile(limits.low, 2), np.tile(limits.high, 2)  # [6]
        shares = rng.random((*shape, 6))
        want = (low + shares * (high - low)).reshape(*shape, 2, 3)
        frozen(shares, want)
        got = env.to_footsteps(shares, limits)
        assert got.shape == want.shape, "actions [..., 6], any [...] -> footsteps [..., 2, 3]"
        close(got, want, SHARES, atol=1e-6)
        action = env.to_action(want, limits)
        assert action.shape == shares.shape, "footsteps [..., 2, 3] -> actions [..., 6], any [...]"
        hint = "to_action is the inverse: what is within the limits is walked as asked for"
        close(env.to_footsteps(action, limits), want, hint, atol=1e-6)
    for step, end in (9.0, 1), (-9.0, 0):
        close(env.to_action(np.full((2, 3), step), limits), end, "clipped to [0, 1]")


@pytest.mark.parametrize("name, shape", [("actions", (2, 6)), ("goals", (2, 3))])
def test_wrong_numbers_are_refused_and_change_nothing(name, shape):
    one, untouched = (FootstepVectorEnv(2, noise=True) for _ in range(2))
    for envs in (one, untouched):
        envs.reset(seed=8)
    for wrong in (np.full(shape, math.nan), np.zeros(shape)[None], 0.5):
        with pytest.raises(ValueError, match=f"^{name} must be finite numbers of sh"):
            one.step(wrong) if name == "actions" else one.reset(options={"goals": wrong})
    action = np.full((2, 6), 0.45)
    equal(one.step(action)[0], untouched.step(action)[0], "check BEFORE anything is drawn")


def potentials(goals, task=TASK):
    """The three quantities Φ [n] of goals (x, y, α) [n, 3] that a reward pays the changes of."""
    x, y, yaw = goals.T
    d, beta = np.hypot(x, y), np.arctan2(y, x)
    alpha = robot_model.wrap(yaw)
    near = np.exp(-((d / task.near_m) ** 2))
    return {
        "r_d": -task.s_d * d,
        "r_a": -task.s_a * abs(alpha) * near,
        "r_o": -task.s_o * abs(beta) * (1 - near),
    }


def by_hand(before, after, action, last, fall, success, task, periods, margin):
    """All eight terms, each [n]."""
    old, new = potentials(before, task), potentials(after, task)
    return {
        **{name: new[name] - old[name] for name in old},
        "r_c": -task.s_c * ((action - last) ** 2).sum(1),
        "r_fall": np.where(fall, -task.s_fall, 0),
        "r_goal": np.where(success, task.s_goal, 0),
        "r_time": -task.s_time * periods,
        "r_stay": np.where(success, task.s_stay * margin, 0),
    }


NEAR = "near(d) = exp(−(d / 0.4 m)²)"
FORMULAS = {
    "r_d": "progress: d before − d after",
    "r_a": "|α|·near(d) − |α′|·near(d′), both signs are alike, " + NEAR,
    "r_o": "|β|·far(d) − |β′|·far(d′), far(d) = 1 − near(d), " + NEAR,
    "r_c": "−Σ (action − last action)² over all six numbers",
    "r_fall": "a fall costs s_fall",
    "r_goal": "a success pays s_goal",
    "r_time": "every double step costs s_time, and more if it took longer than a period",
    "r_stay": "a success pays s_stay, times the margin with which the robot comes to rest",
}


@pytest.mark.parametrize("task", [TASK, OTHER], ids=["task", "another task"])
def test_reward_formulas_of_every_robot_are_those_by_hand(task):
    rng, n = default_rng(8), 6  # yaws beyond a turn: α is wrapped
    before, after = rng.uniform([-1, -1, -6], [1, 1, 6], (2, n, 3))
    action, last = rng.random((2, n, 6))
    fall, success = np.arange(n) % 3 == 0, np.arange(n) % 3 == 1
    frozen(before, after, action, last, fall, success)
    periods, margin = rng.uniform(1, 1.6, n), rng.uniform(-0.5, 1, n)
    told = before, after, action, last, fall, success, task, periods, margin
    got, want = env.reward_terms(*told), by_hand(*told)
    assert got.keys() >= want.keys(), "a term is missing"
    for name, values in got.items():
        assert np.shape(values) == (n,), (
            f"{name}: [n], sums go over the action's axis only, .sum(-1) (got {np.shape(values)})"
        )
    for name in want:
        close(
            got[name],
            want[name],
            f"{name} of a robot: the sign, the scalar of this task, an angle that is not wrapped, "
            f"or another robot's numbers? {FORMULAS[name]}",
        )


@IN_3D_SLOW
def test_rewards_of_a_real_walk_compare_the_poses_before_and_after(sim):
    goals = default_rng(4).normal(0, [0.5, 0.5, 2], (4, 3))
    world, robots = FootstepWorld(4, sim, noise=True), np.arange(4)
    world.reset(robots, [default_rng(i) for i in robots], goals)
    for _ in range(12):
        before, last = robot_model.relative(world.pose, goals), world.last_action.copy()
        action = env.hand_written(world.view(robots).goal, world.limits)
        result = world.step(action, robots)
        after = robot_model.relative(world.pose, goals)
        margin = env.margin_at_rest(after, world.engine.closing_step(robots), TASK)
        periods = result["motion"].ticks / world.engine.period_ticks
        ended = result["fall"], result["success"]
        want = env.reward_terms(before, after, action, last, *ended, TASK, periods, margin)
        for name, values in result["reward_terms"].items():
            close(values, want[name], f"{name}: true goals seen before and after the double step")
        close(result["reward"], sum(want.values()))


def test_the_margin_is_that_of_the_place_where_the_trunk_comes_to_rest():
    rest = np.array([0.04, -0.01, -0.05])  # ahead, to the right: a goal here has the margin 1
    off = np.array([
        [0, 0, 0],
        [0.03, 0, 0],  # 3 of 5 cm beyond
        [0, 0.04, np.radians(5)],  # 4 of 5 cm, 5 of 10°
        [0, 0, np.radians(-12)],  # outside
    ])  # fmt: skip
    got = env.margin_at_rest(robot_model.compose(rest, off), np.tile(rest, (4, 1)), TASK)
    close(got, [1, 0.4, 0.2, -0.2], "1 − max(d / 5 cm, |α| / 10°), seen from the place of rest")


def test_discounted_progress_telescopes():
    # Σ γᵗ·(Φ_{t+1} − Φ_t) = γᵀ·Φ_end − Φ_start + (1 − γ)·Σ γᵗ·Φ_{t+1},  t = 0 … T − 1
    path = default_rng(9).uniform([-1, -1, -3], [1, 1, 3], (21, 3))  # T = 20
    still, never = np.zeros((20, 6)), np.zeros(20, bool)
    gamma = 0.95  # as in stage 4; any other one would do
    factors = gamma ** np.arange(20)
    parts = env.reward_terms(path[:-1], path[1:], still, still, never, never, TASK)
    for name, phi in potentials(path).items():
        want = gamma**20 * phi[-1] - phi[0] + (1 - gamma) * factors @ phi[1:]
        hint = f"{name} is Φ′ − Φ, not Φ − Φ′ and not γ·Φ′ − Φ: {FORMULAS[name]}"
        close(factors @ parts[name], want, hint)


def test_goals_are_spread_as_the_task_says_and_do_not_depend_on_their_number():
    goals = env.draw_goals(stream("evaluation", 0), 5000, OTHER)
    close(goals.mean(0), 0, atol=0.08)
    close(goals[:, :2].std(0), OTHER.goal_std_m, rtol=0.05)
    assert np.all(np.abs(goals[:, 2]) <= math.pi), "yaw is wrapped"
    share = np.mean(np.abs(goals[:, 2]) < math.pi / 2)  # N(0, π/2) wrapped: 0.683 and a bit more
    assert 0.64 < share < 0.73, f"{share:.2f} of the goals turn by less than 90°"
    seven = env.draw_goals(stream("evaluation", 0), 7, OTHER)
    equal(seven, goals[:7], "draw [count, 3], goal after goal")


def test_every_second_goal_of_the_training_is_far():
    world, robots = FootstepWorld(1500), np.arange(1500)
    world.simulator.reset = lambda *_: None  # only goals are of interest here
    world.reset(robots, [stream("training", i) for i in robots])
    d = np.hypot(*world.goal[:, :2].T)
    # x, y ~ N(0, σ) lie within r with 1 − exp(−r² / 2σ²); half have σ = 0.5 m, half 1 m
    r = np.array([0.3, 0.6, 1.0, 1.5, 2.0])  # [m]
    want = 1 - (np.exp(-((r / 0.5) ** 2) / 2) + np.exp(-(r**2) / 2)) / 2
    found = np.mean(d[:, None] < r, 0)
    close(found, want, f"goals within {r} m: all with one spread, or not half and half?", atol=0.04)


def test_streams_are_separate():
    numbers = [(), (0,), (1,), (0, 0), (0, 1), (1, 0)]
    keys = [(name, seed, *more) for name in env.STREAMS for seed in (0, 1) for more in numbers]
    drawn = {stream(*key).random() for key in keys}
    assert len(drawn) == len(keys), "to numpy (0, 0) is (0): zeros at the end vanish"


def test_noise_has_the_size_of_the_task_and_off_means_exact():
    goal, robots = np.array([[0.5, -0.4, 3.13]] * 30), np.arange(30)  # near ±π: wrap the noise
    exact, noisy = (FootstepWorld(30, noise=noise) for noise in (False, True))

    def measured(world):
        world.set_goal(robots, goal)  # so that the last measurement is forgotten
        return world.view(robots).goal

    for world in exact, noisy:
        world.reset(robots)
    close(measured(exact), goal)
    exact.measure(robots)
    close(exact.view(robots).goal, goal, "also a second time")
    seen = np.array([measured(noisy) for _ in range(100)])  # [100, 30, 3]
    error = robot_model.wrap(seen - goal) / [TASK.noise_m, TASK.noise_m, TASK.noise_rad]
    close(error.std((0, 1)), 1, "the size is that of the task", rtol=0.06)
    close(error.mean((0, 1)), 0, atol=0.08)
    assert related(error) < 0.1, "every number has noise of its own, anew each time"
    close(noisy.relative_goal(robots), goal, "the true goal stays true")


@BOTH
def test_feet_within_the_limits_do_not_touch(sim):
    limits, beside = env.LIMITS[sim], walk_engine.TUNED[sim].foot_distance
    inside = ROBOT.foot_width / 2 - ROBOT.foot_outward  # [m] from the ankle to the inner edge
    ends, edges = (-ROBOT.foot_back, ROBOT.foot_front), (-inside, ROBOT.foot_width - inside)
    sole = np.array([*itertools.product(ends, edges)])  # [4, 2] seen from the left ankle
    for x, y, yaw in itertools.product(*zip(limits.low, limits.high)):  # where the left foot lands
        corners = robot_model.turned(sole, yaw) + [x, beside + y]
        assert corners[:, 1].min() > inside + 0.01, f"{(x, y, yaw)}: on the right foot, or nearly"


DRIFT, NOISE = np.broadcast_to([[0.1, 0.2, 0.5], [0.1, 0.1, 0.2]], (2, 3))


BATCH = "your function gets batches [n, …]: n goals [n, 3], n covariances [n, 3, 3]"


def explained(got, mistakes, hint):
    """The hint, or of these mistakes (what each of them gives, by what to say) the one that was made."""
    return next((said for said, wrong in mistakes.items() if np.allclose(got, wrong)), hint)


def test_estimate_predict_by_hand():
    goal = np.array([[2.4, 0, 0.5], [1.3, 0.1, 0.5]])
    before = np.array([[[0.01, 0.004, 0], [0.004, 0.02, 0.003], [0, 0.003, 0.03]]] * 2)
    before[1] *= 2
    motion = np.array([[0.4, 0, 0], [0.3, 0.1, math.pi / 2]])
    frozen(goal, before, motion)
    got, covariance = env.predict(goal, before, motion, DRIFT)
    assert (np.shape(got), np.shape(covariance)) == (goal.shape, before.shape), BATCH
    hint = "the goal seen from the new pose: who turns left sees it turn right; `relative`"
    close(got, [[2.0, 0, 0.5], [0, -1.0, 0.5 - math.pi / 2]], hint)
    # drift² = 0.01, 0.04, 0.25; of the first goal, at x = 2: (x·0.5)² to y, x·0.5² to y with yaw
    hint = (
        "G·D·Gᵀ, D = diag(drift²): an unplanned turn by e moves a goal at x ahead by e·x to the "
        "SIDE; x is that after the double step"
    )
    root = "D = diag(drift²), variances: `drift` holds standard deviations, so square them"
    got = np.diagonal(covariance[0])
    hint = explained(got, {root: [0.11, 0.22 + 2.0, 0.53]}, hint)
    close(got, [0.02, 0.06 + 1.0, 0.28], hint)
    hint = (
        "G·D·Gᵀ: who turned too far sees the goal too far to the right and turned, so these errors "
        "belong together"
    )
    close(covariance[0], [[0.02, 0.004, 0], [0.004, 1.06, 0.503], [0, 0.503, 0.28]], hint)
    # of the second one, at y = −1: (y·0.5)² to x; x′ = y and y′ = −x
    P = np.array([[0.04, -0.008, 0.006], [-0.008, 0.02, 0], [0.006, 0, 0.06]])  # J·P·Jᵀ
    added = [[0.26, 0, 0.25], [0, 0.04, 0], [0.25, 0, 0.25]]  # G·D·Gᵀ
    too_early = P + [[0.04, 0, 0], [0, 0.26, -0.25], [0, -0.25, 0.25]]
    late = "G·D·Gᵀ is seen from the new pose: first turn P, J·P·Jᵀ, then add G·D·Gᵀ"
    _, alone = env.predict(goal[1:], before[1:], motion[1:], DRIFT)
    own = "right for one robot alone: J = Rz(−turn) of a robot has its OWN turn, motion[:, 2]"
    mistakes = {late: too_early} | ({own: covariance[1]} if np.allclose(alone, P + added) else {})
    hint = (
        "J·P·Jᵀ, J = Rz(−turn): who turns left sees the goal, and its errors of x and y, turn back "
        "with it"
    )
    close(covariance[1], P + added, explained(covariance[1], mistakes, hint))


def test_estimate_correct_by_hand():
    together = [[0.03, 0, 0.02], [0, 0.01, 0], [0.02, 0, 0.03]]
    covariance = np.array([np.diag([0.03, 0.01, 0.12]), 1e6 * np.eye(3), together])
    goal = np.array([[1.0, 2, 3.1], [9, 9, 0], [1, 2, 3]])
    measured = np.array([[2.0, 1, -3.1], [1, 2, 3], [1.3, 2.2, 3]])
    frozen(goal, covariance, measured)
    got, after = env.correct(goal, covariance, measured, NOISE)
    assert (np.shape(got), np.shape(after)) == (goal.shape, covariance.shape), (
        f"{BATCH}; `np.matvec` multiplies K of each robot by its error"
    )
    # K = 0.75, 0.5, 0.75; and 1
    mistakes = {
        "R = diag(noise²), variances: `noise` holds standard deviations, so square them": [
            1 + 0.03 / 0.13,
            2 - 0.01 / 0.11,
        ],
        "goal + K·(measured − goal): a sign is turned round, it moves away from what is seen": [
            0.25,
            2.5,
        ],
        "K = V / (V + R) is turned round: the larger V is, the more the measurement counts": [
            1.25,
            1.5,
        ],
        "this is the plain mean: K = V / (V + R) weighs both by how exact they are": [1.5, 1.5],
    }
    hint = "goal + K·(measured − goal), K = V / (V + R), R = diag(noise²)"
    close(got[0, :2], [1.75, 1.5], explained(got[0, :2], mistakes, hint))
    short = 3.1 + 0.75 * (2 * math.pi - 6.2)
    mistakes = {
        "wrap the yaw of the result, too: over π it goes on at −π": short,
        "wrap the error of yaw: from 3.1 to −3.1 rad it is a short turn, over π": 3.1 - 0.75 * 6.2,
    }
    hint = "goal + K·(measured − goal): wrap the error of yaw, and the yaw of the result"
    close(got[0, 2], short - 2 * math.pi, explained(got[0, 2], mistakes, hint))
    close(got[1], [1, 2, 3], "with nothing known before, the measurement counts alone")
    hint = "K = P·(P + R)⁻¹: errors of x and yaw belong together, so what is seen of x tells of yaw"
    # (P + R)⁻¹ of x and yaw: (0.07, −0.02; −0.02, 0.04) / (0.04·0.07 − 0.02²)
    close(got[2], [1.2125, 2.1, 3.1], hint)
    hint = "(1 − K)·P = K·R"
    close(after[0], np.diag([0.0075, 0.005, 0.03]), hint)
    close(after[1], np.diag([0.01, 0.01, 0.04]), hint)
    close(after[2] * 1200, [[8.5, 0, 4], [0, 6, 0], [4, 0, 16]], hint)


@BOTH
def test_the_world_predicts_what_is_planned_and_forgets_with_the_episode(sim):
    envs, settings = FootstepVectorEnv(3, sim, noise=True), {"goals": [[2.0, 0, 0]] * 3}
    world, rng = envs.world, default_rng(0)

    def follows(robots, plan, disturbance):  # exactly the plan
        trunk = plan.trunk[..., robot_model.GROUND]
        moved = robot_model.relative(trunk[:, 0], trunk[:, -1])
        done = motion(robot_model.compose(world.pose, moved))
        world.simulator.state[:, :6] = done.torso[:, -1]
        return done

    world.simulator.run = follows
    first, _ = envs.reset(seed=0, options=settings)
    known = [0.05**2 * np.eye(3)] * 3
    close(world.covariance, known, "one measurement; σ = 5 cm, 0.05 rad", atol=1e-8)
    with mock.patch.object(world, "measure"):
        for _ in range(6):
            world.estimate[:], world.covariance[:] = world.relative_goal(envs.robots), 0
            world.step(rng.random((3, 6)), envs.robots)
            close(world.estimate, world.relative_goal(envs.robots), "trunk to trunk, as planned")
            hint = "of what was known for sure only the drift of a double step is unknown"
            close(world.covariance[:, 2, 2], env.DRIFT[sim][2] ** 2, hint)
    world.covariance[:] = 0
    world.measure(envs.robots)
    hint = "an estimate is more than the last measurement: what is known for sure stays as it is"
    close(world.estimate, world.relative_goal(envs.robots), hint)
    again, _ = envs.reset(seed=0, options=settings)
    equal(again, first, "a new episode knows nothing of the last one")


HEAVY = replace(ROBOT, torso=replace(ROBOT.torso, mass=5.0))


@cache
def disturbances(sim):
    """What 100 robots meet in 24 double steps: pushes [N] and errors of the IMU, [24, 100, T, ...]
    each; and their world."""
    world, robots = FootstepWorld(100, sim, push=0.4, robot=HEAVY), np.arange(100)
    told = follow(world, np.zeros((100, 3)))
    world.reset(robots, [stream("training", i) for i in robots])
    for _ in range(24):
        world.step(np.full((100, 6), 0.5), robots)
    return np.array([one.push for one in told]), np.array([one.imu for one in told]), world


@BOTH
def test_pushes_come_by_chance_and_from_everywhere(sim):
    push, _, world = disturbances(sim)
    rows = push.reshape(-1, *push.shape[2:])  # [2400, T, 2]
    size = np.hypot(*np.moveaxis(rows, -1, 0))  # [2400, T] [N]
    pushed = size.any(1)
    close(pushed.mean(), world.engine.period / TASK.push_every, "every 3 s", atol=0.03)
    force = 5.0 * 0.4 / 0.05  # F = m·Δv / t, m: HEAVY's torso; t = five ticks of 10 ms
    first = size[pushed].argmax(1)
    since = np.arange(size.shape[1]) - first[:, None]
    during = (since >= 0) & (since < 5)
    close(size[pushed], force * during, "one push, of five ticks in a row, and nothing else")
    last = world.engine.period_ticks - 5
    assert (first.min(), first.max()) == (0, last), "at any time of the usual double step"
    ahead, left = rows[pushed, first].T / force
    counts, _ = np.histogram(np.arctan2(left, ahead), 8, (-math.pi, math.pi))
    if sim == "mujoco":
        assert counts.min() > 0.6 * counts.mean(), "evenly from all around"
    else:
        close(left, 0, "on the plane: ahead or back", atol=1e-12)
        assert 0.4 < (ahead > 0).mean() < 0.6


def test_the_imu_has_noise_of_its_own_at_every_tick():
    _, imu, _ = disturbances("mujoco")
    error = imu.swapaxes(1, 2).reshape(-1, 100, 4)  # [2448, 100, 4] tick by tick
    noise = error / ([TASK.imu_rad] * 2 + [TASK.imu_rad_s] * 2)
    close(noise.std((0, 1)), 1, "the size is that of the task", rtol=0.02)
    assert related(noise) < 0.01, "anew at every tick, for each of its four numbers"


def test_every_number_of_a_body_is_uniform_around_that_of_the_model():
    n, spread, columns = 2000, Spread(), []
    rngs, model = default_rng(0).spawn(n), robot_model.Variation.as_model(ROBOT, n)
    body = spread.draw(rngs, ROBOT)
    assert vars(body).keys() == vars(spread).keys(), "a size for every field"
    for name, size in vars(spread).items():
        off = (getattr(body, name) - getattr(model, name)).reshape(n, -1) / size  # from −1 to 1
        columns.append(2 * off - 1 if name == "delay" else off)  # no delay is below 0
    off = np.hstack(columns)
    for got, want in (off.min(0), -1), (off.max(0), 1), (off.mean(0), 0), (off.std(0), 3**-0.5):
        close(got, want, f"smallest, largest, mean, σ in the order of {[*vars(spread)]}", atol=0.06)
    assert related(off) < 0.1, "every number is drawn by itself: two go together"
    ice = Spread(friction=2.0).draw(rngs, ROBOT).friction
    assert ice.min() > 0 and ice.max() > 2.6, "no friction is less than none: its absolute value"


WILD = default_rng(0).random(6)


class Greedy(Spread):  # takes more random numbers than ours
    def draw(self, rngs, robot):
        for rng in rngs:
            rng.random(99)
        return super().draw(rngs, robot)


@pytest.mark.parametrize("change, may_change", [
    ({"goals": [[1.0, 2.0, 3.0]]}, {"goal"}),
    ({"spread": Greedy()}, set(robot_model.Variation.__dataclass_fields__)),
    ({"push": 0.8}, {"push"}),
    ({"ask": FootstepWorld.view}, set()),
    ({"ask": FootstepWorld.measure}, {"noise of the goal"}),
    ({"walks_on": True}, set()),
], ids=["goals", "greedy", "push", "view", "measure", "walk on"])  # fmt: skip
def test_what_is_given_or_done_replaces_its_own_draw_and_nothing_else(change, may_change):
    def drawn(goals=None, push=0.4, spread=Spread(), ask=None, walks_on=False):
        """What is drawn for a robot in two episodes, [2, ...] by name."""
        task, episodes = replace(TASK, push_every=0.7), []
        world = FootstepWorld(1, noise=True, push=push, task=task, spread=spread)
        told = follow(world, np.zeros((1, 3)))
        for rngs in [stream("training", 6)], ():
            world.reset([0], rngs, goals)
            if ask:
                ask(world, [0])
            world.step([WILD], [0])
            goal = world.goal.copy()
            world.set_goal([0], goal)  # so that the estimate is the next measurement
            found = vars(world.simulator.variation) | {
                "goal": goal,
                "noise of the goal": world.estimate - world.relative_goal([0]),
                "noise of the IMU": told[-1].imu,
                "push": told[-1].push,
            }
            episodes.append({name: values.copy() for name, values in found.items()})
            if walks_on:
                world.step([WILD], [0])
        return {name: np.array([one[name] for one in episodes]) for name in found}

    plain, other = drawn(), drawn(**change)
    changed = {name for name in plain if not np.allclose(plain[name], other[name], atol=1e-9)}
    assert changed <= may_change and bool(changed) == bool(may_change), (
        f"{changed} changed: every purpose and every episode has a generator of its own"
    )
    if "push" in change:
        close(other["push"], 2 * plain["push"], "the same pushes, twice as strong")
    for name in plain.keys() - {"push"}:
        assert len(np.unique(plain[name])) == plain[name].size, f"{name}: drawn anew for each"


def test_a_view_shows_what_was_measured_and_nothing_of_the_truth():
    """Floor, body, pose and goal differ, and what is estimated is alike: so must be the views."""
    goals, views = np.array([[0.4, -0.1, 0.5]] * 3), []
    for far in 0, 5:
        world = FootstepWorld(3, noise=True)
        world.reset(np.arange(3))
        world.simulator.state[:, robot_model.GROUND] += far
        world.estimate[:] = goals
        views.append(vars(world.view([2, 1])))
    np.testing.assert_equal(*views, "it tells what no robot can know")
    equal(views[0]["robots"], [2, 1])
    close(views[0]["goal"], goals[:2])
    for name in "goal", "last_action", "neutral_action":
        views[1][name][:] = 9
    for values in (world.neutral_action, world.last_action, world.estimate):
        assert values.max() <= 1, "a planner wrote into its view: hand out copies"


@BOTH
def test_whoever_changes_a_number_can_walk(sim):
    """A mass, a length, how and how fast it walks, what it may command, what is random."""
    drift, limits = np.full(3, 0.1), env.StepLimits((-0.1, 0, -0.3), (0.1, 0, 0.4))
    robot = replace(ROBOT, torso=replace(ROBOT.torso, mass=3.0), thigh_length=0.175)
    walk = replace(walk_engine.TUNED[sim], foot_rise=0.03, step_ticks=35)
    own = {"robot": robot, "walk": walk, "limits": limits, "drift": drift}
    world, robots = FootstepWorld(4, sim, spread=Spread(mass=0.3, delay=0), **own), np.arange(4)
    world.reset(robots, [stream("training", 1, i) for i in robots], [[0.5, 0.1, 0.3]] * 4)
    for _ in range(4):
        view = world.view(robots)
        result = world.step(env.hand_written(view.goal, world.limits), robots)
    close(view.period, 0.7, "a planner is told how long a double step of this walk takes")
    assert view.limits == limits, "and what it may command"
    equal(world.drift, drift, "what the filter expects")
    assert not result["fall"].any(), "it should walk with other numbers, too"
    assert (world.pose[:, 0] > 0.15).all(), f"it should come nearer, {world.pose}"


def test_a_step_before_the_first_reset_is_an_error():
    with pytest.raises(gym.error.ResetNeeded):
        FootstepWorld(1).step(np.full((1, 6), 0.5), [0])


OWN = """
from dataclasses import dataclass, replace
from importlib import import_module

import beside

env = import_module("03_env")
ROBOT, WALK, LIMITS = env.robot_model.ROBOT, env.walk_engine.TUNED["{sim}"], env.LIMITS["{sim}"]
{line}


@dataclass
class Mine:
    number: "int" = beside.NUMBER


if __name__ == "__main__":
    raise ValueError("only when it is started")
"""


@pytest.fixture
def own_file(tmp_path, monkeypatch):
    """own_file(line, sim) -> the path of a file with a robot of one's own, in which this line stands."""
    monkeypatch.setattr(sys, "path", sys.path[:])
    (tmp_path / "beside.py").write_text("NUMBER = 7", "utf-8")
    monkeypatch.delitem(sys.modules, "beside", raising=False)

    def write(line="", sim="pymunk"):
        path = tmp_path / "mine.py"
        path.write_text(OWN.format(sim=sim, line=line), "utf-8")
        return path

    return write


def test_names_in_a_file_of_one_s_own(own_file):
    (mine, robot) = env.names_in(own_file(), Mine=type, ROBOT=robot_model.RobotModel)
    assert mine().number == 7 and robot == ROBOT, "it may import what lies beside it"


def test_each_file_has_its_own_helpers_and_changes_neither_our_folder_nor_our_path(
    tmp_path, monkeypatch
):
    here = os.getcwd()
    for owner in "ada", "bob":
        mine = tmp_path / owner / "mine.py"
        mine.parent.mkdir()
        mine.with_name("tools.py").write_text(f"OWNER = '{owner}'", "utf-8")
        mine.write_text("import os, tools; OWNER = tools.OWNER; os.chdir('/')", "utf-8")
        assert env.names_in(mine, OWNER=str) == [owner], "the second one has the first one's tools"
    assert os.getcwd() == here, "results are written where the script was started"
    monkeypatch.syspath_prepend(mine.parent)  # as if it lay beside our script
    places = sys.path[:]
    env.names_in(mine, OWNER=str)
    assert sys.path == places, "what is imported later is looked for as before"


@pytest.mark.parametrize("line, said", [
    ("ROBOT = 3", "needs a ROBOT that is a RobotModel"), ("exit()", "ends Python"), ("1 / 0", None),
])  # fmt: skip
def test_a_wrong_file_is_one_line_and_an_error_in_it_keeps_its_traceback(own_file, line, said):
    path = own_file(line)
    kind = robot_model.InputError if said else ZeroDivisionError
    with pytest.raises(kind, match=rf"\A{path}: {said}.*\Z" if said else None) as caught:
        env.names_in(path, ROBOT=robot_model.RobotModel)
    if not said:
        last = caught.traceback[-1]
        assert last.path == path and line in str(last.statement), "where it was raised"


@BOTH
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("line", [
    "ROBOT = replace(ROBOT, thigh_length=-1.0)", "WALK = replace(WALK, step_ticks=30.5)",
    "ROBOT = replace(ROBOT, torso=replace(ROBOT.torso, mass=-1.0))",
    "LIMITS = env.StepLimits((0, 0), (1, 1, 1))",
])  # fmt: skip
def test_a_robot_that_cannot_stand_or_step_is_one_line_that_names_its_file(own_file, sim, line):
    path = own_file(line, sim)
    with pytest.raises(robot_model.InputError, match=rf"\A{path}: .*{sim}.*\Z"):
        env.robot_settings(path, sim)


IN, OUT, FALL, OTHER_GOAL = (0.0, 0), (0.2, 0), "falls, inside", "inside, with a goal that is set"


@pytest.mark.parametrize("in_a_row, ends, want, counted", [  # of the double steps: how far from the
    # goal [m], [°]; how it ends; after how many of them
    (2, [IN, OUT, IN, IN], "success", 3), (2, [IN, FALL], "fall", 2),
    (2, [(0.049, 9.9)] * 2, "success", 1), (2, [(0.0, 360)] * 2, "success", 1),
    (2, [(0.051, 0)] * 2, "", 2), (2, [(0.0, -10.1)] * 2, "", 2),
    (2, [IN, OTHER_GOAL, IN], "success", 2), (1, [OUT, IN], "success", 2),
    (3, [IN, IN, OUT, IN, IN, IN], "success", 4),
])  # fmt: skip
def test_to_arrive_is_to_stay_within_5_cm_and_10_degrees(in_a_row, ends, want, counted):
    # Noise must not matter: the true pose counts.
    world = FootstepWorld(1, noise=True, task=replace(TASK, in_a_row=in_a_row))
    # First it starts at its goal, which does not count as having been there. The second time
    # nothing is left of the first episode.
    for goal in np.array([[0, 0, 0], [0.7, -0.2, 1.0]]):
        world.reset([0], goals=[goal])
        for step, end in enumerate(ends, 1):
            if end is OTHER_GOAL:
                world.set_goal([0], [goal])
            x, yaw = IN if end in (FALL, OTHER_GOAL) else end
            place = goal + [0.6 * x, 0.8 * x, math.radians(yaw)]
            follow(world, [place], end is FALL, waits=step)
            result = world.step(np.full((1, 6), 0.4), [0])
            got = [name for name in ("success", "fall", "timeout") if result[name]]
            assert got == ([want] if want and step == len(ends) else []), (
                f"after double step {step} of {ends}: {in_a_row} in a row must end within 5 cm AND "
                "10° of the true goal, wrapped, since it was set; and a fall is a fall, whatever "
                "the last episode was"
            )
        hint = "a success took the time to the FIRST of those in a row"
        ticks = range(2 * WALK.step_ticks + 1, 9999)  # of the first double step, of the second, …
        close(result["time"], 0.01 * sum(ticks[:counted]), hint)


def test_no_time_left_truncates_and_does_not_terminate():
    usual = 2 * WALK.step_ticks  # [ticks] of a double step
    envs = FootstepVectorEnv(5, task=replace(TASK, time_limit=0.01 * 5 * usual))  # for five
    world, away, goal = envs.world, [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]
    want = np.array(["", "timeout", "timeout", "success", "fall"])
    envs.reset(seed=0, options={"goals": [goal] * 5})
    # Another double step just fits in for robot 0, and not for robot 2, which waits a tick.
    world.ticks[:] = began = usual * np.array([3, 4, 3, 4, 4])
    waits = np.array([0, 3, 1, 8, 1])
    world.in_a_row[3], world.arrival[3] = 1, began[3]
    follow(world, np.array([away, away, goal, goal, goal]), want == "fall", waits)
    _, _, terminated, truncated, infos = envs.step(np.tile(envs.neutral_action, (5, 1)))
    hint = "it truncates where no double step fits in: stage 4 bootstraps there, not after a fall"
    equal(truncated, want == "timeout", hint)
    equal(terminated, np.isin(want, ("success", "fall")), hint)
    equal(infos["_final_info"], want != "", "which episodes ended")
    ended = began + usual + waits
    time = 0.01 * np.where(want == "success", began, ended)
    hint = "[s], also of a double step that waits; a success was there before"
    close(infos["final_info"]["time"], time, hint)
    equal(world.ticks, ended * (want == ""), "waiting takes time; the next episode begins with 0")
    equal(world.steps, want == "", "so does the count of double steps")


def test_the_hand_written_planner_turns_to_a_far_goal_and_like_a_near_one():
    limits = env.LIMITS["pymunk"]
    goals = np.array([[0.1, -0.06, 0.2], [0.0, 3.0, -0.2]])
    near, far = env.to_footsteps(env.hand_written(goals, limits), limits)
    hint = "near: like the goal; both feet share it, and to the right the right foot leads"
    close(near, [[0.05, 0, 0.1], [0.05, 0.06, -0.1]], hint)
    close(far, [[0, 0.07, 0.15], [0, 0, -0.15]], "far: to the goal's place, to the left")


def test_the_figure_of_rewards_shows_sums_and_centimetres(shown):
    paid = {"r_c": np.array([0.0, -1.0]), "r_fall": np.zeros(2), "r_d": np.array([1.0, 2.0])}
    with mock.patch.object(FootstepWorld, "step"):  # the robots stand
        _, claimed = errors = env.estimate_errors("pymunk", 0)
    close(claimed[0], 0.05, "of one measurement the filter claims its noise, [m]", rtol=1e-3)
    env.plot_rewards(paid, errors, "")
    curves, estimate = shown[0].axes
    names = [name.get_text() for name in curves.get_legend().get_texts()]
    assert names == ["r_d", "r_c"], "as the lines end; a term that paid nothing is left out"
    close(curves.lines[0].get_ydata(), [0, 1, 3], "the sum of rewards so far, at first 0")
    for line, want in zip(estimate.lines, errors):
        close(line.get_ydata(), 100 * want, "cm")


def test_a_training_has_goals_of_its_own_stream():
    envs, world = FootstepVectorEnv(1), FootstepWorld(1)
    envs.reset(seed=3)
    world.reset([0], [stream("training", 3)])
    equal(envs.world.goal, world.goal, "never those of the evaluation")


def test_a_walk_is_cut_off_before_a_double_step_that_may_wait_too_long():
    world = FootstepWorld(1, "mujoco", task=replace(TASK, time_limit=1.3))
    world.reset([0], goals=[[9.0, 0, 0]])
    hint = "after 0.6 s, for 0.6 s and 0.4 s of waiting are too long"
    assert world.step([world.neutral_action], [0])["timeout"], hint


def test_another_seed_of_the_demonstration_is_another_walk(monkeypatch, tmp_path):
    reset = mock.Mock(side_effect=KeyboardInterrupt)
    monkeypatch.setattr(FootstepVectorEnv, "reset", reset)
    for seed in "0", "1":
        monkeypatch.setattr("sys.argv", ["03_env.py", "--seed", seed, "--out", str(tmp_path)])
        with pytest.raises(KeyboardInterrupt):
            env.main()
    one, other = reset.mock_calls
    assert one != other, "--seed reaches no robot"
