"""Does a result depend on the goals, on the seed of the training, or on an IMU?

    python tests/studies/seeds.py [--mujoco] [--only distances | pooled | seeds | imu]
                                  [--out FOLDER]

pooled: evaluation seeds 120 to 129, walked once, after everything has been chosen; the next recipe
takes 130 to 139. seeds: all trainings and their opponents, then the trainings on grounds of one
friction. imu: three trainings with IMU against those without, from the same training seeds.
All trainings are made before, by `python 04_ppo.py --mujoco --seed 0 --out results/mujoco/seeds/0`
and so on, with `--imu` into imu/seeds/. The median of each kind, by success with noise and then by
time, is the one to ship.
"""

from itertools import product

import common
import matplotlib.pyplot as plt
import numpy as np
from common import FEW, RESULTS, SEEDS, env, evaluate, pick

DURATION = "50 minutes on two cores; 3-D: 3 hours"
SETS, GROUND_SETS, POOLED_SETS = 4, 2, 10  # of 500 goals
POOLED_FIRST = 120  # evaluation seed
FRICTIONS = (0.4, 0.5, 0.7, 1.0)  # [-] μ
DISTANCES = (0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0)  # [m]

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
    """Rows of these planners for near and far goals; a policy's time also relative to that of
    the references, and with an IMU to that without, from the same training seed.
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

def least_time(goals, world):
    """Time [n] in which no robot gets to goals [n, 3]: so many double steps are needed for the way,
    if all are the longest, and so many for the turn; the larger number counts.
    """
    task, (low, high) = world.task, np.array([world.limits.low, world.limits.high])
    longest = np.hypot(2 * high[0], high[1] - low[1])  # [m] ahead and sideways
    d, alpha, _ = env.polar(goals)
    way = (d - task.success_m) / longest
    turn = (np.abs(alpha) - task.success_rad) / (high[2] - low[2])
    return world.engine.period * np.ceil(np.maximum(1, np.maximum(way, turn)))

def study_distances(args, count=200):
    """Each planner that races with the policy, to `count` goals at every distance, with noise."""
    planners = {name: planner for (name, _), planner in opponents(args.sim).items()
                if name in ("baseline_tuned", "expert")}
    planners["policy"] = common.policy(RESULTS / args.sim / "policy.pt", args.sim)
    trials = evaluate.draw_trials(POOLED_FIRST, count * len(DISTANCES))
    far = np.repeat(DISTANCES, count)
    way, yaw = np.random.default_rng(0).uniform(-np.pi, np.pi, (2, len(far)))
    trials.goals = np.stack([far * np.cos(way), far * np.sin(way), yaw], -1)
    rows = []
    with common.world(args.sim, num_robots=len(far)) as world:
        least = least_time(trials.goals, world)
        for name, planner in planners.items():
            ended = evaluate.evaluate(planner, world, trials, noise=True)
            for distance in DISTANCES:
                own = {key: value[far == distance] for key, value in ended.items()}
                reached = own["outcome"] == "success"
                rows.append({"planner": name, "distance": distance,
                             "success": float(reached.mean()),
                             "fall": float((own["outcome"] == "fall").mean()),
                             "time_mean": float(own["time"][reached].mean()),
                             "least": float(least[far == distance][reached].mean())})
    return {"goals": count, "rows": rows}

def study_all(args):
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

PARTS = {"distances": study_distances, "pooled": study_pooled, "seeds": study_all, "imu": study_imu}

def table(found, sim):
    """Markdown; square brackets: 95 % intervals over goals."""
    if "seeds" in found:
        found["ground"] = {"rows": found["seeds"]["ground"]}
    start = {"goal_std_m": 1, "noise": 0, "planner": 0}
    end = {"success": 4, "fall": 4, "timeout": 4, "time_mean": 2, "still_there": 3,
           "over_baseline_tuned": 3, "over_search": 3, "over_expert": 3}
    return common.sections(found, {
        "distances": {"planner": 0, "distance": 2, "success": 3, "fall": 3, "time_mean": 2,
                      "least": 2},
        "seeds": start | {"seed": 0} | end,
        "ground": {"goal_std_m": 1, "friction": 1, "seed": 0, "fall": 4},
        "pooled": start | {"falls": 0} | end,
        "imu": start | {"seed": 0, "falls": 0, "fall": 4, "time_mean": 2, "time_ratio": 3}})

def plot(found, sim):
    """Time over the distance of the goal."""
    rows = found["distances"]["rows"]
    figure, axis = plt.subplots(figsize=(8, 4))
    for name, style in (("policy", "o-"), ("expert", "s--"), ("baseline_tuned", "^:")):
        own = pick(rows, planner=name)
        axis.plot(DISTANCES, [row["time_mean"] for row in own], style, color=common.COLORS[name],
                  label=name)
    axis.plot(DISTANCES, [row["least"] for row in own], color="0.5",
              label="bound: every step the longest")
    axis.set(xlabel="distance of the goal [m]", ylabel="mean time of the successes [s]",
             title=f"Time over distance, any direction and yaw, with noise ({sim})", ylim=(0, None))
    axis.legend()
    return figure

if __name__ == "__main__":
    common.run("seeds")
