"""The same classes under PyPose's names, so that ``pp.module.MPC`` reads as it does there."""

from .control import LQR, MPC
from .filters import EKF, PF, UKF
from .systems import LTI, LTV, NLS, System

__all__ = ["EKF", "LQR", "LTI", "LTV", "MPC", "NLS", "PF", "UKF", "System"]
