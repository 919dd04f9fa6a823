"""Optimal control: the linear quadratic regulator, and model predictive control by iterative LQR.

Chapters 2 and 3 build it; chapter 8 differentiates it. Read `riccati`, then `sweep`, then `ilqr`.
"""

from .lqr import LQR
from .mpc import MPC, Plan, shift
from .riccati import dlqr

__all__ = ["LQR", "MPC", "Plan", "dlqr", "shift"]
