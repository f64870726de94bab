"""Grades many submissions in one process, each by the command that the sheet names.

For ../test_workbook.py, which asks whether the grading is right: stdin is a JSON list of
[label, exercise, {file: text}]; for each one a line of JSON comes back: [label, exit code, what the
student reads at last].
"""

import contextlib
import io
import json
import os
import shlex
import sys
import tempfile
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).resolve().parent))
from workbook import command  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]

def forget(folder):
    """Every module of ours and of the submission: the next one brings its own. (But none of the
    virtual environment, which may lie in our folder: numpy cannot be loaded twice.)
    """
    for name, module in list(sys.modules.items()):
        path = Path(getattr(module, "__file__", None) or "/")
        ours = path.is_relative_to(ROOT) and not path.is_relative_to(sys.prefix)
        if name != "__main__" and (ours or path.is_relative_to(folder)):
            del sys.modules[name]

def grade(exercise, files):
    """(exit code, what pytest printed) for a folder with these files, as in a fresh process."""
    path, said = list(sys.path), io.StringIO()
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            Path(folder, name).write_text(text, encoding="utf-8")
        words = shlex.split(command(exercise, f'"{Path(folder).as_posix()}"'))
        with contextlib.redirect_stdout(said):
            code = pytest.main([str(ROOT / "tests"), *words[3:],  # the folder lies elsewhere
                                "-p", "no:cacheprovider", "--capture=sys"])
        forget(Path(folder).resolve())
    sys.path[:] = path
    return int(code), said.getvalue()

if __name__ == "__main__":
    os.chdir(ROOT)
    for label, exercise, files in json.load(sys.stdin):
        code, said = grade(exercise, files)
        print(json.dumps([label, code, said]), flush=True)
