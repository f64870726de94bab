"""Stage 2, checked against theory: splines against their boundary conditions, footsteps against
plain geometry, the engine against itself, and the walks against physics."""

import math
from dataclasses import replace
from importlib import import_module
from itertools import permutations, product

import mujoco
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
    return walk_engine.within(rng.uniform(limits.low, limits.high, (*shape, 2, 3)), limits)

def bodies(count, friction):
    """Robots as in the model on a ground of this μ."""
    spread = robot_model.Spread(0, 0, 0, 0, 0)
    body = spread.draw(np.random.default_rng(0).spawn(count), ROBOT)
    body.friction[:] = friction
    return body

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
    np.testing.assert_allclose(walk_engine.polynomial(c, 0.7 * tau), want, atol=1e-12, err_msg=(
        "from rest to rest: 10τ³ − 15τ⁴ + 6τ⁵, unaccelerated at both ends"))


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
        # Each side of the seam is one quintic, and the roll a sine: a fit of degree 9 is exact.
        last = np.polynomial.polynomial.polyfit(dt * np.arange(-9, 1), before[-10:], 9)
        start = np.polynomial.polynomial.polyfit(dt * np.arange(10), after[:10], 9)
        for order, what, unit in ((0, "position", ""), (1, "velocity", "/s"), (2, "c₂", "/s²")):
            np.testing.assert_allclose(start[order], last[order], atol=1e-6, err_msg=(
                f"{what} of x, y, z, roll, pitch, yaw [m{unit} or rad{unit}] jumps between double "
                "steps: the next spline starts with the state in which this one ended"))
        assert np.abs(last[1]).max() > 0.05, "the trunk should be moving at the seam"

@pytest.mark.parametrize("phase", [0.0, 0.25, -0.25])
def test_trunk_passes_its_knots_between_the_feet(phase):
    p = replace(walk_engine.TUNED["mujoco"], frequency=0.5 / 0.28, trunk_phase=phase,
                trunk_swing=0.3, trunk_x_offset=0.02, trunk_pitch=0.1, pitch_per_step=0.5,
                pitch_per_turn=0.4, trunk_roll=0)
    for footsteps in ([[0, 0, 0], [0, 0, 0]], [[0.08, 0, 0], [0.08, 0, 0]],
                      [[0.08, 0.03, 0.2], [0.06, 0.01, -0.1]], [[0, 0, -0.2], [0, 0, 0.2]]):
        engine, straight = (walk_engine.WalkEngine(1, q, ROBOT)
                            for q in (p, replace(p, pitch_per_turn=0)))
        left, right = engine.feet[0].copy()
        trunk, unturned = (e.plan(np.array([footsteps]), [0])[0].trunk[0]  # [T + 1, 6]
                           for e in (engine, straight))
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
            assert unturned[tick, 4] == pytest.approx(0.1 + 0.5 * forward, abs=1e-9), (
                "the lean is trunk_pitch + pitch_per_step · forward + …; forward: the way of the "
                "trunk's middle, not of the foot, in its own frame (turned by its own yaw)")
            assert pitch == pytest.approx(0.1 + 0.5 * forward + 0.4 * abs(turn), abs=1e-9), (
                "a turn to either side adds the same lean")
            # From knot to knot it is one quintic: a fit of degree 5 is exact.
            near = np.arange(10) if k == 0 else np.arange(-9, 1)
            c = np.polynomial.polynomial.polyfit(near * ROBOT.control_dt, trunk[tick + near], 5)
            np.testing.assert_allclose(c[1, [0, 1, 5]], (after - before) / engine.half, atol=1e-6,
                                       err_msg="it passes with the mean velocity of the step")
            np.testing.assert_allclose(c[2], 0, atol=1e-5, err_msg="it passes unaccelerated")

def test_trunk_rolls_towards_the_support_foot_and_leaves_the_feet_where_they_were():
    p = replace(walk_engine.TUNED["mujoco"], trunk_roll=0.06)
    footsteps = np.array([[[0.08, 0.02, 0.1], [0.06, 0, 0]]])
    engine, upright = (walk_engine.WalkEngine(1, replace(p, trunk_roll=roll), ROBOT)
                       for roll in (0.06, 0))
    (trajectory, feet), (_, want) = (e.plan(footsteps, [0]) for e in (engine, upright))
    roll, half = trajectory.trunk[0, :, 3], engine.half_ticks
    np.testing.assert_allclose(roll[[0, half, -1]], 0, atol=1e-12, err_msg=(
        "upright where single steps and double steps meet"))
    points, _ = robot_model.body_points(ROBOT, trajectory.trunk[0], trajectory.joints[0])
    lifted = points[:, 0, 0, 2] - points[:, 1, 0, 2]  # [T + 1] left hip above the right one [m]
    assert (lifted[1:half] > 0).all() and (lifted[half + 1 : -1] < 0).all(), (
        "the left foot swings first: the hip of the SWING foot is lifted")
    most = np.abs(roll).reshape(-1)[[half // 2, half + half // 2]]
    np.testing.assert_allclose(most, p.trunk_roll, rtol=0.01, err_msg="half-way it is all of it")
    np.testing.assert_array_equal(feet, want, err_msg="the feet need not know of a roll")
    np.testing.assert_allclose(points[:, :, 2, :2], feet[0, ..., :2], atol=1e-9)
    np.testing.assert_allclose(points[:, :, 3:, 2], feet[0, ..., 2, None] * np.ones(2), atol=1e-9,
                               err_msg="the legs make up for the roll: soles stay level")

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
        np.testing.assert_allclose(rise[[engine.half_ticks, -1], [0, 1]], 0, atol=1e-12, err_msg=(
            "half of the swing up, half of it down: a foot lands at height 0"))
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
    np.testing.assert_allclose(left[: waiting + 1], left[:1].repeat(waiting + 1, 0), atol=1e-12,
                               err_msg="it waits during the double support, on the ground")
    assert left[-1, 2] == pytest.approx(0, abs=1e-12), (
        "half of the swing up, half of it down: a foot lands at height 0")
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
    rng, limits = np.random.default_rng(6), walk_engine.LIMITS[sim]
    assert limits.load == 1.5, "the corners of what may be asked for: one whole and one half share"
    shares = np.array([*permutations((1, 0.5, 0)), (0.5, 0.5, 0.5)])  # of x, y, yaw
    ends = np.array(list(product(*zip(limits.low, limits.high))))  # [8, 3]
    corners = np.unique((ends[:, None] * shares).reshape(-1, 3), axis=0)  # [32, 3]
    worst = np.array(list(product(corners, corners)))  # [1024, 2, 3] left, right
    inside = random_footsteps(rng, sim, 500)
    plans = [np.concatenate([worst.repeat(4, 0), inside])]  # every one, and then any other
    plans.append(rng.permutation(plans[0]))
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


@BOTH
def test_within_leaves_what_is_possible_and_shrinks_the_rest_to_the_boundary(sim):
    limits, rng = walk_engine.LIMITS[sim], np.random.default_rng(3)
    low, high = np.array(limits.low), np.array(limits.high)
    asked = rng.uniform(low, high, (500, 2, 3))
    got = walk_engine.within(asked, limits)

    def load(footsteps):  # by the table, one foot and one axis at a time
        return np.array([[sum(v / high[k] if v > 0 else v / low[k] for k, v in enumerate(foot))
                          for foot in step] for step in footsteps])

    much = load(asked) > limits.load  # [500, 2]
    assert 50 < much.sum() < 950, "the test should see both kinds"
    np.testing.assert_array_equal(got[~much], asked[~much], err_msg=(
        "possible: untouched; and one foot's step does not shrink the other one's"))
    np.testing.assert_allclose(load(got)[much], limits.load, err_msg=(
        "too much: just on the boundary; forward and backward have different limits"))
    ratio = got[much] / asked[much]
    np.testing.assert_allclose(ratio, ratio[:, :1] * np.ones(3), err_msg=(
        "x, y and yaw shrink alike: the direction is kept"))
    for k in range(3):
        for most in (low[k], high[k]):
            alone = most * np.eye(3)[[k, k]]
            np.testing.assert_array_equal(walk_engine.within(alone, limits), alone, err_msg=(
                "all of one and nothing of the others is possible"))

def test_soles_are_where_mujoco_has_them():
    rng, count = np.random.default_rng(5), 40
    model = robot_model.mujoco_model(ROBOT)
    torso = rng.uniform([-1, -1, 0.3, -0.5, -0.5, -3], [1, 1, 0.5, 0.5, 0.5, 3], (count, 6))
    joints = rng.uniform(0.5 * np.tile(ROBOT.joint_min, 2), 0.5 * np.tile(ROBOT.joint_max, 2),
                         (count, 12))
    ankle, low = walk_engine.soles(ROBOT, torso, joints)  # [n, 2, 3], [n, 2]
    assert ankle.shape == (count, 2, 3) and low.shape == (count, 2)
    data = mujoco.MjData(model)
    for i in range(count):
        data.qpos[:3], data.qpos[7:] = torso[i, :3], joints[i]
        turn = robot_model.rotation(*torso[i, 3:])
        mujoco.mju_mat2Quat(data.qpos[3:7], turn.ravel())
        mujoco.mj_forward(model, data)
        for foot, side in enumerate(("left", "right")):
            np.testing.assert_allclose(ankle[i, foot], data.body(f"{side} foot").xpos, atol=1e-9)
            sole = data.geom(f"{side} sole")
            corners = np.array(list(product((-1, 1), (-1, 1), [-1]))) * model.geom(sole.id).size
            height = sole.xpos[2] + corners @ sole.xmat.reshape(3, 3)[2]  # [4] of the underside
            assert low[i, foot] == pytest.approx(height.min(), abs=1e-9), (
                f"{side}: the sole is beside its ankle, outward; its lowest corner counts")


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
    seen = []
    poses, wanted, fall = walk_engine.walk(sim, walk_engine.TUNED[sim], [gentle, wild, gentle],
                                           watch=lambda _, motion: seen.append(len(motion.fell)))
    assert fall[1] in (1, 2, 3), "steps of 0.4 m are longer than a leg: physics should say no"
    k = fall[1] + 1
    assert seen == [3] * k + [2] * (5 - k), "who watches sees every double step of who is up"
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

def turned(yaw, friction):
    """Mean walked ÷ commanded of five double steps that turn on the spot in MuJoCo."""
    shares = np.linspace(0.94, 1.06, 7)[:, None, None, None]  # slipping is chaotic: take the mean
    plans = shares * np.tile([[0, 0, yaw], [0, 0, -yaw]], (1, 5, 1, 1))
    poses, wanted, _ = walk_engine.walk("mujoco", walk_engine.TUNED["mujoco"], plans,
                                        bodies(7, friction))
    return (poses[:, -1, 2] / wanted[:, -1, 2]).mean()

def test_a_gentle_turn_is_followed_in_mujoco():
    share = turned(0.15, ROBOT.friction)  # a quarter of what is tried; 0.1 rad scuffs: 0.7
    assert share == pytest.approx(1.0, abs=0.2), f"{share:.2f} of the turn: do the feet scuff?"

@pytest.mark.parametrize("yaw", [0.2, 0.4])
def test_a_turn_slips_on_ice_in_mujoco(yaw):
    ground, ice = turned(yaw, ROBOT.friction), turned(yaw, 0.05)
    assert ground == pytest.approx(1.0, abs=0.15), f"{ground:.2f} of the turn on firm ground"
    assert ice < 0.5, f"{ice:.2f} of the turn: does μ of a Body reach the walk?"

@BOTH
def test_ice_costs_way(sim):
    plans = np.tile([[0.08, 0, 0], [0.08, 0, 0]], (1, 6, 1, 1))
    firm, ice = (walk_engine.walk(sim, walk_engine.TUNED[sim], plans, bodies(1, friction))[0]
                 for friction in (ROBOT.friction, 0.02))
    assert ice[0, -1, 0] < 0.9 * firm[0, -1, 0], (
        f"{ice[0, -1, 0]:.2f} m on ice, {firm[0, -1, 0]:.2f} m on firm ground")

@BOTH
def test_the_same_plan_gives_the_same_walk(sim):
    plans = 0.5 * random_footsteps(np.random.default_rng(8), sim, 3, 4)
    one, two = (walk_engine.walk(sim, walk_engine.TUNED[sim], plans) for _ in range(2))
    for a, b in zip(one, two):
        np.testing.assert_array_equal(a, b)
    assert np.ptp(one[0][:, -1], axis=0).max() > 0.01, "different plans, different walks"


# ---------------------------------------------------------------- tuning
@pytest.fixture
def few(monkeypatch):
    """Fewer walks for a measurement."""
    monkeypatch.setattr(walk_engine, "LEVELS", 2)
    monkeypatch.setattr(walk_engine, "FRICTION", (0.7,))

@pytest.mark.parametrize("sim", ["pymunk", pytest.param("mujoco", marks=pytest.mark.slow)])
def test_one_round_of_tuning_searches_its_range_and_nothing_else(few, sim, capsys):
    found, before = walk_engine.tune(sim, 0, 1, population=2, elite=1), walk_engine.TUNED[sim]
    assert isinstance(found, walk_engine.WalkParameters)
    for key, (low, high) in walk_engine.SEARCH.items():
        if sim == "pymunk" and key in walk_engine.PLANAR_FIXED:
            assert getattr(found, key) == getattr(before, key), f"{key} has no meaning on a plane"
        else:
            assert low <= getattr(found, key) <= high, f"{key} left the range it is searched in"
    assert (found.trunk_swing == found.trunk_roll == 0) or sim == "mujoco"
    shown = capsys.readouterr().out
    assert "score of the mean" in shown and "clearance" in shown

def numbers(parameters):
    """What is searched, as shares [12] of the ranges."""
    low, high = np.array(list(walk_engine.SEARCH.values())).T
    return (np.array([getattr(parameters, key) for key in walk_engine.SEARCH]) - low) / (high - low)

@pytest.fixture
def tried(monkeypatch):
    """Instead of walking, every candidate is scored by its distance to a known optimum."""
    optimum, seen, seeds = np.linspace(0.25, 0.75, len(walk_engine.SEARCH)), [], []

    def measure(sim, parameters, seed):
        seen.append(numbers(parameters))
        seeds.append(seed)
        return np.linalg.norm(seen[-1] - optimum)

    monkeypatch.setattr(walk_engine, "measure", measure)
    monkeypatch.setattr(walk_engine, "score", lambda sim, away: -away)
    monkeypatch.setattr(walk_engine, "in_words", str)
    return optimum, seen, seeds

def test_tuning_keeps_the_best_quarter(tried):
    optimum, seen, _ = tried
    found = numbers(walk_engine.tune("mujoco", seed=0, iterations=1))
    np.testing.assert_allclose(seen[0], numbers(walk_engine.TUNED["mujoco"]), atol=1e-3, err_msg=(
        "it begins where the last tuning ended"))
    order = np.argsort([np.linalg.norm(x - optimum) for x in seen])
    best = np.array(seen)[order[: len(seen) // 4]]
    # The candidates are rounded to four decimals, hence the tolerance.
    np.testing.assert_allclose(found, 0.3 * seen[0] + 0.7 * best.mean(0), atol=3e-3, err_msg=(
        "the new mean: 30 % of the old one, 70 % of the BEST quarter; the best scores are the "
        "largest"))

def test_tuning_moves_towards_the_optimum(tried):
    optimum, seen, _ = tried
    found = numbers(walk_engine.tune("mujoco", seed=1, iterations=15))
    before, after = (np.linalg.norm(x - optimum) for x in (seen[0], found))
    # A local search whose spread shrinks quickly: from this far it stops at about 40 %.
    assert after < 0.5 * before, f"from {before:.2f} to {after:.2f} of the ranges away from it"
    first, last = (np.std(x, axis=0).mean() for x in (seen[:28], seen[-28:]))
    assert last < 0.2 * first, "the candidates should gather: does the spread shrink?"

def test_tuning_compares_its_candidates_in_the_same_worlds(tried):
    _, _, seeds = tried
    walk_engine.tune("mujoco", seed=0, iterations=3, population=4, elite=1)
    worlds = np.reshape(seeds, (3, 4))
    assert (worlds == worlds[:, :1]).all(), "in one round luck must be the same for all"
    assert len(set(worlds[:, 0])) == 3, "other worlds in every round: or it learns one by heart"

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
    np.testing.assert_allclose(walk_engine.within(plans, limits), plans, err_msg=(
        "x, y and yaw together, too: the robot is never asked for more"))
    room = 0.02 * (np.array(limits.high) - limits.low)
    assert (low < limits.low + room).all() and (high > limits.high - room).all(), "all of them"

def test_highest_speed_ignores_everything_beyond_the_first_fall():
    levels, count = walk_engine.LEVELS, len(walk_engine.PATTERN)
    moving = sum(walk_engine.PATTERN) * 0.5  # [s]
    ways = (np.arange(levels) + 1) / levels
    ways[[2, 3]] = ways[[3, 2]]  # level 3 is faster than level 4
    poses = np.zeros((4 * levels, count + 1, 3))
    fall = np.full(4 * levels, count)
    for i, axis in enumerate((0, 0, 1, 2)):  # every walk moves its way
        poses[i * levels : (i + 1) * levels, -1, axis] = (1, -1, 1, 1)[i] * ways
    forward = walk_engine.highest_speed(poses, fall, period=0.5)["forward"]
    assert forward == pytest.approx(1 / moving), (
        "its way by the time of all double steps that are not on the spot: sum(PATTERN) · period, "
        "not len(PATTERN) · period")
    fall[4::levels] = 2  # level 5 falls
    for direction, speed in walk_engine.highest_speed(poses, fall, period=0.5).items():
        assert speed == pytest.approx(ways[2] / moving), (
            f"{direction}: of eight levels the third is the fastest below the first one that "
            "fell, and not the last one that stood; a way counts to whichever side")

def test_measure_of_robots_that_do_exactly_what_was_made_up(monkeypatch):
    """Robots follow their plan, but 4 mm too high and drifting 1 mm ahead per tick."""
    p = replace(walk_engine.TUNED["mujoco"], frequency=0.5 / 0.30, double_support=1 / 3,
                foot_rise=0.04, trunk_roll=0.05)  # the swing: 20 of 30 ticks
    plans, rows, seen = walk_engine.PLANS, 4 * walk_engine.LEVELS, {}

    def fake(sim, parameters, footsteps, body, watch):
        n, count = footsteps.shape[:2]
        seen["footsteps"], seen["body"] = footsteps, body
        engine = walk_engine.WalkEngine(n, parameters)
        trajectory, _ = engine.plan(footsteps[:, 0], np.arange(n))
        torso, fell = trajectory.trunk[:, 1:].copy(), np.arange(n) % 3 == 0
        torso[..., 0] += 0.001 * np.arange(torso.shape[1])
        torso[..., 2] += 0.004
        torso[fell, :, 2] = -1  # whoever fell has no clearance
        watch(engine, robot_model.Motion(torso, trajectory.joints[:, 1:], None, fell))
        wanted, fall = np.ones((n, count + 1, 3)), np.full(n, count)
        wanted[:, 0] = 0
        poses = wanted * np.repeat([0.5, 0.6, 0.7, 9], [rows, rows, rows, plans])[:, None, None]
        fall[-plans::2] = count // 2  # every other random walk falls half-way
        return poses, wanted, fall

    monkeypatch.setattr(walk_engine, "walk", fake)
    got, period = walk_engine.measure("mujoco", p, seed=3), 0.6
    assert len(seen["footsteps"]) == 3 * rows + plans
    friction = seen["body"].friction
    np.testing.assert_array_equal(friction[: 3 * rows], np.repeat(walk_engine.FRICTION, rows))
    assert np.ptp(friction[3 * rows :]) > 0.3, "random walks keep the ground that they drew"
    assert np.ptp(seen["body"].mass) > 0.1, "and all of them the bodies"
    moving = sum(walk_engine.PATTERN) * period  # [s]
    for share, speeds, tracking in zip((0.5, 0.6, 0.7), got["speeds"], got["tracking"]):
        for direction in walk_engine.DIRECTIONS:
            assert speeds[direction] == pytest.approx(share / moving), direction
            assert tracking[direction] == pytest.approx(share), f"{direction}: walked ÷ commanded"
    assert got["stood"] == 0.5, "the share of random plans"
    assert got["steps"] == 0.75, "the share of random double steps"
    # At 30 and at 70 % of its swing the foot is up by s(0.6) of its rise, minimum jerk.
    want = 0.04 * (10 * 0.6**3 - 15 * 0.6**4 + 6 * 0.6**5) + 0.004
    np.testing.assert_allclose(got["clearance"], want, atol=1e-9, err_msg=(
        "lowest corner of the SWING foot between 30 and 70 % of its swing"))
    assert got["slip"] == pytest.approx(0.019), "19 ticks of drift while the other foot swings"

def measured(**changed):
    """What `measure` might return: every required speed, everything else without fault."""
    required = {name: speed for name, (_, _, speed) in walk_engine.DIRECTIONS.items()}
    perfect = dict.fromkeys(required, 1.0)
    return {"speeds": [required] * 3, "tracking": [perfect] * 3, "stood": 1.0, "steps": 1.0,
            "clearance": [0.008, 0.001], "slip": 0.0} | changed

def test_score_adds_roots_of_speeds_at_the_worst_friction_standing_tracking_and_clearance():
    required = measured()["speeds"][0]
    assert walk_engine.score("mujoco", measured()) == pytest.approx(1 + 2 + 1 - 0 + 1)
    quick, slow = ({**required, "forward": factor * required["forward"]} for factor in (4, 1 / 4))
    for what, changed, want in (
            ("four times as fast forward: √4 = 2, a quarter of the mean",
             {"speeds": [quick] * 3}, 5 + 1 / 4),
            ("slow at one μ counts, the faster ones do not",
             {"speeds": [quick, slow, required]}, 5 - 1 / 8),
            ("random double steps count twice", {"steps": 0.5}, 4),
            ("random plans count once", {"stood": 0.5}, 4.5),
            ("10 % short", {"tracking": [dict.fromkeys(required, 0.9)] * 3}, 4.9),
            ("10 % too far is as bad", {"tracking": [dict.fromkeys(required, 1.1)] * 3}, 4.9),
            ("short and too far do not cancel",
             {"tracking": [dict.fromkeys(required, ratio) for ratio in (0.9, 1.0, 1.1)]},
             5 - 0.2 / 3),
            ("half of 8 mm, the median counts", {"clearance": [0.004, 0.004]}, 4.5),
            ("more than 8 mm is not rewarded", {"clearance": [0.020, 0.020]}, 5)):
        assert walk_engine.score("mujoco", measured(**changed)) == pytest.approx(want), what

def test_score_of_a_planar_robot_ignores_sideways_steps():
    required = measured()["speeds"][0]
    still, lost = {**required, "sideways": 0.0}, {**dict.fromkeys(required, 1.0), "sideways": 5.0}
    got = walk_engine.score("pymunk", measured(speeds=[still] * 3, tracking=[lost] * 3))
    assert got == pytest.approx(5), "on the plane they follow the command: no achievement"
    assert walk_engine.score("mujoco", measured(speeds=[still] * 3)) == pytest.approx(5 - 1 / 4)

def test_in_words_shows_the_worst():
    speeds = [dict.fromkeys(walk_engine.DIRECTIONS, v) for v in (0.31, 0.17, 0.52)]
    tracking = [dict.fromkeys(walk_engine.DIRECTIONS, v) for v in (0.93, 1.06, 0.81)]
    words = walk_engine.in_words(measured(speeds=speeds, tracking=tracking, stood=0.75,
                                          clearance=[0.0083, -0.0021], slip=0.0045))
    for part in (*(f"{name} 0.17" for name in walk_engine.DIRECTIONS), "0.81 to 1.06",
                 "standing 0.75", "8.3 / -2.1 mm", "slip 4.5 mm"):
        assert part in words, f"{part} is not in: {words}"
