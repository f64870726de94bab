"""Does a result depend on the goals, or on the seed of the training?

    python tests/studies/seeds.py [--mujoco] [--only distances | pooled | seeds | film] [--out FOLDER]

pooled: evaluation seeds 120 to 129, walked once, after everything has been chosen; the next recipe
takes 130 to 139. seeds: all trainings and their opponents, on seeds 120 to 123.
All trainings are made before, by `python 04_ppo.py --mujoco --seed 0 --out results/mujoco/seeds/0`
and so on. The median, by success with noise and then by time, is the one to ship.
"""

import common
import matplotlib.pyplot as plt
import numpy as np
from common import RESULTS, SEEDS, env, evaluate, pick, robot_model

DURATION = "20 minutes on two cores; 3-D: 40"
SETS, POOLED_SETS = 4, 10  # of 500 goals
POOLED_FIRST = 120  # evaluation seed
DISTANCES = (0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0)  # [m]


def opponents(sim):
    """The best two planners that do not learn, by name."""
    expert = evaluate.load_planner(common.ROOT / "tests" / "exercises" / "expert.py")
    return {"baseline_tuned": common.opponents(sim)["baseline_tuned"], "expert": expert}


def walked(sim, policies, sets, references=None):
    """Rows of these policies, by training seed, for near and far goals with noise; their times also
    relative to those of the references, which get rows, too.
    """
    rows, references = [], references or {}
    with common.world(sim) as world:
        for far in (False, True):
            theirs = {
                name: common.walks(planner, world, far, sets, POOLED_FIRST)
                for name, planner in references.items()
            }
            rows += [
                {"seed": None, **common.row_of(ended, name, far)} for name, ended in theirs.items()
            ]
            for seed, planner in policies.items():
                ended = common.walks(planner, world, far, sets, POOLED_FIRST)
                row = {"seed": seed, **common.row_of(ended, "policy", far)}
                for name, other in theirs.items():
                    row |= common.time_ratio(ended, other, f"over_{name}")
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
    """The kinematic optimum [n] [s]: no plan within the step limits gets to goals [n, 3] sooner.

    Double steps are whole. So many are needed for the way, so many for the turn, each to the edge
    of the tolerance; the larger number counts. Straight ahead is not the fastest walk: a foot lands
    x ahead of the standing one, w to its side, and turned out by ω. With the toes ω/2 to either
    side of the way, not only x leads ahead, but w, too. (This is about plans. A slip may add to
    them. A robot that walks like this falls in its second double step, in both simulators.)
    """
    x, w, turn = world.limits.high + world.engine.beside[0]  # [m], [m], [rad] ω
    # In a double step:  way ≤ 2·(x·cos(ω/2) + w·sin(ω/2)),  turn ≤ ω outward + ω inward
    longest = 2 * robot_model.turned([x, w], -turn / 2)[0]
    d, alpha, _ = env.polar(goals)
    ways = (d - world.task.success_m) / longest
    turns = (np.abs(alpha) - world.task.success_rad) / (turn - world.limits.low[2])
    return world.engine.period * np.ceil(np.maximum(ways, turns).clip(1))


def study_distances(args, count=200):
    """Each planner that races with the policy, to `count` goals at every distance, with noise."""
    planners = opponents(args.sim)
    planners["policy"] = common.policy(RESULTS / args.sim / "policy.pt", args.sim)
    trials = evaluate.draw_trials(POOLED_FIRST, count * len(DISTANCES))
    far = np.repeat(DISTANCES, count)
    way, yaw = np.random.default_rng(0).uniform(-np.pi, np.pi, (2, len(far)))
    trials.goals = np.stack([far * np.cos(way), far * np.sin(way), yaw], -1)
    rows = []
    with common.world(args.sim, num_robots=len(far)) as world:
        least = least_time(trials.goals, world)
        for name, planner in planners.items():
            ended = {"least": least} | evaluate.evaluate(planner, world, trials)
            for distance in DISTANCES:
                own = {key: value[far == distance] for key, value in ended.items()}
                row = common.row_of(own, name)
                kept = {key: row[key] for key in ("planner", "success", "fall", "time_mean")}
                shortest = own["least"][own["outcome"] == "success"].mean()
                rows.append({"distance": distance, **kept, "least": float(shortest)})
    return {"goals": count, "rows": rows}


def study_all(args):
    """Every training and its opponents."""
    folder = RESULTS / args.sim / "seeds"
    policies = {
        seed: common.policy(folder / str(seed) / "policy.pt", args.sim) for seed in SEEDS[args.sim]
    }
    found = walked(args.sim, policies, SETS, opponents(args.sim))
    return {"median_seed": median_seed(pick(found["rows"], planner="policy")), **found}


def study_pooled(args):
    """The shipped policy in many walks."""
    shipped = common.policy(RESULTS / args.sim / "policy.pt", args.sim)
    return {"first_seed": POOLED_FIRST, **walked(args.sim, {None: shipped}, POOLED_SETS)}


def study_film(args):
    """The shipped policy before, during and after its training, in learning.gif above the table."""
    folder = RESULTS / args.sim
    names = {"before training": "policy.start", "after a tenth of it": "policy.tenth"}
    with common.world(args.sim, num_robots=1, noise=False, cores=1) as world:
        trials = evaluate.Trials(evaluate.FIGURE_GOALS[:1], 0)
        walks = {}
        for title, name in {**names, "at the end": "policy"}.items():
            planner = common.policy(folder / f"{name}.pt", args.sim)
            walks[title] = next(evaluate.record(planner, world, trials))
    evaluate.plot_race(walks, args.out.parent / "learning.gif", every=20)
    return {title: walk["ending"] for title, walk in walks.items()}


PARTS = {
    "distances": study_distances,
    "pooled": study_pooled,
    "seeds": study_all,
    "film": study_film,
}


def table(found, sim):
    """Markdown; square brackets: 95 % intervals over goals."""
    start = {"goal_std_m": 1, "planner": 0}
    end = {
        "falls": 0,
        "success": 4,
        "timeout": 4,
        "time_mean": 2,
        "still_there": 3,
        "over_baseline_tuned": 3,
        "over_expert": 3,
    }
    return common.sections(
        found,
        {
            "distances": {
                "planner": 0,
                "distance": 2,
                "success": 3,
                "fall": 3,
                "time_mean": 2,
                "least": 2,
            },
            "seeds": start | {"seed": 0} | end,
            "pooled": start | end,
        },
    )


def plot(found, sim):
    """Time over the distance of the goal."""
    rows = found["distances"]["rows"]
    figure, axis = plt.subplots(figsize=(8, 4))
    for name, style in (("policy", "o-"), ("expert", "s--"), ("baseline_tuned", "^:")):
        own = pick(rows, planner=name)
        axis.plot(
            DISTANCES,
            [row["time_mean"] for row in own],
            style,
            color=common.COLORS[name],
            label=name,
        )
    axis.plot(
        DISTANCES,
        [row["least"] for row in own],
        color="0.5",
        label="least time that the step limits allow",
    )
    axis.set(
        xlabel="distance of the goal [m]",
        ylabel="mean time of the successes [s]",
        title=f"Time over distance, any direction and yaw, with noise ({sim})",
        ylim=(0, None),
    )
    axis.legend()
    return figure


def found(data):
    """Sentences by name, from the numbers of both simulators."""
    distances, pooled, trained = (data["mujoco"][part] for part in ("distances", "pooled", "seeds"))
    names = "policy", "expert", "baseline_tuned"
    times, falls = (
        [common.values(distances["rows"], key, planner=name) for name in names]
        for key in ("time_mean", "fall")
    )
    first = np.sum(np.argmin(times, 0) == 0)
    policy, by_hand, tuned = (own[-1] for own in times)
    near, far = (
        common.values(pooled["rows"], "falls", goal_std_m=std)[0] for std in common.STD.values()
    )
    trainings = pick(trained["rows"], planner="policy")
    ratios = [row["over_expert"] for row in trainings]
    walks, fell = (sum(row[key] for row in trainings) for key in ("episodes", "falls"))
    return {
        "distances": f"The policy is the fastest of the three at {first} of {len(times[0])} "
        f"distances. At 6 m it needs {policy:.1f} s, `expert` {by_hand:.1f} s and "
        f"`baseline_tuned` {tuned:.1f} s; there they fall in "
        "{}, {} and {} of the walks.".format(*(common.share(own[-1], 1) for own in falls)),
        "pooled": f"In {pooled['goals']:,} walks to near goals and {pooled['goals']:,} to far ones "
        f"the policy fell {near} and {far} times.",
        "trainings": f"Five trainings need {min(ratios):.2f} to {max(ratios):.2f} of the time of "
        f"`expert`. All five together fell {fell} times in {walks:,} walks.",
    }


if __name__ == "__main__":
    common.start("seeds")
