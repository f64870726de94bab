"""Does feeling the torso's tilt prevent falls? Three policies with IMU against the three shipped.

    python tests/studies/imu.py [--mujoco] [--ship]

All walk to the same 5,000 near and 5,000 far goals; goal and IMU are measured with noise. The
median with IMU is the one to ship: with --ship it becomes results/<sim>/imu/policy.pt, and all
three become results/<sim>/imu/seeds/.
"""

import common
import kept
import numpy as np

DURATION = {"pymunk": "about 80 minutes on two cores, trainings included",
            "mujoco": "about 110 minutes on two cores, trainings included"}
SETS = 10  # of 500 goals, near and far, for every policy
HEAD = ("goals", "planner", "training seed", "walks", "falls", "share [95 % interval]", "time [s]",
        "time ÷ that of `policy`, same seed")

def study(sim):
    """Pairs of policies from the same training seed; then all seeds of a kind together."""
    folders = {seed: kept.train(sim, seed, imu=True) for seed in kept.SEEDS}
    files = {"policy": kept.shipped_seeds(sim)["policy"],
             "policy_imu": [folder / "policy.pt" for folder in folders.values()]}
    trials, rows = kept.Trials(sim), []
    for far in (False, True):
        walks = {name: [trials.run(*kept.policy(path, sim), True, count=SETS, far=far)
                        for path in paths] for name, paths in files.items()}
        for name, parts in walks.items():
            pairs = zip([*kept.SEEDS, None], [*parts, together(parts)],
                        [*walks["policy"], together(walks["policy"])])
            for seed, own, plain in pairs:
                row = {"seed": seed, "falls": int((own["outcome"] == "fall").sum())}
                row |= kept.row_of(own, name, True, far)
                if name == "policy_imu":
                    row |= kept.time_ratio(own, plain, "time_ratio")
                rows.append(row)
    trials.close()
    # By success, then by time, over near and far goals.
    median = kept.median_seed([
        {"seed": seed, "time_mean": None, **kept.means(
            [row for row in rows if (row["planner"], row["seed"]) == ("policy_imu", seed)],
            ("success", "time_mean"))} for seed in kept.SEEDS])
    lines = [line(row, median) for row in rows]
    content = {"goals": SETS * kept.PER_SEED, "median_seed": median, "rows": rows}
    return common.Findings(content, common.markdown(HEAD, lines),
                           files=kept.to_ship(folders, median, "imu/"))

def together(parts):
    """The walks of all seeds as one; the interval takes the seeds for walks like others."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

def line(row, median):
    """Cells of the table."""
    chosen = (row["planner"], row["seed"]) == ("policy_imu", median)
    label = "all" if row["seed"] is None else str(row["seed"]) + " (median)" * chosen
    ratio = common.with_interval(row, "time_ratio") if "time_ratio" in row else ""
    return [f"{row['goal_std_m']} m", row["planner"], label, row["episodes"], row["falls"],
            common.with_interval(row, "fall", 4), common.number(row["time_mean"], 2), ratio]

if __name__ == "__main__":
    common.main(__file__)
