"""What the notebooks use beside the library: claims, plots, tables, films, sliders, proofreading.

The library itself never imports this package.
"""

from . import plotting, widgets
from .animation import animate
from .claims import claim
from .tables import table

__all__ = ["animate", "claim", "plotting", "table", "widgets"]
