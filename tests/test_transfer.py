"""The study `transfer`: another model of the robot, another engine, another robot. The team's own
file is not here; a small one is written by hand, from the table of joints."""

import sys
from argparse import Namespace
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from itertools import product

import bullet
import common
import mujoco
import numpy as np
import pytest
import transfer
import walk
from checks import close
from common import env, evaluate, robot_model, walk_engine

ROOT, OP3 = common.ROOT, common.ROOT / "tests" / "exercises" / "starters" / "op3.py"
ROBOT = robot_model.RobotModel(hip_x=0.02)
POLICY = common.RESULTS / "mujoco" / "policy.pt"
PLACES = np.zeros((6, 3))  # of a joint, seen from the one above; the left hip's y is ROBOT.hip_y
PLACES[[1, 3, 4], 2] = ROBOT.hip_z, -ROBOT.thigh_length, -ROBOT.shin_length
PLACES[2, 0] = ROBOT.hip_x
AXES = np.eye(3)[[2, 0, 1, 1, 1, 0]]
LINK = (
    '<link name="{}"><inertial><mass value="{}"/><origin xyz="0 0 {}"/>'
    '<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial>{}</link>'
)
SHAPES = (  # none of them is a cleat
    '<visual><geometry><mesh filename="package://nowhere/leg.stl"/></geometry></visual>'
    '<collision><geometry><box size="1 1 1"/></geometry></collision>'
)
CLEAT = (
    '<collision><origin xyz="{} {} {}"/><geometry><sphere radius="0.006"/></geometry></collision>'
)
JOINT = (
    '<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/><origin xyz="{}" rpy="{}"/>'
    '<axis xyz="{}"/><limit lower="{}" upper="{}" effort="1" velocity="1"/>'
    '<dynamics damping="9" friction="9"/></joint>'
)


def words(numbers):
    return " ".join(map(str, numbers))


def small_urdf(path):
    """The right leg first, as in theirs. At their zeros its links are turned by our zeros, and the
    right foot is rolled as in the published file."""
    parts = [LINK.format("base_link", 3.0, 0.12, SHAPES, i=0.04)]
    for side, outward in ("R", -1), ("L", 1):
        above = "base_link"
        for k, (name, row) in enumerate(transfer.JOINTS.items()):
            sign, zero = row[side == "R"], row[2 + (side == "R")]
            turn = (zero - transfer.MISTAKE * (side + name == "RAnkleRoll")) * AXES[k]
            place = PLACES[k] + [0, outward * ROBOT.hip_y * (k == 0), 0]
            link, shapes = f"{side.lower()}_{k}", SHAPES
            for x, y in product((0.1, -0.07), (0.04, -0.04)) if k == 5 else ():
                shapes += CLEAT.format(x, y + outward * 0.015, 0.006 - ROBOT.ankle_height)
            limits = sorted(sign * (np.array([-1.5, 2.0]) - zero))
            turns = words(place), words(turn), words(sign * AXES[k])
            parts.append(LINK.format(link, 0.3, -0.02, shapes, i=0.001))
            parts.append(JOINT.format(side + name, above, link, *turns, *limits))
            above = link
        arm, axis = f"{side}_arm", f"0 {outward} 0"
        parts.append(LINK.format(arm, 0.1, -0.1, "", i=0.001))
        name = side + "ShoulderPitch"
        parts.append(JOINT.format(name, "base_link", arm, "0 0 0.2", "0 0 0", axis, -3, 3))
    path.write_text(f'<robot name="small">{"".join(parts)}</robot>', "utf-8")
    return path


def standing(simulator, ticks, force=0):
    """The Motion of robots that should only stand; for 50 ms [N] the second one is pushed left."""
    robots = np.arange(len(simulator.state))
    plan = robot_model.Trajectory(*np.zeros((2, len(robots), ticks + 1, 12)))
    plan.joints[:] = simulator.standing[1]
    disturbance = robot_model.Disturbance.none(plan)
    disturbance.push[1:2, 5:10, 1] = force
    return simulator.run(robots, plan, disturbance)


@pytest.fixture(scope="module")
def urdf(tmp_path_factory):
    return transfer.readable(small_urdf(tmp_path_factory.mktemp("urdf") / "robot.urdf"))


@pytest.mark.parametrize("mend", [True, False])
def test_the_team_s_legs_are_ours_in_every_pose(urdf, mend):
    """Names, signs and zeros of the table: our angles put their feet where ours are."""
    model, parts = transfer.team_model(urdf, ROBOT, mend)
    assert [model.joint(k).name for k in range(1, 13)] == transfer.NAMES, "the left leg first"
    data, feet = mujoco.MjData(model), [model.body(parts[k]).id for k in (6, 12)]
    published = robot_model.rotation(np.array([0, 0 if mend else -transfer.MISTAKE]), 0, 0)
    for joints in np.random.default_rng(0).uniform(-0.3, 0.6, (20, 12)):
        data.qpos[7:] = joints
        mujoco.mj_kinematics(model, data)
        points, turn = robot_model.leg_points(ROBOT, joints.reshape(2, 6))
        close(data.xpos[feet] - data.qpos[:3], points[:, 2] + ROBOT.hips)
        close(data.xmat[feet].reshape(2, 3, 3), turn @ published, "as published: rolled")
    close(model.jnt_range[1:12], np.tile([-1.5, 2.0], (11, 1)), "limits turn with signs and zeros")


def test_the_team_s_model_has_our_motors_and_touches_with_its_cleats(urdf):
    model, parts = transfer.team_model(urdf, ROBOT)
    ours = robot_model.mujoco_model(ROBOT)
    for name in transfer.OURS:
        close(getattr(model, name), getattr(ours, name), name)
    assert model.npair == 8 and not (model.geom_contype | model.geom_conaffinity).any()
    close(model.body("base_link").mass, 3.2, "arms are part of the torso")
    simulator = transfer.TeamSim(urdf, True, "mujoco", 1, robot_model.stance(ROBOT), ROBOT, 1)
    body = env.Spread().draw([np.random.default_rng(0)], ROBOT)
    simulator.reset([0], body)
    masses = simulator.models[0].body_mass[simulator.parts] / model.body_mass[simulator.parts]
    close(masses[[5, 6, 11, 12]], body.mass[0, [4, 4, 8, 8]], "a foot of theirs is two bodies")
    motion = standing(simulator, 100)
    simulator.close()
    assert not motion.fell[0] and abs(motion.torso[0, -1, 2] - simulator.standing[0][2]) < 0.01


@pytest.mark.parametrize("text, reason", [
    (None, "no URDF .*No such file"),
    ("<robot", "no URDF"),
    ('<robot><joint name="hip"/></robot>', "another robot, it has no joint LAnklePitch"),
], ids=str)  # fmt: skip
def test_a_file_of_another_robot_is_one_line(tmp_path, text, reason):
    path = tmp_path / "robot.urdf"
    if text:
        path.write_text(text)
    with pytest.raises(robot_model.InputError, match=f"robot.urdf: {reason}") as stopped:
        common.main("transfer", ["--mujoco", "--urdf", str(path), "--out", str(tmp_path)])
    assert len(str(stopped.value).splitlines()) == 1


@pytest.mark.parametrize("part", ["bullet", "urdf", "before"])
def test_what_was_not_given_is_left_out_in_words(part, tmp_path, capsys):
    common.main("transfer", ["--mujoco", "--only", part, "--out", str(tmp_path)])
    assert f"left out: --{part}" in capsys.readouterr().out
    assert not [*tmp_path.iterdir()]


def test_without_pybullet_one_line_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    with pytest.raises(robot_model.InputError, match="python -m pip install .*pybullet==3.2.7"):
        bullet.BulletSim("mujoco", 1, robot_model.stance(ROBOT), ROBOT)


def test_rows_compare_the_same_goals_and_become_table_words_and_figure():
    args, cases = Namespace(sim="mujoco", walks=1), {transfer.OWN: {}, "again": {}}
    rows = transfer.measure(args, cases)
    own, again = (common.pick(rows, case=case) for case in cases)
    for row, other in zip(own, again):
        assert other["far_over_own"] == pytest.approx(1) and row["far_time_mean"] > 0
        close(other["far_policy_over"], own[0]["far_time_mean"] / row["far_time_mean"])
    found = {"zeros": {"rows": rows}}
    figure = transfer.plot(found, "mujoco")
    assert [text.get_text() for text in figure.axes[0].get_yticklabels()] == [*cases]
    robot_model.plt.close(figure)
    assert "again" in transfer.table(found, "mujoco")
    assert "pairs" in transfer.found({"mujoco": found})["expert"]


def test_an_older_policy_walks_on_the_robot_of_its_training(monkeypatch, capsys):
    worlds = []
    monkeypatch.setattr(transfer, "measure", lambda args, cases, planners: worlds.append(cases))
    transfer.study_before(Namespace(before=POLICY, urdf=None, sim="mujoco"))
    (world,) = worlds[0].values()
    with common.world("mujoco", num_robots=1, **world) as one:
        evaluate.load_policy(POLICY, one)
    assert "another" not in capsys.readouterr().out, "no note of a difference"


def test_the_robot_of_a_file_walks():
    settings = evaluate.names_in(OP3)
    with common.world("mujoco", num_robots=4, noise=False, cores=1, **settings) as world:
        close(sum(world.simulator.model.body_mass), 3.15, "kg", atol=0.01)
        for _ in range(6):
            result = world.step([world.neutral_action] * 4, np.arange(4))
        assert not result["fall"].any()


def test_the_search_for_a_walk_takes_another_robot(monkeypatch):
    own, seen = evaluate.names_in(OP3), []

    def measure(sim, parameters, seed, **world):
        seen.append((parameters, world))

    monkeypatch.setattr(walk, "measure", measure)
    monkeypatch.setattr(walk, "score", lambda sim, measured: 0.0)
    monkeypatch.setattr(walk, "in_words", str)
    monkeypatch.setattr(walk, "SIZES", (2, 9, 3))
    walk.tune("mujoco", 0, **own)
    low, high = 0.65 * np.array(walk.SEARCH["trunk_height"])
    for parameters, world in seen:
        assert world == {"robot": own["robot"], "limits": own["limits"]}
        assert low <= parameters.trunk_height <= high, "ranges are as long as its legs"
    assert seen[0][0] == own["walk"], "it begins at the walk of the file"


@pytest.mark.parametrize("flags, reason", [
    (["--robot", str(OP3)], "--robot goes with --tune"),
    (["--tune", "--robot", str(ROOT / "LICENSE")], "LICENSE: no such .py file"),
    (["--tune", "--robot", str(ROOT / "tests" / "checks.py")], "checks.py: defines no LIMITS"),
], ids=str)  # fmt: skip
def test_a_robot_that_cannot_be_used_is_one_line(flags, reason, tmp_path):
    with pytest.raises(robot_model.InputError, match=reason):
        walk.main(["--mujoco", "--out", str(tmp_path), *flags])


# ------------------------------------------------------------------------ PyBullet
absent = find_spec("pybullet") is None
needs_pybullet = pytest.mark.skipif(absent, reason=f"PyBullet is not installed: {bullet.PIP}")


@needs_pybullet
@pytest.mark.slow
def test_another_engine_walks_the_same_walks():
    """Four walks of stage 2: in PyBullet they end where they end in MuJoCo, nearly."""
    plans = [[double_step] * 8 for double_step in walk_engine.WALKS.values()]
    tuned, body = walk_engine.TUNED["mujoco"], robot_model.Body.as_model(ROBOT, 4)
    heights = []

    def watch(engine, motion):
        heights.append(motion.torso[:, 0, 2])

    run = partial(walk_engine.walk_plans, "mujoco", tuned, plans, simulate=bullet.BulletSim)
    poses, _, fall = run(body, watch=watch)
    assert (fall == 8).all(), "nobody falls"
    close(heights[0], tuned.trunk_height, "they stand on the floor, and do not fall onto it", 0.003)
    ours, _, _ = run(body, simulate=robot_model.make_sim)
    error = np.abs(poses[:, -1] - ours[:, -1])
    assert (error < [0.15, 0.15, 0.35]).all(), error
    close(run(body)[0], poses, "the same again")
    slippery = replace(body, friction=np.full(4, 0.05))
    assert np.abs(run(slippery)[0][0, -1, 0] - poses[0, -1, 0]) > 0.2, "its own floor"
    late = replace(body, delay=np.ones(4, int))
    assert np.abs(run(late)[0] - poses).max() > 0.005, "delay"


@needs_pybullet
@pytest.mark.slow
def test_pybullet_has_our_masses_motors_and_pushes():
    simulator = bullet.BulletSim("mujoco", 3, robot_model.stance(ROBOT), ROBOT)
    body = env.Spread(com=0.02).draw([np.random.default_rng(k) for k in range(3)], ROBOT)
    simulator.reset(np.arange(3), body)
    model = simulator.models[1]
    for k, name in (-1, "torso"), (1, "left hip"), (3, "left shin"), (11, "right foot"):
        mass, friction, inertia, centre, *_ = simulator.worlds[1].getDynamicsInfo(bullet.ROBOT, k)
        close([mass, friction], [*model.body(name).mass, body.friction[1]], name)
        close(centre, model.body(name).ipos, name)
        rotor = [0, 0, 0] if k < 0 else ROBOT.armature * model.jnt_axis[1 + k]
        close(inertia, model.body(name).inertia + rotor, name)
    for force, way in (0, 0), (60, 0.0385):
        simulator.reset(np.arange(3), robot_model.Body.as_model(ROBOT, 3))
        moved = standing(simulator, 30, force).torso[:, -1, 1]
        close(moved, [0, way, 0], "only one is pushed, as far as in MuJoCo", 0.004)
    simulator.close()


@needs_pybullet
@pytest.mark.slow
def test_the_policy_arrives_in_another_engine():
    policy = common.shipped("mujoco")
    with common.world("mujoco", num_robots=12, simulate=bullet.BulletSim) as world:
        ended = common.walks(policy, world, far=True, first=transfer.SEED)
    assert (ended["outcome"] == "success").sum() >= 11
