"""Trainings and trials of the studies, kept so that nothing is done twice (see common.py).

The 500 near and 500 far goals of evaluation seed 110 (on the plane: 0) are those of README's table
(and of times.py); the studies use the seeds 1, 2, 3, … No training and no tuning ever sees them.
"""

import csv
from dataclasses import asdict, replace
from functools import partial
from importlib import import_module

import common
import numpy as np
from tqdm import tqdm

robot_model = import_module("01_robot_model")
env = import_module("03_env")
ppo = import_module("04_ppo")
evaluate = import_module("05_evaluate")

SEEDS = (0, 1, 2)  # of the trainings
FIRST = 1  # evaluation seed of the first set of goals
PER_SEED = 500  # goals in a set
TILTED = 0.25  # [rad] a pitch of the torso, in either direction, that announces a fall
# Told apart without red and green, and in grey (after Okabe and Ito).
COLORS = {"policy": "#0072b2", "policy_imu": "#cc79a7", "baseline": "#e69f00",
          "baseline_tuned": "#d55e00", "search": "#56b4e9"}
MARKERS = {"policy": "o", "policy_imu": "s", "baseline": "+", "baseline_tuned": "^", "search": "x"}


# ------------------------------------------------------------------------ trainings
FILES = ("policy.pt", "learning_curve.csv", "settings.txt")  # of a training that is shipped

def settings_of(sim, imu=False):
    """Ten letters that change when a training would be another one."""
    return common.digest(env.fingerprint(sim, imu), env.Task(), robot_model.RobotModel(),
                         robot_model.Spread(), ppo.PPOConfig(), ppo.STEPS)

def train(sim, seed, imu=False):
    """The folder of a training; made by the command that a user would give, unless it is there.

    If the very same training is shipped in results/, that one is taken.
    """
    made_of = settings_of(sim, imu)
    out = common.work(sim) / f"train{'_imu' * imu}_{seed}_{made_of}"
    picture = out / "learning_curve.png"  # the last file that a training writes
    if not picture.is_file():
        take_shipped(sim, seed, imu, out, made_of)
    if not picture.is_file():
        flags = ["--seed", str(seed), "--steps", str(ppo.STEPS), "--out", str(out)]
        flags += ["--mujoco"] * (sim == "mujoco") + ["--imu"] * imu
        flags += ["--resume"] * (out / "checkpoint.pt").is_file()
        print("python 04_ppo.py", *flags, flush=True)
        try:
            ppo.main(flags)
        except SystemExit as stop:  # it has said why
            if stop.code == 130:
                raise KeyboardInterrupt from stop
            raise
    common.write(out / "settings.txt", made_of + "\n")
    return out

def take_shipped(sim, seed, imu, out, made_of):
    """A training that is shipped, if it is of these settings, as if it had just been made."""
    folder = common.RESULTS / sim / ("imu" * imu) / "seeds" / str(seed)
    stamp = folder / "settings.txt"
    if stamp.is_file() and stamp.read_text(encoding="utf-8").strip() == made_of:
        for name in FILES:
            common.copy(folder / name, out / name)
        with open(out / "learning_curve.csv", encoding="utf-8", newline="") as file:
            curve = [{name: float(value) for name, value in row.items()}
                     for row in csv.DictReader(file)]
        ppo.plot_learning_curve(curve, out / "learning_curve.png", f"PPO on {sim}, seed {seed}")

def learn(out, cfg, make_envs, steps, seed, **more):
    """`ppo.train`, continued if it was interrupted."""
    resume = (out / "checkpoint.pt").is_file()
    try:
        return ppo.train(cfg, make_envs, out, steps, seed, resume=resume, **more)
    except (ppo.PolicyError, FloatingPointError) as error:
        raise common.StudyError(f"{out}: {error}") from error

def median_seed(rows):
    """The training seed in the middle: by success, then by time. Not the best one."""
    order = sorted(rows, key=lambda row: (row["success"], -(row["time_mean"] or np.inf)))
    return order[len(order) // 2]["seed"]

def to_ship(folders, median, prefix=""):
    """Findings.files: the median of the trainings, with its curve if it is the policy of the
    README, and all of them as evidence.
    """
    files = {f"{prefix}seeds/{seed}/{name}": folder / name
             for seed, folder in folders.items() for name in FILES}
    shown = ["policy.pt"] + ["learning_curve.csv", "learning_curve.png"] * (not prefix)
    return files | {prefix + name: folders[median] / name for name in shown}


# ------------------------------------------------------------------------ planners
def policy(path, sim):
    """The planner of a policy file, and what it depends on."""
    try:
        return evaluate.load(path, sim)[1], path.read_bytes()
    except ppo.PolicyError as error:
        raise common.StudyError(str(error)) from error

def baseline(settings):
    """The same of a baseline."""
    return evaluate.BaselinePlanner(settings), asdict(settings)

def opponents(sim):
    """The paper's baseline and what is shipped beside it, by name, each with what it depends on."""
    folder, found = common.RESULTS / sim, {"baseline": baseline(evaluate.BaselineSettings())}
    try:
        tuned = evaluate.load(folder / "baseline_tuned.json", sim)[1]
        search = evaluate.load(folder / "search.npz", sim)[1]
    except evaluate.InputError as error:
        raise common.StudyError(str(error)) from error
    file = (folder / "search.npz").read_bytes()
    return found | {"baseline_tuned": baseline(tuned.settings), "search": (search, file)}

def shipped(sim):
    """The shipped policies and their opponents."""
    files = {"policy": "policy.pt", "policy_imu": "imu/policy.pt"}
    paths = {name: common.RESULTS / sim / file for name, file in files.items()}
    if not paths["policy_imu"].is_file():
        del paths["policy_imu"]
    return {name: policy(path, sim) for name, path in paths.items()} | opponents(sim)

def shipped_seeds(sim):
    """The policy files of all training seeds, in lists by planner; with IMU only if shipped."""
    folder = common.RESULTS / sim
    found = {"policy": [folder / "seeds" / str(seed) / "policy.pt" for seed in SEEDS]}
    if (folder / "imu" / "policy.pt").is_file():
        found["policy_imu"] = [folder / "imu" / path.relative_to(folder)
                               for path in found["policy"]]
    return found


# ------------------------------------------------------------------------ trials
class Trials:
    """Runs planners on sets of 500 trials in one simulator, and remembers what came out.

    spread: how far the worlds may be from the model, None: as stage 1 says.
    """

    def __init__(self, sim, spread=robot_model.Spread(), robot=robot_model.RobotModel(),
                 cores=None):
        self.sim, self.spread, self.cores, self.robot = sim, spread, cores, robot
        self.world = None

    def run(self, planner, key, noise, first=FIRST, count=4, far=False, friction=np.nan, size=1.0,
            purpose="evaluation", per_seed=None):
        """Arrays [per_seed·count] as of `evaluate`, and what fell how (see `measure`).

        key: what the planner depends on; size: of the noise, relative to the task's.
        """
        parts, per_seed = [], per_seed or PER_SEED
        settings = noise, far, float(friction), size, purpose, per_seed
        for seed in range(first, first + count):
            name = common.digest(key, env.fingerprint(self.sim), self.spread, self.robot,
                                 env.Task(), settings)
            path = common.work(self.sim, "trials") / f"{name}_{seed}.npz"
            if not path.is_file():
                walked = self.measure(planner, seed, *settings)
                robot_model.atomic_write(path, partial(np.savez_compressed, **walked))
            with np.load(path) as stored:
                parts.append(dict(stored))
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def measure(self, planner, seed, noise, far, friction, size, purpose, per_seed):
        """One set. Beside what `evaluate` returns, for every fall [F, 8]: the goal seen from the
        robot before it (x, y, yaw), step length now and before [m], pitch before [rad], moment
        [share of the double step], μ; and how many double steps of a walk began TILTED [per_seed].
        """
        world, task = self.make_world(), env.Task()
        world.task = replace(task, noise_m=size * task.noise_m, noise_rad=size * task.noise_rad)
        trials = evaluate.draw_trials(seed, per_seed, far, friction, purpose)
        before, falls = trials.goals.copy(), [np.zeros((0, 8))]
        pitch = np.full(per_seed, world.engine.parameters.trunk_pitch)
        tilted = np.zeros(per_seed, int)

        def watch(robots, result):
            bar.update(sum(int(result[name].sum()) for name in evaluate.OUTCOMES))
            fell, motion = result["fall"], result["motion"]
            down = robot_model.fallen(motion.torso[fell], world.engine.stance[0][2])
            steps = env.to_footsteps(world.actions[robots[fell]], world.limits)  # [F, 2, 2, 3]
            falls.append(np.column_stack([
                before[robots[fell]], steps[..., 0].mean(-1), pitch[robots[fell]],
                np.argmax(down, 1) / down.shape[1], world.friction[robots[fell]]]))
            tilted[robots] += np.abs(pitch[robots]) > TILTED
            before[robots], pitch[robots] = world.relative_goal(robots), motion.torso[:, -1, 4]

        title = f"{type(planner).__name__}, trials {seed}"
        with tqdm(total=per_seed, desc=title, unit=" trials", leave=False) as bar:
            ended = evaluate.evaluate(planner, world, trials, noise, watch)
        return {**ended, "goals": trials.goals, "tilted": tilted, "falls": np.concatenate(falls)}

    def make_world(self):
        """The world, when the first trial needs it."""
        if self.world is None:
            self.world = env.FootstepWorld(PER_SEED, self.sim, cores=self.cores,
                                           robot=self.robot, spread=self.spread)
        return self.world

    def close(self):
        """Ends the simulator."""
        if self.world is not None:
            self.world.close()
        self.world = None

def row_of(trials, name, noise, far=False):
    """A row of stage 5's table."""
    task = env.Task()
    std = task.far_std_m if far else task.goal_std_m
    return evaluate.summary(name, noise, std, trials, task)

def time_ratio(trials, reference, name):
    """More of a row: time relative to another planner's, nothing without a common success."""
    ratio, interval, goals = evaluate.time_ratio(trials, reference)
    if not goals:
        return {}
    return {name: round(ratio, 4), f"{name}_ci95": [round(edge, 4) for edge in interval]}

def means(rows, names):
    """Means of some columns of rows, where there is something."""
    known = {name: [row[name] for row in rows if row.get(name) is not None] for name in names}
    return {name: np.mean(values) for name, values in known.items() if values}
