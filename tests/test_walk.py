"""Stage 2, checked against theory: splines against their boundary conditions, footsteps against
plain geometry, the engine against itself, and the walks against physics."""

import math
from importlib import import_module

import numpy as np
import pytest

robot_model = import_module("01_robot_model")
walk_engine = import_module("02_walk_engine")

ROBOT = robot_model.RobotModel()
BOTH = pytest.mark.parametrize("name", ["pymunk", "mujoco"])


def make_engine(name, num_robots=1):
    return walk_engine.WalkEngine(num_robots, walk_engine.TUNED[name], ROBOT, name == "pymunk")


def random_footsteps(rng, name, *shape):
    limits = walk_engine.LIMITS[name]
    return rng.uniform(limits.low, limits.high, (*shape, 2, 3))


# ---------------------------------------------------------------- quintic splines
def test_quintic_meets_its_six_boundary_conditions():
    rng = np.random.default_rng(0)
    for _ in range(50):
        start, end, duration = rng.normal(size=3), rng.normal(size=3), rng.uniform(0.2, 2.0)
        c = np.polynomial.Polynomial(walk_engine.quintic(start, end, duration))
        for t, want, where in ((0.0, start, "start"), (duration, end, "end")):
            got = [c.deriv(order)(t) if order else c(t) for order in range(3)]
            np.testing.assert_allclose(got, want, atol=1e-6, err_msg=(
                f"{where}: position, velocity, acceleration; is c₂ = a₀/2? the powers of T?"))


def test_polynomial_and_its_derivatives_equal_numpy():
    rng = np.random.default_rng(1)
    c, t = rng.normal(size=(3, 6)), np.linspace(-1, 1, 11)
    for order in range(3):
        got = walk_engine.polynomial(c, t, order)
        assert got.shape == (3, 11)
        for row, numbers in zip(got, c):
            want = np.polyval(np.polyder(numbers[::-1], order), t)
            np.testing.assert_allclose(row, want, atol=1e-12, err_msg=f"derivative {order}")


def test_rest_to_rest_is_the_minimum_jerk_curve():
    tau = np.linspace(0, 1, 21)
    c = walk_engine.quintic([0, 0, 0], [2.0, 0, 0], 0.7)
    want = 2.0 * (10 * tau**3 - 15 * tau**4 + 6 * tau**5)
    np.testing.assert_allclose(walk_engine.polynomial(c, 0.7 * tau), want, atol=1e-12)


# ---------------------------------------------------------------- poses in the plane
def matrix(pose):
    """Homogeneous matrix of (x, y, yaw): an independent way to compose poses."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return np.array([[cos, -sin, pose[0]], [sin, cos, pose[1]], [0, 0, 1]])


def test_compose_multiplies_matrices_and_relative_undoes_it():
    base, pose = np.random.default_rng(2).uniform(-1, 1, (2, 40, 3)) * [1, 1, 3]
    got = walk_engine.compose(base, pose)
    for a, b, c in zip(base, pose, got):
        np.testing.assert_allclose(matrix(a) @ matrix(b), matrix(c), atol=1e-12, err_msg=(
            "first turn the pose by the base's yaw, then add the base's place"))
    np.testing.assert_allclose(walk_engine.relative(base, got), pose, atol=1e-12)


# ---------------------------------------------------------------- the plan
def in_first_frame(first, second):
    """Trunk [3] (x, y, yaw) and feet [2, 3] of every sample of `second`, seen from the frame of
    `first`: its frame is the right foot where `first` ended."""
    base = first.feet[0, -1, 1, [0, 1, 3]]  # right foot
    trunk = walk_engine.compose(base[None], second.trunk[0][:, [0, 1, 5]])
    feet = walk_engine.compose(base[None, None], second.feet[0][..., [0, 1, 3]])
    return trunk, feet


@BOTH
def test_trunk_is_smooth_and_feet_stay_across_double_steps(name):
    engine, rng, dt = make_engine(name), np.random.default_rng(3), ROBOT.control_dt
    plans = [engine.plan(random_footsteps(rng, name, 1), [0])[0] for _ in range(6)]
    for first, second in zip(plans, plans[1:]):
        trunk, feet = in_first_frame(first, second)
        np.testing.assert_allclose(first.trunk[0, -1][[0, 1, 5]], trunk[0], atol=1e-9, err_msg=(
            "the trunk jumps between double steps: is its state turned into the new frame?"))
        np.testing.assert_allclose(first.feet[0, -1][:, [0, 1, 3]], feet[0], atol=1e-9, err_msg=(
            "a foot jumps: the next plan must start where this one ended"))
        np.testing.assert_allclose(second.feet[0, 0, :, 2], 0, atol=1e-12)
        np.testing.assert_allclose(first.joints[0, -1], second.joints[0, 0], atol=1e-9)
        # Each side of the seam is one quintic: a fit of degree 5 is exact, and so are v and a.
        before = np.c_[first.trunk[0][:, [0, 1, 5]], first.trunk[0][:, 4]]
        after = np.c_[trunk, second.trunk[0][:, 4]]
        last = np.polynomial.polynomial.polyfit(dt * np.arange(-9, 1), before[-10:], 5)
        start = np.polynomial.polynomial.polyfit(dt * np.arange(10), after[:10], 5)
        for order, what, unit in ((0, "position", ""), (1, "velocity", "/s"), (2, "c₂", "/s²")):
            np.testing.assert_allclose(start[order], last[order], atol=1e-6, err_msg=(
                f"{what} of x, y, yaw, pitch [m{unit} or rad{unit}] jumps between double steps: "
                "is the state turned into the frame of the new support foot?"))
        assert np.abs(last[1]).max() > 0.05, "the trunk should be moving at the seam"


@BOTH
def test_all_zero_footsteps_step_on_the_spot(name):
    engine = make_engine(name)
    p, zero = engine.parameters, np.zeros((1, 2, 3))
    for _ in range(4):
        plan, executed = engine.plan(zero, [0])
        np.testing.assert_array_equal(executed, zero)
        feet = plan.feet[0]
        np.testing.assert_allclose(feet[:, 0, [0, 1, 3]] - [0, p.foot_distance, 0], 0, atol=1e-12,
                                   err_msg="zeros: the left foot lands where it was")
        np.testing.assert_allclose(feet[:, 1, [0, 1, 3]], 0, atol=1e-12)
        assert feet[..., 0, 2].max() == pytest.approx(p.foot_rise, rel=0.1)
        assert feet[..., 1, 2].max() == pytest.approx(p.foot_rise, rel=0.1)
        assert (feet[..., 2].min(-1) == 0).all(), "one foot is always on the ground"
        assert np.all(np.abs(plan.trunk[0, :, 0]) < 0.02), "the trunk stays above the feet"
    half = engine.half_ticks
    assert feet[half // 2, 0, 2] > 0.01 and feet[half // 2, 1, 2] == 0, "left swings first"
    assert feet[half + half // 2, 1, 2] > 0.01 and feet[half + half // 2, 0, 2] == 0


def test_swing_foot_waits_rises_and_lands_at_rest():
    engine = make_engine("mujoco")
    plan, _ = engine.plan(np.array([[[0.1, 0.02, 0.2], [0.1, 0.0, 0.0]]]), [0])
    left = plan.feet[0, : engine.half_ticks + 1, 0]  # [K, 4]
    waiting = int(engine.parameters.double_support * engine.half_ticks)
    assert waiting >= 1, "the test should see the double support"
    np.testing.assert_allclose(left[: waiting + 1], left[:1].repeat(waiting + 1, 0), atol=1e-12)
    speed = np.abs(np.diff(left, axis=0)) / ROBOT.control_dt
    assert np.all(speed[-1] < 0.1 * speed.max(0) + 1e-9), "the foot should land at rest"
    np.testing.assert_allclose(left[-1], [0.1, engine.parameters.foot_distance + 0.02, 0, 0.2],
                               atol=1e-12)
    rise = left[:, 2]
    assert rise.max() == pytest.approx(engine.parameters.foot_rise, rel=0.1) and rise.min() >= 0


@BOTH
def test_right_foot_mirrors_the_left_one(name):
    """The right step after a plan equals the mirrored left step, from mirrored feet."""
    engine, step = make_engine(name), [0.06, 0.05, 0.2]
    p, half = engine.parameters, engine.half_ticks
    first, _ = engine.plan(np.array([[step, [0, 0, 0]]]), [0])
    engine.reset(np.arange(1))
    second, _ = engine.plan(np.array([[[0, 0, 0], step]]), [0])
    left = first.feet[0, half, 0, [0, 1, 3]]  # seen from the right foot
    last = second.feet[0, -1]
    right = walk_engine.relative(last[0, [0, 1, 3]], last[1, [0, 1, 3]])  # seen from the left one
    np.testing.assert_allclose(left, [step[0], p.foot_distance + step[1], step[2]], atol=1e-12)
    np.testing.assert_allclose(right * [1, -1, -1], left, atol=1e-12, err_msg=(
        "outward is positive for both feet: y and yaw change their sign for the right one"))


@BOTH
def test_plans_of_many_robots_equal_single_plans(name):
    rng, n = np.random.default_rng(4), 5
    many, single = make_engine(name, n), [make_engine(name) for _ in range(n)]
    for robots in (np.arange(n), np.array([3, 1]), np.arange(n)):
        footsteps = random_footsteps(rng, name, len(robots))
        got, executed = many.plan(footsteps, robots)
        for row, i in enumerate(robots):
            want, one = single[i].plan(footsteps[row : row + 1], [0])
            np.testing.assert_allclose(executed[row], one[0], atol=1e-14)
            for field in ("joints", "trunk", "feet"):
                np.testing.assert_allclose(getattr(got, field)[row], getattr(want, field)[0],
                                           atol=1e-12, err_msg="robots must not mix")


@BOTH
def test_commanded_is_where_the_engine_puts_the_feet(name):
    rng, engine, count = np.random.default_rng(5), make_engine(name), 6
    footsteps = random_footsteps(rng, name, 1, count)
    footsteps[..., 1] = np.abs(footsteps[..., 1]) + 0.05  # far enough apart: not clipped
    base = np.array([0.0, -engine.parameters.foot_distance / 2, 0.0])
    for k in range(count):
        plan, executed = engine.plan(footsteps[:, k], [0])
        np.testing.assert_array_equal(executed, footsteps[:, k])
        left = walk_engine.compose(base, plan.feet[0, -1, 0, [0, 1, 3]])
        base = walk_engine.compose(base, plan.feet[0, -1, 1, [0, 1, 3]])
    got = walk_engine.commanded(engine.parameters, footsteps)[0]
    np.testing.assert_allclose(got, (left + base) / 2, atol=1e-9)


# ---------------------------------------------------------------- soles
def sole_corners(foot, side):
    """The four corners [4, 2] of a sole; foot (x, y, yaw) of its ankle, side +1: left."""
    x = [-ROBOT.foot_back, ROBOT.foot_front, ROBOT.foot_front, -ROBOT.foot_back]
    outward = np.array([-1, -1, 1, 1]) * ROBOT.foot_width / 2 + ROBOT.foot_outward
    return (matrix(foot) @ np.array([x, side * outward, np.ones(4)]))[:2].T


def gap(one, other):
    """Distance between two convex quadrilaterals along their best separating axis; < 0: overlap."""
    best = -np.inf
    for shape in (one, other):
        for edge in np.roll(shape, -1, 0) - shape:
            normal = np.array([-edge[1], edge[0]]) / np.linalg.norm(edge)
            a, b = one @ normal, other @ normal
            best = max(best, a.min() - b.max(), b.min() - a.max())
    return best


@BOTH
def test_soles_never_overlap_and_the_executed_step_is_reported(name):
    rng, engine = np.random.default_rng(6), make_engine(name)
    low, high = np.array([-0.25, -0.15, -0.6]), np.array([0.25, 0.1, 0.6])
    touching = 0
    for _ in range(300):
        wish = rng.uniform(low, high, (1, 2, 3))
        plan, executed = engine.plan(wish, [0])
        left, right = np.zeros(3), plan.feet[0, -1, 1, [0, 1, 3]]
        landing = plan.feet[0, engine.half_ticks, 0, [0, 1, 3]]
        wanted = wish[0, 0] + [0, engine.parameters.foot_distance, 0]
        touching += gap(sole_corners(wanted, 1), sole_corners(left, -1)) < 0
        for a, b in ((landing, left), (landing, right)):
            assert gap(sole_corners(a, 1), sole_corners(b, -1)) > 0.0099, (
                f"soles closer than 1 cm: does clip know the corner that a yaw of "
                f"{executed[0, :, 2]} rad brings inward?")
        distance = engine.parameters.foot_distance
        np.testing.assert_allclose(landing, executed[0, 0] + [0, distance, 0],
                                   atol=1e-12, err_msg="report what is done, not what was asked")
        np.testing.assert_array_equal(executed[..., [0, 2]], wish[..., [0, 2]])
        assert (executed[..., 1] >= wish[..., 1]).all(), "moved outward, never inward"
    assert touching > 10, "the test should ask for steps that are too close"


def test_clip_leaves_wide_footsteps_alone():
    engine = make_engine("mujoco")
    wide = np.array([[[0.1, 0.0, 0.1], [0.1, 0.05, -0.1]]])
    np.testing.assert_array_equal(engine.clip(wide), wide)
    close = np.array([[[0.0, -0.2, 0.0], [0.0, -0.2, 0.0]]])
    distance = engine.clip(close)[0, :, 1] + engine.parameters.foot_distance
    want = ROBOT.foot_width - 2 * ROBOT.foot_outward + walk_engine.CLEARANCE
    np.testing.assert_allclose(distance, want, err_msg="parallel soles: width + clearance apart")


@BOTH
def test_joint_targets_respect_the_limits(name):
    rng, n = np.random.default_rng(7), 40
    engine = make_engine(name, n)
    low, high = np.tile(ROBOT.joint_min, 2), np.tile(ROBOT.joint_max, 2)
    for _ in range(4):
        footsteps = 2 * random_footsteps(rng, name, n)  # beyond what an action can ask for
        joints = engine.plan(footsteps, np.arange(n))[0].joints
        assert np.isfinite(joints).all()
        assert (joints >= low).all() and (joints <= high).all()
    engine.reset(np.arange(n))
    joints = engine.plan(0 * footsteps, np.arange(n))[0].joints
    np.testing.assert_allclose(joints[:, 0], engine.stance[None].repeat(n, 0), atol=1e-9, err_msg=(
        "after a reset a plan starts from standing"))


# ---------------------------------------------------------------- walks
def walk(name, step, count=8):
    """Torso [3] reached by `count` equal double steps, the commanded one, and if it stayed up."""
    plans = np.tile(np.array(step, float), (1, count, 1, 1))
    poses, fall = walk_engine.walk(name, walk_engine.TUNED[name], plans)
    wish = walk_engine.commanded(walk_engine.TUNED[name], plans)[0]
    return poses[0, -1], wish, bool(fall[0] == count)


@BOTH
@pytest.mark.parametrize("direction, step, axis", [
    ("forward", [[0.08, 0, 0], [0.08, 0, 0]], 0),
    ("backward", [[-0.06, 0, 0], [-0.06, 0, 0]], 0),
    ("sideways", [[0, 0.06, 0], [0, 0, 0]], 1),
    ("turning", [[0, 0, 0.15], [0, 0, -0.15]], 2)])
def test_it_walks_what_is_commanded(name, direction, step, axis):
    got, wish, up = walk(name, step)
    assert up, f"{direction}: fell within the step limits"
    assert got[axis] == pytest.approx(wish[axis], rel=0.2), (
        f"{direction}: walked {got[axis]:.2f}, commanded {wish[axis]:.2f} m or rad")
    others = [k for k in (0, 1) if k != axis]
    assert np.all(np.abs(got - wish)[others] < 0.25), f"{direction}: drifts to {got}"


@BOTH
def test_it_falls_when_it_must(name):
    _, _, up = walk(name, [[0.4, 0, 0], [0.4, 0, 0]])
    assert not up, "steps of 0.4 m are longer than a leg: physics should say no"


def test_a_sharp_turn_slips_in_mujoco():
    shares = np.linspace(0.94, 1.06, 7)[:, None, None, None]  # slipping is chaotic: take the mean
    achieved = {}
    for yaw in (0.1, 0.6):
        plans = shares * np.tile([[0, 0, yaw], [0, 0, -yaw]], (1, 5, 1, 1))
        poses, _ = walk_engine.walk("mujoco", walk_engine.TUNED["mujoco"], plans)
        wish = walk_engine.commanded(walk_engine.TUNED["mujoco"], plans)
        achieved[yaw] = (poses[:, -1, 2] / wish[:, 2]).mean()
    assert achieved[0.1] == pytest.approx(1.0, abs=0.15), f"gentle: {achieved[0.1]:.2f} of the turn"
    assert achieved[0.6] < 0.88, (
        f"sharp: {achieved[0.6]:.2f} of the turn; the soles should slip on the ground")


@BOTH
def test_the_same_plan_gives_the_same_walk(name):
    rng = np.random.default_rng(8)
    plans = 0.5 * random_footsteps(rng, name, 3, 4)
    one, two = (walk_engine.walk(name, walk_engine.TUNED[name], plans) for _ in range(2))
    np.testing.assert_array_equal(one[0], two[0])
    np.testing.assert_array_equal(one[1], two[1])
    assert np.ptp(one[0][:, -1], axis=0).max() > 0.01, "different plans, different walks"


# ---------------------------------------------------------------- tuning
def test_one_round_of_tuning_stays_in_the_search_range(capsys):
    found = walk_engine.tune("mujoco", seed=0, iterations=1, population=4, elite=2)
    assert isinstance(found, walk_engine.WalkParameters)
    for key, (low, high) in walk_engine.SEARCH.items():
        assert low <= getattr(found, key) <= high, f"{key} left the range it is searched in"
    assert found != walk_engine.WalkParameters(), "nothing was learned from the elite"
    assert "score of the mean" in capsys.readouterr().out


def test_planar_tuning_leaves_alone_what_has_no_meaning_there():
    found = walk_engine.tune("pymunk", seed=0, iterations=1, population=2, elite=1)
    assert (found.trunk_swing, found.foot_distance) == (0.0, 0.18)
    for key in set(walk_engine.SEARCH) - set(walk_engine.PLANAR_FIXED):
        low, high = walk_engine.SEARCH[key]
        assert low <= getattr(found, key) <= high


def test_highest_speed_ignores_everything_beyond_the_first_fall():
    levels, count = walk_engine.LEVELS, len(walk_engine.PATTERN)
    shares = (np.arange(levels) + 1) / levels
    poses = np.zeros((4 * levels, count + 1, 3))
    fall = np.full(4 * levels, count)
    for i, axis in enumerate((0, 0, 1, 2)):  # every walk moves its share; level 5 falls
        poses[i * levels : (i + 1) * levels, -1, axis] = (1, -1, 1, 1)[i] * shares
        fall[i * levels + 4] = 2
    speeds = walk_engine.highest_speed(poses, fall, period=0.5)
    for direction, speed in speeds.items():
        assert speed == pytest.approx(shares[3] / (sum(walk_engine.PATTERN) * 0.5)), (
            f"{direction}: the fourth of eight levels was the last one below a fall")


@BOTH
def test_fastest_speed_is_measured_and_not_commanded(name):
    speed = walk_engine.fastest_speed(name, repeats=1)
    period = walk_engine.WalkEngine(1, walk_engine.TUNED[name]).period
    step = 0.6 * walk_engine.LIMITS[name].high[0]
    plan = np.tile([step, 0, 0], (1, 8, 2, 1))
    poses, fall = walk_engine.walk(name, walk_engine.TUNED[name], plan)
    assert fall[0] == 8
    moderate = (poses[0, -1, 0] - poses[0, 4, 0]) / (4 * period)
    assert 0.9 * moderate < speed < 2 * walk_engine.LIMITS[name].high[0] / period, (
        "at least that of a moderate walk, less than what the longest footsteps ask for")


@BOTH
def test_the_map_of_falls_knows_what_is_easy_and_what_is_impossible(name):
    easy, wild = np.zeros((1, 2, 3)), np.tile([0.5, 0.0, 0.0], (1, 2, 1))
    shares = walk_engine.fall_map(name, walk_engine.TUNED[name], np.concatenate([easy, easy, wild]),
                                  np.concatenate([easy, wild, wild]), repeats=2)
    assert shares.tolist() == [0, 1, 1], "on the spot; suddenly 0.5 m; always 0.5 m"
