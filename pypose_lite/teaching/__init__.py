"""What the notebooks use beside the library: claims, plots, tables, films, sliders, checks.

The library itself never imports this package.
"""

from . import plotting, widgets
from .animation import animate
from .checks import check, progress
from .claims import claim
from .tables import table

__all__ = ["animate", "check", "claim", "plotting", "progress", "table", "widgets"]
