"""The answers that graders are tested on: small functions or values, right or wrong.

    @right("2.1")
    def with_the_inverse(A, B, Q, R, V): ...

    @wrong("2.1", "K has the opposite sign")
    def sign(A, B, Q, R, V): ...

    wrong("2.2", "returns")("a")
    wrong("1.6", "shape", "half of it")(lap[:64])

``wrong`` says what the verdict has to say, too. A file a chapter, ``answers_02.py``, holds them.
"""

from typing import Any, NamedTuple


class Case(NamedTuple):
    """An answer, and a part of the verdict on it; None where it has to be accepted."""

    number: str
    answer: Any
    says: str | None
    words: str

    @property
    def name(self) -> str:
        return f"{self.number}-{self.words or getattr(self.answer, '__name__', repr(self.answer))}"


CASES: list[Case] = []


def right(number: str, words: str = ""):
    """Adds an answer that has to be accepted; ``words`` name it where it has no name."""
    return wrong(number, None, words)


def wrong(number: str, says: str | None, words: str = ""):
    """Adds an answer that has to be refused by a verdict that contains what ``says`` says."""

    def add(answer):
        CASES.append(Case(number, answer, says, words))
        return answer

    return add
