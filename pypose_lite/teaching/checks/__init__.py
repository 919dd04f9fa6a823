"""The checks of the labs: ``check("2.1", answer)`` and ``progress()``.

``exercise`` says what an exercise is, ``expect`` holds the usual properties, ``given`` the numbers
that an answer is tried on, and a file a chapter what its answers must do. ``run`` judges: it is
imported when it is first asked for, since it needs torch and reading verdicts does not.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .exercise import EXERCISES, Exercise, Failure, chapter, find
from .verdict import Verdict, verdicts_in, verdicts_of

if TYPE_CHECKING:
    from . import expect
    from .run import check, judge, progress

__all__ = [
    "EXERCISES",
    "Exercise",
    "Failure",
    "Verdict",
    "chapter",
    "check",
    "expect",
    "find",
    "judge",
    "progress",
    "verdicts_in",
    "verdicts_of",
]


def __getattr__(name: str) -> Any:
    """Imports what judges, when it is first asked for."""
    if name in ("check", "judge", "progress"):
        return getattr(import_module(".run", __name__), name)
    if name == "expect":
        return import_module(".expect", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
