"""The unscented Kalman filter: 2 n + 1 chosen points go through the model instead of a tangent."""

import functools
import math
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from .base import GaussianFilter
from .gaussian import Joint, factor, spread


class UKF(GaussianFilter):
    """Unscented Kalman filter: ``x[i+1], P = ukf(x[i], y[i], u[i], P, Q, R)``.

    The same steps as the EKF's, with :func:`sigma_points` for its tangents; they are drawn
    anew after the correction.

    Args:
        model: the system; no Jacobian is taken.
        Q: process noise covariance ``(..., n, n)``, symmetric >= 0.
        R: observation noise covariance ``(..., p, p)``, symmetric > 0.
        msqrt: a square root of a covariance, M with ``M M' = P`` or ``M' M = P``. None is
            Cholesky's factor, also of a P that is only semi-definite.
        residual: the difference of two observations, for angles.

    All methods take ``k > -n``, the weight of the centre against the others, see
    :func:`sigma_points`.

    Source: D. Simon, "Optimal State Estimation" (2006), section 14.3.
    """

    def __init__(self, model, Q=None, R=None, msqrt=None, *, residual=None):
        super().__init__(model, Q, R, residual=residual)
        self.msqrt = msqrt

    def forward(self, x, y, u, P, Q=None, R=None, t=None, k=None):  # type: ignore[override]
        """Returns x and P of the next state: corrected with y, then predicted."""
        return super().forward(x, y, u, P, Q, R, t, k=k)

    def joint_transition(self, x, u, P, t, k=None) -> Joint:
        """Returns how x and f(x, u, t) vary over the sigma points."""
        dx, w = sigma_points(P, k, self.msqrt)
        return spread(lambda x: self.model.transition(x, u, t), x, dx, w, torch.sub)

    def joint_observation(self, x, u, P, t, k=None) -> Joint:
        """Returns how x and g(x, u, t) vary over the sigma points."""
        dx, w = sigma_points(P, k, self.msqrt)
        return spread(lambda x: self.model.observe(x, u, t), x, dx, w, self.residual)


def sigma_points(P: Tensor, k=None, msqrt: Callable | None = None) -> tuple[Tensor, Tensor]:
    """Returns 2 n + 1 points about zero with covariance P, as columns, and their weights.

        dx = sqrt(n + k) [0, L, -L],  L L' = P          (1)
        w = [k, 1/2, ..., 1/2] / (n + k)                (2)

    Args:
        P: ``(..., n, n)``, symmetric >= 0.
        k: any number above -n. None is ``max(3 - n, 0)``: up to n = 3 the points then have a
            Gaussian's fourth moments; above, 3 - n would be a negative weight, which can make
            a covariance indefinite, and 0 is the nearest that cannot (the cubature rule).
        msqrt: as in :class:`UKF`.

    Returns:
        dx ``(..., n, 2n+1)`` and w ``(2n+1,)``.

    Source: S. Julier, J. Uhlmann, "A new extension of the Kalman filter to nonlinear systems"
    (1997); k = 0: I. Arasaratnam, S. Haykin, "Cubature Kalman filters" (2009).
    """
    n = P.shape[-1]
    k = max(3 - n, 0) if k is None else k
    if not k > -n:
        raise ValueError(f"k: expected a number above -n = {-n}, got {k}")
    unit, w = (z.to(P, copy=True) for z in _unit_points(n, float(k)))
    return (factor(P) if msqrt is None else _square_root(msqrt, P)) @ unit, w


@functools.cache
def _unit_points(n: int, k: float) -> tuple[Tensor, Tensor]:
    """Returns the sigma points of ``P = I`` as columns, and their weights."""
    eye = math.sqrt(n + k) * np.eye(n)
    points = np.concatenate([np.zeros((n, 1)), eye, -eye], axis=1)  # (1)
    weights = np.array([k / (n + k)] + 2 * n * [0.5 / (n + k)])  # (2)
    return torch.from_numpy(points), torch.from_numpy(weights)


def _square_root(msqrt: Callable, P: Tensor) -> Tensor:
    """Returns M with ``M M' = P``, whichever of the two kinds of root msqrt gives."""
    M, size = msqrt(P), P.detach().abs().amax()
    tolerance = math.sqrt(torch.finfo(P.dtype).eps) * size
    for root in (M, M.mT):
        if (root @ root.mT - P).abs().amax() <= tolerance:
            return root
    raise ValueError("msqrt: expected M with M M' = P or M' M = P, got neither")
