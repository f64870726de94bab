"""A number in a sentence of README.md or results/README.md belongs to a key behind its paragraph:

    The robot falls in 21 of 2,000 walks, so in 1 % of them. <!-- kicks.pushed -->

`numbers` has what may be told for each key: measured, read from results/*.json, or a setting of the
code. In which order and words a paragraph tells it is free. A share or a ratio may be told in
percent, also what it lacks to 1 or has more. Tables are generated, so nothing in a table counts;
nor does what stands in `code`, in a link, or in a name like 3-D, stage 2 or seed 0.
"""

import re

import common
import numpy as np
import pytest
from common import PER_SET, RESULTS, ROOT, STD, env, pick, ppo, robot_model, values

MOST = {"README.md": 60, "results/README.md": 40}  # numbers in sentences: more are a table
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
def study(name, part):
    """What a study in 3-D has written about one of its parts."""
    return common.read_json(RESULTS / "mujoco" / "studies" / f"{name}.json")[part]


def rows(name, part, **wanted):
    """The rows of a study's part with these values."""
    return pick(study(name, part)["rows"], **wanted)


def falls(found):
    """Falls of each of these rows, and of how many walks."""
    return [values(found, "falls"), values(found, "episodes")]


def numbers():
    """What may be told for every key, in the units of the pages."""
    task = env.Task()
    _, policy = ppo.load_policy(RESULTS / "mujoco" / "policy.pt")
    evaluation = common.read_json(RESULTS / "mujoco" / "evaluation.json")
    exact = {"noise": False, "goal_std_m": STD[True]}
    search = {"reference": "search", "noise": True}
    fell = values(pick(evaluation["rows"], **exact), "fall")
    (random,) = rows("walk", "limits", map="1,000 random plans")
    (tuned,) = rows("baseline", "baseline_tuned", chosen=True)
    calm = rows("seeds", "pooled", push=0.0, planner="baseline_tuned")
    trained = rows("seeds", "seeds", push=0.0, planner="policy")
    compared = rows("baseline", "policy")  # the same five, 2,000 walks each
    pushed = rows("seeds", "pooled", push=0.4)  # the policy comes last
    lead = {
        part: values(study("seeds", part)["over"], "ratio", push=0.0, other="baseline_tuned")
        for part in ("pooled", "seeds")
    }
    first = rows("ladder", "rungs", rung="the paper's", in_a_row=1)
    times = np.array(values(first, "time_mean"))
    unanswered = rows("ladder", "rungs", rung="our learning", in_a_row=1)[1:]  # without `baseline`
    peers = common.read_json(RESULTS / "pymunk" / "studies" / "peers.json")["training"]["rows"]
    peers = np.array(values(peers, "time_mean")).reshape(2, 3, 2)  # near and far, seed, learner
    op3 = rows("transfer", "op3", push=0.0)
    return {
        "by.hand": [22, 38, 2, 13, 100],  # in no file
        "task.goals": [STD.values(), PER_SET, task.in_a_row, 100 * task.success_m]
        + [np.degrees(task.success_rad), task.time_limit],
        "task.impulse": [0.4, 0.4 * robot_model.RobotModel().torso.mass],
        "training": [1024, 25_600, policy["steps"]],
        "evaluation.exact": [PER_SET, np.multiply(PER_SET, fell)],
        "walk.limits": [random["fall_inside"], random["clearance, median [mm]"]],
        "baseline.times": [*values(rows("baseline", "paper"), "time"), tuned["time"]],
        "seeds.pooled": [lead["pooled"], *(sum(counts) for counts in falls(calm))],
        "seeds.trainings": lead["seeds"],
        "seeds.falls": [
            sum(values(trained, "falls")) + 2000 * sum(values(compared, "fall")),
            sum(values(trained, "episodes")) + 2000 * len(compared),
            *map(sum, falls(calm)),
        ],
        "seeds.pushed": falls(pushed),
        "seeds.lead": values(pushed[-1:], "over_baseline_tuned"),
        "kicks.capture": falls(rows("kicks", "steps", push=0.6)),
        "kicks.steps": falls(rows("kicks", "steps", push=0.4)),
        "seeds.far": [
            # From where on the policy is later, without pairs
            min(
                one["distance"]
                for one, other in zip(
                    rows("seeds", "distances", planner="policy"),
                    rows("seeds", "distances", planner="baseline_tuned"),
                )
                if one["time_mean"] - other["time_mean"]
                > 1.96 * np.hypot(one["time_std"], other["time_std"]) / one["episodes"] ** 0.5
            ),
        ],
        "seeds.estimate": max(
            max(row["x_ratio"], row["y_ratio"]) for row in rows("seeds", "estimate")
        ),
        "evaluation.search": np.divide(1, values(evaluation["ratios"], "time_ratio", **search)),
        "ladder.first": [
            times / times[0],
            times[2:].mean() / times[0],
            [6.35 / 11.43, 11.43, times[0]],  # the paper's Table II
            falls(first),
        ],
        "ladder.unanswered": [*map(sum, falls(unanswered))],
        "peers": np.divide(*peers.mean(1).T),
        "transfer": [falls(op3), op3[0]["over_baseline_scaled"], 100, 2],  # of PyBullet; degrees
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
