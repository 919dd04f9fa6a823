"""What the notebooks use beside the library: claims, plots, pictures that move, proofreading.

The library itself never imports this package.
"""

from . import plotting, widgets
from .animation import animate
from .claims import claim

__all__ = ["animate", "claim", "plotting", "widgets"]
