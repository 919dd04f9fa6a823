"""The exercises are those of the solutions, they run up to their first stub, and tell nothing."""

import re
from pathlib import Path

import jupytext
import pytest
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

from pypose_lite.teaching.checks import chapter, verdicts_in
from pypose_lite.teaching.site import exercises as tool

ROOT = Path(__file__).parents[2]
SOLUTIONS, EXERCISES = ROOT / "solutions", ROOT / "exercises"
LABS = {path.name: path.read_text("utf-8") for path in sorted(SOLUTIONS.glob("[0-9]*.py"))}
SOLUTION = re.compile(f"{tool.BEGIN}\n(.*?){tool.END}", re.DOTALL)
each_lab = pytest.mark.parametrize("name", LABS)


def test_the_exercises_are_those_of_the_solutions():
    differ = tool.differing(LABS, EXERCISES)
    assert not differ, f"exercises/ differ from solutions/ in {[*differ]}: run `make exercises`"
    assert {path.name for path in EXERCISES.glob("*.py")} == LABS.keys()


@each_lab
def test_a_lab_is_in_its_form(name):
    assert tool.complaints(LABS[name], name) == []


@each_lab
def test_a_lab_says_the_minutes_that_its_checks_say(name):
    text = LABS[name]
    minutes = {
        cell.exercise: tool.MINUTES.search(cell.text)
        for cell in tool.cells_of(text)
        if tool.HEADING.search(cell.text)
    }
    wanted = {exercise.number: exercise.minutes for exercise in chapter(int(name[:2]))}
    assert {number: int(found[1]) for number, found in minutes.items()} == wanted


def lines(text):
    """The lines of a text, without their margins."""
    return {line.strip() for line in text.splitlines()}


@each_lab
def test_an_exercise_holds_no_line_of_its_solution(name):
    exercise = (EXERCISES / name).read_text("utf-8")
    told = lines("\n".join(SOLUTION.findall(LABS[name]))) & lines(exercise)
    assert told <= lines(SOLUTION.sub("", LABS[name])), "these stand in the exercise"
    assert 'tags=["solution"]' not in exercise


@each_lab
def test_an_exercise_runs_up_to_its_first_stub(name):
    notebook = jupytext.read(EXERCISES / name)
    folder = {"metadata": {"path": str(EXERCISES)}}
    with pytest.raises(CellExecutionError) as failed:
        NotebookClient(notebook, timeout=120, resources=folder).execute()
    assert failed.value.ename == "NotImplementedError"
    number = failed.value.evalue.split()[0]
    verdicts = verdicts_in(notebook)
    assert {verdict.state for verdict in verdicts} <= {"open"}
    first = [e.number for e in chapter(int(name[:2]))][: len(verdicts) + 1]
    assert number in first, "a cell failed that is no stub which the reader has come to"
