"""What the answers of lab 7 must do: comparing loops, taking errors apart."""

import math

import torch

from ... import infinity
from ...systems import DubinsCar
from . import expect
from .chapter_07_logs import FAULTS
from .exercise import Exercise, Failure
from .words import kind

paired = Exercise("7.1", "A paired comparison", minutes=10, takes="a, b")


def pairs(given, count=40, shift=0.3):
    """Errors of two loops that meet the same noise."""
    common = given.randn(count)
    return 4 + common + shift + 0.3 * given.randn(count), 4 + common + 0.3 * given.randn(count)


@paired.must("return the mean of a - b and half the width of its interval")
def mean_and_half(answer, given):
    for count in (40, 9):
        a, b = pairs(given, count)
        mean, half = expect.parts(answer(a, b), "mean", "half width")
        gaps = [x - y for x, y in zip(a.tolist(), b.tolist())]
        wanted = math.fsum(gaps) / count
        mistakes = {"This is b - a: a positive number shall say that b is smaller.": -wanted}
        expect.close("the mean", mean, wanted, "The mean of the differences.", mistakes)
        spread = math.fsum((gap - wanted) ** 2 for gap in gaps)
        error = math.sqrt(spread / (count - 1))
        apart = 1.96 * ((a.var() + b.var()) / count).sqrt()
        mistakes = {
            "This is the interval of two loops with different noise: take a - b first.": apart,
            "This is the spread of single laps; a mean of n of them has 1 / sqrt(n) of it.": 1.96
            * error,
            "This is one standard error; the interval of 95 % has 1.96 of them.": error
            / math.sqrt(count),
            "The sample's standard deviation divides by n - 1.": 1.96 * math.sqrt(spread) / count,
            "This is the whole width: return half of it.": 3.92 * error / math.sqrt(count),
            "Divide by the square root of n, not by n.": 1.96 * error / count,
        }
        hint = "1.96 standard deviations of a - b, divided by the square root of their number."
        expect.close("the half width", half, 1.96 * error / math.sqrt(count), hint, mistakes)


@paired.must("contain the true difference in about 95 % of all samples")
def covers(answer, given):
    inside = 0
    for _ in range(300):
        mean, half = answer(*pairs(given))
        inside += abs(float(mean) - 0.3) <= float(half)
    hint = "Is the width right for every sample?"
    expect.that(270 <= inside <= 297, "about 285 of 300 samples", f"{inside}", hint)


needed = Exercise("7.2", "How many laps are enough?", minutes=5, takes="differences, half_width")


@needed.must("return the smallest number of laps whose interval is narrow enough")
def enough(answer, given):
    for factor in (0.137, 0.052, 2.3, 0.61):
        differences = 0.4 + given.uniform(0.1, 2, 1) * given.randn(30)
        one = 1.96 * differences.std().item()
        wanted = next(n for n in range(1, 10**6) if one / math.sqrt(n) <= factor * one)
        came = expect.tensor("the number", answer(differences, factor * one), ()).item()
        hint = "1.96 s / sqrt(n) <= half_width, solved for n, and rounded up."
        if wanted > 1 and came == wanted - 1:
            hint = "Rounded down, the interval is a little too wide: round up."
        elif abs(came - 30 * wanted) < 30:
            hint = "s is the spread of a single difference: the 30 laps that you have do not count."
        elif came == math.ceil(1 / factor) and came != wanted:
            hint = "The width falls with the square root of n."
        elif came == math.ceil((one / 1.96 / (factor * one)) ** 2):
            hint = "The interval of 95 % has 1.96 standard errors to each side."
        elif came != round(came):
            hint = "A number of laps is a whole number."
        elif factor > 1:
            hint = "One lap is the least."
        expect.that(came == wanted, f"{wanted} laps", f"{came:g}", hint)


split = Exercise("7.3", "Take an error apart", minutes=15, takes="x, X, u", points=2)


def lap_pieces(given, steps=60):
    """States near the right circle, estimates near them, and inputs, of another lap each time."""
    s = torch.linspace(0.3, 5.5, steps + 1)
    x = infinity.reference(s) + 0.05 * given.randn(steps + 1, 4)
    X = x + 0.04 * given.randn(steps + 1, 4) + torch.tensor([0.01, 0.0, 0.0, 0.0])
    return x, X, given.uniform(0.5, 1.5, steps, 2)


def outside(place):
    """How far outside the right circle a place is, (...), from its two coordinates alone."""
    return ((place[..., 0] - 1) ** 2 + place[..., 1] ** 2) ** 0.5 - 1


def squares(t, b, c):
    """The four numbers of the split, from the three distances."""
    control, jump, estimation = (z.square().mean() for z in (c, b - c, t - b))
    return torch.stack([control, jump, estimation, t.square().mean() - control - jump - estimation])


def taken_apart(answer, x, X, u):
    """The four numbers of an answer."""
    names = "control", "jump", "estimation", "cross terms"
    came = expect.parts(answer(x, X, u), *names)
    return torch.stack([expect.tensor(name, z, ()) for name, z in zip(names, came)])


@split.must("return four parts that add up to the mean square of the true distance")
def adds_up(answer, given):
    x, X, u = lap_pieces(given)
    came = taken_apart(answer, x, X, u)
    total = outside(x[1:]).square().mean()
    mistakes = {
        "The cross terms count twice in the square of a sum.": total
        - squares(outside(x[1:]), outside(X[1:]), outside(led(X, u)))[3] / 2,
        "These are the parts of the states x[0] to x[N-1]: u[i] leads to state i + 1.": outside(
            x[:-1]
        )
        .square()
        .mean(),
    }
    hint = "The mean square of t = c + j + e, of the states x[1] to x[N]."
    if came[3] == 0:
        hint = "The cross terms are not zero here: 2 (cj + ce + je), on average."
    expect.close("the sum of the four", came.sum(), total, hint, mistakes)


def led(X, u):
    """Where the inputs lead the estimates, step by step."""
    return torch.stack([DubinsCar(0.1).transition(a, b) for a, b in zip(X, u)])


@split.must("measure control from the circle to where u[i] leads X[i]")
def control_part(answer, given):
    x, X, u = lap_pieces(given)
    want = squares(outside(x[1:]), outside(X[1:]), outside(led(X[:-1], u)))
    from_truth = outside(led(x[:-1], u))
    mistakes = {
        "This starts from the true state: the MPC knew X[i].": from_truth.square().mean(),
        "This is the believed distance, c + j: take f(X[i], u[i]).": outside(X[1:]).square().mean(),
        "This is the square of a mean; take the mean of squares.": outside(led(X[:-1], u)).mean()
        ** 2,
        "This is X[i] itself, before the step.": outside(X[:-1]).square().mean(),
    }
    came = taken_apart(answer, x, X, u)
    expect.close("control", came[0], want[0], "c is the distance of f(X[i], u[i]).", mistakes)


@split.must("measure the jump from there to X[i+1], and estimation from there to x[i+1]")
def other_parts(answer, given):
    x, X, u = lap_pieces(given)
    t, b, c = outside(x[1:]), outside(X[1:]), outside(led(X[:-1], u))
    want = squares(t, b, c)
    came = taken_apart(answer, x, X, u)
    unsigned = (b.abs() - c.abs()).square().mean()
    mistakes = {
        "Distances have signs: outside is positive, inside is negative.": unsigned,
        "Jump and estimation have changed places.": want[2],
    }
    hint = "j is b - c, with b the distance of X[i+1]."
    expect.close("jump", came[1], want[1], hint, mistakes)
    mistakes = {"Distances have signs.": (t.abs() - b.abs()).square().mean()}
    hint = "e is t - b, with t the distance of x[i+1]."
    expect.close("estimation", came[2], want[2], hint, mistakes)


BLOCKS = ("plan", "MPC", "filter", "sensor")
HINTS = {
    "a": "Its targets lie on the circles and its estimates are right; the car does not get there.",
    "b": "Its innovations are as large as they should be, but X - x has a mean that is not 0.",
    "c": "Its filter is right. How far from the circles are the targets themselves?",
    "d": "X - x is 0 on average, but NEES and NIS are far too large: it believes itself too much.",
}

which_block = Exercise("7.4", "Which block is at fault?", minutes=20, points=3)


@which_block.must("name a block for each of the four logs")
def all_named(answer, given):
    wanted = 'a dictionary like {"a": "plan", "b": "filter", ...}'
    if not isinstance(answer, dict) or set(answer) != set(FAULTS):
        raise Failure(wanted, kind(answer), "One entry for each of the letters a, b, c, d.")
    for letter, block in answer.items():
        if not isinstance(block, str) or block.lower() not in {b.lower() for b in BLOCKS}:
            raise Failure(f"one of {', '.join(BLOCKS)} for log {letter}", repr(block))


@which_block.must("name the block that is at fault in each log")
def rightly_named(answer, given):
    for letter, block in FAULTS.items():
        if answer[letter].lower() != block.lower():
            raise Failure(f"another block for log {letter}", repr(answer[letter]), HINTS[letter])
