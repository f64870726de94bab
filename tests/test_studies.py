"""The studies' own tools: what they hide, keep and count. The studies themselves take hours."""

import json
from importlib import import_module

import numpy as np
import pytest

studies = import_module("studies")
env = studies.env


def test_a_result_is_kept_under_everything_it_depends_on():
    robot = studies.robot_model.RobotModel()
    first = studies.digest(robot, env.Task(), b"policy")
    assert first == studies.digest(studies.robot_model.RobotModel(), env.Task(), b"policy")
    others = [(robot, env.Task(), b"another"), (robot, env.Task(s_fall=7.0), b"policy"),
              (studies.replace(robot, friction=0.4), env.Task(), b"policy")]
    for ingredients in others:
        assert studies.digest(*ingredients) != first, "an old result would be taken for a new one"


def test_hidden_observation_is_the_action_before_the_last_one():
    names = [row[0] for row in env.observation_table()]
    hidden = names[studies.LATER]
    assert len(hidden) == 6 and all("action before" in name for name in hidden)
    envs = studies.HiddenEnv(2, "mujoco", cores=1)
    envs.reset(seed=0)
    for _ in range(2):
        observations, *_ = envs.step(np.full((2, 6), 0.6))
    envs.close()
    assert not observations[:, studies.LATER].any(), "the policy can still see it"
    assert observations[:, 8:14].any(), "the last action must stay visible"


def test_every_reward_term_has_its_ablation():
    zero, still = np.zeros((1, 3)), np.zeros((1, 6))
    terms = env.reward_terms(zero, zero, still, still, np.zeros(1), np.zeros(1))
    for name in terms:
        variant = studies.VARIANTS[f"without {name}"]
        task = studies.replace(env.Task(), **variant["task"])
        without = env.reward_terms(zero + 1, zero + [2, 1, 3], still + 1, still,
                                   np.ones(1), np.ones(1), task)
        assert without[name] == 0, f"the variant 'without {name}' still pays it"
        assert all(without[other] != 0 for other in terms if other != name)


def test_an_interrupted_study_takes_up_its_finished_trials(tmp_path, monkeypatch):
    monkeypatch.setattr(studies, "store", lambda sim: tmp_path)
    monkeypatch.setattr(studies, "PER_SEED", 3)
    asked = []

    class Forward(studies.evaluate.BaselinePlanner):
        def act(self, world, robots, measured):
            asked.append(len(robots))
            return super().act(world, robots, measured)

    planner = Forward(studies.evaluate.BaselineSettings().tuned(3.0, 0.6))
    trials = studies.Trials("pymunk", cores=1)
    first = trials.run("forward", planner, "key", True, count=1)
    decisions = len(asked)
    again = trials.run("forward", planner, "key", True, count=2)
    trials.close()
    assert decisions > 0 and len(asked) > decisions, "the second 3 goals are new"
    assert sum(asked[:decisions]) == first["steps"].sum()
    for key in ("outcome", "time", "goals"):
        np.testing.assert_array_equal(first[key], again[key][: len(first[key])])
    assert not np.array_equal(again["goals"][:3], again["goals"][3:]), "each set has its own goals"


@pytest.mark.parametrize("sim", ["pymunk", "mujoco"])
def test_the_shipped_comparison_of_times_comes_from_the_shipped_trials(sim, monkeypatch):
    published = {}
    monkeypatch.setattr(studies, "publish", lambda sim, name, content, text, figure=None:
                        published.update(text=text, content=content))
    studies.times(sim)
    folder = studies.ROOT / "results" / sim / "studies"
    assert published["text"] == (folder / "times.md").read_text(encoding="utf-8")
    assert published["content"] == json.loads((folder / "times.json").read_text(encoding="utf-8"))


def test_markdown_is_aligned():
    lines = studies.markdown(["a", "long head"], [[1, 2], ["xyz", 4]]).splitlines()
    assert len({len(line) for line in lines}) == 1
    assert lines[2].split("|")[1:3] == [" 1   ", " 2         "]


def test_when_a_training_has_learned():
    curve = [[4000, None], [8000, 0.9], [12000, 0.8], [16000, 0.8], [20000, 1.0]]
    assert studies.learned_after(curve) == 16.0, "the mean of three updates reaches 80 %"
    assert studies.learned_after(curve[:3]) is None, "one lucky update is not enough"
    assert studies.spread([1.0, None, 3.0], 1) == "2.0 (1.0 … 3.0), 1 never"
    assert studies.spread([None, None], 1) == "never"


def test_the_median_seed_is_neither_the_best_nor_the_worst():
    rows = [{"seed": seed, "success": success, "time_mean": time}
            for seed, success, time in ((0, 1.0, 5.0), (1, 1.0, 6.0), (2, 0.9, 4.0))]
    assert studies.median_seed(rows) == 1, "by success first; then the slower one is the worse one"
