"""Starter for "Obstacles": one disc, one intermediate goal beside it, chosen by hand. From the root:
python tests/course/starters/obstacles.py"""

import sys
from importlib import import_module
from pathlib import Path

import numpy as np

sys.path.append(".")
env, ppo = import_module("03_env"), import_module("04_ppo")
DISC = np.array([0.9, 0.0, 0.2])  # x, y, radius [m]
WAY = np.array([[0.9, 0.6, 0.0], [1.8, 0.0, 0.0]])  # intermediate goal, goal: x, y [m], yaw [rad]

if __name__ == "__main__":
    model = ppo.load_policy(Path("results/mujoco/policy.pt"))[0]
    world, robots = env.FootstepWorld(1, "mujoco", noise=True), np.array([0])
    world.reset(robots, goals=WAY[:1])
    nearest, goals = np.inf, 0
    for _ in range(60):  # double steps
        view = world.view(robots)
        if goals == 0 and np.hypot(*view.goal[0, :2]) < 0.3:  # near enough, as it believes
            goals = 1
            world.set_goal(robots, WAY[1:])
            continue
        result = world.step(model.decide(view.observation), robots)
        nearest = min(nearest, np.hypot(*(world.pose[0, :2] - DISC[:2])) - DISC[2])
        if result["fall"] or goals and result["success"]:
            break
    print(f"{world.steps[0]} double steps, {nearest:.2f} m between torso and disc at the nearest")
