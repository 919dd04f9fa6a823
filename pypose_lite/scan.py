"""Loops over time, in a form that torch can compile as well.

Eager code loops in Python. While ``torch.compile`` traces, a loop becomes torch's scan, so that
compiling does not take longer for a longer horizon.
"""

from collections.abc import Callable

import torch
from torch import Tensor

from .batched import from_rows, to_rows


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


def _compiled_scan(body: Callable, carry: Tensor, xs: tuple[Tensor, ...], reverse: bool):
    """Torch's scan of batches in rows; a step's results share no memory with what it is given."""
    from torch._higher_order_ops.scan import scan as torch_scan

    def turned(carry, step):
        carry, ys = body(from_rows(carry, 0), tuple(from_rows(x, 0) for x in step))
        return to_rows(carry, 0), tuple(to_rows(y, 0) for y in ys)

    rows = tuple(to_rows(x, 1) for x in xs)
    carry, ys = torch_scan(turned, to_rows(carry, 0), rows, reverse=reverse)
    return from_rows(carry, 0), tuple(from_rows(y, 1) for y in ys)
