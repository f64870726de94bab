"""Hard to break: bodies, surroundings and ends of a process that nobody would wish for."""

import io
import json
import os
import signal
import subprocess
import sys
import textwrap
import types
import warnings
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

robot_model = import_module("01_robot_model")
env = import_module("03_env")
ROOT = Path(__file__).resolve().parents[1]

def started(folder, *arguments, **environment):
    """A Python script in a process of its own: what it says and its exit code."""
    return subprocess.run([sys.executable, *map(str, arguments)], cwd=folder, check=False,
                          capture_output=True, encoding="utf-8", errors="replace", timeout=120,
                          env=os.environ | {"PYTHONPATH": str(ROOT)} | environment)


# ------------------------------------------------------------------------ bodies
EXTREME = {
    "no friction": {"friction": 0.0}, "friction 2": {"friction": 2.0},
    "no motors": {"torque_limit": (0.1,) * 6},
    "stiff": {"stiffness": 6000.0, "planar_gain": 800.0},
    "no gravity": {"gravity": 0.0}, "coarse time": {"control_dt": 0.04},
}

@pytest.mark.parametrize("sim", ["pymunk", "mujoco"])
@pytest.mark.parametrize("extreme", EXTREME)
def test_an_extreme_body_falls_and_nothing_else_happens(sim, extreme, capfd, tmp_path, monkeypatch):
    """Nothing is raised, warned of, written or not finite. More with STEPS=1000 python -m pytest …
    """
    monkeypatch.chdir(tmp_path)
    robot = replace(robot_model.RobotModel(), **EXTREME[extreme])
    envs = env.FootstepVectorEnv(8, sim, noise=True, imu=True, robot=robot, cores=1)
    dice = np.random.default_rng(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        envs.reset(seed=0)
        for _ in range(int(os.environ.get("STEPS", "8"))):
            seen, reward, *_ = envs.step(dice.random((8, 6)))
            assert np.isfinite(reward).all() and envs.observation_space.contains(seen)
            assert np.isfinite(envs.world.pose).all() and np.isfinite(envs.world.tilt).all()
    envs.close()
    assert capfd.readouterr() == ("", ""), "a simulator wrote to the terminal"
    assert not list(tmp_path.iterdir()), "a simulator wrote a file"


# ------------------------------------------------------------------------ surroundings
@pytest.mark.slow
def test_a_bare_surrounding_is_enough(tmp_path):
    """No HOME, a backend without its display, a read-only folder."""
    folder = tmp_path / "read only"
    folder.mkdir()
    folder.chmod(0o555)
    kept = {name: os.environ[name] for name in ("PATH", "SYSTEMROOT", "LD_LIBRARY_PATH")
            if name in os.environ}
    done = subprocess.run(
        [sys.executable, ROOT / "02_walk_engine.py", "--out", tmp_path / "out"], cwd=folder,
        capture_output=True, encoding="utf-8", errors="replace", check=False,
        env=kept | {"MPLBACKEND": "TkAgg", "LC_ALL": "C"})
    assert done.returncode == 0 and "a left turn" in done.stdout, done.stderr[-2000:]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "02_plan.png", "02_walk.png"] and not list(folder.iterdir())

def test_letters_that_a_console_does_not_have_are_replaced(monkeypatch):
    """As by a pipe on Windows."""
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BytesIO(), "ascii"))
    robot_model.StageParser("").parse([])
    print("α ± μ", flush=True)
    assert sys.stdout.buffer.getvalue().split() == [b"?"] * 3

def test_a_console_without_an_encoding_or_none_at_all_is_enough(monkeypatch):
    """As in a notebook; and `python 04_ppo.py 2>&-`, or pythonw."""
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    monkeypatch.setattr(sys, "stderr", None)
    assert robot_model.StageParser("").parse([]).sim == "pymunk"

@pytest.mark.parametrize("error, said", [
    (KeyboardInterrupt(), "interrupted"), (BrokenProcessPool("a process died"), "a process died")])
def test_what_a_stage_cannot_help_is_one_line(error, said, monkeypatch, capsys):
    def main():
        raise error

    monkeypatch.setattr(sys, "argv", ["folder/stage.py"])
    with pytest.raises(SystemExit) as stopped:
        robot_model.run(main)
    assert (stopped.value.code, capsys.readouterr().err) == (2, f"\nstage.py: {said}\n")

def test_an_error_of_somebody_s_code_keeps_its_traceback():
    with pytest.raises(FileNotFoundError):
        robot_model.run(lambda: open("no such file"))


# ------------------------------------------------------------------------ ends
@pytest.fixture(scope="module")
def two_processes(tmp_path_factory):
    """Two planar robots in two processes that a script has started; and a file of that script."""
    script = tmp_path_factory.mktemp("a script") / "mine.py"
    script.write_text("from pathlib import Path\nPath(__file__).with_name('loaded').touch()")
    main = types.ModuleType("__main__")
    main.__file__ = str(script)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "__main__", main)
        envs = env.FootstepVectorEnv(2, cores=2)
    envs.reset(seed=0)
    yield envs, script.with_name("loaded")
    envs.close()

def test_processes_of_the_simulator_do_not_load_the_script_that_started_them(two_processes):
    assert not two_processes[1].exists(), "it may need seconds, and a guard below `if __name__`"

@pytest.mark.skipif(sys.platform == "win32", reason="no process can be sent Ctrl-C alone there")
def test_ctrl_c_does_not_end_the_processes_of_the_simulator(two_processes):
    """The terminal sends it to them, too; what ends them is the stage."""
    envs, _ = two_processes
    for pool in envs.world.sim.pools:
        for process in pool._processes.values():
            os.kill(process.pid, signal.SIGINT)
    assert np.isfinite(envs.step(np.full((2, 6), 0.5))[1]).all()

def test_a_closed_environment_may_be_closed_again_and_walks_no_more(two_processes):
    """It is the last test with these two."""
    envs, _ = two_processes
    for close in (envs.close, envs.close, envs.world.close):
        close()
    with pytest.raises(RuntimeError, match="shutdown"):
        envs.step(np.full((2, 6), 0.5))

KILLED = """
    import os, signal, sys
    from importlib import import_module
    ppo, env = import_module("04_ppo"), import_module("03_env")
    out, number = ppo.Path(sys.argv[1]), int(sys.argv[2])

    def train(resume=False):
        cfg = ppo.PPOConfig(num_envs=4, rollout=8, epochs=2, minibatch=16, checkpoint_every=2,
                            unsettled=0)
        ppo.train(cfg, lambda n: env.FootstepVectorEnv(n, "pymunk", True, cores=1), out, 20 * 32,
                  seed=5, resume=resume)

    def dying(function, when, write=False):
        calls = []

        def call(*args, **kw):
            calls.append(1)
            if len(calls) < when:
                return function(*args, **kw)
            if write:  # in the middle of a file
                path, content = args
                temporary = path.with_name(f"{path.stem}.{os.getpid()}.tmp{path.suffix}")
                content(temporary)
                whole = temporary.read_bytes()
                temporary.write_bytes(whole[: len(whole) // 2])
            os.kill(os.getpid(), signal.SIGKILL)
        return call

    if number >= 0:
        phase, when = (("collect", 3), ("improve", 3), ("atomic_write", 2), ("collect", 1),
                       ("atomic_write", 1))[number % 5]
        when += 1
        owner = ppo.robot_model if phase == "atomic_write" else ppo
        setattr(owner, phase, dying(getattr(owner, phase), when, owner is not ppo))
    train(resume=(out / "checkpoint.pt").exists())
"""

@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no kill -9 here")
def test_five_kills_change_no_weight(tmp_path):
    """kill -9 while collecting, improving and writing; then the weights of the quiet training."""
    torch = import_module("04_ppo").torch
    script = tmp_path / "train.py"
    script.write_text(textwrap.dedent(KILLED), encoding="utf-8")
    quiet, killed = tmp_path / "quiet", tmp_path / "killed"
    for folder in (quiet, killed):
        folder.mkdir()
    assert started(tmp_path, script, quiet, -1).returncode == 0
    for number in range(5):
        done = started(tmp_path, script, killed, number)
        assert done.returncode == -signal.SIGKILL, done.stderr[-2000:]
        for file in {*killed.glob("*.pt")} - {*killed.glob("*.tmp.pt")}:
            torch.load(file, weights_only=True)  # whole: the old one or the new one
    last = started(tmp_path, script, killed, -1)
    assert last.returncode == 0, last.stderr[-2000:]
    one, other = (torch.load(folder / "policy.pt", weights_only=True)["state_dict"]
                  for folder in (quiet, killed))
    assert all(torch.equal(one[name], other[name]) for name in one), "not bit for bit"


# ------------------------------------------------------------------------ files
def fails(path):
    """Half of it is written when the disk is full."""
    path.write_text("hal")
    raise OSError(28, "No space left on device")

def stops(path):
    path.write_text("hal")
    raise KeyboardInterrupt

@pytest.mark.parametrize("write", [fails, stops])
def test_a_file_that_could_not_be_finished_damages_nothing(write, tmp_path):
    path = tmp_path / "policy.pt"
    path.write_text("the good one")
    with pytest.raises((OSError, KeyboardInterrupt)):
        robot_model.atomic_write(path, write)
    assert path.read_text() == "the good one"
    assert list(tmp_path.iterdir()) == [path], "what could not be finished takes no place"

def test_two_trainings_may_write_into_one_folder(tmp_path, monkeypatch):
    """Each has temporary files of its own: whoever is last wins, and the file is whole."""
    path = tmp_path / "policy.pt"

    def first(temporary):
        temporary.write_text("first")
        with monkeypatch.context() as patch:
            patch.setattr(os, "getpid", lambda: -1)  # another process, meanwhile
            robot_model.atomic_write(path, lambda other: other.write_text("second"))

    robot_model.atomic_write(path, first)
    assert path.read_text() == "first" and list(tmp_path.iterdir()) == [path]

def test_every_figure_is_written_atomically():
    for path in [*ROOT.glob("0*.py"), *(ROOT / "tests" / "studies").glob("*.py")]:
        for line in path.read_text(encoding="utf-8").splitlines():
            if "savefig(" in line or ".save(" in line and "torch" not in line:
                assert "lambda file: " in line, f"{path.name}: not by atomic_write: {line.strip()}"

def test_results_are_json_without_nan():
    """What others read: no NaN, no Infinity, in any of our JSON files."""
    for path in (ROOT / "results").rglob("*.json"):
        json.loads(path.read_text(encoding="utf-8"), parse_constant=lambda word: pytest.fail(word))
