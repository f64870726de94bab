"""How good can planners get that do not learn? One method optimises all their settings.

    python tests/studies/baseline.py [--mujoco] [--only PART] [--out FOLDER]

paper: the paper's baseline, with which the others are compared.
baseline_tuned: the same controller, but both feet share its steps.
expert: `tests/exercises/expert.py`.
policy: the trained policies on the same walks. The figure shows times and falls of all.

The cross-entropy method searches the logarithms of eight settings, for one price of a fall after
the other. Each search begins where the last one has ended. These ends, and the settings from which
the first search began, are compared on 2,000 other goals, and with pushes on the 1,000 far ones.
Of those that keep the rule (`keeps`) the one with the fewest points of the contest is taken; so is
the policy to be shipped. If none keeps it, *still there* does not count; if none falls so seldom, all
of them count.
"""

import sys
from functools import partial

import common
import numpy as np
from common import ROOT, evaluate, pick, values
from tqdm import tqdm

sys.path.append(str(ROOT / "tests" / "exercises"))
import expert
import judge

DURATION = "15 minutes on two cores; 3-D: 30 minutes"
SIZES = (2, 14, 4)  # iterations for each price, candidates, how many are kept
WALKS = 48  # near ones and as many far ones, for every candidate
SETS = 2  # of 500 near and of 500 far ones, for every finalist
PRICES = (50.0, 100.0, 200.0, 400.0)  # [s] of one fall per walk; of a time-out a quarter
PUSH = 0.4  # [m/s]
LEAVING = 50.0  # [s] in the search: price of leaving the goal again, if more often than allowed
# The rule for all planners: of those that keep it, the fewest points win. Our choice.
STAYS = 0.93  # least share of *still there*, near and far
MAX_FALLS, MAX_PUSHED = 0.005, 0.02  # share of the walks; of those with pushes
EXPERT = ["top_x", "top_y", "top_turn", "change_x", "change_y", "change_turn", "together", "gain"]


def tuned_of(settings):
    """The paper's controller with these settings, but both feet share its steps."""
    return evaluate.BaselinePlanner(evaluate.BaselineSettings(*settings, share=True))


def expert_of(settings):
    """The expert with these settings, in the order of EXPERT."""
    top, change = tuple(settings[:3]), tuple(settings[3:6])
    return expert.Planner(expert.Settings(top, change, *settings[6:]))


def tuning(planner, world, seed, count):
    """The facts of `count` near and `count` far walks of the tuning, with noise."""
    return facts(common.near_and_far(planner, world, first=seed, per_set=count, purpose="tuning"))


def facts(ended):
    """The numbers that count of some walks, by name."""
    row = common.row_of(ended, "")
    shares = {name: row[name] for name in evaluate.OUTCOMES}
    return shares | {"time": row["time_mean"], "still_there": row["still_there"]}


def final(world, planner):
    """The facts of a planner in 2,000 walks with noise, *still there* also near and far; pushed: the
    share of falls in the 1,000 far ones with pushes.
    """
    others = {"sets": SETS, "first": 101, "purpose": "tuning"}
    near, far = (common.walks(planner, world, far, **others) for far in common.STD)
    pushed = common.walks(planner, common.world(world.sim, push=PUSH), far=True, **others)
    return facts(common.together([near, far])) | {
        "still_near": facts(near)["still_there"],
        "still_far": facts(far)["still_there"],
        "pushed": facts(pushed)["fall"],
    }


def cost(row, price=PRICES[2]):
    """What the search makes small [s]: time, the price of falls, and that of leaving the goal."""
    if row["time"] is None:
        return 100.0
    leaves = max(0.0, STAYS - row["still_there"])
    return row["time"] + price * (row["fall"] + row["timeout"] / 4) + LEAVING * leaves


def optimise(world, planner_of, start):
    """The rows of all candidates, and the settings in which the search ends for each price."""

    def plain(x):
        return np.exp(x).round(4).tolist()

    def costs(price, _, drawn):
        found, seed = [], 1 + len(tried) // SIZES[1]  # all candidates have the same goals
        for settings in map(plain, tqdm(drawn, leave=False, unit=" candidates")):
            row = tuning(planner_of(settings), world, seed, WALKS)
            tried.append({"settings": settings, "price": price, **row})
            found.append(cost(row, price))
        print(f"price {price:.0f} s: mean {found[0]:.2f} s, best {min(found):.2f} s", flush=True)
        return found

    tried, ends, rng = [], [], np.random.default_rng(0)
    mean = np.log(start)
    for price in PRICES:
        spread = 0.15 if ends else 0.3
        mean = common.cross_entropy(partial(costs, price), mean, spread, SIZES, rng)
        ends.append(plain(mean))
    return tried, ends


def keeps(row, stays=STAYS):
    """Does a planner with these facts keep the rule, if it need be still there so often?"""
    least = min(row["still_near"] or 0, row["still_far"] or 0)  # None: it never arrived
    return row["fall"] <= MAX_FALLS and row["pushed"] <= MAX_PUSHED and least >= stays


def points(row):
    """Those of the contest, from a planner's facts: seconds; a fall and a time-out have a price."""
    price = judge.PER_FALL * row["fall"] + judge.PER_TIMEOUT * row["timeout"]
    return np.inf if row["time"] is None else row["time"] + price


def choose(rows):
    """The rule that chose the best of these rows, and the rows, which say whether they are chosen."""
    if kept := [row for row in rows if keeps(row)]:
        rule = "it keeps the rule, with the fewest points"
    elif kept := [row for row in rows if keeps(row, stays=0.5)]:
        rule = "none keeps the rule; of those with so few falls it has the fewest points"
    else:
        kept, rule = rows, "none falls so seldom; it has the fewest points"
    best = min(kept, key=points)
    return rule, [row | {"chosen": row is best} for row in rows]


def searched(args, planner_of, now):
    """The whole search, from the settings on that are in use, `now`: values by name."""
    world = common.world(args.sim)
    tried, ends = optimise(world, planner_of, [*now.values()])
    rule, rows = choose(
        [
            {"price": price, "settings": dict(zip(now, at)), **final(world, planner_of(at))}
            for price, at in [*zip(PRICES, ends), (None, [*now.values()])]
        ]
    )
    return {"trials": 2 * SETS * common.PER_SET, "rule": rule, "finalists": rows, "tried": tried}


def study_paper(args):
    """The facts of the paper's settings."""
    return final(common.world(args.sim), evaluate.BaselinePlanner())


def study_tuned(args):
    """The search for TUNED_BASELINE of stage 5."""
    now = vars(evaluate.TUNED_BASELINE[args.sim]).copy()
    del now["share"]
    return searched(args, tuned_of, now)


def study_expert(args):
    """The search for the constants of the expert; they are those for 3-D."""
    now = expert.Settings()
    constants = [*now.top, *now.change, now.together, now.gain]
    return searched(args, expert_of, dict(zip(EXPERT, constants)))


def study_policy(args):
    """Rows of the trained policies on the same walks. The chosen one is to be shipped."""
    world, planners = common.world(args.sim), common.trainings(args.sim)
    rule, rows = choose([{"seed": k, **final(world, planners[k])} for k in planners])
    return {"trials": 2 * SETS * common.PER_SET, "rule": rule, "rows": rows}


PARTS = {
    "paper": study_paper,
    "baseline_tuned": study_tuned,
    "expert": study_expert,
    "policy": study_policy,
}
SHOWN = {"expert": "s", "policy": "o", "baseline_tuned": "^"}  # markers in the figure


def table(found):
    """The finalists beside the paper's settings, and the trainings."""
    facts = {
        "fall": 4,
        "pushed": 3,
        "timeout": 4,
        "time": 2,
        "still_near": 3,
        "still_far": 3,
        "chosen": 0,
    }
    text = ""
    for part in ("baseline_tuned", "expert"):
        if part in found:
            rows = [row | row["settings"] for row in found[part]["finalists"]]
            columns = {"price": 0} | dict.fromkeys(rows[0]["settings"], 2) | facts
            rows.insert(0, {"chosen": "paper", **found.get("paper", {})})
            rule = f"Chosen: {found[part]['rule']}."
            text += f"### {part}\n\n{common.table(rows, columns)}\n{rule}\n\n"
    return text + common.sections(found, {"policy": {"seed": 0} | facts})


def plot(found, sim):
    """Draws time over falls, without pushes and with them: what speed costs."""
    figure, axes = common.subplots(1, 2, figsize=(10, 4.2), sharey=True)
    titles = {"fall": "near and far, % of 2,000 walks", "pushed": "far, pushed, % of 1,000 walks"}
    for axis, (key, title), most in zip(axes, titles.items(), (MAX_FALLS, MAX_PUSHED)):
        axis.axvline(100 * most, color="0.5", ls="--", label="the rule allows so many")
        for part, marker in SHOWN.items():
            if part in found:
                rows = found[part].get("finalists") or found[part]["rows"]
                look = {"ms": 9, "color": common.COLORS[part], "label": part}
                axis.plot(100 * np.array(values(rows, key)), values(rows, "time"), marker, **look)
                (best,) = pick(rows, chosen=True)
                axis.plot(100 * best[key], best["time"], "ko", ms=17, fillstyle="none")
        axis.set(xlabel=f"falls: {title}")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    axes[0].set_ylabel("mean time, near and far [s]")
    figure.suptitle(f"What speed costs: settings and trainings, circles: chosen ({sim})")
    return figure


if __name__ == "__main__":
    common.start("baseline")
