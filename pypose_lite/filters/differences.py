"""Differences and means of vectors some of whose entries are angles.

An angle of 3.1 and one of -3.1 are 0.08 apart, not 6.2, and between them lies pi, not 0. So a
filter never subtracts or averages states and observations itself. It asks the user's ``residual``
(of two observations) and ``residual_x`` (of two states); :func:`angles` makes one. A mean follows
from the differences alone:

    mean <- mean + sum w_k (x_k - mean)      (1)

Without angles one round is exact, wherever it starts. With angles, a round is exact once all
points lie within half a turn of where it starts; where they do not, the mean comes closer from
round to round. Users who know their mean in closed form pass it as ``mean_x``.
"""

import functools
import math
from collections.abc import Callable

import torch
from torch import Tensor

Difference = Callable[[Tensor, Tensor], Tensor]
Mean = Callable[[Tensor, Tensor], Tensor]
ROUNDS = 8  # of (1); a belief of one hump needs two or three, whichever point comes first


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
    mean = points[..., 0, :]
    for _ in range(rounds):
        shift = w.unsqueeze(-2) @ difference(points, mean.unsqueeze(-2))
        mean = mean + shift.squeeze(-2)  # (1)
    return mean


def difference_and_mean(difference: Difference | None, mean: Mean | None = None):
    """Returns what a filter uses where a user gave these: a difference, and a mean of points."""
    if mean is not None:
        return difference, functools.partial(_whole_mean, mean)
    difference, rounds = (torch.sub, 1) if difference is None else (difference, ROUNDS)
    return difference, functools.partial(mean_by_differences, difference=difference, rounds=rounds)


def _whole_mean(mean: Mean, points: Tensor, w: Tensor) -> Tensor:
    """Returns a user's mean of points, with a weight for each in every member of the batch."""
    return mean(points, w.expand(points.shape[:-1]))


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
