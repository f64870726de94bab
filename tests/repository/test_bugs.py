"""The patches of tests/exercises/bugs: each applies to the stages as they are and changes one of
them a little; the stages still import, and the test that debug.md names catches the bug (slow)."""

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
BOOK = (ROOT / "tests" / "exercises" / "debug.md").read_text("utf-8")
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
        {path.name: path.read_text("utf-8") for path in folder.glob("0*.py")}
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
    (tmp_path / "mine.py").write_text(STUDENT_S_TEST, "utf-8")
    script = str(ROOT / "tests" / "exercises" / "debug.py")
    got, said = run(sys.executable, script, "mine.py", bug, folder=tmp_path)
    assert got == code and says in said, said
    assert os.listdir(tmp_path) == ["mine.py"], "nothing is left behind"
