"""Where does the robot fall? Pushes, other grounds, other bodies, other errors.

    python tests/studies/kicks.py [--mujoco] [--only pushes | worlds | blocks | steps] [--out FOLDER]

pushes: far goals with noise. A push acts on the torso for 50 ms; alone it would make the torso
faster by Δv. On average there is one every 3 s; all planners meet the same ones.
worlds: the shipped policy, near and far goals with noise. It does not observe the world.
blocks: far goals with noise, on a floor of blocks 0.2 m wide with drawn heights; only in 3-D.
steps: the shipped policy with and without steps that answer a push (`capture`, `wait` of stage 2),
on tuning seeds; in 3-D also in worlds in which these might fail.
"""

from dataclasses import replace
from itertools import product

import common
import matplotlib.pyplot as plt
import numpy as np
import seeds
from common import RESULTS, env, evaluate, robot_model, share

DURATION = "pushes: 5 minutes on two cores, worlds: 5; 3-D: 20 each, blocks 10, steps 40"
SETS = 1  # of 500 goals, for every push and world
FEW = 250  # goals on blocks, where MuJoCo is half as fast
BLOCKS = (0.005, 0.010)  # [m] heights from 0 to this
SPEEDS = (0.0, 0.2, 0.4, 0.6)  # Δv [m/s]


def everybody(sim, per_set=common.PER_SET, **settings):
    """Rows of all planners on their way to far goals in such a world, with and without reflex."""
    planners = {
        "policy": common.policy(RESULTS / sim / "policy.pt", sim),
        **common.opponents(sim),
    }
    rows = []
    for reflex in (True, False):
        walk = None if reflex else common.without_reflex(sim)
        with common.world(sim, num_robots=per_set, walk=walk, **settings) as world:
            for name, planner in planners.items():
                ended = common.walks(planner, world, True, SETS, per_set=per_set)
                rows.append({"reflex": reflex, **common.row_of(ended, name, True)})
    return rows


def study_pushes(args):
    """Everybody at every Δv."""
    rows = []
    for speed in SPEEDS:
        rows += [{"speed": speed, **row} for row in everybody(args.sim, push=speed)]
    return {"rows": rows}


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
    """Everybody on uneven ground, which nobody has met in a training."""
    rows = []
    for height in BLOCKS:
        found = everybody(args.sim, FEW, kind=Blocks, highest=height)
        rows += [{"blocks": height, **row} for row in found]
    return {"rows": rows}


class SlowNoise(env.FootstepWorld):
    """The noise of the goal is as large, but changes slowly: 0.9 of it stay for the next time."""

    STAYS = 0.9

    def __init__(self, num_robots, *args, **settings):
        super().__init__(num_robots, *args, **settings)
        self.last = np.zeros((num_robots, 3))

    def noisy(self, purpose, exact, robots, std):
        noisy = super().noisy(purpose, exact, robots, std)
        if purpose != env.NOISE or not self.noise:
            return noisy
        # e ← 0.9·e + √(1 − 0.9²)·(new noise) has the standard deviation of the new noise
        new = noisy - exact
        slow = self.STAYS * self.last[robots] + (1 - self.STAYS**2) ** 0.5 * new
        self.last[robots] = np.where(self.steps[robots, None] == 0, new, slow)
        return exact + self.last[robots]


def ground(mu):
    """Settings of a world with this friction everywhere."""
    robot = replace(robot_model.RobotModel(), friction=mu)
    return {"robot": robot, "spread": env.Spread(friction=0.0)}


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
    policy = common.policy(RESULTS / args.sim / "policy.pt", args.sim)
    rows = []
    for title, settings in WORLDS.items():
        with common.world(args.sim, **settings) as world:
            for far in (False, True):
                ended = common.walks(policy, world, far, SETS, seeds.POOLED_FIRST)
                rows.append({"world": title, **common.row_of(ended, "policy", far)})
    return {"rows": rows}


class Lag(env.FootstepWorld):
    """The measured tilt is 40 ms old."""

    READINGS = 2

    def __init__(self, num_robots, *args, **settings):
        super().__init__(num_robots, *args, **settings)
        self.exact = self.simulator.imu
        self.simulator.imu = self.late

    def late(self, robots):
        tilt, rates = self.exact(robots)
        past = self.past[robots]
        self.past[robots] = np.concatenate([past[:, 1:], tilt[:, None]], 1)
        return past[:, 0], rates

    def reset(self, robots, *args, **more):
        super().reset(robots, *args, **more)
        if not hasattr(self, "past"):
            self.past = np.zeros((len(self.goal), self.READINGS, 2))  # [N, readings, 2] [rad]
        self.past[robots] = 0, self.engine.parameters.trunk_pitch


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
HARD = {  # worlds in which steps might fail: settings
    "flat floor": {},
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


def study_steps(args, per_set=500, first=900):
    """Rows by world, push and answer; every answer is compared with the reflex, walk by walk."""
    policy = common.policy(RESULTS / args.sim / "policy.pt", args.sim)

    def walked(settings, answer, push, far, sets):
        walk = replace(common.walk_engine.TUNED[args.sim], **ANSWERS[answer])
        with common.world(args.sim, num_robots=per_set, walk=walk, push=push, **settings) as world:
            return common.walks(policy, world, far, sets, first, per_set, "tuning")

    flat = "flat floor"
    cases = [(flat, 0.0, False), (flat, 0.0, True)]
    cases += product(HARD if args.sim == "mujoco" else [flat], (0.4, 0.6), (True,))
    rows = []
    for name, push, far in cases:
        for answer in ANSWERS if name == flat and push else ("reflex", "all"):
            ended = walked(HARD[name], answer, push, far, 4 if name == flat else 2)
            if answer == "reflex":
                reference = ended
            fell, before = ended["outcome"] == "fall", reference["outcome"] == "fall"
            ratio = evaluate.time_ratio(ended, reference)
            rows.append(
                {
                    "world": name,
                    "push": push,
                    "answer": answer,
                    **common.row_of(ended, "policy", far),
                    "time_over_reflex": ratio["time_ratio"],
                    "time_over_reflex_ci95": ratio["time_ratio_ci95"],
                    "no_longer": int((before & ~fell).sum()),
                    "newly": int((fell & ~before).sum()),
                }
            )

    return {"rows": rows}


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
    """Share of falls over Δv, one colour a planner, with 95 % intervals."""
    rows = found["pushes"]["rows"]
    figure, axis = plt.subplots(figsize=(8, 4))
    names = dict.fromkeys(row["planner"] for row in rows)
    for name, reflex in product(names, (True, False)):
        own = common.pick(rows, planner=name, reflex=reflex)
        fall = np.array([row["fall"] for row in own])
        low, high = np.transpose([row["fall_ci95"] for row in own])
        axis.errorbar(
            [row["speed"] for row in own],
            fall,
            np.abs([fall - low, high - fall]),
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


def steps(part):
    """What was found of steps that answer a push: a sentence and a table, if it was measured."""
    if part is None:
        return {}

    def row(world, push, answer, std=1.0):
        wanted = {"world": world, "push": push, "answer": answer, "goal_std_m": std}
        return common.pick(part["rows"], **wanted)[0]

    def changed(world, answer, push):
        new, old = row(world, push, answer), row(world, push, "reflex")
        low, high = new["time_over_reflex_ci95"]
        return {
            f"falls at {push} m/s": f"{old['falls']} → {new['falls']} of {new['episodes']:,}",
            f"time at {push} m/s": f"× {new['time_over_reflex']:.2f} [{low:.2f}, {high:.2f}]",
        }

    cases = [("flat floor", answer) for answer in list(ANSWERS)[1:]]
    cases += [(world, "all") for world in list(HARD)[1:]]
    rows = [
        {"world": world, "answer": answer}
        | changed(world, answer, 0.4)
        | changed(world, answer, 0.6)
        for world, answer in cases
    ]
    near, far = (row("flat floor", 0.0, "all", std)["falls"] for std in common.STD.values())
    return {
        "steps": "With capture steps and waiting the shipped policy, which was trained without them, "
        f"falls in {near} near and {far} far walks of 2,000 that nobody pushes. On the way to far "
        "goals, with the reflex alone → with this answer, too (time: over goals that both "
        "reached):\n\n" + common.table(rows, dict.fromkeys(rows[0], 0)),
    }


def found(data):
    """Sentences by name, from the numbers of both simulators."""
    pushes, worlds, blocks = (data["mujoco"][part]["rows"] for part in [*PARTS][:3])

    def falls(rows, **wanted):
        own = {"planner": "policy", **wanted}
        walks, _ = common.values(rows, "episodes", **own)
        on, off = (common.values(rows, "fall", reflex=reflex, **own) for reflex in (True, False))
        return (
            f"{share(on, 1)} of {walks} far walks with the reflex and in {share(off, 1)} without it"
        )

    def counted(*names):
        rows = [row for row in worlds if row["world"] in names]
        walks = sum(row["episodes"] for row in rows)
        return f"{sum(row['falls'] for row in rows)} of {walks:,} walks"

    slow = common.values(worlds, "time_mean", world="noise of the goal lasts for seconds")
    gyro = common.values(worlds, "fall", world="a gyro ten times worse")
    outside = "μ = 0.3 (trained: 0.4 to 1.0)", "μ = 1.2", "masses ± 20 % (± 10 %)"
    return {
        "pushed": "In 3-D, pushed by 0.4 m/s every 3 s, the policy falls in "
        f"{falls(pushes, speed=0.4)}.",
        "blocks": f"On blocks of up to 5 mm it falls in {falls(blocks, blocks=0.005)}; of up to 10 mm, "
        f"in {falls(blocks, blocks=0.01)}. It was trained on a flat floor.",
        "grounds": "On the three grounds of the range that was trained it falls in "
        f"{counted('μ = 0.4', 'μ = 0.7', 'μ = 1.0')}; outside of it (two more grounds, and twice "
        f"the spread of masses) in {counted(*outside)}.",
        "slow": f"If the noise of the goal lasts for seconds, it arrives, but takes {slow[0]:.1f} s "
        f"to near and {slow[1]:.1f} s to far goals.",
        "gyro": f"With a gyro ten times worse it falls in {share(gyro[0], 1)} and "
        f"{share(gyro[1], 1)} of the walks.",
        **steps(data["mujoco"].get("steps")),
    }


if __name__ == "__main__":
    common.start("kicks")
