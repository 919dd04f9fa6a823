"""A cubic spline through points or poses: what all the curves of this folder are.

Its makers (`hermite`, `cubic_spline`, `uniform_bspline`, `planner.path`) differ in the numbers that
they put in; evaluating it, and its derivatives, is the same for all. It is a chain of segments,
one from each knot to the next. Within a segment u runs from 0 to 1; the segment starts somewhere
and takes three steps, of which lambda_j(u) says how much is done:

    points    p(u) = start + lambda_1 step_1 + lambda_2 step_2 + lambda_3 step_3             (1)
    poses     T(u) = start exp(lambda_1 step_1) exp(lambda_2 step_2) exp(lambda_3 step_3)    (2)
    weights   lambda(u) = table [1, u, u^2, u^3]                                             (3)

The curve's own parameter t is i + u in segment i, or, where the knots have times, the time.

Source: Kim, Kim, Shin, "A general construction scheme for unit quaternion curves with simple
high order derivatives", SIGGRAPH 1995 (the cumulative form); Sommer et al., "Efficient
derivative computation for cumulative B-splines on Lie groups", CVPR 2020 (its derivatives).
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil

import torch
from torch import Tensor

from ..lie import LieGroup
from ..linalg import bmv
from ..shapes import check, has_numbers

# Row j: the coefficients of 1, u, u^2, u^3 in lambda_j.
Table = tuple[tuple[float, float, float, float], ...]


@dataclass(frozen=True, eq=False)
class Spline:
    """A curve of S cubic segments, to be evaluated anywhere.

    Attributes:
        start: where each segment starts, points (..., S, d), `SE3` (..., S, 7) or `SO3`.
        steps: its three steps, each (..., S, d), or twists (..., S, 6).
        table: how much of each step is done at u.
        times: the parameter at the knots, (S + 1,) or (..., S + 1); None is 0, 1, ..., S.
    """

    start: Tensor
    steps: tuple[Tensor, Tensor, Tensor]
    table: Table
    times: Tensor | None = None

    @property
    def segments(self) -> int:
        """The number S of segments."""
        return self.start.shape[-2]

    def __call__(self, t: Tensor | float, derivative: int = 0) -> Tensor:
        """The points or poses at the parameters ``t``, or a derivative with respect to them.

        Args:
            t: parameters (M,) or (..., M), or a single one, from the first knot's to the last's.
                Inside ``torch.vmap``, where nobody can look, those beyond continue the cubics.
            derivative: 0, 1 or 2. For poses: the body twist ``v`` (..., M, 6), in
                ``T' = T hat(v)``, and its rate.
        """
        if not isinstance(t, Tensor):
            t = torch.as_tensor(t, dtype=self.start.dtype, device=self.start.device)
        if t.ndim == 0:
            return self(t[None], derivative)[..., 0, :]
        segment, u = self.locate(t)
        there = self.take(segment).local(u, derivative)
        if self.times is None or derivative == 0:
            return there
        begin, end = _ends(self.times, segment)
        return there / (end - begin)[..., None] ** derivative

    def locate(self, t: Tensor) -> tuple[Tensor, Tensor]:
        """The numbers of the segments that ``t`` (..., M) lies in, and u in each of them."""
        check("t: M", t)
        self._refuse_outside(t)
        S = self.segments
        if self.times is None:
            segment = t.detach().floor().clamp(0, S - 1)
            return segment.long(), t - segment
        batch = torch.broadcast_shapes(self.times.shape[:-1], t.shape[:-1])
        inner, t = self.times[..., 1:-1].expand(*batch, -1), t.expand(*batch, -1)
        where = inner.detach().contiguous(), t.detach().contiguous()
        segment = torch.searchsorted(*where, right=True)  # a knot belongs to what begins there
        begin, end = _ends(self.times, segment)
        return segment, (t - begin) / (end - begin)

    def parameter(self, segment: Tensor, u: Tensor) -> Tensor:
        """The parameters ``t (..., M)`` at ``u (..., M)`` of the segments ``segment (..., M)``."""
        if self.times is None:
            return segment + u
        return torch.lerp(*_ends(self.times, segment), u)  # never beyond the end

    def sample(self, interval: float = 0.1, derivative: int = 0) -> Tensor:
        """What ``__call__`` gives at 0, interval, 2 interval ... of every segment, and the end.

        Args:
            interval: in (0, 1], a share of each segment, however long that takes.
            derivative: as in ``__call__``.
        """
        u = local_times(interval).to(self.start)
        inner = self.spread().local(u, derivative)
        last = self.take(torch.tensor([self.segments - 1], device=u.device))
        end = last.local(u.new_ones(1), derivative)
        if self.times is not None and derivative:
            scale = self.times.diff(dim=-1)[..., None] ** derivative
            inner, end = inner / scale[..., None], end / scale[..., -1:, :]
        return torch.cat([inner.flatten(-3, -2), end], -2)

    def local(self, u: Tensor, derivative: int = 0) -> Tensor:
        """The same at the local parameter ``u (..., S)`` in [0, 1], one for each segment."""
        if derivative not in (0, 1, 2):
            raise ValueError(f"derivative: expected 0, 1 or 2, got {derivative}")
        weights = [_weights(self.table, u, order) for order in range(derivative + 1)]
        if isinstance(self.start, LieGroup):
            return _pose(self.start, self.steps, weights)
        (w1, w2, w3), (step1, step2, step3) = weights[-1], self.steps
        done = w1 * step1 + w2 * step2 + w3 * step3
        return self.start + done if derivative == 0 else done  # (1)

    def take(self, segment: Tensor) -> "Spline":
        """The segments of the given numbers (M,) or (..., M), side by side: for `local` alone."""
        return self._map(lambda x: _take(x, segment))

    def spread(self) -> "Spline":
        """One more dimension behind S, for any number k of u in each segment: (..., S, k)."""
        return self._map(lambda x: x.unsqueeze(-2))

    def _map(self, change: Callable[[Tensor], Tensor]) -> "Spline":
        """The segments with every tensor changed, without their times."""
        first, middle, last = map(change, self.steps)
        return Spline(change(self.start), (first, middle, last), self.table)

    def _refuse_outside(self, t: Tensor) -> None:
        """Raises ValueError where a parameter lies before the first knot or beyond the last."""
        ends = torch.tensor([0, self.segments], dtype=t.dtype, device=t.device)
        times = ends if self.times is None else self.times.detach()
        first, last = times[..., :1], times[..., -1:]
        outside = (t < first) | (t > last)
        if has_numbers(outside) and outside.any():
            between = f"[{first.min().item():.6g}, {last.max().item():.6g}]"
            got = f"{t.min().item():.6g} to {t.max().item():.6g}"
            raise ValueError(f"t: expected parameters in {between}, got {got}")


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


def _ends(times: Tensor, segment: Tensor) -> tuple[Tensor, Tensor]:
    """When the given segments begin, and when they end, both (..., M)."""
    begin, end = (_take(x[..., None], segment)[..., 0] for x in (times[..., :-1], times[..., 1:]))
    return begin, end


def _weights(table: Table, u: Tensor, derivative: int) -> list[Tensor]:
    """A derivative of lambda_1, lambda_2, lambda_3 at ``u (...)``, each (..., 1)."""
    rows: list = [list(row) for row in table]
    for _ in range(derivative):  # of c_k u^k: k c_k u^(k - 1)
        rows = [[k * c for k, c in enumerate(row)][1:] for row in rows]
    *lower, total = torch.tensor(rows, dtype=u.dtype, device=u.device).unbind(-1)
    for column in reversed(lower):
        total = total * u[..., None] + column  # (3), by Horner's rule
    return [w[..., None] for w in total.unbind(-1)]


def _pose(start: LieGroup, steps: tuple, weights: list[list[Tensor]]) -> Tensor:
    """The pose (2), or its body twist v, or the rate a of that.

    After each factor A = exp(lambda step), with l' and l'' the derivatives of lambda,

        v <- Ad(A^-1) v + l' step,                                  (4)
        a <- Ad(A^-1) a + l' [v, step] + l'' step, with the new v.  (5)
    """
    group, order = start.operations, len(weights) - 1
    T = start.tensor()
    v = a = torch.zeros_like(steps[0])
    for step, *scale in zip(steps, *weights, strict=True):
        A = group.exp(scale[0] * step)
        if order == 0:
            T = group.compose(T, A)  # (2)
            continue
        across = group.adjoint(group.inverse(A))
        v = bmv(across, v) + scale[1] * step  # (4)
        if order == 2:
            a = bmv(across, a) + scale[1] * group.bracket(v, step) + scale[2] * step  # (5)
    return (T.as_subclass(type(start)), v, a)[order]
