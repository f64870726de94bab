"""The shipped evidence: complete, good enough, and what README says of it.

What lies in results/<sim>/studies/ was measured at c5bd0f7, where `stays_up` was the share of the
successes that still stood two double steps later.
"""

import csv
import json
import math
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from test_scripts import FLAGS, check_picture

evaluate = import_module("05_evaluate")
env = evaluate.env
ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "results"
README = (ROOT / "README.md").read_text(encoding="utf-8")
SIMS = ("pymunk", "mujoco")

def shipped(sim, name):
    """A JSON file of ours; `nan` would be an error."""
    text = (RESULTS / sim / name).read_text(encoding="utf-8")
    return json.loads(text, parse_constant=lambda word: pytest.fail(f"{name}: {word}"))

def shipped_trials(sim):
    """The lines of trials.csv by (planner, noise)."""
    runs = {}
    with open(RESULTS / sim / "trials.csv", newline="", encoding="utf-8") as file:
        for line in csv.DictReader(file):
            runs.setdefault((line["planner"], line["noise"] == "yes"), []).append(line)
    return runs


# ------------------------------------------------------------------------ the table
@pytest.mark.parametrize("sim", SIMS)
def test_readme_shows_the_shipped_table(sim):
    shown = README.split(f"<!-- table {sim} -->")[1].split("<!-- end -->")[0].strip()
    table = (RESULTS / sim / "table.md").read_text(encoding="utf-8").strip()
    assert shown == table, f"README's {sim} table is not results/{sim}/table.md: copy it again"
    evaluation = shipped(sim, "evaluation.json")
    made = evaluate.table(evaluation["rows"], evaluation["ratios"]).strip()
    assert table == made, "table.md and evaluation.json are of different runs"

@pytest.mark.parametrize("sim", SIMS)
def test_shipped_numbers_meet_what_we_promise(sim):
    evaluation = shipped(sim, "evaluation.json")
    rows = {(row["planner"], row["noise"]): row for row in evaluation["rows"]}
    for noise, least in ((False, 0.994), (True, 0.990)):
        policy, baseline = rows["policy", noise], rows["baseline", noise]
        assert policy["episodes"] >= 500
        assert policy["success"] >= least
        assert baseline["success"] >= 0.90
    for ratio in evaluation["ratios"]:
        if (ratio["planner"], ratio["reference"]) == ("policy", "baseline"):
            assert ratio["time_ratio"] <= 0.38

@pytest.mark.parametrize("sim", SIMS)
def test_evaluation_is_of_the_shipped_planners(sim):
    evaluation, folder = shipped(sim, "evaluation.json"), RESULTS / sim
    planners = {"policy": folder / "policy.pt", "policy_imu": folder / "imu" / "policy.pt"}
    planners = {name: path for name, path in planners.items() if path.exists()}
    names = {*planners, "baseline", "baseline_tuned"}
    assert {row["planner"] for row in evaluation["rows"]} == names, "not what is shipped"
    assert set(evaluation["planners"]) == {*planners, "baseline_tuned"}
    assert evaluation["policy"] == evaluation["planners"]["policy"]
    for name, path in planners.items():
        _, about = evaluate.load_planner(path, sim)
        about["file"] = path.relative_to(ROOT).as_posix()
        assert evaluation["planners"][name] == about, f"{name} is another file now: evaluate again"
    settings = shipped(sim, "baseline_tuned.json")["settings"]
    assert settings.keys() == vars(evaluate.BaselineSettings()).keys(), "all eight numbers"

@pytest.mark.parametrize("sim", SIMS)
def test_evaluation_agrees_with_its_trials(sim):
    """Everything in evaluation.json is computed again from the single trials."""
    evaluation, runs = shipped(sim, "evaluation.json"), shipped_trials(sim)
    assert len(runs) == len(evaluation["rows"])
    for row in evaluation["rows"]:
        own = runs[row["planner"], row["noise"]]
        assert len(own) == row["episodes"]
        for end in evaluate.OUTCOMES:
            share = sum(t["outcome"] == end for t in own) / len(own)
            assert share == pytest.approx(row[end], abs=5e-5), end
            assert row[f"{end}_ci95"][0] <= share <= row[f"{end}_ci95"][1]
        reached = [t for t in own if t["outcome"] == "success"]
        times = [float(t["time"]) for t in reached]
        assert np.mean(times) == pytest.approx(row["time_mean"], abs=5e-3)
        assert np.std(times) == pytest.approx(row["time_std"], abs=5e-3)
        there = [t["outcome"] for t in own if t["still_there"] == "yes"]
        assert set(there) <= {"success"}, "who did not arrive cannot be still there"
        assert len(there) / len(reached) == pytest.approx(row["still_there"], abs=5e-5)
    for ratio in evaluation["ratios"]:
        one, other = (runs[ratio[name], ratio["noise"]] for name in ("planner", "reference"))
        both = [(float(a["time"]), float(b["time"])) for a, b in zip(one, other)
                if a["outcome"] == b["outcome"] == "success"]
        ours, theirs = np.mean(both, 0)
        assert len(both) == ratio["goals"]
        assert ours / theirs == pytest.approx(ratio["time_ratio"], abs=1e-3)
        assert ratio["time_ratio_ci95"][0] < ours / theirs < ratio["time_ratio_ci95"][1]

@pytest.mark.parametrize("sim", SIMS)
def test_everybody_had_the_goals_of_the_seed(sim):
    evaluation = shipped(sim, "evaluation.json")
    assert evaluation["goals"] == "drawn" and evaluation["sim"] == sim
    rng = env.stream("evaluation", evaluation["seed"])
    goals = env.draw_goals(rng, evaluation["rows"][0]["episodes"])
    for lines in shipped_trials(sim).values():
        assert [int(line["trial"]) for line in lines] == list(range(len(goals)))
        walked = [[float(line[name]) for name in ("x", "y", "yaw")] for line in lines]
        np.testing.assert_allclose(walked, goals, atol=1e-12)

@pytest.mark.parametrize("sim", SIMS)
def test_shipped_policy_fits_and_walks(sim):
    planner, _ = evaluate.load_planner(RESULTS / sim / "policy.pt", sim)
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

def test_every_shipped_policy_fits():
    """Median, seeds, with and without IMU; on the plane none has an IMU."""
    found = sorted(RESULTS.rglob("policy.pt"))
    assert len(found) == 12, "two simulators with three seeds and their median; IMU: 3-D only"
    for path in found:
        sim, *folders, _ = path.relative_to(RESULTS).parts
        planner, about = evaluate.load_planner(path, sim)
        assert planner.imu == ("imu" in folders), path
        assert about["steps"] >= 500_000, f"{path}: shorter than what 04_ppo.py does by itself"


# ------------------------------------------------------------------------ studies
# The one behind README's second table: 2,000 goals, three training seeds.
@pytest.mark.parametrize("sim", SIMS)
def test_three_seeds_beat_the_paper(sim):
    study = shipped(sim, "studies/seeds.json")
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
    folder, study = RESULTS / sim, shipped(sim, "studies/seeds.json")
    noisy = [r for r in study["rows"] if r["seed"] is not None and r["noise"]]
    order = sorted(noisy, key=lambda r: (r["success"], -r["time_mean"]))
    assert order[len(order) // 2]["seed"] == study["median_seed"]
    median = folder / "seeds" / str(study["median_seed"]) / "policy.pt"
    assert (folder / "policy.pt").read_bytes() == median.read_bytes(), "not the best: the median"

def test_the_imu_study_is_complete_and_ships_the_median():
    folder, study = RESULTS / "mujoco", shipped("mujoco", "studies/imu.json")
    assert all(row["episodes"] >= 5000 for row in study["rows"])
    assert len({row["seed"] for row in study["rows"]}) >= 3
    median = folder / "imu" / "seeds" / str(study["median_seed"]) / "policy.pt"
    assert (folder / "imu" / "policy.pt").read_bytes() == median.read_bytes(), "not the best one"
    assert study["means"][1]["time_ratio"] <= 1.005, "safe, but slower: that is easy"

def test_half_way_from_mode_to_mean_is_where_falls_are_rare():
    rows = shipped("mujoco", "studies/decision.json")["rows"]
    falls, times = {}, {}
    for rule in ("mode (paper)", "half-way (ours)", "mean"):
        own = [row for row in rows if row["rule"] == rule]
        assert len(own) == 6, "three seeds each of policy and policy_imu"
        falls[rule] = sum(round(row["fall"] * row["episodes"]) for row in own)
        times[rule] = np.mean([row["time_mean"] for row in own])
    # If the rule made no difference, each fall would be as likely under one rule as the other.
    few, total = falls["half-way (ours)"], falls["half-way (ours)"] + falls["mode (paper)"]
    chance = sum(math.comb(total, k) for k in range(few + 1)) / 2**total
    assert chance <= 0.025, f"{few} of {total} falls: that could be luck ({chance:.3f})"
    assert times["half-way (ours)"] <= 1.04 * times["mode (paper)"] < times["mean"]

@pytest.mark.parametrize("sim", SIMS)
def test_a_short_training_is_enough(sim):
    study = shipped(sim, "studies/budget.json")
    assert study["episodes"] >= 1000 and study["success"] >= 0.98
    assert study["minutes"] <= 6.0, "on two cores"
    assert study["learning_ms"] <= 0.10, "everything but simulation, per double step"

@pytest.mark.parametrize("sim", SIMS)
def test_readme_shows_the_shipped_benchmark(sim):
    benchmark = (RESULTS / sim / "benchmark.txt").read_text(encoding="utf-8").strip()
    assert benchmark in README
    row = next(line.split() for line in benchmark.splitlines() if line.split()[0] == "64")
    assert float(row[3]) >= {"pymunk": 0.50, "mujoco": 0.90}[sim], "too much beside the physics"

def test_readme_shows_the_studies():
    shown = dict(re.findall(r"<!-- study (\S+) -->\n(.*?)<!-- end -->", README, re.DOTALL))
    for name, text in shown.items():
        sim, study = name.split("/")
        path = RESULTS / sim / "studies" / f"{study}.md"
        assert path.exists(), f"README shows {name}, which is not shipped any more"
        table = path.read_text(encoding="utf-8")
        assert text.strip() == table.strip(), f"README's {name} is not results/…/{study}.md"
    studies = {path.stem for path in RESULTS.glob("*/studies/*.md")}
    assert {name.split("/")[1] for name in shown} == studies, "each for one simulator at least"


# ------------------------------------------------------------------------ figures
@pytest.mark.parametrize("path", sorted(RESULTS.rglob("*.png")),
                         ids=lambda path: path.relative_to(RESULTS).as_posix())
def test_shipped_figures_show_something(path):
    check_picture(path)

@pytest.mark.parametrize("sim", SIMS)
def test_shipped_animation_has_more_than_ten_frames(sim):
    with PIL.Image.open(RESULTS / sim / "animation.gif") as film:
        assert film.n_frames > 10

def test_figures_of_readme_are_shipped():
    for path in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", README):
        assert (ROOT / path).is_file(), f"README shows {path}, which is not there"


# ------------------------------------------------------------------------ commands and exercises
def test_commands_of_readme_exist():
    for name, flags in re.findall(r"python (0\d_\w+\.py)([^`\n]*)", README):
        assert name in FLAGS, f"README: there is no {name}"
        for flag in re.findall(r"--[a-z-]+", flags):
            known = {"--mujoco", "--seed", "--out", *FLAGS[name]}
            assert flag in known, f"README names `{name} {flag}`, which does not exist"
    for path in re.findall(r"tests/[\w/]+\.py", README):
        assert (ROOT / path).is_file(), f"README names {path}, which does not exist"

# A process that takes the body of one function after another away; its tests must notice.
EMPTY = """
import sys, json, pytest
from importlib import import_module
root, rows = sys.argv[1], json.loads(sys.argv[2])
sys.path[:0] = [root, root + "/tests/exercises"]
for file, names, tests, keywords in rows:
    module = import_module(file)
    for name in names:
        def empty(*_, **__):
            raise NotImplementedError(name)
        kept = getattr(module, name, None)
        if kept is None:
            continue
        setattr(module, name, empty)
        arguments = [f"{root}/{tests}", "-k", keywords, "-x", "-q", "-p", "no:cacheprovider"]
        print("graded", name, int(pytest.main(arguments)))
        setattr(module, name, kept)
"""

def test_readme_s_exercises_are_graded():
    """Every function to be written exists, and its tests fail as long as it is not written."""
    place = r"(?:stage (0\d)|`tests/exercises/(\w+)\.py`)"
    found = re.findall(rf"^\| (`.*?) in {place}.*\| `(tests/\S+?)(?: -k (.*?))?` \|$", README,
                       re.MULTILINE)
    rows = []
    for text, stage, exercise, tests, keywords in found:
        file = exercise or next(ROOT.glob(f"{stage}_*.py")).stem
        rows.append([file, re.findall(r"`(\w+)`", text), tests, keywords.strip('"')])
    written = [name for _, names, _, _ in rows for name in names]
    assert len(rows) >= 6, f"README's table of exercises: only {written}"
    done = subprocess.run([sys.executable, "-c", EMPTY, str(ROOT), json.dumps(rows)], cwd=ROOT,
                          capture_output=True, text=True, timeout=120)
    grades = dict(re.findall(r"^graded (\w+) (\d)$", done.stdout, re.MULTILINE))
    assert grades == dict.fromkeys(written, "1"), (
        "1: its tests fail when the function is empty, as they should; 0: they do not notice; "
        f"5: `-k` finds no test; missing: there is no such function\n{done.stderr[-800:]}")
