"""Knots at given times, and natural, clamped and periodic ends, against SciPy."""

import numpy as np
import pytest
import torch
from scipy import interpolate
from torch.autograd import gradcheck

from pypose_lite.lie import SE3, randn_SE3, randn_SO3, se3
from pypose_lite.splines import arc_length, chspline, cubic_spline, hermite, hermite_segments

F64 = torch.float64
TIMES = [None, [0.5, 0.6, 1.9, 2.0, 4.0, 4.5]]
each_times = pytest.mark.parametrize("times", TIMES, ids=["even", "uneven"])
each_order = pytest.mark.parametrize("derivative", [0, 1, 2])


def points(*shape, seed=0):
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=F64)


def closed(*shape, seed=0):
    p = points(*shape, seed=seed)
    return torch.cat([p, p[..., :1, :]], -2)


def close(a, b, atol=1e-12):
    b = b if isinstance(b, torch.Tensor) else torch.as_tensor(b, dtype=a.dtype)
    torch.testing.assert_close(a, b, atol=atol, rtol=1e-12)


def parameters(times, count=40):
    knots = np.array(times if times is not None else range(6), dtype=float)
    return knots, np.linspace(knots[0], knots[-1] - 1e-9, count)


ENDS = {
    "natural": ("natural", points(6, 3), "natural"),
    "at rest": ("clamped", points(6, 3), "clamped"),
    "periodic": ("periodic", closed(5, 3), "periodic"),
    "given": (
        (points(3, seed=1), points(3, seed=2)),
        points(6, 3),
        ((1, points(3, seed=1).numpy()), (1, points(3, seed=2).numpy())),
    ),
}


@each_times
@each_order
@pytest.mark.parametrize("ends, p, theirs", ENDS.values(), ids=ENDS)
def test_cubic_spline_equals_scipys(ends, p, theirs, times, derivative):
    knots, t = parameters(times)
    reference = interpolate.CubicSpline(knots, p.numpy(), bc_type=theirs)
    ours = cubic_spline(p, times, ends)(torch.from_numpy(t), derivative)
    close(ours, reference(t, derivative), atol=1e-12 * 10.0**derivative * 10)


@pytest.mark.parametrize("ends", ["natural", "clamped"])
@pytest.mark.parametrize("N", [2, 3])
def test_two_and_three_points_are_enough(N, ends):
    p, t = points(N, 2), np.linspace(0, N - 1, 9)
    reference = interpolate.CubicSpline(np.arange(N), p.numpy(), bc_type=ends)
    close(cubic_spline(p, None, ends)(torch.from_numpy(t)), reference(t))


@each_times
@each_order
def test_hermite_at_given_times_equals_scipys_with_the_tangents_of_parabolas(times, derivative):
    p, (knots, t) = points(6, 3), parameters(times)
    tangents = np.gradient(p.numpy(), knots, axis=0)  # of the parabola; one-sided at the ends
    reference = interpolate.CubicHermiteSpline(knots, p.numpy(), tangents)
    ours = hermite(p, times=times)
    close(ours(torch.from_numpy(t), derivative), reference(t, derivative), atol=1e-10)
    given = hermite(p, torch.from_numpy(tangents), times)
    close(given(torch.from_numpy(t), derivative), reference(t, derivative), atol=1e-10)


@each_order
def test_samples_lie_at_equal_shares_of_every_segment(derivative):
    spline = hermite(points(6, 2), times=TIMES[1])
    knots = torch.tensor(TIMES[1], dtype=F64)
    t = torch.cat([torch.lerp(a, b, torch.arange(4).to(F64) / 4) for a, b in zip(knots, knots[1:])])
    close(spline.sample(0.25, derivative)[:-1], spline(t, derivative), atol=1e-10)
    end = knots[-1:] - (1e-13 if derivative else 0)
    close(spline.sample(0.25, derivative)[-1:], spline(end, derivative), atol=1e-9)


@each_times
@pytest.mark.parametrize("make", [hermite, cubic_spline])
@pytest.mark.parametrize("order", [0, 1])
def test_a_closed_curve_has_no_jump_at_its_seam(make, times, order):
    curve = make(closed(5, 3), times=times, ends="periodic")
    ends = curve.sample(1.0, order)[[0, -1]]
    close(ends[0], ends[1], atol=1e-11)
    if order == 1:
        open_curve = make(closed(5, 3), times=times)
        assert open_curve.sample(1.0, 1)[[0, -1]].diff(dim=0).abs().max() > 0.1


def test_a_closed_chspline_is_that_of_the_points_gone_round_thrice():
    p = closed(5, 2)
    thrice = chspline(torch.cat([p[:-1], p[:-1], p]), 0.25)
    close(chspline(p, 0.25, ends="periodic"), thrice[20:41])


def test_closed_poses_and_rotations_have_no_jump_at_the_seam():
    for X in (randn_SE3(5, sigma=0.5, dtype=F64), randn_SO3(5, sigma=0.5, dtype=F64)):
        twists = chspline(torch.cat([X, X[:1]]), 0.5, derivative=1, ends="periodic")
        close(twists[0], twists[-1])
        flipped = torch.cat([X, X[:1]])
        flipped.tensor()[-1, -4:] *= -1  # the same rotation
        close(chspline(flipped, 0.5, derivative=1, ends="periodic")[0], twists[0])


def test_poses_at_given_times_move_with_the_twists_of_those_times():
    xi, times = 0.4 * points(1, 6), torch.tensor([0, 0.5, 0.7, 2.0], dtype=F64)
    X = randn_SE3(1, dtype=F64) @ se3(times[:, None] * xi).Exp()  # one constant twist
    curve, t = hermite(X, times=times), torch.linspace(0, 2, 9, dtype=F64)
    close(curve(t).matrix(), (X[:1] @ se3(t[:, None] * xi).Exp()).matrix())
    close(curve(t, 1), xi.expand(9, 6))
    close(curve(t, 2), torch.zeros(9, 6, dtype=F64))


def test_rotations_are_the_rotations_of_poses_that_stay_in_place():
    q = randn_SO3(6, sigma=0.7, dtype=F64)
    poses = torch.cat([torch.zeros(6, 3, dtype=F64), q.tensor()], -1)
    for order in range(3):
        ours, theirs = chspline(q, 0.25, order), chspline(SE3(poses), 0.25, order)
        close(ours.as_subclass(torch.Tensor), theirs.as_subclass(torch.Tensor)[..., 3:])


@pytest.mark.parametrize("make", [hermite, cubic_spline])
def test_batches_of_points_and_of_times_equal_single_curves(make):
    p, t = points(3, 6, 2), torch.tensor(TIMES[1], dtype=F64)
    own = t + torch.rand(3, 6, generator=torch.Generator().manual_seed(0), dtype=F64).cumsum(-1)
    at = own[:, :1] + torch.linspace(0, 0.9, 7, dtype=F64) * (own[:, -1:] - own[:, :1])
    for order in range(3):
        singles = [make(a, times=b)(c, order) for a, b, c in zip(p, own, at)]
        close(make(p, times=own)(at, order), torch.stack(singles), atol=1e-9)
        shared = [make(p[0], times=b)(c, order) for b, c in zip(own, at)]
        close(make(p[0], times=own)(at, order), torch.stack(shared), atol=1e-9)
        alone = [make(a, times=t)(at[0].clamp(0.5, 4.5), order) for a in p]
        close(make(p, times=t)(at[0].clamp(0.5, 4.5), order), torch.stack(alone), atol=1e-9)
    close(arc_length(make(p, times=own))[1], arc_length(make(p[1], times=own[1])))


@pytest.mark.parametrize("ends", ["natural", "clamped"])
def test_gradients_agree_with_finite_differences(ends):
    p, times = points(5, 2).requires_grad_(), torch.tensor([0, 0.4, 1, 3, 3.5], dtype=F64)
    times.requires_grad_()
    t = torch.tensor([0.1, 0.9, 2.2, 3.4], dtype=F64, requires_grad=True)
    assert gradcheck(lambda p, h, t: cubic_spline(p, h, ends)(t), (p, times, t))
    assert gradcheck(lambda p, h, t: hermite(p, times=h)(t, 1), (p, times, t))


def test_single_parameters_are_taken():
    curve = hermite(points(6, 2), times=TIMES[1])
    many = curve(torch.tensor([0.5, 1.7], dtype=F64))
    close(curve(1.7), many[1])
    close(curve(torch.tensor(1.7, dtype=F64), 1), curve(torch.tensor([1.7], dtype=F64), 1)[0])


@pytest.mark.parametrize(
    "times", [[0, 2, 3], (0, 2, 3), np.array([0, 2, 3]), torch.tensor([0, 2, 3])]
)
def test_whole_numbers_are_times(times):
    wanted = hermite(points(3, 2), times=torch.tensor([0.0, 2, 3], dtype=F64))(1.0)
    close(hermite(points(3, 2), times=times)(1.0), wanted)


def test_float32_stays_float32():
    p = points(6, 2)
    curve = cubic_spline(p.float(), TIMES[1])(torch.linspace(0.5, 4.5, 9))
    assert curve.dtype == torch.float32
    close(curve.double(), cubic_spline(p, TIMES[1])(torch.linspace(0.5, 4.5, 9).double()), 1e-5)


P = points(4, 2)


@pytest.mark.parametrize(
    "call, words",
    [
        (
            lambda: hermite(P, times=[0, 2, 1, 3]),
            "times: expected increasing numbers, got 2.0 and 1.0 at 1",
        ),
        (lambda: cubic_spline(P, [0, 1, 1, 3]), "expected increasing numbers, got 1.0 and 1.0"),
        (lambda: hermite(P, times=[0, 1, 2]), r"times: expected \(\.\.\., N=4\), got \(3,\)"),
        (lambda: hermite(P, times=torch.arange(4.0)), "times: expected torch.float64"),
        (lambda: cubic_spline(P, [0, 1, 2, np.inf]), "times: expected finite numbers"),
        (lambda: cubic_spline(P, ends="periodic"), "points: expected the last to be the first"),
        (lambda: chspline(P, ends="periodic"), "points: expected the last to be the first"),
        (lambda: cubic_spline(P, ends="loose"), "ends: expected \"natural\", .*got 'loose'"),
        (lambda: cubic_spline(P, ends=None), "ends: expected .* or two tangents, got None"),
        (lambda: cubic_spline(P, ends=(P[0],)), "ends: expected .* or two tangents, got"),
        (lambda: hermite(P, ends="natural"), 'ends: expected "one-sided" or "periodic", got'),
        (lambda: hermite(P, P, ends="periodic"), "ends: expected no word"),
        (lambda: cubic_spline(P, ends=(P[0], P[0, :1])), r"last: expected \(\.\.\., d=2\)"),
        (lambda: cubic_spline(P[:1]), r"points: expected \(\.\.\., N >= 2, d\), got \(1, 2\)"),
        (lambda: cubic_spline(randn_SE3(4)), "points: expected .* got poses"),
        (
            lambda: hermite(P, times=[1, 2, 3, 5])(torch.tensor([1.0, 5.5], dtype=F64)),
            r"t: expected parameters in \[1, 5\], got 1 to 5.5",
        ),
        (lambda: hermite_segments(P, P[1:], P[1:], [3, 2, 1, 0]), "times: expected increasing"),
    ],
)
def test_what_does_not_fit_is_named(call, words):
    with pytest.raises(ValueError, match=words):
        call()
