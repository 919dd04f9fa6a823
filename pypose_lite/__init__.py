"""pypose_lite: robot motion in small, readable torch code; `book/` explains every line.

The public names, in the order of the book.
"""

from . import infinity, module, utils
from .lqr import LQR
from .models import CartPole, DubinsCar, Pendulum
from .mpc import MPC, Plan, shift
from .riccati import dlqr
from .shapes import bmv, bvmv, bvv
from .systems import LTI, LTV, NLS, Linearization, System
from .version import __version__

__all__ = [
    "LQR",
    "LTI",
    "LTV",
    "MPC",
    "NLS",
    "CartPole",
    "DubinsCar",
    "Linearization",
    "Pendulum",
    "Plan",
    "System",
    "__version__",
    "bmv",
    "bvmv",
    "bvv",
    "dlqr",
    "infinity",
    "module",
    "shift",
    "utils",
]
