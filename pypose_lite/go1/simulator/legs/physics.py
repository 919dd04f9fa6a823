"""The body in MuJoCo: twelve torques go in; joints, attitude and the feet's forces come out."""

import copy
from random import Random

import numpy as np
from numpy.typing import NDArray

from ..floor import Floor
from . import parts

Array = NDArray[np.float64]
RADIUS = 0.022  # m, of a foot
TRUNK = "base"


class Unstable(RuntimeError):
    """The physics has left what can be computed."""


class Physics:
    """A body on a floor, at rest where the robot was switched on.

    No two bodies are alike: by its seed, a trunk is up to 5 % lighter or heavier, and its middle
    up to 1 cm elsewhere. (Assumed; a dog that is alike in every run drifts the same in every run.)

    Args:
        floor: on which it stands.
        random: from which its build is drawn.

    Attributes:
        torques: what the motors last gave, N m.
    """

    def __init__(self, floor: Floor, random: Random) -> None:
        self._mujoco = parts.package("mujoco")
        self.model = model = copy.copy(parts.body(floor))
        self.data = self._mujoco.MjData(model)
        joints = [model.joint(name) for name in parts.JOINTS]
        self._q = np.array([joint.qposadr[0] for joint in joints])
        self._v = np.array([joint.dofadr[0] for joint in joints])
        motors = [model.actuator(name.removesuffix("_joint")).id for name in parts.JOINTS]
        self._motors, self._limits = np.array(motors), model.actuator_ctrlrange[motors].T
        self._feet = [model.geom(leg).id for leg in parts.LEGS]
        self._trunk = model.body(TRUNK).id
        self.torques, self._force, self._until = np.zeros(12), np.zeros(3), 0.0
        model.body_mass[self._trunk] *= random.uniform(0.95, 1.05)
        for axis in (0, 1):
            model.body_ipos[self._trunk, axis] += random.uniform(-0.01, 0.01)

    def place(self, joints: Array) -> None:
        """Puts it onto the floor with its joints like that, at rest."""
        data = self.data
        self._mujoco.mj_resetData(self.model, data)
        data.qpos[self._q] = joints
        self._mujoco.mj_kinematics(self.model, data)
        rotation = data.xmat[self._trunk].reshape(3, 3)
        above = min((rotation.T @ data.geom_xpos[foot])[2] for foot in self._feet) - RADIUS
        data.qpos[:3] -= above * rotation[:, 2]
        self._mujoco.mj_forward(self.model, data)

    def step(self, torques: Array) -> None:
        """Moves on by a step of the model, the motors giving those torques as far as they can.

        Raises:
            Unstable: a torque, or a number of the body, is not finite (any more).
        """
        data = self.data
        if not np.isfinite(torques).all():  # MuJoCo itself would take them for zeros
            raise Unstable(f"the motors were asked for a NaN after {self.time:.2f} s")
        data.ctrl[self._motors] = self.torques = np.clip(torques, *self._limits)
        data.xfrc_applied[self._trunk, :3] = self._force if self.time < self._until else 0.0
        self._mujoco.mj_step(self.model, data)
        if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
            raise Unstable(f"the physics became unstable after {self.time:.2f} s: a NaN")

    def push(self, force: tuple[float, float, float], seconds: float) -> None:
        """Pushes the trunk for so long: newtons ahead, left and up, as it is turned now."""
        x, y, up = force
        c, s = np.cos(self.heading), np.sin(self.heading)
        self._force = np.array([c * x - s * y, s * x + c * y, up])
        self._until = self.time + seconds

    @property
    def time(self) -> float:
        """Seconds since it was placed."""
        return self.data.time

    @property
    def joints(self) -> Array:
        """The joints' angles (12,), rad."""
        return self.data.qpos[self._q]

    @property
    def speeds(self) -> Array:
        """The joints' speeds (12,), rad/s."""
        return self.data.qvel[self._v]

    @property
    def accelerations(self) -> Array:
        """The joints' accelerations (12,), rad/s^2."""
        return self.data.qacc[self._v]

    @property
    def place_of_trunk(self) -> Array:
        """Where the trunk is (3,), m."""
        return self.data.qpos[:3]

    @property
    def rotation(self) -> Array:
        """From the body's axes to the world's (3, 3)."""
        w, x, y, z = self.data.qpos[3:7]
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )

    @property
    def heading(self) -> float:
        """Which way it looks, rad."""
        rotation = self.rotation
        return float(np.arctan2(rotation[1, 0], rotation[0, 0]))

    @property
    def gyroscope(self) -> Array:
        """The turn rates about the body's axes (3,), rad/s."""
        return self.data.qvel[3:6]

    @property
    def accelerometer(self) -> Array:
        """What an accelerometer in the body feels (3,), m/s^2."""
        return self.data.sensor("accelerometer").data

    def feet(self) -> tuple[Array, Array]:
        """Where the feet touch or would, and how fast, seen from the trunk by the joints alone.

        Returns:
            Places (4, 3) in m, and velocities (4, 3) in m/s if the trunk were fixed, both along
            the world's axes; the point is the foot's lowest.
        """
        places, velocities = np.empty((4, 3)), np.empty((4, 3))
        jacobian, speeds = np.zeros((3, self.model.nv)), self.data.qvel[6:]
        for i, foot in enumerate(self._feet):
            point = self.data.geom_xpos[foot] - [0.0, 0.0, RADIUS]
            body = self.model.geom_bodyid[foot]
            self._mujoco.mj_jac(self.model, self.data, jacobian, None, point, body)
            places[i] = point - self.place_of_trunk
            velocities[i] = jacobian[:, 6:] @ speeds
        return places, velocities

    def forces(self) -> Array:
        """How strongly each foot is pressed on (4,), N."""
        found, force = np.zeros(4), np.zeros(6)
        for number, contact in enumerate(self.data.contact[: self.data.ncon]):
            for i, foot in enumerate(self._feet):
                if foot in (contact.geom1, contact.geom2):
                    self._mujoco.mj_contactForce(self.model, self.data, number, force)
                    found[i] += force[0]
        return found
