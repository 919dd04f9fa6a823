"""Gaussian beliefs: squares and their roots, division by a covariance, how likely a value is.

A filter carries a covariance P, but computes with its root L, ``P = L L'``: a small variance
beside a large one then keeps twice as many digits, and what is written as a sum of squares, as
Joseph's form is, cannot turn negative by rounding. No covariance is ever inverted: a division by
one goes through its Cholesky factor, which fails where it is not positive definite, and says so.
"""

import functools
import math
from typing import NamedTuple

import torch
from torch import Tensor

from ..shapes import has_numbers


class Innovation(NamedTuple):
    """What an observation says beyond the expected, and how much of that was to be expected.

    A row without a measurement has value 0, and 1 on the diagonal of the covariance.
    """

    value: Tensor  # y minus its expectation, (..., p)
    covariance: Tensor  # S, (..., p, p)
    known: Tensor  # which rows were measured, (..., p)

    @property
    def log_likelihood(self) -> Tensor:
        """The log-density of the rows that were measured, ``(...)``; sum it over a run."""
        e, name = self.value.unsqueeze(-1), "the innovation's covariance"
        rows = self.known.sum(-1, keepdim=True)
        return log_density(e, self.covariance, rows, name).squeeze(-1)


class Correction(NamedTuple):
    """What an observation makes of a belief, and the quantities on the way there."""

    x: Tensor  # mean once y is known, (..., n)
    P: Tensor  # covariance once y is known, (..., n, n)
    z: Tensor  # the expected observation, (..., p)
    e: Tensor  # y - z, (..., p)
    S: Tensor  # covariance of e, (..., p, p)
    K: Tensor  # gain, (..., n, p)


def square(M: Tensor) -> Tensor:
    """Returns ``M M'``, which is positive semi-definite whatever was rounded in M."""
    return M @ M.mT


def divide(M: Tensor, S: Tensor) -> Tensor:
    """Returns ``M S^-1`` for a covariance S of the innovation, without inverting it."""
    return torch.cholesky_solve(M.mT, cholesky(S, "the innovation's covariance")).mT


def covariance(P: Tensor) -> Tensor:
    """Returns P exactly symmetric, its variances raised by n roundings.

    Where variances differ by more digits than a float has (1e4 beside 1e-6 in float32), even
    the correctly rounded P may be indefinite; raised by that little it is not.
    """
    return (P + P.mT) * _halves(P.shape[-1], P.dtype, P.device)


@functools.cache
def _halves(n: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """Returns a matrix of 1/2, on the diagonal more by n roundings."""
    with torch.inference_mode(False):  # it is kept, and gradients may be asked for later
        half = torch.full((n, n), 0.5, dtype=dtype, device=device)
        return half.fill_diagonal_(0.5 + 0.5 * n * torch.finfo(dtype).eps)


def cholesky(P: Tensor, name: str) -> Tensor:
    """Returns the lower L with ``L L' = P``; ValueError where P is not positive definite.

    Inside ``torch.vmap``, where no member can be asked, L is NaN there.
    """
    L, info = torch.linalg.cholesky_ex(P.lerp(P.mT, 0.5))
    if not has_numbers(info):
        return torch.where((info == 0)[..., None, None], L, torch.nan)
    if _some(info):
        raise ValueError(f"{name}: expected positive definite, got eigenvalue {_smallest(P):.3g}")
    return L


def factor(P: Tensor, name: str = "P") -> Tensor:
    """Returns the lower L with ``L L' = P`` of a positive semi-definite P, zero included.

    Differentiable where P is positive definite; a direction without variance has no gradient.

    Raises:
        ValueError: where P is indefinite by more than rounding; inside ``torch.vmap``, where no
            member can be asked, L is NaN there.
    """
    P = P.lerp(P.mT, 0.5)
    L, info = torch.linalg.cholesky_ex(P)
    if has_numbers(info) and not _some(info):
        return L
    definite = (info == 0)[..., None, None]
    one = torch.eye(P.shape[-1], dtype=P.dtype, device=P.device)
    L = torch.linalg.cholesky_ex(torch.where(definite, P, one)).L  # keeps the gradients finite
    return torch.where(definite, L, _factor_by_columns(P, name))


def _factor_by_columns(P: Tensor, name: str) -> Tensor:
    """Cholesky's factor, a column at a time; a column whose pivot is only rounding is zero."""
    n, variance = P.shape[-1], P.diagonal(dim1=-2, dim2=-1)
    rounding = n * torch.finfo(P.dtype).eps
    columns, rest = [], P
    for j in range(n):
        pivot = rest[..., j, j]
        live = pivot > rounding * variance[..., j]
        root = torch.where(live, pivot, torch.ones_like(pivot)).sqrt()
        column = rest[..., :, j] / root.unsqueeze(-1)
        columns.append(torch.where(live.unsqueeze(-1), column, torch.zeros_like(column)))
        rest = rest - columns[-1].unsqueeze(-1) * columns[-1].unsqueeze(-2)
    deviation = variance.abs().sqrt()
    scale = deviation.unsqueeze(-1) * deviation.unsqueeze(-2)
    allowed = 4 * math.sqrt(rounding) * scale + torch.finfo(P.dtype).tiny
    bad = (rest.abs() > allowed).flatten(-2).any(-1)
    L = torch.stack(columns, dim=-1).tril()
    if not has_numbers(bad):
        return torch.where(bad[..., None, None], torch.nan, L)
    if bad.any():
        raise ValueError(f"{name}: expected no negative eigenvalue, got {_smallest(P):.3g}")
    return L


def squared_distance(e: Tensor, P: Tensor, name: str) -> tuple[Tensor, Tensor]:
    """Returns ``e' P^-1 e`` of each column of ``e (..., p, k)``, and ``log det P (..., 1)``."""
    L = cholesky(P, name)
    log_det = 2 * L.diagonal(dim1=-2, dim2=-1).log().sum(-1, keepdim=True)
    return torch.linalg.solve_triangular(L, e, upper=False).square().sum(-2), log_det


def log_density(e: Tensor, P: Tensor, rows: Tensor | int, name: str) -> Tensor:
    """Returns log N(e; 0, P) of each column of ``e (..., p, k)``, of which ``rows`` rows count."""
    distance, log_det = squared_distance(e, P, name)
    rows = rows.to(P.dtype) if isinstance(rows, Tensor) else rows
    return -(distance + log_det + rows * math.log(2 * math.pi)) / 2


def _some(info: Tensor) -> bool:
    """Returns whether any is not 0, quicker than ``any`` where there is only one."""
    return bool(info if info.ndim == 0 else info.any())


def _smallest(P: Tensor) -> float:
    return torch.linalg.eigvalsh(P.detach()).min().item()
