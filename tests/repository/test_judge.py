"""The contest: who wins, who is left out and why, and what a cheat gains (nothing)."""

import os
import re

import judge
import numpy as np
import predict
import pytest
from common import ROOT
from test_scripts import main_of, python


def rows(times, outcome="success", still_there=0.8):
    """Near and far walks with these times [s] and outcomes."""
    row = {"time_mean": None, "fall": 0.0, "timeout": 0.0, "still_there": still_there}
    return [row | {"walks": (np.broadcast_to(outcome, len(times)), times)}] * 2


def test_points_are_those_of_the_rule():
    near, _ = rows([4, 6, 1, 100], ["success", "success", "fall", "timeout"])
    far, _ = rows([8, 8, 8, 8])
    # near: (4 + 6)/2 s, and a quarter of 200 s and of 100 s; far: 8 s
    assert judge.points([near, far]) == (5 + 50 + 25 + 8) / 2
    assert judge.points(rows([1, 1], "timeout")) == 100, "who never arrives has no time"


def test_a_place_is_shared_unless_the_paired_difference_from_its_first_planner_is_clear():
    dice = np.random.default_rng(0)
    first = dice.normal(5, 2, 200)  # [s]
    chance = dice.normal(0, 1, 200)
    found = {
        "leaves": [*rows(first - 1)[1:], *rows(first - 1, still_there=0.69)[1:]],  # the far goals
        "never": rows(first, "fall", None),
        "third": rows(first + 0.24),  # later on every goal
        "second": rows(first + 0.12 + chance - chance.mean()),  # by chance now sooner, now later
        "baseline_tuned": rows(first),
        "equal": rows(first + 0.24),
        "sooner": rows(first - 0.1, still_there=0.7),
    }
    lines = re.findall(r"^\| (\w+) +\| `(\w+)` .* (\S+) +\|$", judge.ranking(found), re.MULTILINE)
    assert [*map(" ".join, lines)] == [
        "1 sooner fewer",
        "2 baseline_tuned —",
        "2 second —",
        "4 third more",
        "4 equal more",
        "disqualified leaves fewer",
        "disqualified never more",
    ], "take the difference in each walk, and from the first planner of a place, not from its last"


CHEAT = """
import gc, sys
class Planner(Planner):
    def reset(self, num_robots):
        super().reset(num_robots)
        frame, things = sys._getframe(), gc.get_objects()
        while frame:
            started = frame.f_locals.get("preparation_data", sys.argv)
            assert "--seed" not in str(started), "the goals can be drawn from it"
            things += frame.f_locals.values()
            frame = frame.f_back
        self.worlds = [thing for thing in things if type(thing).__name__ == "FootstepWorld"]

    def act(self, view):
        for world in self.worlds:
            view.goal[:] = world.relative_goal(view.robots)
        return super().act(view)
"""
CONTEST = {  # by name: what follows the text of expert.py, and what the leaderboard says
    "good": ("import op3  # below the root, as the packages of README's .venv", r"\| `good` "),
    "cheat": (CHEAT, "cheat and expert: equal actions"),  # so it knows no more than `expert`
    "Zo\udceb": ("Planner.act = lambda self, view: 1 + 0 * view.last_action", r"\| `Zo\?` "),
    "bad": ("raise ValueError('of\\n mine')", "bad is left out: ValueError: of mine"),
    "rival": ("from good import Planner", "rival is left out: .*No module named 'good'"),
    "ends": ("__import__('os')._exit(0)", "ends is left out: .* has ended"),
    "hangs": ("while True: pass", "hangs is left out: no answer within 20 s"),
    "shape": ("Planner.act = lambda *_: [[0.5] * 6]", r"shape is left out: .* shape \(2, 6\)"),
}


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="there every name is text")
def test_cheats_win_nothing_and_it_is_told_why_a_planner_is_left_out(tmp_path):
    planner = (ROOT / "tests/studies/expert.py").read_text("utf-8")
    for name, (more, _) in CONTEST.items():
        (tmp_path / f"{name}.py").write_text(planner + more, "utf-8")
    (tmp_path / "ada.txt").touch()
    lab = tmp_path / "lab"
    lab.mkdir()
    (lab / "common.py").touch()  # called like one of ours
    path = f"{lab}{os.pathsep}{ROOT / 'tests/course/starters'}"
    flags = "--episodes 2 --seed 3 --out".split()
    assert python(predict.__file__, "--help", PYTHONPATH=path).returncode == 0
    done = python(judge.__file__, tmp_path, *flags, lab, PYTHONPATH=path)
    assert done.returncode == 0, done.stderr
    assert "raise ValueError('of" in done.stderr, "a student's own error has its traceback"
    board = (lab / "leaderboard.md").read_text("utf-8")
    for said in "ada.txt is left out: .*no such .py", *(said for _, said in CONTEST.values()):
        assert re.search(said, board), f"{said}:\n{board}"
    assert board.count("equal actions") == 3, "of cheat, good and expert; all others differ"


def test_contestants_of_one_name_are_refused(tmp_path, monkeypatch, capsys):
    (tmp_path / "expert.py").touch()
    with pytest.raises(SystemExit, match="2"):
        main_of("judge.py", monkeypatch, tmp_path)
    assert "name of its own" in capsys.readouterr().err
