"""Ways to rotations and poses: from matrices and angles, the identity, and random ones."""

from typing import Any

import torch
from torch import Generator, Tensor

from ..shapes import check, has_numbers
from .angles import so3_from_euler
from .taylor import safe_norm
from .tensor import SE3, SO3, LieTensor, se3, so3


def mat2SO3(mat: Any, check: bool = True, rtol: float = 1e-5, atol: float = 1e-5) -> SO3:
    """The rotations ``(..., 4)`` of matrices, ``mat2SO3(X.matrix()) = X`` or ``-X``.

    Args:
        mat: rotation matrices (..., 3, 3), or poses' (..., 3, 4) or (..., 4, 4), of which the
            rotation is taken.
        check: whether matrices that are no rotations are refused.
        rtol: how far R R' and det R may be from 1, relatively.
        atol: the same, absolutely.

    Raises:
        ValueError: another shape; with ``check``, R R' is not the identity or det R is not 1.

    Source: Shepperd, "Quaternion from rotation matrix", 1978: of four ways to the same numbers,
    one that divides by no small number; which one, and so the sign, is PyPose's choice.
    """
    R = _matrices(mat)[..., :3, :3]
    if check:
        _refuse_unless_rotation(R, rtol, atol)
    return _quaternion(R, atol).as_subclass(SO3)


def mat2SE3(mat: Any, check: bool = True, rtol: float = 1e-5, atol: float = 1e-5) -> SE3:
    """The poses ``(..., 7)`` of matrices, ``mat2SE3(X.matrix()) = X``, up to the quaternion's sign.

    Args:
        mat: homogeneous matrices (..., 4, 4), or (..., 3, 4) without their last row, or rotations
            (..., 3, 3), which move nothing.
        check: whether matrices that are no poses are refused.
        rtol: as in `mat2SO3`, also for the last row.
        atol: as in `mat2SO3`, also for the last row.

    Raises:
        ValueError: as in `mat2SO3`, or a last row that is not [0, 0, 0, 1].
    """
    M = _matrices(mat)
    q = mat2SO3(M, check, rtol, atol).tensor()
    if check and M.shape[-2] == 4 and has_numbers(M):
        row = M.detach()[..., 3, :]
        last = torch.tensor([0, 0, 0, 1], dtype=row.dtype, device=row.device)
        if not torch.allclose(row, last.expand_as(row), rtol, atol):
            raise ValueError(f"mat: expected last rows [0, 0, 0, 1], got {row.tolist()}")
    t = M[..., :3, 3] if M.shape[-1] == 4 else torch.zeros_like(M[..., 0])
    return torch.cat([t, q], -1).as_subclass(SE3)


def euler2SO3(euler: Any) -> SO3:
    """The rotations ``Exp(yaw e_z) Exp(pitch e_y) Exp(roll e_x)`` of ``euler (..., 3)``, rad."""
    return so3_from_euler(_floating(euler)).as_subclass(SO3)


def identity_so3(*lshape: int, **options: Any) -> so3:
    """Tangents ``(*lshape, 3)`` of zeros; ``options`` are those of `torch.zeros`."""
    return so3(torch.zeros(*_shape(lshape), 3, **options))


def identity_se3(*lshape: int, **options: Any) -> se3:
    """Tangents ``(*lshape, 6)`` of zeros; ``options`` are those of `torch.zeros`."""
    return se3(torch.zeros(*_shape(lshape), 6, **options))


def identity_SO3(*lshape: int, **options: Any) -> SO3:
    """Rotations ``(*lshape, 4)`` by nothing; ``options`` are those of `torch.zeros`."""
    return identity_so3(*lshape, **options).Exp()


def identity_SE3(*lshape: int, **options: Any) -> SE3:
    """Poses ``(*lshape, 7)`` that move nothing; ``options`` are those of `torch.zeros`."""
    return identity_se3(*lshape, **options).Exp()


def randn_so3(
    *lshape: int,
    sigma: float = 1.0,
    generator: Generator | None = None,
    requires_grad: bool = False,
    **options: Any,
) -> so3:
    """Random rotation vectors ``(*lshape, 3)``: a normal angle about a uniform axis.

    One seed gives the same numbers here and in PyPose.

    Args:
        lshape: the shape of the batch.
        sigma: the standard deviation of the angle, rad.
        generator: where the numbers come from.
        requires_grad: whether the result is a leaf to differentiate with respect to.
        options: dtype and device.
    """
    shape = _shape(lshape)
    axis = torch.randn(*shape, 3, generator=generator, **options)
    angle = sigma * torch.randn(*shape, 1, generator=generator, **options)
    return _leaf(so3(axis / safe_norm(axis, keepdim=True) * angle), requires_grad)


def randn_se3(
    *lshape: int,
    sigma: float | tuple[float, ...] = 1.0,
    generator: Generator | None = None,
    requires_grad: bool = False,
    **options: Any,
) -> se3:
    """Random twists ``(*lshape, 6)``: a normal rho, and phi as in `randn_so3`.

    Args:
        lshape: the shape of the batch.
        sigma: one standard deviation for all, or one for rho (m) and one for the angle (rad), or
            one for each of rho's three numbers and one for the angle.
        generator: as in `randn_so3`.
        requires_grad: as in `randn_so3`.
        options: dtype and device.
    """
    spread = tuple(sigma) if isinstance(sigma, tuple | list) else (sigma, sigma)
    if len(spread) not in (2, 4):
        raise ValueError(f"sigma: expected 1, 2 or 4 numbers, got {sigma}")
    phi = randn_so3(*lshape, sigma=spread[-1], generator=generator, **options).tensor()
    rho = torch.randn(*phi.shape, generator=generator, **options)
    scaled = rho.new_tensor(spread[:-1]) * rho
    return _leaf(se3(torch.cat([scaled, phi], -1)), requires_grad)


def randn_SO3(*lshape: int, requires_grad: bool = False, **options: Any) -> SO3:
    """Random rotations ``(*lshape, 4)``: `Exp` of `randn_so3`, which knows the ``options``."""
    return _leaf(randn_so3(*lshape, **options).Exp(), requires_grad)


def randn_SE3(*lshape: int, requires_grad: bool = False, **options: Any) -> SE3:
    """Random poses ``(*lshape, 7)``: `Exp` of `randn_se3`, which knows the ``options``."""
    return _leaf(randn_se3(*lshape, **options).Exp(), requires_grad)


def _shape(lshape: tuple) -> tuple[int, ...]:
    """The shape, however it came: as numbers or as one tuple."""
    one = len(lshape) == 1 and not isinstance(lshape[0], int)
    return tuple(lshape[0]) if one else lshape


def _floating(data: Any) -> Tensor:
    """The data as a plain tensor of floats."""
    x = torch.as_tensor(data).as_subclass(Tensor)
    return x if x.is_floating_point() else x.to(torch.get_default_dtype())


def _matrices(mat: Any) -> Tensor:
    """The matrices as a tensor of floats, of one of the three shapes."""
    M = _floating(mat)
    if tuple(M.shape[-2:]) not in ((3, 3), (3, 4), (4, 4)):
        shapes = "(..., 3, 3), (..., 3, 4) or (..., 4, 4)"
        raise ValueError(f"mat: expected {shapes}, got {tuple(M.shape)}")
    check("mat: k n", M)
    return M


def _refuse_unless_rotation(R: Tensor, rtol: float, atol: float) -> None:
    """Raises ValueError for the first of the matrices that is no rotation."""
    R = R.detach()
    if not has_numbers(R):
        return
    one = torch.eye(3, dtype=R.dtype, device=R.device)
    product, turned = R @ R.mT, R.det()
    right = torch.isclose(product, one, rtol, atol).flatten(-2).all(-1)
    bad = ~right | ((turned - 1).abs() > atol + rtol)
    if bad.any():
        where = tuple(bad.nonzero()[0].tolist())
        raise ValueError(
            f"mat: expected rotations (..., 3, 3) with R R' = 1 and det R = 1, got R R' off by "
            f"{(product - one)[where].abs().max():.3g} and det R = {turned[where]:.3g}"
            + (f" at {where}" if where else "")
        )


def _quaternion(R: Tensor, atol: float) -> Tensor:
    """A row of the matrix ``4 q q'``, which is linear in R, divided by its length.

    Each row is q times four times one entry of q, and the four squared entries are on the
    diagonal. The row is chosen so that its entry of the diagonal is at least 1.
    """
    (a, b, c), (d, e, f), (g, h, i) = (row.unbind(-1) for row in R.unbind(-2))
    rows = [
        [1 + a - e - i, b + d, c + g, h - f],
        [b + d, 1 - a + e - i, f + h, c - g],
        [c + g, f + h, 1 - a - e + i, d - b],
        [h - f, c - g, d - b, 1 + a + e + i],
    ]
    x, y, z, w = (torch.stack(row, -1) for row in rows)
    first, up, apart = (m[..., None] for m in (a > e, i >= atol, a < -e))
    row = torch.where(up, torch.where(apart, z, w), torch.where(first, x, y))
    return row / safe_norm(row, keepdim=True)


def _leaf(X: LieTensor, requires_grad: bool) -> Any:
    """The same numbers, detached, as a leaf that asks for a gradient or not."""
    leaf = X.detach()
    leaf.requires_grad_(requires_grad)
    return leaf
