"""Tests with the mark `shipped` hold files of results/ against today's code. Whoever has changed the
robot, the walk or the task has another world than these files, and needs no red line for it: there
such tests are skipped. Where the variable CI is set, as in `.ci/run`, they fail instead."""

import os
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

RESULTS = Path(__file__).resolve().parents[1] / "results"


@cache
def outdated():
    """Which folders of results/ are of another world than today's, and what differs there, as text."""
    env, ppo = import_module("03_env"), import_module("04_ppo")
    found = []
    for path in sorted(RESULTS.glob("*/policy.pt")):
        here = ppo.fingerprint(env.FootstepWorld(1, path.parent.name))
        fits = ppo.torch.load(path, weights_only=True)["fits"]
        if other := [name for name in here if fits.get(name) != here[name]]:
            found.append(f"results/{path.parent.name} (another {', '.join(other)})")
    return " and ".join(found)


@pytest.fixture
def shown(monkeypatch):
    """The figures that would be written to files, one after the other."""
    figures, robot_model = [], import_module("01_robot_model")
    monkeypatch.setattr(robot_model, "save_figure", lambda figure, path: figures.append(figure))
    return figures


def pytest_runtest_setup(item):
    if item.get_closest_marker("shipped") and outdated():
        said = f"shipped files of another world: {outdated()}; see tests/README.md"
        if "CI" in os.environ:
            pytest.fail(said, pytrace=False)
        pytest.skip(said)
