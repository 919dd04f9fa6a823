"""A check in a notebook: its verdict stands there once, and an interrupt is the reader's."""

import os
import signal
import threading

import nbformat
import pytest
from nbclient import NotebookClient

from pypose_lite.teaching.checks import verdicts_in

SETUP = """\
import time
from IPython.display import display
from pypose_lite.teaching.checks import Exercise, check, expect, progress

double = Exercise("98.1", "Twice <as> long", minutes=5, takes="x", seconds=1)

@double.must("return twice its argument")
def doubled(answer, given):
    expect.close("y", answer(3.0), 6.0)
"""
CELLS = {
    "right": "verdict = check('98.1', lambda x: 2 * x)\nverdict",
    "wrong": "check('98.1', lambda x: x)",
    "loud": "def loud(x):\n    print(1)\n    display(2)\n    return 2 * x\ncheck('98.1', loud)",
    "raising": "def own(x):\n    y = x\n    return 1 / 0\ncheck('98.1', own)",
    "endless": "def endless(x):\n    while True: pass\ncheck('98.1', endless)",
    "value": "assert verdict.passed and verdict.points == 1",
    "progress": "progress()",
}


@pytest.fixture(scope="module")
def outputs():
    """The outputs of each cell, by its name."""
    code = [nbformat.v4.new_code_cell(source) for source in (SETUP, *CELLS.values())]
    notebook = nbformat.v4.new_notebook(cells=code)
    NotebookClient(notebook, timeout=60, kernel_name="python3").execute()
    assert [verdict.state for verdict in verdicts_in(notebook)] == [
        "accepted",
        "refused",
        "accepted",
        "refused",
        "refused",
    ]
    return {name: cell.outputs for name, cell in zip(CELLS, notebook.cells[1:])}


@pytest.mark.parametrize("name", ["right", "wrong", "loud", "raising", "endless", "progress"])
def test_a_cell_shows_one_output(outputs, name):
    assert len(outputs[name]) == 1


def test_the_verdict_is_text_and_escaped_html(outputs):
    data = outputs["right"][0].data
    assert data["text/plain"] == "✓ 98.1 Twice <as> long: accepted."
    assert "✓ 98.1 Twice &lt;as&gt; long: accepted.</pre>" in data["text/html"]


def test_an_exception_names_the_line_of_the_cell(outputs):
    assert outputs["raising"][0].data["text/plain"].endswith("Line 3, in own: return 1 / 0")


def test_an_endless_loop_is_ended_and_the_kernel_lives(outputs):
    assert "had not come to an end after 1 s" in outputs["endless"][0].data["text/plain"]
    assert "0 of 1 exercises accepted" in outputs["progress"][0].data["text/plain"]


def test_the_result_can_be_used_and_shows_nothing_itself(outputs):
    assert outputs["value"] == []


@pytest.mark.skipif(os.name != "posix", reason="sends a signal")
def test_a_reader_can_interrupt_a_check():
    sources = SETUP, "double.seconds = 50", CELLS["endless"]
    cells = [nbformat.v4.new_code_cell(source) for source in sources]
    notebook = nbformat.v4.new_notebook(cells=cells)
    client = NotebookClient(notebook, timeout=60, kernel_name="python3", allow_errors=True)

    def interrupt():
        client.km.provisioner.process.send_signal(signal.SIGINT)

    with client.setup_kernel():
        for index, cell in enumerate(cells):
            if index == 2:
                threading.Timer(2, interrupt).start()
            client.execute_cell(cell, index)
    assert [output.get("ename") for output in cells[2].outputs] == ["KeyboardInterrupt"]
