"""An exercise as its check knows it: a title, and what an answer must do.

A file a chapter, ``chapter_02.py``, reads like a specification:

    riccati_step = Exercise("2.1", "One Riccati step", minutes=10, takes="A, B, Q, R, V", points=2)

    @riccati_step.must("give u = K x the least cost of this step and all that follow")
    def best_input(answer, given):
        A, B = given.randn(3, 3), given.randn(3, 2)
        ...
        expect.close("K", K, the_same_by_another_route, hint="...")

A property returns where it holds, and raises ``Failure`` where it does not.
"""

import importlib
import pkgutil
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

NUMBER = re.compile(r"(\d+)\.\d+")


class Failure(Exception):
    """A property that an answer lacks: what was expected, what came, and one hint.

    ``sentence`` says which, where it is not the one that is being checked.
    """

    def __init__(self, expected: str, came: str, hint: str = "", sentence: str = "") -> None:
        super().__init__(f"expected {expected}, got {came}. {hint}".strip())
        self.expected, self.came, self.hint, self.sentence = expected, came, hint, sentence


@dataclass(frozen=True)
class Property:
    """What an answer must do, in words that follow "it must", and the function that sees to it."""

    sentence: str
    holds: Callable[[Any, Any], Any]


@dataclass
class Exercise:
    """An exercise and the properties of its right answers, checked in the order of the file.

    Args:
        number: of the chapter and the exercise, ``"2.1"``.
        title: as in the lab.
        minutes: that a reader needs.
        takes: the arguments of the function that is asked for, ``"A, B, x"``; "" for a value.
        points: in a course.
        seconds: that a check of it may take.
        random: True where an answer may give other results when it is called again.
    """

    number: str
    title: str
    minutes: int
    takes: str = ""
    points: int = 1
    seconds: float = 10.0
    random: bool = False
    properties: list[Property] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Enters the exercise in the list of all of them."""
        if not NUMBER.fullmatch(self.number):
            raise ValueError(f"number: expected one like '2.1', got {self.number!r}")
        EXERCISES[self.number] = self

    def must(self, sentence: str) -> Callable[[Callable], Callable]:
        """Adds the property that follows; ``sentence`` says it in words after "it must"."""

        def add(holds: Callable) -> Callable:
            self.properties.append(Property(sentence, holds))
            return holds

        return add


EXERCISES: dict[str, Exercise] = {}


def chapter(number: int) -> list[Exercise]:
    """Returns the exercises of a chapter, in the order of their file; none if it has no file.

    The file is ``chapter_02.py``; a long one goes on in others, ``chapter_02_....py``.
    """
    for module in pkgutil.iter_modules([str(Path(__file__).parent)]):
        if module.name.startswith(f"chapter_{number:02d}"):
            importlib.import_module(f"{__package__}.{module.name}")
    return [exercise for key, exercise in EXERCISES.items() if key.startswith(f"{number}.")]


def find(number: str) -> Exercise:
    """Returns the exercise of this number, or says which there are."""
    if not isinstance(number, str) or not (found := NUMBER.fullmatch(number)):
        raise ValueError(f"check: expected an exercise's number such as '2.1', got {number!r}")
    known = [exercise.number for exercise in chapter(int(found[1]))]
    if number not in known:
        there = f"it has {', '.join(known)}" if known else "it has none"
        raise ValueError(f"check: chapter {found[1]} has no exercise {number}; {there}")
    return EXERCISES[number]
