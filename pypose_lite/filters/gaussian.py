"""Gaussian beliefs: their factors, what an observation leaves of them, how likely it was.

A Gaussian filter sees a function z = h(x) through a few points: the columns of dx are how they
lie about the mean of x, those of dz how their images lie about the mean of z. EKF and UKF differ
in how they choose the points; the rest is here and in ``base.py``. Chapter 4 derives it.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor


class Joint(NamedTuple):
    """How a state x and a function z of it vary together: k points with weights."""

    mean: Tensor  # of z, (..., p)
    dx: Tensor  # (..., n, k)
    dz: Tensor  # (..., p, k)
    w: Tensor  # (k,)

    @property
    def covariance(self) -> Tensor:
        """The covariance of z, without noise, ``(..., p, p)``."""
        return (self.w * self.dz) @ self.dz.mT


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


def innovation(y: Tensor, joint: Joint, R: Tensor, residual: Callable) -> Innovation:
    """Returns what y says beyond its expectation in ``joint``, seen with noise R."""
    e, joint, R = observed(y, joint, R, residual)
    S = joint.covariance + R
    return Innovation(e, (S + S.mT) / 2, (~y.isnan()).expand(e.shape))


def condition(joint: Joint, R: Tensor) -> tuple[Tensor, Tensor]:
    """Returns the gain, and the covariance of x that is left once ``z + noise`` is known.

        S = sum w dz dz' + R                          (1)
        K = sum w dx dz' S^-1                         (2)
        P = sum w (dx - K dz)(dx - K dz)' + K R K'    (3)

    (3) is Joseph's form: a sum of squares, so that rounding cannot turn a variance negative. It
    equals the textbooks' (I - K C) P where z = C x.

    Args:
        joint: how x and z vary together.
        R: noise covariance of z, ``(..., p, p)``.

    Returns:
        K ``(..., n, p)`` and P ``(..., n, n)``.

    Raises:
        ValueError: where S is not positive definite.

    Source: D. Simon, "Optimal State Estimation" (2006), equations (3.22) and (14.58) to (14.60).
    """
    _, dx, dz, w = joint
    weighted = w * dz
    S = weighted @ dz.mT + R  # (1)
    L = cholesky(S, "the innovation's covariance")
    K = torch.cholesky_solve(weighted @ dx.mT, L).mT  # (2)
    rest = dx - K @ dz
    P = (w * rest) @ rest.mT + K @ R @ K.mT  # (3)
    return K, P


def spread(function: Callable, x: Tensor, dx: Tensor, w: Tensor, residual: Callable) -> Joint:
    """Returns how the points ``x + dx`` and their images vary, each about its mean.

    The images are compared with the first of them by ``residual``, so that angles may be averaged.
    """
    images = each(function, (x.unsqueeze(-1) + dx).movedim(-1, 0))
    centre = images[0]
    dz = residual(images, centre).movedim(0, -1)
    shift = dz @ w
    return Joint(centre + shift, dx, dz - shift.unsqueeze(-1), w)


def each(function: Callable, points: Tensor) -> Tensor:
    """Returns the images of points, ``(k, ..., n) -> (k, ..., p)``.

    The points keep the first dimension for themselves, and leave the second to a model whose
    parameters have a batch: it is not mistaken for theirs, even where both have one size.
    """
    return function(points.unsqueeze(1)).squeeze(1)


def known_rows(
    y: Tensor, z: Tensor, R: Tensor, residual: Callable
) -> tuple[Tensor, Tensor, Tensor | None]:
    """Returns ``y - z``, R, and which rows of y are known where some are not, but NaN.

    Those are made to say nothing: their difference is 0, and their noise 1, by itself.
    """
    if z.shape[-1] != R.shape[-1]:
        p = z.shape[-1]
        raise ValueError(f"R: expected (..., p={p}, p={p}), got {tuple(R.shape[-2:])}; p is g's")
    if not math.isnan(y.sum().item()):
        return residual(y, z), R, None
    known, one = ~y.isnan(), torch.eye(R.shape[-1], dtype=R.dtype, device=R.device)
    R = torch.where(known.unsqueeze(-1) & known.unsqueeze(-2), R, one)
    return residual(torch.where(known, y, z), z), R, known


def observed(
    y: Tensor, joint: Joint, R: Tensor, residual: Callable
) -> tuple[Tensor, Joint, Tensor]:
    """Returns the innovation, and joint and R without the rows that are missing."""
    e, R, known = known_rows(y, joint.mean, R, residual)
    if known is not None:
        joint = joint._replace(dz=joint.dz * known.unsqueeze(-1))
    return e, joint, R


def covariance(P: Tensor) -> Tensor:
    """Returns P exactly symmetric, its variances raised by n roundings.

    Where variances differ by more digits than a float has (1e4 beside 1e-6 in float32), even
    the correctly rounded P may be indefinite; raised by that little it is not.
    """
    n, eps = P.shape[-1], torch.finfo(P.dtype).eps
    half = torch.full((n, n), 0.5, dtype=P.dtype, device=P.device)
    return (P + P.mT) * half.fill_diagonal_(0.5 + 0.5 * n * eps)


def cholesky(P: Tensor, name: str) -> Tensor:
    """Returns the lower L with ``L L' = P``; ValueError where P is not positive definite."""
    L, info = torch.linalg.cholesky_ex(P.lerp(P.mT, 0.5))
    if _some(info):
        raise ValueError(f"{name}: expected positive definite, got eigenvalue {_smallest(P):.3g}")
    return L


def factor(P: Tensor, name: str = "P") -> Tensor:
    """Returns the lower L with ``L L' = P`` of a positive semi-definite P, zero included.

    Differentiable where P is positive definite; a direction without variance has no gradient.

    Raises:
        ValueError: where P is indefinite by more than rounding.
    """
    P = P.lerp(P.mT, 0.5)
    L, info = torch.linalg.cholesky_ex(P)
    if not _some(info):
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
    if (rest.abs() > allowed).any():
        raise ValueError(f"{name}: expected no negative eigenvalue, got {_smallest(P):.3g}")
    return torch.stack(columns, dim=-1).tril()


def squared_distance(e: Tensor, P: Tensor, name: str) -> tuple[Tensor, Tensor]:
    """Returns ``e' P^-1 e`` of each column of ``e (..., p, k)``, and ``log det P (..., 1)``."""
    L = cholesky(P, name)
    log_det = 2 * L.diagonal(dim1=-2, dim2=-1).log().sum(-1, keepdim=True)
    return torch.linalg.solve_triangular(L, e, upper=False).square().sum(-2), log_det


def log_density(e: Tensor, P: Tensor, rows: Tensor | int, name: str) -> Tensor:
    """Returns log N(e; 0, P) of each column of ``e (..., p, k)``, of which ``rows`` rows count."""
    distance, log_det = squared_distance(e, P, name)
    return -(distance + log_det + rows * math.log(2 * math.pi)) / 2


def _some(info: Tensor) -> bool:
    """Returns whether any is not 0, quicker than ``any`` where there is only one."""
    return bool(info if info.ndim == 0 else info.any())


def _smallest(P: Tensor) -> float:
    return torch.linalg.eigvalsh(P.detach()).min().item()
