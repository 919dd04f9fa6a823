"""What the answers of lab 6 must do: curves through points."""

import math

import torch

from . import expect
from .exercise import Exercise

basis = Exercise("6.1", "The Hermite basis", minutes=5, takes="u")


def usual_mistakes(u):
    """What the basis is for known mistakes, by the hints that mend them."""
    p1, m0, m1 = 3 * u**2 - 2 * u**3, u - 2 * u**2 + u**3, u**3 - u**2
    columns = {
        "The order is p0, m0, p1, m1.": (1 - p1, p1, m0, m1),
        "The factor of m1 has the wrong sign: p'(1) = m1, not -m1.": (1 - p1, m0, p1, -m1),
        "The factor of m0 has the wrong sign.": (1 - p1, -m0, p1, m1),
        "p0 and p1 are interchanged: at u = 0 the curve is at p0.": (p1, m0, 1 - p1, m1),
        "m0 and m1 are interchanged.": (1 - p1, m1, p1, m0),
        "This is Bernstein's basis, of the corners of the control polygon.": (
            (1 - u) ** 3,
            3 * u * (1 - u) ** 2,
            3 * u**2 * (1 - u),
            u**3,
        ),
    }
    return {hint: torch.stack(each, -1) for hint, each in columns.items()}


@basis.must("return four factors for each u, a tensor (..., 4)")
def shape_of_basis(answer, given):
    for shape in [(5,), (2, 3)]:
        came = answer(given.uniform(0, 1, *shape))
        hint = "torch.stack([...], dim=-1) makes the four factors the last dimension."
        if getattr(came, "shape", None) == (4, *shape):
            expect.that(False, f"shape {(*shape, 4)}", f"{(4, *shape)}", hint)
        expect.tensor("the basis", came, (*shape, 4))


@basis.must("be right for any cubic: with its ends and its tangents it gives the cubic itself")
def reproduces_cubics(answer, given):
    u = given.uniform(0, 1, 9)
    mistakes = usual_mistakes(u)
    cubics = given.randn(4, 4)  # coefficients of 1, u, u^2, u^3, a row each
    powers = torch.stack([u**k for k in range(4)], -1)
    ends = torch.stack(
        [cubics[:, 0], cubics[:, 1], cubics.sum(1), cubics @ torch.arange(4.0).double()], -1
    )
    came = expect.tensor("the basis", answer(u), (9, 4))
    hints = {hint: table @ ends.mT for hint, table in mistakes.items()}
    hint = "Sort p(u) by p0, m0, p1 and m1: what is multiplied by each of them?"
    expect.close("the curve", came @ ends.mT, powers @ cubics.mT, hint, hints, 1e-5)


times = Exercise("6.2", "A spline through given times", minutes=10, takes="p, t", points=2)


def uneven(given, N=6):
    """Increasing times with unequal gaps."""
    return given.uniform(0.3, 2.5, N).cumsum(0)


@times.must("return a tangent for each point, a tensor (N, d)")
def shape_of_tangents(answer, given):
    for N, d in [(5, 2), (3, 3), (4, 1)]:
        expect.tensor("the tangents", answer(given.randn(N, d), uneven(given, N)), (N, d))


@times.must("give the slope of the only leg at the first and at the last point")
def one_sided_ends(answer, given):
    for N in (2, 5):
        p, t = given.randn(N, 2), uneven(given, N)
        came = expect.tensor("the tangents", answer(p, t), (N, 2))
        slope = p.diff(dim=0) / t.diff()[:, None]
        leg = p.diff(dim=0)
        mistakes = {"Divide the leg by the time that it takes.": torch.stack([leg[0], leg[-1]])}
        want = torch.stack([slope[0], slope[-1]])
        hint = "A slope is the way divided by the time: metres a second."
        expect.close("the tangents at the ends", came[[0, -1]], want, hint, mistakes)


def parabola_slope(p, t, i):
    """The derivative at t[i] of the parabola through three points, from its coefficients."""
    powers = torch.stack([(t[i - 1 : i + 2] - t[i]) ** k for k in range(3)], -1)
    return torch.linalg.solve(powers, p[i - 1 : i + 2])[1]


@times.must("give the slope of the parabola through each inner point and its neighbours")
def of_the_parabola(answer, given):
    p, t = given.randn(6, 2), uneven(given)
    want = torch.stack([parabola_slope(p, t, i) for i in range(1, 5)])
    g, h = t.diff()[:-1, None], t.diff()[1:, None]
    leg = p.diff(dim=0)
    a, b = leg[:-1] / g, leg[1:] / h
    mistakes = {
        "The weights are interchanged: the shorter leg has to count more.": (g * a + h * b)
        / (g + h),
        "This is the mean of both slopes: the shorter leg has to count more.": (a + b) / 2,
        "The times do not matter here: divide by them.": (leg[:-1] + leg[1:]) / 2,
        "The mean slope is not exact for a parabola.": (leg[:-1] + leg[1:])
        / (t[2:] - t[:-2])[:, None],
    }
    hint = "The slope of a leg is that of the parabola in the middle of the leg. Interpolate."
    came = expect.tensor("the tangents", answer(p, t), (6, 2))
    expect.close("the tangents inside", came[1:-1], want, hint, mistakes, 1e-5)


length = Exercise("6.3", "How long is a curve?", minutes=10, takes="velocity, a, b")


def ring(t):
    """The velocity on a circle of radius 2."""
    return torch.stack([-2 * torch.sin(t), 2 * torch.cos(t)], -1)


def parabola(t):
    """The velocity of (t, t^2)."""
    return torch.stack([torch.ones_like(t), 2 * t], -1)


def line(t):
    """The velocity on a straight line, not constant."""
    return torch.stack([3 * torch.cos(t) + 3.5, 4 * torch.cos(t) + 14 / 3], -1)


def measured(answer, velocity, a, b, want, hint):
    """Holds an answer to the length of a curve."""
    t = torch.linspace(a, b, 20001)
    v = velocity((t[1:] + t[:-1]) / 2)
    dt = (b - a) / 20000
    speed = v.norm(dim=-1)
    mistakes = {
        "This is the way from start to end: take the norm before the sum.": (v.sum(0) * dt).norm(),
        "This is the mean speed: multiply by the time, b - a.": speed.mean(),
        "This is the sum of |x'| and |y'|: the speed is the square root of the squares.": (
            v.abs().sum() * dt
        ),
        "The square root is missing: the speed is the norm of the velocity.": (
            speed.square().sum() * dt
        ),
    }
    came = expect.tensor("the length", answer(velocity, a, b), ())
    near = abs(came.item() - want) < 0.05 * want
    hint = "Almost: more parts, or the speed in the middle of each." if near else hint
    expect.close("the length", came, want, hint, mistakes, 2e-4)


@length.must("be right for a circle")
def of_a_circle(answer, given):
    hint = "Add up speed times time, over short parts."
    measured(answer, ring, 0.0, 2 * math.pi, 4 * math.pi, hint)
    measured(answer, ring, 0.5, 2.0, 3.0, hint)


@length.must("be right where the speed is not constant")
def of_others(answer, given):
    hint = "The speed is different at each parameter: evaluate it at many of them."
    want = 5 * (math.sin(2.5) - math.sin(1.0)) + 35 / 6 * 1.5
    measured(answer, line, 1.0, 2.5, want, hint)
    b = 1.7
    half = math.sqrt(1 + 4 * b * b)
    measured(answer, parabola, 0.0, b, b * half / 2 + math.asinh(2 * b) / 4, hint)
