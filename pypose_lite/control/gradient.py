"""The gradient of a plan: how the best inputs move when the problem does.

At a solution the slope of the total cost vanishes, ``g(u, theta) = dJ/du = 0`` in the free
inputs. Differentiating that (the implicit function theorem), with H the exact Hessian of J:

    du/dtheta = - H^-1 dg/dtheta                                      (1)

Neither H nor the iterations that led here are recorded: H^-1 is one Riccati run in the backward
pass. A clamped input moves with its bound and with nothing else. Chapter 8 uses it.

Source: Amos et al., "Differentiable MPC for end-to-end planning and control" (2018), with the
exact Hessian in place of Gauss-Newton's.
"""

import warnings
from typing import Any

import torch
from torch import Tensor
from torch.autograd import Function
from torch.autograd.function import once_differentiable

from ..linalg import bmv
from .ilqr import Solution
from .problem import Problem, rollout
from .riccati import homogeneous_cost, homogeneous_dynamics, riccati
from .sweep import costates, model, newton_model


def differentiable(problem: Problem, x_init: Tensor, solution: Solution) -> Solution:
    """Returns the same solution with a graph to x_init and to whatever made the problem.

    Warns where sweeps were ended before the slope vanished: (1) holds at solutions only.
    """
    X, U = solution.X, solution.U
    with torch.no_grad():
        _, A, B, q, *_ = model(problem, X[:-1], U, problem.times(U))
        now, later = q[..., : U.shape[-1]], bmv(B.mT, costates(A, q))
        push = now + later
        low = torch.zeros_like(U) if problem.lower is None else (U <= problem.lower) & (push > 0)
        high = torch.zeros_like(U) if problem.upper is None else (U >= problem.upper) & (push < 0)
        clamped = low.bool() | high.bool()
        small = torch.finfo(U.dtype).eps ** 0.5 * (now.abs() + later.abs()).amax(0)
        _warn(~solution.converged & ((push.abs() > small) & ~clamped).any(0).any(-1))
    with torch.enable_grad():
        U = U.detach().requires_grad_()
        U = U if problem.lower is None else torch.where(low, problem.lower, U)
        U = U if problem.upper is None else torch.where(high, problem.upper, U)
        cost = problem.cost(rollout(problem, x_init, U), U)
        (g,) = torch.autograd.grad(cost.sum(), U, create_graph=True)
        U = _Implicit.apply(U, g, problem, solution.X, clamped)
        X = rollout(problem, x_init, U)
        return solution._replace(X=X, U=U, cost=problem.cost(X, U))


def _warn(wrong: Tensor) -> None:
    if wrong.any():
        count = int(wrong.sum())
        warnings.warn(
            f"{count} plans have not converged: their gradients are not exact", stacklevel=4
        )


class _Implicit(Function):
    """The inputs, with the gradient (1) to the slope g."""

    @staticmethod
    def forward(ctx: Any, U, g, problem, X, clamped):
        ctx.problem = problem
        ctx.save_for_backward(X, U, clamped)
        return U.clone()

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, v: Tensor):
        X, U, clamped = ctx.saved_tensors
        to_g = newton_step(ctx.problem, X, U, torch.where(clamped, 0, v), clamped)  # (1)
        return v, to_g, None, None, None


@torch.no_grad()
def newton_step(problem: Problem, X: Tensor, U: Tensor, v: Tensor, clamped: Tensor) -> Tensor:
    """Returns ``-H^-1 v (T, ..., m)`` for the exact Hessian H in the inputs that are free.

    It is an LQR around the plan whose only slope is v.

    Raises:
        RuntimeError: where H is not positive definite: the plan is no strict minimum.
    """
    x, t = X[:-1], problem.times(U)
    _, A, B, q, Q, curve = newton_model(problem, x, U, t)
    Q = Q + curve(costates(A, q))
    none = torch.zeros_like(q[..., U.shape[-1] :])
    box = (torch.where(clamped, 0.0, -torch.inf).to(v), torch.where(clamped, 0.0, torch.inf).to(v))
    M = homogeneous_cost(Q, torch.cat([v, none], dim=-1))
    K, _, failed = riccati(M, homogeneous_dynamics(A, B), box)
    if failed.any():
        raise RuntimeError("the plan is no strict minimum of its cost, so it has no gradient")
    x, steps = torch.zeros_like(X[0]), []
    for k, a, b in zip(K, A, B):
        steps.append(bmv(k[..., :-1], x) + k[..., -1])
        x = bmv(a, x) + bmv(b, steps[-1])
    return torch.stack(steps)
