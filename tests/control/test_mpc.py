"""MPC: what comes back is a minimum, it got there downhill, and nothing was left behind."""

import copy

import numpy as np
import pytest
import scipy.optimize
import torch
from oracles import (
    BATCHES,
    Affine,
    Clockwork,
    DenseQP,
    close,
    draw,
    matrices,
    rollout,
    total_cost,
    weights,
)

import pypose_lite as pp
from pypose_lite.control.ilqr import improve, start
from pypose_lite.control.sweep import follow

pytestmark = pytest.mark.usefixtures("float64")


def slope(system, x, u, Q, p=None, target=None):
    """The gradient of one sample's total cost in its inputs, through a plain rollout."""
    u = u.detach().clone().requires_grad_()
    cost = total_cost(rollout(system, x, u), u, Q, p, target)
    return torch.autograd.grad(cost, u)[0]


def swing(g, kind, count):
    """A pendulum or a cart-pole, a cost, and starts from everywhere."""
    if kind is pp.Pendulum:
        return pp.Pendulum(), torch.diag(torch.tensor([1, 0.1, 0.01])), 3 * draw(g, count, 2)
    scale = torch.tensor([1.0, 1.0, 2.0, 2.0])
    return (
        pp.CartPole(),
        torch.diag(torch.tensor([1, 0.1, 1, 0.1, 0.01])),
        scale * draw(g, count, 4),
    )


# --- P14, P15: downhill, to a minimum


@pytest.mark.parametrize("kind", [pp.Pendulum, pp.CartPole])
def test_from_a_hundred_starts_plans_are_finite_and_costs_never_rise(g, kind):
    system, Q, x = swing(g, kind, 100)
    plan = pp.MPC(system, Q, None, 25).solve(None, x)
    assert all(torch.isfinite(z).all() for z in (plan.x, plan.u, plan.cost))
    assert plan.history.shape == (plan.iterations.max() + 1, 100)
    rise = plan.history.diff(dim=0) / plan.history[:-1].abs().clamp(min=1e-9)
    assert rise.max() <= 1e-13
    close(plan.cost, plan.history.min(0).values, 1e-11)
    assert plan.converged.all()
    for i in range(0, 100, 24):
        close(plan.x[i], rollout(system, x[i], plan.u[i]), 1e-9)
        assert slope(system, x[i], plan.u[i], Q).abs().max() < 1e-6


def test_it_finds_at_least_as_good_a_plan_as_scipy(g):
    mpc, x = pp.infinity.controller(T=6), pp.infinity.waypoints()[0]
    target, Q = pp.infinity.waypoints()[2], mpc.Q

    def cost(u):
        u = torch.tensor(u).reshape(6, 2).requires_grad_()
        value = total_cost(rollout(mpc.system, x, u), u, Q, None, target)
        return value.item(), torch.autograd.grad(value, u)[0].flatten().numpy()

    plan = mpc.solve(0.1, x, target)
    found = scipy.optimize.minimize(cost, np.zeros(12), jac=True, tol=1e-12)
    assert plan.cost <= found.fun + 1e-9
    assert cost(plan.u.numpy())[0] == pytest.approx(plan.cost.item(), abs=1e-12)


@pytest.mark.parametrize("constant", [-50.0, 1000.0])
def test_a_constant_added_to_the_cost_changes_nothing(g, constant):
    """A further state that stays 1 carries it, with a linear weight."""

    class Carries(pp.NLS):
        def state_transition(self, state, input):
            return torch.cat([pendulum.state_transition(state[:2], input), state[2:]])

    pendulum = pp.Pendulum()
    Q = torch.diag(torch.tensor([1, 0.1, 0, 0.01]))
    p = torch.tensor([0, 0, constant / 20, 0])
    x = torch.cat([3 * draw(g, 6, 2), torch.ones(6, 1)], -1)
    plain, shifted = (pp.MPC(Carries(), Q, p, 20).solve(None, x) for p in (None, p))
    assert shifted.converged.all()
    close(shifted.u, plain.u, 1e-5)
    close(shifted.cost, plain.cost + constant, 1e-8)


def test_the_cost_never_rises_where_plain_sweeps_raise_it():
    class Winds(pp.NLS):
        def state_transition(self, state, input):
            a, b = state
            return torch.stack([a + torch.sin(6 * b), b + input[0]])

        def observation(self, state, input):
            return state

    Q, x = torch.diag(torch.tensor([1, 0.01, 0.01])), torch.tensor([1, 0.25])
    lqr, u, plain = pp.LQR(Winds(), Q, None, 6), None, []
    for _ in range(8):
        _, u, cost = lqr(x, None, u)
        plain.append(cost)
    assert (torch.stack(plain).diff() > 1).any()
    plan = pp.MPC(Winds(), Q, None, 6).solve(None, x)
    assert (plan.history.diff() <= 1e-13).all() and plan.cost < min(plain)
    assert plan.converged and slope(Winds(), x, plan.u, Q).abs().max() < 1e-6


def test_a_plan_is_followed_by_its_feedback(g):
    mpc, x = pp.MPC(Clockwork().reset(1), torch.eye(3), None, 4), draw(g, 3, 2)
    problem, x_init, U, _ = mpc._state(x, None, draw(g, 3, 4, 1), None, None, None)
    X, K, k = start(problem, x_init, U).X, draw(g, 4, 3, 1, 2), draw(g, 4, 3, 1)
    Xs, Us = follow(problem, x_init, X, U, K, k)
    for t in range(4):
        close(Us[t], U[t] + k[t] + pp.bmv(K[t], Xs[t] - X[t]))
        close(Xs[t + 1], problem.system.transition(Xs[t], Us[t], 1 + t))


def test_steps_to_where_the_system_is_not_defined_do_not_hide_a_shorter_one():
    class Logarithm(pp.NLS):
        def state_transition(self, state, input):
            return state + torch.log(1 + input)

        def observation(self, state, input):
            return state

    Q, x, target = torch.diag(torch.tensor([1, 0.01])), torch.zeros(1), torch.tensor([-3.0])
    plan = pp.MPC(Logarithm(), Q, None, 2).solve(None, x, target)  # u = -3 does not exist
    assert plan.converged and (plan.u > -1).all()
    assert plan.history[1] < plan.history[0]  # by a fifth of the step; the half is not finite


def test_a_target_out_of_reach_is_approached_and_the_plan_converges():
    target = torch.tensor([1e3, 0, 1, 0])
    plan = pp.infinity.controller().solve(0.1, pp.infinity.waypoints()[0], target)
    assert plan.converged and plan.x[-1, 0] > 1


def test_at_the_target_there_is_nothing_to_do():
    x = pp.infinity.waypoints()[3]
    plan = pp.infinity.controller().solve(0.1, x, x)
    assert plan.converged and plan.iterations == 1
    close(plan.u, torch.zeros(10, 2)), close(plan.cost, torch.tensor(0.0))


def test_a_state_where_the_system_has_no_derivative_is_refused():
    """A car without a heading: atan2(0, 0)."""
    mpc = pp.infinity.controller(T=3)
    with pytest.raises(
        ValueError, match=r"state_transition of DubinsCar: its derivative df\[[23]\]"
    ):
        mpc.solve(0.1, torch.zeros(4), pp.infinity.waypoints()[1])


def test_a_cost_without_a_minimum_is_not_said_to_have_converged(g):
    Q = torch.diag(torch.tensor([-9.0, -9.0, 1.0]))
    plan = pp.MPC(pp.LTI(*matrices(g, 2, 1)), Q, None, 3).solve(None, draw(g, 2))
    assert not plan.converged and plan.iterations == 200
    assert torch.isfinite(plan.cost) and plan.cost < plan.history[0]


def test_a_sweep_whose_model_has_no_minimum_changes_nothing(g):
    Q, x = torch.diag(torch.tensor([-9.0, -9.0, 1.0])), draw(g, 20, 2)
    mpc = pp.MPC(pp.LTI(*matrices(g, 2, 1)), Q, None, 3)
    problem, x_init, U, _ = mpc._state(x, None, None, None, None, None)
    at = start(problem, x_init, U)
    new = improve(problem, at, newton=False)
    assert new.promised.isinf().all() and (new.damping > 0).all() and not new.converged.any()
    close(new.U, at.U, 0)


def test_a_plan_leaves_the_saddle_that_it_comes_by():
    """Newton's model has no minimum there, and with Gauss-Newton's 200 sweeps were too few."""
    x = torch.tensor([[-0.6987, 1.0468, 1.0555, 0.4158], [0.2821, -0.8516, 0.3040, -0.8839]])
    mpc, target = pp.infinity.controller(T=50), pp.infinity.waypoints()[[8, 3]]
    plan = mpc.solve(0.1, x, target)
    assert plan.converged.all()
    for i in range(2):
        assert slope(mpc.system, x[i], plan.u[i], mpc.Q, None, target[i]).abs().max() < 1e-6


# --- P10-P12: linear systems, and time


@pytest.mark.parametrize("n, m, T", [(1, 1, 3), (2, 1, 4), (4, 2, 5)])
def test_on_a_linear_system_it_is_the_quadratic_programme(g, n, m, T):
    given, (Q, p), x = matrices(g, n, m), weights(g, n + m, (T,)), draw(g, n)
    target = draw(g, n)
    plan = pp.MPC(pp.LTI(*given), Q, p, T).solve(None, x, target)
    r = torch.cat([target, torch.zeros(m)])
    A, B, _, _, c1, _ = (z.expand(T, *z.shape) for z in given)
    close(plan.u, DenseQP(A, B, c1, Q, p - Q @ r, x).solve(), 1e-10)
    close(plan.cost, total_cost(plan.x, plan.u, Q, p, target), 1e-10)
    assert plan.converged and plan.iterations <= 3


def test_the_same_system_in_three_forms_has_the_same_plan_cost_and_gradients(g):
    given, (Q, p), x, target = matrices(g, 2, 1), weights(g, 3), draw(g, 2), draw(g, 2)

    def answers(make):
        leaves = [z.clone().requires_grad_() for z in (*given[:2], given[4], Q, p, x, target)]
        A, B, c1, *rest = leaves
        system = make(A, B, *given[2:4], c1, given[5])
        X, U, cost = pp.MPC(system, *rest[:2], 5)(None, *rest[2:])
        loss = (X.square().sum(-1) * torch.arange(6)).sum() + U.sum() + 0.1 * cost
        return [X, U, cost, *torch.autograd.grad(loss, leaves)]

    first = answers(pp.LTI)
    for make in (lambda *m: pp.LTV(*(z.expand(2, *z.shape) for z in m)), Affine):
        for a, b in zip(first, answers(make), strict=True):
            close(a, b, 1e-10)


@pytest.mark.parametrize("t", [0, 4])
@pytest.mark.parametrize("dt", [None, 1, 0.1])
def test_on_a_changing_system_the_plan_starts_at_its_clock(g, t, dt):
    (Q, p), x, target = weights(g, 3), draw(g, 2), draw(g, 2)
    for system in (Clockwork(), pp.LTV(*matrices(g, 2, 1, (3,)))):
        plan = pp.MPC(system.reset(t), Q, p, 5).solve(dt, x, target)
        close(plan.x, rollout(system, x, plan.u))
        close(plan.cost, total_cost(plan.x, plan.u, Q, p, target))
        assert plan.converged and slope(system, x, plan.u, Q, p, target).abs().max() < 1e-7
        assert system.systime == t


def test_a_target_may_be_one_for_each_step(g):
    (Q, _), x, targets = weights(g, 3), draw(g, 3, 2), draw(g, 3, 4, 2)
    system, r = Clockwork(), torch.cat([targets, torch.zeros(3, 4, 1)], -1)
    constant = pp.bvmv(r, Q, r).sum(-1) / 2
    plan = pp.MPC(system, Q, None, 4).solve(None, x, targets)
    linear = pp.MPC(system, Q, -pp.bmv(Q, r), 4).solve(None, x)
    close(plan.u, linear.u, 1e-8)
    close(plan.cost, linear.cost + constant, 1e-11)
    same = pp.MPC(system, Q, None, 4).solve(None, x, targets[:, :1])
    close(same.u, pp.MPC(system, Q, None, 4).solve(None, x, targets[:, 0]).u, 0)


# --- P1, P6: batches and sizes


@pytest.mark.parametrize("lead", BATCHES, ids=str)
@pytest.mark.parametrize("bounded", [False, True])
def test_a_batch_of_states_is_planned_as_each_alone(g, lead, bounded):
    Q, p = weights(g, 3)
    mpc, x, target = (
        pp.MPC(Clockwork(2.0).reset(1), Q, p, 4),
        2 * draw(g, *lead, 2),
        draw(g, *lead, 2),
    )
    box = {"u_lower": -0.2, "u_upper": 0.3} if bounded else {}
    many = mpc.solve(None, x, target, **box)
    assert [z.shape for z in many[:5]] == [(*lead, 5, 2), (*lead, 4, 1), lead, lead, lead]
    assert many.history.shape[1:] == lead
    for i in np.ndindex(lead):
        one = mpc.solve(None, x[i], target[i], **box)
        for a, b in zip(many[:3], one[:3]):
            close(a[i], b)
        assert many.converged[i] and many.iterations[i] == one.iterations


@pytest.mark.parametrize("lead", [(1,), (3,), (2, 3)], ids=str)
def test_every_argument_may_have_a_batch_of_its_own(g, lead):
    T, slips = 4, 0.3 * torch.rand(lead, generator=g)
    (Q, p), u = weights(g, 6, (*lead, T)), 0.1 * draw(g, *lead, T, 2)
    x, target = draw(g, *lead, 4), draw(g, *lead, 4)
    low, high = -draw(g, *lead, T, 2).abs(), draw(g, *lead, 1, 2).abs()
    many = pp.MPC(pp.DubinsCar(slip=slips), Q, p, T)(0.1, x, target, u, low, high)
    for i in np.ndindex(lead):
        alone = pp.MPC(pp.DubinsCar(slip=slips[i]), Q[i], p[i], T)
        for a, b in zip(many, alone(0.1, x[i], target[i], u[i], low[i], high[i])):
            close(a[i], b, 1e-8)


@pytest.mark.parametrize("lead", [(2, 3), (1, 3), (1, 1), (0, 3)], ids=str)
def test_arguments_may_have_some_dimensions_of_the_batch(g, lead):
    T, (some, others) = 4, lead
    Q, p = weights(g, 6, (some, 1, T))[0], weights(g, 6, (1, others, T))[1]
    x, target, low = draw(g, *lead, 4), draw(g, others, 4), -draw(g, some, 1, 1, 2).abs()
    many = pp.MPC(pp.DubinsCar(), Q, p, T)(0.1, x, target, None, low)
    assert [z.shape for z in many] == [(*lead, T + 1, 4), (*lead, T, 2), lead]
    for i, j in np.ndindex(lead):
        alone = pp.MPC(pp.DubinsCar(), Q[i, 0], p[0, j], T)(
            0.1, x[i, j], target[j], None, low[i, 0]
        )
        for a, b in zip(many, alone):
            close(a[i, j], b, 1e-8)


@pytest.mark.parametrize("steps", [2, 100])
def test_the_only_member_of_a_batch_is_planned_for_as_if_it_were_alone(g, steps):
    x, target, (Q, p) = draw(g, 4), draw(g, 4), weights(g, 6, ())
    mpc = pp.MPC(pp.DubinsCar(), Q, p, 5, pp.utils.ReduceToBason(steps, tol=0))
    box = {"u_lower": -0.5, "u_upper": 0.5}
    batch = mpc.solve(0.1, x[None], target[None], **box)
    alone = mpc.solve(0.1, x, target, **box)
    assert batch.history.shape == (*alone.history.shape, 1)
    assert (batch.iterations == 2) == (steps == 2)
    for a, b in zip((*batch[:-1], batch.history.mT), alone):
        close(a[0], b, 0)


def test_one_state_and_one_input_are_enough(g):
    class Cubic(pp.NLS):
        def state_transition(self, state, input):
            return state - 0.1 * state**3 + input

    for lead in ((), (1,), (3,)):
        x, u, cost = pp.MPC(Cubic(), torch.eye(2), torch.ones(2), 1)(None, draw(g, *lead, 1))
        close(u, -torch.ones(*lead, 1, 1))
        plan = pp.MPC(Cubic(), torch.eye(2), None, 5).solve(None, 2 * draw(g, *lead, 1))
        assert plan.converged.all() and plan.x.shape == (*lead, 6, 1)


@pytest.mark.parametrize("lead", [(), (3,)], ids=str)
def test_float32_stays_float32_and_converges(lead):
    x, target = (pp.infinity.waypoints()[i].expand(*lead, 4) for i in (0, 1))
    want = pp.infinity.controller().solve(0.1, x, target, u_lower=-1.0, u_upper=1.0)
    mpc = pp.infinity.controller(dtype=torch.float32)
    plan = mpc.solve(0.1, x.float(), target.float(), u_lower=-1.0, u_upper=1.0)
    assert {z.dtype for z in plan[:3]} == {torch.float32} and plan.converged.all()
    close(plan.u.double(), want.u, 1e-3)
    assert plan.u.abs().max() <= 1


# --- warm starts and steppers


def test_a_shifted_plan_drops_its_first_input_and_repeats_its_last(g):
    u = draw(g, 3, 4, 2).requires_grad_()
    later = pp.shift(u)
    close(later[:, :3], u[:, 1:].detach(), 0), close(later[:, 3], u[:, 3].detach(), 0)
    assert not later.requires_grad


def test_a_warm_start_needs_few_sweeps(g):
    mpc, x = pp.infinity.controller(), pp.infinity.waypoints()
    first = mpc.solve(0.1, x[0], x[1])
    again = mpc.solve(0.1, x[0], x[1], first.u)
    assert first.iterations > 2 and again.iterations <= 1 and again.converged
    close(again.u, first.u, 1e-9)
    moved = mpc.solve(0.1, first.x[1], x[1], pp.shift(first.u))
    assert moved.iterations < first.iterations


def test_a_stepper_ends_the_sweeps_and_the_plan_says_that_it_has_not_converged():
    x = pp.infinity.waypoints()
    mpc = pp.MPC(pp.DubinsCar(), torch.eye(6), None, 10, pp.utils.ReduceToBason(steps=2))
    plan = mpc.solve(0.1, x[0], x[3])
    assert not plan.converged and plan.iterations == 2 and len(plan.history) == 3
    full = pp.MPC(pp.DubinsCar(), torch.eye(6), None, 10).solve(0.1, x[0], x[3])
    assert full.converged and full.cost <= plan.cost
    close(full.history[:3], plan.history, 1e-12)


def test_a_stepper_stays_as_it_was_and_may_be_shared():
    x, stepper = pp.infinity.waypoints(), pp.utils.ReduceToBason(steps=3, patience=1)
    stepper.step(5.0)
    before = copy.deepcopy(vars(stepper))
    one, two = (pp.MPC(pp.DubinsCar(), torch.eye(6), None, T, stepper) for T in (5, 8))
    first = one.solve(0.1, x[0], x[1])
    two.solve(0.1, x[0], x[1])
    close(one.solve(0.1, x[0], x[1]).history, first.history, 0)
    assert vars(stepper) == before and one.stepper is two.stepper is stepper


def test_a_stepper_hears_what_a_sweep_hoped_to_gain():
    heard = []

    class Listens(pp.utils.ReduceToBason):
        def step(self, loss):
            heard.append(float(loss))
            super().step(loss)

    x = pp.infinity.waypoints()
    mpc = pp.MPC(pp.DubinsCar(), torch.eye(6), None, 10, Listens(steps=50, tol=1e-4))
    plan = mpc.solve(0.1, x[0], x[1])
    assert heard[0] > 1e-4 > heard[-1] >= 0 and len(heard) == plan.iterations
    assert (plan.history[-1] - plan.history[-2]).abs() <= 2 * heard[-1] + 1e-12


def test_du_limits_how_far_one_sweep_moves_and_not_where_sweeps_end():
    x, start = pp.infinity.waypoints(), torch.full((10, 2), 0.05)
    mpc = pp.infinity.controller()
    free = mpc.solve(0.1, x[0], x[1])
    before, moved = start, []
    for k in range(1, 5):
        some = pp.MPC(mpc.system, mpc.Q, None, 10, pp.utils.ReduceToBason(steps=k, tol=0))
        now = some.solve(0.1, x[0], x[1], start, du=0.4).u
        moved.append((now - before).abs().max().item())
        before = now
    assert max(moved) <= 0.4 + 1e-12 and moved[0] == pytest.approx(0.4)
    slow = mpc.solve(0.1, x[0], x[1], start, du=torch.tensor([0.4, 0.2]))
    close(slow.u, free.u, 1e-7)
    assert slow.converged and slow.iterations > free.iterations


# --- P3, P5: nothing is left behind; modules


def test_arguments_system_and_controller_stay_as_they_were(g):
    system, (Q, p) = Clockwork().reset(2), weights(g, 3)
    x, target, u = draw(g, 2), draw(g, 2), 0.1 * draw(g, 4, 1)
    mpc = pp.MPC(system, Q, p, 4)
    before = copy.deepcopy((mpc.state_dict(), x, target, u))
    first, second = (mpc.solve(None, x, target, u, -0.3, 0.3) for _ in range(2))
    for a, b in zip(first, second):
        close(a, b, 0)
    for now, then in zip((x, target, u), before[1:]):
        close(now, then, 0)
    for name, value in mpc.state_dict().items():
        close(value, before[0][name], 0)


def test_two_controllers_may_share_one_system(g):
    system, (Q, p), x = Clockwork(), weights(g, 3), draw(g, 2)
    short, long = pp.MPC(system, Q, p, 3), pp.MPC(system, 2 * Q, None, 6)
    first = short(None, x)
    long(None, x)
    for a, b in zip(short(None, x), first):
        close(a, b, 0)


def test_weights_are_learned_move_and_are_saved_and_copies_work_after_a_backward(g):
    (Q, p), x = weights(g, 6), pp.infinity.waypoints()
    slip = torch.nn.Parameter(torch.tensor(0.1).float())
    given = (torch.nn.Parameter(z.float()) for z in (Q, p))
    mpc = pp.MPC(pp.DubinsCar(slip=slip), *given, 4).double()
    assert {name for name, _ in mpc.named_parameters()} == {"Q", "p", "system.slip"}
    mpc(0.1, x[0], x[1])[1].sum().backward()
    assert all(z.grad is not None and z.dtype == torch.float64 for z in mpc.parameters())
    duplicate = copy.deepcopy(mpc)
    other = pp.MPC(pp.DubinsCar(slip=torch.nn.Parameter(torch.tensor(0.0))), Q, p, 4)
    other.load_state_dict(mpc.state_dict())
    for a, b, c in zip(mpc(0.1, x[0], x[1]), duplicate(0.1, x[0], x[1]), other(0.1, x[0], x[1])):
        close(a, b, 0), close(a, c, 0)
    assert duplicate.Q is not mpc.Q


# --- P4: what does not fit is named (what LQR takes as well is tested there)


@pytest.mark.parametrize(
    "change, words",
    [
        ({"target": (3,)}, "target: expected (..., n=4), got (3,)"),
        ({"target": ()}, "target: expected (..., n=4), got ()"),
        ({"target": (7, 4)}, "target: expected a state or T=5 of them, got (7, 4)"),
        (
            {"target": (3, 4), "x_init": (2, 4)},
            "target: its batch (3,) does not broadcast with (2,)",
        ),
        ({"target": (3, 5, 4), "x_init": (2, 4)}, "target: its batch (3,) does not broadcast"),
        ({"x_init": (3,)}, "x_init: expected (..., n=4), got (3,)"),
        ({"u_init": (4, 2)}, "u_init: expected (..., T=5, 2), got (4, 2)"),
        (
            {"u_init": (3, 5, 2), "x_init": (2, 4)},
            "u_init: expected (..., T=5, 2) for a batch (2,)",
        ),
        ({"u_lower": (3,)}, "u_lower: expected (..., T=5, 2), got (3,)"),
        ({"u_upper": (4, 2)}, "u_upper: expected (..., T=5, 2), got (4, 2)"),
        ({"du": (1,)}, "du: expected (..., T=5, 2), got (1,)"),
        ({"du": (2,)}, "du: expected a positive change"),
    ],
    ids=str,
)
def test_a_shape_that_does_not_fit_is_named(change, words):
    given = {"x_init": (4,), "target": (4,)} | change
    mpc = pp.MPC(pp.DubinsCar(), torch.eye(6), None, 5)
    with pytest.raises(ValueError) as error:
        mpc.solve(0.1, **{name: torch.zeros(shape) for name, shape in given.items()})
    assert words in str(error.value)


@pytest.mark.parametrize("name", ["x_init", "target", "u_init", "u_lower", "u_upper", "du"])
@pytest.mark.parametrize(
    "spoil, words",
    [
        (lambda z: z.float(), "expected torch.float64 on cpu"),
        (lambda z: z.long(), "expected a floating-point tensor, got torch.int64"),
        (lambda z: z * torch.nan, "expected finite numbers, got nan"),
        (lambda z: "nonsense", "expected"),
    ],
    ids=["float32", "int64", "nan", "str"],
)
def test_an_argument_of_the_wrong_kind_is_named(name, spoil, words):
    given = {"x_init": (4,), "target": (4,), name: (4,) if name in ("x_init", "target") else (5, 2)}
    given = {k: torch.ones(shape) for k, shape in given.items()}
    given[name] = spoil(given[name])
    if name == "x_init" and words.startswith("expected torch"):
        name, words = "Q", "like x_init"  # the state says what the others should be
    with pytest.raises(ValueError, match=f"{name}: .*{words}"):
        pp.MPC(pp.DubinsCar(), torch.eye(6), None, 5).solve(0.1, **given)


def test_an_argument_on_another_device_is_named():
    mpc, x = pp.infinity.controller(), pp.infinity.waypoints()
    with pytest.raises(
        ValueError, match="target: expected torch.float64 on cpu like x_init, got .* m"
    ):
        mpc(0.1, x[0], x[1].to("meta"))
    mpc.Q = mpc.Q.to("meta")
    with pytest.raises(
        ValueError, match="Q: expected torch.float64 on cpu like x_init, got .* meta"
    ):
        mpc(0.1, x[0], x[1])


def test_swapped_arguments_are_named():
    with pytest.raises(ValueError, match="x_init: expected a floating-point tensor, got float"):
        pp.infinity.controller()(pp.infinity.waypoints()[0], 0.1)


def test_a_time_step_unlike_the_systems_own_is_refused():
    x = pp.infinity.waypoints()
    with pytest.raises(ValueError, match="dt: the system steps by 0.1, got 0.2"):
        pp.infinity.controller()(0.2, x[0], x[1])


def test_a_rollout_that_diverges_is_an_error(g):
    class Explodes(pp.NLS):
        def state_transition(self, state, input):
            return state**3 + input

    mpc = pp.MPC(Explodes(), torch.eye(2), None, 9)
    with pytest.raises(ValueError, match=r"the rollout from it diverges, x\[7\] is not finite"):
        mpc(None, torch.tensor([2.0]))
    plan = mpc.solve(None, torch.tensor([2.0]), u_init=torch.tensor([-8.0] + [0.0] * 8)[:, None])
    assert plan.converged and torch.isfinite(plan.cost)
