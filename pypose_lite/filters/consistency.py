"""Is a filter as sure as it may be? Errors and innovations against their own covariances."""

import torch
from torch import Tensor

from ..shapes import check
from .gaussian import Innovation, squared_distance


def nees(x: Tensor, P: Tensor, truth: Tensor) -> Tensor:
    """Returns the normalised estimation error squared ``(x - truth)' P^-1 (x - truth)``.

    Of a consistent filter it is chi-square distributed with n degrees of freedom: n on average,
    more when the filter is too sure, less when it is too modest.

    Args:
        x: estimates ``(..., n)``.
        P: their covariances ``(..., n, n)``, symmetric > 0.
        truth: the states ``(..., n)``.

    Source: Y. Bar-Shalom, X. Li, T. Kirubarajan, "Estimation with Applications to Tracking and
    Navigation" (2001), section 5.4.
    """
    check("x: n, P: n n, truth: n", x, P, truth)
    return squared_distance((x - truth).unsqueeze(-1), P, "P")[0].squeeze(-1)


def nis(innovation: Innovation) -> Tensor:
    """Returns the normalised innovation squared ``e' S^-1 e``, which needs no truth, ``(...)``.

    Of a consistent filter it is chi-square distributed, with as many degrees of freedom as rows
    were seen, and independent from step to step.

    Source: as for :func:`nees`.
    """
    e, S, _ = innovation
    return squared_distance(e.unsqueeze(-1), S, "the innovation's covariance")[0].squeeze(-1)


def chi_square_interval(dof: int, runs: int = 1, level: float = 0.95) -> tuple[float, float]:
    """Returns where the mean of ``runs`` independent NEES or NIS of a consistent filter lies.

    Their sum is chi-square distributed with ``runs * dof`` degrees of freedom.

    Args:
        dof: degrees of freedom of one: n for the NEES, p for the NIS.
        runs: how many are averaged.
        level: how likely the mean is to lie inside, between 0 and 1; each end leaves out half
            of the rest.

    Raises:
        ValueError: for a level outside, or less than one degree of freedom or run.
    """
    if not (dof > 0 and runs > 0 and 0 < level < 1):
        raise ValueError(f"expected dof > 0, runs > 0, 0 < level < 1, got {dof}, {runs}, {level}")
    tails = torch.tensor([(1 - level) / 2, (1 + level) / 2], dtype=torch.float64)
    low, high = (_chi_square_quantile(tails, dof * runs) / runs).tolist()
    return low, high


def _chi_square_quantile(probability: Tensor, dof: float) -> Tensor:
    """Returns the quantiles by bisection of the distribution function."""
    half = torch.full_like(probability, dof / 2)
    low, high = torch.zeros_like(probability), torch.full_like(probability, 2 * dof + 1000)
    for _ in range(100):
        middle = (low + high) / 2
        below = torch.special.gammainc(half, middle / 2) < probability
        low, high = torch.where(below, middle, low), torch.where(below, high, middle)
    return high
