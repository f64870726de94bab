"""Another engine: our robot in PyBullet, for the study `transfer`. Its methods are those of MujocoSim.

    python -m pip install --only-binary=:all: pybullet==3.2.7

The servo is that of stage 1, τ = clip(stiffness·(target − q), ± limit) − damping·q̇, computed anew
every 2 ms and given as a torque: PyBullet's own position motor follows another law. Six things that
cost us time, in case you build a simulator, too:
- PyBullet has no `armature`. The inertia of a rotor is added to the link below its joint, about the
  axis of the joint. (With the light link alone, 2 ms would be too long for this stiffness.)
- A link has one joint. So where two axes meet, in hip and ankle, a link of 1 g stands between them.
- The position of the base is that of its centre of mass, not that of its frame.
- Dry friction is a motor that tries to hold its joint still, with the torque `stiction` at most.
- PyBullet multiplies the μ of two shapes: that of the floor is 1. Its friction cone is round only
  with enableConeFriction.
- `createMultiBody` ignores inertias and joint limits: `changeDynamics` sets them afterwards.
Every robot has a world of its own, so that some can walk while others wait; a reset builds it again.
"""

from functools import partial

import numpy as np
from common import robot_model

PIP = "python -m pip install --only-binary=:all: pybullet==3.2.7"
AXES = np.tile(np.eye(3)[[2, 0, 1, 1, 1, 0]], (2, 1))  # [12, 3] z, x, y, y, y, x in both legs
PARENTS = [0, 1, 2, 3, 4, 5, 0, 7, 8, 9, 10, 11]  # of the twelve links; 0: torso
MASS = [0, 1, 1, 2, 3, 4, 4, 5, 5, 6, 7, 8, 8]  # columns of Body.mass: torso, then the links
MIRROR = np.repeat([[1, 1, 1], [1, -1, 1]], 6, 0)  # [12, 3] of a place in the left, the right leg
STEPS = 5  # of physics in a control tick
FLOOR, ROBOT, JOINTS = 0, 1, [*range(12)]  # PyBullet counts the bodies of a world, and its joints


class World:
    """One of PyBullet's worlds: all of its functions."""

    def __init__(self):
        try:
            import pybullet
        except ImportError as error:
            raise robot_model.InputError(f"PyBullet is not installed: {PIP}") from error
        self.bullet = pybullet
        self.number = pybullet.connect(pybullet.DIRECT)

    def __getattr__(self, name):
        return partial(getattr(self.bullet, name), physicsClientId=self.number)


class BulletSim(robot_model.Simulator):
    """N robots in PyBullet. Columns of `state` [N, 21]: the torso's pose (x, y, z, roll, pitch, yaw),
    its angular velocity about its own axes, the twelve joint angles."""

    def __init__(self, sim, num_robots, standing, robot, cores=None):
        super().__init__(num_robots, standing, robot)
        between = robot_model.Link(0.001, (0, 0, 0), (1e-5, 1e-5, 1e-5))
        leg = between, robot.hip, robot.thigh, robot.shin, between, robot.foot
        self.links = robot.torso, *leg, *leg
        self.limit, self.damping = np.tile([robot.torque_limit, robot.damping], 2)  # [12] each
        self.body = robot_model.Body.as_model(robot, num_robots)
        self.state = np.zeros((num_robots, 21))
        self.worlds = [World() for _ in range(num_robots)]
        self.reset(np.arange(num_robots))

    def place(self, robots, body):
        """See `Simulator`."""
        if body is not None:
            for name, values in vars(body).items():
                getattr(self.body, name)[robots] = values
        for i in robots:
            self.build(self.worlds[i], i)
            self.state[i] = self.read(i)

    def build(self, world, i):
        """Floor and standing robot i."""
        robot, body, bullet = self.robot, self.body, world.bullet
        torso, joints = self.standing
        world.resetSimulation()
        world.setGravity(0, 0, -robot.gravity)
        world.setPhysicsEngineParameter(robot.control_dt / STEPS, enableConeFriction=1)
        world.createMultiBody(0, world.createCollisionShape(bullet.GEOM_PLANE))
        world.changeDynamics(FLOOR, -1, lateralFriction=1)
        places, soles = np.zeros((2, 6, 3)), [-1] * 12  # of the joints, seen from those above
        places[:, 0] = robot.hips
        places[:, 2, 0] = robot.hip_x
        places[:, [3, 4], 2] = -robot.thigh_length, -robot.shin_length
        half = (
            np.array([robot.foot_front + robot.foot_back, robot.foot_width, robot.sole_height]) / 2
        )
        middle = robot.foot_front - half[0], robot.foot_outward, half[2] - robot.ankle_height
        for k in (5, 11):
            soles[k] = world.createCollisionShape(
                bullet.GEOM_BOX, halfExtents=half, collisionFramePosition=MIRROR[k] * middle
            )
        mass = body.mass[i, MASS] * [link.mass for link in self.links]  # [13]
        centre = robot.torso.com + body.com[i]
        straight = [[0, 0, 0, 1]] * 12
        world.createMultiBody(
            mass[0],
            basePosition=torso[:3] + robot_model.rotation(*torso[3:]) @ centre,
            baseOrientation=world.getQuaternionFromEuler(torso[3:]),
            baseInertialFramePosition=centre,
            linkMasses=mass[1:],
            linkCollisionShapeIndices=soles,
            linkVisualShapeIndices=[-1] * 12,
            linkPositions=places.reshape(12, 3),
            linkOrientations=straight,
            linkInertialFramePositions=MIRROR * [link.com for link in self.links[1:]],
            linkInertialFrameOrientations=straight,
            linkParentIndices=PARENTS,
            linkJointTypes=[bullet.JOINT_REVOLUTE] * 12,
            linkJointAxis=AXES,
            flags=bullet.URDF_USE_SELF_COLLISION,  # the feet touch one another
        )
        rotors = robot.armature * np.vstack([np.zeros(3), AXES])  # [13, 3]
        for k, link in enumerate(self.links):
            world.changeDynamics(
                ROBOT,
                k - 1,  # -1: the base
                lateralFriction=body.friction[i],
                localInertiaDiagonal=body.mass[i, MASS[k]] * np.array(link.inertia) + rotors[k],
                linearDamping=0,
                angularDamping=0,
                jointDamping=0,
                jointLowerLimit=robot.joint_min[k % 6 - 1],  # the base has no joint
                jointUpperLimit=robot.joint_max[k % 6 - 1],
            )
        for k in JOINTS:
            world.resetJointState(ROBOT, k, joints[k])
        mode = bullet.VELOCITY_CONTROL
        world.setJointMotorControlArray(ROBOT, JOINTS, mode, forces=body.stiction[i])

    def read(self, i):
        """The state [21] of robot i."""
        world = self.worlds[i]
        centre, (*xyz, w) = world.getBasePositionAndOrientation(ROBOT)
        angles = robot_model.euler(np.array([w, *xyz]))
        turn = robot_model.rotation(*angles)
        place = centre - turn @ (self.robot.torso.com + self.body.com[i])
        omega = turn.T @ world.getBaseVelocity(ROBOT)[1]
        joints = [angle for angle, *_ in world.getJointStates(ROBOT, JOINTS)]
        return np.concatenate([place, angles, omega, joints])

    def imu(self, robots):
        """See `Simulator`."""
        return self.state[robots, 3:5], self.state[robots, 6:8]

    def advance(self, robots, targets, push):
        """See `Simulator`; the targets' rates are not used."""
        states = np.empty((*push.shape[:2], 21))
        gains = self.robot.stiffness * self.body.stiffness[robots]  # [n, 12]
        for row, tick in np.ndindex(push.shape[:2]):
            world, target = self.worlds[robots[row]], targets[row, tick, 0]
            mode, frame = world.bullet.TORQUE_CONTROL, world.bullet.WORLD_FRAME
            for _ in range(STEPS):
                q, rate = np.array([s[:2] for s in world.getJointStates(ROBOT, JOINTS)]).T
                # τ = clip(k·(target − q), ± limit) − d·q̇
                torque = np.clip(gains[row] * (target - q), -self.limit, self.limit)
                torque -= self.damping * rate
                world.setJointMotorControlArray(ROBOT, JOINTS, mode, forces=torque)
                if push[row, tick].any():  # a force lasts for one step
                    centre, _ = world.getBasePositionAndOrientation(ROBOT)
                    force = [*push[row, tick], 0]
                    world.applyExternalForce(ROBOT, -1, force, centre, frame)
                world.stepSimulation()
            states[row, tick] = self.read(robots[row])
        self.state[robots] = states[:, -1]
        return states

    def motion(self, robots, plan, states, ticks):
        """See `Simulator`."""
        seen = states[:, 1:]
        lost = ~np.isfinite(states).all((1, 2))
        return seen[..., :6], seen[..., 9:], seen[:, -1, 6:9], lost

    def close(self):
        """Ends its worlds."""
        for world in self.worlds:
            world.disconnect()
