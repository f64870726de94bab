"""The exercises: clean sheets, and a grading that rejects wrong solutions with words that fit."""

import ast
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import debug
import grading
import pytest
import sheet
import workbook
from solutions import referee
from solutions.mutants import HARMLESS
from solutions.referee import emptied, graded, text_of
from test_scripts import main_of, python
from workbook import BOOK

ROOT = sheet.ROOT
FOLDER = Path(sheet.__file__).parent
EXERCISES = (FOLDER / "exercises.md").read_text("utf-8")
TEACHING = (FOLDER / "teaching.md").read_text("utf-8")


def grade(folder, *more, cwd=ROOT):
    flags = "-p", "no:cacheprovider", "--stages", folder
    return python("-m", "pytest", ROOT / "tests", *flags, *more, cwd=cwd)


def last_words(done):
    """What a student reads at last."""
    _, found, words = done.stdout.rpartition(" what to mend ")
    assert found, f"the grading does not come to its end:\n{done.stdout[-2000:]}"
    return words


def test_readme_and_list_agree():
    heads = re.findall(r"^#### (\w+) (★+) (\d+) minutes$", EXERCISES, re.MULTILINE)
    assert heads == [(name, "★" * row.stars, str(row.minutes)) for name, row in BOOK.items()], (
        "tests/course/exercises.md: #### name, stars, minutes in the order of workbook.py"
    )
    place = ""
    for part in re.split(r"^(?=###)", EXERCISES, flags=re.MULTILINE):
        place = (re.findall(r"^### .*`(\w+)\.py`$", part, re.MULTILINE) or [place])[0]
        if part.startswith("#### "):
            row = BOOK[part.split()[1]]
            assert place == row.file, f"{row.name} is in {row.file}.py"
            for said in ("<summary>Hints</summary>", "You learn ", *row.functions):
                assert said in part, f"{row.name}: where is {said}?"


MINUTES = {f"build.{name}": row.minutes for name, row in BOOK.items()}
for kind in "predict", "debug":
    text = (FOLDER / f"{kind}.md").read_text("utf-8")
    heads = re.findall(r"^## (\w+): .*\n\n(?:★+ )?(\d+) minutes", text, re.MULTILINE)
    MINUTES |= {f"{kind}.{name}": int(minutes) for name, minutes in heads}


@pytest.mark.parametrize("number", range(1, 12))
def test_the_hours_of_a_lesson_are_the_sum_of_its_minutes(number):
    """Of the reading, and of all exercises without parentheses."""
    lesson = sheet.part(number).partition("<details>")[0]
    names = re.findall(r"\s`((?:build|predict|debug)\.\w+)`", lesson)
    (read,) = re.findall(r"Read \((\d+) minutes", lesson)
    (hours,) = re.findall(r"^\*([\d.]+) hours? at home\.\*", lesson, re.MULTILINE)
    total = int(read) + sum(MINUTES[name] for name in set(names))
    assert abs(total - 60 * float(hours)) <= 15, f"lesson {number} takes {total} minutes"


def test_a_sheet_keeps_docstrings_and_equations_and_all_other_code():
    for file, empty in sheet.sheets(BOOK).items():
        stem = Path(file).stem
        source = sheet.find(stem).read_text("utf-8")
        tree = ast.parse(source)
        for row in (row for row in BOOK.values() if row.file == stem):
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
    script = FOLDER / "sheet.py"
    out = tmp_path / "my exercises"
    done = python(script, "--out", "my exercises", cwd=tmp_path, PYTHONIOENCODING="cp1252")
    assert done.returncode == 0, done.stderr
    assert {path.name for path in out.iterdir()} == {f"{row.file}.py" for row in BOOK.values()}
    assert "/exercises/" in (ROOT / ".gitignore").read_text("utf-8"), "a student's work"
    assert workbook.command('"wrap"', f'"{out.resolve().as_posix()}"') in done.stdout
    places = re.findall(r"(\w+\.py):(\d+)", done.stdout)
    lines = [(out / file).read_text("utf-8").splitlines()[int(k) - 1].strip() for file, k in places]
    assert lines == [
        f'raise NotImplementedError("exercise: {row.name}")'
        for row in BOOK.values()
        for _ in row.functions
    ], "sheet.py prints in which line of which file a student writes"
    mine = out / "04_ppo.py"
    solved = out / "05_evaluate.py"
    mine.write_text("# a night's work\n")
    solved.write_text("# solved\n")
    again = python(script, "--out", out)
    (line,) = again.stderr.splitlines()
    assert again.returncode == 2 and "--force" in line and mine.read_text() == "# a night's work\n"
    assert python(script, "--out", out, "--force", "--only", "gae").returncode == 0
    assert mine.read_text("utf-8").count("exercise: ") == 1
    assert solved.read_text() == "# solved\n", "files of other exercises stay"


def test_no_sheet_is_made_while_a_bug_is_in_a_stage(tmp_path, monkeypatch, capsys):
    debug.copied(tmp_path)
    monkeypatch.setattr(sheet, "ROOT", tmp_path)
    for bug in debug.BUGS:
        debug.put(bug, tmp_path)
        with pytest.raises(SystemExit, match="2"):  # one line, and nothing is written
            main_of("sheet.py", monkeypatch, "--out", tmp_path / "mine")
        (line,) = capsys.readouterr().err.splitlines()
        assert line.endswith(f"debug.py undo {bug}"), "a student would build on this bug"
        debug.put(bug, tmp_path, undo=True)
    assert not (tmp_path / "mine").exists()


def test_a_stage_may_begin_with_a_byte_order_mark(tmp_path, monkeypatch):
    text = sheet.find("04_ppo").read_text("utf-8")
    marked = tmp_path / "04_ppo.py"  # as an editor of Windows saves it
    marked.write_text(text, "utf-8-sig")
    monkeypatch.setattr(sheet, "find", lambda file: marked)
    assert sheet.sheets(["gae"])["04_ppo.py"] == sheet.emptied(text, BOOK["gae"])


@pytest.mark.parametrize(
    "arguments, mention",
    [
        (["--only", "gea"], "gea"),
        (["--lesson", "11"], "lesson 11"),
        (["--out", str(ROOT), "--force"], "solutions"),
        (["--out", str(FOLDER / "sheet.py"), "--force"], "cannot write"),
    ],
    ids=str,
)
def test_a_sheet_that_cannot_be_written_is_one_line(arguments, mention):
    done = python(FOLDER / "sheet.py", *arguments)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1, done.stderr
    assert mention in done.stderr


def submission(folder, **bodies):
    """A folder with the files of these exercises only; the first function has another body."""
    folder.mkdir()
    for name, body in bodies.items():
        row = BOOK[name]
        path = folder / f"{row.file}.py"
        text = path.read_text("utf-8") if path.exists() else text_of(name)
        text = sheet.replaced(text, row.functions[0], body.splitlines())
        path.write_text(text, "utf-8")
    for path in folder.iterdir():  # a full sheet
        path.write_text(f"{path.read_text('utf-8')}{sheet.MARK} {', '.join(BOOK)}\n", "utf-8")
    return folder


@pytest.mark.slow
def test_the_sheet_of_a_lesson_has_its_exercises_and_its_studies_run(tmp_path, monkeypatch, capsys):
    assert sheet.lesson(3) == ["quintic", "swing"], (
        "the course; the first time without (build.knot)"
    )
    for number, study in (4, "walk.py"), (10, "search.py"):
        folder = tmp_path / study
        main_of("sheet.py", monkeypatch, "--lesson", number, "--out", folder)
        assert f'"{" or ".join(sheet.lesson(number))}"' in capsys.readouterr().out
        done = python(folder / study, "--help", cwd=tmp_path)
        assert "--mujoco" in done.stdout, done.stderr
    words = last_words(grade(folder))
    assert words.count(": not in this sheet\n") == len(BOOK) - 1, words
    assert "look_up is not written yet" in words
    assert f" 0 of {len(BOOK)} exercises solved, 0 of " in words and "Run" not in words, (
        "an untouched sheet earns no stars, and does not run"
    )


@pytest.mark.slow
def test_an_empty_sheet_can_be_graded(tmp_path):
    sheets = tmp_path / "exercises"
    assert python(FOLDER / "sheet.py", "--out", sheets).returncode == 0
    done = grade(sheets)
    words = last_words(done)
    assert done.returncode == 1 and f"0 of {len(BOOK)} exercises solved" in words
    assert "not graded" not in words, "every test module can be imported while all is empty"
    reasons = re.findall(r"^  - (.*)$", words, re.MULTILINE)
    assert set(reasons) <= {f"{name} is not written yet" for name in BOOK}, reasons
    assert not list(sheets.glob("__pycache__")), "nothing of ours in a student's folder"


@pytest.mark.slow
def test_a_submission_of_few_files_is_graded_from_any_folder(tmp_path):
    folder = submission(
        tmp_path / "alice smith",
        wrap='raise NotImplementedError("exercise: wrap")',
        compose="return base + pose",
        fallen="import atexit, pytest, threading, time\natexit.register(time.sleep, 1e6)\n"
        "threading.Thread(target=time.sleep, args=[1e6]).start()\npytest.skip('later')",
    )
    (folder / "04_ppo.py").write_text("def gae(:\n", "utf-8")
    (folder / "beta.py").write_text("import sys\nsys.exit()\n", "utf-8")
    chosen = "wrap or compose or fallen or link_frames or quintic or beta_mode or gae"
    done = grade("alice smith", "-k", chosen, cwd=tmp_path)
    words = last_words(done)
    assert done.returncode == 1 and "grading" in done.stdout and "01_robot_model.py" in done.stdout
    for says in (
        r"wrap ★: 0 of \d tests pass\n  - wrap is not written yet\n",
        r"compose ★: 0 of \d tests pass\n  - first turn the pose .*\n"
        r"  Hints: tests/course/exercises.md, exercise \"compose\"\n",
        r"fallen ★: 0 of \d tests pass\n",  # who skips gets no stars
        r"link_frames ★★: solved",
        r"quintic ★★: not handed in, there is no 02_walk_engine.py\n",
        r"gae ★★: 0 of \d tests pass\n  - 04_ppo.py, line 1: SyntaxError: invalid syntax\n",
        r"beta_mode ★: 0 of \d tests pass\n  - ends Python",
        "alice smith: 1 of 7 exercises solved, 2 of 10 stars",
    ):
        assert re.search(says, words), f"{says}:\n{words}"
    assert "Run your own" not in words, "a robot does not run with empty functions"
    assert len(words.splitlines()) <= 22, "the hints come last, and in a few lines"


@pytest.mark.parametrize("shell, first", [
    pytest.param("bash", "for", marks=pytest.mark.slow), ("pwsh", "Get-ChildItem"),
])  # fmt: skip
def test_the_lines_for_teachers_grade_submissions_and_collect_the_marks(
    tmp_path, monkeypatch, shell, first
):
    if shutil.which(shell) is None or (shell, sys.platform) == ("bash", "win32"):
        pytest.skip(f"no {shell} here")
    (tmp_path / "submissions").mkdir()
    submission(tmp_path / "submissions" / "ada", quintic="return 0")
    (tmp_path / "marks_bob.txt").touch()
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), os.pathsep)
    for line in re.findall(rf"^{first} .*$", TEACHING, re.MULTILINE):
        line = line.replace("=no tests", f"=no {ROOT / 'tests'} -p no:cacheprovider")
        command = [shell, "-c", line]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout.splitlines() == [
        "ada: 0 of 2 exercises solved, 0 of 5 stars",
        "marks_bob.txt: no result",
    ]


@pytest.mark.parametrize(
    "folder, mention", [("missing", "there is no such folder"), (".", "neither a stage")]
)
def test_a_wrong_folder_is_one_line(tmp_path, folder, mention):
    done = grade(tmp_path / folder, "-k", "gae")
    assert done.returncode == 4 and mention in done.stderr and "Traceback" not in done.stderr


@pytest.mark.slow
def test_what_never_ends_or_ends_python_fails_and_the_others_keep_their_grades(tmp_path):
    late = "takes too long: a loop that never ends"
    ends = "ends Python"
    slow = "import time\ntime.sleep(2)\nreturn angle - 2 * np.pi * np.rint(angle / 2 / np.pi)"
    bodies = {
        "compose": ("import time\ntime.sleep(1e6)", late),
        "fallen": ("while True:\n    pass", late),
        "link_frames": ("return sum(range(10**13))", late),
        "reflex": ("while True:\n    try:\n        pass\n    except:\n        pass", late),
        "quintic": ("import os\nos._exit(0)", ends),
        "clipped_objective": ("raise KeyboardInterrupt", ends),
        "low_pass": ('import pytest\npytest.exit("done")', ends),
    }
    wrong = {name: body for name, (body, _) in bodies.items()}
    folder = submission(tmp_path / "eve", wrap=slow, **wrong)
    (folder / "beta.py").write_text("while True:\n    pass\n", "utf-8")
    bodies["beta_mode"] = "a loop while the file is imported", late
    done = grade(folder, "--patience=5", "-k", " or ".join(["wrap", *bodies]))
    words = last_words(done)
    for name, (body, says) in bodies.items():
        assert re.search(rf"{name} ★+: 0 of \d tests pass\n  - {says}", words), f"{body}:\n{words}"
    hint = "a slow exercise has its full time, whatever the others do"
    assert "eve: 1 of 9 exercises solved, 1 of 12 stars" in words and done.returncode == 1, hint
    assert done.stdout.count(" stars\n") == 1, "who collects the marks wants each of them once"


# What pytest-xdist does to a plugin: here no test is run, but in other processes.
XDIST = """
def pytest_addoption(parser):
    parser.getgroup("xdist")._addoption("-n", dest="processes", type=int)

def pytest_runtestloop(session):
    return session.config.option.processes or None
"""


@pytest.mark.slow
def test_who_tests_in_several_processes_gets_the_same_grades(tmp_path):
    (tmp_path / "xdist.py").write_text(XDIST, "utf-8")
    folder = submission(tmp_path / "dan", wilson="return [0, 1]", low_pass="return 0")
    told = {"PYTHONPATH": str(tmp_path), "PYTEST_ADDOPTS": "-p xdist -n 2"}
    command = workbook.command('"wilson or low_pass or velocity_command"', folder)
    words = last_words(python(*shlex.split(command)[1:], **told))  # as the sheets say it
    assert "dan: 1 of 3 exercises solved, 2 of 4 stars" in words, words
    run = f"{folder.as_posix()}/05_evaluate.py --"
    assert words.count("Run your own code: python ") == words.count(run) == 1, (
        "lesson 9 of the course"
    )


def test_a_solved_exercise_has_a_command_that_runs_it(tmp_path):
    """Also one in parentheses, whose sheet has nothing else."""
    for name in BOOK:
        (told, *others) = grading.own_code([name], tmp_path)
        assert told.startswith("python ") and not others, (
            f"{name}: the course has it in no lesson, or two"
        )
        assert tmp_path.as_posix() in told, told
    assert "04_ppo.py --quick" in next(grading.own_code(["improve"], tmp_path))


@pytest.mark.parametrize("message, said", [
    ("AssertionError: mind the\n  sign\nassert 1 == 2", "mind the sign"),
    ("AssertionError: \nNot equal to tolerance rtol=1e-07, atol=0\nits sign\n"
     "Mismatched elements: 1 / 2 (50%)\nMismatch at index:\n [1]: -3.0 (ACTUAL), 3.0 (DESIRED)\n"
     "Max absolute", "its sign (got -3.0, expected 3.0 at [1])"),
    ("AssertionError: its sign\nassert -3.0 == 3.0 ± 1e-9\n  \n  comparison failed\n"
     "  Obtained: -3.0\n  Expected: 3.0", "its sign (got -3.0, expected 3.0)"),
    ("ValueError: output array is read-only", "what is given must not be written to"),
    ("assert 1 == 2\n + where", "gae is right: assert 1 == 2"),
    ("TypeError: no such thing", "TypeError: no such thing"),
    ("TypeError: no 'NoneType'", "TypeError: no 'NoneType': does each function return its result?"),
    ("ZeroDivisionError: by 0", "ZeroDivisionError: by 0: treat 0 apart"),
])  # fmt: skip
def test_what_a_failing_test_says_is_freed_from_what_pytest_and_numpy_add(message, said):
    longrepr = SimpleNamespace(reprcrash=SimpleNamespace(message=message))
    report = SimpleNamespace(nodeid="x.py::test_gae_is_right", longrepr=longrepr)
    assert grading.hint(report) == said


@pytest.mark.slow
def test_wrong_solutions_are_rejected_with_words_that_fit_and_right_ones_accepted():
    cases = [*referee.written()]
    problems = [
        f"{case.exercise}: “{case.mistake}” must get “{case.words or 'no complaint'}”, but gets {said}"
        for case, said in zip(cases, graded(cases))
        if not (any(case.words in text for text in said) if case.words else not said)
    ]
    assert not problems, "\n".join(problems)


@pytest.mark.slow
def test_errors_of_rounding_are_no_mistakes():
    cases = [*referee.ours_rounded()]
    said = [(case.exercise, said) for case, said in zip(cases, graded(cases)) if said]
    assert len(cases) > 60 and not said, f"compare floats by `close`: {said}"


@pytest.mark.filterwarnings("ignore::SyntaxWarning")  # of mistakes
@pytest.mark.slow
def test_small_mistakes_by_rule_are_rejected_in_words():
    cases = [*referee.by_rule()]
    passed = []
    assert len(cases) > 1000
    for case, said in zip(cases, graded(cases)):
        assert not any(": assert " in text for text in said), f"{said} tells no student anything"
        passed += [case.mistake] * (not said)
    counts = Counter(mistake.split(", in: ")[0] for mistake in passed)
    assert counts <= Counter(HARMLESS), (
        "Nothing rejects these mistakes. Sharpen a test; if a function with the mistake computes "
        f"the same, count it in HARMLESS: {counts - Counter(HARMLESS)}, of\n" + "\n".join(passed)
    )


def test_every_exercise_has_right_solutions_in_other_ways():
    counts = Counter(case.exercise for case in referee.written() if not case.words)
    assert all(counts[name] >= 2 for name in BOOK), counts


def needs(name, known=frozenset()):
    """The exercise, all that it needs by exercises.md, and all that those need."""
    known = known | {name}
    part = EXERCISES.split(f"\n#### {name} ")[1].split("\n#### ")[0]
    for said in re.findall(r"\bNeeds\b[^:.]*:\s([^.;]+)", part):
        for word in re.findall(r"\w+", said):
            if word in BOOK and word not in known:
                known = needs(word, known)
    return known


@pytest.mark.slow
def test_an_exercise_passes_and_needs_no_more_than_readme_says():
    results = graded([emptied(BOOK.keys() - needs(name), name) for name in BOOK])
    problems = [
        f"{name}: exercises.md says it needs {sorted(needs(name) - {name})}, but {said}"
        for name, said in zip(BOOK, results)
        if said
    ]
    assert not problems, "\n".join(problems)
