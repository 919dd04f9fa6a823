"""A system's step in compiled code, and the numbers that it takes just now.

A step is written down once for all times, or, where the system asks for the time's value
(``ref[int(t)]``, ``if t < 5``), once for each time step that a plan comes by. Steps that do the
same with other numbers are of one *kind*; each kind is compiled, and its numbers, constants and
parameters alike, are handed over with every call. So when something changes that the system
depends on (`watch`), its step is written down anew, which takes milliseconds, and only a step that
does something *else* is compiled anew.
"""

import ctypes
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import pad

from ..systems import System
from .library import load
from .places import AsksForTime, Unsupported
from .recorder import Recording, record
from .source import REALS, Kind, source
from .watch import changed, watch

KINDS = 16  # a system whose steps do more different things than so many is refused
COMPARED = 8  # steps of a plan, on first use
_libraries: dict[tuple, ctypes.CDLL] = {}


class Step(NamedTuple):
    """One step, as it was written down; leading dimensions are a batch of the system's own."""

    kind: int
    constants: Tensor  # (..., count), the numbers that it takes; 0 where a parameter's belongs
    into: Tensor  # which of them are numbers of parameters
    picked: Tensor  # (..., len(into)), which numbers of the parameters, one after another
    parameters: list[Tensor]

    def numbers(self) -> Tensor:
        """Returns the numbers that the step takes now, ``(..., count)``."""
        if not len(self.into):
            return self.constants
        flat = torch.cat([z.detach().reshape(-1).to(self.constants) for z in self.parameters])
        return self.constants.index_copy(-1, self.into, flat[self.picked])


class Program:
    """A system's steps, written down and compiled.

    Args:
        system: whose transition it is.
        n: how many states.
        m: how many inputs.
        dtype: of all numbers.
        device: where they are.

    Raises:
        RuntimeError: for a system that cannot be compiled, naming it, and why.
    """

    def __init__(self, system: System, n: int, m: int, dtype: torch.dtype, device: torch.device):
        self.system, self.sizes = system, (n, m, dtype)
        self.name = type(system).__name__
        if dtype not in REALS or device.type != "cpu":
            raise RuntimeError(
                f"{self.name} cannot be compiled: expected float32 or float64 on the CPU, got "
                f"{dtype} on {device}"
            )
        self.steps: dict[int | None, Step] = {}  # by time; None is for all times
        self.kinds: dict[Kind, int] = {}
        self.fixed: list[tuple[Tensor, Tensor]] = []  # tensors whose values were written down
        self.compared: set[bool] = set()  # which libraries were: that of one plan, and of many
        self.noted = watch(system)
        try:
            self._write_down(None)
        except AsksForTime:
            pass

    def has_changed(self) -> bool:
        """Returns whether the system would do something else by now."""
        return changed(self.noted) or any(not torch.equal(*pair) for pair in self.fixed)

    def library(self, many: bool) -> ctypes.CDLL:
        """Returns the code of all kinds of steps known so far, for one plan or for many."""
        n, m, dtype = self.sizes
        key = tuple(self.kinds), n, m, dtype, many
        if key not in _libraries:
            try:
                text = source(list(self.kinds), n, m, dtype, many)
            except Unsupported as why:
                raise RuntimeError(f"{self.name} cannot be compiled: it {why}") from why
            plans = "batches of plans" if many else "single plans"
            _libraries[key] = load(text, f"{plans} for {self.name}")
        return _libraries[key]

    def at(self, times: Tensor) -> tuple[Tensor, Tensor]:
        """Returns the kinds ``(T,)`` of some steps, and their numbers ``(T or 1, ..., count)``."""
        if None in self.steps:
            return torch.zeros_like(times), self.steps[None].numbers()[None]
        for t in times.tolist():
            if t not in self.steps:
                self._write_down(t)
        steps = [self.steps[t] for t in times.tolist()]
        numbers = [step.numbers() for step in steps]
        count = max(z.shape[-1] for z in numbers)
        padded = [pad(z, (0, count - z.shape[-1])) for z in numbers]
        return torch.tensor([step.kind for step in steps]), torch.stack(padded)

    def compare(self, many: bool, x: Tensor, U: Tensor, times: Tensor) -> None:
        """Raises RuntimeError where the compiled step is not the system's along a plan's start.

        Args:
            many: which library, that of one plan or of many.
            x: where the plan starts, ``(n,)``.
            U: its inputs ``(T, m)``.
            times: the time steps ``(T,)``.
        """
        l = torch.linspace(0.5, 1.5, len(x)).to(x)
        for u, t in list(zip(U, times))[:COMPARED]:
            y, A, B, curvature = self.system.expand_transition(x[None], u[None], t)
            S = curvature(l.expand_as(y))
            y, A, B, S = (z.flatten(0, -1 - d)[:1] for z, d in ((y, 1), (A, 2), (B, 2), (S, 2)))
            core = torch.cat([y.flatten(), torch.cat([A, B], -1).flatten(), S.flatten()])
            size = core.abs().nan_to_num(1, 1).max().clamp(min=1).item()
            close = size * torch.finfo(x.dtype).eps ** 0.5
            if not torch.allclose(self._probe(many, t, x, u, l), core, 0, close, equal_nan=True):
                why = "it reads more than its arguments"
                raise RuntimeError(f"{self.name} cannot be compiled: {why}")
            x = y[0]
        self.compared.add(many)

    def _probe(self, many: bool, t: Tensor, x: Tensor, u: Tensor, l: Tensor) -> Tensor:
        """Returns what the compiled step gives: f, its slopes and its curvature, in one row."""
        n, k = len(x), len(x) + len(u)
        result = x.new_empty(n + n * k + k * k)
        (kind,), numbers = self.at(t[None])
        given = [z.contiguous() for z in (x, u, numbers.flatten(0, -2)[0], l, result)]
        self.library(many).probe(
            ctypes.c_int64(int(kind)),
            ctypes.c_int64(int(t)),
            *(ctypes.c_void_p(z.data_ptr()) for z in given),
        )
        return result

    def _write_down(self, t: int | None) -> None:
        """Notes what the system does at a time step, or at all."""
        n, m, dtype = self.sizes
        try:
            recording, again = (record(self.system, n, m, dtype, t, seed) for seed in (0, 1))
            kind, numbers = _canonical(recording)
            if (kind, numbers) != _canonical(again):
                raise Unsupported("computes with values outside of torch, or draws them")
            if len(self.kinds) == KINDS and kind not in self.kinds:
                raise Unsupported(f"does more than {KINDS} different things at different times")
        except AsksForTime:
            raise
        except Exception as error:
            why = f"it {error}" if isinstance(error, Unsupported) else str(error)
            raise RuntimeError(f"{self.name} cannot be compiled: {why}") from error
        own, rows = recording.next_state.shape[:-1], list(zip(*numbers))
        into = [i for i, row in enumerate(rows) if isinstance(row[0], int)]
        constants = [[0 if isinstance(z, int) else z for z in row] for row in numbers]
        picked = [[row[i] for i in into] for row in numbers]
        self.fixed += recording.fixed
        self.steps[t] = Step(
            self.kinds.setdefault(kind, len(self.kinds)),
            torch.tensor(constants, dtype=dtype).reshape(*own, len(rows)),
            torch.tensor(into, dtype=torch.int64),
            torch.tensor(picked, dtype=torch.int64).reshape(*own, len(into)),
            recording.parameters,
        )


def _canonical(recording: Recording) -> tuple[Kind, list[list]]:
    """Returns what a step does, and the numbers that it takes for each of the system's batch."""
    kinds, numbers = set(), []
    for places in recording.next_state.reshape(-1, recording.next_state.shape[-1]).tolist():
        arithmetic, results, taken = recording.arithmetic.canonical(places)
        kinds.add((tuple(arithmetic.entries), tuple(results)))
        numbers.append(taken)
    if len(kinds) > 1:
        raise Unsupported("does different things for different members of its batch")
    return kinds.pop(), numbers
