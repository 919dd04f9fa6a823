"""The two functions of a model, f and g, as a filter looks at them at one step.

A filter knows a model through ``f(x)`` (the next state) and ``g(x)`` (the observation) with the
step's input and time filled in. The EKF asks for a value and a tangent, the UKF for the spread of
sigma points, the PF for the image of each particle. How two values differ, and what their mean is,
goes with the function, as some entries may be angles. Rows that were not measured, a sensor with
a g of its own, and process noise that is correlated with the observation's are functions, too:
they replace f or g, so that the filters' equations need not know of them.
"""

import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn

from ..linalg import bmv
from ..shapes import check, has_numbers
from ..systems import System
from ..systems.functions import TIME
from .differences import Difference
from .gaussian import factor


@dataclass(frozen=True)
class Function:
    """A function of the state alone: ``f(x) (..., n)`` or ``g(x) (..., p)``."""

    name: str  # whose it is in error messages
    value: Callable[[Tensor], Tensor]
    slope: Callable[[Tensor], tuple[Tensor, Tensor]]
    difference: Difference
    average: Callable[[Tensor, Tensor], Tensor]

    def tangent(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Returns the value at x and the Jacobian there, ``(..., p)`` and ``(..., p, n)``."""
        z, slope = self.slope(x)
        finite(self.name, z)
        return z, slope

    def each(self, points: Tensor) -> Tensor:
        """Returns the images of points, ``(..., k, n) -> (..., k, p)``.

        The points come first, and leave the second dimension to a model whose parameters have a
        batch: it is not mistaken for theirs, even where both have one size.
        """
        return self.value(points.movedim(-2, 0).unsqueeze(1)).squeeze(1).movedim(0, -2)

    def spread(self, points: Tensor, w: Tensor) -> tuple[Tensor, Tensor]:
        """Returns the mean of the images of points, and how each differs from it.

        Args:
            points: ``(..., k, n)``.
            w: weights of sum 1, ``(k,)`` or ``(..., k)``.

        Returns:
            ``(..., p)``, and as columns ``(..., p, k)``.
        """
        images = self.each(points)
        finite(self.name, images)
        mean = self.average(images, w)
        return mean, self.difference(images, mean.unsqueeze(-2)).mT

    def only(self, known: Tensor) -> "Function":
        """Returns the function with 0 in the rows that are not ``known (..., p)``."""

        def value(x):
            z = self.value(x)
            return torch.where(known, z, torch.zeros_like(z))

        def slope(x):
            z, C = self.slope(x)
            row = known.unsqueeze(-1)
            return (torch.where(k, a, torch.zeros_like(a)) for k, a in ((known, z), (row, C)))

        return replace(self, value=value, slope=slope)


def transition(model: System, u: Tensor, t, n: int, difference, average) -> Function:
    """Returns the model's f with input and time filled in, a state ``(..., n)``."""

    def sized(z: Tensor) -> Tensor:
        if z.shape[-1] != n:
            got = tuple(z.shape)
            raise ValueError(f"state_transition: expected a state (..., n={n}), got {got}")
        return z

    def slope(x):
        z, A = model.linearize_transition(x, u, t, wrt="x")
        return sized(z), A

    def value(x):
        return sized(model.transition(x, u, t))

    return Function("state_transition", value, slope, difference, average)


def observation(model: System, u: Tensor, t, p: int, difference, average) -> Function:
    """Returns the model's g with input and time filled in, an observation ``(..., p)``."""

    def sized(z: Tensor) -> Tensor:
        size = z.shape[-1]
        if size != p:
            raise ValueError(f"R: expected (..., p={size}, p={size}), got ({p}, {p}); p is g's")
        return z

    def slope(x):
        z, C = model.linearize_observation(x, u, t, wrt="x")
        return sized(z), C

    def value(x):
        return sized(model.observe(x, u, t))

    return Function("observation", value, slope, difference, average)


class Sensor(System):
    """A sensor of its own: a function g of (state), (state, input) or (state, input, t).

    As of any system, g may be written for one sample: batches are mapped over it.
    """

    def __init__(self, g: Callable):
        super().__init__()
        self.g, self.asks = g, what_it_asks(g)

    def observation(self, state, input, t=None):
        """Returns g."""
        given = {"state": state, "input": input, "t": t}
        return self.g(*(given[name] for name in self.asks))


def what_it_asks(g: Callable) -> list[str]:
    """Returns which of state, input and t the function g takes, in its order.

    An argument with a default is left alone, unless its name says that it is the input or the time.
    """
    if not callable(g):
        raise ValueError(f"g: expected a function, got {type(g).__name__}")
    try:
        taken = inspect.signature(g.forward if isinstance(g, nn.Module) else g).parameters.values()
    except ValueError:  # some of torch's own functions do not say
        return ["state"]
    asks, by_name = ["state"], (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.VAR_KEYWORD)
    for argument in [a for a in taken if a.kind not in by_name][1:]:
        if argument.name in TIME:
            asks.append("t")
        elif argument.name in ("u", "input") or argument.default is argument.empty:
            asks.append("input" if len(asks) == 1 else "t")
    return asks


def measured(g: Function, y: Tensor, R: Tensor, S: Tensor | None = None) -> tuple:
    """Returns g, y, R and S, where rows of y that are NaN say nothing, and how many rows do.

    Such a row of y is 0 and so is g's; its noise is 1 and independent of all others.
    """
    if has_numbers(y) and not math.isnan(y.sum().item()):
        return g, y, R, S, y.shape[-1]
    known, one = ~y.isnan(), torch.eye(R.shape[-1], dtype=R.dtype, device=R.device)
    R = torch.where(known.unsqueeze(-1) & known.unsqueeze(-2), R, one)
    if S is not None:
        S = torch.where(known.unsqueeze(-2), S, torch.zeros_like(S))
    rows = known.sum(-1, keepdim=True)
    return g.only(known), torch.where(known, y, torch.zeros_like(y)), R, S, rows


def decorrelated(f: Function, g: Function, y: Tensor, Q: Tensor, R: Tensor, S: Tensor):
    """Returns f and Q whose process noise is independent of the observation's.

    With S = cov(w, v), the observation's error v = y - g(x) says something about the process
    noise w of the same step. What it says moves into f, what is left of w has covariance Q':

        f'(x) = f(x) + S R^-1 (y - g(x))      (1)
        Q' = Q - S R^-1 S'                    (2)

    Raises:
        ValueError: where [[R, S'], [S, Q]] is no covariance, or R is not positive definite.

    Source: A. Jazwinski, "Stochastic Processes and Filtering Theory" (1970), section 7.3.
    """
    p = R.shape[-1]
    lead = torch.broadcast_shapes(Q.shape[:-2], R.shape[:-2], S.shape[:-2])
    Q, R, S = (M.expand(*lead, *M.shape[-2:]) for M in (Q, R, S))
    L = factor(
        torch.cat([torch.cat([R, S.mT], -1), torch.cat([S, Q], -1)], -2), "[[R, S'], [S, Q]]"
    )
    G = torch.linalg.solve_triangular(L[..., :p, :p], L[..., p:, :p], upper=False, left=False)
    rest = L[..., p:, p:]

    def value(x):
        return f.value(x) + bmv(G, g.difference(y, g.value(x)))  # (1)

    def slope(x):
        (z, A), (h, C) = f.slope(x), g.slope(x)
        return z + bmv(G, g.difference(y, h)), A - G @ C

    return replace(f, value=value, slope=slope), rest @ rest.mT  # (2)


def all_finite(z: Tensor) -> bool:
    """Returns whether all numbers in z are finite; False inside ``torch.vmap``."""
    return has_numbers(z) and math.isfinite(z.sum().item())


def finite(name: str, z: Tensor) -> None:
    """Raises ValueError where z, a value of the function ``name``, is NaN or infinite."""
    if not all_finite(z):
        check(f"{name}: p", z)
