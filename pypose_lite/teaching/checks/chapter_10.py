"""What the answers of lab 10 must do: batches, laps, intervals; two more files go on."""

import math
from typing import Any

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode

from ... import infinity
from . import expect
from .exercise import Exercise, Failure

first_exit = Exercise("10.1", "A loop becomes a batch", minutes=10, takes="x, lane", points=2)
CALLS, CARS, STATES = 1000, 2000, 20


class Counted(TorchFunctionMode):
    """Counts the operations on tensors in its block."""

    def __init__(self) -> None:
        super().__init__()
        self.calls = 0

    def __torch_function__(self, function, types, args=(), kwargs=None):
        self.calls += 1
        return function(*args, **(kwargs or {}))


def some_laps(given, *shape: int) -> Tensor:
    """States around the path that wander off; some laps stay near it."""
    s = torch.linspace(0, 3, STATES).expand(*shape, STATES)
    far = given.uniform(0, 0.35, *shape)[..., None, None]
    return infinity.reference(s) + far * given.randn(*shape, STATES, 4)


def exits_of(x: Tensor, lane: float) -> list[list[int]]:
    """For each lap the states that are outside, found by its distance from both circles."""
    rows = []
    for lap in x.reshape(-1, x.shape[-2], 4).tolist():
        off = [min(abs(math.dist(p[:2], [c, 0]) - 1) for c in (1, -1)) for p in lap]
        rows.append([k for k, distance in enumerate(off) if distance > lane])
    return rows


def with_none(rows: list[list[int]], none: int, pick=min) -> Tensor:
    """One number for each lap: of its states outside, or ``none``."""
    return torch.tensor([float(pick(row)) if row else float(none) for row in rows])


@first_exit.must("return a whole number for each lap, whatever the shape of the batch")
def shape_of_exits(answer, given):
    for shape in [(6,), (), (2, 3), (1,)]:
        x = some_laps(given, *shape)
        expect.tensor(f"the numbers of laps {(*shape, STATES, 4)}", answer(x, 0.3), shape)


@first_exit.must("give what the loop gives")
def same_as_loop(answer, given):
    x = some_laps(given, 40)
    x[3] = infinity.reference(torch.linspace(0, 3, STATES))  # never outside
    rows = exits_of(x, 0.3)
    right = with_none(rows, STATES)
    mistakes = {
        f"A lap that never leaves has {STATES}, the number of its states; argmax says 0.": (
            with_none(rows, 0)
        ),
        f"A lap that never leaves has {STATES}, the number of its states.": with_none(rows, -1),
        f"A lap that never leaves has {STATES}: it is the state after the last one.": (
            with_none(rows, STATES - 1)
        ),
        "This is the last state outside; the first one is wanted.": with_none(rows, STATES, max),
        "States are counted from 0, as in the loop.": right + 1,
        "This counts the states inside; those after the first exit do not matter.": (
            torch.tensor([float(STATES - len(row)) for row in rows])
        ),
        "This counts the states outside.": torch.tensor([float(len(row)) for row in rows]),
    }
    hint = "Each lap has an answer of its own: look along the second last dimension of x."
    expect.close("the numbers", answer(x, 0.3), right, hint, mistakes)


@first_exit.must("do without a loop over the cars")
def no_loop(answer, given):
    x = some_laps(given, CARS)
    with Counted() as counted:
        answer(x, 0.3)
    hint = "All cars at once: compare, then count along the states."
    calls = counted.calls // 2 if answer.repeat else counted.calls
    came = f"{calls} of them"
    expect.that(calls < CALLS, f"few operations for {CARS} cars", came, hint)


laps_needed = Exercise("10.2", "How many laps?", minutes=10, takes="z, share", points=1)


def number_of_laps(answer, z: Tensor, share: float) -> float:
    """A whole number, as an answer gives it."""
    value = expect.tensor("the number of laps", answer(z, share), ()).item()
    expect.that(value == round(value), "a whole number", f"{value:g}", "Round up: math.ceil.")
    return value


@laps_needed.must("return the number of laps that brings the half-width down to the share")
def right_number(answer, given):
    for size, centre, spread, share in [
        (400, 5, 1, 0.01),
        (600, -2, 3, 0.05),
        (500, 0.1, 0.02, 0.02),
    ]:
        z = centre + spread * given.randn(size)
        m, s = z.mean().abs().item(), z.std().item()
        n = (1.96 * s / (share * m)) ** 2
        mistakes = {
            "Squared: the standard error falls with the root of the number.": n**0.5,
            "sigma is the standard deviation: the root of the variance.": n * s**2,
            "The half-width is 1.96 standard errors.": n / 1.96**2,
            "The half-width counts, not the whole width.": n / 4,
            "To each side of the mean is the whole share.": 4 * n,
            "The share is one of the mean: relative to its size.": n * m**2,
        }
        came = number_of_laps(answer, z, share)
        if abs(came - n) <= 0.006 * n + 2:
            continue
        hints = [hint for hint, wrong in mistakes.items() if abs(came - wrong) < 0.01 * wrong + 1.5]
        hint = hints[0] if hints else "Solve 1.96 sigma / sqrt(N) = share |mean| for N."
        raise Failure(f"about {n:.0f} laps", f"{came:.0f}", hint)


@laps_needed.must("need a hundred times the laps for a tenth of the share")
def scaling(answer, given):
    z = 3 + given.randn(300)
    wide, narrow = number_of_laps(answer, z, 0.02), number_of_laps(answer, z, 0.002)
    off = abs(narrow / max(wide, 1) - 100)
    expect.that(
        off < 2, "100 times as many", f"{narrow / max(wide, 1):.3g} times", "N ~ 1/share^2."
    )


interval = Exercise("10.3", "An interval for a share", minutes=15, takes="k, n", points=2)
Z = 1.96


def root(share: float, n: int, low: float, high: float) -> float:
    """Where the share is Z standard deviations away, between two numbers, by halving."""

    def away(p: float) -> bool:
        return (share - p) ** 2 > Z**2 * p * (1 - p) / n

    outside = away(low)
    for _ in range(200):
        middle = (low + high) / 2
        low, high = (middle, high) if away(middle) == outside else (low, middle)
    return (low + high) / 2


def ends_of(k: int, n: int) -> Tensor:
    """Both ends of Wilson's interval, by halving."""
    share = k / n
    low = 0.0 if k == 0 else root(share, n, 0.0, share)
    high = 1.0 if k == n else root(share, n, share, 1.0)
    return torch.tensor([low, high])


def simple(k: float, n: float, z: float = Z) -> Tensor:
    """The interval with the observed share in the place of p."""
    share = torch.as_tensor(k / n)
    spread = z * (share * (1 - share) / n).sqrt()
    return torch.stack([share - spread, share + spread])


def apart(came: Any) -> Any:
    """Two numbers in one tensor as two numbers; everything else as it came."""
    return tuple(came) if isinstance(came, Tensor) and came.shape == (2,) else came


def came_of(answer, k: int, n: int) -> Tensor:
    """The two ends that an answer gives."""
    names = ("the lower end", "the upper end")
    ends = expect.parts(apart(answer(k, n)), *names)
    return torch.stack([expect.tensor(name, end, ()) for name, end in zip(names, ends)])


@interval.must("return two ends where the share is 1.96 standard deviations away")
def right_ends(answer, given):
    for k, n in [(7, 50), (40, 64), (3, 1000)]:
        right, c = ends_of(k, n), Z**2 / n
        one = simple(k, n, 1.0)
        centre = right.mean()
        unscaled = (1 + c) * right
        mistakes = {
            "The lower end comes first.": right.flip(0),
            "That is the simple interval: the share stands in the place of p.": simple(k, n),
            "That is one standard deviation, with the share in the place of p.": one,
            "Divide by twice the factor of p squared, 2 (1 + c).": unscaled,
            "Divide by 2 (1 + c), not by (1 + c).": 2 * right,
            "Both roots are wanted, not their centre.": torch.stack([centre, centre]),
        }
        hint = "Insert your ends into the equation: do both sides agree?"
        expect.close(f"the ends of {k} of {n}", came_of(answer, k, n), right, hint, mistakes, 1e-3)


@interval.must("say something where none, or all, of the laps have failed")
def at_the_ends(answer, given):
    n = given.size(80)
    for k in (0, n):
        came = came_of(answer, k, n)
        width = (came[1] - came[0]).item()
        hint = "After 0 of n the probability may still be about 4 / n."
        expect.that(width > 1 / n, "an interval with a width", f"one of {width:.2g}", hint)
        right = ends_of(k, n)
        expect.close(f"the ends of {k} of {n}", came, right, hint, tolerance=2e-3)
