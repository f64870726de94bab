"""Stage 1, checked against physics: the kinematics against MuJoCo's own, both simulators against
the numbers of the robot model and against each other. A failing test names the likely mistake."""

import math
import time
from importlib import import_module

import mujoco
import numpy as np
import pymunk
import pytest

robot_model = import_module("01_robot_model")
walk_engine = import_module("02_walk_engine")

ROBOT = robot_model.RobotModel()
BOTH = pytest.mark.parametrize("name", ["pymunk", "mujoco"])
FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS


@pytest.fixture
def make_sim(tmp_path, monkeypatch):
    """make_sim(name, N, ...): a simulator whose robots stand; closed after the test."""
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warnings into the current folder
    made = []

    def make(name, num_robots=1, cores=1, joints=None):
        sim = robot_model.SIMULATORS[name](num_robots, joints, ROBOT, cores)
        made.append(sim)
        sim.reset(np.arange(num_robots))
        return sim

    yield make
    for sim in made:
        sim.close()


def standing(sim, seconds, robots=None):
    """Let robots stand; returns their Motion."""
    robots = np.arange(sim.num_robots) if robots is None else np.asarray(robots)
    joints = robot_model.stance(ROBOT, planar=sim.planar)
    n, ticks = len(robots), round(seconds / ROBOT.control_dt)
    still = robot_model.Trajectory(np.tile(joints, (n, ticks + 1, 1)),
                                   np.zeros((n, ticks + 1, 6)), np.zeros((n, ticks + 1, 2, 4)))
    return sim.run(still, robots)


def pieces(trajectory, ticks=1):
    """The same trajectory as a list of short ones, to look at the robot in between."""
    total = trajectory.joints.shape[1] - 1
    return [robot_model.Trajectory(*(a[:, k : k + ticks + 1] for a in (
        trajectory.joints, trajectory.trunk, trajectory.feet))) for k in range(0, total, ticks)]


def walking(name, num_robots, footsteps, count):
    """Trajectories of `count` equal double steps from standing, and the stance to start from."""
    engine = walk_engine.WalkEngine(num_robots, walk_engine.TUNED[name], ROBOT, name == "pymunk")
    footsteps = np.tile(np.array(footsteps, float), (num_robots, 1, 1))
    everybody = np.arange(num_robots)
    return [engine.plan(footsteps, everybody)[0] for _ in range(count)], engine.stance


def quaternion(roll, pitch, yaw):
    """(w, x, y, z) of Rz(yaw)·Ry(pitch)·Rx(roll), by MuJoCo."""
    result = np.array([1.0, 0, 0, 0])
    for axis, angle in (([0, 0, 1.0], yaw), ([0, 1.0, 0], pitch), ([1.0, 0, 0], roll)):
        turn = np.zeros(4)
        mujoco.mju_axisAngle2Quat(turn, np.array(axis), angle)
        mujoco.mju_mulQuat(result, result.copy(), turn)
    return result


# ---------------------------------------------------------------- kinematics
def random_joints(rng, count):
    """Joint angles [count, 12] inside the limits, knees bent, hips above the soles."""
    low = np.array([-1.0, -0.6, -1.2, 0.05, -1.2, -0.6])
    high = np.array([1.0, 0.6, 0.6, 2.2, 0.3, 0.6])
    assert (low >= ROBOT.joint_min).all() and (high <= ROBOT.joint_max).all()
    return rng.uniform(np.tile(low, 2), np.tile(high, 2), (count, 12))


def test_forward_kinematics_equals_mujoco():
    model = mujoco.MjModel.from_xml_string(robot_model.mjcf(ROBOT))
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    for joints in random_joints(rng, 50):
        torso = np.concatenate([rng.normal(size=3), rng.uniform(-1.2, 1.2, 3)])
        data.qpos[:3], data.qpos[3:7] = torso[:3], quaternion(*torso[3:])
        data.qpos[7:] = joints
        mujoco.mj_forward(model, data)
        points, yaws = robot_model.body_points(ROBOT, torso, joints)  # [2, 5, 3], [2]
        for leg, (side, sign) in enumerate((("left", 1), ("right", -1))):
            for k, part in enumerate(("hip", "shin", "foot")):  # a body sits at its upper joint
                np.testing.assert_allclose(points[leg, k], data.body(f"{side} {part}").xpos,
                                           atol=1e-9, err_msg=(
                    f"{side} {part}: sign of a pitch, or order of hip yaw and roll?"))
            sole, foot = data.geom(f"{side} sole"), data.body(f"{side} foot")
            length, _, thick = model.geom(f"{side} sole").size
            for k, x in ((3, -length), (4, length)):  # heel, toe: below the ankle's axis
                corner = [x, -sign * ROBOT.foot_outward, -thick]
                want = sole.xpos + sole.xmat.reshape(3, 3) @ corner
                np.testing.assert_allclose(points[leg, k], want, atol=1e-9, err_msg=(
                    "heel or toe: foot_front and foot_back swapped, or the ankle's height?"))
            want = math.atan2(foot.xmat[3], foot.xmat[0])
            assert robot_model.wrap(yaws[leg] - want) == pytest.approx(0, abs=1e-9)


def test_euler_angles_are_the_inverse_of_rotation():
    angles = np.random.default_rng(1).uniform(-1.4, 1.4, (50, 3)) * [2, 1, 2]
    for roll, pitch, yaw in angles:
        q = quaternion(roll, pitch, yaw)
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, q)
        got = robot_model.rotation(np.array(roll), np.array(pitch), np.array(yaw))
        np.testing.assert_allclose(got, matrix.reshape(3, 3), atol=1e-9)
        np.testing.assert_allclose(robot_model.euler(q), (roll, pitch, yaw), atol=1e-9)


def test_leg_inverse_undoes_forward():
    joints = random_joints(np.random.default_rng(2), 500).reshape(-1, 6)
    points, foot = robot_model.leg_points(ROBOT, joints)
    got, reachable = robot_model.leg_inverse(ROBOT, points[:, 2], foot)
    assert reachable.all(), "every one of these poses was made by the leg itself"
    np.testing.assert_allclose(got, joints, atol=1e-6, err_msg=(
        "does the knee bend the other way, or is an arctan2 turned round?"))


def test_body_inverse_puts_the_feet_where_they_should_be():
    rng, n = np.random.default_rng(3), 200
    trunk = rng.uniform([-1, -1, 0.36, -0.1, -0.1, -3], [1, 1, 0.39, 0.1, 0.2, 3], (n, 6))
    away = rng.uniform([-0.05, 0.07, 0, -0.3], [0.05, 0.11, 0.03, 0.3], (n, 2, 4))
    away[:, 1, 1] *= -1
    feet, cos, sin = away.copy(), np.cos(trunk[:, None, 5]), np.sin(trunk[:, None, 5])
    feet[..., 0] = trunk[:, None, 0] + cos * away[..., 0] - sin * away[..., 1]
    feet[..., 1] = trunk[:, None, 1] + sin * away[..., 0] + cos * away[..., 1]
    feet[..., 3] += trunk[:, None, 5]
    joints, reachable = robot_model.body_inverse(ROBOT, trunk, feet)
    assert reachable.all()
    points, yaw = robot_model.body_points(ROBOT, trunk, joints)
    sole = feet[..., None, 2] * np.ones(2)
    np.testing.assert_allclose(points[..., 3:, 2], sole, atol=1e-9, err_msg="soles must be level")
    np.testing.assert_allclose(points[..., 2, :2], feet[..., :2], atol=1e-9)
    np.testing.assert_allclose(robot_model.wrap(yaw - feet[..., 3]), 0, atol=1e-9)


def test_a_pose_out_of_reach_is_pulled_to_the_nearest_one():
    flat, longest = np.eye(3), ROBOT.thigh_length + ROBOT.shin_length
    for position in ([0, 0, -0.5], [0.1, 0.05, -0.4], [-0.05, -0.02, -9.0]):
        joints, reachable = robot_model.leg_inverse(ROBOT, np.array(position), flat)
        assert not reachable, f"{position} m is further than the leg is long"
        ankle = robot_model.leg_points(ROBOT, joints)[0][2]
        want = np.array(position) / np.linalg.norm(position) * longest
        np.testing.assert_allclose(ankle, want, atol=1e-6, err_msg=(
            "too far: a straight leg pointing at the wish is the nearest pose"))
    near = np.array([0, 0, -0.02])
    joints, reachable = robot_model.leg_inverse(ROBOT, near, flat)
    assert not reachable and joints[3] == pytest.approx(ROBOT.joint_max[3]), (
        "too near: the knee bends as far as it can")


def test_inverse_never_returns_nan_and_never_leaves_the_joint_limits():
    rng = np.random.default_rng(4)
    position = rng.normal(size=(2000, 3)) * 0.4
    position[0] = 0.0  # the ankle in the hip: no direction to pull along
    angles = rng.uniform(-3, 3, (3, 2000))
    joints, reachable = robot_model.leg_inverse(ROBOT, position, robot_model.rotation(*angles))
    assert np.isfinite(joints).all(), "arccos and arcsin need their argument clipped to ±1"
    assert (joints >= ROBOT.joint_min).all() and (joints <= ROBOT.joint_max).all()
    ankle = robot_model.leg_points(ROBOT, joints)[0][:, 2]
    there = np.linalg.norm(ankle - position, axis=-1) < 1e-6
    assert 5 < reachable.sum() < 1500, "the test should contain both kinds of poses"
    assert there[reachable].all(), "reported as reachable, but the ankle is elsewhere"


# ---------------------------------------------------------------- one robot model
def test_mass_and_its_centre_are_the_same_everywhere(make_sim):
    sim = make_sim("pymunk")
    model = mujoco.MjModel.from_xml_string(robot_model.mjcf(ROBOT))
    space, _ = sim._local._build()
    planar = sum(body.mass for body in space.bodies)
    assert model.body_mass.sum() == pytest.approx(ROBOT.mass), "MuJoCo adds the mass of geoms?"
    assert planar == pytest.approx(ROBOT.mass), "are both hip motors in the planar torso?"
    data, torso = mujoco.MjData(model), robot_model.standing_torso(ROBOT, sim.start_joints)
    data.qpos[:3], data.qpos[3:7] = torso[:3], quaternion(*torso[3:])
    data.qpos[7:] = sim.start_joints
    mujoco.mj_forward(model, data)
    centre = sum(np.array(body.position) * body.mass for body in space.bodies) / planar
    np.testing.assert_allclose(centre, data.subtree_com[0][[0, 2]], atol=1e-9, err_msg=(
        "the same posture, but the masses are elsewhere in one simulator"))


def test_fall_means_half_the_height_or_45_degrees():
    upright = 1.0
    for height, cos, fell in ((0.41, upright, False), (0.19, upright, True), (0.21, upright, False),
                              (0.4, math.cos(math.radians(44)), False),
                              (0.4, math.cos(math.radians(46)), True), (0.1, 0.0, True)):
        assert bool(robot_model.fallen(height, cos, 0.4)) == fell, (
            f"height {height} m of 0.4 m, tilt {math.degrees(math.acos(cos)):.0f}°")


# ---------------------------------------------------------------- standing and falling
@BOTH
def test_robot_stands_and_falls_without_its_motors(make_sim, name):
    sim = make_sim(name, 2)
    joints = robot_model.stance(ROBOT, planar=sim.planar)
    motion = standing(sim, 3.0)
    assert not motion.fell.any()
    sag = robot_model.standing_torso(ROBOT, joints)[2] - motion.torso[:, -1, 2]
    assert np.all(np.abs(sag) < 0.003), f"torso sags {1000 * sag} mm: motors too soft"
    assert np.all(np.abs(motion.pose) < 0.005), f"it should stay at the origin: {motion.pose}"
    np.testing.assert_allclose(motion.joints[:, -1], np.tile(joints, (2, 1)), atol=0.02)
    sim.power(False)
    limp = standing(sim, 3.0)
    assert limp.fell.all(), "without motors it cannot stand: does `power` reach the motors?"
    sim.power(True)
    sim.reset(np.arange(2))
    assert not standing(sim, 1.0).fell.any(), "motors on again after a reset: it should stand"


@BOTH
def test_fall_of_a_motion_follows_the_criterion(make_sim, name):
    sim = make_sim(name)
    sim.power(False)
    seen = []
    for _ in range(300):
        motion = standing(sim, ROBOT.control_dt)
        _, _, height, roll, pitch, _ = motion.torso[0, -1]
        tilt = math.cos(roll) * math.cos(pitch)
        seen.append((bool(motion.fell[0]), height < 0.5 * sim.standing_height or tilt < 0.7071))
    fell, want = np.array(seen).T
    assert want.any() and not want.all(), "the test should see the robot up and down"
    assert np.sum(fell != want) <= 1, "fall: half the standing height, or 45° of tilt"


# ---------------------------------------------------------------- friction
def test_mujoco_foot_slides_with_the_friction_of_the_model(make_sim):
    sim = make_sim("mujoco")
    model, data = sim.model, mujoco.MjData(sim.model)
    for velocity in ((1.0, 0.0), (0.0, 1.0)):
        mujoco.mj_setState(model, data, sim._state[0], FULL)
        data.qvel[:2], data.ctrl[:] = velocity, sim._control[0]
        momentum, steps = [], 8
        for _ in range(steps + 1):
            mujoco.mj_forward(model, data)
            mujoco.mj_subtreeVel(model, data)
            momentum.append(data.subtree_linvel[0].copy())  # per mass: v of the centre [m/s]
            mujoco.mj_step(model, data)
        change = momentum[-1] - momentum[0]
        seconds = steps * ROBOT.physics_dt
        # ∫ horizontal force / ∫ vertical force = μ; that the robot rocks does not matter.
        mu = np.linalg.norm(change[:2]) / (change[2] + ROBOT.gravity * seconds)
        assert mu == pytest.approx(ROBOT.friction, rel=0.05), (
            f"sliding along {velocity}: μ = {mu:.3f}; two geoms' values combined by a maximum?")
        braking = np.linalg.norm(change[:2]) / seconds
        assert braking == pytest.approx(4.905, rel=0.3), "μ·g, give or take the rocking"


def test_planar_foot_slides_with_the_friction_of_the_model(make_sim):
    space, _ = make_sim("pymunk")._local._build()

    def velocity():  # of the centre of mass
        return sum(np.array(body.velocity) * body.mass for body in space.bodies) / ROBOT.mass

    for _ in range(40):  # settle
        space.step(ROBOT.physics_dt)
    for body in space.bodies:
        body.velocity = 1.0, 0.0
    before, steps = velocity(), 8
    for _ in range(steps):
        space.step(ROBOT.physics_dt)
    change, seconds = velocity() - before, steps * ROBOT.physics_dt
    mu = -change[0] / (change[1] + ROBOT.gravity * seconds)
    assert mu == pytest.approx(ROBOT.friction, rel=0.05), (
        f"μ = {mu:.3f}; pymunk MULTIPLIES the friction of both shapes")


# ---------------------------------------------------------------- motors and joints
def separation(sim):
    """Largest gap between the two bodies of any joint now [m]."""
    joints = [joint for space in sim._local.spaces for joint in space.constraints]
    return max((p.a.local_to_world(p.anchor_a) - p.b.local_to_world(p.anchor_b)).length
               for p in joints if isinstance(p, pymunk.PivotJoint))


@pytest.mark.parametrize("yaw", [0.0, 0.3])
def test_planar_joints_stay_together_and_motors_keep_their_limits(make_sim, yaw):
    plans, stance = walking("pymunk", 2, [[0.1, 0, yaw], [0.1, 0, -yaw]], 5)
    sim = make_sim("pymunk", 2, joints=stance)
    limit, gap, torque, joints = np.tile(ROBOT.torque_limit, 2), 0.0, 0.0, []
    for piece in (piece for plan in plans for piece in pieces(plan)):
        motion = sim.run(piece, np.arange(2))
        gap, torque = max(gap, separation(sim)), np.maximum(torque, sim.torque())
        joints.append(motion.joints[:, -1])
    assert 1e-6 < gap < 0.002, f"{1000 * gap:.2f} mm apart: more solver iterations"
    assert np.all(torque <= limit + 1e-6), "does every motor have its max_force?"
    assert torque.max() > 3.0, "walking takes some N m: is the torque measured at all?"
    speed = np.abs(np.diff(joints, axis=0)).max((0, 1)) / ROBOT.control_dt
    assert np.all(speed < 1.1 * np.tile(ROBOT.speed_limit, 2)), (
        f"joint speeds {speed.round(1)} rad/s beyond what the motors can do")
    assert speed[3] > 1.0, "a knee that does not move is no walk"


def test_mujoco_motors_keep_torque_and_speed_limits(make_sim):
    plans, stance = walking("mujoco", 1, [[0.1, 0, 0.15], [0.1, 0, -0.15]], 5)
    sim = make_sim("mujoco", joints=stance)
    limit, data, joints = np.tile(ROBOT.torque_limit, 2), mujoco.MjData(sim.model), []
    for plan in plans:
        joints.extend(sim.run(plan, np.arange(1)).joints[0])
    speed = np.abs(np.diff(joints, axis=0)).max(0) / ROBOT.control_dt
    assert np.all(speed < 1.25 * np.tile(ROBOT.speed_limit, 2)), (
        f"joint speeds {speed.round(1)} rad/s beyond what the motors can do")
    # Far from its target a motor pushes with all it has, and at its speed limit with nothing.
    mujoco.mj_setState(sim.model, data, sim._start, FULL)
    for share in (0.0, 0.5, 1.0):
        data.ctrl[:] = data.qpos[7:] + 3.0
        data.qvel[6:] = share * np.tile(ROBOT.speed_limit, 2)
        mujoco.mj_forward(sim.model, data)
        torque = data.qfrc_actuator[6:] + data.qfrc_passive[6:]
        np.testing.assert_allclose(torque, (1 - share) * limit, atol=1e-6, err_msg=(
            "a motor's torque falls on a line to zero at its speed limit"))


@BOTH
def test_reported_torque_of_standing_carries_the_weight(make_sim, name):
    sim = make_sim(name)
    standing(sim, 1.0)
    torque = np.abs(sim.torque()[0])
    # Statics of one leg with half the weight above the ankle: F·(knee ahead of the foot's force)
    points = robot_model.body_points(ROBOT, np.zeros(6), sim.start_joints)[0]
    lever = np.abs(points[0, 1, 0] - points[0, [2, 0], 0]).max()
    most = ROBOT.mass * ROBOT.gravity / 2 * lever + 0.5
    for knee in (3, 9):
        assert 0.5 < torque[knee] < most, f"a knee: {torque[knee]:.1f} N m, at most {most:.1f}"
    assert abs(torque[3] - torque[9]) < 0.2, "both legs carry the same"


# ---------------------------------------------------------------- many robots
@BOTH
def test_reset_of_some_robots_leaves_the_others_alone(make_sim, name):
    plans, stance = walking(name, 3, [[0.06, 0, 0.05], [0.06, 0, -0.05]], 2)
    disturbed, quiet = make_sim(name, 3, joints=stance), make_sim(name, 3, joints=stance)
    everybody, others = np.arange(3), [0, 2]
    for sim in (disturbed, quiet):
        sim.run(plans[0], everybody)
    disturbed.reset([1])
    got, want = disturbed.run(plans[1], everybody), quiet.run(plans[1], everybody)
    np.testing.assert_array_equal(got.torso[others], want.torso[others], err_msg=(
        "robot 1 was reset, robots 0 and 2 felt it"))
    assert got.pose[1, 0] < want.pose[1, 0] - 0.03, "robot 1 starts at the origin again"
    fresh = make_sim(name, 3, joints=stance).run(plans[1], everybody)
    np.testing.assert_array_equal(got.torso[1], fresh.torso[1], err_msg=(
        "something of the last episode survives a reset"))


@BOTH
def test_robots_move_alike_whoever_else_moves(make_sim, name):
    plans, stance = walking(name, 3, [[0.06, 0, 0], [0.06, 0, 0]], 1)
    together, alone = make_sim(name, 3, joints=stance), make_sim(name, 3, joints=stance)
    want = together.run(plans[0], np.arange(3))
    one = robot_model.Trajectory(plans[0].joints[2:], plans[0].trunk[2:], plans[0].feet[2:])
    got = alone.run(one, np.array([2]))
    np.testing.assert_array_equal(got.torso[0], want.torso[2])
    np.testing.assert_array_equal(got.feet[0], want.feet[2])


@BOTH
@pytest.mark.parametrize("bad", [math.nan, 1e12])
def test_a_diverged_robot_counts_as_fallen_and_the_others_go_on(make_sim, name, bad):
    sim, healthy = make_sim(name, 3), make_sim(name, 3)
    if name == "mujoco":
        sim._state[1, 20] = bad  # forward velocity of the torso
    else:
        next(iter(sim._local.spaces[1].bodies)).velocity = bad, 0.0
    motion, want = standing(sim, 0.5), standing(healthy, 0.5)
    np.testing.assert_array_equal(motion.fell, [False, True, False], err_msg=(
        "a state that is not finite is a fall; comparisons with nan are always False"))
    for field in ("torso", "joints", "feet"):
        np.testing.assert_array_equal(getattr(motion, field)[[0, 2]], getattr(want, field)[[0, 2]])
    assert np.isfinite(motion.pose).all(), "the pose goes into rewards: it must stay finite"
    assert standing(sim, 0.1).fell[1], "still lost until its reset"
    sim.reset([1])
    again = standing(sim, 0.5)
    assert not again.fell.any() and np.isfinite(again.torso).all(), "a reset cures it"


# ---------------------------------------------------------------- worker processes
def test_planar_robots_in_two_processes_move_as_in_one(make_sim):
    plans, stance = walking("pymunk", 3, [[0.08, 0.02, 0.1], [0.08, 0, -0.1]], 2)
    one, two = make_sim("pymunk", 3, 1, stance), make_sim("pymunk", 3, 2, stance)
    assert len(two._processes) == 2 and one._local is not None
    for robots in (np.arange(3), np.array([0, 2])):
        part = robot_model.Trajectory(*(a[robots] for a in (
            plans[0].joints, plans[0].trunk, plans[0].feet)))
        got, want = two.run(part, robots), one.run(part, robots)
        for field in ("torso", "joints", "spin", "feet", "fell"):
            np.testing.assert_array_equal(getattr(got, field), getattr(want, field), err_msg=(
                f"{field}: are rows and robots matched after spreading them over workers?"))
    np.testing.assert_array_equal(two.torque(), one.torque())
    two.power(False)
    assert standing(two, 2.0).fell.all(), "motors off must reach every process"
    processes = list(two._processes)
    two.close()
    assert all(process.exitcode == 0 for process in processes), (
        f"close must end the workers: {[process.exitcode for process in processes]}")
    two.close()  # again is harmless


# ---------------------------------------------------------------- planar yaw
def quick_turn(sim, angle, seconds):
    """Yaw reached after a commanded turn at constant rate, and a second to come to rest."""
    ticks, total = round(seconds / ROBOT.control_dt), round((seconds + 1.0) / ROBOT.control_dt)
    trunk = np.zeros((1, total + 1, 6))
    trunk[0, :, 5] = angle * np.clip(np.arange(total + 1) / ticks, 0, 1)
    joints = np.tile(sim.start_joints, (1, total + 1, 1))
    still = robot_model.Trajectory(joints, trunk, np.zeros((1, total + 1, 2, 4)))
    return sim.run(still, np.arange(1)).pose[0, 2]


def test_planar_yaw_follows_a_gentle_turn_and_slips_in_a_sharp_one(make_sim):
    gentle = quick_turn(make_sim("pymunk"), 0.5, 0.5)
    assert gentle == pytest.approx(0.5, rel=0.1), f"gentle: {gentle:.2f} of 0.50 rad"
    sharp = quick_turn(make_sim("pymunk"), 1.0, 0.05)
    assert 0.0 < sharp < 0.6, (
        f"sharp: {sharp:.2f} of 1.00 rad. τ ≤ μ·N·r: friction cannot carry such a torque")
    # Accelerated by μ·N·r/I for as long as the command turns, then braked as long: τ/I·t².
    torque = ROBOT.friction * ROBOT.mass * ROBOT.gravity * make_sim("pymunk")._local.sole_radius
    most = torque / ROBOT.yaw_inertia * 0.05**2 + 2 * torque / ROBOT.yaw_stiffness
    assert sharp < most + 0.02, f"faster than friction allows: {sharp:.2f} rad, {most:.2f} rad"


def test_mean_radius_of_the_sole(make_sim):
    rng, robots = np.random.default_rng(0), make_sim("pymunk")._local
    size = (ROBOT.foot_front + ROBOT.foot_back, ROBOT.foot_width)
    points = rng.uniform(-0.5, 0.5, (200_000, 2)) * size
    want = np.hypot(*points.T).mean()
    assert robots.sole_radius == pytest.approx(want, rel=0.03), "r: mean over the whole sole"


def test_faster_solver_settings_do_not_change_the_physics(make_sim):
    """Cold or warm start: the solver must find the same contact forces (6 double steps)."""
    plans, stance = walking("mujoco", 1, [[0.08, 0.02, 0.1], [0.08, 0, -0.1]], 6)
    ends = []
    for flags in (None, 0):
        sim = make_sim("mujoco", joints=stance)
        if flags is not None:
            assert sim.model.opt.disableflags, "nothing is switched off: then why this test?"
            sim.model.opt.disableflags = flags
        ends.append([sim.run(plan, [0]).torso[0, -1] for plan in plans])
    np.testing.assert_allclose(*ends, atol=1e-3, err_msg=(
        "the flags in mjcf() are there to save time, not to change how the robot walks"))


@BOTH
def test_bare_seconds_are_a_part_of_the_wall_clock(make_sim, name):
    sim = make_sim(name, 2, cores=1)
    before, clock = sim.bare_seconds(), time.perf_counter()
    standing(sim, 1.0)
    took, bare = time.perf_counter() - clock, sim.bare_seconds() - before
    assert 0.1 * took < bare < took, "bare physics is what is left without our own code"
