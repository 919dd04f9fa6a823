"""Folds what the tags of a chapter's cells say: once for the page, once for JupyterLab.

The tags are ``setup``, ``hide-input``, ``claims``, ``answer``; ``book/authors.md`` has the table.
"""

import re
from collections.abc import Iterable, Iterator
from itertools import groupby
from typing import Any

import nbformat

from ..claims import claims_in
from .scoreboard import anchor

BUTTON = "Open the answer"
OPENED = f'<details class="answer"><summary>{BUTTON}</summary>'  # a cell of its own, as is its end
CLOSED = "</details>"
VIEW = "application/vnd.jupyter.widget-view+json"
STATE = "application/vnd.jupyter.widget-state+json"


def tags_of(cell: Any) -> list[str]:
    """The tags of a cell, none where it has none."""
    return list(cell.metadata.get("tags", []))


def for_page(notebook: Any) -> Any:
    """Returns the notebook with what the page builder needs to fold the same cells."""
    notebook = nbformat.from_dict(notebook)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            tags = tags_of(cell)
            if "claims" in tags:
                _fold(cell, "hide-cell", claims_hold(cell))
            elif "setup" in tags:
                _fold(cell, "hide-input", "Set-up")
    notebook.cells = _named(_with_anchors(_answers(notebook.cells)))
    return notebook


def for_lab(notebook: Any) -> Any:
    """Returns the notebook with the same cells folded in JupyterLab, and in what reads its format.

    Our extension for JupyterLab folds an answer as a whole; without it, its code cells are folded
    one by one, and its text is under a triangle. Claims do not stop a run there: readers who change
    something see which of them no longer hold, and go on.
    """
    notebook = nbformat.from_dict(notebook)
    _still(notebook)
    cells = []
    for answer, group in groupby(notebook.cells, lambda cell: "answer" in tags_of(cell)):
        members = list(group)
        if answer:
            cells.append(_text(f"**{BUTTON}**", "answer-button"))
        for cell in members:
            cells.append(_folded(cell, answer))
    notebook.cells = _named(cells)
    return notebook


def fold_code(cell: Any) -> None:
    """Folds the code of a cell of a solution on the page; the output stays."""
    if cell.cell_type == "code" and not {"hide-input", "hide-cell"} & set(tags_of(cell)):
        _fold(cell, "hide-input", "Code")


def claims_hold(cell: Any) -> str:
    """What stands on the fold over a cell of claims."""
    count = len(claims_in(nbformat.v4.new_notebook(cells=[cell])))
    count = count or len(re.findall(r"^claim\(", cell.source, flags=re.MULTILINE))
    return "1 claim holds" if count == 1 else f"{count} claims hold"


def _fold(cell: Any, tag: str, prompt: str) -> None:
    """Tells the page builder to fold a cell, and what stands on the fold."""
    tags = [name for name in tags_of(cell) if name not in ("hide-input", "hide-cell")]
    cell.metadata["tags"] = [*tags, tag]
    cell.metadata["mystnb"] = {
        **cell.metadata.get("mystnb", {}),
        "code_prompt_show": prompt,
        "code_prompt_hide": prompt,
    }


def _answers(cells: list[Any]) -> Iterator[Any]:
    """All cells, and those of each answer between two that open and close its fold."""
    for answer, group in groupby(cells, lambda cell: "answer" in tags_of(cell)):
        if answer:
            yield _text(OPENED, "answer-begins")
        yield from group
        if answer:
            yield _text(CLOSED, "answer-ends")


def _with_anchors(cells: Iterable[Any]) -> Iterator[Any]:
    """All cells, and before each that claims, places for links from the scoreboard."""
    for cell in cells:
        made = claims_in(nbformat.v4.new_notebook(cells=[cell]))
        if made:
            ids = "".join(f'<a class="anchor" id="{anchor(claim.name)}"></a>' for claim in made)
            yield _text(ids, "anchors")
        yield cell


def _folded(cell: Any, answer: bool) -> Any:
    """A cell with the metadata that folds it in JupyterLab."""
    tags = tags_of(cell)
    if cell.cell_type == "markdown":
        if answer:
            cell.source = f"{OPENED}\n\n{cell.source}\n\n{CLOSED}"
        return cell
    hidden = {
        "source_hidden": answer or bool({"setup", "hide-input", "claims"} & set(tags)),
        "outputs_hidden": answer or "claims" in tags,
    }
    if "claims" in tags:
        cell.metadata["tags"] = [*tags, "raises-exception"]
    if any(hidden.values()):
        cell.metadata["jupyter"] = {**cell.metadata.get("jupyter", {}), **hidden}
    return cell


def _text(source: str, tag: str) -> Any:
    """A text cell with one tag."""
    return nbformat.v4.new_markdown_cell(source, metadata={"tags": [tag]})


def _still(notebook: Any) -> None:
    """Puts a widget's first picture in its place: without a kernel, a widget is a broken link."""
    widgets = notebook.metadata.pop("widgets", {}).get(STATE, {}).get("state", {})
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            if VIEW in output.get("data", {}):
                picture = _first_picture(widgets, output.data[VIEW]["model_id"])
                output.data = {"text/plain": "Run this cell to use its slider."}
                if picture:
                    output.data["text/html"] = picture


def _first_picture(widgets: dict, model: str) -> str:
    """The first picture within a widget, depth first, or nothing."""
    state = widgets.get(model, {}).get("state", {})
    if "<img" in str(state.get("value", "")):
        return state["value"]
    inner = (child.removeprefix("IPY_MODEL_") for child in state.get("children", []))
    return next(filter(None, (_first_picture(widgets, child) for child in inner)), "")


def _named(cells: Iterable[Any]) -> list[Any]:
    """The cells with identifiers that are the same in every build."""
    cells = list(cells)
    for number, cell in enumerate(cells):
        cell["id"] = f"cell-{number}"
    return cells
