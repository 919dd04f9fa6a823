"""What pytest does with a chapter, and what every chapter's file has to be."""

import subprocess
from pathlib import Path

import jupytext
import pytest
from small_books import CLAIM, ERROR, FIGURE, PROSE

from pypose_lite.teaching.proofread import shared_headings
from pypose_lite.teaching.site import api, contents, scoreboard
from pypose_lite.teaching.site.pages import notebooks, texts

ROOT = Path(__file__).parents[2]
CHAPTERS = sorted((ROOT / "book").glob("*.py"))
LISTED = set(contents.names())

BOOK = {
    "good.py": FIGURE + CLAIM.format(0.5),
    "claim.py": CLAIM.format(1.5),
    "error.py": ERROR,
    "prose.py": PROSE,
    "figure.py": FIGURE,
}


@pytest.fixture(scope="module")
def report(run_book):
    """What pytest says about a book of one good chapter and four bad ones."""
    return run_book(BOOK)[1]


@pytest.mark.parametrize(
    "line",
    [
        "FAILED book/claim.py::Cell 1",
        "FAILED book/error.py::Cell 0",
        "FAILED book/prose.py::proofreading - book/prose.py:6: prose states '0.21 m'",
        "FAILED book/figure.py::proofreading - book/figure.py:8: section 'Look' shows",
        "claim does not hold: a = 1.5 m; claimed: below 1 m",
        "ZeroDivisionError",
    ],
)
def test_pytest_names_each_fault_of_a_chapter(report, line):
    assert line in report


def test_pytest_finds_no_fault_in_a_good_chapter(report):
    assert "good.py" not in report
    assert "4 failed" in report.splitlines()[-1]


def test_pytest_does_not_wait_for_a_kernel_that_has_died(run_book):
    _, report = run_book({"dies.py": "# %%\nimport os\n\nos._exit(1)\n"})
    assert "its kernel died, most often because memory ran out: close other programs" in report
    assert "Timeout" not in report


def test_the_records_of_a_lesson_and_of_its_lab_lie_side_by_side(run_book):
    root, _ = run_book({"01_one.py": CLAIM.format(0.5)}, {"01_one.py": CLAIM.format(0.25)})
    values = [claim.value for claim in scoreboard.recorded(root / "build" / "claims").values()]
    assert values == [0.5, 0.25]


@pytest.mark.parametrize("path", CHAPTERS, ids=lambda path: path.stem)
def test_a_chapter_is_a_notebook_that_jupyterlab_can_start(path):
    notebook = jupytext.read(path)
    assert notebook.metadata.kernelspec.name == "python3"
    assert notebook.cells[0].cell_type == "markdown"
    assert notebook.cells[0].source.startswith("# ")


def test_lessons_have_headings_of_their_own():
    lessons = {path.stem: jupytext.read(path) for path in CHAPTERS}
    assert shared_headings(lessons) == []


@pytest.mark.parametrize("path", CHAPTERS, ids=lambda path: path.stem)
def test_a_chapter_is_on_the_site(path):
    assert path.stem in LISTED


def test_the_table_of_contents_names_pages_that_exist():
    assert {*notebooks(), *texts(), *api.pages()} >= LISTED


def test_a_lab_follows_its_lesson_and_solutions_have_a_part_of_their_own():
    names = contents.names()
    for page in notebooks():
        if page.startswith("exercises/"):
            assert names.index(page) == names.index(page.removeprefix("exercises/")) + 1
    solutions = [name for name in names if name.startswith("solutions/")]
    first = names.index(solutions[0])
    assert names[first : first + len(solutions)] == solutions
    assert set(solutions) == {page for page in notebooks() if page.startswith("solutions/")}


def test_no_notebook_is_kept_in_git():
    command = ["git", "ls-files", "*.ipynb"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    if done.returncode:
        pytest.skip("not a git checkout")
    assert done.stdout == ""
