"""Dynamical systems, linear and nonlinear, and the models of the book.

Chapter 1 builds :class:`System` from scratch.
"""

from .linear import LTI, LTV
from .models import CartPole, DubinsCar, Legs, Pendulum
from .nonlinear import NLS
from .system import Linearization, System

__all__ = [
    "LTI",
    "LTV",
    "NLS",
    "CartPole",
    "DubinsCar",
    "Legs",
    "Linearization",
    "Pendulum",
    "System",
]
