"""Stage 5: the baseline's equations, the statistics, and the command line from end to end."""

import csv
import json
import math
import os
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import torch

evaluate = import_module("05_evaluate")
env, ppo = evaluate.env, evaluate.ppo
SCRIPT = Path(evaluate.__file__)
B = evaluate.BaselineSettings()


# ---------------------------------------------------------------- the baseline's equations
def command(x, y, yaw=0.0, settings=B):
    return evaluate.velocity_command(np.array([[x, y, yaw]]), settings)[0]


@pytest.mark.parametrize("x, y, expected", [(5, 0, (0.12, 0)), (-5, 0, (-0.06, 0)),
                                            (0, 5, (0, 0.07)), (0, -5, (0, -0.07))])
def test_speed_limit_on_each_axis(x, y, expected):
    np.testing.assert_allclose(command(x, y)[:2], expected, atol=1e-12, err_msg=(
        "forward 0.12, backward 0.06, sideways 0.07 m/s: is backward taken for forward?"))


def test_far_goals_are_approached_on_the_edge_of_the_diamond():
    for beta in np.linspace(-np.pi, np.pi, 50):
        v_x, v_y, _ = command(3 * math.cos(beta), 3 * math.sin(beta))
        edge = abs(v_x) / (0.12 if v_x > 0 else 0.06) + abs(v_y) / 0.07
        assert edge == pytest.approx(1), "between the axes the limit is linear, not an ellipse"
        assert math.atan2(v_y, v_x) == pytest.approx(beta), "limiting must not change direction"


def test_near_the_goal_speed_is_gain_times_distance():
    np.testing.assert_allclose(command(0.03, -0.02), (0.03, -0.02, 0), atol=1e-12, err_msg=(
        "v = min(gain·d, v_max): inside the limits the gain decides"))
    assert not command(0, 0).any(), "at the goal there is nothing to do"


def test_far_away_it_faces_the_goal_and_nearby_it_turns_like_the_goal():
    assert command(0, 1.01, 0.2)[2] == pytest.approx(0.3), "far: 0.3·β = 0.47 rad/s, limited to 0.3"
    assert command(1.01, 0, 0.5)[2] == pytest.approx(0), "far: the goal is straight ahead"
    assert command(1.01, -0.1, 0.5)[2] == pytest.approx(-0.3 * math.atan2(0.1, 1.01))
    assert command(0, 0.99, 0.5)[2] == pytest.approx(0.15), "near: turn to α = 0.5 rad, gain 0.3"
    assert command(0.1, 0, 3)[2] == pytest.approx(0.3), "near: limited to 0.3 rad/s"
    assert command(0.1, 0, -3)[2] == pytest.approx(-0.3), "the limit holds to both sides"
    # the shortest way round: a goal turned by 350° is reached by −10°
    assert command(0.1, 0, math.radians(350))[2] == pytest.approx(0.3 * math.radians(-10))


def test_the_filter_is_the_limit_of_small_steps():
    start, target, seconds, tau = 0.02, 0.12, 0.6, 1.0
    exact = evaluate.low_pass(start, target, seconds, tau)
    previous = np.inf
    for rate in (20, 200, 2000):  # [Hz] Euler steps of dv/dt = (v_cmd − v) / τ
        v = start
        for _ in range(round(seconds * rate)):
            v += (target - v) / tau / rate
        error = abs(v - exact)
        assert error < 0.2 * previous, "v ← v + (1 − exp(−t/τ))·(v_cmd − v): is the sign right?"
        previous = error
    assert error < 1e-4
    twice = evaluate.low_pass(evaluate.low_pass(start, target, 0.3, tau), target, 0.3, tau)
    assert twice == pytest.approx(exact), "two halves of a step must equal one whole step"


def test_velocities_become_mirrored_footsteps():
    def steps(*velocity):
        return evaluate.velocity_to_footsteps(np.array([velocity]), period=0.5)[0]

    hint = "outward is positive for both feet: y and yaw of the right foot are mirrored"
    np.testing.assert_allclose(steps(0.12, 0, 0), [[0.03, 0, 0], [0.03, 0, 0]])
    np.testing.assert_allclose(steps(0, 0.06, 0), [[0, 0.03, 0], [0, 0, 0]], err_msg=hint)
    np.testing.assert_allclose(steps(0, -0.06, 0), [[0, 0, 0], [0, 0.03, 0]], err_msg=hint)
    np.testing.assert_allclose(steps(0, 0, 0.2), [[0, 0, 0.05], [0, 0, -0.05]], err_msg=hint)


@pytest.mark.parametrize("velocity", [(0.1, 0, 0), (-0.05, 0, 0), (0, 0.06, 0), (0, -0.06, 0),
                                      (0, 0, 0.3), (0, 0, -0.3)])
def test_executed_footsteps_move_the_feet_at_that_velocity(velocity):
    engine = env.walk_engine.WalkEngine(1, env.walk_engine.TUNED["pymunk"], planar=True)
    footsteps = evaluate.velocity_to_footsteps(np.array([velocity]), engine.period)
    for _ in range(2):  # the second double step begins where the first one ended
        trajectory, executed = engine.plan(footsteps, np.array([0]))
    np.testing.assert_allclose(executed, footsteps)
    feet = trajectory.feet[0][:, :, [0, 1, 3]].mean(1)  # [T + 1, 3] between the feet
    moved = (feet[-1] - feet[0]) / engine.period
    assert moved[2] == pytest.approx(velocity[2], abs=1e-9), "wrong turning rate"
    if velocity[2] == 0:
        np.testing.assert_allclose(moved, velocity, atol=1e-9, err_msg=(
            "forward: half the period's way per single step; sideways: all of it by one foot"))


def test_the_baseline_stays_within_the_step_limits():
    planner = evaluate.BaselinePlanner(B.tuned(40.0, 10.0))
    world = env.FootstepWorld(1, cores=1)
    planner.reset(1)
    for _ in range(5):
        action = planner.act(world, np.array([0]), np.array([[-3.0, -3.0, -3.0]]))
    assert action.shape == (1, 6) and (action >= 0).all() and (action <= 1).all()
    world.close()


# ---------------------------------------------------------------- statistics
def test_wilson_interval():
    assert evaluate.wilson(5, 10) == pytest.approx([0.2366, 0.7634], abs=1e-4)
    assert evaluate.wilson(490, 500) == pytest.approx([0.9636, 0.9891], abs=1e-4)
    low, high = evaluate.wilson(500, 500)
    assert high == pytest.approx(1) and 0.99 < low < 1, "500 of 500 does not prove 100 %"
    assert evaluate.wilson(0, 500) == pytest.approx([1 - high, 1 - low]), "not symmetric"


def test_wilson_interval_covers_the_truth_95_times_in_100():
    rng, p, n = np.random.default_rng(0), 0.96, 500
    inside = [low <= p <= high for low, high in
              (evaluate.wilson(k, n) for k in rng.binomial(n, p, size=4000))]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)


def trials(outcomes, times):
    return {"outcome": np.array(outcomes), "time": np.array(times, float),
            "stays_up": np.array(outcomes) == "success"}


def test_time_ratio_uses_only_goals_that_both_reached():
    ours = trials(["success", "success", "fall"], [5, 10, 1])
    theirs = trials(["success", "success", "success"], [10, 20, 100])
    ratio, (low, high), goals = evaluate.time_ratio(ours, theirs)
    assert (ratio, goals) == (0.5, 2), "a fall's time must not count as a fast success"
    assert low == high == 0.5, "paired: a goal's difficulty cancels out, resample goals, not times"
    fell, reached = trials(["fall"], [1]), trials(["success"], [10])
    assert evaluate.time_ratio(fell, reached) == (None, None, 0), "no goal in common: no ratio"


def test_summary_without_a_success_is_valid_json():
    row = evaluate.summary("policy", True, trials(["fall", "timeout"], [1, 100]), env.Task())
    assert row["success"] == 0 and row["fall"] == row["timeout"] == 0.5
    assert row["time_mean"] is row["stays_up"] is None, "no success: no mean, and not 0 or nan"
    json.dumps(row, allow_nan=False)
    assert "none" in evaluate.table([row], [])


def test_lower_bound_is_straight_and_in_whole_double_steps():
    goals = np.array([[1.05, 0, 3], [0, -1.06, 0], [0.03, 0.03, 1]])
    bound = evaluate.lower_bound(goals, speed=0.5, period=0.5, task=env.Task())
    np.testing.assert_allclose(bound, (2.0, 2.5, 0.0), atol=1e-9, err_msg=(
        "1.00 m at 0.25 m per double step: 4 of them; 1 cm more: 5; inside the circle: none"))
    row = evaluate.summary("policy", False, trials(["success", "fall", "success"], [4, 1, 2]),
                           env.Task(), bound)
    assert row["time_bound"] == 1.0, "the bound is averaged over the successes, as the time is"
    assert "3.00" in evaluate.table([row], [], 0.5), "time 3 s, bound 1 s"


# ---------------------------------------------------------------- trials
class Recorder:
    """Stands still and remembers what it was told; three decisions are enough."""

    def reset(self, num_robots):
        self.measured = []

    def act(self, world, robots, measured):
        self.measured.append(measured.copy())
        return np.tile(world.neutral_action, (len(robots), 1))


class Wild(Recorder):
    """A planner that behaves differently."""

    def act(self, world, robots, measured):
        super().act(world, robots, measured)
        return np.tile([0.7, 0.3, 0.5, 0.7, 0.3, 0.5], (len(robots), 1))


SHORT = env.Task(time_limit=2.0)


@pytest.fixture(scope="module")
def world():
    world = env.FootstepWorld(6, cores=1, task=SHORT)
    yield world
    world.close()


def first_noise(planner, world, goals):
    evaluate.evaluate(planner, world, goals, seed=3, noise=True)
    noise = planner.measured[0] - goals
    noise[:, 2] = env.wrap(noise[:, 2])
    return noise


def test_noise_of_a_goal_depends_on_neither_planner_nor_number(world):
    goals = env.draw_goals(env.stream("evaluation", 3), 6)
    np.testing.assert_array_equal(goals[:2], env.draw_goals(env.stream("evaluation", 3), 2))
    noise = first_noise(Recorder(), world, goals)
    hint = "one generator per goal and one `world.measure` per decision"
    np.testing.assert_array_equal(noise, first_noise(Wild(), world, goals), err_msg=hint)
    np.testing.assert_array_equal(noise[:2], first_noise(Recorder(), world, goals[:2]), hint)
    assert len(np.unique(noise)) == noise.size, "goals must not share their noise"
    drawn = (goals / [1, 1, math.pi / 2])[0]
    assert not np.allclose(noise[0] / 0.05, drawn), "goals and noise come from the same generator"


def test_outcomes_are_exclusive_and_deterministic(world):
    goals = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])  # where it stands; too far for 2 s
    runs = [evaluate.evaluate(evaluate.BaselinePlanner(), world, goals) for _ in range(2)]
    assert runs[0]["outcome"].tolist() == ["success", "timeout"]
    assert runs[0]["stays_up"].tolist() == [True, False], "only a success can stay up"
    assert runs[0]["time"][0] == pytest.approx(world.engine.period), "a step is counted twice"
    for key in runs[0]:
        np.testing.assert_array_equal(runs[0][key], runs[1][key], err_msg="same seed, same numbers")


def test_a_planner_that_returns_nonsense_is_told(world):
    class Broken(Recorder):
        def act(self, world, robots, measured):
            return np.full((len(robots), 6), np.nan)

    with pytest.raises(ValueError, match="finite numbers"):
        evaluate.evaluate(Broken(), world, np.zeros((2, 3)))


def test_the_recorded_walk_is_the_measured_one(world):
    walk, = evaluate.record(Recorder(), world, np.array([[1.0, 0.0, 0.0]]))
    steps = len(walk["feet"])
    ticks = steps * 2 * world.engine.half_ticks
    assert walk["torso"].shape == (ticks, 6) and walk["joints"].shape == (ticks, 12)
    np.testing.assert_array_equal(walk["torso"][-1, [0, 1, 5]], world.pose[0], err_msg=(
        "the picture must show the simulator's pose, not the commanded one"))


# ---------------------------------------------------------------- files and the command line
def save_untrained(path, sim="pymunk", imu=False, **fits):
    torch.manual_seed(0)
    model = ppo.ActorCritic(len(env.observation_table(imu)), 6, first_action=0.4)
    path.parent.mkdir(parents=True, exist_ok=True)
    ppo.save_policy(path, model, {"fits": env.fingerprint(sim, imu) | fits, "steps": 10,
                                  "minutes": 0.1, "seed": 0})
    return path


def run_main(*arguments):
    """Exit code of the script, run in this process."""
    with pytest.raises(SystemExit) as stopped:
        evaluate.main([str(argument) for argument in arguments])
    return stopped.value.code


def refused(capsys, *arguments):
    """The one line on stderr of a call that must be refused."""
    assert run_main(*arguments) == 2, "bad input ends with exit code 2"
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and lines[0].startswith("05_evaluate.py: "), f"one clear line: {lines}"
    return lines[0]


@pytest.mark.parametrize("text, line", [
    ("x,y,yaw\n1,2,3\n1,two,3\n", 3), ("x,y,yaw\n1,nan,3\n", 2), ("x,y,yaw\n\n1,2,inf\n", 3),
    ("x,y,yaw\n1,2\n", 2), ("x,y,yaw\n1,2,3,4\n", 2), ("x,y\n1,2\n", 1), ("", 1), ("1,2,3\n", 1),
    ("x,y,yaw\n", 1), ("x,y,yaw\n1,2,\n", 2)])
def test_a_malformed_goals_file_names_the_line(text, line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("goals.csv").write_text(text)
    message = refused(capsys, "--goals", "goals.csv")
    assert f"goals.csv, line {line}: " in message, f"{text!r}: line {line} is the wrong one"


def test_goals_file_is_read_whatever_wrote_it(tmp_path):
    path = tmp_path / "goals.csv"
    path.write_bytes("\ufeffname, X ,y,yaw\r\na,1,-2.5,7\r\n\r\n".encode())  # as a spreadsheet does
    np.testing.assert_allclose(evaluate.read_goals(path), [[1, -2.5, 7 - 2 * math.pi]])


def test_bad_input_is_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert "python 04_ppo.py" in refused(capsys), "without a policy, say how to get one"
    good = save_untrained(tmp_path / "policy.pt")
    other = save_untrained(tmp_path / "other.pt", sim="mujoco")
    limits = save_untrained(tmp_path / "limits.pt", **{"step limits": {"low": [0], "high": [1]}})
    Path("text.pt").write_text("no tensors")
    Path("latin.csv").write_bytes(b"x,y,yaw\n\xe9,1,1\n")
    assert "simulator is mujoco" in refused(capsys, "--policy", other)
    assert "step limits" in refused(capsys, "--policy", limits)
    assert "text.pt" in refused(capsys, "--policy", "text.pt")
    assert "missing.pt" in refused(capsys, "--policy", "missing.pt")
    assert "missing.csv" in refused(capsys, "--policy", good, "--goals", "missing.csv")
    assert "UTF-8" in refused(capsys, "--policy", good, "--goals", "latin.csv")
    assert "text.pt" in refused(capsys, "--policy", good, "--out", Path("text.pt") / "below")
    for count in ("0", "-3", "many", "1.5"):
        refused(capsys, "--policy", good, "--episodes", count)
    refused(capsys, "--policy", good, "--seed", "-1")
    refused(capsys, "--tune-baseline", "--noise")
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert "pip install mujoco" in refused(capsys, "--mujoco", "--policy", other)


def test_from_a_policy_file_to_the_table(tmp_path):
    """Twice in a process of its own, as a student calls it: all files, and the same numbers."""
    save_untrained(tmp_path / "runs/pymunk/imu/policy.pt", imu=True)
    shipped = tmp_path / "results/pymunk"
    save_untrained(shipped / "policy.pt")
    (shipped / "baseline_tuned.json").write_text('{"factor": 2.0, "turning_gain": 0.6}')
    (tmp_path / "goals.csv").write_text("x,y,yaw\n0.1,0,0\n0,0.2,0.5\n-0.1,0,0\n")
    texts = []
    for out in ("one", "two"):
        done = subprocess.run([sys.executable, SCRIPT, "--noise", "--goals", "goals.csv", "--out",
                               out], cwd=tmp_path, capture_output=True, encoding="utf-8",
                              env=os.environ | {"PYTHONUTF8": "1"}, check=False)
        assert done.returncode == 0, done.stderr
        names = ("evaluation.json", "trials.csv", "table.md")
        texts.append([(tmp_path / out / name).read_text(encoding="utf-8") for name in names])
    assert texts[0] == texts[1], "the same seed gives the same numbers"
    assert "results/pymunk/policy.pt" in done.stdout and texts[0][2] in done.stdout
    assert (tmp_path / "one/footsteps.png").read_bytes().startswith(b"\x89PNG")
    assert not list(tmp_path.rglob("*.tmp*")), "a temporary file was left behind"

    content = json.loads(texts[0][0])
    assert content["sim"] == "pymunk" and content["policy"]["steps"] == 10
    names = ["policy", "policy_imu", "baseline", "baseline_tuned"]
    assert [(r["planner"], r["noise"]) for r in content["rows"]] == [
        (name, noise) for noise in (False, True) for name in names]
    for row in content["rows"]:
        assert row["success"] + row["timeout"] + row["fall"] == pytest.approx(1, abs=2e-4)
        assert row["success_ci95"][0] <= row["success"] <= row["success_ci95"][1]
        assert ("noise_m" in row) == row["noise"]
    assert len(content["ratios"]) == 8, "two policies × two baselines × two noise settings"
    lines = list(csv.DictReader(texts[0][1].splitlines()))
    assert len(lines) == 3 * len(content["rows"])
    goals = {name: [line["x"] for line in lines if line["planner"] == name] for name in names}
    assert all(goal == goals["policy"] for goal in goals.values()), "the same goals for everyone"
    again = evaluate.read_goals(tmp_path / "one/trials.csv")  # failed trials can be repeated
    np.testing.assert_array_equal(again[:3], evaluate.read_goals(tmp_path / "goals.csv"))
    assert "0.545" in evaluate.table(content["rows"], content["ratios"]) or all(
        ratio["goals"] == 0 for ratio in content["ratios"])


def test_tuning_keeps_the_fastest_safe_setting(tmp_path, monkeypatch):
    monkeypatch.setattr(evaluate, "FACTORS", (1.0, 2.0))
    monkeypatch.setattr(evaluate, "TURNING_GAINS", (0.6,))
    evaluate.main(["--tune-baseline", "--episodes", "2", "--out", str(tmp_path)])
    stored = json.loads((tmp_path / "baseline_tuned.json").read_text())
    assert {"factor", "turning_gain", "grid"} <= stored.keys() and len(stored["grid"]) == 2
    safe = [row for row in stored["grid"] if row["success"] >= evaluate.TUNED_SUCCESS]
    if safe:
        fastest = min(safe, key=lambda row: row["time_mean"])
        assert stored["factor"] == fastest["factor"], "slower than another safe setting"


def test_the_policy_for_the_figures_comes_first(tmp_path, monkeypatch):
    shipped = Path(evaluate.__file__).parent / "results" / "mujoco"
    shutil.copytree(shipped, tmp_path / "results" / "mujoco")
    monkeypatch.chdir(tmp_path)
    for imu, first in ((False, "policy"), (True, "policy_imu")):
        planners, about = evaluate.choose_planners("mujoco", imu=imu)
        assert next(iter(planners)) == next(iter(about)) == first
        assert set(planners) == {"policy", "policy_imu", "baseline", "baseline_tuned"}
        assert about["policy_imu"]["imu"] and not about["policy"]["imu"]
    shutil.rmtree(tmp_path / "results" / "mujoco" / "imu")
    assert "policy" in evaluate.choose_planners("mujoco")[0], "nobody asked for the other one"
    with pytest.raises(evaluate.InputError, match="04_ppo.py --mujoco --imu"):
        evaluate.choose_planners("mujoco", imu=True)
