"""Stage 1, checked against physics. A failing test names the likely mistake."""

import math
import os
from dataclasses import replace
from functools import cache
from importlib import import_module
from itertools import product
from pathlib import Path

import mujoco
import numpy as np
import pymunk
import pytest
from checks import BOTH, close, equal, frozen
from numpy.random import default_rng

robot_model = import_module("01_robot_model")
walk_engine = import_module("02_walk_engine")

ROBOT = robot_model.RobotModel()
DT = ROBOT.control_dt  # [s] of a tick
STEP = DT / ROBOT.substeps  # [s] of physics
LEG = ROBOT.hip, ROBOT.thigh, ROBOT.shin, ROBOT.foot
MASS = sum(link.mass for link in (ROBOT.torso, *LEG, *LEG))
SAGITTAL, PLANAR = robot_model.SAGITTAL, [0, 2, 3, 4, 6, 7, 8]  # joints, links of the plane
OTHER = replace(ROBOT, hip_x=0.0, thigh=ROBOT.shin, shin=ROBOT.thigh)
ROBOTS = pytest.mark.parametrize("robot", [ROBOT, OTHER], ids=["ours", "another"])


def stance(sim):
    """Torso pose [6] and joints [12] from which a simulator starts."""
    return robot_model.stance(ROBOT, planar=sim == "pymunk")


def make_sim(sim, num_robots=1, standing=None, robot=ROBOT):
    """A simulator whose robots stand."""
    simulator = robot_model.SIMULATORS[sim](num_robots, standing or stance(sim), robot)
    simulator.reset(np.arange(num_robots))
    return simulator


class Moving(robot_model.Trajectory):
    """A Trajectory that also moves the trunk on the floor, by `move` [n, T, 3]."""

    def __init__(self, joints, move=0.0):
        super().__init__(joints)
        self.move = np.zeros((len(joints), self.ticks, 3)) + move

    def go_on(self, rows, tick, imu):
        joints, _ = super().go_on(rows, tick, imu)
        return joints, self.move[rows, tick]


def still(sim, num_robots, seconds):
    """A plan of robots that only stand."""
    return Moving(np.tile(stance(sim)[1], (num_robots, round(seconds / DT) + 1, 1)))


def leaning(sim, angles, seconds):
    """A plan that leans forward by these angles [N] in a smooth way, then stands for 2 s."""
    trajectory = still(sim, len(angles), seconds + 2.0)
    time = DT * np.arange(trajectory.ticks + 1)
    share = (1 - np.cos(np.pi * np.minimum(time / seconds, 1))) / 2
    trajectory.joints[..., [4, 10]] -= np.multiply.outer(angles, share)[..., None]
    return trajectory


def run(simulator, plan, disturbance=None):
    """The Motion of all robots on their plan."""
    return simulator.run(np.arange(len(plan.progress)), plan, disturbance)


def throw(simulator, i, x, y=0.0, z=0.0):
    """From now on robot i moves with this velocity [m/s], and nothing of it turns."""
    if simulator.planar:
        for body in simulator.worlds[i][1]:
            body.velocity, body.angular_velocity = (x, z), 0.0
    else:
        simulator.physics[i, 19:] = [x, y, z] + 15 * [0.0]


def mass_velocity(motion):
    """Of the centre of mass in the last tick, its mean [n, 3] [m/s]."""
    robots = zip(motion.torso, motion.joints)
    centres = [robot_model.centre_of_mass(ROBOT, *robot) for robot in robots]  # [n, T, 3]
    return np.diff(centres, axis=1)[:, -1] / DT


def bodies(count):
    """Robots that differ a little from the model; their motors are on time, their zeros right."""
    body, rng = robot_model.Variation.as_model(ROBOT, count), default_rng(0)
    for name in "friction", "mass", "stiffness", "stiction", "com", "gyro":
        values = getattr(body, name)
        values += rng.uniform(-0.02, 0.02, values.shape)
    return body


def ends(motion):
    """How a Motion ends [n, 20]: torso, joints, whether the robot fell, ticks."""
    return np.column_stack([motion.torso[:, -1], motion.joints[:, -1], motion.fell, motion.ticks])


def qpos(torso, joints):
    """Where MuJoCo has a robot with this torso pose [6] and these joints [12], [18]."""
    return [*torso[:3], *torso[:2:-1], *joints]  # yaw, pitch, roll


@cache
def nominal(robot=ROBOT):
    return mujoco.MjModel.from_xml_string(robot_model.mujoco_xml(robot))


def mujoco_at(torso, joints, robot=ROBOT):
    """MuJoCo's model and data of a robot with this torso pose [6] and these joints [12]."""
    model = nominal(robot)
    data = mujoco.MjData(model)
    data.qpos[:] = qpos(torso, joints)
    mujoco.mj_forward(model, data)
    return model, data


def test_compose_multiplies_matrices_and_relative_undoes_it():
    def turn(place, yaw):  # as x + i·y, which a turn multiplies by a number
        z = (place[..., 0] + 1j * place[..., 1]) * np.exp(1j * yaw)
        return np.stack([z.real, z.imag], -1)

    for shape in (40,), (), (2, 4):  # a batch, one pose, rows of poses
        poses = default_rng(2).uniform(-1, 1, (2, *shape, 3)) * [1, 1, 9]
        frozen(poses)
        base, inner = poses
        got = robot_model.compose(base, inner)
        frozen(got)
        want = base[..., :2] + turn(inner, base[..., 2])
        hint = "first turn the pose by the base's yaw, then add the base's place"
        close(got[..., :2], want, hint)
        hint = "yaws add up, without wrap: a foot that turns on and on must not jump"
        close(got[..., 2], poses[..., 2].sum(0), hint)
        hint = "relative undoes compose: first subtract the base's place, then turn back, by −yaw"
        back = robot_model.relative(base, got)
        close(back[..., :2], inner[..., :2], hint)
        hint = "relative subtracts yaws, without wrap, so that it undoes compose"
        close(back[..., 2], inner[..., 2], hint)


def test_wrap_keeps_the_direction_and_stays_within_half_a_turn():
    angles = np.concatenate([np.linspace(-20, 20, 101), [math.pi, -math.pi, 3 * math.pi]])
    frozen(angles)
    wrapped = robot_model.wrap(angles)
    outside = np.abs(wrapped) > math.pi + 1e-9
    assert not outside.any(), (
        f"from −π to π: {angles[outside][0]:.2f} becomes {wrapped[outside][0]:.2f}, too few turns are "
        "taken away, or too many"
    )
    close(
        np.exp(1j * wrapped),
        np.exp(1j * angles),
        "whole turns only are taken away: cos + i·sin stays, for it is the same direction",
    )


def random_joints(rng, *shape):
    """Joint angles [*shape, 12] inside the limits, knees bent, hips above the soles."""
    low, high = [-1.0, -0.6, -1.2, 0.05, -1.2, -0.6], [1.0, 0.6, 0.6, 2.2, 0.3, 0.6]
    return rng.uniform(np.tile(low, 2), np.tile(high, 2), (*shape, 12))


# What a mistake in a link's origin, and in its rotation, may be
CHAIN = {
    "torso": ("x, y, z as given", "Rz(yaw)·Ry(pitch)·Rx(roll)"),
    "hip": ("R·robot.hips + torso, on its own side", "R·Rz(hip yaw)·Rx(hip roll), in this order"),
    "thigh": ("hip_x along the first column of the hip's rotation", "hip's·Ry(hip pitch)"),
    "shin": (
        "−thigh_length along the third column of the thigh's rotation",
        "pitches add up: hip's·Ry(hip pitch + knee)",
    ),
    "foot": (
        "−shin_length along the third column of the shin's rotation",
        "hip's·Ry(hip pitch + knee + ankle pitch)·Rx(ankle roll), in this order",
    ),
}
NAMES_OF_LINKS = [
    "torso",
    *(f"{side} {link}" for side in ("left", "right") for link in [*CHAIN][1:]),
]


@ROBOTS
def test_forward_kinematics_and_the_centre_of_mass_equal_those_of_mujoco(robot):
    rng, shape = default_rng(0), (6, 8)
    poses = random_joints(rng, *shape)
    torsos = rng.uniform(-1.2, 1.2, (*shape, 6))
    frozen(torsos, poses)
    found = robot_model.link_frames(robot, torsos, poses)
    for got, more in zip(found, ((9, 3), (9, 3, 3))):
        assert np.shape(got) == (*shape, *more), "torso [..., 6], joints [..., 12]: any [...]"
    data = [mujoco_at(torsos[i], poses[i], robot)[1] for i in np.ndindex(shape)]
    origins = np.reshape([one.xpos[1:] for one in data], (*shape, 9, 3))
    turns = np.reshape([one.xmat[1:] for one in data], (*shape, 9, 3, 3))
    for k, link in enumerate(NAMES_OF_LINKS):
        place, turn = CHAIN[link.split()[-1]]
        said = f"the first wrong link is the {link}: its"
        close(found[0][..., k, :], origins[..., k, :], f"{said} origin is wrong ({place})")
        got, want = found[1][..., k, :, :], turns[..., k, :, :]
        if np.allclose(got.mT, want):
            turn = "it is transposed"
        close(got, want, f"{said} rotation is wrong ({turn})")
    for i, one in zip(np.ndindex(shape), data):
        (got,) = robot_model.centre_of_mass(robot, torsos[i][None], poses[i][None])
        hint = (
            "Σ mᵢ·pᵢ / Σ mᵢ, over all nine links, none with the mass of a geom; y of a right leg's "
            "centre is mirrored, as it is outward"
        )
        close(got, one.subtree_com[0], hint)


def left_leg(robot, joints):
    """Axis of hip pitch, knee and ankle [..., 3, 3] in the frame of the left hip, and the foot's
    rotation [..., 3, 3]; joints [..., 6]."""
    joints = np.tile(joints, 2)
    origins, turns = robot_model.link_frames(robot, 0 * joints[..., :6], joints)
    return origins[..., 2:5, :] - robot.hips[0], turns[..., 4, :, :]


@ROBOTS
def test_leg_inverse_undoes_forward(robot):
    joints = random_joints(default_rng(2), 500).reshape(-1, 2, 6)
    points, foot = left_leg(robot, joints)
    got = robot_model.leg_inverse(robot, points[..., 2, :], foot)
    assert got.shape == joints.shape, "positions [..., 3] in, joint angles [..., 6] out"
    got, joints = got.reshape(-1, 6), joints.reshape(-1, 6)
    wrong = ~np.isclose(got, joints, rtol=0, atol=1e-6).all(0)  # [6] hip 0, 1, 2; knee 3; ankle
    names = np.array(robot_model.JOINTS)
    cause = (
        "is the axis of hip pitch hip_x AHEAD of the hip, and does the knee bend the other way?"
        if wrong[3]
        else "is an arctan2 of the ankle turned round, or r not in the foot's frame, Rᵀ·(−p)?"
        if wrong[4:].any()
        else "is the ankle's roll taken out of the foot's rotation, or an arctan2 turned round?"
    )
    k = np.abs(got - joints).max(1).argmax()
    assert not wrong.any(), (
        f"wrong: {', '.join(names[wrong])} (of {', '.join(names)}): {cause} "
        f"(got {got[k].round(3)}, expected {joints[k].round(3)})"
    )


@BOTH
def test_joints_for_feet_puts_the_feet_where_they_should_be(sim):
    rng, n, place = default_rng(3), 200, [0, 1, 3]  # x, y, yaw of a foot
    trunk = stance(sim)[0] + rng.uniform(-1, 1, (n, 6)) * [1, 1, 0.02, 0.1, 0.1, 3]
    away = rng.uniform(-1, 1, (n, 2, 3)) * [0.05, 0.02, 0.3] + [[0, 0.09, 0], [0, -0.09, 0]]
    here, feet = trunk[:, None, robot_model.GROUND], rng.uniform(0, 0.03, (n, 2, 4))
    feet[..., place] = robot_model.compose(here, away)
    trunk[:, 3] *= sim == "mujoco"
    joints = robot_model.joints_for_feet(ROBOT, trunk, feet, sim == "pymunk")
    if sim == "pymunk":
        away[..., 1], away[..., 2] = ROBOT.hips[:, 1], 0  # legs below their hips
        feet[..., place] = robot_model.compose(here, away)
    origins, turns = robot_model.link_frames(ROBOT, trunk, joints)
    close(origins[:, [4, 8]] - [0, 0, ROBOT.ankle_height], feet[..., :3], "soles are elsewhere")
    level = robot_model.rotation(0, 0, feet[..., 3])
    close(turns[:, [4, 8]], level, "soles must be level, and point where they should")


@ROBOTS
def test_inverse_pulls_a_pose_out_of_reach_along_the_line_from_the_hip(robot):
    for knee, hint, *positions in (
        (0.0, "too far: a straight leg", [0.0, 0, -0.5], [0.1, 0.05, -0.4], [-0.05, -0.02, -9.0]),
        (robot.joint_max[3], "too near: a folded leg (the knee at its joint limit, not |thigh − shin|)",
         [0.03, 0.0, -0.04], [0.01, 0.012, -0.03], [0.02, -0.02, -0.01]),
    ):  # fmt: skip
        hip, _, ankle = left_leg(robot, [0, 0, 0, knee, 0, 0])[0]
        reach = np.linalg.norm(ankle - hip)
        for position, yaw in zip(np.add(positions, [robot.hip_x, 0, 0]), (0.0, 0.4, -0.5)):
            frozen(position)
            foot = robot_model.rotation(0, 0, yaw)
            joints = robot_model.leg_inverse(robot, position, foot)
            points, got = left_leg(robot, joints)
            away = position - points[0]  # from the axis of hip pitch
            want = points[0] + away / np.linalg.norm(away) * reach
            said = f"{position}: {hint} that points at the wish is the nearest pose"
            close(points[2], want, said, atol=1e-6)
            close(got, foot, "the foot is turned as commanded", atol=1e-6)
            close(joints[3], knee, atol=1e-6)


def test_inverse_never_returns_nan_and_never_leaves_the_joint_limits():
    rng = default_rng(4)
    position = rng.normal(size=(2000, 3)) * 0.4
    position[0] = 0.0  # the ankle in the hip: no direction to pull along
    foot = robot_model.rotation(*rng.uniform(-3, 3, (3, 2000)))
    joints = robot_model.leg_inverse(ROBOT, position, foot)
    # A hip that rolls by ±90°, a leg that is straight: of 1 rounding makes more than 1.
    rolled = random_joints(rng, 100).reshape(-1, 6)
    rolled[:, 1] = [math.pi / 2, -math.pi / 2] * 100
    points, turn = left_leg(ROBOT, rolled)
    for length in np.linspace(0.1, 0.3, 20):
        robot = replace(ROBOT, thigh_length=length)
        more = robot_model.leg_inverse(robot, 9 * points[:, 2], turn)
        assert np.isfinite([*joints, *more]).all(), (
            "arccos and arcsin need their argument clipped to ±1"
        )
    inside = joints.clip(ROBOT.joint_min, ROBOT.joint_max)
    close(joints, inside, "at last clip the angles to the joint limits")


@ROBOTS
def test_mass_its_centre_and_its_inertia_are_the_same_in_both_simulators(robot):
    torso, joints = standing = robot_model.stance(robot, planar=True)
    _, data = mujoco_at(torso, joints, robot)
    _, links, _ = make_sim("pymunk", 1, standing, robot).worlds[0]
    masses = np.array([body.mass for body in links])
    places = np.array([body.local_to_world(body.center_of_gravity) for body in links])  # [7, 2]
    close(masses.sum(), MASS, "are both hip motors in the planar torso?")
    middle = np.average(places, 0, masses)
    close(middle, data.subtree_com[0][[0, 2]], "masses are elsewhere in one")
    # Turning the stiff robot about y: I = Σ (Iᵢ + mᵢ·dᵢ²); without the rotors of its six motors
    own = sum(body.moment for body in links) - 6 * ROBOT.armature
    got = own + masses @ ((places - middle) ** 2).sum(1)
    want = data.crb[1, 1]  # about y, of MuJoCo's body 1 with all bodies that hang on it
    close(got, want, "planar torso: parallel axes of its three parts")


def test_mujoco_motors_cannot_push_a_joint_through_its_limit():
    low, high = np.tile([ROBOT.joint_min, ROBOT.joint_max], 2)
    far = still("mujoco", 2, 1.0)
    slowly = np.linspace(0, 1, 101)[:, None]  # a joint that is thrown goes farther
    far.joints += slowly * (np.stack([low - 0.5, high + 0.5])[:, None] - far.joints)
    joints = run(make_sim("mujoco", 2), far).joints
    beyond = np.maximum(low - joints, joints - high).max(1)  # [2, 12]
    assert (beyond < 0.1).all(), f"{beyond.round(2)} rad beyond: has the simulator the limits?"
    assert ((beyond > 0).sum(1) >= 4).all(), "the test should push against some limits"


@BOTH
def test_motion_tells_where_the_bodies_are_and_how_fast_they_turn(sim):
    """Robots in the air, pitched by 0.8 rad, that turn, move their joints and are pushed, for 100
    fine ticks; no two of them are alike."""
    rng, n, dt, plan = default_rng(5), 8, 0.0002, still(sim, 8, 1.0)
    torso, joints = stance(sim)
    torso[[2, 4]] = 1.0, 0.8
    simulator = make_sim(sim, n, (torso, joints), replace(ROBOT, control_dt=dt, substeps=1))
    time = dt * np.arange(101)
    plan.joints += rng.uniform(-3, 3, (n, 1, 12)) * time[:, None]
    plan.move[..., 2] = 2 * dt  # turns by 2 rad/s
    disturbance = robot_model.Disturbance.none(plan)
    disturbance.push += rng.uniform(-50, 50, (n, 1, 2))
    motion = run(simulator, plan, disturbance)

    want = np.diff(motion.torso[:, -2:, 3:], axis=1)[:, 0] / dt  # [8, 3]
    close(simulator.state[:, 18:], want, "rad/s: rates of roll, pitch, yaw", atol=0.01)

    torso, joints = motion.torso[:, -1], motion.joints[:, -1]
    if sim == "mujoco":
        want = [qpos(*pair) for pair in zip(torso, joints)]
        hint = "x, y, z, yaw, pitch, roll, joints: a named column of the state is another one"
        close(simulator.physics[:, 1:19], want, hint)  # behind the time
        return
    torso[:, robot_model.GROUND] = 0  # seen from its own place, along its own plane
    points, turns = robot_model.link_frames(ROBOT, torso, joints)
    for i, (_, links, _) in enumerate(simulator.worlds):
        places = [body.position - (links[0].position.x, 0) for body in links]
        got = points[i, PLANAR][:, [0, 2]]
        close(got, places, "the torso's frame, or a joint", atol=2e-3)
        along = [body.rotation_vector for body in links]  # x and z of their own x axes
        close(turns[i, PLANAR][:, [0, 2], 0], along, "a pitch is minus an angle")


def test_fall_means_half_the_height_or_45_degrees():
    for standing, (height, roll, pitch, fell) in product((0.4, 0.6), (
        (0.19, 0, 0, True), (0.21, 0, 0, False), (0.4, 44, 0, False),
        (0.4, 46, 0, True), (0.4, 0, -44, False), (0.4, 0, -46, True), (0.4, 32, 32, False),
        (0.4, 35, 35, True), (0.4, 180, 0, True),
    )):  # fmt: skip
        height += (standing - 0.4) / 2
        torso = np.full((2, 3, 6), [7, -7, standing, 0, 0, 3])  # the first three stand
        torso[1, :, 2:5] = height, math.radians(roll), math.radians(pitch)
        frozen(torso)
        got = robot_model.fallen(torso, standing)
        assert np.shape(got) == (2, 3) and (got == [[False], [fell]]).all(), (
            f"height {height:.2f} m of {standing} m, roll {roll}°, pitch {pitch}° is "
            f"{('no', 'a')[fell]} fall"
        )


@BOTH
def test_a_robot_let_go_in_the_air_drops_freely_and_has_fallen_half_way(sim):
    torso, joints = stance(sim)
    torso[2] = 1.03
    simulator = make_sim(sim, 1, (torso, joints))
    motion = run(simulator, still(sim, 1, 0.32))  # half of it takes √(1.03 m / g) = 0.324 s
    time = DT * np.arange(1, 33)
    off = torso[:3] - motion.torso[0, :, :3]  # [32, 3]
    off[:, 2] -= ROBOT.gravity * time**2 / 2
    assert (np.abs(off.T) < ROBOT.gravity * time * STEP / 2 + 1e-6).all(), (  # of Euler's method
        f"{off} m: it begins at the origin; x, y, z are those of the torso's frame; or does "
        "something hold the robot in the air?"
    )
    assert not motion.fell[0], "half of the height at which it stood is a fall, not more"
    assert run(simulator, still(sim, 1, 0.02)).fell[0], "below half of its height it has fallen"
    throw(simulator, 0, 0.0, z=2.0)
    motion = run(simulator, still(sim, 1, 0.1))
    assert motion.fell[0] and motion.torso[0, -1, 2] > 0.55, "looked for at every control tick"


@BOTH
def test_robot_falls_when_its_centre_of_mass_passes_its_toes(sim):
    def ahead(angle):
        """Statics: how far the centre of mass is ahead of the toes [m]."""
        joints = stance(sim)[1]
        joints[[4, 10]] -= angle
        data = mujoco_at([0, 0, 0, 0, -joints[2:5].sum(), 0], joints)[1]  # the soles are level
        return data.subtree_com[0][0] - data.body("left foot").xpos[0] - ROBOT.foot_front

    tips = next(angle for angle in np.arange(0, 1, 0.005) if ahead(angle) > 0)
    angles = tips + np.array([-0.1, -0.04, 0.02, 0.1])
    motion = run(make_sim(sim, 4), leaning(sim, angles, 4.0))
    equal(
        motion.fell,
        [False, False, True, True],
        f"leaning slowly by {angles.round(2)} rad: the statics say it tips at {tips:.2f} rad",
    )


@BOTH
def test_a_robot_whose_plan_is_done_keeps_its_state(sim):
    """And goes on from there, with what it chose last."""
    simulator, plan = make_sim(sim, 2), leaning(sim, [0.2, 0.2], 0.3)
    simulator.reset([0, 1], replace(robot_model.Variation.as_model(ROBOT, 2), delay=[0.5, 0.5]))
    plan.move += 0.001
    plan.progress[1] = plan.ticks - 20
    motion = run(simulator, plan)
    equal(motion.ticks, [plan.ticks, 20])
    one, other = motion.torso
    assert (other[19:] == one[19]).all(), "after 20 ticks one robot is done, and the other goes on"
    rest = simulator.run([1], Moving(plan.joints[1:, 20:], plan.move[1:, 20:]))
    hint = "what it does next is what the other one has done: is a part of the state forgotten?"
    equal(rest.torso[0], one[20:], hint)


@BOTH
def test_a_push_gives_momentum_to_the_torso_while_it_lasts(sim):
    torso, joints = stance(sim)
    torso[2] = 1.0  # in the air, where no ground takes a share
    trajectory = still(sim, 3, 0.12)
    speeds = np.array([[0.6, 0, 0], [0, -0.2, 0], [0, 0, 0]])  # [m/s] ahead, to the right, none
    disturbance = robot_model.Disturbance.none(trajectory)
    force = walk_engine.push_force(ROBOT, speeds[:, None, :2])
    disturbance.push[:, 3 : 3 + walk_engine.PUSH_TICKS] = force
    simulator = make_sim(sim, 3, (torso, joints))
    motion = run(simulator, trajectory, disturbance)
    got = mass_velocity(motion)
    speeds[1, 1] *= sim == "mujoco"  # nobody is pushed out of a plane
    want = ROBOT.torso.mass * speeds
    hint = "force·time, of this robot, in these ticks only; none up or down"
    close(MASS * (got - got[2]), want, hint, atol=0.01)
    assert simulator.state[0, 19] > 0.1, "it is pushed above its hips, so it also turns"


@BOTH
def test_the_imu_is_read_in_every_tick_with_the_gyro_s_constant_error(sim):
    simulator, plan, rng, errors = make_sim(sim), still(sim, 1, 0.4), default_rng(1), []
    body, go_on = bodies(1), plan.go_on
    simulator.reset([0], body)

    def measured(rows, tick, imu):
        # roll, pitch and their rates: measured − true
        errors.append(imu[0] - simulator.state[0, [3, 4, 18, 19]])
        return go_on(rows, tick, imu)

    plan.go_on = measured
    push, imu = rng.normal(0, 20, (1, 40, 2)), rng.normal(0, 0.2, (1, 40, 4))
    run(simulator, plan, robot_model.Disturbance(push, imu))
    want = imu[0] + [0, 0, *body.gyro[0]]
    close(
        errors, want, "as now, plus the error of this very tick, and the constant one of the rates"
    )


def sliding(sim, ticks, degrees=0):
    """The μ that acts on two robots that are thrown in this direction; the second one drew 0.4."""
    simulator = make_sim(sim, 2)
    simulator.reset([1], replace(robot_model.Variation.as_model(ROBOT, 1), friction=[0.4]))
    run(simulator, still(sim, 2, 1.0))  # the weight settles on the soles
    thrown = math.cos(math.radians(degrees)), math.sin(math.radians(degrees)), 0
    for i in range(2):
        throw(simulator, i, *thrown)
    # Few ticks: later it rocks, a toe digs in, and a foot that turns slides elsewhere.
    motion = run(simulator, still(sim, 2, ticks * DT))
    change = mass_velocity(motion) - thrown
    # ∫ horizontal force / ∫ vertical force = μ; that a foot bounces does not matter.
    # The velocity is the mean of the last two physics steps; pymunk moves a body, then brakes it.
    fall = ROBOT.gravity * (2 * ticks - (1.5 if sim == "pymunk" else 0.5)) * STEP
    return np.hypot(change[:, 0], change[:, 1]) / (change[:, 2] + fall)


def test_mujoco_foot_slides_alike_in_all_directions_with_the_friction_it_drew():
    for degrees in 0, 45, 90:
        hint = f"μ at {degrees}°: only at 45°: a pyramid; else: the larger of two values?"
        close(sliding("mujoco", 2, degrees), [ROBOT.friction, 0.4], hint, rtol=0.05)


def test_planar_foot_slides_with_the_friction_it_drew():
    hint = "μ; pymunk MULTIPLIES the friction of both shapes"
    close(sliding("pymunk", 4), [ROBOT.friction, 0.4], hint, rtol=0.02)


def test_planar_joints_stay_together_and_keep_their_speed_limits():
    engine, simulator = walk_engine.walkers("pymunk", 1)
    simulator.reset([0])
    for _ in range(4):
        joints = run(simulator, engine.plan([[[0.1, 0, 0.3], [0.1, 0, -0.3]]], [0])).joints[0]
        speed = np.abs(np.diff(joints, axis=0)).max(0) / DT
        assert (speed < 1.1 * np.tile(ROBOT.speed_limit, 2)).all(), f"{speed} rad/s: too fast"
        for p in simulator.worlds[0][0].constraints:
            if isinstance(p, pymunk.PivotJoint):
                gap = p.a.local_to_world(p.anchor_a) - p.b.local_to_world(p.anchor_b)
                assert gap.length < 0.002, f"{gap.length} m apart: more solver iterations"


def test_mujoco_motors_keep_torque_and_speed_limits():
    limits = ROBOT.torque_limit, ROBOT.speed_limit, ROBOT.damping
    limit, fast, damping = np.tile(limits, 2)
    model, data = mujoco_at(*stance("mujoco"))
    # Far from its target a motor pushes with all it has, less back-EMF, which also brakes a joint
    # that the robot's own weight throws beyond its speed limit (a knee in a long swing).
    for share in (0.0, 0.5, 1.0, 1.25):
        data.ctrl[:] = data.qpos[6:] + 3.0
        data.qvel[6:] = share * fast
        mujoco.mj_forward(model, data)
        torque = data.qfrc_actuator[6:] + data.qfrc_passive[6:]
        close(torque, limit - damping * share * fast, "a line that falls with the speed")


def test_mujoco_robots_get_what_they_drew_each_in_a_model_of_its_own():
    simulator, body, like = make_sim("mujoco", 3), bodies(2), nominal()
    for _ in range(2):  # factors must not pile up from reset to reset
        simulator.reset([2, 0], body)
    equal(simulator.models[1].body_mass, like.body_mass, "robot 1 shares what others drew")
    close(like.geom("left sole").pos[1], ROBOT.foot_outward, "the sole is outside of its ankle")

    def drawn(name):
        return np.array([getattr(simulator.models[i], name) for i in (2, 0)])

    mass, moved = drawn("body_mass")[:, 1:], drawn("body_ipos") - like.body_ipos
    close(mass, body.mass * like.body_mass[1:], "torso; left hip, thigh, shin, foot; right ones")
    inertia = body.mass[..., None] * like.body_inertia[1:]
    close(drawn("body_inertia")[:, 1:], inertia, "the same shape, and so many times as heavy")
    hint = "what MuJoCo derives from the masses is old: mj_setConst"
    close(drawn("body_subtreemass")[:, 1], mass.sum(1), hint)
    close(moved[:, 1], body.com, "of the torso's centre of mass in its own frame")
    stiffness = body.stiffness * ROBOT.stiffness
    close(drawn("actuator_gainprm")[..., 0], stiffness, "left leg, then right leg")
    hint = "τ = stiffness·(target − q); else the zero moves"
    close(drawn("actuator_biasprm")[..., 1], -stiffness, hint)
    friction = np.pad(body.stiction * np.tile(ROBOT.stiction, 2), ((0, 0), (6, 0)))
    close(drawn("dof_frictionloss"), friction, "at the joints; nothing holds the torso in the air")


def test_planar_robots_get_what_they_drew():
    simulator, body = make_sim("pymunk", 3), bodies(2)
    simulator.reset([2, 0], body)

    def of(i, name):
        return np.array([getattr(link, name) for link in simulator.worlds[i][1]])

    mass, rotors = of(1, "mass"), np.append(0, np.full(6, ROBOT.armature))
    plan, rate = still("pymunk", 3, 2 * DT), 0.5  # [rad/s]
    plan.joints += 0.01 + rate * DT * np.arange(3)[:, None]
    error = plan.joints[:, 1] - run(simulator, plan).joints[:, 0]
    for row, i in enumerate([2, 0]):
        _, _, motors = simulator.worlds[i]
        factor = body.mass[row, PLANAR]
        close(of(i, "mass"), factor * mass, "torso; left thigh, shin, foot; right ones")
        moment = factor * (of(1, "moment") - rotors)
        close(of(i, "moment") - rotors, moment, "so many times as heavy, but the rotors")
        moved = of(i, "center_of_gravity") - of(1, "center_of_gravity")  # [7, 2]
        torso = ROBOT.torso.mass * body.com[row, [0, 2]]
        close(mass[0] * moved[0], torso, "the torso's centre of mass; the hips' motors stay")
        want = rate + ROBOT.planar_gain * body.stiffness[row] * error[i]
        speed = [motor.rate for motor in motors]  # in the second tick
        close(speed, want[SAGITTAL], "that of the target + gain·stiffness·error", rtol=1e-4)
        left = np.tile(ROBOT.torque_limit, 2) - body.stiction[row] * np.tile(ROBOT.stiction, 2)
        torque = [motor.max_force for motor in motors]
        close(torque, left[SAGITTAL], "what dry friction leaves of the largest torque")


@BOTH
def test_a_delayed_robot_moves_as_one_that_is_sent_the_mixture_of_two_targets(sim):
    """And a joint with a wrong zero goes as far beside its target."""
    simulator, body, rng = (
        make_sim(sim, 4),
        robot_model.Variation.as_model(ROBOT, 2),
        default_rng(6),
    )
    body.delay[:], body.zero[:] = [1, 0.5], rng.uniform(-0.02, 0.02, (2, 12))
    simulator.reset([0, 1], body)
    given = stance(sim)[1] + rng.uniform(-0.1, 0.1, (2, 41, 12))
    given[:, 0] = stance(sim)[1]  # at first it stands
    sent = given + body.zero[:, None]
    sent[0, 1:], sent[1, 1:] = sent[0, :-1], (sent[1, :-1] + sent[1, 1:]) / 2
    simulator.last_sent[2:] = sent[:, 0]
    joints = np.concatenate([given, sent])
    for k in 0, 20:  # two runs
        torso = run(simulator, Moving(joints[:, k : k + 21])).torso
        hint = (
            "every target, also the last of a run, comes a tick later, or half of it with half of "
            "the next one; and a motor holds target + zero, in every tick"
        )
        close(torso[:2], torso[2:], hint)


@BOTH
def test_robots_move_alike_whoever_else_moves_or_is_reset(sim):
    rng, everybody = default_rng(1), np.arange(4)
    footsteps = np.linspace(1, 0.6, 4)[:, None, None] * [[0.06, 0, 0.1], [0.06, 0, -0.1]]
    push, imu = rng.normal(0, 10, (4, 102, 2)), rng.normal(0, 0.03, (4, 102, 4))

    some, whole, fresh = teams = [walk_engine.walkers(sim, 4) for _ in range(3)]
    for _, simulator in some, whole:
        simulator.reset([2, 3, 0, 1], replace(bodies(4), delay=[1, 0, 0.5, 1]))
    fresh[1].reset(everybody)

    def double_step(team, robots=everybody):
        engine, simulator = team
        plan = engine.plan(footsteps[robots], robots)
        disturbance = robot_model.Disturbance(push[robots], imu[robots])
        return ends(simulator.run(robots, plan, disturbance))

    want = double_step(whole)
    assert sim == "pymunk" or len({*want[:, -1]}) > 1, "some should wait longer than others"
    for robots in [2], [3, 1, 0]:
        hint = "are rows, robots, their bodies and what disturbs them matched?"
        equal(double_step(some, robots), want[robots], hint)
    for one in (*some, *fresh):
        one.reset([1])
    got, want, new = map(double_step, teams)
    equal(got[[0, 2, 3]], want[[0, 2, 3]], "robot 1 was reset, and others changed")
    equal(got[1], new[1], "a reset keeps something of the last walk, or body")


@BOTH
def test_a_diverged_robot_is_a_silent_fall_of_its_own(capfd, sim):
    def stand(simulator):
        return run(simulator, still(sim, 4, 0.5))

    simulator, want = make_sim(sim, 4), ends(stand(make_sim(sim, 4)))
    throw(simulator, 1, math.nan)
    throw(simulator, 2, 1e12)
    motion = stand(simulator)
    hint = "a state that is not finite is a fall; comparisons with nan are always False"
    equal(motion.fell, [False, True, True, False], hint)
    equal(ends(motion)[[0, 3]], want[[0, 3]], "the others go on")
    moved = motion.torso[1:3] - stance(sim)[0]
    close(moved, 0, "finite, where it was last seen: no teleport", atol=0.01)
    simulator.reset([1, 2])
    equal(ends(stand(simulator))[[1, 2]], want[[1, 2]], "a reset cures it")
    assert capfd.readouterr() == ("", ""), "MuJoCo's warnings, of which it also writes a file"


def test_a_planar_robot_turns_and_moves_sideways_exactly_as_commanded():
    plan = leaning("pymunk", [0.1, 0.1], 0.3)
    plan.move[1] = default_rng(0).uniform(-0.05, 0.05, (plan.ticks, 3))
    torso = run(make_sim("pymunk", 2), plan).torso
    ground = np.pad(torso[..., robot_model.GROUND], ((0, 0), (1, 0), (0, 0)))  # and the origin
    steps = robot_model.relative(ground[:, :-1], ground[:, 1:])  # [2, T, 3]
    close(steps[..., 1:], plan.move[..., 1:], "sideways and yaw, seen from where it was")
    close(steps[1, :, 0], steps[0, :, 0], "ahead it moves as simulated")
    equal(torso[1, :, 2:5], torso[0, :, 2:5], "which changes nothing of its fall")


def test_a_robot_is_painted_from_the_farthest_limb_to_the_nearest_one():
    axes, (torso, joints) = robot_model.Figure().subplots(), stance("mujoco")
    from_its_right, from_above = (robot_model.camera_at(-90, height) for height in (0, 90))
    close(from_above, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], "rows: up; ahead is right; left is up")
    robot_model.draw_robots(axes, ROBOT, torso[None], joints[None], from_its_right)
    colors = [patch.get_facecolor() for patch in axes.patches]
    legs = [red > blue for red, _, blue, _ in colors if abs(red - blue) > 0.1]  # the trunk is grey
    hint = "first the left leg, blue, in front of it the right one, orange: thigh, shin, foot"
    assert legs == [False] * 3 + [True] * 3, hint


def test_without_out_everything_goes_below_the_simulators_folder_in_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    args = robot_model.stage_parser("").parse_args(["--mujoco"])
    folder = robot_model.output_folder(args, "studies")
    assert folder == Path("runs", "mujoco", "studies") and folder.is_dir()


def test_a_file_is_there_as_a_whole_or_as_it_was(tmp_path, monkeypatch):
    path, used = tmp_path / "policy.pt", []
    path.write_text("old")
    # RuntimeError: of matplotlib without LaTeX, and of PyTorch on a full disk
    errors = [RuntimeError("latex could not be found"), OSError(28, "No space left")]

    def write(temporary):
        used.append(temporary)
        temporary.write_text("new")
        assert path.read_text() == "old", "nobody may see a file that is half written"
        if errors:
            raise errors.pop()

    for said in "No space left", "latex could not be found":
        with pytest.raises(robot_model.InputError, match=f"policy.pt: {said}"):
            robot_model.atomic_write(path, write)
    monkeypatch.setattr(os, "getpid", lambda: -1)  # another process
    robot_model.atomic_write(path, write)
    assert path.read_text() == "new" and [*tmp_path.iterdir()] == [path], "no rest"
    assert used[0] != used[-1], "two processes that write one file would mix"


def test_a_name_that_is_no_text_costs_no_file(tmp_path):
    robot_model.write_text(tmp_path / "table.md", os.fsdecode(b"walk\xff.pt falls\n"))
    assert (tmp_path / "table.md").read_bytes() == b"walk?.pt falls\n"
