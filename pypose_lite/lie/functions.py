"""PyPose's functions on rotations and poses: each calls the method of its name."""

from typing import Any

from torch import Tensor

from .tensor import SE3, SO3, LieAlgebra, LieGroup, LieTensor, se3, so3


def Exp(a: LieAlgebra) -> Any:
    """The element that the constant velocity ``a`` reaches in time 1."""
    return a.Exp()


def Log(X: LieGroup) -> Any:
    """The tangent ``a`` with ``Exp(a) = X``."""
    return X.Log()


def Inv(X: LieGroup | LieAlgebra) -> Any:
    """``X^-1``, or ``-a`` of a tangent."""
    return X.Inv()


def Mul(X: LieGroup, Y: Tensor) -> Any:
    """``X Y``, a product of two elements, or the points ``Y (..., 3)`` moved."""
    return X @ Y


def Act(X: LieGroup, p: Tensor) -> Tensor:
    """The points ``X p``, for ``p (..., 3)``."""
    return X.Act(p)


def Retr(X: LieGroup, a: Tensor) -> Any:
    """``Exp(a) X``."""
    return X.Retr(a)


def Adj(X: LieGroup, a: Tensor) -> Any:
    """``b`` with ``X Exp(a) = Exp(b) X``."""
    return X.Adj(a)


def AdjT(X: LieGroup, a: Tensor) -> Any:
    """``b`` with ``Exp(a) X = X Exp(b)``."""
    return X.AdjT(a)


def euler(X: LieGroup | LieAlgebra, eps: float = 2e-4) -> Tensor:
    """Roll, pitch and yaw ``(..., 3)``, rad, of rotations, poses or tangents."""
    return X.euler(eps)


def is_lietensor(x: object) -> bool:
    """Whether ``x`` is a tensor of rotations, poses or tangents."""
    return isinstance(x, LieTensor)


def is_SO3(x: object) -> bool:
    """Whether ``x`` is a tensor of rotations."""
    return isinstance(x, SO3)


def is_SE3(x: object) -> bool:
    """Whether ``x`` is a tensor of poses."""
    return isinstance(x, SE3)


def is_so3(x: object) -> bool:
    """Whether ``x`` is a tensor of rotation vectors."""
    return isinstance(x, so3)


def is_se3(x: object) -> bool:
    """Whether ``x`` is a tensor of twists."""
    return isinstance(x, se3)
