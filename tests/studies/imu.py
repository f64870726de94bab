"""Does feeling the torso's tilt prevent falls? Three policies with IMU against the three shipped.

    python tests/studies/imu.py [--mujoco] [--ship]

All meet the same 5,000 noisy goals. The median with IMU is the one to ship: with --ship it becomes
results/<sim>/imu/policy.pt, and all three become results/<sim>/imu/seeds/.
"""

import common
import kept

DURATION = {"pymunk": "about 25 minutes on two cores", "mujoco": "about 35 minutes on two cores"}
SETS = 10  # of 500 goals
MEANS = ("success", "fall", "timeout", "time_mean", "time_ratio")
HEAD = ("planner", "training seed", "success", "fall [95 % interval]", "timeout", "time [s]",
        "time ÷ that of `policy`, same seed")

def study(sim):
    """Pairs of policies from the same training seed."""
    folders = {seed: kept.train(sim, seed, imu=True) for seed in kept.SEEDS}
    trials, rows = kept.Trials(sim), []
    for seed, path in zip(kept.SEEDS, kept.shipped_seeds(sim)["policy"]):
        plain = trials.run(*kept.policy(path, sim), True, count=SETS)
        with_imu = trials.run(*kept.policy(folders[seed] / "policy.pt", sim), True, count=SETS)
        rows.append({"seed": seed, **kept.row_of(plain, "policy", True)})
        rows.append({"seed": seed, **kept.row_of(with_imu, "policy_imu", True),
                     **kept.time_ratio(with_imu, plain, "time_ratio")})
    trials.close()
    means, lines = [], []
    for name in ("policy", "policy_imu"):
        own = [row for row in rows if row["planner"] == name]
        means.append({"planner": name, **kept.means(own, MEANS)})
        median = kept.median_seed(own)
        lines += [line(row, str(row["seed"]) + " (median)" * (row["seed"] == median))
                  for row in own]
        lines.append(line(means[-1], "mean"))
    content = {"goals": SETS * kept.PER_SEED, "median_seed": median, "rows": rows, "means": means}
    return common.Findings(content, common.markdown(HEAD, lines),
                           files=kept.to_ship(folders, median, "imu/"))

def line(row, label):
    """Cells of the table; a mean has no intervals, and only policy_imu has ratios."""
    fall, ratio = (common.with_interval(row, key, digits) if f"{key}_ci95" in row else
                   common.number(row[key], digits) if key in row else ""
                   for key, digits in (("fall", 4), ("time_ratio", 3)))
    return [row["planner"], label, common.number(row["success"], 4), fall,
            common.number(row["timeout"], 4), common.number(row.get("time_mean"), 2), ratio]

if __name__ == "__main__":
    common.main(__file__)
