"""Stage 1, checked against physics. A failing test names the likely mistake."""

import math
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import cache
from importlib import import_module
from itertools import combinations, product

import mujoco
import numpy as np
import pymunk
import pytest
from checks import close, equal, frozen
from numpy.random import default_rng

robot_model = import_module("01_robot_model")
walk_engine = import_module("02_walk_engine")

ROBOT = robot_model.RobotModel()
STEP = ROBOT.control_dt / ROBOT.substeps  # [s] of physics
LINKS = (ROBOT.torso, *2 * (ROBOT.hip, ROBOT.thigh, ROBOT.shin, ROBOT.foot))
MASS = sum(link.mass for link in LINKS)
# Walks that keep to their plan; the tests of stage 2 see how others answer a push.
STRICT = {name: replace(p, capture=0, wait=0) for name, p in walk_engine.TUNED.items()}
BOTH = pytest.mark.parametrize("name", ["pymunk", "mujoco"])
OTHER = replace(ROBOT, hip_x=0.0, thigh=ROBOT.shin, shin=ROBOT.thigh)
ROBOTS = pytest.mark.parametrize("robot", [ROBOT, OTHER], ids=["ours", "another"])


@pytest.fixture
def make_sim(tmp_path, monkeypatch):
    """make_sim(name, N, ...): a simulator whose robots stand; closed after the test."""

    def make(name, num_robots=1, cores=1, standing=None, robot=ROBOT):
        sim = robot_model.make_sim(name, num_robots, standing or stance(name), robot, cores)
        return stack.enter_context(closing(sim))

    monkeypatch.chdir(tmp_path)  # where MuJoCo would write its log
    with ExitStack() as stack:
        yield make


def stance(name):
    """Torso pose [6] and joints [12] from which a simulator starts."""
    return robot_model.stance(ROBOT, planar=name == "pymunk")


def still(name, num_robots, seconds):
    """The WalkPlan of robots that only stand, without a reflex."""
    ticks = round(seconds / ROBOT.control_dt)
    engine = walk_engine.WalkEngine(num_robots, STRICT[name], ROBOT, name == "pymunk")
    joints = np.tile(stance(name)[1], (num_robots, ticks + 1, 1))
    trunk, feet = (np.zeros((num_robots, ticks + 1, *shape)) for shape in ((6,), (2, 4)))
    gain = np.zeros((num_robots, ticks, 2))
    return walk_engine.WalkPlan(joints, trunk, feet, gain, np.arange(num_robots), engine)


def leaning(name, angles, seconds):
    """A Trajectory that leans forward by these angles [N], minimum jerk, then stands for 2 s."""
    trajectory = still(name, len(angles), seconds + 2.0)
    tau = np.minimum(np.arange(trajectory.joints.shape[1]) * ROBOT.control_dt / seconds, 1)
    share = 10 * tau**3 - 15 * tau**4 + 6 * tau**5
    trajectory.joints[..., [4, 10]] -= (np.array(angles)[:, None] * share)[..., None]
    return trajectory


def planar_mean(bodies, what):
    """The mean position or velocity of these bodies by their masses, x and z."""
    masses = [body.mass for body in bodies]
    return np.average([getattr(body, what) for body in bodies], 0, masses)


def pivots_of(space):
    """What holds hip, knee and ankle together; left, then right."""
    return [joint for joint in space.constraints if isinstance(joint, pymunk.PivotJoint)]


def part(plan, first, last):
    """A plan from the first to the last of these samples of its joints."""
    timed = {name: vars(plan)[name][:, first : last + 1] for name in ("joints", "trunk", "feet")}
    return replace(plan, **timed, reflex_gain=plan.reflex_gain[:, first:last])


def single_ticks(trajectory):
    """The same trajectory as a list of short ones, to look at the robot in between."""
    return [part(trajectory, k, k + 1) for k in range(trajectory.most_ticks)]


def walking(name, num_robots, footsteps, count, robot=ROBOT):
    """Trajectories of `count` equal double steps, shorter ones for later robots; and the stance."""
    p = STRICT[name]
    p = replace(p, half_ticks=round(p.half_ticks * ROBOT.control_dt / robot.control_dt))
    engine = walk_engine.WalkEngine(num_robots, p, robot, name == "pymunk")
    footsteps = np.linspace(1, 0.6, num_robots)[:, None, None] * footsteps  # [N, 2, 3]
    everybody = np.arange(num_robots)
    return [engine.plan(footsteps, everybody) for _ in range(count)], engine.stance


def disturbed(plan):
    """A noisy gyro, and every robot is pushed ahead for 50 ms, during this plan."""
    disturbance = robot_model.Disturbance.none(plan)
    disturbance.gyro_error[:] = default_rng(1).normal(0, 0.2, disturbance.push.shape)
    disturbance.push[:, 10:15, 0] = 30
    return disturbance


SPREAD = {"friction": 0.3, "mass": 0.1, "stiffness": 0.2, "stiction": 1.5}


def bodies(count, delay=0, **spread):
    """Robots that differ from the model by at most so much."""
    body, rng = robot_model.Body.as_model(ROBOT, count), default_rng(0)
    for name, width in spread.items():
        values = getattr(body, name)
        values += width * rng.uniform(-1, 1, values.shape)
    body.stiction = np.abs(body.stiction)
    body.delay[:] = delay
    return body


def assert_same_motion(got, want, rows, want_rows, hint):
    """Some rows of a Motion equal some rows of another one, bit for bit."""
    for field, values in vars(got).items():
        equal(values[rows], vars(want)[field][want_rows], f"{field}: {hint}")


def quaternion(angles):
    """(w, x, y, z) of Rz(yaw)·Ry(pitch)·Rx(roll), by MuJoCo; roll, pitch, yaw [3]."""
    result = np.zeros(4)
    mujoco.mju_euler2Quat(result, angles, "XYZ")
    return result


@cache
def nominal(robot=ROBOT):
    return robot_model.mujoco_model(robot)


def mujoco_at(torso, joints, robot=ROBOT):
    """MuJoCo's model and data of a robot with this torso pose [6] and these joints [12]."""
    model = nominal(robot)
    data = mujoco.MjData(model)
    data.qpos[:3], data.qpos[3:7], data.qpos[7:] = torso[:3], quaternion(torso[3:]), joints
    mujoco.mj_forward(model, data)
    return model, data


def mujoco_data(sim, i=0):
    """MuJoCo's data of robot i of a simulator, as it is now."""
    model = sim.models[i]
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, sim.state[i], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    mujoco.mj_forward(model, data)
    return data


def velocity(model, data):
    """Of the robot's centre of mass in MuJoCo, [3] [m/s]."""
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    return data.subtree_linvel[0].copy()


def test_compose_multiplies_matrices_and_relative_undoes_it():
    for shape in (40,), (), (2, 4):  # a batch, one pose, rows of poses
        poses = default_rng(2).uniform(-1, 1, (2, *shape, 3)) * [1, 1, 3]
        frozen(poses)
        base, inner = poses
        got = robot_model.compose(base, inner)
        frozen(got)
        (a, turn), (b, _), (c, _) = (  # places as x + i·y, turns as factors
            (p[..., 0] + 1j * p[..., 1], np.exp(1j * p[..., 2])) for p in (base, inner, got)
        )
        close(c, a + turn * b, "first turn the pose by the base's yaw, then add the base's place")
        close(
            got[..., 2],
            poses[..., 2].sum(0),
            "yaws add up, without wrap: a foot that turns on and on must not jump",
        )
        close(
            robot_model.relative(base, got),
            inner,
            "relative undoes compose: first subtract the base's place, then turn back, by −yaw",
        )


def test_wrap_keeps_the_direction_and_stays_within_half_a_turn():
    angles = np.concatenate([np.linspace(-20, 20, 101), [math.pi, -math.pi, 3 * math.pi]])
    frozen(angles)
    wrapped = robot_model.wrap(angles)
    outside = np.abs(wrapped) > math.pi + 1e-9
    assert not outside.any(), (
        f"[−π, π): {angles[outside][0]:.2f} becomes {wrapped[outside][0]:.2f}, too few turns are "
        "taken away, or too many"
    )
    assert (wrapped < math.pi).all(), "[−π, π): π becomes −π"
    close(
        np.exp(1j * wrapped),
        np.exp(1j * angles),
        "whole turns only are taken away: cos + i·sin stays, for it is the same direction",
    )


def random_joints(rng, count):
    """Joint angles [count, 12] inside the limits, knees bent, hips above the soles."""
    low, high = [-1.0, -0.6, -1.2, 0.05, -1.2, -0.6], [1.0, 0.6, 0.6, 2.2, 0.3, 0.6]
    return rng.uniform(np.tile(low, 2), np.tile(high, 2), (count, 12))


@ROBOTS
def test_forward_kinematics_equals_mujoco(robot):
    rng = default_rng(0)
    poses = random_joints(rng, 50)
    torsos = np.concatenate([rng.normal(size=(50, 3)), rng.uniform(-1.2, 1.2, (50, 3))], 1)
    frozen(poses)
    found = robot_model.body_points(robot, torsos, poses)  # [50, 2, 5, 3], [50, 2, 3, 3]
    for torso, joints, points, turn in zip(torsos, poses, *found):
        model, data = mujoco_at(torso, joints, robot)
        for leg, (side, sign) in enumerate((("left", 1), ("right", -1))):
            for k, name in enumerate(("thigh", "shin", "foot")):  # a body sits at its upper joint
                close(
                    points[leg, k],
                    data.body(f"{side} {name}").xpos,
                    f"{side} {name}: a length, the sign of a pitch, pitches that do not add up, or "
                    "the order of hip yaw and roll?",
                )
            sole, foot = data.geom(f"{side} sole"), data.body(f"{side} foot")
            close(
                turn[leg],
                foot.xmat.reshape(3, 3),
                "the rotation that is returned is the foot's: is the ankle's roll in it, and "
                "behind all pitches?",
            )
            length, _, thick = model.geom(f"{side} sole").size
            for k, x in ((3, -length), (4, length)):  # heel, toe: below the ankle's axis
                corner = [x, -sign * ROBOT.foot_outward, -thick]
                want = sole.xpos + sole.xmat.reshape(3, 3) @ corner
                close(
                    points[leg, k],
                    want,
                    "heel or toe: foot_front and foot_back swapped, or the ankle's height?",
                )


@ROBOTS
def test_centre_of_mass_is_that_of_mujoco_for_parallel_feet(robot):
    for joints in random_joints(default_rng(3), 20):
        joints[6:] = joints[:6]
        joints[[0, 1, 5, 6, 7, 11]] = 0
        torso = np.array([0.3, -0.2, 0.4, 0.0, 0.2, 0.0])
        data = mujoco_at(torso, joints, robot)[1]
        got = robot_model.centre_of_mass(robot, torso[None], joints[None])[0]
        close(got, data.subtree_com[0], "Σ mᵢ·pᵢ / Σ mᵢ, over all nine links", atol=1e-9)


def test_euler_angles_of_a_quaternion():
    angles = default_rng(1).uniform(-1.4, 1.4, (50, 3)) * [2, 1, 2]
    close(robot_model.euler([quaternion(turn) for turn in angles]), angles)


@ROBOTS
def test_leg_inverse_undoes_forward(robot):
    joints = random_joints(default_rng(2), 500).reshape(-1, 2, 6)
    points, foot = robot_model.leg_points(robot, joints)
    got = robot_model.leg_inverse(robot, points[..., 2, :], foot)
    assert got.shape == joints.shape, "positions [..., 3] in, joint angles [..., 6] out"
    got, joints = got.reshape(-1, 6), joints.reshape(-1, 6)
    wrong = ~np.isclose(got, joints, rtol=0, atol=1e-6).all(0)  # [6] hip 0, 1, 2; knee 3; ankle
    names = np.array(robot_model.JOINTS)
    cause = (
        "does the knee bend the other way?"
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
def test_body_inverse_puts_the_feet_where_they_should_be(name):
    rng, n, planar = default_rng(3), 200, name == "pymunk"
    trunk = rng.uniform([-1, -1, 0.36, -0.1, -0.1, -3], [1, 1, 0.39, 0.1, 0.2, 3], (n, 6))
    trunk[:, 3] *= not planar
    away = rng.uniform([-0.05, 0.07, -0.3], [0.05, 0.11, 0.3], (n, 2, 3)) * [[1, 1, 1], [1, -1, 1]]
    height = rng.uniform(0, 0.03, (n, 2, 1))
    here = trunk[:, None, [0, 1, 5]]
    feet = np.insert(robot_model.compose(here, away), [2], height, -1)  # [n, 2, 4]
    joints = robot_model.body_inverse(ROBOT, trunk, feet, planar)
    if planar:
        lacking = np.delete(joints, robot_model.SAGITTAL, 1)
        close(lacking, 0, "a plane has no hip yaw and no rolls")
        away[..., 1], away[..., 2] = ROBOT.hips[:, 1], 0  # legs below their hips
    error = robot_model.foot_poses(ROBOT, trunk, joints) - robot_model.compose(here, away)
    error[..., 2] = robot_model.wrap(error[..., 2])
    close(error, 0)
    points, _ = robot_model.body_points(ROBOT, trunk, joints)
    close(points[..., 3:, 2], height.repeat(2, -1), "soles must be level")


@ROBOTS
def test_inverse_pulls_a_pose_out_of_reach_along_the_line_from_the_hip(robot):
    for knee, hint, *positions in (
        (0.0, "too far: a straight leg", [0.0, 0, -0.5], [0.1, 0.05, -0.4], [-0.05, -0.02, -9.0]),
        (robot.joint_max[3], "too near: a folded leg (the knee at its joint limit, not |thigh − shin|)",
         [0.03, 0.0, -0.04], [0.01, 0.012, -0.03], [0.02, -0.02, -0.01]),
    ):  # fmt: skip
        hip, _, ankle, _, _ = robot_model.leg_points(robot, [0, 0, 0, knee, 0, 0])[0]
        reach = np.linalg.norm(ankle - hip)
        for position, yaw in zip(np.add(positions, [robot.hip_x, 0, 0]), (0.0, 0.4, -0.5)):
            frozen(position)
            foot = robot_model.rotation(*np.array([0, 0, yaw]))
            joints = robot_model.leg_inverse(robot, position, foot)
            points, got = robot_model.leg_points(robot, joints)
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
    rolled[:, 1] = math.pi / 2 * rng.choice([-1, 1], 200)
    points, turn = robot_model.leg_points(ROBOT, rolled)
    for length in np.linspace(0.1, 0.3, 20):
        robot = replace(ROBOT, thigh_length=length)
        more = robot_model.leg_inverse(robot, 9 * points[:, 2], turn)
        assert np.isfinite([*joints, *more]).all(), (
            "arccos and arcsin need their argument clipped to ±1"
        )
    assert (joints >= ROBOT.joint_min).all() and (joints <= ROBOT.joint_max).all(), (
        "at last clip the angles to the joint limits"
    )


MUJOCO_LINKS = [
    "torso",
    *(f"{side} {link}" for side in ("left", "right") for link in ("hip", "thigh", "shin", "foot")),
]


def test_every_link_of_mujoco_has_the_mass_the_centre_and_the_inertia_of_the_table():
    for name, link in zip(MUJOCO_LINKS, LINKS):
        body, side = nominal().body(name), -1 if name.startswith("right") else 1
        close(body.mass, link.mass, f"{name}: plus that of a geom?")
        close(body.inertia, link.inertia, f"{name}: of x, y, z", atol=1e-9)
        close(
            body.ipos,
            np.multiply(link.com, [1, side, 1]),
            f"{name}: y of a leg's centre of mass is outward, so the right one's is mirrored",
        )


def test_soles_touch_the_ground_and_one_another_and_nothing_else_touches():
    model, data = mujoco_at(*robot_model.stance(ROBOT, foot_distance=0.05))
    touching = {tuple(model.geom(geom).name for geom in sorted(pair)) for pair in data.contact.geom}
    assert touching == {*combinations(("ground", "left sole", "right sole"), 2)}


@ROBOTS
def test_mass_its_centre_and_its_inertia_are_the_same_in_both_simulators(make_sim, robot):
    torso, joints = standing = robot_model.stance(robot, planar=True)
    model, data = mujoco_at(torso, joints, robot)
    bodies = make_sim("pymunk", standing=standing, robot=robot).spaces[0].bodies
    close(sum(body.mass for body in bodies), MASS, "are both hip motors in the planar torso?")
    centre = planar_mean(bodies, "position")
    close(centre, data.subtree_com[0][[0, 2]], "masses are elsewhere in one")
    # Turning the stiff robot about y: I = Σ (Iᵢ + mᵢ·dᵢ²); without the rotors of its six motors
    got = sum(body.moment + body.mass * abs(body.position - centre) ** 2 for body in bodies)
    away = data.xipos[1:, [0, 2]] - centre  # MuJoCo's body 0 is the world
    along = data.ximat[1:].reshape(-1, 3, 3)[:, 1]  # the y axis seen from each body
    want = (along**2 * model.body_inertia[1:]).sum() + model.body_mass[1:] @ (away**2).sum(1)
    close(got - 6 * ROBOT.armature, want, "planar torso: parallel axes of its three parts")


@BOTH
def test_motors_cannot_push_a_joint_through_its_limit(make_sim, name):
    sim, limits = make_sim(name, 2), np.tile([ROBOT.joint_min, ROBOT.joint_max], 2)  # [2, 12]
    sign = np.array([-1, 1])[:, None, None]
    far = still(name, 2, 1.0)
    slowly = np.linspace(0, 1, 101)[:, None]  # a joint that is thrown goes farther
    far.joints += slowly * (limits[:, None] + 0.5 * sign - far.joints)
    seen = range(12) if name == "mujoco" else robot_model.SAGITTAL
    beyond = sign * (sim.run(np.arange(2), far).joints - limits[:, None])
    beyond = beyond[..., seen].max(1)  # [2, 12] or [2, 6]
    assert (beyond < 0.1).all(), f"{beyond.round(2)} rad beyond: has the simulator the limits?"
    assert ((beyond > 0).sum(1) >= 4).all(), "the test should push against some limits"


@BOTH
@pytest.mark.parametrize("what", ["walks", "falls"])
def test_motion_tells_where_the_bodies_are(make_sim, name, what):
    (plan,), standing = walking(name, 1, [[0.08, 0, 0], [0.08, 0, 0]], 1)
    trajectory = part(plan, 0, 15)  # until the left foot is in the air
    if what == "falls":
        trajectory, standing = part(leaning(name, [0.4], 0.5), 0, 54), stance(name)
    sim = make_sim(name, standing=standing)
    motion = sim.run([0], trajectory)
    points, turn = robot_model.body_points(ROBOT, motion.torso[0, -1], motion.joints[0, -1])
    lifted, tilt = points[0, 3:, 2].min(), motion.torso[0, -1, 4]
    assert tilt > 0.6 if what == "falls" else lifted > 0.005, "the test should see that"
    points = points[:, :3].reshape(6, 3)  # hip, knee, ankle; left, right
    if name == "mujoco":
        links = (
            f"{side} {link}" for side in ("left", "right") for link in ("thigh", "shin", "foot")
        )
        want = [mujoco_data(sim).body(link).xpos for link in links]
        close(points, want, "a named column of the state is another one")
        return
    pivots = pivots_of(sim.spaces[0])
    want = [p.b.local_to_world(p.anchor_b) for p in pivots]
    hint = "the torso frame is below the centre of its body; a pitch is minus an angle"
    close(points[:, [0, 2]], want, hint, atol=2e-3)
    pitch = np.arctan2(-turn[:, 2, 0], turn[:, 0, 0])  # of both feet
    close(pitch, [-pivots[k].b.angle for k in (2, 5)], "the ankle's pitch?")
    lacking = np.delete(np.arange(12), robot_model.SAGITTAL)
    equal(motion.joints[..., lacking], trajectory.joints[:, 1:, lacking], "reported as commanded")


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
            f"{('no', 'a')[fell]} fall" + any((roll, pitch)) * ": cos(tilt) = cos roll · cos pitch"
        )


@BOTH
def test_a_robot_let_go_in_the_air_drops_freely_and_has_fallen_half_way(make_sim, name):
    torso, joints = stance(name)
    torso[2] = 1.0
    sim = make_sim(name, standing=(torso, joints))
    motion = sim.run([0], still(name, 1, 0.31))  # half of it takes √(1 m / 9.81 m/s²) = 0.319 s
    time = ROBOT.control_dt * np.arange(1, 32)
    off = 1 - motion.torso[0, :, 2] - ROBOT.gravity * time**2 / 2
    assert (np.abs(off) < ROBOT.gravity * time * STEP / 2 + 1e-6).all(), (  # of Euler's method
        f"{off} m: z is that of the torso's frame, or something holds the robot in the air"
    )
    assert not motion.fell[0], "half of the height at which it stood is a fall, not more"
    assert sim.run([0], still(name, 1, 0.02)).fell[0], "below half of its height it has fallen"
    if name == "mujoco":
        sim.state[0, 22] = 2.0  # thrown up again [m/s]
    else:
        for body in sim.spaces[0].bodies:
            body.velocity = 0.0, 2.0
    motion = sim.run([0], still(name, 1, 0.1))
    assert motion.fell[0] and motion.torso[0, -1, 2] > 0.55, "looked for at every control tick"


@BOTH
def test_robot_falls_when_its_centre_of_mass_passes_its_toes(make_sim, name):
    def ahead(angle):
        """Statics: how far the centre of mass is ahead of the toes [m]."""
        joints = stance(name)[1]
        joints[[4, 10]] -= angle
        data = mujoco_at([0, 0, 0, 0, -joints[2:5].sum(), 0], joints)[1]  # the soles are level
        return data.subtree_com[0][0] - data.body("left foot").xpos[0] - ROBOT.foot_front

    tips = next(angle for angle in np.arange(0, 1, 0.005) if ahead(angle) > 0)
    angles = tips + np.array([-0.1, -0.04, 0.02, 0.1])
    motion = make_sim(name, 4).run(np.arange(4), leaning(name, angles, 4.0))
    equal(
        motion.fell,
        [False, False, True, True],
        f"leaning slowly by {angles.round(2)} rad: the statics say it tips at {tips:.2f} rad",
    )


@BOTH
def test_fall_of_a_motion_follows_the_criterion_at_every_tick(make_sim, name):
    trajectory = leaning(name, np.linspace(0.15, 0.4, 8), 0.5)
    trajectory.trunk[..., 5] = np.linspace(0, 2, trajectory.most_ticks + 1)
    motion = make_sim(name, 8).run(np.arange(8), trajectory)
    down = robot_model.fallen(motion.torso, stance(name)[0][2])  # [N, T]
    assert down.any() and not down.all(1).any(), "the test should see robots up and down"
    equal(motion.fell, down.any(1), "half the standing height, or 45°, at any control tick")
    sim, first = make_sim(name), np.argmax(down.any(1))
    until = part(robot_model.some_rows(trajectory, [first]), 0, np.argmax(down[first]) + 1)
    pieces = [sim.run([0], piece) for piece in single_ticks(until)]
    fell = [piece.fell[0] for piece in pieces]
    equal(fell, down[first, : len(fell)], "a fall is seen in its very tick, not earlier")
    ends = [piece.torso[0, 0] for piece in pieces]
    hint = "a part of the state is forgotten between two runs"
    close(ends, motion.torso[first, : len(ends)], hint)


@BOTH
def test_the_reflex_brakes_what_a_push_begins(make_sim, name):
    gains, pushes = [0.05, 0.0, -0.05], [(1, 0), (-1, 0), *[(0, 1), (0, -1)] * (name == "mujoco")]
    count = 3 * len(pushes)
    trajectory = still(name, count, 3.0)
    trajectory.reflex_gain[:, 10:] = np.tile(gains, len(pushes))[:, None, None]
    force = ROBOT.torso.mass * 0.6 / 0.05  # m·Δv / t [N], for 50 ms
    disturbance = robot_model.Disturbance.none(trajectory)
    disturbance.push[:, 10:15] = force * np.repeat(pushes, 3, 0)[:, None]
    motion = make_sim(name, count).run(np.arange(count), trajectory, disturbance)
    change = np.abs(motion.torso[:, 18, 3:5] - motion.torso[:, 9, 3:5]).max(1)
    for push, lean, fell in zip(pushes, change.reshape(-1, 3), motion.fell.reshape(-1, 3)):
        what = f"pushed along {push}: 40 ms later it leans by {lean.round(3)} rad, gains {gains} s"
        assert lean[0] < 0.95 * lean[1] and lean[1] < 0.95 * lean[2], (
            f"{what}: the toes press where the robot turns to; is a sign wrong?"
        )
        assert not fell[0], f"{what}: the reflex keeps it up"
        assert fell[2] or push[1], f"{what}: the opposite sign drives the sway until it falls"


@BOTH
def test_a_push_gives_momentum_to_the_torso_while_it_lasts(make_sim, name):
    torso, joints = stance(name)
    torso[2] = 1.0  # in the air, where no ground takes a share
    sim, trajectory = make_sim(name, 3, standing=(torso, joints)), still(name, 3, 0.12)
    want = np.array([[2.1, 0], [0, -0.7], [0, 0]])  # [kg m/s] ahead, to the right, none
    disturbance = robot_model.Disturbance.none(trajectory)
    disturbance.push[:, 3:8] = want[:, None] / (5 * ROBOT.control_dt)  # force = momentum / time
    motion = sim.run(np.arange(3), trajectory, disturbance)
    for i in range(3):
        if name == "mujoco":
            got = velocity(sim.model, mujoco_data(sim, i))[:2]
        else:
            got = planar_mean(sim.spaces[i].bodies, "velocity")
            got[1] += ROBOT.gravity * 0.12  # it drops
            want[i, 1] = 0  # nobody is pushed up, down or out of a plane
        hint = "force·time, of this robot, in these ticks only"
        close(MASS * got, want[i], hint, atol=0.01)
    assert motion.angular_velocity[0, 1] > 0.1, "it is pushed above its hips, so it also turns"


@BOTH
def test_the_gyro_is_read_every_second_tick(make_sim, monkeypatch, name):
    (plan,), standing = walking(name, 1, [[0.06, 0, 0.1], [0.06, 0, -0.1]], 1)
    whole, piece = (make_sim(name, standing=standing) for _ in range(2))
    read = []

    def silent(plan, robot, rows, at, omega):
        read.append((at[0, 0], at[0, -1], omega))
        return np.zeros((1, at.shape[1] - 1, 12))

    monkeypatch.setattr(walk_engine.WalkPlan, "feedback", silent)
    disturbance = robot_model.Disturbance.none(plan)
    disturbance.gyro_error[0, 20] = 0.3, -0.4
    whole.run([0], plan, disturbance)
    assert [one[:2] for one in read] == [(k, k + 2) for k in range(0, 62, 2)], "it holds for two"
    for reading, error in (read[5], 0), (read[10], [0.3, -0.4]):
        tick, _, omega = reading
        true = piece.run([0], part(plan, tick - 10, tick)).angular_velocity[:, :2]
        want = true * [name == "mujoco", 1] + error  # a plane has no x
        hint = "how fast the torso turns about x and y, plus the gyro's error, at this tick:"
        close(omega, want, f"{hint} {tick}")


def test_mujoco_foot_slides_alike_in_all_directions_with_the_friction_it_drew(make_sim):
    sim = make_sim("mujoco", 2)
    sim.reset([0], replace(bodies(1), friction=[0.4]))
    sim.run(np.arange(2), still("mujoco", 2, 1.0))  # the weight settles on the soles

    for (i, friction), degrees in product(enumerate((0.4, ROBOT.friction)), (0, 45, 90)):
        model, data = sim.models[i], mujoco_data(sim, i)
        data.qvel[:2] = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        data.ctrl[:] = stance("mujoco")[1]
        before = velocity(model, data)
        steps = 4  # later it rocks, and a foot that turns slides elsewhere
        mujoco.mj_step(model, data, steps)
        change = velocity(model, data) - before
        # ∫ horizontal force / ∫ vertical force = μ; that a foot bounces does not matter.
        mu = np.linalg.norm(change[:2]) / (change[2] + ROBOT.gravity * steps * STEP)
        close(
            mu,
            friction,
            f"at {degrees}°: μ = {mu:.3f}; only at 45°: a pyramid; else: the larger of two values?",
            rtol=0.02,
        )


def test_planar_foot_slides_with_the_friction_it_drew(make_sim):
    sim = make_sim("pymunk", 2)
    sim.reset([0], replace(bodies(1), friction=[0.4]))
    for space, friction in zip(sim.spaces, (0.4, ROBOT.friction)):
        for _ in range(40):  # settle
            space.step(STEP)
        for link in space.bodies:
            link.velocity = 1.0, 0.0
        steps = 6  # later a toe digs in, and stops
        for _ in range(steps):
            space.step(STEP)
        ahead, up = planar_mean(space.bodies, "velocity") - [1, 0]
        mu = -ahead / (up + ROBOT.gravity * steps * STEP)
        close(
            mu, friction, f"μ = {mu:.3f}; pymunk MULTIPLIES the friction of both shapes", rtol=0.02
        )


def planar_torque(sim):
    """Size of the motors' torque in the last physics step, [N, 6] [N m]."""
    return np.array([[abs(motor.impulse) / STEP for motor in motors] for motors in sim.motors])


def test_planar_joints_stay_together_and_motors_keep_torque_and_speed_limits(make_sim):
    plans, standing = walking("pymunk", 2, [[0.1, 0, 0.3], [0.1, 0, -0.3]], 4)
    sim = make_sim("pymunk", 2, standing=standing)
    limit, gap, torque, joints = np.tile(ROBOT.torque_limit, 2), [], 0.0, []
    for piece in (piece for plan in plans for piece in single_ticks(plan)):
        joints.append(sim.run(np.arange(2), piece).joints[:, -1])
        torque = np.maximum(torque, planar_torque(sim))
        for p in (pivot for space in sim.spaces for pivot in pivots_of(space)):
            gap.append((p.a.local_to_world(p.anchor_a) - p.b.local_to_world(p.anchor_b)).length)
    assert 1e-6 < max(gap) < 0.002, f"{1000 * max(gap):.2f} mm apart: more solver iterations"
    assert (torque <= limit[robot_model.SAGITTAL] + 1e-6).all(), "has every motor its max_force?"
    speed = np.abs(np.diff(joints, axis=0)).max((0, 1)) / ROBOT.control_dt
    assert (speed < 1.1 * np.tile(ROBOT.speed_limit, 2)).all(), f"{speed.round(1)} rad/s: too fast"


@BOTH
def test_joints_are_as_late_as_back_emf_and_dry_friction_make_them(make_sim, name):
    floating = replace(ROBOT, gravity=0.0)
    torso, joints = robot_model.stance(ROBOT, planar=name == "pymunk")
    sim = make_sim(name, 12, standing=(torso + [0, 0, 1, 0, 0, 0], joints), robot=floating)
    trajectory, rate, each = still(name, 12, 0.3), 1.0, np.arange(12)  # [rad/s]; joint i of robot i
    trajectory.joints[each, :, each] += rate * ROBOT.control_dt * np.arange(31)
    late = trajectory.joints[each, 1:, each] - sim.run(each, trajectory).joints[each, :, each]
    want, hint = 0 * each, "a motor of the plane that follows only the error lags behind"
    if name == "mujoco":
        # stiffness·error = damping·rate + dry friction, when a physics step begins: on average
        # (control_dt + STEP) / 2 before the end of the tick, whose target it already has
        torque = rate * np.array(ROBOT.damping) + ROBOT.stiction
        want = np.tile(torque / ROBOT.stiffness, 2) - rate * (ROBOT.control_dt + STEP) / 2
        hint = "back-EMF, dry friction, or the target of another tick?"
    late = late[:, 10:].mean(1)  # [rad]
    close(late, want, f"rad behind their targets, joint by joint: {hint}", atol=0.0005)


def test_mujoco_motors_keep_torque_and_speed_limits(make_sim):
    sim = make_sim("mujoco")
    table = ROBOT.torque_limit, ROBOT.speed_limit, ROBOT.damping, ROBOT.stiction
    limit, fast, damping, friction = np.tile(table, 2)
    left, data = limit - damping * fast - friction, mujoco_data(sim)
    assert (np.abs(left) < 0.04 * limit).all(), "the table: nothing is left at the speed limit"
    # Far from its target a motor pushes with all it has, less back-EMF, which also brakes a joint
    # that the robot's own weight throws beyond its speed limit (a knee in a long swing).
    for share in (0.0, 0.5, 1.0, 1.25):
        data.ctrl[:] = data.qpos[7:] + 3.0
        data.qvel[6:] = share * fast
        mujoco.mj_forward(sim.model, data)
        torque = data.qfrc_actuator[6:] + data.qfrc_passive[6:]
        close(torque, limit - damping * share * fast, "a line that falls with the speed")


@BOTH
def test_spin_is_the_angular_velocity_about_the_torsos_own_axes(make_sim, name):
    fine = replace(ROBOT, control_dt=0.002, substeps=1)
    plans, standing = walking(name, 1, [[0.08, 0.02, 0.2], [0.08, 0, -0.2]], 4, fine)
    sim = make_sim(name, standing=standing, robot=fine)
    turns, spins = [], []
    for plan, first in product(plans, range(0, plans[0].most_ticks, 5)):
        motion = sim.run([0], part(plan, first, first + 5))
        turns.append(robot_model.rotation(*motion.torso[0, -2:, 3:].T))
        spins.append(motion.angular_velocity[0])
    assert not motion.fell.any() and motion.torso[0, -1, 5] > 1.0, "it should walk in a circle"
    turns, spins = np.array(turns), np.array(spins)  # [K, 2, 3, 3], [K, 3]
    # Rᵀ·Ṙ is the cross product with ω, both in the torso's own frame.
    change = turns[:, 0].swapaxes(1, 2) @ turns[:, 1] / fine.control_dt
    want = (change - change.swapaxes(1, 2))[:, [2, 0, 1], [1, 2, 0]] / 2  # [K, 3]
    size, error = (np.sqrt(np.mean(x**2, 0)) for x in (want, spins - want))
    assert (size > 0.04).all(), f"the torso should turn about all axes, {size.round(3)} rad/s"
    assert (error < [0.01, 0.03, 0.01]).all(), (
        f"{error.round(3)} rad/s about x, y, z: rates of roll, pitch, yaw, or the world's axes?"
    )


MUJOCO_JOINTS = [f"{side} {joint}" for side in ("left", "right") for joint in robot_model.JOINTS]


def test_mujoco_robots_get_what_they_drew_each_in_a_model_of_its_own(make_sim):
    sim, body, like = make_sim("mujoco", 3), bodies(2, **SPREAD), nominal()
    sim.reset([2, 0], body)
    equal(sim.models[1].body_mass, like.body_mass, "robot 1 shares what others drew")
    links = [like.body(link).id for link in MUJOCO_LINKS]
    motors = [like.actuator(joint).id for joint in MUJOCO_JOINTS]
    turning = [like.joint(joint).dofadr[0] for joint in MUJOCO_JOINTS]
    for row, i in enumerate([2, 0]):
        model, factor = sim.models[i], body.mass[row]
        close(model.body_mass[links], factor * like.body_mass[links], f"{MUJOCO_LINKS}")
        close(
            model.body_inertia[links],
            factor[:, None] * like.body_inertia[links],
            "the same shape, and so many times as heavy",
            atol=1e-9,
        )
        close(
            model.body("torso").subtreemass,
            model.body_mass.sum(),
            "what MuJoCo derives from the masses is old: mj_setConst",
        )
        stiffness = body.stiffness[row] * ROBOT.stiffness
        close(model.actuator_gainprm[motors, 0], stiffness, f"{MUJOCO_JOINTS}")
        close(
            model.actuator_biasprm[motors, 1],
            -stiffness,
            "τ = stiffness·(target − q); one without the other moves the zero",
        )
        equal(model.actuator_biasprm[:, 2], like.actuator_biasprm[:, 2])
        equal(model.dof_frictionloss[turning], body.stiction[row])
        assert not model.dof_frictionloss[:6].any(), "nothing holds the torso in the air"
        equal(model.pair_friction[:, :2], body.friction[row])


def test_planar_robots_get_what_they_drew(make_sim):
    sim, body = make_sim("pymunk", 3), bodies(2, **SPREAD)
    sim.reset([2, 0], body)
    hips = robot_model.planar_links(ROBOT)[0]  # the torso with both hips
    links = hips, *2 * (ROBOT.thigh, ROBOT.shin, ROBOT.foot)
    for row, i in enumerate([2, 0]):
        factors = body.mass[row, [0, 2, 3, 4, 6, 7, 8]]
        for k, (link, got, factor) in enumerate(zip(links, sim.spaces[i].bodies, factors)):
            close(got.mass, factor * link.mass, f"body {k}")
            rotor = ROBOT.armature if k else 0.0
            close(got.moment, factor * link.inertia[1] + rotor, f"body {k}", atol=1e-9)
    plan = still("pymunk", 3, ROBOT.control_dt)
    plan.joints += 0.01
    sim.run(np.arange(3), plan)
    speed = np.array([[motor.rate for motor in sim.motors[i]] for i in (2, 0)])
    close(speed, 0.01 * ROBOT.planar_gain * body.stiffness[:, robot_model.SAGITTAL], rtol=1e-6)
    close(sum(body.mass for body in sim.spaces[1].bodies), MASS, "robot 1 was not reset")


def test_static_friction_is_taken_from_a_planar_motors_largest_torque(make_sim):
    sim, body = make_sim("pymunk", 2), bodies(2, stiction=1.5)
    sim.reset(np.arange(2), body)
    far, most = still("pymunk", 2, 1.0), 0.0
    far.joints[:, 1:] = np.tile(ROBOT.joint_max, 2) + 0.5  # motors push against the joint limits
    for piece in single_ticks(far):
        sim.run(np.arange(2), piece)
        most = np.maximum(most, planar_torque(sim))
    left = (np.tile(ROBOT.torque_limit, 2) - body.stiction)[:, robot_model.SAGITTAL]
    assert (most <= left + 1e-6).all(), f"{most.round(2)} N m, at most {left.round(2)}"
    close(most, left, "all the rest is there to be used")


@BOTH
def test_a_delayed_robot_moves_as_one_whose_targets_come_a_tick_later(make_sim, monkeypatch, name):
    """And a joint with a wrong zero goes as far beside its target."""
    plans, standing = walking(name, 1, [[0.08, 0, 0.1], [0.08, 0, -0.1]], 2)
    sim, last = make_sim(name, 2, standing=standing), standing[1][None, None]
    body = bodies(1, delay=1, zero=0.02)
    sim.reset([0], body)
    ticks, rng = plans[0].most_ticks, default_rng(6)
    added = np.zeros((2, ticks, 12))  # by a reflex that we make up

    def made_up(self, robot, rows, at, angular_velocity):
        return added[rows[:, None], at[:, :-1]]

    monkeypatch.setattr(walk_engine.WalkPlan, "feedback", made_up)
    for plan in plans:
        late = np.concatenate([last, plan.joints[:, :-1]], 1) + body.zero
        both = replace(
            robot_model.some_rows(plan, [0, 0]), joints=np.concatenate([plan.joints, late])
        )
        before = added[0, -1].copy()
        added[0] = rng.uniform(-0.05, 0.05, (ticks, 12))
        added[1] = [before, *added[0, :-1]]
        motion = sim.run(np.arange(2), both)
        close(
            motion.torso[0],
            motion.torso[1],
            "every target, also the last of a run, comes a tick later, with what the reflex adds; "
            "and a motor holds target + zero, in every tick",
        )
        last = plan.joints[:, -2:-1]


@BOTH
def test_a_torso_s_centre_of_mass_can_be_off_the_model_s(make_sim, name):
    torso, _ = stance(name)
    sim, body = make_sim(name, 2), bodies(2)
    body.com[0] = 0.01, 0.0, 0.02
    sim.reset([0, 1], body)
    if name == "mujoco":
        centres = [mujoco_data(sim, i).subtree_com[0] for i in range(2)]
    else:
        centres = [
            planar_mean(space.bodies, "position")[[0, 0, 1]] * [1, 0, 1] for space in sim.spaces
        ]
    want = robot_model.rotation(*np.array([0, torso[4], 0])) @ body.com[0] * ROBOT.torso.mass / MASS
    close(centres[0] - centres[1], want, "of the whole robot, by the torso's share of its mass")
    motion = sim.run([0, 1], still(name, 2, 0.01))
    close(motion.torso[:, 0], np.tile(torso, (2, 1)), "the torso's frame stays", atol=0.002)


@BOTH
def test_robots_move_alike_whoever_else_moves_or_is_reset(make_sim, name):
    plans, standing = walking(name, 4, [[0.06, 0, 0.1], [0.06, 0, -0.1]], 2)
    for plan in plans:
        plan.reflex_gain[2] = 0  # one of them without the reflex
    pushes = disturbed(plans[0])
    spread, one, fresh = sims = [make_sim(name, 4, cores, standing) for cores in (2, 1, 1)]
    for sim in sims:
        sim.reset([2, 3, 0, 1], bodies(4, **SPREAD, delay=1))
    want = one.run(np.arange(4), plans[0], pushes)
    for robots in ([2], [3, 1, 0]):
        got = spread.run(
            robots, robot_model.some_rows(plans[0], robots), robot_model.some_rows(pushes, robots)
        )
        hint = "are rows, robots, their bodies and what disturbs them matched?"
        assert_same_motion(got, want, slice(None), robots, hint)
    spread.reset([1])
    got, want, new = (sim.run(np.arange(4), plans[1], pushes) for sim in (spread, one, fresh))
    assert_same_motion(got, want, [0, 2, 3], [0, 2, 3], "robot 1 was reset, and others changed")
    assert_same_motion(got, new, 1, 1, "a reset keeps more than the body, or less")
    assert got.torso[1, -1, 0] < want.torso[1, -1, 0] - 0.03, "robot 1 starts at the origin again"
    two = make_sim(name, 2, standing=standing)
    two.reset([0], bodies(1))  # robot 1 never gets one
    motion = two.run(np.arange(2), robot_model.some_rows(plans[0], [0, 0]))
    assert_same_motion(motion, motion, 0, 1, "a body like the model is another robot")


@pytest.mark.parametrize("name, cores", [("pymunk", 1), ("mujoco", 1), ("mujoco", 2)])
def test_a_diverged_robot_is_a_silent_fall_of_its_own(make_sim, tmp_path, capfd, name, cores):
    sim, healthy = (make_sim(name, 4, cores) for _ in range(2))
    everybody, seconds = np.arange(4), still(name, 4, 0.5)
    for robot, bad in ((1, math.nan), (2, 1e12)):  # forward velocity of the torso [m/s]
        if name == "mujoco":
            sim.state[robot, 20] = bad
        else:
            next(iter(sim.spaces[robot].bodies)).velocity = bad, 0.0
    motion, want = sim.run(everybody, seconds), healthy.run(everybody, seconds)
    hint = "a state that is not finite is a fall; comparisons with nan are always False"
    equal(motion.fell, [False, True, True, False], hint)
    assert_same_motion(motion, want, [0, 3], [0, 3], "the others go on")
    last = np.tile(stance(name)[0], (2, 50, 1))
    close(motion.torso[1:3], last, "finite, where it was last seen: no teleport", atol=0.01)
    assert sim.run(everybody, still(name, 4, 0.1)).fell[1:3].all(), "still lost until its reset"
    sim.reset([1, 2])
    assert_same_motion(sim.run(everybody, seconds), want, [1, 2], [1, 2], "a reset cures it")
    assert capfd.readouterr() == ("", "") and not list(tmp_path.iterdir()), "MuJoCo's warnings"


def test_planar_yaw_turns_as_fast_as_sole_and_motor_can_bear(make_sim):
    sim, body = make_sim("pymunk", 3), bodies(3, friction=0.3, mass=0.1)
    body.friction[2] = 9.0
    sim.reset(np.arange(3), body)
    a, b = ROBOT.foot_front + ROBOT.foot_back, ROBOT.foot_width
    # The integral of √(x² + y²) over the rectangle a × b, divided by a·b
    radius = (
        math.hypot(a, b) / 6
        + a**2 / (12 * b) * math.asinh(b / a)
        + b**2 / (12 * a) * math.asinh(a / b)
    )
    close(sim.sole_radius, radius, "r [m]: a mean over the whole sole", rtol=0.005)
    yaw = sim.run_yaw(np.full((3, 2), 0.5), np.arange(3))  # commanded: 0.5 rad in a tick
    torque = np.diff(yaw, 2) * ROBOT.yaw_inertia / ROBOT.control_dt**2  # [N, 1]
    weight = np.array([sum(link.mass for link in space.bodies) for space in sim.spaces])
    grip = body.friction[:2] * weight[:2] * ROBOT.gravity * sim.sole_radius  # [N m]
    close(torque[:2, 0], grip, "r·μ·m·g: a sole with the robot's weight on it", atol=1e-3)
    close(torque[2], ROBOT.torque_limit[0], "the hip's motor has a limit, too")
