"""How fast does this robot walk straight ahead? The reference speed of times.py.

    python tests/studies/speed.py [--mujoco] [--ship]

144 walks of ten nearly equal double steps within the limits of an action, ahead or slanting. The
fastest one that did not fall is a reference, no bound: another walk may be faster.
"""

from importlib import import_module

import common
import numpy as np

walk_engine = import_module("02_walk_engine")
DURATION = {"pymunk": "a few seconds", "mujoco": "a few seconds"}
COUNT, REPEATS = 10, 4  # double steps of a walk, walks for every step

def fastest(sim, seed=0):
    """Highest speed [m/s] in the second half of a walk that did not fall; its step ahead, aside."""
    limits, rng = walk_engine.LIMITS[sim], np.random.default_rng(seed)
    grid = [(u, v) for u in np.linspace(0, limits.high[0], 12) for v in (0, 0.04, 0.08)]  # [m]
    steps = np.array([[[u, v, 0], [u, 0, 0]] for u, v in grid]).repeat(REPEATS, 0)  # [R, 2, 3]
    plans = steps[:, None].repeat(COUNT, 1)  # [R, K, 2, 3]
    plans = np.clip(plans * rng.uniform(0.95, 1.05, plans.shape), limits.low, limits.high)
    parameters = walk_engine.TUNED[sim]
    poses, _, fall = walk_engine.walk(sim, parameters, plans)
    way = poses[:, -1, :2] - poses[:, COUNT // 2, :2]  # [m]
    seconds = (COUNT - COUNT // 2) * walk_engine.WalkEngine(1, parameters).period
    speed = np.hypot(*way.T) / seconds * (fall == COUNT)  # [R]
    return float(speed.max()), steps[speed.argmax(), 0, :2].tolist()

def study(sim):
    """The one number."""
    speed, (ahead, aside) = fastest(sim)
    head = ["simulator", "reference speed [m/s]", "each foot ahead [m]", "left foot outward [m]"]
    line = [sim, f"{speed:.2f}", f"{ahead:.2f}", f"{aside:.2f}"]
    return common.Findings({"speed": round(speed, 4), "ahead": ahead, "aside": aside},
                           common.markdown(head, [line]))

if __name__ == "__main__":
    common.main(__file__)
