"""The studies' own tools, with answers that are known; the studies themselves take hours."""

import itertools
import math
from argparse import Namespace
from dataclasses import replace
from functools import partial
from importlib import import_module
from types import SimpleNamespace

import ablations
import baseline
import common
import kicks
import numpy as np
import pytest
import search
import seeds
import walk
from test_robot import mujoco_at

robot_model, walk_engine = common.robot_model, common.walk_engine
env, ppo, evaluate, torch = common.env, common.ppo, common.evaluate, common.ppo.torch
equal, close = np.testing.assert_array_equal, np.testing.assert_allclose
ROBOT, LIMITS = robot_model.RobotModel(), env.LIMITS["pymunk"]
STUDIES = ("walk", "baseline", "search", "seeds", "kicks", "ablations", "peers", "benchmark")


@pytest.fixture(autouse=True)
def one_process(monkeypatch):
    monkeypatch.setattr(robot_model, "CORES", 1)


@pytest.mark.parametrize("name", STUDIES)
def test_every_study_says_its_question_and_then_its_duration(name, capsys, monkeypatch, tmp_path):
    study, flag = import_module(name), "--limits" if name == "walk" else "--mujoco"
    assert "?" in study.__doc__.splitlines()[0], "the first line is the question it answers"
    assert f"python tests/studies/{name}.py" in study.__doc__
    part, *_ = study.PARTS
    monkeypatch.setitem(study.PARTS, part, lambda args: {"rows": []})
    monkeypatch.setattr(study, "table", lambda found, sim: "a table\n")
    monkeypatch.setattr(study, "plot", lambda found, sim: None, raising=False)
    monkeypatch.setattr(robot_model, "save_figure", lambda figure, path: path.write_text("it"))
    main = getattr(study, "main", partial(common.main, name))
    main([flag, "--out", str(tmp_path), *["--only", part] * (len(study.PARTS) > 1)])
    assert capsys.readouterr().out.splitlines()[0].endswith(f": {study.DURATION}")
    files = {path.name for path in tmp_path.iterdir()}
    assert files == {f"{name}.json", f"{name}.md", f"{name}.png"}


def test_a_part_is_written_before_the_next_one_and_leaves_the_others(tmp_path):
    parts = {"one": lambda args: {"rows": [1, (2, 3)]}, "two": lambda args: 1 / 0}
    study = SimpleNamespace(__name__="both", PARTS=parts, table=lambda found, sim: f"{found}\n")
    (tmp_path / "both.json").write_text('{"two": {"rows": []}}', encoding="utf-8")
    with pytest.raises(ZeroDivisionError):
        for part in parts:
            common.publish(study, part, Namespace(sim="pymunk", out=tmp_path))
    found = common.read_json(tmp_path / "both.json")
    assert found == {"two": {"rows": []}, "one": {"rows": [1, [2, 3]]}}
    assert (tmp_path / "both.md").read_text(encoding="utf-8") == f"{found}\n", "as from the file"


@pytest.mark.parametrize(
    "path",
    sorted(common.RESULTS.glob("*/studies/*.json")),
    ids=lambda path: f"{path.parts[-3]}-{path.stem}",
)
def test_the_shipped_table_is_that_of_the_shipped_numbers(path):
    study, sim, found = import_module(path.stem), path.parts[-3], common.read_json(path)
    assert study.table(found, sim) == path.with_suffix(".md").read_text(encoding="utf-8")
    if hasattr(study, "plot") and path.stem != "walk" and [*study.PARTS][0] in found:
        figure = study.plot(found, sim)
        assert all(axes.lines for axes in figure.axes)
        robot_model.plt.close(figure)


def test_walks_are_those_of_stage_05_set_by_set(monkeypatch):
    monkeypatch.setattr(common, "PER_SET", 3)
    planner, short = evaluate.BaselinePlanner(), replace(env.Task(), time_limit=2.6)  # [s]
    with common.world("pymunk", task=short) as world:
        both = common.walks(planner, world, sets=2, first=5)
        second = evaluate.evaluate(planner, world, evaluate.draw_trials(6, 3))
        tuning = common.walks(planner, world, sets=1, first=5, purpose="tuning", per_set=2)
    assert len(both["time"]) == 6 and len(tuning["time"]) == 2
    for name in second:
        equal(both[name][3:], second[name], err_msg=name)
    assert not np.isclose(tuning["friction"], both["friction"][:2]).any(), "other worlds"
    with common.world("pymunk", num_robots=2, **kicks.ground(1.2)) as world:
        world.reset([0, 1])
        assert world.noise and (world.friction == 1.2).all(), "friction is what was asked for"


def test_a_policy_is_compared_with_its_references(monkeypatch):
    def walks(seconds, *_):  # here a planner is the time of its three walks
        yes = np.full(3, True)
        return {
            "outcome": np.full(3, "success"),
            "time": np.full(3, seconds),
            "time_once": np.full(3, seconds),
            "still_there": yes,
            "reached_once": yes,
        }

    monkeypatch.setattr(common, "walks", walks)
    monkeypatch.setattr(common, "PER_SET", 3)
    rows = seeds.walked("pymunk", {0: 4.0, 1: 1.0}, 1, {"baseline": 8.0})["rows"]
    ratios = [(row["planner"], row["seed"], row.get("over_baseline")) for row in rows]
    near = [("baseline", None, None), ("policy", 0, 0.5), ("policy", 1, 0.125)]
    assert ratios == near + near, "near, then far"
    assert [row["falls"] for row in rows] == [0] * 6


def test_the_median_seed_is_neither_the_best_nor_the_worst():
    rows = [
        {"seed": seed, "success": success, "time_mean": time}
        for seed, success, time in ((0, 1.0, 5.0), (1, 1.0, 6.0), (2, 0.9, None))
    ]
    assert seeds.median_seed(rows) == 1, "by success first; then the slower one is the worse one"


def test_slow_noise_is_as_large_and_stays():
    robots, zero, std = np.arange(400), np.zeros((400, 3)), np.full(3, 0.05)
    world = kicks.SlowNoise(400, "pymunk", noise=True, cores=1)
    world.reset(robots, [np.random.default_rng([0, i]) for i in robots])
    seen = [world._noisy(env.NOISE, zero, robots, std) for world.steps[:] in range(12)]
    world.steps[:] = 0
    anew = world._noisy(env.NOISE, zero, robots, std)
    world.close()
    close(np.std(seen, (1, 2)), 0.05, rtol=0.08, err_msg="also the first")
    for one, other, want in (
        (seen[:-1], seen[1:], 0.9),
        (seen[:-5], seen[5:], 0.9**5),
        (seen[-1], anew, 0),
    ):
        assert np.corrcoef(np.ravel(one), np.ravel(other))[0, 1] == pytest.approx(want, abs=0.1)


def test_pushes_meet_every_planner_with_and_without_the_reflex(monkeypatch):
    met = []
    monkeypatch.setattr(common, "PER_SET", 1)
    monkeypatch.setattr(common, "row_of", lambda ended, name, far: {"planner": name})
    monkeypatch.setattr(
        common,
        "walks",
        lambda planner, world, *_, **more: met.append((world.engine.parameters.reflex, world.push)),
    )
    monkeypatch.setattr(common, "policy", lambda path, sim: path)
    rows = kicks.study_pushes(Namespace(sim="mujoco"))["rows"]
    kinds = [*itertools.product((True, False), kicks.SPEEDS, ("policy", "baseline_tuned"))]
    assert [(row["reflex"], row["speed"], row["planner"]) for row in rows] == kinds
    gain = walk_engine.TUNED["mujoco"].reflex
    assert met == [(gain * reflex, speed) for reflex, speed, _ in kinds], "what the row says"


def test_gaussian_policy_is_a_normal_distribution_around_the_first_action():
    first, obs = np.array([0.2, 0.5, 0.8]), torch.zeros(100, 4)
    torch.manual_seed(0)
    model = ablations.GaussianActor(4, 3, (8, 8), first, 10.0)
    close(model.decide(obs), np.tile(first, (100, 1)), atol=0.02)
    std = (4 * 11) ** -0.5  # of a Beta with mean 0.5, α + β = 10
    action = model.sample(obs)
    assert action.shape == (100, 3) and action.min() < 0, "it may leave [0, 1], unlike the Beta"
    z = (action.numpy() - first) / std  # Σ (−z²/2 − ln(σ·√(2π)))
    log_prob = model.policy(obs).log_prob(action)
    want = (-(z**2) / 2 - np.log(std * np.sqrt(2 * np.pi))).sum(1)
    close(log_prob.detach().numpy(), want, atol=0.1)
    log_prob.sum().backward()  # d/d ln σ = z² − 1: σ is learned, too
    close(model.log_std.grad, (z**2 - 1).sum(0), atol=1.0)
    model.sharpness = 4.0  # p(x)^k ∝ exp(−k·z²/2)
    sharp = model.policy(obs).stddev[0].detach()
    close(sharp, std / 2, rtol=1e-4, err_msg="it must sharpen like the Beta")
    model.actor[-1].bias.data += 0.4
    close(model.decide(obs)[0], [0.6, 0.9, 1.0], atol=0.02, err_msg="clipped")


def test_highest_speed_ignores_everything_beyond_the_first_fall():
    levels, count = walk.LEVELS, len(walk.PATTERN)
    moving = sum(walk.PATTERN) * 0.5  # [s]
    ways = (np.arange(levels) + 1) / levels
    ways[[2, 3]] = ways[[3, 2]]  # level 3 is faster than level 4
    poses = np.full((4 * levels, count + 1, 3), 3.0)  # not from the world's origin
    poses[:, -1] = 9  # and aside
    fall = np.full(4 * levels, count)
    for i, axis in enumerate((0, 0, 1, 2)):  # every walk moves its way
        poses[i * levels : (i + 1) * levels, -1, axis] = 3 + (1, -1, 1, 1)[i] * ways
    forward = walk.highest_speed(poses, fall, period=0.5)["forward"]
    assert forward == pytest.approx(1 / moving), (
        "its way along its axis, from its first pose on, by the time of all double steps that are "
        "not on the spot: sum(PATTERN) · period, not len(PATTERN) · period"
    )
    fall[4::levels] = 2  # level 5 falls
    for direction, speed in walk.highest_speed(poses, fall, period=0.5).items():
        assert speed == pytest.approx(ways[2] / moving), (
            f"{direction}: of eight levels the third is the fastest below the first one that "
            "fell, and not the last one that stood; a way counts to whichever side"
        )


def test_soles_are_where_mujoco_has_them():
    rng = np.random.default_rng(5)
    torso = rng.uniform([-1, -1, 0.3, -0.5, -0.5, -3], [1, 1, 0.5, 0.5, 0.5, 3], (40, 6))
    low, high = (0.5 * np.tile(limit, 2) for limit in (ROBOT.joint_min, ROBOT.joint_max))
    joints = rng.uniform(low, high, (40, 12))
    ankle, lowest = walk.soles(ROBOT, torso, joints)  # [40, 2, 3], [40, 2]
    corners = np.array([*itertools.product((-1, 1), (-1, 1), [-1])])  # of the underside
    for i in range(40):
        model, data = mujoco_at(torso[i], joints[i])
        for foot, side in enumerate(("left", "right")):
            close(ankle[i, foot], data.body(f"{side} foot").xpos, atol=1e-9)
            sole = data.geom(f"{side} sole")
            placed = sole.xpos + corners * model.geom(sole.id).size @ sole.xmat.reshape(3, 3).T
            assert lowest[i, foot] == pytest.approx(placed[:, 2].min(), abs=1e-9), (
                f"{side}: the sole is beside its ankle, outward; its lowest corner counts"
            )


def test_measure_of_robots_that_do_exactly_what_was_made_up(monkeypatch):
    """Robots follow their plan, but 4 mm too high and drifting 1 mm ahead per tick."""
    p = replace(
        walk_engine.TUNED["mujoco"],
        half_ticks=30,
        double_support=1 / 3,
        foot_rise=0.04,
        trunk_roll=0.05,
    )  # the swing: 20 of 30 ticks
    plans, rows, seen = walk.PLANS, 4 * walk.LEVELS, {}

    def fake(sim, parameters, footsteps, body, disturb, watch):
        n, count = footsteps.shape[:2]
        seen["footsteps"], seen["body"] = footsteps, body
        engine = walk_engine.WalkEngine(n, parameters)
        trajectory, _ = engine.plan(footsteps[:, 0], np.arange(n))
        seen["gyro"] = np.empty((n, 0, 2))
        for _ in range(2):  # double steps
            disturb(trajectory, np.arange(n))
            seen["gyro"] = np.concatenate([seen["gyro"], trajectory.gyro_error], 1)
        torso, fell = trajectory.trunk[:, 1:].copy(), np.arange(n) % 3 == 0
        torso[..., 0] += 0.001 * np.arange(torso.shape[1])
        torso[..., 2] += 0.004
        torso[fell, :, 2] = -1  # whoever fell has no clearance
        watch(engine, robot_model.Motion(torso, trajectory.joints[:, 1:], None, fell))
        wanted, fall = np.ones((n, count + 1, 3)), np.full(n, count)
        wanted[:, 0] = 0
        poses = wanted * np.repeat([0.5, 0.6, 0.7, 9], [rows, rows, rows, plans])[:, None, None]
        fall[-plans::2] = count // 2  # every other random walk falls half-way
        return poses, wanted, fall

    monkeypatch.setattr(walk_engine, "walk_plans", fake)
    got, period = walk.measure("mujoco", p, seed=3), 0.6
    assert len(seen["footsteps"]) == 3 * rows + plans
    friction = seen["body"].friction
    equal(friction[: 3 * rows], np.repeat(walk.FRICTION, rows))
    limits, random = env.LIMITS["mujoco"], seen["footsteps"][3 * rows :]
    assert ((random >= limits.low) & (random <= limits.high)).all(), "beyond the limits"
    for found, limit in ((random.min((0, 1)), limits.low), (random.max((0, 1)), limits.high)):
        close(found, [limit] * 2, rtol=0.05, atol=0.005, err_msg="plans use all of the limits")
    assert np.ptp(friction[3 * rows :]) > 0.3, "random walks have the ground that they drew"
    assert np.ptp(seen["body"].mass) > 0.1, "all have drawn bodies"
    gyro = seen["gyro"]  # [n, 120, 2] errors [rad/s]
    assert gyro.mean(1).std() == pytest.approx((0.05**2 / 3 + 0.1**2 / 120) ** 0.5, rel=0.1), (
        "a constant error of each robot, ± 0.05 rad/s"
    )
    assert gyro.std(1).mean() == pytest.approx(0.1, rel=0.03), "noise in every tick [rad/s]"
    moving = sum(walk.PATTERN) * period  # [s]
    for share, speeds, tracking in zip((0.5, 0.6, 0.7), got["speeds"], got["tracking"]):
        for direction in walk.DIRECTIONS:
            assert speeds[direction] == pytest.approx(share / moving), direction
            assert tracking[direction] == pytest.approx(share), f"{direction}: walked ÷ commanded"
    assert got["stood"] == 0.5, "the share of random plans"
    assert got["steps"] == 0.75, "the share of random double steps"
    # At 30 and at 70 % of its swing the foot is up by s(0.6) of its rise, minimum jerk.
    want = 0.04 * (10 * 0.6**3 - 15 * 0.6**4 + 6 * 0.6**5) + 0.004
    close(got["clearance"], want, atol=1e-9, err_msg="the SWING foot's lowest, amid a swing")
    assert got["slip"] == pytest.approx(0.019), "19 ticks of drift while the other foot swings"


def test_tuning_takes_the_best_quarter_and_moves_towards_the_optimum(monkeypatch):
    """Instead of walking, every candidate is scored by its distance to a known optimum."""
    optimum, seen, worlds = np.linspace(0.25, 0.75, len(walk.SEARCH)), [], []
    low, high = np.array(list(walk.SEARCH.values())).T

    def shares(parameters):  # what is searched, as shares [12] of the ranges
        return (np.array([getattr(parameters, key) for key in walk.SEARCH]) - low) / (high - low)

    def measure(sim, parameters, seed):
        seen.append(shares(parameters))
        worlds.append(seed)
        return np.linalg.norm(seen[-1] - optimum)

    monkeypatch.setattr(walk, "measure", measure)
    monkeypatch.setattr(walk, "score", lambda sim, away: -away)
    monkeypatch.setattr(walk, "in_words", str)
    for sim, fixed in (("pymunk", walk.PLANAR_FIXED), ("mujoco", ())):
        seen.clear()
        worlds.clear()
        found = shares(walk.tune(sim, seed=1, iterations=15))
        assert np.min(seen) > -1e-3 and np.max(seen) < 1.001, "outside of its range"
        searched = [name for name, width in zip(walk.SEARCH, np.ptp(seen, 0)) if width > 0]
        assert searched == [name for name in walk.SEARCH if name not in fixed], sim
    close(seen[0], shares(walk_engine.TUNED["mujoco"]), atol=1e-3, err_msg="where the last ended")
    rounds, worlds = np.reshape(seen, (15, 28, -1)), np.reshape(worlds, (15, 28))
    away = np.linalg.norm(rounds - optimum, axis=-1)  # [15, 28]
    best = rounds[0, away[0].argsort()[:7]]
    # The candidates are rounded, half_ticks to one of 15 whole numbers: hence the tolerance.
    error = np.abs(rounds[1, 0] - 0.3 * seen[0] - 0.7 * best.mean(0))
    assert (error < np.where(np.array([*walk.SEARCH]) == "half_ticks", 0.06, 3e-3)).all(), (
        "the new mean: 30 % of the old one, 70 % of the BEST quarter, those of the largest scores"
    )
    # A local search whose spread shrinks quickly: from this far it stops at about 40 %.
    assert np.linalg.norm(found - optimum) < 0.5 * away[0, 0], "further away than half of the way"
    assert (worlds == worlds[:, :1]).all(), "in one round luck must be the same for all"
    assert len(set(worlds[:, 0])) == 15, "other worlds in every round: or it learns one by heart"


def test_the_shipped_share_of_falls_is_that_within_the_limits():
    for sim, limits in env.LIMITS.items():
        found = common.read_json(common.RESULTS / sim / "studies" / "walk.json")["limits"]
        for title, (_, second, _) in walk.MAPS.items():
            inside = walk.allowed(walk.cells(title, walk.X, second), limits)
            falls = np.array(found[title]["falls"])[inside]
            assert falls.mean() == pytest.approx(found[title]["fall_inside"], abs=1e-4), title


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


def test_tuning_chooses_the_fastest_safe_setting_that_stays():
    paper = {"fall": 0.0, "time": 20.0, "still_there": 0.98}
    rows = [
        paper | {"time": 9.0},
        paper | {"time": 8.0, "fall": 0.005},
        paper | {"time": 7.0, "fall": 0.006},
        paper | {"time": 6.0, "still_there": 0.969},
        paper | {"time": None, "still_there": None},
    ]
    best = baseline.choose(rows, paper)[0]
    assert best is rows[1], "fastest of those with at most 0.5 % falls that stay"
    safe, rule = baseline.choose(rows[2:4], paper)
    assert safe is rows[3] and "none" in rule, "none of the safe ones stays: the fastest of them"


def test_tuning_tries_all_settings_of_planners_that_use_them(monkeypatch):
    tried, row = [], {"time": 7.0, "fall": 0.0, "timeout": 0.0, "still_there": 1.0}
    monkeypatch.setattr(baseline, "both", lambda world, values, *_: tried.append(values))
    monkeypatch.setattr(baseline, "facts", lambda ended: row)
    baseline.optimise(None, tuple, baseline.START, row)
    assert tried[0] == baseline.START
    assert all(len(set(values)) > 100 for values in zip(*tried)), "one is not tuned"
    planner = baseline.tuned_of(tried[1])
    assert vars(planner.settings) == dict(zip(baseline.TUNED, tried[1])) | {"share": True}
    world = env.FootstepWorld(1, cores=1)
    world.reset([0], goals=[[1.0, 1.0, 1.0]])
    seen, actions = world.look([0]), []
    world.close()
    for values in (tried[1], tried[2]):
        planner = baseline.expert_of(values)
        planner.reset(1)
        actions.append(planner.act(seen))
    assert (actions[0] != actions[1]).any()


def test_the_least_time_by_hand():
    world = SimpleNamespace(
        task=env.Task(),
        limits=LIMITS,
        engine=SimpleNamespace(period=0.6, beside=np.array([[0, 0.18, 0], [0, -0.18, 0]])),
    )
    # Seen from the other foot, a foot lands 0.18 m ahead, 0.18 + 0.15 m aside, 0.6 rad outward.
    way = 2 * (0.18 * math.cos(0.3) + 0.33 * math.sin(0.3))  # [m] of a double step, toes out
    turn = 0.60 + 0.40  # [rad]
    goals = [
        [0.04, 0, 0],
        [3 * way + 0.04, 0, 0],
        [0, 3 * way + 0.06, 0],
        [0, 0, 2 * turn + 0.17],
        [0, 0, -2 * turn - 0.18],
        [0, -way - 0.06, 2 * turn + 0.18],
    ]
    close(
        seeds.least_time(np.array(goals), world),
        0.6 * np.array([1, 3, 4, 2, 3, 3]),
        err_msg=("to the edge of the tolerance, 5 cm and 10°, in whole double steps; at least one"),
    )


@pytest.mark.parametrize("sim", ["pymunk", "mujoco"])
def test_no_plan_is_faster_than_the_least_time(sim):
    """The walk engine plans every extreme double step eight times in a row, and others at random.
    The goal is where the trunk comes to, and farther on by the tolerance.
    """
    robots, limits = np.arange(512), env.LIMITS[sim]
    engine = env.walk_engine.WalkEngine(512, env.walk_engine.TUNED[sim], planar=sim == "pymunk")
    world = SimpleNamespace(task=env.Task(), limits=limits, engine=engine)
    extreme = np.array([*itertools.product((0.0, 1.0), repeat=6)])  # [64, 6] actions
    chosen = np.random.default_rng(0).integers(64, size=(8, 512))
    chosen[:, :64] = np.arange(64)
    start = engine.trunk[0, [0, 1, 5], 0].copy()
    for steps, row in enumerate(chosen, 1):
        trajectory, _ = engine.plan(env.to_footsteps(extreme[row], limits), robots)
        goals = trajectory.trunk[:, -1, [0, 1, 5]] - start
        goals[:, :2] *= 1 + 0.0499 / np.hypot(*goals.T[:2])[:, None]
        goals[:, 2] += np.copysign(math.radians(9.99), goals[:, 2])
        least = seeds.least_time(goals, world) / engine.period
        assert least.max() <= steps + 1e-9, f"{extreme[row[least.argmax()]]} is faster"
        assert least.max() == pytest.approx(steps), "some walk needs all of these double steps"
