"""The contest of projects.md: a leaderboard of planners' files.

    python tests/exercises/judge.py submissions/ --seed 417 418     all .py files of a folder
    python tests/exercises/judge.py ada.py bob.py --seed 417 418

With each planner the robots walk in 3-D to the same 500 near and 500 far goals of every seed, with
noise, and to the far ones again with pushes of 0.4 m/s. `policy` and `baseline_tuned` take part in
every contest. The world is in this process. A planner is in a process of its own, its file alone in
an empty folder; it receives the views and sends back actions, nothing else. (Like every program of
yours it can still read your other files. So choose seeds that nobody knows, and let strangers' files
run as another user.) It has --patience seconds for a decision, and half an hour for all of them. A
file that fails or takes too long is named and left out. After every planner the judge writes
leaderboard.md and leaderboard.png to runs/contest/. Only --episodes 500 and two seeds, the defaults,
count. Without a file it prints the table of the planners of README, as shipped in results/.
"""

import multiprocessing
import os
import shutil
import sys
import tempfile
import threading
import time
import traceback
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

sys.path.append(str(Path(__file__).resolve().parents[1] / "studies"))
import common
from common import ROOT, env, evaluate, robot_model

FIELD = ("policy", "baseline_tuned")  # they take part in every contest
PER_FALL, PER_TIMEOUT = 200, 100  # [s] per share of the walks
STAYS = 0.7  # least share of the successes that is still there
WALKS = ((False, 0.0), (True, 0.0), (True, 0.4))  # far?, pushes [m/s]; the last does not count
TOTAL = 1800  # [s] for all decisions of a file


# ------------------------------------------------------------------------ points
def points(rows):
    """The fewest win: seconds, falls and time-outs of the rows with noise; None: disqualified."""
    if any(row["time_mean"] is None or row["still_there"] < STAYS for row in rows):
        return None
    return sum(
        row["time_mean"] + PER_FALL * row["fall"] + PER_TIMEOUT * row["timeout"] for row in rows
    ) / len(rows)


def interval(rows):
    """The 95 % interval of the points: a near walk and the far one in the same world are drawn
    together, see `bootstrap` of stage 5."""

    def drawn(*samples):
        total = 0
        for outcome, seconds in zip(samples[::2], samples[1::2]):  # [2000, walks] each
            reached = outcome == "success"
            total = total + (seconds * reached).sum(1) / np.maximum(reached.sum(1), 1)
            total = total + PER_FALL * (outcome == "fall").mean(1)
            total = total + PER_TIMEOUT * (outcome == "timeout").mean(1)
        return total / len(rows)

    return evaluate.bootstrap(drawn, *(np.array(sample) for row in rows for sample in row["walks"]))


def ranked(found):
    """Names, the best first, and their points."""
    scores = {name: points(rows[:2]) for name, rows in found.items()}
    return sorted(found, key=lambda name: (scores[name] is None, scores[name] or 0)), scores


def ranking(found):
    """Lines of Markdown for rows {planner: near, far, and perhaps far with pushes}, best first."""
    lines = []
    names, scores = ranked(found)
    for name in names:
        calm, pushed = found[name][:2], found[name][2:]
        cells = [f"`{name}`"]
        for row in calm:
            time = "none" if row["time_mean"] is None else "{time_mean:.1f}, {time_median:.1f} s"
            cells.append(f"{time}; {{falls}}, {{timeout:.3f}}".format(**row))
        cells.append(f"{min(row['still_there'] or 0 for row in calm):.2f}")
        cells.append(" ".join(f"{row['fall']:.3f}" for row in pushed) or "not walked")
        if scores[name] is None:
            cells.append("disqualified")
        else:
            low, high = interval(calm)
            cells.append(f"{scores[name]:.1f} [{low:.1f}, {high:.1f}]")
        lines.append(" | ".join(cells))
    head = (
        "planner | near: time, median; falls, time-outs | far: the same | still there "
        "| falls when pushed | points [95 % interval]"
    )
    return common.markdown(head, lines)


def noisy(folder):
    """Rows with noise by planner, of an evaluation.json; each with its walks: outcomes, seconds."""
    found, walks = {}, common.read_trials(folder / "trials.csv")
    for row in common.read_json(folder / "evaluation.json")["rows"]:
        if row["noise"]:
            own = walks[row["planner"], True, row["goal_std_m"]]
            walked = {"walks": [own["outcome"], own["time"]]}
            found.setdefault(row["planner"], []).append(common.with_falls(row) | walked)
    return found


def shown(file):
    """What a contestant is called: its file's name, with ? for what is no letter of UTF-8 or would
    mean something in a table or a picture."""
    return "".join(c if c.isprintable() and c not in "$|`\\" else "?" for c in file.stem)


def plot(found, path):
    """Points as bars, with their intervals; the best on top."""
    names, scores = ranked(found)
    figure = Figure(figsize=(8, 1.6 + 0.4 * len(names)))
    axis = figure.subplots()
    for place, name in enumerate(reversed(names)):
        if scores[name] is None:
            axis.text(0, place, " disqualified", va="center")
            continue
        axis.barh(place, scores[name], color="tab:purple" if name in FIELD else "tab:olive")
        axis.plot(interval(found[name][:2]), [place, place], "k", lw=2)
    axis.set(
        yticks=range(len(names)),
        yticklabels=names[::-1],
        xlabel="points [s], the fewest win; black: 95 % interval; purple: of the repository",
        title="The contest: near and far goals in 3-D, with noise",
    )
    robot_model.save_figure(figure, path)


# ------------------------------------------------------------------------ a planner of others
class LeftOut(Exception):
    """A planner that cannot take part, and why."""


def serve(pipe, file):
    """In a process of its own: answers the questions of `Contestant`, in the folder of the file."""
    os.chdir(file.parent)
    # Neither the command line nor the folders of the repository are this file's business.
    sys.argv = [str(file)]
    sys.path[:] = [path for path in sys.path if ROOT not in (Path(path), *Path(path).parents)]
    try:
        planner = evaluate.load_planner(file)
        pipe.send_bytes(b"ready")
        while True:
            method, argument = pipe.recv()
            if method == "act":
                argument = env.View(**argument)
            answer = getattr(planner, method)(argument)
            pipe.send_bytes(b"" if method == "reset" else np.asarray(answer, float).tobytes())
    except (EOFError, KeyboardInterrupt):
        pass  # the contest is over
    except BaseException:
        traceback.print_exc()


class Contestant:
    """A planner whose file runs in a process of its own, which knows only what is sent to it."""

    def __init__(self, file, patience):
        self.file = file
        self.patience = patience  # [s] for a decision
        self.left = TOTAL  # [s] for all others
        self.folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        copy = Path(self.folder.name).resolve() / file.name
        shutil.copyfile(file, copy)
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=serve, args=(theirs, copy), daemon=True)
        self.process.start()
        theirs.close()
        try:
            self.answer(60 + patience)  # it imports PyTorch first
        except LeftOut:
            self.close()
            raise

    def answer(self, patience, size=5):
        """The bytes that come back in time, `size` of them at most."""
        begin = time.monotonic()
        if not self.pipe.poll(min(patience, self.left)):
            raise LeftOut(f"no answer within {patience:.0f} s, or {TOTAL} s in all")
        self.left -= time.monotonic() - begin
        try:
            return self.pipe.recv_bytes(size)
        except (EOFError, OSError) as error:
            raise LeftOut("its process has ended, see above, or sent too much") from error

    def ask(self, method, argument, size):
        """Calls a method of the planner, over there."""
        watch = threading.Timer(self.patience, self.process.kill)  # if it does not even listen
        watch.start()
        try:
            self.pipe.send((method, argument))
        except OSError as error:
            raise LeftOut("its process has ended") from error
        finally:
            watch.cancel()
        return self.answer(self.patience, size)

    def reset(self, num_robots):
        self.ask("reset", num_robots, 0)

    def act(self, view):
        count = len(view.robots)
        numbers = np.frombuffer(self.ask("act", vars(view), count * 6 * 8))
        if numbers.size != count * 6:
            raise LeftOut(f"actions must have the shape {(count, 6)}")
        return numbers.reshape(count, 6)

    def close(self):
        """Ends its process."""
        self.process.kill()
        self.process.join()
        self.folder.cleanup()


def walk(planner, name, seeds, episodes):
    """Rows of a planner, as `noisy` has them, for all WALKS."""
    rows = []
    for far, push in WALKS:
        world = common.world("mujoco", num_robots=episodes, push=push)
        parts = [
            evaluate.evaluate(planner, world, evaluate.draw_trials(seed, episodes, far))
            for seed in seeds
        ]
        ended = common.together(parts)
        row = common.row_of(ended, name, far)
        rows.append(row | {"walks": [ended["outcome"], ended["time"]]})
    return rows


def read_arguments():
    """The command line, and the files of the contestants."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE.py or FOLDER")
    parser.add_argument("--seed", type=int, nargs="+", default=[0, 1], dest="seeds")
    parser.add_argument("--episodes", type=int, default=500)
    parser.add_argument("--patience", type=float, default=20, help="[s] for a decision")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "contest")
    parser.set_defaults(sim="mujoco", seed=0)
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
    if len({shown(file) for file in files} | set(FIELD)) < len(files) + len(FIELD):
        parser.error("two planners of one name: give every file a name of its own")
    return args, files


def main():
    args, files = read_arguments()
    if not files:
        print(ranking(noisy(ROOT / "results" / "mujoco")))
        return
    out = robot_model.output_folder(args)
    tuned = evaluate.BaselinePlanner(evaluate.TUNED_BASELINE["mujoco"])
    field = dict(zip(FIELD, (common.shipped("mujoco"), tuned)))
    found, note = {}, f"Seeds {args.seeds}, {args.episodes} walks each."
    for place in (*FIELD, *files):
        name = place if place in FIELD else shown(place)
        print(f"{name} walks", flush=True)
        planner = None
        try:
            planner = field[name] if place in FIELD else Contestant(place.resolve(), args.patience)
            found[name] = walk(planner, name, args.seeds, args.episodes)
        except (LeftOut, ValueError, OSError) as error:  # OSError: its file cannot be read
            print(f"{name} is left out: {error}", file=sys.stderr)
        finally:
            if isinstance(planner, Contestant):
                planner.close()
        robot_model.write_text(out / "leaderboard.md", f"{note}\n\n{ranking(found)}")
        plot(found, out / "leaderboard.png")
    print(f"{note}\n\n{ranking(found)}\nleaderboard.md and .png are in {out}")


if __name__ == "__main__":
    robot_model.start(main)
