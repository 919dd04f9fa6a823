"""pypose_lite: robot motion in small, readable torch code; `book/` explains every line.

The public names, in the order of the book. A name is imported when it is first asked for, so that
the robot's part, ``pypose_lite.go1``, runs on a small computer without torch.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import control, filters, go1, infinity, lie, module, splines, systems, utils
    from .control import LQR, MPC, Plan, dlqr, input_rates, shift
    from .filters import EKF, PF, UKF, smooth
    from .lie import (
        SE3,
        SO3,
        Act,
        Adj,
        AdjT,
        Exp,
        Inv,
        LieTensor,
        Log,
        Mul,
        Retr,
        euler,
        euler2SO3,
        identity_SE3,
        identity_se3,
        identity_SO3,
        identity_so3,
        is_lietensor,
        is_SE3,
        is_se3,
        is_SO3,
        is_so3,
        mat2SE3,
        mat2SO3,
        randn_SE3,
        randn_se3,
        randn_SO3,
        randn_so3,
        se3,
        so3,
    )
    from .linalg import bmv, bvmv, bvv
    from .splines import bspline, chspline, local_plan, planner
    from .systems import LTI, LTV, NLS, CartPole, DubinsCar, Legs, Linearization, Pendulum, System

__version__ = "0.1.0"

_ROOMS = {
    "systems": ["System", "NLS", "LTI", "LTV", "Linearization"]
    + ["DubinsCar", "Legs", "Pendulum", "CartPole"],
    "control": ["LQR", "MPC", "Plan", "dlqr", "input_rates", "shift"],
    "filters": ["EKF", "UKF", "PF", "smooth"],
    "lie": ["SO3", "so3", "SE3", "se3", "LieTensor"]
    + ["Exp", "Log", "Inv", "Mul", "Act", "Adj", "AdjT", "Retr"]
    + ["mat2SO3", "mat2SE3", "euler2SO3", "euler"]
    + ["identity_SO3", "identity_so3", "identity_SE3", "identity_se3"]
    + ["randn_SO3", "randn_so3", "randn_SE3", "randn_se3"]
    + ["is_SO3", "is_so3", "is_SE3", "is_se3", "is_lietensor"],
    "splines": ["bspline", "chspline", "local_plan", "planner"],
    "linalg": ["bmv", "bvv", "bvmv"],
    "infinity": [],
    "go1": [],
    "module": [],
    "utils": [],
}
_ROOM_OF = {name: room for room, names in _ROOMS.items() for name in names}

__all__ = [
    "__version__",
    *(room for room in _ROOMS if room != "linalg"),
    *_ROOM_OF,
]


def __getattr__(name: str) -> Any:
    """Imports the room of a public name, or the room itself, when it is first asked for."""
    if name in _ROOM_OF:
        value = getattr(import_module(f".{_ROOM_OF[name]}", __name__), name)
    elif name in _ROOMS:
        value = import_module(f".{name}", __name__)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
