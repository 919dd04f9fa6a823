"""Standing, lying, and the ways between them: joints that go from one posture to the next."""

import math

import numpy as np

from ..body import STEP
from .gait import STANCE, pull
from .physics import Array, Physics

LINK, SIDE = 0.213, 0.0955  # m: thigh and calf; from the hip's axis out to the leg
HIPS = np.array([[x, y, 0.0] for x in (0.1934, -0.1934) for y in (-0.0465, 0.0465)])  # FR FL RR RL
OUT = np.array([-1.0, 1.0, -1.0, 1.0])  # which side a leg is on
FOLDED = np.array([0.0, 1.36, -2.6] * 4)  # rad
GAINS = 60.0, 2.0  # N m/rad, N m s/rad
FASTEST = 3.0  # rad/s, of a joint between two postures
NEAR = 0.25  # rad, how near a joint has to be to where it should


def feet(joints: Array) -> Array:
    """Where the feet's middles are (4, 3), seen from the trunk, for the joints' angles (12,)."""
    hip, thigh, calf = joints.reshape(4, 3).T
    x = -LINK * (np.sin(thigh) + np.sin(thigh + calf))
    down = LINK * (np.cos(thigh) + np.cos(thigh + calf))
    side = OUT * SIDE
    y = side * np.cos(hip) + down * np.sin(hip)
    z = side * np.sin(hip) - down * np.cos(hip)
    return HIPS + np.stack([x, y, z], axis=-1)


def joints_for(places: Array) -> Array:
    """The joints' angles (12,) that put the feet there (4, 3), or as near as legs are long."""
    x, y, z = (places - HIPS).T
    side = OUT * SIDE
    down = np.sqrt(np.maximum(y**2 + z**2 - side**2, 0.1**2))
    hip = np.arctan2(y, -z) - np.arctan2(side, down)
    reach = np.clip(np.hypot(x, down), 0.12, 0.998 * 2 * LINK)
    calf = -np.arccos(reach**2 / (2 * LINK**2) - 1)
    thigh = np.arctan2(-x, down) - calf / 2
    return np.stack([hip, thigh, calf], axis=-1).reshape(12)


def stance(euler: tuple[float, float, float], height: float) -> Array:
    """The joints (12,) of a stand whose trunk is turned by roll, pitch, yaw, and so much higher."""
    roll, pitch, yaw = euler
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in (roll, pitch, yaw))
    turned = np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
    on_the_floor = feet(STANCE) - [0.0, 0.0, height]
    return joints_for(on_the_floor @ turned)  # each foot seen from the turned trunk


class Postures:
    """Takes the joints from where they are through postures to the last, and holds that."""

    def __init__(self) -> None:
        self._target, self._way = STANCE, [STANCE]

    def go(self, physics: Physics, *way: Array) -> None:
        """Sets out from where the joints are, through those postures."""
        self._target, self._way = physics.joints.copy(), [*way]

    def hold(self, last: Array) -> None:
        """Changes the posture in which the way ends."""
        self._way[-1] = last

    def arrived(self, physics: Physics) -> bool:
        """Whether the last posture is taken."""
        there = len(self._way) == 1 and np.allclose(self._target, self._way[0])
        return there and float(np.abs(physics.joints - self._target).max()) < NEAR

    def torques(self, physics: Physics) -> Array:
        """The joints' torques (12,)."""
        most = FASTEST * STEP
        self._target = self._target + np.clip(self._way[0] - self._target, -most, most)
        if len(self._way) > 1 and np.allclose(self._target, self._way[0]):
            del self._way[0]
        return pull(physics, self._target, GAINS)
