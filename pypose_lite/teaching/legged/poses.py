"""Where all joints of a dog were on its walk, in the plane of the waypoints."""

import math
from typing import Any

import numpy as np

from ...go1.robot import Robot
from ...go1.simulator.legs import parts
from ...go1.simulator.legs.dog import LeggedDog
from .scene import Array

Pose = tuple[float, float, float]


def walked(robot: Robot, start: Pose = (0.0, 0.0, 0.0), seconds: float = math.inf) -> Array:
    """The latest of a dog's film: time in s, then the positions of all joints, rows (T, 20).

    These are true, whatever the robot's odometry says.

    Args:
        robot: as `connect("sim:legs")` returns it, after the walk and before it is closed, since
            it stands for a moment when that is done.
        start: where it stood when it was switched on, (x, y, heading) in m and rad, as `connect`
            was told: the plane in which the rows are.
        seconds: how many of the last ones.

    Raises:
        ValueError: it is no simulated robot with legs.
    """
    dog = robot.simulator and robot.simulator.dog
    if not isinstance(dog, LeggedDog):
        raise ValueError(f"robot: expected a simulated one with legs, got {robot.address!r}")
    film = np.array([(time, *joints) for time, joints in dog.film])
    film = film[film[:, 0] >= film[-1, 0] - seconds - 1e-9]
    x, y, heading = dog.pose  # since it was switched on
    c, s = math.cos(start[2]), math.sin(start[2])
    now = start[0] + c * x - s * y, start[1] + s * x + c * y, start[2] + heading
    physical = (*dog.physics.place_of_trunk[:2], dog.physics.heading)
    return np.hstack([film[:, :1], moved(film[:, 1:], physical, now)])


def moved(joints: Array, here: Pose, there: Pose) -> Array:
    """Joints (T, 19), moved in the plane so that what was at one pose is at another."""
    turn = there[2] - here[2]
    c, s = math.cos(turn), math.sin(turn)
    x, y = joints[:, 0] - here[0], joints[:, 1] - here[1]
    a, b, p, q = joints[:, 3:7].T  # quaternion: w, x, y, z
    ch, sh = math.cos(turn / 2), math.sin(turn / 2)
    result = joints.copy()
    result[:, 0], result[:, 1] = there[0] + c * x - s * y, there[1] + s * x + c * y
    result[:, 3:7] = np.stack(
        [ch * a - sh * q, ch * b - sh * p, ch * p + sh * b, ch * q + sh * a]
    ).T
    return result


def snapshots(joints: Array, apart: float) -> Array:
    """Of joints (T, 19), those that can stand in one picture (D, 19): no two nearer than that, m.

    The first is taken, and then each that is far enough from all that were taken before.
    """
    taken = joints[:1]
    for row in joints:
        if np.hypot(*(taken[:, :2] - row[:2]).T).min() >= apart:
            taken = np.vstack([taken, row])
    return taken


class Skeleton:
    """The bodies' positions, by MuJoCo's kinematics, which needs no OpenGL.

    Attributes:
        half: lengths of the trunk's box (3,), m.
    """

    def __init__(self) -> None:
        self._mujoco = parts.package("mujoco")
        self._model: Any = parts.body(parts.Floor())
        self._data = self._mujoco.MjData(self._model)
        box = self._mujoco.mjtGeom.mjGEOM_BOX
        first = self._model.body("base").geomadr[0]
        own = range(first, first + self._model.body("base").geomnum[0])
        [trunk] = [geom for geom in own if self._model.geom_type[geom] == box]
        self.half = self._model.geom_size[trunk].copy()

    def __call__(self, joints: Array) -> tuple[Array, Array]:
        """The trunk's corners (2, 2, 2, 3) and the legs (4, 4, 3): hip, thigh, calf, foot; m."""
        data = self._data
        data.qpos[:] = joints
        self._mujoco.mj_kinematics(self._model, data)
        signs = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1], indexing="ij"), axis=-1)
        rotation = data.body("base").xmat.reshape(3, 3)
        corners = data.body("base").xpos + (signs * self.half) @ rotation.T
        legs = [
            [data.body(f"{leg}_{part}").xpos for part in ("hip", "thigh", "calf")]
            + [data.geom(leg).xpos]
            for leg in parts.LEGS
        ]
        return corners, np.array(legs)
