"""Clean exercise sheets: copies of the stages in which the functions of workbook.py are empty.

    python tests/exercises/sheet.py                      all of them, into exercises/
    python tests/exercises/sheet.py --only gae quintic   only these are empty

Docstrings stay, and comments, for they hold the equations. What is there is overwritten only with
--force.
"""

import argparse
import ast
import io
import sys
import textwrap
import tokenize
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent))
from workbook import BOOK, command  # noqa: E402  (beside this script)

ROOT = Path(__file__).resolve().parents[2]

def find(file):
    """The path of a module that has exercises: a stage, one beside this script, or a study."""
    places = ROOT, ROOT / "tests" / "exercises", ROOT / "tests" / "studies"
    return next(path for path in (place / f"{file}.py" for place in places) if path.is_file())

def read(path):
    """Its text, with \\n at the ends of lines on every system."""
    return path.read_text(encoding="utf-8")

def function_in(tree, name):
    """The node of a function, or of a method with its class: "WalkEngine._swing"."""
    for part in name.split("."):
        tree = next((node for node in tree.body if getattr(node, "name", None) == part), None)
        if tree is None:
            raise LookupError(f"workbook.py: there is no {name}")
    return tree

def body_of(source, name, since=""):
    """(first, end, indent): lines[first:end] of the source are what is to be written.

    Without the docstring, with the comments above the first statement.
    """
    node = function_in(ast.parse(source), name)
    after, statements = node.body[0].lineno - 1, list(node.body)
    if ast.get_docstring(node) is not None:
        after = statements.pop(0).end_lineno
    while since and not ast.get_source_segment(source, statements[0]).startswith(since):
        after = statements.pop(0).end_lineno
        if not statements:
            raise LookupError(f"workbook.py: no statement of {name} begins with {since!r}")
    return after, node.end_lineno, " " * node.body[0].col_offset

def replaced(source, name, lines, since=""):
    """The source with other lines (not indented) as that body."""
    first, end, indent = body_of(source, name, since)
    old = source.splitlines()
    return "\n".join(old[:first] + [(indent + line).rstrip() for line in lines] + old[end:]) + "\n"

def equations(source, name, since=""):
    """The comments of that body that have a line of their own."""
    first, end, _ = body_of(source, name, since)
    comments = [token for token in tokenize.generate_tokens(io.StringIO(source).readline)
                if token.type == tokenize.COMMENT]
    return [token.string for token in comments
            if first < token.start[0] <= end and token.line.lstrip().startswith("#")]

def emptied(source, exercise):
    """The source without the exercise's solution."""
    for name in exercise.functions:
        stub = [*equations(source, name, exercise.since),
                f'raise NotImplementedError("exercise: {exercise.name}")']
        source = replaced(source, name, stub, exercise.since)
    return source

def solved(source, exercise, solution):
    """The source with the bodies of the functions in the text `solution` instead of ours."""
    lines = solution.splitlines()
    for node in ast.parse(solution).body:
        name, = (name for name in exercise.functions if name.split(".")[-1] == node.name)
        body = textwrap.dedent("\n".join(lines[node.lineno : node.end_lineno]))
        source = replaced(source, name, body.splitlines(), exercise.since)
    return source

def sheets(names):
    """All files of a clean sheet by name, with these exercises empty."""
    texts = {}
    for exercise in BOOK.values():
        path = find(exercise.file)
        text = texts.setdefault(path.name, read(path))
        if exercise.name in names:
            texts[path.name] = emptied(text, exercise)
    return texts

def main():
    sys.stdout.reconfigure(errors="replace")  # a Windows console may have no ★
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", metavar="NAME", help="the functions to be emptied")
    parser.add_argument("--out", type=Path, default=ROOT / "exercises", metavar="FOLDER")
    parser.add_argument("--force", action="store_true", help="overwrite what is there")
    args = parser.parse_args()

    def refuse(line):
        print(f"{Path(__file__).name}: {line}", file=sys.stderr)
        sys.exit(2)

    names = list(dict.fromkeys(args.only or BOOK))
    unknown = [name for name in names if name not in BOOK]
    if unknown:
        refuse(f"there is no exercise {', '.join(unknown)}; there are {', '.join(BOOK)}")
    texts, out = sheets(names), args.out.resolve()
    if out in {find(row.file).parent for row in BOOK.values()}:
        refuse(f"{out} holds the solutions; take another folder")
    there = [name for name in texts if (out / name).exists()]
    if there and not args.force:
        refuse(f"{out} has {', '.join(there)} already, perhaps with your work; "
               "--force overwrites, --out FOLDER writes elsewhere")
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            (out / name).write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        refuse(f"cannot write to {out}: {error.strerror}")
    for name in names:
        row = BOOK[name]
        stars, functions = row.stars * "★", ", ".join(row.functions)
        print(f"{name:22s}{stars:5s}{row.minutes:4d} min  {row.file}.py  {functions}")
    try:
        folder = out.relative_to(ROOT).as_posix()
    except ValueError:
        folder = out.as_posix()
    folder = f'"{folder}"' if " " in folder else folder
    chosen = f'"{" or ".join(names)}"' if args.only and len(names) > 1 else names[0]
    print(f"To be written in {out}. Graded, from {ROOT}, by\n    {command(chosen, folder)}")

if __name__ == "__main__":
    main()
