"""pypose_lite: robot motion in small, readable torch code; `book/` explains every line.

The public names, in the order of the book.
"""

from . import module, utils
from .models import CartPole, DubinsCar, Pendulum
from .shapes import bmv, bvmv, bvv
from .systems import LTI, LTV, NLS, Linearization, System
from .version import __version__

__all__ = [
    "LTI",
    "LTV",
    "NLS",
    "CartPole",
    "DubinsCar",
    "Linearization",
    "Pendulum",
    "System",
    "__version__",
    "bmv",
    "bvmv",
    "bvv",
    "module",
    "utils",
]
