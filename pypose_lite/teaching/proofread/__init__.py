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

__all__ = ["REFERENCE", "Fault", "complaints", "prose", "shared_headings"]

RULES = [
    prose.measured_numbers,
    prose.numbers_in_words,
    prose.predictions,
    prose.headings_in_answers,
    shown.figures_without_claim,
    shown.figures_that_are_not_there,
    shown.figures_without_text,
    shown.claims_in_their_cells,
    shown.claims_twice,
    shown.claims_unmade,
    shown.refused_answers,
    code.wide_lines,
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
    lab = path is not None and path.parent.name == "solutions"
    rules = [rule for rule in RULES if not (lab and rule is prose.numbers_in_words)]  # its tasks'
    faults = [fault for rule in rules for fault in rule(notebook)]
    lines = cell_lines(path, len(notebook.cells))
    return [fault.at(path, lines) for fault in sorted(faults, key=lambda f: (f.cell, f.line))]


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
