"""What does each ingredient of the learning do? Short trainings, each without one of them.

    python tests/studies/ablations.py [--mujoco] [--only PART] [--out FOLDER]

long: two trainings as long as the shipped one, beside it; their walks are pushed, too.
mode: the shipped trainings decide by the mean of their distribution, and by its mode.
"""

import json
import multiprocessing
import threading
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import product

import common
import matplotlib.pyplot as plt
import numpy as np
from common import FEW, env, evaluate, ppo, robot_model, share
from tqdm import tqdm

torch = ppo.torch
DURATION = "two cores: ablations 40 minutes; in 3-D 80, then long 40, mode 10"
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
    **{
        f"without r_{k}": {"task": {f"s_{k}": 0.0}}
        for k in ("d", "a", "o", "c", "fall", "goal", "time")
    },
}


class ModePlanner(evaluate.PolicyPlanner):
    """Decides by the mode of the distribution; the sharpness k does not change it."""

    def act(self, view):
        seen = torch.as_tensor(view.observation[:, : self.columns])
        with torch.no_grad():
            return self.model.policy(seen).mode.numpy()


def judged(planner, sim, reflex=True):
    """A row for 250 near and 250 far noisy goals, walked on one core."""
    walk = None if reflex else common.without_reflex(sim)
    with common.world(sim, num_robots=GOALS // 2, walk=walk, cores=1) as world:
        parts = [
            common.walks(planner, world, far, sets=1, per_set=GOALS // 2) for far in (False, True)
        ]
    return evaluate.summary("policy", True, None, common.together(parts), env.Task())


def learn(sim, name, seed, steps, folder, cores=None):
    """Train this variant; returns its planner."""
    variant = VARIANTS[name]
    task = replace(env.Task(), **variant.get("task", {}))
    imu = variant.get("imu", False)

    walk = common.without_reflex(sim) if "reflex" in variant else None
    make_envs = partial(
        env.FootstepVectorEnv,
        sim=sim,
        noise=True,
        imu=imu,
        staggered=True,
        task=task,
        walk=walk,
        cores=cores,
    )
    config = ppo.PPOConfig(**variant.get("config", {}))
    model, _ = ppo.train(
        config, make_envs, folder, steps, seed, make_model=variant.get("model", ppo.ActorCritic)
    )
    return evaluate.PolicyPlanner(model)


def ablate(sim, name, seed):
    """The row of one short training on one core; that of a finished one lies in its folder."""
    folder = common.work(sim, "ablations", f"{name}_{seed}")
    path = folder / "row.json"
    if not path.is_file():
        planner = learn(sim, name, seed, STEPS, folder, cores=1)
        row = judged(planner, sim, "reflex" not in VARIANTS[name])
        evaluate.write_text(path, json.dumps(row))
    return {"variant": name, "seed": seed, **common.read_json(path)}


def watch_parent():
    """First call in a process: it ends when the one that started it is gone."""
    threading.Thread(target=robot_model.end_with_parent, daemon=True).start()


def study_ablations(args):
    """As many trainings at a time as there are cores."""
    jobs = list(product([args.sim], VARIANTS, FEW))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(robot_model.CORES, context, watch_parent) as pool:
        try:
            rows = list(tqdm(pool.map(ablate, *zip(*jobs)), total=len(jobs), unit=" trainings"))
        except KeyboardInterrupt:
            for child in multiprocessing.active_children():
                child.terminate()
            raise
    return {"steps": STEPS, "goals": GOALS, "rows": rows}


def walked(sim, planner, far, push, walk=None):
    """The row of a planner on 1,000 noisy goals."""
    with common.world(sim, push=push, walk=walk) as world:
        ended = common.walks(planner, world, far, sets=2)
    return {"push": push, **common.row_of(ended, "policy", far)}


def long_row(sim, name, seed, far, push):
    """The row of a training as long as the shipped ones, made if it is not there."""
    variant, folder = VARIANTS[name], common.RESULTS / sim / "seeds" / str(seed)
    if variant:  # something differs in the training
        folder = common.work(sim, "ablations", f"{name}_{seed}_long")
        if not (folder / "policy.pt").is_file():
            learn(sim, name, seed, ppo.STEPS, folder)
    model, _ = ppo.load_policy(folder / "policy.pt")
    log = np.genfromtxt(folder / "learning_curve.csv", delimiter=",", names=True)
    critic = log["explained_variance"][len(log) // 2 :].mean()  # second half of the training
    walk = common.without_reflex(sim) if "reflex" in variant else None
    row = walked(sim, evaluate.PolicyPlanner(model), far, push, walk)
    return {"variant": name, "seed": seed, "critic": round(critic, 3), **row}


def study_long(args):
    """Two long trainings and the shipped one, with the seed of that one."""
    seed = ppo.load_policy(common.RESULTS / args.sim / "policy.pt")[1]["seed"]
    jobs = product(("reference", "without the reflex", "with IMU"), (False, True), (0.0, 0.4))
    rows = [long_row(args.sim, name, seed, far, push) for name, far, push in jobs]
    return {"steps": ppo.STEPS, "goals": 2 * common.PER_SET, "rows": rows}


def study_mode(args):
    """Every shipped training by both rules."""
    rows = []
    for seed in common.SEEDS[args.sim]:
        file = common.RESULTS / args.sim / "seeds" / str(seed) / "policy.pt"
        model, _ = ppo.load_policy(file)
        for rule, kind in (("mean", evaluate.PolicyPlanner), ("mode", ModePlanner)):
            for far, push in ((False, 0.0), (True, 0.0), (True, 0.4)):
                row = walked(args.sim, kind(model), far, push)
                rows.append({"decides by": rule, "seed": seed, **row})
    return {"goals": 2 * common.PER_SET, "rows": rows}


PARTS = {"ablations": study_ablations, "long": study_long, "mode": study_mode}


def table(found, sim):
    """Every training by every variant or rule."""
    columns = {"seed": 0, "success": 4, "fall": 4, "timeout": 4, "still_there": 3, "time_mean": 2}
    walked = {"goal_std_m": 1, "push": 1} | columns
    return common.sections(
        found,
        {
            "ablations": {"variant": 0} | columns,
            "long": {"variant": 0} | walked | {"critic": 2},
            "mode": {"decides by": 0} | walked,
        },
    )


def plot(found, sim):
    """A bar (mean) for every variant, a dot for every training."""
    rows = found["ablations"]["rows"]
    figure, axes = plt.subplots(1, 2, figsize=(11, 1.6 + 0.25 * len(VARIANTS)), sharey=True)
    for axis, key in zip(axes, ("success", "time_mean")):
        for place, name in enumerate(VARIANTS):
            known = [row[key] for row in common.pick(rows, variant=name) if row[key] is not None]
            axis.barh(place, np.mean(known or [0]), color="tab:blue", alpha=0.5)
            axis.plot(known, [place] * len(known), "ko")
        axis.set(xlabel=common.HEADS[key], yticks=range(len(VARIANTS)), yticklabels=VARIANTS)
    figure.suptitle(f"{STEPS:,} double steps of training ({sim})")
    return figure


def found(data):
    """Sentences and tables by name, from the numbers of both simulators."""
    short, long = (
        data[sim][part]["rows"] for sim, part in (("pymunk", "ablations"), ("mujoco", "long"))
    )

    def mean(rows, key, **wanted):
        return np.mean(common.values(rows, key, **wanted))

    distance, angle = (mean(short, "success", variant=f"without r_{name}") for name in "da")
    plain, sharp = (
        mean(short, "time_mean", variant=name) for name in ("no sharpening", "reference")
    )
    trained = []
    for name in dict.fromkeys(row["variant"] for row in long):
        calm, pushed = common.pick(long, variant=name, goal_std_m=1.0)
        trained.append(
            f"{name} | {calm['time_mean']:.1f} | {share(calm['fall'], 1)} "
            f"| {share(pushed['fall'], 1)} | {share(calm['critic'])}"
        )
    usual, blind, _ = common.values(long, "time_mean", goal_std_m=1.0, push=0.0)
    return {
        "rewards": f"On the plane the mean success is {share(distance)} without the reward for "
        f"distance and {share(angle)} without the one for the angle. All other variants arrive.",
        "sharpening": "So short a training is sharpened too soon: without sharpening the walks "
        f"take {plain:.1f} s, with it {sharp:.1f} s.",
        "blind": f"Trained without the reflex, a policy needs {blind:.1f} s to far goals instead of "
        f"{usual:.1f} s.",
        "long": "Long trainings in 3-D, on the way to far goals; the IMU wins nothing here:\n\n"
        + evaluate.markdown(
            "training | time [s] | falls | falls, pushed | variance explained by the critic",
            trained,
        ),
    }


if __name__ == "__main__":
    common.start("ablations")
