"""How far does pure search get? And what does it cost to be blind to dynamics?

    python tests/studies/search.py [--mujoco] [--ship]

The planner `search` of stage 5 with step sizes of half to all that the limits allow, and with a
largest change from one double step to the next: every combination on 600 noisy tuning trials, half
of them far. The five best are walked again on 2,000 others. Kept is the fastest with at most 0.5 %
falls that stays (search.npz); if none does, the one that falls least, and the table says so. The
figure shows all of them beside all the carrots that the study `baseline` has tried.
"""

import baseline
import common
import kept
import numpy as np
from kept import env, evaluate
from tqdm import tqdm

DURATION = {"pymunk": "about 10 minutes on two cores", "mujoco": "about 20 minutes on two cores"}
FACTORS = (0.4, 0.5, 0.6, 0.75, 1.0)  # [-] on the limits of a step
CHANGES = (0.1, 0.2, 0.35, 1.0)  # [share of limits] from one double step to the next; 1: any
WALKS, FINALISTS = 300, 5

def table(sim, factor):
    """(steps, moves, value) for step sizes up to that factor; kept."""
    limits = evaluate.walk_engine.LIMITS[sim]
    key = common.digest(env.fingerprint(sim), factor, evaluate.CELL, evaluate.TURN, evaluate.HALF)
    path = common.work(sim, "search") / f"{key}.npz"
    if not path.is_file():
        steps = evaluate.double_steps(limits, factor)
        moves, stood = evaluate.displacements(sim, steps)
        value = evaluate.steps_to_go(moves[stood], env.Task())
        evaluate.save_search(path, sim, factor, 1.0, (steps[stood], moves[stood], value))
    with np.load(path) as stored:
        planner = evaluate.load_search(path, sim)[0]
        return stored["steps"], stored["moves"], planner.value

def planner(sim, factor, change):
    """The planner, and what it depends on."""
    limits = evaluate.walk_engine.LIMITS[sim]
    return evaluate.SearchPlanner(*table(sim, factor), limits, change), ("search", factor, change)

def study(sim):
    """The grid, then the finalists."""
    trials, tried = kept.Trials(sim), []
    for factor in FACTORS:
        for change in tqdm(CHANGES, desc=f"factor {factor}", leave=False):
            ended = baseline.both(trials, planner(sim, factor, change), True, 1, 1, WALKS)
            tried.append({"factor": factor, "change": change, **baseline.facts(ended)})
    tried.sort(key=baseline.cost)
    paper = baseline.final(trials, kept.baseline(baseline.Settings()))
    rows = [row | baseline.final(trials, planner(sim, row["factor"], row["change"]))
            for row in tried[:FINALISTS]]
    trials.close()
    best, rule = baseline.choose(rows, paper)
    file = common.work(sim) / "search.npz"
    evaluate.save_search(file, sim, best["factor"], best["change"], table(sim, best["factor"]))
    lines = [[row["factor"], row["change"], f"{row['fall']:.4f}", f"{row['timeout']:.4f}",
              common.number(row["time"], 2), common.number(row["still_there"], 3),
              common.number(row["still_there_quiet"], 3), "chosen" * (row is best)]
             for row in rows]
    head = ["step size", "largest change", "fall", "timeout", "time [s]", "still there",
            "without noise", ""]
    content = {"trials": 2 * baseline.SETS * kept.PER_SEED, "rule": rule, "finalists": rows,
               "tried": tried}
    return common.Findings(content, common.markdown(head, lines), plot(tried, sim),
                           {"search.npz": file})

def plot(tried, sim):
    """Falls against time, every setting a dot."""
    figure, axis = common.plt.subplots(figsize=(7, 4.5), layout="constrained")
    carrots = common.read_json(common.RUNS / sim / "baseline.json")["tried"]
    for rows, name in ((carrots, "baseline_tuned"), (tried, "search")):
        known = [(row["time"], row["fall"]) for row in rows if row["time"] is not None]
        label = f"{name}: {len(known)} settings"
        axis.plot(*np.transpose(known), ".", color=kept.COLORS[name], label=label, alpha=0.6)
    axis.axhline(baseline.MAX_FALLS, color="0.6", lw=1)
    axis.set(xlabel="mean time of the successes [s]", ylabel="share of walks that fell [1]",
             yscale="symlog", title=f"What it costs to be fast, and blind ({sim})", xlim=(0, 30))
    axis.set_yscale("symlog", linthresh=0.01)
    axis.grid(alpha=0.3)
    axis.legend()
    return figure

if __name__ == "__main__":
    common.main(__file__)
