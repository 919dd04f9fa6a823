"""The extended Kalman filter: the model's tangents at the estimate."""

import torch
from torch import Tensor

from .base import GaussianFilter
from .gaussian import Joint, factor


class EKF(GaussianFilter):
    """Extended Kalman filter: ``x[i+1], P = ekf(x[i], y[i], u[i], P, Q, R)``.

    It sees the model through its tangents at the estimate:

        g(x + dx) = g(x) + C dx      (1)
        f(x + dx) = f(x) + A dx      (2)

    An update is S = C P C' + R, K = P C' S^-1, x <- x + K (y - g(x)), P <- (I - K C) P (I - K C)'
    + K R K'; a prediction x' = f(x), P' = A P A' + Q. Both are computed from L, where P = L L',
    and C L: small variances keep twice as many digits.

    Args:
        model: the system; of its Jacobians only A and C are taken, once each.
        Q: process noise covariance ``(..., n, n)``, symmetric >= 0.
        R: observation noise covariance ``(..., p, p)``, symmetric > 0.
        residual: the difference of two observations, for angles.

    Source: D. Simon, "Optimal State Estimation" (2006), section 13.2.
    """

    def joint_transition(self, x, u, P, t) -> Joint:
        """Returns the tangent of f at x."""
        f, A = self.model.linearize_transition(x, u, t, wrt="x")  # (2)
        return tangent(f, A, P)

    def joint_observation(self, x, u, P, t) -> Joint:
        """Returns the tangent of g at x."""
        g, C = self.model.linearize_observation(x, u, t, wrt="x")  # (1)
        return tangent(g, C, P)


def tangent(z: Tensor, C: Tensor, P: Tensor) -> Joint:
    """Returns how x and ``z + C dx`` vary together: over the columns of L, with P = L L'."""
    L = factor(P)
    return Joint(z, L, C @ L, torch.ones(L.shape[-1], dtype=L.dtype, device=L.device))
