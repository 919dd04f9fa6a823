"""Graders are code, too: each accepts right answers of several kinds and refuses common mistakes.

The terminal's summary shows the table of them; conftest.py at the top prints it.
"""

import importlib
from pathlib import Path

import pytest
from graders import CASES

from pypose_lite.teaching.checks import EXERCISES, chapter, find, judge

HERE = Path(__file__).parent
for path in sorted(HERE.glob("answers_*.py")):
    importlib.import_module(path.stem)
for number in range(1, 11):
    chapter(number)
RIGHT = [case for case in CASES if case.says is None]
WRONG = [case for case in CASES if case.says is not None]


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("case", RIGHT, ids=lambda case: case.name)
def test_a_right_answer_is_accepted(case, seed, record_property):
    verdict = judge(find(case.number), case.answer, seed)
    assert verdict.passed, str(verdict)
    if seed == 0:
        record_property("grader", [case.number, "right accepted"])


@pytest.mark.parametrize("case", WRONG, ids=lambda case: case.name)
def test_a_wrong_answer_is_refused_by_words_that_point_at_the_mistake(case, record_property):
    verdict = judge(find(case.number), case.answer)
    assert verdict.state == "refused"
    assert case.says in str(verdict)
    record_property("grader", [case.number, "wrong refused"])


@pytest.mark.parametrize("number", sorted(EXERCISES))
def test_the_table_of_graders_has_no_gap(number):
    assert len({case.name for case in RIGHT if case.number == number}) >= 2
    assert len({case.name for case in WRONG if case.number == number}) >= 4


@pytest.mark.parametrize("number", sorted(EXERCISES))
def test_a_stub_is_neither_right_nor_wrong(number):
    def stub(*args):
        raise NotImplementedError(number)

    if find(number).takes:
        names = find(number).takes
        stub = eval(f"lambda {names}: stub({names})", {"stub": stub})
        assert judge(find(number), stub).state == "open"


@pytest.mark.parametrize("value", [None, "abc", 3.5, [], {}, b"x", object, print], ids=str)
@pytest.mark.parametrize("number", sorted(EXERCISES))
def test_what_is_no_answer_gets_a_verdict_of_a_few_lines(number, value):
    verdict = judge(find(number), value)
    assert verdict.state == "refused"
    assert len(str(verdict).splitlines()) <= 4
    assert "Traceback" not in str(verdict)


@pytest.mark.parametrize("value", [None, "abc", 3.5, [], (1, 2), {}], ids=repr)
@pytest.mark.parametrize("number", sorted(EXERCISES))
def test_a_function_that_returns_something_else_gets_a_verdict_of_a_few_lines(number, value):
    if names := find(number).takes:
        verdict = judge(find(number), eval(f"lambda {names}: value", {"value": value}))
        assert verdict.state == "refused"
        assert len(str(verdict).splitlines()) <= 4
        assert "could not be tried" not in str(verdict)
