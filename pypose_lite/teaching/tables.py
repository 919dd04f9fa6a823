"""Tables of results, as JupyterLab and the page show them."""

from collections.abc import Iterable

from IPython.display import Markdown


def table(head: str, rows: Iterable[str]) -> Markdown:
    """Returns a table, names on the left and numbers to the right.

    Args:
        head: what the columns are, with units: ``"filter | error (m) | NEES"``.
        rows: as many cells each, likewise divided: ``"EKF | 0.055 | 4.02"``.

    Raises:
        ValueError: a row has more cells than the head, or fewer.
    """
    bars, rows = head.count("|"), list(rows)
    for row in rows:
        if row.count("|") != bars:
            raise ValueError(f"rows: expected {bars + 1} cells, as in {head!r}, got {row!r}")
    rule = " | ".join([":--"] + ["--:"] * bars)
    return Markdown("\n".join(f"| {line} |" for line in [head, rule, *rows]))
