"""The gradient of a plan: how the best inputs move when the problem does.

At a solution the slope of the total cost vanishes, ``g(w, theta) = dJ/dw = 0`` in the free
inputs (the stationarity condition). Differentiating that by the implicit function theorem, with H
the exact Hessian of J:

    dw/dtheta = - H^-1 dg/dtheta                                      (1)

Here w is what is added to the plan while it is driven, ``u = U + w + K (x - X)``, with the plan's
own gains. Without K the same derivatives would be those of an open loop, which on an unstable
system are nothing but rounding. Neither H nor the sweeps that led here are recorded: H^-1 is one
more Riccati pass, in the backward pass. A clamped input moves with its bound and with nothing else.
`MPC` and the bounded `LQR` call :func:`differentiable`; chapter 8 derives it from a small example.

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
from .iterate import Iterate, Solution
from .problem import Problem
from .riccati import CostToGo, riccati
from .sweep import costates, follow, model


def differentiable(problem: Problem, x_init: Tensor, solution: Solution) -> Solution:
    """Returns the same solution with a graph to x_init and to whatever made the problem.

    Warns where sweeps were ended before the slope vanished: (1) holds at solutions only.
    """
    X, U = solution.X, solution.U
    low, high = _clamped(problem, solution)
    clamped = low | high
    K = torch.where(clamped[..., None], 0, solution.K)
    free = problem._replace(lower=None, upper=None, du=None)
    with torch.enable_grad():
        U = U if problem.lower is None else torch.where(low, problem.lower, U)
        U = U if problem.upper is None else torch.where(high, problem.upper, U)
        w = torch.zeros_like(U, requires_grad=True)
        cost = problem.cost(*follow(free, x_init, X, U, K, w))
        (g,) = torch.autograd.grad(cost.sum(), w, create_graph=True)
        w = _Implicit.apply(w, g, problem, solution._replace(K=K), clamped)
        X, U = follow(free, x_init, X, U, K, w)
        return solution._replace(X=X, U=U, cost=problem.cost(X, U))


@torch.no_grad()
def _clamped(problem: Problem, solution: Solution) -> tuple[Tensor, Tensor]:
    """Returns which inputs are pushed outward at their lower, and at their upper bound."""
    X, U = solution.X, solution.U
    none = torch.zeros_like(U, dtype=torch.bool)
    A, B, q, _ = model(problem, Iterate.first(X, U, solution.cost), newton=False)
    now = q[..., X.shape[-1] :]
    later = bmv(B.mT, costates(problem, X, A, B, q, solution.K))
    push = now + later
    low = none if problem.lower is None else (U <= problem.lower) & (push > 0)
    high = none if problem.upper is None else (U >= problem.upper) & (push < 0)
    small = torch.finfo(U.dtype).eps ** 0.5 * (now.abs() + later.abs()).amax(0)
    sloping = ((push.abs() > small) & ~low & ~high).any(0).any(-1)
    count = int((~solution.converged & sloping).sum())
    if count:
        message = f"{count} plans have not converged: their gradients are not exact"
        warnings.warn(message, stacklevel=5)
    return low, high


class _Implicit(Function):
    """What is added to the inputs, with the gradient (1) to the slope g."""

    @staticmethod
    def forward(ctx: Any, w, g, problem, solution, clamped):
        ctx.problem, ctx.solution = problem, solution
        ctx.save_for_backward(clamped)
        return w.clone()

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, v: Tensor):
        (clamped,) = ctx.saved_tensors
        v = torch.where(clamped, 0, v)
        return v, newton_step(ctx.problem, ctx.solution, v, clamped), None, None, None  # (1)


@torch.no_grad()
def newton_step(problem: Problem, solution: Solution, v: Tensor, clamped: Tensor) -> Tensor:
    """Returns ``-H^-1 v (T, ..., m)`` for the exact Hessian H in the inputs that are free.

    It is an LQR around the plan whose only slope is v, and that in ``w = du - K dx``.

    Raises:
        RuntimeError: where H is not positive definite: the plan is no strict minimum.
    """
    X, U, K = solution.X, solution.U, solution.K
    at = Iterate.first(X, U, solution.cost)._replace(K=K)
    at = at._replace(exact=torch.ones_like(at.exact))
    A, B, _, Q = model(problem, at, newton=True)
    last = problem.last_cost_to_go(X)
    last = CostToGo(last.V, torch.zeros_like(last.v), last.c)
    slope = torch.cat([-bmv(K.mT, v), v], -1)
    infinite = torch.full_like(v, torch.inf)
    box = torch.where(clamped, 0, -infinite), torch.where(clamped, 0, infinite)
    gains, offsets, _, failed = riccati(last, Q, slope, A, B, box)
    if failed.any():
        raise RuntimeError("the plan is no strict minimum of its cost, so it has no gradient")
    dx, steps = torch.zeros_like(X[0]), []
    for t in range(len(U)):
        du = bmv(gains[t], dx) + offsets[t]
        steps.append(du - bmv(K[t], dx))
        dx = bmv(A[t], dx) + bmv(B[t], du)
    return torch.stack(steps)
