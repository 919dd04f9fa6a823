"""nbgrader: released, handed in, graded and exported, with nothing of a solution on the way out."""

import csv
import os
import shutil
import subprocess
import sys

import nbformat
import pytest
from submissions import (
    BELIEVE_ME,
    KEY,
    NUMBERS,
    RIGHT,
    SOURCES,
    WRONG,
    cell,
    handed_in,
    saved,
    with_checks,
    with_verdicts_in_its_outputs,
    without_checks,
)

from pypose_lite.teaching.grading import homework

LEAVES = "import os\ndef line_search(cost_after, cost_now, alphas):\n    os._exit(0)"
HANDED_IN = {
    "right": (handed_in(), 3),
    "wrong": (handed_in(RIGHT | WRONG, e32="def line_search(:"), 1),
    "empty": (handed_in({}), 0),
    "tampering": (
        with_verdicts_in_its_outputs(
            with_checks("check = print", handed_in(e31=BELIEVE_ME + WRONG["3.1"], e32=LEAVES))
        ),
        1,
    ),
    "cutting": (without_checks(handed_in(e35="import time; time.sleep(1e6)")), 2),
}


def nbgrader(course, *arguments):
    """Runs a command of nbgrader in the course's folder."""
    home = {"HOME": str(course), "JUPYTER_CONFIG_DIR": str(course / "jupyter")}
    command = [sys.executable, "-m", "nbgrader", *arguments]
    done = subprocess.run(
        command, cwd=course, env=os.environ | home, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return done


@pytest.fixture(scope="module")
def course(tmp_path_factory):
    """A course in which everybody has handed in, and everything was graded."""
    course = tmp_path_factory.mktemp("course")
    homework.for_nbgrader(SOURCES, {"03_mpc": KEY}, course)
    key = course / "keys" / "03_mpc.json"
    text = key.read_text("utf-8").replace('"cell_seconds": 60.0', '"cell_seconds": 8.0')
    key.write_text(text, encoding="utf-8")
    for student, (notebook, _) in HANDED_IN.items():
        saved(notebook, course / "submitted" / student / "03_mpc" / "03_mpc.ipynb")
    nbgrader(course, "autograde", "03_mpc")
    nbgrader(course, "export")
    return course


def test_each_student_has_the_points_of_their_right_answers(course):
    with open(course / "grades.csv", encoding="utf-8") as file:
        rows = {row["student_id"]: row for row in csv.DictReader(file)}
    scores = {student: float(rows[student]["raw_score"]) for student in HANDED_IN}
    assert scores == {student: points for student, (_, points) in HANDED_IN.items()}
    assert {float(row["max_score"]) for row in rows.values()} == {3.0}


def test_the_graded_notebook_shows_the_verdict_in_the_restored_check(course):
    path = course / "autograded" / "tampering" / "03_mpc" / "03_mpc.ipynb"
    graded = nbformat.read(path, as_version=4)
    first = cell(graded, "check", "3.1")
    assert first.source == 'check("3.1", warm_start)'
    assert "has come back at the end" in "\n".join(first.outputs[0].traceback)


def test_students_get_feedback(course):
    nbgrader(course, "generate_feedback", "03_mpc", "--student=wrong")
    page = (course / "feedback" / "wrong" / "03_mpc" / "03_mpc.html").read_text("utf-8")
    assert "The input that was just used has come back at the end." in page


def test_the_released_notebook_is_the_one_that_students_get_from_the_other_kits(course):
    released = nbformat.read(course / "release" / "03_mpc" / "03_mpc.ipynb", as_version=4)
    blank = handed_in({})
    assert len(released.cells) == len(blank.cells)
    for ours, theirs in zip(blank.cells, released.cells):
        stub = ours.source.split("raise NotImplementedError(")[0]
        assert theirs.source.startswith(stub)
        assert (ours.source == theirs.source) or theirs.source == f"{stub}raise NotImplementedError"
    assert {cell(released, "check", number).metadata.nbgrader.points for number in NUMBERS} == {1}


def test_a_submission_that_is_no_notebook_leaves_the_others_graded(course, tmp_path):
    copy = tmp_path / "course"
    shutil.copytree(course, copy)
    shutil.rmtree(copy / "submitted")
    (copy / "submitted" / "broken" / "03_mpc").mkdir(parents=True)
    (copy / "submitted" / "broken" / "03_mpc" / "03_mpc.ipynb").write_text("no", encoding="utf-8")
    command = [sys.executable, "-m", "nbgrader", "autograde", "03_mpc"]
    done = subprocess.run(command, cwd=copy, capture_output=True, text=True, timeout=300)
    assert done.returncode != 0
    assert "broken" in done.stderr
