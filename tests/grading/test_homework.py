"""`make homework`: all labs are built, and what students get holds no solution and no seed."""

import json
import re
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest
from submissions import ROOT

from pypose_lite.teaching.checks import chapter
from pypose_lite.teaching.grading import homework
from pypose_lite.teaching.site import exercises as tool

LABS = {path.stem: path.read_text("utf-8") for path in sorted(ROOT.glob("solutions/[0-9]*.py"))}
SOLUTION = re.compile(f"{tool.BEGIN}\n(.*?){tool.END}", re.DOTALL)
SEED = 918_273_645
each_lab = pytest.mark.parametrize("lab", LABS)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """All that the command makes of all labs."""
    target = tmp_path_factory.mktemp("homework")
    module = "pypose_lite.teaching.grading.homework"
    command = [sys.executable, "-m", module, "solutions", target]
    done = subprocess.run(
        [*command, f"--seed={SEED}"], cwd=ROOT, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    return target


def what_students_get(built: Path, lab: str) -> list[nbformat.NotebookNode]:
    paths = built / "students" / f"{lab}.ipynb", built / "nbgrader/release" / lab / f"{lab}.ipynb"
    return [nbformat.read(path, as_version=4) for path in paths]


def lines(text):
    """The lines of a text, without margins, and without those of marks alone."""
    return {line.strip() for line in text.splitlines() if re.search(r"\w", line)}


@each_lab
def test_students_get_no_line_of_a_solution(built, lab):
    given = lines(SOLUTION.sub("", LABS[lab]))
    secret = lines("\n".join(SOLUTION.findall(LABS[lab]))) - given
    explained = [cell.text for cell in tool.cells_of(LABS[lab]) if cell.is_solution]
    secret |= {line.removeprefix("# ") for text in explained for line in lines(text)} - given
    assert len(secret) > 20
    for notebook in what_students_get(built, lab):
        told = lines("\n".join(cell.source for cell in notebook.cells)) & secret
        assert told == set()
        assert not any(cell.get("outputs") for cell in notebook.cells)


@each_lab
def test_students_get_no_seed(built, lab):
    for notebook in what_students_get(built, lab):
        assert str(SEED) not in nbformat.writes(notebook)


@each_lab
def test_each_exercise_has_its_answer_its_check_and_its_points(built, lab):
    exercises = chapter(int(lab[:2]))
    for notebook in what_students_get(built, lab):
        marked = [cell for cell in notebook.cells if "nbgrader" in cell.metadata]
        points = {c.metadata.nbgrader.grade_id: c.metadata.nbgrader.get("points") for c in marked}
        assert len(points) == len(marked)
        for exercise in exercises:
            name = exercise.number.replace(".", "-")
            assert points[f"check-{name}"] == exercise.points
            assert f"answer-{name}" in points


@each_lab
def test_each_kit_has_the_lab_with_the_hidden_seed(built, lab):
    copies = [f"keys/{lab}.json", f"pytest/{lab}/key.json", f"nbgrader/keys/{lab}.json"]
    for copy in copies:
        key = json.loads((built / copy).read_text(encoding="utf-8"))
        assert key["seed"] == SEED
        assert [task["number"] for task in key["tasks"]] == [
            exercise.number for exercise in chapter(int(lab[:2]))
        ]
    assert (built / "otter" / f"{lab}.zip").exists()


def test_the_seed_is_drawn_once_and_kept(tmp_path):
    path = tmp_path / "keys" / "seed.txt"
    first = homework.kept_seed(path, None)
    assert first > 0
    assert homework.kept_seed(path, None) == first
    assert homework.kept_seed(path, 12) == 12 == homework.kept_seed(path, None)
    with pytest.raises(ValueError, match="public checks"):
        homework.kept_seed(path, 0)


def test_some_exercises_can_be_chosen_and_unknown_ones_are_named():
    text = homework.chosen(LABS, ["3.2"])["03_mpc"]
    assert tool.HEADING.findall(text) == [("3.2", "A line search")]
    assert "import pypose_lite as pp" in text
    with pytest.raises(ValueError, match="3.99"):
        homework.chosen(LABS, ["3.2", "3.99"])
