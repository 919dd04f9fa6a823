"""The models against their equations of motion, solved another way."""

import math

import numpy as np
import pytest
import torch
from oracles import close, draw
from scipy.integrate import solve_ivp
from torch.autograd import gradcheck

import pypose_lite as pp

pytestmark = pytest.mark.usefixtures("float64")
MODELS = [pp.DubinsCar, pp.Legs, pp.Pendulum, pp.CartPole]


def sample(g, model, *lead):
    n, m = model.sizes["n"], model.sizes["m"]
    return draw(g, *lead, n), draw(g, *lead, m)


@pytest.mark.parametrize("slip", [0.0, 0.3])
def test_the_car_turns_first_and_then_drives_ahead(g, slip):
    for _ in range(5):
        (i, j, theta, v, phi) = draw(g, 5).tolist()
        x = torch.tensor([i, j, math.cos(theta), math.sin(theta)])
        new = theta + (1 - slip) * phi * 0.2
        want = [i + 0.2 * v * math.cos(new), j + 0.2 * v * math.sin(new)]
        want = torch.tensor([*want, math.cos(new), math.sin(new)])
        close(pp.DubinsCar(dt=0.2, slip=slip)(x, torch.tensor([v, phi]))[0], want)


def test_the_car_draws_a_circle_of_radius_speed_over_turn_rate():
    """36 steps of 10 degrees: the corners of a regular polygon, and back at the start."""
    car, turn = pp.DubinsCar(dt=0.5), math.radians(10)
    x = torch.tensor([0.0, 0.0, math.cos(-turn / 2), math.sin(-turn / 2)])
    xs = [x := car(x, torch.tensor([0.8, turn / 0.5]))[0] for _ in range(36)]
    radius = 0.4 / (2 * math.sin(turn / 2))
    centre = torch.tensor([0.0, radius])
    away = torch.stack(xs)[:, :2] - centre
    close(away.norm(dim=-1), torch.full((36,), radius))
    close(xs[-1][:2], torch.zeros(2))


def test_the_car_needs_no_unit_heading_and_returns_one(g):
    x, u = draw(g, 6, 4), draw(g, 6, 2)
    after = pp.DubinsCar()(x, u)[0]
    close(after[:, 2:].norm(dim=-1), torch.ones(6))
    scaled = x * torch.tensor([1, 1, 7.0, 7.0])
    close(pp.DubinsCar()(scaled, u)[0], after)


def test_the_car_is_seen_as_it_was_before_the_step(g):
    x, u = sample(g, pp.DubinsCar, 3)
    close(pp.DubinsCar()(x, u)[1], x, 0)


def test_legs_get_to_their_speeds_as_the_equation_of_a_lag_says(g):
    """The exact solution of lag dv/dt = u - v, after each of 30 steps; then the car moves by v."""
    legs, car, lag = pp.Legs(dt=0.04, lag=0.3), pp.DubinsCar(dt=0.04), 0.3
    x, u = draw(g, 6), draw(g, 2)
    start, seen = x[4:], x
    for step in range(1, 31):
        seen, before = legs(seen, u)[0], seen
        v = u + math.exp(-0.04 * step / lag) * (start - u)
        close(seen[4:], v)
        close(seen[:4], car(before[:4], v)[0])


def test_legs_that_do_not_do_as_they_are_told_go_where_scipy_integrates_to(g):
    """500 steps of 2 ms of a body with gain, drift and a slide in turns."""
    lag, gain, drift, axle = (0.3, 0.15), (1.2, 0.9), (-0.1, 0.05), 0.17
    numbers = {"lag": torch.tensor(lag), "gain": torch.tensor(gain), "drift": torch.tensor(drift)}
    legs = pp.Legs(2e-3, **numbers, axle=axle)
    u = torch.tensor([0.5, -0.8])

    def motion(_, s):
        i, j, theta, v, w = s
        left = axle * w
        rates = [(gain[k] * float(u[k]) + drift[k] - (v, w)[k]) / lag[k] for k in (0, 1)]
        forward = [math.cos(theta), math.sin(theta)]
        return [v * forward[0] - left * forward[1], v * forward[1] + left * forward[0], w, *rates]

    x = torch.tensor([0.2, -0.1, math.cos(0.4), math.sin(0.4), 0.1, 0.3])
    end = solve_ivp(motion, (0, 1), [0.2, -0.1, 0.4, 0.1, 0.3], rtol=1e-9, atol=1e-9).y[:, -1]
    for _ in range(500):
        x = legs(x, u)[0]
    expected = [end[0], end[1], math.cos(end[2]), math.sin(end[2]), end[3], end[4]]
    close(x, torch.tensor(expected), 5e-3)


def test_a_lag_can_be_learned(g):
    lag = torch.tensor(0.2, requires_grad=True)
    x, u = draw(g, 6), draw(g, 2)
    assert gradcheck(lambda lag: pp.Legs(0.1, lag=lag)(x, u)[0], lag)


def test_a_short_pendulum_step_follows_the_equation_of_motion(g):
    """1000 steps of 1 ms against SciPy's integration."""
    length, mass, damping, tau = 0.7, 1.4, 0.2, 0.5
    pendulum = pp.Pendulum(1e-3, length, mass, damping, 9.0)

    def motion(_, s):
        torque = mass * 9.0 * length * math.sin(s[0]) - damping * s[1] + tau
        return [s[1], torque / (mass * length**2)]

    x = torch.tensor([0.4, -0.3])
    want = solve_ivp(motion, (0, 1), x.tolist(), rtol=1e-10, atol=1e-10).y[:, -1]
    for _ in range(1000):
        x = pendulum(x, torch.tensor([tau]))[0]
    close(x, torch.tensor(want), 2e-2)
    assert abs(x[0] - 0.4) > 1


def test_a_pendulum_step_moves_the_angle_with_the_new_rate(g):
    x, u = sample(g, pp.Pendulum, 5)
    after, y = pp.Pendulum(0.05, 0.7, 1.4, 0.2, 9.0)(x, u)
    torque = 1.4 * 9.0 * 0.7 * x[:, 0].sin() - 0.2 * x[:, 1] + u[:, 0]
    omega = x[:, 1] + torque / (1.4 * 0.49) * 0.05
    close(after, torch.stack([x[:, 0] + 0.05 * omega, omega], -1))
    close(y, x[:, :1], 0)


def test_a_cart_pole_step_is_explicit_euler_on_lagranges_equations(g):
    """Both accelerations at once, from the mass matrix of cart and rod."""
    dt, half, M, m, gravity = 0.03, 0.6, 1.2, 0.2, 9.5
    x, u = sample(g, pp.CartPole, 5)
    after, y = pp.CartPole(dt, half, M, m, gravity)(x, u)
    for i in range(5):
        _, dx, theta, dtheta = x[i].tolist()
        c, s = math.cos(theta), math.sin(theta)
        mass = np.array([[M + m, m * half * c], [m * half * c, (1 + 1 / 3) * m * half**2]])
        force = np.array([u[i, 0] + m * half * dtheta**2 * s, m * gravity * half * s])
        ddx, ddtheta = np.linalg.solve(mass, force)
        close(after[i], x[i] + dt * torch.tensor([dx, ddx, dtheta, ddtheta]))
    close(y, x[:, [0, 2]], 0)


@pytest.mark.parametrize("model", MODELS)
def test_each_parameter_may_be_learned(g, model):
    x, u = sample(g, model, 2)
    names = [name for name in vars(model()) if not name.startswith("_") and name != "training"]
    assert len(names) == {"DubinsCar": 2, "Legs": 6, "Pendulum": 5, "CartPole": 5}[model.__name__]
    values = [torch.tensor(float(getattr(model(), name)), requires_grad=True) for name in names]
    assert gradcheck(lambda *values: model(*values)(x, u)[0], values)
    learned = model(**{names[1]: torch.nn.Parameter(values[1].detach())})
    assert [name for name, _ in learned.named_parameters()] == [names[1]]


@pytest.mark.parametrize("model", MODELS)
def test_float32_stays_float32_for_one_state_and_for_many(g, model):
    for lead in ((), (3,)):
        x, u = (z.float() for z in sample(g, model, *lead))
        found = (*model()(x, u), *model().linearize(x, u))
        assert {z.dtype for z in found} == {torch.float32}


@pytest.mark.parametrize("model", MODELS)
def test_shapes_that_do_not_fit_are_named(g, model):
    x, u = sample(g, model)
    n, m = model.sizes["n"], model.sizes["m"]
    with pytest.raises(ValueError, match=rf"state: expected \(..., n={n}\), got \({n + 1},\)"):
        model()(torch.cat([x, x[:1]]), u)
    with pytest.raises(ValueError, match=rf"input: expected \(..., m={m}\), got \({m + 1},\)"):
        model()(x, torch.cat([u, u[:1]]))
