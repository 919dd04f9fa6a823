"""Models, runs, and the dense Gaussian of a whole run that the filters are compared with."""

from typing import NamedTuple

import numpy as np
import scipy.stats
import torch
from torch import nn

import pypose_lite as pp
from pypose_lite.filters import EKF, PF, UKF

FILTERS = {"EKF": EKF, "UKF": UKF, "PF": PF}
BATCHES = [(), (1,), (3,), (2,), (5,), (2, 3)]  # with n = 2: (n,) and (2n+1,) among them


def close(a, b, atol=1e-12):
    torch.testing.assert_close(a, b, atol=atol, rtol=0)


def draw(g, *shape):
    return torch.randn(*shape, generator=g, dtype=torch.float64)


def spd(g, n, lead=(), scale=1.0):
    """A covariance with correlations."""
    W = draw(g, *lead, n, n)
    return scale * (W @ W.mT / n + 0.2 * torch.eye(n, dtype=W.dtype))


class Linear(NamedTuple):
    """``x' = A x + B u + c1 + w``, ``y = C x + D u + c2 + v``, and a belief to start with."""

    A: torch.Tensor
    B: torch.Tensor
    C: torch.Tensor
    D: torch.Tensor
    c1: torch.Tensor
    c2: torch.Tensor
    Q: torch.Tensor
    R: torch.Tensor
    x: torch.Tensor
    P: torch.Tensor

    @property
    def model(self):
        return pp.LTI(*self[:6])

    def run(self, g, T, lead=()):
        """States ``(*lead, T+1, n)``, inputs and observations ``(*lead, T, .)``."""
        n, m, p = self.A.shape[-1], self.B.shape[-1], self.C.shape[-2]
        root_P, root_Q, root_R = (torch.linalg.cholesky(S) for S in (self.P, self.Q, self.R))
        u = 3 * draw(g, *lead, T, m)  # long steps: an index off by one shows
        x, y = [self.x + draw(g, *lead, n) @ root_P.mT], []
        for i in range(T):
            noise = draw(g, *lead, p) @ root_R.mT
            y.append(x[i] @ self.C.mT + u[..., i, :] @ self.D.mT + self.c2 + noise)
            f = x[i] @ self.A.mT + u[..., i, :] @ self.B.mT + self.c1
            x.append(f + draw(g, *lead, n) @ root_Q.mT)
        return torch.stack(x, -2), u, torch.stack(y, -2)


def linear(g, n=2, m=1, p=2, radius=0.95):
    A = draw(g, n, n)
    A = radius * A / torch.linalg.eigvals(A).abs().max()
    B, C, D, c1, c2 = draw(g, n, m), draw(g, p, n), draw(g, p, m), draw(g, n), draw(g, p)
    return Linear(A, B, C, D, c1, c2, spd(g, n, scale=0.1), spd(g, p), draw(g, n), spd(g, n))


def dense(system, u):
    """Means and maps of all states and of all observations: one Gaussian for the whole run.

    All that is random (the first state, w, v) is one vector of unit variance; every state and
    every observation is a linear function of it, ``mean + map @ vector``.
    """
    A, B, C, D, c1, c2, Q, R, x, P = (part.numpy() for part in system)
    n, p, roots = len(A), len(C), [np.linalg.cholesky(S) for S in (P, Q, R)]
    mean, map_x = x, np.zeros((n, n + len(u) * (n + p)))
    map_x[:, :n] = roots[0]
    X, Y = [(mean, map_x)], []
    for i, now in enumerate(u.numpy()):
        at = n + i * (n + p)
        map_y = C @ map_x
        map_y[:, at + n : at + n + p] += roots[2]
        Y.append((C @ mean + D @ now + c2, map_y))
        mean, map_x = A @ mean + B @ now + c1, A @ map_x
        map_x[:, at : at + n] += roots[1]
        X.append((mean, map_x))
    return [np.concatenate(part) for part in (*zip(*X, strict=True), *zip(*Y, strict=True))]


def whole_run(system, u, y, known):
    """Mean and covariance of all states given ``y[:known]``."""
    means, maps, expected, seen = dense(system, u)
    n, rows = len(system.A), known * len(system.C)
    seen, e = seen[:rows], y.numpy().ravel()[:rows] - expected[:rows]
    gain = np.linalg.solve(seen @ seen.T, seen @ maps.T).T
    means, covariance = means + gain @ e, maps @ maps.T - gain @ seen @ maps.T
    starts = range(0, len(means), n)
    blocks = np.stack([covariance[i : i + n, i : i + n] for i in starts])
    return torch.tensor(means.reshape(-1, n)), torch.tensor(blocks)


def whole_log_likelihood(system, u, y):
    """The log-density of all observations."""
    _, _, expected, seen = dense(system, u)
    return scipy.stats.multivariate_normal(expected, seen @ seen.T).logpdf(y.numpy().ravel())


def textbook(system, u, y):
    """All predictions of the Kalman filter, as a course writes it down first."""
    A, B, C, D, c1, c2, Q, R, x, P = (part.numpy() for part in system)
    xs, Ps = [x], [P]
    for i in range(len(u)):
        K = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
        x = x + K @ (y[i].numpy() - C @ x - D @ u[i].numpy() - c2)
        P = P - K @ C @ P
        x, P = A @ x + B @ u[i].numpy() + c1, A @ P @ A.T + Q
        xs.append(x)
        Ps.append(P)
    return torch.tensor(np.stack(xs)), torch.tensor(np.stack(Ps))


def record(filter, x, P, y, u, *noise, **options):
    """The loop of the book: means ``(..., T+1, n)`` and covariances ``(..., T+1, n, n)``."""
    xs, Ps = [x], [P]
    for i in range(y.shape[-2]):
        x, P = filter(x, y[..., i, :], u[..., i, :], P, *noise, **options)
        xs.append(x)
        Ps.append(P)
    return torch.stack(xs, -2), torch.stack(Ps, -3)


class Bend(pp.NLS):
    """A curved model for one sample, n = 2, m = 1, p = 2, with a parameter to learn."""

    def __init__(self, strength=0.3):
        super().__init__()
        self.strength = nn.Parameter(torch.tensor(strength, dtype=torch.float64))

    def state_transition(self, state, input, t=None):
        a, b = state
        return torch.stack([a + self.strength * b.sin(), 0.9 * b + input[0] * a.cos()])

    def observation(self, state, input, t=None):
        a, b = state
        return torch.stack([a + self.strength * a * b, b.exp() + input[0]])


class Still(pp.NLS):
    """A state that stays where it is, and is seen as it is."""

    vectorized = True

    def state_transition(self, state, input, t=None):
        return state

    def observation(self, state, input, t=None):
        return state


def one_step(g, lead=(), n=2, m=1, p=2):
    """``x, y, u, P, Q, R``."""
    return (
        draw(g, *lead, n),
        draw(g, *lead, p),
        draw(g, *lead, m),
        spd(g, n, lead, 0.1),
        spd(g, n, lead, 0.05),
        spd(g, p, lead, 2.0),
    )
