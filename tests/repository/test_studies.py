"""The studies' own tools, with answers that are known; the studies themselves take hours."""

import itertools
import math
import runpy
import signal
import subprocess
import sys
import time
from argparse import Namespace
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import ablations
import baseline
import common
import kicks
import numpy as np
import pytest
import seeds
import walk
from test_01_robot_model import mujoco_at  # pytest asserts in it, too

robot_model, walk_engine = common.robot_model, common.walk_engine
env, ppo, evaluate, torch = common.env, common.ppo, common.evaluate, common.ppo.torch
equal, close = np.testing.assert_array_equal, np.testing.assert_allclose
ROBOT, LIMITS = robot_model.RobotModel(), env.LIMITS["pymunk"]


@pytest.fixture(autouse=True)
def one_process(monkeypatch):
    monkeypatch.setattr(robot_model, "CORES", 1)


@pytest.mark.parametrize("name", common.STUDIES)
def test_every_study_says_its_question_and_then_its_duration(name, capsys, monkeypatch, tmp_path):
    study, flag = import_module(name), "--limits" if name == "walk" else "--mujoco"
    assert "?" in study.__doc__.splitlines()[0], "the first line is the question it answers"
    assert f"python tests/studies/{name}.py" in study.__doc__
    part, *_ = study.PARTS
    monkeypatch.setitem(study.PARTS, part, lambda args: {"rows": []})
    monkeypatch.setattr(study, "table", lambda found, sim: "a table\n")
    monkeypatch.setattr(study, "plot", lambda found, sim: None, raising=False)
    monkeypatch.setattr(robot_model, "save_figure", lambda figure, path: path.write_text("it"))
    main = getattr(study, "main", partial(common.main, name))
    main([flag, "--out", str(tmp_path), *["--only", part] * (len(study.PARTS) > 1)])
    assert capsys.readouterr().out.splitlines()[0].endswith(f": {study.DURATION}")
    files = {path.name for path in tmp_path.iterdir()}
    assert files == {f"{name}.json", f"{name}.md", f"{name}.png"}


def test_a_part_is_written_before_the_next_one_and_leaves_the_others(tmp_path):
    parts = {"one": lambda args: {"rows": [1, (2, 3)]}, "two": lambda args: 1 / 0}
    study = SimpleNamespace(__name__="both", PARTS=parts, table=lambda found, sim: f"{found}\n")
    (tmp_path / "both.json").write_text('{"two": {"rows": []}}', encoding="utf-8")
    with pytest.raises(ZeroDivisionError):
        for part in parts:
            common.publish(study, part, Namespace(sim="pymunk", out=tmp_path))
    found = common.read_json(tmp_path / "both.json")
    assert found == {"two": {"rows": []}, "one": {"rows": [1, [2, 3]]}}
    assert (tmp_path / "both.md").read_text(encoding="utf-8") == f"{found}\n", "as from the file"


@pytest.mark.parametrize(
    "path",
    sorted(common.RESULTS.glob("*/studies/*.json")),
    ids=lambda path: f"{path.parts[-3]}-{path.stem}",
)
def test_the_shipped_table_is_that_of_the_shipped_numbers(path):
    study, sim, found = import_module(path.stem), path.parts[-3], common.read_json(path)
    assert study.table(found, sim) == path.with_suffix(".md").read_text(encoding="utf-8")
    if hasattr(study, "plot") and path.stem != "walk" and [*study.PARTS][0] in found:
        figure = study.plot(found, sim)
        assert all(axes.lines for axes in figure.axes)
        robot_model.plt.close(figure)


def test_a_finished_training_of_the_ablations_is_not_made_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(ablations, "judged", lambda *_: {"success": 0.5})
    trained = []
    monkeypatch.setattr(ablations, "learn", lambda *job, **more: trained.append(job))
    rows = [ablations.ablate("pymunk", "reference", 1) for _ in range(2)]
    assert rows == [{"variant": "reference", "seed": 1, "success": 0.5}] * 2 and len(trained) == 1


def test_a_damaged_file_of_a_study_is_one_line(tmp_path):
    (tmp_path / "seeds.json").write_text('{"rows": [')
    with pytest.raises(robot_model.InputError, match="seeds.json: damaged .*delete it"):
        common.read_json(tmp_path / "seeds.json")


def test_help_of_common_writes_no_page(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["common.py", "--help"])
    monkeypatch.setattr(evaluate, "write_text", pytest.fail)
    with pytest.raises(SystemExit) as stopped:
        runpy.run_path(common.__file__, run_name="__main__")
    assert stopped.value.code == 0 and "usage" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no process can be sent Ctrl-C alone there")
def test_ctrl_c_stops_the_ablations_with_their_workers(tmp_path):
    script = Path(ablations.__file__)
    command = [sys.executable, script, "--only", "ablations", "--out", tmp_path]
    signal.signal(signal.SIGINT, signal.default_int_handler)  # in the background, too
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as process:
        begun = tmp_path / "runs" / "pymunk" / "studies" / "ablations"
        end = time.monotonic() + 60
        while time.monotonic() < end and not [*begun.rglob("checkpoint.pt")]:
            time.sleep(0.2)  # until a training has made an update
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=20)[1]
    assert process.returncode == 2 and "ablations.py: interrupted" in said, said[-2000:]
    before = {path: path.stat().st_mtime_ns for path in begun.rglob("*")}
    time.sleep(4)
    assert before == {path: path.stat().st_mtime_ns for path in begun.rglob("*")}, "it trains on"


def test_walks_are_those_of_stage_05_set_by_set(monkeypatch):
    monkeypatch.setattr(common, "PER_SET", 3)
    planner, short = evaluate.BaselinePlanner(), replace(env.Task(), time_limit=2.6)  # [s]
    with common.world("pymunk", task=short) as world:
        both = common.walks(planner, world, sets=2, first=5)
        second = evaluate.evaluate(planner, world, evaluate.draw_trials(6, 3))
        tuning = common.walks(planner, world, sets=1, first=5, purpose="tuning", per_set=2)
    assert len(both["time"]) == 6 and len(tuning["time"]) == 2
    for name in second:
        equal(both[name][3:], second[name], err_msg=name)
    assert not np.isclose(tuning["friction"], both["friction"][:2]).any(), "other worlds"
    with common.world("pymunk", num_robots=2, **kicks.ground(1.2)) as world:
        world.reset([0, 1])
        assert world.noise and (world.friction == 1.2).all(), "friction is what was asked for"


def test_the_median_seed_is_neither_the_best_nor_the_worst():
    rows = [
        {"seed": seed, "success": success, "time_mean": time}
        for seed, success, time in ((0, 1.0, 5.0), (1, 1.0, 6.0), (2, 0.9, None))
    ]
    assert seeds.median_seed(rows) == 1, "by success first; then the slower one is the worse one"


def test_slow_noise_is_as_large_and_stays():
    robots, zero, std = np.arange(400), np.zeros((400, 3)), np.full(3, 0.05)
    world = kicks.SlowNoise(400, "pymunk", noise=True, cores=1)
    world.reset(robots, [np.random.default_rng([0, i]) for i in robots])
    seen = [world.noisy(env.NOISE, zero, robots, std) for world.steps[:] in range(12)]
    world.steps[:] = 0
    anew = world.noisy(env.NOISE, zero, robots, std)
    world.close()
    close(np.std(seen, (1, 2)), 0.05, rtol=0.08, err_msg="also the first")
    for one, other, want in (
        (seen[:-1], seen[1:], 0.9),
        (seen[:-5], seen[5:], 0.9**5),
        (seen[-1], anew, 0),
    ):
        assert np.corrcoef(np.ravel(one), np.ravel(other))[0, 1] == pytest.approx(want, abs=0.1)


def test_gaussian_policy_is_a_normal_distribution_around_the_first_action():
    first, obs = np.array([0.2, 0.5, 0.8]), torch.zeros(100, 4)
    torch.manual_seed(0)
    model = ablations.GaussianActor(4, 3, (8, 8), first, 10.0)
    close(model.decide(obs), np.tile(first, (100, 1)), atol=0.02)
    std = (4 * 11) ** -0.5  # of a Beta with mean 0.5, α + β = 10
    action = model.sample(obs)
    assert action.shape == (100, 3) and action.min() < 0, "it may leave [0, 1], unlike the Beta"
    z = (action.numpy() - first) / std  # Σ (−z²/2 − ln(σ·√(2π)))
    log_prob = model.policy(obs).log_prob(action)
    want = (-(z**2) / 2 - np.log(std * np.sqrt(2 * np.pi))).sum(1)
    close(log_prob.detach().numpy(), want, atol=0.1)
    log_prob.sum().backward()  # d/d ln σ = z² − 1: σ is learned, too
    close(model.log_std.grad, (z**2 - 1).sum(0), atol=1.0)
    model.sharpness = 4.0  # p(x)^k ∝ exp(−k·z²/2)
    sharp = model.policy(obs).stddev[0].detach()
    close(sharp, std / 2, rtol=1e-4, err_msg="it must sharpen like the Beta")
    model.actor[-1].bias.data += 0.4
    close(model.decide(obs)[0], [0.6, 0.9, 1.0], atol=0.02, err_msg="clipped")


def test_soles_are_where_mujoco_has_them():
    rng = np.random.default_rng(5)
    torso = rng.uniform([-1, -1, 0.3, -0.5, -0.5, -3], [1, 1, 0.5, 0.5, 0.5, 3], (40, 6))
    low, high = (0.5 * np.tile(limit, 2) for limit in (ROBOT.joint_min, ROBOT.joint_max))
    joints = rng.uniform(low, high, (40, 12))
    ankle, lowest = walk.soles(ROBOT, torso, joints)  # [40, 2, 3], [40, 2]
    corners = np.array([*itertools.product((-1, 1), (-1, 1), [-1])])  # of the underside
    for i in range(40):
        model, data = mujoco_at(torso[i], joints[i])
        for foot, side in enumerate(("left", "right")):
            close(ankle[i, foot], data.body(f"{side} foot").xpos, atol=1e-9)
            sole = data.geom(f"{side} sole")
            placed = sole.xpos + corners * model.geom(sole.id).size @ sole.xmat.reshape(3, 3).T
            assert lowest[i, foot] == pytest.approx(placed[:, 2].min(), abs=1e-9), (
                f"{side}: the sole is beside its ankle, outward; its lowest corner counts"
            )


def test_clearance_is_that_of_the_swinging_foot_and_slip_that_of_the_other():
    """Robots that follow their plan, but 4 mm too high and drifting 1 mm ahead per tick."""
    p = replace(
        walk_engine.TUNED["mujoco"], half_ticks=30, double_support=1 / 3, foot_rise=0.04
    )  # the swing: 20 of 30 ticks
    engine = walk_engine.WalkEngine(2, p)
    plan, _ = engine.plan([[[0.08, 0, 0], [0.08, 0, 0]]] * 2, [0, 1])
    torso = plan.trunk[:, 1:].copy()
    torso[..., 0] += 0.001 * np.arange(torso.shape[1])
    torso[..., 2] += 0.004
    torso[1, :, 2] = -1  # whoever fell has no clearance
    fell = np.array([False, True])
    motion = robot_model.Motion(torso, plan.joints[:, 1:], None, fell)
    clearance, slip = walk.clearance_and_slip(engine, motion)
    # At 30 and at 70 % of its swing the foot is up by s(0.6) of its rise, minimum jerk.
    want = 0.04 * (10 * 0.6**3 - 15 * 0.6**4 + 6 * 0.6**5) + 0.004
    close(np.ravel(clearance), want, atol=1e-9, err_msg="the lowest amid a swing")
    close(np.ravel(slip), 0.019, atol=1e-9, err_msg="19 ticks of drift while the other swings")


def test_the_cross_entropy_method_draws_nearer_to_the_best():
    optimum, seen = np.array([0.3, 0.7]), []

    def costs(iteration, drawn):
        seen.append(drawn)
        return np.linalg.norm(drawn - optimum, axis=1)

    start, rng = np.array([0.5, 0.5]), np.random.default_rng(0)
    found = common.cross_entropy(costs, start, 0.1, (15, 28, 7), rng, 0.0, 1.0)
    close(found, optimum, atol=0.03)
    assert np.shape(seen) == (15, 28, 2) and 0 <= np.min(seen) and np.max(seen) <= 1
    best = seen[0][np.linalg.norm(seen[0] - optimum, axis=1).argsort()[:7]]
    close(seen[1][0], 0.3 * start + 0.7 * best.mean(0), err_msg="towards the best quarter")


def test_the_shipped_share_of_falls_is_that_within_the_limits():
    for sim, limits in env.LIMITS.items():
        found = common.read_json(common.RESULTS / sim / "studies" / "walk.json")["limits"]
        for title, (_, second, _) in walk.MAPS.items():
            inside = walk.allowed(walk.cells(title, walk.X, second), limits)
            falls = np.array(found[title]["falls"])[inside]
            assert falls.mean() == pytest.approx(found[title]["fall_inside"], abs=1e-4), title


def test_tuning_chooses_the_fastest_safe_setting_that_stays():
    paper = {"fall": 0.0, "time": 20.0, "still_there": 0.98}
    rows = [
        paper | {"time": 9.0},
        paper | {"time": 8.0, "fall": 0.005},
        paper | {"time": 7.0, "fall": 0.006},
        paper | {"time": 6.0, "still_there": 0.969},
        paper | {"time": None, "still_there": None},
    ]
    best = baseline.choose(rows, paper)[0]
    assert best is rows[1], "fastest of those with at most 0.5 % falls that stay"
    safe, rule = baseline.choose(rows[2:4], paper)
    assert safe is rows[3] and "none" in rule, "none of the safe ones stays: the fastest of them"


def test_tuning_tries_all_settings_of_planners_that_use_them(monkeypatch):
    tried, row = [], {"time": 7.0, "fall": 0.0, "timeout": 0.0, "still_there": 1.0}
    monkeypatch.setattr(baseline, "both", lambda world, values, *_: tried.append(values))
    monkeypatch.setattr(baseline, "facts", lambda ended: row)
    baseline.optimise(None, tuple, baseline.START, row)
    assert tried[0] == baseline.START
    assert all(len(set(values)) > 100 for values in zip(*tried)), "one is not tuned"
    planner = baseline.tuned_of(tried[1])
    assert vars(planner.settings) == dict(zip(baseline.TUNED, tried[1])) | {"share": True}
    world = env.FootstepWorld(1, cores=1)
    world.reset([0], goals=[[1.0, 1.0, 1.0]])
    seen, actions = world.look([0]), []
    world.close()
    for values in (tried[1], tried[2]):
        planner = baseline.expert_of(values)
        planner.reset(1)
        actions.append(planner.act(seen))
    assert (actions[0] != actions[1]).any()


def test_the_least_time_by_hand():
    world = SimpleNamespace(
        task=env.Task(),
        limits=LIMITS,
        engine=SimpleNamespace(period=0.6, beside=np.array([[0, 0.18, 0], [0, -0.18, 0]])),
    )
    # Seen from the other foot, a foot lands 0.18 m ahead, 0.18 + 0.15 m aside, 0.6 rad outward.
    way = 2 * (0.18 * math.cos(0.3) + 0.33 * math.sin(0.3))  # [m] of a double step, toes out
    turn = 0.60 + 0.40  # [rad]
    goals = [
        [0.04, 0, 0],
        [3 * way + 0.04, 0, 0],
        [0, 3 * way + 0.06, 0],
        [0, 0, 2 * turn + 0.17],
        [0, 0, -2 * turn - 0.18],
        [0, -way - 0.06, 2 * turn + 0.18],
    ]
    close(
        seeds.least_time(np.array(goals), world),
        0.6 * np.array([1, 3, 4, 2, 3, 3]),
        err_msg=("to the edge of the tolerance, 5 cm and 10°, in whole double steps; at least one"),
    )
