"""Sweeps of iLQR compiled by torch: the same answer, several times faster.

The loops over time become torch's scan (`scan.py`) and the small matrices plain arithmetic, many
members at a time (`batched.py`). Of a single plan all sweeps are one compiled loop, too, and Python
is called once. Of a batch each sweep is a call, so that members that have converged drop out; it
takes full steps after one Riccati run, and members whom that leads nowhere are swept once more,
by steps of all lengths.
"""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor

from ..control import ilqr
from ..control.ilqr import SWEEPS, Iterate, Solution, apart, first, in_line, optimize, start
from ..control.problem import Problem
from .rows import from_rows, to_rows
from .sweep import STEPS, cost, follow, improve

AT_ONCE = 1024  # members in a call: what they need fits the cache of a processor
OPTIONS: dict[str, Any] = {
    "size_asserts": False,
    "alignment_asserts": False,
    "max_fusion_size": 1000,  # the body of a loop over time is one kernel
    "realize_reads_threshold": 0,  # what is needed twice, such as a sine, is computed once
    "realize_cpu_acc_reads_threshold": 6,  # and so is the product of two matrices
    "cpp_wrapper": True,  # loops are C++, too
    "inplace_buffers": False,  # else a loop's result is declared twice there
}
ALONE: dict[str, Any] = {
    "fullgraph": True,
    "dynamic": False,  # all sizes are known, but that of the batch
    "isolate_recompiles": True,  # nothing is shared with other controllers
    "recompile_limit": 64,  # for so many kinds of problems, and values of a system's numbers
}


class CompiledOptimizer:
    """What :func:`ilqr.optimize` does, compiled on first use and compared with it once.

    Args:
        options: for torch's inductor.

    Raises:
        RuntimeError: where torch is older than 2.13.
    """

    def __init__(self, **options):
        if torch.__version__ < "2.13":
            raise RuntimeError(f"compile: expected torch 2.13, got {torch.__version__}")
        from .entries import Entries, Unallocated  # with torch's compiler, which takes seconds

        passes = {"post_grad_custom_pre_pass": Entries(), "_post_fusion_custom_pass": Unallocated()}
        options = OPTIONS | passes | {"guard_filter_fn": _guards} | options
        self.sweep, self.sweeps = (  # copies, as torch takes options out of what it is given
            torch.compile(function, options=dict(options), **ALONE)
            for function in (improve, improve_all)
        )
        self.trusted: set[tuple] = set()

    def __call__(self, problem: Problem, x_init: Tensor, U: Tensor, stepper=None) -> Solution:
        """Returns the plan that sweeps from U lead to.

        Raises:
            RuntimeError: where the system cannot be compiled, or not faithfully.
            ValueError: where the rollout of U is not finite.
        """
        line = in_line(problem, x_init, U)
        if line is not None:
            return self(*line, stepper).shaped(U.shape[1:-1])
        if U.ndim > 3:
            name, batch = type(problem.system).__name__, tuple(U.shape[1:-1])
            raise RuntimeError(
                f"{name} cannot be compiled for a batch {batch}: it has a batch of its own, and "
                "that may have one dimension"
            )
        if U.ndim > 2 or stepper is not None:
            return optimize(problem, x_init, U, stepper, self.improve)
        with torch.no_grad():
            known = self._kind(problem, U) in self.trusted
            at = (_unmoved if known else start)(problem, x_init, U)
            at, history = self._improve_all(problem, at, SWEEPS)
            if not math.isfinite(history[0] + at.X.sum()):
                start(problem, x_init, U)  # says what diverges
        history = history[: int(at.iterations) + 1]
        return Solution(at.X, at.U, at.cost, at.converged, at.iterations, history)

    def improve(self, problem: Problem, at: Iterate, newton: bool) -> Iterate:
        """Returns the next iterate."""
        if at.cost.ndim == 0:
            return self._improve_all(problem, at, 1)[0]
        if not apart(problem, at.X[0], at.U[0]):
            new = self._step(problem, at, torch.ones_like(at.cost))
            stuck = _stuck(at, new)
            return new.unless(~stuck, ilqr.improve(problem, at, newton)) if stuck.any() else new
        parts = [
            self._improve_some(problem.members(rows), at.members(rows))
            for rows in _shares(len(at.cost))
        ]
        return parts[0] if len(parts) == 1 else Iterate.joined(parts)

    def _improve_some(self, problem: Problem, at: Iterate) -> Iterate:
        """Returns the next iterate of a batch ``(B,)``: by full steps, where they help."""
        new = self._step(problem, at, torch.ones_like(at.cost))
        stuck = _stuck(at, new)
        if not stuck.any():
            return new
        rows, lengths = stuck.nonzero()[:, 0], STEPS.to(at.cost)
        again, lengths = rows.repeat(len(lengths)), lengths.repeat_interleave(len(rows))
        tried = self._step(problem.members(again), at.members(again), lengths)
        best = tried.cost.reshape(-1, len(rows)).argmin(0)
        best = best * len(rows) + torch.arange(len(rows), device=rows.device)
        return new.replaced(rows, tried.members(best))

    def _step(self, problem: Problem, at: Iterate, length: Tensor) -> Iterate:
        """Returns the next iterate of a batch, each member by a step of its own length."""
        given = (*_owned(problem, at), True, length)
        if length.ndim == 1:
            _any_batch(given[0], given[1], length)
        self._check(problem, at, lambda: self.sweep(*given))
        return self.sweep(*given)

    def _improve_all(self, problem: Problem, at: Iterate, sweeps: int) -> tuple[Iterate, Tensor]:
        """Returns where at most so many sweeps of a single plan end, and the costs on the way."""
        given = (*_owned(problem, at), at.cost.new_zeros(SWEEPS + 1))
        self._check(problem, at, lambda: self.sweeps(*given, torch.ones_like(at.iterations))[0])
        return self.sweeps(*given, torch.full_like(at.iterations, sweeps))

    def _check(self, problem: Problem, at: Iterate, run: Callable[[], Iterate]) -> None:
        """Runs a compiled sweep for the first time, and compares it with that of Python."""
        kind = self._kind(problem, at.U)
        if kind in self.trusted:
            return
        name = type(problem.system).__name__
        try:
            new = run()
        except Exception as error:
            raise RuntimeError(f"{name} cannot be compiled: {error}") from error
        if not _alike(at, new, ilqr.improve(problem, at, True)):
            raise RuntimeError(f"{name} cannot be compiled: it reads more than its arguments")
        self.trusted.add(kind)

    @staticmethod
    def _kind(problem: Problem, U: Tensor) -> tuple:
        """Returns what another code is compiled for."""
        return (U.dtype, U.shape[0], U.ndim, *(z is None for z in problem[2:]))


def improve_all(problem: Problem, at: Iterate, history: Tensor, left: Tensor):
    """Returns the last iterate of a single plan, and ``history`` with the costs on the way.

    The states of ``at`` but the first, and its cost, are made from its inputs.
    """
    from torch._higher_order_ops.while_loop import while_loop

    T, m = at.U.shape
    stay = at.U.new_zeros(T, m, at.X.shape[-1] + 1)
    X, U = follow(problem, at.X[0], at.X, at.U, stay)
    now, steps = cost(problem, X, U), torch.arange(len(history), device=history.device)
    history = torch.where(steps == at.iterations, now, history)

    def goes_on(left, history, *at):
        return (left > 0) & ~Iterate(*at).converged

    def sweep(left, history, *at):
        new = improve(problem, Iterate(*at), True)
        history = torch.where(steps == new.iterations, new.cost, history)
        return left - 1, history, *(z.clone() for z in new)

    at = at._replace(X=X, U=U, cost=now)
    _, history, *rest = while_loop(goes_on, sweep, (left.clone(), history, *at))
    return Iterate(*rest), history


def _shares(count: int) -> list[slice]:
    """Returns equal shares of a batch, small enough for the processor's cache."""
    shares = math.ceil(count / AT_ONCE)
    edges = [count * i // shares for i in range(shares + 1)]
    return [slice(*pair) for pair in pairwise(edges)]


def _stuck(at: Iterate, new: Iterate) -> Tensor:
    """Returns whether a sweep has led nowhere, though its model had a minimum."""
    return ~(new.cost < at.cost) & ~new.converged & torch.isfinite(new.promised)


def _unmoved(problem: Problem, x_init: Tensor, U: Tensor) -> Iterate:
    """Returns the inputs to start from, and what else `improve_all` makes of them itself."""
    X = x_init.expand(len(U) + 1, -1)
    return first(X, problem.clip(U), X.new_zeros(()))


def _owned(problem: Problem, at: Iterate) -> tuple[Problem, Iterate]:
    """Returns copies, a batch's in rows; the compiler tells tensors apart by how they lie."""

    def own(z: Tensor) -> Tensor:
        if at.cost.ndim == 0:
            return z.clone(memory_format=torch.contiguous_format)
        return from_rows(to_rows(z, 1), 1)

    tensors = [z if z is None else own(z) for z in problem[2:]]
    return Problem(*problem[:2], *tensors), Iterate(*map(own, at))  # type: ignore[arg-type]


def _any_batch(problem: Problem, at: Iterate, length: Tensor) -> None:
    """Tells the compiler that the size of the batch ``(B,)`` will change."""
    for z in (at.X, at.U, *(z for z in problem[2:] if z is not None and z.shape[1] > 1)):
        torch._dynamo.maybe_mark_dynamic(z, 1)
    for z in (*at[2:], length):
        torch._dynamo.maybe_mark_dynamic(z, 0)


def _alike(at: Iterate, new: Iterate, eager: Iterate) -> bool:
    """Returns whether two sweeps have led to the same cost, where the first led anywhere."""
    close = 1e3 * torch.finfo(new.cost.dtype).eps
    same = torch.isclose(new.cost, eager.cost, rtol=close, atol=close)
    return bool((same | (new.cost == at.cost)).all())


def _guards(entries) -> list[bool]:
    """Returns which of what a sweep reads may change: not the code of this library and of torch."""
    fixed = {"pypose_lite", "torch", *globals(), *improve.__globals__}

    def package(name: str) -> str:  # G['__import_torch_dot_func'].vjp is of torch
        return name.removeprefix("G['").split("'")[0].removeprefix("__import_").split("_dot_")[0]

    def may_change(entry) -> bool:
        if entry.is_global:
            return package(entry.name) not in fixed
        return "__import__('torch')" not in entry.name

    return [may_change(entry) for entry in entries]
