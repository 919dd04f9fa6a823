"""Loops over time and solves with small matrices, in a form that torch can compile as well.

Eager code loops in Python and calls LAPACK. While ``torch.compile`` traces, a loop becomes
torch's scan, so that compiling does not take longer for a longer horizon, and a solve becomes
plain arithmetic, which the compiler fuses with what stands around it.
"""

from collections.abc import Callable

import torch
from torch import Tensor


def scan(body: Callable, carry: Tensor, xs: tuple[Tensor, ...], reverse: bool = False):
    """Returns the last carry, and what every step gives, stacked with time first.

    ``carry, ys_t = body(carry, xs_t)`` for each t, from the last to the first where ``reverse``.

    Args:
        body: one step; ``xs_t`` and ``ys_t`` are tuples of tensors.
        carry: what goes from step to step; its shape stays.
        xs: sequences ``(T, ...)``.
        reverse: the direction.
    """
    if torch.compiler.is_compiling():
        return _compiled_scan(body, carry, xs, reverse)
    steps = list(zip(*(x.unbind(0) for x in xs)))
    ys = []
    for step in reversed(steps) if reverse else steps:
        carry, y = body(carry, step)
        ys.append(y)
    return carry, tuple(torch.stack(y) for y in zip(*(ys[::-1] if reverse else ys)))


def some(mask: Tensor) -> bool:
    """Returns whether any is True; compiled code cannot ask, and hopes that none is."""
    return not torch.compiler.is_compiling() and bool(mask.any())


def every(mask: Tensor) -> bool:
    """Returns whether all are True; compiled code cannot ask, and does not count on it."""
    return not torch.compiler.is_compiling() and bool(mask.all())


def solve_positive(H: Tensor, R: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Returns ``H^-1 R``, ``W = L^-1 R`` with ``H = L L'``, and what is not 0 where H is not > 0.

    Half of the way, W, is all that ``R' H^-1 R = W' W`` needs.

    Args:
        H: symmetric, ``(..., m, m)``.
        R: ``(..., m, k)``.
    """
    if torch.compiler.is_compiling():
        return _compiled_solve(H, R)
    L, failed = torch.linalg.cholesky_ex(H)
    W = torch.linalg.solve_triangular(L, R, upper=False)
    return torch.linalg.solve_triangular(L.mT, W, upper=True), W, failed


def _compiled_scan(body: Callable, carry: Tensor, xs: tuple[Tensor, ...], reverse: bool):
    from torch._higher_order_ops.scan import scan as torch_scan

    def cloned(carry, step):  # what a step returns must not share memory with what it is given
        carry, ys = body(carry, step)
        return _own(carry), tuple(_own(y) for y in ys)

    return torch_scan(cloned, _own(carry), tuple(_own(x) for x in xs), reverse=reverse)


def _own(x: Tensor) -> Tensor:
    return x.clone(memory_format=torch.contiguous_format)


def _compiled_solve(H: Tensor, R: Tensor) -> tuple[Tensor, Tensor, Tensor]:
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
    rows = [R[..., i, :] for i in range(m)]
    for i in range(m):
        for k in range(i):
            rows[i] = rows[i] - L[i, k][..., None] * rows[k]
        rows[i] = rows[i] / L[i, i][..., None]
    W = torch.stack(rows, dim=-2)
    for i in reversed(range(m)):
        for k in range(i + 1, m):
            rows[i] = rows[i] - L[k, i][..., None] * rows[k]
        rows[i] = rows[i] / L[i, i][..., None]
    return torch.stack(rows, dim=-2), W, failed
