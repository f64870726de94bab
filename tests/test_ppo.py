"""Stage 4, checked against theory: every equation by itself, then tiny worlds that isolate one
fault each, then files, resuming and the command line. A failing test names the likely mistake."""

import math
from importlib import import_module

import gymnasium as gym
import numpy as np
import pytest
import torch

ppo = import_module("04_ppo")

SMALL = ppo.PPOConfig(num_envs=16, rollout=16, minibatch=64, learning_rate=5e-3, gamma=0.5)


# ---------------------------------------------------------------- the equations
def brute_force_advantages(r, v, v_next, terminated, truncated, gamma, lam):
    """A_t = Σ_l (γλ)^l δ_{t+l}, written as the double sum, for one environment."""
    advantages = []
    for t in range(len(r)):
        total = 0.0
        for n in range(t, len(r)):
            delta = r[n] + (0.0 if terminated[n] else gamma * v_next[n]) - v[n]
            total += (gamma * lam) ** (n - t) * delta
            if terminated[n] or truncated[n]:
                break
        advantages.append(total)
    return advantages


@pytest.mark.parametrize("lam", [0.0, 0.95, 1.0])
def test_gae_equals_the_double_sum(lam):
    rng = np.random.default_rng(0)
    steps, robots, gamma = 30, 5, 0.9
    r, v, v_next = rng.normal(size=(3, steps, robots))
    terminated, truncated = rng.random((2, steps, robots)) < 0.15
    assert (terminated & truncated).any(), "the test should contain steps that are both"
    got = ppo.gae(*map(torch.tensor, (r, v, v_next, terminated, truncated)), gamma, lam)
    for i in range(robots):
        want = brute_force_advantages(r[:, i], v[:, i], v_next[:, i], terminated[:, i],
                                      truncated[:, i], gamma, lam)
        np.testing.assert_allclose(got[:, i], want, atol=1e-12, err_msg=(
            "does a fall zero V(s'), and do a fall AND a cut-off both stop the λ-sum?"))


def test_gae_never_looks_at_the_value_behind_a_fall():
    one = torch.ones(1, 1)
    fall = torch.ones(1, 1, dtype=torch.bool)
    advantage = ppo.gae(one, one, one * torch.nan, fall, ~fall, 0.9, 0.95)
    assert advantage.item() == 0.0, "0·nan is nan: select with torch.where instead of multiplying"


def test_beta_log_prob_integrates_to_one_and_equals_lgamma():
    x = np.linspace(0.0, 1.0, 20_001)[1:-1]
    for a, b in [(1.0, 1.0), (2.0, 5.0), (4.5, 1.2), (30.0, 60.0)]:
        column = torch.tensor(x)[:, None]
        log_p = ppo.beta_log_prob(column, torch.full_like(column, a), torch.full_like(column, b))
        area = np.sum(np.exp(log_p.numpy())) * (x[1] - x[0])
        assert area == pytest.approx(1.0, abs=2e-3), "the normalisation B(α, β) is wrong"
        i = 7_000
        want = ((a - 1) * math.log(x[i]) + (b - 1) * math.log(1 - x[i])
                + math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b))
        assert log_p[i].item() == pytest.approx(want, abs=1e-9), "check the sign of ln B(α, β)"


def test_joint_log_prob_and_entropy_sum_over_the_action():
    a, b, x = torch.tensor([[2.0, 3.0]]), torch.tensor([[4.0, 1.5]]), torch.tensor([[0.3, 0.6]])
    reference = torch.distributions.Beta(a, b)
    assert torch.allclose(ppo.beta_log_prob(x, a, b), reference.log_prob(x).sum(-1), atol=1e-5), (
        "independent variables: the joint log-probability is the SUM (not the mean)")
    assert torch.allclose(ppo.beta_entropy(a, b), reference.entropy().sum(-1), atol=1e-5)
    assert ppo.beta_entropy(torch.ones(1, 1), torch.ones(1, 1)).abs() < 1e-6


def test_beta_mode_is_where_the_density_is_largest():
    x = torch.linspace(1e-4, 1 - 1e-4, 9_999, dtype=torch.float64)[:, None]
    for a, b in [(2.0, 5.0), (9.0, 1.1), (1.5, 1.5), (400.0, 100.0)]:
        a, b = torch.tensor([a], dtype=torch.float64), torch.tensor([b], dtype=torch.float64)
        best = x[ppo.beta_log_prob(x, a, b).argmax()].item()
        assert ppo.beta_mode(a, b).item() == pytest.approx(best, abs=2e-4), (
            "mode = (α−1)/(α+β−2); α/(α+β) would be the mean")
    assert ppo.beta_mode(torch.ones(1), torch.ones(1)).item() == pytest.approx(0.5), "0/0"


def test_beta_decision_lies_between_mode_and_mean():
    alpha, beta = torch.tensor([1.1, 5.0, 1.0]), torch.tensor([3.0, 2.0, 1.0])
    mode, mean = ppo.beta_mode(alpha, beta), torch.distributions.Beta(alpha, beta).mean
    torch.testing.assert_close(ppo.beta_decision(alpha, beta, 0.0), mode)
    torch.testing.assert_close(ppo.beta_decision(alpha, beta, 1.0), mean)
    torch.testing.assert_close(ppo.beta_decision(alpha, beta), (mode + mean) / 2)


def test_clipped_objective_truth_table():
    table = [  # ratio, advantage, what may be gained with ε = 0.2
        (1.0, 2.0, 2.0), (1.5, 2.0, 2.4), (0.5, 2.0, 1.0),
        (1.0, -2.0, -2.0), (1.5, -2.0, -3.0), (0.5, -2.0, -1.6)]
    ratio, advantage, want = torch.tensor(table).T
    assert torch.allclose(ppo.clipped_objective(ratio, advantage, 0.2), want), (
        "take the minimum of both products; clipping the ratio alone forgives bad moves")


def test_numbers_to_watch():
    ratio = torch.tensor([0.7, 0.9, 1.0, 1.3])
    assert ppo.clip_fraction(ratio, 0.2).item() == 0.5
    want = float(np.mean(ratio.numpy() - 1 - np.log(ratio.numpy())))
    assert ppo.approx_kl(ratio.log()).item() == pytest.approx(want, abs=1e-6)
    target = torch.tensor([1.0, 2.0, 3.0])
    assert ppo.explained_variance(target, target).item() == 1.0
    assert ppo.explained_variance(torch.zeros(3), target).item() == pytest.approx(0.0)
    assert math.isnan(ppo.explained_variance(target, torch.ones(3)).item())
    assert ppo.value_loss(torch.zeros(2), torch.tensor([1.0, 3.0])).item() == 5.0


# ---------------------------------------------------------------- the networks
@pytest.mark.parametrize("distribution", ["beta", "gaussian"])
def test_first_policy_is_around_first_action(distribution):
    first, obs = [0.2, 0.5, 0.8], np.random.default_rng(0).normal(size=(100, 4))
    torch.manual_seed(0)
    model = ppo.ActorCritic(4, 3, distribution=distribution, first_action=first)
    mode = model.decide(obs)
    assert mode.shape == (100, 3) and mode.dtype == np.float32
    if distribution == "beta":
        with torch.no_grad():
            mode = ppo.beta_mode(*model.policy(torch.tensor(obs, dtype=torch.float32)))
    np.testing.assert_allclose(mode, np.tile(first, (100, 1)), atol=0.02, err_msg=(
        "the bias must be softplus⁻¹(m·(c−2)), and the last layer's weights small"))
    if distribution == "beta":
        alpha, beta = model.policy(torch.zeros(1, 4))
        assert torch.allclose(alpha + beta, torch.tensor(10.0), atol=0.5)


def test_samples_have_finite_log_probability_even_for_wild_networks():
    head = ppo.BetaHead(torch.full((1,), 0.5), 10.0)
    for raw in ([-1e4, -1e4], [1e6, -1e4], [-1e4, 1e6], [1e6, 1e6]):
        alpha, beta = head(torch.tensor([raw]).expand(1000, 2))
        assert (alpha >= 1).all() and (beta >= 1).all() and torch.isfinite(alpha + beta).all()
        x = head.sample(alpha, beta)
        assert torch.isfinite(head.log_prob(x, alpha, beta)).all(), "keep samples off 0 and 1"
        assert torch.isfinite(head.decide(alpha, beta)).all()


# ---------------------------------------------------------------- worlds that isolate one fault
class Probe(gym.vector.VectorEnv):
    """A world in two functions: first(rng, n) -> obs [n, 1] and
    play(obs, action) -> next obs, reward, terminated, truncated. Resets in the same step."""

    metadata = {"autoreset_mode": gym.vector.AutoresetMode.SAME_STEP}  # noqa: RUF012

    def __init__(self, num_envs, first, play):
        self.num_envs, self.first, self.play = num_envs, first, play
        self.single_observation_space = gym.spaces.Box(-1, 1, (1,))
        self.single_action_space = gym.spaces.Box(-2, 2, (1,))

    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.obs = self.first(self.rng, self.num_envs)
        return self.obs, {}

    def step(self, action):
        after, reward, terminated, truncated = self.play(self.obs, action)
        done = terminated | truncated
        infos = {"final_obs": after, "_final_obs": done, "final_info": {}} if done.any() else {}
        self.obs = np.where(done[:, None], self.first(self.rng, self.num_envs), after)
        return self.obs, reward, terminated, truncated, infos


def either(rng, n):  # first observation: 0 or 1
    return rng.integers(0, 2, (n, 1)).astype(np.float32)


def zero(rng, n):
    return np.zeros((n, 1), np.float32)


def learn(first, play, folder, updates=40, cfg=SMALL):
    model, _ = ppo.train(cfg, lambda n: Probe(n, first, play), folder,
                         updates * cfg.num_envs * cfg.rollout, progress=False)
    return model


def value(model, obs):
    return model.value(torch.tensor([[float(obs)]])).item()


def test_constant_reward_is_learned_as_the_value(tmp_path):
    def play(obs, action):
        yes = np.ones(len(obs), bool)
        return obs, np.ones(len(obs)), yes, ~yes
    assert value(learn(zero, play, tmp_path), 0) == pytest.approx(1.0, abs=0.1), (
        "one step, reward 1, then a fall: V = 1. The critic does not learn, or looks behind a fall")


def test_reward_two_steps_ahead_is_discounted_once(tmp_path):
    def play(obs, action):  # 0 -> 1 (reward 0), 1 -> end (reward 1)
        end = obs[:, 0] == 1
        return np.ones_like(obs), end.astype(float), end, np.zeros(len(obs), bool)
    model = learn(zero, play, tmp_path)
    assert value(model, 1) == pytest.approx(1.0, abs=0.1)
    assert value(model, 0) == pytest.approx(0.5, abs=0.1), "V(0) = γ·V(1) with γ = 0.5"


def test_cut_off_bootstraps_from_its_last_observation_and_a_fall_does_not(tmp_path):
    def play(obs, action):  # from 0: cut off at observation 1; from 1: fall with reward 1
        fall = obs[:, 0] == 1
        return np.ones_like(obs), fall.astype(float), fall, ~fall
    v = value(learn(either, play, tmp_path), 0)
    assert v == pytest.approx(0.5, abs=0.07), (
        f"V(0) = {v:.2f}, expected γ·V(1) = 0.50. 0.00: a cut-off is treated like a fall; "
        "0.33: bootstrapped from the first observation of the NEXT episode")


def test_a_fall_ends_the_future(tmp_path):
    def play(obs, action):  # reward 1 and a fall or a cut-off, told apart by the observation
        fall = obs[:, 0] == 1
        return obs, np.ones(len(obs)), fall, ~fall
    model = learn(either, play, tmp_path)
    assert value(model, 1) == pytest.approx(1.0, abs=0.1), "after a fall nothing follows: V = 1"
    assert value(model, 0) == pytest.approx(2.0, abs=0.2), "cut off: V = 1/(1−γ) = 2"


@pytest.mark.parametrize("distribution", ["beta", "gaussian"])
def test_action_goes_to_the_target(tmp_path, distribution):
    def play(obs, action):  # best action 1.2 of [-2, 2], that is 0.8 of [0, 1]
        yes = np.ones(len(obs), bool)
        return obs, -((action[:, 0] - 1.2) ** 2), yes, ~yes
    cfg = ppo.PPOConfig(**{**vars(SMALL), "distribution": distribution})
    mode = learn(zero, play, tmp_path, cfg=cfg).decide(np.zeros((1, 1)))
    assert mode.item() == pytest.approx(0.8, abs=0.05), (
        "wrong sign of the objective, or actions not scaled from [0, 1] to [low, high]")


def test_action_depends_on_the_observation(tmp_path):
    def play(obs, action):  # best action −1 (0.25 of [0, 1]) at 0, and +1 (0.75) at 1
        yes = np.ones(len(obs), bool)
        return obs, -((action[:, 0] - (2 * obs[:, 0] - 1)) ** 2), yes, ~yes
    mode = learn(either, play, tmp_path).decide(np.array([[0.0], [1.0]]))[:, 0]
    np.testing.assert_allclose(mode, [0.25, 0.75], atol=0.08, err_msg=(
        "do observation, action and advantage still belong together after shuffling?"))


def pendulum(num_envs):
    return ppo.gym_envs("Pendulum-v1")(num_envs)


def test_a_short_training_improves_the_pendulum(tmp_path):
    cfg = ppo.PPOConfig(**ppo.PRESETS["Pendulum-v1"])
    _, rows = ppo.train(cfg, pendulum, tmp_path, 60_000, progress=False)
    first, last = rows[1]["return"], ppo.recent_mean(rows, "return")
    assert last > first + 300, f"return went from {first:.0f} to {last:.0f} only"
    assert rows[1]["length"] == 200, "episodes of Pendulum have 200 steps"
    assert math.isnan(rows[-1]["success"]), "not reported by Pendulum: nan, not 0"


# ---------------------------------------------------------------- resuming and files
QUICK = ppo.PPOConfig(num_envs=4, rollout=16, minibatch=32, epochs=2, checkpoint_every=2)


def same(model, other):
    a, b = model.state_dict(), other.state_dict()
    return a.keys() == b.keys() and all(torch.equal(a[key], b[key]) for key in a)


def test_resume_is_bit_for_bit(tmp_path, monkeypatch):
    def run(folder, resume=False):
        return ppo.train(QUICK, pendulum, folder, 7 * 64, seed=3, resume=resume, progress=False)

    model, rows = run(tmp_path / "whole")
    calls, improve = [], ppo.improve

    def interrupted(*args):
        calls.append(1)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return improve(*args)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(ppo, "improve", interrupted)
        run(tmp_path / "parts")
    assert not (tmp_path / "parts" / "policy.pt").exists()
    resumed, resumed_rows = run(tmp_path / "parts", resume=True)
    assert same(model, resumed), (
        "something crosses the checkpoint: generator, episodes, Adam's state or learning rate?")
    for row, other in zip(rows, resumed_rows, strict=True):
        for name in set(ppo.COLUMNS) - {"minutes", "learning_ms"}:
            np.testing.assert_equal(row[name], other[name])
    stored, _ = ppo.load_policy(tmp_path / "parts" / "policy.pt")
    assert same(model, stored)


def test_resume_refuses_other_settings(tmp_path):
    def run(**changes):
        return ppo.train(QUICK, pendulum, tmp_path, **{"total_steps": 128, "seed": 0,
                                                       "progress": False, **changes})
    with pytest.raises(ppo.PolicyError, match="no such file"):
        run(resume=True)
    model, _ = run()
    assert same(model, run(resume=True)[0]), "a finished training is returned as it is"
    for changes in ({"seed": 1}, {"total_steps": 256}, {"fits": {"simulator": "mujoco"}}):
        with pytest.raises(ppo.PolicyError, match="cannot resume: (seed|steps|simulator) is"):
            run(resume=True, **changes)


FITS = {"simulator": "pymunk", "limits": [0.1, 0.2]}
META = {"fits": FITS, "steps": 10, "minutes": 0.5, "seed": 0, "config": {}}


def test_policy_survives_the_disk_and_the_old_one_is_kept(tmp_path):
    path, obs = tmp_path / "policy.pt", np.random.default_rng(0).normal(size=(7, 5))
    old, new = ppo.ActorCritic(5, 2), ppo.ActorCritic(5, 2, distribution="gaussian")
    ppo.save_policy(path, old, META)
    ppo.save_policy(path, new, META)
    model, meta = ppo.load_policy(path)
    assert np.array_equal(model.decide(obs), new.decide(obs))
    assert meta["steps"] == 10 and meta["distribution"] == "gaussian" and meta["fits"] == FITS
    previous, _ = ppo.load_policy(tmp_path / "policy.previous.pt")
    assert same(previous, old)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["policy.previous.pt", "policy.pt"]


def test_a_difference_names_both_sides_and_the_simulator_first():
    other = {"simulator": "mujoco", "limits": [9, 9]}
    assert ppo.difference(FITS, other) == "simulator is pymunk in the file, but mujoco here"
    other["simulator"] = "pymunk"
    assert ppo.difference(FITS, other) == "limits is [0.1, 0.2] in the file, but [9, 9] here"
    assert ppo.difference(FITS, dict(FITS)) == ""


def test_foreign_files_are_refused_with_one_line(tmp_path):
    good, bad = tmp_path / "policy.pt", tmp_path / "bad.pt"
    ppo.save_policy(good, ppo.ActorCritic(5, 2), META)
    stored = torch.load(good, weights_only=True)
    broken = dict(stored["state_dict"])
    broken["critic.0.bias"] = broken["critic.0.bias"] * math.nan
    contents = {
        "text": lambda: bad.write_text("hello"),
        "empty": lambda: bad.write_bytes(b""),
        "half": lambda: bad.write_bytes(good.read_bytes()[:3000]),
        "a pickled class": lambda: torch.save(ppo.ActorCritic(5, 2), bad),
        "a list": lambda: torch.save([1, 2], bad),
        "another format": lambda: torch.save({"format": 99}, bad),
        "no weights": lambda: torch.save({"format": 1}, bad),
        "another shape": lambda: torch.save({**stored, "obs_dim": 6}, bad),
        "another head": lambda: torch.save({**stored, "distribution": "poisson"}, bad),
        "nan": lambda: torch.save({**stored, "state_dict": broken}, bad),
    }
    for name, write in contents.items():
        write()
        with pytest.raises(ppo.PolicyError) as caught:
            ppo.load_policy(bad)
        assert len(str(caught.value).splitlines()) == 1 and "bad.pt" in str(caught.value), name
    with pytest.raises(ppo.PolicyError, match="no such file"):
        ppo.load_policy(tmp_path / "missing.pt")


def test_a_failing_save_leaves_the_good_policy_alone(tmp_path, monkeypatch):
    path = tmp_path / "policy.pt"
    ppo.save_policy(path, ppo.ActorCritic(5, 2), META)
    before = path.read_bytes()
    with pytest.raises(TypeError):  # an array is not plain
        ppo.save_policy(path, ppo.ActorCritic(5, 2), {"fits": np.zeros(3)})

    def disk_full(*args):
        raise OSError("no space left on device")
    monkeypatch.setattr(torch, "save", disk_full)
    with pytest.raises(OSError, match="no space"):
        ppo.save_policy(path, ppo.ActorCritic(5, 2), META)
    assert path.read_bytes() == before


# ---------------------------------------------------------------- the command line
@pytest.mark.parametrize("arguments", [
    ["--steps", "0"], ["--steps", "-5"], ["--steps", "many"], ["--seed", "-1"], ["--seed", "x"],
    ["--env", "Pendulum-v1", "--mujoco"], ["--env", "NoSuchWorld-v0"], ["--env", "CartPole-v1"],
    ["--env", "Pendulum-v1", "--resume"], ["--unknown"],
    ["--env", "Pendulum-v1", "--out", "a_file"], ["--env", "Pendulum-v1", "--out", "a_file/sub"],
], ids=" ".join)
def test_wrong_values_get_one_line_and_exit_code_2(arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a_file").write_text("not a folder")
    with pytest.raises(SystemExit) as caught:
        ppo.main(arguments)
    message = capsys.readouterr().err
    assert caught.value.code == 2, message
    assert len(message.splitlines()) == 1 and message.startswith("04_ppo.py: "), message


def test_command_line_trains_resumes_and_can_be_interrupted(tmp_path, monkeypatch, capsys):
    arguments = ["--env", "Pendulum-v1", "--steps", "4096", "--out", str(tmp_path)]
    ppo.main(arguments)
    assert "100 episodes: return -" in capsys.readouterr().out
    assert {"policy.pt", "checkpoint.pt", "learning_curve.csv", "learning_curve.png"} == {
        path.name for path in tmp_path.iterdir()}
    header, *table = (tmp_path / "learning_curve.csv").read_text().splitlines()
    assert header == ",".join(ppo.COLUMNS)
    assert [line.split(",")[0] for line in table] == ["2048", "4096"]
    before = (tmp_path / "policy.pt").read_bytes()
    ppo.main([*arguments, "--resume"])
    assert "already finished" in capsys.readouterr().out
    assert (tmp_path / "policy.pt").read_bytes() == before

    def interrupt(*args):
        raise KeyboardInterrupt
    monkeypatch.setattr(ppo, "improve", interrupt)
    with pytest.raises(SystemExit) as caught:
        ppo.main(arguments)
    assert caught.value.code == 130 and "interrupted" in capsys.readouterr().err
    assert (tmp_path / "policy.pt").read_bytes() == before
