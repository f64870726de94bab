"""Stage 4: how does the robot learn which footsteps to take? By trying, with PPO.

Paper: section II, "Policy" (two hidden layers of 64 neurons, a Beta distribution for each action
variable), trained with PPO, proximal policy optimization [7]. The paper used the PPO of
Stable-Baselines3 [8]. Here PPO is written out, so that every equation has a line to point at:

    networks: the policy π (actor) and the value V (critic)           `ActorCritic`
    repeat until all double steps are taken:                          `learn`
        (1) a rollout: N robots take T double steps each, by π        `collect`
        (2) judge every action: its advantage A, by V                 `gae`
        (3) improve both networks, with every sample ten times:       `improve`
            ρ = π(a|s) / π_old(a|s),  Â = A, standardised
            L = mean min(ρ·Â, clip(ρ, 1 ± ε)·Â)                       `clipped_objective`
            a gradient step (of Adam) lowers −L + c_V·mean (V − target)²,
            target: our best estimate of the return, V + A
        (4) log how the episodes ended                                `episode_means`

What is the critic worth? With V = 0 the robot takes 2 to 8 % more time to a goal, and a pendulum is
not swung up at all (results/STUDIES.md, *ladder*).

    python 04_ppo.py                 250,000 double steps of the planar robot (`--mujoco`: in 3-D)
    python 04_ppo.py --quick         60,000 double steps, in two minutes, into runs/<sim>/quick/
    python 04_ppo.py --gamma 0.9     another setting: all fields of `PPOConfig` but `hidden` are flags
    python 04_ppo.py --resume        continue a stopped training (same flags), with fresh episodes

During the training, checkpoint.pt in runs/<sim>/ holds the policy so far, for --resume and for
stage 5. At the end the stage writes policy.pt, learning_curve.csv and learning_curve.png there.
(`plot_learning_curve` says what is normal in this picture.) The goal is measured with noise.

Read down to the line of equals signs. Below it are the policy gradient, the networks, `train`,
which keeps the files of a training, the picture, and the command line.

Leaves out: recurrent policies, normalisation of observations and rewards, GPUs; and what [8] can do
but does not do by default: an entropy bonus, value clipping, a stop at a large KL.
[7] Schulman et al.: Proximal Policy Optimization Algorithms, 2017, arXiv 1707.06347.
[8] Raffin et al.: Stable-Baselines3: Reliable Reinforcement Learning Implementations, 2021.
[GAE] Schulman et al.: High-Dimensional Continuous Control Using GAE, 2015, arXiv 1506.02438.
"""

import json
import math
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module

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
    """The settings, each with its source: [P] the paper; [7]; [8] its default; [own] our choice
    (how: results/STUDIES.md, *ladder*). In parentheses: the name in [8]."""

    num_envs: int = 64  # N, robots that walk at the same time, `collect` (n_envs) [own]
    rollout: int = 16  # T, double steps of each robot in an update, `collect` (n_steps) [own]
    epochs: int = 10  # how often `improve` uses every sample (n_epochs) [8]
    minibatch: int = 512  # samples in a gradient step of `improve` (batch_size) [own]
    learning_rate: float = 3e-3  # of Adam at the start; it falls linearly to 0 in `learn` [own]
    gamma: float = 0.95  # γ, discount per double step, `gae`: 20 ahead counts 0.95²⁰ = 0.36 [own]
    lam: float = 0.95  # λ, from 0 to 1: trust in sampled returns, `gae` (gae_lambda) [8]
    clip: float = 0.2  # ε of `clipped_objective` (clip_range) [7]
    value_coef: float = 0.5  # c_V, weight of the critic's loss in `improve` (vf_coef) [8]
    max_grad_norm: float = 0.5  # `improve` scales longer gradients down to this [8]
    hidden: tuple = (64, 64)  # neurons per hidden layer of `mlp` [P]
    first_concentration: float = 10.0  # of the first Beta policy; large: little noise [own]


# ------------------------------------------------------------------------ one update of PPO
def collect(model, envs, obs, steps):
    """(1) Lets N robots take T steps each, from the observations obs [N, …] on.
    Returns tensors [T, N, …] by name (the rollout buffer), the observations to go on from, and the
    infos of every step."""
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
        buffer.append(
            {
                "obs": obs,
                "action": action,
                "next_obs": next_obs,
                "reward": reward.astype(np.float32),
                "terminated": terminated,
                "truncated": truncated,
            }
        )
        infos.append(info)
        obs = after
    data = {name: torch.as_tensor(np.stack([s[name] for s in buffer])) for name in buffer[0]}
    return data, obs, infos


# What is maximised? The policy π(a|s) is a distribution over the actions a for each observation s.
# The return from step t on is G_t = r_t + γ·r_{t+1} + γ²·r_{t+2} + …, with the reward r_t of a step
# and the discount γ, a little below 1. PPO makes its average large.
#   value      V(s) = E[G_t | s]: the average return from s on; learned by the critic
#   advantage  A_t: how much better the action was than the average one, about G_t − V(s_t)
# A step along the gradient of A_t·ln π(a_t|s_t) makes good actions more likely, and bad ones less.
# (Why this one? See "the policy gradient", below the line.)
def gae(rewards, values, next_values, terminated, truncated, gamma, lam):
    """(2) Advantages A_t by generalised advantage estimation [GAE]; everything [T, N].

    next_values[t] is V of what really followed step t. (Behind a fall it may be anything, or nan.)
    The action of one step gave r_t + γ·V(s_{t+1}), and V(s_t) was expected. The difference is
        δ_t = r_t + γ·V(s_{t+1}) − V(s_t).
    Three estimates of the advantage are made of it, here without the end of an episode:
        one step     δ_t                  little noise, but wrong where the critic is wrong
        two steps    δ_t + γ·δ_{t+1}      = r_t + γ·r_{t+1} + γ²·V(s_{t+2}) − V(s_t): the V between
                                          cancels
        all steps    Σ_k γᵏ·δ_{t+k}       = G_t − V(s_t): right on average, but noisy (a wrong
                                          V(s_t) is the same for all actions, so it cancels)
    λ between 0 (the first of them) and 1 (the last one) lets later δ fade:
        A_t = Σ_k (γλ)ᵏ·δ_{t+k}           so δ 10 steps ahead counts (0.95·0.95)¹⁰ = 0.36

    A fall, the goal and a cut-off all end an episode, and the sum. After a fall, or at the goal
    (terminated), there is no future: the later rewards are 0. After a cut-off (truncated: the
    time is up) the world would have gone on; only our recording stopped. A 0 would pull V
    towards 0 there: down where walking pays, and up where it only costs, as for a robot that
    does not find its goal. So V of the LAST observation of that episode stands for the rest
    ("bootstrapping"), and never V of the next episode's first one. The same holds where a
    rollout ends within an episode."""
    after = next_values.masked_fill(terminated, 0)  # not "· 0", as nan · 0 = nan
    deltas = rewards + gamma * after - values  # r_t + γ·(1 − terminated_t)·V(s_{t+1}) − V(s_t)
    goes_on = ~(terminated | truncated)  # the sum stops at a fall, at the goal AND at a cut-off
    advantages = torch.empty_like(rewards)
    next_advantage = torch.zeros_like(rewards[0])  # [N] A_{t+1}
    for t in reversed(range(len(rewards))):  # A_t = δ_t + γ·λ·A_{t+1} within one episode
        next_advantage = deltas[t] + gamma * lam * (goes_on[t] * next_advantage)
        advantages[t] = next_advantage
    return advantages


def clipped_objective(ratio, advantage, clip):
    """What PPO maximises, for each sample; ratio ρ = π(a|s) / π_old(a|s).
    PPO uses a sample several times while the policy moves on, so it weights the sample by ρ. (At
    ρ = 1 the gradient of ρ·A is A·∇ln π.) For a good action (A > 0) the objective is constant where
    ρ > 1 + ε, for a bad one (A < 0) where ρ < 1 − ε. There this sample moves no policy. It is no
    bound: others move it on, and here 44 % end outside of 1 ± ε at first, 23 % at the end. If ρ has
    moved against A, the unclipped product is the smaller one and keeps its gradient. Hence the
    minimum."""
    # min(ρ·A, clip(ρ, 1 − ε, 1 + ε)·A)
    return torch.min(ratio * advantage, ratio.clamp(1.0 - clip, 1.0 + clip) * advantage)


def advantages_and_targets(model, data, cfg):
    """(2) The advantages, the critic's targets and log π_old, [B] each, B = T·N; data: tensors
    [T, N, …]."""
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
        targets = values + advantages
        # π_old is the model as it is now, before the first gradient step.
        old_log_prob = model.policy(data["obs"]).log_prob(data["action"])
    return advantages.flatten(), targets.flatten(), old_log_prob.flatten()


def improve(model, optimizer, data, cfg):
    """(3) Takes gradient steps on a rollout, data: tensors [T, N, …]. Returns numbers over all
    samples: from before these steps entropy and explained_variance; from after them clip_fraction,
    approx_kl and value_loss."""
    advantages, targets, old_log_prob = advantages_and_targets(model, data, cfg)  # [B] each
    obs, action = data["obs"].flatten(0, 1), data["action"].flatten(0, 1)  # [B, …]
    with torch.no_grad():
        entropy = model.policy(obs).entropy().mean()  # [nats]
        # For the log, see `plot_learning_curve`:  1 − Var[target − V] / Var[target]
        unexplained = (targets - model.value(obs)).var() / targets.var()
    for _ in range(cfg.epochs):
        for pick in torch.randperm(len(obs)).split(cfg.minibatch):  # [minibatch]
            ratio = (model.policy(obs[pick]).log_prob(action[pick]) - old_log_prob[pick]).exp()
            # Â = (A − mean) / std over the minibatch: is an action better or worse than the others?
            # So the actor's loss does not depend on the unit of the rewards. (The critic's does,
            # and both gradients are limited together.)
            a = advantages[pick]
            a = (a - a.mean()) / (a.std(correction=0) + 1e-8)  # (of a single sample: 0, not nan)
            # L_V = mean (V(s) − target)²;   loss = −L + c_V·L_V
            critic_loss = nn.functional.mse_loss(model.value(obs[pick]), targets[pick])
            loss = -clipped_objective(ratio, a, cfg.clip).mean() + cfg.value_coef * critic_loss
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(model.parameters(), cfg.max_grad_norm)
            optimizer.step()
    with torch.no_grad():  # for the log: the policy after the update against π_old
        log_ratio = model.policy(obs).log_prob(action) - old_log_prob
        outside = ((log_ratio.exp() - 1).abs() > cfg.clip).float()  # of [1 − ε, 1 + ε]
        return {
            "entropy": entropy.item(),
            "explained_variance": 1.0 - unexplained.item(),
            "clip_fraction": outside.mean().item(),
            "approx_kl": (torch.expm1(log_ratio) - log_ratio).mean().item(),
            "value_loss": nn.functional.mse_loss(model.value(obs), targets).item(),
        }


# ------------------------------------------------------------------------ the loop
def episode_means(infos):
    """(4) The means over the episodes that ended in these steps; nan where nothing was reported.
    "return": the sum of an episode's rewards, not discounted; "time": of the successes."""
    ended = {name: [] for name in ("return", "length", "success", "fall", "timeout", "time")}
    for info in infos:
        for i in np.flatnonzero(info.get("_episode", [])):  # robots whose episode has ended
            ended["return"].append(info["episode"]["r"][i])
            ended["length"].append(info["episode"]["l"][i])
            final = info["final_info"]  # other environments do not report an outcome
            for name in ended.keys() & final.keys():
                if name != "time" or final["success"][i]:
                    ended[name].append(final[name][i])
    return {name: float(np.mean(values or [np.nan])) for name, values in ended.items()}


def learn(model, optimizer, envs, cfg, updates, first=0, seed=None, improve=improve):
    """Runs the loop, from update `first` on; after every update yields numbers by name.
    improve(model, optimizer, data, cfg) changes the model, and returns some of these numbers."""
    obs, _ = envs.reset(seed=seed)
    for update in range(first, updates):
        rate = float(cfg.learning_rate * (1.0 - update / updates))  # falls linearly to 0
        optimizer.param_groups[0]["lr"] = rate
        data, obs, infos = collect(model, envs, obs, cfg.rollout)  # (1)
        numbers = improve(model, optimizer, data, cfg)  # (2), (3)
        if not math.isfinite(numbers.get("value_loss", 0)):
            raise InputError(f"update {update + 1}: the loss is not finite")
        yield {**numbers, **episode_means(infos), "learning_rate": rate}  # (4)


# ==================================================================== the end of a first reading
# ------------------------------------------------------------------------ the policy gradient
# It says how the average changes with the policy's parameters; ∇ is the gradient with respect to
# these. First for one decision (for continuous actions Σ is an integral):
#   E[G] = Σ_a π(a)·G(a).   As ∇π = π·∇ln π:   ∇E[G] = Σ_a π·G·∇ln π = E[G·∇ln π].
#   A number b, the same for all actions, changes nothing: as Σ_a π = 1, E[b·∇ln π] = b·Σ_a ∇π = 0.
#   So we may subtract b = V(s), usually with less noise: E[A·∇ln π].
# An episode is many decisions. Its probability is the product of all π(a_t|s_t)·p(s_{t+1}|s_t,
# a_t), where p is what the world does. So the logarithm is a sum, and the terms of the world, ln p,
# do not depend on our parameters. The rewards before a decision do not depend on its action, so
# they drop out like b. The gradients of the decisions are added: E[Σ_t A_t·∇ln π(a_t|s_t)]. (We
# leave out a factor γᵗ, as nearly everybody does: with it late decisions would hardly be learned.)


# ------------------------------------------------------------------------ the networks
def mlp(sizes, last_gain):
    """Linear layers with tanh between them. The first weights are random, orthogonal, as in [8]."""
    layers = []
    for inputs, outputs in zip(sizes[:-1], sizes[1:]):
        linear = nn.Linear(inputs, outputs, dtype=torch.float32)
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
    say where the hump's top is, the mode m, and how narrow it is, the concentration c = α + β.
    Training uses sampled actions, evaluation the mode, as in the paper.
        m = (α − 1) / (c − 2),   so   α = 1 + (c − 2)·m,   β = 1 + (c − 2)·(1 − m)"""

    def __init__(self, obs_dim, act_dim, hidden=(64, 64), first_action=0.5, concentration=10.0):
        super().__init__()
        self.sizes = {"obs_dim": obs_dim, "act_dim": act_dim, "hidden": hidden}  # for the file
        self.actor = mlp((obs_dim, *hidden, 2 * act_dim), last_gain=0.01)
        self.critic = mlp((obs_dim, *hidden, 1), last_gain=1.0)
        # The last weights are small, so the first outputs x are nearly the bias. The bias is chosen
        # so that `policy` gives the mode first_action (a number or [act_dim], kept within 0.01 …
        # 0.99) and this concentration: m = 1 / (1 + e⁻ˣ) (sigmoid), c − 2 = ln(1 + eˣ) (softplus).
        mode = torch.as_tensor(first_action, dtype=torch.float32).expand(act_dim).clamp(0.01, 0.99)
        c_minus_2 = torch.full_like(mode, concentration - 2.0)
        # Both are solved for x
        self.actor[-1].bias.data = torch.cat([mode.logit(), c_minus_2.expm1().log()])

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
        """Random actions of the policy, to explore; tensors: [N, obs] -> [N, act]."""
        with torch.no_grad():
            # Exactly 0 or 1 would have an infinite log-probability.
            return self.policy(obs).sample().clamp(1e-6, 1.0 - 1e-6)

    def decide(self, obs):
        """The mode, without exploring ([8]: deterministic); arrays: [N, obs] -> [N, act]."""
        with torch.no_grad(), one_thread():
            return self.policy(torch.as_tensor(obs, dtype=torch.float32)).mode.numpy()


# ------------------------------------------------------------------------ a whole training
@contextmanager
def one_thread():
    """PyTorch computes with one thread: quicker here, and core counts change no rounding."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


@one_thread()
def train(
    cfg,
    make_envs,
    out,
    total_steps,
    seed=0,
    resume=False,
    make_model=ActorCritic,
    improve=improve,
    **about,
):
    """Trains for `total_steps` steps of all robots together; returns (model, rows of the log).
    make_envs(num_envs) -> vector environment with AutoresetMode.SAME_STEP and actions in [0, 1];
    out: an existing folder, a Path; improve: see `learn`; about: is stored with the policy."""
    samples = cfg.num_envs * cfg.rollout  # steps of all robots in an update
    updates = math.ceil(total_steps / samples)
    checkpoint = out / "checkpoint.pt"
    envs = gym.wrappers.vector.RecordEpisodeStatistics(make_envs(cfg.num_envs))
    space = gym.spaces.Box(0, 1, envs.single_action_space.shape)
    mode = envs.metadata.get("autoreset_mode")
    if envs.single_action_space != space or mode != gym.vector.AutoresetMode.SAME_STEP:
        raise InputError("needs environments with actions in [0, 1] and AutoresetMode.SAME_STEP")
    # What must be the same when a stopped training goes on (as plain values, like those of a file)
    fits = fingerprint(getattr(envs.unwrapped, "world", None))
    about = plain(about | {"seed": seed, "steps": updates * samples, "config": cfg, "fits": fits})
    if resume:
        model, stored = load_policy(checkpoint, make_model)
        if "rows" not in stored or not about.items() <= stored.items():
            raise InputError(f"{checkpoint}: no stopped training with the same flags")
        rows, adam = stored["rows"], stored["optimizer"]
    elif checkpoint.exists():
        raise InputError(f"{checkpoint}: a stopped training: --resume continues it, or delete it")
    else:
        torch.manual_seed(seed)
        sizes = envs.single_observation_space.shape[0], space.shape[0], cfg.hidden
        first_action = getattr(envs.unwrapped, "neutral_action", 0.5)
        model = make_model(*sizes, first_action, cfg.first_concentration)
        rows, adam = [], None
    first = len(rows)
    # foreach: one call for all weights, which is quicker; eps as in [8]
    optimizer = torch.optim.Adam(model.parameters(), eps=1e-5, foreach=True)
    if adam:
        optimizer.load_state_dict(adam)
    # After a stop: other random numbers than before it
    new_seed = int(np.random.SeedSequence([seed, 1 + first]).generate_state(1)[0])
    torch.manual_seed(new_seed)
    log = learn(model, optimizer, envs, cfg, updates, first, new_seed, improve)
    bar = tqdm(log, total=updates, initial=first, unit=" steps", unit_scale=samples)
    for numbers in bar:
        bar.set_description(
            f"success {numbers['success']:.2f}, falls {numbers['fall']:.2f}, "
            f"return {numbers['return']:.2f}"
        )
        rows.append(plain({"steps": (len(rows) + 1) * samples, **numbers}))
        save_policy(checkpoint, model, **about, rows=rows, optimizer=optimizer.state_dict())
    envs.close()
    table, header = [list(row.values()) for row in rows], ",".join(rows[0])
    robot_model.atomic_write(
        out / "learning_curve.csv",
        lambda file: np.savetxt(file, table, "%.9g", ",", header=header, comments=""),
    )
    save_policy(out / "policy.pt", model, **about)
    checkpoint.unlink()
    return model, rows


# ------------------------------------------------------------------------ files
def plain(value):
    """The value as numbers, texts, lists and dicts; also arrays and dataclasses in it. (A file with
    numbers of numpy in it can be written, but not be read.)"""
    text = json.dumps(value, default=lambda of: of.tolist() if hasattr(of, "tolist") else vars(of))
    return json.loads(text)


def fingerprint(world):
    """What a policy is trained in, as plain values by name; None without a world."""
    return world and plain(
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
    """Writes the model as it is now, and `about` (plain values, tensors). The name of the weights
    says what the actor's outputs mean: a file in which they mean something else is refused."""
    stored = {**about, **plain(model.sizes), "mode_and_concentration": model.state_dict()}
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
    What is normal (numbers: first and last fifth of both `results/<sim>/learning_curve.csv`)?
    Successes are near 1, but for update 11, when the first episodes run out of time together.
    Before it, and just after it, only short walks end: these times are too low. Then times of
    successes fall. Falls rise from 0 to 0.001 (3-D) or 0.003 (2-D) of the walks: the first policy
    mostly steps on the spot, and a robot that learns to be quick falls sometimes. The entropy, how
    random the policy is (in nats: with natural logarithms), falls. At first 0.41 of the samples are
    outside of 1 ± ε, at the end 0.21 ([8] logs the mean over its gradient steps, which is smaller).
    The KL (Kullback-Leibler divergence, how far a rollout moves the policy) falls from 0.04 to 0.02
    nats. The explained variance, how much of the differences between the critic's targets V
    predicts, rises from less than 0.1 to 0.2, and is below 0 in one update of six (2-D) or eight
    (3-D): even the true goal tells little of what a walk will return (see projects.md). At 1 V
    would predict the targets but for a constant, at 0 it is no better than their mean.

    KL(π_old‖π) = E[−ln ρ] [nats], mean over π_old. We take the mean of (ρ − 1) − ln ρ: it is the
    same, as E[ρ − 1] = 0, with less noise, as ln ρ ≈ ρ − 1."""
    steps = np.array([row["steps"] for row in rows]) / 1000  # [U]
    width = len(rows) // 20 + 1
    figure = robot_model.Figure(figsize=(9, 11))
    grid = figure.subplots(4, 2, sharex=True)
    grid[2, 0].set_yscale("log")  # of the time
    for axes, (name, column) in zip(grid.flat, PANELS.items()):
        values = np.array([row.get(column, np.nan) for row in rows])
        mean = np.convolve(values, np.ones(width) / width, "valid")
        middle = steps[width // 2 :]  # of the updates of each mean
        axes.plot(middle[: len(mean)], mean, "m")
        axes.plot(steps, values, "m.", alpha=0.2)
        axes.set_title(name)
    axes.set_ylim(-0.5, 1.05)  # of the last panel: while all returns are alike it may be −10
    figure.supxlabel("double steps of all robots [thousands]")
    figure.suptitle(f"{title}; dots: updates, lines: means of a twentieth of them")
    robot_model.save_figure(figure, path)


# ------------------------------------------------------------------------ command line
def main(argv=None):
    parser = robot_model.stage_parser(__doc__)
    add = parser.add_argument
    add("--steps", type=int, help=f"Train for so many double steps (default {STEPS:,}).")
    add("--quick", action="store_true")
    add("--resume", action="store_true")
    usual = vars(PPOConfig())
    for name, value in usual.items():
        if name != "hidden":
            add(f"--{name}", type=type(value), default=value, help="default %(default)s")
    args = parser.parse_args(argv)
    cfg = PPOConfig(**{name: getattr(args, name, value) for name, value in usual.items()})
    steps = (QUICK_STEPS if args.quick else STEPS) if args.steps is None else args.steps
    if min(steps, cfg.num_envs, cfg.rollout, cfg.epochs, cfg.minibatch) < 1:
        parser.error("--steps, --num_envs, --rollout, --epochs and --minibatch from 1 on")
    out = robot_model.output_folder(args, "quick" if args.quick else "")
    print(
        f"training on {args.sim}: {steps:,} steps or a few more, seed {args.seed}, into {out}\n"
        "(Ctrl-C stops it; the same flags and --resume continue)"
    )
    make_envs = partial(env.FootstepVectorEnv, sim=args.sim, noise=True)
    _, rows = train(cfg, make_envs, out, steps, args.seed, args.resume)
    plot_learning_curve(rows, out / "learning_curve.png", f"PPO on {args.sim}, seed {args.seed}")
    print(f"policy.pt, learning_curve.csv and learning_curve.png are in {out}")
    flag = " --mujoco" if args.sim == "mujoco" else ""
    print(
        "A near goal in 2-D takes 0 to 2 % more time than with baseline_tuned after --quick, 14 % less "
        "with the shipped policy. Yours:\n"
        f'    python 05_evaluate.py --noise{flag} --policy "{out / "policy.pt"}"'
    )


if __name__ == "__main__":
    robot_model.start(main)
