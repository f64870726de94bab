"""What leads from the paper to this system, and what does PPO need here? Short trainings.

    python tests/studies/ladder.py --mujoco [--only PART [--rung NAME]] [--out FOLDER]

walk: the walk of the rungs that have no answers to a lean, searched for without them. (Only in 3-D.)
rungs: from the paper's system to ours in three changes, three trainings on each rung. (`RUNGS`; only
in 3-D.) With --rung only this one is measured; of the others the file keeps what it has.
without: our system without one part of the learning at a time.

What is finished stays in runs/<sim>/studies/ladder until you delete it, so a study that was stopped
goes on there.
"""

import json
import sys
from dataclasses import replace
from functools import partial
from itertools import product

import baseline
import common
import numpy as np
import walk
from common import env, evaluate, ppo, robot_model, values, walk_engine

sys.path.append(str(common.ROOT / "tests" / "course" / "starters"))
import pendulum

torch = ppo.torch
DURATION = "on one core: without, 3-D: 100 minutes, 2-D: 90; walk: 25 minutes; rungs: 6 hours"
STEPS = {"pymunk": 60_000, "mujoco": 125_000}  # double steps of a training
SEEDS = {"pymunk": (0, 1, 2), "mujoco": (0,)}  # of `without`
FIRST, SETS = 140, 2  # evaluation seeds: 1,000 near and 1,000 far goals of `without`
RUNGS_FIRST = 300  # that of the rungs: 500 near goals
FLAGS = {"rung": {"metavar": "NAME", "help": "of the rungs measure this one"}}


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
# Found by the part `walk`: a walk for itself, not one with its answers switched off.
OPEN_LOOP = replace(
    WALK,
    **common.NO_ANSWERS,
    double_support=0.0355,
    foot_distance=0.1565,
    foot_rise=0.0317,
    trunk_height=0.3725,
    trunk_phase=-0.0457,
    trunk_pitch=0.0848,
    trunk_swing=0.2116,
    trunk_x_offset=0.0198,
    trunk_roll=0.0431,
)
WALKS = {
    "with answers": WALK,
    "answers switched off": replace(WALK, **common.NO_ANSWERS),
    "searched without answers": OPEN_LOOP,
}
# As far as the paper's text tells. Ours are robot and walk, the scalars of the reward and the price
# of a fall, one last action instead of two, noise and far goals in training, and how long it takes.
PAPER = {
    "model": ShapeActor,
    "task": env.Task(in_a_row=1, s_goal=0.0, s_time=0.0, s_stay=0.0),
    "drift": (1e3, 1e3, 1e3),  # so only the last measurement counts
    "walk": OPEN_LOOP,
    "spread": AS_MODEL,
}
# What each rung changes. First the learning, in the paper's world: an estimate of the goal, rewards
# of goal and time, a policy that learns mode and concentration. Then the walk. At last the task:
# random floors and bodies, and the rule of a success, which changes what is counted.
RUNGS = {
    "the paper's": {},
    "our learning": {
        "drift": env.DRIFT["mujoco"],
        "task": env.Task(in_a_row=1, s_stay=0.0),
        "model": ppo.ActorCritic,
    },
    "answers to a lean": {"walk": WALK},
    "our task": {"spread": env.Spread(), "task": env.Task()},
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
    """A row for the trainings of each name."""
    world, walked, rows = common.world(args.sim), {}, []
    for name, seed in product(WITHOUT, SEEDS[args.sim]):
        planner = learn(args.sim, f"without {name}", seed, **WITHOUT[name])
        for far in common.STD:
            walked[name, seed, far] = common.walks(planner, world, far, SETS, FIRST)
    for name, far in product(WITHOUT, common.STD):
        own, complete = (
            [walked[one, seed, far] for seed in SEEDS[args.sim]] for one in (name, "nothing")
        )
        row = common.row_of(common.together(own), name, far, without=name)
        # Trainings are not walks: each is shown. None: a network that never arrives
        ratios = [common.time_over("ratio", *pair) for pair in zip(own, complete)]
        per_seed = ", ".join(common.cell(one, "ratio", 3).split(" ")[0] for one in ratios)
        rows.append(row | {"per_seed": per_seed})
    return rows


def tuned_for(world):
    """Settings of `baseline_tuned` for near goals in this world, from those of stage 5 on, and a row
    for each generation of the search."""
    start = baseline.in_use(world.sim)

    def walked(drawn, trial):
        goals = {"first": trial, "purpose": "tuning"}
        return [common.walks(baseline.tuned_of(x), world, **goals) for x in np.exp(drawn)]

    def cost(ended):
        return baseline.cost(baseline.facts(ended) | {"still_there": 1.0})

    x, curve = common.search(walked, cost, np.log([*start.values()]), 0.2, ppo.STEPS, 0)
    return {"settings": np.exp(x), "curve": curve}


def study_walk(args):
    """The walk that a search without answers and pushes ends at (OPEN_LOOP), and a row for each
    generation. `kicks.py` lets it walk."""
    start = replace(WALK, **common.NO_ANSWERS)
    world = common.world("mujoco", num_robots=1, walk=start)
    # step_ticks stays, so that double steps take equally long on all rungs.
    fixed = *common.NO_ANSWERS, "usual_lean", "fade", "step_ticks"
    found, curve = walk.tune(world, 0, fixed, count=2 * walk.WALKS, pushes=(0.0,))
    return {"parameters": vars(found), "curve": curve}


def judged(sim, name, make_planner, in_a_row, task, **own):
    """The row of a planner for near goals; a success is in_a_row double steps at the goal. fell: in
    which of these walks it fell."""
    world = common.world(sim, task=replace(task, in_a_row=in_a_row), **own)
    ended = common.walks(make_planner(), world, first=RUNGS_FIRST)
    more = {"in_a_row": in_a_row, "fell": np.flatnonzero(common.fell(ended))}
    return common.row_of(ended, name) | more


def tuned_there(sim, **own):
    """`baseline_tuned`, searched anew in this world."""
    world = common.world(sim, num_robots=48, **own)
    path = common.work(sim, "ladder", "rungs") / "tuned.json"
    return baseline.tuned_of(kept(path, tuned_for, world)["settings"])


def rows_of_rung(sim, k, rung, settings):
    """Rows of a rung's policies and of the baseline, with noise and by both rules of a success; on
    the first rung and on the last one also of `baseline_tuned`, searched there."""
    own = {name: value for name, value in settings.items() if name != "model"}
    planners = {"baseline": evaluate.BaselinePlanner}
    tuned = {
        "the paper's": partial(tuned_there, sim, **own),
        "our task": partial(evaluate.BaselinePlanner, evaluate.TUNED_BASELINE[sim]),
    }
    if rung in tuned:
        planners["baseline_tuned"] = tuned[rung]
    for seed in (0, 1, 2):
        planners[f"policy {seed}"] = partial(learn, sim, f"rung {k}", seed, **settings)
    folder, rows = common.work(sim, "ladder", "rungs"), []
    for name, in_a_row in product(planners, (1, 2)):
        path = folder / f"{k} {name} {in_a_row}.json"
        row = kept(path, judged, sim, name, planners[name], in_a_row, **own)
        rows.append({"rung": rung, "how": f"{in_a_row} at the goal"} | row)
    return rows


def study_rungs(args):
    """Rows of every rung, or of the one that --rung names beside those that the file has."""
    if args.rung not in (None, *RUNGS):
        raise robot_model.InputError(f"--rung {args.rung}: there are {', '.join(RUNGS)}")
    rows, settings = [], PAPER
    for k, (rung, change) in enumerate(RUNGS.items()):
        settings = settings | change
        if args.rung in (None, rung):
            rows += rows_of_rung(args.sim, k, rung, settings)
        else:
            known = common.read_json(args.out / "ladder.json")["rungs"]["rows"]
            rows += common.pick(known, rung=rung)
    return rows


def cut_off_is_end(model, optimizer, data, cfg):
    """`improve` of a learner that takes the end of the time for a fall."""
    data["terminated"] = data["terminated"] | data["truncated"]
    data["advantage"], data["target"] = ppo.judge(model, data, cfg)
    return ppo.improve(model, optimizer, data, cfg)


PENDULUM = {  # what differs from stage 4 on a task without a robot
    "complete": {},
    "no critic (V = 0)": {"make_model": NoCritic},
    "a time-out taken for an end": {"improve": cut_off_is_end},
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


PARTS = {
    "pendulum": study_pendulum,
    "without": study_without,
    "walk": study_walk,
    "rungs": study_rungs,
}
ONLY_3D = "walk", "rungs"


COLUMNS = {
    "pendulum": {"learner": 0, "return": 1, "worst": 1, "best": 1},
    "without": {"without": 0, ("falls", "goal_std_m"): 0, ("time_mean", "goal_std_m"): 2}
    | {("per_seed", "goal_std_m"): 0},
    "rungs": {"rung": 0, "planner": 0, ("time_mean", "how"): 2, ("still_there", "how"): 2}
    | {"falls": 1},
    "falls on the first rung": {"planner": 0, "falls": 0, "falls of baseline_tuned": 0}
    | {"only_ours": 0, "only_theirs": 0, "p": 4},
}


def last_returns(rows, name):
    """The mean of the last three returns of each training of a learner."""
    return [np.mean(returns[-3:]) for returns in values(rows, "return", learner=name)]


def with_means(rows):
    """The rows of the rungs, and behind several trainings of a rung their mean."""
    found, shown = [], ("time_mean", "falls", "still_there")
    for rung in RUNGS:
        own = common.pick(rows, rung=rung)
        found += own
        for how in dict.fromkeys(values(own, "how")):
            same = [row for row in common.pick(own, how=how) if row["planner"].startswith("policy")]
            if len(same) > 1:
                means = {key: np.mean(values(same, key)) for key in shown}
                found.append({"rung": rung, "planner": "policies, mean", "how": how} | means)
    return found


def falls_there(rows):
    """On the first rung, in the same worlds: in how many walks the robot falls with each training and
    with `baseline_tuned`, and McNemar's exact test. (A training is not a sample of walks, so there
    is no test of all together.)"""
    first, lines = common.pick(rows, rung=[*RUNGS][0], in_a_row=1), []
    known = common.pick(first, planner="baseline_tuned")
    for row in first if known else ():
        if row["planner"].startswith("policy"):
            fell = (np.isin(range(row["episodes"]), each["fell"]) for each in (row, known[0]))
            line = {"planner": row["planner"], "falls": row["falls"]}
            line["falls of baseline_tuned"] = known[0]["falls"]
            lines.append(line | evaluate.mcnemar(*fell))
    return lines


def table(found):
    """The learners on Pendulum, what PPO needs, and the rungs."""
    found = dict(found)
    if "pendulum" in found:
        lines = []
        for name in PENDULUM:
            last = last_returns(found["pendulum"]["rows"], name)
            line = {"learner": name, "return": np.mean(last), "worst": min(last), "best": max(last)}
            lines.append(line)
        found["pendulum"] = {"rows": lines}
    if "rungs" in found:
        rows = found["rungs"]["rows"]
        found["rungs"] = {"rows": with_means(rows)}
        if lines := falls_there(rows):
            found["falls on the first rung"] = {"rows": lines}
    return common.sections(found, COLUMNS)


def plot(found, sim):
    """What each learner's return does on Pendulum."""
    figure, axes = common.subplots(figsize=(8, 4.5))
    pendulum.draw_learners(axes, found["pendulum"]["rows"])
    for line in axes.lines:
        x, y = line.get_data()
        axes.text(1.01 * x[-1], y[-1], line.get_label(), color=line.get_color(), va="center")
    axes.set_xlim(0, 1.4 * x[-1])
    axes.set_xticks(range(0, 70, 10))
    axes.set_title("PPO swings up a pendulum: mean of five seeds, 95 % intervals")
    return figure


def plot_rungs(found, sim):
    """The mean times on every rung, by the paper's rule; text: the mean of the trainings."""
    figure, axes = common.subplots(figsize=(9, 3.4))
    rows = common.pick(found["rungs"]["rows"], in_a_row=1)
    for name, look in {"baseline": "|", "baseline_tuned": "D", "policy": "o"}.items():
        own = [row for row in rows if row["planner"].rstrip(" 012") == name]
        times, rungs = values(own, "time_mean"), values(own, "rung")
        color = "purple" if name == "policy" else "k"
        below = 0.25 * (name == "baseline_tuned")  # else it hides the circles
        heights = [[*RUNGS].index(rung) + below for rung in rungs]
        axes.plot(times, heights, look, color=color, label=name, fillstyle="none", ms=9, mew=2)
    for row in common.pick(with_means(rows), planner="policies, mean"):
        place = row["time_mean"], [*RUNGS].index(row["rung"])
        axes.annotate(f"{place[0]:.1f}", place, (0, 8), textcoords="offset points", ha="center")
    names = ["the paper's system", *(f"+ {rung}" for rung in [*RUNGS][1:])]
    axes.set_yticks(range(len(RUNGS)), names)
    axes.margins(y=0.1)
    axes.invert_yaxis()
    axes.set_xlim(0)
    axes.set_xlabel(
        "mean time to a near goal [s]; one double step there is enough (the paper's rule)"
    )
    axes.legend(loc="lower center")
    return figure


PICTURES = {"ladder": ("pendulum", plot), "ladder.rungs": ("rungs", plot_rungs)}


if __name__ == "__main__":
    common.start("ladder")
