"""Tries solutions: a function takes the place of ours while the tests of its exercise run.

for case, said in zip(cases, graded(cases)): …      cases: a list, of `written` or of `by_rule`
"""

import ast
import contextlib
import io
import sys
from collections import namedtuple
from importlib import import_module
from operator import attrgetter
from pathlib import Path

import grading
import pytest
import sheet
from workbook import BOOK, graded_by

from .mutants import SLOW, mutants

Case = namedtuple(
    "Case",
    (
        "exercise",
        "functions",  # {name: source} of what takes our places
        "mistake",  # what is wrong, for the reader
        "words",  # that the grader must say; "": any, or none
    ),
)
PLACE = {path.split(".")[-1]: (row, path) for row in BOOK.values() for path in row.functions}


def text_of(exercise):
    return sheet.find(BOOK[exercise].file).read_text("utf-8")


def written():
    """The cases of right.py and of wrong.py."""
    texts = [Path(__file__).with_name(file).read_text("utf-8") for file in ("right.py", "wrong.py")]
    for node in ast.parse("".join(texts)).body:
        if isinstance(node, ast.FunctionDef) and node.name in PLACE:
            row, _ = PLACE[node.name]
            marks = [[text.value for text in mark.args] for mark in node.decorator_list]
            node.decorator_list = []
            for mistake, *words in marks or [[ast.get_docstring(node)]]:
                yield Case(row.name, {node.name: ast.unparse(node)}, mistake, "".join(words))


def by_rule():
    """The cases of mutants.py, of most exercises without those that take minutes."""
    for row in BOOK.values():
        tree = ast.parse(text_of(row.name))
        for path in row.functions:
            node = sheet.function_in(tree, path)
            for mistake, place, source in mutants(node, row.since):
                if mistake.startswith(SLOW.get(path, "")):
                    said = f"{node.name}: {mistake}, in: {place}"
                    yield Case(row.name, {node.name: source}, said, "")


def rounded(value, sign):
    """The same numbers, but for a few errors of rounding."""
    if isinstance(value, dict):
        return {key: rounded(one, sign) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(one, sign) for one in value]
    kind = str(getattr(value, "dtype", type(value)))
    if "float" not in kind:
        return value
    return value * (1 + sign * (2e-7 if "32" in kind else 4e-16)) + sign * 1e-17


def ours_rounded():
    """Our own functions, as if they were computed in another order."""
    for name, (row, path) in PLACE.items():
        if name not in SLOW:
            node = sheet.function_in(ast.parse(text_of(row.name)), path)
            node.name = "ours"
            lines = [f"def {name}(*args, **more):", "from solutions.referee import rounded"]
            lines += [
                *ast.unparse(node).splitlines(),
                "return rounded(ours(*args, **more), mistake)",
            ]
            for sign in 1, -1:
                yield Case(row.name, {name: "\n    ".join(lines)}, sign, "")


def emptied(names, exercise, words=""):
    """A case of this exercise in a sheet where these are empty."""
    functions = {}
    for row in (BOOK[name] for name in names):
        tree = ast.parse(sheet.emptied(text_of(row.name), row))
        nodes = [sheet.function_in(tree, path) for path in row.functions]
        functions |= {node.name: ast.unparse(node) for node in nodes}
    return Case(exercise, functions, "", words)


def put(patch, name, source, mistake):
    """A function takes the place of that of its name, wherever a module of ours has it."""
    row, path = PLACE[name]
    module = import_module(row.file)
    owner = attrgetter(path.rpartition(".")[0])(module) if "." in path else module
    # Outside of its class a method cannot say super().
    source = source.replace("super()", f"super({path.partition('.')[0]}, self)")
    made = {}
    exec(source, vars(module), made)  # it sees what stands in its module, and `mistake`
    patch.setattr(module, "mistake", mistake, raising=False)
    patch.setattr(module, "ours", getattr(owner, name), raising=False)
    old, new = getattr(owner, name), made[name]
    if owner is not module:
        patch.setattr(owner, name, new)
        return
    for place in list(sys.modules.values()):
        held = getattr(place, "__dict__", {})
        if str(held.get("__file__")).startswith(str(sheet.ROOT)):  # a module of ours
            for other in [key for key, value in held.items() if value is old and key != "ours"]:
                patch.setattr(place, other, new)


class Referee:
    """A plugin of pytest: runs the tests of an exercise once for each case. `said` gets a list for
    each: what the failing tests say, at most four as a student reads, none after its words.
    """

    def __init__(self, cases):
        self.cases, self.said = cases, []

    def pytest_runtestloop(self, session):
        for case in self.cases:
            row = BOOK[case.exercise]
            tests, said = [], []
            for beginning in row.tests:  # in this order those that train come last
                one = row._replace(tests=(beginning,))
                found = [item for item in session.items if graded_by(one, item.nodeid)]
                tests += found
                if not found:
                    said.append(f"{row.grader}.py cannot be imported, or has no {beginning}…")
            self.said.append(said)
            with pytest.MonkeyPatch.context() as patch:
                for name, source in case.functions.items():
                    put(patch, name, source, case.mistake)
                for item in tests:
                    item.ihook.pytest_runtest_protocol(item=item, nextitem=None)
                    if len(said) == 4 or any(case.words in text for text in said):
                        break
        return True

    def pytest_runtest_logreport(self, report):
        if report.failed and grading.hint(report) not in self.said[-1]:
            self.said[-1].append(grading.hint(report))


def graded(cases):
    """What the failing tests say, a list for each case."""
    referee, printed = Referee(cases), io.StringIO()
    graders = {BOOK[case.exercise].grader for case in cases}
    files = [str(sheet.ROOT / "tests" / f"{grader}.py") for grader in sorted(graders)]
    # Without what takes time after each test or at the end
    needless = ("cacheprovider", "logging", "unraisableexception", "threadexception")
    flags = ["--tb=native", "--no-summary", *(f"-pno:{plugin}" for plugin in needless)]
    with contextlib.redirect_stdout(printed):
        code = pytest.main([*files, *flags], [referee])
    assert code in (0, 1) and len(referee.said) == len(cases), printed.getvalue()[-2000:]
    return referee.said
