"""Rules for text: it states no measurements, and asks before it answers."""

import re
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

from .fault import Fault, line_of, tags, text_cells

# Numbers that are given, not measured, and may stand in prose: the example's and the paper's.
GIVEN = frozenset(
    ["1 m", "45 degrees", "95 %", "0.1", "0.005", "0.05", "0.163", "0.058", "0.065"]
    + ["3.34", "4.72", "0.2045", "0.1803", "0.1802", "0.0959", "17 waypoints"]
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
WORDS = (
    r"(?:two|three|four|five|six|seven|eight|nine|ten|eleven|twelve|fifteen|sixteen|twenty|thirty"
    r"|forty|fifty|sixty|ninety|(?:a|one|two|three|five|ten) (?:hundred|thousand)|a dozen)"
)
COUNTED = (
    r"(?:steps?|sweeps?|iterations?|evaluations?|laps?|waypoints?|digits?|times|fold|percent"
    r"|(?:centi|milli)?metres?|(?:milli|micro)?seconds?|minutes?|degrees?|radians?)"
)
IN_WORDS = re.compile(
    rf"\b(?:twice|thrice|half(?=(?: as| of| the| an?)\b)|a (?:third|quarter|fifth|tenth|hundredth)"
    rf"(?= of\b)|\d+ (?:steps|sweeps|iterations|evaluations|laps|waypoints|digits)"
    rf"|{WORDS}[\s-]{COUNTED})(?![\w-])",
    re.IGNORECASE,
)
REFERENCE = re.compile(r"(?<!`)\{claim\}`([\w.]+)`")  # `name`, or `03_mpc.name` in another chapter
HEADING = re.compile(r"^(#+) (.+)$", re.MULTILINE)


def measured_numbers(notebook: Any) -> Iterator[Fault]:
    """Yields each number in prose that has a decimal point or a unit and is not known as given.

    Code, mathematics, roles, links, tags and comments are not prose. A number that is given, such
    as a setting, is declared in the same cell: ``<!-- given: 0.3 m, 20 Hz -->``.
    """
    yield from _numbers(notebook, MEASURED)


def numbers_in_words(notebook: Any) -> Iterator[Fault]:
    """Yields each number in prose that is said in words or counts: "twice", "12 steps"."""
    yield from _numbers(notebook, IN_WORDS)


def _numbers(notebook: Any, numbers: re.Pattern) -> Iterator[Fault]:
    for k, cell in text_cells(notebook):
        declared = re.findall(r"<!-- given: (.*?) -->", cell.source, re.DOTALL)
        given = GIVEN.union(*(re.split(r",\s+", part) for part in declared))
        known = {" ".join(number.lower().split()) for number in given}
        blanked = NOT_PROSE.sub(lambda found: re.sub(r"[^\n]", "\0", found[0]), cell.source)
        for found in numbers.finditer(blanked):
            number = " ".join(found[0].split())
            if not known & {number.lower(), number.split()[0].lower()}:
                yield Fault(k, line_of(cell, found.start()), _mend(number))


def _mend(number: str) -> str:
    """What to do about a number."""
    return (
        f"prose states {number!r}. Measured: let a cell claim it and write {{claim}}`its_name` "
        f"instead. Given: add <!-- given: {number} --> to the same text cell"
    )


def predictions(notebook: Any) -> Iterator[Fault]:
    """Yields each question without a folded answer after it, and each answer without a question."""
    cells = list(enumerate(notebook.cells))
    for (k, cell), (_, after) in pairwise([*cells, (len(cells), None)]):
        asks = cell.cell_type == "markdown" and "**Predict.**" in cell.source
        answered = after is not None and "answer" in tags(after)
        if asks and not answered:
            line = line_of(cell, cell.source.index("**Predict.**"))
            yield Fault(k, line, 'after **Predict.** comes a cell with the tag "answer"')
        if answered and not asks and "answer" not in tags(cell):
            yield Fault(k + 1, 0, "an answer without a text before it that asks: **Predict.**")


def headings_in_answers(notebook: Any) -> Iterator[Fault]:
    """Yields each heading within an answer: a fold cannot hold a section."""
    for k, cell in text_cells(notebook):
        if "answer" in tags(cell):
            for found in HEADING.finditer(_without_code(cell.source)):
                line = line_of(cell, found.start())
                yield Fault(k, line, f"a fold cannot hold a section: {found[0]!r} in an answer")


def headings(notebook: Any) -> list[str]:
    """The headings of the second level."""
    texts = (_without_code(cell.source) for _, cell in text_cells(notebook))
    return [found[2] for text in texts for found in HEADING.finditer(text) if found[1] == "##"]


def section(cell: Any) -> str:
    """The last heading of the first or second level in a text cell, or nothing."""
    if cell.cell_type != "markdown":
        return ""
    found = [text for level, text in HEADING.findall(_without_code(cell.source)) if len(level) < 3]
    return "".join(found[-1:])


def _without_code(text: str) -> str:
    """The text with code blocks blanked, line by line."""
    return re.sub(r"```.*?```", lambda f: "\n" * f[0].count("\n"), text, flags=re.DOTALL)
