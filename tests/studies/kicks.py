"""Does the IMU help where falls exist? Two policies, trained and judged while kicked; 3-D only.

    python tests/studies/kicks.py [--mujoco] [--ship]

A kick pushes the torso for 50 ms, in a random horizontal direction, at a random moment of a double
step, with the impulse that alone would make the torso faster by Δv; on average one every 3 s. In
training Δv is drawn from 0 to 0.4 m/s. Three short trainings of each kind, then 500 far noisy goals
for each of them at each of five fixed Δv. The kicks are drawn from generators of the trial
(`PURPOSES` of stage 3): all planners meet the same. The IMU is read between double steps; so the
table also says how many falls begin and end in one: kicked and down before anything could be felt.
"""

import common
import kept
import numpy as np
from kept import env, ppo, robot_model

DURATION = {"pymunk": "it needs --mujoco", "mujoco": "about an hour on two cores"}
STEPS = 250_000  # double steps of a training: enough to arrive, see budget.py
SEEDS = kept.SEEDS  # of the trainings with and without IMU
SETS = 1  # of 500 far goals
SPEEDS = (0.0, 0.1, 0.2, 0.3, 0.4)  # Δv [m/s]; trained: anything up to the last one
AFTER = ("in the kick's double step", "in the next one", "later")
BETWEEN, LASTS = 3.0, 0.05  # [s] mean time between kicks, and of a kick

class KickedSim(robot_model.MujocoSim):
    """Robots of a world that are kicked; Δv is drawn between two values [m/s]."""

    def __init__(self, world, low, high):
        engine, count = world.engine, len(world.rng)
        super().__init__(count, engine.stance, engine.robot, min(robot_model.CORES, count))
        self.dice, self.low, self.high, self.period = world.dice, low, high, engine.period
        self.threads, self.pool = self.pool, self  # `run` calls the rollout below
        self.torso = self.model.body("torso").id
        self.since = np.full(count, 999)  # [N] double steps since the last kick; 0: in this one
        self.at_fall = self.since.copy()  # the same, when it fell last

    def reset(self, robots, body=None):
        """See `MujocoSim`."""
        super().reset(robots, body)
        if hasattr(self, "since"):  # not yet when it is built
            self.since[robots] = 999

    def run(self, trajectory, robots):
        """See `MujocoSim`."""
        self.kicked = np.asarray(robots)
        self.since[self.kicked] += 1
        motion = super().run(trajectory, robots)
        fell = self.kicked[motion.fell]
        self.at_fall[fell] = self.since[fell]
        return motion

    def forces(self, robots, steps):
        """On the torso [n, steps, 2] (x, y) [N] in every physics step of a double step."""
        # Four numbers for every double step, kick or not: so the later ones stay the same.
        dice = np.array([self.dice[i]["kicks"].random(4) for i in robots])  # [n, 4]
        lasts = round(LASTS / self.model.opt.timestep)  # [steps]
        speed = self.low + dice[:, 1] * (self.high - self.low)  # [n] Δv
        # F = m·Δv / duration, with probability period / mean time between kicks
        force = self.robot.torso.mass * speed / LASTS * (dice[:, 0] < self.period / BETWEEN)
        self.since[robots[force > 0]] = 0
        begin = np.floor(dice[:, 2] * (steps - lasts + 1)).astype(int)  # it ends within
        since = np.arange(steps) - begin[:, None]  # [n, steps]
        angle = 2 * np.pi * dice[:, 3]
        push = force[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)  # [n, 2]
        return push[:, None] * ((since >= 0) & (since < lasts))[..., None]

    def rollout(self, models, data, start, control):
        """MuJoCo's, with forces and torques on all bodies [n, S, 6·bodies] after the controls."""
        kinds = self.mujoco.mjtState
        outer = np.zeros((*control.shape[:2], self.model.nbody, 6))
        outer[:, :, self.torso, :2] = self.forces(self.kicked, control.shape[1])
        both = np.concatenate([control, outer.reshape(*control.shape[:2], -1)], -1)
        spec = int(kinds.mjSTATE_CTRL) | int(kinds.mjSTATE_XFRC_APPLIED)
        return self.threads.rollout(models, data, start, both, control_spec=spec)

    def close(self):
        """End the threads."""
        self.threads.close()

def kicked(world, low, high):
    """The same world, but its robots are kicked from now on."""
    world.sim.close()
    world.sim = KickedSim(world, low, high)
    return world

class KickedTrials(kept.Trials):
    """Trials with kicks of one Δv [m/s]."""

    def __init__(self, speed):
        super().__init__("mujoco")
        self.speed = speed

    def run(self, planner, key, *args, **kw):
        """See `kept.Trials`."""
        return super().run(planner, (key, "kicks, since", self.speed, BETWEEN, LASTS), *args, **kw)

    def measure(self, *args):
        """See `kept.Trials`; and, for every fall, how many double steps ago the last kick was."""
        ended = super().measure(*args)
        fell = np.flatnonzero(ended["outcome"] == "fall")
        return ended | {"since_kick": self.world.sim.at_fall[fell]}

    def make_world(self):
        """The world, when the first trial needs it."""
        if self.world is None:
            kicked(super().make_world(), self.speed, self.speed)
        return self.world

def train(seed, imu):
    """The policy file of a training with kicks."""
    fits, cfg = env.fingerprint("mujoco", imu), ppo.PPOConfig()
    settings = fits, env.Task(), robot_model.RobotModel(), robot_model.Spread(), cfg
    name = common.digest(*settings, STEPS, SPEEDS[-1], BETWEEN, LASTS)
    out = common.work("mujoco") / f"kicks{'_imu' * imu}_{seed}_{name}"

    def make_envs(num_envs):
        envs = env.FootstepVectorEnv(num_envs, "mujoco", noise=True, imu=imu)
        kicked(envs.world, 0.0, SPEEDS[-1])
        return envs

    if not (out / "policy.pt").is_file():
        kept.learn(out, cfg, make_envs, STEPS, seed,
                   about={"fits": fits, "imu": imu, "noise": True})
    return out / "policy.pt"

def study(sim):
    """Both kinds of policies at every Δv."""
    if sim != "mujoco":
        raise common.StudyError("a planar robot cannot be kicked sideways: add --mujoco")
    planners = {name: [kept.policy(train(seed, imu), sim) for seed in SEEDS]
                for name, imu in (("policy", False), ("policy_imu", True))}
    rows, lines = [], []
    for speed in SPEEDS:
        trials, line, plain = KickedTrials(speed), [f"{speed:.1f}"], None
        for name, own in planners.items():
            parts = [trials.run(*planner, True, count=SETS, far=True) for planner in own]
            ended = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
            row = {"speed": speed, **kept.row_of(ended, name, True, far=True)}
            counts = np.bincount(np.minimum(ended["since_kick"], 2), minlength=3).tolist()
            row["falls_after"] = dict(zip(AFTER, counts))
            if plain:
                row |= kept.time_ratio(ended, plain, "time_ratio")
            plain = ended
            rows.append(row)
            line += [common.with_interval(row, "fall"), ", ".join(map(str, counts)),
                     common.number(row["time_mean"], 2)]
        lines.append([*line, common.with_interval(row, "time_ratio")
                      if "time_ratio" in row else ""])
        trials.close()
    head = ["Δv [m/s]", *(f"{name}: {what}" for name in planners
                          for what in ("fall [95 % interval]", "of them in the kick's double step, "
                                       "in the next one, later", "time [s]")),
            "time with IMU ÷ without"]
    content = {"steps": STEPS, "seeds": SEEDS, "walks": len(SEEDS) * SETS * kept.PER_SEED,
               "rows": rows}
    return common.Findings(content, common.markdown(head, lines), plot(rows, planners))

def plot(rows, names):
    """Falls and time over the strength of the kicks."""
    figure, axes = common.plt.subplots(1, 2, figsize=(9, 3.9), layout="constrained")
    for shift, name in enumerate(names):
        own = [row for row in rows if row["planner"] == name]
        x, kw = np.array(SPEEDS) + 0.004 * shift, {"color": kept.COLORS[name], "label": name}
        axes[0].plot(x, [row["fall"] for row in own], f"{kept.MARKERS[name]}-", **kw)
        axes[0].vlines(x, *np.transpose([row["fall_ci95"] for row in own]), alpha=0.4,
                       color=kept.COLORS[name])
        axes[1].plot(x, np.array([row["time_mean"] for row in own], float),
                     f"{kept.MARKERS[name]}-", **kw)
    axes[0].set(title="falls; lines: 95 % intervals", ylabel="share of walks [1]")
    axes[1].set(title="time of successes", ylabel="mean [s]", ylim=(0, 1.1 * axes[1].get_ylim()[1]))
    for axis in axes:
        axis.set(xlabel="Δv of the torso in a kick [m/s]")
        axis.grid(alpha=0.3)
    axes[0].legend()
    figure.suptitle(f"A kick every {BETWEEN:.0f} s, far goals, noise")
    return figure

if __name__ == "__main__":
    common.main(__file__)
