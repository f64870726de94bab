"""The exercises to be written: clean sheets, the grading and its last words, and whether it is
right: plausible wrong solutions must be rejected with a message that fits."""

import ast
import json
import os
import re
import shlex
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "tests" / "exercises"
workbook, sheet = import_module("workbook"), import_module("sheet")
BOOK, CORES = workbook.BOOK, import_module("01_robot_model").CORES
NAMES = pytest.mark.parametrize("name", BOOK)
WRONG = sorted((FOLDER / "wrong").glob("*.py"))
FIRST = {path.stem.split("__")[0]: path for path in reversed(WRONG)}  # the first one of each
FIRST.pop("improve")  # its tests train: the slow part has it

def run(*arguments, cwd=ROOT, **environment):
    """A finished process of Python."""
    return subprocess.run([sys.executable, *map(str, arguments)], cwd=cwd, text=True, timeout=300,
                          capture_output=True, encoding="utf-8",
                          env={**os.environ, "PYTHONIOENCODING": "utf-8", **environment})

def grade(folder, *more, cwd=ROOT):
    return run("-m", "pytest", ROOT / "tests", "-p", "no:cacheprovider", "--stages", folder, *more,
               cwd=cwd)

def last_words(said):
    """What a student reads at last."""
    assert " what to mend " in said, f"the grading does not come to its end:\n{said[-2000:]}"
    return said[said.rindex(" what to mend ") :]

def text_of(name):
    return sheet.read(sheet.find(BOOK[name].file))


# ------------------------------------------------------------------------ the list
@NAMES
def test_the_list_names_what_is_there(name):
    row = BOOK[name]
    assert row.name == name and re.fullmatch(r"[a-z_]+", name) and 1 <= row.stars <= 4
    source = text_of(name)
    for function in row.functions:
        first, end, _ = sheet.body_of(source, function, row.since)
        assert first < end
    grader, *beginnings = row.tests
    written = re.findall(r"^def test_(\w+)", (ROOT / "tests" / f"{grader}.py").read_text("utf-8"),
                         re.MULTILINE)
    for beginning in beginnings:
        assert any(test.startswith(beginning) for test in written), (
            f"workbook.py, {name}: {grader}.py has no test_{beginning}…")

def test_exercises_cover_all_stages_from_easy_to_hard():
    assert {row.file[:2] for row in BOOK.values()} >= {"01", "02", "03", "04", "05"}
    assert {row.stars for row in BOOK.values()} == {1, 2, 3, 4} and len(BOOK) >= 16
    assert "/exercises/" in (ROOT / ".gitignore").read_text("utf-8").splitlines()

def test_readme_and_list_agree():
    text = (FOLDER / "README.md").read_text(encoding="utf-8")
    heads = re.findall(r"^#### (\w+) (★+) (\d+) minutes$", text, re.MULTILINE)
    assert heads == [(name, "★" * row.stars, str(row.minutes)) for name, row in BOOK.items()] or (
        sorted(heads) == sorted((name, "★" * row.stars, str(row.minutes))
                                for name, row in BOOK.items())), (
        "tests/exercises/README.md: #### name, stars, minutes as in workbook.py")
    place = ""
    for part in re.split(r"^(?=###)", text, flags=re.MULTILINE):
        place = (re.findall(r"^### .*`(\w+)\.py`$", part, re.MULTILINE) or [place])[0]
        if not part.startswith("#### "):
            continue
        row = BOOK[part.split()[1]]
        assert place == row.file, f"{row.name} is in {row.file}.py"
        assert f"\n    {workbook.command(row.name)}\n" in part, "the exact command"
        assert 2 <= part.count("<details><summary>Hint ") == part.count("</details>") <= 3, row.name
        assert "You learn " in part, row.name
        for function in row.functions:
            assert f"`{function}`" in part, f"{row.name}: {function} is to be written, too"


# ------------------------------------------------------------------------ sheets
@NAMES
def test_a_sheet_keeps_the_docstring_and_the_equations_and_nothing_else(name):
    row, source = BOOK[name], text_of(name)
    empty = sheet.emptied(source, row)
    old, new = ast.parse(source), ast.parse(empty)
    for function in row.functions:
        one, other = (sheet.function_in(tree, function) for tree in (old, new))
        assert ast.get_docstring(one) == ast.get_docstring(other)
        assert ast.unparse(one.args) == ast.unparse(other.args)
        stub = ast.unparse(other.body[-1])
        assert stub == f"raise NotImplementedError('exercise: {name}')"
        if not row.since:
            assert len(other.body) == 1 + (ast.get_docstring(one) is not None), "code is left"
        first, end, _ = sheet.body_of(source, function, row.since)
        comments = [line.strip() for line in source.splitlines()[first:end]
                    if line.strip().startswith("#")]
        first, end, _ = sheet.body_of(empty, function, "raise" if row.since else "")
        kept = [line.strip() for line in empty.splitlines()[first : end - 1]]
        assert kept == comments, "the comments above the code, all of them and nothing else"
        one.body = other.body = [ast.Pass()]
    assert ast.unparse(old) == ast.unparse(new), "everything else is as it was"

def test_students_see_equations():
    assert "# δ_t = r_t" in sheet.emptied(text_of("gae"), BOOK["gae"])
    assert "# L = min(" in sheet.emptied(text_of("clipped_objective"), BOOK["clipped_objective"])
    assert "# α − 1 = m·(c − 2)" in sheet.emptied(text_of("first_bias"), BOOK["first_bias"])

def test_sheets_are_written_from_any_folder_and_work_is_not_overwritten(tmp_path):
    script, out = FOLDER / "sheet.py", tmp_path / "my exercises"
    done = run(script, "--out", "my exercises", cwd=tmp_path, PYTHONIOENCODING="cp1252")
    assert done.returncode == 0, done.stderr
    files = {f"{row.file}.py" for row in BOOK.values()}
    assert {path.name for path in out.iterdir()} == files
    assert workbook.command("wrap", '"' + out.resolve().as_posix() + '"') in done.stdout
    for name in files:
        assert b"\r" not in (out / name).read_bytes()
    mine = out / "04_ppo.py"
    mine.write_text("# a night's work\n")
    again = run(script, "--out", out, cwd=tmp_path)
    assert again.returncode == 2 and mine.read_text() == "# a night's work\n"
    assert len(again.stderr.splitlines()) == 1 and "--force" in again.stderr, again.stderr
    only = run(script, "--out", out, "--force", "--only", "gae", "quintic", cwd=tmp_path)
    assert only.returncode == 0, only.stderr
    stubs = {name: (out / name).read_text("utf-8").count("exercise: ") for name in files}
    assert stubs == {**dict.fromkeys(files, 0), "04_ppo.py": 1, "02_walk_engine.py": 1}

@pytest.mark.parametrize("arguments, mention", [
    (["--only", "gea"], "gea"), (["--out", str(ROOT), "--force"], "solutions"),
    (["--out", str(FOLDER), "--force"], "solutions"),
    (["--out", str(FOLDER / "sheet.py"), "--force"], "cannot write")], ids=str)
def test_a_sheet_that_cannot_be_written_is_one_line(arguments, mention):
    done = run(FOLDER / "sheet.py", *arguments)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1, done.stderr
    assert mention in done.stderr


# ------------------------------------------------------------------------ grading
def submission(folder, **solutions):
    """A folder with the files of these exercises only, each with a text instead of our solution."""
    folder.mkdir(exist_ok=True)
    texts = {}
    for name, solution in solutions.items():
        path = sheet.find(BOOK[name].file)
        text = texts.get(path.name, sheet.read(path))
        texts[path.name] = (sheet.emptied(text, BOOK[name]) if solution is None
                            else sheet.solved(text, BOOK[name], solution))
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    return folder

@pytest.mark.slow
def test_an_empty_sheet_can_be_graded(tmp_path):
    sheets = tmp_path / "exercises"
    assert run(FOLDER / "sheet.py", "--out", sheets).returncode == 0
    done = grade(sheets)
    words = last_words(done.stdout)
    assert done.returncode == 1 and f"0 of {len(BOOK)} exercises solved" in words
    assert "not graded" not in words, "every test module can be imported while all is empty"
    reasons = re.findall(r"^  - (.*)$", words, re.MULTILINE)
    assert set(reasons) <= {f"{name} is not written yet" for name in BOOK}, reasons
    assert not list(sheets.glob("__pycache__")), "nothing of ours in a student's folder"

def test_a_submission_of_one_file_is_graded_from_any_folder(tmp_path):
    submission(tmp_path / "alice smith", gae=None, clipped_objective=(
        "def clipped_objective(ratio, advantage, clip):\n    return ratio * advantage\n"))
    done = grade("alice smith", "-k", "gae or clipped_objective or low_pass", cwd=tmp_path)
    words = last_words(done.stdout)
    assert done.returncode == 1 and "grading" in done.stdout and "04_ppo.py" in done.stdout
    assert re.search(r"^clipped_objective ★: 0 of 1 tests pass\n  - take the minimum of both "
                     r"products; .*\n  Hints: tests/exercises/README.md, exercise \"clipped_obj",
                     words, re.MULTILINE), words
    assert "gae ★★: 0 of 4 tests pass\n  - gae is not written yet\n" in words, words
    assert "low_pass ★: not handed in, there is no 05_evaluate.py" in words
    assert "alice smith: 0 of 3 exercises solved, 0 of 4 stars" in words
    assert len(words.splitlines()) <= 12, "the hints come last, and in a few lines"
    assert "wilson" not in words

def test_the_command_of_the_sheets_works_word_for_word():
    done = run(*shlex.split(workbook.command("beta_mode", "tests/exercises"))[1:])
    assert done.returncode == 0, done.stdout + done.stderr
    assert "beta_mode ★: solved" in last_words(done.stdout)

@pytest.mark.slow
def test_a_file_that_cannot_be_imported_is_told_at_last(tmp_path):
    (tmp_path / "04_ppo.py").write_text("def gae(:\n", encoding="utf-8")
    done = grade(tmp_path, "-k", "gae")
    assert done.returncode != 0
    assert "  - 04_ppo.py, line 1: SyntaxError: invalid syntax" in last_words(done.stdout)

@pytest.mark.slow
def test_nothing_is_no_solution_and_a_copy_is_told(tmp_path):
    """Who hands in an empty folder's worth, or our own words, gets no praise for it."""
    gae = sheet.read(sheet.find("04_ppo"))
    (tmp_path / "04_ppo.py").write_text(gae, encoding="utf-8", newline="\n")
    words = last_words(grade(tmp_path, "-k", "gae or wilson").stdout)
    assert re.search(r"^gae ★★: solved, \d of \d tests pass, word for word as in the repository$",
                     words, re.MULTILINE), words
    assert "wilson ★: not handed in" in words
    assert (f"{tmp_path.name}: 1 of 2 exercises solved, 2 of 3 stars; 1 word for word as in the "
            "repository") in words
    assert "what to mend in " + tmp_path.name in grade(tmp_path, "-k", "wilson").stdout, (
        "a teacher must see whose it is")

@pytest.mark.parametrize("make, mention", [(False, "there is no such folder"),
                                           (True, "neither a stage")])
def test_a_wrong_folder_is_one_line(tmp_path, make, mention):
    if make:
        (tmp_path / "empty").mkdir()
    done = grade(tmp_path / "empty", "-k", "gae")
    assert done.returncode == 4 and mention in done.stderr and "Traceback" not in done.stderr

@pytest.mark.slow
def test_an_endless_loop_is_stopped(tmp_path, monkeypatch):
    conftest = (ROOT / "conftest.py").read_text(encoding="utf-8")
    assert "PATIENCE = 60 " in conftest
    folder = submission(tmp_path / "slow", low_pass=(
        "def low_pass(velocity, command, seconds, time_constant):\n"
        "    while True:\n        pass\n"))
    start = time.monotonic()
    done = run("-c", "import sys, pytest\n"
               "class Hurry:\n"
               "    def pytest_collection_finish(self, session):\n"
               "        for plugin in session.config.pluginmanager.get_plugins():\n"
               "            if hasattr(plugin, 'PATIENCE'):\n"
               "                plugin.PATIENCE = 3\n"
               "sys.exit(pytest.main(sys.argv[1:], plugins=[Hurry()]))", "tests", "--stages",
               folder, "-k", "low_pass or wilson", "-p", "no:cacheprovider")
    words = last_words(done.stdout)
    assert time.monotonic() - start < 50 and "a loop that never ends?" in words, words
    assert "wilson ★: solved" in words, "the others are graded nevertheless"

def test_what_a_failing_test_says_is_freed_from_what_pytest_and_numpy_add():
    hint = import_module("conftest").hint

    def said(message):
        return hint(SimpleNamespace(nodeid="tests/test_ppo.py::test_gae_is_right[1.0]",
                                    longrepr=SimpleNamespace(reprcrash=SimpleNamespace(
                                        message=message))))

    assert said("AssertionError: mind the\n  sign\nassert 1 == 2") == "mind the sign"
    assert said("AssertionError: \nNot equal to tolerance rtol=1e-07, atol=0\nits sign\n"
                "Mismatched elements: 1 / 1 (100%)\nMax absolute") == "its sign"
    assert said("AssertionError: \nArrays are not equal\nits sign\n(shapes (1,), (2,) mismatch)"
                ) == "its sign"
    assert said("NotImplementedError: exercise: gae") == "gae is not written yet"
    assert said("assert 1 == 2\n + where") == "gae is right[1.0]: assert 1 == 2"
    assert said("TypeError: no such thing") == "TypeError: no such thing"


# ------------------------------------------------------------------------ is the grading right?
def says(path):
    """(what is wrong, the words that the grading should contain) of a file in wrong/."""
    return re.match(r"# (.+?) Says: (.+)\n", sheet.read(path)).groups()

def graded(cases):
    """{label: (exit code, last words)} of [label, exercise, {file: text}], a process per core."""
    def grade_some(some):
        done = subprocess.run([sys.executable, str(FOLDER / "referee.py")], input=json.dumps(some),
                              capture_output=True, text=True, encoding="utf-8", cwd=ROOT,
                              env={**os.environ, "PYTHONIOENCODING": "utf-8"})
        rows = [json.loads(line) for line in done.stdout.splitlines()]
        assert len(rows) == len(some), done.stderr[-2000:]
        return {label: (code, last_words(said)) for label, code, said in rows}

    cores = min(CORES, len(cases))
    with ThreadPoolExecutor(cores) as pool:
        parts = pool.map(grade_some, [cases[k::cores] for k in range(cores)])
        return {label: words for part in parts for label, words in part.items()}

def case(path):
    """A wrong solution as a submission of one file."""
    name = path.stem.split("__")[0]
    source = sheet.find(BOOK[name].file)
    return [path.stem, name, {source.name: sheet.solved(sheet.read(source), BOOK[name],
                                                        sheet.read(path))}]

def check(paths):
    results, problems = graded([case(path) for path in paths]), []
    for path in paths:
        (code, words), (what, expected) = results[path.stem], says(path)
        if code != 1:
            problems.append(f"{path.stem} ({what}) is not rejected (exit code {code})")
        elif expected not in words:
            problems.append(f"{path.stem} ({what}) is rejected without “{expected}”:\n{words}")
    assert not problems, "\n".join(problems)

def test_wrong_solutions_are_enough_and_say_what_is_wrong():
    count = dict.fromkeys(BOOK, 0)
    for path in WRONG:
        count[path.stem.split("__")[0]] += 1
        says(path)
    assert min(count.values()) >= 2 and len(WRONG) >= 40, count

def test_a_wrong_solution_of_every_sixth_exercise_is_rejected():
    check(list(FIRST.values())[::6])

@pytest.mark.slow
def test_every_wrong_solution_is_rejected_with_words_that_fit():
    check(WRONG)

@pytest.mark.slow
def test_every_emptied_function_is_rejected_and_ours_passes():
    cases = []
    for name, row in BOOK.items():
        path = sheet.find(row.file)
        cases += [[f"{name} empty", name, {path.name: sheet.emptied(sheet.read(path), row)}],
                  [f"{name} ours", name, {path.name: sheet.read(path)}]]
    results = graded(cases)
    for name in BOOK:
        code, words = results[f"{name} empty"]
        assert code == 1 and f"{name} is not written yet" in words, words
        code, words = results[f"{name} ours"]
        assert code == 0 and ": solved, " in words, words

def needed():
    """{name: it, and all exercises that it needs by README.md, and that those need}."""
    text, direct = (FOLDER / "README.md").read_text(encoding="utf-8"), {}
    for part in re.split(r"^#### ", text, flags=re.MULTILINE)[1:]:
        said = " ".join(re.findall(r"\bNeeds\b[^:.]*:\s([^.;]+)", part))
        direct[part.split()[0]] = {word for word in re.findall(r"\w+", said) if word in BOOK}
    result = {}
    for name in BOOK:
        names, more = set(), {name}
        while more:
            names |= more
            more = set().union(*(direct[one] for one in names)) - names
        result[name] = names
    return result

def test_needs_are_read_from_readme():
    names = needed()
    assert names["wrap"] == {"wrap"} and names["leg_inverse"] == {"leg_inverse", "leg_points"}
    assert {"first_bias", "gae", "clipped_objective"} < names["improve"]
    assert {"wrap", "look_up"} < names["steps_to_go"], "also what is said in parentheses"

@pytest.mark.slow
def test_an_exercise_needs_no_more_than_readme_says():
    names = needed()
    results = graded([[name, name, sheet.sheets(BOOK.keys() - names[name])] for name in BOOK])
    problems = [f"{name}: README.md says it needs {sorted(names[name] - {name})}, but\n{words}"
                for name, (code, words) in results.items() if code != 0]
    assert not problems, "\n".join(problems)
