"""Arithmetic on single numbers: what it computes, its slopes, and what it does without."""

import math

import pytest
import torch
from oracles import close
from replay import replay
from torch.autograd.functional import hessian, jacobian

from pypose_lite.compiled.scalars import FOLDED, PARTIALS, Arithmetic, power

pytestmark = pytest.mark.usefixtures("float64")


def of_two(op):
    """An operation of x and y, and these; its third argument is a product of both."""
    to = Arithmetic()
    leaves = [to.leaf("x", i) for i in range(2)]
    args = [leaves[0], leaves[1], to.do("mul", *leaves)]
    count = {"where": 3, "pow": 2, "atan2": 2, "remainder": 2, "maximum": 2, "minimum": 2}
    count |= dict.fromkeys(("add", "sub", "mul", "div"), 2)
    return to, to.do(op, *args[: count.get(op, 1)]), leaves


@pytest.mark.parametrize("op", PARTIALS)
def test_slopes_are_those_of_torch(op):
    to, result, leaves = of_two(op)
    ((a, b),) = to.slopes([result], leaves)
    again = [row for row in to.slopes([a, b], leaves)]
    assert to.gradient(result, leaves) == [a, b]
    for point in ([0.3, 0.7], [0.6, 0.2], [0.9, 0.9 - 1e-9]):
        x = torch.tensor(point)

        def f(x):
            return replay(to, [result], x=x)[0]

        close(replay(to, [a, b], x=x), jacobian(f, x), 1e-9)
        close(replay(to, sum(again, []), x=x).reshape(2, 2), hessian(f, x), 1e-7)


@pytest.mark.parametrize("op", ["maximum", "minimum"])
def test_a_tie_counts_half_on_each_side(op):
    to, result, leaves = of_two(op)
    (slopes,) = to.slopes([result], leaves)
    close(replay(to, slopes, x=torch.tensor([0.5, 0.5])), torch.tensor([0.5, 0.5]))


KNOWN = {  # of x, which is unknown
    "0 x": (("mul", 0.0, "x"), 0.0),
    "x 0": (("mul", "x", 0.0), 0.0),
    "1 x": (("mul", 1.0, "x"), "x"),
    "x 1": (("mul", "x", 1.0), "x"),
    "0 + x": (("add", 0.0, "x"), "x"),
    "x + 0": (("add", "x", 0.0), "x"),
    "x - 0": (("sub", "x", 0.0), "x"),
    "x / 1": (("div", "x", 1.0), "x"),
    "0 / x": (("div", 0.0, "x"), 0.0),
    "one": (("where", 1.0, "x", 2.0), "x"),
    "other": (("where", 0.0, 2.0, "x"), "x"),
    "both": (("where", "x", 3.0, 3.0), 3.0),
    **{op: ((op, 3.0, 5.0), FOLDED[op](3.0, 5.0)) for op in ("add", "sub", "mul")},
}


@pytest.mark.parametrize("name", KNOWN)
def test_what_is_known_is_not_computed(name):
    to = Arithmetic()
    place = {"x": to.leaf("x", 0)}
    (op, *args), result = KNOWN[name]
    at = to.do(op, *(place.get(a, None) if a == "x" else to.constant(a) for a in args))
    assert at == (place["x"] if result == "x" else to.constant(result))


def test_signs_of_zero_and_of_numbers_stay():
    to = Arithmetic()
    x = to.leaf("x", 0)
    assert to.constant(-0.0) != to.constant(0.0)
    assert to.do("sub", to.constant(0), x) == to.do("mul", to.constant(-1), x) == to.do("neg", x)
    assert to.do("div", x, to.constant(-1)) == to.do("neg", x)
    assert to.do("neg", to.do("neg", x)) == x
    assert math.copysign(1, to.value(to.do("neg", to.constant(0.0)))) == -1


@pytest.mark.parametrize("exponent", [0.0, 1.0, 2.0, 5.0, -1.0, -3.0, 0.5, 1.5, 20.0])
def test_powers(exponent):
    to = Arithmetic()
    x = to.leaf("x", 0)
    at = power(to, x, exponent)
    close(replay(to, [at], x=torch.tensor([1.3])), torch.tensor([1.3**exponent]), 1e-12)
    close(
        replay(to, to.slopes([at], [x])[0], x=torch.tensor([1.3])),
        torch.tensor([exponent * 1.3 ** (exponent - 1)]),
        1e-10,
    )


def test_the_same_work_with_other_numbers_is_the_same_arithmetic():
    def made(number, junk):
        to = Arithmetic()
        for i in range(junk):
            to.do("sin", to.leaf("u", i))
        x = to.leaf("x", 0)
        parameter = to.leaf("number", 7)
        one = to.do("mul", to.do("add", x, to.constant(number)), parameter)
        return to.canonical([to.do("cos", one), to.do("add", one, to.constant(1))])

    (a, places, numbers), (b, others, other_numbers) = made(0.3, 0), made(0.4, 3)
    assert a.entries == b.entries and places == others
    assert numbers == [7 if z == 7 else 0.3 for z in other_numbers] and 0.4 in other_numbers
    assert made(1.0, 0)[2] == [7], "1 stays in the code"
