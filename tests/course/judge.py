"""The contest of projects.md: a leaderboard of planners' files.

    python tests/course/judge.py submissions/ --seed 417 418     all .py files of a folder
    python tests/course/judge.py ada.py bob.py --seed 417 418

With each planner the robots walk in 3-D to the same 500 near and 500 far goals of every seed, with
noise, and to the far ones again with pushes of 0.4 m/s. `policy` and `baseline_tuned` take part in
every contest. The world is in this process. A planner is in a process of its own, its file alone in
an empty folder; it receives the views and sends back actions, nothing else. (Like every program of
yours it can still read your other files. So choose seeds that nobody knows, and let strangers' files
run as another user.) It has --patience seconds for a decision, and half an hour for all of them. A
file that fails or takes too long is named and left out. Time is that of the clock: leave the machine
alone. The processes that a file has started end with it, except those in a session of their own. A
planner takes 3 to 5 minutes on one core. After each of them the judge writes leaderboard.md,
leaderboard.png and walks.json to runs/contest/. If you stop the judge and start it again, it measures
only those planners that are not in walks.json with the same file, seeds, number of walks and stages.
Only --episodes 500 and two seeds, the defaults, count.
Without a file the judge prints the table of the planners of README, as shipped in results/.
"""

import json
import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from contextlib import closing, nullcontext, suppress
from hashlib import sha256
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

sys.path.append(str(Path(__file__).resolve().parents[1] / "studies"))
import common
from common import ROOT, env, evaluate, robot_model

# They take part in every contest; with the files that they are read from.
FIELD = {
    "policy": ROOT / "results" / "mujoco" / "policy.pt",
    "baseline_tuned": ROOT / "05_evaluate.py",
}
STAYS = 0.7  # least share of the successes that is still there
OUT = "disqualified"  # instead of a place
WALKS = ((False, 0.0), (True, 0.0), (True, 0.4))  # far?, pushes [m/s]; the last does not count
TOTAL = 1800  # [s] for all decisions of a file
SHOWN = 4000  # letters of what a file has printed


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
        total = total + (mean + price[trials].mean(-1)) / len(rows)
    return total


def interval(rows, others=()):
    """The 95 % interval of the points; or of their difference from those of another planner's rows.

    It is paired, see `bootstrap` of stage 5: a trial is chosen with all its walks, near and far, of
    both planners."""
    trials = np.arange(len(rows[0]["walks"][0]))
    return evaluate.bootstrap(lambda drawn: points(rows, drawn) - points(others, drawn), trials)


def stays(rows):
    """The least share of the successes that is still there."""
    return min(row["still_there"] or 0 for row in rows[:2])


def ranked(found):
    """(place, name, points, their interval) of every planner, the best first. found: its rows by
    name, near, far, and perhaps far with pushes.

    A planner has the place of the one before it, unless its points are more, by `interval`, than
    those of the first planner of that place."""
    field = []
    first = ()
    scores = {name: (stays(rows) < STAYS, points(rows[:2])) for name, rows in found.items()}
    for name in sorted(found, key=scores.get):
        rows = found[name][:2]
        out, score = scores[name]
        if out:
            place = OUT
        elif interval(rows, first)[0] > 0:  # also without a first one: points are above 0
            place = len(field) + 1
            first = rows
        field.append((place, name, score, interval(rows)))
    return field


def ranking(found):
    """The table of the planners in Markdown, see `ranked`."""
    lines = []
    pushed = ()
    for place, name, score, ends in ranked(found):
        near, far, *pushed = found[name]
        cells = [str(place), f"`{name}`"]
        for row in near, far:
            time = "none" if row["time_mean"] is None else "{time_mean:.1f}, {time_median:.1f} s"
            cells.append(f"{time}; {{fall:.3f}}, {{timeout:.3f}}".format(**row))
        cells += [f"{stays(found[name]):.2f}", *(f"{row['fall']:.3f}" for row in pushed)]
        cells.append("{:.1f} [{:.1f}, {:.1f}]".format(score, *ends))
        low, high = interval(found[name][:2], found.get("baseline_tuned", found[name])[:2])
        cells.append("fewer" if high < 0 else "more" if low > 0 else "—")
        lines.append(" | ".join(cells))
    head = (
        "place | planner | near: time, median; shares of falls, time-outs | far: the same | still there "
        f"| {'falls when pushed | ' * len(pushed)}points [95 % interval] | than `baseline_tuned`"
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


def shown(file):
    """What a contestant is called: its file's name, with ? for what is no letter of UTF-8 or would
    mean something in a table or a picture."""
    return "".join(c if c.isprintable() and c not in "$|`\\" else "?" for c in file.stem)


def plot(found, path):
    """Points as bars, with their intervals; the best on top."""
    field = ranked(found)[::-1]
    figure = Figure(figsize=(8, 1.6 + 0.4 * len(field)))
    axis = figure.subplots()
    for height, (place, name, score, ends) in enumerate(field):
        if place != OUT:
            axis.barh(height, score, color="tab:purple" if name in FIELD else "tab:olive")
            axis.plot(ends, [height, height], "k", lw=2)
    axis.set(
        yticks=range(len(field)),
        yticklabels=[f"{name}: {place}" for place, name, *_ in field],
        ylabel="planner: place",
        xlabel="points [s], the fewest win; black: 95 % interval; purple: of the repository",
        title="The contest: near and far goals in 3-D, with noise",
    )
    robot_model.save_figure(figure, path)


# ------------------------------------------------------------------------ a planner of others
class LeftOut(Exception):
    """A planner that cannot take part, and why."""


def serve(pipe, file):
    """In a process of its own: answers the questions of `Contestant`, in the folder of the file."""
    if hasattr(os, "setsid"):  # not on Windows
        os.setsid()  # a group of its own, with the processes that it starts
    os.chdir(file.parent)
    output = os.open("../output", os.O_WRONLY)
    for stream in 1, 2:  # not the judge's: a process of this file could hold them for ever
        os.dup2(output, stream)
    # Neither the command line nor the folders of the repository are this file's business.
    sys.argv = [str(file)]
    sys.path[:] = [path for path in sys.path if ROOT not in (Path(path), *Path(path).parents)]
    planner = evaluate.load_planner(file)
    while True:
        method, argument = pipe.recv()
        if method == "reset":
            planner.reset(argument)
            pipe.send_bytes(b"")
        else:
            actions = planner.act(env.View(**argument))
            pipe.send_bytes(env.checked("actions", actions, len(argument["robots"]), 6).tobytes())


class Contestant:
    """A planner whose file runs in a process of its own, which knows only what is sent to it."""

    def __init__(self, file, patience):
        self.file = file
        self.patience = patience  # [s] for a decision
        self.left = TOTAL  # [s] for all others
        self.folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        copy = Path(self.folder.name).resolve() / "alone" / file.name
        copy.parent.mkdir()
        shutil.copyfile(file, copy)
        self.output = open(copy.parents[1] / "output", "w+", encoding="utf-8", errors="replace")
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=serve, args=(theirs, copy), daemon=True)
        self.process.start()
        theirs.close()

    def ask(self, method, argument, size, patience):
        """Calls a method of the planner, over there; returns the bytes that come back in time, `size`
        of them at most."""
        begin = time.monotonic()
        watch = threading.Timer(patience, self.kill)  # if it does not even listen
        watch.start()
        try:
            self.pipe.send((method, argument))
            watch.cancel()
            if not self.pipe.poll(min(patience, self.left)):
                limit = f"{patience:.0f} s" if patience < self.left else f"{TOTAL} s in all"
                raise LeftOut(f"no answer within {limit}")
            self.left -= time.monotonic() - begin
            return self.pipe.recv_bytes(size)
        except (EOFError, OSError) as error:
            raise LeftOut(
                "its program has ended (its error is in the judge's output), or sent too much"
            ) from error
        finally:
            watch.cancel()

    def reset(self, num_robots):
        self.ask("reset", num_robots, 0, 60 + self.patience)  # it may still import PyTorch

    def act(self, view):
        count = len(view.robots)
        answer = self.ask("act", vars(view), count * 6 * 8, self.patience)
        return np.frombuffer(answer).reshape(count, 6)  # a ValueError if they are fewer

    def kill(self):
        """Ends its process, and those that this one has started (not on Windows)."""
        with suppress(AttributeError, OSError):  # Windows; too early, or nobody is left
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.kill()

    def close(self):
        """Ends its process, and shows its error."""
        self.kill()
        self.process.join()
        sys.stderr.write(self.output.read()[-SHOWN:])
        self.output.close()
        self.folder.cleanup()


def walk(name, file, args):
    """Rows of a planner, as `noisy` has them, for all WALKS."""
    rows = []
    ours = common.opponents("mujoco") | {"policy": common.shipped("mujoco")}
    with (
        nullcontext(ours[name])
        if name in FIELD
        else closing(Contestant(file.resolve(), args.patience)) as planner
    ):
        for far, push in WALKS:
            world = common.world("mujoco", num_robots=args.episodes, push=push)
            parts = [
                evaluate.evaluate(planner, world, evaluate.draw_trials(seed, args.episodes, far))
                for seed in args.seeds
            ]
            ended = common.together(parts)
            walks = [ended["outcome"].tolist(), ended["time"].tolist()]
            rows.append(common.row_of(ended, name, far, walks=walks))
    return rows


def read_arguments():
    """The command line, and the files of the planners by name."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE.py or FOLDER")
    parser.add_argument("--seed", type=int, nargs="+", default=[0, 1], dest="seeds")
    parser.add_argument("--episodes", type=int, default=500)
    parser.add_argument("--patience", type=float, default=20, help="[s] for a decision")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "contest")
    parser.set_defaults(seed=0)
    args = parser.parse_args()
    if args.episodes < 1 or min(args.seeds) < 0 or args.patience <= 0:
        parser.error("--episodes from 1, --seed from 0, --patience above 0")
    files = []
    for path in args.files:
        if not path.exists():
            parser.error(f"{path}: no such file or folder")
        files += sorted(path.glob("*.py")) if path.is_dir() else [path]
    if args.files and not files:
        parser.error("no .py file in there")
    entrants = FIELD | {shown(file): file for file in files}
    if len(entrants) < len(files) + len(FIELD):
        parser.error("two planners of one name: give every file a name of its own")
    return args, entrants


def main():
    args, entrants = read_arguments()
    if not args.files:
        print(ranking(noisy(ROOT / "results" / "mujoco")))
        return
    out = robot_model.output_folder(args)
    path = out / "walks.json"  # rows by what they depend on: a planner's file and its world
    known = common.read_json(path) if path.is_file() else {}
    stages = [stage.read_bytes() for stage in sorted(ROOT.glob("0*.py"))]
    world = args.seeds, args.episodes, WALKS, stages
    found = {}
    left = ""
    walked = 0
    each = ""
    began = time.monotonic()
    for number, (name, file) in enumerate(entrants.items(), 1):
        try:
            key = sha256(repr((file.read_bytes(), *world)).encode()).hexdigest()
            told = "has walked before" if key in known else "walks"
            print(f"{name} {told} (planner {number} of {len(entrants)}{each})", flush=True)
            if key not in known:
                known[key] = walk(name, file, args)
                walked += 1
                each = f"; each takes {(time.monotonic() - began) / 60 / walked:.1f} minutes"
                robot_model.write_text(path, json.dumps(known))
            found[name] = known[key]
        except (LeftOut, ValueError, OSError) as error:  # OSError: its file cannot be read
            left += f"\n{name} is left out: {error}\n"
            print(left.splitlines()[-1], file=sys.stderr)
        board = f"Seeds {args.seeds}, {args.episodes} walks each.\n\n{ranking(found)}{left}"
        robot_model.write_text(out / "leaderboard.md", board)
        plot(found, out / "leaderboard.png")
    print(f"{board}\nleaderboard.md and .png are in {out}")


if __name__ == "__main__":
    robot_model.run_script(main)
