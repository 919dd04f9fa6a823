"""Products of small matrices and vectors, and solves, for each member of a batch.

Vectors come last and batches first: a state is ``(..., n)``. One matrix, or a few, go to BLAS and
LAPACK. Of many, and while torch compiles, each number is a row of its own in memory with a column
for every member, ``(..., n, B)``, and a product is plain arithmetic on such rows: no call for each
member, and vector instructions all the way. What loops of arithmetic call (`scan.py`) takes numpy's
arrays, too.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

MANY, SMALL = 256, 8  # rows are quicker for so many members or more, with so many columns or less


def bmv(mat: Tensor, vec: Tensor) -> Tensor:
    """Batched matrix times vector: ``(..., n, m), (..., m) -> (..., n)``."""
    if torch.compiler.is_compiling():
        return _in_rows(lambda A, b: _dot(A, b.unsqueeze(-3), -2), 1, (mat, 2), (vec, 1))
    if vec.ndim == 1:  # the quick way; rows would not be quicker, as with matrices
        return mat @ vec
    return (mat @ vec.unsqueeze(-1)).squeeze(-1)


def bmm(lmat: Tensor, rmat: Tensor) -> Tensor:
    """Batched matrix product: ``(..., n, k), (..., k, m) -> (..., n, m)``."""
    if not _many(lmat, 2):
        return lmat @ rmat

    def product(A, B):
        return _dot(A.unsqueeze(-2), B.unsqueeze(-4), -3)

    return _in_rows(product, 2, (lmat, 2), (rmat, 2))


def bvv(lvec: Tensor, rvec: Tensor) -> Tensor:
    """Batched inner product of two vectors: ``(..., n), (..., n) -> (...)``."""
    return (lvec * rvec).sum(-1)


def bvmv(lvec: Tensor, mat: Tensor, rvec: Tensor) -> Tensor:
    """Batched vector times matrix times vector: ``(..., n), (..., n, m), (..., m) -> (...)``."""
    return bvv(lvec, bmv(mat, rvec))


def cat(parts: list[Tensor] | tuple[Tensor, ...], dim: int, core: int = 2) -> Tensor:
    """Returns parts of matrices, or of what has so many dimensions of its own, put together."""
    if isinstance(parts[0], np.ndarray):
        return np.concatenate(parts, dim)
    if not _many(parts[0], core):
        return torch.cat(parts, dim)
    cores = [(part, core) for part in parts]
    return _in_rows(lambda *rows: torch.cat(rows, dim - 1), core, *cores)


def stack(parts: Sequence[Tensor]) -> Tensor:
    """Returns parts put together along a new first dimension."""
    return torch.stack(tuple(parts)) if isinstance(parts[0], Tensor) else np.stack(parts)


def where(mask: Tensor, these: Any, those: Any) -> Any:
    """Returns these where the mask is True, and those elsewhere."""
    return (torch if isinstance(mask, Tensor) else np).where(mask, these, those)


def solve_positive(H: Tensor, R: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Returns ``H^-1 R``, ``W = L^-1 R`` with ``H = L L'``, and what is not 0 where H is not > 0.

    Half of the way, W, is all that ``R' H^-1 R = W' W`` needs.

    Args:
        H: symmetric, ``(..., m, m)``.
        R: ``(..., m, k)``.
    """
    if isinstance(H, np.ndarray):
        return _solve_in_numpy(H, R)
    if _many(H, 2):
        return _solve_by_rows(H, R)
    L, failed = torch.linalg.cholesky_ex(H)
    W = torch.linalg.solve_triangular(L, R, upper=False)
    return torch.linalg.solve_triangular(L.mT, W, upper=True), W, failed


def eye(H: Tensor) -> Tensor:
    """Returns the identity matrix that fits square matrices ``(..., m, m)``."""
    if isinstance(H, np.ndarray):
        return np.eye(H.shape[-1], dtype=H.dtype)
    return torch.eye(H.shape[-1], dtype=H.dtype, device=H.device)


def settled(z: Tensor, core: int) -> Tensor:
    """Returns ``(..., *core)``, of so many dimensions, in rows where those are quicker."""
    return from_rows(to_rows(z, -core - 1), -core - 1) if _many(z, core) else z


def inside_transform(z: Tensor) -> bool:
    """Returns whether torch compiles, or one of its transforms hands out z."""
    return torch.compiler.is_compiling() or torch._C._functorch.is_functorch_wrapped_tensor(z)


def to_rows(z: Tensor, batch: int) -> Tensor:
    """Returns a copy whose dimension ``batch``, where there is one, has come last."""
    z = z.movedim(batch, -1) if -z.ndim <= batch < z.ndim else z
    return z.clone(memory_format=torch.contiguous_format)


def from_rows(z: Tensor, batch: int) -> Tensor:
    """Returns what :func:`to_rows` was given; it stays where it lies."""
    return z.movedim(-1, batch) if -z.ndim <= batch < z.ndim else z


def _dot(a: Tensor, b: Tensor, dim: int) -> Tensor:
    """Returns the sum of ``a * b`` over a dimension, without ever writing all of ``a * b``."""
    if torch.compiler.is_compiling():
        return (a * b).sum(dim)
    (first, second), *pairs = zip(a.unbind(dim), b.unbind(dim), strict=True)
    total = first * second
    for pair in pairs:
        total.addcmul_(*pair)
    return total


def _solve_in_numpy(H: np.ndarray, R: np.ndarray) -> Any:
    try:
        inverse = np.linalg.inv(np.linalg.cholesky(H))  # numpy has no solve for triangles
    except np.linalg.LinAlgError:
        return np.full_like(R, np.nan), np.full_like(R, np.nan), 1
    W = inverse @ R
    return inverse.mT @ W, W, 0


def _solve_by_rows(H: Tensor, R: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Cholesky's factor column by column, then both triangular solves, row by row."""
    m = H.shape[-1]
    L: dict[tuple[int, int], Tensor] = {}
    failed = torch.zeros_like(H[..., 0, 0], dtype=torch.int32)
    for j in range(m):
        for i in range(j, m):
            s = H[..., i, j]
            for k in range(j):
                s = s - L[i, k] * L[j, k]
            if i == j:
                failed = failed + (~(s > 0)).to(torch.int32)
                s = torch.where(s > 0, s, 1).sqrt()
            else:
                s = s / L[j, j]
            L[i, j] = s
    rows = [R[..., i : i + 1, :] for i in range(m)]
    for i in range(m):
        for k in range(i):
            rows[i] = rows[i] - L[i, k][..., None, None] * rows[k]
        rows[i] = rows[i] / L[i, i][..., None, None]
    W = cat(rows, -2)
    for i in reversed(range(m)):
        for k in range(i + 1, m):
            rows[i] = rows[i] - L[k, i][..., None, None] * rows[k]
        rows[i] = rows[i] / L[i, i][..., None, None]
    return cat(rows, -2), W, failed


def _many(z: Tensor, core: int) -> bool:
    """Returns whether rows are quicker for ``(..., *core)``, of so many dimensions of its own."""
    if torch.compiler.is_compiling():
        return True
    return z.ndim > core and z.shape[-core - 1] >= MANY and z.shape[-1] <= SMALL


def _in_rows(function: Callable[..., Tensor], core: int, *parts: tuple[Tensor, int]) -> Tensor:
    """Returns ``function`` of parts as rows ``(..., *core, B)``, the result turned back.

    ``core`` counts the dimensions of the result but the batch, and each part comes with its own.
    """
    y = function(*(z.movedim(-c - 1, -1) if z.ndim > c else z.unsqueeze(-1) for z, c in parts))
    alone = all(z.ndim == c for z, c in parts)
    return y.squeeze(-1) if alone else y.movedim(-1, -core - 1)
