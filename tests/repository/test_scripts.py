"""Every script that a page names runs: its files and pictures, and what happens to wrong values."""

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

import matplotlib.image
import mujoco
import numpy as np
import pytest
from checks import close
from sheet import ROOT

PAGES = [
    path.relative_to(ROOT).as_posix()
    for place in ("*.md", "results/**/*.md", "tests/**/*.md")
    for path in sorted(ROOT.glob(place))
]
README = (ROOT / "README.md").read_text("utf-8")


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
    """What a script prints, in its own process and a bare surrounding: no HOME, no display."""
    kept = {"PATH", "SYSTEMROOT", "LD_LIBRARY_PATH"} & os.environ.keys()
    bare = {name: os.environ[name] for name in kept} | {"LC_ALL": "C", "MPLBACKEND": "TkAgg"}
    done = python(ROOT / script, *arguments, cwd=folder, surrounding=bare)
    assert done.returncode == 0, f"{script} {arguments}:\n{done.stdout}\n{done.stderr}"
    return done.stdout


def main_of(script, monkeypatch, *arguments):
    """The script's main in this process: starting one takes seconds."""
    monkeypatch.setattr(sys, "argv", [script, *map(str, arguments)])
    return import_module(script.removesuffix(".py")).main()


def check_picture(path):
    """Something is drawn in it: frames, letters and grids have no colour, legends have 0.1 %."""
    image = matplotlib.image.imread(path)
    coloured = (np.ptp(image[..., :3], axis=-1) > 0.25).mean()
    assert coloured > 0.002, f"{path}: only {coloured:.2%} of it has a colour: are the axes empty?"


def check_model(path):
    """MuJoCo's viewer can open the file; there a robot stands as it began, after two seconds, too."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, round(2 / model.opt.timestep))
    close(data.qpos, 0, "at first a viewer sets all joints and targets to 0", atol=0.05)


# ------------------------------------------------------------------------ commands
def told(name):
    """The measured lines of an experiment in predict.md."""
    page = (ROOT / "tests" / "course" / "predict.md").read_text("utf-8")
    section = page.split(f"\n## {name}:")[1].split("\n## ")[0].split("What we measured")[1]
    return re.findall(r"^    (.*)$", section, re.MULTILINE)


def numbers(line):
    """A line without its numbers, and its numbers."""
    pattern = r"-?\d+\.?\d*"
    line = line.replace("−", "-").split("  (")[0]
    return re.sub(pattern, "#", line).split(), [float(x) for x in re.findall(pattern, line)]


@pytest.mark.shipped
@pytest.mark.slow
@pytest.mark.parametrize("commands, pictures, name, tolerance", [
    (["01_robot_model.py", "01_robot_model.py --mujoco"], 2, "lean", 0.0011),
    (["02_walk_engine.py"], 2, None, 0),
    (["02_walk_engine.py --mujoco"], 2, "capture", 2),  # of twelve
    (["03_env.py"], 1, None, 0),
    (["tests/course/predict.py reflex --mujoco"], 0, "reflex", 12),  # of 96
    (["tests/course/predict.py sway --mujoco"], 0, "sway", 0.005),
    (["tests/course/predict.py circle"], 0, "circle", 0),
    (["tests/course/predict.py concentration"], 0, "concentration", 0),
], ids=str)  # fmt: skip
def test_demonstrations_draw_pictures_and_print_what_predict_md_tells(
    tmp_path, commands, pictures, name, tolerance
):
    printed = "".join(run(*command.split(), folder=tmp_path) for command in commands)
    drawn = [*map(check_picture, tmp_path.glob("runs/*/0*.png"))]
    assert len(drawn) == pictures
    for path in tmp_path.rglob("robot.xml"):
        check_model(path)
    for line in told(name) if name else ():
        words, values = numbers(line)
        found = [more for other, more in map(numbers, printed.splitlines()) if other == words]
        assert pytest.approx(values, abs=tolerance) in found, f"{line!r}, but:\n{printed}"


@pytest.mark.shipped
@pytest.mark.slow
@pytest.mark.parametrize(
    "number, other, command",
    re.findall(r"\| `(\w+=.+?)` to `(.+?)` \| `python (.+?)` \|", README),
)
def test_the_first_experiments_of_a_student_walk(tmp_path, number, other, command):
    """README's changes, in a copy: it walks, and a note says what differs."""
    for path in ROOT.glob("0*.py"):
        shutil.copy(path, tmp_path)
    script = tmp_path / "02_walk_engine.py"
    name, _ = number.split("=")
    changed = script.read_text("utf-8").replace(number, f"{name}={other}")
    script.write_text(changed, "utf-8")
    sim = "mujoco" if "--mujoco" in command else "pymunk"
    policy = ROOT / "results" / sim / "policy.pt"
    _, *flags = command.replace("100", "8").split()
    shown = run(tmp_path / "05_evaluate.py", *flags, "--policy", policy, folder=tmp_path)
    assert "another walk" in shown and "| policy " in shown


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
    check_picture("train/learning_curve.png")
    search = ROOT / "tests" / "studies" / "search.py"  # in the figure the policy would take 100 s
    flags = ["--noise", "--policy", policy, "--planner", search, "--episodes", 1, "--out", "out"]
    shown = run("05_evaluate.py", *flags, folder=tmp_path)
    assert Path("out/table.md").read_text("utf-8") in shown
    check_picture("out/footsteps.png")
    evaluation = json.loads(Path("out/evaluation.json").read_text("utf-8"))
    assert evaluation["policy"] == [str(policy)] and len(evaluation["rows"]) == 8


@pytest.mark.parametrize("script, arguments, mention", [
    ("01_robot_model.py", "--seed -1", "--seed must be 0 or more"),
    ("04_ppo.py", "--out a_file/sub --steps 1", "a_file"),
    ("04_ppo.py", "--steps 0", "--steps.* from 1"),
    ("04_ppo.py", "--rollout many", "--rollout: invalid int value: 'many'"),
    ("05_evaluate.py", "--policy a_file", "a_file"),
    ("05_evaluate.py", "--push nan", "--push and --friction from 0"),
    ("05_evaluate.py", "--push -1 --policy missing.pt", "--push and --friction from 0"),
])  # fmt: skip
def test_wrong_values_get_one_clear_line_and_destroy_nothing(
    tmp_path, monkeypatch, capfd, script, arguments, mention
):
    (tmp_path / "a_file").write_text("mine")
    monkeypatch.chdir(tmp_path)
    wrong = partial(main_of, script, monkeypatch, *arguments.split())
    with pytest.raises(SystemExit, match="2"):
        import_module("01_robot_model").run_script(wrong)
    line = capfd.readouterr().err.strip().splitlines()[-1]  # above it argparse's usage may stand
    assert re.match(f"{script}: .*{mention}", line), f"who complains, of which value? {line!r}"
    assert [path.read_text() for path in tmp_path.iterdir()] == ["mine"], "it writes nothing"


# ------------------------------------------------------------------------ pages
@pytest.mark.parametrize("page", [*sorted(path.name for path in ROOT.glob("0*.py")), *PAGES])
def test_commands_and_files_that_a_page_or_stage_names_exist(page, monkeypatch, capsys):
    text = (ROOT / page).read_text("utf-8")
    for script, given in re.findall(r"python (0\d_\w+\.py)([^`\n]*)", text):
        with pytest.raises(SystemExit, match="0"):
            main_of(script, monkeypatch, "--help")
        known = re.findall(r"--[a-z_-]+", capsys.readouterr().out)
        assert {*re.findall(r"--[a-z_-]+", given)} <= {*known}, f"{page}: `{script}{given}`"
    for path in re.findall(r"tests/(?!test_mine)[\w/]+\.py", text):
        assert (ROOT / path).is_file(), f"{page} names {path}, which does not exist"


def blocks(page):
    text = (ROOT / page).read_text("utf-8")
    return re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


@pytest.mark.shipped
@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page)])
def test_the_python_of_a_page_runs(page, tmp_path, monkeypatch):
    """All its blocks in order, as one program, and the tests that they define."""
    shutil.copytree(ROOT / "results" / "mujoco", tmp_path / "results" / "mujoco")
    monkeypatch.chdir(tmp_path)
    names = {}
    exec("\n".join(blocks(page)), names)
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
    assert Path("runs/pymunk/quick/policy.pt").is_file(), "what the last cell evaluates"


@pytest.mark.shipped
def test_the_figures_of_the_course_are_drawn(tmp_path, monkeypatch):
    main_of("figures.py", monkeypatch, "--out", tmp_path)
    assert [*map(check_picture, tmp_path.glob("*.png"))], "none"


def test_the_notebook_installs_what_the_stages_need():
    """With the versions of requirements.txt, or in the one that is there."""
    installed = {*CELLS[0].split()}
    for line in (ROOT / "requirements.txt").read_text().split():
        assert {line, line.split("==")[0]} & installed, f"{line} is in requirements.txt"
