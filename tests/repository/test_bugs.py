"""The bugs of tests/course/bugs: each changes the stages as they are a little, in one place; they
still import, and the test that debug.md names catches the bug (slow)."""

import ast
import re

import debug
import pytest
from debug import BUGS, ROOT
from test_scripts import main_of, python

PAGE = (ROOT / "tests" / "course" / "debug.md").read_text("utf-8")
STAGES = sorted(path.stem for path in ROOT.glob("0*.py"))
IMPORT_THEN_TEST = f"""
import importlib, pytest, sys
for name in {STAGES}:
    importlib.import_module(name)
print("imported", flush=True)
sys.exit(pytest.main(["-o", "addopts=", "-p", "debug", "-p", "no:cacheprovider", *sys.argv[1:]]))
"""


@pytest.mark.parametrize("name", BUGS)
def test_a_bug_changes_little_in_one_stage_and_can_be_taken_out(name, tmp_path, monkeypatch):
    debug.copied(tmp_path)
    monkeypatch.setattr(debug, "ROOT", tmp_path)
    stage = tmp_path / debug.read_bug(name)[0]
    good = stage.read_text("utf-8")
    main_of("debug.py", monkeypatch, "put", name)
    new = set(stage.read_text("utf-8").splitlines()) - set(good.splitlines())
    assert 0 < len(new) <= 6, f"one bug, not a rewrite: {new}"
    with pytest.raises(SystemExit, match="2"):  # it is in already
        main_of("debug.py", monkeypatch, "put", name)
    main_of("debug.py", monkeypatch, "undo", name)
    assert ast.dump(ast.parse(stage.read_text("utf-8"))) == ast.dump(ast.parse(good))


def test_a_bug_is_found_in_any_layout_and_only_if_it_is_there_once():
    source = "def f(x):\n    y = g(\n        x, 1\n    )  # of g\n    return y\n"
    bad = "def f(x):\n    y = g(x, 2)\n    z = y  # of g\n    return y\n"
    assert debug.exchanged(source, "y = g(x, 1)", "y = g(x, 2)\nz = y") == bad
    for text, count in ((bad, 0), ("yy = g(x, 1)", 0), (2 * source, 2)):
        with pytest.raises(ValueError, match=f"must be there once, and are {count} times:\ny = g"):
            debug.exchanged(text, "y = g(x, 1)", "")


@pytest.mark.slow
@pytest.mark.parametrize("name", BUGS)
def test_a_bug_is_silent_and_caught_by_the_test_that_debug_md_names(name, tmp_path):
    debug.copied(tmp_path)
    debug.put(name, tmp_path)
    section = PAGE.split(f"\n## {name}: ")[1]
    module, begins = re.search(r"Our own test</summary>\s+`(test_\w+)\.(\w+)`", section).groups()
    files = tmp_path.glob(f"tests/**/{module}.py")
    done = python("-c", IMPORT_THEN_TEST, *files, "-k", f"test_{begins}", cwd=tmp_path)
    assert done.stdout.startswith("imported\n"), f"it is not silent: {done.stderr}"
    assert done.returncode == debug.CAUGHT, f"not caught by an assertion: {done.stdout}"


WRAPPED = """
from importlib import import_module
import numpy as np

def test_angles_are_wrapped():
    d, alpha, beta = import_module("03_env").polar(np.array([1.0, 0.0, 4.0]))
"""
SLIDES = """
from dataclasses import replace
from importlib import import_module

def test_feet_stay_where_they_are_pulled_by_less_than_friction():
    robot_model = import_module("01_robot_model")
    robot = replace(robot_model.ROBOT, friction=0.4)
    sim = robot_model.PymunkSim(1, robot_model.stance(robot, True), robot)
    sim.reset([0])
    space, bodies, _ = sim.worlds[0]
    before = bodies[3].position.x
    for _ in range(50):
        for foot in bodies[3], bodies[6]:
            foot.force = 0.3 * robot.gravity * sum(body.mass for body in bodies) / 2, 0.0
        space.step(0.002)
    assert bodies[3].position.x - before < 0.001
"""


@pytest.mark.slow
@pytest.mark.parametrize("bug, test, says", [
    ("tired", WRAPPED + "    assert alpha > 3.2", "Without a bug your test must pass"),
    ("tired", WRAPPED + "    assert alpha < 3.2", "With tired it must fail by an assertion"),
    ("stubborn", WRAPPED + "    alpha < 3.2 or {}['an AssertionError']", "With stubborn it must"),
    ("stubborn", WRAPPED + "    assert alpha < 3.2", "fails with stubborn: well done"),
    ("skates", SLIDES, "fails with skates: well done"),
    ("skates", "while True:\n    pass", "takes longer than 1 s"),
])  # fmt: skip
def test_a_student_s_test_is_judged_with_and_without_the_bug(
    tmp_path, monkeypatch, bug, test, says
):
    debug.copied(tmp_path)
    debug.put("stubborn", tmp_path)  # somebody has left one in
    monkeypatch.setattr(debug, "ROOT", tmp_path)
    monkeypatch.setattr(debug, "PATIENCE", 300 if "def" in test else 1)
    (tmp_path / "mine.py").write_text(test, "utf-8")
    try:
        said = debug.judged(tmp_path / "mine.py", bug)
    except SystemExit as error:
        said = str(error)
    assert says in said and "Warning" not in said, said
