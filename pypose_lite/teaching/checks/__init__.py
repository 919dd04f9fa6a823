"""The checks of the labs: ``check("2.1", answer)`` and ``progress()``.

``exercise`` says what an exercise is, ``expect`` holds the usual properties, ``given`` the numbers
that an answer is tried on, and a file a chapter what its answers must do. ``run`` judges.
"""

from . import expect
from .exercise import EXERCISES, Exercise, Failure, chapter, find
from .run import check, judge, progress
from .verdict import Verdict, verdicts_in, verdicts_of

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
