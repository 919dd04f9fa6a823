"""Splines against SciPy, autograd and PyPose: continuity, invariances, batches, gradients."""

import math

import numpy as np
import pytest
import torch
from scipy import interpolate
from torch.autograd import gradcheck
from torch.autograd.functional import jacobian

from pypose_lite.lie import SE3, is_SE3, randn_SE3, se3
from pypose_lite.splines import bspline, chspline, hermite, hermite_segments, uniform_bspline

F64 = torch.float64
SHAPES = [(), (1,), (3,), (7,), (2, 3)]
both = pytest.mark.parametrize("build", [hermite, uniform_bspline])
each_order = pytest.mark.parametrize("derivative", [0, 1, 2])


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


def points(*shape, seed=0, dtype=F64):
    return torch.randn(*shape, generator=generator(seed), dtype=F64).to(dtype)


def poses(*shape, seed=0, sigma=(1.0, 0.7)):
    return randn_SE3(*shape, sigma=sigma, generator=generator(seed), dtype=F64)


def close(a, b, atol=1e-12, rtol=1e-12):
    b = b if isinstance(b, torch.Tensor) else torch.as_tensor(b, dtype=a.dtype)
    a, b = (x.tensor() if is_SE3(x) else x for x in (a, b))
    torch.testing.assert_close(a, b, atol=atol, rtol=rtol)


def segments_at(spline, u, derivative):
    """Every segment at the local parameter u."""
    return spline.local(spline.start.new_full((spline.segments,), u), derivative)


# where the samples are


ROUNDS_UP = [1, 2, 3, 10, 49, 98, 103, 107, 196, 197, 1999, 2000]  # 1 / (1 / 49) > 49, ...


@pytest.mark.parametrize(
    "call, gaps, kind, ks",
    [
        (chspline, 2, float, range(1, 2001)),
        (chspline, 2, np.float32, ROUNDS_UP),
        (bspline, 0, float, ROUNDS_UP),
        (lambda p, i: bspline(p, i, extrapolate=True), 4, float, ROUNDS_UP),
    ],
)
def test_an_interval_of_1_over_k_gives_k_samples_a_gap(call, gaps, kind, ks):
    p = points(3 if gaps else 4, 1)
    counts = {k: call(p, kind(1) / kind(k)).shape[0] for k in ks}
    assert counts == {k: (gaps or 1) * k + 1 for k in ks}


def test_an_interval_that_does_not_divide_1_restarts_at_every_point():
    line = torch.tensor([[0.0], [1], [2], [3]], dtype=F64)
    wanted = torch.tensor([0, 0.3, 0.6, 0.9, 1, 1.3, 1.6, 1.9, 2, 2.3, 2.6, 2.9, 3], dtype=F64)
    close(chspline(line, 0.3)[:, 0], wanted)


@both
@pytest.mark.parametrize("interval", [1.0, 0.25, 0.1, 0.3])
def test_sampling_and_evaluating_agree(build, interval):
    spline = build(points(2, 7, 3))
    local = np.arange(0, 1 - 1e-9, interval)
    t = np.append((np.arange(spline.segments)[:, None] + local).ravel(), spline.segments)
    close(spline.sample(interval), spline(torch.from_numpy(t)))


# chspline in R^d


@each_order
@pytest.mark.parametrize("N", [2, 3, 20])
@pytest.mark.parametrize("interval", [1.0, 0.1, 1 / 49, 0.3])
def test_chspline_equals_scipys_hermite_with_central_differences(N, interval, derivative):
    p = points(N, 3).numpy()
    tangents = np.gradient(p, axis=0)  # one-sided at the ends
    reference = interpolate.CubicHermiteSpline(np.arange(N), p, tangents)
    t = np.arange(N - 1)[:, None] + np.arange(0, 1 - 1e-9, interval)
    wanted = reference(np.append(t.ravel(), N - 1), derivative)
    if derivative == 2:  # it jumps at the knots; at the last, ours is that of the last segment
        wanted[-1] = reference(np.array([N - 1 - 1e-13]), 2)
    close(chspline(torch.from_numpy(p), interval, derivative), wanted, atol=1e-11)


def test_chspline_equals_pypose():
    pypose = pytest.importorskip("pypose")
    p, k = points(2, 3, 9, 4), [0.1, 0.2, 0.3, 0.4, 1 / 7]
    worst = [(chspline(p, i) - pypose.chspline(p, i)).abs().max() for i in k]
    close(torch.stack(worst), torch.zeros(len(k), dtype=F64), atol=1e-13)


def test_chspline_passes_its_knots():
    p = points(2, 8, 3)
    close(chspline(p, 0.1)[:, ::10], p)
    X = poses(2, 8)
    close(chspline(X, 0.1)[:, ::10].matrix(), X.matrix())


@pytest.mark.parametrize("data", [points(2, 8, 3), poses(2, 8)], ids=["points", "poses"])
def test_chspline_has_a_continuous_first_derivative(data):
    spline = hermite(data)
    ends, starts = segments_at(spline, 1.0, 1), segments_at(spline, 0.0, 1)
    close(ends[..., :-1, :], starts[..., 1:, :], atol=1e-12)
    jump = segments_at(spline, 1.0, 2)[..., :-1, :] - segments_at(spline, 0.0, 2)[..., 1:, :]
    assert jump.abs().max() > 0.1  # and no more than that


def test_chspline_keeps_its_digits_in_float32_over_20000_points():
    s = torch.arange(20_000, dtype=F64)
    p = torch.stack([(0.3 * s).sin(), (0.2 * s).cos()], -1)
    error = chspline(p.float(), 0.1).double() - chspline(p.float().double(), 0.1)
    assert error.abs().max() < 1e-6


@pytest.mark.parametrize("data", [[[0, 0], [1, 2]], np.array([[0, 0], [1, 2]])])
def test_two_integer_points_are_a_straight_line(data):
    close(chspline(data, 0.5), torch.tensor([[0, 0], [0.5, 1], [1, 2]]), atol=1e-7)


def test_given_tangents_are_the_derivative_at_the_knots():
    p, m = points(6, 2), points(6, 2, seed=1)
    close(hermite(p, m).sample(1.0, derivative=1), m)
    X, xi = poses(6), points(6, 6, seed=1)
    close(hermite(X, xi).sample(1.0, derivative=1), xi)


# bspline in R^d


@each_order
@pytest.mark.parametrize("extrapolate", [False, True])
def test_bspline_equals_scipys_uniform_basis(extrapolate, derivative):
    p = points(7, 3)
    control = torch.cat([p[:1], p[:1], p, p[-1:], p[-1:]]) if extrapolate else p
    n = len(control)
    reference = interpolate.BSpline(np.arange(n + 4) - 3, control.numpy(), 3)
    wanted = reference.derivative(derivative) if derivative else reference
    ours = bspline(p, 0.1, extrapolate, derivative)
    close(ours, wanted(np.arange(10 * (n - 3) + 1) / 10), atol=1e-11)


@pytest.mark.parametrize("data", [points(2, 7, 3), poses(2, 7)], ids=["points", "poses"])
@each_order
def test_bspline_has_two_continuous_derivatives(data, derivative):
    spline = uniform_bspline(data, extrapolate=True)
    ends, starts = segments_at(spline, 1.0, derivative), segments_at(spline, 0.0, derivative)
    close(ends[..., :-1, :], starts[..., 1:, :], atol=1e-12)


@pytest.mark.parametrize("N", [2, 3, 6])
@pytest.mark.parametrize("make", [lambda N: points(2, N, 3), lambda N: poses(2, N)])
def test_an_extrapolated_bspline_begins_and_ends_at_the_ends_at_rest(make, N):
    data = make(N)
    curve, speed = bspline(data, 0.2, True), bspline(data, 0.2, True, derivative=1)
    assert curve.shape[-2] == 5 * (N + 1) + 1
    close(curve[..., [0, -1], :], data[..., [0, -1], :])
    close(speed[..., [0, -1], :], torch.zeros_like(speed[..., :2, :]))


@pytest.mark.parametrize("call, first", [(chspline, 0.0), (bspline, 1.0)])
def test_straight_lines_and_constant_twists_are_reproduced(call, first):
    t = torch.arange(6, dtype=F64)[:, None]
    a, b = points(1, 3), points(1, 3, seed=1)
    curve = call(a + b * t, 0.1)
    s = first + torch.arange(len(curve), dtype=F64)[:, None] / 10
    close(curve, a + b * s)
    xi, start = 0.4 * points(1, 6, seed=2), poses(1)
    close(call(start @ se3(xi * t).Exp(), 0.1).matrix(), (start @ se3(xi * s).Exp()).matrix())
    twist = call(start @ se3(xi * t).Exp(), 0.1, derivative=1)
    close(twist, xi.expand_as(twist))


# poses


@pytest.mark.parametrize("call", [chspline, bspline])
def test_poses_come_out_as_poses_with_unit_quaternions(call):
    X = SE3(poses(3, 9).tensor() * torch.tensor([1, 1, 1, *4 * [1.0005]], dtype=F64))
    curve = call(X, 0.1)
    assert is_SE3(curve)
    close(curve.rotation().norm(dim=-1), torch.ones(curve.lshape, dtype=F64))


@pytest.mark.parametrize("call", [chspline, bspline])
def test_the_curve_moves_with_the_frame(call):
    X, G = poses(2, 7), poses(seed=5)
    close(call(G @ X, 0.2).matrix(), (G @ call(X, 0.2)).matrix())


@pytest.mark.parametrize("call", [chspline, bspline])
@each_order
def test_poses_that_only_translate_follow_the_spline_of_their_translations(call, derivative):
    p = points(7, 3)
    X = SE3(torch.cat([p, torch.tensor([0, 0, 0, 1.0], dtype=F64).expand(7, 4)], -1))
    close(call(X, 0.1, derivative=derivative)[:, :3], call(p, 0.1, derivative=derivative))


@both
def test_twists_are_the_derivatives_of_the_poses(build):
    spline = build(poses(6))
    t = torch.tensor([0.3], dtype=F64)
    T, v, a = (spline(t, order)[0] for order in range(3))
    rate = jacobian(lambda s: spline(s)[0].matrix(), t)[..., 0]
    hat = torch.linalg.inv(T.matrix()) @ rate  # T' = T hat(v)
    close(torch.stack([hat[2, 1], hat[0, 2], hat[1, 0]]), v[3:])
    close(hat[:3, 3], v[:3])
    close(jacobian(lambda s: spline(s, 1)[0], t)[..., 0], a)


def test_the_poses_bspline_equals_pypose():
    pypose = pytest.importorskip("pypose")
    X = poses(2, 6)
    close(bspline(X, 0.1), pypose.bspline(pypose.SE3(X.tensor()), 0.1).tensor())
    close(bspline(X, 0.1, True), pypose.bspline(pypose.SE3(X.tensor()), 0.1, True).tensor())


# batches, gradients, arguments


@pytest.mark.parametrize("call", [chspline, bspline])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
@each_order
def test_a_batch_equals_the_stack_of_single_curves(call, shape, derivative):
    for data in (points(*shape, 5, 2), poses(*shape, 5)):
        rows = data.reshape(-1, 5, data.shape[-1])
        singles = torch.stack([call(row, 0.5, derivative=derivative) for row in rows])
        batched = call(data, 0.5, derivative=derivative)
        assert batched.shape[:-2] == shape
        close(batched.reshape(singles.shape), singles)


@both
def test_each_member_of_a_batch_may_have_its_own_parameters(build):
    spline, t = build(points(3, 6, 2)), 3 * torch.rand(3, 4, generator=generator(), dtype=F64)
    singles = [build(p)(row) for p, row in zip(points(3, 6, 2), t, strict=True)]
    close(spline(t), torch.stack(singles))
    close(build(points(6, 2))(t), torch.stack([build(points(6, 2))(row) for row in t]))


@pytest.mark.parametrize("call", [chspline, bspline])
@each_order
def test_gradients_agree_with_finite_differences(call, derivative):
    p = points(2, 4, 2).requires_grad_()
    assert gradcheck(lambda x: call(x, 0.5, derivative=derivative), p)
    xi = (0.6 * points(4, 6)).requires_grad_()

    def of_poses(x):
        out = call(se3(x).Exp(), 0.5, derivative=derivative)
        return out.matrix() if derivative == 0 else out

    assert gradcheck(of_poses, xi, fast_mode=True)


def test_gradients_with_respect_to_parameters_and_tangents_are_right():
    p, m = points(4, 2).requires_grad_(), points(4, 2, seed=1).requires_grad_()
    t = torch.tensor([0.2, 1.7, 2.9], dtype=F64, requires_grad=True)
    assert gradcheck(lambda p, m, t: hermite(p, m)(t, 1), (p, m, t))


@pytest.mark.parametrize("call", [chspline, bspline])
def test_gradients_at_repeated_poses_and_points_are_finite(call):
    xi = torch.zeros(4, 6, requires_grad=True)
    call(se3(xi).Exp(), 0.25).matrix().sum().backward()
    assert xi.grad.isfinite().all()


@pytest.mark.parametrize("call", [chspline, bspline])
def test_the_input_stays_as_it_was(call):
    for data in (points(5, 2), poses(5)):
        before = data.clone()
        first, second = call(data, 0.2), call(data, 0.2)
        close(data, before, atol=0, rtol=0)
        close(first, second, atol=0, rtol=0)


@pytest.mark.parametrize("dtype", [torch.float32, F64])
def test_the_dtype_is_that_of_the_points(dtype):
    assert chspline(points(4, 2, dtype=dtype), 0.3).dtype == dtype
    assert bspline(poses(4).to(dtype), 0.3, derivative=2).dtype == dtype


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: chspline(points(1, 2)), r"points: expected \(\.\.\., N >= 2, d\), got \(1, 2\)"),
        (lambda: bspline(points(3, 2)), r"data: expected \(\.\.\., N >= 4, d\), got \(3, 2\)"),
        (lambda: bspline(poses(1), extrapolate=True), "data: expected .* N >= 2"),
        (lambda: chspline(points(3)), r"points: expected \(\.\.\., N, d\), got \(3,\)"),
        (lambda: chspline(points(3, 2), 0), r"interval: expected a number in \(0, 1\], got 0"),
        (lambda: chspline(points(3, 2), -0.1), r"interval: .* got -0.1"),
        (lambda: bspline(points(4, 2), 1.01), r"interval: .* got 1.01"),
        (lambda: bspline(points(4, 2), math.nan), r"interval: .* got nan"),
        (lambda: chspline(points(3, 2) / 0), "points: expected finite numbers, got"),
        (lambda: chspline(points(3, 2), derivative=3), "derivative: expected 0, 1 or 2, got 3"),
        (lambda: hermite(points(3, 2), points(2, 2)), r"tangents: expected \(\.\.\., N=3, w=2\)"),
        (lambda: hermite(poses(3), points(3, 7)), r"tangents: expected \(\.\.\., N=3, w=6\)"),
        (lambda: hermite_segments(*[points(1, 2)] * 3), "points: expected .* N >= 2"),
        (
            lambda: hermite_segments(points(3, 2), points(2, 2), points(3, 2)),
            r"arriving: expected \(\.\.\., S=2, w=2\), got \(3, 2\)",
        ),
        (
            lambda: hermite(points(3, 2))(torch.tensor([0.0, 2.5], dtype=F64)),
            r"t: expected parameters in \[0, 2\], got 0 to 2.5",
        ),
    ],
)
def test_what_does_not_fit_is_named(call, words):
    with pytest.raises(ValueError, match=words):
        call()
