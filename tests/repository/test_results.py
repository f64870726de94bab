"""The shipped evidence: complete, of the shipped planners, and rightly told in words."""

import json
import re
import subprocess
import sys
from functools import cache
from importlib import import_module
from itertools import product
from pathlib import Path

import baseline
import common
import judge
import numpy as np
import PIL.Image
import pytest
from test_scripts import check_picture

evaluate = import_module("05_evaluate")
env = evaluate.env
ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "results"
LONGEST = {
    "README.md": 170,
    "results/STUDIES.md": 220,  # lines
    "results/pymunk/README.md": 115,
    "results/mujoco/README.md": 115,
}
TEXTS = {page: (ROOT / page).read_text(encoding="utf-8") for page in LONGEST}
README, STUDIES = TEXTS["README.md"], TEXTS["results/STUDIES.md"]
EVERY_SIM = pytest.mark.parametrize("sim", ("pymunk", "mujoco"))


def shipped(sim, name):
    return common.read_json(RESULTS / sim / name)


@cache
def shipped_trials(sim):
    """The columns of trials.csv by (planner, noise, σ of the goals)."""
    return common.read_trials(RESULTS / sim / "trials.csv")


def ends(planner, trials, sim="pymunk", noise=False):
    """How these trials end."""
    with common.world(sim, num_robots=len(trials.goals), noise=noise, cores=1) as world:
        return evaluate.evaluate(planner, world, trials)


# ------------------------------------------------------------------------ numbers in words
def values(rows, key, **wanted):
    """What the rows with these values have under a key."""
    return [row[key] for row in common.pick(rows, **wanted)]


def share(part, digits=0):
    """0.031 as 3 %."""
    return f"{100 * np.mean(part):.{digits}f} %"


def said_of_the_rivals():
    """The policy against planners that do not learn, in 3-D, with noise."""
    rows = shipped("mujoco", "evaluation.json")["rows"]
    policy, paper, tuned = (
        values(rows, "time_mean", planner=name, noise=True, goal_std_m=0.5)[0]
        for name in ("policy", "baseline", "baseline_tuned")
    )
    yield (
        f"reaches near goals in {policy:.1f} s on average. The paper's controller takes "
        f"{paper:.1f} s in the same world, and {tuned:.1f} s after tuning"
    )
    walks = shipped_trials("mujoco")
    both = {
        name: common.together([walks[name, True, std] for std in (0.5, 1.0)])
        for name in ("policy", "baseline_tuned", "expert")
    }
    for other in ("baseline_tuned", "expert"):
        ratio = evaluate.time_ratio(both["policy"], both[other])
        yield (
            f"{ratio['time_ratio']:.2f} of the time of `{other}` on average, and "
            f"{ratio['median']:.2f} in the median; it is slower in {share(ratio['slower'])} of "
            "the walks"
        )


def said_of_the_studies():
    """Falls, pushes, steps and opponents in 3-D, with noise."""
    seeds, kicks, tuned, walk = (
        shipped("mujoco", f"studies/{name}.json") for name in ("seeds", "kicks", "baseline", "walk")
    )
    pooled = seeds["pooled"]
    near, far = (values(pooled["rows"], "falls", goal_std_m=std)[0] for std in (0.5, 1.0))
    yield (
        f"In {pooled['goals']:,} walks to near goals and {pooled['goals']:,} to far ones the "
        f"policy fell {near} and {far} times"
    )
    trainings = common.pick(seeds["seeds"]["rows"], planner="policy")
    ratios = [row["over_expert"] for row in trainings]
    walks = sum(row["episodes"] for row in trainings)
    yield (
        f"They need {min(ratios):.2f} to {max(ratios):.2f} of the time of `expert`. All five "
        f"together fell {sum(row['falls'] for row in trainings)} times in {walks:,} walks"
    )
    times, falls = (
        [
            values(seeds["distances"]["rows"], key, planner=name)
            for name in ("policy", "expert", "baseline_tuned")
        ]
        for key in ("time_mean", "fall")
    )
    first = np.sum(np.argmin(times, 0) == 0)
    yield (
        f"The policy is the fastest of the three at {first} of {len(times[0])} distances."
        " At 6 m it needs {:.1f} s, `expert` {:.1f} s and `baseline_tuned` {:.1f} s; there they "
        "fall in {}, {} and {} of the walks".format(
            *(own[-1] for own in times), *(share(own[-1], 1) for own in falls)
        )
    )
    pushed = {
        reflex: values(kicks["pushes"]["rows"], "fall", speed=0.4, planner="policy", reflex=reflex)[
            0
        ]
        for reflex in (True, False)
    }
    yield (
        f"pushed by 0.4 m/s every 3 s the policy falls in {share(pushed[True], 1)} of the far "
        f"walks with the reflex and in {share(pushed[False], 1)} without"
    )
    quiet = values(kicks["pushes"]["rows"], "fall", speed=0.0, planner="policy", reflex=False)[0]
    yield f"Without pushes and without the reflex it falls in {share(quiet, 1)}"
    worlds = kicks["worlds"]["rows"]
    for names in (
        ("μ = 0.4", "μ = 0.7", "μ = 1.0"),
        ("μ = 0.3 (trained: 0.4 to 1.0)", "μ = 1.2", "masses ± 20 % (± 10 %)"),
    ):
        rows = [row for row in worlds if row["world"] in names]
        yield (
            f"{sum(row['falls'] for row in rows)} of {sum(row['episodes'] for row in rows):,} walks"
        )
    near, far = values(worlds, "time_mean", world="noise of the goal lasts for seconds")
    yield f"arrives, but takes {near:.1f} s to near and {far:.1f} s to far goals"
    near, far = (
        share(fall, 1) for fall in values(worlds, "fall", world="pushed by 0.4 m/s every 3 s")
    )
    yield f"{near} of the near and {far} of the far walks with such pushes"
    yield f"{share(walk['limits']['stood'], 1)} of 1,000 random plans within the limits stand"
    median, lowest = (1000 * height for height in walk["limits"]["clearance"])  # [mm]
    yield f"by {median:.1f} mm in the median. The 5th percentile is {lowest:.1f} mm".replace(
        "-", "−"
    )
    (time,) = values(tuned["baseline_tuned"]["finalists"], "time", chosen=True)
    yield (
        f"needs {time:.1f} s for near and far goals together, the paper's settings "
        f"{tuned['baseline_tuned']['paper']['time']:.1f} s"
    )
    yield f"`expert` needs {values(tuned['expert']['finalists'], 'time', chosen=True)[0]:.1f} s"
    rows = shipped("mujoco", "evaluation.json")["rows"]
    near, far = values(rows, "time_mean", planner="search", noise=True)
    yield f"needs {near:.1f} s to near and {far:.1f} s to far goals"
    steady = walk["limits"]["forward and turning"]
    yield (
        f"{share(steady['fall_inside'])} of the walks forward and turning fall within the "
        f"limits, and {share(steady['fall_anywhere'])} anywhere on the map"
    )


def said_of_learning():
    """Ablations, other implementations, speed."""
    short = shipped("pymunk", "studies/ablations.json")["ablations"]["rows"]
    distance, angle = (values(short, "success", variant=f"without r_{name}") for name in "da")
    assert sum(row["success"] < 1 for row in short) == sum(x < 1 for x in distance + angle), (
        "all other variants arrive"
    )
    yield (
        f"the mean success is {share(distance)} without the reward for distance and "
        f"{share(angle)} without the one for the angle"
    )
    plain, sharp = (
        np.mean(values(short, "time_mean", variant=name)) for name in ("no sharpening", "reference")
    )
    yield f"without sharpening the walks take {plain:.1f} s, with it {sharp:.1f} s"
    found = shipped("mujoco", "studies/ablations.json")
    for name, words in (
        ("reference", "The shipped recipe"),
        ("decides by the mode (paper)", "the mode"),
        ("rollouts of 32", "the shorter rollouts"),
        ("rollouts of 32, s_c 0.2", "those with twice the price"),
    ):
        near, far, pushed = (
            {
                key: np.mean(
                    values(found["choices"]["rows"], key, variant=name, goal_std_m=std, push=push)
                )
                for key in ("time_mean", "still_there", "fall")
            }
            for std, push in ((0.5, 0.0), (1.0, 0.0), (1.0, 0.4))
        )
        yield (
            f"{words}: {near['time_mean']:.2f} and {far['time_mean']:.2f} s, still there "
            f"{near['still_there']:.2f} and {far['still_there']:.2f}, falls "
            f"{share([near['fall'], far['fall']], 2)}, pushed {share(pushed['fall'], 1)}"
        )
    for name, words in (
        ("reference", "the shipped policy"),
        ("with IMU", "the one with the IMU"),
        ("without the reflex", "the one without the reflex"),
    ):
        calm, pushed = common.pick(found["long"]["rows"], variant=name, goal_std_m=1.0)
        yield (
            f"{words} needs {calm['time_mean']:.1f} s to far goals and falls in "
            f"{share(calm['fall'], 1)} of the walks, pushed in {share(pushed['fall'], 1)}; its "
            f"critic explains {share(calm['critic'])} of the variance"
        )
    usual, blind, _ = values(found["long"]["rows"], "time_mean", goal_std_m=1.0, push=0.0)
    yield f"needs {blind:.1f} s to far goals instead of {usual:.1f} s"
    peers = shipped("mujoco", "studies/peers.json")["sb3"]["rows"]
    ours, theirs = (
        values(peers, "time_mean", kind=kind) for kind in ("ours, Gaussian", "SB3, the same robots")
    )
    assert min(ours) < max(theirs) and min(theirs) < max(ours), "their seeds overlap"
    yield f"walks take {np.mean(ours):.1f} s and those of Stable-Baselines3 {np.mean(theirs):.1f} s"
    yield "has {} of the speed of bare physics in 3-D and {} on the plane".format(
        *(
            share(values(shipped(sim, "studies/benchmark.json")["rows"], "ratio", robots=64))
            for sim in ("mujoco", "pymunk")
        )
    )
    stops = shipped("mujoco", "studies/benchmark.json")["stops_ratio"]
    yield f"the stops for the gyro leave {share(stops)} of the speed"


def said_of_the_world():
    """The task, what is drawn, the robot."""
    task, spread, robot = env.Task(), env.Spread(), env.robot_model.RobotModel()
    walks = len(shipped_trials("mujoco")["policy", True, 0.5]["x"])
    yield (
        f"{walks} walks in 3-D to near and as many to far goals (σ of x and y: "
        f"{task.goal_std_m} m and {task.far_std_m:.0f} m)"
    )
    yield f"an error of {100 * task.noise_m:.0f} cm and {np.degrees(task.noise_rad):.0f}°"
    yield (
        f"within {100 * task.success_m:.0f} cm and {np.degrees(task.success_rad):.0f}° of the "
        f"goal, in at most {task.time_limit:.0f} s"
    )
    yield (
        f"friction μ ({robot.friction - spread.friction:.1f} to "
        f"{robot.friction + spread.friction:.1f}), masses (± {share(spread.mass)}), motor "
        f"stiffness (± {share(spread.stiffness)}), joint friction (up to {spread.stiction} N m) "
        f"and delay (up to {1000 * spread.delay * robot.control_dt:.0f} ms)"
    )
    leg = robot.hip, robot.thigh, robot.shin, robot.foot
    yield f"robot weighs {robot.torso.mass + 2 * sum(link.mass for link in leg):.1f} kg"


def test_numbers_in_words_are_those_of_the_files():
    """Of README's text and its findings, and of the paragraphs *Found* in STUDIES.md."""
    readme, studies = (" ".join(text.split()) for text in (README, STUDIES))
    found = re.findall(r"\*Found\.\* (.*?) (?=\*Not|Table)", studies)
    assert len(found) == STUDIES.count("\n## ") - 1, "the last part is no study"
    found = " ".join([readme.split("## What we found")[1].split(" ## ")[0], *found])
    for said in (said_of_the_rivals, said_of_the_studies, said_of_learning, said_of_the_world):
        for words in said():
            assert words in readme or words in studies, f"no page says: … {words} …"
            found = found.replace(words, "")
    found = re.sub(r"`[^`]*`|3-D|95 % t-interval|Baselines3", "", found)
    assert not re.findall(r".{0,50}\d.{0,50}", found), "numbers that are not in the files"


# ------------------------------------------------------------------------ pages
def test_tables_of_pages_are_those_of_the_files():
    for path, text in common.pages().items():
        assert path.read_text(encoding="utf-8") == text, (
            f"{path.relative_to(ROOT)} has an old table: run python tests/studies/common.py"
        )


@pytest.mark.parametrize("page", LONGEST)
def test_pages_are_short_and_their_links_work(page):
    text = TEXTS[page]
    assert len(text.splitlines()) <= LONGEST[page], "take something away"
    for link in re.findall(r'\]\(([^)#]+)|src="([^"]+)"', text):
        path = "".join(link)
        assert path.startswith("https://") or (ROOT / page).parent.joinpath(path).is_file(), (
            f"{page} leads to {path}, which is not there"
        )


def test_the_planner_of_readme_gets_there(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(re.search(r"```python\n(.*?)```", README, re.DOTALL)[1], encoding="utf-8")
    ended = ends(evaluate.load_planner(file), evaluate.draw_trials(1, 6))
    assert (ended["outcome"] == "success").sum() >= 5, "an example should work"


# ------------------------------------------------------------------------ the table
@EVERY_SIM
def test_table_and_evaluation_are_of_one_run_and_meet_their_targets(sim):
    evaluation = shipped(sim, "evaluation.json")
    rows = {(row["planner"], row["noise"], row["goal_std_m"]): row for row in evaluation["rows"]}
    table = (RESULTS / sim / "table.md").read_text(encoding="utf-8")
    assert table == evaluate.table(evaluation["rows"], evaluation["ratios"])
    assert evaluation["goals"] == evaluation["friction"] == "drawn" and evaluation["sim"] == sim
    names = "policy", "baseline", "baseline_tuned", "search", "expert"
    kinds = [*product((False, True), (0.5, 1.0))]  # noise, σ of the goals [m]
    assert set(rows) == {(name, *kind) for name in names for kind in kinds}, (
        "--noise --far --planner expert.py search.py"
    )
    assert all(row["episodes"] >= 500 for row in rows.values())
    for kind in kinds:
        policy, paper, tuned, *_ = (rows[name, *kind] for name in names)
        assert policy["success"] >= float(evaluate.PAPER["policy", False].split(" | ")[0]), kind
        if sim == "mujoco":  # on the plane, with noise, the baseline stays more often
            assert policy["still_there"] >= paper["still_there"] - 0.02, "it leaves, others stay"
        assert policy["time_mean"] < min(paper["time_mean"], tuned["time_mean"])


@EVERY_SIM
def test_evaluation_agrees_with_its_trials(sim):
    """Everything in evaluation.json is computed again; trials.csv has times with two decimals."""
    found, runs = shipped(sim, "evaluation.json"), shipped_trials(sim)
    rows = [evaluate.summary(*key, ended, env.Task()) for key, ended in runs.items()]
    again = json.loads(json.dumps(rows + evaluate.compare(runs)))  # tuples become lists
    for old, new in zip(found["rows"] + found["ratios"], again, strict=True):
        assert old.keys() == new.keys()
        for name, value in new.items():
            exact = value is None or isinstance(value, str)
            assert old[name] == (value if exact else pytest.approx(value, rel=1e-9)), name


@EVERY_SIM
def test_all_planners_had_the_same_goals_and_ground(sim):
    seed, runs = shipped(sim, "evaluation.json")["seed"], shipped_trials(sim)
    for (_, _, std), own in runs.items():
        count = len(own["x"])
        drawn = evaluate.draw_trials(seed, count, std == env.Task.far_std_m)
        goals = np.column_stack([own[name] for name in ("x", "y", "yaw")])
        np.testing.assert_allclose(goals, drawn.goals, atol=1e-12)
        assert own["trial"].tolist() == [*range(count)] and (own["seed"] == seed).all()
        np.testing.assert_array_equal(own["mu"], runs["policy", False, 0.5]["mu"])


@EVERY_SIM
def test_lines_of_the_shipped_trials_can_be_repeated(sim):
    """Two walks of the policy: the same end; to the bit only on the machine that made them."""
    trials = evaluate.draw_trials(shipped(sim, "evaluation.json")["seed"], 2)
    ended = ends(common.policy(RESULTS / sim / "policy.pt", sim), trials, sim, noise=True)
    want = shipped_trials(sim)["policy", True, 0.5]
    assert ended["outcome"].tolist() == want["outcome"][:2].tolist()
    np.testing.assert_allclose(ended["friction"], want["mu"][:2])


# ------------------------------------------------------------------------ planners, figures
@EVERY_SIM
def test_shipped_policy_reaches_new_goals(sim):
    with common.world(sim, num_robots=1, cores=1) as world:
        planner, facts = evaluate.load_policy(RESULTS / sim / "policy.pt", world)
    facts["file"] = f"results/{sim}/policy.pt"
    assert facts == shipped(sim, "evaluation.json")["policy"], "another file now: evaluate again"
    ended = ends(planner, evaluate.draw_trials(1, 24), sim)  # not those of the shipped table
    # With a true rate of 0.97, fewer than 20 of 24 happen once in 3000 runs.
    assert np.sum(ended["outcome"] == "success") >= 20
    assert np.mean(ended["time"]) < 10.0, "a good policy needs about four seconds"


@pytest.mark.parametrize(
    "path", [*RESULTS.rglob("policy.pt")], ids=lambda path: path.relative_to(RESULTS).as_posix()
)
def test_every_shipped_policy_fits_and_its_page_is_right(path, capsys):
    sim, *folders, _ = path.relative_to(RESULTS).parts
    with common.world(sim, num_robots=1, cores=1) as world:
        _, facts = evaluate.load_policy(path, world)
    assert "note" not in capsys.readouterr().out, "it was trained in another world than this one"
    assert facts["imu"] == ("imu" in folders)
    assert facts["steps"] >= 500_000, "too short"
    if "seeds" not in folders:
        words = f"{facts['steps']:,} double steps, seed {facts['seed']}, {facts['minutes']:.0f} min"
        assert words in " ".join(TEXTS[f"results/{sim}/README.md"].split()), words


@pytest.mark.parametrize(
    "sim, part", [("mujoco", "baseline_tuned"), ("mujoco", "expert"), ("pymunk", "baseline_tuned")]
)
def test_the_opponents_were_tuned_by_a_rule(sim, part):
    """The study says by which, and what else was tried; test_studies has the rule."""
    found = shipped(sim, "studies/baseline.json")[part]
    (chosen,) = common.pick(found["finalists"], chosen=True)
    own = baseline.expert.Settings()
    constants = [*own.top, *own.change, own.together, own.gain]
    assert chosen["settings"] | {"share": True} == vars(evaluate.TUNED_BASELINE[sim]) or (
        [*chosen["settings"].values()] == constants
    )
    assert found["trials"] >= 2000 and len(found["tried"]) >= 100
    stays = chosen["still_there"] >= found["paper"]["still_there"] - baseline.LESS
    assert ("none" in found["rule"]) == (not stays or chosen["fall"] > baseline.MAX_FALLS)
    assert (RESULTS / sim / "search.npz").stat().st_size <= 500_000


def test_shipped_files_show_something_and_have_a_study():
    for path in RESULTS.glob("*/studies/*"):
        assert (ROOT / "tests" / "studies" / f"{path.stem}.py").is_file(), f"{path}: no study"
    for path in RESULTS.rglob("*.png"):
        check_picture(path)
    for path in RESULTS.rglob("*.gif"):
        with PIL.Image.open(path) as film:
            assert film.n_frames > 10, path


# ------------------------------------------------------------------------ the contest
def test_who_never_arrives_or_leaves_is_disqualified():
    """All else about points is compared with the shipped ranking in test_ledger."""
    row = {
        "time_mean": 5.0,
        "fall": 0.01,
        "timeout": 0.02,
        "still_there": 0.8,
        "walks": [["success", "success"], [5.0, 6.0]],
    }
    never, leaves = row | {"time_mean": None, "still_there": None}, row | {"still_there": 0.6}
    rows = {"never.py": [never] * 2, "leaves.py": [row, leaves], "good.py": [row] * 2}
    best, *others = judge.ranking(rows).splitlines()[2:]
    assert "good.py" in best and ["disqualified" in line for line in others] == [True, True]


def test_contestants_of_one_name_are_refused(tmp_path, monkeypatch, capsys):
    for name in ("ada", "bob"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "mine.py").touch()
    monkeypatch.setattr("sys.argv", ["judge.py", str(tmp_path / "ada"), str(tmp_path / "bob")])
    with pytest.raises(SystemExit) as stop:
        judge.main()
    assert stop.value.code == 2 and "name of its own" in capsys.readouterr().err


@pytest.mark.slow
def test_the_leaderboard_ranks_all_files_of_a_folder(tmp_path):
    """A good planner, and one that raises: the other ones are ranked all the same."""
    planner = re.search(r"```python\n(.*?)```", README, re.DOTALL)[1]
    (tmp_path / "good.py").write_text(planner, encoding="utf-8")
    (tmp_path / "bad.py").write_text("raise ValueError('of mine')", encoding="utf-8")
    command = [sys.executable, judge.__file__, tmp_path, "--episodes", "3", "--out", tmp_path]
    done = subprocess.run(command, capture_output=True, encoding="utf-8", check=True)
    assert "of mine" in done.stderr and "bad is left out" in done.stderr
    board = (tmp_path / "leaderboard.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| `(\w+)` ", board, re.MULTILINE)) == {"good", *judge.FIELD}
    assert (tmp_path / "leaderboard.png").stat().st_size > 5000
