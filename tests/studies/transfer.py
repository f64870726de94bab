"""Does the robot walk where it was not trained: in another engine, in its own team's model?

    python tests/studies/transfer.py --mujoco                  joints whose zeros are wrong; OP3
    python tests/studies/transfer.py --mujoco --bullet         also in PyBullet
    python tests/studies/transfer.py --mujoco --urdf PATH      also in the team's model
    python tests/studies/transfer.py --mujoco --brief --walks 40    six rows, for a lesson

--bullet needs PyBullet, see `bullet.py`:

    python -m pip install --only-binary=:all: pybullet==3.2.7

PATH is one file of the team, of 2024-09-26. It needs no meshes:

    git clone --filter=blob:none --no-checkout https://github.com/bit-bots/bitbots_main team
    git -C team show 3d2c30b74:bitbots_wolfgang/wolfgang_description/urdf/robot.urdf > robot.urdf

Nothing is trained or tuned here. The robots walk to far goals, without pushes and with them, as in
`seeds.py`, but to other goals. Guess first: what costs the most time, the engine, the team's masses
and shapes, or a degree in each joint?

The file has a mistake, which the team mended on 2026-03-13: at its zero the right foot is rolled by
1.3°. Our model has its masses, lengths and motors from this file, and since 2026-11-26 the centres of
mass, the place of the hips and the dry friction of `RobotModel`. These are no evidence, then. New
to the policy are arms, cleats under the feet, and two legs that are not quite alike.

Not covered: this file is a model, too. The arms do not move. Only the cleats touch the floor, and the
feet cannot touch each other.
"""

import sys
import xml.etree.ElementTree as ET
from dataclasses import replace

import common
import mujoco
import numpy as np
import seeds
from bullet import BulletSim
from common import env, robot_model, walk_engine

sys.path.append(str(common.ROOT / "tests" / "course" / "starters"))
import op3

InputError = robot_model.InputError
DURATION = "5 minutes on one core; --bullet 5 minutes more, --urdf 5 minutes more"
OWN, BULLET = "our model", "PyBullet"
PUBLISHED, MENDED = "team's, as published", "team's, mended"
ZEROS = {f"joint zeros, σ {k / 2:g}°": k * env.Spread.zero for k in (2, 4)}  # ours: 0.5°
SEED = 201  # of the evaluation; no other study uses it
WALK = walk_engine.TUNED["mujoco"]
OFF = {  # walks that do not answer what the IMU measures
    "reflex off": {"walk": replace(WALK, reflex=0.0)},
    "steps off": {"walk": replace(WALK, capture=0.0, wait=0.0)},
}
# ours = sign · theirs + zero [rad]: sign of the left, of the right leg; zero of the left, of the right
JOINTS = {
    "HipYaw": (-1, -1, 0, 0),  # their axis points down
    "HipRoll": (1, 1, 0, 0),  # both point ahead
    "HipPitch": (-1, 1, 0.0258, 0.0232),  # mirrored motors; our thigh is the line from hip to knee
    "Knee": (1, -1, -0.2876, -0.2850),  # at their zero it is bent to the front, beyond straight
    "AnklePitch": (1, -1, 0, 0),  # at both zeros the sole is at right angles to the shin
    "AnkleRoll": (-1, -1, 0, 0),  # their axis points back
}
NAMES = [side + name for side in "LR" for name in JOINTS]
SIGN, ZERO = np.transpose([*JOINTS.values()]).reshape(2, 12)
MISTAKE = 1.5708 - 1.54833  # [rad] by which the file turns the right foot too little
ARMS = {"LShoulderPitch": 0.6, "LElbow": 0.3, "RShoulderPitch": -0.6, "RElbow": -0.3}  # in a walk
# What it gets from our model: motors, physics
OURS = """dof_damping dof_armature dof_frictionloss actuator_gainprm actuator_biasprm
    actuator_biastype actuator_forcerange actuator_forcelimited jnt_actfrclimited""".split()
OPTIONS = "timestep", "cone", "disableflags"
BENT = np.full(12, 0.5)  # [rad] joint angles at which the two robots are compared
TURNED, APART = 0.17, 0.05  # [rad, m] largest difference of joint axes, and their distance


# ------------------------------------------------------------------------ the team's model
def team_model(urdf, mend, ours):
    """The team's robot as a MuJoCo model with our angles, and with motors and floor of `ours`, and the
    indices of its PARTS, see `MujocoSim`. A ValueError if a file does not tell their robot.
    """
    spec = mujoco.MjSpec.from_string(urdf)
    if [joint.name for joint in spec.joints if joint.name in NAMES] != NAMES:
        raise ValueError(f"from the hips down its joints must be {', '.join(NAMES)}")
    for joint in spec.joints:
        if joint.name not in NAMES:  # an arm or the head: it is held, and part of the torso
            held, turn = np.zeros((2, 4))
            mujoco.mju_axisAngle2Quat(turn, joint.axis, ARMS.get(joint.name, 0))
            mujoco.mju_mulQuat(held, joint.parent.quat, turn)
            joint.parent.quat = held
            spec.delete(joint)
    for joint, sign, zero in zip(spec.joints, SIGN, ZERO):
        if mend and joint.name == "RAnkleRoll":
            zero -= MISTAKE
        joint.axis, joint.ref = sign * joint.axis, zero
        joint.range = np.sort(sign * joint.range + zero)
        motor = {"target": joint.name, "trntype": mujoco.mjtTrn.mjTRN_JOINT}
        spec.add_actuator(name=joint.name, **motor)
    for kind, axis in zip(ours.jnt_type[:6], ours.jnt_axis):  # on which the torso hangs
        spec.worldbody.first_body().add_joint(type=kind, axis=axis)
    cleats = spec.geoms
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    for k, cleat in enumerate(cleats):
        cleat.name = f"cleat {k}"
        spec.add_pair(geomname1="floor", geomname2=cleat.name, condim=3)
    model = spec.compile()
    bodies = model.jnt_bodyid[5:]  # [13] the torso, then the body below each joint
    if not {*bodies[[6, 12]]} <= {*model.geom_bodyid}:
        raise ValueError("no spheres, the cleats, under both feet")
    model.geom_contype[:] = model.geom_conaffinity[:] = 0  # only these pairs touch
    for name in OURS:
        getattr(model, name)[:] = getattr(ours, name)
    for name in OPTIONS:
        setattr(model.opt, name, getattr(ours.opt, name))
    model.pair_friction[:] = ours.pair_friction[0]
    # The bodies with random masses: the torso, and those below our joints but for hip yaw and ankle
    # pitch (hip and foot are two bodies each, and only the mass of the lower one is random).
    return model, np.delete(bodies, [1, 5, 7, 11])


def team_sim(urdf, mend):
    """The simulator of the team's robots; urdf: of `readable`; mend: without the file's mistake."""

    class TeamSim(robot_model.MujocoSim):
        def build(self, robot):
            model, self.PARTS = team_model(urdf, mend, super().build(robot))
            return model

    return TeamSim


def axes(simulator, joints):
    """The directions of the joint axes [12, 3], and a point on each [12, 3] [m], seen from the torso.
    (Frames of links may be turned in any way, as in the team's file.)"""
    data = mujoco.MjData(simulator.model)
    data.qpos[6:] = joints
    mujoco.mj_kinematics(simulator.model, data)
    return data.xaxis[6:], data.xanchor[6:]


def readable(path):
    """A URDF as MuJoCo can read it: the left leg first, and of all shapes only spheres, the cleats.
    An InputError if it is not one, or one of another robot."""
    try:
        root = ET.parse(path).getroot()
        if root.find("joint/mimic") is not None:
            raise ValueError("a joint follows another one (mimic)")
        for link in root.iter("link"):
            for part in [*link]:
                sphere = part.tag == "collision" and part.find("geometry/sphere") is not None
                if part.tag != "inertial" and not sphere:
                    link.remove(part)
        root[:] = sorted(root, key=lambda part: part.get("name", "").upper().startswith("R"))
        urdf, robot = ET.tostring(root, encoding="unicode"), robot_model.RobotModel()
        settings = 1, robot_model.stance(robot), robot
        theirs, ours = team_sim(urdf, True)(*settings), robot_model.MujocoSim(*settings)
        (axis, point), (our_axis, our_point) = (axes(one, BENT) for one in (theirs, ours))
        apart = np.linalg.norm(np.cross(point - our_point, our_axis), axis=1)  # [m]
        if not ((np.abs(axis - our_axis) < TURNED).all() and (apart < APART).all()):  # or nan
            raise ValueError("its links are not where ours are: axes, lengths in metres?")
        if not 0.9 < theirs.model.body_mass.sum() / ours.model.body_mass.sum() < 1.1:
            raise ValueError("its mass is not that of our robot: in kilograms?")
    except (OSError, ET.ParseError, LookupError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"{path}: no URDF of the team's robot ({reason})") from error
    return urdf


# ------------------------------------------------------------------------ the study
def measure(args, cases, walks):
    """Rows of the policy and its best two opponents, see `seeds.walked`, in each case; cases: settings
    of the world by name. --brief: only rows of the policy."""
    if args.sim != "mujoco" or walks < 1:
        raise InputError("this study needs --mujoco, and --walks from 1 on")
    policy, rows = {None: common.shipped(args.sim)}, []
    opponents = {} if args.brief else common.opponents(args.sim)
    for case, settings in cases.items():
        how = {"kinds": seeds.KINDS[1:], "num_robots": walks, **settings}  # far goals
        found = seeds.walked(args.sim, policy, 1, opponents, SEED, **how)
        rows += [{"case": case} | row for row in found["rows"]]
    return rows


def study_zeros(args):
    """Our own model, with zeros of the joints as in training and with larger errors."""
    zeros = {name: {"spread": env.Spread(zero=zero)} for name, zero in ZEROS.items()}
    return measure(args, {OWN: {}} | zeros, args.walks)


def study_op3(args):
    """Another robot with a walk of its own: `tests/course/starters/op3.py`."""
    if args.brief:
        return print("OP3 is left out: --brief")
    other = {"robot": op3.ROBOT, "walk": op3.WALK, "limits": op3.LIMITS}
    return measure(args, {"OP3": other}, args.walks)


def study_bullet(args):
    """The other engine; half of the walks, because it is slow."""
    if not args.bullet:
        return print("PyBullet is left out: --bullet")
    cases = {OWN: {}, BULLET: {"physics": BulletSim}}
    return measure(args, cases, max(1, args.walks // 2))


def study_urdf(args):
    """The team's model, as published, mended, and without answers."""
    if not args.urdf:
        return print("the team's model is left out: --urdf PATH, see transfer.py's first lines")
    published, mended = ({"physics": team_sim(args.urdf, mend)} for mend in (False, True))
    cases = {PUBLISHED: published, MENDED: mended}
    cases |= {f"{MENDED}, {name}": mended | settings for name, settings in OFF.items()}
    return measure(args, cases, args.walks)


FLAGS = {
    "walks": {"type": int, "default": 200, "help": "for each row; in PyBullet half of them"},
    "brief": {"action": "store_true", "help": "only the policy, without OP3"},
    "bullet": {"action": "store_true", "help": "PyBullet, too: 8 GB of memory"},
    "urdf": {"type": readable, "help": "the team's model, too"},  # a wrong file ends it at once
}
PARTS = {"zeros": study_zeros, "op3": study_op3, "bullet": study_bullet, "urdf": study_urdf}


SHOWN = {"case": 0, "push": 1, "planner": 0, "success": 3, "falls": 0, "time_mean": 2}
SHOWN |= {f"over_{name}": 3 for name in ("baseline_tuned", "expert")}
COLUMNS = dict.fromkeys(PARTS, SHOWN)


if __name__ == "__main__":
    common.start("transfer")
