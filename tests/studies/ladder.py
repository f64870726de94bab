"""What leads from the paper to this system, and what does PPO need here? Short trainings.

    python tests/studies/ladder.py --mujoco [--only PART] [--out FOLDER]

rungs: from the paper's system to ours, one change after the other. (`RUNGS`; only in 3-D.)
without: our system without one part of the learning at a time.

A training that is finished stays in runs/<sim>/studies/ladder until you delete it.
"""

import json
import sys
from dataclasses import replace
from functools import partial
from itertools import product

import baseline
import common
import numpy as np
from common import env, evaluate, ppo, robot_model, values, walk_engine

sys.path.append(str(common.ROOT / "tests" / "exercises" / "starters"))
import pendulum

torch = ppo.torch
DURATION = "on one core: without, 3-D: 100 minutes, 2-D: 70; rungs: 3 hours"
STEPS = {"pymunk": 60_000, "mujoco": 125_000}  # double steps of a training
SEEDS = {"pymunk": (0, 1, 2), "mujoco": (0,)}  # of `without`
FIRST, SETS = 140, 2  # evaluation seeds: 1,000 near and 1,000 far goals of `without`


class ShapeActor(ppo.ActorCritic):
    """The outputs are the two parameters of each Beta distribution, α − 1 and β − 1."""

    def __init__(self, obs_dim, act_dim, hidden, first_action=0.5, concentration=10.0):
        super().__init__(obs_dim, act_dim, hidden)
        mode = torch.as_tensor(first_action).expand(act_dim).clamp(0.01, 0.99)
        first = torch.cat([mode, 1 - mode]) * (concentration - 2)
        self.actor[-1].bias.data.copy_(first.expm1().log())

    def policy(self, obs):
        shape = 1 + torch.nn.functional.softplus(self.actor(obs)).clamp(1e-3, 1e3)
        beta = torch.distributions.Beta(*shape.chunk(2, -1), validate_args=False)
        return torch.distributions.Independent(beta, 1, validate_args=False)


class NoCritic(ppo.ActorCritic):
    """V = 0 everywhere."""

    def value(self, obs):
        return 0 * super().value(obs)


AS_MODEL = env.Spread(**dict.fromkeys(vars(env.Spread()), 0.0))  # no robot differs from the model
WALK = walk_engine.TUNED["mujoco"]
# As far as the paper's text tells. Ours are robot and walk, the scalars of the reward and the price
# of a fall, one last action instead of two, noise and far goals in training, and how long it takes.
PAPER = {
    "model": ShapeActor,
    "task": env.Task(in_a_row=1, s_goal=0.0, s_time=0.0, s_stay=0.0),
    "drift": (1e3, 1e3, 1e3),  # so only the last measurement counts
    "walk": replace(WALK, **common.NO_ANSWERS),
    "spread": AS_MODEL,
}
# What each rung changes. First the learning, in the paper's world; then the world; at last the rule
# of a success, which changes what is counted.
RUNGS = {
    "the paper's": {},
    "an estimate of the goal": {"drift": env.DRIFT["mujoco"]},
    "rewards of goal and time": {"task": env.Task(in_a_row=1, s_stay=0.0)},
    "outputs mode and concentration": {"model": ppo.ActorCritic},
    "answers to a lean": {"walk": WALK},
    "random floors and bodies": {"spread": env.Spread()},
    "two in a row, reward of rest": {"task": env.Task()},
}
WITHOUT = {  # what differs from our system, see `learn`
    "nothing": {},
    "critic (V = 0)": {"model": NoCritic},
    "clipping (ε = ∞)": {"config": ppo.PPOConfig(clip=1e9)},
    "λ below 1 (λ = 1)": {"config": ppo.PPOConfig(lam=1.0)},
    "r_c": {"task": env.Task(s_c=0.0)},
    "random worlds in training": {"spread": AS_MODEL},
}


def learn(sim, name, seed, model=ppo.ActorCritic, config=ppo.PPOConfig(), **world):
    """Trains in this world, or takes the training of this name that is there; returns its planner."""
    folder = common.work(sim, "ladder", f"{name}_{seed}")
    if not (folder / "policy.pt").is_file():
        envs = partial(env.FootstepVectorEnv, sim=sim, noise=True, **world)
        ppo.train(config, envs, folder, STEPS[sim], seed, make_model=model)
    network, _ = ppo.load_policy(folder / "policy.pt", model)
    return evaluate.PolicyPlanner(network)


def kept(path, measure, *args, **settings):
    """What measure returns, plain values; the file keeps it, for when the study is started again."""
    if not path.is_file():
        robot_model.write_text(path, json.dumps(ppo.as_json(measure(*args, **settings))))
    return common.read_json(path)


def study_without(args):
    """A row for every training, and for all of one name together."""
    world, walked, rows = common.world(args.sim), {}, []
    for name, seed in product(WITHOUT, SEEDS[args.sim]):
        planner = learn(args.sim, f"without {name}", seed, **WITHOUT[name])
        for far in common.STD:
            walked[name, seed, far] = common.walks(planner, world, far, SETS, FIRST)
    for name, far in product(WITHOUT, common.STD):
        own, reference = (
            common.together([walked[kind, seed, far] for seed in SEEDS[args.sim]])
            for kind in (name, "nothing")
        )
        row = common.row_of(own, name, far, without=name)
        rows.append(row | common.time_over("time_over_all", own, reference))
        ratios = (
            common.time_over("", walked[name, seed, far], walked["nothing", seed, far])[""]
            for seed in SEEDS[args.sim]
        )
        rows[-1]["per_seed"] = ", ".join(f"{ratio:.3f}" for ratio in ratios)
    return {"steps": STEPS[args.sim], "rows": rows}


def tuned_for(world):
    """Settings of `baseline_tuned` for near goals in this world, from those of stage 5 on."""
    start = vars(evaluate.TUNED_BASELINE[world.sim]).copy()
    del start["share"]

    def walked(drawn, trial):
        goals = evaluate.draw_trials(trial, len(world.goal) // len(drawn), purpose="tuning").goals
        return common.at_once([baseline.tuned_of(x) for x in np.exp(drawn)], world, goals, trial)

    def cost(ended):
        return baseline.cost(baseline.facts(ended) | {"still_there": 1.0})

    x, _ = common.search(walked, cost, np.log([*start.values()]), 0.2, STEPS[world.sim], 0)
    return np.exp(x)


def judged(sim, name, planner, noise, in_a_row, task, **own):
    """The row of a planner for near goals; a success is in_a_row double steps at the goal."""
    task = replace(task, in_a_row=in_a_row)
    ended = common.walks(planner, common.world(sim, noise=noise, task=task, **own), first=FIRST)
    return common.row_of(ended, name) | {"noise": noise, "in_a_row": in_a_row}


def study_rungs(args):
    """Rows of every rung's policies and of the baseline: with noise and without, by both rules of a
    success; on the first rung also of `baseline_tuned`, searched anew in its world."""
    if args.sim != "mujoco":
        print("the rungs are only in 3-D: --mujoco")
        return None
    settings, rows, folder = PAPER, [], common.work(args.sim, "ladder", "rungs")
    for k, (rung, change) in enumerate(RUNGS.items()):
        settings = settings | change
        own = {name: value for name, value in settings.items() if name != "model"}
        planners = {"baseline": evaluate.BaselinePlanner()}
        if not k:
            world = common.world(args.sim, num_robots=common.CANDIDATES * 48, **own)
            tuned = kept(folder / "tuned.json", tuned_for, world)
            planners["baseline_tuned"] = baseline.tuned_of(tuned)
        for seed in (0, 1, 2) if k in (0, len(RUNGS) - 1) else (0,):
            planners[f"policy {seed}"] = learn(args.sim, f"rung {k}", seed, **settings)
        for name, noise, in_a_row in product(planners, (True, False), (1, 2)):
            path = folder / f"{k} {name} {noise} {in_a_row}.json"
            row = kept(path, judged, args.sim, name, planners[name], noise, in_a_row, **own)
            how = f"{'with' if noise else 'without'} noise, {in_a_row} at the goal"
            rows.append({"rung": rung, "how": how} | row)
    return {"steps": STEPS[args.sim], "rows": rows}


def cut_off_is_end(model, optimizer, data, cfg):
    """`improve` of a learner that takes the end of the time for a fall."""
    data["terminated"] = data["terminated"] | data["truncated"]
    data["advantage"], data["target"] = ppo.judge(model, data, cfg)
    return ppo.improve(model, optimizer, data, cfg)


PENDULUM = {  # what differs from stage 4 on a task without a robot
    "complete": {},
    "no critic (V = 0)": {"make_model": NoCritic},
    "a cut-off taken for an end": {"improve": cut_off_is_end},
    "no clipping (ε = ∞)": {"clip": 1e9},
    "λ = 0": {"lam": 0.0},
}


def swung(folder, seed, make_model=ppo.ActorCritic, improve=ppo.improve, **changes):
    """The log of a training on Pendulum, plain values; changes: of the settings."""
    config = replace(pendulum.CONFIG, **changes)
    learner = {"make_model": make_model, "improve": improve}
    return ppo.train(config, pendulum.gym_envs, folder, 60_000, seed, **learner)[1]


def study_pendulum(args):
    """The return of every training, after each update in which episodes ended."""
    rows = []
    for name, seed in product(PENDULUM, range(5)):
        folder = common.work("Pendulum-v1", "ladder", f"{name}_{seed}")
        log = kept(folder / "rows.json", swung, folder, seed, **PENDULUM[name])
        ended = [row for row in log if row["return"] == row["return"]]  # else it is nan
        returns = [round(row["return"], 2) for row in ended]
        row = {"learner": name, "seed": seed, "steps": values(ended, "steps"), "return": returns}
        rows.append(row)
    return rows


PARTS = {"pendulum": study_pendulum, "without": study_without, "rungs": study_rungs}


def last_returns(rows, name):
    """The mean of the last three returns of each training of a learner."""
    return [np.mean(returns[-3:]) for returns in values(rows, "return", learner=name)]


def table(found):
    """The learners on Pendulum, what PPO needs, and the rungs."""
    text = ""
    if "pendulum" in found:
        rows = found["pendulum"]["rows"]
        lines = []
        for name in PENDULUM:
            last = last_returns(rows, name)
            line = {"learner": name, "return": np.mean(last), "worst": min(last), "best": max(last)}
            lines.append(line)
        columns = {"learner": 0, "return": 1, "worst": 1, "best": 1}
        text += f"### pendulum\n\n{common.table(lines, columns)}\n"
    without = {"without": 0, "goal_std_m": 1, "falls": 0, "time_mean": 2}
    columns = {
        "without": without | {"time_over_all": 3, "per_seed": 0},
        "rungs": {"rung": 0, "planner": 0, ("time_mean", "how"): 2, ("falls", "how"): 0},
    }
    return text + common.sections(found, columns)


def plot(found, sim):
    """What each learner's return does on Pendulum."""
    figure, axes = common.subplots(figsize=(8, 4.5))
    pendulum.draw_learners(axes, found["pendulum"]["rows"])
    for line in axes.lines:
        x, y = line.get_data()
        axes.text(1.01 * x[-1], y[-1], line.get_label(), color=line.get_color(), va="center")
    axes.set_xlim(0, 1.4 * x[-1])
    axes.set_title("PPO swings up a pendulum: mean of five seeds, 95 % intervals")
    return figure


if __name__ == "__main__":
    common.start("ladder")
