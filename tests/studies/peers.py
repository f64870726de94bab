"""Does another implementation of PPO learn the same? Stable-Baselines3 on the same task.

    python -m pip install stable-baselines3==2.9.2
    python tests/studies/peers.py [--mujoco] [--out FOLDER]

Our trainings are those of `ablations` with a clipped Gaussian policy and no sharpening, for six seeds.
An exact permutation test compares the times: if both implementations learn the same, each division of
the twelve trainings into two groups of six is as likely as ours. p is the share of the divisions in
which the means differ by as much.
"""

from itertools import combinations
from types import SimpleNamespace

import ablations
import common
import numpy as np
from common import env, evaluate, ppo, robot_model, values

torch = ppo.torch
DURATION = "40 minutes; 3-D: 80"
SEEDS = range(6)
CFG = ablations.UNSHARPENED
UPDATES = -(-ablations.STEPS // (CFG.num_envs * CFG.rollout))


def learn(sim, seed):
    """Trains one policy and returns its row."""
    try:
        from stable_baselines3 import PPO
        from stable_baselines3.common.env_util import make_vec_env
    except ImportError as error:
        raise robot_model.InputError(
            "first: python -m pip install stable-baselines3==2.9.2"
        ) from error
    first = ppo.random_seed(seed) % 2**31  # near seeds would share most of their robots' worlds
    settings = {"sim": sim, "noise": True}
    envs = make_vec_env(env.FootstepEnv, CFG.num_envs, first, env_kwargs=settings)
    model = PPO(
        "MlpPolicy",
        envs,
        n_steps=CFG.rollout,
        batch_size=CFG.minibatch,
        n_epochs=CFG.epochs,
        learning_rate=lambda left: CFG.learning_rate * (left + 1 / UPDATES),  # left: after it
        gamma=CFG.gamma,
        gae_lambda=CFG.lam,
        clip_range=CFG.clip,
        vf_coef=CFG.value_coef,
        max_grad_norm=CFG.max_grad_norm,
        device="cpu",
        seed=first,
        policy_kwargs={
            "net_arch": list(CFG.hidden),  # of the actor, and of the critic
            "activation_fn": torch.nn.Tanh,
            "log_std_init": float(ablations.log_std(CFG.first_concentration)),
        },
    )
    neutral = env.to_action(np.zeros((2, 3)), env.LIMITS[sim])
    model.policy.action_net.bias.data.copy_(torch.as_tensor(neutral))
    model.learn(UPDATES * CFG.num_envs * CFG.rollout)
    envs.close()

    def decide(obs):
        """Its prediction is the mean of the normal distribution, clipped."""
        return model.predict(obs, deterministic=True)[0]

    planner = evaluate.PolicyPlanner(SimpleNamespace(decide=decide))
    return {"seed": seed, **ablations.judged(planner, sim)}


def study_ours(args):
    """Rows of our trainings; those of `ablations` are among them."""
    return ablations.study_short(args, [ablations.PEER], SEEDS)


def study_sb3(args):
    """Rows of the other implementation's trainings."""
    return [learn(args.sim, seed) for seed in SEEDS]


PARTS = {"ours": study_ours, "sb3": study_sb3}


COLUMNS = dict.fromkeys(PARTS, {"seed": 0, "success": 3, "fall": 3, "time_mean": 2})


def found(data):
    """Sentences by name, from the numbers of the plane."""
    ours, theirs = (values(data["pymunk"][part]["rows"], "time_mean") for part in PARTS)
    times = np.array(ours + theirs)
    divisions = [times[[*group]].mean() for group in combinations(range(len(times)), len(ours))]
    differ = np.abs(divisions - times.mean())  # half of the difference of the two means
    p = (differ >= abs(np.mean(ours) - times.mean()) - 1e-9).mean()
    return {
        "times": f"On the plane the walks take {np.mean(ours):.1f} s with our {len(ours)} policies "
        f"({min(ours):.1f} to {max(ours):.1f} s), and {np.mean(theirs):.1f} s with those of "
        f"Stable-Baselines3 ({min(theirs):.1f} to {max(theirs):.1f} s). If both implementations learned the "
        f"same, chance would give such a difference with the probability p = {p:.3f}.",
    }


if __name__ == "__main__":
    common.start("peers")
