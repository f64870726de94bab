"""Does another implementation of PPO compute the same? One update by Stable-Baselines3, one by us.

    python -m pip install stable-baselines3==2.9.2
    python tests/studies/peers.py [--out FOLDER]

Both get the same network (a Gaussian policy, as Stable-Baselines3 has no Beta policy), and the same
rollout in an environment of random numbers, in which episodes end and are cut off by chance. Compared
are the advantages, and all weights after ten epochs. A minibatch holds the whole rollout, so its
order does not matter.
"""

from dataclasses import replace

import ablations
import common
import gymnasium as gym
import numpy as np
from common import ppo, robot_model

torch = ppo.torch
DURATION = "seconds"
ROBOTS, STEPS, SEEN, ACTS = 64, 16, 20, 6  # shape of the rollout, of observations and actions
CFG = replace(ppo.PPOConfig(), minibatch=ROBOTS * STEPS)


class Chance(gym.Env):
    """Random observations and rewards. `seen` holds a row for every step."""

    observation_space = gym.spaces.Box(-np.inf, np.inf, (SEEN,))
    action_space = gym.spaces.Box(0, 1, (ACTS,))

    def __init__(self):
        self.seen = []

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.obs = self.np_random.normal(size=SEEN).astype(np.float32)
        return self.obs, {}

    def step(self, action):
        obs, self.obs = self.obs, self.np_random.normal(size=SEEN).astype(np.float32)
        reward, ends = self.np_random.normal(), self.np_random.random(2) < 0.1
        row = {"obs": obs, "next_obs": self.obs, "reward": np.float32(reward)}
        self.seen.append(row | {"terminated": ends[0], "truncated": ends[1]})
        return self.obs, reward, *map(bool, ends), {}


def study_exact(args):
    """How much advantages and weights differ, and how much they vary or move."""
    try:
        from stable_baselines3 import PPO
        from stable_baselines3.common.env_util import make_vec_env
        from stable_baselines3.common.logger import Logger
    except ImportError as error:
        raise robot_model.InputError(
            "first: python -m pip install stable-baselines3==2.9.2"
        ) from error
    envs = make_vec_env(Chance, ROBOTS, args.seed)
    theirs = PPO(
        "MlpPolicy",
        envs,
        n_steps=STEPS,
        batch_size=CFG.minibatch,
        n_epochs=CFG.epochs,
        learning_rate=CFG.learning_rate,
        gamma=CFG.gamma,
        gae_lambda=CFG.lam,
        clip_range=CFG.clip,
        vf_coef=CFG.value_coef,
        max_grad_norm=CFG.max_grad_norm,
        device="cpu",
        seed=args.seed,
        policy_kwargs={"net_arch": [*CFG.hidden], "activation_fn": torch.nn.Tanh},
    )
    model = ablations.GaussianActor(SEEN, ACTS, CFG.hidden, 0.5, CFG.first_concentration)
    policy = theirs.policy
    hidden = policy.mlp_extractor
    networks = hidden.policy_net, policy.action_net, hidden.value_net, policy.value_net
    others = [policy.log_std, *(weights for part in networks for weights in part.parameters())]
    pairs = [*zip(model.parameters(), others, strict=True)]  # log σ, actor, critic
    first = [other.detach().clone() for other in others]
    for (ours, _), weights in zip(pairs, first):
        ours.data.copy_(weights)
    _, callback = theirs._setup_learn(CFG.minibatch)
    buffer = theirs.rollout_buffer
    theirs.collect_rollouts(envs, callback, buffer, STEPS)  # actions, advantages
    seen = [*zip(*(env.unwrapped.seen for env in envs.envs))]  # [T][N]
    data = {
        name: torch.as_tensor(np.array([[row[name] for row in rows] for rows in seen]))
        for name in seen[0][0]
    }
    data["action"] = torch.as_tensor(buffer.actions)  # [T, N, ACTS]
    advantages, _, _ = ppo.advantages_and_targets(model, data, CFG)
    off = np.abs(advantages.numpy() - buffer.advantages.ravel())
    optimizer = torch.optim.Adam(model.parameters(), CFG.learning_rate, eps=1e-5)
    ppo.improve(model, optimizer, data, CFG)
    theirs.set_logger(Logger(None, []))
    theirs.train()
    with torch.no_grad():
        moved = max((ours - weights).abs().max().item() for (ours, _), weights in zip(pairs, first))
        apart = max((ours - other).abs().max().item() for ours, other in pairs)
    row = {"cut_off": int(data["truncated"].sum()), "advantages_differ": float(off.max())}
    row |= {"they_vary_by": advantages.std().item(), "weights_differ": apart, "they_move_by": moved}
    return [row]


PARTS = {"exact": study_exact}


COLUMNS = {
    "exact": {"cut_off": 0, "advantages_differ": 8, "they_vary_by": 2}
    | {"weights_differ": 8, "they_move_by": 4}
}


if __name__ == "__main__":
    common.start("peers")
