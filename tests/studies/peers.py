"""Does another implementation of PPO learn the same? Stable-Baselines3 on the same robots.

    python -m pip install stable-baselines3==2.9.2
    python tests/studies/peers.py [--mujoco] [--out FOLDER]

If ours is right, the ranges of their seeds overlap. (Two equal ones fail that in one case of ten.)
"""

from dataclasses import replace
from functools import partial
from time import perf_counter
from types import SimpleNamespace

import ablations
import common
import numpy as np
from common import FEW, env, evaluate, ppo, robot_model

try:
    import stable_baselines3
    from stable_baselines3.common.vec_env import VecEnv
except ImportError:  # `study_sb3` says so
    stable_baselines3, VecEnv = None, object

torch = ppo.torch
DURATION = "10 minutes on two cores; 3-D: 20"
STEPS = ablations.STEPS  # double steps of a training
CFG = replace(ppo.PPOConfig(), sharpest=1.0)
UPDATE = CFG.num_envs * CFG.rollout  # double steps
LOG_STD = float(-0.5 * np.log(4 * (CFG.first_concentration + 1)))  # as in `GaussianActor`


def row_of(kind, seed, begin, decide, sim):
    """The row of a training; decide: observations [n, 20] -> actions [n, 6]."""
    seconds = round(perf_counter() - begin, 1)
    planner = evaluate.PolicyPlanner(SimpleNamespace(decide=decide, shape={"obs_dim": 20}))
    return {"kind": kind, "seed": seed, "seconds": seconds, **ablations.judged(planner, sim)}


class SameRobots(VecEnv):
    """Our vector environment as theirs: a list of infos, the last observation among them."""

    def __init__(self, envs):
        self.envs = envs
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def reset(self):
        return self.envs.reset(seed=self._seeds[0])[0]

    def step_async(self, actions):
        self.actions = actions

    def step_wait(self):
        obs, reward, terminated, truncated, info = self.envs.step(self.actions)
        infos = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(terminated | truncated):
            infos[i] = {
                "terminal_observation": info["final_obs"][i],
                "TimeLimit.truncated": bool(truncated[i]),
            }
        return obs, reward.astype(np.float32), terminated | truncated, infos

    def close(self):
        self.envs.close()

    def get_attr(self, attr_name, indices=None):
        return [None for _ in self._get_indices(indices)]  # the render_mode

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False for _ in self._get_indices(indices)]

    set_attr = env_method = None  # are not called


def ours(sim, seed):
    """One training of stage 04: its row."""
    begin, folder = perf_counter(), common.work(sim, "peers", str(seed))
    make_envs = partial(env.FootstepVectorEnv, sim=sim, noise=True, staggered=True)
    model, _ = ppo.train(CFG, make_envs, folder, STEPS, seed, make_model=ablations.GaussianActor)
    return row_of("ours, Gaussian", seed, begin, model.decide, sim)


def theirs(sim, seed):
    """The same by Stable-Baselines3."""
    torch.set_num_threads(1)  # as in stage 04
    begin, updates, hidden = perf_counter(), -(-STEPS // UPDATE), list(CFG.hidden)
    envs = SameRobots(env.FootstepVectorEnv(CFG.num_envs, sim, noise=True, staggered=True))
    model = stable_baselines3.PPO(
        "MlpPolicy",
        envs,
        n_steps=CFG.rollout,
        batch_size=CFG.minibatch,
        n_epochs=CFG.epochs,
        learning_rate=lambda left: CFG.learning_rate * (left + 1 / updates),  # left: after it
        gamma=CFG.gamma,
        gae_lambda=CFG.lam,
        clip_range=CFG.clip,
        vf_coef=CFG.value_coef,
        max_grad_norm=CFG.max_grad_norm,
        device="cpu",
        seed=ppo.random_seed(seed) % 2**31,  # near seeds would share most of their robots' worlds
        policy_kwargs={
            "net_arch": {"pi": hidden, "vf": hidden},
            "activation_fn": torch.nn.Tanh,
            "log_std_init": LOG_STD,
        },
    )
    model.policy.action_net.bias.data.copy_(torch.as_tensor(envs.envs.neutral_action))
    model.learn(updates * UPDATE)
    envs.close()
    # Its prediction is the mean of the normal distribution, clipped.
    return row_of(
        "SB3, the same robots",
        seed,
        begin,
        lambda obs: model.predict(obs, deterministic=True)[0],
        sim,
    )


def study_sb3(args):
    """Seed by seed, so that a machine that slows down slows both."""
    if stable_baselines3 is None:
        raise robot_model.InputError("first: python -m pip install stable-baselines3==2.9.2")
    return {"rows": [learn(args.sim, seed) for seed in FEW for learn in (ours, theirs)]}


PARTS = {"sb3": study_sb3}


def table(found, sim):
    """All trainings."""
    columns = {"kind": 0, "seed": 0, "success": 3, "fall": 3, "time_mean": 2, "seconds": 0}
    return common.sections(found, {"sb3": columns})


def found(data):
    """Sentences by name, from the numbers of both simulators."""
    ours, theirs = (
        common.values(data["mujoco"]["sb3"]["rows"], "time_mean", kind=kind)
        for kind in ("ours, Gaussian", "SB3, the same robots")
    )
    return {
        "times": f"In 3-D our walks take {np.mean(ours):.1f} s (three seeds: {min(ours):.1f} to "
        f"{max(ours):.1f} s) and those of Stable-Baselines3 {np.mean(theirs):.1f} s "
        f"({min(theirs):.1f} to {max(theirs):.1f} s). Both arrive in all walks. On the same robots "
        "both trainings last as long."
    }


if __name__ == "__main__":
    common.start("peers")
