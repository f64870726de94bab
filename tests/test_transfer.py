"""The study `transfer`: another model of the robot, another engine, another robot. The team's own
file is not here; small_robot.urdf tells our robot as theirs does."""

import re
import sys
import xml.etree.ElementTree as ET
from argparse import Namespace
from dataclasses import replace
from importlib.util import find_spec
from unittest import mock

import bullet
import common
import mujoco
import numpy as np
import pytest
import transfer
import walk
from checks import close
from common import evaluate, robot_model, walk_engine

TESTS = common.ROOT / "tests"
FILE = TESTS / "small_robot.urdf"
URDF = transfer.readable(FILE)
ROBOT = robot_model.RobotModel()
SETTINGS = 2, robot_model.stance(ROBOT), ROBOT  # of a simulator


def walked(physics, body=None):
    """Where four walks of stage 2 end: the torsos' x, y, yaw. Nobody falls."""
    plans = [[double_step] * 4 for double_step in walk_engine.WALKS.values()]
    with mock.patch.dict(robot_model.SIMULATORS, mujoco=physics):
        poses, _, fall = walk_engine.walk_plans("mujoco", walk_engine.TUNED["mujoco"], plans, body)
    assert (fall == 4).all()
    return poses[:, -1]


def links(simulator, joints):
    """Where torso and links are, and how they are turned, seen from the torso [9, 12]."""
    data = mujoco.MjData(simulator.model)
    data.qpos[6:] = joints
    mujoco.mj_kinematics(simulator.model, data)
    return np.hstack([data.xpos, data.xmat])[simulator.PARTS]


@pytest.mark.parametrize("mend", [True, False])
def test_the_team_s_links_are_where_ours_are(mend):
    """Names, signs and zeros of the table. As published, the right foot is rolled."""
    theirs, ours = transfer.team_sim(URDF, mend)(*SETTINGS), robot_model.MujocoSim(*SETTINGS)
    rolled = -transfer.MISTAKE * (np.arange(12) == 11)
    for joints in np.random.default_rng(0).uniform(-0.3, 0.6, (20, 12)):
        close(links(theirs, joints), links(ours, joints + (not mend) * rolled), atol=2e-5)


def test_frames_of_links_may_be_turned_as_in_the_team_s_file(tmp_path):
    """The first link of the left leg, turned by 90° about x: the same robot, told otherwise."""
    root = ET.parse(FILE).getroot()
    first = next(joint for joint in root.iter("joint") if joint.get("name") == "LHipYaw")
    name = first.find("child").get("link")
    hung = [joint for joint in root.iter("joint") if joint.find("parent").get("link") == name]

    def turned(element, key):  # seen from the turned frame: (x, y, z) is (x, z, −y)
        x, y, z = map(float, element.get(key).split())
        element.set(key, f"{x} {z} {-y}")

    first.find("origin").set("rpy", f"{np.pi / 2} 0 0")
    turned(first.find("axis"), "xyz")
    for joint in hung:
        assert joint.find("origin").get("rpy", "0 0 0").split() == ["0"] * 3
        joint.find("origin").set("rpy", f"{-np.pi / 2} 0 0")
        turned(joint.find("origin"), "xyz")
    path = tmp_path / "robot.urdf"
    path.write_text(ET.tostring(root, encoding="unicode"), "utf-8")
    theirs, same = (
        transfer.team_sim(urdf, True)(*SETTINGS) for urdf in (transfer.readable(path), URDF)
    )
    for found, want in zip(
        transfer.axes(theirs, transfer.BENT), transfer.axes(same, transfer.BENT)
    ):
        close(found, want, atol=1e-6)


@pytest.mark.shipped
def test_a_file_that_tells_our_robot_walks_as_our_robot():
    """Our masses, motors and floor; cleats instead of soles."""
    theirs, ours = walked(transfer.team_sim(URDF, True)), walked(robot_model.MujocoSim)
    close(theirs, ours, atol=0.1)


KNEE = 'name="LKnee" type="revolute">'
AXIS = '(LKnee".*?<axis xyz=")0 1 0'
MIMIC = '<mimic joint="RKnee"/>'


@pytest.mark.parametrize("pattern, instead, reason", [
    ("</robot>", "", "no element"), ("<.*", "<robot/>", "its joints must be LHipYaw, LHipRoll"),
    ("^", '<?xml version="1.0" encoding="x-none"?>', "unknown encoding"),
    (KNEE, KNEE.replace("revolute", "fixed"), "its joints must be"),
    ("LHip(Yaw|Roll)", lambda found: {"Yaw": "LHipRoll", "Roll": "LHipYaw"}[found[1]], "must be"),
    (KNEE, KNEE.replace("revolute", "prismatic"), "links"),
    (AXIS, r"\g<1>0 -1 0", "links"), (AXIS, r"\g<1>1 0 0", "links"), (AXIS, r"\1nan 0 0", "links"),
    ('(LKnee".*?<origin xyz=")0 0 -0.169', r"\g<1>0 0 -169", "links"),
    ('mass value="', r"\g<0>1", "kilograms"),
    (KNEE, KNEE + MIMIC, "mimic"), ('name="LShoulderPitch" .*?>', r"\g<0>" + MIMIC, "mimic"),
    ('mass value="0.088"', 'mass value="0"', "mass"),
    ('ixx="0.0003"', 'ixx="1"', "inertia must"), ("<inertial>.*?</inertial>", "", "mass"),
    ("collision", "visual", "cleats"), ('(<link name="LAnkleRoll.*?)<collision>.*?</link>', r"\1</link>", "cleats"),
])  # fmt: skip
def test_a_file_that_does_not_tell_the_team_s_robot_is_one_line_at_once(
    tmp_path, monkeypatch, pattern, instead, reason
):
    """Before anything walks; with "as published" beside it a table of falls would be a slander."""
    monkeypatch.setattr(transfer, "measure", pytest.fail)
    path = tmp_path / "robot.urdf"
    changed = re.sub(pattern, instead, FILE.read_text("utf-8"), flags=re.DOTALL)
    path.write_text(changed, "utf-8")
    said = rf"\A.*robot.urdf: no URDF .*{reason}.*\Z"
    with pytest.raises(robot_model.InputError, match=said):
        common.main("transfer", ["--mujoco", "--urdf", str(path)])


def test_what_is_not_there_is_said_in_words(monkeypatch, capsys):
    nothing = Namespace(bullet=False, urdf=None)
    assert transfer.study_bullet(nothing) is transfer.study_urdf(nothing) is None
    said = capsys.readouterr().out
    assert "left out: --bullet" in said and "left out: --urdf" in said
    monkeypatch.setitem(sys.modules, "pybullet", None)
    with pytest.raises(robot_model.InputError, match="python -m pip install .*pybullet==3.2.7"):
        bullet.BulletSim(*SETTINGS)


@pytest.mark.shipped
def test_rows_become_a_table(monkeypatch):
    ended = {"outcome": np.array(["success"] * 2)}
    ended |= {name: np.ones(2) for name in ("time", "steps", "still_there")}
    monkeypatch.setattr(common, "walks", lambda *_: ended)
    monkeypatch.setattr(transfer, "BulletSim", robot_model.MujocoSim)  # PyBullet may be missing
    args = Namespace(sim="mujoco", walks=2, brief=False, bullet=True, urdf=URDF)
    found = {part: {"rows": study(args)} for part, study in transfer.PARTS.items()}
    assert transfer.MENDED in common.tables(transfer, found)
    rows = [row for part in found.values() for row in part["rows"]]
    assert {(row["success"], row["episodes"]) for row in rows} == {(1, 2)}
    args.brief = True
    rows = transfer.study_zeros(args)
    assert len(rows) == 6 and {row["planner"] for row in rows} == {"policy"}, "lesson 11 reads six"
    assert "÷" not in common.table(rows, transfer.COLUMNS["zeros"]), "no empty columns"


def test_the_robot_of_a_file_walks_and_a_search_begins_at_its_walk(monkeypatch):
    path = TESTS / "course" / "starters" / "op3.py"
    args = Namespace(sim="mujoco", robot=path, friction=None)
    world = evaluate.env.FootstepWorld(1, **evaluate.world_settings(args))
    tuned, robot = world.engine.parameters, world.engine.robot
    measured = walk.measure("mujoco", tuned, 0, (0.7,), 8, robot, world.limits)
    assert measured["stood"] > 0.8
    monkeypatch.setattr(common, "cma_es", lambda costs, mean, *more: mean)
    assert walk.tune(world, 0)[0] == tuned


PYBULLET = pytest.mark.skipif(find_spec("pybullet") is None, reason=f"no PyBullet: {bullet.PIP}")


@PYBULLET
def test_another_engine_tells_the_rates_of_roll_pitch_and_yaw():
    """While a robot that flies turns about all axes."""
    simulator = bullet.BulletSim(*SETTINGS)
    simulator.reset([0])
    world = simulator.worlds[0]
    turn = world.getQuaternionFromEuler([0.4, 0.5, 2.0])
    world.resetBasePositionAndOrientation(bullet.ROBOT, [0, 0, 2], turn)
    world.resetBaseVelocity(bullet.ROBOT, angularVelocity=[1.0, -2.0, 1.5])
    before, now, after = (simulator.tick(0, simulator.standing[1], [0, 0]) for _ in range(3))
    close(now[3:6], [0.4, 0.5, 2.0], "as it was turned", atol=0.1)
    close(now[18:], (after - before)[3:6] / 0.02, "as it turns on", atol=0.05)


@PYBULLET
@pytest.mark.slow
def test_another_engine_walks_the_same_walks_with_our_masses_and_rotors():
    body = robot_model.Variation.as_model(ROBOT, 4)
    poses = walked(bullet.BulletSim, body)
    close(poses, walked(robot_model.MujocoSim), "as in MuJoCo, nearly", atol=0.3)
    for change in {"friction": np.full(4, 0.05)}, {"delay": np.ones(4)}:
        assert np.abs(walked(bullet.BulletSim, replace(body, **change)) - poses).max() > 0.005
    simulator = bullet.BulletSim(*SETTINGS)
    simulator.reset([0, 1])
    shin = simulator.model.body("left shin")
    mass, _, inertia, centre, *_ = simulator.worlds[1].getDynamicsInfo(bullet.ROBOT, 3)
    close([mass, *centre], [*shin.mass, *shin.ipos])
    close(inertia, shin.inertia + [0, ROBOT.armature, 0], "the rotor of the knee")
