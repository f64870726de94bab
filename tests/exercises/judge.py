"""The contest of projects.md: a leaderboard of planners' files.

    python tests/exercises/judge.py submissions/ --seed 417      all .py files of a folder
    python tests/exercises/judge.py ada.py bob.py --seed 417

Each file walks in 3-D to the same 500 near and 500 far goals, with noise, and to the far ones again
with pushes of 0.4 m/s; so do `policy` and `baseline_tuned`. Each has a process of its own and half
an hour. A file that fails or takes too long is named and left out. Writes leaderboard.md and .png
to runs/contest/. Only --episodes 500, the default, counts. Without a file: the planners of README,
as shipped in results/.
"""

import csv
import json
import os
import subprocess
import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from importlib import import_module
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
FIELD = ("policy", "baseline_tuned")  # they take part in every contest
PER_FALL, PER_TIMEOUT = 200, 100  # [s] per share of the walks
STAYS = 0.7  # least share of the successes that is still there
PUSH = 0.4  # [m/s]
PATIENCE = 1800  # [s] for each file


def points(rows):
    """The fewest win: seconds, falls and time-outs of the rows with noise; None: disqualified."""
    if any(row["time_mean"] is None or row["still_there"] < STAYS for row in rows):
        return None
    return sum(
        row["time_mean"] + PER_FALL * row["fall"] + PER_TIMEOUT * row["timeout"] for row in rows
    ) / len(rows)


def interval(rows):
    """The 95 % interval of the points: draw as many walks again, with replacement, 2,000 times."""
    rng, drawn = np.random.default_rng(0), np.zeros(2000)
    for row in rows:
        ended, time = np.array(row["walks"]).T  # [walks] outcome, seconds
        pick = rng.integers(len(ended), size=(2000, len(ended)))  # [2000, walks]
        reached, time = ended[pick] == "success", time.astype(float)[pick]
        seconds = (time * reached).sum(1) / np.maximum(reached.sum(1), 1)
        drawn += (
            seconds
            + PER_FALL * (ended[pick] == "fall").mean(1)
            + PER_TIMEOUT * (ended[pick] == "timeout").mean(1)
        ) / len(rows)
    return np.percentile(drawn, [2.5, 97.5])


def ranking(found):
    """Lines of Markdown for rows {planner: near, far, and perhaps far with pushes}, best first."""
    scores = {name: points(rows[:2]) for name, rows in found.items()}
    lines = [
        "| planner | near: time, falls, time-outs | far: time, falls, time-outs | still there "
        "| falls when pushed | points [95 % interval] |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for name in sorted(found, key=lambda name: (scores[name] is None, scores[name] or 0)):
        calm, pushed = found[name][:2], found[name][2:]
        cells = [f"`{name}`"]
        for row in calm:
            time = "none" if row["time_mean"] is None else f"{row['time_mean']:.1f} s"
            cells.append(f"{time}, {row['fall']:.3f}, {row['timeout']:.3f}")
        cells.append(f"{min(row['still_there'] or 0 for row in calm):.2f}")
        cells.append(" ".join(f"{row['fall']:.3f}" for row in pushed) or "not walked")
        if scores[name] is None:
            cells.append("disqualified")
        else:
            low, high = interval(calm)
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


def walk(name, seed, episodes):
    """In a process of its own: the rows of a planner, as `noisy` has them; name: a file, or one of
    the field.
    """
    sys.path.append(str(ROOT))  # the stages
    os.environ.pop("MUJOCO_GL", None)  # a wrong renderer would stop MuJoCo, and we need none
    evaluate = import_module("05_evaluate")
    env = evaluate.env
    if name in FIELD:
        shipped = ROOT / "results" / "mujoco" / "policy.pt"
        planner = evaluate.choose_planners("mujoco", [shipped])[0][name]
    else:
        planner = evaluate.load_planner(Path(name))
    world, rows = env.FootstepWorld(episodes, "mujoco", noise=True), []
    for far, push in ((False, 0.0), (True, 0.0), (True, PUSH)):
        world.push = push
        ended = evaluate.evaluate(planner, world, evaluate.draw_trials(seed, episodes, far), True)
        row = evaluate.summary(name, True, None, ended, env.Task())
        row["walks"] = list(zip(ended["outcome"].tolist(), ended["time"].tolist()))
        rows.append(row)
    world.close()
    return rows


def plot(found, path):
    """Points as bars, with their intervals; the best on top."""
    sys.path.append(str(ROOT))
    robot_model = import_module("01_robot_model")
    plt = robot_model.plt
    scores = {name: points(rows[:2]) for name, rows in found.items()}
    names = sorted(found, key=lambda name: scores[name] or np.inf)[::-1]
    figure, axis = plt.subplots(figsize=(8, 1.2 + 0.4 * len(names)))
    for place, name in enumerate(names):
        if scores[name] is None:
            axis.text(0, place, " disqualified", va="center")
            continue
        low, high = interval(found[name][:2])
        axis.barh(place, scores[name], color="tab:purple" if name in FIELD else "tab:olive")
        axis.plot([low, high], [place, place], "k", lw=2)
    axis.set(
        yticks=range(len(names)),
        yticklabels=names,
        xlabel="points [s], the fewest win; line: 95 % interval",
    )
    robot_model.save_figure(figure, path)


def main():
    sys.stdout.reconfigure(errors="replace")  # a Windows console may not know σ
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE.py or FOLDER")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--episodes", type=int, default=500)
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "contest")
    parser.add_argument("--walk", metavar="PLANNER", help="used by the judge itself")
    args = parser.parse_args()
    if args.walk:
        rows = walk(args.walk, args.seed, args.episodes)
        args.files[0].write_text(json.dumps(rows), encoding="utf-8")
        return
    files = []
    for path in args.files:
        if not path.exists():
            parser.error(f"{path}: no such file or folder")
        files += sorted(path.glob("*.py")) if path.is_dir() else [path]
    if len({file.stem for file in files} | set(FIELD)) < len(files) + len(FIELD):
        parser.error("two planners of one name: give every file a name of its own")
    if not files:
        print(ranking(noisy(ROOT / "results" / "mujoco")))
        return
    out = args.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    found = {}
    for planner in (*FIELD, *files):
        name = Path(planner).stem
        planner = planner if planner in FIELD else Path(planner).resolve()
        command = [
            sys.executable,
            __file__,
            out / f"{name}.json",
            "--walk",
            planner,
            "--seed",
            str(args.seed),
            "--episodes",
            str(args.episodes),
        ]
        print(f"{name} walks", flush=True)
        try:
            subprocess.run(
                command, cwd=ROOT, stdout=subprocess.DEVNULL, timeout=PATIENCE, check=True
            )
            found[name] = json.loads((out / f"{name}.json").read_text(encoding="utf-8"))
        except subprocess.TimeoutExpired:
            print(f"{name} is left out: longer than {PATIENCE / 60:.0f} minutes", file=sys.stderr)
        except subprocess.CalledProcessError:
            print(f"{name} is left out: see the error above", file=sys.stderr)
    text = ranking(found)
    (out / "leaderboard.md").write_text(text, encoding="utf-8")
    plot(found, out / "leaderboard.png")
    print(f"{text}\nwritten: leaderboard.md and .png in {out}")


if __name__ == "__main__":
    main()
