"""Loops over time, in a form that torch can compile as well.

Python loops over the steps, and does for all of them at once what needs no loop. A loop that is
only arithmetic on small matrices spends its time on calling torch; numpy, on the same memory, is
called in less than half of it. While ``torch.compile`` traces, everything becomes the body of one
loop, torch's scan: compiling does not take longer for a longer horizon, and what only the next line
needs is never written to memory.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from .rows import to_rows

Tensors = tuple[Tensor, ...]


class Steps(NamedTuple):
    """What is known of every time step: sequences ``(T, *batch, ...)``.

    A function gets a step as ``f(*known_t)``; the body of a loop gets ``body(*carry, *known_t)``
    and returns the next carry and what else it gives, both tuples. What is known may have a batch
    of 1 in place of the batch.
    """

    known: Tensors
    batch: int  # its dimensions
    reverse: bool = False  # whether loops run from the last step to the first
    todo: tuple[tuple[Callable, Tensors | None], ...] = ()  # while torch compiles

    def map(self, function: Callable) -> "Steps":
        """Returns the steps with ``function`` of each still to do."""
        return self._replace(todo=(*self.todo, (function, None)))

    def accumulate(self, body: Callable, *carry: Tensor, reads: int) -> "Steps":
        """Returns the steps with a loop still to do that reads the first so many."""

        def reading(*z):
            return body(*z[: len(carry) + reads])

        return self._replace(todo=(*self.todo, (reading, carry)))

    def scan(self, body: Callable, *carry: Tensor) -> tuple[Tensors, Tensors]:
        """Returns the last carry, and what a loop's body gives, ``(T, ...)`` each."""
        return _compiled(self._replace(todo=(*self.todo, (body, carry))))


def _compiled(steps: Steps) -> tuple[Tensors, Tensors]:
    """All that is to do, as one loop over few tensors: each costs time in every round."""
    from torch._higher_order_ops.scan import scan as torch_scan

    batch, todo = steps.batch, steps.todo
    known = [z.flip(0) if steps.reverse else z for z in steps.known]
    carries = [z for _, carry in todo for z in carry or ()]
    known_rows, carry_rows = _Rows(known, 1, batch), _Rows(carries, 0, batch)

    def step(rows, at):
        old, at = carry_rows.apart(rows), known_rows.apart(at)
        new: Tensors = ()
        ys: Tensors = ()
        for function, carry in todo:
            if carry is None:
                at = function(*at)
            else:
                mine, ys = function(*old[: len(carry)], *at)
                old, new, at = old[len(carry) :], (*new, *mine), (*ys, *at)
        return carry_rows.together(new, 0), [to_rows(y, 0 if batch else y.ndim) for y in ys]

    rows, ys = torch_scan(step, carry_rows.together(carries, 0), known_rows.together(known, 1))
    ys = [y.flip(0) if steps.reverse else y for y in ys]
    last = carry_rows.apart(rows)[-len(todo[-1][1] or ()) :]
    return tuple(last), tuple(y.movedim(-1, 1) if batch else y for y in ys)


class _Rows:
    """How tensors lie in few, ``(entries, batch)``: one for each type and size of the batch.

    They are like ``zs``, which have ``lead`` dimensions before those of the batch.
    """

    def __init__(self, zs: list[Tensor], lead: int, batch: int):
        kinds: dict[Any, list[tuple[int, torch.Size]]] = {}
        for i, z in enumerate(zs):
            kind = z.dtype, batch and z.shape[lead] == 1
            kinds.setdefault(kind, []).append((i, z.shape[lead + batch :]))
        self.kinds, self.batch = list(kinds.values()), batch

    def together(self, zs: Sequence[Tensor], lead: int) -> list[Tensor]:
        """Returns the rows of tensors, after their ``lead`` dimensions."""
        rows = [to_rows(z, lead) if self.batch else z.unsqueeze(-1) for z in zs]
        rows = [z.reshape(*z.shape[:lead], -1, z.shape[-1]) for z in rows]
        return [torch.cat([rows[i] for i, _ in kind], lead) for kind in self.kinds]

    def apart(self, rows: list[Tensor]) -> list[Tensor]:
        """Returns the tensors that some rows are, ``(*batch, ...)``."""
        zs: dict[int, Tensor] = {}
        for one, kind in zip(rows, self.kinds):
            for (i, shape), z in zip(kind, one.split([shape.numel() for _, shape in kind])):
                z = z.reshape(*shape, z.shape[-1])
                zs[i] = z.movedim(-1, 0) if self.batch else z.squeeze(-1)
        return [zs[i] for i in range(len(zs))]
