"""How to train on more than one machine? Footsteps-v0 with Ray RLlib, here on one of them.

    python tests/studies/rllib.py [--mujoco] [--ship]

Ray wants another Gymnasium than ours, so it gets an environment of its own, with the same stages:
`python -m venv ray`, then there `python -m pip install "ray[rllib]==2.60.0" torch==2.13.0
pymunk==7.3.1 mujoco==4.0.0 matplotlib tqdm`. Its PPO with the settings and the first policy of
ours, 100,000 double steps, three seeds, two processes with eight robots each; then 250 near and 250
far noisy goals. (Its own first policy draws actions with a standard deviation as wide as half of
their range: after 70,000 double steps it still fell in 73 % of the walks.) On a cluster: start Ray
there with this folder at the same place on every machine, set RAY_ADDRESS, and RUNNERS below.
"""

import os
from importlib import import_module
from time import perf_counter

import ablations
import common
import kept
import numpy as np
from kept import env, evaluate, ppo

try:
    import ray
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.rllib.callbacks.callbacks import RLlibCallback
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
    from ray.tune.registry import register_env
except ImportError:  # it is told when the study begins
    ray, RLlibCallback = None, object

DURATION = {"pymunk": "about 16 minutes on two cores", "mujoco": "about 16 minutes on two cores"}
STEPS, RUNNERS, ROBOTS = 100_000, 2, 8

def one_robot(settings):
    """What the processes run; they import the stages anew."""
    return import_module("03_env").FootstepEnv(**settings)

class Ends(RLlibCallback):
    """How episodes end, for the log."""

    def on_episode_end(self, *, episode, metrics_logger, **_):
        for name in ("success", "fall"):
            metrics_logger.log_value(name, float(episode.get_infos(-1)[name]), window=200)

def algorithm(sim, seed, runners):
    """RLlib's PPO with the settings and the first policy of ours, as far as it has them."""
    cfg = ppo.PPOConfig()
    register_env("footsteps", one_robot)
    config = (
        PPOConfig()
        .environment("footsteps", env_config={"sim": sim, "noise": True})
        .env_runners(num_env_runners=runners, num_envs_per_env_runner=ROBOTS,
                     sample_timeout_s=600)
        .training(lr=[[0, cfg.learning_rate], [STEPS, 0.0]], gamma=cfg.gamma, lambda_=cfg.lam,
                  clip_param=cfg.clip, num_epochs=cfg.epochs, minibatch_size=cfg.minibatch,
                  train_batch_size_per_learner=cfg.num_envs * cfg.rollout, use_kl_loss=False,
                  vf_loss_coeff=cfg.value_coef, vf_clip_param=float("inf"), entropy_coeff=0.0,
                  grad_clip=cfg.max_grad_norm, grad_clip_by="global_norm")
        .rl_module(model_config=DefaultModelConfig(
            fcnet_hiddens=list(cfg.hidden), fcnet_activation="tanh", vf_share_layers=False))
        .callbacks(Ends)
        .debugging(seed=seed)
    )
    algo = config.build_algo()
    weights = algo.learner_group.get_weights()
    last = weights["default_policy"]  # its last layer gives the means, then ln σ
    neutral = env.to_action(np.zeros((2, 3)), env.walk_engine.LIMITS[sim])  # [6] from 0 to 1
    # σ of a Beta distribution in the middle: 1 / √(4·(c + 1)), on a range of 2: twice that
    log_std = np.full(6, np.log(2) - 0.5 * np.log(4 * (cfg.first_concentration + 1)))
    last["pi.net.mlp.0.weight"] = 0.01 * last["pi.net.mlp.0.weight"]
    last["pi.net.mlp.0.bias"] = np.float32(np.concatenate([2 * neutral - 1, log_std]))
    algo.learner_group.set_weights(weights)
    algo.env_runner_group.sync_weights(  # and waits until every process has them
        from_worker_or_learner_group=algo.learner_group, timeout_seconds=60)
    return algo

class Decides:
    """Its model, decisions as ours."""

    def __init__(self, module):
        self.module = module

    def decide(self, obs):
        """The mean of the normal distribution; RLlib's actions go from −1 to 1."""
        with ppo.torch.no_grad():
            out = self.module.forward_inference({"obs": ppo.torch.as_tensor(obs)})
        mean = out["action_dist_inputs"].chunk(2, -1)[0].numpy()
        return np.clip((mean + 1) / 2, 0, 1)

def train(sim, seed):
    """One training and its trials: a row."""
    algo, curve, begin = algorithm(sim, seed, RUNNERS), [], perf_counter()
    steps = 0
    while steps < STEPS:
        seen = algo.train()["env_runners"]
        steps = int(seen["num_env_steps_sampled_lifetime"])
        curve.append({"steps": steps, "minutes": round((perf_counter() - begin) / 60, 3),
                      **{name: round(float(seen[name]), 4) for name in ("success", "fall")
                         if name in seen}})
        print(f"seed {seed}: {curve[-1]}", flush=True)
    seconds = perf_counter() - begin
    ended = ablations.walks(evaluate.PolicyPlanner(Decides(algo.get_module()), False), sim)
    algo.stop()
    return {"seed": seed, "steps": steps, "seconds": round(seconds, 1), "curve": curve,
            "speed": round(steps / seconds, 1),
            **evaluate.summary("policy", True, None, ended, env.Task())}

def study(sim):
    """Three trainings."""
    if ray is None:
        raise common.StudyError("it needs Ray, in an environment of its own: see --help")
    folders = [str(common.ROOT), str(common.ROOT / "tests" / "studies")]
    ray.init(runtime_env={"env_vars": {"PYTHONPATH": os.pathsep.join(folders)}},
             include_dashboard=False, log_to_driver=False)
    rows = [train(sim, seed) for seed in kept.SEEDS]
    ray.shutdown()
    keys = {"success": 3, "fall": 3, "time_mean": 2, "seconds": 0, "speed": 0}
    lines = [[f"seed {row['seed']}", *(common.number(row[key], n) for key, n in keys.items())]
             for row in rows]
    lines.append(["all", *(common.spread([row[key] for row in rows], n)
                           for key, n in keys.items())])
    head = ["training", "success", "fall", "time [s]", "wall-clock [s]", "double steps per second"]
    return common.Findings({"steps": STEPS, "runners": RUNNERS, "robots": ROBOTS, "rows": rows},
                           common.markdown(head, lines), plot(rows, sim))

def plot(rows, sim):
    """Success and falls against double steps; the clock is in the table."""
    figure, axes = common.plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
    for axis, name in zip(axes, ("success", "fall")):
        for row, marker in zip(rows, "o^x"):
            known = [point for point in row["curve"] if name in point]
            axis.plot([point["steps"] / 1000 for point in known],
                      [point[name] for point in known], f"{marker}-", ms=4, lw=1,
                      label=f"seed {row['seed']}")
        axis.set(xlabel="double steps [thousands]", ylabel=f"{name}, share of episodes [1]")
        axis.grid(alpha=0.3)
    axes[0].legend()
    figure.suptitle(f"While exploring: RLlib's PPO on Footsteps-v0 ({sim})")
    return figure

if __name__ == "__main__":
    common.main(__file__)
