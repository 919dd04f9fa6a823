"""LQR against the dense quadratic programme, plain rollouts, and itself in other forms."""

import copy
import warnings
from functools import partial

import numpy as np
import pytest
import torch
from oracles import (
    BATCHES,
    Affine,
    Clockwork,
    DenseQP,
    central,
    close,
    draw,
    jacobian,
    matrices,
    rollout,
    total_cost,
    weights,
)
from torch.autograd import gradcheck

import pypose_lite as pp

pytestmark = pytest.mark.usefixtures("float64")
SIZES = [(1, 1, 1), (1, 1, 5), (2, 1, 4), (3, 2, 7), (6, 3, 5), (2, 3, 3)]


def dense(system, Q, p, T, x_init, t=0):
    """The problem of one sample on an LTI (t = 0) or a stacked LTV, as a quadratic programme."""
    stacks = [z for z in (system._A, system._B, system._c1)]
    if isinstance(system, pp.LTV):
        steps = [(t + i) % len(system._A) for i in range(T)]
        A, B, c = (z[steps] for z in stacks)
    else:
        A, B, c = (z.expand(T, *z.shape) for z in stacks)
    Q, p = (z if z.ndim == d + 1 else z.expand(T, *z.shape) for z, d in ((Q, 2), (p, 1)))
    return DenseQP(A, B, c, Q, p, x_init)


def forms(given):
    """The same linear system as LTI, as LTV and as NLS."""
    return [
        pp.LTI(*given),
        pp.LTV(*(z.expand(3, *z.shape) for z in given)),
        Affine(*given),
    ]


# --- P10: the dense quadratic programme


@pytest.mark.parametrize("n, m, T", SIZES)
def test_the_plan_on_a_linear_system_is_the_quadratic_programmes(g, n, m, T):
    """With c1, p, cross terms, and a Q of one step or of each."""
    system, x = pp.LTI(*matrices(g, n, m)), draw(g, n)
    for lead in ((), (T,)):
        Q, p = weights(g, n + m, lead)
        X, U, cost = pp.LQR(system, Q, p, T)(x)
        close(U, dense(system, Q, p, T, x).solve(), 1e-10)
        close(X, rollout(system, x, U))
        close(cost, total_cost(X, U, Q, p), 1e-10)


def test_a_q_that_is_not_symmetric_acts_as_its_symmetric_part(g):
    system, (Q, p), skew = pp.LTI(*matrices(g, 2, 2)), weights(g, 4), draw(g, 4, 4)
    x = draw(g, 2)
    for a, b in zip(pp.LQR(system, Q + skew - skew.mT, p, 4)(x), pp.LQR(system, Q, p, 4)(x)):
        close(a, b)


@pytest.mark.parametrize("t", [0, 2, 7])
def test_the_plan_on_a_changing_linear_system_starts_at_its_clock(g, t):
    system = pp.LTV(*matrices(g, 3, 2, (5,))).reset(t)
    (Q, p), x = weights(g, 5, (6,)), draw(g, 3)
    X, U, cost = pp.LQR(system, Q, p, 6)(x)
    close(U, dense(system, Q, p, 6, x, t).solve(), 1e-10)
    close(X, rollout(system, x, U))
    close(cost, total_cost(X, U, Q, p), 1e-10)
    assert system.systime == t


def test_an_unstable_system_keeps_its_digits(g):
    """One that grows twofold in each step: after 40, an open-loop rollout would have lost 12.

    How a plan begins does not depend on how far away its end is.
    """
    system, (Q, p), x = pp.LTI(*matrices(g, 2, 1, radius=2.0)), weights(g, 3), draw(g, 2)
    near, far = (pp.LQR(system, Q, p, T)(x) for T in (40, 60))
    for a, b in zip(near[:2], far[:2]):
        close(a[:10], b[:10], 1e-9)


def test_p_may_be_left_out(g):
    system, (Q, p), x = pp.LTI(*matrices(g, 2, 1)), weights(g, 3), draw(g, 2)
    for a, b in zip(pp.LQR(system, Q, None, 4)(x), pp.LQR(system, Q, 0 * p, 4)(x)):
        close(a, b, 0)


# --- P11, P12: other forms, and the cost that is reported


def test_the_same_system_in_three_forms_has_the_same_plan_cost_and_gradients(g):
    given, (Q, p), x = matrices(g, 2, 1), weights(g, 3), draw(g, 2)
    weight = draw(g, 5)

    def answers(kind):
        leaves = [z.clone().requires_grad_() for z in (*given[:2], given[4], Q, p, x)]
        A, B, c1, *rest = leaves
        system = forms((A, B, *given[2:4], c1, given[5]))[kind]
        X, U, cost = pp.LQR(system, *rest[:2], 5)(rest[2])
        loss = (X[:5, 0] * weight).sum() + U.square().sum() + 0.1 * cost
        return [X, U, cost, *torch.autograd.grad(loss, leaves)]

    first, *others = (answers(kind) for kind in range(3))
    for other in others:
        for a, b in zip(first, other, strict=True):
            close(a, b, 1e-10)


@pytest.mark.parametrize("t", [0, 4])
@pytest.mark.parametrize("dt", [None, 1, 0.1])
def test_the_reported_cost_is_that_of_rolling_the_inputs_out(g, t, dt):
    (Q, p), x = weights(g, 3), draw(g, 2)
    for system in (Clockwork(), pp.LTV(*matrices(g, 2, 1, (3,)))):
        X, U, cost = pp.LQR(system.reset(t), Q, p, 5)(x, dt, 0.3 * draw(g, 5, 1))
        close(X, rollout(system, x, U))
        close(cost, total_cost(X, U, Q, p))
        assert system.systime == t


def test_around_a_nonlinear_system_the_plan_is_one_gauss_newton_sweep(g):
    """Its gains solve the quadratic programme of the linearisation, at the clock's time."""
    system, (Q, p) = Clockwork().reset(3), weights(g, 3)
    x, u = draw(g, 2), 0.5 * draw(g, 4, 1)
    xs = rollout(system, x, u)
    lin = system.linearize(xs[:-1], u, 3 + torch.arange(4))
    change = DenseQP(
        lin.A,
        lin.B,
        torch.zeros(4, 2),
        Q.expand(4, 3, 3),
        pp.bmv(Q, torch.cat([xs[:-1], u], -1)) + p,
        torch.zeros(2),
    ).solve()
    K, k = pp.LQR(system, Q, p, 4).lqr_backward(x, None, u)
    dx = torch.zeros(2)
    for t in range(4):
        close(K[t] @ dx + k[t], change[t], 1e-11)
        dx = lin.A[t] @ dx + lin.B[t] @ change[t]
    X, U, _ = pp.LQR(system, Q, p, 4)(x, None, u)
    for t in range(4):
        close(U[t], u[t] + k[t] + K[t] @ (X[t] - xs[t]), 1e-11)
    close(X, rollout(system, x, U))


def test_the_gains_of_a_linear_system_act_on_the_state_itself(g):
    system, (Q, p), x = pp.LTI(*matrices(g, 3, 2)), weights(g, 5), draw(g, 3)
    lqr = pp.LQR(system, Q, p, 4)
    X, U, _ = lqr(x)
    K, k = lqr.lqr_backward(x)
    assert K.shape == (4, 2, 3) and k.shape == (4, 2)
    close(U, pp.bmv(K, X[:-1]) + k)
    elsewhere = lqr.lqr_backward(draw(g, 3), None, draw(g, 4, 2))
    close(elsewhere[0], K, 0), close(elsewhere[1], k, 0)


# --- P1, P6: batches and sizes


@pytest.mark.parametrize("kind", ["LTI", "LTV", "NLS"])
@pytest.mark.parametrize("lead", BATCHES, ids=str)
def test_a_batch_of_states_is_planned_as_each_alone(g, kind, lead):
    given, (Q, p) = matrices(g, 2, 1), weights(g, 3)
    system = {"LTI": lambda: pp.LTI(*given), "LTV": lambda: forms(given)[1], "NLS": Clockwork}[
        kind
    ]()
    lqr, x = pp.LQR(system.reset(1), Q, p, 4), draw(g, *lead, 2)
    X, U, cost = lqr(x)
    assert (X.shape, U.shape, cost.shape) == ((*lead, 5, 2), (*lead, 4, 1), lead)
    K, k = lqr.lqr_backward(x)
    assert (K.shape, k.shape) == ((*lead, 4, 1, 2), (*lead, 4, 1))
    for i in np.ndindex(lead):
        for many, one in zip((X, U, cost, K, k), (*lqr(x[i]), *lqr.lqr_backward(x[i]))):
            close(many[i], one)


@pytest.mark.parametrize("lead", [(1,), (3,), (2, 3)], ids=str)
@pytest.mark.parametrize("bounded", [False, True])
@pytest.mark.parametrize("kind", [pp.LTI, pp.LTV])
def test_every_argument_may_have_a_batch_of_its_own(g, kind, lead, bounded):
    T = 4
    given = matrices(g, 2, 1, (*lead, T) if kind is pp.LTV else lead)
    (Q, p), x, u = weights(g, 3, (*lead, T)), draw(g, *lead, 2), draw(g, *lead, T, 1)
    low, high = (-0.2 * draw(g, *lead, T, 1).abs(), 0.3) if bounded else (None, None)
    found = pp.LQR(kind(*given), Q, p, T)(x, 1, u, low, high)
    for i in np.ndindex(lead):
        one = pp.LQR(kind(*(z[i] for z in given)), Q[i], p[i], T)
        alone = one(x[i], 1, u[i], low[i] if bounded else None, high)
        for a, b in zip(found, alone):
            close(a[i], b, 1e-9 if bounded else 1e-12)


def test_arguments_broadcast(g):
    given, T = matrices(g, 2, 1, (3, 1)), 4
    Q, p = weights(g, 3, (2, 1))
    found = pp.LQR(pp.LTI(*given), Q, p[0, 0], T)(draw(g, 2))
    assert [z.shape for z in found] == [(3, 2, 5, 2), (3, 2, 4, 1), (3, 2)]
    steps = weights(g, 3, (T,))[0]
    x = draw(g, 3, 2)
    lqr = pp.LQR(pp.LTI(*(z[:, 0] for z in given)), steps, p[:1].expand(3, 1, 3), T)
    alone = pp.LQR(pp.LTI(*(z[1, 0] for z in given)), steps, p[0, 0], T)
    close(lqr(x)[1][1], alone(x[1])[1])


def test_weights_of_a_batch_and_weights_of_steps_may_stand_side_by_side(g):
    """A Q for each member beside a p for each step of each, as PyPose has them."""
    system, x = pp.LTI(*matrices(g, 2, 1)), draw(g, 2, 2)
    Q, p = weights(g, 3, (2,))[0], draw(g, 2, 5, 3)
    found = pp.LQR(system, Q, p, 5)(x)
    for i in range(2):
        for a, b in zip(found, pp.LQR(system, Q[i], p[i], 5)(x[i])):
            close(a[i], b)


@pytest.mark.parametrize("lead", [(), (1,), (2,)], ids=str)
def test_one_state_and_one_input_are_enough(g, lead):
    system = pp.LTI(*matrices(g, 1, 1, lead))
    x, u, cost = pp.LQR(system, torch.eye(2), None, 3)(torch.ones(1), 1, None, -0.1, 0.1)
    assert (x.shape, u.shape, cost.shape) == ((*lead, 4, 1), (*lead, 3, 1), lead)
    x, u, cost = pp.LQR(system, torch.eye(2), torch.ones(2), 1)(torch.ones(1))
    close(u, -torch.ones(*lead, 1, 1))


def test_float32_stays_float32(g):
    given, (Q, p), x = matrices(g, 3, 2), weights(g, 5), draw(g, 3)
    want = pp.LQR(pp.LTI(*given), Q, p, 6)(x)
    single = pp.LQR(pp.LTI(*(z.float() for z in given)), Q.float(), p.float(), 6)
    for call in (single(x.float()), single(x.float(), 1, None, -5.0, 5.0)):
        assert {z.dtype for z in call} == {torch.float32}
    for a, b in zip(single(x.float()), want):
        torch.testing.assert_close(a.double(), b, rtol=1e-4, atol=1e-4)


# --- P2: gradients


@pytest.mark.parametrize("lead", [(), (2,)], ids=str)
def test_the_plan_has_exact_gradients_in_every_argument(g, lead):
    A, B, C, D, c1, c2 = matrices(g, 2, 1, lead)
    (Q, p), x = weights(g, 3, lead), draw(g, *lead, 2)

    def plan(A, B, c1, Q, p, x):
        Q, p = (z if lead == () else z.unsqueeze(1) for z in (Q, p))
        return pp.LQR(pp.LTI(A, B, C, D, c1, c2), Q, p, 3)(x)

    assert gradcheck(plan, [z.requires_grad_() for z in (A, B, c1, Q, p, x)])


def test_the_plan_on_a_changing_system_has_exact_gradients(g):
    given, (Q, p), x = matrices(g, 2, 1, (3,)), weights(g, 3), draw(g, 2)

    def plan(A, B, c1, Q, x):
        return pp.LQR(pp.LTV(A, B, *given[2:4], c1, given[5]).reset(1), Q, p, 4)(x)

    assert gradcheck(plan, [z.requires_grad_() for z in (*given[:2], given[4], Q, x)])


def test_a_nonlinear_sweep_has_exact_gradients_also_through_its_linearisation(g):
    (Q, p), x, u = weights(g, 3), draw(g, 2, 2), draw(g, 3, 1)
    gain = torch.tensor(1.2)

    def sweep(gain, Q, p, x, u):
        lqr = pp.LQR(Clockwork(gain), Q, p, 3)
        return (*lqr(x, None, u), *lqr.lqr_backward(x, None, u))

    assert gradcheck(sweep, [z.requires_grad_() for z in (gain, Q, p, x, u)])


def test_a_bounded_plan_has_exact_gradients(g):
    given, (Q, p), x = matrices(g, 2, 2), weights(g, 4), 2 * draw(g, 2)
    low, high = -0.4 * draw(g, 4, 2).abs(), torch.tensor([0.2, 0.5])
    leaves = {"x": x, "low": low, "high": high, "A": given[0], "Q": Q, "c1": given[4]}

    def plan(**new):
        z = leaves | new
        system = pp.LTI(z["A"], *given[1:4], z["c1"], given[5])
        return pp.LQR(system, z["Q"], p, 4)(z["x"], 1, None, z["low"], z["high"])[1]

    at = plan()
    clamped = (at == low) | (at == high)
    assert clamped.any() and not clamped.all()
    for name, value in leaves.items():
        J = jacobian(lambda v, name=name: plan(**{name: v}), value)
        close(J, central(lambda v, name=name: plan(**{name: v}), value), 1e-5 * (1 + J.abs().max()))


# --- P16 on a linear system, where the oracle is SciPy


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("n, m, T", [(2, 1, 8), (4, 2, 6), (3, 3, 4)])
def test_the_bounded_plan_is_the_box_constrained_programmes(seed, n, m, T):
    g = torch.Generator().manual_seed(seed)
    system, x = pp.LTI(*matrices(g, n, m, radius=1.1)), 2 * draw(g, n)
    (Q, p), low = weights(g, n + m, (T,)), -0.5 * draw(g, T, m).abs()
    high = low + 0.6 * draw(g, m).abs()
    X, U, cost = pp.LQR(system, Q, p, T)(x, 1, None, low, high)
    close(U, dense(system, Q, p, T, x).solve_within(low, high), 1e-6)
    assert (U >= low).all() and (U <= high).all()
    close(X, rollout(system, x, U))
    close(cost, total_cost(X, U, Q, p), 1e-10)


def test_inputs_move_no_further_than_du_from_where_they_start(g):
    system, (Q, p), x = pp.LTI(*matrices(g, 2, 2)), weights(g, 4), 2 * draw(g, 2)
    start = 0.1 * draw(g, 5, 2)
    lqr = pp.LQR(system, Q, p, 5)
    U = lqr(x, 1, start, du=0.3)[1]
    close(U, dense(system, Q, p, 5, x).solve_within(start - 0.3, start + 0.3), 1e-6)
    both = lqr(x, 1, start, -0.25, 0.25, 0.3)[1]
    low, high = (start - 0.3).clamp(min=-0.25), (start + 0.3).clamp(max=0.25)
    close(both, dense(system, Q, p, 5, x).solve_within(low, high), 1e-6)
    assert both.abs().max() <= 0.25


def test_a_start_outside_the_bounds_is_moved_to_them_first(g):
    system, (Q, p), x = pp.LTI(*matrices(g, 2, 1)), weights(g, 3), draw(g, 2)
    lqr = pp.LQR(system, Q, p, 4)
    far, edge = torch.full((4, 1), 9.0), torch.full((4, 1), 0.5)
    close(lqr(x, 1, far, -0.5, 0.5, 0.2)[1], lqr(x, 1, edge, -0.5, 0.5, 0.2)[1], 0)


def test_on_a_nonlinear_system_sweeps_go_on_until_the_bounds_leave_nothing_better(g):
    (Q, p), x = weights(g, 3), 2 * draw(g, 3, 2)
    system = Clockwork(gain=3.0)
    X, U, cost = pp.LQR(system, Q, p, 5)(x, None, None, -0.5, 0.2)
    plan = pp.MPC(system, Q, p, 5).solve(None, x, u_lower=-0.5, u_upper=0.2)
    assert plan.converged.all() and ((U == -0.5) | (U == 0.2)).any()
    close(U, plan.u, 1e-7)


# --- P3: nothing is left behind


def test_arguments_system_and_controller_stay_as_they_were(g):
    system, (Q, p), x, u = Clockwork().reset(2), weights(g, 3), draw(g, 2), draw(g, 4, 1)
    system.set_refpoint(x, u[0])
    A = system.A
    lqr = pp.LQR(system, Q, p, 4)
    before = copy.deepcopy((lqr.state_dict(), x, u))
    first, second = lqr(x, 1, u, -1.0, 1.0), lqr(x, 1, u, -1.0, 1.0)
    lqr(x, 1, u), lqr.lqr_backward(x, 1, u)
    for a, b in zip(first, second):
        close(a, b, 0)
    close(x, before[1], 0), close(u, before[2], 0), close(system.A, A, 0)
    for name, value in lqr.state_dict().items():
        close(value, before[0][name], 0)


def test_two_controllers_may_share_one_system(g):
    system, (Q, p), x = pp.LTV(*matrices(g, 2, 1, (3,))), weights(g, 3), draw(g, 2)
    short, long = pp.LQR(system, Q, p, 3), pp.LQR(system, Q, p, 7)
    first = short(x)
    long(x), long(x, 1, None, -0.1, 0.1)
    for a, b in zip(short(x), first):
        close(a, b, 0)


def test_after_a_step_of_the_system_plans_start_later(g):
    system, (Q, p), x = pp.LTV(*matrices(g, 2, 1, (5,))), weights(g, 3), draw(g, 2)
    lqr = pp.LQR(system, Q, p, 3)
    first = lqr(x)[1]
    system(x, draw(g, 1))
    later = lqr(x)[1]
    assert (first - later).abs().min() > 1e-3
    close(later, dense(system, Q, p, 3, x, 1).solve(), 1e-10)


# --- P5: modules


def test_weights_are_learned_move_and_are_saved(g):
    given, (Q, p), x = matrices(g, 2, 1), weights(g, 3), draw(g, 2)
    lqr = pp.LQR(
        pp.LTI(*(z.float() for z in given)),
        torch.nn.Parameter(Q.float()),
        torch.nn.Parameter(p.float()),
        3,
    ).double()
    assert {name for name, _ in lqr.named_parameters()} == {"Q", "p"}
    lqr(x)[1].sum().backward()
    assert all(z.grad is not None and z.dtype == torch.float64 for z in lqr.parameters())
    other = pp.LQR(pp.LTI(*matrices(g, 2, 1)), *weights(g, 3), 3)
    other.load_state_dict(lqr.state_dict())
    duplicate = copy.deepcopy(lqr)
    for a, b, c in zip(lqr(x), other(x), duplicate(x)):
        close(a, b, 0), close(a, c, 0)
    assert duplicate.Q is not lqr.Q


# --- P4: what does not fit is named

eye, ones, zeros = (partial(f, dtype=torch.float64) for f in (torch.eye, torch.ones, torch.zeros))


def diag(numbers):
    return torch.tensor(numbers, dtype=torch.float64).diag()


@pytest.mark.parametrize(
    "change, words",
    [
        ({"Q": ones(4, 5)}, "Q: expected (..., k, k), got (4, 5)"),
        ({"Q": eye(4)}, "Q: expected (..., n+m, n+m) with n=2 and m=1, got (4, 4)"),
        ({"Q": None}, "Q: expected a floating-point tensor, got NoneType"),
        ({"Q": eye(3) * torch.nan}, "Q: expected finite numbers, got nan at (0, 0)"),
        (
            {"Q": torch.ones(3, 3, dtype=int)},
            "Q: expected a floating-point tensor, got torch.int64",
        ),
        (
            {"Q": eye(3).float()},
            "Q: expected torch.float64 on cpu like x_init, got torch.flo",
        ),
        ({"Q": eye(3).expand(4, 3, 3)}, "Q: expected (..., T=5, 3, 3), got (4, 3, 3)"),
        (
            {"Q": diag([1, 1, -1.0])},
            "Q: its block of u must be positive definite",
        ),
        ({"Q": diag([-99, 1, 0.1])}, "Q: the cost has no minimum"),
        ({"p": ones(4)}, "p: expected (..., k=3), got (4,)"),
        ({"p": ones(4, 3)}, "p: expected (..., T=5, 3), got (4, 3)"),
        ({"p": ones(3).float()}, "p: expected torch.float64 on cpu like x_init"),
        ({"p": ones(3) / 0}, "p: expected finite numbers, got inf at (0,)"),
        ({"T": 0}, "T: expected a number of steps, at least one, got 0"),
        ({"T": 2.5}, "T: expected a number of steps, at least one, got 2.5"),
        ({"T": "five"}, "T: expected a number of steps, at least one, got 'five'"),
        ({"x": ones(3)}, "x_init: expected (..., n=2), got (3,); n=2 comes from A"),
        ({"x": None}, "x_init: expected a floating-point tensor, got NoneType"),
        ({"x": [1.0, 2.0]}, "x_init: expected a floating-point tensor, got list"),
        ({"x": torch.tensor([1, 2])}, "x_init: expected a floating-point tensor, got torch.int64"),
        ({"x": ones(2).float()}, "x_init: expected torch.float64 on cpu like A"),
        ({"x": diag([torch.nan, 0]).diag()}, "x_init: expected finite numbers, got nan"),
        ({"dt": 0}, "dt: expected a positive time step, got 0"),
        ({"dt": -0.1}, "dt: expected a positive time step, got -0.1"),
        ({"dt": float("nan")}, "dt: expected a positive time step, got nan"),
        ({"dt": float("inf")}, "dt: expected a positive time step, got inf"),
        ({"dt": "fast"}, "dt: expected a positive time step, got 'fast'"),
        ({"u_traj": zeros(4, 1)}, "u_traj: expected (..., T=5, 1), got (4, 1)"),
        ({"u_traj": zeros(5, 2)}, "u_traj: expected (..., T=5, 1), got (5, 2)"),
        (
            {"u_traj": zeros(5, 1).float()},
            "u_traj: expected torch.float64 on cpu like x_init",
        ),
        ({"u_lower": "nonsense"}, "u_lower: expected numbers, got 'nonsense'"),
        ({"u_lower": zeros(2)}, "u_lower: expected (..., T=5, 1), got (2,)"),
        ({"u_lower": zeros(1).float()}, "u_lower: expected torch.float64 on cpu like x_init"),
        ({"u_lower": torch.nan}, "u_lower: expected finite numbers, got nan"),
        ({"u_lower": 1.0, "u_upper": 0.5}, "u_lower: expected no more than u_upper"),
        ({"u_upper": [[1, 2]]}, "u_upper: expected (..., T=5, 1), got (1, 2)"),
        ({"du": 0.0}, "du: expected a positive change"),
        ({"du": torch.nan}, "du: expected finite numbers, got nan"),
        ({"Q": eye(3).expand(2, 1, 3, 3), "x": ones(4, 2)}, "for a batch (4,)"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_an_argument_that_does_not_fit_is_named(g, change, words):
    given = {"x": ones(2), "Q": eye(3), "p": None, "T": 5} | change
    x, Q, p, T = (given.pop(name) for name in ("x", "Q", "p", "T"))
    with pytest.raises(ValueError) as error:
        pp.LQR(pp.LTI(*matrices(g, 2, 1)), Q, p, T)(x, **given)
    assert words in str(error.value)


def test_steps_and_members_are_never_mixed_up(g):
    system, Q = pp.LTI(*matrices(g, 2, 1)), weights(g, 3, (4,))[0]
    with pytest.raises(
        ValueError, match=r"Q: \(4, 3, 3\) may be T=4 steps or a batch \(4,\); give"
    ):
        pp.LQR(system, Q, None, 4)(draw(g, 4, 2))
    x = draw(g, 4, 2)
    steps, members = pp.LQR(system, Q[None], None, 4)(x), pp.LQR(system, Q[:, None], None, 4)(x)
    for i in range(4):
        close(steps[1][i], pp.LQR(system, Q, None, 4)(x[i])[1])
        close(members[1][i], pp.LQR(system, Q[i], None, 4)(x[i])[1])


def test_a_rollout_that_diverges_is_an_error_and_not_a_silent_nan():
    class Explodes(pp.NLS):
        def state_transition(self, state, input):
            return state**3 + input

    for bounds in ({}, {"u_lower": -1.0, "u_upper": 1.0}):
        with pytest.raises(
            ValueError, match=r"x_init: the rollout from it diverges, x\[7\] is not"
        ):
            pp.LQR(Explodes(), torch.eye(2), None, 9)(torch.tensor([2.0]), **bounds)
    with pytest.raises(ValueError, match="diverges, its cost is not finite"):
        pp.LQR(Explodes(), 1e300 * torch.eye(2), None, 5)(torch.tensor([2.0]))


def test_a_time_step_unlike_the_systems_own_is_refused():
    lqr = pp.LQR(pp.DubinsCar(dt=0.1), torch.eye(6), None, 3)
    x = torch.tensor([0, 0, 1.0, 0])
    with pytest.raises(ValueError, match="dt: the system steps by 0.1, got 1"):
        lqr(x, 1)
    close(lqr(x, 0.1)[1], lqr(x)[1], 0)


def test_the_error_says_at_which_step_a_cost_has_no_minimum(g):
    Q = torch.eye(3).repeat(6, 1, 1)
    Q[4, :2, :2] = -99 * torch.eye(2)
    with pytest.raises(ValueError, match="its curvature in u is not > 0 at t=3"):
        pp.LQR(pp.LTI(*matrices(g, 2, 1)), Q, None, 6)(draw(g, 2))


def test_bounds_that_hold_a_plan_without_minimum_give_a_corner(g):
    Q = torch.diag(torch.tensor([-99, -99, 0.1]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        U = pp.LQR(pp.LTI(*matrices(g, 2, 1)), Q, None, 4)(draw(g, 2), 1, None, -1.0, 2.0)[1]
    assert ((U[:-1] == -1) | (U[:-1] == 2)).all()


def test_a_bounded_plan_that_finds_no_end_says_so(g):
    """At rest where the cost is largest: every way down is as good."""
    Q = torch.diag(torch.tensor([-99, -99, 0.1]))
    A, B, C, D, _, _ = matrices(g, 2, 1)
    with pytest.warns(UserWarning, match="the bounded plan has not converged in 200 sweeps"):
        pp.LQR(pp.LTI(A, B, C, D), Q, None, 2)(torch.zeros(2), 1, None, -1.0, 1.0)
