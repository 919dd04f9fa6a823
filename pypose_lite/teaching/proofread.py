"""What a chapter is held to beside that its cells run: figures have claims, prose no measurements.

Its code has to fit, too: a cell on a screen, a line on the page, a chapter in 90 minutes. Each rule
reads a notebook (nbformat), outputs included, and yields its complaints.
"""

import re
from collections import Counter
from collections.abc import Iterator
from typing import Any

from .checks import verdicts_in
from .claims import claims_in

# Numbers that are given, not measured, and may stand in prose: the example's and the paper's.
GIVEN = frozenset(
    ["1 m", "45 degrees", "95 %", "0.1", "0.005", "0.05", "0.163", "0.058", "0.065"]
    + ["3.34", "4.72", "0.2045", "0.1803", "0.1802", "0.0959"]
)
NOT_PROSE = re.compile(
    r"<!--.*?-->|```.*?```|\$\$.*?\$\$|\$[^$\n]+\$"  # comments, code, mathematics
    r"|(?:\{[\w:-]+\})?`[^`]*`|<[^>\n]+>|\]\([^)]*\)|https?://\S+"  # roles, tags, links
    r"|^\*\d+ minutes\.[^\n]*\*$"  # how long an exercise takes
    r"|\b(?:Section|Chapter|Table|Figure|Fig\.|Eq\.|Exercise|Python|PyPose) \d[\d.]*",  # names
    re.DOTALL | re.IGNORECASE | re.MULTILINE,
)
UNITS = (
    r"\s?(?:cm|mm|ms|µs|us|ns|m|s|Hz|rad|deg|°|%|"
    r"metres?|seconds?|milliseconds?|microseconds?|minutes?|degrees?|radians?|percent|times)(?!\w)"
)
MEASURED = re.compile(rf"(?<![\w.])(?:\d+\.\d+(?:e-?\d+)?(?!\.?\d)(?:{UNITS})?|\d+{UNITS})")
REFERENCE = re.compile(r"(?<!`)\{claim\}`([\w.]+)`")  # `name`, or `03_mpc.name` in another chapter
FIGURE = re.compile(r"image/|video/|application/vnd\.jupyter\.widget-view")
LINES, COLUMNS = 20, 86  # of a code cell: more lines need two looks, more columns a scrollbar


def complaints(notebook: Any, name: str = "") -> list[str]:
    """Returns what is wrong with an executed notebook, by all the rules.

    Args:
        notebook: with its outputs.
        name: of its file.
    """
    rules = [measured_numbers, figures_without_claim, claims_twice, claims_unmade]
    rules += [long_cells, wide_lines, refused_answers]
    return [complaint for rule in rules for complaint in rule(notebook)]


def measured_numbers(notebook: Any) -> Iterator[str]:
    """Yields each number in prose that has a decimal point or a unit and is not known as given.

    Code, mathematics, roles, links, tags and comments are not prose. A number that is given, such
    as a setting, is declared in the same cell: ``<!-- given: 0.3 m, 20 Hz -->``.
    """
    for cell in notebook.cells:
        if cell.cell_type != "markdown":
            continue
        declared = re.findall(r"<!-- given: (.*?) -->", cell.source)
        given = GIVEN.union(*(part.split(", ") for part in declared))
        for number in MEASURED.findall(NOT_PROSE.sub(" ", cell.source)):
            if not given & {number, number.split()[0]}:
                yield (
                    f"prose states {number!r}. Measured: let a cell claim it and write "
                    f"{{claim}}`its_name` instead. Given: add <!-- given: {number} --> to the text "
                    f"cell that begins {cell.source[:40]!r}"
                )


def figures_without_claim(notebook: Any) -> Iterator[str]:
    """Yields each section (from one heading to the next) with a figure, and no claim or check."""
    title, figures, claims = "the beginning", 0, 0
    for cell in [*notebook.cells, None]:
        heading = _heading(cell) if cell is not None else "the end"
        if heading and figures and not claims:
            yield f"section {title!r} shows a figure and claims nothing: add a claim(...) under it"
        if heading:
            title, figures, claims = heading, 0, 0
        if cell is not None and cell.cell_type == "code":
            figures += any(map(_is_figure, cell.get("outputs", [])))
            made = [out.get("metadata", {}) for out in cell.get("outputs", [])]
            claims += any("claim" in each or "verdict" in each for each in made)


def claims_twice(notebook: Any) -> Iterator[str]:
    """Yields each name under which two claims are made."""
    for name, count in Counter(made.name for made in claims_in(notebook)).items():
        if count > 1:
            yield f"claim {name!r} is made {count} times: text could not tell which one it means"


def claims_unmade(notebook: Any) -> Iterator[str]:
    """Yields each name that the text refers to and no cell claims; other chapters' are not seen."""
    made = {claim.name for claim in claims_in(notebook)}
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            for name in REFERENCE.findall(cell.source):
                if "." not in name and name not in made:
                    yield f"text refers to {{claim}}`{name}`, which no cell claims"


def long_cells(notebook: Any) -> Iterator[str]:
    """Yields each code cell of more than 20 lines, blank ones within it included.

    Folded cells count (``hide-input``: readers unfold them), and so do those that only JupyterLab
    shows (``remove-cell``): whatever a reader may open has to fit on a screen.
    """
    for cell in _code(notebook):
        if (lines := len(cell.source.strip().splitlines())) > LINES:
            yield (
                f"a code cell has {lines} lines, more than {LINES}: say it in fewer, or make two "
                f"cells of the one that begins {_first_line(cell)!r}"
            )


def wide_lines(notebook: Any) -> Iterator[str]:
    """Yields each line of code that needs a scrollbar on the page: of more than 86 columns."""
    for cell in _code(notebook):
        for line in map(str.rstrip, cell.source.splitlines()):
            if len(line) > COLUMNS:
                yield (
                    f"a line of code has {len(line)} columns, more than {COLUMNS}: break it, or "
                    f"give a part of it a name: {line.strip()!r}"
                )


def refused_answers(notebook: Any) -> Iterator[str]:
    """Yields each verdict of a check that is not "accepted": a solution has to be right."""
    for verdict in verdicts_in(notebook):
        if not verdict.passed:
            yield f"a check does not accept what it is given: {verdict}"


def _code(notebook: Any) -> list[Any]:
    """The code cells that have something in them."""
    return [cell for cell in notebook.cells if cell.cell_type == "code" and cell.source.strip()]


def _first_line(cell: Any) -> str:
    return cell.source.strip().splitlines()[0][:60]


def _heading(cell: Any) -> str:
    """The last heading of the first or second level in a text cell, or nothing."""
    if cell.cell_type != "markdown":
        return ""
    text = re.sub(r"```.*?```", "", cell.source, flags=re.DOTALL)
    return "".join(re.findall(r"^##? (.+)$", text, flags=re.MULTILINE)[-1:])


def _is_figure(output: Any) -> bool:
    """Whether an output is a picture, a film or a widget."""
    data = output.get("data", {})
    drawn = re.search(r"<(img|svg|video)\b", "".join(data.get("text/html", "")))
    return drawn is not None or any(map(FIGURE.match, data))
