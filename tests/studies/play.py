"""How does a planner walk? Click a goal, and watch.

    python tests/studies/play.py [--mujoco] [--planner FILE.py] [--robot FILE.py]

A click sets a goal, dragging gives its heading, the space bar pushes the robot. Yellow are the two
footsteps that the planner has just chosen. It is your own planner if you name one, else the policy.
Of stage 5's other flags these act here, too: --policy, --noise, --friction, --push (how hard the
space bar pushes, 0.6 m/s by default). The window needs a display.
"""

import math

import matplotlib.pyplot as plt
import numpy as np
from common import env, evaluate, robot_model, walk_engine


class PushedWorld(env.FootstepWorld):
    """A FootstepWorld in which you push all robots, as their next double step begins."""

    shove = 0, 0  # [m/s] of their torsos along the world's x and y; planar: ahead

    def _disturbance(self, plan, robots):
        disturbance = super()._disturbance(plan, robots)
        force = walk_engine.push_force(self.engine.robot, np.array(self.shove))  # [2] [N]
        disturbance.push[:, : walk_engine.PUSH_TICKS] += force
        return disturbance


def draw_scene(axes, world, feet, torso, joints, chosen):
    """Clears the axes and draws a robot on its way to its goal; returns the camera. Footprints
    [K, 2, 3], torso [6], joints [12], footsteps that are chosen and not taken yet [2, 3]."""
    robot, camera = world.engine.robot, robot_model.camera_at()
    axes.clear()
    robot_model.draw_ground(axes, camera, 4)
    env.draw_way(axes, world, world.goal[0], feet, camera)
    x, y, _ = world.goal[0]
    pole = camera[1:] @ [[x, x], [y, y], [0, 0.4]]  # [m], so that nobody overlooks the goal
    axes.plot(*pole, "s-", color="magenta", lw=3, markevery=[1], ms=12, zorder=0.6)
    for side, color in enumerate(robot_model.COLORS):
        outline = env.sole(robot, side)
        env.draw_shape(axes, chosen[side], outline, camera, ec=color, fc="yellow")
    robot_model.draw_robots(axes, robot, torso[None], joints[None], camera)
    return camera


def pictures(axes, world, planner, feet, push, name, window=(-1.7, 1.7, -1, 1.6)):
    """Lets the first robot do a double step, and draws it. Yields the result of `double_step` after
    every picture, one for eight ticks. Yellow: the footsteps that were chosen, from where the right
    foot stood. feet: a list of earlier ones [2, 3]; those at the beginning are added. push [2]: see
    `PushedWorld.shove`. (The planar robot's left foot lands to the right of its mark: it cannot
    spread its legs.)"""
    engine, began = world.engine, world.ticks[0]
    world.shove = push
    result = evaluate.double_step(planner, world, np.array([0]))
    motion = result["motion"]
    torso, joints = motion.torso[0], motion.joints[0]  # [T, 6], [T, 12]
    feet += [*evaluate.foot_poses(engine.robot, torso[:1], joints[:1])]
    steps = env.to_footsteps(world.last_action[:1], world.limits)
    chosen = np.concatenate(engine.landings(feet[-1][None, robot_model.RIGHT], steps))  # [2, 3]
    for tick in range(0, motion.ticks[0], 8):
        now = torso[tick]
        camera = draw_scene(axes, world, feet[-20:], now, joints[tick], chosen)
        if any(push):  # it lasts for 5 ticks, which nobody would see
            torso_at = camera[1:] @ now[:3]
            x, y = robot_model.turned(push, now[5] * engine.planar)  # drawn as 1 m for 1 m/s
            arrow = camera[1:] @ [x, y, 0]
            text = f"push: {math.hypot(*push):.1f} m/s"
            style = {"color": "tab:red"}
            axes.annotate(text, torso_at, torso_at - arrow, arrowprops=style, **style)
        seconds = (began + tick) * engine.robot.control_dt
        axes.set_title(f"{name}\n{seconds:.1f} s", parse_math=False)
        axes.axis(window)
        yield result


def open_window():
    """An empty figure on the screen, and its axes."""
    plt.rcParams["toolbar"] = "None"  # every picture sets its own axes, so nobody can zoom
    figure, axes = plt.subplots(figsize=(9, 7))
    if plt.get_backend() == "agg":  # which Matplotlib takes where it can open no window
        raise robot_model.InputError("this needs a display, and Tk or Qt (pip install pyqt6)")
    return figure, axes


def play(world, name, planner, push):
    """Lets a robot walk to where the mouse is pressed, until the window closes. Dragging gives the
    goal's heading; space is a push [2]. After a fall the robot stands at the origin again."""
    figure, axes = open_window()
    figure.supxlabel("click: a goal; drag: its heading; space: a push")
    keys, pressed, feet = [], np.zeros(2), []  # pressed: where the mouse was, x, y [m]

    def ground(event):
        """The place on the floor, x, y [m], to which the mouse points; nan: beside the picture."""
        place = np.array([event.xdata, event.ydata], float)  # of None it makes nan
        return np.linalg.solve(robot_model.camera_at()[1:, :2], place)

    def press(event):
        pressed[:] = ground(event)

    def release(event):
        x, y = ground(event) - pressed
        if np.isfinite(x):
            world.set_goal([0], [*pressed, math.atan2(y, x)])

    connect = figure.canvas.mpl_connect
    connect("button_press_event", press)
    connect("button_release_event", release)
    connect("key_press_event", lambda event: keys.append(event.key))
    world.goal[0], fell = evaluate.FIGURE_GOALS[0], True
    while plt.fignum_exists(figure.number):
        if fell:
            world.reset([0], goals=world.goal[:1])
            planner.reset(1)
            feet.clear()
        pushed = push if " " in keys else (0, 0)
        keys.clear()
        for result in pictures(axes, world, planner, feet, pushed, name):
            plt.pause(0.04)  # half of the 0.08 s of eight ticks; to draw takes about the other half
            fell = result["fall"][0]


def main(argv=None):
    args = evaluate.arguments(argv, __doc__)
    world = PushedWorld(1, noise=args.noise, **evaluate.world_settings(args))
    planners = evaluate.choose_planners(world, args.policy, args.planner)
    name = [*planners][-3]  # the last one that you chose; both baselines follow
    with env.one_line_if_it_exits(type(planners[name]).__module__):  # its file
        play(world, name, planners[name], (args.push or 0.6, 0))


if __name__ == "__main__":
    robot_model.run_script(main)
