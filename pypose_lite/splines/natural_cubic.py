"""Cubic splines with two continuous derivatives: natural, clamped and periodic ones.

Of all curves through the points, the natural cubic spline bends least: it minimises the integral
of the squared second derivative. Its tangents m solve one linear system, in which the second
derivative does not jump; the price is that every point is felt everywhere. Between two knots it
is Hermite's cubic, so what comes back is the same `Spline` as that of `hermite`.

Source: de Boor, "A Practical Guide to Splines", chapter IV.
"""

from typing import Any

import torch
from torch import Tensor

from ..lie import LieGroup
from ..shapes import check
from .cubic_hermite import hermite
from .curve import Spline
from .knots import as_knots, as_times, durations, legs, refuse_unless_closed


def cubic_spline(
    points: Any, times: Any = None, ends: str | tuple[Tensor, Tensor] = "natural"
) -> Spline:
    """The cubic spline through points, with two continuous derivatives.

    With slopes a, b of the legs before and after a knot, which take the times g and h, the
    tangents at the last knot, this one and the next, l, m, r, fulfil

        h l + 2 (g + h) m + g r = 3 (h a + g b)                                 (1)

    at every inner knot. The two equations at the ends are

        natural     2 m + r = 3 b,  l + 2 m = 3 a:  no second derivative        (2)
        clamped     m as given, or zero                                         (3)
        periodic    (1) across the seam, and both ends have the same tangent    (4)

    Args:
        points: (..., N, d), N at least 2.
        times: when the points are passed, (N,) or (..., N), increasing; None is 0, 1, 2, ...
        ends: "natural"; "clamped", at rest at both ends; "periodic", for a closed curve, whose
            last point is its first; or the pair of tangents (..., d) at the first and last point.

    Raises:
        ValueError: poses, too few points, times that do not increase, "periodic" and not closed.
    """
    if isinstance(points, LieGroup):
        raise ValueError(
            "points: expected (..., N, d), got poses, for which two continuous derivatives are no "
            "linear system: take hermite, or uniform_bspline, which has them and passes nearby"
        )
    points = as_knots("points", points, 2)
    times = as_times(times, points)
    time = durations(times, points)
    slope = legs(points) / time
    e = torch.eye(points.shape[-2], dtype=points.dtype, device=points.device)  # each picks one m
    inner = _no_jump(*_neighbours(time), *_neighbours(slope), e[:-2], e[1:-1], e[2:])
    first, last = _at_the_ends(points, time, slope, e, ends)
    matrix, right = (_stack(rows) for rows in zip(first, inner, last))
    return hermite(points, torch.linalg.solve(matrix, right), times)


def _neighbours(x: Tensor) -> tuple[Tensor, Tensor]:
    """What belongs to the leg before each inner knot, and to the leg after it."""
    return x[..., :-1, :], x[..., 1:, :]


def _no_jump(g, h, a, b, l, m, r) -> tuple[Tensor, Tensor]:
    """Both sides of (1), where l, m, r are the rows that pick these tangents."""
    return h * l + 2 * (g + h) * m + g * r, 3 * (h * a + g * b)  # (1)


def _at_the_ends(points: Tensor, time: Tensor, slope: Tensor, e: Tensor, ends: Any) -> tuple:
    """The first and the last equation, both sides of each, one row high."""
    start, stop = slope[..., :1, :], slope[..., -1:, :]
    if ends == "natural":
        return (2 * e[:1] + e[1:2], 3 * start), (e[-2:-1] + 2 * e[-1:], 3 * stop)  # (2)
    if ends == "periodic":
        refuse_unless_closed(points)
        g, h = time[..., -1:, :], time[..., :1, :]
        seam = _no_jump(g, h, stop, start, e[-2:-1], e[:1], e[1:2])
        return seam, (e[-1:] - e[:1], torch.zeros_like(stop))  # (4)
    if ends != "clamped" and not (isinstance(ends, tuple | list) and len(ends) == 2):
        words = 'expected "natural", "clamped", "periodic" or two tangents'
        raise ValueError(f"ends: {words}, got {ends!r}")
    rest = torch.zeros_like(points[..., 0, :])
    first, last = (rest, rest) if ends == "clamped" else ends
    check("points: N d, first: d, last: d", points, first, last)
    return (e[:1], first[..., None, :]), (e[-1:], last[..., None, :])  # (3)


def _stack(rows: tuple[Tensor, ...]) -> Tensor:
    """The rows of equations (..., k, n) below each other, for the batch of them all."""
    batch = torch.broadcast_shapes(*(x.shape[:-2] for x in rows))
    return torch.cat([x.expand(*batch, *x.shape[-2:]) for x in rows], -2)
