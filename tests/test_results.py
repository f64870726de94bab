"""The shipped evidence: complete, of the shipped planners, and what README says of it."""

import csv
import json
import re
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
sys.path.append(str(ROOT / "tests" / "studies"))
book = import_module("book")

def shipped(sim, name):
    """A JSON file of ours; `nan` would be an error."""
    text = (RESULTS / sim / name).read_text(encoding="utf-8")
    return json.loads(text, parse_constant=lambda word: pytest.fail(f"{name}: {word}"))

def key_of(row):
    """Which row: (planner, noise, σ of the goals)."""
    return row["planner"], row["noise"], row["goal_std_m"]

def shipped_trials(sim):
    """The lines of trials.csv by (planner, noise, σ of the goals)."""
    runs = {}
    with open(RESULTS / sim / "trials.csv", newline="", encoding="utf-8") as file:
        for line in csv.DictReader(file):
            key = line["planner"], line["noise"] == "yes", float(line["goal_std_m"])
            runs.setdefault(key, []).append(line)
    return runs

# ------------------------------------------------------------------------ pages
def test_pages_say_what_the_files_say():
    """README's table, results/<sim>/README.md, results/STUDIES.md: no number copied by hand."""
    for path, text in book.pages().items():
        assert path.read_text(encoding="utf-8") == text, (
            f"{path.relative_to(ROOT)} is not of these files: run python tests/studies/book.py")

def test_readme_is_short():
    assert len(README.splitlines()) <= 200, "what is longer belongs to results/ or the exercises"

@pytest.mark.parametrize("sim", SIMS)
def test_table_and_evaluation_are_of_one_run(sim):
    evaluation = shipped(sim, "evaluation.json")
    table = (RESULTS / sim / "table.md").read_text(encoding="utf-8")
    assert table == evaluate.table(evaluation["rows"], evaluation["ratios"])
    assert evaluation["goals"] == evaluation["friction"] == "drawn" and evaluation["sim"] == sim

def test_everything_in_studies_is_of_a_study():
    for path in RESULTS.glob("*/studies/*"):
        assert path.stem in book.ORDER, f"{path.name} has no study any more"

def test_the_planner_of_readme_gets_there(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(re.search(r"```python\n(.*?)```", README, re.DOTALL)[1], encoding="utf-8")
    planner, world = evaluate.OwnPlanner(file), env.FootstepWorld(6, cores=1)
    ended = evaluate.evaluate(planner, world, evaluate.draw_trials(1, 6))
    world.close()
    assert (ended["outcome"] == "success").sum() >= 5, "an example should work"

# ------------------------------------------------------------------------ the table
@pytest.mark.parametrize("sim", SIMS)
def test_shipped_numbers_meet_what_we_promise(sim):
    rows = {key_of(row): row for row in shipped(sim, "evaluation.json")["rows"]}
    for (planner, noise, std), row in rows.items():
        assert row["episodes"] >= 500
        if planner == "policy":
            assert row["success"] >= evaluate.PAPER["policy", False][0], (noise, std)
            paper = rows["baseline", noise, std]
            if sim == "mujoco":  # on the plane, with noise, the baseline stays more often
                assert row["still_there"] >= paper["still_there"] - 0.02, "it leaves, others stay"
            for other in ("baseline", "baseline_tuned"):
                assert row["time_mean"] < rows[other, noise, std]["time_mean"]

@pytest.mark.parametrize("sim", SIMS)
def test_evaluation_is_of_the_shipped_planners(sim):
    evaluation, folder = shipped(sim, "evaluation.json"), RESULTS / sim
    policies = {"policy": folder / "policy.pt", "policy_imu": folder / "imu" / "policy.pt"}
    policies = {name: path for name, path in policies.items() if path.exists()}
    assert {row["planner"] for row in evaluation["rows"]} == {
        *policies, "baseline", "baseline_tuned", "search"}, "not what is shipped"
    assert {row["goal_std_m"] for row in evaluation["rows"]} == {0.5, 1.0}, "--far"
    assert evaluation["policy"] == evaluation["planners"]["policy"]
    for name, path in policies.items():
        *_, about = evaluate.load(path, sim)
        about["file"] = path.relative_to(ROOT).as_posix()
        assert evaluation["planners"][name] == about, f"{name} is another file now: evaluate again"
    for name, file in (("baseline_tuned", "baseline_tuned.json"), ("search", "search.npz")):
        *_, about = evaluate.load(folder / file, sim)
        about["file"] = (folder / file).relative_to(ROOT).as_posix()
        assert evaluation["planners"][name] == about

@pytest.mark.parametrize("sim", SIMS)
def test_evaluation_agrees_with_its_trials(sim):
    """Everything in evaluation.json is computed again from the single trials."""
    evaluation, runs = shipped(sim, "evaluation.json"), shipped_trials(sim)
    assert runs.keys() == {key_of(row) for row in evaluation["rows"]}
    for row in evaluation["rows"]:
        own = runs[key_of(row)]
        assert len(own) == row["episodes"]
        for end in evaluate.OUTCOMES:
            share = sum(t["outcome"] == end for t in own) / len(own)
            assert share == pytest.approx(row[end], abs=5e-5), end
            assert row[f"{end}_ci95"][0] <= share <= row[f"{end}_ci95"][1]
        reached = [t for t in own if t["outcome"] == "success"]
        once = [t for t in own if t["reached_once"] == "yes"]
        assert len(once) / len(own) == pytest.approx(row["reached_once"], abs=5e-5)
        for key, lines in (("time", reached), ("time_once", once)):
            times = [float(t[key]) for t in lines]
            assert np.mean(times) == pytest.approx(row[f"{key}_mean"], abs=5e-3)
            assert np.std(times) == pytest.approx(row[f"{key}_std"], abs=5e-3)
        there = [t["outcome"] for t in own if t["still_there"] == "yes"]
        assert set(there) <= {"success"}, "who did not arrive cannot be still there"
        assert len(there) / len(reached) == pytest.approx(row["still_there"], abs=5e-5)
    for ratio in evaluation["ratios"]:
        block = ratio["noise"], ratio["goal_std_m"]
        one, other = (runs[ratio[name], *block] for name in ("planner", "reference"))
        both = [(float(a["time"]), float(b["time"])) for a, b in zip(one, other)
                if a["outcome"] == b["outcome"] == "success"]
        ours, theirs = np.mean(both, 0)
        assert len(both) == ratio["goals"]
        assert ours / theirs == pytest.approx(ratio["time_ratio"], abs=1e-3)
        assert ratio["time_ratio_ci95"][0] < ours / theirs < ratio["time_ratio_ci95"][1]

@pytest.mark.parametrize("sim", SIMS)
def test_everybody_had_the_same_goals_and_ground(sim):
    evaluation, drawn = shipped(sim, "evaluation.json"), {}
    for (_, _, std), lines in shipped_trials(sim).items():
        goals = evaluate.draw_trials(evaluation["seed"], len(lines), std == 1.0).goals
        walked = [[float(line[name]) for name in ("x", "y", "yaw")] for line in lines]
        np.testing.assert_allclose(walked, goals, atol=1e-12)
        assert [int(line["trial"]) for line in lines] == list(range(len(goals)))
        ground = [line["mu"] for line in lines]
        assert ground == drawn.setdefault("mu", ground), "another floor for another planner"
    mu = np.array(drawn["mu"], float)
    assert 0.4 <= mu.min() < 0.42 and 0.98 < mu.max() <= 1.0

@pytest.mark.parametrize("sim", SIMS)
def test_a_line_of_the_shipped_trials_can_be_repeated(sim, tmp_path):
    """Two walks of the policy: the same end; to the bit only on the machine that made them."""
    lines = shipped_trials(sim)["policy", True, 0.5][:2]
    file = tmp_path / "two.csv"
    with open(file, "w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, lines[0].keys())
        writer.writeheader()
        writer.writerows(lines)
    _, planner, _ = evaluate.load(RESULTS / sim / "policy.pt", sim)
    trials, world = evaluate.read_trials(file, 0, np.nan), env.FootstepWorld(2, sim, cores=1)
    ended = evaluate.evaluate(planner, world, trials, noise=True)
    world.close()
    np.testing.assert_allclose(ended["friction"], [float(line["mu"]) for line in lines])
    assert ended["outcome"].tolist() == [line["outcome"] for line in lines]

@pytest.mark.parametrize("sim", SIMS)
def test_shipped_policy_fits_and_walks(sim):
    _, planner, _ = evaluate.load(RESULTS / sim / "policy.pt", sim)
    trials, world = evaluate.draw_trials(1, 24), env.FootstepWorld(24, sim)
    ended = evaluate.evaluate(planner, world, trials)  # not the trials of the shipped table
    world.close()
    success = np.mean(ended["outcome"] == "success")
    # With a true rate of 0.97, fewer than 20 of 24 happen once in 3000 runs.
    assert success >= 20 / 24, f"the shipped {sim} policy reached only {success:.2f} of new goals"
    assert np.mean(ended["time"]) < 10.0, "a good policy needs about four seconds"

def test_every_shipped_policy_fits():
    for path in RESULTS.rglob("policy.pt"):
        sim, *folders, _ = path.relative_to(RESULTS).parts
        _, planner, about = evaluate.load(path, sim)
        assert planner.imu == ("imu" in folders), path
        assert about["steps"] >= 500_000, f"{path}: too short"

@pytest.mark.parametrize("sim", SIMS)
def test_the_opponents_were_tuned_by_a_rule(sim):
    """The file says by which, and its study shows what else was tried."""
    study, chosen = shipped(sim, "studies/baseline.json"), shipped(sim, "baseline_tuned.json")
    assert chosen["rule"] == study["rule"] and len(study["tried"]) >= 150
    finalist = next(r for r in study["finalists"] if r["settings"] == chosen["settings"])
    assert study["trials"] >= 2000
    safe = [row for row in study["finalists"] if row["fall"] <= 0.005
            and row["still_there"] >= study["paper"]["still_there"] - 0.02]
    stays = [row for row in safe if row.get("quiet", 0) >= 0.97]
    fastest = min(row["time"] for row in stays or safe)
    assert finalist["time"] == fastest, "a faster one was left out"
    assert ("none stays" in study["rule"]) == (not stays)
    assert (RESULTS / sim / "search.npz").stat().st_size <= 500_000

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
    for path in re.findall(r'(?:!\[[^\]]*\]\(|<img src=")([^)"]+)', README):
        assert (ROOT / path).is_file(), f"README shows {path}, which is not there"


# ------------------------------------------------------------------------ commands
def test_commands_of_readme_exist():
    for name, flags in re.findall(r"python (0\d_\w+\.py)([^`\n]*)", README):
        assert name in FLAGS, f"README: there is no {name}"
        for flag in re.findall(r"--[a-z-]+", flags):
            known = {"--mujoco", "--seed", "--out", *FLAGS[name]}
            assert flag in known, f"README names `{name} {flag}`, which does not exist"
    for path in re.findall(r"tests/[\w/]+\.py", README):
        assert (ROOT / path).is_file(), f"README names {path}, which does not exist"


# ------------------------------------------------------------------------ the contest
def test_points_of_the_contest_are_seconds():
    row = {"time_mean": 5.0, "fall": 0.01, "timeout": 0.02, "still_there": 0.8}
    other = row | {"time_mean": 7.0, "fall": 0.03, "timeout": 0.0}
    assert book.judge.points([row, other]) == pytest.approx(
        (5.0 + 2.0 + 2.0 + 7.0 + 6.0) / 2), "200 s per share of falls, 100 s per share of time-outs"
    assert book.judge.points([row, other | {"still_there": 0.6}]) is None, "it runs through"
    assert book.judge.points([row | {"time_mean": None, "still_there": None}]) is None
    row["walks"] = other["walks"] = [("success", "5.0"), ("success", "6.0")]
    lines = book.judge.ranking({"none.py": [row | {"time_mean": None, "still_there": None}] * 2,
                                "slow.py": [other] * 2, "fast.py": [row] * 2}).splitlines()
    assert [re.search(r"`(.*)`", line)[1] for line in lines[2:]] == [
        "fast.py", "slow.py", "none.py"], "the fewest points win"
    assert "disqualified" in lines[-1]

def test_points_of_the_contest_have_an_interval():
    rng, count = np.random.default_rng(0), 400
    ended = rng.choice(["success", "fall"], count, p=(0.95, 0.05))
    time = np.where(ended == "success", rng.normal(7.0, 2.0, count), 3.0)
    reached, fell = time[ended == "success"], ended == "fall"
    # Time and falls are nearly independent: their variances add up. Two equal blocks: half of it.
    variance = (reached.var() / len(reached) + 200**2 * fell.var() / count) / 2
    middle = reached.mean() + 200 * fell.mean()
    rows = [{"walks": list(zip(ended.tolist(), map(str, time)))}] * 2
    np.testing.assert_allclose(
        book.judge.interval(rows), middle + 1.96 * variance**0.5 * np.array([-1, 1]), rtol=0.03,
        err_msg="mean ± 1.96 standard errors, nearly; only successes have a time")

def test_contestants_of_one_name_are_refused(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["judge.py", "ada/mine.py", "bob/mine.py"])
    with pytest.raises(SystemExit) as stop:
        book.judge.main()
    assert stop.value.code == 2 and "name of its own" in capsys.readouterr().err
