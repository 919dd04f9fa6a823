"""Verdicts in the JSON that courses' platforms read."""

import os
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from ..checks import Verdict
from .key import Key


def prairielearn(key: Key, verdicts: Sequence[Verdict]) -> dict[str, Any]:
    """Returns what PrairieLearn expects in ``/grade/results/results.json``.

    Source: PrairieLearn's documentation, "External grading", section "Grading results".
    """
    tests = [
        {
            "name": f"{task.number} {task.title}",
            "points": verdict.points,
            "max_points": verdict.out_of,
            "message": verdict.message,
        }
        for task, verdict in zip(key.tasks, verdicts)
    ]
    score = sum(v.points for v in verdicts) / sum(v.out_of for v in verdicts)
    return {"gradable": True, "score": score, "tests": tests}


def classroom50(key: Key, verdicts: Sequence[Verdict]) -> dict[str, Any]:
    """Returns what Classroom 50 expects in ``result.json``; its runner says the rest by variables.

    Source: Classroom 50's documentation, "Advanced autograding", schema ``classroom50/result/v1``.
    """
    tests = [
        {
            "test-name": f"{task.number} {task.title}",
            "passed": verdict.passed,
            "score": verdict.points,
            "max-score": verdict.out_of,
        }
        for task, verdict in zip(key.tasks, verdicts)
    ]
    variable = os.environ.get
    commit = variable("COMMIT_URL", "")
    return {
        "schema": "classroom50/result/v1",
        "classroom": variable("CLASSROOM", ""),
        "assignment": variable("ASSIGNMENT", key.lab),
        "submission": variable("SUBMISSION_TAG", ""),
        "commit": commit,
        "release": variable("RELEASE_URL", ""),
        "review": variable("REVIEW_URL") or commit,
        "datetime": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "score": sum(verdict.points for verdict in verdicts),
        "max-score": sum(verdict.out_of for verdict in verdicts),
        "tests": tests,
    }


FORMS = {"prairielearn": prairielearn, "classroom50": classroom50}
