"""What does each ingredient of the learning do? Short trainings, each without one of them.

    python tests/studies/ablations.py [--mujoco] [--only ablations | long | decision] [--out FOLDER]

long: two trainings as long as the shipped one, beside it; their walks are pushed, too.
decision: the shipped trainings decide by the mode of their distribution, as the paper does, and by
its mean, as ours do.
"""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from dataclasses import replace
from itertools import product

import common
import numpy as np
from common import FEW, env, evaluate, ppo, robot_model
from tqdm import tqdm

torch = ppo.torch
DURATION = "two cores: ablations 40 minutes; in 3-D 80, then long 40 and decision 10"
STEPS, GOALS = 50_000, 500  # double steps of a short training, near and far goals for it

class GaussianActor(ppo.ActorCritic):
    """The usual choice instead of the Beta. The environment clips its action; π is not clipped."""
    def __init__(self, obs_dim, act_dim, hidden, first_action, concentration):
        super().__init__(obs_dim, act_dim, hidden)
        self.actor = ppo.mlp((obs_dim, *hidden, act_dim), last_gain=0.01)
        first = torch.as_tensor(first_action, dtype=torch.float32).expand(act_dim)
        self.actor[-1].bias.data.copy_(first)
        # σ² = 1 / (4·(c + 1)), that of a Beta with mean 0.5 and concentration c
        log_std = -0.5 * np.log(4 * (concentration + 1))
        self.log_std = torch.nn.Parameter(torch.full((act_dim,), log_std))

    def policy(self, obs):
        std = self.log_std.exp() / self.sharpness**0.5  # p(x)^k is a normal distribution again
        normal = torch.distributions.Normal(self.actor(obs), std)
        return torch.distributions.Independent(normal, 1)

    def sample(self, obs):
        with torch.no_grad():
            return self.policy(obs).sample()

    def decide(self, obs):
        return np.clip(super().decide(obs), 0, 1)  # its mode and its mean are the same

VARIANTS = {  # name: what differs from the reference
    "reference": {},
    "Gaussian policy, clipped": {"model": GaussianActor},
    "no sharpening": {"config": {"sharpest": 1.0}},
    "with IMU": {"imu": True},
    "without the reflex": {"reflex": False},
    **{f"without r_{k}": {"task": {f"s_{k}": 0.0}}
       for k in ("d", "a", "o", "c", "fall", "goal", "time")},
}

class ModePlanner(evaluate.PolicyPlanner):
    """Decides by the mode of the distribution; the sharpness k does not change it."""
    def act(self, view, robots, measured):
        seen = torch.as_tensor(view.observation[:, : self.columns])
        with torch.no_grad():
            return self.model.policy(seen).mode.numpy()

def judged(planner, sim, reflex=True):
    """A row for 250 near and 250 far noisy goals, walked on one core."""
    with closing(env.FootstepWorld(GOALS // 2, sim, cores=1)) as world:
        if not reflex:
            common.set_reflex(world, 0.0)
        parts = [common.walks(planner, world, True, far, sets=1, per_set=GOALS // 2)
                 for far in (False, True)]
    return evaluate.summary("policy", True, None, common.together(parts), env.Task())

def learn(sim, name, seed, steps, folder, cores=None):
    """Train this variant; returns its planner."""
    variant = VARIANTS[name]
    task = replace(env.Task(), **variant.get("task", {}))
    imu = variant.get("imu", False)

    def make_envs(num_envs):
        envs = env.FootstepVectorEnv(
            num_envs, sim, True, imu, staggered=True, task=task, cores=cores)
        if "reflex" in variant:
            common.set_reflex(envs.world, 0.0)
        return envs

    config = ppo.PPOConfig(**variant.get("config", {}))
    model, _ = ppo.train(config, make_envs, folder, steps, seed,
                         make_model=variant.get("model", ppo.ActorCritic))
    return evaluate.PolicyPlanner(model, imu)

def ablate(sim, name, seed):
    """The row of one short training on one core."""
    folder = common.work(sim, "ablations", f"{name}_{seed}")
    planner = learn(sim, name, seed, STEPS, folder, cores=1)
    return {"variant": name, "seed": seed, **judged(planner, sim, "reflex" not in VARIANTS[name])}

def study_ablations(args):
    """As many trainings at a time as there are cores."""
    jobs = list(product([args.sim], VARIANTS, FEW))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(robot_model.CORES, context) as pool:
        rows = list(tqdm(pool.map(ablate, *zip(*jobs)), total=len(jobs), unit=" trainings"))
    return {"steps": STEPS, "goals": GOALS, "rows": rows}

def study_long(args):
    """Two long trainings and the shipped one, with the seed of that one."""
    seed = ppo.load_policy(common.RESULTS / args.sim / "policy.pt")[1]["seed"]
    folders, rows = {"reference": common.RESULTS / args.sim / "seeds" / str(seed)}, []
    for name in ("without the reflex", "with IMU"):
        folders[name] = common.work(args.sim, "ablations", f"{name}_long")
        if not (folders[name] / "policy.pt").is_file():
            learn(args.sim, name, seed, ppo.STEPS, folders[name])
    for name, far, push in product(folders, (False, True), (0.0, 0.4)):
        model, _ = ppo.load_policy(folders[name] / "policy.pt")
        log = np.genfromtxt(folders[name] / "learning_curve.csv", delimiter=",", names=True)
        with common.world(args.sim) as world:
            world.push = push  # [m/s]
            if "reflex" in VARIANTS[name]:
                common.set_reflex(world, 0.0)
            planner = evaluate.PolicyPlanner(model, name == "with IMU")
            ended = common.walks(planner, world, True, far, sets=2)
        critic = log["explained_variance"][len(log) // 2 :].mean()  # second half of the training
        rows.append({"variant": name, "push": push, "seed": seed, "critic": round(critic, 3),
                     **common.row_of(ended, "policy", True, far)})
    return {"steps": ppo.STEPS, "goals": 2 * common.PER_SET, "rows": rows}

def study_decision(args):
    """Three trainings by both rules."""
    rows, rules = [], {"mode (paper)": ModePlanner, "mean (ours)": evaluate.PolicyPlanner}
    with common.world(args.sim) as world:
        for far, rule, seed in product((False, True), rules, FEW):
            path = common.RESULTS / args.sim / "seeds" / str(seed) / "policy.pt"
            planner = rules[rule](common.policy(path, args.sim).model)
            ended = common.walks(planner, world, True, far)
            rows.append({"rule": rule, "seed": seed,
                         **common.row_of(ended, "policy", True, far)})
    return {"goals": 4 * common.PER_SET, "rows": rows}

PARTS = {"ablations": study_ablations, "long": study_long, "decision": study_decision}

def table(found, sim):
    """Every training by every variant or rule."""
    columns = {"seed": 0, "success": 4, "fall": 4, "timeout": 4, "still_there": 3, "time_mean": 2}
    return common.sections(found, {
        "ablations": {"variant": 0} | columns,
        "long": {"variant": 0, "goal_std_m": 1, "push": 1} | columns | {"critic": 2},
        "decision": {"goal_std_m": 1, "rule": 0} | columns})

def plot(found, sim):
    """Every training of the variants."""
    rows = found["ablations"]["rows"]
    return common.dots(rows, "variant", "success", f"{STEPS:,} double steps of training ({sim})")

if __name__ == "__main__":
    common.run("ablations")
