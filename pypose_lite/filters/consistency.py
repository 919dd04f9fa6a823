"""Is a filter as sure as it may be? Errors and innovations against their own covariances.

A filter says how far off it may be. Whether that is true shows over many runs, where NEES, the
squared error measured in units of P, has to be n on average at every time step. NIS asks the same
of the innovation, and needs no truth, so that it can be watched on a robot.
"""

import torch
from torch import Tensor

from ..shapes import check
from .differences import Difference, difference_and_mean
from .gaussian import Innovation, squared_distance


def nees(x: Tensor, P: Tensor, truth: Tensor, residual_x: Difference | None = None) -> Tensor:
    """Returns the normalised estimation error squared ``(x - truth)' P^-1 (x - truth)``.

    Of a consistent filter it is chi-square distributed with n degrees of freedom: n on average,
    more when the filter is too sure, less when it is too modest.

    Args:
        x: estimates ``(..., n)``.
        P: their covariances ``(..., n, n)``, symmetric > 0.
        truth: the states ``(..., n)``.
        residual_x: the difference of two states, where they have angles, as the filter's.

    Source: Y. Bar-Shalom, X. Li, T. Kirubarajan, "Estimation with Applications to Tracking and
    Navigation" (2001), section 5.4.
    """
    check("x: n, P: n n, truth: n", x, P, truth)
    difference, _ = difference_and_mean(residual_x, name="residual_x")
    e = difference(x, truth)
    return squared_distance(e.unsqueeze(-1), P, "P")[0].squeeze(-1)


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

    Independent are the NEES of M runs at *one* time step: ``chi_square_interval(n, runs=M)``, a
    band that a plot of their mean over time should leave at one step in twenty. Independent are,
    too, all NIS of M runs of T steps: ``chi_square_interval(p, runs=M * T)``. The NEES of one run
    at different steps are not: errors last. Their average over M runs *and* T steps spreads less
    than the band of one step, but more than ``runs=M * T`` would say. What holds for it comes from
    the runs themselves. Each has a mean of its own, and these M means are independent:

        means = nees.mean(-1)                                    # (M, T) -> (M,)
        half = 2 * means.std() / M**0.5                          # 95 %, for M of 20 or more
        consistent = abs(means.mean() - n) < half

    Args:
        dof: degrees of freedom of one: n for the NEES, p for the NIS.
        runs: how many independent ones are averaged.
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
