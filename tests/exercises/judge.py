"""The contest of projects.md: a leaderboard of planners' files.

    python tests/exercises/judge.py submissions/ --seed 417      all .py files of a folder
    python tests/exercises/judge.py ada.py bob.py --seed 417

Each file walks in 3-D to the same 500 near and 500 far goals, with noise, and to the far ones again
with pushes of 0.4 m/s; so do `policy` and `baseline_tuned`. Each has a process of its own and half
an hour. A file that fails or takes too long is named and left out. Writes leaderboard.md and .png
to runs/contest/. Only --episodes 500, the default, counts. Without a file: the planners of README,
as shipped in results/.
"""

import json
import os
import subprocess
import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / "studies"))
import common
from common import ROOT, env, evaluate, robot_model

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
    """The 95 % interval of the points: a near walk and the far one in the same world are drawn
    together, see `bootstrap` of stage 5."""

    def drawn(*samples):
        total = 0
        for outcome, time in zip(samples[::2], samples[1::2]):  # [2000, walks] each
            reached = outcome == "success"
            total = total + (time * reached).sum(1) / np.maximum(reached.sum(1), 1)
            total = total + PER_FALL * (outcome == "fall").mean(1)
            total = total + PER_TIMEOUT * (outcome == "timeout").mean(1)
        return total / len(rows)

    return evaluate.bootstrap(drawn, *(np.array(sample) for row in rows for sample in row["walks"]))


def ranking(found):
    """Lines of Markdown for rows {planner: near, far, and perhaps far with pushes}, best first."""
    scores = {name: points(rows[:2]) for name, rows in found.items()}
    lines = []
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
        lines.append(" | ".join(cells))
    head = (
        "planner | near: time, falls, time-outs | far: time, falls, time-outs | still there "
        "| falls when pushed | points [95 % interval]"
    )
    return evaluate.markdown(head, lines)


def noisy(folder):
    """Rows with noise by planner, of an evaluation.json; each with its walks: outcomes, seconds."""
    found, walks = {}, common.read_trials(folder / "trials.csv")
    for row in common.read_json(folder / "evaluation.json")["rows"]:
        if row["noise"]:
            own = walks[row["planner"], True, row["goal_std_m"]]
            walked = {"walks": [own["outcome"], own["time"]]}
            found.setdefault(row["planner"], []).append(row | walked)
    return found


def rows_of(name, seed, episodes):
    """In a process of its own: the rows of a planner, as `noisy` has them; name: a file, or one of
    the field.
    """
    os.environ.pop("MUJOCO_GL", None)  # a wrong renderer would stop MuJoCo, and we need none
    if name in FIELD:
        shipped = ROOT / "results" / "mujoco" / "policy.pt"
        with common.world("mujoco", num_robots=1) as world:
            planner = evaluate.choose_planners(world, [shipped])[0][name]
    else:
        planner = evaluate.load_planner(Path(name))
    rows = []
    for far, push in ((False, 0.0), (True, 0.0), (True, PUSH)):
        with common.world("mujoco", num_robots=episodes, push=push) as world:
            ended = evaluate.evaluate(planner, world, evaluate.draw_trials(seed, episodes, far))
        row = evaluate.summary(name, True, None, ended, env.Task())
        rows.append(row | {"walks": [ended["outcome"].tolist(), ended["time"].tolist()]})
    return rows


def plot(found, path):
    """Points as bars, with their intervals; the best on top."""
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
        rows = rows_of(args.walk, args.seed, args.episodes)
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
