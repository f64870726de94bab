"""Stage 2, checked against theory: splines against their boundary conditions, footsteps against
plain geometry, the engine against itself, and the walks against physics."""

import math
from dataclasses import replace
from importlib import import_module
from itertools import product

import numpy as np
import pytest

robot_model = import_module("01_robot_model")
walk_engine = import_module("02_walk_engine")

ROBOT = robot_model.RobotModel()
BOTH = pytest.mark.parametrize("sim", ["pymunk", "mujoco"])

@pytest.fixture(autouse=True)
def one_process(monkeypatch):
    """Starting processes takes longer than these walks; robots in several are test_robot's."""
    monkeypatch.setattr(robot_model, "CORES", 1)

def make_engine(sim, num_robots=1):
    return walk_engine.WalkEngine(num_robots, walk_engine.TUNED[sim], ROBOT, sim == "pymunk")

def random_footsteps(rng, sim, *shape):
    limits = walk_engine.LIMITS[sim]
    return rng.uniform(limits.low, limits.high, (*shape, 2, 3))

def matrix(pose):
    """Homogeneous matrix of (x, y, yaw): an independent way to compose poses."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return np.array([[cos, -sin, pose[0]], [sin, cos, pose[1]], [0, 0, 1]])

def seen_from(base, pose):
    """The pose (x, y, yaw) seen from the frame `base`."""
    x, y, _ = np.linalg.solve(matrix(base), [pose[0], pose[1], 1])
    return np.array([x, y, pose[2] - base[2]])


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

def test_quintic_of_many_splines_equals_one_at_a_time():
    start, end = np.random.default_rng(1).normal(size=(2, 5, 4, 3))  # robots, axes
    got = walk_engine.quintic(start, end, 0.3)
    assert got.shape == (5, 4, 6), "start, end [..., 3] in, coefficients [..., 6] out"
    for i, k in product(range(5), range(4)):
        want = walk_engine.quintic(start[i, k], end[i, k], 0.3)
        np.testing.assert_allclose(got[i, k], want, rtol=1e-12, err_msg="splines must not mix")

def test_polynomial_and_its_derivatives_equal_numpy():
    rng = np.random.default_rng(1)
    c, t = rng.normal(size=(2, 3, 6)), np.linspace(-1, 1, 11)
    for order in range(3):
        got = walk_engine.polynomial(c, t, order)
        assert got.shape == (2, 3, 11)
        for i, k in product(range(2), range(3)):
            want = np.polyval(np.polyder(c[i, k, ::-1], order), t)
            np.testing.assert_allclose(got[i, k], want, atol=1e-12, err_msg=f"derivative {order}")

def test_rest_to_rest_is_the_minimum_jerk_curve():
    tau = np.linspace(0, 1, 21)
    c = walk_engine.quintic([0, 0, 0], [2.0, 0, 0], 0.7)
    want = 2.0 * (10 * tau**3 - 15 * tau**4 + 6 * tau**5)
    np.testing.assert_allclose(walk_engine.polynomial(c, 0.7 * tau), want, atol=1e-12)


# ---------------------------------------------------------------- the plan
@BOTH
def test_trunk_is_smooth_and_feet_stay_across_double_steps(sim):
    engine, rng, dt = make_engine(sim), np.random.default_rng(3), ROBOT.control_dt
    plans = [engine.plan(random_footsteps(rng, sim, 1), [0]) for _ in range(6)]
    for (first, first_feet), (second, second_feet) in zip(plans, plans[1:]):
        before, after = first.trunk[0], second.trunk[0]  # [T + 1, 6]
        np.testing.assert_allclose(before[-1], after[0], atol=1e-9, err_msg=(
            "the trunk jumps between double steps: is its state at the end remembered?"))
        np.testing.assert_allclose(first_feet[0, -1], second_feet[0, 0], atol=1e-9, err_msg=(
            "a foot jumps: the next plan must start where this one ended"))
        np.testing.assert_allclose(second_feet[0, 0, :, 2], 0, atol=1e-12)
        np.testing.assert_allclose(first.joints[0, -1], second.joints[0, 0], atol=1e-9)
        # Each side of the seam is one quintic: a fit of degree 5 is exact, and so are v and a.
        last = np.polynomial.polynomial.polyfit(dt * np.arange(-9, 1), before[-10:], 5)
        start = np.polynomial.polynomial.polyfit(dt * np.arange(10), after[:10], 5)
        for order, what, unit in ((0, "position", ""), (1, "velocity", "/s"), (2, "c₂", "/s²")):
            np.testing.assert_allclose(start[order], last[order], atol=1e-6, err_msg=(
                f"{what} of x, y, z, roll, pitch, yaw [m{unit} or rad{unit}] jumps between double "
                "steps: the next spline starts with the state in which this one ended"))
        assert np.abs(last[1]).max() > 0.05, "the trunk should be moving at the seam"

@pytest.mark.parametrize("phase", [0.0, 0.25, -0.25])
def test_trunk_passes_its_knots_between_the_feet(phase):
    p = replace(walk_engine.TUNED["mujoco"], trunk_phase=phase, trunk_swing=0.3,
                trunk_x_offset=0.02, trunk_pitch=0.1, pitch_per_step=0.5, pitch_per_turn=0.4)
    for footsteps in ([[0, 0, 0], [0, 0, 0]], [[0.08, 0, 0], [0.08, 0, 0]],
                      [[0.08, 0.03, 0.2], [0.06, 0.01, -0.1]], [[0, 0, -0.2], [0, 0, 0.2]]):
        engine = walk_engine.WalkEngine(1, p, ROBOT)
        left, right = engine.feet[0].copy()
        trunk = engine.plan(np.array([footsteps]), [0])[0].trunk[0]  # [T + 1, 6]
        new_left, new_right = engine.feet[0]
        for k, (support, start, landing) in enumerate(((right, left, new_left),
                                                       (new_left, right, new_right))):
            tick = int((k + 0.5 + phase) * engine.half_ticks)
            assert tick == (k + 0.5 + phase) * engine.half_ticks, "the very tick of the knot"
            x, y, z, roll, pitch, yaw = trunk[tick]
            before, after = (support + start) / 2, (support + landing) / 2
            centre = (before + after) / 2
            np.testing.assert_allclose((z, roll), (p.trunk_height, 0))
            assert yaw == pytest.approx(centre[2], abs=1e-9)
            ahead, aside, _ = seen_from(centre, [x, y, yaw])
            assert ahead == pytest.approx(p.trunk_x_offset, abs=1e-9), (
                "half way the trunk is between the feet, and x_offset AHEAD of their middle")
            towards = seen_from(centre, support)[1]
            assert (towards < 0) == (k == 0), "while the left foot swings the right one supports"
            assert aside == pytest.approx(p.trunk_swing * towards, abs=1e-9), (
                f"knot {k + 1}: sideways a share of the way to the SUPPORT foot, which is at "
                f"{towards:.3f} m; the trunk is at {aside:.3f} m")
            forward, turn = seen_from([0, 0, centre[2]], after - before)[0], after[2] - before[2]
            assert pitch == pytest.approx(0.1 + 0.5 * forward + 0.4 * abs(turn), abs=1e-9), (
                "a turn to either side adds the same lean")
            # From knot to knot it is one quintic: a fit of degree 5 is exact.
            near = np.arange(10) if k == 0 else np.arange(-9, 1)
            c = np.polynomial.polynomial.polyfit(near * ROBOT.control_dt, trunk[tick + near], 5)
            np.testing.assert_allclose(c[1, [0, 1, 5]], (after - before) / engine.half, atol=1e-6,
                                       err_msg="it passes with the mean velocity of the step")
            np.testing.assert_allclose(c[2], 0, atol=1e-5, err_msg="it passes unaccelerated")

@BOTH
def test_all_zero_footsteps_step_on_the_spot(sim):
    engine = make_engine(sim)
    p, zero = engine.parameters, np.zeros((1, 2, 3))
    stands = [[0, p.foot_distance / 2, 0], [0, -p.foot_distance / 2, 0]]
    for _ in range(4):
        trajectory, feet = engine.plan(zero, [0])
        np.testing.assert_allclose(feet[0][..., [0, 1, 3]], np.tile(stands, (feet.shape[1], 1, 1)),
                                   atol=1e-12, err_msg="zeros: each foot lands where it was")
        rise = feet[0, ..., 2]  # [T + 1, 2]
        np.testing.assert_allclose(rise.max(0), p.foot_rise, rtol=0.1)
        assert (rise.min(-1) == 0).all(), "one foot is always on the ground"
        assert np.all(np.abs(trajectory.trunk[0, :, 0]) < 0.02), "the trunk stays above the feet"
    half = engine.half_ticks
    assert rise[half // 2, 0] > 0.01 and rise[half // 2, 1] == 0, "left swings first"
    assert rise[half + half // 2, 1] > 0.01 and rise[half + half // 2, 0] == 0

def test_swing_foot_waits_rises_and_lands_at_rest():
    engine = make_engine("mujoco")
    _, feet = engine.plan(np.array([[[0.1, 0.02, 0.2], [0.1, 0.0, 0.0]]]), [0])
    left = feet[0, : engine.half_ticks + 1, 0]  # [K, 4]
    waiting = int(engine.parameters.double_support * engine.half_ticks)
    assert waiting >= 1, "the test should see the double support"
    np.testing.assert_allclose(left[: waiting + 1], left[:1].repeat(waiting + 1, 0), atol=1e-12)
    speed = np.abs(np.diff(left, axis=0)) / ROBOT.control_dt
    assert np.all(speed[-1] < 0.1 * speed.max(0) + 1e-9), "the foot should land at rest"
    distance = engine.parameters.foot_distance
    np.testing.assert_allclose(left[-1], [0.1, distance / 2 + 0.02, 0, 0.2], atol=1e-12, err_msg=(
        "the left foot lands beside the right one, which stands at y = −distance / 2"))
    rise = left[:, 2]
    assert rise.max() == pytest.approx(engine.parameters.foot_rise, rel=0.1) and rise.min() >= 0

@BOTH
def test_right_foot_mirrors_the_left_one(sim):
    """The right foot's step, seen from the left one, is the mirrored step of the left foot."""
    engine, step = make_engine(sim), [0.06, 0.05, 0.2]
    p, half = engine.parameters, engine.half_ticks
    _, first = engine.plan(np.array([[step, [0, 0, 0]]]), [0])
    engine.reset(np.arange(1))
    _, second = engine.plan(np.array([[[0, 0, 0], step]]), [0])
    poses = [0, 1, 3]
    left = seen_from(first[0, half, 1, poses], first[0, half, 0, poses])
    right = seen_from(second[0, -1, 0, poses], second[0, -1, 1, poses])
    np.testing.assert_allclose(left, [step[0], p.foot_distance + step[1], step[2]], atol=1e-12)
    np.testing.assert_allclose(right * [1, -1, -1], left, atol=1e-12, err_msg=(
        "outward is positive for both feet: y and yaw change their sign for the right one"))

@BOTH
def test_plans_of_many_robots_equal_single_plans(sim):
    rng, n = np.random.default_rng(4), 5
    many, single = make_engine(sim, n), [make_engine(sim) for _ in range(n)]
    for robots in (np.arange(n), np.array([3, 1]), np.arange(n)):
        footsteps = random_footsteps(rng, sim, len(robots))
        got, feet = many.plan(footsteps, robots)
        for row, i in enumerate(robots):
            want, want_feet = single[i].plan(footsteps[row : row + 1], [0])
            for a, b in ((got.joints, want.joints), (got.trunk, want.trunk), (feet, want_feet)):
                np.testing.assert_allclose(a[row], b[0], atol=1e-12, err_msg="robots must not mix")

@BOTH
def test_feet_land_where_the_footsteps_put_them(sim):
    rng, engine, count = np.random.default_rng(5), make_engine(sim), 6
    footsteps, distance = random_footsteps(rng, sim, 1, count), engine.parameters.foot_distance
    right = matrix([0.0, -distance / 2, 0.0])
    for k in range(count):
        (x, y, yaw), (x2, y2, yaw2) = footsteps[0, k]
        left = right @ matrix([x, distance + y, yaw])  # seen from the right foot, at its left
        right = left @ matrix([x2, -distance - y2, -yaw2])  # seen from the left foot, mirrored
        _, feet = engine.plan(footsteps[:, k], [0])
        for foot, want in enumerate((left, right)):
            np.testing.assert_allclose(matrix(feet[0, -1, foot, [0, 1, 3]]), want, atol=1e-9,
                                       err_msg=f"{('left', 'right')[foot]} foot, double step {k}")
            np.testing.assert_allclose(engine.feet[0, foot], feet[0, -1, foot, [0, 1, 3]],
                                       atol=1e-12, err_msg="the engine remembers where they are")

@BOTH
def test_joint_targets_respect_the_limits(sim):
    rng, n = np.random.default_rng(7), 40
    engine = make_engine(sim, n)
    low, high = np.tile(ROBOT.joint_min, 2), np.tile(ROBOT.joint_max, 2)
    for _ in range(4):
        footsteps = 2 * random_footsteps(rng, sim, n)  # beyond what an action can ask for
        joints = engine.plan(footsteps, np.arange(n))[0].joints
        assert np.isfinite(joints).all()
        assert (joints >= low).all() and (joints <= high).all()
    engine.reset(np.arange(n))
    trajectory, _ = engine.plan(0 * footsteps, np.arange(n))
    torso, joints = engine.stance
    np.testing.assert_allclose(trajectory.joints[:, 0], np.tile(joints, (n, 1)), atol=1e-9,
                               err_msg="after a reset a plan starts from standing")
    x_offset = engine.parameters.trunk_x_offset  # where the simulator's frame begins
    np.testing.assert_allclose(trajectory.trunk[:, 0], np.tile(torso + [x_offset, *5 * [0]],
                                                               (n, 1)), atol=1e-9)


# ---------------------------------------------------------------- soles
def sole_corners(feet, side):
    """The four corners [..., 4, 2] of soles; feet [..., 3] (x, y, yaw) of ankles, side +1: left."""
    x = np.array([-ROBOT.foot_back, ROBOT.foot_front, ROBOT.foot_front, -ROBOT.foot_back])
    y = side * (np.array([-1, -1, 1, 1]) * ROBOT.foot_width / 2 + ROBOT.foot_outward)
    cos, sin = np.cos(feet[..., 2, None]), np.sin(feet[..., 2, None])
    return np.stack([feet[..., 0, None] + cos * x - sin * y,
                     feet[..., 1, None] + sin * x + cos * y], -1)

def gap(feet):
    """Distance [...] between left and right sole, seen from above, along the best separating axis.

    feet [..., 2, 3]; negative: the soles overlap. Of a rectangle two edges are axes enough.
    """
    left, right = sole_corners(feet[..., 0, :], 1), sole_corners(feet[..., 1, :], -1)
    best = np.full(feet.shape[:-2], -np.inf)
    for shape, k in product((left, right), (0, 1)):
        edge = shape[..., k + 1, :] - shape[..., k, :]
        normal = np.stack([-edge[..., 1], edge[..., 0]], -1)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        a, b = (np.einsum("...ij,...j->...i", corners, normal) for corners in (left, right))
        best = np.maximum(best, np.maximum(a.min(-1) - b.max(-1), b.min(-1) - a.max(-1)))
    return best

def test_gap_of_two_soles_in_cases_that_a_ruler_can_check():
    width, length = ROBOT.foot_width, ROBOT.foot_front + ROBOT.foot_back
    inner = width - 2 * ROBOT.foot_outward  # both soles reach inward from their ankles by half
    for left, right, want in (
            ([0, 0.2, 0], [0, 0, 0], 0.2 - inner), ([0, 0.05, 0], [0, 0, 0], 0.05 - inner),
            ([0.3, 0, 0], [0, 0, 0], 0.3 - length),
            ([0, 0, 0], [0, 0.2, 0], 0.2 - width - 2 * ROBOT.foot_outward),
            ([0, 0.2, math.pi / 2], [0, 0, 0], 0.2 - ROBOT.foot_back - inner / 2)):
        got = gap(np.array([left, right]))
        assert got == pytest.approx(want, abs=1e-12), f"{left}, {right}: the test's own ruler"

@BOTH
def test_soles_never_touch_within_the_limits(sim):
    limits = walk_engine.LIMITS[sim]
    corners = np.array(list(product(*zip(limits.low, limits.high))))  # [8, 3]
    worst = np.array(list(product(corners, corners)))  # [64, 2, 3] left, right
    inside = random_footsteps(np.random.default_rng(6), sim, 500)
    plans = [np.concatenate([worst.repeat(64, 0), inside]),  # every one, and then every other
             np.concatenate([np.tile(worst, (64, 1, 1)), inside[::-1]])]
    engine = make_engine(sim, len(plans[0]))
    for footsteps in plans:
        _, feet = engine.plan(footsteps, np.arange(len(footsteps)))  # [N, T + 1, 2, 4]
        apart = gap(feet[..., [0, 1, 3]])  # [N, T + 1]
        landings = apart[:, [engine.half_ticks, -1]].min()
        assert landings > 0.03, f"soles on the ground come as close as {1000 * landings:.0f} mm"
        above = np.abs(feet[..., 0, 2] - feet[..., 1, 2]) > ROBOT.sole_height
        touching = ((apart < 0) & ~above).any(1)
        assert not touching.any(), (
            f"{touching.sum()} of {len(touching)} double steps: one sole swings through the "
            f"other one, {footsteps[touching][:1]}")
        if sim == "mujoco":  # where feet collide: leave room beside one another, too
            assert apart.min() > 0.01, f"{1000 * apart.min():.0f} mm"
    close = np.tile([0.0, -0.15, 0.3], (1, 2, 1))
    _, feet = make_engine(sim).plan(close, [0])
    assert gap(feet[0, -1][:, [0, 1, 3]]) < 0, "beyond the limits the test should see an overlap"


# ---------------------------------------------------------------- walks
def walk(sim, step, count=8):
    """Torso [3] reached by `count` equal double steps, the commanded one, and if it stayed up."""
    plans = np.tile(np.array(step, float), (1, count, 1, 1))
    poses, wanted, fall = walk_engine.walk(sim, walk_engine.TUNED[sim], plans)
    return poses[0, -1], wanted[0, -1], bool(fall[0] == count)

@BOTH
@pytest.mark.parametrize("direction, step, axis, count", [
    ("forward", [[0.08, 0, 0], [0.08, 0, 0]], 0, 8),
    ("backward", [[-0.06, 0, 0], [-0.06, 0, 0]], 0, 8),
    ("sideways", [[0, 0.06, 0], [0, 0, 0]], 1, 8),
    ("turning", [[0, 0, 0.15], [0, 0, -0.15]], 2, 8),
    ("turning beyond half a turn", [[0, 0, -0.15], [0, 0, 0.15]], 2, 14)])
def test_it_walks_what_is_commanded(sim, direction, step, axis, count):
    got, wish, up = walk(sim, step, count)
    assert up, f"{direction}: fell within the step limits"
    left, right = step[0][axis], step[1][axis] * (1, -1, -1)[axis]
    assert wish[axis] == pytest.approx(count * (left + right) - right / 2), (
        "after a double step the left foot is behind the right one by the right one's step")
    assert got[axis] == pytest.approx(wish[axis], rel=0.2), (
        f"{direction}: walked {got[axis]:.2f}, commanded {wish[axis]:.2f} m or rad")
    others = [k for k in (0, 1) if k != axis]
    assert np.all(np.abs(got - wish)[others] < 0.25), f"{direction}: drifts to {got}"

@BOTH
def test_it_falls_when_it_must(sim):
    gentle, wild = np.tile([0.05, 0, 0.1], (5, 2, 1)), np.tile([0.4, 0, 0], (5, 2, 1))
    wild[0] = 0
    poses, wanted, fall = walk_engine.walk(sim, walk_engine.TUNED[sim], [gentle, wild, gentle])
    assert fall[1] in (1, 2, 3), "steps of 0.4 m are longer than a leg: physics should say no"
    k = fall[1] + 1
    np.testing.assert_array_equal(poses[1, k:], np.tile(poses[1, k], (6 - k, 1)), err_msg=(
        "a walk ends with its fall"))
    np.testing.assert_array_equal(wanted[1, k:], np.tile(wanted[1, k], (6 - k, 1)))
    alone = walk_engine.walk(sim, walk_engine.TUNED[sim], [gentle, gentle])
    np.testing.assert_array_equal(fall[[0, 2]], alone[2], err_msg="5: these two stay up")
    np.testing.assert_array_equal(poses[[0, 2]], alone[0], err_msg="who falls is not in the way")
    np.testing.assert_array_equal(wanted[[0, 2]], alone[1])

@BOTH
def test_wanted_is_the_middle_between_the_feet(sim):
    footsteps = 0.3 * random_footsteps(np.random.default_rng(9), sim, 2, 4)
    poses, wanted, fall = walk_engine.walk(sim, walk_engine.TUNED[sim], footsteps)
    assert (fall == 4).all() and poses.shape == wanted.shape == (2, 5, 3)
    engine = make_engine(sim, 2)
    np.testing.assert_array_equal(wanted[:, 0], 0)
    for k in range(4):
        engine.plan(footsteps[:, k], np.arange(2))
        np.testing.assert_allclose(wanted[:, k + 1], engine.feet.mean(1), atol=1e-12)
    np.testing.assert_allclose(poses[:, -1], wanted[:, -1], atol=0.1, err_msg=(
        "small steps: the torso should be about there"))

def test_a_sharp_turn_slips_in_mujoco():
    shares = np.linspace(0.94, 1.06, 7)[:, None, None, None]  # slipping is chaotic: take the mean
    achieved = {}
    for yaw in (0.1, 0.6):
        plans = shares * np.tile([[0, 0, yaw], [0, 0, -yaw]], (1, 5, 1, 1))
        poses, wanted, _ = walk_engine.walk("mujoco", walk_engine.TUNED["mujoco"], plans)
        achieved[yaw] = (poses[:, -1, 2] / wanted[:, -1, 2]).mean()
    assert achieved[0.1] == pytest.approx(1.0, abs=0.15), f"gentle: {achieved[0.1]:.2f} of the turn"
    assert achieved[0.6] < 0.88, (
        f"sharp: {achieved[0.6]:.2f} of the turn; the soles should slip on the ground")

@BOTH
def test_the_same_plan_gives_the_same_walk(sim):
    plans = 0.5 * random_footsteps(np.random.default_rng(8), sim, 3, 4)
    one, two = (walk_engine.walk(sim, walk_engine.TUNED[sim], plans) for _ in range(2))
    for a, b in zip(one, two):
        np.testing.assert_array_equal(a, b)
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

def numbers(parameters):
    """What is searched, as shares [11] of the ranges."""
    low, high = np.array(list(walk_engine.SEARCH.values())).T
    return (np.array([getattr(parameters, key) for key in walk_engine.SEARCH]) - low) / (high - low)

@pytest.fixture
def tried(monkeypatch):
    """Instead of walking, every candidate is scored by its distance to a known optimum."""
    optimum, seen = np.linspace(0.25, 0.75, len(walk_engine.SEARCH)), []

    def score(sim, parameters):
        seen.append(numbers(parameters))
        return -np.linalg.norm(seen[-1] - optimum), {"forward": 0.0}, 0.0

    monkeypatch.setattr(walk_engine, "score", score)
    return optimum, seen

def test_tuning_keeps_the_best_quarter(tried):
    optimum, seen = tried
    found = numbers(walk_engine.tune("mujoco", seed=0, iterations=1))
    np.testing.assert_allclose(seen[0], numbers(walk_engine.WalkParameters()), atol=1e-3)
    order = np.argsort([np.linalg.norm(x - optimum) for x in seen])
    best = np.array(seen)[order[: len(seen) // 4]]
    # The candidates are rounded to four decimals, hence the tolerance.
    np.testing.assert_allclose(found, 0.3 * seen[0] + 0.7 * best.mean(0), atol=3e-3, err_msg=(
        "the new mean: 30 % of the old one, 70 % of the BEST quarter; the best scores are the "
        "largest"))

def test_tuning_moves_to_the_optimum(tried):
    optimum, seen = tried
    found = numbers(walk_engine.tune("mujoco", seed=1, iterations=15))
    before, after = (np.linalg.norm(x - optimum) for x in (seen[0], found))
    assert after < 0.1 * before, f"from {before:.2f} to {after:.2f} of the ranges away from it"
    first, last = (np.std(x, axis=0).mean() for x in (seen[:32], seen[-32:]))
    assert last < 0.2 * first, "the candidates should gather: does the spread shrink?"

def test_speed_plans_move_along_their_axis_only():
    plans, levels = walk_engine.speed_plans(), walk_engine.LEVELS
    assert plans.shape == (4 * levels, len(walk_engine.PATTERN), 2, 3)
    engine = make_engine("mujoco", len(plans))
    for k in range(plans.shape[1]):
        engine.plan(plans[:, k], np.arange(len(plans)))
    moved = np.abs(engine.feet.mean(1)).reshape(4, levels, 3)
    for row, (direction, (_, axis, _)) in zip(moved, walk_engine.DIRECTIONS.items()):
        assert (np.diff(row[:, axis]) > 0).all(), f"{direction}: every level is faster"
        assert row[0, axis] > 0.02, f"{direction} moves along axis {axis} of x, y, yaw"
        if direction != "turning":  # there, each foot steps around the other one
            np.testing.assert_allclose(np.delete(row, axis, 1), 0, atol=1e-9, err_msg=direction)

def test_random_plans_stay_within_the_limits():
    limits = walk_engine.LIMITS["mujoco"]
    plans = walk_engine.random_plans(np.random.default_rng(0), limits, 200)
    low, high = plans.min((0, 1)), plans.max((0, 1))  # [2, 3] each foot
    assert (low >= limits.low).all() and (high <= limits.high).all()
    room = 0.02 * (np.array(limits.high) - limits.low)
    assert (low < limits.low + room).all() and (high > limits.high - room).all(), "all of them"

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

@pytest.mark.parametrize("sim, want", [("mujoco", (2 + 1 + 1 + 1) / 4),
                                       ("pymunk", (2 + 1 + 1) / 3)])
def test_score_adds_roots_of_speeds_and_the_share_of_random_steps(monkeypatch, sim, want):
    parameters = walk_engine.TUNED[sim]
    moving = sum(walk_engine.PATTERN) * walk_engine.WalkEngine(1, parameters).period  # [s]

    def fake(got, _, footsteps):
        levels, count = walk_engine.LEVELS, len(walk_engine.PATTERN)
        assert got == sim and len(footsteps) > 4 * levels
        poses, fall = np.zeros((len(footsteps), count + 1, 3)), np.full(len(footsteps), count)
        for i, (direction, (_, axis, good)) in enumerate(walk_engine.DIRECTIONS.items()):
            speed = good * (4 if direction == "forward" else 1)
            poses[(i + 1) * levels - 1, -1, axis] = speed * moving
        fall[4 * levels :: 2] = count // 2  # every other random walk falls half-way
        return poses, poses, fall

    monkeypatch.setattr(walk_engine, "walk", fake)
    value, speeds, stood = walk_engine.score(sim, parameters)
    assert stood == pytest.approx(0.75), "the share of random double steps that were stood"
    assert value == pytest.approx(want + 2 * 0.75), (
        "mean of √(speed / good speed) + 2 · share; sideways is no achievement on the plane")
    assert set(speeds) == set(walk_engine.DIRECTIONS) - ({"sideways"} if sim == "pymunk" else set())
