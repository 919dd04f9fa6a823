"""What a lab is graded by. A key stays with the teacher: its seed draws the hidden numbers."""

import ast
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..checks import Exercise


@dataclass(frozen=True)
class Task:
    """An exercise of a lab, as far as grading needs it.

    ``answer`` is the expression that the lab hands to its check, such as ``line_search`` or
    ``(lower, upper)``; ``seconds`` is what the check may take.
    """

    number: str
    title: str
    points: int
    seconds: float
    answer: str

    @property
    def id(self) -> str:
        """The number in letters that every kit allows: ``3-2``."""
        return self.number.replace(".", "-")


@dataclass(frozen=True)
class Key:
    """A lab's tasks, and the numbers on which answers are tried.

    Args:
        lab: its name, ``"03_mpc"``; the submission is ``03_mpc.ipynb``.
        seed: of the hidden numbers and shapes; 0 are those of the public checks.
        tasks: in the order of the lab.
        cell_seconds: that a cell of the notebook may take.
        seconds: that the whole submission may take.
    """

    lab: str
    seed: int
    tasks: tuple[Task, ...]
    cell_seconds: float = 60.0
    seconds: float = 900.0

    def write(self, path: Path) -> None:
        """Writes the key as JSON."""
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")

    @staticmethod
    def read(path: Path) -> "Key":
        """Returns the key that ``write`` has written."""
        return Key.made_of(json.loads(path.read_text(encoding="utf-8")))

    @staticmethod
    def made_of(fields: dict[str, Any]) -> "Key":
        """Returns the key of these fields, as JSON has them."""
        return Key(**{**fields, "tasks": tuple(Task(**task) for task in fields["tasks"])})


def key_of(lab: str, codes: Iterable[str], exercises: Iterable[Exercise], seed: int) -> Key:
    """Returns the key of a lab.

    Args:
        lab: its name.
        codes: the sources of its code cells; their calls of ``check`` name the answers.
        exercises: that its checks know.
        seed: of the hidden numbers.

    Raises:
        ValueError: an exercise is never checked.
    """
    answers = {number: answer for code in codes for number, answer in checks_in(code).items()}
    exercises = list(exercises)
    if missing := [e.number for e in exercises if e.number not in answers]:
        raise ValueError(f"{lab}: expected a check of each exercise, got none of {missing}")
    tasks = [Task(e.number, e.title, e.points, e.seconds, answers[e.number]) for e in exercises]
    return Key(lab, seed, tuple(tasks))


def checks_in(code: str) -> dict[str, str]:
    """Returns the calls ``check("3.2", answer)`` in a cell: their answers' source, by number.

    A cell that is no Python, as with magics or a mistake, has none.
    """
    try:
        calls = [node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Call)]
    except (SyntaxError, ValueError):
        return {}
    checks = [c for c in calls if isinstance(c.func, ast.Name) and c.func.id == "check"]
    return {
        str(call.args[0].value): ast.unparse(call.args[1])
        for call in checks
        if len(call.args) > 1 and isinstance(call.args[0], ast.Constant)
    }
