"""Heading and curvature of planar curves against closed forms."""

import pytest
import torch
from torch.autograd import gradcheck

from pypose_lite.splines import curvature, heading

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


@pytest.mark.parametrize("size, dtype", [(1e-15, torch.float32), (1e-120, F64)])
def test_curvature_of_a_curve_that_is_slow_is_that_of_a_fast_one(size, dtype):
    velocity, acceleration = (size * x.to(dtype) for x in parabola(torch.tensor(0.5, dtype=F64)))
    close(size * curvature(velocity, acceleration).double(), 2 / 2**1.5, atol=1e-6)


def test_what_does_not_fit_is_named():
    with pytest.raises(ValueError, match=r"velocity: expected \(\.\.\., n=2\), got \(3, 3\)"):
        heading(points(3, 3))
