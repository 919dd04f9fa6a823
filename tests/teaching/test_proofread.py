"""Each rule complains about what it should, and about nothing else."""

import nbformat
import pytest

from pypose_lite.teaching.proofread import (
    claims_twice,
    claims_unmade,
    complaints,
    figures_without_claim,
    long_cells,
    measured_numbers,
    wide_lines,
)

new = nbformat.v4
PICTURE = new.new_output("display_data", {"image/png": "iVBORw0KGgo="})
WIDGET = new.new_output(
    "display_data", {"application/vnd.jupyter.widget-view+json": {"model_id": "0"}}
)
FILM = new.new_output("execute_result", {"text/html": "<div><img src='data:image/gif;...'></div>"})
TEXT = new.new_output("stream", text="48 steps\n")


def claimed(name):
    """The output that a claim leaves."""
    record = {"name": name, "value": 1.0, "bound": "below 2"}
    return new.new_output("display_data", {"text/plain": "..."}, metadata={"claim": record})


def notebook(*cells):
    """A notebook of text cells (strings) and code cells (lists of outputs)."""
    return new.new_notebook(
        cells=[
            new.new_markdown_cell(cell)
            if isinstance(cell, str)
            else new.new_code_cell("...", outputs=cell)
            for cell in cells
        ]
    )


@pytest.mark.parametrize(
    "prose",
    [
        "The error is 0.21 on average.",
        "The error is 0.21 m.",
        "It stops after 3 s.",
        "It stops after 3s.",
        "A rate of 50 Hz",
        "in 12 ms",
        "four cars in 1.5e-3",
        "It is 8 times faster.",
        "only 5 % of them",
        "only 5% of them",
        "turns by 30°",
        "**0.31**",
        "(0.31)",
        "-0.31",
        "| EKF | 0.0551 |",
        "## The error falls to 0.06 m",
        "a `claim`, then 0.21, then $x$",
        "between $3$ and 0.7",
        "about 1.000",
    ],
)
def test_a_measured_number_in_prose_is_found(prose):
    assert len(list(measured_numbers(notebook(prose)))) == 1


@pytest.mark.parametrize(
    "prose",
    [
        "The car visits 17 waypoints in 48 steps.",
        "The error is {claim}`ekf_error` and `0.21` is code.",
        "$x = 0.21$ and $$ y = 0.3 \\text{ m} $$ and\n\n$$\nz = 0.4\n$$ (eq-z)",
        "```python\nx = 0.21\n```",
        "a [link 3](https://example.org/0.21) and https://example.org/1.5",
        "<img width='3.5 m'>",
        "PyPose 0.9.5, PyPose v0.6, version 1.2.3, Section 3.2, Python 3.11, Fig. 2.1",
        "Noise 0.163, dt 0.1 s, two circles of 1 m, eight arcs of 45 degrees, 95 % interval",
        "The paper has 0.2045 m, 0.1803 m, 0.1802 m and 0.0959 m.",
        "Rate 20 Hz, reach 0.3 m. <!-- given: 20 Hz, 0.3 m -->",
        "Time: 90 minutes.\n\n<!-- given: 90 minutes -->",
        "<!-- a note to ourselves:\n0.21 m > 0.2 m -->",
        "a 2-D world, the 3rd member, x10 s_3, chapter 3 shows",
        "3 monkeys, 4 sheep and 5 hertzes",
    ],
)
def test_other_numbers_in_prose_are_not_complained_about(prose):
    assert list(measured_numbers(notebook(prose))) == []


def test_a_number_is_given_in_its_own_cell_only():
    text = notebook("<!-- given: 20 Hz -->", "A rate of 20 Hz.")
    assert len(list(measured_numbers(text))) == 1


def test_numbers_in_code_cells_are_not_prose():
    assert list(measured_numbers(notebook([TEXT]))) == []


def test_the_complaint_says_how_to_mend_it():
    [complaint] = measured_numbers(notebook("The error is 0.21 m."))
    for part in ("'0.21 m'", "{claim}`its_name`", "<!-- given: 0.21 m -->", "The error is"):
        assert part in complaint


@pytest.mark.parametrize("figure", [PICTURE, WIDGET, FILM])
def test_a_section_that_only_shows_is_found(figure):
    found = figures_without_claim(notebook("# One", [claimed("a")], "## Two", [figure], "## Three"))
    assert list(found) == [
        "section 'Two' shows a figure and claims nothing: add a claim(...) under it"
    ]


@pytest.mark.parametrize(
    "cells",
    [
        ["# One", [PICTURE], [claimed("a")]],
        ["# One", [claimed("a")], "text", [PICTURE]],
        ["# One", [PICTURE, claimed("a")]],
        ["# One", [PICTURE], "### Below One", [claimed("a")]],
        ["# One", [PICTURE], "```\n# no heading\n```", [claimed("a")]],
        ["# One", [TEXT], "## Two", [TEXT]],
        ["# One", [PICTURE], [claimed("a")], "## Two", "text"],
    ],
)
def test_a_claim_in_the_same_section_is_enough(cells):
    assert list(figures_without_claim(notebook(*cells))) == []


@pytest.mark.parametrize("cells", [[[PICTURE]], ["# One", [PICTURE]]])
def test_the_first_and_the_last_section_count_too(cells):
    assert len(list(figures_without_claim(notebook(*cells)))) == 1


def test_a_name_is_claimed_once():
    text = notebook([claimed("a"), claimed("b")], [claimed("a")])
    assert list(claims_twice(text)) == [
        "claim 'a' is made 2 times: text could not tell which one it means"
    ]


def test_text_refers_to_claims_that_are_made():
    text = notebook("{claim}`a`, {claim}`b`, {claim}`04_ekf.c` and ``{claim}`d` ``", [claimed("a")])
    assert list(claims_unmade(text)) == ["text refers to {claim}`b`, which no cell claims"]


def program(*sources, tags=()):
    """A notebook of code cells."""
    cells = [new.new_code_cell(source, metadata={"tags": list(tags)}) for source in sources]
    return new.new_notebook(cells=cells)


@pytest.mark.parametrize("tags", [[], ["hide-input"], ["remove-cell"]])
def test_a_code_cell_of_more_than_20_lines_is_found(tags):
    [complaint] = long_cells(program("i = 1\n" * 20, "j = 2\n\n" + "k = 3\n" * 19, tags=tags))
    assert complaint.startswith("a code cell has 21 lines, more than 20: ")
    assert complaint.endswith("begins 'j = 2'")


def test_a_code_cell_may_have_20_lines_and_a_text_cell_more():
    text = program("i = 1\n" * 20, "\n\n" + "i = 1\n" * 20 + " \n\n")
    assert list(long_cells(text)) == []
    assert list(long_cells(notebook("a line\n" * 30))) == []


@pytest.mark.parametrize("line", ["x = " + 83 * "1", "# " + 85 * "y", 4 * " " + 83 * "z"])
def test_a_line_of_code_of_more_than_86_columns_is_found(line):
    [complaint] = wide_lines(program(f"i = 1\n{line}\nj = 2"))
    assert complaint.startswith("a line of code has 87 columns, more than 86: ")
    assert complaint.endswith(repr(line.strip()))


def test_a_line_of_code_may_have_86_columns_and_a_line_of_text_more():
    assert list(wide_lines(program("x = " + 82 * "1", "x = " + 82 * "1" + "  "))) == []
    assert list(wide_lines(notebook("word " * 40))) == []


def test_all_rules_are_applied():
    text = notebook("# 0.21 m {claim}`b`", [PICTURE], "# Two", [claimed("a"), claimed("a")])
    text.cells.append(new.new_code_cell("i = 1\n" * 20 + 87 * "j"))
    assert len(complaints(text)) == 6
