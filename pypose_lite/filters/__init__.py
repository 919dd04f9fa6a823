"""State estimation: what is known of a state from noisy observations.

All filters share one convention: ``y[i]`` belongs to the state before step i, and
``x[i+1], P = f(x[i], y[i], u[i], P, Q, R)`` first corrects with it, then predicts.
"""

from .base import Filter
from .consistency import chi_square_interval, nees, nis
from .differences import angles, wrap
from .ekf import EKF
from .gaussian import Innovation
from .gaussian_filter import GaussianFilter
from .particles import Particles, multinomial, resample, systematic
from .pf import PF
from .smoother import smooth
from .ukf import UKF, sigma_points

__all__ = [
    "EKF",
    "PF",
    "UKF",
    "Filter",
    "GaussianFilter",
    "Innovation",
    "Particles",
    "angles",
    "chi_square_interval",
    "multinomial",
    "nees",
    "nis",
    "resample",
    "sigma_points",
    "smooth",
    "systematic",
    "wrap",
]
