"""Rules for code: it fits on a screen, does one thing a line, and needs nothing that is folded."""

import ast
import builtins
import re
from collections.abc import Iterator
from typing import Any

from .fault import Fault, code_cells, tags

LINES, MOST_LINES = 20, 40  # of a code cell that is read, and of one that is folded
COLUMNS = 86  # more need a scrollbar
FOLDED = {"setup", "hide-input", "claims", "answer", "remove-cell"}
KNOWN = frozenset(dir(builtins)) | {"display", "get_ipython"}


def parsed(cell: Any) -> ast.Module:
    """The syntax tree of a cell; an empty one where it is no Python."""
    source = re.sub(r"^[%!].*$", "pass", cell.source, flags=re.MULTILINE)
    try:
        return ast.parse(source)
    except SyntaxError:
        return ast.Module([], [])


def long_cells(notebook: Any) -> Iterator[Fault]:
    """Yields each code cell of more than 20 lines, blank ones included; folded, of 40."""
    for k, cell in code_cells(notebook):
        lines = len(cell.source.strip().splitlines())
        most = MOST_LINES if FOLDED & tags(cell) else LINES
        if lines > most:
            text = f"a code cell has {lines} lines, more than {most}: say it in fewer, or make two"
            yield Fault(k, 0, text)


def wide_lines(notebook: Any) -> Iterator[Fault]:
    """Yields each line of code that needs a scrollbar on the page: of more than 86 columns."""
    for k, cell in code_cells(notebook):
        for number, line in enumerate(map(str.rstrip, cell.source.splitlines())):
            if len(line) > COLUMNS:
                text = f"a line of code has {len(line)} columns, more than {COLUMNS}: break it, or "
                yield Fault(k, number, f"{text}give a part of it a name: {line.strip()!r}")


def statements(notebook: Any) -> Iterator[Fault]:
    """Yields what makes a line of visible code do two things: ``;``, ``:=``, ``a, b = 1, 2``.

    A cell with the tag ``as-printed``, a listing of somebody else, stays as it is.
    """
    for k, cell in code_cells(notebook):
        if tags(cell) & (FOLDED - {"answer"} | {"as-printed"}):
            continue
        begun: set[int] = set()
        for node in ast.walk(parsed(cell)):
            line = getattr(node, "lineno", 0) - 1
            if isinstance(node, ast.stmt):
                if line in begun:
                    yield Fault(k, line, "two statements on a line: give each its own")
                begun.add(line)
            if isinstance(node, ast.NamedExpr):
                yield Fault(k, line, ":= in an expression: give the assignment its own line")
            if isinstance(node, ast.Assign) and _packs(node):
                yield Fault(k, line, "a tuple assigned to a tuple: give each name its own line")


def _packs(node: ast.Assign) -> bool:
    """Whether an assignment makes the tuple that it takes apart."""
    return isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple | ast.List)


def folded_names(notebook: Any) -> Iterator[Fault]:
    """Yields each name in a visible cell that only a folded cell before it defines.

    The set-up is excepted, and folded cells may use what folded cells define.
    """
    seen, hidden = set(KNOWN), set[str]()
    for k, cell in code_cells(notebook):
        tree, folded = parsed(cell), FOLDED & tags(cell)
        if not folded:
            yield from _hidden_names(k, tree, hidden - seen)
        if folded and "setup" not in folded:
            hidden |= defined(tree)
        else:
            seen |= defined(tree)


def _hidden_names(k: int, tree: ast.Module, hidden: set[str]) -> Iterator[Fault]:
    """The first use of each hidden name in a cell that does not define it itself."""
    own = defined(tree, deeply=True)
    for node in sorted(_names(tree), key=lambda node: (node.lineno, node.col_offset)):
        if isinstance(node.ctx, ast.Load) and node.id in hidden - own:
            hidden = hidden - {node.id}
            text = f"visible code uses {node.id!r}, which only a folded cell defines: show it"
            yield Fault(k, node.lineno - 1, text)


def _names(tree: ast.AST) -> list[ast.Name]:
    return [node for node in ast.walk(tree) if isinstance(node, ast.Name)]


def defined(tree: ast.Module, deeply: bool = False) -> set[str]:
    """The names that a cell defines; ``deeply``: also those within its functions."""
    found = set()
    todo: list[ast.AST] = list(tree.body)
    while todo:
        node = todo.pop()
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
            todo += list(ast.iter_child_nodes(node)) if deeply else []
            continue
        if isinstance(node, ast.Import | ast.ImportFrom):
            found |= {(each.asname or each.name).split(".")[0] for each in node.names}
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            found.add(node.id)
        if isinstance(node, ast.arg):
            found.add(node.arg)
        inner = isinstance(node, ast.Lambda | ast.ListComp | ast.DictComp | ast.GeneratorExp)
        todo += list(ast.iter_child_nodes(node)) if deeply or not inner else []
    return found
