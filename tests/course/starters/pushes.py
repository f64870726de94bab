"""Starter for "A map of pushes": how strong may a push from the right be, in the third double step?

python tests/course/starters/pushes.py      from the root of the project; half a minute
"""

import sys
from importlib import import_module

import numpy as np

sys.path.append(".")
robot_model, walk, env = map(import_module, ("01_robot_model", "02_walk_engine", "03_env"))
ROBOTS, ANGLE, FIRST = 64, np.radians(90), 10  # direction (0: forward) and first tick of the push

if __name__ == "__main__":
    robot = robot_model.RobotModel()
    body = env.Spread().draw([env.stream("tuning", 0, i) for i in range(ROBOTS)], robot)
    steps = np.tile(walk.WALKS["forward"], (ROBOTS, 6, 1, 1))  # six double steps each
    for speed in (0.2, 0.4, 0.6, 0.8):  # [m/s]
        force = robot_model.turned([walk.push_force(robot, speed), 0], ANGLE)

        def push(k, disturbance, robots, force=force):
            if k == 2:
                disturbance.push[:, FIRST : FIRST + walk.PUSH_TICKS] = force

        _, _, fall = walk.walk_plans("mujoco", walk.TUNED["mujoco"], steps, body, push)
        print(f"{speed} m/s: {np.mean(fall < 6):.0%} fall")
