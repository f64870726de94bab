"""Stage 2: how do two footsteps become a walk?

    python 02_walk_engine.py             walks and pushes in 2-D; 4 seconds
    python 02_walk_engine.py --mujoco    the same in 3-D

The swing foot and the trunk move along quintic splines, and inverse kinematics turns their poses
into joint angles: the paper's engine [5]. A push would topple this walk, so we add three answers to
what the IMU measures (`WalkPlan`): a reflex of the ankles, capture steps, which put a foot down
where the robot leans, and steps that wait. (The paper mentions only the last, as future work.) In
2-D the last two are off when the robot walks to a goal.

A double step is a swing of the left foot and then one of the right, about 0.3 s each: see
`results/mujoco/double_step.png`. A footstep (x, y, yaw) says where the swing foot lands, seen from
its usual place beside the support foot; y and yaw are positive outward.

The stage prints where four walks should end, and where they do. Which goes farthest astray? (A
planner has to correct this.) Then it pushes twelve walking robots, each at another moment. How many
fall without any answer, with the reflex, with both reflex and capture steps? Guess
(`tests/course/predict.md`, *capture*), then look at `runs/<sim>/02_push.png`.

Read down to the line of equals signs.

[5] Bestmann, Zhang, 2022: Bipedal Walking on Humanoid Robots through Parameter Optimization.
"""

from dataclasses import dataclass, replace
from importlib import import_module

import numpy as np
from matplotlib.figure import Figure
from numpy.polynomial.polynomial import polyder, polyval

# A module name may not start with a digit in an import statement, hence import_module.
robot_model = import_module("01_robot_model")
LEFT, RIGHT, GROUND = robot_model.LEFT, robot_model.RIGHT, robot_model.GROUND
compose = robot_model.compose


@dataclass(frozen=True)
class WalkParameters:
    """How the robot walks; named after the parameters of [5]."""

    step_ticks: int  # [control ticks] of a single step
    double_support: float  # [-] share of a single step with both feet on the floor
    foot_distance: float  # [m] between the ankles when standing
    foot_rise: float  # [m] apex of the swing foot
    trunk_height: float  # [m] torso frame above the soles
    trunk_phase: float  # [single steps] by which the trunk is late (< 0: early); within ±0.5
    trunk_pitch: float  # [rad] forward lean
    trunk_x_offset: float  # [m] trunk ahead of the middle of the feet
    trunk_swing: float = 0.0  # [-] sideways: share of the distance from middle to support foot
    trunk_roll: float = 0.0  # [rad] towards the support foot, in the middle of a single step; ours
    # How a double step answers a push, see below; ours. capture = wait = 0: only the reflex is on
    reflex: float = 0.05  # [s] gain at the support ankle, see `reflex`
    capture: float = 0.0  # [-] share of the lean that the swing foot follows, see `capture_step`
    usual_lean: float = 0.04  # [rad] smaller leans are usual in a calm walk, and not answered
    follow: float = 0.3  # [-] in a tick a swing foot goes this share of the way to its answer
    fade: float = 0.015  # [-] in a tick a standing foot's answer shrinks by this share
    wait: float = 0.0  # [1/rad] how much the plan slows down per lean, see `waiting_pace`
    late_lean: float = 0.06  # [rad] lean over the support foot from which on it slows down
    longest_wait_ticks: int = 40  # [control ticks] that a double step may take longer


REFLEX_LIMIT = 0.25  # [rad] of what the reflex adds to a joint target; our choice
PUSH_TICKS = 5  # [control ticks] that a push lasts; our choice
MIRROR = np.array([[1, 1, 1], [1, -1, -1]])  # footsteps of the left and of the right foot


# ------------------------------------------------------------------------ the engine
class WalkEngine:
    """Plans double steps of N robots, and stores their commanded feet and trunks, seen from one
    fixed frame: the middle between the feet after a reset."""

    def __init__(self, num_robots, parameters, robot=robot_model.ROBOT, planar=False):
        p = self.parameters = parameters
        self.robot = robot
        self.planar = planar
        self.step_time = p.step_ticks * robot.control_dt  # [s] a single step
        self.period = 2 * self.step_time  # [s] a double step that does not wait
        self.period_ticks = 2 * p.step_ticks  # [control ticks] the same
        self.stance = robot_model.stance(  # torso, joints
            robot, planar, p.trunk_height, p.foot_distance, p.trunk_pitch, p.trunk_x_offset
        )
        # The usual place of each foot, seen from the other one: left, right  [2, 3]
        self.beside = np.array([[0, 1, 0], [0, -1, 0]]) * p.foot_distance
        self.foot_poses = np.zeros((num_robots, 2, 3))  # left, right: x, y [m], yaw [rad]
        self.trunk_state = np.zeros((num_robots, 6, 3))  # position, velocity, acceleration
        self.answer = np.zeros((num_robots, 2, 3))  # see `capture_step`; a standing foot keeps it
        self.reset(np.arange(num_robots))

    def reset(self, robots):
        """These robots [n] stand still."""
        p = self.parameters
        self.foot_poses[robots] = self.beside / 2
        self.answer[robots] = 0
        self.trunk_state[robots] = 0
        self.trunk_state[robots, :, 0] = p.trunk_x_offset, 0, p.trunk_height, 0, p.trunk_pitch, 0

    def swinging(self, samples):
        """Which foot swings at these samples [...] of a plan, [..., 2] bool: left, right."""
        first = samples < self.parameters.step_ticks
        return np.stack([first, ~first], -1)

    def landings(self, right, footsteps):
        """Where the left and then the right foot land [n, 3]; right [n, 3], footsteps [n, 2, 3]."""
        steps = footsteps * MIRROR + self.beside  # [n, 2, 3] each foot seen from the other one
        left = compose(right, steps[:, LEFT])
        return left, compose(left, steps[:, RIGHT])

    def plan(self, footsteps, robots):
        """The WalkPlan of the next double step of these robots [n]. The engine counts it as done:
        the next plan begins where this one ends, wherever the robot then is.

        footsteps [n, 2, 3]: left, right; x, y [m], yaw [rad], outward positive. Zeros: on the spot;
            (0, 0.06, 0)   (0, 0, 0)      0.06 m to the left
            (0.08, 0, 0)   (0.08, 0, 0)   0.16 m ahead: each foot lands 0.08 m ahead of the other

            time   0 · · · · · · · · change · · · · · · period · · · · · · ·
            left   |both|   swing    |       support       |
            right  |     support     |both|   swing        |
            trunk  ├───── knot 1 ────────── knot 2 ────────┤──── (knot 3)
                 state                                   state

        both: double support, both feet on the floor. A knot is the state (position, velocity,
        acceleration) that the trunk should have in the middle of a single step (trunk_phase later).
        Knot 3 lies in the next double step. Quintics join the knots."""
        left, right = self.foot_poses[robots].swapaxes(0, 1)  # [n, 3] each
        new_left, new_right = self.landings(right, footsteps)
        # The next left step is not known yet: we expect the same one again.
        next_left, _ = self.landings(new_right, footsteps)
        knots = [
            self._knot(right, left, new_left),
            self._knot(new_left, right, new_right),
            self._knot(new_right, new_left, next_left),
        ]
        trunk = self._trunk_path(knots, robots)  # [n, T + 1, 6]
        change = self.parameters.step_ticks  # the tick when the support foot changes
        feet = np.zeros((len(left), self.period_ticks + 1, 2, 4))
        ground = [0, 1, 3]  # x, y, yaw of a foot on its way; z stays 0 where it stands
        feet[:, : change + 1, LEFT] = self._swing(left, new_left)
        feet[:, change:, LEFT, ground] = new_left[:, None]
        feet[:, :change, RIGHT, ground] = right[:, None]
        feet[:, change:, RIGHT] = self._swing(right, new_right)
        self.foot_poses[robots] = np.stack([new_left, new_right], 1)
        return WalkPlan(self, np.asarray(robots), trunk, feet)

    def _knot(self, support, start, landing):
        """State of the trunk (as self.trunk_state) in the middle of a single step, [n, 6, 3], from
        poses [n, 3] of the support foot, of the swing foot at lift-off, and where it lands. The
        trunk is half way between the middles of the feet before and after the step. It moves with
        the mean velocity, and is shifted and rolled towards the support foot."""
        p = self.parameters
        before = (support + start) / 2  # middle of the feet
        after = (support + landing) / 2
        centre = (before + after) / 2
        seen = robot_model.relative(centre, support)  # [n, 3] y: positive to the left
        offset = seen * [0, p.trunk_swing, 0] + [p.trunk_x_offset, 0, 0]
        knot = np.zeros((len(centre), 6, 3))
        knot[:, GROUND, 0] = compose(centre, offset)
        knot[:, GROUND, 1] = (after - before) / self.step_time
        knot[:, 2, 0] = p.trunk_height
        knot[:, 3, 0] = -p.trunk_roll * np.sign(seen[:, 1])  # a positive roll leans to the right
        knot[:, 4, 0] = p.trunk_pitch
        return knot

    # ================================================================ the end of a first reading
    def closing_step(self, robots):
        """How far the middle of the feet, seen from itself, still goes in a double step in place
        [n, 3]: the left foot closes up beside the right one. See stage 3."""
        left, right = self.foot_poses[robots].swapaxes(0, 1)  # [n, 3] each
        closed = compose(right, self.beside[:1])
        return robot_model.relative((left + right) / 2, (closed + right) / 2)

    def _trunk_path(self, knots, robots):
        """x, y, z, roll, pitch, yaw of the trunk, [n, T + 1, 6]: one quintic from knot to knot."""
        time = np.arange(self.period_ticks + 1) * self.robot.control_dt  # [T + 1] [s]
        ends = (np.arange(3) + 0.5 + self.parameters.trunk_phase) * self.step_time  # [3] [s] knots
        begins = 0.0, *ends
        states = self.trunk_state[robots], *knots  # [n, 6, 3] each
        path = np.empty((len(states[0]), 6, len(time)))
        for k in range(3):
            spline = quintic(states[k], states[k + 1], ends[k] - begins[k])  # [n, 6, 6]
            later = time >= begins[k]  # the next spline overwrites what is beyond its knot
            path[..., later] = polynomial(spline, time[later] - begins[k])
        # The double step ends within the last spline. The next one begins in the state there.
        state = [polynomial(spline, self.period - begins[2], order) for order in range(3)]
        self.trunk_state[robots] = np.stack(state, -1)
        return path.swapaxes(1, 2)

    def _swing(self, start, landing):
        """The swing foot [n, step_ticks + 1, 4] (x, y, z, yaw) of a single step. In its first part,
        `double_support` of it, the foot stands. Then x, y and yaw go to the landing, each along one
        quintic from rest to rest. z rises by `foot_rise` in the first half of this swing, along a
        quintic, too. In the second half it goes back along the same curve."""
        p = self.parameters
        time = np.linspace(0, 1, p.step_ticks + 1)  # of the single step, then of the swing
        time = np.clip((time - p.double_support) / (1 - p.double_support), 0, 1)
        smooth = quintic([0, 0, 0], [1, 0, 0], 1)  # from 0 to 1, from rest to rest
        share = polynomial(smooth, time)[:, None]
        foot = np.zeros((len(start), len(time), 4))
        foot[..., [0, 1, 3]] = start[:, None] + share * (landing - start)[:, None]
        foot[..., 2] = p.foot_rise * polynomial(smooth, 2 * np.minimum(time, 1 - time))
        return foot


# In 3-D found by `python tests/studies/walk.py --tune --mujoco` on 2026-11-28, in 2-D by a search
# for speed on 2026-11-26 (step_ticks was given).
TUNED = {
    "pymunk": WalkParameters(
        step_ticks=31,
        double_support=0.0498,
        foot_distance=0.18,  # not tuned: in 2-D it hardly matters
        foot_rise=0.0313,
        trunk_height=0.3652,
        trunk_phase=0.0064,
        trunk_pitch=0.1098,
        trunk_x_offset=-0.001,
        reflex=0.03,  # [s] these motors follow at once; 0.05 is no better
    ),
    "mujoco": WalkParameters(
        step_ticks=30,
        double_support=0.0097,
        foot_distance=0.1641,
        foot_rise=0.0414,
        trunk_height=0.3755,
        trunk_phase=-0.0965,
        trunk_pitch=0.0593,
        trunk_swing=0.2102,
        trunk_x_offset=0.0229,
        trunk_roll=0.0574,
        reflex=0.0557,
        capture=0.8281,
        usual_lean=0.0271,
        fade=0.0306,
        wait=11.9913,
    ),
}


# ------------------------------------------------------------------------ quintic splines
def quintic(start, end, duration):
    """Coefficients c [..., 6] of x(t) = Σ cₖ·tᵏ with three boundary conditions at each end.
    start, end [..., 3]: position, velocity, acceleration at t = 0 and t = duration [s]. Curves that
    are joined like this do not jump in acceleration, so the motors need no jump of torque."""
    p0, v0, a0 = np.moveaxis(start, -1, 0)
    p1, v1, a1 = np.moveaxis(end, -1, 0)
    D = duration
    # At t = 0:  c₀ = p₀, c₁ = v₀, c₂ = a₀/2.  At t = D the others must supply what is missing:
    p = p1 - p0 - v0 * D - a0 * D**2 / 2
    v = v1 - v0 - a0 * D
    a = a1 - a0
    # c₃D³ + c₄D⁴ + c₅D⁵ = p,  3c₃D² + 4c₄D³ + 5c₅D⁴ = v,  6c₃D + 12c₄D² + 20c₅D³ = a.
    # So for D = 1 the matrix from p, v, a to c₃, c₄, c₅ is the inverse of (1, 1, 1), (3, 4, 5),
    # (6, 12, 20).
    c3 = (20 * p - 8 * v * D + a * D**2) / (2 * D**3)
    c4 = (-30 * p + 14 * v * D - 2 * a * D**2) / (2 * D**4)
    c5 = (12 * p - 6 * v * D + a * D**2) / (2 * D**5)
    return np.stack([p0, v0, a0 / 2, c3, c4, c5], -1)


def polynomial(c, t, order=0):
    """The spline's position, or its derivative of that order: c [..., 6], t [K] -> [..., K]."""
    # numpy wants the coefficients first: [6, ...]
    return polyval(t, polyder(np.moveaxis(c, -1, 0), order))


# ------------------------------------------------------------------------ answers to a push
def capture_step(lean, lean_over_support, swings, old, p):
    r"""Returns what each leg answers to a lean, [n, 2, 3]: the roll and pitch e [rad] by which it
    takes the trunk to lean more than planned (columns 1, 2), and a shift of its landing to the left
    [m] (column 0). A swing foot approaches this answer, a standing foot's fades.

    lean [n, 2]: measured − planned roll and pitch [rad]; lean_over_support [n]: the roll's part of
    it, positive towards the support foot [rad]; swings [n, 2] bool: which foot swings, left or
    right, double support included; old [n, 2, 3]: the answer of the last tick.

    Seen from behind, with the trunk T, the swing foot L and the support foot R:
            as planned        leans to the left     and answers

               T                   T                     T
              / \                  | \                  /  \
             /   \                /   \                /    \
            L     R               L     R             L       R

    A push tilts the whole robot by `lean` about the support foot, so the trunk, at the height h,
    moves by h·lean. The swing leg turns with it: without an answer L lands as far from R as
    planned. To answer, the inverse kinematics is told that the trunk leans by e more than planned.
    To reach the same place from such a trunk it turns the leg, and the real foot lands h·e farther
    in the direction of the lean. e is `capture` times the lean beyond ± usual_lean. If the robot
    leans to the other side, over R, such a landing would bring the feet together, so its sideways
    part is shifted back by h·e."""
    e = p.capture * (lean - np.clip(lean, -p.usual_lean, p.usual_lean))  # [n, 2]
    # A positive roll leans to the right, so h·e is a shift back to the left.
    back = np.where(lean_over_support > 0, p.trunk_height * e[:, 0], 0)  # [n]
    wanted = np.column_stack([back, e])[:, None]  # [n, 1, 3]
    # The tilt is noisy, so a swing foot goes only a share of the way in a tick.
    swing = old + p.follow * (wanted - old)
    # The answer of a standing foot fades slowly: a quick return would tip the robot.
    stand = (1 - p.fade) * old
    return np.where(swings[..., None], swing, stand)


def waiting_pace(lean_over_support, p):
    """Returns the pace of a plan, the ticks by which it advances in a tick, [n], from 0 to 1;
    lean_over_support [n]: positive outward [rad]. A robot that leans outward over its support foot
    needs more time until it comes back to the other foot. How much? See `tests/course/predict.md`,
    *waiting*: there the robot is a pendulum."""
    # pace = 1 − wait·(lean − late_lean), from 0 to 1
    return np.clip(1 - p.wait * (lean_over_support - p.late_lean), 0, 1)


class WalkPlan:
    """A planned double step, and how it answers what the IMU measures meanwhile; a `Trajectory` of
    stage 1. In the field's words: feedback of the torso's angular velocity to the ankles (rate
    feedback, an ankle strategy), of its tilt to the landing place (a capture step) and to the
    timing of the step. With reflex, capture and wait at 0 it is the open loop of the paper."""

    def __init__(self, engine, robots, trunk, feet):
        p = engine.parameters
        self.engine = engine  # it stores the answers from plan to plan
        self.robots = robots  # [n] that follow it
        self.trunk = trunk  # [n, T + 1, 6] x, y, z [m], roll, pitch, yaw [rad]
        self.feet = feet  # [n, T + 1, 2, 4] x, y, z of the sole below the ankle [m], yaw [rad]
        self.ticks = engine.period_ticks  # T
        self.most_ticks = self.ticks + (p.longest_wait_ticks if p.wait else 0)
        self.progress = np.zeros(len(robots))  # [n] ticks of the plan done: fewer, if it waited

    def go_on(self, rows, tick, imu):
        """See `Trajectory`."""
        engine, p, robots = self.engine, self.engine.parameters, self.robots[rows]
        progress = self.progress[rows]  # [k]
        sample = progress.astype(int)  # [k] where in the plan each robot is
        trunk = self.trunk[rows, sample]  # [k, 6]
        lean = imu[:, :2] - trunk[:, 3:5]  # [k, 2] roll, pitch beyond the plan [rad]
        swings = engine.swinging(sample)  # [k, 2]
        # A positive roll leans to the right: outward, while the left foot swings
        lean_over_support = np.where(swings[:, LEFT], 1, -1) * lean[:, 0]  # [k]
        # Never more than longest_wait_ticks late: then the plan goes on, whatever the lean
        least = tick + 1 - (self.most_ticks - self.ticks)
        pace = waiting_pace(lean_over_support, p)
        self.progress[rows] = progress = np.clip(progress + pace, least, self.ticks)
        next_sample = progress.astype(int)
        next_trunk, feet = self.trunk[rows, next_sample], self.feet[rows, next_sample]
        answer = capture_step(lean, lean_over_support, swings, engine.answer[robots], p)
        engine.answer[robots] = answer  # [k, 2, 3]
        # The inverse kinematics gets a trunk for each leg: where it is planned, but leaning by what
        # this leg answers. It is not where the trunk is, and that is how the foot lands elsewhere.
        trunk_of_leg = next_trunk[:, None].repeat(2, 1)  # [k, 2, 6]
        trunk_of_leg[..., 3:5] += answer[..., 1:]
        # And the landing is shifted to the left of the trunk  [k, 2, 2]
        feet[..., :2] += robot_model.turned(answer[..., :1] * [0, 1], trunk_of_leg[..., 5])
        joints = robot_model.joints_for_feet(engine.robot, trunk_of_leg, feet, engine.planar)
        # The planned change of the trunk in this tick: of roll and pitch, and on the floor
        planned_rates = (next_trunk - trunk)[:, 3:5] / engine.robot.control_dt  # [k, 2]
        move = robot_model.relative(trunk[:, GROUND], next_trunk[:, GROUND])  # [k, 3]
        return joints + reflex(imu[:, 2:] - planned_rates, swings, p), move


def reflex(rate_error, swings, p):
    """Returns what is added to the joint targets, [n, 12] [rad].
    rate_error [n, 2]: measured − planned rates of roll and pitch [rad/s]; swings [n, 2] bool: which
    foot swings. If the torso turns forward faster than planned, the toes of the support foot are
    turned down. They press on the floor, which brakes the turn."""
    # added = gain·(measured rate − planned rate), at most ± REFLEX_LIMIT; gain [s]
    turn = np.clip(p.reflex * rate_error, -REFLEX_LIMIT, REFLEX_LIMIT)  # [n, 2]
    added = np.zeros((*swings.shape, 6))  # [n, 2, 6]
    # Roll and pitch of the ankle of the foot that does not swing
    added[..., 5] = ~swings * turn[:, :1]
    added[..., 4] = ~swings * turn[:, 1:]
    return added.reshape(-1, 12)


# ------------------------------------------------------------------------ to walk with it
def push_force(robot, speed):
    """The force [N] that gives the torso alone this speed [m/s]: mass·Δv / duration."""
    return robot.torso.mass * speed / (PUSH_TICKS * robot.control_dt)


def walkers(sim, num_robots, parameters=None, robot=robot_model.ROBOT):
    """The engine that plans for N robots, and their simulator; `reset` it first."""
    simulator = robot_model.SIMULATORS[sim]
    engine = WalkEngine(num_robots, parameters or TUNED[sim], robot, simulator.planar)
    return engine, simulator(num_robots, engine.stance, robot)


def walk_plans(
    sim, parameters, footsteps, variation=None, disturb=None, watch=None, robot=robot_model.ROBOT
):
    """Lets N robots, which differ from the model by `variation`, walk S double steps [N, S, 2, 3].
    Returns torso poses [N, S + 1, 3], commanded ones [N, S + 1, 3] (yaws unwrapped; both begin at
    the origin), and in which double step each robot fell [N] (S: it did not fall). It stays where
    it is at the end of this double step. Before double step k disturb(k, disturbance, robots) may
    change the Disturbance of these robots [n]. After it watch(engine, plan, motion) is called."""
    footsteps = np.asarray(footsteps)
    n, count = footsteps.shape[:2]  # N, S
    engine, simulator = walkers(sim, n, parameters, robot)
    simulator.reset(np.arange(n), variation)
    poses, commanded = np.zeros((2, n, count + 1, 3))
    fall_step = np.full(n, count)
    offset = np.array([parameters.trunk_x_offset, 0, 0])  # the trunk, seen from between the feet
    for k in range(count):
        up = np.flatnonzero(fall_step == count)
        if not len(up):
            break
        plan = engine.plan(footsteps[up, k], up)
        disturbance = robot_model.Disturbance.none(plan)
        if disturb:
            disturb(k, disturbance, up)
        motion = simulator.run(up, plan, disturbance)
        poses[up, k + 1 :] = motion.torso[:, -1:, GROUND]
        commanded[:, k + 1 :] = compose(engine.foot_poses.mean(1), offset)[:, None] - offset
        fall_step[up[motion.fell]] = k
        if watch:
            watch(engine, plan, motion)
    poses[..., 2] = np.unwrap(poses[..., 2])
    return poses, commanded, fall_step


# ------------------------------------------------------------------------ demonstration
WALKS = {  # eight double steps each
    "forward": [[0.08, 0, 0], [0.08, 0, 0]],
    "backward": [[-0.06, 0, 0], [-0.06, 0, 0]],
    "sideways": [[0, 0.06, 0], [0, 0, 0]],
    "a left turn": [[0.06, 0, 0.15], [0.06, 0, -0.15]],
}


def pushed(sim, parameters, speed, count=12):
    """Lets robots walk straight ahead for ten double steps, and pushes each of them forward, by
    this speed [m/s] (see `push_force`), once in the second one. Returns the tilts of each torso in
    the ticks of its walk, `count` lists [rad], and which robots fell [count]."""
    tilts = [[] for _ in range(count)]
    force = push_force(robot_model.ROBOT, speed)
    moments = np.linspace(0, 2 * parameters.step_ticks - PUSH_TICKS, count).astype(int)

    def disturb(k, disturbance, robots):
        if k == 1:
            for push, first in zip(disturbance.push, moments[robots]):
                push[first : first + PUSH_TICKS, 0] = force

    def watch(engine, plan, motion):
        tilt = np.arccos(np.cos(motion.torso[..., 3:5]).prod(-1))  # [n, T] as in `fallen`
        for i, measured, ticks in zip(plan.robots, tilt, motion.ticks):
            tilts[i] += [*measured[:ticks]]

    steps = [[WALKS["forward"]] * 10] * count
    _, _, fall_step = walk_plans(sim, parameters, steps, None, disturb, watch)
    return tilts, fall_step < 10


def plot_push(pushes, engine, path):
    """Draws the tilt of all robots over time, a panel for each answer; pushes: what `pushed`
    returns, by the answer's name; engine: of robots that walked like these."""
    panels = Figure(figsize=(9, 3.6)).subplots(1, len(pushes), sharey=True)
    for panel, (name, (tilts, fell)) in zip(panels, pushes.items()):
        panel.axvspan(engine.period, 2 * engine.period, color="0.9")
        for tilt, color in zip(tilts, np.where(fell, "tab:red", "0.5")):
            degrees = np.degrees(tilt)
            degrees = degrees[np.maximum.accumulate(degrees) < 45]  # what follows is no walk
            panel.plot(np.arange(len(degrees)) * engine.robot.control_dt, degrees, color=color)
        panel.set_title(f"{name}:\n{fell.sum()} of {len(fell)} fall")
        panel.set_xlabel("time [s], grey: pushes")
    panels[0].set_ylabel("tilt of the torso [°], to a fall at 45°")
    robot_model.save_figure(panels[0].figure, path)


def plot_plan(engine, plan, motion, path):
    """Draws a robot's double step over time: feet and trunk, planned and simulated. In 3-D all of
    the robot is 2 cm beside its plan, because its first double step drifted, and the feet rise 6 to
    8 mm less than planned: back-EMF and dry friction hold the motors back, and the torso sinks."""
    robot = engine.robot
    # Left foot, right foot, trunk; the simulated ones begin a tick later  [T + 1 or T, 3, 3]
    planned = np.concatenate([plan.feet[0, ..., :3], plan.trunk[0, :, None, :3]], 1)
    points, _ = robot_model.link_frames(robot, motion.torso[0], motion.joints[0])
    walked = points[:, [4, 8, 0]]  # the ankles and the torso
    walked[:, :2, 2] -= robot.ankle_height  # now the soles below the ankles
    # The simulators' origin is where the torso was after the reset. The plan's is between the feet.
    walked[..., 0] += engine.parameters.trunk_x_offset
    figure = Figure(figsize=(9, 4))
    axes = figure.subplots(1, 3)
    titles = "forward: x [m]", "sideways: y [m]", "height of the feet: z [m]"
    for k, axis in enumerate(axes):
        for values, style, first in (planned, "-", 0), (walked, "--", 1):
            time = (first + np.arange(len(values))) * robot.control_dt
            axis.set_prop_cycle(color=[*robot_model.COLORS, "black"])
            axis.plot(time, values[..., k], style)
        axis.set(title=titles[k], xlabel="time [s]")
    axes[2].set_ylim(-0.01, 0.05)
    names = "left foot", "right foot", "trunk (plan), torso (simulated)"
    figure.legend(axes[0].lines[:3], names, loc="outside lower center", ncols=3)
    figure.suptitle("Solid: plan. Dashed: simulated")
    robot_model.save_figure(figure, path)


def main():
    args = robot_model.stage_parser(__doc__).parse_args()
    out = robot_model.output_folder(args)
    sim = args.sim
    parameters = TUNED[sim]
    engine, simulator = walkers(sim, 1)
    simulator.reset([0])
    print(f"{sim}: a double step takes {engine.period:.2f} s")
    for _ in range(2):  # the second one is drawn; the first one starts from standing
        plan = engine.plan([WALKS["forward"]], [0])
        motion = simulator.run([0], plan)
    plot_plan(engine, plan, motion, out / "02_plan.png")

    footsteps = [[double_step] * 8 for double_step in WALKS.values()]  # [4, S, 2, 3]
    poses, commanded, fall_step = walk_plans(sim, parameters, footsteps)
    print("walk           commanded x, y [m], yaw [rad]   walked               fell")
    for name, a, b, when in zip(WALKS, commanded[:, -1], poses[:, -1], fall_step):
        print(
            f"{name:14s} {a[0]:5.2f} {a[1]:5.2f} {a[2]:5.2f}               "
            f"{b[0]:5.2f} {b[1]:5.2f} {b[2]:5.2f}    {'yes' if when < 8 else 'no'}"
        )
    pushes, speed = {}, 0.8 if engine.planar else 0.7  # [m/s]
    only_reflex = replace(parameters, capture=0.0, wait=0.0)
    answers = {
        "open loop": replace(only_reflex, reflex=0.0),
        "reflex": only_reflex,
        "reflex and capture steps": replace(only_reflex, capture=1.0),
    }
    for name, settings in answers.items():
        _, fell = pushes[name] = pushed(sim, settings, speed)
        print(f"pushed by {speed} m/s, {name}: {fell.sum()} of {len(fell)} fall")
    plot_push(pushes, engine, out / "02_push.png")
    print("Look at 02_plan.png and 02_push.png in", out)


if __name__ == "__main__":
    robot_model.run_script(main)
