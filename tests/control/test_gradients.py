"""The plan's gradients against central differences of converged plans, and the closed loop's."""

import warnings

import pytest
import torch
from oracles import Clockwork, close, draw, jacobian, matrices, weights
from torch.autograd import gradcheck

import pypose_lite as pp
from pypose_lite import infinity

pytestmark = pytest.mark.usefixtures("float64")


def assert_gradient(plan, leaves, tol=1e-5, step=1e-5):
    """The gradient in each leaf of a random sum of what ``plan`` returns is that of differences.

    Along three random directions, to ``tol`` of the gradient's length.
    """
    g = torch.Generator().manual_seed(9)
    weight = draw(g, *plan(**leaves).shape)
    for name, value in leaves.items():

        def loss(v, name=name):
            return (weight * plan(**(leaves | {name: v}))).sum()

        v = value.clone().requires_grad_()
        (gradient,) = torch.autograd.grad(loss(v), v)
        assert gradient.norm() > 1e-4, name
        for _ in range(3):
            way = draw(g, *value.shape)
            way = way / way.norm()
            want = (loss(value + step * way) - loss(value - step * way)) / (2 * step)
            assert abs((gradient * way).sum() - want) < tol * gradient.norm(), name


def both(plan):
    """States and inputs side by side, as one vector for each member."""
    return torch.cat([plan[0].flatten(-2), plan[1].flatten(-2)], -1)


# --- P17


def test_a_plan_follows_its_start_target_weights_and_parameters_exactly():
    """The infinity's MPC, with cross terms and a linear cost; a Gauss-Newton step is far off."""
    g = torch.Generator().manual_seed(1)
    w = infinity.waypoints()
    Q, p = weights(g, 6)

    def plan(x, target, Q, p, slip):
        return both(pp.MPC(pp.DubinsCar(slip=slip), Q, p, 5)(0.1, x, target))

    leaves = {"x": w[0], "target": w[2], "Q": Q, "p": 0.1 * p, "slip": torch.tensor(0.1)}
    assert_gradient(plan, leaves)


def test_a_clamped_plan_follows_its_bounds_and_what_is_left_free():
    g = torch.Generator().manual_seed(2)
    w, Q = infinity.waypoints(), infinity.controller().Q
    low, high = torch.tensor([0.1, 0.3]), 1.5 + torch.rand(6, 2, generator=g)

    def plan(x, target, low, high, Q, slip):
        mpc = pp.MPC(pp.DubinsCar(slip=slip), Q, None, 6)
        return both(mpc(0.1, x, target, None, low, high))

    leaves = {"x": w[0], "target": w[1], "low": low, "high": high, "Q": Q}
    leaves |= {"slip": torch.tensor(0.1)}
    u = plan(**leaves)[-12:].reshape(6, 2)
    assert (u == low).any() and (u == high).any() and ((u > low) & (u < high)).sum() > 4
    assert_gradient(plan, leaves)


def test_a_clamped_input_moves_with_its_bound_and_with_nothing_else():
    w, mpc = infinity.waypoints(), infinity.controller(T=6)
    x = w[0].clone().requires_grad_()
    high = torch.tensor([2.0, 1.5]).expand(6, 2).clone().requires_grad_()
    u = mpc(0.1, x, w[1], None, -9.0, high)[1]
    clamped = u == high
    t, i = clamped.nonzero()[0].tolist()
    dx, dhigh = torch.autograd.grad(u[t, i], (x, high), retain_graph=True)
    close(dx, torch.zeros(4), 0)
    want = torch.zeros(6, 2)
    want[t, i] = 1
    close(dhigh, want, 0)
    t, i = (~clamped).nonzero()[0].tolist()
    dx, dhigh = torch.autograd.grad(u[t, i], (x, high))
    assert dx.abs().max() > 0.01
    assert (dhigh[~clamped] == 0).all() and (dhigh[clamped] != 0).any()


@pytest.mark.parametrize("bounded", [False, True])
def test_every_member_of_a_batch_has_its_own_exact_gradient(g, bounded):
    """Also of parameters that the members share, and never of another member's."""
    Q, p = weights(g, 3)
    x, target, gain = draw(g, 3, 2), draw(g, 3, 2), torch.tensor(1.5)
    own = {"x": x, "target": target}
    if bounded:
        own["low"] = -0.4 - 0.4 * torch.rand(3, 4, 1, generator=g)

    def plan(x, target, Q, p, gain, low=None):
        mpc = pp.MPC(Clockwork(gain).reset(2), Q, p, 4)
        return both(mpc(None, x, target, None, low, 0.5 if bounded else None))

    leaves = own | {"Q": Q, "p": 0.3 * p, "gain": gain}
    if bounded:
        u = plan(**leaves)[:, -4:, None]
        assert (u == own["low"]).any() and (u == 0.5).any() and ((u > own["low"]) & (u < 0.5)).any()
    assert_gradient(plan, leaves)
    J = jacobian(lambda x: plan(**(leaves | {"x": x})), x)
    for i in range(3):
        alone = leaves | {name: z[i] for name, z in own.items()}
        J_i = jacobian(lambda x, alone=alone: plan(**(alone | {"x": x})), x[i])
        for j in range(3):
            close(J[i, :, j], J_i if i == j else torch.zeros_like(J_i), 1e-7)


@pytest.mark.parametrize("kind", [pp.LTI, pp.LTV])
def test_matrices_of_a_linear_system_have_exact_gradients(g, kind):
    T, given = 3, matrices(g, 2, 1, (3,) if kind is pp.LTV else ())
    (Q, p), x = weights(g, 3), 2 * draw(g, 2)

    def plan(A, B, c1):
        system = kind(A, B, *given[2:4], c1, given[5]).reset(1)
        return both(pp.MPC(system, Q, p, T)(None, x, None, None, -0.3, 0.6))

    assert_gradient(plan, {"A": given[0], "B": given[1], "c1": given[4]})


@pytest.mark.parametrize("kind", [pp.Pendulum, pp.CartPole])
def test_parameters_of_the_swings_have_exact_gradients(g, kind):
    """Where Gauss-Newton's step misses by a fifth."""
    n = kind.sizes["n"]
    Q, x = torch.diag(torch.tensor([1, 0.1, 1, 0.1][:n] + [0.01])), 0.8 * draw(g, n)

    def plan(length, gravity):
        return both(pp.MPC(kind(length=length, gravity=gravity), Q, None, 12)(None, x))

    assert_gradient(plan, {"length": torch.tensor(0.6), "gravity": torch.tensor(9.0)})


def test_gradcheck_passes_through_a_bounded_plan_and_its_cost(g):
    (Q, p), x, target = weights(g, 2), 2 * draw(g, 2, 1), draw(g, 1)
    high = torch.tensor([0.3])

    class Bends(pp.NLS):
        vectorized = True

        def state_transition(self, state, input):
            return state + 0.3 * state.sin() + input * (1 + 0.2 * state.cos())

    def plan(x, target, Q, p, high):
        return pp.MPC(Bends(), Q, p, 3)(None, x, target, None, None, high)

    leaves = [z.requires_grad_() for z in (x, target, Q, p, high)]
    assert gradcheck(plan, leaves, rtol=1e-5, atol=1e-6)


def test_the_cost_has_the_envelopes_gradient_in_one_more_way(g):
    """d cost / d theta at fixed u: what moves u does not move a minimum to first order."""
    (Q, p), x, gain = weights(g, 3), draw(g, 2), torch.tensor(1.4, requires_grad=True)
    mpc = pp.MPC(Clockwork(gain), Q, p, 4)
    X, U, cost = mpc(None, x)
    U, system = U.detach(), Clockwork(gain)
    states = [x]
    for u in U[:-1]:
        states.append(system(states[-1], u)[0])
    z = torch.cat([torch.stack(states), U], -1)
    fixed = (pp.bvmv(z, Q, z) / 2 + z @ p).sum()
    close(torch.autograd.grad(cost, gain)[0], torch.autograd.grad(fixed, gain)[0], 1e-7)


# --- what a gradient costs, and when it cannot be had


def test_no_graph_is_made_where_nothing_wants_one(g):
    mpc, w = infinity.controller(T=3), infinity.waypoints()
    assert not any(z.requires_grad for z in mpc(0.1, w[0], w[1]))
    with torch.no_grad():
        x = w[0].clone().requires_grad_()
        assert not any(z.requires_grad for z in mpc(0.1, x, w[1]))
    assert all(z.requires_grad for z in mpc(0.1, w[0].clone().requires_grad_(), w[1])[:2])


def test_the_graph_does_not_grow_with_the_number_of_sweeps():
    w = infinity.waypoints()
    x = w[0].clone().requires_grad_()

    def nodes(start):
        mpc = infinity.controller(T=5)
        plan = mpc.solve(0.1, x, w[1], start)
        seen, todo = set(), [plan.u.grad_fn]
        while todo:
            node = todo.pop()
            if node is not None and node not in seen:
                seen.add(node)
                todo += [n for n, _ in node.next_functions]
        return len(seen), int(plan.iterations)

    (cold, many), (warm, few) = nodes(None), nodes(infinity.controller(T=5)(0.1, w[0], w[1])[1])
    assert many > few and cold == warm


def test_the_start_of_the_sweeps_has_no_gradient(g):
    w, u = infinity.waypoints(), 0.1 * draw(g, 5, 2)
    x, u = w[0].clone().requires_grad_(), u.requires_grad_()
    plan = infinity.controller(T=5)(0.1, x, w[1], u)
    dx, du = torch.autograd.grad(plan[1].sum(), (x, u), allow_unused=True)
    assert du is None and dx.abs().max() > 0


def test_a_plan_that_has_not_converged_says_that_its_gradient_is_not_exact():
    w = infinity.waypoints()
    mpc = pp.MPC(pp.DubinsCar(), torch.eye(6), None, 10, pp.utils.ReduceToBason(steps=1))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mpc(0.1, w[:2], w[2:4])
    with pytest.warns(
        UserWarning, match="2 plans have not converged: their gradients are not exact"
    ):
        mpc(0.1, w[:2].clone().requires_grad_(), w[2:4])


def test_rounding_alone_does_not_look_like_a_plan_that_has_not_converged():
    """Nor where a slope is the difference of two numbers that nearly vanish themselves."""
    torch.set_default_dtype(torch.float32)
    torch.manual_seed(0)
    A, B, c = torch.eye(3) + 0.1 * torch.randn(3, 3), torch.randn(3, 3), torch.zeros(3)
    lti = pp.LTI(A, B, torch.eye(3), 0 * A, c, c)
    mpc = pp.MPC(lti, torch.eye(6), torch.randn(6), 5, pp.utils.ReduceToBason(steps=1))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plan = mpc.solve(1, torch.randn(4096, 3, requires_grad=True))
    assert not plan.converged.any()


def test_only_the_members_whose_gradient_is_wrong_are_counted():
    """A plan that rests at its target, or wholly at its bounds, needs no more sweeps."""
    w, once = infinity.waypoints(), pp.utils.ReduceToBason(steps=1)
    mpc = pp.MPC(pp.DubinsCar(), torch.eye(6), None, 3, once)
    x = w[[0, 0]].clone().requires_grad_()
    with pytest.warns(UserWarning, match="^1 plans have not converged"):
        plan = mpc.solve(0.1, x, w[[0, 1]])
    assert not plan.converged[1]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mpc(0.1, x[:1], w[:1])
        plan = mpc.solve(0.1, x, w[[1, 1]], None, 0.0, torch.tensor([1e-3, 0.0]))
    assert (plan.u[:, 0] == torch.tensor([1e-3, 0.0])).all()


def test_a_plan_that_is_no_minimum_has_no_gradient():
    """A car that has to turn by 180 degrees rests between left and right."""
    w = infinity.waypoints()
    x = w[0].clone().requires_grad_()
    u = infinity.controller()(0.1, x, w[4])[1]
    with pytest.raises(RuntimeError, match="the plan is no strict minimum of its cost"):
        u.sum().backward()


# --- the closed loop


def test_ten_steps_of_the_closed_loop_have_exact_gradients():
    """From the start, the controller's weights, and the slip of the car that moves."""
    Q = infinity.controller().Q

    def lap(x, q, slip):
        mpc = pp.MPC(pp.DubinsCar(), torch.diag(q), None, 4)
        return infinity.drive(mpc, infinity.SimulatedCar(pp.DubinsCar(slip=slip), x), steps=10).x

    x = infinity.waypoints()[:2] + torch.tensor([0.03, -0.02, 0.01, 0.02])
    leaves = [x, Q.diagonal().clone(), torch.tensor(0.1)]
    assert gradcheck(
        lap, [z.requires_grad_() for z in leaves], rtol=1e-5, atol=1e-6, fast_mode=True
    )


def test_ten_bounded_steps_that_learn_the_model_in_the_controller_have_exact_gradients():
    def lap(slip, high):
        mpc = pp.MPC(pp.DubinsCar(slip=slip), infinity.controller().Q, None, 4)

        def within(dt, x, target):
            return mpc(dt, x, target, None, -high, high)

        return infinity.drive(within, steps=10).x[-1]

    leaves = {"slip": torch.tensor(0.2), "high": torch.tensor([2.0, 2.5])}
    assert_gradient(lap, leaves)
