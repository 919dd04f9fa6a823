"""The regulator of the endless horizon: one gain for all steps.

It solves the algebraic Riccati equation. Chapter 2 finds it as the limit of ever longer plans;
here the horizon doubles with every pass.
"""

import torch
from torch import Tensor

from ..linalg import symmetric
from ..shapes import check, has_numbers


def dlqr(
    A: Tensor, B: Tensor, Q: Tensor, R: Tensor, N: Tensor | None = None, steps: int = 60
) -> tuple[Tensor, Tensor]:
    """Returns the gain ``K (..., m, n)`` and the cost ``P (..., n, n)`` of the endless horizon.

    ``u = -K x``, as the name promises elsewhere, minimises ``sum 1/2 x' Q x + 1/2 u' R u + x' N u``
    and costs ``1/2 x' P x``. Where there is a cross term, ``u = w - R^-1 N' x`` removes it:

        A = A - B R^-1 N'                          (1)
        Q = Q - N R^-1 N'                          (2)

    Doubling: P_j is the cost-to-go of 2^j steps, A_j the closed loop over them, S_j their reach:

        W = I + S_j P_j                            (3)
        A_j+1 = A_j W^-1 A_j                       (4)
        S_j+1 = S_j + A_j W^-1 S_j A_j'            (5)
        P_j+1 = P_j + A_j' P_j W^-1 A_j            (6)

    Args:
        A: ``(..., n, n)``.
        B: ``(..., n, m)``.
        Q: cost of the state, ``(..., n, n)``, symmetric >= 0, and so is (2).
        R: cost of the input, ``(..., m, m)``, symmetric > 0.
        N: cost of state times input, ``(..., n, m)``, or None.
        steps: how many doublings at most.

    Raises:
        ValueError: where no gain is stable: (A, B) cannot be stabilised, or Q does not see an
            unstable motion; and where the cost has no minimum.

    Source: Chu, Fan, Lin, Wang, "Structure-preserving algorithms for periodic discrete-time
    algebraic Riccati equations" (2004), section 3.
    """
    check("A: n n, B: n m, Q: n n, R: m m, N: n m", A, B, Q, R, N)
    N = torch.zeros_like(B) if N is None else N
    batch = torch.broadcast_shapes(*(z.shape[:-2] for z in (A, B, Q, R, N)))
    A, B, Q, R, N = (z.expand(*batch, *z.shape[-2:]) for z in (A, B, Q, R, N))
    R, Q = symmetric(R), symmetric(Q)
    if has_numbers(R) and torch.linalg.cholesky_ex(R.detach()).info.any():
        raise ValueError("R: expected a positive definite matrix")
    crossing = torch.linalg.solve(R, N.mT)
    P = doubled(A - B @ crossing, B, Q - N @ crossing, R, steps)  # (1), (2)
    H = R + B.mT @ P @ B
    K = torch.linalg.solve(H, B.mT @ P @ A + N.mT)
    _refuse(A, B, K, H)
    return K, P


def doubled(A: Tensor, B: Tensor, Q: Tensor, R: Tensor, steps: int) -> Tensor:
    """Returns the fixed point P of the Riccati equation, by doubling the horizon: (3) to (6)."""
    P = Q
    S = symmetric(B @ torch.linalg.solve(R, B.mT))
    eye = torch.eye(A.shape[-1], dtype=A.dtype, device=A.device)
    for _ in range(steps):
        W = eye + S @ P  # (3)
        WA, WS = torch.linalg.solve(W, A), torch.linalg.solve(W, S)
        S = symmetric(S + A @ WS @ A.mT)  # (5)
        change = symmetric(A.mT @ P @ WA)  # (6)
        A, P = A @ WA, P + change  # (4)
        if has_numbers(change) and not bool(change.abs().amax() > 1e-15 * P.abs().amax()):
            break
    return P


def _refuse(A: Tensor, B: Tensor, K: Tensor, H: Tensor) -> None:
    """Raises ValueError where the cost has no minimum or the closed loop is not stable."""
    closed, H = (A - B @ K).detach(), H.detach()
    if not has_numbers(closed):
        return
    if torch.isfinite(H).all() and torch.linalg.cholesky_ex(H).info.any():
        raise ValueError("Q: the cost has no minimum; expected Q >= 0")
    if not torch.isfinite(closed).all() or (torch.linalg.eigvals(closed).abs() >= 1).any():
        raise ValueError(
            "A, B: no gain makes A - B K stable: (A, B) cannot be stabilised, or Q "
            "gives an unstable motion no cost"
        )
