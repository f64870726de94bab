"""The exercise book speaks of functions, settings, tests and exercises that exist.

In every Markdown file of tests/exercises a name in backticks like `03.polar`, `test_env.goal_is`,
`build.gae`, `predict.lean` or `debug.tired` is looked up; a message says which line is wrong.
"""

import ast
import re
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest
from workbook import BOOK  # of tests/exercises

TESTS = Path(__file__).resolve().parent
BOOKS = TESTS / "exercises"
STAGES = {path.stem[:2]: path.stem for path in TESTS.parent.glob("0*.py")}
PAGES = ("course.md", "debug.md", "ledger.md", "predict.md", "projects.md")
NAME = re.compile(r"`(0\d|test_\w+|build|predict|debug)((?:\.\w+)*)`")
VERDICTS = ("reproduced", "changed", "unknown", "left out")

def lines(page):
    """(number, line) of a page."""
    return list(enumerate((BOOKS / page).read_text(encoding="utf-8").splitlines(), 1))

@cache
def headings(page):
    """The words that name the exercises of a page: `## lean: At which lean …`."""
    found = (re.match(r"## (\w+):", line) for _, line in lines(page))
    return {match[1] for match in found if match}

@cache
def names_in(module):
    """Names of the test functions in a file, or None without such a file."""
    path = TESTS / f"{module}.py"
    if not path.is_file():
        return None
    return [node.name for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")]

def in_stage(stage, path):
    """Is there such a function, class, method, constant or setting?"""
    thing = import_module(STAGES[stage])
    for part in path:
        if part in getattr(thing, "__dataclass_fields__", {}):
            return part == path[-1]  # a setting has no parts of its own
        if not hasattr(thing, part):
            return False
        thing = getattr(thing, part)
    return True

def problem(place, path):
    """What is wrong with a name like 03.polar, or ""."""
    if place.isdigit():
        if place not in STAGES:
            return f"there is no stage {place}"
        return "" if in_stage(place, path) else f"stage {STAGES[place]} has no {'.'.join(path)}"
    if place.startswith("test_"):
        names = names_in(place)
        if names is None:
            return f"there is no tests/{place}.py"
        begins = f"test_{'.'.join(path)}" if path else ""
        found = any(name.startswith(begins) for name in names)
        return "" if found else f"no test in tests/{place}.py begins with {begins}"
    known = {"build": set(BOOK), "predict": headings("predict.md"), "debug": headings("debug.md")}
    return "" if ".".join(path) in known[place] else f"there is no exercise {'.'.join(path)}"

@pytest.mark.parametrize("page", PAGES)
def test_everything_that_is_named_exists(page):
    found, wrong = 0, []
    for number, line in lines(page):
        for place, rest in NAME.findall(line):
            found += 1
            reason = problem(place, rest.split(".")[1:])
            if reason:
                wrong.append(f"tests/exercises/{page}, line {number}: `{place}{rest}`: {reason}")
    assert not wrong, "\n".join(wrong)
    assert found > 3, f"{page} names nothing: has its notation changed?"

@pytest.mark.parametrize("place, path, reason", [
    ("03", ["polar"], ""), ("03", ["polarr"], "has no polarr"), ("09", ["x"], "no stage 09"),
    ("03", ["Task", "success_m"], ""), ("02", ["StepLimits", "low"], ""),
    ("03", ["Task", "gone"], "has no Task.gone"), ("02", ["WalkEngine", "plan"], ""),
    ("test_env", ["goal_is"], ""), ("test_env", ["goal_was"], "begins with test_goal_was"),
    ("test_nothing", [], "no tests/test_nothing.py"), ("build", ["gae"], ""),
    ("build", ["gay"], "no exercise gay"), ("debug", ["nothing"], "no exercise nothing"),
])
def test_names_that_do_not_exist_are_noticed(place, path, reason):
    got = problem(place, path)
    assert got.endswith(reason) if reason else not got, got

def test_every_row_of_the_ledger_has_a_verdict():
    rows = [(number, line) for number, line in lines("ledger.md") if line.startswith("|")]
    assert len(rows) > 50, "the ledger is one table"
    for number, line in rows[2:]:
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        where = f"tests/exercises/ledger.md, line {number}"
        assert len(cells) == 5, f"{where}: {len(cells)} cells instead of 5"
        assert cells[4].startswith(VERDICTS), f"{where}: begins with none of {VERDICTS}"
        if not cells[4].startswith("left out"):
            assert NAME.search(cells[2]), f"{where}: who implements it?"
            assert NAME.search(cells[3]), f"{where}: who tests it?"

@pytest.mark.parametrize("part", ["I", "II a", "II b", "II c", "II d", "II e", "III", "IV", "(1)",
                                  "Table I", "Table II", "Fig. 1", "Fig. 2", "Fig. 3",
                                  *(f"[{number}]" for number in range(3, 11))])
def test_the_ledger_leaves_out_no_part_of_the_paper(part):
    text = "\n".join(line for _, line in lines("ledger.md") if line.startswith("|"))
    assert re.search(rf"(^| ){re.escape(part)}( |,|$)", text, re.MULTILINE), f"where is {part}?"

@pytest.mark.parametrize("exercise", BOOK)
def test_every_exercise_to_build_belongs_to_a_lesson(exercise):
    text = (BOOKS / "course.md").read_text(encoding="utf-8")
    assert f"`build.{exercise}`" in text, "in which lesson is it written?"

@pytest.mark.parametrize("kind", ["predict", "debug"])
def test_every_other_exercise_belongs_to_a_lesson(kind):
    text = (BOOKS / "course.md").read_text(encoding="utf-8")
    for name in headings(f"{kind}.md"):
        assert f"`{kind}.{name}`" in text, f"in which lesson is {kind}.{name} done?"

@pytest.mark.parametrize("page", PAGES)
def test_pages_fit_the_screen(page):
    for number, line in lines(page):
        assert len(line) <= 110 or line.startswith("|"), f"{page}, line {number} is too long"

@pytest.mark.parametrize("name", ["circle", "sharpness"])
def test_the_quick_experiments_print_what_is_told(name, capsys):
    import_module("predict").EXPERIMENTS[name]("pymunk")
    told = (BOOKS / "predict.md").read_text(encoding="utf-8")
    for line in capsys.readouterr().out.splitlines():
        assert line.strip() in told, f"predict.md does not show {line!r}"

@pytest.mark.parametrize("name", ["foot_rise", "double_support"])
def test_predictions_were_measured_with_the_walk_that_is_used(name):
    tuned = getattr(import_module("02_walk_engine").TUNED["mujoco"], name)
    told = (BOOKS / "predict.md").read_text(encoding="utf-8")
    assert f"| {tuned}, tuned |" in told, f"{name} is {tuned} now: measure predict.md anew"
