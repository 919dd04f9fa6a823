"""Model predictive control: plan T steps ahead, take the first, plan again.

Chapter 3 builds it. `arguments.py` states the problem, `ilqr.py` repeats the sweeps of `sweep.py`,
each sweep is a Riccati pass (`riccati.py`), and `gradient.py` differentiates the plan.
"""

import copy
import warnings
from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from .arguments import OptimalControl
from .gradient import differentiable
from .ilqr import SWEEPS, optimize


class Plan(NamedTuple):
    """What :meth:`MPC.solve` returns."""

    x: Tensor  # states, (..., T+1, n)
    u: Tensor  # inputs, (..., T, m)
    cost: Tensor  # (...)
    converged: Tensor  # whether the cost has no slope left but out of the bounds, (...), bool
    iterations: Tensor  # how many sweeps it took, (...)
    history: Tensor  # the cost at the start and after each sweep, (sweeps + 1, ...)


class MPC(OptimalControl):
    """Returns the best states and inputs for the next T steps of any system; Q, p are weights.

        J = sum_t 1/2 (z_t - r)' Q_t (z_t - r) + p_t' z_t + 1/2 (x_T - r)' Qf (x_T - r) + pf' x_T

    with ``z = [x, u]`` and ``r = [target, u_target]``. It keeps nothing between calls. Gradients of
    the plan are exact, by the implicit function theorem, where it has converged; where it has not,
    a warning says so.

    Args:
        system: any :class:`System`; its clock says when a plan starts.
        Q: weights ``(n+m, n+m)`` to ``(..., T, n+m, n+m)``; see :class:`OptimalControl`.
        p: linear weights, or None.
        T: how many steps to plan.
        stepper: says when sweeps may stop early, such as ``utils.ReduceToBason(steps=10)``; it is
            told the cost that the latest sweep hoped to gain, and stays as it was. None goes on
            until the plan has converged, for 200 sweeps at most.
        Qf: weights of the state after the last step, or None; see :class:`OptimalControl`.
        pf: its linear weights, or None.

    Source: "PyPose v0.6", section III-B; Li, Todorov, "Iterative linear quadratic regulator
    design for nonlinear biological movement systems" (2004).
    """

    def __init__(self, system, Q, p, T, stepper=None, Qf=None, pf=None):
        super().__init__(system, Q, p, T, Qf, pf)
        self.stepper = stepper
        self._optimize: Callable = optimize

    def forward(
        self,
        dt,
        x_init,
        target=None,
        u_init=None,
        u_lower=None,
        u_upper=None,
        du=None,
        u_target=None,
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Returns ``x (..., T+1, n)``, ``u (..., T, m)`` and ``cost (...)``; see :meth:`solve`."""
        return self.solve(dt, x_init, target, u_init, u_lower, u_upper, du, u_target)[:3]

    def solve(
        self,
        dt,
        x_init,
        target=None,
        u_init=None,
        u_lower=None,
        u_upper=None,
        du=None,
        u_target=None,
    ) -> Plan:
        """Returns the plan, and whether and how it converged.

        Warns where 200 sweeps were not enough; a stepper may end them earlier without a word.

        Args:
            dt: seconds a step takes; only compared with that of a system that states its own,
                since time is counted in steps.
            x_init: ``(..., n)``.
            target: the state to reach, ``(..., n)``, or one for each step: a dimension more than
                x_init, ``(..., T, n)``, or ``(..., T+1, n)`` with that of the last state.
            u_init: inputs to start from, ``(..., T, m)``, such as :func:`shift` of the last plan.
            u_lower: lower bound of u: a number, ``(m,)`` or ``(..., T, m)``; may be infinite.
            u_upper: upper bound of u.
            du: how far one sweep may change u.
            u_target: what the inputs should be, such as the thrust that hovers: ``(..., m)`` or
                ``(..., T, m)``; zero where None.

        Raises:
            ValueError: for arguments that do not fit, or a rollout of u_init that diverges.
        """
        problem, x_init, U, graph = self._state(
            x_init, dt, u_init, u_lower, u_upper, du, target, u_target
        )
        solution = self._optimize(problem, x_init, U, self._fresh_stepper())
        if graph and torch.is_grad_enabled():
            solution = differentiable(problem, x_init, solution)
        elif not solution.converged.all() and (solution.iterations >= SWEEPS).any():
            count = int((~solution.converged).sum())
            warnings.warn(f"{count} plans have not converged in {SWEEPS} sweeps", stacklevel=2)
        X, U, cost = solution.X, solution.U, solution.cost
        rest = solution.converged, solution.iterations, solution.history
        return Plan(X.movedim(0, -2), U.movedim(0, -2), cost, *rest)

    def compile(self) -> None:
        """Makes later plans many times faster: they are made by compiled code, kept on disk.

        Plans and gradients stay the same. The first plan takes a few seconds, and so does the first
        batch; another process, another horizon, other weights, bounds or numbers of the system take
        next to nothing. What the system keeps may change at any time.

        Raises:
            RuntimeError: where there is no C++ compiler (g++ or clang++); and at the next plan,
                where the system cannot be compiled: its functions branch on a state, leave torch,
                or use an operation that the engine has no rule for.
        """
        from ..compiled import CompiledOptimizer

        self._optimize = CompiledOptimizer()

    def _fresh_stepper(self):
        stepper = copy.deepcopy(self.stepper)
        if stepper is not None:
            stepper.reset()
        return stepper


def shift(u: Tensor) -> Tensor:
    """Returns a plan's inputs ``(..., T, m)`` one step later: the next plan's warm start."""
    return torch.cat([u[..., 1:, :], u[..., -1:, :]], dim=-2).detach()
