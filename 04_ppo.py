"""Stage 4: how does the robot learn which footsteps to take? By trying, with PPO.

Paper: section II, "Policy" (two hidden layers of 64 neurons, a Beta distribution for each action
variable), trained with PPO, proximal policy optimization [7]. The paper used Stable-Baselines3 [8];
here it is written out, so that every equation has a line to point at.

    python 04_ppo.py                 500,000 double steps of the planar robot (pymunk)
    python 04_ppo.py --mujoco        the same in 3-D
    python 04_ppo.py --quick         60,000 of them, a lesson of a minute, into runs/<sim>/quick/
    python 04_ppo.py --resume        continue after Ctrl-C: the same policy, bit for bit
    python 04_ppo.py --imu           the torso's tilt and angular velocity observed, too
    python 04_ppo.py --env Pendulum-v1 --gamma 0.95 --steps 150000     another Gymnasium task

The share of successes should rise, the share of falls sink. The stage writes policy.pt and
learning_curve.csv and .png to runs/<sim>/, and checkpoint.pt to resume from. Beside the last policy
it keeps the first one (policy.start.pt) and that after a tenth of the way (policy.tenth.pt). The
goal is measured with noise (--no-noise: exactly).

What is maximised. The policy π(a|s) is a distribution over the actions a for each observation s.
The return from step t on is G_t = r_t + γ·r_{t+1} + γ²·r_{t+2} + …; its average shall be large.
  value      V(s) = E[G_t | s]: the average return from s on; learned by a second network,
             the critic
  advantage  A_t: how much better the action was than the average one, about G_t − V(s_t)
How the average changes with the policy's parameters (the policy gradient), first for one decision;
∇ is the gradient with respect to the parameters (for continuous actions Σ is an integral):
  E[G] = Σ_a π(a)·G(a).   As ∇π = π·∇ln π:   ∇E[G] = Σ_a π·G·∇ln π = E[G·∇ln π].
  A number b that does not depend on a changes nothing: E[b·∇ln π] = b·Σ_a ∇π = b·∇1 = 0.
  So we may subtract b = V(s). The result is the same on average, with less noise: E[A·∇ln π].
Over an episode the gradients of its decisions are added. (The rewards before a decision do not
depend on its action; they drop out like b. Exactly, decision t counts γᵗ times; as usual we leave
this out, so that late decisions learn as much.) Following this gradient makes good actions more
likely and bad ones less.
PPO uses a sample several times while the policy moves on, so it weights it by the ratio
ρ = π(a|s) / π_old(a|s); at ρ = 1 the gradient of ρ·A is A·∇ln π again.

The loop: (1) collect a rollout: N robots take T steps; (2) judge every action; (3) improve;
(4) log. Repeat.

A cut-off and a fall both end an episode, but they do not mean the same. After a fall (terminated)
there is no future: the sum of the later rewards is 0, and that is the truth; at the goal likewise.
After a cut-off (truncated: the time is up) the world would have gone on; only our recording
stopped. A 0 there would train the critic to give walking well at 99 s the same value as lying on
the ground. So the missing sum is replaced by V of the LAST observation of that episode
("bootstrapping"). The first observation of the next episode must not be used. Where a rollout ends
within an episode, V of the observation that follows replaces the rest, too.

Leaves out: the entropy bonus of [7], value clipping, a stop at a large Kullback-Leibler divergence
(KL), recurrent policies, normalisation of observations and rewards, GPUs.

[7] Schulman et al.: Proximal Policy Optimization Algorithms, 2017, arXiv 1707.06347.
[8] Raffin et al.: Stable-Baselines3: Reliable Reinforcement Learning Implementations, 2021.
[GAE] Schulman et al.: High-Dimensional Continuous Control Using GAE, 2015, arXiv 1506.02438.
"""

import argparse
import contextlib
import math
import shutil
import time
import warnings
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np
import torch
from torch import nn
from torch.distributions import Beta, Distribution, Independent
from tqdm import tqdm

robot_model = import_module("01_robot_model")
env = import_module("03_env")
torch.set_num_threads(1)  # matrices this small are slower on several threads
Distribution.set_default_validate_args(False)  # quicker
STEPS, QUICK_STEPS = 500_000, 60_000  # double steps; the paper: 1,000,000


@dataclass(frozen=True)
class PPOConfig:
    """Sources: [P] the paper, [7], [8] its default, [own] our choice; (name in [8])."""

    num_envs: int = 64  # N, robots that walk at the same time (n_envs) [own]
    rollout: int = 64  # T, double steps of each robot between two updates (n_steps) [own]
    epochs: int = 10  # how often every sample is used (n_epochs) [8]
    minibatch: int = 512  # samples per gradient step (batch_size) [own]
    learning_rate: float = 1e-3  # of Adam at the start; falls linearly to 0 [own]
    gamma: float = 0.98  # γ, discount per double step: 50 ahead, rewards count 0.98⁵⁰ = 0.36 [own]
    lam: float = 0.95  # λ, from 0 to 1: trust in sampled returns, see `gae` (gae_lambda) [8]
    clip: float = 0.2  # ε: beyond 1 ± ε the objective does not grow (clip_range) [7]
    reward_scale: float = 1.0  # so that returns have a size of about 1 to 10 [own]
    value_coef: float = 0.5  # c_V, weight of the critic's loss in the sum (vf_coef) [8]
    max_grad_norm: float = 0.5  # longer gradients are scaled down to this length [8]
    hidden: tuple = (64, 64)  # neurons per hidden layer [P]
    first_concentration: float = 10.0  # c = α+β of the first policy, > 2; large: little noise [own]
    sharpest: float = 6.0  # k at the end, see `ActorCritic`: the policy becomes narrower [own]
    checkpoint_every: int = 10  # updates; then all episodes begin anew, see `train` [own]


# Of --env. Its episodes may be long, so they are never cut off for a checkpoint.
GYM_CONFIG = PPOConfig(
    num_envs=16,
    rollout=128,
    minibatch=256,
    gamma=0.99,
    reward_scale=0.1,
    sharpest=4.0,
    checkpoint_every=10**9,
)


# ------------------------------------------------------------------------ the networks
def mlp(sizes, last_gain):
    """Linear layers with tanh between them; random weights as in [8]: a matrix with orthogonal rows
    or columns of length √2."""
    layers = []
    for inputs, outputs in zip(sizes[:-1], sizes[1:]):
        linear = nn.Linear(inputs, outputs)
        nn.init.orthogonal_(linear.weight, 2**0.5)
        nn.init.zeros_(linear.bias)
        layers += [linear, nn.Tanh()]
    nn.init.orthogonal_(linear.weight, last_gain)  # of the last layer
    return nn.Sequential(*layers[:-1])


class ActorCritic(nn.Module):
    """Two separate networks: the actor proposes actions, the critic predicts the return V(s).

    Each action variable x in [0, 1] has a Beta distribution, p(x) ∝ x^(α−1)·(1−x)^(β−1): a single
    hump, as α, β > 1 (not the angles of stage 3). Training uses sampled actions, evaluation uses
    the mean. A narrow distribution makes the two similar. So it is made narrower during training:
    its density is raised to a power k, the sharpness, which grows from 1 to 6.
        p(x)^k ∝ x^(k·(α−1))·(1−x)^(k·(β−1))   is a Beta distribution again, with the same mode.
    """

    sharpness = 1.0  # k; set by `train` and `load_policy`

    def __init__(self, obs_dim, act_dim, hidden=(64, 64), first_action=0.5, concentration=10.0):
        super().__init__()
        self.shape = {"obs_dim": obs_dim, "act_dim": act_dim, "hidden": hidden}  # for the file
        self.actor = mlp((obs_dim, *hidden, 2 * act_dim), last_gain=0.01)
        self.critic = mlp((obs_dim, *hidden, 1), last_gain=1.0)
        # With small last weights the first policy hardly depends on the observation: the bias alone
        # puts its mode m = (α − 1) / (c − 2) at first_action, with the concentration c = α+β:
        # α − 1 = m·(c − 2),  β − 1 = (1 − m)·(c − 2)
        mode = torch.as_tensor(first_action, dtype=torch.float32).expand(act_dim).clamp(0.01, 0.99)
        wanted = torch.cat([mode, 1.0 - mode]) * (concentration - 2.0)  # first all α, then all β
        # softplus(x) = ln(1 + eˣ), so softplus⁻¹(w) = ln(eʷ − 1)
        self.actor[-1].bias.data.copy_(torch.log(torch.expm1(wanted)))

    def value(self, obs):
        """The critic's V(s): [..., obs] -> [...]."""
        return self.critic(obs).squeeze(-1)

    def policy(self, obs):
        """π(·|s): [..., obs] -> a distribution over actions [..., act]."""
        raw = nn.functional.softplus(self.actor(obs)).clamp(1e-6, 1e3)  # no overflow
        alpha, beta = (1.0 + self.sharpness * raw).chunk(2, dim=-1)
        return Independent(Beta(alpha, beta), 1)  # log π(a|s): the sum over a's variables

    def sample(self, obs):
        """Actions drawn for exploration, tensors: [N, obs] -> [N, act]."""
        with torch.no_grad():  # exactly 0 or 1 would have an infinite log-probability
            return self.policy(obs).sample().clamp(1e-6, 1.0 - 1e-6)

    def decide(self, obs):
        """The action without exploring (predict), arrays: [N, obs] -> [N, act]: the mean."""
        with torch.no_grad():  # α / (α + β); the paper: the mode, see `tests/studies/ablations.py`
            return self.policy(torch.as_tensor(obs, dtype=torch.float32)).mean.numpy()


# ------------------------------------------------------------------------ one update of PPO
def collect(model, envs, obs, steps):
    """(1) N robots take T steps each, from the observations obs [N, …] on: tensors [T, N, …] by
    name (the rollout buffer), the observations to go on from, and the infos of every step.
    """
    buffer, infos = [], []
    for _ in range(steps):
        obs = obs.astype(np.float32)  # a copy: environments may reuse their arrays
        action = model.sample(torch.from_numpy(obs))  # [N, act]
        after, reward, terminated, truncated, info = envs.step(action.numpy())
        # Where an episode has ended, `after` already belongs to the next one (stage 3, SAME_STEP).
        # What really followed the action is the last observation of the ended one.
        next_obs = after.astype(np.float32)
        for i in np.flatnonzero(terminated | truncated):
            next_obs[i] = info["final_obs"][i]
        step = {
            "obs": obs,
            "action": action,
            "next_obs": next_obs,
            "reward": reward.astype(np.float32),
            "terminated": terminated,
            "truncated": truncated,
        }
        buffer.append({name: torch.as_tensor(value) for name, value in step.items()})
        infos.append(info)
        obs = after
    data = {name: torch.stack([step[name] for step in buffer]) for name in buffer[0]}
    return data, obs, infos


def gae(rewards, values, next_values, terminated, truncated, gamma, lam):
    """(2) Advantages A_t by generalised advantage estimation [GAE]; everything [T, N].

    next_values[t] is V of what really followed step t. The error of the critic in one step is
        δ_t = r_t + γ·V(s_{t+1}) − V(s_t).
    Three estimates of the advantage are made of it:
        one step     δ_t                  little noise, but wrong where the critic is wrong
        two steps    δ_t + γ·δ_{t+1}      = r_t + γ·r_{t+1} + γ²·V(s_{t+2}) − V(s_t): the V between
                                          cancels
        all steps    Σ_k γᵏ·δ_{t+k}       = G_t − V(s_t): right on average, but noisy
    λ between 0 (the first row) and 1 (the last one) lets later errors fade:
        A_t = Σ_k (γλ)ᵏ·δ_{t+k}        with λ = 0.95 the error 20 steps ahead counts 0.95²⁰ = 0.36
    """
    # δ_t = r_t + γ·(1 − terminated_t)·V(s_{t+1}) − V(s_t)
    after = next_values.masked_fill(terminated, 0)  # not "· 0", as nan · 0 = nan
    deltas = rewards + gamma * after - values
    # A_t = δ_t + γ·λ·A_{t+1} within one episode: the sum stops at a fall AND at a cut-off
    goes_on = ~(terminated | truncated)
    advantages = torch.empty_like(rewards)
    next_advantage = torch.zeros_like(rewards[0])  # [N] A_{t+1}
    for t in reversed(range(len(rewards))):
        next_advantage = deltas[t] + gamma * lam * (goes_on[t] * next_advantage)
        advantages[t] = next_advantage
    return advantages


def clipped_objective(ratio, advantage, clip):
    """Per sample, to be maximised; ratio ρ = π(a|s) / π_old(a|s).

    For a good action (A > 0) it stays constant for ρ > 1 + ε, for a bad one (A < 0) for ρ < 1 − ε:
    there is no gradient to move the policy farther. If ρ has moved against A, the unclipped product
    is the smaller one and keeps its gradient; hence the minimum.
    """
    # L = min(ρ·A, clip(ρ, 1 − ε, 1 + ε)·A)
    return torch.min(ratio * advantage, ratio.clamp(1.0 - clip, 1.0 + clip) * advantage)


def judge(model, data, cfg):
    """(2) Advantage, the critic's target, log π_old, each [B], B = T·N; data: tensors [T, N, …]."""
    with torch.no_grad():
        values = model.value(data["obs"])  # [T, N]
        rewards = cfg.reward_scale * data["reward"]
        advantages = gae(
            rewards,
            values,
            model.value(data["next_obs"]),
            data["terminated"],
            data["truncated"],
            cfg.gamma,
            cfg.lam,
        )
        # The critic's output should be G_t. Our best estimate of G_t: V(s_t) + A_t
        targets = values + advantages
        # π_old is the model as it is now, before the first gradient step.
        old_log_prob = model.policy(data["obs"]).log_prob(data["action"])
    return advantages.flatten(), targets.flatten(), old_log_prob.flatten()


def improve(model, optimizer, data, cfg):
    """(3) Gradient steps on a rollout (tensors [T, N, …]); returns numbers, on all samples:
    before them entropy, explained_variance; after them clip_fraction, approx_kl, value_loss.
    """
    advantages, targets, old_log_prob = judge(model, data, cfg)  # [B] each
    obs, action = data["obs"].flatten(0, 1), data["action"].flatten(0, 1)  # [B, …]
    with torch.no_grad():
        entropy = model.policy(obs).entropy().mean()  # [nats]
        # 1 − Var[target − V] / Var[target].   1: V predicts the return, 0: V is no better than a
        # constant, the mean of all targets (usual while rare falls make most of the variance)
        unexplained = (targets - model.value(obs)).var() / targets.var()
        before = {"entropy": entropy.item(), "explained_variance": 1.0 - unexplained.item()}
    for _ in range(cfg.epochs):
        for pick in torch.randperm(len(obs)).split(cfg.minibatch):  # [minibatch]
            ratio = (model.policy(obs[pick]).log_prob(action[pick]) - old_log_prob[pick]).exp()
            # Â = (A − mean) / std over the minibatch: is it better or worse than the others? So the
            # size of the rewards does not matter.
            a = advantages[pick]
            a = (a - a.mean()) / (a.std(correction=0) + 1e-8)  # (of a single sample: 0, not nan)
            # L_V = mean (V(s) − target)²;   loss = −L + c_V·L_V
            critic_loss = nn.functional.mse_loss(model.value(obs[pick]), targets[pick])
            loss = -clipped_objective(ratio, a, cfg.clip).mean() + cfg.value_coef * critic_loss
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(model.parameters(), cfg.max_grad_norm)
            optimizer.step()
    with torch.no_grad():  # the policy after the update against π_old
        log_ratio = model.policy(obs).log_prob(action) - old_log_prob
        outside = ((log_ratio.exp() - 1).abs() > cfg.clip).float()  # of [1 − ε, 1 + ε]
        # How far the policy moved: KL(π_old‖π) = E[−ln ρ] [nats], mean over π_old. As E[ρ − 1] = 0,
        # we may add ρ − 1: the mean is the same, but each sample is ≥ 0, so there is less noise.
        return {
            **before,
            "clip_fraction": outside.mean().item(),
            "approx_kl": (torch.expm1(log_ratio) - log_ratio).mean().item(),
            "value_loss": nn.functional.mse_loss(model.value(obs), targets).item(),
        }


# ------------------------------------------------------------------------ the loop
def train(
    cfg, make_envs, out, total_steps, seed=0, about=None, resume=False, make_model=ActorCritic
):
    """Trains for `total_steps` steps of all robots together; (model, rows of the log).

    make_envs(num_envs) -> vector environment with AutoresetMode.SAME_STEP and actions in [0, 1];
    out: an existing folder, a Path; about: plain values, stored with the policy. about["fits"] is
    compared by stage 5 with its own simulator, observation, limits and walk.
    """
    samples = cfg.num_envs * cfg.rollout  # steps of all robots in an update
    updates = max(1, math.ceil(total_steps / samples))
    about = {
        "fits": {},
        **(about or {}),
        "seed": seed,
        "steps": updates * samples,
        "config": asdict(cfg),
    }
    torch.manual_seed(random_seed(seed))
    with contextlib.closing(make_envs(cfg.num_envs)) as bare:
        envs = gym.wrappers.vector.RecordEpisodeStatistics(bare)
        model = make_model(
            envs.single_observation_space.shape[0],
            envs.single_action_space.shape[0],
            cfg.hidden,
            getattr(bare, "neutral_action", 0.5),
            cfg.first_concentration,
        )
        # foreach: one call for all weights, which is quicker; eps as in [8]
        optimizer = torch.optim.Adam(model.parameters(), eps=1e-5, foreach=True)
        rows = load_checkpoint(out, about, model, optimizer) if resume else []
        if not resume:
            (out / "checkpoint.pt").unlink(missing_ok=True)
            if (out / "policy.pt").exists():  # an older policy is kept
                shutil.copyfile(out / "policy.pt", out / "policy.previous.pt")
        first = len(rows)
        started = time.monotonic() - (60 * rows[-1]["minutes"] if rows else 0)  # [s]
        early = {0: "start", max(1, updates // 10): "tenth"}  # policies worth keeping, by update
        bar = tqdm(
            range(first, updates), total=updates, initial=first, unit=" steps", unit_scale=samples
        )
        for update in bar:
            # At every tenth update all episodes begin anew, with seeds made of the update's number.
            # So the networks and Adam's state are all that a checkpoint has to hold, and a resumed
            # training does bit for bit the same as an uninterrupted one.
            if update % cfg.checkpoint_every == 0:
                if update > first:
                    save_checkpoint(out, about, rows, model, optimizer)
                new_seed = random_seed(seed, 1 + update)
                torch.manual_seed(new_seed)
                obs, _ = envs.reset(seed=new_seed)
            # Learning rate and sharpness change linearly with p, from 0 to (nearly) 1.
            p = update / updates
            rate = cfg.learning_rate * (1.0 - p)
            optimizer.param_groups[0]["lr"] = rate
            model.sharpness = 1.0 + (cfg.sharpest - 1.0) * p
            if update in early:
                save_policy(out / f"policy.{early[update]}.pt", model, about)
            data, obs, infos = collect(model, envs, obs, cfg.rollout)
            numbers = improve(model, optimizer, data, cfg)
            means = episode_means(infos)
            minutes = (time.monotonic() - started) / 60
            rows.append(
                {
                    "steps": (update + 1) * samples,
                    "minutes": minutes,
                    **numbers,
                    **means,
                    "learning_rate": rate,
                }
            )
            bar.set_description(
                f"success {means['success']:.2f}, falls {means['fall']:.2f}, "
                f"return {means['return']:.2f}"
            )
            if not np.isfinite(numbers["value_loss"]):
                raise FloatingPointError(f"after {rows[-1]['steps']} steps: the loss is not finite")
    model.sharpness = cfg.sharpest
    if first < updates:
        # If the training is killed between these two lines, --resume writes the policy again.
        save_policy(out / "policy.pt", model, {**about, "minutes": minutes})
        save_checkpoint(out, about, rows, model, optimizer)
    return model, rows


def episode_means(infos):
    """(4) Means over the episodes that ended in these steps; nan where nothing was reported."""
    ended = {name: [] for name in ("return", "length", "success", "fall", "timeout", "time")}
    for info in (info for info in infos if "episode" in info):  # of RecordEpisodeStatistics
        told = info["episode"]
        final = {**info["final_info"], "return": told["r"], "length": told["l"]}
        for name in ended.keys() & final.keys():  # "return": sum of the rewards, not discounted
            counted = info["_episode"]
            if name == "time":  # of successes only
                counted = counted & final.get("success", True)
            ended[name] += final[name][counted].tolist()
    return {name: float(np.mean(v)) if v else float("nan") for name, v in ended.items()}


def random_seed(*numbers):
    """A 32-bit seed made of several numbers."""
    return int(np.random.SeedSequence(numbers).generate_state(1)[0])


# ------------------------------------------------------------------------ files
class PolicyError(ValueError):
    """A file cannot be used; the message is one line that says why."""


def load_plain(path, *keys):
    """The dict with these keys in a file of ours; foreign code in the file is never run."""
    try:
        with warnings.catch_warnings(action="ignore"):  # torch's, about foreign formats
            stored = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError:
        raise PolicyError(f"{path}: no such file") from None
    except Exception as error:  # torch raises many types, with messages of many lines
        raise PolicyError(f"{path}: damaged, or not written by 04_ppo.py") from error
    if not isinstance(stored, dict) or not stored.keys() >= set(keys):
        raise PolicyError(f"{path}: not written by 04_ppo.py")
    return stored


def difference(stored, wanted):
    """The first entry that differs: "name is A in the file, but B here"; or ""."""
    for key in {**wanted, **stored}:
        there = stored.get(key, "missing")
        here = wanted.get(key, "missing")
        if there != here:
            if isinstance(there, dict) and isinstance(here, dict):
                return f"{key}: {difference(there, here)}"
            return f"{key} is {there} in the file, but {here} here"
    return ""


def save_policy(path, model, meta):
    """Writes the model and `meta` (plain values)."""
    stored = {**meta, **model.shape, "sharpness": model.sharpness, "state_dict": model.state_dict()}
    robot_model.atomic_write(path, partial(torch.save, stored))


def load_policy(path):
    """(model, meta); meta["fits"] says what the policy was trained for."""
    meta = load_plain(path, "obs_dim", "act_dim", "hidden", "sharpness", "state_dict", "fits")
    model = ActorCritic(meta["obs_dim"], meta["act_dim"], meta["hidden"])
    model.load_state_dict(meta.pop("state_dict"))
    model.sharpness = meta["sharpness"]
    return model, meta


def save_checkpoint(out, about, rows, model, optimizer):
    """All that a resumed training needs, and the log so far as a table."""
    stored = {
        "about": about,
        "rows": rows,
        "model": model.state_dict(),
        "optimizer": optimizer.state_dict(),
    }
    robot_model.atomic_write(out / "checkpoint.pt", partial(torch.save, stored))
    table = [list(row.values()) for row in rows]
    robot_model.atomic_write(
        out / "learning_curve.csv",
        lambda file: np.savetxt(file, table, "%.9g", ",", header=",".join(rows[0]), comments=""),
    )


def load_checkpoint(out, about, model, optimizer):
    """Puts the networks and Adam's state back where a training stopped; returns its log."""
    path = out / "checkpoint.pt"
    stored = load_plain(path, "about", "rows", "model", "optimizer")
    if mismatch := difference(stored["about"], about):
        raise PolicyError(f"{path}: cannot resume: {mismatch}")
    model.load_state_dict(stored["model"])
    optimizer.load_state_dict(stored["optimizer"])
    return stored["rows"]


# ------------------------------------------------------------------------ the picture
PANELS = {  # title and unit: columns
    "success rises, falls sink [share of walks]": ("success", "timeout", "fall"),
    "the way to the goal takes less time [s]": ("time",),
    "the return, not discounted (first episodes: short)": ("return",),
    "it explores less: entropy (may be < 0) [nats]": ("entropy",),
    "updates move the policy less [share clipped]": ("clip_fraction",),
    "the critic predicts: explained variance [1]": ("explained_variance",),
}


def plot_learning_curve(rows, path, title):
    """Every panel of the log: a faint dot for each update, and a running mean of a twentieth."""
    steps = np.array([row["steps"] for row in rows]) / 1000.0  # [U]
    shown = {
        name: [column for column in columns if not np.isnan([row[column] for row in rows]).all()]
        for name, columns in PANELS.items()
    }
    shown = {name: columns for name, columns in shown.items() if columns}
    figure, grid = plt.subplots(2, math.ceil(len(shown) / 2), figsize=(12, 6.5))
    for axes, (name, columns) in zip(grid.flat, shown.items()):
        for column in columns:
            y = np.array([row[column] for row in rows])  # [U] nan where nothing was reported
            x, y = steps[~np.isnan(y)], y[~np.isnan(y)]
            width = max(1, len(y) // 20)
            mean = np.convolve(y, np.full(width, 1 / width), "valid")
            (line,) = axes.plot(x[width // 2 :][: len(mean)], mean, label=column)
            axes.plot(x, y, ".", color=line.get_color(), alpha=0.2)
        axes.set(title=name, xlabel="steps of all robots [thousands]")
        if len(columns) > 1:
            axes.legend()
    axes.set_ylim(-0.5, 1.05)  # of the last panel: while all returns are alike it may be −10
    for axes in grid.flat[len(shown) :]:
        axes.remove()
    figure.suptitle(title)
    robot_model.save_figure(figure, path)


# ------------------------------------------------------------------------ command line
def gym_envs(env_id, num_envs):
    """A registered Gymnasium environment for `train`: flat observations, actions in [0, 1]."""

    def rescaled(one):
        box = one.action_space
        if not isinstance(box, gym.spaces.Box) or not box.is_bounded() or len(box.shape) != 1:
            raise gym.error.Error(f"{env_id}: this PPO needs actions in a Box [n], with bounds")
        return gym.wrappers.RescaleAction(one, *np.float32([0, 1]))

    return gym.make_vec(
        env_id,
        num_envs,
        "sync",
        {"autoreset_mode": "SameStep"},
        (rescaled, gym.wrappers.FlattenObservation),
    )


def main(argv=None):
    parser = robot_model.StageParser(__doc__)
    parser.add_argument("--imu", action="store_true", help="observe the torso's tilt and turning")
    parser.add_argument("--noise", action=argparse.BooleanOptionalAction, default=True)
    parser.add_argument("--steps", type=robot_model.whole, help=f"double steps (default {STEPS:,})")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_STEPS:,} steps")
    parser.add_argument("--resume", action="store_true", help="continue an interrupted training")
    parser.add_argument("--env", metavar="ID", help="train on this Gymnasium environment instead")
    parser.add_argument("--gamma", type=float, help="discount per step instead of PPOConfig's")
    args = parser.parse(argv)
    steps = QUICK_STEPS if args.quick else STEPS
    if args.steps is not None:
        steps = args.steps
    if args.env and (args.sim == "mujoco" or args.imu or args.resume):
        parser.error("--env cannot be combined with --mujoco, --imu or --resume")
    task = args.env or args.sim
    if args.env:
        cfg = GYM_CONFIG
        fits = {"simulator": task}
        make_envs = partial(gym_envs, task)
    else:
        cfg = PPOConfig()
        fits = env.fingerprint(args.sim, args.imu)
        make_envs = partial(
            env.FootstepVectorEnv, sim=args.sim, noise=args.noise, imu=args.imu, staggered=True
        )
    if args.gamma is not None:
        cfg = replace(cfg, gamma=args.gamma)
    variants = ["imu"] * args.imu + ["quick"] * args.quick
    folder = task.replace("/", "-").replace(":", "-")
    out = parser.folder(args, Path("runs", folder, *variants))
    print(f"training on {task}: {steps:,} steps, seed {args.seed}, into {out}")
    about = {"fits": fits, "imu": args.imu, "noise": args.noise}
    try:
        _, rows = train(cfg, make_envs, out, steps, args.seed, about, args.resume)
    except (PolicyError, FloatingPointError, ImportError, gym.error.Error) as error:
        parser.error(str(error))
    plot_learning_curve(rows, out / "learning_curve.png", f"PPO on {task}, seed {args.seed}")
    print(f"after {rows[-1]['minutes']:.1f} minutes: policy.pt, learning_curve.csv and .png")
    if (out / "policy.previous.pt").exists():
        print(f"the policy that was in {out} before: policy.previous.pt")
    if not args.env:
        flag = " --mujoco" * (args.sim == "mujoco")
        print(f'next: python 05_evaluate.py --noise{flag} --policy "{out / "policy.pt"}"')


if __name__ == "__main__":
    robot_model.run(main)
