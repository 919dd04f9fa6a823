"""Rotations SO(2) and poses SE(2) of the plane.

A rotation is ``[cos, sin]``, a pose ``[x, y, cos, sin]``: the state of the Dubins car. The
tangents are the angle ``[phi]`` and ``[rho_x, rho_y, phi]``, the translation first.
``T_wb`` takes what is known in frame b to frame w: ``p_w = se2_act(T_wb, p_b)``.
"""

import torch
from torch import Tensor

from ..shapes import check
from .taylor import sinc_half


def so2_exp(phi: Tensor) -> Tensor:
    """The rotation ``(..., 2)`` by ``phi (..., 1)``, rad; its matrix is ``expm(hat(phi))``."""
    check("phi: n", phi, n=1)
    return torch.cat([phi.cos(), phi.sin()], -1)


def so2_log(R: Tensor) -> Tensor:
    """The angle ``(..., 1)`` in (-pi, pi] of the rotation ``R (..., 2)``."""
    check("R: n", R, n=2)
    return torch.atan2(R[..., 1:], R[..., :1])


def so2_compose(R_ab: Tensor, R_bc: Tensor) -> Tensor:
    """``R_ac = R_ab R_bc``, all ``(..., 2)``."""
    check("R_ab: n, R_bc: n", R_ab, R_bc, n=2)
    return _rotate(R_ab, R_bc)


def so2_inverse(R: Tensor) -> Tensor:
    """The rotation ``(..., 2)`` that undoes ``R (..., 2)``."""
    check("R: n", R, n=2)
    return torch.stack([R[..., 0], -R[..., 1]], -1)


def so2_act(R: Tensor, p: Tensor) -> Tensor:
    """The points ``p (..., 2)`` rotated by ``R (..., 2)``."""
    check("R: n, p: n", R, p, n=2)
    return _rotate(R, p)


def so2_matrix(R: Tensor) -> Tensor:
    """The matrix ``(..., 2, 2)`` of ``R (..., 2)``."""
    check("R: n", R, n=2)
    return torch.stack([R, _quarter_turn(R)], -1)


def so2_adjoint(R: Tensor) -> Tensor:
    """``[[1]] (..., 1, 1)``: rotations of the plane commute."""
    check("R: n", R, n=2)
    return torch.ones_like(R[..., :1, None])


def se2_exp(xi: Tensor) -> Tensor:
    """The pose ``(..., 4)`` reached by the constant twist ``xi = [rho, phi] (..., 3)`` in time 1.

    ``se2_matrix(se2_exp(xi)) = expm(hat(xi))``. The path is an arc: its chord has the direction
    of ``rho`` turned by ``phi / 2``, and is shorter by ``sin(phi / 2) / (phi / 2)``.
    """
    check("xi: n", xi, n=3)
    rho, phi = xi[..., :2], xi[..., 2:]
    chord = 2 * sinc_half(phi**2) * _rotate(so2_exp(phi / 2), rho)
    return torch.cat([chord, so2_exp(phi)], -1)


def se2_log(T: Tensor) -> Tensor:
    """The twist ``[rho, phi] (..., 3)`` with ``se2_exp`` of it equal to ``T (..., 4)``."""
    check("T: n", T, n=4)
    phi = so2_log(T[..., 2:])
    rho = _rotate(so2_exp(-phi / 2), T[..., :2]) / (2 * sinc_half(phi**2))
    return torch.cat([rho, phi], -1)


def se2_compose(T_ab: Tensor, T_bc: Tensor) -> Tensor:
    """``T_ac = T_ab T_bc``, all ``(..., 4)``."""
    check("T_ab: n, T_bc: n", T_ab, T_bc, n=4)
    R = T_ab[..., 2:]
    t = _rotate(R, T_bc[..., :2]) + T_ab[..., :2]
    return torch.cat([t, _rotate(R, T_bc[..., 2:])], -1)


def se2_inverse(T: Tensor) -> Tensor:
    """The pose ``T_ba (..., 4)`` of ``T_ab (..., 4)``."""
    check("T: n", T, n=4)
    back = so2_inverse(T[..., 2:])
    return torch.cat([-_rotate(back, T[..., :2]), back], -1)


def se2_act(T_ab: Tensor, p_b: Tensor) -> Tensor:
    """The points ``p_a (..., 2)`` of ``p_b (..., 2)``: rotated, then moved."""
    check("T_ab: m, p_b: n", T_ab, p_b, m=4, n=2)
    return _rotate(T_ab[..., 2:], p_b) + T_ab[..., :2]


def se2_matrix(T: Tensor) -> Tensor:
    """The homogeneous matrix ``(..., 3, 3)`` of ``T (..., 4)``."""
    check("T: n", T, n=4)
    top = torch.cat([so2_matrix(T[..., 2:]), T[..., :2, None]], -1)
    last = torch.tensor([0, 0, 1], dtype=top.dtype, device=top.device)
    return torch.cat([top, last.expand_as(top[..., :1, :])], -2)


def se2_adjoint(T: Tensor) -> Tensor:
    """The ``Ad (..., 3, 3)`` with ``T se2_exp(xi) T^-1 = se2_exp(Ad xi)`` for ``T (..., 4)``."""
    check("T: n", T, n=4)
    moved = se2_matrix(T)
    column = torch.cat([-_quarter_turn(T[..., :2]), torch.ones_like(T[..., :1])], -1)
    return torch.cat([moved[..., :2], column[..., None]], -1)


def _rotate(R: Tensor, p: Tensor) -> Tensor:
    """The product of complex numbers, which composes rotations as well as it turns points."""
    (c, s), (x, y) = R.unbind(-1), p.unbind(-1)
    return torch.stack([c * x - s * y, s * x + c * y], -1)


def _quarter_turn(v: Tensor) -> Tensor:
    """The vectors ``v (..., 2)`` turned by 90 degrees to the left."""
    return torch.stack([-v[..., 1], v[..., 0]], -1)
