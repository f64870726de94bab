"""Another engine: our robot in PyBullet, for the study `transfer`.

    python -m pip install --only-binary=:all: pybullet==3.2.7

MuJoCo's model of a robot holds all of its numbers: masses, places, motors, a Body. `BulletSim` hands
them to PyBullet. So only the methods `place` and `advance` differ from those of MujocoSim. The servo is that of stage 1, computed
again every 2 ms and given as a torque, because PyBullet's own position motor follows another law.
Traps:
- PyBullet has no `armature`. We add the inertia of a rotor to the link below its joint, about the
  axis of the joint. (With the light link alone, 2 ms would be too long for this stiffness.)
- A link has one joint. Where two axes meet, in hip and ankle, a link of 1 g is between them.
- `createMultiBody` takes the place of the torso's frame, but what we read later is the place of its
  centre of mass. (If they are confused, the robots begin 12 cm above the floor, fall onto it, and
  most of them walk on.)
- Dry friction is a motor that tries to hold its joint still, with at most that torque.
- PyBullet multiplies the μ of two shapes, so that of the floor is 1. Its friction cone is round only
  with enableConeFriction.
- `createMultiBody` takes no inertias, and leaves the joints' damping undefined: `changeDynamics` sets
  both. (It takes no joint limits either. We leave them out, because no walk comes near them.)
Every robot has a world of its own, because some walk while others wait. A reset builds the world
again. (For each world PyBullet prints a line `argv[0]=`.)
"""

import numpy as np
from common import robot_model

PIP = "python -m pip install --only-binary=:all: pybullet==3.2.7"
STEPS = 5  # of physics in a control tick
FLOOR, ROBOT, JOINTS = 0, 1, [*range(12)]  # PyBullet counts the bodies of a world, and its joints


class BulletSim(robot_model.MujocoSim):
    """N robots in PyBullet."""

    def __init__(self, num_robots, standing, robot):
        try:
            import pybullet
            from pybullet_utils.bullet_client import BulletClient
        except ImportError as error:
            raise robot_model.InputError(f"PyBullet is not installed: {PIP}") from error
        # Every world has all of PyBullet's functions and constants. It ends with its object.
        self.worlds = [BulletClient(pybullet.DIRECT) for _ in range(num_robots)]
        super().__init__(num_robots, standing, robot)

    def place(self, i):
        """See `Simulator`."""
        super().place(i)
        self.stand(self.worlds[i], self.models[i])

    def stand(self, world, model):
        """Makes the floor and a standing robot."""
        torso, joints = self.standing
        world.resetSimulation()
        world.setGravity(*model.opt.gravity)
        world.setPhysicsEngineParameter(self.robot.control_dt / STEPS, enableConeFriction=1)
        world.createMultiBody(0, world.createCollisionShape(world.GEOM_PLANE))
        world.changeDynamics(FLOOR, -1, lateralFriction=1)
        # Of the links that make up a body the first one has its place, the last one its mass.
        part = model.jnt_bodyid[5:]  # [13] the torso, then the body below each joint
        last = np.append(np.diff(part) > 0, True)[:, None]  # [13, 1]
        first = np.roll(last, 1)
        axes = model.jnt_axis[6:]
        inertias = np.where(last, model.body_inertia[part], 1e-5)  # [13, 3]
        inertias[1:] += model.dof_armature[6:, None] * axes
        masses = np.where(last[:, 0], model.body_mass[part], 0.001)
        centres = last * model.body_ipos[part]
        nothing, straight = [-1] * 12, [[0, 0, 0, 1]] * 12
        shapes = nothing.copy()
        for k, name in (5, "left sole"), (11, "right sole"):
            sole = model.geom(name)
            shapes[k] = world.createCollisionShape(
                world.GEOM_BOX, halfExtents=sole.size, collisionFramePosition=sole.pos
            )
        world.createMultiBody(
            masses[0],
            basePosition=torso[:3],
            baseOrientation=world.getQuaternionFromEuler(torso[3:]),
            baseInertialFramePosition=centres[0],
            linkMasses=masses[1:],
            linkCollisionShapeIndices=shapes,
            linkVisualShapeIndices=nothing,
            linkPositions=(first * model.body_pos[part])[1:],
            linkOrientations=straight,
            linkInertialFramePositions=centres[1:],
            linkInertialFrameOrientations=straight,
            linkParentIndices=[*range(6), 0, *range(7, 12)],  # 0: the torso
            linkJointTypes=[world.JOINT_REVOLUTE] * 12,
            linkJointAxis=axes,
            flags=world.URDF_USE_SELF_COLLISION,  # the feet touch one another
        )
        for k, inertia in enumerate(inertias, -1):  # -1: the torso
            world.changeDynamics(
                ROBOT,
                k,
                lateralFriction=model.pair_friction[0, 0],
                localInertiaDiagonal=inertia,
                linearDamping=0,
                angularDamping=0,
                jointDamping=0,
            )
        for k, angle in enumerate(joints):
            world.resetJointState(ROBOT, k, angle)
        mode, friction = world.VELOCITY_CONTROL, model.dof_frictionloss[6:]
        world.setJointMotorControlArray(ROBOT, JOINTS, mode, forces=friction)  # to the rate 0

    def advance(self, robots, targets, push, move):
        """See `Simulator`."""
        return np.array([*map(self.tick, robots, targets[:, 1], push)])

    def tick(self, i, aim, force):
        """The state [21] of robot i after a tick with these joint targets [12] and this push [2]."""
        world, model = self.worlds[i], self.models[i]
        limit, gain = model.actuator_forcerange[:, 1], model.actuator_gainprm[:, 0]  # [12] each
        for _ in range(STEPS):
            q, rate = angles_and_rates(world)
            # τ = clip(k·(target − q), ± limit) − d·q̇
            torque = np.clip(gain * (aim - q), -limit, limit) - model.dof_damping[6:] * rate
            world.setJointMotorControlArray(ROBOT, JOINTS, world.TORQUE_CONTROL, forces=torque)
            centre, _ = world.getBasePositionAndOrientation(ROBOT)
            # A force lasts for one step.
            world.applyExternalForce(ROBOT, -1, [*force, 0], centre, world.WORLD_FRAME)
            world.stepSimulation()
        centre, turn = world.getBasePositionAndOrientation(ROBOT)
        tilt = world.getEulerFromQuaternion(turn)  # roll, pitch, yaw
        position = centre - robot_model.rotation(*tilt) @ model.body_ipos[1]
        angles, _ = angles_and_rates(world)
        # The turning rate seen from the yaw: ω = ṙ·(cos pitch, 0, −sin pitch) + (0, ṗ, ẏ), for roll r,
        # pitch p, yaw y
        _, pitch, yaw = tilt
        x, y, z = robot_model.rotation(0, 0, -yaw) @ world.getBaseVelocity(ROBOT)[1]
        rates = x / np.cos(pitch), y, z + x * np.tan(pitch)
        return np.concatenate([position, tilt, angles, rates])


def angles_and_rates(world):
    """Those of the joints [12] each."""
    return np.array([state[:2] for state in world.getJointStates(ROBOT, JOINTS)]).T
