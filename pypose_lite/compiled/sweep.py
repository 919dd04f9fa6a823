"""One sweep of iterative LQR for torch's compiler: all that happens at a step is one loop's body.

The same plans as `control/sweep.py`, whose names and equations these functions bear.
"""

import torch
from torch import Tensor

from ..control.ilqr import Iterate, judge, same_bounds
from ..control.problem import Problem
from ..control.riccati import Box
from ..systems.derivatives import transformed, transformed_hessian
from ..systems.mapping import same_batch
from .loops import Steps
from .rows import bmm, bmv, cat, solve_positive

STEPS = torch.tensor([1.0, 0.5, 0.2, 0.05])


def model(problem: Problem, x: Tensor, u: Tensor, t: Tensor) -> tuple:
    """Returns ``f, A, B, q, Q`` and what the dynamics add to Q, a function of costates."""
    f, m = problem.system.mapped("state_transition", t, clock=False), u.shape[-1]
    x, u = same_batch(x, u)
    y, A, B = transformed(f, x, u, "xu")
    q = bmv(problem.Q, cat([u, x], -1, 1) - problem.r) + problem.p
    Q = problem.Q.expand(*q.shape, q.shape[-1])
    return y, A, B, q, Q, lambda l: transformed_hessian(f, x, u, l).roll((m, m), (-2, -1))


def cost(problem: Problem, X: Tensor, U: Tensor) -> Tensor:
    """Returns the total cost, as `Problem.cost` does."""
    z = torch.cat([U, X[:-1]], dim=-1)
    return ((z - problem.r) * bmv(problem.Q, z - problem.r) / 2 + problem.p * z).sum(-1).sum(0)


def earlier(l: Tensor, A: Tensor, q: Tensor) -> tuple[tuple[Tensor], tuple[Tensor]]:
    """Returns the costate one step earlier, and that of this step: the body of a loop."""
    return (q[..., -l.shape[-1] :] + bmv(A.mT, l),), (l,)  # (1)


def sweep(problem: Problem, X: Tensor, U: Tensor, damping: Tensor, exact: Tensor):
    """Returns gains ``(T, ..., m, n+1)``, the change of cost that they promise, what failed.

    Where ``exact (...)`` is True the model is Newton's, else Gauss-Newton's. A model without a
    minimum has failed. ``damping (...)`` is added to its curvature in u (Levenberg, Marquardt).
    """
    m, n, batch = U.shape[-1], X.shape[-1], X.shape[1:-1]
    l, V, zero = X.new_zeros(X.shape[1:]), X.new_zeros(*batch, n + 1, n + 1), X.new_zeros(batch)

    def modelled(x, u, t, Q, p, r, damping, exact, *box):  # the LQR around the plan
        here = problem._replace(Q=Q, p=p, r=r)
        _, A, B, q, Q, curve = model(here, x, u, t)
        on_u = (torch.arange(m + n, device=q.device) < m).to(q.dtype)
        Q = Q + torch.diag_embed(damping[..., None] * on_u)
        return A, q, B, Q, curve, exact, *box

    def curved(l, A, q, B, Q, curve, exact, *box):  # after the costates: Newton's model of it
        Q = Q + torch.where(exact[..., None, None] > 0, curve(l), 0)
        return A, q, B, Q, curve, exact, *box

    def homogeneous(A, q, B, Q, curve, exact, *box):
        return homogeneous_cost(Q, q), homogeneous_dynamics(A, B), *box

    def back(V, failed, M, G, *box):
        V, K, now = riccati_step(V, M, G, box or None)
        return (V, failed + now), (K,)

    given = X[:-1], U, problem.times(U), problem.Q, problem.p, problem.r
    flags = (z.expand(len(U), *batch) for z in (damping, exact.to(X)))
    steps = Steps((*given, *flags, *(problem.box(U) or ())), len(batch), reverse=True)
    steps = steps.map(modelled)
    steps = steps.accumulate(earlier, l, reads=2).map(curved)
    (V, failed), (K,) = steps.map(homogeneous).scan(back, V, zero)
    return K, V[..., -1, -1] / 2, failed > 0


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

    def move(x, t, K, X, aim, *limits):
        u = aim + bmv(K, x - X)
        u = torch.clamp(u, *limits) if limits else u
        f = problem.system.mapped("state_transition", t.reshape(()), clock=False)
        return (f(x, u),), (x, u)

    known = Steps((t, K, X[:-1], aim, *limits), U.ndim - 2)
    (last,), (states, inputs) = known.scan(move, x_init)
    return torch.cat([states, last[None]]), inputs


def search(problem: Problem, X, U, was: Tensor, K: Tensor, promised: Tensor, length=None):
    """Returns the trajectory after one step, its cost, and whether it helped.

    Steps of all lengths are tried, or, with ``length (...)``, only that one.
    """
    rounding = 8 * torch.finfo(was.dtype).eps * was.abs()
    if length is not None:
        K = cat([K[..., :-1], length[..., None, None] * K[..., -1:]], -1)
    tried = follow(problem, X[0], X, U, K, STEPS.to(U) if length is None else None)
    new = tuple(z[:, 0] for z in tried) if length is None else tried
    new = (*new, _or_infinite(cost(problem, *new)))
    helped = new[-1] <= was + torch.maximum(1e-4 * promised, -rounding) + rounding
    if length is not None:
        helped = torch.where(length < 1, new[-1] < was, helped)
    else:
        best = _best(problem, *(z[:, 1:] for z in tried))
        new = _where(helped, new, best)
        helped = helped | (best[-1] < was)
    return (*_where(helped, new, (X, U, was)), helped)


def _best(problem: Problem, Xs: Tensor, Us: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Returns the cheapest of trajectories ``(T+1, S, ..., n)``, and its cost."""
    costs = torch.stack([cost(problem, Xs[:, i], Us[:, i]) for i in range(Xs.shape[1])])
    least, best = _or_infinite(costs).min(0)
    pick = best.expand(1, 1, *best.shape)[..., None]
    return Xs.take_along_dim(pick, 1)[:, 0], Us.take_along_dim(pick, 1)[:, 0], least


def _where(mask: Tensor, these: tuple, those: tuple) -> tuple[Tensor, Tensor, Tensor]:
    """Returns states, inputs and cost of one or the other plan for each member of a batch."""
    masks = mask[..., None], mask[..., None], mask
    X, U, cost = (torch.where(*choice) for choice in zip(masks, these, those))
    return X, U, cost


def _or_infinite(cost: Tensor) -> Tensor:
    """Returns a cost that no plan can prefer where it is not finite."""
    return cost.nan_to_num(torch.inf, torch.inf, torch.inf)


def improve(problem: Problem, at: Iterate, newton: bool, length: Tensor | None = None) -> Iterate:
    """Returns the next iterate, as `ilqr.improve` does."""
    m, exact = at.U.shape[-1], at.exact
    K, gain, failed = sweep(problem, at.X, at.U, at.damping, exact)
    K, gain = torch.where(failed[..., None, None], 0, K), torch.where(failed, 0, gain)
    X, U, new, helped = search(problem, at.X, at.U, at.cost, K, gain, length)
    size = K[..., -1].abs().amax((0, -1)) / (1 + at.U.abs().amax((0, -1)))
    unit = torch.diagonal(problem.Q[..., :m, :m], 0, -2, -1).mean((0, -1))
    old, same = (at.cost, at.size, at.damping, exact), same_bounds(problem, at.U, U)
    judged = judge(*old, new, gain, failed, helped, size, unit, same)
    promised, size, damping, exact, converged = judged
    return Iterate(X, U, new, promised, size, damping, exact, converged, at.iterations + 1)


def homogeneous_dynamics(A: Tensor, B: Tensor, c: Tensor | None = None) -> Tensor:
    """Returns ``G (..., n+1, m+n+1)`` with ``[A x + B u + c, 1] = G [u, x, 1]``."""
    c = torch.zeros_like(A[..., 0]) if c is None else c
    top = cat([B, A, c.unsqueeze(-1)], -1)
    last = torch.zeros_like(top[..., :1, :])
    last[..., -1] = 1
    return cat([top, last], -2)


def homogeneous_cost(Q: Tensor, q: Tensor) -> Tensor:
    """Returns ``M (..., k+1, k+1)`` with ``1/2 [w, 1]' M [w, 1] = 1/2 w' Q w + q' w``."""
    q = q.unsqueeze(-1)
    side = cat([q, torch.zeros_like(q[..., :1, :])], -2)
    return cat([cat([Q, q.mT], -2), side], -1)


def riccati_step(V: Tensor, M: Tensor, G: Tensor, box: Box | None = None) -> tuple[Tensor, ...]:
    """Returns the cost-to-go one step earlier, the gains ``K (..., m, n+1)``, and what failed.

    The cost-to-go is ``1/2 [x, 1]' V [x, 1]`` and the best input is ``u = K [x, 1]``:

        H = M + G' V G                             (1)
        W = - L^-1 H_u[x,1],   H_uu = L L'         (2)
        K = L'^-1 W                                (3)
        V = H_[x,1][x,1] - W' W                    (4)

    With a box, inputs that it clamps keep their bound and get no feedback (3'), and V is what
    any K would cost:

        V = H_[x,1][x,1] + K' (H_uu K + H_u[x,1]) + H_u[x,1]' K       (4')

    Args:
        V: ``(..., n+1, n+1)``.
        M: cost, ``(..., m+n+1, m+n+1)``.
        G: dynamics, ``(..., n+1, m+n+1)``.
        box: lower and upper bound of u at x = 0, ``(..., m)`` each, or None.

    The third result is not 0 where ``H_uu`` is not positive definite.

    Source: Tassa, Mansard, Todorov, "Control-limited differential dynamic programming" (2014).
    """
    m = M.shape[-1] - V.shape[-1]
    H = M + bmm(G.mT, bmm(V, G))  # (1)
    Huu, Hu = H[..., :m, :m], H[..., :m, m:]
    if box is None:
        K, W, failed = solve_positive(Huu, -Hu)  # (2), (3)
        return H[..., m:, m:] - bmm(W.mT, W), K, failed  # (4)
    K, failed = _clamped_gains(Huu, Hu, *box)  # (3')
    V = H[..., m:, m:] + bmm(K.mT, bmm(Huu, K) + Hu) + bmm(Hu.mT, K)  # (4')
    return V, K, failed


def _clamped_gains(Huu: Tensor, Hu: Tensor, lower: Tensor, upper: Tensor) -> tuple[Tensor, Tensor]:
    """Returns the gains of ``min 1/2 u' Huu u + u' Hu [x, 1]``, u in the box where x = 0.

    Two rounds: first the inputs that stand at a bound and are pushed outward are clamped, then
    also those that the remaining freedom sends across one. At a solution no second round is
    needed, so that iterations with this step end at a point where the bounds hold exactly.
    What fails in the first round has failed, as nothing is known then of what to clamp.
    """
    push = Hu[..., -1]
    clamped = ((lower >= 0) & (push >= 0)) | ((upper <= 0) & (push <= 0))
    nearest = lower.clip(min=0) + upper.clip(max=0)  # to 0, in the box
    K, failed = _free_gains(Huu, Hu, clamped, clamped * nearest)
    k = K[..., -1]
    clamped = clamped | (k < lower) | (k > upper)
    K, again = _free_gains(Huu, Hu, clamped, clamped * k.clip(lower, upper))
    return K, failed + again


def _free_gains(Huu: Tensor, Hu: Tensor, clamped: Tensor, at: Tensor) -> tuple[Tensor, Tensor]:
    """Returns the gains of the inputs that are free while the clamped ones stay ``at``."""
    free = ~clamped[..., None]
    rest = cat([Hu[..., :-1], (Hu[..., -1] + bmv(Huu, at))[..., None]], -1)
    held = Huu * (free & free.mT) + ~free * torch.eye(
        Huu.shape[-1], dtype=Huu.dtype, device=Huu.device
    )
    K, _, failed = solve_positive(held, -rest * free)
    return cat([K[..., :-1], K[..., -1:] + at[..., None]], -1), failed
