"""The answers that graders are tested on: small functions or values, right or wrong.

    @right("2.1")
    def with_the_inverse(A, B, Q, R, V): ...

    @wrong("2.1", "K has the opposite sign")
    def sign(A, B, Q, R, V): ...

    wrong("2.2", "returns")("a")

``wrong`` says what the verdict has to say, too. A file a chapter, ``answers_02.py``, holds them.
"""

from typing import Any, NamedTuple


class Case(NamedTuple):
    """An answer, and a part of the verdict on it; None where it has to be accepted."""

    number: str
    answer: Any
    says: str | None

    @property
    def name(self) -> str:
        return f"{self.number}-{getattr(self.answer, '__name__', repr(self.answer)[:40])}"


CASES: list[Case] = []


def right(number: str):
    """Adds an answer that has to be accepted."""
    return lambda answer: CASES.append(Case(number, answer, None)) or answer


def wrong(number: str, says: str):
    """Adds an answer that has to be refused by a verdict that contains these words."""
    return lambda answer: CASES.append(Case(number, answer, says)) or answer
