"""Where does the robot fall? Pushes, other floors, other bodies, other errors.

    python tests/studies/kicks.py [--mujoco] [--only pushes | worlds | blocks | steps] [--out FOLDER]

pushes: far goals with noise. A push acts on the torso for 50 ms and would give the torso alone the
speed Δv. There is one every 3 s on average. All planners meet the same pushes.
worlds: the shipped policy, which does not observe the world; near and far goals with noise.
blocks: far goals with noise, on a floor of blocks 0.2 m wide with random heights. Only in 3-D.
steps: the shipped policy with and without answers to a push (`capture`, `wait` of stage 2), on
seeds of the tuning; in 3-D also in worlds in which these answers might not help.
"""

from dataclasses import replace
from itertools import product

import common
import matplotlib.pyplot as plt
import numpy as np
import seeds
from common import env, evaluate, fallen, pick, robot_model, share, values

DURATION = "pushes: 5 minutes on two cores, worlds: 5; 3-D: 20 each, blocks 10, steps 40"
FEW = 250  # goals on blocks, where MuJoCo is half as fast; elsewhere 500
BLOCKS = (0.005, 0.010)  # [m] heights from 0 to this
SPEEDS = (0.0, 0.2, 0.4, 0.6)  # Δv [m/s]


def everybody(sim, **settings):
    """Rows of all planners for far goals in such a world, with the reflex and without it."""
    planners = {"policy": common.shipped(sim), **common.opponents(sim)}
    rows = []
    for reflex in (True, False):
        walk = None if reflex else common.without_reflex(sim)
        with common.world(sim, walk=walk, **settings) as world:
            for name, planner in planners.items():
                ended = common.walks(planner, world, far=True)
                rows.append(common.row_of(ended, name, far=True, reflex=reflex))
    return rows


def study_pushes(args):
    """Rows of every planner at every Δv."""
    return [{"speed": speed, **row} for speed in SPEEDS for row in everybody(args.sim, push=speed)]


class Blocks(env.FootstepWorld):
    """A floor of blocks 0.2 m wide, up to 4 m from the origin, with random heights from 0 to
    `highest` [m]; where the robots stand at first it is flat."""

    def __init__(self, num_robots, *args, highest, **settings):
        self.highest = highest
        super().__init__(num_robots, *args, **settings)

    def reset(self, robots, *args, **more):
        super().reset(robots, *args, **more)
        for i, rng in zip(robots, self.rngs[robots, env.WORLD]):
            heights = rng.uniform(0, self.highest, (40, 40))
            heights[19:21, 19:21] = 0
            model = self.simulator.models[i]  # its own since the reset, as it got a Body
            model.hfield_data = np.kron(heights, np.ones((4, 4))).ravel()  # 4 samples each
            model.geom("blocks").pos = 0


def study_blocks(args):
    """Rows of every planner on uneven floors, on which nothing was trained; only 3-D has blocks."""
    return [
        {"blocks": height, **row}
        for height in (BLOCKS if args.sim == "mujoco" else ())
        for row in everybody(args.sim, kind=Blocks, num_robots=FEW, highest=height)
    ]


class SlowNoise(env.FootstepWorld):
    """The noise of the goal is as large as usual, but slow: the next look keeps 0.9 of it."""

    def __init__(self, num_robots, *args, **settings):
        super().__init__(num_robots, *args, **settings)
        self.last = np.zeros((num_robots, 3))

    def noisy(self, purpose, exact, robots, std):
        noisy = super().noisy(purpose, exact, robots, std)
        if purpose != env.NOISE:
            return noisy
        # e ← 0.9·e + √(1 − 0.9²)·(new noise) has the standard deviation of the new noise
        new = noisy - exact
        slow = 0.9 * self.last[robots] + (1 - 0.9**2) ** 0.5 * new
        self.last[robots] = np.where(self.steps[robots, None] == 0, new, slow)
        return exact + self.last[robots]


def ground(mu):
    """Settings of a world with this friction everywhere."""
    return {"robot": robot_model.RobotModel(friction=mu), "spread": env.Spread(friction=0.0)}


WORLDS = {  # settings of the world
    "as trained": {},
    "μ = 0.4": ground(0.4),
    "μ = 0.7": ground(0.7),
    "μ = 1.0": ground(1.0),
    "μ = 0.3 (trained: 0.4 to 1.0)": ground(0.3),
    "μ = 1.2": ground(1.2),
    "pushed by 0.4 m/s every 3 s": {"push": 0.4},
    "masses ± 20 % (± 10 %)": {"spread": env.Spread(mass=0.2)},
    "a gyro ten times worse": {"spread": env.Spread(gyro=0.5), "task": env.Task(imu_rad_s=1.0)},
    "noise of the goal lasts for seconds": {"kind": SlowNoise},
}


def study_worlds(args):
    """Rows of the policy in every world, on evaluation seeds of `seeds.py`."""
    policy, rows = common.shipped(args.sim), []
    for title, settings in WORLDS.items():
        with common.world(args.sim, **settings) as world:
            for far in (False, True):
                ended = common.walks(policy, world, far, first=seeds.POOLED_FIRST)
                rows.append(common.row_of(ended, "policy", far, world=title))
    return rows


class Lag(env.FootstepWorld):
    """The measured tilt is 40 ms old."""

    def __init__(self, num_robots, *args, **settings):
        self.before, self.last = np.zeros((2, num_robots, 2))  # [N, 2] [rad] the last two readings
        super().__init__(num_robots, *args, **settings)
        self.exact = self.simulator.imu
        self.simulator.imu = self.late

    def late(self, robots):
        tilt, rates = self.exact(robots)
        told = self.before[robots]
        self.before[robots], self.last[robots] = self.last[robots], tilt
        return told, rates

    def reset(self, robots, *args, **more):
        super().reset(robots, *args, **more)
        self.before[robots] = self.last[robots] = 0, self.engine.parameters.trunk_pitch


class Wrong(env.FootstepWorld):
    """The measured tilt is off by 0.02 rad in roll and pitch, by chance to which side."""

    def _disturbance(self, plan, robots):
        disturbance = super()._disturbance(plan, robots)
        disturbance.tilt_error += 0.02 * np.sign(self.gyro_offset[robots])[:, None]
        return disturbance


ANSWERS = {  # settings of the walk
    "reflex": {},
    "open loop": {"reflex": 0.0},
    "steps": {"capture": 1.0},
    "waiting": {"wait": 10.0},
    "all": {"capture": 1.0, "wait": 10.0},
}
FLAT = "flat floor"
HARD = {  # worlds in which steps might fail: settings
    FLAT: {},
    "blocks up to 5 mm": {"kind": Blocks, "highest": 0.005},
    "blocks up to 10 mm": {"kind": Blocks, "highest": 0.010},
    "μ = 0.35": ground(0.35),
    "μ = 1.1": ground(1.1),
    "a gyro ten times worse": WORLDS["a gyro ten times worse"],
    "tilt 40 ms late": {"kind": Lag},
    "tilt off by 0.02 rad": {"kind": Wrong},
    "joint zeros, σ 0.5°": {"spread": env.Spread(zero=np.radians(0.5))},
    "joint zeros, σ 1°": {"spread": env.Spread(zero=np.radians(1.0))},
}


def study_steps(args):
    """Rows by world, push and answer; every answer is compared with the reflex, walk by walk."""
    policy, rows = common.shipped(args.sim), []
    cases = [(FLAT, 0.0, False), (FLAT, 0.0, True)]  # world, push, far goals?
    cases += product(HARD if args.sim == "mujoco" else [FLAT], (0.4, 0.6), [True])
    for name, push, far in cases:
        for answer in ANSWERS if name == FLAT and push else ("reflex", "all"):
            walk = replace(common.walk_engine.TUNED[args.sim], **ANSWERS[answer])
            with common.world(args.sim, walk=walk, push=push, **HARD[name]) as world:
                sets = 4 if name == FLAT else 2
                ended = common.walks(policy, world, far, sets, first=900, purpose="tuning")
            if answer == "reflex":
                reference = ended
            fell, before = ended["outcome"] == "fall", reference["outcome"] == "fall"
            ratio = evaluate.time_ratio(ended, reference)
            row = common.row_of(ended, "policy", far, world=name, push=push, answer=answer)
            row["time_over_reflex"] = ratio["time_ratio"]
            row["time_over_reflex_ci95"] = ratio["time_ratio_ci95"]
            row["no_longer"] = int((before & ~fell).sum())
            row["newly"] = int((fell & ~before).sum())
            rows.append(row)
    return rows


PARTS = {
    "pushes": study_pushes,
    "worlds": study_worlds,
    "blocks": study_blocks,
    "steps": study_steps,
}


STEPS = {
    **{"world": 0, "push": 1, "goal_std_m": 1, "answer": 0, "falls": 0, "episodes": 0},
    **{"time_over_reflex": 3, "still_there": 2, "no_longer": 0, "newly": 0},
}


def table(found, sim):
    """Markdown, all with noise."""
    columns = {"planner": 0, "success": 3, "fall": 3, "time_mean": 2}
    return common.sections(
        found,
        {
            "pushes": {"speed": 1, "reflex": 0} | columns,
            "worlds": {"world": 0, "goal_std_m": 1, "falls": 0} | columns,
            "blocks": {"blocks": 3, "reflex": 0} | columns,
            "steps": STEPS,
        },
    )


def plot(found, sim):
    """Draws the share of falls over Δv, one colour for each planner, with 95 % intervals."""
    rows = found["pushes"]["rows"]
    figure, axis = plt.subplots(figsize=(8, 4))
    names = dict.fromkeys(values(rows, "planner"))
    for name, reflex in product(names, (True, False)):
        own = pick(rows, planner=name, reflex=reflex)
        axis.errorbar(
            values(own, "speed"),
            *common.fall_bars(own),
            color=common.COLORS.get(name),
            linestyle="-" if reflex else "--",
            capsize=3,
            label=f"{name}, {'with' if reflex else 'without'} reflex",
        )
    axis.set(
        xlabel="push: Δv of the torso [m/s]",
        ylabel="share of walks with a fall [1]",
        title=f"Pushed every 3 s on average, on the way to far goals ({sim})",
        ylim=(0, None),
    )
    axis.legend()
    return figure


def steps(rows):
    """Returns what was found of steps that answer a push: sentences and a table."""
    calm = values(rows, "falls", push=0.0, answer="all")
    shown, left, worlds = {}, {}, set()  # left: share of falls that remains, by push
    for new in rows:
        world, push, answer = new["world"], new["push"], new["answer"]
        if push and answer != "reflex":
            (old,) = pick(rows, world=world, push=push, answer="reflex")
            if world != FLAT:
                worlds.add(world)
                left.setdefault(push, []).append(new["falls"] / old["falls"])
                continue
            line = shown.setdefault(answer, {"answer": answer})
            line[f"falls at {push} m/s"] = f"{old['falls']} → {fallen([new])}"
            line[f"time at {push} m/s"] = "× " + common.cell(new, "time_over_reflex", 2)
    lines = [*shown.values()]
    ranges = (f"{share(min(k))} to {share(max(k))} at {push} m/s" for push, k in left.items())
    return (
        "Capture steps and waiting (`all`) were added to the shipped policy without new training. "
        f"If nobody pushes, the robot then falls in {calm[0]} of 2,000 near and {calm[1]} of 2,000 "
        f"far walks. In {len(worlds)} other worlds with pushes (other floors, worse sensors, wrong "
        "joint zeros) a part of the falls with the reflex alone remains: "
        f"{', '.join(ranges)}. The table "
        "is of far walks with pushes on the flat floor. Falls: with the reflex alone → with the "
        "answer. (`open loop` has no reflex, the others have it.) Time: that with the answer ÷ "
        "that with the reflex alone.\n\n" + common.table(lines, dict.fromkeys(lines[0], 0))
    )


def found(data):
    """Sentences by name, from the numbers of both simulators."""
    pushes, worlds, blocks, answers = (data["mujoco"][part]["rows"] for part in PARTS)

    def falls(rows, **wanted):
        on, off = pick(rows, planner="policy", **wanted)  # with the reflex, without it
        return (
            f"{share(on['fall'], 1)} of {on['episodes']} far walks with the reflex, and in "
            f"{share(off['fall'], 1)} without it"
        )

    def counted(*names):
        return f"{fallen([row for row in worlds if row['world'] in names])} walks"

    slow = values(worlds, "time_mean", world="noise of the goal lasts for seconds")
    gyro = values(worlds, "fall", world="a gyro ten times worse")
    outside = "μ = 0.3 (trained: 0.4 to 1.0)", "μ = 1.2", "masses ± 20 % (± 10 %)"
    return {
        "pushed": "In 3-D, pushed by 0.4 m/s every 3 s on average, the robot falls in "
        f"{falls(pushes, speed=0.4)}.",
        "blocks": f"On blocks of up to 5 mm the robot falls in {falls(blocks, blocks=0.005)}. On "
        f"blocks of up to 10 mm it falls in {falls(blocks, blocks=0.01)}. The policy was trained "
        "on a flat floor.",
        "grounds": "On three floors of the trained range the robot falls in "
        f"{counted('μ = 0.4', 'μ = 0.7', 'μ = 1.0')}. Outside of that range (two other floors, and "
        f"masses that differ twice as much) it falls in {counted(*outside)}.",
        "slow": "If the error of the measured goal lasts for seconds, the robot arrives, but takes "
        f"{slow[0]:.1f} s to near goals and {slow[1]:.1f} s to far ones.",
        "gyro": f"With a gyro ten times worse the robot falls in {share(gyro[0], 1)} of the near "
        f"walks and in {share(gyro[1], 1)} of the far ones.",
        "steps": steps(answers),
    }


if __name__ == "__main__":
    common.start("kicks")
