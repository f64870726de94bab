"""What does an honest floor do to the walk? Isotropic friction, drawn like the body; 3-D only.

    python tests/studies/floor.py [--mujoco] [--ship]

The walk was tuned on MuJoCo's friction pyramid with μ = 0.5. Here friction is the same in every
direction, and every robot draws its own: μ from 0.4 to 1.0, masses ± 10 %, stiffness ± 20 %, static
friction of the joints up to 1.5 N m, and a delay of none or one control tick. Measured are the
highest speeds without a fall at the worst of μ = 0.4, 0.7 and 1.0; random plans of eight double
steps that end standing; the lowest corner of the swinging sole between 30 and 70 % of its swing;
and how far the ankle of the support foot slides in a single step. RETUNED comes from the cross-
entropy method in this world (2026-11-21: 10 iterations of 28 candidates from a walk found before),
its roll of the trunk towards the support foot is new.
"""

import copy
from dataclasses import asdict
from importlib import import_module

import common
import numpy as np

robot_model, walk_engine = common.robot_model, import_module("02_walk_engine")
DURATION = {"pymunk": "it needs --mujoco", "mujoco": "about 20 seconds on two cores"}
FRICTION = (0.4, 0.7, 1.0)  # [-] of the speed test
COUNT = 64  # random plans
LOAD = 1.5  # [-] largest sum of the shares of a footstep's limits in x, y and yaw; 3: any
RETUNED = walk_engine.WalkParameters(
    frequency=1.6014, double_support=0.0855, foot_distance=0.1683, foot_rise=0.0312,
    trunk_height=0.3802, trunk_phase=-0.0469, trunk_pitch=0.0695, trunk_swing=0.2186,
    trunk_x_offset=0.013, pitch_per_step=-0.2545, pitch_per_turn=0.0214)
WALKS = {  # name: parameters, roll of the trunk [rad], LOAD
    "as shipped": (walk_engine.TUNED["mujoco"], 0.0, 3.0),
    "as shipped, combined steps limited": (walk_engine.TUNED["mujoco"], 0.0, LOAD),
    "re-tuned, without roll": (RETUNED, 0.0, LOAD),
    "re-tuned": (RETUNED, 0.0541, LOAD),
}

class RollingEngine(walk_engine.WalkEngine):
    """The walk engine with a roll of the trunk: the side of the swing foot is lifted."""

    roll = 0.0  # [rad]

    def _trunk_path(self, knots, robots):
        trunk = super()._trunk_path(knots, robots)
        time = np.arange(trunk.shape[1]) * self.robot.control_dt
        trunk[..., 3] = self.roll * np.sin(np.pi * time / self.half)
        return trunk

class HonestSim(robot_model.MujocoSim):
    """N robots, each with a model of its own. `friction` [N]: of the ground; the rest is drawn."""

    def __init__(self, standing, friction, rng):
        import mujoco

        super().__init__(len(friction), standing, cores=robot_model.CORES)
        self.delay = rng.random(len(friction)) < 0.5  # one control tick, or none
        self.control = np.tile(standing[1], (len(friction), 1))  # of the last tick
        self.models = []
        for mu in friction:
            model, mass = copy.copy(self.model), rng.uniform(0.9, 1.1, self.model.nbody)
            model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
            model.pair_friction[:, :2] = mu
            model.body_mass[:] *= mass
            model.body_inertia[:] *= mass[:, None]
            stiffness = rng.uniform(0.8, 1.2, model.nu)
            model.actuator_gainprm[:, 0] *= stiffness
            model.actuator_biasprm[:, 1] *= stiffness
            model.dof_frictionloss[6:] = rng.uniform(0, 1.5, 12)
            mujoco.mj_setConst(model, self.data[0])  # what MuJoCo derives from the masses
            self.models.append(model)
        self.threads, self.pool = self.pool, self  # `run` calls the rollout below

    def run(self, trajectory, robots):
        """See `MujocoSim`."""
        self.robots = robots
        return super().run(trajectory, robots)

    def rollout(self, _, data, start, control):
        """Every robot with its own model; its commands [n, S, 12] perhaps a tick late."""
        last = self.control[self.robots, None].repeat(self.robot.substeps, 1)
        late = np.concatenate([last, control[:, : -self.robot.substeps]], 1)
        self.control[self.robots] = control[:, -1]
        control = np.where(self.delay[self.robots, None, None], late, control)
        return self.threads.rollout([self.models[i] for i in self.robots], data, start, control)

    def close(self):
        """End the threads."""
        self.threads.close()

def corners(robot, torso, joints):
    """Ankles [..., 2, 3] and height of each sole's lowest corner [..., 2] in the world."""
    base = robot_model.rotation(*np.moveaxis(torso[..., 3:], -1, 0))[..., None, :, :]
    points, turn = robot_model.leg_points(robot, joints.reshape(*joints.shape[:-1], 2, 6))
    ankle = (base @ (points[..., 2, :] + robot.hips)[..., None])[..., 0] + torso[..., None, :3]
    turn, outward = base @ turn, np.array([1, -1])  # left, right
    heights = [turn[..., 2, 0] * x - turn[..., 2, 2] * robot.ankle_height
               + turn[..., 2, 1] * (y + outward * robot.foot_outward)
               for x in (-robot.foot_back, robot.foot_front)
               for y in (-robot.foot_width / 2, robot.foot_width / 2)]
    return ankle, np.min(heights, 0) + ankle[..., 2]

def limited(footsteps, load):
    """Footsteps [..., 2, 3] made smaller where the shares of their limits add up to more."""
    limits = walk_engine.LIMITS["mujoco"]
    largest = np.where(footsteps >= 0, limits.high, np.abs(limits.low))
    share = (np.abs(footsteps) / largest).sum(-1, keepdims=True)
    return footsteps / np.maximum(1, share / load)

def walk(parameters, roll, plans, friction, rng):
    """Torso poses [N, K + 1, 3], falls [N], clearances and slips [m] of all single steps."""
    n, count = plans.shape[:2]
    engine = RollingEngine(n, parameters)
    engine.roll, robot, half = roll, engine.robot, engine.half_ticks
    sim, fall = HonestSim(engine.stance, friction, rng), np.full(n, count)
    poses, clear, slip = np.zeros((n, count + 1, 3)), [], []
    lift = round(half * parameters.double_support)
    early, late = (round(lift + (half - lift) * share) for share in (0.3, 0.7))
    for k in range(count):
        up = np.flatnonzero(fall == count)
        poses[:, k + 1] = poses[:, k]
        motion = sim.run(engine.plan(plans[up, k], up)[0], up)
        poses[up, k + 1], fall[up[motion.fell]] = motion.torso[:, -1, [0, 1, 5]], k
        ankle, low = corners(robot, motion.torso, motion.joints)
        for swing, start in ((0, 0), (1, half)):  # left, right
            clear.append(low[~motion.fell, start + early : start + late, swing].min(1))
            way = ankle[:, start + half - 1, 1 - swing] - ankle[:, start + lift, 1 - swing]
            slip.append(np.hypot(*way[~motion.fell, :2].T))
    sim.close()
    poses[..., 2] = np.unwrap(poses[..., 2], axis=1)
    return poses, fall, np.concatenate(clear), np.concatenate(slip)

def measure(parameters, roll, load, seed=0):
    """One row of the table, plain numbers."""
    rng, straight = np.random.default_rng(seed), walk_engine.speed_plans()
    rough = limited(walk_engine.random_plans(rng, walk_engine.LIMITS["mujoco"], COUNT), load)
    plans = np.concatenate([straight] * len(FRICTION) + [rough])
    friction = np.r_[np.repeat(FRICTION, len(straight)), rng.uniform(0.4, 1.0, COUNT)]
    poses, fall, clear, slip = walk(parameters, roll, plans, friction, rng)
    parts = [slice(i * len(straight), (i + 1) * len(straight)) for i in range(len(FRICTION))]
    period = walk_engine.WalkEngine(1, parameters).period
    speeds = [walk_engine.highest_speed(poses[part], fall[part], period) for part in parts]
    worst = {name: round(min(speed[name] for speed in speeds), 3) for name in speeds[0]}
    stood = float(np.mean(fall[-COUNT:] == plans.shape[1]))
    return {**worst, "stood": round(stood, 3), "slip": round(float(np.median(slip)), 5),
            "clearance": [round(float(np.percentile(clear, q)), 5) for q in (50, 5)]}

def study(sim):
    """Every walk on the same floors with the same bodies."""
    if sim != "mujoco":
        raise common.StudyError("feet can skate sideways in 3-D only: add --mujoco")
    numbers, lines = {}, []
    for name, (parameters, roll, load) in WALKS.items():
        row = numbers[name] = measure(parameters, roll, load)
        clear = " / ".join(f"{1000 * value:.1f}" for value in row["clearance"])
        lines.append([name, *(f"{row[key]:.2f}" for key in walk_engine.DIRECTIONS),
                      f"{row['stood']:.2f}", clear, f"{1000 * row['slip']:.1f}"])
    head = ["walk", "forward [m/s]", "backward [m/s]", "sideways [m/s]", "turning [rad/s]",
            "random plans stood", "clearance [mm], median / 5th percentile", "slip [mm], median"]
    asked = {name: [roll, load] for name, (_, roll, load) in WALKS.items()}
    return common.Findings({"asked": asked, "retuned": asdict(RETUNED), "rows": numbers},
                           common.markdown(head, lines))

if __name__ == "__main__":
    common.main(__file__)
