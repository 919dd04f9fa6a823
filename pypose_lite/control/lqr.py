"""The linear quadratic regulator: the best inputs over T steps, in one sweep.

Chapter 2 builds it from the Riccati step of `riccati.py`.
"""

import warnings

import torch
from torch import Tensor

from ..shapes import has_numbers
from ..systems import LTI
from .arguments import OptimalControl
from .gradient import differentiable
from .ilqr import optimize
from .problem import Problem, refuse_divergence, rollout
from .sweep import follow, regulator


class LQR(OptimalControl):
    """Returns the states, inputs and cost that minimise a quadratic cost; Q, p are weights.

        J = sum_t 1/2 (z_t - r)' Q_t (z_t - r) + p_t' z_t + 1/2 (x_T - r)' Qf (x_T - r) + pf' x_T

    with ``z = [x, u]`` and t = 0 .. T-1. A linear system is solved exactly. Around a nonlinear one
    this is one Gauss-Newton sweep from ``u_traj``, returned with the states it really leads to.
    With bounds, sweeps go on until they hold and nothing better is left. The plan starts at the
    system's current time.

    See :class:`OptimalControl` for the arguments of the constructor.

    Source: Boyd, EE363 lecture 1, "Linear quadratic regulator: discrete-time finite horizon";
    the signature is PyPose's.
    """

    inputs = "u_traj"

    def forward(
        self,
        x_init,
        dt=None,
        u_traj=None,
        u_lower=None,
        u_upper=None,
        du=None,
        target=None,
        u_target=None,
    ):
        """Returns ``x (..., T+1, n)``, ``u (..., T, m)`` and ``cost (...)``.

        Args:
            x_init: ``(..., n)``.
            dt: seconds a step takes; only compared with that of a system that states its own,
                since time is counted in steps.
            u_traj: inputs to linearise around, ``(..., T, m)``; zeros where None.
            u_lower: lower bound of u: a number, ``(m,)`` or ``(..., T, m)``; may be infinite.
            u_upper: upper bound of u.
            du: how far u may move from ``u_traj``.
            target: the r of states, ``(..., n)`` or one for each step, ``(..., T, n)``; zero
                where None.
            u_target: the r of inputs, ``(..., m)`` or ``(..., T, m)``; zero where None.

        Raises:
            ValueError: for arguments that do not fit, a rollout that diverges, or a cost that has
                no minimum.
        """
        problem, x_init, U, graph = self._state(
            x_init, dt, u_traj, u_lower, u_upper, du, target, u_target
        )
        U = problem.clamp(U)
        if problem.box(U) is None:
            X, U, cost = _regulate(problem, x_init, U)
        else:
            problem = problem.within_du_of(U)
            solution = optimize(problem, x_init, U)
            if not solution.converged.all():
                warnings.warn("the bounded plan has not converged in 200 sweeps", stacklevel=2)
            if graph and torch.is_grad_enabled():
                solution = differentiable(problem, x_init, solution)
            X, U, cost = solution.X, solution.U, solution.cost
        return X.movedim(0, -2), U.movedim(0, -2), cost

    def lqr_backward(
        self, x_init, dt=None, u_traj=None, target=None, u_target=None
    ) -> tuple[Tensor, Tensor]:
        """Returns the gains ``K (..., T, m, n)`` and ``k (..., T, m)`` around ``u_traj``.

        The plan is ``u = u_traj + K (x - x_traj) + k``, where ``x_traj`` follows from ``u_traj``;
        for a linear system ``x_traj`` and ``u_traj`` are zero, so that ``u = K x + k``.
        """
        stated = self._state(x_init, dt, u_traj, None, None, None, target, u_target)
        X, U = _nominal(stated.problem, stated.x_init, stated.U)
        K, k = _gains(stated.problem, X, U)
        return K.movedim(0, -3), k.movedim(0, -2)


def _regulate(problem: Problem, x_init: Tensor, U: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Returns states, inputs and cost of one sweep without bounds."""
    X, U = _nominal(problem, x_init, U)
    new = _swept(problem, x_init, X, U)
    swamped = _swamped(X, new[0])
    if has_numbers(swamped) and swamped.any():
        new = _swept(problem, x_init, torch.where(swamped[..., None], x_init, X), U)
    cost = problem.cost(*new)
    refuse_divergence(X, cost)
    return *new, cost


def _swept(problem: Problem, x_init: Tensor, X: Tensor, U: Tensor) -> tuple[Tensor, Tensor]:
    return follow(problem, x_init, X, U, *_gains(problem, X, U))


def _nominal(problem: Problem, x_init: Tensor, U: Tensor) -> tuple[Tensor, Tensor]:
    """Returns states and inputs to linearise around: zeros where any do, else a rollout."""
    if isinstance(problem.system, LTI):  # an unstable rollout would cost digits
        return x_init.new_zeros(len(problem.t) + 1, *x_init.shape), torch.zeros_like(U)
    return rollout(problem, x_init, U), U


def _swamped(X: Tensor, new: Tensor) -> Tensor:
    """Returns whether states to linearise around are so large that a plan drowns in rounding.

    A rollout on an unstable system explodes. The plan is then the small difference of huge
    numbers, and has to be found around x_init instead.
    """
    eps, tiny = torch.finfo(X.dtype).eps, torch.finfo(X.dtype).tiny
    size, useful = (z.detach().abs().amax((0, -1)) for z in (X, new))
    return ~(size <= useful.clamp(min=tiny) / eps ** (1 / 3))


def _gains(problem: Problem, X: Tensor, U: Tensor) -> tuple[Tensor, Tensor]:
    """Returns the regulator's gains around states that are finite, else around the first one.

    Raises:
        ValueError: where the cost has no minimum.
    """
    finite = torch.isfinite(X).all(0).all(-1)
    K, k, failed = regulator(problem, torch.where(finite[..., None], X, X[0]), U)
    if has_numbers(failed) and failed.any():
        refuse_divergence(X, problem.cost(X, U))
        step = int(failed.reshape(len(failed), -1).any(-1).nonzero()[-1])
        raise ValueError(f"Q: the cost has no minimum, its curvature in u is not > 0 at t={step}")
    return K, k
