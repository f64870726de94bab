"""Every stage from the command line: one small run from end to end, its figures, and what happens
to wrong values. These tests say that the scripts work together; the other files say why."""

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
    "02_walk_engine.py": ["--tune"],
    "03_env.py": ["--imu"],
    "04_ppo.py": ["--imu", "--noise", "--no-noise", "--steps", "--quick", "--resume", "--env"],
    "05_evaluate.py": ["--noise", "--episodes", "--goals", "--far", "--friction", "--policy",
                       "--imu", "--gif", "--planner", "--play"],
}
SCRIPTS = tuple(FLAGS)

def run(script, *arguments, folder):
    """Run a stage in its own process, as a student does."""
    command = [sys.executable, str(ROOT / script), *map(str, arguments)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=240,
                          env={**os.environ, "MPLBACKEND": "Agg"})

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

@pytest.mark.parametrize("legend", [False, True])
def test_empty_axes_are_no_picture(tmp_path, legend):
    figure, panels = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
    for axis in panels:
        axis.set(title="a title", xlabel="time [s]", ylabel="height [m]")
        axis.grid()
        if legend:
            for name in ("left foot", "right foot", "trunk"):
                axis.plot([], [], label=name)
            axis.legend()
    figure.savefig(tmp_path / "empty.png", dpi=110)
    with pytest.raises(AssertionError, match="are the axes empty"):
        check_picture(tmp_path / "empty.png")
    panels[0].plot([0, 1], [0, 1], color="tab:green", lw=5)
    panels[1].bar([0, 1], [1, 2])
    figure.savefig(tmp_path / "full.png", dpi=110)
    plt.close(figure)
    check_picture(tmp_path / "full.png")


# ------------------------------------------------------------------------ small runs
@pytest.mark.slow
@pytest.mark.parametrize("script, pictures, text", [
    ("01_robot_model.py", ["01_robot.png"], "of 64 fell"),
    ("02_walk_engine.py", ["02_plan.png", "02_walk.png"], "forward"),
    ("03_env.py", ["03_rewards.png"], "hand-written"),
])
def test_demonstrations_of_the_first_stages(tmp_path, script, pictures, text):
    out = tmp_path / "a new" / "folder"
    shown = succeeds(script, "--out", out, folder=tmp_path)
    assert text in shown, f"{script} should print {text!r}:\n{shown}"
    assert sorted(path.name for path in out.iterdir()) == pictures, "exactly what was promised"
    for name in pictures:
        assert name in shown, f"say where {name} is"
        check_picture(out / name)
    assert [path.name for path in tmp_path.iterdir()] == ["a new"], "nothing outside of --out"

def main_of(script, monkeypatch, *arguments):
    """The stage's main in this process: starting one takes seconds."""
    monkeypatch.setattr(sys, "argv", [script, *map(str, arguments)])
    return import_module(script.removesuffix(".py")).main()

@pytest.mark.slow
def test_default_folder_is_runs_and_the_simulator(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(import_module("01_robot_model"), "CORES", 1)
    for flags, sim in ([], "pymunk"), (["--mujoco"], "mujoco"):
        main_of("02_walk_engine.py", monkeypatch, *flags)
        for name in ("02_plan.png", "02_walk.png"):
            check_picture(tmp_path / "runs" / sim / name)

@pytest.mark.slow
def test_leaning_robots_are_drawn_by_the_seed(tmp_path, monkeypatch, capsys):
    shown = []
    for seed in (1, 2):
        main_of("01_robot_model.py", monkeypatch, "--mujoco", "--seed", seed, "--out", tmp_path)
        shown.append(capsys.readouterr().out)
    check_picture(tmp_path / "01_robot.png")
    assert shown[0] != shown[1], "--seed does nothing"

def test_demonstration_with_imu_in_mujoco(tmp_path, monkeypatch, capsys):
    """Without physics, which takes its time: the robots are where they should be."""
    robot_model = import_module("01_robot_model")

    def run(self, trajectory, robots):
        nothing = np.zeros((len(robots), 3))
        return robot_model.Motion(trajectory.trunk[:, 1:], trajectory.joints[:, 1:], nothing,
                                  nothing[:, 0] > 0)

    monkeypatch.setattr(robot_model.MujocoSim, "run", run)
    main_of("03_env.py", monkeypatch, "--mujoco", "--imu", "--out", tmp_path)
    shown = capsys.readouterr().out
    for name, *_ in import_module("03_env").observation_table(imu=True):
        assert name in shown, f"the table of the observation lacks {name}"
    assert "random" in shown and "hand-written" in shown
    check_picture(tmp_path / "03_rewards.png")

def test_tuning_prints_a_line_to_paste(tmp_path, monkeypatch, capsys):
    """Without the search itself, which takes minutes."""
    engine = import_module("02_walk_engine")
    asked = []
    monkeypatch.setattr(engine, "tune", lambda sim, seed: (
        asked.append((sim, seed)), engine.TUNED[sim])[1])
    main_of("02_walk_engine.py", monkeypatch, "--tune", "--mujoco", "--seed", 3, "--out", tmp_path)
    assert asked == [("mujoco", 3)]
    pasted = eval(capsys.readouterr().out, {"WalkParameters": engine.WalkParameters})
    assert pasted == engine.TUNED["mujoco"]

@pytest.mark.slow
def test_train_a_little_in_mujoco(tmp_path):
    """In this process: an update of 04_ppo.py with its own settings takes a while."""
    ppo, env = import_module("04_ppo"), import_module("03_env")
    small = ppo.PPOConfig(num_envs=8, rollout=8, minibatch=32, epochs=2)
    task = env.Task(time_limit=2.0)  # three double steps, so that many episodes end
    _, rows = ppo.train(
        small, lambda n: env.FootstepVectorEnv(n, "mujoco", noise=True, imu=True, task=task),
        tmp_path, 12 * 64, progress=False, about={"fits": env.fingerprint("mujoco", True)})
    assert [row["steps"] for row in rows] == [64 * (i + 1) for i in range(12)]
    assert any(row["timeout"] > 0 for row in rows), "episodes have ended, and nobody counted them"
    model, meta = ppo.load_policy(tmp_path / "policy.pt")
    assert meta["fits"]["simulator"] == "mujoco" and len(meta["fits"]["observation"]) == 25
    assert meta["steps"] == 768
    action = model.decide(env.FootstepVectorEnv(2, "mujoco", imu=True).reset(seed=0)[0])
    neutral = env.to_action(np.zeros((2, 3)), env.walk_engine.LIMITS["mujoco"])
    np.testing.assert_allclose(action, [neutral, neutral], atol=0.15, err_msg=(
        "a policy that knows hardly anything yet should step on the spot"))
    ppo.plot_learning_curve(rows, tmp_path / "learning_curve.png", "a little training")
    check_picture(tmp_path / "learning_curve.png")

def test_train_a_little_then_evaluate(tmp_path, monkeypatch, capsys):
    train, result = tmp_path / "train", tmp_path / "result"
    shown = succeeds("04_ppo.py", "--steps", 256, "--seed", 1, "--out", train, folder=tmp_path)
    assert len((train / "learning_curve.csv").read_text().splitlines()) >= 2, "head and a row"
    assert (train / "learning_curve.png").stat().st_size > 1000
    policy = train / "policy.pt"
    assert policy.stat().st_size > 1000
    assert f'python 05_evaluate.py --noise --policy "{policy}"' in shown, "say how to go on"
    (tmp_path / "goals.csv").write_text("x,y,yaw\n0,0,0\n0.3,0,0\n-0.3,0.2,1\n0.2,-0.1,-1\n")
    monkeypatch.chdir(tmp_path)
    env = import_module("03_env")
    short = {"task": env.Task(time_limit=5.0), "cores": 1}
    monkeypatch.setattr(env, "FootstepWorld", partial(env.FootstepWorld, **short))
    arguments = ["--goals", "goals.csv", "--policy", policy, "--out", result]
    main_of("05_evaluate.py", monkeypatch, *arguments)
    evaluation = json.loads((result / "evaluation.json").read_text(encoding="utf-8"))
    assert evaluation["sim"] == "pymunk" and evaluation["goals"] == "goals.csv"
    assert evaluation["policy"]["seed"] == 1 and evaluation["policy"]["file"] == policy.as_posix()
    assert [row["planner"] for row in evaluation["rows"]] == ["policy", "baseline"]
    assert all(row["episodes"] == 4 for row in evaluation["rows"])
    table = (result / "table.md").read_text(encoding="utf-8")
    assert table in capsys.readouterr().out and "baseline" in table
    trials = (result / "trials.csv").read_text(encoding="utf-8").splitlines()
    assert len(trials) == 1 + 4 * len(evaluation["rows"]), "a row per planner and goal"
    check_picture(result / "footsteps.png")
    # The policy of one simulator is refused by the other.
    with pytest.raises(SystemExit) as caught:
        main_of("05_evaluate.py", monkeypatch, "--mujoco", *arguments)
    wrong = capsys.readouterr().err
    one_clear_line(caught.value.code, wrong, "05_evaluate.py --mujoco")
    assert "pymunk" in wrong and "mujoco" in wrong


# ------------------------------------------------------------------------ flags
def one_clear_line(code, errors, what):
    """Exit code 2 and one line on stderr, that is not a traceback."""
    lines = errors.strip().splitlines()
    assert code == 2, f"{what}: exit code {code}\n{errors}"
    assert len(lines) == 1 and "Traceback" not in lines[0], f"{what}:\n{errors}"
    assert len(lines[0]) > 15, f"{what}: say what to do, not only {lines[0]!r}"

@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    """A policy file that fits, untrained: without one, 05 complains about that first."""
    ppo, env = import_module("04_ppo"), import_module("03_env")
    path = tmp_path_factory.mktemp("policy") / "policy.pt"
    model = ppo.ActorCritic(len(env.observation_table()), len(env.ACTION_NAMES))
    ppo.save_policy(path, model, {"fits": env.fingerprint("pymunk"), "config": {"sharpest": 4.0}})
    return path

WRONG = [(script, arguments, mention) for script in SCRIPTS for arguments, mention in (
    (["--seed", "-1"], "seed"), (["--seed", "many"], "many"), (["--out", "a_file/sub"], "a_file"),
    (["--out", "a_file"], "a_file"), (["--no-such-flag"], "--no-such-flag"),
    (["unexpected"], "unexpected"))]
WRONG += [("04_ppo.py", arguments, mention) for arguments, mention in (
    (["--steps", "0"], "steps"), (["--steps", "1.5"], "1.5"), (["--env", "No-such-v0"], "No-such"),
    (["--env", "CartPole-v1"], "CartPole"), (["--env", "Pendulum-v1", "--mujoco"], "--env"),
    (["--env", "Pendulum-v1", "--imu"], "--env"), (["--env", "Pendulum-v1", "--no-noise"], "--env"),
    (["--resume", "--out", "."], "checkpoint"))]
WRONG += [("05_evaluate.py", arguments, mention) for arguments, mention in (
    (["--episodes", "0"], "episodes"), (["--episodes", "10001"], "10001"),
    (["--goals", "a_file"], "a_file, line 1"),
    (["--goals", "a_file", "--episodes", "3"], "--episodes"), (["--policy", "a_file"], "a_file"),
    (["--policy", "a_file", "--imu"], "--policy"), (["--goals", "a_file", "--far"], "--far"),
    *((["--friction", mu], mention) for mu, mention in (
        ("-0.1", "from 0 to 100, not -0.1"), ("nan", "from 0 to 100, not nan"),
        ("100", "--friction from 0 to 100"), ("ice", "--friction: invalid float value: 'ice'"))))]

@pytest.mark.parametrize("script, arguments, mention", WRONG,
                         ids=[f"{script} {' '.join(flags)}" for script, flags, _ in WRONG])
def test_wrong_values_get_one_clear_line(tmp_path, monkeypatch, capfd, policy, script, arguments,
                                         mention):
    (tmp_path / "a_file").write_text("not a folder")
    monkeypatch.chdir(tmp_path)
    if script == "05_evaluate.py" and "--policy" not in arguments:
        arguments = [*arguments, "--policy", policy]
    with pytest.raises(SystemExit) as caught:  # in this process: starting 40 of them takes long
        main_of(script, monkeypatch, *arguments)
    message = capfd.readouterr().err
    one_clear_line(caught.value.code, message, f"{script} {arguments}")
    assert message.startswith(f"{script}: "), "say who complains"
    assert mention in message, f"name the value that is wrong: {message!r}"
    assert [path.name for path in tmp_path.iterdir()] == ["a_file"], "wrong values write nothing"

def test_wrong_values_end_the_process_with_code_2(tmp_path):
    done = run("04_ppo.py", "--env", "Hopper-v2", folder=tmp_path)  # Gymnasium warns, too
    one_clear_line(done.returncode, done.stderr, "04_ppo.py --env Hopper-v2")

@pytest.fixture
def help_of(tmp_path, monkeypatch, capsys):
    """What `--help` prints, of any stage, in an empty folder."""
    def ask(script):
        monkeypatch.chdir(tmp_path)
        with pytest.raises(SystemExit) as caught:
            main_of(script, monkeypatch, "--help")
        assert caught.value.code == 0
        assert not list(tmp_path.iterdir()), "--help writes nothing"
        return capsys.readouterr().out
    return ask

@pytest.mark.parametrize("script", SCRIPTS)
def test_help_names_every_flag(help_of, script):
    text = help_of(script)
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
