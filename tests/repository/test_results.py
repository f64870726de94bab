"""The shipped evidence: complete, of the shipped planners, and rightly told in words."""

import json
import re
from argparse import Namespace
from functools import cache
from itertools import product

import baseline
import common
import numpy as np
import PIL.Image
import pytest
from checks import BOTH, close, equal
from common import RESULTS, ROOT, env, evaluate
from test_scripts import check_picture

LONGEST = {
    "README.md": 130,
    "results/README.md": 230,  # lines
    "results/pymunk/README.md": 115,
    "results/mujoco/README.md": 115,
    "tests/README.md": 40,
    "tests/course/README.md": 520,
    "tests/course/projects.md": 215,
    "tests/course/teaching.md": 125,
}
TEXTS = {page: (ROOT / page).read_text("utf-8") for page in LONGEST}
README = TEXTS["README.md"]


def shipped(sim, name):
    return common.read_json(RESULTS / sim / name)


@cache
def shipped_trials(sim):
    """The columns of trials.csv by (planner, noise, σ of the goals)."""
    return common.read_trials(RESULTS / sim / "trials.csv")


# ------------------------------------------------------------------------ pages
def test_pages_have_the_tables_of_the_files():
    for path, text in common.pages().items():
        assert path.read_text("utf-8") == text, (
            f"{path.relative_to(ROOT)} has old tables: run python tests/studies/common.py"
        )


@pytest.mark.parametrize("page", LONGEST)
def test_pages_are_short_and_their_links_work(page):
    text = TEXTS[page]
    assert len(text.splitlines()) <= LONGEST[page], "take something away"
    for link in re.findall(r'\]\(([^)#]+)|src="([^"]+)"', text):
        path = "".join(link)
        assert path.startswith("https://") or (ROOT / page).parent.joinpath(path).is_file(), (
            f"{page} leads to {path}, which is not there"
        )


def test_the_planner_of_readme_gets_there(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(re.search(r"```python\n(.*?)```", README, re.DOTALL)[1], "utf-8")
    world = common.world("pymunk", num_robots=6, noise=False)
    ended = common.walks(evaluate.load_planner(file), world)
    assert (ended["outcome"] == "success").sum() >= 5, "an example should work"


# ------------------------------------------------------------------------ the table
@BOTH
def test_the_evaluation_has_all_rows_and_meets_its_targets(sim):
    evaluation = shipped(sim, "evaluation.json")
    rows = {(row["planner"], row["noise"], row["goal_std_m"]): row for row in evaluation["rows"]}
    assert evaluation["friction"] is None and evaluation["sim"] == sim
    names = "policy", "baseline", "baseline_tuned", "search", "expert"
    kinds = [*product((False, True), (0.5, 1.0))]  # noise, σ of the goals [m]
    assert set(rows) == {(name, *kind) for name in names for kind in kinds}
    assert all(row["episodes"] >= 500 for row in rows.values())
    for kind in kinds:
        policy, paper, tuned, *_ = (rows[name, *kind] for name in names)
        assert policy["success"] >= 0.980, f"{kind}: the paper's"
        assert policy["still_there"] >= 0.88, "it arrives, and leaves again"
        assert policy["time_mean"] < min(paper["time_mean"], tuned["time_mean"])


@BOTH
def test_evaluation_agrees_with_its_trials(sim):
    """Everything in evaluation.json is computed again; trials.csv has times with two decimals."""
    found = shipped(sim, "evaluation.json")
    runs = shipped_trials(sim)
    rows = [evaluate.summary(*key, ended) for key, ended in runs.items()]
    again = json.loads(json.dumps(rows + evaluate.compare(runs)))  # tuples become lists
    for old, new in zip(found["rows"] + found["ratios"], again, strict=True):
        assert old.keys() == new.keys()
        for name, value in new.items():
            exact = value is None or isinstance(value, str)
            assert old[name] == (value if exact else pytest.approx(value, rel=1e-9)), name


@BOTH
def test_all_planners_had_the_same_goals_and_ground(sim):
    seed = shipped(sim, "evaluation.json")["seed"]
    runs = shipped_trials(sim)
    for (_, _, std), own in runs.items():
        count = len(own["x"])
        drawn = evaluate.draw_trials(seed, count, std == env.Task.far_std_m)
        goals = np.column_stack([own[name] for name in ("x", "y", "yaw")])
        close(goals, drawn.goals)
        assert own["trial"].tolist() == [*range(count)] and (own["seed"] == seed).all()
        equal(own["mu"], runs["policy", False, 0.5]["mu"])


@pytest.mark.shipped
@BOTH
@pytest.mark.parametrize("noise, far", [*product((False, True), repeat=2)])
def test_lines_of_the_shipped_trials_can_be_repeated(sim, noise, far):
    """The policy's first twenty walks of a block, tick by tick. All are the same on the machine that
    made them. Elsewhere rounding may differ by 1e-16, which grows with every landing of a foot: in
    60 walks of a block at most two ended at another time."""
    seed, std = shipped(sim, "evaluation.json")["seed"], common.STD[far]
    world = common.world(sim, num_robots=20, noise=noise)
    ended = common.walks(common.shipped(sim), world, far, first=seed)
    want = shipped_trials(sim)["policy", noise, std][:20]
    close(ended["mu"], want["mu"])
    same = np.abs(ended["time"] - want["time"]) < 1e-6
    for name in "outcome", "steps", "still_there":
        same &= ended[name] == want[name]
    assert same.sum() >= 18, f"{same.sum()} of 20: walk again, by the command of results/{sim}"


# ------------------------------------------------------------------------ planners, figures


@pytest.mark.shipped
@pytest.mark.parametrize(
    "path", [*RESULTS.rglob("policy.pt")], ids=lambda path: path.relative_to(RESULTS).as_posix()
)
def test_every_shipped_policy_fits_and_its_page_is_right(path, capsys):
    sim, *folders, _ = path.relative_to(RESULTS).parts
    evaluate.policy_planner(path, common.world(sim, num_robots=1))
    assert "note" not in capsys.readouterr().out, "it was trained in another world than this one"
    if not folders:
        (used,) = shipped(sim, "evaluation.json")["policy"]
        assert used == path.relative_to(ROOT).as_posix(), "another file: evaluate again"
    if "seeds" not in folders:
        _, about = common.ppo.load_policy(path)
        words = f"{about['steps']:,} double steps, seed {about['seed']}"
        assert words in " ".join(TEXTS[f"results/{sim}/README.md"].split()), words


@pytest.mark.shipped
@BOTH
@pytest.mark.parametrize("part", ["baseline_tuned", "expert"])
def test_the_opponents_were_tuned_in_this_world_with_the_policy_s_budget(sim, part, monkeypatch):
    """The study says by which rule; test_studies has the rule."""
    found = shipped(sim, "studies/baseline.json")[part]
    world = common.ppo.fingerprint(common.world(sim, num_robots=1))
    assert found["fits"] == world, "the world has changed: search for its opponents again, too"
    (chosen,) = common.pick(found["finalists"], chosen=True)
    monkeypatch.setattr(baseline, "searched", lambda args, planner_of, now: now)
    assert chosen["settings"] == baseline.PARTS[part](Namespace(sim=sim)), "others are in use"
    assert evaluate.TUNED_BASELINE[sim].share
    assert found["trials"] >= 2000
    steps = [common.values(found["curve"], "steps", restart=k)[-1] for k in range(3)]
    assert min(steps) >= evaluate.ppo.STEPS, "each search takes as many steps as a training"
    assert ("none" in found["rule"]) == (not baseline.keeps(chosen))
    assert (RESULTS / sim / "search.npz").stat().st_size <= 500_000


def test_shipped_files_show_something_and_have_a_study_and_a_page():
    pages = " ".join(path.read_text("utf-8") for path in ROOT.rglob("*.md"))
    for path in RESULTS.rglob("*.[gp][in][fg]"):
        assert f"{path.name})" in pages, f"{path}: no page shows it"
    for name, below in re.findall(r"!\[[^]]+\]\((.+?)\)\n *(.?)", pages):
        assert below == "*", f"{name}: below it stands no caption: what is there to see?"
    for path in RESULTS.glob("*/studies/*"):
        study = path.name.split(".")[0]
        assert (ROOT / "tests" / "studies" / f"{study}.py").is_file(), f"{path}: no study"
        assert f"\n## {study}: " in TEXTS["results/README.md"], f"{study}: what was found?"
    for path in RESULTS.rglob("*.png"):
        check_picture(path)
    for path in RESULTS.rglob("*.gif"):
        with PIL.Image.open(path) as film:
            assert film.n_frames > 10, path
