"""The shipped evidence: complete, good enough, and what README says of it."""

import csv
import json
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
SIMS = ("pymunk", "mujoco")


def evaluation(sim):
    return json.loads((ROOT / "results" / sim / "evaluation.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("sim", SIMS)
def test_readme_shows_the_shipped_table(sim):
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    shown = readme.split(f"<!-- table {sim} -->")[1].split("<!-- end -->")[0].strip()
    shipped = (ROOT / "results" / sim / "table.md").read_text(encoding="utf-8").strip()
    assert shown == shipped, f"README's {sim} table is not results/{sim}/table.md: copy it again"


@pytest.mark.parametrize("sim", SIMS)
def test_shipped_numbers_meet_what_we_promise(sim):
    shipped = evaluation(sim)
    rows = {(row["planner"], row["noise"]): row for row in shipped["rows"]}
    for noise, least in ((False, 0.97), (True, 0.95)):
        policy, baseline = rows["policy", noise], rows["baseline", noise]
        assert policy["episodes"] >= 500
        assert policy["success"] >= least
        assert policy["stays_up"] >= 0.99, "the policy lunges at the goal and falls behind it"
        assert baseline["success"] >= 0.90
    for ratio in shipped["ratios"]:
        if (ratio["planner"], ratio["reference"]) == ("policy", "baseline"):
            assert ratio["time_ratio"] <= 0.50


@pytest.mark.parametrize("sim", SIMS)
def test_evaluation_agrees_with_its_trials(sim):
    """The rates in evaluation.json are recomputed from the single trials."""
    with open(ROOT / "results" / sim / "trials.csv", newline="", encoding="utf-8") as file:
        trials = list(csv.DictReader(file))
    for row in evaluation(sim)["rows"]:
        key = (row["planner"], "yes" if row["noise"] else "no")
        own = [trial for trial in trials if (trial["planner"], trial["noise"]) == key]
        assert len(own) == row["episodes"]
        times = [float(t["time"]) for t in own if t["outcome"] == "success"]
        assert len(times) / len(own) == pytest.approx(row["success"], abs=5e-4)
        assert np.mean(times) == pytest.approx(row["time_mean"], abs=5e-3)


@pytest.mark.parametrize("sim", SIMS)
def test_shipped_policy_fits_and_walks(sim):
    evaluate = import_module("05_evaluate")
    env = import_module("03_env")
    planner, _ = evaluate.load_planner(ROOT / "results" / sim / "policy.pt", sim)
    goals = env.draw_goals(env.stream("evaluation", 1), 24)  # not the goals of the shipped table
    world = env.FootstepWorld(len(goals), sim)
    try:
        trials = evaluate.evaluate(planner, world, goals, seed=1)
    finally:
        world.close()
    success = np.mean(trials["outcome"] == "success")
    # With a true rate of 0.97, fewer than 20 of 24 happen once in 3000 runs.
    assert success >= 20 / 24, f"the shipped {sim} policy reached only {success:.2f} of new goals"
    assert np.mean(trials["time"]) < 10.0, "a good policy needs about four to five seconds"
