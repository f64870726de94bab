"""Does a result depend on the seed of the training, on the goals, or on an IMU?

    python tests/studies/seeds.py [--mujoco] [--only seeds | pooled | imu] [--out FOLDER]

seeds: all trainings (five in 3-D, three on the plane) and their opponents; then the trainings on
grounds of one friction. pooled: the shipped policy on evaluation seeds 120 to 129, walked once for
every recipe that is shipped, after everything has been chosen: the next recipe takes 130 to 139. imu: three trainings with IMU against those without, from the same training seeds.
All trainings are made before, by `python 04_ppo.py --mujoco --seed 0 --out results/mujoco/seeds/0`
and so on, with `--imu` into imu/seeds/. The median of each kind, by success with noise and then by
time, is the one to ship.
"""

from itertools import product

import common
import numpy as np
from common import FEW, RESULTS, SEEDS, evaluate, pick

DURATION = "50 minutes on two cores; 3-D: 3 hours"
SETS, GROUND_SETS, POOLED_SETS = 4, 2, 10  # of 500 goals
POOLED_FIRST = 120  # evaluation seed
FRICTIONS = (0.4, 0.5, 0.7, 1.0)  # [-] μ

def trained(sim, seeds, kind="policy"):
    """The policies by name and training seed."""
    folder = RESULTS / sim / ("seeds" if kind == "policy" else "imu/seeds")
    return {(kind, seed): common.policy(folder / str(seed) / "policy.pt", sim) for seed in seeds}

def opponents(sim):
    """The same of planners that do not learn."""
    expert = evaluate.load_planner(common.ROOT / "tests" / "exercises" / "expert.py")
    planners = common.opponents(sim) | {"expert": expert}
    return {(name, None): planner for name, planner in planners.items()}

def walked(sim, planners, noises, sets, first=1, references=()):
    """Rows of these planners for near and far goals.

    Policies get their time relative to that of the references; those with IMU that relative to the
    policy of the same training seed, too.
    """
    rows = []
    with common.world(sim) as world:
        for far, noise in product((False, True), noises):
            walks = {key: common.walks(planner, world, noise, far, sets, first)
                     for key, planner in planners.items()}
            for (name, seed), ended in walks.items():
                row = {"seed": seed, **common.row_of(ended, name, noise, far)}
                if name.startswith("policy"):
                    for other in references:
                        row |= common.time_ratio(ended, walks[other, None], f"over_{other}")
                if name == "policy_imu" and seed is not None:
                    row |= common.time_ratio(ended, walks["policy", seed], "time_ratio")
                rows.append(row)
    return {"goals": sets * common.PER_SET, "rows": rows}

def median_seed(rows):
    """The training seed in the middle: by mean success of its rows, then by time. Not the best."""
    def rank(seed):
        own = pick(rows, seed=seed)
        times = [np.inf if row["time_mean"] is None else row["time_mean"] for row in own]
        return np.mean([row["success"] for row in own]), -np.mean(times)
    seeds = sorted({row["seed"] for row in rows}, key=rank)
    return seeds[len(seeds) // 2]

# ------------------------------------------------------------------------ the three parts
def study_seeds(args):
    """Every training and its opponents in every block, every training on every ground."""
    policies, ground = trained(args.sim, SEEDS[args.sim]), []
    found = walked(args.sim, opponents(args.sim) | policies, (False, True), SETS,
                   references=("baseline", "baseline_tuned", "search"))
    with common.world(args.sim) as world:
        for far, friction, key in product((False, True), FRICTIONS, policies):
            ended = common.walks(policies[key], world, True, far, GROUND_SETS, friction=friction)
            row = common.row_of(ended, "policy", True, far)
            ground.append({"seed": key[1], "friction": friction, **row})
    median = median_seed(pick(found["rows"], noise=True, planner="policy"))
    return {"median_seed": median, **found, "ground": ground}

def study_pooled(args):
    """The shipped policy in many walks, with noise."""
    shipped = common.policy(RESULTS / args.sim / "policy.pt", args.sim)
    found = walked(args.sim, {("policy", None): shipped}, (True,), POOLED_SETS, POOLED_FIRST)
    return {"first_seed": POOLED_FIRST, **found}

def study_imu(args):
    """Pairs of policies from the same training seed."""
    policies = trained(args.sim, FEW) | trained(args.sim, FEW, "policy_imu")
    found = walked(args.sim, policies, (True,), POOLED_SETS)
    return {"median_seed": median_seed(pick(found["rows"], planner="policy_imu")), **found}

PARTS = {"seeds": study_seeds, "pooled": study_pooled, "imu": study_imu}

def table(found, sim):
    """Markdown; square brackets: 95 % intervals over goals."""
    if "seeds" in found:
        found["ground"] = {"rows": found["seeds"]["ground"]}
    start = {"goal_std_m": 1, "noise": 0, "planner": 0}
    end = {"success": 4, "fall": 4, "timeout": 4, "time_mean": 2, "still_there": 3,
           "over_baseline_tuned": 3, "over_search": 3, "over_expert": 3}
    return common.sections(found, {
        "seeds": start | {"seed": 0} | end,
        "ground": {"goal_std_m": 1, "friction": 1, "seed": 0, "fall": 4},
        "pooled": start | {"falls": 0} | end,
        "imu": start | {"seed": 0, "falls": 0, "fall": 4, "time_mean": 2, "time_ratio": 3}})

def plot(found, sim):
    """Far goals on grounds of one friction."""
    rows = pick(found["seeds"]["ground"], goal_std_m=1.0)
    return common.dots(rows, "friction", "fall", f"Far goals by friction μ, with noise ({sim})")

if __name__ == "__main__":
    common.run("seeds")
