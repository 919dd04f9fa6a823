"""Tags become folds: for the page builder, and in the metadata that JupyterLab reads."""

import jupytext
import nbformat
import pytest
from small_books import LESSON

from pypose_lite.teaching.pictures import Picture
from pypose_lite.teaching.site import folds


def claimed(name):
    """The output that a claim leaves."""
    record = {"name": name, "value": 1.0, "bound": "below 2"}
    return nbformat.v4.new_output("display_data", {"text/plain": ""}, metadata={"claim": record})


@pytest.fixture
def lesson():
    """A small lesson, as jupytext reads it, with the claims that a run leaves."""
    notebook = jupytext.reads(LESSON, "py:percent")
    for cell in notebook.cells:
        if "claims" in folds.tags_of(cell):
            cell.outputs = [claimed(cell.source.split('"')[1])]
    return notebook


def cells_with(notebook, tag):
    """The cells of a notebook with a tag."""
    return [cell for cell in notebook.cells if tag in folds.tags_of(cell)]


def test_on_the_page_the_set_up_and_the_claims_have_their_folds(lesson):
    page = folds.for_page(lesson)
    [setup] = cells_with(page, "setup")
    assert "hide-input" in setup.metadata.tags
    assert setup.metadata.mystnb.code_prompt_show == "Set-up"
    first, second = cells_with(page, "claims")
    assert first.metadata.mystnb.code_prompt_show == "1 claim holds"
    assert "hide-cell" in first.metadata.tags and "hide-cell" in second.metadata.tags


@pytest.mark.parametrize(("count", "text"), [(1, "1 claim holds"), (5, "5 claims hold")])
def test_a_fold_says_how_many_claims_hold(count, text):
    source = "\n".join(f"claim('a{k}', 1)" for k in range(count))
    cell = nbformat.v4.new_code_cell(source)
    assert folds.claims_hold(cell) == text
    cell.outputs = [claimed(f"a{k}") for k in range(count)]
    assert folds.claims_hold(cell) == text


def test_on_the_page_one_fold_is_around_all_of_an_answer(lesson):
    sources = [cell.source for cell in folds.for_page(lesson).cells]
    begins, ends = sources.index(folds.OPENED), sources.index(folds.CLOSED)
    assert sources[begins - 1].startswith("**Predict.**")
    assert sources[ends - 1].startswith("It is below it")
    assert any("print(" in source for source in sources[begins:ends])
    assert sources[ends + 1] == "A slider follows."


def test_on_the_page_a_link_from_the_scoreboard_finds_the_claim(lesson):
    sources = [cell.source for cell in folds.for_page(lesson).cells]
    place = sources.index('<a class="anchor" id="claim-steps"></a>')
    assert sources[place + 1].startswith('claim("steps"')


def test_in_jupyterlab_code_and_claims_are_folded_and_what_is_visible_is_not(lesson):
    lab = folds.for_lab(lesson)
    [setup] = cells_with(lab, "setup")
    assert setup.metadata.jupyter == {"source_hidden": True, "outputs_hidden": False}
    for cell in cells_with(lab, "claims"):
        assert cell.metadata.jupyter == {"source_hidden": True, "outputs_hidden": True}
        assert "raises-exception" in cell.metadata.tags  # a reader's change stops nothing
    [visible] = [cell for cell in lab.cells if cell.source.startswith("steps = 11")]
    assert "jupyter" not in visible.metadata


def test_in_jupyterlab_an_answer_has_a_button_before_it_and_each_cell_is_folded(lesson):
    cells = folds.for_lab(lesson).cells
    [button] = [k for k, cell in enumerate(cells) if "answer-button" in folds.tags_of(cell)]
    assert "**Predict.**" in cells[button - 1].source
    code, claims, text = cells[button + 1 : button + 4]
    assert code.metadata.jupyter == claims.metadata.jupyter
    assert code.metadata.jupyter == {"source_hidden": True, "outputs_hidden": True}
    assert text.source.startswith(folds.OPENED) and text.source.endswith(folds.CLOSED)


def test_folding_leaves_the_notebook_as_it_was_and_is_the_same_each_time(lesson):
    before = nbformat.writes(lesson)
    first, second = folds.for_lab(lesson), folds.for_lab(lesson)
    assert nbformat.writes(lesson) == before
    assert first == second
    nbformat.validate(folds.for_page(lesson))


def test_a_solutions_code_is_folded_on_the_page_and_its_output_is_not():
    cell = nbformat.v4.new_code_cell("answer = 3")
    folds.fold_code(cell)
    assert cell.metadata.tags == ["hide-input"]


def test_without_a_kernel_a_slider_is_its_first_picture():
    picture = Picture(b"...", "A line.").html
    state = {
        "box": {"state": {"children": ["IPY_MODEL_slider", "IPY_MODEL_picture"]}},
        "slider": {"state": {"value": 3}},
        "picture": {"state": {"value": picture}},
    }
    view = {folds.VIEW: {"model_id": "box"}, "text/plain": "VBox(...)"}
    output = nbformat.v4.new_output("display_data", view)
    cell = nbformat.v4.new_code_cell("widgets.panels(...)", outputs=[output])
    notebook = nbformat.v4.new_notebook(cells=[cell])
    notebook.metadata["widgets"] = {folds.STATE: {"state": state}}
    plain = folds.for_lab(notebook)
    assert plain.cells[0].outputs[0].data["text/html"] == picture
    assert "widgets" not in plain.metadata
