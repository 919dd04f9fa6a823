"""The problem that LQR and MPC solve.

    minimise    sum_t 1/2 (z_t - r_t)' Q_t (z_t - r_t) + p_t' z_t                  z_t = [x_t, u_t]
                + 1/2 (x_T - r_T)' Qf (x_T - r_T) + pf' x_T
    subject to  x_t+1 = f(x_t, u_t, t),    lower <= u_t <= upper

over t = 0 .. T-1. `arguments.py` makes it of what users pass; everything else in this folder works
on it. Time comes first, ``(T, ..., n)``, so that batches broadcast. Whatever belongs to the last
state alone has a time dimension of 1.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from ..linalg import bmv, bvmv, bvv
from ..shapes import has_numbers
from ..systems import System
from .riccati import Box, CostToGo


class Problem(NamedTuple):
    """What is minimised, with a batch dimension for each of the plan's."""

    system: System
    t: Tensor  # time steps, (T,)
    Q: Tensor  # symmetric weights of z, (T, ..., n+m, n+m)
    p: Tensor  # linear weights of z, (T, ..., n+m)
    r: Tensor  # what z should be, (T, ..., n+m)
    Qf: Tensor  # symmetric weights of the last state, (1, ..., n, n); zeros where it costs nothing
    pf: Tensor  # linear weights of the last state, (1, ..., n)
    rf: Tensor  # what the last state should be, (1, ..., n)
    lower: Tensor | None = None  # bounds of u, (T, ..., m)
    upper: Tensor | None = None
    du: Tensor | None = None  # how far one sweep may change u, (T, ..., m)

    def members(self, rows: Tensor | slice) -> "Problem":
        """Returns the problem of some members of a batch ``(B,)``."""
        pick = [z if z is None or z.shape[1] == 1 else z[:, rows] for z in self[2:]]
        return Problem(self.system, self.t, *pick)  # type: ignore[arg-type]

    def times(self, U: Tensor) -> Tensor:
        """Returns the time steps with a dimension for each of U's batch, ``(T, 1, ..)``."""
        return self.t.reshape(-1, *[1] * (U.ndim - 2))

    def bounds(self, U: Tensor) -> Box | None:
        """Returns the least and the largest inputs that a sweep from U may choose, or None."""
        if self.lower is None and self.upper is None and self.du is None:
            return None
        free = torch.full_like(U, torch.inf)
        lower = -free if self.lower is None else self.lower
        upper = free if self.upper is None else self.upper
        du = free if self.du is None else self.du
        return torch.maximum(lower, U - du), torch.minimum(upper, U + du)

    def box(self, U: Tensor) -> Box | None:
        """Returns how far each input may go down and up from U in one sweep, or None."""
        bounds = self.bounds(U)
        return None if bounds is None else (bounds[0] - U, bounds[1] - U)

    def within_du_of(self, U: Tensor) -> "Problem":
        """Returns the problem whose bounds keep every input within ``du`` of U."""
        bounds = self.bounds(U)
        return self if bounds is None else self._replace(lower=bounds[0], upper=bounds[1], du=None)

    def clamp(self, U: Tensor) -> Tensor:
        """Returns the inputs within their lower and upper bounds."""
        U = U if self.lower is None else torch.maximum(U, self.lower)
        return U if self.upper is None else torch.minimum(U, self.upper)

    def cost(self, X: Tensor, U: Tensor) -> Tensor:
        """Returns the total cost ``(...)`` of ``X (T+1, ..., n)`` and ``U (T, ..., m)``."""
        z = torch.cat([X[:-1], U], dim=-1)
        steps = bvmv(z - self.r, self.Q, z - self.r) / 2 + bvv(self.p, z)
        off = X[-1:] - self.rf
        last = bvmv(off, self.Qf, off) / 2 + bvv(self.pf, X[-1:])
        return steps.sum(0) + last[0]

    def expand_cost(self, X: Tensor, U: Tensor) -> tuple[Tensor, Tensor]:
        """Returns the slope and the curvature of each step's cost in z, at a plan.

        They are ``q (T, ..., n+m)`` and ``Q (T, ..., n+m, n+m)``.
        """
        q = bmv(self.Q, torch.cat([X[:-1], U], -1) - self.r) + self.p
        return q, self.Q.expand(*q.shape, q.shape[-1])

    def last_cost_to_go(self, X: Tensor) -> CostToGo:
        """Returns what a change of the last state of a plan adds to the cost."""
        v = bmv(self.Qf, X[-1:] - self.rf) + self.pf
        V = self.Qf.expand(*v.shape, v.shape[-1])
        return CostToGo(V[0], v[0], torch.zeros_like(v[0, ..., 0]))


def rollout(problem: Problem, x_init: Tensor, U: Tensor) -> Tensor:
    """Returns the states ``(T+1, ..., n)`` that the inputs ``(T, ..., m)`` lead to."""
    X = [x_init]
    for t, u in zip(problem.t, U):
        X.append(problem.system.transition(X[-1], u, t))
    return torch.stack(torch.broadcast_tensors(*X))


def refuse_divergence(X: Tensor, cost: Tensor) -> None:
    """Raises ValueError where a cost is not finite, naming the first of the states that is not.

    Args:
        X: a rollout, ``(T+1, ..., n)``.
        cost: the least that is known of for these members, ``(...)``.
    """
    if not has_numbers(cost) or torch.isfinite(cost).all():
        return
    lost = ~torch.isfinite(cost)[..., None] & ~torch.isfinite(X)
    if lost.any():
        step = int(lost.nonzero()[0, 0])
        raise ValueError(f"x_init: the rollout from it diverges, x[{step}] is not finite")
    raise ValueError("x_init: the rollout from it diverges, its cost is not finite")
