"""The study `transfer`: another model of the robot, another robot. The team's own file is not here;
small_robot.urdf tells our robot as theirs does."""

import re
from argparse import Namespace

import common
import mujoco
import numpy as np
import pytest
import transfer
import walk
from checks import close
from common import evaluate, robot_model

TESTS = common.ROOT / "tests"
FILE = TESTS / "small_robot.urdf"
URDF = transfer.readable(FILE)
ROBOT = robot_model.RobotModel()
SETTINGS = 2, robot_model.stance(ROBOT), ROBOT  # of a simulator


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


@pytest.mark.parametrize("pattern, instead, reason", [
    ("</robot>", "", "no element"), ("<.*", "<robot/>", "its joints must be LHipYaw, LHipRoll"),
    ('(LKnee".*?<axis xyz=")0 1 0', r"\g<1>0 -1 0", "links"),
    ('mass value="', r"\g<0>1", "kilograms"), ("collision", "visual", "cleats"),
    ('name="LKnee" type="revolute">', r'\g<0><mimic joint="RKnee"/>', "mimic"),
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


@pytest.mark.shipped
def test_rows_become_a_table(monkeypatch):
    ended = {"outcome": np.array(["success"] * 2)}
    ended |= {name: np.ones(2) for name in ("time", "steps", "still_there")}
    monkeypatch.setattr(common, "walks", lambda *_: ended)
    args = Namespace(sim="mujoco", walks=2, brief=False, urdf=URDF)
    parts = {name: transfer.PARTS[name] for name in ("zeros", "op3", "urdf")}
    found = {name: {"rows": study(args)} for name, study in parts.items()}
    assert transfer.MENDED in common.tables(transfer, found)
    rows = [row for part in found.values() for row in part["rows"]]
    assert {(row["success"], row["episodes"]) for row in rows} == {(1, 2)}
    args.brief = True
    rows = transfer.study_zeros(args)
    assert len(rows) == 6 and {row["planner"] for row in rows} == {"policy"}, "lesson 11 reads six"


def test_the_robot_of_a_file_walks_and_a_search_begins_at_its_walk(monkeypatch):
    path = TESTS / "course" / "starters" / "op3.py"
    args = Namespace(sim="mujoco", robot=path, friction=None)
    world = evaluate.env.FootstepWorld(1, **evaluate.world_settings(args))
    tuned, robot = world.engine.parameters, world.engine.robot
    measured = walk.measure("mujoco", tuned, 0, (0.7,), 8, robot, world.limits)
    assert measured["stood"] > 0.8
    monkeypatch.setattr(common, "cma_es", lambda costs, mean, *more: mean)
    assert walk.tune(world, 0)[0] == tuned
