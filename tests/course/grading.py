"""A plugin of pytest, loaded by .pytest.ini. With `--stages FOLDER` it grades the exercises in that
folder; an exercise whose file is missing there is "not handed in", and one that was not empty in the
sheet and is as in the root is "not in this sheet":

    python -m pytest tests --stages=exercises              all of tests/course/workbook.py
    python -m pytest tests --stages=exercises -k gae       this one; or -k "gae or quintic"

FOLDER is looked for where you are, then in the repository's root. From another folder, add the path
of `tests`, so that pytest finds .pytest.ini.

What a student writes may never end, or end Python. So another process grades, and writes down what it
begins and what comes out. If it ends too early, a new one goes on behind the test that ended it.
"""

import faulthandler
import json
import os
import re
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

import pytest
from sheet import ROOT, left_out, part  # of tests/course
from workbook import BOOK, graded_by

PATIENCE = 6  # [s] for an import or a test; a sixth for other tests of an exercise that was late
ENDS = "ends Python (exit, or main() unguarded?)"
GRADER = """
import os, pytest, sys
code = pytest.main()
sys.stdout.flush()
os._exit(code)  # no thread of a student, and nothing in atexit, keeps it alive
"""
LATE = "takes too long: a loop that never ends? (If the computer is busy: --patience 60)"


def pytest_addoption(parser):
    parser.addoption("--stages", metavar="FOLDER", help="grade the exercises in this folder")
    parser.addoption("--patience", type=float, default=PATIENCE, help="[s] for a test of these")


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config):
    """Lets other processes grade, until one of them comes to its end."""
    if config.getoption("stages") is None or "GRADED" in os.environ:
        return None
    command = [sys.executable, "-c", GRADER, *config.invocation_params.args]
    if config.pluginmanager.hasplugin("xdist"):
        command += ["-n", "0"]  # one test after the other
    stopped = []
    with tempfile.TemporaryDirectory() as folder:
        graded = Path(folder, "graded")
        graded.touch()
        while True:
            try:
                code = subprocess.run(command, env=os.environ | {"GRADED": str(graded)}).returncode
            except KeyboardInterrupt:
                return pytest.ExitCode.INTERRUPTED
            known = stopped
            found = read(graded).items()
            stopped = [f"{key} {said}" for key, (_, said) in found if said in (ENDS, LATE)]
            if stopped == known:
                return pytest.ExitCode.TESTS_FAILED if stopped else code
            print(f"\n{stopped[-1]} What is left is graded now.\n", flush=True)


def read(graded):
    """What was written down by test or module: the exercises that it grades, and what it says; None:
    it passes."""
    found = {}
    for line in graded.read_text("utf-8").splitlines():
        if line.startswith("["):
            key, names, said = json.loads(line)
            found[key] = names, said
        elif line.startswith("Timeout"):  # faulthandler says so of the last one
            found[key] = names, LATE
    return found


def pytest_configure(config):
    os.environ["MPLBACKEND"] = "Agg"  # figures need no screen
    given = config.getoption("stages")
    if given is None:
        return
    places = [base / given for base in (config.invocation_params.dir, ROOT)]
    folder = next((place.resolve() for place in places if place.is_dir()), None)
    if folder is None:
        raise pytest.UsageError(f"--stages {given}: there is no such folder")
    if not any((folder / f"{row.file}.py").is_file() for row in BOOK.values()):
        raise pytest.UsageError(f"--stages {given}: neither a stage nor another exercise in there")
    sys.path.insert(0, str(folder))  # before the folders of .pytest.ini
    sys.dont_write_bytecode = True  # no __pycache__ among a student's files
    config.pluginmanager.register(Grading(config, folder, Path(os.environ["GRADED"])))


class Grading:
    """Runs the tests of the chosen exercises and nothing else, and says at last what to mend."""

    def __init__(self, config, folder, graded):
        self.folder = folder
        self.chosen = list(BOOK)
        words = re.findall(r"\w+", config.option.keyword)
        if words and set(words) <= {"or", *BOOK}:  # names of exercises, not of tests
            self.chosen = [name for name in BOOK if name in words]
            config.option.keyword = ""
        self.keyword = config.option.keyword  # of tests
        self.missing = {}  # exercises that are not graded, and why
        for name in self.chosen:
            path = folder / f"{BOOK[name].file}.py"
            if not path.is_file():
                self.missing[name] = f"not handed in, there is no {path.name}"
            elif left_out(path.read_text("utf-8-sig", "replace"), BOOK[name]):
                self.missing[name] = "not in this sheet"
        self.here = [name for name in self.chosen if name not in self.missing]
        self.patience = config.getoption("patience")
        for library in ("mujoco", "gymnasium", "torch"):  # slow to import, and no student's fault
            import_module(library)
        self.found = read(graded)  # by the processes before this one
        self.graded = graded.open("a", buffering=1, encoding="utf-8")
        if config.option.tbstyle == "auto":
            config.option.tbstyle = "short"
        config.option.continue_on_collection_errors = True  # one bad file, and the others' grades
        config.option.reportchars = "N"  # no summary that cuts the hints off

    def note(self, key, names, said):
        """Writes down what a test or a module says about these exercises."""
        self.found[key] = names, said
        print(json.dumps([key, names, said]), file=self.graded)

    @contextmanager
    def watched(self, key, names, seconds):
        """What begins now ends this process, if it does not end itself in time."""
        self.note(key, names, ENDS)
        faulthandler.dump_traceback_later(seconds, exit=True, file=self.graded)
        try:
            yield
        except (SystemExit, KeyboardInterrupt, pytest.exit.Exception):
            os._exit(1)  # without a summary: the process behind this one prints it
        finally:
            faulthandler.cancel_dump_traceback_later()

    def pytest_report_header(self):
        files = sorted({f"{BOOK[name].file}.py" for name in self.here})
        return f"grading {self.folder}: {', '.join(files)}"

    def pytest_ignore_collect(self, collection_path):
        graders = {BOOK[name].tests[0] for name in self.here}
        graders -= {key for key, (_, said) in self.found.items() if said}  # cannot be imported
        return collection_path.suffix == ".py" and collection_path.stem not in graders or None

    @pytest.hookimpl(wrapper=True)
    def pytest_make_collect_report(self, collector):
        """The tests, or the student's file, may not be importable."""
        if not isinstance(collector, pytest.Module):
            return (yield)
        module = collector.path.stem
        names = [name for name in self.here if BOOK[name].tests[0] == module]
        with self.watched(module, names, self.patience):
            report = yield
        self.note(module, *((names, hint(report)) if report.failed else ((), None)))
        return report

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, config, items):
        for item in items:
            item.exercises = [
                name
                for name in self.here
                if graded_by(BOOK[name], item.path.stem, item.originalname)
            ]
        left = [item for item in items if item.exercises and item.nodeid not in self.found]
        config.hook.pytest_deselected(items=[item for item in items if item not in left])
        items[:] = left

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item):
        late = any(
            said == LATE and {*names} & {*item.exercises} for names, said in self.found.values()
        )
        with self.watched(item.nodeid, item.exercises, self.patience / (6 if late else 1)):
            return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item, call):
        report = yield
        if report.when == "call" or not report.passed:
            self.note(item.nodeid, item.exercises, None if report.passed else hint(report))
        return report

    @pytest.hookimpl(trylast=True)
    def pytest_terminal_summary(self, terminalreporter):
        write = terminalreporter.write_line
        solved = []
        if self.keyword and not any(names for names, _ in self.found.values()):
            write(
                f"-k {self.keyword}: no exercise is called like that. There are: {', '.join(BOOK)}"
            )
            return
        terminalreporter.section(f"what to mend in {self.folder.name}")
        for name in self.chosen:
            results = [said for names, said in self.found.values() if name in names]
            row = BOOK[name]
            head = f"{name} {row.stars * '★'}"
            passed = results.count(None)
            if name in self.missing:
                write(f"{head}: {self.missing[name]}")
            elif not results:
                write(f"{head}: not graded, its tests were not run")
            elif passed == len(results):
                solved.append(name)
                write(f"{head}: solved, {passed} of {passed} tests pass", green=1)
            else:
                write(f"{head}: {passed} of {len(results)} tests pass", red=1)
                said = {re.sub(r" \((for|got) .*", "", text): text for text in results if text}
                for text in [*said.values()][:4]:
                    write(f"  - {text}")
                write(f'  Hints: tests/course/exercises.md, exercise "{name}"')
        for told in own_code(solved, self.folder):
            write(f"Run your own code: {told}")
        stars, total = (sum(BOOK[name].stars for name in names) for names in (solved, self.chosen))
        write(
            f"{self.folder.name}: {len(solved)} of {len(self.chosen)} exercises solved, "
            f"{stars} of {total} stars"
        )


def own_code(solved, folder):
    """The commands with which solved exercises run in the robot, of each lesson that has one of
    them, also in parentheses; none if another function in this folder is still empty."""
    if any('"exercise: ' in path.read_text("utf-8", "replace") for path in folder.glob("*.py")):
        return
    shown = (folder.relative_to(ROOT) if folder.is_relative_to(ROOT) else folder).as_posix()
    for number in range(1, 12):
        if {*re.findall(r"`build\.(\w+)`", part(number))} & {*solved}:
            (told,) = re.findall(r"^- Your own code: `([^`]+)`", part(number), re.MULTILINE)
            yield re.sub(r"exercises/lesson\d+", shown, " ".join(told.split()))


# What numpy and pytest write about the numbers that differ: where (or nothing), got, expected.
NUMBERS = (
    r"^ \[([\d, ]+)\]: (.*) \(ACTUAL\), (.*) \(DESIRED\)$",
    r"^\(shapes (\(.*\)), (\(.*\)) mismatch\)$",
    r"^ ACTUAL: (.*)\n DESIRED: (.*)$",
    r"^ +Obtained: (.*)\n +Expected: (.*?)(?: ±.*)?$",
    r"^ +(\d+) +\| (.*?) +\| (.*?) *$",
)

# What Python, NumPy and PyTorch say of arrays in a function for one robot
NOT_ONE = (
    r"\w+Error: (too many values|not enough values|The truth value|Boolean value of Tensor|"
    r"operands could not|only .*array|setting an array element|Input must be 1- or 2-d|"
    r"index \d is out of bounds for axis 0 with size \d\b)"
)
NOT_JOINED = r"ValueError: all the input array"  # what NumPy says of numbers [n] beside rows [n, 2]


def hint(report):
    """What a failing test says, in a few words: its author's message, if there is one."""
    crash = getattr(report.longrepr, "reprcrash", None)
    if crash is None:  # a file that cannot be imported: the last line says why
        text = str(report.longrepr).strip()
        # The last place that is named: "name.py", line 7 of a SyntaxError, or name.py:7
        places = re.findall(r'([\w.]+\.py)(?:", line |:)(\d+)', text)
        where = "{}, line {}: ".format(*places[-1]) if places else ""
        return where + re.sub(r"^E\s*", "", text.splitlines()[-1])
    text = crash.message.removeprefix("AssertionError").removeprefix(":").strip()
    text = re.sub(r"^NotImplementedError: exercise: (\w+)", r"\1 is not written yet", text)
    text = re.sub(
        r"^(ValueError: .* is read-only|RuntimeError: Inplace update to inference tensor).*",
        "what is given must not be written to",
        text,
    )
    for pattern, more in (
        (NOT_ONE, "your function gets batches [n, …]"),
        (NOT_JOINED, "numbers [n] become a column by [..., None]"),
        ("TypeError: .*NoneType", "does each function return its result?"),
        ("ZeroDivisionError", "treat 0 apart"),
    ):
        if re.match(pattern, text):
            text = f"{text.splitlines()[0].rstrip('.')}: {more}"
    # numpy writes a head line before the author's message and its numbers behind it.
    text = re.sub(r"^(Not equal to tolerance|Arrays are not|Items are not).*\n+", "", text)
    message = re.split(r"^(?:assert |Mismatch|x and y |nan |\(shapes| ACTUAL)", text, flags=re.M)[0]
    # Without a message: what the test is called, and what it found.
    words = report.nodeid.split("::")[-1].removeprefix("test_").replace("_", " ")
    said = " ".join(message.split()) or f"{words}: {text.partition(chr(10))[0] or 'failed'}"
    text = re.sub(r"array\((.*?)(, dtype=\w+)?\)", r"\1", text)
    for numbers in NUMBERS:
        if found := re.search(numbers, text, re.M):
            *at, got, expected = (re.sub(r"(\.\d{7})\d+", r"\1", part) for part in found.groups())
            return f"{said} (got {got}, expected {expected}{''.join(f' at [{i}]' for i in at)})"
    return said
