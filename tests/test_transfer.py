"""The study `transfer`: joints whose zeros are wrong, and another robot."""

import json
from argparse import Namespace

import common
import numpy as np
import pytest
import transfer
import walk
from common import evaluate, ppo, walk_engine


@pytest.mark.shipped
def test_rows_become_a_table(monkeypatch):
    ended = {"outcome": np.array(["success"] * 2)}
    ended |= {name: np.ones(2) for name in ("time", "steps", "still_there")}
    monkeypatch.setattr(common, "walks", lambda *_: ended)
    args = Namespace(sim="mujoco", walks=2)
    found = {part: {"rows": study(args)} for part, study in transfer.PARTS.items()}
    assert "OP3" in common.tables(transfer, found)
    rows = [row for part in found.values() for row in part["rows"]]
    assert {(row["success"], row["episodes"]) for row in rows} == {(1, 2)}
    json.dumps(ppo.as_json(found), allow_nan=False)  # of so few walks there is no interval


def test_the_robot_of_a_file_walks_and_a_search_begins_at_its_walk(monkeypatch):
    path = common.ROOT / "tests" / "course" / "starters" / "op3.py"
    args = Namespace(sim="mujoco", robot=path, friction=None)
    world = evaluate.env.FootstepWorld(1, **evaluate.world_settings(args))
    tuned, robot = world.engine.parameters, world.engine.robot
    low, high = world.limits.low, world.limits.high
    plans = np.random.default_rng(0).uniform(low, high, (16, 8, 2, 3))
    _, _, fall = walk_engine.walk_plans("mujoco", tuned, plans, robot=robot)
    assert (fall == 8).mean() > 0.8, "random footsteps within its limits"
    monkeypatch.setattr(common, "cma_es", lambda costs, mean, *more: mean)
    assert walk.tune(world, 0)[0] == tuned
