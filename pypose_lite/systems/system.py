"""Dynamical systems: how a state moves, what is observed of it, and both made linear.

    x[i+1] = f(x[i], u[i], t[i])        y[i] = g(x[i], u[i], t[i])

A user writes f as ``state_transition`` and g as ``observation``, for one sample or for any batch,
with the time step ``t`` as an argument or without. Calling the system takes one step and ticks
its clock; nothing else does. How functions of one sample are mapped over batches is in
`mapping.py`, how they are differentiated in `derivatives.py`. Chapter 1 builds this file.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, Self

import torch
from torch import Tensor, nn

from ..linalg import bmv
from ..shapes import check, inside_transform
from .derivatives import hessian, jacobians
from .functions import written
from .kinks import Place, refuse_curved_kinks, refuse_kinks
from .mapping import over_batch, same_batch
from .slow import warn_once

Time = Tensor | int | None


class Linearization(NamedTuple):
    """A system made linear at a point: ``x' = A x + B u + c1`` and ``y = C x + D u + c2``."""

    A: Tensor
    B: Tensor
    C: Tensor
    D: Tensor
    c1: Tensor
    c2: Tensor


class System(nn.Module):
    """A discrete-time dynamical system; subclasses write its two functions.

    A function may be a method, or any callable that is assigned to its name. It is given the time
    step where it asks for it: by an argument called ``t`` or ``time``, or by a third one without a
    default. It may be written for one sample, ``state (n,)`` and ``input (m,)``: it is then mapped
    over batches, and a warning says where that takes a loop.

    A subclass whose functions handle leading dimensions themselves may say ``vectorized = True``,
    which is faster and lets its parameters have a batch of their own; its ``t`` then comes as
    ``(..., 1)``, like a state. One that says ``sizes = {"n": 4, "m": 2}`` has other shapes refused
    by name.

    Source: "PyPose v0.6", section III-A, equations (1).
    """

    vectorized = False
    sizes: dict[str, int] = {}
    _t: Tensor

    def __init__(self):
        super().__init__()
        self.register_buffer("_t", torch.zeros((), dtype=torch.int64))
        self.register_forward_hook(System._tick)
        self._last: tuple[Tensor, ...] = ()

    def state_transition(self, state: Tensor, input: Tensor, t: Tensor | None = None) -> Tensor:
        """Returns the next state f(x, u, t), without noise; a subclass writes it."""
        raise NotImplementedError(f"{type(self).__name__} has to define state_transition")

    def observation(self, state: Tensor, input: Tensor, t: Tensor | None = None) -> Tensor:
        """Returns the observation g(x, u, t), without noise; a subclass writes it."""
        raise NotImplementedError(f"{type(self).__name__} has to define observation")

    def forward(self, state: Tensor, input: Tensor) -> tuple[Tensor, Tensor]:
        """Returns the next state ``(..., n)`` and this step's observation ``(..., p)``.

        The observation belongs to the state before the step. The clock ticks afterwards.

        Args:
            state: ``(..., n)``.
            input: ``(..., m)``.

        Raises:
            ValueError: for shapes, dtypes or numbers that do not fit.
        """
        state, input = vector("state", state), vector("input", input)
        self.check_point("state", state, input)
        if not inside_transform(state):
            self._last = (state.detach().clone(), input.detach().clone())
        return self.transition(state, input), self.observe(state, input)

    def _tick(self, args, result) -> None:
        self._t = self._t + 1

    @property
    def systime(self) -> Tensor:
        """The current time: how many steps were taken since the start, a 0-dim int64 tensor."""
        return self._t

    @systime.setter
    def systime(self, t: Tensor | int) -> None:
        self.reset(t)

    def reset(self, t: Tensor | int = 0) -> Self:
        """Sets the clock to step ``t``, a whole number, and returns the system."""
        value = float(t)
        if not value.is_integer():
            raise ValueError(f"t: expected a whole number of steps, got {value}")
        self._t = torch.full_like(self._t, round(value))
        return self

    def transition(self, x: Tensor, u: Tensor, t: Time = None) -> Tensor:
        """Returns f(x, u, t) for any batch; the clock stays. ``t=None`` is the current time."""
        y = self.mapped("state_transition", t)(x, u)
        if y.shape[-1] != x.shape[-1]:
            raise ValueError(
                f"state_transition: expected a state (..., n={x.shape[-1]}), got {tuple(y.shape)}"
            )
        return y

    def observe(self, x: Tensor, u: Tensor, t: Time = None) -> Tensor:
        """Returns g(x, u, t) for any batch; the clock stays. ``t=None`` is the current time."""
        return self.mapped("observation", t)(x, u)

    def linearize(self, x: Tensor, u: Tensor, t: Time = None) -> Linearization:
        """Returns ``A B C D c1 c2`` at ``x (..., n)``, ``u (..., m)``; differentiable.

        Args:
            x: states ``(..., n)``.
            u: inputs ``(..., m)``.
            t: one time step, or one for each member of the batch: a tensor that broadcasts with
                the leading dimensions. None is the current time.

        Raises:
            ValueError: where a derivative is not finite though f or g is, as at a kink.
        """
        f, A, B = self.linearize_transition(x, u, t)
        g, C, D = self.linearize_observation(x, u, t)
        return Linearization(A, B, C, D, f - bmv(A, x) - bmv(B, u), g - bmv(C, x) - bmv(D, u))

    def linearize_transition(self, x, u, t=None, wrt: str = "xu") -> tuple[Tensor, ...]:
        """Returns ``f(x, u, t)`` and its Jacobians ``A (..., n, n)``, ``B (..., n, m)``.

        ``wrt="x"`` leaves out B, for those who do not need it. Errors are those of `linearize`.
        """
        return self._tangent("state_transition", x, u, t, wrt)

    def linearize_observation(self, x, u, t=None, wrt: str = "xu") -> tuple[Tensor, ...]:
        """Returns ``g(x, u, t)`` and its Jacobians ``C (..., p, n)``, ``D (..., p, m)``."""
        return self._tangent("observation", x, u, t, wrt)

    def _tangent(self, name: str, x: Tensor, u: Tensor, t: Time, wrt: str) -> tuple[Tensor, ...]:
        f, place = self.mapped(name, t), Place(self, name, self._time(t))
        x, u = same_batch(x, u)
        y, *slopes = jacobians(f, x, u, wrt)
        refuse_kinks(place, f, x, u, y, torch.cat(slopes, -1))
        return y, *slopes

    def expand_transition(self, x, u, t=None) -> tuple[Tensor, Tensor, Tensor, Callable]:
        """Returns ``f(x, u, t)``, A and B, and a function for f's second derivative; no graph.

        The function takes costates ``(..., n)`` and returns the second derivative of
        ``costate' f(x, u, t)`` with respect to ``[x, u]``, ``(..., n+m, n+m)``: what Newton's
        model of a cost has beyond Gauss-Newton's.

        Raises:
            ValueError: where a first or a second derivative is not finite though f is.
        """
        name, t = "state_transition", self._time(t)
        with torch.no_grad():
            y, A, B = self.linearize_transition(x, u, t)
        x, u = (z.expand(*y.shape[:-1], -1) for z in (x, u))

        def curve(costate: Tensor) -> Tensor:
            H = hessian(self.mapped(name, t), x, u, costate)
            refuse_curved_kinks(Place(self, name, t), x, y, H)
            return H

        return y, A, B, curve

    def check_point(self, name: str, state: Tensor, input: Tensor | None = None) -> dict[str, int]:
        """Returns the sizes n and m of a state and an input, or says what does not fit.

        Args:
            name: what an error calls the state, such as ``x_init``.
            state: ``(..., n)``.
            input: ``(..., m)``; None leaves out m.
        """
        return check(f"{name}: n, input: m", state, input, **self.sizes)

    def mapped(self, name: str, t: Time = None) -> Callable:
        """Returns ``(x, u) -> f(x, u, t)`` for any batch, however the user has written f.

        Args:
            name: that of f, ``state_transition`` or ``observation``.
            t: one time step, or one for each member; None is the current time. The clock shows it
                to functions that look at it while they run.
        """
        t = self._time(t)
        f = partial(self._at, written(self, name))

        def any_batch(x: Tensor, u: Tensor) -> Tensor:
            x, u = same_batch(x, u)
            x, u, now = x.clone(), u.clone(), t.clone()  # f may write into what it is given
            if not self.vectorized:
                return over_batch(f, x, u, now, partial(warn_once, self, name))
            y = f(x, u, now)
            if t.ndim and y.shape[:-1] != x.shape[:-1]:
                want = f"expected a batch {tuple(x.shape[:-1])}, got {tuple(y.shape[:-1])}"
                raise ValueError(f"{name}: {want}; t comes as (..., 1)")
            return y

        return any_batch

    def _time(self, t: Time) -> Tensor:
        return self._t if t is None else torch.as_tensor(t)

    def _at(self, function: Callable, x: Any, u: Any, t: Tensor) -> Any:
        """Returns ``function(x, u, t)``, with t on the clock meanwhile."""
        now, self._buffers["_t"] = self._buffers["_t"], t
        try:
            return function(x, u, t)
        finally:
            self._buffers["_t"] = now

    def __getattr__(self, name: str):
        """Lets an AttributeError from inside a property arrive as it is."""
        if isinstance(getattr(type(self), name, None), property):
            return getattr(type(self), name).fget(self)
        return super().__getattr__(name)


def vector(name: str, x: Tensor) -> Tensor:
    """Returns x with at least one dimension; a number is a vector of one.

    Raises:
        ValueError: where x is no tensor; it is called by its name.
    """
    if not isinstance(x, Tensor):
        raise ValueError(f"{name}: expected a floating-point tensor, got {type(x).__name__}")
    return torch.atleast_1d(x)
