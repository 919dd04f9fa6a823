"""What a picture shows, and from where it is seen."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ASPECT = 2.0  # width by height
DPI = 100  # pixels to an inch of a figure; which number it is does not matter
WAYPOINT = 0.07  # m, the radius of its mark
LIGHT = np.array([-0.3, -0.35, 1.0])  # towards it


@dataclass(frozen=True)
class Shot:
    """What there is to see: dogs, their way, and the waypoints, on a level floor.

    Attributes:
        dogs: the positions of all joints (D, 19), as MuJoCo has them.
        way: the trajectory that was recorded (N, 2), m.
        waypoints: on the floor (W, 2), m.
    """

    dogs: Array
    way: Array
    waypoints: Array


@dataclass(frozen=True)
class Camera:
    """A pinhole camera that looks at a point; by default, down at the whole infinity.

    Attributes:
        width: of the picture, pixels.
        lookat: the point, m.
        distance: to it, m.
        elevation: degrees above the horizon in which it looks; negative is down.
        azimuth: degrees from the x axis in which it looks; at 90, x goes to the right.
        fovy: degrees that it sees from the top to the bottom.
    """

    width: int
    lookat: tuple[float, float, float] = (0.0, -0.2, 0.1)
    distance: float = 3.5
    elevation: float = -50.0
    azimuth: float = 90.0
    fovy: float = 40.0

    @property
    def height(self) -> int:
        """Of the picture, pixels."""
        return round(self.width / ASPECT)

    def project(self, points: Array) -> Array:
        """Where points (..., 3) in m are seen: pixels right, pixels down, metres away (..., 3)."""
        right, up, ahead = self.axes
        seen = points - self.place
        away = seen @ ahead
        scale = self.height / 2 / math.tan(math.radians(self.fovy) / 2) / away
        across = self.width / 2 + scale * (seen @ right)
        down = self.height / 2 - scale * (seen @ up)
        return np.stack([across, down, away], axis=-1)

    @property
    def axes(self) -> tuple[Array, Array, Array]:
        """To the right, up and ahead in the picture: unit vectors in the world."""
        turn, lift = math.radians(self.azimuth), math.radians(self.elevation)
        c, s = math.cos(turn), math.sin(turn)
        ahead = np.array([math.cos(lift) * c, math.cos(lift) * s, math.sin(lift)])
        right = np.array([s, -c, 0.0])
        return right, np.cross(right, ahead), ahead

    @property
    def place(self) -> Array:
        """Where it is (3,), m."""
        return np.array(self.lookat) - self.distance * self.axes[2]
