"""What is the price of an honest ground? MuJoCo's friction cones, and the walk's trunk; 3-D only.

    python tests/studies/ground.py [--mujoco] [--ship]

MuJoCo's own friction is a pyramid: quicker to compute, but stronger along the ground's x and y
than between them. `impratio` makes friction stiffer against the normal force; ours is 1. All walks
are those of `measure` in stage 2, with drawn bodies: the highest speeds without a fall at the worst
of three μ, random plans that stand, the lowest corner of the swinging sole, and the slip of the
support foot. What does it cost, and what do a higher foot and a roll of the trunk bring? The
support foot may slip 8 mm: at 1 it slips 5, a higher `impratio` slows physics and changes little.
Our foot_rise and trunk_roll are where stage 2's tuning has ended, in the middle of the curve:
lower, and the sole scrapes, higher, and speed and standing are lost. (30 mm with 0.06 rad clears
9 mm and walks as well: for the next walk, as what was learned on this one had to be learned anew.)
"""

import contextlib
from dataclasses import replace
from importlib import import_module
from time import perf_counter

import common
import numpy as np
from tqdm import tqdm

robot_model, walk_engine = common.robot_model, import_module("02_walk_engine")
DURATION = {"pymunk": "it needs --mujoco", "mujoco": "about 6 minutes on two cores"}
SEEDS = 4  # of the worlds and random plans; each number is a mean over them
CONES = {"pyramid": 0, "elliptic (ours)": 1}  # MuJoCo's mjtCone
RATIOS = (1.0, 3.0, 10.0)  # impratio
RISES = (0.02, 0.03, 0.04, 0.05, 0.06)  # [m] of the foot
ROLLS = (0.0, 0.03, 0.06, 0.09)  # [rad] of the trunk
TUNED = walk_engine.TUNED["mujoco"]

@contextlib.contextmanager
def ground(cone, impratio):
    """Meanwhile simulators are made with this friction; gives [double steps, seconds] so far."""
    make, spent = robot_model.make_sim, np.zeros(2)

    def changed(*settings):
        sim = make(*settings)
        sim.model.opt.cone, sim.model.opt.impratio = cone, impratio  # copied by every Body
        run = sim.run

        def timed(trajectory, robots):
            begin = perf_counter()
            motion = run(trajectory, robots)
            spent[:] += len(robots), perf_counter() - begin
            return motion

        sim.run = timed
        return sim

    robot_model.make_sim = changed
    try:
        yield spent
    finally:
        robot_model.make_sim = make

def row_of(parameters, cone=CONES["elliptic (ours)"], impratio=1.0):
    """The walk on this ground, plain numbers: means over the seeds."""
    with ground(cone, impratio) as spent:
        measured = [walk_engine.measure("mujoco", parameters, seed) for seed in range(SEEDS)]
    row = {name: [min(at[name] for at in one["speeds"]) for one in measured]
           for name in walk_engine.DIRECTIONS}
    row |= {name: [one[name] for one in measured] for name in ("stood", "slip")}
    row |= {name: [one["clearance"][k] for one in measured]
            for k, name in enumerate(("clearance", "lowest"))}
    row = {name: round(float(np.mean(values)), 5) for name, values in row.items()}
    return row | {"per_second": round(spent[0] / spent[1], 1)}

def study(sim):
    """Every ground, every walk."""
    if sim != "mujoco":
        raise common.StudyError("feet can skate sideways in 3-D only: add --mujoco")
    jobs = {f"{name} cone, impratio {ratio:.0f}": (TUNED, cone, ratio)
            for name, cone in CONES.items() for ratio in RATIOS}
    jobs["ours, without the trunk's roll"] = (replace(TUNED, trunk_roll=0.0),)
    rows = {name: row_of(*job) for name, job in tqdm(jobs.items(), unit=" grounds")}
    curve = [{"foot_rise": rise, "trunk_roll": roll,
              **row_of(replace(TUNED, foot_rise=rise, trunk_roll=roll))}
             for roll in tqdm(ROLLS, unit=" rolls") for rise in RISES]
    lines = [[name, *cells(row)] for name, row in rows.items()]
    lines += [[f"foot_rise {row['foot_rise']}, trunk_roll {row['trunk_roll']}", *cells(row)]
              for row in curve]
    head = ["", "double steps per second", "forward [m/s]", "backward [m/s]", "sideways [m/s]",
            "turning [rad/s]", "random plans that stand", "clearance [mm], median / 5 %",
            "slip [mm], median"]
    content = {"foot_rise": TUNED.foot_rise, "trunk_roll": TUNED.trunk_roll, "grounds": rows,
               "curve": curve}
    return common.Findings(content, common.markdown(head, lines), plot(curve))

def cells(row):
    """Of the table."""
    return [f"{row['per_second']:.0f}", *(f"{row[key]:.2f}" for key in walk_engine.DIRECTIONS),
            f"{row['stood']:.2f}", f"{1000 * row['clearance']:.1f} / {1000 * row['lowest']:.1f}",
            f"{1000 * row['slip']:.1f}"]

def plot(curve):
    """Clearance, speed and standing over the height of the foot, a line for every roll."""
    figure, axes = common.plt.subplots(1, 3, figsize=(12, 3.9), layout="constrained")
    for k, roll in enumerate(ROLLS):
        own = [row for row in curve if row["trunk_roll"] == roll]
        rise = [1000 * row["foot_rise"] for row in own]
        kw = {"color": f"C{k}", "marker": ".", "label": f"trunk roll {roll} rad"}
        axes[0].plot(rise, [1000 * row["clearance"] for row in own], **kw)
        axes[0].plot(rise, [1000 * row["lowest"] for row in own], ":", color=f"C{k}")
        axes[1].plot(rise, [row["forward"] for row in own], **kw)
        axes[2].plot(rise, [row["stood"] for row in own], **kw)
    axes[0].axhline(0, color="0.6", lw=1)
    axes[0].set(title="clearance of the swinging sole", ylabel="median; dotted: 5 % [mm]")
    axes[1].set(title="forward speed", ylabel="at the worst μ [m/s]", ylim=(0, None))
    axes[2].set(title="random plans", ylabel="share that stands [1]", ylim=(0, 1))
    for axis in axes:
        axis.axvline(1000 * TUNED.foot_rise, color="0.6", lw=1)
        axis.set(xlabel="foot_rise [mm]")
        axis.grid(alpha=0.3)
    axes[0].legend(fontsize=8)
    figure.suptitle(f"How high should a foot rise? (grey: ours, with a trunk roll of "
                    f"{TUNED.trunk_roll} rad)")
    return figure

if __name__ == "__main__":
    common.main(__file__)
