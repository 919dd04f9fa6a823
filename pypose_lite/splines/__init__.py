"""Smooth curves through waypoints and poses, and what a car asks of them.

| curve                        | passes its points | continuous      | a point is felt   |
|------------------------------|-------------------|-----------------|-------------------|
| `chspline` (Catmull-Rom)     | yes               | tangent         | in four segments  |
| `cubic_spline` (natural ...) | yes               | curvature, too  | everywhere        |
| `bspline` (uniform B-spline) | no                | curvature, too  | in four segments  |
| `planner.path`               | yes, with heading | direction       | in two segments   |

``chspline(points, interval)`` and ``bspline(data, interval)`` give samples; `hermite`,
`cubic_spline`, `uniform_bspline` and `planner.path` give a `Spline`, to be evaluated anywhere:
``spline(t, derivative=1)``.
"""

from .b_spline import bspline, uniform_bspline
from .cubic_hermite import chspline, hermite, hermite_segments
from .curve import Spline
from .geometry import curvature, heading
from .length import arc_length, evenly_spaced, parameter_at
from .natural_cubic import cubic_spline
from .planner import local_plan

__all__ = [
    "Spline",
    "arc_length",
    "bspline",
    "chspline",
    "cubic_spline",
    "curvature",
    "evenly_spaced",
    "heading",
    "hermite",
    "hermite_segments",
    "local_plan",
    "parameter_at",
    "uniform_bspline",
]
