"""How sure are we? Stage 5's table once more, over ten sets of 500 goals that nobody had seen.

    python tests/studies/pooled.py [--mujoco] [--ship]

Evaluation seeds 110 to 119, the shipped planners; in 3-D the first set is that of README's table
(`05_evaluate.py --mujoco --noise --far --seed 110`). They are walked once for every recipe that is
shipped, after everything has been chosen: 100 to 109 went to policies that decided by the mode, the
next recipe takes 120 to 129.
"""

import itertools

import common
import kept

DURATION = {"pymunk": "about 25 minutes on two cores", "mujoco": "about 70 minutes on two cores"}
FIRST, SETS = 110, 10  # evaluation seeds, of 500 goals each
HEAD = ("goals", "noise", "planner", "success [95 % interval]", "falls", "fall [95 % interval]",
        "time-outs", "time [s]", "still there", "÷ baseline_tuned", "÷ search")

def study(sim):
    """Every planner in every block; those who learned against the two that race with them."""
    trials, planners, rows = kept.Trials(sim), kept.shipped(sim), []
    for far, noise in itertools.product((False, True), repeat=2):
        walks = {name: trials.run(*planner, noise, FIRST, SETS, far)
                 for name, planner in planners.items()}
        for name, own in walks.items():
            row = kept.row_of(own, name, noise, far)
            row |= {f"{end}s": int((own["outcome"] == end).sum()) for end in ("fall", "timeout")}
            for other in ("baseline_tuned", "search"):
                if name.startswith("policy"):
                    row |= kept.time_ratio(own, walks[other], f"over_{other}")
            rows.append(row)
    trials.close()
    content = {"first_seed": FIRST, "goals": SETS * kept.PER_SEED, "rows": rows}
    return common.Findings(content, common.markdown(HEAD, map(line, rows)))

def line(row):
    """Cells of the table."""
    ratios = [common.with_interval(row, key) if key in row else ""
              for key in ("over_baseline_tuned", "over_search")]
    return [f"{row['goal_std_m']} m", "yes" if row["noise"] else "no", row["planner"],
            common.with_interval(row, "success", 4), row["falls"],
            common.with_interval(row, "fall", 4), row["timeouts"],
            common.number(row["time_mean"], 2), common.number(row["still_there"], 3), *ratios]

if __name__ == "__main__":
    common.main(__file__)
