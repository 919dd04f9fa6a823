"""Smooth curves through waypoints and poses: `chspline`, `bspline`, and what a car asks of them.

``chspline(points, interval)`` and ``bspline(data, interval)`` give samples; `hermite` and
`uniform_bspline` give the curve itself, to be evaluated anywhere: ``spline(t, derivative=1)``.
"""

from .cubic import bspline, chspline, hermite, hermite_segments, uniform_bspline
from .curve import Spline
from .geometry import arc_length, curvature, evenly_spaced, heading, parameter_at
from .planner import local_plan

__all__ = [
    "Spline",
    "arc_length",
    "bspline",
    "chspline",
    "curvature",
    "evenly_spaced",
    "heading",
    "hermite",
    "hermite_segments",
    "parameter_at",
    "local_plan",
    "parameter_at",
    "uniform_bspline",
]
