"""For nbgrader: its step that executes a notebook is replaced by ours, which grades it.

nbgrader restores the cells that a student may not change, and afterwards reads the points from the
outputs of the checks' cells. In between, no kernel is started: the outputs are our verdicts.
``nbgrader_config.py`` says so::

    c.Autograde.autograde_preprocessors = with_nbgrader.STEPS
    c.Grade.keys = "keys"
"""

from pathlib import Path

from nbconvert.preprocessors import ClearMetadataPreprocessor
from nbformat.v4 import new_output
from nbgrader.preprocessors import (
    AssignLatePenalties,
    CheckCellMetadata,
    NbGraderPreprocessor,
    SaveAutoGrades,
)
from traitlets import Unicode

from ..checks import Verdict
from .grade import grade
from .key import Key, Task


class Grade(NbGraderPreprocessor):
    """Puts the verdicts into the cells of the checks."""

    keys = Unicode("keys", help="The folder of the keys, seen from the course's.").tag(config=True)

    def preprocess(self, nb, resources):
        """Returns the notebook with our outputs, and no others."""
        key = Key.read(Path(self.keys) / f"{resources['nbgrader']['notebook']}.json")
        verdicts = {check_id(task): verdict for task, verdict in zip(key.tasks, grade(nb, key))}
        for cell in nb.cells:
            if cell.cell_type == "code":
                verdict = verdicts.get(cell.metadata.get("nbgrader", {}).get("grade_id"))
                cell.outputs = [shown(verdict)] if verdict else []
        return nb, resources


STEPS = [Grade, ClearMetadataPreprocessor, SaveAutoGrades, AssignLatePenalties, CheckCellMetadata]


def shown(verdict: Verdict):
    """Returns the output that nbgrader takes for all points, or for none: an error."""
    if verdict.passed:
        return new_output("display_data", {"text/plain": str(verdict)})
    lines = str(verdict).splitlines()
    return new_output("error", ename="Verdict", evalue=lines[0], traceback=lines)


def check_id(task: Task) -> str:
    """The name by which nbgrader knows the cell of a check."""
    return f"check-{task.id}"


def check_cell(task: Task) -> dict:
    """Returns nbgrader's metadata of the cell with a check: locked, and worth points."""
    return {**_cell(check_id(task)), "grade": True, "locked": True, "points": task.points}


def answer_cell(task: Task) -> dict:
    """Returns nbgrader's metadata of the cell with the answer."""
    return {**_cell(f"answer-{task.id}"), "solution": True}


def _cell(name: str) -> dict:
    fields = {"grade": False, "locked": False, "solution": False, "task": False}
    return {**fields, "grade_id": name, "schema_version": 3}
