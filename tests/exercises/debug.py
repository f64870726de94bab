"""Does your test catch a silent bug of debug.md?

    python tests/exercises/debug.py mine.py tired

Runs the tests in mine.py twice, in a copy of the repository: they must pass without the bug and
fail with it, by an assertion. Your own files stay as they are.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BUGS = ROOT / "tests" / "exercises" / "bugs"


def copied(folder):
    """The stages and what tests may import, in this folder."""
    for path in [*ROOT.glob("0*.py"), ROOT / ".pytest.ini"]:
        shutil.copy(path, folder)
    shutil.copytree(ROOT / "tests", folder / "tests", ignore=shutil.ignore_patterns("__pycache__"))


def tested(folder):
    """(exit code of pytest, what it says) for the student's test."""
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "tests/test_of_mine.py",
    ]
    done = subprocess.run(command, cwd=folder, capture_output=True, encoding="utf-8", check=False)
    return done.returncode, done.stdout + done.stderr


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("file", type=Path, help="your test")
    parser.add_argument("bug", choices=sorted(path.stem for path in BUGS.glob("*.patch")))
    args = parser.parse_args()
    if not args.file.is_file():
        parser.error(f"{args.file}: no such file")
    if shutil.which("git") is None:
        parser.error("patches are applied by git, which is not installed")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        copied(folder)
        shutil.copy(args.file, folder / "tests" / "test_of_mine.py")
        code, said = tested(folder)
        if code != 0:
            sys.exit(f"{said}\nWithout the bug your test must pass, and it does not.")
        # git must not take the copy for a part of a repository around it.
        subprocess.run(
            ["git", "apply", BUGS / f"{args.bug}.patch"],
            cwd=folder,
            check=True,
            env={**os.environ, "GIT_CEILING_DIRECTORIES": str(folder.parent)},
        )
        code, said = tested(folder)
        if code != 1 or "AssertionError" not in said:
            sys.exit(
                f"{said}\nYour test passes without the bug. With {args.bug} it must fail by "
                "an assertion, and it does not."
            )
    print(
        f"{said}\nYour test passes without the bug and fails with {args.bug}: well done. Does "
        "the message above say what is wrong?"
    )


if __name__ == "__main__":
    main()
