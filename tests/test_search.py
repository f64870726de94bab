"""The planner `search`: dynamic programming over double steps. It grades two exercises."""

import math
from dataclasses import replace

import common
import numpy as np
import pytest
import search
from checks import close
from test_05_evaluate import view

env, robot_model = common.env, common.robot_model
LIMITS = env.LIMITS["pymunk"]


HERE = env.Task(success_m=0.0, success_rad=0.0)  # nothing but the goal itself

# stay, go, turn left, a right-hand curve: in cells and quarter turns
LATTICE = np.array([(0, 0, 0), (1, 0, 0), (0, 0, 1), (2, 1, -1)])
LATTICE = LATTICE * (search.CELL, search.CELL, math.pi / 2)  # [m, m, rad]

ODD = np.array([  # not in whole cells
    (0.13, 0, 0), (-0.07, 0, 0), (0.02, 0.06, 0), (0.02, -0.06, 0),
    (0.06, 0.01, 0.4), (0.06, -0.01, -0.4),
])  # fmt: skip


@pytest.fixture
def small_map(monkeypatch):
    """Maps of another size: (cells on each side, turns around the circle)."""

    def build(half, turns):
        for name, value in ("HALF", half), ("TURNS", turns), ("TURN", 2 * math.pi / turns):
            monkeypatch.setattr(search, name, value)

    return build


def test_steps_to_go_obeys_its_equation(small_map):
    small_map(half=9, turns=12)
    value = search.steps_to_go(ODD, env.Task())
    k, i, j = np.indices((12, 19, 19))
    poses = np.stack([(i - 9) * 0.05, (j - 9) * 0.05, k * math.radians(30)], -1)
    after = poses[..., None, :] + ODD  # [..., A, 3] so it is for the yaw; x and y are turned:
    after[..., :2] = poses[..., None, :2] + robot_model.turned(ODD[:, :2], poses[..., None, 2])
    left = search.look_up(value, after)  # [..., A]
    left[np.abs(after[..., :2]).max(-1) > 0.45 + 1e-9] = search.FAR
    want = np.minimum(search.FAR, 1 + left.min(-1))
    want[(np.hypot(i - 9, j - 9) <= 1 + 1e-9) & (k == 0)] = 0
    hint = (
        "V = 1 + min over moves of V after the move: was it repeated until nothing changes? And V = "
        "0 at the goal: within 5 cm it has arrived. V[yaw, x, y] of the robot seen from the goal: "
        "are x and y swapped, or the move turned by −yaw? The map ends at its edge: outside, the "
        "goal is out of reach"
    )
    assert (want < search.FAR).mean() > 0.9, hint
    close(value, want, hint, atol=0.02)


def test_look_up_is_linear_between_cells(small_map):
    small_map(half=3, turns=8)
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-0.15, 0.15, (2, 200)).round(2)  # some on cells, some on the edge
    plane = np.tile(np.arange(7)[:, None] * 2.0 - np.arange(7), (8, 1, 1))
    found = search.look_up(plane, np.stack([x, y, rng.uniform(-9, 9, 200)], -1))
    close(
        found,
        2 * (x / 0.05 + 3) - (y / 0.05 + 3),
        "value[yaw, x, y]: on a cell V is that of the cell; between them it is the mean of the "
        "eight corners by their shares, so a slanted plane stays one",
        atol=1e-3,
    )
    close(
        search.look_up(plane, np.broadcast_to([9.0, -9.0, 1.0], 3)),
        12,
        "Beyond the map V is that of its edge: clip x and y, not the cell only",
        atol=1e-3,
    )
    value = rng.uniform(0, 9, (8, 7, 7))
    middle = search.look_up(value, np.array([0.025, -0.025, math.pi / 8]))
    close(middle, value[:2, 3:5, 2:4].mean(), "the mean of the eight corners")


def test_look_up_closes_the_circle_of_yaws(small_map):
    small_map(half=1, turns=8)
    value = np.tile(np.arange(8.0)[:, None, None], (1, 3, 3))
    want = {315: 7, 337.5: 3.5, -22.5: 3.5, 359.9999: 0, 360: 0, -90: 6, -45 - 720: 7}
    for yaw, expected in want.items():
        found = search.look_up(value, np.array([0, 0, math.radians(yaw)]))
        close(found, expected, f"{yaw}°: after the last yaw, the first", atol=1e-4)


@pytest.mark.parametrize("change, x, last, moves, why", [
    (1.0, 0.0, 0, [0], "it stays at the goal"),
    (0.25, -0.2, 0, [1], "four cells: best is to go"),
    (0.15, -0.2, 0, [0], "too different: do as before"),
    (0.15, 0.0, 3, [3], "it cannot stop at once"),
    (1.0, -0.5, 0, [1, 3], "beyond the map of 0.45 m: on, not on the spot"),
])  # fmt: skip
def test_search_decides(small_map, change, x, last, moves, why):
    """The robot stands at x, seen from the goal, and has just taken this move of LATTICE."""
    small_map(half=9, turns=4)
    actions = np.zeros((4, 6))
    actions[:, 0] = 0.2 * np.arange(4)  # they differ by 0.2 from one to the next
    steps = env.to_footsteps(actions, LIMITS)
    planner = search.Planner((steps, LATTICE, search.steps_to_go(LATTICE, HERE), change))
    (action,) = planner.act(view([[-x, 0, 0]], last_action=actions[[last]]))
    assert np.abs(actions - action).max(-1).argmin() in moves, why


def test_search_writes_the_map_that_its_planner_reads_and_refuses_others(tmp_path, monkeypatch):
    steps = search.double_steps(LIMITS, 0.5)
    value = np.random.default_rng(0).uniform(0, 25, (36, 129, 129))
    known = steps, steps[:, 0], value, 0.2
    (tmp_path / "pymunk").mkdir()
    search.write_map(tmp_path / "pymunk" / "search.npz", "pymunk", 0.5, known)
    monkeypatch.setattr(common, "RESULTS", tmp_path)
    for wrote, read in zip(known, search.read_map(LIMITS)):
        close(read, wrote, "V: in twentieths of a step", atol=0.026)
    with pytest.raises(robot_model.InputError, match="0.17.*search.py makes one"):
        search.read_map(replace(LIMITS, high=(0.17, 0.15, 0.6)))
