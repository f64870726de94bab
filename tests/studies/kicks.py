"""Where does the robot fall? Pushes, other floors, other bodies, other errors.

    python tests/studies/kicks.py [--mujoco] [--only worlds | steps | unanswered] [--out FOLDER]

worlds: the shipped policy, which does not observe the world; near and far goals with noise.
steps: the shipped policy without some of the answers to a push (`reflex`, `capture`, `wait` of stage
2). A push acts for 50 ms and would give the torso alone the speed in the table. There is one every
3 s on average, the same ones with all answers.
unanswered: `baseline_tuned` (the policy has learned with the answers) with all of them, with all of
them switched off, and with a walk that was searched for without them (`ladder.py`). Only in 3-D.
"""

from dataclasses import replace
from itertools import product

import common
import ladder
import numpy as np
import seeds
from common import env, evaluate, pick, robot_model, walk_engine

DURATION = "on one core: 15 minutes; 3-D: 40"


class Slow:
    """Noise as large as that of a generator, but slow: the next number keeps 0.9 of the last one."""

    def __init__(self, rng):
        self.rng, self.last = rng, None

    def normal(self, *args):
        new = self.rng.normal(*args)
        # e ← 0.9·e + √(1 − 0.9²)·(new noise) has the standard deviation of the new noise
        first = self.last is None
        self.last = new if first else 0.9 * self.last + (1 - 0.9**2) ** 0.5 * new
        return self.last


class SlowNoise(env.FootstepWorld):
    """The noise of a goal is slow."""

    def set_goal(self, robots, goals):
        for i in robots:
            self.dice[i] = self.dice[i]._replace(noise=Slow(self.dice[i].noise))
        super().set_goal(robots, goals)


def ground(mu):
    """Settings of a world with this friction everywhere."""
    return {"robot": robot_model.RobotModel(friction=mu), "spread": env.Spread(friction=0.0)}


def motors(**settings):
    """Settings of a world with another robot model."""
    return {"robot": robot_model.RobotModel(**settings)}


TRAINED, SLOW = "as trained", "noise of the goal lasts for seconds"
WORLDS = {  # settings of the world
    TRAINED: {},
    "μ = 0.3 (trained: 0.4 to 1.0)": ground(0.3),
    "μ = 1.2": ground(1.2),
    "pushed by 0.4 m/s every 3 s": {"push": 0.4},
    "masses ± 20 % (± 10 %)": {"spread": env.Spread(mass=0.2)},
    "a gyro ten times worse": {"spread": env.Spread(gyro=0.5), "task": env.Task(imu_rad_s=1.0)},
    SLOW: {"kind": SlowNoise},
    "exact joint zeros (σ 0.5°)": {"spread": env.Spread(zero=0.0)},
    "a four times finer time step": motors(substeps=8),
    "servo gain 150 N m/rad (300)": motors(stiffness=150.0),
    "servo gain 75 N m/rad, for 30 s": motors(stiffness=75.0) | {"task": env.Task(time_limit=30.0)},
    # wolfgang_mjx_feetonly_backlash.xml of bit-bots/mujoco_playground, without its play
    "motors of the team's model for learning": motors(
        stiffness=20.5,
        torque_limit=(8.0,) * 6,
        damping=(1.7,) * 6,
        stiction=(0.1,) * 6,
        armature=0.025,
    ),
}


def study_worlds(args):
    """Rows of the policy in every world, and in two of them its opponents: 500 near and 1,000 far walks
    each, on seeds of `seeds.py`."""
    policy, rows = {"policy": common.shipped(args.sim)}, []
    for (title, settings), far in product(WORLDS.items(), common.STD):
        others = common.opponents(args.sim) if title in (TRAINED, SLOW) else {}
        how = far, 1 + far, seeds.FIRST, settings
        rows += common.measured(args.sim, policy | others, *how, world=title)
    return rows


ANSWERS = {  # what answers a push: settings of the walk
    "all": {},
    "without the reflex": {"reflex": 0.0},
    "without capture steps": {"capture": 0.0},
    "without waiting": {"wait": 0.0},
    "reflex alone": {"capture": 0.0, "wait": 0.0},
    "no answer": common.NO_ANSWERS,
}
CASES = (  # push, far goals?, sets of 500 goals
    (0.4, True, 4),
    (0.6, True, 2),
    (0.0, False, 2),
    (0.0, True, 2),
)
UNANSWERED_FIRST = 310  # evaluation seed of `unanswered`


def compared(sim, name, planner, kind, walks, case, first):
    """Rows of a planner with these walks, each compared with the first one, walk by walk; kind: the
    column with the names of the walks."""
    rows, (push, far, sets) = [], case
    for walk, parameters in walks.items():
        world = common.world(sim, walk=parameters, push=push)
        ended = common.walks(planner, world, far, sets, first)
        if not rows:
            reference = ended
        row = {"push": push, kind: walk} | common.time_over("time_over_all", ended, reference)
        row |= evaluate.mcnemar(common.fell(ended), common.fell(reference))
        rows.append(common.row_of(ended, name, far, **row))
    return rows


def study_steps(args):
    """Rows of the policy by push and answer; every answer is compared with all of them."""
    planner, now, rows = common.shipped(args.sim), walk_engine.TUNED[args.sim], []
    for case in CASES:
        answers = ANSWERS if case[0] else ("all", "reflex alone")
        walks = {name: replace(now, **ANSWERS[name]) for name in answers}
        rows += compared(args.sim, "policy", planner, "answer", walks, case, seeds.FIRST)
    return rows


def study_unanswered(args):
    """Rows of `baseline_tuned` by push and walk; each walk is compared with that with all answers."""
    planner, rows = common.opponents(args.sim)["baseline_tuned"], []
    for push, far, _ in CASES:
        how = "walk", ladder.WALKS, (push, far, 2), UNANSWERED_FIRST
        rows += compared(args.sim, "baseline_tuned", planner, *how)
    return rows


PARTS = {
    "steps": study_steps,
    "worlds": study_worlds,
    "unanswered": study_unanswered,
}
ONLY_3D = ("unanswered",)


COLUMNS = {
    "worlds": {"world": 0, "planner": 0, ("falls", "goal_std_m"): 0}
    | {("time_mean", "goal_std_m"): 2},
    "steps": {"push": 1, "goal_std_m": 1, "answer": 0, "falls": 0, "episodes": 0}
    | {"time_over_all": 3, "only_theirs": 0, "only_ours": 0},
    "unanswered": {"push": 1, "goal_std_m": 1, "walk": 0, "falls": 0, "episodes": 0}
    | {"time_mean": 2},
}


def plot(found, sim):
    """Draws how often the robot falls with these answers to a push, with 95 % intervals."""
    figure, panels = common.subplots(1, 2, figsize=(9, 3.4), sharey=True)
    for axes, push in zip(panels, (0.4, 0.6)):
        for height, answer in enumerate(reversed(ANSWERS)):
            (row,) = pick(found["steps"]["rows"], push=push, answer=answer)
            ends = 100 * np.array(row["fall_ci95"])
            axes.barh(height, 100 * row["fall"], color="tab:red", alpha=0.6)
            axes.plot(ends, [height, height], "k", lw=2)
            axes.text(ends[1] + 2, height, f"{row['falls']:,} of {row['episodes']:,}", va="center")
        axes.set(title=f"pushed by {push} m/s", xlabel="falls [% of the walks]", xlim=(0, 115))
    panels[0].set_yticks(range(len(ANSWERS)), reversed(ANSWERS))
    return figure


PICTURES = {"kicks": ("steps", plot)}


if __name__ == "__main__":
    common.start("kicks")
