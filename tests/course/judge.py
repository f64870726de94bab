"""The contest of projects.md: a leaderboard of planners' files.

    python tests/course/judge.py submissions/ --seed 417 418     all files of a folder
    python tests/course/judge.py ada.py bob.py --seed 417 418

With each planner the robots walk in 3-D to the same 500 near and 500 far goals of every seed, with
noise. `policy`, `baseline_tuned` and `expert` take part in every contest. The world is in this
process. A planner is in a process of its own, which receives the views and sends back actions,
nothing else; its file lies alone in a folder. (Like every program of yours it can still read your
other files and the command line. So choose seeds that nobody knows, and let strangers' files run as
another user.) It has --patience seconds for a decision. A file that fails or takes too long is left
out, and the leaderboard says why. It also says which planners act alike on the first 20 goals: one
is a copy. A planner takes 3 minutes on one core, one as slow as `baseline` 9. After each of them the
judge writes leaderboard.md to runs/contest/. Only --episodes 500 and two seeds, the defaults, count.
Without a file the judge prints the table of the planners of README, as shipped in results/.
"""

import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
import traceback
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from contextlib import closing, nullcontext, suppress
from hashlib import sha256
from pathlib import Path
from unittest import mock

import numpy as np

sys.path.insert(1, str(Path(__file__).resolve().parents[1] / "studies"))  # before others' common.py
import common
from common import ROOT, env, evaluate, robot_model

FIELD = "policy", "baseline_tuned", "expert"  # they take part in every contest
STAYS = 0.7  # least share of the successes that is still there
COMPARED = 20  # goals: whoever acts there exactly as another planner is a copy


# ------------------------------------------------------------------------ points
def points(rows, trials=slice(None)):
    """The mean of the rows' points, [...]; the fewest win. trials: the numbers of those that count,
    [..., n]."""
    total = 0
    for row in rows:
        outcome, seconds = map(np.array, row["walks"])
        reached = outcome == "success"
        price = common.PER_FALL * (outcome == "fall") + common.PER_TIMEOUT * (outcome == "timeout")
        mean = (seconds * reached)[trials].sum(-1) / np.maximum(reached[trials].sum(-1), 1)
        total += (mean + price[trials].mean(-1)) / len(rows)
    return total


def interval(rows, others=()):
    """The 95 % interval of the points; or of their difference from those of another planner's rows.

    It is paired, see `bootstrap` of stage 5: a trial is chosen with all its walks, near and far, of
    both planners."""
    trials = np.arange(len(rows[0]["walks"][0]))
    return evaluate.bootstrap(lambda drawn: points(rows, drawn) - points(others, drawn), trials)


def stays(rows):
    """The least share of the successes that is still there."""
    return min(row["still_there"] or 0 for row in rows)


def ranked(found):
    """(place, name, points, their interval) of every planner, the best first. found: its rows by
    name, near and far.

    A planner has the place of the one before it, unless its points are more, by `interval`, than
    those of the first planner of that place."""
    field = []
    first = ()
    scores = {name: (stays(rows) < STAYS, points(rows)) for name, rows in found.items()}
    for name in sorted(found, key=scores.get):
        rows = found[name]
        out, score = scores[name]
        if out:
            place = "disqualified"
        elif interval(rows, first)[0] > 0:  # also without a first one: points are above 0
            place = len(field) + 1
            first = rows
        field.append((place, name, score, interval(rows)))
    return field


def ranking(found):
    """The table of the planners in Markdown, see `ranked`."""
    lines = []
    for place, name, score, ends in ranked(found):
        cells = [str(place), f"`{name}`"]
        for row in found[name]:
            time = "none" if row["time_mean"] is None else "{time_mean:.1f}, {time_median:.1f} s"
            cells.append(f"{time}; {{fall:.3f}}, {{timeout:.3f}}".format(**row))
        cells.append(f"{stays(found[name]):.2f}")
        cells.append("{:.1f} [{:.1f}, {:.1f}]".format(score, *ends))
        low, high = interval(found[name], found.get("baseline_tuned", found[name]))
        cells.append("fewer" if high < 0 else "more" if low > 0 else "—")
        lines.append(" | ".join(cells))
    head = (
        "place | planner | near: time, median; shares of falls, time-outs | far: the same | still there "
        "| points [95 % interval] | than `baseline_tuned`"
    )
    return evaluate.markdown(head, lines)


def noisy(folder):
    """Rows with noise by planner, of an evaluation.json; each with its walks: outcomes, seconds."""
    found = {}
    walks = common.read_trials(folder / "trials.csv")
    for row in common.read_json(folder / "evaluation.json")["rows"]:
        if row["noise"]:
            own = walks[row["planner"], True, row["goal_std_m"]]
            row["walks"] = own["outcome"], own["time"]
            found.setdefault(row["planner"], []).append(row)
    return found


# ------------------------------------------------------------------------ a planner of others
def serve(pipe, file):
    """In a process of its own: answers the questions of a `Contestant` with "+" and numbers, or says
    what was wrong."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the judge
    os.chdir(file.parent)
    pipe.send_bytes(b"all that is ours is imported")
    try:
        planner = evaluate.load_planner(file)
        while True:
            method, argument = pipe.recv()
            actions = getattr(planner, method)(argument)
            answer = b"+"
            if method == "act":
                answer += env.checked("actions", actions, len(argument.robots), 6).tobytes()
            pipe.send_bytes(answer)
    except BaseException as error:
        traceback.print_exc()  # for who has started the judge, which then ends this process
        pipe.send_bytes(f"{type(error).__name__}: {error}".encode(errors="replace"))


class Contestant:
    """A planner whose file runs in a process of its own, which knows only what is sent to it."""

    def __init__(self, file, patience):
        self.patience = patience  # [s] for a decision
        self.folder = tempfile.TemporaryDirectory()
        copy = Path(shutil.copy(file, self.folder.name))
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=serve, args=(theirs, copy), daemon=True)
        with mock.patch.object(sys, "argv", [str(copy)]):  # it inherits this, not our seeds
            self.process.start()
        theirs.close()
        self.pipe.recv_bytes()  # from here on its time runs

    def ask(self, *question):
        """The bytes that a method of the planner returns, over there."""
        answer = f"no answer within {self.patience:.0f} s".encode()
        with suppress(ConnectionError):  # it has ended, and said why
            self.pipe.send(question)
        try:
            if self.pipe.poll(self.patience):
                answer = self.pipe.recv_bytes(10**7)  # not `recv`: that runs what it gets
        except (EOFError, ConnectionError):
            answer = b"its process has ended"
        if not answer.startswith(b"+"):
            raise robot_model.InputError(answer.decode(errors="replace"))
        return answer[1:]

    def reset(self, num_robots):
        self.ask("reset", num_robots)

    def act(self, view):
        return np.frombuffer(self.ask("act", view)).reshape(-1, 6)  # checked as those of others

    def close(self):
        self.process.kill()
        self.process.join()


# ------------------------------------------------------------------------ the contest
def walk(name, planner, args):
    """Rows of a planner, near and far, as `noisy` has them; "acts": what it did to the first goals."""
    rows = []
    acts = sha256()
    world = common.world("mujoco", num_robots=args.episodes)

    def watch(robots, motion):
        if robots[0] < COMPARED:
            acts.update(world.last_action[:COMPARED].tobytes())

    for far in False, True:
        parts = [
            evaluate.evaluate(planner, world, evaluate.draw_trials(seed, args.episodes, far), watch)
            for seed in args.seeds
        ]
        ended = common.together(parts)
        walks = ended["outcome"], ended["time"]
        rows.append(common.row_of(ended, name, far, walks=walks, acts=acts.hexdigest()))
    return rows


def read_arguments():
    """The command line, and the files of the planners by name."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("files", nargs="*", type=Path, metavar="FILE.py or FOLDER")
    add("--seed", type=int, nargs="+", default=[0, 1], dest="seeds")
    add("--episodes", type=int, default=500)
    add("--patience", type=float, default=20)  # [s] for a decision
    add("--out", type=Path, default=ROOT / "runs" / "contest")
    parser.set_defaults(seed=0)
    args = parser.parse_args()
    if args.episodes < 1 or min(args.seeds) < 0 or not 0 < args.patience < 1e5:
        parser.error("--episodes from 1, --seed from 0, --patience above 0")
    files = []
    for path in args.files:
        if not path.exists():
            parser.error(f"{path}: no such file or folder")
        files += filter(Path.is_file, sorted(path.iterdir())) if path.is_dir() else [path]
    names = [file.name.removesuffix(".py").encode(errors="replace").decode() for file in files]
    if len({*names, *FIELD}) < len(names) + len(FIELD):
        parser.error("two planners of one name: give every file a name of its own")
    return args, dict(zip(names, files))


def main():
    args, files = read_arguments()
    if not args.files:
        print(ranking(noisy(ROOT / "results" / "mujoco")))
        return
    out = robot_model.output_folder(args)
    field = common.opponents("mujoco") | {"policy": common.shipped("mujoco")}
    entrants = field | files
    found = {}
    notes = ""
    for number, name in enumerate(entrants, 1):
        print(f"{name} walks (planner {number} of {len(entrants)})")
        try:
            with (
                nullcontext(field[name])
                if name in field
                else closing(Contestant(files[name], args.patience)) as planner
            ):
                rows = walk(name, planner, args)
            for other in found:
                if found[other][-1]["acts"] == rows[-1]["acts"]:
                    notes += f"\n{name} and {other}: equal actions, one is a copy of the other\n"
            found[name] = rows
        except (robot_model.InputError, ValueError, OSError) as error:  # OSError: no readable file
            notes += f"\n{name} is left out: {' '.join(str(error).split())[:300]}\n"
        board = f"Seeds {args.seeds}, {args.episodes} walks each.\n\n{ranking(found)}{notes}"
        robot_model.write_text(out / "leaderboard.md", board)
    print(f"{board}\nleaderboard.md is in {out}")


if __name__ == "__main__":
    robot_model.run_script(main)
