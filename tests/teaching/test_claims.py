"""A claim shows and records what holds, and stops the cell at what does not."""

import math
import re
import subprocess
import sys

import nbformat
import numpy as np
import pytest
import torch
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

from pypose_lite.teaching.claims import Claim, claim, claims_in

NAN = math.nan


def executed(*cells):
    """The notebook of these code cells, run in a fresh kernel."""
    setup = "import torch\nfrom pypose_lite.teaching.claims import claim"
    code = [nbformat.v4.new_code_cell(source) for source in (setup, *cells)]
    notebook = nbformat.v4.new_notebook(cells=code)
    NotebookClient(notebook, timeout=60, kernel_name="python3").execute()
    return notebook


@pytest.mark.parametrize(
    ("value", "bounds"),
    [
        (0.0543, {"below": 0.058}),
        (4.0, {"above": 3.34, "below": 4.72}),
        (17, {"equals": 17}),
        (1.01, {"equals": 1, "within": 0.02}),
        (True, {"equals": True}),
        (torch.tensor(0.1), {"below": 0.2}),
        (torch.tensor([[0.1]], dtype=torch.float64), {"below": 0.2}),
        (np.float32(0.1), {"below": 0.2}),
        (math.inf, {"above": 0}),
    ],
)
def test_a_claim_that_holds_prints_its_line(value, bounds, capsys):
    claim("number", value, **bounds)
    assert capsys.readouterr().out.startswith("`number` = ")


@pytest.mark.parametrize(
    ("value", "bounds"),
    [
        (0.058, {"below": 0.058}),
        (3.34, {"above": 3.34, "below": 4.72}),
        (4.72, {"above": 3.34, "below": 4.72}),
        (16, {"equals": 17}),
        (1.03, {"equals": 1, "within": 0.02}),
        (False, {"equals": True}),
        (NAN, {"below": 1}),
        (NAN, {"above": 1}),
        (NAN, {"equals": 1, "within": 5}),
        (NAN, {"equals": NAN}),
    ],
)
def test_a_claim_that_does_not_hold_raises(value, bounds, capsys):
    with pytest.raises(AssertionError, match="claim does not hold: number = "):
        claim("number", value, **bounds)
    assert re.match("`number` = .*, claimed: ", capsys.readouterr().out)


def test_the_error_says_what_came_and_what_was_claimed():
    with pytest.raises(AssertionError, match=r"error = 0\.07 m; claimed: below 0\.058 m"):
        claim("error", 0.07, below=0.058, unit="m")


@pytest.mark.parametrize(
    ("name", "value", "bounds", "message"),
    [
        ("x", 1.0, {}, "x: a claim needs below=, above= or equals="),
        ("x", 1.0, {"below": 2, "within": 1}, "x: within= needs equals="),
        ("EKF error", 1.0, {"below": 2}, "name: expected lower-case .* got 'EKF error'"),
        ("x", torch.zeros(2), {"below": 2}, r"x: expected one number, got shape \(2,\)"),
        ("x", np.zeros((2, 1)), {"below": 2}, r"x: expected one number, got shape \(2, 1\)"),
        ("x", "1.0", {"below": 2}, "x: expected one number, got str"),
        ("x", None, {"below": 2}, "x: expected one number, got NoneType"),
    ],
)
def test_what_is_no_claim_is_refused(name, value, bounds, message):
    with pytest.raises(ValueError, match=message):
        claim(name, value, **bounds)


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        (0.054312, "m", "0.0543 m"),
        (0.0, "m", "0 m"),
        (48, "", "48"),
        (123456789, "", "123456789"),
        (1234.56, "s", "1235 s"),
        (1.23e-7, "", "1.23e-7"),
        (2.5e12, "Hz", "2.5e12 Hz"),
        (-0.5, "rad", "-0.5 rad"),
        (True, "", "yes"),
        (False, "", "no"),
        (math.inf, "", "inf"),
    ],
)
def test_numbers_are_shown_with_three_digits_and_their_unit(value, unit, shown):
    assert Claim("x", value, "", unit).number == shown


def test_the_line_names_the_bound_and_the_papers_number(capsys):
    claim("ekf_error", 0.0543, above=0.01, below=0.058, unit="m", paper=0.1803)
    line = "`ekf_error` = 0.0543 m, above 0.01 m and below 0.058 m (paper: 0.1803 m)\n"
    assert capsys.readouterr().out == line


def test_a_notebook_carries_its_claims_with_the_number_of_their_cell():
    notebook = executed(
        "x = 1",
        "claim('a', torch.tensor(0.25), below=1, unit='m', paper=0.5)\nclaim('b', 3, equals=3)",
        "claim('c', 2.0, above=1, varies=True)",
    )
    assert claims_in(notebook) == [
        Claim("a", 0.25, "below 1 m", "m", 0.5, cell=3),
        Claim("b", 3, "equal to 3", cell=3),
        Claim("c", 2.0, "above 1", varies=True, cell=4),
    ]


def test_a_notebook_shows_the_line_of_a_claim():
    output = executed("claim('a', 0.25, below=1, unit='m')").cells[1].outputs[0]
    assert output.data["text/markdown"] == "✓ `a` = 0.25 m, below 1 m"


def test_a_claim_that_does_not_hold_stops_the_notebook():
    with pytest.raises(CellExecutionError, match="claim does not hold: a = 2 ; claimed: below 1"):
        executed("claim('a', 2, below=1)")


def test_a_reader_who_changed_something_sees_the_number_that_came_beside_the_claim():
    cell = nbformat.v4.new_code_cell(
        "from pypose_lite.teaching.claims import claim\nclaim('a', 2, below=1)",
        metadata={"tags": ["raises-exception"]},
    )
    notebook = nbformat.v4.new_notebook(cells=[cell])
    NotebookClient(notebook, timeout=60, kernel_name="python3").execute()
    shown, error = notebook.cells[0].outputs
    assert shown.data["text/markdown"] == "✗ `a` = 2, claimed: below 1"
    assert claims_in(notebook) == [Claim("a", 2, "below 1", cell=1, holds=False)]
    assert error.ename == "AssertionError"


def test_claims_need_neither_ipython_nor_a_notebook():
    code = (
        "import sys; sys.modules['IPython'] = None\n"
        "from importlib.util import spec_from_file_location, module_from_spec\n"
        f"spec = spec_from_file_location('claims', {sys.modules[claim.__module__].__file__!r})\n"
        "claims = sys.modules['claims'] = module_from_spec(spec); spec.loader.exec_module(claims)\n"
        "claims.claim('a', 1, below=2)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (run.stdout, run.returncode) == ("`a` = 1, below 2\n", 0), run.stderr
