"""A lab that is not in its form is refused by file, line and exercise, and nothing is written."""

import fnmatch
import subprocess
import sys
from pathlib import Path

import pytest

from pypose_lite.teaching.site import exercises as tool

ROOT = Path(__file__).parents[2]
LAB = (ROOT / "solutions" / "02_lqr.py").read_text("utf-8")
FIRST = "# ## Exercise 2.1: One Riccati step"
SECOND = "# ## Exercise 2.2: A car that flees the line"
BEGIN, END = f"    {tool.BEGIN}\n", f"    {tool.END}\n"
CHECK = 'check("2.1", riccati_step)'
NOTES = '# %% [markdown] tags=["solution"]\n# The cost'

FAULTS = {
    "not closed": (END, "", BEGIN, "2.1: ### BEGIN SOLUTION is not closed by ### END SOLUTION"),
    "not opened": (BEGIN, "", END, "2.1: ### END SOLUTION without ### BEGIN SOLUTION"),
    "nested": (BEGIN, BEGIN + BEGIN, f"{BEGIN}    H", "2.1: ### BEGIN SOLUTION within another"),
    "no exercise": (FIRST, "#", BEGIN, "(none): ### BEGIN SOLUTION before any"),
    "no check": (CHECK, "riccati_step", FIRST, '2.1: has no check: a cell with check("2.1", ...)'),
    "other check": (CHECK, 'check("2.2", 1)', '"2.2", 1', "2.2: check(*) stands in exercise 2.1"),
    "no notes": (NOTES, "# %% [markdown]\n# A", FIRST, "2.1: has no explanation: a text cell with"),
    "no minutes": ("# *10 minutes. Warm-up.*\n", "", FIRST, "2.1: does not say its minutes"),
    "a hint less": ("Hint 3\n", "Hint\n", FIRST, "2.1: lacks 1 of its three hints: * Hint 3"),
    "a number twice": (SECOND, SECOND.replace("2.2", "2.1"), "# ## Exercise 2.1: A", "2.1: 2 have"),
    "unknown number": (SECOND, SECOND.replace("2.2", "2.99"), "# ## Exercise 2.99", "2.99: has no"),
    "other title": (FIRST, f"{FIRST}s", FIRST, "2.1: is called 'One Riccati step' in pypose_lite/"),
    "no solution": (f"{tool.BEGIN}\nanswer_22", "answer_22", SECOND, "2.2: does not mark its solu"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_named_with_its_place(fault):
    old, new, place, says = FAULTS[fault]
    lab = LAB.replace(old, new, 1)
    assert lab != LAB
    line = 1 + lab[: lab.index(place)].count("\n")
    found = tool.complaints(lab, "02_lqr.py")
    assert fnmatch.filter(found, f"02_lqr.py:{line}: exercise {says}*"), found


def test_an_exercise_that_only_the_checks_know_is_named():
    lab = LAB[: LAB.index("# %% [markdown]\n# ## Exercise 2.2")]
    assert tool.complaints(lab, "02_lqr.py")[0] == (
        "02_lqr.py:1: exercise 2.2: is in pypose_lite/teaching/checks/chapter_02.py "
        "and not in this lab"
    )


def command(folder):
    """Runs the command on the solutions in a folder."""
    run = [sys.executable, "-m", tool.__name__, "solutions", "exercises"]
    return subprocess.run(run, cwd=folder, capture_output=True, text=True, timeout=120)


def test_the_command_writes_the_exercises_and_says_which(tmp_path):
    (tmp_path / "solutions").mkdir()
    (tmp_path / "solutions" / "02_lqr.py").write_text(LAB, "utf-8")
    first, again = command(tmp_path), command(tmp_path)
    assert (first.stdout, first.returncode) == ("exercises made anew: 02_lqr.py\n", 0)
    assert (again.stdout, again.returncode) == ("exercises are as they were\n", 0)
    made = (tmp_path / "exercises" / "02_lqr.py").read_text("utf-8")
    assert made == (ROOT / "exercises" / "02_lqr.py").read_text("utf-8")
    assert '    raise NotImplementedError("2.1 One Riccati step")\n' in made


def test_the_command_writes_nothing_for_a_lab_that_is_not_in_its_form(tmp_path):
    (tmp_path / "solutions").mkdir()
    (tmp_path / "solutions" / "02_lqr.py").write_text(LAB.replace(END, ""), "utf-8")
    done = command(tmp_path)
    assert done.returncode == 1
    assert done.stderr.startswith("02_lqr.py:")
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "exercises").exists()
