"""What slides may refer to in an executed chapter: claims, figures, equations, tables, code.

Each is a dictionary from the names that a slide uses to Markdown. A figure's name is the beginning
of its alternative text, a table's the beginning of its head; code has the names that it defines.
"""

import ast
import base64
import io
import re
import textwrap
from collections.abc import Iterator
from difflib import get_close_matches
from itertools import pairwise
from typing import Any

from bs4 import BeautifulSoup
from PIL import Image

from .plain import EQUATION, citation, equation_numbers
from .scoreboard import Claims

BEGINNINGS = "figure", "table"  # kinds that are named by how they begin
TALL = 0.7  # height by width from which a picture stands beside the text
Names = dict[str, dict[str, str]]  # by kind, then by name


def names_of(notebook: Any, page: str, claims: Claims) -> Names:
    """Everything that the slides of a page can refer to.

    Args:
        notebook: the page as it was executed.
        page: its name, ``"03_mpc"``.
        claims: those of the whole book; a name of the page itself needs no ``03_mpc.`` before it.
    """
    text = "\n\n".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")
    numbers = equation_numbers(page, text)
    everywhere = {f"{there}.{name}": claim.number for (there, name), claim in claims.items()}
    here = {name: claim.number for (there, name), claim in claims.items() if there == page}
    return {
        "claim": here | everywhere,
        "figure": dict(figures(notebook)),
        "table": dict(tables(notebook)),
        "equation": {label: tagged(body, numbers[label]) for body, label in EQUATION.findall(text)},
        "eq": {label: f"({number})" for label, number in numbers.items()},
        "code": dict(code(notebook)),
    }


def tagged(body: str, number: str) -> str:
    """An equation as a block of its own, with the number that it has in the chapter."""
    return f"\n$$\n{body.strip()} \\tag{{{number}}}\n$$\n"


def outputs(notebook: Any) -> Iterator[Any]:
    """The data of all outputs, by type."""
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            if "claim" not in output.get("metadata", {}):
                yield output.get("data", {})


def figures(notebook: Any) -> Iterator[tuple[str, str]]:
    """Every figure and film by its alternative text, also each picture of a slider."""
    shown = [data.get("text/html", "") for data in outputs(notebook)]
    for models in notebook.metadata.get("widgets", {}).values():
        shown += [model["state"].get("value", "") for model in models["state"].values()]
    for text in shown:
        if "<img" in str(text):
            tree: Any = BeautifulSoup(text, "html.parser")
            for image in tree.find_all("img"):
                yield image["alt"], f'\n<figure class="{shape(image["src"])}">{image}</figure>\n'


def shape(source: str) -> str:
    """Whether a picture is tall, and gets a side of its slide, or wide; from its ``data:`` URL."""
    data = base64.b64decode(source.partition("base64,")[2])
    if not data:
        return "wide"
    width, height = Image.open(io.BytesIO(data)).size
    return "tall" if height > TALL * width else "wide"


def tables(notebook: Any) -> Iterator[tuple[str, str]]:
    """Every table by its head, ``filter | error (m) | NEES``."""
    for data in outputs(notebook):
        text = data.get("text/markdown", "")
        if text.startswith("|"):
            head = text.splitlines()[0].strip("| ")
            yield re.sub(r"\s*\|\s*", " | ", head), f"\n{text}\n"


def code(notebook: Any) -> Iterator[tuple[str, str]]:
    """The lines of every function, class, method and assignment, by the first name defined."""
    seen: set[str] = set()
    for cell in notebook.cells:
        if cell.cell_type == "code":
            for name, lines in definitions(parsed(cell.source), cell.source.splitlines()):
                if name not in seen:
                    seen.add(name)
                    yield name, lines


def parsed(source: str) -> list[ast.stmt]:
    """The statements of a cell; none where it is no plain Python."""
    try:
        return ast.parse(source).body
    except SyntaxError:
        return []


def definitions(body: list[ast.stmt], source: list[str], prefix: str = "") -> Iterator[tuple]:
    """The names that statements define, each with its lines, comments at their ends included."""
    for statement in body:
        lines = source[statement.lineno - 1 : statement.end_lineno]
        for name in defined_by(statement):
            yield prefix + name, textwrap.dedent("\n".join(lines))
        if isinstance(statement, ast.ClassDef):
            yield from definitions(statement.body, source, f"{statement.name}.")


def defined_by(statement: ast.stmt) -> list[str]:
    """The names that one statement defines."""
    if isinstance(statement, ast.FunctionDef | ast.ClassDef):
        return [statement.name]
    if not isinstance(statement, ast.Assign):
        return []
    nodes = [node for target in statement.targets for node in ast.walk(target)]
    return [node.id for node in nodes if isinstance(node, ast.Name)]


def resolve(kind: str, name: str, names: Names) -> str:
    """Returns the Markdown that a reference stands for.

    Raises:
        ValueError: there is nothing of that name, with the names that are near.
    """
    if kind in ("cite", "cite:p", "cite:t"):
        return citation(name, kind[5:] or "p")
    if kind not in names:
        known = ", ".join([*names, "cite"])
        raise ValueError(f"{{{kind}}} is no reference that slides have; expected one of {known}")
    if kind == "code":
        return block([find(kind, part.strip(), names) for part in name.split(",")])
    return find(kind, name, names)


def block(parts: list[str]) -> str:
    """Pieces of code as one block, with blank lines around those of several lines."""
    text = parts[0]
    for before, part in pairwise(parts):
        text += ("\n\n" if "\n" in before + part else "\n") + part
    return f"\n```python\n{text}\n```\n"


def find(kind: str, name: str, names: Names) -> str:
    """The one entry of a kind that has a name, or that begins with it."""
    known = names[kind]
    if name in known:
        return known[name]
    begins = [full for full in known if kind in BEGINNINGS and full.startswith(name)]
    if len(begins) == 1:
        return known[begins[0]]
    if begins:
        raise ValueError(f"{len(begins)} of the chapter's {kind}s begin with {name!r}: say more")
    raise ValueError(f"the chapter has no {kind} {name!r}; {near(name, list(known))}")


def near(name: str, known: list[str]) -> str:
    """The names that a wrong one may have meant, or all where there are few."""
    beginnings = {full[: max(len(name), 40)]: full for full in known}
    close = get_close_matches(name, beginnings, 3, 0.5) or list(beginnings)[:3]
    return f"near names: {', '.join(close)}" if close else "it has none"
