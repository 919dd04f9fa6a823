"""What a car needs to know of a curve: heading, curvature, and how long it is.

The parameter of a spline says nothing of metres: between two points that are close together the
curve is slow. `parameter_at` finds the parameters at given distances along the curve.
"""

import numpy as np
import torch
from torch import Tensor

from ..lie import is_SE3
from ..lie.taylor import safe_norm
from ..shapes import check
from .curve import Spline

# Gauss-Legendre nodes and weights on [0, 1]: exact for polynomials of degree 31.
NODES, WEIGHTS = (torch.from_numpy(a) / 2 for a in np.polynomial.legendre.leggauss(16))
NODES = NODES + 0.5
SEARCH = 60  # bisections, at the worst, to find a length; Newton needs about 5


def heading(velocity: Tensor, still: Tensor | None = None) -> Tensor:
    """The direction ``[cos, sin] (..., 2)`` of a planar curve.

    Args:
        velocity: its first derivative (..., 2) with respect to any parameter.
        still: what to return (..., 2) where the velocity is zero; ``[1, 0]`` if None.
    """
    still = velocity.new_tensor([1, 0]) if still is None else still
    check("velocity: n, still: n", velocity, still, n=2)
    speed = safe_norm(velocity, keepdim=True)
    return torch.where(speed > 0, velocity / torch.where(speed > 0, speed, 1), still)


def curvature(velocity: Tensor, acceleration: Tensor) -> Tensor:
    """The curvature ``(...)`` of a planar curve, 1/m: positive to the left, 0 where it rests.

    Args:
        velocity: its first derivative (..., 2) with respect to any parameter.
        acceleration: its second derivative (..., 2).
    """
    check("velocity: n, acceleration: n", velocity, acceleration, n=2)
    (dx, dy), (ddx, ddy) = velocity.unbind(-1), acceleration.unbind(-1)
    speed = safe_norm(velocity)
    moving = speed > 0
    return torch.where(moving, (dx * ddy - dy * ddx) / torch.where(moving, speed, 1) ** 3, 0)


def arc_length(spline: Spline) -> Tensor:
    """The distance ``(..., S + 1)`` along the curve from its start to every knot.

    For poses it is the distance that the translation travels.
    """
    each = _length(spline, spline.start.new_ones(spline.segments))
    return torch.cat([torch.zeros_like(each[..., :1]), each.cumsum(-1)], -1)


def parameter_at(spline: Spline, distance: Tensor) -> Tensor:
    """The parameters ``(..., M)`` at which the curve has gone the ``distance`` (M,) or (..., M).

    Distances before the start or beyond the end give the ends. The gradient, and that of the
    gradient, are those of the implicit function; they are 0 where the curve rests.
    """
    check("distance: M", distance)
    knots = arc_length(spline)
    batch = torch.broadcast_shapes(knots.shape[:-1], distance.shape[:-1])
    knots, distance = knots.expand(*batch, -1), distance.expand(*batch, -1)
    distance = distance.clamp(min=0).minimum(knots[..., -1:])  # what lies beyond ends at once
    segment = torch.searchsorted(knots[..., 1:].detach().contiguous(), distance.detach())
    segment = segment.clamp(max=spline.segments - 1)
    rest = distance - knots.take_along_dim(segment, -1)
    pieces = spline.take(segment)
    with torch.no_grad():
        u = _search(pieces, rest)
    for _ in range(2):  # from the root, two of Newton's steps carry two derivatives
        speed = _speed(pieces, u)
        slope = torch.where(speed > 0, speed, 1)
        u = u - torch.where(speed > 0, (_length(pieces, u) - rest) / slope, 0)
    return segment + u.clamp(0, 1)


def evenly_spaced(spline: Spline, count: int) -> Tensor:
    """The parameters ``(..., count)`` of points at equal distances, both ends included."""
    if count < 2:
        raise ValueError(f"count: expected at least 2, got {count}")
    total = arc_length(spline)[..., -1:]
    share = torch.linspace(0, 1, count, dtype=total.dtype, device=total.device)
    return parameter_at(spline, total * share)


def _search(pieces: Spline, rest: Tensor) -> Tensor:
    """The u in [0, 1] where ``rest`` is gone: Newton's steps, or halving where they leave."""
    low, high = torch.zeros_like(rest), torch.ones_like(rest)
    whole = _length(pieces, high)
    u = torch.where(whole > 0, rest / whole, 0)  # exact at both ends
    for _ in range(SEARCH):
        excess = _length(pieces, u) - rest
        low, high = torch.where(excess < 0, u, low), torch.where(excess < 0, high, u)
        newton = u - excess / _speed(pieces, u)  # outside, or NaN, where the curve rests
        inside = (newton >= low) & (newton <= high)
        before, u = u, torch.where(inside, newton, (low + high) / 2)
        if (u - before).abs().max() < torch.finfo(u.dtype).eps ** 0.5:  # the next would square it
            break
    return u


def _length(pieces: Spline, u: Tensor) -> Tensor:
    """The distance ``(..., S)`` gone in every segment from its start to u: Gauss's quadrature."""
    speed = _speed(pieces.spread(), u[..., None] * NODES.to(u))
    return u * (speed @ WEIGHTS.to(u))


def _speed(pieces: Spline, u: Tensor) -> Tensor:
    """The length of the first derivative."""
    velocity = pieces.local(u, 1)
    return safe_norm(velocity[..., :3] if is_SE3(pieces.start) else velocity)
