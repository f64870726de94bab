"""Hard to break: bodies, consoles and ends of a process that nobody would wish for."""

import io
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from checks import BOTH
from sheet import ROOT
from tqdm import tqdm

robot_model = import_module("01_robot_model")
env = import_module("03_env")
EXTREME = {"no friction": {"friction": 0.0}, "no motors": {"torque_limit": (0.1,) * 6}}


@pytest.mark.filterwarnings("error")
@BOTH
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
        assert np.isfinite(envs.world.pose).all() and np.isfinite(envs.world.imu).all()
    envs.close()
    assert capfd.readouterr() == ("", ""), "a simulator wrote to the terminal"
    assert not list(tmp_path.iterdir()), "a simulator wrote a file"


def test_what_a_stage_cannot_help_is_one_line(monkeypatch, capsys):
    errors = [
        KeyboardInterrupt(),
        BrokenProcessPool("a process died"),
        robot_model.InputError("no such file"),
        io.UnsupportedOperation(),  # an OSError and a ValueError
    ]

    def main():
        raise errors.pop(0)

    monkeypatch.setattr(sys, "argv", ["folder/stage.py"])
    for said in ("interrupted", "a process died", "no such file"):
        with pytest.raises(SystemExit) as stopped:
            robot_model.start(main)
        assert (stopped.value.code, capsys.readouterr().err) == (2, f"\nstage.py: {said}\n")
    with pytest.raises(io.UnsupportedOperation):  # an error of somebody's code keeps its traceback
        robot_model.start(main)


def children_since(before):
    return [child for child in multiprocessing.active_children() if child not in before]


@pytest.mark.parametrize("console", [io.TextIOWrapper(io.BytesIO(), "ascii"), None])
def test_any_console_is_enough(monkeypatch, console):
    """A pipe on Windows has few letters; pythonw has neither stdout nor stderr."""
    monkeypatch.setattr(sys, "stdout", console)
    monkeypatch.setattr(sys, "stderr", console)
    robot_model.start(lambda: print("α ± μ", tqdm([1]), flush=True))
    assert not console or b"? ? ?" in console.buffer.getvalue()


def test_a_stage_leaves_the_figures_of_a_notebook_alone():
    code = """
import os, matplotlib
matplotlib.use("svg")
__import__("01_robot_model")
assert matplotlib.get_backend() == "svg"
"""
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_processes_of_the_simulator_survive_ctrl_c_and_end_when_closed():
    before = multiprocessing.active_children()
    envs = env.FootstepVectorEnv(2, cores=2)
    envs.reset(seed=0)
    if sys.platform != "win32":  # no process can be sent Ctrl-C alone there
        for process in children_since(before):
            os.kill(process.pid, signal.SIGINT)  # as the terminal does
    assert np.isfinite(envs.step(np.full((2, 6), 0.5))[1]).all()
    for close in (envs.close, envs.close, envs.world.close):  # again is harmless
        close()
    assert not children_since(before)
    with pytest.raises(RuntimeError, match="shutdown"):
        envs.step(np.full((2, 6), 0.5))


SERVER = """
import multiprocessing, threading, time
from importlib import import_module
env = import_module("03_env")
def make():
    world = env.FootstepWorld(2, cores=2)
    print(*[child.pid for child in multiprocessing.active_children()], flush=True)
    time.sleep(60)
if __name__ == "__main__":
    thread = threading.Thread(target=make)
    thread.start()
    thread.join()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGKILL")
def test_no_process_of_the_simulator_outlives_a_killed_parent(tmp_path):
    """Also made in a thread, as by a server."""
    script = tmp_path / "mine.py"
    script.write_text(SERVER, "utf-8")
    with subprocess.Popen(
        [sys.executable, script],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    ) as process:
        pids = [int(pid) for pid in process.stdout.readline().split()]
        process.kill()
    assert len(pids) == 2, "both processes have started"

    def alive(pid):
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return False
        state = Path(f"/proc/{pid}/stat")  # a zombie has ended, too
        return not (state.exists() and state.read_text().split()[2] == "Z")

    end = time.monotonic() + 2
    while time.monotonic() < end and any(map(alive, pids)):
        time.sleep(0.05)
    assert not any(map(alive, pids)), "they live on"


def test_who_stops_reading_gets_no_traceback():
    command = f'"{sys.executable}" -u -c "{READ_ON}" | head -n 1'
    done = subprocess.run(command, shell=True, cwd=ROOT, capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("0\n", "")


READ_ON = "import importlib as i; i.import_module('01_robot_model').start(lambda: [print(k) for k in range(10**5)])"


def test_two_trainings_that_write_one_file_leave_a_whole_one(tmp_path):
    """Each has temporary files of its own; test_04_ppo has a training that is killed."""
    path = tmp_path / "policy.pt"

    def first(temporary):
        temporary.write_text("first")
        with mock.patch("os.getpid", return_value=-1):  # another process, meanwhile
            robot_model.atomic_write(path, lambda other: other.write_text("second"))

    robot_model.atomic_write(path, first)
    assert path.read_text() == "first", "who is last wins, and the file is whole"


def test_a_user_s_settings_of_matplotlib_do_not_rule_the_figures():
    with robot_model.plt.rc_context({"text.usetex": True}):
        robot_model.start(lambda: None)
        assert not robot_model.plt.rcParams["text.usetex"]
