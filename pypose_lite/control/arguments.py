"""What users pass to LQR and MPC, checked and brought into one form.

Sequences come as ``(..., T, n)``, weights with or without time and batch, bounds as numbers or
tensors. `OptimalControl` turns them into a :class:`Problem`, time first and one batch dimension
for each of the plan's, or says what does not fit.
"""

import math
from numbers import Integral
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from ..linalg import symmetric
from ..shapes import alike, check, has_numbers, join, over_time, register
from ..systems import System
from .problem import Problem


class Stated(NamedTuple):
    """A problem as it was stated, with what a plan begins with."""

    problem: Problem
    x_init: Tensor  # (..., n)
    U: Tensor  # inputs to start from, (T, ..., m)
    graph: bool  # whether x_init, the weights, the bounds or the system want a gradient


class OptimalControl(nn.Module):
    """A system and a quadratic cost over T steps: what LQR and MPC have in common.

    Args:
        system: any :class:`System`; its clock says when a plan starts.
        Q: weights of ``z = [x, u]``: ``(n+m, n+m)``, one for each step ``(T, n+m, n+m)``, or
            with leading batch dimensions. Its symmetric part counts; that of u must be > 0.
        p: linear weights, likewise ``(n+m,)`` to ``(..., T, n+m)``, or None.
        T: how many steps to plan.
        Qf: weights of the state after the last step, ``(n, n)`` or ``(..., n, n)``; None, as in
            PyPose, lets it cost nothing.
        pf: its linear weights, ``(n,)`` or ``(..., n)``, or None.
    """

    system: System
    Q: Tensor
    p: Tensor | None
    Qf: Tensor | None
    pf: Tensor | None
    T: int
    inputs = "u_init"  # what the call's inputs to start from are called

    def __init__(self, system: System, Q: Tensor, p: Tensor | None, T: int, Qf=None, pf=None):
        super().__init__()
        if isinstance(T, bool) or not isinstance(T, Integral) or T < 1:
            raise ValueError(f"T: expected a number of steps, at least one, got {T!r}")
        if not isinstance(Q, Tensor):
            raise ValueError(f"Q: expected a floating-point tensor, got {type(Q).__name__}")
        check("p: k", p, **check("Q: k k", Q))  # apart: one may have steps, the other a batch
        check("Qf: n n, pf: n", Qf, pf)
        self.system, self.T = system, int(T)
        for name, value in (("Q", Q), ("p", p), ("Qf", Qf), ("pf", pf)):
            register(self, name, value)

    def _state(
        self, x_init, dt, u_init, u_lower, u_upper, du, target=None, u_target=None
    ) -> Stated:
        """Returns the problem that a call states."""
        n, m = self._sizes(x_init)
        for name in ("Q", "p", "Qf", "pf"):
            alike(name, getattr(self, name), x_init)
        for name, value in (("target", target), ("u_target", u_target), (self.inputs, u_init)):
            alike(name, value, x_init)
        check_dt(self.system, dt)
        x_init = x_init.clone()  # of x[i], where a loop writes x[i+1] beside it
        zero = x_init.new_zeros(n + m)
        moved = self.system.transition(x_init, zero[n:])
        r, rf = _references(target, u_target, x_init, m, self.T)
        given = {  # name: value, what one of it has as its shape
            "Q": (symmetric(self.Q), (n + m, n + m)),
            "p": (zero if self.p is None else self.p, (n + m,)),
            "target": (r, (n + m,)),
            "Qf": (x_init.new_zeros(n, n) if self.Qf is None else symmetric(self.Qf), (n, n)),
            "pf": (zero[:n] if self.pf is None else self.pf, (n,)),
            "rf": (rf, (n,)),
            "u_lower": (_bound("u_lower", u_lower, x_init, m), (m,)),
            "u_upper": (_bound("u_upper", u_upper, x_init, m), (m,)),
            "du": (_bound("du", du, x_init, m), (m,)),
            self.inputs: (zero[n:] if u_init is None else u_init, (m,)),
        }
        *parts, U, batch = _in_time_and_batch(given, self.T, tuple(moved.shape[:-1]))
        now = self.system.systime
        problem = Problem(self.system, now + torch.arange(self.T, device=now.device), *parts)
        _check_problem(problem)
        graph = any(z is not None and z.requires_grad for z in (moved, *parts))
        return Stated(problem, x_init.expand(*batch, n), U.expand(self.T, *batch, m), graph)

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
        check("Qf: n n, pf: n", self.Qf, self.pf, n=n)
        return n, m


def check_dt(system: System, dt) -> None:
    """Raises ValueError where dt is not the time step that the system itself states."""
    if dt is None:
        return
    if getattr(dt, "shape", None) and math.prod(dt.shape) != 1:
        raise ValueError(f"dt: expected one time step for all, got shape {tuple(dt.shape)}")
    seconds = dt.item() if hasattr(dt, "item") else dt
    if not isinstance(seconds, int | float) or not 0 < seconds < math.inf:
        raise ValueError(f"dt: expected a positive time step, got {dt!r}")
    own = getattr(system, "dt", None)
    if isinstance(own, float | int) and not math.isclose(own, seconds, rel_tol=1e-6):
        raise ValueError(f"dt: the system steps by {own}, got {seconds:.6g}")


def _references(target, u_target, x_init: Tensor, m: int, T: int) -> tuple[Tensor, Tensor]:
    """Returns where z should be, ``(..., T or 1, n+m)``, and where the last state, ``(..., n)``.

    A target is one state, T of them, or T + 1, of which the last is for the state after the last
    step.
    """
    check("target: n", target, n=x_init.shape[-1])
    check("u_target: m", u_target, m=m)
    target = torch.zeros_like(x_init) if target is None else target
    u_target = x_init.new_zeros(m) if u_target is None else u_target
    target = target.unsqueeze(-2) if target.ndim <= x_init.ndim else target
    u_target = u_target.unsqueeze(-2) if u_target.ndim <= x_init.ndim else u_target
    if target.shape[-2] not in (1, T, T + 1):
        raise ValueError(f"target: expected a state or T={T} of them, got {tuple(target.shape)}")
    if u_target.shape[-2] not in (1, T):
        raise ValueError(
            f"u_target: expected an input or T={T} of them, got {tuple(u_target.shape)}"
        )
    last, target = target[..., -1, :], target[..., :T, :]
    lead = torch.broadcast_shapes(target.shape[:-1], u_target.shape[:-1])
    return torch.cat([target.expand(*lead, -1), u_target.expand(*lead, -1)], -1), last


def _bound(name: str, value: Tensor | float | None, like: Tensor, m: int) -> Tensor | None:
    """Returns a bound as a tensor; it may be infinite, and a number holds for every input."""
    if value is None:
        return None
    try:
        if not isinstance(value, Tensor):
            value = torch.as_tensor(value, dtype=like.dtype, device=like.device)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: expected numbers, got {value!r}") from None
    alike(name, value, like, infinite=True)
    return value.expand(m) if value.ndim == 0 else value


def _in_time_and_batch(given: dict, T: int, batch: tuple) -> list:
    """Returns each value as ``(T, ..., core)`` with a dimension for each of the batch; then that.

    Args:
        given: for each name a value, or None, and what one of it has as its shape.
        T: how many steps.
        batch: that of the system's next state.
    """
    timed: dict[str, tuple[Any, int]] = {}
    for name, (value, core) in given.items():
        if value is not None and name in ("Qf", "pf", "rf"):
            value = value.unsqueeze(0)
        elif value is not None and name == "target":
            value = value.movedim(-2, 0).expand(T, *value.shape[:-2], *core)
        elif value is not None:
            value = over_time(name, value, core, T, batch)
        timed[name] = value, len(core)
    for name, (value, core) in timed.items():
        lead = () if value is None else tuple(value.shape[1 : value.ndim - core])
        batch = join("target" if name == "rf" else name, lead, batch)
    return [*(_padded(value, core, len(batch)) for value, core in timed.values()), batch]


def _padded(z: Tensor | None, core: int, dims: int) -> Tensor | None:
    """Returns ``(T, lead, core)`` with as many leading dimensions as the batch has."""
    if z is None or z.ndim == dims + core + 1:
        return z
    return z.reshape(len(z), *[1] * (dims + core + 1 - z.ndim), *z.shape[1:])


def _check_problem(problem: Problem) -> None:
    """Raises ValueError where the inputs have nothing to minimise, or no room to do it in."""
    if not has_numbers(problem.Q):
        return
    n = problem.rf.shape[-1]
    if torch.linalg.cholesky_ex(problem.Q[..., n:, n:].detach()).info.any():
        raise ValueError("Q: its block of u must be positive definite at every step")
    lower, upper = problem.lower, problem.upper
    if lower is not None and upper is not None and (lower > upper).any():
        raise ValueError("u_lower: expected no more than u_upper")
    if problem.du is not None and not (problem.du > 0).all():
        raise ValueError("du: expected a positive change")
