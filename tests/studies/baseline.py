"""How good can the paper's baseline get? All combinations of a speed factor and a turning gain.

    python tests/studies/baseline.py [--mujoco] [--ship]

Each on 500 goals that belong to tuning only, without noise. Kept is the fastest one that reaches
97 % of them: baseline_tuned.json, what stage 5 calls `baseline_tuned`.
"""

from dataclasses import asdict, replace
from itertools import product

import common
import kept

DURATION = {"pymunk": "about 5 minutes on two cores", "mujoco": "about 8 minutes on two cores"}
FACTORS = tuple(1 + 0.25 * k for k in range(13))  # [-] on the four speed limits: 1 … 4
TURNING_GAINS = (0.3, 0.6, 1.0)  # [1/s]
SUCCESS = 0.97  # [-] of the goals must be reached; our choice
LIMITS = ("forward", "backward", "sideways", "turning")
KEYS = ("success", "success_ci95", "timeout", "fall", "time_mean", "time_std")

def settings(factor, turning_gain):
    """The same controller, less cautious."""
    cautious = kept.evaluate.BaselineSettings()
    faster = {name: factor * getattr(cautious, name) for name in LIMITS}
    return replace(cautious, turning_gain=turning_gain, **faster)

def choose(grid):
    """The best row of the grid, and by which rule."""
    safe = [row for row in grid if row["success"] >= SUCCESS]
    if safe:
        return min(safe, key=lambda row: row["time_mean"]), f"the fastest with success >= {SUCCESS}"
    return max(grid, key=lambda row: row["success"]), "the highest success"

def study(sim):
    """The whole grid."""
    trials, grid = kept.Trials(sim), []
    for factor, gain in product(FACTORS, TURNING_GAINS):
        own = trials.run(*kept.baseline(settings(factor, gain)), False, 0, 1, purpose="tuning")
        row = kept.row_of(own, "baseline_tuned", False)
        grid.append({"factor": factor, "turning_gain": gain, **{key: row[key] for key in KEYS}})
    trials.close()
    best, rule = choose(grid)
    chosen = {"sim": sim, "settings": asdict(settings(best["factor"], best["turning_gain"])),
              "factor": best["factor"], "turning_gain": best["turning_gain"], "rule": rule}
    file = common.work(sim) / "baseline_tuned.json"
    common.write(file, common.as_json(chosen))
    head = ["speed limits ×", "turning gain [1/s]", "success [95 % interval]", "fall", "timeout",
            "time [s]", ""]
    lines = [[row["factor"], row["turning_gain"], common.with_interval(row, "success"),
              f"{row['fall']:.3f}", f"{row['timeout']:.3f}", common.number(row["time_mean"], 2),
              "chosen" * (row is best)] for row in grid]
    return common.Findings({"goals": kept.PER_SEED, "grid": grid}, common.markdown(head, lines),
                           files={"baseline_tuned.json": file})

if __name__ == "__main__":
    common.main(__file__)
