"""The planner to beat in the contest: the best one that we can write by hand, without learning.

    python 05_evaluate.py --mujoco --noise --far --planner tests/studies/expert.py

The planner commands how far the robot moves in a double step, (x, y, turn), and uses four ideas:
1. Half of the right foot's last step is still to be walked. So the planner takes the goal as seen
   from where the robot will come to rest.
2. The robot brakes late: it is as fast as it may be to stop at the goal, if it slows down by the
   same amount in every double step.
3. Until it is near, the robot may face the goal, or turn its back to it. The planner simulates its
   own law for each of these, and takes the one with which the robot arrives first.
4. Both feet share a sideways distance and a turn, each in proportion to its limit.
"""

from dataclasses import dataclass
from importlib import import_module

import numpy as np

robot_model = import_module("01_robot_model")
env = import_module("03_env")
FACING = (None, (0.3, 0.0), (0.6, 0.0), (0.3, np.pi), (0.6, np.pi))  # until [m], turned by [rad]
HORIZON = 25  # double steps that are rolled out


@dataclass(frozen=True)
class Settings:
    """How bold the planner is."""

    top: tuple  # largest command, share of the limits: x, y, turn
    change: tuple  # its largest change in a double step, also a share
    together: float  # largest sum of the three shares
    gain: float  # share of the distance that is left, near the goal


TUNED = {  # by `python tests/studies/baseline.py --only expert`, 2026-11-28
    "pymunk": Settings((0.6328, 1.9471, 1.1503), (2.2824, 1.5404, 0.3925), 2.5082, 1.0099),
    "mujoco": Settings((0.6519, 0.7948, 1.07), (0.9402, 0.8674, 0.4784), 1.8692, 0.797),
}


def law(rest, last, facing, limits, settings):
    """The next command [n, 3] for goals seen from where the robot comes to rest [n, 3]."""
    low, high = np.array(limits.low), np.array(limits.high)
    largest = np.array([2 * high[0], high[1] - low[1], high[2] - low[2]])  # of a double step
    smallest = np.array([2 * low[0], *-largest[1:]])
    error = rest.copy()
    if facing:
        until, turned = facing
        d, _, beta = env.polar(rest)
        error[:, 2] = np.where(d > until, beta - turned, rest[:, 2])
    error[:, 2] = env.wrap(error[:, 2])
    # v, v − a, v − 2a, … add up to the way that is left: v = (−a + √(a² + 8·a·way)) / 2
    a = settings.change * largest
    way = settings.gain * np.abs(error)
    speed = np.minimum(way, (-a + np.sqrt(a**2 + 8 * a * way)) / 2)
    wanted = np.clip(np.sign(error) * speed, settings.top * smallest, settings.top * largest)
    wanted = np.clip(wanted, last - a, last + a)
    share = np.abs(wanted) / np.where(wanted > 0, largest, -smallest)
    return wanted * np.minimum(1, settings.together / np.maximum(share.sum(1), 1e-9))[:, None]


def footsteps(command, limits):
    """The two footsteps [n, 2, 3] that move the robot by this command [n, 3] in a double step."""
    low, high = np.array(limits.low)[1:], np.array(limits.high)[1:]
    leading = np.maximum(command[:, 1:] * high / (high - low), 0)
    right_leads = np.maximum(-command[:, 1:] * high / (high - low), 0)
    ratio = low / high  # the following foot steps inward
    left, right = leading + ratio * right_leads, right_leads + ratio * leading
    x = command[:, :1] / 2
    return np.stack([np.hstack([x, left]), np.hstack([x, right])], 1)


class Planner:
    """See above; it remembers its last command."""

    def __init__(self, settings=None):
        self.settings = settings  # None: those in TUNED for these limits, else those of 3-D

    def reset(self, num_robots):
        self.last = np.zeros((num_robots, 3))

    def act(self, view):
        settings = self.settings
        for sim, limits in env.LIMITS.items():
            if settings is None and view.limits == limits:
                settings = TUNED[sim]
        settings = settings or TUNED["mujoco"]
        step = env.to_footsteps(view.last_action, view.limits)[:, 1] * [1, -1, -1]
        rest, last = robot_model.relative(step / 2, view.goal), self.last[view.robots]
        soonest, chosen = np.full(len(last), np.inf), last
        for facing in FACING:
            goal, command, first, time = rest, last, None, 0.0
            for _ in range(HORIZON):
                command = law(goal, command, facing, view.limits, settings)
                first = command if first is None else first
                # Time until it is near, and a fraction of a double step for what is left then.
                left = np.hypot(goal[:, 0], goal[:, 1]) / 0.15 + np.abs(env.wrap(goal[:, 2])) / 0.5
                time = time + np.minimum(1, left)
                goal = robot_model.relative(command, goal)
            chosen = np.where((time < soonest)[:, None], first, chosen)
            soonest = np.minimum(soonest, time)
        self.last[view.robots] = chosen
        return env.to_action(footsteps(chosen, view.limits), view.limits)
