"""Is the policy faster everywhere? Its time for every goal of stage 5's table, and the others'.

    python tests/studies/times.py [--mujoco] [--ship]

From the single trials in results/<sim>/trials.csv. The reference is kinematic: the double steps
that `search` counts from the start to the goal, as if each took the robot as far as it does in a
steady walk. It may be beaten: the steps of `search` were chosen so that it rarely falls.
"""

import csv

import common
import kept
import numpy as np
from kept import env, evaluate

DURATION = {"pymunk": "a few seconds", "mujoco": "a few seconds"}
TICKS = (1, 2, 5, 10, 20, 50, 100)  # [s]
LAYERS = ("baseline", "search", "baseline_tuned", "policy", "policy_imu")  # the last one on top
HEAD = ("goals σ", "noise", "planner", "its time ÷ reference, median",
        "policy's time ÷ its, 10th percentile", "median", "90th percentile",
        "share of goals where the policy is slower")

def read_trials(path):
    """Goals [n, 3] by σ [m], and by (planner, noise, σ) times [n] [s], nan without success."""
    times, goals = {}, {}
    try:
        with open(path, newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                std = float(row["goal_std_m"])
                key = row["planner"], row["noise"], std
                time = float(row["time"]) if row["outcome"] == "success" else np.nan
                times.setdefault(key, []).append(time)
                if row["planner"] == "policy" and row["noise"] == "yes":
                    goals.setdefault(std, []).append([float(row[k]) for k in ("x", "y", "yaw")])
        if len(goals) < 2:
            raise ValueError("a block is missing")
    except (KeyError, ValueError) as error:
        raise common.StudyError(f"{path}: needs the trials of `05_evaluate.py --noise --far` "
                                f"({error})") from error
    return ({std: np.array(rows) for std, rows in goals.items()},
            {key: np.array(values) for key, values in times.items()})

def reference(goals, sim, search):
    """The double steps of `search` to goals [n, 3], at least one, in seconds [n].

    nan beyond its map.
    """
    period = env.walk_engine.WalkEngine(1, env.walk_engine.TUNED[sim]).period  # [s]
    pose = common.robot_model.relative(goals, np.zeros(3))  # the start seen from the goal
    steps = evaluate.look_up(search.value, pose)  # [n]
    beyond = np.abs(pose[:, :2]).max(1) >= evaluate.CELL * evaluate.HALF
    return np.where(beyond | (steps > evaluate.FAR - 1), np.nan,
                    np.maximum(1, steps) * period)

def study(sim):
    """How many times another planner's time the policy needs, goal by goal."""
    goals, times = read_trials(common.RESULTS / sim / "trials.csv")
    search, _ = kept.opponents(sim)["search"]
    fastest = {std: reference(rows, sim, search) for std, rows in goals.items()}
    content, lines = [], []
    for (name, noise, std), own in times.items():
        ratio = times["policy", noise, std] / own
        ratio, over = ratio[np.isfinite(ratio)], own / fastest[std]
        row = {"goal_std_m": std, "noise": noise, "planner": name}
        row["over_reference"] = np.median(over[np.isfinite(over)])
        if name != "policy":
            row |= dict(zip(("p10", "median", "p90"), np.percentile(ratio, [10, 50, 90])))
            row["policy_slower"] = np.mean(ratio > 1)
        row = {k: round(float(v), 4) if isinstance(v, float) else v for k, v in row.items()}
        content.append(row)
        digits = {"over_reference": 2, "p10": 2, "median": 2, "p90": 2, "policy_slower": 3}
        cells = [common.number(row[key], n) if key in row else "" for key, n in digits.items()]
        lines.append([f"{std} m", noise, name, *cells])
    return common.Findings(content, common.markdown(HEAD, lines), plot(fastest, times, sim))

def plot(fastest, times, sim):
    """Every dot is a goal; the policy with IMU would hide the other one."""
    figure, axes = common.plt.subplots(1, 2, figsize=(10, 4.6), layout="constrained", sharey=True)
    names = {name for name, _, _ in times} - {"policy_imu"}
    for axis, noise in zip(axes, ("no", "yes")):
        for name in sorted(names, key=LAYERS.index):
            parts = [(fastest[std], times[name, noise, std]) for std in fastest
                     if (name, noise, std) in times]
            if parts:
                axis.plot(*np.concatenate(parts, 1), kept.MARKERS[name], color=kept.COLORS[name],
                          ms=3, label=name, alpha=0.5)
        end = np.nanmax(np.concatenate(list(fastest.values())))
        axis.plot([0.6, end], [0.6, end], "k", lw=1, label="as the reference")
        axis.set(title=f"{'with' if noise == 'yes' else 'without'} noise",
                 xlabel="reference: steps to go of `search` [s]", xscale="log", yscale="log",
                 xticks=TICKS[:5], xticklabels=TICKS[:5], yticks=TICKS, yticklabels=TICKS)
        axis.minorticks_off()
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("time to the goal [s]")
    axes[0].legend(fontsize=8, markerscale=2)
    figure.suptitle(f"What noise costs every planner; every mark is a goal reached ({sim})")
    return figure

if __name__ == "__main__":
    common.main(__file__)
