"""Writes a system's step down: torch runs it once, and every number's way is noted.

:func:`record` calls the system's transition for one sample. Under a dispatch mode each operation
of torch comes by here; what it does to the places of numbers (`places`), `rules` says.

A tensor that the system keeps is not written down but told when the code runs, so that training
needs no new code. A *value* that the run asks for, by ``int(t)`` or ``float(self.mass)``, cannot be
told later. Of a tensor that the system keeps it is written down, and noted as fixed. Of the time,
:class:`AsksForTime` is raised, and the caller records each time step by itself. Of a state, there
is no way: the system branches on it, and :class:`Unsupported` says so.
"""

from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

from ..shapes import RECORDING
from ..systems import System
from . import rules
from .places import Places, Unsupported, flat
from .scalars import Arithmetic

LARGEST = 20_000  # operations on single numbers: more would take too long to compile


class Recording(NamedTuple):
    """What a system computes."""

    arithmetic: Arithmetic
    next_state: Tensor  # (..., n), the places of its numbers; leading: a batch of its parameters
    parameters: list[Tensor]  # whose numbers ("number", i) counts through, one after another
    fixed: list[tuple[Tensor, Tensor]]  # tensors whose values are written down, and these


def record(
    system: System, n: int, m: int, dtype: torch.dtype, t: int | None = None, seed: int = 0
) -> Recording:
    """Returns what ``system.transition`` computes of x (n,), u (m,) and t, or of the given t.

    It is called at a point that the seed says; what it computes must not depend on that.

    Raises:
        AsksForTime: where t is not given and its value is asked for.
        Unsupported: for what cannot be written down.
    """
    g = torch.Generator().manual_seed(seed)
    x, u = (torch.rand(size, generator=g, dtype=dtype) for size in (n, m))
    clock = torch.tensor(1 if t is None else t)
    places = Places()
    leaf = places.arithmetic.leaf
    places.note(x, [leaf("x", i) for i in range(n)])
    places.note(u, [leaf("u", i) for i in range(m)])
    places.note(clock, [leaf("t") if t is None else leaf("constant", t)])
    without_numbers = RECORDING.set(True)
    try:
        with torch.no_grad(), _Recorder(places):
            y = system.transition(x, u, clock)
    finally:
        RECORDING.reset(without_numbers)
    return Recording(places.arithmetic, places.of(y), places.parameters, places.fixed)


class _Recorder(TorchDispatchMode):
    """Sees each operation of torch, and notes where its results come from."""

    def __init__(self, places: Places):
        super().__init__()
        self.places = places

    @classmethod
    def _should_skip_dynamo(cls) -> bool:
        """Where this is True, torch loads its compiler, a second's work, to warn it of the mode."""
        return False

    def __torch_dispatch__(self, func, types, args=(), kwargs=None) -> Any:
        """Runs an operation."""
        places, kwargs = self.places, kwargs or {}
        name = func._schema.name.removeprefix("aten::")
        given = [z for z in flat((args, kwargs)) if isinstance(z, Tensor)]
        for z in given:
            if name == "lift_fresh" and not places.knows(z):  # torch.tensor([1.0, 2.0])
                places.note(z, [places.arithmetic.constant(v) for v in z.flatten().tolist()])
            places.of(z)
        if torch.Tag.nondeterministic_seeded in func.tags:
            raise Unsupported(f"draws random numbers ({name})")
        if name in ("_local_scalar_dense", "is_nonzero"):
            places.ask(args[0], "branches on a state or an input, or asks for its value")
        elif func._schema.is_mutable:
            return self._write(func, name, args, kwargs)
        elif not rules.knows(places, func, name, given):
            return self._decomposed(func, name, args, kwargs)
        result = func(*args, **kwargs)
        for i, z in enumerate(flat(result)):
            if isinstance(z, Tensor) and not places.knows(z):
                places.note(z, rules.origin(places, func, name, args, kwargs, z, i))
        if len(places.arithmetic.entries) > LARGEST:
            raise Unsupported(f"has more than {LARGEST} operations on single numbers")
        return result

    def _write(self, func, name: str, args, kwargs) -> Any:
        """Runs an operation that writes in place; x += y is x.copy_(x + y)."""
        if "out" in kwargs or not name.endswith("_"):
            raise Unsupported(f"uses {name} with out=")
        if name not in rules.WRITES:
            with self:
                return args[0].copy_(getattr(torch.ops.aten, name[:-1])(*args, **kwargs))
        rules.write(self.places, func, name, args)
        return func(*args, **kwargs)

    def _decomposed(self, func, name: str, args, kwargs) -> Any:
        """Runs an operation as simpler ones."""
        from torch._decomp import decomposition_table

        with self:
            if func in decomposition_table:
                return decomposition_table[func](*args, **kwargs)
            result = func.decompose(*args, **kwargs)
        if result is NotImplemented:
            raise Unsupported(f"uses {name}, which has no rule here")
        return result
