"""Can more machines teach one policy? Ray actors simulate the robots; stage 4 is not changed.

    python -m pip install ray==2.60.0
    python tests/studies/cluster.py --mujoco --only train --seed 0 --out runs/cluster
    python tests/studies/cluster.py --mujoco --only speed       what Ray costs

An actor is an object in a process of its own, on any machine of a Ray cluster. Calls of its methods
travel there, and results come back. Here each actor simulates a part of the robots. `Cluster` talks
to all actors, and to stage 4 it looks like a `FootstepVectorEnv`. Every robot has a random
generator of its own, so it does not matter where it is simulated: the policy is the same, bit for
bit. An actor computes in one thread. (Without Ray, MuJoCo takes all cores that its process may use,
CORES of stage 1. `taskset -c 0,1 python 04_ppo.py --mujoco` allows it two.)

Without --address Ray starts on this machine, for this run only. For several machines, which need
the same versions of Python and of the packages (Ray copies our code to them):

    export RAY_AUTH_MODE=token          on all of them: only those with the token may run code there
    ray get-auth-token --generate       on the first one; copy ~/.ray/auth_token to the others
    ray start --head --port 6379        on the first one, which prints its ADDRESS
    ray start --address ADDRESS:6379    on every other one
    python tests/studies/cluster.py --mujoco --only train --address ADDRESS:6379 --actors 16
    ray stop                            on each of them, at the end
"""

import socket
import sys
import time
from functools import partial

import common
import numpy as np
from common import ROOT, env, ppo, robot_model

try:
    import ray
except ImportError:
    ray = None  # `connect` says how to install it

DURATION = "a training takes as long as in stage 4; speed: 2 minutes"
TOLD = "success", "fall", "timeout", "time"  # what stage 4 asks of an ended episode
SHORT = 8_192  # double steps, to compare and to measure the speed


class Part:
    """Some of the robots, in a process anywhere."""

    def __init__(self, count, settings):
        robot_model.CORES = 1  # in this process
        self.envs = env.FootstepVectorEnv(count, **settings)

    def reset(self, seeds):
        """The first observations."""
        return self.envs.reset(seed=int(seeds[0]))[0]

    def step(self, actions):
        """What `FootstepVectorEnv.step` returns, and of its infos those that training needs."""
        *result, infos = self.envs.step(actions)  # observations, reward, terminated, truncated
        last = infos.get("final_obs", result[0])
        return *result, last, *(infos[name] for name in TOLD)


class Cluster(env.FootstepVectorEnv):
    """N robots shared among some actors. To stage 4 it is a `FootstepVectorEnv`; a robot that stays
    here tells the settings of all."""

    def __init__(self, num_envs, actors, **settings):
        super().__init__(1, **settings)
        self.num_envs = num_envs
        remote = ray.remote(num_cpus=1)(Part)
        shares = np.array_split(np.arange(num_envs), min(actors, num_envs))
        self.parts = [remote.remote(len(share), settings) for share in shares]

    def ask(self, method, array):
        """The answers of all actors, which work at the same time. Each gets its robots' part of the
        array.
        """
        shares = np.array_split(array, len(self.parts))
        calls = [getattr(part, method).remote(share) for part, share in zip(self.parts, shares)]
        try:
            return ray.get(calls)
        except ray.exceptions.RayActorError as error:
            raise robot_model.InputError("an actor or its machine is gone: train again") from error

    def reset(self, *, seed, options=None):
        """See `FootstepVectorEnv.reset`; there are no options."""
        return np.concatenate(self.ask("reset", seed + np.arange(self.num_envs))), {}

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
        for part in self.parts:
            ray.kill(part)


def connect(actors, address=None):
    """Connects to Ray on this machine, or to the cluster at that address; Ray copies the stages."""
    if ray is None:
        raise robot_model.InputError("the cluster needs Ray: python -m pip install ray==2.60.0")
    ray.shutdown()  # what another part has begun
    ray.cloudpickle.register_pickle_by_value(sys.modules[Part.__module__])
    # No folder beside the stages: results, tests, .git, an environment of any name
    stages = {"working_dir": str(ROOT), "excludes": ["*/"]}
    where = {"address": address} if address else {"num_cpus": actors, "include_dashboard": False}
    try:
        if address:  # Ray would wait long for a machine that is not there
            host, port = address.rsplit(":", 1)
            socket.create_connection((host, int(port)), timeout=5).close()
        ray.init(**where, runtime_env=stages, log_to_driver=False, logging_level="error")
    except (OSError, ValueError) as error:  # a ConnectionError is an OSError
        raise robot_model.InputError(f"--address {address}: no Ray cluster there") from error


def train(args):
    """Trains a policy; writes policy.pt and the learning curve as stage 4 does, and no rows."""
    if min(args.steps, args.actors) < 1:
        raise robot_model.InputError("--steps and --actors from 1 on")
    connect(args.actors, args.address)
    make_envs = partial(Cluster, actors=args.actors, sim=args.sim, noise=True)
    _, rows = ppo.train(ppo.PPOConfig(), make_envs, args.out, args.steps, args.seed)
    ppo.plot_learning_curve(rows, args.out / "learning_curve.png", f"{args.actors} actors")
    print("written:", args.out / "policy.pt")


def study_speed(args):
    """Rows of short trainings: by stage 4 alone, and with 1, 2 and 4 actors on this machine."""
    connect(4)
    kinds = {"stage 4 alone": env.FootstepVectorEnv}
    kinds |= {f"{n} actor{'s' * (n > 1)}": partial(Cluster, actors=n) for n in (1, 2, 4)}
    rows, weights = [], []
    for name, kind in kinds.items():
        make_envs = partial(kind, sim=args.sim, noise=True)
        folder = common.work(args.sim, "cluster", name)
        begin = time.perf_counter()
        model, _ = ppo.train(ppo.PPOConfig(), make_envs, folder, SHORT)
        speed = SHORT / (time.perf_counter() - begin)
        weights.append(ppo.torch.nn.utils.parameters_to_vector(model.parameters()))
        equal = ppo.torch.equal(weights[-1], weights[0])
        rows.append({"training": name, "double_steps_per_second": speed, "equal": equal})
    return rows


FLAGS = {
    "steps": {"type": int, "default": ppo.STEPS, "help": "double steps of a training"},
    "actors": {"type": int, "default": robot_model.CORES, "help": "processes with robots"},
    "address": {"help": "of a running cluster; else Ray starts here"},
}
PARTS = {"speed": study_speed, "train": train}


COLUMNS = {"speed": {"training": 0, "double_steps_per_second": 0, "equal": 0}}


if __name__ == "__main__":
    common.start("cluster")
