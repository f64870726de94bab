"""The bugs of tests/course/bugs: each changes the stages as they are a little, in one place; they
still import, and the test that debug.md names catches the bug (slow)."""

import ast
import os
import re
import shutil
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module

import debug
import pytest
from debug import BUGS, ROOT
from test_scripts import main_of, python

BOOK = (ROOT / "tests" / "course" / "debug.md").read_text("utf-8")
SECTIONS = {part.split(":")[0]: part for part in re.split(r"^## ", BOOK, flags=re.MULTILINE)[1:]}
STAGES = sorted(path.stem for path in ROOT.glob("0*.py"))
IMPORT_THEN_TEST = f"""
import importlib, pytest, sys
for name in {STAGES}:
    importlib.import_module(name)
print("imported", flush=True)
sys.exit(pytest.main(["-p", "debug", "-p", "no:cacheprovider", *sys.argv[1:]]))
"""


def catcher(name):
    """The test that debug.md says catches this bug: its module, and how its name begins."""
    named = SECTIONS[name].split("Our own test</summary>")[1]
    (found,) = re.findall(r"`(test_\w+)\.(\w+)`", named)
    return found


def test_every_bug_has_its_page_and_every_page_its_bug():
    assert sorted(SECTIONS) == BUGS, "headings of debug.md and files in bugs/ differ"


@pytest.mark.parametrize("name", BUGS)
def test_a_bug_changes_little_in_one_stage_and_has_a_whole_page(name, tmp_path, monkeypatch):
    for part in ("★", "*Symptom.*", "*Task.*", "<summary>Hint 1", "<summary>Hint 2"):
        assert part in SECTIONS[name], f"{name}: where is {part}?"
    assert catcher(name)
    file, _, _ = debug.read_bug(name)
    good = (ROOT / file).read_text("utf-8")
    copy = tmp_path / file
    copy.write_text(good, "utf-8")
    monkeypatch.setattr(debug, "ROOT", tmp_path)

    def after(what):
        """The stage after this command."""
        main_of("debug.py", monkeypatch, what, name)
        return copy.read_text("utf-8")

    new = set(after("put").splitlines()) - set(good.splitlines())
    assert 0 < len(new) <= 6, f"one bug, not a rewrite: {new}"
    assert all(len(line) <= 100 for line in new), "a long line gives the bug away"
    with pytest.raises(SystemExit, match="2"):  # it is in already
        after("put")
    assert ast.dump(ast.parse(after("undo"))) == ast.dump(ast.parse(good))


def test_a_bug_is_found_in_any_layout_and_only_if_it_is_there_once():
    source = "def f(x):\n    y = g(\n        x,  # of f\n        1\n    )  # of g\n    return y\n"
    bad = "def f(x):\n    y = g(x, 2)\n    z = y  # of g\n    return y\n"
    assert debug.exchanged(source, "y = g(x, 1)", "y = g(x, 2)\nz = y") == bad
    for text, count in ((bad, 0), (2 * source, 2)):
        with pytest.raises(ValueError, match=f"must be there once, and are {count} times:\ny = g"):
            debug.exchanged(text, "y = g(x, 1)", "")


@pytest.mark.slow
def test_bugs_are_silent_and_caught_by_our_tests(tmp_path):
    def problem(name):
        folder = tmp_path / name
        folder.mkdir()
        debug.copied(folder)
        debug.put(name, folder)
        module, begins = catcher(name)
        files = folder.glob(f"tests/**/{module}.py")
        done = python("-c", IMPORT_THEN_TEST, *files, "-k", f"test_{begins}", cwd=folder)
        code = done.returncode
        said = done.stdout + done.stderr
        if not said.startswith("imported\n"):
            return f"{name} is not silent: {said}"
        if code != debug.CAUGHT:
            return f"{module}.{begins} does not catch {name} by an assertion:\n{said[-2000:]}"

    with ThreadPoolExecutor(import_module("01_robot_model").CORES) as pool:
        problems = list(filter(None, pool.map(problem, BUGS)))
    assert not problems, "\n".join(problems)


def test_a_bug_that_cannot_be_put_is_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(debug, "ROOT", tmp_path)
    stage = tmp_path / "04_ppo.py"

    def said():
        with pytest.raises(SystemExit, match="2"):
            main_of("debug.py", monkeypatch, "put", "tired")
        return capsys.readouterr().err.splitlines()[-1]

    assert "No such file" in said()
    for wrong in "def gae(:\n", "def gae(rewards:\n", "  x = (\n", "if x:\n  y\n z\n":
        stage.write_text(wrong, "utf-8")
        assert "04_ppo.py is no Python" in said() and stage.read_text("utf-8") == wrong


def test_the_copy_of_a_read_only_folder_can_be_written(tmp_path, monkeypatch):
    shared = tmp_path / "shared"
    copy = tmp_path / "copy"
    (shared / "tests").mkdir(parents=True)
    for path in shared / "04_ppo.py", shared / ".pytest.ini", shared / "tests" / "checks.py":
        path.touch(0o444)
    (shared / "tests").chmod(0o555)
    monkeypatch.setattr(debug, "ROOT", shared)
    debug.copied(copy)
    found = [path.stat().st_mode & 0o200 for path in copy.rglob("*")]
    assert len(found) == 4 and all(found), "somebody cannot write what was copied"


@pytest.mark.slow
def test_a_student_s_test_that_never_ends_is_stopped(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text("while True:\n    pass\n", "utf-8")
    monkeypatch.setattr(debug, "PATIENCE", 1)
    with pytest.raises(SystemExit, match="takes longer than 1 s"):
        debug.judged(tmp_path / "mine.py", "tired")


STUDENT_S_TEST = """
from importlib import import_module
import numpy as np

def test_angles_are_wrapped():
    d, alpha, beta = import_module("03_env").polar(np.array([1.0, 0.0, 4.0]))
    print(f"α = {alpha} for a yaw of ± 4 rad")
    right = abs(alpha) <= np.pi
"""


@pytest.fixture(scope="module")
def with_bugs(tmp_path_factory):
    """A repository in which two bugs are in."""
    folder = tmp_path_factory.mktemp("repository")
    debug.copied(folder)
    shutil.copytree(debug.FOLDER, folder / "tests" / "course" / "bugs")
    for bug in "stubborn", "tired":
        debug.put(bug, folder)
    return folder


ASSERTS = "    assert right\n"
RAISES = "    right or {}['an AssertionError']\n"


@pytest.mark.slow
@pytest.mark.parametrize("bug, last, code, says", [
    ("tired", "    assert not right\n", 1, "Without a bug your test must pass"),
    ("tired", ASSERTS, 1, "With tired it must fail"),
    ("stubborn", ASSERTS, 0, "fails with stubborn: well done"),
    ("stubborn", RAISES, 1, "by an assertion, and it does not"),
])  # fmt: skip
def test_a_student_s_test_is_judged_with_and_without_the_bug(
    with_bugs, tmp_path, bug, last, code, says
):
    (tmp_path / "mine.py").write_text(STUDENT_S_TEST + last, "utf-8")
    # A console of Windows, which has ± and no α; and options of the student's own
    surrounding = {"PYTHONIOENCODING": "cp1252", "PYTEST_ADDOPTS": "--tb=short"}
    script = with_bugs / "tests" / "course" / "debug.py"
    done = python(script, "mine.py", bug, cwd=tmp_path, **surrounding)
    said = done.stdout + done.stderr
    assert done.returncode == code and says in said, said
    assert ("± 4 rad" in said) == ("must fail" not in says), said
    assert os.listdir(tmp_path) == ["mine.py"], "nothing is left behind"
