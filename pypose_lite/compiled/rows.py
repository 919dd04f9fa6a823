"""Small matrices of many members as plain arithmetic, which is what a compiler makes fast.

Each number is a row of its own in memory with a column for every member, ``(..., n, B)``.
"""

from collections.abc import Callable

import torch
from torch import Tensor


def bmv(mat: Tensor, vec: Tensor) -> Tensor:
    """Batched matrix times vector."""
    return _in_rows(lambda A, b: (A * b.unsqueeze(-3)).sum(-2), 1, (mat, 2), (vec, 1))


def bmm(lmat: Tensor, rmat: Tensor) -> Tensor:
    """Batched matrix product."""

    def product(A, B):
        return (A.unsqueeze(-2) * B.unsqueeze(-4)).sum(-3)

    return _in_rows(product, 2, (lmat, 2), (rmat, 2))


def cat(parts, dim: int, core: int = 2) -> Tensor:
    """Returns parts of arrays with ``core`` own dimensions, put together."""
    cores = [(part, core) for part in parts]
    return _in_rows(lambda *rows: torch.cat(rows, dim - 1), core, *cores)


def to_rows(z: Tensor, batch: int) -> Tensor:
    """Returns a copy whose dimension ``batch``, where there is one, has come last."""
    z = z.movedim(batch, -1) if -z.ndim <= batch < z.ndim else z
    return z.clone(memory_format=torch.contiguous_format)


def from_rows(z: Tensor, batch: int) -> Tensor:
    """Returns what :func:`to_rows` was given; it stays where it lies."""
    return z.movedim(-1, batch) if -z.ndim <= batch < z.ndim else z


def solve_positive(H: Tensor, R: Tensor) -> tuple[Tensor, Tensor, Tensor]:
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


def _in_rows(function: Callable[..., Tensor], core: int, *parts: tuple[Tensor, int]) -> Tensor:
    """Returns ``function`` of parts as rows ``(..., *core, B)``, the result turned back.

    ``core`` counts the dimensions of the result but the batch, and each part comes with its own.
    """
    y = function(*(z.movedim(-c - 1, -1) if z.ndim > c else z.unsqueeze(-1) for z, c in parts))
    alone = all(z.ndim == c for z, c in parts)
    return y.squeeze(-1) if alone else y.movedim(-1, -core - 1)
