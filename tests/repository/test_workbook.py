"""The exercises: clean sheets, and a grading that rejects wrong solutions with words that fit."""

import re
import subprocess
import sys
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import grading
import pytest
import sheet
from solutions import referee
from solutions.mutants import HARMLESS
from test_scripts import main_of, python
from workbook import BOOK

FOLDER = Path(sheet.__file__).parent
ONLY_BASH = pytest.mark.skipif(sys.platform == "win32", reason="for bash")


def grade(folder, names, *more, **surrounding):
    """What a student reads at last."""
    done = python(*f"-m pytest tests --stages {folder} -k".split(), names, *more, **surrounding)
    return done.stdout.rpartition("\nwhat to mend ")[2] + done.stderr


def submission(folder, **bodies):
    """A folder with the files of these exercises; the first function of each has another body."""
    folder.mkdir(parents=True)
    texts = sheet.sheets([])
    for name, body in bodies.items():
        file, function = f"{BOOK[name].file}.py", BOOK[name].functions[0]
        texts[file] = sheet.replaced(texts[file], function, body.splitlines())
        (folder / file).write_text(texts[file], "utf-8")


def test_a_sheet_keeps_equations_says_where_to_write_and_overwrites_no_work(
    tmp_path, monkeypatch, capsys
):
    main_of("sheet.py", monkeypatch, "--out", tmp_path)
    printed = capsys.readouterr().out
    for row in BOOK.values():
        text, source = (tmp_path / f"{row.file}.py").read_text("utf-8"), referee.text_of(row.name)
        kept, all_of_them = ({*re.findall(r"(?m)^ *(#.*)", code)} for code in (text, source))
        assert all_of_them <= kept, "all comments stay, for they hold the equations"
        gaps = [k for k, line in enumerate(text.splitlines(), 1) if f': {row.name}"' in line]
        told = ", ".join(f"{row.file}.py:{k}" for k in gaps)
        assert f" {told}\n" in printed and len(gaps) == len(row.functions), row
        grading.own_code([row], tmp_path)
        assert f"python {tmp_path}" in capsys.readouterr().out
    work = tmp_path / "05_evaluate.py"
    work.write_text("# a night's work")
    with pytest.raises(SystemExit, match="2"):
        main_of("sheet.py", monkeypatch, "--out", tmp_path)
    main_of("sheet.py", monkeypatch, "--out", tmp_path, "--force", "--only", "gae")
    assert work.read_text() == "# a night's work"  # nobody asked for this one


@pytest.mark.slow
def test_students_make_and_grade_sheets_in_an_edition_without_solutions(tmp_path, monkeypatch):
    folder = tmp_path / 'class "A"'
    main_of("sheet.py", monkeypatch, "--edition", folder)
    all_of_it = "".join(path.read_text("utf-8") for path in folder.rglob("*.py"))
    assert all(f'"exercise: {name}"' in all_of_it for name in BOOK), "the root has no solution"
    assert not [*folder.rglob("right.py"), *folder.rglob("tired.txt")]
    python("tests/course/sheet.py", cwd=folder)
    words = grade("exercises", " or ".join(BOOK), cwd=folder)
    assert words.count(" is not written yet\n") >= len(BOOK), f"all can be imported: {words}"


CASES = {  # a body, and what the grader says
    "wrap": ("import time\ntime.sleep(3)\nreturn np.arctan2(np.sin(angle), np.cos(angle))", "solved"),
    "link_frames": ("return sum(range(10**13))", "0 of 1 tests pass\n  - takes too long on the"),
    "fallen": ("while True:\n    pass", "0 of 1 tests pass\n  - computes for too long"),
    "quintic": ("import os\nos._exit(0)", "0 of 1 tests pass\n  - ends Python"),
    "beta_mode": ("while(:", "0 of 1 tests pass\n  - beta.py, line "),
    "encode_goal": (None, "not handed in, there is no 03_env.py"),
    "reflex": (None, "not in this sheet"),
}  # fmt: skip


@pytest.mark.slow
@ONLY_BASH
def test_what_never_ends_or_ends_python_fails_and_the_others_keep_their_grades(tmp_path):
    submission(tmp_path / "eve", **{name: body for name, (body, _) in CASES.items() if body})
    slow = tmp_path / "fc-list"  # by which matplotlib looks for fonts when it is first imported
    slow.write_text("#!/bin/sh\nsleep 12\n")
    slow.chmod(0o755)
    cold = {"MPLCONFIGDIR": str(tmp_path), "PATH": f"{tmp_path}:/usr/bin:/bin"}
    words = grade(tmp_path / "eve", " or ".join(CASES), "--patience=1", **cold)
    for name, (_, said) in CASES.items():
        assert re.search(rf"^{name} ★+: {re.escape(said)}", words, re.MULTILINE), words
    assert "eve: 1 of 7 exercises solved, 1 of 10 stars\n" in words
    assert "a number of seconds" in grade(tmp_path, "gae", "--patience", "inf")


@pytest.mark.slow
@ONLY_BASH
def test_the_lines_for_lecturers_collect_marks_and_say_why_there_are_none(tmp_path):
    submission(tmp_path / "submissions" / "ada", quintic="return 0")
    (tmp_path / "submissions" / "bob").mkdir()
    (tmp_path / "marks_cleo.txt").write_text("ERROR: too late")
    for line in re.findall(r"^for .*$", (FOLDER / "teaching.md").read_text("utf-8"), re.MULTILINE):
        line = line.replace("python", sys.executable).replace(" tests ", f" {sheet.ROOT}/tests ")
        done = subprocess.run(["bash", "-c", line], cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout.splitlines() == [
        "marks_ada.txt:ada: 0 of 2 exercises solved, 0 of 5 stars",
        "marks_bob.txt:quintic ★★: not handed in, there is no 02_walk_engine.py",
        "marks_bob.txt:swing ★★★: not handed in, there is no 02_walk_engine.py",
        "marks_bob.txt:bob: 0 of 2 exercises solved, 0 of 5 stars",
        "marks_cleo.txt: no result: ERROR: too late",
    ]


@pytest.mark.parametrize("message, said", [
    ("AssertionError: \nNot equal to tolerance rtol=1e-07, atol=0\nits sign\n"
     "Mismatched elements: 1 / 2 (50%)\nMismatch at index:\n [1]: -3.0 (ACTUAL), 3.0 (DESIRED)\n"
     "Max absolute", "its sign (got -3.0, expected 3.0 at [1])"),
    ("AssertionError: mind the\n  sign\nassert -3.0 == 3.0 ± 1e-9\n  \n  comparison failed\n"
     "  Obtained: -3.0\n  Expected: 3.0", "mind the sign (got -3.0, expected 3.0)"),
    ("Items are not equal:\nits sign\n ACTUAL: 1\n DESIRED: 2", "its sign (got 1, expected 2)"),
    ("assert 1 == 2\n + where", "gae is right: assert 1 == 2"),
    ("ValueError: too many values.\nat", "ValueError: too many values: your function gets batches [n, …]"),
])  # fmt: skip
def test_what_a_failing_test_says_is_freed_from_what_pytest_and_numpy_add(message, said):
    crash = SimpleNamespace(reprcrash=SimpleNamespace(message=message))
    report = SimpleNamespace(nodeid="x.py::test_gae_is_right", longrepr=crash)
    assert grading.hint(report) == said


def test_an_exercise_without_any_result_is_not_solved(tmp_path, capsys):
    assert grading.tell(tmp_path, [BOOK["wrap"]], {}, {})
    assert "0 of 1 exercises solved" in capsys.readouterr().out


@pytest.mark.slow
def test_wrong_solutions_are_rejected_with_words_that_fit_and_right_and_rounded_ones_accepted():
    cases = [*referee.written(), *referee.ours_rounded()]
    for case, said in zip(cases, referee.graded(cases)):
        fits = any(case.words in text for text in said) if case.words else not said
        assert fits, f"{case.exercise}: {case.mistake} must get {case.words!r}, but gets {said}"


@pytest.mark.filterwarnings("ignore::SyntaxWarning")  # of mistakes
@pytest.mark.slow
def test_small_mistakes_by_rule_are_rejected_in_words():
    cases = [*referee.by_rule()]
    passed = []
    assert len(cases) > 1000
    for case, said in zip(cases, referee.graded(cases)):
        assert not any(": assert " in text for text in said), f"{said} tells no student anything"
        passed += [case.mistake] * (not said)
    more = Counter(mistake.split(", in: ")[0] for mistake in passed) - Counter(HARMLESS)
    assert not more, (
        "Nothing rejects these mistakes. Sharpen a test; if a function with the mistake computes "
        f"the same, count it in HARMLESS: {more}, of\n" + "\n".join(passed)
    )


@pytest.mark.slow
def test_exercises_md_has_every_exercise_and_names_what_it_needs():
    page = (FOLDER / "exercises.md").read_text("utf-8")
    cases = []
    for row, part in zip(BOOK.values(), page.split("\n#### ")[1:]):
        assert part.startswith(f"{row.name} {row.stars * '★'} {row.minutes} minutes\n"), row
        needed = re.findall(r"\w+", part.partition("<")[0])  # its name is the first word
        cases.append(referee.emptied(BOOK.keys() - {*needed}, row.name))
    for case, said in zip(cases, referee.graded(cases)):
        assert not said, f"{case.exercise}: exercises.md must say what it needs"
