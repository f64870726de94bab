"""What must hold for whatever goes in: splines, kinematics, plans, goals, the environment.

Hypothesis looks for a counterexample and shows the smallest one that it finds. The same examples in
every run (derandomize), so a failure is a fault and no bad luck.
"""

import math
from importlib import import_module

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as some

robot_model = import_module("01_robot_model")
walk_engine = import_module("02_walk_engine")
env = import_module("03_env")
evaluate = import_module("05_evaluate")

ROBOT = robot_model.RobotModel()
settings.register_profile("ours", max_examples=100, deadline=None, derandomize=True)
settings.load_profile("ours")

def number(low, high):
    return some.floats(low, high, allow_nan=False)

def numbers(low, high, count):
    return some.lists(number(low, high), min_size=count, max_size=count).map(np.array)

POSE = some.tuples(number(-9, 9), number(-9, 9), number(-9, 9)).map(np.array)  # m, m, rad
STEP = numbers(-1, 1, 6).map(lambda share: share.reshape(2, 3))  # of twice the limits

# ------------------------------------------------------------------------ poses and legs
@given(POSE, POSE)
def test_relative_undoes_compose(base, pose):
    there = robot_model.compose(base, pose)
    np.testing.assert_allclose(robot_model.relative(base, there), pose, atol=1e-9)

@given(number(-1e6, 1e6))
def test_a_wrapped_angle_is_the_same_angle(angle):
    wrapped = robot_model.wrap(angle)
    assert -math.pi <= wrapped < math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-6)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-6)

@given(numbers(0.02, 0.98, 6))
def test_inverse_kinematics_finds_the_pose_again(share):
    low = np.array([-0.6, -0.5, -1.2, 0.05, -0.9, -0.5])
    high = np.array([0.6, 0.5, 0.7, 2.0, 0.3, 0.5])
    points, turn = robot_model.leg_points(ROBOT, low + share * (high - low))
    found = robot_model.leg_inverse(ROBOT, points[2], turn)
    again, same_turn = robot_model.leg_points(ROBOT, found)
    np.testing.assert_allclose(again[2], points[2], atol=1e-9, err_msg="place of the ankle")
    np.testing.assert_allclose(same_turn, turn, atol=1e-9, err_msg="direction of the foot")

@given(numbers(-1, 1, 3), numbers(-4, 4, 3))
def test_inverse_kinematics_always_answers_within_the_limits(place, angles):
    turn = robot_model.rotation(*angles)
    found = robot_model.leg_inverse(ROBOT, place, turn)
    assert np.isfinite(found).all()
    assert (found >= np.array(ROBOT.joint_min) - 1e-9).all()
    assert (found <= np.array(ROBOT.joint_max) + 1e-9).all()

# ------------------------------------------------------------------------ splines and plans
@given(numbers(-5, 5, 3), numbers(-5, 5, 3), number(0.05, 5))
def test_a_quintic_keeps_its_six_conditions(start, end, duration):
    c = walk_engine.quintic(start, end, duration)
    for t, wanted in ((0, start), (duration, end)):
        for order in range(3):
            found = walk_engine.polynomial(c, np.array([t]), order)[0]
            assert math.isclose(found, wanted[order], rel_tol=1e-6, abs_tol=1e-5), (t, order)

@given(some.sampled_from(["pymunk", "mujoco"]), STEP)
def test_within_shrinks_and_never_turns(sim, share):
    limits = walk_engine.LIMITS[sim]
    asked = share * 2 * np.array(limits.high)
    found = walk_engine.within(asked, limits)
    factor = np.where(asked == 0, 1, found / np.where(asked == 0, 1, asked))
    assert (factor <= 1 + 1e-12).all() and (factor > 0).all()
    for foot in range(2):
        mine = factor[foot][asked[foot] != 0]
        np.testing.assert_allclose(mine, mine[:1].repeat(len(mine)), rtol=1e-9, err_msg=(
            "one factor for x, y and yaw of a foot"))
    np.testing.assert_allclose(walk_engine.within(found, limits), found, atol=1e-12, err_msg=(
        "what is within stays as it is"))

@given(some.sampled_from(["pymunk", "mujoco"]),
       some.lists(numbers(0, 1, 6), min_size=2, max_size=5))
@settings(max_examples=40)
def test_plans_go_on_where_the_last_one_ended(sim, actions):
    engine = walk_engine.WalkEngine(1, walk_engine.TUNED[sim], planar=sim == "pymunk")
    limits, last, last_feet = walk_engine.LIMITS[sim], engine.stance[1], None
    for action in actions:
        trajectory, feet = engine.plan(env.to_footsteps(action[None], limits), [0])
        joints = trajectory.joints[0]
        assert np.isfinite(joints).all()
        np.testing.assert_allclose(joints[0], last, atol=1e-6, err_msg="no jump between two plans")
        assert np.abs(np.diff(joints, axis=0)).max() < 0.5, "no jump within a plan [rad per tick]"
        assert (feet[0, :, :, 2] >= -1e-9).all(), "no foot below the ground"
        assert (feet[0, [0, -1], :, 2] == 0).all(), "both feet stand at both ends"
        if last_feet is not None:
            np.testing.assert_allclose(feet[0, 0], last_feet, atol=1e-9)
        last, last_feet = joints[-1], feet[0, -1]

# ------------------------------------------------------------------------ task and statistics
@given(some.sampled_from(["pymunk", "mujoco"]), numbers(0, 1, 6))
def test_a_footstep_asked_for_again_is_the_same(sim, action):
    limits = walk_engine.LIMITS[sim]
    steps = env.to_footsteps(action, limits)
    again = env.to_footsteps(env.to_action(steps, limits), limits)
    np.testing.assert_allclose(again, steps, atol=1e-9)

@given(numbers(-30, 30, 3))
def test_an_encoded_goal_is_within_its_table(goal):
    goal[2] = robot_model.wrap(goal[2])
    low, high = np.array([row[2:] for row in env.GOAL_TABLE]).T
    seen = env.encode_goal(goal)
    assert ((seen >= low - 1e-12) & (seen <= high + 1e-12)).all(), seen

@given(some.integers(1, 5000).flatmap(lambda n: some.tuples(some.integers(0, n), some.just(n))))
def test_wilson_holds_the_share_and_stays_a_share(drawn):
    count, total = drawn
    low, high = evaluate.wilson(count, total)
    assert 0 <= low <= count / total + 1e-12 and count / total - 1e-12 <= high <= 1
    assert high > low, "never sure"

WORLDS = {}

def world_of(sim):
    """One world per simulator for all examples."""
    if sim not in WORLDS:
        WORLDS[sim] = env.FootstepEnv(sim, noise=True, imu=True)
    return WORLDS[sim]

@given(some.sampled_from(["pymunk", "mujoco"]), some.integers(0, 10**6),
       some.lists(numbers(0, 1, 6), min_size=1, max_size=8))
@settings(max_examples=30)
def test_whatever_is_done_the_environment_keeps_its_contract(sim, seed, actions):
    world = world_of(sim)
    seen, _ = world.reset(seed=seed)
    for action in actions:
        assert world.observation_space.contains(seen), seen
        seen, reward, terminated, truncated, info = world.step(action)
        assert math.isfinite(reward) and not (terminated and truncated)
        assert math.isclose(reward, sum(info["reward_terms"].values()), abs_tol=1e-9)
        assert terminated == (info["success"] or info["fall"]) and truncated == info["timeout"]
        if terminated or truncated:
            break
    assert world.observation_space.contains(seen), "the last one, too"
