"""Sensors that speak one at a time: each update has its own g and R."""

import functools
import math

import pytest
import torch
from filter_helpers import Bend, Still, close, draw, linear, record, spd, whole_run
from torch.autograd import gradcheck

import pypose_lite as pp
from pypose_lite.filters import EKF, PF, UKF, angles

pytestmark = pytest.mark.filterwarnings("ignore:PF")
gaussian = pytest.mark.parametrize("kind", [EKF, UKF])
ROWS = {"a": [0], "b": [1, 3], "c": [2]}


def split(system):
    """A function and a noise for each of three sensors, which make the whole observation."""
    C, D, c2 = system.C, system.D, system.c2

    def sensor(rows):
        return lambda state, input: C[rows] @ state + D[rows] @ input + c2[rows]

    return {name: (sensor(rows), system.R[rows][:, rows]) for name, rows in ROWS.items()}


def four_rows(g):
    system = linear(g, 3, 2, 4)
    R = torch.zeros(4, 4)
    for rows in ROWS.values():  # no correlation but within a sensor
        R[torch.tensor(rows).unsqueeze(-1), torch.tensor(rows)] = spd(g, len(rows))
    return system._replace(R=R)


@gaussian
@pytest.mark.parametrize("order", ["abc", "cab", "bca"])
def test_one_after_the_other_they_are_the_stacked_measurement(g, kind, order):
    system = four_rows(g)
    y, u, filter, x, P = draw(g, 4), draw(g, 2), kind(system.model), system.x, system.P
    want = filter.update(x, y, u, P, system.R)
    for name in order:
        h, R = split(system)[name]
        x, P = filter.update(x, y[ROWS[name]], u, P, R=R, g=h)
    close(x, want[0])
    close(P, want[1])


@gaussian
def test_at_different_rates_they_are_the_run_given_all_that_came(g, kind):
    """One speaks at every step, one at every second, one at every third."""
    system = four_rows(g)
    _, u, y = system.run(g, 9)
    filter, x, P, rates = kind(system.model, system.Q), system.x, system.P, {"a": 1, "b": 2, "c": 3}
    holes = torch.full_like(y, torch.nan)
    for i in range(9):
        for name, (h, R) in split(system).items():
            if i % rates[name] == 0:
                x, P = filter.update(x, y[i, ROWS[name]], u[i], P, R=R, g=h)
                holes[i, ROWS[name]] = y[i, ROWS[name]]
        x, P = filter.predict(x, u[i], P)
    want = record(kind(system.model, system.Q, system.R), system.x, system.P, holes, u)
    close(x, want[0][-1], 1e-10)
    close(P, want[1][-1], 1e-10)
    every = whole_run(
        system._replace(C=system.C[:1], D=system.D[:1], c2=system.c2[:1], R=system.R[:1, :1]),
        u,
        y[:, :1],
        9,
    )
    alone, L = system.x, system.P
    for i in range(9):
        h, R = split(system)["a"]
        alone, L = filter.predict(*swap(filter.update(alone, y[i, :1], u[i], L, R=R, g=h), u[i]))
    close(alone, every[0][-1], 1e-10)
    close(L, every[1][-1], 1e-10)


def swap(belief, u):
    x, P = belief
    return x, u, P


@pytest.mark.parametrize("kind", [EKF, UKF])
def test_the_innovation_is_the_sensors(g, kind):
    system = four_rows(g)
    y, u = draw(g, 2), draw(g, 2)
    h, R = split(system)["b"]
    got = kind(system.model).innovation(system.x, y, u, system.P, R, g=h)
    C = system.C[[1, 3]]
    close(got.value, y - h(system.x, u))
    close(got.covariance, C @ system.P @ C.mT + R)


def test_particles_take_sensors_too(g):
    system = four_rows(g)
    u = draw(g, 2)
    y = system.model.observe(system.x, u) + draw(g, 4)
    pf, whole = PF(system.model, particles=200_000), EKF(system.model)
    want = whole.update(system.x, y, u, system.P, system.R)
    particles, total = pf.draw(system.x, system.P, g), 0
    for name, (h, R) in split(system).items():
        total = total + pf.log_likelihood(particles, y[ROWS[name]], u, R, g=h)
        particles = pf.weigh(particles, y[ROWS[name]], u, R, g=h)
    close(particles.mean, want[0], 0.03)
    close(particles.covariance, want[1], 0.03)
    log_density = whole.innovation(system.x, y, u, system.P, system.R).log_likelihood
    close(total, log_density, 0.05)
    h, R = split(system)["b"]
    got = pf.update(system.x, y[[1, 3]], u, system.P, R, g=h, generator=g)
    want = whole.update(system.x, y[[1, 3]], u, system.P, R, g=h)
    close(got[0], want[0], 0.02)
    close(got[1], want[1], 0.02)
    got = pf.innovation(system.x, y[[1, 3]], u, system.P, R, g=h, generator=g)
    want = whole.innovation(system.x, y[[1, 3]], u, system.P, R, g=h)
    close(got.value, want.value, 1e-9)
    close(got.covariance, want.covariance, 1e-9)


def scaled(scale, state):
    return scale * state[:1] * state[1:]


def of_the_time(state, t):
    assert t == 0  # the clock, not the input
    return state[:1] * state[1:]


SPELLINGS = {
    "of the state": lambda state: state[:1] * state[1:],
    "of state and input": lambda state, input: state[:1] * state[1:] + 0 * input,
    "of the time, too": lambda state, input, t: state[:1] * state[1:] + 0 * t,
    "of state and time": of_the_time,
    "with an option": lambda state, scale=1.0: scale * state[:1] * state[1:],
    "with an input that may be left out": lambda x, u=None: x[:1] * x[1:] + 0 * u,
    "of a batch": lambda state: state[..., :1] * state[..., 1:],
    "with options by name": lambda state, *, scale=1.0, **more: scale * state[:1] * state[1:],
    "in part given": functools.partial(scaled, 1.0),
}


@pytest.mark.parametrize("kind", [EKF, UKF, PF])
@pytest.mark.parametrize("h", SPELLINGS.values(), ids=SPELLINGS)
@pytest.mark.parametrize("lead", [(), (2,), (3,), (2, 3)])
def test_g_may_be_written_as_any_observation(g, kind, h, lead):
    class Product(Still):
        def observation(self, state, input, t=None):
            return state[..., :1] * state[..., 1:]

    x, y, u = draw(g, *lead, 2), draw(g, *lead, 1), draw(g, *lead, 1)
    P, R, model = spd(g, 2, lead, 0.1), torch.eye(1), Product()
    seeds = [{"generator": torch.Generator().manual_seed(1)} if kind is PF else {} for _ in "12"]
    want = kind(model).update(x, y, u, P, R, **seeds[0])
    got = kind(Still()).update(x, y, u, P, R=R, g=h, **seeds[1])
    close(got[0], want[0])
    close(got[1], want[1])


@gaussian
def test_a_sensor_of_the_state_needs_no_input_and_another_says_so(g, kind):
    x, P, filter = draw(g, 2), spd(g, 2), kind(Bend())
    got = filter.update(x, draw(g, 1) * 0, None, P, R=torch.eye(1), g=lambda state: state[:1])
    want = filter.update(x, torch.zeros(1), torch.ones(1), P, R=torch.eye(1), g=lambda s: s[:1])
    close(got[0], want[0])
    with pytest.raises(
        ValueError, match=r"u: g takes \(state, input\), so an input has to be given"
    ):
        filter.update(x, torch.zeros(1), None, P, R=torch.eye(1), g=lambda state, input: state[:1])


@pytest.mark.parametrize("kind", [EKF, UKF, PF])
def test_a_sensor_has_a_noise_of_its_own(g, kind):
    x, P, filter = draw(g, 2), spd(g, 2), kind(Bend(), R=torch.eye(2))
    with pytest.raises(ValueError, match="R: expected the noise of g's sensor"):
        filter.update(x, x, x[:1], P, g=lambda state: state)
    with pytest.raises(ValueError, match=r"R: expected \(..., p=1, p=1\), got \(2, 2\); p is g's"):
        filter.update(x, x, x[:1], P, R=torch.eye(2), g=lambda state: state[:1])


@pytest.mark.parametrize("kind", [EKF, UKF, PF])
def test_the_filters_residual_is_for_its_own_observation_alone(g, kind):
    """A position and a compass beside a model that is seen as a compass."""
    model, seeds = Still(), [torch.Generator().manual_seed(1) for _ in range(4)]
    filter = kind(model, R=0.1 * torch.eye(1), residual=angles(0))
    x, P, u, R = torch.tensor([3.1]), 0.1 * torch.eye(1), torch.zeros(1), 0.1 * torch.eye(1)

    def update(y, **options):
        seed = {"generator": seeds.pop()} if kind is PF else {}
        return filter.update(x, torch.tensor([y]), u, P, R, **options, **seed)[0]

    near = update(-3.1)  # the model's own, across the cut
    compass = update(-3.1, g=lambda state: state, residual=angles(0))
    position = update(9.3, g=lambda state: state)  # metres: 6.2 apart
    close(compass, near)
    assert abs(near.item() - math.pi) < 0.05 and position.item() > 3.5


class Swing(pp.NLS):
    def state_transition(self, state, input, t=None):
        return state

    def observation(self, state, input, t=None):
        return state * (1 + t)


@pytest.mark.parametrize("kind", [EKF, UKF])
def test_the_time_of_a_sensor_is_the_models_clock_unless_it_is_given(g, kind):
    x, P, u, R, model = draw(g, 2), spd(g, 2), torch.zeros(1), torch.eye(2), Swing()
    model.reset(3)
    filter = kind(model, R=R)
    for t in (None, 7, torch.tensor(2)):
        want = filter.update(x, x, u, P, t=t)
        got = filter.update(x, x, u, P, R=R, t=t, g=lambda state, input, t: state * (1 + t))
        close(got[0], want[0])
    assert model.systime == 3


@pytest.mark.parametrize("kind", [EKF, UKF])
def test_rows_of_a_sensor_may_be_missing(g, kind):
    x, P, R, filter = draw(g, 2), spd(g, 2), spd(g, 2), kind(Bend())
    y = torch.tensor([0.4, torch.nan])
    got = filter.update(x, y, x[:1], P, R=R, g=lambda state: state)
    want = filter.update(x, y[:1], x[:1], P, R=R[:1, :1], g=lambda state: state[:1])
    close(got[0], want[0])
    close(got[1], want[1])


@gaussian
def test_gradients_reach_the_sensors_parameters(g, kind):
    x, P, filter = draw(g, 2), spd(g, 2), kind(Bend())

    def update(x, y, P, R, gain):
        return filter.update(x, y, None, P, R=R, g=lambda state: gain * state.sin())

    args = x, draw(g, 2), P, spd(g, 2), torch.tensor(1.3)
    assert gradcheck(update, [a.clone().requires_grad_() for a in args])


@gaussian
@pytest.mark.parametrize("h", [torch.nn.Linear(2, 1), torch.sin])
def test_a_sensor_may_be_a_module_or_a_function_of_torchs(g, kind, h):
    h = h.double() if isinstance(h, torch.nn.Module) else h
    x, P = draw(g, 3, 2), spd(g, 2)
    p = h(x).shape[-1]
    got = kind(Still()).update(x, torch.zeros(p), None, P, R=torch.eye(p), g=h)
    assert got[0].shape == (3, 2)
    close(got[0][1], kind(Still()).update(x[1], torch.zeros(p), None, P, R=torch.eye(p), g=h)[0])


@gaussian
def test_errors_of_a_sensor_arrive_as_they_are(g, kind):
    x, P = draw(g, 2), spd(g, 2)
    with pytest.raises(ZeroDivisionError):
        kind(Still()).update(x, x, None, P, R=torch.eye(2), g=lambda state: state * (1 / 0))


@gaussian
def test_where_g_is_not_finite_it_is_said(g, kind):
    filter, P = kind(Still()), torch.eye(1)
    with pytest.raises(ValueError, match="observation: expected finite numbers, got nan at"):
        filter.update(-torch.ones(1), torch.ones(1), None, P, R=torch.eye(1), g=torch.log)
