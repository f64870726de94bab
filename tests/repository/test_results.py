"""The shipped evidence: complete, of the shipped planners, and rightly told in words."""

import json
import re
from argparse import Namespace
from functools import cache
from itertools import product

import baseline
import common
import numpy as np
import pytest
from checks import BOTH, close, equal
from common import RESULTS, ROOT, env, evaluate
from test_scripts import PAGES

README = (ROOT / "README.md").read_text("utf-8")


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


@pytest.mark.parametrize(
    "page",
    PAGES,
)
def test_links_of_a_page_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)#]+)", (ROOT / page).read_text("utf-8")):
        assert link.startswith("https://") or (ROOT / page).parent.joinpath(link).exists(), link


def test_the_planner_of_readme_gets_there():
    names = {}
    exec(re.search(r"```python\n(.*?)```", README, re.DOTALL)[1], names)
    world = common.world("pymunk", num_robots=6, noise=False)
    ended = common.walks(names["Planner"](), world)
    assert (ended["outcome"] == "success").sum() >= 5, "an example should work"


# ------------------------------------------------------------------------ the table
@BOTH
def test_the_evaluation_has_all_rows_and_meets_its_targets(sim):
    rows = common.pick(shipped(sim, "evaluation.json")["rows"], episodes=500)
    for noise, std in product((False, True), common.STD.values()):
        found = {row["planner"]: row for row in common.pick(rows, noise=noise, goal_std_m=std)}
        assert found.keys() > common.WHAT.keys(), "README shows them"
        policy = found["policy"]
        assert policy["success"] >= 0.980, "the paper's"
        assert policy["still_there"] >= 0.88, "it arrives, and leaves again"
        assert policy["time_mean"] < found["baseline"]["time_mean"]
        assert policy["time_mean"] < found["baseline_tuned"]["time_mean"]


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
        drawn = evaluate.draw_trials(seed, len(own), std == env.Task.far_std_m)
        close(np.column_stack([own[name] for name in ("x", "y", "yaw")]), drawn.goals)
        equal(own["trial"], range(len(own)))
        equal(own["seed"], seed)
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
@BOTH
def test_the_shipped_policy_fits_and_its_page_is_right(sim, capsys):
    common.shipped(sim)
    assert "note" not in capsys.readouterr().out, "it was trained in another world than this one"
    path = RESULTS / sim / "policy.pt"
    used = shipped(sim, "evaluation.json")["policy"]
    assert used == [path.relative_to(ROOT).as_posix()], "another file: evaluate again"
    _, about = common.ppo.load_policy(path)
    words = f"{about['steps']:,} double steps, seed {about['seed']}"
    assert words in " ".join(path.with_name("README.md").read_text("utf-8").split()), words


@pytest.mark.shipped
@BOTH
@pytest.mark.parametrize("part", ["baseline_tuned", "expert"])
def test_the_opponents_were_tuned_in_this_world_with_the_policy_s_budget(sim, part, monkeypatch):
    """By which rule one is chosen: see test_studies."""
    found = shipped(sim, "studies/baseline.json")[part]
    world = common.ppo.fingerprint(common.world(sim, num_robots=1))
    assert found["fits"] == world, "the world has changed: search for its opponents again, too"
    (chosen,) = common.pick(found["rows"], chosen=True)
    monkeypatch.setattr(baseline, "searched", lambda args, planner_of, now: now)
    assert chosen["settings"] == baseline.PARTS[part](Namespace(sim=sim)), "others are in use"
    for restart in range(3):
        *_, taken = common.values(found["curve"], "steps", restart=restart)
        assert taken >= evaluate.ppo.STEPS, "each search takes as many steps as a training"


def test_every_shipped_picture_is_on_a_page():
    pages = " ".join((ROOT / page).read_text("utf-8") for page in PAGES)
    hidden = [path for path in RESULTS.rglob("*.[gp][in][fg]") if f"{path.name})" not in pages]
    assert not hidden, "no page shows these"
