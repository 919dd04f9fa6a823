"""An exercise to check answers of."""

import pytest

from pypose_lite.teaching.checks import Exercise, exercise, expect, run


@pytest.fixture
def double(monkeypatch):
    """An exercise: write a function that doubles a vector."""
    monkeypatch.setattr(exercise, "EXERCISES", {})
    monkeypatch.setattr(run, "SESSION", {})
    double = Exercise("98.1", "Twice as long", minutes=5, takes="x", points=3, seconds=0.5)

    @double.must("return twice its argument")
    def doubled(answer, given):
        x = given.randn(3)
        mistakes = {"You have squared it.": x**2}
        expect.close("y", answer(x), 2 * x, "Add it to itself.", mistakes)

    return double
