"""Every stage from the command line: one small run from end to end, and what happens to wrong
values. These tests say that the scripts work together; the other files say why."""

import json
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = ("01_robot_model.py", "02_walk_engine.py", "03_env.py", "04_ppo.py", "05_evaluate.py")


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


def check_picture(path):
    """The file is a picture with something drawn in it."""
    image = matplotlib.image.imread(path)
    assert min(image.shape[:2]) > 100, f"{path.name} is only {image.shape} pixels"
    assert image[..., :3].std() > 0.01, f"{path.name} is empty"


@pytest.mark.parametrize("script, flags, pictures, text", [
    ("01_robot_model.py", [], ["01_robot.png"], "64 of 64 fell"),
    ("01_robot_model.py", ["--mujoco"], ["01_robot.png"], "64 of 64 fell"),
    ("02_walk_engine.py", [], ["02_plan.png", "02_walk.png"], "forward"),
    ("02_walk_engine.py", ["--mujoco"], ["02_plan.png", "02_walk.png"], "forward"),
    ("03_env.py", [], ["03_rewards.png"], "hand-written"),
    ("03_env.py", ["--mujoco", "--imu"], ["03_rewards.png"], "torso roll"),
], ids=lambda value: " ".join(value) if isinstance(value, list) else str(value))
def test_demonstrations_of_the_first_stages(tmp_path, script, flags, pictures, text):
    out = tmp_path / "a new" / "folder"
    shown = succeeds(script, *flags, "--out", out, folder=tmp_path)
    assert text in shown, f"{script} should print {text!r}:\n{shown}"
    assert sorted(path.name for path in out.iterdir()) == pictures, "exactly what was promised"
    for name in pictures:
        check_picture(out / name)
    assert [path.name for path in tmp_path.iterdir()] == ["a new"], "nothing outside of --out"


def test_default_folder_is_runs_and_the_simulator(tmp_path):
    succeeds("02_walk_engine.py", folder=tmp_path)
    assert (tmp_path / "runs" / "pymunk" / "02_walk.png").exists()


def test_train_a_little_in_mujoco(tmp_path):
    """In this process: an update of 04_ppo.py with its own settings takes a while."""
    ppo, env = import_module("04_ppo"), import_module("03_env")
    small = ppo.PPOConfig(num_envs=4, rollout=16, minibatch=32, epochs=2)
    _, rows = ppo.train(small, lambda n: env.FootstepVectorEnv(n, "mujoco", noise=True, imu=True),
                        tmp_path, 128, progress=False, fits=env.fingerprint("mujoco", True))
    assert rows[-1]["steps"] == 128
    model, meta = ppo.load_policy(tmp_path / "policy.pt")
    assert meta["fits"]["simulator"] == "mujoco" and len(meta["fits"]["observation"]) == 25
    action = model.decide(env.FootstepVectorEnv(2, "mujoco", imu=True).reset(seed=0)[0])
    neutral = env.to_action(np.zeros((2, 3)), env.walk_engine.LIMITS["mujoco"])
    np.testing.assert_allclose(action, [neutral, neutral], atol=0.1, err_msg=(
        "a policy that knows nothing yet should step on the spot"))


def test_train_a_little_then_evaluate(tmp_path):
    train, result = tmp_path / "train", tmp_path / "result"
    succeeds("04_ppo.py", "--steps", 256, "--seed", 1, "--out", train, folder=tmp_path)
    assert len((train / "learning_curve.csv").read_text().splitlines()) >= 2, "head and a row"
    check_picture(train / "learning_curve.png")
    policy = train / "policy.pt"
    assert policy.stat().st_size > 1000
    arguments = ["--episodes", 4, "--policy", policy, "--out", result]
    shown = succeeds("05_evaluate.py", *arguments, folder=tmp_path)
    evaluation = json.loads((result / "evaluation.json").read_text())
    assert evaluation["sim"] == "pymunk"
    assert len(evaluation["rows"]) >= 2, "the learned planner and the baseline"
    assert "baseline" in shown and "baseline" in (result / "table.md").read_text()
    trials = (result / "trials.csv").read_text().splitlines()
    assert len(trials) == 1 + 4 * len(evaluation["rows"]), "a row per planner and goal"
    check_picture(result / "footsteps.png")
    # The policy of one simulator is refused by the other.
    wrong = run("05_evaluate.py", "--mujoco", *arguments, folder=tmp_path)
    one_clear_line(wrong, "05_evaluate.py --mujoco")
    assert "pymunk" in wrong.stderr and "mujoco" in wrong.stderr


def one_clear_line(done, what):
    """Exit code 2 and one line on stderr, that is not a traceback."""
    lines = done.stderr.strip().splitlines()
    assert done.returncode == 2, f"{what}: exit code {done.returncode}\n{done.stderr}"
    assert len(lines) == 1 and "Traceback" not in lines[0], f"{what}:\n{done.stderr}"
    assert len(lines[0]) > 15, f"{what}: say what to do, not only {lines[0]!r}"


@pytest.mark.parametrize("script", SCRIPTS)
@pytest.mark.parametrize("arguments, mention", [
    (["--seed", "-1"], "seed"), (["--seed", "many"], "many"), (["--out", "a_file/sub"], "a_file"),
    (["--out", "a_file"], "a_file"), (["--no-such-flag"], "--no-such-flag"),
    (["unexpected"], "unexpected")], ids=lambda value: " ".join(value))
def test_wrong_values_get_one_clear_line(tmp_path, monkeypatch, capfd, script, arguments, mention):
    (tmp_path / "a_file").write_text("not a folder")
    monkeypatch.chdir(tmp_path)
    if script == "05_evaluate.py" and "--out" in arguments:
        arguments = [*arguments, "--tune-baseline"]  # otherwise it asks for a policy first
    monkeypatch.setattr(sys, "argv", [script, *arguments])
    with pytest.raises(SystemExit) as caught:  # in this process: starting 30 of them takes long
        import_module(script.removesuffix(".py")).main()
    message = capfd.readouterr().err
    done = subprocess.CompletedProcess(arguments, caught.value.code, "", message)
    one_clear_line(done, f"{script} {' '.join(arguments)}")
    assert mention in message, f"name the value that is wrong: {message!r}"
    assert [path.name for path in tmp_path.iterdir()] == ["a_file"], "wrong values write nothing"


@pytest.mark.parametrize("script", SCRIPTS)
def test_wrong_values_end_the_process_with_code_2(tmp_path, script):
    (tmp_path / "a_file").write_text("not a folder")
    one_clear_line(run(script, "--out", "a_file/sub", folder=tmp_path), f"{script} --out")


@pytest.mark.parametrize("script", SCRIPTS)
def test_help_names_every_flag(tmp_path, script):
    text = succeeds(script, "--help", folder=tmp_path)
    for flag in ("--mujoco", "--seed", "--out"):
        assert flag in text, f"{script} has the same flags as the other stages"
    assert not list(tmp_path.iterdir()), "--help writes nothing"
