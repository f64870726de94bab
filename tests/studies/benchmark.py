"""How much of the environment's time is physics? Its speed against that of bare physics.

    python tests/studies/benchmark.py [--mujoco] [--ship]

Bare physics is what the simulator's own step takes while the same robots step on the spot: without
plans, motor targets, measurements and rewards. It, the share of planning and the memory (what the
robots add to a process that has already walked one) are measured on one core, in a fresh process
for every number of robots; the environment on one core and on all of them.
"""

import multiprocessing
import re
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from pathlib import Path
from time import perf_counter

import common
import numpy as np
import pymunk

env = import_module("03_env")
DURATION = {"pymunk": "about a minute on two cores", "mujoco": "about a minute on two cores"}
COUNTS = (1, 4, 16, 64, 256)  # robots
STEPS = 1024  # double steps in each measurement
HEAD = ("robots", "environment, all cores [1/s]", "environment, one core [1/s]",
        "bare physics, one core [1/s]", "ratio on one core", "planning", "kB per robot")

def bare_physics(sim):
    """The function that does nothing but physics: its owner and its name."""
    if sim == "pymunk":
        return pymunk.Space, "step"
    return import_module("mujoco.rollout").Rollout, "rollout"

def seconds(envs):
    """Wall-clock time of a double step of all robots together, on the spot [s]."""
    action = np.tile(envs.neutral_action, (envs.num_envs, 1))
    rounds = max(4, STEPS // envs.num_envs)
    envs.reset(seed=0)
    envs.step(action)  # by its end all processes have started
    begin = perf_counter()
    for _ in range(rounds):
        envs.step(action)
    return (perf_counter() - begin) / rounds

def memory():
    """Memory of this process [bytes]; nan where /proc does not tell."""
    try:
        status = Path("/proc/self/status").read_text()
    except OSError:
        return float("nan")
    return 1024 * int(re.search(r"VmRSS:\s+(\d+)", status)[1])

def on_one_core(sim, count):
    """A row of the table, but for the speed on all cores."""
    seconds(env.FootstepVectorEnv(1, sim, cores=1))  # loads everything
    before = memory()
    envs = env.FootstepVectorEnv(count, sim, cores=1)
    whole = seconds(envs)  # [s]
    used = (memory() - before) / count / 1000  # [kB]
    planning = common.timed(envs.world.engine, "plan")
    with common.timed(*bare_physics(sim)) as physics, planning as plan:
        watched = seconds(envs)
    bare, plan = (watch.seconds / plan.calls for watch in (physics, plan))  # [s]
    envs.close()
    return {"robots": count, "one_core": count / whole, "bare": count / bare,
            "ratio": bare / whole, "planning": plan / watched, "kB": used}

def study(sim):
    """Every number of robots."""
    rows, context = [], multiprocessing.get_context("spawn")
    for count in COUNTS:
        with ProcessPoolExecutor(1, context) as pool:  # fresh: nobody has used memory before
            row = pool.submit(on_one_core, sim, count).result()
        envs = env.FootstepVectorEnv(count, sim)
        row["all_cores"] = count / seconds(envs)
        envs.close()
        rows.append({key: round(value, 4) if np.isfinite(value) else None
                     for key, value in row.items()})
    keys = {"all_cores": 0, "one_core": 0, "bare": 0, "ratio": 2, "planning": 2, "kB": 0}
    lines = [[row["robots"], *(common.number(row[key], n) for key, n in keys.items())]
             for row in rows]
    return common.Findings({"cores": common.robot_model.CORES, "rows": rows},
                           common.markdown(HEAD, lines))

if __name__ == "__main__":
    common.main(__file__)
