"""The same classes under PyPose's names, so that ``pp.module.MPC`` reads as it does there."""

from .filters import EKF, PF, UKF
from .linear import LTI, LTV
from .lqr import LQR
from .mpc import MPC
from .systems import NLS, System

__all__ = ["EKF", "LQR", "LTI", "LTV", "MPC", "NLS", "PF", "UKF", "System"]
