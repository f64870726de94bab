"""How much of the environment's time is physics, and what does the reflex cost?

    python tests/studies/benchmark.py [--mujoco] [--out FOLDER]

All robots step on the spot, on one core. Physics is what the simulator's own step takes; the rest
are plans, motor targets, measurements and rewards. Speeds are double steps per second. With the
reflex the simulator stops for the gyro every 20 ms; without it (gain 0) MuJoCo runs through. What
the stops cost is measured with a gain too small to move anything. The reflex itself costs more:
with it the soles stand flatter, so there are more points of contact to compute.
"""

from contextlib import closing
from time import perf_counter
from unittest import mock

import common
import mujoco.rollout
import numpy as np
import pymunk
from common import env

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

    with closing(env.FootstepVectorEnv(count, sim, cores=1)) as envs:
        action = np.tile(envs.neutral_action, (count, 1))
        if gain is not None:
            common.set_reflex(envs.world, gain)
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
    through, stops = (measure(args.sim, 64, gain)["one_core"] for gain in (0.0, 1e-9))
    return {"rows": rows, "without_reflex": through, "stops_ratio": stops / through}


PARTS = {"": study}


def table(found, sim):
    """Double steps per second."""
    rows = common.table(found["rows"], {"robots": 0, "one_core": 0, "bare": 0, "ratio": 2})
    return (
        f"{rows}\n64 robots without the reflex: {found['without_reflex']:.0f}. With stops for "
        f"the gyro: {found['stops_ratio']:.2f} of that.\n"
    )


if __name__ == "__main__":
    common.run("benchmark")
