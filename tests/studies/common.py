"""What the studies share: the command line, where they write, tables and a stopwatch.

A study is a file with its DURATION in words and a function `study(sim)` that returns `Findings`.
`main` runs it and writes them to runs/studies/<sim>/; only `--ship` copies them to results/<sim>/.
What takes long is kept in runs/studies/<sim>/cache/, named after every setting it depends on:
an interrupted study continues, a repeated one is quick. (Code is no part of the name: after
changing it, delete the folder.)

Most studies judge what is shipped. After a change of robot, walk or task therefore, each --ship:
baseline, search, seeds, imu; then `05_evaluate.py --noise --far` for results/<sim>/; then all the
others.
"""

import contextlib
import hashlib
import json
import shutil
import sys
import time
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path

import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[2]
RUNS, RESULTS = ROOT / "runs" / "studies", ROOT / "results"
if str(ROOT) not in sys.path:  # the autograder has put another folder before it
    sys.path.insert(0, str(ROOT))
robot_model = import_module("01_robot_model")

class StudyError(ValueError):
    """A study cannot be done; the message is one line that says why."""

@dataclass
class Findings:
    """What a study has found."""

    numbers: object  # plain values, for NAME.json
    table: str  # Markdown, for NAME.md
    figure: object = None  # for NAME.png
    files: dict = field(default_factory=dict)  # what else to ship: name in results/<sim>/ -> file


# ------------------------------------------------------------------------ command line
class StudyParser(robot_model.StageParser):
    """A study takes two flags only; errors are one line with exit code 2, as in the stages."""

    def __init__(self, prog, doc, duration):
        takes = "; ".join(f"{sim}: {words}" for sim, words in duration.items())
        ArgumentParser.__init__(self, prog, description=doc, epilog=f"Duration: {takes}.",
                                formatter_class=RawDescriptionHelpFormatter)
        self.add_argument("--mujoco", dest="sim", action="store_const", const="mujoco",
                          default="pymunk", help="3-D instead of the sagittal plane")
        self.add_argument("--ship", action="store_true",
                          help="also replace what is shipped in results/<sim>/")

def main(file, argv=None):
    """Runs the study in a file and writes its findings."""
    name, started = Path(file).stem, sys.modules["__main__"]
    if getattr(started, "__file__", None) == file:
        del started.__file__  # or every process of a simulator would load it, and PyTorch with it
    module = import_module(name)
    parser = StudyParser(Path(file).name, module.__doc__, module.DURATION)
    args = parser.parse(argv)
    print(f"{name}, {args.sim}: {module.DURATION[args.sim]}", flush=True)
    try:
        publish(name, args.sim, module.study(args.sim), args.ship)
    except KeyboardInterrupt:
        print("\ninterrupted: the same command continues", file=sys.stderr)
        sys.exit(130)
    except (StudyError, OSError) as error:
        parser.error(" ".join(str(error).split()))

def publish(name, sim, findings, ship=False):
    """Writes to runs/studies/<sim>/, and copies from there to results/<sim>/ only if told to."""
    folder = RUNS / sim
    write(folder / f"{name}.json", as_json(findings.numbers))
    write(folder / f"{name}.md", findings.table)
    made = {f"studies/{name}{end}": folder / f"{name}{end}" for end in (".json", ".md")}
    if findings.figure is not None:
        made[f"studies/{name}.png"] = folder / f"{name}.png"
        robot_model.atomic_write(folder / f"{name}.png",
                                 lambda file: findings.figure.savefig(file, dpi=110))
        plt.close(findings.figure)
    for target, source in findings.files.items():
        made[target] = folder / target
        copy(source, folder / target)
    print(f"\n{findings.table}\nwritten:", *made.values(), sep="\n  ")
    if ship:
        for target, source in made.items():
            copy(source, RESULTS / sim / target)
        print("shipped:", *(RESULTS / sim / target for target in made), sep="\n  ")


# ------------------------------------------------------------------------ files
def work(sim, *parts):
    """Where that study's long work is kept; the folder is made."""
    folder = RUNS.joinpath(sim, "cache", *parts)
    folder.mkdir(parents=True, exist_ok=True)
    return folder

def digest(*ingredients):
    """Ten letters that change when anything changes that a result depends on."""
    return hashlib.sha256(repr(ingredients).encode()).hexdigest()[:10]

def write(path, text):
    """The old file or the new one, never half of one; UTF-8 and plain line ends everywhere."""
    path.parent.mkdir(parents=True, exist_ok=True)
    robot_model.atomic_write(path, lambda file: file.write_bytes(text.encode("utf-8")))

def copy(source, target):
    """A file, with the folders it needs."""
    target.parent.mkdir(parents=True, exist_ok=True)
    robot_model.atomic_write(target, lambda file: shutil.copyfile(source, file))

def as_json(content):
    """Readable by a human, too; NaN would not be JSON."""
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"

def read_json(path):
    """The content of a file that another study, or stage 5, has written."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise StudyError(f"{path}: missing or damaged ({error})") from error


# ------------------------------------------------------------------------ tables
def markdown(head, rows):
    """A table in Markdown, columns aligned."""
    cells = [tuple(head), ("---",) * len(head), *[tuple(map(str, row)) for row in rows]]
    widths = [max(map(len, column)) for column in zip(*cells)]
    return "\n".join("| " + " | ".join(map(str.ljust, c, widths)) + " |" for c in cells) + "\n"

def number(value, digits):
    """A number as text; None: there was nothing to measure."""
    return "none" if value is None else f"{value:.{digits}f}"

def with_interval(row, key, digits=3):
    """A number of a row and its 95 % interval, as text."""
    low, high = row[f"{key}_ci95"]
    return f"{row[key]:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"

def spread(values, digits):
    """Mean (least … most) of the values that exist, as text."""
    known = [value for value in values if value is not None]
    if not known:
        return "never"
    mean = sum(known) / len(known)
    text = f"{mean:.{digits}f} ({min(known):.{digits}f} … {max(known):.{digits}f})"
    return text + f", {len(values) - len(known)} never" * (len(known) < len(values))


# ------------------------------------------------------------------------ stopwatch
@dataclass
class Stopwatch:
    """Calls of a function: how often, how long together [s], and from when to when."""

    calls: int = 0
    seconds: float = 0.0
    first: float = None  # beginning of the first one, on the clock of time.perf_counter
    last: float = None  # end of the last one

@contextlib.contextmanager
def timed(owner, name):
    """Meanwhile every call of owner.name is timed by the Stopwatch that is returned."""
    original, watch = getattr(owner, name), Stopwatch()

    def call(*args, **kw):
        begin = time.perf_counter()
        result = original(*args, **kw)
        watch.last = time.perf_counter()
        watch.first = begin if watch.first is None else watch.first
        watch.calls, watch.seconds = watch.calls + 1, watch.seconds + watch.last - begin
        return result

    setattr(owner, name, call)
    try:
        yield watch
    finally:
        setattr(owner, name, original)
