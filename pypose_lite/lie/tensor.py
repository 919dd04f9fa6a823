"""The `SE3` tensor: PyPose's names for poses in space, a thin layer over the functions.

`SE3` and its tangent `se3` are tensors that know what their last dimension means. Taking rows,
stacking and copying keep that knowledge; every other operation gives a plain tensor.
"""

from typing import Any, ClassVar, Self

import torch
from torch import Generator, Tensor

from ..linalg import bmv
from ..shapes import check
from .space import se3_act, se3_adjoint, se3_compose, se3_exp, se3_inverse, se3_log, se3_matrix
from .taylor import safe_norm

# What moves whole rows about, or copies them, and so leaves poses poses.
ROWS = frozenset(
    "__getitem__ cat chunk clone cpu cuda detach double expand flip float index_select narrow "
    "repeat reshape roll split squeeze stack take_along_dim tile to unbind unsqueeze view".split()
)
# What leaves tangents tangents: they are vectors.
ARITHMETIC = frozenset("add sub mul div neg mean sum".split())


class LieTensor(Tensor):
    """What `SE3` and `se3` share: a tensor of rows of a fixed width."""

    width: ClassVar[int]
    keeps: ClassVar[frozenset[str]]

    def __new__(cls, data: Any) -> Self:
        """Takes a tensor, an array or nested lists ``(..., width)``; integers become floats."""
        x = torch.as_tensor(data).as_subclass(Tensor)
        x = x if x.is_floating_point() else x.to(torch.get_default_dtype())
        check(f"{cls.__name__}: n", x, n=cls.width)
        return x.as_subclass(cls)

    @classmethod
    def __torch_function__(cls, func, types, args=(), kwargs=None):
        """Runs ``func`` on plain tensors, and labels what comes back where rows were kept."""
        with torch._C.DisableTorchFunctionSubclass():
            out = func(*args, **(kwargs or {}))
        keeps = getattr(func, "__name__", "") in cls.keeps

        def label(x):
            return x.as_subclass(cls) if keeps and x.shape[-1:] == (cls.width,) else x

        return tuple(map(label, out)) if keeps and isinstance(out, tuple) else label(out)

    def __deepcopy__(self, memo: dict) -> Self:
        """A copy with its own memory, still a parameter where this is one."""
        copy = self.detach().clone().requires_grad_(self.requires_grad)
        if getattr(self, "_is_param", False):
            copy._is_param = True
        return memo.setdefault(id(self), copy)

    @property
    def lshape(self) -> torch.Size:
        """The shape without the last dimension."""
        return self.shape[:-1]

    def tensor(self) -> Tensor:
        """The numbers as a plain tensor ``(..., width)``, in the same graph."""
        return self.as_subclass(Tensor)


class se3(LieTensor):  # noqa: N801  (PyPose's name)
    """Twists ``[rho, phi] (..., 6)``: translation first, then rotation vector; m and rad."""

    width = 6
    keeps = ROWS | ARITHMETIC

    def Exp(self) -> "SE3":
        """The poses reached by these twists in time 1."""
        return se3_exp(self.tensor()).as_subclass(SE3)


class SE3(LieTensor):
    """Poses ``[t, q] (..., 7)``: translation, then unit quaternion x, y, z, w.

    Raises:
        ValueError: a row is not 7 finite numbers, or its quaternion's length is not 1 to 1e-3.
    """

    width = 7
    keeps = ROWS

    def __new__(cls, data: Any) -> Self:
        """Takes what `LieTensor` takes."""
        T = super().__new__(cls, data)
        length = safe_norm(T.tensor().detach()[..., 3:])
        if ((length - 1).abs() > 1e-3).any():
            worst = length.flatten()[(length - 1).abs().argmax()].item()
            raise ValueError(
                f"SE3: expected [t, q] with a unit quaternion x, y, z, w, got length {worst:.4g}"
            )
        return T

    def Log(self) -> se3:
        """The twists that reach these poses in time 1, rotating by pi at most."""
        return se3_log(self.tensor()).as_subclass(se3)

    def Inv(self) -> Self:
        """The poses the other way round: T_ba of T_ab."""
        return se3_inverse(self.tensor()).as_subclass(type(self))

    def Act(self, p: Tensor) -> Tensor:
        """The points ``p (..., 3)``, rotated and then moved."""
        return se3_act(self.tensor(), p)

    def Adj(self, a: Tensor) -> se3:
        """The twists ``b`` with ``T Exp(a) = Exp(b) T`` for ``a (..., 6)``."""
        return bmv(se3_adjoint(self.tensor()), a.as_subclass(Tensor)).as_subclass(se3)

    def __matmul__(self, other: Any) -> Any:
        """``T_ab @ T_bc = T_ac``, ``T_ab @ p_b = p_a``."""
        if isinstance(other, SE3):
            return se3_compose(self.tensor(), other.tensor()).as_subclass(type(self))
        if isinstance(other, se3) or not isinstance(other, Tensor):
            return NotImplemented
        return self.Act(other)

    __mul__ = __matmul__

    def translation(self) -> Tensor:
        """The translations ``(..., 3)``, m."""
        return self.tensor()[..., :3]

    def rotation(self) -> Tensor:
        """The unit quaternions x, y, z, w ``(..., 4)``."""
        return self.tensor()[..., 3:]

    def matrix(self) -> Tensor:
        """The homogeneous matrices ``(..., 4, 4)``."""
        return se3_matrix(self.tensor())


def is_SE3(x: object) -> bool:
    """Whether ``x`` is a tensor of poses."""
    return isinstance(x, SE3)


def identity_SE3(*lshape: int, **options: Any) -> SE3:
    """Poses ``(*lshape, 7)`` that move nothing; ``options`` are those of `torch.zeros`."""
    return se3(torch.zeros(*lshape, 6, **options)).Exp()


def randn_SE3(
    *lshape: int,
    sigma: float | tuple[float, float] = 1.0,
    generator: Generator | None = None,
    requires_grad: bool = False,
    **options: Any,
) -> SE3:
    """Random poses ``(*lshape, 7)``: `se3_exp` of normal twists, as PyPose draws them.

    Args:
        lshape: the shape of the batch.
        sigma: standard deviation of rho (m) and of the angle (rad) about a uniform axis, or one
            for each.
        generator: where the numbers come from.
        requires_grad: whether the poses are a leaf to differentiate with respect to.
        options: dtype and device.
    """
    spread = sigma if isinstance(sigma, tuple) else (sigma, sigma)
    draw = torch.randn(*lshape, 7, generator=generator, **options)
    axis = draw[..., 3:6] / safe_norm(draw[..., 3:6], keepdim=True)
    xi = torch.cat([spread[0] * draw[..., :3], spread[1] * draw[..., 6:] * axis], -1)
    poses = se3(xi).Exp()
    poses.requires_grad_(requires_grad)
    return poses
