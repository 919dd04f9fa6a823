"""Nonlinear systems, made linear at a reference point."""

from typing import Self

import torch
from torch import Tensor

from .system import Linearization, System, vector


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
        state = self._last[0] if state is None else vector("state", state)
        input = self._last[1] if input is None else vector("input", input)
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
