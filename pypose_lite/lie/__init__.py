"""The groups of rotations and poses, as functions and as tensors with PyPose's names.

Each group ``G`` of ``so2 se2 so3 se3`` has ``G_exp`` (tangent to group), ``G_log`` (back),
``G_compose``, ``G_inverse``, ``G_act`` (on points), ``G_matrix`` and ``G_adjoint``; all are
functions on tensors, batched and differentiable, also at the identity and at half a turn.

| group | element                 | tangent              |
|-------|-------------------------|----------------------|
| SO(2) | ``[cos, sin]``          | ``[phi]``            |
| SE(2) | ``[x, y, cos, sin]``    | ``[rho (2), phi]``   |
| SO(3) | ``[x, y, z, w]``, unit  | ``phi (3)``          |
| SE(3) | ``[t (3), x, y, z, w]`` | ``[rho (3), phi (3)]`` |

Tangents act on the right, in the frame of the moving body: ``T(t) = T0 exp(t xi)`` is what a
body with the constant body twist ``xi`` does.

`SO3`, `SE3` and their tangents `so3`, `se3` are tensors that have these functions as methods.
"""

from .angles import so3_euler, so3_from_euler
from .create import (
    euler2SO3,
    identity_SE3,
    identity_se3,
    identity_SO3,
    identity_so3,
    mat2SE3,
    mat2SO3,
    randn_SE3,
    randn_se3,
    randn_SO3,
    randn_so3,
)
from .functions import (
    Act,
    Adj,
    AdjT,
    Exp,
    Inv,
    Log,
    Mul,
    Retr,
    euler,
    is_lietensor,
    is_SE3,
    is_se3,
    is_SO3,
    is_so3,
)
from .plane import (
    se2_act,
    se2_adjoint,
    se2_compose,
    se2_exp,
    se2_inverse,
    se2_log,
    se2_matrix,
    so2_act,
    so2_adjoint,
    so2_compose,
    so2_exp,
    so2_inverse,
    so2_log,
    so2_matrix,
)
from .space import (
    se3_act,
    se3_adjoint,
    se3_bracket,
    se3_compose,
    se3_exp,
    se3_inverse,
    se3_log,
    se3_matrix,
    so3_act,
    so3_adjoint,
    so3_bracket,
    so3_compose,
    so3_exp,
    so3_inverse,
    so3_log,
    so3_matrix,
    so3_normalize,
)
from .tensor import SE3, SO3, LieAlgebra, LieGroup, LieTensor, se3, so3

__all__ = [
    "Act",
    "Adj",
    "AdjT",
    "Exp",
    "Inv",
    "LieAlgebra",
    "LieGroup",
    "LieTensor",
    "Log",
    "Mul",
    "Retr",
    "SE3",
    "SO3",
    "euler",
    "euler2SO3",
    "identity_SE3",
    "identity_SO3",
    "identity_se3",
    "identity_so3",
    "is_SE3",
    "is_SO3",
    "is_lietensor",
    "is_se3",
    "is_so3",
    "mat2SE3",
    "mat2SO3",
    "randn_SE3",
    "randn_SO3",
    "randn_se3",
    "randn_so3",
    "se2_act",
    "se2_adjoint",
    "se2_compose",
    "se2_exp",
    "se2_inverse",
    "se2_log",
    "se2_matrix",
    "se3",
    "se3_act",
    "se3_adjoint",
    "se3_bracket",
    "se3_compose",
    "se3_exp",
    "se3_inverse",
    "se3_log",
    "se3_matrix",
    "so2_act",
    "so2_adjoint",
    "so2_compose",
    "so2_exp",
    "so2_inverse",
    "so2_log",
    "so2_matrix",
    "so3",
    "so3_act",
    "so3_adjoint",
    "so3_bracket",
    "so3_compose",
    "so3_euler",
    "so3_exp",
    "so3_from_euler",
    "so3_inverse",
    "so3_log",
    "so3_matrix",
    "so3_normalize",
]
