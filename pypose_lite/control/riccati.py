"""The Riccati step: the best input when all that follows costs a quadratic.

Everything linear-quadratic in this library is this one step. `LQR` repeats it backward in time, a
sweep of iterative LQR does so along a plan (`sweep.py`), and the gradient of a plan is one more
backward pass (`gradient.py`). Chapter 2 derives it. Inputs and states stand as users write them,
``z = [x, u]``; sequences have time first, ``(T, ..., n)``.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from ..linalg import bmv, bvv, symmetric

Box = tuple[Tensor, Tensor]


class CostToGo(NamedTuple):
    """What is still to pay from a state x on: ``1/2 x' V x + v' x + c``."""

    V: Tensor  # (..., n, n), symmetric
    v: Tensor  # (..., n)
    c: Tensor  # (...)

    def from_origin(self, d: Tensor) -> "CostToGo":
        """Returns the cost-to-go as a function of ``x - d``."""
        slope = bmv(self.V, d)
        return CostToGo(self.V, self.v + slope, self.c + bvv(d, self.v + slope / 2))


def riccati_step(
    after: CostToGo, Q: Tensor, q: Tensor, A: Tensor, B: Tensor, box: Box | None = None
) -> tuple[CostToGo, Tensor, Tensor, Tensor]:
    """Returns the cost-to-go one step earlier, the gains K and k, and where there are none.

    The step costs ``1/2 z' Q z + q' z`` with ``z = [x, u]``, leads to ``x' = A x + B u``, and from
    there on ``after`` is to pay. With ``F = [A B]`` both together are a quadratic in z:

        H = Q + F' V F                             (1)
        h = q + F' v                               (2)

    Its minimum over u is ``u = K x + k``, and what is left is the cost-to-go of x:

        K = -Huu^-1 Hux                            (3)
        k = -Huu^-1 hu                             (4)
        V = Hxx + Hxu K                            (5)
        v = hx + Hxu k                             (6)
        c = c + k' (hu + 1/2 Huu k)                (7)

    V is kept symmetric: rounding would make it less so with every step, by products of two
    eigenvalues of A, until a long plan of an unstable system is nothing but that error.

    Args:
        after: the cost-to-go of the next state; its V is ``(..., n, n)``.
        Q: symmetric, ``(..., n+m, n+m)``.
        q: ``(..., n+m)``.
        A: ``(..., n, n)``.
        B: ``(..., n, m)``.
        box: lower and upper bound of u at x = 0, ``(..., m)`` each, or None. An input at its bound
            stays there: its row of K is 0.

    The last result ``(...)`` is not 0 where ``Huu`` is not positive definite, so that there is no
    minimum.

    Source: Bertsekas, "Dynamic Programming and Optimal Control", vol. 1, section 4.1; the box:
    Tassa, Mansard, Todorov, "Control-limited differential dynamic programming" (2014).
    """
    n = A.shape[-1]
    F = torch.cat([A, B], -1)
    H = Q + F.mT @ after.V @ F  # (1)
    h = q + bmv(F.mT, after.v)  # (2)
    Hxx, Hux, Huu = H[..., :n, :n], H[..., n:, :n], H[..., n:, n:]
    hx, hu = h[..., :n], h[..., n:]
    K, k, failed = best_gains(Huu, Hux, hu, box)  # (3), (4)
    V = symmetric(Hxx + Hux.mT @ K)  # (5)
    v = hx + bmv(Hux.mT, k)  # (6)
    c = after.c + bvv(k, hu + bmv(Huu, k) / 2)  # (7)
    return CostToGo(V, v, c), K, k, failed


def riccati(
    last: CostToGo,
    Q: Tensor,
    q: Tensor,
    A: Tensor,
    B: Tensor,
    box: Box | None = None,
    defects: Tensor | None = None,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Returns the gains of all steps, what they promise, and where there are none.

    They are ``K (T, ..., m, n)``, ``k (T, ..., m)``, ``c (...)``, the change of the cost
    that the gains promise, and ``failed (T, ...)``, not 0 where a step has no minimum.

    Args:
        last: the cost-to-go of the state after the last step.
        Q: ``(T, ..., n+m, n+m)``, as in :func:`riccati_step`, and so are q, A and B.
        q: ``(T, ..., n+m)``.
        A: ``(T, ..., n, n)``.
        B: ``(T, ..., n, m)``.
        box: bounds, ``(T, ..., m)`` each, or None.
        defects: ``(T, ..., n)``, added to each next state, ``x' = A x + B u + d``, or None.
    """
    after, steps = last, []
    for t in reversed(range(len(A))):
        after = after if defects is None else after.from_origin(defects[t])
        bounds = None if box is None else (box[0][t], box[1][t])
        after, *gains = riccati_step(after, Q[t], q[t], A[t], B[t], bounds)
        steps.append(gains)
    K, k, failed = (torch.stack(z) for z in zip(*reversed(steps)))
    return K, k, after.c, failed


def best_gains(
    Huu: Tensor, Hux: Tensor, hu: Tensor, box: Box | None = None
) -> tuple[Tensor, Tensor, Tensor]:
    """Returns K and k of the least ``1/2 u' Huu u + u' (Hux x + hu)``, and where there is none.

    In a box k is the best input for x = 0. Two rounds find it: first the inputs that stand at a
    bound and are pushed outward are clamped, then also those that the remaining freedom sends
    across one. At a solution no second round is needed, so that iterations with this step end
    where the bounds hold exactly. What fails in the first round has failed, as nothing is known
    then of what to clamp.
    """
    if box is None:
        return _free_gains(Huu, Hux, hu)
    lower, upper = box
    clamped = ((lower >= 0) & (hu >= 0)) | ((upper <= 0) & (hu <= 0))
    nearest = lower.clip(min=0) + upper.clip(max=0)  # to 0, in the box
    _, k, failed = _gains_beside(clamped, nearest, Huu, Hux, hu)
    clamped = clamped | (k < lower) | (k > upper)
    K, k, again = _gains_beside(clamped, k.clip(lower, upper), Huu, Hux, hu)
    return K, k, failed + again


def _gains_beside(clamped: Tensor, at: Tensor, Huu: Tensor, Hux: Tensor, hu: Tensor):
    """Returns the gains of the inputs that are free while the clamped ones stay ``at``."""
    at = torch.where(clamped, at, 0)
    free = ~clamped[..., None]
    held = Huu * (free & free.mT) + torch.diag_embed(clamped.to(Huu))
    K, k, failed = _free_gains(held, Hux * free, (hu + bmv(Huu, at)) * ~clamped)
    return K, k + at, failed


def _free_gains(Huu: Tensor, Hux: Tensor, hu: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    L, failed = torch.linalg.cholesky_ex(Huu)
    Kk = -torch.cholesky_solve(torch.cat([Hux, hu[..., None]], -1), L)
    return Kk[..., :-1], Kk[..., -1], failed
