"""Rotations SO(3) and poses SE(3) of space, as functions on tensors.

A rotation is a unit quaternion ``[x, y, z, w]``, a pose ``[t, q] (..., 7)``. The tangents are
the rotation vector ``phi (..., 3)`` and the twist ``[rho, phi] (..., 6)``, in PyPose's order.
``T_wb`` takes what is known in frame b to frame w: ``p_w = se3_act(T_wb, p_b)``. Gradients are
those of the numbers themselves (PyPose returns the tangent's).

Source: Sola, Deray, Atchuthan, "A micro Lie theory for state estimation in robotics",
appendices B to D.
"""

import torch
from torch import Tensor

from ..linalg import bvv
from ..shapes import check
from .taylor import angle_over_sine, cos_half, cot_defect, safe_norm, sinc_half, sine_defect


def so3_exp(phi: Tensor) -> Tensor:
    """The quaternion ``(..., 4)`` with ``so3_matrix(so3_exp(phi)) = expm(hat(phi))``.

    Args:
        phi: rotation vectors (..., 3): axis times angle, rad; any length.
    """
    check("phi: n", phi, n=3)
    x = bvv(phi, phi)[..., None]
    return torch.cat([sinc_half(x) * phi, cos_half(x)], -1)


def so3_log(q: Tensor) -> Tensor:
    """The rotation vector ``(..., 3)``, at most pi long, of ``q (..., 4)``; q and -q are one.

    The angle comes from the vector part as well as from w, so that it keeps its digits near pi.
    """
    check("q: n", q, n=4)
    q = torch.where(q[..., 3:] < 0, -q, q)
    v, w = q[..., :3], q[..., 3:]
    return 2 * angle_over_sine(bvv(v, v)[..., None], w) * v


def so3_compose(q_ab: Tensor, q_bc: Tensor) -> Tensor:
    """``q_ac``, the quaternion product ``q_ab q_bc``, all ``(..., 4)``."""
    check("q_ab: n, q_bc: n", q_ab, q_bc, n=4)
    return _product(q_ab, q_bc)


def so3_inverse(q: Tensor) -> Tensor:
    """The rotation that undoes the unit quaternion ``q (..., 4)``: its conjugate."""
    check("q: n", q, n=4)
    return _conjugate(q)


def so3_act(q: Tensor, p: Tensor) -> Tensor:
    """The points ``p (..., 3)`` rotated by the unit quaternion ``q (..., 4)``."""
    check("q: m, p: n", q, p, m=4, n=3)
    return _rotate(q, p)


def so3_matrix(q: Tensor) -> Tensor:
    """The rotation matrix ``(..., 3, 3)`` of the unit quaternion ``q (..., 4)``."""
    check("q: n", q, n=4)
    axes = torch.eye(3, dtype=q.dtype, device=q.device)
    return _rotate(q[..., None, :], axes).mT


def so3_adjoint(q: Tensor) -> Tensor:
    """The ``Ad (..., 3, 3)`` with ``q so3_exp(phi) q^-1 = so3_exp(Ad phi)``: the matrix itself."""
    return so3_matrix(q)


def so3_bracket(a: Tensor, b: Tensor) -> Tensor:
    """The Lie bracket ``[a, b] (..., 3)``: the cross product."""
    check("a: n, b: n", a, b, n=3)
    return _cross(a, b)


def so3_normalize(q: Tensor) -> Tensor:
    """The quaternion ``q (..., 4)`` scaled to length 1."""
    check("q: n", q, n=4)
    return q / safe_norm(q, keepdim=True)


def se3_exp(xi: Tensor) -> Tensor:
    """The pose ``(..., 7)`` reached by the constant twist ``xi`` in time 1.

    ``se3_matrix(se3_exp(xi)) = expm(hat(xi))``. With theta the length of phi, the translation is

        t = rho + b phi x rho + c phi x (phi x rho),                            (1)
        b = (1 - cos theta) / theta^2,  c = (theta - sin theta) / theta^3.      (2)

    Args:
        xi: twists [rho, phi] (..., 6), m and rad.
    """
    check("xi: n", xi, n=6)
    rho, phi = xi[..., :3], xi[..., 3:]
    x = bvv(phi, phi)[..., None]
    half = sinc_half(x)
    b, c = 2 * half**2, sine_defect(x)  # (2)
    turned = _cross(phi, rho)
    t = rho + b * turned + c * _cross(phi, turned)  # (1)
    return torch.cat([t, half * phi, cos_half(x)], -1)


def se3_log(T: Tensor) -> Tensor:
    """The twist ``[rho, phi] (..., 6)`` with ``se3_exp`` of it equal to ``T (..., 7)``.

    With theta the length of phi, at most pi, the inverse of (1) in `se3_exp` is

        rho = t - 1/2 phi x t + d phi x (phi x t),                              (1)
        d = (1 - (theta / 2) cot(theta / 2)) / theta^2.                         (2)
    """
    check("T: n", T, n=7)
    t, phi = T[..., :3], so3_log(T[..., 3:])
    d = cot_defect(bvv(phi, phi)[..., None])  # (2)
    turned = _cross(phi, t)
    rho = t - turned / 2 + d * _cross(phi, turned)  # (1)
    return torch.cat([rho, phi], -1)


def se3_compose(T_ab: Tensor, T_bc: Tensor) -> Tensor:
    """``T_ac = T_ab T_bc``, all ``(..., 7)``."""
    check("T_ab: n, T_bc: n", T_ab, T_bc, n=7)
    q = T_ab[..., 3:]
    t = _rotate(q, T_bc[..., :3]) + T_ab[..., :3]
    return torch.cat([t, _product(q, T_bc[..., 3:])], -1)


def se3_inverse(T: Tensor) -> Tensor:
    """The pose ``T_ba (..., 7)`` of ``T_ab (..., 7)``."""
    check("T: n", T, n=7)
    back = _conjugate(T[..., 3:])
    return torch.cat([-_rotate(back, T[..., :3]), back], -1)


def se3_act(T_ab: Tensor, p_b: Tensor) -> Tensor:
    """The points ``p_a (..., 3)`` of ``p_b (..., 3)``: rotated, then moved."""
    check("T_ab: m, p_b: n", T_ab, p_b, m=7, n=3)
    return _rotate(T_ab[..., 3:], p_b) + T_ab[..., :3]


def se3_matrix(T: Tensor) -> Tensor:
    """The homogeneous matrix ``(..., 4, 4)`` of ``T (..., 7)``."""
    check("T: n", T, n=7)
    top = torch.cat([so3_matrix(T[..., 3:]), T[..., :3, None]], -1)
    last = torch.tensor([0, 0, 0, 1], dtype=top.dtype, device=top.device)
    return torch.cat([top, last.expand_as(top[..., :1, :])], -2)


def se3_adjoint(T: Tensor) -> Tensor:
    """The ``Ad (..., 6, 6)`` with ``T se3_exp(xi) T^-1 = se3_exp(Ad xi)`` for ``T (..., 7)``."""
    check("T: n", T, n=7)
    R = so3_matrix(T[..., 3:])
    top = torch.cat([R, _cross(T[..., None, :3], R.mT).mT], -1)  # t x each column of R
    return torch.cat([top, torch.cat([torch.zeros_like(R), R], -1)], -2)


def se3_bracket(a: Tensor, b: Tensor) -> Tensor:
    """The Lie bracket ``[a, b] (..., 6)``: the rate of ``Ad b`` when a pose moves by ``a``."""
    check("a: n, b: n", a, b, n=6)
    rho = _cross(a[..., 3:], b[..., :3]) + _cross(a[..., :3], b[..., 3:])
    return torch.cat([rho, _cross(a[..., 3:], b[..., 3:])], -1)


def _product(q: Tensor, r: Tensor) -> Tensor:
    """The quaternion product."""
    a, u = q[..., 3:], q[..., :3]
    b, v = r[..., 3:], r[..., :3]
    return torch.cat([a * v + b * u + _cross(u, v), a * b - bvv(u, v)[..., None]], -1)


def _conjugate(q: Tensor) -> Tensor:
    """The inverse of a unit quaternion."""
    return torch.cat([-q[..., :3], q[..., 3:]], -1)


def _rotate(q: Tensor, p: Tensor) -> Tensor:
    """The vector part of q p q*, for a unit quaternion."""
    v, w = q[..., :3], q[..., 3:]
    twice = 2 * _cross(v, p)
    return p + w * twice + _cross(v, twice)


def _cross(u: Tensor, v: Tensor) -> Tensor:
    """The cross product of ``(..., 3)`` and ``(..., 3)``, whose batches broadcast."""
    return torch.linalg.cross(*torch.broadcast_tensors(u, v))
