"""Stage 3: what does the robot observe, what may it do, and what is it rewarded for?

    python 03_env.py             a random planner, then a hand-written one, in 2-D; 10 seconds
    python 03_env.py --mujoco    the same in 3-D

Predict, then look at what is printed (1) and at `runs/<sim>/03_rewards.png` (2):
1. Eight reward terms (`reward_terms`) pay a robot with the hand-written planner in 60 double steps.
   Which two pay most? Which ones cost?
2. A measured x or y of the goal is off by 5 cm (standard deviation). How exact is an estimate from
   one measurement, from five, from ten, while the robot stands, and while it walks?

A planner chooses actions (double steps); a policy is a learned planner. To arrive, two double steps
in a row must end at the goal (in the paper one). An episode is a walk. At the goal or after a fall it
is terminated. When only the time is up, it could go on: it is truncated. Stage 4 must tell these two
apart.

`FootstepWorld` is the whole task for N robots; `FootstepVectorEnv` and `FootstepEnv` give it the
interfaces of Gymnasium. Floor and body are random (`Spread`), and pushes if you ask for them. Noisy
goals are estimated from all measurements so far (`predict`, `correct`).

Paper: section II a, b, d, e. We never saw its Table I and Fig. 2, so formulas of rewards and
the encoding of the observation are ours. Read down to the line of equals signs.
"""

import runpy
import sys
from collections import namedtuple
from contextlib import chdir, contextmanager
from dataclasses import dataclass
from importlib import import_module

import gymnasium as gym
import numpy as np
from gymnasium.vector.utils import batch_space

robot_model = import_module("01_robot_model")
walk_engine = import_module("02_walk_engine")
wrap, InputError = robot_model.wrap, robot_model.InputError


@dataclass(frozen=True)
class Task:
    """The task. Comments name the source: "paper" or "ours"."""

    # [m] goals: x, y ~ N(0, σ²); ours: with it `baseline` of stage 5 takes about the paper's time
    goal_std_m: float = 0.5
    far_std_m: float = 1.0  # [m] σ of far goals: in training with probability ½, `--far`; ours
    goal_std_rad: float = np.pi / 2  # [rad] goals: σ of the yaw, wrapped; ours
    success_m: float = 0.05  # [m] paper
    success_rad: float = np.radians(10)  # [rad] paper
    in_a_row: int = 2  # [-] so many double steps in a row must end at the goal; paper: 1
    time_limit: float = 100.0  # [s] simulated; paper, there of the evaluation
    noise_m: float = 0.05  # [m] standard deviation of the measured goal, x and y; ours
    noise_rad: float = 0.05  # [rad] of its yaw; ours
    imu_rad: float = 0.02  # [rad] of the tilt by the IMU (inertial measurement unit); ours
    imu_rad_s: float = 0.1  # [rad/s] of its angular velocity, which the reflex reads; ours
    push_every: float = 3.0  # [s] between two pushes, on average; ours
    near_m: float = 0.4  # [m] what "close" means in the rewards; ours
    # Scalars of the reward, all ours. The first four terms are the paper's.
    s_d: float = 1.0  # [1/m] distance
    s_a: float = 0.3  # [1/rad] angle
    s_o: float = 0.1  # [1/rad] orient to goal
    s_c: float = 0.1  # [-] continuity
    s_fall: float = 20.0  # [-] cost of a fall
    s_goal: float = 1.5  # [-] bonus for having arrived
    s_stay: float = 1.0  # [-] for arriving near the middle (outside a cost): `margin_at_rest`
    s_time: float = 0.04  # [-] cost of time, per usual double step


@dataclass(frozen=True)
class StepLimits:
    """The smallest and the largest footstep that an action can command."""

    low: tuple  # x [m], y [m], yaw [rad]; y and yaw outward
    high: tuple


# Our choice, from the maps of `python tests/studies/walk.py --limits`. Planar sideways steps cannot
# cause a fall; their limit is our choice, too. Where feet land, they do not touch each other.
LIMITS = {
    "pymunk": StepLimits(low=(-0.15, -0.04, -0.40), high=(0.16, 0.15, 0.60)),
    "mujoco": StepLimits(low=(-0.12, -0.04, -0.30), high=(0.14, 0.18, 0.50)),
}

# The observation, seen from above (paper, Fig. 2; the encoding is ours):
#
#                    / the goal's yaw
#                   /  ) α
#             goal o- - - - - -
#                 .
#            d  .                        d: the distance to the goal
#             .   ) β                    β: the direction to the goal, from straight ahead
#     robot >- - - - - - - - - ahead     α: the goal's yaw, from straight ahead
#
# "zoomed": in units of 0.5 m, clipped to ±1. Near the goal these change faster than d. Of a goal
# beyond 2 m (7 % in training) a policy sees little but the direction and the yaw. What a double
# step does also depends on how the body moves when it begins. No planner sees that; the last action
# stands in for it: −1 is the low limit, 1 the high one. Each row: name, unit, low, high.
ACTION_NAMES = [f"{foot} {axis}" for foot in ("left", "right") for axis in ("x", "y", "yaw")]
OBSERVATION = [
    ("distance d, clipped", "m", 0.0, 2.0),
    ("x = d·cos β, zoomed and clipped", "0.5 m", -1.0, 1.0),
    ("y = d·sin β, zoomed and clipped", "0.5 m", -1.0, 1.0),
    *((name, "1", -1.0, 1.0) for name in ("cos β", "sin β", "cos α", "sin α")),
    ("α / π", "π rad", -1.0, 1.0),
    *((f"{name}, last action", "low … high limit", -1.0, 1.0) for name in ACTION_NAMES),
]


# Who knows what:
#   policy, critic     the estimate of the goal, the last action: OBSERVATION
#   another planner    the same, the goal unclipped, step limits, period, neutral action: `View`
#   estimate           noisy measurements of the goal, and the planned motion of a double step
#   robot's computer   the planned double step; roll, pitch and their rates, with errors
#   reward             the true pose, the goal, a fall, the time, actions, where the feet should be
#   nobody             floor, masses, motors, delays, wrong zeros of joints, coming pushes
@dataclass(frozen=True)
class View:
    """What a planner may use for n robots; all of it is copied."""

    robots: np.ndarray  # [n] their indices: a planner with a memory has a row of it for each
    goal: np.ndarray  # [n, 3] x, y [m], yaw [rad] seen from the robot: the estimate
    observation: np.ndarray  # [n, 14] rows as in OBSERVATION
    last_action: np.ndarray  # [n, 6]
    period: float  # [s] of a usual double step, which does not wait
    limits: StepLimits
    neutral_action: np.ndarray  # [6] step on the spot


# ------------------------------------------------------------------------ goals
def polar(goal):
    """d [m], α, β [rad], each [...], of goals seen from the robot, [..., 3] (x, y, yaw)."""
    x, y, yaw = np.moveaxis(goal, -1, 0)
    return np.hypot(x, y), wrap(yaw), np.arctan2(y, x)


def count_in_a_row(after, fall, so_far, task):
    """How many double steps in a row, [n], have now ended at the goal. (`Task.in_a_row` of them are
    a success.) after [n, 3]: the goal seen from the robot; fall [n] bool; so_far [n]: till now."""
    d, alpha, _ = polar(after)
    inside = (d <= task.success_m) & (np.abs(alpha) <= task.success_rad)
    return np.where(inside & ~fall, so_far + 1, 0)  # whoever falls is not at the goal


def encode_goal(goal):
    """The first eight numbers [..., 8] of OBSERVATION for goals seen from the robot [..., 3]."""
    d, alpha, beta = polar(goal)
    zoomed = np.clip(goal / 0.5, -1, 1)  # [..., 3] x, y; the yaw is not used
    return np.stack([
        np.minimum(d, 2.0), zoomed[..., 0], zoomed[..., 1],
        np.cos(beta), np.sin(beta), np.cos(alpha), np.sin(alpha), alpha / np.pi,
    ], -1)  # fmt: skip


# ------------------------------------------------------------------------ actions
def to_footsteps(action, limits):
    """Actions [..., 6] in [0, 1] as footsteps [..., 2, 3]: 0 is the lower limit, 1 the upper."""
    share = np.reshape(action, (*np.shape(action)[:-1], 2, 3))
    return limits.low + share * np.subtract(limits.high, limits.low)


# ------------------------------------------------------------------------ rewards
def potentials(goal, near_m):
    """Φ [3, n] of the three rewards for progress; goals seen from the robot [n, 3]."""
    d, alpha, beta = polar(goal)
    # near(d) = exp(−(d / near_m)²): 1 at the goal, 0 far from it
    near = np.exp(-((d / near_m) ** 2))
    # Φ_d = −d,   Φ_a = −|α|·near(d),   Φ_o = −|β|·(1 − near(d))
    # (Who comes near with a wrong yaw loses something at first, and earns it back by turning.)
    return np.stack([-d, -np.abs(alpha) * near, -np.abs(beta) * (1 - near)])


def margin_at_rest(after, closing_step, task):
    """How far inside the goal's tolerance robots come to rest [n]: 1 in its middle, 0 at its edge,
    negative outside. A robot that arrives still closes its feet, which moves it on by about 1 cm:
    closing_step [n, 3]. after [n, 3]: the goal seen from the robot before that."""
    d, alpha, _ = polar(robot_model.relative(closing_step, after))
    return 1 - np.maximum(d / task.success_m, np.abs(alpha) / task.success_rad)


def reward_terms(
    before, after, action, last_action, fall, success, task=Task(), periods=1, margin=0
):
    """The scaled reward terms by name, each [n]; their sum is the reward. All formulas are ours.
        r_d, r_a, r_o   s·(Φ′ − Φ) with s_d, s_a, s_o of the task: `potentials` after the double
                        step minus those before it
        r_c             −s_c·Σ (action − last action)²
        r_fall          −s_fall, of a fall
        r_goal          s_goal, of a success
        r_time          −s_time·periods
        r_stay          s_stay·margin, of a success
    before, after [n, 3]: the goal seen from the robot around the double step; actions [n, 6] in
    [0, 1]; fall, success [n] bool; periods [n]: how long the double step took, in usual ones;
    margin [n]: see `margin_at_rest`.

    Without a discount all but the ends cancel in the sum over a walk, Σ(Φ_{t+1} − Φ_t) = Φ_T − Φ_0:
    a detour pays nothing. This holds after a fall, too, so the farther from the goal the robot
    falls, the less it was paid (Φ_d = −d). With the discount of stage 4 it pays to hurry, and a
    detour may pay a little (predict.md, *circle*)."""
    progress = potentials(after, task.near_m) - potentials(before, task.near_m)  # [3, n]
    change = action - last_action  # [n, 6]
    return {
        "r_d": task.s_d * progress[0],
        "r_a": task.s_a * progress[1],
        "r_o": task.s_o * progress[2],
        "r_c": task.s_c * -(change**2).sum(-1),
        "r_fall": -task.s_fall * fall,
        "r_goal": task.s_goal * success,
        "r_time": np.full(len(before), -task.s_time) * periods,
        "r_stay": task.s_stay * success * margin,
    }


# ==================================================================== the end of a first reading
# ------------------------------------------------------------------------ the estimate
# The process noise of the filter [m, m, rad]: √5 times this is about the error after five equal
# double steps, which err alike, in the random walks of `python tests/studies/walk.py`.
DRIFT = {"pymunk": (0.014, 0.008, 0.0), "mujoco": (0.0214, 0.0185, 0.1262)}


# A measured goal is off by 5 cm in x and in y, by 0.05 rad in yaw; a double step by 1 to 2 cm (in
# 3-D also by 0.13 rad). So it pays to remember measurements: a Kalman filter. It also keeps how
# large its error may be: the covariance P of the errors of x, y, yaw (diagonal: their variances).
def predict(goal, covariance, motion, drift):
    """The goal [n, 3] after a double step of the robot, and the covariance [n, 3, 3] of its error.
    motion [n, 3]: planned pose of the trunk after the double step, seen from that before it; drift
    [3]: see DRIFT. In m, m, rad."""
    goal = robot_model.relative(motion, goal)
    x, y, _ = goal.T
    turn = motion[:, 2]
    # The robot has turned, so what it sees turns back, as does the error of x and y: J = Rz(−turn).
    J = robot_model.rotation(0, 0, -turn)  # [n, 3, 3]
    # Let the double step end a small e = (e_x, e_y, e_yaw) away from its plan, as seen from there.
    # This moves a goal at (x, y) by −(e_x − y·e_yaw, e_y + x·e_yaw, e_yaw) = −G·e: an unplanned
    # turn moves it to the side. The covariance of e is D = diag(drift²).
    G = np.tile(np.eye(3), (len(goal), 1, 1))  # [n, 3, 3]
    G[:, 0, 2], G[:, 1, 2] = -y, x
    D = np.diag(np.square(drift))  # [3, 3]
    return goal, J @ covariance @ J.mT + G @ D @ G.mT  # J·P·Jᵀ + G·D·Gᵀ


def correct(goal, covariance, measured, noise):
    """The goal [n, 3], its yaw wrapped, after a measurement [n, 3], and its covariance; noise: the
    standard deviation of the measurement [3]. In m, m, rad."""
    # Mix prediction and measurement, goal + K·(measured − goal). For one number with independent
    # errors of variance V and R the mix has the variance (1 − K)²·V + K²·R. This is smallest where
    # its derivative −2·(1 − K)·V + 2·K·R is 0: K = V / (V + R), and V ← (1 − K)·V = K·R.
    # For three numbers the same holds with matrices.
    P, R = covariance, np.diag(np.square(noise))
    K = P @ np.linalg.inv(P + R)  # [n, 3, 3] K = P·(P + R)⁻¹
    error = measured - goal
    error[:, 2] = wrap(error[:, 2])
    goal = goal + np.matvec(K, error)
    goal[:, 2] = wrap(goal[:, 2])
    return goal, K @ R  # P ← K·R


# ------------------------------------------------------------------------ what is random
STREAMS = {"training": 1, "tuning": 2, "evaluation": 3}  # "tuning": of planners


def stream(name, seed, *more):
    """A random generator of its own for every stream, seed, and number of a trial."""
    # + 1: to numpy the seeds [a, b, 0] and [a, b] are the same.
    return np.random.default_rng([STREAMS[name], seed, *(number + 1 for number in more)])


def draw_goals(rng, count, task=Task(), far=False):
    """Goal poses [count, 3]: x, y [m], yaw [rad]. Goal i does not depend on `count`."""
    std = task.far_std_m if far else task.goal_std_m
    goals = rng.normal(0, (std, std, task.goal_std_rad), (count, 3))
    goals[:, 2] = wrap(goals[:, 2])
    return goals


@dataclass(frozen=True)
class Spread:
    """How far floor and robot may be from the model in an episode (domain randomization): ± on
    every number of the Variation's field of this name, uniform and independent, in the order of
    these fields. All zeros: the model itself. Sizes: ours."""

    friction: float = 0.3  # [-] on μ
    mass: float = 0.10  # [-] on the factors of every link's mass and inertia
    stiffness: float = 0.20  # [-] on the factors of every motor's position gain
    stiction: float = 0.5  # [-] on the factors of every joint's dry friction
    delay: float = 1.0  # [ticks] so from 0 to 1, see `draw`
    zero: float = 3**0.5 * np.radians(0.5)  # [rad] of every joint: ± a has σ = a/√3, here 0.5°
    com: float = 0.01  # [m] on x, y, z of the torso's centre of mass
    gyro: float = 0.05  # [rad/s] on the constant errors of the rates of roll and pitch

    def draw(self, rngs, robot):
        """The Variation for n robots, one generator each."""
        variation = robot_model.Variation.as_model(robot, len(rngs))
        for name, size in vars(self).items():
            values = getattr(variation, name)  # [n, …]
            values += [rng.uniform(-size, size, values.shape[1:]) for rng in rngs]
        variation.friction = np.abs(variation.friction)  # not below 0
        variation.delay = np.abs(variation.delay)
        return variation


# ------------------------------------------------------------------------ the world
def to_action(footsteps, limits):
    """The action [..., 6] of footsteps [..., 2, 3], clipped to [0, 1]; undoes `to_footsteps`."""
    span = np.subtract(limits.high, limits.low)  # [3]
    share = np.subtract(footsteps, limits.low) / np.maximum(span, 1e-9)
    return np.clip(share, 0, 1).reshape(*share.shape[:-2], 6)


def checked(name, value, *shape):
    """The value as an array [shape]. A ValueError if it is not finite, or has another shape."""
    array = np.array(value, float)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite numbers of shape {shape}, not {value!r:.60}")
    return array


# A robot's generator makes others in each episode: for the goal's place, floor and body, the noise
# of the measured goal, pushes (when, in which direction), and the errors of the IMU.
Dice = namedtuple("Dice", "goal world noise push imu")


class FootstepWorld:
    """N robots and their N goals; call `reset` first. `robots` are the indices [n] of some of them.
    Every robot has a random generator of its own, so N robots together do the same as each of them
    alone. Floor, body, and the noise of the k-th measurement do not depend on the planner."""

    def __init__(
        self,
        num_robots,
        sim="pymunk",
        noise=False,  # does a planner see the goal with noise?
        push=0.0,  # [m/s] random pushes; each would give the torso alone this speed
        walk=None,  # WalkParameters; None: TUNED of stage 2
        limits=None,  # StepLimits; None: LIMITS
        drift=None,  # [m, m, rad] error of a double step that the filter expects; None: DRIFT
        task=Task(),
        spread=Spread(),
        robot=robot_model.ROBOT,
    ):
        if sim not in robot_model.SIMULATORS or num_robots < 1:
            raise ValueError(
                f"sim is one of {', '.join(robot_model.SIMULATORS)}, with one robot or more; "
                f"not {sim!r}, {num_robots}"
            )
        self.limits = limits or LIMITS[sim]
        self.drift = DRIFT[sim] if drift is None else drift
        self.sim = sim
        self.noise = noise
        self.push = push
        self.task = task
        self.spread = spread
        self.engine, self.simulator = walk_engine.walkers(sim, num_robots, walk, robot)
        # [6] step on the spot; not 0.5, since the limits are not symmetric
        self.neutral_action = to_action(np.zeros((2, 3)), self.limits)
        self.rng = np.array(np.random.default_rng().spawn(num_robots))  # [N] the robots' own
        self.dice = [None] * num_robots  # the Dice of each, since its first reset
        # The goals in the world, x, y [m], yaw [rad]; estimates of them, seen from the robots
        self.goal, self.estimate = np.zeros((2, num_robots, 3))  # [N, 3] each
        self.covariance = np.zeros((num_robots, 3, 3))  # of the estimate's error, in m and rad
        self.last_action = np.zeros((num_robots, 6))
        # Of this episode: double steps, control ticks; how many double steps in a row have ended at
        # the goal, and the tick when the first of them did  [N] each
        self.steps, self.ticks, self.in_a_row, self.arrival = np.zeros((4, num_robots), int)

    def reset(self, robots, rngs=(), goals=None):
        """Starts episodes: these robots stand at the origin. rngs: n random generators, else the
        robots go on with their own. goals [n, 3], else they are random."""
        if goals is not None:
            goals = checked("goals", goals, len(robots), 3)
        if rngs:
            self.rng[robots] = rngs
        for i in robots:  # spawn returns new generators at every call, so every episode differs
            self.dice[i] = Dice(*self.rng[i].spawn(5))
        if goals is None:  # far with probability ½
            dice = [self.dice[i].goal for i in robots]
            goals = [draw_goals(rng, 1, self.task, far=rng.random() < 0.5)[0] for rng in dice]
        variation = self.spread.draw([self.dice[i].world for i in robots], self.engine.robot)
        self.simulator.reset(robots, variation)
        self.engine.reset(robots)
        self.last_action[robots] = self.neutral_action
        self.steps[robots] = self.ticks[robots] = 0
        self.set_goal(robots, goals)

    def set_goal(self, robots, goals):
        """Sets other goals [n, 3], x, y [m], yaw [rad] in the world, and measures them once."""
        self.goal[robots] = goals
        self.estimate[robots] = 0
        self.covariance[robots] = 1e8 * np.eye(3)  # nearly nothing is known of them
        self.in_a_row[robots] = 0
        self.measure(robots)

    @property
    def pose(self):
        """Where the torsos truly stand on the floor, [N, 3] x, y [m], yaw [rad]."""
        return self.simulator.state[:, robot_model.GROUND]

    def relative_goal(self, robots):
        """The true goal seen from the robot [n, 3]: x, y [m], yaw [rad]."""
        return robot_model.relative(self.pose[robots], self.goal[robots])

    def measure(self, robots):
        """Corrects the estimate by one more measurement: once before every decision."""
        task = self.task
        std = self.noise * np.array([task.noise_m, task.noise_m, task.noise_rad])
        noise = [self.dice[i].noise.normal(0, std) for i in robots]  # [n, 3]
        # Without noise R is nearly 0, so K is 1: only the new measurement counts. (R = 0 has no
        # inverse for the yaw in 2-D, which does not drift.)
        measured = self.relative_goal(robots) + noise
        self.estimate[robots], self.covariance[robots] = correct(
            self.estimate[robots], self.covariance[robots], measured, np.maximum(std, 1e-6)
        )

    def view(self, robots):
        """The View of these robots."""
        goal, last_action = self.estimate[robots], self.last_action[robots]
        observation = np.hstack([encode_goal(goal), 2 * last_action - 1])  # [0, 1] to [−1, 1]
        return View(
            np.array(robots),
            goal,
            observation.astype(np.float32),
            last_action,
            self.engine.period,
            self.limits,
            self.neutral_action.copy(),
        )

    def _disturbance(self, plan, robots):
        """Errors of the IMU and pushes while these robots follow their plan: a Disturbance."""
        task, disturbance = self.task, robot_model.Disturbance.none(plan)
        std = np.repeat([task.imu_rad, task.imu_rad_s], 2)  # of roll, pitch, and their rates
        ticks = walk_engine.PUSH_TICKS
        chance = self.engine.period / task.push_every  # of a push in a double step
        for i, push, imu in zip(robots, disturbance.push, disturbance.imu):
            imu[:] = self.dice[i].imu.normal(0, std, imu.shape)
            drawn, when, direction = self.dice[i].push.random(3)  # also if unused
            if drawn < chance:
                # Within the usual double step: a plan that waits takes longer
                first = int(when * (self.engine.period_ticks - ticks + 1))
                if self.engine.planar:
                    direction = round(direction) / 2  # ahead or back, else in any direction
                force = walk_engine.push_force(self.engine.robot, self.push)  # [N]
                push[first : first + ticks] = robot_model.turned([force, 0], 2 * np.pi * direction)
        return disturbance

    def step(self, actions, robots):
        """Simulates one double step of these robots; actions [n, 6], clipped to [0, 1]. Returns a
        dict of arrays [n]: success, fall, timeout, inside (the goal's tolerance; all bool), time
        [s], reward, and reward_terms by name; and the simulator's Motion. The time of a success
        ends with the first of the double steps in a row that ended inside."""
        task, dt = self.task, self.engine.robot.control_dt
        actions = np.clip(checked("actions", actions, len(robots), 6), 0, 1)
        if None in [self.dice[i] for i in robots]:
            raise gym.error.ResetNeeded("call reset before the first step")
        before = self.relative_goal(robots)
        last = self.last_action[robots]
        plan = self.engine.plan(to_footsteps(actions, self.limits), robots)
        # The robot knows its plan, and how far it was off only by the next measurement.
        trunk = plan.trunk[..., robot_model.GROUND]  # [n, T + 1, 3]
        planned = robot_model.relative(trunk[:, 0], trunk[:, -1])
        self.estimate[robots], self.covariance[robots] = predict(
            self.estimate[robots], self.covariance[robots], planned, self.drift
        )

        motion = self.simulator.run(robots, plan, self._disturbance(plan, robots))
        fall = motion.fell
        self.last_action[robots] = actions
        self.steps[robots] += 1
        self.ticks[robots] += motion.ticks

        after = self.relative_goal(robots)
        now = self.ticks[robots]
        in_a_row = count_in_a_row(after, fall, self.in_a_row[robots], task)
        arrival = np.where(in_a_row == 1, now, self.arrival[robots])
        self.in_a_row[robots], self.arrival[robots] = in_a_row, arrival
        success = in_a_row >= task.in_a_row
        # An episode is cut off before a double step that might take too long.
        no_time = now + plan.most_ticks > round(task.time_limit / dt)  # [ticks]

        periods = motion.ticks / self.engine.period_ticks
        margin = margin_at_rest(after, self.engine.closing_step(robots), task)
        terms = reward_terms(before, after, actions, last, fall, success, task, periods, margin)
        self.measure(robots)
        return {
            "success": success,
            "fall": fall,
            "timeout": no_time & ~success & ~fall,
            "inside": in_a_row > 0,
            "time": np.where(success, arrival, now) * dt,
            "reward": sum(terms.values()),
            "reward_terms": terms,
            "motion": motion,
        }


# ------------------------------------------------------------------------ files of your own
@contextmanager
def one_line_if_it_exits(file):
    """Says in one line which file of yours ends Python, and so would end our script in silence."""
    try:
        with chdir("."):  # it may go to another folder: afterwards we are back in ours
            yield
    except SystemExit as error:
        raise InputError(f"{file}: ends Python, by exit() or main()") from error


def names_in(path, **wanted):
    """The values of these names, of these types, in a file of your own, which may import, at its
    top, what lies beside it. Errors in it keep their own traceback."""
    if path.suffix != ".py" or not path.is_file():
        raise InputError(f"{path}: no such .py file (--policy takes a policy.pt)")
    modules, places = set(sys.modules), sys.path[:]
    sys.path.append(str(path.resolve().parent))  # last: it may import what lies beside it
    with one_line_if_it_exits(path):
        found = runpy.run_path(str(path), run_name=path.as_posix())
    sys.path[:] = places  # the next file may have another tools.py beside it
    for name in set(sys.modules) - modules:
        if path.with_name(f"{name}.py").is_file():
            del sys.modules[name]
    for name, kind in wanted.items():
        if not isinstance(found.get(name), kind):
            raise InputError(
                f"{path}: needs a {name} that is a {'class' if kind is type else kind.__name__}"
            )
    return [found[name] for name in wanted]


def robot_settings(path, sim):
    """The settings of a FootstepWorld that ROBOT, WALK and LIMITS of your own file are. Raises an
    InputError if this robot does not stand for a second, or cannot take a double step."""
    robot, walk, limits = names_in(
        path, ROBOT=robot_model.RobotModel, WALK=walk_engine.WalkParameters, LIMITS=StepLimits
    )
    settings = {"robot": robot, "walk": walk, "limits": limits}
    try:
        with np.errstate(all="ignore"):  # the error below says enough
            world = FootstepWorld(1, sim, **settings)
            world.reset([0])
            world.step([world.neutral_action], [0])  # it may fall, but it must be possible
            world.simulator.reset([0])
            still = np.tile(world.engine.stance[1], (1, round(1 / robot.control_dt) + 1, 1))
            if world.simulator.run([0], robot_model.Trajectory(still)).fell[0]:
                raise ValueError("the robot falls within a second, where it should stand")
    except Exception as error:  # whatever a wrong number leads to, in our code or a simulator's
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: ROBOT, WALK or LIMITS do not fit {sim}: {reason}") from error
    return settings


# ------------------------------------------------------------------------ a picture
def sole(robot, side):
    """Outline [4, 2] of a sole on the floor, x, y [m] from its ankle; side: 0 left, 1 right."""
    x = [robot.foot_front, robot.foot_front, -robot.foot_back, -robot.foot_back]
    y = (1, -1)[side] * robot.foot_outward + robot.foot_width / 2 * np.array([1, -1, -1, 1])
    return np.column_stack([x, y])


def draw_shape(axes, pose, outline, camera, **style):
    """Draws an outline [k, 2], seen from a pose [3], on the floor."""
    points = pose[:2] + robot_model.turned(outline, pose[2])
    axes.fill(*(camera[1:, :2] @ points.T), lw=2, zorder=0.5, **style)


def draw_way(axes, world, goal, feet, camera):
    """Draws the goal [3], a disc as large as the tolerance with a tip along its yaw, and footprints
    [K, 2, 3] (x, y, yaw of the ankles) on the floor."""
    for side, color in enumerate(robot_model.COLORS):
        outline = sole(world.engine.robot, side)
        for poses in feet:
            draw_shape(axes, poses[side], outline, camera, fc=color, alpha=0.35)
    radius = world.task.success_m
    angle = np.linspace(0.6, 2 * np.pi - 0.6, 40)
    disc = np.append(robot_model.turned((radius, 0), angle), [(5 * radius, 0)], 0)  # [41, 2] [m]
    draw_shape(axes, goal, disc, camera, fc="tab:green", alpha=0.9)


# ------------------------------------------------------------------------ Gymnasium
class FootstepVectorEnv(gym.vector.VectorEnv):
    """N independent episodes in one call; all settings are those of `FootstepWorld`. An ended
    episode starts again in the SAME step: `step` returns the first observation of the next episode,
    and the last one of the ended episode is in infos["final_obs"][i], where infos["_final_obs"][i]
    is True. (Gymnasium's wrappers that refuse this mode work with
    `gymnasium.make_vec("03_env:Footsteps-v0", n, "sync")`.)"""

    metadata = {"autoreset_mode": gym.vector.AutoresetMode.SAME_STEP}

    def __init__(self, num_envs=64, sim="pymunk", **settings):  # of FootstepWorld: noise, push, …
        self.world = FootstepWorld(num_envs, sim, **settings)
        self.num_envs = num_envs
        bounds = np.array([row[2:] for row in OBSERVATION], np.float32).T  # low, high  [2, 14]
        self.single_observation_space = gym.spaces.Box(*bounds)
        self.single_action_space = gym.spaces.Box(0, 1, (6,))
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.neutral_action = self.world.neutral_action
        self.robots = np.arange(num_envs)

    def reset(self, *, seed=None, options=None):
        """Starts new episodes; robot i gets seed + i. options["goals"] [N, 3] sets the goals."""
        rngs = () if seed is None else [stream("training", seed + i) for i in self.robots]
        self.world.reset(self.robots, rngs, **(options or {}))
        return self.world.view(self.robots).observation, {}

    def step(self, actions):
        """Simulates a double step, and restarts ended episodes. infos: the result of
        `FootstepWorld.step` without the Motion, final_obs and final_info."""
        infos = self.world.step(actions, self.robots)
        del infos["motion"]
        observations = self.world.view(self.robots).observation
        terminated = infos["success"] | infos["fall"]
        over = terminated | infos["timeout"]
        if over.any():
            infos = infos | {
                "final_obs": observations.copy(),
                "final_info": infos,
                "_final_obs": over,
                "_final_info": over,
            }
            fresh = self.robots[over]
            self.world.reset(fresh)
            observations[fresh] = self.world.view(fresh).observation
        return observations, infos["reward"], terminated, infos["timeout"], infos


class FootstepEnv(gym.Env):
    """One robot walks to a goal, a double step at a time. (`FootstepVectorEnv` with one robot.)

    ## Action
    Box(0, 1, (6,)): where both feet step, as shares of LIMITS: x, y, yaw of the left foot, then of
    the right one, y and yaw positive outward. `envs.neutral_action` steps on the spot.

    ## Observation and reward
    Box (14,): the goal seen from the robot, and the last action, see OBSERVATION. The reward is the
    sum of `reward_terms`.

    ## Start and end of an episode
    The robot stands at the origin; goal, floor and body are random. Terminated: two double steps in
    a row have ended within 5 cm and 10° of the goal, or it has fallen. Truncated: after 100 s.

    ## Arguments
    render_mode: None or "rgb_array". (`gymnasium.wrappers.RecordVideo` films it if moviepy is
    installed.) The others are those of `FootstepWorld`; `reset` takes options={"goals": [(x, y,
    yaw)]}. `gymnasium.make("03_env:Footsteps-v0", sim="mujoco", noise=True)` makes one."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 2}  # a picture for a double step

    def __init__(self, render_mode=None, **settings):  # those of FootstepVectorEnv
        self.render_mode = render_mode
        self.envs = FootstepVectorEnv(1, **settings)
        self.observation_space = self.envs.single_observation_space
        self.action_space = self.envs.single_action_space

    def reset(self, *, seed=None, options=None):
        """Starts a new episode."""
        super().reset(seed=seed)
        observations, info = self.envs.reset(seed=seed, options=options)
        return observations[0], info

    def step(self, action):
        """Simulates one double step; the info holds the reward terms and how the episode ended."""
        world = self.envs.world
        result = world.step([action], [0])
        del result["motion"]
        result |= result.pop("reward_terms")
        info = {name: value.item() for name, value in result.items()}
        terminated = info["success"] or info["fall"]
        return world.view([0]).observation[0], info["reward"], terminated, info["timeout"], info

    def render(self):
        """The robot and its goal (green, its tip points along the yaw), uint8 [400, 400, 3]."""
        axes = robot_model.Figure(figsize=(4, 4), dpi=100).subplots()
        world, camera = self.envs.world, robot_model.camera_at()
        robot_model.draw_ground(axes, camera, 0.5)
        draw_way(axes, world, world.goal[0], [], camera)
        torso, joints, _ = np.split(world.simulator.state, [6, 18], 1)
        robot_model.draw_robots(axes, world.engine.robot, torso, joints, camera)
        return robot_model.pixels(axes.figure)


gym.register("Footsteps-v0", "03_env:FootstepEnv", vector_entry_point="03_env:FootstepVectorEnv")


# ------------------------------------------------------------------------ demonstration
def hand_written(goal, limits):
    """The actions [n, 6] of a planner without learning, for goals seen from the robot [n, 3]. Far
    from the goal the robot turns towards it, near the goal to the goal's yaw. Its steps are at most
    half of what the limits allow."""
    d, alpha, beta = polar(goal)
    turn = np.where(d > 0.5, beta, alpha)  # [n] half a metre: our choice
    x, y, _ = goal.T
    wish = np.stack([x / 2, y, turn / 2], -1)  # [n, 3] each foot: half of x, half of the turn
    outward = wish[:, None] * walk_engine.MIRROR  # [n, 2, 3] y and yaw positive outward
    # y from 0 on: sideways only the leading foot steps  [m, m, rad]
    return to_action(np.clip(outward, [-0.06, 0, -0.15], [0.06, 0.07, 0.15]), limits)


def estimate_errors(sim, seed):
    """The root mean square error of the estimate's x and y after 1, 2, … 15 measurements, and what
    the filter claims, [2, 15] [m], for 64 robots that walk by `hand_written` to goals 2 m ahead."""
    world, robots = FootstepWorld(64, sim, noise=True), np.arange(64)
    world.reset(robots, [stream("training", seed, i) for i in robots], [[2, 0, 0]] * 64)
    rows = []
    for _ in range(15):
        error = (world.estimate - world.relative_goal(robots))[:, :2]
        variance = world.covariance[:, [0, 1], [0, 1]]
        rows.append(np.sqrt([(error**2).mean(), variance.mean()]))
        world.step(hand_written(world.estimate, world.limits), robots)
    return np.transpose(rows)


def plot_rewards(episode, errors, path):
    """Draws what each reward term paid in the K double steps of an episode, [K] by its name, and
    errors as by `estimate_errors`."""
    curves, estimate = robot_model.Figure(figsize=(9, 4.5)).subplots(1, 2)
    for term, values in sorted(episode.items(), key=lambda item: -item[1].sum()):
        if values.any():
            curves.plot(np.append(0, values.cumsum()), label=term)
    curves.legend()  # in the order of their ends
    curves.set(
        title="An episode of the hand-written planner",
        xlabel="double step",
        ylabel="sum of rewards so far [1]",
    )
    k = np.arange(1, errors.shape[1] + 1)
    names = "walking", "claimed by the filter,\nfor a policy's longer steps", "standing still"
    for error, name in zip((*errors, Task.noise_m / np.sqrt(k)), names):
        estimate.plot(k, 100 * error, "o-", label=name)
    estimate.set(
        title="The estimated goal",
        xlabel="measurements so far",
        ylabel="error of x and y [cm]",
        ylim=(0, None),
    )
    estimate.legend()
    robot_model.save_figure(curves.figure, path)


def main():
    args = robot_model.stage_parser(__doc__).parse_args()
    path = robot_model.output_folder(args) / "03_rewards.png"
    envs = FootstepVectorEnv(32, args.sim)
    seed = envs.num_envs * args.seed  # other robots for another seed
    seen, _ = envs.reset(seed=seed)
    print(f"{'observation':32} {'unit':>22}   low  high  example")
    for (name, unit, low, high), value in zip(OBSERVATION, seen[0]):
        print(f"{name:32} {unit:>22} {low:5} {high:5} {value:8.2f}")
    print(
        "\naction: x [m], y [m], yaw [rad] of the left foot, then of the right one, y, yaw outward\n"
        f"0 is {envs.world.limits.low}, 1 is {envs.world.limits.high}\n\n"
        f"{envs.num_envs} robots, 60 double steps each"
    )
    rng = stream("training", args.seed, 0)
    planners = {
        "random": lambda view: rng.random((envs.num_envs, 6)),
        "hand-written": lambda view: hand_written(view.goal, view.limits),
    }
    for name, act in planners.items():
        envs.reset(seed=seed)
        infos = []
        for _ in range(60):
            infos.append(envs.step(act(envs.world.view(envs.robots)))[-1])
        goals = np.array([info["success"] for info in infos])  # [60, 32]
        falls = np.array([info["fall"] for info in infos])
        print(
            f"{name}: {goals.sum()} episodes at the goal, {falls.sum()} falls; mean pay of a robot"
        )
        paid = {}
        for term in infos[0]["reward_terms"]:
            paid[term] = np.array([info["reward_terms"][term] for info in infos])  # [60, 32]
            print(f"    {term:8}{paid[term].sum(0).mean():8.2f}")
    # Of the hand-written planner, which walked last: the longest of the robots' first episodes
    ends = (goals | falls).argmax(0)  # [32]
    robot = ends.argmax()
    episode = {term: values[: ends[robot] + 1, robot] for term, values in paid.items()}
    plot_rewards(episode, estimate_errors(args.sim, args.seed), path)
    print("Look at", path)


if __name__ == "__main__":
    robot_model.run_script(main)
