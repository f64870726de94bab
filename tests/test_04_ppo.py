"""Stage 4, checked against theory. A failing test names the likely mistake."""

import inspect
import itertools
import math
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from unittest import mock

import gymnasium as gym
import numpy as np
import pytest
import torch
from checks import close, equal, locked
from numpy.random import default_rng
from torch.nn.utils import parameters_to_vector

ppo = import_module("04_ppo")
env, InputError = ppo.env, ppo.robot_model.InputError
ActorCritic, PPOConfig, train = ppo.ActorCritic, ppo.PPOConfig, ppo.train

SMALL = PPOConfig(num_envs=32, rollout=4, epochs=5, minibatch=64, learning_rate=1e-2, gamma=0.5)
torch.set_num_threads(1)  # small networks: with more it takes twenty times as long
HERE = Path()  # of each test another folder, see `own_folder`
EPISODES = ("return", "success", "fall", "timeout", "time")  # columns about episodes


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def brute_force_advantages(r, v, v_next, terminated, truncated, gamma, lam):
    """A_t = Σ_l (γλ)^l δ_{t+l}, written as the double sum; everything [T, N]."""
    delta = r + gamma * np.where(terminated, 0, v_next) - v
    advantages = np.zeros(r.shape)
    for t in range(len(r)):
        goes_on = np.ones(r.shape[1], bool)
        for n in range(t, len(r)):
            advantages[t] += goes_on * (gamma * lam) ** (n - t) * delta[n]
            goes_on &= ~(terminated | truncated)[n]
    return advantages


@pytest.mark.parametrize("lam", [0.0, 0.95, 1.0])
def test_gae_equals_the_double_sum(lam):
    rng, steps, robots, gamma = default_rng(0), 30, 5, 0.9
    r, v, v_next = rng.normal(size=(3, steps, robots))
    terminated, truncated = rng.random((2, steps, robots)) < 0.15
    assert (terminated & truncated).any(), "the test should contain steps that are both"
    one = "a single step: A = δ = r + γ·V(s') − V(s), not the critic's target, which is without minus "
    one += "V(s), and not normalised"
    many = "nothing ends: A_t = δ_t + γ·λ·A_{t+1}, from the last step backward; V(s'_t) is "
    many += "next_values[t]"
    fallen = "after a fall V(s') counts as 0, and the sum stops"
    cut = "after a cut-off V(s') stays (the bootstrap), and the sum stops"
    unknown = (
        "behind a fall V(s') may be nan, and 0·nan is nan: select with torch.where instead of "
    )
    unknown += "multiplying"
    for rows, falls, cuts, behind, hint in (
        (1, False, False, 0.0, one),
        (steps, False, False, 0.0, many),
        (steps, True, False, 0.0, fallen),
        (steps, False, True, 0.0, cut),
        (steps, True, True, np.nan, unknown),
    ):
        fall = terminated & falls
        after = v_next + np.where(fall, behind, 0.0)
        told = [x[:rows] for x in (r, v, after, fall, truncated & cuts)]
        given = [*map(torch.tensor, told)]  # [rows, robots] each
        got = ppo.gae(*given, gamma, lam)
        assert isinstance(got, torch.Tensor), (
            f"a tensor [T, N], with which stage 4 goes on, not {type(got).__name__}: write it in "
            "PyTorch"
        )
        for tensor, array in zip(given, told):
            equal(tensor, array, "what is given must not be written to")
        close(got, brute_force_advantages(*told, gamma, lam), hint, atol=1e-5, rtol=1e-5)


def test_clipped_objective_truth_table():
    table = [  # ratio, advantage, what may be gained with ε = 0.2, and its gradient
        (1.0, 2.0, 2.0, 2),
        (1.5, 2.0, 2.4, 0),
        (0.5, 2.0, 1.0, 2),
        (1.0, -2.0, -2.0, -2),
        (1.5, -2.0, -3.0, -2),
        (0.5, -2.0, -1.6, 0),
    ]
    ratio, advantage, *_ = torch.tensor(table).T
    got = ppo.clipped_objective(ratio.requires_grad_(), advantage, 0.2)
    assert got.shape == (6,), "a number per sample: the mean is taken later"
    assert got.requires_grad, "no gradient comes through: neither detach nor NumPy"
    got.sum().backward()
    assert got[0] > 0, "at ρ = 1 the objective is A itself: is there a minus too many?"
    for (rho, a, want, slope), value, gradient in zip(table, got.tolist(), ratio.grad.tolist()):
        hint = f"ρ = {rho}, A = {a}: take the minimum of ρ·A and clip(ρ, 0.8, 1.2)·A"
        close(value, want, hint, rtol=1e-5)
        hint = "its gradient is A, but 0 for A > 0 beyond 1 + ε and for A < 0 below 1 − ε"
        close(gradient, slope, f"ρ = {rho}, A = {a}: {hint}", rtol=1e-5)
    other = ppo.clipped_objective(ratio[1], advantage[1], 0.1).item()
    close(other, 2.2, "ε is the argument `clip`, not always 0.2", rtol=1e-5)


def model_with(alpha, beta):
    """A model in double precision whose policy is Beta(α, β), two arrays [k], whatever it sees."""
    model = ActorCritic(1, len(alpha)).double()
    above, below = torch.tensor(np.array([alpha, beta], float)) - 1.0  # α − 1, β − 1
    torch.nn.init.zeros_(model.actor[-1].weight)
    # outputs: the logit of the mode, ln((α − 1) / (β − 1)); softplus⁻¹ of the concentration − 2
    bias = torch.cat([torch.log(above / below), torch.log(torch.expm1(above + below))])
    model.actor[-1].bias.data.copy_(bias)
    return model


def density(model, points):
    """p(x) of the model's policy at the points [..., act], in double precision."""
    with torch.no_grad():
        log_prob = model.policy(torch.zeros(1, dtype=torch.float64)).log_prob(torch.tensor(points))
    assert log_prob.shape == points.shape[:-1], "one log-probability for all numbers of an action"
    return log_prob.exp().numpy()


SHAPES = [(1.2, 1.2), (2.0, 5.0), (4.5, 1.2), (30.0, 60.0)]


@pytest.mark.parametrize("alpha, beta", SHAPES)
def test_log_prob_of_the_policy_is_that_of_its_beta_distribution(alpha, beta):
    x = np.array([0.005, 0.35, 0.95])
    norm = math.lgamma(alpha + beta) - math.lgamma(alpha) - math.lgamma(beta)
    want = np.exp((alpha - 1) * np.log(x) + (beta - 1) * np.log(1 - x) + norm)
    hint = "α = 1 + (c − 2)·m, β = 1 + (c − 2)·(1 − m)"
    close(density(model_with([alpha], [beta]), x[:, None]), want, hint, rtol=1e-9)
    both = density(model_with([alpha, alpha], [beta, beta]), np.stack([x, x], -1))
    close(both, want**2, "of two numbers: the SUM of their log-probabilities", rtol=1e-9)


def test_the_decision_is_the_mode():
    alpha, beta = np.array(SHAPES).T
    decided = model_with(alpha, beta).float().decide(np.zeros((3, 1)))
    assert decided.shape == (3, 4) and decided.dtype == np.float32
    mode = (alpha - 1) / (alpha + beta - 2)
    close(decided, [mode] * 3, "(α−1)/(α+β−2), not α/(α+β), the mean", atol=1e-5)


# of all numbers, or of each
@pytest.mark.parametrize("first", [0.3, [0.05, 0.5, 0.95], [0.0, 1.0, 0.5]], ids=str)
@pytest.mark.parametrize("concentration", [10.0, 3.0, 200.0])
def test_first_policy_is_around_first_action(first, concentration):
    torch.manual_seed(0)
    model = ActorCritic(4, 3, first_action=first, concentration=concentration)
    assert torch.isfinite(model.actor[-1].bias).all(), (
        "logit(0) is −∞, from where no gradient leads back: clamp the mode to 0.01 … 0.99"
    )
    with torch.no_grad():
        pi = model.policy(torch.randn(100, 4))
    # Var = m·(1 − m) / (α + β + 1) at the mean m
    total = pi.mean * (1 - pi.mean) / pi.variance - 1
    half = "the last weights are small, and this half of the bias undoes what `policy` does to it: "
    close(total, concentration, half + "the second, for α + β", rtol=0.05)
    close(pi.mode, np.broadcast_to(first, (100, 3)), half + "the first, for the mode", atol=0.02)


def test_layers_begin_with_orthogonal_rows_or_columns():
    for sizes in ((30, 7, 5), (7, 30, 5)):
        layers = [layer for layer in ppo.mlp(sizes, 0.1) if hasattr(layer, "weight")]
        for layer, length in zip(layers, (2**0.5, 0.1), strict=True):
            weight = layer.weight.detach()
            rows = min(weight, weight.T, key=len)
            close(rows @ rows.T, length**2 * np.eye(len(rows)), f"of length {length}", atol=1e-5)


def test_samples_have_finite_log_probability_even_for_wild_networks():
    model, obs = ActorCritic(2, 1), torch.zeros(1000, 2)
    for raw in itertools.product((-1e4, 1e6, 3e38), repeat=2):
        model.actor[-1].bias.data.copy_(torch.tensor(raw))
        pi, (x, told) = model.policy(obs), model.sample(obs)
        assert ((x > 9e-7) & (x < 1 - 9e-7)).all(), "keep samples off 0 and 1"
        log_prob = pi.log_prob(x)
        equal(told, log_prob.detach(), "ln π of the action that is returned")
        log_prob.sum().backward()
        for got in (log_prob, pi.entropy(), pi.mode, *(p.grad for p in model.actor.parameters())):
            assert torch.isfinite(got).all(), f"for {raw}: keep α and β within bounds"


class Probe(gym.vector.VectorEnv):
    """Every episode begins with one of the observations `starts`, drawn by chance.

    play(obs [n, 1], action [n, 1]) -> next obs, reward, terminated, truncated.
    """

    metadata = {"autoreset_mode": gym.vector.AutoresetMode.SAME_STEP}

    def __init__(self, num_envs, play, starts=np.zeros(1, np.float32)):
        self.num_envs, self.play, self.starts = num_envs, play, starts
        self.single_observation_space = gym.spaces.Box(-1, 1, (1,))
        self.single_action_space = gym.spaces.Box(0, 1, (1,))

    def first(self):
        return self.rng.choice(self.starts, (self.num_envs, 1))

    def reset(self, seed=None, options=None):
        self.rng = default_rng(seed)
        self.obs = self.first()
        return self.obs.copy(), {}

    def step(self, action):
        after, reward, terminated, truncated = self.play(self.obs.copy(), action)
        done = terminated | truncated
        infos = {"final_obs": after, "_final_obs": done, "final_info": {}} if done.any() else {}
        # One array for the observations of all steps: who wants to keep one has to copy it.
        self.obs[:] = np.where(done[:, None], self.first(), after)
        return self.obs, reward, terminated, truncated, infos


def paid(reward):
    """A world of single steps, each with the reward(obs, action) [n] and a fall."""

    def play(obs, action):
        yes = np.ones(len(obs), bool)
        return obs, reward(obs[:, 0], action[:, 0]), yes, ~yes

    return play


EITHER = np.array([0.0, 1.0])  # first observations, in double precision, as some tasks have them
constant = paid(lambda obs, action: np.ones(len(obs)))


def learn(play, cfg=SMALL, **settings):
    """The model after 15 updates in a probe world with these settings; files are written here."""
    steps = 15 * cfg.num_envs * cfg.rollout
    envs = partial(Probe, play=play, **settings)
    # ppo.improve of now: it may be an exercise
    model, _ = train(cfg, envs, HERE, steps, improve=ppo.improve)
    return model


def value(model, obs):
    return model.value(torch.tensor([[float(obs)]])).item()


def test_constant_reward_is_learned_as_the_value():
    model = learn(constant)
    hint = "one step, reward 1, then a fall: V = 1. Does the critic learn? Or look behind a fall?"
    close(value(model, 0), 1.0, hint, atol=0.1)


def test_reward_two_steps_ahead_is_discounted_once():
    def play(obs, action):  # 0 -> 1 (reward 0), 1 -> end (reward 1)
        end = obs[:, 0] == 1
        return np.ones_like(obs), end.astype(float), end, np.zeros(len(obs), bool)

    model = learn(play)
    close(value(model, 1), 1.0, atol=0.1)
    close(value(model, 0), 0.5, "V(0) = γ·V(1) with γ = 0.5", atol=0.1)


def test_cut_off_bootstraps_from_its_last_observation_and_a_fall_does_not():
    def play(obs, action):  # from 0: cut off at observation 1; from 1: fall with reward 1
        fall = obs[:, 0] == 1
        return np.ones_like(obs), fall.astype(float), fall, ~fall

    hint = "V(0) = γ·V(1). 0.00: as after a fall; 0.33: V of the NEXT episode's first observation"
    close(value(learn(play, starts=EITHER), 0), 0.5, hint, atol=0.07)


def test_action_goes_to_the_target_of_its_observation():
    play = paid(lambda obs, action: -16 * (action - (0.25 + 0.5 * obs)) ** 2)
    model = learn(play, starts=EITHER)
    hint = (
        "do observation, action and advantage still belong together after shuffling? Near 1 and "
        "0: the sign of the objective is wrong"
    )
    close(model.decide([[0.0], [1.0]])[:, 0], [0.25, 0.75], hint, atol=0.08)


@pytest.mark.parametrize("play, cfg", [
    (paid(lambda obs, action: math.nan * obs), SMALL),
    (constant, replace(SMALL, learning_rate=1e30)),
], ids=["reward", "learning rate"])  # fmt: skip
def test_numbers_that_are_not_finite_stop_the_training(play, cfg):
    with pytest.raises(InputError, match=r"\Aupdate \d+: the loss is not finite\Z"):
        learn(play, cfg=cfg)
    assert not (HERE / "policy.pt").exists(), "a policy of nan must not be written"


def test_episode_means_count_ended_episodes_only():
    def step(*episodes):
        """infos of a step; of every episode: how it ended ("": it goes on), return, time."""
        ends, returns, times = map(np.array, zip(*episodes))
        final = {name: ends == name for name in EPISODES[1:4]}
        final |= {"time": times, "reward": 0 * times}
        return {"_episode": ends != "", "episode": {"r": returns}, "final_info": final}

    nothing = dict.fromkeys(EPISODES, math.nan)
    assert ppo.episode_means([{}, {}]) == pytest.approx(nothing, nan_ok=True)
    both = step(("success", 3.0, 6.0), ("fall", -1.0, 99.0))
    late = step(("timeout", 1.0, 100.0), ("", 0.0, 0.0))
    got = ppo.episode_means([{}, both, late])
    want = {"return": 1.0, "time": 6.0} | dict.fromkeys(EPISODES[1:4], 1 / 3)
    assert got == pytest.approx(want), "of 3, −1 and 1; the time counts where the goal was reached"
    assert math.isnan(ppo.episode_means([late])["time"]), "no success: nan, not 0"


def rollout(model, steps=16, robots=8, scale=1.0, shift=0.0):
    """Invented data [T, N, …] with actions of this model."""
    torch.manual_seed(1)
    obs, next_obs = torch.randn(2, steps, robots, 3)
    action, log_prob = model.sample(obs)
    return {
        "obs": obs,
        "action": action,
        "log_prob": log_prob,
        "next_obs": next_obs,
        "reward": scale * torch.randn(steps, robots) + shift,
        "terminated": torch.rand(steps, robots) < 0.1,
        "truncated": torch.rand(steps, robots) < 0.1,
    }


def improve(model, optimizer, data, cfg):
    """`ppo.improve` with data that are judged as in a training."""
    advantage, target = ppo.judge(model, data, cfg)
    return ppo.improve(model, optimizer, data | {"advantage": advantage, "target": target}, cfg)


def fresh_model():
    torch.manual_seed(0)
    return ActorCritic(3, 2)


def test_numbers_to_watch_are_those_at_the_end_of_the_update():
    cfg = PPOConfig(minibatch=127, epochs=8, gamma=0.9)  # and a minibatch of a single sample
    old, model = fresh_model(), fresh_model()
    data = rollout(model)
    got = improve(model, torch.optim.Adam(model.parameters(), lr=3e-3), data, cfg)
    obs, action = data["obs"], data["action"]
    with torch.no_grad():
        v, v_next = old.value(obs), old.value(data["next_obs"])
        told = data["reward"], v, v_next, data["terminated"], data["truncated"]
        target = v + ppo.gae(*told, cfg.gamma, cfg.lam)  # V(s_t) + A_t
        log_ratio = model.policy(obs).log_prob(action) - old.policy(obs).log_prob(action)
        ratio = log_ratio.exp()
        want = {
            "entropy": old.policy(obs).entropy().mean(),
            "clip_fraction": ((ratio < 1 - cfg.clip) | (ratio > 1 + cfg.clip)).float().mean(),
            "approx_kl": (ratio - 1 - log_ratio).mean(),
            "explained_variance": 1 - (target - v).var() / target.var(),
            "value_loss": ((model.value(obs) - target) ** 2).mean(),
        }
    assert got.keys() == want.keys()
    hint = "the deviation of a minibatch of one sample is 0, not nan: std(correction=0)"
    assert np.isfinite([*got.values()]).all(), hint
    for name, number in want.items():
        hint = (
            f"{name}: KL, clip fraction and value loss compare the policy after the LAST gradient "
            "step with π_old on all samples; explained variance and entropy are those of the model "
            "that acted; targets and π_old stay as they are given"
        )
        close(got[name], number.item(), hint, rtol=1e-3)


def gradients(cfg, lr=0.0, outlier=0.0, **rewards):
    """How long the gradient of every step is, of a fresh model; one of the rewards is much larger."""
    lengths, model = [], fresh_model()

    class Spy(torch.optim.SGD):
        def step(self):
            lengths.append(math.hypot(*(p.grad.norm() for p in self.param_groups[0]["params"])))
            super().step()

    data = rollout(model, **rewards)
    data["reward"][0, 0] += outlier
    improve(model, Spy(model.parameters(), lr=lr), data, cfg)
    return lengths


def test_gradients_are_limited_to_the_maximal_length():
    cfg = PPOConfig(minibatch=36, epochs=3, max_grad_norm=0.01)
    lengths = gradients(cfg, lr=1e-3, scale=1000)
    assert len(lengths) == 3 * 4, (
        "every epoch uses all 128 samples, in minibatches of 36, 36, 36, 20"
    )
    hint = "a step is as long as the gradient: scale that of actor and critic together, every time"
    close(lengths, 0.01, hint, rtol=1e-3)
    free = gradients(replace(cfg, max_grad_norm=1e9), scale=1000)
    assert min(free) > 50, "the limit is a setting, and the test needs long gradients"
    assert free[-1] < 4 * free[0], (
        "gradients pile up from one step to the next: optimizer.zero_grad() before backward()"
    )
    assert len(np.unique(np.round(free, 3))) == 12, (
        "nothing moves, but each gradient is another one: every epoch shuffles the samples"
    )


def test_the_old_policy_stays_the_same_and_holds_the_new_one_back():
    cfg = PPOConfig(minibatch=128, epochs=60, clip=0.1, value_coef=0.0, max_grad_norm=1e9)
    model = fresh_model()
    watched = improve(model, torch.optim.Adam(model.parameters(), lr=3e-3), rollout(model), cfg)
    assert 0.001 < watched["approx_kl"] < 0.05, (
        f"after 60 rounds the policy has moved by {watched['approx_kl']:.3f} nats: π_old is that "
        "before the first gradient step and of the same `pick`, and the clipped objective pays "
        "nothing beyond 1 ± ε"
    )


@pytest.mark.parametrize("value_coef", [0.0, 0.5, 2.0])
def test_the_critic_s_weight_is_value_coef(value_coef):
    cfg = PPOConfig(minibatch=128, epochs=1, max_grad_norm=1e9, value_coef=value_coef)  # one step
    start, model = fresh_model(), fresh_model()
    data = rollout(model)
    judged = _, targets = ppo.judge(start, data, cfg)
    assert not any(numbers.requires_grad for numbers in judged), (
        "advantages and targets are numbers, which no gradient changes: no_grad"
    )
    improve(model, torch.optim.SGD(model.parameters(), lr=1e-2), data, cfg)
    (value_coef * ((start.value(data["obs"]) - targets) ** 2).mean()).backward()
    hint = "loss = −L + value_coef·L_V, L_V = mean (V − target)², without a half"
    for now, was in zip(model.critic.parameters(), start.critic.parameters()):
        torch.testing.assert_close(now, was - 1e-2 * was.grad, msg=hint)


def test_advantages_are_normalised():
    cfg = PPOConfig(minibatch=128, epochs=3, value_coef=0.0, max_grad_norm=1e9)

    def updated(**rewards):
        model = fresh_model()
        for tensor in model.critic[-1].parameters():
            torch.nn.init.zeros_(tensor)  # V = 0 and every step is the last: A = r
        data = rollout(model, **rewards)
        data["terminated"][:] = True
        improve(model, torch.optim.SGD(model.parameters(), lr=0.1), data, cfg)
        return parameters_to_vector(model.actor.parameters())

    start, plain = parameters_to_vector(fresh_model().actor.parameters()), updated()
    for changed, word in (
        (updated(scale=100.0), "the size of the rewards: divide by std"),
        (updated(shift=50.0), "a constant added to all rewards: subtract the mean"),
    ):
        apart = (changed - plain).norm() / (plain - start).norm()
        assert apart < 0.01, f"a policy must not depend on {word} ({apart:.0%})"
    cfg = replace(cfg, minibatch=16)
    apart = np.median(gradients(cfg, outlier=1e4)) / np.median(gradients(cfg))
    assert apart > 0.5, (
        "Â = (A − mean) / std over the MINIBATCH: over all samples a single huge reward makes the "
        f"gradients of the minibatches without it short ({apart:.0%})"
    )


def test_the_first_policy_of_a_training_is_made_as_it_is_told():
    class Neutral(Probe):
        neutral_action = [0.3]

    cfg = replace(SMALL, hidden=(8,), first_concentration=50.0, learning_rate=0.0)
    for world, first in ((Neutral, 0.3), (Probe, 0.5)):  # the neutral action, or else the middle
        model, _ = train(cfg, partial(world, play=constant), HERE, 1)
        with torch.no_grad():
            pi = model.policy(torch.zeros(1, 1))
        close(pi.mode, [[first]], atol=0.01)
        close(pi.mean * (1 - pi.mean) / pi.variance, [[51.0]], "α + β + 1", rtol=0.02)


def test_the_learning_rate_falls_to_zero():
    """By a training with another algorithm, which logs what it likes."""
    cfg = replace(SMALL, epochs=1, minibatch=128)
    rates, rollouts = [], []

    def watched(model, optimizer, data, cfg):
        for got, want in zip((data["advantage"], data["target"]), ppo.judge(model, data, cfg)):
            equal(got, want, "(2) judges what was collected, before (3)")
        rates.append(optimizer.param_groups[0]["lr"])
        rollouts.append(data)
        return {"loss": np.float32(0.5)}

    with mock.patch.object(ppo, "episode_means", wraps=ppo.episode_means) as means:
        _, rows = train(cfg, wandering, HERE, 4 * 128 + 1, improve=watched)
    assert len(means.call_args.args[0]) == cfg.rollout, "(4) logs the episodes of all its steps"
    assert [row["steps"] for row in rows] == [128, 256, 384, 512, 640], "whole updates, rounded up"
    want = cfg.learning_rate * np.array([1.0, 0.8, 0.6, 0.4, 0.2])
    close(rates, want, "linearly to 0 after the last update, and Adam has to be told")
    for one, other in itertools.pairwise(rollouts):
        goes_on = ~(one["terminated"] | one["truncated"])[-1]
        hint = "a rollout goes on where the last one ended"
        close(other["obs"][0][goes_on], one["next_obs"][-1][goes_on], hint)


def test_the_learning_curve_shows_each_column_below_its_title(shown):
    columns = "success fall time return entropy clip_fraction approx_kl explained_variance timeout"
    numbers = {name: 100 * k for k, name in enumerate(columns.split())}
    rows = [{name: k + number for name, number in numbers.items()} for k in range(40)]
    ppo.plot_learning_curve([row | {"steps": 1000 * row["success"]} for row in rows], "", "")
    words = "successes falls time return entropy samples change explained".split()
    robot, learner = shown[0].axes[::2], shown[0].axes[1::2]
    for k, (axes, title) in enumerate(zip(robot + learner, words, strict=True)):
        assert axes.get_title().splitlines()[-1].startswith(title)
        thousands, means = axes.lines[0].get_data()
        close(means - thousands, 100 * k, f"{title}: in the middle of what it is the mean of")


QUICK = PPOConfig(num_envs=4, rollout=16, minibatch=32, epochs=2, hidden=(8,))


def contents():
    return {path.name: path.read_bytes() for path in HERE.iterdir() if path.is_file()}


def wander(obs, action):
    """Short episodes with chance in it: where they begin, and (by the action) where they end."""
    after = np.clip(obs + (action - 0.5), -1, 1)
    return after, after[:, 0], after[:, 0] > 0.6, after[:, 0] < -0.6


wandering = partial(Probe, play=wander, starts=np.linspace(-0.5, 0.5, 1001, dtype=np.float32))


def test_a_killed_training_leaves_its_policy_so_far_and_the_next_one_says_so(capsys):
    """Its settings are numbers of numpy, as in a sweep by np.logspace; files hold plain ones."""
    cfg = replace(QUICK, learning_rate=np.float64(0.001), hidden=(np.int64(8),))
    about = {"push": np.array([0.4, 0.8]), "noise": np.bool_(True)}
    killed = mock.Mock(wraps=ppo.improve, side_effect=[mock.DEFAULT, KeyboardInterrupt])
    with pytest.raises(KeyboardInterrupt):
        train(cfg, wandering, HERE, 7 * 64, improve=killed, **about)
    assert contents().keys() == {"checkpoint.pt"}, "policy.pt is written at the end"
    early, stored = ppo.load_policy(HERE / "checkpoint.pt")
    plain = {"push": [0.4, 0.8], "noise": True, "hidden": [8], "steps": 7 * 64, "seed": 0}
    assert stored.items() >= plain.items() and "checkpoint" not in capsys.readouterr().out
    last, _ = train(cfg, wandering, HERE, 7 * 64, **about)
    assert "checkpoint.pt" in capsys.readouterr().out, "two trainings write the same files"
    assert contents().keys() == {"policy.pt", "learning_curve.csv"}
    assert (HERE / "learning_curve.csv").read_text("utf-8").startswith("steps,"), "names of columns"
    final, _ = ppo.load_policy(HERE / "policy.pt")
    assert final.decide([[0.3]]) == last.decide([[0.3]]) != early.decide([[0.3]])


def test_a_training_says_so_if_another_one_has_just_begun_there(capsys):
    """Before its first update, which takes minutes if it is large."""

    def begun(*given):
        train(QUICK, wandering, HERE, 64)
        return ppo.improve(*given)

    train(QUICK, wandering, HERE, 64, improve=begun)
    (line,) = capsys.readouterr().out.splitlines()
    assert "checkpoint.pt" in line and "still runs" in line, "two trainings write the same files"


@pytest.mark.parametrize("name", ["policy.pt", "learning_curve.csv", "checkpoint.pt"])
def test_a_file_that_cannot_be_written_is_one_line(name):
    with locked(name), pytest.raises(InputError, match=rf"\A.*{name}: Access is denied\Z"):
        train(QUICK, wandering, HERE, 2 * 64)
    hint = "the training is not lost: the checkpoint is its last policy"
    assert (HERE / "checkpoint.pt").exists() == (name != "checkpoint.pt"), hint
    assert not list(HERE.glob("*.tmp*")), "no half of a file is left"


def test_a_seed_is_a_training():
    def run(seed, **changes):
        model, _ = train(replace(QUICK, **changes), wandering, HERE, 3 * 64, seed)
        return model.decide([[0.3]])

    with mock.patch.object(Probe, "reset", autospec=True, side_effect=Probe.reset) as reset:
        assert run(0) == run(0), "the same seed gives the same policy"
        assert run(0, learning_rate=0.0) != run(1, learning_rate=0.0), "other first weights"
    seeds = [call.kwargs["seed"] for call in reset.mock_calls]
    assert seeds[0] == seeds[1] == seeds[2] != seeds[3], "other episodes, which begin once"


MINE = """
from dataclasses import replace
from importlib import import_module

env = import_module("03_env")
ours = env.robot_model.ROBOT
ROBOT = replace(ours, torso=replace(ours.torso, mass=3.0))
WALK = replace(env.walk_engine.TUNED["pymunk"], foot_rise=0.03)
LIMITS = env.StepLimits((-0.1, 0.0, -0.3), (0.1, 0.1, 0.3))
"""


@pytest.mark.parametrize("name, value", [
    ("single_action_space", gym.spaces.Box(-2, 2, (1,))),
    ("metadata", {"autoreset_mode": gym.vector.AutoresetMode.NEXT_STEP}),
])  # fmt: skip
def test_a_task_that_cannot_be_learned_here_is_refused_in_one_line(name, value):
    def other(num_envs):
        envs = Probe(num_envs, wander)
        setattr(envs, name, value)
        return envs

    with pytest.raises(InputError, match=r"\A.*actions in \[0, 1\] and .*SAME_STEP\Z"):
        train(QUICK, other, HERE, 64)
    assert not contents()


class Foreign:
    """What a file may contain that runs code when it is read carelessly."""

    def __reduce__(self):
        return Path.touch, (HERE / "touched",)


@pytest.mark.parametrize("damage", [
    lambda path: path.write_bytes(path.read_bytes()[:-3]),
    lambda path: torch.save({"fits": Foreign()}, path),
], ids=["its end", "code"])  # fmt: skip
def test_a_file_that_is_no_policy_is_refused_in_one_line(damage):
    path = HERE / "bad.pt"
    ppo.save_policy(path, ActorCritic(5, 2))
    damage(path)
    with pytest.raises(InputError, match=r"\A.*bad\.pt: damaged, or .*\Z"):
        ppo.load_policy(path)
    assert not (HERE / "touched").exists(), "reading a file ran code from inside it"


@pytest.fixture
def called(monkeypatch):
    """The command line calls this instead of `train`."""
    trained = mock.Mock(return_value=(None, []))
    monkeypatch.setattr(ppo, "train", trained)
    monkeypatch.setattr(ppo, "plot_learning_curve", mock.Mock())
    return trained


@pytest.mark.parametrize("arguments, steps, out, flags", [
    ("", 250_000, "runs/pymunk", ""),
    ("--quick", 60_000, "runs/pymunk/quick", ""),
    ("--mujoco", 250_000, "runs/mujoco", " --mujoco"),
    ("--quick --steps 70 --robot mine.py --out mine", 70, "mine", ' --robot "mine.py"'),
], ids=str)  # fmt: skip
def test_flags_reach_the_training(arguments, steps, out, flags, called, capsys):
    Path("mine.py").write_text(MINE, "utf-8")
    ppo.main([*arguments.split(), "--seed", "5"])
    command = f'05_evaluate.py --noise{flags} --policy "{Path(out, "policy.pt")}"\n'
    assert command in capsys.readouterr().out, "how to go on, in this simulator, with this robot"
    given = inspect.signature(train).bind(*called.call_args.args, **called.call_args.kwargs)
    make_envs = given.arguments.pop("make_envs")
    want = {"cfg": PPOConfig(), "out": Path(out), "total_steps": steps, "seed": 5}
    assert given.arguments == want and Path(out).is_dir()
    world = make_envs(1).world
    assert world.noise, "it learns from noisy goals"
    assert world.push == 0, "trained without pushes"
    assert world.sim == ("mujoco" if "--mujoco" in flags else "pymunk")
    assert (world.engine.robot.torso.mass == 3.0) == ("--robot" in flags)


@pytest.mark.parametrize("dash", "_-")
def test_each_setting_but_the_layers_is_a_flag(called, dash):
    usual = {name: value for name, value in vars(PPOConfig()).items() if name != "hidden"}
    others = {name: value / 2 if value < 1 else 2 * value for name, value in usual.items()}
    ppo.main([f"--{name.replace('_', dash)}={value}" for name, value in others.items()])
    assert called.call_args.args[0] == PPOConfig(**others)


@pytest.mark.parametrize("flag", [
    "--minibatch=0", "--gamma=7", "--clip=-1",
    "--first_concentration=2", "--learning_rate=nan", "--steps=0",
])  # fmt: skip
def test_a_flag_out_of_range_is_refused_in_one_line(capsys, flag):
    with pytest.raises(SystemExit, match="2"):
        ppo.main([flag])
    name, _ = flag.split("=")
    assert name in capsys.readouterr().err.splitlines()[-1], "say which flag is wrong"


def test_the_pendulum_of_the_course_is_another_task_for_the_same_learner():
    pendulum = import_module("starters.pendulum")
    pendulum.main(["--steps", "2049", "--out", "."])
    assert contents().keys() == {"policy.pt", "learning_curve.csv", "learning_curve.png"}
    assert ppo.load_policy(HERE / "policy.pt")[1]["steps"] == 2 * 16 * 128
