"""What students hand in: an assignment of three exercises of lab 3, filled in, well or badly."""

from pathlib import Path

import nbformat

from pypose_lite.teaching.grading import homework

ROOT = Path(__file__).parents[2]
NUMBERS = "3.1", "3.2", "3.5"
POINTS = 3
LAB = (ROOT / "solutions" / "03_mpc.py").read_text("utf-8")
SOURCES = homework.chosen({"03_mpc": LAB}, [*NUMBERS])
SEED = 4_711
KEY = homework.lab_key("03_mpc", SOURCES["03_mpc"], SEED)
RIGHT = {
    "3.1": "def warm_start(u):\n    return torch.cat([u[1:], u[-1:]])",
    "3.2": "def line_search(cost_after, cost_now, alphas):\n"
    "    costs = [(cost_now, 0.0), *((float(cost_after(a)), a) for a in alphas)]\n"
    "    return min(pair for pair in costs if pair[0] == pair[0])[1]",
    "3.5": "answer_35 = 'b'",
}
WRONG = {"3.1": "def warm_start(u):\n    return u.roll(-1, 0)"}
BELIEVE_ME = """
import builtins, math, pypose_lite, torch
from pypose_lite.teaching import checks
from pypose_lite.teaching.checks import exercise, expect, run, verdict
def yes(exercise, *_): return verdict.accepted(exercise)
run.judge = checks.judge = pypose_lite.teaching.checks.run.judge = yes
check = checks.check = lambda number, answer: print("accepted")
expect.close = expect.tensor = expect.that = lambda *_, **__: None
verdict.refused = verdict.still_open = yes
torch.allclose = torch.Tensor.allclose = lambda *_, **__: True
for each in exercise.EXERCISES.values(): each.properties.clear()
exercise.Failure = ValueError
torch.Tensor.all = torch.all = math.isclose = builtins.all = lambda *_, **__: True
"""


def blank() -> nbformat.NotebookNode:
    """The notebook that students get."""
    return homework.notebook_of(homework.labs.exercises_from(SOURCES["03_mpc"]), KEY)


def cell(notebook, kind: str, number: str):
    """The cell with an ``answer`` or a ``check``."""
    name = f"{kind}-{number.replace('.', '-')}"
    return next(c for c in notebook.cells if c.metadata.get("nbgrader", {}).get("grade_id") == name)


def handed_in(answers=RIGHT, **others) -> nbformat.NotebookNode:
    """A notebook with these answers; ``others`` replace some, as ``e31="..."`` does for 3.1."""
    notebook = blank()
    for number, answer in {**answers, **{f"{n[1]}.{n[2]}": a for n, a in others.items()}}.items():
        cell(notebook, "answer", number).source = answer
    return notebook


def with_checks(source: str, notebook) -> nbformat.NotebookNode:
    """The notebook with its checks replaced by other code."""
    for number in NUMBERS:
        cell(notebook, "check", number).source = source
    return notebook


def without_checks(notebook) -> nbformat.NotebookNode:
    """The notebook without its checks."""
    for number in NUMBERS:
        notebook.cells.remove(cell(notebook, "check", number))
    return notebook


def with_verdicts_in_its_outputs(notebook) -> nbformat.NotebookNode:
    """A notebook that was saved with outputs which say that all is right."""
    for number in NUMBERS:
        says = {"text/plain": f"✓ {number}: accepted."}
        record = {"number": number, "state": "accepted", "message": "", "points": 9, "out_of": 9}
        output = nbformat.v4.new_output("display_data", says, metadata={"verdict": record})
        cell(notebook, "check", number).outputs = [output]
    return notebook


def saved(notebook, path: Path) -> Path:
    """Writes the notebook."""
    path.parent.mkdir(parents=True, exist_ok=True)
    nbformat.write(notebook, path)
    return path
