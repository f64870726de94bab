"""How good can planners get that do not learn? All their settings optimised, by one method.

    python tests/studies/baseline.py [--mujoco] [--only PART] [--out FOLDER]

paper: the paper's baseline, with which the others are compared.
baseline_tuned: the same controller; both feet share its steps.
expert: `tests/exercises/expert.py`.
Cross-entropy method on the logarithms of eight settings, for one price of a fall after the other:
each search begins where the last one has ended. These ends and the settings in use walk to 2,000
other goals, and pushed to 1,000 far ones; `choose` decides.
policy: the trainings on the same walks. The figure shows what speed costs each of them in falls.
"""

import sys
from dataclasses import fields
from functools import partial

import common
import matplotlib.pyplot as plt
import numpy as np
from common import RESULTS, ROOT, evaluate
from tqdm import tqdm

sys.path.append(str(ROOT / "tests" / "exercises"))
import expert

DURATION = "15 minutes on two cores; 3-D: 30 minutes"
SIZES = (2, 14, 4)  # iterations for each price, candidates, how many are kept
WALKS = 48  # near ones and as many far ones, for every candidate
SETS = 2  # of 500 near and of 500 far ones, for every finalist
PRICES = (50.0, 100.0, 200.0, 400.0)  # [s] of one fall per walk; of a time-out a quarter
PUSH = 0.4  # [m/s]
LEAVING = 50.0  # [s] of one walk in which it does not stay, beyond the paper's; our choice
MAX_FALLS, MAX_PUSHED = 0.005, 0.05  # share of the walks; of those with pushes
LESS = 0.01  # by how much less it may stay than the paper's: 2,000 trials cannot tell this apart
Settings = evaluate.BaselineSettings
TUNED = [entry.name for entry in fields(Settings) if entry.name != "share"]
EXPERT = ["top_x", "top_y", "top_turn", "change_x", "change_y", "change_turn", "together", "gain"]


def tuned_of(values):
    """The paper's controller with these settings, in the order of TUNED."""
    return evaluate.BaselinePlanner(Settings(*values, share=True))


def expert_of(values):
    """The expert with these settings, in the order of EXPERT."""
    return expert.Planner(expert.Settings(tuple(values[:3]), tuple(values[3:6]), *values[6:]))


def both(world, planner, first, sets, per_set=None):
    """Near and far walks of the tuning together, with noise."""
    return common.together(
        [
            common.walks(planner, world, far, sets, first, per_set, purpose="tuning")
            for far in (False, True)
        ]
    )


def facts(ended):
    """What counts of some walks, plain numbers."""
    reached = ended["outcome"] == "success"

    def mean(name):
        return float(ended[name][reached].mean()) if reached.any() else None

    shares = {name: float(np.mean(ended["outcome"] == name)) for name in evaluate.OUTCOMES}
    return shares | {"time": mean("time"), "still_there": mean("still_there")}


def final(world, planner):
    """The facts of a planner on 2,000 noisy trials; pushed: share of falls in the 1,000 far ones,
    if it is pushed there.
    """
    rows = facts(both(world, planner, 101, SETS))
    with common.world(world.sim, push=PUSH) as windy:
        ended = common.walks(planner, windy, True, SETS, 101, purpose="tuning")
    return rows | {"pushed": facts(ended)["fall"]}


def cost(row, paper, price=PRICES[2]):
    """What the search makes small [s]: time, falls, and staying less often than the paper's."""
    if row["time"] is None:
        return 100.0
    leaves = max(0.0, paper["still_there"] - row["still_there"])
    return row["time"] + price * (row["fall"] + row["timeout"] / 4) + LEAVING * leaves


def optimise(world, planner_of, start, paper):
    """All candidates as (settings, facts, price), and the settings where it ends for each price."""

    def plain(x):
        return [round(float(value), 4) for value in np.exp(x)]

    def costs(price, _, drawn):
        rows = []
        for x in tqdm(drawn, leave=False, unit=" candidates"):
            row = facts(both(world, planner_of(plain(x)), 1 + len(tried) // SIZES[1], 1, WALKS))
            rows.append((plain(x), row, price))
        found = [cost(row, paper, price) for _, row, _ in rows]
        tried.extend(rows)
        print(f"price {price:.0f} s: mean {found[0]:.2f} s, best {min(found):.2f} s", flush=True)
        return found

    tried, ends, rng = [], [], np.random.default_rng(0)
    mean = np.log(start)
    for price in PRICES:
        spread = 0.15 if ends else 0.3
        mean = common.cross_entropy(partial(costs, price), mean, spread, SIZES, rng)
        ends.append(plain(mean))
    return tried, ends


def choose(rows, paper):
    """The best of these facts, and by which rule; paper: facts of the paper's baseline."""
    safe = [
        row
        for row in sorted(rows, key=lambda row: row["time"] or np.inf)
        if row["fall"] <= MAX_FALLS and row["pushed"] <= MAX_PUSHED
    ]
    stay = [row for row in safe if (row["still_there"] or 0) >= paper["still_there"] - LESS]
    if stay:
        return stay[0], "the fastest of the safe ones that stay"
    if safe:
        return safe[0], "none is safe and stays: the fastest that is safe"
    return min(rows, key=lambda row: row["fall"]), "none is safe: the fewest falls"


def searched(args, planner_of, names, now):
    """The whole search, from the settings on that are in use now, values by `names`."""
    paper = common.read_json(args.out / "baseline.json")["paper"]
    with common.world(args.sim) as world:
        tried, ends = optimise(world, planner_of, now, paper)
        rows = [
            {"price": price, "settings": dict(zip(names, at)), **final(world, planner_of(at))}
            for price, at in tqdm([*zip(PRICES, ends), (None, now)], unit=" finalists")
        ]
    best, rule = choose(rows, paper)
    return {
        "trials": 2 * SETS * common.PER_SET,
        "rule": rule,
        "paper": paper,
        "finalists": [row | {"chosen": row is best} for row in rows],
        "tried": [{"settings": values, "price": price, **row} for values, row, price in tried],
    }


def study_paper(args):
    """The facts of the paper's settings."""
    with common.world(args.sim) as world:
        return final(world, evaluate.BaselinePlanner(Settings()))


def study_tuned(args):
    """The settings TUNED of stage 05."""
    now = evaluate.TUNED_BASELINE[args.sim]
    return searched(args, tuned_of, TUNED, [getattr(now, name) for name in TUNED])


def study_expert(args):
    """The constants of the expert; they are those of 3-D."""
    now = expert.Settings()
    return searched(args, expert_of, EXPERT, [*now.top, *now.change, now.together, now.gain])


def study_policy(args):
    """The trainings on the same walks."""
    rows = []
    with common.world(args.sim) as world:
        for seed in common.SEEDS[args.sim]:
            file = RESULTS / args.sim / "seeds" / str(seed) / "policy.pt"
            rows.append({"seed": seed, **final(world, common.policy(file, args.sim))})
    return {"trials": 2 * SETS * common.PER_SET, "rows": rows}


PARTS = {
    "paper": study_paper,
    "baseline_tuned": study_tuned,
    "expert": study_expert,
    "policy": study_policy,
}
SHOWN = {"expert": "s", "policy": "o", "baseline_tuned": "^"}  # markers in the figure


def table(found, sim):
    """The finalists beside the paper's settings, and the trainings."""
    facts = {"fall": 4, "pushed": 3, "timeout": 4, "time": 2, "still_there": 3}
    text = ""
    for part, names in (("baseline_tuned", TUNED), ("expert", EXPERT)):
        if part in found:
            rows = [row | row["settings"] for row in found[part]["finalists"]]
            rows.insert(0, {"chosen": "paper", **found[part]["paper"]})
            columns = {"price": 0} | dict.fromkeys(names, 2) | facts | {"chosen": 0}
            text += (
                f"### {part}\n\n{common.table(rows, columns)}\nChosen: {found[part]['rule']}.\n\n"
            )
    return text + common.sections(found, {"policy": {"seed": 0} | facts})


def plot(found, sim):
    """Time over falls, without pushes and with them: what speed costs."""
    figure, axes = plt.subplots(1, 2, figsize=(11, 4), sharey=True)
    titles = "near and far, % of 2,000 walks", "far, pushed, % of 1,000 walks"
    for axis, key, title in zip(axes, ("fall", "pushed"), titles):
        for part, marker in SHOWN.items():
            if part in found:
                rows = found[part].get("finalists") or found[part]["rows"]
                share = [100 * row[key] for row in rows]
                time = [row["time"] for row in rows]
                axis.plot(share, time, marker, ms=10, color=common.COLORS[part], label=part)
        axis.set(xlabel=f"falls: {title}", xlim=(0, None))
    axes[0].legend()
    axes[0].set_ylabel("mean time, near and far [s]")
    figure.suptitle(f"What speed costs: settings and trainings by time and falls ({sim})")
    return figure


def found(data):
    """Sentences by name, from the numbers of both simulators."""
    parts = data["mujoco"]
    (tuned,), (by_hand,) = (
        common.pick(parts[part]["finalists"], chosen=True) for part in ("baseline_tuned", "expert")
    )
    times, falls = ([row[key] for row in parts["policy"]["rows"]] for key in ("time", "fall"))
    return {
        "tuned": f"In 3-D `baseline_tuned` needs {tuned['time']:.1f} s for near and far goals "
        f"together, the paper's settings {parts['paper']['time']:.1f} s.",
        "expert": f"`expert` needs {by_hand['time']:.2f} s and falls in "
        f"{common.share(by_hand['fall'], 2)}; on the same goals the trainings of the policy need "
        f"{min(times):.2f} to {max(times):.2f} s and fall in {common.share(min(falls), 2)} to "
        f"{common.share(max(falls), 2)}.",
    }


if __name__ == "__main__":
    common.start("baseline")
