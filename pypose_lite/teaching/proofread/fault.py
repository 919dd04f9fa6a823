"""A fault and its place, as the rules find it and as an author reads it."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

CELL = re.compile(r"^# %%", re.MULTILINE)


@dataclass(frozen=True)
class Fault:
    """What is wrong: in which cell of the notebook, and in which of its lines, both from 0."""

    cell: int
    line: int
    text: str

    def at(self, path: Path | None, lines: list[int]) -> str:
        """The complaint as one line, ``book/03_mpc.py:12: ...``; without a source only its text."""
        if path is None:
            return self.text
        place = f"{path.parent.name}/{path.name}"
        if self.cell < len(lines):
            place += f":{lines[self.cell] + self.line}"
        return f"{place}: {self.text}"


def cell_lines(path: Path | None, cells: int) -> list[int]:
    """The line of the source, from 1, where the text of each of its cells begins."""
    if path is None or not path.exists():
        return []
    source = path.read_text(encoding="utf-8")
    lines = []
    for found in CELL.finditer(source):
        text = source[found.start() :].split("\n", 1)[-1]
        blank = len(text) - len(text.lstrip("\n"))
        lines.append(source.count("\n", 0, found.start()) + 2 + blank)
    return [1] * (cells - len(lines)) + lines  # text before the first mark is a cell, too


def tags(cell: Any) -> set[str]:
    """The tags of a cell."""
    return set(cell.metadata.get("tags", []))


def code_cells(notebook: Any) -> list[tuple[int, Any]]:
    """The code cells that have something in them, with their numbers."""
    cells = enumerate(notebook.cells)
    return [(k, cell) for k, cell in cells if cell.cell_type == "code" and cell.source.strip()]


def text_cells(notebook: Any) -> list[tuple[int, Any]]:
    """The text cells, with their numbers."""
    return [(k, cell) for k, cell in enumerate(notebook.cells) if cell.cell_type == "markdown"]


def line_of(cell: Any, position: int) -> int:
    """The line of a cell, from 0, in which a character stands."""
    return cell.source.count("\n", 0, position)
