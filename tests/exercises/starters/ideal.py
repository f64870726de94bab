"""No physics: the robot moves exactly as planned, so nothing can fall here. PPO learns in seconds.

    python tests/exercises/starters/ideal.py

Trains 16,000 double steps with the settings of the 3-D robot and evaluates 200 goals, with noise.
"""

import sys
import tempfile
from contextlib import closing
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[3]))  # where the stages are
robot_model, env, ppo, evaluate = map(
    import_module, ("01_robot_model", "03_env", "04_ppo", "05_evaluate")
)


class IdealSim(robot_model.Simulator):
    """N robots that do what they are told; `state` is where the torso is: x, y [m], yaw [rad]."""

    def __init__(self, sim, num_robots, standing, robot, cores):
        super().__init__(num_robots, standing, robot)
        self.state = np.zeros((num_robots, 3))

    def place(self, robots, body):
        self.state[robots] = 0

    def run(self, robots, plan, disturbance=None):
        trunk, torso = plan.trunk[..., robot_model.GROUND], plan.trunk[:, 1:].copy()
        moved = robot_model.relative(trunk[:, :1], trunk[:, 1:])
        torso[..., robot_model.GROUND] = robot_model.compose(self.state[robots, None], moved)
        self.state[robots] = torso[:, -1, robot_model.GROUND]
        n, ticks, _ = torso.shape
        still, fell = np.zeros((n, 3)), np.zeros(n, bool)
        return robot_model.Motion(torso, plan.joints[:, 1:], still, fell, np.full(n, ticks))


IDEAL = {"sim": "mujoco", "noise": True, "simulate": IdealSim, "drift": (0.001, 0.001, 0.001)}


def main():
    print("Ideal robots: they move exactly as planned, so nothing can fall here.")
    make_envs = partial(env.FootstepVectorEnv, staggered=True, **IDEAL)
    with tempfile.TemporaryDirectory() as folder:
        model, _ = ppo.train(ppo.PPOConfig(), make_envs, Path(folder), 16_000)
    with closing(env.FootstepWorld(200, **IDEAL)) as world:
        for planner in evaluate.PolicyPlanner(model), evaluate.BaselinePlanner():
            ended = evaluate.evaluate(planner, world, evaluate.draw_trials(0, 200))
            success = ended["outcome"] == "success"
            seconds = ended["time"][success].mean()
            print(f"{type(planner).__name__}: {success.mean():.0%} arrive, in {seconds:.1f} s")


if __name__ == "__main__":
    robot_model.start(main)
