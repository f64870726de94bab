"""Stage 1: what is the robot, and what does physics do with it?

Paper: section II-a, a simulated biped with position-controlled joints. The robot is [6].

    python 01_robot_model.py             pymunk: sagittal plane + yaw
    python 01_robot_model.py --mujoco    MuJoCo: full 3-D

64 robots stand for a second, then lean forward, slowly, each to a different angle (`--seed`); the
smallest lean that fell is drawn (`runs/<sim>/01_robot.png`); 2 seconds. Predict it from the numbers
below: by how much must the ankles of `stance` turn until the centre of mass passes the toes?

The words. The sagittal plane divides a body into left and right: x and z lie in it. Trunk and torso
are one part: "trunk" is where the walk wants it, "torso" where physics put it. The support foot
stands while the swing foot travels; a sole is the rectangle under a foot. Armature: the inertia of
a motor's fast rotor, felt through the gears. Back-EMF: a turning motor is a generator, too, and
brakes itself; at its speed limit no torque is left. Frames: x forward, y left, z up; angles in
radians, counter-clockwise about their axis, so a positive pitch leans forward. Joints, left leg and
then right: hip yaw, hip roll, hip pitch, knee, ankle pitch, ankle roll. Shapes: N robots, n some of
them (given by their indices), T control ticks.

Left out: arms and head (their mass is in the torso), gear play, sensors; only soles touch anything.

[5] Bestmann, Zhang, 2022: Bipedal Walking on Humanoid Robots through Parameter Optimization.
[6] Bestmann et al., 2021: Wolfgang-OP: A Robust Humanoid Robot Platform for Research and
    Competitions.
"""

import contextlib
import copy
import importlib.util
import math
import multiprocessing
import os
import signal
import sys
import tempfile
from argparse import ArgumentParser, ArgumentTypeError, RawDescriptionHelpFormatter
from dataclasses import dataclass
from pathlib import Path

os.environ["MPLBACKEND"] = "Agg"  # figures are drawn into files, without a screen
if __name__ == "__mp_main__":  # a process of `Workers`: Ctrl-C does not end it, a closed pipe does
    signal.signal(signal.SIGINT, signal.SIG_IGN)

import matplotlib.pyplot as plt
import numpy as np
import pymunk.batch

LEFT, RIGHT = 0, 1
COLORS = ("tab:blue", "tab:orange")  # of the left and of the right foot in every figure
JOINTS = ("hip yaw", "hip roll", "hip pitch", "knee", "ankle pitch", "ankle roll")
SAGITTAL = np.array([2, 3, 4, 8, 9, 10])  # the six of twelve joints that the planar robot has
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

@dataclass(frozen=True)
class Link:
    """A rigid body. `com` is seen from the joint above (torso: its frame); y outward for a leg."""
    mass: float  # [kg]
    com: tuple  # [m] centre of mass (x, y, z)
    inertia: tuple  # [kg m²] about the centre of mass (x, y, z)

@dataclass(frozen=True)
class RobotModel:
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
    speed_limit: tuple = (5.76, 5.76, 5.76, 3.87, 5.76, 5.76)  # [rad/s] without load
    joint_min: tuple = (-1.57, -1.6, -2.77, -0.2, -1.42, -1.4)  # [rad] about z, x, y, y, y, x
    joint_max: tuple = (1.57, 1.6, 0.79, 2.8, 0.37, 1.4)
    armature: float = 0.01  # [kg m²] our choice
    # The world.
    friction: float = 0.7  # [-] foot on ground, μ; the robot's own simulator: 0.5
    gravity: float = 9.81  # [m/s²]
    control_dt: float = 0.010  # [s] a control tick: a new joint target; our choice
    substeps: int = 2  # [-] physics steps in a control tick, in both simulators; our choice
    stiffness: float = 300.0  # [N m/rad] position gain of a motor, only in MuJoCo; our choice
    # pymunk only.
    planar_gain: float = 40.0  # [1/s] speed of a motor per position error; our choice
    planar_iterations: int = 20  # [-] of the solver; our choice, keeps the joints together
    yaw_inertia: float = 0.05  # [kg m²] whole robot about the vertical; our estimate
    yaw_stiffness: float = 45.0  # [N m/rad] hip yaw motor; our choice
    yaw_damping: float = 3.0  # [N m s/rad] critical for the two values above

    @property
    def hips(self):
        """Both hips in the trunk's frame, [2, 3] [m]."""
        return np.array([[0, self.hip_y, self.hip_z], [0, -self.hip_y, self.hip_z]])

    @property
    def damping(self):
        """Back-EMF of the motors of a leg, shape [6] [N m s/rad]: torque limit / speed limit."""
        return np.array(self.torque_limit) / np.array(self.speed_limit)

@dataclass(frozen=True)
class Spread:
    """How far ground and robot may be from the model in an episode; the robot is not told. All
    zeros: the model itself. Every value is drawn uniformly, independently; sizes: our choice."""
    friction: float = 0.3  # [-] ± on μ
    mass: float = 0.10  # [-] ± share of every link's mass and inertia
    stiffness: float = 0.20  # [-] ± share of every motor's position gain
    stiction: float = 1.5  # [N m] 0 to this: dry friction of every joint; public model: 2.55
    delay: int = 1  # [ticks] 0 or this, equally likely; at most 1: from target to motor

    def draw(self, rngs, robot):
        """One Body per generator, n in all."""
        dice = np.array([rng.uniform(-1, 1, 35) for rng in rngs])  # [n, 1 + 9 + 12 + 12 + 1]
        friction, mass, stiffness, stiction, delay = np.split(dice, [1, 10, 22, 34], axis=1)
        return Body(np.maximum(0, robot.friction + self.friction * friction[:, 0]),
                    1 + self.mass * mass, 1 + self.stiffness * stiffness,
                    self.stiction * (1 + stiction) / 2, self.delay * (delay[:, 0] > 0))

@dataclass
class Body:
    """What n robots drew, and do not know."""
    friction: np.ndarray  # [n] μ of the ground
    mass: np.ndarray  # [n, 9] factors: torso, left hip, thigh, shin, foot, right ones
    stiffness: np.ndarray  # [n, 12] factors
    stiction: np.ndarray  # [n, 12] [N m] dry friction
    delay: np.ndarray  # [n] [ticks] 0 or 1

@dataclass
class Trajectory:
    """What N robots are asked to do in T control ticks; sample 0 is where the last one ended."""
    joints: np.ndarray  # [N, T + 1, 12] joint targets [rad]
    trunk: np.ndarray  # [N, T + 1, 6] x, y, z [m], roll, pitch, yaw [rad]; only the plane reads it

@dataclass
class Motion:
    """What physics did with N robots: at the end of each of T control ticks, or at the very end."""
    torso: np.ndarray  # [N, T, 6] x, y, z [m], roll, pitch, yaw [rad] in the world
    joints: np.ndarray  # [N, T, 12] measured [rad]; joints that the plane lacks: as commanded
    spin: np.ndarray  # [N, 3] angular velocity of the torso about its own axes [rad/s], at the end
    fell: np.ndarray  # [N] bool: fell at any control tick

# ------------------------------------------------------------------------ poses on the ground
def wrap(angle):
    """The same angle in [−π, π) [rad]."""
    return (angle + np.pi) % (2 * np.pi) - np.pi

def turned(vector, yaw):
    """Vectors [..., 2] turned by yaw [...] [rad]."""
    (x, y), cos, sin = np.moveaxis(vector, -1, 0), np.cos(yaw), np.sin(yaw)
    return np.stack([cos * x - sin * y, sin * x + cos * y], -1)

def compose(base, pose):
    """The pose [..., 3] (x, y, yaw) given in the frame `base` [..., 3], seen from outside."""
    place = base[..., :2] + turned(pose[..., :2], base[..., 2])
    return np.concatenate([place, (base[..., 2] + pose[..., 2])[..., None]], -1)

def relative(base, pose):
    """The pose [..., 3] seen from the frame `base` [..., 3]; inverse of `compose`."""
    place = turned(pose[..., :2] - base[..., :2], -base[..., 2])
    return np.concatenate([place, (pose[..., 2] - base[..., 2])[..., None]], -1)

# ------------------------------------------------------------------------ leg kinematics
def rotation(roll, pitch, yaw):
    """Rz(yaw)·Ry(pitch)·Rx(roll): arrays of one shape [...] in, matrices [..., 3, 3] out."""
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    cy, sy = np.cos(yaw), np.sin(yaw)
    rows = [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,
            sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,
            -sp, cp * sr, cp * cr]
    return np.stack(rows, -1).reshape(*np.shape(roll), 3, 3)

def leg_points(robot, joints):
    """Where the parts of a leg are, in the hip's frame, for angles [..., 6].

    Returns points [..., 5, 3]: hip, knee, ankle, heel, toe [m], the last two straight behind and
    ahead of the ankle at the height of the sole; and the foot's rotation [..., 3, 3]
    = Rz(hip yaw)·Rx(hip roll)·Ry(hip pitch + knee + ankle pitch)·Rx(ankle roll).
    """
    yaw, roll, pitch, knee, ankle_pitch, ankle_roll = np.moveaxis(np.asarray(joints), -1, 0)
    zero = np.zeros_like(yaw)
    hip_turn = rotation(roll, zero, yaw)  # [..., 3, 3]
    pitches = pitch, pitch + knee, pitch + knee + ankle_pitch
    thigh_turn, shin_turn, flat_turn = (hip_turn @ rotation(zero, p, zero) for p in pitches)
    foot_turn = flat_turn @ rotation(ankle_roll, zero, zero)
    knee_point = -robot.thigh_length * thigh_turn[..., 2]  # a leg hangs along −z
    ankle = knee_point - robot.shin_length * shin_turn[..., 2]
    heel = ankle + foot_turn @ np.array([-robot.foot_back, 0, -robot.ankle_height])
    toe = ankle + foot_turn @ np.array([robot.foot_front, 0, -robot.ankle_height])
    return np.stack([0 * ankle, knee_point, ankle, heel, toe], -2), foot_turn

def leg_inverse(robot, position, foot_turn):
    """Joint angles [..., 6] [rad] of one leg, analytically.

    position [..., 3]: ankle in the hip's frame [m]; foot_turn [..., 3, 3]: rotation of the foot. An
    ankle out of reach is moved along its line to the hip, no farther than it must; at last the
    angles are clipped to the joint limits.

         o hip       Two sides of a triangle are the thigh and the shin, the third is r, from the
          \\          ankle to the hip. Its length gives the knee. The leg lies in a plane;
           o knee    only the ankle's roll can bring r into it; there the ankle's pitch makes r a
          /          side of the triangle. What is left of the foot's rotation is the hip's.
         o__ ankle
    """
    thigh, shin = robot.thigh_length, robot.shin_length
    # The hip seen from the ankle, in the foot's frame: r = Rᵀ·(−p)
    rx, ry, rz = np.moveaxis(np.einsum("...ji,...j->...i", foot_turn, -position), -1, 0)
    length = np.sqrt(rx**2 + ry**2 + rz**2)  # [...]
    # Law of cosines: |r|² = thigh² + shin² + 2·thigh·shin·cos(knee); of ±knee we take the positive.
    shortest = math.sqrt(thigh**2 + shin**2 + 2 * thigh * shin * math.cos(robot.joint_max[3]))
    reach = np.clip(length, shortest, thigh + shin)
    knee = np.arccos(np.clip((reach**2 - thigh**2 - shin**2) / (2 * thigh * shin), -1, 1))
    ankle_roll = np.arctan2(ry, rz)
    # Pitch of r in the shin's frame, (−thigh·sin knee, 0, shin + thigh·cos knee), and the foot's.
    from_shin = np.arctan2(-thigh * np.sin(knee), shin + thigh * np.cos(knee))
    from_foot = np.arctan2(rx, np.hypot(ry, rz))
    ankle_pitch = from_shin - from_foot
    # Without the ankle's roll the foot's rotation R is M = R·Rx(−ankle roll) = Rz(yaw)·Rx(roll)·
    # Ry(pitch), with the sum of the three pitches: their axes are parallel, so they add up.
    cos, sin = np.cos(ankle_roll)[..., None], np.sin(ankle_roll)[..., None]
    m_y = cos * foot_turn[..., 1] - sin * foot_turn[..., 2]  # [..., 3] second column of M
    m_zz = sin[..., 0] * foot_turn[..., 2, 1] + cos[..., 0] * foot_turn[..., 2, 2]
    yaw = np.arctan2(-m_y[..., 0], m_y[..., 1])
    roll = np.arcsin(np.clip(m_y[..., 2], -1, 1))
    pitch = np.arctan2(-foot_turn[..., 2, 0], m_zz) - knee - ankle_pitch
    joints = np.stack([yaw, roll, pitch, knee, ankle_pitch, ankle_roll], -1)
    return np.clip(joints, robot.joint_min, robot.joint_max)

def body_inverse(robot, trunk, feet, planar=False):
    """Joint angles [..., 12] that put both feet in their places; planar: legs below their hips.

    trunk [..., 6]: x, y, z, roll, pitch, yaw; feet [..., 2, 4]: x, y, z of the sole, yaw.
    """
    # Feet seen from a level frame at the trunk that turns with it: x, y, yaw. [..., 2, 3]
    seen = relative(trunk[..., None, [0, 1, 5]], feet[..., [0, 1, 3]])
    if planar:
        seen[..., 1], seen[..., 2] = robot.hips[:, 1], 0.0
    height = feet[..., 2] + robot.ankle_height - trunk[..., None, 2]  # [..., 2] ankle above trunk
    ankle = np.stack([seen[..., 0], seen[..., 1], height], -1)  # [..., 2, 3]
    # From the level frame into the leaning one: p ← Rᵀ·p, foot's rotation ← Rᵀ·Rz(yaw)
    zero = np.zeros_like(height)
    lean = rotation(trunk[..., 3], trunk[..., 4], zero[..., 0])[..., None, :, :]  # [..., 1, 3, 3]
    ankle = np.einsum("...ji,...j->...i", lean, ankle)
    foot_turn = lean.swapaxes(-1, -2) @ rotation(zero, zero, seen[..., 2])
    joints = leg_inverse(robot, ankle - robot.hips, foot_turn)  # [..., 2, 6]
    return joints.reshape(*joints.shape[:-2], 12)

def body_points(robot, torso, joints):  # [..., 6], [..., 12]
    """Legs in the world, [..., 2, 5, 3] (hip … toe), and the feet's rotations [..., 2, 3, 3]."""
    base = rotation(*np.moveaxis(torso[..., 3:], -1, 0))[..., None, :, :]  # [..., 1, 3, 3]
    points, foot_turn = leg_points(robot, joints.reshape(*joints.shape[:-1], 2, 6))
    points = points + robot.hips[:, None]
    world = (base[..., None, :, :] @ points[..., None])[..., 0] + torso[..., None, None, :3]
    return world, base @ foot_turn

def stance(robot, height=0.395, foot_distance=0.18, pitch=0.1, planar=False, x_offset=0.0):
    """Standing at the origin, trunk `x_offset` ahead of the feet: torso's pose [6], joints [12]."""
    trunk = np.array([0, 0, height, 0, pitch, 0])
    feet = np.array([[-x_offset, y, 0, 0] for y in (foot_distance / 2, -foot_distance / 2)])
    return trunk, body_inverse(robot, trunk, feet, planar)

def fallen(torso, standing_height):
    """Fall [5]: the torso [..., 6] is below half its standing height or tilted beyond 45°."""
    cos_tilt = np.cos(torso[..., 3]) * np.cos(torso[..., 4])
    return (torso[..., 2] < 0.5 * standing_height) | (cos_tilt < math.cos(math.pi / 4))

# ------------------------------------------------------------------------ MuJoCo, 3-D
def add_leg(robot, spec, leg, side):
    """One leg, from the hip down: nested bodies, joints and motors; side: 1 left, −1 right."""
    import mujoco

    body, axes = spec.body("torso"), np.eye(3)[[2, 0, 1, 1, 1, 0]]  # z, x, y, y, y, x
    for part, place, joints in (("hip", (0, side * robot.hip_y, robot.hip_z), (0, 1)),
                                ("thigh", (0, 0, 0), (2,)),
                                ("shin", (0, 0, -robot.thigh_length), (3,)),
                                ("foot", (0, 0, -robot.shin_length), (4, 5))):
        link = getattr(robot, part)
        body = body.add_body(name=f"{leg} {part}", pos=place, mass=link.mass, inertia=link.inertia,
                             ipos=np.array(link.com) * (1, side, 1), explicitinertial=True)
        for k in joints:
            name, limit = f"{leg} {JOINTS[k]}", robot.torque_limit[k]
            body.add_joint(name=name, axis=axes[k], range=(robot.joint_min[k], robot.joint_max[k]),
                           damping=robot.damping[k], armature=robot.armature)
            motor = spec.add_actuator(name=name, target=name, forcerange=(-limit, limit),
                                      trntype=mujoco.mjtTrn.mjTRN_JOINT)
            motor.set_to_position(kp=robot.stiffness)
    size = robot.foot_front + robot.foot_back, robot.foot_width, robot.sole_height  # of the box
    place = (robot.foot_front - robot.foot_back) / 2, side * robot.foot_outward
    body.add_geom(name=f"{leg} sole", type=mujoco.mjtGeom.mjGEOM_BOX, size=np.array(size) / 2,
                  pos=(*place, size[2] / 2 - robot.ankle_height), contype=0, conaffinity=0)

def mujoco_model(robot):
    """The robot as a MuJoCo model. Each motor is a position servo with a torque-speed line:

    τ = clip(stiffness·(target − q), ±torque limit) − damping·q̇, zero at the speed limit.
    A joint that the ground drives backward is braked harder than the limit, as by a real motor.
    Geoms touch nothing (contype 0) except in three pairs; condim 3: a normal force and two along
    the ground, within Coulomb's cone, alike in all directions (MuJoCo's own choice is a pyramid: μ
    along the ground's x and y, μ/√2 between them; it is 1.3 times faster and lets feet skate).
    The flags save a third of the time: at landing feet Newton's method needs fewer iterations when
    it does not start from the last forces, and one robot has no islands to solve apart.
    """
    import mujoco

    spec, bit = mujoco.MjSpec(), mujoco.mjtDisableBit
    spec.compiler.degree = False  # angles in radians
    spec.option.timestep = robot.control_dt / robot.substeps
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.gravity = 0, 0, -robot.gravity
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.disableflags = bit.mjDSBL_WARMSTART | bit.mjDSBL_ISLAND
    ground = mujoco.mjtGeom.mjGEOM_PLANE
    spec.worldbody.add_geom(name="ground", type=ground, size=(0, 0, 1), contype=0, conaffinity=0)
    torso = spec.worldbody.add_body(name="torso", mass=robot.torso.mass, ipos=robot.torso.com,
                                    inertia=robot.torso.inertia, explicitinertial=True)
    torso.add_freejoint()
    add_leg(robot, spec, "left", 1)
    add_leg(robot, spec, "right", -1)
    soles, friction = ("left sole", "right sole"), (robot.friction, robot.friction, 0, 0, 0)
    for one, other in (("ground", soles[0]), ("ground", soles[1]), soles):
        spec.add_pair(geomname1=one, geomname2=other, condim=3, friction=friction)
    return spec.compile()

def euler(quaternion):
    """Roll, pitch, yaw [..., 3] of unit quaternions [..., 4] (w, x, y, z)."""
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.stack([roll, pitch, yaw], -1)

class MujocoSim:
    """N robots in 3-D. One call of `mujoco.rollout` runs all of them on all cores."""
    # Columns of MuJoCo's state [38]; from 20 on velocities: place, turning (own axes), joints.
    TIME, PLACE, TURN, ANGLES, SPIN = 0, slice(1, 4), slice(4, 8), slice(8, 20), slice(23, 26)

    def __init__(self, num_robots, standing, robot=RobotModel(), cores=1):
        import mujoco.rollout  # only here: everything else works without MuJoCo

        # A diverging robot would fill the terminal and a log file; we report it as a fall.
        mujoco.set_mju_user_warning(lambda text: None)
        self.mujoco, self.robot, (torso, joints) = mujoco, robot, standing
        self.model = mujoco_model(robot)
        self.models = [self.model] * num_robots  # of each robot; its own after a reset with a Body
        self.data = [mujoco.MjData(self.model) for _ in range(cores)]
        self.pool = mujoco.rollout.Rollout(nthread=cores if cores > 1 else 0)
        self.standing_height = torso[2]
        self.start = np.zeros(1 + self.model.nq + self.model.nv)  # [38] standing at the origin
        self.start[self.PLACE], self.start[self.ANGLES] = torso[:3], joints
        self.start[self.TURN] = math.cos(torso[4] / 2), 0, math.sin(torso[4] / 2), 0
        self.state = np.tile(self.start, (num_robots, 1))  # [N, 38]
        self.control = np.tile(joints, (num_robots, 1))  # [N, 12] of the last tick
        self.delay = np.zeros(num_robots, int)  # [ticks] 0 or 1

    def reset(self, robots, body=None):
        """Robots [n] stand at the origin again; body: what they drew, None: as before."""
        self.state[robots], self.control[robots] = self.start, self.start[self.ANGLES]
        if body is not None:
            self.delay[robots] = body.delay
            for row, i in enumerate(robots):
                self.models[i] = self._changed(body, row)

    def _changed(self, body, row):
        """The model with this row of a Body."""
        model = copy.copy(self.model)
        mass = np.append(1.0, body.mass[row])  # in the order of MuJoCo's bodies; first the world
        model.body_mass[:] *= mass
        model.body_inertia[:] *= mass[:, None]
        model.pair_friction[:, :2] = body.friction[row]
        model.actuator_gainprm[:, 0] *= body.stiffness[row]
        model.actuator_biasprm[:, 1] *= body.stiffness[row]
        model.dof_frictionloss[6:] = body.stiction[row]
        self.mujoco.mj_setConst(model, self.data[0])  # whatever MuJoCo derives from the masses
        return model

    def run(self, trajectory, robots):
        """Let these robots [n] follow their trajectory; returns their Motion."""
        robot, start, targets = self.robot, self.state[robots], trajectory.joints
        # A tick's target is where the joint should be at its end. Back-EMF would make the motor lag
        # behind a moving target, so it gets one that runs ahead: target + rate·damping / stiffness
        rate = np.diff(targets, axis=1) / robot.control_dt  # [n, T, 12] [rad/s]
        control = targets[:, 1:] + rate * np.tile(robot.damping / robot.stiffness, 2)
        late = np.concatenate([self.control[robots][:, None], control[:, :-1]], 1)  # by a tick
        self.control[robots] = control[:, -1]
        control = np.where(self.delay[robots, None, None], late, control)
        control = np.repeat(control, robot.substeps, axis=1)
        states, _ = self.pool.rollout([self.models[i] for i in robots], self.data, start, control)
        # MuJoCo restarts a diverged robot at time 0: a healthy-looking teleport. It is a fall.
        passed = states[:, -1, self.TIME] - start[:, self.TIME]  # [n] [s]
        lost = ~np.isfinite(states).all((1, 2)) | (passed < rate.shape[1] * robot.control_dt - 1e-6)
        states[lost] = start[lost, None]
        self.state[robots] = states[:, -1]
        seen = states[:, robot.substeps - 1 :: robot.substeps]  # [n, T, 38] at the ends of ticks
        torso = np.concatenate([seen[..., self.PLACE], euler(seen[..., self.TURN])], -1)
        fell = fallen(torso, self.standing_height).any(1) | lost
        return Motion(torso, seen[..., self.ANGLES], seen[:, -1, self.SPIN], fell)

    def close(self):
        self.pool.close()

# ------------------------------------------------------------------------ pymunk, planar
def planar_links(robot):
    """The seven bodies: torso with both hips' motors; left thigh, shin, foot; the right ones."""
    parts = [(robot.torso, 0.0), (robot.hip, robot.hip_z), (robot.hip, robot.hip_z)]
    mass = sum(link.mass for link, _ in parts)
    centre = sum(link.mass * (link.com[2] + z) for link, z in parts) / mass
    # Parallel axes: I = Σ (Iᵢ + mᵢ·zᵢ²)
    pitch = sum(link.inertia[1] + link.mass * (link.com[2] + z - centre) ** 2 for link, z in parts)
    torso, leg = Link(mass, (0, 0, centre), (0, pitch, 0)), (robot.thigh, robot.shin, robot.foot)
    return torso, *leg, *leg

class PymunkSim:
    """N planar robots: pymunk in the sagittal plane, yaw and sideways beside it.

    pymunk's y is our z, and its angles turn x towards y: a body's pitch is minus its angle. Yaw ψ
    is a degree of freedom of its own: every tick the lag e grows by the commanded minus the true
    turn, and the hip pushes the torso after it, as hard as its motor and the friction under a sole
    bear (`_run_yaw`). Beyond that the sole slips, and that part of the command is lost. Sideways
    follows the command and cannot fall.
    """
    PARENT = (0, 1, 2, 0, 4, 5)  # of the bodies 1…6: left and right thigh, shin, foot; 0: torso
    ANGLE, SPIN = 2, 5  # columns of a body's state x, z, angle and their rates [m, rad, s]
    MASS = [0, 2, 3, 4, 6, 7, 8]  # of the bodies in Body.mass; the hips go with the torso

    def __init__(self, num_robots, standing, robot=RobotModel()):
        self.robot, self.links = robot, planar_links(robot)
        self.standing, self.standing_height = standing, standing[0][2]
        middles = (np.arange(50) + 0.5) / 50 - 0.5  # r: mean distance from the sole's centre
        x, y = (robot.foot_front + robot.foot_back) * middles, robot.foot_width * middles
        self.sole_radius = np.hypot(x[:, None], y).mean()  # r [m]
        self.spaces, self.motors = [None] * num_robots, [None] * num_robots
        self.bodies = np.zeros((num_robots, 7, 6))
        self.pose = np.zeros((num_robots, 3))  # x, y [m], yaw ψ [rad] of the torso in the world
        self.yaw_rate, self.yaw_lag = np.zeros((2, num_robots))  # ψ̇ [rad/s], e [rad]
        self.lost = np.zeros(num_robots, bool)  # diverged
        self.buffer = pymunk.batch.Buffer()
        self.delay = np.zeros(num_robots, int)  # [ticks] 0 or 1
        self.last = np.zeros((num_robots, 2, 6))  # joint targets of the last tick and their rates
        self.masses = np.tile([link.mass for link in self.links], (num_robots, 1))  # [N, 7] [kg]
        self.friction = np.full(num_robots, robot.friction)
        self.gain = np.full((num_robots, 6), robot.planar_gain)  # [1/s]
        self.stiction = np.zeros((num_robots, 6))  # [N m]
        self.reset(np.arange(num_robots))

    def reset(self, robots, body=None):
        """Robots [n] stand at the origin again; body: what they drew, None: as before."""
        if body is not None:
            self.masses[robots] = body.mass[:, self.MASS] * [link.mass for link in self.links]
            self.friction[robots], self.delay[robots] = body.friction, body.delay
            self.gain[robots] = self.robot.planar_gain * body.stiffness[:, SAGITTAL]
            self.stiction[robots] = body.stiction[:, SAGITTAL]
        for i in robots:  # in a fresh space: a used one keeps contacts of the last fall
            self.spaces[i], self.motors[i] = self._build(i)
        self.last[robots] = self.standing[1][SAGITTAL], np.zeros(6)
        self.pose[robots], self.yaw_rate[robots], self.yaw_lag[robots] = 0, 0, 0
        self.lost[robots], self.bodies[robots] = False, self._read(robots)

    def _build(self, i):
        """A space with ground and standing robot i, and the robot's six motors."""
        robot, (torso, joints) = self.robot, self.standing
        space = pymunk.Space()
        space.gravity, space.iterations = (0, -robot.gravity), robot.planar_iterations
        space.collision_slop = 0.0005  # [m] pymunk's own value is meant for pixels
        ground = pymunk.Segment(pymunk.Body(0, 0, pymunk.Body.KINEMATIC), (-1e4, -1), (1e4, -1), 1)
        ground.friction = self.friction[i]  # pymunk MULTIPLIES both shapes' values; the other is 1
        space.add(ground.body, ground)  # it never moves, and takes 66 kB less than a static body
        legs = body_points(robot, torso, joints)[0][:, :3, [0, 2]].reshape(6, 2)
        points = [tuple(torso[[0, 2]]), *map(tuple, legs)]  # [7, 2] upper joint of each body
        pitches = torso[4] + np.array([0, *joints[2:5].cumsum(), *joints[8:11].cumsum()])
        bodies, motors = [], []
        for k, (link, point, pitch) in enumerate(zip(self.links, points, pitches)):
            # The rotor turns with the link below it. It also keeps the solver calm: without it the
            # light shin between heavy neighbours makes a standing robot sway by centimetres.
            mass, rotor = self.masses[i, k], robot.armature if k else 0.0
            body = pymunk.Body(mass, link.inertia[1] * mass / link.mass + rotor)
            x, _, z = link.com
            body.angle, body.position = -pitch, point
            body.position = body.local_to_world((x, z))  # pymunk counts from the centre of mass
            space.add(body)
            if link is robot.foot:
                back, front, low = -robot.foot_back, robot.foot_front, -robot.ankle_height
                high = low + robot.sole_height
                corners = [(back, low), (front, low), (front, high), (back, high)]
                shape = pymunk.Poly(body, [(u - x, w - z) for u, w in corners])
                shape.friction, shape.filter = 1.0, pymunk.ShapeFilter(group=1)  # not one another
                space.add(shape)
            if k:  # a joint angle is q = pitch − parent's pitch = parent's angle − angle [pymunk's]
                parent, index = bodies[self.PARENT[k - 1]], SAGITTAL[k - 1] % 6
                # A speed with a largest torque, less dry friction (which in MuJoCo helps to hold).
                motors.append(pymunk.SimpleMotor(parent, body, 0.0))  # its rate is q̇, too
                motors[-1].max_force = max(0, robot.torque_limit[index] - self.stiction[i, k - 1])
                limits = -robot.joint_max[index], -robot.joint_min[index]  # its angle is −q
                space.add(motors[-1], pymunk.PivotJoint(parent, body, point),
                          pymunk.RotaryLimitJoint(parent, body, *limits))
            bodies.append(body)
        return space, motors

    def _read(self, robots):
        """States [n, 7, 6] of the bodies of these robots; all spaces in one buffer, for speed."""
        batch, buffer, fields = pymunk.batch, self.buffer, pymunk.batch.BodyFields
        buffer.clear()  # one for ever: pymunk 7.3 never frees a Buffer
        wanted = fields.POSITION | fields.ANGLE | fields.VELOCITY | fields.ANGULAR_VELOCITY
        for i in robots:
            batch.get_space_bodies(self.spaces[i], wanted, buffer)
        return np.frombuffer(buffer.float_buf()).reshape(-1, 8, 6)[:, 1:].copy()  # first: ground

    def _angles(self, bodies):
        """Sagittal joint angles [..., 6] of bodies [..., 7, 6]: pitch of a link − its parent's."""
        pitch = -bodies[..., self.ANGLE]
        return pitch[..., 1:] - pitch[..., self.PARENT]

    def run(self, trajectory, robots):
        """Let these robots [n] follow their trajectory; returns their Motion."""
        robots, pose = np.asarray(robots, int), self.pose[robots]
        targets, some = trajectory.joints[..., SAGITTAL], range(0, len(robots) or 1, 16)
        seen = np.concatenate([self._run_plane(targets[i : i + 16], robots[i : i + 16])
                               for i in some])  # [n, T + 1, 7, 6]; 16 spaces fit into a cache
        trunk = trajectory.trunk[..., [0, 1, 5]]
        wanted = relative(trunk[:, :-1], trunk[:, 1:])  # [n, T, 3] ahead, sideways, yaw per tick
        yaw = self._run_yaw(seen, wanted[..., 2], robots)  # [n, T + 1]
        # The torso frame is below the centre of its body: (x, z) −= down·(−sin angle, cos angle)
        x, z, angle = np.moveaxis(seen[:, :, 0, :3], -1, 0)  # [n, T + 1] each
        down = self.links[0].com[2]  # [m]
        x, z = x + down * np.sin(angle), z - down * np.cos(angle)
        moved = np.stack([np.diff(x), wanted[..., 1]], -1)  # [n, T, 2] x: measured, y: commanded
        torso = np.zeros((*wanted.shape[:2], 6))
        torso[..., :2] = pose[:, None, :2] + np.cumsum(turned(moved, yaw[:, :-1]), 1)
        torso[..., 2], torso[..., 4], torso[..., 5] = z[:, 1:], -angle[:, 1:], yaw[:, 1:]
        self.pose[robots] = torso[:, -1, [0, 1, 5]]
        joints = trajectory.joints[:, 1:].copy()
        joints[..., SAGITTAL] = self._angles(seen[:, 1:])
        fell = fallen(torso, self.standing_height).any(1) | self.lost[robots]
        # Seen from a torso with pitch θ and yaw ψ: spin = (−ψ̇·sin θ, θ̇, ψ̇·cos θ)
        pitch, yaw_rate = torso[:, -1, 4], self.yaw_rate[robots]
        spin = [-yaw_rate * np.sin(pitch), -seen[:, -1, 0, self.SPIN], yaw_rate * np.cos(pitch)]
        return Motion(torso, joints, np.stack(spin, -1), fell)

    def _run_plane(self, targets, robots):
        """Bodies [n, T + 1, 7, 6], before and after every tick; joint targets [n, T + 1, 6]."""
        set_rate = pymunk.SimpleMotor.rate.fset  # `motor.rate = …` at half its price
        robot, limit = self.robot, np.tile(self.robot.speed_limit[2:5], 2)
        dt, numbers = robot.control_dt / robot.substeps, robots.tolist()
        rates = np.diff(targets, axis=1) / robot.control_dt  # [n, T, 6] [rad/s]
        wanted = np.stack([targets[:, :-1], rates], 2)  # [n, T, 2, 6]
        late = np.concatenate([self.last[robots][:, None], wanted[:, :-1]], 1)  # by a tick
        self.last[robots] = wanted[:, -1]
        wanted = np.where(self.delay[robots, None, None, None], late, wanted)
        seen = np.empty((*targets.shape[:2], 7, 6))
        seen[:, 0] = self.bodies[robots]
        for t in range(rates.shape[1]):
            # A motor that only followed the error would lag behind a moving target: add its rate.
            error = wanted[:, t, 0] - self._angles(seen[:, t])
            speeds = np.clip(wanted[:, t, 1] + self.gain[robots] * error, -limit, limit)
            for i, row in zip(numbers, speeds.tolist()):
                for motor, speed in zip(self.motors[i], row):
                    set_rate(motor, speed)
                for _ in range(0 if self.lost[i] else robot.substeps):
                    self.spaces[i].step(dt)
            seen[:, t + 1] = self._read(robots)
            lost = ~(np.abs(seen[:, t + 1]) < 1e4).all((1, 2))  # diverged; nan < 1e4 is False, too
            seen[lost, t + 1] = seen[lost, t]  # where it was last seen
            self.lost[robots[lost]] = True
        self.bodies[robots] = seen[:, -1]
        return seen

    def _run_yaw(self, seen, turn, robots):
        """Yaw ψ [n, T + 1] from bodies seen [n, T + 1, 7, 6] and turns asked for [n, T] [rad]."""
        robot, dt = self.robot, self.robot.control_dt
        k, c = robot.yaw_stiffness, robot.yaw_damping
        # The ground's force, ahead and up: F_x = Σ mᵢ·ẍᵢ,  F = Σ mᵢ·(z̈ᵢ + g) ≥ 0  [n, T] [N]
        change = np.diff(seen[..., 3:5], axis=1) / dt + [0, robot.gravity]  # [n, T, 7, 2]
        ahead, up = np.moveaxis((change * self.masses[robots, None, :, None]).sum(2), -1, 0)
        # bound = min(motor limit, r·√((μ·F)² − F_x²)): ahead and turning share the friction
        grip = (self.friction[robots, None] * np.maximum(up, 0.0)) ** 2 - ahead**2
        bounds = np.minimum(robot.torque_limit[0], self.sole_radius * np.sqrt(np.maximum(grip, 0)))
        yaw = np.repeat(self.pose[robots, 2:], turn.shape[1] + 1, 1)
        rate, lag = self.yaw_rate[robots], self.yaw_lag[robots]  # [n]
        for t in range(turn.shape[1]):
            bound = bounds[:, t]
            # τ = clip(k·e + c·ė, ±bound),  ė = commanded − true yaw rate;  I·ψ̈ = τ
            torque = np.clip(k * lag + c * (turn[:, t] / dt - rate), -bound, bound)
            rate = rate + torque / robot.yaw_inertia * dt
            yaw[:, t + 1] = yaw[:, t] + rate * dt
            # |e| ≤ bound / k: what would make it larger turns the sole on the ground
            lag = np.clip(lag + turn[:, t] - rate * dt, -bound / k, bound / k)
        self.yaw_rate[robots], self.yaw_lag[robots] = rate, lag
        return yaw

    def close(self):
        """Nothing to end."""

# ------------------------------------------------------------------------ several processes
def serve(pipe, *settings):
    """A process of its own: runs the methods of its PymunkSim until the pipe closes."""
    sim = PymunkSim(*settings)
    with contextlib.suppress(EOFError, ConnectionError):
        while True:
            method, robots, part = pipe.recv()
            pipe.send(sim.run(part, robots) if method == "run" else sim.reset(robots, part))

class Workers:
    """N planar robots over W processes: robot i is number i // W in the PymunkSim of i mod W."""
    def __init__(self, num_robots, standing, robot, cores):
        context = multiprocessing.get_context("spawn")  # the same on every system
        self.pipes, self.processes = [], []
        # A process imports `__main__`: let it be this file, not a later stage and PyTorch.
        started, sys.modules["__main__"] = sys.modules["__main__"], sys.modules[serve.__module__]
        for w in range(cores):
            pipe, end = context.Pipe()
            settings = end, len(range(w, num_robots, cores)), standing, robot
            self.processes.append(context.Process(target=serve, args=settings, daemon=True))
            self.processes[-1].start()
            end.close()
            self.pipes.append(pipe)
        sys.modules["__main__"] = started

    def _ask(self, method, robots, part):
        """Sends each process its share of the robots [n]; their rows in it, and all answers."""
        robots, count = np.asarray(robots, int), len(self.pipes)
        rows = [np.flatnonzero(robots % count == w) for w in range(count)]
        try:
            for own, pipe in zip(rows, self.pipes):
                share = part and type(part)(*(v[own] for v in vars(part).values()))
                pipe.send((method, robots[own] // count, share))
            return rows, [pipe.recv() for pipe in self.pipes]
        except (EOFError, ConnectionError) as error:
            raise OSError("a process of the simulator ended; start again (04: --resume)") from error

    def reset(self, robots, body=None):
        self._ask("reset", robots, body)

    def run(self, trajectory, robots):
        rows, motions = self._ask("run", robots, trajectory)
        order = np.argsort(np.concatenate(rows))  # back into the order of `robots`
        fields = zip(*(vars(motion).values() for motion in motions))
        return Motion(*(np.concatenate(parts)[order] for parts in fields))

    def close(self):
        for pipe, process in zip(self.pipes, self.processes):
            pipe.close()
            process.join(timeout=5)  # it reads the end of the pipe,
            process.terminate()  # unless a process forked since then holds the pipe open

def make_sim(sim, num_robots, standing, robot=RobotModel(), cores=None):
    """N robots in "pymunk" or "mujoco", standing as `stance` says, also after every reset."""
    cores = min(cores or CORES, num_robots)
    if sim == "mujoco":
        return MujocoSim(num_robots, standing, robot, cores)
    if cores == 1:  # no process is worth starting
        return PymunkSim(num_robots, standing, robot)
    return Workers(num_robots, standing, robot, cores)

# ------------------------------------------------------------------------ command line
def whole(text, least=0, most=2**63 - 2):
    """A whole number of the command line."""
    if not text.isdecimal() or len(text) > 19 or not least <= int(text) <= most:
        raise ArgumentTypeError(f"{text[:30]} is not a whole number from {least} to {most}")
    return int(text)

class StageParser(ArgumentParser):
    """The flags of every stage; a wrong value gets one clear line and exit code 2."""
    def __init__(self, doc, prog=None):
        super().__init__(prog, description=doc, formatter_class=RawDescriptionHelpFormatter)
        self.add_argument("--mujoco", dest="sim", action="store_const", const="mujoco",
                          default="pymunk", help="3-D instead of the sagittal plane")
        self.add_argument("--seed", type=whole, default=0, help="same seed, same numbers")
        self.add_argument("--out", type=Path, help="folder to write to; runs/<sim>/")

    def error(self, message):
        self.exit(2, f"{self.prog}: {' '.join(message.split())}\n")

    def parse(self, argv=None):
        """The arguments; `sim` is "pymunk" or "mujoco"."""
        for stream in (sys.stdout, sys.stderr):
            if hasattr(stream, "reconfigure"):  # a notebook's has not
                stream.reconfigure(errors="replace")  # Windows pipes may not know α or ±
        args = self.parse_args(argv)
        os.environ.pop("MUJOCO_GL", None)  # a wrong renderer would stop MuJoCo, and we need none
        if args.sim == "mujoco" and importlib.util.find_spec("mujoco") is None:
            self.error("--mujoco needs MuJoCo: python -m pip install mujoco")
        return args

    def folder(self, args, default=None):
        """The folder to write to, made and known to be writable."""
        out = args.out or default or Path("runs") / args.sim
        try:
            out.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=out):
                return out
        except OSError as error:
            self.error(f"cannot write to the folder {out} ({error.strerror}), choose another --out")

def atomic_write(path, write):
    """write(temporary file), then rename: the old file or the new one, never half of one."""
    temporary = path.with_name(f"{path.stem}.{os.getpid()}.tmp{path.suffix}")  # two may write it
    try:
        write(temporary)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)

def run(main):
    """Calls a stage's main(); Ctrl-C, a full disk or a lost process is one line, no traceback."""
    sys.stderr = sys.stderr or open(os.devnull, "w")  # it was closed
    try:
        main()
        print(end="", flush=True)
    except (OSError, KeyboardInterrupt) as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what is left to print may have no reader
        print(f"{Path(sys.argv[0]).name}: {str(error) or 'interrupted'}", file=sys.stderr)
        sys.exit(2 if isinstance(error, OSError) else 130)

# ------------------------------------------------------------------------ demonstration
def draw_robot(axis, robot, torso, joints, alpha=1.0):
    """The robot from the side: torso [6] and joints [12] as measured."""
    points, _ = body_points(robot, torso, joints)  # [2, 5, 3]
    up = rotation(*torso[3:]) @ np.array([0, 0, 0.3])  # [m] as long as the real torso
    back = np.array([points[:, 0].mean(0), torso[:3] + up])  # from between the hips
    axis.plot(back[:, 0], back[:, 2], color="0.75", lw=14, alpha=alpha, solid_capstyle="butt")
    for leg in (RIGHT, LEFT):  # hip, knee, ankle, heel, toe, ankle; the right leg shows as a rim
        x, _, z = points[leg, [0, 1, 2, 3, 4, 2]].T
        axis.plot(x, z, color=COLORS[leg], alpha=alpha, lw=2 + 3 * leg, solid_joinstyle="round")

def main():
    parser = StageParser(__doc__)
    args = parser.parse()
    out, robot, count = parser.folder(args), RobotModel(), 64
    standing = stance(robot, planar=args.sim == "pymunk")
    sim = make_sim(args.sim, count, standing, robot)
    leans = np.random.default_rng(args.seed).uniform(0.1, 0.5, count)  # [rad]
    seconds = np.arange(0, 10 + 1e-9, robot.control_dt)  # [T + 1]
    joints = np.tile(standing[1], (count, len(seconds), 1))  # [N, T + 1, 12]
    for ankle_pitch in (4, 10):  # left, right; stand for a second, then lean for eight
        joints[..., ankle_pitch] -= leans[:, None] * np.clip((seconds - 1) / 8, 0, 1)
    motion = sim.run(Trajectory(joints, np.zeros((count, len(seconds), 6))), np.arange(count))
    sim.close()
    i = np.argmin(np.where(motion.fell, leans, np.inf))  # the smallest lean that fell
    print(f"{motion.fell.sum()} of {count} fell; the smallest lean that did: {leans[i]:.2f} rad")

    figure, axis = plt.subplots(figsize=(7, 4.5), layout="constrained")
    down = np.argmax(fallen(motion.torso[i], standing[0][2]))  # the tick when the fall counts
    for k, tick in enumerate(np.linspace(down - 100, down, 8).astype(int)):
        draw_robot(axis, robot, motion.torso[i, tick], motion.joints[i, tick], (k + 1) / 8)
    axis.axhline(0, color="0.5", lw=1)
    axis.set(xlabel="x [m]", ylabel="z [m]", aspect="equal", ylim=(-0.05, 0.8),
             title=f"The last second before a fall, leaning by {leans[i]:.2f} rad at the ankles\n"
             "(left leg blue, right leg orange, eight moments)")
    atomic_write(out / "01_robot.png", lambda file: figure.savefig(file, dpi=110))
    print("Look at", out / "01_robot.png")

if __name__ == "__main__":
    run(main)
