"""Clean exercise sheets: copies of the stages in which the functions of workbook.py are empty.

    python tests/course/sheet.py                      all of them, into exercises/
    python tests/course/sheet.py --lesson 3           those of lesson 3, into exercises/lesson3/
    python tests/course/sheet.py --only gae quintic   only these are empty
    python tests/course/sheet.py --edition FOLDER     a repository for students, without solutions

Docstrings stay, and comments on a line of their own. Only --force
overwrites. The last line of each file tells the grader what was empty in it.

With --edition the stages and studies themselves are empty there, and the bugs are in disguise. With
--only or --lesson as well all other functions are there; see teaching.md.
"""

import ast
import codecs
import re
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from functools import cache
from pathlib import Path

from debug import BUGS, FOLDER, copied, read_bug
from workbook import BOOK, any_console, command

ROOT = Path(__file__).resolve().parents[2]
MARK = "# Empty in this sheet:"


def find(file):
    """The path of a module that has exercises: a stage, one beside this script, or a study."""
    places = ROOT, ROOT / "tests/course", ROOT / "tests/studies"
    return next(path for place in places if (path := place / f"{file}.py").is_file())


def function_in(tree, name):
    """The node of a function, or of a method with its class: "WalkEngine._swing"."""
    for part in name.split("."):
        tree = next(node for node in tree.body if getattr(node, "name", None) == part)
    return tree


parsed = cache(ast.parse)


def left_out(source, exercise):
    """Is an exercise no part of this sheet: not empty at first, and as in the root?"""
    if re.search(rf"^{MARK}.*\b{exercise.name}\b", source, re.MULTILINE):
        return False

    def functions(text):
        return [ast.dump(function_in(parsed(text), name)) for name in exercise.functions]

    try:
        return functions(source) == functions(find(exercise.file).read_text("utf-8-sig"))
    except (SyntaxError, ValueError, StopIteration):  # no Python, or without this function
        return False


def part(number):
    """A lesson of the course."""
    page = ROOT / "tests/course/README.md"
    return page.read_text("utf-8").partition(f"\n## Lesson {number}: ")[2].partition("\n## ")[0]


def lesson(number):
    """The exercises of a lesson, without those in parentheses."""
    return re.findall(r"\s`build\.(\w+)`", part(number))


def body_of(source, name, since=""):
    """(first, end, indent): lines[first:end] are to be written, all behind the docstring."""
    node = function_in(ast.parse(source), name)
    after = node.body[0].lineno - 1
    statements = list(node.body)
    if ast.get_docstring(node) is not None:
        after = statements.pop(0).end_lineno
    while since and not ast.get_source_segment(source, statements[0]).startswith(since):
        after = statements.pop(0).end_lineno
    return after, node.end_lineno, " " * node.body[0].col_offset


def replaced(source, name, lines, since=""):
    """The source with other lines (not indented) as that body."""
    first, end, indent = body_of(source, name, since)
    old = source.splitlines()
    return "\n".join(old[:first] + [(indent + line).rstrip() for line in lines] + old[end:]) + "\n"


def emptied(source, exercise):
    """The source without the exercise's solution; comments with a line of their own stay."""
    if f'"exercise: {exercise.name}"' in source:
        return source  # in an edition it is so already
    for name in exercise.functions:
        first, end, _ = body_of(source, name, exercise.since)
        lines = [line.strip() for line in source.splitlines()[first:end]]
        stub = [line for line in lines if line.startswith("#")]
        stub.append(f'raise NotImplementedError("exercise: {exercise.name}")')
        source = replaced(source, name, stub, exercise.since)
    return source


def sheets(names):
    """The text of every file of a clean sheet, by its name; these exercises are empty."""
    texts = {}
    for exercise in BOOK.values():
        path = find(exercise.file)
        text = texts.setdefault(path.name, path.read_text("utf-8-sig"))
        if exercise.name in names:
            texts[path.name] = emptied(text, exercise)
    return texts


def noted(text):
    """The text of a file, with what lets a study run elsewhere, and with the mark for the grader."""
    studies = ascii(str(ROOT / "tests/studies"))  # whatever the folder is called
    first = re.search(r"^import (baseline|common)$", text, re.MULTILINE)
    if first:
        path = f"import sys\n\nsys.path.insert(1, {studies})  # where this is\n"
        text = text[: first.start()] + path + text[first.start() :]
    empty = dict.fromkeys(re.findall(r'"exercise: (\w+)"', text))
    return f"{text}\n{MARK} {', '.join(empty)}\n"


def edition(names, out):
    """Writes a repository for students, in which these exercises are empty."""
    copied(out, "README.md", "LICENSE", "requirements.txt", ".gitignore", "results/**/*")
    (out / FOLDER.relative_to(ROOT)).mkdir()
    for path in FOLDER.iterdir():
        hidden = out / path.relative_to(ROOT).with_suffix(".rot13")
        hidden.write_text(codecs.encode(path.read_text("utf-8"), "rot13"), "utf-8")
    for row in (BOOK[name] for name in names):
        path = out / find(row.file).relative_to(ROOT)
        path.write_text(emptied(path.read_text("utf-8-sig"), row), "utf-8", newline="\n")
    print(f"A repository for students is in {out}")


def main():
    any_console()
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--only", nargs="+", choices=BOOK, default=BOOK, metavar="NAME")
    which.add_argument("--lesson", type=int, choices=range(1, 11), help="those of a lesson")
    parser.add_argument("--out", type=Path, metavar="FOLDER")
    parser.add_argument("--edition", type=Path, metavar="FOLDER", help="write one for students")
    parser.add_argument("--force", action="store_true", help="overwrite what is there")
    args = parser.parse_args()
    names, out = args.only, ROOT / "exercises"
    if args.lesson:
        names = lesson(args.lesson)
        out /= f"lesson{args.lesson}"
    out = (args.edition or args.out or out).resolve()
    if out in [find(row.file).parent for row in BOOK.values()]:
        parser.error(f"{out} holds the solutions; take another folder")
    for name in BUGS:
        file, _, bug = read_bug(name)
        if "".join(bug.split()) in "".join((ROOT / file).read_text("utf-8").split()):
            parser.error(f"{file} has a bug; take it out: python tests/course/debug.py undo {name}")
    texts = {name: noted(text) for name, text in sheets(names).items()}
    if args.force:  # only the files of the named exercises; others may be solved
        named = {f"{BOOK[name].file}.py" for name in names}
        texts = {name: texts[name] for name in texts if name in named or not (out / name).exists()}
    elif any((out / name).exists() for name in texts):
        parser.error(f"{out} holds exercises; --force overwrites them, --out writes elsewhere")
    try:
        if args.edition:
            return edition(names, out)
        out.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            (out / name).write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        parser.error(f"cannot write to {out}: {error.strerror}")
    for name in names:
        row = BOOK[name]
        stub = f'("exercise: {name}")'
        lines = texts[f"{row.file}.py"].splitlines()
        gaps = [f"{row.file}.py:{k}" for k, line in enumerate(lines, 1) if line.endswith(stub)]
        print(f"{name:22s}{row.stars * '★':5s}{row.minutes:4d} min  {', '.join(gaps)}")
    folder = (out.relative_to(ROOT) if out.is_relative_to(ROOT) else out).as_posix()
    some = names if len(names) < len(BOOK) else ["gae"]
    graded = command(f'"{" or ".join(some)}"', f'"{folder}"')
    print(f"To be written in {out}. Graded, from {ROOT}, by\n    {graded}")


if __name__ == "__main__":
    main()
