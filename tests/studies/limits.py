"""How long may a step be? Maps of the falls, on which the limits of an action were chosen.

    python tests/studies/limits.py [--mujoco] [--ship]

Every cell is four walks of three and then five equal double steps, each step varied by ±5 %. The
third map asks what fells the robot: a long step, or a sudden change of its length?
"""

from importlib import import_module

import common
import numpy as np

walk_engine = import_module("02_walk_engine")
DURATION = {"pymunk": "about 20 seconds on two cores", "mujoco": "about 30 seconds on two cores"}
CELLS, REPEATS = 15, 4  # along each axis of a map, walks in a cell
X = np.linspace(-0.24, 0.32, CELLS)  # [m]
MAPS = {  # title: label of the second axis, its values, first and then from (x, second)
    "forward and turning": ("yaw of both feet [rad]", np.linspace(-0.7, 0.7, CELLS),
                            lambda x, yaw: [[[x, 0, yaw], [x, 0, -yaw]]] * 2),
    "forward and sideways": ("left foot outward [m]", np.linspace(0, 0.21, CELLS),
                             lambda x, y: [[[x, y, 0], [x, 0, 0]]] * 2),
    "change of step length": ("x of the steps before [m]", X,
                              lambda x, last: [[[last, 0, 0]] * 2, [[x, 0, 0]] * 2]),
}

def fall_map(sim, first, then, seed=0):
    """Share of falls [R] over plans [R, 2, 3]: three double steps `first`, then five of `then`."""
    plans = np.stack([first] * 3 + [then] * 5, 1).repeat(REPEATS, 0)  # [R · repeats, 8, 2, 3]
    rng = np.random.default_rng(seed)
    plans = plans * rng.uniform(0.95, 1.05, (len(plans), 1, 1, 3))
    _, _, fall = walk_engine.walk(sim, walk_engine.TUNED[sim], plans)
    return (fall < plans.shape[1]).reshape(-1, REPEATS).mean(1)

def within(values, low, high):
    """Which of the values an action can ask for."""
    return (values >= low - 1e-9) & (values <= high + 1e-9)

def study(sim):
    """The three maps."""
    low, high = walk_engine.LIMITS[sim].low, walk_engine.LIMITS[sim].high
    # A steady turn is outward for one foot and inward, the smaller limit, for the other one.
    edges = {"forward and turning": (low[2], -low[2]), "forward and sideways": (0, high[1]),
             "change of step length": (low[0], high[0])}
    maps, lines, content = {}, [], {}
    for title, (_, second, plan) in MAPS.items():
        cells = np.array([plan(x, other) for other in second for x in X], float)  # [R, 2, 2, 3]
        falls = fall_map(sim, cells[:, 0], cells[:, 1]).reshape(len(second), len(X))
        inside = np.outer(within(second, *edges[title]), within(X, low[0], high[0]))
        content[title] = {"fall_inside": round(falls[inside].mean(), 4),
                          "fall_anywhere": round(falls.mean(), 4)}
        lines.append([title, f"{falls[inside].mean():.2f}", f"{falls.mean():.2f}"])
        maps[title] = falls
    change = (X - X[:, None])[inside & (falls == 0)]  # [m] of the third map
    content["largest_change"] = [round(change.min(), 4), round(change.max(), 4)]
    table = common.markdown(["map", "falls within the limits", "falls anywhere"], lines)
    table += (f"\nLargest change of step length within the limits without a fall: "
              f"{change.max():+.2f} m and {change.min():+.2f} m, of {high[0] - low[0]:.2f} m.\n")
    return common.Findings(content, table, plot(maps, edges, (low[0], high[0]), sim))

def plot(maps, edges, limits, sim):
    """Share of falls by color; the box is what an action can ask for."""
    figure, axes = common.plt.subplots(1, 3, figsize=(14, 4.4), layout="constrained")
    for axis, (title, falls) in zip(axes, maps.items()):
        label, second, _ = MAPS[title]
        image = axis.pcolormesh(X, second, falls, cmap="magma_r", vmin=0, vmax=1)
        size = limits[1] - limits[0], edges[title][1] - edges[title][0]
        axis.add_patch(common.plt.Rectangle((limits[0], edges[title][0]), *size, fill=False,
                                            ec="tab:cyan", lw=2))
        axis.set(title=title, xlabel="x of the steps [m]", ylabel=label)
    figure.colorbar(image, ax=axes, label="share of falls in 8 double steps")
    figure.suptitle(f"What the robot can take ({sim}); blue: the limits of an action")
    return figure

if __name__ == "__main__":
    common.main(__file__)
