"""Stage 2: how do two footsteps become a walk?

The paper uses the walk engine of [5]: quintic splines (polynomials of degree 5, joined smoothly)
for the swing foot and the trunk, inverse kinematics by formulas (from the poses of feet and trunk
to joint angles), and parameters found by optimisation. We add three answers to what the IMU
measures; in the paper they are future work (see `WalkPlan`). A reflex moves the ankles. A capture
step lands where the robot leans. Waiting lets a step take longer. In 3-D all three are on. On the
plane the last two gain nothing in usual walks, so there they are off.

    python 02_walk_engine.py      a plan, four walks, pushes; 4 seconds (`--mujoco` in 3-D)

Prints, for four walks of eight double steps, where the robot was commanded to end and where it
ended. Draws `runs/<sim>/02_plan.png`, `02_walk.png` and `02_push.png`. The planar robot ends within
1.2 cm of the command. The 3-D robot misses it by up to 0.13 m and 0.19 rad, and a planner has to
correct this. (More grip does not help, as a try with `friction` 5 shows.) `python
tests/studies/walk.py` measures how fast and how well the robot walks on other floors and with other
bodies, and tunes the walk. Nothing is random here, so `--seed` changes nothing.

Then the stage pushes twelve walking robots forward, in each of three runs, each robot at another
moment of the double step. They walk without any answer (in open loop), then with the reflex, then
with all three answers (in this test the planar robot has them, too). Guess first: how many of the
twelve fall each time, in 3-D and on the plane? (Answers: `tests/exercises/predict.md`, capture.) A
push of 0.8 m/s is a force for 50 ms. It would give the torso alone this speed, and the whole robot
0.57 of it, as the torso has 0.57 of the mass.

A double step is a swing of the left foot and then one of the right. A footstep (x, y, yaw) says
where the swing foot lands. (0, 0, 0) is the swing foot's usual place: beside the other foot, at
foot_distance, with the same heading. x and y are measured along the axes of the other foot. For the
right foot y and yaw are mirrored, so that outward is positive for both. With all zeros the robot
steps on the spot. With (0.08, 0, 0) for both feet each lands 0.08 m ahead of the other: a double
step moves the robot by 0.16 m (the first one moves the middle of its feet by 0.12 m, since they
start side by side). With (0, 0.06, 0) for the left and zeros for the right foot it moves 0.06 m to
the left.

Predict: in 3-D the robot sways from side to side in a straight walk. How far does it sway? Give it
as a share of p, the distance from the middle between the feet to the support foot. Model the robot
as a linear inverted pendulum: all its mass m at a constant height h, on a massless leg that stands
on the support foot. y is the distance of the mass from the foot. The leg pushes along itself: its
force has the vertical part m·g, and so the horizontal part m·g·y/h. Hence

    ÿ = g/h·y   and   y(t) = y₀·cosh(√(g/h)·t)

Here t = 0 is the middle of a single step. Then the mass is nearest to the foot, at y₀, and turns
back. A single step lasts P/2, where P is the period of the double step. So at t = ±P/4 the mass
must be in the middle, where the other foot takes over: y(P/4) = p. Therefore in mid-step the mass
has swayed by

    p − y₀ = p·(1 − 1/cosh(√(g/h)·P/4))

towards the foot. Put in h = 0.37 m (the centre of mass; the torso frame is at 0.38 m) and P = 0.62
s, and compare your share with that of the tuned plan, which the stage prints. (`trunk_swing` is the
sway of the trunk. The centre of mass sways less, because the legs move less; `trunk_roll` makes it
sway a little more. And the foot is no point: it may press anywhere on its sole.) The planar robot
does not sway, as it cannot fall sideways.

[5] Bestmann, Zhang, 2022: Bipedal Walking on Humanoid Robots through Parameter Optimization.
"""

from dataclasses import dataclass, replace
from importlib import import_module

import matplotlib.pyplot as plt
import numpy as np

# A module name may not start with a digit in an import statement, hence import_module.
robot_model = import_module("01_robot_model")
LEFT, RIGHT, GROUND = robot_model.LEFT, robot_model.RIGHT, robot_model.GROUND
compose = robot_model.compose


@dataclass(frozen=True)
class WalkParameters:
    """How the robot walks; named after the parameters of [5]."""

    half_ticks: int  # [control ticks] of a single step
    double_support: float  # [-] share of a single step with both feet on the floor
    foot_distance: float  # [m] between the ankles when standing
    foot_rise: float  # [m] apex of the swing foot
    trunk_height: float  # [m] torso frame above the soles
    trunk_phase: float  # [single steps] by which the trunk is late; between −0.5 and 0.5
    trunk_pitch: float  # [rad] forward lean
    trunk_swing: float  # [-] share of the distance from the middle to the support foot
    trunk_x_offset: float  # [m] trunk ahead of the middle of the feet
    pitch_per_step: float  # [rad/m] lean added per metre of a single step
    trunk_roll: float  # [rad] towards the support foot, in the middle of a single step; ours
    reflex: float = 0.05  # [s] gain at the support ankle, see `WalkPlan`; ours, not tuned
    # How a double step answers the torso's lean; ours. With capture = wait = 0 there is no answer.
    # In 3-D the values 1.0 and 10.0 were measured (STUDIES, kicks). The planar robot gains nothing.
    capture: float = 0.0  # [-] share of the lean that the swing foot follows, see `capture_step`
    usual_lean: float = 0.04  # [rad] a lean that comes from walking alone: not answered
    fade: float = 0.03  # [-] share of a standing foot's answer that is lost per reading
    wait: float = 0.0  # [1/rad] how much the plan slows down per lean, see `waiting_pace`
    late_lean: float = 0.06  # [rad] lean over the support foot from which on it slows down
    longest_wait_ticks: int = 40  # [control ticks] that a double step may take longer


# Found by `tests/studies/walk.py --tune`: for the planar robot on 2026-11-26; in 3-D on 2026-11-23,
# for a robot without dry friction. A new search in 3-D found a walk in which every planner is
# slower. On the plane the search found half_ticks = 34; 31 is as in 3-D.
TUNED = {
    "pymunk": WalkParameters(
        half_ticks=31,
        double_support=0.0498,
        foot_distance=0.18,  # not tuned: on the plane it hardly matters
        foot_rise=0.0313,
        trunk_height=0.3652,
        trunk_phase=0.0064,
        trunk_pitch=0.1098,
        trunk_swing=0.0,
        trunk_x_offset=-0.001,
        pitch_per_step=0.1599,
        trunk_roll=0.0,
    ),
    "mujoco": WalkParameters(
        half_ticks=31,
        double_support=0.0777,
        foot_distance=0.1634,
        foot_rise=0.0307,
        trunk_height=0.3767,
        trunk_phase=-0.0475,
        trunk_pitch=0.0706,
        trunk_swing=0.2214,
        trunk_x_offset=0.0124,
        pitch_per_step=-0.2815,
        trunk_roll=0.0533,
        capture=1.0,
        wait=10.0,
    ),
}
REFLEX_LIMIT = 0.25  # [rad] of what the reflex adds to a joint target; our choice
PUSH_TICKS = 5  # [control ticks] that a push lasts; our choice
MIRROR = np.array([[1, 1, 1], [1, -1, -1]])  # footsteps of the left and of the right foot


# ------------------------------------------------------------------------ quintic splines
def quintic(start, end, duration):
    """Coefficients c [..., 6] of x(t) = Σ cₖ·tᵏ with three boundary conditions at each end.

    start, end [..., 3]: position, velocity, acceleration at t = 0 and t = duration [s].
    """
    p0, v0, a0 = np.moveaxis(start, -1, 0)
    p1, v1, a1 = np.moveaxis(end, -1, 0)
    D = duration
    # c₀ = p₀, c₁ = v₀, c₂ = a₀/2 hold at t = 0. At t = D the others must supply what is missing:
    p = p1 - p0 - v0 * D - a0 * D**2 / 2
    v = v1 - v0 - a0 * D
    a = a1 - a0
    # c₃D³ + c₄D⁴ + c₅D⁵ = p,  3c₃D² + 4c₄D³ + 5c₅D⁴ = v,  6c₃D + 12c₄D² + 20c₅D³ = a.
    # To check the solution put D = 1: the rows (20, −8, 1), (−30, 14, −2), (12, −6, 1), halved, are
    # the inverse of the matrix with the rows (1, 1, 1), (3, 4, 5), (6, 12, 20).
    c3 = (20 * p - 8 * v * D + a * D**2) / (2 * D**3)
    c4 = (-30 * p + 14 * v * D - 2 * a * D**2) / (2 * D**4)
    c5 = (12 * p - 6 * v * D + a * D**2) / (2 * D**5)
    return np.stack([p0, v0, a0 / 2, c3, c4, c5], -1)


def polynomial(c, t, order=0):
    """The spline's position, or its derivative of that order: c [..., 6], t [K] -> [..., K]."""
    # numpy wants the coefficients first: [6, ...]
    derived = np.polynomial.polynomial.polyder(np.moveaxis(c, -1, 0), order)
    return np.polynomial.polynomial.polyval(t, derived)


# ------------------------------------------------------------------------ answers to a push
def capture_step(error, over, swings, old, p):
    """Returns each foot's answer to a lean, [n, 2, 3]: how far its landing moves to the left [m],
    and the roll and pitch [rad] that its leg adds to those of the planned trunk.

    error [n, 2]: measured − planned roll and pitch [rad]; over [n]: its roll, positive towards the
    support foot [rad]; swings [n, 2] bool: which foot swings, left or right, double support
    included; old [n, 2, 3]: the answer of the last reading.

    A push makes the robot lean as a whole. Let e be what we answer: the error beyond ± usual_lean,
    times `capture`. The trunk, at the height h, is then h·e from where it should be. So the swing
    leg is placed as if the plan leaned by e more. Its sole stays nearly level, and the whole leg
    moves with the trunk: the foot lands h·e farther on the side to which the robot leans. Seen
    from the new foot, the trunk is then where the plan has it. (The trunk's speed, the ẏ/ω of a
    capture point, is not answered.) If the robot leans to the side of the support foot, the feet
    would come close together. So there the landing is moved back by h·e.
    """
    e = p.capture * (error - np.clip(error, -p.usual_lean, p.usual_lean))  # [n, 2]
    # y = h·e; a positive roll leans to the right, so this moves the landing to the left
    return_y = p.trunk_height * e[:, 0] * (over > 0)  # [n]
    wanted = np.column_stack([return_y, e])[:, None]  # [n, 1, 3]
    # The tilt is noisy, so a swing foot moves half of the distance at every reading. The answer of
    # a standing foot fades slowly: a quick return would tip the robot.
    return np.where(swings[..., None], (old + wanted) / 2, (1 - p.fade) * old)


def waiting_pace(over, p):
    """Returns the part of a tick by which the plan advances in a tick, [n]; over [n]: the lean over
    the support foot [rad].

    Let the mass be y outward of the ankle, and the point of the sole that bears it c outward. The
    pendulum in the head of this file is then ÿ = ω²·(y − c), ω = √(g/h). For the capture point
    ξ = y + ẏ/ω this is ξ̇ = ω·(ξ − c): its distance from c grows as e^(ωt). The sole's edge is 6 cm
    outward. If ξ is beyond it, waiting does not help. If not, the mass comes back. The other foot
    takes over at ξ = −b, b = p·(1 + tanh(ω·P/4)). Until then the mass needs

        t = ln((c + b) / (c − ξ)) / ω

    With ω = 5.2/s, p = 8.2 cm and c = 6 cm a single step, 0.31 s, suffices for ξ = 2 cm. For
    ξ = 4 cm it takes 0.44 s. The robot does not measure ξ, so the law uses the lean instead: the
    trunk is h·over outward of its plan, 2.3 cm at late_lean. The trunk's speed is left out.
    """
    # pace = 1 − wait·(over − late_lean), from 0 to 1
    return np.clip(1 - p.wait * (over - p.late_lean), 0, 1)


@dataclass
class WalkPlan(robot_model.Trajectory):
    """A planned double step, and how it answers what the IMU measures meanwhile.

    In the field's words: feedback of the torso's angular velocity to the ankles (rate feedback, an
    ankle strategy), of its tilt to the landing place (a capture step) and to the timing of the
    step. All of it closes a loop within the double step. With reflex, capture and wait at 0 it is
    the open loop of the paper.
    """

    feet: np.ndarray  # [n, T + 1, 2, 4] x, y, z of the sole below the ankle [m], yaw [rad]
    reflex_gain: np.ndarray  # [n, T, 2] [s] left, right ankle; only of the support foot
    robots: np.ndarray  # [n] that follow it
    engine: object  # the WalkEngine that made it; `targets` writes to its `answer`

    def begin(self):
        """See `Trajectory`."""
        self.progress = np.zeros(len(self.joints))  # [n] ticks of the plan done so far

    @property
    def longest(self):
        """The number of ticks by which the plan may be late."""
        p = self.engine.parameters
        return p.longest_wait_ticks if p.wait else 0

    @property
    def most_ticks(self):
        """The number of ticks that it takes at most."""
        return super().most_ticks + self.longest

    def ended(self, tick):
        """Which robots have come to its end, [n] bool."""
        return self.progress >= self.reflex_gain.shape[1]

    def targets(self, robot, rows, tick, tilt, angular_velocity):
        """See `Trajectory`."""
        p, end = self.engine.parameters, self.reflex_gain.shape[1]
        sample = np.rint(self.progress[rows]).astype(int)  # [k] of the plan, now
        error = tilt - self.trunk[rows, sample, 3:5]  # [k, 2] roll, pitch [rad]
        first = sample < end // 2  # [k] in the first single step, in which the left foot swings
        swings = np.stack([first, ~first], 1)  # [k, 2]
        over = np.where(first, 1, -1) * error[:, 0]  # [k] a positive roll leans to the right
        # How far the plan comes in the next ticks, at most `longest` late  [k, ticks + 1]
        ticks = np.arange(min(robot_model.READ_EVERY, self.most_ticks - tick) + 1)
        progress = self.progress[rows, None] + waiting_pace(over, p)[:, None] * ticks
        progress = np.clip(progress, tick + ticks - self.longest, end)
        self.progress[rows] = progress[:, -1]
        at = np.rint(progress).astype(int)  # [k, ticks + 1] samples of the plan
        added = self.feedback(robot, rows, at, angular_velocity)
        if not p.capture:
            return self.joints[rows[:, None], at], added
        robots = self.robots[rows]
        answer = capture_step(error, over, swings, self.engine.answer[robots], p)  # [k, 2, 3]
        self.engine.answer[robots] = answer
        # The trunk as each leg takes it to be, and the feet  [k, ticks + 1, 2, 6 or 4]
        trunk = self.trunk[rows[:, None], at][:, :, None].repeat(2, 2)
        trunk[..., 3:5] += answer[:, None, :, 1:]
        feet = self.feet[rows[:, None], at]
        moved = answer[:, None, :, :1] * [0, 1]  # [k, 1, 2, 2] x, y
        feet[..., :2] += robot_model.turned(moved, trunk[..., 5])
        return robot_model.body_inverse(robot, trunk, feet, self.engine.planar), added

    def feedback(self, robot, rows, at, angular_velocity):
        """The reflex: what is added to the joint targets of the next ticks, [k, ticks, 12], for
        some rows [k] of the plan.

        at [k, ticks + 1]: the samples of the plan from now on; angular_velocity [k, 2]: of the
        torso about its x and y axes, as the gyro measures it now [rad/s]. If the torso turns
        forward faster than planned, the toes of the support foot are turned down. They press on the
        floor, which brakes the turn.
        """
        ticks = at.shape[1] - 1
        # planned rate of roll and pitch: change of the trunk's lean / time  [k, 2] [rad/s]
        lean = self.trunk[rows[:, None], at, 3:5]  # [k, ticks + 1, 2]
        planned = (lean[:, -1] - lean[:, 0]) / (ticks * robot.control_dt)
        # added = gain·(measured rate − planned rate), at most ± REFLEX_LIMIT; gain [s]
        rate = angular_velocity - planned
        last = self.reflex_gain.shape[1] - 1
        gain = self.reflex_gain[rows[:, None], np.minimum(at[:, :-1], last)]  # [k, ticks, 2]
        turn = gain[..., None] * rate[:, None, None]  # [k, ticks, foot, 2]
        added = np.zeros((*turn.shape[:3], 6))
        added[..., [5, 4]] = np.clip(turn, -REFLEX_LIMIT, REFLEX_LIMIT)  # ankle roll, ankle pitch
        return added.reshape(*turn.shape[:2], 12)


# ------------------------------------------------------------------------ the engine
class WalkEngine:
    """Plans double steps of N robots. It stores the commanded feet and trunk of every robot.

    All poses are seen from one fixed frame: the middle between the feet after a reset. (The origin
    of the simulators is where the torso was then, trunk_x_offset farther ahead.)
    """

    def __init__(self, num_robots, parameters, robot=robot_model.RobotModel(), planar=False):
        p = self.parameters = parameters
        signed = "trunk_phase", "trunk_pitch", "trunk_x_offset", "pitch_per_step", "trunk_roll"
        robot_model.check(p, ("half_ticks", "foot_distance", "trunk_height"), signed)
        if p.double_support >= 1 or abs(p.trunk_phase) >= 0.5:
            raise ValueError(f"double_support below 1, trunk_phase within ± 0.5: {p}")
        robot_model.check_robot(robot)
        self.robot = robot
        self.planar = planar
        self.half = p.half_ticks * robot.control_dt  # [s] a single step
        self.period = 2 * self.half  # [s] a double step that does not wait
        self.period_ticks = 2 * p.half_ticks  # [control ticks] the same
        self.stance = robot_model.stance(  # torso, joints
            robot, planar, p.trunk_height, p.foot_distance, p.trunk_pitch, p.trunk_x_offset
        )
        soles = robot_model.body_points(robot, *self.stance)[0][:, 3:, 2]  # heights [m]
        if np.abs(soles).max() > 0.001:
            robot_model.note(
                f"legs cannot hold the trunk {p.trunk_height} m above the floor: the soles "
                f"are {soles.max():.3f} m above it"
            )
        # Where each foot usually is, seen from the other one: left, right  [2, 3]
        self.beside = np.array([[0, 1, 0], [0, -1, 0]]) * p.foot_distance
        self.feet = np.zeros((num_robots, 2, 3))  # left, right: x, y [m], yaw [rad]
        # Trunk [N, 6, 3]: x, y, z, roll, pitch, yaw; of each of them position, velocity,
        # acceleration. (Its height is constant.)
        self.trunk = np.zeros((num_robots, 6, 3))
        self.answer = np.zeros((num_robots, 2, 3))  # of both feet to a push, see `capture_step`
        self.reset(np.arange(num_robots))

    def reset(self, robots):
        """These robots [n] stand still."""
        p = self.parameters
        self.feet[robots] = self.beside / 2
        self.answer[robots] = 0
        self.trunk[robots] = 0
        self.trunk[robots, :, 0] = p.trunk_x_offset, 0, p.trunk_height, 0, p.trunk_pitch, 0

    def landings(self, right, footsteps):
        """Where the left and then the right foot land [n, 3]; right [n, 3], footsteps [n, 2, 3]."""
        steps = footsteps * MIRROR + self.beside  # [n, 2, 3] each foot seen from the other one
        left = compose(right, steps[:, LEFT])
        return left, compose(left, steps[:, RIGHT])

    def plan(self, footsteps, robots):
        """The WalkPlan of the next double step of these robots [n].

        footsteps [n, 2, 3]: left, right; x, y [m], yaw [rad], outward positive.

            time   0 · · · · · · · · half · · · · · · · period · · · · · · ·
            left   |wait|   swing    |       support       |
            right  |     support     |wait|   swing        |
            trunk  ├───── knot 1 ────────── knot 2 ────────┤──── (knot 3)
                 state                                   state

        A knot is the state (position, velocity, acceleration) that the trunk should have in the
        middle of a single step (trunk_phase later). Knot 3 lies in the next double step. Quintics
        join the knots.
        """
        left, right = self.feet[robots].swapaxes(0, 1)  # [n, 3] each
        new_left, new_right = self.landings(right, footsteps)
        # The next left step is not known yet: we expect the same one again.
        next_left, _ = self.landings(new_right, footsteps)
        knots = [
            self._knot(right, left, new_left),
            self._knot(new_left, right, new_right),
            self._knot(new_right, new_left, next_left),
        ]
        trunk = self._trunk_path(knots, robots)  # [n, T + 1, 6]
        half = self.parameters.half_ticks  # the tick when the support foot changes
        feet = np.zeros((len(left), self.period_ticks + 1, 2, 4))
        # Where a foot stands, after its swing or before it: x, y, yaw; z stays 0
        feet[..., [0, 1, 3]] = np.stack([new_left, right], 1)[:, None]
        feet[:, :half, LEFT] = self._swing(left, new_left)[:, :-1]
        feet[:, half:, RIGHT] = self._swing(right, new_right)
        self.feet[robots] = np.stack([new_left, new_right], 1)
        joints = robot_model.body_inverse(self.robot, trunk, feet, self.planar)
        gain = np.zeros((len(left), self.period_ticks, 2))
        gain[:, :half, RIGHT] = self.parameters.reflex  # of the support foot
        gain[:, half:, LEFT] = self.parameters.reflex
        return WalkPlan(joints, trunk, feet, gain, np.asarray(robots), self)

    def _knot(self, support, start, landing):
        """State of the trunk (as self.trunk) in the middle of a single step, [n, 6, 3].

        The arguments are foot poses [n, 3]: the support foot, the swing foot at lift-off, and where
        it lands. The trunk is half way between the middle of the feet before the step and the
        middle after it, moves with the mean velocity, without acceleration, and is shifted and
        rolled towards the support foot.
        """
        p = self.parameters
        before = (support + start) / 2  # middle of the feet
        after = (support + landing) / 2
        centre = (before + after) / 2
        side = robot_model.relative(centre, support)[:, 1]  # [n] [m] left: positive
        offset = np.stack(
            [np.full_like(side, p.trunk_x_offset), p.trunk_swing * side, 0 * side], -1
        )
        knot = np.zeros((len(centre), 6, 3))
        knot[:, GROUND, 0] = compose(centre, offset)
        knot[:, GROUND, 1] = (after - before) / self.half
        knot[:, 2, 0] = p.trunk_height
        # how far the middle of the feet moves along its mean yaw  [n] [m]
        ahead = robot_model.turned((after - before)[:, :2], -centre[:, 2])[:, 0]
        knot[:, 3, 0] = -p.trunk_roll * np.sign(side)  # a positive roll leans to the right
        knot[:, 4, 0] = p.trunk_pitch + p.pitch_per_step * ahead
        return knot

    def _trunk_path(self, knots, robots):
        """x, y, z, roll, pitch, yaw of the trunk, [n, T + 1, 6]: one quintic from knot to knot."""
        p = self.parameters
        time = np.arange(self.period_ticks + 1) * self.robot.control_dt  # [T + 1] [s]
        ends = (np.arange(3) + 0.5 + p.trunk_phase) * self.half  # [3] [s] when a knot is reached
        state = self.trunk[robots]  # [n, 6, 3]
        path = np.empty((len(state), 6, len(time)))
        for begin, end, knot in zip((0.0, *ends), ends, knots):
            spline = quintic(state, knot, end - begin)  # [n, 6, 6]
            later = time >= begin  # the next spline overwrites what is beyond its knot
            path[..., later] = polynomial(spline, time[later] - begin)
            state = knot
        # The double step ends within the last spline; the next double step begins in that state.
        state = [polynomial(spline, self.period - begin, order) for order in range(3)]
        self.trunk[robots] = np.stack(state, -1)
        return path.swapaxes(1, 2)

    def _swing(self, start, landing):
        """The swing foot [n, half_ticks + 1, 4] (x, y, z, yaw): it waits, rises, and lands."""
        wait = self.parameters.double_support * self.half
        swing = self.half - wait  # [s]
        t = np.arange(self.parameters.half_ticks + 1) * self.robot.control_dt  # [s]
        t = np.clip(t - wait, 0, swing)
        zero = np.zeros_like(start)
        begin = np.stack([start, zero, zero], -1)  # at rest
        end = np.stack([landing, zero, zero], -1)
        foot = np.zeros((len(start), len(t), 4))
        foot[..., [0, 1, 3]] = polynomial(quintic(begin, end, swing), t).swapaxes(1, 2)
        up = quintic([0, 0, 0], [self.parameters.foot_rise, 0, 0], swing / 2)  # [6]
        # The descent is the rise, reversed in time.
        foot[..., 2] = polynomial(up, np.minimum(t, swing - t))
        return foot


def push_force(robot, speed):
    """The force [N] that gives the torso alone this speed [m/s] within PUSH_TICKS."""
    # force = mass·Δv / duration
    return robot.torso.mass * speed / (PUSH_TICKS * robot.control_dt)


def walkers(
    sim,
    num_robots,
    parameters=None,
    robot=robot_model.RobotModel(),
    cores=None,
    simulate=robot_model.make_sim,
):
    """The engine that plans for N robots, and the simulator in which they stand; parameters: None
    for TUNED. `sim` chooses the settings, `simulate` makes the physics (see `make_sim`)."""
    planar = robot_model.SIMULATORS[sim].planar
    engine = WalkEngine(num_robots, parameters or TUNED[sim], robot, planar)
    return engine, simulate(sim, num_robots, engine.stance, robot, cores)


def walk_plans(
    sim,
    parameters,
    footsteps,
    body=None,
    disturb=None,
    watch=None,
    **more,  # of `walkers`: robot, cores, simulate
):
    """Lets N robots, which differ from the model by `body`, walk K double steps [N, K, 2, 3].

    Returns torso poses [N, K + 1, 3], commanded ones [N, K + 1, 3] (yaws unwrapped; both begin at
    the origin), and in which double step each robot fell [N] (K: it did not fall). Before every
    double step disturb(disturbance, robots) may change the Disturbance of these robots [n]. After
    every double step watch(engine, motion) is called.
    """
    footsteps = np.asarray(footsteps)
    n, count = footsteps.shape[:2]
    engine, simulator = walkers(sim, n, parameters, **more)
    simulator.reset(np.arange(n), body)
    poses, commanded = np.zeros((2, n, count + 1, 3))
    fall = np.full(n, count)
    ahead = np.array([parameters.trunk_x_offset, 0, 0])  # the trunk, seen from between the feet
    for k in range(count):
        poses[:, k + 1] = poses[:, k]
        up = np.flatnonzero(fall == count)
        if len(up):
            plan = engine.plan(footsteps[up, k], up)
            disturbance = robot_model.Disturbance.none(plan)
            if disturb:
                disturb(disturbance, up)
            motion = simulator.run(up, plan, disturbance)
            poses[up, k + 1] = motion.torso[:, -1, GROUND]
            fall[up[motion.fell]] = k
            if watch:
                watch(engine, motion)
        commanded[:, k + 1] = compose(engine.feet.mean(1), ahead) - ahead
    simulator.close()
    poses[..., 2] = np.unwrap(poses[..., 2])
    return poses, commanded, fall


# ------------------------------------------------------------------------ demonstration
WALKS = {  # eight double steps each
    "forward": [[0.08, 0, 0], [0.08, 0, 0]],
    "backward": [[-0.06, 0, 0], [-0.06, 0, 0]],
    "sideways": [[0, 0.06, 0], [0, 0, 0]],
    "a left turn": [[0.06, 0, 0.15], [0.06, 0, -0.15]],
}


def pushed(sim, parameters, speed, count=12):
    """Lets robots walk straight ahead for six double steps, and pushes each of them once.

    The push, see `push_force`, is forward, at this speed [m/s], and comes in the second double step
    at a moment of the robot's own. Returns the tilt of every torso, `count` arrays [T] [rad], and
    which robots fell [count]. T differs, if a robot waits.
    """
    engine, simulator = walkers(sim, count, parameters)
    robots, tilts, fell = np.arange(count), [[] for _ in range(count)], np.zeros(count, bool)
    for k in range(6):
        plan = engine.plan([WALKS["forward"]] * count, robots)
        disturbance = robot_model.Disturbance.none(plan)
        if k == 1:
            moments = np.linspace(0, 2 * parameters.half_ticks - PUSH_TICKS, count).astype(int)
            for push, first in zip(disturbance.push, moments):
                push[first : first + PUSH_TICKS, 0] = push_force(engine.robot, speed)
        motion = simulator.run(robots, plan, disturbance)
        tilt = np.arccos(np.cos(motion.torso[..., 3:5]).prod(-1))  # [count, T] as in `fallen`
        for own, measured, ticks in zip(tilts, tilt, motion.ticks):
            own.append(measured[:ticks])
        fell |= motion.fell
    simulator.close()
    return [np.concatenate(own) for own in tilts], fell


def plot_push(tilts, engine, path, title):
    """Draws the tilt over time of all robots of `pushed`: arrays [T] by the name of an answer."""
    figure, axis = plt.subplots(figsize=(9, 4.2))
    for (name, robots), style in zip(tilts.items(), ("C3:", "C1--", "C2-")):
        for tilt in robots:
            time = np.arange(len(tilt)) * engine.robot.control_dt
            (line,) = axis.plot(time, np.degrees(tilt), style, lw=0.9)
        line.set_label(name)
    axis.axhline(45, color="black", ls=":", label="fallen")
    axis.axvspan(engine.period, 2 * engine.period, color="0.9", label="each is pushed once in here")
    axis.legend(loc="upper left")
    axis.set(title=title, xlabel="time [s]", ylabel="tilt of the torso [°]", ylim=(0, 60))
    robot_model.save_figure(figure, path)


def plot_plan(engine, plan, motion, path):
    """Draws a robot's double step over time: trunk and soles, planned and measured."""
    robot, time = engine.robot, np.arange(len(plan.trunk[0])) * engine.robot.control_dt
    walked = np.arange(1, motion.ticks[0] + 1) * robot.control_dt  # longer, if it waits
    torso = motion.torso[0, :, :2] + [engine.parameters.trunk_x_offset, 0]  # plan's origin
    points, turn = robot_model.body_points(robot, motion.torso[0], motion.joints[0])
    # The lowest point of a sole [T, 2]: heel or toe, and the edge to which the foot tilts
    soles = points[:, :, 3:, 2].min(-1) - robot.foot_width / 2 * np.abs(turn[..., 2, 1])
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.8))
    titles = "forward: x [m]", "sideways: y [m]", "height of the soles: z [m]"
    for k, (axis, title) in enumerate(zip(axes, titles)):
        for foot, color in enumerate(robot_model.COLORS):
            side = ("left", "right")[foot]
            axis.plot(time, plan.feet[0, :, foot, k], color, label=f"{side} foot, planned")
            if k == 2:
                axis.plot(walked, soles[:, foot], "--", c=color, label=f"{side} foot, measured")
        if k < 2:
            axis.plot(time, plan.trunk[0, :, k], "k", label="trunk, planned")
            axis.plot(walked, torso[:, k], "k--", label="torso, measured")
        axis.axvline(engine.half, color="0.7", label="the support foot changes")
        axis.set(title=title, xlabel="time [s]")
    lines = {line.get_label(): line for axis in axes for line in axis.lines}  # of each name one
    figure.legend(lines.values(), lines, loc="outside lower center", ncols=4)
    figure.suptitle("A double step during a walk: the left foot swings, then the right")
    robot_model.save_figure(figure, path)


def plot_walks(poses, commanded, path, title):
    """Draws every walk from above: poses and commanded poses [4, K + 1, 3]."""
    figure, axis = plt.subplots(figsize=(9, 4.2))
    for k, (name, walked) in enumerate(zip(WALKS, poses)):
        x, y, yaw = walked.T  # an arrow points where the robot faces
        axis.quiver(
            x, y, np.cos(yaw), np.sin(yaw), color=f"C{k + 2}", label=name, width=0.004, pivot="mid"
        )
    axis.plot(*commanded[..., :2].reshape(-1, 2).T, "k+", label="commanded")
    axis.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title=title)
    axis.margins(0.1)
    axis.legend()
    robot_model.save_figure(figure, path)


def main():
    args = robot_model.stage_parser(__doc__).parse_args()
    out = robot_model.output_folder(args)
    sim = args.sim
    parameters = TUNED[sim]
    engine, simulator = walkers(sim, 1)
    print(f"{sim}: a double step takes {engine.period:.2f} s")
    for _ in range(2):  # the second one is drawn; the first one starts from standing
        plan = engine.plan([WALKS["forward"]], [0])
        motion = simulator.run([0], plan)
    simulator.close()
    plot_plan(engine, plan, motion, out / "02_plan.png")
    mass = robot_model.centre_of_mass(engine.robot, plan.trunk[0], plan.joints[0])  # [T + 1, 3]
    share = mass[:, 1].max() / (parameters.foot_distance / 2)
    print(f"in the plan the centre of mass sways {share:.2f} of the distance to the support foot")

    plans = [[double_step] * 8 for double_step in WALKS.values()]  # [4, K, 2, 3]
    poses, commanded, fall = walk_plans(sim, parameters, plans)
    plot_walks(poses, commanded, out / "02_walk.png", f"Eight double steps ({sim}), from above")
    print("walk           commanded x, y [m], yaw [rad]   walked               fell")
    for name, a, b, when in zip(WALKS, commanded[:, -1], poses[:, -1], fall):
        print(
            f"{name:14s} {a[0]:5.2f} {a[1]:5.2f} {a[2]:5.2f}               "
            f"{b[0]:5.2f} {b[1]:5.2f} {b[2]:5.2f}    {'yes' if when < 8 else 'no'}"
        )
    tilts, speed = {}, 0.8  # [m/s]
    on = parameters if sim == "mujoco" else replace(parameters, capture=1, wait=10)
    answers = {
        "open loop": replace(parameters, reflex=0.0, capture=0.0, wait=0.0),
        "reflex": replace(parameters, capture=0.0, wait=0.0),
        "reflex, steps and waiting": on,
    }
    for name, walk in answers.items():
        tilts[name], fell = pushed(sim, walk, speed)
        print(f"pushed by {speed} m/s, {name}: {fell.sum()} of {len(fell)} fall")
    plot_push(tilts, engine, out / "02_push.png", f"Twelve pushes of {speed} m/s each ({sim})")
    print("Look at 02_plan.png, 02_walk.png and 02_push.png in", out)


if __name__ == "__main__":
    robot_model.start(main)
