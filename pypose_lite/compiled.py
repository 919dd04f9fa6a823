"""A sweep of iLQR compiled by torch: the same answer, several times faster.

The time loops become torch's scan and the small matrices plain arithmetic (`scan.py`); what is
left for Python is one call a sweep.
"""

import torch

from .ilqr import Iterate, Problem, improve


class CompiledSweep:
    """What :func:`ilqr.improve` does, compiled on first use and compared with it once.

    Args:
        options: for torch's inductor.
    """

    def __init__(self, **options):
        kept = {"size_asserts": False, "alignment_asserts": False}
        self.compiled = torch.compile(improve, fullgraph=True, options=kept | options)
        self.trusted: set[tuple] = set()

    def __call__(self, problem: Problem, at: Iterate, newton: bool) -> Iterate:
        """Returns the next iterate.

        Raises:
            RuntimeError: where the system cannot be compiled, or not faithfully.
        """
        if at.cost.ndim == 1:
            _any_batch(problem, at)
        kind = (type(problem.system), at.U.dtype, at.U.ndim, newton)
        if kind in self.trusted:
            return self.compiled(problem, at, newton)
        name = kind[0].__name__
        try:
            new = self.compiled(problem, at, newton)
        except Exception as error:
            raise RuntimeError(f"{name} cannot be compiled: {error}") from error
        eager = improve(problem, at, newton)
        close = 1e3 * torch.finfo(at.cost.dtype).eps
        if not torch.allclose(new.cost, eager.cost, rtol=close, atol=close):
            raise RuntimeError(f"{name} cannot be compiled: it reads more than its arguments")
        self.trusted.add(kind)
        return new


def _any_batch(problem: Problem, at: Iterate) -> None:
    """Tells the compiler that the size of the batch ``(B,)`` will change."""
    for z in (at.X, at.U, *(z for z in problem[2:] if z is not None and z.shape[1] > 1)):
        torch._dynamo.maybe_mark_dynamic(z, 1)
    for z in at[2:]:
        torch._dynamo.maybe_mark_dynamic(z, 0)
