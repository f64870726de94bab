"""The studies behind README's claims; outside the reading path. One sub-command each:

    python tests/studies.py seeds        three trainings, 2,000 unseen goals each; ships the median
    python tests/studies.py imu          does feeling the torso's tilt prevent falls? 5,000 goals
    python tests/studies.py decision     mode or mean of the policy's distribution?
    python tests/studies.py budget       what a training of 300,000 double steps costs and gives
    python tests/studies.py falls        where falls happen, after which change of step, and when
    python tests/studies.py noise        success and time against the size of the noise
    python tests/studies.py times        time per goal, policy against baseline
    python tests/studies.py robustness   the same planners in a finer, slipperier or weaker world
    python tests/studies.py ablations    what is left without each ingredient of the learning

(all with `--mujoco` in 3-D). Each writes numbers (.json), README's table (.md) and most a figure
(.png) to results/<sim>/studies/. Trainings and trials are kept in runs/studies/<sim>/ under a name
made from every setting they depend on: an interrupted study continues, a repeated one is quick.
(Code is not part of the name: after changing it, delete the folder.)

The 500 goals of evaluation seed 0 are those of README's first tables (and of `times`); all others
use the seeds 1, 2, 3, …, 500 goals each. No training and no tuning ever sees any of them.
"""

import argparse
import csv
import hashlib
import json
import multiprocessing
import os
import shutil
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, replace
from importlib import import_module
from pathlib import Path

import numpy as np
from tqdm import tqdm

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
robot_model = import_module("01_robot_model")
env = import_module("03_env")
ppo = import_module("04_ppo")
evaluate = import_module("05_evaluate")
plt = evaluate.plt

SEEDS = (0, 1, 2)  # of the trainings
FIRST = 1  # evaluation seed of the first 500 goals; 0 belongs to README's table
PER_SEED = 500  # goals
BUDGET = 300_000  # double steps of the shorter training
COLORS = {"policy": "tab:blue", "policy_imu": "tab:purple", "baseline": "tab:orange",
          "baseline_tuned": "tab:green"}  # fmt: skip


# ---------------------------------------------------------------- work that is kept
def store(sim):
    folder = ROOT / "runs" / "studies" / sim
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def digest(*ingredients):
    """Ten letters that change when anything changes that a result depends on."""
    return hashlib.sha256(repr(ingredients).encode()).hexdigest()[:10]


def train(sim, seed, imu=False, steps=ppo.STEPS):
    """The command a user would give, unless its policy is there already; returns its folder."""
    out = store(sim) / f"train_imu{seed}_" if imu else store(sim) / f"train{seed}_"
    made_for = env.fingerprint(sim, imu), env.Task(), robot_model.RobotModel()
    out = out.with_name(out.name + digest(*made_for, ppo.PPOConfig(), steps))
    if not (out / "policy.pt").is_file():
        resume = ["--resume"] if (out / "checkpoint.pt").is_file() else []
        flags = ["--mujoco"] * (sim == "mujoco") + ["--imu"] * imu + resume
        options = {"--steps": steps, "--seed": seed, "--out": out}
        flags += [str(part) for option in options.items() for part in option]
        command = [sys.executable, "04_ppo.py", *flags]
        print(" ".join(["python", *command[1:]]))
        subprocess.run(command, cwd=ROOT, check=True)
    return out


class Trials:
    """Runs planners on goals in one simulator, and remembers what came out."""

    def __init__(self, sim, robot=robot_model.RobotModel(), cores=None):
        self.sim, self.robot, self.cores, self.world = sim, robot, cores, None

    def run(self, title, planner, key, noise, first=FIRST, count=4, size=1.0):
        """`count` sets of 500 goals; arrays [500·count] as of `evaluate`, and what fell how.

        key: what the planner depends on; size: of the noise, relative to the task's.
        """
        parts = []
        for seed in range(first, first + count):
            name = digest(key, env.fingerprint(self.sim), self.robot, env.Task(), noise, size)
            folder = store(self.sim) / "trials"
            path = next(folder.glob(f"*_{seed}_{name}.npz"), folder / f"{title}_{seed}_{name}.npz")
            if not path.is_file():
                self.measure(path, planner, noise, seed, size)
            with np.load(path) as stored:
                parts.append({key: stored[key] for key in stored.files})
        return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}

    def measure(self, path, planner, noise, seed, size):
        if self.world is None:
            self.world = env.FootstepWorld(PER_SEED, self.sim, robot=self.robot, cores=self.cores)
        world, task = self.world, env.Task()
        world.task = replace(task, noise_m=size * task.noise_m, noise_rad=size * task.noise_rad)
        goals = env.draw_goals(env.stream("evaluation", seed), PER_SEED)
        before, falls, changes = goals.copy(), [], []

        def watch(robots, result):
            count(robots, result)
            length = world.actions[robots][:, :, [0, 3]].mean(-1)  # [n, 2] x of both feet, 0 … 1
            low, high = world.limits.low[0], world.limits.high[0]
            length = low + length * (high - low)  # [m] now, before
            sample = (robots % 20 == 0) & ~result["fall"]  # steps that went well
            changes.append(length[sample])
            torso = result["motion"].torso
            tilt = np.cos(torso[..., 3]) * np.cos(torso[..., 4])
            down = robot_model.fallen(torso[..., 2], tilt, world.sim.standing_height)  # [n, T]
            for row in np.flatnonzero(result["fall"]):
                when = np.argmax(down[row]) / down.shape[1]  # [-] share of the double step
                falls.append([*before[robots[row]], *length[row], when])
            before[robots] = world.relative_goal(robots)

        with tqdm(total=PER_SEED, desc=path.stem, unit=" trials", leave=False) as bar:
            count = evaluate.progress(bar)
            trials = evaluate.evaluate(planner, world, goals, seed, noise, watch)
        trials |= {"goals": goals, "falls": np.reshape(falls, (-1, 6)),
                   "changes": np.concatenate(changes)}  # fmt: skip
        path.parent.mkdir(exist_ok=True)
        temporary = path.with_suffix(".tmp.npz")
        np.savez_compressed(temporary, **trials)
        os.replace(temporary, path)

    def close(self):
        if self.world is not None:
            self.world.close()
        self.world = None


class SharePlanner(evaluate.PolicyPlanner):
    """A policy that decides between its mode (share 0) and its mean (share 1)."""

    def __init__(self, model, imu, share):
        super().__init__(model, imu)
        self.share = share

    def act(self, world, robots, measured):
        world.imu = self.imu
        with ppo.torch.no_grad():
            observations = ppo.torch.as_tensor(world.observe(robots, measured))
            return ppo.beta_decision(*self.model.policy(observations), self.share).numpy()


def policy_trials(trials, path, title, noise, share=ppo.MEAN_SHARE, **more):
    """Trials of a policy file."""
    planner, _ = evaluate.load_planner(path, trials.sim)
    if share != ppo.MEAN_SHARE:
        planner = SharePlanner(planner.model, planner.imu, share)
    return trials.run(title, planner, (path.read_bytes(), share), noise, **more)


def shipped(sim):
    """The shipped planners by name, with what each depends on."""
    folder = ROOT / "results" / sim
    found = {}
    for name, file in (("policy", "policy.pt"), ("policy_imu", "imu/policy.pt")):
        if (folder / file).is_file():
            planner = evaluate.load_planner(folder / file, sim)[0]
            found[name] = planner, ((folder / file).read_bytes(), ppo.MEAN_SHARE)
    settings = {"baseline": evaluate.BaselineSettings()}
    tuned = folder / "baseline_tuned.json"
    if tuned.is_file():
        best = json.loads(tuned.read_text(encoding="utf-8"))
        settings["baseline_tuned"] = settings["baseline"].tuned(
            best["factor"], best["turning_gain"]
        )
    for name, setting in settings.items():
        found[name] = evaluate.BaselinePlanner(setting), asdict(setting)
    return found


def row_of(trials, name, noise):
    return evaluate.summary(name, noise, trials, env.Task())


def median_seed(rows):
    """The training seed in the middle: by success, then by time. Not the best one."""
    order = sorted(rows, key=lambda row: (row["success"], -row["time_mean"]))
    return order[len(order) // 2]["seed"]


def keep(folders, median, results):
    """Ships the median of the trainings, and all of them as evidence."""
    for seed, folder in folders.items():
        target = results / "seeds" / str(seed)
        target.mkdir(parents=True, exist_ok=True)
        for name in ("policy.pt", "learning_curve.csv"):
            shutil.copyfile(folder / name, target / name)
    for name in ("policy.pt", "learning_curve.csv", "learning_curve.png"):
        shutil.copyfile(folders[median] / name, results / name)


# ---------------------------------------------------------------- output
def markdown(head, rows):
    """A table in Markdown, columns aligned."""
    cells = [tuple(head), ("---",) * len(head), *[tuple(map(str, row)) for row in rows]]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "\n".join("| " + " | ".join(map(str.ljust, c, widths)) + " |" for c in cells) + "\n"


def publish(sim, name, content, text, figure=None):
    """Writes a study's numbers, table and figure."""
    folder = ROOT / "results" / sim / "studies"
    folder.mkdir(parents=True, exist_ok=True)
    evaluate.write_json(folder / f"{name}.json", content)
    evaluate.write_text(folder / f"{name}.md", text)
    if figure is not None:
        path = folder / f"{name}.png"
        ppo.atomic_write(path, lambda temporary: figure.savefig(temporary, dpi=110, format="png"))
        plt.close(figure)
    print(f"\n{text}\nwritten: {(folder / name).relative_to(ROOT).as_posix()}.*")


def yes(noise):
    return "yes" if noise else "no"


# ---------------------------------------------------------------- the studies
def seeds(sim):
    """Three trainings, judged on the same 2,000 goals; the median one becomes the shipped one."""
    results = ROOT / "results" / sim
    folders = {seed: train(sim, seed) for seed in SEEDS}
    trials = Trials(sim)
    others = {k: v for k, v in shipped(sim).items() if k.startswith("baseline")}
    rows, references = [], {}
    for noise in (False, True):
        for name, (planner, key) in others.items():
            references[name, noise] = trials.run(name, planner, key, noise)
            rows.append({"seed": None, **row_of(references[name, noise], name, noise)})
        for seed, folder in folders.items():
            own = policy_trials(trials, folder / "policy.pt", f"policy{seed}", noise)
            row = {"seed": seed, **row_of(own, "policy", noise)}
            for name in others:
                ratio, interval, _ = evaluate.time_ratio(own, references[name, noise])
                row[f"over_{name}"] = round(ratio, 4)
                row[f"over_{name}_ci95"] = [round(bound, 4) for bound in interval]
            rows.append(row)
    trials.close()
    mine = [row for row in rows if row["seed"] is not None]
    median = median_seed([row for row in mine if row["noise"]])
    keep(folders, median, results)
    keys = ["success", "fall", "timeout", "stays_up", "time_mean", *(f"over_{k}" for k in others)]
    digits = [4, 4, 4, 4, 2, 3, 3]
    lines = []

    def cells(row):
        return [f"{row[key]:.{n}f}" if key in row else "" for key, n in zip(keys, digits)]

    for noise in (False, True):
        chosen = [row for row in mine if row["noise"] == noise]
        for row in chosen:
            label = f"{row['seed']}" + " (shipped)" * (row["seed"] == median)
            lines.append([yes(noise), label, *cells(row)])
        mean = {key: np.mean([row[key] for row in chosen]) for key in keys}
        lines.append([yes(noise), "mean", *cells(mean)])
        for name in others:
            row = next(r for r in rows if r["planner"] == name and r["noise"] == noise)
            lines.append([yes(noise), name, *cells(row)])
    head = ["noise", "training seed", "success", "fall", "timeout", "still up", "time [s]",
            *(f"÷ {name}" for name in others)]  # fmt: skip
    content = {"goals": 4 * PER_SEED, "median_seed": median, "rows": rows}
    publish(sim, "seeds", content, markdown(head, lines), plot_seeds(folders, sim))


def read_curve(folder):
    """The columns of a learning curve, arrays [U] by name."""
    with open(folder / "learning_curve.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}


def smooth(values, window=8):
    """Mean of the last values, skipping nan."""
    return np.array([np.nanmean(values[max(0, i + 1 - window) : i + 1])
                     for i in range(len(values))])  # fmt: skip


def plot_seeds(folders, sim):
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
    panels = (("success", "share of episodes [1]"), ("fall", "share of episodes [1]"),
              ("time", "simulated time of successes [s]"))  # fmt: skip
    for axis, (key, label) in zip(axes, panels, strict=True):
        curves = []
        for seed, folder in folders.items():
            curve = read_curve(folder)
            curves.append(smooth(curve[key]))
            axis.plot(curve["steps"] / 1000, curves[-1], lw=1.2, label=f"seed {seed}")
        low, high = np.min(curves, 0), np.max(curves, 0)
        axis.fill_between(curve["steps"] / 1000, low, high, color="0.85", zorder=0)
        axis.set(title=key, ylabel=label, xlabel="double steps of all robots [thousands]")
        axis.grid(alpha=0.3)
    axes[2].set_ylim(0, 2.5 * np.nanmedian(curves))
    axes[0].legend()
    figure.suptitle(f"Three trainings while exploring ({sim}); grey: their spread")
    return figure


def imu(sim):
    """Three policies that feel their torso's tilt against three that do not: 5,000 noisy goals."""
    results = ROOT / "results" / sim
    folders = {seed: train(sim, seed, imu=True) for seed in SEEDS}
    trials, rows, lines = Trials(sim), [], []
    for seed, folder in folders.items():
        paths = results / "seeds" / str(seed) / "policy.pt", folder / "policy.pt"
        plain, with_imu = (policy_trials(trials, path, f"{name}{seed}", True, count=10)
                           for name, path in zip(("policy", "policy_imu"), paths))  # fmt: skip
        ratio, interval, _ = evaluate.time_ratio(with_imu, plain)
        rows.append({"seed": seed, **row_of(plain, "policy", True)})
        rows.append({"seed": seed, **row_of(with_imu, "policy_imu", True),
                     "time_ratio": ratio, "time_ratio_ci95": interval})  # fmt: skip
    trials.close()
    published = (results / "studies" / "seeds.json").read_text(encoding="utf-8")
    chosen = {"policy": json.loads(published)["median_seed"],
              "policy_imu": median_seed([r for r in rows if r["planner"] == "policy_imu"])}
    keep(folders, chosen["policy_imu"], results / "imu")
    means, keys = [], ("success", "fall", "timeout", "time_mean", "time_ratio")
    for name in ("policy", "policy_imu"):
        own = [row for row in rows if row["planner"] == name]
        means.append({"planner": name, **{k: np.mean([r[k] for r in own]) for k in keys
                                          if k in own[0]}})  # fmt: skip
        for row in [*own, means[-1]]:
            label = str(row.get("seed", "mean")) + " (shipped)" * (row.get("seed") == chosen[name])
            fall = f"{row['fall']:.4f}"
            if "fall_ci95" in row:
                fall += " [{:.4f}, {:.4f}]".format(*row["fall_ci95"])
            faster = f"{row['time_ratio']:.3f}" if "time_ratio" in row else ""
            if "time_ratio_ci95" in row:
                faster += " [{:.3f}, {:.3f}]".format(*row["time_ratio_ci95"])
            lines.append([name, label, f"{row['success']:.4f}", fall, f"{row['timeout']:.4f}",
                          f"{row['time_mean']:.2f}", faster])  # fmt: skip
    head = ["planner", "training seed", "success", "fall [95 % interval]", "timeout", "time [s]",
            "time ÷ that of `policy`, same seed"]  # fmt: skip
    publish(sim, "imu", {"goals": 10 * PER_SEED, "median_seed": chosen["policy_imu"], "rows": rows,
                         "means": means}, markdown(head, lines))  # fmt: skip


def decision(sim):
    """Mode, mean, or half-way: falls and time of all seeds, 1,000 noisy goals."""
    results, trials, rows, lines = ROOT / "results" / sim, Trials(sim), [], []
    for name, folder in (("policy", results / "seeds"), ("policy_imu", results / "imu" / "seeds")):
        for rule, share in (
            ("mode (paper)", 0.0), ("half-way (ours)", ppo.MEAN_SHARE), ("mean", 1.0)
        ):
            own = []
            for seed in SEEDS:
                path = folder / str(seed) / "policy.pt"
                trial = policy_trials(trials, path, f"{name}{seed}", True, share, count=2)
                own.append({"rule": rule, "seed": seed, **row_of(trial, name, True)})
            rows += own
            lines.append([name, rule, spread([r["success"] for r in own], 4),
                          spread([r["fall"] for r in own], 4),
                          spread([r["time_mean"] for r in own], 2)])  # fmt: skip
    trials.close()
    head = ["planner", "decides by", "success", "fall", "time [s]"]
    publish(sim, "decision", {"goals": 2 * PER_SEED, "rows": rows}, markdown(head, lines))


def budget(sim):
    """What 300,000 double steps cost and give: the final policy on 1,000 goals, no noise."""
    folder = train(sim, SEEDS[0], steps=BUDGET)
    trials = Trials(sim)
    row = row_of(policy_trials(trials, folder / "policy.pt", "budget", False, count=2),
                 "policy", False)  # fmt: skip
    trials.close()
    curve = read_curve(folder)
    row |= {"minutes": round(curve["minutes"][-1], 2), "cores": robot_model.CORES,
            "learning_ms": round(curve["learning_ms"].mean(), 4)}  # fmt: skip
    success = "{:.3f} [{:.3f}, {:.3f}]".format(row["success"], *row["success_ci95"])
    line = [sim, f"{BUDGET:,}", f"{row['minutes']:.1f}", f"{row['learning_ms']:.3f}", success,
            f"{row['time_mean']:.2f}"]  # fmt: skip
    head = ["simulator", "double steps", f"minutes on {robot_model.CORES} cores",
            "learning [ms per double step]", "success [95 % interval]", "time [s]"]  # fmt: skip
    publish(sim, "budget", row, markdown(head, [line]))


def falls(sim):
    """Every fall of all seeds on 5,000 noisy goals: the goal then, change of step, moment."""
    trials, found, text = Trials(sim), {}, []
    results = ROOT / "results" / sim
    policies = {"policy": results / "seeds", "policy_imu": results / "imu" / "seeds"}
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.9), layout="constrained")
    for name, folder in policies.items():
        parts = [policy_trials(trials, folder / str(seed) / "policy.pt", f"{name}{seed}", True,
                               count=10) for seed in SEEDS]  # fmt: skip
        own = {key: np.concatenate([part[key] for part in parts])
               for key in ("falls", "changes", "time")}  # fmt: skip
        x, y, _, now, last, when = own["falls"].T
        found[name] = own["falls"].round(4).tolist()
        kw = {"color": COLORS[name], "label": f"{name}: {len(x)} falls", "s": 14, "zorder": 3}
        axes[0].scatter(x, y, **kw)
        axes[1].scatter(last, now, **kw)
        axes[2].hist(when, np.linspace(0, 1, 15), color=COLORS[name], alpha=0.6)
        if name == "policy":
            axes[1].plot(own["changes"][:, 1], own["changes"][:, 0], ".", color="0.8", ms=2,
                         zorder=0, label="steps that went well")  # fmt: skip
        back = np.mean(now < 0) if len(x) else 0.0
        change = np.mean(np.abs(now - last)) if len(x) else 0.0
        usual = np.abs(np.diff(own["changes"], axis=1)).mean()
        left = np.mean(when < 0.5) if len(x) else 0.0
        text.append([name, len(own["time"]), len(x),
                     f"{back:.2f} / {np.mean(own['changes'][:, 0] < 0):.2f}",
                     f"{100 * change:.1f} / {100 * usual:.1f}", f"{left:.2f} / 0.50"])  # fmt: skip
    trials.close()
    axes[0].add_patch(plt.Circle((0, 0), 0.4, fill=False, ec="0.5", ls=":"))
    axes[0].plot(0, 0, "k>", ms=8)
    axes[0].set(title="goal, seen from the robot before the step", xlabel="ahead [m]",
                ylabel="left [m]", aspect="equal", xlim=(-2, 2), ylim=(-2, 2))  # fmt: skip
    axes[1].set(title="forward step length", xlabel="of the step before [m]",
                ylabel="of the step of the fall [m]", aspect="equal")  # fmt: skip
    axes[2].set(title="moment of the fall", xlabel="share of the double step: left swing, right",
                ylabel="falls", xlim=(0, 1))  # fmt: skip
    axes[2].axvline(0.5, color="0.5", lw=1)
    axes[1].legend(fontsize=7)
    axes[0].legend(fontsize=7)
    head = ["planner", "noisy walks", "falls", "walking backward, falls / all steps",
            "change of step length, falls / all steps [cm]",
            "while the left foot swings, falls / all steps"]  # fmt: skip
    figure.suptitle(f"Where, after what and when the robot falls ({sim}, noise)")
    publish(sim, "falls", {"columns": "goal x, y, yaw; step length, the one before; moment",
                           "falls": found}, markdown(head, text), figure)  # fmt: skip


def noise(sim):
    """Success and time of every planner while the measured goal gets worse."""
    sizes, trials, rows = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0), Trials(sim), []
    for name, (planner, key) in shipped(sim).items():
        for size in sizes:
            own = trials.run(name, planner, key, True, count=1, size=size)
            rows.append({"size": size, **row_of(own, name, True)})
    trials.close()
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained", sharex=True)
    names = list(dict.fromkeys(row["planner"] for row in rows))
    for shift, name in enumerate(names):
        own = [row for row in rows if row["planner"] == name]
        x = np.array([row["size"] for row in own]) * env.Task().noise_m * 100 + 0.1 * shift
        for axis, key in zip(axes, ("success", "fall", "time_mean"), strict=True):
            y = np.array([row[key] if row[key] is not None else np.nan for row in own])
            axis.plot(x, y, ".-", color=COLORS[name], label=name)
            if f"{key}_ci95" in own[0]:
                bounds = np.transpose([row[f"{key}_ci95"] for row in own])
                axis.vlines(x, *bounds, color=COLORS[name], alpha=0.4, lw=1)
    axes[0].set(title="success", ylabel="share of 500 goals [1]")
    axes[1].set(title="fall", ylabel="share of 500 goals [1]")
    axes[2].set(title="time of successes", ylabel="mean [s]", ylim=(0, None))
    for axis in axes:
        axis.set(xlabel="noise of x and y [cm], of yaw [0.01 rad]")
        axis.grid(alpha=0.3)
    axes[0].legend(fontsize=8)
    figure.suptitle(f"The worse the robot knows its goal ({sim}; 5 cm is the task's noise; "
                    "lines: 95 % intervals)")
    lines = [[f"{100 * size * env.Task().noise_m:.1f}", *(
        "{success:.3f} / {fall:.3f} / {time:.1f}".format(**r, time=r["time_mean"] or np.nan)
        for name in names for r in rows if (r["planner"], r["size"]) == (name, size)
    )] for size in sizes]  # fmt: skip
    head = ["noise [cm, 0.01 rad]", *(f"{name}: success / fall / time [s]" for name in names)]
    publish(sim, "noise", {"goals": PER_SEED, "rows": rows}, markdown(head, lines), figure)


def times(sim):
    """Time per goal, policy against the baselines, from the trials behind README's first table."""
    path = ROOT / "results" / sim / "trials.csv"
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    facts = json.loads((path.parent / "evaluation.json").read_text(encoding="utf-8"))
    by = {}
    for row in rows:
        by.setdefault((row["planner"], row["noise"]), []).append(row)
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.4), layout="constrained", sharey=True)
    lines, content = [], []
    goals = np.array([[float(r[k]) for k in ("x", "y", "yaw")] for r in by["policy", "no"]])
    distance = np.hypot(*goals[:, :2].T)  # [m]
    engine = env.walk_engine.WalkEngine(1, env.walk_engine.TUNED[sim])
    bound = evaluate.lower_bound(goals, facts["fastest_speed"], engine.period, env.Task())
    for axis, noisy in zip(axes, ("no", "yes"), strict=True):
        order = np.argsort(distance)
        axis.plot(distance[order], bound[order], "k", lw=1.5, zorder=3, label="lower bound")
        for name in COLORS:
            if (name, noisy) not in by:
                continue
            own = by[name, noisy]
            time = np.array([float(r["time"]) if r["outcome"] == "success" else np.nan
                             for r in own])  # fmt: skip
            axis.plot(distance, time, ".", ms=3, color=COLORS[name], label=name)
            if name.startswith("baseline"):
                policy = np.array([float(r["time"]) if r["outcome"] == "success" else np.nan
                                   for r in by["policy", noisy]])  # fmt: skip
                ratio = policy / time
                ratio = ratio[np.isfinite(ratio)]
                low, middle, high = np.percentile(ratio, [10, 50, 90])
                slower = np.mean(ratio > 1)
                lines.append([noisy, name, f"{low:.2f}", f"{middle:.2f}", f"{high:.2f}",
                              f"{slower:.3f}"])  # fmt: skip
                content.append({"noise": noisy, "reference": name, "p10": round(low, 4),
                                "median": round(middle, 4), "p90": round(high, 4),
                                "policy_slower": round(float(slower), 4)})  # fmt: skip
        axis.set(title=f"{'with' if noisy == 'yes' else 'without'} noise",
                 xlabel="distance to the goal at the start [m]")  # fmt: skip
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("time to the goal [s]")
    axes[0].legend(fontsize=8, markerscale=3)
    figure.suptitle(f"Every dot is a goal reached ({sim})")
    head = ["noise", "policy's time ÷ that of", "10th percentile", "median", "90th percentile",
            "share of goals where the policy is slower"]  # fmt: skip
    publish(sim, "times", content, markdown(head, lines), figure)


def robustness(sim):
    """Policy and tuned baseline in worlds they were not made for; no noise, 500 goals."""
    model = robot_model.RobotModel()
    dt, control = model.physics_dt, model.control_dt
    worlds = {
        "as trained": {},
        "half the time step": {"physics_dt": dt / 2},
        # (on the plane a double step then takes 0.55 s instead of 0.56 s: whole ticks)
        "half the time step and control tick": {"physics_dt": dt / 2, "control_dt": control / 2},
        "friction 0.4": {"friction": 0.4},
        "friction 0.7": {"friction": 0.7},
        "2/3 of the motors' stiffness": {"stiffness": model.stiffness * 2 / 3,
                                         "planar_gain": model.planar_gain * 2 / 3},
    }  # fmt: skip
    worlds |= {"elliptic friction cone": {"friction_cone": "elliptic"}} if sim == "mujoco" else {
        "twice the solver's iterations": {"planar_iterations": 2 * model.planar_iterations}}
    planners = {k: v for k, v in shipped(sim).items() if k in ("policy", "baseline_tuned")}
    rows, lines = [], []
    for title, change in worlds.items():
        trials, line = Trials(sim, replace(model, **change)), [title]
        for name, (planner, key) in planners.items():
            own = trials.run(name, planner, key, False, count=1)
            row = row_of(own, name, False)
            rows.append({"world": title, "change": change, **row})
            line += ["{:.3f} [{:.3f}, {:.3f}]".format(row["success"], *row["success_ci95"]),
                     f"{row['time_mean']:.2f}"]  # fmt: skip
        trials.close()
        lines.append(line)
    head = ["world", *(f"{name}: {what}" for name in planners
                       for what in ("success [95 % interval]", "time [s]"))]  # fmt: skip
    publish(sim, "robustness", rows, markdown(head, lines))


# ---------------------------------------------------------------- ablations
STEPS = 100_000
VARIANTS = {  # name: what differs from the reference
    "reference": {},
    "Gaussian policy, clipped": {"config": {"distribution": "gaussian"}},
    # α = β = 1 + ln 2, what zero biases of the network's last layer would give
    "first policy: broad": {"config": {"first_concentration": 2 + 2 * float(np.log(2))},
                            "centre": True},
    "one previous action": {"hide": True},
    "with IMU": {"imu": True},
    "trained without noise": {"noise": False},
    **{f"without r_{k}": {"task": {f"s_{k}": 0.0}}
       for k in ("d", "a", "o", "c", "fall", "goal", "time")},
}  # fmt: skip
LATER = slice(len(env.GOAL_TABLE) + 6, len(env.GOAL_TABLE) + 12)  # the action before the last one


class HiddenEnv(env.FootstepVectorEnv):
    """The observation without the action before the last one."""

    def reset(self, **kw):
        observations, info = super().reset(**kw)
        observations[:, LATER] = 0
        return observations, info

    def step(self, actions):
        observations, *rest, infos = super().step(actions)
        observations[:, LATER] = 0
        if "final_obs" in infos:
            infos["final_obs"][:, LATER] = 0
        return observations, *rest, infos


class HiddenPlanner(evaluate.PolicyPlanner):
    """The policy to it."""

    def act(self, world, robots, measured):
        world.imu = self.imu
        observations = world.observe(robots, measured)
        observations[:, LATER] = 0
        return self.model.decide(observations)


def ablate(sim, name, seed):
    """One training of STEPS double steps on one core, and 500 noisy goals; cached."""
    variant = VARIANTS[name]
    cfg = ppo.PPOConfig(**variant.get("config", {}))
    task = replace(env.Task(), **variant.get("task", {}))
    use_imu, hide = variant.get("imu", False), variant.get("hide", False)
    # A resumable folder per training; PPO's own file says what it was made for.
    key = digest(robot_model.RobotModel(), env.fingerprint(sim, use_imu), task, cfg, variant, STEPS)
    out = store(sim) / "ablations" / f"{''.join(c for c in name if c.isalnum())}_{seed}_{key}"
    result = out / "result.json"
    if result.is_file():
        return json.loads(result.read_text(encoding="utf-8"))

    def make_envs(num_envs):
        kind = HiddenEnv if hide else env.FootstepVectorEnv
        envs = kind(num_envs, sim, variant.get("noise", True), use_imu, task=task, cores=1)
        if variant.get("centre"):
            envs.neutral_action = 0.5
        return envs

    resume = (out / "checkpoint.pt").is_file()
    model, rows = ppo.train(cfg, make_envs, out, STEPS, seed, resume,
                            env.fingerprint(sim, use_imu), progress=False)  # fmt: skip
    planner = (HiddenPlanner if hide else evaluate.PolicyPlanner)(model, use_imu)
    goals = env.draw_goals(env.stream("evaluation", FIRST), PER_SEED)
    world = env.FootstepWorld(PER_SEED, sim, cores=1)
    trials = evaluate.evaluate(planner, world, goals, FIRST, noise=True)
    world.close()
    row = {"variant": name, "seed": seed, **row_of(trials, "policy", True),
           "curve": [[r["steps"], None if np.isnan(r["success"]) else round(r["success"], 4)]
                     for r in rows]}  # fmt: skip
    evaluate.write_json(result, row)
    return row


def learned_after(curve, share=0.8):
    """Thousands of double steps until that share of the training's episodes succeeds, or None."""
    steps, success = np.transpose([[x, y or 0.0] for x, y in curve])
    reached = np.flatnonzero(smooth(success, 3) >= share)
    return float(steps[reached[0]]) / 1000 if len(reached) else None


def spread(values, digits):
    """Mean (least … most) of the values that exist, as text."""
    known = [value for value in values if value is not None]
    if not known:
        return "never"
    text = f"{np.mean(known):.{digits}f} ({min(known):.{digits}f} … {max(known):.{digits}f})"
    return text + f", {len(values) - len(known)} never" * (len(known) < len(values))


def ablations(sim):
    """Three seeds of every variant, one core each, as many at a time as there are cores."""
    jobs = [(sim, name, seed) for name in VARIANTS for seed in SEEDS]
    rows = []
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(robot_model.CORES, mp_context=context) as pool:
        for row in tqdm(pool.map(ablate, *zip(*jobs, strict=True)), total=len(jobs)):
            rows.append(row)
    for row in rows:
        row["learned_after"] = learned_after(row["curve"])
    figure, axes = plt.subplots(1, 3, figsize=(13, 5), layout="constrained", sharey=True)
    lines = []
    for place, name in enumerate(VARIANTS):
        own = [row for row in rows if row["variant"] == name]
        color = "k" if name == "reference" else "tab:blue"
        for axis, key in zip(axes, ("success", "time_mean", "learned_after"), strict=True):
            values = [row[key] for row in own if row[key] is not None]
            axis.plot(values, [place] * len(values), "o", color=color, alpha=0.6)
            if values:
                axis.plot(np.mean(values), place, "|", color=color, ms=18)
        lines.append([name, *(spread([row[key] for row in own], digits) for key, digits in (
            ("success", 3), ("fall", 3), ("timeout", 3), ("time_mean", 1), ("learned_after", 0)))])
    axes[0].set(yticks=range(len(VARIANTS)), yticklabels=VARIANTS, title="success",
                xlabel="share of 500 goals [1]")  # fmt: skip
    axes[1].set(title="time of the successes", xlabel="mean [s]")
    axes[2].set(title="first success in 80 % of the episodes",
                xlabel="double steps of training [thousands]")  # fmt: skip
    axes[0].invert_yaxis()
    for axis in axes:
        axis.grid(alpha=0.3)
    figure.suptitle(f"{STEPS:,} double steps of training ({sim}); dots: three seeds, bar: their "
                    "mean; no dot: never")  # fmt: skip
    head = ["variant", "success", "fall", "timeout", "time [s]", "80 % after [1,000 steps]"]
    publish(sim, "ablations", {"steps": STEPS, "goals": PER_SEED, "rows": rows},
            markdown(head, lines), figure)  # fmt: skip


STUDIES = {f.__name__: f for f in (seeds, imu, decision, budget, falls, noise, times, robustness,
                                   ablations)}


def main():
    """See the head of this file."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = robot_model.StageParser(description=__doc__, formatter_class=raw)
    parser.add_argument("study", choices=STUDIES)
    parser.add_argument("--mujoco", action="store_true", help="3-D simulator instead of pymunk")
    args = parser.parse_args()
    try:
        STUDIES[args.study]("mujoco" if args.mujoco else "pymunk")
    except KeyboardInterrupt:
        print("\ninterrupted: the same command continues", file=sys.stderr)
        sys.exit(130)
    except (evaluate.InputError, ppo.PolicyError, OSError, KeyError,
            subprocess.CalledProcessError) as error:
        parser.error(f"{error} (run `studies.py seeds` and `05_evaluate.py` first?)")


if __name__ == "__main__":  # the simulator's worker processes import this file again
    main()
