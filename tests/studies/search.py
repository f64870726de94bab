"""How far does a search get that ignores how the robot moves when a double step begins?

    python 05_evaluate.py --noise --planner tests/studies/search.py    the planner, beside others
    python tests/studies/search.py [--mujoco] [--out FOLDER]           a new map for it

`Planner` is a worked example of a planner of your own. It takes the double step after which the
fewest double steps are left. A map V tells how many are left from every pose around the goal. The
script computes V once by dynamic programming: this gives, for all starts at once, what A* gives for
one start in the paper's references [3] and [4]. The motion of the robot when a double step begins
is left out. To make up for that, the script tries several sizes of steps, and several largest
changes from one step to the next. It writes the best map to search.npz in the folder above the
table. The planner reads results/<sim>/search.npz.
"""

import json
import math
from itertools import product

import baseline
import common
import numpy as np
from common import env, ppo, robot_model, walk_engine

CELL, TURN = 0.05, math.radians(10)  # [m], [rad] size of a cell of the map of poses
HALF, TURNS = 64, 36  # cells on each side of the goal (3.2 m), and around the circle
FAR = 25.5  # [double steps] what the map says where the goal is out of reach


def double_steps(limits, factor=1.0):
    """Double steps [A, 2, 3] to search over, within the limits times a factor; first: in place."""
    low, high = factor * np.array([limits.low, limits.high])
    axes = np.linspace(low[0], high[0], 8), np.linspace(-1, 1, 5), np.linspace(-1, 1, 7)
    # x [m]; to the left, shares of the largest sideways step and of the largest turn
    x, left = np.split(np.array([*product(*axes)]), [1], 1)  # [A − 1, 1], [A − 1, 2]
    # To the left: the left foot goes outward, the right one inward, by the same share.
    outward = np.stack([left, -left], 1)  # [A − 1, 2, 2]
    steps = np.zeros((len(x) + 1, 2, 3))
    steps[1:, :, 0] = x
    steps[1:, :, 1:] = outward * np.where(outward > 0, high[1:], -low[1:])
    return steps


def displacements(sim, steps):
    """Where each of the double steps [A, 2, 3] takes the robot, seen from where it was [A, 3], and
    after which of them the robot still stands [A]. Measured for a robot in the middle of the
    spread: the third to sixth of six double steps in a row.
    """
    plans = np.repeat(steps[:, None], 6, 1)  # [A, 6, 2, 3]
    body = robot_model.Variation.as_model(robot_model.RobotModel(), len(plans))
    body.delay += env.Spread().delay / 2
    poses, _, fall = walk_engine.walk_plans(sim, walk_engine.TUNED[sim], plans, body)
    return robot_model.relative(poses[:, 2:-1], poses[:, 3:]).mean(1), fall == 6


def steps_to_go(moves, task):
    """How many double steps it takes to the goal, from every pose around it: dynamic programming.

    moves [A, 3]: what a double step does. Returns V [TURNS, 2·HALF + 1, 2·HALF + 1] over the
    robot's yaw, x and y as seen from the goal:

        V = 0 at the goal,   V(pose) = 1 + min over moves of V(pose after the move)

    repeated until nothing changes. Between the cells V is linear in x, y and yaw. Beyond the map
    the goal is out of reach, V = FAR.
    """
    axis = CELL * np.arange(-HALF, HALF + 1)  # [m]
    yaws = TURN * np.arange(TURNS)  # [rad]
    near = np.hypot(axis[:, None], axis) <= task.success_m + 1e-9
    turned = np.abs(robot_model.wrap(yaws)) <= task.success_rad + 1e-9
    goal = near & turned[:, None, None]  # [TURNS, x, y]
    value = np.where(goal, 0.0, FAR).astype(np.float32)
    longest = np.abs(moves[:, :2]).max() * math.sqrt(2)  # [m] along x or y, however it is turned
    pad = math.ceil(longest / CELL) + 1  # cells beyond the map
    while True:
        border = np.pad(value, ((0, 0), (pad, pad), (pad, pad)), constant_values=FAR)
        best = np.full_like(value, FAR)
        for k, yaw in enumerate(yaws):
            for move, turn in zip(robot_model.turned(moves[:, :2], yaw), moves[:, 2]):
                # Seen from the goal, a move shifts all the poses of one yaw alike: by whole cells
                # (i, j, m), and by shares (u, v, w) of the next cell.
                (i, j), (u, v) = np.divmod(move / CELL, 1)
                m, w = divmod(k + turn / TURN, 1)
                x = slice(int(i) + pad, int(i) + pad + 2 * HALF + 2)
                y = slice(int(j) + pad, int(j) + pad + 2 * HALF + 2)
                this, following = border[int(m) % TURNS, x, y], border[int(m + 1) % TURNS, x, y]
                part = (1 - w) * this + w * following
                part = (1 - u) * part[:-1] + u * part[1:]
                part = (1 - v) * part[:, :-1] + v * part[:, 1:]
                np.minimum(best[k], part, out=best[k])
        better = np.where(goal, 0.0, np.minimum(best + 1, FAR)).astype(np.float32)
        if np.abs(better - value).max() < 0.01:
            return better
        value = better


def look_up(value, poses):
    """V [...] at poses [..., 3] (x, y [m], yaw [rad]) seen from the goal; linear between cells.

    V [TURNS, 2·HALF + 1, 2·HALF + 1], over yaw, x and y: how many double steps are left from there;
    see `steps_to_go`. Beyond the map V is that of its edge. After the last yaw comes the first.
    """
    edge = CELL * HALF - 1e-6
    x, y = (np.clip(poses[..., k], -edge, edge) / CELL + HALF for k in (0, 1))  # [cells]
    yaw = poses[..., 2] / TURN
    i, j, k = (np.floor(c).astype(int) for c in (x, y, yaw))
    u, v, w = x - i, y - j, yaw - k  # how far towards the next cell, 0 to 1
    total = 0.0
    for a, b, c in np.ndindex(2, 2, 2):  # the eight corners of the cell
        share_x = u if a else 1 - u
        share_y = v if b else 1 - v
        share_yaw = w if c else 1 - w
        corner = value[(k + c) % TURNS, i + a, j + b]
        total = total + share_x * share_y * share_yaw * corner
    return total


class Planner:
    """Takes the double step after which the fewest are left."""

    def __init__(self, known=None):
        self.known = known  # as of `read_map`; None: the shipped one

    def reset(self, num_robots):
        """Resets nothing: it does not remember."""

    def act(self, view):
        """Actions [n, 6] for the goals [n, 3] as n robots know them."""
        if self.known is None:
            self.known = read_map(view.limits)  # they tell the simulator
        steps, moves, value, largest_change = self.known
        actions = env.to_action(steps, view.limits)  # [A, 6]
        pose = robot_model.relative(view.goal, np.zeros(3))  # [n, 3] of the robot, from the goal
        # A robot beyond the map: as if it stood at the edge, in the same direction. A move may lead
        # farther out, along a diagonal by √2 more.
        edge = CELL * HALF - np.abs(moves[:, :2]).max() * math.sqrt(2)  # [m]
        pose[:, :2] /= np.maximum(1, np.abs(pose[:, :2]).max(-1, keepdims=True) / edge)
        left = look_up(value, robot_model.compose(pose[:, None], moves))  # [n, A]
        # An action that differs too much from the last one costs more than any path: a last resort.
        change = np.abs(view.last_action[:, None] - actions).max(-1)  # [n, A]
        left = left + 100 * np.maximum(0, change - largest_change)
        return actions[left.argmin(1)]


def read_map(limits):
    """The shipped map of the simulator with these limits: steps [A, 2, 3], moves [A, 3], V, and how
    far an action may be from the last one. Raises an InputError if there is no map for these
    limits. (If you have changed the walk, the moves are still those of the shipped walk.)
    """
    for path in common.RESULTS.glob("*/search.npz"):
        with np.load(path) as file:
            about = json.loads(str(file["about"]))
            if about["step limit"] == ppo.as_json(limits):
                value = file["twentieths"].astype(np.float32) / 20
                return file["steps"], file["moves"], value, about["change"]
    raise robot_model.InputError(
        f"no map of search for the step limit {limits}: python tests/studies/search.py makes one, "
        "with --out results/pymunk/studies or, with --mujoco, results/mujoco/studies"
    )


def write_map(path, sim, factor, known):
    """Writes the file for `read_map`."""
    steps, moves, value, change = known
    about = {"step limit": ppo.as_json(env.LIMITS[sim]), "factor": factor, "change": change}
    told = {"about": json.dumps(about), "steps": steps, "moves": moves}
    told["twentieths"] = np.round(20 * value).astype(np.uint16)
    robot_model.atomic_write(path, lambda file: np.savez_compressed(file, **told))


DURATION = "6 minutes on two cores; 3-D: 10 minutes"
FACTORS = (0.3, 0.45, 0.6, 0.8, 1.0)  # [-] on the limits of a step
CHANGES = (0.2, 0.35, 1.0)
WALKS = 100  # near ones and as many far ones


def make_map(sim, factor):
    """steps, moves, V for double steps up to this share of the limits, rounded as in the file."""
    steps = double_steps(env.LIMITS[sim], factor)
    moves, stood = displacements(sim, steps)
    value = np.round(20 * steps_to_go(moves[stood], env.Task())) / 20
    return steps[stood], moves[stood], value


def study(args):
    """Tries every size with every largest change, and writes the best one's map."""
    tried, world = [], common.world(args.sim)
    maps = {factor: make_map(args.sim, factor) for factor in FACTORS}
    for factor, change in product(FACTORS, CHANGES):
        planner = Planner((*maps[factor], change))
        ended = common.near_and_far(planner, world, per_set=WALKS, purpose="tuning")
        tried.append({"factor": factor, "change": change, **baseline.facts(ended)})
    # The planner aims at the edge of the tolerance; leaving it again costs nothing here.
    best = min(tried, key=lambda row: baseline.cost(row | {"still_there": 1.0}))
    known = *maps[best["factor"]], best["change"]
    write_map(args.out.parent / "search.npz", args.sim, best["factor"], known)
    return [row | {"chosen": row is best} for row in tried]


PARTS = {"maps": study}
COLUMNS = {
    "maps": {"factor": 2, "change": 2, "time": 2, "fall": 4, "timeout": 4}
    | {"still_there": 3, "chosen": 0}
}


if __name__ == "__main__":
    common.start("search")
