"""Stage 1: what is the robot, and what does physics do with it?

Paper: section II-a (a simulated biped, position-controlled joints); the robot is its reference [6].

    python 01_robot_model.py             pymunk: sagittal plane + yaw
    python 01_robot_model.py --mujoco    MuJoCo: full 3-D

prints the mass table, lets the robot stand for 3 s, measures the simulator's speed, and draws the
robot standing and, with its motors off, falling (`runs/<sim>/01_robot.png`). A few seconds.

One `RobotModel` feeds the leg kinematics, both simulators and the drawings. A simulator takes the
joint targets of N robots and returns a `Motion`: what physics made of them.
Frames: x forward, y left, z up; angles in radians, counter-clockwise about their axis, so a
positive pitch leans forward. Joint order, for the left leg and then for the right one:
hip yaw, hip roll, hip pitch, knee, ankle pitch, ankle roll.

Left out: arms and head (their mass is in the torso), gear play, sensors. The planar robot cannot
fall sideways: its sideways motion follows the command (see `PlanarRobots`).
"""

import argparse
import math
import multiprocessing
import os
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

LEFT, RIGHT = 0, 1
# Cores that this process may use; not every system tells, then all of them.
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
JOINTS = ("hip yaw", "hip roll", "hip pitch", "knee", "ankle pitch", "ankle roll")
SAGITTAL = np.array([2, 3, 4, 8, 9, 10])  # the six of twelve joints that the planar robot has


@dataclass(frozen=True)
class Link:
    """A rigid body. Offsets are seen from the joint above it; y is outward for a leg."""

    mass: float  # [kg]
    com: tuple  # [m] centre of mass (x, y, z)
    inertia: tuple  # [kg m²] about the centre of mass (x, y, z)


@dataclass(frozen=True)
class RobotModel:
    """Wolfgang-OP, simplified (public model: its URDF of 2024-10, unless a line says otherwise)."""

    # Masses: public model. Centres of mass and inertias: our estimates for the merged parts.
    # Torso: torso, arms and head in one body. Its frame is the "trunk" of the walk engine.
    torso: Link = Link(3.490, (0.0, 0.0, 0.120), (0.045, 0.035, 0.025))
    hip: Link = Link(0.389, (0.0, 0.0, 0.0), (0.0004, 0.0004, 0.0004))  # yaw and roll motors
    thigh: Link = Link(0.242, (0.0, 0.0, -0.085), (0.0008, 0.0008, 0.0003))
    shin: Link = Link(0.088, (0.0, 0.0, -0.085), (0.0003, 0.0003, 0.0001))
    foot: Link = Link(0.595, (0.006, 0.004, -0.019), (0.0012, 0.0016, 0.0016))  # and ankle motors
    hip_y: float = 0.055  # [m] hip beside the torso frame
    hip_z: float = -0.041  # [m] hip below the torso frame
    thigh_length: float = 0.169  # [m] hip axis to knee axis
    shin_length: float = 0.170  # [m] knee axis to ankle axis
    ankle_height: float = 0.053  # [m] ankle axis above the sole
    foot_front: float = 0.108  # [m] sole ahead of the ankle axis
    foot_back: float = 0.076  # [m] sole behind the ankle axis
    foot_width: float = 0.090  # [m]
    foot_outward: float = 0.015  # [m] centre of the sole outside the ankle axis
    torso_box: tuple = (0.10, 0.20, 0.30)  # [m] size (x, y, z) for contact and drawing; our choice

    # Motors: yaw, roll, pitch, knee, ankle pitch, ankle roll of one leg.
    torque_limit: tuple = (10.0, 10.0, 10.0, 12.9, 10.0, 10.0)  # [N m] at standstill
    speed_limit: tuple = (5.76, 5.76, 5.76, 3.87, 5.76, 5.76)  # [rad/s] without load
    joint_min: tuple = (-1.57, -1.6, -2.77, -0.2, -1.42, -1.4)  # [rad] in our axes; roll symmetric
    joint_max: tuple = (1.57, 1.6, 0.79, 2.8, 0.37, 1.4)
    stiffness: float = 300.0  # [N m/rad] position gain of a motor; our choice
    armature: float = 0.01  # [kg m²] rotor inertia seen through the gears; our choice
    planar_gain: float = 40.0  # [1/s] pymunk motor: speed per position error; our choice
    planar_iterations: int = 20  # [-] of pymunk's solver; our choice, keeps the joints together
    yaw_inertia: float = 0.05  # [kg m²] whole planar robot about the vertical; our estimate
    yaw_stiffness: float = 45.0  # [N m/rad] planar hip yaw motor; our choice
    yaw_damping: float = 3.0  # [N m s/rad] critical for the two values above
    friction: float = 0.5  # [-] foot on ground, the value of the robot's own simulator
    friction_cone: str = "pyramidal"  # in MuJoCo; its default. "elliptic" takes longer
    gravity: float = 9.81  # [m/s²]

    # Time. Control is what a motor sees; physics runs finer.
    control_dt: float = 0.010  # [s] a new joint target; our choice
    physics_dt: float = 0.005  # [s] both simulators; our choice

    @property
    def mass(self):
        """Total mass [kg]."""
        return self.torso.mass + 2 * sum(part.mass for part in self.leg)

    @property
    def leg(self):
        """The links of one leg from the hip down."""
        return (self.hip, self.thigh, self.shin, self.foot)

    @property
    def damping(self):
        """Back-EMF of each motor [N m s/rad], [6]: its torque is used up at its speed limit."""
        return np.array(self.torque_limit) / np.array(self.speed_limit)


@dataclass
class Trajectory:
    """What N robots are asked to do in T control ticks; sample 0 is where the last one ended."""

    joints: np.ndarray  # [N, T + 1, 12] joint targets [rad]
    trunk: np.ndarray  # [N, T + 1, 6] x, y, z [m], roll, pitch, yaw [rad] in a common frame
    feet: np.ndarray  # [N, T + 1, 2, 4] x, y, z of the sole below the ankle [m], yaw [rad]


@dataclass
class Motion:
    """What physics did with N robots, at the end of each of T control ticks."""

    torso: np.ndarray  # [N, T, 6] x, y, z [m], roll, pitch, yaw [rad] in the world
    joints: np.ndarray  # [N, T, 12] measured joint angles [rad]
    spin: np.ndarray  # [N, 3] angular velocity of the torso at the end, in its own frame [rad/s]
    feet: np.ndarray  # [N, 2, 3] x, y [m] of the ankles, yaw [rad] of the feet, at the end
    fell: np.ndarray  # [N] bool: fell at any time

    @property
    def pose(self):
        """Torso on the ground at the end: x, y [m], yaw [rad]; [N, 3]."""
        return self.torso[:, -1, [0, 1, 5]]


# ---------------------------------------------------------------------------- leg kinematics


def wrap(angle):
    """The same angle in [−π, π) [rad]."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def rotation(roll, pitch, yaw):
    """Rz(yaw)·Ry(pitch)·Rx(roll): arrays of one shape [...] in, matrices [..., 3, 3] out."""
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    cy, sy = np.cos(yaw), np.sin(yaw)
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.stack([np.stack(np.broadcast_arrays(*row), -1) for row in rows], -2)


def leg_points(robot, joints):
    """Where the parts of a leg are, in the hip's frame, for angles [..., 6].

    Returns points [..., 5, 3]: hip, knee, ankle, heel, toe [m], and the foot's rotation
    [..., 3, 3] = Rz(hip yaw)·Rx(hip roll)·Ry(hip pitch + knee + ankle pitch)·Rx(ankle roll)
    """
    yaw, roll, pitch, knee, ankle_pitch, ankle_roll = np.moveaxis(np.asarray(joints), -1, 0)
    zero = np.zeros_like(yaw)
    hip = rotation(zero, zero, yaw) @ rotation(roll, zero, zero)  # [..., 3, 3]
    thigh = hip @ rotation(zero, pitch, zero)
    shin = hip @ rotation(zero, pitch + knee, zero)
    foot = hip @ rotation(zero, pitch + knee + ankle_pitch, zero) @ rotation(ankle_roll, zero, zero)
    knee_point = -robot.thigh_length * thigh[..., :, 2]  # a leg hangs along −z
    ankle = knee_point - robot.shin_length * shin[..., :, 2]
    heel = ankle + foot @ np.array([-robot.foot_back, 0, -robot.ankle_height])
    toe = ankle + foot @ np.array([robot.foot_front, 0, -robot.ankle_height])
    return np.stack([0 * ankle, knee_point, ankle, heel, toe], -2), foot


def leg_inverse(robot, position, foot):
    """Joint angles of one leg, analytically.

    position [..., 3]: ankle in the hip's frame [m]; foot [..., 3, 3]: its rotation in that frame.
    Returns joints [..., 6] [rad] and reachable [...] bool. A pose out of reach is pulled along the
    line from the hip to the nearest one that the leg can take, then clipped to the joint limits.
    """
    thigh, shin = robot.thigh_length, robot.shin_length
    # r: the hip seen from the ankle, in the foot's frame, r = Rᵀ·(−p)
    rx, ry, rz = np.moveaxis(np.einsum("...ji,...j->...i", foot, -position), -1, 0)  # each [...]
    length = np.sqrt(rx**2 + ry**2 + rz**2)
    # Law of cosines: |r|² = thigh² + shin² + 2·thigh·shin·cos(knee); the knee bends one way only.
    shortest = math.sqrt(thigh**2 + shin**2 + 2 * thigh * shin * math.cos(robot.joint_max[3]))
    reach = np.clip(length, shortest, thigh + shin)
    knee = np.arccos(np.clip((reach**2 - thigh**2 - shin**2) / (2 * thigh * shin), -1, 1))
    ankle_roll = np.arctan2(ry, rz)
    # Pitch of the line from ankle to hip, seen from the shin and from the foot.
    from_shin = np.arctan2(-thigh * np.sin(knee), shin + thigh * np.cos(knee))
    from_foot = np.arctan2(rx, np.hypot(ry, rz))
    ankle_pitch = from_shin - from_foot
    # Without the ankle's roll, the foot's rotation is M = Rz(yaw)·Rx(roll)·Ry(sum of pitches).
    cos, sin = np.cos(ankle_roll)[..., None], np.sin(ankle_roll)[..., None]
    middle = cos * foot[..., :, 1] - sin * foot[..., :, 2]  # [..., 3] second column of M
    last_z = sin[..., 0] * foot[..., 2, 1] + cos[..., 0] * foot[..., 2, 2]  # M₃₃
    yaw = np.arctan2(-middle[..., 0], middle[..., 1])
    roll = np.arcsin(np.clip(middle[..., 2], -1, 1))
    pitch = np.arctan2(-foot[..., 2, 0], last_z) - knee - ankle_pitch
    wanted = np.stack([yaw, roll, pitch, knee, ankle_pitch, ankle_roll], -1)  # [..., 6]
    joints = np.clip(wanted, robot.joint_min, robot.joint_max)
    reachable = (np.abs(reach - length) < 1e-9) & np.all(joints == wanted, -1)
    return joints, reachable


def hips(robot):
    """Both hips in the trunk's frame, [2, 3] [m]."""
    return np.array([[0, robot.hip_y, robot.hip_z], [0, -robot.hip_y, robot.hip_z]])


def body_inverse(robot, trunk, feet, planar=False):
    """Joint angles [..., 12] that put both feet in their places below the trunk.

    trunk [..., 6]: x, y, z, roll, pitch, yaw; feet [..., 2, 4]: x, y, z of the sole, yaw.
    Also returns reachable [..., 2] bool, one per leg. Planar: the legs stay below their hips.
    """
    yaw = wrap(feet[..., 3] - trunk[..., None, 5])  # [..., 2] foot seen from the trunk
    offset = feet[..., :3] + [0, 0, robot.ankle_height] - trunk[..., None, :3]  # [..., 2, 3]
    cos, sin = np.cos(trunk[..., 5, None]), np.sin(trunk[..., 5, None])
    x = cos * offset[..., 0] + sin * offset[..., 1]
    y = -sin * offset[..., 0] + cos * offset[..., 1]
    if planar:
        y, yaw = np.broadcast_to(hips(robot)[:, 1], y.shape), np.zeros_like(yaw)
    lean = rotation(trunk[..., 3], trunk[..., 4], np.zeros_like(trunk[..., 4]))  # [..., 3, 3]
    # The level axes under the trunk, seen from the leaning trunk: the rows of its rotation.
    ahead, left, up = (lean[..., None, i, :] for i in range(3))  # each [..., 1, 3]
    ankle = x[..., None] * ahead + y[..., None] * left + offset[..., 2, None] * up  # [..., 2, 3]
    cos, sin = np.cos(yaw)[..., None], np.sin(yaw)[..., None]
    axes = cos * ahead + sin * left, cos * left - sin * ahead, up + 0 * sin  # of the foot
    foot = np.stack(axes, -1)  # [..., 2, 3, 3]
    joints, reachable = leg_inverse(robot, ankle - hips(robot), foot)
    return joints.reshape(*joints.shape[:-2], 12), reachable


def body_points(robot, torso, joints):
    """Both legs in the world, [..., 2, 5, 3] (hip, knee, ankle, heel, toe), and foot yaws [..., 2].

    torso [..., 6], joints [..., 12].
    """
    base = rotation(torso[..., 3], torso[..., 4], torso[..., 5])[..., None, :, :]  # [..., 1, 3, 3]
    points, foot = leg_points(robot, joints.reshape(*joints.shape[:-1], 2, 6))
    points = points + hips(robot)[:, None, :]
    world = (base[..., None, :, :] @ points[..., None])[..., 0] + torso[..., None, None, :3]
    ahead = (base @ foot)[..., :, 0]  # [..., 2, 3] where the toes point
    return world, np.arctan2(ahead[..., 1], ahead[..., 0])


def stance(robot, height=0.395, foot_distance=0.18, pitch=0.1, planar=False, x_offset=0.0):
    """Joint angles [12] of standing with the trunk `x_offset` ahead of the middle of the feet."""
    trunk = np.array([x_offset, 0.0, height, 0.0, pitch, 0.0])
    feet = np.array([[0, foot_distance / 2, 0, 0], [0, -foot_distance / 2, 0, 0]])
    return body_inverse(robot, trunk, feet, planar)[0]


def standing_torso(robot, joints):
    """Pose [6] of the torso that puts the soles flat on the ground, for joints [12]."""
    torso = np.array([0, 0, 0, 0, -joints[2:5].sum(), 0.0])  # the pitches down a leg add up to 0
    torso[2] = -body_points(robot, torso, joints)[0][..., 2].min()
    return torso


def fallen(height, cos_tilt, standing_height):
    """Fall: the trunk is below half its standing height or tilted beyond 45°.

    Reference [5], which tests roll and pitch one by one; here their common tilt is tested.
    """
    return (height < 0.5 * standing_height) | (cos_tilt < math.cos(math.pi / 4))


# ---------------------------------------------------------------------------- MuJoCo, 3-D


def mjcf(robot):
    """The robot as a MuJoCo model. Each motor is a position servo with a torque-speed line:

    τ = clip(stiffness·(target − q), ±torque limit) − damping·q̇, zero at the speed limit.
    A joint that the ground drives backward is braked harder than the limit, as by a real motor.
    The friction pyramid: μ along the ground's x and y, μ/√2 between them, never more.
    The two flags only save time (a third): at landing feet, Newton's method finds the same contact
    forces in fewer iterations when it does not start from those of the last time step.
    """

    def inertial(link, side=1):
        x, y, z = link.com
        ixx, iyy, izz = link.inertia
        return (
            f'<inertial pos="{x} {side * y} {z}" mass="{link.mass}" '
            f'diaginertia="{ixx} {iyy} {izz}"/>'
        )

    def joint(leg, index, axis):
        return (
            f'<joint name="{leg} {JOINTS[index]}" axis="{axis}" '
            f'damping="{robot.damping[index]}" armature="{robot.armature}"/>'
        )

    def leg_body(leg, side):
        sole = (robot.foot_front + robot.foot_back) / 2  # [m] half length
        x = (robot.foot_front - robot.foot_back) / 2
        thick = 0.010  # [m] half thickness of the plate, not of the foot's mass
        return f"""
        <body name="{leg} hip" pos="0 {side * robot.hip_y} {robot.hip_z}">
          {joint(leg, 0, "0 0 1")} {joint(leg, 1, "1 0 0")} {inertial(robot.hip)}
          <body name="{leg} thigh">
            {joint(leg, 2, "0 1 0")} {inertial(robot.thigh)}
            <body name="{leg} shin" pos="0 0 {-robot.thigh_length}">
              {joint(leg, 3, "0 1 0")} {inertial(robot.shin)}
              <body name="{leg} foot" pos="0 0 {-robot.shin_length}">
                {joint(leg, 4, "0 1 0")} {joint(leg, 5, "1 0 0")} {inertial(robot.foot, side)}
                <geom name="{leg} sole" type="box" size="{sole} {robot.foot_width / 2} {thick}"
                  pos="{x} {side * robot.foot_outward} {thick - robot.ankle_height}"/>
              </body>
            </body>
          </body>
        </body>"""

    motors = "".join(
        f'<position joint="{leg} {name}" kp="{robot.stiffness}" '
        f'forcerange="{-robot.torque_limit[i]} {robot.torque_limit[i]}"/>'
        for leg in ("left", "right")
        for i, name in enumerate(JOINTS)
    )
    contact = f'condim="3" friction="{robot.friction} {robot.friction} 0.005 0.0001 0.0001"'
    half = [size / 2 for size in robot.torso_box]
    return f"""
    <mujoco>
      <option timestep="{robot.physics_dt}" integrator="implicitfast"
        cone="{robot.friction_cone}" gravity="0 0 {-robot.gravity}">
        <flag warmstart="disable" island="disable"/>
      </option>
      <default><geom contype="0" conaffinity="0"/></default>
      <worldbody>
        <geom name="ground" type="plane" size="0 0 1"/>
        <body name="torso" pos="0 0 1">
          <freejoint/> {inertial(robot.torso)}
          <geom name="torso" type="box" size="{half[0]} {half[1]} {half[2]}" pos="0 0 {half[2]}"/>
          {leg_body("left", 1)} {leg_body("right", -1)}
        </body>
      </worldbody>
      <contact>
        <pair geom1="ground" geom2="left sole" {contact}/>
        <pair geom1="ground" geom2="right sole" {contact}/>
        <pair geom1="left sole" geom2="right sole" {contact}/>
        <pair geom1="ground" geom2="torso" {contact}/>
      </contact>
      <actuator>{motors}</actuator>
    </mujoco>"""


class MujocoSim:
    """N robots in 3-D. One call of `mujoco.rollout` runs all of them on all cores."""

    name = "mujoco"
    planar = False

    def __init__(self, num_robots, joints=None, robot=RobotModel(), cores=None):
        import mujoco  # only here: everything else works without MuJoCo
        from mujoco.rollout import Rollout

        self.robot, self.num_robots = robot, num_robots
        self.model = mujoco.MjModel.from_xml_string(mjcf(robot))
        cores = min(cores or CORES, num_robots)
        self._data = [mujoco.MjData(self.model) for _ in range(cores)]
        self._pool = Rollout(nthread=cores if cores > 1 else 0)
        self._substeps = round(robot.control_dt / robot.physics_dt)
        self._seconds = 0.0  # of bare physics
        self._gain = self.model.actuator_gainprm.copy(), self.model.actuator_biasprm.copy()
        joints = stance(robot) if joints is None else joints
        self.start_joints = joints
        self._start = self._settle(joints)
        self.standing_height = self._start[3]
        self._state = np.tile(self._start, (num_robots, 1))  # [N, 38] time, qpos 19, qvel 18
        self._control = np.tile(joints, (num_robots, 1))  # [N, 12] last motor commands

    def _settle(self, joints):
        """The state [38] after standing still for a second, moved to the origin."""
        torso = standing_torso(self.robot, joints)
        state = np.zeros(1 + self.model.nq + self.model.nv)
        state[3:8] = torso[2], math.cos(torso[4] / 2), 0, math.sin(torso[4] / 2), 0
        state[8:20] = joints
        control = np.tile(joints, (1, round(1.0 / self.robot.physics_dt), 1))
        state = self._pool.rollout(self.model, self._data, state[None], control)[0][0, -1]
        state[[0, 1, 2]] = 0.0  # time, x, y
        return state

    def reset(self, robots):
        """Put these robots (indices [n]) back to standing at the origin."""
        self._state[robots] = self._start
        self._control[robots] = self.start_joints

    def run(self, trajectory, robots):
        """Let these robots [n] follow their trajectory; returns their Motion."""
        robot, start, targets = self.robot, self._state[robots], trajectory.joints
        # The damping of a moving target is fed forward, so that the motor does not lag behind it.
        rate = np.diff(targets, axis=1) / robot.control_dt  # [n, T, 12] [rad/s]
        control = targets[:, 1:] + rate * np.tile(robot.damping / robot.stiffness, 2)
        control = np.repeat(control, self._substeps, axis=1)
        clock = time.perf_counter()
        states, _ = self._pool.rollout(self.model, self._data, start, control)  # [n, S, 38]
        self._seconds += time.perf_counter() - clock
        # MuJoCo restarts a diverged robot at time 0: a healthy-looking teleport. It is a fall.
        expected = start[:, 0] + control.shape[1] * robot.physics_dt
        lost = ~np.isfinite(states).all((1, 2)) | (np.abs(states[:, -1, 0] - expected) > 1e-6)
        states[lost] = start[lost, None]
        self._state[robots], self._control[robots] = states[:, -1], control[:, -1]
        cos_tilt = 1 - 2 * (states[..., 5] ** 2 + states[..., 6] ** 2)  # [n, S]
        down = fallen(states[..., 3], cos_tilt, self.standing_height).any(1)
        seen = states[:, self._substeps - 1 :: self._substeps]  # [n, T, 38]
        torso = np.concatenate([seen[..., 1:4], euler(seen[..., 4:8])], -1)
        points, yaw = body_points(robot, torso[:, -1], seen[:, -1, 8:20])
        feet = np.concatenate([points[:, :, 2, :2], yaw[..., None]], -1)  # [n, 2, 3]
        return Motion(torso, seen[..., 8:20], seen[:, -1, 23:26], feet, down | lost)

    def bare_seconds(self):
        """Wall-clock that `run` has spent in nothing but physics [s]: what a benchmark compares."""
        return self._seconds

    def torque(self):
        """Torque of every motor now, [N, 12] [N m]."""
        limit = np.tile(self.robot.torque_limit, 2)
        push = self.robot.stiffness * (self._control - self._state[:, 8:20])
        return np.clip(push, -limit, limit) - np.tile(self.robot.damping, 2) * self._state[:, 26:]

    def power(self, on):
        """Switch all motors on or off (their back-EMF still brakes)."""
        self.model.actuator_gainprm[:] = self._gain[0] * on
        self.model.actuator_biasprm[:] = self._gain[1] * on

    def close(self):
        """End the threads."""
        self._pool.close()


def euler(quaternion):
    """Roll, pitch, yaw [..., 3] of unit quaternions [..., 4] (w, x, y, z)."""
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.stack([roll, pitch, yaw], -1)


# ---------------------------------------------------------------------------- pymunk, planar


def planar_bodies(robot):
    """Torso with both hip motors in it, thigh, shin and foot."""
    parts = [(robot.torso, 0.0), (robot.hip, robot.hip_z), (robot.hip, robot.hip_z)]
    mass = sum(link.mass for link, _ in parts)
    centre = sum(link.mass * (link.com[2] + z) for link, z in parts) / mass
    # Parallel axes: I = Σ (Iᵢ + mᵢ·zᵢ²)
    pitch = sum(link.inertia[1] + link.mass * (link.com[2] + z - centre) ** 2 for link, z in parts)
    return Link(mass, (0, 0, centre), (0, pitch, 0)), robot.thigh, robot.shin, robot.foot


class PlanarRobots:
    """Planar robots in one process: pymunk in the sagittal plane, yaw and sideways beside it.

    pymunk's y is our z, and its angles turn x towards y: a body's pitch is minus its angle.
    Yaw ψ is a degree of freedom of its own. The hip motor twists the torso against the support
    foot by e; friction on the ground carries at most μ·N·r, beyond it the foot slips:

        τ = clip(k·e + c·ė, ±bound),   I·ψ̈ = τ,   |e| ≤ bound / k,   bound = min(motor limit, μ·N·r)

    with N the measured contact force and r the mean radius of the sole. Sideways is kinematic: it
    follows the command and cannot fall.
    """

    PARENT = [0, 1, 2, 0, 4, 5]  # of bodies 1…6; body 0 is the torso

    def __init__(self, robot, num_robots, joints):
        from pymunk import batch

        self.robot, self.start_joints = robot, joints
        self.spaces, self.motors = [None] * num_robots, [None] * num_robots
        self.bodies = np.zeros((num_robots, 7, 6))  # x, z, angle [m, m, rad] and their rates
        self.world = np.zeros((num_robots, 3))  # x, y [m], yaw [rad] of the torso frame
        self.yaw_rate = np.zeros(num_robots)  # ψ̇ [rad/s]
        self.twist = np.zeros(num_robots)  # e [rad]
        self.lost = np.zeros(num_robots, bool)  # state not finite
        self.buffer = batch.Buffer()
        self.seconds = 0.0  # of bare physics
        self.torque_share = 1.0  # 0 when the motors are switched off
        self.links = planar_bodies(robot)
        self.masses = np.array([self.links[i].mass for i in (0, 1, 2, 3, 1, 2, 3)])  # [7] [kg]
        self.standing_height = standing_torso(robot, joints)[2]
        along = np.linspace(-0.5, 0.5, 51) * (robot.foot_front + robot.foot_back)
        across = np.linspace(-0.5, 0.5, 51) * robot.foot_width
        self.sole_radius = np.hypot(along[:, None], across).mean()  # r [m]

    def reset(self, robots):
        """Fresh robots, standing: a space that is used again keeps contacts of the last fall."""
        for i in robots:
            self.spaces[i], self.motors[i] = self._build()
        self.world[robots], self.yaw_rate[robots], self.twist[robots] = 0, 0, 0
        self.lost[robots] = False
        self.bodies[robots] = self._read(robots)
        still = np.tile(self.start_joints[SAGITTAL], (len(robots), 21, 1))
        zero = np.zeros((len(robots), 20))
        self.run(robots, still, zero, zero)  # 0.2 s: the weight settles on the soles
        self.world[robots] = 0

    def _build(self):
        import pymunk

        robot, space = self.robot, pymunk.Space()
        space.gravity = 0, -robot.gravity
        space.iterations = robot.planar_iterations
        space.collision_slop = 0.0005  # [m] pymunk's own value is meant for pixels
        ground = pymunk.Segment(space.static_body, (-1e4, -1.0), (1e4, -1.0), 1.0)
        ground.friction = robot.friction  # pymunk multiplies both shapes' values; the foot has 1
        space.add(ground)
        pose = standing_torso(robot, self.start_joints)
        points = body_points(robot, pose, self.start_joints)[0][..., [0, 2]]  # [2, 5, 2] x, z

        def add_body(link, joint, pitch):
            """A link whose upper joint is at the point `joint`; pymunk counts from its centre."""
            # The rotor turns with the link below it. It also keeps the solver calm: without it
            # the light shin between heavy neighbours makes a standing robot sway by centimetres.
            rotor = 0.0 if link is self.links[0] else robot.armature
            body = pymunk.Body(link.mass, link.inertia[1] + rotor)
            body.angle, body.position = -pitch, tuple(joint)
            body.position = body.local_to_world((link.com[0], link.com[2]))  # joint → centre
            space.add(body)
            return body

        def add_box(body, link, back, front, bottom, top):
            corners = [(back, bottom), (front, bottom), (front, top), (back, top)]
            shape = pymunk.Poly(body, [(x - link.com[0], z - link.com[2]) for x, z in corners])
            shape.friction = 1.0
            shape.filter = pymunk.ShapeFilter(group=1)  # a robot does not collide with itself
            space.add(shape)

        motors = []
        torso = add_body(self.links[0], pose[[0, 2]], pose[4])
        depth, _, height = robot.torso_box
        add_box(torso, self.links[0], -depth / 2, depth / 2, 0.0, height)
        for side in (LEFT, RIGHT):
            parent, pitch = torso, pose[4]
            for k, link in enumerate(self.links[1:]):  # hip + thigh, knee + shin, ankle + foot
                pitch = pitch + self.start_joints[SAGITTAL[3 * side + k]]
                body = add_body(link, points[side, k], pitch)
                low, high = robot.joint_min[2 + k], robot.joint_max[2 + k]
                # A motor turns a against b at `rate`; pitch is minus angle, so that is q̇ of b.
                motor = pymunk.SimpleMotor(parent, body, 0.0)
                motor.max_force = robot.torque_limit[2 + k] * self.torque_share  # [N m]
                motors.append(motor)
                pivot = pymunk.PivotJoint(parent, body, tuple(points[side, k]))
                space.add(motor, pivot, pymunk.RotaryLimitJoint(parent, body, -high, -low))
                parent = body
            add_box(parent, link, -robot.foot_back, robot.foot_front,
                    -robot.ankle_height, 0.02 - robot.ankle_height)  # fmt: skip
        return space, motors

    def _read(self, robots):
        """State [n, 7, 6] of all bodies of these robots; one buffer for all spaces."""
        from pymunk import batch

        fields = batch.BodyFields
        wanted = fields.POSITION | fields.ANGLE | fields.VELOCITY | fields.ANGULAR_VELOCITY
        self.buffer.clear()
        for i in robots:
            batch.get_space_bodies(self.spaces[i], wanted, self.buffer)
        # Seven bodies and, last, the ground.
        return np.frombuffer(self.buffer.float_buf()).reshape(-1, 8, 6)[:, :7]

    def joint_angles(self, bodies):
        """Sagittal joint angles [..., 6] of body states [..., 7, 6]."""
        pitch = -bodies[..., 2]
        return pitch[..., 1:] - pitch[..., self.PARENT]

    def run(self, robots, joints, turn, side):
        """joints [n, T + 1, 6] [rad]; turn, side [n, T]: yaw [rad] and sideways [m] per tick."""
        from pymunk import SimpleMotor

        set_rate = SimpleMotor.rate.fset  # `motor.rate = …` at half its price
        robot, ticks = self.robot, joints.shape[1] - 1
        substeps = round(robot.control_dt / robot.physics_dt)
        speed_limit = np.tile(robot.speed_limit[2:5], 2)
        feed_forward = np.diff(joints, axis=1) / robot.control_dt  # [n, T, 6] [rad/s]
        seen = np.empty((len(robots), ticks + 1, 7, 6))
        seen[:, 0] = self.bodies[robots]
        for t in range(ticks):
            # A motor that only followed the error would lag: add the target's own rate.
            error = joints[:, t] - self.joint_angles(seen[:, t])
            rate = feed_forward[:, t] + robot.planar_gain * error
            rate = np.minimum(np.maximum(rate, -speed_limit), speed_limit)
            for i, rates in zip(robots, rate.tolist()):
                for motor, value in zip(self.motors[i], rates):
                    set_rate(motor, value)
            clock = time.perf_counter()
            for i in robots[~self.lost[robots]]:
                for _ in range(substeps):
                    self.spaces[i].step(robot.physics_dt)
            self.seconds += time.perf_counter() - clock
            seen[:, t + 1] = self._read(robots)
            if not np.abs(seen[:, t + 1]).max() < 1e4:  # too large, or not a number
                self.lost[robots] |= ~(np.abs(seen[:, t + 1]) < 1e4).all((1, 2))
        self.bodies[robots] = seen[:, -1]
        return self._motion(robots, seen, turn, side)

    def _motion(self, robots, seen, turn, side):
        """World pose and falls from the bodies' states seen [n, T + 1, 7, 6]."""
        robot, dt = self.robot, self.robot.control_dt
        # N = Σ mᵢ·(v̇ᵢ + g): only the ground can hold the robot up. [n, T]
        lift = np.diff((seen[..., 4] * self.masses).sum(-1), axis=1) / dt
        force = np.nan_to_num(np.maximum(lift + self.masses.sum() * robot.gravity, 0.0))
        limit = np.minimum(robot.torque_limit[0], robot.friction * force * self.sole_radius)
        angle, com = seen[:, :, 0, 2], self.links[0].com[2]
        x = seen[:, :, 0, 0] + np.sin(angle) * com  # [n, T + 1] torso frame below its centre
        height = seen[:, :, 0, 1] - np.cos(angle) * com
        ahead = np.nan_to_num(np.diff(x, axis=1))  # [n, T] forward motion, measured
        k, c = robot.yaw_stiffness, robot.yaw_damping
        pose, rate, twist = self.world[robots], self.yaw_rate[robots], self.twist[robots]
        yaw = np.repeat(pose[:, 2:], turn.shape[1] + 1, 1)  # [n, T + 1]
        for t in range(turn.shape[1]):  # everything below is [n]
            bound = limit[:, t]  # min(motor limit, μ·N·r) [N m]
            # τ = clip(k·e + c·ė, ±bound),  ė = commanded minus true yaw rate;  I·ψ̈ = τ
            torque = k * twist + c * (turn[:, t] / dt - rate)
            torque = np.minimum(np.maximum(torque, -bound), bound)
            rate = rate + torque / robot.yaw_inertia * dt
            yaw[:, t + 1] = yaw[:, t] + rate * dt
            # |e| ≤ bound / k: what would twist the leg further turns the foot on the ground
            twist = twist + turn[:, t] - rate * dt
            twist = np.minimum(np.maximum(twist, -bound / k), bound / k)
        cos, sin = np.cos(yaw[:, :-1]), np.sin(yaw[:, :-1])
        torso = np.zeros((len(robots), turn.shape[1], 6))
        torso[..., 0] = pose[:, :1] + np.cumsum(cos * ahead - sin * side, 1)
        torso[..., 1] = pose[:, 1:2] + np.cumsum(sin * ahead + cos * side, 1)
        torso[..., 5] = yaw[:, 1:]
        self.world[robots], self.yaw_rate[robots] = torso[:, -1, [0, 1, 5]], rate
        self.twist[robots] = twist
        torso[..., 2], torso[..., 4] = height[:, 1:], -angle[:, 1:]
        lost = self.lost[robots]
        torso[lost] = np.nan_to_num(torso[lost])
        down = fallen(torso[..., 2], np.cos(torso[..., 4]), self.standing_height).any(1)
        spin = np.stack([0 * rate, -seen[:, -1, 0, 5], rate], -1)
        foot, (cx, _, cz) = seen[:, -1, [3, 6], :3], self.links[3].com  # [n, 2, 3] x, z, angle
        cos, sin = np.cos(foot[..., 2]), np.sin(foot[..., 2])
        foot_x = foot[..., 0] - (cos * cx - sin * cz) - x[:, -1, None]  # ankle ahead of the torso
        return torso, self.joint_angles(seen[:, 1:]), spin, foot_x, down | lost

    def bare_seconds(self):
        """See `PymunkSim.bare_seconds`."""
        return self.seconds

    def torque(self):
        """Size of the motors' torque in the last physics step, [n, 6] [N m]."""
        impulse = [[abs(motor.impulse) for motor in motors] for motors in self.motors]
        return np.array(impulse) / self.robot.physics_dt

    def power(self, on):
        """Switch all motors on or off, of robots built from now on too."""
        self.torque_share = float(on)
        for motors in self.motors:
            for k, motor in enumerate(motors or ()):
                motor.max_force = self.robot.torque_limit[2 + k % 3] * self.torque_share


def planar_worker(pipe, robot, num_robots, joints):
    """A worker process: serves the methods of its own PlanarRobots until the pipe closes."""
    robots = PlanarRobots(robot, num_robots, joints)
    try:
        while True:
            method, arguments = pipe.recv()
            pipe.send(getattr(robots, method)(*arguments))
    except (EOFError, KeyboardInterrupt, BrokenPipeError):
        pass


class PymunkSim:
    """N planar robots, spread over worker processes: robot i lives in worker i mod W."""

    name = "pymunk"
    planar = True

    def __init__(self, num_robots, joints=None, robot=RobotModel(), cores=None):
        self.robot, self.num_robots = robot, num_robots
        self.start_joints = stance(robot, planar=True) if joints is None else joints
        self.standing_height = standing_torso(robot, self.start_joints)[2]
        cores = max(1, min(cores or CORES, num_robots))
        counts = [len(range(w, num_robots, cores)) for w in range(cores)]
        self._pipes, self._processes = [], []
        self._local = None
        if cores == 1:  # no process is worth starting
            self._local = PlanarRobots(robot, num_robots, self.start_joints)
            return
        context = multiprocessing.get_context("spawn")  # the same on every system
        for count in counts:
            pipe, end = context.Pipe()
            process = context.Process(
                target=planar_worker, args=(end, robot, count, self.start_joints), daemon=True
            )
            process.start()
            end.close()
            self._pipes.append(pipe)
            self._processes.append(process)

    def _call(self, method, robots=None, *arrays):
        """Call a method in every worker that has some of these robots; returns (rows, result)s."""
        if self._local is not None:
            arguments = arrays if robots is None else (robots, *arrays)
            return [(slice(None), getattr(self._local, method)(*arguments))]
        asked = []
        for w, pipe in enumerate(self._pipes):
            if robots is None:
                rows, arguments = slice(w, None, len(self._pipes)), arrays
            else:
                rows = np.flatnonzero(robots % len(self._pipes) == w)
                if not len(rows):
                    continue
                arguments = (robots[rows] // len(self._pipes), *(a[rows] for a in arrays))
            pipe.send((method, arguments))
            asked.append((rows, pipe))
        return [(rows, pipe.recv()) for rows, pipe in asked]

    def reset(self, robots):
        """Put these robots (indices [n]) back to standing at the origin."""
        if len(robots):
            self._call("reset", np.asarray(robots))

    def run(self, trajectory, robots):
        """Let these robots [n] follow their trajectory; returns their Motion."""
        robots, trunk = np.asarray(robots), trajectory.trunk
        step = np.diff(trunk[..., [0, 1, 5]], axis=1)  # [n, T, 3]
        cos, sin = np.cos(trunk[:, :-1, 5]), np.sin(trunk[:, :-1, 5])
        side = cos * step[..., 1] - sin * step[..., 0]  # [n, T] sideways, seen from the trunk
        n, ticks = step.shape[:2]
        torso, joints = np.empty((n, ticks, 6)), trajectory.joints[:, 1:].copy()
        spin, foot_x, fell = np.empty((n, 3)), np.empty((n, 2)), np.empty(n, bool)
        sagittal = trajectory.joints[..., SAGITTAL]
        for rows, result in self._call("run", robots, sagittal, step[..., 2], side):
            torso[rows], seen, spin[rows], foot_x[rows], fell[rows] = result
            joints[np.ix_(np.arange(n)[rows], np.arange(ticks), SAGITTAL)] = seen
        # Feet: measured forward, as commanded sideways and in yaw, beside the measured torso.
        last, feet = trunk[:, -1], trajectory.feet[:, -1]  # [n, 6], [n, 2, 4]
        away = feet[..., :2] - last[:, None, :2]
        side = np.cos(last[:, 5, None]) * away[..., 1] - np.sin(last[:, 5, None]) * away[..., 0]
        pose = torso[:, -1, [0, 1, 5]][:, None]  # [n, 1, 3]
        cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
        world = np.stack(
            [pose[..., 0] + cos * foot_x - sin * side, pose[..., 1] + sin * foot_x + cos * side,
             pose[..., 2] + feet[..., 3] - last[:, None, 5]], -1)  # fmt: skip
        return Motion(torso, joints, spin, world, fell)

    def bare_seconds(self):
        """Wall-clock that the busiest worker's `run` has spent in nothing but physics [s]."""
        return max(result for _, result in self._call("bare_seconds"))

    def torque(self):
        """Size of the torque of every motor in the last physics step, [N, 12] [N m]."""
        torque = np.zeros((self.num_robots, 12))
        for rows, result in self._call("torque"):
            torque[np.arange(self.num_robots)[rows][:, None], SAGITTAL] = result
        return torque

    def power(self, on):
        """Switch all motors on or off."""
        self._call("power", None, on)

    def close(self):
        """End the worker processes."""
        for pipe in self._pipes:
            pipe.close()
        for process in self._processes:
            process.join(timeout=5)
        self._pipes, self._processes = [], []


SIMULATORS = {"pymunk": PymunkSim, "mujoco": MujocoSim}


# ---------------------------------------------------------------------------- command line


class StageParser(argparse.ArgumentParser):
    """The same flags in every stage; a wrong value gets one clear line and exit code 2."""

    def __init__(self, **settings):
        super().__init__(**settings)
        for stream in (sys.stdout, sys.stderr):  # Windows pipes may not know α or ±
            if hasattr(stream, "reconfigure"):
                stream.reconfigure(errors="replace")

    def error(self, message):
        """One line instead of the usage."""
        self.exit(2, f"{self.prog}: {message}\n")


def stage_parser(doc, prog=None):
    """A parser with --mujoco, --seed and --out; the help is the head of the stage's file."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = StageParser(prog=prog, description=doc, formatter_class=raw)
    parser.add_argument("--mujoco", action="store_true", help="3-D instead of the sagittal plane")
    parser.add_argument("--seed", type=int, default=0, help="the same seed gives the same numbers")
    parser.add_argument("--out", type=Path, help="folder for what is written; runs/<sim>/")
    return parser


def parse_stage(parser, argv=None):
    """Parsed arguments, with `sim` ("pymunk" or "mujoco")."""
    args = parser.parse_args(argv)
    args.sim = "mujoco" if args.mujoco else "pymunk"
    if args.seed < 0:
        parser.error(f"--seed must not be negative, got {args.seed}")
    if args.mujoco:
        try:
            import mujoco  # noqa: F401
        except ImportError:
            parser.error("--mujoco needs MuJoCo: python -m pip install mujoco")
    import matplotlib

    matplotlib.use("Agg")  # draws into files, needs no screen
    return args


def output_folder(parser, args, default=None):
    """The folder to write to (default: runs/<sim>), made and known to be writable before work."""
    out = args.out or default or Path("runs") / args.sim
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=out):
            return out
    except OSError as error:
        parser.error(f"cannot write to the folder {out} ({error.strerror}), choose another --out")


def main():
    """See the head of this file."""
    parser = stage_parser(__doc__)
    args = parse_stage(parser)
    out = output_folder(parser, args)
    robot = RobotModel()
    print(f"{'body':8s} {'mass [kg]':>10s} {'centre of mass [m]':>22s} {'inertia [kg m²]':>26s}")
    for name, link in zip(("torso", "hip", "thigh", "shin", "foot"), (robot.torso, *robot.leg)):
        com = ", ".join(f"{v:.3f}" for v in link.com)
        inertia = ", ".join(f"{v:.4f}" for v in link.inertia)
        print(f"{name:8s} {link.mass:10.3f} {com:>22s} {inertia:>26s}")
    print(f"total    {robot.mass:10.3f}   (every part below the torso twice)\n")

    count, seconds = 64, 3.0
    sim = SIMULATORS[args.sim](count)
    everybody, ticks = np.arange(count), round(seconds / robot.control_dt)
    joints = stance(robot, planar=sim.planar)
    still = Trajectory(
        np.tile(joints, (count, ticks + 1, 1)),
        np.zeros((count, ticks + 1, 6)),
        np.zeros((count, ticks + 1, 2, 4)),
    )
    sim.reset(everybody)
    clock = time.perf_counter()
    stood = sim.run(still, everybody)
    speed = count * seconds / (time.perf_counter() - clock)
    wanted = standing_torso(robot, joints)
    sag = 1000 * (wanted[2] - stood.torso[0, -1, 2])
    print(f"{count} robots stood for {seconds:.0f} s: {stood.fell.sum()} fell; "
          f"torso sag {sag:.1f} mm,")  # fmt: skip
    print("  torques of the left leg [N m]: " + ", ".join(
        f"{name} {torque:.1f}" for name, torque in zip(JOINTS, sim.torque()[0])))  # fmt: skip
    print(f"  {speed:.0f} seconds of one robot simulated per second on {CORES} cores")
    sim.power(False)
    fallen_motion = sim.run(still, everybody)
    sim.close()
    print(f"Motors off: {fallen_motion.fell.sum()} of {count} fell.")
    plot_robot(robot, stood, fallen_motion, out / "01_robot.png")
    print("Look at", out / "01_robot.png")


def plot_robot(robot, stood, falling, path):
    """From the side: standing, then eight moments of the fall without motors."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(9, 4.5), layout="constrained", sharey=True)
    draw_robot(axes[0], robot, stood.torso[0, -1], stood.joints[0, -1])
    axes[0].set(title="standing for 3 s", ylabel="z [m]")
    height = falling.torso[0, :, 2]
    down = np.argmax(height < 1.02 * height.min() + 0.01)  # the tick when it is almost down
    last = min(round(1.3 * down), len(height) - 1)
    moments = np.linspace(0, last, 8).astype(int)
    for i, k in enumerate(moments):
        draw_robot(axes[1], robot, falling.torso[0, k], falling.joints[0, k], (i + 1) / 8)
    axes[1].set(title=f"motors off: eight moments of {last * robot.control_dt:.1f} s")
    axes[0].plot([], [], "tab:green", lw=3, label="left leg")
    axes[0].plot([], [], "tab:red", lw=3, label="right leg (behind)")
    axes[0].legend(loc="upper right", fontsize=8)
    for axis in axes:
        axis.axhline(0, color="0.5", lw=1)
        axis.set(xlabel="x [m]", aspect="equal", xlim=(-0.6, 0.6), ylim=(-0.05, 0.85))
    figure.savefig(path, dpi=110)
    plt.close(figure)


def draw_robot(axis, robot, torso, joints, alpha=1.0):
    """The robot from the side: torso [6] and joints [12] as measured. Green: left, red: right."""
    points, _ = body_points(robot, torso, joints)  # [2, 5, 3]
    depth, _, height = robot.torso_box
    box = np.array([[-depth, 0], [depth, 0], [depth, 2 * height], [-depth, 2 * height]]) / 2
    cos, sin = np.cos(torso[4]), np.sin(torso[4])
    x = torso[0] + cos * box[:, 0] + sin * box[:, 1]
    z = torso[2] - sin * box[:, 0] + cos * box[:, 1]
    axis.fill(x, z, color="0.75", alpha=alpha, zorder=1)
    hip = points[:, 0].mean(0)
    axis.plot([torso[0], hip[0]], [torso[2], hip[2]], color="0.75", lw=5, alpha=alpha, zorder=1)
    for leg, color in ((RIGHT, "tab:red"), (LEFT, "tab:green")):
        x, z = points[leg, [0, 1, 2, 3, 4, 2], 0], points[leg, [0, 1, 2, 3, 4, 2], 2]
        axis.plot(x, z, color=color, alpha=alpha, lw=3, solid_joinstyle="round", zorder=2)


if __name__ == "__main__":
    main()
