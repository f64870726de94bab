"""A plugin of pytest, loaded by .pytest.ini. With `--stages FOLDER` it grades the exercises in that
folder; an exercise whose file is missing there is "not handed in", and one that was not empty in the
sheet and is as in the root is "not in this sheet":

    python -m pytest tests --stages=exercises              all of tests/course/workbook.py
    python -m pytest tests --stages=exercises -k gae       this one; or -k "gae or quintic"

From another folder, add the path of `tests`, so that pytest finds .pytest.ini.

What a student writes may never end, or end Python. So another process runs the tests, and writes
down what it begins and what comes out. If it ends too early, a new one goes on with the other
exercises.
"""

import faulthandler
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from importlib import import_module
from pathlib import Path

import pytest
from sheet import ROOT, left_out, part  # of tests/course
from workbook import BOOK, any_console, graded_by

os.environ["MPLBACKEND"] = "Agg"  # figures need no screen
ENDS = "ends Python (exit, or main() unguarded?)"
COMPUTES = "computes for too long: a loop that never ends? (More time: --patience 60)"
WAITS = "takes too long on the clock: does it wait, or call what never ends? (Or --patience 60)"
FLAGS = "--tb=short", "-rN", "--continue-on-collection-errors", "-pno:cacheprovider"


def pytest_addoption(parser):
    parser.addoption("--stages", metavar="FOLDER", help="grade the exercises in this folder")
    # On a busy machine a right solution waits for its turn, but computes no longer than elsewhere.
    # So an import or a test has this much processor time, and ten times as much on the clock.
    parser.addoption(
        "--patience", type=float, default=20, help="[s] to compute; ten times as long to wait"
    )


def pytest_cmdline_main(config):
    """Lets other processes grade, until one of them comes to its end, and says what to mend."""
    options = config.option
    if options.stages is None:
        return None
    folder = Path(options.stages)
    if not folder.is_dir():
        raise pytest.UsageError(f"--stages {folder}: there is no such folder")
    if not 0 < options.patience < 1e6:
        raise pytest.UsageError("--patience: a number of seconds above 0")
    chosen = options.keyword.split(" or ") if options.keyword else [*BOOK]
    if not {*chosen} <= {*BOOK}:
        raise pytest.UsageError(f"-k {options.keyword}: there are {', '.join(BOOK)}")
    rows = [BOOK[name] for name in chosen]
    missing = {}
    for row in rows:
        path = folder / f"{row.file}.py"
        if not path.is_file():
            missing[row] = f"not handed in, there is no {path.name}"
        elif left_out(path.read_text("utf-8-sig", "replace"), row):
            missing[row] = "not in this sheet"
    found, left = {}, [row for row in rows if row not in missing]
    with tempfile.TemporaryDirectory() as temporary:
        graded = Path(temporary, "graded")
        graded.touch()
        command = [
            sys.executable,
            __file__,
            graded,
            folder.resolve(),
            str(options.patience),
            *FLAGS,
        ]
        while left:
            files = sorted({f"tests/{row.grader}.py" for row in left})
            tests = " or ".join(f"test_{begin}" for row in left for begin in row.tests)
            done = [f"--deselect={key}" for key in found if "::" in key]
            try:
                subprocess.run([*command, *files, "-k", tests, *done], cwd=ROOT)
            except KeyboardInterrupt:
                return 2  # as pytest itself
            found, before = read(graded), left
            stopped = [key for key, said in found.items() if said in (ENDS, COMPUTES, WAITS)]
            left = [row for row in left if not any(graded_by(row, key) for key in stopped)]
            if left == before:  # nothing has stopped it
                break
    return tell(folder, rows, missing, found)


def read(graded):
    """What each test or module says, as it was written down; None: it passes."""
    found = {}
    for line in graded.read_text().splitlines():
        if line.startswith("["):
            key, said = json.loads(line)
            found[key] = said
        elif line.startswith("Timeout"):  # faulthandler says so of the last one
            found[key] = WAITS
    return found


def tell(folder, rows, missing, found):
    """Prints what to mend in each exercise; returns the exit code."""
    any_console()
    print(f"\nwhat to mend in {folder}:")
    solved = []
    for row in rows:
        results = [said for key, said in found.items() if graded_by(row, key) and said != ""]
        passed = results.count(None)
        print(row.name, row.stars * "★", end=": ")
        if row in missing:
            print(missing[row])
        elif results and passed == len(results):
            solved.append(row)
            print(f"solved, {passed} of {passed} tests pass")
        else:
            print(f"{passed} of {len(results)} tests pass")
            said = {re.sub(r" \((for|got) .*", "", text): text for text in results if text}
            for text in [*said.values()][:4]:
                print(f"  - {text}")
            print(f'  Hints: tests/course/exercises.md, exercise "{row.name}"')
    if solved == rows:
        own_code(rows, folder)
    stars, total = (sum(row.stars for row in each) for each in (solved, rows))
    print(
        f"{folder.resolve().name}: {len(solved)} of {len(rows)} exercises solved,",
        f"{stars} of {total} stars",
    )
    return solved != rows


def own_code(rows, folder):
    """Prints the commands with which these exercises run in the robot, of each lesson that has one of
    them, also in parentheses."""
    for number in range(1, 12):
        lesson = part(number)
        if any(f"`build.{row.name}`" in lesson for row in rows):
            told = re.search(r"^- Your own code: `([^`]+)`", lesson, re.MULTILINE)[1]
            told = " ".join(told.split()).replace(f"exercises/lesson{number}", folder.as_posix())
            print(f"Run your own code: {told}")


class Watch:
    """A plugin of the process that grades."""

    def __init__(self, graded, folder, patience):
        self.graded = open(graded, "a", buffering=1)
        self.folder = folder
        self.patience = float(patience)
        self.limit = float("inf")  # [s] of processor time for what runs
        threading.Thread(target=self.watch, daemon=True).start()

    def watch(self):
        """In a thread of its own: ends this process if what runs has computed for too long."""
        while time.process_time() < self.limit:
            time.sleep(0.1)
        self.note(self.running, COMPUTES)
        os._exit(1)

    def begin(self, key):
        """A test runs, or a module is imported."""
        self.running = key
        self.note(key, ENDS)
        self.limit = time.process_time() + self.patience
        # This clock also stops a call that lets no other thread of Python run.
        faulthandler.dump_traceback_later(10 * self.patience, exit=True, file=self.graded)

    def note(self, key, said):
        print(json.dumps([key, said]), file=self.graded)

    def pytest_configure(self):
        sys.path.insert(0, self.folder)  # before the folders of .pytest.ini

    def pytest_collectstart(self, collector):
        if isinstance(collector, pytest.Module):
            self.begin(collector.nodeid)

    def pytest_collectreport(self, report):
        self.note(report.nodeid, hint(report) if report.failed else "")

    def pytest_runtest_logstart(self, nodeid):
        self.begin(nodeid)

    def pytest_runtest_logreport(self, report):
        if report.when == "call" or not report.passed:
            self.note(report.nodeid, None if report.passed else hint(report))


# What pytest and numpy write, and how it is said in a few words.
WORDS = (
    (r"AssertionError:?\s*", ""),
    (r"NotImplementedError: exercise: (\w+)", r"\1 is not written yet"),
    (
        r"(ValueError: .* is read-only|RuntimeError: Inplace update to inference tensor).*",
        "what is given must not be written to",
    ),
    # Python, NumPy and PyTorch of arrays in a function for one robot
    (
        r"(\w+Error: (?:too many values|not enough values|The truth value|"
        r"Boolean value of Tensor|operands could not|only .*array|setting an array element|"
        r"Input must be 1- or 2-d|index \d is out of bounds for axis 0 with size \d\b).*?)\.?(?:\n(?s:.*))?\Z",
        r"\1: your function gets batches [n, …]",
    ),
    # NumPy of numbers [n] beside rows [n, 2]
    (
        r"(ValueError: all the input array.*?)\.?(?:\n(?s:.*))?\Z",
        r"\1: numbers [n] become a column by [..., None]",
    ),
    (
        r"(TypeError: .*NoneType.*?)\.?(?:\n(?s:.*))?\Z",
        r"\1: does each function return its result?",
    ),
    (r"(ZeroDivisionError.*?)\.?(?:\n(?s:.*))?\Z", r"\1: treat 0 apart"),
    # numpy writes a head line before the author's message.
    (r"(Not equal to tolerance|Arrays are not|Items are not).*\n+", ""),
)
# Numbers that differ: where (or nothing), got, expected
NUMBERS = (
    r"^ \[([\d, ]+)\]: (.*) \(ACTUAL\), (.*) \(DESIRED\)$",
    r"^\(shapes (\(.*\)), (\(.*\)) mismatch\)$",
    r"^ ACTUAL: (.*)\n DESIRED: (.*)$",
    r"^ +Obtained: (.*)\n +Expected: (.*?)(?: ±.*)?$",
    r"^ +(\d+) +\| (.*?) +\| (.*?) *$",
)


def hint(report):
    """What a failing test says, in a few words: its author's message, if there is one."""
    crash = getattr(report.longrepr, "reprcrash", None)
    if crash is None:  # a file that cannot be imported: the last line says why
        text = str(report.longrepr).strip()
        # The last place that is named: "name.py", line 7 of a SyntaxError, or name.py:7
        places = re.findall(r'([\w.]+\.py)(?:", line |:)(\d+)', text)
        where = "{}, line {}: ".format(*places[-1]) if places else ""
        return where + re.sub(r"^E\s*", "", text.splitlines()[-1])
    text = crash.message.strip()
    for written, said in WORDS:
        text = re.sub(rf"\A{written}", said, text)
    message = re.split(r"(?m)^(?:assert |Mismatch|x and y |nan |\(shapes| ACTUAL)", text)[0]
    # Without a message: what the test is called, and what it found.
    words = report.nodeid.partition("::test_")[2].replace("_", " ")
    said = " ".join(message.split()) or f"{words}: {text.partition(chr(10))[0] or 'failed'}"
    for numbers in NUMBERS:
        if found := re.search(numbers, text, re.M):
            *at, got, expected = found.groups()
            return f"{said} (got {got}, expected {expected}{''.join(f' at [{i}]' for i in at)})"
    return said


if __name__ == "__main__":  # the process that grades
    sys.dont_write_bytecode = True  # no __pycache__ among a student's files
    os.environ["PYTEST_ADDOPTS"] = ""  # --stages may be in there
    # The first import may take a minute (fonts are looked for), which is no student's fault.
    for library in "gymnasium", "matplotlib.figure", "mujoco.rollout", "pymunk", "torch":
        import_module(library)
    code = pytest.main(sys.argv[4:], [Watch(*sys.argv[1:4])])
    sys.stdout.flush()
    os._exit(code)  # no thread of a student, and nothing in atexit, keeps it alive
