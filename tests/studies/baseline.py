"""How good can planners get that do not learn? One method optimises all their settings.

    python tests/studies/baseline.py [--mujoco] [--only PART] [--out FOLDER]

paper: the paper's baseline, with which the others are compared; what sharing sidesteps brings.
baseline_tuned: the same controller, but both feet share its steps.
expert: `tests/studies/expert.py`.
policy: the trained policies on the same walks. baseline.png shows times and falls of all.

An evolution strategy (`common.cma_es`) searches the logarithms of eight settings. Each search may
take as many double steps as the training of a policy, and there are three of them, which begin at
the settings in use. Their ends, and these settings, are compared on 2,000 other goals, and with
pushes on the 1,000 far ones. If the one with the fewest points of the contest breaks the rule
(`keeps`), a fourth search begins there, and asks for more. Of those that keep the rule the one with
the fewest points is taken; so is the policy to be shipped. If none keeps it, *still there* does not
count; if none falls so seldom, all of them count.
"""

from dataclasses import replace

import common
import expert
import numpy as np
from common import evaluate, ppo

DURATION = "on one core: two hours; 3-D: six hours"
RESTARTS, BUDGET = 3, ppo.STEPS  # searches, and the double steps of each
PUSH = 0.4  # [m/s]
WALKS = {0.0: 36, PUSH: 12}  # of every candidate, by push; half to near, half to far goals
SETS = 2  # of 500 near and of 500 far ones, for every finalist
LEAVING = 50.0  # [s] in the search: price of leaving the goal again, if more often than allowed
MORE = 0.02  # by which the fourth search asks for more walks that are still there
# The rule for all planners: of those that keep it, the fewest points win. Our choice.
STAYS = 0.93  # least share of *still there*, near and far
MAX_FALLS, MAX_PUSHED = 0.005, 0.02  # share of the walks; of those with pushes
EXPERT = ["top_x", "top_y", "top_turn", "change_x", "change_y", "change_turn", "together", "gain"]


def tuned_of(settings):
    """The team's controller with these settings, but both feet share its steps."""
    return evaluate.BaselinePlanner(evaluate.BaselineSettings(*settings, share=True))


def in_use(sim):
    """The settings of `baseline_tuned`, by name, in the order of `tuned_of`."""
    settings = vars(evaluate.TUNED_BASELINE[sim]).copy()
    del settings["share"]
    return settings


def expert_of(settings):
    """The expert with these settings, in the order of EXPERT."""
    top, change = tuple(settings[:3]), tuple(settings[3:6])
    return expert.Planner(expert.Settings(top, change, *settings[6:]))


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


def cost(row, stays=STAYS):
    """What the search makes small [s]: the points of the contest, and the price of leaving the goal."""
    return min(1000.0, points(row) + LEAVING * max(0.0, stays - (row["still_there"] or 0)))


def keeps(row, stays=STAYS):
    """Does a planner with these facts keep the rule, if it need be still there so often?"""
    least = min(row["still_near"] or 0, row["still_far"] or 0)  # None: it never arrived
    return row["fall"] <= MAX_FALLS and row["pushed"] <= MAX_PUSHED and least >= stays


def points(row):
    """Those of the contest, from a planner's facts: seconds; a fall and a time-out have a price."""
    price = common.PER_FALL * row["fall"] + common.PER_TIMEOUT * row["timeout"]
    return np.inf if row["time"] is None else row["time"] + price


def choose(rows):
    """The rows, which say whether they are chosen: see above."""
    kept = [row for row in rows if keeps(row)] or [row for row in rows if keeps(row, stays=0.5)]
    best = min(kept or rows, key=points)
    return [row | {"chosen": row is best} for row in rows]


def searched(args, planner_of, now):
    """The whole search, from the settings on that are in use, `now`: values by name."""
    world, rows, curve = common.world(args.sim), [], []
    worlds = [common.world(args.sim, num_robots=n, push=push) for push, n in WALKS.items()]

    def walked(drawn, trial):
        return common.calm_and_pushed([planner_of(plain(x)) for x in drawn], worlds, trial)

    def plain(x):
        return np.exp(x).round(4).tolist()

    def compare(search, settings):
        row = {"search": search, "settings": dict(zip(now, settings))}
        rows.append(row | final(world, planner_of(settings)))

    def search(restart, start, stays):
        def price(ended):
            return cost(facts(ended), stays)

        x, more = common.search(walked, price, np.log(start), 0.2, BUDGET, restart)
        curve.extend(more)
        compare(restart + 1, plain(x))

    compare("none", [*now.values()])
    for restart in range(RESTARTS):
        search(restart, [*now.values()], STAYS)
    best = min(rows, key=points)
    if not keeps(best):
        search(RESTARTS, [*best["settings"].values()], STAYS + MORE)
    return {"rows": choose(rows), "curve": curve, "fits": ppo.fingerprint(world)}


def study_paper(args):
    """The row of the paper's settings, and of ours if both feet do not share sidesteps."""
    alone = replace(evaluate.TUNED_BASELINE[args.sim], share=False)
    tried = {"the team's": evaluate.BaselineSettings(), "ours, not shared": alone}
    world = common.world(args.sim)
    planners = {name: evaluate.BaselinePlanner(settings) for name, settings in tried.items()}
    return [{"settings": name} | final(world, planners[name]) for name in planners]


def study_tuned(args):
    """The search for TUNED_BASELINE of stage 5."""
    return searched(args, tuned_of, in_use(args.sim))


def study_expert(args):
    """The search for the settings of the expert."""
    now = expert.TUNED[args.sim]
    constants = [*now.top, *now.change, now.together, now.gain]
    return searched(args, expert_of, dict(zip(EXPERT, constants)))


def study_policy(args):
    """Rows of the trained policies on the same walks. The chosen one is to be shipped."""
    world, planners = common.world(args.sim), common.trainings(args.sim)
    return choose([{"seed": k, **final(world, planners[k])} for k in planners])


PARTS = {
    "paper": study_paper,
    "baseline_tuned": study_tuned,
    "expert": study_expert,
    "policy": study_policy,
}
SHOWN = {"expert": "s", "policy": "o", "baseline_tuned": "^"}  # markers in the figure


FACTS = {"fall": 4, "pushed": 3, "time": 2, "still_near": 3, "still_far": 3, "chosen": 0}
COLUMNS = {
    "paper": {"settings": 0, **FACTS},
    "baseline_tuned": {"search": 0, **FACTS},
    "expert": {"search": 0, **FACTS},
    "policy": {"seed": 0, **FACTS},
}


def plot(found, sim):
    """Draws time over falls, without pushes and with them: what speed costs."""
    figure, panels = common.subplots(1, 2, figsize=(9, 4), sharey=True)
    titles = {
        "fall": "2,000 calm walks, near and far",
        "pushed": f"x: falls of 1,000 far walks, pushed by {PUSH} m/s",
    }
    for axes, (key, title), most in zip(panels, titles.items(), (MAX_FALLS, MAX_PUSHED)):
        axes.axvline(100 * most, color="0.5", ls="--", zorder=0)
        axes.set(title=title, xlabel="falls [%]; dashed: the most that the rule allows")
        for part, marker in SHOWN.items():
            axes.plot([], [], marker, color=common.COLORS[part], label=part)
            for row in found[part]["rows"] if part in found else ():
                # Hollow: it breaks the rule. Large: it was chosen.
                fill = "full" if keeps(row) else "none"
                look = {
                    "color": common.COLORS[part],
                    "fillstyle": fill,
                    "ms": 14 if row["chosen"] else 8,
                }
                axes.plot(100 * row[key], row["time"], marker, **look)
    panels[0].set_ylabel("mean time of the calm walks [s]")
    panels[0].legend(loc="upper right")
    return figure


PICTURES = {"baseline": ("paper", plot), "baseline.search": ("expert", common.plot_searches)}


if __name__ == "__main__":
    common.start("baseline")
