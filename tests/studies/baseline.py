"""How good can planners get that do not learn? All their settings optimised, by one method.

    python tests/studies/baseline.py [--mujoco] [--only baseline_tuned | expert] [--out FOLDER]

baseline_tuned: the paper's baseline; both feet share its steps.
expert: `tests/exercises/expert.py`.
Cross-entropy method on the logarithms of eight settings. Where it
ends, the settings in use, and the best candidates walk to 2,000 other goals; `choose` decides.
"""

import sys
from dataclasses import asdict, fields

import common
import numpy as np
from common import RESULTS, ROOT, evaluate
from tqdm import tqdm

sys.path.append(str(ROOT / "tests" / "exercises"))
import expert

DURATION = "12 minutes on two cores; 3-D: 25 minutes"
SIZES, FINALISTS = (8, 16, 4), 5
WALKS = 64  # near ones and as many far ones, for every candidate
SETS = 2  # of 500 near and of 500 far ones, for every finalist
PRICE = 200.0  # [s] of one fall per walk; of a time-out a quarter: our choice
LEAVING = 50.0  # [s] of one walk in which it does not stay, beyond the paper's; our choice
MAX_FALLS = 0.005  # share of the walks
LESS = 0.01  # by how much less it may stay than the paper's: 2,000 trials cannot tell this apart
Settings = evaluate.BaselineSettings
TUNED = [entry.name for entry in fields(Settings) if entry.name != "share"]
EXPERT = ["top_x", "top_y", "top_turn", "change_x", "change_y", "change_turn", "together", "gain"]
START = (0.48, 0.35, 0.25, 1.1, 0.85, 0.7, 0.85, 0.25)  # of it, from first trials in 3-D


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
    """The facts of a planner on 2,000 noisy trials."""
    return facts(both(world, planner, 101, SETS))


def cost(row, paper):
    """What the search makes small [s]: time, falls, and staying less often than the paper's."""
    if row["time"] is None:
        return 100.0
    leaves = max(0.0, paper["still_there"] - row["still_there"])
    return row["time"] + PRICE * (row["fall"] + row["timeout"] / 4) + LEAVING * leaves


def optimise(world, planner_of, start, paper):
    """All candidates as (settings, facts, cost), and the settings where it ends."""

    def plain(x):
        return [round(float(value), 4) for value in np.exp(x)]

    def costs(iteration, drawn):
        rows = []
        for x in tqdm(drawn, leave=False, unit=" candidates"):
            row = facts(both(world, planner_of(plain(x)), 1 + iteration, 1, WALKS))
            rows.append((plain(x), row, cost(row, paper)))
        found = [row[2] for row in rows]
        tried.extend(rows)
        print(f"{iteration}: mean {found[0]:.2f} s, best {min(found):.2f} s", flush=True)
        return found

    tried, rng = [], np.random.default_rng(0)
    return tried, plain(common.cross_entropy(costs, np.log(start), 0.3, SIZES, rng))


def choose(rows, paper):
    """The best of these facts, and by which rule; paper: facts of the paper's baseline."""
    safe = [
        row
        for row in sorted(rows, key=lambda row: row["time"] or np.inf)
        if row["fall"] <= MAX_FALLS
    ]
    stay = [row for row in safe if (row["still_there"] or 0) >= paper["still_there"] - LESS]
    if stay:
        return stay[0], "the fastest of the safe ones that stay"
    if safe:
        return safe[0], "none is safe and stays: the fastest that is safe"
    return min(rows, key=lambda row: row["fall"]), "none is safe: the fewest falls"


def searched(world, planner_of, names, start, now, paper):
    """The whole search; `start`, and the settings that are in use now: values by `names`."""
    tried, end = optimise(world, planner_of, start, paper)
    tried.sort(key=lambda row: row[2])
    best_of_all = [values for values, *_ in tried[: FINALISTS - 2]]
    rows = [
        {"settings": dict(zip(names, values)), **final(world, planner_of(values))}
        for values in tqdm([end, now, *best_of_all], unit=" finalists")
    ]
    best, rule = choose(rows, paper)
    print("chosen:", best["settings"])
    return {
        "trials": 2 * SETS * common.PER_SET,
        "rule": rule,
        "paper": paper,
        "finalists": [row | {"chosen": row is best} for row in rows],
        "tried": [{"settings": values, **row} for values, row, _ in tried],
    }


def study_tuned(args):
    """The settings TUNED of stage 05."""
    now = [getattr(evaluate.TUNED_BASELINE[args.sim], name) for name in TUNED]
    with common.world(args.sim) as world:
        paper = final(world, evaluate.BaselinePlanner(Settings()))
        return searched(world, tuned_of, TUNED, START, now, paper)


def study_expert(args):
    """The constants of the expert; they are those of 3-D."""
    settings = expert.Settings()
    now = [*settings.top, *settings.change, settings.together, settings.gain]
    paper = common.read_json(RESULTS / args.sim / "studies/baseline.json")["baseline_tuned"][
        "paper"
    ]
    with common.world(args.sim) as world:
        return searched(world, expert_of, EXPERT, now, now, paper)


PARTS = {"baseline_tuned": study_tuned, "expert": study_expert}


def table(found, sim):
    """The finalists; of it also the paper's settings."""
    text = ""
    for part, names in (("baseline_tuned", TUNED), ("expert", EXPERT)):
        if part in found:
            paper = {"settings": asdict(Settings()), "chosen": "paper", **found[part]["paper"]}
            first = [paper] * (part == "baseline_tuned")
            columns = dict.fromkeys(names, 2) | {
                "fall": 4,
                "timeout": 4,
                "time": 2,
                "still_there": 3,
                "chosen": 0,
            }
            rows = [row | row["settings"] for row in [*first, *found[part]["finalists"]]]
            text += (
                f"### {part}\n\n{common.table(rows, columns)}\nChosen: {found[part]['rule']}.\n\n"
            )
    return text


def found(data):
    """Sentences by name, from the numbers of both simulators."""
    tuned, by_hand = (data["mujoco"][part] for part in ("baseline_tuned", "expert"))
    time, other = (
        common.pick(part["finalists"], chosen=True)[0]["time"] for part in (tuned, by_hand)
    )
    return {
        "tuned": f"In 3-D `baseline_tuned` needs {time:.1f} s for near and far goals together, the "
        f"paper's settings {tuned['paper']['time']:.1f} s.",
        "expert": f"`expert` needs {other:.1f} s.",
    }


if __name__ == "__main__":
    common.start("baseline")
