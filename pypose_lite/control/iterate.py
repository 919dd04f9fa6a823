"""What passes from one sweep to the next: where the iteration stands, and where it has ended.

Sequences have time first, ``(T, ..., n)``; whatever a plan has only one of is ``(...)``.
"""

from typing import NamedTuple

import torch
from torch import Tensor

BATCH = (1, 1, 1, 0, 0, 0, 0, 0, 0, 0)  # at which dimension each part of an iterate has its batch


class Iterate(NamedTuple):
    """A plan, and what the latest sweep tells the next one."""

    X: Tensor  # states, (T+1, ..., n)
    U: Tensor  # inputs, (T, ..., m)
    K: Tensor  # gains that keep the system near the plan, (T, ..., m, n)
    cost: Tensor
    promised: Tensor  # what the latest sweep hoped to gain, >= 0; inf where it had no minimum
    size: Tensor  # of the latest step that was proposed, relative to U
    damping: Tensor
    exact: Tensor  # whether the next sweep may use the exact curvature
    converged: Tensor
    iterations: Tensor

    @staticmethod
    def first(X: Tensor, U: Tensor, cost: Tensor) -> "Iterate":
        """Returns a plan that no sweep has led to."""
        no, none = torch.zeros_like(cost, dtype=torch.bool), torch.zeros_like(cost)
        K = U.new_zeros(*U.shape, X.shape[-1])
        count = torch.zeros_like(cost, dtype=torch.int64)
        return Iterate(X, U, K, cost, none, none + torch.inf, none, no, no, count)

    def members(self, rows: Tensor | slice) -> "Iterate":
        """Returns some members of a batch ``(B,)``."""
        return Iterate(*(z[:, rows] if d else z[rows] for d, z in zip(BATCH, self)))

    @staticmethod
    def joined(parts: list["Iterate"]) -> "Iterate":
        """Returns several batches ``(B,)`` as one."""
        return Iterate(*(torch.cat(zs, d) for d, zs in zip(BATCH, zip(*parts))))

    def replaced(self, rows: Tensor, new: "Iterate") -> "Iterate":
        """Returns this batch ``(B,)`` with the given members replaced by new ones."""
        return Iterate(*(z.index_copy(d, rows, w) for d, z, w in zip(BATCH, self, new)))

    def unless(self, done: Tensor, new: "Iterate") -> "Iterate":
        """Returns the new iterate but for the members that are done, which stay as they are."""
        return Iterate(
            *(torch.where(_beside(done, z, d), z, w) for d, z, w in zip(BATCH, self, new))
        )


class Solution(NamedTuple):
    """A plan, and how it was found."""

    X: Tensor  # states, (T+1, ..., n)
    U: Tensor  # inputs, (T, ..., m)
    K: Tensor  # gains that keep the system near the plan, (T, ..., m, n)
    cost: Tensor
    converged: Tensor
    iterations: Tensor  # how many sweeps
    history: Tensor  # the cost at the start and after each sweep, (sweeps + 1, ...)

    def shaped(self, batch: tuple[int, ...]) -> "Solution":
        """Returns one plan, or a batch ``(B,)`` of them, as a batch of the given shape."""
        dims, old = (1, 1, 1, 0, 0, 0, 1), self.cost.ndim
        shapes = ((*z.shape[:d], *batch, *z.shape[d + old :]) for d, z in zip(dims, self))
        return Solution(*(z.reshape(shape) for z, shape in zip(self, shapes)))


def _beside(mask: Tensor, z: Tensor, dim: int) -> Tensor:
    """Returns a mask of the batch with the dimensions that z has after its batch."""
    return mask.reshape(*mask.shape, *[1] * (z.ndim - dim - mask.ndim))
