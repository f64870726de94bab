"""The contest of projects.md: points of planners' files, and of those that are in the field anyway.

    python tests/exercises/judge.py ada.py bob.py --seed 417

Runs `05_evaluate.py --mujoco --noise --far --planner FILE --seed SEED` for each file (also
`--episodes`), writes to runs/contest/ and prints the points. A file that fails, or takes too long,
is named and left out. Only --episodes 500, the default, counts. Without a file: the field, as
shipped in results/.
"""

import csv
import json
import subprocess
import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
PER_FALL, PER_TIMEOUT = 200, 100  # [s] per share of the walks
STAYS = 0.7  # least share of the successes that is still there
PATIENCE = 1800  # [s] for each file

def points(rows):
    """The fewest win: seconds, falls and time-outs of the rows with noise; None: disqualified."""
    if any(row["time_mean"] is None or row["still_there"] < STAYS for row in rows):
        return None
    return sum(row["time_mean"] + PER_FALL * row["fall"] + PER_TIMEOUT * row["timeout"]
               for row in rows) / len(rows)

def interval(rows):
    """The 95 % interval of the points: draw as many walks again, with replacement, 2,000 times."""
    rng, drawn = np.random.default_rng(0), np.zeros(2000)
    for row in rows:
        ended, time = np.array(row["walks"]).T  # [walks] outcome, seconds
        pick = rng.integers(len(ended), size=(2000, len(ended)))  # [2000, walks]
        reached, time = ended[pick] == "success", time.astype(float)[pick]
        seconds = (time * reached).sum(1) / np.maximum(reached.sum(1), 1)
        drawn += (seconds + PER_FALL * (ended[pick] == "fall").mean(1)
                  + PER_TIMEOUT * (ended[pick] == "timeout").mean(1)) / len(rows)
    return np.percentile(drawn, [2.5, 97.5])

def ranking(found):
    """Lines of Markdown for rows {planner: its rows with noise}, best first."""
    scores = {name: points(rows) for name, rows in found.items()}
    lines = ["| planner | near: time, falls, time-outs | far: time, falls, time-outs | still there "
             "| points [95 % interval] |", "| --- | --- | --- | --- | --- |"]
    for name in sorted(found, key=lambda name: (scores[name] is None, scores[name] or 0)):
        cells = [f"`{name}`"]
        for row in found[name]:
            time = "none" if row["time_mean"] is None else f"{row['time_mean']:.1f} s"
            cells.append(f"{time}, {row['fall']:.3f}, {row['timeout']:.3f}")
        cells.append(f"{min(row['still_there'] or 0 for row in found[name]):.2f}")
        if scores[name] is None:
            cells.append("disqualified")
        else:
            low, high = interval(found[name])
            cells.append(f"{scores[name]:.1f} [{low:.1f}, {high:.1f}]")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"

def noisy(folder):
    """Rows with noise by planner, of an evaluation.json; each with its walks: outcome, seconds."""
    found, walks = {}, {}
    with open(folder / "trials.csv", encoding="utf-8", newline="") as file:
        for walk in csv.DictReader(file):
            key = walk["planner"], walk["noise"] == "yes", float(walk["goal_std_m"])
            walks.setdefault(key, []).append((walk["outcome"], walk["time"]))
    for row in json.loads((folder / "evaluation.json").read_text(encoding="utf-8"))["rows"]:
        if row["noise"]:
            row["walks"] = walks[row["planner"], True, row["goal_std_m"]]
            found.setdefault(row["planner"], []).append(row)
    return found

def main():
    sys.stdout.reconfigure(errors="replace")  # a Windows console may not know σ
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE.py")
    parser.add_argument("--seed", default="0")
    parser.add_argument("--episodes", default="500")
    args = parser.parse_args()
    if len({file.stem for file in args.files}) < len(args.files):
        parser.error("two files of one name: give every contestant's file a name of its own")
    found = {} if args.files else noisy(ROOT / "results" / "mujoco")
    for file in args.files:
        out = ROOT / "runs" / "contest" / file.stem
        command = [sys.executable, ROOT / "05_evaluate.py", "--mujoco", "--noise", "--far",
                   "--seed", args.seed, "--episodes", args.episodes, "--out", out,
                   "--planner", file.resolve()]
        try:
            subprocess.run(command, cwd=ROOT, stdout=subprocess.DEVNULL, timeout=PATIENCE,
                           check=True)
            found |= noisy(out)
        except subprocess.TimeoutExpired:
            print(f"{file} is left out: longer than {PATIENCE / 60:.0f} minutes", file=sys.stderr)
        except subprocess.CalledProcessError:
            print(f"{file} is left out: see the error above", file=sys.stderr)
    print(ranking(found))

if __name__ == "__main__":
    main()
