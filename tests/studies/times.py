"""Is the policy faster everywhere? Its time for every goal of stage 5's table, and the baselines'.

    python tests/studies/times.py [--mujoco] [--ship]

From the single trials in results/<sim>/trials.csv.
"""

import csv
from importlib import import_module

import common
import numpy as np
import speed

env = import_module("03_env")
DURATION = {"pymunk": "a few seconds", "mujoco": "a few seconds"}
COLORS = {"policy": "tab:blue", "baseline": "tab:orange", "baseline_tuned": "tab:green"}
HEAD = ("noise", "policy's time ÷ that of", "10th percentile", "median", "90th percentile",
        "share of goals where the policy is slower")

def read_trials(path):
    """Distances of the goals [n] [m]; by (planner, noise) times [n] [s], nan without success."""
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    times, goals = {}, {}
    for row in rows:
        key = row["planner"], row["noise"]
        time = float(row["time"]) if row["outcome"] == "success" else np.nan
        times.setdefault(key, []).append(time)
        goals.setdefault(key, []).append((float(row["x"]), float(row["y"])))
    if ("policy", "yes") not in times:
        raise common.StudyError(f"{path}: needs the trials of `05_evaluate.py --noise`")
    distance = np.hypot(*np.transpose(goals["policy", "yes"]))
    return distance, {key: np.array(values) for key, values in times.items()}

def reference(distance, sim):
    """Straight to the circle around the goal as in speed.py, in whole double steps: [n] [s]."""
    period = env.walk_engine.WalkEngine(1, env.walk_engine.TUNED[sim]).period  # [s]
    length = speed.fastest(sim)[0] * period  # [m]
    return np.maximum(1, np.ceil((distance - env.Task().success_m) / length)) * period

def study(sim):
    """How many times the baselines' time the policy needs, goal by goal."""
    distance, times = read_trials(common.RESULTS / sim / "trials.csv")
    content, lines = [], []
    for noise in ("no", "yes"):
        for name in ("baseline", "baseline_tuned"):
            if (name, noise) in times:
                ratio = times["policy", noise] / times[name, noise]
                ratio = ratio[np.isfinite(ratio)]
                shares = [*np.percentile(ratio, [10, 50, 90]), np.mean(ratio > 1)]
                keys = ("p10", "median", "p90", "policy_slower")
                content.append({"noise": noise, "reference": name} |
                               {key: round(share, 4) for key, share in zip(keys, shares)})
                lines.append([noise, name, *(f"{share:.2f}" for share in shares[:3]),
                              f"{shares[3]:.3f}"])
    return common.Findings(content, common.markdown(HEAD, lines), plot(distance, times, sim))

def plot(distance, times, sim):
    """Every dot is a goal."""
    figure, axes = common.plt.subplots(1, 2, figsize=(10, 4.4), layout="constrained", sharey=True)
    far = np.linspace(0, distance.max(), 500)  # [m]
    fast = reference(far, sim)
    for axis, noise in zip(axes, ("no", "yes")):
        for name, color in COLORS.items():
            if (name, noise) in times:
                axis.plot(distance, times[name, noise], ".", ms=3, color=color, label=name)
        axis.plot(far, fast, "k", lw=1, label="reference: straight ahead, fast")
        axis.set(title=f"{'with' if noise == 'yes' else 'without'} noise",
                 xlabel="distance to the goal at the start [m]")
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("time to the goal [s]")
    axes[0].legend(fontsize=8, markerscale=3)
    figure.suptitle(f"Every dot is a goal reached ({sim})")
    return figure

if __name__ == "__main__":
    common.main(__file__)
