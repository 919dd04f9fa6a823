"""Linear systems: the same at every step (LTI), or another one at each (LTV)."""

from collections.abc import Callable
from typing import Self

import torch
from torch import Tensor

from ..linalg import bmv
from ..shapes import check, register
from .system import System


class LTI(System):
    """A linear system: ``x' = A x + B u + c1``, ``y = C x + D u + c2`` at every step.

    Args:
        A: ``(..., n, n)``.
        B: ``(..., n, m)``.
        C: ``(..., p, n)``.
        D: ``(..., p, m)``.
        c1: ``(..., n)`` or None.
        c2: ``(..., p)`` or None.

    Raises:
        ValueError: for matrices that do not fit together.
    """

    vectorized = True

    def __init__(self, A, B, C, D, c1=None, c2=None):
        super().__init__()
        self._check_matrices(A, B, C, D, c1, c2)
        for name, value in zip(("_A", "_B", "_C", "_D", "_c1", "_c2"), (A, B, C, D, c1, c2)):
            register(self, name, value)

    @staticmethod
    def _check_matrices(*matrices: Tensor | None) -> None:
        check("A: n n, B: n m, C: p n, D: p m, c1: n, c2: p", *matrices)

    A = property(lambda self: self._A, doc="State matrix, (..., n, n).")
    B = property(lambda self: self._B, doc="Input matrix, (..., n, m).")
    C = property(lambda self: self._C, doc="Output matrix, (..., p, n).")
    D = property(lambda self: self._D, doc="Feedthrough matrix, (..., p, m).")
    c1 = property(lambda self: self._c1, doc="Constant of the transition, (..., n), or None.")
    c2 = property(lambda self: self._c2, doc="Constant of the observation, (..., p), or None.")

    def check_point(self, name, state, input=None):
        """Returns the sizes n and m, or says what does not fit A and B; see `System`."""
        return check(f"A: n n, B: n m, {name}: n, input: m", self.A, self.B, state, input)

    def set_refpoint(self, state=None, input=None, t=None) -> Self:
        """Returns the system: a linear one is the same at every point."""
        return self

    def state_transition(self, state, input, t=None):
        """Returns ``A x + B u + c1``."""
        return _affine(self.A, state, self.B, input, self.c1)

    def observation(self, state, input, t=None):
        """Returns ``C x + D u + c2``."""
        return _affine(self.C, state, self.D, input, self.c2)

    def expand_transition(self, x, u, t=None):
        """Returns f, A, B and a function that answers zeros: a linear system has no curvature."""
        size = x.shape[-1] + u.shape[-1]

        def curve(costate):
            return torch.zeros_like(costate[..., :1, None]).expand(*costate.shape[:-1], size, size)

        return (*self.linearize_transition(x, u, t), curve)

    def linearize_transition(self, x, u, t=None, wrt="xu"):
        """Returns ``f``, ``A`` and ``B``, expanded to the batch."""
        return self._with_matrices(self.state_transition, lambda: (self.A, self.B), x, u, t, wrt)

    def linearize_observation(self, x, u, t=None, wrt="xu"):
        """Returns ``g``, ``C`` and ``D``, expanded to the batch."""
        return self._with_matrices(self.observation, lambda: (self.C, self.D), x, u, t, wrt)

    def _with_matrices(self, function, matrices, x, u, t, wrt) -> tuple[Tensor, ...]:
        def now(x, u, t):
            return function(x, u), matrices()

        y, pair = self._at(now, x, u, self._time(t))
        wanted = [m for letter, m in zip("xu", pair) if letter in wrt]
        return (y, *(m.expand(*y.shape[:-1], *m.shape[-2:]) for m in wanted))


class LTV(LTI):
    """A linear system with other matrices at each step: ``x' = A_t x + B_t u + c1_t``, and so on.

    Its matrices are ``(..., T, rows, columns)``, ``c1`` and ``c2`` ``(..., T, rows)``, one for each
    step; after T steps they begin anew. A subclass may compute them instead, as properties ``A``
    to ``c2`` that read ``self.systime``; what the constructor is given is then kept as it is, in
    ``self._A`` to ``self._c2``, for them to use.
    """

    def __init__(self, A=None, B=None, C=None, D=None, c1=None, c2=None):
        super().__init__(A, B, C, D, c1, c2)

    @staticmethod
    def _check_matrices(*matrices: Tensor | None) -> None:
        pass  # their layout is the subclass's

    def _now(self, stack: Tensor | None, dims: int) -> Tensor | None:
        if stack is None:
            return None
        step = (self._t.long() % stack.shape[-dims]).reshape(1)
        return stack.index_select(-dims, step).squeeze(-dims)

    A = property(lambda self: self._now(self._A, 3), doc="State matrix now, (..., n, n).")
    B = property(lambda self: self._now(self._B, 3), doc="Input matrix now, (..., n, m).")
    C = property(lambda self: self._now(self._C, 3), doc="Output matrix now, (..., p, n).")
    D = property(lambda self: self._now(self._D, 3), doc="Feedthrough matrix now, (..., p, m).")
    c1 = property(lambda self: self._now(self._c1, 2), doc="Constant of the transition now.")
    c2 = property(lambda self: self._now(self._c2, 2), doc="Constant of the observation now.")

    def set_refpoint(self, state=None, input=None, t=None) -> Self:
        """Sets the clock to ``t``, where it is given, and returns the system."""
        return self if t is None else self.reset(t)

    def mapped(self, name, t=None) -> Callable:
        """Returns ``(x, u) -> f(x, u, t)`` for any batch; see :meth:`System.mapped`."""
        t, at_once = self._time(t), super().mapped
        if t.numel() == 1:
            return at_once(name, t.reshape(()))

        def each(x, u, t):
            return (self.mapped(name, t)(x, u),)

        return lambda x, u: _row_by_row(each, x, u, t)[0]

    def _with_matrices(self, function, matrices, x, u, t, wrt):
        t, at_once = self._time(t), super()._with_matrices
        if t.numel() == 1:
            return at_once(function, matrices, x, u, t.reshape(()), wrt)

        def each(x, u, t):
            return self._with_matrices(function, matrices, x, u, t, wrt)

        return _row_by_row(each, x, u, t)


def _row_by_row(function: Callable, x: Tensor, u: Tensor, t: Tensor) -> tuple[Tensor, ...]:
    """Returns the results of ``function(x, u, t)`` for each row of t, stacked.

    Matrices that change with time are those of one time only.
    """
    lead = torch.broadcast_shapes(x.shape[:-1], u.shape[:-1], t.shape)
    t = t.reshape(*[1] * (len(lead) - t.ndim), *t.shape)
    rows = zip(x.expand(*lead, -1), u.expand(*lead, -1), t.expand(lead[0], *t.shape[1:]))
    return tuple(torch.stack(part) for part in zip(*(function(*row) for row in rows)))


def _affine(M: Tensor, x: Tensor, N: Tensor, u: Tensor, c: Tensor | None) -> Tensor:
    y = bmv(M, x) + bmv(N, u)
    return y if c is None else y + c
