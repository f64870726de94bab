"""How long may a step be, and how much at once? Maps of falls, on which the limits were chosen.

    python tests/studies/limits.py [--mujoco] [--ship]

Robots with drawn bodies on drawn ground. Every cell is eight walks of three and then five equal
double steps, each step varied by ±5 %. The third map asks what fells the robot: a long step, or a
sudden change of its length? The fourth panel walks random plans within the limits of x, y and yaw
while the sum of their shares may be 1, …, 3 (anything); the blue line is the limit that we chose.
Then the feet in random plans within the limits (stage 2 also counts the straight walks of its speed
test, in which they rise higher).
"""

from dataclasses import replace
from importlib import import_module

import common
import numpy as np

robot_model, walk_engine = common.robot_model, import_module("02_walk_engine")
DURATION = {"pymunk": "about 2 minutes on two cores", "mujoco": "about 2 minutes on two cores"}
CELLS, REPEATS = 15, 8  # along each axis of a map, walks in a cell
PLANS = 512  # random ones for every load
FEET = 6  # seeds of 96 random plans, for the feet
LOADS = (1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0)  # [-] largest sums of the shares
X = np.linspace(-0.24, 0.32, CELLS)  # [m]
MAPS = {  # title: label of the second axis, its values, first and then from (x, second)
    "forward and turning": ("yaw of both feet [rad]", np.linspace(-0.7, 0.7, CELLS),
                            lambda x, yaw: [[[x, 0, yaw], [x, 0, -yaw]]] * 2),
    "forward and sideways": ("left foot outward [m]", np.linspace(0, 0.21, CELLS),
                             lambda x, y: [[[x, y, 0], [x, 0, 0]]] * 2),
    "change of step length": ("x of the steps before [m]", X,
                              lambda x, last: [[[last, 0, 0]] * 2, [[x, 0, 0]] * 2]),
}

def falls_of(sim, plans, rng):
    """Which plans [R, K, 2, 3] end in a fall [R], each with a body and a ground of its own."""
    body = robot_model.Spread().draw(rng.spawn(len(plans)), robot_model.RobotModel())
    _, _, fall = walk_engine.walk(sim, walk_engine.TUNED[sim], plans, body)
    return fall < plans.shape[1]

def fall_map(sim, first, then, seed=0):
    """Share of falls [R] over plans [R, 2, 3]: three double steps `first`, then five of `then`."""
    plans = np.stack([first] * 3 + [then] * 5, 1).repeat(REPEATS, 0)  # [R · repeats, 8, 2, 3]
    rng = np.random.default_rng(seed)
    plans = plans * rng.uniform(0.95, 1.05, (len(plans), 1, 1, 3))
    return falls_of(sim, plans, rng).reshape(-1, REPEATS).mean(1)

def standing(sim, load, seed=0):
    """Share of random plans that end standing, if combined steps are limited to that load."""
    rng, limits = np.random.default_rng(seed), replace(walk_engine.LIMITS[sim], load=load)
    return 1 - falls_of(sim, walk_engine.random_plans(rng, limits, PLANS), rng).mean()

def feet(sim):
    """Clearance, median and 5th percentile, and slip [m] as of `measure`, in random plans only."""
    frictions, walk_engine.FRICTION = walk_engine.FRICTION, ()  # no speed test
    try:
        seen = walk_engine.average([walk_engine.measure(sim, walk_engine.TUNED[sim], seed)
                                    for seed in range(FEET)])
    finally:
        walk_engine.FRICTION = frictions
    return [round(value, 5) for value in (*seen["clearance"], seen["slip"])]

def cells(title, xs, others):
    """Double steps [len(others), len(xs), 2, 2, 3] of a map: first, then."""
    return np.array([[MAPS[title][2](x, other) for x in xs] for other in others], float)

def allowed(steps, limits):
    """Which double steps [..., 2, 2, 3] of a map an action can ask for, all four footsteps."""
    single = (steps >= np.array(limits.low) - 1e-9) & (steps <= np.array(limits.high) + 1e-9)
    whole = np.isclose(walk_engine.within(steps, limits), steps)
    return (single & whole).all((-3, -2, -1))

def study(sim):
    """The three maps and the loads."""
    limits, maps, lines, content = walk_engine.LIMITS[sim], {}, [], {}
    for title, (_, second, _) in MAPS.items():
        steps = cells(title, X, second)
        first, then = (steps[..., k, :, :].reshape(-1, 2, 3) for k in (0, 1))
        falls = maps[title] = fall_map(sim, first, then).reshape(len(second), len(X))
        inside = allowed(steps, limits)
        content[title] = {"fall_inside": round(falls[inside].mean(), 4),
                          "fall_anywhere": round(falls.mean(), 4)}
        lines.append([title, f"{falls[inside].mean():.2f}", f"{falls.mean():.2f}"])
    change = (X - X[:, None])[inside & (falls == 0)]  # [m] of the third map
    content["largest_change"] = [round(change.min(), 4), round(change.max(), 4)]
    stood = content["stood"] = {load: round(float(standing(sim, load)), 4) for load in LOADS}
    table = common.markdown(["map", "falls within the limits", "falls anywhere"], lines)
    table += (f"\nLargest change of step length within the limits without a fall: "
              f"{change.max():+.2f} m and {change.min():+.2f} m, of "
              f"{limits.high[0] - limits.low[0]:.2f} m.\n\n")
    head = ["largest sum of shares", *map(str, LOADS)]
    table += common.markdown(head, [["random plans that stand", *map("{:.2f}".format,
                                                                     stood.values())]])
    *content["clearance"], content["slip"] = clearance, lowest, slip = feet(sim)
    table += (f"\nFeet in random plans: clearance {1000 * clearance:.1f} mm (median) and "
              f"{1000 * lowest:.1f} mm (5 %), slip of the support foot {1000 * slip:.1f} mm.\n")
    return common.Findings(content, table, plot(maps, stood, limits, sim))

def plot(maps, stood, limits, sim):
    """Share of falls by color; inside of the line is what an action can ask for."""
    figure, axes = common.plt.subplots(1, 4, figsize=(18, 4.4), layout="constrained")
    for axis, (title, falls) in zip(axes, maps.items()):
        label, second, _ = MAPS[title]
        image = axis.pcolormesh(X, second, falls, cmap="magma_r", vmin=0, vmax=1)
        fine, other = (np.linspace(v[0], v[-1], 300) for v in (X, second))
        inside = allowed(cells(title, fine, other), limits)
        axis.contour(fine, other, inside, [0.5], colors="tab:cyan", linewidths=2)
        axis.set(title=title, xlabel="x of the steps [m]", ylabel=label)
    figure.colorbar(image, ax=axes[:3], label="share of falls in 8 double steps")
    axes[3].plot(list(stood), list(stood.values()), "o-")
    axes[3].axvline(limits.load, color="tab:cyan", lw=2)
    axes[3].set(title="x, y and yaw at once", xlabel="largest sum of the shares of the limits [1]",
                ylabel="share of random plans that stand [1]", ylim=(0, 1))
    axes[3].grid(alpha=0.3)
    figure.suptitle(f"What the robot can take in drawn worlds ({sim}); blue: the limits of an "
                    "action")
    return figure

if __name__ == "__main__":
    common.main(__file__)
