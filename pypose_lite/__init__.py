"""pypose_lite: robot motion in small, readable torch code; `book/` explains every line.

The public names, in the order of the book.
"""

from . import filters, infinity, lie, module, planner, splines, utils
from .batched import bmv, bvmv, bvv
from .filters import EKF, PF, UKF, smooth
from .lie import SE3, identity_SE3, is_SE3, randn_SE3, se3
from .linear import LTI, LTV
from .lqr import LQR
from .models import CartPole, DubinsCar, Pendulum
from .mpc import MPC, Plan, shift
from .planner import local_plan
from .riccati import dlqr
from .splines import bspline, chspline
from .systems import NLS, Linearization, System
from .version import __version__

__all__ = [
    "EKF",
    "LQR",
    "LTI",
    "LTV",
    "MPC",
    "NLS",
    "PF",
    "SE3",
    "UKF",
    "CartPole",
    "DubinsCar",
    "Linearization",
    "Pendulum",
    "Plan",
    "System",
    "__version__",
    "bmv",
    "bspline",
    "bvmv",
    "bvv",
    "chspline",
    "dlqr",
    "filters",
    "identity_SE3",
    "infinity",
    "is_SE3",
    "lie",
    "local_plan",
    "module",
    "planner",
    "randn_SE3",
    "se3",
    "shift",
    "smooth",
    "splines",
    "utils",
]
