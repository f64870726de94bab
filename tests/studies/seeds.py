"""Does the seed of the training matter? Three trainings, judged on the same 2,000 unseen goals.

    python tests/studies/seeds.py [--mujoco] [--ship]

The median of them (by success with noise, then by time) is the one to ship: with --ship it becomes
results/<sim>/policy.pt, and all three become results/<sim>/seeds/.
"""

import common
import kept
import numpy as np

DURATION = {"pymunk": "about 25 minutes on two cores", "mujoco": "about 35 minutes on two cores"}
SETS = 4  # of 500 goals
COLUMNS = {"success": 4, "fall": 4, "timeout": 4, "still_there": 4, "time_mean": 2,
           "over_baseline": 3, "over_baseline_tuned": 3}  # digits
HEAD = ("noise", "training seed", "success", "fall", "timeout", "still there", "time [s]",
        "÷ baseline", "÷ baseline_tuned")

def study(sim):
    """Every training and both baselines, without and with noise."""
    folders = {seed: kept.train(sim, seed) for seed in kept.SEEDS}
    trials, rows = kept.Trials(sim), []
    for noise in (False, True):
        others = {name: trials.run(*planner, noise, count=SETS)
                  for name, planner in kept.baselines(sim).items()}
        rows += [{"seed": None, **kept.row_of(other, name, noise)}
                 for name, other in others.items()]
        for seed, folder in folders.items():
            own = trials.run(*kept.policy(folder / "policy.pt", sim), noise, count=SETS)
            row = {"seed": seed, **kept.row_of(own, "policy", noise)}
            for name, other in others.items():
                row |= kept.time_ratio(own, other, f"over_{name}")
            rows.append(row)
    trials.close()
    median = kept.median_seed([r for r in rows if r["noise"] and r["seed"] is not None])
    content = {"goals": SETS * kept.PER_SEED, "median_seed": median, "rows": rows}
    return common.Findings(content, table(rows, median), plot(folders, sim),
                           kept.to_ship(folders, median))

def table(rows, median):
    """Seeds, their mean, then the baselines; without and with noise."""
    lines = []
    for noise in (False, True):
        seeds = [r for r in rows if r["noise"] == noise and r["seed"] is not None]
        shown = {f"{r['seed']}" + " (median)" * (r["seed"] == median): r for r in seeds}
        shown["mean"] = kept.means(seeds, COLUMNS)
        shown |= {r["planner"]: r for r in rows if r["noise"] == noise and r["seed"] is None}
        for label, row in shown.items():
            cells = [common.number(row[key], digits) if key in row else ""
                     for key, digits in COLUMNS.items()]
            lines.append(["yes" if noise else "no", label, *cells])
    return common.markdown(HEAD, lines)

def smooth(values, window=8):
    """Mean of the last values, skipping nan."""
    parts = (values[max(0, i + 1 - window) : i + 1] for i in range(len(values)))
    return [np.nanmean(part) if np.isfinite(part).any() else np.nan for part in parts]

def plot(folders, sim):
    """The learning curves, each the mean of the last eight updates."""
    figure, axes = common.plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
    labels = {"success": "share of episodes [1]", "fall": "share of episodes [1]",
              "time": "simulated time of successes [s]"}
    for seed, folder in folders.items():
        curve = np.genfromtxt(folder / "learning_curve.csv", delimiter=",", names=True)
        for axis, (key, label) in zip(axes, labels.items()):
            axis.plot(curve["steps"] / 1000, smooth(curve[key]), lw=1.2, label=f"seed {seed}")
            axis.set(title=key, ylabel=label, xlabel="double steps of all robots [thousands]")
            axis.grid(alpha=0.3)
    axes[0].legend()
    figure.suptitle(f"{len(folders)} trainings, while exploring ({sim})")
    return figure

if __name__ == "__main__":
    common.main(__file__)
