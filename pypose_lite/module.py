"""The same classes under PyPose's names, so that ``pp.module.LTI`` reads as it does there."""

from .systems import LTI, LTV, NLS, System

__all__ = ["LTI", "LTV", "NLS", "System"]
