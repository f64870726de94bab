"""Stage 2: how do two footsteps become a walk?

Paper: the walk engine of [5]: quintic splines for the swing foot and the trunk, analytic inverse
kinematics, open loop within a double step; parameters found by optimisation.

    python 02_walk_engine.py             one plan, how well it walks, and four walks; 9 seconds
    python 02_walk_engine.py --tune      optimise the parameters (cross-entropy method); 12 minutes

(both with `--mujoco` in 3-D). The first prints how fast and how well it walks on drawn ground with
drawn bodies, and what four walks do; it draws `runs/<sim>/02_*.png`. The second prints a line for
TUNED. Expect: it walks nearly as far as commanded. Predict: with `--mujoco`, what does the trunk do
sideways in a straight walk, and why? (On the plane it need not do anything.)

A double step is a swing of the left foot and then one of the right. A footstep (x, y, yaw) says
where a swing foot lands, seen from the other foot and from its usual place beside it; y and yaw are
mirrored for the right foot, so that outward is positive for both. All zeros steps on the spot;
(0.08, 0, 0) for both feet moves it on by 0.16 m (at first less): each lands 0.08 m ahead;
(0, 0.06, 0) for the left and zeros for the right foot move it 0.06 m to the left.

Left out: stairs, and stabilising within a step: the engine is blind while it walks.

[5] Bestmann, Zhang, 2022: Bipedal Walking on Humanoid Robots through Parameter Optimization.
"""

from dataclasses import dataclass, replace
from importlib import import_module

import matplotlib.pyplot as plt
import numpy as np

# A module name may not start with a digit in an import statement, hence import_module.
robot_model = import_module("01_robot_model")
LEFT, RIGHT, compose = robot_model.LEFT, robot_model.RIGHT, robot_model.compose

@dataclass(frozen=True)
class WalkParameters:
    """Named after those of [5]. The values here are a first guess; those in use: TUNED."""
    frequency: float = 1.6  # [Hz] double steps per second; 1 / (2·frequency) in whole ticks
    double_support: float = 0.1  # [-] share of a single step with both feet on the ground
    foot_distance: float = 0.18  # [m] between the ankles when standing
    foot_rise: float = 0.05  # [m] apex of the swing foot
    trunk_height: float = 0.395  # [m] torso frame above the soles
    trunk_phase: float = -0.1  # [single steps] by which the trunk is late; above −0.5, below 0.5
    trunk_pitch: float = 0.1  # [rad] forward lean
    trunk_swing: float = 0.3  # [-] share of the way from the middle to the support foot it takes
    trunk_x_offset: float = 0.0  # [m] trunk ahead of the middle of the feet
    pitch_per_step: float = 0.0  # [rad/m] lean added per forward step length
    pitch_per_turn: float = 0.0  # [rad/rad] lean added per turn in a single step, to either side
    trunk_roll: float = 0.0  # [rad] towards the support foot, in the middle of a single step; ours

@dataclass(frozen=True)
class StepLimits:
    """The smallest and the largest footstep that a planner may ask for; see `within`."""
    low: tuple  # x [m], y [m], yaw [rad], outward positive
    high: tuple
    load: float = 1.5  # [-] largest sum of the shares of x, y and yaw; 3 would allow everything

TUNED = {  # by `--tune`; in 3-D twice, and with an earlier version of it; 2026-11-21
    "pymunk": WalkParameters(
        frequency=1.6129, double_support=0.0998, foot_rise=0.0226, trunk_height=0.3718,
        trunk_phase=0.0353, trunk_pitch=0.0773, trunk_swing=0.0, trunk_x_offset=0.0024,
        pitch_per_step=-0.0122, pitch_per_turn=0.1092),
    "mujoco": WalkParameters(
        frequency=1.6014, double_support=0.0855, foot_distance=0.1683, foot_rise=0.0312,
        trunk_height=0.3802, trunk_phase=-0.0469, trunk_pitch=0.0695, trunk_swing=0.2186,
        trunk_x_offset=0.013, pitch_per_step=-0.2545, pitch_per_turn=0.0214, trunk_roll=0.0541),
}
# Our choice, on the maps of `python tests/studies/limits.py`. Planar sideways steps cannot fall, so
# their limit is the 3-D robot's. Feet within these limits do not touch one another.
LIMITS = {
    "pymunk": StepLimits(low=(-0.16, -0.04, -0.40), high=(0.18, 0.10, 0.60)),
    "mujoco": StepLimits(low=(-0.12, -0.04, -0.30), high=(0.16, 0.10, 0.45)),
}
MIRROR = np.array([[1, 1, 1], [1, -1, -1]])  # footsteps of the left and of the right foot

def within(footsteps, limits):
    """Footsteps [..., 2, 3] made smaller where x, y and yaw together ask for too much.

    Each uses a share of its limit, 0 to 1; together at most `load`. So a footstep may use all of
    one limit and half of another, but not all of all three.
    """
    # s = |x| / x_max + |y| / y_max + |yaw| / yaw_max;   footstep ← footstep · min(1, load / s)
    largest = np.where(footsteps >= 0, limits.high, np.negative(limits.low))
    share = (np.abs(footsteps) / largest).sum(-1, keepdims=True)
    return footsteps / np.maximum(1, share / limits.load)

# ------------------------------------------------------------------------ quintic splines
def quintic(start, end, duration):
    """Coefficients c [..., 6] of x(t) = Σ cₖ·tᵏ with three boundary conditions at each end.

    start, end [..., 3]: position, velocity, acceleration at t = 0 and t = duration [s].
    """
    p0, v0, a0 = np.moveaxis(np.asarray(start, float), -1, 0)
    p1, v1, a1 = np.moveaxis(np.asarray(end, float), -1, 0)
    D = duration
    # c₀ = p₀, c₁ = v₀, c₂ = a₀/2 hold at t = 0. What they leave open at t = D:
    p = p1 - p0 - v0 * D - a0 * D**2 / 2
    v = v1 - v0 - a0 * D
    a = a1 - a0
    # c₃D³ + c₄D⁴ + c₅D⁵ = p,  3c₃D² + 4c₄D³ + 5c₅D⁴ = v,  6c₃D + 12c₄D² + 20c₅D³ = a, solved:
    c3 = (20 * p - 8 * v * D + a * D**2) / (2 * D**3)
    c4 = (-30 * p + 14 * v * D - 2 * a * D**2) / (2 * D**4)
    c5 = (12 * p - 6 * v * D + a * D**2) / (2 * D**5)
    return np.stack([p0, v0, a0 / 2, c3, c4, c5], -1)

def polynomial(c, t, order=0):
    """The spline's position, or its derivative of that order: c [..., 6], t [K] -> [..., K]."""
    derived = np.polynomial.polynomial.polyder(np.moveaxis(c, -1, 0), order)
    return np.polynomial.polynomial.polyval(t, derived)

# ------------------------------------------------------------------------ the engine
class WalkEngine:
    """Plans double steps of N robots. Remembers where each robot's feet and trunk should be.

    All poses live in one fixed frame: the middle between the feet, where they stood after a reset.
    """
    def __init__(self, num_robots, parameters, robot=robot_model.RobotModel(), planar=False):
        self.parameters, self.robot, self.planar, p = parameters, robot, planar, parameters
        self.half_ticks = max(2, round(0.5 / parameters.frequency / robot.control_dt))
        self.half = self.half_ticks * robot.control_dt  # [s] a single step
        self.period = 2 * self.half  # [s] a double step
        self.stance = robot_model.stance(robot, p.trunk_height, p.foot_distance, p.trunk_pitch,
                                         planar, p.trunk_x_offset)  # torso, joints
        self.feet = np.zeros((num_robots, 2, 3))  # left, right: x, y [m], yaw [rad]
        # Trunk: x, y, yaw, pitch (its height is constant, its roll a sine), and of each of them
        self.trunk = np.zeros((num_robots, 4, 3))  # position, velocity, acceleration
        self.reset(np.arange(num_robots))

    def reset(self, robots):
        """These robots [n] stand still."""
        p = self.parameters
        self.feet[robots], self.trunk[robots] = 0, 0
        self.feet[robots, :, 1] = p.foot_distance / 2, -p.foot_distance / 2
        self.trunk[robots, :, 0] = p.trunk_x_offset, 0, 0, p.trunk_pitch

    def landings(self, right, footsteps):
        """Where the left and then the right foot land [n, 3]; right [n, 3], footsteps [n, 2, 3]."""
        beside = np.array([[0, 1, 0], [0, -1, 0]]) * self.parameters.foot_distance
        steps = footsteps * MIRROR + beside  # [n, 2, 3] each foot seen from the other one
        left = compose(right, steps[:, LEFT])
        return left, compose(left, steps[:, RIGHT])

    def plan(self, footsteps, robots):
        """Next double step of these robots [n]: their Trajectory, and their feet.

        footsteps [n, 2, 3]: left, right; x, y [m], yaw [rad], outward positive. Feet
        [n, T + 1, 2, 4]: x, y, z of the sole [m], yaw [rad].

            time   0 · · · · · · · · half · · · · · · · period · · · · · · ·
            left   |wait|   swing    |       support       |
            right  |     support     |wait|   swing        |
            trunk  ├───── knot 1 ────────── knot 2 ────────┤──── (knot 3)   + trunk_phase
                 state                                   state
        """
        left, right = self.feet[robots, LEFT], self.feet[robots, RIGHT]
        new_left, new_right = self.landings(right, footsteps)
        # The next left step is not known yet: we expect the same one again.
        next_left, _ = self.landings(new_right, footsteps)
        knots = [self._knot(right, left, new_left), self._knot(new_left, right, new_right),
                 self._knot(new_right, new_left, next_left)]
        trunk = self._trunk_path(knots, robots)  # [n, T + 1, 6]
        feet = self._feet_path(left, right, new_left, new_right)
        self.feet[robots] = np.stack([new_left, new_right], 1)
        joints = robot_model.body_inverse(self.robot, trunk, feet, self.planar)
        return robot_model.Trajectory(joints, trunk), feet

    def _knot(self, support, start, landing):
        """What the trunk's spline goes through half way in a single step, [n, 4, 3].

        Three feet [n, 3]: the support foot, and the swing foot before and after. The trunk is
        half way between the middles of the feet before and after, moves with the mean velocity,
        without acceleration, and is shifted towards the support foot.
        """
        # aside = trunk_swing · y of the support foot, seen from the middle
        # lean  = trunk_pitch + pitch_per_step · forward + pitch_per_turn · |turn|,   forward, turn:
        #         what the middle of the feet does, seen in the yaw that it has half way
        p = self.parameters
        before, after = (support + start) / 2, (support + landing) / 2  # middle of the feet
        centre = (before + after) / 2
        aside = p.trunk_swing * robot_model.relative(centre, support)[:, 1]  # [n]
        offset = np.stack([np.full_like(aside, p.trunk_x_offset), aside, 0 * aside], -1)
        knot = np.zeros((len(centre), 4, 3))
        knot[:, :3, 0] = compose(centre, offset)
        knot[:, :3, 1] = (after - before) / self.half
        ahead = robot_model.turned((after - before)[:, :2], -centre[:, 2])[:, 0]  # [n] [m]
        turn = np.abs(after - before)[:, 2]
        knot[:, 3, 0] = p.trunk_pitch + p.pitch_per_step * ahead + p.pitch_per_turn * turn
        return knot

    def _trunk_path(self, knots, robots):
        """x, y, z, roll, pitch, yaw of the trunk, [n, T + 1, 6]: one quintic from knot to knot."""
        time = np.arange(2 * self.half_ticks + 1) * self.robot.control_dt  # [T + 1]
        state, start = self.trunk[robots], 0.0
        path = np.empty((len(state), 4, len(time)))
        for k, knot in enumerate(knots):
            end = (k + 0.5 + self.parameters.trunk_phase) * self.half  # [s] time of the knot
            c = quintic(state, knot, end - start)  # [n, 4, 6]
            inside = (time > start - 1e-9) & (time <= end + 1e-9)
            path[..., inside] = polynomial(c, time[inside] - start)
            if k < 2:
                state, start = knot, end
        # The double step ends within the last spline c; the next one takes over its state there.
        self.trunk[robots] = np.stack([polynomial(c, self.period - start, k) for k in range(3)], -1)
        trunk = np.zeros((len(path), len(time), 6))
        trunk[..., [0, 1, 5, 4]] = path.swapaxes(1, 2)
        trunk[..., 2] = self.parameters.trunk_height
        # The left foot swings first, and its side is lifted: a positive roll.
        trunk[..., 3] = self.parameters.trunk_roll * np.sin(np.pi * time / self.half)
        return trunk

    def _feet_path(self, left, right, new_left, new_right):
        """x, y, z, yaw of both soles, [n, T + 1, 2, 4]: each stands while the other one swings."""
        change = self.half_ticks  # the tick when the support foot changes
        feet = np.zeros((len(left), 2 * change + 1, 2, 4))
        feet[:, : change + 1, LEFT] = self._swing(left, new_left)
        feet[:, change:, LEFT][..., [0, 1, 3]] = new_left[:, None]  # x, y, yaw; z stays 0
        feet[:, :change, RIGHT][..., [0, 1, 3]] = right[:, None]
        feet[:, change:, RIGHT] = self._swing(right, new_right)
        return feet

    def _swing(self, start, landing):
        """Swing foot [n, half_ticks + 1, 4] (x, y, z, yaw): waits, rises, lands."""
        wait = self.parameters.double_support * self.half
        swing = self.half - wait  # [s]
        t = np.arange(self.half_ticks + 1) * self.robot.control_dt  # [half_ticks + 1] [s]
        t = np.clip(t - wait, 0, swing)
        zero = np.zeros_like(start)
        begin, end = (np.stack([pose, zero, zero], -1) for pose in (start, landing))  # at rest
        foot = np.zeros((len(start), len(t), 4))
        foot[..., [0, 1, 3]] = polynomial(quintic(begin, end, swing), t).swapaxes(1, 2)
        up = quintic([0, 0, 0], [self.parameters.foot_rise, 0, 0], swing / 2)  # [6]
        foot[..., 2] = polynomial(up, np.minimum(t, swing - t))  # down is up, mirrored in time
        return foot

def walk(sim, parameters, footsteps, body=None, watch=None):
    """Walk N robots (body: what they drew) through K double steps [N, K, 2, 3], from standing.

    Returns torso poses [N, K + 1, 3], commanded poses between the feet [N, K + 1, 3] (yaws
    unwrapped), and in which double step each robot fell [N] (K: it stayed up). watch(engine,
    motion) is called after every double step.
    """
    footsteps = np.asarray(footsteps, float)
    n, count = footsteps.shape[:2]
    engine = WalkEngine(n, parameters, planar=sim == "pymunk")
    simulator = robot_model.make_sim(sim, n, engine.stance)
    simulator.reset(np.arange(n), body)
    poses, wanted = np.zeros((2, n, count + 1, 3))
    fall = np.full(n, count)
    for k in range(count):
        poses[:, k + 1], wanted[:, k + 1] = poses[:, k], wanted[:, k]
        up = np.flatnonzero(fall == count)
        if len(up):
            motion = simulator.run(engine.plan(footsteps[up, k], up)[0], up)
            poses[up, k + 1] = motion.torso[:, -1, [0, 1, 5]]
            wanted[up, k + 1] = engine.feet[up].mean(1)
            fall[up[motion.fell]] = k
            if watch:
                watch(engine, motion)
    simulator.close()
    poses[..., 2] = np.unwrap(poses[..., 2], axis=1)
    return poses, wanted, fall

# ------------------------------------------------------------------------ how well it walks
# The largest double step that is tried [2, 3] (left and right foot; m, m, rad), which of x, y, yaw
# it moves, and the speed that we require [m/s, rad/s]. Our choice, from first trials.
DIRECTIONS = {
    "forward": ([[0.24, 0, 0], [0.24, 0, 0]], 0, 0.30),
    "backward": ([[-0.20, 0, 0], [-0.20, 0, 0]], 0, 0.25),
    "sideways": ([[0, 0.16, 0], [0, 0, 0]], 1, 0.20),
    "turning": ([[0, 0, 0.60], [0, 0, -0.60]], 2, 1.3),
}
LEVELS = 8  # step sizes tried per direction
PATTERN = (1, 1, 1, 1, 0, 0, 1, 1)  # double steps: start, stop, start again
FRICTION = (0.4, 0.7, 1.0)  # [-] μ of the speed test
PLANS = 96  # random ones

def speed_plans():
    """Footsteps [4 · LEVELS, 8, 2, 3] of the speed test: every direction at every level."""
    go = np.array(PATTERN)[:, None, None]  # [K, 1, 1]
    shares = (np.arange(LEVELS) + 1) / LEVELS
    return np.array([share * go * step for step, _, _ in DIRECTIONS.values() for share in shares])

def random_plans(rng, limits, count):
    """Footsteps [count, 8, 2, 3] drawn evenly within the limits: harder than any planned walk."""
    return within(rng.uniform(limits.low, limits.high, (count, len(PATTERN), 2, 3)), limits)

def highest_speed(poses, fall, period):
    """{direction: speed [m/s, rad/s]}: the fastest below the first that fell, of `speed_plans`.

    poses [4·LEVELS, K + 1, 3] and fall [4·LEVELS] as of `walk`, period [s].
    """
    # speed = |way along the axis| / (Σ PATTERN · period); ends amid a step: 4 % low, not sideways
    speeds = {}
    for i, (direction, (_, axis, _)) in enumerate(DIRECTIONS.items()):
        rows = slice(i * LEVELS, (i + 1) * LEVELS)
        moved = np.abs(poses[rows, -1, axis] - poses[rows, 0, axis])  # [LEVELS]
        unbroken = np.cumprod(fall[rows] == len(PATTERN))  # 1 up to the first fall, then 0
        speeds[direction] = float(np.max(moved * unbroken) / (sum(PATTERN) * period))
    return speeds

def soles(robot, torso, joints):
    """Ankles [..., 2, 3] and the height of each sole's lowest corner [..., 2], in the world [m]."""
    points, turn = robot_model.body_points(robot, torso, joints)
    ankle, z = points[..., 2, :], turn[..., 2, :]  # z [..., 2, 3]: rise per metre along x, y, z
    middle = np.array([1, -1]) * robot.foot_outward  # of the left and of the right sole
    heights = [x * z[..., 0] + (middle + y) * z[..., 1] - robot.ankle_height * z[..., 2]
               for x in (-robot.foot_back, robot.foot_front)
               for y in (-robot.foot_width / 2, robot.foot_width / 2)]
    return ankle, ankle[..., 2] + np.min(heights, 0)

def measure(sim, parameters, seed=0):
    """How well robots with drawn bodies walk on drawn ground; a dict of plain numbers.

    speeds: per μ of FRICTION, by direction [m/s, rad/s]; tracking: walked ÷ commanded, mean of
    steps of a quarter and of half the largest size, likewise; stood: share of random plans that did
    not fall; steps: share of their double steps before a fall; clearance: lowest corner of the
    swinging sole between 30 and 70 % of its swing, median and 5th percentile [m]; slip: way of the
    support foot's ankle while the other foot is in the air, median [m]; both over all walks.
    """
    rng, straight = np.random.default_rng(seed), speed_plans()
    plans = np.concatenate([*[straight] * len(FRICTION), random_plans(rng, LIMITS[sim], PLANS)])
    body = robot_model.Spread().draw(rng.spawn(len(plans)), robot_model.RobotModel())
    body.friction[: -PLANS] = np.repeat(FRICTION, len(straight))
    clearance, slip = [], []

    def watch(engine, motion):
        ankle, low = soles(engine.robot, motion.torso[~motion.fell], motion.joints[~motion.fell])
        wait = round(parameters.double_support * engine.half_ticks)  # [ticks]
        swing = engine.half_ticks - wait
        for foot, start in ((LEFT, wait), (RIGHT, engine.half_ticks + wait)):
            inner = slice(start - 1 + round(0.3 * swing), start + round(0.7 * swing))
            clearance.append(low[:, inner, foot].min(1))  # index i is the end of tick i + 1
            way = ankle[:, start + swing - 1, 1 - foot] - ankle[:, start, 1 - foot]
            slip.append(np.hypot(way[:, 0], way[:, 1]))

    poses, wanted, fall = walk(sim, parameters, plans, body, watch)
    period, speeds, tracking = WalkEngine(1, parameters).period, [], []
    for first in np.arange(len(FRICTION)) * len(straight):
        rows = slice(first, first + len(straight))
        speeds.append(highest_speed(poses[rows], fall[rows], period))
        ratio = poses[rows, -1] / np.where(wanted[rows, -1] == 0, np.nan, wanted[rows, -1])
        gentle = np.array([LEVELS // 4, LEVELS // 2]) - 1  # levels
        tracking.append({name: float(ratio[i * LEVELS + gentle, axis].mean())
                         for i, (name, (_, axis, _)) in enumerate(DIRECTIONS.items())})
    return {"speeds": speeds, "tracking": tracking,
            "stood": float(np.mean(fall[-PLANS:] == len(PATTERN))),
            "steps": float(np.mean(fall[-PLANS:]) / len(PATTERN)),
            "clearance": np.percentile(np.concatenate(clearance), [50, 5]).tolist(),
            "slip": float(np.median(np.concatenate(slip)))}

def average(parts):
    """The mean of several `measure`s, number by number."""
    if isinstance(parts[0], dict):
        return {key: average([part[key] for part in parts]) for key in parts[0]}
    if isinstance(parts[0], list):
        return [average(row) for row in zip(*parts)]
    return float(np.mean(parts))

# ------------------------------------------------------------------------ tuning
SEARCH = {  # tuned parameters and their ranges: those of [5], some made wider
    "frequency": (1.0, 3.0), "double_support": (0.0, 0.4), "foot_distance": (0.15, 0.22),
    "foot_rise": (0.02, 0.10), "trunk_height": (0.36, 0.42), "trunk_phase": (-0.45, 0.45),
    "trunk_pitch": (-0.1, 0.3), "trunk_swing": (0.0, 0.8), "trunk_x_offset": (-0.03, 0.03),
    "pitch_per_step": (-1.0, 1.0), "pitch_per_turn": (-0.5, 0.5), "trunk_roll": (-0.02, 0.12),
}
PLANAR_FIXED = ("trunk_swing", "foot_distance", "trunk_roll")  # hardly matter in the plane

def score(sim, measured):
    """What tuning maximises; see `measure`.

    Mean of √(speed / required speed) at the worst μ + 2 · share of random double steps + share of
    random plans − mean |walked ÷ commanded − 1| + median clearance / 8 mm, at most 1. The root
    makes a slow direction count more than a fast one; slip is only printed.
    """
    real = [name for name in DIRECTIONS if (sim, name) != ("pymunk", "sideways")]  # not simulated
    worst = [min(at[name] for at in measured["speeds"]) / DIRECTIONS[name][2] for name in real]
    off = [abs(at[name] - 1) for at in measured["tracking"] for name in real]
    feet = min(measured["clearance"][0] / 0.008, 1)  # more is not rewarded
    return np.mean(np.sqrt(worst)) + 2 * measured["steps"] + measured["stood"] - np.mean(off) + feet

def tune(sim, seed, iterations=10, population=28, elite=7):
    """Cross-entropy method: draw candidates, keep the best quarter, draw nearer to them.

    Begins at TUNED: paste the result there, and a second call goes on. [5] used a tree-structured
    Parzen estimator for the same question. Returns WalkParameters.
    """
    names = [k for k in SEARCH if sim == "mujoco" or k not in PLANAR_FIXED]
    low, high = np.array([SEARCH[k] for k in names]).T
    rng = np.random.default_rng(seed)
    mean, spread = np.array([getattr(TUNED[sim], k) for k in names]), (high - low) / 10
    for iteration in range(iterations):
        drawn = np.clip(mean + spread * rng.normal(size=(population, len(names))), low, high)
        drawn[0] = mean
        tried = [replace(TUNED[sim], **dict(zip(names, x.round(4).tolist()))) for x in drawn]
        seen = [measure(sim, one, iteration) for one in tried]  # same worlds; main: others
        scores = [score(sim, measured) for measured in seen]
        best = np.argsort(scores)[::-1][:elite]
        # Seven samples are noisy: keep some of the old distribution.
        mean = 0.3 * mean + 0.7 * drawn[best].mean(0)
        spread = 0.5 * spread + 0.5 * drawn[best].std(0)
        print(f"{iteration:3d}  score of the mean {scores[0]:.3f}, best {scores[best[0]]:.3f}  |  "
              f"{in_words(seen[0])}\n{tried[0]}", flush=True)
    return replace(TUNED[sim], **dict(zip(names, mean.round(4).tolist())))

def in_words(measured):
    """The worst and the typical of `measure` in a line."""
    worst = (f"{k} {min(at[k] for at in measured['speeds']):.2f}" for k in DIRECTIONS)
    ratios = [ratio for at in measured["tracking"] for ratio in at.values()]
    clear = " / ".join(f"{1000 * value:.1f}" for value in measured["clearance"])
    return (f"{', '.join(worst)} (worst μ)  |  walked ÷ commanded {min(ratios):.2f} to "
            f"{max(ratios):.2f}  |  random plans standing {measured['stood']:.2f}  |  clearance "
            f"{clear} mm (median / 5 %)  |  slip {1000 * measured['slip']:.1f} mm")

# ------------------------------------------------------------------------ demonstration
WALKS = {  # eight double steps each
    "forward": [[0.08, 0, 0], [0.08, 0, 0]],
    "backward": [[-0.06, 0, 0], [-0.06, 0, 0]],
    "sideways": [[0, 0.06, 0], [0, 0, 0]],
    "a left turn": [[0.06, 0, 0.15], [0.06, 0, -0.15]],
}

def main():
    parser = robot_model.StageParser(__doc__)
    parser.add_argument("--tune", action="store_true", help="optimise the walk parameters")
    args = parser.parse()
    out = parser.folder(args)
    if args.tune:
        print(tune(args.sim, args.seed))
        return
    engine = WalkEngine(1, TUNED[args.sim], planar=args.sim == "pymunk")
    print(f"{args.sim}: a double step takes {engine.period:.2f} s")
    for _ in range(2):  # the second double step: not from standing
        trajectory, feet = engine.plan(np.array([WALKS["forward"]]), [0])
    time = np.arange(feet.shape[1]) * engine.robot.control_dt
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
    titles = "forward: x [m]", "sideways: y [m]", "height of the soles: z [m]"
    for k, (axis, title) in enumerate(zip(axes, titles)):
        for foot, name in ((LEFT, "left foot"), (RIGHT, "right foot")):
            axis.plot(time, feet[0, :, foot, k], color=robot_model.COLORS[foot], label=name)
        if k < 2:
            axis.plot(time, trajectory.trunk[0, :, k], "k", label="trunk")
        axis.axvline(engine.half, color="0.7", lw=1, label="the support foot changes")
        axis.set(title=title, xlabel="time [s]")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    figure.suptitle("A double step amid a walk: the left foot swings, then the right")
    robot_model.atomic_write(out / "02_plan.png", lambda file: figure.savefig(file, dpi=110))

    plans = np.repeat(np.array(list(WALKS.values()))[:, None], 8, 1)  # [4, K, 2, 3]
    poses, wanted, fall = walk(args.sim, TUNED[args.sim], plans)
    seen = average([measure(args.sim, TUNED[args.sim], 1000 + 3 * args.seed + k) for k in range(3)])
    for mu, speeds, ratios in zip(FRICTION, seen["speeds"], seen["tracking"]):
        print(f"μ {mu}, drawn bodies: fastest (and walked ÷ commanded)",
              ", ".join(f"{name} {speeds[name]:.2f} ({ratios[name]:.2f})" for name in speeds))
    print(in_words(seen))
    print("walk           commanded x, y [m], yaw [rad]   walked               fell")
    figure, axis = plt.subplots(figsize=(8, 4), layout="constrained")
    for name, asked, walked, when in zip(WALKS, wanted, poses, fall):
        a, b = ("{:5.2f} {:5.2f} {:5.2f}".format(*path[-1]) for path in (asked, walked))
        print(f"{name:14s} {a:31s} {b:20s} {'yes' if when < 8 else 'no'}")
        line, = axis.plot(*walked[:, :2].T, ".-", label=name)
        axis.plot(*asked[:, :2].T, "x", color=line.get_color())
    axis.set(xlabel="x [m]", ylabel="y [m]", aspect="equal",
             title=f"Eight double steps ({args.sim}), dots: measured, crosses: commanded")
    axis.legend()
    axis.grid(alpha=0.3)
    robot_model.atomic_write(out / "02_walk.png", lambda file: figure.savefig(file, dpi=110))
    print("Look at", out / "02_plan.png", "and", out / "02_walk.png")

if __name__ == "__main__":
    robot_model.run(main)
