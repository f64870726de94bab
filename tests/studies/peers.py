"""How does the PPO of Stable-Baselines3, with which the paper trained, learn in this world?

    python -m pip install stable-baselines3==2.9.2
    python tests/studies/peers.py [--mujoco] [--out FOLDER]

`Footsteps` is our vector environment as a VecEnv of Stable-Baselines3: all robots walk in one call. (One
robot an environment, as `gymnasium.make` gives it, takes six times as long.) Its PPO trains with the
settings of stage 4, but with a Gaussian policy, because it has no Beta policy. Both learn with three
seeds, for as long as the trainings of `ladder.py`, which ours are.
"""

import common
import gymnasium as gym
import ladder
import numpy as np
from common import env, ppo, robot_model

try:
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecEnv
except ImportError:  # said when a training starts
    PPO, VecEnv, BaseCallback = None, object, object

TICKS = 4, 6, 10, 20, 40, 100  # [s]
DURATION = "on one core: 25 minutes; 3-D: two hours"
CFG = ppo.PPOConfig()


class Footsteps(VecEnv):
    """N robots; actions in [−1, 1]. The other arguments are those of `FootstepVectorEnv`."""

    def __init__(self, num_envs, **settings):
        self.envs = env.FootstepVectorEnv(num_envs, **settings)
        actions = gym.spaces.Box(-1, 1, self.envs.single_action_space.shape)
        super().__init__(num_envs, self.envs.single_observation_space, actions)

    def reset(self):
        seed, self._seeds = self._seeds[0], [None] * self.num_envs  # of `seed`, for one reset
        return self.envs.reset(seed=seed)[0]

    def step_async(self, actions):
        self.actions = (actions + 1) / 2

    def step_wait(self):
        obs, reward, terminated, truncated, infos = self.envs.step(self.actions)
        told = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(terminated | truncated):
            final = {key: infos["final_info"][key][i] for key in ("success", "time")}
            last = {"terminal_observation": infos["final_obs"][i]}
            told[i] = last | final | {"TimeLimit.truncated": truncated[i] and not terminated[i]}
        return obs, reward.astype(np.float32), terminated | truncated, told

    def get_attr(self, name, indices=None):
        return [getattr(self.envs, name)] * self.num_envs

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False] * self.num_envs

    def close(self):
        self.envs.close()

    set_attr = env_method = None  # there is no environment of a single robot


class Log(BaseCallback):
    """How long the walks of every rollout took that arrived: rows as in learning_curve.csv."""

    def _on_training_start(self):
        self.rows, self.times = [], []

    def _on_step(self):
        self.times += [info["time"] for info in self.locals["infos"] if info and info["success"]]
        return True

    def _on_rollout_end(self):
        if self.times:
            self.rows.append({"steps": self.num_timesteps, "time": np.mean(self.times)})
        self.times = []


class Planner:
    """Walks as the policy of a PPO of Stable-Baselines3 says."""

    def __init__(self, model):
        self.model = model

    def reset(self, num_robots):
        """It remembers nothing."""

    def act(self, view):
        return (self.model.predict(view.observation, deterministic=True)[0] + 1) / 2


def train(sim, seed, steps):
    """A PPO of Stable-Baselines3, trained with the settings of stage 4, and the rows of its log."""
    if PPO is None:
        raise robot_model.InputError("python -m pip install stable-baselines3==2.9.2")
    model = PPO(
        "MlpPolicy",
        Footsteps(CFG.num_envs, sim=sim, noise=True),
        n_steps=CFG.rollout,
        batch_size=CFG.minibatch,
        n_epochs=CFG.epochs,
        learning_rate=lambda left: left * CFG.learning_rate,  # left: from 1 to 0
        gamma=CFG.gamma,
        gae_lambda=CFG.lam,
        clip_range=CFG.clip,
        vf_coef=CFG.value_coef,
        max_grad_norm=CFG.max_grad_norm,
        seed=seed,
        device="cpu",
        # As wide as the first Beta: of [0, 1] 0.5/√(c + 1), of [−1, 1] twice as much
        policy_kwargs={
            "net_arch": [*CFG.hidden],
            "log_std_init": -0.5 * np.log(CFG.first_concentration + 1),
        },
    )
    log = Log()
    with ppo.one_thread():
        model.learn(steps, log, progress_bar=False)
    return model, log.rows


def study_training(args):
    """Rows of all policies, and how long the walks took in each training."""
    planners, logs = {}, []
    for seed in range(3):
        model, log = train(args.sim, seed, ladder.STEPS[args.sim])
        ours = ladder.learn(args.sim, "without nothing", seed)
        planners |= {f"Stable-Baselines3, seed {seed}": Planner(model), f"ours, seed {seed}": ours}
        path = common.work(args.sim, "ladder", f"without nothing_{seed}") / "learning_curve.csv"
        curve = np.genfromtxt(path, delimiter=",", names=True)
        arrived = curve[curve["time"] == curve["time"]]  # before, it is nan
        for name, rows in {"Stable-Baselines3": log, "ours": arrived}.items():
            curve = {key: [row[key] for row in rows] for key in ("steps", "time")}
            logs.append({"learner": name, "seed": seed} | curve)
    near, far = (common.measured(args.sim, planners, far, 1, 140, {}) for far in common.STD)
    return {"rows": near + far, "logs": logs}


PARTS = {"training": study_training}
COLUMNS = {"training": {"planner": 0, ("falls", "goal_std_m"): 0, ("time_mean", "goal_std_m"): 2}}


def plot(found, sim):
    """How the time to the goal falls."""
    figure, axes = common.subplots(figsize=(8, 4))
    for name, look in {"ours": "purple", "Stable-Baselines3": "k--"}.items():
        for log in common.pick(found["training"]["logs"], learner=name):
            (line,) = axes.plot(np.divide(log["steps"], 1000), log["time"], look)
        line.set_label(name)
    axes.set(xlabel="double steps [thousands]", ylabel="time to the goal [s]", yscale="log")
    axes.set_yticks(TICKS, TICKS)
    axes.minorticks_off()
    axes.set_title("PPO of stage 4 and of Stable-Baselines3, the same settings")
    axes.legend(loc="upper right")
    return figure


PICTURES = {"peers": ("training", plot)}


if __name__ == "__main__":
    common.start("peers")
