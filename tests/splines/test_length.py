"""Lengths along curves against SciPy's quadrature, also where a curve nearly or wholly stops."""

import numpy as np
import pytest
import torch
from scipy import integrate, optimize
from torch.autograd import gradcheck, gradgradcheck

from pypose_lite.lie import is_SE3, randn_SE3, randn_SO3
from pypose_lite.splines import (
    arc_length,
    cubic_spline,
    evenly_spaced,
    hermite,
    hermite_segments,
    length,
    parameter_at,
    uniform_bspline,
)

F64 = torch.float64


def close(a, b, atol=1e-12, rtol=1e-12):
    torch.testing.assert_close(a, torch.as_tensor(b, dtype=a.dtype), atol=atol, rtol=rtol)


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
@pytest.mark.parametrize("times", [None, [0.0, 0.3, 0.7, 2.0]])
def test_points_at_given_distances_have_the_right_gradients(check, times):
    p = smooth(4).requires_grad_()
    s = torch.tensor([0.1, 0.8, 1.9], dtype=F64, requires_grad=True)

    def walk(p, s):
        spline = hermite(p, times=times)
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


# cusps


def at(xy):
    return torch.tensor(xy, dtype=F64)


CUSPS = {
    "near": hermite(at([[0, 0], [3, 0], [-2, 0.01], [1, 0]])),
    "nearer": hermite(at([[0, 0], [3, 0], [-2, 1e-5], [1, 0]])),
    "there and back": hermite(at([[0, 0], [3, 0], [-2, 0], [1, 0]])),
    "two in one": hermite_segments(at([[0, 0], [0.1, 0]]), at([[2, 0.01]]), at([[2.1, 0]])),
    "steered": uniform_bspline(at([[0, 0], [1, 1], [0, 1e-3], [1, 1], [-3, 2]]), True),
    "natural": cubic_spline(at([[0, 0], [3, 0], [-2, 1e-4], [1, 0]]), times=[0, 1, 1.5, 4]),
    "poses": hermite(randn_SE3(6, sigma=(1.0, 2.0), dtype=F64).requires_grad_()),
}


def slowest(speed):
    """Where a speed has its minima between 0 and 1, for SciPy to split the integral there."""
    grid = np.linspace(0, 1, 401)
    value = [speed(u) for u in grid]
    low = [i for i in range(1, 400) if value[i] < min(value[i - 1], value[i + 1])]
    bounds = [(grid[i - 1], grid[i + 1]) for i in low]
    find = optimize.minimize_scalar
    exact = {"method": "bounded", "options": {"xatol": 1e-14}}
    return [find(lambda u: speed(u) ** 2, bounds=b, **exact).x for b in bounds]


def segment_length(spline, k):
    """SciPy's quadrature of a segment, split where it is slowest."""
    piece = spline.take(torch.tensor([k]))

    def speed(u):
        velocity = piece.local(at([u]), 1)[0]
        return float((velocity[:3] if is_SE3(spline.start) else velocity).detach().norm())

    ends = [0, *slowest(speed), 1]
    parts = [
        integrate.quad(speed, a, b, epsabs=1e-13, epsrel=1e-12, limit=300)[0]
        for a, b in zip(ends, ends[1:])
    ]
    return sum(parts)


@pytest.mark.parametrize("spline", CUSPS.values(), ids=CUSPS)
def test_lengths_of_curves_with_cusps_equal_scipys_quadrature(spline):
    each = [segment_length(spline, k) for k in range(spline.segments)]
    close(arc_length(spline).diff(dim=-1).detach(), each, atol=1e-12, rtol=1e-9)


@pytest.mark.parametrize("name", ["near", "there and back", "two in one", "natural"])
def test_points_beyond_a_cusp_are_found(name):
    spline = CUSPS[name]
    t = evenly_spaced(spline, 30)
    assert (t.diff() > 0).all()
    far = arc_length(spline)[-1] * torch.linspace(0, 1, 30, dtype=F64)
    knots = spline.times if spline.times is not None else torch.arange(spline.segments + 1)
    segment, u = spline.locate(t)
    gone = arc_length(spline)[segment] + torch.stack(
        [begun(spline, int(k), x) for k, x in zip(segment, u)]
    )
    close(gone, far, atol=1e-8)
    close(t[[0, -1]], [float(knots[0]), float(knots[-1])])


def begun(spline, k, u):
    """The length of the first part of a segment, by a fine polygon."""
    fine = spline.take(torch.full((100_001,), k)).local(u * torch.linspace(0, 1, 100_001).to(u))
    return fine.diff(dim=0).norm(dim=-1).sum()


def test_lengths_of_curves_with_cusps_have_the_right_gradients():
    points = at([[0, 0], [3, 0], [-2, 0.01], [1, 0]])

    def total(p):
        return arc_length(hermite(p))[-1]

    gradient, h = torch.func.grad(total)(points), 1e-6
    for i in range(8):
        step = h * torch.eye(8, dtype=F64)[i].reshape(4, 2)
        close(gradient.flatten()[i], (total(points + step) - total(points - step)) / (2 * h), 1e-6)


def test_a_cusp_in_a_batch_changes_nothing_for_the_others():
    p = torch.stack([at([[0, 0], [3, 0], [-2, y], [1, 0]]) for y in (0.01, 2.0, 0.0)])
    singles = torch.stack([arc_length(hermite(x)) for x in p])
    close(arc_length(hermite(p)), singles, atol=0, rtol=1e-14)
    s = torch.linspace(0, 11, 9, dtype=F64)
    one_by_one = torch.stack([parameter_at(hermite(x), s) for x in p])
    close(parameter_at(hermite(p), s), one_by_one)


def test_a_curve_without_cusps_is_measured_in_one_piece():
    angle = torch.linspace(0, 6, 13, dtype=F64)
    round = hermite(torch.stack([angle.cos(), angle.sin()], -1))
    assert length._mesh(round).shape == (12, 2)
    assert length._mesh(CUSPS["near"]).shape[-1] > 8


def test_the_two_rules_are_exact_for_polynomials():
    x, k = length.NODES, torch.arange(32, dtype=F64)
    powers = x[:, None] ** k
    close(length.KRONROD @ powers, 1 / (k + 1), atol=1e-15, rtol=0)
    close((length.GAUSS @ powers)[:20], 1 / (k[:20] + 1), atol=1e-15, rtol=0)


def test_the_length_of_rotations_is_the_angle_turned():
    q = randn_SO3(2, sigma=0.5, dtype=F64)
    steady = (q[0].Inv() @ q[1]).Log().tensor().norm()
    close(arc_length(hermite(q))[-1], steady)


def test_lengths_do_not_depend_on_the_times():
    p, times = smooth(5), at([0, 0.1, 0.7, 2, 2.1])
    tangents = torch.randn(5, 2, generator=torch.Generator().manual_seed(0), dtype=F64)
    timed = hermite(p, tangents, times)
    h = times.diff()[:, None]
    plain = hermite_segments(p, h * tangents[:-1], h * tangents[1:])
    close(arc_length(timed), arc_length(plain))
    s = torch.linspace(0, 2, 9, dtype=F64)
    close(timed(parameter_at(timed, s)), plain(parameter_at(plain, s)))


def test_evenly_spaced_parameters_never_pass_the_last_time():
    """Not by one digit: parameters beyond are refused."""
    generator = torch.Generator().manual_seed(0)
    times = torch.randn(50, 5, generator=generator, dtype=F64).sort(-1).values
    curve = hermite(smooth(5), times=times)
    t = evenly_spaced(curve, 4)
    close(curve(t)[:, [0, -1]], smooth(5)[[0, -1]].expand(50, 2, 2))
    ends = curve.parameter(torch.arange(4).expand(50, 4), torch.ones(50, 4, dtype=F64))
    assert torch.equal(ends, times[:, 1:])


def test_no_fewer_than_two_points_are_evenly_spaced():
    with pytest.raises(ValueError, match="count: expected at least 2, got 1"):
        evenly_spaced(hermite(smooth()), 1)
