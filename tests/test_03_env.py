"""Stage 3, checked against the task. A failing test names the likely mistake."""

import itertools
import math
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from importlib import import_module

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np
import pytest
from checks import BOTH, close, equal, frozen
from gymnasium.utils.env_checker import check_env
from numpy.random import default_rng

env = import_module("03_env")
robot_model, walk_engine = env.robot_model, env.walk_engine
FootstepWorld, FootstepVectorEnv = env.FootstepWorld, env.FootstepVectorEnv
Spread, stream = env.Spread, env.stream
TASK = env.Task()
OTHER = env.Task(
    near_m=0.7, s_d=2, s_a=0.5, s_o=0.2, s_c=0.05, s_fall=3, s_goal=4, s_time=0.5, s_stay=6,
    goal_std_m=0.3, beyond_m=1.2, ahead_m=0.7
)  # fmt: skip
ROBOT = robot_model.RobotModel()
GAMMA = import_module("04_ppo").PPOConfig().gamma


@pytest.fixture
def make():
    """make(kind, ...): an environment or a world, closed after the test."""
    with ExitStack() as stack:
        yield lambda kind, *args, **more: stack.enter_context(closing(kind(*args, **more)))


WALK = walk_engine.TUNED["pymunk"]


def motion(poses, fell=False):
    """A Motion that ends at these poses [n, 3], for a physics that does as the test says."""
    n = len(poses)
    torso = np.zeros((n, 1, 6))
    torso[:, 0, [0, 1, 5]] = poses
    torso[:, 0, 2] = 0.38
    ticks = np.full(n, 2 * WALK.half_ticks)
    return robot_model.Motion(
        torso, np.zeros((n, 1, 12)), np.zeros((n, 3)), np.full(n, fell), ticks
    )


def follow(world, done):
    """From now on its physics does this, a Motion, whatever is planned."""
    world.simulator.run = lambda *_: done


@BOTH
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.filterwarnings("error")
def test_gymnasium_finds_nothing_to_complain_about(sim):
    one = gym.make("Footsteps-v0", sim=sim, render_mode="rgb_array")
    check_env(one.unwrapped)
    one.reset(seed=3)
    before = one.render()
    assert before.shape == (400, 400, 3) and before.dtype == np.uint8 and np.ptp(before) > 100
    one.step(np.full(6, 0.6, np.float32))
    assert (one.render() != before).any(-1).mean() > 0.02, "the robot has moved, the camera too"
    one.close()


@pytest.mark.parametrize(
    "mode, more",
    [("sync", {"sim": "mujoco"}), ("async", {}), ("vector_entry_point", {"cores": 1})],
    ids=str,
)
def test_gymnasium_can_make_vectors(make, mode, more):
    own = make(FootstepVectorEnv, 2, more.get("sim", "pymunk"))
    envs = make(partial(gym.make_vec, "Footsteps-v0", 2, mode, **more))
    first, _ = own.reset(seed=4)
    equal(envs.reset(seed=4)[0], first, "robot i has the seed s + i, in both vectors")
    action = np.full((2, 6), 0.4, np.float32)
    equal(envs.step(action)[0], own.step(action)[0])


def test_a_vector_keeps_the_conventions_of_gymnasium(make):
    envs = make(gym.make_vec, "Footsteps-v0", 2, render_mode="rgb_array", max_episode_steps=2)
    listed = gym.wrappers.vector.DictInfoToList(envs)
    listed.reset(seed=0)
    for step in range(2):
        *_, truncated, infos = listed.step(np.full((2, 6), 0.5, np.float32))
        assert truncated.all() == (step == 1), "max_episode_steps is a time limit"
        assert len(infos) == 2 and {"success", "reward_terms"} <= infos[1].keys()
    assert "final_info" in infos[0], "the info of what has ended, too"
    pictures = envs.render()
    assert [picture.shape for picture in pictures] == [(400, 400, 3)] * 2, "one for every robot"


def test_a_picture_does_not_depend_on_the_user_s_figures(make):
    envs = make(FootstepVectorEnv, 1)
    plain = envs.picture(0)
    with plt.rc_context({"figure.dpi": 150, "savefig.format": "svg"}):
        equal(envs.picture(0), plain)
    assert plain.shape == (400, 400, 3) and not plt.get_fignums()


@BOTH
@pytest.mark.parametrize("n", [3, pytest.param(64, marks=pytest.mark.slow)])
@pytest.mark.parametrize("law", [{}, {"capture": 1.0, "wait": 30.0}], ids=["as it is", "steps"])
def test_robots_together_equal_robots_alone(make, sim, n, law):
    rng, task = default_rng(0), replace(TASK, time_limit=2.0, push_every=1.0)
    walk = replace(walk_engine.TUNED[sim], **law)
    settings = {"noise": True, "imu": True, "push": 1.2, "task": task, "walk": walk}  # some fall
    together = make(FootstepVectorEnv, n, sim, cores=2, **settings)
    alone = [make(env.FootstepEnv, sim=sim, **settings) for _ in range(n)]
    got, _ = together.reset(seed=11)
    want = [one.reset(seed=11 + i)[0] for i, one in enumerate(alone)]
    equal(got, want, "robot i has the seed s + i")
    fell = set()
    for _ in range(10):
        actions = (together.neutral_action + rng.uniform(-0.1, 0.1, (n, 6))).astype(np.float32)
        actions[:, [0, 3]] = rng.integers(0, 2, (n, 2))  # as far ahead or back as it goes
        got, *numbers, infos = together.step(actions)
        for i, one in enumerate(alone):
            last, *own, info = one.step(actions[i])
            assert own == [column[i] for column in numbers], "reward, terminated, truncated"
            if own[1] or own[2]:
                equal(infos["final_obs"][i], last)
                del info["reward_terms"]
                assert info == {name: infos["final_info"][name][i] for name in info}
                fell.add(info["fall"])
                last, _ = one.reset()  # no seed: its generator goes on
            equal(got[i], last, "all is drawn by the robot's own generator, equally often")
    assert fell == {True, False}, "the test should see resets after falls and after time-outs"


def test_goal_is_encoded_as_in_the_table():
    d, beta, alpha = 0.3, math.radians(120), math.radians(-45)
    goal = np.array([d * math.cos(beta), d * math.sin(beta), alpha])
    want = [0.3, -0.3, 0.5196152, -0.5, 0.8660254, 0.7071068, -0.7071068, -0.25]
    close(
        env.encode_goal(goal),
        want,
        "d, 2d·cos β, 2d·sin β, cos β, sin β, cos α, sin α, α/π; α is not β "
        "(for 0.3 m, β = 120°, α = −45°)",
    )
    far = env.encode_goal(np.broadcast_to([4.0, -3.0, math.pi * 1.5], 3))
    close(far[:3], [2, 1, -1], "clipped: 2 m and ±1 (for a goal at (4, −3))")
    close(far[7], -0.5, "270° is −90°: wrap the angle")


@pytest.mark.parametrize("shape", [(1,), (7,), (2, 3)], ids=str)
def test_many_goals_are_encoded_each_by_itself(shape):
    goals = default_rng(6).uniform([-2, -2, -9], [2, 2, 9], (*shape, 3))
    encoded = env.encode_goal(goals)
    assert encoded.shape == (*shape, 8), "goals [..., 3] -> [..., 8]: write x as goal[..., 0]"
    alone = [env.encode_goal(goal) for goal in goals.reshape(-1, 3)]
    close(encoded.reshape(-1, 8), alone, f"goals of {shape} must not mix")


def test_a_distant_goal_is_observed_as_one_on_the_way(make):
    far, near = OTHER.beyond_m * np.array([[1.01], [0.99]])
    way = np.array([[0.6, -0.8, 0.0]])  # one metre in its direction
    goals = np.vstack([far * way, near * way]) + [0, 0, 2.0]
    seen = env.intermediate(goals, OTHER)
    ahead = [0.6 * OTHER.ahead_m, -0.8 * OTHER.ahead_m, math.atan2(-0.8, 0.6)]
    close(seen[0], ahead, "a goal beyond `beyond_m`: `ahead_m` on the way to it, facing it")
    close(seen[1], goals[1], "a nearer goal is itself")
    world = make(FootstepWorld, 2, task=OTHER)
    world.set_goal([0, 1], goals)
    view = world.look([0, 1])
    close(view.goal, goals, "the view's goal is the true one, for every planner")
    close(view.observation[:, :8], env.encode_goal(seen), "a policy sees the other")


@BOTH
def test_imu_is_only_added_to_what_is_seen_without_it(make, sim):
    plain, more = (make(FootstepVectorEnv, 3, sim, imu=imu) for imu in (False, True))
    seen, both = plain.reset(seed=0)[0], more.reset(seed=0)[0]
    equal(both[:, :20], seen, "the IMU is observed only when it is asked for")
    lean = 4 * more.world.engine.parameters.trunk_pitch
    close(both[:, 20:], np.tile([0, lean, 0, 0, 0], (3, 1)), "it starts leaning")
    motion = more.world.step(default_rng(7).uniform(0.3, 0.7, (3, 6)), more.robots)["motion"]
    imu = np.hstack([4 * motion.torso[:, -1, 3:5], motion.angular_velocity])
    seen = more.look(more.robots)[:, 20:]
    close(seen, imu, "that of the LAST tick of the double step", atol=1e-5)
    more.world.imu[1] = 0.1, -0.2, 1.0, -20.0, 3.0
    hint = "roll, pitch in quarters of a radian, then angular velocity x, y, z, clipped at 10"
    close(more.look([1])[0, 20:], [0.4, -0.8, 1.0, -10.0, 3.0], hint)


def test_the_last_two_actions_are_observed(make):
    one = make(env.FootstepEnv)
    one.reset(seed=0)
    neutral = one.world.neutral_action
    small = np.clip(neutral + [0.05, 0, 0, 0, 0.02, 0], 0, 1)
    close(one.step(small)[0][8:], np.r_[small, neutral] * 2 - 1)
    seen = one.step(neutral)[0][8:]
    close(seen, np.r_[neutral, small] * 2 - 1, "newest first")
    for much in (9, -9):  # a list
        seen = one.step([much] * 6)[0][8:14]
        close(seen, np.sign(much), "as it was asked for, clipped to [0, 1]")


SHARES = (
    "0 is low, 1 is high, 0.5 their middle, for both feet, outward positive; first the left "
    "foot's x, y, yaw, then the right foot's"
)


@BOTH
def test_actions_and_footsteps_are_inverse(sim):
    limits, rng = env.LIMITS[sim], default_rng(2)
    low, high = np.tile(limits.low, 2), np.tile(limits.high, 2)  # [6]
    for k, share in itertools.product(range(6), (0.0, 0.5, 1.0)):  # and all the rest is zero steps
        shares, want = -low / (high - low), np.zeros(6)
        shares[k], want[k] = share, low[k] + share * (high[k] - low[k])
        got = np.ravel(env.to_footsteps(np.broadcast_to(shares, 6), limits))
        close(got, want, f"{SHARES} (for {shares.round(3)})", atol=1e-6)
    narrow = env.StepLimits((-0.1, 0.02, -0.3), (0.3, 0.02, 0.3))
    got = env.to_action(np.broadcast_to([0.0, 0.02, 0.0], (2, 3)), narrow)
    close(got, [0.25, 0.5, 0.5] * 2, "to_action: low = high leaves no choice, 0.5", atol=1e-6)
    drawn = rng.uniform(limits.low, limits.high, (1000, 2, 3))
    frozen(drawn)
    action = env.to_action(drawn, limits)
    assert action.shape == (1000, 6), "footsteps [..., 2, 3] -> actions [..., 6]"
    assert action.min() >= 0 and action.max() <= 1, "to_action: the low limit is 0, the high one 1"
    close(
        env.to_footsteps(action, limits),
        drawn,
        "to_action is the inverse: what is within the limits is walked as asked for",
        atol=1e-6,
    )
    some = action[:6].reshape(2, 3, 6)
    assert env.to_footsteps(some, limits).shape == (2, 3, 2, 3), "actions [..., 6], any [...]"
    for step, want in (9.0, 1), (-9.0, 0):
        close(env.to_action(np.full((2, 3), step), limits), want, "clipped to [0, 1]")


@pytest.mark.parametrize("name, shape", [("actions", (2, 6)), ("goals", (2, 3))])
def test_wrong_numbers_are_refused_and_change_nothing(make, name, shape):
    one, untouched = (make(FootstepVectorEnv, 2, noise=True) for _ in range(2))
    for envs in (one, untouched):
        envs.reset(seed=8)
    for wrong in (np.full(shape, math.nan), np.full(shape, math.inf), np.zeros(shape)[None], 0.5):
        with pytest.raises(ValueError, match=f"^{name} must be finite numbers of sh"):
            one.step(wrong) if name == "actions" else one.reset(options={"goals": wrong})
    action = np.full((2, 6), 0.45)
    equal(one.step(action)[0], untouched.step(action)[0], "check BEFORE anything is drawn")
    equal(one.reset()[0], untouched.reset()[0])


def potentials(goal, task=TASK):
    """The three quantities Φ of one goal (x, y, α) that a reward pays the changes of."""
    x, y, alpha = (float(v) for v in goal)
    d, beta = math.hypot(x, y), math.atan2(y, x)
    alpha = math.atan2(math.sin(alpha), math.cos(alpha))  # wrapped
    near = math.exp(-((d / task.near_m) ** 2))
    return {
        "r_d": -task.s_d * d,
        "r_a": -task.s_a * abs(alpha) * near,
        "r_o": -task.s_o * abs(beta) * (1 - near),
    }


def by_hand(before, after, action, last, fall, success, task=TASK, margin=0.0):
    """All eight terms of one robot, with nothing but `math`."""
    old, new = potentials(before, task), potentials(after, task)
    jumps = [(action[k] - last[k]) ** 2 for k in range(6)]
    return {
        **{name: new[name] - old[name] for name in old},
        "r_c": -task.s_c * sum(jumps),
        "r_fall": -task.s_fall if fall else 0.0,
        "r_goal": task.s_goal if success else 0.0,
        "r_time": -task.s_time,
        "r_stay": task.s_stay * margin if success else 0.0,
    }


NEAR = "near(d) = exp(−(d / 0.4 m)²)"
FORMULAS = {
    "r_d": "progress: d before − d after",
    "r_a": "|α|·near(d) − |α′|·near(d′), both signs are alike, " + NEAR,
    "r_o": "|β|·far(d) − |β′|·far(d′), far(d) = 1 − near(d), " + NEAR,
    "r_c": "−Σ (action − last action)² over all six numbers",
    "r_fall": "a fall costs s_fall",
    "r_goal": "a success pays s_goal",
    "r_time": "every double step costs s_time, and more if it took longer than a period",
    "r_stay": "a success pays s_stay, times the margin with which the robot comes to rest",
}


@pytest.mark.parametrize("task", [TASK, OTHER], ids=["task", "another task"])
def test_reward_formulas_of_every_robot_are_those_by_hand(task):
    rng, n = default_rng(8), 6  # yaws beyond a turn: α is wrapped
    before, after = np.broadcast_to(rng.uniform([-1, -1, -6], [1, 1, 6], (2, n, 3)), (2, n, 3))
    action, last = rng.random((2, n, 6))
    fall = np.array([True, False, False, True, False, False])
    success = np.array([False, True, False, False, True, False])
    periods, margin = rng.uniform(1, 1.6, n), rng.uniform(-0.5, 1, n)
    got = env.reward_terms(before, after, action, last, fall, success, task, periods, margin)
    for name, values in got.items():
        assert np.shape(values) == (n,), (
            f"{name}: [n], sums go over the action's axis only, .sum(-1) (got {np.shape(values)})"
        )
    for i in range(n):
        ended = fall[i], success[i]
        want = by_hand(before[i], after[i], action[i], last[i], *ended, task, margin[i])
        want["r_time"] *= periods[i]
        assert got.keys() >= want.keys(), "a term is missing"
        for name in want:
            close(
                got[name][i],
                want[name],
                f"{name} of robot {i}: the sign, the scalar of this task, an angle that is not "
                f"wrapped, or another robot's numbers? {FORMULAS[name]}",
            )


@BOTH
def test_rewards_of_a_real_walk_compare_the_poses_before_and_after(make, sim):
    goals = default_rng(4).normal(0, [0.5, 0.5, 2], (4, 3))
    world, robots = make(FootstepWorld, 4, sim, noise=True), np.arange(4)
    world.reset(robots, [default_rng(i) for i in robots], goals)
    for _ in range(12):
        before, last = robot_model.relative(world.pose, goals), world.actions[:, 0].copy()
        action = env.hand_written(world.look(robots).goal, world.limits)
        result = world.step(action, robots)
        after = robot_model.relative(result["motion"].torso[:, -1, [0, 1, 5]], goals)
        ended = result["fall"], result["success"]
        periods = result["motion"].ticks / world.engine.period_ticks
        step = env.to_footsteps(action, world.limits)
        more = {"periods": periods, "margin": env.margin_at_rest(after, step, world.task)}
        want = env.reward_terms(before, after, action, last, *ended, **more)
        for name, values in result["reward_terms"].items():
            close(values, want[name], f"{name}: true goals seen before and after the double step")
        close(result["reward"], sum(want.values()))


def test_the_margin_is_that_of_the_place_where_the_trunk_comes_to_rest():
    # The right foot has just landed 8 cm ahead and 2 cm outward, so the trunk goes on by half of it.
    step = np.array([[0, 0, 0], [0.08, 0.02, 0.1]])
    there = np.array(
        [0.04, -0.01, -0.05]
    )  # where the goal is, if the margin is to be 1: ahead, to the right
    goals = np.array([there, there, there, there])
    goals[1] = robot_model.compose(there, np.array([0.03, 0.0, 0.0]))  # 3 of 5 cm beyond
    goals[2] = robot_model.compose(
        there, np.array([0.0, 0.04, np.radians(5)])
    )  # 4 of 5 cm, 5 of 10°
    goals[3] = robot_model.compose(there, np.array([0.0, 0.0, np.radians(-12)]))  # outside
    got = env.margin_at_rest(goals, np.tile(step, (4, 1, 1)), TASK)
    close(got, [1, 0.4, 0.2, -0.2], "1 − max(d / 5 cm, |α| / 10°), seen from the place of rest")


@pytest.mark.parametrize("name", ["r_d", "r_a", "r_o"])
def test_discounted_progress_telescopes(name):
    # Σ γᵗ·(Φ_{t+1} − Φ_t) = γᵀ·Φ_end − Φ_start + (1 − γ)·Σ γᵗ·Φ_{t+1},  t = 0 … T − 1
    path = default_rng(9).uniform([-1, -1, -3], [1, 1, 3], (21, 3))  # T = 20
    phi = np.array([potentials(goal)[name] for goal in path])
    factors, still, never = GAMMA ** np.arange(20), np.zeros((20, 6)), np.zeros(20, bool)
    parts = env.reward_terms(path[:-1], path[1:], still, still, never, never, TASK)
    paid, waiting = factors @ parts[name], (1 - GAMMA) * factors @ phi[1:]
    close(
        paid,
        GAMMA**20 * phi[-1] - phi[0] + waiting,
        f"{name} is Φ′ − Φ, not Φ − Φ′ and not γ·Φ′ − Φ: {FORMULAS[name]}",
    )


def test_goals_are_spread_as_the_task_says_and_do_not_depend_on_their_number():
    goals = env.draw_goals(stream("evaluation", 0), 5000, OTHER)
    close(goals.mean(0), 0, atol=0.08)
    close(goals[:, :2].std(0), OTHER.goal_std_m, rtol=0.05)
    assert np.all(np.abs(goals[:, 2]) <= math.pi), "yaw is wrapped"
    share = np.mean(np.abs(goals[:, 2]) < math.pi / 2)  # N(0, π/2) wrapped: 0.683 and a bit more
    assert 0.64 < share < 0.73, f"{share:.2f} of the goals turn by less than 90°"
    seven = env.draw_goals(stream("evaluation", 0), 7, OTHER)
    equal(seven, goals[:7], "draw [count, 3], goal after goal")


def test_every_second_goal_of_the_training_is_far(make):
    world, goals = make(FootstepWorld, 1), []
    world.simulator.reset = lambda *_: None  # only goals are of interest here
    world.rng[0] = stream("training", 0)
    for _ in range(1500):
        world.reset([0])
        goals.append(world.goal[0].copy())
    d = np.hypot(*np.array(goals)[:, :2].T)
    for radius in (0.3, 0.6, 1.0, 1.5, 2.0):
        # x, y ~ N(0, σ) lie within r with 1 − exp(−r² / 2σ²); half have σ = 0.5 m, half 1 m
        want = np.mean([1 - math.exp(-((radius / std) ** 2) / 2) for std in (0.5, 1.0)])
        close(
            np.mean(d < radius),
            want,
            f"share of the goals within {radius} m. All with one spread, or not half and half?",
            atol=0.04,
        )


def test_streams_are_separate_and_repeatable():
    numbers = [(), (0,), (1,), (0, 0), (0, 1), (1, 0)]
    keys = [(name, seed, *more) for name in env.STREAMS for seed in (0, 1) for more in numbers]
    drawn = np.array([[stream(*key).random() for key in keys] for _ in range(2)])
    equal(drawn[0], drawn[1])
    assert len({*drawn[0]}) == len(keys), "to numpy (0, 0) is (0): zeros at the end vanish"


def test_noise_has_the_size_of_the_task_and_off_means_exact(make):
    goal = np.array([[0.5, -0.4, 3.13]])  # near ±π: noise has to be wrapped
    exact, noisy = (make(FootstepWorld, 1, noise=noise) for noise in (False, True))

    def look(world):
        """What is seen of the goal [m, m, rad] and by the IMU [rad, rad/s], [8]."""
        world.set_goal([0], goal)  # so that the last look is forgotten
        view = world.look([0])
        return np.append(view.goal, view.observation[0, 20:] / [4, 4, 1, 1, 1])

    true = np.append(goal, exact.imu)
    close(look(exact), true)
    close(exact.look([0]).goal, goal, "also a second look")
    seen = np.array([look(noisy) for _ in range(3000)])
    assert np.all(np.abs(seen[:, 2]) <= math.pi), "wrap the noisy yaw"
    error = robot_model.wrap(seen - true)
    std = [TASK.noise_m] * 2 + [TASK.noise_rad] + [TASK.imu_rad] * 2 + [TASK.imu_rad_s] * 3
    close(error.std(0), std, rtol=0.06)
    close(error.mean(0) / std, 0, atol=0.08)
    together = np.corrcoef(np.c_[error[:-1], error[1:]].T) - np.eye(16)
    assert np.abs(together).max() < 0.1, "every number has noise of its own, anew at every look"
    close(noisy.relative_goal([0]), goal, "the true goal stays true")
    equal(noisy.imu, exact.imu, "the true tilt stays true")


@BOTH
def test_feet_within_the_limits_do_not_touch(sim):
    limits, beside = env.LIMITS[sim], walk_engine.TUNED[sim].foot_distance
    inside = ROBOT.foot_width / 2 - ROBOT.foot_outward  # [m] from the ankle to the inner edge
    sole = [
        *itertools.product(
            (-ROBOT.foot_back, ROBOT.foot_front), (-inside, ROBOT.foot_width - inside)
        )
    ]
    for x, y, yaw in itertools.product(*zip(limits.low, limits.high)):  # where the left foot lands
        corners = robot_model.turned(np.array(sole), np.full(4, yaw)) + [x, beside + y]
        assert corners[:, 1].min() > inside + 0.01, f"{(x, y, yaw)}: on the right foot, or nearly"


DRIFT, NOISE = np.broadcast_to([[0.1, 0.2, 0.5], [0.1, 0.1, 0.2]], (2, 3))


def test_estimate_predict_by_hand():
    goal = np.array([[2.4, 0, 0.5], [1.3, 0.1, 0.5]])
    before = np.array([[[0.01, 0.004, 0], [0.004, 0.02, 0.003], [0, 0.003, 0.03]]] * 2)
    before[1] *= 2
    motion = np.array([[0.4, 0, 0], [0.3, 0.1, math.pi / 2]])
    frozen(goal, before, motion)
    got, covariance = env.predict(goal, before, motion, DRIFT)
    close(
        got,
        [[2.0, 0, 0.5], [0, -1.0, 0.5 - math.pi / 2]],
        "the goal seen from the new pose: who turns left sees it turn right; `relative`",
    )
    # drift² = 0.01, 0.04, 0.25; of the first goal, at x = 2: (x·0.5)² to y, x·0.5² to y with yaw
    close(
        np.diagonal(covariance[0]),
        [0.02, 0.06 + 1.0, 0.28],
        "V + drift² + lever: an unplanned turn by e moves a goal at x ahead by e·x to the SIDE; x "
        "is that after the double step",
    )
    close(
        covariance[0],
        [[0.02, 0.004, 0], [0.004, 1.06, 0.503], [0, 0.503, 0.28]],
        "G·D·Gᵀ: who turned too far sees the goal too far to the right and turned, so these errors "
        "belong together",
    )
    # of the second one, at y = −1: (y·0.5)² to x; x′ = y and y′ = −x
    close(
        covariance[1],
        [[0.04 + 0.26, -0.008, 0.006 + 0.25], [-0.008, 0.06, 0], [0.256, 0, 0.31]],
        "J·P·Jᵀ: who turns left sees the goal, and its errors of x and y, turn back with it",
    )


def test_estimate_correct_by_hand():
    together = [[0.03, 0, 0.02], [0, 0.01, 0], [0.02, 0, 0.03]]
    covariance = np.array([np.diag([0.03, 0.01, 0.12]), 1e6 * np.eye(3), together])
    goal = np.array([[1.0, 2, 3.1], [9, 9, 0], [1, 2, 3]])
    measured = np.array([[2.0, 1, -3.1], [1, 2, 3], [1.3, 2.2, 3]])
    frozen(goal, covariance, measured)
    got, after = env.correct(goal, covariance, measured, NOISE)
    around = 3.1 + 0.75 * (2 * math.pi - 6.2) - 2 * math.pi
    close(
        got[:2],  # K = 0.75, 0.5, 0.75; and 1
        [[1.75, 1.5, around], [1, 2, 3]],
        "goal + K·(measured − goal), K = V / (V + noise²); from 3.1 to −3.1 rad it is a small way, "
        "over π; and with nothing known before, the measurement counts alone",
    )
    close(  # (P + R)⁻¹ of x and yaw: (0.07, −0.02; −0.02, 0.04) / (0.04·0.07 − 0.02²)
        got[2],
        [1.2125, 2.1, 3.1],
        "K = P·(P + R)⁻¹: the errors of x and yaw belong together, so what is seen of x tells of yaw",
    )
    hint = "(1 − K)·P = K·R"
    close(after[0], np.diag([0.0075, 0.005, 0.03]), hint)
    close(after[1], np.diag([0.01, 0.01, 0.04]), hint)
    close(after[2] * 1200, [[8.5, 0, 4], [0, 6, 0], [4, 0, 16]], hint)


@BOTH
def test_the_world_predicts_what_is_planned_and_forgets_with_the_episode(make, sim):
    envs, fell = make(FootstepVectorEnv, 3, sim, noise=True), np.zeros(3, bool)
    world, rng, settings = envs.world, default_rng(0), {"goals": [[2.0, 0, 0]] * 3}

    def follows(robots, plan, disturbance):  # exactly the plan
        trunk = plan.trunk[..., [0, 1, 5]]
        way = robot_model.relative(trunk[:, 0], trunk[:, -1])
        return motion(robot_model.compose(world.pose, way), fell)

    world.simulator.run = follows
    first, _ = envs.reset(seed=0, options=settings)
    first_look = np.tile(0.05**2 * np.eye(3), (3, 1, 1))
    close(world.covariance, first_look, "one measurement; σ = 5 cm, 0.05 rad", atol=1e-8)
    for _ in range(6):
        world.estimate[:], world.covariance[:] = world.relative_goal(envs.robots), 0
        world.step(rng.random((3, 6)), envs.robots)
        close(world.estimate, world.relative_goal(envs.robots), "from trunk to trunk, as planned")
        close(world.covariance[:, 2, 2], env.DRIFT[sim][2] ** 2, atol=1e-9)
    fell[1] = True
    envs.step(rng.random((3, 6)))
    equal(np.isclose(world.covariance[:, 0, 0], 0.05**2), fell, "a new episode knows nothing")
    equal(envs.reset(seed=0, options=settings)[0], first, "to the bit: a seed is an episode")


def disturbances(make, sim, push, steps, n=16):
    """Pushes [N] and errors of the gyro [rad/s] of n robots, [steps, n, T, 2] each; the world."""
    world, told, robots = make(FootstepWorld, n, sim, True, push), [], np.arange(n)
    follow(world, motion(np.zeros((n, 3))))
    world.reset(robots, [stream("training", i) for i in robots])
    for _ in range(steps):
        world.look(robots)
        world.step(np.full((n, 6), 0.5), robots, lambda disturbance, _: told.append(disturbance))
    return np.array([one.push for one in told]), np.array([one.gyro_error for one in told]), world


@BOTH
def test_pushes_come_by_chance_and_from_everywhere(make, sim):
    push, _, world = disturbances(make, sim, 0.4, 150)
    rows = push.reshape(-1, *push.shape[2:])  # [2400, T, 2]
    size = np.hypot(*np.moveaxis(rows, -1, 0))  # [2400, T] [N]
    pushed = size.any(1)
    close(pushed.mean(), world.engine.period / TASK.push_every, "every 3 s", atol=0.03)
    force = ROBOT.torso.mass * 0.4 / 0.05  # F = m·Δv / t, t = five ticks of 10 ms
    first = size[pushed].argmax(1)
    for row, begin in zip(size[pushed], first):
        close(row[begin : begin + 5], force, "one push, of five ticks in a row")
    close(size[pushed].sum(1), 5 * force, "and nothing else")
    last = world.engine.period_ticks - 5
    assert (first.min(), first.max()) == (0, last), "at any time of the usual double step"
    ahead, left = rows[pushed, first].T / force
    counts, _ = np.histogram(np.arctan2(left, ahead), 8, (-math.pi, math.pi))
    if sim == "mujoco":
        assert counts.min() > 0.6 * counts.mean(), "evenly from all around"
    else:
        close(left, 0, "on the plane: ahead or back", atol=1e-12)
        assert 0.4 < (ahead > 0).mean() < 0.6


def test_the_gyro_has_an_offset_for_an_episode_and_noise_at_every_tick(make):
    _, gyro, world = disturbances(make, "mujoco", 0.0, 8, 300)
    error = np.moveaxis(gyro, 1, 0).reshape(300, -1, 2)  # [300, 496, 2] tick after tick
    noise = error - world.gyro_offset[:, None]
    close(noise.mean(1), 0, "the same offset in all of an episode", atol=0.022)
    close(noise.std((0, 1)), TASK.imu_rad_s, rtol=0.02)
    pairs = np.concatenate([noise[:, :-1], noise[:, 1:]], -1).reshape(-1, 4)
    assert np.abs(np.corrcoef(pairs.T) - np.eye(4)).max() < 0.02, "anew at every tick, for x and y"
    parts = np.quantile(world.gyro_offset, [0, 0.25, 0.75, 1])
    close(parts / Spread().gyro, [-1, -0.5, 0.5, 1], "evenly within the spread", atol=0.1)


def test_drawn_bodies_stay_within_the_spread_and_use_all_of_it():
    spread, rngs = Spread(zero=0.01, com=0.02), default_rng(0).spawn(500)
    body, dry = spread.draw(rngs, ROBOT), np.tile(ROBOT.stiction, 2)
    for what, middle, half in (
        ("friction", ROBOT.friction, spread.friction),
        ("mass", 1, spread.mass),
        ("stiffness", 1, spread.stiffness),
        ("stiction", dry, dry * spread.stiction_share),
    ):
        drawn = (vars(body)[what] - middle) / half  # −1 to 1
        assert np.abs(drawn).max() <= 1, f"{what}: beyond its spread"
        assert (drawn.min(0) < -0.96).all() and (drawn.max(0) > 0.96).all(), f"{what}: all of it"
        close(drawn.mean(0), 0 * drawn[0], f"{what}: drawn evenly", atol=0.12)
    assert set(body.delay) == {0, spread.delay} and 0.4 < np.mean(body.delay) < 0.6
    values = np.column_stack([body.friction, body.mass, body.stiffness, body.stiction, body.delay])
    alike = np.corrcoef(values.T) - np.eye(35)
    assert np.abs(alike).max() < 0.2, "every value is drawn by itself: two go together"
    close(body.zero.std(0), np.full(12, 0.01), "σ of every joint's zero", rtol=0.15)
    close([body.com.min(), body.com.max()], [-0.02, 0.02], "± 2 cm on every axis", atol=0.001)
    plain = replace(spread, zero=0.0, com=0.0).draw(default_rng(0).spawn(500), ROBOT)
    equal(plain.mass, body.mass, "what is drawn later does not change what is drawn earlier")
    ice = Spread(friction=2.0).draw(rngs, ROBOT)
    assert ice.friction.min() == 0, "no friction is less than none"


BODY = set(robot_model.Body.__dataclass_fields__)
WILD = default_rng(0).random(6)


class Greedy(Spread):  # takes more random numbers than ours
    def draw(self, rngs, robot):
        for rng in rngs:
            rng.random(99)
        return super().draw(rngs, robot)


@pytest.mark.parametrize("change, may_change", [
    ({"goals": [[1.0, 2.0, 3.0]] * 3}, {"goal"}),
    ({"spread": Greedy(zero=0.01, com=0.01)}, BODY),
    ({"push": 0.8}, {"push"}),
    ({"count": 1}, set()),
    ({"first": lambda world: world.look([0])}, {"noise of the goal", "noise of the IMU"}),
    ({"last": lambda world: world.look([0])}, set()),
    ({"last": lambda world: world.step([WILD], [0])}, set()),
], ids=["goals", "greedy", "push", "fewer", "look", "look at last", "walk on"])  # fmt: skip
def test_what_is_given_or_done_replaces_its_own_draw_and_nothing_else(make, change, may_change):
    def drawn(first=None, last=None, goals=None, count=3, push=0.4, **settings):
        """What is drawn for the first robot in two episodes, [2, ...] by name."""
        settings = {"spread": Spread(zero=0.01, com=0.01), **settings}
        task, robots = replace(TASK, push_every=0.7), np.arange(count)
        world = make(FootstepWorld, count, noise=True, push=push, task=task, **settings)
        rngs, episodes = [stream("training", 6, i) for i in robots], []
        for _ in range(2):
            world.reset(robots, rngs, goals)
            rngs = ()
            if first:
                first(world)
            world.set_goal(robots, world.goal)  # so that the first look is forgotten
            view = world.look(robots)
            seen = vars(world.simulator.body) | {
                "goal": world.goal,
                "of the gyro": world.gyro_offset,
                "noise of the goal": robot_model.wrap(view.goal - world.relative_goal(robots)),
                "noise of the IMU": view.observation[:, 20:],
            }
            equal(world.friction, seen["friction"], "the μ that stage 5 reports is another one")
            world.step([WILD] * count, robots, lambda told, _, to=seen: to.update(push=told.push))
            episodes.append({name: values[0].copy() for name, values in seen.items()})
            if last:
                last(world)
        return {name: np.array([one[name] for one in episodes]) for name in episodes[0]}

    plain, other = drawn(), drawn(**change)
    changed = {name for name in plain if not np.allclose(plain[name], other[name], atol=1e-9)}
    assert changed <= may_change and bool(changed) == bool(may_change), (
        f"{changed} changed: every purpose and every episode has a generator of its own"
    )
    if "push" in change:
        close(other["push"], 2 * plain["push"], "the same pushes, twice as strong")
    if "goals" in change:
        equal(other["goal"], change["goals"][:2])
    for name in plain.keys() - {"delay", "push"}:
        assert len(np.unique(plain[name])) == plain[name].size, f"{name}: drawn anew for each"


def test_a_view_shows_what_was_measured_and_nothing_of_the_truth(make):
    """Ground, body, pose and goal differ, and all the rest is alike: so must be the views."""
    goals, views = np.array([[0.4, -0.1, 0.5]] * 3), []
    for seed, far in ((0, 0.0), (1, 5.0)):
        world = make(FootstepWorld, 3)
        world.reset(np.arange(3), [stream("training", seed, i) for i in range(3)])
        world.pose += far
        world.set_goal(np.arange(3), robot_model.compose(world.pose, goals))  # as seen, the same
        views.append(vars(world.look([2, 1])))
    assert (views[0].pop("limits"), views[1].pop("limits")) == (world.limits, world.limits)
    for name, shown in views[1].items():
        close(views[0][name], shown, f"{name} tells what no robot can know")
        if np.ndim(shown):
            shown[:] = 9
    equal(views[0]["robots"], [2, 1])
    close(views[0]["goal"], goals[:2])
    for values in (world.neutral_action, world.actions, world.estimate):
        assert values.max() <= 1, "a planner wrote into its view: hand out copies"


CHANGES = {  # a student's first change of a number, in both simulators
    "a mass": {"robot": replace(ROBOT, torso=replace(ROBOT.torso, mass=3.0))},
    "a length": {"robot": replace(ROBOT, thigh_length=0.175)},
    "the walk": {"walk": {"foot_rise": 0.03}},
    "a slower walk": {"walk": {"half_ticks": 35}},
    "no choice sideways": {"limits": env.StepLimits((-0.1, 0, -0.3), (0.1, 0, 0.4))},
    "the spread": {"spread": Spread(mass=0.3, delay=0)},
}


@BOTH
@pytest.mark.parametrize("change", CHANGES)
def test_whoever_changes_a_number_can_walk(make, sim, change):
    settings = dict(CHANGES[change])
    if "walk" in settings:
        settings["walk"] = replace(walk_engine.TUNED[sim], **settings["walk"])
    world, robots = make(FootstepWorld, 4, sim, **settings), np.arange(4)
    world.reset(robots, [stream("training", 1, i) for i in robots], [[0.5, 0.1, 0.3]] * 4)
    for _ in range(4):
        result = world.step(env.hand_written(world.look(robots).goal, world.limits), robots)
    assert not result["fall"].any(), f"{change}: it should walk with other numbers, too"
    assert (world.pose[:, 0] > 0.15).all(), f"{change}: it should come nearer, {world.pose}"
    make(gym.make, "Footsteps-v0", sim=sim, **settings).reset()


IMPOSSIBLE = [  # of which setting, which field ("": all of it), and a value that cannot be
    ("spread", "mass", 1.0),
    ("spread", "delay", 2),
    ("spread", "gyro", math.nan),
    ("task", "time_limit", 0.0),
    ("task", "push_every", 0.0),
    ("task", "near_m", 0.0),
    ("task", "noise_m", -0.1),
    ("walk", "half_ticks", 0),
    ("walk", "reflex", -0.05),
    ("walk", "trunk_phase", math.nan),
    ("robot", "torque_limit", (1.0, math.nan)),
    ("robot", "friction", -0.1),
    ("foot", "mass", 0.0),
    ("foot", "com", (0, math.nan, 0)),
    ("limits", "high", (-0.2, 0.1, 0.3)),
    ("limits", "low", (-0.1, math.inf, -0.3)),
    ("limits", "low", (-0.1, 0)),
    ("drift", "", (0.01, 0.01)),
    ("drift", "", (0.01, -0.01, 0.1)),
    ("push", "", -1.0),
    ("push", "", math.nan),
    ("num_robots", "", 0),
    ("sim", "", "bullet"),
]  # fmt: skip


@pytest.mark.parametrize("setting, field, value", IMPOSSIBLE, ids=str)
def test_impossible_settings_are_one_line_when_a_world_is_made(setting, field, value):
    possible = {"spread": Spread(), "task": TASK, "walk": WALK, "limits": env.LIMITS["pymunk"]}
    possible |= {"robot": ROBOT, "foot": ROBOT.foot}
    wrong = {setting: replace(possible[setting], **{field: value}) if field else value}
    if setting == "foot":
        wrong = {"robot": replace(ROBOT, **wrong)}
    with pytest.raises(ValueError, match=r"\A.+\Z") as caught:
        FootstepWorld(**{"num_robots": 1, **wrong})
    assert (field or str(value)) in str(caught.value), "say which setting it is"


def test_an_impossible_body_is_one_line(make):
    world = make(FootstepWorld, 1)
    body = robot_model.Body.as_model(ROBOT, 1)
    with pytest.raises(ValueError, match="Body: stiction"):
        world.simulator.reset([0], replace(body, stiction=-body.mass))


def test_a_time_limit_below_a_double_step_ends_an_episode_with_its_first(make):
    envs = make(FootstepVectorEnv, 2, staggered=True, task=replace(TASK, time_limit=0.3))
    envs.reset(seed=0)
    assert envs.step(np.full((2, 6), 0.5))[3].all()


def test_a_misspelt_setting_or_option_is_an_error(make):
    with pytest.raises(TypeError, match="nois"):
        gym.make("Footsteps-v0", nois=True)
    one = make(env.FootstepEnv)
    one.render()  # before the first reset, too
    with pytest.raises(TypeError, match="goal'"):
        one.reset(options={"goal": [[1.0, 0, 0]]})
    info = one.step(one.world.neutral_action)[-1]
    assert {type(info[name]) for name in ("success", "fall", "timeout", "time")} == {bool, float}
    close(info["seconds"], one.world.engine.period, "of the double step, which did not wait")


IN, OUT, FALL = (0.0, 0), (0.2, 0), "falls, inside"  # from the goal [m], [°]


@pytest.mark.parametrize("ends, want, counted", [  # of the double steps; how it ends; its time
    ([IN, IN], "success", 1), ([IN, OUT, IN, IN], "success", 3), ([IN, FALL], "fall", 2),
    ([(0.049, 9.9)] * 2, "success", 1), ([(0.0, 360)] * 2, "success", 1),
    ([(0.051, 0)] * 2, "", 2), ([(0.0, 10.1)] * 2, "", 2),
    ([(0.0, -10.1)] * 2, "", 2),
])  # fmt: skip
def test_to_arrive_is_to_stay_within_5_cm_and_10_degrees(make, ends, want, counted):
    # Noise must not matter: the true pose counts.
    world, robots = make(FootstepWorld, 3, noise=True), [2, 0]
    # First it starts at its goal, which does not count as having been there. The second time
    # nothing is left of the first episode.
    for goal in np.array([[0, 0, 0], [0.7, -0.2, 1.0]]):
        world.reset(np.arange(3), goals=[goal] * 3)
        for step, end in enumerate(ends, 1):
            x, yaw = IN if end is FALL else end
            off = [0.6 * x, 0.8 * x, math.radians(yaw)], [0.2, 0, 0]  # of robot 2, of robot 0
            follow(world, motion(goal + off, [end is FALL, False]))
            world.look(robots)
            world.set_goal([1], [[9.0, 9.0, 0.0]])  # that of another robot
            result = world.step(np.full((2, 6), 0.4), robots)
            got = [name for name in ("success", "fall", "timeout") if result[name][0]]
            assert got == ([want] if want and step == len(ends) else []), (
                f"after double step {step} of {ends}: two in a row must end within 5 cm AND 10° of "
                "the true goal, wrapped; and a fall in the second is a fall, whatever the last "
                "episode was"
            )
            inside = end is not FALL and abs(x) < 0.05 and min(yaw % 360, -yaw % 360) < 10
            equal(result["inside"], [inside, False], "of every robot by itself; a fall wins")
            paid = [result["reward_terms"][name][0] for name in ("r_goal", "r_fall")]
            assert paid == [TASK.s_goal * ("success" in got), -TASK.s_fall * ("fall" in got)]
            assert not result["success"][1], "a robot arrives for itself, not for another one"
        close(
            result["time"] / world.engine.period,
            [counted, len(ends)],
            "a success took the time to the FIRST of the two",
        )


@BOTH
@pytest.mark.parametrize("limit", [TASK.time_limit, None])  # [s] None: just five double steps
def test_no_time_left_truncates_and_does_not_terminate(make, sim, limit):
    walk, dt = walk_engine.TUNED[sim], ROBOT.control_dt
    longest = dt * walk.longest_wait_ticks * (walk.wait > 0)  # [s] so long the last one may wait
    limit = limit or 10 * dt * walk.half_ticks + longest
    envs = make(FootstepVectorEnv, 5, sim, task=replace(TASK, time_limit=limit))
    period, usual = envs.world.engine.period, envs.world.engine.period_ticks
    whole = math.floor((limit - longest) / period + 1e-9)  # double steps that fit into it
    away, goal = np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    want = np.array(["", "timeout", "timeout", "success", "fall"])
    envs.reset(seed=0, options={"goals": [goal] * 5})
    envs.world.ticks[:] = np.subtract(whole, [3, 2, 2, 2, 2]) * usual
    for (
        poses,
        falls,
    ) in (  # where the last two double steps end, and who falls; robot 0 has one more
        ([away, away, away, goal, goal], False),
        ([away, away, goal, goal, goal], want == "fall"),
    ):
        follow(envs.world, motion(poses, falls))
        _, _, terminated, truncated, infos = envs.step(np.tile(envs.neutral_action, (5, 1)))
        assert (terminated | truncated).any() == np.any(falls), "there was time for two"
    hint = "a time-out truncates: stage 4 bootstraps there, and not after a fall"
    equal(truncated, want == "timeout", hint)
    equal(terminated, np.isin(want, ("success", "fall")), hint)
    for mask in ("_final_obs", "_final_info"):
        equal(infos[mask], want != "", f"{mask} says which episodes ended")
    for name in ("success", "fall", "timeout"):
        equal(infos["final_info"][name], want == name)
    counted = whole - np.isin(want, ("", "success"))
    close(infos["final_info"]["time"], counted * period)
    close(infos["final_obs"][1, 0], 1.0, "one metre was left")
    equal(envs.world.ticks, np.array([whole - 1, 0, 0, 0, 0]) * usual)


def test_seconds_are_counted_also_while_a_double_step_waits(make):
    world, robots = make(FootstepWorld, 3, task=replace(TASK, time_limit=2.0)), np.arange(3)
    usual = world.engine.period_ticks
    world.reset(robots, goals=[[1.0, 0, 0], [0.0, 0, 0], [1.0, 0, 0]])
    for waits in np.array([[0, 0, 0], [40, 8, 0]]):
        done = motion(np.zeros((3, 3)))
        done.ticks += waits
        follow(world, done)
        result = world.step(np.tile(world.neutral_action, (3, 1)), robots)
        cost = result["reward_terms"]["r_time"] * usual / done.ticks
        close(cost, -TASK.s_time, "time costs by the second: more for a double step that waited")
        no_time = [waits.any(), False, False]
        equal(result["timeout"], no_time, "1.64 s: no time for another one")
    close(result["time"], [2 * usual / 100 + 0.4, usual / 100, 2 * usual / 100], "[s]; the success "
          "was there after the first double step")  # fmt: skip


def test_staggered_episodes_end_one_by_one_and_only_the_first_ones_are_short(make):
    settings = {"task": replace(TASK, time_limit=7.0, goal_std_m=1e4, far_std_m=1e4)}
    envs = make(FootstepVectorEnv, 8, staggered=True, **settings)
    follow(envs.world, motion(np.zeros((8, 3))))
    envs.reset(seed=1)
    whole = envs.world.max_steps
    ends = np.array([envs.step(np.full((8, 6), 0.5))[3] for _ in range(3 * whole)])  # [K, 8]
    steps = [np.flatnonzero(column) for column in ends.T]  # when each one timed out
    assert len({one[0] for one in steps}) > 4 and ends[:whole].any(0).all(), "at different times"
    for one in steps:
        equal(np.diff(one), whole, "later episodes have the full time")
