"""What every filter promises: nothing is changed, what does not fit is named, parameters move."""

import copy
import functools
import re

import pytest
import torch
from filter_helpers import FILTERS, Bend, close, one_step
from torch import nn

import pypose_lite as pp
from pypose_lite.filters import EKF, PF, UKF, Filter, smooth

pytestmark = pytest.mark.filterwarnings("ignore:PF")
tensor, zeros, ones, eye = (
    functools.partial(make, dtype=torch.float64)
    for make in (torch.tensor, torch.zeros, torch.ones, torch.eye)
)
every = pytest.mark.parametrize("kind", FILTERS.values(), ids=FILTERS)
NAMES = ["x", "y", "u", "P", "Q", "R"]


def seeded(kind, seed=1):
    return {"generator": torch.Generator().manual_seed(seed)} if kind is PF else {}


@every
def test_a_call_leaves_model_clock_and_arguments_alone_and_repeats(g, kind):
    model, args = Bend(), one_step(g)
    model(args[0], args[2])
    filter, before = kind(model, *args[4:]), [a.clone() for a in args]
    state = copy.deepcopy(filter.state_dict())
    first = filter(*args[:4], **seeded(kind))
    second = filter(*args[:4], **seeded(kind))
    assert torch.equal(first[0], second[0]) and torch.equal(first[1], second[1])
    assert all(torch.equal(a, b) for a, b in zip(args, before, strict=True))
    assert model.systime == 1
    assert all(torch.equal(value, state[name]) for name, value in filter.state_dict().items())


@every
def test_two_filters_share_one_model(g, kind):
    model, args = Bend(), one_step(g)
    one, other = kind(model, *args[4:]), EKF(model, *args[4:])
    alone = one(*args[:4], **seeded(kind))
    other(*args[:4])
    close(one(*args[:4], **seeded(kind))[0], alone[0], 0)


@every
def test_noise_of_the_call_goes_before_that_of_the_filter(g, kind):
    args = one_step(g)
    other = kind(Bend(), 3 * args[4], 2 * args[5])
    want = kind(Bend(), *args[4:])(*args[:4], **seeded(kind))
    got = other(*args, **seeded(kind))
    close(got[0], want[0], 0)
    close(got[1], want[1], 0)
    other.set_uncertainty(Q=args[4])
    other.set_uncertainty(R=args[5])
    close(other(*args[:4], **seeded(kind))[1], want[1], 0)


@every
def test_one_state_one_input_one_observation(g, kind):
    one = torch.ones(1, 1)
    filter = kind(pp.LTI(0.5 * one, one, one, 0 * one), 0.1 * one, 0.2 * one)
    x, P = filter(torch.zeros(1), torch.ones(1), torch.ones(1), one, **seeded(kind))
    assert x.shape == (1,) and P.shape == (1, 1)
    scalar = filter(*map(torch.tensor, (0.0, 1.0, 1.0)), one, **seeded(kind))  # numbers are (1,)
    close(scalar[0], x, 0)


@every
def test_float32_stays_float32_and_comes_close(g, kind):
    args = one_step(g)
    x, P = kind(Bend())(*args, **seeded(kind))
    small = kind(Bend().float())(*(a.float() for a in args), **seeded(kind))
    assert small[0].dtype == small[1].dtype == torch.float32
    tolerance = 0.1 if kind is PF else 1e-5  # float32 draws are other draws
    close(small[0].double(), x.detach(), tolerance)
    close(small[1].double(), P.detach(), tolerance)


@every
def test_double_moves_the_noise_and_parameters_are_learned(g, kind):
    args = one_step(g)
    filter = kind(Bend().float(), args[4].float(), nn.Parameter(args[5].float()))
    assert {name for name, _ in filter.named_parameters()} == {"R", "model.strength"}
    assert filter.double().Q.dtype == filter.R.dtype == torch.float64
    filter(*args[:4], **seeded(kind))[0].sum().backward()
    assert filter.R.grad.abs().sum() > 0
    twin = copy.deepcopy(filter)
    close(twin.R, filter.R, 0)
    filter.set_uncertainty(R=args[5])  # from a parameter to a plain tensor
    assert not isinstance(filter.R, nn.Parameter)


@every
def test_the_state_dict_round_trips(g, kind):
    args = one_step(g)
    filter, other = kind(Bend(), *args[4:]), kind(Bend(0.7), torch.eye(2), torch.eye(2))
    other.load_state_dict(filter.state_dict())
    want, got = filter(*args[:4], **seeded(kind)), other(*args[:4], **seeded(kind))
    close(got[0], want[0], 0)
    close(got[1], want[1], 0)


def test_parameters_of_any_argument_are_taken(g):
    args = [nn.Parameter(a) for a in one_step(g)]
    x, _ = EKF(Bend())(*args)
    x.sum().backward()
    assert all(a.grad is not None for a in args[:4])


ERRORS = {
    "x": (zeros(3), r"P: expected (..., n=3, n=3), got (2, 2); n=3 comes from x"),
    "y": (zeros(3), r"R: expected (..., p=3, p=3), got (2, 2); p=3 comes from y"),
    "P": (eye(2)[0], r"P: expected (..., n=2, n=2), got (2,); n=2 comes from x"),
    "Q": (tensor(0.01), r"Q: expected (..., n=2, n=2), got (); n=2 comes from x"),
    "R": (eye(3), r"R: expected (..., p=2, p=2), got (3, 3); p=2 comes from y"),
    "u": (tensor([torch.nan]), "u: expected finite numbers, got nan at (0,)"),
}


@every
@pytest.mark.parametrize("name", ERRORS)
def test_what_does_not_fit_is_named(g, kind, name):
    value, text = ERRORS[name]
    args = dict(zip(NAMES, one_step(g), strict=True)) | {name: value}
    with pytest.raises(ValueError, match=re.escape(text)):
        kind(Bend())(**args)


@every
@pytest.mark.parametrize(
    "change, text",
    [
        ({"P": eye(2).float()}, "P: expected torch.float64 on cpu like x, got torch.float32"),
        ({"x": ones(2).long()}, "x: expected a floating-point tensor, got torch.int64"),
        ({"x": [0.0, 0.0]}, "x: expected a tensor, got list"),
        ({"u": None}, "u: expected a tensor, got NoneType"),
        ({"Q": None}, "Q: expected a tensor, got NoneType"),
        ({"y": tensor([0.0, torch.inf])}, "y: expected finite numbers, got inf at (1,)"),
        ({"P": torch.diag(tensor([1.0, -1]))}, "P: expected no negative eigenvalue, got -1"),
        ({"x": zeros(2, 2), "P": eye(2).expand(3, 2, 2)}, "does not broadcast"),
        ({"R": zeros(2, 2), "P": zeros(2, 2)}, "expected positive definite"),
        ({"y": zeros(1), "R": eye(1)}, "R: expected (..., p=2, p=2), got (1, 1)"),
    ],
)
def test_what_makes_no_sense_is_named(g, kind, change, text):
    args = dict(zip(NAMES, one_step(g), strict=True)) | change
    with pytest.raises(ValueError, match=re.escape(text)):
        kind(Bend())(**args)


@every
@pytest.mark.parametrize("name", ["Q", "R"])
def test_noise_that_is_no_covariance_is_refused_at_once(kind, name):
    with pytest.raises(ValueError, match=f"{name}: expected no negative eigenvalue"):
        kind(Bend(), **{name: -torch.eye(2)})


@every
def test_a_transition_of_another_size_is_named(g, kind):
    class Shrinks(Bend):
        def state_transition(self, state, input, t=None):
            return state[:1]

    with pytest.raises(ValueError, match=r"state_transition: expected a state \(..., n=2\)"):
        kind(Shrinks())(*one_step(g))


@every
def test_errors_of_the_model_arrive_as_they_are(g, kind):
    class Broken(Bend):
        def observation(self, state, input, t=None):
            return self.lenght * state

    with pytest.raises(AttributeError, match="lenght"):
        kind(Broken())(*one_step(g))


def test_k_below_minus_n_and_roots_that_are_none_are_refused(g):
    args = one_step(g)
    with pytest.raises(ValueError, match="k: expected a number above -n = -2, got -2"):
        UKF(Bend())(*args, k=-2)
    with pytest.raises(ValueError, match="msqrt: expected M"):
        UKF(Bend(), msqrt=lambda P: P)(*args)
    with pytest.raises(TypeError, match="k"):
        EKF(Bend())(*args, k=1)  # an argument that means nothing here is not swallowed


def test_a_filter_of_no_particles_is_refused():
    with pytest.raises(ValueError, match="particles: expected at least 1, got 0"):
        PF(Bend(), particles=0)


def test_a_run_to_smooth_must_have_one_state_more_than_observations(g):
    x, _, _, P, Q, R = one_step(g, (5,))
    with pytest.raises(ValueError, match=r"x: expected \(..., S=6, n\), got \(5, 2\)"):
        smooth(EKF(Bend()), x, P, torch.zeros(5, 2), torch.zeros(5, 1), Q[0], R[0])


def test_pypose_calls_run(g):
    """The signature of PyPose, by position and by name."""
    x, y, u, P, Q, R = one_step(g)
    for filter in (EKF(Bend(), Q, R), UKF(Bend(), Q=Q, R=R, msqrt=torch.linalg.cholesky)):
        close(filter(x, y, u, P)[0], filter(x, y, u, P, Q, R, t=torch.tensor(0))[0], 0)
    UKF(Bend())(x, y, u, P, Q, R, None, 1.0)
    PF(Bend(), Q, R, 50)(x, y, u, P, t=0)
    assert issubclass(EKF, Filter)


def test_the_ekf_takes_each_tangent_once_and_none_in_the_input(g, monkeypatch):
    model, asked = Bend(), []
    for name in ("linearize_transition", "linearize_observation"):
        real = getattr(model, name)
        monkeypatch.setattr(
            model,
            name,
            lambda *a, real=real, name=name, **kw: asked.append((name, kw)) or real(*a, **kw),
        )
    EKF(model)(*one_step(g))
    assert sorted(asked, key=str) == [
        ("linearize_observation", {"wrt": "x"}),
        ("linearize_transition", {"wrt": "x"}),
    ]
