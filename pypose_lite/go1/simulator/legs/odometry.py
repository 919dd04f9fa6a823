"""How far it came, told from the legs: a foot that stands does not move, so the body does.

Seen from the body, a foot on the floor goes backward as fast as the body goes forward:

    v = -(dr + w x r)      r: from the body to the foot; dr: by the joints; w: by the gyroscope

The feet's answers are averaged by how strongly each is pressed on, as a foot that is hardly down
still slides. What slips nevertheless is not seen, and what the gyroscope adds to the heading is
believed: so it drifts, as the odometry of legs does.
"""

import math

import numpy as np

from ..body import STEP, Triple, moved
from .physics import Array, Physics

TOUCH, FIRM = 5.0, 30.0  # N: a foot that is pressed on less does not count, one with more no more
STRIDE = 0.2  # s, over which the weights of the feet are averaged: about a step of the gait
SMOOTH = 0.1  # s, over which the velocity that it tells is averaged; assumed


class Odometry:
    """Where the robot believes that it is, and how fast.

    Args:
        start: where it believes to begin, (x, y, heading) in m and rad.
        physics: the body, as it stands there.

    Attributes:
        place: x and y in m, heading in rad.
        velocity: forward and left in m/s, turn in rad/s, averaged over `SMOOTH`.
        forces: on the feet (4,), N.
        height: m, of the body above the feet that stand.
    """

    def __init__(self, start: Triple, physics: Physics) -> None:
        self.place, self.velocity = start, (0.0, 0.0, 0.0)
        self.forces, self.height = np.zeros(4), 0.0
        self._heading, self._weight = physics.heading, 4 * FIRM

    def see(self, physics: Physics, yaw_drift: float) -> None:
        """Takes a step of the body into account; its gyroscope errs by so many rad/s."""
        places, rates = physics.feet()
        self.forces = physics.forces()
        weights = np.where(self.forces > TOUCH, np.minimum(self.forces, FIRM), 0.0)
        self._weight += STEP / STRIDE * (weights.sum() - self._weight)
        spin = physics.rotation @ physics.gyroscope
        velocity = -weights @ (rates + np.cross(spin, places)) / max(self._weight, FIRM)
        standing = weights.any()
        height = weights @ places[:, 2] / weights.sum() if standing else places[:, 2].min()
        self.height = max(-float(height), 0.0)
        self._move(velocity, physics.heading, yaw_drift)

    def _move(self, velocity: Array, heading: float, yaw_drift: float) -> None:
        """Moves the place on by a velocity (3,) in the world, along the believed heading."""
        turned = math.remainder(heading - self._heading, 2 * math.pi)
        c, s = math.cos(heading), math.sin(heading)
        x, y, _ = velocity.tolist()
        now = c * x + s * y, c * y - s * x, turned / STEP + yaw_drift
        self._heading = heading
        self.place = moved(self.place, *now)
        share = STEP / SMOOTH
        forward, left, turn = (v + share * (n - v) for v, n in zip(self.velocity, now))
        self.velocity = forward, left, turn
