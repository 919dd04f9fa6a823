"""The book's pictures of the plane: every function takes an ``ax`` and returns what it drew.

States are rows ``[i, j, cos, sin]``: the position in metres, then the heading. Colours, style and
``show`` are those of ``figures``; the shapes differ as well as the colours.
"""

import math
from functools import partial

import torch
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from matplotlib.quiver import Quiver
from torch import Tensor

from .. import infinity
from ..shapes import check
from .figures import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY, show, stacked, use_style

__all__ = ["use_style", "show", "stacked"]
__all__ += ["infinity_axes", "plot_course", "plot_waypoints", "plot_states", "plot_reference"]
__all__ += ["plot_heading", "plot_covariance"]
__all__ += ["BLUE", "RED", "ORANGE", "GREEN", "PURPLE", "SKY", "GREY"]


def infinity_axes(ax: Axes, title: str = "", margin: float = 0.4) -> Axes:
    """Returns ``ax`` as the plane of the infinity: metres, equal scales, ``margin`` around it."""
    ax.set_aspect("equal")
    ax.set(xlim=(-2 - margin, 2 + margin), ylim=(-1 - margin, 1 + margin))
    ax.set(xlabel="i (m)", ylabel="j (m)", title=title)
    return ax


def plot_course(ax: Axes, title: str = "") -> Axes:
    """Returns ``ax`` as that plane, with the two circles and the 17 waypoints in it."""
    infinity_axes(ax, title)
    circles = infinity.reference(torch.linspace(0, infinity.LENGTH, 200))
    plot_reference(ax, circles, label="two circles")
    plot_waypoints(ax, infinity.waypoints())
    return ax


def plot_waypoints(ax: Axes, waypoints: Tensor, label: str = "waypoints") -> PathCollection:
    """Returns the red points that the car has to visit; ``waypoints (T, n)``, n >= 2."""
    i, j = _positions("waypoints", waypoints).unbind(-1)
    return ax.scatter(i, j, s=36, color=RED, marker="o", zorder=3, label=label)


def plot_states(ax: Axes, x: Tensor, label: str | None = None, color: str = BLUE) -> list[Line2D]:
    """Returns the connected dots of a run ``x (T, n)``, or of a batch of them ``(..., T, n)``."""
    paths = _positions("x", x).flatten(0, -3) if x.ndim > 2 else _positions("x", x)[None]
    lines = [ax.plot(*path.mT, ".-", lw=1, ms=5, color=color)[0] for path in paths]
    lines[0].set_label(label or "_nolegend_")
    return lines


def plot_reference(ax: Axes, points: Tensor, label: str = "reference") -> list[Line2D]:
    """Returns the orange curve that the car should follow; ``points (T, n)``, n >= 2."""
    return ax.plot(*_positions("points", points).mT, color=ORANGE, lw=3, alpha=0.6, label=label)


def plot_heading(ax: Axes, x: Tensor, length: float = 0.25, color: str = "black") -> Quiver:
    """Returns an arrow of ``length`` metres at each state of ``x (T, 4)``, along its heading."""
    check("x: T four", x, four=4)
    i, j, c, s = x.detach().cpu().unbind(-1)
    in_metres = partial(ax.quiver, angles="xy", scale_units="xy", scale=1 / length)
    return in_metres(i, j, c, s, color=color, width=0.004, zorder=4)


def plot_covariance(
    ax: Axes, mean: Tensor, P: Tensor, probability: float = 0.95, color: str = BLUE
) -> Ellipse:
    """Returns the ellipse that holds the position with ``probability``.

    Args:
        ax: where to draw.
        mean: the estimate (n,), position first.
        P: its covariance (n, n), in square metres.
        probability: of the position lying inside, 0 < probability < 1.
        color: of the outline.
    """
    check("mean: n, P: n n", mean, P)
    # In two dimensions the squared Mahalanobis distance exceeds r^2 with probability exp(-r^2/2).
    radius = math.sqrt(-2 * math.log(1 - probability))
    variance, axes = torch.linalg.eigh(P.detach().cpu()[:2, :2])
    minor, major = (2 * radius * variance.clamp(min=0).sqrt()).tolist()
    angle = math.degrees(math.atan2(axes[1, 1], axes[0, 1]))
    i, j = mean.detach().cpu()[:2].tolist()
    ellipse = Ellipse((i, j), major, minor, angle=angle, fill=False, color=color, lw=1)
    ax.add_patch(ellipse)
    return ellipse


def _positions(name: str, points: Tensor) -> Tensor:
    """The first two columns of ``(..., T, n)``, as matplotlib takes them."""
    if check(f"{name}: T n", points)["n"] < 2:
        raise ValueError(f"{name}: expected (..., T, n) with n >= 2, got {tuple(points.shape)}")
    return points.detach().cpu()[..., :2]
