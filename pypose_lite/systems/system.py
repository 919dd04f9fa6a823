"""Dynamical systems: how a state moves, what is observed of it, and both made linear.

    x[i+1] = f(x[i], u[i], t[i])        y[i] = g(x[i], u[i], t[i])

A user writes f as ``state_transition`` and g as ``observation``, for one sample or for any batch,
with the time step ``t`` as an argument or without. Calling the system takes one step and ticks
its clock; nothing else does. Chapter 1 builds this file from scratch.
"""

import inspect
from collections.abc import Callable
from typing import Any, NamedTuple, Self

import torch
from torch import Tensor, nn

from ..linalg import bmv
from ..shapes import check
from .derivatives import hessian, jacobians


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

    A function may be written for one sample, ``state (n,)`` and ``input (m,)``: batches are then
    mapped over it. A subclass whose functions handle leading dimensions themselves may say
    ``vectorized = True``, which is faster and lets its parameters have a batch of their own; its
    ``t`` then comes as ``(..., 1)``, like a state. One that says ``sizes = {"n": 4, "m": 2}`` has
    other shapes refused by name.

    Source: "PyPose v0.6", section III-A, equations (1).
    """

    vectorized = False
    sizes: dict[str, int] = {}
    _arguments: dict[str, int] = {}
    _t: Tensor

    def __init_subclass__(cls, **kwargs):
        """Notes which of the user's functions take the time: 3 arguments, or 2."""
        super().__init_subclass__(**kwargs)
        functions = (cls.state_transition, cls.observation)
        cls._arguments = {f.__name__: len(inspect.signature(f).parameters) - 1 for f in functions}

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
        state, input = _vector("state", state), _vector("input", input)
        self.check_point("state", state, input)
        state = state.clone()  # x[i+1], y[i] = system(x[i], u[i]) writes beside it
        self._last = (state.detach(), input.detach())
        return self.transition(state, input), self.observe(state, input)

    def check_point(self, name: str, state: Tensor, input: Tensor | None = None) -> dict[str, int]:
        """Returns the sizes of a state called ``name`` and an input, or says what does not fit."""
        return check(f"{name}: n, input: m", state, input, **self.sizes)

    def transition(self, x: Tensor, u: Tensor, t: Tensor | int | None = None) -> Tensor:
        """Returns f(x, u, t) for any batch; the clock stays. ``t=None`` is the current time."""
        y = self._batched(self.state_transition, t)(x, u)
        if y.shape[-1] != x.shape[-1]:
            raise ValueError(
                f"state_transition: expected a state (..., n={x.shape[-1]}), got {tuple(y.shape)}"
            )
        return y

    def observe(self, x: Tensor, u: Tensor, t: Tensor | int | None = None) -> Tensor:
        """Returns g(x, u, t) for any batch; the clock stays. ``t=None`` is the current time."""
        return self._batched(self.observation, t)(x, u)

    def linearize(self, x: Tensor, u: Tensor, t: Tensor | int | None = None) -> Linearization:
        """Returns ``A B C D c1 c2`` at ``x (..., n)``, ``u (..., m)``; differentiable.

        Args:
            x: states ``(..., n)``.
            u: inputs ``(..., m)``.
            t: one time step, or one for each member of the batch: a tensor that broadcasts with
                the leading dimensions. None is the current time.
        """
        f, A, B = self.linearize_transition(x, u, t)
        g, C, D = self.linearize_observation(x, u, t)
        return Linearization(A, B, C, D, f - bmv(A, x) - bmv(B, u), g - bmv(C, x) - bmv(D, u))

    def linearize_transition(self, x, u, t=None, wrt: str = "xu") -> tuple[Tensor, ...]:
        """Returns ``f(x, u, t)`` and its Jacobians ``A (..., n, n)``, ``B (..., n, m)``.

        ``wrt="x"`` leaves out B, for those who do not need it.
        """
        return jacobians(self._batched(self.state_transition, t), *expand(x, u), wrt)

    def linearize_observation(self, x, u, t=None, wrt: str = "xu") -> tuple[Tensor, ...]:
        """Returns ``g(x, u, t)`` and its Jacobians ``C (..., p, n)``, ``D (..., p, m)``."""
        return jacobians(self._batched(self.observation, t), *expand(x, u), wrt)

    def expand_transition(self, x, u, t=None) -> tuple[Tensor, Tensor, Tensor, Callable]:
        """Returns f, A and B, without a graph, and f's second derivative: Taylor's expansion.

        That is a function of costates ``(..., n)``: it returns the second derivative of
        ``costate' f(x, u, t)`` in ``[x, u]``, ``(..., n+m, n+m)``, which makes a Newton step of a
        Gauss-Newton step.
        """
        f = self._batched(self.state_transition, t)
        x, u = expand(x, u)
        with torch.no_grad():
            y, A, B = jacobians(f, x, u)
        x, u = (z.expand(*y.shape[:-1], -1) for z in (x, u))
        return y, A, B, lambda costate: hessian(f, x, u, costate)

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

    def _tick(self, args, result) -> None:
        self._t = self._t + 1

    def _at(self, t: Tensor, function: Callable, *args) -> Any:
        """Calls ``function`` while the clock shows ``t``, and puts the clock back."""
        if torch.compiler.is_compiling():  # which allows no side effect; MPC.compile checks
            return function(*args)
        now, self._buffers["_t"] = self._buffers["_t"], t
        try:
            return function(*args)
        finally:
            self._buffers["_t"] = now

    def _batched(self, function: Callable, t: Tensor | int | None) -> Callable:
        """Returns ``(x, u) -> function(x, u, t)`` for any batch, however function is written.

        vmap maps a function of one sample over the batch. What vmap cannot map (a branch on a
        state, ``torch.tensor([[t]])``) is looped over, so that the user's own errors arrive.
        """
        t = self._t if t is None else torch.as_tensor(t)
        args = self._arguments[function.__name__]

        def one(x, u, t):
            return self._at(t, function, *(x, u, t)[:args]).reshape(-1)  # (1, n) becomes (n,)

        def many(x, u):
            x, u = expand(x, u)
            if self.vectorized:
                y = self._at(t, function, *(x, u, t.unsqueeze(-1))[:args])
                if t.ndim and y.shape[:-1] != x.shape[:-1]:
                    want = f"expected a batch {tuple(x.shape[:-1])}, got {tuple(y.shape[:-1])}"
                    raise ValueError(f"{function.__name__}: {want}; t comes as (..., 1)")
                return y
            if x.ndim == 1:
                return one(x, u, t)
            rows = [z.reshape(-1, z.shape[-1]) for z in (x, u)]
            steps = t.expand(x.shape[:-1]).reshape(-1) if t.ndim else t
            dims = (0, 0, 0 if t.ndim else None)
            mapped: Callable[..., Tensor] = torch.vmap(one, dims, randomness="different")
            try:
                y = mapped(*rows, steps)
            except RuntimeError:
                y = torch.stack([one(*row) for row in zip(*rows, steps.expand(len(rows[0])))])
            return y.reshape(*x.shape[:-1], -1)

        return many

    def __getattr__(self, name: str):
        """Lets an AttributeError from inside a property arrive as it is."""
        if isinstance(getattr(type(self), name, None), property):
            return getattr(type(self), name).fget(self)
        return super().__getattr__(name)


class NLS(System):
    """A nonlinear system; ``A B C D c1 c2`` are those at the reference point.

    Source: "PyPose v0.6", section III-A.
    """

    def __init__(self):
        super().__init__()
        self._reference: tuple[Tensor, ...] = ()

    def set_refpoint(self, state=None, input=None, t=None) -> Self:
        """Sets where ``A B C D c1 c2`` are taken; what is None is that of the latest step."""
        if (state is None or input is None) and not self._last:
            raise RuntimeError("set_refpoint: no step was taken yet, so give state and input")
        state = self._last[0] if state is None else _vector("state", state)
        input = self._last[1] if input is None else _vector("input", input)
        self.check_point("state", state, input)
        self._reference = (state, input, self._t if t is None else torch.as_tensor(t))
        return self

    def __getstate__(self) -> dict:
        """A copy keeps the values of the reference point, not the graph that led to them."""
        reference = tuple(part.detach() for part in self._reference)
        return self.__dict__ | {"_reference": reference}

    @property
    def _linear(self) -> Linearization:
        if not self._reference:
            raise RuntimeError("A B C D c1 c2: call set_refpoint(state, input, t) first")
        return self.linearize(*self._reference)

    A = property(lambda self: self._linear.A, doc="df/dx at the reference point, (..., n, n).")
    B = property(lambda self: self._linear.B, doc="df/du at the reference point, (..., n, m).")
    C = property(lambda self: self._linear.C, doc="dg/dx at the reference point, (..., p, n).")
    D = property(lambda self: self._linear.D, doc="dg/du at the reference point, (..., p, m).")
    c1 = property(lambda self: self._linear.c1, doc="f(x, u) - A x - B u there, (..., n).")
    c2 = property(lambda self: self._linear.c2, doc="g(x, u) - C x - D u there, (..., p).")


def _vector(name: str, x: Tensor) -> Tensor:
    """Returns x with at least one dimension; a number is a vector of one."""
    if not isinstance(x, Tensor):
        raise ValueError(f"{name}: expected a floating-point tensor, got {type(x).__name__}")
    return torch.atleast_1d(x)


def expand(x: Tensor, u: Tensor) -> tuple[Tensor, Tensor]:
    """Gives states and inputs the same leading dimensions."""
    if x.shape[:-1] == u.shape[:-1]:
        return x, u
    if u.ndim == 1:  # the quick way for one input, as broadcast_shapes is slow
        return x, u.expand(*x.shape[:-1], -1)
    batch = torch.broadcast_shapes(x.shape[:-1], u.shape[:-1])
    return x.expand(*batch, -1), u.expand(*batch, -1)
