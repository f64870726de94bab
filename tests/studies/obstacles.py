"""Can a robot walk around obstacles that its planner does not see? By intermediate goals.

    python tests/studies/obstacles.py [--mujoco] [--only PART] [--out FOLDER]

Discs lie on the floor (the paper's outlook, section IV). The shortest path around them is computed
once, from the true start on the true map. It leads over the corners of polygons around the discs,
inflated by MARGIN (a visibility graph). Its corners are the intermediate goals. On its way the
robot knows only the noisy estimate of its next goal, as always. By this estimate it also decides
when to take the goal after it. So any planner works with such a chain, unchanged.

A walk touches a disc if, at any time, a sole or the torso's column comes over it. (A swinging foot
counts, too.) For comparison the robot walks to the same goals without discs.
"""

from dataclasses import dataclass

import common
import networkx  # PyTorch brings it along
import numpy as np
from common import env, evaluate, robot_model

DURATION = "2 minutes; 3-D: 6 minutes"
FIELDS = 200
SEED = 0  # of the stream "evaluation"; margin and nearness were chosen in "tuning"
DISCS = 3, 8  # how many, from … to …
RADIUS = 0.10, 0.25  # [m]
DISTANCE = 2.0, 3.0  # [m] of the goal
ASIDE = 0.8  # [m] of a disc from the straight path, at most
MARGIN = 0.32  # [m] from a disc's edge to where the torso's middle may go
CORNERS = 16  # of the polygon around a disc
NEAR = 0.25  # [m] estimated distance of a goal at which the one after it becomes the next
TORSO = 0.12  # [m] radius of its column
SPEED = 0.35  # [m/s] with which the times are compared; about that of 3-D robots straight ahead


@dataclass
class Field:
    """Discs [k, 3] (x, y, radius [m]); the path [c, 3] around them: poses, the last is the goal."""

    discs: np.ndarray
    way: np.ndarray

    @property
    def length(self):
        """From the origin over all corners [m]."""
        return np.linalg.norm(np.diff(self.way[:, :2], axis=0, prepend=0), axis=1).sum()


def gaps(start, end, discs):
    """How far straight lines from start to end [..., 2] pass from the discs' middles, [..., k] [m]."""
    line = (end - start)[..., None, :]
    to = discs[:, :2] - start[..., None, :]  # [..., k, 2]
    # The nearest point of the line, as a part of it
    part = np.clip((to * line).sum(-1) / np.maximum((line**2).sum(-1), 1e-9), 0, 1)
    return np.linalg.norm(to - part[..., None] * line, axis=-1)


def shortest_way(goal, discs):
    """Corners [c, 3] of the path from the origin to the goal [3] that keeps MARGIN, or None. The
    yaw of a corner is that of the path behind it.
    """
    reach = discs[:, 2] + MARGIN  # [k]
    angle = np.arange(CORNERS) / CORNERS * 2 * np.pi
    circle = robot_model.turned([1, 0], angle) / np.cos(np.pi / CORNERS)  # [CORNERS, 2]
    corners = discs[:, None, :2] + reach[:, None, None] * circle  # [k, CORNERS, 2]
    points = np.vstack([[0, 0], goal[:2], corners.reshape(-1, 2)])  # [p, 2]
    # Every point with every other one: which of them see each other?
    free = (gaps(points[:, None], points, discs) > reach - 1e-9).all(-1)  # [p, p]
    length = np.linalg.norm(points[:, None] - points, axis=-1)
    graph = networkx.from_numpy_array(np.where(free, length, 0))  # 0: no edge
    if not networkx.has_path(graph, 0, 1):
        return None
    path = points[networkx.shortest_path(graph, 0, 1, "weight")]  # [c + 1, 2]
    legs = np.diff(path, axis=0)
    heading = np.append(np.arctan2(*legs[1:, ::-1].T), goal[2])
    return np.column_stack([path[1:], heading])


def draw_field(rng):
    """A random field in which a disc is on the straight path, and a detour exists."""
    while True:
        angle, yaw = rng.uniform(-np.pi, np.pi, 2)
        distance, count = rng.uniform(*DISTANCE), rng.integers(*DISCS, endpoint=True)
        middles = rng.uniform([0, -ASIDE], [distance, ASIDE], (count, 2))
        # All of it is turned: the goal may also be behind the robot.
        discs = np.column_stack([robot_model.turned(middles, angle), rng.uniform(*RADIUS, count)])
        goal = np.array([*robot_model.turned([distance, 0], angle), yaw])
        way = shortest_way(goal, discs)
        if way is not None and len(way) > 1:
            return Field(discs, way)


def draw_fields(count):
    """Fields, and the Trials of their goals; a field does not depend on `count`."""
    fields = [draw_field(env.stream("evaluation", SEED, i)) for i in range(count)]
    return fields, evaluate.Trials(np.array([field.way[-1] for field in fields]), SEED)


@dataclass
class Chain:
    """A planner with intermediate goals: robot i walks along ways[i], poses [c, 3]."""

    planner: object
    world: env.FootstepWorld
    ways: list

    def reset(self, num_robots):
        self.next = np.zeros(num_robots, int)
        self.planner.reset(num_robots)
        self.aim(np.arange(num_robots))

    def aim(self, robots):
        """Makes the next goal of these robots that of the world."""
        self.world.set_goal(robots, [self.ways[i][self.next[i]] for i in robots])

    def act(self, view):
        left = np.array([len(self.ways[i]) - 1 - self.next[i] for i in view.robots])
        near = (env.polar(view.goal)[0] < NEAR) & (left > 0)  # [n]
        robots = view.robots[near]
        if len(robots):
            self.next[robots] += 1
            self.aim(robots)
            seen = self.world.view(robots)
            view.goal[near], view.observation[near] = seen.goal, seen.observation
        return self.planner.act(view)


def touching(robot, motion, fields):
    """Did a sole or the torso come over a disc? [n] bool, for n fields with a robot in each."""
    inner, outer = robot.foot_outward + np.array([-0.5, 0.5]) * robot.foot_width  # edges of a sole
    found = []
    # Every 40 ms, torso [t, 6] and joints [t, 12]
    for field, torso, joints in zip(fields, motion.torso[:, ::4], motion.joints[:, ::4]):
        discs, radius = field.discs[:, :2], field.discs[:, 2]  # [k, 2], [k]
        feet = evaluate.foot_poses(robot, torso, joints)[:, :, None]  # [t, 2, 1, 3]
        # A disc's middle seen from a foot [t, 2, k], and the point of the sole that is nearest to it
        x, y = np.moveaxis(robot_model.turned(discs - feet[..., :2], -feet[..., 2]), -1, 0)
        y[:, robot_model.RIGHT] *= -1  # as if it were a left foot
        sole = np.hypot(x - x.clip(-robot.foot_back, robot.foot_front), y - y.clip(inner, outer))
        column = np.linalg.norm(discs - torso[:, None, :2], axis=-1) - TORSO  # [t, k]
        found.append((sole < radius).any() or (column < radius).any())
    return np.array(found)


def walk_fields(planner, world, fields, trials):
    """What `evaluate` returns of walks around the discs, and which of them touched one [n]."""
    touched = np.zeros(len(fields), bool)

    def watch(robots, motion):
        touched[robots] |= touching(world.engine.robot, motion, [fields[i] for i in robots])

    chain = Chain(planner, world, [field.way for field in fields])
    return evaluate.evaluate(chain, world, trials, watch), touched


def study(args):
    """Rows of the policy and the tuned baseline, around the discs and to the same goals without."""
    fields, trials = draw_fields(FIELDS)
    straight = np.linalg.norm(trials.goals[:, :2], axis=1)
    length = np.array([field.length for field in fields])
    planners = common.opponents(args.sim) | {"policy": common.shipped(args.sim)}
    world, rows, touched = common.world(args.sim, num_robots=FIELDS), [], []

    def add_row(name, ended, way, **more):
        row = common.row_of(ended, name, **more)
        least = way[ended["outcome"] == "success"] / SPEED  # [s]
        rows.append(row | {"time_over_way": row["time_mean"] / least.mean()})

    for name in ("policy", "baseline_tuned"):
        ended, touches = walk_fields(planners[name], world, fields, trials)
        touched.append(touches)
        add_row(name, ended, length, discs=True, touches=touches.mean())
        ended = evaluate.evaluate(planners[name], world, trials)
        add_row(name, ended, straight, discs=False)
    return {"rows": rows, "fields": FIELDS, "touches": evaluate.mcnemar(*touched)}


def draw_discs(axes, field):
    """Draws the discs, grey, and the shortest path around them."""
    for *middle, radius in field.discs:
        circle = robot_model.turned([radius, 0], np.linspace(0, 2 * np.pi, 60))
        axes.fill(*(middle + circle).T, color="0.45", lw=0, zorder=0.4)
    way = np.vstack([[0, 0], field.way[:, :2]])
    axes.plot(*way.T, "k:", lw=1, zorder=0.4)


def plot(found, sim):
    """Draws three fields from above, and walks of the policy in them."""
    figure, grid = common.subplots(1, 3, figsize=(11, 4.2))
    world = common.world(sim, num_robots=1)
    for axes, field in zip(grid, draw_fields(3)[0][::-1]):
        draw_discs(axes, field)
        chain = Chain(common.shipped(sim), world, [field.way])
        one = evaluate.Trials(field.way[-1:], SEED)
        title = f"shortest way {field.length:.1f} m{evaluate.draw_walks(axes, world, chain, one)}"
        middle = (field.way.max(0) + field.way.min(0))[:2] / 2  # of the figure
        (left, low), (right, high) = middle - [1.8, 1.5], middle + [1.8, 1.5]
        axes.set(title=title, xlabel="x [m]", ylabel="y [m]", aspect="equal")
        axes.axis((left, right, low, high))
    figure.suptitle(
        f"The policy around discs, with noise. Dotted: the shortest way that keeps {MARGIN} m from them\n"
        f"Line: the torso. Blue: left foot, orange: right foot. Green: the goal ({sim})"
    )
    return figure


PARTS = {"walks": study}


COLUMNS = {
    "walks": {"planner": 0, "discs": 0, "success": 3, "touches": 3, "fall": 3, "time_mean": 1}
    | {"time_over_way": 2}
}


if __name__ == "__main__":
    common.start("obstacles")
