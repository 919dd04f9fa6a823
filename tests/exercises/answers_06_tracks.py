"""Answers to lab 6, as students give them: an order, moved waypoints, a smooth track."""

import math

import numpy as np
import torch
from graders import right, wrong

from pypose_lite import infinity, splines

# --- 6.7


def errors(make, counts, low=0.3, high=0.7, of="sine", only_points=False):
    found = []
    for N in counts:
        x = torch.linspace(0, 2 * math.pi, N + 1)
        ring = torch.stack([x.cos(), x.sin()], -1)
        curve = make(torch.stack([x, x.sin()], -1) if of == "sine" else ring)
        t = torch.linspace(low * N, high * N, 12 * N + 1)
        t = torch.arange(N // 3, N // 2).double() if only_points else t
        p = curve(t)
        off = p[:, 1] - p[:, 0].sin() if of == "sine" else p.norm(dim=-1) - 1
        found.append(off.abs().max())
    return torch.stack(found)


def ratio(e):
    return e[0] / e[1]


@right("6.7")
def at_the_same_parameter(make):
    found = []
    for N in (30, 60):
        x = torch.linspace(0, 2 * math.pi, N + 1)
        curve = make(torch.stack([x, x.sin()], -1))
        t = torch.arange(0.35 * N, 0.65 * N, 0.11)
        found.append((curve(t)[:, 1] - (2 * math.pi * t / N).sin()).abs().max().item())
    return math.log2(found[0] / found[1])


@right("6.7")
def by_a_line_through_the_logarithms(make):
    counts = [32, 64, 128]
    slope = np.polyfit(np.log(counts), errors(make, counts).log().numpy(), 1)[0]
    return -slope


@right("6.7")
def on_a_parabola_with_a_wave(make):
    found = []
    for N in (40, 80):
        x = torch.linspace(-1, 2, N + 1)
        curve = make(torch.stack([x, x**2 + (2 * x).cos()], -1))
        p = curve(torch.linspace(0.4 * N, 0.6 * N, 10 * N + 1))
        found.append((p[:, 1] - p[:, 0] ** 2 - (2 * p[:, 0]).cos()).abs().max())
    return torch.log2(found[0] / found[1])


@wrong("6.7", "A circle makes a gift")
def on_a_circle(make):
    return ratio(errors(make, (32, 64), of="circle")).log2()


@wrong("6.7", "Stay away from the ends")
def with_its_ends(make):
    found = []
    for N in (32, 64):
        x = torch.linspace(0.5, 3.5, N + 1)
        p = make(torch.stack([x, x.sin()], -1))(torch.linspace(0, N, 12 * N + 1))
        found.append((p[:, 1] - p[:, 0].sin()).abs().max())
    return ratio(found).log2()


@wrong("6.7", "Its sign is wrong")
def the_other_sign(make):
    return -ratio(errors(make, (32, 64))).log2()


@wrong("6.7", "This is the ratio of the errors")
def without_the_logarithm(make):
    return ratio(errors(make, (32, 64)))


@wrong("6.7", "the one to the base 2")
def with_the_decimal_logarithm(make):
    return ratio(errors(make, (32, 64))).log10()


@wrong("6.7", "Is it log2?")
def with_the_natural_logarithm(make):
    return ratio(errors(make, (32, 64))).log()


@wrong("6.7", "the order")
def at_the_points_only(make):
    return ratio(errors(make, (32, 64), only_points=True)).log2()


@wrong("6.7", "find 4 where it is 4")
def always_three(make):
    return 3.0


# --- 6.8


def bends(p):
    pieces = splines.hermite(p).spread()
    u = torch.linspace(0, 1, 15)
    return splines.curvature(pieces.local(u, 1), pieces.local(u, 2)).abs()


def moved(p, z, reach=0.1):
    return p + reach * z / (1 + z.square().sum(-1, keepdim=True)).sqrt()


@right("6.8")
def by_lbfgs(p):
    z = torch.zeros(p.shape, requires_grad=True)

    def rough():
        total = (bends(moved(p, z)) ** 12).mean() ** (1 / 12)
        (z.grad,) = torch.autograd.grad(total, z)
        return total.detach()

    torch.optim.LBFGS([z], max_iter=60, line_search_fn="strong_wolfe").step(rough)
    return moved(p, z).detach()


def by_descent(p, steps=250, size=0.003, sign=-1.0, reach=0.095):
    """Downhill in the points themselves, which are brought back into their circles."""
    q = p.clone()
    for _ in range(steps):
        q.requires_grad_()
        (slope,) = torch.autograd.grad((bends(q) ** 16).mean() ** (1 / 16), q)
        q = q.detach() + sign * size * slope
        way = q - p
        q = p + way * (reach / way.norm(dim=-1, keepdim=True).clamp(min=reach))
    return q.detach()


@right("6.8")
def by_projected_descent(p):
    return by_descent(p, reach=0.0999)


@wrong("6.8", "It is not smaller than before")
def as_they_were(p):
    return p.clone()


@wrong("6.8", "It is not smaller than before")
def uphill(p):
    return by_descent(p, steps=3, sign=1.0)


@wrong("6.8", "make more steps")
def one_step(p):
    return by_descent(p, steps=1)


@wrong("6.8", "shorter than 0.1")
def too_far(p):
    return by_descent(p, reach=0.3)


@wrong("6.8", "a curvature below 2")
def with_noise_instead(p):
    return moved(p, torch.randn(p.shape))


@wrong("6.8", "of shape (17, 2)")
def with_the_headings(p):
    return infinity.waypoints()


# --- 6.9


def stated(curve, count=126):
    t = splines.evenly_spaced(curve, count)
    return torch.cat([curve(t), splines.heading(curve(t, 1))], -1)


def of_bumps(points, n=16):
    t = torch.linspace(0, n - 3, len(points))
    matrix = splines.uniform_bspline(torch.eye(n))(t)
    return splines.uniform_bspline(torch.linalg.lstsq(matrix, points).solution)


@right("6.9")
def a_natural_spline_of_means(points):
    q = torch.cat([points[:1].expand(3, 2), points, points[-1:].expand(3, 2)])
    means = q.unfold(0, 7, 1).mean(-1)
    return stated(splines.cubic_spline(means[::5]), 110)


@right("6.9")
def fourteen_bumps(points):
    return stated(of_bumps(points, 15), 200)


@right("6.9")
def a_fourier_series(points):
    """Both circles are one period, so a few waves describe them."""
    s = torch.linspace(0, 2 * math.pi, len(points))
    waves = [torch.ones_like(s)]
    for k in range(1, 7):
        waves += [(k * s).cos(), (k * s).sin()]
    matrix = torch.stack(waves, -1)
    p = matrix @ torch.linalg.lstsq(matrix, points).solution
    return stated(splines.cubic_spline(p[::2] if len(p) % 2 else p))


@wrong("6.9", "The curve follows the noise")
def through_all_points(points):
    return stated(splines.hermite(points), 110)


@wrong("6.9", "The curve follows the noise")
def too_many_bumps(points):
    return stated(of_bumps(points, 60))


@wrong("6.9", "cuts the curve")
def too_few_bumps(points):
    return stated(of_bumps(points, 9))


@wrong("6.9", "the heading belongs to it")
def places_alone(points):
    return stated(of_bumps(points))[:, :2]


@wrong("6.9", "headings of length 1")
def velocities(points):
    curve = of_bumps(points)
    t = splines.evenly_spaced(curve, 126)
    return torch.cat([curve(t), curve(t, 1)], -1)


@wrong("6.9", "in this order")
def sine_first(points):
    return stated(of_bumps(points))[:, [0, 1, 3, 2]]


@wrong("6.9", "begin where the recording begins")
def one_half_of_it(points):
    return stated(of_bumps(points))[:60]


@wrong("6.9", "evenly_spaced")
def in_large_steps(points):
    return stated(of_bumps(points), 30)
