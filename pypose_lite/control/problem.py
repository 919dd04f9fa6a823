"""The problem that LQR and MPC solve, and how users state it.

    minimise    sum_t 1/2 (z_t - r_t)' Q_t (z_t - r_t) + p_t' z_t,    z_t = [x_t, u_t]
    subject to  x_t+1 = f(x_t, u_t, t),    lower <= u_t <= upper

over t = 0 .. T-1. Users write sequences as ``(..., T, n)`` and z as ``[x, u]``; inside, time
comes first, ``(T, ..., n)``, so that batches broadcast, and inputs come before states, so that
the Riccati step solves for a leading block.
"""

import math
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from ..linalg import bmv, bvmv, bvv
from ..shapes import alike, check, join, over_time
from ..systems import System


class Problem(NamedTuple):
    """What is minimised; each tensor is ``(T, ..., ·)`` or None, inputs before states."""

    system: System
    t: Tensor  # time steps, (T,)
    Q: Tensor  # symmetric weights of [u, x]
    p: Tensor  # linear weights of [u, x]
    r: Tensor  # what [u, x] should be
    lower: Tensor | None = None  # bounds of u
    upper: Tensor | None = None
    du: Tensor | None = None  # how far one sweep may change u

    def members(self, rows: Tensor | slice) -> "Problem":
        """Returns the problem of some members of a batch ``(B,)``."""
        pick = [z if z is None or z.shape[1] == 1 else z[:, rows] for z in self[2:]]
        return Problem(self.system, self.t, *pick)  # type: ignore[arg-type]

    def times(self, U: Tensor) -> Tensor:
        """Returns the time steps with a dimension for each of U's batch, ``(T, 1, ..)``."""
        return self.t.reshape(-1, *[1] * (U.ndim - 2))

    def limits(self, U: Tensor) -> tuple[Tensor, Tensor] | None:
        """Returns the least and the largest inputs that a sweep from U may choose, or None."""
        if self.lower is None and self.upper is None and self.du is None:
            return None
        free = torch.full_like(U, torch.inf)
        lower = -free if self.lower is None else self.lower
        upper = free if self.upper is None else self.upper
        du = free if self.du is None else self.du
        return torch.maximum(lower, U - du), torch.minimum(upper, U + du)

    def box(self, U: Tensor) -> tuple[Tensor, Tensor] | None:
        """Returns how far each input may go down and up from U in one sweep, or None."""
        limits = self.limits(U)
        return None if limits is None else (limits[0] - U, limits[1] - U)

    def near(self, U: Tensor) -> "Problem":
        """Returns the problem whose bounds keep every input within ``du`` of U."""
        limits = self.limits(U)
        return self if limits is None else self._replace(lower=limits[0], upper=limits[1], du=None)

    def clip(self, U: Tensor) -> Tensor:
        """Returns the inputs within their bounds."""
        U = U if self.lower is None else torch.maximum(U, self.lower)
        return U if self.upper is None else torch.minimum(U, self.upper)

    def cost(self, X: Tensor, U: Tensor) -> Tensor:
        """Returns the total cost ``(...)`` of ``X (T+1, ..., n)`` and ``U (T, ..., m)``."""
        z = torch.cat([U, X[:-1]], dim=-1)
        return (bvmv(z - self.r, self.Q, z - self.r) / 2 + bvv(self.p, z)).sum(0)

    def check(self, m: int) -> None:
        """Raises ValueError where there is nothing to minimise over m inputs."""
        if torch.linalg.cholesky_ex(self.Q[..., :m, :m].detach()).info.any():
            raise ValueError("Q: its block of u must be positive definite at every step")
        if self.lower is not None and self.upper is not None and (self.lower > self.upper).any():
            raise ValueError("u_lower: expected no more than u_upper")
        if self.du is not None and not (self.du > 0).all():
            raise ValueError("du: expected a positive change")

    def expand_cost(self, x: Tensor, u: Tensor) -> tuple[Tensor, Tensor]:
        """Returns the slope and the curvature of each step's cost in ``[u, x]``.

        They are ``q (..., m+n)`` and ``Q (..., m+n, m+n)``.
        """
        q = bmv(self.Q, torch.cat([u, x], -1) - self.r) + self.p
        return q, self.Q.expand(*q.shape, q.shape[-1])


def rollout(problem: Problem, x_init: Tensor, U: Tensor) -> Tensor:
    """Returns the states ``(T+1, ..., n)`` that the inputs ``(T, ..., m)`` lead to."""
    X = [x_init]
    for t, u in zip(problem.t, U):
        X.append(problem.system.transition(X[-1], u, t))
    return torch.stack(torch.broadcast_tensors(*X))


class OptimalControl(nn.Module):
    """A system and a quadratic cost over T steps: what LQR and MPC have in common.

    Args:
        system: any :class:`System`; its clock says when a plan starts.
        Q: weights of ``z = [x, u]``: ``(n+m, n+m)``, one for each step ``(T, n+m, n+m)``, or
            with leading batch dimensions. Its symmetric part counts; that of u must be > 0.
        p: linear weights, likewise ``(n+m,)`` to ``(..., T, n+m)``, or None.
        T: how many steps to plan.

    The state after the last step costs nothing, as in PyPose.
    """

    system: System
    Q: Tensor
    p: Tensor | None
    start = "u_init"  # what the call's inputs to start from are called

    def __init__(self, system: System, Q: Tensor, p: Tensor | None, T: int):
        super().__init__()
        if not isinstance(T, int) or T < 1:
            raise ValueError(f"T: expected a number of steps, at least one, got {T!r}")
        if not isinstance(Q, Tensor):
            raise ValueError(f"Q: expected a floating-point tensor, got {type(Q).__name__}")
        check("p: k", p, **check("Q: k k", Q))  # apart: one may have steps, the other a batch
        self.system, self.T = system, T
        for name, value in (("Q", Q), ("p", p)):
            if isinstance(value, nn.Parameter):
                self.register_parameter(name, value)
            else:
                self.register_buffer(name, value)

    def _pose(self, x_init, dt, u_init, u_lower, u_upper, du, target=None):
        """Returns the problem, x_init and the inputs to start from: checked, time first.

        The fourth result is whether x_init, the weights, the bounds or the system want a gradient.
        """
        n, m = self._sizes(x_init)
        k, none = n + m, x_init.new_zeros(n + m)
        names = ("Q", "p", "target", "u_lower", "u_upper", "du", self.start)
        for name, value in zip(names[:3] + names[-1:], (self.Q, self.p, target, u_init)):
            alike(name, value, x_init)
        check_step(self.system, dt)
        moved = self.system.transition(x_init, none[n:])
        batch = tuple(moved.shape[:-1])

        def timed(name, value, *sizes):
            return None if value is None else over_time(name, value, sizes, self.T, batch)

        tensors = [
            timed("Q", ((self.Q + self.Q.mT) / 2).roll((m, m), (-2, -1)), k, k),
            timed("p", none if self.p is None else self.p.roll(m, -1), k),
            _reference(target, x_init, m, self.T),
            timed("u_lower", _bound("u_lower", u_lower, x_init, m), m),
            timed("u_upper", _bound("u_upper", u_upper, x_init, m), m),
            timed("du", _bound("du", du, x_init, m), m),
            timed(self.start, none[n:] if u_init is None else u_init, m),
        ]
        cores = (2, 1, 1, 1, 1, 1, 1)
        for name, z, core in zip(names, tensors, cores):
            batch = batch if z is None else join(name, tuple(z.shape[1 : z.ndim - core]), batch)
        *parts, U = [_padded(z, c, len(batch)) for z, c in zip(tensors, cores)]
        t = self.system.systime + torch.arange(self.T, device=self.system.systime.device)
        problem = Problem(self.system, t, *parts)
        problem.check(m)
        x_init = x_init.clone()  # of x[i], where a loop writes x[i+1] beside it
        graph = any(z is not None and z.requires_grad for z in (moved, *parts))
        return problem, x_init.expand(*batch, n), U.expand(self.T, *batch, m), graph

    def _sizes(self, x_init: Tensor) -> tuple[int, int]:
        """Returns n and m, of which Q has to be made."""
        if not isinstance(x_init, Tensor):
            kind = type(x_init).__name__
            raise ValueError(f"x_init: expected a floating-point tensor, got {kind}")
        sizes = self.system.check_point("x_init", x_init)
        n, k = sizes["n"], self.Q.shape[-1]
        m = sizes.get("m", k - n)
        if m < 1 or k != n + m:
            made = f"n={n} and m={sizes['m']}" if "m" in sizes else f"n={n} of x_init"
            raise ValueError(f"Q: expected (..., n+m, n+m) with {made}, got {tuple(self.Q.shape)}")
        return n, m


def check_step(system: System, dt) -> None:
    """Raises ValueError where dt is not the time step that the system itself states."""
    if dt is not None and not (isinstance(dt, float | int | Tensor) and dt > 0):
        raise ValueError(f"dt: expected a positive time step, got {dt!r}")
    own = getattr(system, "dt", None)
    if dt is not None and isinstance(own, float | int) and not math.isclose(own, dt, rel_tol=1e-6):
        raise ValueError(f"dt: the system steps by {own}, got {dt}")


def _reference(target: Tensor | None, x_init: Tensor, m: int, T: int) -> Tensor:
    """Returns where ``[u, x]`` should be, ``(T, ..., m+n)``; a target is a state or T of them."""
    check("target: n", target, n=x_init.shape[-1])
    target = x_init.new_zeros(x_init.shape[-1]) if target is None else target
    target = target.unsqueeze(-2) if target.ndim <= x_init.ndim else target
    if target.shape[-2] not in (1, T):
        raise ValueError(f"target: expected a state or T={T} of them, got {tuple(target.shape)}")
    r = torch.cat([target.new_zeros(*target.shape[:-1], m), target], dim=-1).movedim(-2, 0)
    return r.expand(T, *r.shape[1:])


def _bound(name: str, value: Tensor | float | None, like: Tensor, m: int) -> Tensor | None:
    """Returns a bound as a tensor; it may be infinite, and a number holds for every input."""
    if value is None:
        return None
    try:
        value = value if isinstance(value, Tensor) else like.new_tensor(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: expected numbers, got {value!r}") from None
    alike(name, value, like, infinite=True)
    return value.expand(m) if value.ndim == 0 else value


def _padded(z: Any, core: int, dims: int) -> Any:
    """Returns ``(T, lead, core)`` with as many leading dimensions as the batch has."""
    if z is None or z.ndim == dims + core + 1:
        return z
    return z.reshape(len(z), *[1] * (dims + core + 1 - z.ndim), *z.shape[1:])
