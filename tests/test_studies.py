"""The studies' own tools: what they keep, hide, count, and where they write. They take hours; here
only tiny versions of them run."""

import hashlib
import json
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).resolve().parent / "studies"
sys.path.append(str(FOLDER))
common, kept = import_module("common"), import_module("kept")
env, ppo, evaluate, torch = kept.env, kept.ppo, kept.evaluate, kept.ppo.torch
STUDIES = sorted(path.stem for path in FOLDER.glob("*.py") if path.stem not in ("common", "kept"))
SIMS = pytest.mark.parametrize("sim", ["pymunk", "mujoco"])
EVERY = pytest.mark.parametrize("name", STUDIES)

def run(name, *flags):
    """The study on the command line, but in this process."""
    common.main(str(FOLDER / f"{name}.py"), list(flags))

def hashes(folder):
    """What is in every file of a folder."""
    return {path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in folder.rglob("*") if path.is_file()}

@pytest.fixture
def tiny(monkeypatch, tmp_path):
    """Three goals, one core, everything in a folder of its own; the folder, with a copy of results.

    The trainings are the shipped ones.
    """
    def train(sim, seed, imu=False):
        shipped, out = common.RESULTS / sim / ("imu" if imu else ""), tmp_path / f"{imu}{seed}"
        shutil.copytree(shipped / "seeds" / str(seed), out, dirs_exist_ok=True)
        shutil.copyfile(shipped / "learning_curve.png", out / "learning_curve.png")
        return out

    shutil.copytree(common.RESULTS, tmp_path / "results")
    monkeypatch.setattr(common, "RESULTS", tmp_path / "results")
    monkeypatch.setattr(common, "RUNS", tmp_path / "runs")
    monkeypatch.setattr(common.robot_model, "CORES", 1)
    monkeypatch.setattr(kept, "PER_SEED", 3)
    monkeypatch.setattr(kept, "train", train)
    return tmp_path


# ------------------------------------------------------------------------ the command line
@EVERY
def test_every_study_says_what_it_asks_and_how_to_run_it(name, capsys):
    doc = import_module(name).__doc__
    assert "?" in doc.splitlines()[0], "the first line is the question it answers"
    assert f"\n    python tests/studies/{name}.py [--mujoco] [--ship]\n" in doc
    with pytest.raises(SystemExit) as stop:
        run(name, "--help")
    assert stop.value.code == 0
    text = " ".join(capsys.readouterr().out.split())
    for words in import_module(name).DURATION.values():
        assert words in text, "--help says how long it takes"

@EVERY
@SIMS
def test_every_study_prints_its_duration_first_and_ships_only_if_told_to(
        name, sim, tiny, monkeypatch, capsys):
    """With the study itself replaced by one that knows the answer at once."""
    found = common.Findings({"answer": 42}, "| answer |\n", common.plt.figure(), {})
    study, flags = import_module(name), ["--mujoco"] * (sim == "mujoco")
    monkeypatch.setattr(study, "study", lambda sim: found)
    before, shipped = hashes(common.RESULTS), hashes(common.ROOT / "results")
    run(name, *flags)
    assert capsys.readouterr().out.splitlines()[0] == f"{name}, {sim}: {study.DURATION[sim]}"
    made = {f"{name}.json", f"{name}.md", f"{name}.png"}
    assert set(hashes(common.RUNS / sim)) == made
    assert hashes(common.RESULTS) == before, "results/ was changed without --ship"
    run(name, "--ship", *flags)
    after = hashes(common.RESULTS)
    assert {path for path in after if after[path] != before.get(path)} == {
        f"{sim}/studies/{path}" for path in made}
    assert hashes(common.ROOT / "results") == shipped

def test_wrong_flags_and_missing_files_get_one_line(tiny, capsys):
    shutil.rmtree(common.RESULTS / "pymunk" / "seeds")
    for name, flags, reason in (("falls", [], "seeds/0/policy.pt: no such file"),
                                ("speed", ["--seed", "1"], "--seed"),
                                ("noise", ["--episodes=3"], "--episodes")):
        with pytest.raises(SystemExit) as stop:
            run(name, *flags)
        message = capsys.readouterr().err
        assert stop.value.code == 2 and reason in message
        assert len(message.splitlines()) == 1, message

def test_the_script_itself_starts():
    command = [sys.executable, str(FOLDER / "times.py"), "--no-such-flag"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1, done.stderr

def test_an_interruption_is_no_error(monkeypatch, capsys):
    def stop(sim):
        raise KeyboardInterrupt
    monkeypatch.setattr(import_module("speed"), "study", stop)
    with pytest.raises(SystemExit) as end:
        run("speed")
    assert end.value.code == 130 and "the same command continues" in capsys.readouterr().err


# ------------------------------------------------------------------------ whole studies, tiny
@pytest.mark.parametrize("name, sim, prefix", [("seeds", "pymunk", ""), ("imu", "mujoco", "imu/")])
def test_chosen_policies_are_replaced_only_by_ship(name, sim, prefix, tiny, monkeypatch):
    study, results = import_module(name), common.RESULTS
    monkeypatch.setattr(study, "SETS", 1)
    (results / sim / prefix / "policy.pt").write_bytes(b"older")
    before, flags = hashes(results), ["--mujoco"] * (sim == "mujoco")
    run(name, *flags)
    assert hashes(results) == before, f"{name} replaced what is shipped without a word"
    mine = hashes(common.RUNS / sim)
    content = json.loads((common.RUNS / sim / f"{name}.json").read_text(encoding="utf-8"))
    median = content["median_seed"]
    assert mine[f"{prefix}policy.pt"] == mine[f"{prefix}seeds/{median}/policy.pt"]
    run(name, "--ship", *flags)
    after = hashes(results / sim)
    for path in (f"{prefix}{file}" for file in (
            "policy.pt", "learning_curve.csv", "learning_curve.png", "seeds/0/policy.pt",
            "seeds/1/policy.pt", "seeds/2/policy.pt", "seeds/2/learning_curve.csv")):
        assert after[path] == mine[path], f"--ship has not copied {path}"
    assert after[f"studies/{name}.json"] == mine[f"{name}.json"]
    changed = {path for path in after if after[path] != before.get(f"{sim}/{path}")}
    assert changed <= {path for path in mine if path.startswith(prefix or "")} | {
        f"studies/{name}{end}" for end in (".json", ".md", ".png")}

@SIMS
def test_the_shipped_comparison_of_times_comes_from_the_shipped_trials(sim, monkeypatch):
    times = import_module("times")
    monkeypatch.setattr(times.speed, "fastest", lambda sim: (0.5, [0.1, 0.0]))  # for the figure
    found, folder = times.study(sim), common.RESULTS / sim / "studies"
    common.plt.close(found.figure)
    assert found.table == (folder / "times.md").read_text(encoding="utf-8")
    assert found.numbers == common.read_json(folder / "times.json")


# ------------------------------------------------------------------------ what is kept
def test_a_result_is_kept_under_everything_it_depends_on():
    robot = kept.robot_model.RobotModel()
    first = common.digest(robot, env.Task(), b"policy")
    assert first == common.digest(kept.robot_model.RobotModel(), env.Task(), b"policy")
    others = [(robot, env.Task(), b"another"), (robot, env.Task(s_fall=7.0), b"policy"),
              (replace(robot, friction=0.4), env.Task(), b"policy")]
    for ingredients in others:
        assert common.digest(*ingredients) != first, "an old result would be taken for a new one"

def test_an_interrupted_study_takes_up_its_finished_trials(tiny):
    asked = []

    class Forward(evaluate.BaselinePlanner):
        def act(self, world, robots, measured):
            asked.append(len(robots))
            return super().act(world, robots, measured)

    planner = Forward(import_module("baseline").settings(3.0, 0.6))
    trials = kept.Trials("pymunk")
    first = trials.run(planner, "key", True, count=1)
    decisions = len(asked)
    again = trials.run(planner, "key", True, count=2)
    trials.close()
    assert decisions > 0 and len(asked) > decisions, "the second 3 goals are new"
    assert sum(asked[:decisions]) == first["steps"].sum()
    for key in ("outcome", "time", "goals"):
        np.testing.assert_array_equal(first[key], again[key][: len(first[key])])
    assert not np.array_equal(again["goals"][:3], again["goals"][3:]), "each set has its own goals"

def test_tuning_and_evaluation_have_different_goals(tiny):
    trials = kept.Trials("pymunk")
    planner = kept.baseline(import_module("baseline").settings(3.0, 0.6))
    sets = [trials.run(*planner, False, 0, 1, purpose=purpose)["goals"]
            for purpose in ("tuning", "evaluation")]
    trials.close()
    assert not np.isclose(*sets).any(), "the baseline would be tuned on the goals it is judged by"

def test_a_fall_is_recorded_with_its_step_and_its_moment(tiny, monkeypatch):
    """Two double steps on the spot, then longer and longer ones until everybody has fallen."""
    lengths = np.array([0.0, 0.0, 0.42, 0.44, 0.46, 0.48, 0.5])  # [m]

    class Lunge(evaluate.BaselinePlanner):
        def act(self, world, robots, measured):
            footsteps = np.zeros((len(robots), 2, 3))
            footsteps[:, :, 0] = lengths[world.steps[robots]][:, None]
            return env.to_action(footsteps, world.limits)

    limits = env.walk_engine.StepLimits(low=(-0.5, -0.04, -0.3), high=(0.5, 0.1, 0.45))
    monkeypatch.setitem(env.walk_engine.LIMITS, "mujoco", limits)
    trials = kept.Trials("mujoco")
    found = trials.run(Lunge(), "lunge", False, count=1)
    trials.close()
    assert (found["outcome"] == "fall").all()
    last = np.sort(found["steps"]) - 1
    assert (last >= 2).all(), "on the spot nobody falls"
    now, before, when = found["falls"][:, 3:].T
    np.testing.assert_allclose(now, lengths[last], err_msg="length of the step that fell")
    np.testing.assert_allclose(before, lengths[last - 1], err_msg="of the one before")
    assert (when >= 0).all() and (when < 1).all(), "a share of the double step"
    moved = np.hypot(*(found["falls"][:, :2] - found["goals"][:, :2])[last == 2].T)
    assert (moved < 0.1).all(), "the goal is recorded as it was before the step that fell"

def test_the_median_seed_is_neither_the_best_nor_the_worst():
    rows = [{"seed": seed, "success": success, "time_mean": time}
            for seed, success, time in ((0, 1.0, 5.0), (1, 1.0, 6.0), (2, 0.9, None))]
    assert kept.median_seed(rows) == 1, "by success first; then the slower one is the worse one"


# ------------------------------------------------------------------------ tables and stopwatch
def test_markdown_is_aligned():
    lines = common.markdown(["a", "long head"], [[1, 2], ["xyz", 4]]).splitlines()
    assert len({len(line) for line in lines}) == 1
    assert lines[2].split("|")[1:3] == [" 1   ", " 2         "]

def test_a_spread_says_how_many_never_came():
    assert common.spread([1.0, None, 3.0], 1) == "2.0 (1.0 … 3.0), 1 never"
    assert common.spread([None, None], 1) == "never"

def test_the_stopwatch_counts_calls_and_leaves_no_trace():
    class Clock:
        def wait(self, seconds):
            time.sleep(seconds)
            return seconds

    original, clock = Clock.wait, Clock()
    begin = time.perf_counter()
    with common.timed(Clock, "wait") as watch:
        assert clock.wait(0.02) == 0.02 and clock.wait(seconds=0.01) == 0.01
    assert watch.calls == 2 and watch.seconds >= 0.03
    assert begin < watch.first <= watch.last - watch.seconds + 1e-9
    assert Clock.wait is original

def test_learning_is_what_the_simulation_leaves():
    budget, cfg = import_module("budget"), ppo.PPOConfig(num_envs=10, rollout=5)
    watch = common.Stopwatch(calls=15, seconds=2.0, first=1.0, last=4.0)
    assert budget.learning_ms(watch, cfg) == pytest.approx(10.0), (
        "1 s of learning, from two rollouts of 5 · 10 double steps; the third comes too late")
    watch.calls = 5
    assert budget.learning_ms(watch, cfg) is None, "one rollout ends before any learning"

@SIMS
def test_bare_physics_is_nothing_but_the_simulator_s_steps(sim):
    benchmark = import_module("benchmark")
    envs = env.FootstepVectorEnv(3, sim, cores=1)
    envs.reset(seed=0)
    ticks, robot = 2 * envs.world.engine.half_ticks, envs.world.engine.robot
    begin = time.perf_counter()
    with common.timed(*benchmark.bare_physics(sim)) as physics:
        envs.step(np.tile(envs.neutral_action, (3, 1)))
    took = time.perf_counter() - begin
    envs.close()
    assert physics.calls == (3 * ticks * robot.substeps if sim == "pymunk" else 1)
    assert 0 < physics.seconds < took

def test_a_row_of_the_benchmark(monkeypatch):
    benchmark = import_module("benchmark")
    monkeypatch.setattr(benchmark, "STEPS", 8)
    row = benchmark.on_one_core("mujoco", 2)
    assert row["robots"] == 2 and row["ratio"] == pytest.approx(row["one_core"] / row["bare"])
    assert 0 < row["planning"] < 1 and all(key in row for key in ("bare", "kB"))


# ------------------------------------------------------------------------ single studies
def test_hidden_observation_is_the_action_before_the_last_one():
    ablations = import_module("ablations")
    names = [row[0] for row in env.observation_table()]
    hidden = names[ablations.LATER]
    assert len(hidden) == 6 and all("action before" in name for name in hidden)
    envs = ablations.HiddenEnv(2, "mujoco", cores=1)
    envs.reset(seed=0)
    for _ in range(2):
        observations, *_ = envs.step(np.full((2, 6), 0.6))
    envs.close()
    assert not observations[:, ablations.LATER].any(), "the policy can still see it"
    assert observations[:, 8:14].any(), "the last action must stay visible"

def test_every_reward_term_has_its_ablation():
    zero, still, variants = np.zeros((1, 3)), np.zeros((1, 6)), import_module("ablations").VARIANTS
    terms = env.reward_terms(zero, zero, still, still, np.zeros(1), np.zeros(1))
    for name in terms:
        task = replace(env.Task(), **variants[f"without {name}"]["task"])
        without = env.reward_terms(zero + 1, zero + [2, 1, 3], still + 1, still,
                                   np.ones(1), np.ones(1), task)
        assert without[name] == 0, f"the variant 'without {name}' still pays it"
        assert all(without[other] != 0 for other in terms if other != name)

def test_when_a_training_has_learned():
    after = import_module("ablations").learned_after
    curve = [[8000, 0.6], [12000, 0.9], [16000, 1.0], [20000, 1.0]]
    assert after(curve) == 16.0, "the mean of three updates reaches 80 %"
    assert after(curve[:2]) is None and after(curve[1:3]) is None, "two lucky updates: not enough"

def test_gaussian_policy_is_a_normal_distribution_around_the_first_action():
    first, obs = np.array([0.2, 0.5, 0.8]), np.zeros((100, 4), np.float32)
    torch.manual_seed(0)
    model = import_module("ablations").GaussianActor(4, 3, (8, 8), first, 10.0)
    np.testing.assert_allclose(model.decide(obs), np.tile(first, (100, 1)), atol=0.02)
    obs, std = torch.as_tensor(obs), (4 * 11) ** -0.5  # of a Beta with mean 0.5, α + β = 10
    action = model.sample(obs)
    assert action.shape == (100, 3) and action.min() < 0, "it may leave [0, 1], unlike the Beta"
    z = (action.numpy() - first) / std  # Σ (−z²/2 − ln(σ·√(2π)))
    expected = (-(z**2) / 2 - np.log(std * np.sqrt(2 * np.pi))).sum(1)
    with torch.no_grad():
        log_prob = model.policy(obs).log_prob(action).numpy()
    np.testing.assert_allclose(log_prob, expected, atol=0.1)

def test_gaussian_policy_learns_with_the_same_ppo():
    torch.manual_seed(0)
    cfg = ppo.PPOConfig(epochs=4, minibatch=128)
    model = import_module("ablations").GaussianActor(1, 1, (8, 8), np.array([0.3]), 10.0)
    optimizer = torch.optim.Adam(model.parameters(), lr=5e-3)
    obs, yes = torch.zeros(4, 128, 1), torch.ones(4, 128, dtype=torch.bool)
    for _ in range(25):
        action = model.sample(obs)
        reward = -((action[..., 0].clamp(0, 1) - 0.8) ** 2)
        ppo.improve(model, optimizer, {"obs": obs, "next_obs": obs, "action": action,
                                       "reward": reward, "terminated": yes, "truncated": ~yes}, cfg)
    best = model.decide(np.zeros((1, 1), np.float32)).item()
    assert best == pytest.approx(0.8, abs=0.05), "the best action is 0.8"

def test_shares_between_mode_and_mean():
    decision = import_module("decision")
    planner, _ = kept.policy(common.RESULTS / "mujoco" / "policy.pt", "mujoco")
    world = env.FootstepWorld(2, "mujoco", cores=1)
    world.reset([0, 1], goals=np.array([[1.0, 0.5, 1.0], [-1.0, 0.0, 2.0]]))
    actions = {share: decision.SharePlanner(planner, share).act(world, [0, 1], world.goal)
               for share in (0.0, ppo.MEAN_SHARE, 1.0)}
    np.testing.assert_array_equal(actions[ppo.MEAN_SHARE], planner.act(world, [0, 1], world.goal))
    between = (1 - ppo.MEAN_SHARE) * actions[0.0] + ppo.MEAN_SHARE * actions[1.0]
    world.close()
    np.testing.assert_allclose(actions[ppo.MEAN_SHARE], between, atol=1e-6)

def test_an_elliptic_cone_is_another_world(tiny):
    robustness, goals = import_module("robustness"), []
    planner = kept.baseline(import_module("baseline").settings(3.5, 1.0))
    for kind in (kept.Trials, robustness.EllipticTrials):
        trials, ends = kind("mujoco"), []
        sim = trials.make_world().sim
        sim.run = record(sim.run, ends)
        trials.run(*planner, False, count=1)
        trials.close()
        assert ends, "it took the other world's trials"
        goals.append(ends[5])
    assert not np.allclose(*goals, atol=1e-6), "the cone has no effect"

def record(run, ends):
    """A simulator's run that also keeps where the torsos were."""
    def recorded(*arguments):
        motion = run(*arguments)
        ends.append(motion.torso[:, -1])
        return motion
    return recorded

def test_tuning_keeps_the_fastest_safe_setting():
    baseline = import_module("baseline")
    rows = [{"success": 1.0, "time_mean": 9.0}, {"success": 0.975, "time_mean": 8.0},
            {"success": 0.9, "time_mean": 6.0}]
    assert baseline.choose(rows)[0] == rows[1], "fastest of those that reach 97 %"
    assert baseline.choose(rows[2:])[0] == rows[2], "no safe one: the one with most success"
    cautious, tuned = evaluate.BaselineSettings(), baseline.settings(2.0, 0.6)
    assert (tuned.forward, tuned.turning, tuned.turning_gain) == (0.24, 0.6, 0.6)
    assert (tuned.gain, tuned.far_m, tuned.time_constant) == (
        cautious.gain, cautious.far_m, cautious.time_constant)

def test_the_tuned_baseline_has_all_eight_settings(tiny, monkeypatch):
    monkeypatch.setattr(import_module("baseline"), "FACTORS", (1.0, 4.0))
    monkeypatch.setattr(import_module("baseline"), "TURNING_GAINS", (0.6,))
    run("baseline", "--ship", "--mujoco")
    tuned = json.loads((common.RESULTS / "mujoco" / "baseline_tuned.json").read_text())
    assert evaluate.BaselineSettings(**tuned["settings"]).turning_gain == 0.6
    assert tuned["settings"].keys() == vars(evaluate.BaselineSettings()).keys()
    assert len(common.read_json(common.RUNS / "mujoco" / "baseline.json")["grid"]) == 2
    assert kept.shipped("mujoco")["baseline_tuned"][1] == tuned["settings"]

def test_reference_is_straight_and_in_whole_double_steps(monkeypatch):
    times = import_module("times")
    period = env.walk_engine.WalkEngine(1, env.walk_engine.TUNED["pymunk"]).period
    monkeypatch.setattr(times.speed, "fastest", lambda sim: (0.25 / period, [0.1, 0.0]))
    steps = times.reference(np.array([1.049, 1.06, 0.03]), "pymunk") / period
    np.testing.assert_allclose(steps, (4, 5, 1), err_msg=(
        "1 m at 0.25 m per double step: 4; 1 cm more: 5; even in the circle one is walked"))

@SIMS
def test_fastest_speed_is_measured_and_not_commanded(sim, monkeypatch):
    speed, walk_engine = import_module("speed"), env.walk_engine
    monkeypatch.setattr(common.robot_model, "CORES", 1)
    monkeypatch.setattr(speed, "REPEATS", 1)
    found, _ = speed.fastest(sim)
    period = walk_engine.WalkEngine(1, walk_engine.TUNED[sim]).period
    step = 0.6 * walk_engine.LIMITS[sim].high[0]
    plan = np.tile([step, 0, 0], (1, 8, 2, 1))
    poses, _, fall = walk_engine.walk(sim, walk_engine.TUNED[sim], plan)
    assert fall[0] == 8
    moderate = (poses[0, -1, 0] - poses[0, 4, 0]) / (4 * period)
    assert 0.9 * moderate < found < 2 * walk_engine.LIMITS[sim].high[0] / period, (
        "at least that of a moderate walk, less than what the longest footsteps ask for")

@SIMS
def test_the_map_of_falls_knows_what_is_easy_and_what_is_impossible(sim, monkeypatch):
    limits = import_module("limits")
    monkeypatch.setattr(common.robot_model, "CORES", 1)
    monkeypatch.setattr(limits, "REPEATS", 2)
    easy, wild = np.zeros((1, 2, 3)), np.tile([0.5, 0.0, 0.0], (1, 2, 1))
    shares = limits.fall_map(sim, np.concatenate([easy, easy, wild]),
                             np.concatenate([easy, wild, wild]))
    assert shares.tolist() == [0, 1, 1], "on the spot; suddenly 0.5 m; always 0.5 m"

def test_a_decision_takes_time(monkeypatch):
    decision_time, world = import_module("decision_time"), env.FootstepWorld(2, "mujoco", cores=1)
    micros = decision_time.decision_time(evaluate.BaselinePlanner(), world, 2)
    world.close()
    assert 1 < micros < 1e6, "[µs]"


# ------------------------------------------------------------------------ the honest floor
def test_the_lowest_corner_of_a_sole_is_mujoco_s():
    import mujoco

    floor, robot_model = import_module("floor"), common.robot_model
    robot, rng = robot_model.RobotModel(), np.random.default_rng(0)
    model = robot_model.mujoco_model(robot)
    data = mujoco.MjData(model)
    joints = np.tile(robot_model.stance(robot)[1], (20, 1)) + rng.normal(size=(20, 12)) * 0.2
    torso = np.c_[rng.normal(size=(20, 3)), rng.uniform(-0.4, 0.4, (20, 3))]
    got, want = floor.corners(robot, torso, joints)[1], []
    for pose, angles in zip(torso, joints):
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, robot_model.rotation(*pose[3:]).ravel())
        data.qpos[:] = np.concatenate([pose[:3], quaternion, angles])
        mujoco.mj_forward(model, data)
        for name in ("left sole", "right sole"):
            geom = data.geom(name)
            size = np.abs(geom.xmat.reshape(3, 3)[2]) @ model.geom(name).size  # half its height
            want.append(geom.xpos[2] - size)
    np.testing.assert_allclose(got.ravel(), want, atol=1e-9, err_msg=(
        "is the outward side of the right foot −y, and is the ankle above the sole?"))

def test_combined_steps_are_made_smaller_and_single_ones_are_not():
    floor = import_module("floor")
    limits = floor.walk_engine.LIMITS["mujoco"]
    corner, single = np.array([limits.high, limits.low]), np.diag(limits.high)[:2]
    np.testing.assert_array_equal(floor.limited(single, 1.5), single, err_msg="one share is 1")
    np.testing.assert_allclose(floor.limited(corner, 1.5), corner / 2, err_msg="3 shares to 1.5")
    np.testing.assert_array_equal(floor.limited(corner, 3.0), corner, err_msg="anything goes")

def test_on_the_honest_floor_a_walk_does_not_care_where_north_is():
    """On MuJoCo's pyramid the same walk ends elsewhere when it starts at another heading."""
    floor, compose = import_module("floor"), common.robot_model.compose
    headings, ends = np.radians([0, 45, 90]), {}
    engine = floor.RollingEngine(3, floor.RETUNED)
    engine.roll = 0.0541
    plans = [engine.plan(np.tile([[0.06, 0.02, 0.1], [0.06, 0, -0.1]], (3, 1, 1)), range(3))[0]
             for _ in range(6)]
    for name in ("pyramid", "honest"):
        sim = floor.HonestSim(engine.stance, np.full(3, 0.5), np.random.default_rng(0))
        sim.models, sim.delay = [sim.models[0]] * 3, sim.delay[:1].repeat(3)  # three equal bodies
        if name == "pyramid":
            sim.models[0].opt.cone = 0
        half = headings / 2
        sim.state[:, sim.TURN] = [  # turn · lean of the start
            [np.cos(h) * w, -np.sin(h) * y, np.cos(h) * y, np.sin(h) * w]
            for h, (w, _, y, _) in zip(half, sim.state[:, sim.TURN])]
        for plan in plans:
            pose = sim.run(plan, np.arange(3)).torso[:, -1, [0, 1, 5]]
        sim.close()
        back = np.stack([0 * headings, 0 * headings, -headings], -1)  # seen from the start
        ends[name] = np.ptp(compose(back, pose)[:, :2], axis=0).max()  # [m]
    assert ends["honest"] < 0.01, f"{ends['honest']:.3f} m apart: is friction isotropic?"
    assert ends["pyramid"] > 0.01, "the test sees no difference between the two cones"
