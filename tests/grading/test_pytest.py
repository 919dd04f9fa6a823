"""pytest: a test an exercise, JUnit for a platform, and no say for the files of a student."""

import os
import subprocess
import sys
from xml.etree import ElementTree

import pytest
from submissions import KEY, RIGHT, WRONG, handed_in, saved

from pypose_lite.teaching.checks import Verdict
from pypose_lite.teaching.grading import homework
from pypose_lite.teaching.grading.forms import prairielearn


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """What JUnit is told of a submission that brings files of its own."""
    kit, theirs = tmp_path_factory.mktemp("kit"), tmp_path_factory.mktemp("submission")
    homework.for_pytest(KEY, kit)
    hostile = "import pytest\n@pytest.hookimpl(tryfirst=True)\ndef pytest_runtest_call(item):\n"
    (theirs / "conftest.py").write_text(hostile + "    item.obj = print\n", encoding="utf-8")
    (theirs / "torch.py").write_text("raise SystemExit", encoding="utf-8")
    wrong = handed_in(RIGHT | WRONG, e32="raise SystemExit('All correct')")
    notebook = saved(wrong, theirs / "03_mpc.ipynb")
    words = "--noconftest -c /dev/null test_03_mpc.py --junitxml=junit.xml -q".split()
    environment = os.environ | {"SUBMISSION": str(notebook)}
    command = [sys.executable, "-P", "-m", "pytest", *words]
    done = subprocess.run(command, cwd=kit, env=environment, capture_output=True, text=True)
    assert done.returncode == 1, done.stdout + done.stderr
    return ElementTree.parse(kit / "junit.xml").getroot()


def test_each_exercise_is_a_test_that_fails_with_its_verdict(report):
    cases = list(report.iter("testcase"))
    assert [case.get("name") for case in cases] == [f"test_exercise[{t.number}]" for t in KEY.tasks]
    failed = [case.find("failure") for case in cases]
    assert [failure is None for failure in failed] == [False, False, True]
    assert "The input that was just used has come back at the end." in failed[0].text


def test_the_points_are_in_the_report(report):
    points = [
        {entry.get("name"): entry.get("value") for entry in case.iter("property")}
        for case in report.iter("testcase")
    ]
    assert [entry["points"] for entry in points] == ["0", "0", "1"]
    assert {entry["max_points"] for entry in points} == {"1"}


def test_prairielearn_gets_a_score_between_0_and_1_and_the_words():
    verdicts = [
        Verdict("3.1", "accepted", "fine", 1, 1),
        Verdict("3.2", "refused", "it must ...", 0, 1),
        Verdict("3.5", "open", "not done yet", 0, 2),
    ]
    result = prairielearn(KEY, verdicts)
    assert result["score"] == 0.25
    assert result["tests"][1] == {
        "name": "3.2 A line search",
        "points": 0,
        "max_points": 1,
        "message": "it must ...",
    }
