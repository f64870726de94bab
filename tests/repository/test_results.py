"""The shipped evidence: complete, of the shipped planners, and rightly told in words."""

import json
import os
import re
import sys
import time
from argparse import Namespace
from contextlib import closing
from functools import cache
from itertools import product
from types import SimpleNamespace

import baseline
import common
import judge
import numpy as np
import pytest
from checks import BOTH, close, equal
from common import RESULTS, ROOT, env, evaluate, robot_model
from test_scripts import PAGES, main_of, python

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
        assert found.keys() == common.WHAT.keys()
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
    """The study says by which rule; test_studies has the rule."""
    found = shipped(sim, "studies/baseline.json")[part]
    world = common.ppo.fingerprint(common.world(sim, num_robots=1))
    assert found["fits"] == world, "the world has changed: search for its opponents again, too"
    (chosen,) = common.pick(found["finalists"], chosen=True)
    monkeypatch.setattr(baseline, "searched", lambda args, planner_of, now: now)
    assert chosen["settings"] == baseline.PARTS[part](Namespace(sim=sim)), "others are in use"
    assert ("none" in found["rule"]) == (not baseline.keeps(chosen))
    for restart in range(3):
        *_, taken = common.values(found["curve"], "steps", restart=restart)
        assert taken >= evaluate.ppo.STEPS, "each search takes as many steps as a training"


def test_every_shipped_picture_is_on_a_page():
    pages = " ".join((ROOT / page).read_text("utf-8") for page in PAGES)
    hidden = [path for path in RESULTS.rglob("*.[gp][in][fg]") if f"{path.name})" not in pages]
    assert not hidden, "no page shows these"


# ------------------------------------------------------------------------ the contest
ROW = {
    "time_mean": 5.0,
    "time_median": 5.0,
    "fall": 0.01,
    "timeout": 0.02,
    "still_there": 0.8,
    "walks": [["success", "success"], [5.0, 6.0]],
}


def test_who_never_arrives_is_disqualified():
    """All else about points is compared with the shipped ranking in test_ledger."""
    never = ROW | {"time_mean": None, "still_there": None}
    head, _, best, last = judge.ranking({"never": [never] * 2, "good": [ROW] * 2}).splitlines()
    assert "good" in best and "disqualified" in last
    assert "pushed" not in head, "nobody has walked with pushes: leave this column out"
    assert "| falls when pushed |" in judge.ranking({"pushed": [ROW] * 3})


def test_a_place_is_shared_unless_the_paired_difference_from_its_first_planner_is_clear(
    monkeypatch,
):
    dice = np.random.default_rng(0)
    first = dice.normal(5, 2, 200)
    chance = dice.normal(0, 1, 200)
    seconds = {
        "first": first,
        "second": first + 0.12 + chance - chance.mean(),  # by chance now sooner, now later
        "third": first + 0.24,  # later on every goal
        "equal": first + 0.24,
        "leaves": first - 1,
    }
    found = {
        name: [ROW | {"walks": [["success"] * 200, times]}] * 2 for name, times in seconds.items()
    }
    found["leaves"][1] = found["leaves"][1] | {"still_there": 0.6}  # only the far goals
    field = judge.ranked(found)
    places = {name: place for place, name, *_ in field}
    assert places == {"first": 1, "second": 1, "third": 3, "equal": 3, "leaves": judge.OUT}, (
        "the planners walk to the same goals: choose the same walks of both, and take the difference "
        "from the first planner of a place, not from its last"
    )
    ends = {name: interval for _, name, _, interval in field}
    assert ends["first"][1] > ends["third"][0] + 0.2, (
        "a comparison without pairs shows no difference"
    )
    figures = []
    monkeypatch.setattr(robot_model, "save_figure", lambda figure, path: figures.append(figure))
    judge.plot(found, "leaderboard.png")
    labels = [label.get_text() for label in figures[0].axes[0].get_yticklabels()]
    assert labels[-1] == "first: 1" and "third: 3" in labels, "the best on top, with its place"


def test_a_contest_tells_its_time_and_goes_on_where_it_was_stopped(tmp_path, monkeypatch, capsys):
    ada, bob, stage = (tmp_path / name for name in ("ada.py", "bob.py", "03_env.py"))
    out = tmp_path / "out"
    walked = []
    stopped = ["bob"]

    def walk(name, *_):
        if name in stopped:
            raise KeyboardInterrupt
        walked.append(name)
        return [ROW] * 3

    def contest(*flags):
        walked.clear()
        main_of("judge.py", monkeypatch, ada, bob, "--out", out, *flags)
        return [*walked]

    monkeypatch.setattr(judge, "walk", walk)
    monkeypatch.setattr(judge, "plot", lambda *_: None)
    monkeypatch.setattr(judge, "ROOT", tmp_path)  # where the stages are
    clock = SimpleNamespace(monotonic=lambda: 240 * len(walked))
    monkeypatch.setattr(judge, "time", clock)
    for file in ada, bob, stage:
        file.write_text(file.name)
    with pytest.raises(KeyboardInterrupt):
        contest()
    said = capsys.readouterr().out
    assert "ada walks (planner 3 of 4; each takes 4.0 minutes)" in said, "say how long it will take"
    stopped.clear()
    assert contest() == ["bob"], "who has walked before the contest was stopped need not walk again"
    assert "ada has walked before (planner 3 of 4)" in capsys.readouterr().out
    everybody = [*judge.FIELD, "ada", "bob"]
    ada.write_text("better")
    assert contest() == ["ada"], "a file that has changed walks again, the others do not"
    assert contest("--seed", 7) == contest("--episodes", 400) == everybody, "to other goals"
    stage.write_text("another world")
    assert contest() == everybody, "in another world what was kept is worth nothing"
    assert contest() == []
    (out / "walks.json").write_text('{"half of a')
    with pytest.raises(robot_model.InputError, match=r"walks\.json: damaged .* delete it"):
        contest()


def test_contestants_of_one_name_are_refused(tmp_path, monkeypatch, capsys):
    for name in ("ada", "bob"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "mine.py").touch()
    with pytest.raises(SystemExit, match="2"):
        main_of("judge.py", monkeypatch, tmp_path / "ada", tmp_path / "bob")
    assert "name of its own" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform != "linux", reason="such names are not allowed there")
def test_odd_names_do_not_end_the_contest(tmp_path, monkeypatch, capsys):
    for name in (b"ada", b"Zo\xeb", b"a$^$", b"b|c\n"):
        (tmp_path / f"{os.fsdecode(name)}.py").touch()
    (tmp_path / "folder.py").mkdir()
    monkeypatch.setattr(judge, "walk", lambda *_: [ROW] * 3)
    board = tmp_path / "out" / "leaderboard.md"
    main_of("judge.py", monkeypatch, tmp_path, "--out", board.parent)
    said = capsys.readouterr()
    names = re.findall(r"^\| 1 +\| `(.*?)` +\| ", said.out, re.MULTILINE)  # all are equal
    assert {*names} == {*judge.FIELD, "ada", "Zo?", "a?^?", "b?c?"}
    assert board.is_file() and "folder is left out: " in said.err


# Each of these files first defines README's honest planner; the world is not where they look.
CHEATS = {
    "frame": """
import sys
class Planner(Planner):
    def act(self, view):
        frame = sys._getframe()
        while frame:
            world = frame.f_locals.get("world")
            if hasattr(world, "relative_goal"):
                view.goal[:] = world.relative_goal(view.robots)
            frame = frame.f_back
        return super().act(view)
""",
    "step": """
from importlib import import_module
World, np = import_module("03_env").FootstepWorld, np
true_step = World.step
def step(self, actions, robots, disturb=None):
    every = np.ones(len(robots), bool)
    return true_step(self, actions, robots) | {"success": every, "inside": every}
World.step = step
""",
    "reset": """
from importlib import import_module
World = import_module("03_env").FootstepWorld
World.set_goal = lambda self, robots, goals: None
""",
    "seed": """
import sys
assert "--seed" not in sys.argv, "the goals can be drawn from it"
""",
    "files": """
import json, os, pathlib
class Planner(Planner):
    def act(self, view):
        for path in pathlib.Path().glob("*"):
            path.write_text(json.dumps([{"time_mean": 0.1}]))
        os._exit(0)
""",
    "rival": "from good import Planner",
    "hangs": """
class Planner(Planner):
    def act(self, view):
        while True:
            pass
""",
    "bad": "raise ValueError('of mine')",
}


@pytest.mark.slow
def test_cheats_win_nothing_and_the_others_are_ranked(tmp_path):
    planner = re.search(r"```python\n(.*?)```", README, re.DOTALL)[1]
    for name, more in {"good": "", **CHEATS}.items():
        (tmp_path / f"{name}.py").write_text(planner + more, "utf-8")
    flags = "--episodes 2 --seed 3 --patience 4 --out".split()
    done = python(judge.__file__, tmp_path, *flags, tmp_path)
    assert done.returncode == 0, done.stderr
    assert "of mine" in done.stderr, "a student's own error has its traceback"
    left = set(re.findall(r"^(\w+) is left out: ", done.stderr, re.MULTILINE))
    assert left == {"files", "rival", "hangs", "bad"}
    board = (tmp_path / "leaderboard.md").read_text("utf-8")
    found = re.findall(r"^\| (\w+) +\| `(\w+)` +(.*)", board, re.MULTILINE)
    lines = {name: (place, numbers) for place, name, numbers in found}
    assert lines.keys() == {"good", "frame", "step", "reset", "seed", *judge.FIELD}
    for name in ("frame", "step", "reset", "seed"):
        assert lines[name] == lines["good"], f"{name} is better than what it does honestly"
    assert (tmp_path / "leaderboard.png").stat().st_size > 5000


MISTAKEN = """
import subprocess, sys
import numpy as np

print("of mine", flush=True)

class Planner:
    def reset(self, num_robots):
        subprocess.Popen([sys.executable, "-c", {ticks!r}])

    def act(self, view):
        return {action}
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="it has no groups of processes")
@pytest.mark.parametrize("action, error", [
    ("np.zeros((6, 4))", "actions must be finite numbers of shape (4, 6)"), ("input()", "EOFError"),
])  # fmt: skip
def test_a_contestant_s_error_is_shown_and_its_processes_end(tmp_path, capfd, action, error):
    file = tmp_path / "mine.py"
    clock = tmp_path / "clock"
    ticks = f"import time\nwhile 1: open({str(clock)!r}, 'a').write('.'); time.sleep(0.02)"
    file.write_text(MISTAKEN.format(ticks=ticks, action=action), "utf-8")
    world = common.world("mujoco", num_robots=4)
    world.reset(range(4), [env.stream("training", k) for k in range(4)])
    with closing(judge.Contestant(file, 30)) as planner:
        planner.reset(4)
        time.sleep(1)
        with pytest.raises(judge.LeftOut, match="its program has ended"):
            planner.act(world.view(range(4)))
    out, said = capfd.readouterr()
    assert error in said and "of mine" in said, "a student wants to know what was wrong"
    assert not out, "who holds the judge's output keeps `judge.py | tee log` alive"
    before = clock.stat().st_size
    time.sleep(1)
    assert clock.stat().st_size == before, "it computes on, beside the next planners"
