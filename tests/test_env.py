"""Stage 3, checked against the task: spaces, encoding, reward formulas by hand, episodes and their
ends, seeds and noise, and N robots together against N robots alone."""

import math
import warnings
from dataclasses import replace
from importlib import import_module

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

env = import_module("03_env")
robot_model, walk_engine = env.robot_model, env.walk_engine
BOTH = pytest.mark.parametrize("sim", ["pymunk", "mujoco"])
TASK = env.Task()
GAMMA = import_module("04_ppo").PPOConfig().gamma


@pytest.fixture
def make():
    """make(kind, ...): an environment or a world, closed after the test."""
    made = []

    def build(kind, *args, **kwargs):
        made.append(kind(*args, **kwargs))
        return made[-1]

    yield build
    for one in made:
        one.close()


def motion(poses, fell):
    """A Motion that ends at these poses [n, 3], for a physics that is told what to do."""
    n = len(poses)
    torso = np.zeros((n, 1, 6))
    torso[:, 0, [0, 1, 5]], torso[:, 0, 2] = poses, 0.38
    return robot_model.Motion(torso, np.zeros((n, 1, 12)), np.zeros((n, 3)), np.zeros((n, 2, 3)),
                              np.array(fell))


# ---------------------------------------------------------------- Gymnasium
@BOTH
def test_gymnasium_finds_nothing_to_complain_about(sim):
    one = gym.make("Footsteps-v0", sim=sim)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*render.*")
        warnings.filterwarnings("ignore", category=DeprecationWarning)
        check_env(one.unwrapped, skip_render_check=True)
    one.close()


def test_make_vec_gives_the_vector_environment():
    envs = gym.make_vec("Footsteps-v0", num_envs=3, vectorization_mode="vector_entry_point")
    assert isinstance(envs.unwrapped, env.FootstepVectorEnv)
    assert envs.metadata["autoreset_mode"] is gym.vector.AutoresetMode.SAME_STEP
    observations, _ = envs.reset(seed=0)
    assert envs.observation_space.contains(observations), "float32, inside the Box, [N, 20]"
    observations, rewards, terminated, truncated, _ = envs.step(envs.action_space.sample())
    assert envs.observation_space.contains(observations)
    assert rewards.shape == terminated.shape == truncated.shape == (3,)
    envs.close()


@BOTH
@pytest.mark.parametrize("noise", [False, True], ids=["exact", "noise"])
def test_robots_together_equal_robots_alone(make, sim, noise):
    n, seed, rng = 3, 11, np.random.default_rng(0)
    cores = 2 if sim == "pymunk" and noise else 1
    together = make(env.FootstepVectorEnv, n, sim, noise, imu=noise, cores=cores)
    alone = [make(env.FootstepEnv, sim, noise, imu=noise) for _ in range(n)]
    got, _ = together.reset(seed=seed)
    want = [one.reset(seed=seed + i)[0] for i, one in enumerate(alone)]
    np.testing.assert_array_equal(got, want, err_msg="robot i has the seed s + i")
    ends = 0
    for _ in range(25):
        actions = rng.integers(0, 2, (n, 6)).astype(np.float32)  # only extremes: they fall
        got, rewards, terminated, truncated, infos = together.step(actions)
        for i, one in enumerate(alone):
            last, reward, done, cut, info = one.step(actions[i])
            assert (reward, done, cut) == (rewards[i], terminated[i], truncated[i])
            for name, value in info["reward_terms"].items():
                assert infos["reward_terms"][name][i] == value
            if done or cut:
                ends += 1
                np.testing.assert_array_equal(infos["final_obs"][i], last)
                assert infos["final_info"]["fall"][i] == info["fall"]
                assert infos["final_info"]["time"][i] == info["time"]
                last, _ = one.reset()  # no seed: its generator goes on
            np.testing.assert_array_equal(got[i], last, err_msg=(
                "after an automatic reset: is the next goal drawn from the robot's own generator, "
                "and is the noise drawn equally often?"))
    assert ends >= 3, "random actions should make the robots fall: the resets were not tested"


def test_a_finished_episode_starts_anew_in_the_same_step(make, monkeypatch):
    envs = make(env.FootstepVectorEnv, 3, cores=1)
    goals = np.array([[1.0, 0, 0], [1.0, 1.0, 0.5], [-1.0, 0.3, 2.0]])
    first, _ = envs.reset(seed=3, options={"goals": goals})
    poses = np.array([[1.0, 0.02, 0.1], [0.4, 0.2, 0.1], [0.1, 0, 0]])
    fell = [False, False, True]
    monkeypatch.setattr(envs.world.sim, "run", lambda *_: motion(poses, fell))
    action = np.full((3, 6), 0.3)
    obs, _, terminated, truncated, infos = envs.step(action)
    np.testing.assert_array_equal(terminated, [True, False, True])
    np.testing.assert_array_equal(truncated, False)
    np.testing.assert_array_equal(infos["_final_obs"], [True, False, True])
    np.testing.assert_array_equal(infos["_final_info"], [True, False, True])
    np.testing.assert_array_equal(infos["final_info"]["success"], [True, False, False])
    np.testing.assert_array_equal(infos["final_info"]["fall"], fell)
    np.testing.assert_allclose(infos["final_info"]["time"], envs.world.engine.period)
    old = env.encode_goal(walk_engine.relative(poses, goals))
    for i in (0, 2):
        np.testing.assert_allclose(infos["final_obs"][i, :8], old[i], atol=1e-6, err_msg=(
            "final_obs is the LAST observation of the old episode"))
        np.testing.assert_allclose(obs[i, 8:], np.tile(2 * envs.neutral_action - 1, 2), atol=1e-6,
                                   err_msg="obs is the FIRST of the new one: nothing done yet")
        assert not np.allclose(obs[i, :8], old[i]), "a new goal is expected"
        assert envs.world.steps[i] == 0
    np.testing.assert_allclose(obs[1, :8], old[1], atol=1e-6)
    np.testing.assert_allclose(obs[1, 8:14], 2 * 0.3 - 1, atol=1e-6, err_msg="the last action")
    assert envs.world.steps[1] == 1
    fell[2] = False
    poses[:] = 0
    assert "final_obs" not in envs.step(action)[4], "only when an episode ended"


# ---------------------------------------------------------------- observation and action
def test_goal_is_encoded_as_in_the_table():
    d, beta, alpha = 0.3, math.radians(120), math.radians(-45)
    goal = np.array([d * math.cos(beta), d * math.sin(beta), alpha])
    want = [0.3, -0.3, 0.5196152, -0.5, 0.8660254, 0.7071068, -0.7071068, -0.25]
    np.testing.assert_allclose(env.encode_goal(goal), want, atol=1e-6, err_msg=(
        "d, 2d·cos β, 2d·sin β, cos β, sin β, cos α, sin α, α/π; α is not β"))
    far = env.encode_goal(np.array([4.0, -3.0, math.pi * 1.5]))
    assert far[0] == 3.0 and far[1] == 1.0 and far[2] == -1.0, "clipped: 3 m and ±1"
    assert far[7] == pytest.approx(-0.5), "270° is −90°: wrap the angle"


@BOTH
@pytest.mark.parametrize("imu", [False, True], ids=["plain", "imu"])
def test_observations_stay_inside_the_box(make, sim, imu):
    envs = make(env.FootstepVectorEnv, 8, sim, noise=True, imu=imu, cores=1)
    space, rng = envs.single_observation_space, np.random.default_rng(1)
    assert space.shape == (25 if imu else 20,) == (len(env.observation_table(imu)),)
    obs, _ = envs.reset(seed=5, options={"goals": 9 * rng.normal(size=(8, 3))})
    for _ in range(6):
        assert obs.dtype == np.float32 and envs.observation_space.contains(obs)
        obs = envs.step(rng.random((8, 6)))[0]


def test_imu_shows_the_tilt_of_the_torso(make, monkeypatch):
    one = make(env.FootstepEnv, imu=True)
    obs, _ = one.reset(seed=0)
    pitch = one.world.engine.parameters.trunk_pitch
    np.testing.assert_allclose(obs[20:], [0, 4 * pitch, 0, 0, 0], atol=1e-6, err_msg=(
        "it starts leaning forward as the walk engine wants it"))
    tilted = motion(np.zeros((1, 3)), [False])
    tilted.torso[0, 0, 3:5], tilted.spin[0] = (0.1, -0.2), (1.0, -20.0, 3.0)
    monkeypatch.setattr(one.world.sim, "run", lambda *_: tilted)
    obs = one.step(one.neutral_action)[0]
    np.testing.assert_allclose(obs[20:], [0.4, -0.8, 1.0, -10.0, 3.0], atol=1e-6)


@BOTH
def test_actions_and_footsteps_are_inverse(sim):
    limits, rng = walk_engine.LIMITS[sim], np.random.default_rng(2)
    action = rng.random((20, 6))
    footsteps = env.to_footsteps(action, limits)
    assert footsteps.shape == (20, 2, 3)
    np.testing.assert_allclose(env.to_action(footsteps, limits), action, atol=1e-12)
    for end, want in ((0.0, limits.low), (1.0, limits.high)):
        np.testing.assert_allclose(env.to_footsteps(np.full(6, end), limits), [want, want])
    assert env.to_action(np.full((2, 3), 9.0), limits).max() == 1.0, "clipped to [0, 1]"
    neutral = env.to_action(np.zeros((2, 3)), limits)
    assert ((neutral > 0) & (neutral < 1)).all()
    np.testing.assert_allclose(env.to_footsteps(neutral, limits), 0, atol=1e-12, err_msg=(
        "the neutral action steps on the spot; the middle, 0.5, does not"))


def test_the_last_two_actions_are_observed(make):
    one = make(env.FootstepEnv)
    one.reset(seed=0)
    neutral = one.neutral_action
    small = np.clip(neutral + [0.05, 0, 0, 0, 0.02, 0], 0, 1)
    np.testing.assert_allclose(one.step(small)[0][8:], np.r_[small, neutral] * 2 - 1, atol=1e-6)
    np.testing.assert_allclose(one.step(neutral)[0][8:], np.r_[neutral, small] * 2 - 1, atol=1e-6,
                               err_msg="newest first")


def test_wild_actions_are_clipped(make):
    one, other = make(env.FootstepEnv), make(env.FootstepEnv)
    one.reset(seed=0)
    other.reset(seed=0)
    wild = np.array([0.5, 7.0, 0.4, 0.5, 0.5, -3.0])
    got, want = one.step(wild), other.step(np.clip(wild, 0, 1))
    np.testing.assert_array_equal(got[0], want[0])
    assert got[1] == want[1]


# ---------------------------------------------------------------- rewards
def terms(before, after, action=None, last=None, fall=False, success=False):
    """Reward terms of one robot, plain floats."""
    action = np.zeros(6) if action is None else np.array(action, float)
    last = action if last is None else np.array(last, float)
    result = env.reward_terms(np.array([before], float), np.array([after], float), action[None],
                              last[None], np.array([fall]), np.array([success]), TASK)
    return {name: float(value[0]) for name, value in result.items()}


def test_reward_formulas_by_hand():
    # Far: from (2, 0) to (1, 1) seen from the robot, goal orientation 0 -> 0.5 rad.
    got = terms((2, 0, 0), (1, 1, 0.5))
    near0, near1 = math.exp(-25), math.exp(-2 / 0.16)  # exp(−(d / 0.4 m)²)
    assert got["r_d"] == pytest.approx(2 - math.sqrt(2)), "progress: d before − d after"
    assert got["r_a"] == pytest.approx(0.3 * (0 * near0 - 0.5 * near1), abs=1e-12)
    assert got["r_o"] == pytest.approx(0.1 * -(math.pi / 4) * (1 - near1)), "turned away: negative"
    assert got["r_time"] == -0.01 and got["r_fall"] == 0 and got["r_goal"] == 0
    # Close: at 0.4 m, near = 1/e; turning from α = −1 to −0.2 counts, the direction less.
    got = terms((0.4, 0, -1.0), (0.4, 0, -0.2))
    assert got["r_d"] == 0 and got["r_o"] == 0
    assert got["r_a"] == pytest.approx(0.3 * 0.8 / math.e), "|α|: both signs are alike"
    got = terms((-0.4, 0, 0), (0.4, 0, 0))
    assert got["r_o"] == pytest.approx(0.1 * math.pi * (1 - 1 / math.e)), "β: π -> 0"
    # Continuity: only the lengths x, y of both feet, squared, in shares of the limits.
    now, before = [0.5, 0.1, 0.9, 0.2, 0.4, 0.9], [0.2, 0.1, 0.0, 0.2, 0.8, 0.0]
    got = terms((1, 0, 0), (1, 0, 0), now, before)
    assert got["r_c"] == pytest.approx(-0.02 * (0.3**2 + 0.4**2)), "yaw must not count"
    assert terms((1, 0, 0), (1, 0, 0), fall=True)["r_fall"] == -TASK.s_fall
    assert terms((1, 0, 0), (1, 0, 0), success=True)["r_goal"] == TASK.s_goal


@BOTH
def test_reward_is_the_sum_of_its_terms(make, sim):
    envs = make(env.FootstepVectorEnv, 4, sim, cores=1)
    envs.reset(seed=2)
    rng, size = np.random.default_rng(3), 0.0
    for _ in range(6):
        before, last = envs.world.relative_goal(np.arange(4)), envs.world.actions[:, 0].copy()
        action = rng.random((4, 6))
        _, reward, _, _, infos = envs.step(action)
        parts = infos["reward_terms"]
        assert list(parts) == ["r_d", "r_a", "r_o", "r_c", "r_fall", "r_goal", "r_time"]
        np.testing.assert_allclose(reward, np.sum(list(parts.values()), 0), atol=1e-12)
        np.testing.assert_allclose(parts["r_c"], -TASK.s_c * (
            (action - last)[:, [0, 1, 3, 4]] ** 2).sum(1), atol=1e-12, err_msg=(
            "compare with the action before, not with the neutral one or with itself"))
        size = max(size, np.abs(before[:, 0]).max())
    assert size > 0.1


def test_going_in_circles_pays_nothing():
    rng = np.random.default_rng(4)
    path = rng.uniform([-2, -2, -3], [2, 2, 3], (30, 3))
    path[-1] = path[0]
    total = 0.0
    for a, b in zip(path, path[1:]):
        parts = terms(a, b)
        total += sum(value for name, value in parts.items() if name != "r_time")
    assert total == pytest.approx(0, abs=1e-9), "terms must pay for progress, and take it back"


def straight_walk(goal, step=0.15, turn=0.3, stop=0.0):
    """Goals seen from a robot that turns to the goal, walks to `stop` before it, turns to α."""
    d, alpha, beta = (float(v) for v in env.polar(np.array(goal, float)))
    heading, left, poses = 0.0, d, [np.array(goal, float)]

    def seen():
        b = beta - heading
        poses.append(np.array([left * math.cos(b), left * math.sin(b), alpha - heading]))

    while abs(beta - heading) > 1e-9:
        heading += float(np.clip(beta - heading, -turn, turn))
        seen()
    while left > stop + 1e-9:
        left = max(stop, left - step)
        seen()
    while abs(robot_model.wrap(alpha - heading)) > 1e-9 and not stop:
        heading += float(np.clip(robot_model.wrap(alpha - heading), -turn, turn))
        seen()
    return poses


def discounted(poses, steps=0, fall=False, success=False):
    """Return Σ γᵗ·r_t of a path that then waits until `steps` double steps are over."""
    poses = poses + [poses[-1]] * max(0, steps + 1 - len(poses))
    count, total = len(poses) - 1, 0.0
    for t, (a, b) in enumerate(zip(poses, poses[1:])):
        end = t == count - 1
        total += GAMMA**t * sum(terms(a, b, fall=fall and end, success=success and end).values())
    return total


GOALS = [(1, 0, 0), (3, 1, 2), (-1, -1, -1), (0.3, 0.2, 3), (-0.2, 0, 0.5)]


@BOTH
@pytest.mark.parametrize("goal", GOALS,
                         ids=str)
def test_returns_rank_what_we_want(sim, goal):
    period = walk_engine.WalkEngine(1, walk_engine.TUNED[sim]).period
    patience = int(TASK.time_limit / period)  # double steps until the time-out
    assert pytest.approx(0.98) == GAMMA
    walked = discounted(straight_walk(goal), success=True)
    stood = discounted([np.array(goal, float)], patience)
    fell = discounted([np.array(goal, float)] * 2, fall=True)
    loitered = discounted(straight_walk(goal, stop=0.06), patience)
    assert walked > stood + 0.1, f"to the goal {walked:.2f}, standing still {stood:.2f}"
    assert stood > fell + 0.1, f"standing still {stood:.2f}, falling at once {fell:.2f}"
    assert walked > loitered + 0.1, f"finishing {walked:.2f}, waiting next to it {loitered:.2f}"


# ---------------------------------------------------------------- goals, noise and seeds
def test_goals_are_spread_as_the_task_says_and_do_not_depend_on_their_number():
    goals = env.draw_goals(env.stream("evaluation", 0), 5000)
    np.testing.assert_allclose(goals.mean(0), 0, atol=0.08)
    np.testing.assert_allclose(goals[:, :2].std(0), TASK.goal_std_m, rtol=0.05)
    assert np.all(np.abs(goals[:, 2]) <= math.pi), "yaw is wrapped"
    share = np.mean(np.abs(goals[:, 2]) < math.pi / 2)  # N(0, π/2) wrapped: 0.683 and a bit more
    assert 0.64 < share < 0.73, f"{share:.2f} of the goals turn by less than 90°"
    np.testing.assert_array_equal(env.draw_goals(env.stream("evaluation", 0), 7), goals[:7],
                                  err_msg="draw [count, 3], goal after goal")


def test_streams_are_separate_and_repeatable():
    drawn = {(name, seed): env.stream(name, seed).normal(size=4)
             for name in ("training", "tuning", "evaluation") for seed in (0, 1)}
    values = list(drawn.values())
    for i, a in enumerate(values):
        for b in values[:i]:
            assert not np.allclose(a, b), "training must never see the goals of the evaluation"
    np.testing.assert_array_equal(env.stream("tuning", 1).normal(size=4), drawn["tuning", 1])


def test_the_same_seed_gives_the_same_episode(make):
    envs = [make(env.FootstepVectorEnv, 2, noise=True, cores=1) for _ in range(3)]
    starts = [e.reset(seed=s)[0] for e, s in zip(envs, (4, 4, 5))]
    np.testing.assert_array_equal(starts[0], starts[1])
    assert not np.allclose(starts[0], starts[2]), "another seed, other goals"
    np.testing.assert_array_equal(starts[0][1], starts[2][0], err_msg="4 + 1 is 5 + 0")
    action = np.tile(envs[0].neutral_action, (2, 1))
    for _ in range(3):
        np.testing.assert_array_equal(envs[0].step(action)[0], envs[1].step(action)[0])
    again, _ = envs[0].reset()
    assert not np.allclose(again, starts[0]), "a reset without a seed goes on drawing"


def test_noise_has_the_size_of_the_task_and_off_means_exact(make):
    goals = np.tile([0.5, -0.4, 3.13], (4000, 1))  # near ±π: noise has to be wrapped
    one = make(env.FootstepWorld, 1)
    world = make(env.FootstepWorld, 1, noise=True)
    for w in (one, world):
        w.reset([0], [env.stream("training", 0)], goals[:1])
    np.testing.assert_allclose(one.measure([0]), goals[:1], atol=1e-12)
    assert not one.noise and world.noise
    seen = np.array([world.measure([0])[0] for _ in range(4000)])
    assert np.all(np.abs(seen[:, 2]) <= math.pi), "wrap the noisy yaw"
    error = np.c_[seen[:, :2] - goals[:, :2], robot_model.wrap(seen[:, 2] - goals[:, 2])]
    np.testing.assert_allclose(error.std(0), [0.05, 0.05, 0.05], rtol=0.06)
    np.testing.assert_allclose(error.mean(0), 0, atol=0.004)
    correlation = np.corrcoef(error[:-1, 0], error[1:, 0])[0, 1]
    assert abs(correlation) < 0.06, "noise is drawn anew at every measurement"
    np.testing.assert_allclose(world.relative_goal([0]), goals[:1], atol=1e-12)


def test_a_goal_can_be_given(make):
    one = make(env.FootstepEnv)
    obs, _ = one.reset(seed=0, options={"goal": (0.3, 0.0, math.pi / 2)})
    np.testing.assert_allclose(obs[:8], [0.3, 0.6, 0, 1, 0, 0, 1, 0.5], atol=1e-6)


# ---------------------------------------------------------------- how an episode ends
@pytest.mark.parametrize("x, yaw_deg, fell, want", [
    (0.0, 0, False, "success"), (0.049, 9.9, False, "success"), (-0.049, -9.9, False, "success"),
    (0.051, 0, False, ""), (0.0, 10.1, False, ""), (0.0, -10.1, False, ""), (0.0, 180, False, ""),
    (0.0, 360, False, "success"), (0.0, 0, True, "fall"), (1.0, 0, True, "fall")])
def test_success_needs_place_and_orientation_and_no_fall(make, monkeypatch, x, yaw_deg, fell, want):
    one = make(env.FootstepEnv, noise=True)  # noise must not matter: the true pose counts
    goal = np.array([0.7, -0.2, 1.0])
    for seed in range(5):
        one.reset(seed=seed, options={"goal": goal})
        away = np.array([[x * 0.6, x * 0.8, math.radians(yaw_deg)]])
        with monkeypatch.context() as patch:
            patch.setattr(one.world.sim, "run", lambda *_, away=away: motion(goal + away, [fell]))
            _, _, terminated, truncated, info = one.step(one.neutral_action)
        got = [name for name in ("success", "fall", "timeout") if info[name]]
        assert got == ([want] if want else []), (
            f"{100 * x:.1f} cm and {yaw_deg}° away, fell: {fell}; success: 5 cm AND 10°, true "
            "pose, angles wrapped, and a fall wins")
        assert terminated == bool(want) and not truncated
        assert info["reward_terms"]["r_goal"] == TASK.s_goal * (want == "success")
        assert info["reward_terms"]["r_fall"] == -TASK.s_fall * (want == "fall")


@BOTH
def test_no_time_left_truncates_and_does_not_terminate(make, monkeypatch, sim):
    one = make(env.FootstepEnv, sim)
    period = one.world.engine.period
    whole = math.floor(TASK.time_limit / period + 1e-9)  # double steps that fit into 100 s
    goal = np.array([2.0, 0.0, 0.0])
    for steps, pose, fell, want in ((whole - 2, goal / 2, False, (False, False, False)),
                                    (whole - 1, goal / 2, False, (False, True, True)),
                                    (whole - 1, goal, False, (True, False, False)),
                                    (whole - 1, goal / 2, True, (True, False, False))):
        one.reset(seed=0, options={"goal": goal})
        one.world.steps[:] = steps
        monkeypatch.setattr(one.world.sim, "run", lambda *_, p=pose, f=fell: motion(p[None], [f]))
        _, _, terminated, truncated, info = one.step(one.neutral_action)
        assert (terminated, truncated, bool(info["timeout"])) == want, (
            f"after {steps + 1} of {whole} double steps: a time-out truncates, it does not "
            "terminate; goal and fall come first")
        assert info["time"] == pytest.approx((steps + 1) * period)
        assert info["time"] <= TASK.time_limit + 1e-9


def test_a_reset_clears_the_last_episode(make):
    one = make(env.FootstepEnv, task=replace(TASK, time_limit=3.0))
    first, _ = one.reset(seed=1)
    steps = 0
    while True:  # a short time limit instead of a patched clock: the whole way through
        _, _, terminated, truncated, info = one.step(one.neutral_action)
        steps += 1
        if terminated or truncated:
            break
    assert info["timeout"] and steps == math.floor(3.0 / one.world.engine.period + 1e-9)
    again, _ = one.reset(seed=1)
    np.testing.assert_array_equal(first, again)
    assert one.step(one.neutral_action)[4]["time"] == pytest.approx(one.world.engine.period)


@BOTH
def test_demonstration_planner_reaches_goals(make, sim):
    world = make(env.FootstepWorld, 16, sim, cores=1)
    everybody, seen = np.arange(16), []
    world.reset(everybody, [env.stream("training", 0, i) for i in everybody])
    outcome = env.walk_episodes(world, env.hand_written, everybody,
                                lambda robots, result: seen.extend(robots))
    assert set(outcome) <= {"success", "fall", "timeout"}
    assert np.mean(outcome == "success") > 0.5, f"the task must be solvable: {outcome}"
    np.testing.assert_array_equal(np.bincount(seen), world.steps, "one call a double step")


@BOTH
def test_benchmark_compares_with_the_physics_inside(sim, capsys):
    env.benchmark(sim, counts=(1, 3))
    _, head, *rows = capsys.readouterr().out.splitlines()
    columns = ("robots", "environment", "bare physics", "ratio", "planning", "kB per robot")
    assert all(name in head for name in columns)
    for count, row in zip((1, 3), rows, strict=True):
        robots, speed, bare, ratio, planning, _ = (float(cell) for cell in row.split())
        assert robots == count
        assert ratio == pytest.approx(speed / bare, abs=0.01)
        assert 0 < ratio < 1, "bare physics is a part of what the environment does"
        assert 0 < planning < 1 - ratio + 0.01, "a share of the time that physics leaves"
