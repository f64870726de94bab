"""A plugin of pytest, loaded by .pytest.ini. With `--stages FOLDER` it grades the exercises in that
folder; an exercise whose file is missing there is "not handed in":

    python -m pytest tests --stages=exercises              all of exercises/workbook.py
    python -m pytest tests --stages=exercises -k gae       this one; or -k "gae or quintic"

FOLDER is looked for where you are, then in the repository's root. From another folder, add the path
of `tests`, so that pytest finds .pytest.ini.
"""

import _thread
import os
import re
import signal
import sys
import threading
import time

import pytest
from sheet import ROOT  # of tests/exercises
from workbook import BOOK, graded_by

PATIENCE = 60  # [s] for the first test that does not end; the next ones get a sixth of it


def pytest_addoption(parser):
    parser.addoption("--stages", metavar="FOLDER", help="grade the exercises in this folder")


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
    config.pluginmanager.register(Grading(config, folder))


class Grading:
    """Runs the tests of the chosen exercises and nothing else, and says at last what to mend."""

    def __init__(self, config, folder):
        self.folder, chosen = folder, list(BOOK)
        words = re.findall(r"\w+", config.option.keyword)
        if words and set(words) <= {"or", *BOOK}:  # names of exercises, not of tests
            chosen = [name for name in BOOK if name in words]
            config.option.keyword = ""
        self.keyword = config.option.keyword  # of tests
        self.results = {name: [] for name in chosen}  # per test: None, or what the failing one says
        self.here = [name for name in chosen if (folder / f"{BOOK[name].file}.py").is_file()]
        self.patience = PATIENCE
        signal.signal(signal.SIGINT, signal.default_int_handler)  # in the background, too
        if config.option.tbstyle == "auto":
            config.option.tbstyle = "short"
        config.option.continue_on_collection_errors = True  # one bad file, and the others' grades
        config.option.reportchars = "N"  # no summary that cuts the hints off

    def pytest_report_header(self):
        files = sorted({f"{BOOK[name].file}.py" for name in self.here})
        return f"grading {self.folder}: {', '.join(files)}"

    def pytest_ignore_collect(self, collection_path):
        graders = {BOOK[name].tests[0] for name in self.here}
        return collection_path.suffix == ".py" and collection_path.stem not in graders or None

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, config, items):
        for item in items:
            item.exercises = [
                name
                for name in self.here
                if graded_by(BOOK[name], item.path.stem, item.originalname)
            ]
        config.hook.pytest_deselected(items=[item for item in items if not item.exercises])
        items[:] = [item for item in items if item.exercises]

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item):
        """An endless loop must not stop a teacher's loop over thirty submissions."""
        seconds, begin = self.patience, time.monotonic()
        late = threading.Timer(seconds, _thread.interrupt_main)
        late.daemon = True
        late.start()
        try:
            return (yield)
        except KeyboardInterrupt:
            if time.monotonic() - begin < seconds:
                raise  # Ctrl-C
            self.patience = PATIENCE / 6
            pytest.fail(f"takes longer than {seconds:.0f} s: a loop that never ends?")
        finally:
            late.cancel()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item, call):
        report = yield
        if report.when == "call" or report.failed:
            for name in item.exercises:
                self.results[name].append(None if report.passed else hint(report))
        return report

    @pytest.hookimpl(wrapper=True)
    def pytest_make_collect_report(self, collector):
        """A file that ends Python when it is imported must not take the other grades along."""
        try:
            return (yield)
        except SystemExit:
            said = "a file of these ends Python when it is imported (exit, or main() unguarded)"
            return pytest.CollectReport(collector.nodeid, "failed", said, None)

    def pytest_collectreport(self, report):
        if report.failed:  # the tests, or the student's file, could not be imported
            for name in self.here:
                if report.nodeid.endswith(f"{BOOK[name].tests[0]}.py"):
                    self.results[name].append(hint(report))

    @pytest.hookimpl(trylast=True)
    def pytest_terminal_summary(self, terminalreporter):
        write, stars, solved = terminalreporter.write_line, 0, 0
        if self.keyword and not any(self.results.values()):
            write(
                f"-k {self.keyword}: no exercise is called like that. There are: {', '.join(BOOK)}"
            )
            return
        terminalreporter.section(f"what to mend in {self.folder.name}")
        for name, results in self.results.items():
            row, head = BOOK[name], f"{name} {BOOK[name].stars * '★'}"
            passed = results.count(None)
            if name not in self.here:
                write(f"{head}: not handed in, there is no {row.file}.py")
            elif not results:
                write(f"{head}: not graded, its tests were not run")
            elif passed == len(results):
                stars, solved = stars + row.stars, solved + 1
                write(f"{head}: solved, {passed} of {passed} tests pass", green=1)
            else:
                write(f"{head}: {passed} of {len(results)} tests pass", red=1)
                said = {re.sub(r" \((for|got) .*", "", text): text for text in results if text}
                for text in [*said.values()][:4]:
                    write(f"  - {text}")
                write(f'  Hints: tests/exercises/README.md, exercise "{name}"')
        total = sum(BOOK[name].stars for name in self.results)
        write(
            f"{self.folder.name}: {solved} of {len(self.results)} exercises solved, "
            f"{stars} of {total} stars"
        )


# What numpy and pytest write about the numbers that differ: where (or nothing), got, expected.
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
    text = crash.message.removeprefix("AssertionError").removeprefix(":").strip()
    text = re.sub(r"^NotImplementedError: exercise: (\w+)", r"\1 is not written yet", text)
    text = re.sub(
        r"^(ValueError: .* is read-only|RuntimeError: Inplace update to inference tensor).*",
        "what is given must not be written to",
        text,
    )
    # numpy writes a head line before the author's message and its numbers behind it.
    text = re.sub(r"^(Not equal to tolerance|Arrays are not|Items are not).*\n+", "", text)
    message = re.split(r"^(?:assert |Mismatch|x and y |\(shapes| ACTUAL)", text, flags=re.M)[0]
    # Without a message: what the test is called, and what it found.
    words = report.nodeid.split("::")[-1].removeprefix("test_").replace("_", " ")
    said = " ".join(message.split()) or f"{words}: {text.partition(chr(10))[0] or 'failed'}"
    for found in filter(None, (re.search(numbers, text, re.M) for numbers in NUMBERS)):
        *place, got, expected = (re.sub(r"(\.\d{7})\d+", r"\1", part) for part in found.groups())
        return f"{said} (got {got}, expected {expected}{''.join(f' at [{i}]' for i in place)})"
    return said
