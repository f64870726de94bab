"""What does each ingredient of the learning do? Short trainings, each without one of them.

    python tests/studies/ablations.py [--mujoco] [--only PART] [--out FOLDER]

robots: trainings with more robots, the same double steps in all, and one seed.
long: the shipped policy, deciding by its mean and by its mode, and a policy that was trained as
long without the reflex. They are compared with and without pushes.
"""

import json
from functools import partial
from itertools import product

import common
import numpy as np
from common import env, evaluate, pick, ppo, robot_model, share, values

torch = ppo.torch
DURATION = "two cores: ablations 40 minutes, robots 4; in 3-D twice that, then long 20"
STEPS, GOALS = 25_600, 500  # double steps of a short training, near and far goals for it
SEEDS = (0, 1, 2)  # of the short trainings


def log_std(concentration):
    """ln σ of a normal distribution as wide as a Beta with mean 0.5 and concentration c."""
    return -0.5 * np.log(4 * (concentration + 1))  # σ² = 1 / (4·(c + 1))


class GaussianActor(ppo.ActorCritic):
    """A normal distribution, the usual choice. The environment clips its actions, not π."""

    def __init__(self, obs_dim, act_dim, hidden, first_action, concentration):
        super().__init__(obs_dim, act_dim, hidden)
        self.actor = ppo.mlp((obs_dim, *hidden, act_dim), last_gain=0.01)
        self.actor[-1].bias.data.copy_(torch.as_tensor(first_action))
        self.log_std = torch.nn.Parameter(torch.full((act_dim,), log_std(concentration)))

    def policy(self, obs):
        std = self.log_std.exp() / self.sharpness**0.5  # p(x)^k is a normal distribution again
        normal = torch.distributions.Normal(self.actor(obs), std)
        return torch.distributions.Independent(normal, 1)

    def sample(self, obs):
        with torch.no_grad():
            return self.policy(obs).sample()

    def decide(self, obs):
        return np.clip(super().decide(obs), 0, 1)  # its mode and its mean are the same


PEER, BLIND = "Gaussian policy, no sharpening", "without the reflex"
VARIANTS = {  # name: what differs from the reference
    "reference": {},
    "Gaussian policy, clipped": {"model": GaussianActor},
    PEER: {"model": GaussianActor, "config": {"sharpest": 1.0}},
    "no sharpening": {"config": {"sharpest": 1.0}},
    "with IMU": {"world": {"imu": True}},
    BLIND: {},
    **{
        f"without r_{name[2:]}": {"world": {"task": env.Task(**{name: 0.0})}}
        for name in vars(env.Task())
        if name.startswith("s_")
    },
}
ROBOTS = {
    "64 robots": {},
    "256 robots": {"config": {"num_envs": 256}},
    "256 robots, rollouts of 4": {"config": {"num_envs": 256, "rollout": 4}},
}


class ModePlanner(evaluate.PolicyPlanner):
    """Decides by the mode of the distribution; the sharpness k does not change it."""

    def act(self, view):
        seen = torch.as_tensor(view.observation[:, : self.columns])
        with torch.no_grad():
            return self.model.policy(seen).mode.numpy()


def judged(planner, sim, walk=None):
    """The row of a planner for 250 near and 250 far goals with noise."""
    with common.world(sim, num_robots=GOALS // 2, walk=walk) as world:
        ended = common.near_and_far(planner, world)
    return evaluate.summary("policy", True, None, ended, env.Task())


def walk_of(sim, name):
    """The walk that a variant is trained and judged with; None: the usual one."""
    return common.without_reflex(sim) if name == BLIND else None


def learn(sim, name, seed, steps):
    """Trains this variant; returns its planner and its folder."""
    variant = (VARIANTS | ROBOTS)[name]
    make_envs = partial(
        env.FootstepVectorEnv,
        sim=sim,
        noise=True,
        staggered=True,
        walk=walk_of(sim, name),
        **variant.get("world", {}),
    )
    config = ppo.PPOConfig(**variant.get("config", {}))
    folder = common.work(sim, "ablations", f"{name}_{seed}_{steps}")
    stopped = (folder / "checkpoint.pt").exists()
    model, _ = ppo.train(
        config,
        make_envs,
        folder,
        steps,
        seed,
        resume=stopped,
        make_model=variant.get("model", ppo.ActorCritic),
    )
    return evaluate.PolicyPlanner(model), folder


def study_short(args, names, seeds=SEEDS):
    """Rows of all these trainings, made one after the other."""
    rows = []
    for name, seed in product(names, seeds):
        path = common.work(args.sim, "ablations", f"{name}_{seed}_{STEPS}") / "row.json"
        if not path.is_file():  # the row of a finished training stays until you delete it
            planner, _ = learn(args.sim, name, seed, STEPS)
            row = judged(planner, args.sim, walk_of(args.sim, name))
            robot_model.write_text(path, json.dumps(row))
        rows.append({"variant": name, "seed": seed, **common.read_json(path)})
    return {"steps": STEPS, "rows": rows}


BY_MODE = "reference, by its mode"


def study_long(args):
    """Rows, 1,000 walks each: the shipped policy by both rules, and one of the same seed that was
    trained without the reflex.
    """
    folder = common.RESULTS / args.sim
    model, about = ppo.load_policy(folder / "policy.pt")
    seed = about["seed"]
    blind, blind_folder = learn(args.sim, BLIND, seed, ppo.STEPS)
    rows = []
    for name, planner, log in (
        ("reference", evaluate.PolicyPlanner(model), folder),
        (BY_MODE, ModePlanner(model), folder),
        (BLIND, blind, blind_folder),
    ):
        log = np.genfromtxt(log / "learning_curve.csv", delimiter=",", names=True)
        critic = log["explained_variance"][len(log) // 2 :].mean()  # second half of the training
        about = {"variant": name, "seed": seed, "critic": critic}
        for far, push in product((False, True), (0.0, 0.4)):
            with common.world(args.sim, push=push, walk=walk_of(args.sim, name)) as world:
                ended = common.walks(planner, world, far, sets=2)
            rows.append(common.row_of(ended, "policy", far, **about, push=push))
    return rows


PARTS = {
    "ablations": partial(study_short, names=VARIANTS),
    "robots": partial(study_short, names=ROBOTS, seeds=[0]),
    "long": study_long,
}


LONG = {"variant": 0, "push": 1, "time_mean": 2, "still_there": 3, "fall": 3, "critic": 2}


def table(found, sim):
    """Markdown of every training."""
    columns = {"variant": 0, "seed": 0, "success": 4, "fall": 4, "still_there": 3, "time_mean": 2}
    long = {"goal_std_m": 1} | LONG
    return common.sections(found, {"ablations": columns, "robots": columns, "long": long})


def found(data):
    """Sentences and tables by name, from the numbers of both simulators."""
    plane, long = data["pymunk"], data["mujoco"]["long"]["rows"]

    def means(part, key, names):
        rows = plane[part]["rows"]
        return [np.mean(values(rows, key, variant=name)) for name in names]

    arrived = dict(zip(VARIANTS, means("ablations", "success", VARIANTS)))
    distance, least = share(arrived.pop("without r_d")), min(arrived.values())
    shown = {key: digits for key, digits in LONG.items() if key != "push"}
    usual, blind = (
        share(values(long, "fall", goal_std_m=1.0, push=0.4, variant=name), 1)
        for name in ("reference", BLIND)
    )
    return {
        "rewards": "On the plane, after short trainings without the reward for distance, the robot "
        f"arrives in {distance} of the walks. After those of every other variant it arrives in "
        f"{'all' if least == 1 else f'at least {share(least)}'} of them.",
        "sharpening": "With a Beta policy the walks take {0:.1f} s, and {3:.1f} s if it is not "
        "sharpened. With a Gaussian policy they take {1:.1f} s, and {2:.1f} s if it is not "
        "sharpened.".format(*means("ablations", "time_mean", [*VARIANTS][:4])),
        "robots": "After one training of the same 25,600 double steps the walks take {:.1f} s with "
        "64 robots, {:.1f} s with 256, and {:.1f} s with 256 and rollouts of 4.".format(
            *means("robots", "time_mean", ROBOTS)
        ),
        "blind": "If the reflex is off in training and walk, the robot falls in "
        f"{blind} of 1,000 far walks with pushes. If it is on in both, the robot falls in {usual}.",
        "long": "The long trainings in 3-D were judged by 1,000 far walks each, with pushes of 0.4 "
        "m/s:\n\n" + common.table(pick(long, goal_std_m=1.0, push=0.4), shown),
    }


if __name__ == "__main__":
    common.start("ablations")
