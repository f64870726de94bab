"""How well does the walk engine walk, and how large may a step be?

    python tests/studies/walk.py             speeds, random plans, the feet, DRIFT; 20 seconds
    python tests/studies/walk.py --limits    maps of falls, on which LIMITS was chosen; 2 minutes
    python tests/studies/walk.py --tune      three searches for the parameters TUNED; an hour
    python tests/studies/walk.py --robot FILE.py    such searches for another robot, from its WALK on

(each with `--mujoco` in 3-D.) All robots have random bodies, and an IMU with errors. Every cell of a
map is eight walks. The searches print lines for TUNED, or for WALK of the file.
"""

from dataclasses import replace
from importlib import import_module
from pathlib import Path

import baseline
import common
import numpy as np
from common import env, evaluate, robot_model, walk_engine
from tqdm import tqdm

DURATION = "20 seconds; --limits 2 minutes; --tune an hour, in 3-D"
# The largest double step that is tried [2, 3] (left and right foot; m, m, rad), and which of x, y,
# yaw it moves. Our choice, from first trials.
DIRECTIONS = {
    "forward": ([[0.24, 0, 0], [0.24, 0, 0]], 0),
    "backward": ([[-0.20, 0, 0], [-0.20, 0, 0]], 0),
    "sideways": ([[0, 0.16, 0], [0, 0, 0]], 1),
    "turning": ([[0, 0, 0.60], [0, 0, -0.60]], 2),
}
LEVELS = 8  # step sizes tried per direction
PATTERN = (1, 1, 1, 1, 0, 0, 1, 1)  # double steps: start, stop, start again
FRICTION = (0.4, 0.7, 1.0)  # [-] μ of the speed test
PLANS = 96  # random ones
RANDOM = 1000  # random ones, for --limits
OURS = robot_model.RobotModel()


def speed_plans():
    """Footsteps [4 · LEVELS, 8, 2, 3] of the speed test: every direction at every level."""
    go = np.array(PATTERN)[:, None, None]  # [K, 1, 1]
    shares = (np.arange(LEVELS) + 1) / LEVELS
    return np.array([share * go * step for step, _ in DIRECTIONS.values() for share in shares])


def random_robots(rng, count):
    """Bodies, and `disturb` of `walk_plans`, as in stage 3: noise of the IMU at every tick."""
    std = np.repeat([env.Task.imu_rad, env.Task.imu_rad_s], 2)

    def disturb(k, disturbance, robots):
        # Drawn for all robots: so nobody's errors depend on who has fallen.
        shape = count, *disturbance.imu.shape[1:]
        disturbance.imu[:] = rng.normal(0, std, shape)[robots]

    return env.Spread().draw(rng.spawn(count), OURS), disturb


def highest_speed(poses, fall, period):
    """{direction: speed [m/s, rad/s]}: the fastest below the first that fell, of `speed_plans`.

    poses [4·LEVELS, K + 1, 3] and fall [4·LEVELS] as of `walk_plans`, period [s]. Row by row the
    levels of the first direction, then those of the second, and so on. A robot fell if its `fall`
    is less than len(PATTERN). A robot that did not fall at a level above a fall was lucky: it does
    not count.
    """
    # speed = |distance along the axis| / (Σ PATTERN · period)
    # A walk ends with the trunk between the feet. The last step of the right foot has moved the
    # trunk by half of that step only. So a half of twelve steps is missing, and speeds are 4 % too
    # low. This is not so sideways, where the right foot's steps have no length.
    speeds = {}
    for i, (direction, (_, axis)) in enumerate(DIRECTIONS.items()):
        rows = slice(i * LEVELS, (i + 1) * LEVELS)
        moved = np.abs(poses[rows, -1, axis] - poses[rows, 0, axis])  # [LEVELS]
        unbroken = np.cumprod(fall[rows] == len(PATTERN))  # 1 up to the first fall, then 0
        speeds[direction] = float(np.max(moved * unbroken) / (sum(PATTERN) * period))
    return speeds


def lowest(robot, torso, joints):
    """Height of each sole's lowest corner [..., 2], in the world [m]."""
    points, turns = robot_model.link_frames(robot, torso, joints)
    ankle, up = points[..., [4, 8], 2], turns[..., [4, 8], 2, :]  # up: third row of a foot's R
    outlines = [env.sole(robot, side) for side in (0, 1)]  # [2, 4, 2] seen from the ankles
    corners = np.insert(outlines, 2, -robot.ankle_height, -1)  # [2, 4, 3]
    return ankle + (corners @ up[..., None])[..., 0].min(-1)


def clearance(engine, motion):
    """How low the lowest corner of the swinging sole comes in the middle of its swing, between 30 and
    70 % of it: of the n robots that stood through a double step, both feet in turn, [2·n] [m].
    """
    up = ~motion.fell
    low = lowest(engine.robot, motion.torso[up], motion.joints[up])  # [n, T, 2]
    step_ticks = engine.parameters.step_ticks
    # A single step of step_ticks ticks: first nobody swings, then one foot does.
    #     tick   0 · · · wait · · · · · · · step_ticks      (the right foot: step_ticks later)
    #            |  both  |     swing      |
    wait = round(engine.parameters.double_support * step_ticks)
    swing = step_ticks - wait
    found = []
    for foot in (robot_model.LEFT, robot_model.RIGHT):
        # A motion has no state before its first tick: index i is what tick i + 1 left behind.
        first = foot * step_ticks + wait
        middle = slice(first + round(0.3 * swing) - 1, first + round(0.7 * swing))
        found.append(low[:, middle, foot].min(1))
    return np.concatenate(found)


def off_plan(planned, poses):
    """How far double steps end from their plan: the mean of each [3], and what a filter should
    expect of them, the deviation of the sum of five in a row ÷ √5 [3]; in m, m, rad.

    planned [n, K, 3]: the planned motion in each double step, seen from its beginning; poses
    [n, K + 1, 3] of n robots that did not fall. Errors in a row are alike (a robot that slips does
    so again), so their sum is larger than that of independent errors.
    """
    error = robot_model.relative(poses[:, :-1], poses[:, 1:]) - planned
    error[..., 2] = env.wrap(error[..., 2])
    last = error[:, -5:]
    return last.mean((0, 1)), last.sum(1).std(0) / 5**0.5


def measure_drift(sim):
    """`off_plan` of one random double step within 75 % of the limits, repeated: planners seldom ask
    for more, and on its way to a goal a robot takes similar steps in a row.
    """
    rng, limits, walk = np.random.default_rng(3000), env.LIMITS[sim], walk_engine.TUNED[sim]
    plans = 0.75 * rng.uniform(limits.low, limits.high, (RANDOM, 1, 2, 3)).repeat(len(PATTERN), 1)
    trunk = [np.tile([walk.trunk_x_offset, 0, 0], (RANDOM, 1))]  # as planned  [N, 3] each

    def watch(engine, plan, motion):
        trunk.append(engine.trunk_state[:, robot_model.GROUND, 0].copy())

    poses, _, fall = walk_engine.walk_plans(sim, walk, plans, *random_robots(rng, RANDOM), watch)
    trunk = np.stack(trunk, 1)  # [N, K + 1, 3]
    stood = fall == len(PATTERN)
    return off_plan(robot_model.relative(trunk[:, :-1], trunk[:, 1:])[stood], poses[stood])


def measure(sim, parameters, seed=0, frictions=FRICTION, count=PLANS):
    """How well robots with random bodies walk on random floors; a dict of plain numbers.

    speeds: per μ of frictions, by direction [m/s, rad/s]; stood: share of `count` robots that walked a
    random plan without a fall; clearance: median and 5th percentile of `clearance` over all walks [m].
    """
    rng, limits = np.random.default_rng(seed), env.LIMITS[sim]
    straight = speed_plans()
    random = rng.uniform(limits.low, limits.high, (count, len(PATTERN), 2, 3))
    plans = np.concatenate([*[straight] * len(frictions), random])
    body, gyros = random_robots(rng, len(plans))
    body.friction[:-count] = np.repeat(frictions, len(straight))
    feet = []

    def watch(engine, plan, motion):
        feet.append(clearance(engine, motion))

    poses, _, fall = walk_engine.walk_plans(sim, parameters, plans, body, gyros, watch)
    period = walk_engine.WalkEngine(1, parameters).period
    at_mu = np.arange(len(plans) - count).reshape(-1, len(straight))  # the rows of each μ
    return {
        "speeds": [highest_speed(poses[rows], fall[rows], period) for rows in at_mu],
        "stood": np.mean(fall[-count:] == len(PATTERN)),
        "clearance": np.percentile(np.concatenate(feet), [50, 5]),
    }


SEARCH = {  # tuned parameters and their ranges, of our robot; our choice
    "step_ticks": (27, 31.4),
    "foot_distance": (0.15, 0.19),
    "double_support": (0.0, 0.3),
    "foot_rise": (0.02, 0.06),
    "trunk_height": (0.36, 0.395),
    "trunk_phase": (-0.2, 0.2),
    "trunk_pitch": (0.0, 0.2),
    "trunk_x_offset": (-0.01, 0.03),
    "trunk_roll": (0.0, 0.1),
    "reflex": (0.0, 0.12),
    "capture": (0.4, 1.6),
    "usual_lean": (0.02, 0.07),
    "fade": (0.005, 0.05),
    "wait": (0.0, 20.0),
}
# In 2-D these stay as they are.
ONLY_3D = "foot_distance", "trunk_roll", "capture", "usual_lean", "fade", "wait"
RESTARTS, BUDGET = 3, 125_000  # searches, and the double steps of each
WALKS = 12  # of each candidate to near and as many to far goals, and all of them again with pushes
FRESH = 1000  # walks of each of these four kinds, that compare what the search has found
LENGTHS = "foot_distance", "foot_rise", "trunk_height", "trunk_x_offset"


def sway(parameters, robot):
    """By which share of the way to the support foot a pendulum sways: *sway* of predict.md."""
    step = parameters.step_ticks * robot.control_dt  # [s] P/2
    omega = (robot.gravity / parameters.trunk_height) ** 0.5  # [1/s]
    return 1 - 1 / np.cosh(omega * step / 2)


def walked(world, parameters, trial, count=WALKS, pushes=(0.0, baseline.PUSH)):
    """What `evaluate` returns, for `baseline_tuned` with this walk, to `count` near and far goals each
    for every push."""
    planner = evaluate.BaselinePlanner(evaluate.TUNED_BASELINE[world.sim])
    own = {"walk": parameters, "limits": world.limits, "robot": world.engine.robot}
    worlds = [env.FootstepWorld(2 * count, world.sim, True, push, **own) for push in pushes]
    return common.calm_and_pushed([planner], worlds, trial)[0]


def points(ended):
    """Those of the contest, which the search makes small: time [s], and the price of falls."""
    return baseline.points(baseline.facts(ended))


def tune(world, seed, fixed=(), **how):
    """A search from the walk of this world on, see `common.search`; fixed: names of what stays as it
    is, how: see `walked`. Returns WalkParameters, and a row for each generation. The trunk sways as
    much more or less as the pendulum does. ([5] used a tree-structured Parzen estimator.)
    """
    start, robot = world.engine.parameters, world.engine.robot
    fixed = (*fixed, *(() if world.sim == "mujoco" else ONLY_3D))
    names = [name for name in SEARCH if name not in fixed]
    mean = np.array([getattr(start, name) for name in names], float)
    # Another robot's lengths differ in proportion to its size; its own walk is always in the range.
    size = [robot.thigh_length / OURS.thigh_length if name in LENGTHS else 1 for name in names]
    low, high = np.array([SEARCH[name] for name in names]).T * size
    low, high = np.minimum(low, mean), np.maximum(high, mean)

    def changed(x):
        new = replace(start, **dict(zip(names, x.round(4).tolist())))
        new = replace(new, step_ticks=round(new.step_ticks))
        share = start.trunk_swing * sway(new, robot) / sway(start, robot)
        return replace(new, trunk_swing=round(float(share), 4))

    def walk(drawn, trial):
        return [walked(world, changed(x), trial, **how) for x in tqdm(drawn, leave=False)]

    x, curve = common.search(walk, points, mean, (high - low) / 8, BUDGET, seed, low, high)
    return changed(x), curve


CLEARANCE = "clearance, median [mm]", "clearance, 5 % [mm]"
CELLS, REPEATS = 15, 8  # along each axis of a map, walks in a cell
X = np.linspace(-0.24, 0.32, CELLS)  # [m]
MAPS = {  # title: label of the second axis, its values, first and then from (x, second)
    "forward and turning": (
        "yaw of both feet [rad]",
        np.linspace(-0.7, 0.7, CELLS),
        lambda x, yaw: [[[x, 0, yaw], [x, 0, -yaw]]] * 2,
    ),
    "forward and sideways": (
        "left foot outward [m]",
        np.linspace(0, 0.21, CELLS),
        lambda x, y: [[[x, y, 0], [x, 0, 0]]] * 2,
    ),
    "change of step length": (
        "x of the steps before [m]",
        X,
        lambda x, last: [[[last, 0, 0]] * 2, [[x, 0, 0]] * 2],
    ),
}


def fall_map(sim, steps):
    """Share of falls [R, C] of random robots; steps [R, C, 2, 2, 3]: three times the first double
    step, then five times the second one, varied by ± 5 %.
    """
    rng = np.random.default_rng(0)
    plans = steps[:, :, [0, 0, 0, 1, 1, 1, 1, 1]].reshape(-1, 8, 2, 3).repeat(REPEATS, 0)
    plans = plans * rng.uniform(0.95, 1.05, (len(plans), 1, 1, 3))  # [R · C · REPEATS, 8, 2, 3]
    robots = random_robots(rng, len(plans))
    _, _, fall = walk_engine.walk_plans(sim, walk_engine.TUNED[sim], plans, *robots)
    return (fall < 8).reshape(*steps.shape[:2], REPEATS).mean(-1)


def cells(steps, xs, others):
    """Double steps [len(others), len(xs), 2, 2, 3] of a map: first, then."""
    return np.array([[steps(x, other) for x in xs] for other in others], float)


def allowed(steps, limits):
    """Which double steps [..., 2, 2, 3] of a map an action can reach, all four footsteps."""
    beyond = np.abs(steps - np.clip(steps, limits.low, limits.high))
    return (beyond < 1e-9).all((-3, -2, -1))


def study_limits(args):
    """Rows of the three maps, and of random plans."""
    rows, limits = [], env.LIMITS[args.sim]
    for title, (_, second, steps) in MAPS.items():
        steps = cells(steps, X, second)
        falls = fall_map(args.sim, steps)
        row = {"map": title, "fall_inside": falls[allowed(steps, limits)].mean()}
        rows.append(row | {"fall_anywhere": falls.mean(), "falls": falls})
    walked = measure(args.sim, walk_engine.TUNED[args.sim], frictions=(), count=RANDOM)
    row = {"map": f"{RANDOM:,} random plans", "fall_inside": 1 - walked["stood"]}
    return [*rows, row | dict(zip(CLEARANCE, 1000 * walked["clearance"]))]


def study_tune(args):
    """The searches, and what they and the walk in use get on the same trials of their own."""
    args.friction = None
    world = env.FootstepWorld(1, **evaluate.world_settings(args))
    ends, curve, rows = [world.engine.parameters], [], []
    for restart in range(RESTARTS):
        parameters, more = tune(world, args.seed + restart)
        ends.append(parameters)
        curve += more
    for k, parameters in enumerate(ends):
        ended = walked(world, parameters, 1, FRESH)
        row = {"search": k or "none", "points": points(ended)}
        row["falls"] = int(common.fell(ended).sum())
        print(f"{row['points']:.2f} points, {row['falls']} falls of {4 * FRESH:,}: {parameters}")
        rows.append(row | vars(parameters))
    if args.robot:
        return None
    return {"rows": rows, "curve": curve}


def study_speeds(args):
    """Prints speeds, how random plans end, the feet, and what the filter should expect."""
    measured = measure(args.sim, walk_engine.TUNED[args.sim], 1000 + args.seed)
    rows = [{"μ": mu, **speeds} for mu, speeds in zip(FRICTION, measured["speeds"])]
    print(
        "Fastest with random bodies [m/s, rad/s]:",
        common.table(rows, dict.fromkeys(rows[0], 2)),
        sep="\n",
    )
    print(f"random plans standing {measured['stood']:.2f}")
    for name, height in zip(CLEARANCE, measured["clearance"]):
        print(f"{name}: {1000 * height:.1f}")
    for name, off in zip(("mean", "DRIFT"), measure_drift(args.sim)):
        print(f"walked − planned [m, m, rad], {name}:", off.round(4))


PARTS = {"limits": study_limits, "tune": study_tune, "speeds": study_speeds}


COLUMNS = {
    "tune": {"search": 0, "points": 2, "falls": 0},
    "limits": {"map": 0, "fall_inside": 2, "fall_anywhere": 2} | dict.fromkeys(CLEARANCE, 1),
}


def plot(found, sim):
    """Share of falls by colour; inside of the line is what an action can reach."""
    figure, axes = common.subplots(1, 3, figsize=(9, 3.6))
    for axis, (title, (label, second, steps)) in zip(axes, MAPS.items()):
        (row,) = common.pick(found["limits"]["rows"], map=title)
        image = axis.pcolormesh(X, second, row["falls"], cmap="Greys", vmin=0, vmax=1)
        fine, other = (np.linspace(1.5 * v[0] - 0.5 * v[1], v[-1], 300) for v in (X, second))
        inside = allowed(cells(steps, fine, other), env.LIMITS[sim])
        axis.contour(fine, other, inside, [0.5], colors="tab:green", linewidths=2)
        axis.grid(False)
        axis.set(title=title, xlabel="x of the steps [m]", ylabel=label)
    figure.colorbar(image, ax=axes, label="share of eight robots that fall")
    return figure


PICTURES = {"walk": ("limits", plot), "walk.tune": ("tune", common.plot_searches)}


FLAGS = {
    "limits": {"action": "store_true", "help": "maps of falls"},
    "tune": {"action": "store_true", "help": "optimise the walk parameters"},
    "robot": {"type": Path, "help": "optimise the WALK of this file for its ROBOT and LIMITS"},
}


def main(argv=None):
    study = import_module("walk")
    args = common.arguments(study, argv, **FLAGS)
    part = "tune" if args.tune or args.robot else "limits" if args.limits else "speeds"
    common.publish(study, part, args)


if __name__ == "__main__":
    robot_model.run_script(main)
