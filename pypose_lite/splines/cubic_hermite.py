"""Cubic Hermite splines: curves that pass their knots with given tangents.

A Hermite segment is a Bezier curve whose inner control points lie a third of the tangents away
from its ends, so its three steps are a third of the one tangent, the rest, and a third of the
other. `chspline` is the Catmull-Rom spline: its tangents are those of the parabola through a knot
and its two neighbours, which for times 0, 1, 2, ... is half of what leads from one neighbour to
the other. Chapter 6 of the book derives all of it.

Source: Catmull, Rom, "A class of local interpolating splines", 1974; for uneven times Barry,
Goldman, "A recursive evaluation algorithm for a class of Catmull-Rom splines", 1988.
"""

from typing import Any

import torch
from torch import Tensor

from ..lie import LieGroup
from ..shapes import check
from .curve import Spline, Table
from .knots import as_knots, as_times, count, durations, legs, refuse_unless_closed, tangent_width

BEZIER: Table = ((0, 3, -3, 1), (0, 0, 3, -2), (0, 0, 0, 1))


def chspline(
    points: Any, interval: float = 0.1, derivative: int = 0, ends: str = "one-sided"
) -> Tensor:
    """The Catmull-Rom spline through points or poses, sampled: a cubic Hermite spline.

    Neighbouring points are 1 apart in the parameter; the first derivative is continuous. From
    each point on, the samples lie 0, interval, 2 interval, ... further; 1/k gives (N - 1) k + 1.
    Where 1 / interval is not whole, the last gap before each point is shorter. For knots at other
    times see `hermite`.

    Args:
        points: (..., N, d), or `SE3` (..., N, 7) or `SO3` (..., N, 4); N at least 2.
        interval: in (0, 1].
        derivative: 0 for the points; 1 or 2 for that derivative, per unit of the parameter (of
            poses: the body twist (..., 6) and its rate). The second jumps at the points: there
            it is that of the segment that begins.
        ends: as in `hermite`.

    Raises:
        ValueError: fewer than 2 points, an interval outside (0, 1], numbers that are not finite.
    """
    return hermite(points, ends=ends).sample(interval, derivative)


def hermite(
    points: Any, tangents: Tensor | None = None, times: Any = None, ends: str = "one-sided"
) -> Spline:
    """The curve of `chspline`, to be evaluated anywhere; with other tangents or times if given.

    Args:
        points: as in `chspline`.
        tangents: the derivative at every point (..., N, d); for poses, body twists (..., N, 6).
            None is Catmull and Rom's choice.
        times: when the points are passed, (N,) or (..., N), increasing; None is 0, 1, 2, ...
        ends: the tangent at the first and the last point, where tangents are None:
            "one-sided" is the slope of the only leg there is, as in PyPose; "periodic" is for a
            closed curve, whose last point is its first: both ends have the same tangent.

    Raises:
        ValueError: as in `chspline`; times that do not increase; "periodic" and not closed.
    """
    points = as_knots("points", points, 2)
    times = as_times(times, points)
    if tangents is None:
        tangents = catmull_rom(points, times, ends)
    elif ends != "one-sided":
        raise ValueError(f"ends: expected no word on them beside given tangents, got {ends!r}")
    check("points: N d, tangents: N w", points, tangents, w=tangent_width(points))
    return hermite_segments(points, tangents[..., :-1, :], tangents[..., 1:, :], times)


def hermite_segments(
    points: Tensor, leaving: Tensor, arriving: Tensor, times: Any = None
) -> Spline:
    """The curve that has a tangent of its own at either end of every segment.

    Args:
        points: (..., S + 1, d), or `SE3` (..., S + 1, 7) or `SO3` (..., S + 1, 4).
        leaving: the derivative (..., S, d) at the segments' starts; for poses, (..., S, 6).
        arriving: the derivative at their ends.
        times: as in `hermite`.
    """
    S = count("points", points, 2) - 1
    spec = "points: N d, leaving: S w, arriving: S w"
    check(spec, points, leaving, arriving, S=S, w=tangent_width(points))
    times = as_times(times, points)
    h = durations(times, points)
    first, last, leg = h * leaving / 3, h * arriving / 3, legs(points)
    if isinstance(points, LieGroup):
        group = type(points).operations
        inner = group.compose(group.compose(group.exp(-first), group.exp(leg)), group.exp(-last))
        middle = group.log(inner)
    else:
        middle = leg - first - last
    return Spline(points[..., :-1, :], (first, middle, last), BEZIER, times)


def catmull_rom(points: Tensor, times: Tensor | None, ends: str) -> Tensor:
    """Returns the tangents ``(..., N, w)`` of the parabola through each knot and its neighbours.

    With slopes a, b of the legs before and after a knot, which take the times g and h,

        m = (h a + g b) / (g + h).                                              (1)

    Before the first knot and after the last, `ends` says which leg is taken for the missing one.
    """
    if ends not in ("one-sided", "periodic"):
        raise ValueError(f'ends: expected "one-sided" or "periodic", got {ends!r}')
    time = durations(times, points)
    slope = legs(points) / time
    if ends == "periodic":
        refuse_unless_closed(points)
    before, after = (-1, 0) if ends == "periodic" else (0, -1)
    time, slope = (
        torch.cat([x[..., [before], :], x, x[..., [after], :]], -2) for x in (time, slope)
    )
    (g, h), (a, b) = ((x[..., :-1, :], x[..., 1:, :]) for x in (time, slope))
    return (h * a + g * b) / (g + h)  # (1)
