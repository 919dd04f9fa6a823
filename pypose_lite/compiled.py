"""A sweep of iLQR compiled by torch: the same answer, several times faster.

The time loops become torch's scan and the small matrices plain arithmetic (`scan.py`); what is
left for Python is one call a sweep. The compiled sweep takes the straight road: full steps, and
one Riccati run. Where that leads nowhere, the sweep in Python goes on.
"""

from typing import Any

import torch
from torch import Tensor

from .ilqr import Iterate, Problem, advance, improve

OPTIONS: dict[str, Any] = {
    "size_asserts": False,
    "alignment_asserts": False,
    "realize_reads_threshold": 0,  # what is needed twice, such as a sine, is computed once
    "force_pointwise_cat": True,  # and what is put together is so in one pass
}


class CompiledSweep:
    """What :func:`ilqr.improve` does, compiled on first use and compared with it once.

    Args:
        options: for torch's inductor.
    """

    def __init__(self, **options):
        self.compiled = torch.compile(improve, fullgraph=True, options=OPTIONS | options)
        self.trusted: set[tuple] = set()

    def __call__(self, problem: Problem, at: Iterate, newton: bool) -> Iterate:
        """Returns the next iterate.

        Raises:
            RuntimeError: where the system cannot be compiled, or not faithfully.
        """
        if at.cost.shape == (1,):  # which the compiler would see as another kind of batch
            twice = torch.zeros(2, dtype=torch.int64, device=at.cost.device)
            return self(problem.members(twice), at.members(twice), newton).members(twice[:1])
        new = self._straight(problem, at, newton)
        stuck = ~(new.cost < at.cost) & ~new.converged
        if stuck.any():
            new = new.unless(~stuck, advance(improve, problem, at, stuck, newton))
        return new

    def _straight(self, problem: Problem, at: Iterate, newton: bool) -> Iterate:
        """Returns what the compiled code makes of it, once that is known to be right."""
        kind = (at.U.dtype, at.U.shape[0], at.U.ndim, *(z is None for z in problem[2:]))
        name = type(problem.system).__name__
        given = (
            Problem(*problem[:2], *map(_own, problem[2:])),  # type: ignore[arg-type]
            Iterate(*map(_own, at)),  # type: ignore[arg-type]
        )
        if at.cost.ndim == 1:
            _any_batch(*given)
        if kind in self.trusted:
            return self.compiled(*given, True)
        try:
            new = self.compiled(*given, True)
        except Exception as error:
            raise RuntimeError(f"{name} cannot be compiled: {error}") from error
        if not _alike(at, new, improve(problem, at, newton)):
            raise RuntimeError(f"{name} cannot be compiled: it reads more than its arguments")
        self.trusted.add(kind)
        return new


def _own(z: Tensor | None) -> Tensor | None:
    """Returns a copy with the usual strides, as the compiler tells tensors apart by them."""
    return None if z is None else z.clone(memory_format=torch.contiguous_format)


def _alike(at: Iterate, new: Iterate, eager: Iterate) -> bool:
    """Returns whether two sweeps have led to the same cost, where the first led anywhere."""
    close = 1e3 * torch.finfo(new.cost.dtype).eps
    same = torch.isclose(new.cost, eager.cost, rtol=close, atol=close)
    return bool((same | (new.cost == at.cost)).all())


def _any_batch(problem: Problem, at: Iterate) -> None:
    """Tells the compiler that the size of the batch ``(B,)`` will change."""
    for z in (at.X, at.U, *(z for z in problem[2:] if z is not None and z.shape[1] > 1)):
        torch._dynamo.maybe_mark_dynamic(z, 1)
    for z in at[2:]:
        torch._dynamo.maybe_mark_dynamic(z, 0)
