"""No physics: the robot moves exactly as planned, so nothing can fall here. PPO learns in seconds.

    python tests/course/starters/ideal.py

Trains 16,000 double steps with the settings of the 3-D robot and evaluates 200 goals, with noise.
"""

import sys
import tempfile
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[3]))  # where the stages are
robot_model, env, ppo, evaluate = map(
    import_module, ("01_robot_model", "03_env", "04_ppo", "05_evaluate")
)


class IdealSim(robot_model.Simulator):
    """N robots that do what they are told."""

    def place(self, i):
        pass

    def advance(self, robots, targets, push, move):
        state, ground = self.state[robots], robot_model.GROUND
        state[:, ground] = robot_model.compose(state[:, ground], move)
        state[:, robot_model.ANGLES] = targets[:, 1]
        return state


robot_model.SIMULATORS["mujoco"] = IdealSim
# Robots that never lean need no answer to a lean.
WALK = replace(env.walk_engine.TUNED["mujoco"], reflex=0.0, capture=0.0, wait=0.0)
IDEAL = {"sim": "mujoco", "noise": True, "walk": WALK, "drift": (0.001, 0.001, 0.001)}


def main():
    print("Ideal robots: they move exactly as planned, so nothing can fall here.")
    make_envs = partial(env.FootstepVectorEnv, **IDEAL)
    with tempfile.TemporaryDirectory() as folder:
        model, _ = ppo.train(ppo.PPOConfig(), make_envs, Path(folder), 16_000)
    world = env.FootstepWorld(200, **IDEAL)
    for planner in evaluate.PolicyPlanner(model), evaluate.BaselinePlanner():
        ended = evaluate.evaluate(planner, world, evaluate.draw_trials(0, 200))
        success = ended["outcome"] == "success"
        seconds = ended["time"][success].mean()
        print(f"{type(planner).__name__}: {success.mean():.0%} arrive, in {seconds:.1f} s")


if __name__ == "__main__":
    robot_model.run_script(main)
