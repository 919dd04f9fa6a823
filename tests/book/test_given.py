"""Exercises show what is given, and nothing that an answer would show."""

import nbformat
import pytest

from pypose_lite.teaching.site.given import with_given_outputs

new = nbformat.v4


def notebook(*sources, ran=False):
    """A notebook of code cells; where it has run, each has printed its own source."""
    cells = [new.new_code_cell(source) for source in sources]
    for cell in cells if ran else []:
        cell.outputs = [new.new_output("stream", text=cell.source)]
    return new.new_notebook(cells=cells)


@pytest.mark.parametrize(
    ("exercise", "solution", "shown"),
    [
        (["x = 1", "plot(x)"], ["x = 1", "plot(x)"], [True, True]),
        (["def f(): stub", "check(f)"], ["def f(): 1", "check(f)"], [False, False]),
        (
            ["def f(): stub", "y = f()", "plot(y)", "plot(3)"],
            ["def f(): 1", "y = f()", "plot(y)", "plot(3)"],
            [False, False, False, True],
        ),
        (["raise stub", "check(a)"], ["a = 3", "check(a)"], [False, False]),
        (["x = 1", "progress()"], ["x = 1", "progress()"], [True, False]),
        (["raise stub", "b = a", "plot(b)"], ["a = 3", "b = a", "plot(b)"], [False] * 3),
    ],
)
def test_what_depends_on_an_answer_is_not_shown(exercise, solution, shown):
    made = with_given_outputs(notebook(*exercise), notebook(*solution, ran=True))
    assert [bool(cell.outputs) for cell in made.cells] == shown
