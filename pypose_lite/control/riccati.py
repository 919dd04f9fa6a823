"""The Riccati step: the best input when the future's cost is a quadratic.

Everything linear-quadratic in this library is this one step: LQR runs it backward in time, iLQR
runs it around a trajectory, the gradient of a plan is one more backward run.

Constants ride along in homogeneous coordinates: with ``z = [u, x, 1]`` a step ``x' = A x + B u +
c`` is ``[x', 1] = G z`` and a cost ``1/2 w' Q w + q' w`` of ``w = [u, x]`` is ``1/2 z' M z``.
Chapter 2 derives it.
"""

import torch
from torch import Tensor

from ..linalg import bmv
from ..shapes import check

Box = tuple[Tensor, Tensor]


def homogeneous_dynamics(A: Tensor, B: Tensor, c: Tensor | None = None) -> Tensor:
    """Returns ``G (..., n+1, m+n+1)`` with ``[A x + B u + c, 1] = G [u, x, 1]``."""
    c = torch.zeros_like(A[..., 0]) if c is None else c
    top = torch.cat([B, A, c.unsqueeze(-1)], -1)
    last = torch.zeros_like(top[..., :1, :])
    last[..., -1] = 1
    return torch.cat([top, last], -2)


def homogeneous_cost(Q: Tensor, q: Tensor) -> Tensor:
    """Returns ``M (..., k+1, k+1)`` with ``1/2 [w, 1]' M [w, 1] = 1/2 w' Q w + q' w``."""
    q = q.unsqueeze(-1)
    side = torch.cat([q, torch.zeros_like(q[..., :1, :])], -2)
    return torch.cat([torch.cat([Q, q.mT], -2), side], -1)


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
    H = M + G.mT @ V @ G  # (1)
    Huu, Hu = H[..., :m, :m], H[..., :m, m:]
    if box is None:
        K, W, failed = solve_positive(Huu, -Hu)  # (2), (3)
        return H[..., m:, m:] - W.mT @ W, K, failed  # (4)
    K, failed = _clamped_gains(Huu, Hu, *box)  # (3')
    V = H[..., m:, m:] + K.mT @ (Huu @ K + Hu) + Hu.mT @ K  # (4')
    return V, K, failed


def riccati(M: Tensor, G: Tensor, box: Box | None = None) -> tuple[Tensor, ...]:
    """Returns all gains ``(T, ..., m, n+1)``, the cost-to-go at the start, and what failed.

    Args:
        M: costs of the T steps, ``(T, ..., m+n+1, m+n+1)``. The last state costs nothing.
        G: dynamics of the T steps, ``(T, ..., n+1, m+n+1)``.
        box: bounds, ``(T, ..., m)`` each, or None.
    """
    batch = torch.broadcast_shapes(M.shape[1:-2], G.shape[1:-2])
    V, gains, failures = G.new_zeros(*batch, G.shape[-2], G.shape[-2]), [], []
    for t in reversed(range(len(M))):
        V, K, failed = riccati_step(V, M[t], G[t], box and (box[0][t], box[1][t]))
        gains.append(K)
        failures.append(failed)
    return torch.stack(gains[::-1]), V, torch.stack(failures[::-1])


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
    rest = torch.cat([Hu[..., :-1], (Hu[..., -1] + bmv(Huu, at))[..., None]], -1)
    held = Huu * (free & free.mT) + torch.diag_embed(clamped.to(Huu))
    K, _, failed = solve_positive(held, -rest * free)
    return torch.cat([K[..., :-1], K[..., -1:] + at[..., None]], -1), failed


def solve_positive(H: Tensor, R: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Returns ``H^-1 R``, ``L^-1 R`` with ``H = L L'``, and what is not 0 where H is not > 0."""
    L, failed = torch.linalg.cholesky_ex(H)
    W = torch.linalg.solve_triangular(L, R, upper=False)
    return torch.linalg.solve_triangular(L.mT, W, upper=True), W, failed


def dlqr(A: Tensor, B: Tensor, Q: Tensor, R: Tensor, steps: int = 60) -> tuple[Tensor, Tensor]:
    """Returns the gain ``K (..., m, n)`` and the cost ``P (..., n, n)`` of the endless horizon.

    ``u = -K x``, as the name promises elsewhere, minimises ``sum 1/2 x' Q x + 1/2 u' R u`` and
    costs ``1/2 x' P x``. Doubling: P_j is the cost-to-go of 2^j steps, A_j the closed loop over
    them, S_j their reach:

        W = I + S_j P_j                            (1)
        A_j+1 = A_j W^-1 A_j                       (2)
        S_j+1 = S_j + A_j W^-1 S_j A_j'            (3)
        P_j+1 = P_j + A_j' P_j W^-1 A_j            (4)

    Args:
        A: ``(..., n, n)``.
        B: ``(..., n, m)``.
        Q: cost of the state, ``(..., n, n)``, symmetric >= 0.
        R: cost of the input, ``(..., m, m)``, symmetric > 0.
        steps: how many doublings at most.

    Raises:
        ValueError: where no gain is stable: (A, B) cannot be stabilised, or Q does not see an
            unstable motion; and where the cost has no minimum.

    Source: Chu, Fan, Lin, Wang, "Structure-preserving algorithms for periodic discrete-time
    algebraic Riccati equations" (2004), section 3.
    """
    check("A: n n, B: n m, Q: n n, R: m m", A, B, Q, R)
    batch = torch.broadcast_shapes(*(z.shape[:-2] for z in (A, B, Q, R)))
    A, B, Q, R = (z.expand(*batch, *z.shape[-2:]) for z in (A, B, Q, R))  # solve may guess wrong
    R, P = (R + R.mT) / 2, (Q + Q.mT) / 2
    if torch.linalg.cholesky_ex(R.detach()).info.any():
        raise ValueError("R: expected a positive definite matrix")
    S = B @ torch.linalg.solve(R, B.mT)
    Aj, eye = A, torch.eye(A.shape[-1], dtype=A.dtype, device=A.device)
    for _ in range(steps):
        W = eye + S @ P  # (1)
        WA, WS = torch.linalg.solve(W, Aj), torch.linalg.solve(W, S)
        S = S + Aj @ WS @ Aj.mT  # (3)
        change = Aj.mT @ P @ WA  # (4)
        Aj, P = Aj @ WA, P + (change + change.mT) / 2  # (2)
        if not bool((change.abs().amax() > 1e-15 * P.abs().amax()).item()):
            break
    H = R + B.mT @ P @ B
    K = torch.linalg.solve(H, B.mT @ P @ A)
    if torch.linalg.cholesky_ex(H.detach()).info.any() and torch.isfinite(H).all():
        raise ValueError("Q: the cost has no minimum; expected Q >= 0")
    closed = (A - B @ K).detach()
    if not torch.isfinite(closed).all() or (torch.linalg.eigvals(closed).abs() >= 1).any():
        raise ValueError(
            "A, B: no gain makes A - B K stable: (A, B) cannot be stabilised, or Q "
            "gives an unstable motion no cost"
        )
    return K, P
