"""What the exercise book names exists: `03.polar`, `walk.measure`, `test_03_env.goal_is`."""

import re
from importlib import import_module

import pytest
from sheet import ROOT
from workbook import BOOK  # of tests/course

PAGES = "README.md", "debug.md", "ledger.md", "predict.md", "projects.md"
TEXT = {page: (ROOT / "tests" / "course" / page).read_text("utf-8") for page in PAGES}
STAGES = {path.stem[:2]: path.stem for path in ROOT.glob("0*.py")}
STUDIES = "|".join(path.stem for path in (ROOT / "tests" / "studies").glob("*.py"))
EXERCISES = [f"build.{name}" for name in BOOK]
for kind in "predict", "debug":  # "## lean: At which lean …"
    heads = re.findall(r"^## (\w+):", TEXT[f"{kind}.md"], re.MULTILINE)
    EXERCISES += [f"{kind}.{name}" for name in heads]
NAME = re.compile(rf"`((?:0\d|test_\w+)(?:\.\w+)*|(?:build|predict|debug|{STUDIES})(?:\.\w+)+)`")


def exists(place, *path):
    """Is there a thing like 03.polar? place "03", path "polar"."""
    name = ".".join(path)
    if place in ("build", "predict", "debug"):
        return f"{place}.{name}" in EXERCISES
    if place.startswith("test_"):
        files = (ROOT / "tests").rglob(f"{place}.py")
        return any(f"def test_{name}" in file.read_text("utf-8") for file in files)
    thing = import_module(STAGES.get(place, place))
    for part in path:
        thing = getattr(thing, "__dataclass_fields__", {}).get(part) or getattr(thing, part)
    return True


@pytest.mark.parametrize("page", PAGES)
def test_everything_that_is_named_exists(page):
    wrong = [name for name in NAME.findall(TEXT[page]) if not exists(*name.split("."))]
    assert not wrong, f"tests/course/{page} names what is not there"


def test_every_exercise_belongs_to_a_lesson():
    absent = [name for name in EXERCISES if f"`{name}`" not in TEXT["README.md"]]
    assert not absent, "in which lesson are these done?"


def test_the_field_of_the_contest_is_that_of_the_shipped_walks():
    judge = import_module("judge")
    field = judge.ranking(judge.noisy(judge.ROOT / "results" / "mujoco"))
    assert f"<!-- contest -->\n{field}<!-- end -->" in TEXT["projects.md"], "judge.py prints it"
