"""For pytest: a test an exercise, so that ``--junitxml`` reports what was accepted.

A test file is two lines::

    from pypose_lite.teaching.grading.with_pytest import graded_by
    test_exercise = graded_by(Path(__file__).with_name("key.json"))
"""

import functools
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from ..checks import Verdict
from .grade import grade
from .key import Key


def graded_by(path: Path) -> Callable:
    """Returns the tests of a lab; ``SUBMISSION`` in the environment is the notebook's path."""
    key = Key.read(path)
    submission = Path(os.environ.get("SUBMISSION", f"{key.lab}.ipynb"))

    @functools.cache
    def verdicts() -> dict[str, Verdict]:
        return {verdict.number: verdict for verdict in grade(submission, key)}

    @pytest.mark.parametrize("number", [task.number for task in key.tasks])
    def test_exercise(number: str, record_property: Callable) -> None:
        verdict = verdicts()[number]
        record_property("points", verdict.points)
        record_property("max_points", verdict.out_of)
        if not verdict.passed:
            pytest.fail(verdict.message, pytrace=False)

    return test_exercise
