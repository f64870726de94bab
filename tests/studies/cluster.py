"""Can more machines teach one policy? Ray actors simulate the robots; stage 4 is not changed.

    python -m pip install ray==2.60.0
    python tests/studies/cluster.py --mujoco       what Ray costs, in short trainings

An actor is an object in a process of its own, on any machine of a Ray cluster. Calls of its methods
travel there, and results come back. Here each actor simulates a shard of the robots, in one thread.
To stage 4 all of them together look like a `FootstepVectorEnv`. Every robot has a random generator of
its own, so it does not matter where it is simulated: the policy is that of stage 4 alone, bit for
bit. It is written to runs/<sim>/studies/cluster. For a whole training set STEPS to 250,000, and
ACTORS to 0 and as many as you have cores. If an actor is lost, the training ends.

Ray starts on this machine, for this run only. For several machines, which need the same versions of
Python and of the packages (Ray copies our code to them):

    export RAY_AUTH_MODE=token          on all of them: only those with the token may run code there
    ray get-auth-token --generate       on the first one; copy ~/.ray/auth_token to the others
    ray start --head --port 6379        on the first one, which prints its ADDRESS
    ray start --address ADDRESS:6379    on every other one
    export RAY_ADDRESS=ADDRESS:6379     on the one where you start the study
    ray stop                            on each of them, at the end
"""

import sys
import time
from functools import partial

import common
import numpy as np
from common import env, ppo, robot_model

try:
    import ray
except ImportError:
    ray = None  # said when the study starts

DURATION = "2 minutes"
STEPS = 8192  # double steps of a training
ACTORS = 0, 1, 2, 4  # of the trainings; 0: stage 4 alone. They share the 64 robots equally


class Shard:
    """Some of the robots, in a process anywhere."""

    def __init__(self, count, settings):
        robot_model.CORES = 1  # in this process
        self.envs = env.FootstepVectorEnv(count, **settings)

    def reset(self, seeds):
        """The first observations; a robot's seed is one more than that of the robot before."""
        return self.envs.reset(seed=seeds[0])[:1]

    def step(self, actions):
        """What `FootstepVectorEnv.step` returns, but for the infos only what followed the actions."""
        *result, infos = self.envs.step(actions)
        return *result, infos.get("final_obs", result[0])


class Cluster(env.FootstepVectorEnv):
    """N robots, shared among actors. (One more stays here: it tells the settings of all.)"""

    def __init__(self, num_envs, actors, **settings):
        super().__init__(1, **settings)
        self.num_envs = num_envs
        actor = ray.remote(scheduling_strategy="SPREAD")(Shard)
        self.shards = [actor.remote(num_envs // actors, settings) for _ in range(actors)]

    def ask(self, method, array):
        """The joined answers of all actors, which work at the same time, each on its part."""
        parts = zip(self.shards, np.split(array, len(self.shards)))
        answers = ray.get([getattr(shard, method).remote(part) for shard, part in parts])
        return map(np.concatenate, zip(*answers))

    def reset(self, seed, **_):
        """See `FootstepVectorEnv.reset`; there are no options."""
        return *self.ask("reset", seed + np.arange(self.num_envs)), {}

    def step(self, actions):
        """See `FootstepVectorEnv.step`; how episodes end is not told."""
        *result, last = self.ask("step", actions)
        return *result, {"final_obs": last, "final_info": {}}


def study_speed(args):
    """Rows of trainings: by stage 4 alone (0 actors), then with actors. Are the weights equal?"""
    if ray is None:
        raise robot_model.InputError("the cluster needs Ray: python -m pip install ray==2.60.0")
    ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])
    # Ray copies the stages, and no folder beside them: results, tests, an environment of any name.
    ray.init(runtime_env={"working_dir": str(common.ROOT), "excludes": ["*/"]})
    folder, rows, models = common.work(args.sim, "cluster", "training"), [], []
    for n in ACTORS:
        kind = partial(Cluster, actors=n) if n else env.FootstepVectorEnv
        make_envs, begin = partial(kind, sim=args.sim, noise=True), time.perf_counter()
        model, _ = ppo.train(ppo.PPOConfig(), make_envs, folder, STEPS, args.seed)
        models.append(model)
        rows.append(
            {
                "training": f"{n} actors",
                "double_steps_per_second": STEPS / (time.perf_counter() - begin),
                "equal": all(map(ppo.torch.equal, models[0].parameters(), model.parameters())),
            }
        )
    return rows


PARTS = {"speed": study_speed}
COLUMNS = {"speed": dict.fromkeys(("training", "double_steps_per_second", "equal"), 0)}


if __name__ == "__main__":
    common.start("cluster")
