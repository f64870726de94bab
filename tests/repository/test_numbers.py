"""The numbers in the sentences of the pages are those of the files in results/.

Sentences are written by hand. An item of a list, or a paragraph that begins with *Found.*, ends with
a mark if it has a number; other paragraphs may have one:

    - The robot falls in 21 of 2,000 walks. <!-- kicks: pushed -->

NUMBERS has for each mark the numbers of its sentence in the same order, also in lists; shares in
percent.
"""

import re
from decimal import Decimal
from functools import cache

import baseline
import common
import kicks
import ladder
import numpy as np
import pytest
import seeds
import transfer
import walk
from common import PER_SET, RESULTS, ROOT, STD, env, pick, ppo, robot_model, values

PAGES = "README.md", "results/README.md", "results/mujoco/README.md", "results/pymunk/README.md"
TEXTS = {page: (ROOT / page).read_text("utf-8") for page in PAGES}
MARK = re.compile(r"<!-- ([^<>]+: [^<>]+) -->$")
NO_NUMBER = re.compile(r"<!--.*?-->|`.*?`|\[.*?\]\(.*?\)|[23]-D|stages? \d|^\d+\. ")
NUMBER = re.compile(r"−?\d+(?:,\d{3})*(?:\.\d+)?(?:e-\d+)?")


# ------------------------------------------------------------------------ the checker
def blocks(text):
    """Items of lists and paragraphs, each in one line; without generated tables and code."""
    text = re.sub(r"<!-- (\w+) -->\n.*?<!-- end -->|```.*?```", "", text, flags=re.DOTALL)
    return [" ".join(block.split()) for block in re.split(r"\n\s*\n|\n(?=- |\d+\. |</)", text)]


def agree(shown, value):
    """Is this the value, rounded to as many decimals as are shown?"""
    number = Decimal(shown.replace(",", "").replace("−", "-"))
    unit = 10.0 ** number.as_tuple().exponent
    return abs(float(number) - value) <= 0.500001 * unit


def mistakes(texts, numbers):
    """What is wrong in these pages (texts by name), a line each; numbers: as NUMBERS."""
    seen = []
    for page, block in ((page, block) for page, text in texts.items() for block in blocks(text)):
        shown, mark = NUMBER.findall(NO_NUMBER.sub(" ", block)), MARK.search(block)
        where = f"{page}: “{block}”"
        if mark is None:
            if shown and re.match(r"- |\d+\. |\*Found\.\*", block):
                yield (
                    f"{where} has numbers: end it with a mark, <!-- study: what -->, and put into "
                    "NUMBERS of test_numbers.py from which file they come"
                )
            continue
        seen.append(mark[1])
        if mark[1] not in numbers:
            yield f"{where}: its mark is not in NUMBERS of test_numbers.py"
            continue
        wanted = np.concatenate([*map(np.ravel, numbers[mark[1]]())]).tolist()
        if len(shown) != len(wanted):
            yield f"{where} shows the numbers {shown}, but NUMBERS has {wanted}"
            continue
        for one, value in zip(shown, wanted):
            if not agree(one, value):
                yield f"{where} shows {one}, but it is {value:.6g}: does the sentence still hold?"
    yield from (f"no page has <!-- {mark} --> of NUMBERS" for mark in {*numbers} - {*seen})
    yield from (f"<!-- {mark} --> is there twice" for mark in {*seen} if seen.count(mark) > 1)


@pytest.mark.parametrize("text, complaint", [
    ("- In 3-D (stage 4) 2,000 walks\n  take −3.4 s. <!-- a: b -->\n- [1](2) `3`\n\nOf 7.", ""),
    ("*Found.* 2,000 walks take −3.4 s. <!-- a: b -->\n- Well.\n\n<!-- t -->\n- 5\n<!-- end -->", ""),
    ("1. With 2,000.0 s: −3.449. <!-- a: b -->", "shows −3.449, but it is -3.4382"),
    ("- 2,000 s, −3.43 s. <!-- a: b -->", "shows −3.43, but it is -3.4382"),
    ("- 2,000 s, 3.4 s. <!-- a: b -->", "shows 3.4, but it is -3.4382"),
    ("- 2,001 s, −3 s. <!-- a: b -->", "shows 2,001, but it is 2000"),
    ("- 2e-06 s, −3 s. <!-- a: b -->", "shows 2e-06, but it is 2000"),
    ("- 2,000 s, −3.4 and 1 s. <!-- a: b -->", "shows the numbers ['2,000', '−3.4', '1']"),
    ("Of 2,000. <!-- a: b -->", "shows the numbers ['2,000'], but NUMBERS has [2000.0, -3.4382]"),
    ("- 2,000 s, −3.4 s. <!-- a: b -->\n- Of 7.", "“- Of 7.” has numbers: end it with a mark"),
    ("- 2,000 s, −3.4 s. <!-- a: b -->\n\n*Found.* 7", "“*Found.* 7” has numbers: end it with"),
    ("- 2,000 s, −3.4 s. <!-- a: b --> More.", "has numbers: end it with a mark"),
    ("- 2,000 s, −3.4 s. <!-- a: b -->\n- 7. <!-- a: c -->", "its mark is not in NUMBERS"),
    ("Nothing.", "no page has <!-- a: b -->"),
    (2 * "- 2,000 s, −3.4 s. <!-- a: b -->\n", "<!-- a: b --> is there twice"),
])  # fmt: skip
def test_a_wrong_number_or_a_missing_mark_is_found(text, complaint):
    found = "\n".join(mistakes({"page.md": text}, {"a: b": lambda: [2000, -3.4382]}))
    assert complaint in found if complaint else not found, found


# ------------------------------------------------------------------------ the numbers
@cache
def read(sim, name):
    return common.read_json(RESULTS / sim / f"{name}.json")


def study(name, sim="mujoco"):
    return read(sim, f"studies/{name}")


def rows(name, part, sim="mujoco", **wanted):
    """The rows of a study's part with these values."""
    return pick(study(name, sim)[part]["rows"], **wanted)


def column(key, *part, **wanted):
    return values(rows(*part, **wanted), key)


def fallen(*part, **wanted):
    """In how many walks of these rows the robot fell, and of how many."""
    return [sum(column(key, *part, **wanted)) for key in ("falls", "episodes")]


def percent(*shares):
    return [100 * share for share in shares]


def ends(numbers):
    return [min(numbers), max(numbers)]


def evaluated(sim, key, **wanted):
    return values(read(sim, "evaluation")["rows"], key, noise=True, **wanted)


def saved(sim, std, other="baseline_tuned"):
    """How much less time the policy takes than another planner, and its interval [%]."""
    wanted = {"noise": True, "goal_std_m": std, "reference": other}
    (row,) = pick(read(sim, "evaluation")["ratios"], **wanted)
    low, high = row["time_ratio_ci95"]
    return percent(1 - row["time_ratio"], 1 - high, 1 - low)


def least_and_most_saved():
    """How much less time all trainings take than either opponent, and to how many goals more [%]."""
    names = "baseline_tuned", "expert"
    saved = ends([of_all(other, std)[0] for std in STD.values() for other in names])
    ratios = pick(read("mujoco", "evaluation")["ratios"], noise=True, reference="baseline_tuned")
    return [*saved, percent(*ends(values(ratios, "slower")))]


def mass():
    robot = robot_model.RobotModel()
    leg = robot.hip, robot.thigh, robot.shin, robot.foot
    return robot.torso.mass + 2 * sum(link.mass for link in leg)


def training(sim):
    _, about = ppo.load_policy(RESULTS / sim / "policy.pt")
    return [about["steps"], about["seed"]]


def tuned_walk():
    found = rows("walk", "tune")
    points, falls = values(found, "points"), values(found, "falls")
    best = np.argmin(points)
    return [walk.BUDGET, points[1:], points[0], falls[best], falls[0], 4 * walk.FRESH]


def chosen(part, sim="mujoco"):
    return pick(study("baseline", sim)[part]["finalists"], chosen=True)[0]


def planners_and_policies():
    """Times and falls of the chosen planners, the policies and the paper's settings [s, %]."""
    tuned, expert = chosen("baseline_tuned"), chosen("expert")
    assert tuned["fall"] == expert["fall"], "the sentence gives both the same number"
    policies = rows("baseline", "policy")
    kept = [*filter(baseline.keeps, policies)]
    times, falls = (ends(values(kept, key)) for key in ("time", "fall"))
    walked = study("baseline")["expert"]["trials"]
    found = [tuned["time"], expert["time"], 100 * tuned["fall"], walked]
    found += [len(policies), len(kept), times]
    return [*found, percent(*falls), study("baseline")["paper"]["time"]]


def planners_of_the_plane():
    """In 2-D: times of tuned, `expert`, policies; falls with pushes [%]; ends of searches, worse ones."""
    found, parts = study("baseline", "pymunk"), ("baseline_tuned", "expert")
    starts_and_ends = [found[part]["finalists"] for part in parts]
    assert not any(map(baseline.keeps, sum(starts_and_ends, []))), "a sentence says so"
    both = [chosen(part, "pymunk") for part in parts]
    policies = rows("baseline", "policy", "pymunk")
    (own,) = pick(policies, chosen=True)
    times = values(both, "time") + [len(policies), *ends(values(policies, "time"))]
    fresh = [
        evaluated("pymunk", "episodes", planner="policy")[0],
        -saved("pymunk", NEAR, "expert")[0],
    ]
    far = saved("pymunk", FAR, "expert")
    assert far[1] < 0 < far[2], "a sentence says that both take as long"
    worse = [
        baseline.points(end) > baseline.points(start)
        for start, *searches in starts_and_ends
        for end in searches
    ]
    pushed = percent(*values([*both, own], "pushed"))
    return [times, fresh, pushed, len(worse), sum(worse)]


def four_searches():
    _, *three, _ = study("baseline")["baseline_tuned"]["finalists"]
    times, falls = values(three, "time"), values(three, "fall")
    asked = 100 * (baseline.STAYS + baseline.MORE)
    return [times, 100 * three[0]["still_far"], percent(*falls[1:]), asked]


def at(distance, name):
    (row,) = rows("seeds", "distances", planner=name, distance=distance)
    return row["time_mean"]


def distances():
    """Near by and far away, the policy and both opponents."""
    names = "policy", "baseline_tuned", "expert"
    close, near = ([d, *(at(d, name) for name in names)] for d in (0.25, 2.0))
    until = [d for d in seeds.DISTANCES if at(d, names[0]) <= at(d, names[1]) + 0.02][-1]
    later = [d for d in seeds.DISTANCES if d > until]
    assert all(at(d, "policy") <= at(d, "expert") + 0.02 for d in seeds.DISTANCES)
    assert all(at(d, names[1]) < min(at(d, names[0]), at(d, names[2])) for d in later)
    slower = at(later[-1], names[0]) - at(later[-1], names[1])
    return [until, close, near, later[0], later[-1], slower]


def far_falls(name):
    walked = rows("seeds", "distances", planner=name)
    return sum(row["falls"] for row in walked if row["distance"] >= seeds.FAR)


def far():
    falls = study("seeds")["distances"]["falls"]
    found = [far_falls(name) for name in ("policy", "baseline_tuned")]
    assert not far_falls("expert"), "the sentence says never"
    return [falls["walks"], seeds.FAR, found, falls["p"]]


def plan():
    wanted = {"distance": 2.0, "planner": seeds.EXACT}
    (exact,) = rows("seeds", "distances", **wanted)
    noisy = column("time_mean", "seeds", "distances", **wanted | {"planner": "policy"})
    return [2, exact["plan"], exact["time_mean"], noisy]


def of_all(other, std, part="seeds"):
    """How much less time the policies of a part take together than another planner, and its interval
    [%]."""
    over = study("seeds")[part]["over"]
    (row,) = pick(over, other=other, goal_std_m=std, push=0.0)
    low, high = row["ratio_ci95"]
    return percent(1 - row["ratio"], 1 - high, 1 - low)


def trained():
    """How many trainings there are, and how much less time they take than `baseline_tuned` [%]."""
    ratios = column(
        "over_baseline_tuned", "seeds", "seeds", planner="policy", push=0.0, goal_std_m=FAR
    )
    less, more = percent(1 - max(ratios), 1 - min(ratios))
    tuned = [of_all("baseline_tuned", std) for std in (FAR, NEAR)]
    return [len(ratios), PER_SET, less, more, tuned[0], PER_SET, tuned[1]]


def falls_of_all(part, push):
    """Of the policies of a part, and of their opponents."""
    names = "policy", "expert", "baseline_tuned"
    return [fallen("seeds", part, planner=name, push=push) for name in names]


def pooled():
    """To how many goals, then how much less time than the opponents; far, then near."""
    found, names = [], ("baseline_tuned", "expert")
    for std in (FAR, NEAR):
        found.append([study("seeds")["pooled"]["goals"]])
        found += [of_all(name, std, "pooled") for name in names]
    return found


def pooled_falls():
    """In all walks; then with pushes, of how many, and p of the policy and `expert`."""
    ((own, walks), (expert, _), (tuned, _)) = falls_of_all("pooled", 0.0)
    assert own == expert
    (policy, count), *others = falls_of_all("pooled", 0.4)
    (test,) = pick(study("seeds")["pooled"]["over"], push=0.4, other="expert")
    others = [falls for falls, _ in others]
    return [walks, own, tuned, 0.4, policy, count, *others, test["falls"][0]["p"]]


def pooled_for_readme():
    far, tuned, expert, near, *less = pooled()
    walks, never, fell, *_ = pooled_falls()
    assert not never, "the sentence says never"
    return [*far, tuned, expert, *near, less, 95, walks, fell]


def pushed_for_readme():
    _, _, _, push, policy, count, expert, tuned, _ = pooled_falls()
    return [push, EVERY, policy, count, tuned, expert, pushed()[2][-1]]


def error_over_claimed(number):
    found = rows("seeds", "estimate", filter=[*seeds.FILTERS][number])
    return ends([row[f"{axis}_ratio"] for row in found for axis in seeds.AXES])


def pushed():
    steps = {"push": 0.4}
    names = "all", "reflex alone", "open loop"
    return [0.4, EVERY, [fallen("kicks", "steps", **steps, answer=name) for name in names]]


def hard():
    names = "policy", "baseline_tuned", "expert"
    first, *others = (fallen("kicks", "pushes", planner=name, speed=0.6) for name in names)
    return [0.6, EVERY, first, [falls for falls, _ in others]]


def in_worlds(*names):
    return np.sum([fallen("kicks", "worlds", world=name) for name in names], 0)


def slow():
    """Times to near and far goals with noise that lasts; then that of an ideal walker, estimated."""
    names = "policy", "expert", "baseline_tuned"
    times = [
        column("time_mean", "kicks", "worlds", world=kicks.SLOW, planner=name) for name in names
    ]
    return [*np.transpose(times), 7]


def without(name):
    """How much more time the walks take without this part: near and far, in 3-D and in 2-D [%]."""
    found = (
        column("time_over_all", "ladder", "without", sim, without=name)
        for sim in ("mujoco", "pymunk")
    )
    return [100 * (ratio - 1) for ratios in found for ratio in ratios]


def pendulum():
    found = rows("ladder", "pendulum", "pymunk")
    *others, last = (ends(ladder.last_returns(found, name)) for name in ladder.PENDULUM)
    return [60_000, others, 0, last]  # λ = 0


def rungs(key, planner="policy", in_a_row=2, noise=True):
    """Of these planners, all whose names begin so, on every rung: a list for each."""
    found = []
    for rung in ladder.RUNGS:
        walked = rows("ladder", "rungs", rung=rung, noise=noise, in_a_row=in_a_row)
        found.append([row[key] for row in walked if row["planner"].startswith(planner)])
    return found


def first_rung():
    """By the paper's rule of a success: times, ÷ `baseline`'s, there, falls, of how many, there."""
    own, walks = rungs("time_mean", in_a_row=1)[0], common.PER_SET
    slow, falls = (rungs(key, "baseline", 1)[0][0] for key in ("time_mean", "falls"))
    assert falls == 0, "a sentence says so"
    shares = percent(np.mean(own) / slow, 6.35 / 11.43)  # Table II, with noise
    fell = sum(rungs("falls", in_a_row=1)[0])
    return [len(own), ends(own), shares, fell, len(own) * walks, 0, walks, 11, 6, walks]


def tuned_there(key):
    return rungs(key, "baseline_tuned", 1)[0][0]


def what_is_reproduced():
    slow, _ = rungs("time_mean", "baseline", 1)[0]
    return [*first_rung()[2], 100 * tuned_there("time_mean") / slow]


def up_the_ladder():
    """By our rule: times before the walk answers, then; on the last rung; falls there."""
    times, falls = (rungs(key) for key in ("time_mean", "falls"))
    answers = [*ladder.RUNGS].index("answers to a lean")
    before = ends(sum(times[:answers], []))
    count = len(times[-1])
    last = [count, *ends(times[-1]), sum(falls[-1]), count * common.PER_SET]
    return [before, times[answers], last]


def speed():
    alone, *others = rows("cluster", "speed")
    actors = [[int(row["training"].split()[0]), row[STEPS_PER_S]] for row in others]
    return [[count for count, _ in actors], alone[STEPS_PER_S], actors]


def elsewhere(case, push=0.0, planner="policy"):
    """The row of far walks in another model or engine."""
    wanted = {"case": case, "push": push, "planner": planner, "goal_std_m": FAR}
    parts = study("transfer").values()
    return pick([row for part in parts for row in part["rows"]], **wanted)[-1]


def count(key, *case):
    row = elsewhere(*case)
    return [row[key] * row["episodes"], row["episodes"]]


def engines():
    return [
        column("time_mean", "transfer", "bullet", case=case, planner=planner, **CALM_FAR)
        for planner in ("policy", "expert", "baseline_tuned")
        for case in (transfer.BULLET, transfer.OWN)
    ]


def mended():
    case = transfer.MENDED
    off = [f"{case}, {name}" for name in transfer.OFF]
    expert = [elsewhere(name, planner="expert")["falls"] for name in off]
    falls = [count("fall", *which) for which in ((case, 0.4), (case,), *([one] for one in off))]
    return [count("success", case), 0.4, falls, expert]


def another_robot():
    """OP3, to far goals: falls of the policy and its opponents, and how much more time it takes [%]."""
    own, *others = (
        elsewhere("OP3", planner=name) for name in ("policy", "expert", "baseline_tuned")
    )
    assert own["falls"] == 0, "a sentence says never"
    more = [100 * (own[f"over_{name}"] - 1) for name in ("expert", "baseline_tuned")]
    return [own["episodes"], *values(others, "falls"), *np.abs(more)]


def wrong_zeros():
    """Times with zeros of σ 1°, shares of arrivals with those of 2°; with all three planners."""
    names = "policy", "expert", "baseline_tuned"
    once, twice = ([elsewhere(case, planner=name) for name in names] for case in transfer.ZEROS)
    times, arrived = values(once, "time_mean"), values(twice, "success")
    return [2 * ZERO, ZERO, times, 4 * ZERO, percent(*arrived)]


NEAR, FAR = STD.values()
CALM_FAR = {"push": 0.0, "goal_std_m": FAR}
EVERY = env.Task.push_every  # [s]
ZERO = np.degrees(env.Spread.zero / 3**0.5)  # [°] σ of a number in ± zero
STEPS_PER_S = "double_steps_per_second"
NUMBERS = {
    "evaluation: 2-D": lambda: [
        evaluated("pymunk", "time_mean", planner=name, goal_std_m=NEAR)
        for name in ("policy", "baseline_tuned", "baseline", "expert")
    ],
    "seeds: headline": least_and_most_saved,
    "by hand: feet": lambda: [87, 100, 100, 10.9, 2.9],  # README has the commands
    "by hand: pushes": lambda: [100, 22, 12, 22, 10],
    "robot: mass": lambda: [mass(), 7.5],
    "task: goals": lambda: [
        evaluated("mujoco", "episodes", planner="policy"),
        [NEAR, FAR],
        env.Task.in_a_row,
        100 * env.Task.success_m,
        np.degrees(env.Task.success_rad),
        env.Task.time_limit,
    ],
    "task: noise": lambda: [100 * env.Task.noise_m, np.degrees(env.Task.noise_rad)],
    "mujoco: policy": lambda: [training("mujoco"), 22],  # minutes
    "pymunk: policy": lambda: [training("pymunk"), 9],
    "walk: limits": lambda: [
        100 * study("walk")["limits"]["stood"],
        walk.RANDOM,
        1000 * study("walk")["limits"]["clearance"][0],  # [mm]
        5,
        1000 * study("walk")["limits"]["clearance"][1],
    ],
    "walk: tune": tuned_walk,
    "baseline: times": planners_and_policies,
    "baseline: 2-D": planners_of_the_plane,
    "baseline: four searches": four_searches,
    "baseline: before": lambda: [study("baseline")["baseline_tuned"]["finalists"][0]["time"]],
    "search: times": lambda: evaluated("mujoco", "time_mean", planner="search"),
    "seeds: distances": distances,
    "seeds: far": far,
    "seeds: 6 m": lambda: distances()[-3:],
    "seeds: plan": plan,
    "seeds: trainings": trained,
    "seeds: trainings, expert": lambda: [of_all("expert", std) for std in (FAR, NEAR)],
    "seeds: falls": lambda: [trained()[0], *falls_of_all("seeds", 0.0)],
    "seeds: pooled": pooled,
    "seeds: README": pooled_for_readme,
    "seeds: pooled falls": pooled_falls,
    "seeds: estimate": lambda: [error_over_claimed(0), error_over_claimed(1)],
    "kicks: README": pushed_for_readme,
    "kicks: camera": lambda: slow()[0][::2],
    "kicks: pushed": pushed,
    "kicks: blocks": lambda: [
        [1000 * own["highest"], *in_worlds(name)] for name, own in kicks.BLOCKS.items()
    ],
    "kicks: floors": lambda: [
        in_worlds("μ = 0.4", "μ = 0.7", "μ = 1.0"),
        in_worlds("μ = 0.3 (trained: 0.4 to 1.0)", "μ = 1.2", "masses ± 20 % (± 10 %)"),
    ],
    "kicks: hard": hard,
    "kicks: slow": slow,
    "kicks: gyro": lambda: [
        [
            column("time_mean", "kicks", "worlds", planner="policy", world=world, goal_std_m=NEAR)
            for world in ("a gyro ten times worse", kicks.TRAINED)
        ],
        percent(*column("fall", "kicks", "worlds", world="a gyro ten times worse")),
    ],
    "kicks: zeros": lambda: column(
        "time_mean", "kicks", "worlds", world=[*kicks.WORLDS][-1], goal_std_m=FAR
    ),
    "ladder: first rung": first_rung,
    "ladder: tuned there": lambda: [
        tuned_there("time_mean"),
        tuned_there("falls"),
        common.PER_SET,
    ],
    "ladder: answers": up_the_ladder,
    "ladder: README": what_is_reproduced,
    "ladder: critic": lambda: [0, without("critic (V = 0)")],
    "ladder: clipping": lambda: without("clipping (ε = ∞)"),
    "ladder: λ": lambda: [1, np.multiply([-1, -1, 1, 1], without("λ below 1 (λ = 1)"))],
    "ladder: r_c": lambda: [
        np.negative(without("r_c")),
        [
            *fallen("ladder", "without", without="r_c"),
            fallen("ladder", "without", without="nothing")[0],
        ],
    ],
    "ladder: action before": lambda: np.negative(without("action before the last")),
    "ladder: worlds": lambda: np.negative(without("random worlds in training")),
    "ladder: pendulum": pendulum,
    "peers: training": lambda: column("time_mean", "peers", "training", "pymunk"),
    "cluster: speed": speed,
    "transfer: models": lambda: [
        count("success", transfer.BULLET),
        count("success", transfer.PUBLISHED),
    ],
    "transfer: engines": engines,
    "transfer: answers": mended,
    "transfer: OP3": another_robot,
    "transfer: README": lambda: [0, another_robot()[:3], another_robot()[4]],
    "transfer: zeros": wrong_zeros,
}


@pytest.mark.shipped
def test_the_numbers_of_the_pages_are_those_of_the_files():
    found = [*mistakes(TEXTS, NUMBERS)]
    assert not found, "\n".join(found)
