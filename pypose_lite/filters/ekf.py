"""The extended Kalman filter: Kalman's equations, with the model's tangents at the estimate.

Near the estimate, f(x + dx) = f(x) + A dx and g(x + dx) = g(x) + C dx, with the Jacobians A and C
there. On a linear system this is the exact Kalman filter; elsewhere it is as good as the tangents
are over the width of P. The public methods, which call the two below, are in
``gaussian_filter.py``.
"""

from torch import Tensor

from ..linalg import bmv
from .function import Function
from .gaussian import Correction, divide, factor, square
from .gaussian_filter import GaussianFilter


class EKF(GaussianFilter):
    """Extended Kalman filter: ``x[i+1], P = ekf(x[i], y[i], u[i], P, Q, R)``.

    Update with y[i]:

        e = y - g(x, u)                            (1)
        S = C P C' + R                             (2)
        K = P C' S^-1                              (3)
        x <- x + K e                               (4)
        P <- (I - K C) P (I - K C)' + K R K'       (5)

    then predict x[i+1]:

        x <- f(x, u)                               (6)
        P <- A P A' + Q                            (7)

    (5) is Joseph's form of (I - K C) P. P enters by its root L, ``P = L L'``, so that each product
    M P M' is the square of M L: small variances keep twice as many digits.

    Args:
        model: the system; of its Jacobians only A and C are taken, once each.
        Q: process noise covariance ``(..., n, n)``, symmetric >= 0.
        R: observation noise covariance ``(..., p, p)``, symmetric > 0.
        S: covariance of the two noises of a step, ``(..., n, p)``; None is 0.
        residual: the difference of two observations, where they have angles.
        residual_x: the difference of two states, where they have angles; only the smoother asks.
        mean_x: taken for the sake of the other filters, whose calls are the same; never asked.

    Methods, arguments and errors are those of :class:`GaussianFilter`.

    Source: D. Simon, "Optimal State Estimation" (2006), section 13.2.
    """

    def _update(self, g: Function, x, y, P, R) -> Correction:
        z, C = g.tangent(x)
        L = factor(P)
        e = g.difference(y, z)  # (1)
        S = square(C @ L) + R  # (2)
        K = divide(L @ (C @ L).mT, S)  # (3)
        x = x + bmv(K, e)  # (4)
        P = square(L - K @ C @ L) + K @ R @ K.mT  # (5)
        return Correction(x, P, z, e, S, K)

    def _predict(self, f: Function, x, P, Q) -> tuple[Tensor, Tensor]:
        x, A = f.tangent(x)  # (6)
        P = square(A @ factor(P)) + Q  # (7)
        return x, P
