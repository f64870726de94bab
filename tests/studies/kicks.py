"""Where does the robot fall? Other grounds, other bodies, and pushes.

    python tests/studies/kicks.py --mujoco [--only worlds | pushes] [--out FOLDER]

worlds: three shipped planners, near and far goals with noise. No planner observes the world. (The
two worlds on static friction came last, to find out why the bare model falls more than the drawn
ones.)

pushes, 3-D only: three short trainings with IMU and three without, trained and judged while they
are pushed. A push acts on the torso for 50 ms, in a random horizontal direction, at a random moment
of a double step; alone it would make the torso faster by Δv. On average there is one every 3 s.
They are drawn from generators of the trial, so all planners meet the same.
"""

import common
import numpy as np
from common import SEEDS, env, ppo, robot_model

DURATION = "worlds: 10 minutes on two cores; 3-D: 20, and 60 for the pushes"

# ------------------------------------------------------------------------ other worlds
class Soft(env.Spread):
    """Every motor has 2/3 of the stiffness it would have drawn."""
    def draw(self, rngs, robot):
        body = super().draw(rngs, robot)
        body.stiffness = body.stiffness * 2 / 3
        return body

WORLDS = {  # spread, and friction if it is not drawn
    "as trained": (env.Spread(), np.nan),
    "μ = 0.3 (trained: 0.4 to 1.0)": (env.Spread(), 0.3),
    "μ = 1.2": (env.Spread(), 1.2),
    "masses ± 20 % (± 10 %)": (env.Spread(mass=0.2), np.nan),
    "2/3 of the motors' stiffness": (Soft(), np.nan),
    "no static friction in the joints": (env.Spread(stiction=0.0), np.nan),
    "nothing but static friction": (env.Spread(0, 0, 0, delay=0), np.nan),
    "no spread at all: the model, μ = 0.7": (env.Spread(0, 0, 0, 0, 0), np.nan),
}

def study_worlds(args):
    """Rows of every planner in every world."""
    planners = {"policy": common.policy(common.RESULTS / args.sim / "policy.pt", args.sim)}
    planners |= common.opponents(args.sim)
    rows = []
    for title, (spread, friction) in WORLDS.items():
        with common.world(args.sim, spread=spread) as world:
            for far in (False, True):
                for name in ("policy", "baseline_tuned", "search"):
                    ended = common.walks(planners[name], world, True, far, 2, friction=friction)
                    rows.append({"world": title, **common.row_of(ended, name, True, far)})
    return {"goals": 2 * common.PER_SET, "rows": rows}

# ------------------------------------------------------------------------ pushes
STEPS = 250_000  # double steps of a training: enough to arrive
SPEEDS = (0.0, 0.1, 0.2, 0.3, 0.4)  # Δv [m/s]; trained: anything up to the last one
BETWEEN, LASTS = 3.0, 0.05  # [s] mean time between pushes, and of a push

class KickedSim(robot_model.MujocoSim):
    """Robots of a world that are pushed; Δv is drawn between two values [m/s]."""
    def __init__(self, world, low, high):
        engine, count = world.engine, len(world.rng)
        super().__init__(count, engine.stance, engine.robot, min(robot_model.CORES, count))
        self.dice, self.low, self.high, self.period = world.dice, low, high, engine.period
        self.threads, self.pool = self.pool, self  # `run` calls the rollout below
        self.torso = self.model.body("torso").id

    def run(self, trajectory, robots):
        """See `MujocoSim`."""
        self.running = robots
        return super().run(trajectory, robots)

    def forces(self, robots, steps):
        """On the torso [n, steps, 2] (x, y) [N] in every physics step of a double step."""
        # Always four numbers, with or without a push: so the later ones stay the same.
        dice = np.array([self.dice[i]["kicks"].random(4) for i in robots])  # [n, 4]
        lasts = round(LASTS / self.model.opt.timestep)  # [steps]
        speed = self.low + dice[:, 1] * (self.high - self.low)  # [n] Δv
        # F = m·Δv / duration, with probability period / mean time between pushes
        force = self.robot.torso.mass * speed / LASTS
        force = np.where(dice[:, 0] < self.period / BETWEEN, force, 0)
        begin = np.floor(dice[:, 2] * (steps - lasts + 1)).astype(int)  # it ends within
        since = np.arange(steps) - begin[:, None]  # [n, steps]
        angle = 2 * np.pi * dice[:, 3]
        push = force[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)  # [n, 2]
        return push[:, None] * ((since >= 0) & (since < lasts))[..., None]

    def rollout(self, models, data, start, control):
        """MuJoCo's, with forces and torques on all bodies [n, S, 6·bodies] after the controls."""
        kinds = self.mujoco.mjtState
        n, steps, _ = control.shape
        outer = np.zeros((n, steps, self.model.nbody, 6))
        outer[:, :, self.torso, :2] = self.forces(self.running, steps)
        both = np.concatenate([control, outer.reshape(n, steps, -1)], -1)
        spec = int(kinds.mjSTATE_CTRL) | int(kinds.mjSTATE_XFRC_APPLIED)
        return self.threads.rollout(models, data, start, both, control_spec=spec)

    def close(self):
        """End the threads."""
        self.threads.close()

def kicked(world, low, high):
    """The same world, but its robots are pushed from now on."""
    world.close()
    world.sim = KickedSim(world, low, high)
    world.close = world.sim.close
    return world

def train(name, seed):
    """The policy of a training with pushes; an interrupted one goes on."""
    folder = common.work("mujoco", "kicks", f"{name}_{seed}")
    imu = name == "policy_imu"

    def make_envs(num_envs):
        envs = env.FootstepVectorEnv(num_envs, "mujoco", noise=True, imu=imu)
        kicked(envs.world, 0.0, SPEEDS[-1])
        return envs

    if not (folder / "policy.pt").is_file():
        about = {"fits": env.fingerprint("mujoco", imu), "imu": imu, "noise": True}
        ppo.train(ppo.PPOConfig(), make_envs, folder, STEPS, seed, about,
                  resume=(folder / "checkpoint.pt").is_file())
    return common.policy(folder / "policy.pt", "mujoco")

def study_pushes(args):
    """Both kinds of policies at every Δv."""
    if args.sim != "mujoco":
        raise ppo.PolicyError("a planar robot cannot be pushed sideways: add --mujoco")
    kinds = {name: [train(name, seed) for seed in SEEDS] for name in ("policy", "policy_imu")}
    rows = []
    for speed in SPEEDS:
        with common.world(args.sim) as world:
            kicked(world, speed, speed)
            walks = {name: common.together([common.walks(planner, world, True, far=True, sets=1)
                                            for planner in planners])
                     for name, planners in kinds.items()}
        for name, ended in walks.items():
            row = {"speed": speed, **common.row_of(ended, name, True, far=True)}
            if name == "policy_imu":
                row |= common.time_ratio(ended, walks["policy"], "time_ratio")
            rows.append(row)
    return {"steps": STEPS, "walks": len(SEEDS) * common.PER_SET, "rows": rows}

PARTS = {"worlds": study_worlds, "pushes": study_pushes}

def table(found, sim):
    """Markdown, all with noise."""
    columns = {"planner": 0, "success": 3, "fall": 3, "time_mean": 2}
    return common.sections(found, {"worlds": {"world": 0, "goal_std_m": 1} | columns,
                                   "pushes": {"speed": 1} | columns | {"time_ratio": 3}})

if __name__ == "__main__":
    common.run("kicks")
