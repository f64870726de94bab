"""Stage 3: what does the robot see, what may it do, and what is it rewarded for?

Paper: section II a, b, d, e. One action is a double step; goal or fall end the episode. The robot
has arrived when it stays: two double steps in a row must end at the goal (the paper asks for one).

    python 03_env.py      a random and a hand-written planner side by side; 8 seconds

(`--mujoco` in 3-D, `--imu` with the torso's tilt in the observation). Prints what is observed, what
an action is and how the episodes end; writes `runs/<sim>/03_rewards.png`. Predict: of which reward
terms does the hand-written planner earn most, and which ones cost it?

The words. An episode is one walk, from standing to the goal, a fall or the end of the time. A
planner chooses the actions; a policy is a planner that is learned: a function from the observation
to an action. The return of an episode is G = r₀ + γ·r₁ + γ²·r₂ + …; the discount γ, a bit less than
1, makes later rewards count less. An episode is terminated when nothing can follow (goal, fall) and
truncated when only the recording stops (time is up): stage 4 must tell these apart.

`FootstepWorld` is the whole task for N robots. `FootstepVectorEnv` shows it to PPO, the learning
method of stage 4, as a `gymnasium.vector.VectorEnv`; `FootstepEnv` ("Footsteps-v0") shows one robot
of it to other libraries as a `gymnasium.Env`.

Reconstructed, for the paper gives only names and captions: the formulas and scalars of the reward,
the encoding of the observation, the spread of goals and noise. Ours: ground and body are drawn anew
for every episode (`Spread` of stage 1), and neither the planner nor the policy is told.
"""

import math
from dataclasses import asdict, dataclass
from importlib import import_module

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np

robot_model = import_module("01_robot_model")
walk_engine = import_module("02_walk_engine")
wrap = robot_model.wrap

@dataclass(frozen=True)
class Task:
    """The task; source "paper", or "ours" where the paper is silent."""
    goal_std_m: float = 0.5  # [m] goals: x, y ~ N(0, σ²); ours: planar times are as the paper's
    far_std_m: float = 1.0  # [m] of half of the goals in training, and of `05 --far`; ours
    goal_std_rad: float = math.pi / 2  # [rad] goals: σ of the yaw, wrapped; ours
    success_m: float = 0.05  # [m] paper
    success_rad: float = math.radians(10)  # [rad] paper
    time_limit: float = 100.0  # [s] simulated; paper
    noise_m: float = 0.05  # [m] standard deviation of the measured goal, x and y; ours
    noise_rad: float = 0.05  # [rad] of its yaw; ours
    imu_rad: float = 0.02  # [rad] of the measured tilt; ours
    imu_rad_s: float = 0.1  # [rad/s] of the measured angular velocity; ours
    near_m: float = 0.4  # [m] what "close" means in the rewards; ours
    # Scalars of the reward. The paper's terms (values reconstructed):
    s_d: float = 1.0  # [1/m] distance
    s_a: float = 0.3  # [1/rad] angle
    s_o: float = 0.1  # [1/rad] orient to goal
    s_c: float = 0.02  # [-] continuity
    s_fall: float = 10.0  # [-] the price of a fall; ours
    s_goal: float = 1.0  # [-] the prize for having arrived; ours
    s_time: float = 0.02  # [-] a double step; for ever: 0.02 / (1 − γ) = 1 with γ = 0.98; ours

# The observation: name, unit, low, high. d: distance to the goal, α: its orientation seen from the
# robot, β: the direction towards it seen from the robot (paper, Fig. 2); the encoding is ours.
GOAL_TABLE = (
    ("distance d, clipped", "m", 0.0, 3.0),
    ("x = d·cos β, zoomed and clipped", "0.5 m", -1.0, 1.0),
    ("y = d·sin β, zoomed and clipped", "0.5 m", -1.0, 1.0),
    ("cos β", "1", -1.0, 1.0),
    ("sin β", "1", -1.0, 1.0),
    ("cos α", "1", -1.0, 1.0),
    ("sin α", "1", -1.0, 1.0),
    ("α / π", "π rad", -1.0, 1.0),
)
# How the body moves now decides what it can do next; without a sensor, the last two actions tell.
ACTION_NAMES = tuple(f"{foot} {axis}" for foot in ("left", "right") for axis in ("x", "y", "yaw"))
PREVIOUS_TABLE = tuple((f"{name}, {ago}", "limits at ∓1", -1.0, 1.0)
                       for ago in ("last action", "action before") for name in ACTION_NAMES)
IMU_TABLE = (
    ("torso roll", "0.25 rad", -4.0, 4.0),
    ("torso pitch", "0.25 rad", -4.0, 4.0),
    *((f"angular velocity {axis}", "rad/s", -10.0, 10.0) for axis in "xyz"),
)
STREAMS = {"training": 1, "tuning": 2, "evaluation": 3}  # "tuning": of planners
PURPOSES = ("goal", "world", "noise", "imu", "kicks")  # own dice each; kicks: tests/studies
ENDS = ("success", "fall", "timeout", "time")  # what an environment tells of an ended episode

def observation_table(imu=False):
    """Rows (name, unit, low, high) of the observation, in order."""
    return GOAL_TABLE + PREVIOUS_TABLE + (IMU_TABLE if imu else ())

def stream(name, seed, *more):
    """A random generator of its own for every stream, seed, and number of a trial."""
    # + 1, because numpy takes (seed, 0) for the same as (seed).
    return np.random.default_rng([STREAMS[name], seed, *(number + 1 for number in more)])

def checked(name, value, *shape):
    """The value as an array of that shape; a one-line ValueError if it is not, or not finite."""
    try:
        array = np.asarray(value)
        right = array.dtype.kind in "biuf" and array.size and np.isfinite(array).all()
    except ValueError:  # lists of different lengths
        right = False
    if not right or array.shape != shape:
        text = " ".join(f"{value!r:.60}".split())
        raise ValueError(f"{name} must be finite numbers of shape {shape}, got {text}")
    return array.astype(float)

# ------------------------------------------------------------------------ goal, action, reward
def draw_goals(rng, count, task=Task(), far=False):
    """Goal poses [count, 3]: x, y [m], yaw [rad]. Goal i does not depend on `count`."""
    std = task.far_std_m if far else task.goal_std_m
    goals = rng.normal(size=(count, 3)) * (std, std, task.goal_std_rad)
    goals[:, 2] = wrap(goals[:, 2])
    return goals

def polar(goal):
    """d [m], α, β [rad], each [...], of goals seen from the robot, [..., 3] (x, y, yaw)."""
    x, y, yaw = np.moveaxis(goal, -1, 0)
    return np.hypot(x, y), wrap(yaw), np.arctan2(y, x)

def encode_goal(goal):
    """The eight numbers [..., 8] of GOAL_TABLE for goals seen from the robot [..., 3]."""
    d, alpha, beta = polar(goal)
    x, y = np.clip(2 * goal[..., 0], -1, 1), np.clip(2 * goal[..., 1], -1, 1)
    return np.stack([np.minimum(d, 3.0), x, y, np.cos(beta), np.sin(beta),
                     np.cos(alpha), np.sin(alpha), alpha / np.pi], -1)

def to_footsteps(action, limits):
    """Actions [..., 6] in [0, 1] as footsteps [..., 2, 3]: 0 is the lower limit, 1 the upper.

    A footstep that asks for too much at once is made smaller (`within` of stage 2).
    """
    share = np.reshape(action, (*np.shape(action)[:-1], 2, 3))
    asked = limits.low + share * np.subtract(limits.high, limits.low)
    return walk_engine.within(asked, limits)

def to_action(footsteps, limits):
    """The action [..., 6] of footsteps [..., 2, 3], clipped: inverts an unscaled `to_footsteps`."""
    share = (footsteps - np.array(limits.low)) / np.subtract(limits.high, limits.low)
    return np.clip(share, 0, 1).reshape(*share.shape[:-2], 6)

def reward_terms(before, after, action, last_action, fall, success, task=Task()):
    """The seven scaled terms, each [n]: r_d, r_a, r_o, r_c, r_fall, r_goal, r_time; their sum is
    the reward. Costs (a fall, a double step, a change of the steps) are negative.

    before, after [n, 3]: the goal seen from the robot around the double step; actions [n, 6] in
    [0, 1]. All formulas are ours. Distance, angle and orientation pay for progress: each is Φ′ − Φ
    of some quantity Φ. Added up without a discount, only the ends are left,
        Σ (Φ_{t+1} − Φ_t) = Φ_end − Φ_start,   so a circle pays nothing; with a discount γ < 1,
        Σ γᵗ·(Φ_{t+1} − Φ_t) = γᴷ·Φ_end − Φ_start + (1 − γ)·Σ γᵗ·Φ_{t+1},   t = 0 … K − 1:
    so the way counts, too: what is gained early weighs more than what is given back late. Look up:
    potential-based shaping (Ng, Harada, Russell, 1999); theirs, γ·Φ′ − Φ, does not change which
    policy is best.
    """
    d0, alpha0, beta0 = polar(before)
    d1, alpha1, beta1 = polar(after)
    near0, near1 = np.exp(-((d0 / task.near_m) ** 2)), np.exp(-((d1 / task.near_m) ** 2))
    return {
        # r_d = d − d′,  so Φ = −d
        "r_d": task.s_d * (d0 - d1),
        # r_a = |α|·near(d) − |α′|·near(d′),  near(d) = exp(−(d / 0.4 m)²);  Φ = −|α|·near(d)
        "r_a": task.s_a * (np.abs(alpha0) * near0 - np.abs(alpha1) * near1),
        # r_o = |β|·far(d) − |β′|·far(d′),  far(d) = 1 − near(d);  Φ = −|β|·far(d)
        "r_o": task.s_o * (np.abs(beta0) * (1 - near0) - np.abs(beta1) * (1 - near1)),
        # r_c = −Σ (action − last action)² over x and y of both feet, as actions in [0, 1]
        "r_c": task.s_c * -((action - last_action)[:, [0, 1, 3, 4]] ** 2).sum(-1),
        "r_fall": -task.s_fall * fall, "r_goal": task.s_goal * success,
        "r_time": np.full(len(d0), -task.s_time)}

# ------------------------------------------------------------------------ the world
@dataclass(frozen=True)
class View:
    """What n robots know when they decide, beside the measured goals; all of it is copied."""
    period: float  # [s] of a double step
    limits: walk_engine.StepLimits
    neutral_action: np.ndarray  # [6] step on the spot
    actions: np.ndarray  # [n, 2, 6] the last one, the one before
    observation: np.ndarray  # [n, 25] rows as in `observation_table`, the IMU's last

class FootstepWorld:
    """N robots on their way to N goals. `robots` are always the indices [n] of some of them.

    Every robot has a random generator of its own, and in every episode a child of it for each of
    PURPOSES: so N robots together do the same as each of them alone, and whatever a planner does,
    ground, body and noise stay the same.
    """
    def __init__(self, num_robots, sim="pymunk", noise=False, task=Task(), cores=None,
                 robot=robot_model.RobotModel(), spread=robot_model.Spread()):
        if sim not in list(walk_engine.LIMITS):  # a list: sim may be anything
            raise ValueError(f"sim must be {' or '.join(walk_engine.LIMITS)}, got {sim!r}")
        self.task, self.limits, self.spread = task, walk_engine.LIMITS[sim], spread
        self.noise = noise  # are goal and tilt measured with noise?
        self.engine = walk_engine.WalkEngine(num_robots, walk_engine.TUNED[sim], robot,
                                             planar=sim == "pymunk")
        self.sim = robot_model.make_sim(sim, num_robots, self.engine.stance, robot, cores)
        self.neutral_action = to_action(np.zeros((2, 3)), self.limits)  # [6] step on the spot
        self.rng = [np.random.default_rng() for _ in range(num_robots)]
        self.dice = [dict(zip(PURPOSES, rng.spawn(len(PURPOSES)))) for rng in self.rng]
        self.friction = np.zeros(num_robots)  # μ of the episode
        self.goal = np.zeros((num_robots, 3))
        self.pose = np.zeros((num_robots, 3))  # torso on the ground, true
        self.tilt = np.zeros((num_robots, 5))  # roll, pitch [rad], angular velocity [rad/s]
        self.actions = np.zeros((num_robots, 2, 6))  # the last one, the one before
        self.steps = np.zeros(num_robots, int)  # double steps of this episode
        self.inside = np.zeros(num_robots, bool)  # did the last one end at the goal?

    def reset(self, robots, rngs=(), goals=None, friction=np.nan):
        """Start episodes: standing at the origin; rngs and goals [n, 3]: new ones, if given.

        friction: μ instead of what is drawn, [n] or one for all; nan: as drawn.
        """
        robots = np.asarray(robots)
        if goals is not None:
            goals = np.clip(checked("goals", goals, len(robots), 3), -1e9, 1e9)  # no overflow
        friction = np.zeros(len(robots)) + friction
        if (friction < 0).any() or (friction > 100).any():
            raise ValueError(f"friction must be from 0 to 100, got {friction}")
        for i, rng in zip(robots, rngs or [self.rng[i] for i in robots]):
            self.rng[i], self.dice[i] = rng, dict(zip(PURPOSES, rng.spawn(len(PURPOSES))))
        if goals is None:  # each one is far with probability ½
            dice = [self.dice[i]["goal"] for i in robots]
            goals = [draw_goals(rng, 1, self.task, far=rng.random() < 0.5)[0] for rng in dice]
        body = self.spread.draw([self.dice[i]["world"] for i in robots], self.engine.robot)
        body.friction = np.where(np.isnan(friction), body.friction, friction)
        self.sim.reset(robots, body)
        self.engine.reset(robots)
        self.friction[robots], self.inside[robots] = body.friction, False
        self.goal[robots], self.pose[robots], self.steps[robots] = goals, 0, 0
        self.tilt[robots] = 0, self.engine.parameters.trunk_pitch, 0, 0, 0
        self.actions[robots] = self.neutral_action

    def relative_goal(self, robots):
        """The true goal seen from the robot [n, 3]: x, y [m], yaw [rad]."""
        return robot_model.relative(self.pose[robots], self.goal[robots])

    def measure(self, robots):
        """The goal as the robot measures it [n, 3]: with noise, drawn anew at every call."""
        goal = self.relative_goal(robots)
        if self.noise:
            scale = (self.task.noise_m, self.task.noise_m, self.task.noise_rad)
            goal = goal + np.array([self.dice[i]["noise"].normal(size=3) for i in robots]) * scale
        goal[:, 2] = wrap(goal[:, 2])
        return goal

    def observe(self, robots, measured, imu=False):
        """Observations [n, 20 or 25], float32, as in `observation_table`; measured goals [n, 3]."""
        parts = [encode_goal(measured), 2 * self.actions[robots].reshape(-1, 12) - 1]
        if imu:
            tilt, task = self.tilt[robots], self.task
            if self.noise:
                scale = (task.imu_rad,) * 2 + (task.imu_rad_s,) * 3
                tilt = tilt + np.array([self.dice[i]["imu"].normal(size=5) for i in robots]) * scale
            low, high = np.array([row[2:] for row in IMU_TABLE]).T
            parts.append(np.clip(tilt * [4, 4, 1, 1, 1], low, high))
        return np.concatenate(parts, -1).astype(np.float32)

    def view(self, robots, measured):
        """What a planner may know of these robots beside the measured goals [n, 3]."""
        return View(self.engine.period, self.limits, self.neutral_action.copy(),
                    self.actions[robots], self.observe(robots, measured, imu=True))

    def step(self, actions, robots):
        """One double step of these robots; actions [n, 6], clipped to [0, 1].

        Returns a dict of arrays [n]: success, fall, timeout, inside (the goal's tolerance; all
        bool), time [s], reward, and reward_terms by name; and the simulator's Motion. The time of a
        success is that of the first of the two double steps that ended inside.
        """
        actions = np.clip(checked("actions", actions, len(robots), 6), 0, 1)
        before, last = self.relative_goal(robots), self.actions[robots, 0]
        trajectory, _ = self.engine.plan(to_footsteps(actions, self.limits), robots)
        motion = self.sim.run(trajectory, robots)
        self.pose[robots] = motion.torso[:, -1, [0, 1, 5]]
        self.tilt[robots] = np.concatenate([motion.torso[:, -1, 3:5], motion.spin], -1)
        self.actions[robots, 1], self.actions[robots, 0] = last, actions
        self.steps[robots] += 1
        after = self.relative_goal(robots)
        d, alpha, _ = polar(after)
        inside = (d <= self.task.success_m) & (np.abs(alpha) <= self.task.success_rad)
        inside &= ~motion.fell  # a fall wins
        success = inside & self.inside[robots]  # twice in a row
        self.inside[robots] = inside
        seconds = self.steps[robots] * self.engine.period
        # No double step may end after the time limit: is there room for one more?
        late = seconds + self.engine.period > self.task.time_limit + 1e-9
        timeout = late & ~success & ~motion.fell
        terms = reward_terms(before, after, actions, last, motion.fell, success, self.task)
        return {"success": success, "fall": motion.fell, "timeout": timeout, "inside": inside,
                "time": seconds - success * self.engine.period,
                "reward": sum(terms.values()), "reward_terms": terms, "motion": motion}

    def close(self):  # the simulator's threads or processes
        self.sim.close()

def fingerprint(sim, imu=False):
    """What a policy was made for, in plain values; it is stored with the policy."""
    return {"simulator": sim, "observation": [row[0] for row in observation_table(imu)],
            "step limits": asdict(walk_engine.LIMITS[sim]),
            "walk parameters": asdict(walk_engine.TUNED[sim])}

# ------------------------------------------------------------------------ Gymnasium
def spaces(imu):
    """Observation and action space of one robot."""
    low, high = np.array([row[2:] for row in observation_table(imu)], np.float32).T
    return gym.spaces.Box(low, high), gym.spaces.Box(0.0, 1.0, (6,), np.float32)

class FootstepVectorEnv(gym.vector.VectorEnv):
    """N independent episodes in one call. A finished one starts anew in the SAME step:
    `step` returns the first observation of the new episode, and the last one of the old episode in
    `infos["final_obs"]`. Stage 4 needs that one: what would have followed a truncated episode is
    estimated ("bootstrapped") from there. infos["_final_obs"][i] says whether robot i's has ended.
    (The planar robots live in processes: call it below `if __name__ == "__main__":`.)
    """
    metadata = {"autoreset_mode": gym.vector.AutoresetMode.SAME_STEP, "render_modes": []}

    def __init__(self, num_envs=64, sim="pymunk", noise=False, imu=False, **settings):
        self.num_envs, self.imu = num_envs, imu
        self.single_observation_space, self.single_action_space = singles = spaces(imu)
        self.observation_space, self.action_space = (
            gym.vector.utils.batch_space(space, num_envs) for space in singles)
        self.world = FootstepWorld(num_envs, sim, noise, **settings)
        self.neutral_action = self.world.neutral_action
        self._everybody = np.arange(num_envs)

    def _observe(self, robots):
        return self.world.observe(robots, self.world.measure(robots), self.imu)

    def reset(self, *, seed=None, options=None):
        """New episodes; robot i gets the seed + i. options["goals"] [N, 3] sets the goals."""
        seeds = () if seed is None else range(int(seed), int(seed) + self.num_envs)
        rngs = [stream("training", number) for number in seeds]
        self.world.reset(self._everybody, rngs, (options or {}).get("goals"))
        return self._observe(self._everybody), {}

    def step(self, actions):
        """See `FootstepWorld.step`; infos hold the reward terms, and final_obs, final_info."""
        result = self.world.step(actions, self._everybody)
        terminated, truncated = result["success"] | result["fall"], result["timeout"]
        observations, done = self._observe(self._everybody), terminated | truncated
        infos, ended = {"reward_terms": result["reward_terms"]}, np.flatnonzero(done)
        if len(ended):
            final = {key: result[key] for key in ENDS}
            infos |= {"final_obs": observations.copy(), "_final_obs": done, "_final_info": done,
                      "final_info": {**final, **{f"_{key}": done for key in ENDS}}}
            self.world.reset(ended)
            observations[ended] = self._observe(ended)
        return observations, result["reward"], terminated, truncated, infos

    def close_extras(self, **_):  # called once by `close`
        self.world.close()

class FootstepEnv(gym.Env):
    """One robot; the same world with N = 1."""
    def __init__(self, sim="pymunk", noise=False, imu=False, **settings):
        self.observation_space, self.action_space = spaces(imu)
        self.imu, self.world = imu, FootstepWorld(1, sim, noise, cores=1, **settings)

    def _observe(self):
        return self.world.observe([0], self.world.measure([0]), self.imu)[0]

    def reset(self, *, seed=None, options=None):
        """A new episode; options["goal"] = (x, y, yaw) sets its goal."""
        goal = (options or {}).get("goal")
        goals = None if goal is None else checked("goal", goal, 3)[None]
        if seed is not None:  # the generator that robot 0 of the vector environment has
            self.np_random, self._np_random_seed = stream("training", seed), seed
        self.world.reset([0], [self.np_random], goals)
        return self._observe(), {}

    def step(self, action):
        """One double step; the info holds the reward terms and how the episode ended."""
        result = self.world.step(checked("action", action, 6)[None], [0])
        info = {key: result[key][0] for key in ENDS}
        info["reward_terms"] = {name: float(r[0]) for name, r in result["reward_terms"].items()}
        terminated, truncated = bool(info["success"] or info["fall"]), bool(info["timeout"])
        return self._observe(), float(result["reward"][0]), terminated, truncated, info

    def close(self):
        self.world.close()

gym.register("Footsteps-v0", entry_point=FootstepEnv, vector_entry_point=FootstepVectorEnv)

# ------------------------------------------------------------------------ demonstration
def hand_written(measured, limits):
    """A planner: walk to the goal, facing it while far, turning as it is turned when near.

    It knows nothing about dynamics and takes at most half of what the limits allow.
    Goals as measured [n, 3] -> actions [n, 6].
    """
    d, alpha, beta = polar(measured)
    turn = np.where(d > 0.5, beta, alpha)  # [n] where to look; from half a metre on: our choice
    low, high = np.array([limits.low, limits.high]) / 2
    footsteps = np.zeros((len(measured), 2, 3))
    # Both feet share the way forward. Sideways only the leading foot steps, outward. A turn is
    # outward for one foot, inward for the other: the smaller limit, low (inward), counts for both.
    footsteps[:, :, 0] = np.clip(measured[:, 0] / 2, low[0], high[0])[:, None]
    footsteps[:, 0, 1] = np.clip(measured[:, 1], 0, high[1])
    footsteps[:, 1, 1] = np.clip(-measured[:, 1], 0, high[1])
    footsteps[:, :, 2] = np.clip(turn / 2, low[2], -low[2])[:, None] * walk_engine.MIRROR[:, 2]
    return to_action(footsteps, limits)

def main():
    parser = robot_model.StageParser(__doc__)
    parser.add_argument("--imu", action="store_true", help="tilt and angular velocity observed too")
    args = parser.parse()
    out, limits = parser.folder(args), walk_engine.LIMITS[args.sim]
    print(f"{'observation':32s} {'unit':>22s} {'low':>7s} {'high':>7s}")
    for name, unit, low, high in observation_table(args.imu):
        print(f"{name:32s} {unit:>22s} {low:7.1f} {high:7.1f}")
    print(f"\n{'action (outward is positive)':32s} {'unit':>22s} {'0 is':>7s} {'1 is':>7s}")
    for row in zip(ACTION_NAMES, ("m", "m", "rad") * 2, limits.low * 2, limits.high * 2):
        print("{:32s} {:>22s} {:7.2f} {:7.2f}".format(*row))

    envs = FootstepVectorEnv(64, args.sim, imu=args.imu)
    dice = stream("training", args.seed, 0)
    planners = {"random": lambda goals, limits: dice.random((len(goals), 6)),
                "hand-written": hand_written}
    print(f"\n64 robots, 60 double steps ({60 * envs.world.engine.period:.0f} s) each")
    for planner, act in planners.items():
        envs.reset(seed=args.seed)
        rows = [envs.step(act(envs.world.measure(np.arange(64)), limits))[-1]["reward_terms"]
                for _ in range(60)]
        paid = {name: np.array([row[name] for row in rows]) for name in rows[0]}  # [60, 64] each
        goals, falls = (paid["r_goal"] > 0).sum(), (paid["r_fall"] < 0).sum()
        print(f"{planner:13s}: {goals} episodes at the goal, {falls} falls")
    envs.close()
    figure, axis = plt.subplots(figsize=(8, 4), layout="constrained")
    words = "distance", "angle", "orient to goal", "continuity", "fall", "goal", "time"
    for (name, r), word, style in zip(paid.items(), words, ("-", "--", ":", "-.", "x", "o-", "+")):
        axis.plot(range(1, 61), r[:, 0].cumsum(), style, markevery=5, label=f"{name}: {word}")
    axis.set(title=f"What each reward has paid robot 0, hand-written planner ({args.sim})",
             xlabel="double step (several episodes)", ylabel="sum of rewards so far [1]")
    axis.legend(ncols=2)
    axis.grid(alpha=0.3)
    robot_model.atomic_write(out / "03_rewards.png", lambda file: figure.savefig(file, dpi=110))
    print("Look at", out / "03_rewards.png")

if __name__ == "__main__":
    robot_model.run(main)
