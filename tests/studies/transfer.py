"""Does it walk where it was not trained: in another engine, in the team's own model of the robot?

    python tests/studies/transfer.py --mujoco                  joints whose zeros are wrong
    python tests/studies/transfer.py --mujoco --bullet         also in PyBullet, see `bullet.py`
    python tests/studies/transfer.py --mujoco --urdf PATH      also in the team's model
    python tests/studies/transfer.py --mujoco --walks 40 …     a tenth of the walks, for a lesson

PATH: bitbots_wolfgang/wolfgang_description/urdf/robot.urdf in your own clone of bit-bots/bitbots_main
at 3d2c30b74 (2024-09-26); its meshes are not needed. Nothing is trained or tuned here. --before
POLICY.pt adds an older policy, with the walk and the robot that its file says it was trained with.

Guess first: what costs the most time, the engine, the team's masses and shapes, or a degree in each
joint? The file as published has a mistake: at its zero the right foot is rolled by 1.3°. (It stood
there from 2020 to 2026.) The numbers of our RobotModel were taken from this file, too. What the file
has and we have not: arms, cleats under the feet, and two legs that are not quite alike.
"""

import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import partial
from pathlib import Path

import common
import matplotlib.pyplot as plt
import numpy as np
from bullet import BulletSim
from common import env, evaluate, pick, robot_model, walk_engine

DURATION = "20 minutes on two cores; --bullet and --urdf: 15 minutes more each"
RATIO = "time_ratio", "time_ratio_ci95"  # of `evaluate.time_ratio`
OWN, MENDED = "our model", "team's, mended"
SEED = 160  # of the evaluation; no other study uses it
GOALS = {"near": (False, 0.0), "far": (True, 0.0), "pushed": (True, 0.4)}  # far? pushes [m/s]
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
MASS = [0, 1, 1, 2, 3, 4, 4, 5, 5, 6, 7, 8, 8]  # columns of Body.mass of their torso and links
# What it gets from our model: motors, physics
OURS = """dof_damping dof_armature dof_frictionloss actuator_gainprm actuator_biasprm
    actuator_biastype actuator_forcerange actuator_forcelimited jnt_actfrclimited""".split()
OPTIONS = "timestep gravity cone integrator disableflags".split()


# ------------------------------------------------------------------------ the team's model
def readable(path):
    """A URDF as MuJoCo can read it: the left leg first, and of all shapes only spheres, the cleats.
    An InputError if it is not one, or one of a robot with other joints."""
    try:
        root = ET.parse(path).getroot()
    except (OSError, ET.ParseError) as error:
        raise robot_model.InputError(f"{path}: no URDF ({error})") from error
    if absent := {*NAMES} - {joint.get("name") for joint in root.iter("joint")}:
        raise robot_model.InputError(f"{path}: another robot, it has no joint {min(absent)}")
    for link in root.iter("link"):
        for shape in link.findall("visual") + link.findall("collision"):
            if shape.tag == "visual" or shape.find("geometry/sphere") is None:
                link.remove(shape)
    root[:] = sorted(root, key=lambda part: part.get("name", "").upper().startswith("R"))
    return ET.tostring(root, encoding="unicode")


def team_model(urdf, robot, mend=True):
    """Their bodies with our angles, motors and floor, and their names as `MujocoSim` wants them: the
    torso, then the links below the twelve joints. urdf: of `readable`."""
    import mujoco

    spec = mujoco.MjSpec.from_string(urdf)
    spec.compiler.balanceinertia = True  # inertias of some links are rounded to what cannot be
    torso = spec.worldbody.first_body()
    torso.add_freejoint()
    for joint in spec.joints[1:]:
        if joint.name not in NAMES:  # an arm or the head: it is held, and part of the torso
            held, turn = np.zeros((2, 4))
            mujoco.mju_axisAngle2Quat(turn, joint.axis, ARMS.get(joint.name, 0))
            mujoco.mju_mulQuat(held, joint.parent.quat, turn)
            joint.parent.quat = held
            spec.delete(joint)
    zero = ZERO - mend * MISTAKE * (np.arange(12) == 11)  # the last is the right ankle roll
    for name, sign, angle in zip(NAMES, SIGN, zero):
        joint = spec.joint(name)
        joint.axis, joint.ref = sign * joint.axis, angle
        joint.range = np.sort(sign * joint.range + angle)
        spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    cleats = spec.geoms
    spec.worldbody.add_geom(name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    for k, cleat in enumerate(cleats):
        cleat.name = f"cleat {k}"
        spec.add_pair(geomname1="ground", geomname2=cleat.name, condim=3)
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0  # only these pairs touch
    model, ours = spec.compile(), robot_model.mujoco_model(robot)
    for name in OURS:
        getattr(model, name)[:] = getattr(ours, name)
    for name in OPTIONS:
        setattr(model.opt, name, getattr(ours.opt, name))
    model.pair_friction[:] = ours.pair_friction[0]
    return model, [torso.name, *(spec.joint(name).parent.name for name in NAMES)]


class TeamSim(robot_model.MujocoSim):
    """N robots of the team. Hip and foot are two bodies each, which share a factor of Body.mass."""

    def __init__(self, urdf, mend, sim, num_robots, standing, robot, cores):
        super().__init__(num_robots, standing, robot, cores, *team_model(urdf, robot, mend))

    def place(self, robots, body):
        super().place(robots, body and replace(body, mass=body.mass[:, MASS]))


# ------------------------------------------------------------------------ the study
def measure(args, cases, planners=None, share=1):
    """A row for each planner in each case; cases: settings of the world by name. Goal by goal,
    over_own: its times ÷ its times in the first case; policy_over: the policy's times ÷ its times.
    """
    if args.sim != "mujoco":
        raise robot_model.InputError("this study is about the 3-D robot: add --mujoco")
    planners = planners or {"policy": common.shipped(args.sim), **common.opponents(args.sim)}
    first, rows, count = {}, [], max(1, args.walks // share)
    for case, settings in cases.items():
        told = {name: {"case": case, "planner": name} for name in planners}
        for goals, (far, push) in GOALS.items():
            with common.world(args.sim, num_robots=count, push=push, **settings) as world:
                ended = {
                    name: common.walks(planner, world, far, first=SEED)
                    for name, planner in planners.items()
                }
            own = first.setdefault(goals, ended)
            for name, walks in ended.items():
                row = common.row_of(walks, name, far)
                over = {"over_own": (walks, own[name]), "policy_over": (ended["policy"], walks)}
                for key, pair in over.items():
                    row[key], row[f"{key}_ci95"] = map(evaluate.time_ratio(*pair).get, RATIO)
                told[name] |= {f"{goals}_{key}": value for key, value in row.items()}
        rows += told.values()
    return rows


def without(args, prefix="", **settings):
    """Cases in which the walk does not answer what the IMU measures, as far as it does."""
    walk = walk_engine.TUNED[args.sim]
    off = {"reflex off": replace(walk, reflex=0), "steps off": replace(walk, capture=0, wait=0)}
    return {prefix + name: {"walk": w, **settings} for name, w in off.items() if w != walk}


def in_team(args):
    """Cases in their model, as published and mended."""
    return {
        "team's, as published": {"simulate": partial(TeamSim, args.urdf, False)},
        MENDED: {"simulate": partial(TeamSim, args.urdf, True)},
    }


def study_zeros(args):
    """Our own model; joints whose zeros are wrong; no answers."""
    cases = {OWN: {}}
    for degrees in 0.5, 1, 2:
        spread = env.Spread(zero=np.radians(degrees))
        cases[f"joint zeros, σ {degrees}°"] = {"spread": spread}
    return measure(args, cases | without(args))


def study_bullet(args):
    """The other engine."""
    if not args.bullet:
        return print("PyBullet is left out: --bullet")
    return measure(args, {OWN: {}, "PyBullet": {"simulate": BulletSim}}, share=4)


def study_urdf(args):
    """The team's model, also without answers."""
    if not args.urdf:
        return print("the team's model is left out: --urdf PATH, see transfer.py's first lines")
    cases = in_team(args)
    off = without(args, f"{MENDED}, ", **cases[MENDED])
    return measure(args, {OWN: {}} | cases | off)


def study_before(args):
    """An older policy, with the robot, the walk and the limits of its training."""
    if not args.before:
        return print("an older policy is left out: --before POLICY.pt")
    fits = common.ppo.load_policy(args.before)[1]["fits"]
    # Files of before 2026-11-26 do not say these of their robot.
    back_emf = tuple(np.divide(*(fits["robot"][name] for name in ("torque_limit", "speed_limit"))))
    robot = {"hip_x": 0.0, "stiction": (0.0,) * 6, "damping": back_emf} | fits["robot"]
    robot |= {k: robot_model.Link(**v) for k, v in robot.items() if isinstance(v, dict)}
    world = {
        "robot": robot_model.RobotModel(**robot),
        "walk": walk_engine.WalkParameters(**fits["walk"]),
        "limits": env.StepLimits(**fits["step limit"]),
    }
    cases = {"before: " + OWN: world}
    for name, settings in in_team(args).items() if args.urdf else ():
        cases["before: " + name] = world | settings
    return measure(args, cases, {"policy": common.policy(args.before, args.sim)})


FLAGS = {
    "walks": {"type": int, "default": 400},
    "bullet": {"action": "store_true"},
    "urdf": {"type": readable},  # a wrong file ends it at once
    "before": {"type": Path},
}
PARTS = {"zeros": study_zeros, "bullet": study_bullet, "urdf": study_urdf, "before": study_before}
COLUMNS = {
    "case": 0,
    "far_episodes": 0,
    "near_success": 3,
    "near_time_mean": 2,
    "far_success": 3,
    "far_time_mean": 2,
    "far_still_there": 2,
    "far_over_own": 2,
    "pushed_fall": 3,
}


def table(found, sim):
    """A table for each part."""
    columns = {"planner": 0} | COLUMNS | {"far_policy_over": 2}
    return common.sections(found, dict.fromkeys(PARTS, columns))


def rows_of(found):
    """The rows of all parts; those in our model once, of the first part."""
    first = {}
    for part in filter(found.get, PARTS):
        for row in found[part]["rows"]:
            first.setdefault((row["case"], row["planner"]), row)
    return [*first.values()]


def plot(found, sim):
    """Far goals: who arrives, and how much longer it takes; a row a case, a colour a planner."""
    figure, panels = plt.subplots(1, 2, figsize=(11, 5.5), sharey=True)
    rows = [row for row in rows_of(found) if row["far_over_own"]]
    cases = [*dict.fromkeys(row["case"] for row in rows)]
    for shift, (name, color) in zip((0.2, 0, -0.2), common.COLORS.items()):
        own = pick(rows, planner=name)
        y = shift - np.array([cases.index(row["case"]) for row in own])
        for panel, key in zip(panels, ("far_success", "far_over_own")):
            x, (low, high) = (np.array([row[k] for row in own]).T for k in (key, f"{key}_ci95"))
            errors = np.maximum(0, [x - low, high - x])
            panel.errorbar(x, y, xerr=errors, fmt="o", color=color, capsize=3, label=name)
    panels[0].set(yticks=-np.arange(len(cases)), yticklabels=cases)
    panels[0].set(xlabel="share of walks that arrive [1]")
    panels[1].axvline(1, color="0.5", zorder=0)
    panels[1].set(xlabel="mean time ÷ that on our model, same goals [1]")
    panels[1].legend()
    figure.suptitle("Far goals with noise: the same planners in other worlds; bars: 95 % intervals")
    return figure


def found(data):
    """Sentences by name, from the numbers of 3-D."""
    rows, told = rows_of(data["mujoco"]), {}
    for name in "expert", "baseline_tuned":
        own, keys = pick(rows, planner=name), ("near_policy_over_ci95", "far_policy_over_ci95")
        pairs = [row[key] for row in own for key in keys if row[key]]  # None: nobody arrived
        less, more = sum(high < 1 for _, high in pairs), sum(low > 1 for low, _ in pairs)
        told[name] = (
            f"Of {len(pairs)} pairs of a world and a set of goals, near or far, the policy needs less "
            f"time than `{name}` in {less} and more in {more}. In the others the 95 % interval of "
            "the ratio of their times contains 1."
        )
    return told | {
        "policy": f"The policy:\n\n{common.table(pick(rows, planner='policy'), COLUMNS)}"
    }


if __name__ == "__main__":
    common.start("transfer")
