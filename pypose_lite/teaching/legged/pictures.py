"""What the book shows of a dog with legs: its walk in one picture, and its walk as a film.

Both take any walk of `poses.walked`. Without OpenGL they draw stick figures instead, and say so.
"""

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from ... import infinity
from ..animation import animate
from ..pictures import Picture, png
from . import poses, render, sticks
from .poses import walked
from .scene import DPI, Array, Camera, Shot

__all__ = ["film", "on_infinity", "snapshots", "walked"]

APART = 0.85  # m: a little more than a dog is long
QUALITY = 88  # of JPEG
KEPT = Path(__file__).with_name("dog_on_infinity.jpg")  # which `make picture` makes
ON_INFINITY = (
    "Snapshots of a simulated Go2, a robot with four legs, in one picture. It walks a figure of "
    "eight; a blue line of dots is the way that it has recorded, and red discs are the waypoints."
)


def on_infinity() -> Picture:
    """Returns the picture of a whole lap that README and opening page show."""
    return Picture(KEPT.read_bytes(), ON_INFINITY, "jpeg", letters=False)


def snapshots(
    walk: Array, way: Any, alt: str, apart: float = APART, width: int = 1540, stand_in: bool = True
) -> Picture:
    """Returns one picture of the whole walk: dogs where it was, all on the same floor.

    Args:
        walk: rows of `walked` (T, 20).
        way: the trajectory that was recorded, states (N, 2) or more columns; m.
        alt: what the picture shows, in words.
        apart: m, from any dog to the nearest other.
        width: of the picture, pixels.
        stand_in: whether stick figures stand in where there is no OpenGL.

    Raises:
        NoOpenGL: there is none, and nothing may stand in.
    """
    dogs = poses.snapshots(_joints(walk), apart)
    [shot], camera = _shots([dogs], [_plane(way)]), Camera(width)
    try:
        [picture] = render.rendered([shot], camera)
    except render.NoOpenGL as reason:
        if not stand_in:
            raise
        print(_line(reason))
        return Picture(png(sticks.drawn(shot, camera), DPI), alt, letters=False)
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "jpeg", quality=QUALITY)
    return Picture(buffer.getvalue(), alt, "jpeg", letters=False)


def film(
    walk: Array, way: Any, alt: str, dt: float = 0.1, every: int = 4, width: int = 640
) -> Picture:
    """Returns the walk as a film in its own time, the dog's recorded way growing behind it.

    Args:
        walk: rows of `walked` (T, 20).
        way: the trajectory that was recorded, states (N, 2) or more columns; m. Its last is at the
            time of the walk's last.
        alt: what the film shows, in words.
        dt: s, from one state of the way to the next.
        every: so many rows are a frame.
        width: of the picture, pixels.
    """
    joints, times, path = _joints(walk), walk[:, 0], _plane(way)
    rows = range(len(walk) - 1, -1, -every)[::-1]
    gone = [max(len(path) - round((times[-1] - times[row]) / dt), 0) for row in rows]
    shots, camera = _shots([joints[[k]] for k in rows], [path[:n] for n in gone]), Camera(width)
    try:
        frames = render.rendered(shots, camera)
    except render.NoOpenGL as reason:
        print(_line(reason))

        def draw(k: int) -> Figure:
            return sticks.drawn(shots[k], camera)
    else:

        def draw(k: int) -> Figure:
            return _figure(frames[k])

    seconds = every * float(np.median(np.diff(times))) if len(walk) > 1 else dt
    return replace(animate(draw, len(shots), seconds, DPI, alt=alt), letters=False)


def _joints(walk: Array) -> Array:
    """The positions of all joints (T, 19)."""
    if walk.ndim != 2 or walk.shape[1] != 20 or not len(walk):
        raise ValueError(f"walk: expected rows of 20, as `walked` returns them, got {walk.shape}")
    return walk[:, 1:]


def _plane(way: Any) -> Array:
    """The first two columns."""
    points = np.asarray(way, float)
    if points.ndim != 2 or points.shape[1] < 2:
        raise ValueError(f"way: expected (N, n) with n >= 2, got {points.shape}")
    return points[:, :2]


def _shots(dogs: list[Array], ways: list[Array]) -> list[Shot]:
    places = infinity.waypoints(torch.float64)[:, :2].round(decimals=6)
    waypoints = places.unique(dim=0).numpy()  # the middle is three of them
    return [Shot(some, way, waypoints) for some, way in zip(dogs, ways)]


def _line(reason: render.NoOpenGL) -> str:
    return f"Drawn as stick figures, since there is no OpenGL here ({reason})."


def _figure(picture: NDArray[np.uint8]) -> Figure:
    """A figure that is the picture, pixel by pixel."""
    height, width = picture.shape[:2]
    figure = plt.figure(figsize=(width / DPI, height / DPI), dpi=DPI, layout="none")
    figure.figimage(picture)
    return figure
