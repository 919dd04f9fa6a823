"""Rules for what is shown: figures say in words what they show, and claim; claims are made once."""

import ast
import re
from collections.abc import Iterator
from typing import Any

from ..checks import verdicts_of
from .code import parsed
from .fault import Fault, code_cells, line_of, tags, text_cells
from .prose import REFERENCE, section

FIGURE = re.compile(r"image/|video/|application/vnd\.jupyter\.widget-view")
PICTURE = re.compile(r"image/|video/")
ELEMENT = re.compile(r"<(?:img|svg|video)\b[^>]*>")
ALT = re.compile(r"\balt=([\"'])[^\"']*\w.*?\1")
DRAWERS = {"panels", "live", "animate"}  # functions of teaching that show, and take an alt=
SHOWERS = {"plotting.show", "figures.show", "plt.show"}
SHOWERS |= {"widgets.panels", "widgets.live", "animate"}
COMPUTES = (
    ast.Assign | ast.AugAssign | ast.AnnAssign | ast.For | ast.If | ast.With | ast.FunctionDef
)


def figures_without_claim(notebook: Any) -> Iterator[Fault]:
    """Yields each section (from one heading to the next) with a figure, and no claim or check."""
    title, first, claims = "the beginning", -1, 0
    for k, cell in [*enumerate(notebook.cells), (-1, None)]:
        heading = section(cell) if cell is not None else "the end"
        if heading and first >= 0 and not claims:
            text = f"section {title!r} shows a figure and claims nothing: add a claim(...) under it"
            yield Fault(first, 0, text)
        if heading:
            title, first, claims = heading, -1, 0
        if cell is not None and cell.cell_type == "code":
            outputs = cell.get("outputs", [])
            first = k if first < 0 and any(map(_is_figure, outputs)) else first
            made = [out.get("metadata", {}) for out in outputs]
            claims += any("claim" in each or "verdict" in each for each in made)


def figures_without_text(notebook: Any) -> Iterator[Fault]:
    """Yields each figure, slider and film that has no alternative text."""
    for k, cell in code_cells(notebook):
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            elements = ELEMENT.findall("".join(data.get("text/html", "")))
            if any(map(PICTURE.match, data)) or not all(map(ALT.search, elements)):
                text = 'end its cell with plotting.show(fig, "what it shows")'
                yield Fault(k, 0, f"a figure without an alternative text: {text}")
        for call in ast.walk(parsed(cell)):
            if isinstance(call, ast.Call) and _name(call) in DRAWERS and not _has_text(call):
                text = f'{_name(call)} without an alternative text: alt="what it shows"'
                yield Fault(k, call.lineno - 1, text)


def figures_that_are_not_there(notebook: Any) -> Iterator[Fault]:
    """Yields each cell that shows a figure, by its code, and has none among its outputs."""
    for k, cell in code_cells(notebook):
        if any(map(_is_figure, cell.get("outputs", []))):
            continue
        for call in _calls_at_once(parsed(cell)):
            if (name := ast.unparse(call.func)) in SHOWERS:
                text = f"no figure came of {name}(...): set no backend, and show it in this cell"
                yield Fault(k, call.lineno - 1, text)


def claims_in_their_cells(notebook: Any) -> Iterator[Fault]:
    """Yields each claim outside a cell tagged ``claims``, and what such a cell does beside."""
    for k, cell in code_cells(notebook):
        tree = parsed(cell)
        if "claims" in tags(cell):
            for statement in tree.body:
                if not (isinstance(statement, COMPUTES) or _is_claim(statement)):
                    text = "a cell of claims holds claims and what they compute, not this"
                    yield Fault(k, statement.lineno - 1, text)
        else:
            for node in ast.walk(tree):
                if isinstance(node, ast.stmt) and _is_claim(node):
                    text = 'a claim outside a cell with the tag "claims"'
                    yield Fault(k, node.lineno - 1, text)


def claims_twice(notebook: Any) -> Iterator[Fault]:
    """Yields each name under which a second claim is made."""
    made = set()
    for k, cell in code_cells(notebook):
        for name in _claimed(cell):
            if name in made:
                text = f"claim {name!r} is made twice: text could not tell which one it means"
                yield Fault(k, 0, text)
            made.add(name)


def claims_unmade(notebook: Any) -> Iterator[Fault]:
    """Yields each name that the text refers to and no cell claims; other chapters' are not seen."""
    made = {name for _, cell in code_cells(notebook) for name in _claimed(cell)}
    for k, cell in text_cells(notebook):
        for found in REFERENCE.finditer(cell.source):
            if "." not in found[1] and found[1] not in made:
                text = f"text refers to {{claim}}`{found[1]}`, which no cell claims"
                yield Fault(k, line_of(cell, found.start()), text)


def refused_answers(notebook: Any) -> Iterator[Fault]:
    """Yields each verdict of a check that is not "accepted": a solution has to be right."""
    for index, cell in enumerate(notebook.cells):
        for verdict in verdicts_of(cell):
            if not verdict.passed:
                yield Fault(index, 0, f"a check does not accept what it is given: {verdict}")


def _claimed(cell: Any) -> list[str]:
    """The names of the claims in a cell's outputs."""
    records = (output.get("metadata", {}).get("claim") for output in cell.get("outputs", []))
    return [record["name"] for record in records if record]


def _calls_at_once(tree: ast.Module) -> Iterator[ast.Call]:
    """The calls that a cell makes when it runs: those within its functions come later, or never."""
    later = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Lambda
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Call):
            yield node
        waiting += [child for child in ast.iter_child_nodes(node) if not isinstance(child, later)]


def _is_claim(statement: ast.AST) -> bool:
    """Whether a statement is a call of ``claim``."""
    call = statement.value if isinstance(statement, ast.Expr) else None
    return isinstance(call, ast.Call) and _name(call) == "claim"


def _name(call: ast.Call) -> str:
    """The last name of what is called: ``show`` of ``plotting.show``."""
    return getattr(call.func, "attr", getattr(call.func, "id", ""))


def _has_text(call: ast.Call) -> bool:
    """Whether a call has an ``alt=`` that says something."""
    texts = [word.value for word in call.keywords if word.arg == "alt"]
    return any(not isinstance(text, ast.Constant) or str(text.value).strip() for text in texts)


def _is_figure(output: Any) -> bool:
    """Whether an output is a picture, a film or a widget."""
    data = output.get("data", {})
    drawn = ELEMENT.search("".join(data.get("text/html", "")))
    return drawn is not None or any(map(FIGURE.match, data))
