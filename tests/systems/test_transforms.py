"""torch's own transforms over systems: vmap is a loop, grad and jacrev are autograd's."""

import copy

import pytest
import torch
from oracles import Clockwork, central, close, draw, matrices
from torch.func import functional_call, grad, hessian, jacfwd, jacrev, vmap

import pypose_lite as pp

pytestmark = pytest.mark.usefixtures("float64")


class FillsZeros(pp.NLS):
    def state_transition(self, state, input, t):
        n = torch.zeros(2)
        n[0] = state[0] + 0.1 * state[1].sin()
        n[1] = state[1] * input[0] + t
        return n

    def observation(self, state, input):
        return state[:1] * input


def lti(g):
    return pp.LTI(*matrices(g, 2, 1))


def ltv(g):
    return pp.LTV(*matrices(g, 2, 1, (6,)))


SYSTEMS = [lti, ltv, lambda g: pp.Pendulum(), lambda g: Clockwork(), lambda g: FillsZeros()]
NAMES = ["lti", "ltv", "pendulum", "clockwork", "fills zeros"]


@pytest.fixture(params=SYSTEMS, ids=NAMES)
def system(request, g):
    return request.param(g)


CALLS = {
    "transition": lambda s, x, u, t: s.transition(x, u, t),
    "observe": lambda s, x, u, t: s.observe(x, u, t),
    "linearize": lambda s, x, u, t: tuple(s.linearize(x, u, t)),
    "curvature": lambda s, x, u, t: s.expand_transition(x, u, t)[3](torch.ones_like(x)),
    "reference": lambda s, x, u, t: copy.copy(s).set_refpoint(x, u, t).A,
}


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("lead", [(), (2,)], ids=str)
def test_vmap_is_a_loop(system, g, call, lead):
    x, u, t = draw(g, 3, *lead, 2), draw(g, 3, *lead, 1), torch.tensor(4)
    found = vmap(lambda x, u: CALLS[call](system, x, u, t))(x, u)
    for i in range(3):
        want = CALLS[call](system, x[i], u[i], t)
        for got, one in zip(*((z,) if torch.is_tensor(z) else z for z in (found, want))):
            close(got[i].expand_as(one), one)


def test_vmap_over_some_of_the_arguments(system, g):
    x, u, t = draw(g, 3, 2), draw(g, 3, 1), torch.tensor([1, 4, 4])
    found = vmap(lambda u: system.linearize(x[0], u, 1).B)(u)
    close(found, torch.stack([system.linearize(x[0], one, 1).B for one in u]))
    found = vmap(lambda x, t: system.transition(x, u[0], t))(x, t)
    close(found, torch.stack([system.transition(z, u[0], now) for z, now in zip(x, t)]))


def test_steps_inside_vmap_tick_once_and_leave_nothing_behind(system, g):
    x, u = draw(g, 3, 2), draw(g, 3, 1)
    want = system(x, u)
    found = vmap(system)(x, u)
    assert system.systime == 2
    for got, one in zip(found, system.reset(1)(x, u)):
        close(got, one)
    copy.deepcopy(system), vmap(system)(x, u)
    copy.deepcopy(system)(x, u)
    assert want[0].shape == found[0].shape


@pytest.mark.parametrize("jacobian", [jacrev, jacfwd])
def test_jacobians_by_transforms_are_the_linearisation(system, g, jacobian):
    x, u = draw(g, 2), draw(g, 1)
    A, B = jacobian(lambda x, u: system.transition(x, u, 3), (0, 1))(x, u)
    close(A, system.linearize(x, u, 3).A), close(B, system.linearize(x, u, 3).B)


def test_derivatives_of_a_linearisation_are_central_differences(system, g):
    x, u = draw(g, 2), draw(g, 1)

    def size(x):
        return system.linearize(x, u, 3).A.square().sum()

    close(grad(size)(x), central(lambda x: size(x)[None], x)[0], 1e-7)
    close(jacrev(size)(x), grad(size)(x))
    close(
        hessian(lambda x: system.transition(x, u, 3)[1])(x),
        hessian_by_differences(system, x, u),
        1e-8,
    )


def hessian_by_differences(system, x, u):
    return central(lambda x: system.linearize(x, u, 3).A[1], x)


class Linear(torch.nn.Module):
    def __init__(self, car):
        super().__init__()
        self.car = car

    def forward(self, x, u):
        return self.car.linearize(x, u).A


def test_gradients_reach_parameters_by_functional_call(g):
    car, x, u = pp.DubinsCar(slip=torch.nn.Parameter(torch.tensor(0.2))), draw(g, 4), draw(g, 2)

    def cost(slip):
        moved, y = functional_call(car, {"slip": slip}, (x, u))
        return (moved * y).sum()

    close(
        grad(cost)(torch.tensor(0.2)), central(lambda s: cost(s)[None], torch.tensor(0.2))[0], 1e-8
    )
    found = vmap(cost)(torch.tensor([0.0, 0.3]))
    close(found, torch.stack([cost(torch.tensor(s)) for s in (0.0, 0.3)]))
    A = vmap(lambda s: functional_call(Linear(car), {"car.slip": s}, (x, u)))(torch.tensor([0.3]))
    close(A[0], pp.DubinsCar(slip=0.3).linearize(x, u).A)


def test_a_missing_derivative_is_no_error_inside_vmap_where_numbers_are_unknown(g):
    car = pp.DubinsCar()
    A = vmap(lambda x: car.linearize(x, torch.zeros(2)).A)(torch.zeros(3, 4))
    assert A.shape == (3, 4, 4)
