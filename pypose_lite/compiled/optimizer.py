"""What `MPC.compile()` puts in place of :func:`control.ilqr.optimize`: the same plans, in C++.

A system's step is written down as arithmetic on single numbers (`recorder`, `places`, `rules`,
`scalars`). That becomes C++ with its exact derivatives (`source`), is compiled together with
iterative LQR (`ilqr.cpp`, `lanes.h`), and is kept on disk (`library`). `program` has it made and
watches whether the system is still the same (`watch`); `run` hands a problem over.

One library serves every horizon, all weights and bounds, and batches of any size; a single plan has
one of its own. Nothing else is generated, so everything that a plan depends on is either in the
C++ text, under which a library is kept, or handed over with every call.

It holds that every plan is the core's, sweep by sweep, to rounding. On first use the compiled step
is compared with the system's; and where a derivative or a rollout is not finite the core is asked,
which says what is wrong.
"""

import warnings

import torch
from torch import Tensor

from ..control.ilqr import SWEEPS, optimize
from ..control.iterate import Solution
from ..control.problem import Problem
from .library import compiler
from .program import Program
from .run import Run

TESTED = (2, 4), (2, 14)  # the oldest and the newest torch


class CompiledOptimizer:
    """Finds the plans that :func:`control.ilqr.optimize` finds, in compiled code.

    With a torch that is newer or older than those that it was tested with it warns, once, and
    leaves the plans to the core.

    Raises:
        RuntimeError: where there is no C++ compiler.
    """

    def __init__(self) -> None:
        compiler()
        self.programs: dict[tuple, Program] = {}
        version = tuple(int(part) for part in torch.__version__.split(".")[:2])
        self.usable = TESTED[0] <= version <= TESTED[1]
        if not self.usable:
            oldest, newest = (".".join(map(str, tested)) for tested in TESTED)
            warnings.warn(
                f"compile: tested with torch {oldest} to {newest}, not with {torch.__version__}: "
                "plans are made without compiling",
                stacklevel=3,
            )

    def __reduce__(self) -> tuple:
        """A copy plans for another system, so it begins anew; what is on disk makes that quick."""
        return type(self), ()

    @torch.no_grad()
    def __call__(self, problem: Problem, x_init: Tensor, U: Tensor, stepper=None) -> Solution:
        """Returns the plan that sweeps from U lead to.

        Args:
            problem: its tensors have a batch dimension for each of the plan's.
            x_init: ``(..., n)``.
            U: inputs to start from, ``(T, ..., m)``.
            stepper: may stop earlier; it is told how much cost the latest sweep hoped to gain.

        Raises:
            RuntimeError: where the system cannot be compiled, or not faithfully.
            ValueError: where the rollout of U diverges, and the regulator cannot prevent it.
        """
        if not self.usable or not U.numel():
            return optimize(problem, x_init, U, stepper)
        run = Run(self._program(problem, x_init, U), problem, x_init, U)
        history = run.sweep(SWEEPS) if stepper is None else run.follow(stepper)
        if run.strange.any():
            return optimize(problem, x_init, U, stepper)
        return run.solution(history)

    def _program(self, problem: Problem, x_init: Tensor, U: Tensor) -> Program:
        """Returns the system's code, made anew where the system has changed."""
        key = problem.system, U.dtype, U.device
        program = self.programs.get(key)
        if program is None or program.has_changed():
            program = Program(problem.system, x_init.shape[-1], U.shape[-1], U.dtype, U.device)
        many = U.shape[1:-1].numel() > 1
        if many not in program.compared:
            x = x_init.reshape(-1, x_init.shape[-1])[0]
            program.compare(many, x, U.reshape(len(U), -1, U.shape[-1])[:, 0], problem.t)
        self.programs[key] = program
        return program
