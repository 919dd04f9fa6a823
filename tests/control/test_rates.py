"""Changes of the input that cost something or are limited: against the same problem by SciPy."""

import pytest
import torch
from oracles import Clockwork, close, draw, weights
from scipy.optimize import Bounds, minimize

import pypose_lite as pp
from pypose_lite.control import input_rates

pytestmark = pytest.mark.usefixtures("float64")


def by_scipy(system, Q, S, x, u_last, target, T, limit=None):
    """The changes of the best plan, each cost written out."""

    def price(flat):
        du = torch.as_tensor(flat).reshape(T, -1)
        u, now, cost = u_last, x, 0
        for t in range(T):
            u = u + du[t]
            z = torch.cat([now - target, u])
            cost = cost + z @ Q @ z / 2 + du[t] @ S @ du[t] / 2
            now = system.transition(now, u, 1 + t)
        return cost

    def both(flat):
        flat = torch.tensor(flat, requires_grad=True)
        cost = price(flat)
        return cost.item(), torch.autograd.grad(cost, flat)[0].numpy()

    box = None if limit is None else Bounds(-limit, limit)
    start = torch.zeros(T * len(u_last)).numpy()
    found = minimize(both, start, jac=True, method="L-BFGS-B", bounds=box, tol=1e-15)
    return torch.tensor(found.x).reshape(T, -1), torch.tensor(found.fun)


@pytest.mark.parametrize("limit", [None, 0.1])
def test_a_plan_is_the_one_whose_changes_cost_least(g, limit):
    system, Q, S = Clockwork().reset(1), weights(g, 3)[0], torch.tensor([[0.7]])
    x, u_last, target = draw(g, 2), 0.5 * draw(g, 1), draw(g, 2)
    longer, Q_longer = input_rates(system, Q, S)
    longer.reset(1)
    mpc = pp.MPC(longer, Q_longer, None, 6)
    goal = torch.cat([target, torch.zeros(1)])
    bounds = {} if limit is None else {"u_lower": -limit, "u_upper": limit}
    plan = mpc.solve(None, torch.cat([x, u_last]), goal, **bounds)
    du, cost = by_scipy(system, Q, S, x, u_last, target, 6, limit)
    assert plan.converged
    close(plan.cost, cost, 1e-7)
    close(plan.u, du, 1e-3)
    close(plan.x[1:, 2], u_last + plan.u[:, 0].cumsum(0))
    if limit is not None:
        assert (plan.u.abs() <= limit).all() and (plan.u.abs() == limit).any()


def test_a_dear_change_makes_a_calm_plan(g):
    x, target = pp.infinity.waypoints()[0], pp.infinity.waypoints()[2]
    Q = torch.diag(torch.tensor([1, 1, 0.3, 0.3, 0.01, 0.01]))
    rough = []
    for price in (1e-6, 1.0):
        car, weigh = input_rates(pp.DubinsCar(), Q, price * torch.eye(2))
        start, goal = (torch.cat([z, torch.zeros(2)]) for z in (x, target))
        rough.append(pp.MPC(car, weigh, None, 10).solve(0.1, start, goal).u.abs().max())
    assert rough[1] < 0.3 * rough[0]


def test_a_batch_is_the_stack_of_single_plans_and_the_observation_is_the_systems(g):
    car, Q = input_rates(pp.DubinsCar(), weights(g, 6)[0], torch.eye(2))
    x, u = draw(g, 3, 6), draw(g, 3, 2)
    close(car.observe(x, u), x[:, :4])
    plans = pp.LQR(car, Q, None, 4)(x)
    for i in range(3):
        for many, one in zip(plans, pp.LQR(car, Q, None, 4)(x[i])):
            close(many[i], one, 1e-10)
    with pytest.raises(ValueError, match="dt: the system steps by 0.1, got 0.2"):
        pp.LQR(car, Q, None, 4)(x, 0.2)


@pytest.mark.parametrize(
    "Q, S, words",
    [
        (torch.eye(3), torch.eye(3), "S: expected fewer inputs than Q has rows, 3, got 3"),
        (torch.eye(3), torch.zeros(1, 2), "S: expected"),
        (torch.zeros(2, 3), torch.eye(1), "Q: expected"),
    ],
)
def test_weights_that_do_not_fit_are_refused(Q, S, words):
    with pytest.raises(ValueError, match=words):
        input_rates(Clockwork(), Q.double(), S.double())
