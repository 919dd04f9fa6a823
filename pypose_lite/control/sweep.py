"""One sweep of iterative LQR: a model along a plan, the best gains for it, a walk along them.

The order and the letters are those of the sweep that chapter 3 writes by hand. `ilqr.py` repeats
it, and `verdict.py` says what follows from how it went. Sequences have time first, ``(T, ..., n)``.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from ..linalg import bmv
from .iterate import Iterate
from .problem import Problem
from .riccati import riccati

SHORTER = (0.5, 0.2, 0.05)  # step lengths, tried where the full one does not help


class Sweep(NamedTuple):
    """Where a sweep has led, and what it had hoped for."""

    X: Tensor  # states, (T+1, ..., n)
    U: Tensor  # inputs, (T, ..., m)
    K: Tensor  # gains, (T, ..., m, n)
    cost: Tensor  # of the new plan, (...)
    change: Tensor  # of the cost, as the model promised it, <= 0
    size: Tensor  # of the proposed change of U, relative to U
    failed: Tensor  # whether the model had no minimum: then nothing moves
    helped: Tensor  # whether the new plan is better


def sweep(problem: Problem, at: Iterate, newton: bool) -> Sweep:
    """Returns where one sweep from the plan ``at`` leads.

    Args:
        problem: its tensors have a batch dimension for each of the plan's.
        at: the plan to improve.
        newton: whether the members of which ``at.exact`` is True get Newton's model of the
            dynamics; the others always get Gauss-Newton's.
    """
    A, B, q, Q = model(problem, at, newton)  # 1. a model along the plan
    last = problem.last_cost_to_go(at.X)  # 2. Riccati, from the end
    K, k, change, failed = riccati(last, Q, q, A, B, problem.box(at.U))
    failed = failed.any(0)
    K = torch.where(failed[..., None, None], at.K, K)
    k = torch.where(failed[..., None], 0, k)
    change = torch.where(failed, 0, change)
    X, U, cost, helped = line_search(problem, at, K, k, change)  # 3. along the gains
    size = k.abs().amax((0, -1)) / (1 + at.U.abs().amax((0, -1)))
    return Sweep(X, U, K, cost, change, size, failed, helped)


def model(problem: Problem, at: Iterate, newton: bool) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Returns the dynamics ``A, B`` along a plan, and slope q and curvature Q of each step's cost.

    Gauss-Newton takes f as linear. Newton adds its curvature, weighed by the costates ``l_t+1``,
    which say what a change of the next state does to the cost that is still to come:

        Q_t = Q_t + sum_i l_t+1,i  d2 f_i / dz2                       (1)

    ``at.damping`` is added to the curvature in u (Levenberg, Marquardt).
    """
    x, t = at.X[:-1], problem.times(at.U)
    q, Q = problem.expand_cost(at.X, at.U)
    if newton:
        _, A, B, curvature = problem.system.expand_transition(x, at.U, t)
        l = costates(problem, at.X, A, B, q, at.K)
        Q = Q + torch.where(at.exact[..., None, None], curvature(l), 0)  # (1)
    else:
        _, A, B = problem.system.linearize_transition(x, at.U, t)
    on_u = torch.arange(Q.shape[-1], device=Q.device) >= at.X.shape[-1]
    return A, B, q, Q + torch.diag_embed(at.damping[..., None] * on_u)


def costates(problem: Problem, X: Tensor, A: Tensor, B: Tensor, q: Tensor, K: Tensor) -> Tensor:
    """Returns ``l_1 .. l_T (T, ..., n)``: how the cost to come changes with each state.

    The inputs react by ``K (x - X)``, as they do when the plan is driven. On an unstable system
    the same recursion without K would grow beyond all bounds; at a solution, where the cost has no
    slope in the inputs that may react, both are the same.

        l_t = q_x + K' q_u + (A + B K)' l_t+1                         (1)
    """
    n = A.shape[-1]
    l = [problem.last_cost_to_go(X).v]
    for t in reversed(range(1, len(A))):
        own = q[t, ..., :n] + bmv(K[t].mT, q[t, ..., n:])
        l.append(own + bmv((A[t] + B[t] @ K[t]).mT, l[-1]))  # (1)
    return torch.stack(torch.broadcast_tensors(*reversed(l)))


def line_search(
    problem: Problem, at: Iterate, K: Tensor, k: Tensor, change: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Returns states, inputs and cost after one step along the gains, and whether it helped.

    The full step is taken where it keeps a small part of the change that was promised, else the
    best of several shorter ones, else none.
    """
    rounding = 8 * torch.finfo(at.cost.dtype).eps * at.cost.abs()
    X, U, cost = priced(problem, *follow(problem, at.X[0], at.X, at.U, K, k))
    helped = cost <= at.cost + torch.maximum(1e-4 * change, -rounding) + rounding
    if not helped.all():
        best = at.X, at.U, at.cost
        for length in SHORTER:
            plan = priced(problem, *follow(problem, at.X[0], at.X, at.U, K, length * k))
            best = choose(plan[2] < best[2], plan, best)
        X, U, cost = choose(helped, (X, U, cost), best)
        helped = helped | (cost < at.cost)
    return X, U, cost, helped


def follow(
    problem: Problem, x_init: Tensor, X: Tensor, U: Tensor, K: Tensor, k: Tensor
) -> tuple[Tensor, Tensor]:
    """Returns the states and the inputs of ``u = U + k + K (x - X)``, kept within the bounds."""
    bounds, aim = problem.bounds(U), U + k
    x, states, inputs = x_init, [x_init], []
    for i, t in enumerate(problem.t):
        u = aim[i] + bmv(K[i], x - X[i])
        u = u if bounds is None else torch.clamp(u, bounds[0][i], bounds[1][i])
        x = problem.system.transition(x, u, t)
        states.append(x)
        inputs.append(u)
    return torch.stack(torch.broadcast_tensors(*states)), torch.stack(inputs)


def regulator(problem: Problem, X: Tensor, U: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Returns the gains K and k of the LQR around states that need not follow from the inputs.

    Third comes where there are none, ``(T, ...)``. Gauss-Newton's model, differentiable.
    """
    f, A, B = problem.system.linearize_transition(X[:-1], U, problem.times(U))
    q, Q = problem.expand_cost(X, U)
    last = problem.last_cost_to_go(X)
    K, k, _, failed = riccati(last, Q, q, A, B, problem.box(U), defects=f - X[1:])
    return K, k, failed


def regulated(problem: Problem, x_init: Tensor, U: Tensor) -> tuple[Tensor, Tensor]:
    """Returns states and inputs that the regulator around standing still at x_init leads to.

    They stay bounded where the rollout of U explodes, as on an unstable system.
    """
    X = x_init.expand(len(U) + 1, *x_init.shape)
    K, k, _ = regulator(problem, X, U)
    return follow(problem, x_init, X, U, K, k)


def priced(problem: Problem, X: Tensor, U: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Returns states and inputs with their cost, infinite where it is not finite."""
    return X, U, problem.cost(X, U).nan_to_num(torch.inf, torch.inf, torch.inf)


def choose(mask: Tensor, these: tuple, those: tuple) -> tuple[Tensor, Tensor, Tensor]:
    """Returns states, inputs and cost of one or the other plan, for each member of a batch."""
    masks = mask[..., None], mask[..., None], mask
    X, U, cost = (torch.where(*choice) for choice in zip(masks, these, those))
    return X, U, cost
