"""What is each part of PPO worth? Five learners swing up a pendulum, a task without a robot.

    python tests/studies/ladder.py [--out FOLDER]

pendulum: the learner of stage 4, and four that lack a part of it; five seeds each. The task is that
of `tests/exercises/starters/pendulum.py`, which draws a student's own curve over these.

A training that is finished stays in runs/Pendulum-v1/studies/ladder until you delete it.
"""

import json
import sys
from dataclasses import replace
from itertools import product

import common
import numpy as np
from common import ppo, robot_model, values

sys.path.append(str(common.ROOT / "tests" / "exercises" / "starters"))
import pendulum

DURATION = "6 minutes on one core"
STEPS, SEEDS = 60_000, range(5)  # of every learner


class NoCritic(ppo.ActorCritic):
    """V = 0 everywhere."""

    def value(self, obs):
        return 0 * super().value(obs)


def kept(path, measure, *args, **settings):
    """What measure returns, plain values; the file keeps it, for when the study is started again."""
    if not path.is_file():
        robot_model.write_text(path, json.dumps(ppo.plain(measure(*args, **settings))))
    return common.read_json(path)


def cut_off_is_end(model, optimizer, data, cfg):
    """`improve` of a learner that takes the end of the time for a fall."""
    data["terminated"] = data["terminated"] | data["truncated"]
    return ppo.improve(model, optimizer, data, cfg)


PENDULUM = {  # what differs from stage 4 on a task without a robot
    "complete": {},
    "no critic (V = 0)": {"make_model": NoCritic},
    "a cut-off taken for an end": {"improve": cut_off_is_end},
    "no clipping (ε = ∞)": {"clip": 1e9},
    "λ = 0": {"lam": 0.0},
}


def swung(folder, seed, make_model=ppo.ActorCritic, improve=ppo.improve, **changes):
    """The log of a training on Pendulum, plain values; changes: of the settings."""
    config = replace(pendulum.CONFIG, **changes)
    learner = {"make_model": make_model, "improve": improve}
    return ppo.train(config, pendulum.gym_envs, folder, STEPS, seed, **learner)[1]


def study_pendulum(args):
    """The return of every training, after each update in which episodes ended."""
    rows = []
    for name, seed in product(PENDULUM, SEEDS):
        folder = common.work("Pendulum-v1", "ladder", f"{name}_{seed}")
        log = kept(folder / "rows.json", swung, folder, seed, **PENDULUM[name])
        ended = [row for row in log if row["return"] == row["return"]]  # else it is nan
        returns = [round(row["return"], 2) for row in ended]
        row = {"learner": name, "seed": seed, "steps": values(ended, "steps"), "return": returns}
        rows.append(row)
    return rows


PARTS = {"pendulum": study_pendulum}


def last_returns(rows, name):
    """The mean of the last three returns of each training of a learner."""
    return [np.mean(returns[-3:]) for returns in values(rows, "return", learner=name)]


def table(found):
    """The learners: the mean over their trainings, the worst and the best one."""
    lines = []
    for name in PENDULUM:
        last = last_returns(found["pendulum"]["rows"], name)
        line = {"learner": name, "return": np.mean(last), "worst": min(last), "best": max(last)}
        lines.append(line)
    columns = {"learner": 0, "return": 1, "worst": 1, "best": 1}
    return f"### pendulum\n\n{common.table(lines, columns)}\n"


def plot(found, sim):
    """What each learner's return does on Pendulum."""
    figure, axes = common.subplots(figsize=(8, 4.5))
    pendulum.draw_learners(axes, found["pendulum"]["rows"])
    axes.legend(loc="upper left")
    axes.set_title("PPO swings up a pendulum: mean of five seeds, 95 % intervals")
    return figure


if __name__ == "__main__":
    common.start("ladder")
