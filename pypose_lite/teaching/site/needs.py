"""Which exercises of a lab use what others define: the answer of one, or a cell that is given."""

import ast
from itertools import chain

from .exercises import cells_of


def needs_in(lab: str) -> dict[str, list[str]]:
    """Returns, for each exercise that needs others of its lab, their numbers.

    It needs them where its code reads a name that it does not bind itself, that the lab's beginning
    does not bind either, and that a cell of theirs does.

    Args:
        lab: its text, a jupytext file with solutions.
    """
    cells: dict[str, list[ast.Module]] = {}
    for cell in cells_of(lab):
        if cell.header.startswith("# %%") and "[markdown]" not in cell.header:
            cells.setdefault(cell.exercise, []).append(ast.parse(cell.text))
    given = {number: set(chain(*map(_defined, trees))) for number, trees in cells.items()}
    found = {}
    for number, trees in cells.items():
        own = set(chain(*map(_bound, trees))) | given.get("", set())
        missing = set(chain(*map(_read, trees))) - own
        others = [n for n, names in given.items() if n not in ("", number) and names & missing]
        if number and others:
            found[number] = others
    return found


def _defined(tree: ast.Module) -> set[str]:
    """The names that a cell leaves behind."""
    left = set()
    for line in tree.body:
        if isinstance(line, ast.FunctionDef | ast.ClassDef):
            left.add(line.name)
        else:
            left |= _bound(line)
    return left


def _bound(tree: ast.AST) -> set[str]:
    """The names that are bound anywhere in a piece of code, arguments of functions included."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
            found.add(node.id)
        elif isinstance(node, ast.arg):
            found.add(node.arg)
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.alias):
            found.add((node.asname or node.name).split(".")[0])
    return found


def _read(tree: ast.AST) -> set[str]:
    """The names that a piece of code reads."""
    names = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
    return {name.id for name in names if isinstance(name.ctx, ast.Load)}
