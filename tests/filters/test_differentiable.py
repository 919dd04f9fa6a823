"""Gradients are those of what is returned; those of particles tend to the exact filter's."""

import pytest
import torch
from filter_helpers import FILTERS, Bend, close, draw, linear, one_step, record
from torch.autograd import gradcheck
from torch.func import functional_call

import pypose_lite as pp
from pypose_lite.filters import EKF, PF, UKF, resample, smooth, systematic

pytestmark = pytest.mark.filterwarnings("ignore:PF")
every = pytest.mark.parametrize("kind", FILTERS.values(), ids=FILTERS)


def make(kind, model):
    """The filter as a function that draws the same numbers at every call."""
    if kind is not PF:
        return kind(model)
    pf = PF(model, particles=20)
    return lambda *a: pf(*a, generator=torch.Generator().manual_seed(3))


def tracked(args):
    return [a.clone().requires_grad_() for a in args]


@every
@pytest.mark.parametrize("lead", [(), (2,)])
def test_gradients_reach_every_argument(g, kind, lead):
    assert gradcheck(make(kind, Bend()), tracked(one_step(g, lead)))


@every
@pytest.mark.parametrize("lead", [(), (2,)])
def test_gradients_reach_the_models_parameters(g, kind, lead):
    model, args = Bend(), one_step(g, lead)
    filter = make(kind, model)

    def step(strength):
        model._parameters["strength"] = strength
        return filter(*args)

    assert gradcheck(step, tracked([torch.tensor(0.3)]))


@pytest.mark.parametrize("kind", [EKF, UKF])
def test_the_log_likelihood_has_gradients(g, kind):
    *args, R = one_step(g)
    x, y, u, P, _ = args
    assert gradcheck(
        lambda *a: kind(Bend()).innovation(*a).log_likelihood, tracked([x, y, u, P, R])
    )


@every
def test_gradients_pass_ten_steps_of_a_closed_loop(g, kind):
    """A linear controller steers by the estimate, the observations come from the true car."""
    car, N = pp.DubinsCar(), 10
    noise, K = 0.1 * draw(g, N, 4), 0.5 * draw(g, 2, 4)
    filter, eye = make(kind, car), torch.eye(4)

    def loop(K, r, slip):
        car.slip = slip
        truth = x = torch.tensor([0.0, 0.0, 1.0, 0.0])
        P = 0.01 * eye
        for v in noise:
            u = torch.tensor([1.0, 0.0]) - pp.bmv(K, x)
            y, truth = car.observe(truth, u) + v, car.transition(truth, u)
            x, P = filter(x, y, u, P, 1e-3 * eye, r * eye)
        return x, P

    assert gradcheck(loop, tracked([K, torch.tensor(0.3), torch.tensor(0.1)]))


@pytest.mark.parametrize("kind", [EKF, UKF])
def test_the_smoother_has_gradients(g, kind):
    x, _, _, P, Q, R = one_step(g)
    y, u, filter = draw(g, 3, 2), draw(g, 3, 1), kind(Bend())

    def run(x, P, y, u, Q, R):
        return smooth(filter, *record(filter, x, P, y, u, Q, R), y, u, Q, R)

    assert gradcheck(run, tracked([x, P, y, u, Q, R]))


@every
def test_rows_without_a_measurement_do_not_poison_gradients(g, kind):
    x, y, *rest = tracked(one_step(g, (3,)))
    holes = torch.tensor([[False, True], [True, True], [False, False]])
    mean, P = make(kind, Bend())(x, y.masked_fill(holes, torch.nan), *rest)
    (mean.sum() + P.sum()).backward()
    assert all(a.grad.isfinite().all() for a in (x, y, *rest))
    assert (y.grad[holes] == 0).all() and (y.grad[~holes] != 0).all()


@every
def test_a_certain_state_has_finite_gradients(g, kind):
    x, y, u, _, Q, R = one_step(g)
    x, Q, R = tracked([x, Q, R])
    mean, P = make(kind, Bend())(x, y, u, torch.diag(torch.tensor([0.5, 0.0])), Q, R)
    (mean.sum() + P.sum()).backward()
    assert all(a.grad.isfinite().all() for a in (x, Q, R))


def exact_gradients(system, u, y, scale):
    """Of the Kalman filter's last mean, with respect to scales of A and of R."""
    a, r = tracked(scale)
    model = pp.LTI(a * system.A, *system[1:6])
    x, _ = record(EKF(model), system.x, system.P, y, u, system.Q, r * system.R)
    return torch.autograd.grad(x[-1].sum(), [a, r])


def test_the_particles_gradients_tend_to_those_of_the_exact_filter(g):
    system = linear(g)
    _, u, y = system.run(g, 4)
    want = exact_gradients(system, u, y, [torch.ones(()), torch.ones(())])
    a, r = tracked([torch.ones(()), torch.ones(())])
    pf = PF(pp.LTI(a * system.A, *system[1:6]), particles=200_000)
    x, _ = record(pf, system.x, system.P, y, u, system.Q, r * system.R, generator=g)
    got = torch.autograd.grad(x[-1].sum(), [a, r])
    for one, other in zip(got, want, strict=True):
        assert one.item() == pytest.approx(other.item(), rel=0.02)


def kept_gradients(g, system, u, y):
    """Of the last mean of particles that are resampled at every step, many runs at once."""
    a, r = tracked([torch.ones(200, 1, 1), torch.ones(200, 1, 1)])
    pf = PF(pp.LTI(a * system.A, *system[1:6]), particles=2000)
    particles = pf.draw(system.x.expand(200, 2), system.P, generator=g)
    for i in range(len(u)):
        particles = pf.weigh(particles, y[i], u[i], r * system.R)
        positions = systematic(1 - torch.rand(200, 2000, generator=g))
        particles = pf.move(resample(particles, positions), u[i], system.Q, generator=g)
    return torch.autograd.grad(particles.mean.sum(), [a, r])


def test_gradients_pass_resampling_right_on_average(g):
    system = linear(g)
    _, u, y = system.run(g, 3)
    want = exact_gradients(system, u, y, [torch.ones(()), torch.ones(())])
    for one, other in zip(kept_gradients(g, system, u, y), want, strict=True):
        spread = one.std().item() / 200**0.5
        assert abs(one.mean().item() - other.item()) < 4 * spread + 0.01 * abs(other.item())


def test_a_learned_model_is_a_functional_call(g):
    """torch.func sees the same numbers as autograd."""
    model, args = Bend(), one_step(g)
    filter = EKF(model)

    def loss(strength):
        x, P = functional_call(filter, {"model.strength": strength}, args)
        return x.sum() + P.sum()

    strength = torch.tensor(0.3)
    by_func = torch.func.grad(loss)(strength)
    (by_grad,) = torch.autograd.grad(loss(s := strength.clone().requires_grad_()), s)
    close(by_func, by_grad)
    close(torch.func.jacrev(loss)(strength), by_grad)
