"""The studies' own tools, with answers that are known; the studies themselves take hours."""

import itertools
import json
import math
from argparse import Namespace
from dataclasses import replace
from functools import partial
from importlib import import_module
from types import SimpleNamespace
from unittest import mock

import baseline
import common
import film
import kicks
import ladder
import matplotlib as mpl
import mujoco
import numpy as np
import peers
import PIL.Image
import play
import pytest
import seeds
import walk
from checks import BOTH, close, equal, letters_are_large
from common import env, evaluate, pick, ppo, robot_model, walk_engine
from matplotlib.backend_bases import KeyEvent, MouseEvent
from numpy.random import default_rng
from test_01_robot_model import mujoco_at  # pytest asserts in it, too
from test_05_evaluate import Recorder, middles_of_soles, save_untrained
from test_scripts import python

torch = ppo.torch
ROBOT = robot_model.RobotModel()
LIMITS = env.LIMITS["pymunk"]


@pytest.mark.parametrize("name", common.STUDIES)
def test_every_study_says_its_question_and_then_its_duration(name, capsys, monkeypatch, tmp_path):
    study = import_module(name)
    flag = "--limits" if name == "walk" else "--mujoco"
    assert "?" in study.__doc__.splitlines()[0], "the first line is the question it answers"
    part = next(iter(study.PARTS))
    monkeypatch.setitem(study.PARTS, part, lambda args: {"rows": []})
    for fake in ("table", "plot"):
        monkeypatch.setattr(study, fake, lambda *_: "a table\n", raising=False)
    monkeypatch.setattr(robot_model, "save_figure", lambda figure, path: path.write_text(figure))
    monkeypatch.setattr(common, "CAPTIONS", {name: "what to see"})
    main = getattr(study, "main", partial(common.main, name))
    only = ["--only", part] if part and name != "walk" else []
    main([flag, "--out", str(tmp_path), *only])
    assert capsys.readouterr().out.splitlines()[0].endswith(f": {study.DURATION}")
    endings = {".json", ".md", ".png"} if part else {".json", ".md"}  # no figure of `search`
    assert {path.name for path in tmp_path.iterdir()} == {name + ending for ending in endings}


def test_a_part_is_written_before_the_next_one_and_leaves_the_others(tmp_path):
    parts = {"one": lambda args: {"rows": [1, (2, 3)]}, "two": lambda args: 1 / 0}
    study = SimpleNamespace(__name__="both", PARTS=parts, table=str)
    args = Namespace(sim="pymunk", out=tmp_path)
    path = tmp_path / "both.json"
    path.write_text('{"two": {"rows": []}}')
    common.publish(study, "one", args)
    with pytest.raises(ZeroDivisionError):
        common.publish(study, "two", args)
    found = {"two": {"rows": []}, "one": {"rows": [1, [2, 3]]}}
    assert common.read_json(path) == found
    assert (tmp_path / "both.md").read_text("utf-8") == str(found), "as from the file"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "path",
    sorted(common.RESULTS.glob("*/studies/*.json")),
    ids=lambda path: f"{path.parts[-3]}-{path.stem}",
)
def test_a_figure_of_the_shipped_numbers_has_something_in_every_panel(path):
    study = import_module(path.stem)
    sim = path.parts[-3]
    found = common.read_json(path)
    if hasattr(study, "plot") and path.stem != "walk" and [*study.PARTS][0] in found:
        figure = study.plot(found, sim)
        assert all(axes.lines for axes in figure.axes)
        letters_are_large(figure)
        with mock.patch("time.perf_counter", side_effect=itertools.count(step=2)):  # busy
            robot_model.pixels(figure)  # matplotlib warns where a legend has no place of its own


def test_letters_and_colours_of_the_pictures_that_stages_and_films_draw(monkeypatch):
    """Letters are large enough to read on a page. Nothing is blue or orange but the feet."""
    figures, none = [], {"fall": [False], "timeout": [False], "success": [True]}
    monkeypatch.setattr(robot_model, "save_figure", lambda figure, path: figures.append(figure))
    double_step = evaluate.double_step
    monkeypatch.setattr(evaluate, "double_step", lambda *walk: double_step(*walk) | none)
    with mpl.rc_context(robot_model.STYLE):
        engine, simulator = walk_engine.walkers("pymunk", 1)
        simulator.reset([0])
        plan = engine.plan([walk_engine.WALKS["forward"]], [0])
        walk_engine.plot_plan(engine, plan, simulator.run([0], plan), "")
        tilts = [[0.1, 0.2], [0.1, 1.0]]
        pushes = dict.fromkeys("abc", (tilts, np.array([False, True])))
        walk_engine.plot_push(pushes, engine, "")
        env.plot_rewards({f"r_{k}": np.ones(3) for k in range(8)}, np.ones((2, 15)), "")
        ppo.plot_learning_curve([{"steps": 1, "time": 2.0}], "", "a title")
        world = env.FootstepWorld(1)
        planner = {"a name": evaluate.BaselinePlanner()}
        evaluate.plot_footsteps(world, planner, evaluate.Trials(np.zeros((1, 3)), 0), "")
        figures += [draw("pymunk") for draw in film.PICTURES]
        lines = [line.get_color() for line in figures[2].axes[0].lines]
    for figure in figures:
        letters_are_large(figure)
    red, green, blue = np.transpose([mpl.colors.to_rgb(color) for color in lines])
    foot = (blue > red + 0.2) & (blue > green + 0.2) | (red > green + 0.2) & (green > blue + 0.2)
    assert len({*lines}) == 8 and not foot.any(), f"names are told by colour: {lines}"
    colors = [line.get_color() for line in figures[1].axes[0].lines]
    assert colors == ["0.5", "tab:red"], "who falls is red"


def test_walks_are_those_of_stage_05_set_by_set():
    planner = evaluate.BaselinePlanner()
    short = env.Task(time_limit=2.6)  # [s]
    world = common.world("pymunk", task=short, num_robots=3, **kicks.ground(1.2))
    both = common.walks(planner, world, sets=2, first=5, per_set=3)
    second = evaluate.evaluate(planner, world, evaluate.draw_trials(6, 3))
    assert world.noise and (both["mu"] == 1.2).all(), "friction is what was asked for"
    for name in second:
        equal(both[name][3:], second[name], name)


@pytest.mark.slow
def test_a_film_goes_to_three_goals_and_holds_a_push_and_each_goal(tmp_path, monkeypatch):
    """As if a goal were reached after three double steps. The robot is not drawn: it takes long."""
    goals, pushed, double_step = [], [], evaluate.double_step

    def step(planner, world, robots):
        goals.append(world.goal[0].tolist())
        pushed.append(math.hypot(*world.shove))
        ended = {"success": [len(goals) % 3 == 0], "fall": [len(goals) == 11], "timeout": [False]}
        return double_step(planner, world, robots) | ended

    monkeypatch.setattr(evaluate, "double_step", step)
    monkeypatch.setattr(play, "draw_scene", lambda *_: robot_model.camera_at())
    figure, axes = common.subplots(figsize=(6, 1))
    planner = evaluate.BaselinePlanner()
    pictures = film.walk(axes, planner, "pymunk", film.GOALS, "{}")
    film.save(figure, pictures, tmp_path / "film.gif")
    equal(goals, np.repeat(film.GOALS, 3, axis=0), "one after the other")
    close(pushed, np.eye(9)[5] * math.hypot(*film.PUSH), "once, on the way to the second one")
    seconds = 9 * 2 * 0.31  # nine double steps
    assert axes.get_title().endswith(f"arrived: {seconds:.1f} s"), "no time is lost"
    with PIL.Image.open(tmp_path / "film.gif") as shown:
        frames = PIL.ImageSequence.Iterator(shown)
        lasting = np.array([frame.info["duration"] for frame in frames]) / 1000  # [s]
    held = lasting[lasting > 0.5]
    close(held, [0.08 * film.HELD] * 4, "a push as it begins, three goals", atol=0.09)
    close(lasting.sum(), seconds + 4 * 0.08 * (film.HELD - 0.5), "else in real time", atol=0.4)
    again = [*film.walk(axes, planner, "pymunk", film.GOALS, "{}")]
    assert len(again) == 2 * 8, "a film ends with a fall, here in the second double step"
    first, other = (film.walk(axes, planner, "pymunk", film.GOALS, "{}") for _ in range(2))
    equal(next(first)["motion"].torso, next(other)["motion"].torso, "every film is the same")


@pytest.mark.shipped
def test_the_film_of_a_training_says_how_long_each_policy_has_learned():
    _, panels = common.subplots(1, 3, figsize=(3, 1))
    next(film.training(panels, "mujoco"))
    steps = "1,024", "25,600", "250,880"
    titles = [f"{count} double steps of training\n0.0 s" for count in steps]
    assert [axes.get_title() for axes in panels] == titles


# ------------------------------------------------------------------------ the window to play with
def test_all_robots_can_be_pushed_as_a_double_step_begins():
    robot = replace(robot_model.ROBOT, torso=replace(robot_model.ROBOT.torso, mass=5.0))
    world = play.PushedWorld(2, robot=robot)
    world.reset([0, 1])
    world.simulator.run = run = mock.Mock(wraps=world.simulator.run)
    world.shove = 0.3, -0.2
    world.step(np.full((2, 6), 0.5), [0, 1])
    got = run.call_args.args[2].push
    want = np.zeros_like(got)
    want[:, :5] = 5.0 / 0.05 * np.array([0.3, -0.2])
    close(got, want, "this robot's torso, for five ticks, and no longer")


@BOTH
def test_a_picture_shows_the_chosen_footsteps_and_the_push_before_they_are_done(sim, monkeypatch):
    axes, feet, shown, push = mpl.figure.Figure().subplots(), [], [], [0.1, 0]

    def show(axes, robot, torso, joints, camera):  # to draw takes long
        shown.append((torso[0], joints[0]))

    monkeypatch.setattr(robot_model, "draw_robots", show)
    ahead = [[[0.04, 0.02, 0.2], [0.04, 0.02, -0.1]]]
    planner = mock.Mock(**{"act.return_value": env.to_action(ahead, env.LIMITS[sim])})
    world = play.PushedWorld(1, sim)
    world.reset([0], [default_rng(3)])
    world.simulator.run = run = mock.Mock(wraps=world.simulator.run)
    for _ in range(3):
        pictures = play.pictures(axes, world, planner, feet, push, "")
        yaw = next(pictures)["motion"].torso[0, 0, 5]
        (arrow,) = axes.texts
        for _ in pictures:
            bright = [p for p in axes.patches if p.get_facecolor() == (1, 1, 0, 1)]
            assert len(bright) == 2, "left and right"
    camera = robot_model.camera_at()[1:, :2]
    drawn = np.array([patch.get_xy()[:4].mean(0) for patch in bright])
    landed = middles_of_soles(world) @ camera.T
    # The planar robot's legs cannot spread: its left foot lands nearer to the right one.
    first = int(world.engine.planar)
    close(drawn[first:], landed[first:], "there the foot lands", atol=0.04)
    assert len(feet) == 3, "where the feet stood before each double step"
    for poses in zip(*shown):
        count = len(np.unique(poses, axis=0))
        assert count == len(shown), "in each picture torso and joints are elsewhere"
    _, _, disturbance = run.call_args.args
    assert disturbance.push.any(), "who is pushed in a picture is pushed"
    assert arrow.get_text() == "push: 0.1 m/s" and yaw > 0.4
    want = camera @ robot_model.turned(push, yaw * world.engine.planar)
    hint = "on the plane it is pushed ahead, in 3-D along x"
    close(np.subtract(arrow.xy, arrow.xyann), want, hint)


def test_the_robot_does_what_mouse_and_keys_say(monkeypatch):
    """It falls in the fourth double step, as it is told here. It is not drawn: that takes long."""
    figure, axes = play.plt.subplots()
    world = play.PushedWorld(2)  # the second one stands still
    pictures, pushed, double_step = itertools.count(), [], evaluate.double_step

    def step(planner, world, robots):
        pushed.append(math.hypot(*world.shove))
        return double_step(planner, world, robots) | {"fall": [len(pushed) == 4]}

    def do(kind, name, *what):
        figure.canvas.callbacks.process(name, kind(name, figure.canvas, *what))

    def drag(start, end):
        for name, place in ("press", start), ("release", end):
            pixels = axes.transData.transform(robot_model.camera_at()[1:, :2] @ place)
            do(MouseEvent, f"button_{name}_event", *pixels, 1)

    def told():  # every `yield` is a double step
        drag((0.4, 0.2), (0.4, 0.5))
        goal = world.relative_goal([0])
        close(world.view([0]).goal, goal, "the estimate of the old goal is forgotten")
        close(world.goal[0], [0.4, 0.2, math.pi / 2], "dragged along +y", atol=1e-3)
        assert axes.get_title().startswith("mine\n")
        for key in " x":
            do(KeyEvent, "key_press_event", key)
            yield
        equal(pushed, [0, 0.1, 0], "space: a push")
        drag((-0.2, 0.1), (-0.2, 0.1))
        goal = [-0.2, 0.1, world.pose[0, 2]]
        close(world.goal[0], goal, "a click: as it is turned now", atol=1e-3)
        drag((9.0, 9.0), (9.0, 9.5))
        yield  # it falls
        yield
        assert world.steps[0] == len(planner.goals) == 1, "after a fall it begins anew"
        close(world.goal[0], goal, "to the same goal; off the map is none", atol=1e-3)
        play.plt.close(figure)
        yield

    events, planner = told(), Recorder()
    monkeypatch.setattr(evaluate, "double_step", step)
    monkeypatch.setattr(play, "draw_scene", lambda *_: robot_model.camera_at())
    monkeypatch.setattr(play, "open_window", lambda: (figure, axes))
    # eight pictures for a double step
    monkeypatch.setattr(play.plt, "pause", lambda _: next(pictures) % 8 or next(events))
    play.play(world, "mine", planner, (0.1, 0))
    assert not play.plt.fignum_exists(figure.number), "the story did not come to its end"


def test_a_player_gets_the_world_and_the_planner_of_the_command_line(tmp_path, monkeypatch):
    monkeypatch.setattr(play, "play", window := mock.Mock())
    file = tmp_path / "mine.py"
    file.write_text("class Planner: pass")
    policy = save_untrained(tmp_path / "policy.pt", "mujoco")
    flags = "--mujoco --noise --friction 0.65 --push 0.3".split()
    play.main([*flags, "--policy", str(policy), "--planner", str(file)])
    (world, name, planner, push), _ = window.call_args
    assert name == "mine" and type(planner).__name__ == "Planner"
    world.reset([0])
    equal(world.simulator.variation.friction, 0.65, "the same floor as stage 5")
    assert (world.sim, world.noise) == ("mujoco", True)
    close(push, [0.3, 0], "by hand")
    assert world.push == 0, "and not by chance"


def test_without_a_display_the_window_is_one_line(monkeypatch):
    monkeypatch.setattr(play.plt, "get_backend", lambda: "agg")
    with pytest.raises(robot_model.InputError, match="needs a display"):
        play.open_window()
    play.plt.close("all")


# ------------------------------------------------------------------------ other studies
def test_slow_noise_is_as_large_and_stays():
    robots = np.arange(150)
    world = kicks.SlowNoise(150, "pymunk", noise=True)
    seen = []
    for _ in range(2):
        world.reset(robots, [default_rng([len(seen), i]) for i in robots], np.zeros((150, 3)))
        for _ in range(3):
            seen.append(world.estimate.copy())
            world.covariance[:] = 1e8 * np.eye(3)  # else it would remember
            world.measure(robots)
    close(np.std(seen, (1, 2)), 0.05, "also the first", rtol=0.08)
    alike = np.corrcoef(np.reshape(seen, (6, -1)))[0]
    want = [1, 0.9, 0.81, 0, 0, 0]
    close(alike, want, "0.9 a double step; a new episode, a new one", atol=0.1)


def test_soles_are_where_mujoco_has_them():
    rng = default_rng(5)
    corners = np.array([*itertools.product((-1, 1), (-1, 1), [-1])])
    for torso in rng.uniform([-1, -1, 0.3, -0.5, -0.5, -3], [1, 1, 0.5, 0.5, 0.5, 3], (40, 6)):
        joints = 0.5 * rng.uniform(np.tile(ROBOT.joint_min, 2), np.tile(ROBOT.joint_max, 2))
        model, data = mujoco_at(torso, joints)
        _, lowest = walk.soles(ROBOT, torso, joints)
        for side, height in zip(("left", "right"), lowest):
            sole = data.geom(f"{side} sole")
            placed = sole.xpos + corners * model.geom(sole.id).size @ sole.xmat.reshape(3, 3).T
            close(height, placed[:, 2].min(), "the lowest corner")


def test_blocks_are_as_high_as_drawn_and_flat_where_the_robots_stand():
    world = common.world("mujoco", num_robots=2, **kicks.BLOCKS["blocks up to 10 mm"])
    world.reset([0, 1], [env.stream("training", i) for i in (0, 1)])
    # Rays from 1 m above, downward, beside the robot: heights of the floor
    places = [[x, 0.5, 1] for x in np.arange(-3, 3, 0.05)] + [[0.15, 0.15, 1]]
    down = [0, 0, -1]
    hit = np.zeros(1, np.int32)
    found = []
    for model in world.simulator.models:
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        rays = [mujoco.mj_ray(model, data, place, down, None, 1, 1, hit) for place in places]
        *heights, stands = 1 - np.array(rays)
        close(stands, 0, "where it stands it is flat", atol=1e-6)
        parts = np.quantile(heights, [0, 0.25, 0.75, 1])
        close(parts, [0, 0.0025, 0.0075, 0.01], "evenly from 0 to the highest", atol=0.0015)
        found.append(heights)
    assert np.ptp(found, 0).max() > 0.003, "every robot has a floor of its own"


def test_clearance_is_that_of_the_swinging_foot_and_slip_that_of_the_other():
    """A robot that follows its plan, but 4 mm too high and drifting 1 mm ahead per tick."""
    p = walk_engine.TUNED["mujoco"]
    p = replace(p, step_ticks=30, double_support=1 / 3, foot_rise=0.04)  # 20 of 30 ticks swing
    engine = walk_engine.WalkEngine(1, p)
    plan = engine.plan([[[0.08, 0, 0], [0.08, 0, 0]]], [0])
    torso = plan.trunk[:, 1:].copy()
    torso[..., 0] += 0.001 * np.arange(torso.shape[1])
    torso[..., 2] += 0.004
    joints = robot_model.joints_for_feet(ROBOT, plan.trunk, plan.feet)[:, 1:]
    motion = robot_model.Motion(torso, joints, np.array([False]), [60])
    clearance, slip = walk.clearance_and_slip(engine, motion)
    # At 30 and at 70 % of its swing the foot is up by s(0.6) of its rise, minimum jerk.
    want = 0.04 * (10 * 0.6**3 - 15 * 0.6**4 + 6 * 0.6**5) + 0.004
    close(clearance, want, "the lowest amid a swing")
    close(slip, 0.019, "19 ticks of drift while the other swings")


def test_an_evolution_strategy_learns_along_which_valley_to_go():
    """A valley a hundred times as long as wide, in no axis' direction."""
    rng, seen = default_rng(0), []
    turn = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    optimum = np.full(6, 0.6)

    def costs(generation, drawn):
        if generation == 200:
            return None
        seen.append(drawn)
        return (((drawn - optimum) @ turn * [100, 1, 1, 1, 1, 1]) ** 2).sum(1)

    start, spread = np.full(6, 0.4), np.full(6, 0.1)
    found = common.cma_es(costs, start, spread, 12, rng, np.zeros(6), np.ones(6))
    close(found, optimum, "with its covariance it should come down the valley", atol=1e-3)
    assert np.shape(seen) == (200, 12, 6) and 0 <= np.min(seen) and np.max(seen) <= 1
    first, last = (np.std(drawn @ turn, 0) for drawn in (seen[0], seen[60]))
    assert last[0] / last[1:].mean() < 0.3 * first[0] / first[1:].mean(), "narrow across the valley"


def test_planners_at_once_walk_as_each_of_them_alone():
    tuned = evaluate.TUNED_BASELINE["pymunk"]
    planners = [evaluate.BaselinePlanner(own) for own in (tuned, replace(tuned, forward=0.3))]
    world = common.world("pymunk", num_robots=2)
    both = common.calm_and_pushed(planners, [world], 7)
    for planner, found in zip(planners, both):
        (alone,) = common.calm_and_pushed([planner], [common.world("pymunk", num_robots=2)], 7)
        for name, part in found.items():
            assert part.tolist() == alone[name].tolist(), name
    assert both[0]["time"].tolist() != both[1]["time"].tolist()


def test_a_search_of_the_walk_draws_walks_and_begins_with_the_one_in_use(monkeypatch):
    world, seen = common.world("mujoco", num_robots=1), []
    now = world.engine.parameters

    def walked(world, parameters, seed):
        seen.append(parameters)
        outcome = np.array(["success", "fall", "success", "timeout"], object)
        return {
            "outcome": outcome,
            "time": np.array([3.0, 1, 5, 100]),
            "steps": np.arange(4),
            "still_there": np.ones(4, bool),
        }

    monkeypatch.setattr(walk, "walked", walked)
    close(walk.points(walked(world, now, 0)), 4 + 200 / 4 + 100 / 4, "time of successes, prices")
    monkeypatch.setattr(walk, "BUDGET", 100)
    found, curve = walk.tune(world, 0)
    taken = [row["steps"] for row in curve]
    assert taken == [72, 144], "it ends when so many double steps are taken: 12 candidates, 6 each"
    assert curve[0]["falls"] == 12 and curve[0]["restart"] == 0
    ticks = {parameters.step_ticks for parameters in (*seen, found)}
    assert len(ticks) > 1 and ticks <= {27, 28, 29, 30, 31}, f"the range of SEARCH: {ticks}"
    assert type(found.trunk_swing) is float, "a line for TUNED shows plain numbers"
    close(walk.sway(now, ROBOT), 0.24, "that of predict.md", atol=0.005)
    hint = "the trunk sways as much more or less as the pendulum does"
    for one in seen:
        close(
            one.trunk_swing / now.trunk_swing,
            walk.sway(one, ROBOT) / walk.sway(now, ROBOT),
            hint,
            1e-3,
        )


def test_errors_that_repeat_add_up_in_what_the_filter_expects():
    rng = default_rng(0)
    planned = np.tile([0.1, 0.0, 0.2], (4000, 8, 1))
    own = rng.normal(0, 0.01, (4000, 1, 3))
    new = rng.normal(0, 0.02, (4000, 8, 3))
    poses = [np.zeros((4000, 3))]
    for step in (planned + own + new + [0.003, 0, 0]).swapaxes(0, 1):
        poses.append(robot_model.compose(poses[-1], step))
    mean, drift = walk.off_plan(planned, np.stack(poses, 1))
    close(mean, [0.003, 0, 0], "walked − planned, seen from where the step began", atol=1e-3)
    # Var(Σ of five) / 5 = (25·0.01² + 5·0.02²) / 5
    close(drift, (5 * 0.01**2 + 0.02**2) ** 0.5, "√(Var / 5) of the sum of five", rtol=0.04)


def test_a_fourth_search_begins_where_the_quickest_broke_the_rule(monkeypatch):
    """Here the first setting is the time, and robots that are quicker than in 4.5 s leave the goal."""
    begun, leaves = [], 4.5

    def search(walked, cost, mean, spread, budget, seed):
        begun.append(float(np.exp(mean[0]).round(4)))
        stays = {"fall": 0.0, "timeout": 0.0, "time": 5.0, "still_there": 0.94}
        monkeypatch.setattr(baseline, "facts", lambda ended: stays)
        paid = cost(None) - 5.0
        close(paid, 50 * 0.01 * (seed == 3), "the fourth search asks for 95 %")
        return mean + np.log([1, 0.8, 0.9, 1.3][seed]), [{"restart": seed}]

    def final(world, planner):
        time = planner.settings.forward
        still = 0.94 if time > leaves else 0.92
        calm = dict.fromkeys(("fall", "pushed", "timeout"), 0.0)
        return calm | {"time": time, "still_near": still, "still_far": still}

    monkeypatch.setattr(common, "search", search)
    monkeypatch.setattr(baseline, "final", final)
    settings = dict.fromkeys(list(vars(evaluate.BaselineSettings()))[:8], 5.0)
    found = baseline.searched(Namespace(sim="pymunk"), baseline.tuned_of, settings)
    assert begun == [5.0, 5.0, 5.0, 4.0], (
        "three from the settings in use, one from the quickest end"
    )
    times = common.values(found["finalists"], "time")
    close(times, [5.0, 5.0, 4.0, 4.5, 5.2])
    (chosen,) = common.pick(found["finalists"], chosen=True)
    assert chosen["time"] == 5.0, "4.0 and 4.5 s leave the goal too often"
    begun.clear()
    leaves = 0
    baseline.searched(Namespace(sim="pymunk"), baseline.tuned_of, settings)
    assert len(begun) == 3, "the quickest keeps the rule: no fourth search"


def test_of_the_planners_that_keep_the_rule_the_one_with_the_fewest_points_is_taken():
    row = {"fall": 0.0, "pushed": 0.0, "timeout": 0.0, "still_near": 0.95, "still_far": 0.93}
    rows = [
        row | {"time": 9.1},
        row | {"time": 8.6, "fall": 0.003},
        row | {"time": 8.0, "fall": 0.005, "pushed": 0.02},
        row | {"time": 7.0, "pushed": 0.021},
        row | {"time": 6.0, "still_far": 0.929},
        row | {"time": 6.0, "still_near": 0.929},
        row | {"time": 7.0, "fall": 0.006},
        row | {"time": None, "still_near": None, "still_far": None},
    ]
    _, found = baseline.choose(rows)
    best = common.values(found, "time", chosen=True)
    assert best == [8.0], "8 + 200 · 0.005 points; ≤ 0.5 % falls, ≤ 2 % pushed, stays in ≥ 93 %"
    why, (leaves, *others) = baseline.choose(rows[5:])
    assert leaves["chosen"] and "none" in why, "nobody keeps the rule: then only falls count"
    _, (falls, never) = baseline.choose(others)
    assert falls["chosen"], "it falls too often; the other one never arrives"


def test_a_plan_that_turns_walks_and_turns_again_by_hand():
    world = common.world("pymunk", num_robots=1)
    (ahead, _, out), back = LIMITS.high, -LIMITS.low[0]  # [m], [rad], [m]
    turn = out - LIMITS.low[2]  # [rad] in a double step: a foot outward, the other one inward
    goals = [[3.9 * ahead, 0, 0], [-3.9 * back, 0, 0], [0, 0, 2.5 * turn], [0, 1.9 * ahead, 0]]
    found = seeds.turn_walk_turn(np.array(goals), world) / world.engine.period
    aside = 1 + 2 * math.ceil(math.pi / 2 / turn)
    close(found, [2, 2, 3, aside], "whole double steps, two steps each; behind it: backwards")


# ------------------------------------------------------------------------ seeds, peers
def test_the_ladder_changes_one_thing_a_rung_and_ends_at_this_system():
    settings = ladder.PAPER
    for rung, change in ladder.RUNGS.items():
        assert len(change) == (rung != "the paper's"), f"{rung}: one change"
        settings = settings | change
    ours = common.world("mujoco", num_robots=1)
    own = {name: value for name, value in settings.items() if name != "model"}
    last = common.world("mujoco", num_robots=1, **own)
    assert ppo.fingerprint(last) == common.ppo.fingerprint(ours)
    assert settings["model"] is ppo.ActorCritic
    first = common.world("mujoco", num_robots=1, **{name: ladder.PAPER[name] for name in own})
    first.reset([0])
    first.estimate[:] = 9, 9, 1
    first.step(first.neutral_action[None], [0])
    close(first.estimate, first.relative_goal([0]), "only the last measurement counts", atol=0.3)


def test_a_rung_is_measured_alone_and_its_trainings_are_not_pooled(monkeypatch, tmp_path):
    shared = {"how": "so", "episodes": 4, "time_mean": 3.0, "falls": 1}
    kinds = {"baseline_tuned": [0, 1, 2], "policy 0": [0], "policy 1": []}
    rows = [{"planner": name, "fell": fell, **shared} for name, fell in kinds.items()]
    rows[-1] |= {"time_mean": 4.0, "falls": 0}
    first, other = [*ladder.RUNGS][:2]
    rows = [{"rung": rung, **row} for rung in (first, other) for row in rows]
    old = {"rungs": {"rows": [row | {"old": True} for row in rows]}}
    (tmp_path / "ladder.json").write_text(json.dumps(old))
    measured = lambda sim, k, rung, settings: pick(rows, rung=rung)  # noqa: E731
    monkeypatch.setattr(ladder, "rows_of_rung", measured)
    args = Namespace(sim="mujoco", out=tmp_path, rung=first)
    found = ladder.study_rungs(args)["rows"]
    assert found == pick(rows, rung=first) + pick(old["rungs"]["rows"], rung=other)
    with pytest.raises(robot_model.InputError, match="there are the paper's, "):
        ladder.study_rungs(Namespace(sim="mujoco", out=tmp_path, rung="x"))
    means = pick(ladder.with_means(rows), planner="policies, mean")
    assert [(row["time_mean"], row["falls"]) for row in means] == [(3.5, 0.5)] * 2
    one, two = ladder.falls_there(rows)
    assert (one["only_ours"], one["only_theirs"], one["p"]) == (0, 2, 0.5)
    assert (two["only_ours"], two["only_theirs"], two["p"]) == (0, 3, 0.25)


def test_learners_that_lack_a_part(monkeypatch):
    sizes = len(env.OBSERVATION), len(env.ACTION_NAMES)
    obs = ppo.torch.rand(5, sizes[0])
    model = ladder.NoCritic(*sizes)
    close(model.value(obs).detach(), 0)
    (model.value(obs) - 1).square().mean().backward()  # a training needs it
    shape = ladder.ShapeActor(*sizes, (64, 64), 0.3, 10.0)
    close(shape.policy(obs).base_dist.concentration1.detach(), 1 + 0.3 * 8, atol=0.1)
    close(shape.policy(obs).base_dist.concentration0.detach(), 1 + 0.7 * 8, atol=0.1)
    told = []
    monkeypatch.setattr(ppo, "improve", lambda model, optimizer, data, cfg: told.append(data))
    monkeypatch.setattr(ppo, "judge", lambda model, data, cfg: (data["terminated"].clone(), 0))
    ends = {"terminated": torch.tensor([True, False, False])}
    ladder.cut_off_is_end(
        None, None, ends | {"truncated": torch.tensor([False, True, False])}, None
    )
    assert told[0]["terminated"].tolist() == [True, True, False], "nothing follows a cut-off"
    assert told[0]["advantage"].tolist() == [True, True, False], "it is judged in this way"


def test_falls_of_every_training_are_compared_trial_by_trial(monkeypatch):
    trial = np.arange(400)
    falls = {"expert": trial < 10, 0: trial < 40, 1: (5 <= trial) & (trial < 15)}

    def walks(planner, *_):
        outcome = np.where(falls[planner], "fall", "success")
        ones = np.ones(400)
        return {
            "outcome": outcome,
            "time": ones,
            "steps": ones,
            "still_there": outcome == "success",
        }

    monkeypatch.setattr(common, "walks", walks)
    monkeypatch.setattr(common, "world", lambda *_, **settings: None)  # nobody walks there
    found = seeds.walked("pymunk", {0: 0, 1: 1}, 1, {"expert": "expert"})
    assert len(found["over"]) == 3, "near, far, and far with pushes"
    for row in found["over"]:
        alone = [(test["only_ours"], test["only_theirs"]) for test in row["falls"]]
        assert alone == [(30, 0), (5, 5)] and row["falls"][1]["p"] == 1


def test_an_interval_over_trainings_is_wider_than_one_over_goals():
    """Two trainings, of 0.8 and of 1.0 times the time, on all goals: which of them is shipped?"""
    rng = default_rng(0)

    def walks(time, outcome="success"):
        return {"outcome": np.broadcast_to(outcome, time.shape), "time": time}

    theirs = rng.uniform(3, 9, 400)
    ours = [walks(0.8 * theirs), walks(theirs)]
    found = seeds.over_trainings(ours, walks(theirs))
    close(found["ratio"], 0.9)
    close(found["ratio_ci95"], [0.8, 1.0], "each training alone may have been made", atol=1e-6)
    chance = walks(theirs + rng.normal(0, 1, 400))
    low, high = seeds.over_trainings([chance] * 2, walks(theirs))["ratio_ci95"]
    width = 2 * 1.96 / (theirs.mean() * 400**0.5)
    close(high - low, width, "of one training the goals are left", rtol=0.2)
    fell = walks(np.full(400, 99.0), np.where(theirs < 6, "fall", "success"))
    close(seeds.over_trainings([fell], walks(theirs))["ratio"], 99 / theirs[theirs >= 6].mean())


@pytest.mark.slow
def test_our_vector_environment_is_one_of_stable_baselines3():
    pytest.importorskip("stable_baselines3", reason="only the study `peers` needs it")
    settings = {"noise": True, "task": env.Task(time_limit=3.0, s_fall=5.0)}
    theirs, ours = peers.Footsteps(4, **settings), env.FootstepVectorEnv(4, **settings)
    theirs.seed(7)
    equal(theirs.reset(), ours.reset(seed=7)[0])
    ends = 0
    for action in default_rng(0).uniform(-1, 1, (12, 4, 6)):
        obs, reward, done, told = theirs.step(action)
        want, pay, terminated, truncated, infos = ours.step((action + 1) / 2)
        close([*obs.ravel(), *reward], [*want.ravel(), *pay], atol=1e-6)
        equal(done, terminated | truncated)
        for i in np.flatnonzero(done):
            ends += 1
            equal(told[i]["terminal_observation"], infos["final_obs"][i])
            assert told[i]["TimeLimit.truncated"] == (truncated[i] and not terminated[i])
    assert ends > 4
    model, log = peers.train("pymunk", 0, 1024)
    assert [row["steps"] for row in log] == [1024]
    world = common.world("pymunk", num_robots=2)
    world.reset([0, 1])
    actions = peers.Planner(model).act(world.view([0, 1]))
    assert actions.shape == (2, 6) and (0 <= actions).all() and (actions <= 1).all()


# ------------------------------------------------------------------------ cluster
@pytest.mark.slow
def test_a_training_over_actors_is_that_of_stage_04_bit_for_bit(tmp_path):
    """In a process of its own, since Ray leaves processes behind."""
    pytest.importorskip("ray", reason="only the study `cluster` needs it")
    code = "import cluster, common; cluster.STEPS = 2048; common.main('cluster')"
    studies = str(common.ROOT / "tests" / "studies")
    done = python("-c", code, "--out", ".", cwd=tmp_path, PYTHONPATH=studies)
    assert done.returncode == 0, done.stderr
    rows = common.read_json(tmp_path / "cluster.json")["speed"]["rows"]
    assert [row["equal"] for row in rows] == [True] * 4, "where a robot walks changes nothing"
