"""The unscented Kalman filter: 2 n + 1 chosen points go through the model instead of a tangent.

The points have the mean and the covariance of the belief. Their images under f or g stand for the
image of the belief: their weighted mean and covariance are right to second order, where a tangent
is to first, and no Jacobian is taken. On a linear system this is the exact Kalman filter.
"""

import functools
import math
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from ..linalg import bmv
from ..shapes import has_numbers
from .function import Function
from .gaussian import Correction, divide, factor
from .gaussian_filter import GaussianFilter


class UKF(GaussianFilter):
    """Unscented Kalman filter: ``x[i+1], P = ukf(x[i], y[i], u[i], P, Q, R)``.

    With sigma points x + dx_j and their weights w_j, update with y[i]:

        z = mean of g(x + dx_j),  dz_j = g(x + dx_j) - z      (1)
        e = y - z                                             (2)
        S = sum w dz dz' + R                                  (3)
        K = sum w dx dz' S^-1                                 (4)
        x <- x + K e                                          (5)
        P <- sum w (dx - K dz)(dx - K dz)' + K R K'           (6)

    then, with new points, predict x[i+1]:

        x <- mean of f(x + dx_j),  dz_j = f(x + dx_j) - x     (7)
        P <- sum w dz dz' + Q                                 (8)

    (6) is Joseph's form, as in the EKF. It is a sum of squares where no weight is negative.

    Args:
        model: the system; no Jacobian is taken.
        Q: process noise covariance ``(..., n, n)``, symmetric >= 0.
        R: observation noise covariance ``(..., p, p)``, symmetric > 0.
        msqrt: a square root of a covariance, M with ``M M' = P`` or ``M' M = P``. None is
            Cholesky's factor, also of a P that is only semi-definite.
        S: covariance of the two noises of a step, ``(..., n, p)``; None is 0.
        residual: the difference of two observations, where they have angles.
        residual_x: the difference of two states, where they have angles.
        mean_x: the mean of weighted states; None follows from ``residual_x``.

    All methods take ``k > -n``, which sets how far out the points lie, see :func:`sigma_points`.
    Their other arguments and errors are those of :class:`GaussianFilter`.

    Source: D. Simon, "Optimal State Estimation" (2006), section 14.3.
    """

    def __init__(
        self,
        model,
        Q=None,
        R=None,
        msqrt=None,
        *,
        S=None,
        residual=None,
        residual_x=None,
        mean_x=None,
    ):
        differences = {"residual": residual, "residual_x": residual_x, "mean_x": mean_x}
        super().__init__(model, Q, R, S=S, **differences)
        self.msqrt = msqrt

    def forward(self, x, y, u, P, Q=None, R=None, t=None, k=None, *, S=None):  # type: ignore[override]
        """Returns x and P of the next state: corrected with y, then predicted."""
        return super().forward(x, y, u, P, Q, R, t, S=S, k=k)

    def _update(self, g: Function, x, y, P, R, k=None) -> Correction:
        dx, w = sigma_points(P, k, self.msqrt)
        z, dz = g.spread((x.unsqueeze(-1) + dx).mT, w)  # (1)
        e = g.difference(y, z)  # (2)
        S = (w * dz) @ dz.mT + R  # (3)
        K = divide((w * dx) @ dz.mT, S)  # (4)
        x = x + bmv(K, e)  # (5)
        rest = dx - K @ dz
        P = (w * rest) @ rest.mT + K @ R @ K.mT  # (6)
        return Correction(x, P, z, e, S, K)

    def _predict(self, f: Function, x, P, Q, k=None) -> tuple[Tensor, Tensor]:
        dx, w = sigma_points(P, k, self.msqrt)
        x, dz = f.spread((x.unsqueeze(-1) + dx).mT, w)  # (7)
        P = (w * dz) @ dz.mT + Q  # (8)
        return x, P


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

    The *scaled* sigma points of other libraries have three numbers, alpha, beta and kappa, and
    ``lambda = alpha^2 (n + kappa) - n``. With ``k = lambda`` the points are the same, and so are
    the weights of means. For covariances the scaled transform weighs the centre by
    ``1 - alpha^2 + beta`` more; here one set of weights serves both, so that the results are equal
    where ``beta = alpha^2 - 1``: with alpha = 1, beta = 0 and kappa = k.

    Returns:
        dx ``(..., n, 2n+1)`` and w ``(2n+1,)``.

    Source: S. Julier, J. Uhlmann, "A new extension of the Kalman filter to nonlinear systems"
    (1997); k = 0: I. Arasaratnam, S. Haykin, "Cubature Kalman filters" (2009); scaled points:
    E. Wan, R. van der Merwe, "The unscented Kalman filter for nonlinear estimation" (2000).
    """
    n = P.shape[-1]
    k = max(3 - n, 0) if k is None else k
    if not k > -n:
        raise ValueError(f"k: expected a number above -n = {-n}, got {k}")
    unit, w = _unit_points(n, float(k), P.dtype, P.device)
    return (factor(P) if msqrt is None else _square_root(msqrt, P)) @ unit, w.clone()


@functools.cache
def _unit_points(n: int, k: float, dtype: torch.dtype, device: torch.device) -> list[Tensor]:
    """Returns the sigma points of ``P = I`` as columns, and their weights."""
    eye = math.sqrt(n + k) * np.eye(n)
    points = np.concatenate([np.zeros((n, 1)), eye, -eye], axis=1)  # (1)
    weights = np.array([k / (n + k)] + 2 * n * [0.5 / (n + k)])  # (2)
    with torch.inference_mode(False):  # they are kept, and gradients may be asked for later
        return [torch.tensor(z, dtype=dtype, device=device) for z in (points, weights)]


def _square_root(msqrt: Callable, P: Tensor) -> Tensor:
    """Returns M with ``M M' = P``, whichever of the two kinds of root msqrt gives."""
    M, size = msqrt(P), P.detach().abs().amax()
    errors = [(root @ root.mT - P).abs().amax() for root in (M, M.mT)]
    if not has_numbers(size):
        return torch.where(errors[0] <= errors[1], M, M.mT)
    if not min(errors) <= math.sqrt(torch.finfo(P.dtype).eps) * size:
        raise ValueError("msqrt: expected M with M M' = P or M' M = P, got neither")
    return M if errors[0] <= errors[1] else M.mT
