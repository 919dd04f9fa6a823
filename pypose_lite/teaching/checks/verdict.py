"""What a check says, and how a notebook shows it."""

import html
from dataclasses import asdict, dataclass
from typing import Any

from .exercise import Exercise

SIGNS = {"accepted": "✓", "refused": "✗", "open": "…"}
COLOURS = {"accepted": "#009E73", "refused": "#D55E00", "open": "#666666"}
STYLE = (
    "margin: 0; padding-left: 0.8em; border-left: 4px solid {}; "
    "white-space: pre-wrap; word-break: normal; overflow-wrap: break-word"
)


@dataclass(frozen=True)
class Verdict:
    """The result of a check: ``accepted``, ``refused`` or still ``open``.

    ``points`` of ``out_of`` were earned; ``sentence`` says what it must do and does not.
    """

    number: str
    state: str
    message: str
    points: int
    out_of: int
    sentence: str = ""

    @property
    def passed(self) -> bool:
        """Whether the answer was accepted."""
        return self.state == "accepted"

    def __str__(self) -> str:
        """The lines that the reader sees."""
        return f"{SIGNS[self.state]} {self.message}"

    def _ipython_display_(self) -> None:
        """Shows nothing: the check has shown it already."""


def accepted(exercise: Exercise) -> Verdict:
    """Returns the verdict on a right answer."""
    message = f"{exercise.number} {exercise.title}: accepted."
    return Verdict(exercise.number, "accepted", message, exercise.points, exercise.points)


def still_open(exercise: Exercise) -> Verdict:
    """Returns the verdict on a stub."""
    message = f"{exercise.number} {exercise.title}: not done yet."
    return Verdict(exercise.number, "open", message, 0, exercise.points)


def refused(exercise: Exercise, sentence: str, *lines: str) -> Verdict:
    """Returns the verdict on an answer that does not do what it must."""
    first = f"{exercise.number} {exercise.title}: it must {sentence}."
    message = "\n".join([first, *(f"  {line}" for line in lines if line)])
    return Verdict(exercise.number, "refused", message, 0, exercise.points, sentence)


def show(verdict: Verdict) -> None:
    """Displays the verdict once, with its record in the output's metadata."""
    display_text(str(verdict), COLOURS[verdict.state], {"verdict": asdict(verdict)})


def display_text(text: str, colour: str, metadata: dict[str, Any]) -> None:
    """Displays lines of plain text beside a coloured bar, or prints them where nothing displays."""
    try:
        from IPython import display, get_ipython
    except ImportError:
        return print(text)
    if not hasattr(get_ipython(), "kernel"):
        return print(text)
    framed = f'<pre style="{STYLE.format(colour)}">{html.escape(text)}</pre>'
    display.display({"text/plain": text, "text/html": framed}, raw=True, metadata=metadata)


def verdicts_in(notebook: Any) -> list[Verdict]:
    """Returns the verdicts that an executed notebook (nbformat) holds."""
    return [verdict for cell in notebook.cells for verdict in verdicts_of(cell)]


def verdicts_of(cell: Any) -> list[Verdict]:
    """Returns the verdicts in the outputs of one cell."""
    records = [output.get("metadata", {}).get("verdict") for output in cell.get("outputs", [])]
    return [Verdict(**record) for record in records if record]
