"""A number in a sentence of README.md or results/README.md belongs to a key behind its paragraph:

    The robot falls in 21 of 2,000 walks, so in 1 % of them. <!-- kicks.pushed -->

`numbers` has what may be told for each key: measured, read from results/*.json, or a setting of the
code. In which order and words a paragraph tells it is free. A share or a ratio may be told in
percent, also what it lacks to 1 or has more. Tables are generated, so nothing in a table counts;
nor does what stands in `code`, in a link, or in a name like 3-D, stage 2 or seed 0.
"""

import re

import baseline
import common
import kicks
import ladder
import numpy as np
import pytest
import seeds
import walk
from common import PER_SET, RESULTS, ROOT, STD, env, pick, ppo, robot_model, values, walk_engine

MOST = {"README.md": 76, "results/README.md": 287}  # numbers in sentences: more are a table
NO_SENTENCE = re.compile(r"```.*?```|^(?:    |\||#|<(?!!)).*?$", re.DOTALL | re.MULTILINE)
NAME = re.compile(
    r"<!--.*?-->|`.*?`|\[[^]]*\]\([^)]*\)|^\d+\. |[23]-D|95 % interval"
    r"|(?:stage|lesson|lines?|Python|MuJoCo|seed) [\d.]+(?:(?: to| and) [\d.]+)?"
)
NUMBER = re.compile(r"(?<!\w)−?\d+(?:,\d{3})*(?:\.\d+)?(?!\w)")


# ------------------------------------------------------------------------ the checker
def paragraphs(text):
    """Returns (paragraph, its numbers as they are shown) for every paragraph and item of a list."""
    blocks = re.split(r"\n\s*\n|\n(?=- |\d+\. )", NO_SENTENCE.sub("", text))
    told = [" ".join(block.split()) for block in blocks]
    return [(one, NUMBER.findall(NAME.sub(" ", one))) for one in told]


def flat(value):
    """All numbers in lists of lists."""
    return sum(map(flat, value), []) if np.iterable(value) else [float(f"{value:.6g}")]


def agree(shown, value):
    """Is this the value, or its percentage, rounded to as many decimals as are shown?"""
    number = float(shown.replace(",", "").replace("−", "-"))
    half = 0.500001 / 10 ** len(shown.partition(".")[2])
    return min(abs(number - x) for x in (value, 100 * value, 100 * abs(1 - value))) <= half


def mistakes(text, known):
    """The numbers of a page that belong to no key of their paragraph, a line each."""
    for paragraph, shown in paragraphs(text):
        keys = re.findall(r"[\w.]+", " ".join(re.findall("<!--(.*?)-->", paragraph)))
        own = {key: flat(known.get(key, [])) for key in keys}
        for number in shown:
            if not any(agree(number, value) for value in flat(own.values())):
                yield f"{number} belongs to no key of “{paragraph}”, which say {own}"


@pytest.mark.parametrize("text, wrong", [
    ("1. In 3-D it takes −3.4 s\n  in 2,000 walks, `9`. <!-- a.b -->\n\n    5\n\n| 6 |", []),
    ("- Of 20.0 % [7, 2,000], or 80 %, [a link](7). <!-- a.c, a.b -->", ["7"]),
    ("It is −3.43, 3.4 and 2,001. <!-- a.b -->", ["−3.43", "3.4", "2,001"]),
    ("- 7 <!-- a.b -->\n- 7 <!-- a.c -->\n- 7 <!-- a.d -->\n\n*Found.* 7", ["7"] * 4),
])  # fmt: skip
def test_a_number_that_belongs_to_no_key_of_its_paragraph_is_found(text, wrong):
    found = [*mistakes(text, {"a.b": [2000, [-3.4382]], "a.c": 0.2})]
    assert [line.split()[0] for line in found] == wrong, found


# ------------------------------------------------------------------------ the numbers
OPPONENTS = "baseline_tuned", "expert"


def part_of(name, part, sim="mujoco"):
    """What a study has written about one of its parts."""
    return common.read_json(RESULTS / sim / "studies" / f"{name}.json")[part]


def rows(name, part, keys, sim="mujoco", **wanted):
    """What a study's rows with these values have under these keys, a list for each key."""
    return [values(part_of(name, part, sim)["rows"], key, **wanted) for key in keys.split()]


def falls(name, part, **wanted):
    """Falls and walks of the rows with these values, of each and of all together."""
    each = rows(name, part, "falls episodes", **wanted)
    return [each, [sum(own) for own in each]]


def evaluated(sim, part="rows", key="time_mean", **wanted):
    """What the rows of stage 5's table with these values have under this key, with noise."""
    found = common.read_json(RESULTS / sim / "evaluation.json")[part]
    return values(found, key, noise=True, **wanted)


def over(part):
    """Times of policies over those of other planners to the same goals, and the intervals."""
    found = pick(part_of("seeds", part)["over"], push=0.0)
    return [values(found, key) for key in ("ratio", "ratio_ci95")]


def finalists(sim):
    """What the study `baseline` has measured of all whom it compared; how many are policies, and how
    many of these keep the rule."""
    policies = part_of("baseline", "policy", sim)["rows"]
    found = [part_of("baseline", "paper", sim), *policies]
    for part in OPPONENTS:
        found += part_of("baseline", part, sim)["finalists"]
    known = [values(found, key) for key in ("time", "fall", "pushed", "still_far")]
    return [*known, len(policies), sum(map(baseline.keeps, policies))]


def first_rung():
    """By the paper's rule of a success: times, those over the time of `baseline`, and falls."""
    there = {"rung": "the paper's", "noise": True, "in_a_row": 1}
    (times,) = rows("ladder", "rungs", "time_mean", **there)
    fell = [falls("ladder", "rungs", planner=f"policy {seed}", **there)[1] for seed in range(3)]
    return [times, np.divide(times, times[0]), falls("ladder", "rungs", **there), np.sum(fell, 0)]


def transferred(part, keys="time_mean falls episodes", **wanted):
    """`rows` of far walks in another model or engine."""
    return rows("transfer", part, keys, goal_std_m=STD[True], **wanted)


def numbers():
    """What may be told for every key, in the units of the pages."""
    task, robot, limits = env.Task(), robot_model.RobotModel(), part_of("walk", "limits")
    leg, tick = (robot.hip, robot.thigh, robot.shin, robot.foot), robot.control_dt
    double_step = 2 * walk_engine.TUNED["mujoco"].step_ticks * tick
    _, policy = ppo.load_policy(RESULTS / "mujoco" / "policy.pt")
    distances, pooled = part_of("seeds", "distances"), part_of("seeds", "pooled")
    last = {row["planner"]: row["time_mean"] for row in pick(distances["rows"], distance=6.0)}
    far = [row for row in distances["rows"] if row["distance"] >= seeds.FAR]
    floors = [falls("kicks", "worlds", world=f"μ = {mu}")[1] for mu in (0.4, 0.7, 1.0)]
    return {
        "by.hand": [2, 0.2, 0, 1, 12, 87, 100, 10.9, 2.9, 22, 10, 7.5, 1.3, 7, 8, 5],  # in no file
        "task.goals": [STD.values(), PER_SET, task.in_a_row, 100 * task.success_m]
        + [np.degrees(task.success_rad), task.time_limit],
        "task.noise": [100 * task.noise_m, np.degrees(task.noise_rad)],
        "task.pushes": [kicks.SPEEDS, task.push_every, 1000 * walk_engine.PUSH_TICKS * tick],
        "robot.mass": robot.torso.mass + 2 * sum(link.mass for link in leg),
        "training.steps": [1024, 25_600, policy["steps"], ladder.STEPS.values(), double_step],
        "evaluation.plane": evaluated("pymunk"),
        "evaluation.space": evaluated("mujoco"),
        "evaluation.slower": evaluated("mujoco", "ratios", "slower", reference="baseline_tuned"),
        "walk.limits": [limits["stood"], walk.RANDOM, np.multiply(1000, limits["clearance"])],
        "walk.tune": [walk.BUDGET, 4 * walk.FRESH, rows("walk", "tune", "points falls")],
        "baseline.rule": [baseline.MAX_FALLS, baseline.MAX_PUSHED, baseline.STAYS]
        + [baseline.STAYS + baseline.MORE, baseline.BUDGET, common.PER_FALL / 100],
        "baseline.space": [part_of("baseline", "expert")["trials"], finalists("mujoco")],
        "baseline.plane": [PER_SET, finalists("pymunk")],
        "seeds.distances": rows("seeds", "distances", "distance time_mean plan")
        + [last["policy"] - last["baseline_tuned"]],
        "seeds.far": [
            seeds.FAR,
            distances["falls"].values(),
            sum(values(far, "falls", planner="baseline_tuned")),
        ],
        "seeds.pooled": [pooled["goals"], 2 * pooled["goals"], over("pooled")],
        "seeds.falls": [falls("seeds", "pooled", push=push) for push in (0.0, 0.4)]
        + [falls("seeds", "pooled", push=0.0, planner="baseline_tuned")]
        + [row["falls"][0]["p"] for row in pooled["over"]],
        "seeds.trainings": [5, PER_SET, over("seeds")]
        + rows("seeds", "seeds", "over_baseline_tuned", push=0.0, planner="policy"),
        "seeds.trainings.falls": [
            falls("seeds", "seeds", push=0.0, planner=name) for name in ("policy", *OPPONENTS)
        ],
        "seeds.estimate": rows("seeds", "estimate", "x_ratio y_ratio yaw_ratio"),
        "kicks.pushes": falls("kicks", "pushes", speed=0.6),
        "kicks.steps": falls("kicks", "steps", push=0.4),
        "kicks.blocks": [[5, 10], *(falls("kicks", "worlds", world=name) for name in kicks.BLOCKS)],
        "kicks.floors": [13, PER_SET, 2 * PER_SET, 0, np.sum(floors, 0)],
        "kicks.slow": rows("kicks", "worlds", "time_mean", world=kicks.SLOW),
        "kicks.others": [
            rows("kicks", "worlds", "time_mean fall", planner="policy", world=name)
            for name in (kicks.TRAINED, "a gyro ten times worse", [*kicks.WORLDS][-1])
        ],
        "ladder.first": [first_rung(), 3, 6.35 / 11.43, 11, 6],  # the paper's Table II
        "ladder.rungs": rows("ladder", "rungs", "time_mean", in_a_row=2, noise=True),
        "ladder.without": [0, 1, falls("ladder", "without", without="r_c")]
        + [rows("ladder", "without", "time_over_all", sim) for sim in ("mujoco", "pymunk")],
        "ladder.pendulum": [
            ladder.last_returns(part_of("ladder", "pendulum", "pymunk")["rows"], name)
            for name in ladder.PENDULUM
        ],
        "peers.training": rows("peers", "training", "time_mean", "pymunk"),
        "cluster.speed": [1, 2, 4, rows("cluster", "speed", "double_steps_per_second")],
        "transfer.engines": transferred("bullet", push=0.0),
        "transfer.team": [transferred("urdf"), 0.4],
        "transfer.op3": [
            transferred("op3", push=0.0),
            transferred("op3", "over_expert over_baseline_tuned", push=0.0, planner="policy"),
        ],
        "transfer.zeros": [0.5, 1, 2, transferred("zeros", "time_mean success", push=0.0)],
    }


def test_every_key_is_needed():
    told = "".join((ROOT / page).read_text("utf-8") for page in MOST)
    assert not [key for key in numbers() if key not in told], "no sentence needs them any more"


@pytest.mark.shipped
@pytest.mark.parametrize("page", MOST)
def test_the_numbers_of_a_page_belong_to_its_keys(page):
    text = (ROOT / page).read_text("utf-8")
    found = [*mistakes(text, numbers())]
    assert not found, "\n".join([f"{page} (tests/README.md says what keys are):", *found])
    count = sum(len(shown) for _, shown in paragraphs(text))
    assert count <= MOST[page], f"{count} numbers in sentences of {page}: a table can have some"
