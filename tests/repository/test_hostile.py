"""Hard to break: bodies, consoles, surroundings and ends of a process that nobody would wish for."""

import io
import itertools
import multiprocessing
import os
import shlex
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from unittest import mock

import matplotlib
import numpy as np
import pytest
from checks import IN_3D_SLOW
from sheet import ROOT
from test_scripts import python
from tqdm import tqdm

robot_model = import_module("01_robot_model")
walk_engine = import_module("02_walk_engine")
env = import_module("03_env")


@pytest.mark.filterwarnings("error")
@IN_3D_SLOW
@pytest.mark.parametrize("extreme", [{"friction": 0.0}, {"torque_limit": (0.1,) * 6}], ids=str)
def test_an_extreme_body_may_fall_and_nothing_else_happens(
    sim, extreme, capfd, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    robot = robot_model.RobotModel(**extreme)
    envs = env.FootstepVectorEnv(8, sim, noise=True, robot=robot)
    dice = np.random.default_rng(0)
    envs.reset(seed=0)
    falls = 0
    for _ in range(8):
        seen, reward, *_, infos = envs.step(dice.random((8, 6)))
        falls += infos["fall"].sum()
        assert np.isfinite(reward).all() and envs.observation_space.contains(seen)
        assert np.isfinite(envs.world.simulator.state).all()
    assert falls or "friction" in extreme, "who has no strength should fall: the test sees none"
    assert capfd.readouterr() == ("", ""), "a simulator wrote to the terminal"
    assert not list(tmp_path.iterdir()), "a simulator wrote a file"


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


def test_who_stops_reading_gets_no_traceback():
    code = "__import__('01_robot_model').run_script(lambda: [print(k) for k in range(10**5)])"
    command = shlex.join([sys.executable, "-u", "-c", code]) + " | head -n 1"
    done = subprocess.run(command, shell=True, cwd=ROOT, capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("0\n", "")


@pytest.mark.filterwarnings("error")
def test_a_busy_machine_draws_every_legend_in_silence(tmp_path):
    """matplotlib warns where it has looked for a place for more than a second."""
    with mock.patch("time.perf_counter", side_effect=itertools.count(step=2)):
        env.plot_rewards({"r_d": np.ones(5)}, np.ones((2, 15)), tmp_path / "rewards.png")


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
    seen = []
    with matplotlib.rc_context({"figure.dpi": 77}):
        before = dict(matplotlib.rcParams)
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


def walk_in_3d(count):
    envs = env.FootstepVectorEnv(count, "mujoco")
    envs.reset(seed=0)
    envs.step([envs.neutral_action] * count)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # Python 3.12: "may lead to deadlocks"
@pytest.mark.parametrize("count", [1, 4])
def test_a_forked_process_walks_in_3d(count):
    """As those of AsyncVectorEnv. A fork copies no threads, so nobody must wait for MuJoCo's."""
    walk_in_3d(4)
    child = multiprocessing.get_context("fork").Process(target=walk_in_3d, args=(count,))
    child.start()
    child.join(30)
    code = child.exitcode
    child.kill()
    assert code == 0, f"{code}: None means that it still waits"


@pytest.mark.slow
@pytest.mark.parametrize("surrounding", ["notebook", "debugger", "profiler", "thread"])
def test_stage_5_walks_in_any_surrounding(surrounding, tmp_path, monkeypatch, capfd):
    """Where no other process can help."""
    policy = ROOT / "results" / "pymunk" / "policy.pt"
    flags = ["--episodes", "1", "--policy", str(policy), "--out", "out"]
    alone = [] if surrounding == "notebook" else ["--jobs", "1"]
    monkeypatch.setattr(sys, "argv", ["05_evaluate.py", *flags, *alone])
    monkeypatch.setattr(robot_model, "CORES", 2)
    monkeypatch.chdir(tmp_path)
    # python -m cProfile 05_evaluate.py: the module __main__ is not the stage.
    stage = ROOT / "05_evaluate.py"
    names = {"__name__": "__main__", "__file__": str(stage)}
    code = compile(stage.read_text("utf-8"), stage.name, "exec")
    if surrounding == "notebook":  # exec(open("05_evaluate.py").read())
        del names["__file__"]
    if surrounding == "debugger":  # python -m pdb 05_evaluate.py; so is the second %run of a kernel
        monkeypatch.delattr(sys.modules["__main__"], "__spec__")
    if surrounding == "thread":
        with ThreadPoolExecutor() as pool:
            pool.submit(exec, code, names).result()
    else:
        exec(code, names)
    assert "| baseline " in (tmp_path / "out" / "table.md").read_text("utf-8")
    assert "Error" not in capfd.readouterr().err
