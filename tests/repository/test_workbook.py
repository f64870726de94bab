"""The exercises: clean sheets, and a grading that rejects wrong solutions with words that fit."""

import ast
import contextlib
import functools
import inspect
import io
import os
import re
import shlex
import subprocess
import sys
from collections import Counter
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace

import grading
import pytest
import sheet
import workbook
from solutions.mutants import mutants
from workbook import BOOK

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "tests" / "exercises"
README = (FOLDER / "README.md").read_text("utf-8")


def run(*arguments, cwd=ROOT, **environment):
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        cwd=cwd,
        text=True,
        timeout=300,
        capture_output=True,
        encoding="utf-8",
        env={**os.environ, "PYTHONIOENCODING": "utf-8", **environment},
    )


def grade(folder, *more, cwd=ROOT):
    return run(
        "-m", "pytest", ROOT / "tests", "-p", "no:cacheprovider", "--stages", folder, *more, cwd=cwd
    )


def last_words(done):
    """What a student reads at last."""
    _, found, words = done.stdout.rpartition(" what to mend ")
    assert found, f"the grading does not come to its end:\n{done.stdout[-2000:]}"
    return words


def text_of(name):
    return sheet.find(BOOK[name].file).read_text("utf-8")


def test_readme_and_list_agree():
    heads = re.findall(r"^#### (\w+) (★+) (\d+) minutes$", README, re.MULTILINE)
    assert heads == [(name, "★" * row.stars, str(row.minutes)) for name, row in BOOK.items()], (
        "tests/exercises/README.md: #### name, stars, minutes in the order of workbook.py"
    )
    place = ""
    for part in re.split(r"^(?=###)", README, flags=re.MULTILINE):
        place = (re.findall(r"^### .*`(\w+)\.py`$", part, re.MULTILINE) or [place])[0]
        if part.startswith("#### "):
            row = BOOK[part.split()[1]]
            assert place == row.file, f"{row.name} is in {row.file}.py"
            for said in ("<summary>Hints</summary>", "You learn ", *row.functions):
                assert said in part, f"{row.name}: where is {said}?"


def test_a_sheet_keeps_docstrings_and_equations_and_all_other_code():
    for file, empty in sheet.sheets(BOOK).items():
        source = sheet.find(Path(file).stem).read_text("utf-8")
        tree = ast.parse(source)
        for row in (row for row in BOOK.values() if row.file == Path(file).stem):
            for function in row.functions:
                node = sheet.function_in(tree, function)
                first = 1 if ast.get_docstring(node) else 0
                while not ast.unparse(node.body[first]).startswith(row.since):
                    first += 1
                stub = f"raise NotImplementedError('exercise: {row.name}')"
                node.body[first:] = ast.parse(stub).body
        assert ast.unparse(ast.parse(empty)) == ast.unparse(tree), file
        kept, comments = (re.findall(r"^ *(#.*)", text, re.MULTILINE) for text in (empty, source))
        assert kept == comments, f"{file}: all comments stay, for they hold the equations"


def test_sheets_are_written_from_any_folder_and_work_is_not_overwritten(tmp_path):
    script, out = FOLDER / "sheet.py", tmp_path / "my exercises"
    done = run(script, "--out", "my exercises", cwd=tmp_path, PYTHONIOENCODING="cp1252")
    assert done.returncode == 0, done.stderr
    assert {path.name for path in out.iterdir()} == {f"{row.file}.py" for row in BOOK.values()}
    assert "/exercises/" in (ROOT / ".gitignore").read_text("utf-8"), "a student's work"
    assert workbook.command("wrap", '"' + out.resolve().as_posix() + '"') in done.stdout
    mine, solved = out / "04_ppo.py", out / "05_evaluate.py"
    mine.write_text("# a night's work\n")
    solved.write_text("# solved\n")
    again = run(script, "--out", out)
    (line,) = again.stderr.splitlines()
    assert again.returncode == 2 and "--force" in line and mine.read_text() == "# a night's work\n"
    assert run(script, "--out", out, "--force", "--only", "gae").returncode == 0
    assert mine.read_text("utf-8").count("exercise: ") == 1
    assert solved.read_text() == "# solved\n", "files of other exercises stay"


@pytest.mark.parametrize(
    "arguments, mention",
    [
        (["--only", "gea"], "gea"),
        (["--out", str(ROOT), "--force"], "solutions"),
        (["--out", str(FOLDER / "sheet.py"), "--force"], "cannot write"),
    ],
    ids=str,
)
def test_a_sheet_that_cannot_be_written_is_one_line(arguments, mention):
    done = run(FOLDER / "sheet.py", *arguments)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1, done.stderr
    assert mention in done.stderr


def submission(folder, **bodies):
    """A folder with the files of these exercises only; None: empty, else another body."""
    folder.mkdir()
    for name, body in bodies.items():
        row, path = BOOK[name], folder / f"{BOOK[name].file}.py"
        text = path.read_text("utf-8") if path.exists() else text_of(name)
        text = (
            sheet.emptied(text, row)
            if body is None
            else sheet.replaced(text, row.functions[0], body.splitlines())
        )
        path.write_text(text, encoding="utf-8", newline="\n")
    return folder


@pytest.mark.slow
def test_an_empty_sheet_can_be_graded(tmp_path):
    sheets = tmp_path / "exercises"
    assert run(FOLDER / "sheet.py", "--out", sheets).returncode == 0
    done = grade(sheets)
    words = last_words(done)
    assert done.returncode == 1 and f"0 of {len(BOOK)} exercises solved" in words
    assert "not graded" not in words, "every test module can be imported while all is empty"
    reasons = re.findall(r"^  - (.*)$", words, re.MULTILINE)
    assert set(reasons) <= {f"{name} is not written yet" for name in BOOK}, reasons
    assert not list(sheets.glob("__pycache__")), "nothing of ours in a student's folder"


def test_a_submission_of_few_files_is_graded_from_any_folder(tmp_path):
    folder = submission(tmp_path / "alice smith", wrap=None, compose="return base + pose")
    (folder / "04_ppo.py").write_text("def gae(:\n", "utf-8")
    done = grade("alice smith", "-k", "wrap or compose or low_pass or gae", cwd=tmp_path)
    words = last_words(done)
    assert done.returncode == 1 and "grading" in done.stdout and "01_robot_model.py" in done.stdout
    assert re.search(
        r"compose ★: 0 of \d tests pass\n  - first turn the pose .*\n"
        r"  Hints: tests/exercises/README.md, exercise \"compose\"\n",
        words,
    ), words
    assert re.search(r"wrap ★: 0 of \d tests pass\n  - wrap is not written yet\n", words), words
    assert "low_pass ★: not handed in, there is no 05_evaluate.py" in words
    assert "  - 04_ppo.py, line 1: SyntaxError: invalid syntax" in words, "and others are graded"
    assert "alice smith: 0 of 4 exercises solved, 0 of 5 stars" in words
    assert len(words.splitlines()) <= 15, "the hints come last, and in a few lines"


def test_who_skips_or_exits_gets_no_stars_and_the_others_keep_theirs(tmp_path):
    folder = submission(tmp_path / "bob", compose='import pytest\npytest.skip("later")')
    (folder / "05_evaluate.py").write_text("import sys\nsys.exit()\n", "utf-8")
    command = workbook.command('"wrap or compose or low_pass"', folder)  # as the sheets say it
    words = last_words(run(*shlex.split(command)[1:]))
    assert re.search(r"compose ★: 0 of \d tests pass", words), words
    assert "wrap ★: solved" in words
    assert re.search(r"low_pass ★: 0 of \d tests pass\n  - .*ends Python", words), words
    assert "bob: 1 of 3 exercises solved, 1 of 3 stars" in words


@pytest.mark.skipif(sys.platform == "win32", reason="README has another line for PowerShell")
def test_marks_of_a_submission_that_ended_python_are_no_result(tmp_path):
    (tmp_path / "marks_ada.txt").write_text("ada: 1 of 1 exercises solved, 2 of 2 stars\n")
    (tmp_path / "marks_bob.txt").touch()
    (line,) = re.findall(r"^for marks in .*$", README, re.MULTILINE)
    done = subprocess.run(line, shell=True, cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout.splitlines() == [
        "ada: 1 of 1 exercises solved, 2 of 2 stars",
        "marks_bob.txt: no result",
    ]


@pytest.mark.parametrize(
    "folder, mention", [("missing", "there is no such folder"), (".", "neither a stage")]
)
def test_a_wrong_folder_is_one_line(tmp_path, folder, mention):
    done = grade(tmp_path / folder, "-k", "gae")
    assert done.returncode == 4 and mention in done.stderr and "Traceback" not in done.stderr


@pytest.mark.slow
def test_an_endless_loop_is_stopped(tmp_path):
    assert grading.PATIENCE == 60
    folder = submission(tmp_path / "slow", low_pass="while True:\n    pass")
    done = run(
        "-c",
        "import sys, grading, pytest\ngrading.PATIENCE = 3\nsys.exit(pytest.main(sys.argv[1:]))",
        "tests",
        "--stages",
        folder,
        "-k",
        "low_pass or wilson",
        "-p",
        "no:cacheprovider",
        PYTHONPATH=os.pathsep.join([str(ROOT / "tests" / "repository"), str(FOLDER)]),
    )
    words = last_words(done)
    assert "takes longer than 3 s: a loop that never ends?" in words, words
    assert "wilson ★: solved" in words, "the others are graded nevertheless"


def test_what_a_failing_test_says_is_freed_from_what_pytest_and_numpy_add():
    def said(message):
        longrepr = SimpleNamespace(reprcrash=SimpleNamespace(message=message))
        return grading.hint(SimpleNamespace(nodeid="x.py::test_gae_is_right", longrepr=longrepr))

    assert said("AssertionError: mind the\n  sign\nassert 1 == 2") == "mind the sign"
    assert (
        said(
            "AssertionError: \nNot equal to tolerance rtol=1e-07, atol=0\nits sign\n"
            "Mismatched elements: 1 / 2 (50%)\nMismatch at index:\n [1]: -3.0 (ACTUAL), 3.0 "
            "(DESIRED)\nMax absolute"
        )
        == "its sign (got -3.0, expected 3.0 at [1])"
    )
    assert (
        said(
            "AssertionError: its sign\nassert -3.0 == 3.0 ± 1e-9\n  \n  comparison failed\n"
            "  Obtained: -3.0\n  Expected: 3.0"
        )
        == "its sign (got -3.0, expected 3.0)"
    )
    assert said("ValueError: output array is read-only") == "what is given must not be written to"
    assert said("assert 1 == 2\n + where") == "gae is right: assert 1 == 2"
    assert said("TypeError: no such thing") == "TypeError: no such thing"


PLACE = {path.split(".")[-1]: (row, path) for row in BOOK.values() for path in row.functions}


def solutions(file):
    """(function's name, source, mistake, words of the grader) for all of right.py or of wrong.py."""
    for node in ast.parse((FOLDER / "solutions" / file).read_text("utf-8")).body:
        if isinstance(node, ast.FunctionDef) and node.name in PLACE:
            marks = [[ast.literal_eval(text) for text in mark.args] for mark in node.decorator_list]
            node.decorator_list = []
            for mistake, words in marks or [(ast.get_docstring(node), "")]:
                yield node.name, ast.unparse(node), mistake, words


def making(function, mistake):
    """The function, with its last argument."""

    @functools.wraps(function)
    def call(*args, **kwargs):
        return function(*args, **kwargs, mistake=mistake)

    return call


def put(patch, function, source, mistake):
    """A function takes the place of that of its name, wherever a module of ours has it."""
    row, path = PLACE[function]
    module = import_module(row.file)
    owner = attrgetter(path.rpartition(".")[0])(module) if "." in path else module
    # Outside of its class a method cannot say super().
    source = source.replace("super()", f"super({path.partition('.')[0]}, self)")
    written = {}
    exec(source, vars(module), written)  # it sees what stands in its module
    old, new = getattr(owner, function), written[function]
    if "mistake" in inspect.signature(new).parameters:
        new = making(new, mistake)
    if owner is not module:
        patch.setattr(owner, function, new)
        return
    for place in list(sys.modules.values()):
        held = getattr(place, "__dict__", {})
        if str(held.get("__file__")).startswith(str(ROOT)):  # a module of ours
            for name in [name for name, value in held.items() if value is old]:
                patch.setattr(place, name, new)


class Referee:
    """A plugin of pytest: runs the tests of an exercise once for each case: an exercise, [(name,
    source, mistake)] of the functions that take our places, words. `said` gets a list for each
    case: what the failing tests say, at most four as a student reads, none after these words.
    """

    def __init__(self, cases):
        self.cases, self.said = cases, []

    def pytest_runtestloop(self, session):
        named = [(f"{item.path.stem}.{item.originalname}", item) for item in session.items]
        for name, functions, words in self.cases:
            grader, *beginnings = BOOK[name].tests
            # In the order of workbook.py, where the tests that train come last.
            tests, said = [], []
            for beginning in (f"{grader}.test_{beginning}" for beginning in beginnings):
                found = [item for name, item in named if name.startswith(beginning)]
                tests += found
                if not found:
                    said.append(f"{grader}.py cannot be imported, or has no {beginning}…")
            self.said.append(said)
            with pytest.MonkeyPatch.context() as patch:
                for function in functions:
                    put(patch, *function)
                for item in tests:
                    item.ihook.pytest_runtest_protocol(item=item, nextitem=None)
                    if len(said) == 4 or any(words in text for text in said):
                        break
        return True

    def pytest_runtest_logreport(self, report):
        if report.failed and grading.hint(report) not in self.said[-1]:
            self.said[-1].append(grading.hint(report))


def graded(cases):
    """What the failing tests say, a list for each case."""
    referee, printed = Referee(cases), io.StringIO()
    files = {str(ROOT / "tests" / f"{BOOK[name].tests[0]}.py") for name, _, _ in cases}
    # Without what takes time after each test or at the end
    needless = ("cacheprovider", "logging", "unraisableexception", "threadexception")
    flags = ["--tb=native", "--no-summary", *(f"-pno:{plugin}" for plugin in needless)]
    with contextlib.redirect_stdout(printed):
        code = pytest.main([*sorted(files), *flags], [referee])
    assert code in (0, 1) and len(referee.said) == len(cases), printed.getvalue()[-2000:]
    return referee.said


def empty(names):
    """[(name, source, "")] of the functions of these exercises in an empty sheet."""
    trees = [(BOOK[name], ast.parse(sheet.emptied(text_of(name), BOOK[name]))) for name in names]
    found = [sheet.function_in(tree, path) for row, tree in trees for path in row.functions]
    return [(node.name, ast.unparse(node), "") for node in found]


@pytest.mark.parametrize("file", ["wrong.py", "right.py"])
@pytest.mark.parametrize("trains", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_wrong_solutions_are_rejected_with_words_that_fit_and_right_ones_accepted(file, trains):
    found = [
        (PLACE[name][0].name, [(name, source, mistake)], words)
        for name, source, mistake, words in solutions(file)
        if (name == "improve") == trains
    ]
    problems = [
        f"{name}: “{mistake}” must get “{words or 'no complaint'}”, but gets {said}"
        for (name, ((*_, mistake),), words), said in zip(found, graded(found))
        if not (any(words in text for text in said) if words else not said)
    ]
    assert not problems, "\n".join(problems)


TRAIN_OR_SEARCH = "improve", "steps_to_go"  # a mistake by rule may take minutes there
HARMLESS = {  # so many mistakes that compute the same, or that nobody should ask for
    "wrap: instead of Add": 1,  # half a turn ahead, or back
    "fallen: instead of cos": 1,  # sin 45° = cos 45°
    "leg_inverse: instead of 1": 1,  # no knee folds so far
    "_swing: instead of 0": 2,  # an acceleration of 1 m/s² where the height turns
    "_swing: writes into what is given": 1,  # the engine does not use it any more
    "_knot: instead of Mult": 1,  # by a sign
    "reward_terms: exchanged in Sub": 1,  # squared
    "reward_terms: arguments exchanged": 1,
    "bootstrap: instead of 0": 1,  # another seed
    "highest_speed: exchanged in Sub": 1,  # of both signs
    "look_up: exchanged in a row": 2,  # corners in another order
    "log_beta_function: arguments exchanged": 1,  # B(α, β) = B(β, α)
    "beta_log_prob: exchanged in log_beta_function": 1,
    "beta_entropy: exchanged in log_beta_function": 1,
    "beta_entropy: arguments exchanged": 1,
    "beta_mode: instead of Add": 1,  # 0.5 is right wherever α = β
    "beta_mode: left of Add alone": 1,  # 0/0, where nobody looks
}


@pytest.mark.filterwarnings("ignore::SyntaxWarning")  # of mistakes
def test_small_mistakes_by_rule_are_rejected_in_words():
    cases, labels = [], []
    for row in BOOK.values():
        tree = ast.parse(text_of(row.name))
        for path in set(row.functions).difference(TRAIN_OR_SEARCH):
            node = sheet.function_in(tree, path)
            for mistake, place, source in mutants(node, row.since):
                cases.append((row.name, [(node.name, source, "")], ""))
                labels.append((f"{node.name}: {mistake}", place))
    assert len(cases) > 1000
    passed, silent = Counter(), []
    for (label, place), said in zip(labels, graded(cases)):
        passed[label] += not said
        if not said and passed[label] > HARMLESS.get(label, 0):
            silent.append(f"{label}, in: {place}")
        assert not any(": assert " in text for text in said), f"{said} tells no student anything"
    assert not silent, (
        "Nothing rejects these mistakes. Sharpen a test; if a function with the mistake computes "
        "the same, count it in HARMLESS:\n" + "\n".join(silent)
    )


def test_every_exercise_has_right_solutions_in_other_ways_and_all_solutions_are_few_lines():
    counts, lines = Counter(PLACE[name][0].name for name, *_ in solutions("right.py")), 0
    assert all(counts[name] >= 2 for name in BOOK), counts
    for file in ("wrong.py", "right.py", "mutants.py"):
        lines += len((FOLDER / "solutions" / file).read_text("utf-8").splitlines())
    assert lines <= 1400


def test_every_emptied_function_is_rejected():
    results = graded([(name, empty([name]), "not written yet") for name in BOOK])
    for name, said in zip(BOOK, results):
        assert said == [f"{name} is not written yet"], name


def needs(name, known=frozenset()):
    """The exercise, all that it needs by README.md, and all that those need."""
    known = known | {name}
    part = README.split(f"\n#### {name} ")[1].split("\n#### ")[0]
    for said in re.findall(r"\bNeeds\b[^:.]*:\s([^.;]+)", part):
        for word in re.findall(r"\w+", said):
            if word in BOOK and word not in known:
                known = needs(word, known)
    return known


@pytest.mark.slow
def test_an_exercise_passes_and_needs_no_more_than_readme_says():
    results = graded([(name, empty(BOOK.keys() - needs(name)), "") for name in BOOK])
    problems = [
        f"{name}: README.md says it needs {sorted(needs(name) - {name})}, but {said}"
        for name, said in zip(BOOK, results)
        if said
    ]
    assert not problems, "\n".join(problems)
