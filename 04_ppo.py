"""Stage 4: how does the robot learn which footsteps to take? By trying, with PPO.

Paper: section II, "Policy" (two hidden layers of 64 neurons, a Beta distribution for each action
variable), trained with PPO, proximal policy optimization [7]. The paper used Stable-Baselines3 [8];
here it is written out, so that every equation has a line to point at.

    python 04_ppo.py                 1,000,000 double steps of the planar robot (pymunk)
    python 04_ppo.py --mujoco        the same in 3-D
    python 04_ppo.py --quick         60,000 of them, a lesson of a minute, into runs/<sim>/quick/
    python 04_ppo.py --resume        continue after Ctrl-C: the same policy, bit for bit
    python 04_ppo.py --env Pendulum-v1 --steps 150000     another world: bounded Box, normalised

Expect: success rises, falls sink; then policy.pt, learning_curve.csv and .png in runs/<sim>/, and
checkpoint.pt to resume from. The goal is measured with noise (--no-noise: exactly).

What is maximised. The policy π(a|s) is a distribution over the actions a for each observation s.
The return from step t on is G_t = r_t + γ·r_{t+1} + γ²·r_{t+2} + …; we want it large on average.
  value      V(s) = E[G_t | s]: what to expect; a second network, the critic, learns it
  advantage  A_t: how much better the action was than expected, about G_t − V(s_t)
How the average changes with one decision (with all: their sum, policy gradient), Σ over actions:
∇E[G] = Σ G·∇π = E[G·∇ln π]. As E[∇ln π] = Σ∇π = ∇1 = 0, G − V(s) does as well, with less noise. So
follow E[A·∇ln π(a|s)]: good actions become more likely, bad ones less.
PPO uses a sample several times while the policy moves on, so it weights it by the ratio
ρ = π(a|s) / π_old(a|s); at ρ = 1 the gradient of ρ·A is A·∇ln π again.

The loop: (1) collect, N robots take T steps; (2) judge every action; (3) improve; (4) log. Repeat.

A cut-off and a fall both end an episode, but they do not mean the same. After a fall (terminated)
there is no future: the sum of the later rewards is 0, and that is the truth; at the goal likewise.
After a cut-off (truncated: the time is up) the world would have gone on; only our recording
stopped. Putting 0 there would tell the critic that walking well at 99 s is worth as little as lying
on the ground. So the missing sum is replaced by V of the LAST observation of that episode
("bootstrapping"), not by V of the next one's first; likewise where a rollout ends in mid-episode.

Leaves out: the entropy bonus of [7], value clipping, a stop at a large KL, memory, GPUs.

[7] Schulman et al.: Proximal Policy Optimization Algorithms, 2017, arXiv 1707.06347.
[8] Raffin et al.: Stable-Baselines3: Reliable Reinforcement Learning Implementations, 2021.
[GAE] Schulman et al.: High-Dimensional Continuous Control Using GAE, 2015, arXiv 1506.02438.
"""

import argparse
import contextlib
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
from tqdm import tqdm

robot_model = import_module("01_robot_model")
env = import_module("03_env")
torch.set_num_threads(1)  # matrices this small are slower on several threads
STEPS, QUICK_STEPS = 1_000_000, 60_000  # double steps; as many as the paper's

@dataclass(frozen=True)
class PPOConfig:
    """Sources: [P] the paper, [7], [8] its default, [own] our choice."""
    num_envs: int = 64  # N, robots that walk at the same time [own]
    rollout: int = 64  # T, double steps of each robot between two updates [own]
    epochs: int = 10  # how often every sample is used [8]
    minibatch: int = 512  # samples per gradient step [own]
    learning_rate: float = 1e-3  # of Adam at the start; falls linearly to 0 [own]
    gamma: float = 0.98  # γ, discount per double step: looks about 1/(1−γ) = 50 ahead [own]
    lam: float = 0.95  # λ of [GAE], see `gae` [8]
    clip: float = 0.2  # ε, how far the ratio ρ is rewarded to move [7]
    value_coef: float = 0.5  # c_V, weight of the critic's loss in the sum [8]
    max_grad_norm: float = 0.5  # longer gradients are scaled down to this length [8]
    hidden: tuple = (64, 64)  # neurons per hidden layer [P]
    first_concentration: float = 10.0  # α+β of the first policy, > 2; larger: explores less [own]
    sharpest: float = 4.0  # exploration fades: π^k, k grows linearly from 1 to this [own]
    normalize: bool = False  # observations and rewards; stage 3's have the right size [own]
    checkpoint_every: int = 10  # updates; see `train` [own]
    unsettled: int = 3  # updates after a reset: too few or many time-outs, logged as nan [own]
FOREIGN = PPOConfig(num_envs=16, rollout=128, minibatch=256, gamma=0.99, normalize=True)  # --env
PENDULUM = replace(FOREIGN, gamma=0.95)  # what it does now is seen within 20 steps

# ------------------------------------------------------------------------ the networks
def mlp(sizes, last_gain):
    """Linear layers with tanh between them; orthogonal weights with gain √2, as in [8]."""
    layers = []
    for inputs, outputs in zip(sizes[:-1], sizes[1:]):
        layers += [nn.Linear(inputs, outputs), nn.Tanh()]
        nn.init.orthogonal_(layers[-2].weight, 2**0.5)
        nn.init.zeros_(layers[-2].bias)
    nn.init.orthogonal_(layers[-2].weight, last_gain)
    return nn.Sequential(*layers[:-1])

class ActorCritic(nn.Module):
    """Two separate networks: the actor proposes actions, the critic predicts the return V(s).

    Each action variable x in [0, 1] has a Beta distribution, p(x) ∝ x^(α−1)·(1−x)^(β−1): a single
    hump, as α, β > 1 (not the angles of stage 3). Training rewards what the samples do, but in the
    end the mean decides. So the samples gather around it: while training, a sharpness k grows, and
        p(x)^k ∝ x^(k·(α−1))·(1−x)^(k·(β−1))   is a Beta distribution again, narrower, mode kept.
    """
    sharpness = 1.0  # k; set by `train` and `load_policy`

    def __init__(self, obs_dim, act_dim, hidden=(64, 64), first_action=0.5, concentration=10.0,
                 normalize=False):
        super().__init__()
        self.shape = {"obs_dim": int(obs_dim), "act_dim": int(act_dim), "hidden": list(hidden),
                      "normalize": normalize}
        if normalize:  # mean and variance of observations and of Σ γᵏ·r: means over the rollouts
            self.seen, self.paid = (nn.BatchNorm1d(size, affine=False, momentum=None).eval()
                                    for size in (obs_dim, 1))
        self.actor = mlp((obs_dim, *hidden, 2 * act_dim), last_gain=0.01)
        self.critic = mlp((obs_dim, *hidden, 1), last_gain=1.0)
        # With small last weights the first policy hardly depends on the observation: the bias alone
        # puts its mode m = (α − 1) / (c − 2) at first_action, with the concentration c = α+β:
        # α − 1 = m·(c − 2),  β − 1 = (1 − m)·(c − 2)
        mode = torch.as_tensor(first_action, dtype=torch.float32).expand(act_dim).clamp(0.01, 0.99)
        wanted = torch.cat([mode, 1.0 - mode]) * (concentration - 2.0)  # first all α, then all β
        self.actor[-1].bias.data.copy_(torch.log(torch.expm1(wanted)))  # softplus⁻¹

    def scaled(self, obs):
        """Observations [..., obs] with mean 0 and variance 1, if it normalises."""
        if not self.shape["normalize"]:
            return obs
        return self.seen(obs.reshape(-1, obs.shape[-1])).clamp(-10, 10).reshape(obs.shape)

    def value(self, obs):
        """The critic's V(s): [..., obs] -> [...]."""
        return self.critic(self.scaled(obs)).squeeze(-1)

    def policy(self, obs):
        """π(·|s): [..., obs] -> a distribution over actions [..., act]."""
        raw = nn.functional.softplus(self.actor(self.scaled(obs))).clamp(1e-6, 1e3)  # no overflow
        alpha, beta = (1.0 + self.sharpness * raw).chunk(2, dim=-1)
        return torch.distributions.Independent(  # the log-probability of an action is a sum
            torch.distributions.Beta(alpha, beta, validate_args=False), 1, validate_args=False)

    def sample(self, obs):
        """Actions drawn for exploration, tensors: [N, obs] -> [N, act]."""
        with torch.no_grad():  # exactly 0 or 1 would have an infinite log-probability
            return self.policy(obs).sample().clamp(1e-6, 1.0 - 1e-6)

    def decide(self, obs):
        """What to do when it counts, arrays: [N, obs] -> [N, act]: the mean. (The paper: mode.)"""
        with torch.no_grad():  # α / (α + β), calmer than the mode: `tests/studies/decision.py`
            return self.policy(torch.as_tensor(obs, dtype=torch.float32)).mean.numpy()

# ------------------------------------------------------------------------ one update of PPO
def collect(model, envs, obs, steps):
    """(1) N robots take T steps each, from the observations obs [N, …] on: tensors [T, N, …] by
    name, the observations to go on from, and the infos of every step.
    """
    memory, infos = [], []
    for _ in range(steps):
        obs = obs.astype(np.float32)  # a copy: environments may reuse their arrays
        action = model.sample(torch.from_numpy(obs))  # [N, act]
        after, reward, terminated, truncated, info = envs.step(action.numpy())
        # Where an episode has ended, `after` already belongs to the next one (SAME_STEP); what
        # really followed the action is the last observation of the ended one.
        next_obs = after.astype(np.float32)
        for i in np.flatnonzero(terminated | truncated):
            next_obs[i] = info["final_obs"][i]
        step = {"obs": obs, "next_obs": next_obs, "reward": reward.astype(np.float32),
                "terminated": terminated, "truncated": truncated}
        memory.append({"action": action, **{name: torch.tensor(v) for name, v in step.items()}})
        infos.append(info)
        obs = after
    return {name: torch.stack([step[name] for step in memory]) for name in memory[0]}, obs, infos

def gae(rewards, values, next_values, terminated, truncated, gamma, lam):
    """(2) Advantages A_t by generalised advantage estimation [GAE]; everything [T, N].

    next_values[t] is V of what really followed step t. One surprise of the critic,
    δ_t = r_t + γ·V(s_{t+1}) − V(s_t), is an advantage with little noise, but wrong where the critic
    is. In two, δ_t + γ·δ_{t+1} = r_t + γ·r_{t+1} + γ²·V(s_{t+2}) − V(s_t), the V between cancels.
    All make G_t − V(s_t), right but noisy. λ < 1 lets them fade: A_t = Σ_k (γλ)ᵏ·δ_{t+k}
    """
    # δ_t = r_t + γ·(1 − terminated_t)·V(s'_t) − V(s_t)
    bootstrap = torch.where(terminated, torch.zeros_like(next_values), next_values)
    deltas = rewards + gamma * bootstrap - values
    # A_t = δ_t + γ·λ·A_{t+1} within one episode: the sum stops at a fall AND at a cut-off
    goes_on = 1.0 - (terminated | truncated).to(rewards.dtype)
    advantages = torch.zeros_like(rewards)
    later = torch.zeros_like(rewards[0])  # [N] A_{t+1}
    for t in reversed(range(len(rewards))):
        later = advantages[t] = deltas[t] + gamma * lam * goes_on[t] * later
    return advantages

def clipped_objective(ratio, advantage, clip):
    """Per sample, to be maximised; ratio ρ = π(a|s) / π_old(a|s).

    A good action (A > 0) that is 20 % more likely by now earns nothing more, nor does a bad one
    that is 20 % less likely. What went the wrong way keeps its gradient: hence the minimum.
    """
    # L = min(ρ·A, clip(ρ, 1 − ε, 1 + ε)·A)
    return torch.min(ratio * advantage, ratio.clamp(1.0 - clip, 1.0 + clip) * advantage)

def judge(model, data, cfg):
    """(2) Advantage, the critic's target, log π_old, each [B], B = T·N; data: tensors [T, N, …]."""
    with torch.no_grad():
        values, rewards = model.value(data["obs"]), data["reward"]  # [T, N]
        if cfg.normalize:  # r ← r / std of Σ γᵏ·r
            rewards = rewards / (model.paid.running_var + 1e-8).sqrt()
        advantages = gae(rewards, values, model.value(data["next_obs"]),
                         data["terminated"], data["truncated"], cfg.gamma, cfg.lam)
        # The critic should say G_t. Our best estimate of it: V(s_t) + A_t
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
        left = (targets - model.value(obs)).var() / targets.var()
        # 1 − Var[target − V] / Var[target]; 1: the critic knew it, near 0: falls surprise it
        before = {"entropy": entropy.item(), "explained_variance": 1.0 - left.item()}
    for _ in range(cfg.epochs):
        for pick in torch.randperm(len(obs)).split(cfg.minibatch):  # [minibatch]
            ratio = (model.policy(obs[pick]).log_prob(action[pick]) - old_log_prob[pick]).exp()
            # Â = (A − mean) / std: compared with the minibatch, whatever the size of the rewards
            a = advantages[pick]
            a = (a - a.mean()) / (a.std(correction=0) + 1e-8)
            # L_V = mean (V(s) − target)²;   loss = −L + c_V·L_V
            critic_loss = ((model.value(obs[pick]) - targets[pick]) ** 2).mean()
            loss = -clipped_objective(ratio, a, cfg.clip).mean() + cfg.value_coef * critic_loss
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(model.parameters(), cfg.max_grad_norm)
            optimizer.step()
    with torch.no_grad():  # the policy after the update against π_old
        log_ratio = model.policy(obs).log_prob(action) - old_log_prob
        outside = ((log_ratio.exp() - 1).abs() > cfg.clip).float()  # of [1 − ε, 1 + ε]
        # How far it moved: KL(π_old‖π) ≈ mean (ρ − 1 − ln ρ) ≥ 0 [nats]
        return {**before, "clip_fraction": outside.mean().item(),
                "approx_kl": (torch.expm1(log_ratio) - log_ratio).mean().item(),
                "value_loss": ((model.value(obs) - targets) ** 2).mean().item()}

def learn_scales(model, data, cfg):
    """Mean and variance of the observations and of Σ γᵏ·r, for the next rollout."""
    none, ends = torch.zeros_like(data["reward"]), (data["terminated"], data["truncated"])
    paid = gae(data["reward"], none, none, *ends, cfg.gamma, 1.0)  # [T, N]
    for norm, rows in ((model.seen, data["obs"].flatten(0, 1)), (model.paid, paid.reshape(-1, 1))):
        norm.train()(rows)
        norm.eval()  # and then they stay as they are

def episode_means(infos):
    """(4) Means over the episodes that ended in these steps; nan where nothing was reported."""
    ended = {name: [] for name in ("return", "length", "success", "fall", "timeout", "time")}
    for info in infos:  # "return" is here the sum of the rewards, not discounted
        told = info.get("episode", {})  # of RecordEpisodeStatistics
        final = {**info.get("final_info", {}), "return": told.get("r"), "length": told.get("l")}
        for i in np.flatnonzero(info.get("_episode", ())):
            for name in ended.keys() & final.keys():
                if name != "time" or "success" not in final or final["success"][i]:  # [s]
                    ended[name].append(final[name][i])
    return {name: float(np.mean(v)) if v else float("nan") for name, v in ended.items()}

# ------------------------------------------------------------------------ files
class PolicyError(ValueError):
    """A file cannot be used; the message is one line that says why."""

def save_plain(path, stored):
    """A dict of plain values and tensors."""
    try:
        robot_model.atomic_write(path, lambda file: torch.save(stored, file))
    except RuntimeError as error:  # of PyTorch
        raise OSError(f"{path} cannot be written: is the disk full?") from error

def load_plain(path):
    """The dict in a file of ours, without running any foreign code; PolicyError if it is none."""
    try:
        with warnings.catch_warnings(action="ignore"):  # torch's, about foreign formats
            return dict(torch.load(path, map_location="cpu", weights_only=True))
    except FileNotFoundError as error:
        raise PolicyError(f"{path}: no such file") from error
    except Exception as error:  # torch raises many types, with messages of many lines
        raise PolicyError(f"{path}: damaged, or not written by 04_ppo.py") from error

def difference(stored, wanted):
    """"name is A in the file, but B here": the first entry that differs, or ""."""
    for key in sorted(stored.keys() | wanted.keys(), key=lambda k: (k != "simulator", k)):
        there, here = stored.get(key, "missing"), wanted.get(key, "missing")
        if isinstance(there, dict) and isinstance(here, dict) and there != here:
            return f"{key}: {difference(there, here)}"
        if there != here:
            return f"{key} is {there} in the file, but {here} here"
    return ""

def save_policy(path, model, meta):
    """Writes the model and `meta` (plain values); an older file becomes <name>.previous.pt."""
    if path.exists():
        previous = path.with_name(path.stem + ".previous" + path.suffix)
        robot_model.atomic_write(previous, lambda file: file.write_bytes(path.read_bytes()))
    save_plain(path, {**meta, **model.shape, "state_dict": model.state_dict()})

def load_policy(path):
    """(model, meta); meta["fits"] says what the policy was trained for."""
    meta = load_plain(path)
    try:
        with torch.device("meta"):  # shapes without numbers: a bad file might ask for millions
            model = ActorCritic(meta["obs_dim"], meta["act_dim"], meta["hidden"],
                                normalize=meta.get("normalize", False))
        model.load_state_dict(meta.pop("state_dict"), assign=True)
        model.float()
        model.sharpness = float(meta["config"]["sharpest"])  # as trained last
        if not all(tensor.isfinite().all() for tensor in model.state_dict().values()):
            raise ValueError("not finite")
    except (KeyError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        raise PolicyError(f"{path}: not a policy, of another shape, or not finite") from error
    return model, meta

def save_checkpoint(out, about, rows, model, optimizer):
    """All that a resumed training needs, and the log so far as a table."""
    stored = {"about": about, "update": len(rows), "rows": rows,
              "model": model.state_dict(), "optimizer": optimizer.state_dict()}
    save_plain(out / "checkpoint.pt", stored)
    table = [list(row.values()) for row in rows]
    robot_model.atomic_write(out / "learning_curve.csv", lambda file: np.savetxt(
        file, table, "%.6g", ",", header=",".join(rows[0]), comments=""))

def load_checkpoint(path, about, model, optimizer):
    """Puts the networks and Adam's state back where a training stopped; returns its log."""
    stored = load_plain(path)
    if mismatch := difference(stored.get("about", {}), about):
        raise PolicyError(f"{path}: cannot resume: {mismatch}")
    try:
        model.load_state_dict(stored["model"])
        optimizer.load_state_dict(stored["optimizer"])
        minutes = [row["minutes"] for row in stored["rows"]]  # every update has a row in the log
        if stored["update"] != len(minutes) or not isinstance(stored["rows"], list):
            raise ValueError("its log is of another training")
        return stored["rows"]
    except (KeyError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        raise PolicyError(f"{path}: not a checkpoint of this training") from error

# ------------------------------------------------------------------------ the loop
def train(cfg, make_envs, out, total_steps, seed=0, about=None, resume=False, progress=True,
          make_model=ActorCritic):
    """Trains for `total_steps` steps of all robots together; (model, rows of the log).

    make_envs(num_envs) -> vector environment with AutoresetMode.SAME_STEP and actions in [0, 1];
    about: plain values that say what is learned; stage 5 checks its "fits".
    """
    torch.manual_seed(random_seed(seed))
    about = {"fits": {}, **(about or {}), "seed": seed, "steps": total_steps, "config": asdict(cfg)}
    samples = cfg.num_envs * cfg.rollout  # steps of all robots in an update
    updates = -(-total_steps // samples)  # rounded up to whole updates
    envs = gym.wrappers.vector.RecordEpisodeStatistics(make_envs(cfg.num_envs))
    model = make_model(envs.single_observation_space.shape[0], envs.single_action_space.shape[0],
                       cfg.hidden, getattr(envs.unwrapped, "neutral_action", 0.5),  # of stage 3
                       cfg.first_concentration, cfg.normalize)
    optimizer = torch.optim.Adam(model.parameters(), eps=1e-5, foreach=True)  # ε of [8]; quicker
    out, rows = Path(out), []
    out.mkdir(parents=True, exist_ok=True)
    if resume:
        rows = load_checkpoint(out / "checkpoint.pt", about, model, optimizer)
    elif (out / "checkpoint.pt").exists():  # of an older training
        (out / "checkpoint.pt").replace(out / "checkpoint.previous.pt")
    first, started = len(rows), time.monotonic() - (60 * rows[-1]["minutes"] if rows else 0)  # [s]
    bar = tqdm(range(first, updates), total=updates, initial=first, unit=" steps",
               unit_scale=samples, disable=not progress, dynamic_ncols=True)
    with contextlib.closing(envs), bar:
        for update in bar:
            if update % cfg.checkpoint_every == 0:  # a point to resume from
                # A resumed training does bit for bit what an uninterrupted one does: only networks,
                # Adam's state and the update's number go on, in either; seeds and episodes are new.
                if update > first:
                    save_checkpoint(out, about, rows, model, optimizer)
                torch.manual_seed(random_seed(seed, 1 + update))
                obs, _ = envs.reset(seed=random_seed(seed, 1 + update))
            rate = optimizer.param_groups[0]["lr"] = cfg.learning_rate * (1.0 - update / updates)
            model.sharpness = 1.0 + (cfg.sharpest - 1.0) * update / updates
            data, obs, infos = collect(model, envs, obs, cfg.rollout)
            watched = improve(model, optimizer, data, cfg)
            if cfg.normalize:
                learn_scales(model, data, cfg)
            settled = update % cfg.checkpoint_every >= cfg.unsettled
            row = {"steps": (update + 1) * samples, "minutes": (time.monotonic() - started) / 60,
                   **watched, **episode_means(infos if settled else []), "learning_rate": rate}
            rows.append(row)
            bar.set_postfix({name: f"{row[name]:.3g}" for name in ("success", "fall", "return")})
            if not np.isfinite(row["value_loss"]):
                raise FloatingPointError(f"after {row['steps']} steps: the loss is not finite")
        model.sharpness = cfg.sharpest
        if first < updates:  # the policy first: the last checkpoint says that it exists
            done = {key: row[key] for key in ("steps", "minutes")}
            save_policy(out / "policy.pt", model, {**about, **done})
            save_checkpoint(out, about, rows, model, optimizer)
    return model, rows

def random_seed(*numbers):  # one made of several
    return int(np.random.SeedSequence(numbers).generate_state(1)[0])

# ------------------------------------------------------------------------ the picture
PANELS = (  # title, label of the vertical axis, columns
    ("Exploring: success rises, falls sink", "share of walks [1]", ("success", "timeout", "fall")),
    ("The way to the goal takes less time", "simulated time [s]", ("time",)),
    ("The return rises (not discounted)", "sum of rewards per episode [1]", ("return",)),
    ("It explores less (below 0 is normal)", "entropy of the policy [nats]", ("entropy",)),
    ("Updates move the policy less", "share; KL [nats]", ("clip_fraction", "approx_kl")),
    ("Can the critic predict?", "explained variance [1]", ("explained_variance",)),
)

def plot_learning_curve(rows, path, title):
    """Every panel of the log; each dot is an update, most is learned in the first ones."""
    steps = np.array([row["steps"] for row in rows]) / 1000.0  # [U]
    figure, grid = plt.subplots(2, 3, figsize=(12, 6.5), sharex=True, layout="constrained")
    for axes, (name, unit, columns) in zip(grid.flat, PANELS):
        for column, style in zip(columns, (".-", "x-", "^-")):
            y = np.array([row[column] for row in rows])  # [U] nan where nothing was reported
            axes.plot(steps[y == y], y[y == y], style, ms=5, lw=1, label=column)
        axes.set(title=name, ylabel=unit, xlabel="steps of all robots [thousands]", xscale="log")
        axes.grid(alpha=0.3)
        axes.legend()
    grid[1, 2].set_ylim(-0.5, 1.05)  # when all returns are alike a single value may be −10
    figure.suptitle(title)
    robot_model.atomic_write(path, lambda file: figure.savefig(file, dpi=130))
    plt.close(figure)

# ------------------------------------------------------------------------ command line
def foreign_envs(env_id, num_envs):
    """A registered Gymnasium environment for `train`: flat observations, actions in [0, 1]."""
    wrappers = (lambda one: gym.wrappers.RescaleAction(one, *np.float32([0, 1])),
                gym.wrappers.FlattenObservation)
    envs = gym.make_vec(env_id, num_envs, "sync", {"autoreset_mode": "SameStep"}, wrappers)
    if len(envs.single_action_space.shape) != 1 or envs.single_action_space.dtype.kind != "f":
        raise ValueError(f"an action is {envs.single_action_space}")
    return envs

def main(argv=None):
    parser = robot_model.StageParser(__doc__, Path(__file__).name)
    parser.add_argument("--imu", action="store_true", help="observe the torso's tilt and turning")
    parser.add_argument("--noise", action=argparse.BooleanOptionalAction, default=True)
    parser.add_argument("--steps", type=lambda text: robot_model.whole(text, 1),
                        help=f"double steps (default {STEPS:,})")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_STEPS:,} steps")
    parser.add_argument("--resume", action="store_true", help="continue an interrupted training")
    parser.add_argument("--env", metavar="ID", help="train on this Gymnasium environment instead")
    args = parser.parse(argv)
    if args.env is not None and (args.sim == "mujoco" or args.imu or not args.noise):
        parser.error("--env cannot be combined with --mujoco, --imu or --no-noise")
    steps, task = args.steps or (QUICK_STEPS if args.quick else STEPS), args.sim
    if args.env is not None:
        task = args.env
        cfg, fits = PENDULUM if task == "Pendulum-v1" else FOREIGN, {"simulator": task}
        make_envs = partial(foreign_envs, task)
        gym.logger.min_level = gym.logger.ERROR  # its warnings take lines of their own
        try:
            make_envs(1).close()
        except Exception as error:  # a foreign environment may raise anything
            parser.error(f"{task} needs its packages and a row of bounded actions: {error}")
    else:
        cfg, fits = PPOConfig(), env.fingerprint(args.sim, args.imu)
        make_envs = partial(env.FootstepVectorEnv, sim=args.sim, noise=args.noise, imu=args.imu)
    usual = Path("runs", task.replace("/", "-").replace(":", "-"), *["imu"] * args.imu)
    out = parser.folder(args, usual / "quick" if args.quick else usual)
    print(f"training on {task}: {steps:,} steps, seed {args.seed}, into {out}")
    try:
        _, rows = train(cfg, make_envs, out, steps, args.seed, resume=args.resume,
                        about={"fits": fits, "imu": args.imu, "noise": args.noise})
    except (PolicyError, FloatingPointError, OSError) as error:
        parser.error(str(error))
    except KeyboardInterrupt:
        parser.exit(130, "\ninterrupted; --resume goes on from the last checkpoint, if any\n")
    plot_learning_curve(rows, out / "learning_curve.png", f"PPO on {task}, seed {args.seed}")
    print(f"after {rows[-1]['minutes']:.1f} minutes: policy.pt, learning_curve.csv and .png")
    if not args.env:  # stage 5 finds a policy in its usual folder
        file = " --imu" * args.imu if out == usual else f' --policy "{out / "policy.pt"}"'
        print("next: python 05_evaluate.py --noise" + " --mujoco" * (args.sim == "mujoco") + file)

if __name__ == "__main__":
    robot_model.run(main)
