"""Every stage from the command line: one small run from end to end, its figures, and what happens
to wrong values. These tests say that the scripts work together; the other files say why."""

import csv
import json
import os
import re
import subprocess
import sys
from functools import partial
from importlib import import_module
from pathlib import Path

import matplotlib.image
import matplotlib.pyplot as plt
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
FLAGS = {  # beside --help, --mujoco, --seed and --out, which every stage has
    "01_robot_model.py": [],
    "02_walk_engine.py": [],
    "03_env.py": [],
    "04_ppo.py": ["--imu", "--noise", "--no-noise", "--steps", "--quick", "--resume", "--env",
                  "--gamma"],
    "05_evaluate.py": ["--noise", "--far", "--goals", "--episodes", "--friction", "--policy",
                       "--planner", "--gif", "--play"],
}
SCRIPTS = tuple(FLAGS)

def run(script, *arguments, folder):
    """Run a stage in its own process, as a student does; no display or renderer is needed."""
    command = [sys.executable, str(ROOT / script), *map(str, arguments)]
    return subprocess.run(command, cwd=folder, capture_output=True, encoding="utf-8", check=False,
                          timeout=240, env=os.environ | {
                              "PYTHONUTF8": "1", "MPLBACKEND": "TkAgg", "MUJOCO_GL": "none"})

def succeeds(script, *arguments, folder):
    """The output of a run that must end well."""
    done = run(script, *arguments, folder=folder)
    assert done.returncode == 0, f"{script} {arguments} failed:\n{done.stdout}\n{done.stderr}"
    assert "Traceback" not in done.stderr, done.stderr
    return done.stdout


# ------------------------------------------------------------------------ figures
def check_picture(path):
    """The file is a picture with something drawn in it: frames, letters and grids have no colour.

    Half a percent is more than legends have (0.1 %) and less than any figure here (1 %).
    """
    image = matplotlib.image.imread(path)
    assert min(image.shape[:2]) > 100, f"{path} is only {image.shape} pixels"
    coloured = (np.ptp(image[..., :3], axis=-1) > 0.25).mean()
    assert coloured > 0.005, f"{path}: only {coloured:.2%} of it has a colour: are the axes empty?"

def test_empty_axes_are_no_picture(tmp_path):
    figure, panels = plt.subplots(1, 3, figsize=(12, 3.6))
    for axis in panels:
        axis.set(title="a title", xlabel="time [s]", ylabel="height [m]")
        axis.grid()
        for name in ("left foot", "right foot", "trunk"):
            axis.plot([], [], label=name)
        axis.legend()
    figure.savefig(tmp_path / "empty.png")
    with pytest.raises(AssertionError, match="are the axes empty"):
        check_picture(tmp_path / "empty.png")
    panels[1].bar([0, 1], [1, 2])
    figure.savefig(tmp_path / "full.png")
    plt.close(figure)
    check_picture(tmp_path / "full.png")


# ------------------------------------------------------------------------ small runs
@pytest.mark.slow
def test_demonstration_of_the_first_stage(tmp_path):
    out = tmp_path / "a new" / "folder"
    shown = succeeds("01_robot_model.py", "--out", out, folder=tmp_path)
    assert "of 64 fell" in shown and "01_robot.png" in shown, shown
    assert [path.name for path in out.iterdir()] == ["01_robot.png"], "as its docstring says"
    check_picture(out / "01_robot.png")
    assert [path.name for path in tmp_path.iterdir()] == ["a new"], "nothing outside of --out"

def main_of(script, monkeypatch, *arguments):
    """The stage's main in this process: starting one takes seconds."""
    monkeypatch.setattr(sys, "argv", [script, *map(str, arguments)])
    return import_module(script.removesuffix(".py")).main()

@pytest.mark.slow
def test_default_folder_is_runs_and_the_simulator(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(import_module("01_robot_model"), "CORES", 1)
    main_of("02_walk_engine.py", monkeypatch)
    main_of("01_robot_model.py", monkeypatch, "--mujoco")
    for name in ("pymunk/02_plan.png", "pymunk/02_walk.png", "mujoco/01_robot.png"):
        check_picture(tmp_path / "runs" / name)

@pytest.mark.slow
def test_demonstration_of_the_third_stage(tmp_path, monkeypatch, capsys):
    """Of 4 instead of 64 robots."""
    env = import_module("03_env")
    four = env.FootstepVectorEnv(4, cores=1)
    monkeypatch.setattr(env, "FootstepVectorEnv", lambda count, sim: four)
    main_of("03_env.py", monkeypatch, "--out", tmp_path)
    shown = capsys.readouterr().out
    for name, *_ in env.observation_table():
        assert name in shown, f"the table of the observation lacks {name}"
    found = re.findall(r"(random|hand-written) *: (\d+) episodes at the goal, (\d+) falls", shown)
    (_, _, wild), (_, goals, _) = found
    assert int(goals) > 0 and int(wild) > 0 and "03_rewards.png" in shown
    check_picture(tmp_path / "03_rewards.png")

class Enough(Exception):
    """Nothing has to walk in the next two tests."""

def test_leaning_robots_are_drawn_by_the_seed(tmp_path, monkeypatch):
    robot_model, leans = import_module("01_robot_model"), []

    def run(sim, trajectory, robots):
        leans.append(trajectory.joints[:, -1, 4])  # [N] the left ankle's pitch
        raise Enough

    monkeypatch.setattr(robot_model.MujocoSim, "run", run)
    for seed in (1, 2):
        with pytest.raises(Enough):
            main_of("01_robot_model.py", monkeypatch, "--mujoco", "--seed", seed, "--out", tmp_path)
    assert len(np.unique(leans)) == 2 * 64, "--seed does nothing"

def test_another_seed_of_the_third_stage_draws_other_robots(tmp_path, monkeypatch):
    env, seeds = import_module("03_env"), []

    def reset(envs, seed):
        seeds.append(seed)
        raise Enough

    monkeypatch.setattr(env.FootstepVectorEnv, "reset", reset)
    for seed in (0, 1):
        with pytest.raises(Enough):
            main_of("03_env.py", monkeypatch, "--mujoco", "--seed", seed, "--out", tmp_path)
    assert seeds[1] - seeds[0] >= 64, "robot i has the seed + i, so 63 of 64 would be the same"

@pytest.mark.slow
def test_train_a_little_in_mujoco(tmp_path):
    """In this process: an update of 04_ppo.py with its own settings takes a while."""
    ppo, env = import_module("04_ppo"), import_module("03_env")
    small = ppo.PPOConfig(num_envs=8, rollout=8, minibatch=32, epochs=2)
    task = env.Task(time_limit=2.0)  # three double steps, so that many episodes end
    _, rows = ppo.train(
        small, lambda n: env.FootstepVectorEnv(n, "mujoco", noise=True, imu=True, task=task),
        tmp_path, 12 * 64, about={"fits": env.fingerprint("mujoco", True)})
    assert [row["steps"] for row in rows] == [64 * (i + 1) for i in range(12)]
    assert any(row["timeout"] > 0 for row in rows), "episodes have ended, and nobody counted them"
    model, meta = ppo.load_policy(tmp_path / "policy.pt")
    assert meta["fits"]["simulator"] == "mujoco" and len(meta["fits"]["observation"]) == 25
    action = model.decide(env.FootstepVectorEnv(2, "mujoco", imu=True).reset(seed=0)[0])
    neutral = env.to_action(np.zeros((2, 3)), env.LIMITS["mujoco"])
    np.testing.assert_allclose(action, [neutral, neutral], atol=0.15, err_msg=(
        "a policy that knows hardly anything yet should step on the spot"))
    ppo.plot_learning_curve(rows, tmp_path / "learning_curve.png", "a little training")
    check_picture(tmp_path / "learning_curve.png")

@pytest.mark.slow
def test_train_a_little_then_evaluate(tmp_path, monkeypatch, capsys):
    """04 in this process, with few robots; 05 on all cores in another one, then on one in this."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(import_module("01_robot_model"), "CORES", 1)
    ppo, evaluate, train = import_module("04_ppo"), import_module("05_evaluate"), Path("train")
    small = partial(ppo.PPOConfig, num_envs=8, rollout=8, minibatch=32)
    monkeypatch.setattr(ppo, "PPOConfig", small)
    main_of("04_ppo.py", monkeypatch, "--steps", 256, "--seed", 1, "--out", train)
    shown = capsys.readouterr().out
    with open(train / "learning_curve.csv", encoding="utf-8") as file:
        assert [row["steps"] for row in csv.DictReader(file)] == ["64", "128", "192", "256"]
    policy = train / "policy.pt"
    assert f'python 05_evaluate.py --noise --policy "{policy}"' in shown, "say how to go on"
    assert min(path.stat().st_size for path in train.iterdir()) > 100
    (tmp_path / "goals.csv").write_text("x,y,yaw\n0,0,0\n0.01,0,0.05\n0,-0.01,-0.05\n0,0,0.1\n")
    (tmp_path / "mine.py").write_text(  # the figure shows it: the policy would need 100 s
        "from importlib import import_module\n"
        "evaluate = import_module('05_evaluate')\n"
        "def Planner(): return evaluate.BaselinePlanner(evaluate.TUNED['pymunk'])\n")
    arguments = ["--noise", "--policy", policy, "--planner", "mine.py", "--goals", "goals.csv",
                 "--out"]
    shown = succeeds("05_evaluate.py", *arguments, tmp_path / "one", folder=tmp_path)
    evaluation = json.loads((tmp_path / "one/evaluation.json").read_text(encoding="utf-8"))
    assert evaluation["sim"] == "pymunk" and evaluation["goals"] == "goals.csv"
    assert evaluation["policy"]["seed"] == 1 and evaluation["policy"]["file"] == policy.as_posix()
    assert all(row["episodes"] == 4 for row in evaluation["rows"])
    assert (tmp_path / "one/table.md").read_text(encoding="utf-8") in shown
    check_picture(tmp_path / "one/footsteps.png")
    monkeypatch.setattr(evaluate, "FIGURE_GOALS", np.zeros((2, 3)))  # quickly: it has been drawn
    monkeypatch.setattr(evaluate, "plot_footsteps", lambda *_: None)
    monkeypatch.setattr(sys, "path", sys.path[:])
    main_of("05_evaluate.py", monkeypatch, *arguments, tmp_path / "two")
    for name in ("evaluation.json", "trials.csv", "table.md"):
        one, two = ((tmp_path / out / name).read_text(encoding="utf-8") for out in ("one", "two"))
        assert one == two, f"{name}: the same seed gives the same numbers, whatever the cores"
    assert not list(tmp_path.rglob("*.tmp*")), "a temporary file was left behind"


# ------------------------------------------------------------------------ flags
def one_clear_line(code, errors, what):
    """Exit code 2 and one line on stderr, that is not a traceback."""
    lines = errors.strip().splitlines()
    assert code == 2, f"{what}: exit code {code}\n{errors}"
    assert len(lines) == 1 and "Traceback" not in lines[0], f"{what}:\n{errors}"
    assert len(lines[0]) > 15, f"{what}: say what to do, not only {lines[0]!r}"

WRONG = (
    ("01_robot_model.py", "--seed -1", "seed"),
    ("01_robot_model.py", f"--seed {2**32}", str(2**32)),
    ("02_walk_engine.py", "--seed many", "many"),
    ("02_walk_engine.py", "--no-such-flag", "--no-such-flag"),
    ("03_env.py", "unexpected", "unexpected"),
    ("03_env.py", "--out a_file", "a_file"),
    ("04_ppo.py", "--out a_file/sub", "a_file"),
    ("04_ppo.py", "--steps 1.5", "1.5"),
    ("04_ppo.py", "--env Pendulum-v1 --imu", "--env"),
    ("04_ppo.py", "--env Pendulum-v1 --resume", "--env"),
    ("05_evaluate.py", "--episodes 0", "--episodes from 1"),
    ("05_evaluate.py", "--episodes 10001", "to 10000"),
    ("05_evaluate.py", "--friction -0.1", "--friction"),
    ("05_evaluate.py", "--friction ice", "'ice'"),
    ("05_evaluate.py", "--goals a_file --far", "--far"))

@pytest.mark.parametrize("script, arguments, mention", WRONG)
def test_wrong_values_get_one_clear_line(tmp_path, monkeypatch, capfd, script, arguments, mention):
    (tmp_path / "a_file").write_text("not a folder")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as caught:
        main_of(script, monkeypatch, *arguments.split())
    message = capfd.readouterr().err
    one_clear_line(caught.value.code, message, f"{script} {arguments}")
    assert message.startswith(f"{script}: "), "say who complains"
    assert mention in message, f"name the value that is wrong: {message!r}"
    assert [path.name for path in tmp_path.iterdir()] == ["a_file"], "wrong values write nothing"

@pytest.mark.slow
def test_wrong_values_end_the_process_with_code_2(tmp_path):
    done = run("04_ppo.py", "--env", "No-such-v0", folder=tmp_path)
    one_clear_line(done.returncode, done.stderr, "04_ppo.py --env No-such-v0")

@pytest.mark.parametrize("script", SCRIPTS)
def test_help_names_every_flag(tmp_path, monkeypatch, capsys, script):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as caught:
        main_of(script, monkeypatch, "--help")
    assert caught.value.code == 0 and not list(tmp_path.iterdir()), "--help writes nothing"
    text = capsys.readouterr().out
    usage = text.split("\n\n")[0]
    assert set(re.findall(r"--[a-z-]+", usage)) == {"--mujoco", "--seed", "--out", *FLAGS[script]}
    question = import_module(script.removesuffix(".py")).__doc__.splitlines()[0]
    assert question in text, "--help begins with the question that the stage answers"

@pytest.mark.parametrize("script", SCRIPTS)
def test_commands_in_the_stages_exist(script):
    """Flags and files that the texts of a stage name are those that there are."""
    text = (ROOT / script).read_text(encoding="utf-8")
    commands = re.findall(r"python (0\d_\w+\.py)([^`\n]*)", text)
    assert commands, f"{script} does not say how to run it"
    for name, flags in commands:
        for flag in re.findall(r"--[a-z-]+", flags):
            known = {"--mujoco", "--seed", "--out", *FLAGS[name]}
            assert flag in known, f"{script} names `{name} {flag}`, which does not exist"
    for path in re.findall(r"tests/[\w/]+\.py", text):
        assert (ROOT / path).is_file(), f"{script} names {path}, which does not exist"
