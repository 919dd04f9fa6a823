"""Where each number of a tensor stands in an :class:`~.scalars.Arithmetic`, while it is recorded.

Beside every storage lies an array of the same length that says, for each of its numbers, which
place it has. A view of the one is a view of the other, so views and writes in place need no care.
"""

from typing import Any

import torch
from torch import Tensor

from .scalars import Arithmetic


class Unsupported(Exception):
    """What cannot be written down, in words that follow "it"."""


class AsksForTime(Exception):
    """The system asks for the time's value, as ``int(t)`` does."""


class Places:
    """An arithmetic, and the place in it of each number of every storage that was seen.

    A tensor that was not seen before belongs to the system: it is a parameter, and its numbers are
    ``("number", i)``, counted through all parameters.
    """

    def __init__(self) -> None:
        self.arithmetic = Arithmetic()
        self.parameters: list[Tensor] = []
        self.fixed: list[tuple[Tensor, Tensor]] = []  # parameters whose values were asked for
        self.known: dict[int, Tensor] = {}  # the places of a storage, by its address
        self.kept: list[Tensor] = []  # so that no address is used again

    def note(self, z: Tensor, places: Any) -> None:
        """Keeps the places of a new tensor's numbers."""
        if z.is_complex() or z.layout != torch.strided or z.device.type != "cpu":
            raise Unsupported(f"has a tensor of another kind, {z.dtype} on {z.device}")
        size = z.untyped_storage().nbytes() // z.element_size()
        base = torch.full((size,), -1, dtype=torch.int64)
        lies = base.as_strided(z.shape, z.stride(), z.storage_offset())
        lies.copy_(torch.as_tensor(places, dtype=torch.int64).reshape(z.shape))
        self.known[address(z)] = base
        self.kept.append(z)

    def knows(self, z: Tensor) -> bool:
        """Returns whether a tensor's storage was seen."""
        return not z.numel() or address(z) in self.known

    def of(self, z: Tensor) -> Tensor:
        """Returns the places of a tensor's numbers; one that was not seen yet is a parameter."""
        if not z.numel():
            return torch.zeros(z.shape, dtype=torch.int64)
        if not self.knows(z):
            self.note(z, torch.full(z.shape, -1))
        base = self.known[address(z)]
        places = base.as_strided(z.shape, z.stride(), z.storage_offset())
        if (places < 0).any():
            count = sum(p.numel() for p in self.parameters)
            new = [self.arithmetic.leaf("number", count + i) for i in range(z.numel())]
            places.copy_(torch.tensor(new).reshape(z.shape))
            self.parameters.append(z)
        return places

    def is_constant(self, z: Tensor) -> bool:
        """Returns whether all numbers of a tensor are known, whatever x, u and t are."""
        return all(self.arithmetic.value(i) is not None for i in self.of(z).flatten().tolist())

    def depends(self, z: Tensor) -> bool:
        """Returns whether a tensor's numbers depend on x, u or t."""
        needed = self.arithmetic.needs(self.of(z).flatten().tolist())
        return any(self.arithmetic.entries[i][0] in ("x", "u", "t") for i in needed)

    def ask(self, z: Tensor, why: str) -> None:
        """Makes sure that a tensor's values may be asked for: what the system keeps, made of it.

        Raises:
            Unsupported: where they depend on a state or an input, which ``why`` is about.
            AsksForTime: where they depend on the time.
        """
        needed = self.arithmetic.needs(self.of(z).flatten().tolist())
        leaves = {self.arithmetic.entries[i][0] for i in needed}
        if leaves & {"x", "u"}:
            raise Unsupported(why)
        if "t" in leaves:
            raise AsksForTime
        if "number" in leaves:
            self.fixed = [(p, p.detach().clone()) for p in self.parameters]


def address(z: Tensor) -> int:
    """Returns where a tensor's storage begins."""
    return z.untyped_storage().data_ptr()


def flat(z: Any) -> list:
    """Returns what stands in nested lists, tuples and dictionaries."""
    if isinstance(z, dict):
        return flat(list(z.values()))
    return [one for part in z for one in flat(part)] if isinstance(z, list | tuple) else [z]
