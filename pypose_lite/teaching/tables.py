"""Tables of results, as JupyterLab and the page show them."""

from collections.abc import Iterable

from IPython.display import Markdown
from tabulate import tabulate


def table(head: str, rows: Iterable[str]) -> Markdown:
    """Returns a table, names on the left and numbers to the right.

    Args:
        head: what the columns are, with units: ``"filter | error (m) | NEES"``.
        rows: as many cells each, likewise divided: ``"EKF | 0.055 | 4.02"``.

    Raises:
        ValueError: a row has more cells than the head, or fewer.
    """
    columns, *cells = [[cell.strip() for cell in line.split("|")] for line in (head, *rows)]
    for row in cells:
        if len(row) != len(columns):
            line = " | ".join(row)
            raise ValueError(f"rows: expected {len(columns)} cells, as in {head!r}, got {line!r}")
    sides = ["left"] + ["right"] * (len(columns) - 1)
    return Markdown(tabulate(cells, columns, "pipe", disable_numparse=True, colalign=sides))
