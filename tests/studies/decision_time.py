"""How long does one decision take, from the measured goals to the actions?

    python tests/studies/decision_time.py [--mujoco] [--ship]

The shipped planners, for one robot and for 64 at once, in wall-clock time on one core. All of them
get a view with an observation in it; to make it is part of the decision.
"""

import time

import common
import kept
import numpy as np

DURATION = {"pymunk": "a few seconds", "mujoco": "a few seconds"}
COUNTS, REPEATS = (1, 64), 200

def decision_time(planner, world, count):
    """Median wall-clock time of a decision for `count` robots at once [µs]."""
    robots, seconds = np.arange(count), []
    measured = world.measure(robots)
    planner.reset(count)
    for _ in range(REPEATS):
        begin = time.perf_counter()
        planner.act(world.view(robots, measured), robots, measured)
        seconds.append(time.perf_counter() - begin)
    return 1e6 * float(np.median(seconds))

def study(sim):
    """Every planner."""
    world, rows, robots = kept.env.FootstepWorld(max(COUNTS), sim, cores=1), [], range(max(COUNTS))
    world.reset(robots, [kept.env.stream("evaluation", kept.FIRST, i) for i in robots])
    for name, (planner, _) in kept.shipped(sim).items():
        for count in COUNTS:
            micros = decision_time(planner, world, count) / count
            rows.append({"planner": name, "robots": count, "us_per_robot": round(micros, 2)})
    world.close()
    head = ["planner", "robots at once", "µs per robot"]
    lines = [[row["planner"], row["robots"], f"{row['us_per_robot']:.1f}"] for row in rows]
    return common.Findings(rows, common.markdown(head, lines))

if __name__ == "__main__":
    common.main(__file__)
