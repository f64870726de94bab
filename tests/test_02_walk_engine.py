"""Stage 2, checked against theory, plain geometry and physics."""

from dataclasses import replace
from functools import partial
from importlib import import_module
from itertools import product

import numpy as np
import pytest
from checks import BOTH, close, equal, frozen
from numpy.polynomial.polynomial import polyfit
from numpy.random import default_rng

robot_model = import_module("01_robot_model")
walk_engine = import_module("02_walk_engine")

ROBOT = robot_model.RobotModel()


def make_engine(sim, num_robots=1, **law):
    parameters = replace(walk_engine.TUNED[sim], **law)
    return walk_engine.WalkEngine(num_robots, parameters, ROBOT, sim == "pymunk")


def random_footsteps(rng, *shape):
    """Left and right footsteps [..., 2, 3], about as large as those of the task."""
    return rng.uniform((-0.08, -0.03, -0.2), (0.12, 0.07, 0.3), (*shape, 2, 3))


def test_quintic_meets_its_six_boundary_conditions():
    rng = default_rng(0)
    for duration in rng.uniform(0.2, 2.0, 5):
        start, end = rng.normal(size=(2, 5, 4, 3))  # robots, axes
        frozen(start, end)
        splines = walk_engine.quintic(start, end, duration)
        assert splines.shape == (5, 4, 6), "start, end [..., 3] in, coefficients [..., 6] out"
        for i, k in product(range(5), range(4)):
            c = np.polynomial.Polynomial(splines[i, k])
            for t, want, where in ((0.0, start, "start"), (duration, end, "end")):
                got = [c.deriv(order)(t) if order else c(t) for order in range(3)]
                close(
                    got,
                    want[i, k],
                    f"{where}: position, velocity, acceleration; c₀ comes first; is c₂ = a₀/2? the "
                    "powers of T?",
                )


@BOTH
def test_trunk_is_smooth_and_feet_stay_across_double_steps(sim):
    engine, rng, dt = make_engine(sim), default_rng(3), ROBOT.control_dt
    plans = [engine.plan(random_footsteps(rng, 1), [0]) for _ in range(6)]
    for first, second in zip(plans, plans[1:]):
        before, after = first.trunk[0], second.trunk[0]  # [T + 1, 6]
        close(
            first.feet[0, -1],
            second.feet[0, 0],
            "a foot jumps: the next plan must start where this one ended",
        )
        # Each side of the seam is one quintic: a fit of degree 5 is exact.
        last = polyfit(dt * np.arange(-9, 1), before[-10:], 5)
        start = polyfit(dt * np.arange(10), after[:10], 5)
        for order, what, unit in ((0, "position", ""), (1, "velocity", "/s"), (2, "c₂", "/s²")):
            close(
                start[order],
                last[order],
                f"{what} of x, y, z, roll, pitch, yaw [m{unit} or rad{unit}] jumps between double "
                "steps: the next spline starts with the state in which this one ended",
            )
        assert np.abs(last[1]).max() > 0.05, "the trunk should be moving at the seam"
    standing = polyfit(dt * np.arange(10), plans[0].trunk[0, :10], 5)
    close(standing[1:3], 0, "a walk begins at rest: velocity or c₂ jumps there")
    jump = max(np.abs(np.diff(trajectory.joints, axis=1)).max() for trajectory in plans)
    assert jump < 0.2, f"a joint's target jumps by {jump:.2f} rad in a tick"


@pytest.mark.parametrize("phase", [0.0, 0.25, -0.25])
def test_trunk_passes_its_knots_between_the_feet(phase):
    p = replace(
        walk_engine.TUNED["mujoco"],
        half_ticks=28,
        trunk_phase=phase,
        trunk_swing=0.3,
        trunk_x_offset=0.02,
        trunk_pitch=0.1,
        pitch_per_step=0.5,
        trunk_roll=0.05,
    )
    for footsteps in (
        [[0, 0, 0], [0, 0, 0]],
        [[0.08, 0.03, 0.2], [0.06, 0.01, -0.1]],
    ):
        engine = walk_engine.WalkEngine(1, p, ROBOT)
        left, right = engine.feet[0].copy()
        trunk = engine.plan([footsteps], [0]).trunk[0]  # [T + 1, 6]
        new_left, new_right = engine.feet[0]
        steps = (right, left, new_left), (new_left, right, new_right)
        for k, (support, start, landing) in enumerate(steps):
            tick = round((k + 0.5 + phase) * p.half_ticks)  # the very tick of the knot
            x, y, z, roll, pitch, yaw = trunk[tick]
            before, after = (support + start) / 2, (support + landing) / 2
            centre = (before + after) / 2
            hint = "trunk_roll towards the SUPPORT foot: a positive roll leans to the right"
            close((z, roll), (p.trunk_height, (0.05, -0.05)[k]), hint)
            close(yaw, centre[2], "the yaw of the middle, half way")
            ahead, aside, _ = robot_model.relative(centre, np.array([x, y, yaw]))
            close(
                ahead,
                p.trunk_x_offset,
                "half way the trunk is between the feet, and x_offset AHEAD of their middle",
            )
            towards = robot_model.relative(centre, support)[1]
            assert (towards < 0) == (k == 0), "while the left foot swings the right one supports"
            close(
                aside,
                p.trunk_swing * towards,
                f"knot {k + 1}: sideways a share of the way to the SUPPORT foot, at {towards:.3f} m",
            )
            forward = robot_model.turned((after - before)[:2], -centre[2])[0]
            close(
                pitch,
                0.1 + 0.5 * forward,
                "the lean is trunk_pitch + pitch_per_step · forward; forward: the way of the trunk's "
                "middle, not of the foot, in its own frame",
            )
            # From knot to knot it is one quintic: a fit of degree 5 is exact.
            near = np.arange(10) if k == 0 else np.arange(-9, 1)
            c = polyfit(near * ROBOT.control_dt, trunk[tick + near], 5)
            velocity = (after - before) / engine.half
            close(c[1, [0, 1, 5]], velocity, "with the mean velocity of the step")
            close(c[1, 3:5], 0, "there the lean turns back")
            close(c[2], 0, "it passes unaccelerated", atol=1e-5)


def standing(n):
    """A WalkPlan of five ticks for n robots: nothing moves, and no foot has a reflex."""
    joints, trunk, feet = (np.zeros((n, 6, *shape)) for shape in ((12,), (6,), (2, 4)))
    gain, engine = np.zeros((n, 5, 2)), make_engine("mujoco", n)
    return walk_engine.WalkPlan(joints, trunk, feet, gain, np.arange(n), engine)


def test_reflex_adds_its_gain_times_the_rate_beyond_the_planned_one():
    plan, robot = standing(1), replace(ROBOT, control_dt=0.02)
    plan.trunk[0, 2:5, 3:5] = [0.010, 0.100], [0.011, 0.098], [0.014, 0.090]
    plan.reflex_gain[0, 2:4] = [0.05, 0], [0, 0.1]  # at first the left foot stands, then the right
    for samples in ([2, 3, 4], [2, 3]):
        got = plan.feedback(
            robot, np.array([0]), np.array([samples]), np.broadcast_to([0.6, 0.8], (1, 2))
        )
        # planned in two ticks: +0.004 / 0.04 s = 0.1 and −0.010 / 0.04 s = −0.25 rad/s; in one: half
        # of the first, and −0.002 / 0.02 s; measured: 0.6 and 0.8 rad/s
        roll, pitch = (0.6 - 0.1, 0.8 + 0.25) if len(samples) == 3 else (0.6 - 0.05, 0.8 + 0.1)
        want = np.zeros((1, 2, 12))
        want[0, 0, [5, 4]] = 0.05 * roll, 0.05 * pitch
        want[0, 1, [11, 10]] = 0.1 * roll, 0.1 * pitch
        close(
            got,
            want[:, : len(samples) - 1],
            "added = gain·(measured rate − planned rate), which is the change of the lean / time, of "
            "a robot with another control_dt: x to the roll, y to the pitch of the ankle whose gain "
            "it is; one reading for both ticks, or for a single one; no other joint",
        )


def test_reflex_has_a_limit_and_reads_every_robot_for_itself():
    plan, limit = standing(3), walk_engine.REFLEX_LIMIT
    plan.reflex_gain[:] = np.array([0.02, 0.1, -0.05])[:, None, None]  # of both feet
    at, rows = np.tile([0, 1, 2], (3, 1)), np.arange(3)
    rates = np.array([[7, 99], [-99, 0], [1.0, 99]])
    frozen(at, rows, rates)
    got = plan.feedback(ROBOT, rows, at, rates)
    want = np.array([[0.14, limit], [-limit, 0], [-0.05, -limit]])  # ankle roll, ankle pitch
    close(
        got[..., [5, 4, 11, 10]],
        np.tile(want[:, None], (2, 2)),
        "what is ADDED is limited, to either side; not the rate",
    )


def test_reflex_follows_a_plan_that_waits_and_one_that_has_ended():
    plan, robot = standing(2), replace(ROBOT, control_dt=0.01)
    plan.trunk[:, :, 4] = 0.001 * np.arange(6) ** 2  # [rad] at the six samples
    plan.reflex_gain[:, :, 0] = [0.01, 0.02, 0.03, 0.04, 0.05]  # [s] in the five ticks
    waits = np.array([[3, 3, 3], [4, 5, 5]])
    got = plan.feedback(robot, np.array([1, 0]), waits, np.zeros((2, 2)))[..., 4]
    want = [[0, 0], [-0.05 * 0.009 / 0.02, -0.05 * 0.009 / 0.02]]
    close(got, want, "the lean between the samples `at`; after the end the gain of the last tick "
          "(a robot that waits expects no rate)", atol=1e-9)  # fmt: skip


LAW = replace(walk_engine.TUNED["mujoco"], capture=0.8, usual_lean=0.03, fade=0.1, wait=8.0,
              late_lean=0.05, trunk_height=0.4)  # fmt: skip
# Lean beyond the plan (roll, pitch), over the support foot; which foot swings; the answer before;
# the answer: left foot, right foot; to the left [m], roll, pitch [rad]
ANSWERS = {
    "a lean within usual_lean is not answered": (
        (0.03, -0.02), 0.03, "left", (0, 0, 0), ((0, 0, 0), (0, 0, 0))),
    "half of the share `capture` of what is beyond ± usual_lean; to the swing side no shift": (
        (-0.13, 0.08), -0.13, "left", (0, 0, 0), ((0, -0.04, 0.02), (0, 0, 0))),
    "to the side of the support foot it lands beside it as planned: h·e to the left for a positive "
    "roll": ((0.13, -0.08), 0.13, "left", (0, 0, 0), ((0.016, 0.04, -0.02), (0, 0, 0))),
    "of the right foot likewise; a shift keeps the sign of the roll": (
        (-0.13, 0.0), 0.13, "right", (0, 0, 0), ((0, 0, 0), (-0.016, -0.04, 0))),
    "a swing foot goes half of the way from where it was; a standing one's answer fades by `fade`": (
        (0.03, 0.13), 0.03, "right", (0.01, 0.1, 0.2), ((0.009, 0.09, 0.18), (0.005, 0.05, 0.14))),
}  # fmt: skip


def test_capture_step_moves_the_swing_foot_by_the_lean():
    rows = [*ANSWERS.values()]
    error, over = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
    swings = np.array([[row[2] == "left", row[2] == "right"] for row in rows])
    old = np.array([[row[3]] * 2 for row in rows], float)
    frozen(error, over, swings, old)
    got = walk_engine.capture_step(error, over, swings, old, LAW)
    assert np.shape(got) == (len(rows), 2, 3), "robots; left, right foot; y, roll, pitch"
    for hint, row, answer in zip(ANSWERS, rows, got):
        close(answer, row[4], hint, atol=1e-12)
    off = walk_engine.capture_step(error, over, swings, 0 * old, replace(LAW, capture=0.0))
    close(off, 0, "capture = 0: no answer")


def test_waiting_pace_slows_the_plan_down_while_the_robot_leans_over_its_support_foot():
    over = np.array([-1.0, 0.0, 0.05, 0.10, 0.16, 0.5])
    frozen(over)
    want = [1, 1, 1, 0.6, 0.12, 0]
    got = walk_engine.waiting_pace(over, LAW)
    close(got, want, "1 − wait·(over − late_lean): never above 1, never below 0", atol=1e-12)
    close(walk_engine.waiting_pace(over, replace(LAW, wait=0.0)), 1, "wait = 0: never")


def test_a_plan_that_nobody_disturbs_is_the_same_with_and_without_the_law():
    laws = {"capture": 0.0, "wait": 0.0}, {"capture": 1.0, "wait": 10.0}
    plain, lawful = (make_engine("mujoco", **law) for law in laws)
    for engine, most in ((plain, 62), (lawful, 102)):
        plan = engine.plan([[[0.08, 0, 0.1], [0.08, 0, 0]]], [0])
        plan.begin()
        assert plan.most_ticks == most, "a double step may wait for longest_wait_ticks"
        for tick in range(0, 62, 2):
            assert not plan.ended(tick)[0]
            planned = plan.trunk[:, tick, 3:5]
            samples, _ = plan.targets(ROBOT, np.array([0]), tick, planned, np.zeros((1, 2)))
            close(samples[0], plan.joints[0, tick : tick + 3], "as planned")
        assert plan.ended(62)[0]


def test_a_plan_waits_no_longer_than_it_may_and_the_foot_lands_where_the_robot_leans():
    """The right foot stands, the robot leans by 0.14 rad to its side, then to the other one."""
    engine = make_engine("mujoco", 2, capture=1.0, wait=100.0)
    plan, rows = engine.plan(np.zeros((2, 2, 3)), [0, 1]), np.array([0, 1])
    plan.begin()
    lean, ticks = np.array([[0.14, 0.0], [-0.14, 0.0]]), np.zeros(2, int)
    while not plan.ended(ticks.max()).all():
        on = rows[~plan.ended(ticks.max())]
        now = np.rint(plan.progress[on]).astype(int)
        tilt = plan.trunk[on, now, 3:5] + lean[on] * (now[:, None] < 31)  # until the left one lands
        samples, _ = plan.targets(ROBOT, on, ticks.max(), tilt, np.zeros((len(on), 2)))
        ticks[on] = ticks.max() + 2
        if plan.progress[1] == 30:  # robot 1 does not wait: its left foot is about to land
            joints = samples[-1, -1]
    equal(
        ticks, [102, 62], "who leans over the support foot waits, at most 40 ticks; others do not"
    )
    # Robot 1 leans as a whole, about its right foot: where is the left one then?
    trunk, pivot = plan.trunk[1, 30], plan.feet[1, 30, 1, :3]
    tilted = robot_model.rotation(*np.array([-0.14, 0, 0]))
    leaning = np.concatenate([pivot + tilted @ (trunk[:3] - pivot), trunk[3:] + [-0.14, 0, 0]])
    points, turn = robot_model.body_points(ROBOT, leaning, joints)
    e = 0.14 - engine.parameters.usual_lean
    aside = points[0, 2, 1] - plan.feet[1, 30, 0, 1]
    hint = f"{1000 * aside:.0f} mm farther to the left: h·e is {1000 * trunk[2] * e:.0f} mm"
    close(aside, trunk[2] * e, hint, rtol=0.1)
    close(turn[0, 2, 1], -engine.parameters.usual_lean, "its sole is nearly level", atol=0.01)
    equal(engine.answer[1, 1], 0, "the right foot stood all the time that the robot leaned")


def test_the_answer_of_a_foot_goes_on_in_the_next_double_step():
    engine = make_engine("mujoco", 2, capture=1.0)
    engine.answer[1] = 0.02, 0.05, 0.03
    for robots in ([0, 1], [1]):  # also if the rows of the plan are not all robots
        before, row = engine.answer.copy(), np.array([len(robots) - 1])
        plan = engine.plan(np.zeros((len(robots), 2, 3)), robots)
        plan.begin()
        plan.targets(ROBOT, row, 0, plan.trunk[row, 0, 3:5], np.zeros((1, 2)))
        keeps = 1 - engine.parameters.fade
        hint = "a standing foot snaps back: the next plan begins with the answer of the last one"
        close(engine.answer[1, 1], keeps * before[1, 1], hint)
        equal(engine.answer[0], 0, "of this robot only")
    engine.reset([1])
    equal(engine.answer, 0, "a reset forgets it")


@BOTH
def test_the_reflex_belongs_to_the_foot_that_does_not_swing(sim):
    engine = make_engine(sim)
    plan = engine.plan([[[0.08, 0, 0.1], [0.08, 0, 0]]], [0])
    gain, half = plan.reflex_gain[0], engine.parameters.half_ticks
    for first in (0, half):  # two single steps; each of them begins with a double support
        swing = plan.feet[0, first : first + half, :, 2].max(0).argmax()
        here = gain[first : first + half]
        equal(here[:, swing], 0, "the ankle of a foot in the air would only kick")
        equal(here[:, 1 - swing], engine.parameters.reflex, "this one stands all the time")
    disturbance = robot_model.Disturbance.none(plan)
    disturbance.push[:] = 1
    assert not disturbance.gyro_error.any(), "whoever writes pushes into it changes the gyro"


@BOTH
def test_all_zero_footsteps_step_on_the_spot(sim):
    engine = make_engine(sim)
    p, half = engine.parameters, engine.parameters.half_ticks
    stands = [[0, p.foot_distance / 2, 0], [0, -p.foot_distance / 2, 0]]
    for _ in range(4):
        trajectory = engine.plan(np.zeros((1, 2, 3)), [0])
        feet = trajectory.feet
        close(
            feet[0][..., [0, 1, 3]],
            np.tile(stands, (feet.shape[1], 1, 1)),
            "zeros: each foot lands where it was",
        )
        rise = feet[0, ..., 2]  # [T + 1, 2]
        close(rise.max(0), p.foot_rise, "half way it is as high as foot_rise", rtol=0.1)
        close(rise.min(-1), 0, "one foot is always on the ground, z = 0")
        close(
            rise[[half, -1], [0, 1]],
            0,
            "half of the swing up, half of it down: a foot lands at height 0",
        )
        assert np.all(np.abs(trajectory.trunk[0, :, 0]) < 0.02), "the trunk stays above the feet"
    assert rise[half // 2, 0] > 0.01 and rise[half + half // 2, 1] > 0.01, "left swings first"


def test_swing_foot_waits_rises_and_lands_at_rest():
    engine = make_engine("mujoco")
    feet = engine.plan([[[0.1, 0.02, 0.2], [0.1, 0.0, 0.0]]], [0]).feet
    left = feet[0, : engine.parameters.half_ticks + 1, 0]  # [K, 4]
    waiting = int(engine.parameters.double_support * engine.parameters.half_ticks)
    assert waiting >= 1, "the test should see the double support"
    close(
        left[: waiting + 1],
        left[:1].repeat(waiting + 1, 0),
        "it waits during the double support, on the ground: not even a small way is made",
    )
    assert np.ptp(left[: waiting + 3, :3], 0).min() > 1e-6, "it waits no longer than that"
    close(
        left[-2, [0, 1, 3]],
        engine.feet[0, 0],
        "x, y and yaw just before it lands: it lands where it shall, and at rest",
        atol=2e-3,
    )
    assert left[-2, 2] > 1e-6, "it lands at the end of the single step, and waits before it only"
    speed = np.abs(np.diff(left, axis=0)) / ROBOT.control_dt
    assert np.all(speed[-1] < 0.1 * speed.max(0) + 1e-9), "the foot should land at rest"
    change = np.abs(np.diff(left[:, [0, 1, 3]], 2, axis=0))  # of the speed, tick by tick
    assert np.all(change[-1] < 0.6 * change.max(0)), (
        "x, y and yaw land without acceleration: degree five, for a cubic brakes most at the end"
    )
    assert left[:, 2].min() > -1e-9, f"below the ground: z = {left[:, 2].min()} m"


@BOTH
def test_plans_of_many_robots_equal_single_plans(sim):
    rng, n = default_rng(4), 5
    many, single = make_engine(sim, n), [make_engine(sim) for _ in range(n)]
    for robots in (np.arange(n), [3, 1], np.arange(n)):
        footsteps = random_footsteps(rng, len(robots))
        got = many.plan(footsteps, robots)
        for row, i in enumerate(robots):
            want = single[i].plan(footsteps[row : row + 1], [0])
            for name in ("joints", "trunk", "feet"):
                close(vars(got)[name][row], vars(want)[name][0], "robots must not mix")


@BOTH
def test_feet_land_where_the_footsteps_put_them(sim):
    rng, engine, count = default_rng(5), make_engine(sim), 6
    footsteps, distance = random_footsteps(rng, 1, count), engine.parameters.foot_distance
    right = np.array([0.0, -distance / 2, 0.0])
    for k in range(count):
        one, other = footsteps[0, k] + [0, distance, 0]
        left = robot_model.compose(right, one)  # seen from the right foot, at its left
        right = robot_model.compose(left, other * [1, -1, -1])  # seen from the left foot, mirrored
        feet = engine.plan(footsteps[:, k], [0]).feet
        landed = feet[0, -1][:, [0, 1, 3]]
        close(landed, [left, right], f"left and right foot, double step {k}")
        close(engine.feet[0], landed, "the engine remembers where they are")


@BOTH
def test_joint_targets_begin_as_the_robot_stands_also_after_a_reset(sim):
    rng, n = default_rng(7), 40
    engine, robots = make_engine(sim, n), np.arange(n)
    for _ in range(4):
        engine.plan(random_footsteps(rng, n), robots)
    engine.reset(robots)
    plan, fresh = (one.plan(np.zeros((n, 2, 3)), robots) for one in (engine, make_engine(sim, n)))
    equal(plan.trunk, fresh.trunk, "something of the last walk survives a reset")
    torso, joints = engine.stance
    close(plan.joints[:, 0], np.tile(joints, (n, 1)), "it begins standing")
    torso[0] += engine.parameters.trunk_x_offset  # where the simulator's frame begins
    close(plan.trunk[:, 0], np.tile(torso, (n, 1)))


@BOTH
def test_it_walks_what_is_commanded(sim):
    count, tests = (
        8,
        {  # steps of left and right foot, and the axis along which they move
            "forward": ([0.08, 0, 0], [0.08, 0, 0], 0),
            "backward": ([-0.06, 0, 0], [-0.06, 0, 0], 0),
            "sideways": ([0, 0.06, 0], [0, 0, 0], 1),
            "turning left": ([0, 0, 0.15], [0, 0, -0.15], 2),
            "turning right, beyond half a turn": ([0, 0, -0.22], [0, 0, 0.22], 2),
        },
    )
    plans = [[test[:2]] * count for test in tests.values()]
    poses, wanted, fall = walk_engine.walk_plans(sim, walk_engine.TUNED[sim], plans)
    assert not poses[:, 0].any() and not wanted[:, 0].any(), "all of them begin at the origin"
    for what, (left, right, axis), got, goal, end in zip(
        tests, tests.values(), poses[:, -1], wanted[:, -1], fall
    ):
        assert end == count, f"{what}: fell"
        outward = (1, -1, -1)[axis] * right[axis]
        close(
            goal[axis],
            count * (left[axis] + outward) - outward / 2,
            "after a double step the left foot is behind the right one by the right one's step",
        )
        close(
            got[axis],
            goal[axis],
            f"{what}: walked {got[axis]:.2f}, commanded {goal[axis]:.2f} m or rad",
            rtol=0.2,
        )
        drift = np.delete(got - goal, [axis, 2])
        assert np.all(np.abs(drift) < 0.25), f"{what}: drifts by {drift.round(2)} m"


@BOTH
def test_a_walk_ends_with_its_fall_and_the_others_go_on(sim):
    plans = np.tile([0.05, 0, 0.1], (3, 5, 2, 1))
    plans[1, 1:] = [0.4, 0, 0]
    asked, seen, walk = [], [], partial(walk_engine.walk_plans, sim, walk_engine.TUNED[sim])
    poses, wanted, fall = walk(
        plans,
        disturb=lambda _, up: asked.append([*up]),
        watch=lambda _, motion: seen.append(len(motion.fell)),
    )
    assert fall[1] in (1, 2, 3), "steps of 0.4 m are longer than a leg: it should fall"
    k = fall[1] + 1
    assert asked == [[0, 1, 2]] * k + [[0, 2]] * (5 - k), "disturb is told which robots are up"
    assert seen == [3] * k + [2] * (5 - k), "watch sees every double step of those"
    assert (poses[1, k:] == poses[1, k]).all(), "a walk ends with its fall"
    for got, want in zip((poses, wanted, fall), walk(plans[[0, 2]])):
        equal(got[[0, 2]], want, "a fall changes another walk")


@BOTH
def test_pushes_during_a_walk_tilt_the_robot_with_the_reflex_less(sim):
    walk, speed = walk_engine.TUNED[sim], 0.9 if sim == "pymunk" else 0.6
    tilt, fell = walk_engine.pushed(sim, walk, speed)
    blind, blind_fell = walk_engine.pushed(sim, replace(walk, reflex=0.0), speed)
    calm, _ = walk_engine.pushed(sim, walk, 0.0)
    ticks = 12 * walk.half_ticks
    assert len(tilt) == 12 and min(map(len, tilt)) >= ticks, "twelve robots, six double steps"
    tilt, blind, calm = (
        np.array([one[:ticks] for one in all_of]) for all_of in (tilt, blind, calm)
    )
    assert (calm == calm[0]).all(), "without a push all twelve walk alike"
    begins = (np.abs(tilt - calm) > 1e-9).argmax(1)  # [tick]
    assert len({*begins}) == 12, f"each is pushed at another moment: {begins}"
    assert min(begins) >= 2 * walk.half_ticks and max(begins) < 4 * walk.half_ticks
    falls, blind_falls = fell.sum(), blind_fell.sum()
    assert falls < blind_falls, f"{falls} fall with the reflex, {blind_falls} without it"
    tilted = [np.median(one.max(1)).round(3) for one in (tilt, blind)]
    assert tilted[0] < tilted[1], f"largest tilts with and without the reflex: {tilted} rad"


def test_legs_that_cannot_reach_the_ground_are_told_once(capsys):
    short = replace(ROBOT, thigh_length=0.110, shin_length=0.110)
    for _ in range(2):
        walk_engine.WalkEngine(1, walk_engine.TUNED["mujoco"], short)
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith("note: ") and "0.3767 m" in line, line


def test_highest_speed_ignores_everything_beyond_the_first_fall():
    walk = import_module("walk")  # of tests/studies, or a student's
    levels, count = walk.LEVELS, len(walk.PATTERN)
    moving = sum(walk.PATTERN) * 0.5  # [s]
    ways = (np.arange(levels) + 1) / levels
    ways[[2, 3]] = ways[[3, 2]]  # level 3 is faster than level 4
    poses = np.full((4, levels, count + 1, 3), 3.0)  # not from the world's origin
    poses[:, :, 1:] = 9  # and aside
    for i, (axis, sign) in enumerate(((0, 1), (0, -1), (1, 1), (2, 1))):  # every walk its way
        poses[i, :, -1, axis] = 3 + sign * (1 + i) * ways
    poses, fall = poses.reshape(4 * levels, count + 1, 3), np.full(4 * levels, count)
    forward = walk.highest_speed(poses, fall, period=0.5)["forward"]
    close(
        forward,
        1 / moving,
        "its way along its axis, from its first pose on, by the time of all double steps that are "
        "not on the spot: sum(PATTERN) · period, not len(PATTERN) · period",
    )
    fall[4::levels] = 2  # level 5 falls
    for i, (direction, speed) in enumerate(walk.highest_speed(poses, fall, period=0.5).items(), 1):
        close(
            speed,
            i * ways[2] / moving,
            f"{direction}: of eight levels the third is the fastest below the first one that "
            "fell, and not the last one that stood; a way counts to whichever side",
        )
