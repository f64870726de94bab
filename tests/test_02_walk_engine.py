"""Stage 2, checked against theory, plain geometry and physics."""

from dataclasses import replace
from functools import partial
from importlib import import_module
from unittest import mock

import numpy as np
import pytest
from checks import BOTH, IN_3D_SLOW, close, equal, frozen
from numpy.polynomial.polynomial import polyfit
from numpy.random import default_rng

robot_model = import_module("01_robot_model")
walk_engine = import_module("02_walk_engine")

ROBOT = robot_model.RobotModel()


WALKS = walk_engine.WALKS
LAW = replace(walk_engine.TUNED["mujoco"], capture=0.8, usual_lean=0.03, follow=0.25, fade=0.1,
              wait=8.0, late_lean=0.05, trunk_height=0.4)  # fmt: skip


def make_engine(sim, num_robots=1, robot=ROBOT, **law):
    parameters = replace(walk_engine.TUNED[sim], **law)
    return walk_engine.WalkEngine(num_robots, parameters, robot, sim == "pymunk")


def planned(engine, plan):
    """The joint angles of the first robot's planned feet and trunk, [T + 1, 12]."""
    return robot_model.joints_for_feet(engine.robot, plan.trunk[0], plan.feet[0], engine.planar)


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
        for t, want, where in (0.0, start, "start"), (duration, end, "end"):
            hint = (
                f"{where}: position, velocity, acceleration; c₀ comes first; is c₂ = a₀/2? the "
                "powers of D?"
            )
            got = [walk_engine.polynomial(splines, t, order) for order in range(3)]
            close(np.stack(got, -1), want, hint)


@BOTH
def test_trunk_is_smooth_and_feet_stay_across_double_steps(sim):
    engine, rng, dt = make_engine(sim), default_rng(3), ROBOT.control_dt
    plans = [engine.plan(random_footsteps(rng, 1), [0]) for _ in range(6)]
    for first, second in zip(plans, plans[1:]):
        before, after = first.trunk[0], second.trunk[0]  # [T + 1, 6]
        hint = "a foot jumps: the next plan must start where this one ended"
        close(first.feet[0, -1], second.feet[0, 0], hint)
        # Each side of the seam is one quintic: a fit of degree 5 is exact.
        last = polyfit(dt * np.arange(-9, 1), before[-10:], 5)
        start = polyfit(dt * np.arange(10), after[:10], 5)
        hint = (
            "position, velocity or c₂ (rows) of x, y, z, roll, pitch, yaw (columns) jumps between double "
            "steps: the next spline starts with the state in which this one ended"
        )
        close(start[:3], last[:3], hint)
    standing = polyfit(dt * np.arange(10), plans[0].trunk[0, :10], 5)
    close(standing[1:3], 0, "a walk begins at rest: velocity or c₂ jumps there")
    torso, joints = engine.stance
    torso[0] += engine.parameters.trunk_x_offset  # where the simulator's frame begins
    close(plans[0].trunk[0, 0], torso, "as the robot stands")
    hint = "as the robot stands: its trunk is trunk_x_offset AHEAD of its feet"
    close(planned(engine, plans[0])[0], joints, hint)
    steady = make_engine(sim)
    for _ in range(3):
        plan = steady.plan([[[0.08, 0, 0]] * 2], [0])
    hint = "equal double steps: the trunk keeps its speed, and expects no stop after them"
    close(np.diff(plan.trunk[0, :, 0], 2), 0, hint)


@pytest.mark.parametrize("phase", [0.0, 0.25, -0.25])
def test_trunk_passes_its_knots_between_the_feet(phase):
    engine = make_engine("mujoco", step_ticks=28, trunk_phase=phase)
    p, (left, right) = engine.parameters, engine.foot_poses[0].copy()
    trunk = engine.plan([[[-0.08, 0.03, -0.2], [0.06, 0.01, -0.1]]], [0]).trunk[0]  # [T + 1, 6]
    new_left, new_right = engine.foot_poses[0]
    steps = (right, left, new_left), (new_left, right, new_right)
    for k, (support, start, landing) in enumerate(steps):
        tick = round((k + 0.5 + phase) * p.step_ticks)  # the very tick of the knot
        x, y, z, roll, pitch, yaw = trunk[tick]
        before, after = (support + start) / 2, (support + landing) / 2
        centre = (before + after) / 2
        hint = "trunk_roll towards the SUPPORT foot: a positive roll leans to the right"
        want = p.trunk_height, (1, -1)[k] * p.trunk_roll, p.trunk_pitch
        close((z, roll, pitch), want, hint)
        close(yaw, centre[2], "the yaw of the middle, half way")
        ahead, aside, _ = robot_model.relative(centre, np.array([x, y, yaw]))
        hint = "half way the trunk is between the feet, and x_offset AHEAD of their middle"
        close(ahead, p.trunk_x_offset, hint)
        towards = robot_model.relative(centre, support)[1]
        hint = f"sideways a share of the distance to the SUPPORT foot, at {towards:.3f} m"
        close(aside, p.trunk_swing * towards, f"knot {k + 1}: {hint}")
        # From knot to knot it is one quintic: a fit of degree 5 is exact.
        near = np.arange(10) if k == 0 else np.arange(-9, 1)
        c = polyfit(near * ROBOT.control_dt, trunk[tick + near], 5)
        velocity = (after - before) / engine.step_time
        close(c[1, [0, 1, 5]], velocity, "with the mean velocity of the step")
        close(c[1, 3:5], 0, "there the lean turns back")
        close(c[2], 0, "it passes unaccelerated", atol=1e-5)


def test_reflex_adds_its_gain_times_the_error_to_the_ankle_that_stands():
    p, limit = replace(LAW, reflex=0.1), walk_engine.REFLEX_LIMIT
    error = np.array([[0.6, 0.8], [0.3, -99], [99, -0.1]])  # [rad/s] of roll, pitch
    swings = np.array([[True, False], [False, True], [True, False]])
    frozen(error, swings)
    added = walk_engine.reflex(error, swings, p)
    assert np.shape(added) == (3, 12), "[n, 12]: the left leg's six joints, then the right leg's"
    legs = np.reshape(added, (3, 2, 6))
    close(legs[swings], 0, "which foot? The one that swings gets 0, the other one the reflex")
    stands = legs[~swings]  # [3, 6]
    close(
        stands[:, :4], 0, "which joints? Only the ankle's: pitch is joint 4 of a leg, roll joint 5"
    )
    roll, pitch = stands[:, 5], stands[:, 4]
    small = np.array([roll[0], pitch[0], roll[1], pitch[2]])  # below the limit
    want = np.array([0.06, 0.08, 0.03, -0.01])
    axes = "which axis? x of the error goes to the roll, y to the pitch"
    assert not np.allclose(small[:2], want[1::-1]), axes
    close(np.sign(small), np.sign(want), "which sign? The ankle turns as the torso turns")
    close(small, want, "how much? `p.reflex` [s] times the error [rad/s], and only then limited")
    hint = "which limit? ± REFLEX_LIMIT of what is ADDED, not of the error, and to both sides"
    close([pitch[1], roll[2]], [-limit, limit], hint)


ZERO = 0, 0, 0
# Lean beyond the plan (roll, pitch), over the support foot; which foot swings; the answer before;
# the answer: left foot, right foot; to the left [m], roll, pitch [rad]
ANSWERS = {
    "a lean within usual_lean is not answered": (
        (0.03, -0.02), 0.03, "left", ZERO, (ZERO, ZERO)),
    "a quarter of the share `capture` of what is beyond ± usual_lean; to the swing side no shift": (
        (-0.13, 0.08), -0.13, "left", ZERO, ((0, -0.02, 0.01), ZERO)),
    "to the side of the support foot it lands beside it as planned: h·e to the left for a positive "
    "roll": ((0.13, -0.08), 0.13, "left", ZERO, ((0.008, 0.02, -0.01), ZERO)),
    "of the right foot likewise; a shift keeps the sign of the roll": (
        (-0.13, 0.0), 0.13, "right", ZERO, (ZERO, (-0.008, -0.02, 0))),
    "a swing foot goes a share `follow` of the way from where it was; a standing one's answer fades "
    "by `fade`": (
        (0.03, 0.13), 0.03, "right", (0.01, 0.1, 0.2), ((0.009, 0.09, 0.18), (0.0075, 0.075, 0.17))),
}  # fmt: skip


def test_capture_step_moves_the_swing_foot_by_the_lean():
    error, over, foot, old, want = zip(*ANSWERS.values())
    error, over, old = np.array(error), np.array(over), np.repeat(old, 2, 0).reshape(-1, 2, 3)
    swings = np.array(foot)[:, None] == ["left", "right"]
    frozen(error, over, swings, old)
    got = walk_engine.capture_step(error, over, swings, old, LAW)
    assert np.shape(got) == old.shape, "robots; left, right foot; y, roll, pitch"
    for hint, answer, one in zip(ANSWERS, got, want):
        close(answer, one, hint, atol=1e-12)
    off = walk_engine.capture_step(error, over, swings, 0 * old, replace(LAW, capture=0.0))
    close(off, 0, "capture = 0: no answer")


def test_waiting_pace_slows_the_plan_down_while_the_robot_leans_over_its_support_foot():
    over = np.array([-1.0, 0.0, 0.05, 0.10, 0.16, 0.5])
    frozen(over)
    want = [1, 1, 1, 0.6, 0.12, 0]
    got = walk_engine.waiting_pace(over, LAW)
    close(got, want, "1 − wait·(over − late_lean): never above 1, never below 0", atol=1e-12)
    close(walk_engine.waiting_pace(over, replace(LAW, wait=0.0)), 1, "wait = 0: never")


def followed(plan, lean=0.0):
    """Asks the plan of one robot, up to its end, for joint targets [T, 12]. The robot turns as planned.
    Until its left foot lands it leans to the right by so much [rad] more than planned."""
    half = plan.ticks // 2
    rates = np.diff(plan.trunk[0, :, 3:5], axis=0) / plan.engine.robot.control_dt  # [T, 2]
    answers = []
    for tick in range(plan.ticks):
        roll, pitch = plan.trunk[0, tick, 3:5]
        imu = np.array([[roll + lean * (tick < half), pitch, *rates[tick]]])
        answers.append(plan.go_on(np.array([0]), tick, imu)[0][0])
    return answers


@BOTH
def test_a_plan_that_nobody_disturbs_is_the_same_with_and_without_the_law(sim):
    """Also of a robot with another control_dt."""
    for longer, capture, reflex, wait in (0, 0.0, 0.0, 0.0), (40, 1.0, 0.05, 10.0):
        robot = replace(ROBOT, control_dt=0.02)
        engine = make_engine(sim, 1, robot, capture=capture, reflex=reflex, wait=wait)
        for _ in range(2):
            plan = engine.plan([[[0.08, 0, 0.1], [0.08, 0.05, 0]]], [0])
            most = 2 * engine.parameters.step_ticks + longer
            assert plan.most_ticks == most, "a double step may wait for longest_wait_ticks"
            close(followed(plan), planned(engine, plan)[1:], "a planned lean or rate is no error")


def test_progress_advances_by_the_pace_and_the_trunk_moves_as_planned():
    """Nearly to its end robots lean over their support foot, by more or less."""
    half = walk_engine.TUNED["mujoco"].step_ticks
    whole, until = 2 * half, 2 * half - 3  # [ticks]
    pace = np.array([1, 1, 0.6, 0.25, 0])
    engine = make_engine("mujoco", 5, capture=0.0, reflex=0.0, wait=10.0, late_lean=0.06)
    plan = engine.plan(np.tile([0.06, 0, 0.1], (5, 2, 1)), np.arange(5))
    ground = plan.trunk[..., robot_model.GROUND]  # [5, T + 1, 3]
    place = ground[:, 0]
    for tick in range(whole + 40):
        rows = np.flatnonzero(plan.progress < whole)
        sample = plan.progress[rows].astype(int)
        over = np.array([-0.3, 0, 0.1, 0.135, 0.2])[rows] * (tick < until)
        imu = plan.trunk[rows, sample][:, [3, 4, 3, 4]]
        imu[:, 0] += np.where(sample < half, over, -over)
        _, move = plan.go_on(rows, tick, imu)
        place[rows] = robot_model.compose(place[rows], move)
        time = tick + 1
        want = pace * min(time, until) + max(time - until, 0)
        hint = "a sum of paces, but at most 40 ticks late, and no more than the plan has"
        close(plan.progress, np.clip(want, time - 40, whole), f"after {time} ticks: {hint}")
    close(place, ground[:, -1], "each move is seen from where the trunk was")


def test_the_foot_lands_where_the_robot_leans_but_never_close_to_the_other_one():
    """The right foot stands, the robot faces left (along y), and leans to its left or right."""
    for lean, share in (-0.14, 1), (0.14, 0):
        engine = make_engine("mujoco", capture=1.0, wait=0.0, reflex=0.0)
        p = engine.parameters
        last = p.step_ticks - 1  # [ticks] the left foot is about to land
        engine.foot_poses[0] = robot_model.compose(
            np.array([0, 0, np.pi / 2]), engine.foot_poses[0]
        )
        engine.trunk_state[0, [0, 1, 5], 0] = 0, p.trunk_x_offset, np.pi / 2
        plan = engine.plan(np.zeros((1, 2, 3)), [0])
        joints = followed(plan, lean)[last - 1]
        # The robot leans as a whole, about its right foot. Where will the left one land?
        trunk, pivot = plan.trunk[0, last].copy(), plan.feet[0, last, 1, :3]
        trunk[:3] = pivot + robot_model.rotation(0, lean, 0) @ (trunk[:3] - pivot)
        trunk[3] += lean
        points, turns = robot_model.link_frames(ROBOT, trunk, joints)
        most = p.trunk_height * (0.14 - p.usual_lean)
        aside = plan.feet[0, last, 0, 0] - points[4, 0]
        hint = f"{1000 * aside:.0f} mm farther to the left: h·e is {1000 * most:.0f} mm"
        close(aside, share * most, hint, atol=0.1 * most)
        close(turns[4, 2, 1], np.sign(lean) * p.usual_lean, "its sole is nearly level", atol=0.01)
        equal(engine.answer[0, 1], 0, "the right foot stood all the time that the robot leaned")


def test_the_answer_of_a_foot_goes_on_in_the_next_double_step():
    engine = make_engine("mujoco", 2, capture=1.0)
    engine.answer[1] = 0.02, 0.05, 0.03
    for robots in ([0, 1], [1]):  # also if the rows of the plan are not all robots
        before, row = engine.answer.copy(), np.array([len(robots) - 1])
        plan = engine.plan(np.zeros((len(robots), 2, 3)), robots)
        plan.go_on(row, 0, plan.trunk[row, 0][:, [3, 4, 0, 0]])
        keeps = 1 - engine.parameters.fade
        hint = "a standing foot snaps back: the next plan begins with the answer of the last one"
        close(engine.answer[1, 1], keeps * before[1, 1], hint)
        equal(engine.answer[0], 0, "of this robot only")
    engine.reset([1])
    equal(engine.answer, 0, "a reset forgets it")


@BOTH
def test_all_zero_footsteps_step_on_the_spot(sim):
    engine = make_engine(sim)
    p, half = engine.parameters, engine.parameters.step_ticks
    stands = [[0, p.foot_distance / 2, 0], [0, -p.foot_distance / 2, 0]]
    for _ in range(4):
        plan = engine.plan(np.zeros((1, 2, 3)), [0])
        (feet,) = plan.feet  # [T + 1, 2, 4]
        hint = "zeros: each foot lands where it was; x, y and yaw (columns 0, 1 and 3)"
        close(feet[..., [0, 1, 3]] - stands, 0, hint)
        left, right = feet[..., 2].T  # [T + 1] each
        close(right[: half + 1], 0, "the left foot swings first, the right one stands: z = 0")
        close(left[half:], 0, "then the left one stands: it has landed at height 0")
        close(right[half:], left[: half + 1], "the right foot rises and lands as the left one did")
        ahead = plan.trunk[0, :, 0] - p.trunk_x_offset
        assert np.all(np.abs(ahead) < 0.02), "the trunk stays above the feet"


def test_swing_foot_waits_rises_and_lands_at_rest():
    engine = make_engine("mujoco", step_ticks=31, double_support=0.08)  # for 2.5 ticks
    p, start = engine.parameters, engine.foot_poses[0, 0].copy()
    feet = engine.plan([[[0.1, 0.02, 0.2], [0.1, 0.0, 0.0]]], [0]).feet
    left = feet[0, : p.step_ticks + 1, 0]  # [K, 4]
    time = np.linspace(0, 1, p.step_ticks + 1)  # of the single step
    time = np.clip((time - p.double_support) / (1 - p.double_support), 0, 1)  # of the swing

    def smooth(time):
        """From 0 to 1 and from rest to rest, at both ends without acceleration."""
        return 10 * time**3 - 15 * time**4 + 6 * time**5

    close(
        left[:, [0, 1, 3]],
        start + np.outer(smooth(time), engine.foot_poses[0, 0] - start),
        "x, y and yaw (columns 0, 1 and 3) wait for double_support · half, not rounded to ticks, then "
        "go from rest to rest, and at both ends without acceleration: is it a quintic?",
    )
    close(
        left[:, 2],
        p.foot_rise * smooth(2 * np.minimum(time, 1 - time)),
        "z: on the ground, 0, in the double support; in the first half of the swing by a quintic up to "
        "foot_rise, in the second half down to 0, at rest: is the descent the ascent backwards?",
    )


@BOTH
def test_plans_of_many_robots_equal_single_plans(sim):
    rng, n = default_rng(4), 5
    many, single = make_engine(sim, n), [make_engine(sim) for _ in range(n)]
    for robots in (np.arange(n), [3, 1], np.arange(n)):
        footsteps = random_footsteps(rng, len(robots))
        got = many.plan(footsteps, robots)
        for row, i in enumerate(robots):
            want = single[i].plan(footsteps[row : row + 1], [0])
            for name in ("trunk", "feet"):
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
        close(engine.foot_poses[0], landed, "the engine remembers where they are")


@BOTH
def test_moves_on_is_where_the_trunk_goes_when_the_walk_stops(sim):
    middle = dict.fromkeys(("trunk_phase", "trunk_x_offset", "trunk_swing"), 0.0)
    engine, robots = make_engine(sim, 50, **middle), np.arange(50)
    steps = random_footsteps(default_rng(6), 50)
    engine.plan(steps, robots)
    before = engine.plan(steps, robots).trunk[:, -1, robot_model.GROUND]
    moves_on = engine.closing_step(robots)  # [50, 3]
    for _ in range(3):
        stopping = engine.plan(np.zeros((50, 2, 3)), robots)
    want = robot_model.relative(before, stopping.trunk[:, -1, robot_model.GROUND])
    hint = "the left foot lands beside the right one, where that one's toes point"
    close(moves_on, want, hint, atol=0.005)  # [m, m, rad]


@BOTH
def test_it_walks_what_is_commanded(sim):
    plans = [[double_step] * 8 for double_step in WALKS.values()]
    poses, wanted, fall = walk_engine.walk_plans(sim, walk_engine.TUNED[sim], plans)
    equal(fall, 8, f"a fall in one of {', '.join(WALKS)}")
    ends = (0, 1.24), (0, -0.93), (1, 0.48), (2, 2.325)  # along this axis [m or rad]
    for what, (axis, end), got, goal in zip(WALKS, ends, poses[:, -1], wanted[:, -1]):
        hint = "after a double step the left foot is behind the right one by the right one's step"
        close(goal[axis], end, f"{what}: {hint}")
        close(got[axis], end, f"{what}: it walks something else", rtol=0.2)
        assert (np.abs(got - goal)[:2] < 0.25).all(), f"{what}: drifts from {goal} to {got}"


@BOTH
def test_a_walk_ends_with_its_fall_and_the_others_go_on(sim):
    plans = np.tile([0.05, 0, 0.1], (3, 5, 2, 1))
    plans[1, 1:] = [0.4, 0, 0]
    seen, ends = [], []
    walk = partial(walk_engine.walk_plans, sim, walk_engine.TUNED[sim])

    def watch(engine, plan, motion):
        seen.append([*plan.robots])
        ends.append(motion.torso[0, -1, robot_model.GROUND])

    poses, wanted, fall = walk(plans, watch=watch)
    assert fall[1] in (1, 2, 3), "steps of 0.4 m are longer than a leg: it should fall"
    k = fall[1] + 1
    assert seen == [[0, 1, 2]] * k + [[0, 2]] * (5 - k), "only who is up walks on"
    close(poses[0, 1:], ends, "where the robot stands, and not where it should")
    assert (poses[1, k:] == poses[1, k]).all(), "a walk ends with its fall"
    for got, want in zip((poses, wanted, fall), walk(plans[[0, 2]])):
        equal(got[[0, 2]], want, "a fall changes another walk")


@BOTH
def test_a_walk_is_that_of_the_body_and_of_the_robot_that_are_given(sim):
    walk = partial(walk_engine.walk_plans, sim, walk_engine.TUNED[sim], [[WALKS["forward"]] * 2])
    ice = replace(robot_model.Variation.as_model(ROBOT, 1), friction=0.1)
    (usual, *_), (slips, *_) = walk(), walk(variation=ice)
    apart = np.abs(usual - slips).max()  # [m]
    assert apart > 0.001, "`body` reaches nobody: on ice the robot slips"
    equal(walk(robot=replace(ROBOT, friction=0.1))[0], slips, "`robot` is another one than ours")


@IN_3D_SLOW
def test_pushes_during_a_walk_make_fewer_robots_fall_with_the_reflex(sim):
    walk = replace(walk_engine.TUNED[sim], capture=0.0, wait=0.0)
    # With these pushes 0 of 48 robots fall with the reflex, without it 12 (2-D) and 30 (3-D).
    speed, count = (0.8, 24) if sim == "pymunk" else (0.6, 12)
    tilts, fell = walk_engine.pushed(sim, walk, speed, count)
    _, blind_fell = walk_engine.pushed(sim, replace(walk, reflex=0.0), speed, count)
    (calm, _), calm_fell = walk_engine.pushed(sim, walk, 0.0, count=2)
    assert not calm_fell.any(), "without a push nobody falls: is a sign of the reflex wrong?"
    same = [sum(np.isclose(a, b, 0, 1e-9) for a, b in zip(one, calm)) for one in tilts]
    assert len({*same}) == count, f"each is pushed at another moment: {same}"
    hint = f"all in the second double step, k = 1: {same}"
    assert min(same) >= 2 * walk.step_ticks and max(same) < 4 * walk.step_ticks, hint
    falls, blind_falls = fell.sum(), blind_fell.sum()
    assert falls < blind_falls, f"{falls} fall with the reflex, {blind_falls} without it"


def test_a_plan_that_is_followed_is_drawn_twice_at_the_same_place(shown):
    engine = make_engine("mujoco")
    plan = engine.plan([WALKS["forward"]], [0])
    torso = plan.trunk[:, 1:] - [engine.parameters.trunk_x_offset, 0, 0, 0, 0, 0]
    motion = robot_model.Motion(torso, planned(engine, plan)[None, 1:], [False], [plan.ticks])
    walk_engine.plot_plan(engine, plan, motion, "")
    for axes in shown[0].axes:
        lines = axes.lines
        styles = [line.get_linestyle() for line in lines]
        assert styles == ["-"] * 3 + ["--"] * 3, "solid as planned, dashed as measured"
        for wished, measured in zip(lines[:3], lines[3:]):
            hint = "the measured curve is that of the plan, from its first tick on"
            close(measured.get_xydata(), wished.get_xydata()[1:], hint)


def test_a_tilt_is_drawn_until_the_robot_has_fallen_and_in_red(shown):
    """Near 90° roll and pitch turn over: a robot that lies would seem to stand up."""
    stands, falls = np.full(5, 0.1), np.array([0.1, 0.5, 1.5, 0.2, 0.1])  # [rad]
    walked = [stands, falls], np.array([False, True])
    walk_engine.plot_push({"reflex": walked, "again": walked}, make_engine("mujoco"), "")
    lines = shown[0].axes[0].lines
    for line, want, color in zip(lines, (stands, falls[:2]), ("0.5", "tab:red"), strict=True):
        close(line.get_ydata(), np.degrees(want), "up to 45°, no more")
        assert line.get_color() == color, "red is who falls"


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
    hint = (
        "its distance along its axis, from its first pose on, by the time of all double steps that "
        "are not on the spot: sum(PATTERN) · period, not len(PATTERN) · period"
    )
    close(walk.highest_speed(poses, fall, period=0.5)["forward"], 1 / moving, hint)
    fall[4::levels] = 2  # level 5 falls
    for i, (direction, speed) in enumerate(walk.highest_speed(poses, fall, period=0.5).items(), 1):
        hint = (
            f"{direction}: of eight levels the third is the fastest below the first one that "
            "fell, and not the last one that stood; a distance has no sign"
        )
        close(speed, i * ways[2] / moving, hint)


def test_the_stage_prints_what_was_commanded_then_what_was_walked(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("sys.argv", ["02_walk_engine.py", "--out", str(tmp_path)])
    ends = np.full((4, 9, 3), 2.0), np.full((4, 9, 3), 1.0), [8, 8, 8, 3]
    monkeypatch.setattr(walk_engine, "walk_plans", lambda *_: ends)
    pushed = mock.Mock(return_value=([[0.1]], np.array([False])))
    monkeypatch.setattr(walk_engine, "pushed", pushed)
    walk_engine.main()
    said = " ".join(capsys.readouterr().out.split())
    assert "a left turn 1.00 1.00 1.00 2.00 2.00 2.00 yes" in said, "yes: it fell, after three"
    laws = [call.args[1] for call in pushed.mock_calls]
    answers = [(law.reflex > 0, law.capture > 0) for law in laws]
    assert answers == [(0, 0), (1, 0), (1, 1)], "open loop, reflex, capture steps, too"
