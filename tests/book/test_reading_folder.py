"""The folder for readers: brought up to date, but for what they have changed."""

import json

import nbformat
import pytest

from pypose_lite.teaching.site import lab

new = nbformat.v4


@pytest.fixture
def book(monkeypatch):
    """What the book holds now, by place: a test may change it."""
    made = {
        "1_lessons/03_mpc.ipynb": ["# MPC", "x = 1"],
        "2_exercises/03_mpc.ipynb": ["# Lab 3", "raise NotImplementedError"],
    }

    def staged(_executed):
        return {
            name: new.new_notebook(
                cells=[new.new_markdown_cell(text), new.new_code_cell(code)],
            )
            for name, (text, code) in made.items()
        }

    monkeypatch.setattr(lab, "staged", staged)
    return made


EXERCISE = "2_exercises/03_mpc.ipynb"


def code(path):
    """The code of a notebook's only code cell."""
    return nbformat.read(path, 4).cells[1].source


def answer(path, text, outputs=()):
    """What a reader does: changes the code, runs it, saves."""
    notebook = nbformat.read(path, 4)
    notebook.cells[1].source = text
    notebook.cells[1].outputs = list(outputs)
    nbformat.write(notebook, path)


def test_a_readers_answer_is_kept_and_the_rest_is_brought_up_to_date(book, tmp_path, capsys):
    lab.stage(None, tmp_path)
    answer(tmp_path / EXERCISE, "my_answer = 3")
    book[EXERCISE][1] = "raise NotImplementedError('2.1')"
    book["1_lessons/03_mpc.ipynb"][1] = "x = 2"
    lab.stage(None, tmp_path)
    assert code(tmp_path / EXERCISE) == "my_answer = 3"
    assert code(tmp_path / "1_lessons/03_mpc.ipynb") == "x = 2"
    assert capsys.readouterr().out == f"Left as you changed them: {EXERCISE}\n"


def test_running_a_notebook_is_no_change(book, tmp_path):
    lab.stage(None, tmp_path)
    printed = new.new_output("stream", text="1\n")
    answer(tmp_path / "1_lessons/03_mpc.ipynb", "x = 1", [printed])
    lab.stage(None, tmp_path)
    kept = nbformat.read(tmp_path / "1_lessons/03_mpc.ipynb", 4)
    assert kept.cells[1].outputs == [printed]  # nothing is new, so nothing is written
    book["1_lessons/03_mpc.ipynb"][1] = "x = 2"
    lab.stage(None, tmp_path)
    assert code(tmp_path / "1_lessons/03_mpc.ipynb") == "x = 2"


def test_a_notebook_that_a_reader_deleted_comes_back(book, tmp_path):
    lab.stage(None, tmp_path)
    (tmp_path / EXERCISE).unlink()
    lab.stage(None, tmp_path)
    assert code(tmp_path / EXERCISE) == "raise NotImplementedError"


def test_what_the_book_no_longer_has_goes_unless_a_reader_has_changed_it(book, tmp_path):
    lab.stage(None, tmp_path)
    answer(tmp_path / EXERCISE, "my_answer = 3")
    book.clear()
    lab.stage(None, tmp_path)
    lab.stage(None, tmp_path)
    assert [path.name for path in tmp_path.rglob("*.ipynb")] == ["03_mpc.ipynb"]
    assert code(tmp_path / EXERCISE) == "my_answer = 3"


def test_an_exercise_is_reset_and_the_readers_version_stays_beside_it(book, tmp_path):
    lab.stage(None, tmp_path)
    for k in (1, 2):
        answer(tmp_path / EXERCISE, f"answer = {k}")
        lab.reset(None, tmp_path, "03_mpc")
        assert code(tmp_path / EXERCISE) == "raise NotImplementedError"
    assert code(tmp_path / "2_exercises/03_mpc.mine.ipynb") == "answer = 1"
    assert code(tmp_path / "2_exercises/03_mpc.mine2.ipynb") == "answer = 2"
    book[EXERCISE][1] = "raise NotImplementedError('2.1')"
    lab.reset(None, tmp_path, "03_mpc")
    book[EXERCISE][1] = "raise NotImplementedError('2.2')"
    lab.stage(None, tmp_path)
    assert code(tmp_path / EXERCISE) == "raise NotImplementedError('2.2')"


def test_any_notebook_is_reset_by_its_place(book, tmp_path):
    lab.stage(None, tmp_path)
    answer(tmp_path / "1_lessons/03_mpc.ipynb", "x = 5")
    lab.reset(None, tmp_path, "1_lessons/03_mpc")
    assert code(tmp_path / "1_lessons/03_mpc.ipynb") == "x = 1"


@pytest.mark.parametrize(
    ("wanted", "message"),
    [("", "which one\\? make reset EXERCISE=03_mpc"), ("09_no", "there is no 2_exercises/09_no")],
)
def test_a_reset_of_nothing_says_what_there_is(book, tmp_path, wanted, message):
    with pytest.raises(SystemExit, match=message):
        lab.reset(None, tmp_path, wanted)


def test_the_book_for_readers_has_no_markup_and_begins_with_a_page_that_leads_on(tmp_path):
    made = lab.staged(tmp_path)
    assert {name.split("/")[0] for name in made} >= {"1_lessons", "start_here.ipynb"}
    assert all(name.endswith(".ipynb") for name in made)
    start = "".join(cell.source for cell in made["start_here.ipynb"].cells)
    assert "(1_lessons/01_systems.ipynb)" in start
    for name, notebook in made.items():
        for cell in notebook.cells:
            if cell.cell_type == "markdown":
                assert "{claim}" not in cell.source.replace("``{claim}", ""), name
                assert ":::" not in cell.source, name


def test_numbers_that_are_not_known_yet_have_a_place_for_the_kernels(tmp_path):
    made = lab.staged(tmp_path)
    start = "".join(cell.source for cell in made["start_here.ipynb"].cells)
    assert '<span class="claim" title="steps">…</span>' in start


def test_jupyterlab_asks_no_question_about_news(tmp_path):
    environment = lab.settings(tmp_path / "config")
    file = tmp_path / "config" / "labconfig" / "default_setting_overrides.json"
    written = json.loads(file.read_text(encoding="utf-8"))
    assert environment == {"JUPYTER_CONFIG_DIR": str(tmp_path / "config")}
    assert written["@jupyterlab/apputils-extension:notification"]["fetchNews"] == "false"


@pytest.mark.parametrize(("user", "allowed"), [(0, True), (1000, False)])
def test_jupyterlab_starts_for_root_too(monkeypatch, user, allowed):
    monkeypatch.setattr(lab.os, "geteuid", lambda: user)
    assert ("--allow-root" in lab.command()) is allowed
