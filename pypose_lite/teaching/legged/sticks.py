"""Stick figures by matplotlib, where MuJoCo cannot draw: the same dogs, seen by the same camera."""

from functools import cache

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from ..figures import BLUE, RED
from .poses import Skeleton
from .scene import DPI, LIGHT, WAYPOINT, Array, Camera, Shot

FLOOR, SHADE, COAT, NEAR, FAR = "#ebeef0", "#c9cdd1", "#525c70", "#2b303b", "#8c95a3"
NECK = 0.1  # m, from the trunk to the head
PAGE = 770  # pixels, the width of the page
FACES = [(axis, side) for axis in range(3) for side in range(2)]  # of the trunk's box


def drawn(shot: Shot, camera: Camera) -> Figure:
    """The shot as a figure, as many pixels wide as the camera's picture at `DPI`."""
    size = camera.width / DPI, camera.height / DPI
    figure = plt.figure(figsize=size, dpi=DPI, facecolor=FLOOR, layout="none")
    ax = figure.add_axes((0, 0, 1, 1))
    ax.set(xlim=(0, camera.width), ylim=(camera.height, 0))
    ax.axis("off")
    _floor(ax, shot, camera)
    skeleton = _skeleton()
    bodies = [skeleton(joints) for joints in shot.dogs]
    for corners, legs in bodies:
        _shade(ax, corners, legs, camera)
    bodies.sort(key=lambda body: -_away(body[0], camera))
    for k, (corners, legs) in enumerate(bodies, start=1):
        _dog(ax, corners, legs, camera, 10.0 * k)
    return figure


_skeleton = cache(Skeleton)


def _floor(ax: Axes, shot: Shot, camera: Camera) -> None:
    """The waypoints and the way, which lie on the floor."""
    turn = np.linspace(0, 2 * np.pi, 40)
    circle = WAYPOINT * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    for waypoint in shot.waypoints:
        ax.fill(*_seen(camera, _on_floor(waypoint + circle)), color=RED, lw=0, zorder=1)
    way, size = _seen(camera, _on_floor(shot.way)), _points(camera, 6)
    ax.plot(*way, ".-", color=BLUE, zorder=2, lw=_points(camera, 1.8), ms=size)


def _shade(ax: Axes, corners: Array, legs: Array, camera: Camera) -> None:
    """The shadow of a dog, flat on the floor."""
    for face in _faces(corners):
        ax.fill(*_seen(camera, _fallen(face)), color=SHADE, lw=0, zorder=0)
    for leg in legs:
        _line(ax, camera, _fallen(leg), SHADE, 3, 0)


def _dog(ax: Axes, corners: Array, legs: Array, camera: Camera, order: float) -> None:
    """The legs and the head, behind the trunk or before it, between `order` and `order` + 2."""
    trunk = _away(corners, camera)

    def layer(points: Array) -> float:
        return order + 1 + np.sign(trunk - _away(points, camera))

    for leg in legs:
        place = layer(leg[:2])
        _line(ax, camera, leg, FAR if place < order + 1 else NEAR, 4, place)
        ax.plot(*_seen(camera, leg[-1:]), "o", color="black", ms=_points(camera, 6), zorder=place)
    middle, front = corners.mean((0, 1, 2)), corners[1].mean((0, 1))
    neck = front + NECK * (front - middle) / np.linalg.norm(front - middle)
    _line(ax, camera, np.stack([front, neck]), NEAR, 8, layer(neck))
    size = _points(camera, 11)
    ax.plot(*_seen(camera, neck[None]), "o", color=NEAR, ms=size, zorder=layer(neck))
    for face in _faces(corners):
        normal = face.mean(0) - middle
        if normal @ (face.mean(0) - camera.place) < 0:  # it looks at the camera
            sun = max(normal @ LIGHT / np.linalg.norm(normal) / np.linalg.norm(LIGHT), 0.0)
            color = [(0.7 + 0.3 * sun) * part for part in to_rgb(COAT)]
            edge = _points(camera, 0.5)
            ax.fill(*_seen(camera, face), fc=color, ec=NEAR, lw=edge, zorder=order + 1)


def _line(ax: Axes, camera: Camera, points: Array, color: str, width: float, order: float) -> None:
    """A line through points (N, 3), so many pixels wide on the page."""
    [line] = ax.plot(*_seen(camera, points), color=color, lw=_points(camera, width), zorder=order)
    line.set(solid_capstyle="round", solid_joinstyle="round")


def _points(camera: Camera, pixels: float) -> float:
    """Points that are so many pixels where the picture is as wide as the page."""
    return pixels * camera.width / PAGE * 72 / DPI


def _seen(camera: Camera, points: Array) -> Array:
    """Where points (N, 3) are in the picture, pixels right and down (2, N)."""
    return camera.project(points)[:, :2].T


def _faces(corners: Array) -> list[Array]:
    """The six faces (4, 3) of a box of corners (2, 2, 2, 3)."""
    around = [(0, 0), (0, 1), (1, 1), (1, 0)]
    return [
        np.array([np.take(corners, side, axis=axis)[place] for place in around])
        for axis, side in FACES
    ]


def _away(points: Array, camera: Camera) -> float:
    """How far the middle of points (..., 3) is away from the camera, m."""
    return float(camera.project(points)[..., 2].mean())


def _on_floor(points: Array) -> Array:
    """Points (N, 2) of the floor in space (N, 3)."""
    return np.column_stack([points, np.zeros(len(points))])


def _fallen(points: Array) -> Array:
    """Where the light throws points (N, 3) to the floor."""
    return points - points[:, 2:] * LIGHT / LIGHT[2]
