"""What does each ingredient of the learning do? Short trainings, each without one of them.

    python tests/studies/ablations.py [--mujoco] [--only PART] [--out FOLDER]

robots: trainings with more robots, the same double steps in all, and one seed.
mode: the shipped policy, deciding by the mean of its distribution and by its mode.
"""

import json
from functools import partial
from itertools import product

import common
import numpy as np
from common import env, evaluate, fallen, pick, ppo, robot_model, share, values

torch = ppo.torch
DURATION = "two cores: ablations 15 minutes, robots 4; in 3-D 35, mode 5"
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


PEER = "Gaussian policy, no sharpening"
SAME = "all robots and floors the same"
UNSHARPENED = ppo.PPOConfig(sharpest=1.0)
VARIANTS = {  # name: what differs from the reference, see `learn`
    "reference": {},
    "Gaussian policy, clipped": {"model": GaussianActor},
    PEER: {"model": GaussianActor, "config": UNSHARPENED},
    "no sharpening": {"config": UNSHARPENED},
    SAME: {"spread": env.Spread(**dict.fromkeys(vars(env.Spread()), 0))},
    **{
        f"without r_{name[2:]}": {"task": env.Task(**{name: 0.0})}
        for name in vars(env.Task())
        if name.startswith("s_")
    },
}
# In 3-D, where the robot can fall to the side: the rewards and the random world. The others on the
# plane, where a training takes half as long.
IN_3D = "reference", SAME, *(name for name in VARIANTS if name.startswith("without r_"))
ON_PLANE = "reference", *(name for name in VARIANTS if name not in IN_3D)
ROBOTS = {
    "64 robots": {},
    "256 robots": {"config": ppo.PPOConfig(num_envs=256)},
    "256 robots, rollouts of 4": {"config": ppo.PPOConfig(num_envs=256, rollout=4)},
}


class ModePlanner(evaluate.PolicyPlanner):
    """Decides by the mode of the distribution; the sharpness k does not change it."""

    def act(self, view):
        seen = torch.as_tensor(view.observation)
        with torch.no_grad():
            return self.model.policy(seen).mode.numpy()


def judged(planner, sim):
    """The row of a planner for 250 near and 250 far goals with noise."""
    ended = common.near_and_far(planner, common.world(sim, num_robots=GOALS // 2))
    return common.row_of(ended, "policy") | {"goal_std_m": None}


def learn(sim, seed, folder, model=ppo.ActorCritic, config=ppo.PPOConfig(), **world):
    """Trains a variant in a folder, or goes on with it; returns its planner."""
    settings = {"sim": sim, "noise": True, "staggered": True, **world}
    model, _ = ppo.train(
        config,
        partial(env.FootstepVectorEnv, **settings),
        folder,
        STEPS,
        seed,
        resume=(folder / "checkpoint.pt").exists(),
        make_model=model,
    )
    return evaluate.PolicyPlanner(model)


def study_short(args, names, seeds=SEEDS):
    """Rows of all these trainings, made one after the other."""
    rows = []
    for name, seed in product(names, seeds):
        folder = common.work(args.sim, "ablations", f"{name}_{seed}_{STEPS}")
        path = folder / "row.json"
        if not path.is_file():  # the row of a finished training stays until you delete it
            planner = learn(args.sim, seed, folder, **(VARIANTS | ROBOTS)[name])
            row = judged(planner, args.sim)
            robot_model.write_text(path, json.dumps(row))
        rows.append({"variant": name, "seed": seed, **common.read_json(path)})
    return {"steps": STEPS, "rows": rows}


def study_ablations(args):
    """Rows of three trainings for every variant."""
    return study_short(args, IN_3D if args.sim == "mujoco" else ON_PLANE)


def study_mode(args):
    """Rows of the shipped policy by both rules, 1,000 walks each, without pushes and with them."""
    model, _ = ppo.load_policy(common.RESULTS / args.sim / "policy.pt")
    planners = {"mean": evaluate.PolicyPlanner(model), "mode": ModePlanner(model)}
    rows = []
    for rule, far, push in product(planners, (False, True), (0.0, 0.4)):
        ended = common.walks(planners[rule], common.world(args.sim, push=push), far, sets=2)
        rows.append(common.row_of(ended, "policy", far, rule=rule, push=push))
    return rows


PARTS = {
    "ablations": study_ablations,
    "robots": partial(study_short, names=ROBOTS, seeds=[0]),
    "mode": study_mode,
}


SHORT = {"variant": 0, "seed": 0, "success": 4, "fall": 4, "still_there": 3, "time_mean": 2}
COLUMNS = {
    "ablations": SHORT,
    "robots": SHORT,
    "mode": {"goal_std_m": 1, "rule": 0, "push": 1, "time_mean": 2, "still_there": 3, "fall": 3},
}


def found(data):
    """Sentences and tables by name, from the numbers of both simulators."""
    mean, mode = pick(data["mujoco"]["mode"]["rows"], goal_std_m=1.0, push=0.4)

    def means(part, key, names, sim="pymunk"):
        rows = data[sim][part]["rows"]
        return [np.mean(values(rows, key, variant=name)) for name in names]

    short = data["mujoco"]["ablations"]["rows"]
    arrived = dict(zip(IN_3D, means("ablations", "success", IN_3D, "mujoco")))
    distance, least = share(arrived.pop("without r_d")), min(arrived.values())
    return {
        "rewards": "In 3-D, after short trainings without the reward for distance, the robot "
        f"arrives in {distance} of the walks. After the trainings of all other variants it "
        f"arrives in {'all' if least == 1 else f'at least {share(least)}'} walks.",
        "falls": f"After all of these trainings the robot falls in {fallen(short)} walks. So short "
        "trainings cannot show what the cost of a fall and the random worlds are for.",
        "sharpening": "On the plane, with a Beta policy, the walks take {0:.1f} s, and {3:.1f} s if it is not "
        "sharpened. With a Gaussian policy they take {1:.1f} s, and {2:.1f} s if it is not "
        "sharpened.".format(*means("ablations", "time_mean", [*VARIANTS][:4])),
        "robots": "Three trainings have 25,600 double steps each. With 64 robots the walks then take "
        "{:.1f} s, with 256 robots {:.1f} s, and with 256 robots that take only 4 double steps in a "
        "rollout {:.1f} s.".format(*means("robots", "time_mean", ROBOTS)),
        "mode": "If the policy takes the mode of its distribution, as in the paper, and not its mean, a "
        f"far walk with pushes takes {mode['time_mean']:.2f} instead of {mean['time_mean']:.2f} s, and the "
        f"robot falls in {fallen([mode])} instead of {fallen([mean])}. The 95 % intervals of the falls "
        f"{common.overlap(mean['fall_ci95'], mode['fall_ci95'])}.",
    }


if __name__ == "__main__":
    common.start("ablations")
