"""For otter-grader, and so for Gradescope: a plugin that grades before anything is executed.

It hands otter, in the place of the submission, a notebook that holds the verdicts and nothing else.
otter's tests, a file an exercise, only look them up; its results file is made from them.
"""

from pathlib import Path
from typing import Any

from nbformat.v4 import new_code_cell, new_notebook
from otter.plugins import AbstractOtterPlugin

from .grade import grade
from .key import Key, Task

NAME = f"{__name__}.Grade"
TEST = """\
OK_FORMAT = False

from otter.test_files import test_case

name = {name!r}


@test_case(points={points})
def accepted(verdicts):
    points, message = (verdicts or {{}}).get({number!r}, (0, "It was not graded."))
    assert points == {points}, message
"""


class Grade(AbstractOtterPlugin):
    """Replaces the submission by its verdicts; its configuration is the key."""

    def before_execution(self, submission: Any) -> Any:
        """Returns the notebook that otter executes."""
        key = Key.made_of(self.plugin_config)
        verdicts = grade(Path(self.submission_path), key)
        told = {verdict.number: (verdict.points, verdict.message) for verdict in verdicts}
        return new_notebook(cells=[new_code_cell(f"verdicts = {told!r}")])


def test_file(task: Task) -> str:
    """Returns otter's test of an exercise."""
    name = f"{task.number} {task.title}"
    return TEST.format(name=name, points=task.points, number=task.number)
