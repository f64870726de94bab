"""Stage 1, checked against physics: the kinematics against MuJoCo's own, both simulators against
the numbers of the robot model and against each other. A failing test names the likely mistake."""

import math
import threading
from dataclasses import replace
from importlib import import_module

import mujoco
import numpy as np
import pymunk
import pytest

robot_model = import_module("01_robot_model")
walk_engine = import_module("02_walk_engine")

ROBOT = robot_model.RobotModel()
STEP = ROBOT.control_dt / ROBOT.substeps  # [s] of physics
LINKS = (ROBOT.torso, *2 * (ROBOT.hip, ROBOT.thigh, ROBOT.shin, ROBOT.foot))
MASS = sum(link.mass for link in LINKS)
BOTH = pytest.mark.parametrize("name", ["pymunk", "mujoco"])
FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS

@pytest.fixture
def make_sim(tmp_path, monkeypatch):
    """make_sim(name, N, ...): a simulator whose robots stand; closed after the test."""
    monkeypatch.chdir(tmp_path)  # where MuJoCo would write its log
    made = []

    def make(name, num_robots=1, cores=1, standing=None, robot=ROBOT):
        standing = standing or stance(name)
        made.append(robot_model.make_sim(name, num_robots, standing, robot, cores))
        return made[-1]

    yield make
    for sim in made:
        sim.close()

def stance(name):
    """Torso pose [6] and joints [12] from which a simulator starts."""
    return robot_model.stance(ROBOT, planar=name == "pymunk")

def still(name, num_robots, seconds):
    """A Trajectory of robots that are asked to stand."""
    ticks = round(seconds / ROBOT.control_dt)
    joints = np.tile(stance(name)[1], (num_robots, ticks + 1, 1))
    return robot_model.Trajectory(joints, np.zeros((num_robots, ticks + 1, 6)))

def leaning(name, angles, seconds):
    """A Trajectory that leans forward by these angles [N], minimum jerk, then stands for 2 s."""
    trajectory = still(name, len(angles), seconds + 2.0)
    tau = np.clip(np.arange(trajectory.joints.shape[1]) * ROBOT.control_dt / seconds, 0, 1)
    share = 10 * tau**3 - 15 * tau**4 + 6 * tau**5
    trajectory.joints[..., [4, 10]] -= (np.array(angles)[:, None] * share)[..., None]
    return trajectory

def planar_bodies(space):
    """The robot's seven, without the ground; the torso first."""
    return list(space.bodies)[1:]

def part(trajectory, robots=slice(None), ticks=slice(None)):
    """Some robots or some samples of a trajectory."""
    return robot_model.Trajectory(trajectory.joints[robots, ticks], trajectory.trunk[robots, ticks])

def single_ticks(trajectory):
    """The same trajectory as a list of short ones, to look at the robot in between."""
    total = trajectory.joints.shape[1] - 1
    return [part(trajectory, ticks=slice(k, k + 2)) for k in range(total)]

def walking(name, num_robots, footsteps, count, robot=ROBOT):
    """Trajectories of `count` equal double steps from standing, and the stance to start from.

    Later robots take shorter steps, so that a mix-up of robots shows.
    """
    engine = walk_engine.WalkEngine(num_robots, walk_engine.TUNED[name], robot, name == "pymunk")
    footsteps = np.linspace(1, 0.6, num_robots)[:, None, None] * footsteps  # [N, 2, 3]
    everybody = np.arange(num_robots)
    return [engine.plan(footsteps, everybody)[0] for _ in range(count)], engine.stance

def bodies(count, seed=0, **spread):
    """What `count` robots drew; whatever has no spread here is as in the model."""
    sizes = dict.fromkeys(("friction", "mass", "stiffness", "stiction", "delay"), 0) | spread
    rngs = np.random.default_rng(seed).spawn(count)
    return robot_model.Spread(**sizes).draw(rngs, ROBOT)

def quaternion(roll, pitch, yaw):
    """(w, x, y, z) of Rz(yaw)·Ry(pitch)·Rx(roll), by MuJoCo."""
    result = np.array([1.0, 0, 0, 0])
    for axis, angle in (([0, 0, 1.0], yaw), ([0, 1.0, 0], pitch), ([1.0, 0, 0], roll)):
        turn = np.zeros(4)
        mujoco.mju_axisAngle2Quat(turn, np.array(axis), angle)
        mujoco.mju_mulQuat(result, result.copy(), turn)
    return result

def matrix(roll, pitch, yaw):
    """Rz(yaw)·Ry(pitch)·Rx(roll), by MuJoCo."""
    result = np.zeros(9)
    mujoco.mju_quat2Mat(result, quaternion(roll, pitch, yaw))
    return result.reshape(3, 3)

def mujoco_at(torso, joints):
    """MuJoCo's model and data of a robot with this torso pose [6] and these joints [12]."""
    model = robot_model.mujoco_model(ROBOT)
    data = mujoco.MjData(model)
    data.qpos[:3], data.qpos[3:7], data.qpos[7:] = torso[:3], quaternion(*torso[3:]), joints
    mujoco.mj_forward(model, data)
    return model, data


# ---------------------------------------------------------------- poses in the plane
def test_compose_multiplies_matrices_and_relative_undoes_it():
    base, inner = np.random.default_rng(2).uniform(-1, 1, (2, 40, 3)) * [1, 1, 3]
    got = robot_model.compose(base, inner)
    for a, b, c in zip(base, inner, got):
        first, second, both = (matrix(0, 0, pose[2]) for pose in (a, b, c))
        np.testing.assert_allclose(first @ second, both, atol=1e-12)
        place = a[:2] + (first @ [b[0], b[1], 0])[:2]
        np.testing.assert_allclose(c[:2], place, atol=1e-12, err_msg=(
            "first turn the pose by the base's yaw, then add the base's place"))
    np.testing.assert_allclose(robot_model.relative(base, got), inner, atol=1e-12, err_msg=(
        "relative undoes compose: first subtract the base's place, then turn back, by −yaw"))

def test_wrap_keeps_the_direction_and_stays_within_half_a_turn():
    angles = np.concatenate([np.linspace(-20, 20, 101), [math.pi, -math.pi, 3 * math.pi]])
    wrapped = robot_model.wrap(angles)
    assert ((-math.pi <= wrapped) & (wrapped < math.pi)).all(), "[−π, π): π becomes −π"
    np.testing.assert_allclose(np.exp(1j * wrapped), np.exp(1j * angles), atol=1e-12)


# ---------------------------------------------------------------- kinematics
def random_joints(rng, count):
    """Joint angles [count, 12] inside the limits, knees bent, hips above the soles."""
    low = np.array([-1.0, -0.6, -1.2, 0.05, -1.2, -0.6])
    high = np.array([1.0, 0.6, 0.6, 2.2, 0.3, 0.6])
    assert (low >= ROBOT.joint_min).all() and (high <= ROBOT.joint_max).all()
    return rng.uniform(np.tile(low, 2), np.tile(high, 2), (count, 12))

def test_forward_kinematics_equals_mujoco():
    rng = np.random.default_rng(0)
    for joints in random_joints(rng, 50):
        torso = np.concatenate([rng.normal(size=3), rng.uniform(-1.2, 1.2, 3)])
        model, data = mujoco_at(torso, joints)
        points, turn = robot_model.body_points(ROBOT, torso, joints)  # [2, 5, 3], [2, 3, 3]
        yaws = np.arctan2(turn[:, 1, 0], turn[:, 0, 0])  # [2]
        for leg, (side, sign) in enumerate((("left", 1), ("right", -1))):
            for k, name in enumerate(("hip", "shin", "foot")):  # a body sits at its upper joint
                np.testing.assert_allclose(points[leg, k], data.body(f"{side} {name}").xpos,
                                           atol=1e-9, err_msg=(
                    f"{side} {('hip', 'knee', 'ankle')[k]}: sign of a pitch, or order of hip yaw "
                    "and roll?"))
            sole, foot = data.geom(f"{side} sole"), data.body(f"{side} foot")
            length, _, thick = model.geom(f"{side} sole").size
            for k, x in ((3, -length), (4, length)):  # heel, toe: below the ankle's axis
                corner = [x, -sign * ROBOT.foot_outward, -thick]
                want = sole.xpos + sole.xmat.reshape(3, 3) @ corner
                np.testing.assert_allclose(points[leg, k], want, atol=1e-9, err_msg=(
                    "heel or toe: foot_front and foot_back swapped, the ankle's height, or the "
                    "ankle's roll?"))
            want = math.atan2(foot.xmat[3], foot.xmat[0])
            assert math.remainder(yaws[leg] - want, math.tau) == pytest.approx(0, abs=1e-9), (
                "the rotation that is returned is the foot's")

def test_euler_angles_are_the_inverse_of_rotation():
    angles = np.random.default_rng(1).uniform(-1.4, 1.4, (50, 3)) * [2, 1, 2]
    for roll, pitch, yaw in angles:
        got = robot_model.rotation(np.array(roll), np.array(pitch), np.array(yaw))
        np.testing.assert_allclose(got, matrix(roll, pitch, yaw), atol=1e-9)
        got = robot_model.euler(quaternion(roll, pitch, yaw))
        np.testing.assert_allclose(got, (roll, pitch, yaw), atol=1e-9)

def test_leg_inverse_undoes_forward():
    joints = random_joints(np.random.default_rng(2), 500).reshape(-1, 6)
    points, foot = robot_model.leg_points(ROBOT, joints)
    got = robot_model.leg_inverse(ROBOT, points[:, 2], foot)
    assert got.shape == joints.shape, "positions [..., 3] in, joint angles [..., 6] out"
    wrong = ~np.isclose(got, joints, rtol=0, atol=1e-6).all(0)  # [6] hip 0, 1, 2; knee 3; ankle
    names = np.array(robot_model.JOINTS)
    cause = ("does the knee bend the other way?" if wrong[3] else
             "is an arctan2 of the ankle turned round?" if wrong[4:].any() else
             "is the ankle's roll taken out of the foot's rotation, or an arctan2 turned round?")
    assert not wrong.any(), f"wrong: {', '.join(names[wrong])} (of {', '.join(names)}): {cause}"

def test_body_inverse_puts_the_feet_where_they_should_be():
    rng, n = np.random.default_rng(3), 200
    trunk = rng.uniform([-1, -1, 0.36, -0.1, -0.1, -3], [1, 1, 0.39, 0.1, 0.2, 3], (n, 6))
    away = rng.uniform([-0.05, 0.07, 0, -0.3], [0.05, 0.11, 0.03, 0.3], (n, 2, 4))
    away[:, 1, 1] *= -1
    feet, cos, sin = away.copy(), np.cos(trunk[:, None, 5]), np.sin(trunk[:, None, 5])
    feet[..., 0] = trunk[:, None, 0] + cos * away[..., 0] - sin * away[..., 1]
    feet[..., 1] = trunk[:, None, 1] + sin * away[..., 0] + cos * away[..., 1]
    feet[..., 3] += trunk[:, None, 5]
    joints = robot_model.body_inverse(ROBOT, trunk, feet)
    points, turn = robot_model.body_points(ROBOT, trunk, joints)
    yaw = np.arctan2(turn[..., 1, 0], turn[..., 0, 0])
    sole = feet[..., None, 2] * np.ones(2)
    np.testing.assert_allclose(points[..., 3:, 2], sole, atol=1e-9, err_msg="soles must be level")
    np.testing.assert_allclose(points[..., 2, :2], feet[..., :2], atol=1e-9)
    np.testing.assert_allclose(robot_model.wrap(yaw - feet[..., 3]), 0, atol=1e-9)

def test_body_inverse_on_the_plane_keeps_the_legs_below_their_hips():
    rng = np.random.default_rng(5)
    trunk = rng.uniform([-1, -1, 0.36, 0, -0.1, -3], [1, 1, 0.39, 0, 0.2, 3], (50, 6))
    feet = np.zeros((50, 2, 4))
    feet[..., :2] = trunk[:, None, :2] + rng.uniform(-0.08, 0.08, (50, 2, 2))
    joints = robot_model.body_inverse(ROBOT, trunk, feet, planar=True)
    np.testing.assert_allclose(np.delete(joints, robot_model.SAGITTAL, 1), 0, atol=1e-12, err_msg=(
        "a plane has no hip yaw and no rolls"))
    points = robot_model.body_points(ROBOT, trunk, joints)[0]
    np.testing.assert_allclose(points[..., 3:, 2], 0, atol=1e-9, err_msg="soles must be level")
    ahead = np.stack([np.cos(trunk[:, 5]), np.sin(trunk[:, 5])], -1)[:, None]  # [n, 1, 2]
    got, want = ((p - trunk[:, None, :2]) @ ahead.swapaxes(1, 2)
                 for p in (points[..., 2, :2], feet[..., :2]))
    np.testing.assert_allclose(got, want, atol=1e-9, err_msg="ahead, the feet are as asked for")

@BOTH
def test_stance_stands_flat_on_the_ground(name):
    torso, joints = robot_model.stance(ROBOT, 0.38, 0.2, 0.15, name == "pymunk", 0.02)
    np.testing.assert_array_equal(torso, [0, 0, 0.38, 0, 0.15, 0])
    points, turn = robot_model.body_points(ROBOT, torso, joints)
    yaw = np.arctan2(turn[:, 1, 0], turn[:, 0, 0])
    np.testing.assert_allclose(points[:, 3:, 2], 0, atol=1e-9, err_msg="heel or toe in the air")
    width = 2 * ROBOT.hip_y if name == "pymunk" else 0.2
    np.testing.assert_allclose(points[:, 2, :2], [[-0.02, width / 2], [-0.02, -width / 2]],
                               atol=1e-9, err_msg="the trunk is x_offset AHEAD of the feet")
    np.testing.assert_allclose(yaw, 0, atol=1e-9)

ELSEWHERE = "within reach and clipped nowhere, but the ankle is elsewhere"
OTHERWISE = "within reach and clipped nowhere, but the foot is turned otherwise"

def test_inverse_pulls_a_pose_out_of_reach_along_the_line_from_the_hip():
    inside, foot = np.array([0.02, 0.03, -0.25]), matrix(0, 0, 0.3)
    points, got = robot_model.leg_points(ROBOT, robot_model.leg_inverse(ROBOT, inside, foot))
    np.testing.assert_allclose(points[2], inside, atol=1e-6, err_msg=ELSEWHERE)
    np.testing.assert_allclose(got, foot, atol=1e-6, err_msg=OTHERWISE)
    bent = robot_model.leg_points(ROBOT, [0, 0, 0, ROBOT.joint_max[3], 0, 0])[0][2]
    shortest, longest = np.linalg.norm(bent), ROBOT.thigh_length + ROBOT.shin_length
    for position, yaw, reach in (
            ([0, 0, -0.5], 0.0, longest), ([0.1, 0.05, -0.4], 0.3, longest),
            ([-0.05, -0.02, -9.0], -0.2, longest), ([0, 0, -0.02], 0.0, shortest),
            ([0.03, 0.0, -0.04], 0.0, shortest), ([0.01, 0.012, -0.03], 0.4, shortest),
            ([0.02, -0.02, -0.01], -0.5, shortest)):
        foot = matrix(0, 0, yaw)
        joints = robot_model.leg_inverse(ROBOT, np.array(position), foot)
        points, got = robot_model.leg_points(ROBOT, joints)
        want = np.array(position) / np.linalg.norm(position) * reach
        side = ("too far: a straight leg" if reach == longest else
                "too near: a folded leg (the knee at its joint limit, not |thigh − shin|)")
        np.testing.assert_allclose(points[2], want, atol=1e-6, err_msg=(
            f"{position}: {side} that points at the wish is the nearest pose"))
        np.testing.assert_allclose(got, foot, atol=1e-6, err_msg="the foot is turned as asked for")
        knee = 0.0 if reach == longest else ROBOT.joint_max[3]
        assert joints[3] == pytest.approx(knee, abs=1e-6)

def test_inverse_never_returns_nan_and_never_leaves_the_joint_limits():
    rng = np.random.default_rng(4)
    position = rng.normal(size=(2000, 3)) * 0.4
    position[0] = 0.0  # the ankle in the hip: no direction to pull along
    foot = robot_model.rotation(*rng.uniform(-3, 3, (3, 2000)))
    joints = robot_model.leg_inverse(ROBOT, position, foot)
    assert np.isfinite(joints).all(), "arccos and arcsin need their argument clipped to ±1"
    assert (joints >= ROBOT.joint_min).all() and (joints <= ROBOT.joint_max).all(), (
        "at last clip the angles to the joint limits")
    free = ((joints > ROBOT.joint_min) & (joints < ROBOT.joint_max)).all(1)
    free &= np.linalg.norm(position, axis=1) < ROBOT.thigh_length + ROBOT.shin_length
    points, got = robot_model.leg_points(ROBOT, joints)
    np.testing.assert_allclose(points[free, 2], position[free], atol=1e-6, err_msg=ELSEWHERE)
    np.testing.assert_allclose(got[free], foot[free], atol=1e-6, err_msg=OTHERWISE)
    assert 5 < free.sum() < 1500, (
        f"{free.sum()} of 2000 random poses can be taken: is a sign wrong, are limits ignored?")


# ---------------------------------------------------------------- one robot model
def test_mass_its_centre_and_its_inertia_are_the_same_everywhere(make_sim):
    torso, joints = stance("pymunk")
    model, data = mujoco_at(torso, joints)
    bodies = planar_bodies(make_sim("pymunk").spaces[0])
    planar = sum(body.mass for body in bodies)
    assert model.body_mass.sum() == pytest.approx(MASS), "MuJoCo adds the mass of geoms?"
    assert planar == pytest.approx(MASS), "are both hip motors in the planar torso?"
    centre = sum(np.array(body.position) * body.mass for body in bodies) / planar
    np.testing.assert_allclose(centre, data.subtree_com[0][[0, 2]], atol=1e-9, err_msg=(
        "the same posture, but the masses are elsewhere in one simulator"))
    # Turning the stiff robot about y: I = Σ (Iᵢ + mᵢ·dᵢ²); without the rotors of its six motors
    got = sum(body.moment + body.mass * (body.position - tuple(centre)).length ** 2
              for body in bodies) - 6 * ROBOT.armature
    want = 0.0
    for i in range(1, model.nbody):
        away = data.xipos[i][[0, 2]] - centre
        along = data.ximat[i].reshape(3, 3)[1]  # the y axis seen from the body
        want += along**2 @ model.body_inertia[i] + model.body_mass[i] * away @ away
    assert got == pytest.approx(want, rel=1e-6), "planar torso: parallel axes of its three parts"

def test_joint_limits_are_in_mujoco_too(make_sim):
    sim = make_sim("mujoco")
    for side in ("left", "right"):
        for k, joint in enumerate(robot_model.JOINTS):
            got = sim.model.joint(f"{side} {joint}")
            assert sim.model.jnt_limited[got.id], f"{side} {joint} turns without end"
            np.testing.assert_allclose(got.range, (ROBOT.joint_min[k], ROBOT.joint_max[k]),
                                       err_msg=f"{side} {joint} [rad]: degrees?")

@BOTH
@pytest.mark.parametrize("sign", [1, -1])
def test_motors_cannot_push_a_joint_through_its_limit(make_sim, name, sign):
    sim = make_sim(name)
    limit = np.tile(ROBOT.joint_max if sign > 0 else ROBOT.joint_min, 2)
    far = still(name, 1, 1.0)
    far.joints[:, 1:] = limit + 0.5 * sign
    seen = range(12) if name == "mujoco" else robot_model.SAGITTAL
    beyond = (sign * (sim.run(far, [0]).joints[0] - limit))[:, seen].max(0)
    assert (beyond < 0.1).all(), (
        f"{beyond.round(2)} rad beyond the limits: does the simulator know them?")
    assert (beyond > 0).sum() >= 4, "the test should push against some limits"

@BOTH
@pytest.mark.parametrize("what", ["walks", "falls"])
def test_motion_tells_where_the_bodies_are(make_sim, name, what):
    if what == "walks":  # until the left foot is in the air
        (trajectory, _), standing = walking(name, 1, [[0.08, 0, 0], [0.08, 0, 0]], 2)
        trajectory = part(trajectory, ticks=slice(0, 16))
    else:
        trajectory, standing = part(leaning(name, [0.4], 0.5), ticks=slice(0, 55)), stance(name)
    sim = make_sim(name, standing=standing)
    motion = sim.run(trajectory, [0])
    points, _ = robot_model.body_points(ROBOT, motion.torso[0, -1], motion.joints[0, -1])
    if what == "walks":
        assert points[0, 3:, 2].min() > 0.005, "the test should see a foot in the air"
    else:
        assert motion.torso[0, -1, 4] > 0.6, "the test should see it tilted"
    if name == "mujoco":
        data = mujoco.MjData(sim.model)
        mujoco.mj_setState(sim.model, data, sim.state[0], FULL)
        mujoco.mj_forward(sim.model, data)
        want = [[data.body(f"{side} {k}").xpos for k in ("hip", "shin", "foot")]
                for side in ("left", "right")]
        np.testing.assert_allclose(points[:, :3], want, atol=1e-9, err_msg=(
            "one of the named columns of the state is another one"))
        return
    pivots = [p for p in sim.spaces[0].constraints if isinstance(p, pymunk.PivotJoint)]
    want = [p.b.local_to_world(p.anchor_b) for p in pivots]  # hip, knee, ankle; twice
    np.testing.assert_allclose(points[:, :3, [0, 2]].reshape(6, 2), want, atol=2e-3, err_msg=(
        "the torso frame is below the centre of its body; a pitch is minus an angle"))
    for leg, pivot in enumerate((pivots[2], pivots[5])):
        (sole,) = pivot.b.shapes
        corners = np.array([pivot.b.local_to_world(v) for v in sole.get_vertices()])
        for point in points[leg, 3:][:, [0, 2]]:  # heel, toe
            assert np.linalg.norm(corners - point, axis=1).min() < 2e-3, "the ankle's pitch?"
    lacking = np.delete(np.arange(12), robot_model.SAGITTAL)
    np.testing.assert_array_equal(motion.joints[..., lacking],
                                  trajectory.joints[:, 1:, lacking], err_msg=(
        "joints that a plane lacks are reported as commanded"))

def test_fall_means_half_the_height_or_45_degrees():
    for height, roll, pitch, fell in (
            (0.41, 0, 0, False), (0.19, 0, 0, True), (0.21, 0, 0, False), (0.4, 44, 0, False),
            (0.4, 46, 0, True), (0.4, 0, -44, False), (0.4, 0, 46, True), (0.4, 0, -46, True),
            (0.4, 30, 30, False), (0.4, 32, 32, False), (0.4, 35, 35, True), (0.4, 180, 0, True),
            (0.1, 90, 0, True)):
        torso = np.array([7, -7, height, math.radians(roll), math.radians(pitch), 3])
        up = matrix(*torso[3:])[2, 2]  # cosine of the tilt
        assert fell == (height < 0.2 or up < math.cos(math.radians(45))), "the test's own table"
        got = robot_model.fallen(np.tile(torso, (2, 3, 1)), 0.4)
        assert got.shape == (2, 3) and (got == fell).all(), (
            f"height {height} m of 0.4 m, roll {roll}°, pitch {pitch}° is {'a' if fell else 'no'} "
            "fall" + (": cos(tilt) = cos roll · cos pitch" if roll or pitch else ""))


# ---------------------------------------------------------------- standing and falling
@BOTH
def test_robot_stands_where_it_was_put(make_sim, name):
    sim, (torso, joints) = make_sim(name, 2), stance(name)
    motion = sim.run(still(name, 2, 3.0), np.arange(2))
    assert not motion.fell.any()
    sag = torso[2] - motion.torso[..., 2]
    assert np.all(np.abs(sag) < 0.003), f"torso sags {1000 * sag} mm: motors too soft"
    assert np.all(np.abs(motion.torso[..., [0, 1, 5]]) < 0.005), "it should stay at the origin"
    np.testing.assert_allclose(motion.joints, np.tile(joints, (2, 300, 1)), atol=0.02)

def test_standing_height_is_the_same_in_both_simulators(make_sim):
    heights, standing = [], robot_model.stance(ROBOT, planar=True)
    for name in ("pymunk", "mujoco"):
        sim = make_sim(name, standing=standing)
        first = sim.run(part(still("pymunk", 1, 0.1), ticks=slice(0, 2)), [0]).torso[0, 0, 2]
        assert first == pytest.approx(standing[0][2], abs=5e-4), (
            f"{name}: after the first tick it is {1000 * (first - standing[0][2]):.2f} mm off")
        heights.append(sim.standing_height)
    assert heights == [standing[0][2]] * 2, (
        f"{heights} m: half of it is a fall, so the same robot would fall at two heights")

@BOTH
def test_robot_falls_without_its_motors(make_sim, name):
    sim, robots = make_sim(name, 2), np.arange(2)
    if name == "mujoco":
        sim.model.actuator_gainprm[:] = 0
        sim.model.actuator_biasprm[:] = 0
    else:
        for motor in sim.motors[0] + sim.motors[1]:
            motor.max_force = 0
    assert sim.run(still(name, 2, 3.0), robots).fell.all(), "who holds it up, if not its motors?"

@BOTH
def test_robot_falls_when_its_centre_of_mass_passes_its_toes(make_sim, name):
    def ahead(angle):
        """Statics: how far the centre of mass is ahead of the toes [m]."""
        joints = stance(name)[1].copy()
        joints[[4, 10]] -= angle
        data = mujoco_at([0, 0, 0, 0, -joints[2:5].sum(), 0], joints)[1]  # the soles are level
        return data.subtree_com[0][0] - data.body("left foot").xpos[0] - ROBOT.foot_front

    tips = next(angle for angle in np.arange(0, 1, 0.001) if ahead(angle) > 0)
    angles = tips + np.array([-0.1, -0.04, 0.02, 0.1])
    motion = make_sim(name, 4).run(leaning(name, angles, 4.0), np.arange(4))
    np.testing.assert_array_equal(motion.fell, [False, False, True, True], err_msg=(
        f"leaning slowly by {angles.round(2)} rad: the statics say it tips at {tips:.2f} rad"))

@BOTH
def test_fall_of_a_motion_follows_the_criterion_at_every_tick(make_sim, name):
    angles = np.linspace(0.15, 0.4, 8)
    trajectory = leaning(name, angles, 0.5)
    motion = make_sim(name, 8).run(trajectory, np.arange(8))
    up = np.cos(motion.torso[..., 3]) * np.cos(motion.torso[..., 4])
    down = (motion.torso[..., 2] < 0.5 * stance(name)[0][2]) | (up < math.sqrt(0.5))  # [N, T]
    assert down.any() and not down.all(1).any(), "the test should see robots up and down"
    np.testing.assert_array_equal(motion.fell, down.any(1), err_msg=(
        "fall: half the standing height, or 45° of tilt, at any control tick"))
    sim, first = make_sim(name), np.argmax(down.any(1))
    tick = np.argmax(down[first])
    pieces = single_ticks(part(trajectory, [first], slice(0, tick + 2)))
    seen = [bool(sim.run(piece, [0]).fell[0]) for piece in pieces]
    assert seen == [False] * tick + [True], "a fall is seen in its very tick, and not earlier"

def somersault(sim, name, seconds):
    """Throw the robot up, two metres high, such that it turns over once."""
    rate = 2 * math.pi / seconds
    if name == "mujoco":
        sim.state[0, sim.PLACE.stop - 1] += 2.0
        sim.state[0, sim.SPIN] = 0, rate, 0
        return
    bodies = planar_bodies(sim.spaces[0])
    centre = sum(np.array(body.position) * body.mass for body in bodies) / MASS
    for body in bodies:
        x, z = body.position - tuple(centre)
        body.angular_velocity, body.velocity = -rate, (rate * z, -rate * x)
        body.position += 0.0, 2.0
    sim.bodies[0] = sim._read([0])[0]

@BOTH
def test_a_somersault_is_a_fall_although_it_ends_upright(make_sim, name):
    sim = make_sim(name)
    somersault(sim, name, 0.5)
    motion = sim.run(still(name, 1, 0.5), [0])
    up = np.cos(motion.torso[0, :, 3]) * np.cos(motion.torso[0, :, 4])
    assert up.min() < -0.9 and up[-1] > 0.9 and motion.torso[0, :, 2].min() > 0.5, (
        "the test should see it upside down in the air, and then upright again")
    assert motion.fell[0], "a fall is looked for at every control tick, not only at the last one"


# ---------------------------------------------------------------- friction
@pytest.mark.parametrize("friction", [0.4, ROBOT.friction])
def test_mujoco_foot_slides_alike_in_all_directions_with_the_friction_it_drew(make_sim, friction):
    sim, body = make_sim("mujoco"), bodies(1)
    body.friction[:] = friction
    sim.reset([0], body)
    sim.run(still("mujoco", 1, 1.0), [0])  # the weight settles on the soles
    model, data = sim.models[0], mujoco.MjData(sim.model)
    for degrees in (0, 45, 90):
        mujoco.mj_setState(model, data, sim.state[0], FULL)
        data.qvel[:2] = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        data.ctrl[:] = stance("mujoco")[1]
        momentum, steps = [], 4  # later it rocks, and a foot that turns slides elsewhere
        for _ in range(steps + 1):
            mujoco.mj_forward(model, data)
            mujoco.mj_subtreeVel(model, data)
            momentum.append(data.subtree_linvel[0].copy())  # per mass: v of the centre [m/s]
            mujoco.mj_step(model, data)
        change, seconds = momentum[-1] - momentum[0], steps * STEP
        # ∫ horizontal force / ∫ vertical force = μ; that a foot bounces does not matter.
        mu = np.linalg.norm(change[:2]) / (change[2] + ROBOT.gravity * seconds)
        assert mu == pytest.approx(friction, rel=0.02), (
            f"sliding at {degrees}°: μ = {mu:.3f}; at 45° only: a pyramid, not Coulomb's cone; "
            "everywhere: two geoms' values combined by a maximum?")
        carried = 1 + change[2] / seconds / ROBOT.gravity
        assert carried == pytest.approx(1, abs=0.6 * friction), (
            "the ground carries it meanwhile; the more friction, the more it rocks")

@pytest.mark.parametrize("friction", [0.4, ROBOT.friction])
def test_planar_foot_slides_with_the_friction_it_drew(make_sim, friction):
    sim, body = make_sim("pymunk"), bodies(1)
    body.friction[:] = friction
    sim.reset([0], body)
    space = sim.spaces[0]

    def velocity():  # of the centre of mass
        return sum(np.array(body.velocity) * body.mass for body in planar_bodies(space)) / MASS

    for _ in range(40):  # settle
        space.step(STEP)
    for link in planar_bodies(space):
        link.velocity = 1.0, 0.0
    before, steps = velocity(), 6  # later a toe digs in, and stops
    for _ in range(steps):
        space.step(STEP)
    change, seconds = velocity() - before, steps * STEP
    mu = -change[0] / (change[1] + ROBOT.gravity * seconds)
    assert mu == pytest.approx(friction, rel=0.02), (
        f"μ = {mu:.3f}; pymunk MULTIPLIES the friction of both shapes")

@pytest.mark.parametrize("cone, alike", [(mujoco.mjtCone.mjCONE_ELLIPTIC, True),
                                         (mujoco.mjtCone.mjCONE_PYRAMIDAL, False)])
def test_a_walk_does_not_know_where_north_is(make_sim, cone, alike):
    """Six double steps, begun at 0°, 45° and 90°: MuJoCo's pyramid must fail, the cone must not."""
    plans, standing = walking("mujoco", 3, [[0.08, 0.02, 0.1], [0.08, 0, -0.1]], 6)
    plans = [part(plan, [0, 0, 0]) for plan in plans]
    sim, start = make_sim("mujoco", 3, standing=standing), np.zeros((3, 3))
    assert sim.model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC, "μ is alike in all directions"
    sim.model.opt.cone, start[:, 2] = cone, np.radians([0, 45, 90])
    sim.state[:, sim.TURN] = [quaternion(0, standing[0][4], yaw) for yaw in start[:, 2]]
    for plan in plans:
        motion = sim.run(plan, np.arange(3))
    ends = robot_model.relative(start, motion.torso[:, -1, [0, 1, 5]])[:, :2]
    apart = np.ptp(ends, axis=0).max()
    assert not motion.fell.any() and (apart < 0.01) == alike, (
        f"seen from the start the three walks end {1000 * apart:.1f} mm apart")


# ---------------------------------------------------------------- motors and joints
def separation(sim):
    """Largest gap between the two bodies of any joint now [m]."""
    joints = [joint for space in sim.spaces for joint in space.constraints]
    return max((p.a.local_to_world(p.anchor_a) - p.b.local_to_world(p.anchor_b)).length
               for p in joints if isinstance(p, pymunk.PivotJoint))

def planar_torque(sim):
    """Size of the motors' torque in the last physics step, [N, 6] [N m]."""
    return np.array([[abs(motor.impulse) / STEP for motor in motors] for motors in sim.motors])

@pytest.mark.parametrize("yaw", [0.0, 0.3])
def test_planar_joints_stay_together_and_motors_keep_their_limits(make_sim, yaw):
    plans, standing = walking("pymunk", 2, [[0.1, 0, yaw], [0.1, 0, -yaw]], 5)
    sim = make_sim("pymunk", 2, standing=standing)
    limit, gap, torque, joints = np.tile(ROBOT.torque_limit, 2), 0.0, 0.0, []
    for piece in (piece for plan in plans for piece in single_ticks(plan)):
        motion = sim.run(piece, np.arange(2))
        gap, torque = max(gap, separation(sim)), np.maximum(torque, planar_torque(sim))
        joints.append(motion.joints[:, -1])
    assert 1e-6 < gap < 0.002, f"{1000 * gap:.2f} mm apart: more solver iterations"
    assert np.all(torque <= limit[robot_model.SAGITTAL] + 1e-6), (
        "does every motor have its max_force?")
    assert torque.max() > 3.0, "walking takes some N m: is the torque measured at all?"
    speed = np.abs(np.diff(joints, axis=0)).max((0, 1)) / ROBOT.control_dt
    assert np.all(speed < 1.1 * np.tile(ROBOT.speed_limit, 2)), (
        f"joint speeds {speed.round(1)} rad/s beyond what the motors can do")
    assert speed[3] > 1.0, "a knee that does not move is no walk"

def test_mujoco_motors_keep_torque_and_speed_limits(make_sim):
    plans, standing = walking("mujoco", 1, [[0.08, 0, 0.15], [0.08, 0, -0.15]], 5)
    sim = make_sim("mujoco", standing=standing)
    limit, data, joints = np.tile(ROBOT.torque_limit, 2), mujoco.MjData(sim.model), []
    for plan in plans:
        joints.extend(sim.run(plan, np.arange(1)).joints[0])
    speed = np.abs(np.diff(joints, axis=0)).max(0) / ROBOT.control_dt
    assert np.all(speed < 1.25 * np.tile(ROBOT.speed_limit, 2)), (
        f"joint speeds {speed.round(1)} rad/s beyond what the motors can do")
    # Far from its target a motor pushes with all it has, at its speed limit with nothing; a joint
    # that the robot's own weight throws beyond it (a knee in a long swing) is braked.
    mujoco.mj_setState(sim.model, data, sim.start, FULL)
    for share in (0.0, 0.5, 1.0, 1.25):
        data.ctrl[:] = data.qpos[7:] + 3.0
        data.qvel[6:] = share * np.tile(ROBOT.speed_limit, 2)
        mujoco.mj_forward(sim.model, data)
        torque = data.qfrc_actuator[6:] + data.qfrc_passive[6:]
        np.testing.assert_allclose(torque, (1 - share) * limit, atol=1e-6, err_msg=(
            "a motor's torque falls on a line to zero at its speed limit"))

@BOTH
def test_motors_of_a_standing_robot_carry_the_weight_above_them(make_sim, name):
    sim = make_sim(name)
    motion = sim.run(still(name, 1, 3.0), [0])
    model, data = mujoco_at(motion.torso[0, -1], motion.joints[0, -1])
    if name == "mujoco":
        mujoco.mj_setState(model, data, sim.state[0], FULL)
        data.ctrl[:] = stance(name)[1]
        mujoco.mj_forward(model, data)
        torque = data.qfrc_actuator[6:][robot_model.SAGITTAL].reshape(2, 3)
        np.testing.assert_allclose(torque[0], torque[1], atol=0.05, err_msg="both carry the same")
    else:
        torque = planar_torque(sim).reshape(2, 3)
    # Statics: the two legs together hold the moment of all that is above their joint.
    above = ["torso", "left hip", "right hip"]
    for k, (joint, link) in enumerate((("hip pitch", "thigh"), ("knee", "shin"),
                                       ("ankle pitch", "foot"))):
        axis = data.joint(f"left {joint}").xanchor[0]
        want = sum(model.body(body).mass[0] * ROBOT.gravity * (data.body(body).xipos[0] - axis)
                   for body in above)
        left, right = torque[:, k]
        got = [left + right]
        if name == "pymunk":  # sizes only, and stiff legs may push against each other
            want, got = abs(want), [left + right, abs(left - right)]
        assert min(abs(g - want) for g in got) < 0.1, (
            f"{joint}: {left:.2f} and {right:.2f} N m, together they should hold {want:.2f} N m")
        above += [f"left {link}", f"right {link}"]


# ---------------------------------------------------------------- the torso's angular velocity
@BOTH
def test_spin_is_the_angular_velocity_about_the_torsos_own_axes(make_sim, name):
    fine = replace(ROBOT, control_dt=0.002, substeps=1)
    plans, standing = walking(name, 1, [[0.05, 0.02, 0.2], [0.05, 0, -0.2]], 5, fine)
    sim = make_sim(name, standing=standing, robot=fine)
    turns, spins = [], []
    for piece in (piece for plan in plans for piece in single_ticks(plan)):
        motion = sim.run(piece, [0])
        turns.append(matrix(*motion.torso[0, -1, 3:]))
        spins.append(motion.spin[0])
    assert not motion.fell.any() and motion.torso[0, -1, 5] > 1.0, "it should walk in a circle"
    turns, spins = np.array(turns), np.array(spins)
    # Rᵀ·Ṙ is the cross product with ω, both in the torso's own frame.
    change = turns[:-1].swapaxes(1, 2) @ turns[1:] / fine.control_dt
    want = (change - change.swapaxes(1, 2))[:, [2, 0, 1], [1, 2, 0]] / 2  # [K, 3]
    size, error = (np.sqrt(np.mean(x**2, 0)) for x in (want, spins[1:] - want))
    assert (size > 0.05).all(), f"the torso should turn about all axes, {size.round(3)} rad/s"
    assert (error < [0.01, 0.03, 0.01]).all(), (
        f"error {error.round(3)} of {size.round(3)} rad/s about x, y, z: a sign, or the rates of "
        "roll, pitch and yaw, or axes of the world instead of the leaning torso's own?")


# ---------------------------------------------------------------- bodies that differ
MUJOCO_LINKS = [f"{side} {part}" for side in ("left", "right")
                for part in ("hip", "thigh", "shin", "foot")]
MUJOCO_JOINTS = [f"{side} {joint}" for side in ("left", "right") for joint in robot_model.JOINTS]

def test_drawn_bodies_stay_within_the_spread_and_use_all_of_it():
    spread, count = robot_model.Spread(), 500
    body = spread.draw(np.random.default_rng(0).spawn(count), ROBOT)
    for what, got, width, low, high in (
            ("friction", body.friction, 1, ROBOT.friction - spread.friction,
             ROBOT.friction + spread.friction),
            ("mass", body.mass, 9, 1 - spread.mass, 1 + spread.mass),
            ("stiffness", body.stiffness, 12, 1 - spread.stiffness, 1 + spread.stiffness),
            ("stiction", body.stiction, 12, 0, spread.stiction)):
        assert got.shape == ((count, width) if width > 1 else (count,))
        share = (got.reshape(count, width) - low) / (high - low)
        assert share.min() >= 0 and share.max() <= 1, f"{what}: {got.min():.2f} to {got.max():.2f}"
        assert (share.min(0) < 0.02).all() and (share.max(0) > 0.98).all(), f"{what}: all of it"
        np.testing.assert_allclose(share.mean(0), 0.5, atol=0.06, err_msg=f"{what}: drawn evenly")
    assert set(body.delay) == {0, spread.delay} and 0.4 < np.mean(body.delay) < 0.6
    values = np.column_stack([body.friction, body.mass, body.stiffness, body.stiction, body.delay])
    alike = np.corrcoef(values.T) - np.eye(35)
    assert np.abs(alike).max() < 0.2, "every value is drawn by itself: two go together"

@BOTH
def test_no_spread_draws_the_model_and_changes_no_number(make_sim, name):
    body = bodies(2)
    assert (body.friction == ROBOT.friction).all() and (body.mass == 1).all()
    assert (body.stiffness == 1).all() and not body.stiction.any() and not body.delay.any()
    plans, standing = walking(name, 2, [[0.06, 0.02, 0.1], [0.06, 0, -0.1]], 2)
    one, two = (make_sim(name, 2, standing=standing) for _ in range(2))
    two.reset(np.arange(2), body)
    for plan in plans:
        want, got = (sim.run(plan, np.arange(2)) for sim in (one, two))
        for field in ("torso", "joints", "spin", "fell"):
            np.testing.assert_array_equal(getattr(got, field), getattr(want, field), err_msg=field)

def test_mujoco_robots_get_what_they_drew_each_in_a_model_of_its_own(make_sim):
    sim, body = make_sim("mujoco", 3), bodies(2, mass=0.1, friction=0.3, stiffness=0.2,
                                              stiction=1.5)
    sim.reset([2, 0], body)
    nominal = robot_model.mujoco_model(ROBOT)
    for model in (sim.model, sim.models[1]):
        np.testing.assert_array_equal(model.body_mass, nominal.body_mass, err_msg=(
            "robot 1 was not reset: it shares what robots 2 and 0 drew"))
    for row, i in enumerate([2, 0]):
        model = sim.models[i]
        for link, factor in zip(["torso", *MUJOCO_LINKS], body.mass[row]):
            got, want = model.body(link), nominal.body(link)
            assert got.mass == pytest.approx(factor * want.mass), link
            np.testing.assert_allclose(got.inertia, factor * want.inertia, err_msg=(
                f"{link}: the same shape and {factor:.2f} times as heavy"))
        assert model.body("torso").subtreemass == pytest.approx(model.body_mass.sum()), (
            "what MuJoCo derives from the masses is old: mj_setConst")
        assert model.body_invweight0[1, 0] != nominal.body_invweight0[1, 0]
        for joint, factor, stiction in zip(MUJOCO_JOINTS, body.stiffness[row], body.stiction[row]):
            motor, stiffness = model.actuator(joint), factor * ROBOT.stiffness
            np.testing.assert_allclose((motor.gainprm[0], motor.biasprm[1]),
                                       (stiffness, -stiffness), err_msg=(
                f"{joint}: τ = stiffness·(target − q); one without the other moves the zero"))
            assert motor.biasprm[2] == nominal.actuator(joint).biasprm[2]
            assert model.joint(joint).frictionloss == stiction, joint
        assert not model.dof_frictionloss[:6].any(), "nothing holds the torso in the air"
        np.testing.assert_array_equal(model.pair_friction[:, :2], body.friction[row])

def test_planar_robots_get_what_they_drew(make_sim):
    sim = make_sim("pymunk", 3)
    body = bodies(2, mass=0.1, stiffness=0.2, stiction=1.5)
    sim.reset([2, 0], body)
    hips = robot_model.planar_links(ROBOT)[0]  # the torso with both hips
    links = hips, *2 * (ROBOT.thigh, ROBOT.shin, ROBOT.foot)
    for row, i in enumerate([2, 0]):
        factors = body.mass[row, [0, 2, 3, 4, 6, 7, 8]]
        for k, (link, got, factor) in enumerate(zip(links, planar_bodies(sim.spaces[i]), factors)):
            assert got.mass == pytest.approx(factor * link.mass), f"body {k}"
            rotor = ROBOT.armature if k else 0.0
            assert got.moment == pytest.approx(factor * link.inertia[1] + rotor), f"body {k}"
        np.testing.assert_allclose(sim.gain[i], ROBOT.planar_gain
                                   * body.stiffness[row, robot_model.SAGITTAL])
    nominal, other = (sum(one.mass for one in every)
                      for every in (links, planar_bodies(sim.spaces[1])))
    assert other == pytest.approx(nominal), "not reset"

def test_static_friction_is_taken_from_a_planar_motors_largest_torque(make_sim):
    sim, body = make_sim("pymunk", 2), bodies(2, stiction=1.5)
    sim.reset(np.arange(2), body)
    far, most = still("pymunk", 2, 1.0), 0.0
    far.joints[:, 1:] = np.tile(ROBOT.joint_max, 2) + 0.5  # motors push against the joint limits
    for piece in single_ticks(far):
        sim.run(piece, np.arange(2))
        most = np.maximum(most, planar_torque(sim))
    left = (np.tile(ROBOT.torque_limit, 2) - body.stiction)[:, robot_model.SAGITTAL]
    assert (most <= left + 1e-6).all(), f"{most.round(2)} N m, at most {left.round(2)}"
    np.testing.assert_allclose(most, left, atol=1e-6, err_msg="all the rest is there to be used")

@BOTH
def test_a_delay_of_one_tick_moves_the_joints_one_tick_later(make_sim, name):
    body = bodies(2)
    body.delay[:] = 0, 1
    quiet, bent = still(name, 2, 0.12), still(name, 2, 0.12)
    bent.joints[:, 6:, 3] += 0.05  # the left knee's target, from tick 5 on
    seen = []
    for trajectory in (quiet, bent):
        sim = make_sim(name, 2)
        sim.reset(np.arange(2), body)
        motions = [sim.run(piece, np.arange(2)) for piece in single_ticks(trajectory)]
        seen.append(np.concatenate([m.joints for m in motions], 1)[..., robot_model.SAGITTAL])
    first = (seen[0] != seen[1]).any(-1).argmax(1)  # [2] tick
    np.testing.assert_array_equal(first, [5, 6], err_msg=(
        "the target reaches the delayed robot a tick later; the last one is remembered from one "
        "run to the next"))

def test_a_delayed_mujoco_robot_equals_one_that_is_asked_a_tick_later(make_sim):
    plans, standing = walking("mujoco", 1, [[0.08, 0, 0.1], [0.08, 0, -0.1]], 2)
    delayed, prompt = (make_sim("mujoco", standing=standing) for _ in range(2))
    body = bodies(1)
    body.delay[:] = 1
    delayed.reset([0], body)
    last = plans[0].joints[:, :1]
    for plan in plans:
        joints = np.concatenate([last, plan.joints[:, :-1]], 1)
        got = delayed.run(plan, [0])
        want = prompt.run(robot_model.Trajectory(joints, plan.trunk), [0])
        np.testing.assert_allclose(got.torso, want.torso, atol=1e-9)
        last = plan.joints[:, -2:-1]

@BOTH
def test_a_reset_without_a_body_forgets_all_of_the_last_one_or_nothing(make_sim, name):
    plans, standing = walking(name, 1, [[0.06, 0, 0.1], [0.06, 0, -0.1]], 1)
    body = robot_model.Spread().draw([np.random.default_rng(0)], ROBOT)
    again, drawn, nominal = (make_sim(name, standing=standing) for _ in range(3))
    again.reset([0], body)
    again.reset([0])
    drawn.reset([0], body)
    got, with_it, without = (sim.run(plans[0], [0]).torso for sim in (again, drawn, nominal))
    forgot, kept = (np.abs(got - torso).max() for torso in (without, with_it))
    assert min(forgot, kept) == 0, (
        f"{forgot} from the model, {kept} from the body: half of what was drawn survives a reset")


# ---------------------------------------------------------------- many robots
@BOTH
def test_reset_of_some_robots_leaves_the_others_alone(make_sim, name):
    plans, standing = walking(name, 3, [[0.06, 0, 0.05], [0.06, 0, -0.05]], 2)
    disturbed, quiet, new = (make_sim(name, 3, standing=standing) for _ in range(3))
    everybody, others = np.arange(3), [0, 2]
    for sim in (disturbed, quiet):
        sim.run(plans[0], everybody)
    disturbed.reset([1])
    got, want = disturbed.run(plans[1], everybody), quiet.run(plans[1], everybody)
    np.testing.assert_array_equal(got.torso[others], want.torso[others], err_msg=(
        "robot 1 was reset, robots 0 and 2 felt it"))
    assert got.torso[1, -1, 0] < want.torso[1, -1, 0] - 0.03, "robot 1 starts at the origin again"
    fresh = new.run(plans[1], everybody)
    np.testing.assert_array_equal(got.torso[1], fresh.torso[1], err_msg=(
        "something of the last episode survives a reset"))

@BOTH
def test_robots_move_alike_whoever_else_moves(make_sim, name):
    plans, standing = walking(name, 3, [[0.06, 0, 0.1], [0.06, 0, -0.1]], 1)
    together, alone = (make_sim(name, 3, standing=standing) for _ in range(2))
    want = together.run(plans[0], np.arange(3))
    got = alone.run(part(plans[0], [2]), np.array([2]))
    for field in ("torso", "joints", "spin", "fell"):
        np.testing.assert_array_equal(getattr(got, field)[0], getattr(want, field)[2])

@pytest.mark.parametrize("name, cores", [("pymunk", 1), ("mujoco", 1), ("mujoco", 2)])
@pytest.mark.parametrize("bad", [math.nan, 1e12])
def test_a_diverged_robot_is_a_silent_fall_and_the_others_go_on(make_sim, tmp_path, capfd, name,
                                                                cores, bad):
    sim, healthy, everybody = make_sim(name, 3, cores), make_sim(name, 3, cores), np.arange(3)
    if name == "mujoco":
        sim.state[1, 20] = bad  # forward velocity of the torso
    else:
        planar_bodies(sim.spaces[1])[0].velocity = bad, 0.0
    seconds = still(name, 3, 0.5)
    motion, want = sim.run(seconds, everybody), healthy.run(seconds, everybody)
    np.testing.assert_array_equal(motion.fell, [False, True, False], err_msg=(
        "a state that is not finite is a fall; comparisons with nan are always False"))
    for field in ("torso", "joints", "spin"):
        np.testing.assert_array_equal(getattr(motion, field)[[0, 2]], getattr(want, field)[[0, 2]])
    assert np.isfinite(motion.torso).all(), "the pose goes into rewards: it must stay finite"
    np.testing.assert_allclose(motion.torso[1], np.tile(stance(name)[0], (50, 1)), atol=0.01,
                               err_msg="it stays where it was last seen: no teleport")
    assert sim.run(still(name, 3, 0.1), everybody).fell[1], "still lost until its reset"
    sim.reset([1])
    again = sim.run(seconds, everybody)
    assert not again.fell.any(), "a reset cures it"
    np.testing.assert_array_equal(again.torso[1], want.torso[1], err_msg="a fresh robot")
    shown = capfd.readouterr()
    assert shown.out + shown.err == "", "the fall is enough: MuJoCo's warnings fill the terminal"
    assert not list(tmp_path.iterdir()), "a log file of MuJoCo in the folder of whoever runs this"


# ---------------------------------------------------------------- worker processes
def test_planar_robots_in_two_processes_move_as_in_one(make_sim):
    plans, standing = walking("pymunk", 5, [[0.08, 0.02, 0.1], [0.08, 0, -0.1]], 3)
    one, two = (make_sim("pymunk", 5, cores, standing) for cores in (1, 2))
    assert isinstance(one, robot_model.PymunkSim), "one core: no process is worth starting"
    assert isinstance(two, robot_model.Workers) and len(two.processes) == 2
    assert isinstance(make_sim("pymunk", 1, 2), robot_model.PymunkSim), "one robot: one process"
    for plan, robots, again in ((plans[0], [0, 1, 2, 3, 4], [1]), (plans[1], [4, 2, 0], [2, 0]),
                                (plans[1], [1], []), (plans[2], [3, 2, 1, 4], [0, 1, 2])):
        robots, again = np.array(robots), np.array(again, int)
        got, want = (sim.run(part(plan, robots), robots) for sim in (two, one))
        for field in ("torso", "joints", "spin", "fell"):
            np.testing.assert_array_equal(getattr(got, field), getattr(want, field), err_msg=(
                f"{field}: are rows and robots matched after spreading them over workers?"))
        for sim in (two, one):
            sim.reset(again)
    processes = list(two.processes)
    two.close()
    assert all(process.exitcode == 0 for process in processes), (
        f"close must end the workers: {[process.exitcode for process in processes]}")
    two.close()  # again is harmless

def test_many_planar_robots_move_as_few():
    """A cache holds sixteen; the others wait for their turn."""
    plans, standing = walking("pymunk", 19, [[0.08, 0.02, 0.1], [0.08, 0, -0.1]], 1)
    many, few = (robot_model.PymunkSim(19, standing) for _ in range(2))
    robots = np.arange(19)[::-1]
    got = many.run(part(plans[0], robots), robots)
    for rows in np.split(np.arange(19), [1, 8]):
        want = few.run(part(plans[0], robots[rows]), robots[rows])
        for field in ("torso", "joints", "spin", "fell"):
            np.testing.assert_array_equal(getattr(got, field)[rows], getattr(want, field))

def test_a_reset_robot_of_workers_equals_that_of_one_process(make_sim):
    plans, standing = walking("pymunk", 5, [[0.08, 0, 0.1], [0.08, 0, -0.1]], 2)
    everybody, ends = np.arange(5), []
    for cores in (1, 2):
        sim = make_sim("pymunk", 5, cores, standing)
        sim.run(plans[0], everybody)
        sim.reset(np.array([1, 4]))
        ends.append(sim.run(plans[1], everybody).torso)
    np.testing.assert_array_equal(ends[0], ends[1], err_msg=(
        "robot i is number i // W in process i mod W: another one was reset"))
    x = ends[0][:, -1, 0]
    assert (x[[1, 4]] < x[[0, 3]] - 0.03).all(), "robots 1 and 4 start at the origin again"

def test_bodies_reach_the_same_robots_in_two_processes_as_in_one(make_sim):
    plans, standing = walking("pymunk", 5, [[0.08, 0, 0.1], [0.08, 0, -0.1]], 2)
    ends = []
    for cores in (1, 2):
        sim = make_sim("pymunk", 5, cores, standing)
        for plan, robots, seed in ((plans[0], [0, 1, 2, 3, 4], 1), (plans[1], [4, 2, 1], 2)):
            rngs = np.random.default_rng(seed).spawn(len(robots))
            sim.reset(np.array(robots), robot_model.Spread().draw(rngs, ROBOT))
            ends.append(sim.run(plan, np.arange(5)).torso)
    np.testing.assert_array_equal(ends[:2], ends[2:], err_msg=(
        "rows of a Body go with their robots: robot i is in process i mod W"))

@pytest.mark.parametrize("when", ["before", "meanwhile"])
def test_a_killed_process_is_an_error_and_no_endless_wait(make_sim, when):
    sim, answers = make_sim("pymunk", 2, 2), []
    seconds = 1.0 if when == "before" else 100.0  # of which none, or some, will have passed

    def run():
        try:
            answers.append(sim.run(still("pymunk", 2, seconds), np.arange(2)))
        except Exception as error:
            answers.append(error)

    sim.reset(np.arange(2))  # both processes have started and answered
    thread = threading.Thread(target=run, daemon=True)  # a hanging run must not hang the tests
    if when == "meanwhile":
        thread.start()
        thread.join(0.2)
        assert not answers, "the test should kill the process while it is running"
    sim.processes[1].kill()
    sim.processes[1].join()
    if when == "before":
        thread.start()
    thread.join(60)
    assert answers, "it waits for an answer that nobody will send"
    assert isinstance(answers[0], OSError), f"{answers[0]!r}: a lost process is an OSError"
    assert str(answers[0]) and "\n" not in str(answers[0]), "one line that says what to do"


# ---------------------------------------------------------------- planar yaw
def quick_turn(sim, angle, seconds):
    """Yaw reached after a commanded turn at constant rate, and a second to come to rest."""
    trajectory = still("pymunk", 1, seconds + 1.0)
    ticks, total = round(seconds / ROBOT.control_dt), trajectory.joints.shape[1]
    trajectory.trunk[0, :, 5] = angle * np.clip(np.arange(total) / ticks, 0, 1)
    return sim.run(trajectory, np.arange(1)).torso[0, -1, 5]

def test_planar_yaw_follows_a_gentle_turn_and_slips_in_a_sharp_one(make_sim):
    gentle = quick_turn(make_sim("pymunk"), 0.5, 0.5)
    assert gentle == pytest.approx(0.5, rel=0.1), f"gentle: {gentle:.2f} of 0.50 rad"
    sharp = quick_turn(make_sim("pymunk"), 1.0, 0.05)
    assert 0.0 < sharp < 0.6, (
        f"sharp: {sharp:.2f} of 1.00 rad. τ ≤ μ·F·r: friction cannot carry such a torque")
    # Accelerated by μ·F·r/I for as long as the command turns, then braked as long: τ/I·t².
    torque = ROBOT.friction * MASS * ROBOT.gravity * make_sim("pymunk").sole_radius
    most = torque / ROBOT.yaw_inertia * 0.05**2 + 2 * torque / ROBOT.yaw_stiffness
    assert sharp < most + 0.02, f"faster than friction allows: {sharp:.2f} rad, {most:.2f} rad"

def test_planar_yaw_rate_persists_in_the_air(make_sim):
    sim = make_sim("pymunk")
    for body in planar_bodies(sim.spaces[0]):
        body.position += 0.0, 1.0
    sim.bodies[0], sim.yaw_rate[0] = sim._read([0])[0], 0.8
    trajectory = still("pymunk", 1, 0.3)
    trajectory.trunk[0, :, 5] = -np.linspace(0, 1, 31)  # asks for the other direction
    yaw = sim.run(trajectory, [0]).torso[0, :, 5]
    np.testing.assert_allclose(yaw, 0.8 * ROBOT.control_dt * np.arange(1, 31), atol=1e-3, err_msg=(
        "without contact F = 0, and so is the torque: nothing can stop or start a turn"))

def test_planar_push_ahead_and_turn_share_one_friction_circle(make_sim):
    sim, body = make_sim("pymunk", 4), bodies(4, friction=0.3, mass=0.1)
    sim.reset(np.arange(4), body)
    dt, before = ROBOT.control_dt, sim.bodies
    after = before.copy()
    shares = np.array([0.0, 0.6, 0.8, 1.0])  # of μ·F: accelerated ahead by that share of μ·g
    after[..., 3] += (shares * body.friction * ROBOT.gravity * dt)[:, None]
    seen = np.stack([before, after], 1)  # [N, T + 1, 7, 6]
    yaw = sim._run_yaw(seen, np.full((4, 1), 0.5), np.arange(4))[:, 1]  # told to turn by 0.5 rad
    weight = np.array([sum(link.mass for link in planar_bodies(space)) for space in sim.spaces])
    largest = body.friction * weight * ROBOT.gravity * sim.sole_radius  # [N m]
    np.testing.assert_allclose(yaw * ROBOT.yaw_inertia / dt**2, largest * [1, 0.8, 0.6, 0],
                               atol=1e-3, err_msg=(
        "0.6² + 0.8² = 1: a sole that pushes ahead with 0.6·μ·F has 0.8·μ·F left for a turn"))

def test_mean_radius_of_the_sole(make_sim):
    a, b = ROBOT.foot_front + ROBOT.foot_back, ROBOT.foot_width
    # The integral of √(x² + y²) over the rectangle a × b, divided by a·b
    want = (math.hypot(a, b) / 6 + a**2 / (12 * b) * math.asinh(b / a)
            + b**2 / (12 * a) * math.asinh(a / b))
    got = make_sim("pymunk").sole_radius
    assert got == pytest.approx(want, rel=0.005), (
        f"r = {1000 * got:.2f} mm, {1000 * want:.2f} mm: a mean over the whole sole; a grid that "
        "includes the edges counts them too often")


# ---------------------------------------------------------------- the solver
def test_faster_solver_settings_do_not_change_the_physics(make_sim):
    """Cold or warm start: the solver must find the same contact forces (6 double steps)."""
    plans, standing = walking("mujoco", 1, [[0.08, 0.02, 0.1], [0.08, 0, -0.1]], 6)
    ends = []
    for flags in (None, 0):
        sim = make_sim("mujoco", standing=standing)
        if flags is not None:
            assert sim.model.opt.disableflags, "nothing is switched off: then why this test?"
            sim.model.opt.disableflags = flags
        ends.append([sim.run(plan, [0]).torso[0, -1] for plan in plans])
    np.testing.assert_allclose(*ends, atol=1e-3, err_msg=(
        "the flags of the model are there to save time, not to change how the robot walks"))
