"""Hands a problem to compiled code: where its numbers lie, and buffers for what comes out.

The structures here are those of `ilqr.cpp`, field by field. Nothing is copied that already lies as
the code reads it: numbers of one member and one time step side by side, members and times at any
distance, or at none where they share.
"""

import ctypes
from typing import Any

import torch
from torch import Tensor

from ..control.ilqr import SWEEPS
from ..control.iterate import Solution
from ..control.problem import Problem
from .program import Program

Address, Count = ctypes.c_void_p, ctypes.c_int64
SEQUENCES = ("numbers", "Q", "p", "r", "Qf", "pf", "rf", "lower", "upper", "du", "x_init")
NUMBERS = ("X", "U", "K", "cost", "promised", "size", "damping")
NOTES = ("exact", "converged", "strange", "iterations", "history")


class CSequence(ctypes.Structure):
    """Numbers ``(T, B, ...)``, how far apart times are, and members."""

    _fields_ = [("data", Address), ("by_time", Count), ("by_member", Count)]


class CProblem(ctypes.Structure):
    """A problem of T steps for B members."""

    _fields_ = [
        ("T", Count),
        ("B", Count),
        ("times", Address),
        ("kinds", Address),
        *((name, CSequence) for name in SEQUENCES),
    ]


class CIterate(ctypes.Structure):
    """Where the iteration stands."""

    _fields_ = [(name, Address) for name in NUMBERS + NOTES]


class Run:
    """A problem on its way through the compiled code.

    Args:
        program: the system's code.
        problem: its tensors have a batch dimension for each of the plan's.
        x_init: ``(..., n)``.
        U: inputs to start from, ``(T, ..., m)``.
    """

    def __init__(self, program: Program, problem: Problem, x_init: Tensor, U: Tensor):
        T, self.batch, m, n = len(U), U.shape[1:-1], U.shape[-1], x_init.shape[-1]
        B = self.batch.numel()
        self.X, self.K = U.new_zeros(T + 1, B, n), U.new_zeros(T, B, m, n)
        self.U = U.reshape(T, B, m).clone(memory_format=torch.contiguous_format)
        self.cost, self.promised, self.size, self.damping = U.new_zeros(4, B)
        self.size.fill_(torch.inf)
        self.exact, self.converged, self.strange = torch.zeros(3, B, dtype=torch.bool)
        self.iterations = torch.zeros(B, dtype=torch.int64)
        kinds, numbers = program.at(problem.t)
        dims = len(self.batch)
        numbers = numbers.reshape(
            len(numbers), *[1] * (dims + 2 - numbers.ndim), *numbers.shape[1:]
        )
        given = [_laid_out(z, self.batch) for z in (numbers, *problem[2:], x_init[None])]
        self.kept = [problem.t, kinds, given]  # while their addresses are in use
        self.problem = CProblem(
            T, B, problem.t.data_ptr(), kinds.data_ptr(), *map(_described, given)
        )
        results = [getattr(self, name) for name in (NUMBERS + NOTES)[:-1]]
        self.iterate = CIterate(*(z.data_ptr() for z in results))
        self.plan = program.library(B > 1).plan
        self.threads = max(1, min(torch.get_num_threads(), B // 64))

    def sweep(self, count: int) -> Tensor:
        """Makes at most so many sweeps; returns the costs before and after each, (sweeps+1, B)."""
        history = self.U.new_empty(count + 1, self.U.shape[1])
        self.iterate.history = history.data_ptr()
        pointers = ctypes.byref(self.problem), ctypes.byref(self.iterate)
        most = self.plan(*pointers, Count(count), Count(self.threads))
        return history[: most + 1]

    def follow(self, stepper: Any) -> Tensor:
        """Sweeps until a stepper ends it; returns the costs before and after each sweep."""
        history: list[Tensor] = []
        for _ in range(SWEEPS):
            before = self.sweep(1)[0]
            history += [self.cost.clone()] if history else [before, self.cost.clone()]
            stepper.step(torch.where(self.converged, 0, self.promised).reshape(self.batch))
            if self.converged.all() or not stepper.continual():
                break
        return torch.stack(history)

    def solution(self, history: Tensor) -> Solution:
        """Returns where the sweeps have led."""
        if self.U.shape[1] > 1:  # members that were done earlier stay where they were
            sweeps = torch.arange(len(history))[:, None]
            history = torch.where(sweeps <= self.iterations, history, self.cost)
        plan = self.X, self.U, self.K, self.cost, self.converged, self.iterations, history
        if not self.batch:
            return Solution(*(z.squeeze(d) for d, z in zip((1, 1, 1, 0, 0, 0, 1), plan)))
        return Solution(*plan).shaped(self.batch)


def _laid_out(z: Tensor | None, batch: torch.Size) -> Tensor | None:
    """Returns numbers ``(T, *batch, ...)`` as ``(T, B or 1, ...)``, those of a member in a row."""
    if z is None:
        return None
    dims = len(batch)
    lead, core = z.shape[1 : 1 + dims], z.shape[1 + dims :]
    if not dims:
        z = z.unsqueeze(1)
    elif dims > 1 and lead.numel() == 1:
        z = z.reshape(len(z), 1, *core)
    elif dims > 1:
        z = z.expand(len(z), *batch, *core).reshape(len(z), -1, *core)
    in_a_row = z.stride(-1) == 1 and (len(core) == 1 or z.stride(-2) == core[1])
    return z if in_a_row else z.contiguous()


def _described(z: Tensor | None) -> CSequence:
    if z is None:
        return CSequence(None, 0, 0)
    by_time, by_member = (z.stride(d) if z.shape[d] > 1 else 0 for d in (0, 1))
    return CSequence(z.data_ptr(), by_time, by_member)
