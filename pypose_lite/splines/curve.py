"""A cubic spline through points or poses: rows of numbers, a table, and one formula.

A spline is a chain of segments; segment i runs from parameter t = i to i + 1. With u = t - i,
a segment starts somewhere and takes three steps, of which lambda_j(u) says how much is done:

    points    p(u) = start + lambda_1 step_1 + lambda_2 step_2 + lambda_3 step_3             (1)
    poses     T(u) = start exp(lambda_1 step_1) exp(lambda_2 step_2) exp(lambda_3 step_3)    (2)
    weights   lambda(u) = table [1, u, u^2, u^3]                                             (3)

Source: Kim, Kim, Shin, "A general construction scheme for unit quaternion curves with simple
high order derivatives", SIGGRAPH 1995 (the cumulative form); Sommer et al., "Efficient
derivative computation for cumulative B-splines on Lie groups", CVPR 2020 (its derivatives).
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil

import torch
from torch import Tensor

from ..lie import SE3, se3_adjoint, se3_bracket, se3_compose, se3_exp, se3_inverse
from ..linalg import bmv
from ..shapes import check

# Row j: the coefficients of 1, u, u^2, u^3 in lambda_j.
Table = tuple[tuple[float, float, float, float], ...]


@dataclass(frozen=True, eq=False)
class Spline:
    """A curve of S cubic segments, to be evaluated anywhere.

    Attributes:
        start: where each segment starts, points (..., S, d) or `SE3` (..., S, 7).
        steps: its three steps, each (..., S, d), or twists (..., S, 6).
        table: how much of each step is done at u.
    """

    start: Tensor
    steps: tuple[Tensor, Tensor, Tensor]
    table: Table

    @property
    def segments(self) -> int:
        """The number S of segments; the parameter runs from 0 to S."""
        return self.start.shape[-2]

    def __call__(self, t: Tensor, derivative: int = 0) -> Tensor:
        """The points or poses at the parameters ``t``, or a derivative with respect to them.

        Args:
            t: parameters (M,) or (..., M) in [0, S].
            derivative: 0, 1 or 2. For poses: the body twist ``v`` (..., M, 6), in
                ``T' = T hat(v)``, and its rate.
        """
        check("t: M", t)
        if ((t < 0) | (t > self.segments)).any():
            got = f"{t.min().item():.6g} to {t.max().item():.6g}"
            raise ValueError(f"t: expected parameters in [0, {self.segments}], got {got}")
        segment = t.detach().floor().clamp(max=self.segments - 1)
        return self.take(segment.long()).local(t - segment, derivative)

    def sample(self, interval: float = 0.1, derivative: int = 0) -> Tensor:
        """What ``__call__`` gives at 0, interval, 2 interval ... of every segment, and the end."""
        u = local_times(interval).to(self.start)
        inner = self.spread().local(u, derivative).flatten(-3, -2)
        last = self.take(torch.tensor([self.segments - 1], device=u.device))
        return torch.cat([inner, last.local(u.new_ones(1), derivative)], -2)

    def local(self, u: Tensor, derivative: int = 0) -> Tensor:
        """The same at the local parameter ``u (..., S)`` in [0, 1], one for each segment."""
        if derivative not in (0, 1, 2):
            raise ValueError(f"derivative: expected 0, 1 or 2, got {derivative}")
        weights = [_weights(self.table, u, order) for order in range(derivative + 1)]
        if isinstance(self.start, SE3):
            return _pose(self.start, self.steps, weights)
        (w1, w2, w3), (step1, step2, step3) = weights[-1], self.steps
        done = w1 * step1 + w2 * step2 + w3 * step3
        return self.start + done if derivative == 0 else done  # (1)

    def take(self, segment: Tensor) -> "Spline":
        """The segments of the given numbers (M,) or (..., M), one after the other."""
        return self._map(lambda x: _take(x, segment))

    def spread(self) -> "Spline":
        """One more dimension behind S, for any number k of u in each segment: (..., S, k)."""
        return self._map(lambda x: x.unsqueeze(-2))

    def _map(self, change: Callable[[Tensor], Tensor]) -> "Spline":
        """The spline with every tensor changed."""
        first, middle, last = map(change, self.steps)
        return Spline(change(self.start), (first, middle, last), self.table)


def local_times(interval: float) -> Tensor:
    """0, interval, 2 interval, ... below 1 (float64): k of them where interval is 1/k.

    1 / interval is taken as whole where it is so up to the rounding of a float32; otherwise
    the ceiling of a value such as 49.000000000000007 would add a sample beside a knot.
    """
    length = float(interval)
    if not 0 < length <= 1:
        raise ValueError(f"interval: expected a number in (0, 1], got {interval}")
    pieces = round(1 / length)
    if abs(pieces * length - 1) < 1e-6:
        return torch.arange(pieces, dtype=torch.float64) / pieces
    return torch.arange(ceil(1 / length), dtype=torch.float64) * length


def _take(x: Tensor, segment: Tensor) -> Tensor:
    """The rows ``segment (..., M)`` of ``x (..., S, d)``: (..., M, d)."""
    if segment.ndim == 1:
        return x.index_select(-2, segment)
    batch = torch.broadcast_shapes(x.shape[:-2], segment.shape[:-1])
    index = segment.expand(*batch, -1).unsqueeze(-1)
    return x.expand(*batch, -1, -1).take_along_dim(index, -2)


def _weights(table: Table, u: Tensor, derivative: int) -> list[Tensor]:
    """A derivative of lambda_1, lambda_2, lambda_3 at ``u (...)``, each (..., 1)."""
    rows: list = [list(row) for row in table]
    for _ in range(derivative):  # of c_k u^k: k c_k u^(k - 1)
        rows = [[k * c for k, c in enumerate(row)][1:] for row in rows]
    *lower, total = u.new_tensor(rows).unbind(-1)
    for column in reversed(lower):
        total = total * u[..., None] + column  # (3), by Horner's rule
    return [w[..., None] for w in total.unbind(-1)]


def _pose(start: SE3, steps: tuple, weights: list[list[Tensor]]) -> Tensor:
    """The pose (2), or its body twist v, or the rate a of that.

    After each factor A = exp(lambda step), with l' and l'' the derivatives of lambda,

        v <- Ad(A^-1) v + l' step,                                  (4)
        a <- Ad(A^-1) a + l' [v, step] + l'' step, with the new v.  (5)
    """
    order = len(weights) - 1
    T = start.tensor()
    v = a = torch.zeros_like(steps[0])
    for step, *scale in zip(steps, *weights, strict=True):
        A = se3_exp(scale[0] * step)
        if order == 0:
            T = se3_compose(T, A)  # (2)
            continue
        across = se3_adjoint(se3_inverse(A))
        v = bmv(across, v) + scale[1] * step  # (4)
        if order == 2:
            a = bmv(across, a) + scale[1] * se3_bracket(v, step) + scale[2] * step  # (5)
    return (T.as_subclass(SE3), v, a)[order]
