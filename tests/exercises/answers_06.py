"""Answers to lab 6, as students give them: curves through points."""

import math

import numpy as np
import torch
from graders import right, wrong

from pypose_lite import splines

# --- 6.1


def basis(u, order=(0, 1, 2, 3), signs=(1, 1, 1, 1)):
    p1, m0, m1 = u * u * (3 - 2 * u), u * (1 - u) ** 2, -u * u * (1 - u)
    columns = [1 - p1, m0, p1, m1]
    return torch.stack([signs[k] * columns[k] for k in order], -1)


@right("6.1")
def in_factors(u):
    return basis(u)


@right("6.1")
def by_a_matrix_of_coefficients(u):
    M = torch.tensor([[1.0, 0, -3, 2], [0, 1, -2, 1], [0, 0, 3, -2], [0, 0, -1, 1]])
    return torch.stack([u**k for k in range(4)], -1) @ M.mT


@right("6.1")
def in_numpys_float32(u):
    u = u.numpy().astype(np.float32)
    p1 = u * u * (3 - 2 * u)
    return np.stack([1 - p1, u * (1 - u) ** 2, p1, -u * u * (1 - u)], -1)


@right("6.1")
def by_the_library(u):
    eye = torch.eye(4)
    return splines.hermite(eye[[0, 2]], eye[[1, 3]])(u.flatten()).reshape(*u.shape, 4)


@wrong("6.1", "The order is p0, m0, p1, m1")
def points_first(u):
    return basis(u, (0, 2, 1, 3))


@wrong("6.1", "The factor of m1 has the wrong sign")
def outward_tangent(u):
    return basis(u, signs=(1, 1, 1, -1))


@wrong("6.1", "p0 and p1 are interchanged")
def backward_in_u(u):
    return basis(u, (2, 1, 0, 3))


@wrong("6.1", "This is Bernstein's basis")
def bernstein(u):
    return torch.stack([math.comb(3, k) * u**k * (1 - u) ** (3 - k) for k in range(4)], -1)


@wrong("6.1", "makes the four factors the last dimension")
def stacked_in_front(u):
    return basis(u).movedim(-1, 0)


@wrong("6.1", "m0 and m1 are interchanged")
def tangents_interchanged(u):
    return basis(u, (0, 3, 2, 1))


@wrong("6.1", "Sort p(u) by p0, m0, p1 and m1")
def by_powers(u):
    return torch.stack([u**k for k in range(4)], -1)


# --- 6.2


def with_rule(rule):
    def tangents(p, t):
        time = t.diff()[:, None]
        slope = p.diff(dim=0) / time
        inner = rule(slope[:-1], slope[1:], time[:-1], time[1:])
        return torch.cat([slope[:1], inner, slope[-1:]])

    return tangents


@right("6.2")
def point_by_point(p, t):
    slopes = [(p[i + 1] - p[i]) / (t[i + 1] - t[i]) for i in range(len(p) - 1)]
    found = [slopes[0]]
    for i in range(1, len(p) - 1):
        share = (t[i] - t[i - 1]) / (t[i + 1] - t[i - 1])
        found.append((1 - share) * slopes[i - 1] + share * slopes[i])
    return torch.stack([*found, slopes[-1]])


@right("6.2")
def by_fitted_parabolas(p, t):
    p, t = p.numpy(), t.numpy()
    found = [(p[1] - p[0]) / (t[1] - t[0])]
    for i in range(1, len(p) - 1):
        found.append(np.polyfit(t[i - 1 : i + 2] - t[i], p[i - 1 : i + 2], 2)[1])
    return np.stack([*found, (p[-1] - p[-2]) / (t[-1] - t[-2])])


@right("6.2")
def by_the_librarys_curve(p, t):
    return splines.hermite(p, times=t)(t, derivative=1)


wrong("6.2", "The weights are interchanged", "weights interchanged")(
    with_rule(lambda a, b, g, h: (g * a + h * b) / (g + h))
)
wrong("6.2", "the mean of both slopes", "mean of slopes")(with_rule(lambda a, b, g, h: (a + b) / 2))
wrong("6.2", "Interpolate", "sum of slopes")(with_rule(lambda a, b, g, h: a + b))
wrong("6.2", "Interpolate", "slope of the leg before")(with_rule(lambda a, b, g, h: a))


@wrong("6.2", "Divide the leg by the time")
def as_if_a_second_apart(p, t):
    return splines.hermite(p)(torch.arange(len(p) - 0.0), derivative=1)


@wrong("6.2", "The times do not matter here")
def times_at_the_ends_only(p, t):
    found = splines.hermite(p)(torch.arange(len(p) - 0.0), derivative=1).clone()
    found[[0, -1]] = (p[[1, -1]] - p[[0, -2]]) / (t[[1, -1]] - t[[0, -2]])[:, None]
    return found


@wrong("6.2", "of shape (5, 2)")
def without_the_ends(p, t):
    return (p[2:] - p[:-2]) / (t[2:] - t[:-2])[:, None]


# --- 6.3


@right("6.3")
def by_the_trapezoidal_rule(velocity, a, b):
    t = torch.linspace(a, b, 2001)
    return torch.trapezoid(velocity(t).norm(dim=-1), t)


@right("6.3")
def by_gauss(velocity, a, b):
    nodes, weights = map(torch.from_numpy, np.polynomial.legendre.leggauss(40))
    t = (a + b) / 2 + (b - a) / 2 * nodes
    return (weights * velocity(t).norm(dim=-1)).sum() * (b - a) / 2


@right("6.3")
def one_by_one(velocity, a, b):
    n, total = 500, 0.0
    for k in range(n):
        t = torch.tensor([a + (k + 0.5) / n * (b - a)])
        x, y = velocity(t)[0].tolist()
        total += math.hypot(x, y) * (b - a) / n
    return total


@wrong("6.3", "take the norm before the sum")
def from_start_to_end(velocity, a, b):
    t = torch.linspace(a, b, 20001)
    return torch.trapezoid(velocity(t), t, dim=0).norm()


@wrong("6.3", "multiply by the time")
def mean_speed(velocity, a, b):
    return velocity(torch.linspace(a, b, 20001)).norm(dim=-1).mean()


@wrong("6.3", "The square root is missing")
def squared(velocity, a, b):
    t = torch.linspace(a, b, 20001)
    return torch.trapezoid(velocity(t).square().sum(-1), t)


@wrong("6.3", "the sum of |x'| and |y'|")
def around_the_block(velocity, a, b):
    t = torch.linspace(a, b, 20001)
    return torch.trapezoid(velocity(t).abs().sum(-1), t)


@wrong("6.3", "Almost: more parts")
def in_ten_parts(velocity, a, b):
    t = torch.linspace(a, b, 21)
    return torch.trapezoid(velocity(t).norm(dim=-1), t)


@wrong("6.3", "The speed is different at each parameter")
def at_one_place(velocity, a, b):
    return velocity(torch.tensor([a + 0.0])).norm() * (b - a)
