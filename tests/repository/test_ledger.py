"""What the exercise book names exists: `03.polar`, `walk.measure`, `test_03_env.goal_is`."""

import re
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest
from test_scripts import told
from workbook import BOOK  # of tests/course

TESTS = Path(__file__).resolve().parents[1]
PAGES = ("README.md", "debug.md", "ledger.md", "predict.md", "projects.md")
TEXT = {page: (TESTS / "course" / page).read_text("utf-8") for page in PAGES}
STAGES = {path.stem[:2]: path.stem for path in TESTS.parent.glob("0*.py")}
STUDIES = [path.stem for path in (TESTS / "studies").glob("*.py")]
HEADING = re.compile(r"^## (\w+):", re.MULTILINE)  # "## lean: At which lean …"
EXERCISES = {
    "build": list(BOOK),
    "predict": HEADING.findall(TEXT["predict.md"]),
    "debug": HEADING.findall(TEXT["debug.md"]),
}
WITH_A_DOT = "|".join([*EXERCISES, *STUDIES])  # `search` alone is a planner
NAME = re.compile(rf"`(0\d|test_\w+|(?:{WITH_A_DOT})(?=\.))((?:\.\w+)*)`")


def exists(place, path):
    """Is there a thing like 03.polar? place "03", path ["polar"]."""
    name = ".".join(path)
    if place in EXERCISES:
        return name in EXERCISES[place]
    if place.startswith("test_"):
        files = TESTS.rglob(f"{place}.py")
        return any(f"def test_{name}" in file.read_text("utf-8") for file in files)
    module = STAGES.get(place, place)
    if find_spec(module) is None:
        return False
    thing = import_module(module)
    for part in path:
        settings = getattr(thing, "__dataclass_fields__", {})
        thing = settings.get(part) or getattr(thing, part, None)
    return thing is not None


@pytest.mark.parametrize("page", PAGES)
def test_everything_that_is_named_exists(page):
    wrong = [
        f"tests/course/{page}, line {number}: there is no `{place}{rest}`"
        for number, line in enumerate(TEXT[page].splitlines(), 1)
        for place, rest in NAME.findall(line)
        if not exists(place, rest.split(".")[1:])
    ]
    assert not wrong, "\n".join(wrong)
    found = NAME.findall(TEXT[page])
    assert len(found) > 3, f"{page} names nothing: has its notation changed?"


@pytest.mark.parametrize("kind", EXERCISES)
def test_every_exercise_belongs_to_a_lesson(kind):
    absent = [name for name in EXERCISES[kind] if f"`{kind}.{name}`" not in TEXT["README.md"]]
    assert not absent, f"in which lesson is {kind}.{absent} done?"


@pytest.mark.shipped
@pytest.mark.parametrize("name", ["circle", "concentration"])
def test_the_quick_experiments_print_what_is_told(name, capsys):
    import_module("predict").EXPERIMENTS[name]("pymunk")
    assert capsys.readouterr().out.splitlines() == told(name), "predict.md shows it"


@pytest.mark.shipped
def test_predictions_were_measured_with_the_walk_that_is_used():
    tuned = import_module("02_walk_engine").TUNED["mujoco"].foot_rise
    assert f"| {tuned}, tuned |" in TEXT["predict.md"], f"foot_rise is {tuned}: measure it anew"


def test_the_field_of_the_contest_is_that_of_the_shipped_walks():
    judge = import_module("judge")
    field = judge.ranking(judge.noisy(judge.ROOT / "results" / "mujoco"))
    assert f"<!-- contest -->\n{field}<!-- end -->" in TEXT["projects.md"], "judge.py prints it"
