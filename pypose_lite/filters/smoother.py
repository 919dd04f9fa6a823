"""The smoother: what a recorded run says of each of its states, once all of it is known.

A filter's estimate knows the past. The smoother walks back over the run: what x[i+1] turned out to
be corrects x[i], as an observation would, since the next state is a function of this one plus
noise. Nothing but the correction itself depends on what came later, so all gains of a run come
from two batched calls of the filter, and only a short loop is left.
"""

import torch
from torch import Tensor

from ..linalg import bmv
from ..shapes import check, over_time
from .gaussian_filter import GaussianFilter


def smooth(
    filter: GaussianFilter, x: Tensor, P: Tensor, y: Tensor, u: Tensor, Q=None, R=None, t=0, S=None
) -> tuple[Tensor, Tensor]:
    """Returns mean and covariance of all states of a run, given all of its observations.

    The run is what the loop ``x[i+1], P[i+1] = filter(x[i], y[i], u[i], P[i], Q, R)`` recorded.
    With x+ and P+ corrected by y[i], and G, x' and V from ``filter.reverse``:

        xs[i] = x+[i] + G[i] (xs[i+1] - x'[i])        (1)
        Ps[i] = V[i] + G[i] Ps[i+1] G[i]'             (2)

    V is what is left of the covariance once the next state is known, in Joseph's form, so that
    (2) is a sum of squares. The difference in (1) is the filter's ``residual_x``.

    Args:
        filter: the EKF or UKF that made the run.
        x: the filter's means ``(..., T+1, n)``.
        P: the filter's covariances ``(..., T+1, n, n)``.
        y: observations ``(..., T, p)``, NaN where there was none.
        u: inputs ``(..., T, m)``.
        Q: process noise covariance: one for all, ``(n, n)``; one for each member of the batch,
            ``(..., n, n)``; one a step, ``(T, n, n)``; or both, ``(..., T, n, n)``. None is the
            filter's.
        R: observation noise covariance ``(p, p)``, likewise.
        t: time step of the first observation.
        S: covariance of the two noises of a step ``(n, p)``, likewise.

    Returns:
        ``(..., T+1, n)`` and ``(..., T+1, n, n)``; the last are the filter's own.

    Raises:
        ValueError: for arguments that do not fit, where one may be a batch or steps, or where Q
            leaves a predicted state certain.

    Source: H. Rauch, F. Tung, C. Striebel, "Maximum likelihood estimates of linear dynamic
    systems" (1965); D. Simon, "Optimal State Estimation" (2006), section 9.4.2.
    """
    T = y.shape[-2]
    check("x: S n, P: S n n, y: T p, u: T m", x, P, torch.nan_to_num(y), u, T=T, S=T + 1)
    x, P, y, u = _time_first(x, P, y, u)
    noise = {"Q": Q, "R": R, "S": S}
    Q, R, S = (_noise(filter, *given, y, x.shape[-1]) for given in noise.items())
    times = (t + torch.arange(T, device=x.device)).reshape(-1, *[1] * (x.ndim - 2))
    xf, Pf = filter.update(x[:-1], y, u, P[:-1], R, times)
    xp, G, V = filter.reverse(xf, u, Pf, Q, times, y=y, R=R, S=S)
    xs, Ps = [x[-1]], [P[-1]]
    for i in reversed(range(T)):
        xs.append(xf[i] + bmv(G[i], filter.residual_x(xs[-1], xp[i])))  # (1)
        Pi = V[i] + G[i] @ Ps[-1] @ G[i].mT  # (2)
        Ps.append((Pi + Pi.mT) / 2)
    return torch.stack(xs[::-1], dim=-2), torch.stack(Ps[::-1], dim=-3)


def _noise(filter: GaussianFilter, name: str, value: Tensor | None, y: Tensor, n: int):
    """Returns a covariance for every step and member, time first; None where there is none."""
    value = getattr(filter, name) if value is None else value
    if not isinstance(value, Tensor):
        return value  # the filter says what it expects
    (T, *batch), p = y.shape[:-1], y.shape[-1]
    sizes = {"Q": (n, n), "R": (p, p), "S": (n, p)}[name]
    value = over_time(name, value, sizes, T, tuple(batch))
    lead = value.shape[1:-2]
    return value.reshape(T, *[1] * (len(batch) - len(lead)), *lead, *sizes)


def _time_first(x: Tensor, P: Tensor, y: Tensor, u: Tensor) -> list[Tensor]:
    """Returns the run with one batch for all, and time before it, where the filter maps over it."""
    sizes = x.shape[:-2], P.shape[:-3], y.shape[:-2], u.shape[:-2]
    batch, cores = torch.broadcast_shapes(*sizes), (2, 3, 2, 2)
    run = (z.expand(*batch, *z.shape[-core:]) for z, core in zip((x, P, y, u), cores))
    return [z.movedim(-core, 0) for z, core in zip(run, cores)]
