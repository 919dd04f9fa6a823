"""What an exercise shows before anybody has solved it: figures that do not need an answer.

Exercises are not run, since they stop at their first stub; their solutions are, and most of their
cells are the same.
"""

import ast
from typing import Any

from ..proofread.code import defined, parsed


def with_given_outputs(exercise: Any, solution: Any) -> Any:
    """Returns the exercise with the solution's outputs, but for those that depend on answers."""
    solved = {cell.source: cell for cell in _code(solution)}
    # The names that a student defines, and, below, those computed from them; verdicts on them.
    answers = _defined(_code(solution)) - _defined(_code(exercise)) | {"check", "progress"}
    for cell in _code(exercise):
        tree = parsed(cell)
        if cell.source in solved and not used(tree) & answers:
            cell.outputs = solved[cell.source].outputs
        else:
            answers |= defined(tree)
    return exercise


def used(tree: ast.Module) -> set[str]:
    """The names that a cell reads."""
    names = (node for node in ast.walk(tree) if isinstance(node, ast.Name))
    return {node.id for node in names if isinstance(node.ctx, ast.Load)}


def _code(notebook: Any) -> list[Any]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def _defined(cells: list[Any]) -> set[str]:
    return {name for cell in cells for name in defined(parsed(cell))}
