"""A submission gets the verdicts of the teacher's check, and nothing that it says changes them."""

import dataclasses
import json
import os
import subprocess
import sys
from importlib import import_module

import nbformat
import pytest
import torch
from submissions import (
    BELIEVE_ME,
    KEY,
    NUMBERS,
    RIGHT,
    SEED,
    WRONG,
    blank,
    cell,
    handed_in,
    saved,
    with_checks,
    with_verdicts_in_its_outputs,
    without_checks,
)

from pypose_lite.teaching.checks import find, judge
from pypose_lite.teaching.checks.given import Given
from pypose_lite.teaching.grading import Key, grade
from pypose_lite.teaching.grading.key import checks_in, key_of

module = import_module("pypose_lite.teaching.grading.grade")
SHORT = dataclasses.replace(
    KEY,
    cell_seconds=8.0,
    tasks=tuple(dataclasses.replace(task, seconds=3.0) for task in KEY.tasks),
)


def graded(submission, key=KEY):
    """The verdicts by number; each is worth its points or nothing."""
    verdicts = grade(submission, key)
    assert [verdict.number for verdict in verdicts] == [*NUMBERS]
    assert all(verdict.points == verdict.out_of * verdict.passed for verdict in verdicts)
    return {verdict.number: verdict for verdict in verdicts}


def states(verdicts):
    return [verdict.state for verdict in verdicts.values()]


def test_right_answers_are_accepted_also_where_the_notebook_has_lost_its_checks(monkeypatch):
    """With cells that a student added, magics, and a look at what there is to see."""
    monkeypatch.setenv("GITHUB_TOKEN", "secret")
    notebook = without_checks(handed_in(e31="def warm_start(u):\n    return moved(u)"))
    spy = "import os\nif os.listdir() or 'GITHUB_TOKEN' in os.environ: raise ValueError\n"
    helper = "%matplotlib inline\ndef moved(u):\n    return torch.cat([u[1:], u[-1:]])"
    place = notebook.cells.index(cell(notebook, "answer", "3.1"))
    notebook.cells.insert(place, nbformat.v4.new_code_cell(spy + helper))
    assert states(graded(notebook)) == ["accepted"] * 3


def test_a_wrong_answer_and_broken_syntax_are_refused_in_words_and_spoil_no_other():
    verdicts = graded(handed_in(RIGHT | WRONG, e32="def line_search(:\n    pass"))
    assert states(verdicts) == ["refused", "refused", "accepted"]
    assert "The input that was just used has come back at the end." in verdicts["3.1"].message
    assert "SyntaxError" in verdicts["3.2"].message


def test_what_was_not_done_is_open():
    assert states(graded(blank())) == ["open"] * 3


def test_a_notebook_without_cells_earns_nothing():
    assert states(graded(nbformat.v4.new_notebook())) == ["open"] * 3


def test_a_file_that_is_no_notebook_earns_nothing(tmp_path):
    path = tmp_path / "03_mpc.ipynb"
    path.write_text("All correct", encoding="utf-8")
    verdicts = graded(path)
    assert states(verdicts) == ["refused"] * 3
    assert "cannot be read" in verdicts["3.1"].message


FORGED = """
import os, json
print("✓ 3.1 A warm start: accepted.")
for fd in range(32):
    for word in ("", "accepted", None):
        line = json.dumps([word, "verdict", ["3.1", "accepted", ""]])
        try: os.write(fd, (line + "\\n").encode())
        except OSError: pass
"""


def test_a_notebook_that_prints_verdicts_and_has_other_checks_is_not_believed():
    notebook = handed_in({}, e31=WRONG["3.1"], e35="answer_35 = 'a'")
    notebook = with_verdicts_in_its_outputs(with_checks(FORGED, notebook))
    assert states(graded(notebook)) == ["refused", "open", "refused"]


def test_a_notebook_that_replaces_the_checks_and_their_tools_is_not_believed():
    verdicts = graded(handed_in(e31=BELIEVE_ME + WRONG["3.1"], e35="answer_35 = 'a'"))
    assert states(verdicts) == ["refused", "accepted", "refused"]
    assert "has come back at the end" in verdicts["3.1"].message


def test_an_end_of_the_program_costs_its_own_exercise_only():
    leaves = "import os\ndef warm_start(u):\n    os._exit(0)"
    verdicts = graded(handed_in(e31=leaves, e32="import sys; sys.exit(0)", e35="os._exit(0)"))
    assert states(verdicts) == ["refused"] * 3
    assert "It ended the program" in verdicts["3.1"].message
    assert "SystemExit" in verdicts["3.2"].message
    assert "It ended the program" in verdicts["3.5"].message


def test_loops_without_an_end_cost_their_own_exercise_only(monkeypatch):
    monkeypatch.setattr(module, "GRACE", 1.0)
    in_c = "import time\ndef warm_start(u):\n    time.sleep(1e6)"
    in_cell = "while True:\n    pass"
    verdicts = graded(handed_in(e31=in_c, e32=in_cell), SHORT)
    assert states(verdicts) == ["refused", "refused", "accepted"]
    assert "it must come to an end" in verdicts["3.1"].message
    assert "It had not come to an end after 8 s." in verdicts["3.2"].message


def test_a_notebook_that_takes_for_ever_as_a_whole_is_ended():
    key = dataclasses.replace(KEY, seconds=0.5)
    assert states(graded(handed_in(e31="import time; time.sleep(1e6)"), key)) == ["refused"] * 3


def test_a_grader_that_cannot_run_says_so_and_blames_no_student(monkeypatch):
    monkeypatch.setattr(module, "WORKER", "pypose_lite.no_such_worker")
    with pytest.raises(RuntimeError, match="No module named pypose_lite.no_such_worker"):
        grade(handed_in(), KEY)


def test_an_answer_that_fits_the_shapes_of_the_lab_only_passes_there_and_not_as_homework():
    def by_heart(u):
        known = u.shape in {(5, 2), (1, 1), (3, 4), (6, 2)}
        return torch.cat([u[1:], u[-1:]]) if known else u

    assert judge(find("3.1"), by_heart).passed
    assert not judge(find("3.1"), by_heart, SEED).passed


def test_sizes_are_the_usual_ones_in_the_lab_and_others_in_homework():
    assert [Given().size(3) for _ in range(5)] == [3] * 5
    assert {Given(seed).size(3) for seed in range(1, 30)} == {3, 4, 5}


def test_a_key_comes_back_from_its_file(tmp_path):
    KEY.write(tmp_path / "keys" / "key.json")
    assert Key.read(tmp_path / "keys" / "key.json") == KEY


def test_the_answers_of_a_lab_are_what_its_checks_take():
    assert {task.number: task.answer for task in KEY.tasks} == {
        "3.1": "warm_start",
        "3.2": "line_search",
        "3.5": "answer_35",
    }
    assert checks_in('check("3.8", (lower, upper))\nprint("check(1, 2)")') == {
        "3.8": "(lower, upper)"
    }
    with pytest.raises(ValueError, match="got none of"):
        key_of("03_mpc", ["pass"], [find("3.1")], 1)


def test_the_command_writes_what_platforms_read(tmp_path, monkeypatch):
    KEY.write(tmp_path / "key.json")
    notebook = saved(handed_in(RIGHT | WRONG), tmp_path / "03_mpc.ipynb")
    (tmp_path / "torch.py").write_text("raise SystemExit", encoding="utf-8")
    for variable in ("CLASSROOM", "ASSIGNMENT", "SUBMISSION_TAG", "COMMIT_URL", "RELEASE_URL"):
        monkeypatch.setenv(variable, variable.lower())
    command = [sys.executable, "-P", "-m", "pypose_lite.teaching.grading", "key.json", notebook]
    options = ["--form", "classroom50", "--to", "results/result.json"]
    done = subprocess.run(
        [*command, *options], cwd=tmp_path, env=os.environ, capture_output=True, text=True
    )
    assert done.stdout.splitlines()[-1] == "2 of 3 points"
    result = json.loads((tmp_path / "results" / "result.json").read_text(encoding="utf-8"))
    assert (result["schema"], result["score"], result["max-score"]) == (
        "classroom50/result/v1",
        2,
        3,
    )
    assert result["tests"][0] == {
        "test-name": "3.1 A warm start",
        "passed": False,
        "score": 0,
        "max-score": 1,
    }
    assert result["commit"] == result["review"] == "commit_url"
