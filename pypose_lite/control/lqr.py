"""The linear quadratic regulator: the best inputs over T steps, in one sweep.

Chapter 2 builds it from the Riccati step of `riccati.py`.
"""

import warnings

import torch
from torch import Tensor

from ..systems import LTI
from .gradient import differentiable
from .ilqr import optimize, refuse_divergence
from .problem import OptimalControl, Problem, rollout
from .riccati import homogeneous_cost, homogeneous_dynamics, riccati
from .sweep import follow, model


class LQR(OptimalControl):
    """Returns the states, inputs and cost that minimise a quadratic cost; Q, p are weights.

        J = sum_t 1/2 z_t' Q_t z_t + p_t' z_t,    z = [x, u],    t = 0 .. T-1

    A linear system is solved exactly. Around a nonlinear one this is one Gauss-Newton sweep from
    ``u_traj``, returned with the states it really leads to. With bounds, sweeps go on until they
    hold and nothing better is left. The plan starts at the system's current time.

    See :class:`OptimalControl` for the arguments of the constructor.

    Source: Boyd, EE363 lecture 1, "Linear quadratic regulator: discrete-time finite horizon";
    the signature is PyPose's.
    """

    start = "u_traj"

    def forward(self, x_init, dt=None, u_traj=None, u_lower=None, u_upper=None, du=None):
        """Returns ``x (..., T+1, n)``, ``u (..., T, m)`` and ``cost (...)``.

        Args:
            x_init: ``(..., n)``.
            dt: seconds a step takes; only compared with that of a system that states its own,
                since time is counted in steps.
            u_traj: inputs to linearise around, ``(..., T, m)``; zeros where None.
            u_lower: lower bound of u: a number, ``(m,)`` or ``(..., T, m)``; may be infinite.
            u_upper: upper bound of u.
            du: how far u may move from ``u_traj``.

        Raises:
            ValueError: for arguments that do not fit, a rollout that diverges, or a cost that has
                no minimum.
        """
        problem, x_init, U, graph = self._pose(x_init, dt, u_traj, u_lower, u_upper, du)
        U = problem.clip(U)
        if problem.box(U) is None:
            X, U = _nominal(problem, x_init, U)
            X, U = follow(problem, x_init, X, U, _gains(problem, X, U))
            cost = problem.cost(X, U)
            refuse_divergence(X, cost)
        else:
            problem = problem.near(U)
            solution = optimize(problem, x_init, U)
            if not solution.converged.all():
                warnings.warn("the bounded plan has not converged in 200 sweeps", stacklevel=2)
            if graph and torch.is_grad_enabled():
                solution = differentiable(problem, x_init, solution)
            X, U, cost = solution.X, solution.U, solution.cost
        return X.movedim(0, -2), U.movedim(0, -2), cost

    def lqr_backward(self, x_init, dt=None, u_traj=None) -> tuple[Tensor, Tensor]:
        """Returns the gains ``K (..., T, m, n)`` and ``k (..., T, m)`` around ``u_traj``.

        The plan is ``u = u_traj + K (x - x_traj) + k``, where ``x_traj`` follows from ``u_traj``;
        for a linear system ``x_traj`` and ``u_traj`` are zero, so that ``u = K x + k``.
        """
        problem, x_init, U, _ = self._pose(x_init, dt, u_traj, None, None, None)
        gains = _gains(problem, *_nominal(problem, x_init, U)).movedim(0, -3)
        return gains[..., :-1], gains[..., -1]


def _nominal(problem: Problem, x_init: Tensor, U: Tensor) -> tuple[Tensor, Tensor]:
    """Returns states and inputs to linearise around: zeros where any do, else a rollout."""
    if isinstance(problem.system, LTI):  # an unstable rollout would cost digits
        zeros = x_init.new_zeros(len(problem.t) + 1, *x_init.shape)
        return zeros, torch.zeros_like(U)
    X = rollout(problem, x_init, U)
    refuse_divergence(X, problem.cost(X, U))
    return X, U


def _gains(problem: Problem, X: Tensor, U: Tensor) -> Tensor:
    """Returns ``K (T, ..., m, n+1)`` around states that need not follow from the inputs."""
    f, A, B, q, Q, _ = model(problem, X[:-1], U, problem.times(U))
    G = homogeneous_dynamics(A, B, f - X[1:])
    K, _, failed = riccati(homogeneous_cost(Q, q), G)
    if failed.any():
        step = int(failed.reshape(len(failed), -1).any(-1).nonzero()[-1])
        raise ValueError(f"Q: the cost has no minimum, its curvature in u is not > 0 at t={step}")
    return K
