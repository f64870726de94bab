"""Stage 1: what is the robot, and what does physics do with it?

    python 01_robot_model.py             2-D (pymunk), 5 seconds
    python 01_robot_model.py --mujoco    3-D (MuJoCo), 5 seconds

In 3-D the robot has twelve joints, and all of its motion is simulated. In 2-D it lives in the
sagittal plane, the one that is seen from its side, and keeps six of them. This planar robot stands,
slips and falls as physics says, but it sidesteps and turns as commanded.

101 robots slowly lean forward from their ankles, the first to 0.25 rad, the last to 0.35 rad. What
is the smallest lean with which one falls? Predict it (`tests/course/predict.md`, *lean*, shows
how), run the stage, and look at `runs/<sim>/01_robot.png`: this is how that robot falls.

Read down to the line of equals signs, "the end of a first reading". Below it are the kinematics
(from joints to places, and back), the control loop, two kinds of physics, drawing, files, and main.

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

Left out: all sensors but those of the joints and the IMU (inertial measurement unit), gear play,
arms and head (their mass is in the torso). Only the soles can touch anything.

Paper ("Learning Footstep Planning using Deep Reinforcement Learning for Dynamic Walking"): section
II-a, a simulated biped with position-controlled joints; the robot is [6]. Numbers of sections and
references are the paper's. `tests/course/ledger.md` leads from each part of it to the code.

[6] Bestmann et al., 2021: Wolfgang-OP: A Robust Humanoid Robot Platform.
"""

import copy
import math
import os
import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import mujoco.rollout
import numpy as np
import pymunk
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

# x, y, z            forward, left, up [m]
# roll, pitch, yaw   [rad] about x, y, z by the right-hand rule (the thumb points along the axis):
#                    the torso leans to the right, leans forward, turns to the left
# trunk, torso       the same part: trunk where it is commanded to be, torso where it truly is
# tick               10 ms of control: every motor gets a new target
# [N, n, k, …]       shapes: N all robots; n some of them; k those whose double step is not done
# [T, K, S, …]       T ticks; K moments; S double steps
# robots, rows       which of all N robots; which rows of an array [n, …]
LEFT, RIGHT = 0, 1
COLORS = "tab:blue", "tab:orange"  # of the left and of the right foot
JOINTS = (  # of a leg; of twelve joints the left leg's are the first
    "hip yaw",  # about z; a positive angle turns the toes to the left
    "hip roll",  # about x; swings the leg to the left
    "hip pitch",  # about y; swings the leg back
    "knee",  # about y; bends the knee: the shin swings back
    "ankle pitch",  # about y; lowers the toes
    "ankle roll",  # about x; lifts the left edge of the sole
)
SAGITTAL = [2, 3, 4, 8, 9, 10]  # the six of twelve joints that the planar robot has
# The numbers of a pose in stages 1 and 2:
#   torso, trunk          [6]     x, y, z, roll, pitch, yaw
#   state                 [21]    torso; twelve joints; rates of roll, pitch, yaw [rad/s]
#   foot on the floor     [3]     x, y, yaw
#   foot on its way       [4]     x, y, z of the point of the sole below the ankle; yaw
#   trunk_state           [6, 3]  of each number of the trunk: position, velocity, acceleration
#   answer to a lean      [3]     of a leg: a shift to the left; roll, pitch
GROUND = [0, 1, 5]  # columns of a torso's pose and of a state: x, y, yaw
HEIGHT = 2
TORSO = slice(6)  # columns of a state
ANGLES = np.arange(6, 18)
IMU = [3, 4, 18, 19]  # roll, pitch, and their rates
YAW_RATE = 20


@dataclass(frozen=True)
class Link:
    """A rigid body."""

    mass: float  # [kg]
    # [m] centre of mass (x, y, z), seen from the joint above; of a leg's link y points outward
    com: tuple
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
    hip_x: float = 0.0231  # [m] hip pitch axis ahead of where the axes of hip yaw and roll cross
    thigh_length: float = 0.169  # [m] hip axis to knee axis
    shin_length: float = 0.170  # [m] knee axis to ankle axis
    ankle_height: float = 0.053  # [m] ankle axis above the sole
    foot_front: float = 0.108  # [m] sole ahead of the ankle axis
    foot_back: float = 0.076  # [m] sole behind the ankle axis
    foot_width: float = 0.090  # [m]
    foot_outward: float = 0.015  # [m] centre of the sole outside the ankle axis
    sole_height: float = 0.020  # [m] thickness of the plate that touches the ground; our choice
    # Motors of one leg, in the order of JOINTS.
    torque_limit: tuple = (10.0, 10.0, 10.0, 12.9, 10.0, 10.0)  # [N m] at rest, before friction
    # [rad] The knee's are rounded. Those of the rolls are common to both legs.
    joint_min: tuple = (-1.57, -1.6, -2.74, -0.49, -1.42, -1.4)
    joint_max: tuple = (1.57, 1.6, 0.82, 2.51, 0.37, 1.4)
    # [N m s/rad] back-EMF: a turning motor is a generator, too, and brakes itself. So in MuJoCo it
    # has a speed limit: of the torque limit − damping·speed − stiction nearly nothing is left at
    # `speed_limit`, below.
    damping: tuple = (1.23, 1.23, 1.23, 2.92, 1.23, 1.23)
    stiction: tuple = (2.55, 2.55, 2.55, 1.49, 2.55, 2.55)  # [N m] dry friction
    armature: float = 0.01  # [kg m²] inertia of a motor's rotor, seen through the gears; our choice
    # The world.
    friction: float = 0.7  # [-] foot on ground, μ; the robot's team simulates with 0.5
    gravity: float = 9.81  # [m/s²]
    # [m] A standing robot begins this deep inside the floor, else rounding (1e-17) would decide
    # which corners touch, and the same walk would end elsewhere on another processor; our choice
    sink: float = 1e-9
    control_dt: float = 0.010  # [s] a control tick: a new joint target; our choice
    substeps: int = 2  # [-] physics steps in a control tick, in both simulators; our choice
    # MuJoCo only.
    stiffness: float = 300.0  # [N m/rad] position gain of a motor: torque per error; our choice
    # pymunk only.
    speed_limit: tuple = (5.76, 5.76, 5.76, 3.87, 5.76, 5.76)  # [rad/s] of the motors, as above
    planar_gain: float = 40.0  # [1/s] speed of a motor per position error; our choice
    planar_iterations: int = 20  # [-] of the solver: joints open by about 2 mm at most; ours

    @property
    def hips(self):
        """Both hips in the torso's frame, [2, 3] [m]."""
        return np.array([[0, self.hip_y, self.hip_z], [0, -self.hip_y, self.hip_z]])


ROBOT = RobotModel()


class Trajectory:
    """Joint targets of n robots for T control ticks, whatever the robots measure (open loop). The
    plans of stage 2 look the same from outside, and answer what is measured (closed loop)."""

    def __init__(self, joints):
        self.joints = joints  # [n, T + 1, 12] [rad] sample t: after t ticks; sample 0: the stance
        # T. (A plan that can wait, see stage 2, may take more than `ticks`: up to `most_ticks`.)
        self.ticks = self.most_ticks = joints.shape[1] - 1
        self.progress = np.zeros(len(joints))  # [n] ticks of the plan that each robot has done

    def go_on(self, rows, tick, imu):
        """Plans the next tick of the plan's rows [k], when `tick` ticks have passed and
        `Simulator.imu` measures imu [k, 4]. Returns where the joints should be at its end, [k, 12]
        [rad], and how the trunk should move on the floor meanwhile, [k, 3]: x, y [m], yaw [rad]
        seen from where it was. (The planar robot, which has no legs for y and yaw, obeys these two.
        In 3-D only the legs move it.)"""
        self.progress[rows] += 1
        return self.joints[rows, tick + 1], np.zeros((len(rows), 3))


@dataclass
class Motion:
    """The simulated motion of n robots, at the end of each of T control ticks. (Whoever needed
    fewer ticks stays as it was.)"""

    torso: np.ndarray  # [n, T, 6] x, y, z [m], roll, pitch, yaw [rad] in the world
    joints: np.ndarray  # [n, T, 12] true angles [rad]; 0 for those that the planar robot lacks
    fell: np.ndarray  # [n] bool: fell at any control tick, or its simulation diverged
    ticks: np.ndarray  # [n] control ticks that it needed


# ------------------------------------------------------------------------ poses on the floor
def wrap(angle):
    """The same angle from −π to π [rad]. (Both ends are one direction; either will do.)"""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def turned(vector, yaw):
    """Vectors [..., 2] turned by yaw [...] [rad]."""
    x, y = np.moveaxis(vector, -1, 0)
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.stack([cos * x - sin * y, sin * x + cos * y], -1)


def compose(base, pose):
    """The pose [..., 3] (x, y, unwrapped yaw), given in the frame `base` [..., 3], from outside."""
    position = base[..., :2] + turned(pose[..., :2], base[..., 2])
    yaw = base[..., 2:] + pose[..., 2:]  # [..., 1]
    return np.concatenate([position, yaw], -1)


def relative(base, pose):
    """The pose [..., 3] seen from the frame `base` [..., 3]; inverse of `compose`."""
    away = pose - base
    position = turned(away[..., :2], -base[..., 2])
    return np.concatenate([position, away[..., 2:]], -1)


# ------------------------------------------------------------------------ to stand and to fall
def stance(robot, planar=False, height=0.395, foot_distance=0.18, pitch=0.1, x_offset=0.0):
    """Torso's pose [6] and joints [12] of a robot that stands with its torso above the origin,
    `x_offset` [m] ahead of its feet, and its soles `robot.sink` below the floor."""
    trunk = np.array([0, 0, height, 0, pitch, 0])
    feet = np.array([[-x_offset, y, 0, 0] for y in (foot_distance / 2, -foot_distance / 2)])
    joints = joints_for_feet(robot, trunk, feet, planar)
    return trunk - [0, 0, robot.sink, 0, 0, 0], joints


def fallen(torso, standing_height):
    """Which poses are falls ([5] of stage 2), [...] bool: the torso [..., 6] is below half its
    standing height, or its z axis is more than 45° from the vertical."""
    cos_tilt = np.cos(torso[..., 3]) * np.cos(torso[..., 4])
    return (torso[..., 2] < 0.5 * standing_height) | (cos_tilt < math.cos(math.pi / 4))


def centre_of_mass(robot, torso, joints):
    """Σ mᵢ·pᵢ / Σ mᵢ over all links, [K, 3] in the world; torso [K, 6], joints [K, 12]. (Of 6.1 kg,
    h = 0.38 m above the floor in the stance. Were all mass there, a small lean would grow e-fold in
    √(h/g) = 0.2 s.)"""
    points, turns = link_frames(robot, torso, joints)
    links = [robot.torso] + 2 * [robot.hip, robot.thigh, robot.shin, robot.foot]
    coms = np.array([link.com for link in links])
    coms[5:, 1] *= -1  # outward: on the right side to the right
    centres = points + np.matvec(turns, coms)  # [K, 9, 3]
    return np.average(centres, 1, [link.mass for link in links])


# ==================================================================== the end of a first reading
# ------------------------------------------------------------------------ kinematics
def rotation(roll, pitch, yaw):
    """Rz(yaw)·Ry(pitch)·Rx(roll): numbers or arrays that broadcast to [...] in, [..., 3, 3] out."""
    angles = np.array(np.broadcast_arrays(roll, pitch, yaw))  # [3, ...]
    cr, cp, cy = np.cos(angles)
    sr, sp, sy = np.sin(angles)
    rows = [
        cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,
        sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,
        -sp, cp * sr, cp * cr,
    ]  # fmt: skip
    return np.stack(rows, -1).reshape(*cr.shape, 3, 3)


def link_frames(robot, torso, joints):
    """Where the nine links are in the world: torso; left hip, thigh, shin, foot; the right ones.
    From torso [..., 6] and joints [..., 12] to origins [..., 9, 3] (the torso's frame; of a leg the
    hip, the axis of hip pitch, knee, ankle) and rotations [..., 9, 3, 3]. A foot's, from the torso:
    Rz(hip yaw)·Rx(hip roll)·Ry(hip pitch + knee + ankle pitch)·Rx(ankle roll)."""
    shape = joints.shape[:-1]
    legs = joints.reshape(*shape, 2, 6)
    yaw, roll, pitch, knee, ankle_pitch, ankle_roll = np.moveaxis(legs, -1, 0)  # [..., 2] each
    # Seen from the torso
    hip_turn = rotation(roll, 0, yaw)  # [..., 2, 3, 3]
    thigh_turn = hip_turn @ rotation(0, pitch, 0)
    shin_turn = hip_turn @ rotation(0, pitch + knee, 0)
    foot_turn = hip_turn @ rotation(ankle_roll, pitch + knee + ankle_pitch, 0)
    thigh = robot.hip_x * hip_turn[..., 0]  # from the hip [..., 2, 3]; [..., 0]: first column, x
    shin = thigh - robot.thigh_length * thigh_turn[..., 2]  # a leg hangs along −z
    foot = shin - robot.shin_length * shin_turn[..., 2]
    hip = np.zeros_like(thigh)
    points = np.stack([hip, thigh, shin, foot], -2) + robot.hips[:, None]  # [..., 2, 4, 3]
    turns = np.stack([hip_turn, thigh_turn, shin_turn, foot_turn], -3)
    # In the world: p ← R·p + torso, rotation ← R·rotation
    roll, pitch, yaw = np.moveaxis(torso[..., None, 3:], -1, 0)  # [..., 1] each
    R = rotation(roll, pitch, yaw)  # [..., 1, 3, 3]
    origin = torso[..., None, :3]
    points = np.matvec(R, points.reshape(*shape, 8, 3)) + origin
    turns = R @ turns.reshape(*shape, 8, 3, 3)
    return np.concatenate([origin, points], -2), np.concatenate([R, turns], -3)


def leg_inverse(robot, position, foot_turn):
    r"""Joint angles [..., 6] [rad] of one leg, analytically, clipped to the joint limits; position
    [..., 3]: the ankle from the hip [m]; foot_turn [..., 3, 3]: the foot's rotation; both along the
    torso's axes. An ankle out of reach is moved along r, see below, only as far as needed. A foot
    should be below its hip, and tilt by less than about a radian. To check yours: position
    (0.0341, 0, −0.2993) and foot_turn Ry(−0.1) give 0, 0, −0.526, 0.975, −0.549, 0.

    hip +--o hip pitch   Let r (dots) run from the ankle to the axis of hip pitch. Thigh, shin and r
           :\            form a triangle, in the plane in which the leg bends. Hip pitch, knee and
           : o knee      ankle pitch turn about the normal of this plane, so they cannot move r out
           :/            of it. The hip (+), where the axes of yaw and roll cross, is hip_x behind
           o__ ankle     the axis of hip pitch, in this plane, too.

    1. Only the ankle's roll tilts this plane against the foot. So undo it first: seen from the
       foot, a turn by +ankle roll about x brings the hip into the plane of x and z.
    2. What is left of the foot's rotation gives hip yaw, hip roll, and the sum of three pitches.
       Now we know the hip's x axis, and so r: from the ankle to the hip, and hip_x along this axis.
    3. The length of r gives the knee (law of cosines).
    4. In the plane two angles of r are known: seen from the shin (from the triangle), and seen from
       the foot. The ankle's pitch is their difference, and the hip's pitch the rest of the sum."""
    thigh, shin = robot.thigh_length, robot.shin_length
    # R is foot_turn, p is position. The hip from the ankle, in the foot's frame: Rᵀ·(−p); .mT: Rᵀ
    from_ankle = np.matvec(foot_turn.mT, -position)  # [..., 3]
    # Before the ankle rolls, the hip is at (x, 0, h). When the foot turns by +roll, the hip turns
    # by −roll as seen from it: Rx(−roll)·(x, 0, h) = (x, h·sin roll, h·cos roll) with h > 0.
    ankle_roll = np.arctan2(from_ankle[..., 1], from_ankle[..., 2])
    # The foot's rotation without the ankle's roll:
    # M = R·Rx(−ankle roll) = Rz(hip yaw)·Rx(hip roll)·Ry(s),  s = hip pitch + knee + ankle pitch
    #     |       ·          −sin yaw·cos roll         ·       |
    #   = |       ·           cos yaw·cos roll         ·       |
    #     | −cos roll·sin s       sin roll       cos roll·cos s |
    roll_back = rotation(-ankle_roll, 0, 0)
    M = foot_turn @ roll_back
    yaw = np.arctan2(-M[..., 0, 1], M[..., 1, 1])
    roll = np.arcsin(np.clip(M[..., 2, 1], -1, 1))
    pitch_sum = np.arctan2(-M[..., 2, 0], M[..., 2, 2])  # s
    # Seen from the foot the hip's x axis is the first column of Rx(−ankle roll)·Ry(−s).
    ahead = (roll_back @ rotation(0, -pitch_sum, 0))[..., 0]  # [..., 3]
    rx, ry, rz = np.moveaxis(from_ankle + robot.hip_x * ahead, -1, 0)  # r
    # Law of cosines: |r|² = thigh² + shin² + 2·thigh·shin·cos(knee). (Plus, because the triangle's
    # inner angle is π − knee: knee = 0 is a straight leg.) Of ±knee we take the positive. A longer
    # r is cut to a straight leg, a shorter one to the most that the knee bends.
    r_squared = np.minimum(rx**2 + ry**2 + rz**2, (thigh + shin) ** 2)
    cos_knee = (r_squared - thigh**2 - shin**2) / (2 * thigh * shin)
    knee = np.arccos(np.clip(cos_knee, math.cos(robot.joint_max[3]), 1))
    # The pitch of a vector is its angle from z towards x. Seen from the shin,
    # r = (−thigh·sin knee, 0, shin + thigh·cos knee)
    from_shin = np.arctan2(-thigh * np.sin(knee), shin + thigh * np.cos(knee))
    # Seen from the foot, with its roll undone: r = (rx, 0, √(ry² + rz²))
    from_foot = np.arctan2(rx, np.hypot(ry, rz))
    ankle_pitch = from_shin - from_foot
    pitch = pitch_sum - knee - ankle_pitch
    joints = np.stack([yaw, roll, pitch, knee, ankle_pitch, ankle_roll], -1)
    return np.clip(joints, robot.joint_min, robot.joint_max)


def joints_for_feet(robot, trunk, feet, planar=False):
    """Joint angles [..., 12] that put both feet [..., 2, 4] in their places, if the trunk is at
    [..., 6], or at [..., 2, 6] for each leg. planar: legs below the hips, feet along the trunk."""
    if trunk.ndim < feet.ndim:
        trunk = trunk[..., None, :]  # [..., 1, 6] the same for both legs
    roll, pitch, yaw = np.moveaxis(trunk[..., 3:], -1, 0)  # [..., 1 or 2] each
    base = rotation(roll, pitch, yaw)  # R, [..., 1 or 2, 3, 3]
    # Seen from the trunk:  p ← Rᵀ·(p − trunk),  foot's rotation ← Rᵀ·Rz(foot's yaw)
    ankle = feet[..., :3] - trunk[..., :3] + [0, 0, robot.ankle_height]  # [..., 2, 3]
    ankle = np.matvec(base.mT, ankle)
    foot_yaw = feet[..., 3]
    if planar:
        ankle[..., 1] = robot.hips[:, 1]
        foot_yaw = np.broadcast_to(yaw, foot_yaw.shape)
    foot_turn = base.mT @ rotation(0, 0, foot_yaw)
    joints = leg_inverse(robot, ankle - robot.hips, foot_turn)  # [..., 2, 6]
    return joints.reshape(*joints.shape[:-2], 12)


# ------------------------------------------------------------------------ the control loop
@dataclass
class Variation:
    """How n robots differ from the model: at random, see `Spread` of stage 3."""

    friction: np.ndarray  # [n] μ of the floor
    mass: np.ndarray  # [n, 9] factors: torso, left hip, thigh, shin, foot, right ones
    stiffness: np.ndarray  # [n, 12] factors on the position gain of the motors
    stiction: np.ndarray  # [n, 12] factors on the dry friction of the motors
    delay: np.ndarray  # [n] [ticks] from target to motor; from 0 to 1: a mixture of old and new
    zero: np.ndarray  # [n, 12] [rad] where a joint is when its sensor says 0
    com: np.ndarray  # [n, 3] [m] how far the torso's centre of mass is from that of the model
    gyro: np.ndarray  # [n, 2] [rad/s] constant error of the measured rates of roll and pitch

    @classmethod
    def as_model(cls, robot, n):
        """The Variation of n robots that do not differ from the model."""
        return cls(
            np.full(n, robot.friction),
            np.ones((n, 9)),
            np.ones((n, 12)),
            np.ones((n, 12)),
            np.zeros(n),
            np.zeros((n, 12)),
            np.zeros((n, 3)),
            np.zeros((n, 2)),
        )


@dataclass
class Disturbance:
    """Pushes, and errors of the IMU, that n robots meet in T control ticks. No plan knows them."""

    push: np.ndarray  # [n, T, 2] [N] on the torso: x, y of the world; planar: x ahead of the torso
    imu: np.ndarray  # [n, T, 4] added to `Simulator.imu`: roll, pitch [rad], their rates [rad/s]

    @classmethod
    def none(cls, plan):
        """No push and an exact IMU, for all T = most_ticks that this plan may last."""
        shape = len(plan.progress), plan.most_ticks
        return cls(np.zeros((*shape, 2)), np.zeros((*shape, 4)))


# Who calls whom in a double step (a step with each foot)? Stage 2 plans it for n robots (engine,
# plan, capture_step, reflex). `run` below asks the plan in every tick, for the k that are not done:
#
#     engine.plan(footsteps [n, 2, 3])  ──►  plan: trunk [n, T + 1, 6], feet [n, T + 1, 2, 4]
#
#     state [n, 21] ──► imu [k, 4] ──► plan.go_on: lean ──► capture_step ──► joints_for_feet
#         ▲                                                                  + reflex at the ankles
#         │                                                                        │
#     advance: 2 physics steps ◄── targets [k, 2, 12] ◄── delay, zeros ◄── target [k, 12]
class Simulator:
    """N robots, and the computer that every robot carries: it reads the IMU, asks the plan for
    joint targets, and hands them to the motors. Call `reset` first. A kind of physics is a class
    that adds
        place(i)           robot i stands at the origin, with its `variation`
        advance(robots, targets, push, move)
                           simulates a control tick and returns the states after it [n, 21]
    where targets [n, 2, 12] are the joint targets at the beginning and at the end of the tick [rad]
    (MuJoCo takes the latter only), push [n, 2] is the force on the torso [N], and move [n, 3] is
    how the trunk should move, see `Trajectory.go_on`. SIMULATORS names the classes."""

    planar = False  # do the robots live in the sagittal plane?

    def __init__(self, num_robots, standing, robot):
        self.robot = robot
        self.standing = standing  # torso [6], joints [12], see `stance`
        self.variation = Variation.as_model(robot, num_robots)
        self.state = np.zeros((num_robots, 21))
        # [N, 12] [rad] of the last tick: the plan's target; what was sent to the motors
        self.last_target, self.last_sent = np.zeros((2, num_robots, 12))

    def reset(self, robots, variation=None):
        """Robots [n] stand at the origin, with this Variation; None: that of the model."""
        variation = variation or Variation.as_model(self.robot, len(robots))
        for name, values in vars(variation).items():  # field by field
            getattr(self.variation, name)[robots] = values
        torso, joints = self.standing
        self.state[robots] = [*torso, *joints, 0, 0, 0]
        self.last_target[robots] = self.last_sent[robots] = joints
        for i in robots:
            self.place(i)

    def imu(self, robots):
        """The torso's roll and pitch [rad], and their rates with the gyro's constant error [rad/s],
        [n, 4]. (A real gyro measures about the torso's own axes; upright it is nearly the same.)"""
        imu = self.state[robots][:, IMU]
        imu[:, 2:] += self.variation.gyro[robots]
        return imu

    def run(self, robots, plan, disturbance=None):
        """Lets these robots [n] follow their plan, a Trajectory, tick by tick. Returns a Motion. A
        robot whose plan is done keeps its state. One that falls goes on to the end of its plan."""
        robots = np.asarray(robots)
        disturbance = disturbance or Disturbance.none(plan)
        states, ticks, fell = [], np.zeros(len(robots), int), np.zeros(len(robots), bool)
        for tick in range(plan.most_ticks):
            rows = np.flatnonzero(plan.progress < plan.ticks)  # [k] whose plan is not done
            if not len(rows):
                break
            walking = robots[rows]
            imu = self.imu(walking) + disturbance.imu[rows, tick]
            target, move = plan.go_on(rows, tick, imu)  # [k, 12], [k, 3]
            # sent = target + delay·(last target − target)
            delay = self.variation.delay[walking, None]
            sent = target + delay * (self.last_target[walking] - target)
            # At the beginning and at the end of the tick  [k, 2, 12]
            targets = np.stack([self.last_sent[walking], sent], 1)
            targets += self.variation.zero[walking, None]
            self.last_target[walking], self.last_sent[walking] = target, sent
            state = self.advance(walking, targets, disturbance.push[rows, tick], move)
            finite = (np.abs(state) < 1e6).all(1)  # else the physics diverged: a fall, too
            fell[rows] |= ~finite
            self.state[walking[finite]] = state[finite]
            ticks[rows] += 1
            states.append(self.state[robots])
        states = np.stack(states, 1)  # [n, T, 21]
        torso = states[..., TORSO]
        fell |= fallen(torso, self.standing[0][HEIGHT]).any(1)
        return Motion(torso, states[..., ANGLES], fell, ticks)


# ------------------------------------------------------------------------ MuJoCo, 3-D
def inertial(link, side=1):
    """A link's mass in MJCF, MuJoCo's model language; side −1 mirrors its place."""
    x, y, z = link.com
    xx, yy, zz = link.inertia
    return f'<inertial mass="{link.mass}" pos="{x} {side * y} {z}" diaginertia="{xx} {yy} {zz}"/>'


def leg_xml(robot, leg, side):
    """One leg in MJCF, from the hip down: nested bodies, each with its mass and its joints to the
    body around it; side: 1 left, −1 right. The sole is a box: pos is its centre, size half of each
    side [m]."""
    axes = "0 0 1", "1 0 0", "0 1 0", "0 1 0", "0 1 0", "1 0 0"  # of the joints: z, x, y, y, y, x

    def joint(k):
        return (
            f'<joint name="{leg} {JOINTS[k]}" axis="{axes[k]}" damping="{robot.damping[k]}" '
            f'frictionloss="{robot.stiction[k]}" armature="{robot.armature}" '
            f'range="{robot.joint_min[k]} {robot.joint_max[k]}"/>'
        )

    return f"""
      <body name="{leg} hip" pos="0 {side * robot.hip_y} {robot.hip_z}" childclass="{leg}">
        {inertial(robot.hip, side)} {joint(0)} {joint(1)}
        <body name="{leg} thigh" pos="{robot.hip_x} 0 0">
          {inertial(robot.thigh, side)} {joint(2)}
          <geom type="capsule" fromto="0 0 0 0 0 {-robot.thigh_length}" size="0.036" mass="0"/>
          <body name="{leg} shin" pos="0 0 {-robot.thigh_length}">
            {inertial(robot.shin, side)} {joint(3)}
            <geom type="capsule" fromto="0 0 0 0 0 {-robot.shin_length}" size="0.029" mass="0"/>
            <body name="{leg} foot" pos="0 0 {-robot.shin_length}">
              {inertial(robot.foot, side)} {joint(4)} {joint(5)}
              <geom name="{leg} sole" type="box"
                    pos="{(robot.foot_front - robot.foot_back) / 2} {side * robot.foot_outward}
                         {robot.sole_height / 2 - robot.ankle_height}"
                    size="{(robot.foot_front + robot.foot_back) / 2} {robot.foot_width / 2}
                          {robot.sole_height / 2}"/>
            </body> </body> </body> </body>"""


def mujoco_xml(robot, height=0):
    """The robot in MJCF; height [m]: where the torso is while its z is 0, as a viewer begins. Each
    motor is a position servo (it drives its joint to a target angle) with a torque-speed line:
        τ = clip(stiffness·(target − q), ±torque limit) − damping·q̇ − stiction·sign(q̇)
    <position> makes the first term, the joint's damping and frictionloss are the others.

    elliptic: the friction cone is round, so friction is equal in all directions. MuJoCo's own
        choice, a pyramid, is 1.3 times faster and lets feet skate between the axes.
    warmstart: would save a tenth of the time; without it a step depends on its state alone.
    island: a speed-up of the solver that saves nothing here.
    autoreset: would hide from us that a simulation diverged.
    torso: its six joints to the world are its pose in our state: x, y, z, then yaw, pitch, roll.
        (At a pitch of 90°, long after a fall, yaw and roll turn about one axis: it may diverge.)
    contype 0: only the listed pairs of shapes can touch. All others are to be looked at.
    condim 3: a contact has one normal force and two friction forces, each with its μ."""
    motors = ""
    for leg in ("left", "right"):
        for name, limit in zip(JOINTS, robot.torque_limit):
            motors += (
                f'<position name="{leg} {name}" joint="{leg} {name}" '
                f'forcerange="{-limit} {limit}"/>'
            )
    return f"""
    <mujoco>
      <compiler angle="radian"/>
      <option timestep="{robot.control_dt / robot.substeps}" gravity="0 0 {-robot.gravity}"
              cone="elliptic">
        <flag warmstart="disable" island="disable" autoreset="disable"/>
      </option>
      <default>
        <geom contype="0" conaffinity="0" rgba="0.8 0.8 0.8 1"/>
        <default class="left"> <geom rgba="0.12 0.47 0.71 1"/> </default>
        <default class="right"> <geom rgba="1 0.5 0.05 1"/> </default>
        <pair condim="3" friction="{robot.friction} {robot.friction} 0 0 0"/>
        <position kp="{robot.stiffness}"/>
      </default>
      <worldbody>
        <light pos="0 0 3"/> <geom name="ground" type="plane" size="0 0 1"/>
        <body name="torso" pos="0 0 {height}">
          <joint type="slide" axis="1 0 0"/>
          <joint type="slide" axis="0 1 0"/>
          <joint type="slide" axis="0 0 1"/>
          <joint axis="0 0 1"/>
          <joint axis="0 1 0"/>
          <joint axis="1 0 0"/>
          {inertial(robot.torso)}
          <geom type="capsule" fromto="0 0 0.05 0 0 0.24" size="0.085" mass="0"/>
          <geom type="sphere" pos="0 0 0.36" size="0.055" mass="0"/>
          {leg_xml(robot, "left", 1)} {leg_xml(robot, "right", -1)}
        </body>
      </worldbody>
      <actuator> {motors} </actuator>
      <contact>
        <pair geom1="ground" geom2="left sole"/>
        <pair geom1="ground" geom2="right sole"/>
        <pair geom1="left sole" geom2="right sole"/>
      </contact>
    </mujoco>"""


class MujocoSim(Simulator):
    """N robots in 3-D. Every call of `mujoco.rollout` runs all of them on all cores. A motor gets
    the target of the tick's end. A joint that turns at 1 rad/s is about 5 ms behind this target
    (knee 7), because back-EMF and dry friction hold it back."""

    # Our bodies, to which the columns of `Variation.mass` belong, the torso first; 0 is the world.
    PARTS = np.arange(1, 10)
    ORDER = [0, 1, 2, 5, 4, 3, *range(6, 18)]  # MuJoCo's joints, as in our state

    def __init__(self, num_robots, standing, robot):
        mujoco.set_mju_user_warning(lambda text: None)  # else a diverging robot fills a log file
        self.model = self.build(robot)
        self.models = [None] * num_robots  # of each robot
        self.data = [mujoco.MjData(self.model) for _ in range(min(CORES, num_robots))]
        # Of MuJoCo: time; positions of the torso's six joints and of the twelve others; velocities
        self.physics = np.zeros((num_robots, 37))
        super().__init__(num_robots, standing, robot)

    def build(self, robot):
        """The robot as a MuJoCo model."""
        return mujoco.MjModel.from_xml_string(mujoco_xml(robot))

    def place(self, i):
        """See `Simulator`."""
        self.physics[i] = 0
        # (ORDER leads back, too: a swap of two undoes itself.)
        self.physics[i, 1:19] = np.concatenate(self.standing)[self.ORDER]
        variation = self.variation
        self.models[i] = model = copy.copy(self.model)
        model.body_mass[self.PARTS] *= variation.mass[i]
        model.body_inertia[self.PARTS] *= variation.mass[i, :, None]
        model.body_ipos[self.PARTS[0]] += variation.com[i]
        model.pair_friction[:, :2] = variation.friction[i]
        # A servo's force is gainprm[0]·target + biasprm[1]·q, with stiffness and −stiffness.
        model.actuator_gainprm[:, 0] *= variation.stiffness[i]
        model.actuator_biasprm[:, 1] *= variation.stiffness[i]
        model.dof_frictionloss[6:] *= variation.stiction[i]
        mujoco.mj_setConst(model, self.data[0])  # what MuJoCo derives from the masses

    def advance(self, robots, targets, push, move):
        """See `Simulator`."""
        # 12 targets; then force and torque on every body, 6 numbers each: the world's from 12 on
        inputs = np.zeros((len(robots), self.robot.substeps, 12 + 6 * self.model.nbody))
        inputs[..., :12] = targets[:, 1:]
        torso = 12 + 6 * self.PARTS[0]
        inputs[..., torso : torso + 2] = push[:, None]
        states, _ = mujoco.rollout.rollout(
            [self.models[i] for i in robots],
            self.data,
            self.physics[robots],
            inputs,
            control_spec=mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_XFRC_APPLIED,
            # Its threads wait for the next call. A forked process has none of them.
            persistent_pool=os.getpid() == PROCESS,
        )
        self.physics[robots] = states[:, -1]
        _, position, velocity = np.hsplit(states[:, -1], [1, 19])  # [n, 18] each
        return np.hstack([position[:, self.ORDER], velocity[:, [5, 4, 3]]])


# ------------------------------------------------------------------------ pymunk, planar
def planar_links(robot):
    """The seven bodies: torso with both hips' motors; left thigh, shin, foot; the right ones."""
    torso, hip = robot.torso, robot.hip
    mass = torso.mass + 2 * hip.mass
    share = 2 * hip.mass / mass
    # From the torso's centre of mass to the one of both hips  [3] [m]
    away = robot.hips.mean(0) + hip.com - torso.com
    # Parallel axes: I = Σ (Iᵢ + mᵢ·dᵢ²) about the common centre of mass. For two masses at the
    # distance d the second terms are m₁·m₂ / (m₁ + m₂)·d².
    pitch = torso.inertia[1] + 2 * hip.inertia[1] + share * torso.mass * (away[::2] ** 2).sum()
    merged = Link(mass, torso.com + share * away, (0, pitch, 0))  # only the pitch's is used
    return [merged] + 2 * [robot.thigh, robot.shin, robot.foot]


class PymunkSim(Simulator):
    """N planar robots: pymunk simulates the sagittal plane. Its y is our z, and its angles turn x
    towards y, against our pitch:
        pymunk's angle of a body   = −pitch
        joint angle q              = pitch − parent's pitch = parent's angle − angle
        `rate` of pymunk's motors  = turning rate of the parent − that of the link = +q̇
    Simplified: a motor has its full torque, less dry friction, up to its speed limit. (In MuJoCo
    the torque falls linearly, nearly to zero there.) A rotor adds to the inertia of the link below
    its joint, not only to that about the joint. Joints have no limits; only their targets do."""

    planar = True
    PARENT = [0, 1, 2, 0, 4, 5]  # of the bodies 1…6: thigh, shin, foot; 0: torso
    LINKS = [0, 2, 3, 4, 6, 7, 8]  # the bodies among the nine links; the hips go with the torso

    def __init__(self, num_robots, standing, robot):
        self.worlds = [None] * num_robots  # of each robot: its space, seven bodies, six motors
        self.links = planar_links(robot)
        super().__init__(num_robots, standing, robot)

    def place(self, i):
        """See `Simulator`. In a fresh space, as a used one keeps contacts of the last fall."""
        robot, (torso, joints) = self.robot, self.standing
        factors = self.variation.mass[i, self.LINKS]
        masses = factors * [link.mass for link in self.links]
        moments = factors * [link.inertia[1] for link in self.links]
        friction = self.variation.friction[i]
        for number in (*masses, *moments, friction, robot.planar_iterations):
            if not 0 <= number < math.inf:  # an assertion of pymunk would end Python
                raise InputError(f"pymunk can use no mass, inertia, μ or iterations of {number}")
        space = pymunk.Space()
        space.gravity = 0, -robot.gravity
        space.iterations = robot.planar_iterations or 1
        space.collision_slop = 0.0005  # [m] pymunk's own value is meant for pixels
        # The segment lies 1 m below z = 0 and has a radius of 1 m: its upper side is z = 0.
        ground = pymunk.Segment(space.static_body, (-1e4, -1), (1e4, -1), 1)
        ground.friction = friction  # pymunk MULTIPLIES it by the sole's
        space.add(ground)
        origins, _ = link_frames(robot, torso, joints)  # [9, 3]
        points = origins[self.LINKS][:, [0, 2]].tolist()  # [7, 2] x, z
        # Along a leg pitches add up: of thigh, shin, foot  [2, 3]; with the torso [7]
        pitches = torso[4] + np.append(0, joints[SAGITTAL].reshape(2, 3).cumsum(1))
        coms = np.array([link.com for link in self.links])  # [7, 3] seen from the joint above
        # Only the torso's own centre of mass is random, not that of the hips' motors.
        coms[0] += robot.torso.mass / self.links[0].mass * self.variation.com[i]
        bodies, motors = [], []
        for mass, moment, com, point, pitch in zip(masses, moments, coms, points, pitches):
            body = pymunk.Body(mass, moment)
            body.center_of_gravity = com[0], com[2]
            body.angle = -pitch
            body.position = point
            space.add(body)
            bodies.append(body)
        for foot in bodies[3], bodies[6]:
            low = -robot.ankle_height
            heights = low, low + robot.sole_height
            ends = -robot.foot_back, robot.foot_front
            sole = pymunk.Poly(foot, [(x, z) for x in ends for z in heights])
            sole.friction = 1.0
            sole.filter = pymunk.ShapeFilter(group=1)  # the feet do not touch one another
            space.add(sole)
        for joint, parent, body, point in zip(SAGITTAL, self.PARENT, bodies[1:], points[1:]):
            # The rotor turns with the link below it. Its inertia also stabilises the solver:
            # without it the light shin makes a standing robot sway, by 2 cm in a second.
            body.moment += robot.armature
            index = joint % 6  # in its leg
            motor = pymunk.SimpleMotor(bodies[parent], body, 0.0)
            # Dry friction lowers the largest torque.
            stiction = robot.stiction[index] * self.variation.stiction[i, joint]
            motor.max_force = max(0, robot.torque_limit[index] - stiction)
            space.add(motor, pymunk.PivotJoint(bodies[parent], body, point))
            motors.append(motor)
        self.worlds[i] = space, bodies, motors

    def advance(self, robots, targets, push, move):
        """See `Simulator`. A motor that only followed the error would lag behind a moving target.
        So the target's rate is added (feedforward)."""
        robot, state = self.robot, self.state[robots]
        start, end = targets[..., SAGITTAL].swapaxes(0, 1)  # [n, 6] each
        gain = robot.planar_gain * self.variation.stiffness[robots][:, SAGITTAL]  # [n, 6] [1/s]
        limit = np.tile(robot.speed_limit[2:5], 2)  # [6] [rad/s]
        speeds = (end - start) / robot.control_dt + gain * (start - state[:, ANGLES[SAGITTAL]])
        speeds = np.clip(speeds, -limit, limit)
        rows = np.array(list(map(self._tick, robots, speeds, push[:, 0])))  # [n, 10]
        ahead, height, rate = rows[:, :3].T  # [n] each
        pitches = rows[:, 3:]  # [n, 7] the torso's first
        new = np.zeros_like(state)
        # Ahead it moves as simulated, sideways as commanded; it turns as commanded.
        new[:, GROUND] = compose(state[:, GROUND], np.column_stack([ahead, move[:, 1:]]))
        new[:, HEIGHT], new[:, IMU[1]], new[:, IMU[3]] = height, pitches[:, 0], rate
        new[:, ANGLES[SAGITTAL]] = pitches[:, 1:] - pitches[:, self.PARENT]
        new[:, YAW_RATE] = move[:, 2] / robot.control_dt
        return new

    def _tick(self, i, speeds, force):
        """Simulates robot i for a tick: motors with these speeds [6], a force on the torso [N].
        Returns how far the torso moved ahead [m], its height [m], its rate of pitch [rad/s], and
        the pitches of the seven bodies [rad]."""
        space, bodies, motors = self.worlds[i]
        torso, before = bodies[0], bodies[0].position
        for motor, speed in zip(motors, speeds):
            motor.rate = speed
        for _ in range(self.robot.substeps):
            torso.force = force, 0  # at its centre of mass, in this step only
            space.step(self.robot.control_dt / self.robot.substeps)
        x, z = torso.position
        return x - before.x, z, -torso.angular_velocity, *(-body.angle for body in bodies)


SIMULATORS = {"pymunk": PymunkSim, "mujoco": MujocoSim}
PROCESS = os.getpid()  # that has imported this file
CORES = getattr(os, "process_cpu_count", os.cpu_count)()  # from Python 3.13 on: that we may use


# ------------------------------------------------------------------------ drawing
# Only pictures have a head. Both ends in the torso's frame [m]; colour; radius [m].
UPPER_BODY = (
    ([[0, 0, 0.05], [0, 0, 0.24]], "0.8", 0.085),  # trunk
    ([[0, 0, 0.36], [0, 0, 0.36]], "0.88", 0.055),  # head
)


def camera_at(azimuth=-60, elevation=20):
    """A camera's axes as rows [3, 3]: towards the camera, to the right, up in the picture. Angles
    [°]: (-90, 0) looks from the robot's right side, (-90, 90) from above, without perspective."""
    return rotation(0, -np.radians(elevation), np.radians(azimuth)).T


def capsule(start, end, radius):
    """Outline [24, 2] of a thick line from start [2] to end [2], with round ends."""
    x, y = end - start
    across = np.arctan2(y, x) + np.linspace(0.5, 1.5, 12) * np.pi
    half = turned((radius, 0), across)  # of a circle [12, 2]
    return np.concatenate([start + half, end - half])


def draw_robots(axes, robot, torso, joints, camera):
    """Draws one robot at K moments, the last one strongest: torso [K, 6], joints [K, 12]. Limbs are
    thick lines, painted from the farthest to the nearest one."""
    low = -robot.ankle_height
    sole = [[-robot.foot_back, 0, low], [robot.foot_front, 0, low]]  # heel, toe
    for k, (origins, turns) in enumerate(zip(*link_frames(robot, torso, joints)), 1):
        lines = [
            (origins[0] + ends @ turns[0].T, color, radius) for ends, color, radius in UPPER_BODY
        ]
        for hip, color in zip((1, 5), COLORS):
            thigh, knee, ankle = origins[hip + 1 : hip + 4]
            lines += [
                ([thigh, knee], color, 0.036),
                ([knee, ankle], color, 0.029),
                (ankle + sole @ turns[hip + 3].T, color, 0.016),
            ]
        # The farthest line first: it is as near as the nearer of its ends.
        for ends, color, radius in sorted(lines, key=lambda line: (line[0] @ camera[0]).max()):
            color = 1 - (1 - np.array(to_rgb(color))) * k / len(torso)
            outline = capsule(*(ends @ camera[1:].T), radius)  # right, up
            axes.fill(*outline.T, color=color, ec=color / 2)


def draw_ground(axes, camera, size):
    """Draws squares of 0.25 m on the floor, `size` [m] to every side of the origin."""
    side = [-size, size]
    for u in np.arange(-size, size + 0.01, 0.25):
        for line in ([u, u], side), (side, [u, u]):  # x, y of both ends
            axes.plot(*(camera[1:, :2] @ line), color="0.88", zorder=0)
    axes.set_aspect("equal")
    axes.axis("off")


# ------------------------------------------------------------------------ command line and files
class InputError(Exception):
    """Something that was given cannot be used; the message is one line that says what to do."""


def stage_parser(doc):
    """A parser with the flags that every stage has."""
    parser = ArgumentParser(description=doc, formatter_class=RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--mujoco", dest="sim", action="store_const", const="mujoco", default="pymunk")
    add("--seed", type=int, default=0, help="The same seed gives the same numbers (default 0).")
    add("--out", type=Path, help="Write into this folder (default runs/<sim>/).")
    return parser


def output_folder(args, *parts):
    """The folder to write to, --out or runs/<sim>/ and these parts. Makes it if needed. Raises an
    InputError if that fails, or if the seed is negative."""
    if args.seed < 0:
        raise InputError("--seed must be 0 or more")
    out = args.out or Path("runs", args.sim, *parts)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write to {out} ({error.strerror}): choose --out") from error
    return out


def atomic_write(path, write):
    """Calls write(temporary file), then renames it: `path` is never only a part of a file. Raises
    an InputError with the system's words, for example of a full disk."""
    temporary = path.with_name(f"{path.stem}.{os.getpid()}.tmp{path.suffix}")  # two may write it
    try:
        try:
            write(temporary)
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    except (OSError, RuntimeError) as error:  # the latter by PyTorch and matplotlib
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot write {path}: {reason}") from error


def write_text(path, text):
    """Writes UTF-8 with plain line ends on every system."""
    atomic_write(path, lambda file: file.write_text(text, "utf-8", "replace", newline="\n"))


def pixels(figure):
    """What the figure shows, uint8 [height, width, 3]."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.array(canvas.buffer_rgba())[..., :3]


def save_figure(figure, path):
    """Writes the figure."""
    atomic_write(path, lambda file: figure.savefig(file, dpi=110))


STYLE = {
    # No blue and no orange: these are the left and the right foot.
    "axes.prop_cycle": "cycler(color=['k', 'purple', 'g', 'r', 'brown', 'gray', 'olive', 'hotpink'])",
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "figure.constrained_layout.use": True,
    "axes.formatter.min_exponent": 3,  # 40, not 4 × 10¹, on a logarithmic axis
}


def run_script(main):
    """Calls a script's main(). Prints one line without a traceback for what is no bug: Ctrl-C, and
    input that cannot be used. A reader like `head` may stop reading."""
    if hasattr(sys.stdout, "reconfigure"):  # that of a notebook cannot do this
        sys.stdout.reconfigure(errors="replace")  # a Windows pipe may be unable to encode α
    try:
        with matplotlib.rc_context(STYLE):
            main()
    except BrokenPipeError:
        os._exit(1)  # nobody reads what is still to be printed
    except (InputError, KeyboardInterrupt) as error:
        print(f"\n{Path(sys.argv[0]).name}: {str(error) or 'interrupted'}", file=sys.stderr)
        sys.exit(2)


# ------------------------------------------------------------------------ demonstration
def main():
    args = stage_parser(__doc__).parse_args()
    out = output_folder(args)
    if args.sim == "mujoco":
        # In the viewer the robot begins with straight legs, and drops by 2 cm
        write_text(out / "robot.xml", mujoco_xml(ROBOT, 0.45))
        print(f"python -m mujoco.viewer --mjcf={out / 'robot.xml'}   shows the robot")
    simulator = SIMULATORS[args.sim]
    torso, joints = standing = stance(ROBOT, simulator.planar)
    leans = np.linspace(0.25, 0.35, 101)  # [rad]
    targets = np.tile(joints, (len(leans), 1201, 1))  # [N, T + 1, 12] for 12 s
    # Stand for a second, lean within eight, then wait: at the smallest lean a fall takes seconds.
    # The feet stay flat, so a negative pitch of both ankles tilts all the rest forward.
    time = np.clip(np.linspace(-1, 11, 1201) / 8, 0, 1)  # [T + 1] 0: before the lean, 1: after it
    share = (1 - np.cos(np.pi * time)) / 2  # [T + 1] of the lean
    targets[..., [4, 10]] -= leans[:, None, None] * share[:, None]
    sim = simulator(len(leans), standing, ROBOT)
    robots = np.arange(len(leans))
    sim.reset(robots)
    motion = sim.run(robots, Trajectory(targets))
    i = motion.fell.argmax()  # the first one that fell
    print(f"the smallest lean of a fall: {leans[i]:.3f} rad")
    down = fallen(motion.torso[i], torso[HEIGHT]).argmax()  # [ticks] when the fall counts
    moments = [0, *range(down - 50, down + 1, 10)]  # seven, at first it stands
    torso, joints = motion.torso[i, moments], motion.joints[i, moments]

    axes = Figure().subplots()
    camera = camera_at(-90, 10)  # [3, 3] its rows: towards the camera, right, up
    draw_ground(axes, camera, 0.5)
    draw_robots(axes, ROBOT, torso, joints, camera)
    _, right, up = camera @ centre_of_mass(ROBOT, torso, joints).T
    axes.plot(right, up, "k.-", label="centre of mass")
    axes.axvline(ROBOT.foot_front, ls=":", label="above the toes")
    axes.legend(loc="upper left")
    axes.set_title(f"A fall: lean {leans[i]:.3f} rad (left leg blue, right leg orange)")
    save_figure(axes.figure, out / "01_robot.png")
    print("Look at", out / "01_robot.png")


if __name__ == "__main__":
    run_script(main)
