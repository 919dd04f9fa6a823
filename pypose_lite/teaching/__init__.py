"""What the notebooks use beside the library: claims, plots, tables, films, sliders, checks.

The library itself never imports this package. A name is imported when it is first asked for:
claims, figures, proofreading and the site need no torch.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import figures, plotting, widgets
    from .animation import animate
    from .checks import check, progress
    from .claims import claim
    from .tables import table

__all__ = ["animate", "check", "claim", "figures", "plotting", "progress", "table", "widgets"]

_ROOM_OF = {
    "animate": "animation",
    "check": "checks",
    "claim": "claims",
    "progress": "checks",
    "table": "tables",
}


def __getattr__(name: str) -> Any:
    """Imports a helper, or the module of this name, when it is first asked for."""
    if name in _ROOM_OF:
        return getattr(import_module(f".{_ROOM_OF[name]}", __name__), name)
    if name in __all__:
        return import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
