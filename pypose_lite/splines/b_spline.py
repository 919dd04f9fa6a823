"""Uniform cubic B-splines: curves that are steered by their points, and pass near them.

The three steps of a segment are the legs between four neighbouring points, so the second derivative
is continuous and a point is felt in four segments only; the price is that the curve passes no
point. Chapter 6 of the book derives the table.

Source: de Boor, "A Practical Guide to Splines", chapter IX; for poses Kim, Kim, Shin, "A general
construction scheme for unit quaternion curves with simple high order derivatives", SIGGRAPH 1995.
"""

from typing import Any

import torch
from torch import Tensor

from .curve import Spline, Table
from .knots import as_knots, legs

UNIFORM: Table = ((5 / 6, 3 / 6, -3 / 6, 1 / 6), (1 / 6, 3 / 6, 3 / 6, -2 / 6), (0, 0, 0, 1 / 6))


def bspline(
    data: Any, interval: float = 0.1, extrapolate: bool = False, derivative: int = 0
) -> Tensor:
    """The uniform cubic B-spline steered by points or poses: smoother than `chspline`.

    The second derivative is continuous, and the curve passes near the points, not through them.

    Args:
        data: (..., N, d), or `SE3` (..., N, 7) or `SO3` (..., N, 4); N at least 4.
        interval: in (0, 1]; 1/k gives (N - 3) k + 1 samples, placed as in `chspline`.
        extrapolate: repeats the first and the last point twice more, so that the curve begins
            and ends there, at rest; (N + 1) k + 1 samples, and N may be 2 or 3.
        derivative: as in `chspline`.

    Raises:
        ValueError: too few points, an interval outside (0, 1], numbers that are not finite.
    """
    return uniform_bspline(data, extrapolate).sample(interval, derivative)


def uniform_bspline(data: Any, extrapolate: bool = False) -> Spline:
    """The curve of `bspline`, to be evaluated anywhere; arguments as there."""
    data = as_knots("data", data, 2 if extrapolate else 4)
    if extrapolate:
        first, last = data[..., :1, :], data[..., -1:, :]
        data = torch.cat([first, first, data, last, last], -2)
    leg = legs(data)
    steps = leg[..., :-2, :], leg[..., 1:-1, :], leg[..., 2:, :]
    return Spline(data[..., :-3, :], steps, UNIFORM)
