"""Does the seed of the training matter? Three trainings, judged on the same unseen trials.

    python tests/studies/seeds.py [--mujoco] [--ship]

Near and far goals without and with noise, 2,000 each, then falls on grounds of one friction, 1,000
each with noise. One table holds the means over the seeds against what we promise. The median seed
(by success with noise, then by time) is the one to ship: with --ship it becomes
results/<sim>/policy.pt, and all three become results/<sim>/seeds/.
"""

import itertools

import common
import kept
import numpy as np

DURATION = {"pymunk": "about an hour on two cores",
            "mujoco": "about 40 minutes on two cores, and 35 for a training"}
SETS, GROUND_SETS = 4, 2  # of 500 goals
BLOCKS = tuple(itertools.product((False, True), (False, True)))  # far, noise
STD = {False: kept.env.Task().goal_std_m, True: kept.env.Task().far_std_m}  # [m]
FRICTIONS = (0.4, 0.5, 0.7, 1.0)  # [-] μ
GROUND_LIMITS = {False: 0.008, True: 0.010}  # what we promise of the falls on each: near, far
COLUMNS = {"success": 4, "fall": 4, "timeout": 4, "still_there": 4, "time_mean": 2,
           "over_baseline_tuned": 3, "over_search": 3}  # digits
HEAD = ("goals", "noise", "planner", "success", "fall", "timeout", "still there", "time [s]",
        "÷ baseline_tuned", "÷ search")

def study(sim):
    """Every training and its opponents in every block, every training on every ground."""
    folders = {seed: kept.train(sim, seed) for seed in kept.SEEDS}
    policies = {seed: kept.policy(folder / "policy.pt", sim) for seed, folder in folders.items()}
    trials, opponents, rows, ground = kept.Trials(sim), kept.opponents(sim), [], []
    for far, noise in BLOCKS:
        others = {name: trials.run(*planner, noise, count=SETS, far=far)
                  for name, planner in opponents.items()}
        rows += [{"seed": None, **kept.row_of(other, name, noise, far)}
                 for name, other in others.items()]
        for seed, planner in policies.items():
            own = trials.run(*planner, noise, count=SETS, far=far)
            row = {"seed": seed, **kept.row_of(own, "policy", noise, far)}
            for name, other in others.items():
                row |= kept.time_ratio(own, other, f"over_{name}")
            rows.append(row)
    for far, friction, seed in itertools.product((False, True), FRICTIONS, kept.SEEDS):
        own = trials.run(*policies[seed], True, count=GROUND_SETS, far=far, friction=friction)
        row = kept.row_of(own, "policy", True, far)
        ground.append({"seed": seed, "friction": friction, **row})
    trials.close()
    curves = [np.genfromtxt(folder / "learning_curve.csv", delimiter=",", names=True)
              for folder in folders.values()]
    median = choose(rows)
    promised = promises(rows, ground, [learned_after(curve) for curve in curves])
    content = {"goals": SETS * kept.PER_SEED, "median_seed": median, "rows": rows,
               "ground": ground, "promises": promised}
    lines = [[p["what"], f"{p['sign']} {p['limit']:.{p['digits']}f}",
              common.number(p["found"], p["digits"]), "yes" if p["kept"] else "no"]
             for p in promised]
    text = "\n".join([table(rows, median), ground_table(ground),
                      common.markdown(["mean over the seeds", "promised", "found", "kept"], lines)])
    return common.Findings(content, text, plot(ground, sim), kept.to_ship(folders, median))

def pick(rows, far, noise=True, **more):
    """The rows of a block."""
    wanted = {"goal_std_m": STD[far], "noise": noise, **more}
    return [row for row in rows if all(row[key] == value for key, value in wanted.items())]

def choose(rows):
    """The median seed, over both noisy blocks."""
    noisy = {seed: [row for row in rows if row["seed"] == seed and row["noise"]]
             for seed in kept.SEEDS}
    means = [{"seed": seed, "time_mean": None, **kept.means(own, ("success", "time_mean"))}
             for seed, own in noisy.items()]
    return kept.median_seed(means)

def promises(rows, ground, learned):
    """What we promise of the mean over the seeds, and whether it is kept."""
    found = []

    def promise(what, value, sign, limit, digits=3):
        met = value is not None and (value - limit) * (1 if sign == "≥" else -1) > -1e-9
        found.append({"what": what, "sign": sign, "limit": limit, "digits": digits,
                      "found": value if value is None else round(float(value), 4),
                      "kept": bool(met)})

    for far, noise in BLOCKS:
        mean = dict.fromkeys(COLUMNS)
        mean |= kept.means(pick(rows, far, noise, planner="policy"), COLUMNS)
        baseline = pick(rows, far, noise, planner="baseline")[0]["still_there"] or 0.0
        where = f"{'far' if far else 'near'}, {'with' if noise else 'without'} noise"
        promise(f"success, {where}", mean["success"], "≥", 0.993 if far else 0.995, 4)
        promise(f"fall, {where}", mean["fall"], "≤", 0.006 if far else 0.004, 4)
        promise(f"still there, {where}", mean["still_there"], "≥",
                baseline - 0.02 if noise else 0.97)
        promise(f"time ÷ baseline_tuned, {where}", mean["over_baseline_tuned"], "≤", 0.80)
        if far:
            promise(f"time [s], {where}", mean["time_mean"], "≤", 7.0, 2)
    for far, limit in GROUND_LIMITS.items():
        worst = max(ground_means(ground, far))
        promise(f"fall at the worst μ, {'far' if far else 'near'}", worst, "≤", limit, 4)
    steps = None if None in learned else float(np.mean(learned))
    promise("double steps until 98 % succeed while exploring", steps, "≤", 250_000, 0)
    return found

def ground_means(ground, far):
    """Falls on every ground, means over the seeds."""
    return [np.mean([row["fall"] for row in pick(ground, far, friction=friction)])
            for friction in FRICTIONS]

def table(rows, median):
    """Seeds, their mean, then the opponents; block by block."""
    lines = []
    for far, noise in BLOCKS:
        seeds = pick(rows, far, noise, planner="policy")
        shown = {f"policy, seed {row['seed']}" + " (median)" * (row["seed"] == median): row
                 for row in seeds}
        shown["policy, mean"] = kept.means(seeds, COLUMNS)
        shown |= {row["planner"]: row for row in pick(rows, far, noise, seed=None)}
        for label, row in shown.items():
            cells = [common.with_interval(row, key, digits) if f"{key}_ci95" in row
                     else common.number(row[key], digits) if key in row else ""
                     for key, digits in COLUMNS.items()]
            lines.append(["far" if far else "near", "yes" if noise else "no", label, *cells])
    return common.markdown(HEAD, lines)

def ground_table(ground):
    """Share of falls with noise, by friction."""
    lines = []
    for far, goals in ((False, "near"), (True, "far")):
        lines += [[goals, f"policy, seed {seed}",
                   *(f"{row['fall']:.4f}" for row in pick(ground, far, seed=seed))]
                  for seed in kept.SEEDS]
        lines.append([goals, "policy, mean", *(f"{x:.4f}" for x in ground_means(ground, far))])
    return common.markdown(["goals", "falls", *(f"μ = {mu}" for mu in FRICTIONS)], lines)

def smooth(values, window=8):
    """Mean of the last values, skipping nan."""
    parts = (values[max(0, i + 1 - window) : i + 1] for i in range(len(values)))
    return [np.nanmean(part) if np.isfinite(part).any() else np.nan for part in parts]

def learned_after(curve, share=0.98):
    """Double steps after which that share of the last eight updates' episodes succeeds, or None."""
    reached = np.flatnonzero(np.array(smooth(np.atleast_1d(curve["success"]))) >= share)
    return float(np.atleast_1d(curve["steps"])[reached[0]]) if len(reached) else None

def plot(ground, sim):
    """Falls over the friction of the ground: every training, and the mean of them."""
    figure, axes = common.plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained", sharey=True)
    walks = GROUND_SETS * kept.PER_SEED
    for axis, (far, limit) in zip(axes, GROUND_LIMITS.items()):
        for seed, marker in zip(kept.SEEDS, "o^x"):
            shares = [row["fall"] for row in pick(ground, far, seed=seed)]
            axis.plot(FRICTIONS, shares, marker, color=kept.COLORS["policy"], alpha=0.7,
                      label=f"training seed {seed}, {walks:,} walks a dot")
        axis.plot(FRICTIONS, ground_means(ground, far), color=kept.COLORS["policy"], label="mean")
        axis.axhline(limit, color="0.6", lw=1, label="what we promise of the mean")
        axis.set(title=f"{'far' if far else 'near'} goals", xlabel="friction of the ground μ [-]",
                 xticks=FRICTIONS)
        axis.grid(alpha=0.3)
    axes[0].set(ylabel="share of walks that fall [1]", ylim=(-0.0005, None))
    axes[0].legend(fontsize=8)
    figure.suptitle(f"Is grip dangerous? Falls on grounds of one friction, with noise ({sim})")
    return figure

if __name__ == "__main__":
    common.main(__file__)
