"""Can more machines teach one policy? Ray actors simulate the robots; stage 4 is not changed.

    python -m pip install ray==2.60.0
    python tests/studies/cluster.py --mujoco --steps 250000 --seed 0 --out runs/cluster
    python tests/studies/cluster.py --mujoco --evaluate runs/cluster/policy.pt --out runs/cluster
    python tests/studies/cluster.py --mujoco --only speed       what Ray costs

An actor is an object in a process of its own, on any machine of a Ray cluster. Calls of its methods
travel there, and results come back. Here each actor simulates a part of the robots. `Cluster` talks
to all actors, and to stage 4 it looks like a `FootstepVectorEnv`. Every robot has a random
generator of its own, so it does not matter where it is simulated: the policy is the same, bit for
bit.

Without --address Ray starts on this machine, for this run only. For several machines, which need
the same versions of Python and of the packages (Ray copies our code to them):

    export RAY_AUTH_MODE=token          on all of them: only those with the token may run code there
    ray get-auth-token --generate       on the first one; copy ~/.ray/auth_token to the others
    ray start --head --port 6379        on the first one, which prints its ADDRESS
    ray start --address ADDRESS:6379    on every other one
    python tests/studies/cluster.py --mujoco --address ADDRESS:6379 --actors 16 --out runs/cluster
    ray stop                            on each of them, at the end
"""

import sys
import time
from contextlib import closing
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path

import common
import gymnasium as gym
import numpy as np
from common import ROOT, env, evaluate, ppo, robot_model

DURATION = "a training takes as long as in stage 4; --only speed: 2 minutes"
TOLD = "success", "fall", "timeout", "time"  # what stage 4 asks of an ended episode
BLOCK = 250  # trials that a process walks at a time
SHORT = 8_192  # double steps, to compare and to measure the speed


class Part:
    """Some of the robots, in a process anywhere."""

    def __init__(self, count, settings):
        self.envs = env.FootstepVectorEnv(count, cores=1, **settings)

    def reset(self, seeds, less):
        """less [count]: double steps that the first episodes are shorter (`staggered`)."""
        observations, _ = self.envs.reset(seed=int(seeds[0]))
        self.envs.world.allowed -= less * self.envs.world.engine.period_ticks
        return observations

    def step(self, actions):
        """What `FootstepVectorEnv.step` returns, and of its infos those that training needs."""
        *result, infos = self.envs.step(actions)  # observations, reward, terminated, truncated
        last = infos.get("final_obs", result[0])
        return *result, last, *(infos[name] for name in TOLD)


class Cluster(gym.vector.VectorEnv):
    """N robots shared among some actors; it returns what a staggered `FootstepVectorEnv` does."""

    metadata = env.FootstepVectorEnv.metadata

    def __init__(self, num_envs, actors, **settings):
        import ray

        with closing(env.FootstepVectorEnv(1, cores=1, **settings)) as one:
            self.world = one.world  # stage 4 stores its settings
            self.neutral_action = one.neutral_action
            self.single_observation_space = one.single_observation_space
            self.single_action_space = one.single_action_space
        self.num_envs = num_envs
        remote = ray.remote(num_cpus=1)(Part)
        shares = np.array_split(np.arange(num_envs), min(actors, num_envs))
        self.parts = [remote.remote(len(share), settings) for share in shares]

    def ask(self, method, *arrays):
        """The answers of all actors, which work at the same time. Each gets its robots' part of the
        arrays.
        """
        import ray

        shares = zip(*(np.array_split(array, len(self.parts)) for array in arrays))
        calls = [getattr(part, method).remote(*share) for part, share in zip(self.parts, shares)]
        try:
            return ray.get(calls)
        except ray.exceptions.RayActorError as error:
            raise robot_model.InputError(
                "an actor or its machine is gone; --resume continues after the last update"
            ) from error

    def reset(self, *, seed, options=None):
        """See `FootstepVectorEnv.reset`; there are no options."""
        super().reset(seed=seed)
        # Here, since stage 3 makes these random numbers for all robots together
        less = self.np_random.integers(max(1, self.world.max_steps), size=self.num_envs)
        seeds = seed + np.arange(self.num_envs)
        return np.concatenate(self.ask("reset", seeds, less)), {}

    def step(self, actions):
        """See `FootstepVectorEnv.step`."""
        parts = self.ask("step", actions)
        observations, reward, terminated, truncated, last, *told = map(np.concatenate, zip(*parts))
        ended = terminated | truncated
        infos = {
            "final_obs": last,
            "_final_obs": ended,
            "final_info": dict(zip(TOLD, told)),
            "_final_info": ended,
        }
        return observations, reward, terminated, truncated, infos

    def close_extras(self, **_):
        """Ends the actors."""
        import ray

        for part in self.parts:
            ray.kill(part)


def connect(actors, address=None):
    """Connects to Ray on this machine, or to the cluster at that address; Ray copies the stages."""
    try:
        import ray
    except ImportError as error:
        raise robot_model.InputError(
            "the cluster needs Ray: python -m pip install ray==2.60.0"
        ) from error
    ray.cloudpickle.register_pickle_by_value(sys.modules[Part.__module__])
    stages = {"working_dir": str(ROOT), "excludes": ["runs", "results", ".git", "tests"]}
    where = {"address": address} if address else {"num_cpus": actors, "include_dashboard": False}
    try:
        ray.init(**where, runtime_env=stages, log_to_driver=False, logging_level="error")
    except (ConnectionError, ValueError) as error:
        raise robot_model.InputError(f"--address {address}: no Ray cluster there") from error


def train(args):
    """Trains a policy; writes policy.pt and the learning curve as stage 4 does."""
    connect(args.actors, args.address)
    make_envs = partial(Cluster, actors=args.actors, sim=args.sim, noise=True)
    settings = args.out, args.steps, args.seed, args.resume
    _, rows = ppo.train(ppo.PPOConfig(), make_envs, *settings, imu=False, noise=True)
    ppo.plot_learning_curve(rows, args.out / "learning_curve.png", f"{args.actors} actors")
    print(f"after {rows[-1]['minutes']:.1f} minutes: {args.out / 'policy.pt'}")


def walk_block(planner, sim, noise, trials):
    """Walks the trials of a block, in a process anywhere."""
    with closing(env.FootstepWorld(len(trials.goals), sim, noise, cores=1)) as world:
        return evaluate.evaluate(planner, world, trials)


def walk_all(args):
    """Walks as stage 5 --noise does, the policy only, in blocks on the cluster."""
    import ray

    connect(args.actors, args.address)
    std = common.STD[False]
    trials = evaluate.draw_trials(args.seed, args.episodes)
    policy = common.policy(args.evaluate, args.sim)
    blocks = [
        replace(trials, goals=trials.goals[first : first + BLOCK], first=first)
        for first in range(0, args.episodes, BLOCK)
    ]
    remote = ray.remote(num_cpus=1)(walk_block)
    results = {}
    for noise in (False, True):
        parts = [remote.remote(policy, args.sim, noise, block) for block in blocks]
        results["policy", noise, std] = common.together(ray.get(parts))
    rows = [evaluate.summary(*key, ended, env.Task()) for key, ended in results.items()]
    evaluate.write_trials(args.out / "trials.csv", {std: trials}, results)
    print(evaluate.table(rows, []))


def study_speed(args):
    """Rows of short trainings: by stage 4 alone, and with 1, 2 and 4 actors on this machine."""
    connect(4)
    rows = []
    for actors in (0, 1, 2, 4):
        make_envs = partial(env.FootstepVectorEnv, sim=args.sim, noise=True, staggered=True)
        if actors:
            make_envs = partial(Cluster, actors=actors, sim=args.sim, noise=True)
        folder = common.work(args.sim, "cluster", f"actors{actors}")
        begin = time.perf_counter()
        model, _ = ppo.train(ppo.PPOConfig(), make_envs, folder, SHORT)
        seconds = time.perf_counter() - begin
        weights = ppo.torch.nn.utils.parameters_to_vector(model.parameters())
        if not actors:
            alone = weights
        rows.append(
            {
                "training": f"{actors} actor{'s' * (actors > 1)}" if actors else "stage 4 alone",
                "double_steps_per_second": SHORT / seconds,
                "equal": ppo.torch.equal(weights, alone),
            }
        )
    return rows


PARTS = {"speed": study_speed}


def table(found, sim):
    """Every training."""
    columns = {"training": 0, "double_steps_per_second": 0, "equal": 0}
    return common.sections(found, {"speed": columns})


def found(data):
    """Sentences by name, from the numbers of both simulators."""
    rows = data["mujoco"]["speed"]["rows"]
    told = (f"{row['training']} {row['double_steps_per_second']:.0f}" for row in rows)
    equal = all(common.values(rows, "equal"))
    return {
        "equal": f"With 1, 2 and 4 actors the weights are {'' if equal else 'NOT '}equal to those of "
        f"stage 4 alone, bit for bit.",
        "speed": f"Double steps per second in 3-D on two cores: {', '.join(told)}.",
    }


def main(argv=None):
    study = sys.modules[__name__]
    args = common.arguments(
        study,
        argv,
        steps={"type": int, "default": ppo.STEPS, "help": "double steps of a training"},
        actors={"type": int, "default": robot_model.CORES, "help": "processes with robots"},
        address={"help": "of a running cluster; else Ray starts here"},
        resume={"action": "store_true", "help": "continue a stopped training"},
        evaluate={"type": Path, "metavar": "POLICY", "help": "walk as stage 5 does"},
        episodes={"type": int, "default": 10_000, "help": "how many goals"},
        only={"choices": PARTS, "help": "measure this"},
    )
    if min(args.steps, args.actors, args.episodes) < 1:
        raise robot_model.InputError("--steps, --actors and --episodes from 1 on")
    if args.only:
        common.publish(study, args.only, args)
    elif args.evaluate:
        walk_all(args)
    else:
        train(args)


if __name__ == "__main__":
    robot_model.start(import_module("cluster").main)  # by its name, as its own processes know it
