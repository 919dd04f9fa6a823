"""Each rule complains about what it should, and about nothing else."""

from pathlib import Path

import jupytext
import nbformat
import pytest

from pypose_lite.teaching.proofread import complaints, shared_headings
from pypose_lite.teaching.proofread.code import folded_names, long_cells, statements, wide_lines
from pypose_lite.teaching.proofread.prose import (
    headings_in_answers,
    measured_numbers,
    numbers_in_words,
    predictions,
)
from pypose_lite.teaching.proofread.shown import (
    claims_in_their_cells,
    claims_twice,
    claims_unmade,
    figures_that_are_not_there,
    figures_without_claim,
    figures_without_text,
    refused_answers,
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


def judged(state):
    """The output that a check leaves."""
    record = {"number": "2.1", "state": state, "message": "2.1 Step: so", "points": 0, "out_of": 1}
    return new.new_output("display_data", {"text/plain": "..."}, metadata={"verdict": record})


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
    [fault] = measured_numbers(notebook("The error is 0.21 m."))
    for part in ("'0.21 m'", "{claim}`its_name`", "<!-- given: 0.21 m -->"):
        assert part in fault.text


@pytest.mark.parametrize("figure", [PICTURE, WIDGET, FILM])
def test_a_section_that_only_shows_is_found(figure):
    found = figures_without_claim(notebook("# One", [claimed("a")], "## Two", [figure], "## Three"))
    assert [fault.text for fault in found] == [
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
    assert [fault.text for fault in claims_twice(text)] == [
        "claim 'a' is made twice: text could not tell which one it means"
    ]


def test_text_refers_to_claims_that_are_made():
    text = notebook("{claim}`a`, {claim}`b`, {claim}`04_ekf.c` and ``{claim}`d` ``", [claimed("a")])
    assert [fault.text for fault in claims_unmade(text)] == [
        "text refers to {claim}`b`, which no cell claims"
    ]


def program(*sources, tags=()):
    """A notebook of code cells."""
    cells = [new.new_code_cell(source, metadata={"tags": list(tags)}) for source in sources]
    return new.new_notebook(cells=cells)


@pytest.mark.parametrize(("tags", "most"), [([], 20), (["hide-input"], 40), (["answer"], 40)])
def test_a_code_cell_that_does_not_fit_on_a_screen_is_found(tags, most):
    text = program("i = 1\n" * most, "j = 2\n\n" + "k = 3\n" * (most - 1), tags=tags)
    [fault] = long_cells(text)
    assert fault.text.startswith(f"a code cell has {most + 1} lines, more than {most}: ")
    assert fault.cell == 1


def test_a_code_cell_may_have_20_lines_and_a_text_cell_more():
    text = program("i = 1\n" * 20, "\n\n" + "i = 1\n" * 20 + " \n\n")
    assert list(long_cells(text)) == []
    assert list(long_cells(notebook("a line\n" * 30))) == []


@pytest.mark.parametrize("line", ["x = " + 83 * "1", "# " + 85 * "y", 4 * " " + 83 * "z"])
def test_a_line_of_code_of_more_than_86_columns_is_found(line):
    [fault] = wide_lines(program(f"i = 1\n{line}\nj = 2"))
    assert fault.text.startswith("a line of code has 87 columns, more than 86: ")
    assert fault.text.endswith(repr(line.strip()))
    assert (fault.cell, fault.line) == (0, 1)


def test_a_line_of_code_may_have_86_columns_and_a_line_of_text_more():
    assert list(wide_lines(program("x = " + 82 * "1", "x = " + 82 * "1" + "  "))) == []
    assert list(wide_lines(notebook("word " * 40))) == []


@pytest.mark.parametrize(
    ("prose", "number"),
    [
        ("It takes 12 steps.", "12 steps"),
        ("It is twice as good.", "twice"),
        ("Half as much noise", "Half"),
        ("half of the runs", "half"),
        ("It turns by two degrees.", "two degrees"),
        ("ten times faster", "ten times"),
        ("after a hundred\nlaps", "a hundred laps"),
        ("a tenth of the cost", "a tenth"),
        ("a twenty-step plan", "twenty-step"),
    ],
)
def test_a_number_in_words_is_found(prose, number):
    [fault] = numbers_in_words(notebook(prose))
    assert f"prose states {number!r}." in fault.text


@pytest.mark.parametrize(
    "prose",
    [
        "one step at a time, two circles, three ways, on behalf of the half-plane",
        "It takes {claim}`steps` steps, $2$ times, `twice`.",
        "It looks ten steps ahead. <!-- given: ten steps -->",
        "twice, and half a metre <!-- given: twice,\n half -->",
        "The car visits 17 waypoints.",
    ],
)
def test_other_words_are_not_complained_about(prose):
    assert list(numbers_in_words(notebook(prose))) == []


def lesson(source):
    """The notebook of a jupytext file."""
    return jupytext.reads(source, "py:percent")


PREDICT = """\
# %% [markdown]
# **Predict.** More, or less?
"""
ANSWER = """\
# %% tags=["answer"]
print(1)
# %% [markdown] tags=["answer"]
# Less.
"""


def test_a_question_is_followed_by_its_folded_answer():
    assert list(predictions(lesson(PREDICT + ANSWER + PREDICT + ANSWER))) == []


@pytest.mark.parametrize("source", [PREDICT, PREDICT + "# %%\nprint(1)\n" + PREDICT + ANSWER])
def test_a_question_without_an_answer_is_found(source):
    [fault] = predictions(lesson(source))
    assert (fault.cell, fault.text) == (0, 'after **Predict.** comes a cell with the tag "answer"')


def test_an_answer_without_a_question_is_found():
    [fault] = predictions(lesson("# %% [markdown]\n# No question.\n" + ANSWER))
    expected = "an answer without a text before it that asks: **Predict.**"
    assert (fault.cell, fault.text) == (1, expected)


def test_a_heading_in_an_answer_is_found():
    answer = '# %% [markdown] tags=["answer"]\n# Less.\n#\n# ### Why\n'
    [fault] = headings_in_answers(lesson(PREDICT + answer))
    assert (fault.line, "'### Why' in an answer" in fault.text) == (2, True)
    plain = PREDICT + "# %% [markdown]\n# ### Why\n" + ANSWER
    assert list(headings_in_answers(lesson(plain))) == []


@pytest.mark.parametrize(
    ("code", "text"),
    [
        ("a = 1; b = 2", "two statements on a line"),
        ("if a: b = 2", "two statements on a line"),
        ("def f(x): return x", "two statements on a line"),
        ("print(n := 3)", ":= in an expression"),
        ("a, b = 1, 2", "a tuple assigned to a tuple"),
        ("def f():\n    a, b = [], {}", "a tuple assigned to a tuple"),
    ],
)
@pytest.mark.parametrize("tags", [[], ["answer"]])
def test_a_line_that_does_two_things_is_found(code, text, tags):
    [fault] = statements(program("x = 1\n" + code, tags=tags))
    assert fault.text.startswith(text)
    assert fault.line == 1 + code.count("\n")


@pytest.mark.parametrize(
    "code",
    [
        "a, b = f(x)\nfor i, j in pairs:\n    print(i)",
        "q, (r, s) = torch.linalg.qr(A)",
        "f = lambda x: x\nif a:\n    b = 2\nelse:\n    b = 3",
        "%time x = 1\n!ls",
    ],
)
def test_a_line_that_does_one_thing_is_not_complained_about(code):
    assert list(statements(program(code))) == []


@pytest.mark.parametrize("tag", ["hide-input", "claims", "setup", "as-printed"])
def test_folded_code_may_be_dense_and_so_may_a_listing_of_somebody_else(tag):
    assert list(statements(program("a, b = 1, 2; c = 3", tags=[tag]))) == []


SETUP = '# %% tags=["setup"]\nimport torch\ndt = 0.1\n'
FOLDED = '# %% tags=["{}"]\ngain = 2\ndef secret(x):\n    inner = x\n    return inner\n'
USE = "# %%\nfor k in range(3):\n    y = torch.ones(1) * dt\nz = secret(gain + gain)\n"


@pytest.mark.parametrize("tag", ["hide-input", "claims", "answer", "remove-cell"])
def test_a_name_that_only_a_folded_cell_defines_is_found(tag):
    faults = list(folded_names(lesson(SETUP + FOLDED.format(tag) + USE)))
    assert [fault.text.split("'")[1] for fault in faults] == ["secret", "gain"]
    assert {(fault.cell, fault.line) for fault in faults} == {(2, 2)}


@pytest.mark.parametrize(
    "source",
    [
        "# %%\ngain, secret = f()\n" + FOLDED.format("hide-input") + USE,
        FOLDED.format("hide-input")
        + "# %%\ngain = 3\ndef secret(inner):\n    return inner + gain\n",
        FOLDED.format("hide-input") + '# %% tags=["hide-input"]\nsecret(gain)\n',
        FOLDED.format("setup") + USE,
        FOLDED.format("claims") + "# %%\n[inner for inner in range(3)]\n",
    ],
)
def test_a_name_that_a_reader_has_seen_is_not_complained_about(source):
    assert list(folded_names(lesson(SETUP + source))) == []


NO_TEXT = new.new_output("display_data", {"text/html": "<img src='data:...' alt=\"\">"})
WITH_TEXT = new.new_output("display_data", {"text/html": '<img alt="A line." src="data:...">'})


@pytest.mark.parametrize("figure", [PICTURE, FILM, NO_TEXT])
def test_a_figure_without_an_alternative_text_is_found(figure):
    [fault] = figures_without_text(notebook("# One", [figure]))
    assert fault.cell == 1
    assert 'plotting.show(fig, "what it shows")' in fault.text


@pytest.mark.parametrize("call", ["widgets.panels(draw, [1])", "animate(draw, 3, alt=' ')"])
def test_a_slider_or_a_film_without_an_alternative_text_is_found(call):
    [fault] = figures_without_text(program(f"x = 1\ndisplay({call})"))
    assert (fault.line, 'alt="what it shows"' in fault.text) == (1, True)


def test_a_figure_with_an_alternative_text_is_not_complained_about():
    assert list(figures_without_text(notebook([WITH_TEXT, TEXT, claimed("a")]))) == []
    calls = "widgets.live(draw, alt='A line.', k=1)\nanimate(draw, 3, alt=text)\nlive = 3"
    assert list(figures_without_text(program(calls))) == []


def test_claims_stand_in_cells_of_their_own():
    code = "error = x.mean()\nfor name in names:\n    claim(name, error, below=1)\nclaim('a', 1)"
    assert list(claims_in_their_cells(program(code, tags=["claims"]))) == []
    assert list(claims_in_their_cells(program("claimed = 3\nprint(claimed)"))) == []


@pytest.mark.parametrize("code", ["print(3)", "plt.show()", "import torch", "x"])
def test_a_cell_of_claims_does_nothing_beside(code):
    [fault] = claims_in_their_cells(program(f"claim('a', 1)\n{code}", tags=["claims"]))
    assert (fault.line, "not this" in fault.text) == (1, True)


@pytest.mark.parametrize("code", ["claim('a', 1)", "for x in y:\n    claim(x, 1)"])
def test_a_claim_elsewhere_is_found(code):
    [fault] = claims_in_their_cells(program(code, tags=["hide-input"]))
    assert fault.text == 'a claim outside a cell with the tag "claims"'


def test_chapters_share_no_headings_of_the_second_level():
    chapters = {
        "01_a": notebook("# One\n\n## From scratch\n\n### More", "## Summary"),
        "02_b": notebook("# One\n\n## From scratch", "### More\n\n## Summary"),
    }
    [complaint] = shared_headings(chapters)
    assert complaint.startswith("02_b and 01_a have the same heading, 'From scratch'")
    assert shared_headings({"01_a": chapters["01_a"]}) == []


SOURCE = """\
# ---
# jupyter: {kernelspec: {name: python3}}
# ---

# %% [markdown]
# # One
#
# It is 0.21 m.

# %%
x = 1

y = 2; z = 3
"""


@pytest.fixture
def chapter(tmp_path):
    """Writes a chapter into a folder ``book``, and returns its complaints."""

    def write(source, name="10_new.py"):
        path = tmp_path / "book" / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(source, encoding="utf-8")
        return complaints(lesson(source), path)

    return write


def test_a_complaint_begins_with_the_file_and_the_line(chapter):
    first, second = chapter(SOURCE)
    assert first.startswith("book/10_new.py:8: prose states '0.21 m'")
    assert second.startswith("book/10_new.py:13: two statements on a line")


def test_a_lab_may_count_in_words():
    text = notebook("Half a metre, in 12 steps.")
    assert complaints(text, Path("solutions/03_mpc.py")) == []
    assert len(complaints(text, Path("tutorials/03_mpc.py"))) == 2


def test_all_rules_are_applied():
    text = notebook("# 0.21 m {claim}`b`, twice", [PICTURE], "# Two", [claimed("a"), claimed("a")])
    text.cells.append(new.new_code_cell("i = 1\n" * 20 + 87 * "j"))
    text.cells += lesson(PREDICT + FOLDED.format("hide-input") + USE).cells
    text.cells += program("claim('a', 1); live()").cells
    text.cells += lesson(PREDICT + '# %% [markdown] tags=["answer"]\n# # No\n').cells
    text.cells += lesson("# %% [markdown]\n# \n" + ANSWER).cells
    kinds = {complaint[:12] for complaint in complaints(text)}
    assert len(kinds) == 14, kinds


def test_a_check_proves_what_a_figure_shows():
    cells = "## One", [PICTURE], [judged("accepted")]
    assert list(figures_without_claim(notebook(*cells))) == []


@pytest.mark.parametrize("state", ["refused", "open"])
def test_a_check_that_refuses_its_solution_is_a_fault(state):
    [fault] = refused_answers(notebook("## One", [judged("accepted")], [judged(state)]))
    assert fault.cell == 2
    assert "a check does not accept what it is given: " in fault.text
    assert "2.1 Step: so" in fault.text


@pytest.mark.parametrize(
    ("prose", "found"), [("*10 minutes. Warm-up.*", 0), ("It takes 10 minutes. *So.*", 1)]
)
def test_the_minutes_of_an_exercise_are_given(prose, found):
    assert len(list(measured_numbers(notebook(prose)))) == found


@pytest.mark.parametrize(
    "call", ["plotting.show(fig, 'A.')", "plt.show()", "widgets.panels(draw, [1], 'x', alt='A.')"]
)
def test_a_cell_that_shows_a_figure_and_has_none_is_found(call):
    [fault] = figures_that_are_not_there(program(f"x = 1\n{call}"))
    assert (fault.line, fault.text.split("(")[0]) == (1, f"no figure came of {call.split('(')[0]}")


@pytest.mark.parametrize(
    "code", ["def draw():\n    plt.show()", "show(report)", "draw = lambda: plt.show()"]
)
def test_a_cell_that_shows_nothing_yet_is_not_complained_about(code):
    assert list(figures_that_are_not_there(program(code))) == []


def test_a_cell_with_its_figure_is_not_complained_about():
    lesson = program("plotting.show(fig, 'A.')")
    lesson.cells[-1].outputs = [PICTURE]
    assert list(figures_that_are_not_there(lesson)) == []
