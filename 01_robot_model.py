"""Stage 1: what is the robot, and what does physics do with it?

Paper: section II-a, a simulated biped with position-controlled joints. The robot is [6]. (Sections
and references have the paper's numbers. `tests/exercises/ledger.md` lists what the paper says.)

    python 01_robot_model.py             pymunk: sagittal plane + yaw
    python 01_robot_model.py --mujoco    MuJoCo: full 3-D

Draws the robot with its lengths (`runs/<sim>/01_standing.png`). Then 101 robots stand for a second.
Each of them leans forward to an angle of its own, between 0.25 and 0.35 rad. This takes eight
simulated seconds, slow at the beginning and at the end. Then it waits for three seconds.
`01_robot.png` shows the robot that fell at the smallest lean. The program takes 4 seconds. Nothing
in it is random, so `--seed` changes nothing.

Predict this smallest lean. The feet (1.19 kg, centre of mass 0.001 m behind the ankle axes) do
not move. All the rest (4.93 kg) turns about the ankles. Before it leans, its centre of mass is
0.0137 m ahead of the ankle axes and 0.4104 m above them. The toes are 0.108 m ahead of the axes.
By which angle must the rest turn, so that the centre of mass of the whole robot is above the toes?
The planar robot falls at 0.002 rad less than your pencil says, because even a slow lean has some
speed. In 3-D the motor of a joint is a spring (`stiffness` of `RobotModel`), and two ankles share
the load. By how much do the ankles give way, and does that help or hurt? (Answers:
`tests/exercises/predict.md`, lean.)

How to read this file: read down to the line of equals signs, "the end of a first reading". Below it
are the simulators, the drawing, and the code for the command line and for files.

      seen from its right side                        seen from behind
        z                                               z
        |    _____                                      |
        |   |     |   torso                        _____|_____
        |   |  .  |   (. is its frame)            |     .     |
        |   |__|__|                               |___________|
        |      o       3 hip joints,           left o---+---o right
        |      |       hip_z < 0: below             |   |hip_y
        |      |       the frame                    |       |
        |      |  thigh_length                      |       |
        |      o       knee                         |       |
        |     /   shin_length                       |       |
        |    o         2 ankle joints               o       o
        |  __|___      ankle_height               __|_     _|__
        +--------- x                         y ---------+
      heel ^    ^ toe                          foot_width, foot_outward
      foot_back, foot_front: sole behind and ahead of the ankle axis
      hip_y: from the middle to one hip

    joint of a leg   axis   a positive angle
    hip yaw           z     turns the toes to the left
    hip roll          x     swings the leg to the left
    hip pitch         y     swings the leg back
    knee              y     bends it: swings the shin back
    ankle pitch       y     lowers the toes
    ankle roll        x     lifts the left edge of the sole

Frames: x forward, y left, z up. Angles are in radians, positive by the right-hand rule (the thumb
along the axis); a positive pitch turns z towards x, so the torso leans forward. The twelve joints
are those of the left leg, then those of the right leg, each in the order of the table. The sagittal
plane is the plane of x and z. Trunk and torso mean the same part: "trunk" is where it is commanded
to be, "torso" where it is. The support foot stays on the floor while the swing foot moves. The sole
is the rectangle under a foot. Letters in the shapes of arrays: N all robots, n some of them (given
by their indices), T control ticks of 0.01 s, in each of which a motor gets a new target.

The robot measures the angles of its joints and, with an IMU (inertial measurement unit), the
torso's tilt and turning rates. (It measures the goal in stage 3.) Left out: all other sensors, arms
and head (their mass is in the torso), gear play. Only the soles can touch anything.

[6] Bestmann et al., 2021: Wolfgang-OP: A Robust Humanoid Robot Platform for Research and
    Competitions.
"""

import contextlib
import copy
import importlib.util
import math
import os
import signal
import sys
import tempfile
import threading
import time
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pymunk
from matplotlib.colors import to_rgb

LEFT, RIGHT = 0, 1
COLORS = ("tab:blue", "tab:orange")  # of the left and of the right foot in every figure
JOINTS = ("hip yaw", "hip roll", "hip pitch", "knee", "ankle pitch", "ankle roll")
SAGITTAL = np.array([2, 3, 4, 8, 9, 10])  # the six of twelve joints that the planar robot has
GROUND = [0, 1, 5]  # x, y, yaw of a torso's pose: where it stands on the floor
READ_EVERY = 2  # [ticks] how often the IMU is read; our choice


@dataclass(frozen=True)
class Link:
    """A rigid body. `com` is seen from the joint above (torso: its frame); y outward for a leg."""

    mass: float  # [kg]
    com: tuple  # [m] centre of mass (x, y, z)
    inertia: tuple  # [kg m²] about the centre of mass (x, y, z)


@dataclass(frozen=True)
class RobotModel:
    """Wolfgang-OP, simplified; as in its public model of 2024-10 unless a line says otherwise."""

    # Masses, centres of mass, the torso's inertia: public model; arms as carried in a walk, the
    # left leg. Other inertias: our estimates for the merged parts.
    torso: Link = Link(3.490, (-0.007, 0.0, 0.141), (0.050, 0.037, 0.025))  # with arms and head
    hip: Link = Link(0.389, (0.0, 0.0, 0.0), (0.0004, 0.0004, 0.0004))  # yaw and roll motors
    thigh: Link = Link(0.242, (0.0, 0.0, -0.133), (0.0008, 0.0008, 0.0003))
    shin: Link = Link(0.088, (0.0, 0.0, -0.062), (0.0003, 0.0003, 0.0001))
    foot: Link = Link(0.595, (-0.001, 0.004, -0.006), (0.0012, 0.0016, 0.0016))  # and ankle motors
    hip_y: float = 0.055  # [m] hip beside the torso frame
    hip_z: float = -0.041  # [m] height of the hips in the torso frame
    hip_x: float = 0.0231  # [m] hip pitch axis ahead of the axes of hip yaw and roll
    thigh_length: float = 0.169  # [m] hip axis to knee axis
    shin_length: float = 0.170  # [m] knee axis to ankle axis
    ankle_height: float = 0.053  # [m] ankle axis above the sole
    foot_front: float = 0.108  # [m] sole ahead of the ankle axis
    foot_back: float = 0.076  # [m] sole behind the ankle axis
    foot_width: float = 0.090  # [m]
    foot_outward: float = 0.015  # [m] centre of the sole outside the ankle axis
    sole_height: float = 0.020  # [m] thickness of the plate that touches the ground; our choice
    # Motors: yaw, roll, pitch, knee, ankle pitch, ankle roll of one leg.
    torque_limit: tuple = (10.0, 10.0, 10.0, 12.9, 10.0, 10.0)  # [N m] at standstill
    speed_limit: tuple = (5.76, 5.76, 5.76, 3.87, 5.76, 5.76)  # [rad/s] here no torque is left
    joint_min: tuple = (-1.57, -1.6, -2.74, -0.49, -1.42, -1.4)  # [rad] the knee's are rounded
    joint_max: tuple = (1.57, 1.6, 0.82, 2.51, 0.37, 1.4)  # [rad]
    # [N m s/rad] back-EMF (a turning motor is a generator, too, and brakes itself): it and dry
    # friction leave nothing at the speed limit
    damping: tuple = (1.23, 1.23, 1.23, 2.92, 1.23, 1.23)
    stiction: tuple = (2.55, 2.55, 2.55, 1.49, 2.55, 2.55)  # [N m] dry friction
    armature: float = 0.01  # [kg m²] inertia of a motor's rotor, seen through the gears; our choice
    # The world.
    friction: float = 0.7  # [-] foot on ground, μ; the robot's team simulates with 0.5
    gravity: float = 9.81  # [m/s²]
    control_dt: float = 0.010  # [s] a control tick: a new joint target; our choice
    substeps: int = 2  # [-] physics steps in a control tick, in both simulators; our choice
    stiffness: float = 300.0  # [N m/rad] position gain of a motor: torque per error; only in MuJoCo
    # pymunk only.
    planar_gain: float = 40.0  # [1/s] speed of a motor per position error; our choice
    planar_iterations: int = 20  # [-] of the solver; our choice: joints stay within 1.3 mm
    yaw_inertia: float = 0.05  # [kg m²] whole robot about the vertical; our estimate

    @property
    def hips(self):
        """Both hips in the trunk's frame, [2, 3] [m]."""
        return np.array([[0, self.hip_y, self.hip_z], [0, -self.hip_y, self.hip_z]])


@dataclass
class Body:
    """How n robots differ from the model. Stage 3 chooses the values at random (domain
    randomization), and no planner sees them."""

    friction: np.ndarray  # [n] μ of the floor
    mass: np.ndarray  # [n, 9] factors: torso, left hip, thigh, shin, foot, right ones
    stiffness: np.ndarray  # [n, 12] factors on the position gain of the motors
    stiction: np.ndarray  # [n, 12] [N m] dry friction
    delay: np.ndarray  # [n] [ticks] 0 or 1, from target to motor
    zero: np.ndarray  # [n, 12] [rad] where a joint is when its sensor says 0
    com: np.ndarray  # [n, 3] [m] from the torso's centre of mass in the model to that of the robot

    @classmethod
    def as_model(cls, robot, n):
        """The Body of n robots that do not differ from the model."""
        return cls(
            np.full(n, robot.friction),
            np.ones((n, 9)),
            np.ones((n, 12)),
            np.tile(robot.stiction, (n, 2)),
            np.zeros(n, int),
            np.zeros((n, 12)),
            np.zeros((n, 3)),
        )


@dataclass
class Trajectory:
    """The commands for n robots in T control ticks. Sample k is the target after k ticks. Sample 0
    repeats the last target of the trajectory before."""

    joints: np.ndarray  # [n, T + 1, 12] joint targets [rad]
    trunk: np.ndarray  # [n, T + 1, 6] x, y, z [m], roll, pitch, yaw [rad]

    @property
    def most_ticks(self):
        """The number of ticks that it takes at most. (A plan of stage 2 may wait.)"""
        return self.joints.shape[1] - 1

    def begin(self):
        """The robots begin to follow it."""

    def ended(self, tick):
        """Which robots have no command left after this number of ticks, [n] bool."""
        return np.full(len(self.joints), tick >= self.most_ticks)

    def targets(self, robot, rows, tick, tilt, angular_velocity):
        """The next joint targets for some rows [k] of the plan, and what is added to them.

        These are samples [k, ticks + 1, 12] from now on, and additions [k, ticks, 12]. The robot's
        computer asks for them every READ_EVERY ticks. Here nothing is added (open loop). The plans
        of stage 2 answer what is measured (closed loop).

        tilt, angular_velocity [k, 2]: roll and pitch of the torso [rad] and its rates about its x
        and y axes [rad/s], as measured now.
        """
        samples = self.joints[rows, tick : tick + READ_EVERY + 1]
        return samples, np.zeros_like(samples[:, 1:])


@dataclass
class Disturbance:
    """Pushes, and errors of the IMU, that n robots meet in T control ticks. No plan knows them."""

    push: np.ndarray  # [n, T, 2] [N] on the torso: x, y of the world; planar: x ahead of the torso
    gyro_error: np.ndarray  # [n, T, 2] [rad/s] measured − true angular velocity about x and y
    tilt_error: np.ndarray  # [n, T, 2] [rad] measured − true roll and pitch

    @classmethod
    def none(cls, plan):
        """No push and an exact IMU, as long as this Trajectory lasts."""
        return cls(*np.zeros((3, len(plan.joints), plan.most_ticks, 2)))


@dataclass
class Motion:
    """The simulated motion of n robots: at the end of each of T control ticks, or at the very end.
    If a robot needed fewer ticks than another one, its last state is repeated."""

    torso: np.ndarray  # [n, T, 6] x, y, z [m], roll, pitch, yaw [rad] in the world
    joints: np.ndarray  # [n, T, 12] measured [rad]; those that the planar robot lacks: as commanded
    angular_velocity: np.ndarray  # [n, 3] of the torso about its own axes [rad/s], at the very end
    fell: np.ndarray  # [n] bool: fell at any control tick
    ticks: np.ndarray  # [n] control ticks that it needed


def some_rows(record, rows):
    """A Trajectory or a Disturbance for some of its robots only."""
    values = {field.name: getattr(record, field.name) for field in fields(record)}
    arrays = {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
    return replace(record, **{name: value[rows] for name, value in arrays.items()})


# ------------------------------------------------------------------------ poses on the floor
def wrap(angle):
    """The same angle in [−π, π) [rad]."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def turned(vector, yaw):
    """Vectors [..., 2] turned by yaw [...] [rad]."""
    x, y = np.moveaxis(vector, -1, 0)
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.stack([cos * x - sin * y, sin * x + cos * y], -1)


def compose(base, pose):
    """The pose [..., 3] (x, y, yaw) given in the frame `base` [..., 3], seen from outside."""
    position = base[..., :2] + turned(pose[..., :2], base[..., 2])
    yaw = base[..., 2:] + pose[..., 2:]  # [..., 1]
    return np.concatenate([position, yaw], -1)


def relative(base, pose):
    """The pose [..., 3] seen from the frame `base` [..., 3]; inverse of `compose`."""
    away = pose - base
    position = turned(away[..., :2], -base[..., 2])
    return np.concatenate([position, away[..., 2:]], -1)


# ------------------------------------------------------------------------ leg kinematics
def rotation(roll, pitch, yaw):
    """Rz(yaw)·Ry(pitch)·Rx(roll): numbers or arrays of one shape [...] in, [..., 3, 3] out."""
    angles = np.array(np.broadcast_arrays(roll, pitch, yaw))  # [3, ...]
    cr, cp, cy = np.cos(angles)
    sr, sp, sy = np.sin(angles)
    rows = [
        cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,
        sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,
        -sp, cp * sr, cp * cr,
    ]  # fmt: skip
    return np.stack(rows, -1).reshape(*cr.shape, 3, 3)


def leg_points(robot, joints):
    """Where the parts of a leg are, in the hip's frame, for angles [..., 6].

    Returns points [..., 5, 3]: hip (its axis of pitch), knee, ankle, heel, toe [m], the last two
    straight behind and ahead of the ankle at the height of the sole; and the foot's rotation
    [..., 3, 3] = Rz(hip yaw)·Rx(hip roll)·Ry(hip pitch + knee + ankle pitch)·Rx(ankle roll).
    """
    yaw, roll, pitch, knee, ankle_pitch, ankle_roll = np.moveaxis(joints, -1, 0)
    hip_turn = rotation(roll, 0, yaw)  # [..., 3, 3]
    thigh_turn = hip_turn @ rotation(0, pitch, 0)
    shin_turn = hip_turn @ rotation(0, pitch + knee, 0)
    foot_turn = hip_turn @ rotation(ankle_roll, pitch + knee + ankle_pitch, 0)
    hip = robot.hip_x * hip_turn[..., 0]  # the axis of hip pitch; [..., 0]: first column, x
    knee_point = hip - robot.thigh_length * thigh_turn[..., 2]  # a leg hangs along −z
    ankle = knee_point - robot.shin_length * shin_turn[..., 2]
    heel = ankle + foot_turn @ [-robot.foot_back, 0, -robot.ankle_height]
    toe = ankle + foot_turn @ [robot.foot_front, 0, -robot.ankle_height]
    return np.stack([hip, knee_point, ankle, heel, toe], -2), foot_turn


def leg_inverse(robot, position, foot_turn):
    r"""Joint angles [..., 6] [rad] of one leg, analytically.

    position [..., 3]: ankle in the hip's frame [m]; foot_turn [..., 3, 3]: rotation of the foot. An
    ankle out of reach is moved along its line to the hip, only as far as needed; finally the angles
    are clipped to the joint limits. The function is meant for feet below their hips that tilt by
    less than half a turn. For other feet it may return angles that do not make their pose.

         o hip      Thigh, shin and the vector r from the ankle to the hip form a triangle. It lies
          \          in the plane in which the leg bends; hip pitch, knee and ankle pitch turn about
           o knee   the normal of this plane, so they cannot move r out of it.
          /
         o__ ankle

    1. The ankle's roll is the only joint between foot and shin that turns about another axis. So it
       is the angle that brings r, given in the foot's frame, into the plane of x and z.
    2. What is left of the foot's rotation gives hip yaw, hip roll, and the sum of three pitches.
    3. The length of r gives the knee (law of cosines).
    4. In the plane two angles of r are known: seen from the shin (from the triangle), and seen from
       the foot. The ankle's pitch is their difference, and the hip's pitch is the rest of the sum.
    """
    thigh, shin = robot.thigh_length, robot.shin_length
    # R is foot_turn, p is position. The hip seen from the ankle, in the foot's frame: r = Rᵀ·(−p).
    # (A row times R is the row of Rᵀ·column, as (Rᵀ·v)ᵀ = vᵀ·R.)
    r = (-position[..., None, :] @ foot_turn)[..., 0, :]  # [..., 3]
    # Before the ankle rolls, r = (rx, 0, h). When the foot turns by +roll, r turns by −roll as seen
    # from it: r = Rx(−roll)·(rx, 0, h) = (rx, h·sin roll, h·cos roll) with h > 0.
    ankle_roll = np.arctan2(r[..., 1], r[..., 2])
    # M = R·Rx(−ankle roll) = Rz(hip yaw)·Rx(hip roll)·Ry(s),  s = hip pitch + knee + ankle pitch
    #     |       ·          −sin yaw·cos roll         ·       |
    #   = |       ·           cos yaw·cos roll         ·       |
    #     | −cos roll·sin s       sin roll       cos roll·cos s |
    roll_back = rotation(-ankle_roll, 0, 0)
    M = foot_turn @ roll_back
    yaw = np.arctan2(-M[..., 0, 1], M[..., 1, 1])
    roll = np.arcsin(np.clip(M[..., 2, 1], -1, 1))
    pitches = np.arctan2(-M[..., 2, 0], M[..., 2, 2])  # s
    # So far the hip was where yaw and roll turn. The axis of hip pitch is hip_x ahead of there,
    # along the x axis (the first column) of a frame that is turned by −s before the ankle rolls:
    # there it is (cos s, 0, sin s).
    ahead = (roll_back @ rotation(0, -pitches, 0))[..., 0]  # [..., 3]
    rx, ry, rz = np.moveaxis(r + robot.hip_x * ahead, -1, 0)
    length = np.sqrt(rx**2 + ry**2 + rz**2)  # [...]
    # Law of cosines: |r|² = thigh² + shin² + 2·thigh·shin·cos(knee). (Plus, because the triangle's
    # inner angle is π − knee: knee = 0 is a straight leg.) Of ±knee we take the positive.
    shortest = math.sqrt(thigh**2 + shin**2 + 2 * thigh * shin * math.cos(robot.joint_max[3]))
    reach = np.clip(length, shortest, thigh + shin)
    knee = np.arccos(np.clip((reach**2 - thigh**2 - shin**2) / (2 * thigh * shin), -1, 1))
    # The pitch of a vector is its angle from z towards x. Seen from the shin,
    # r = (−thigh·sin knee, 0, shin + thigh·cos knee)
    from_shin = np.arctan2(-thigh * np.sin(knee), shin + thigh * np.cos(knee))
    # Seen from the foot, after the roll: r = (rx, 0, √(ry² + rz²))
    from_foot = np.arctan2(rx, np.hypot(ry, rz))
    ankle_pitch = from_shin - from_foot
    pitch = pitches - knee - ankle_pitch
    joints = np.stack([yaw, roll, pitch, knee, ankle_pitch, ankle_roll], -1)
    return np.clip(joints, robot.joint_min, robot.joint_max)


def body_inverse(robot, trunk, feet, planar=False):
    """Joint angles [..., 12] that put both feet in their places; planar: legs below their hips.

    trunk [..., 6]: x, y, z, roll, pitch, yaw (or [..., 2, 6]: another one for each leg); feet
    [..., 2, 4]: x, y, z of the point of the sole below the ankle, yaw.
    """
    if trunk.ndim < feet.ndim:
        trunk = trunk[..., None, :]  # [..., 1, 6] the same for both legs
    # Feet seen from a level frame that is at the trunk and turns with it  [..., 2] each
    seen = relative(trunk[..., GROUND], feet[..., [0, 1, 3]])
    x, y, yaw = np.moveaxis(seen, -1, 0)
    if planar:
        y[:] = robot.hips[:, 1]
        yaw[:] = 0.0
    height = feet[..., 2] + robot.ankle_height - trunk[..., 2]  # ankle above trunk
    ankle = np.stack([x, y, height], -1)  # [..., 2, 3]
    # From the level frame into the leaning one: p ← Rᵀ·p, foot's rotation ← Rᵀ·Rz(yaw)
    lean = rotation(trunk[..., 3], trunk[..., 4], 0)  # [..., 1 or 2, 3, 3]
    ankle = (ankle[..., None, :] @ lean)[..., 0, :]
    foot_turn = lean.swapaxes(-1, -2) @ rotation(0, 0, yaw)
    joints = leg_inverse(robot, ankle - robot.hips, foot_turn)  # [..., 2, 6]
    return joints.reshape(*joints.shape[:-2], 12)


def body_points(robot, torso, joints):
    """Legs in the world, [..., 2, 5, 3] (hip … toe), and the feet's rotations [..., 2, 3, 3].

    torso [..., 6]: x, y, z, roll, pitch, yaw; joints [..., 12].
    """
    base = rotation(*np.moveaxis(torso[..., None, 3:], -1, 0))  # [..., 1, 3, 3]
    points, foot_turn = leg_points(robot, joints.reshape(*joints.shape[:-1], 2, 6))
    # points @ Rᵀ turns every row p into R·p.
    world = (points + robot.hips[:, None]) @ base.swapaxes(-1, -2) + torso[..., None, None, :3]
    return world, base @ foot_turn


def foot_poses(robot, torso, joints):
    """Where the ankles are on the floor, and where the toes point: [K, 2, 3] x, y [m], yaw [rad];
    torso [K, 6], joints [K, 12]."""
    points, turn = body_points(robot, torso, joints)
    yaw = np.arctan2(turn[..., 1, 0], turn[..., 0, 0])  # [K, 2]
    return np.dstack([points[:, :, 2, :2], yaw])  # point 2 is the ankle


def stance(robot, planar=False, height=0.395, foot_distance=0.18, pitch=0.1, x_offset=0.0):
    """Torso's pose [6] and joints [12] of a robot that stands with its torso above the origin.

    The trunk is `x_offset` ahead of the feet. (The default values, in [m] and [rad], are a first
    guess for this stage; stage 2 passes its own.)
    """
    trunk = np.array([0, 0, height, 0, pitch, 0])
    feet = np.array([[-x_offset, y, 0, 0] for y in (foot_distance / 2, -foot_distance / 2)])
    return trunk, body_inverse(robot, trunk, feet, planar)


def fallen(torso, standing_height):
    """Which poses are falls (Bestmann 2022), [...] bool: the torso [..., 6] is below half its
    standing height, or tilted beyond 45°."""
    cos_tilt = np.cos(torso[..., 3]) * np.cos(torso[..., 4])
    return (torso[..., 2] < 0.5 * standing_height) | (cos_tilt < math.cos(math.pi / 4))


def centre_of_mass(robot, torso, joints):
    """Σ mᵢ·pᵢ / Σ mᵢ over all links, [K, 3] in the world; torso [K, 6], joints [K, 12]."""
    points, foot_turn = body_points(robot, torso, joints)
    turn = rotation(*torso[:, 3:].T)  # [K, 3, 3]
    # Half way between both legs  [K, 3] each
    hip, knee, ankle, _, _ = points.mean(1).swapaxes(0, 1)
    x, _, z = robot.foot.com  # the outward offsets of parallel feet cancel
    centres = [  # of the torso, and half way between both hips, thighs, shins, feet  [K, 3] each
        torso[:, :3] + turn @ robot.torso.com,
        torso[:, :3] + turn @ robot.hips.mean(0),
        hip + robot.thigh.com[2] / robot.thigh_length * (hip - knee),  # on the line of the joints
        knee + robot.shin.com[2] / robot.shin_length * (knee - ankle),
        ankle + foot_turn.mean(1) @ [x, 0, z],
    ]
    pairs = robot.hip, robot.thigh, robot.shin, robot.foot
    masses = [robot.torso.mass, *(2 * link.mass for link in pairs)]
    return np.average(centres, 0, masses)


# ------------------------------------------------------------------------ demonstration
def plot_standing(robot, standing, path):
    """The robot as it stands (torso [6], joints [12]) from its right side and from behind, with its
    lengths in mm."""
    torso, joints = standing
    hip, knee, ankle, heel, toe = body_points(robot, torso, joints)[0][RIGHT]  # [3] each
    frame, sole = torso[:3], ankle - [0, 0, robot.ankle_height]
    low = frame + [0, 0, robot.hip_z]
    edge = sole - [0, robot.foot_outward + robot.foot_width / 2, 0]
    side = {
        "thigh_length": (hip, knee),
        "shin_length": (knee, ankle),
        "ankle_height": (ankle, sole),
        "foot_front": (sole, toe),
        "foot_back": (heel, sole),
    }
    behind = {
        "hip_z": (frame, low),
        "hip_y": (low, low - [0, robot.hip_y, 0]),
        "trunk_height": (frame, frame * [1, 1, 0]),
        "foot_width": (edge, edge + [0, robot.foot_width, 0]),
    }
    figure, panels = plt.subplots(1, 2, figsize=(9, 5.9), sharey=True)
    titles = "from its right side, lengths in mm", "from behind"
    for panel, title, azimuth, lengths in zip(panels, titles, (-90, 180), (side, behind)):
        camera = camera_at(azimuth, 0)
        draw_robots(panel, robot, torso[None], joints[None], camera)
        height = 0.35  # of the first name [m]
        for name, (start, end) in lengths.items():
            _, right, up = camera @ np.transpose([start, end])  # [2] each
            panel.plot(right, up, "k.-")
            text = f"{name} {1000 * np.linalg.norm(end - start):.0f}"
            line = {"arrowstyle": "-", "color": "0.5"}
            panel.annotate(text, (right.mean(), up.mean()), (0.18, height), arrowprops=line)
            height -= 0.09
        panel.set(title=title, aspect="equal", xlim=(-0.3, 0.42), xlabel="[m]", ylabel="[m]")
    save_figure(figure, path)


def main():
    args = stage_parser(__doc__).parse_args()
    out = output_folder(args)
    robot = RobotModel()
    standing = stance(robot, SIMULATORS[args.sim].planar)
    plot_standing(robot, standing, out / "01_standing.png")

    leans = np.linspace(0.25, 0.35, 101)  # [rad]
    joints = np.tile(standing[1], (len(leans), 1201, 1))  # [N, T + 1, 12] for 12 s
    # Stand for a second, lean within eight, then wait: at the smallest lean a fall takes seconds.
    # The feet stay flat, so a negative pitch of both ankles tilts all the rest forward.
    time = np.clip(np.linspace(-1, 11, 1201) / 8, 0, 1)  # [T + 1] 0: before the lean, 1: after it
    share = (1 - np.cos(np.pi * time)) / 2  # [T + 1] of the lean
    joints[..., [4, 10]] -= leans[:, None, None] * share[:, None]
    print(len(leans), "robots lean forward: some seconds", flush=True)
    sim = make_sim(args.sim, len(leans), standing)
    motion = sim.run(np.arange(len(leans)), Trajectory(joints, np.zeros_like(joints[..., :6])))
    sim.close()
    if motion.fell[0] or not motion.fell.any():
        raise InputError("all of these robots fall, or none: change the range of `leans`")
    i = motion.fell.argmax()  # the first one
    print(f"the smallest lean of a fall: {leans[i]:.3f} rad")
    down = fallen(motion.torso[i], standing[0][2]).argmax()  # [ticks] when the fall counts
    moments = slice(down - 60, down + 1, 10)  # seven
    torso, joints = motion.torso[i, moments], motion.joints[i, moments]

    figure, axes = plt.subplots()
    camera = camera_at(-90, 10)
    draw_ground(axes, camera, 0.5)
    draw_robots(axes, robot, torso, joints, camera)
    _, right, up = camera @ centre_of_mass(robot, torso, joints).T
    axes.plot(right, up, "k.-")
    axes.axvline(robot.foot_front, color="black", ls=":")
    axes.set_title(
        f"The last 0.6 s of a fall: lean {leans[i]:.3f} rad, squares of 0.25 m\n"
        "dots: centre of mass; dotted line: the toes, as they stood"
    )
    save_figure(figure, out / "01_robot.png")
    print("Look at 01_standing.png and 01_robot.png in", out)


# ==================================================================== the end of a first reading
# ------------------------------------------------------------------------ the control loop
class Simulator:
    """N robots, and the computer that every robot carries: it reads the IMU, asks the plan for
    joint targets, and hands them to the motors. A kind of physics is a class that adds

        place(robots, body)             these robots stand at the origin; body: None, as before
        imu(robots)                     the torso's roll and pitch [n, 2] [rad], and its rates about
                                        x and y [n, 2] [rad/s]
        advance(robots, targets, push)  simulates some ticks and returns their states [n, ticks, …];
                                        `state` [N, …] becomes the newest ones
        motion(robots, plan, states, ticks)
                                        what states [n, T + 1, …] mean: torso [n, T, 6], joints
                                        [n, T, 12], the last angular velocity [n, 3], and which
                                        robots diverged [n]
        close()                         only if there is something to end

    where targets [n, ticks, 2, 12] are joint targets [rad] and their rates [rad/s], and push
    [n, ticks, 2] is the force on the torso [N]. Its constructor makes `state` and calls `reset`. As
    `simulate` of stages 2 and 3 it gets what `make_sim` gets.
    """

    planar = False  # do the robots live in the sagittal plane?
    TARGETS = slice(1, None)  # of the samples: a tick gets the target of its end

    def __init__(self, num_robots, standing, robot):
        check_robot(robot)
        self.robot = robot
        self.standing = standing  # torso [6], joints [12], see `stance`
        self.body = Body.as_model(robot, num_robots)
        self.last = np.zeros((num_robots, 2, 12))  # joint targets of the last tick, and their rates

    def reset(self, robots, body=None):
        """Robots [n] stand at the origin again; body: their Body, None: as before."""
        self.last[robots] = self.standing[1], np.zeros(12)
        if body is not None:
            check(body, above_zero=("mass",), may_be_negative=("zero", "com"))
            for name, values in vars(body).items():
                getattr(self.body, name)[robots] = values
        self.place(robots, body)

    def run(self, robots, plan, disturbance=None):
        """Lets these robots [n] follow their plan, a Trajectory; returns their Motion."""
        robots = np.asarray(robots)
        disturbance = disturbance or Disturbance.none(plan)
        plan.begin()
        states, tick, ticks = [self.state[robots][:, None]], 0, np.zeros(len(robots), int)
        while not (ended := plan.ended(tick)).all():
            rows = np.flatnonzero(~ended)  # [k] whose plan goes on
            on = robots[rows]
            tilt, rates = self.imu(on)
            tilt = tilt + disturbance.tilt_error[rows, tick]
            rates = rates + disturbance.gyro_error[rows, tick]
            samples, added = plan.targets(self.robot, rows, tick, tilt, rates)
            speeds = np.diff(samples, axis=1) / self.robot.control_dt  # [k, ticks, 12] [rad/s]
            end = tick + speeds.shape[1]
            angles = samples[:, self.TARGETS] + added
            now = np.stack([angles, speeds], 2)  # [k, ticks, 2, 12]
            late = np.concatenate([self.last[on][:, None], now[:, :-1]], 1)  # by a tick
            self.last[on] = now[:, -1]
            sent = np.where(self.body.delay[on, None, None, None], late, now)
            sent[:, :, 0] += self.body.zero[on, None]
            part = np.repeat(states[-1][:, -1:], end - tick, 1)  # the others stay as they are
            part[rows] = self.advance(on, sent, disturbance.push[rows, tick:end])
            states.append(part)
            ticks[rows] = tick = end
        states = np.concatenate(states, 1)  # [n, T + 1, …]
        torso, joints, angular_velocity, lost = self.motion(robots, plan, states, ticks)
        fell = fallen(torso, self.standing[0][2]).any(1) | lost
        return Motion(torso, joints, angular_velocity, fell, ticks)

    def close(self):
        """Ends its threads, if it has any."""


# ------------------------------------------------------------------------ MuJoCo, 3-D
def inertial(link, side=1):
    """A link's mass in MJCF, MuJoCo's model language; side −1 mirrors its place."""
    x, y, z = link.com
    xx, yy, zz = link.inertia
    return f'<inertial mass="{link.mass}" pos="{x} {side * y} {z}" diaginertia="{xx} {yy} {zz}"/>'


def leg_xml(robot, leg, side):
    """One leg in MJCF, from the hip down: nested bodies; side: 1 left, −1 right.

    Every body has its mass and its joints to the body around it. The foot also has its sole, a box:
    pos is its centre seen from the ankle, size is half of each side [m].
    """
    axes = "0 0 1", "1 0 0", "0 1 0", "0 1 0", "0 1 0", "1 0 0"  # of the joints: z, x, y, y, y, x

    def joint(k):
        return (
            f'<joint name="{leg} {JOINTS[k]}" axis="{axes[k]}" damping="{robot.damping[k]}" '
            f'frictionloss="{robot.stiction[k]}" '
            f'range="{robot.joint_min[k]} {robot.joint_max[k]}"/>'
        )

    return f"""
      <body name="{leg} hip" pos="0 {side * robot.hip_y} {robot.hip_z}">
        {inertial(robot.hip, side)} {joint(0)} {joint(1)}
        <body name="{leg} thigh" pos="{robot.hip_x} 0 0">
          {inertial(robot.thigh, side)} {joint(2)}
          <body name="{leg} shin" pos="0 0 {-robot.thigh_length}">
            {inertial(robot.shin, side)} {joint(3)}
            <body name="{leg} foot" pos="0 0 {-robot.shin_length}">
              {inertial(robot.foot, side)} {joint(4)} {joint(5)}
              <geom name="{leg} sole" type="box"
                    pos="{(robot.foot_front - robot.foot_back) / 2} {side * robot.foot_outward}
                         {robot.sole_height / 2 - robot.ankle_height}"
                    size="{(robot.foot_front + robot.foot_back) / 2} {robot.foot_width / 2}
                          {robot.sole_height / 2}"/>
            </body>
          </body>
        </body>
      </body>"""


def mujoco_model(robot):
    """The robot as a MuJoCo model. Each motor is a position servo (it drives its joint to a target
    angle) with a torque-speed line:

        τ = clip(stiffness·(target − q), ±torque limit) − damping·q̇

    At the speed limit dry friction takes the rest of it. (<position> makes the first term, the
    joint's damping is the second one.) A joint that the floor drives backward is braked harder than
    the limit, as by a real motor.

    elliptic: the friction cone is round, so friction is equal in all directions. MuJoCo's own
        choice, a pyramid, is 1.3 times faster and lets feet skate between the axes.
    warmstart, island: speed-ups of the solver that do not pay here.
    contype 0: only the listed pairs of shapes can touch.
    hfield: a map of heights for uneven floors; it lies below the floor until the study `kicks`
        raises it.
    condim 3: a contact has one normal force and two friction forces, each with its μ. (The other
        three numbers of `friction` are for turning and rolling: condim 4 and 6.)
    """
    import mujoco

    motors = ""
    for leg in ("left", "right"):
        for name, limit in zip(JOINTS, robot.torque_limit):
            motors += (
                f'<position name="{leg} {name}" joint="{leg} {name}" '
                f'forcerange="{-limit} {limit}"/>'
            )
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <compiler angle="radian"/>
      <option timestep="{robot.control_dt / robot.substeps}" gravity="0 0 {-robot.gravity}"
              cone="elliptic">
        <flag warmstart="disable" island="disable"/>
      </option>
      <default>
        <geom contype="0" conaffinity="0"/>
        <pair condim="3" friction="{robot.friction} {robot.friction} 0 0 0"/>
        <joint armature="{robot.armature}"/>
        <position kp="{robot.stiffness}"/>
      </default>
      <asset>
        <hfield name="blocks" nrow="160" ncol="160" size="4 4 1 0.1"/>
      </asset>
      <worldbody>
        <geom name="ground" type="plane" size="0 0 1"/>
        <geom name="blocks" type="hfield" hfield="blocks" pos="0 0 -1"/>
        <body name="torso">
          <freejoint/>
          {inertial(robot.torso)}
          {leg_xml(robot, "left", 1)} {leg_xml(robot, "right", -1)}
        </body>
      </worldbody>
      <actuator> {motors} </actuator>
      <contact>
        <pair geom1="ground" geom2="left sole"/>
        <pair geom1="ground" geom2="right sole"/>
        <pair geom1="left sole" geom2="right sole"/>
        <pair geom1="blocks" geom2="left sole"/>
        <pair geom1="blocks" geom2="right sole"/>
      </contact>
    </mujoco>""")


def euler(quaternion):
    """Roll, pitch, yaw [..., 3] of unit quaternions [..., 4] (w, x, y, z).

    A turn by φ about a unit axis n is the quaternion (cos φ/2, sin φ/2·n). The formulas compare the
    last row and the first column of its rotation matrix with those of `rotation`.
    """
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.stack([roll, pitch, yaw], -1)


class MujocoSim(Simulator):
    """N robots in 3-D. Every call of `mujoco.rollout` runs all of them on all cores.

    At the beginning of a tick a servo gets the target of the tick's end, which is 5 ms early on
    average. Back-EMF makes a moving joint late by damping / stiffness: 4.1 ms, at the knee 9.7 ms.
    Dry friction makes it late by stiction / (stiffness · rate): at 1 rad/s 8.5 ms, the knee 5.0 ms.
    Together, as measured at this rate, the knee is 7.4 ms late, and the other joints are 5.2 to
    5.5 ms late. The targets' rates are not used.

    model: another MuJoCo model. It has a free joint, our twelve joints and their servos in our
    order, and pairs of shapes that touch, made of soles and floor. parts: its bodies, by name or
    number, to which the columns of `Body.mass` belong, the torso first. (In our model they have the
    numbers 1 to 9; 0 is the world.)
    """

    # Columns of MuJoCo's state [38]; from 20 on velocities: of the position, angular velocity about
    # the torso's own axes, of the joints.
    TIME = 0
    POSITION = slice(1, 4)
    TURN = slice(4, 8)  # a quaternion
    ANGLES = slice(8, 20)
    OMEGA = slice(23, 26)

    def __init__(self, num_robots, standing, robot, cores=None, model=None, parts=range(1, 10)):
        import mujoco.rollout  # only here: everything else works without MuJoCo

        super().__init__(num_robots, standing, robot)
        # A diverging robot would fill the terminal and a log file; we report it as a fall.
        mujoco.set_mju_user_warning(lambda text: None)
        torso, joints = standing
        self.model = model or mujoco_model(robot)
        if not math.isclose(self.model.opt.timestep * robot.substeps, robot.control_dt):
            raise ValueError("the model's timestep must be control_dt / substeps")
        cores = min(cores or CORES, num_robots)
        self.parts = [self.model.body(name).id for name in parts]
        self.models = [self.model] * num_robots  # of each robot; its own after a reset with a Body
        self.data = [mujoco.MjData(self.model) for _ in range(cores)]
        self.pool = mujoco.rollout.Rollout(nthread=cores)
        self.process = os.getpid()
        self.inputs = mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_XFRC_APPLIED
        # Standing at the origin [38]: turned by the pitch about y, see `euler`; at rest.
        turn = [math.cos(torso[4] / 2), 0, math.sin(torso[4] / 2), 0]
        self.start = np.concatenate([[0], torso[:3], turn, joints, np.zeros(self.model.nv)])
        self.state = np.tile(self.start, (num_robots, 1))
        self.reset(np.arange(num_robots))

    def place(self, robots, body):
        """See `Simulator`."""
        import mujoco

        self.state[robots] = self.start
        if body is None:
            return
        for row, i in enumerate(robots):
            self.models[i] = model = copy.copy(self.model)
            model.body_mass[self.parts] *= body.mass[row]
            model.body_inertia[self.parts] *= body.mass[row, :, None]
            model.body_ipos[self.parts[0]] += body.com[row]
            model.pair_friction[:, :2] = body.friction[row]
            # A servo's force is gainprm[0]·target + biasprm[1]·q, with stiffness and −stiffness.
            model.actuator_gainprm[:, 0] *= body.stiffness[row]
            model.actuator_biasprm[:, 1] *= body.stiffness[row]
            model.dof_frictionloss[6:] = body.stiction[row]
            mujoco.mj_setConst(model, self.data[0])  # what MuJoCo derives from the masses

    def imu(self, robots):
        """See `Simulator`."""
        state = self.state[robots]
        return euler(state[:, self.TURN])[:, :2], state[:, self.OMEGA][:, :2]

    def advance(self, robots, targets, push):
        """See `Simulator`."""
        if os.getpid() != self.process:  # its threads are not there: it would wait for ever
            raise RuntimeError("this world was made in another process: make one in this process")
        substeps = self.robot.substeps
        # 12 targets; then force and torque on every body, 6 numbers each: the world's from 12 on
        inputs = np.zeros((*push.shape[:2], 12 + 6 * self.model.nbody))
        inputs[..., :12] = targets[:, :, 0]
        torso = 12 + 6 * self.parts[0]
        inputs[..., torso : torso + 2] = push
        states, _ = self.pool.rollout(
            [self.models[i] for i in robots],
            self.data,
            self.state[robots],
            np.repeat(inputs, substeps, axis=1),
            control_spec=self.inputs,
        )
        self.state[robots] = states[:, -1]
        return states[:, substeps - 1 :: substeps]

    def motion(self, robots, plan, states, ticks):
        """See `Simulator`."""
        # MuJoCo checks every step: a state that is not finite, or huge, goes back to the start, at
        # time 0, so that it ends too early. We count this as a fall.
        seconds = ticks * self.robot.control_dt  # [n]
        lost = states[:, -1, self.TIME] < states[:, 0, self.TIME] + seconds - 1e-6
        states[lost] = states[lost, :1]
        self.state[robots] = states[:, -1]
        seen = states[:, 1:]
        torso = np.concatenate([seen[..., self.POSITION], euler(seen[..., self.TURN])], -1)
        return torso, seen[..., self.ANGLES], seen[:, -1, self.OMEGA], lost

    def close(self):
        """Ends its threads."""
        self.pool.close()


# ------------------------------------------------------------------------ pymunk, planar
def planar_links(robot):
    """The seven bodies: torso with both hips' motors; left thigh, shin, foot; the right ones."""
    parts = robot.torso, robot.hip, robot.hip
    mass = np.array([link.mass for link in parts])
    centres = np.array([link.com for link in parts])  # [3, 3] in the torso's frame
    centres[1:, 2] += robot.hip_z
    x, _, z = centre = np.average(centres, 0, mass)
    # Parallel axes: I = Σ (Iᵢ + mᵢ·(xᵢ² + zᵢ²)), xᵢ and zᵢ from the common centre of mass
    away = ((centres - centre) ** 2)[:, [0, 2]].sum(1)  # [3] [m²]
    pitch = sum([link.inertia[1] for link in parts] + mass * away)
    torso = Link(mass.sum(), (x, 0, z), (pitch,) * 3)  # only the one about y is used
    return torso, *(robot.thigh, robot.shin, robot.foot) * 2


class PymunkSim(Simulator):
    """N planar robots: pymunk simulates the sagittal plane; yaw and sideways motion are added.

    pymunk's y is our z, and its angles turn x towards y, against our pitch:

        pymunk's angle of a body   = −pitch
        joint angle q              = pitch − parent's pitch = parent's angle − angle
        pymunk's angle of a joint  = angle − parent's angle = −q   (for its limits)
        `rate` of pymunk's motors  = turning rate of the parent − that of the link = +q̇

    Yaw ψ is a degree of freedom of its own. Its rate follows the commanded one; the torque of the
    hip's motor and the friction of the sole limit how fast (`run_yaw`). Sideways the robot moves as
    commanded, and it cannot fall to the side.

    Two simplifications: a motor has its full torque up to its speed limit (in MuJoCo the torque
    falls linearly to zero there), and a rotor adds to the inertia of the link below its joint as
    if it turned with that link (in MuJoCo only to the inertia about the joint).
    """

    planar = True
    TARGETS = slice(-1)  # a tick gets the target of its beginning, see `advance`
    PARENT = np.array([0, 1, 2, 0, 4, 5])  # of the bodies 1…6: thigh, shin, foot; 0: torso
    MASS = [0, 2, 3, 4, 6, 7, 8]  # of the bodies in Body.mass; the hips go with the torso

    def __init__(self, num_robots, standing, robot, cores=None):
        super().__init__(num_robots, standing, robot)
        self.links = planar_links(robot)
        # r, the mean distance of the sole's points from its centre: if a force F presses evenly on
        # the sole, friction can bear the torque r·μ·F.
        middles = np.linspace(-0.49, 0.49, 50)  # of strips, as a share of the length or width
        length = robot.foot_front + robot.foot_back
        # all pairs of x and y  [50, 50] -> r [m]
        self.sole_radius = np.hypot.outer(length * middles, robot.foot_width * middles).mean()
        self.spaces = [None] * num_robots
        self.bodies = [None] * num_robots  # seven of each robot
        self.motors = [None] * num_robots  # six of each robot
        self.state = np.zeros((num_robots, 10))  # see `_read`
        self.pose = np.zeros((num_robots, 3))  # x, y [m], yaw ψ [rad] of the torso in the world
        self.yaw_rate = np.zeros(num_robots)  # ψ̇ [rad/s]
        self.lost = np.zeros(num_robots, bool)  # diverged
        self.reset(np.arange(num_robots))

    def place(self, robots, body):
        """See `Simulator`."""
        torso = self.links[0]
        part = self.robot.torso.mass / torso.mass  # the hips' motors do not move with `com`
        # Centre of mass of torso and hips in the torso's frame: x, z ([::2]) [m]  [N, 2]
        self.centre = torso.com[::2] + part * self.body.com[:, ::2]
        for i in robots:  # in a fresh space: a used one keeps contacts of the last fall
            self.spaces[i], self.bodies[i], self.motors[i] = self._build(i)
        self.pose[robots] = 0
        self.yaw_rate[robots] = 0
        self.lost[robots] = False
        self.state[robots] = self._read(robots)

    def _build(self, i):
        """A space with the floor and standing robot i; the robot's seven bodies and six motors."""
        robot, (torso, joints) = self.robot, self.standing
        space = pymunk.Space()
        space.gravity = 0, -robot.gravity
        space.iterations = robot.planar_iterations
        space.collision_slop = 0.0005  # [m] pymunk's own value is meant for pixels
        # The segment lies 1 m below z = 0 and has a radius of 1 m: its upper side is z = 0.
        ground = pymunk.Segment(space.static_body, (-1e4, -1), (1e4, -1), 1)
        ground.friction = self.body.friction[i]  # pymunk MULTIPLIES both shapes' μ; the other is 1
        space.add(ground)
        legs = body_points(robot, torso, joints)[0][:, :3, [0, 2]].reshape(6, 2)
        points = np.vstack([torso[[0, 2]], legs]).tolist()  # [7, 2] upper joint of each body
        pitches = torso[4] + np.append(0, joints[SAGITTAL].reshape(2, 3).cumsum(1))  # [7]
        bodies, motors = [], []
        for k, (link, point, pitch) in enumerate(zip(self.links, points, pitches)):
            mass = link.mass * self.body.mass[i, self.MASS[k]]
            body = pymunk.Body(mass, link.inertia[1] * mass / link.mass)
            x, z = self.centre[i] if k == 0 else link.com[::2]
            # pymunk counts from the centre of mass: put it at the joint, turn it, then move it to
            # where the link's (x, z) is, so that the joint comes to be at `point`.
            body.angle = -pitch
            body.position = point
            body.position = body.local_to_world((x, z))
            space.add(body)
            bodies.append(body)
            if link is robot.foot:
                ends = -robot.foot_back, robot.foot_front
                low = -robot.ankle_height
                heights = low, low + robot.sole_height
                shape = pymunk.Poly(body, [(u - x, w - z) for u in ends for w in heights])
                shape.friction = 1.0
                shape.filter = pymunk.ShapeFilter(group=1)  # the feet do not touch one another
                space.add(shape)
            if k:
                # The rotor turns with the link below it. Its inertia also stabilises the solver:
                # without it the light shin makes a standing robot sway, by 2 cm in a second.
                body.moment += robot.armature
                parent = bodies[self.PARENT[k - 1]]
                joint = SAGITTAL[k - 1]
                index = joint % 6  # in its leg
                motor = pymunk.SimpleMotor(parent, body, 0.0)
                # Dry friction lowers the largest torque (in MuJoCo it also holds a joint at rest).
                motor.max_force = max(0, robot.torque_limit[index] - self.body.stiction[i, joint])
                low, high = -robot.joint_max[index], -robot.joint_min[index]
                space.add(
                    motor,
                    pymunk.PivotJoint(parent, body, point),
                    pymunk.RotaryLimitJoint(parent, body, low, high),
                )
                motors.append(motor)
        return space, bodies, motors

    def _read(self, robots):
        """The torso's x, z [m], turning rate [rad/s] and pitch, then the six joint angles [rad]:
        [n, 10]."""
        rows = []
        for i in robots:
            torso = self.bodies[i][0]
            pitches = [-body.angle for body in self.bodies[i]]
            rows.append([*torso.position, -torso.angular_velocity, *pitches])
        states = np.array(rows)
        states[:, 4:] -= states[:, 3 + self.PARENT]  # a joint's angle: pitch − parent's pitch
        return states

    def run(self, robots, plan, disturbance=None):
        """See `Simulator`. Fifty robots at a time: so many fit into a processor's cache."""
        disturbance, motions = disturbance or Disturbance.none(plan), []
        for first in range(0, len(robots), 50):
            rows = slice(first, first + 50)
            part = some_rows(plan, rows), some_rows(disturbance, rows)
            motions.append(super().run(robots[rows], *part))
        arrays = zip(*(vars(motion).values() for motion in motions))
        return Motion(*map(np.concatenate, arrays))

    def imu(self, robots):
        """See `Simulator`; the plane has no roll."""
        return self.state[robots, 3:4] * [0, 1], self.state[robots, 2:3] * [0, 1]

    def advance(self, robots, targets, push):
        """See `Simulator`. A motor that only followed the error would lag behind a moving target,
        so the target's rate is added (feedforward). Then the joint is where the target is at the
        end of each tick.
        """
        robot = self.robot
        limit = np.tile(robot.speed_limit[2:5], 2)  # [6] [rad/s]
        gain = robot.planar_gain * self.body.stiffness[robots][:, SAGITTAL]  # [n, 6] [1/s]
        dt = robot.control_dt / robot.substeps  # [s]
        states = []
        for (angles, rates), forces in zip(
            targets[..., SAGITTAL].transpose(1, 2, 0, 3), push[..., 0].T
        ):
            last = self.state[robots]  # [n, 10]
            speeds = np.clip(rates + gain * (angles - last[:, 4:]), -limit, limit)  # [n, 6]
            for i, row, force in zip(robots, speeds.tolist(), forces.tolist()):
                for motor, speed in zip(self.motors[i], row):
                    motor.rate = speed
                for _ in range(0 if self.lost[i] else robot.substeps):
                    if force:  # in this step only
                        self.bodies[i][0].force = force, 0
                    self.spaces[i].step(dt)
            now = self._read(robots)
            lost = ~(np.abs(now) < 1e4).all(1)  # diverged; nan < 1e4 is False, too
            now[lost] = last[lost]  # where it was last seen
            self.lost[robots] |= lost
            self.state[robots] = now
            states.append(now)
        return np.stack(states, 1)

    def motion(self, robots, plan, states, ticks):
        """See `Simulator`. (No plan waits on the plane: all robots need the same ticks.)"""
        trunk = plan.trunk[..., GROUND]
        wanted = relative(trunk[:, :-1], trunk[:, 1:])  # [n, T, 3] ahead, sideways, yaw per tick
        yaw = self.run_yaw(wanted[..., 2], robots)  # [n, T + 1]
        pitch = states[..., 3]  # [n, T + 1]
        # From the centre of the torso's body down to the torso's frame. (A positive pitch turns z
        # towards x, a positive angle of `turned` the first axis towards the second: here x to z.)
        frame = states[..., :2] - turned(self.centre[robots, None], -pitch)  # [n, T + 1, 2]
        x, z = np.moveaxis(frame, -1, 0)
        moved = np.stack([np.diff(x), wanted[..., 1]], -1)  # [n, T, 2] x: measured, y: commanded
        position = self.pose[robots, None, :2] + turned(moved, yaw[:, :-1]).cumsum(1)
        others = np.stack([z, 0 * z, pitch, yaw], -1)[:, 1:]  # z, roll, pitch, yaw
        torso = np.concatenate([position, others], -1)  # [n, T, 6]
        self.pose[robots] = torso[:, -1, GROUND]
        joints = plan.joints[:, 1:].copy()
        joints[..., SAGITTAL] = states[:, 1:, 4:]
        # About the own axes of a torso with pitch θ and yaw ψ: ω = (−ψ̇·sin θ, θ̇, ψ̇·cos θ)
        rate, pitch = states[:, -1, 2:4].T  # [n] each
        yaw_rate = self.yaw_rate[robots]
        omega = [-yaw_rate * np.sin(pitch), rate, yaw_rate * np.cos(pitch)]
        return torso, joints, np.stack(omega, -1), self.lost[robots]

    def run_yaw(self, turn, robots):
        """Yaw ψ [n, T + 1] for commanded turns [n, T] [rad] in the ticks."""
        robot = self.robot
        dt = robot.control_dt
        masses = self.body.mass[robots][:, self.MASS] * [link.mass for link in self.links]  # [n, 7]
        # torque ≤ min(motor limit, r·μ·m·g): the sole, on which the whole weight rests, would slip
        grip = self.sole_radius * self.body.friction[robots] * masses.sum(1) * robot.gravity
        torque = np.minimum(robot.torque_limit[0], grip)  # [n] [N m]
        most = torque / robot.yaw_inertia * dt  # largest change of ψ̇ in a tick, as I·ψ̈ = torque
        rate = self.yaw_rate[robots]  # [n] ψ̇
        yaw = [self.pose[robots, 2]]
        for wanted in turn.T / dt:
            # ψ̇ ← ψ̇ + clip(commanded rate − ψ̇, ± the largest change);   ψ ← ψ + ψ̇·dt
            rate = rate + np.clip(wanted - rate, -most, most)
            yaw.append(yaw[-1] + rate * dt)
        self.yaw_rate[robots] = rate
        return np.stack(yaw, -1)


SIMULATORS = {"pymunk": PymunkSim, "mujoco": MujocoSim}
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def make_sim(sim, num_robots, standing, robot=RobotModel(), cores=None):
    """N robots in one of SIMULATORS. At first and after every reset they stand like `standing`,
    which `stance` returns. cores: threads of MuJoCo (None: one for each core); pymunk does not use
    them.
    """
    return SIMULATORS[sim](num_robots, standing, robot, cores)


# ------------------------------------------------------------------------ drawing
# Trunk, head and nose: both ends of a line in the torso's frame [m]; only pictures have a head.
# Then colour and radius [m] of all lines: these three; thigh, shin, foot of both legs, left first.
UPPER_ENDS = np.array(
    [[[0, 0, 0.05], [0, 0, 0.24]], [[0, 0, 0.36], [0, 0, 0.36]], [[0.05, 0, 0.36], [0.08, 0, 0.36]]]
)
LINES = (
    ("0.8", 0.085),
    ("0.88", 0.055),
    ("0.3", 0.016),
    *((color, radius) for color in COLORS for radius in (0.036, 0.029, 0.016)),
)


def camera_at(azimuth=-60, elevation=20):
    """A camera's axes as rows [3, 3]: towards the camera, to the right, up in the picture. It looks
    at the floor from these angles [°], without perspective; (-90, 0): from the right, (-90, 90):
    from above.
    """
    return rotation(0, -np.radians(elevation), np.radians(azimuth)).T


def capsule(start, end, radius):
    """Outline [24, 2] of a thick line from start [2] to end [2], with round ends."""
    x, y = end - start
    across = np.arctan2(y, x) + np.linspace(0.5, 1.5, 12) * np.pi
    half = radius * np.stack([np.cos(across), np.sin(across)], -1)  # of a circle [12, 2]
    return np.concatenate([start + half, end - half])


def draw_robots(axes, robot, torso, joints, camera):
    """Draws one robot at K moments, the last one strongest: torso [K, 6], joints [K, 12] as
    measured; camera: of `camera_at`. Limbs are thick lines, painted from the farthest to the
    nearest one.
    """
    for k, (pose, angles) in enumerate(zip(torso, joints), 1):
        upper = pose[:3] + UPPER_ENDS @ rotation(*pose[3:]).T  # [3, 2, 3]
        points, _ = body_points(robot, pose, angles)  # [2, 5, 3]
        # From hip to knee, knee to ankle, heel to toe of both legs  [6, 2, 3]
        legs = points[:, [[0, 1], [1, 2], [3, 4]]].reshape(6, 2, 3)
        seen = np.concatenate([upper, legs]) @ camera.T  # [9, 2, 3] first: towards the camera
        # The farthest line first: it is as near as the nearer of its ends.
        for j in seen[:, :, 0].max(1).argsort():
            color, radius = LINES[j]
            color = 1 - (1 - np.array(to_rgb(color))) * k / len(torso)
            outline = capsule(*seen[j, :, 1:], radius)
            axes.fill(*outline.T, color=color, ec=color / 2, lw=0.6)


def draw_ground(axes, camera, size=2):
    """Draws squares of 0.25 m on the floor, `size` [m] to every side of the origin."""
    for u in np.arange(-size, size + 0.01, 0.25):
        for line in ([u, u], [-size, size]), ([-size, size], [u, u]):
            axes.plot(*(camera[1:, :2] @ line), color="0.88", lw=0.8, zorder=0)
    axes.set_aspect("equal")
    axes.axis("off")


def draw_way(axes, robot, goal, feet, camera, chosen=()):
    """Draws the goal [3] and measured footprints [K, 2, 3] (x, y, yaw of the ankles) on the floor,
    and bright, with an outline, footsteps [k, 2, 3] that are chosen and not taken yet.

    The goal is a disc of 5 cm, the tolerance, with a tip that points along its yaw; it lies above
    the prints.
    """
    angle = np.linspace(0.6, 2 * np.pi - 0.6, 40)
    disc = np.append(turned((0.05, 0), angle), [(0.25, 0)], 0)  # [41, 2] [m]
    x = np.repeat([robot.foot_front, -robot.foot_back], 2)
    y = np.array([1, -1, -1, 1]) * robot.foot_width / 2

    def fill(pose, outline, face, alpha, edge="none"):
        points = pose[:2] + turned(outline, pose[2])
        axes.fill(*(camera[1:, :2] @ points.T), fc=face, alpha=alpha, ec=edge, lw=2, zorder=0.5)

    for k, poses in enumerate([*feet, *chosen]):
        for pose, outward, color in zip(poses, (1, -1), COLORS):
            sole = np.column_stack([x, y + outward * robot.foot_outward])  # [4, 2] [m]
            fill(pose, sole, *((color, 0.35) if k < len(feet) else ("yellow", 1, color)))
    fill(goal, disc, "tab:green", 0.9)


# ------------------------------------------------------------------------ command line and files
class InputError(Exception):
    """Something that was given cannot be used; the message is one line that says what to do."""


def check(settings, above_zero=(), may_be_negative=()):
    """Raises a ValueError that names a field of these settings (a dataclass) with a wrong value.

    A number must be finite. It must not be negative, unless `may_be_negative` names its field, and
    not 0 if `above_zero` names it. A float must be a single number, an int a whole one.
    """
    for field in fields(settings):
        value = getattr(settings, field.name)
        if is_dataclass(value):
            check(value, above_zero, may_be_negative)
            continue
        try:
            numbers = np.array(value, float)
        except (TypeError, ValueError):
            numbers = np.array(np.nan)
        if (
            not np.isfinite(numbers).all()
            or (field.type in (int, float) and numbers.ndim)
            or (field.type is int and numbers % 1)
            or (field.name not in may_be_negative and (numbers < 0).any())
            or (field.name in above_zero and (numbers == 0).any())
        ):
            raise ValueError(f"{type(settings).__name__}: {field.name} cannot be {value!r:.80}")


def check_robot(robot):
    """Raises a ValueError for a RobotModel with impossible values."""
    lengths = "thigh_length", "shin_length"
    divisors = "speed_limit", "control_dt", "substeps", "stiffness", "planar_iterations"
    check(
        robot,
        above_zero=("mass", "inertia", "yaw_inertia", *lengths, *divisors),
        may_be_negative=("com", "hip_x", "hip_z", "joint_min", "joint_max"),
    )
    for name in "torque_limit", "speed_limit", "joint_min", "joint_max", "damping", "stiction":
        if np.shape(getattr(robot, name)) != (6,):
            raise ValueError(f"RobotModel: {name} needs six numbers, one for each motor of a leg")


@cache
def note(text):
    """Prints a note, but the same one only once."""
    print("note:", text)


def stage_parser(doc):
    """A parser with the flags that every stage has."""
    parser = ArgumentParser(description=doc, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument(
        "--mujoco",
        dest="sim",
        action="store_const",
        const="mujoco",
        default="pymunk",
        help="Simulate the robot in 3-D (MuJoCo) instead of on the plane (pymunk).",
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="The same seed gives the same numbers (default 0)."
    )
    parser.add_argument("--out", type=Path, help="Write into this folder (default runs/<sim>/).")
    return parser


def output_folder(args, *parts):
    """The folder to write to: --out, or these parts below runs/, or runs/<sim>. Makes it if needed.

    Raises an InputError if nothing can be written there, if MuJoCo is asked for and missing, or if
    the seed is negative.
    """
    if args.sim == "mujoco" and importlib.util.find_spec("mujoco") is None:
        raise InputError("--mujoco needs MuJoCo: python -m pip install mujoco")
    if args.seed < 0:
        raise InputError("--seed must be 0 or more")
    out = args.out or Path("runs", *(parts or [args.sim]))
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=out):
            return out
    except OSError as error:
        raise InputError(f"cannot write to {out} ({error.strerror}): choose --out") from error


def atomic_write(path, write):
    """Calls write(temporary file), then renames it: `path` is never only a part of a file.

    Raises an InputError if the disk is full, or if another program keeps the file open.
    """
    temporary = path.with_name(f"{path.stem}.{os.getpid()}.tmp{path.suffix}")  # two may write it
    try:
        write(temporary)
        for wait in (0.2, 0.8, 0):  # [s] a virus scanner on Windows soon lets go of a file
            try:
                os.replace(temporary, path)
                break
            except PermissionError:
                if not wait:
                    raise
                time.sleep(wait)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from error
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path, text):
    """Writes UTF-8 with plain line ends on every system."""
    data = text.encode("utf-8", errors="backslashreplace")  # a file's name may hold any byte
    atomic_write(path, lambda file: file.write_bytes(data))


def save_figure(figure, path):
    """Writes the figure, and frees its memory. In a notebook the file is shown, too."""
    atomic_write(path, lambda file: figure.savefig(file, dpi=110))
    plt.close(figure)
    ipython = sys.modules.get("IPython")  # nobody has imported it: this is no notebook
    if ipython and hasattr(ipython.get_ipython(), "kernel"):
        ipython.display.display(ipython.display.Image(filename=path))


STYLE = {"axes.grid": True, "grid.alpha": 0.3, "figure.constrained_layout.use": True}


def interrupt(number, frame):
    """Raises KeyboardInterrupt, what Ctrl-C does; a moment later if pymunk is freeing memory, where
    the exception would be lost."""
    while frame:
        code = frame.f_code
        if "pymunk" in code.co_filename and "free" in code.co_name:
            threading.Timer(0.05, signal.raise_signal, [number]).start()
            return
        frame = frame.f_back
    raise KeyboardInterrupt


def start(main):
    """Calls a script's main(). Prints one line without a traceback for what is no bug: Ctrl-C, and
    input that cannot be used. A reader like `head` may stop reading. Afterwards a notebook shows
    its own figures as before."""
    sys.stderr = sys.stderr or open(os.devnull, "w")  # pythonw has none
    for stream in sys.stdout, sys.stderr:
        if hasattr(stream, "reconfigure"):  # None, and those of a notebook and of IDLE, have none
            stream.reconfigure(errors="replace")  # a Windows pipe may be unable to encode α
    os.environ.pop("MUJOCO_GL", None)  # a wrong renderer would stop MuJoCo, and we need none
    backend = matplotlib.get_backend(auto_select=False)  # None: not chosen yet
    plt.switch_backend("Agg")  # figures are drawn into files, without a screen
    ctrl_c = signal.getsignal(signal.SIGINT)
    usual = ctrl_c is signal.default_int_handler
    usual &= threading.current_thread() is threading.main_thread()
    if usual:
        signal.signal(signal.SIGINT, interrupt)
    try:
        with plt.rc_context({**matplotlib.rcParamsDefault, "backend": "agg", **STYLE}):
            main()
    except BrokenPipeError:
        os._exit(1)  # nobody reads what is still to be printed
    except (InputError, KeyboardInterrupt) as error:
        message = str(error) or "interrupted"
        print(f"\n{Path(sys.argv[0]).name}: {message}", file=sys.stderr)
        sys.exit(2)
    finally:
        if usual:
            signal.signal(signal.SIGINT, ctrl_c)
        with contextlib.suppress(ImportError):  # a screen that is not there
            plt.switch_backend(backend or "Agg")


if __name__ == "__main__":
    start(main)
