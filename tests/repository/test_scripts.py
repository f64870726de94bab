"""Every stage from the command line: a small run, its figures, and what happens to wrong values."""

import json
import os
import re
import shutil
import subprocess
import sys
from functools import partial
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import matplotlib.image
import mujoco
import numpy as np
import pytest
from checks import close
from sheet import ROOT


def python(*arguments, cwd=ROOT, surrounding=os.environ, **more):
    """Python with these arguments, in this surrounding and more, and what it prints."""
    environment = {**surrounding, "PYTHONIOENCODING": "utf-8", **more}
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        cwd=cwd,
        timeout=900,
        capture_output=True,
        encoding=environment["PYTHONIOENCODING"],
        env=environment,
    )


def run(script, *arguments, folder):
    """A stage in its own process and a bare surrounding: no HOME, no display."""
    kept = {"PATH", "SYSTEMROOT", "LD_LIBRARY_PATH"} & os.environ.keys()
    bare = {name: os.environ[name] for name in kept} | {"LC_ALL": "C", "MPLBACKEND": "TkAgg"}
    done = python(ROOT / script, *arguments, cwd=folder, surrounding=bare)
    assert done.returncode == 0, f"{script} {arguments}:\n{done.stdout}\n{done.stderr}"
    assert "Traceback" not in done.stderr, done.stderr
    return done


def check_picture(path):
    """Something is drawn in it: frames, letters and grids have no colour, legends have 0.1 %."""
    image = matplotlib.image.imread(path)
    assert min(image.shape[:2]) > 100, f"{path} is only {image.shape} pixels"
    assert image.shape[1] <= 990, f"{path} is wider than 9 inches: on a page its letters are small"
    coloured = (np.ptp(image[..., :3], axis=-1) > 0.25).mean()
    assert coloured > 0.005, f"{path}: only {coloured:.2%} of it has a colour: are the axes empty?"


def check_model(path):
    """MuJoCo's viewer can open the file; there our robot stands, before and after two seconds."""
    model = mujoco.MjModel.from_xml_path(str(path))
    robot = import_module("01_robot_model").ROBOT
    leg = robot.hip.mass + robot.thigh.mass + robot.shin.mass + robot.foot.mass
    close(model.body_mass.sum(), robot.torso.mass + 2 * leg, "shapes to look at have no mass")
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, round(2 / model.opt.timestep))
    close(data.qpos, 0, "at first a viewer sets all joints and targets to 0", atol=0.05)
    high = robot.ankle_height + robot.shin_length + robot.thigh_length - robot.hip_z
    close(data.body("torso").xpos[2], high, "on straight legs, on the floor", atol=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("script, flags, said, files", [
    ("01_robot_model.py", ["--out", "../a new/one"], "smallest lean of a fall: 0",
     ["a new/one/01_robot.png"]),
    ("01_robot_model.py", ["--mujoco"], "smallest lean of a fall: 0",
     ["here/runs/mujoco/01_robot.png", "here/runs/mujoco/robot.xml"]),
    ("02_walk_engine.py", [], r"sideways +0\.00 +0\.48[^\n]* no\n",  # commanded, fell
     [f"here/runs/pymunk/02_{name}.png" for name in ("plan", "push")]),
    ("03_env.py", [], "distance d.*right yaw, last action.*random: .* [1-9][0-9]* falls.*"
     "hand-written: [1-9][0-9]* episodes at.*r_goal +[1-9]", ["here/runs/pymunk/03_rewards.png"]),
], ids=str)  # fmt: skip
def test_demonstrations_of_the_first_stages(tmp_path, script, flags, said, files):
    here = tmp_path / "here"
    here.mkdir(0o555 if "--out" in flags else 0o777)  # --out is for places where none may write
    shown = run(script, *flags, folder=here).stdout
    assert re.search(said, shown, re.DOTALL) and Path(files[0]).name in shown, shown
    written = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert sorted(path.relative_to(tmp_path).as_posix() for path in written) == files
    for path in written:
        if path.suffix == ".png":
            check_picture(path)
        else:
            check_model(path)


README = (ROOT / "README.md").read_text("utf-8")
EXPERIMENTS = re.findall(r"\| `(0\d_\w+\.py)` \| `(.+?)` to `(.+?)` \| `python (.+?)` \|", README)


@pytest.mark.shipped
@pytest.mark.slow
@pytest.mark.parametrize("script, number, other, command", EXPERIMENTS, ids=str)
def test_the_first_experiments_of_a_student_walk(tmp_path, script, number, other, command):
    """README's changes, in a copy: it walks, and a note says what differs."""
    for path in ROOT.glob("0*.py"):
        shutil.copy(path, tmp_path)
    stage = tmp_path / script
    text = stage.read_text("utf-8")
    assert text.count(number) == 1, f"{number} should stand once in {script}"
    value = re.fullmatch(r"\w+.*=\s*([\d.]+)", number)[1]
    stage.write_text(text.replace(number, number.replace(value, other)), "utf-8")
    sim = "mujoco" if "--mujoco" in command else "pymunk"
    policy = ROOT / "results" / sim / "policy.pt"
    _, *flags = command.replace("100", "8").split()
    evaluate = tmp_path / "05_evaluate.py"
    shown = run(evaluate, *flags, "--policy", policy, folder=tmp_path).stdout
    assert "another walk" in shown
    assert "| policy " in shown


def main_of(script, monkeypatch, *arguments):
    """The stage's main in this process: starting one takes seconds."""
    monkeypatch.setattr(sys, "argv", [script, *map(str, arguments)])
    return import_module(script.removesuffix(".py")).main()


@pytest.mark.slow
def test_the_pendulum_learns_with_a_student_s_own_stage(tmp_path):
    (tmp_path / "04_ppo.py").write_text("raise SystemExit('of mine')")
    pendulum = ROOT / "tests" / "course" / "starters" / "pendulum.py"
    assert "of mine" in python(pendulum, "--stages", tmp_path).stderr, (
        "it runs the stage of the root"
    )
    assert "--steps" in python(pendulum, "--help").stdout


@pytest.mark.slow
def test_train_a_little_then_evaluate(tmp_path, monkeypatch, capsys):
    """04 in this process, with few robots and short episodes; 05 on all cores in another one."""
    monkeypatch.chdir(tmp_path)
    ppo = import_module("04_ppo")
    short = partial(ppo.env.FootstepVectorEnv, task=ppo.env.Task(time_limit=2.0))
    monkeypatch.setattr(ppo.env, "FootstepVectorEnv", short)
    flags = "--steps 512 --num_envs 8 --rollout 8 --minibatch 32 --seed 1 --out train"
    main_of("04_ppo.py", monkeypatch, *flags.split())
    policy = Path("train", "policy.pt")
    said = capsys.readouterr().out
    assert f'python 05_evaluate.py --noise --policy "{policy}"' in said, "say how to go on"
    rows = np.genfromtxt("train/learning_curve.csv", delimiter=",", names=True)
    assert rows["timeout"][-1] > 0, "episodes have ended, and nobody counted them"
    check_picture("train/learning_curve.png")
    search = ROOT / "tests" / "studies" / "search.py"  # in the figure the policy would take 100 s
    flags = ["--noise", "--policy", policy, "--planner", search, "--episodes", 1]
    shown = run("05_evaluate.py", *flags, "--out", "out", folder=tmp_path).stdout
    assert Path("out/table.md").read_text("utf-8") in shown
    check_picture("out/footsteps.png")
    evaluation = json.loads(Path("out/evaluation.json").read_text("utf-8"))
    assert evaluation["policy"] == [str(policy)]
    assert [row["episodes"] for row in evaluation["rows"]] == [1] * 8


@pytest.mark.slow
def test_without_physics_all_arrive():
    """The starter `ideal`: another physics is a class in SIMULATORS."""
    robot_model = import_module("01_robot_model")
    evaluate = import_module("05_evaluate")
    with mock.patch.dict(robot_model.SIMULATORS):  # the starter changes them
        ideal = import_module("starters.ideal")
        world = evaluate.env.FootstepWorld(20, **ideal.IDEAL)
    ended = evaluate.evaluate(evaluate.BaselinePlanner(), world, evaluate.draw_trials(0, 20))
    assert (ended["outcome"] == "success").all(), "nobody falls where nothing slips"
    before = world.pose.copy()
    plan = world.engine.plan(np.zeros((20, 2, 3)) + [0.1, 0, 0.2], np.arange(20))
    world.simulator.run(np.arange(20), plan)
    trunk = plan.trunk[..., robot_model.GROUND]
    want = robot_model.relative(trunk[:, 0], trunk[:, -1])
    close(robot_model.relative(before, world.pose), want, "it moves exactly as planned")


def blocks(page):
    return re.findall(r"^```python\n(.*?)^```", page.read_text("utf-8"), re.DOTALL | re.MULTILINE)


WITH_BLOCKS = [
    page
    for place in ("*.md", "results/**/*.md", "tests/**/*.md")
    for page in sorted(ROOT.glob(place))
    if blocks(page)
]


@pytest.mark.shipped
@pytest.mark.slow
@pytest.mark.parametrize("page", WITH_BLOCKS, ids=lambda page: page.name)
def test_the_python_of_a_page_runs(page, tmp_path, monkeypatch):
    """All its blocks in order, as one program, and the tests that they define."""
    shutil.copytree(ROOT / "results" / "mujoco", tmp_path / "results" / "mujoco")
    monkeypatch.chdir(tmp_path)
    names = {}
    for block in blocks(page):
        exec(block, names)
    for name in [name for name in names if name.startswith("test_")]:
        names[name]()


NOTEBOOK = json.loads((ROOT / "tests/course/notebook.ipynb").read_text("utf-8"))
CELLS = ["".join(cell["source"]) for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]


@pytest.mark.shipped
@pytest.mark.slow
def test_the_cells_of_the_notebook_run(tmp_path, monkeypatch):
    """As one program, with a shorter training, and then with the shipped policy. Of its own commands
    only %run: the others fetch and install."""
    shutil.copytree(ROOT / "results", tmp_path / "results")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(Image=check_picture))
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(version_info=(9, 0)))
    names = {"stage": lambda line: run(*line.split(), folder=tmp_path)}
    for cell in CELLS:
        cell = cell.replace("--quick", "--quick --steps 8192").replace("100", "4")
        cell = cell.replace("runs/pymunk/quick/policy.pt", "results/pymunk/policy.pt")
        program = re.sub(r"^%run (.*)", r'stage("\1")', cell, flags=re.MULTILINE)
        exec(re.sub(r"^[!%].*", "", program, flags=re.MULTILINE), names)
    assert "success" in names["panel"].texts[0].get_text(), "how the walk ends, at the goal"
    assert Path("runs/pymunk/quick/policy.pt").is_file(), "what the last cell evaluates"


def test_the_notebook_has_no_outputs_and_installs_what_the_stages_need():
    assert not any(cell.get("outputs") for cell in NOTEBOOK["cells"]), "clear all outputs"
    first, *_ = CELLS
    needed = (ROOT / "requirements.txt").read_text()
    for package in re.findall(r"^\w+", needed, re.MULTILINE):
        assert package in first, f"{package} is in requirements.txt"
    assert {*re.findall(r"\S+==\S+", first)} <= {*needed.split()}, "of requirements.txt"


@pytest.mark.parametrize("script, arguments, mention", [
    ("01_robot_model.py", "--seed -1", "--seed must be 0 or more"),
    ("04_ppo.py", "--out a_file/sub --steps 1", "a_file"),
    ("04_ppo.py", "--steps 0", "--steps.* from 1"),
    ("04_ppo.py", "--rollout many", "--rollout: invalid int value: 'many'"),
    ("05_evaluate.py", "--episodes 0", "--episodes .* from 1"),
    ("05_evaluate.py", "--jobs 0", "--jobs from 1"),
    ("05_evaluate.py", "--push nan", "--push and --friction from 0"),
    ("05_evaluate.py", "--push -1 --policy missing.pt", "--push and --friction from 0"),
])  # fmt: skip
def test_wrong_values_get_one_clear_line(tmp_path, monkeypatch, capfd, script, arguments, mention):
    (tmp_path / "a_file").touch()  # not a folder
    monkeypatch.chdir(tmp_path)
    wrong = partial(main_of, script, monkeypatch, *arguments.split())
    with pytest.raises(SystemExit, match="2"):
        import_module("01_robot_model").run_script(wrong)
    *usage, line = capfd.readouterr().err.strip().splitlines()
    wanted = f"{script}: .*{mention}"
    assert re.match(wanted, line), f"say who complains, and of which value: {line!r}"
    assert not usage or usage[0].startswith("usage: "), "argparse's usage may stand above it"
    assert [path.name for path in tmp_path.iterdir()] == ["a_file"], "wrong values write nothing"


STAGES = sorted(path.name for path in ROOT.glob("0*.py"))
PAGES = "README.md", "results/README.md", "results/pymunk/README.md", "results/mujoco/README.md"
PAGES += "tests/README.md", "tests/course/README.md", "tests/course/notebook.ipynb"


@pytest.mark.parametrize("page", [*STAGES, *PAGES])
def test_commands_and_files_that_a_page_or_stage_names_exist(page, monkeypatch, capsys):
    text = (ROOT / page).read_text("utf-8")
    commands = re.findall(r"(0\d_\w+\.py)([^`\n]*)", text)
    assert commands, f"{page} does not say how to run it"
    for name, told in commands:
        with pytest.raises(SystemExit, match="0"):
            main_of(name, monkeypatch, "--help")
        usage, about, _ = capsys.readouterr().out.partition("\nStage ")
        assert about, f"--help of {name} says what the stage is about"
        known = re.findall(r"--[a-z_-]+", usage)
        assert {*re.findall(r"--[a-z_-]+", told)} <= {*known}, f"{page}: `{name}{told}`"
    for path in re.findall(r"tests/[\w/]+\.py", text):
        assert (ROOT / path).is_file(), f"{page} names {path}, which does not exist"


# ------------------------------------------------------------------------ numbers of the course
PREDICT = "tests/course/predict.py"


def told(name):
    """The measured lines of an experiment in predict.md."""
    page = (ROOT / PREDICT).with_suffix(".md").read_text("utf-8")
    section = page.split(f"\n## {name}:")[1].split("\n## ")[0].split("What we measured")[1]
    return re.findall(r"^    (.*)$", section, re.MULTILINE)


def numbers(line):
    """A line without its numbers, and its numbers."""
    pattern = r"-?\d+\.?\d*"
    line = line.replace("−", "-").split("  (")[0]
    return re.sub(pattern, "#", line).split(), [float(x) for x in re.findall(pattern, line)]


@pytest.mark.shipped
@pytest.mark.slow
@pytest.mark.parametrize(
    "name, commands, tolerance",
    [
        ("lean", ["01_robot_model.py", "01_robot_model.py --mujoco"], 0.0011),
        ("reflex", [f"{PREDICT} reflex --mujoco"], 12),  # of 96
        ("sway", ["tests/course/predict.py sway --mujoco"], 0.005),
        ("capture", ["02_walk_engine.py --mujoco"], 2),  # of twelve
    ],
    ids=str,
)
def test_predictions_show_what_their_commands_print(tmp_path, name, commands, tolerance):
    printed = "".join(run(*command.split(), folder=tmp_path).stdout for command in commands)
    found = [numbers(line) for line in printed.splitlines()]
    assert told(name), f"predict.md, {name}: where are the measured lines?"
    for line in told(name):
        words, values = numbers(line)
        assert any(
            words == other and values == pytest.approx(more, abs=tolerance) for other, more in found
        ), f"predict.md, {name}: {line!r}, but:\n{printed}"
