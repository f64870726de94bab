"""Hard to break: bodies, consoles, surroundings and ends of a process that nobody would wish for."""

import io
import multiprocessing
import os
import sys
from importlib import import_module
from unittest import mock

import matplotlib
import pytest
from checks import IN_3D_SLOW
from sheet import ROOT
from test_scripts import python
from tqdm import tqdm

env = import_module("03_env")
robot_model = env.robot_model


IMPOSSIBLE = """
import sys
from dataclasses import replace
from importlib import import_module

env = import_module("03_env")
model = env.robot_model
robot = model.RobotModel()
settings = [{"spread": env.Spread(mass=5.0)}]
for number in map(float, ("-1", "nan", "inf")):
    settings += (
        {"robot": replace(robot, foot=replace(robot.foot, mass=number))},
        {"robot": replace(robot, torso=replace(robot.torso, inertia=(number,) * 3))},
        {"robot": replace(robot, friction=number), "spread": env.Spread(friction=0.0)},
        {"robot": replace(robot, planar_iterations=number)},
    )
for setting in settings:
    try:
        env.FootstepVectorEnv(64, sys.argv[1], **setting).reset(seed=0)
    except (model.InputError, ValueError) as error:
        print(error)
print("alive")
"""


@IN_3D_SLOW
def test_an_impossible_body_ends_no_python(sim):
    """A failed assertion in C would take a notebook's memory with it."""
    done = python("-c", IMPOSSIBLE, sim)
    assert done.stdout.endswith("alive\n"), done.stdout + done.stderr


def test_what_a_stage_cannot_help_is_one_line(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["folder/stage.py"])
    with pytest.raises(SystemExit, match="2"):
        robot_model.run_script(mock.Mock(side_effect=KeyboardInterrupt))
    assert capsys.readouterr().err == "\nstage.py: interrupted\n"
    # It is an OSError and a ValueError: an error of somebody's code keeps its traceback.
    with pytest.raises(io.UnsupportedOperation):
        robot_model.run_script(mock.Mock(side_effect=io.UnsupportedOperation))


def test_any_console_is_enough(monkeypatch):
    """A pipe on Windows has few letters; stdout of a notebook or of IDLE has no `reconfigure`, and no
    file behind it."""
    pipe = io.BytesIO()
    for console in io.TextIOWrapper(pipe, "ascii"), io.StringIO():
        monkeypatch.setattr(sys, "stdout", console)
        monkeypatch.setattr(sys, "stderr", console)
        robot_model.run_script(lambda: print("α ± μ", tqdm([1]), flush=True))
    assert b"? ? ?" in pipe.getvalue() and "α ± μ" in console.getvalue()


JITTER = """
from importlib import import_module

def jittery(advance):
    return lambda self, robots, targets, *more: advance(self, robots, targets * (1 - 1e-9), *more)

for simulator in import_module("01_robot_model").SIMULATORS.values():
    simulator.advance = jittery(simulator.advance)
"""


@pytest.mark.slow
def test_no_verdict_about_a_robot_hangs_on_rounding(tmp_path):
    """Every joint target is off by a billionth. What is true of a robot is true then, too."""
    (tmp_path / "jitter.py").write_text(JITTER, "utf-8")
    files = (f"tests/test_0{path.name[1:]}" for path in sorted(ROOT.glob("0[123]_*.py")))
    done = python("-m", "pytest", "-q", "-p", "jitter", *files, PYTHONPATH=str(tmp_path))
    assert done.returncode == 0, f"give these tests a margin:\n{done.stdout}"


# ------------------------------------------------------------------------ notebooks
def test_a_stage_leaves_the_settings_of_a_notebook_alone():
    seen, before = [], dict(matplotlib.rcParams)
    robot_model.run_script(lambda: seen.append(matplotlib.rcParams["axes.grid"]))
    assert seen == [True] and dict(matplotlib.rcParams) == before


@pytest.mark.slow
def test_an_import_changes_nothing_in_its_surroundings():
    code = (
        "import os, torch; torch.set_num_threads(2); before = {**os.environ}; __import__('05_evaluate'); "
        "assert (os.environ, torch.get_num_threads()) == (before, 2)"
    )
    done = python("-c", code, MPLBACKEND="agg")
    assert done.returncode == 0, done.stderr


def walk_in_3d():
    envs = env.FootstepVectorEnv(4, "mujoco")
    envs.reset(seed=0)
    envs.step([envs.neutral_action] * 4)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # Python 3.12: "may lead to deadlocks"
def test_a_forked_process_walks_in_3d():
    """As those of AsyncVectorEnv. A fork copies no threads, so nobody must wait for MuJoCo's."""
    walk_in_3d()
    child = multiprocessing.get_context("fork").Process(target=walk_in_3d)
    child.start()
    child.join(30)
    code = child.exitcode
    child.kill()
    assert code == 0, f"{code}: None means that it still waits"
