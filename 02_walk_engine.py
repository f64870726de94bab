"""Stage 2: how do two footsteps become a walk?

Paper: the walk engine of its reference [5]: quintic splines for the swing foot and the trunk,
analytic inverse kinematics, open loop within a double step; parameters found by optimisation.

    python 02_walk_engine.py             figures of one plan and of the walked path; seconds
    python 02_walk_engine.py --tune      optimise the parameters (cross-entropy method); 5 minutes
    python 02_walk_engine.py --limits    verify the step limits: maps of falls; 15 seconds

(all with `--mujoco` in 3-D). Writes `runs/<sim>/02_*.png`, prints commanded and walked distance.

A footstep (x, y, yaw) is the pose of the landing foot seen from the commanded support foot, minus
the lateral foot distance: all zeros steps on the spot. y and yaw are mirrored for the right foot,
so that outward is positive for both. The left foot swings first, then the right one.

Left out: stepping on stairs, stabilising within a step (the engine is blind while it walks).
"""

import math
from dataclasses import dataclass, replace
from importlib import import_module

import numpy as np

# A module name may not start with a digit in an import statement, hence import_module.
robot_model = import_module("01_robot_model")


@dataclass(frozen=True)
class WalkParameters:
    """Named after those of [5]. These values are where the tuning starts; the used ones: TUNED."""

    frequency: float = 1.6  # [Hz] double steps per second
    double_support: float = 0.1  # [-] share of a single step with both feet on the ground
    foot_distance: float = 0.18  # [m] between the ankles when standing
    foot_rise: float = 0.05  # [m] apex of the swing foot
    trunk_height: float = 0.395  # [m] torso frame above the soles
    trunk_phase: float = -0.1  # [-] trunk against feet, in single steps
    trunk_pitch: float = 0.1  # [rad] forward lean
    trunk_swing: float = 0.3  # [-] how far the trunk moves from the middle to the support foot
    trunk_x_offset: float = 0.0  # [m] trunk ahead of the middle of the feet
    trunk_y_offset: float = 0.0  # [m]
    pitch_per_step: float = 0.0  # [rad/m] lean added per forward step length
    pitch_per_turn: float = 0.0  # [-] lean added per turn of a step


@dataclass(frozen=True)
class StepLimits:
    """What an action of 0 and of 1 mean, for the left foot; the right one is mirrored."""

    low: tuple  # x [m], y [m], yaw [rad]
    high: tuple


TUNED = {  # by `python 02_walk_engine.py --tune` and `… --tune --mujoco`, seed 0, 2026-11-21
    "pymunk": WalkParameters(
        frequency=1.8034, double_support=0.116, foot_rise=0.0285, trunk_height=0.3792,
        trunk_phase=0.0705, trunk_pitch=0.0756, trunk_swing=0.0, trunk_x_offset=0.0051,
        pitch_per_step=-0.0138, pitch_per_turn=0.1447,
    ),
    "mujoco": WalkParameters(
        frequency=1.7702, double_support=0.0861, foot_distance=0.2006, foot_rise=0.0234,
        trunk_height=0.3764, trunk_phase=-0.0283, trunk_pitch=0.0216, trunk_swing=0.2409,
        trunk_x_offset=0.0065, pitch_per_step=-0.2323, pitch_per_turn=0.0334,
    ),
}  # fmt: skip
# Our choice, seen on the maps of --limits: x reaches beyond the edge where falls begin, so does a
# turn or a sideways step together with a long x. Planar sideways steps cannot fall, so their
# limit is the 3-D robot's.
LIMITS = {
    "pymunk": StepLimits(low=(-0.20, -0.04, -0.40), high=(0.22, 0.10, 0.60)),
    "mujoco": StepLimits(low=(-0.12, -0.04, -0.30), high=(0.16, 0.10, 0.45)),
}
MIRROR = np.array([[1, 1, 1], [1, -1, -1]])  # footsteps of the left and of the right foot
CLEARANCE = 0.01  # [m] between the soles of neighbouring footsteps; our choice


# ---------------------------------------------------------------------------- quintic splines


def quintic(start, end, duration):
    """Coefficients c [..., 6] of x(t) = Σ cₖ·tᵏ with both boundary conditions.

    start, end [..., 3]: position, velocity, acceleration at t = 0 and t = duration [s].
    """
    p0, v0, a0 = np.moveaxis(np.asarray(start, float), -1, 0)
    p1, v1, a1 = np.moveaxis(np.asarray(end, float), -1, 0)
    T = duration
    # c₀ = p₀, c₁ = v₀, c₂ = a₀/2 hold at t = 0. What they leave open at t = T:
    p = p1 - p0 - v0 * T - a0 * T**2 / 2
    v = v1 - v0 - a0 * T
    a = a1 - a0
    # c₃T³ + c₄T⁴ + c₅T⁵ = p,  3c₃T² + 4c₄T³ + 5c₅T⁴ = v,  6c₃T + 12c₄T² + 20c₅T³ = a, solved:
    c3 = (20 * p - 8 * v * T + a * T**2) / (2 * T**3)
    c4 = (-30 * p + 14 * v * T - 2 * a * T**2) / (2 * T**4)
    c5 = (12 * p - 6 * v * T + a * T**2) / (2 * T**5)
    return np.stack(np.broadcast_arrays(p0, v0, a0 / 2, c3, c4, c5), -1)


def polynomial(c, t, order=0):
    """The spline's position (or its derivative of that order): c [..., 6], t [K] -> [..., K]."""
    for _ in range(order):  # d/dt Σ cₖtᵏ = Σ k·cₖ·tᵏ⁻¹
        c = c[..., 1:] * np.arange(1, c.shape[-1])
    value = np.zeros(1)
    for k in reversed(range(c.shape[-1])):  # Horner
        value = value * t + c[..., k, None]
    return value


# ---------------------------------------------------------------------------- poses in the plane


def turned(vector, yaw):
    """Vectors [..., 2] turned by yaw [...]."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    x, y = vector[..., 0], vector[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], -1)


def compose(base, pose):
    """The pose [..., 3] (x, y, yaw) given in the frame `base` [..., 3], seen from outside."""
    place = base[..., :2] + turned(pose[..., :2], base[..., 2])
    return np.concatenate([place, (base[..., 2] + pose[..., 2])[..., None]], -1)


def relative(base, pose):
    """The pose [..., 3] seen from the frame `base` [..., 3]; inverse of `compose`."""
    place = turned(pose[..., :2] - base[..., :2], -base[..., 2])
    return np.concatenate([place, (pose[..., 2] - base[..., 2])[..., None]], -1)


# ---------------------------------------------------------------------------- the engine


class WalkEngine:
    """Plans double steps of N robots. Remembers per robot where its walk is: feet and trunk.

    The common frame of a plan is the commanded right foot, the first support foot, at its start.
    """

    AXES = 4  # of the trunk: x, y, yaw, pitch; its height is constant, it does not roll

    def __init__(self, num_robots, parameters, robot=robot_model.RobotModel(), planar=False):
        self.parameters, self.robot, self.planar = parameters, robot, planar
        # A single step lasts whole control ticks, so the frequency is rounded.
        self.half_ticks = max(2, round(0.5 / parameters.frequency / robot.control_dt))
        self.half = self.half_ticks * robot.control_dt  # [s] one single step
        self.period = 2 * self.half  # [s] one double step
        p = parameters
        self.stance = robot_model.stance(
            robot, p.trunk_height, p.foot_distance, p.trunk_pitch, planar, p.trunk_x_offset
        )  # [12] joints
        self._left = np.zeros((num_robots, 3))  # left foot seen from the right one
        self._trunk = np.zeros((num_robots, self.AXES, 3))  # position, velocity, acceleration
        self.reset(np.arange(num_robots))

    def reset(self, robots):
        """These robots [n] stand still."""
        p = self.parameters
        self._left[robots] = 0, p.foot_distance, 0
        self._trunk[robots] = 0
        self._trunk[robots, :, 0] = p.trunk_x_offset, p.foot_distance / 2, 0, p.trunk_pitch

    def clip(self, footsteps):
        """Footsteps [n, 2, 3] whose soles would touch, side by side, moved outward.

        Never acts within LIMITS (soles need 0.11 m, those leave 0.14 m): it is for your own.
        """
        robot, distance = self.robot, self.parameters.foot_distance
        yaw = footsteps[..., 2]
        # Both soles reach `inner` inward from their ankles. A landing foot that is turned brings a
        # corner further in: its heel when turned outward, its toes when turned inward.
        inner = robot.foot_width / 2 - robot.foot_outward
        corner = np.maximum(robot.foot_back * np.sin(yaw), -robot.foot_front * np.sin(yaw))
        apart = inner + inner * np.cos(yaw) + corner + CLEARANCE  # [n, 2] between the ankles
        clipped = footsteps.copy()
        clipped[..., 1] = np.maximum(footsteps[..., 1], apart - distance)
        return clipped

    def plan(self, footsteps, robots):
        """Trajectory of the next double step of these robots [n], and the footsteps executed.

        footsteps [n, 2, 3]: left, right; x, y [m], yaw [rad], outward positive.
        """
        p, half, ticks = self.parameters, self.half, self.half_ticks
        footsteps = self.clip(np.asarray(footsteps, float))
        n = len(footsteps)
        # Landing poses: left foot seen from the right one, then right foot seen from the left one.
        steps = footsteps * MIRROR + [[0, p.foot_distance, 0], [0, -p.foot_distance, 0]]
        right = np.zeros((n, 3))
        left = self._left[robots]
        new_left = steps[:, 0]
        new_right = compose(new_left, steps[:, 1])
        # The trunk is led through one knot per single step. It runs on towards the knot of the
        # next left step, which is not known yet: we expect the first one again.
        next_left = compose(new_right, steps[:, 0])
        knots = [
            self._knot(right, left, new_left),
            self._knot(new_left, right, new_right),
            self._knot(new_right, new_left, next_left),
        ]
        time = np.arange(2 * ticks + 1) * self.robot.control_dt  # [T + 1]
        trunk = np.empty((n, self.AXES, 2 * ticks + 1))
        state, start = self._trunk[robots], 0.0
        for k, knot in enumerate(knots):
            end = (k + 0.5 + p.trunk_phase) * half  # [s] when the trunk passes its knot
            c = quintic(state, knot, end - start)  # [n, 4, 6]
            inside = (time > start - 1e-9) & (time <= end + 1e-9)
            trunk[..., inside] = polynomial(c, time[inside] - start)
            if k == 2:  # where this double step ends, within the last spline
                rest = np.array([self.period - start])
                state = np.concatenate([polynomial(c, rest, order) for order in range(3)], -1)
            else:
                state, start = knot, end

        feet = np.zeros((n, 2 * ticks + 1, 2, 4))
        feet[:, : ticks + 1, 0] = self._swing(left, new_left, time[: ticks + 1])
        feet[:, : ticks + 1, 1, [0, 1, 3]] = right[:, None]
        feet[:, ticks:, 0, [0, 1, 3]] = new_left[:, None]
        feet[:, ticks:, 1] = self._swing(right, new_right, time[: ticks + 1])

        body = np.zeros((n, 2 * ticks + 1, 6))
        body[..., [0, 1, 5, 4]] = trunk.swapaxes(1, 2)
        body[..., 2] = p.trunk_height
        joints, _ = robot_model.body_inverse(self.robot, body, feet, self.planar)
        # The next plan starts in the frame of the new right foot.
        self._left[robots] = relative(new_right, new_left)
        self._trunk[robots] = self._seen_from(new_right, state)
        return robot_model.Trajectory(joints, body, feet), footsteps

    def _knot(self, support, start, landing):
        """State [n, 4, 3] of the trunk half way through a single step; feet [n, 3]."""
        p = self.parameters
        before, after = (support + start) / 2, (support + landing) / 2  # middle of the feet
        centre = (before + after) / 2
        yaw = centre[:, 2]
        # Sideways a share of the way towards the support foot.
        away = turned(support[:, :2] - centre[:, :2], -yaw)
        offset = np.stack(
            [np.full(len(yaw), p.trunk_x_offset), p.trunk_swing * away[:, 1] + p.trunk_y_offset], -1
        )
        knot = np.zeros((len(yaw), self.AXES, 3))
        knot[:, :2, 0] = centre[:, :2] + turned(offset, yaw)
        knot[:, 2, 0] = yaw
        knot[:, :3, 1] = (after - before) / self.half  # mean velocity of the step
        forward = turned(after[:, :2] - before[:, :2], -yaw)[:, 0]
        turn = np.abs(after[:, 2] - before[:, 2])
        lean = p.pitch_per_step * forward + p.pitch_per_turn * turn
        knot[:, 3, 0] = p.trunk_pitch + lean
        return knot

    def _swing(self, start, landing, time):
        """Swing foot [n, K, 4] (x, y, z, yaw): waits for double support, rises, lands at rest."""
        wait = self.parameters.double_support * self.half
        swing = self.half - wait  # [s]
        t = np.clip(time - wait, 0, swing)  # [K]
        zero = np.zeros_like(start)
        begin, end = (np.stack([pose, zero, zero], -1) for pose in (start, landing))
        path = quintic(begin, end, swing)  # [n, 3, 6]
        foot = np.zeros((len(start), len(time), 4))
        foot[..., [0, 1, 3]] = polynomial(path, t).swapaxes(1, 2)
        up = quintic([0, 0, 0], [self.parameters.foot_rise, 0, 0], swing / 2)  # [6]
        foot[..., 2] = polynomial(up, np.minimum(t, swing - t))  # down is up, mirrored in time
        return foot

    def _seen_from(self, base, state):
        """Trunk state [n, 4, 3] in the frame `base` [n, 3]."""
        moved = state.copy()
        moved[:, :3, 0] -= base
        xy = moved[:, :2].swapaxes(1, 2)  # [n, 3, 2] position, velocity and acceleration turn alike
        moved[:, :2] = turned(xy, -base[:, 2, None]).swapaxes(1, 2)
        return moved


# ---------------------------------------------------------------------------- walking and tuning

SEARCH = {  # tuned parameters and their ranges: those of [5], some made wider
    "frequency": (1.0, 3.0),
    "double_support": (0.0, 0.4),
    "foot_distance": (0.15, 0.22),
    "foot_rise": (0.02, 0.10),
    "trunk_height": (0.36, 0.42),
    "trunk_phase": (-0.45, 0.45),
    "trunk_pitch": (-0.1, 0.3),
    "trunk_swing": (0.0, 0.8),
    "trunk_x_offset": (-0.03, 0.03),
    "pitch_per_step": (-1.0, 1.0),
    "pitch_per_turn": (-0.5, 0.5),
}
PLANAR_FIXED = ("trunk_swing", "foot_distance")  # without meaning in the sagittal plane
DIRECTIONS = {  # the largest double step that is tried [2, 3]: left and right foot; m, m, rad
    "forward": [[0.24, 0, 0], [0.24, 0, 0]],
    "backward": [[-0.20, 0, 0], [-0.20, 0, 0]],
    "sideways": [[0, 0.16, 0], [0, 0, 0]],
    "turning": [[0, 0, 0.60], [0, 0, -0.60]],
}
# Random steps while tuning: our first guess of the limits, kept so that the tuning repeats.
ROUGH = {
    "pymunk": StepLimits(low=(-0.12, -0.04, -0.30), high=(0.18, 0.10, 0.45)),
    "mujoco": StepLimits(low=(-0.12, -0.04, -0.30), high=(0.16, 0.10, 0.45)),
}
ITERATIONS = {"pymunk": 14, "mujoco": 16}  # of the tuning: five minutes each on two cores
# Speeds [m/s, rad/s] that count 1 in the score of a tuning; our choice, from first trials.
GOOD_SPEED = {"forward": 0.5, "backward": 0.35, "sideways": 0.2, "turning": 1.5}


def walk(name, parameters, footsteps, robot=robot_model.RobotModel()):
    """Walk N robots through K double steps footsteps [N, K, 2, 3], from standing.

    Returns torso poses [N, K + 1, 3], yaw unwrapped, and in which double step each fell [N] (K:
    it stayed up).
    """
    footsteps = np.asarray(footsteps, float)
    n, count = footsteps.shape[:2]
    kind = robot_model.SIMULATORS[name]
    engine = WalkEngine(n, parameters, robot, kind.planar)
    sim = kind(n, engine.stance, robot)
    sim.reset(np.arange(n))
    poses, fall = np.zeros((n, count + 1, 3)), np.full(n, count)
    for k in range(count):
        poses[:, k + 1] = poses[:, k]
        up = np.flatnonzero(fall == count)
        if len(up):
            trajectory, _ = engine.plan(footsteps[up, k], up)
            motion = sim.run(trajectory, up)
            poses[up, k + 1] = motion.pose
            fall[up[motion.fell]] = k
    sim.close()
    poses[..., 2] = np.unwrap(poses[..., 2], axis=1)
    return poses, fall


LEVELS = 8  # step sizes tried per direction
PATTERN = (1, 1, 1, 1, 0, 0, 1, 1)  # double steps: start, stop, start again


def speed_plans():
    """Footsteps [4 · LEVELS, 8, 2, 3] of the speed test: every direction at every level."""
    go = np.array(PATTERN)[:, None, None]  # [K, 1, 1]
    shares = (np.arange(LEVELS) + 1) / LEVELS
    return np.array([share * go * np.array(s) for s in DIRECTIONS.values() for share in shares])


def random_plans(rng, limits, count=32):
    """Footsteps [count, 8, 2, 3] drawn evenly within the limits: harder than any planned walk."""
    return rng.uniform(limits.low, limits.high, (count, len(PATTERN), 2, 3))


def highest_speed(poses, fall, period):
    """Speed [m/s or rad/s] by direction: the fastest level below the first one that fell."""
    speeds = {}
    for i, (direction, step) in enumerate(DIRECTIONS.items()):
        axis = int(np.argmax(np.abs(np.sum(np.array(step) * MIRROR, 0))))  # of the motion
        rows = slice(i * LEVELS, (i + 1) * LEVELS)
        moved = np.abs(poses[rows, -1, axis] - poses[rows, 0, axis])  # [LEVELS]
        unbroken = np.cumprod(fall[rows] == len(PATTERN)).astype(bool)
        speeds[direction] = float(np.max(moved * unbroken) / (sum(PATTERN) * period))
    return speeds


def score(name, parameters):
    """What tuning maximises: mean of √(speed / good speed) + 2 · share of random steps stood.

    The root makes a slow direction count more than a fast one.
    """
    rng = np.random.default_rng(0)  # the same random steps for all candidates
    straight, rough = speed_plans(), random_plans(rng, ROUGH[name])
    poses, fall = walk(name, parameters, np.concatenate([straight, rough]))
    count = len(straight)
    speeds = highest_speed(poses[:count], fall[:count], WalkEngine(1, parameters).period)
    if robot_model.SIMULATORS[name].planar:
        del speeds["sideways"]  # kinematic: not an achievement
    stood = float(np.mean(fall[count:]) / len(PATTERN))
    fast = np.mean([math.sqrt(v / GOOD_SPEED[direction]) for direction, v in speeds.items()])
    return fast + 2 * stood, speeds, stood


def tune(name, seed, iterations=None, population=32, elite=8):
    """Cross-entropy method: draw candidates, keep the best quarter, draw nearer to them.

    [5] used a tree-structured Parzen estimator for the same question. Returns WalkParameters.
    """
    planar = robot_model.SIMULATORS[name].planar
    names = [k for k in SEARCH if not (planar and k in PLANAR_FIXED)]
    low, high = np.array([SEARCH[k] for k in names]).T
    rng = np.random.default_rng(seed)
    start = replace(WalkParameters(), **({"trunk_swing": 0.0} if planar else {}))
    mean, spread = np.array([getattr(start, k) for k in names]), (high - low) / 4

    def parameters(x):
        return replace(start, **{k: round(float(v), 4) for k, v in zip(names, x)})

    for iteration in range(iterations or ITERATIONS[name]):
        drawn = np.clip(mean + spread * rng.normal(size=(population, len(names))), low, high)
        drawn[0] = np.clip(mean, low, high)
        results = [score(name, parameters(x)) for x in drawn]
        best = np.argsort([-r[0] for r in results])[:elite]
        mean = 0.3 * mean + 0.7 * drawn[best].mean(0)
        spread = 0.3 * spread + 0.7 * drawn[best].std(0)
        value, speeds, stood = results[0]
        shown = "  ".join(f"{k} {v:.2f}" for k, v in speeds.items())
        print(f"{iteration:3d}  score of the mean {value:.3f}, best {results[best[0]][0]:.3f}  |  "
              f"{shown}  |  random steps stood {stood:.2f}", flush=True)  # fmt: skip
    return parameters(mean)


def fall_map(name, parameters, first, then, repeats=4, seed=0):
    """Share of falls [R] over plans [R, 2, 3]: three double steps `first`, then five of `then`.

    Every repeat varies the steps by ±5 %, so that the share says how sharp the edge is.
    """
    rng = np.random.default_rng(seed)
    plans = np.stack([first] * 3 + [then] * 5, 1)  # [R, 8, 2, 3]
    plans = np.repeat(plans, repeats, 0)
    plans = plans * rng.uniform(0.95, 1.05, (len(plans), 1, 1, 3))
    _, fall = walk(name, parameters, plans)
    return (fall < plans.shape[1]).reshape(-1, repeats).mean(1)


def fastest_speed(name, repeats=4, seed=0):
    """Highest measured speed [m/s] of a straight walk, forward or slanting, that did not fall.

    Ten double steps of (almost) equal size within the limits of an action; ±5 % in each repeat.
    """
    rng, count = np.random.default_rng(seed), 10
    x, _, _ = LIMITS[name].high
    grid = [(u, v) for u in np.linspace(0, x, 12) for v in (0, 0.04, 0.08)]  # ahead, outward [m]
    steps = np.array([[[u, v, 0], [u, 0, 0]] for u, v in grid])  # [R, 2, 3]
    plans = np.repeat(steps, repeats, 0)[:, None].repeat(count, 1)  # [R, K, 2, 3]
    plans = plans * rng.uniform(0.95, 1.05, plans.shape)
    poses, fall = walk(name, TUNED[name], plans)
    period = WalkEngine(1, TUNED[name]).period
    way = poses[:, -1, :2] - poses[:, count // 2, :2]  # [m] in the second half: at full speed
    speed = np.hypot(*way.T) / (count - count // 2) / period  # [R]
    return float(speed[fall == count].max())


def commanded(parameters, footsteps):
    """Where the trunk should be after footsteps [N, K, 2, 3]: poses [N, 3] from standing at 0."""
    half = parameters.foot_distance / 2
    right = np.tile([0.0, -half, 0.0], (len(footsteps), 1))
    for k in range(footsteps.shape[1]):
        steps = footsteps[:, k] * MIRROR + [[0, 2 * half, 0], [0, -2 * half, 0]]
        left = compose(right, steps[:, 0])
        right = compose(left, steps[:, 1])
    return (left + right) / 2


# ---------------------------------------------------------------------------- figures


def plot_plan(engine, path):
    """The splines and joint angles of the second of two forward double steps to the left."""
    import matplotlib.pyplot as plt

    footsteps = np.array([[[0.08, 0.04, 0.2], [0.08, 0.0, -0.2]]])
    engine.plan(footsteps, np.arange(1))
    trajectory, _ = engine.plan(footsteps, np.arange(1))
    time = np.arange(trajectory.joints.shape[1]) * engine.robot.control_dt
    figure, axes = plt.subplots(2, 2, figsize=(10, 6), layout="constrained", sharex=True)
    trunk, feet = trajectory.trunk[0], trajectory.feet[0]
    for axis, title, index in ((axes[0, 0], "forward x [m]", 0), (axes[0, 1], "sideways y [m]", 1)):
        axis.plot(time, feet[:, 0, index], "tab:green", label="left foot")
        axis.plot(time, feet[:, 1, index], "tab:red", label="right foot")
        axis.plot(time, trunk[:, index], "k", label="trunk")
        axis.set(title=title)
    axes[0, 0].legend()
    axes[1, 0].plot(time, 100 * feet[:, 0, 2], "tab:green", time, 100 * feet[:, 1, 2], "tab:red")
    axes[1, 0].set(title="foot height [cm]", xlabel="time [s]")
    for index, joint in ((2, "hip pitch"), (3, "knee"), (4, "ankle pitch")):
        line = axes[1, 1].plot(time, trajectory.joints[0, :, index], label=f"{joint}, left")
        right = trajectory.joints[0, :, index + 6]
        axes[1, 1].plot(time, right, "--", color=line[0].get_color(), label="right")
    axes[1, 1].legend(ncols=3, fontsize=8)
    axes[1, 1].set(title="joint targets [rad]", xlabel="time [s]")
    for axis in axes.flat:
        axis.axvline(engine.half, color="0.7", lw=1)  # the support foot changes
        axis.grid(alpha=0.3)
    figure.suptitle("One double step: left foot swings, then the right (frame: first support foot)")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def plot_walk(name, path):
    """Torso of four walks, measured, and where the command wanted it; prints the distances."""
    import matplotlib.pyplot as plt

    parameters, count = TUNED[name], 8
    walks = {
        "forward": [[0.08, 0, 0], [0.08, 0, 0]],
        "backward": [[-0.06, 0, 0], [-0.06, 0, 0]],
        "sideways": [[0, 0.06, 0], [0, 0, 0]],
        "a left turn": [[0.06, 0, 0.15], [0.06, 0, -0.15]],
    }
    plans = np.repeat(np.array(list(walks.values()))[:, None], count, 1)  # [4, K, 2, 3]
    poses, fall = walk(name, parameters, plans)
    figure, axis = plt.subplots(figsize=(8, 4), layout="constrained")
    print(f"{'walk':12s} {'commanded x, y, yaw':>26s} {'walked x, y, yaw':>26s}   fell")
    for i, title in enumerate(walks):
        steps = plans[i : i + 1]
        wish = np.array([commanded(parameters, steps[:, : k + 1])[0] for k in range(count)])
        line = axis.plot(poses[i, :, 0], poses[i, :, 1], ".-", label=title)
        axis.plot(wish[:, 0], wish[:, 1], "x", color=line[0].get_color())
        texts = [f"{p[0]:7.2f} m {p[1]:6.2f} m {p[2]:5.2f} rad" for p in (wish[-1], poses[i, -1])]
        print(f"{title:12s} {texts[0]:>26s} {texts[1]:>26s}   {'yes' if fall[i] < count else 'no'}")
    axis.plot([], [], "kx", label="commanded")
    axis.set(xlabel="x [m]", ylabel="y [m]", aspect="equal",
             title=f"Eight double steps, torso measured once a double step ({name})")  # fmt: skip
    axis.legend()
    axis.grid(alpha=0.3)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def plot_limits(name, path, seed=0):
    """Three maps of the share of falls; the box is what an action can ask for."""
    import matplotlib.pyplot as plt

    limits, parameters = LIMITS[name], TUNED[name]
    x = np.linspace(-0.24, 0.32, 15)
    # A steady turn is outward for one foot and inward, the smaller limit, for the other one.
    maps = (  # title, label of the second axis, its values, first and then from (x, second)
        ("forward and turning", "yaw of both feet [rad]", np.linspace(-0.7, 0.7, 15),
         lambda u, v: ([[u, 0, v], [u, 0, -v]],) * 2, (limits.low[2], -limits.low[2])),
        ("forward and sideways", "left foot outward [m]", np.linspace(0, 0.21, 15),
         lambda u, v: ([[u, v, 0], [u, 0, 0]],) * 2, (0, limits.high[1])),
        ("change of step length", "x of the steps before [m]", x,
         lambda u, v: ([[v, 0, 0]] * 2, [[u, 0, 0]] * 2), (limits.low[0], limits.high[0])),
    )  # fmt: skip
    figure, axes = plt.subplots(1, 3, figsize=(14, 4.4), layout="constrained")
    for axis, (title, label, second, plan, (low, high)) in zip(axes, maps):
        cells = [plan(u, v) for v in second for u in x]
        first, then = (np.array([cell[i] for cell in cells], float) for i in (0, 1))
        falls = fall_map(name, parameters, first, then, seed=seed).reshape(len(second), len(x))
        image = axis.pcolormesh(x, second, falls, cmap="magma_r", vmin=0, vmax=1)
        inside = (x >= limits.low[0] - 1e-9) & (x <= limits.high[0] + 1e-9)
        rows = (second >= low - 1e-9) & (second <= high + 1e-9)
        share = falls[np.ix_(rows, inside)].mean()
        print(f"{title:22s}: {share:.2f} of the walks inside the limits fall, "
              f"{falls.mean():.2f} of all")  # fmt: skip
        if title == "change of step length":
            stood = (falls == 0) & np.outer(rows, inside)  # [before, after]
            change = (x - second[:, None])[stood]  # [m]
            print(f"  largest change inside them without a fall: {change.max():+.2f} m and "
                  f"{change.min():+.2f} m, of {limits.high[0] - limits.low[0]:.2f} m possible")
        size = limits.high[0] - limits.low[0], high - low
        box = plt.Rectangle((limits.low[0], low), *size, fill=False, ec="tab:cyan", lw=2)
        axis.add_patch(box)
        axis.set(title=title, xlabel="x of the steps [m]", ylabel=label)
    figure.colorbar(image, ax=axes, label="share of falls in 8 double steps")
    figure.suptitle(f"What the robot can take ({name}); blue: the limits of an action")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main():
    """See the head of this file."""
    parser = robot_model.stage_parser(__doc__)
    parser.add_argument("--tune", action="store_true", help="optimise the walk parameters")
    parser.add_argument("--limits", action="store_true", help="draw the share of falls as maps")
    args = robot_model.parse_stage(parser)
    out = robot_model.output_folder(parser, args)
    if args.tune:
        print(tune(args.sim, args.seed))
        return
    if args.limits:
        plot_limits(args.sim, out / "02_limits.png", args.seed)
        print("Look at", out / "02_limits.png")
        return
    kind = robot_model.SIMULATORS[args.sim]
    engine = WalkEngine(1, TUNED[args.sim], planar=kind.planar)
    print(f"{args.sim}: a double step takes {engine.period:.2f} s")
    plot_plan(engine, out / "02_plan.png")
    plot_walk(args.sim, out / "02_walk.png")
    print("Look at", out / "02_plan.png", "and", out / "02_walk.png")


if __name__ == "__main__":
    main()
