"""Claims: nothing is said that is not checked.

A claim is a number that the book states, in a cell that fails where the number is not as stated.
It leaves its record in the cell's output, so that the record travels with the notebook: the page
fills ``{claim}`name``` in from there, and the scoreboard lists all records of a build.
"""

import math
import re
from dataclasses import asdict, dataclass
from typing import Any

Number = bool | int | float


@dataclass(frozen=True)
class Claim:
    """A number that a cell has checked.

    ``bound`` says in words what was claimed, ``paper`` is what the paper reports, and ``cell``
    counts the code cells of the chapter from 1. Where ``holds`` is False the cell has stopped, and
    so has the build; readers who changed something see their number all the same.
    """

    name: str
    value: Number
    bound: str
    unit: str = ""
    paper: Number | None = None
    varies: bool = False
    cell: int | None = None
    holds: bool = True

    @property
    def number(self) -> str:
        """The number as prose shows it, with its unit."""
        return _shown(self.value, self.unit)

    @property
    def reported(self) -> str:
        """The paper's number with its unit, or nothing."""
        return "" if self.paper is None else f"{self.paper} {self.unit}".strip()

    def __str__(self) -> str:
        """The line under the figure."""
        paper = f" (paper: {self.reported})" if self.reported else ""
        claimed = self.bound if self.holds else f"claimed: {self.bound}"
        return f"`{self.name}` = {self.number}, {claimed}{paper}"


def claim(
    name: str,
    value: Any,
    *,
    below: float | None = None,
    above: float | None = None,
    equals: float | None = None,
    within: float | None = None,
    unit: str = "",
    paper: Number | None = None,
    varies: bool = False,
) -> None:
    """Shows and records a number, and raises where it is not as claimed.

    Args:
        name: how the text refers to it, ``{claim}`name```: lower-case letters, digits, underscores.
        value: a number, or a tensor or array that holds a single one. NaN fails every claim.
        below: the number is less than this.
        above: the number is greater than this.
        equals: the number is this one, exactly or ``within`` a distance.
        within: the distance allowed from ``equals``.
        unit: SI unit, ``"m"``.
        paper: the number that the paper reports, for the scoreboard.
        varies: True for durations and the like, which differ from one run to the next.

    Raises:
        AssertionError: the claim does not hold.
        ValueError: the claim says nothing, or its name or its value is not of the form above.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise ValueError(f"name: expected lower-case letters, digits, underscores, got {name!r}")
    if below is above is equals is None:
        raise ValueError(f"{name}: a claim needs below=, above= or equals=")
    if within is not None and equals is None:
        raise ValueError(f"{name}: within= needs equals=")
    number = _number(name, value)
    holds = (
        (below is None or number < below)
        and (above is None or number > above)
        and (equals is None or abs(number - equals) <= (within or 0))
    )
    bound = _bound(below, above, equals, within, unit)
    _show(Claim(name, number, bound, unit, paper, varies, holds=holds))
    if not holds:
        raise AssertionError(f"claim does not hold: {name} = {number!r} {unit}; claimed: {bound}")


def claims_in(notebook: Any) -> list[Claim]:
    """Returns the claims that an executed notebook (nbformat) holds, with their cells' numbers."""
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    return [
        Claim(**{**output["metadata"]["claim"], "cell": number})
        for number, cell in enumerate(code, start=1)
        for output in cell.get("outputs", [])
        if "claim" in output.get("metadata", {})
    ]


def _show(record: Claim) -> None:
    """Displays the line under the figure, with the record in the output's metadata."""
    try:
        from IPython import display, get_ipython
    except ImportError:
        return print(record)
    if not hasattr(get_ipython(), "kernel"):
        return print(record)
    text = f"{'✓' if record.holds else '✗'} {record}"
    line = {"text/plain": text, "text/markdown": text}
    metadata = {"claim": asdict(record), "shown": record.number}
    display.display(line, raw=True, metadata=metadata)


def _number(name: str, value: Any) -> Number:
    """A plain number from a number, a tensor or an array."""
    try:
        number = value.item() if hasattr(value, "item") else value
    except (RuntimeError, ValueError):
        raise ValueError(f"{name}: expected one number, got shape {tuple(value.shape)}") from None
    if not isinstance(number, bool | int | float):
        raise ValueError(f"{name}: expected one number, got {type(value).__name__}")
    return number


def _bound(
    below: Number | None,
    above: Number | None,
    equals: Number | None,
    within: Number | None,
    unit: str,
) -> str:
    """``above 3.34 and below 4.72``, ``equal to 1 m within 0.02 m``."""
    parts = {"above": above, "below": below, "equal to": equals}
    words = " and ".join(f"{k} {_shown(v, unit)}" for k, v in parts.items() if v is not None)
    return words if within is None else f"{words} within {_shown(within, unit)}"


def _shown(value: Number, unit: str) -> str:
    """Whole numbers in full, others with three digits: ``0.0543 m``, ``48``, ``2e-7``, ``yes``."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int) or (math.isfinite(value) and 1000 <= abs(value) < 1e6):
        text = f"{value:.0f}"
    else:
        text = re.sub(r"e([+-])0+", r"e\1", f"{value:.3g}").replace("e+", "e")
    return f"{text} {unit}".strip()
