"""Does a result depend on the goals, or on the seed of the training?

    python tests/studies/seeds.py [--mujoco] [--only PART] [--out FOLDER]

distances: the policy and its two best opponents, 0 to 6 m from the goal.
pooled: the same three planners on evaluation seeds 210 to 219. They were used after everything had been
chosen, 210 twice; a new training should take those from 230 on.
seeds: all trainings and their opponents, on evaluation seed 210. Both parts also push the robot on
its way to far goals. The trainings must be there, made by
`python 04_ppo.py --mujoco --seed 0 --out results/mujoco/seeds/0` and so on. baseline.py chooses the
one to ship.
estimate: how large are the errors of the estimated goal, and how large are those that the filter
claims?
"""

from itertools import product

import common
import numpy as np
from common import env, evaluate, fell, pick, robot_model, values

DURATION = "on one core: 20 minutes; 3-D: 60"
POOLED_SETS = 10  # of 500 goals
POOLED_FIRST = 210  # evaluation seed
FIRST = 190  # evaluation seed of `distances` and of kicks.py
KINDS = ((False, 0.0), (True, 0.0), (True, 0.4))  # far goals?, pushes [m/s]
DISTANCES = (0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0)  # [m]
GOALS = 200  # at each of them


def over_trainings(ours, theirs):
    """The mean time of several policies over that of another planner, and its 95 % interval if both
    goals and trainings are resampled. theirs: as `evaluate` returns; ours: a list of such."""
    both = np.stack([one["outcome"] == "success" for one in ours]) & (
        theirs["outcome"] == "success"
    )
    times = np.stack([one["time"] for one in ours])
    above, below = both * times, both * theirs["time"]  # [S, n]
    rng, (policies, goals) = np.random.default_rng(0), both.shape
    # How often a policy, and a goal, is in each of 2,000 choices with replacement
    policy, goal = (rng.multinomial(k, np.full(k, 1 / k), 2000) for k in (policies, goals))
    ratios = (policy @ above * goal).sum(1) / (policy @ below * goal).sum(1)
    interval = np.percentile(ratios, [2.5, 97.5])
    return {"ratio": above.sum() / below.sum(), "ratio_ci95": [*interval]}


def walked(sim, policies, sets, opponents, first=POOLED_FIRST, kinds=KINDS, **settings):
    """Rows of the opponents and of these policies, by training seed, for these kinds of walks with
    noise, in a world with these settings. A row of a policy also has its time relative to those of
    the opponents. `over`: the times of all policies together over those of an opponent, and for each
    policy McNemar's test of the falls.
    """
    planners, rows, over = opponents | policies, [], []  # planners: by name, or by seed
    for far, push in kinds:
        world = common.world(sim, push=push, **settings)
        walks = {
            key: common.walks(planner, world, far, sets, first) for key, planner in planners.items()
        }
        for key, ended in walks.items():
            name, seed = (key, None) if key in opponents else ("policy", key)
            row = common.row_of(ended, name, far, seed=seed, push=push)
            for other in opponents if name == "policy" else ():
                row |= common.time_over(f"over_{other}", ended, walks[other])
            rows.append(row)
        for other in opponents:
            own = over_trainings([walks[seed] for seed in policies], walks[other])
            falls = [evaluate.mcnemar(fell(walks[key]), fell(walks[other])) for key in policies]
            row = {"goal_std_m": common.STD[far], "push": push, "other": other}
            over.append(row | own | {"falls": falls})
    return {"rows": rows, "over": over}


def study_distances(args):
    """Rows of the policy and its opponents for every distance, with noise."""
    planners = {**common.opponents(args.sim), "policy": common.shipped(args.sim)}
    far = np.repeat(DISTANCES, GOALS)
    way, yaw = np.random.default_rng(0).uniform(-np.pi, np.pi, (2, len(far)))
    goals = np.column_stack([robot_model.turned([1, 0], way) * far[:, None], yaw])
    world, rows = common.world(args.sim, num_robots=len(far)), []
    for name, planner in planners.items():
        ended = evaluate.evaluate(planner, world, evaluate.Trials(goals, FIRST))
        for distance in DISTANCES:
            own = {key: value[far == distance] for key, value in ended.items()}
            rows.append(common.row_of(own, name, distance=distance))
    return rows


def study_all(args):
    """Rows of every training and its opponents."""
    return walked(args.sim, common.trainings(args.sim), 1, common.opponents(args.sim))


def study_pooled(args):
    """Rows of the shipped policy and its opponents in many walks."""
    policy, others = {None: common.shipped(args.sim)}, common.opponents(args.sim)
    return walked(args.sim, policy, POOLED_SETS, others)


class Watched(env.FootstepWorld):
    """Stores for every view the squared errors, the claimed variances, distance and double steps."""

    def __init__(self, *args, **settings):
        super().__init__(*args, **settings)
        self.seen = []

    def view(self, robots):
        view, goal = super().view(robots), self.relative_goal(robots)
        error = view.goal - goal
        error[:, 2] = env.wrap(error[:, 2])
        claimed = np.diagonal(self.covariance[robots], axis1=1, axis2=2)
        numbers = error**2, claimed, env.polar(goal)[0], self.steps[robots]
        self.seen.append(np.column_stack(numbers))
        return view


RINGS = (0.0, 0.1, 0.3, 0.7, 1.5, np.inf)  # [m] distances of the goal
AXES = "x", "y", "yaw"


def study_estimate(args):
    """Rows, by distance: the root mean square error, and its ratio to what the filter claims; of all
    measurements, and of those after the second double step (the first ones are surer)."""
    world, rows = common.world(args.sim, Watched), []
    common.walks(common.shipped(args.sim), world, far=True)
    squares = np.concatenate(world.seen)  # [K, 8]
    for steps, (first, last) in product((0, 2), zip(RINGS, RINGS[1:])):
        ring = (squares[:, 6] >= first) & (squares[:, 6] < last) & (squares[:, 7] >= steps)
        error, claimed = np.sqrt(squares[ring, :6].mean(0)).reshape(2, 3)
        row = {"from_step": steps, "from_m": first}
        for axis, e, c in zip(AXES, error, claimed):
            row |= {f"{axis}_error": e, f"{axis}_ratio": e / c}
        rows.append(row)
    return rows


PARTS = {
    "distances": study_distances,
    "pooled": study_pooled,
    "seeds": study_all,
    "estimate": study_estimate,
}


START = {"goal_std_m": 1, "push": 1, "planner": 0}  # columns of the rows of `walked`
END = {
    "falls": 0,
    "time_mean": 2,
    "still_there": 3,
    "over_baseline_tuned": 3,
    "over_expert": 3,
}


COLUMNS = {
    "distances": {"distance": 2, ("time_mean", "planner"): 2, ("falls", "planner"): 0},
    "seeds": {**START, "seed": 0, **END},
    "all trainings": {"goal_std_m": 1, "push": 1, "other": 0, "ratio": 3},
    "pooled": START | END,
    "estimate": {"from_step": 0, "from_m": 1}
    | {f"{axis}_{key}": 3 for axis in AXES for key in ("error", "ratio")},
}


def table(found):
    """The tables, and what all trainings together tell."""
    together = {"rows": found["seeds"]["over"]} if "seeds" in found else {"rows": []}
    return common.sections(found | {"all trainings": together}, COLUMNS)


def plot(found, sim):
    """Draws how much later than the policy the others arrive, over the distance of the goal."""
    rows = found["distances"]["rows"]
    figure, axes = common.subplots(figsize=(9, 4.5))
    policy, spread = (values(rows, key, planner="policy") for key in ("time_mean", "time_std"))
    for name in dict.fromkeys(values(rows, "planner")):
        own, color = pick(rows, planner=name), common.COLORS[name]
        later = np.subtract(values(own, "time_mean"), policy)
        bars = 1.96 * np.hypot(values(own, "time_std"), spread) / GOALS**0.5
        if name == "policy":
            axes.plot(DISTANCES, later, color=color)
        else:
            axes.errorbar(DISTANCES, later, bars, marker="o", color=color)
        axes.text(DISTANCES[-1] + 0.1, later[-1], name, va="center")
    axes.set(xlabel="distance of the goal [m]", ylabel="mean time − that of the policy [s]")
    axes.set_xlim(-0.1, 7.5)
    axes.set_xticks(range(7))
    return figure


PICTURES = {"seeds": ("distances", plot)}


if __name__ == "__main__":
    common.start("seeds")
