"""Rotations and poses as tensors with methods: PyPose's names, a thin layer over `space.py`.

| group | its tensor, rows of                 | its tangents                              |
|-------|-------------------------------------|-------------------------------------------|
| SO(3) | `SO3` (..., 4): x, y, z, w          | `so3` (..., 3): a rotation vector, rad    |
| SE(3) | `SE3` (..., 7): translation, x y z w | `se3` (..., 6): rho, then phi, m and rad |

A `LieTensor` is a tensor that knows what its rows mean. Taking rows, stacking and copying keep
that knowledge; every other operation gives a plain tensor. So do ``torch.vmap`` and ``torch.func``
with what they hand over: inside them, say ``pp.SE3(x)`` once more.

Source: the names are those of PyPose 0.9.5. Its gradients are those of a left perturbation; here
they are those of the numbers, which any optimizer of torch understands.
"""

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple, Self

import torch
from torch import Tensor

from ..linalg import bmv
from ..shapes import check, has_numbers
from . import space
from .angles import so3_euler
from .taylor import safe_norm

# What moves whole rows about, or copies them, and so leaves poses poses.
ROWS = frozenset(
    "__getitem__ broadcast_to cat chunk clone concat contiguous cpu cuda detach double expand "
    "expand_as flip float gather index_select movedim narrow permute repeat reshape roll split "
    "squeeze stack take_along_dim tile to transpose unbind unsqueeze view".split()
)
# What leaves tangents tangents: they are vectors.
ARITHMETIC = frozenset("add sub mul div neg mean sum".split())


class Operations(NamedTuple):
    """What a group can do, as functions on plain tensors."""

    exp: Callable[[Tensor], Tensor]
    log: Callable[[Tensor], Tensor]
    compose: Callable[[Tensor, Tensor], Tensor]
    inverse: Callable[[Tensor], Tensor]
    act: Callable[[Tensor, Tensor], Tensor]
    matrix: Callable[[Tensor], Tensor]
    adjoint: Callable[[Tensor], Tensor]
    bracket: Callable[[Tensor, Tensor], Tensor]


ROTATIONS = Operations(*(getattr(space, f"so3_{name}") for name in Operations._fields))
POSES = Operations(*(getattr(space, f"se3_{name}") for name in Operations._fields))


class LieTensor(Tensor):
    """A tensor of rows of a fixed width, elements of a group or tangents of it."""

    width: ClassVar[int]
    keeps: ClassVar[frozenset[str]]
    operations: ClassVar[Operations]

    def __new__(cls, data: Any) -> Self:
        """Takes a tensor, an array or nested lists ``(..., width)``; integers become floats."""
        x = torch.as_tensor(data).as_subclass(Tensor)
        x = x if x.is_floating_point() else x.to(torch.get_default_dtype())
        check(f"{cls.__name__}: n", x, n=cls.width)
        return x.as_subclass(cls)

    @classmethod
    def __torch_function__(cls, func, types, args=(), kwargs=None):
        """Runs ``func`` on plain tensors, and labels what comes back where rows were kept."""
        out = Tensor.__torch_function__(func, (), args, kwargs or {})
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

    def lview(self, *lshape: int) -> Any:
        """The same rows, with another shape of the batch."""
        return self.view(*lshape, self.width)

    def tensor(self) -> Tensor:
        """The numbers as a plain tensor ``(..., width)``, in the same graph."""
        return self.as_subclass(Tensor)


class LieAlgebra(LieTensor):
    """Tangents of a group: vectors, which can be added and scaled."""

    keeps = ROWS | ARITHMETIC
    group: ClassVar[type["LieGroup"]]

    def Exp(self) -> Any:
        """The element ``X`` that the constant velocity ``a`` reaches in time 1."""
        return self.operations.exp(self.tensor()).as_subclass(self.group)

    def Inv(self) -> Any:
        """``-a``, with ``Exp(-a) = Exp(a)^-1``."""
        return -self

    def matrix(self) -> Tensor:
        """The matrices of ``Exp(a)``."""
        return self.Exp().matrix()

    def euler(self, eps: float = 2e-4) -> Tensor:
        """Roll, pitch and yaw of ``Exp(a)``, as in `LieGroup.euler`."""
        return self.Exp().euler(eps)


class LieGroup(LieTensor):
    """Elements of a group, ``X_ab``: they take what is known in frame b to frame a."""

    keeps = ROWS
    algebra: ClassVar[type[LieAlgebra]]

    def __init_subclass__(cls, **kwargs):
        """Tells the tangents which group they belong to."""
        super().__init_subclass__(**kwargs)
        cls.algebra.group = cls

    def __new__(cls, data: Any) -> Self:
        """Takes what `LieTensor` takes, with quaternions of length 1 to within 1e-3."""
        X = super().__new__(cls, data)
        length = safe_norm(X.tensor().detach()[..., -4:])
        if has_numbers(length) and ((length - 1).abs() > 1e-3).any():
            worst = length.flatten()[(length - 1).abs().argmax()].item()
            raise ValueError(
                f"{cls.__name__}: expected rows that end with a unit quaternion x, y, z, w, "
                f"got length {worst:.4g}"
            )
        return X

    def Log(self) -> Any:
        """The tangent ``a`` with ``Exp(a) = X``, the one that rotates by pi at most."""
        return self.operations.log(self.tensor()).as_subclass(self.algebra)

    def Inv(self) -> Self:
        """``X_ba`` of ``X_ab``."""
        return self.operations.inverse(self.tensor()).as_subclass(type(self))

    def Act(self, p: Tensor) -> Tensor:
        """``p_a = X_ab p_b`` for points ``p_b (..., 3)``."""
        return self.operations.act(self.tensor(), p)

    def Retr(self, a: Tensor) -> Self:
        """``Exp(a) X``: X moved by the tangent ``a``, which is seen from the outer frame."""
        moved = self.operations.exp(a.as_subclass(Tensor))
        return self.operations.compose(moved, self.tensor()).as_subclass(type(self))

    def Adj(self, a: Tensor) -> Any:
        """``b`` with ``X Exp(a) = Exp(b) X``."""
        b = bmv(self.operations.adjoint(self.tensor()), a.as_subclass(Tensor))
        return b.as_subclass(self.algebra)

    def AdjT(self, a: Tensor) -> Any:
        """``b`` with ``Exp(a) X = X Exp(b)``: as in PyPose, `Adj` of the inverse."""
        return self.Inv().Adj(a)

    def matrix(self) -> Tensor:
        """The matrices: rotations ``(..., 3, 3)``, or homogeneous ones ``(..., 4, 4)``."""
        return self.operations.matrix(self.tensor())

    def euler(self, eps: float = 2e-4) -> Tensor:
        """Roll, pitch and yaw ``(..., 3)``, rad; see `so3_euler`."""
        return so3_euler(self.tensor()[..., -4:], eps)

    def __matmul__(self, other: Any) -> Any:
        """``X_ab @ X_bc = X_ac``, ``X_ab @ p_b = p_a``."""
        if not isinstance(other, LieTensor):
            return self.Act(other) if isinstance(other, Tensor) else NotImplemented
        if self.operations is not other.operations or not isinstance(other, LieGroup):
            left, right = type(self).__name__, type(other).__name__
            raise TypeError(f"{left} @ {right}: expected {left} or points (..., 3) on the right")
        return self.operations.compose(self.tensor(), other.tensor()).as_subclass(type(self))

    __mul__ = __matmul__

    def __add__(self, a: Any) -> Any:
        """``X + a = Exp(a) X``, as in PyPose."""
        return self.Retr(a) if isinstance(a, Tensor) else NotImplemented


class so3(LieAlgebra):  # noqa: N801  (PyPose's name)
    """Rotation vectors ``(..., 3)``: axis times angle, rad."""

    width, operations = 3, ROTATIONS


class se3(LieAlgebra):  # noqa: N801
    """Twists ``[rho, phi] (..., 6)``: translation first, then rotation vector; m and rad."""

    width, operations = 6, POSES


class SO3(LieGroup):
    """Rotations ``(..., 4)``: unit quaternions x, y, z, w; q and -q are the same rotation."""

    width, operations, algebra = 4, ROTATIONS, so3

    def rotation(self) -> "SO3":
        """The rotations themselves."""
        return self


class SE3(LieGroup):
    """Poses ``[t, q] (..., 7)``: translation, m, then unit quaternion x, y, z, w."""

    width, operations, algebra = 7, POSES, se3

    def translation(self) -> Tensor:
        """The translations ``(..., 3)``, m."""
        return self.tensor()[..., :3]

    def rotation(self) -> SO3:
        """The rotations ``(..., 4)``."""
        return self.tensor()[..., 3:].as_subclass(SO3)
