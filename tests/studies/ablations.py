"""What does each ingredient of the learning do? Short trainings, each without one of them.

    python tests/studies/ablations.py [--mujoco] [--only PART] [--out FOLDER]

ablations: trainings without one ingredient, three seeds each.
robots: trainings with more robots, the same double steps in all, and one seed.
"""

import json
from functools import partial
from itertools import product

import common
import numpy as np
from common import env, evaluate, ppo, robot_model

torch = ppo.torch
DURATION = "one core: ablations 25 minutes, robots 4; 3-D: three times as long"
STEPS, GOALS = 25_600, 500  # double steps of a short training, near and far goals for it
SEEDS = (0, 1, 2)  # of the short trainings


class GaussianActor(ppo.ActorCritic):
    """A normal distribution, the usual choice. The environment clips its actions, not π."""

    def __init__(self, obs_dim, act_dim, hidden, first_action, concentration):
        super().__init__(obs_dim, act_dim, hidden)
        self.actor = ppo.mlp((obs_dim, *hidden, act_dim), last_gain=0.01)
        self.actor[-1].bias.data.copy_(torch.as_tensor(first_action))
        # As wide as a Beta with mean 0.5 and concentration c: σ² = 1 / (4·(c + 1))
        log_std = -0.5 * np.log(4 * (concentration + 1))
        self.log_std = torch.nn.Parameter(torch.full((act_dim,), log_std))

    def policy(self, obs):
        normal = torch.distributions.Normal(self.actor(obs), self.log_std.exp())
        return torch.distributions.Independent(normal, 1)

    def sample(self, obs):
        with torch.no_grad():
            return self.policy(obs).sample()

    def decide(self, obs):
        return np.clip(super().decide(obs), 0, 1)


class ShapeActor(ppo.ActorCritic):
    """The outputs are the two parameters of each Beta distribution, α − 1 and β − 1."""

    def __init__(self, obs_dim, act_dim, hidden, first_action, concentration):
        super().__init__(obs_dim, act_dim, hidden)
        mode = torch.as_tensor(first_action).expand(act_dim).clamp(0.01, 0.99)
        first = torch.cat([mode, 1 - mode]) * (concentration - 2)
        self.actor[-1].bias.data.copy_(first.expm1().log())

    def policy(self, obs):
        shape = 1 + torch.nn.functional.softplus(self.actor(obs)).clamp(1e-3, 1e3)
        beta = torch.distributions.Beta(*shape.chunk(2, -1), validate_args=False)
        return torch.distributions.Independent(beta, 1, validate_args=False)


VARIANTS = {  # name: what differs from the reference, see `learn`
    "reference": {},
    "Gaussian policy, clipped": {"model": GaussianActor},
    "outputs α and β": {"model": ShapeActor},
    "learning rate 1e-3": {"config": ppo.PPOConfig(learning_rate=1e-3)},
    **{f"without r_{name}": {"task": env.Task(**{f"s_{name}": 0.0})} for name in "daoc"},  # paper
}
ROBOTS = {
    "64 robots": {},
    "256 robots": {"config": ppo.PPOConfig(num_envs=256)},
    "256 robots, rollouts of 4": {"config": ppo.PPOConfig(num_envs=256, rollout=4)},
}


def judged(planner, sim):
    """The row of a planner for 250 near and 250 far goals with noise."""
    ended = common.near_and_far(planner, common.world(sim, num_robots=GOALS // 2))
    return common.row_of(ended, "policy") | {"goal_std_m": None}


def learn(sim, seed, folder, model=ppo.ActorCritic, config=ppo.PPOConfig(), **world):
    """Trains a variant in a folder, or goes on with it; returns its planner."""
    model, _ = ppo.train(
        config,
        partial(env.FootstepVectorEnv, sim=sim, noise=True, **world),
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


PARTS = {
    "ablations": partial(study_short, names=VARIANTS),
    "robots": partial(study_short, names=ROBOTS, seeds=[0]),
}


SHORT = {"variant": 0, "seed": 0, "success": 4, "fall": 4, "still_there": 3, "time_mean": 2}
COLUMNS = dict.fromkeys(PARTS, SHORT)


if __name__ == "__main__":
    common.start("ablations")
