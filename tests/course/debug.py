"""Puts a silent bug of debug.md into a stage, takes it out, or says if your test catches it.

    python tests/course/debug.py put tired
    python tests/course/debug.py tests/test_mine.py tired
    python tests/course/debug.py undo tired

The second runs your test twice, in a copy of the repository: it must pass without the bug and fail
with it, by an assertion. Your own files stay as they are, with a bug or without one.
"""

import codecs
import os
import re
import subprocess
import sys
import tempfile
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from contextlib import suppress
from pathlib import Path

from workbook import any_console

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "tests" / "course" / "bugs"  # a file of text for each
BUGS = sorted(path.stem for path in FOLDER.glob("*.*"))
KEPT = {"__pycache__", "bugs", "solutions", "repository", "teaching.md"}  # not for students
PATIENCE = 300  # [s] for a student's test
CAUGHT = 6  # exit code of pytest -p debug, if a test fails by an assertion; pytest's own end at 5


def read_bug(name):
    """(the stage's file, its old text, the bug's text): the first line, those with − and with +."""
    (path,) = FOLDER.glob(f"{name}.*")
    text = path.read_text("utf-8")
    if path.suffix == ".rot13":  # in an edition for students, see sheet.py
        text = codecs.decode(text, "rot13")
    file, *lines = text.splitlines()
    old, new = ("\n".join(line[2:] for line in lines if line[0] == mark) for mark in "-+")
    return file, old, new


def exchanged(source, old, new):
    """The source with `new` in the place of `old`, which must be there once, in any layout."""
    words = r"\s*".join(map(re.escape, re.findall(r"\w+|[^\w\s]", old)))
    found = [*re.finditer(rf"(?<!\w){words}(?!\w)", source)]
    if len(found) != 1:
        raise ValueError(f"these lines must be there once, and are {len(found)} times:\n{old}")
    before, after = source[: found[0].start()], source[found[0].end() :]
    indent = len(before) - 1 - before.rfind("\n")
    return before + new.replace("\n", "\n" + " " * indent) + after


def put(name, folder, undo=False):
    """Puts a bug into the stage in a folder, or takes it out."""
    file, *texts = read_bug(name)
    source = (folder / file).read_bytes().decode("utf-8")
    (folder / file).write_bytes(exchanged(source, *texts[:: -1 if undo else 1]).encode("utf-8"))


def copied(folder, *more):
    """The stages and what tests may import, in this folder; and more, files of the repository."""
    for pattern in ("0*.py", ".pytest.ini", "tests/**/*.*", *more):
        for path in ROOT.glob(pattern):
            name = path.relative_to(ROOT)
            if path.is_file() and not KEPT & {*name.parts}:
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                # Without its mode: it may be read-only
                (folder / name).write_bytes(path.read_bytes())


def pytest_exception_interact(node, call):
    """Pytest tells its plugins which error a test has met."""
    if call.excinfo.errisinstance(AssertionError):
        node.session.caught = True


def pytest_sessionfinish(session, exitstatus):
    if exitstatus == 1 and hasattr(session, "caught"):
        session.exitstatus = CAUGHT


def tested(folder):
    """(exit code of pytest, what it says) for the student's test."""
    # Without the grader, which would import this module before pytest can
    command = "-m pytest -q -o addopts= -p debug -p no:cacheprovider tests/test_of_mine.py".split()
    more = {"PYTHONIOENCODING": "utf-8", "PYTEST_ADDOPTS": "", "MPLBACKEND": "Agg"}
    try:
        done = subprocess.run(
            [sys.executable, *command],
            cwd=folder,
            timeout=PATIENCE,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            env=os.environ | more,
        )
    except subprocess.TimeoutExpired:
        sys.exit(f"Your test takes longer than {PATIENCE} s: a loop that never ends?")
    return done.returncode, done.stdout + done.stderr


def judged(file, bug):
    """What is said about the test in a file; SystemExit if it does not catch the bug."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        copied(folder)
        for other in BUGS:  # any of them may be in
            with suppress(ValueError):
                put(other, folder, undo=True)
        (folder / "tests" / "test_of_mine.py").write_bytes(Path(file).read_bytes())
        code, said = tested(folder)
        if code != 0:
            sys.exit(f"{said}\nWithout a bug your test must pass, and it does not.")
        put(bug, folder)
        code, said = tested(folder)
    if code != CAUGHT:
        sys.exit(
            f"{said}\nYour test passes without the bug. With {bug} it must fail by an assertion, "
            "and it does not."
        )
    return (
        f"{said}\nYour test passes without the bug and fails with {bug}: well done. Does the "
        "message above say what is wrong?"
    )


def main():
    any_console()
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("what", help="put, undo, or the file of your test")
    parser.add_argument("bug", choices=BUGS)
    args = parser.parse_args()
    try:
        if args.what in ("put", "undo"):
            put(args.bug, ROOT, undo=args.what == "undo")
            print(f"{args.bug} is {'in' if args.what == 'put' else 'out'}")
        else:
            print(judged(args.what, args.bug))
    except ValueError:
        parser.error(f"{args.bug}: it is so already, or its lines in the stage were changed")
    except OSError as error:
        parser.error(f"{error.filename}: {error.strerror}")


if __name__ == "__main__":
    main()
