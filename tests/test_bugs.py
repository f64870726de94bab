"""The patches of tests/exercises/bugs: each applies to the stages as they are and changes one of
them a little; the stages still import, and the test that debug.md names catches the bug (slow)."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from test_ledger import names_in

ROOT = Path(__file__).resolve().parents[1]
BUGS = ROOT / "tests" / "exercises" / "bugs"
BOOK = (ROOT / "tests" / "exercises" / "debug.md").read_text(encoding="utf-8")
SECTIONS = {part.split(":")[0]: part for part in re.split(r"^## ", BOOK, flags=re.MULTILINE)[1:]}
PATCHES = sorted(path.stem for path in BUGS.glob("*.patch"))

def catchers(name):
    """The tests, as (module, function), that debug.md says would catch this bug."""
    named = SECTIONS[name].split("Our own test</summary>")[1]
    found = re.findall(r"`(test_\w+)\.(\w+)`", named)
    return [(module, test) for module, begins in found for test in names_in(module)
            if test.startswith(f"test_{begins}")]

@pytest.fixture
def copy(tmp_path):
    """A copy of the stages and their tests."""
    for path in [*ROOT.glob("0*.py"), ROOT / ".pytest.ini"]:
        shutil.copy(path, tmp_path)
    shutil.copytree(ROOT / "tests", tmp_path / "tests",
                    ignore=shutil.ignore_patterns("__pycache__", "wrong", "bugs", "studies"))
    return tmp_path

def run(*command, folder):
    """(exit code, all that was printed); git takes the folder for no part of a repository."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, encoding="utf-8",
                          env={**os.environ, "GIT_CEILING_DIRECTORIES": str(folder.parent),
                               "MPLBACKEND": "Agg"}, timeout=900)
    return done.returncode, done.stdout + done.stderr

def apply(name, folder, *flags):
    if shutil.which("git") is None:
        pytest.skip("patches are applied by git")
    code, said = run("git", "apply", *flags, str(BUGS / f"{name}.patch"), folder=folder)
    assert code == 0, f"{name}.patch does not apply to the stages as they are: {said}"

def test_every_patch_has_its_page_and_every_page_its_patch():
    assert len(PATCHES) >= 6
    assert sorted(SECTIONS) == PATCHES, "headings of debug.md and files in bugs/ differ"

@pytest.mark.parametrize("name", PATCHES)
def test_patch_applies_changes_little_in_one_stage_and_can_be_taken_back(name, tmp_path):
    before = {path.name: path.read_bytes() for path in ROOT.glob("0*.py")}
    for file, text in before.items():
        (tmp_path / file).write_bytes(text)
    apply(name, tmp_path)
    after = {file: (tmp_path / file).read_bytes() for file in before}
    changed, = (file for file in before if after[file] != before[file])
    text = after[changed].decode("utf-8")
    compile(text, changed, "exec")
    old = set(before[changed].decode("utf-8").splitlines())
    new = [line for line in text.splitlines() if line not in old]
    assert len(new) <= 6, f"one bug, not a rewrite: {new}"
    assert all(len(line) <= 100 for line in new), "a long line gives the bug away"
    apply(name, tmp_path, "-R")
    assert (tmp_path / changed).read_bytes() == before[changed]

@pytest.mark.parametrize("name", PATCHES)
def test_page_gives_a_symptom_a_task_hints_and_our_test(name):
    for part in ("★", "*Symptom.*", "*Task.*", "<summary>Hint 1", "<summary>Hint 2"):
        assert part in SECTIONS[name], f"{name}: where is {part}?"
    assert catchers(name), f"{name}: which test of ours catches it?"

@pytest.mark.slow
@pytest.mark.parametrize("name", PATCHES)
def test_bug_is_silent_and_caught_by_our_test(name, copy):
    apply(name, copy)
    stages = sorted(path.stem for path in copy.glob("0*.py"))
    load = f"from importlib import import_module\nfor name in {stages}: import_module(name)"
    code, said = run(sys.executable, "-c", load, folder=copy)
    assert code == 0 and not said, f"{name} is not silent: {said}"
    for module, test in catchers(name):
        code, said = run(sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider",
                         f"tests/{module}.py::{test}", folder=copy)
        assert code == 1, f"{test} does not catch {name}:\n{said[-2000:]}"
        assert "AssertionError" in said, f"{test} fails, but asserts nothing:\n{said[-2000:]}"
