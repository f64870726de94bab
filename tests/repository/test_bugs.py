"""The patches of tests/exercises/bugs: each applies to the stages as they are and changes one of
them a little; the stages still import, and the test that debug.md names catches the bug (slow)."""

import csv
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BUGS = ROOT / "tests" / "exercises" / "bugs"
BOOK = (ROOT / "tests" / "exercises" / "debug.md").read_text(encoding="utf-8")
SECTIONS = {part.split(":")[0]: part for part in re.split(r"^## ", BOOK, flags=re.MULTILINE)[1:]}
PATCHES = sorted(path.stem for path in BUGS.glob("*.patch"))
STAGES = sorted(path.stem for path in ROOT.glob("0*.py"))
IMPORT_THEN_TEST = f"""
import importlib, pytest, sys
for name in {STAGES}:
    importlib.import_module(name)
print("imported", flush=True)
sys.exit(pytest.main(["-p", "no:cacheprovider", *sys.argv[1:]]))
"""


def catcher(name):
    """The test that debug.md says catches this bug: its module, and how its name begins."""
    named = SECTIONS[name].split("Our own test</summary>")[1]
    (found,) = re.findall(r"`(test_\w+)\.(\w+)`", named)
    return found


def run(*command, folder):
    """(exit code, all that was printed); git takes the folder for no part of a repository."""
    done = subprocess.run(
        command,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        timeout=900,
        env={**os.environ, "GIT_CEILING_DIRECTORIES": str(folder.parent)},
    )
    return done.returncode, done.stdout


def apply(name, folder):
    if shutil.which("git") is None:
        pytest.skip("patches are applied by git")
    code, said = run("git", "apply", str(BUGS / f"{name}.patch"), folder=folder)
    assert code == 0, f"{name}.patch does not apply to the stages as they are: {said}"


def test_every_patch_has_its_page_and_every_page_its_patch():
    assert sorted(SECTIONS) == PATCHES, "headings of debug.md and files in bugs/ differ"


@pytest.mark.parametrize("name", PATCHES)
def test_patch_applies_changes_little_in_one_stage_and_has_a_whole_page(name, tmp_path):
    for part in ("★", "*Symptom.*", "*Task.*", "<summary>Hint 1", "<summary>Hint 2"):
        assert part in SECTIONS[name], f"{name}: where is {part}?"
    assert catcher(name)
    for path in ROOT.glob("0*.py"):
        shutil.copy(path, tmp_path)
    apply(name, tmp_path)
    before, after = (
        {path.name: path.read_text(encoding="utf-8") for path in folder.glob("0*.py")}
        for folder in (ROOT, tmp_path)
    )
    (changed,) = (file for file in before if after[file] != before[file])
    compile(after[changed], changed, "exec")
    new = set(after[changed].splitlines()) - set(before[changed].splitlines())
    assert len(new) <= 6, f"one bug, not a rewrite: {new}"
    assert all(len(line) <= 100 for line in new), "a long line gives the bug away"


@pytest.mark.slow
def test_bugs_are_silent_and_caught_by_our_tests(tmp_path):
    def problem(name):
        folder = tmp_path / name
        shutil.copytree(
            ROOT / "tests",
            folder / "tests",
            ignore=shutil.ignore_patterns("__pycache__", "bugs", "studies"),
        )
        for path in [*ROOT.glob("0*.py"), ROOT / ".pytest.ini"]:
            shutil.copy(path, folder)
        apply(name, folder)
        module, begins = catcher(name)
        code, said = run(
            sys.executable,
            "-c",
            IMPORT_THEN_TEST,
            *map(str, folder.glob(f"tests/**/{module}.py")),
            "-k",
            f"test_{begins}",
            folder=folder,
        )
        if not said.startswith("imported\n"):
            return f"{name} is not silent: {said}"
        if code != 1 or "AssertionError" not in said:
            return f"{module}.{begins} does not catch {name} by an assertion:\n{said[-2000:]}"

    with ThreadPoolExecutor(import_module("01_robot_model").CORES) as pool:
        problems = list(filter(None, pool.map(problem, PATCHES)))
    assert not problems, "\n".join(problems)


def numbers(text):
    return [float(x) for x in re.findall(r"-?\d+\.?\d*", text.replace("−", "-"))]


def shown(job):
    """What a stage shows with a bug, or without: lists of numbers by the title of a column."""
    folder, bug, stage, *flags = job
    folder.mkdir()
    for path in ROOT.glob("0*.py"):
        shutil.copy(path, folder)
    if bug != "before":
        apply(bug, folder)
    code, said = run(sys.executable, stage, *flags, "--out", "out", folder=folder)
    assert code == 0, said
    if "--mujoco" in flags:  # stage 2: commanded x, y, yaw, then walked
        return {
            walk: numbers(re.search(rf"{walk} .*", said)[0])[3:6]
            for walk in ("forward", "left turn")
        }
    *_, last = csv.DictReader((folder / "out" / "learning_curve.csv").open(encoding="utf-8"))
    more = {"approx. KL": "approx_kl", "critic's loss": "value_loss"}
    return {
        title: [float(last[more.get(title, title.replace(" ", "_"))])]
        for title in ("return", "explained variance", "clip fraction", "entropy", *more)
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    "bugs, command, tolerance",
    [
        (("lopsided", "hiccup"), ["02_walk_engine.py", "--mujoco"], {"abs": 0.011}),
        (
            ("tired", "deaf", "average"),
            ["04_ppo.py", "--env", "Pendulum-v1", "--gamma", "0.95", "--steps", "60000"],
            {"rel": 0.3, "abs": 0.011},
        ),
    ],
    ids=str,
)
def test_symptoms_are_those_of_the_page(tmp_path, bugs, command, tolerance):
    jobs = [(tmp_path / bug, bug, *command) for bug in ("before", *bugs)]
    with ThreadPoolExecutor(import_module("01_robot_model").CORES) as pool:
        found = dict(zip(("before", *bugs), pool.map(shown, jobs)))
    for bug in bugs:
        titles, _, before, now, *_ = [
            line.split("|") for line in re.findall(r"^\|(.*)\|$", SECTIONS[bug], re.MULTILINE)
        ]
        names = [title.split(",")[0].strip() for title in titles]
        assert len(found[bug].keys() & {*names}) >= 2, "which columns are those of the command?"
        for name, *cells in zip(names, before, now):
            for cell, got in zip(cells, (found["before"], found[bug])):
                if name in got:
                    assert numbers(cell) == pytest.approx(got[name], **tolerance), (bug, name)


STUDENT_S_TEST = """
from importlib import import_module
import numpy as np

def test_angles_are_wrapped():
    d, alpha, beta = import_module("03_env").polar(np.array([1.0, 0.0, 4.0]))
    assert abs(alpha) <= np.pi, f"α = {alpha} for a yaw of 4 rad"
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "bug, code, says",
    [("stubborn", 0, "fails with stubborn: well done"), ("tired", 1, "With tired it must fail")],
)
def test_a_student_s_test_is_judged_with_and_without_the_bug(tmp_path, bug, code, says):
    (tmp_path / "mine.py").write_text(STUDENT_S_TEST, encoding="utf-8")
    script = str(ROOT / "tests" / "exercises" / "debug.py")
    got, said = run(sys.executable, script, "mine.py", bug, folder=tmp_path)
    assert got == code and says in said, said
    assert os.listdir(tmp_path) == ["mine.py"], "nothing is left behind"


def test_debug_refuses_what_is_not_there(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["debug.py", "nobody.py", "tired"])
    with pytest.raises(SystemExit) as stopped:
        import_module("debug").main()
    assert stopped.value.code == 2 and "nobody.py: no such file" in capsys.readouterr().err
