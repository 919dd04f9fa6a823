"""One sweep of iterative LQR: a model around a plan, the best gains for it, a walk along them.

Sequences have time first, ``(T, ..., n)``. Chapter 3 builds the sweep; `ilqr.py` repeats it.
"""

import torch
from torch import Tensor

from ..linalg import bmv
from .problem import Problem
from .riccati import homogeneous_cost, homogeneous_dynamics, riccati

SHORTER = torch.tensor([0.5, 0.2, 0.05])  # lengths, tried where the full one does not help


def model(problem: Problem, x: Tensor, u: Tensor, t: Tensor) -> tuple:
    """Returns ``f, A, B``, the slope ``q`` and curvature ``Q`` of the cost around a plan, and None.

    Of one step, or of all: x, u, t and the problem's tensors are those of the same steps.
    """
    return *problem.system.linearize_transition(x, u, t), *problem.expand_cost(x, u), None


def newton_model(problem: Problem, x: Tensor, u: Tensor, t: Tensor) -> tuple:
    """Returns :func:`model`, without a graph; its last result says what the dynamics add to Q.

    It is a function of the costates ``l (..., n)`` and makes Newton's model of Gauss-Newton's:

        l_t = dc_t/dx + A_t' l_t+1                                    (1)
        sum_i l_t+1,i  d2 f_i / d[u, x]2                              (2)
    """
    f, A, B, curve = problem.system.expand_transition(x, u, t)
    m = u.shape[-1]
    return f, A, B, *problem.expand_cost(x, u), lambda l: curve(l).roll((m, m), (-2, -1))  # (2)


def costates(A: Tensor, q: Tensor) -> Tensor:
    """Returns ``l_1 .. l_T (T, ..., n)``: what the cost to come gains by a change of x_t+1."""
    n = A.shape[-1]
    l = [torch.zeros_like(A[0, ..., 0] + q[0, ..., -n:])]
    for t in reversed(range(1, len(A))):
        l.append(q[t, ..., -n:] + bmv(A[t].mT, l[-1]))  # (1)
    return torch.stack(l[::-1])


def sweep(problem: Problem, X: Tensor, U: Tensor, damping: Tensor, exact: Tensor | None):
    """Returns gains ``(T, ..., m, n+1)``, the change of cost that they promise, what failed.

    Where ``exact (...)`` is True the model is Newton's, else Gauss-Newton's. A model without a
    minimum has failed. ``damping (...)`` is added to its curvature in u (Levenberg, Marquardt).
    """
    x, m, t = X[:-1], U.shape[-1], problem.times(U)
    _, A, B, q, Q, curve = (model if exact is None else newton_model)(problem, x, U, t)
    if exact is not None:
        Q = Q + torch.where(exact[..., None, None], curve(costates(A, q)), 0)
    on_u = torch.arange(Q.shape[-1], device=Q.device) < m
    Q = Q + torch.diag_embed(damping[..., None] * on_u)
    K, V, failed = riccati(homogeneous_cost(Q, q), homogeneous_dynamics(A, B), problem.box(U))
    return K, V[..., -1, -1] / 2, failed.any(0)


def follow(problem: Problem, x_init, X: Tensor, U: Tensor, K: Tensor, steps: Tensor | None = None):
    """Returns states and inputs of ``u = U + k + K (x - X)``, kept within the box.

    Several ``steps (S,)`` scale k and are tried at once; they add a dimension after time.
    """
    limits: list[Tensor] = list(problem.limits(U) or ())
    t = problem.times(U)
    if steps is not None:
        X, U, K, t, *limits = (z.unsqueeze(1) for z in (X, U, K, t, *limits))
        x_init = x_init.expand(steps.shape[0], *x_init.shape)
        steps = steps.reshape(-1, *[1] * (U.ndim - 2))
    k, K = K[..., -1], K[..., :-1]
    aim = U + (k if steps is None else steps * k)

    x, states, inputs = x_init, [x_init], []
    for i in range(len(aim)):
        u = aim[i] + bmv(K[i], x - X[i])
        u = torch.clamp(u, *(limit[i] for limit in limits)) if limits else u
        x = problem.system.transition(x, u, t[i].reshape(()))
        states.append(x)
        inputs.append(u)
    return torch.stack(states), torch.stack(inputs)


def search(problem: Problem, X, U, cost: Tensor, K: Tensor, promised: Tensor):
    """Returns the trajectory after one step along the gains, its cost, and whether it helped.

    The full step is taken where it keeps a small part of its promise; else the best of several
    shorter ones; else none. They are tried where the full one does not help, or always while torch
    compiles, as that cannot look. With ``step (...)`` only that length is tried.
    """
    rounding = 8 * torch.finfo(cost.dtype).eps * cost.abs()
    full = follow(problem, X[0], X, U, K)
    new = (*full, _or_infinite(problem.cost(*full)))
    helped = new[-1] <= cost + torch.maximum(1e-4 * promised, -rounding) + rounding
    if not helped.all():
        best = _best(problem, *follow(problem, X[0], X, U, K, SHORTER.to(U)))
        new = _where(helped, new, best)
        helped = helped | (best[-1] < cost)
    return (*_where(helped, new, (X, U, cost)), helped)


def _best(problem: Problem, Xs: Tensor, Us: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Returns the cheapest of trajectories ``(T+1, S, ..., n)``, and its cost."""
    costs = torch.stack([problem.cost(Xs[:, i], Us[:, i]) for i in range(Xs.shape[1])])
    cost, best = _or_infinite(costs).min(0)
    pick = best.expand(1, 1, *best.shape)[..., None]
    return Xs.take_along_dim(pick, 1)[:, 0], Us.take_along_dim(pick, 1)[:, 0], cost


def _where(mask: Tensor, these: tuple, those: tuple) -> tuple[Tensor, Tensor, Tensor]:
    """Returns states, inputs and cost of one or the other plan for each member of a batch."""
    masks = mask[..., None], mask[..., None], mask
    X, U, cost = (torch.where(*choice) for choice in zip(masks, these, those))
    return X, U, cost


def _or_infinite(cost: Tensor) -> Tensor:
    """Returns a cost that no plan can prefer where it is not finite."""
    return cost.nan_to_num(torch.inf, torch.inf, torch.inf)
