"""Lets the tests import the stages: import_module("04_ppo"). With `--stages FOLDER` it grades the
exercises in that folder; an exercise whose file it lacks is "not handed in":

    python -m pytest --stages exercises              all of tests/exercises/workbook.py
    python -m pytest --stages exercises -k gae       this one; or -k "gae or quintic"

The folder is seen from where you are, or else from the repository's root. Whoever is elsewhere, or
grades a folder elsewhere, also writes the path of `tests`: so pytest finds this file, and with it
the option.
"""

import _thread
import ast
import contextlib
import os
import re
import signal
import sys
import threading
from pathlib import Path

import pytest

os.environ["MPLBACKEND"] = "Agg"  # draw into files, without a screen
ROOT = Path(__file__).resolve().parent
sys.path.insert(0, str(ROOT))
sys.path.append(str(ROOT / "tests" / "exercises"))

import sheet  # noqa: E402  (in tests/exercises)
from workbook import BOOK, graded_by  # noqa: E402

PATIENCE = 60  # [s] for the first test that does not end; the next ones get a sixth of it

def pytest_addoption(parser):
    parser.addoption("--stages", metavar="FOLDER", help="grade the exercises in this folder")

def pytest_configure(config):
    given = config.getoption("stages")
    if given is None:
        return
    places = [base / given for base in (config.invocation_params.dir, ROOT)]
    folder = next((place.resolve() for place in places if place.is_dir()), None)
    if folder is None:
        raise pytest.UsageError(f"--stages {given}: there is no such folder")
    if not any((folder / f"{row.file}.py").is_file() for row in BOOK.values()):
        raise pytest.UsageError(f"--stages {given}: neither a stage nor another exercise in there")
    sys.path.insert(0, str(folder))
    sys.dont_write_bytecode = True  # nothing of ours among a student's files
    signal.signal(signal.SIGINT, signal.default_int_handler)  # in the background, too: `_patience`
    config.pluginmanager.register(Grading(config, folder))

class Grading:
    """Runs the tests of the chosen exercises and nothing else, and says at last what to mend."""

    def __init__(self, config, folder):
        self.folder, self.chosen = folder, list(BOOK)
        words = re.findall(r"\w+", config.option.keyword)
        if words and set(words) <= {"or", *BOOK}:  # names of exercises, not of tests
            self.chosen = [name for name in BOOK if name in words]
            config.option.keyword = ""
        self.absent = [name for name in self.chosen
                       if not (folder / f"{BOOK[name].file}.py").is_file()]
        self.endless = False
        self.passed = {name: [] for name in self.chosen}  # a bool for every test
        self.hints = {name: [] for name in self.chosen}  # what failing tests say
        self.tests = {}  # exercises by the test's node id
        if config.option.tbstyle == "auto":
            config.option.tbstyle = "short"
        config.option.continue_on_collection_errors = True  # one bad file, and the others' grades
        config.option.reportchars = "N"  # no summary that cuts the hints off

    def pytest_report_header(self):
        here = sorted({f"{row.file}.py" for row in BOOK.values()
                       if (self.folder / f"{row.file}.py").is_file()})
        return f"grading {self.folder}: {', '.join(here)}"

    def pytest_ignore_collect(self, collection_path):
        graders = {BOOK[name].tests[0] for name in self.chosen if name not in self.absent}
        return collection_path.suffix == ".py" and collection_path.stem not in graders or None

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, config, items):
        for item in items:
            self.tests[item.nodeid] = [
                name for name in self.chosen if name not in self.absent
                and graded_by(BOOK[name], item.path.stem, item.originalname)]
        others = [item for item in items if not self.tests[item.nodeid]]
        if others:
            config.hook.pytest_deselected(items=others)
            items[:] = [item for item in items if self.tests[item.nodeid]]

    @contextlib.contextmanager
    def _patience(self):
        """An endless loop must not stop a teacher's loop over thirty submissions."""
        seconds, stopped = PATIENCE / 6 if self.endless else PATIENCE, []

        def stop():
            stopped.append(True)
            _thread.interrupt_main()

        late = threading.Timer(seconds, stop)
        late.daemon = True
        late.start()
        try:
            yield
        except KeyboardInterrupt:
            if not stopped:
                raise
            self.endless = True
            words = f"takes longer than {seconds:.0f} s: a loop that never ends?"
            raise TimeoutError(words) from None
        finally:
            late.cancel()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item):
        try:
            with self._patience():
                return (yield)
        except TimeoutError as error:
            pytest.fail(str(error))

    @pytest.hookimpl(wrapper=True)
    def pytest_make_collect_report(self, collector):
        try:
            with self._patience():
                return (yield)
        except TimeoutError as error:  # at the import of a file
            return pytest.CollectReport(collector.nodeid, "failed", str(error), [])

    def pytest_runtest_logreport(self, report):
        if report.when == "call" or report.failed:
            for name in self.tests[report.nodeid]:
                self.passed[name].append(report.passed)
                if report.failed:
                    self._keep(name, report)

    def pytest_collectreport(self, report):
        if report.failed:  # the module of the tests could not be imported
            for name in self.chosen:
                if report.nodeid.endswith(f"{BOOK[name].tests[0]}.py"):
                    self.passed[name].append(False)
                    self._keep(name, report)

    def _keep(self, name, report):
        text = hint(report)
        if text not in self.hints[name]:
            self.hints[name].append(text)

    def _copied(self, name):
        """Is it word for word (but for comments) what stands in the repository?"""
        row, bodies = BOOK[name], []
        for path in (self.folder / f"{row.file}.py", sheet.find(row.file)):
            try:
                tree = ast.parse(sheet.read(path))
                bodies.append([ast.dump(sheet.function_in(tree, part)) for part in row.functions])
            except (SyntaxError, UnicodeError, LookupError):
                return False
        return bodies[0] == bodies[1]

    @pytest.hookimpl(trylast=True)
    def pytest_terminal_summary(self, terminalreporter):
        write, stars, solved, copied = terminalreporter.write_line, 0, 0, 0
        terminalreporter.section(f"what to mend in {self.folder.name}")
        for name, passed in self.passed.items():
            head, file = f"{name} {BOOK[name].stars * '★'}", f"{BOOK[name].file}.py"
            if name in self.absent:
                write(f"{head}: not handed in, there is no {file}")
            elif not passed:
                write(f"{head}: not graded, its tests were not run")
            elif all(passed):
                same = self._copied(name)
                stars, solved, copied = stars + BOOK[name].stars, solved + 1, copied + same
                write(f"{head}: solved, {len(passed)} of {len(passed)} tests pass"
                      + ", word for word as in the repository" * same, green=1)
            else:
                write(f"{head}: {sum(passed)} of {len(passed)} tests pass", red=1)
                for text in self.hints[name][:4]:
                    write(f"  - {text}")
                write(f'  Hints: tests/exercises/README.md, exercise "{name}"')
        total = sum(BOOK[name].stars for name in self.passed)
        write(f"{self.folder.name}: {solved} of {len(self.passed)} exercises solved, {stars} of "
              f"{total} stars" + f"; {copied} word for word as in the repository" * bool(copied))

def hint(report):
    """What a failing test has to say, in a few words: its author's message, if there is one."""
    crash = getattr(report.longrepr, "reprcrash", None)
    if crash is None:  # a file that cannot be imported: the last line says why
        text = str(report.longrepr)
        lines = [line for line in text.splitlines() if line.strip()]
        # The last place that is named: "name.py", line 7 of a SyntaxError, or name.py:7
        places = re.findall(r'([\w.]+\.py)(?:", line |:)(\d+)', text)
        where = "{}, line {}: ".format(*places[-1]) if places else ""
        return where + re.sub(r"^E\s*", "", lines[-1])
    text = crash.message.removeprefix("AssertionError").removeprefix(":").strip()
    text = re.sub(r"^NotImplementedError: exercise: (\w+)", r"\1 is not written yet", text)
    # numpy's comparisons: the message stands between a head and the numbers.
    text = re.sub(r"^(Not equal to tolerance.*|Arrays are not .*|Items are not .*)\n+", "", text)
    lines = []
    for line in text.splitlines():
        if line.startswith(("assert ", "Mismatched", "x and y ", "(shapes", " ACTUAL", "Mismatch")):
            break
        lines.append(line.strip())
    # Without a message: what the test is called, and what it found.
    words = report.nodeid.split("::")[-1].removeprefix("test_").replace("_", " ")
    return " ".join(filter(None, lines)) or f"{words}: {(text.splitlines() or ['failed'])[0]}"
