"""Optimal control: the linear quadratic regulator, and model predictive control by iterative LQR.

Chapters 2 and 3 build it; chapter 8 differentiates it. Read `riccati`, then `sweep`, then `ilqr`.
"""

from .dlqr import dlqr
from .lqr import LQR
from .mpc import MPC, Plan, shift
from .rates import InputRates, input_rates

__all__ = ["LQR", "MPC", "InputRates", "Plan", "dlqr", "input_rates", "shift"]
