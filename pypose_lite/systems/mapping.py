"""A function of one sample, over batches of any shape.

``torch.vmap`` maps most functions as they are written. What it cannot map is tried in other ways,
each slower than the one before:

1. as it is;
2. with new tensors of its own for each member: ``n = torch.zeros(3)`` may then be filled in place;
3. one time after the other, where members have different times: t is then a single number, as
   ``if t < 5``, ``math.sin(t)`` and ``table[int(t)]`` need;
4. one member after the other. A warning then names the line that cannot be mapped.

A function that fails in all of them fails by itself at last, with its own error.
"""

from collections.abc import Callable

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode

from ..shapes import inside_transform

# What returns a new tensor, which may be filled in place afterwards.
NEW = frozenset(
    "arange cat clone empty empty_like eye full full_like linspace new_empty new_full new_ones "
    "new_tensor new_zeros ones ones_like stack tensor zeros zeros_like".split()
)


def same_batch(x: Tensor, u: Tensor) -> tuple[Tensor, Tensor]:
    """Returns states and inputs with the same leading dimensions, those of both together."""
    if x.shape[:-1] == u.shape[:-1]:
        return x, u
    if u.ndim == 1:  # the quick way for one input, as broadcast_shapes is slow
        return x, u.expand(*x.shape[:-1], -1)
    batch = torch.broadcast_shapes(x.shape[:-1], u.shape[:-1])
    return x.expand(*batch, -1), u.expand(*batch, -1)


def over_batch(function: Callable, x: Tensor, u: Tensor, t: Tensor, looped: Callable) -> Tensor:
    """Returns ``function(x, u, t)`` of each member of a batch, ``(..., p)``.

    Args:
        function: maps ``(n,), (m,), ()`` to ``(p,)``; ``(1, p)`` and a number count as vectors.
        x: states ``(..., n)``.
        u: inputs ``(..., m)``, of the same batch.
        t: one time for all, ``()``, or times that broadcast with the batch.
        looped: is told the reason, an error, where members are taken one after the other.
    """

    def one(x, u, t):
        return function(x, u, t).reshape(-1)

    if x.ndim == 1:
        return _one_sample(one, x, u, t)
    batch = x.shape[:-1]
    x, u = x.reshape(-1, x.shape[-1]), u.reshape(-1, u.shape[-1])
    t = t.expand(batch).reshape(-1) if t.ndim else t
    return _over_rows(one, x, u, t, looped).reshape(*batch, -1)


def _one_sample(one: Callable, x: Tensor, u: Tensor, t: Tensor) -> Tensor:
    """Returns ``one(x, u, t)``; inside a caller's own ``torch.vmap``, in the first two ways."""
    try:
        return one(x, u, t)
    except RuntimeError:
        if not inside_transform(x) and not inside_transform(u):
            raise
    return _with_own_tensors(one)(x, u, t)


def _over_rows(one: Callable, x: Tensor, u: Tensor, t: Tensor, looped: Callable) -> Tensor:
    """Returns ``(B, p)`` for ``(B, n), (B, m)`` and ``()`` or ``(B,)``, in the quickest way."""
    members = (0, 0, 0 if t.ndim else None)
    try:
        return torch.vmap(one, members, randomness="different")(x, u, t)
    except Exception as error:
        reason = error
    try:
        return torch.vmap(_with_own_tensors(one), members, randomness="different")(x, u, t)
    except Exception:
        pass  # there are two ways left
    if t.ndim:
        return _one_time_after_the_other(one, x, u, t, looped)
    y = torch.stack([one(*row, t) for row in zip(x, u)])
    looped(reason)
    return y


def _with_own_tensors(one: Callable) -> Callable:
    """Returns the same function, in which every new tensor is each member's own.

    ``n = torch.zeros(3)`` is one tensor for all members, and has no room for what each of them
    writes into it. To add a zero that is each member's own makes room.
    """

    class OwnTensors(TorchFunctionMode):
        def __init__(self, x: Tensor, u: Tensor, t: Tensor):
            super().__init__()
            self.zero = x.new_zeros(()) + u.new_zeros(()) + t.new_zeros(())

        def __torch_function__(self, func, types, args=(), kwargs=None):
            y = func(*args, **(kwargs or {}))
            if getattr(func, "__name__", "") in NEW:
                y = y + self.zero.to(y.dtype)
            return y

    def with_own(x, u, t):
        with OwnTensors(x, u, t):
            return one(x, u, t)

    return with_own


def _one_time_after_the_other(one, x, u, t, looped) -> Tensor:
    """Returns ``(B, p)``: members that have the same time are mapped together."""
    times, which = t.unique(return_inverse=True)
    rows = [(which == i).nonzero()[:, 0] for i in range(len(times))]
    parts = [_over_rows(one, x[r], u[r], time, looped) for r, time in zip(rows, times)]
    return torch.cat(parts)[torch.cat(rows).argsort()]
