"""Stage 1: what is the robot, and what does physics do with it?

Paper: section II-a, a simulated biped with position-controlled joints. The robot is [6]. (Numbers
of sections and references are the paper's. `tests/exercises/ledger.md` lists what it says.)

    python 01_robot_model.py             pymunk: sagittal plane + yaw
    python 01_robot_model.py --mujoco    MuJoCo: full 3-D

201 robots stand for a second. Then each one leans forward slowly, to an angle of its own. The robot
that fell at the smallest lean is drawn in `runs/<sim>/01_robot.png`. This takes 4 seconds; nothing
is drawn at random, so `--seed` changes nothing here. Predict that lean, to three digits: the feet
(1.19 kg, centre of mass 0.006 m ahead of the ankle axes) stand still, and all the rest (4.93 kg,
0.0127 m ahead of these axes and 0.3993 m above them) turns about the ankles. At which angle is the
centre of mass of the whole robot above the toes? The plane should agree with your pencil. In 3-D
a servo is a spring, see `stiffness`: by how much does it give way, and does that help or hurt?

How to read this file: first the settings, the kinematics and `fallen`, then `main`. Of the two
simulators MujocoSim is the shorter one; PymunkSim is the one that runs without a flag. Skip the
drawing, and all that stands behind "several processes": no later stage asks for it.

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
along the axis); a positive pitch turns z towards x, so the torso leans forward. All twelve joints:
left leg, then right leg, each in the order of the table. The sagittal plane is the plane of x and
z. Trunk and torso are the same part: "trunk" is its commanded pose, "torso" its simulated pose. The
support foot stands while the swing foot moves; the sole is the rectangle under a foot. Shapes: N
robots, n some of them (given by their indices), T control ticks.

Left out: arms and head (their mass is in the torso), gear play, all sensors but the gyro. Only
soles touch anything.

[5] Bestmann, Zhang, 2022: Bipedal Walking on Humanoid Robots through Parameter Optimization.
[6] Bestmann et al., 2021: Wolfgang-OP: A Robust Humanoid Robot Platform for Research and
    Competitions.
"""

import copy
import importlib.util
import itertools
import math
import multiprocessing
import os
import signal
import sys
import tempfile
import threading
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pymunk.batch
from matplotlib.colors import to_rgb

STYLE = {"axes.grid": True, "grid.alpha": 0.3, "figure.constrained_layout.use": True}
plt.rcParams.update(STYLE)

LEFT, RIGHT = 0, 1
COLORS = ("tab:blue", "tab:orange")  # of the left and of the right foot in every figure
JOINTS = ("hip yaw", "hip roll", "hip pitch", "knee", "ankle pitch", "ankle roll")
SAGITTAL = np.array([2, 3, 4, 8, 9, 10])  # the six of twelve joints that the planar robot has
READ_EVERY = 2  # [ticks] how often the gyro is read, see `Trajectory.feedback`; our choice
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Checked:
    """Settings that are finite, and 0 or more but for those that are named; else a ValueError."""

    above_zero = ()
    may_be_negative = ()

    def __post_init__(self):
        for name, value in vars(self).items():
            if isinstance(value, Checked):
                continue
            numbers = np.array(value, float)
            right = np.isfinite(numbers)
            if name not in self.may_be_negative:
                right &= (numbers > 0) | (numbers == 0) & (name not in self.above_zero)
            if not right.all():
                raise ValueError(f"{type(self).__name__}: {name} cannot be {value!r:.80}")


@dataclass(frozen=True)
class Link(Checked):
    """A rigid body. `com` is seen from the joint above (torso: its frame); y outward for a leg."""

    mass: float  # [kg]
    com: tuple  # [m] centre of mass (x, y, z)
    inertia: tuple  # [kg m²] about the centre of mass (x, y, z)

    above_zero = ("mass", "inertia")
    may_be_negative = ("com",)


@dataclass(frozen=True)
class RobotModel(Checked):
    """Wolfgang-OP, simplified; as in its public model of 2024-10 unless a line says otherwise."""

    # Masses: public model. Centres of mass and inertias: our estimates for the merged parts.
    torso: Link = Link(3.490, (0.0, 0.0, 0.120), (0.045, 0.035, 0.025))  # with arms and head
    hip: Link = Link(0.389, (0.0, 0.0, 0.0), (0.0004, 0.0004, 0.0004))  # yaw and roll motors
    thigh: Link = Link(0.242, (0.0, 0.0, -0.085), (0.0008, 0.0008, 0.0003))
    shin: Link = Link(0.088, (0.0, 0.0, -0.085), (0.0003, 0.0003, 0.0001))
    foot: Link = Link(0.595, (0.006, 0.004, -0.019), (0.0012, 0.0016, 0.0016))  # and ankle motors
    hip_y: float = 0.055  # [m] hip beside the torso frame
    hip_z: float = -0.041  # [m] height of the hips in the torso frame
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
    speed_limit: tuple = (5.76, 5.76, 5.76, 3.87, 5.76, 5.76)  # [rad/s] there no torque is left
    joint_min: tuple = (-1.57, -1.6, -2.77, -0.2, -1.42, -1.4)  # [rad]
    joint_max: tuple = (1.57, 1.6, 0.79, 2.8, 0.37, 1.4)  # [rad]
    armature: float = 0.01  # [kg m²] inertia of a motor's rotor, seen through the gears; our choice
    # The world.
    friction: float = 0.7  # [-] foot on ground, μ; the robot's own simulator: 0.5
    gravity: float = 9.81  # [m/s²]
    control_dt: float = 0.010  # [s] a control tick: a new joint target; our choice
    substeps: int = 2  # [-] physics steps in a control tick, in both simulators; our choice
    stiffness: float = 300.0  # [N m/rad] position gain of a motor: torque per error; only in MuJoCo
    # pymunk only.
    planar_gain: float = 40.0  # [1/s] speed of a motor per position error; our choice
    planar_iterations: int = 20  # [-] of its solver of forces; our choice, keeps joints together
    yaw_inertia: float = 0.05  # [kg m²] whole robot about the vertical; our estimate

    above_zero = (
        "thigh_length",
        "shin_length",
        "speed_limit",
        "control_dt",
        "substeps",
        "stiffness",
        "planar_iterations",
        "yaw_inertia",
    )
    may_be_negative = ("hip_z", "joint_min", "joint_max")

    @property
    def hips(self):
        """Both hips in the trunk's frame, [2, 3] [m]."""
        return np.array([[0, self.hip_y, self.hip_z], [0, -self.hip_y, self.hip_z]])

    @property
    def damping(self):
        """Back-EMF of the motors of a leg [6] [N m s/rad]: torque limit / speed limit. (A turning
        motor is a generator, too, and brakes itself.)
        """
        return np.divide(self.torque_limit, self.speed_limit)


@dataclass
class Body(Checked):
    """How n robots differ from the model; hidden from every planner. Stage 3 draws it (domain
    randomization)."""

    friction: np.ndarray  # [n] μ of the ground
    mass: np.ndarray  # [n, 9] factors: torso, left hip, thigh, shin, foot, right ones
    stiffness: np.ndarray  # [n, 12] factors on the position gain of the motors
    stiction: np.ndarray  # [n, 12] [N m] dry friction
    delay: np.ndarray  # [n] [ticks] 0 or 1, from target to motor

    above_zero = ("mass",)


@dataclass
class Trajectory:
    """The commands for N robots in T control ticks, and what pushes them meanwhile. Sample k is the
    target at the end of tick k; sample 0 repeats the last sample of the double step before."""

    joints: np.ndarray  # [N, T + 1, 12] joint targets [rad]
    trunk: np.ndarray  # [N, T + 1, 6] x, y, z [m], roll, pitch, yaw [rad]
    push: np.ndarray  # [N, T, 2] [N] force on the torso: x, y; on the plane only ahead

    def feedback(self, robot, tick, end, angular_velocity):
        """What is added to the joint targets of the ticks from `tick` to `end`, [N, ticks, 12].

        angular_velocity [N, 2]: of the torso about its x and y axes at the first of these ticks
        [rad/s], which a gyro would measure. Here nothing is added (open loop); the plans of stage 2
        have a reflex (closed loop).
        """
        return np.zeros((len(angular_velocity), end - tick, 12))


@dataclass
class Motion:
    """What physics did with N robots: at the end of each of T control ticks, or at the very end."""

    torso: np.ndarray  # [N, T, 6] x, y, z [m], roll, pitch, yaw [rad] in the world
    joints: np.ndarray  # [N, T, 12] measured [rad]; joints that the plane lacks: as commanded
    angular_velocity: np.ndarray  # [N, 3] of the torso about its own axes [rad/s], at the very end
    fell: np.ndarray  # [N] bool: fell at any control tick


# ------------------------------------------------------------------------ poses on the ground
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
    """Rz(yaw)·Ry(pitch)·Rx(roll): arrays of one shape [...] in, matrices [..., 3, 3] out."""
    cr, cp, cy = np.cos([roll, pitch, yaw])
    sr, sp, sy = np.sin([roll, pitch, yaw])
    rows = [
        cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,
        sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,
        -sp, cp * sr, cp * cr,
    ]  # fmt: skip
    return np.stack(rows, -1).reshape(*cr.shape, 3, 3)


def leg_points(robot, joints):
    """Where the parts of a leg are, in the hip's frame, for angles [..., 6].

    Returns points [..., 5, 3]: hip, knee, ankle, heel, toe [m], the last two straight behind and
    ahead of the ankle at the height of the sole; and the foot's rotation [..., 3, 3]
    = Rz(hip yaw)·Rx(hip roll)·Ry(hip pitch + knee + ankle pitch)·Rx(ankle roll).
    """
    yaw, roll, pitch, knee, ankle_pitch, ankle_roll = np.moveaxis(joints, -1, 0)
    zero = np.zeros_like(yaw)
    hip_turn = rotation(roll, zero, yaw)  # [..., 3, 3]
    thigh_turn = hip_turn @ rotation(zero, pitch, zero)
    shin_turn = hip_turn @ rotation(zero, pitch + knee, zero)
    foot_turn = hip_turn @ rotation(ankle_roll, pitch + knee + ankle_pitch, zero)
    knee_point = -robot.thigh_length * thigh_turn[..., 2]  # a leg hangs along −z
    ankle = knee_point - robot.shin_length * shin_turn[..., 2]
    heel = ankle + foot_turn @ np.array([-robot.foot_back, 0, -robot.ankle_height])
    toe = ankle + foot_turn @ np.array([robot.foot_front, 0, -robot.ankle_height])
    return np.stack([0 * ankle, knee_point, ankle, heel, toe], -2), foot_turn


def leg_inverse(robot, position, foot_turn):
    r"""Joint angles [..., 6] [rad] of one leg, analytically.

    position [..., 3]: ankle in the hip's frame [m]; foot_turn [..., 3, 3]: rotation of the foot. An
    ankle out of reach is moved along its line to the hip, no farther than it must; at last the
    angles are clipped to the joint limits. It is meant for feet below their hips that tilt by less
    than half a turn: other angles may come back as other ones.

         o hip      Thigh, shin and the vector r from the ankle to the hip form a triangle. It lies
          \          in the plane in which the leg bends; hip pitch, knee and ankle pitch turn about
           o knee   the normal of this plane, so they cannot move r out of it.
          /
         o__ ankle

    1. The length of r gives the knee (law of cosines).
    2. The ankle's roll is the only joint between foot and shin that turns about another axis. So it
       is the angle that brings r, given in the foot's frame, into the plane of x and z.
    3. In that plane two angles of r are known: seen from the shin (from the triangle), and seen
       from the foot. The ankle's pitch is their difference.
    4. What is left of the foot's rotation is that of the hip.
    """
    thigh, shin = robot.thigh_length, robot.shin_length
    # R is foot_turn, p is position. The hip seen from the ankle, in the foot's frame: r = Rᵀ·(−p)
    rx, ry, rz = np.moveaxis((-position[..., None, :] @ foot_turn)[..., 0, :], -1, 0)
    length = np.sqrt(rx**2 + ry**2 + rz**2)  # [...]
    # Law of cosines: |r|² = thigh² + shin² + 2·thigh·shin·cos(knee). (Plus, because the triangle's
    # inner angle is π − knee: knee = 0 is a straight leg.) Of ±knee we take the positive.
    shortest = math.sqrt(thigh**2 + shin**2 + 2 * thigh * shin * math.cos(robot.joint_max[3]))
    reach = np.clip(length, shortest, thigh + shin)
    knee = np.arccos(np.clip((reach**2 - thigh**2 - shin**2) / (2 * thigh * shin), -1, 1))
    # Before the ankle rolls, r = (rx, 0, h). It turns by +roll as seen from the foot, so there it
    # is r = (rx, h·sin roll, h·cos roll) with h > 0.
    ankle_roll = np.arctan2(ry, rz)
    # The pitch of a vector is its angle from z towards x. Seen from the shin,
    # r = (−thigh·sin knee, 0, shin + thigh·cos knee)
    from_shin = np.arctan2(-thigh * np.sin(knee), shin + thigh * np.cos(knee))
    # Seen from the foot, after the roll: r = (rx, 0, √(ry² + rz²))
    from_foot = np.arctan2(rx, np.hypot(ry, rz))
    ankle_pitch = from_shin - from_foot
    # M = R·Rx(−ankle roll) = Rz(hip yaw)·Rx(hip roll)·Ry(s),  s = hip pitch + knee + ankle pitch
    #     |       ·          −sin yaw·cos roll         ·       |
    #   = |       ·           cos yaw·cos roll         ·       |
    #     | −cos roll·sin s       sin roll       cos roll·cos s |
    zero = np.zeros_like(ankle_roll)
    M = foot_turn @ rotation(-ankle_roll, zero, zero)
    yaw = np.arctan2(-M[..., 0, 1], M[..., 1, 1])
    roll = np.arcsin(np.clip(M[..., 2, 1], -1, 1))
    pitch = np.arctan2(-M[..., 2, 0], M[..., 2, 2]) - knee - ankle_pitch
    joints = np.stack([yaw, roll, pitch, knee, ankle_pitch, ankle_roll], -1)
    return np.clip(joints, robot.joint_min, robot.joint_max)


def body_inverse(robot, trunk, feet, planar=False):
    """Joint angles [..., 12] that put both feet in their places; planar: legs below their hips.

    trunk [..., 6]: x, y, z, roll, pitch, yaw; feet [..., 2, 4]: x, y, z of the point of the sole
    below the ankle, yaw.
    """
    # Feet seen from a level frame at the trunk that turns with it  [..., 2] each
    seen = relative(trunk[..., None, [0, 1, 5]], feet[..., [0, 1, 3]])
    x, y, yaw = np.moveaxis(seen, -1, 0)
    if planar:
        y[:] = robot.hips[:, 1]
        yaw[:] = 0.0
    height = feet[..., 2] + robot.ankle_height - trunk[..., None, 2]  # ankle above trunk
    ankle = np.stack([x, y, height], -1)  # [..., 2, 3]
    # From the level frame into the leaning one: p ← Rᵀ·p, foot's rotation ← Rᵀ·Rz(yaw)
    roll, pitch = trunk[..., None, 3], trunk[..., None, 4]  # [..., 1], the same for both feet
    lean = rotation(roll, pitch, 0 * roll)  # [..., 1, 3, 3]
    zero = np.zeros_like(height)
    ankle = (ankle[..., None, :] @ lean)[..., 0, :]
    foot_turn = lean.swapaxes(-1, -2) @ rotation(zero, zero, yaw)
    joints = leg_inverse(robot, ankle - robot.hips, foot_turn)  # [..., 2, 6]
    return joints.reshape(*joints.shape[:-2], 12)


def body_points(robot, torso, joints):
    """Legs in the world, [..., 2, 5, 3] (hip … toe), and the feet's rotations [..., 2, 3, 3].

    torso [..., 6]: x, y, z, roll, pitch, yaw; joints [..., 12].
    """
    base = rotation(*np.moveaxis(torso[..., None, 3:], -1, 0))  # [..., 1, 3, 3]
    points, foot_turn = leg_points(robot, joints.reshape(*joints.shape[:-1], 2, 6))
    points = points + robot.hips[:, None]
    # A row of points p is turned by p·Rᵀ, which is the row of all R·p.
    world = points @ base.swapaxes(-1, -2) + torso[..., None, None, :3]
    return world, base @ foot_turn


def stance(robot, planar=False, height=0.395, foot_distance=0.18, pitch=0.1, x_offset=0.0):
    """Standing at the origin, trunk `x_offset` ahead of the feet: torso's pose [6], joints [12].
    (Its numbers in [m] and [rad] are a first guess for this stage; stage 2 gives its own.)
    """
    trunk = np.array([0, 0, height, 0, pitch, 0])
    feet = np.array([[-x_offset, y, 0, 0] for y in (foot_distance / 2, -foot_distance / 2)])
    return trunk, body_inverse(robot, trunk, feet, planar)


def fallen(torso, standing_height):
    """Fall [5]: the torso [..., 6] is below half its standing height or tilted beyond 45°."""
    cos_tilt = np.cos(torso[..., 3]) * np.cos(torso[..., 4])
    return (torso[..., 2] < 0.5 * standing_height) | (cos_tilt < math.cos(math.pi / 4))


# ------------------------------------------------------------------------ demonstration
def centre_of_mass(robot, torso, joints):
    """Σ mᵢ·pᵢ / Σ mᵢ over all links, [K, 3] in the world; torso [K, 6], joints [K, 12]."""
    points, foot_turn = body_points(robot, torso, joints)  # hip, knee, ankle, …: [K, 2, 5, 3]
    trunk = torso[:, :3] + rotation(*torso[:, 3:].T) @ robot.torso.com  # [K, 3]
    # We take the centres of thigh and shin to be in their middle, so each end gets half of the
    # mass. That of a foot is seen from the ankle. (The parts of parallel feet outward cancel.)
    thigh, shin, foot = robot.thigh.mass, robot.shin.mass, robot.foot.mass
    parts = [robot.hip.mass + thigh / 2, (thigh + shin) / 2, shin / 2 + foot]  # [3] [kg]
    x, _, z = robot.foot.com
    legs = parts @ points[:, :, :3] + foot * foot_turn @ [x, 0, z]  # [K, 2, 3]
    return (robot.torso.mass * trunk + legs.sum(1)) / (robot.torso.mass + 2 * sum(parts))


def main():
    args = stage_parser(__doc__).parse_args()
    out = output_folder(args)
    robot = RobotModel()
    leans = np.linspace(0.2, 0.4, 201)  # [rad]
    standing = stance(robot, planar=args.sim == "pymunk")
    joints = np.tile(standing[1], (len(leans), 1001, 1))  # [N, T + 1, 12] for 10 s
    # Stand for a second, then lean for eight. The feet stand, so a negative ankle pitch, left and
    # right, tilts all the rest forward.
    share = np.clip(np.linspace(-1, 9, 1001) / 8, 0, 1)  # [T + 1] of the lean
    joints[..., [4, 10]] -= leans[:, None, None] * share[:, None]
    trunk = np.zeros_like(joints[..., :6])
    nobody_pushes = np.zeros_like(joints[:, 1:, :2])
    sim = make_sim(args.sim, len(leans), standing)
    motion = sim.run(np.arange(len(leans)), Trajectory(joints, trunk, nobody_pushes))
    sim.close()
    if not motion.fell.any():
        raise InputError(f"no lean from {leans[0]} to {leans[-1]} rad was enough to fall")
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
    print("Look at", out / "01_robot.png")


# ------------------------------------------------------------------------ MuJoCo, 3-D
def inertial(link, side=1):
    """A link's mass in MuJoCo's model language; side −1 mirrors its place."""
    x, y, z = link.com
    xx, yy, zz = link.inertia
    return f'<inertial mass="{link.mass}" pos="{x} {side * y} {z}" diaginertia="{xx} {yy} {zz}"/>'


def leg_xml(robot, leg, side):
    """One leg in MuJoCo's model language, from the hip down: nested bodies; side: 1 left, −1 right.

    Every body has its mass, its joints (to the body around it) and, the foot, its sole: a box with
    pos, its centre seen from the ankle, and size, half of each side [m].
    """
    axes = "0 0 1", "1 0 0", "0 1 0", "0 1 0", "0 1 0", "1 0 0"  # of the joints: z, x, y, y, y, x

    def joint(k):
        return (
            f'<joint name="{leg} {JOINTS[k]}" axis="{axes[k]}" damping="{robot.damping[k]}" '
            f'range="{robot.joint_min[k]} {robot.joint_max[k]}"/>'
        )

    return f"""
      <body name="{leg} hip" pos="0 {side * robot.hip_y} {robot.hip_z}">
        {inertial(robot.hip, side)} {joint(0)} {joint(1)}
        <body name="{leg} thigh">
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

    τ = clip(stiffness·(target − q), ±torque limit) − damping·q̇, zero at the speed limit.
    (<position> makes the first term, the joint's damping is the second one.) A joint that the
    ground drives backward is braked harder than the limit, as by a real motor.

    implicitfast: the damping is computed from the velocity at the END of a step, so it cannot push
        a joint back and forth. (MuJoCo's own choice, Euler, does so for joints, too.)
    elliptic: the friction cone is round, so friction is equal in all directions. MuJoCo's own
        choice, a pyramid, is 1.3 times faster and lets feet skate between the axes.
    warmstart, island: aids of the solver. It is faster here without them.
    contype 0: only the listed pairs of shapes can touch.
    hfield: a map of heights for uneven ground, far below until `lay_blocks` raises it.
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
              integrator="implicitfast" cone="elliptic">
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


class MujocoSim:
    """N robots in 3-D. Every call of `mujoco.rollout` runs all of them on all cores."""

    # Columns of MuJoCo's state [38]; from 20 on velocities: of the position, angular velocity about
    # the torso's own axes, of the joints.
    TIME = 0
    POSITION = slice(1, 4)
    TURN = slice(4, 8)  # a quaternion
    ANGLES = slice(8, 20)
    OMEGA = slice(23, 26)

    def __init__(self, num_robots, standing, robot, cores):
        import mujoco.rollout  # only here: everything else works without MuJoCo

        # A diverging robot would fill the terminal and a log file; we report it as a fall.
        mujoco.set_mju_user_warning(lambda text: None)
        torso, joints = standing
        self.robot = robot
        self.model = mujoco_model(robot)
        self.models = [self.model] * num_robots  # of each robot; its own after a reset with a Body
        self.data = [mujoco.MjData(self.model) for _ in range(cores)]
        self.pool = mujoco.rollout.Rollout(nthread=cores)
        self.standing_height = torso[2]
        # Standing at the origin [38]: turned by the pitch about y, see `euler`; at rest.
        turn = [math.cos(torso[4] / 2), 0, math.sin(torso[4] / 2), 0]
        self.start = np.concatenate([[0], torso[:3], turn, joints, np.zeros(self.model.nv)])
        self.state = np.tile(self.start, (num_robots, 1))  # [N, 38]
        self.control = np.tile(joints, (num_robots, 1))  # [N, 12] of the last tick
        self.delay = np.zeros(num_robots, int)  # [ticks] 0 or 1
        self.inputs = mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_XFRC_APPLIED

    def reset(self, robots, body=None):
        """Robots [n] stand at the origin again; body: their Body, None: as before."""
        import mujoco

        self.state[robots] = self.start
        self.control[robots] = self.start[self.ANGLES]
        if body is None:
            return
        self.delay[robots] = body.delay
        for row, i in enumerate(robots):
            self.models[i] = model = copy.copy(self.model)
            model.body_mass[1:] *= body.mass[row]  # MuJoCo's body 0 is the world
            model.body_inertia[1:] *= body.mass[row, :, None]
            model.pair_friction[:, :2] = body.friction[row]
            # A servo's force is gainprm[0]·target + biasprm[1]·q, with stiffness and −stiffness.
            model.actuator_gainprm[:, 0] *= body.stiffness[row]
            model.actuator_biasprm[:, 1] *= body.stiffness[row]
            model.dof_frictionloss[6:] = body.stiction[row]
            mujoco.mj_setConst(model, self.data[0])  # what MuJoCo derives from the masses

    def lay_blocks(self, robots, heights):
        """Uneven ground until their next reset: heights [n, 40, 40] [m] of blocks 0.2 m wide, up to
        4 m from the origin; where the robots stand it stays flat.
        """
        heights = np.array(heights)
        heights[:, 19:21, 19:21] = 0
        for i, height in zip(robots, heights):
            self.models[i].hfield_data = np.kron(height, np.ones((4, 4))).ravel()  # 4 samples each
            self.models[i].geom("blocks").pos = 0

    def run(self, robots, trajectory):
        """Let these robots [n] follow their trajectory; returns their Motion."""
        robot = self.robot
        # A tick's target is where the joint should be at its end. The servo gets it at the tick's
        # beginning, on average 5 ms early. Back-EMF lets a moving joint lag behind by as much
        # (damping / stiffness = 5.8 ms), so it is neither early nor late.
        targets = trajectory.joints[:, 1:]  # [n, T, 12]
        start = state = self.state[robots]
        models = [self.models[i] for i in robots]
        ticks = targets.shape[1]
        parts = []
        for t in range(0, ticks, READ_EVERY):  # a rollout for every reading of the gyro
            end = min(t + READ_EVERY, ticks)
            omega = state[:, self.OMEGA][:, :2]  # about x and y
            now = targets[:, t:end] + trajectory.feedback(robot, t, end, omega)
            late = np.concatenate([self.control[robots][:, None], now[:, :-1]], 1)  # by a tick
            self.control[robots] = now[:, -1]
            now = np.where(self.delay[robots, None, None], late, now)
            # 12 targets; then force and torque on every body, 6 numbers each: the world's from 12
            # on, the torso's from 18 on.
            inputs = np.zeros((*now.shape[:2], 12 + 6 * self.model.nbody))
            inputs[..., :12] = now
            inputs[..., 18:20] = trajectory.push[:, t:end]
            inputs = np.repeat(inputs, robot.substeps, axis=1)
            states, _ = self.pool.rollout(
                models, self.data, state, inputs, control_spec=self.inputs
            )
            parts.append(states)
            state = states[:, -1]
        states = np.concatenate(parts, 1)  # [n, T·substeps, 38]
        # MuJoCo checks every step: a state that is not finite, or huge, goes back to the start, at
        # time 0, so that it ends too early. We count this as a fall.
        lost = states[:, -1, self.TIME] < start[:, self.TIME] + ticks * robot.control_dt - 1e-6
        states[lost] = start[lost, None]
        self.state[robots] = states[:, -1]
        seen = states[:, robot.substeps - 1 :: robot.substeps]  # [n, T, 38] at the ends of ticks
        torso = np.concatenate([seen[..., self.POSITION], euler(seen[..., self.TURN])], -1)
        fell = fallen(torso, self.standing_height).any(1) | lost
        return Motion(torso, seen[..., self.ANGLES], seen[:, -1, self.OMEGA], fell)

    def close(self):
        """Ends its threads."""
        self.pool.close()


# ------------------------------------------------------------------------ pymunk, planar
def planar_links(robot):
    """The seven bodies: torso with both hips' motors; left thigh, shin, foot; the right ones."""
    parts = [(robot.torso, 0.0), (robot.hip, robot.hip_z), (robot.hip, robot.hip_z)]
    mass = sum(link.mass for link, _ in parts)
    centre = sum(link.mass * (link.com[2] + z) for link, z in parts) / mass
    # Parallel axes: I = Σ (Iᵢ + mᵢ·zᵢ²)
    pitch = sum(link.inertia[1] + link.mass * (link.com[2] + z - centre) ** 2 for link, z in parts)
    torso = Link(mass, (0, 0, centre), (pitch, pitch, pitch))  # only the one about y is used
    return torso, *(robot.thigh, robot.shin, robot.foot) * 2


class PymunkSim:
    """N planar robots: pymunk in the sagittal plane, yaw and sideways beside it.

    pymunk's y is our z, and its angles turn x towards y, against our pitch:

        pymunk's angle of a body   = −pitch
        joint angle q              = pitch − parent's pitch = parent's angle − angle
        pymunk's angle of a joint  = angle − parent's angle = −q   (for its limits)
        `rate` of pymunk's motors  = turning rate of the parent − that of the link = +q̇

    Yaw ψ is a degree of freedom of its own: its rate follows the commanded one, as fast as the
    torque that the hip's motor has and the sole's friction bears can change it (`run_yaw`).
    Sideways follows the command and cannot fall.

    Two simplifications: a motor has its full torque up to its speed limit (in MuJoCo the torque
    falls linearly to zero there), and a rotor adds to the inertia of the link below its joint as
    if it turned with that link (in MuJoCo only to the inertia about the joint).
    """

    PARENT = (0, 1, 2, 0, 4, 5)  # of the bodies 1…6: left and right thigh, shin, foot; 0: torso
    ANGLE, OMEGA = 2, 5  # columns of a body's state x, z, angle and their rates [m, rad, s]
    MASS = [0, 2, 3, 4, 6, 7, 8]  # of the bodies in Body.mass; the hips go with the torso

    def __init__(self, num_robots, standing, robot):
        self.robot = robot
        self.links = planar_links(robot)
        self.standing = standing
        # r, the mean distance of the sole's points from its centre: a force F, spread evenly, can
        # bear the torque r·μ·F.
        middles = np.linspace(-0.49, 0.49, 50)  # of strips, as a share of the length or width
        length = robot.foot_front + robot.foot_back
        # all pairs of x and y  [50, 50] -> r [m]
        self.sole_radius = np.hypot.outer(length * middles, robot.foot_width * middles).mean()
        self.spaces = [None] * num_robots
        self.motors = [None] * num_robots
        self.buffer = pymunk.batch.Buffer()
        self.bodies = np.zeros((num_robots, 7, 6))
        self.pose = np.zeros((num_robots, 3))  # x, y [m], yaw ψ [rad] of the torso in the world
        self.yaw_rate = np.zeros(num_robots)  # ψ̇ [rad/s]
        self.lost = np.zeros(num_robots, bool)  # diverged
        self.last = np.zeros((num_robots, 2, 6))  # joint targets of the last tick and their rates
        self.body = Body(  # of all N robots: as the model
            np.full(num_robots, robot.friction),
            np.ones((num_robots, 9)),  # mass
            np.ones((num_robots, 12)),  # stiffness
            np.zeros((num_robots, 12)),  # stiction
            np.zeros(num_robots, int),  # delay
        )
        self.reset(np.arange(num_robots))

    def reset(self, robots, body=None):
        """Robots [n] stand at the origin again; body: their Body, None: as before."""
        if body is not None:
            for name, values in vars(body).items():
                getattr(self.body, name)[robots] = values
        for i in robots:  # in a fresh space: a used one keeps contacts of the last fall
            self.spaces[i], self.motors[i] = self._build(i)
        self.last[robots] = self.standing[1][SAGITTAL], np.zeros(6)
        self.pose[robots] = 0
        self.yaw_rate[robots] = 0
        self.lost[robots] = False
        self.bodies[robots] = self._read(robots)

    def _build(self, i):
        """A space with ground and standing robot i, and the robot's six motors."""
        robot, (torso, joints) = self.robot, self.standing
        space = pymunk.Space()
        space.gravity = 0, -robot.gravity
        space.iterations = robot.planar_iterations
        space.collision_slop = 0.0005  # [m] pymunk's own value is meant for pixels
        still = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        ground = pymunk.Segment(still, (-1e4, -1), (1e4, -1), 1)
        ground.friction = self.body.friction[i]  # pymunk MULTIPLIES both shapes' μ; the other is 1
        # The segment lies 1 m below z = 0 and has a radius of 1 m: its upper side is z = 0.
        space.add(still, ground)  # it never moves, and takes 66 kB less than a static body
        legs = body_points(robot, torso, joints)[0][:, :3, [0, 2]].reshape(6, 2)
        points = np.vstack([torso[[0, 2]], legs]).tolist()  # [7, 2] upper joint of each body
        pitches = torso[4] + np.append(0, joints[SAGITTAL].reshape(2, 3).cumsum(1))  # [7]
        bodies, motors = [], []
        for k, (link, point, pitch) in enumerate(zip(self.links, points, pitches)):
            mass = link.mass * self.body.mass[i, self.MASS[k]]
            body = pymunk.Body(mass, link.inertia[1] * mass / link.mass)
            x, _, z = link.com
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
                space.add(
                    motor,
                    pymunk.PivotJoint(parent, body, point),
                    pymunk.RotaryLimitJoint(
                        parent, body, -robot.joint_max[index], -robot.joint_min[index]
                    ),
                )
                motors.append(motor)
        return space, motors

    def _read(self, robots):
        """States [n, 7, 6] of the bodies of these robots, a view until the next reading; all spaces
        in one buffer, for speed.
        """
        everything = pymunk.batch.BodyFields.ALL
        self.buffer.clear()  # always the same one, because pymunk 7.3 never frees a Buffer
        for i in robots:
            pymunk.batch.get_space_bodies(self.spaces[i], everything, self.buffer)
        states = np.frombuffer(self.buffer.float_buf()).reshape(-1, 8, 9)
        return states[:, 1:, :6]  # without the ground; without force and torque

    def _angles(self, bodies):
        """Sagittal joint angles [..., 6] of bodies [..., 7, 6]: pitch of a link − its parent's."""
        pitch = -bodies[..., self.ANGLE]
        return pitch[..., 1:] - pitch[..., self.PARENT]

    def run(self, robots, trajectory):
        """Let these robots [n] follow their trajectory; returns their Motion."""
        seen = self.run_plane(trajectory, robots)  # [n, T + 1, 7, 6]
        trunk = trajectory.trunk[..., [0, 1, 5]]
        wanted = relative(trunk[:, :-1], trunk[:, 1:])  # [n, T, 3] ahead, sideways, yaw per tick
        yaw = self.run_yaw(wanted[..., 2], robots)  # [n, T + 1]
        # The torso frame is below the centre of its body: (x, z) −= down·(−sin angle, cos angle)
        x, z, angle = np.moveaxis(seen[:, :, 0, :3], -1, 0)  # [n, T + 1] each
        down = self.links[0].com[2]  # [m]
        x = x + down * np.sin(angle)
        z = z - down * np.cos(angle)
        moved = np.stack([np.diff(x), wanted[..., 1]], -1)  # [n, T, 2] x: measured, y: commanded
        position = self.pose[robots, None, :2] + turned(moved, yaw[:, :-1]).cumsum(1)
        others = np.stack([z, 0 * z, -angle, yaw], -1)[:, 1:]  # z, roll, pitch, yaw
        torso = np.concatenate([position, others], -1)  # [n, T, 6]
        self.pose[robots] = torso[:, -1, [0, 1, 5]]
        joints = trajectory.joints[:, 1:].copy()
        joints[..., SAGITTAL] = self._angles(seen[:, 1:])
        fell = fallen(torso, self.standing[0][2]).any(1) | self.lost[robots]
        # About the own axes of a torso with pitch θ and yaw ψ: ω = (−ψ̇·sin θ, θ̇, ψ̇·cos θ)
        pitch = torso[:, -1, 4]
        yaw_rate = self.yaw_rate[robots]
        omega = [-yaw_rate * np.sin(pitch), -seen[:, -1, 0, self.OMEGA], yaw_rate * np.cos(pitch)]
        return Motion(torso, joints, np.stack(omega, -1), fell)

    def run_plane(self, trajectory, robots):
        """Bodies [n, T + 1, 7, 6], before and after every tick."""
        robot = self.robot
        targets = trajectory.joints[..., SAGITTAL]  # [n, T + 1, 6]
        limit = np.tile(robot.speed_limit[2:5], 2)  # [6] [rad/s]
        gain = robot.planar_gain * self.body.stiffness[robots][:, SAGITTAL]  # [n, 6] [1/s]
        dt = robot.control_dt / robot.substeps  # [s]
        rates = np.diff(targets, axis=1) / robot.control_dt  # [n, T, 6] [rad/s]
        wanted = np.stack([targets[:, :-1], rates], 2)  # [n, T, 2, 6]
        ticks = rates.shape[1]
        seen = np.empty((*targets.shape[:2], 7, 6))
        seen[:, 0] = self.bodies[robots]
        for t in range(ticks):
            if t % READ_EVERY == 0:
                end = min(t + READ_EVERY, ticks)
                pitching = -seen[:, t, 0, self.OMEGA]  # [n]
                omega = np.stack([0 * pitching, pitching], -1)  # the plane has no roll
                wanted[:, t:end, 0] += trajectory.feedback(robot, t, end, omega)[..., SAGITTAL]
            now = np.where(self.body.delay[robots, None, None], self.last[robots], wanted[:, t])
            self.last[robots] = wanted[:, t]
            # A motor that only followed the error would lag behind a moving target: add the
            # target's rate (feedforward). So a joint arrives at the end of the tick where the
            # target is then.
            error = now[:, 0] - self._angles(seen[:, t])
            speeds = np.clip(now[:, 1] + gain * error, -limit, limit)
            pushes = trajectory.push[:, t, 0].tolist()
            for i, row, push in zip(robots, speeds.tolist(), pushes):
                for motor, speed in zip(self.motors[i], row):
                    motor.rate = speed
                for _ in range(0 if self.lost[i] else robot.substeps):
                    self.motors[i][0].a.force = push, 0  # on the torso, in this step only
                    self.spaces[i].step(dt)
            seen[:, t + 1] = self._read(robots)
            lost = ~(np.abs(seen[:, t + 1]) < 1e4).all((1, 2))  # diverged; nan < 1e4 is False, too
            seen[lost, t + 1] = seen[lost, t]  # where it was last seen
            self.lost[robots] |= lost
        self.bodies[robots] = seen[:, -1]
        return seen

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

    def close(self):
        """It has no threads or processes to stop."""


def make_sim(sim, num_robots, standing, robot=RobotModel(), cores=None):
    """N robots in "pymunk" or "mujoco", standing as `stance` says, also after every reset."""
    cores = min(cores or CORES, num_robots)
    if sim == "mujoco":
        return MujocoSim(num_robots, standing, robot, cores)
    if cores == 1:  # it needs no further process
        return PymunkSim(num_robots, standing, robot)
    return Workers(num_robots, standing, robot, cores)


# ------------------------------------------------------------------------ drawing
# Trunk, head and nose: both ends of a line in the torso's frame [m]; the last two are only drawn.
# Then colour and radius [m] of all lines: these three; thigh, shin, foot of the left, the right leg.
UPPER_ENDS = np.array(
    [[[0, 0, 0.05], [0, 0, 0.24]], [[0, 0, 0.36], [0, 0, 0.36]], [[0.05, 0, 0.36], [0.08, 0, 0.36]]]
)
LINES = (
    *(("0.8", 0.085), ("0.88", 0.055), ("0.3", 0.016)),
    *itertools.product(COLORS, (0.036, 0.029, 0.016)),
)


def camera_at(azimuth=-60, elevation=20):
    """It looks at the ground from these angles [°], without perspective; (-90, 0): from the right,
    (-90, 90): from above. Its axes as rows [3, 3]: towards it, to the right, up in the picture.
    """
    return rotation(0, -np.radians(elevation), np.radians(azimuth)).T


def capsule(start, end, radius):
    """Outline [24, 2] of a thick line from start [2] to end [2], with round ends."""
    x, y = end - start
    across = np.arctan2(y, x) + np.linspace(0.5, 1.5, 12) * np.pi
    half = radius * np.stack([np.cos(across), np.sin(across)], -1)  # of a circle [12, 2]
    return np.concatenate([start + half, end - half])


def draw_robots(axes, robot, torso, joints, camera):
    """One robot at K moments, the last one strongest: torso [K, 6], joints [K, 12] as measured;
    camera: of `camera_at`. Limbs are thick lines, painted from the farthest to the nearest one.
    """
    points, _ = body_points(robot, torso, joints)  # [K, 2, 5, 3]
    turn = rotation(*torso[:, 3:].T).swapaxes(1, 2)  # [K, 3, 3]
    upper = torso[:, None, None, :3] + UPPER_ENDS @ turn[:, None]  # [K, 3, 2, 3]
    # From hip to knee, knee to ankle, heel to toe of both legs  [K, 6, 2, 3]
    legs = points[:, :, [[0, 1], [1, 2], [3, 4]]].reshape(-1, 6, 2, 3)
    seen = np.concatenate([upper, legs], 1) @ camera.T  # [K, 9, 2, 3] first: towards the camera
    count = len(torso)
    # The earliest moment first, then the farthest line: it is as near as the nearer of its ends.
    for k, j in sorted(np.ndindex(count, 9), key=lambda kj: (kj[0], seen[kj][:, 0].max())):
        start, end = seen[k, j, :, 1:]
        color, radius = LINES[j]
        color = 1 - (1 - np.array(to_rgb(color))) * (k + 1) / count
        axes.fill(*capsule(start, end, radius).T, color=color, ec=color / 2, lw=0.6)


def draw_ground(axes, camera, size=2):
    """Squares of 0.25 m on the ground, `size` [m] to every side of the origin."""
    for u in np.arange(-size, size + 0.01, 0.25):
        for line in ([u, u], [-size, size]), ([-size, size], [u, u]):
            axes.plot(*(camera[1:, :2] @ line), color="0.88", lw=0.8, zorder=0)
    axes.set_aspect("equal")
    axes.axis("off")


# ------------------------------------------------------------------------ several processes
# From here on: processes, the command line and files. A first reading may skip this.
def end_with_parent():
    """Waits until the process that started this one is gone, however that ended; then ends it."""
    multiprocessing.parent_process().join()
    os._exit(1)


def begin(*settings):
    """First call in a process of `Workers`: its robots, kept under a global name."""
    global planar_sim
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the main process
    threading.Thread(target=end_with_parent, daemon=True).start()
    planar_sim = PymunkSim(*settings)


def call(method, robots, part):
    """In a process of `Workers`: run(robots, trajectory) or reset(robots, body)."""
    return getattr(planar_sim, method)(robots, part)


class Workers:
    """N planar robots over W processes: robot i is number i // W in the PymunkSim of i mod W."""

    def __init__(self, num_robots, standing, robot, cores):
        context = multiprocessing.get_context("spawn")  # the same on every system
        self.pools = []
        for w in range(cores):
            settings = len(range(w, num_robots, cores)), standing, robot
            self.pools.append(ProcessPoolExecutor(1, context, begin, settings))

    def _ask(self, method, robots, part):
        """Calls method(robots, part) with each process's share of the robots [n]; their rows in it,
        and all answers."""
        robots = np.asarray(robots, int)
        count = len(self.pools)
        rows = [np.flatnonzero(robots % count == w) for w in range(count)]
        answers = []
        for own, pool in zip(rows, self.pools):
            share = part
            if part is not None:  # every array is cut to the robots of this process
                share = replace(part, **{name: array[own] for name, array in vars(part).items()})
            answers.append(pool.submit(call, method, robots[own] // count, share))
        return rows, [answer.result() for answer in answers]

    def reset(self, robots, body=None):
        """See `PymunkSim.reset`."""
        self._ask("reset", robots, body)

    def run(self, robots, trajectory):
        """See `PymunkSim.run`."""
        rows, motions = self._ask("run", robots, trajectory)
        order = np.argsort(np.concatenate(rows))  # back into the order of `robots`
        arrays = zip(*(vars(motion).values() for motion in motions))
        return Motion(*(np.concatenate(parts)[order] for parts in arrays))

    def close(self):
        """Ends its processes."""
        for pool in self.pools:
            pool.shutdown()


# ------------------------------------------------------------------------ command line and files
class InputError(Exception):
    """Something that was given cannot be used; the message is one line that says what to do."""


def stage_parser(doc):
    """The flags of every stage."""
    parser = ArgumentParser(description=doc, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument(
        "--mujoco",
        dest="sim",
        action="store_const",
        const="mujoco",
        default="pymunk",
        help="3-D instead of the sagittal plane",
    )
    parser.add_argument("--seed", type=int, default=0, help="same seed, same numbers")
    parser.add_argument("--out", type=Path, help="folder to write to; runs/<sim>/")
    return parser


def output_folder(args, *parts):
    """The folder to write to, made if need be: --out, or these parts below runs/, or runs/<sim>. An
    InputError if nothing can be written there, if MuJoCo is asked for and missing, or if the
    seed is negative."""
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
    """write(temporary file), then rename: the old file or the new one, never half of one."""
    temporary = path.with_name(f"{path.stem}.{os.getpid()}.tmp{path.suffix}")  # two may write it
    try:
        write(temporary)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path, text):
    """UTF-8 and plain line ends on every system."""
    atomic_write(path, lambda file: file.write_text(text, encoding="utf-8", newline="\n"))


def save_figure(figure, path):
    """Writes the figure, and frees its memory."""
    atomic_write(path, lambda file: figure.savefig(file, dpi=110))
    plt.close(figure)


def start(main):
    """Calls a script's main(). What is no bug is one line, without a traceback: input that cannot
    be used, Ctrl-C, a lost process; and a reader like `head` may stop reading."""
    sys.stderr = sys.stderr or open(os.devnull, "w")  # pythonw has none
    for stream in filter(None, (sys.stdout, sys.stderr)):
        stream.reconfigure(errors="replace")  # a Windows pipe may be unable to encode α
    os.environ.pop("MUJOCO_GL", None)  # a wrong renderer would stop MuJoCo, and we need none
    plt.switch_backend("Agg")  # figures are drawn into files, without a screen
    plt.rcdefaults()  # whatever the user's own settings are
    plt.rcParams.update(STYLE)
    try:
        main()
    except BrokenPipeError:
        os._exit(1)  # nobody reads what is still to be printed
    except (InputError, KeyboardInterrupt, BrokenProcessPool) as error:
        message = str(error) or "interrupted"
        print(f"\n{Path(sys.argv[0]).name}: {message}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    start(main)
