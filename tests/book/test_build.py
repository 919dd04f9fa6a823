"""The scripts between a chapter and its page: run, fill in, compare, list."""

import json
import os
import subprocess
import sys

import nbformat
import pytest
from nbclient.exceptions import CellExecutionError
from small_books import CLAIM, ERROR, HEADER, PROSE

from pypose_lite.teaching.claims import Claim
from pypose_lite.teaching.site import docstrings, execute, scoreboard, stage

CAR = Claim("error", 0.0543, "below 0.058 m", "m", 0.1803, cell=3)
STEPS = Claim("steps", 48, "below 60", cell=4)
CLAIMS = {("03_mpc", "error"): CAR, ("03_mpc", "steps"): STEPS, ("04_ekf", "error"): STEPS}


@pytest.fixture
def chapter(tmp_path):
    """Writes a chapter of these cells and returns its path."""

    def write(*cells):
        path = tmp_path / "x.py"
        path.write_text(HEADER + "".join(cells), encoding="utf-8")
        return path

    return write


def test_a_chapter_that_holds_becomes_a_notebook_with_outputs(chapter, tmp_path):
    line = execute.execute(chapter(CLAIM.format(0.25)), tmp_path / "out" / "x.ipynb")
    notebook = nbformat.read(tmp_path / "out" / "x.ipynb", as_version=4)
    assert line.startswith("x: 1 claims hold (")
    assert "claim" in notebook.cells[1].outputs[0].metadata


@pytest.mark.parametrize(
    ("cell", "message"),
    [
        (CLAIM.format(1.25), "claim does not hold: a = 1.25 m; claimed: below 1 m"),
        (ERROR, "ZeroDivisionError"),
        (PROSE, "prose states '0.21 m'"),
    ],
)
def test_a_chapter_that_does_not_hold_leaves_no_notebook(chapter, tmp_path, cell, message):
    with pytest.raises((CellExecutionError, ValueError), match=message):
        execute.execute(chapter(cell), tmp_path / "out.ipynb")
    assert not (tmp_path / "out.ipynb").exists()


def test_a_chapter_that_does_not_hold_ends_the_build_without_a_traceback(chapter, tmp_path):
    command = [sys.executable, "-m", execute.__name__, chapter(PROSE), tmp_path / "out.ipynb"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    assert "x.py: does not pass its proofreading:" in done.stderr
    assert "/x.py:6: prose states '0.21 m'" in done.stderr
    assert "Traceback" not in done.stderr


PLOT = """\
# %% tags=["setup"]
import matplotlib.pyplot as plt
from pypose_lite.teaching.claims import claim
# %%
_ = plt.plot([0, 1])
plt.show()
# %% tags=["claims"]
claim("a", 0.5, below=1)
"""
WHAT_TO_DO = "most often because memory ran out: close other programs, run it again"


def test_a_figure_is_there_whatever_backend_the_reader_has_set(chapter, tmp_path, monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "Agg")
    with pytest.raises(ValueError, match="a figure without an alternative text"):  # one is there
        execute.execute(chapter(PLOT), tmp_path / "out.ipynb")


def test_a_figure_that_does_not_appear_ends_the_build(chapter, tmp_path):
    use = "import matplotlib\nmatplotlib.use('Agg')\nimport matplotlib.pyplot"
    no_screen = PLOT.replace("import matplotlib.pyplot", use)
    with pytest.raises(ValueError, match="no figure came of plt.show"):
        execute.execute(chapter(no_screen), tmp_path / "out.ipynb")


def test_a_kernel_that_dies_is_said_in_one_line_with_what_to_do(chapter, tmp_path):
    dies = chapter("# %%\nimport os\nos._exit(1)\n")
    command = [sys.executable, "-m", execute.__name__, dies, tmp_path / "out.ipynb"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    *_, line = done.stderr.splitlines()
    assert line.endswith(f"x.py: its kernel died, {WHAT_TO_DO}")
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("kernel", "why"),
    [
        ("python3", "Kernel died before replying to kernel_info"),
        ("fortran", "No such kernel named fortran"),
    ],
)
def test_a_kernel_that_does_not_start_is_said_in_one_line_with_what_to_do(
    chapter, tmp_path, kernel, why
):
    spec = tmp_path / "kernels" / "python3" / "kernel.json"
    spec.parent.mkdir(parents=True)
    ends_at_once = {"argv": ["false"], "display_name": "broken", "language": "python"}
    spec.write_text(json.dumps(ends_at_once), encoding="utf-8")
    page = chapter(CLAIM.format(0.25))
    page.write_text(page.read_text("utf-8").replace("name: python3", f"name: {kernel}"), "utf-8")
    command = [sys.executable, "-m", execute.__name__, page, tmp_path / "out.ipynb"]
    env = os.environ | {"JUPYTER_PATH": str(tmp_path)}
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=120)
    [line] = done.stderr.splitlines()
    assert f"x.py: its kernel does not start ({why}): unset PYTHONPATH" in line


@pytest.mark.parametrize(
    ("text", "filled"),
    [
        ("It is {claim}`error`.", "It is 0.0543 m."),
        ("{claim}`error` and {claim}`steps`", "0.0543 m and 48"),
        ("{claim}`04_ekf.error` elsewhere", "48 elsewhere"),
        ("write ``{claim}`error` ``", "write ``{claim}`error` ``"),
    ],
)
def test_numbers_are_filled_in_where_their_names_stand(text, filled):
    assert stage.Numbers("03_mpc", CLAIMS).fill(text) == filled


@pytest.mark.parametrize("name", ["other", "04_ekf.steps", "05_x.error"])
def test_a_name_that_nobody_claims_ends_the_build(name):
    with pytest.raises(SystemExit, match=f"03_mpc: no cell claims what .* {{claim}}`{name}`"):
        stage.Numbers("03_mpc", CLAIMS).fill(f"{{claim}}`{name}`")


def test_a_single_page_does_without_numbers_of_chapters_that_have_not_run():
    numbers = stage.Numbers("03_mpc", CLAIMS, strict=False)
    assert numbers.fill("{claim}`05_x.error`") == "…"
    with pytest.raises(SystemExit):
        numbers.fill("{claim}`04_ekf.steps`")


def test_the_scoreboard_begins_with_the_papers_numbers_and_goes_on_by_chapter():
    link = '<a href="03_mpc.html#claim-error">error</a>'
    lines = scoreboard.page_of(CLAIMS).splitlines()
    assert [line for line in lines if line.startswith("#")] == [
        "## Beside the paper",
        f"## {scoreboard.title_of('03_mpc')}",
        f"## {scoreboard.title_of('04_ekf')}",
    ]
    assert lines[4:6] == [f"| {link} | 0.1803 m | 0.0543 m |", ""]
    assert f"| {link} | 0.0543 m | below 0.058 m |" in lines


def test_the_printed_scoreboard_lists_chapter_claim_paper_ours_bound_and_cell():
    printed = scoreboard.table(CLAIMS).splitlines()
    assert printed[0].split() == ["chapter", "claim", "paper", "ours", "bound", "cell"]
    assert printed[2] == "03_mpc   steps            48        below 60       4"


def test_pages_that_have_not_changed_are_not_touched_and_old_ones_go(tmp_path):
    stage.put({"a.md": "one", "b.md": "two"}, tmp_path)
    before = (tmp_path / "a.md").stat().st_mtime_ns
    stage.put({"a.md": "one", "c.md": "three"}, tmp_path)
    assert (tmp_path / "a.md").stat().st_mtime_ns == before
    assert {path.name: path.read_text(encoding="utf-8") for path in tmp_path.iterdir()} == {
        "a.md": "one",
        "c.md": "three",
    }


def test_runs_that_agree_have_nothing_to_report():
    again = {key: Claim(**vars(claim)) for key, claim in CLAIMS.items()}
    assert list(scoreboard.unrepeated(CLAIMS, again)) == []


@pytest.mark.parametrize(
    ("second", "report"),
    [
        (
            {**CLAIMS, ("03_mpc", "steps"): Claim("steps", 49, "")},
            "03_mpc.steps: 48 in one run, 49",
        ),
        ({("03_mpc", "error"): CAR, ("04_ekf", "error"): STEPS}, "03_mpc.steps: claimed in one"),
        ({**CLAIMS, ("09_go1", "new"): STEPS}, "09_go1.new: claimed in one run only"),
        (
            {**CLAIMS, ("03_mpc", "error"): Claim("error", 0.05431, "")},
            "03_mpc.error: 0.0543 in one run, 0.05431 in the other",
        ),
    ],
)
def test_numbers_that_do_not_repeat_are_reported(second, report):
    [line] = scoreboard.unrepeated(CLAIMS, second)
    assert line.startswith(report)


def test_a_pull_request_is_told_which_claims_changed():
    timed = Claim("seconds", 1.0, "below 9 s", "s", varies=True)
    before = CLAIMS | {("03_mpc", "seconds"): timed}
    now = {
        ("03_mpc", "error"): CAR,
        ("03_mpc", "steps"): Claim("steps", 49, "below 60"),
        ("03_mpc", "new"): Claim("new", True, "equal to yes"),
        ("03_mpc", "seconds"): Claim("seconds", 2.0, "below 9 s", "s", varies=True),
    }
    assert scoreboard.changes(before, now).splitlines()[0::2][:1] == ["3 claims changed."]
    assert scoreboard.changes(before, now).splitlines()[4:] == [
        "| 03_mpc.new | none | yes | equal to yes |",
        "| 03_mpc.steps | 48 | 49 | below 60 |",
        "| 04_ekf.error | 48 | none | below 60 |",
    ]
    assert scoreboard.changes(now, now) == "No claim changed."


def test_durations_may_vary():
    first, second = ({("a", "t"): Claim("t", t, "", "s", varies=True)} for t in (1.0, 2.0))
    assert list(scoreboard.unrepeated(first, second)) == []


def test_durations_have_to_be_claimed_in_both_runs():
    first = {("a", "t"): Claim("t", 1.0, "", "s", varies=True)}
    assert list(scoreboard.unrepeated(first, {})) == ["a.t: claimed in one run only"]


def test_what_pytest_records_is_what_the_build_gathers(run_book, tmp_path):
    root, _ = run_book({"x.py": CLAIM.format(0.25)})
    execute.execute(root / "book" / "x.py", tmp_path / "x.ipynb")
    assert scoreboard.recorded(root / "build" / "claims") == scoreboard.gather(tmp_path) != {}


@pytest.mark.parametrize(
    ("docstring", "literal"),
    [
        ("Returns x.\n\n    x = f(x) |h + k|   (1)\n    y = g(x)           (2)\n\nMore.", True),
        ("Returns x.\n\n    J = sum_t 1/2 x' Q x\n\nMore.", True),
        ("Returns x.\n\n    a quotation (see page 1)\n\nMore.", False),
        ("Returns x.\n\nArgs:\n    x: the state (1)\n", False),
    ],
)
def test_equations_of_a_docstring_are_shown_as_written(docstring, literal):
    lines = docstring.split("\n")
    docstrings.as_written(None, "function", "f", None, None, lines)
    assert (lines[2:4] == ["::", ""]) is literal
    assert [line for line in lines if line != "::" and line] == [
        line for line in docstring.split("\n") if line
    ]
