"""The planner `search`: dynamic programming over double steps. It grades two exercises."""

import itertools
import math
from dataclasses import replace

import common
import numpy as np
import pytest
import search

env, robot_model = common.env, common.robot_model
close, equal = np.testing.assert_allclose, np.testing.assert_array_equal
LIMITS = env.LIMITS["pymunk"]


@pytest.fixture(autouse=True)
def one_process(monkeypatch):
    monkeypatch.setattr(robot_model, "CORES", 1)


HERE = replace(env.Task(), success_m=0.0, success_rad=0.0)  # nothing but the goal itself

LATTICE = ((0, 0, 0), (1, 0, 0), (0, 0, 1), (2, 1, -1))  # stay, go, turn left, a right-hand curve

ODD = np.array(
    [
        (0.13, 0.0, 0.0),
        (-0.07, 0.0, 0.0),
        (0.02, 0.06, 0.0),
        (0.02, -0.06, 0.0),
        (0.06, 0.01, 0.4),
        (0.06, -0.01, -0.4),
    ]
)  # not in whole cells


@pytest.fixture
def small_map(monkeypatch):
    """Maps of another size: (cells on each side, turns around the circle)."""

    def build(half, turns):
        for name, value in ("HALF", half), ("TURNS", turns), ("TURN", 2 * math.pi / turns):
            monkeypatch.setattr(search, name, value)

    return build


def in_metres(moves):
    """Moves in cells and quarter turns as moves in m, m, rad."""
    return np.array(moves) * (search.CELL, search.CELL, math.pi / 2)


def fewest_moves(moves, half):
    """By trying everything: moves [whole cells, whole cells, quarter turns] -> V [4, x, y]."""
    side = range(-half, half + 1)
    value = np.full((4, 2 * half + 1, 2 * half + 1), search.FAR)
    count = {(0, 0j): 0}  # by yaw and x + y·j; a quarter turn is a factor of j
    open_ones, new = set(itertools.product(range(4), side, side)), {(0, 0, 0)}
    while new:
        open_ones -= new
        for k, x, y in new:
            value[k, x + half, y + half] = count[k, x + y * 1j]
        new = {
            (k, x, y)
            for k, x, y in open_ones
            if any(
                ((k + turn) % 4, x + y * 1j + 1j**k * (ahead + aside * 1j)) in count
                for ahead, aside, turn in moves
            )
        }
        count.update(dict.fromkeys(((k, x + y * 1j) for k, x, y in new), max(count.values()) + 1))
    return value


def test_steps_to_go_is_the_fewest_moves(small_map):
    small_map(half=5, turns=4)
    truth = fewest_moves(LATTICE, half=5)
    assert 4 < truth[truth < search.FAR].max() < search.FAR, "this test's brute force is too easy"
    found = search.steps_to_go(in_metres(LATTICE), HERE)
    close(
        found,
        truth,
        atol=0.01,
        err_msg=(
            "V[yaw, x, y] of the robot seen from the goal: are x and y swapped, or the move turned by "
            "−yaw? The map ends at its edge: outside, the goal is out of reach"
        ),
    )


def test_steps_to_go_obeys_its_equation(small_map):
    small_map(half=12, turns=12)
    value = search.steps_to_go(ODD, env.Task())
    k, i, j = np.meshgrid(np.arange(12), np.arange(4, 21), np.arange(4, 21), indexing="ij")
    poses = np.stack([(i - 12) * 0.05, (j - 12) * 0.05, k * math.radians(30)], -1)
    (x, y, yaw), (ahead, aside, turn) = np.moveaxis(poses[..., None, :], -1, 0), ODD.T
    moved = np.stack(
        [
            x + np.cos(yaw) * ahead - np.sin(yaw) * aside,
            y + np.sin(yaw) * ahead + np.cos(yaw) * aside,
            yaw + turn,
        ],
        -1,
    )  # [..., A, 3]
    at_goal = (np.hypot(poses[..., 0], poses[..., 1]) <= 0.05 + 1e-9) & (k == 0)
    after = np.minimum(search.FAR, 1 + search.look_up(value, moved).min(-1))
    after = np.where(at_goal, 0, after)
    assert after.max() < search.FAR, "all of these can reach it: repeat until nothing changes"
    close(
        value[k, i, j],
        after,
        atol=0.02,
        err_msg=(
            "V = 1 + min over moves of V after the move: was it repeated until nothing changed? And "
            "V = 0 at the goal: within 5 cm it has arrived"
        ),
    )


def test_look_up_is_linear_between_cells(small_map):
    small_map(half=3, turns=8)
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-0.15, 0.15, (2, 200)).round(2)  # some on cells, some on the edge
    plane = np.tile(np.arange(7)[:, None] * 2.0 - np.arange(7), (8, 1, 1))
    found = search.look_up(plane, np.stack([x, y, rng.uniform(-9, 9, 200)], -1))
    close(
        found,
        2 * (x / 0.05 + 3) - (y / 0.05 + 3),
        atol=1e-3,
        err_msg=(
            "value[yaw, x, y]: on a cell V is that of the cell; between them it is the mean of the "
            "eight corners by their shares, so a slanted plane stays one"
        ),
    )
    close(
        search.look_up(plane, np.broadcast_to([9.0, -9.0, 1.0], 3)),
        12,
        atol=1e-3,
        err_msg=("Beyond the map V is that of its edge: clip x and y, not the cell only"),
    )
    value = rng.uniform(0, 9, (8, 7, 7))
    middle = search.look_up(value, np.array([0.025, -0.025, math.pi / 8]))
    assert middle == pytest.approx(value[:2, 3:5, 2:4].mean()), "the mean of the eight corners"


def test_look_up_closes_the_circle_of_yaws(small_map):
    small_map(half=1, turns=8)
    value = np.tile(np.arange(8.0)[:, None, None], (1, 3, 3))
    for yaw, expected in (
        (315, 7),
        (337.5, 3.5),
        (-22.5, 3.5),
        (359.9999, 0),
        (360, 0),
        (-90, 6),
        (-45 - 720, 7),
    ):
        found = search.look_up(value, np.array([0, 0, math.radians(yaw)]))
        assert found == pytest.approx(expected, abs=1e-4), f"{yaw}°: after the last yaw, the first"


def test_double_steps_favour_no_side_and_stay_within_the_limits():
    steps = search.double_steps(LIMITS)
    assert not steps[0].any(), "the first one is in place"
    twice = env.to_footsteps(env.to_action(steps, LIMITS), LIMITS)
    close(twice, steps, atol=1e-12, err_msg="all within the limits, so walked as searched")
    left_first, right_first = (
        np.unique(order.reshape(-1, 6).round(9) + 0.0, axis=0) for order in (steps, steps[:, ::-1])
    )
    equal(left_first, right_first, "what one foot can, the other one can")
    sideways = steps[:, 0, 1] - steps[:, 1, 1]  # [A] [m] to the left: both feet
    assert sideways.max() == pytest.approx(LIMITS.high[1] - LIMITS.low[1]), (
        "one foot steps outward, then the other one follows inward"
    )
    assert np.abs(search.double_steps(LIMITS, 0.5)[..., 0]).max() == 0.09, "half of 18 cm"


def test_displacements_are_those_of_a_steady_walk():
    steps = np.array([[[0, 0, 0]] * 2, [[0.05, 0, 0.2], [0.05, 0, -0.2]], [[9, 0, 0]] * 2])
    moves, stood = search.displacements("mujoco", steps)
    assert stood.tolist() == [True, True, False]
    close(
        moves[:2],
        [[0, 0, 0], [0.1, 0.02, 0.4]],
        atol=0.02,
        err_msg=("a double step, seen from where the robot was and looked before"),
    )


STEPS = np.zeros((len(LATTICE), 2, 3))
STEPS[:, 0, 0] = 0.2 * np.arange(4) * (LIMITS.high[0] - LIMITS.low[0]) + LIMITS.low[0]


def lattice_planner(small_map, change, task=HERE):
    """A Planner on LATTICE moves, whose actions differ by 0.2 from one to the next."""
    small_map(half=9, turns=4)
    moves = in_metres(LATTICE)
    return search.Planner((STEPS, moves, search.steps_to_go(moves, task), change))


def view(goal, limits=LIMITS, actions=None):
    """What a planner sees of one robot with this goal [1, 3]."""
    blank = dict.fromkeys(env.View.__dataclass_fields__) | {"goal": goal, "robots": np.array([0])}
    return env.View(**blank | {"limits": limits, "actions": actions})


def decision(planner, pose, last=0):
    """Which move it takes there after that one; pose [3] of the robot seen from the goal."""
    actions = env.to_action(STEPS, LIMITS)
    goal = robot_model.relative(np.array([pose]), np.zeros(3))
    planner.reset(1)
    (action,) = planner.act(view(goal, actions=np.stack([actions[[last]]] * 2, 1)))
    return int(np.abs(actions - action).max(-1).argmin())


def test_search_arrives_after_as_many_steps_as_its_map_says(small_map):
    planner = lattice_planner(small_map, change=1.0)
    truth, moves = fewest_moves(LATTICE, half=9), in_metres(LATTICE)
    for k, x, y in itertools.product(range(4), (-4, -1, 0, 3), (-3, 0, 1, 4)):
        pose, left = in_metres((x, y, k)), round(truth[k, x + 9, y + 9])
        for _ in range(left):
            pose = robot_model.compose(pose, moves[decision(planner, pose)])
        end = [*pose[:2], robot_model.wrap(pose[2])]
        close(end, 0, atol=1e-9, err_msg=f"not there after {left} moves")


@pytest.mark.parametrize(
    "change, x, last, moves, why",
    [
        (1.0, 0.0, 0, [0], "it stays at the goal"),
        (1.0, -0.05, 0, [0], "arrived: one more move ahead wins nothing"),
        (0.25, -0.2, 0, [1], "four cells: best is to go"),
        (0.15, -0.2, 0, [0], "too different: do as before"),
        (0.15, 0.0, 3, [3], "it cannot stop at once"),
        *(
            (1.0, -far, 0, [1, 3], "beyond the map of 0.45 m: on, not on the spot")
            for far in (0.5, 1.0, 9.0)
        ),
    ],
)
def test_search_decides(small_map, change, x, last, moves, why):
    task = env.Task() if x == -0.05 else HERE  # 5 cm are enough
    planner = lattice_planner(small_map, change, task)
    assert decision(planner, (x, 0.0, 0.0), last) in moves, why


def test_search_writes_the_map_that_its_planner_reads_and_refuses_others(tmp_path, monkeypatch):
    steps = search.double_steps(LIMITS, 0.5)
    value = np.tile(np.hypot(*np.mgrid[-12:12:129j, -12:12:129j]), (36, 1, 1))
    known = steps, steps.sum(1) * [1, 1, 0], value, 0.2
    (tmp_path / "pymunk").mkdir()
    search.write_map(tmp_path / "pymunk" / "search.npz", "pymunk", 0.5, known)
    monkeypatch.setattr(common, "RESULTS", tmp_path)
    for wrote, read in zip(known, search.read_map(LIMITS)):
        close(read, wrote, atol=0.026, err_msg="V: in twentieths of a step")
    limits = replace(LIMITS, high=(0.17, 0.15, 0.6))
    with pytest.raises(robot_model.InputError, match="0.17.*search.py makes one") as error:
        search.Planner().act(view(np.zeros((1, 3)), limits))
    assert len(str(error.value).splitlines()) == 1
