"""Stage 4: how does the robot learn which footsteps to take? By trying, with PPO.

Covers: section II of the paper, "Policy" (two hidden layers of 64 neurons, a Beta distribution for
each action variable) and the training with PPO. The paper used Stable-Baselines3; here it is
written out, so that every equation has a line to point at. One departure: without exploring, the
paper acts by the distribution's mode, we half-way between mode and mean (see `beta_decision`).

    python 04_ppo.py                 500,000 double steps of the planar robot (pymunk)
    python 04_ppo.py --mujoco        the same in 3-D
    python 04_ppo.py --quick         60,000 of them, a lesson, written to runs/<sim>/quick/
    python 04_ppo.py --resume        continue after Ctrl-C: the same policy, bit for bit
    python 04_ppo.py --env Pendulum-v1 --steps 150000     any environment with a bounded Box action

Expect: a progress bar on which the success rate rises and the fall rate sinks; then policy.pt,
learning_curve.csv and learning_curve.png in runs/<sim>/. The goal is measured with noise, as in
stage 05's harder rows (--no-noise: exactly). The paper took 1,000,000 steps. On two cores
(2026-11-21, seed 0; `tests/studies.py budget`) --steps 300000 takes 3.4 minutes on pymunk and 5.0
in MuJoCo, 0.07 ms per step for learning, the rest simulation. --quick takes 45 seconds on pymunk;
its policy reaches the goals, too, but needs about three times as long as the shipped one.

The Pendulum command takes 20 seconds; its deterministic policy then returns −169, −172, −167 with
--seed 0, 1, 2 (mean of 100 episodes; an untrained one about −1200).

The loop. (1) Collect: N robots take T steps each, with actions drawn from the policy's
distribution. (2) Judge: was an action better than the critic expected? That is its advantage A_t.
(3) Improve: make good actions more likely and bad ones less; what changes an action's probability
by more than 20 % earns nothing more until new experience is collected. Repeat.

A cut-off and a fall both end an episode, but they do not mean the same. After a fall (terminated)
there is no future: the sum of the later rewards is 0, and that is the truth; at the goal
likewise. After a cut-off (truncated: the time is up) the world would have gone on; only our
recording stopped. Putting 0 there would tell the critic that walking well at 99 s is worth as
little as lying on the ground. So we ask the critic what would have followed: the missing sum is
replaced by V of the LAST observation of that episode ("bootstrapping"), not by V of the next
episode's first one. The end of a rollout in the middle of an episode is treated the same way.

Leaves out: observation normalisation, value clipping, early stopping at a large KL, recurrent
policies, GPUs.
"""

import argparse
import json
import os
import shutil
import sys
import time
from dataclasses import asdict, dataclass
from importlib import import_module  # `import 03_env`: a name may not start with a digit
from itertools import pairwise
from pathlib import Path

import gymnasium as gym
import matplotlib
import numpy as np
import torch
from torch import nn
from torch.nn.functional import softplus
from tqdm import tqdm

matplotlib.use("Agg")  # draws into files, needs no screen
import matplotlib.pyplot as plt

SAME_STEP = gym.vector.AutoresetMode.SAME_STEP  # the step that ends an episode resets it, too
OUTCOMES = ("success", "fall", "timeout", "time")  # what an environment may report at the end
STEPS, QUICK_STEPS = 500_000, 60_000  # double steps of a training
MEAN_SHARE = 0.5  # [-] of the mean, the rest is the mode, in a decision; tuned
COLUMNS = ("steps", "minutes", "return", "length", *OUTCOMES, "entropy", "clip_fraction",
           "approx_kl", "explained_variance", "value_loss", "learning_rate",
           "learning_ms")  # wall-clock of everything but simulation, per step


@dataclass(frozen=True)
class PPOConfig:
    """Sources: [P] the paper, [PPO] arXiv 1707.06347, [SB3] its default, [own] our choice."""

    num_envs: int = 64  # N, robots that walk at the same time [own]
    rollout: int = 64  # T, double steps of each robot between two updates [own]
    epochs: int = 10  # how often every sample is used [SB3]
    minibatch: int = 512  # samples per gradient step; divides N·T [own]
    learning_rate: float = 1e-3  # of Adam at the start; falls linearly to 0 [own]
    gamma: float = 0.98  # γ, discount per double step: looks about 1/(1−γ) = 50 ahead [own]
    lam: float = 0.95  # λ, 0: trust the critic, 1: trust the sampled return [SB3]
    clip: float = 0.2  # ε, how far the ratio new/old probability is rewarded to move [PPO]
    value_coef: float = 0.5  # weight of the critic's loss [SB3]
    entropy_coef: float = 0.0  # weight of the entropy bonus; falls linearly to 0 [SB3]
    max_grad_norm: float = 0.5  # longer gradients are scaled down to this length [SB3]
    hidden: tuple[int, int] = (64, 64)  # neurons per hidden layer [P]
    distribution: str = "beta"  # "beta" [P], or "gaussian" for comparison
    first_concentration: float = 10.0  # α+β of the first policy, > 2; larger: explores less [own]
    reward_scale: float = 1.0  # multiplies the reward the learner sees, not the one logged [own]
    checkpoint_every: int = 10  # [updates] between two points to resume from [own]

    def __post_init__(self):
        if self.num_envs * self.rollout % self.minibatch:
            raise ValueError(f"minibatch {self.minibatch} does not divide num_envs · rollout = "
                             f"{self.num_envs * self.rollout}")


PRESETS = {  # settings for other environments
    "Pendulum-v1": {"num_envs": 16, "rollout": 128, "minibatch": 256, "gamma": 0.95,
                    "reward_scale": 0.1},  # γ: a step is only 0.05 s here
}


# ---------------------------------------------------------------- the equations of PPO
def gae(rewards, values, next_values, terminated, truncated, gamma, lam):
    """Advantages A_t; everything [T, N]. next_values[t] is V of what really followed step t."""
    # δ_t = r_t + γ·(1 − terminated_t)·V(s'_t) − V(s_t)
    bootstrap = torch.where(terminated, torch.zeros_like(next_values), next_values)
    deltas = rewards + gamma * bootstrap - values
    # A_t = δ_t + γ·λ·A_{t+1} within one episode: the sum stops at a fall AND at a cut-off
    goes_on = 1.0 - (terminated | truncated).to(rewards.dtype)
    advantages = torch.zeros_like(rewards)
    following = torch.zeros_like(rewards[0])  # [N]
    for t in reversed(range(len(rewards))):
        following = deltas[t] + gamma * lam * goes_on[t] * following
        advantages[t] = following
    return advantages


def clipped_objective(ratio, advantage, clip):
    """Per sample, to be maximised; ratio ρ = π_new(a|s) / π_old(a|s)."""
    # L = min(ρ·A, clip(ρ, 1 − ε, 1 + ε)·A)
    return torch.min(ratio * advantage, ratio.clamp(1.0 - clip, 1.0 + clip) * advantage)


def value_loss(values, returns):
    """Mean squared error of the critic's predictions; both [B]."""
    # L_V = mean (V(s_t) − R_t)²   with R_t = A_t + V_old(s_t)
    return ((values - returns) ** 2).mean()


def approx_kl(log_ratio):
    """How far the policy moved [nats]; never negative (Schulman's k3 estimator)."""
    # KL(old‖new) ≈ mean (ρ − 1 − ln ρ)
    return (torch.expm1(log_ratio) - log_ratio).mean()


def clip_fraction(ratio, clip):
    """Share of the samples whose ratio left [1 − ε, 1 + ε]; 0.1 to 0.3 is healthy."""
    return ((ratio - 1.0).abs() > clip).to(ratio.dtype).mean()


def explained_variance(values, returns):
    """1: the critic predicts every return, 0: no better than their mean; nan if all are equal."""
    # EV = 1 − Var[R − V] / Var[R]
    variance = returns.var()
    return 1.0 - (returns - values).var() / variance if variance > 0 else variance * torch.nan


# ---------------------------------------------------------------- the Beta distribution on [0, 1]
def log_beta_function(alpha, beta):
    """Logarithm of the Beta function, which norms the density; elementwise."""
    # ln B(α, β) = ln Γ(α) + ln Γ(β) − ln Γ(α + β)
    return torch.lgamma(alpha) + torch.lgamma(beta) - torch.lgamma(alpha + beta)


def beta_log_prob(x, alpha, beta):
    """Log-density of independent variables [..., k] -> [...]."""
    # ln p(x) = (α−1)·ln x + (β−1)·ln(1−x) − ln B(α, β), summed over the action
    log_p = (alpha - 1) * torch.log(x) + (beta - 1) * torch.log1p(-x)
    return (log_p - log_beta_function(alpha, beta)).sum(-1)


def beta_entropy(alpha, beta):
    """[..., k] -> [...]; 0 for the uniform distribution, negative for every other one."""
    # H = ln B(α, β) − (α−1)·ψ(α) − (β−1)·ψ(β) + (α+β−2)·ψ(α+β)
    psi = torch.digamma
    return (log_beta_function(alpha, beta) - (alpha - 1) * psi(alpha) - (beta - 1) * psi(beta)
            + (alpha + beta - 2) * psi(alpha + beta)).sum(-1)


def beta_mode(alpha, beta):
    """The maximum of the density; 0.5 where it is flat (α = β = 1, where the formula is 0/0)."""
    # mode = (α − 1) / (α + β − 2)
    tiny = 1e-8
    return (alpha - 1 + tiny) / (alpha + beta - 2 + 2 * tiny)


def beta_decision(alpha, beta, share=MEAN_SHARE):
    """What to do when it counts [..., k]: between the mode (share 0) and the mean (share 1).

    The paper takes the mode. But the training rewards what the samples do, and near a limit the
    mode is far from most of them: with α = 1.1, β = 3 it is 0.05, the mean of the samples 0.27. A
    policy that masters a manoeuvre while exploring may fall over its mode; its mean is slower.
    """
    # a = (1 − share)·mode + share·mean,  mean = α / (α + β)
    return (1 - share) * beta_mode(alpha, beta) + share * alpha / (alpha + beta)


# ---------------------------------------------------------------- the networks
def mlp(sizes, last_gain):
    """Linear layers with tanh between them; orthogonal weights keep the length of the signal."""
    layers = []
    for inputs, outputs in pairwise(sizes):
        linear = nn.Linear(inputs, outputs)
        nn.init.orthogonal_(linear.weight, 2**0.5)
        nn.init.zeros_(linear.bias)
        layers += [linear, nn.Tanh()]
    nn.init.orthogonal_(linear.weight, last_gain)
    return nn.Sequential(*layers[:-1])


class BetaHead(nn.Module):
    """Turns 2·k network outputs into α, β > 1: a single hump inside [0, 1]."""

    outputs = 2  # per action variable

    def __init__(self, first_action, concentration):
        super().__init__()
        # mode m and concentration c = α+β:  α − 1 = m·(c − 2),  β − 1 = (1 − m)·(c − 2)
        mode = first_action.clamp(0.01, 0.99)
        wanted = torch.cat([mode, 1.0 - mode]) * (concentration - 2.0)  # [2k]
        self.first_bias = torch.log(torch.expm1(wanted))  # softplus⁻¹(y) = ln(eʸ − 1)

    def forward(self, raw):
        """[N, 2k] -> α [N, k], β [N, k]; the bound keeps α+β finite."""
        return (1.0 + softplus(raw).clamp(max=1e3)).chunk(2, dim=-1)

    def sample(self, alpha, beta):
        """Actions [N, k]; exactly 0 or 1 would have an infinite log-probability."""
        return torch.distributions.Beta(alpha, beta).sample().clamp(1e-6, 1.0 - 1e-6)

    log_prob = staticmethod(beta_log_prob)
    entropy = staticmethod(beta_entropy)
    decide = staticmethod(beta_decision)


class GaussianHead(nn.Module):
    """The usual choice, for comparison. It may sample outside [0, 1]; the environment gets the
    clipped action, while the log-probability is that of the unclipped one."""

    outputs = 1

    def __init__(self, first_action, concentration):
        super().__init__()
        self.first_bias = first_action
        std = (4.0 * (concentration + 1.0)) ** -0.5  # that of a Beta with mean 0.5, α+β = c
        self.log_std = nn.Parameter(torch.full_like(first_action, std).log())  # [k]

    def forward(self, raw):
        """[N, k] -> mean [N, k], standard deviation [N, k]."""
        return raw, self.log_std.exp().expand_as(raw)

    sample = staticmethod(torch.normal)

    def log_prob(self, x, mean, std):
        """Log-density of the unclipped actions [N, k] -> [N]."""
        return torch.distributions.Normal(mean, std, validate_args=False).log_prob(x).sum(-1)

    def entropy(self, mean, std):
        """[N, k] -> [N] [nats]."""
        return torch.distributions.Normal(mean, std, validate_args=False).entropy().sum(-1)

    def decide(self, mean, std):
        """The most likely action that the environment accepts, [N, k]."""
        return mean.clamp(0.0, 1.0)


HEADS = {"beta": BetaHead, "gaussian": GaussianHead}


class ActorCritic(nn.Module):
    """Two separate networks: the actor proposes, the critic predicts the discounted return V(s)."""

    def __init__(self, obs_dim, act_dim, hidden=(64, 64), distribution="beta", first_action=0.5,
                 first_concentration=10.0):
        super().__init__()
        self.shape = {"obs_dim": int(obs_dim), "act_dim": int(act_dim), "hidden": list(hidden),
                      "distribution": distribution}
        first_action = torch.as_tensor(first_action, dtype=torch.float32).expand(act_dim)
        self.head = HEADS[distribution](first_action, first_concentration)
        # Small last weights: at first the action hardly depends on the observation, and the bias
        # alone makes the first policy explore around first_action ("step on the spot").
        self.actor = mlp((obs_dim, *hidden, self.head.outputs * act_dim), last_gain=0.01)
        self.actor[-1].bias.data.copy_(self.head.first_bias)
        self.critic = mlp((obs_dim, *hidden, 1), last_gain=1.0)

    def value(self, obs):
        """The critic's V(s): [N, obs] -> [N]."""
        return self.critic(obs).squeeze(-1)

    def policy(self, obs):
        """[N, obs] -> the two parameters of the distribution, each [N, act]."""
        return self.head(self.actor(obs))

    def sample(self, obs):
        """Actions drawn for exploration: [N, obs] -> [N, act]."""
        with torch.no_grad():
            return self.head.sample(*self.policy(obs))

    def decide(self, obs):
        """Deterministic actions in [0, 1]: obs array [N, obs] -> array [N, act]."""
        with torch.no_grad():
            obs = torch.as_tensor(np.asarray(obs), dtype=torch.float32)
            return self.head.decide(*self.policy(obs)).numpy()


# ---------------------------------------------------------------- files
class PolicyError(ValueError):
    """A file cannot be used; the message is one line that says why."""


def plain(thing):
    """Only numbers, strings, lists and dicts: nothing that needs our classes to be loaded."""
    return json.loads(json.dumps(thing))


def atomic_write(path, write):
    """write(temporary file) in the same folder, then rename: the old file or the new one exists,
    never half of one."""
    temporary = path.with_name(path.name + ".tmp")
    write(temporary)
    os.replace(temporary, path)


def load_plain(path):
    """The dict in a file of ours, without running any foreign code; PolicyError if it is none."""
    path = Path(path)
    if not path.is_file():
        raise PolicyError(f"{path}: no such file")
    try:
        stored = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises many types, with messages of many lines
        raise PolicyError(f"{path}: damaged, or not a file of plain tensors") from error
    if not isinstance(stored, dict) or stored.get("format") != 1:
        raise PolicyError(f"{path}: not written by 04_ppo.py")
    return stored


def difference(stored, wanted):
    """"name is A in the file, but B here" for the first entry that differs, the simulator first;
    "" if none does."""
    keys = sorted(stored.keys() | wanted.keys(), key=lambda k: (not k.startswith("sim"), k))
    for key in keys:
        there, here = stored.get(key, "missing"), wanted.get(key, "missing")
        if isinstance(there, dict) and isinstance(here, dict) and there != here:
            return f"{key}: {difference(there, here)}"
        if there != here:
            return f"{key} is {there} in the file, but {here} here"
    return ""


def save_policy(path, model, meta):
    """Writes the model and `meta` (plain values); an older file becomes <name>.previous.pt."""
    path = Path(path)
    stored = {"format": 1, **plain(meta), **model.shape, "state_dict": model.state_dict()}
    if path.exists():
        previous = path.with_name(path.stem + ".previous" + path.suffix)
        atomic_write(previous, lambda temporary: shutil.copyfile(path, temporary))
    atomic_write(path, lambda temporary: torch.save(stored, temporary))


def load_policy(path):
    """(model, meta); meta["fits"] says what the policy was trained for."""
    stored = load_plain(path)
    try:
        weights = stored.pop("state_dict")
        meta = dict(stored, fits=dict(stored["fits"]))
        model = ActorCritic(**{key: stored[key] for key in
                               ("obs_dim", "act_dim", "hidden", "distribution")})
        model.load_state_dict(weights)
    except (KeyError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        raise PolicyError(f"{path}: not a policy, or of another shape") from error
    if not all(torch.isfinite(tensor).all() for tensor in weights.values()):
        raise PolicyError(f"{path}: contains numbers that are not finite")
    return model, meta


def write_csv(path, rows):
    """The log, one row per update, columns as in COLUMNS."""
    table = [[row[name] for name in COLUMNS] for row in rows]
    atomic_write(path, lambda temporary: np.savetxt(
        temporary, table, fmt="%.6g", delimiter=",", header=",".join(COLUMNS), comments=""))


# ---------------------------------------------------------------- collect, improve, repeat
class Collector:
    """Steps the environments with sampled actions and remembers the episodes that end."""

    def __init__(self, envs):
        self.envs, box = envs, envs.single_action_space
        if envs.metadata.get("autoreset_mode") != SAME_STEP:
            raise ValueError("the vector environment must use AutoresetMode.SAME_STEP")
        self.low, self.span, self.shape = box.low, box.high - box.low, box.shape
        self.simulated = 0.0  # [s] wall-clock spent in the environments

    def reset(self, seed):
        """Fresh episodes in all environments."""
        obs, _ = self.envs.reset(seed=seed)
        self.obs = obs.reshape(len(obs), -1)  # [N, obs]
        self.returns, self.lengths = np.zeros(len(obs)), np.zeros(len(obs))  # [N]

    def step(self, action):
        """action [N, act] in [0, 1] -> the observation that really followed, reward, terminated,
        truncated; all arrays over N, and the list of episodes that ended."""
        action = action.clip(0.0, 1.0).reshape(-1, *self.shape)
        clock = time.perf_counter()
        # a_env = low + a·(high − low)
        obs, reward, terminated, truncated, infos = self.envs.step(self.low + action * self.span)
        self.simulated += time.perf_counter() - clock
        self.obs = obs.reshape(len(obs), -1)
        self.returns += reward
        self.lengths += 1
        # In SAME_STEP mode obs already belongs to the next episode where one has ended:
        # the last observation of the ended one is in infos["final_obs"].
        followed, ended = self.obs.copy(), []
        for i in np.flatnonzero(terminated | truncated):
            followed[i] = np.ravel(infos["final_obs"][i])
            final = infos.get("final_info", {})
            episode = {key: float(final[key][i]) for key in OUTCOMES
                       if key in final and final["_" + key][i]}  # _key: which robots reported it
            ended.append({**episode, "env": i, "return": self.returns[i],
                          "length": self.lengths[i]})
            self.returns[i] = self.lengths[i] = 0.0
        return followed, reward, terminated, truncated, ended

    def rollout(self, model, steps, on_step=lambda: None):
        """T steps of N robots: dict of tensors [T, N, …], and the episodes that ended."""
        kept, episodes = [], []
        for _ in range(steps):
            obs = torch.tensor(self.obs, dtype=torch.float32)  # [N, obs]
            action = model.sample(obs)  # [N, act]
            followed, reward, terminated, truncated, ended = self.step(action.numpy())
            # torch.tensor copies: the environment may reuse its arrays in the next step
            kept.append((obs, action, torch.tensor(followed, dtype=torch.float32),
                         torch.tensor(reward, dtype=torch.float32),
                         torch.tensor(terminated), torch.tensor(truncated)))
            episodes += ended
            on_step()
        names = ("obs", "action", "followed", "reward", "terminated", "truncated")
        return {n: torch.stack(column) for n, column in zip(names, zip(*kept))}, episodes


def improve(model, optimizer, data, cfg, entropy_coef):
    """One PPO update from one rollout (tensors [T, N, …]); returns the numbers to watch."""
    with torch.no_grad():
        values = model.value(data["obs"])  # [T, N]
        next_values = model.value(data["followed"])  # [T, N]
        advantages = gae(data["reward"] * cfg.reward_scale, values, next_values,
                         data["terminated"], data["truncated"], cfg.gamma, cfg.lam)
        # R_t = A_t + V(s_t), the target of the critic
        returns = (advantages + values).flatten()  # [B], B = T·N
        obs, action = data["obs"].flatten(0, 1), data["action"].flatten(0, 1)  # [B, …]
        parameters = model.policy(obs)
        old_log_prob = model.head.log_prob(action, *parameters)  # [B]
        entropy = model.head.entropy(*parameters).mean()
        advantages, ev = advantages.flatten(), explained_variance(values.flatten(), returns)
    seen = []
    for _ in range(cfg.epochs):
        for pick in torch.randperm(len(obs)).split(cfg.minibatch):  # [minibatch]
            parameters = model.policy(obs[pick])
            # ρ = π_new(a|s) / π_old(a|s)
            log_ratio = model.head.log_prob(action[pick], *parameters) - old_log_prob[pick]
            ratio = log_ratio.exp()
            # Â = (A − mean) / std: the size of a gradient step does not depend on the reward's
            a = advantages[pick]
            a = (a - a.mean()) / (a.std() + 1e-8)
            v_loss = value_loss(model.value(obs[pick]), returns[pick])
            # loss = −L_clip + c_V·L_V − c_H·H
            loss = -clipped_objective(ratio, a, cfg.clip).mean() + cfg.value_coef * v_loss
            if entropy_coef > 0.0:
                loss = loss - entropy_coef * model.head.entropy(*parameters).mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(model.parameters(), cfg.max_grad_norm)
            optimizer.step()
            with torch.no_grad():
                seen.append(torch.stack([clip_fraction(ratio, cfg.clip), approx_kl(log_ratio),
                                         v_loss]))
    fraction, kl, v_loss = torch.stack(seen).mean(0).tolist()
    return {"entropy": entropy.item(), "clip_fraction": fraction, "approx_kl": kl,
            "explained_variance": ev.item(), "value_loss": v_loss}


def episode_means(episodes):
    """Means over the episodes that ended; nan where nothing was reported."""
    def mean(key, chosen):
        values = [episode[key] for episode in chosen if key in episode]
        return float(np.mean(values)) if values else float("nan")

    row = {key: mean(key, episodes) for key in ("return", "length", "success", "fall", "timeout")}
    return row | {"time": mean("time", [e for e in episodes if e.get("success", True)])}  # [s]


def random_seed(seed, update):
    """An independent stream of random numbers for every (seed, update)."""
    return int(np.random.SeedSequence([seed, update]).generate_state(1)[0])


def train(cfg, make_envs, out_dir, total_steps, seed=0, resume=False, fits=None, run=None,
          progress=True):
    """Trains for `total_steps` steps of all environments together; (model, rows of the log).

    make_envs(num_envs) -> vector environment; `fits` and `run`: plain dicts that describe what the
    policy is for and what else distinguishes this training (both must agree to resume it).

    To resume bit for bit, nothing may depend on what happened before the point of resuming except
    the networks, Adam's state and the update's number. Therefore every `checkpoint_every` updates,
    in an uninterrupted run too, the generators are seeded anew and fresh episodes begin. (The
    episodes cut there were bootstrapped like at the end of any other rollout.)
    """
    out_dir, per_update = Path(out_dir), cfg.num_envs * cfg.rollout
    updates = -(-total_steps // per_update)  # rounded up to whole updates
    settings = plain({**(fits or {}), **(run or {}), "seed": seed, "steps": total_steps,
                      **asdict(cfg)})
    checkpoint_path, start, rows = out_dir / "checkpoint.pt", 0, []
    if checkpoint_path.exists() and not resume:  # of an older training
        os.replace(checkpoint_path, out_dir / "checkpoint.previous.pt")
    checkpoint = load_plain(checkpoint_path) if resume else None
    if checkpoint:
        mismatch = difference(checkpoint.get("settings", {}), settings)
        if mismatch:
            raise PolicyError(f"{checkpoint_path}: cannot resume: {mismatch}")
        start, rows = checkpoint["update"], checkpoint["rows"]
        if start == updates:
            print("this training has already finished: nothing left to resume")
            return load_policy(out_dir / "policy.pt")[0], rows

    torch.set_num_threads(1)  # matrices this small are slower on several threads
    out_dir.mkdir(parents=True, exist_ok=True)
    envs = make_envs(cfg.num_envs)
    bar = tqdm(total=updates * per_update, initial=start * per_update, unit=" steps",
               disable=not progress, dynamic_ncols=True)
    try:
        torch.manual_seed(random_seed(seed, 0))
        model = ActorCritic(int(np.prod(envs.single_observation_space.shape)),
                            int(np.prod(envs.single_action_space.shape)), cfg.hidden,
                            cfg.distribution, getattr(envs, "neutral_action", 0.5),
                            cfg.first_concentration)
        optimizer = torch.optim.Adam(model.parameters(), eps=1e-5)  # ε of [SB3]
        if checkpoint:
            model.load_state_dict(checkpoint["model"])
            optimizer.load_state_dict(checkpoint["optimizer"])
        collector = Collector(envs)
        started = time.monotonic() - (60.0 * rows[-1]["minutes"] if rows else 0.0)  # [s]

        def save_checkpoint(update):
            stored = {"format": 1, "settings": settings, "update": update, "rows": rows,
                      "model": model.state_dict(), "optimizer": optimizer.state_dict()}
            atomic_write(checkpoint_path, lambda temporary: torch.save(stored, temporary))
            write_csv(out_dir / "learning_curve.csv", rows)

        for update in range(start, updates):
            if update % cfg.checkpoint_every == 0:
                if update > start:
                    save_checkpoint(update)
                torch.manual_seed(random_seed(seed, update))
                collector.reset(random_seed(seed, update))
            remaining = 1.0 - update / updates
            optimizer.param_groups[0]["lr"] = cfg.learning_rate * remaining
            clock, collector.simulated = time.perf_counter(), 0.0
            data, episodes = collector.rollout(model, cfg.rollout,
                                               lambda: bar.update(cfg.num_envs))
            watched = improve(model, optimizer, data, cfg, cfg.entropy_coef * remaining)
            learning = time.perf_counter() - clock - collector.simulated  # [s]
            if not np.isfinite(watched["value_loss"]):
                raise FloatingPointError(f"update {update}: the loss is not finite")
            rows.append({"steps": (update + 1) * per_update,
                         "minutes": (time.monotonic() - started) / 60.0,
                         **episode_means(episodes), **watched,
                         "learning_rate": cfg.learning_rate * remaining,
                         "learning_ms": 1000.0 * learning / per_update})
            bar.set_postfix({name: f"{recent_mean(rows, name):.3g}"
                             for name in ("success", "fall", "return")
                             if not np.isnan(recent_mean(rows, name))})
        meta = {"fits": fits or {}, "steps": rows[-1]["steps"], "minutes": rows[-1]["minutes"],
                "seed": seed, "config": asdict(cfg), "run": run or {}}
        save_policy(out_dir / "policy.pt", model, meta)
        save_checkpoint(updates)  # last: a run counts as finished when its policy exists
    finally:
        bar.close()
        envs.close()
    return model, rows


def recent_mean(rows, name, window=10):
    """Mean of a column over the last updates, skipping nan."""
    values = np.array([row[name] for row in rows[-window:]])
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")


def episode_returns(model, envs, seed, max_steps=10_000):
    """The deterministic policy's return in each environment's first episode; closes them."""
    collector, first = Collector(envs), {}
    collector.reset(seed)
    for _ in range(max_steps):
        *_, ended = collector.step(model.decide(collector.obs))
        for episode in ended:
            first.setdefault(episode["env"], episode["return"])
        if len(first) == envs.num_envs:
            break
    envs.close()
    return np.array(list(first.values()))


# ---------------------------------------------------------------- the picture
PANELS = (  # title, label of the vertical axis, columns
    ("How episodes end (while exploring)", "share of episodes [1]", ("success", "timeout", "fall")),
    ("Time to the goal", "simulated time [s]", ("time",)),
    ("Return", "sum of rewards per episode [1]", ("return",)),
    ("How much it explores", "entropy of the policy [nats]", ("entropy",)),
    ("How far an update moves the policy", "share [1], KL [nats]", ("clip_fraction", "approx_kl")),
    ("How well the critic predicts", "explained variance [1]", ("explained_variance",)),
    ("Loss of the critic", "mean squared error [reward²]", ("value_loss",)),
    ("Length", "steps per episode [1]", ("length",)),
)


def plot_learning_curve(rows, path, title):
    """The first six panels for which there are numbers."""
    steps = np.array([row["steps"] for row in rows]) / 1000.0  # [U]
    figure, grid = plt.subplots(2, 3, figsize=(12, 6.5), layout="constrained")
    known = [p for p in PANELS if np.isfinite([row[p[2][0]] for row in rows]).any()]
    for axes, (name, unit, columns) in zip(grid.flat, known):
        for column in columns:
            color = {"success": "tab:green", "timeout": "tab:gray", "fall": "tab:red"}.get(column)
            mean = [recent_mean(rows[: i + 1], column) for i in range(len(rows))]
            label = column.replace("_", " ").replace("kl", "KL")
            line, = axes.plot(steps, mean, color=color, label=label)
            axes.plot(steps, [row[column] for row in rows], ".", color=line.get_color(),
                      alpha=0.3, markersize=3)
        axes.set(title=name, ylabel=unit, xlabel="steps of all robots together [thousands]")
        axes.grid(alpha=0.3)
        if "explained_variance" in columns:
            axes.set_ylim(-0.5, 1.05)  # when all returns are alike a single value may be −10
        if len(columns) > 1:
            axes.legend()
    figure.suptitle(f"{title}: dots are single updates, lines the mean of the last 10")
    atomic_write(path, lambda temporary: figure.savefig(temporary, dpi=130, format="png"))
    plt.close(figure)


# ---------------------------------------------------------------- command line
def positive(text):
    """A command line's whole number above 0."""
    if not text.isdigit() or int(text) == 0:
        raise argparse.ArgumentTypeError(f"{text} is not a positive whole number")
    return int(text)


def gym_envs(env_id):
    """make_envs(num_envs) for a registered Gymnasium environment; ValueError if it does not fit."""
    def make_envs(num_envs):
        return gym.make_vec(env_id, num_envs=num_envs, vectorization_mode="sync",
                            vector_kwargs={"autoreset_mode": SAME_STEP})
    try:
        envs = make_envs(1)
    except Exception as error:  # a foreign environment may raise anything
        reason = " ".join(str(error).split())
        raise ValueError(f"cannot make environment {env_id}: {reason}") from error
    spaces = envs.single_observation_space, envs.single_action_space
    envs.close()
    if not all(isinstance(space, gym.spaces.Box) for space in spaces) or not spaces[1].is_bounded():
        raise ValueError(f"{env_id} needs a Box observation and a bounded Box action, it has "
                         f"{spaces[0]} and {spaces[1]}")
    return make_envs


def main(argv=None):
    """See the head of this file."""
    robot_model = import_module("01_robot_model")
    parser = robot_model.stage_parser(__doc__, Path(__file__).name)
    parser.add_argument("--imu", action="store_true", help="observe the torso's tilt and turning")
    parser.add_argument("--noise", action=argparse.BooleanOptionalAction, default=True,
                        help="train with measurement noise")
    parser.add_argument("--steps", type=positive, help=f"double steps (default {STEPS:,})")
    parser.add_argument("--quick", action="store_true",
                        help=f"{QUICK_STEPS:,} steps, into runs/<sim>/quick/")
    parser.add_argument("--resume", action="store_true", help="continue an interrupted training")
    parser.add_argument("--env", metavar="ID", help="train on this Gymnasium environment instead")
    args = robot_model.parse_stage(parser, argv)
    if args.env and (args.mujoco or args.imu or not args.noise):
        parser.error("--env cannot be combined with --mujoco, --imu or --no-noise")

    sim, task = args.sim, args.env or args.sim
    folder = Path("runs") / task.replace("/", "-").replace(":", "-")
    folder = folder / ("imu" if args.imu else "") / ("quick" if args.quick else "")
    steps = args.steps or (QUICK_STEPS if args.quick else STEPS)
    cfg = PPOConfig(**PRESETS.get(args.env, {}))
    if args.env:
        try:
            make_envs, fits = gym_envs(args.env), {"simulator": args.env}
        except ValueError as error:
            parser.error(str(error))
    else:
        env_stage = import_module("03_env")
        fits = env_stage.fingerprint(sim, args.imu)

        def make_envs(num_envs):
            return env_stage.FootstepVectorEnv(num_envs, sim, args.noise, args.imu)
    out_dir = robot_model.output_folder(parser, args, folder)
    print(f"training on {task}: {steps:,} steps, seed {args.seed}, into {out_dir}")
    try:
        model, rows = train(cfg, make_envs, out_dir, steps, args.seed, args.resume, fits,
                            {"imu": args.imu, "noise": args.noise})
    except (PolicyError, FloatingPointError, OSError) as error:
        parser.error(str(error))
    except KeyboardInterrupt:
        saved = (out_dir / "checkpoint.pt").exists()
        print("\ninterrupted:", "the same command with --resume continues from the last checkpoint"
              if saved else "too early to resume, no checkpoint was written yet", file=sys.stderr)
        if (out_dir / "policy.pt").exists():
            print(f"{out_dir / 'policy.pt'} is that of an earlier training", file=sys.stderr)
        sys.exit(130)
    plot_learning_curve(rows, out_dir / "learning_curve.png", f"PPO on {task}")
    learning = np.mean([row["learning_ms"] for row in rows])
    print(f"after {rows[-1]['minutes']:.1f} minutes ({learning:.2f} ms of learning per step):",
          *(out_dir / name for name in ("policy.pt", "learning_curve.csv", "learning_curve.png")))
    if args.env:
        returns = episode_returns(model, make_envs(100), random_seed(args.seed, steps))
        print(f"deterministic policy, 100 episodes: return {returns.mean():.1f} ± "
              f"{returns.std():.1f}")
    else:
        found = out_dir == Path("runs") / sim / ("imu" if args.imu else "")  # by stage 05
        print("next: python 05_evaluate.py --noise" + " --mujoco" * args.mujoco
              + (" --imu" * args.imu if found else f" --policy {out_dir / 'policy.pt'}"))


if __name__ == "__main__":  # the simulator's worker processes import this file again
    main()
