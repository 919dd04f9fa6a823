"""A check accepts every right answer, and says of a wrong one what it lacks, in a few lines."""

import sys

import pytest
import torch

from pypose_lite.teaching import checks
from pypose_lite.teaching.checks import Exercise, Failure, expect, judge


def right(x):
    return x + x


def said(exercise, answer):
    """The lines of the verdict on a wrong answer."""
    verdict = judge(exercise, answer)
    assert (verdict.state, verdict.passed, verdict.points) == ("refused", False, 0)
    first, *lines = str(verdict).splitlines()
    assert first.startswith("✗ 98.1 Twice as long: it must ")
    assert 1 <= len(lines) <= 3
    return "\n".join([first.removeprefix("✗ 98.1 Twice as long: "), *map(str.strip, lines)])


# --- what it accepts


@pytest.mark.parametrize(
    "answer",
    [
        right,
        lambda x: 2 * x,
        lambda x: (x.float() + 100 - 100) * 2,
        lambda x: x.numpy() * 2,
        lambda x: [2 * float(each) for each in x],
        lambda x: tuple(2 * each for each in x),
        lambda x: torch.stack([each + each for each in x]),
        lambda x: (x * torch.ones(3, requires_grad=True)) * 2,
        lambda x, scale=2: scale * x,
    ],
)
def test_every_right_answer_is_accepted_in_one_line(double, answer):
    verdict = judge(double, answer)
    assert str(verdict) == "✓ 98.1 Twice as long: accepted."
    assert (verdict.passed, verdict.points, verdict.out_of) == (True, 3, 3)


def test_a_stub_is_not_done_yet(double):
    def stub(x):
        raise NotImplementedError("98.1 Twice as long")

    verdict = judge(double, stub)
    assert str(verdict) == "… 98.1 Twice as long: not done yet."
    assert (verdict.state, verdict.passed, verdict.points) == ("open", False, 0)


def test_a_NotImplementedError_from_within_a_library_is_no_stub(double):
    def unwritten(x):
        from pypose_lite import System

        return System().state_transition(x, x)

    assert "Your code raised NotImplementedError: System has to define" in said(double, unwritten)


# --- what it refuses


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (None, "be a function of x.\nExpected a function of x; got None."),
        ("2 x", "Expected a function of x; got the string '2 x'."),
        (torch.ones(3), "Expected a function of x; got a tensor of shape (3,)."),
        (lambda: 1, "Expected a function of x; got one of no arguments."),
        (lambda x, y: x, "Expected a function of x; got one of x, y."),
        (lambda x: None, "Expected y of shape (3,); got None.\nHint: A function without `return`"),
        (lambda x: "abc", "got the string 'abc'."),
        (lambda x: "a" * 10**6, "got the string 'aaaaaaaaaaaaaaaaaaaa'...."),
        (lambda x: {"y": x}, "got a dict of 1."),
        (lambda x: right, "got a function, right."),
        (lambda x: x[:2], "Expected y of shape (3,); got one of shape (2,)."),
        (lambda x: x + 1j, "Expected y of shape (3,); got a tensor of shape (3,)."),
        (lambda x: x / 0, "got nan or inf."),
        (lambda x: -2 * x, "Hint: Add it to itself."),
        (lambda x: x**2, "Hint: You have squared it."),
        (lambda x: torch.zeros(10**6), "got one of shape (1000000,)."),
    ],
)
def test_a_wrong_answer_is_told_what_was_expected_and_what_came(double, answer, says):
    assert says in said(double, answer)


def test_a_wrong_number_is_shown_beside_the_right_one(double):
    text = said(double, lambda x: 3 * x)
    x = checks.given.Given(0).randn(3)
    shown = [", ".join(f"{each:.4g}" for each in k * x) for k in (2, 3)]
    assert f"Expected y = [{shown[0]}]; got [{shown[1]}]." in text


def test_of_many_numbers_only_the_worst_is_shown():
    wrong = torch.zeros(20, 30)
    wrong[3, 4], wrong[5, 6] = 1.0, 2.0
    with pytest.raises(Failure) as failure:
        expect.close("K", wrong, torch.zeros(20, 30))
    assert (failure.value.expected, failure.value.came) == ("K[5, 6] = 0", "2")


def test_an_answer_that_writes_into_its_argument_is_told_so(double):
    def in_place(x):
        x += x
        return x

    text = said(double, in_place)
    assert text.startswith("it must leave its arguments as they are.\nExpected x as it was")


def test_an_answer_that_changes_from_call_to_call_is_told_so(double):
    text = said(double, lambda x: 2 * x + torch.randn(3))
    assert text.startswith("it must give the same result for the same arguments.")


def test_an_answer_that_may_change_from_call_to_call_is_called_once():
    calls = []
    checks.student.Answer(calls.append, random=True)(1)
    assert calls == [1]


def test_an_exception_is_shown_as_the_students_with_its_line(double):
    def wrong_shapes(x):
        y = 2 * x
        return y @ torch.eye(4)

    line = wrong_shapes.__code__.co_firstlineno + 2
    text = said(double, wrong_shapes)
    assert "Your code raised RuntimeError: " in text
    assert f"Line {line}, in wrong_shapes: return y @ torch.eye(4)" in text


def test_an_exception_within_the_library_names_the_students_line(double):
    def misused(x):
        from pypose_lite import dlqr

        return dlqr(x, x, x, x)

    assert "in misused: return dlqr(x, x, x, x)" in said(double, misused)


def deep(x):
    return deep(x)


def leave(x):
    sys.exit(1)


def interrupt(x):
    raise KeyboardInterrupt


def chatter(x):
    raise ValueError("word " * 10_000)


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (deep, "raised RecursionError: maximum recursion depth exceeded"),
        (leave, "raised SystemExit: 1"),
        (interrupt, "raised KeyboardInterrupt\n"),
        (chatter, "raised ValueError: word word"),
    ],
)
def test_an_answer_may_raise_what_it_likes(double, answer, says):
    text = said(double, answer)
    assert says in text
    assert len(text) < 500


# --- numbers and progress


@pytest.mark.parametrize(
    ("number", "says"),
    [
        ("98.2", "chapter 98 has no exercise 98.2; it has 98.1"),
        ("97.1", "chapter 97 has no exercise 97.1; it has none"),
        (98.1, "expected an exercise's number such as '2.1', got 98.1"),
        ("two", "expected an exercise's number such as '2.1', got 'two'"),
    ],
)
def test_a_number_that_no_exercise_has_is_refused(double, number, says):
    with pytest.raises(ValueError, match=says):
        checks.check(number, right)


def test_other_seeds_give_other_numbers(double):
    seen = []
    for seed in (0, 0, 1):
        judge(double, lambda x: seen.append(x) or 2 * x, seed)
    first, again, other = seen[0], seen[2], seen[4]
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


def test_progress_shows_what_is_done(double, capsys):
    Exercise("98.2", "Half as long", minutes=7)
    checks.progress()
    checks.check("98.1", right)
    checks.progress()
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "Nothing was checked yet."
    assert lines[2] == "Chapter 98: 1 of 2 exercises accepted."
    assert lines[3].split() == ["✓", "98.1", "Twice", "as", "long", "5", "minutes"]
    assert lines[4].split() == ["98.2", "Half", "as", "long", "7", "minutes"]


def test_an_answer_that_is_broken_again_is_no_longer_done(double, capsys):
    checks.check("98.1", right)
    checks.check("98.1", None)
    checks.progress(98)
    assert "Chapter 98: 0 of 1 exercises accepted." in capsys.readouterr().out
