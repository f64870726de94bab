"""How much of the environment's time is physics, and what does the reflex cost?

    python tests/studies/benchmark.py [--mujoco] [--out FOLDER]

All robots step on the spot, on one core. Physics is what the simulator's own step takes; the rest
are plans, motor targets, measurements and rewards. Speeds are double steps per second. The
simulators stop for the gyro every 20 ms. What that costs is measured with a gain of 0, against
robots that are read once in a double step. The reflex itself costs more:
with it the soles stand flatter, so there are more points of contact to compute.
"""

from contextlib import closing
from time import perf_counter
from unittest import mock

import common
import mujoco.rollout
import numpy as np
import pymunk
from common import env, robot_model

DURATION = "a minute"
COUNTS = (1, 4, 16, 64, 256)  # robots
STEPS = 1024  # double steps in each measurement
PHYSICS = {"pymunk": (pymunk.Space, "step"), "mujoco": (mujoco.rollout.Rollout, "rollout")}


def measure(sim, count, gain=None):
    """A row: speed of the environment, of bare physics, and their ratio; gain: of the reflex."""
    owner, name = PHYSICS[sim]
    step, spent = getattr(owner, name), []
    rounds = max(4, STEPS // count)

    def timed(*args, **kw):
        begin = perf_counter()
        result = step(*args, **kw)
        spent.append(perf_counter() - begin)
        return result

    walk = None if gain is None else common.without_reflex(sim, gain)
    with closing(env.FootstepVectorEnv(count, sim, walk=walk, cores=1)) as envs:
        action = np.tile(envs.neutral_action, (count, 1))
        envs.reset(seed=0)
        envs.step(action)
        with mock.patch.object(owner, name, timed):
            begin = perf_counter()
            for _ in range(rounds):
                envs.step(action)
            seconds = perf_counter() - begin
    physics = sum(spent)
    return {
        "robots": count,
        "one_core": count * rounds / seconds,
        "bare": count * rounds / physics,
        "ratio": physics / seconds,
    }


def study(args):
    """Every number of robots, and 64 of them without the reflex."""
    rows = [measure(args.sim, count) for count in COUNTS]
    stops = measure(args.sim, 64, 0.0)["one_core"]
    with mock.patch.object(robot_model, "READ_EVERY", 10**9):  # one reading for a double step
        through = measure(args.sim, 64, 0.0)["one_core"]
    return {"rows": rows, "without_reflex": through, "stops_ratio": stops / through}


PARTS = {"": study}


def table(found, sim):
    """Double steps per second."""
    rows = common.table(found["rows"], {"robots": 0, "one_core": 0, "bare": 0, "ratio": 2})
    return (
        f"{rows}\n64 robots without the reflex: {found['without_reflex']:.0f}. With stops for "
        f"the gyro: {found['stops_ratio']:.2f} of that.\n"
    )


def found(data):
    """Sentences by name, from the numbers of both simulators."""
    full, plane = (
        common.share(common.values(data[sim]["rows"], "ratio", robots=64))
        for sim in ("mujoco", "pymunk")
    )
    return {
        "speed": f"With many robots the environment has {full} of the speed of bare physics in "
        f"3-D and {plane} on the plane. In 3-D the stops for the gyro leave "
        f"{common.share(data['mujoco']['stops_ratio'])} of the speed. The reflex itself costs more: "
        "with it the soles stand flatter, so there are more points of contact to compute."
    }


if __name__ == "__main__":
    common.start("benchmark")
