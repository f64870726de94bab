"""How much noise can each shipped planner take? 500 near goals at six sizes of the noise.

    python tests/studies/noise.py [--mujoco] [--ship]

Noise costs time long before it costs success. In 3-D both baselines run out of time more often
without it than with the task's. Why? Look where those walks end, and how the robot is turned.
"""

import common
import kept
import numpy as np

DURATION = {"pymunk": "about 5 minutes on two cores", "mujoco": "about 9 minutes on two cores"}
SIZES = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0)  # times the task's noise
NOISE_CM = 100 * kept.env.Task().noise_m

def study(sim):
    """Every planner at every size."""
    trials, planners = kept.Trials(sim), kept.shipped(sim)
    rows = {(name, size): {"size": size, **kept.row_of(
        trials.run(*planner, True, count=1, size=size), name, True)}
        for name, planner in planners.items() for size in SIZES}
    trials.close()
    head = ["noise [cm, 0.01 rad]", *(f"{name}: success / fall / time [s]" for name in planners)]
    lines = []
    for size in SIZES:
        own = [rows[name, size] for name in planners]
        lines.append([f"{size * NOISE_CM:.1f}",
                      *(f"{row['success']:.3f} / {row['fall']:.3f} / "
                        f"{common.number(row['time_mean'], 1)}" for row in own)])
    return common.Findings({"goals": kept.PER_SEED, "rows": list(rows.values())},
                           common.markdown(head, lines), plot(rows, list(planners), sim))

def plot(rows, names, sim):
    """Success, falls and time over the size."""
    figure, axes = common.plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
    for shift, name in enumerate(names):
        own = [rows[name, size] for size in SIZES]
        x = np.array(SIZES) * NOISE_CM + 0.1 * shift  # side by side
        for axis, key in zip(axes, ("success", "fall", "time_mean")):
            y = np.array([row[key] for row in own], float)  # None becomes nan
            axis.plot(x, y, f"{kept.MARKERS[name]}-", ms=4, color=kept.COLORS[name], label=name)
            if f"{key}_ci95" in own[0]:
                edges = np.transpose([row[f"{key}_ci95"] for row in own])
                axis.vlines(x, *edges, color=kept.COLORS[name], alpha=0.4, lw=1)
    axes[0].set(title="success", ylabel=f"share of {kept.PER_SEED} goals [1]")
    axes[1].set(title="fall", ylabel=f"share of {kept.PER_SEED} goals [1]")
    axes[2].set(title="time of successes", ylabel="mean [s]", ylim=(0, None))
    for axis in axes:
        axis.set(xlabel="noise of x and y [cm], of yaw [0.01 rad]")
        axis.grid(alpha=0.3)
    axes[2].legend(fontsize=8)
    figure.suptitle(f"The worse the robot knows its goal ({sim}; {NOISE_CM:.0f} cm is the task's "
                    "noise; lines: 95 % intervals)")
    return figure

if __name__ == "__main__":
    common.main(__file__)
