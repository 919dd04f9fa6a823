"""What every spline asks of its knots: points or poses, their times, and the legs between them.

A spline passes its knots ``p_0 ... p_(N-1)`` (or is steered by them) at the times ``t_0 < ... <
t_(N-1)``, which are 0, 1, 2, ... if nobody says otherwise. The leg from one knot to the next is a
difference of points, or the constant twist that leads from one pose to the next.
"""

from typing import Any

import torch
from torch import Tensor

from ..lie import LieGroup, so3_normalize
from ..shapes import check, has_numbers


def as_knots(name: str, data: Any, least: int) -> Tensor:
    """Returns the points as floats, or the poses with unit quaternions; ValueError if too few."""
    x = data if isinstance(data, Tensor) else torch.as_tensor(data)
    x = x if x.is_floating_point() else x.to(torch.get_default_dtype())
    count(name, x, least)
    if isinstance(x, LieGroup):
        numbers = x.tensor()
        unit = torch.cat([numbers[..., :-4], so3_normalize(numbers[..., -4:])], -1)
        return unit.as_subclass(type(x))
    return x


def count(name: str, x: Tensor, least: int) -> int:
    """Returns the number N of points or poses ``(..., N, d)``; ValueError if below ``least``."""
    N = check(f"{name}: N d", x)["N"]
    if N < least:
        raise ValueError(f"{name}: expected (..., N >= {least}, d), got {tuple(x.shape)}")
    return N


def tangent_width(points: Tensor) -> int:
    """Returns the size of a tangent: d for points, 6 for poses, 3 for rotations."""
    return points.algebra.width if isinstance(points, LieGroup) else points.shape[-1]


def legs(points: Tensor) -> Tensor:
    """Returns what leads from each knot to the next: differences or twists (..., N - 1, w)."""
    here, there = points[..., :-1, :], points[..., 1:, :]
    if isinstance(here, LieGroup):
        return (here.Inv() @ there).Log().tensor()
    return there - here


def as_times(times: Any, points: Tensor) -> Tensor | None:
    """Returns the knots' times ``(N,)`` or ``(..., N)`` in the points' dtype; None stays None.

    Raises:
        ValueError: not N numbers, or numbers that do not increase.
    """
    if times is None:
        return None
    t = times
    if not (isinstance(t, Tensor) and t.is_floating_point()):
        t = torch.as_tensor(t, dtype=points.dtype, device=points.device)
    check("points: N d, times: N", points, t)
    late = t[..., 1:] <= t[..., :-1]
    if has_numbers(late) and late.any():
        *_, i = where = tuple(map(int, late.nonzero()[0]))
        before, after = t[where].item(), t[..., 1:][where].item()
        raise ValueError(f"times: expected increasing numbers, got {before} and {after} at {i}")
    return t


def durations(times: Tensor | None, points: Tensor) -> Tensor:
    """Returns how long every segment takes, ``(..., N - 1, 1)``: ones where times are None."""
    if times is None:
        return points.new_ones(points.shape[-2] - 1, 1)
    return times.diff(dim=-1)[..., None]


def refuse_unless_closed(points: Tensor) -> None:
    """Raises ValueError unless the last point or pose is the first, up to rounding."""
    ends = points[..., [-1, 0], :]
    gap = legs(ends).abs().amax()
    size = points.as_subclass(Tensor).abs().amax()
    if has_numbers(gap) and gap > 100 * torch.finfo(gap.dtype).eps * (1 + size):
        raise ValueError(
            f'points: expected the last to be the first for ends="periodic", got {gap:.3g} between'
        )
