"""The smoother: what a recorded run says of each of its states, once all of it is known."""

import torch
from torch import Tensor

from ..linalg import bmv
from ..shapes import check
from .base import GaussianFilter


def smooth(
    filter: GaussianFilter, x: Tensor, P: Tensor, y: Tensor, u: Tensor, Q=None, R=None, t=0
) -> tuple[Tensor, Tensor]:
    """Returns mean and covariance of all states of a run, given all of its observations.

    The run is what the loop ``x[i+1], P[i+1] = filter(x[i], y[i], u[i], P[i], Q, R)`` recorded.
    With x+ and P+ corrected by y[i], and G, x' and V from ``filter.reverse``:

        xs[i] = x+[i] + G[i] (xs[i+1] - x'[i])        (1)
        Ps[i] = V[i] + G[i] Ps[i+1] G[i]'             (2)

    V is what is left of the covariance once the next state is known, in Joseph's form, so that
    (2) is a sum of squares. All corrections and gains come from one batched call.

    Args:
        filter: the EKF or UKF that made the run.
        x: the filter's means ``(..., T+1, n)``.
        P: the filter's covariances ``(..., T+1, n, n)``.
        y: observations ``(..., T, p)``, NaN where there was none.
        u: inputs ``(..., T, m)``.
        Q: process noise covariance ``(..., n, n)``, the same at every step; None is the filter's.
        R: observation noise covariance ``(..., p, p)``, likewise.
        t: time step of the first observation.

    Returns:
        ``(..., T+1, n)`` and ``(..., T+1, n, n)``; the last are the filter's own.

    Raises:
        ValueError: for arguments that do not fit, or where Q leaves a predicted state certain.

    Source: H. Rauch, F. Tung, C. Striebel, "Maximum likelihood estimates of linear dynamic
    systems" (1965); D. Simon, "Optimal State Estimation" (2006), section 9.4.2.
    """
    T = y.shape[-2]
    check("x: S n, P: S n n, y: T p, u: T m", x, P, torch.nan_to_num(y), u, T=T, S=T + 1)
    x, P, y, u = _time_first(x, P, y, u)
    times = (t + torch.arange(T, device=x.device)).reshape(-1, *[1] * (x.ndim - 2))
    xf, Pf = filter.update(x[:-1], y, u, P[:-1], R, times)
    xp, G, V = filter.reverse(xf, u, Pf, Q, times)
    xs, Ps = [x[-1]], [P[-1]]
    for i in reversed(range(T)):
        xs.append(xf[i] + bmv(G[i], xs[-1] - xp[i]))  # (1)
        Ps.append(V[i] + G[i] @ Ps[-1] @ G[i].mT)  # (2)
    return torch.stack(xs[::-1], dim=-2), torch.stack(Ps[::-1], dim=-3)


def _time_first(x: Tensor, P: Tensor, y: Tensor, u: Tensor) -> list[Tensor]:
    """Returns the run with one batch for all, and time before it, where the filter maps over it."""
    sizes = x.shape[:-2], P.shape[:-3], y.shape[:-2], u.shape[:-2]
    batch, cores = torch.broadcast_shapes(*sizes), (2, 3, 2, 2)
    run = (z.expand(*batch, *z.shape[-core:]) for z, core in zip((x, P, y, u), cores))
    return [z.movedim(-core, 0) for z, core in zip(run, cores)]
