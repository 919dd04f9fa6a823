"""pypose_lite: robot motion in small, readable torch code; `book/` explains every line.

The public names, in the order of the book.
"""

from .version import __version__

__all__ = ["__version__"]
