"""Hard to break: bodies, consoles and ends of a process that nobody would wish for."""

import io
import json
import os
import signal
import sys
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

robot_model = import_module("01_robot_model")
env = import_module("03_env")
ROOT = Path(__file__).resolve().parents[1]
EXTREME = {
    "no friction": {"friction": 0.0},
    "friction 2": {"friction": 2.0},
    "no motors": {"torque_limit": (0.1,) * 6},
    "stiff": {"stiffness": 6000.0, "planar_gain": 800.0},
    "no gravity": {"gravity": 0.0},
    "coarse time": {"control_dt": 0.04},
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("sim", ["pymunk", "mujoco"])
@pytest.mark.parametrize("extreme", EXTREME)
def test_an_extreme_body_falls_and_nothing_else_happens(sim, extreme, capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    robot = replace(robot_model.RobotModel(), **EXTREME[extreme])
    envs = env.FootstepVectorEnv(8, sim, noise=True, imu=True, robot=robot, cores=1)
    dice = np.random.default_rng(0)
    envs.reset(seed=0)
    for _ in range(8):
        seen, reward, *_ = envs.step(dice.random((8, 6)))
        assert np.isfinite(reward).all() and envs.observation_space.contains(seen)
        assert np.isfinite(envs.world.pose).all() and np.isfinite(envs.world.tilt).all()
    envs.close()
    assert capfd.readouterr() == ("", ""), "a simulator wrote to the terminal"
    assert not list(tmp_path.iterdir()), "a simulator wrote a file"


def test_any_console_is_enough(monkeypatch):
    """A pipe on Windows has few letters. A notebook has no encoding; pythonw has no stderr."""
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BytesIO(), "ascii"))
    robot_model.StageParser("").parse([])
    print("α ± μ", flush=True)
    assert sys.stdout.buffer.getvalue().split() == [b"?"] * 3
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    monkeypatch.setattr(sys, "stderr", None)
    assert robot_model.StageParser("").parse([]).sim == "pymunk"


def test_what_a_stage_cannot_help_is_one_line(monkeypatch, capsys):
    errors = [KeyboardInterrupt(), BrokenProcessPool("a process died"), FileNotFoundError()]

    def main():
        raise errors.pop(0)

    monkeypatch.setattr(sys, "argv", ["folder/stage.py"])
    for said in ("interrupted", "a process died"):
        with pytest.raises(SystemExit) as stopped:
            robot_model.run(main)
        assert (stopped.value.code, capsys.readouterr().err) == (2, f"\nstage.py: {said}\n")
    with pytest.raises(FileNotFoundError):  # an error of somebody's code keeps its traceback
        robot_model.run(main)


def test_processes_of_the_simulator_survive_ctrl_c_and_end_when_closed(tmp_path, monkeypatch):
    script = tmp_path / "mine.py"
    script.write_text("from pathlib import Path\nPath(__file__).with_name('loaded').touch()")
    monkeypatch.setattr(sys.modules["__main__"], "__file__", str(script))
    monkeypatch.setattr(sys.modules["__main__"], "__spec__", None)
    envs = env.FootstepVectorEnv(2, cores=2)
    envs.reset(seed=0)
    assert not (tmp_path / "loaded").exists(), "it may need seconds, or a guard: `if __name__ …`"
    if sys.platform != "win32":  # no process can be sent Ctrl-C alone there
        for pool in envs.world.sim.pools:
            for process in pool._processes.values():
                os.kill(process.pid, signal.SIGINT)  # as the terminal does
    assert np.isfinite(envs.step(np.full((2, 6), 0.5))[1]).all()
    for close in (envs.close, envs.close, envs.world.close):  # again is harmless
        close()
    with pytest.raises(RuntimeError, match="shutdown"):
        envs.step(np.full((2, 6), 0.5))


def test_two_trainings_that_write_one_file_leave_a_whole_one(tmp_path):
    """Each has temporary files of its own; test_ppo has a training that is killed."""
    path = tmp_path / "policy.pt"

    def first(temporary):
        temporary.write_text("first")
        with mock.patch("os.getpid", return_value=-1):  # another process, meanwhile
            robot_model.atomic_write(path, lambda other: other.write_text("second"))

    robot_model.atomic_write(path, first)
    assert path.read_text() == "first", "who is last wins, and the file is whole"


def test_results_are_json_without_nan():
    for path in (ROOT / "results").rglob("*.json"):
        json.loads(path.read_text(encoding="utf-8"), parse_constant=pytest.fail)
