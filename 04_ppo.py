"""Stage 4: how does the robot learn which footsteps to take? By trying, with PPO.

PPO (proximal policy optimization), written out so that every equation has a line to point at:

    networks: the policy π (actor) and the value V (critic)           `ActorCritic`
    repeat until all double steps are taken, here 245 times:          `train`
        (1) a rollout: 64 robots take 16 double steps each, by π      `collect`
        (2) judge each of these 1,024 actions: its advantage A, by V  `judge`, `gae`
        (3) improve both networks, with every sample ten times:       `improve`
            ρ = π(a|s) / π_old(a|s),  Â = A, standardised
            L = mean min(ρ·Â, clip(ρ, 1 ± ε)·Â)                       `clipped_objective`
            20 gradient steps (of Adam) lower −L + c_V·mean (V − target)²,
            target: our best estimate of the return, V + A
        (4) log how the episodes ended                                `episode_means`

    python 04_ppo.py                 250,000 double steps: 9 minutes, in 3-D (`--mujoco`) 22
    python 04_ppo.py --quick         60,000: 2 to 6 minutes, into runs/<sim>/quick/
    python 04_ppo.py --gamma 0.9     another setting: fields of `PPOConfig` are flags
    python 04_ppo.py --robot my.py   another robot: ROBOT, WALK, LIMITS of your file

Guess: after how many double steps do most walks arrive? To runs/<sim>/ go checkpoint.pt, the policy
so far, and at the end policy.pt and learning_curve.png (`plot_learning_curve` says what is normal).

Read down to the line of equals signs. Left out: recurrent policies, GPUs, normalised observations.
Paper: section II, "Policy" (two hidden layers of 64 neurons, a Beta distribution for each action
variable); its authors used Stable-Baselines3.
"""

import json
import math
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import gymnasium as gym
import numpy as np
import torch
from torch import nn
from torch.distributions import Beta, Independent
from tqdm import tqdm

robot_model = import_module("01_robot_model")
env = import_module("03_env")
InputError = robot_model.InputError
STEPS, QUICK_STEPS = 250_000, 60_000  # double steps; the paper: 1,000,000


@dataclass(frozen=True)
class PPOConfig:
    """The settings, each with its source: [P] the paper; [7]; [8] its default (where there is no
    entropy bonus, value clipping, or stop at a large KL, either); [own] our choice (by some
    twenty trainings). In parentheses: the name in [8].
    [7] Schulman et al., 2017: Proximal Policy Optimization Algorithms.
    [8] Raffin et al., 2021: Stable-Baselines3: Reliable Reinforcement Learning Implementations."""

    num_envs: int = 64  # N, robots that walk at the same time, `collect` (n_envs) [own]
    rollout: int = 16  # T, double steps of each robot in an update, `collect` (n_steps) [own]
    epochs: int = 10  # how often `improve` uses every sample (n_epochs) [8]
    minibatch: int = 512  # samples in a gradient step of `improve` (batch_size) [own]
    learning_rate: float = 3e-3  # of Adam at the start; it falls linearly to 0 in `train` [own]
    gamma: float = 0.95  # γ, discount per double step, `gae`: 20 ahead counts 0.95²⁰ = 0.36 [own]
    lam: float = 0.95  # λ, from 0 to 1: trust in sampled returns, `gae` (gae_lambda) [8]
    clip: float = 0.2  # ε of `clipped_objective` (clip_range) [7]
    value_coef: float = 0.5  # c_V, weight of the critic's loss in `improve` (vf_coef) [8]
    max_grad_norm: float = 0.5  # `improve` scales longer gradients down to this [8]
    hidden: tuple = (64, 64)  # neurons per hidden layer of `mlp` [P]
    first_concentration: float = 10.0  # of the first Beta policy; large: little noise [own]


# ------------------------------------------------------------------------ one update of PPO
def collect(model, envs, obs, steps):
    """(1) Lets N robots take T steps each, from the observations obs [N, …] on. Returns tensors
    [T, N, …] by name (the rollout buffer), the observations to go on from, and all infos."""
    buffer, infos = [], []
    for _ in range(steps):
        obs = obs.astype(np.float32)  # a copy: environments may reuse their arrays
        action, log_prob = model.sample(torch.from_numpy(obs))  # [N, act], [N]
        after, reward, terminated, truncated, info = envs.step(action.numpy())
        # Where an episode has ended, `after` already belongs to the next one (stage 3, SAME_STEP).
        # What really followed the action is the last observation of the ended one.
        next_obs = after.astype(np.float32)
        for i in np.flatnonzero(terminated | truncated):
            next_obs[i] = info["final_obs"][i]
        buffer.append(
            {
                "obs": obs,
                "action": action,
                "log_prob": log_prob,  # ln π_old: it stays as it is while π moves
                "next_obs": next_obs,
                "reward": reward.astype(np.float32),
                "terminated": terminated,
                "truncated": truncated,
            }
        )
        infos.append(info)
        obs = after
    data = {name: torch.from_numpy(np.stack([s[name] for s in buffer])) for name in buffer[0]}
    return data, obs, infos


# What is maximised? The policy π(a|s) is a distribution over the actions a for each observation s.
# PPO makes the average return large, G_t = r_t + γ·r_{t+1} + γ²·r_{t+2} + …, with the reward r_t of
# a step and the discount γ, a little below 1.
#   value      V(s) = E[G_t | s]: the average return from s on; learned by the critic
#   advantage  A_t: how much better the action was than the average one, about G_t − V(s_t)
# A step along the gradient of A_t·ln π(a_t|s_t) makes good actions more likely, and bad ones less.
# (Why this one? See `policy_ratio`.)
def gae(rewards, values, next_values, terminated, truncated, gamma, lam):
    """(2) Advantages A_t by generalised advantage estimation (GAE: Schulman et al., 2015, arXiv
    1506.02438); everything [T, N].

    next_values[t] is V of what really followed step t. (After a fall it does not count.)
    The action of one step gave r_t + γ·V(s_{t+1}), and V(s_t) was expected. The difference is
        δ_t = r_t + γ·V(s_{t+1}) − V(s_t).
    Three estimates of the advantage are made of it, here without the end of an episode:
        one step     δ_t                  little noise, but wrong where the critic is wrong
        two steps    δ_t + γ·δ_{t+1}      = r_t + γ·r_{t+1} + γ²·V(s_{t+2}) − V(s_t)
        all steps    Σ_k γᵏ·δ_{t+k}       = G_t − V(s_t): noisy, but a wrong V(s_t) shifts the A of
                                          all actions alike, which changes no gradient on average
    λ between 0 (the first of them) and 1 (the last one) lets later δ fade:
        A_t = Σ_k (γλ)ᵏ·δ_{t+k}           so δ 10 steps ahead counts (0.95·0.95)¹⁰ = 0.36

    The sum stops where an episode ends. What counts after its end depends on how it ended:
        terminated   (a fall, or the goal) There is no future: V(s_{t+1}) counts as 0.
        truncated    (the time is up) The walk would have gone on, we only stopped recording it. So
                     V of its LAST observation stands for the rest ("bootstrapping"), never V of the
                     next episode's first one.
    Where the rollout ends within an episode, V stands for the rest, too."""
    future = next_values.masked_fill(terminated, 0)
    deltas = rewards + gamma * future - values  # r_t + γ·(1 − terminated_t)·V(s_{t+1}) − V(s_t)
    goes_on = ~(terminated | truncated)  # the sum stops at a fall, at the goal AND at a cut-off
    advantages = torch.empty_like(rewards)
    advantage = torch.zeros_like(rewards[0])  # [N] of the step after this one; after the last: 0
    for t in reversed(range(len(rewards))):  # A_t = δ_t + γ·λ·A_{t+1} within one episode
        advantage = deltas[t] + gamma * lam * (goes_on[t] * advantage)
        advantages[t] = advantage
    return advantages


def clipped_objective(ratio, advantage, clip):
    """What PPO maximises, for each sample; ratio ρ = π(a|s) / π_old(a|s). The samples come from
    π_old while π moves on, so ρ weighs them: Σ π_old·ρ·A = Σ π·A. Once ρ has moved far enough in
    the good direction there is nothing more to gain: for A > 0 the objective is flat where
    ρ > 1 + ε, for A < 0 where ρ < 1 − ε. A ρ that has moved the other way keeps its gradient, which
    brings it back. Hence the minimum. (ε is no bound: other samples move π, too, and ρ with it.)"""
    # min(ρ·A, clip(ρ, 1 − ε, 1 + ε)·A)
    return torch.min(ratio * advantage, ratio.clamp(1.0 - clip, 1.0 + clip) * advantage)


def judge(model, data, cfg):
    """(2) The advantages and the critic's targets, [T, N] each; data: as by `collect`."""
    with torch.no_grad():
        values = model.value(data["obs"])  # [T, N]
        advantages = gae(
            data["reward"],
            values,
            model.value(data["next_obs"]),
            data["terminated"],
            data["truncated"],
            cfg.gamma,
            cfg.lam,
        )
        # The critic's output should be G_t. Our best estimate of G_t: V(s_t) + A_t
        return advantages, values + advantages


def improve(model, optimizer, data, cfg):
    """(3) Takes gradient steps on a rollout; data: as by `collect`, with advantage, target [T, N].
    Returns numbers over all samples: from before these steps entropy and explained_variance; from
    after them clip_fraction, approx_kl and value_loss."""
    samples = {name: values.flatten(0, 1) for name, values in data.items()}  # [B, …], B = T·N
    obs, action, old_log_prob = samples["obs"], samples["action"], samples["log_prob"]
    advantages, targets = samples["advantage"], samples["target"]
    with torch.no_grad():
        entropy = model.policy(obs).entropy().mean()  # [nats]
    # For the log, see `plot_learning_curve`:  1 − Var[target − V] / Var[target],  target − V = A
    explained_variance = 1.0 - advantages.var() / targets.var()

    for _ in range(cfg.epochs):
        for pick in torch.randperm(len(obs)).split(cfg.minibatch):  # [minibatch]
            ratio = policy_ratio(model, obs[pick], action[pick], old_log_prob[pick])
            # Â = (A − mean) / std: is an action better or worse than the others in the minibatch?
            # (correction=0 divides by their number: of a single sample std is 0, not nan.)
            chosen = advantages[pick]
            standardised = (chosen - chosen.mean()) / (chosen.std(correction=0) + 1e-8)
            # L_V = mean (V(s) − target)²;   loss = −L + c_V·L_V
            critic_loss = nn.functional.mse_loss(model.value(obs[pick]), targets[pick])
            objective = clipped_objective(ratio, standardised, cfg.clip).mean()
            loss = -objective + cfg.value_coef * critic_loss
            optimizer.zero_grad()
            loss.backward()
            # Both gradients are limited together. (Adam divides a common factor out again.)
            nn.utils.clip_grad_norm_(model.parameters(), cfg.max_grad_norm)
            optimizer.step()

    with torch.no_grad():  # for the log: the policy after the update against π_old
        log_ratio = model.policy(obs).log_prob(action) - old_log_prob  # ln ρ
        outside = ((log_ratio.exp() - 1).abs() > cfg.clip).float()  # of [1 − ε, 1 + ε]
        # KL(π_old‖π) = E[−ln ρ] [nats], the mean over π_old. As E[ρ − 1] = 0,
        # it is also that of (ρ − 1) − ln ρ, which has less noise, because ln ρ ≈ ρ − 1.
        kl = torch.expm1(log_ratio) - log_ratio
        return {
            "entropy": entropy.item(),
            "explained_variance": explained_variance.item(),
            "clip_fraction": outside.mean().item(),
            "approx_kl": kl.mean().item(),
            "value_loss": nn.functional.mse_loss(model.value(obs), targets).item(),
        }


# ------------------------------------------------------------------------ the loop
def episode_means(infos):
    """(4) The means over the episodes that ended in these steps; nan where nothing was reported.
    "return" is not discounted; "time" is that of the successes."""
    found = {name: [] for name in ("return", "success", "fall", "timeout", "time")}
    for info in infos:
        if "_episode" in info:  # [N] whose episode has ended
            ended, final = info["_episode"], info["final_info"]
            found["return"].extend(info["episode"]["r"][ended])
            if "success" in final:  # other environments report no outcome
                for name in "success", "fall", "timeout":
                    found[name].extend(final[name][ended])
                found["time"].extend(final["time"][ended & final["success"]])
    return {name: float(np.mean(values or [np.nan])) for name, values in found.items()}


@contextmanager
def one_thread():
    """PyTorch computes on the CPU, whatever a notebook's default is, and with one thread: quicker
    here, and core counts change no rounding."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with torch.device("cpu"):
            yield
    finally:
        torch.set_num_threads(threads)


@one_thread()
def train(cfg, make_envs, out, total_steps, seed=0, make_model=None, improve=improve, **about):
    """Trains for `total_steps` steps of all robots together, or a few more; returns (model, rows of
    the log), and writes files into the folder `out`, a Path. make_envs(num_envs) -> vector
    environment with AutoresetMode.SAME_STEP and actions in [0, 1]; make_model: of another class
    than `ActorCritic`; improve: another one; about: is stored with the policy."""
    samples = cfg.num_envs * cfg.rollout  # steps of all robots in an update
    updates = math.ceil(total_steps / samples)
    envs = gym.wrappers.vector.RecordEpisodeStatistics(make_envs(cfg.num_envs))
    world = getattr(envs.unwrapped, "world", None)  # environments of another task have none
    about |= {"seed": seed, "steps": updates * samples, "config": cfg}
    about["fits"] = fingerprint(world) if world else None
    checkpoint = out / "checkpoint.pt"  # before the first update, too: another training sees it
    if checkpoint.exists():
        print(f"{checkpoint} is replaced: of a training that was stopped, or still runs there")
    torch.manual_seed(seed)  # of the first weights
    model = first_model(envs, cfg, make_model or ActorCritic)
    # All other random numbers follow from another seed, which the first one determines.
    next_seed = int(np.random.SeedSequence([seed, 1]).generate_state(1)[0])
    torch.manual_seed(next_seed)
    obs, _ = envs.reset(seed=next_seed)
    # foreach: one call for all weights, which is quicker; eps as in [8]
    optimizer = torch.optim.Adam(model.parameters(), eps=1e-5, foreach=True)
    rows = []
    bar = tqdm(range(updates), unit=" steps", unit_scale=samples)
    for update in bar:
        save_policy(checkpoint, model, **about)
        rate = cfg.learning_rate * (1.0 - update / updates)  # falls linearly to 0
        optimizer.param_groups[0]["lr"] = rate
        data, obs, infos = collect(model, envs, obs, cfg.rollout)  # (1)
        data["advantage"], data["target"] = judge(model, data, cfg)  # (2)
        numbers = improve(model, optimizer, data, cfg)  # (3)
        if not math.isfinite(numbers.get("value_loss", 0)):
            raise InputError(f"update {update + 1}: the loss is not finite")
        numbers |= episode_means(infos)  # (4)
        rows.append({"steps": (update + 1) * samples, **numbers, "learning_rate": rate})
        bar.set_description(
            f"success {numbers['success']:.2f}, falls {numbers['fall']:.2f}, "
            f"return {numbers['return']:.2f}"
        )
    envs.close()
    save_policy(out / "policy.pt", model, **about)
    lines = [",".join(rows[0])]
    lines += [",".join(f"{value:.9g}" for value in row.values()) for row in rows]
    robot_model.write_text(out / "learning_curve.csv", "\n".join(lines) + "\n")
    checkpoint.unlink(missing_ok=True)  # another training into this folder may have ended before
    return model, rows


# ==================================================================== the end of a first reading
# ------------------------------------------------------------------------ the policy gradient
def policy_ratio(model, obs, action, old_log_prob):
    """ρ = π(a|s) / π_old(a|s) of n samples [n]. Its gradient is ρ·∇ln π(a|s), so before the first
    step, where ρ is 1, that of ρ·A is A·∇ln π. Why is this the right direction?

    The policy gradient says how the average return changes with the policy's parameters (∇). First
    for one decision (for continuous actions Σ is an integral):
        E[G] = Σ_a π(a)·G(a).   As ∇π = π·∇ln π:   ∇E[G] = Σ_a π·G·∇ln π = E[G·∇ln π].
    A number b, the same for all actions, changes nothing: as Σ_a π = 1, E[b·∇ln π] = b·Σ_a ∇π = 0.
    So we may subtract b = V(s), usually with less noise: E[A·∇ln π].
    An episode is many decisions. Its probability is the product of all π(a_t|s_t)·p(s_{t+1}|s_t,
    a_t), where p is what the world does. So its logarithm is a sum, and the terms of the world, ln
    p, do not depend on our parameters. The rewards before a decision do not depend on its action,
    so they drop out like b. The gradients of all decisions add up: E[Σ_t A_t·∇ln π(a_t|s_t)]. (We
    leave out a factor γᵗ, as nearly everybody: with it late decisions would hardly be learned.)"""
    return (model.policy(obs).log_prob(action) - old_log_prob).exp()


# ------------------------------------------------------------------------ the networks
def mlp(sizes, last_gain):
    """Linear layers with tanh between them. The first weights are random, orthogonal, as in [8]."""
    layers = []
    for inputs, outputs in zip(sizes[:-1], sizes[1:]):
        linear = nn.Linear(inputs, outputs, dtype=torch.float32, device="cpu")
        nn.init.orthogonal_(linear.weight, 2**0.5)
        nn.init.zeros_(linear.bias)
        layers += [linear, nn.Tanh()]
    layers.pop()  # no tanh behind the last layer
    nn.init.orthogonal_(layers[-1].weight, last_gain)
    return nn.Sequential(*layers)


class ActorCritic(nn.Module):
    """Two separate networks: the actor proposes actions, the critic predicts the return V(s).

    Each action variable x in [0, 1] has a Beta distribution, p(x) ∝ x^(α−1)·(1−x)^(β−1): a single
    hump, as α, β > 1. (Stage 3 has other α, β.) In the paper the actor's outputs are α and β. Ours
    say where the hump's top is, the mode m, and how narrow it is, the concentration c = α + β:
        m = (α − 1) / (c − 2),   so   α = 1 + (c − 2)·m,   β = 1 + (c − 2)·(1 − m)
    Training uses sampled actions, evaluation the mode, as in the paper. A policy begins like the
    first of these humps, and a training makes it as narrow as the second one (here with m = 0.4):
        c = 10, σ = 0.15   0    ▁▁▂▃▄▅▅▆▇▇█████▇▇▆▆▅▄▄▃▂▂▁▁▁         1
        c = 70, σ = 0.06   0           ▁▂▄▆▇█▇▆▄▂▁                   1"""

    def __init__(self, obs_dim, act_dim, hidden=(64, 64), first_action=0.5, concentration=10.0):
        super().__init__()
        self.sizes = {"obs_dim": obs_dim, "act_dim": act_dim, "hidden": hidden}  # for the file
        self.actor = mlp((obs_dim, *hidden, 2 * act_dim), last_gain=0.01)
        self.critic = mlp((obs_dim, *hidden, 1), last_gain=1.0)
        # The last weights are small, so the first outputs are nearly the bias x. It is chosen so
        # that `policy` gives the mode first_action (a number or [act_dim], kept within 0.01 …
        # 0.99) and this concentration: m = 1 / (1 + e⁻ˣ) (sigmoid), c − 2 = ln(1 + eˣ) (softplus).
        mode = torch.as_tensor(first_action, dtype=torch.float32, device="cpu")
        mode = mode.expand(act_dim).clamp(0.01, 0.99)
        y = torch.full_like(mode, concentration - 2.0)  # x = ln(eʸ − 1) = y + ln(1 − e⁻ʸ)
        self.actor[-1].bias.data = torch.cat([mode.logit(), y + (1 - (-y).exp()).log()])

    def value(self, obs):
        """The critic's V(s): [..., obs] -> [...]."""
        return self.critic(obs).squeeze(-1)

    def policy(self, obs):
        """π(·|s): [..., obs] -> a distribution over actions [..., act]."""
        raw_mode, raw_c = self.actor(obs).chunk(2, dim=-1)
        mode = raw_mode.sigmoid()
        # Limits for float32: ln π(a|s) stays finite, and the hump has a top
        c_minus_2 = nn.functional.softplus(raw_c).clamp(1e-3, 1e3)
        alpha, beta = 1.0 + c_minus_2 * mode, 1.0 + c_minus_2 * (1.0 - mode)
        # 1: so ln π(a|s) is the sum over the last axis, the variables of an action. (PyTorch's
        # checks of the values cost time.)
        return Independent(Beta(alpha, beta, validate_args=False), 1, validate_args=False)

    def sample(self, obs):
        """Random actions of the policy, to explore, and ln π of each; [N, obs] -> [N, act], [N]."""
        with torch.no_grad():
            policy = self.policy(obs)
            # Exactly 0 or 1 would have an infinite log-probability.
            action = policy.sample().clamp(1e-6, 1.0 - 1e-6)
            return action, policy.log_prob(action)

    def decide(self, obs):
        """The mode, without exploring ([8]: deterministic); arrays: [N, obs] -> [N, act]."""
        with torch.no_grad():
            return self.policy(torch.as_tensor(obs, dtype=torch.float32, device="cpu")).mode.numpy()


def first_model(envs, cfg, make_model):
    """A model for these environments, whose policy is around the neutral action, or else 0.5."""
    space = gym.spaces.Box(0, 1, envs.single_action_space.shape)
    mode = envs.metadata.get("autoreset_mode")
    if envs.single_action_space != space or mode != gym.vector.AutoresetMode.SAME_STEP:
        raise InputError("needs environments with actions in [0, 1] and AutoresetMode.SAME_STEP")
    sizes = envs.single_observation_space.shape[0], space.shape[0], cfg.hidden
    first_action = getattr(envs.unwrapped, "neutral_action", 0.5)
    return make_model(*sizes, first_action, cfg.first_concentration)


# ------------------------------------------------------------------------ files
def as_json(value):
    """The value as numbers, texts, lists and dicts. (numpy's could be written, but not be read.)"""
    return json.loads(
        json.dumps(
            value, default=lambda part: part.tolist() if hasattr(part, "tolist") else vars(part)
        )
    )


def fingerprint(world):
    """What a policy is trained in, as plain values by name."""
    return as_json(
        {
            "simulator": world.sim,
            "observation": [row[0] for row in env.OBSERVATION],
            "walk": world.engine.parameters,
            "step limit": world.limits,
            "task": world.task,
            "spread": world.spread,
            "drift": world.drift,
            "robot": world.engine.robot,
        }
    )


def save_policy(path, model, **about):
    """Writes the model and `about`. The name of the weights says what the actor's outputs mean."""
    stored = as_json(about | model.sizes) | {"mode_and_concentration": model.state_dict()}
    robot_model.atomic_write(path, lambda file: torch.save(stored, file))


def load_policy(path, make_model=ActorCritic):
    """The model in a file of ours, and all that the file holds. Foreign code in it is never run."""
    try:
        stored = torch.load(path, map_location="cpu", weights_only=True)
        model = make_model(stored["obs_dim"], stored["act_dim"], stored["hidden"])
        model.load_state_dict(stored["mode_and_concentration"])
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except Exception as error:  # torch raises many types, with messages of many lines
        raise InputError(f"{path}: damaged, or not written by this 04_ppo.py") from error
    return model, stored


# ------------------------------------------------------------------------ the picture
PANELS = {  # title and unit: column
    "THE ROBOT\nsuccesses [share of walks]": "success",
    "THE LEARNER\nentropy of the policy, may be < 0 [nats]": "entropy",
    "falls [share of walks]": "fall",
    "samples outside of 1 ± ε [share]": "clip_fraction",
    "time to the goal [s]": "time",
    "change of the policy, KL [nats]": "approx_kl",
    "return, not discounted [1]": "return",
    "explained variance of the critic [1]": "explained_variance",
}


def plot_learning_curve(rows, path, title):
    """Draws the log: a dot for each update, and a line, the mean over a twentieth of them.
    What is normal? (The means of the first and of the last fifth of both shipped trainings.)
        successes   near 1, but for update 11, when the first episodes run out of time together.
        falls       0 -> 0.001 (3-D), 0.003 (2-D): a robot that learns to be quick falls sometimes.
        time        falls, after update 11. (Until then only short walks have ended.)
        entropy     falls: how random the policy is, in nats (with natural logarithms).
        outside     0.41 -> 0.21 of the samples. ([8] logs a smaller mean, over its gradient steps.)
        KL          0.036 -> 0.015 nats: how far a rollout moves the policy (Kullback-Leibler). KL
                    and *outside* fall because the learning rate does, not because all is learned.
        explained   less than 0.1 -> 0.2: how much of the differences between the critic's targets
        variance    does V predict? 1: all; 0: none; below 0: it is worse than their mean. Even the
                    true goal tells little of what a walk will return (projects.md). At first the
                    targets V + A hold an untrained V, and this says nothing."""
    steps = np.array([row["steps"] for row in rows]) / 1000  # [U]
    width = len(rows) // 20 + 1
    weights = np.ones(width) / width  # of the updates in a mean
    figure = robot_model.Figure(figsize=(9, 11))
    grid = figure.subplots(4, 2, sharex=True)
    grid[2, 0].set_yscale("log")  # of the time
    for axes, (name, column) in zip(grid.flat, PANELS.items()):
        values = [row.get(column, np.nan) for row in rows]
        axes.plot(np.convolve(steps, weights, "valid"), np.convolve(values, weights, "valid"), "m")
        axes.plot(steps, values, "m.", alpha=0.2)
        axes.set_title(name)
    axes.set_ylim(-0.5, 1.05)  # of the last panel: while all returns are alike it may be −10
    figure.supxlabel("double steps of all robots [thousands]")
    figure.suptitle(f"{title}; dots: updates, lines: means of a twentieth of them")
    robot_model.save_figure(figure, path)


# ------------------------------------------------------------------------ command line
# From, to. (All other settings: from 0 on, and whole numbers from 1 on.)
RANGES = {"gamma": (0, 1), "lam": (0, 1), "first_concentration": (2.001, 1000)}


def main(argv=None):
    parser = robot_model.stage_parser(__doc__)
    add = parser.add_argument
    add("--steps", type=int, help=f"Train for so many double steps (default {STEPS:,}).")
    add("--quick", action="store_true")
    add("--robot", type=Path, help="Train this robot. (The filter's DRIFT stays that of ours.)")
    usual = vars(PPOConfig())
    del usual["hidden"]
    for name, value in usual.items():
        flags = sorted({f"--{name}", f"--{name.replace('_', '-')}"})
        add(*flags, type=type(value), default=value, help="default %(default)s")
    args = parser.parse_args(argv)
    if args.steps is None:
        args.steps = QUICK_STEPS if args.quick else STEPS
    for name in ("steps", *usual):
        value = getattr(args, name)
        low, high = RANGES.get(name, (int(isinstance(value, int)), math.inf))
        if not low <= value <= high:
            parser.error(f"--{name} from {low} to {high}, not {value}")
    cfg = PPOConfig(**{name: getattr(args, name) for name in usual})
    own = env.robot_settings(args.robot, args.sim) if args.robot else {}
    out = robot_model.output_folder(args, "quick" * args.quick)
    print(
        f"training on {args.sim}: {args.steps:,} steps or a few more, seed {args.seed}, in {out}\n"
        "(Ctrl-C stops it; checkpoint.pt is the policy so far)"
    )
    _, rows = train(
        cfg,
        lambda count: env.FootstepVectorEnv(count, args.sim, noise=True, **own),
        out,
        args.steps,
        args.seed,
    )
    plot_learning_curve(rows, out / "learning_curve.png", f"PPO on {args.sim}, seed {args.seed}")
    flags = " --mujoco" * (args.sim == "mujoco") + f' --robot "{args.robot}"' * bool(args.robot)
    print(
        f"policy.pt, learning_curve.csv and learning_curve.png are in {out}\n"
        "Compare the policy with other planners:\n"
        f'    python 05_evaluate.py --noise{flags} --policy "{out / "policy.pt"}"'
    )


if __name__ == "__main__":
    robot_model.run_script(main)
