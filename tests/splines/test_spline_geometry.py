"""Heading, curvature and arc length against closed forms and SciPy's quadrature."""

import numpy as np
import pytest
import torch
from scipy import integrate
from torch.autograd import gradcheck, gradgradcheck

from pypose_lite.lie import randn_SE3
from pypose_lite.splines import (
    arc_length,
    curvature,
    evenly_spaced,
    heading,
    hermite,
    hermite_segments,
    parameter_at,
    uniform_bspline,
)

F64 = torch.float64


def points(*shape, seed=0):
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=F64)


def close(a, b, atol=1e-12):
    torch.testing.assert_close(a, torch.as_tensor(b, dtype=a.dtype), atol=atol, rtol=1e-12)


def parabola(t):
    """y = x^2 with its two derivatives with respect to x."""
    one = torch.ones_like(t)
    return torch.stack([one, 2 * t], -1), torch.stack([0 * one, 2 * one], -1)


def test_heading_and_curvature_of_a_parabola():
    x = torch.linspace(-2, 2, 9, dtype=F64)
    velocity, acceleration = parabola(x)
    angle = torch.atan2(2 * x, torch.ones_like(x))
    close(heading(velocity), torch.stack([angle.cos(), angle.sin()], -1))
    close(curvature(velocity, acceleration), 2 / (1 + 4 * x**2) ** 1.5)
    close(curvature(-3 * velocity, 9 * acceleration), -2 / (1 + 4 * x**2) ** 1.5)  # backwards


def test_curvature_depends_on_neither_frame_nor_speed():
    velocity, acceleration = parabola(torch.linspace(-2, 2, 9, dtype=F64))
    turn = torch.tensor([[0.6, 0.8], [-0.8, 0.6]], dtype=F64)  # of the rows
    flip = torch.tensor([-1.0, 1.0], dtype=F64)
    k, faster = curvature(velocity, acceleration), acceleration + 3 * velocity
    close(curvature(velocity @ turn, faster @ turn), k)
    close(curvature(velocity * flip, acceleration * flip), -k)


def test_heading_and_curvature_at_rest_are_defined_and_have_finite_gradients():
    v = torch.zeros(2, dtype=F64, requires_grad=True)
    a = torch.ones(2, dtype=F64, requires_grad=True)
    still = torch.tensor([0.0, 1.0], dtype=F64)
    close(heading(v), torch.tensor([1.0, 0.0], dtype=F64))
    close(heading(v, still), still)
    assert curvature(v, a) == 0
    (heading(v, still).sum() + curvature(v, a)).backward()
    assert v.grad.isfinite().all() and a.grad.isfinite().all()


def test_gradients_of_heading_and_curvature_are_right():
    v, a = points(3, 2).requires_grad_(), points(3, 2, seed=1).requires_grad_()
    assert gradcheck(heading, v) and gradcheck(curvature, (v, a))


def smooth(N=9, phase=0.0):
    """Points of a winding curve, unevenly spaced."""
    s = torch.linspace(0, 2, N, dtype=F64) ** 1.5 + phase
    return torch.stack([s + 0.2 * (3 * s).cos(), (2 * s).sin()], -1)


def true_length(spline, a, b):
    """SciPy's quadrature of the speed from a to b."""

    def speed(t):
        return float(spline(torch.tensor([t], dtype=F64), 1)[..., :3].norm())

    knots = [k for k in range(1, spline.segments) if a < k < b]
    return integrate.quad(speed, a, b, points=knots, epsabs=1e-12, epsrel=1e-12)[0]


@pytest.mark.parametrize("spline", [hermite(smooth()), uniform_bspline(smooth(), True)])
def test_arc_length_equals_scipys_quadrature(spline):
    knots = arc_length(spline)
    assert knots[0] == 0 and len(knots) == spline.segments + 1
    each = [true_length(spline, k, k + 1) for k in range(spline.segments)]
    close(knots.diff(), each, atol=1e-8)


def test_arc_length_of_poses_is_how_far_they_travel():
    generator = torch.Generator().manual_seed(0)
    spline = hermite(randn_SE3(2, sigma=(1.0, 0.4), generator=generator, dtype=F64))
    close(arc_length(spline)[-1], true_length(spline, 0, 1), atol=1e-9)


def test_parameter_at_inverts_arc_length():
    spline = hermite(smooth())
    t = torch.tensor([0, 0.1, 0.9, 1, 3.3, 7.99, 8], dtype=F64)
    s = torch.tensor([true_length(spline, 0, x) for x in t.tolist()], dtype=F64)
    close(parameter_at(spline, s), t, atol=1e-8)


@pytest.mark.parametrize("spline", [hermite(smooth()), uniform_bspline(smooth(), True)])
def test_evenly_spaced_points_are_equally_far_apart(spline):
    t = evenly_spaced(spline, 12)
    gaps = [true_length(spline, *pair) for pair in zip(t[:-1].tolist(), t[1:].tolist())]
    close(torch.tensor(gaps, dtype=F64), np.full(11, sum(gaps) / 11), atol=1e-7)
    close(t[[0, -1]], [0, spline.segments], atol=1e-4)  # at rest: t is the cube root of a length


def test_lengths_of_a_batch_equal_those_of_its_members():
    p, s = torch.stack([smooth(), smooth(phase=0.5)]), torch.tensor([0.2, 1.0, 2.5], dtype=F64)
    together = hermite(p)
    close(arc_length(together), torch.stack([arc_length(hermite(x)) for x in p]))
    close(parameter_at(together, s), torch.stack([parameter_at(hermite(x), s) for x in p]))
    own = torch.stack([s, s + 0.3])
    one_by_one = [parameter_at(hermite(x), d) for x, d in zip(p, own, strict=True)]
    close(parameter_at(together, own), torch.stack(one_by_one))
    close(
        parameter_at(hermite(p[0]), own), torch.stack([parameter_at(hermite(p[0]), d) for d in own])
    )


def test_distances_beyond_the_ends_are_the_ends():
    spline = hermite(smooth())
    close(parameter_at(spline, torch.tensor([-1.0, 1e3], dtype=F64)), [0, 8.0])
    still = hermite(torch.ones(3, 2, dtype=F64))  # no length at all
    t = parameter_at(still, torch.tensor([0.0, 1.0], dtype=F64))
    assert ((0 <= t) & (t <= 2)).all()


def test_a_distance_is_found_from_a_guess_where_the_curve_rests():
    """The speed is 12 (u - 1/4)^2, and the first guess for a quarter of the length is 1/4."""
    end, leaving, arriving = (torch.tensor([[x]], dtype=F64) for x in (1.75, 0.75, 6.75))
    spline = hermite_segments(torch.cat([0 * end, end]), leaving, arriving)
    t = parameter_at(spline, torch.tensor([1.75 / 4], dtype=F64))
    close(t, [0.25 + 0.09375 ** (1 / 3)])


@pytest.mark.parametrize("check", [gradcheck, gradgradcheck])
def test_points_at_given_distances_have_the_right_gradients(check):
    p = smooth(4).requires_grad_()
    s = torch.tensor([0.1, 0.8, 1.9], dtype=F64, requires_grad=True)

    def walk(p, s):
        spline = hermite(p)
        return spline(parameter_at(spline, s))

    assert check(walk, (p, s))


def test_lengths_of_curves_that_rest_have_finite_gradients():
    p = torch.tensor([[0.0, 0], [0, 0], [1, 0], [1, 1]], dtype=F64, requires_grad=True)
    spline = uniform_bspline(p, extrapolate=True)
    spline(evenly_spaced(spline, 7)).sum().backward()
    assert p.grad.isfinite().all()
    s = torch.zeros(1, dtype=F64, requires_grad=True)
    parameter_at(spline, s).backward()
    assert s.grad == 0


def test_lengths_work_in_float32():
    spline, exact = hermite(smooth().float()), hermite(smooth())
    close(arc_length(spline).double(), arc_length(exact), atol=1e-5)
    s = torch.linspace(0, 3, 20)
    close(
        spline(parameter_at(spline, s)).double(), exact(parameter_at(exact, s.double())), atol=2e-5
    )


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: evenly_spaced(hermite(points(3, 2)), 1), "count: expected at least 2, got 1"),
        (lambda: heading(points(3, 3)), r"velocity: expected \(\.\.\., n=2\), got \(3, 3\)"),
    ],
)
def test_what_does_not_fit_is_named(call, words):
    with pytest.raises(ValueError, match=words):
        call()
