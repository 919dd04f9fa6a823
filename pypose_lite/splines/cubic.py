"""`chspline` and `bspline`: each is a table, and where its three steps come from.

The steps lead from each of four control points to the next. A Hermite segment is a Bezier curve
whose inner control points lie a third of the tangents away from its ends; a B-spline's control
points are the data themselves. The book's chapter on splines derives both tables.
"""

from typing import Any

import torch
from torch import Tensor

from ..lie import SE3, se3_compose, se3_exp, se3_inverse, se3_log, so3_normalize
from ..shapes import check
from .curve import Spline, Table

BEZIER: Table = ((0, 3, -3, 1), (0, 0, 3, -2), (0, 0, 0, 1))
UNIFORM: Table = ((5 / 6, 3 / 6, -3 / 6, 1 / 6), (1 / 6, 3 / 6, 3 / 6, -2 / 6), (0, 0, 0, 1 / 6))


def chspline(points: Any, interval: float = 0.1, derivative: int = 0) -> Tensor:
    """The cubic Hermite spline through points or poses, with central differences as tangents.

    Neighbouring points are 1 apart in the parameter; the first derivative is continuous. From
    each point on, the samples lie 0, interval, 2 interval, ... further; 1/k gives (N - 1) k + 1.
    Where 1 / interval is not whole, the last gap before each point is shorter.

    Args:
        points: (..., N, d), or `SE3` (..., N, 7); N at least 2.
        interval: in (0, 1].
        derivative: 0 for the points; 1 or 2 for that derivative, per unit of the parameter (of
            poses: the body twist (..., 6) and its rate). The second jumps at the points: there
            it is that of the segment that begins.

    Raises:
        ValueError: fewer than 2 points, an interval outside (0, 1], numbers that are not finite.
    """
    return hermite(points).sample(interval, derivative)


def bspline(
    data: Any, interval: float = 0.1, extrapolate: bool = False, derivative: int = 0
) -> Tensor:
    """The uniform cubic B-spline steered by points or poses: smoother than `chspline`.

    The second derivative is continuous, and the curve passes near the points, not through them.

    Args:
        data: (..., N, d), or `SE3` (..., N, 7); N at least 4.
        interval: in (0, 1]; 1/k gives (N - 3) k + 1 samples, placed as in `chspline`.
        extrapolate: repeats the first and the last point twice more, so that the curve begins
            and ends there, at rest; (N + 1) k + 1 samples, and N may be 2 or 3.
        derivative: as in `chspline`.

    Raises:
        ValueError: too few points, an interval outside (0, 1], numbers that are not finite.
    """
    return uniform_bspline(data, extrapolate).sample(interval, derivative)


def hermite(points: Any, tangents: Tensor | None = None) -> Spline:
    """The curve of `chspline`, to be evaluated anywhere, or that with other tangents.

    Args:
        points: as in `chspline`.
        tangents: the derivative at every point (..., N, d); for poses, body twists (..., N, 6).
    """
    points = _knots("points", points, 2)
    if tangents is None:
        legs = _legs(points)
        between = (legs[..., 1:, :] + legs[..., :-1, :]) / 2
        tangents = torch.cat([legs[..., :1, :], between, legs[..., -1:, :]], -2)
    check("points: N d, tangents: N w", points, tangents, w=_width(points))
    return hermite_segments(points, tangents[..., :-1, :], tangents[..., 1:, :])


def hermite_segments(points: Tensor, leaving: Tensor, arriving: Tensor) -> Spline:
    """The curve that has a tangent of its own at either end of every segment.

    Args:
        points: (..., S + 1, d), or `SE3` (..., S + 1, 7).
        leaving: the derivative (..., S, d) at the segments' starts; for poses, (..., S, 6).
        arriving: the derivative at their ends.
    """
    S = _count("points", points, 2) - 1
    spec = "points: N d, leaving: S w, arriving: S w"
    check(spec, points, leaving, arriving, S=S, w=_width(points))
    first, last, legs = leaving / 3, arriving / 3, _legs(points)
    if isinstance(points, SE3):
        inner = se3_compose(se3_compose(se3_exp(-first), se3_exp(legs)), se3_exp(-last))
        middle = se3_log(inner)
    else:
        middle = legs - first - last
    return Spline(points[..., :-1, :], (first, middle, last), BEZIER)


def uniform_bspline(data: Any, extrapolate: bool = False) -> Spline:
    """The curve of `bspline`, to be evaluated anywhere; arguments as there."""
    data = _knots("data", data, 2 if extrapolate else 4)
    if extrapolate:
        first, last = data[..., :1, :], data[..., -1:, :]
        data = torch.cat([first, first, data, last, last], -2)
    legs = _legs(data)
    steps = legs[..., :-2, :], legs[..., 1:-1, :], legs[..., 2:, :]
    return Spline(data[..., :-3, :], steps, UNIFORM)


def _knots(name: str, data: Any, least: int) -> Tensor:
    """The points as a floating tensor, or the poses with their quaternions made unit."""
    x = data if isinstance(data, Tensor) else torch.as_tensor(data)
    x = x if x.is_floating_point() else x.to(torch.get_default_dtype())
    _count(name, x, least)
    if isinstance(x, SE3):
        return SE3(torch.cat([x.translation(), so3_normalize(x.rotation().tensor())], -1))
    return x


def _count(name: str, x: Tensor, least: int) -> int:
    """The number of points or poses."""
    N = check(f"{name}: N d", x)["N"]
    if N < least:
        raise ValueError(f"{name}: expected (..., N >= {least}, d), got {tuple(x.shape)}")
    return N


def _width(points: Tensor) -> int:
    """The size of a tangent."""
    return 6 if isinstance(points, SE3) else points.shape[-1]


def _legs(points: Tensor) -> Tensor:
    """From each point to the next: the difference (..., N - 1, d), or the twist (..., N - 1, 6)."""
    here, there = points[..., :-1, :], points[..., 1:, :]
    if isinstance(here, SE3) and isinstance(there, SE3):
        return se3_log(se3_compose(se3_inverse(here.tensor()), there.tensor()))
    return there - here
