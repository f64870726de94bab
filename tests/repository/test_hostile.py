"""Hard to break: bodies, consoles and ends of a process that nobody would wish for."""

import contextlib
import io
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from importlib import import_module
from unittest import mock

import numpy as np
import pytest
from checks import BOTH, locked
from sheet import ROOT
from test_workbook import run
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
        robot_model.InputError("no such file"),
        io.UnsupportedOperation(),  # an OSError and a ValueError
    ]

    def main():
        raise errors.pop(0)

    monkeypatch.setattr(sys, "argv", ["folder/stage.py"])
    for said in ("interrupted", "no such file"):
        with pytest.raises(SystemExit) as stopped:
            robot_model.start(main)
        assert (stopped.value.code, capsys.readouterr().err) == (2, f"\nstage.py: {said}\n")
    with pytest.raises(io.UnsupportedOperation):  # an error of somebody's code keeps its traceback
        robot_model.start(main)


class Plain(io.TextIOBase):
    """Like the stdout of a notebook or of IDLE: no `reconfigure`, no file behind it."""

    def __init__(self):
        self.text = ""

    def write(self, text):
        self.text += text
        return len(text)


@pytest.mark.parametrize(
    "console", [io.TextIOWrapper(io.BytesIO(), "ascii"), Plain(), None], ids=str
)
def test_any_console_is_enough(monkeypatch, console):
    """A pipe on Windows has few letters; pythonw has neither stdout nor stderr."""
    monkeypatch.setattr(sys, "stdout", console)
    monkeypatch.setattr(sys, "stderr", console)
    robot_model.start(lambda: print("α ± μ", tqdm([1]), flush=True))
    if isinstance(console, Plain):
        assert "α ± μ" in console.text
    elif console:
        assert b"? ? ?" in console.buffer.getvalue()


NOTEBOOK = """
import matplotlib
matplotlib.use("svg")
from matplotlib import pyplot as plt
plt.rcParams["figure.dpi"] = 77
start = __import__("01_robot_model").start
assert matplotlib.get_backend() == "svg" and not plt.rcParams["axes.grid"], "the import"
def main():
    assert matplotlib.get_backend() == "agg" and plt.rcParams["axes.grid"]
    assert plt.rcParams["figure.dpi"] == 100, "a user's settings do not rule our figures"
plt.figure()
start(main)
assert matplotlib.get_backend() == "svg" and plt.rcParams["figure.dpi"] == 77, "the start"
assert plt.get_fignums() == [1]
"""


def test_a_stage_leaves_the_figures_of_a_notebook_alone():
    done = run("-c", NOTEBOOK)
    assert done.returncode == 0, done.stderr


UNGUARDED = """
import sys
from importlib import import_module
env, walk = import_module("03_env"), import_module("02_walk_engine")
world = env.FootstepWorld(64, cores=2)
world.step([world.neutral_action] * 64, range(64))
env.FootstepVectorEnv(64, noise=True).reset(seed=0)
walk.walk_plans("pymunk", walk.TUNED["pymunk"], [[walk.WALKS["forward"]] * 2] * 64)
print("walked")
"""


@pytest.mark.parametrize("place", ["file", "standard input"])
def test_a_script_needs_no_main_guard(tmp_path, place):
    (tmp_path / "mine.py").write_text(UNGUARDED)
    done = subprocess.run(
        [sys.executable, "mine.py" if place == "file" else "-"],
        input=None if place == "file" else UNGUARDED,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert (done.stdout, done.stderr) == ("walked\n", "")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
def test_a_world_in_a_forked_process_says_so_and_does_not_hang():
    code = """
import multiprocessing
from importlib import import_module
world = import_module("03_env").FootstepWorld(2, "mujoco", cores=2)
def walk():
    try:
        world.step([world.neutral_action] * 2, [0, 1])
    except RuntimeError as error:
        print(error, flush=True)
child = multiprocessing.get_context("fork").Process(target=walk)
child.start()
child.join(30)
assert child.exitcode == 0, "it hangs"
"""
    done = run("-c", code)
    said = "this world was made in another process: make one in this process\n"
    assert (done.returncode, done.stdout) == (0, said), done.stderr


def test_ctrl_c_while_memory_is_freed_comes_a_moment_later(capsys):
    # An exception in here would be ignored, as a destructor calls it.
    source = "def freebody(): signal.raise_signal(signal.SIGINT); came.append('here')"
    names = {"signal": signal, "came": []}
    exec(compile(source, "pymunk/body.py", "exec"), names)

    def main():
        names["freebody"]()
        time.sleep(10)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    with contextlib.ExitStack() as stack:
        stack.callback(signal.signal, signal.SIGINT, before)
        with pytest.raises(SystemExit):
            robot_model.start(main)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler, "a notebook's own"
    assert names["came"] and "interrupted" in capsys.readouterr().err


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


@pytest.mark.parametrize("times, kept", [(2, "new"), (3, "old")])
def test_a_file_that_another_program_holds_is_tried_again_and_then_one_line(tmp_path, times, kept):
    """On Windows a file that is open, in Excel or a virus scanner, cannot be replaced. (The line:
    `test_04_ppo.a_file_that_cannot`.)"""
    path = tmp_path / "trials.csv"
    path.write_text("old")
    with locked("trials.csv", times), contextlib.suppress(robot_model.InputError):
        robot_model.write_text(path, "new")
    assert path.read_text() == kept and [*tmp_path.iterdir()] == [path], "nothing half, no rest"
