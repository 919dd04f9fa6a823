"""``check`` and ``progress``: what a reader calls in a lab."""

from typing import Any

from . import verdict as say
from .exercise import Exercise, Failure, Property, chapter, find
from .given import Given
from .guard import undisturbed
from .limit import Interrupts, TimeLimit, limited
from .student import called, own_frames, raised_in_own_code
from .verdict import SIGNS, Verdict

SESSION: dict[str, Verdict] = {}  # the latest verdicts of this kernel
SHORT = 160  # characters of an exception's message


def check(number: str, answer: Any, seed: int = 0) -> Verdict:
    """Shows whether an answer is right, or which property it lacks, and returns the verdict.

    Args:
        number: of the exercise, ``"2.1"``.
        answer: the function or the value that it asks for.
        seed: of the numbers that the answer is tried on.
    """
    verdict = SESSION[number] = judge(find(number), answer, seed)
    say.show(verdict)
    return verdict


def judge(exercise: Exercise, answer: Any, seed: int = 0) -> Verdict:
    """Returns the verdict on an answer, and shows nothing."""
    if isinstance(answer, NotImplementedError) or answer is NotImplemented:
        return say.still_open(exercise)
    current = exercise.properties[0]

    def go_through() -> None:
        nonlocal current
        for current in exercise.properties:
            current.holds(called(answer, exercise), Given(seed))

    with Interrupts() as interrupts, undisturbed():
        try:
            limited(go_through, exercise.seconds)
        except TimeLimit:
            return _too_slow(exercise, current)
        except Failure as failure:
            return _lacking(exercise, current, failure)
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt) and interrupts.real:
                raise
            return _raised(exercise, current, error)
    return say.accepted(exercise)


def _too_slow(exercise: Exercise, current: Property) -> Verdict:
    came = f"Your code had not come to an end after {exercise.seconds:g} s."
    return say.refused(exercise, current.sentence, came, "Is there a loop that never ends?")


def _lacking(exercise: Exercise, current: Property, failure: Failure) -> Verdict:
    line = f"Expected {failure.expected}; got {failure.came}."
    lines = [line] if len(line) <= 100 else line.replace("; got ", ";\n  got ", 1).split("\n  ")
    hint = f"Hint: {failure.hint}" if failure.hint else ""
    return say.refused(exercise, failure.sentence or current.sentence, *lines, hint)


def _raised(exercise: Exercise, current: Property, error: BaseException) -> Verdict:
    """The student's exception as the student's: its type, its message, the line of their code."""
    if isinstance(error, NotImplementedError) and raised_in_own_code(error):
        return say.still_open(exercise)
    message = " ".join(str(error).split())
    message = message if len(message) <= SHORT else f"{message[:SHORT]} ..."
    what = f"{type(error).__name__}: {message}".removesuffix(": ")
    frames = own_frames(error)
    if not frames:
        return say.refused(exercise, current.sentence, f"Your answer could not be tried: {what}")
    place = f"Line {frames[-1].lineno}, in {frames[-1].name}: {frames[-1].line}"
    return say.refused(exercise, current.sentence, f"Your code raised {what}", place)


def progress(number: int | None = None) -> None:
    """Shows what is done of a lab: of the latest one checked, or of the chapter ``number``.

    It knows what was checked since the kernel started.
    """
    if number is None and not SESSION:
        return say.display_text("Nothing was checked yet.", say.COLOURS["open"], {})
    number = int([*SESSION][-1].split(".")[0]) if number is None else number
    exercises = chapter(number)
    done = [SESSION[e.number].passed for e in exercises if e.number in SESSION]
    rows = [_row(exercise) for exercise in exercises]
    head = f"Chapter {number}: {sum(done)} of {len(exercises)} exercises accepted."
    colour = "accepted" if sum(done) == len(exercises) else "open"
    say.display_text("\n".join([head, *rows]), say.COLOURS[colour], {})


def _row(exercise: Exercise) -> str:
    """``✓ 2.1  One Riccati step      10 minutes``."""
    verdict = SESSION.get(exercise.number)
    sign = SIGNS[verdict.state] if verdict else " "
    return f"{sign} {exercise.number:<5} {exercise.title:<44} {exercise.minutes:>3} minutes"
