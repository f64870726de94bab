"""The studies' own tools: what they keep, hide, count, and where they write. They take hours; here
only tiny versions of them run."""

import hashlib
import json
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

FOLDER = Path(__file__).resolve().parent / "studies"
sys.path.append(str(FOLDER))
common, kept = import_module("common"), import_module("kept")
env, ppo, evaluate, torch = kept.env, kept.ppo, kept.evaluate, kept.ppo.torch
SHARED = "book", "common", "kept"
STUDIES = sorted(path.stem for path in FOLDER.glob("*.py") if path.stem not in SHARED)
SIMS = pytest.mark.parametrize("sim", ["pymunk", "mujoco"])
EVERY = pytest.mark.parametrize("name", STUDIES)

SIZES = {  # of studies that run from end to end here; {"SETS": 1} for the others
    "baseline": {"ITERATIONS": 2, "POPULATION": 3, "ELITE": 2, "SETS": 1, "FINALISTS": 2,
                 "WALKS": 2, "QUIET": 1},
    "search": {"FACTORS": (0.5,), "CHANGES": (0.2, 1.0), "WALKS": 2, "FINALISTS": 1},
    "robustness": {"SETS": 1, "WORLDS": {
        f"μ = {mu}": (kept.robot_model.Spread(), {"friction": mu}) for mu in (0.3, 1.2)}},
    "kicks": {"STEPS": 8, "SEEDS": (0,), "SPEEDS": (0.0, 3.0)},
    "second_walk": {"TUNINGS": (1,), "WORLDS": (0,), "STEPS": 8, "SETS": 1},
    "ground": {"SEEDS": 1, "RATIOS": (1.0,), "RISES": (0.03,), "ROLLS": (0.05,)},
}

def run(name, *flags):
    """The study on the command line, but in this process."""
    common.main(str(FOLDER / f"{name}.py"), list(flags))

def make_small(monkeypatch, name):
    """The sizes of a study become tiny."""
    for size, value in SIZES.get(name, {"SETS": 1}).items():
        monkeypatch.setattr(import_module(name), size, value, raising=False)

def hashes(folder):
    """What is in every file of a folder."""
    return {path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in folder.rglob("*") if path.is_file()}

@pytest.fixture(scope="session")
def made(tmp_path_factory):
    """A results/ folder with all that is judged, like policies that have learned nothing."""
    folder, search = tmp_path_factory.mktemp("made"), import_module("search")
    for sim in ("pymunk", "mujoco"):
        limits, about = env.walk_engine.LIMITS[sim], {"fits": env.fingerprint(sim)}
        forward = env.to_action(np.array([[0.05, 0, 0], [0.05, 0, 0]]), limits)
        for imu in (False, True):
            kind = folder / sim / ("imu" if imu else "")
            for seed in kept.SEEDS:
                torch.manual_seed(seed)
                out = kind / "seeds" / str(seed)
                out.mkdir(parents=True)
                model = ppo.ActorCritic(len(env.observation_table(imu)), 6, first_action=forward)
                ppo.save_policy(out / "policy.pt", model, {
                    "fits": env.fingerprint(sim, imu), "config": {"sharpest": 4.0}})
                (out / "learning_curve.csv").write_text(
                    "steps,success,fall,time\n4096,nan,nan,nan\n8192,0.98,0,8\n12288,1,0,7\n")
                (out / "settings.txt").write_text("as written above")
            for name in ("policy.pt", "learning_curve.csv"):
                shutil.copyfile(kind / "seeds" / "0" / name, kind / name)
            (kind / "learning_curve.png").write_bytes(b"a picture")
        tuned = about | {"settings": vars(evaluate.BaselineSettings())}
        common.write(folder / sim / "baseline_tuned.json", common.as_json(tuned))
        steps = search.double_steps(limits, 0.5)
        cells = evaluate.CELL * np.arange(-evaluate.HALF, evaluate.HALF + 1)
        value = np.hypot(cells[:, None], cells) / 0.2  # a straight line, 0.2 m a double step
        table = steps, steps.sum(1) * [1, 1, 0], np.tile(value, (evaluate.TURNS, 1, 1))
        search.save(folder / sim / "search.npz", sim, 0.5, 1.0, table)
    return folder

@pytest.fixture
def tiny(made, monkeypatch, tmp_path):
    """Three goals a set, six seconds for each, one core, everything in a folder of its own.

    The trainings are those of `made`.
    """
    def train(sim, seed, imu=False):
        source, out = made / sim / ("imu" if imu else ""), tmp_path / f"{imu}{seed}"
        shutil.copytree(source / "seeds" / str(seed), out, dirs_exist_ok=True)
        shutil.copyfile(source / "learning_curve.png", out / "learning_curve.png")
        return out

    shutil.copytree(made, tmp_path / "results")
    monkeypatch.setattr(common, "RESULTS", tmp_path / "results")
    monkeypatch.setattr(common, "RUNS", tmp_path / "runs")
    monkeypatch.setattr(common.robot_model, "CORES", 1)
    monkeypatch.setattr(env, "Task", partial(env.Task, time_limit=6.0))
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
    found = common.Findings({"answer": 42}, "| answer |\n", common.plt.figure(figsize=(1, 1)), {})
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
                                ("times", [], "trials.csv"),
                                ("ground", [], "add --mujoco"), ("kicks", [], "add --mujoco"),
                                ("second_walk", [], "add --mujoco"),
                                ("limits", ["--seed", "1"], "--seed"),
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
    monkeypatch.setattr(import_module("limits"), "study", stop)
    with pytest.raises(SystemExit) as end:
        run("limits")
    assert end.value.code == 130 and "the same command continues" in capsys.readouterr().err


# ------------------------------------------------------------------------ whole studies, tiny
@pytest.mark.parametrize("name, sim, prefix", [("seeds", "pymunk", ""), ("imu", "mujoco", "imu/")])
def test_chosen_policies_are_replaced_only_by_ship(name, sim, prefix, tiny, monkeypatch):
    study, results = import_module(name), common.RESULTS
    monkeypatch.setattr(study, "SETS", 1)
    monkeypatch.setattr(study, "GROUND_SETS", 1, raising=False)
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
            "policy.pt", "seeds/0/policy.pt", "seeds/1/policy.pt", "seeds/2/policy.pt",
            "seeds/2/learning_curve.csv", *["learning_curve.png"] * (not prefix))):
        assert after[path] == mine[path], f"--ship has not copied {path}"
    assert after[f"studies/{name}.json"] == mine[f"{name}.json"]
    changed = {path for path in after if after[path] != before.get(f"{sim}/{path}")}
    assert changed <= {path for path in mine if path.startswith(prefix or "")} | {
        f"studies/{name}{end}" for end in (".json", ".md", ".png")}

@pytest.mark.parametrize("name", ["decision", "falls", "robustness", "noise", "pooled"])
def test_a_study_that_only_judges_runs_from_end_to_end(name, tiny, monkeypatch):
    make_small(monkeypatch, name)
    run(name)
    assert {f"{name}.json", f"{name}.md"} <= set(hashes(common.RUNS / "pymunk"))

def test_the_price_of_the_ground_is_measured_from_end_to_end(tiny, monkeypatch):
    make_small(monkeypatch, "ground")
    for name, value in (("LEVELS", 2), ("FRICTION", (0.7,)), ("PATTERN", (1, 0)), ("PLANS", 2)):
        monkeypatch.setattr(env.walk_engine, name, value)
    run("ground", "--mujoco")
    found = common.read_json(common.RUNS / "mujoco" / "ground.json")
    assert len(found["grounds"]) == 3 and len(found["curve"]) == 1

def test_a_second_walk_is_tuned_mapped_and_learned_from_end_to_end(tiny, monkeypatch):
    ours = env.walk_engine.TUNED["mujoco"]
    make_small(monkeypatch, "second_walk")
    for name, value in (("LEVELS", 4), ("FRICTION", (0.7,)), ("PATTERN", (1, 0)), ("PLANS", 2)):
        monkeypatch.setattr(env.walk_engine, name, value)
    monkeypatch.setattr(import_module("limits"), "study", lambda sim: common.Findings(
        vars(env.walk_engine.TUNED[sim]), "maps\n", common.plt.figure()))
    monkeypatch.setattr(env.walk_engine, "tune", partial(
        env.walk_engine.tune, iterations=1, population=2, elite=1))
    monkeypatch.setattr(ppo, "PPOConfig", partial(ppo.PPOConfig, num_envs=2, rollout=4))
    common.write(common.RESULTS / "mujoco/studies/seeds.json", common.as_json({"rows": [
        {"planner": "policy", "noise": True, "goal_std_m": std, "success": 1.0, "fall": 0.0,
         "still_there": 1.0, "time_mean": 5.0} for std in (0.5, 1)]}))
    run("second_walk", "--mujoco")
    found = common.read_json(common.RUNS / "mujoco" / "second_walk.json")
    assert found["walks"]["ours"] == vars(ours) == vars(env.walk_engine.TUNED["mujoco"]), (
        "what we walk with must be as before")
    assert found["walks"]["the second"] != vars(ours) and len(found["policy"]) == 2
    assert found["maps"] == found["walks"]["the second"], "the maps are those of the other walk"

@SIMS
def test_the_shipped_comparison_of_times_comes_from_the_shipped_trials(sim):
    times, folder = import_module("times"), common.RESULTS / sim
    if not (folder / "search.npz").is_file():
        pytest.skip("nothing of this world is shipped yet")
    found = times.study(sim)
    common.plt.close(found.figure)
    assert found.table == (folder / "studies" / "times.md").read_text(encoding="utf-8")
    assert found.numbers == common.read_json(folder / "studies" / "times.json")


# ------------------------------------------------------------------------ what is kept
def test_a_result_is_kept_under_everything_it_depends_on():
    robot = kept.robot_model.RobotModel()
    first = common.digest(robot, env.Task(), b"policy")
    assert first == common.digest(kept.robot_model.RobotModel(), env.Task(), b"policy")
    others = [(robot, env.Task(), b"another"), (robot, env.Task(s_fall=7.0), b"policy"),
              (replace(robot, friction=0.4), env.Task(), b"policy")]
    for ingredients in others:
        assert common.digest(*ingredients) != first, "an old result would be taken for a new one"

def test_a_shipped_training_is_not_made_again_unless_a_setting_has_changed(tiny, monkeypatch):
    monkeypatch.undo()  # `tiny` replaces the training
    monkeypatch.setattr(common, "RESULTS", tiny / "results")
    monkeypatch.setattr(common, "RUNS", tiny / "runs")
    monkeypatch.setattr(ppo, "STEPS", 4096)
    monkeypatch.setattr(ppo, "PPOConfig", partial(ppo.PPOConfig, num_envs=8, rollout=8))
    asked = []

    def main(flags):
        out = Path(flags[flags.index("--out") + 1])
        out.mkdir()
        asked.append(out)
        row = {column: 0.0 for *_, columns in ppo.PANELS for column in columns} | {"steps": 64}
        ppo.save_policy(out / "policy.pt", ppo.ActorCritic(20, 6), {
            "fits": {}, "config": {"sharpest": 4.0}})
        (out / "learning_curve.csv").write_text(
            ",".join(row) + "\n" + 2 * (",".join(map(str, row.values())) + "\n"))
        (out / "learning_curve.png").write_bytes(b"a picture")

    monkeypatch.setattr(ppo, "main", main)
    first = kept.train("mujoco", 1)
    for target, source in kept.to_ship({1: first}, 1).items():
        common.copy(source, common.RESULTS / "mujoco" / target)
    shutil.rmtree(common.RUNS)
    again = kept.train("mujoco", 1)
    assert len(asked) == 1, "results/ holds this very training"
    assert {path.name for path in again.iterdir()} == {*kept.FILES, "learning_curve.png"}
    kept.train("mujoco", 2)
    monkeypatch.setattr(env, "Task", partial(env.Task, s_fall=7.0))
    kept.train("mujoco", 1)
    spread = kept.robot_model.Spread
    monkeypatch.setattr(kept.robot_model, "Spread", partial(spread, friction=0.0))
    kept.train("mujoco", 1)
    assert len(asked) == 4, "another seed, another reward, other worlds: other trainings"

def test_shipped_trainings_are_of_the_settings_of_today():
    stamps = sorted((common.ROOT / "results").rglob("settings.txt"))
    assert stamps, "the trainings of the recipe are shipped"
    for path in stamps:
        sim, imu = path.relative_to(common.ROOT / "results").parts[0], "imu" in path.parts
        assert path.read_text(encoding="utf-8").strip() == kept.settings_of(sim, imu), (
            f"{path.parent}: made of other settings; train it again (tests/studies/seeds.py)")

def test_an_interrupted_study_takes_up_its_finished_trials(tiny):
    asked = []

    class Counting(evaluate.BaselinePlanner):
        def act(self, view, robots, measured):
            asked.append(len(robots))
            return super().act(view, robots, measured)

    planner = Counting()
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
    planner = kept.baseline(evaluate.BaselineSettings())
    sets = [trials.run(*planner, False, 0, 1, purpose=purpose)["goals"]
            for purpose in ("tuning", "evaluation")]
    trials.close()
    assert not np.isclose(*sets).any(), "the baseline would be tuned on the goals it is judged by"

def test_another_world_has_other_trials(tiny):
    planner, spread = kept.baseline(evaluate.BaselineSettings()), common.robot_model.Spread
    ends = []
    for zero in (spread(), spread(0, 0, 0, 0, 0)):
        trials = kept.Trials("mujoco", zero)
        ends.append(trials.run(*planner, False, count=1)["friction"])
        ends.append(trials.run(*planner, False, count=1, friction=1.2)["friction"])
        trials.close()
    assert np.ptp(ends[0]) > 0 and (ends[2] == 0.7).all(), "it took the other world's trials"
    assert (ends[1] == 1.2).all() and (ends[3] == 1.2).all(), "friction is what was asked for"

def test_a_fall_is_recorded_with_its_step_its_moment_and_what_came_before(tiny, monkeypatch):
    """Two double steps on the spot, then longer and longer ones until everybody has fallen."""
    lengths, ends = np.array([0.0, 0.0, 0.42, 0.44, 0.46, 0.48, 0.5]), []  # [m]

    class Lunge:
        def reset(self, num_robots):
            self.steps = 0

        def act(self, view, robots, measured):
            footsteps = np.zeros((len(robots), 2, 3))
            footsteps[:, :, 0] = lengths[self.steps]
            self.steps += 1
            return env.to_action(footsteps, view.limits)

    limits = env.walk_engine.StepLimits(low=(-0.5, -0.04, -0.3), high=(0.5, 0.1, 0.45))
    monkeypatch.setitem(env.walk_engine.LIMITS, "mujoco", limits)
    trials = kept.Trials("mujoco", common.robot_model.Spread(0, 0, 0, 0, 0))
    sim = trials.make_world().sim
    sim.run = record(sim.run, ends)
    found = trials.run(Lunge(), "lunge", False, count=1)
    trials.close()
    assert (found["outcome"] == "fall").all()
    last = np.sort(found["steps"]) - 1
    assert (last >= 2).all(), "on the spot nobody falls"
    now, before, pitch, when, mu = found["falls"][:, 3:].T
    np.testing.assert_allclose(now, lengths[last], err_msg="length of the step that fell")
    np.testing.assert_allclose(before, lengths[last - 1], err_msg="of the one before")
    assert (when >= 0).all() and (when < 1).all(), "a share of the double step"
    assert (mu == 0.7).all(), "friction of the ground"
    # Without a spread all three do the same: the pitch of any of them will do.
    np.testing.assert_allclose(pitch, [ends[k - 1][0, 4] for k in last], atol=1e-6,
                               err_msg="pitch at the end of the double step before the fall")
    tilts = [np.abs(end[0, 4]) > kept.TILTED for end in ends]
    np.testing.assert_array_equal(np.sort(found["tilted"]), [sum(tilts[:k]) for k in last],
                                  err_msg="double steps that began tilted, the fall's included")
    moved = np.hypot(*(found["falls"][:, :2] - found["goals"][:, :2])[last == 2].T)
    assert (moved < 0.1).all(), "the goal is recorded as it was before the step that fell"

def record(run, ends):
    """A simulator's run that also keeps where the torsos were."""
    def recorded(*arguments):
        motion = run(*arguments)
        ends.append(motion.torso[:, -1])
        return motion
    return recorded

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
    step = common.Stopwatch(calls=15, seconds=2.0, first=1.0, last=4.0)
    reset = common.Stopwatch(calls=2, seconds=0.5, first=0.5, last=3.0)
    assert budget.learning_ms(step, reset, cfg) == pytest.approx(10.0), (
        "1 s of learning, from two rollouts of 5 · 10 double steps; the third comes too late")
    step.calls = 5
    assert budget.learning_ms(step, reset, cfg) is None, "one rollout ends before any learning"

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

def test_the_hidden_planner_sees_what_it_was_trained_with(tiny):
    ablations, world = import_module("ablations"), env.FootstepWorld(2, "mujoco", cores=1)
    planner, _ = kept.policy(common.RESULTS / "mujoco" / "policy.pt", "mujoco")
    world.reset([0, 1])
    world.actions[:, 1] = 0.9, 0.1, 0.2, 0.9, 0.1, 0.8
    measured = world.measure([0, 1])
    hidden = ablations.HiddenPlanner(planner.model).act(world.view([0, 1], measured), [0, 1],
                                                        measured)
    seen = world.observe([0, 1], measured)
    world.close()
    assert not np.allclose(hidden, planner.model.decide(seen), atol=1e-6)
    seen[:, ablations.LATER] = 0
    np.testing.assert_array_equal(hidden, planner.model.decide(seen))

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
    model.sharpness = 4.0  # p(x)^k ∝ exp(−k·z²/2)
    with torch.no_grad():
        sharp = model.policy(obs).stddev[0].numpy()
    np.testing.assert_allclose(sharp, std / 2, rtol=1e-4, err_msg="it must sharpen like the Beta")

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

def test_ours_and_theirs_agree_where_the_ranges_of_their_seeds_overlap():
    study = import_module("stable_baselines")
    _, gaussian, same, apart = study.KINDS
    rows = [{"kind": kind, "seed": seed, "success": success, "fall": fall + 0.001 * seed,
             "time_mean": 5.0 + seed, "learning_ms": learning, "seconds": seconds,
             "curve": [{"steps": 4096, "minutes": 1, "success": 0.5, "fall": 0.0, "time": 9.0}]}
            for seed in range(3) for kind, success, fall, learning, seconds in (
                (gaussian, 0.9 + 0.02 * seed, 0.01, 0.07, 60),
                (same, 0.94 + 0.02 * seed, 0.02, 0.1, 50), (apart, 0.9, 0.01, 0.2, 130))]
    assert [line[-1] for line in study.promises(rows)] == ["yes", "no", "yes", "yes", "no", "yes"]
    assert [line[-2] for line in study.promises(rows)][3:] == ["0.70", "1.20", "0.46"]
    figure = study.plot(rows, "pymunk")
    assert [len(axes.lines) for axes in figure.axes] == [12] * 4, "every training, and the means"
    common.plt.close(figure)

def test_shares_between_mode_and_mean(tiny):
    decision = import_module("decision")
    planner, _ = kept.policy(common.RESULTS / "mujoco" / "policy.pt", "mujoco")
    world = env.FootstepWorld(2, "mujoco", cores=1)
    world.reset([0, 1], goals=np.array([[1.0, 0.5, 1.0], [-1.0, 0.0, 2.0]]))
    view = world.view([0, 1], world.goal)
    world.close()
    mean = planner.act(view, [0, 1], world.goal)
    actions = {share: decision.SharePlanner(planner, share).act(view, [0, 1], world.goal)
               for share in (0.0, 0.5, 1.0)}
    np.testing.assert_allclose(actions[1.0], mean, atol=1e-6, err_msg="the whole share: ours")
    np.testing.assert_allclose(actions[0.5], (actions[0.0] + mean) / 2, atol=1e-6)
    with torch.no_grad():
        raw = torch.nn.functional.softplus(planner.model.actor(
            torch.as_tensor(view.observation[:, : len(env.observation_table())]))).numpy()
    a, b = raw.reshape(2, 2, 6).swapaxes(0, 1)  # α − 1 and β − 1 without sharpness
    np.testing.assert_allclose(actions[0.0], a / (a + b), atol=1e-6, err_msg="the mode")
    np.testing.assert_allclose(mean, (1 + 4 * a) / (2 + 4 * (a + b)), atol=1e-6, err_msg=(
        "the mean of the sharpened Beta, as trained last"))

def test_every_other_world_is_another_one():
    robustness, robot = import_module("robustness"), common.robot_model.RobotModel()
    drawn = []
    for spread, ground in robustness.WORLDS.values():
        body = spread.draw([np.random.default_rng(i) for i in range(3)], robot)
        body.friction = body.friction * 0 + ground.get("friction", body.friction)
        drawn.append(body)
    for body in drawn[1:]:
        same = [np.array_equal(*pair) for pair in zip(vars(drawn[0]).values(), vars(body).values())]
        assert not all(same), "nothing differs"
    np.testing.assert_allclose(drawn[4].stiffness, drawn[0].stiffness * 2 / 3, err_msg="soft")

PAPER = {"fall": 0.0, "time": 20.0, "still_there": 0.98, "planner": 0.99}

def test_tuning_keeps_the_fastest_safe_setting_that_stays(monkeypatch):
    """Here a planner is the share of its successes that stay without noise."""
    baseline = import_module("baseline")
    monkeypatch.setattr(baseline, "both", lambda trials, planner, *_: planner)
    monkeypatch.setattr(baseline, "facts", lambda planner: {"still_there": planner})
    rows = [PAPER | {"time": 9.0}, PAPER | {"time": 8.0, "fall": 0.005},
            PAPER | {"time": 7.0, "fall": 0.006}, PAPER | {"time": 6.0, "still_there": 0.95},
            PAPER | {"time": 5.0, "planner": 0.96},
            PAPER | {"time": None, "still_there": None, "fall": 0.0}]
    best = baseline.choose(None, rows, PAPER)[0]
    assert best is rows[1], "fastest of those with at most 0.5 % falls that stay"
    leaves, rule = baseline.choose(None, [rows[4], PAPER | {"time": 5.5, "planner": 0.9}], PAPER)
    assert leaves is rows[4] and "none stays" in rule, "the fastest, though it leaves without noise"
    safe = baseline.choose(None, rows[2:4], PAPER)[0]
    assert safe is rows[3], "none of the safe ones stays: the fastest of them"
    unsafe = baseline.choose(None, [rows[2], PAPER | {"time": 3.0, "fall": 0.2}], PAPER)[0]
    assert unsafe is rows[2], "no safe one: the one with the fewest falls"

def test_baseline_and_search_are_tuned_and_shipped(tiny, monkeypatch):
    search = import_module("search")  # everybody arrives at once:
    monkeypatch.setattr(env, "Task", partial(env.Task, success_m=9.0, success_rad=4.0))
    make_small(monkeypatch, "baseline")
    make_small(monkeypatch, "search")
    _, planner, _ = evaluate.load(common.RESULTS / "mujoco" / "search.npz", "mujoco")
    limits = env.walk_engine.LIMITS["mujoco"]
    table = search.double_steps(limits, 0.5), planner.moves, planner.value
    monkeypatch.setattr(search, "table", lambda sim, factor: table)
    run("baseline", "--ship", "--mujoco")
    run("search", "--ship", "--mujoco")
    tuned = common.read_json(common.RESULTS / "mujoco" / "baseline_tuned.json")["settings"]
    assert tuned.keys() == vars(evaluate.BaselineSettings()).keys(), "all eight settings"
    found = common.read_json(common.RUNS / "mujoco" / "baseline.json")
    assert len(found["tried"]) == 6 and tuned in [row["settings"] for row in found["finalists"]]
    assert kept.opponents("mujoco")["baseline_tuned"][1] == tuned
    found = common.read_json(common.RUNS / "mujoco" / "search.json")["finalists"][0]
    assert kept.opponents("mujoco")["search"][0].change == found["change"]

def test_promises_are_compared_with_the_means_over_the_seeds():
    seeds, names = import_module("seeds"), ("policy", "baseline")
    rows, std = [], seeds.STD
    for far, noise in seeds.BLOCKS:
        for name, seed, success in [(names[0], k, 0.994 + 0.001 * k) for k in range(3)] + [
                (names[1], None, 1.0)]:
            rows.append({"planner": name, "seed": seed, "noise": noise, "goal_std_m": std[far],
                         "success": success, "fall": 0.005, "still_there": 0.96,
                         "time_mean": 7.0, "over_baseline_tuned": 0.9})
    ground = [{"planner": "policy", "seed": seed, "noise": True, "goal_std_m": std[far],
               "friction": mu, "fall": 0.009} for far in std for mu in seeds.FRICTIONS
              for seed in range(3)]
    found = {row["what"]: row["kept"] for row in seeds.promises(rows, ground, [1e5, 2e5, None])}
    assert found["success, near, with noise"], "0.995 on average: exactly what is promised"
    assert not found["fall, near, with noise"] and found["fall, far, with noise"]
    assert not found["still there, far, without noise"], "at least 0.97"
    assert found["still there, far, with noise"], "at most 0.02 less than the baseline"
    assert found["time [s], far, with noise"]
    assert not found["time ÷ baseline_tuned, near, without noise"]
    assert not found["fall at the worst μ, near"] and found["fall at the worst μ, far"]
    assert not found["double steps until 98 % succeed while exploring"], "one never did"

def test_the_reference_time_is_that_of_search_s_map(monkeypatch):
    times = import_module("times")
    cells = evaluate.CELL * np.arange(-evaluate.HALF, evaluate.HALF + 1)
    value = np.tile(np.minimum(np.abs(cells[:, None]) / 0.2, evaluate.FAR) + 0 * cells, (36, 1, 1))
    period = env.walk_engine.WalkEngine(1, env.walk_engine.TUNED["pymunk"]).period
    # The start seen from a goal that looks along y: what was ahead is beside it.
    goals = np.array([[1.0, 0, 0], [0, 0.6, np.pi / 2], [0, 0, 0], [4.0, 0, 0]])
    steps = times.reference(goals, "pymunk", SimpleNamespace(value=value)) / period
    np.testing.assert_allclose(steps, (5, 3, 1, np.nan), atol=1e-6, err_msg=(
        "0.2 m a double step: 5, 3; at the goal one is walked; beyond the map nothing is known"))

def test_trials_without_far_goals_are_refused(tiny):
    asked = {0.5: evaluate.draw_trials(0, 2)}
    ended = {name: np.zeros(2) for name in ("friction", "time", "steps", "still_there",
                                            "reached_once", "time_once")}
    results = {("policy", True, 0.5): ended | {"outcome": np.array(["fall", "success"])}}
    path = common.RESULTS / "pymunk" / "trials.csv"
    evaluate.write_trials(path, asked, results)
    with pytest.raises(common.StudyError, match="--noise --far"):
        import_module("times").read_trials(path)

@SIMS
def test_the_map_of_falls_knows_what_is_easy_and_what_is_impossible(sim, monkeypatch):
    limits = import_module("limits")
    monkeypatch.setattr(common.robot_model, "CORES", 1)
    monkeypatch.setattr(limits, "REPEATS", 2)
    monkeypatch.setattr(limits, "PLANS", 4)
    easy, wild = np.zeros((1, 2, 3)), np.tile([0.5, 0.0, 0.0], (1, 2, 1))
    shares = limits.fall_map(sim, np.concatenate([easy, easy, wild]),
                             np.concatenate([easy, wild, wild]))
    assert shares.tolist() == [0, 1, 1], "on the spot; suddenly 0.5 m; always 0.5 m"
    assert limits.standing(sim, 0.01) == 1.0, "a load of almost nothing is a step on the spot"

def test_what_is_allowed_in_a_map_is_what_an_action_can_ask_for():
    limits, title = import_module("limits"), "forward and turning"
    bounds = env.walk_engine.StepLimits(low=(-0.1, -0.1, -0.3), high=(0.2, 0.1, 0.6), load=1.5)
    steps = limits.cells(title, [0.0, 0.1, 0.2, 0.25], [0.0, 0.15, 0.3, 0.45])  # yaw, x
    assert limits.allowed(steps, bounds).tolist() == [
        [True, True, True, False],  # yaw 0
        [True, True, True, False],  # 0.15: half of what the inward foot can turn; 1 + 0.5
        [True, True, False, False],  # 0.3: all of it; with half of x 1.5, with all of it 2
        [False, False, False, False]]  # outward for one foot, but inward for the other

def test_a_decision_takes_time(monkeypatch):
    decision_time, world = import_module("decision_time"), env.FootstepWorld(2, "mujoco", cores=1)
    micros = decision_time.decision_time(evaluate.BaselinePlanner(), world, 2)
    world.close()
    assert 1 < micros < 1e6, "[µs]"


# ------------------------------------------------------------------------ ground and kicks
def test_the_ground_s_options_reach_every_robot_and_are_gone_afterwards():
    ground, robot_model = import_module("ground"), common.robot_model
    make, body = robot_model.make_sim, None
    engine = env.walk_engine.WalkEngine(2, ground.TUNED)
    with ground.ground(0, 3.0) as spent:
        sim = robot_model.make_sim("mujoco", 2, engine.stance)
        body = robot_model.Spread().draw(np.random.default_rng(0).spawn(2), engine.robot)
        sim.reset(np.arange(2), body)
        sim.run(engine.plan(np.zeros((2, 2, 3)), [0, 1])[0], np.arange(2))
    sim.close()
    assert [(model.opt.cone, model.opt.impratio) for model in sim.models] == [(0, 3.0)] * 2
    assert spent[0] == 2 and spent[1] > 0, "double steps and seconds"
    assert robot_model.make_sim is make

def test_on_our_ground_a_walk_does_not_care_where_north_is():
    """On MuJoCo's pyramid the same walk ends elsewhere when it starts at another heading."""
    ground, robot_model = import_module("ground"), common.robot_model
    headings, ends = np.radians([0, 45, 90]), []
    engine = env.walk_engine.WalkEngine(3, ground.TUNED)
    plans = [engine.plan(np.tile([[0.06, 0.02, 0.1], [0.06, 0, -0.1]], (3, 1, 1)), range(3))[0]
             for _ in range(6)]
    for cone in ground.CONES.values():
        with ground.ground(cone, 1.0):
            sim = robot_model.make_sim("mujoco", 3, engine.stance)
        half = headings / 2
        sim.state[:, sim.TURN] = [  # turn · lean of the start
            [np.cos(h) * w, -np.sin(h) * y, np.cos(h) * y, np.sin(h) * w]
            for h, (w, _, y, _) in zip(half, sim.state[:, sim.TURN])]
        for plan in plans:
            pose = sim.run(plan, np.arange(3)).torso[:, -1, [0, 1, 5]]
        sim.close()
        back = np.stack([0 * headings, 0 * headings, -headings], -1)  # seen from the start
        ends.append(np.ptp(robot_model.compose(back, pose)[:, :2], axis=0).max())  # [m]
    pyramid, ours = ends
    assert ours < 0.01, f"{ours:.3f} m apart: is friction isotropic?"
    assert pyramid > 0.01, "the test sees no difference between the two cones"

def flying(kicks, low, high, seed=0):
    """A world of three robots high above the ground."""
    world = kicks.kicked(env.FootstepWorld(3, "mujoco", cores=1), low, high)
    world.reset(np.arange(3), [np.random.default_rng([seed, i]) for i in range(3)])
    world.sim.state[:, world.sim.PLACE] += 0, 0, 50.0
    return world

def test_a_kick_has_the_impulse_that_it_promises(monkeypatch):
    """In the air nothing else pushes sideways: the whole robot's momentum is m·Δv."""
    import mujoco

    kicks = import_module("kicks")
    monkeypatch.setattr(kicks, "BETWEEN", 0.01)  # [s] a kick in every double step
    world = flying(kicks, 0.3, 0.3)
    world.step(np.tile(world.neutral_action, (3, 1)), np.arange(3))
    assert not world.sim.since.any(), "all were kicked in this double step"
    world.close()
    momentum = []
    for model, state in zip(world.sim.models, world.sim.state):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = np.split(state[1:], [model.nq])
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        momentum.append(data.subtree_linvel[1, :2] * model.body_subtreemass[1])
    np.testing.assert_allclose(np.hypot(*np.transpose(momentum)),
                               0.3 * world.engine.robot.torso.mass, rtol=0.02)
    angles = np.arctan2(*np.transpose(momentum))
    assert np.ptp(angles) > 0.1, "in different directions"

def test_kicks_are_as_frequent_as_promised_and_depend_on_the_trial_only():
    kicks, steps = import_module("kicks"), 124
    sims = [flying(kicks, 0.0, 0.4).sim for _ in range(2)]
    forces = np.array([sims[0].forces(np.arange(3), steps) for _ in range(600)])  # [600, 3, S, 2]
    alone = np.array([sims[1].forces(np.array([1]), steps) for _ in range(600)])
    np.testing.assert_array_equal(forces[:, 1], alone[:, 0], err_msg="whoever else walks")
    for sim in sims:
        sim.close()
    pushed = np.abs(forces).max(-1) > 0  # [600, 3, S]
    share = pushed.any(-1).mean()
    assert share == pytest.approx(sims[0].period / kicks.BETWEEN, abs=0.03), "one in 3 s"
    assert set(pushed.sum(-1).ravel()) == {0, 10}, "50 ms are 10 steps of physics, all within"
    size = np.hypot(*np.moveaxis(forces, -1, 0)).max(-1)[pushed.any(-1)]
    largest = 0.4 * sims[0].robot.torso.mass / kicks.LASTS
    assert 0.9 * largest < size.max() <= largest and size.min() < 0.1 * largest
    moments = pushed.argmax(-1)[pushed.any(-1)]
    assert moments.min() < 12 and moments.max() > steps - 10 - 12, "at any moment"

def test_without_a_kick_it_is_the_same_simulator():
    kicks, ends = import_module("kicks"), []
    for change in (lambda world: world, lambda world: kicks.kicked(world, 0.0, 0.0)):
        world = change(env.FootstepWorld(2, "mujoco", cores=1))
        world.reset([0, 1], [np.random.default_rng(i) for i in range(2)])
        for _ in range(3):
            world.step(np.tile(world.neutral_action, (2, 1)), np.arange(2))
        world.close()
        ends.append(world.pose.copy())
    np.testing.assert_array_equal(*ends)

def test_kicked_policies_are_trained_and_judged(tiny, monkeypatch):
    monkeypatch.setattr(ppo, "PPOConfig", partial(ppo.PPOConfig, num_envs=2, rollout=4))
    make_small(monkeypatch, "kicks")
    run("kicks", "--mujoco")
    rows = common.read_json(common.RUNS / "mujoco" / "kicks.json")["rows"]
    falls = {(row["planner"], row["speed"]): row["fall"] for row in rows}
    for name in ("policy", "policy_imu"):
        assert falls[name, 0.0] < falls[name, 3.0], "whoever is kicked with 3 m/s falls"
    for row in rows:
        falls = round(row["fall"] * row["episodes"])
        assert sum(row["falls_after"].values()) == falls, "every fall has its kick"
        if row["speed"] == 3.0:
            *soon, later = row["falls_after"].values()
            assert sum(soon) > later, "a kick of 3 m/s is felt at once"
