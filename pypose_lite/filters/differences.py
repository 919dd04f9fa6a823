"""Differences and means of vectors some of whose entries are angles.

An angle of 3.1 and one of -3.1 are 0.08 apart, not 6.2, and between them lies pi, not 0. So a
filter never subtracts or averages states and observations itself. It asks the user's ``residual``
(of two observations) and ``residual_x`` (of two states); :func:`angles` makes one. A mean follows
from the differences alone:

    mean <- mean + sum w_k (x_k - mean)      (1)

Without angles one round is exact, wherever it starts. With angles, a round is exact once all
points lie within half a turn of where it starts; where they do not, the mean comes closer from
round to round. Users who know their mean in closed form pass it as ``mean_x``. Their functions may
be written for one pair of vectors, or one set of points, and are mapped over batches.
"""

import functools
import math
import warnings
from collections.abc import Callable

import torch
from torch import Tensor

from ..shapes import has_numbers
from ..systems.mapping import over_batch

Difference = Callable[[Tensor, Tensor], Tensor]
Mean = Callable[[Tensor, Tensor], Tensor]
ROUNDS = 8  # of (1) at most; a belief of one hump needs two or three, whichever point is first


def wrap(angle: Tensor) -> Tensor:
    """Returns the angle (rad) within [-pi, pi]; one that lies there already is returned exactly."""
    return angle - 2 * math.pi * (angle / (2 * math.pi)).round()


def angles(*which: int) -> Difference:
    """Returns the difference of two vectors whose entries at the indices ``which`` are angles.

    The result is for ``residual`` and ``residual_x``. For states ``[x, y, heading, speed]``:

        ekf = pp.EKF(car, Q, R, residual_x=filters.angles(2))

    Args:
        which: indices of the angles (rad); negative ones count from the end.

    Returns:
        a function of a and b ``(..., n)``: a - b, at those indices within [-pi, pi].
    """
    return functools.partial(_difference, which)


def mean_by_differences(points: Tensor, w: Tensor, difference: Difference, rounds: int) -> Tensor:
    """Returns the mean ``(..., n)`` of points ``(..., k, n)`` with weights ``(..., k)``."""
    mean, small = points[..., 0, :], torch.finfo(points.dtype).eps ** 0.75
    for i in range(rounds):
        shift = w.unsqueeze(-2) @ difference(points, mean.unsqueeze(-2))
        mean = mean + shift.squeeze(-2)  # (1)
        if 0 < i and has_numbers(shift) and shift.abs().max() < small:
            break
    return mean


def difference_and_mean(
    difference: Difference | None, mean: Mean | None = None, name: str = "residual"
):
    """Returns what a filter uses where a user gave these: a difference, and a mean of points.

    Raises:
        ValueError: for what is no function, by its name; once called, for results of another shape.
    """
    if difference is None:
        return torch.sub, functools.partial(mean_by_differences, difference=torch.sub, rounds=1)
    for whose, function in ((name, difference), ("mean_x", mean)):
        if function is not None and not callable(function):
            raise ValueError(f"{whose}: expected a function, got {type(function).__name__}")
    if getattr(difference, "func", None) is not _difference:
        difference = functools.partial(_each_difference, name, difference)
    if mean is not None:
        return difference, functools.partial(_each_mean, mean)
    return difference, functools.partial(mean_by_differences, difference=difference, rounds=ROUNDS)


def _each_difference(name: str, difference: Difference, a: Tensor, b: Tensor) -> Tensor:
    """Returns the differences of a batch by a function that may be written for one pair."""
    if a.shape != b.shape:
        a, b = torch.broadcast_tensors(a, b)

    def one(a, b, _):
        return _shaped(name, difference(a, b), a.shape)

    return over_batch(one, a, b, a.new_zeros(()), functools.partial(_warn_of_loop, name))


def _each_mean(mean: Mean, points: Tensor, w: Tensor) -> Tensor:
    """Returns the means of a batch by a function that may be written for one set of points."""

    def one(points, w):
        return _shaped("mean_x", mean(points, w), points.shape[-1:])

    w, batch = w.expand(points.shape[:-1]), points.shape[:-2]
    if not batch:
        return one(points, w)
    sets = points.reshape(-1, *points.shape[-2:]), w.reshape(-1, w.shape[-1])
    return torch.vmap(one)(*sets).reshape(*batch, -1)


def _shaped(name: str, d: Tensor, shape: tuple[int, ...]) -> Tensor:
    """Returns what a user's function gave, in the shape of a vector, or says what it is instead."""
    if isinstance(d, Tensor) and d.numel() == math.prod(shape):
        return d.reshape(shape)
    got = tuple(d.shape) if isinstance(d, Tensor) else type(d).__name__
    raise ValueError(f"{name}: expected a tensor {tuple(shape)} as its result, got {got}")


def _warn_of_loop(name: str, error: Exception) -> None:
    reason = str(error).strip().splitlines()[0]
    warnings.warn(f"{name}: torch.vmap cannot map it, which is slow: {reason}", stacklevel=2)


def _difference(which: tuple[int, ...], a: Tensor, b: Tensor) -> Tensor:
    d = a - b
    chosen = torch.tensor(_are_angles(which, d.shape[-1]), device=d.device)
    return torch.where(chosen, wrap(d), d)


@functools.cache
def _are_angles(which: tuple[int, ...], n: int) -> list[bool]:
    outside = [i for i in which if not -n <= i < n]
    if outside:
        raise ValueError(f"angles: expected indices of a vector of {n} entries, got {outside[0]}")
    chosen = {i % n for i in which}
    return [i in chosen for i in range(n)]
