"""The shipped evidence: complete, good enough, and what README says of it."""

import csv
import json
import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

evaluate = import_module("05_evaluate")
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
    for noise, least in ((False, 0.994), (True, 0.990)):
        policy, baseline = rows["policy", noise], rows["baseline", noise]
        assert policy["episodes"] >= 500
        assert policy["success"] >= least
        assert policy["stays_up"] >= 0.99, "the policy lunges at the goal and falls behind it"
        assert baseline["success"] >= 0.90
    for ratio in shipped["ratios"]:
        if (ratio["planner"], ratio["reference"]) == ("policy", "baseline"):
            assert ratio["time_ratio"] <= 0.38


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

# The study behind README's second table: 2,000 goals, three training seeds.
@pytest.mark.parametrize("sim", SIMS)
def test_three_seeds_beat_the_paper(sim):
    study = json.loads((ROOT / "results" / sim / "studies/seeds.json").read_text(encoding="utf-8"))
    assert study["goals"] >= 2000
    for noise, success, ratio in ((False, 0.994, 0.36), (True, 0.990, 0.38)):
        rows = [r for r in study["rows"] if r["seed"] is not None and r["noise"] == noise]
        assert len({row["seed"] for row in rows}) >= 3
        mean = {key: np.mean([row[key] for row in rows]) for key in (
            "success", "fall", "timeout", "stays_up", "over_baseline", "over_baseline_tuned")}
        assert mean["success"] >= success
        assert mean["fall"] <= 1 - success
        assert mean["timeout"] <= 0.001
        assert mean["stays_up"] >= 0.998
        assert mean["over_baseline"] <= ratio, "the paper: 0.545 and 0.556"
        assert mean["over_baseline_tuned"] <= 0.60
        tuned = next(r for r in study["rows"]
                     if r["planner"] == "baseline_tuned" and r["noise"] == noise)
        count = sum(row["episodes"] for row in rows)
        most = evaluate.wilson(round(mean["success"] * count), count)[1]
        # Not lower beyond chance: the two intervals overlap.
        assert most >= tuned["success_ci95"][0], "faster, but less reliable: not better"


@pytest.mark.parametrize("sim", SIMS)
def test_the_shipped_policy_is_the_median_seed(sim):
    folder = ROOT / "results" / sim
    study = json.loads((folder / "studies/seeds.json").read_text(encoding="utf-8"))
    noisy = [r for r in study["rows"] if r["seed"] is not None and r["noise"]]
    order = sorted(noisy, key=lambda r: (r["success"], -r["time_mean"]))
    assert order[len(order) // 2]["seed"] == study["median_seed"]
    median = folder / "seeds" / str(study["median_seed"]) / "policy.pt"
    assert (folder / "policy.pt").read_bytes() == median.read_bytes(), "not the best: the median"


@pytest.mark.parametrize("sim", SIMS)
def test_the_imu_study_is_complete_and_ships_the_median(sim):
    folder = ROOT / "results" / sim
    study = json.loads((folder / "studies/imu.json").read_text(encoding="utf-8"))
    assert all(row["episodes"] >= 5000 for row in study["rows"])
    assert len({row["seed"] for row in study["rows"]}) >= 3
    median = folder / "imu" / "seeds" / str(study["median_seed"]) / "policy.pt"
    assert (folder / "imu" / "policy.pt").read_bytes() == median.read_bytes(), "not the best one"
    assert study["means"][1]["time_ratio"] <= 1.005, "safe, but slower: that is easy"


@pytest.mark.parametrize("sim", SIMS)
def test_with_imu_falls_are_halved_or_rare_anyway(sim):
    study = json.loads((ROOT / "results" / sim / "studies/imu.json").read_text(encoding="utf-8"))
    without, with_imu = (mean["fall"] for mean in study["means"])
    assert with_imu <= 0.5 * without or max(without, with_imu) <= 0.001


def test_half_way_from_mode_to_mean_is_where_falls_are_rare():
    path = ROOT / "results/mujoco/studies/decision.json"
    rows = json.loads(path.read_text(encoding="utf-8"))["rows"]
    for planner in ("policy", "policy_imu"):
        fall, time = ({rule: np.mean([r[key] for r in rows
                                      if (r["planner"], r["rule"]) == (planner, rule)])
                       for rule in ("mode (paper)", "half-way (ours)", "mean")}
                      for key in ("fall", "time_mean"))
        assert fall["half-way (ours)"] <= 0.5 * fall["mode (paper)"]
        assert time["half-way (ours)"] <= 1.04 * time["mode (paper)"] < time["mean"]


@pytest.mark.parametrize("sim", SIMS)
def test_a_short_training_is_enough(sim):
    study = json.loads((ROOT / "results" / sim / "studies/budget.json").read_text(encoding="utf-8"))
    assert study["episodes"] >= 1000 and study["success"] >= 0.98
    assert study["minutes"] <= 6.0, "on two cores"
    assert study["learning_ms"] <= 0.10, "everything but simulation, per double step"


@pytest.mark.parametrize("sim", SIMS)
def test_readme_shows_the_shipped_benchmark(sim):
    shipped = (ROOT / "results" / sim / "benchmark.txt").read_text(encoding="utf-8").strip()
    assert shipped in (ROOT / "README.md").read_text(encoding="utf-8")
    row = next(line.split() for line in shipped.splitlines() if line.split()[0] == "64")
    assert float(row[3]) >= {"pymunk": 0.50, "mujoco": 0.90}[sim], "too much beside the physics"


def test_readme_shows_the_studies():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    shown = dict(re.findall(r"<!-- study (\S+) -->\n(.*?)<!-- end -->", readme, re.DOTALL))
    assert len(shown) >= 12
    for name, text in shown.items():
        sim, study = name.split("/")
        shipped = (ROOT / "results" / sim / "studies" / f"{study}.md").read_text(encoding="utf-8")
        assert text.strip() == shipped.strip(), f"README's {name} is not results/…/{study}.md"


def test_readme_s_exercises_exist():
    """Every function to be written, and every file with its tests."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    row = r"^\| (`.* in stage (0\d).*) \| `(tests/\S+) -k (.*)` \|$"
    rows = re.findall(row, readme, re.MULTILINE)
    assert len(rows) >= 6
    for text, stage, tests, keywords in rows:
        module = import_module(next(ROOT.glob(f"{stage}_*.py")).stem)
        for name in re.findall(r"`(\w+)`", text):
            assert callable(getattr(module, name)), f"{name} is not in stage {stage}"
        source = (ROOT / tests).read_text(encoding="utf-8")
        for keyword in keywords.strip('"').split(" or "):
            assert re.search(rf"def test_\w*{keyword}", source), f"no test for {keyword} in {tests}"
