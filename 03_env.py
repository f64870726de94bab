"""Stage 3: what does the robot see, what may it do, and what is it rewarded for?

Paper: section II a, b, d, e. One action is a double step; goal or fall end the episode.

    python 03_env.py                random and hand-written planner side by side; seconds
    python 03_env.py --benchmark    double steps per second of the environment and of bare physics

(both with `--mujoco` in 3-D, `--imu` with the torso's tilt in the observation). Prints the
observation and action tables and where the time goes; writes `runs/<sim>/03_*.png`.

`FootstepWorld` is the whole task for N robots. `FootstepVectorEnv` shows it to PPO as a
`gymnasium.vector.VectorEnv`, `FootstepEnv` ("Footsteps-v0") one robot of it as a `gymnasium.Env`.

Reconstructed (the paper gives only names and captions): the four reward formulas and their
scalars, the encoding of the observation, the spread of goals and noise; each is marked below.
"""

import math
import multiprocessing
import os
import re
import time
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path

import gymnasium as gym
import numpy as np

# A module name may not start with a digit in an import statement, hence import_module.
robot_model = import_module("01_robot_model")
walk_engine = import_module("02_walk_engine")
wrap = robot_model.wrap


@dataclass(frozen=True)
class Task:
    """The task; source "paper", or "ours" where the paper is silent."""

    goal_std_m: float = 1.0  # [m] goals: x, y ~ N(0, 1 m); ours
    goal_std_rad: float = math.pi / 2  # [rad] goals: yaw ~ N(0, π/2), wrapped; ours
    success_m: float = 0.05  # [m] paper
    success_rad: float = math.radians(10)  # [rad] paper
    time_limit: float = 100.0  # [s] simulated; paper
    noise_m: float = 0.05  # [m] standard deviation of the measured goal, x and y; ours
    noise_rad: float = 0.05  # [rad] of its yaw; ours
    near_m: float = 0.4  # [m] what "close" means in the rewards; ours

    # Scalars of the reward. The paper's terms (values reconstructed):
    s_d: float = 1.0  # [1/m] distance
    s_a: float = 0.3  # [1/rad] angle
    s_o: float = 0.1  # [1/rad] orient to goal
    s_c: float = 0.02  # [-] continuity
    # Our three:
    s_fall: float = 4.0  # [-] the price of a fall
    s_goal: float = 1.0  # [-] the prize at the goal
    s_time: float = 0.01  # [-] per double step; never to arrive costs 0.01 / (1 − γ) = 0.5


# The observation: name, unit, low, high. d: distance to the goal, α: its orientation seen from the
# robot, β: the direction towards it seen from the robot (paper, Fig. 2); the encoding is ours.
GOAL_TABLE = (
    ("distance d, at most 3 m", "m", 0.0, 3.0),
    ("near x: 2·d·cos β, at most ±0.5 m of goal", "m / 2", -1.0, 1.0),
    ("near y: 2·d·sin β, at most ±0.5 m of goal", "m / 2", -1.0, 1.0),
    ("cos β", "1", -1.0, 1.0),
    ("sin β", "1", -1.0, 1.0),
    ("cos α", "1", -1.0, 1.0),
    ("sin α", "1", -1.0, 1.0),
    ("α / π", "π rad", -1.0, 1.0),
)
ACTION_NAMES = tuple(f"{foot} {axis}" for foot in ("left", "right") for axis in ("x", "y", "yaw"))
PREVIOUS_TABLE = tuple(
    (f"{name}, {ago}", "share of limits, −1…1", -1.0, 1.0)
    for ago in ("last action", "action before")
    for name in ACTION_NAMES
)
IMU_TABLE = (
    ("torso roll × 4", "rad / 4", -4.0, 4.0),
    ("torso pitch × 4", "rad / 4", -4.0, 4.0),
    ("angular velocity x", "rad/s", -10.0, 10.0),
    ("angular velocity y", "rad/s", -10.0, 10.0),
    ("angular velocity z", "rad/s", -10.0, 10.0),
)
STREAMS = {"training": 1, "tuning": 2, "evaluation": 3}  # separate random numbers for each


def observation_table(imu=False):
    """Rows (name, unit, low, high) of the observation, in order."""
    return GOAL_TABLE + PREVIOUS_TABLE + (IMU_TABLE if imu else ())


def stream(name, *seed):
    """The random generator of a named purpose."""
    return np.random.default_rng(np.random.SeedSequence([STREAMS[name], *seed]))


def draw_goals(rng, count, task=Task()):
    """Goal poses [count, 3]: x, y [m], yaw [rad]. Goal i does not depend on `count`."""
    scale = (task.goal_std_m, task.goal_std_m, task.goal_std_rad)
    goals = rng.normal(size=(count, 3)) * scale
    goals[:, 2] = wrap(goals[:, 2])
    return goals


def polar(goal):
    """d [m], α, β [rad] of goals seen from the robot, [..., 3] (x, y, yaw)."""
    return np.hypot(goal[..., 0], goal[..., 1]), wrap(goal[..., 2]), np.arctan2(
        goal[..., 1], goal[..., 0]
    )  # fmt: skip


def encode_goal(goal):
    """The eight numbers [..., 8] of GOAL_TABLE for goals seen from the robot [..., 3]."""
    d, alpha, beta = polar(goal)
    near = np.clip(2 * goal[..., :2], -1, 1)
    return np.stack(
        [np.minimum(d, 3.0), near[..., 0], near[..., 1], np.cos(beta), np.sin(beta),
         np.cos(alpha), np.sin(alpha), alpha / np.pi], -1)  # fmt: skip


def to_footsteps(action, limits):
    """Actions [..., 6] in [0, 1] as footsteps [..., 2, 3]: 0 is the lower limit, 1 the upper."""
    low, high = np.array(limits.low), np.array(limits.high)
    return low + np.reshape(action, (*np.shape(action)[:-1], 2, 3)) * (high - low)


def to_action(footsteps, limits):
    """The action [..., 6] of footsteps [..., 2, 3]; inverse of `to_footsteps`, clipped."""
    low, high = np.array(limits.low), np.array(limits.high)
    share = np.clip((footsteps - low) / (high - low), 0, 1)
    return share.reshape(*share.shape[:-2], 6)


def reward_terms(before, after, action, last_action, fall, success, task=Task()):
    """The seven scaled terms by name, each [n]; their sum is the reward.

    before, after [n, 3]: the goal seen from the robot around the double step; actions [n, 6] in
    [0, 1]. Distance, angle and orientation pay for progress: undiscounted, walking in a circle
    pays nothing; discounted (γ < 1), every double step spent farther away costs.
    """
    d0, alpha0, beta0 = polar(before)
    d1, alpha1, beta1 = polar(after)
    near0, near1 = np.exp(-((d0 / task.near_m) ** 2)), np.exp(-((d1 / task.near_m) ** 2))
    # r_d = d − d′
    distance = d0 - d1
    # r_a = |α|·near(d) − |α′|·near(d′),  near(d) = exp(−(d / 0.4 m)²)
    angle = np.abs(alpha0) * near0 - np.abs(alpha1) * near1
    # r_o = |β|·far(d) − |β′|·far(d′),  far(d) = 1 − near(d)
    orient = np.abs(beta0) * (1 - near0) - np.abs(beta1) * (1 - near1)
    # r_c = −Σ (footstep length − last footstep length)², in shares of the limits, x and y
    lengths = [0, 1, 3, 4]
    continuity = -((action - last_action)[:, lengths] ** 2).sum(-1)
    return {
        "r_d": task.s_d * distance,
        "r_a": task.s_a * angle,
        "r_o": task.s_o * orient,
        "r_c": task.s_c * continuity,
        "r_fall": -task.s_fall * fall,
        "r_goal": task.s_goal * success,
        "r_time": np.full(len(d0), -task.s_time),
    }


class FootstepWorld:
    """N robots on their way to N goals. Every method takes the indices [n] of some of them."""

    def __init__(self, num_robots, sim="pymunk", noise=False, imu=False, task=Task(), cores=None,
                 robot=robot_model.RobotModel()):  # fmt: skip
        kind = robot_model.SIMULATORS[sim]
        self.task, self.imu, self.noise = task, imu, noise
        self.limits = walk_engine.LIMITS[sim]
        parameters = walk_engine.TUNED[sim]
        self.engine = walk_engine.WalkEngine(num_robots, parameters, robot, kind.planar)
        self.sim = kind(num_robots, self.engine.stance, robot, cores)
        self.neutral_action = to_action(np.zeros((2, 3)), self.limits)  # [6] step on the spot
        self.rng = [None] * num_robots  # one generator a robot: its goal and its noise
        self.goal = np.zeros((num_robots, 3))
        self.pose = np.zeros((num_robots, 3))  # torso on the ground, true
        self.tilt = np.zeros((num_robots, 5))  # roll, pitch [rad], angular velocity [rad/s]
        self.actions = np.zeros((num_robots, 2, 6))  # the last one, the one before
        self.steps = np.zeros(num_robots, int)  # double steps of this episode
        self.seconds = {"planning": 0.0, "physics": 0.0}  # wall-clock, for the benchmark

    def reset(self, robots, rngs, goals=None):
        """Start episodes of these robots: standing at the origin, goal drawn from their rng."""
        robots = np.asarray(robots)
        for i, rng in zip(robots, rngs):
            self.rng[i] = rng
        if goals is None:
            goals = np.concatenate([draw_goals(rng, 1, self.task) for rng in rngs])
        self.sim.reset(robots)
        self.engine.reset(robots)
        self.goal[robots], self.pose[robots], self.steps[robots] = goals, 0, 0
        self.tilt[robots] = 0
        self.tilt[robots, 1] = self.engine.parameters.trunk_pitch
        self.actions[robots] = self.neutral_action

    def relative_goal(self, robots):
        """The true goal seen from the robot [n, 3]: x, y [m], yaw [rad]."""
        return walk_engine.relative(self.pose[robots], self.goal[robots])

    def measure(self, robots):
        """The goal as the robot measures it [n, 3]: with noise, drawn anew at every call."""
        goal = self.relative_goal(robots)
        if self.noise:
            scale = (self.task.noise_m, self.task.noise_m, self.task.noise_rad)
            goal = goal + np.array([self.rng[i].normal(size=3) for i in robots]) * scale
        goal[:, 2] = wrap(goal[:, 2])
        return goal

    def observe(self, robots, measured=None):
        """Observations [n, 20 or 25], float32, as in `observation_table`."""
        goal = self.measure(robots) if measured is None else measured
        parts = [encode_goal(goal), 2 * self.actions[robots].reshape(len(goal), 12) - 1]
        if self.imu:
            low, high = np.array([row[2:] for row in IMU_TABLE]).T
            parts.append(np.clip(self.tilt[robots] * [4, 4, 1, 1, 1], low, high))
        return np.concatenate(parts, -1).astype(np.float32)

    def step(self, actions, robots):
        """One double step of these robots; actions [n, 6] in [0, 1].

        Returns a dict of arrays [n]: success, fall, timeout (bool), time [s], reward, and
        reward_terms by name; and the Motion and the footsteps executed [n, 2, 3].
        """
        actions = np.clip(np.asarray(actions, float), 0, 1)
        before, last = self.relative_goal(robots), self.actions[robots, 0]
        clock = time.perf_counter()
        trajectory, executed = self.engine.plan(to_footsteps(actions, self.limits), robots)
        planned = time.perf_counter()
        motion = self.sim.run(trajectory, robots)
        self.seconds["planning"] += planned - clock
        self.seconds["physics"] += time.perf_counter() - planned
        self.pose[robots] = motion.pose
        self.tilt[robots] = np.concatenate([motion.torso[:, -1, 3:5], motion.spin], -1)
        self.actions[robots, 1], self.actions[robots, 0] = last, actions
        self.steps[robots] += 1
        after = self.relative_goal(robots)
        d, alpha, _ = polar(after)
        at_goal = (d <= self.task.success_m) & (np.abs(alpha) <= self.task.success_rad)
        success = at_goal & ~motion.fell  # a fall wins
        seconds = self.steps[robots] * self.engine.period
        # No double step may end after the time limit: is there room for one more?
        late = seconds + self.engine.period > self.task.time_limit + 1e-9
        timeout = late & ~success & ~motion.fell
        terms = reward_terms(before, after, actions, last, motion.fell, success, self.task)
        return {
            "success": success, "fall": motion.fell, "timeout": timeout, "time": seconds,
            "reward": sum(terms.values()), "reward_terms": terms,
            "motion": motion, "executed": executed,
        }  # fmt: skip

    def close(self):
        """End the simulator's threads or processes."""
        self.sim.close()


def walk_episodes(world, act, robots, watch=None):
    """Walk until the episode of each of these robots [n], just reset, has ended.

    act(world, robots, measured) returns actions [m, 6] for the robots that still walk and the
    goals [m, 3] that they measured; watch(robots, result) is called after every `world.step`.
    Returns outcomes [n]: "success", "fall" or "timeout".
    """
    outcome = np.full(len(world.steps), "running", "<U7")
    active = np.asarray(robots)
    while len(active):
        measured = world.measure(active)  # [m, 3] one measurement per decision
        actions = act(world, active, measured)  # [m, 6]
        if np.shape(actions) != (len(active), 6) or not np.isfinite(actions).all():
            raise ValueError(f"a planner must return {len(active)} × 6 finite numbers in [0, 1]")
        result = world.step(actions, active)
        for name in ("success", "fall", "timeout"):  # judged by the pose that physics made
            outcome[active[result[name]]] = name
        if watch:
            watch(active, result)
        active = active[outcome[active] == "running"]
    return outcome[robots]


def spaces(imu):
    """Observation and action space of one robot."""
    low, high = np.array([row[2:] for row in observation_table(imu)], np.float32).T
    return gym.spaces.Box(low, high), gym.spaces.Box(0.0, 1.0, (6,), np.float32)


def fingerprint(sim, imu=False):
    """What a policy was made for, in plain values; it is stored with the policy."""
    return {
        "simulator": sim,
        "observation": [row[0] for row in observation_table(imu)],
        "step limits": asdict(walk_engine.LIMITS[sim]),
        "walk parameters": asdict(walk_engine.TUNED[sim]),
    }


class FootstepVectorEnv(gym.vector.VectorEnv):
    """N independent episodes in one call. A finished one starts anew in the SAME step:

    `step` returns the first observation of the new episode, and the last one of the old episode in
    `infos["final_obs"]`: PPO needs that one to bootstrap a time-out.
    """

    metadata = {"autoreset_mode": gym.vector.AutoresetMode.SAME_STEP, "render_modes": []}

    def __init__(self, num_envs=64, sim="pymunk", noise=False, imu=False, **world):
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = spaces(imu)
        batch = gym.vector.utils.batch_space
        self.observation_space = batch(self.single_observation_space, num_envs)
        self.action_space = batch(self.single_action_space, num_envs)
        self.world = FootstepWorld(num_envs, sim, noise, imu, **world)
        self.neutral_action = self.world.neutral_action
        self._everybody = np.arange(num_envs)

    def reset(self, *, seed=None, options=None):
        """New episodes; robot i has the seed + i. options["goals"] [N, 3] sets the goals."""
        rngs = self.world.rng
        if isinstance(seed, (int, np.integer)):
            seed = [int(seed) + i for i in range(self.num_envs)]
        if seed is not None:
            rngs = [stream("training", s) for s in seed]
        elif rngs[0] is None:
            fresh = np.random.SeedSequence().generate_state(self.num_envs)
            rngs = [stream("training", s) for s in fresh]
        self.world.reset(self._everybody, rngs, (options or {}).get("goals"))
        return self.world.observe(self._everybody), {}

    def step(self, actions):
        """See `FootstepWorld.step`; infos hold the reward terms, and final_obs, final_info."""
        world = self.world
        result = world.step(actions, self._everybody)
        terminated, truncated = result["success"] | result["fall"], result["timeout"]
        observations = world.observe(self._everybody)
        infos = {"reward_terms": result["reward_terms"]}
        done = terminated | truncated
        if done.any():
            ended = np.flatnonzero(done)
            final = {key: result[key] for key in ("success", "fall", "timeout", "time")}
            infos["final_obs"], infos["_final_obs"] = observations.copy(), done
            infos["final_info"] = {**final, **{f"_{key}": done for key in final}}
            infos["_final_info"] = done
            world.reset(ended, [world.rng[i] for i in ended])
            observations[ended] = world.observe(ended)
        return observations, result["reward"], terminated, truncated, infos

    def close_extras(self, **_):
        """Called once by `close`."""
        self.world.close()


class FootstepEnv(gym.Env):
    """One robot; the same world with N = 1."""

    metadata = {"render_modes": []}

    def __init__(self, sim="pymunk", noise=False, imu=False, render_mode=None, **world):
        self.observation_space, self.action_space = spaces(imu)
        self.render_mode = render_mode
        self.world = FootstepWorld(1, sim, noise, imu, cores=1, **world)
        self.neutral_action = self.world.neutral_action

    def reset(self, *, seed=None, options=None):
        """A new episode; options["goal"] = (x, y, yaw) sets its goal."""
        if seed is not None:
            self._np_random, self._np_random_seed = stream("training", seed), seed
        goal = (options or {}).get("goal")
        goals = None if goal is None else np.reshape(goal, (1, 3))
        self.world.reset([0], [self.np_random], goals)
        return self.world.observe([0])[0], {}

    def step(self, action):
        """One double step; the info holds the reward terms and how the episode ended."""
        result = self.world.step(np.reshape(action, (1, 6)), [0])
        info = {key: result[key][0] for key in ("success", "fall", "timeout", "time")}
        info["reward_terms"] = {name: float(r[0]) for name, r in result["reward_terms"].items()}
        terminated = bool(info["success"] or info["fall"])
        observation = self.world.observe([0])[0]
        return observation, float(result["reward"][0]), terminated, bool(info["timeout"]), info

    def close(self):
        """End the simulator."""
        self.world.close()


gym.register("Footsteps-v0", entry_point=FootstepEnv, vector_entry_point=FootstepVectorEnv)


# ---------------------------------------------------------------------------- demonstration


def hand_written(world, robots, measured):
    """A planner to compare with: turn towards the goal, walk, turn to its orientation.

    It takes half of what the limits allow and knows nothing about dynamics. Actions [n, 6].
    """
    d, alpha, beta = polar(measured)
    turn = np.where(d > 0.5, beta, alpha)  # [n] where to look
    low, high = np.array(world.limits.low) / 2, np.array(world.limits.high) / 2
    footsteps = np.zeros((len(robots), 2, 3))
    # Two steps share the way forward; sideways only the leading foot steps outward.
    footsteps[:, :, 0] = np.clip(measured[:, 0] / 2, low[0], high[0])[:, None]
    footsteps[:, 0, 1] = np.clip(measured[:, 1], 0, high[1])
    footsteps[:, 1, 1] = np.clip(-measured[:, 1], 0, high[1])
    footsteps[:, :, 2] = np.clip(turn / 2, low[2], -low[2])[:, None] * walk_engine.MIRROR[:, 2]
    return to_action(footsteps, world.limits)


def plot_terms(terms, path, title):
    """Reward terms of one episode, per double step and added up."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    steps = np.arange(1, len(terms) + 1)
    for name in terms[0]:
        values = np.array([row[name] for row in terms])
        axes[0].plot(steps, values, ".-", label=name)
        axes[1].plot(steps, np.cumsum(values), label=name)
    total = np.cumsum([sum(row.values()) for row in terms])
    axes[1].plot(steps, total, "k", lw=2, label="all")
    axes[0].set(title="reward terms", xlabel="double step", ylabel="reward [-]")
    axes[1].set(title="their sums so far", xlabel="double step", ylabel="sum of rewards [-]")
    axes[1].legend(ncols=2, fontsize=8)
    for axis in axes:
        axis.grid(alpha=0.3)
    figure.suptitle(title)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def memory():
    """Memory of this process and its children [bytes]; nan where /proc does not tell."""
    try:
        processes = [os.getpid(), *(p.pid for p in multiprocessing.active_children())]
        statuses = [Path(f"/proc/{pid}/status").read_text() for pid in processes]
    except OSError:
        return math.nan
    return sum(1024 * int(re.search(r"VmRSS:\s+(\d+)", text)[1]) for text in statuses)


def benchmark(sim, imu=False, seed=0, counts=(1, 4, 16, 64, 256)):
    """Prints double steps per second of the environment and of bare physics, by number of robots.

    Bare physics: the same physics steps of the same walk, timed inside the simulator, without
    plans, motor targets, measurements and rewards. Memory: what the robots add to the processes,
    which are counted after they have started.
    """
    print("double steps per second; planning: its share of the environment's time")
    head = ("robots", "environment", "bare physics", "ratio", "planning", "kB per robot")
    print("{:>6s} {:>12s} {:>13s} {:>6s} {:>9s} {:>13s}".format(*head))
    for count in counts:
        env = FootstepVectorEnv(count, sim, imu=imu)
        env.world.sim.bare_seconds()  # by its answer all worker processes have started
        empty = memory()
        env.reset(seed=seed)
        action = np.tile(env.neutral_action, (count, 1))
        rounds = max(4, 512 // count)
        env.step(action)
        world, before = env.world, env.world.sim.bare_seconds()
        world.seconds["planning"] = 0.0
        clock = time.perf_counter()
        for _ in range(rounds):
            env.step(action)
        took = time.perf_counter() - clock
        speed = count * rounds / took
        bare = count * rounds / (world.sim.bare_seconds() - before)
        used = (memory() - empty) / count / 1000
        print(f"{count:6d} {speed:12.0f} {bare:13.0f} {speed / bare:6.2f} "
              f"{world.seconds['planning'] / took:9.2f} {used:13.0f}")  # fmt: skip
        env.close()


def main():
    """See the head of this file."""
    parser = robot_model.stage_parser(__doc__)
    parser.add_argument("--imu", action="store_true", help="tilt and angular velocity observed too")
    parser.add_argument("--benchmark", action="store_true", help="measure the speed")
    args = robot_model.parse_stage(parser)
    out = robot_model.output_folder(parser, args)
    if args.benchmark:
        benchmark(args.sim, args.imu, args.seed)
        return
    print(f"{'observation':32s} {'unit':>22s} {'low':>7s} {'high':>7s}")
    for name, unit, low, high in observation_table(args.imu):
        print(f"{name:32s} {unit:>22s} {low:7.1f} {high:7.1f}")
    count = 64
    world = FootstepWorld(count, args.sim, imu=args.imu)
    limits = world.limits
    print(f"\n{'action':32s} {'unit':>22s} {'0 is':>7s} {'1 is':>7s}   (outward is positive)")
    for i, name in enumerate(ACTION_NAMES):
        unit = "rad" if name.endswith("yaw") else "m"
        print(f"{name:32s} {unit:>22s} {limits.low[i % 3]:7.2f} {limits.high[i % 3]:7.2f}")

    dice = stream("training", args.seed, 0)
    planners = {
        "random": lambda world, robots, measured: dice.random((len(robots), 6)),
        "hand-written": hand_written,
    }
    head = ("success", "fall", "timeout", "time of success [s]")
    print(f"\n{count} goals {head[0]:>14s} {head[1]:>8s} {head[2]:>8s} {head[3]:>20s}")
    clock = time.perf_counter()
    steps, everybody = 0, np.arange(count)
    for title, planner in planners.items():
        terms = []  # of robot 0, a dict per double step

        def watch(robots, result):
            if robots[0] == 0:
                terms.append({name: r[0] for name, r in result["reward_terms"].items()})

        world.reset(everybody, [stream("training", args.seed, 1 + i) for i in everybody])
        outcome = walk_episodes(world, planner, everybody, watch)
        steps += world.steps.sum()
        shares = [np.mean(outcome == name) for name in ("success", "fall", "timeout")]
        good = world.steps[outcome == "success"] * world.engine.period  # [s]
        print(f"{title:13s} {shares[0]:9.2f} {shares[1]:8.2f} {shares[2]:8.2f} "
              f"{good.mean() if len(good) else math.nan:20.1f}")  # fmt: skip
    took = time.perf_counter() - clock
    title = f"One episode of the hand-written planner ({args.sim})"
    plot_terms(terms, out / "03_rewards.png", title)
    world.close()
    print(f"\n{steps / took:.0f} double steps per second; of the time: " + ", ".join(
        f"{name} {100 * s / took:.0f} %" for name, s in world.seconds.items()))  # fmt: skip
    print("Look at", out / "03_rewards.png")


if __name__ == "__main__":
    main()
