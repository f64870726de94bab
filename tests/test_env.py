"""Stage 3, checked against the task: spaces, encoding, reward formulas by hand and along real
walks, episodes and their ends, arrival, seeds and noise, ground and body, what a planner may know,
N robots together against N robots alone, and what is refused at the door. A failing test names the
likely mistake."""

import itertools
import math
import re
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
    return robot_model.Motion(torso, np.zeros((n, 1, 12)), np.zeros((n, 3)), np.array(fell))

def seen_from(pose, goal):
    """A goal seen from a robot, both (x, y, yaw), by turning in the complex plane: x, y, α."""
    place = complex(goal[0] - pose[0], goal[1] - pose[1]) * np.exp(-1j * pose[2])
    alpha = np.angle(np.exp(1j * (goal[2] - pose[2])))
    return place.real, place.imag, float(alpha)

# ------------------------------------------------------------------------ Gymnasium
@BOTH
def test_gymnasium_finds_nothing_to_complain_about(sim):
    one = gym.make("Footsteps-v0", sim=sim)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*render.*")
        warnings.filterwarnings("ignore", category=DeprecationWarning)
        check_env(one.unwrapped, skip_render_check=True)
    one.close()

@BOTH
def test_stable_baselines_finds_nothing_to_complain_about(sim):
    """Skipped without it; our vector environment with it: tests/studies/stable_baselines.py."""
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    one = gym.make("Footsteps-v0", sim=sim)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # Its Gaussian policies like −1…1; a Beta policy, ours, has 0…1.
        warnings.filterwarnings("ignore", message=".*symmetric and normalized Box action space")
        checker.check_env(one.unwrapped)
    one.close()

def test_make_vec_gives_the_vector_environment():
    envs = gym.make_vec("Footsteps-v0", num_envs=3, vectorization_mode="vector_entry_point",
                        cores=1)
    assert isinstance(envs.unwrapped, env.FootstepVectorEnv)
    assert envs.metadata["autoreset_mode"] is gym.vector.AutoresetMode.SAME_STEP
    observations, _ = envs.reset(seed=0)
    assert envs.observation_space.contains(observations), "float32, inside the Box, [N, 20]"
    observations, rewards, terminated, truncated, _ = envs.step(envs.action_space.sample())
    assert envs.observation_space.contains(observations)
    assert rewards.shape == terminated.shape == truncated.shape == (3,)
    envs.close()

@BOTH
@pytest.mark.parametrize("mode", ["sync", "async"])
def test_gymnasium_can_make_a_vector_of_single_robots(make, sim, mode):
    own = make(env.FootstepVectorEnv, 2, sim, cores=1)
    envs = gym.make_vec("Footsteps-v0", num_envs=2, vectorization_mode=mode, sim=sim)
    try:
        np.testing.assert_array_equal(envs.reset(seed=4)[0], own.reset(seed=4)[0], err_msg=(
            "robot i has the seed s + i, in Gymnasium's vectors and in ours"))
        for share in (0.5, 0.4):
            action = np.full((2, 6), share, np.float32)
            got, want = envs.step(action), own.step(action)
            np.testing.assert_array_equal(got[0], want[0])
            for one, other in zip(got[1:4], want[1:4]):  # reward, terminated, truncated
                np.testing.assert_array_equal(one, other)
    finally:
        envs.close()

@BOTH
@pytest.mark.parametrize("noise", [False, True], ids=["exact", "noise"])
@pytest.mark.parametrize("n", [3, pytest.param(64, marks=pytest.mark.slow)])
def test_robots_together_equal_robots_alone(make, sim, noise, n):
    seed, rng, task = 11, np.random.default_rng(0), replace(TASK, time_limit=8.0)
    cores = 2 if noise else 1  # several processes or threads must make no difference, either
    together = make(env.FootstepVectorEnv, n, sim, noise, imu=noise, cores=cores, task=task)
    alone = [make(env.FootstepEnv, sim, noise, imu=noise, task=task) for _ in range(n)]
    got, _ = together.reset(seed=seed)
    want = [one.reset(seed=seed + i)[0] for i, one in enumerate(alone)]
    np.testing.assert_array_equal(got, want, err_msg="robot i has the seed s + i")
    ends = {"fall": 0, "timeout": 0}
    for _ in range(30):
        actions = (together.neutral_action + rng.uniform(-0.1, 0.1, (n, 6))).astype(np.float32)
        actions[:, [0, 3]] = rng.integers(0, 2, (n, 2))  # as far ahead or back as it goes: falls
        got, rewards, terminated, truncated, infos = together.step(actions)
        for i, one in enumerate(alone):
            last, reward, done, cut, info = one.step(actions[i])
            assert (reward, done, cut) == (rewards[i], terminated[i], truncated[i])
            for name, value in info["reward_terms"].items():
                assert infos["reward_terms"][name][i] == value
            if done or cut:
                np.testing.assert_array_equal(infos["final_obs"][i], last)
                for name in ("success", "fall", "timeout", "time"):
                    assert infos["final_info"][name][i] == info[name]
                for name in ends:
                    ends[name] += info[name]
                last, _ = one.reset()  # no seed: its generator goes on
            np.testing.assert_array_equal(got[i], last, err_msg=(
                "after an automatic reset: are the next goal, ground and body drawn from the "
                "robot's own generator, and is the noise drawn equally often?"))
    assert min(ends.values()) >= 1 and sum(ends.values()) >= 3, (
        f"these actions should make the robots fall: the resets were not tested, {ends}")

@BOTH
def test_some_robots_walk_while_the_others_wait(make, sim):
    some, everybody = np.array([3, 1]), np.arange(4)
    one, other = (make(env.FootstepWorld, 4, sim, cores=1) for _ in range(2))
    for world in (one, other):
        world.reset(everybody, [env.stream("training", 5, i) for i in everybody])
    action = np.random.default_rng(5).uniform(0.3, 0.7, (4, 6))
    for _ in range(2):
        got, want = one.step(action[some], some), other.step(action, everybody)
        np.testing.assert_array_equal(got["reward"], want["reward"][some], err_msg=(
            "row k of the actions belongs to robots[k]; are the rows mixed up?"))
        for name in ("pose", "tilt", "actions", "steps", "goal"):
            np.testing.assert_array_equal(getattr(one, name)[some], getattr(other, name)[some])
    waiting = [0, 2]
    assert not one.pose[waiting].any() and not one.steps[waiting].any(), "the others must not move"
    np.testing.assert_array_equal(one.actions[waiting], np.tile(one.neutral_action, (2, 2, 1)))
    for world in (one, other):
        world.reset([1], goals=[[1.0, 0, 0]])
    torso = one.step(action[some], some)["motion"].torso
    np.testing.assert_array_equal(torso, other.step(action, everybody)["motion"].torso[some],
                                  err_msg="robot 1 begins anew, robot 3 walks on")

def test_a_finished_episode_starts_anew_in_the_same_step(make, monkeypatch):
    envs = make(env.FootstepVectorEnv, 3, cores=1)
    goals = np.array([[1.0, 0, 0], [1.0, 1.0, 0.5], [-1.0, 0.3, 2.0]])
    envs.reset(seed=3, options={"goals": goals})
    poses = np.array([[1.0, 0.02, 0.1], [0.4, 0.2, 0.1], [0.1, 0, 0]])
    fell = [False, False, False]
    monkeypatch.setattr(envs.world.sim, "run", lambda *_: motion(poses, fell))
    action = np.full((3, 6), 0.3)
    assert "final_obs" not in envs.step(action)[4], "once at the goal is not yet arrived"
    fell[2] = True
    obs, _, terminated, truncated, infos = envs.step(action)
    np.testing.assert_array_equal(terminated, [True, False, True])
    np.testing.assert_array_equal(truncated, False)
    np.testing.assert_array_equal(infos["_final_obs"], [True, False, True])
    np.testing.assert_array_equal(infos["_final_info"], [True, False, True])
    np.testing.assert_array_equal(infos["final_info"]["success"], [True, False, False])
    np.testing.assert_array_equal(infos["final_info"]["fall"], fell)
    np.testing.assert_allclose(infos["final_info"]["time"] / envs.world.engine.period, [1, 2, 2])
    old = env.encode_goal(np.array([seen_from(p, g) for p, g in zip(poses, goals)]))
    for i in (0, 2):
        np.testing.assert_allclose(infos["final_obs"][i, :8], old[i], atol=1e-6, err_msg=(
            "final_obs is the LAST observation of the old episode"))
        np.testing.assert_allclose(obs[i, 8:], np.tile(2 * envs.neutral_action - 1, 2), atol=1e-6,
                                   err_msg="obs is the FIRST of the new one: nothing done yet")
        assert not np.allclose(obs[i, :8], old[i]), "a new goal is expected"
        assert envs.world.steps[i] == 0
    np.testing.assert_allclose(obs[1, :8], old[1], atol=1e-6)
    np.testing.assert_allclose(obs[1, 8:], 2 * 0.3 - 1, atol=1e-6, err_msg="the last actions")
    assert envs.world.steps[1] == 2
    fell[2] = False
    poses[:] = 0
    assert "final_obs" not in envs.step(action)[4], "only when an episode ended"

# ------------------------------------------------------------------------ observation and action
def test_goal_is_encoded_as_in_the_table():
    d, beta, alpha = 0.3, math.radians(120), math.radians(-45)
    goal = np.array([d * math.cos(beta), d * math.sin(beta), alpha])
    want = [0.3, -0.3, 0.5196152, -0.5, 0.8660254, 0.7071068, -0.7071068, -0.25]
    np.testing.assert_allclose(env.encode_goal(goal), want, atol=1e-6, err_msg=(
        "d, 2d·cos β, 2d·sin β, cos β, sin β, cos α, sin α, α/π; α is not β"))
    far = env.encode_goal(np.array([4.0, -3.0, math.pi * 1.5]))
    assert far[0] == 3.0 and far[1] == 1.0 and far[2] == -1.0, "clipped: 3 m and ±1"
    assert far[7] == pytest.approx(-0.5), "270° is −90°: wrap the angle"
    for x, y, yaw in np.random.default_rng(6).uniform([-2, -2, -9], [2, 2, 9], (14, 3)):
        d, alpha = math.hypot(x, y), math.atan2(math.sin(yaw), math.cos(yaw))
        want = [min(d, 3), max(-1, min(1, 2 * x)), max(-1, min(1, 2 * y)), x / d, y / d,
                math.cos(yaw), math.sin(yaw), alpha / math.pi]
        got = env.encode_goal(np.array([x, y, yaw]))
        np.testing.assert_allclose(got, want, atol=1e-9, err_msg=(
            "y to the left and α counter-clockwise are positive"))

@pytest.mark.parametrize("shape", [(1,), (7,), (2, 3)], ids=str)
def test_many_goals_are_encoded_each_by_itself(shape):
    goals = np.random.default_rng(6).uniform([-2, -2, -9], [2, 2, 9], (*shape, 3))
    encoded = env.encode_goal(goals)
    assert encoded.shape == (*shape, 8), "goals [..., 3] -> [..., 8]: write x as goal[..., 0]"
    for i in np.ndindex(shape):
        np.testing.assert_allclose(encoded[i], env.encode_goal(goals[i]), atol=1e-9, err_msg=(
            f"goal {i} of a batch is another one than alone: no goal may depend on another one"))

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
    obs = one.step(one.world.neutral_action)[0]
    np.testing.assert_allclose(obs[20:], [0.4, -0.8, 1.0, -10.0, 3.0], atol=1e-6, err_msg=(
        "roll, pitch in quarters of a radian, then the angular velocity x, y, z, clipped at 10"))

@BOTH
def test_imu_is_only_added_to_what_is_seen_without_it(make, sim):
    world, robots = make(env.FootstepWorld, 3, sim, cores=1), np.array([0, 1, 2])
    world.reset(robots, [env.stream("training", 0, i) for i in robots])
    motions = world.step(np.random.default_rng(7).uniform(0.3, 0.7, (3, 6)), robots)["motion"]
    goals = world.measure(robots)
    plain, more = world.observe(robots, goals), world.observe(robots, goals, imu=True)
    np.testing.assert_array_equal(more[:, :20], plain)
    tilt = np.concatenate([4 * motions.torso[:, -1, 3:5], motions.spin], -1)
    np.testing.assert_allclose(more[:, 20:], tilt, atol=1e-5, err_msg=(
        "the tilt at the LAST control tick of the double step, of the same robot"))

def load(footstep, limits):
    """Sum of the shares of x, y and yaw of one footstep (x, y, yaw)."""
    return sum(v / high if v > 0 else v / low
               for v, low, high in zip(footstep, limits.low, limits.high))

SHARES = ("0 is low, 1 is high, 0.5 their middle, for both feet, outward positive; first the left "
          "foot's x, y, yaw, then the right foot's")

@BOTH
def test_actions_and_footsteps_are_inverse(sim):
    limits, rng = walk_engine.LIMITS[sim], np.random.default_rng(2)
    low, high = np.tile(limits.low, 2), np.tile(limits.high, 2)  # [6]
    for k, share in itertools.product(range(6), (0.0, 0.5, 1.0)):  # and all the rest is zero steps
        shares, want = -low / (high - low), np.zeros(6)
        shares[k], want[k] = share, low[k] + share * (high[k] - low[k])
        got = np.ravel(env.to_footsteps(shares, limits))
        np.testing.assert_allclose(got, want, atol=1e-12, err_msg=SHARES)
    drawn = rng.uniform(limits.low, limits.high, (2000, 2, 3))
    allowed = np.array([f for f in drawn if max(load(foot, limits) for foot in f) <= limits.load])
    assert 100 < len(allowed) < 1900, "the test should see both kinds"
    action = env.to_action(allowed, limits)
    assert action.shape == (len(allowed), 6), "footsteps [..., 2, 3] -> actions [..., 6]"
    assert action.min() >= 0 and action.max() <= 1, "to_action: the low limit is 0, the high one 1"
    np.testing.assert_allclose(env.to_footsteps(action, limits), allowed, atol=1e-12, err_msg=(
        "to_action is the inverse: what is allowed is walked as asked for"))
    some = action[:6].reshape(2, 3, 6)
    assert env.to_footsteps(some, limits).shape == (2, 3, 2, 3), "actions [..., 6], any [...]"
    neutral = env.to_action(np.zeros((2, 3)), limits)
    assert ((neutral > 0) & (neutral < 1)).all()
    np.testing.assert_allclose(env.to_footsteps(neutral, limits), 0, atol=1e-12, err_msg=(
        "the neutral action steps on the spot; the middle, 0.5, does not"))
    for k, (end, bounds) in itertools.product(range(6), enumerate((limits.low, limits.high))):
        single, want = neutral.copy(), np.zeros(6)
        single[k], want[k] = end, bounds[k % 3]
        np.testing.assert_allclose(env.to_footsteps(single, limits).ravel(), want, atol=1e-12,
                                   err_msg=("0 is the lower limit and 1 the upper; first the left "
                                            "foot's x, y, yaw, then the right foot's"))
    assert env.to_action(np.full((2, 3), 9.0), limits).max() == 1.0, "clipped to [0, 1]"
    assert env.to_action(np.full((2, 3), -9.0), limits).min() == 0.0, "clipped to [0, 1]"

@BOTH
def test_a_footstep_that_asks_for_too_much_is_made_smaller_and_not_turned(sim):
    limits = walk_engine.LIMITS[sim]
    corners = np.array(list(itertools.product((0.0, 1.0), repeat=6)))
    actions = np.concatenate([corners, np.random.default_rng(3).random((400, 6))])
    cases = []  # (load, what is asked for, what comes) of every foot
    for action, footsteps in zip(actions, env.to_footsteps(actions, limits), strict=True):
        for share, footstep in zip(action.reshape(2, 3), footsteps):
            asked = [lo + s * (hi - lo) for s, lo, hi in zip(share, limits.low, limits.high)]
            cases.append((load(asked, limits), asked, footstep))
    cases.sort(key=lambda case: case[0])  # first what is possible
    assert cases[0][0] < limits.load < cases[-1][0], "the test should see both kinds"
    for much, asked, footstep in cases:
        shrink = min(1, limits.load / much)  # of all three: it goes the same way
        np.testing.assert_allclose(footstep, np.multiply(asked, shrink), atol=1e-12, err_msg=(
            SHARES if much <= limits.load else
            f"more than the load of {limits.load} is asked for: is `within` missing? It makes x, y "
            "and yaw smaller alike, each foot by itself"))
        assert load(footstep, limits) <= limits.load + 1e-9

def test_the_last_two_actions_are_observed(make):
    one = make(env.FootstepEnv)
    one.reset(seed=0)
    neutral = one.world.neutral_action
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

# ------------------------------------------------------------------------ strict at the door
ROBOTS = np.arange(2)
DOORS = {  # name: what is made, what is handed in there, the argument's name, its shape
    "FootstepEnv action": (lambda: env.FootstepEnv(noise=True),
                           lambda one, value: one.step(value), "action", (6,)),
    "FootstepEnv goal": (lambda: env.FootstepEnv(noise=True),
                         lambda one, value: one.reset(options={"goal": value}), "goal", (3,)),
    "FootstepVectorEnv actions": (lambda: env.FootstepVectorEnv(2, noise=True, cores=1),
                                  lambda one, value: one.step(value), "actions", (2, 6)),
    "FootstepVectorEnv goals": (lambda: env.FootstepVectorEnv(2, noise=True, cores=1),
                                lambda one, value: one.reset(options={"goals": value}),
                                "goals", (2, 3)),
    "FootstepWorld actions": (lambda: env.FootstepWorld(2, noise=True, cores=1),
                              lambda one, value: one.step(value, ROBOTS), "actions", (2, 6)),
    "FootstepWorld goals": (lambda: env.FootstepWorld(2, noise=True, cores=1),
                            lambda one, value: one.reset(ROBOTS, goals=value), "goals", (2, 3)),
}
WRONG = {  # name: how it is made of good numbers
    "nan": lambda good: np.where(np.arange(good.size).reshape(good.shape) == 1, math.nan, good),
    "inf": lambda good: np.where(np.arange(good.size).reshape(good.shape) == 1, math.inf, good),
    "minus inf": lambda good: good - math.inf,
    "one too few": lambda good: good[..., :-1],
    "one too many": lambda good: np.concatenate([good, good[..., :1]], -1),
    "an axis too many": lambda good: good[None],
    "flat or a column": lambda good: good.reshape(-1) if good.ndim > 1 else good[:, None],
    "one robot too many": lambda good: np.concatenate([good, good[:1]]),
    "a single number": lambda good: 0.5,
    "empty": lambda good: [],
    "ragged": lambda good: [*good[:-1].tolist(), good[-1:].tolist()],
    "None inside": lambda good: np.full(good.shape, None),
    "a text": lambda good: "left",
    "texts": lambda good: np.full(good.shape, "left").tolist(),
    "texts of numbers": lambda good: good.astype(str).tolist(),
    "complex numbers": lambda good: good + 1j,
    "too large for a float": lambda good: np.full(good.shape, 10**400, object).tolist(),
    "a dict": lambda good: {"x": 0.5},
}

def start(kind):
    """A new one with seed 8 that has already made a double step."""
    one = kind()
    good = np.full((2, 6), 0.45)
    if isinstance(one, env.FootstepWorld):
        one.reset(ROBOTS, [env.stream("training", 8, i) for i in ROBOTS])
        one.step(good, ROBOTS)
    else:
        one.reset(seed=8)
        one.step(good[0] if isinstance(one, env.FootstepEnv) else good)
    return one

def future(one):
    """What happens next: a double step and a new episode, which draws goals and noise."""
    good = np.full((2, 6), 0.55)
    if isinstance(one, env.FootstepWorld):
        result, measured = one.step(good, ROBOTS), one.measure(ROBOTS)
        one.reset(ROBOTS)
        return [result["reward"], result["motion"].torso, measured, one.measure(ROBOTS), one.goal]
    obs, reward, *_ = one.step(good[0] if isinstance(one, env.FootstepEnv) else good)
    return [obs, reward, one.reset()[0], one.world.goal]

@pytest.fixture(scope="module")
def untouched():
    """What happens next behind every door when nothing wrong was handed in."""
    futures = {}
    for door, (kind, *_) in DOORS.items():
        one = start(kind)
        futures[door] = future(one)
        one.close()
    return futures

@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_numbers_are_refused_and_change_nothing(untouched, door, wrong):
    kind, hand_in, name, shape = DOORS[door]
    one = start(kind)
    try:
        value = WRONG[wrong](np.full(shape, 0.5))
        with pytest.raises(ValueError) as caught:
            hand_in(one, value)
        message = str(caught.value)
        assert re.match(rf"{name} must\b", message), f"which argument is wrong? {message}"
        assert len(message.splitlines()) == 1 and len(message) < 200, f"one short line: {message}"
        for got, want in zip(future(one), untouched[door], strict=True):
            np.testing.assert_array_equal(got, want, err_msg=(
                "what was refused must leave no trace: check BEFORE anything is planned, moved, "
                "drawn or reset"))
    finally:
        one.close()

@pytest.mark.parametrize("door", [door for door in DOORS if door.endswith("actions")]
                         + ["FootstepEnv action"])
def test_no_action_at_all_is_refused(untouched, door):
    kind, hand_in, name, _ = DOORS[door]
    one = start(kind)
    try:
        with pytest.raises(ValueError, match=rf"^{name} must"):
            hand_in(one, None)
        for got, want in zip(future(one), untouched[door], strict=True):
            np.testing.assert_array_equal(got, want)
    finally:
        one.close()

@pytest.mark.parametrize("door", ["FootstepEnv goal", "FootstepVectorEnv goals"])
def test_the_seed_of_a_refused_reset_is_not_taken(untouched, door):
    kind, _, name, shape = DOORS[door]
    one = start(kind)
    try:
        with pytest.raises(ValueError, match=f"^{name} must"):
            one.reset(seed=99, options={name: np.full(shape, math.nan)})
        for got, want in zip(future(one), untouched[door], strict=True):
            np.testing.assert_array_equal(got, want, err_msg=(
                "the goal was refused, but the generator of the seed beside it was kept: check "
                "the goal first"))
    finally:
        one.close()

@BOTH
def test_lists_and_whole_numbers_are_welcome(make, sim):
    one, other = make(env.FootstepEnv, sim), make(env.FootstepEnv, sim)
    got, _ = one.reset(seed=0, options={"goal": [1, 0, 0]})
    want, _ = other.reset(seed=0, options={"goal": np.array([1.0, 0.0, 0.0])})
    np.testing.assert_array_equal(got, want)
    for action in ([0, 1, 0, 1, 0, 1], (0.5,) * 6):
        np.testing.assert_array_equal(one.step(action)[0], other.step(np.array(action))[0])

@pytest.mark.parametrize("kind", [env.FootstepEnv, env.FootstepVectorEnv, env.FootstepWorld])
@pytest.mark.parametrize("sim", ["gazebo", "MuJoCo", "", None, 7, "py\nmunk"], ids=repr)
def test_unknown_simulators_are_refused(kind, sim):
    settings = {"sim": sim} if kind is env.FootstepEnv else {"sim": sim, "cores": 1}
    with pytest.raises(ValueError, match=r"^sim must be pymunk or mujoco, got ") as caught:
        kind(**settings) if kind is not env.FootstepWorld else kind(1, **settings)
    assert len(str(caught.value).splitlines()) == 1

def test_gymnasium_passes_the_refusal_on():
    for build in (gym.make, gym.make_vec):
        with pytest.raises(ValueError, match=r"^sim must be"):
            build("Footsteps-v0", sim="gazebo")

# ------------------------------------------------------------------------ rewards
def terms(before, after, action=None, last=None, fall=False, success=False):
    """Reward terms of one robot, plain floats."""
    action = np.zeros(6) if action is None else np.array(action, float)
    last = action if last is None else np.array(last, float)
    result = env.reward_terms(np.array([before], float), np.array([after], float), action[None],
                              last[None], np.array([fall]), np.array([success]), TASK)
    for name, value in result.items():
        assert np.shape(value) == (1,), (
            f"{name} of one robot has the shape {np.shape(value)} instead of (1,): sums go over "
            "the action's axis only, .sum(-1)")
    return {name: float(value[0]) for name, value in result.items()}

def potentials(goal):
    """The three quantities Φ of one goal (x, y, α) that a reward pays the changes of."""
    x, y, alpha = (float(v) for v in goal)
    d, beta = math.hypot(x, y), math.atan2(y, x)
    alpha = math.atan2(math.sin(alpha), math.cos(alpha))  # wrapped
    near = math.exp(-((d / TASK.near_m) ** 2))
    return {"r_d": -TASK.s_d * d, "r_a": -TASK.s_a * abs(alpha) * near,
            "r_o": -TASK.s_o * abs(beta) * (1 - near)}

def by_hand(before, after, action, last, fall, success):
    """All seven terms of one robot, with nothing but `math`."""
    old, new = potentials(before), potentials(after)
    jumps = [(action[k] - last[k]) ** 2 for k in (0, 1, 3, 4)]  # x and y of both feet, no yaw
    return {**{name: new[name] - old[name] for name in old}, "r_c": -TASK.s_c * sum(jumps),
            "r_fall": -TASK.s_fall if fall else 0.0, "r_goal": TASK.s_goal if success else 0.0,
            "r_time": -TASK.s_time}

NEAR = "near(d) = exp(−(d / 0.4 m)²)"
FORMULAS = {"r_d": "d − d′", "r_a": "|α|·near(d) − |α′|·near(d′), " + NEAR,
            "r_o": "|β|·far(d) − |β′|·far(d′), far(d) = 1 − near(d), " + NEAR,
            "r_c": "r_c = −s_c · Σ (action − last action)² over x and y of both feet",
            "r_fall": "a fall costs s_fall", "r_goal": "a success pays s_goal",
            "r_time": "every double step costs s_time"}

def test_reward_formulas_by_hand():
    # Far: from (2, 0) to (1, 1) seen from the robot, goal orientation 0 -> 0.5 rad.
    got = terms((2, 0, 0), (1, 1, 0.5))
    near0, near1 = math.exp(-25), math.exp(-2 / 0.16)  # exp(−(d / 0.4 m)²)
    assert got["r_d"] == pytest.approx(2 - math.sqrt(2)), "progress: d before − d after"
    assert got["r_a"] == pytest.approx(0.3 * (0 * near0 - 0.5 * near1), abs=1e-12), (
        f"far away α hardly counts; is near(d) another one? {FORMULAS['r_a']}")
    assert got["r_o"] == pytest.approx(0.1 * -(math.pi / 4) * (1 - near1)), (
        f"turned away: negative; or is near(d) another one? {FORMULAS['r_o']}")
    for name, want in (("r_time", -0.02), ("r_fall", 0), ("r_goal", 0)):
        assert got[name] == want, f"{name}: {FORMULAS[name]}"
    # Close: at 0.4 m, near = 1/e; turning from α = −1 to −0.2 counts, the direction less.
    got = terms((0.4, 0, -1.0), (0.4, 0, -0.2))
    assert got["r_d"] == 0 and got["r_o"] == 0, "neither d nor β has changed"
    assert got["r_a"] == pytest.approx(0.3 * 0.8 / math.e), (
        f"|α|: both signs are alike; or is near(d) another one? {FORMULAS['r_a']}")
    got = terms((-0.4, 0, 0), (0.4, 0, 0))
    assert got["r_o"] == pytest.approx(0.1 * math.pi * (1 - 1 / math.e)), (
        f"β: π -> 0; {FORMULAS['r_o']}")
    # Continuity: only the lengths x, y of both feet, squared, in shares of the limits.
    now, before = [0.5, 0.1, 0.9, 0.2, 0.4, 0.9], [0.2, 0.1, 0.0, 0.2, 0.8, 0.0]
    for last_yaw, hint in (0.9, FORMULAS["r_c"]), (0.0, "r_c: yaw must not count"):
        before[2] = before[5] = last_yaw
        got = terms((1, 0, 0), (1, 0, 0), now, before)
        assert got["r_c"] == pytest.approx(-0.02 * (0.3**2 + 0.4**2)), hint
    assert terms((1, 0, 0), (1, 0, 0), fall=True)["r_fall"] == -TASK.s_fall, FORMULAS["r_fall"]
    assert terms((1, 0, 0), (1, 0, 0), success=True)["r_goal"] == TASK.s_goal, FORMULAS["r_goal"]

def test_reward_formulas_for_many_robots_are_those_of_each_alone():
    rng, n = np.random.default_rng(8), 6
    before, after = rng.uniform([-1, -1, -3], [1, 1, 3], (2, n, 3))
    action, last = rng.random((2, n, 6))
    fall = np.array([True, False, False, True, False, False])
    success = np.array([False, True, False, False, True, False])
    got = env.reward_terms(before, after, action, last, fall, success, TASK)
    for name, values in got.items():
        assert np.shape(values) == (n,), (
            f"{name} has the shape {np.shape(values)} instead of ({n},): one number for every "
            "robot. Sums go over the action's axis only: .sum(-1)")
    for i in range(n):
        want = by_hand(before[i], after[i], action[i], last[i], fall[i], success[i])
        assert got.keys() == want.keys()
        alone = terms(before[i], after[i], action[i], last[i], fall[i], success[i])
        for name in want:
            assert got[name][i] == pytest.approx(alone[name], abs=1e-12), (
                f"{name} of robot {i} is another one than alone: another robot's numbers?")
            assert got[name][i] == pytest.approx(want[name], abs=1e-12), (
                f"{name} of robot {i}: the sign, or the scalar? {FORMULAS[name]}")

@BOTH
def test_rewards_of_a_real_walk_compare_the_poses_before_and_after(make, sim):
    goals = np.array([[1.0, 0, 0], [0.5, 0.8, 2.0], [-0.6, -0.3, -1.0], [0.25, 0.1, 1.2]])
    world, everybody = make(env.FootstepWorld, 4, sim, cores=1), np.arange(4)
    world.reset(everybody, [np.random.default_rng(i) for i in everybody], goals)
    total = {name: np.zeros(4) for name in ("r_d", "r_a", "r_o")}
    for _ in range(12):
        poses, last = world.pose.copy(), world.actions[:, 0].copy()
        action = env.hand_written(world.measure(everybody), world.limits)
        result = world.step(action, everybody)
        ends = result["motion"].torso[:, -1, [0, 1, 5]]
        for i in everybody:
            before, after = seen_from(poses[i], goals[i]), seen_from(ends[i], goals[i])
            want = by_hand(before, after, action[i], last[i], result["fall"][i],
                           result["success"][i])
            for name, value in want.items():
                assert result["reward_terms"][name][i] == pytest.approx(value, abs=1e-9), (
                    f"{name} of robot {i}: seen from the robot before and after this double step; "
                    "were the two exchanged, or was a noisy, an old or another goal taken?")
        for name, sums in total.items():
            sums += result["reward_terms"][name]
    gained = [potentials(seen_from(end, goal))["r_d"] - potentials(goal)["r_d"]
              for end, goal in zip(ends, goals)]
    np.testing.assert_allclose(total["r_d"], gained, atol=1e-9)
    assert total["r_d"][:3].min() > 0.15, (
        f"robots that walked towards their goals earned {total['r_d'].round(2)}: coming nearer "
        "must pay, not cost")
    assert total["r_o"][1] > 0.02, "facing the goal pays"
    assert total["r_a"][3] > 0.02, "nearby, turning like the goal pays"

@BOTH
def test_reward_is_the_sum_of_its_terms(make, sim):
    envs = make(env.FootstepVectorEnv, 4, sim, cores=1)
    envs.reset(seed=2)
    rng = np.random.default_rng(3)
    for _ in range(6):
        last = envs.world.actions[:, 0].copy()
        action = rng.random((4, 6))
        _, reward, _, _, infos = envs.step(action)
        parts = infos["reward_terms"]
        assert list(parts) == ["r_d", "r_a", "r_o", "r_c", "r_fall", "r_goal", "r_time"]
        np.testing.assert_allclose(reward, np.sum(list(parts.values()), 0), atol=1e-12)
        np.testing.assert_allclose(parts["r_c"], -TASK.s_c * (
            (action - last)[:, [0, 1, 3, 4]] ** 2).sum(1), atol=1e-12, err_msg=(
            "compare with the action before, not with the neutral one or with itself"))

def test_going_in_circles_pays_nothing():
    rng, n = np.random.default_rng(4), 5
    path = rng.uniform([-2, -2, -3], [2, 2, 3], (30, n, 3))  # every robot on a circle of its own
    path[-1] = path[0]
    action, never = np.tile(rng.random(6), (n, 1)), np.zeros(n, bool)
    total, paid = np.zeros(n), np.zeros(n)
    for before, after in zip(path, path[1:]):
        parts = env.reward_terms(before, after, action, action, never, never, TASK)
        total += sum(value for name, value in parts.items() if name != "r_time")
        paid += np.abs(parts["r_d"])
    assert paid.min() > 1, "on the way the terms must not be zero"
    np.testing.assert_allclose(total, 0, atol=1e-9, err_msg=(
        "terms must pay for progress, and take it back"))

@pytest.mark.parametrize("name", ["r_d", "r_a", "r_o"])
def test_discounted_progress_telescopes_as_the_docstring_says(name):
    # Σ γᵗ·(Φ_{t+1} − Φ_t) = γᵀ·Φ_end − Φ_start + (1 − γ)·Σ γᵗ·Φ_{t+1},  t = 0 … T − 1
    path = np.random.default_rng(9).uniform([-1, -1, -3], [1, 1, 3], (21, 3))  # T = 20
    phi = np.array([potentials(goal)[name] for goal in path])
    factors = GAMMA ** np.arange(20)
    paid = sum(factor * terms(a, b)[name] for factor, a, b in zip(factors, path, path[1:]))
    waiting = (1 - GAMMA) * np.sum(factors * phi[1:])
    assert paid == pytest.approx(GAMMA**20 * phi[-1] - phi[0] + waiting, abs=1e-9), (
        f"{name} is Φ′ − Φ, not Φ − Φ′ and not γ·Φ′ − Φ: {FORMULAS[name]}")
    assert waiting < -1e-3, "away from the goal Φ is negative, so time spent there costs"

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
@pytest.mark.parametrize("goal", GOALS, ids=str)
def test_returns_rank_what_we_want(sim, goal):
    period = walk_engine.WalkEngine(1, walk_engine.TUNED[sim]).period
    patience = int(TASK.time_limit / period)  # double steps until the time-out
    assert pytest.approx(0.98) == GAMMA
    way = straight_walk(goal)
    walked = discounted(way + way[-1:], success=True)  # arrived: it stays for a double step
    stood = discounted([np.array(goal, float)], patience)
    fell = discounted([np.array(goal, float)] * 2, fall=True)
    loitered = discounted(straight_walk(goal, stop=0.06), patience)
    assert walked > stood + 0.1, f"to the goal {walked:.2f}, standing still {stood:.2f}"
    assert stood > fell + 0.1, f"standing still {stood:.2f}, falling at once {fell:.2f}"
    assert walked > loitered + 0.1, f"finishing {walked:.2f}, waiting next to it {loitered:.2f}"

# ------------------------------------------------------------------------ goals, noise and seeds
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
    numbers = [(), (0,), (1,), (2,), (0, 0), (0, 1), (1, 0), (0, 0, 0)]
    drawn = {(name, seed, *more): env.stream(name, seed, *more).normal(size=4)
             for name in ("training", "tuning", "evaluation") for seed in (0, 1)
             for more in numbers}
    keys = list(drawn)
    for i, one in enumerate(keys):
        for other in keys[:i]:
            assert not np.allclose(drawn[one], drawn[other]), (
                f"stream{one} is stream{other}. Names: training must never see the goals of the "
                "evaluation. Numbers: numpy ignores zeros at the end, (0, 0) is (0) to it")
    for key, values in drawn.items():
        np.testing.assert_array_equal(env.stream(*key).normal(size=4), values)

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

def test_imu_noise_has_the_size_of_the_task_and_off_means_exact(make):
    exact, noisy = (make(env.FootstepWorld, 1, noise=noise) for noise in (False, True))
    for world in (exact, noisy):
        world.reset([0], [env.stream("training", 0)], [[1.0, 0, 0]])
    true, goal = exact.tilt[0].copy(), np.array([[1.0, 0, 0]])
    scale = np.array([4, 4, 1, 1, 1])  # quarters of a radian; rad/s
    np.testing.assert_allclose(exact.observe([0], goal, imu=True)[0, 20:], true * scale, atol=1e-6)
    seen = np.array([noisy.observe([0], goal, imu=True)[0, 20:] for _ in range(4000)]) / scale
    np.testing.assert_allclose(seen.std(0), [0.02, 0.02, 0.1, 0.1, 0.1], rtol=0.06)
    np.testing.assert_allclose((seen.mean(0) - true) / seen.std(0), 0, atol=0.07)
    together = np.corrcoef(np.c_[seen[:-1], seen[1:]].T) - np.eye(10)
    assert np.abs(together).max() < 0.08, "every number has noise of its own, anew at every look"
    np.testing.assert_array_equal(noisy.tilt[0], true, err_msg="the true tilt stays true")

@BOTH
def test_imu_feels_the_turning_about_the_axes_of_the_torso(make, sim):
    world, robots = make(env.FootstepWorld, 4, sim, cores=1), np.arange(4)
    world.reset(robots, [env.stream("training", 5, i) for i in robots])
    footsteps = np.array([[0.06, 0.02, 0.25], [0.06, 0, -0.25]])  # a left turn
    action = np.tile(env.to_action(footsteps, world.limits), (4, 1))
    felt, true = [], []
    for _ in range(6):
        torso = world.step(action, robots)["motion"].torso
        felt.append(world.observe(robots, world.measure(robots), imu=True)[:, 22:])
        before, after = (robot_model.rotation(*torso[:, t, 3:].T) for t in (-2, -1))
        turn = before.swapaxes(1, 2) @ after  # [4, 3, 3] in the last control tick, from the torso
        twice = turn - turn.swapaxes(1, 2)  # small angles: 2·[ω·dt]×
        true.append(twice[:, [2, 0, 1], [1, 2, 0]] / 2 / world.engine.robot.control_dt)
    assert np.abs(torso[:, -1, 5]).min() > 2, "the axes of torso and world should differ"
    felt, true = np.array(felt)[2:], np.array(true)[2:]
    size, error = (np.sqrt((v**2).mean((0, 1))) for v in (true, felt - true))
    assert (error < 0.5 * size).all(), (  # the rate changes within a tick
        f"about x, y, z it turns with {size.round(2)}, the IMU is off by {error.round(2)} rad/s. "
        "Once and more: it is about the axes of the world; twice: a wrong sign")

def test_a_goal_can_be_given(make):
    one = make(env.FootstepEnv)
    obs, _ = one.reset(seed=0, options={"goal": (0.3, 0.0, math.pi / 2)})
    np.testing.assert_allclose(obs[:8], [0.3, 0.6, 0, 1, 0, 0, 1, 0.5], atol=1e-6)

def test_every_second_goal_of_the_training_is_far(make, monkeypatch):
    world = make(env.FootstepWorld, 1)
    monkeypatch.setattr(world.sim, "reset", lambda *_: None)  # only goals are wanted
    world.rng[0], goals = env.stream("training", 0), []
    for _ in range(3000):
        world.reset([0])
        goals.append(world.goal[0].copy())
    d = np.hypot(*np.array(goals)[:, :2].T)
    for radius in (0.3, 0.6, 1.0, 1.5, 2.0):
        # x, y ~ N(0, σ) lie within r with 1 − exp(−r² / 2σ²); half have σ = 0.5 m, half 1 m
        want = np.mean([1 - math.exp(-((radius / std) ** 2) / 2) for std in (0.5, 1.0)])
        assert np.mean(d < radius) == pytest.approx(want, abs=0.03), (
            f"share of the goals within {radius} m. All with one spread, or not half and half?")
    near, far = (env.draw_goals(env.stream("tuning", 0), 9, far=far) for far in (False, True))
    np.testing.assert_allclose(far, near * [2, 2, 1], err_msg="farther, and turned alike")

# ------------------------------------------------------------------------ ground and body
def spied(world):
    """The world, and a list of the Body of every reset to come."""
    bodies, reset = [], world.sim.reset

    def told(robots, body):
        bodies.append(body)
        reset(robots, body)

    world.sim.reset = told
    return world, bodies

def assert_same_body(one, other, but=()):
    for name in vars(one).keys() - set(but):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)

def test_whatever_is_done_goals_ground_body_and_noise_stay_the_same(make):
    robots, wild = np.arange(2), np.random.default_rng(0)

    def told(act, looks, steps):
        """Of two episodes: goals, Body, and by how much the first two measurements are off."""
        world, bodies = spied(make(env.FootstepWorld, 2, noise=True, cores=1))
        world.reset(robots, [env.stream("training", 7, i) for i in robots])
        episodes = []
        for _ in range(2):
            goals, noise = world.goal.copy(), []
            for _ in range(steps):
                measured = world.measure(robots)
                noise.append(robot_model.wrap(measured - world.relative_goal(robots)))
                for _ in range(looks):
                    world.view(robots, measured)  # reads the IMU
                world.step(act(world), robots)
            episodes.append((goals, bodies[-1], noise[:2]))
            world.reset(robots)
        return episodes

    still = told(lambda world: np.tile(world.neutral_action, (2, 1)), looks=0, steps=2)
    for looks in (0, 3):
        moved = told(lambda world: wild.random((2, 6)), looks, steps=3)
        for (goals, body, noise), (other_goals, other_body, other_noise) in zip(still, moved):
            np.testing.assert_array_equal(goals, other_goals)
            assert_same_body(body, other_body)
            np.testing.assert_allclose(noise, other_noise, atol=1e-12, err_msg=(
                "the n-th measurement of an episode is always off by the same: does noise share a "
                "generator with the IMU, or does one episode go on with the numbers of the last?"))
    (_, body, _), (_, second, _) = still
    for name in ("friction", "mass", "stiffness", "stiction"):
        one, other = getattr(body, name), getattr(second, name)
        assert not np.isclose(one, other).any(), f"{name}: another episode, another draw"
        assert not np.isclose(one[0], one[1]).any(), f"{name}: another robot, another draw"

def test_the_noise_of_the_imu_does_not_depend_on_any_other(make):
    one, other = (make(env.FootstepWorld, 1, noise=True) for _ in range(2))
    for world in (one, other):
        world.reset([0], [env.stream("training", 0)], [[1.0, 0, 0]])
    for _ in range(3):
        other.measure([0])
        other.dice[0]["kicks"].normal(size=3)  # as in tests/studies
        seen = [world.observe([0], np.ones((1, 3)), imu=True) for world in (one, other)]
        np.testing.assert_array_equal(*seen, err_msg="it needs a generator of its own")

def test_a_given_goal_replaces_the_drawn_one_and_nothing_else(make):
    told = []
    for goals in (None, [[1.0, 2.0, 3.0]]):
        world, bodies = spied(make(env.FootstepWorld, 1, noise=True))
        world.reset([0], [env.stream("training", 6)], goals)
        off = robot_model.wrap(world.measure([0]) - world.relative_goal([0]))
        told.append((bodies[0], off, world.observe([0], np.ones((1, 3)), imu=True)))
    np.testing.assert_array_equal(world.goal, goals)
    assert_same_body(told[0][0], told[1][0])
    for drawn, given in zip(told[0][1:], told[1][1:]):
        np.testing.assert_allclose(drawn, given, atol=1e-12, err_msg=(
            "a goal's numbers were taken from the generator of the world or of the noise"))

def test_goals_and_noise_do_not_depend_on_how_the_world_is_drawn(make):
    class Greedy(robot_model.Spread):
        def draw(self, rngs, robot):
            for rng in rngs:
                rng.random(99)
            return super().draw(rngs, robot)

    told = []
    for spread in (robot_model.Spread(), robot_model.Spread(0, 0, 0, 0, 0), Greedy()):
        world = make(env.FootstepWorld, 1, noise=True, spread=spread)
        world.reset([0], [env.stream("training", 3)])
        told.append(np.concatenate([world.goal, world.measure([0])]))
    for other in told[1:]:
        np.testing.assert_array_equal(told[0], other, err_msg="each has a generator of its own")

@BOTH
def test_a_given_friction_replaces_the_drawn_one_and_nothing_else(make, sim):
    robots, told = np.arange(3), []
    for friction in (math.nan, 0.05, [math.nan, 0.05, math.nan]):
        world, bodies = spied(make(env.FootstepWorld, 3, sim, noise=True, cores=1))
        world.reset(robots, [env.stream("training", 2, i) for i in robots], friction=friction)
        np.testing.assert_array_equal(world.friction, bodies[0].friction)
        told.append((bodies[0], world.goal.copy(), world.measure(robots)))
    (drawn, *seen), *others = told
    for (body, *same), want in zip(others, (np.full(3, 0.05), drawn.friction * [1, 0, 1]
                                            + [0, 0.05, 0])):
        np.testing.assert_array_equal(body.friction, want, err_msg="nan: as drawn")
        assert_same_body(body, drawn, but=("friction",))
        np.testing.assert_array_equal(same, seen)

@BOTH
def test_on_ice_the_robot_gets_less_far(make, sim):
    world, robots = make(env.FootstepWorld, 2, sim, cores=1), np.arange(2)
    goals = [[9, 0, 0]] * 2  # the same robot twice, on two grounds
    world.reset(robots, [env.stream("training", 0) for _ in robots], goals, friction=[0.01, 0.7])
    action = np.tile(env.to_action(np.array([[0.06, 0, 0]] * 2), world.limits), (2, 1))
    for _ in range(4):
        world.step(action, robots)
    ice, rough = world.pose[:, 0]
    assert rough > 0.35 and ice < 0.9 * rough, (
        f"{ice:.2f} m on ice, {rough:.2f} m on rough ground: does μ reach the simulator?")

# ------------------------------------------------------------------------ what may be known
def test_a_view_can_be_scribbled_on(make):
    one, other = (make(env.FootstepWorld, 3, noise=True, cores=1) for _ in range(2))
    robots, some = np.arange(3), np.array([2, 0])
    for world in (one, other):
        world.reset(robots, [env.stream("training", 4, i) for i in robots])
    for _ in range(2):
        views = [world.view(some, world.measure(some)) for world in (one, other)]
        for name, value in vars(views[0]).items():
            np.testing.assert_array_equal(value, vars(views[1])[name], err_msg=name)
            if isinstance(value, np.ndarray):
                value[:] = 0.123
        np.testing.assert_array_equal(one.neutral_action, other.neutral_action)
        np.testing.assert_array_equal(one.actions, other.actions)
        actions = np.full((3, 6), 0.45)
        got, want = (world.step(actions, robots) for world in (one, other))
        np.testing.assert_array_equal(got["reward"], want["reward"], err_msg=(
            "a planner wrote into its view and the world changed: hand out copies"))

def test_a_view_shows_what_was_measured_and_nothing_of_the_truth(make):
    """Ground, body, pose and goal differ, and all the rest is alike: so must be the views."""
    measured, views = np.array([[0.4, -0.1, 0.5]] * 2), []
    for seed, far in ((0, 0.0), (1, 5.0)):
        world = make(env.FootstepWorld, 3, cores=1)
        world.reset(np.arange(3), [env.stream("training", seed, i) for i in range(3)])
        world.pose += far
        views.append(world.view(np.array([2, 1]), measured))
    assert vars(views[0]).keys() == {"period", "limits", "neutral_action", "actions", "observation"}
    for name, value in vars(views[0]).items():
        np.testing.assert_array_equal(value, vars(views[1])[name], err_msg=(
            f"{name} tells a planner what no robot can know"))
    view = views[0]
    assert view.period == world.engine.period and view.limits == world.limits
    np.testing.assert_array_equal(view.actions, np.tile(world.neutral_action, (2, 2, 1)))
    np.testing.assert_allclose(view.observation[:, :8], env.encode_goal(measured), atol=1e-6)
    assert view.observation.shape == (2, len(env.observation_table(imu=True)))

# ------------------------------------------------------------------------ how an episode ends
IN, OUT, FALL = "inside", "outside", "falls, inside"

@pytest.mark.parametrize("ends, want, counted", [  # of the double steps; how it ends; its time
    ([IN, IN], "success", 1), ([OUT, IN, IN], "success", 2), ([IN, OUT, IN, IN], "success", 3),
    ([IN, OUT], "", 2), ([IN, OUT, IN], "", 3), ([IN, FALL], "fall", 2), ([FALL], "fall", 1)],
    ids=lambda value: ", ".join(value) if isinstance(value, list) else str(value))
def test_to_arrive_is_to_stay(make, monkeypatch, ends, want, counted):
    world, robots, others = make(env.FootstepWorld, 3, cores=1), np.array([2, 0]), np.array([1])
    poses = {IN: [0.3, 0, 0], OUT: [0.1, 0, 0], FALL: [0.3, 0, 0]}
    for repeat in range(2):  # the second time: nothing is left of the first episode
        world.reset(np.arange(3), goals=[poses[IN]] * 3)
        for step, end in enumerate(ends, 1):
            mine, his = np.array([poses[end], poses[OUT]]), np.array([poses[IN]])
            falls = [end is FALL, False]
            with monkeypatch.context() as patch:
                patch.setattr(world.sim, "run", lambda *_, p=mine, f=falls: motion(p, f))
                result = world.step(np.full((2, 6), 0.4), robots)
                if step == 1:  # robot 1 is at the goal once and waits there
                    patch.setattr(world.sim, "run", lambda *_, p=his: motion(p, [False]))
                    assert not world.step(np.full((1, 6), 0.4), others)["success"].any()
            got = [name for name in ("success", "fall", "timeout") if result[name][0]]
            assert got == ([want] if want and step == len(ends) else []), (
                f"after double step {step} of {ends}: two in a row must end inside, and a fall "
                f"in the second is a fall{', whatever the last episode was' * repeat}")
            assert result["inside"].tolist() == [end is IN, False], "a fall wins"
            assert result["reward_terms"]["r_goal"][0] == TASK.s_goal * ("success" in got)
            assert not result["success"][1], "a robot arrives for itself, not for another one"
        np.testing.assert_allclose(result["time"] / world.engine.period, [counted, len(ends)],
                                   err_msg="a success took the time to the FIRST of the two")

def test_where_the_robot_starts_does_not_count_as_having_been_there(make, monkeypatch):
    one = make(env.FootstepEnv)
    one.reset(seed=0, options={"goal": (0, 0, 0)})  # it stands on its goal
    monkeypatch.setattr(one.world.sim, "run", lambda *_: motion(np.zeros((1, 3)), [False]))
    ends = [one.step(one.world.neutral_action)[4]["success"] for _ in range(2)]
    assert ends == [False, True], "two double steps must END at the goal"

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
            for falls in (False, fell):  # two double steps that end there
                patch.setattr(one.world.sim, "run", lambda *_, away=away, falls=falls: motion(
                    goal + away, [falls]))
                _, _, terminated, truncated, info = one.step(one.world.neutral_action)
        got = [name for name in ("success", "fall", "timeout") if info[name]]
        assert got == ([want] if want else []), (
            f"{100 * x:.1f} cm and {yaw_deg}° away, fell: {fell}; success: 5 cm AND 10°, true "
            "pose, angles wrapped, and a fall wins")
        assert terminated == bool(want) and not truncated
        assert info["reward_terms"]["r_goal"] == TASK.s_goal * (want == "success")
        assert info["reward_terms"]["r_fall"] == -TASK.s_fall * (want == "fall")

@BOTH
def test_no_time_left_truncates_in_the_vector_too(make, monkeypatch, sim):
    envs = make(env.FootstepVectorEnv, 4, sim, cores=1)
    whole = math.floor(TASK.time_limit / envs.world.engine.period + 1e-9)
    goals = np.tile([2.0, 0.0, 0.0], (4, 1))
    envs.reset(seed=0, options={"goals": goals})
    envs.world.steps[:] = [whole - 3, whole - 2, whole - 2, whole - 2]
    poses, fell = goals * [[0.5], [0.5], [1], [0.5]], [False] * 4
    monkeypatch.setattr(envs.world.sim, "run", lambda *_: motion(poses, fell))
    actions = np.tile(envs.neutral_action, (4, 1))
    _, _, terminated, truncated, _ = envs.step(actions)
    assert not terminated.any() and not truncated.any(), "there is room for one more double step"
    fell[3] = True
    obs, _, terminated, truncated, infos = envs.step(actions)
    np.testing.assert_array_equal(truncated, [False, True, False, False], err_msg=(
        "only the robot that is neither there nor fallen when the time is up is cut off"))
    np.testing.assert_array_equal(terminated, [False, False, True, True], err_msg=(
        "a time-out truncates, it does not terminate: stage 4 bootstraps there, not after a fall"))
    np.testing.assert_array_equal(infos["final_info"]["timeout"], truncated)
    np.testing.assert_allclose(infos["final_info"]["time"] / envs.world.engine.period,
                               [whole - 1, whole, whole - 1, whole])
    assert infos["final_obs"][1, 0] == pytest.approx(1.0), "one metre was left"
    np.testing.assert_array_equal(envs.world.steps, [whole - 1, 0, 0, 0])

@BOTH
def test_no_time_left_truncates_and_does_not_terminate(make, monkeypatch, sim):
    one = make(env.FootstepEnv, sim)
    period = one.world.engine.period
    whole = math.floor(TASK.time_limit / period + 1e-9)  # double steps that fit into 100 s
    goal = np.array([2.0, 0.0, 0.0])
    out, here = goal / 2, goal
    for steps, last, pose, fell, want in ((whole - 2, out, out, False, (False, False, False)),
                                          (whole - 1, out, out, False, (False, True, True)),
                                          (whole - 1, out, here, False, (False, True, True)),
                                          (whole - 1, here, here, False, (True, False, False)),
                                          (whole - 1, here, here, True, (True, False, False)),
                                          (whole - 1, out, out, True, (True, False, False))):
        one.reset(seed=0, options={"goal": goal})
        one.world.steps[:] = steps - 1
        for place, falls in ((last, False), (pose, fell)):
            monkeypatch.setattr(one.world.sim, "run", lambda *_, p=place, f=falls: motion(
                p[None], [f]))
            _, _, terminated, truncated, info = one.step(one.world.neutral_action)
        assert (terminated, truncated, bool(info["timeout"])) == want, (
            f"after {steps + 1} of {whole} double steps: a time-out truncates, it does not "
            "terminate; goal and fall come first")
        assert info["time"] == pytest.approx((steps + 1 - info["success"]) * period)
        assert (steps + 1) * period <= TASK.time_limit + 1e-9

def test_a_reset_clears_the_last_episode(make):
    one = make(env.FootstepEnv, task=replace(TASK, time_limit=3.0))
    first, _ = one.reset(seed=1)
    steps = 0
    while True:  # a short time limit instead of a patched clock: the whole way through
        _, _, terminated, truncated, info = one.step(one.world.neutral_action)
        steps += 1
        if terminated or truncated:
            break
    assert info["timeout"] and steps == math.floor(3.0 / one.world.engine.period + 1e-9)
    again, _ = one.reset(seed=1)
    np.testing.assert_array_equal(first, again)
    assert one.step(one.world.neutral_action)[4]["time"] == pytest.approx(one.world.engine.period)

@BOTH
def test_demonstration_planner_reaches_goals(make, sim):
    world, walking = make(env.FootstepWorld, 16, sim, cores=1), np.arange(16)
    world.reset(walking, [env.stream("training", 0, i) for i in walking])
    ends = {"success": 0, "fall": 0, "timeout": 0}
    while len(walking):
        result = world.step(env.hand_written(world.measure(walking), world.limits), walking)
        done = np.zeros(len(walking), bool)
        for name in ends:
            ends[name] += result[name].sum()
            assert not (done & result[name]).any(), "an episode has one end, not two"
            done |= result[name]
        counted = world.steps[walking] - result["success"]  # to the first of the two at the goal
        np.testing.assert_allclose(result["time"], counted * world.engine.period)
        walking = walking[~done]
    assert sum(ends.values()) == 16
    assert ends["success"] > 8, f"the task must be solvable: {ends}"

def test_hand_written_planner_stays_within_half_of_the_limits():
    goals = np.random.default_rng(10).normal(size=(500, 3)) * [2, 2, 2]
    for limits in walk_engine.LIMITS.values():
        actions = env.hand_written(goals, limits)
        assert actions.shape == (500, 6) and (actions >= 0).all() and (actions <= 1).all()
        steps = env.to_footsteps(actions, limits)  # [500, 2, 3]
        # A turn of one foot is mirrored by the other, so both signs must fit within the smaller.
        assert (np.abs(steps[..., 2]) <= -limits.low[2] / 2 + 1e-9).all()
        assert (steps[..., :2] >= np.array(limits.low[:2]) / 2 - 1e-9).all()
        assert (steps[..., :2] <= np.array(limits.high[:2]) / 2 + 1e-9).all()
        outward = steps[..., 1]  # the leading foot steps aside, the other one follows
        np.testing.assert_array_equal(outward[:, 0] > 1e-9, goals[:, 1] > 0)
        np.testing.assert_array_equal(outward[:, 1] > 1e-9, goals[:, 1] < 0)
