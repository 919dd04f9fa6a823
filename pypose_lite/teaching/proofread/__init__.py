"""What a chapter is held to beside that its cells run.

Prose states no measurements, figures have claims and alternative texts, code is fit to be read.
Each rule reads a notebook (nbformat), outputs included, and yields its faults, with their places.
``prose`` has the rules for text, ``shown`` those for figures and claims, ``code`` those for code.
"""

from pathlib import Path
from typing import Any

from . import code, prose, shown
from .fault import Fault, cell_lines
from .prose import REFERENCE

__all__ = ["OLD_FORM", "REFERENCE", "Fault", "complaints", "prose", "shared_headings"]

# Chapters that are still in the form of before lessons and labs: fewer rules hold for them. One
# that is rewritten leaves the list; when it is empty, it goes.
OLD_FORM = frozenset(["09_go1"])
ALWAYS = [
    prose.measured_numbers,
    shown.figures_without_claim,
    shown.figures_that_are_not_there,
    shown.claims_twice,
    shown.claims_unmade,
    shown.refused_answers,
    code.wide_lines,
]
LESSONS = [
    prose.numbers_in_words,
    prose.predictions,
    prose.headings_in_answers,
    shown.figures_without_text,
    shown.claims_in_their_cells,
    code.long_cells,
    code.statements,
    code.folded_names,
]
SHARED = frozenset(["Summary", "Further reading"])  # headings that every chapter may have


def complaints(notebook: Any, path: Path | None = None) -> list[str]:
    """Returns what is wrong with an executed notebook, by all the rules that hold for it.

    Args:
        notebook: with its outputs.
        path: of its source, ``book/03_mpc.py``; each complaint begins with it and with the line.
    """
    page = f"{path.parent.name}/{path.stem}".removeprefix("book/") if path else ""
    faults = [fault for rule in _rules(page) for fault in rule(notebook)]
    if page in OLD_FORM and _is_lesson(notebook):
        faults.append(Fault(0, 0, f"is in the new form: take {page} off OLD_FORM in proofread"))
    lines = cell_lines(path, len(notebook.cells))
    return [fault.at(path, lines) for fault in sorted(faults, key=lambda f: (f.cell, f.line))]


def _rules(page: str) -> list:
    """The rules that hold for a page. In a lab, counts in words are those of its tasks."""
    if page in OLD_FORM:
        return ALWAYS
    lab = page.startswith("solutions/")
    return ALWAYS + [rule for rule in LESSONS if not (lab and rule is prose.numbers_in_words)]


def shared_headings(chapters: dict[str, Any]) -> list[str]:
    """Returns complaints about headings of the second level that two chapters have.

    Args:
        chapters: notebooks by their names.
    """
    found: dict[str, str] = {}
    wrong = []
    for name, notebook in chapters.items():
        for heading in prose.headings(notebook):
            if heading in found and heading not in SHARED:
                wrong.append(
                    f"{name} and {found[heading]} have the same heading, {heading!r}: the side "
                    f"menu cannot tell them apart; say what it is about in this chapter"
                )
            found.setdefault(heading, name)
    return wrong


def _is_lesson(notebook: Any) -> bool:
    """Whether a chapter folds its set-up, as lessons do."""
    return any("setup" in cell.metadata.get("tags", []) for cell in notebook.cells)
