"""Bounds of the MPC: exact, and where they hold a plan nothing better is within them."""

import numpy as np
import pytest
import scipy.optimize
import torch
from oracles import Clockwork, DenseQP, close, draw, matrices, rollout, total_cost, weights

import pypose_lite as pp

pytestmark = pytest.mark.usefixtures("float64")
INF = float("inf")


def slope(system, x, u, Q, p=None, target=None):
    u = u.detach().clone().requires_grad_()
    cost = total_cost(rollout(system, x, u), u, Q, p, target)
    return torch.autograd.grad(cost, u)[0]


def assert_kkt(slope, u, low, high, tol=1e-6):
    """No slope in free inputs, and out of the box in clamped ones."""
    low, high = (torch.as_tensor(z).expand_as(u) for z in (low, high))
    assert (u >= low).all() and (u <= high).all()
    at_low, at_high = u == low, u == high
    free = slope[~at_low & ~at_high]
    assert free.numel() == 0 or free.abs().max() < tol
    assert (slope[at_low & ~at_high] >= -tol).all() and (slope[at_high & ~at_low] <= tol).all()


# --- linear systems: SciPy's box-constrained programme


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("n, m, T", [(2, 1, 10), (3, 3, 5), (4, 2, 7)])
def test_on_a_linear_system_it_is_the_box_constrained_programme(seed, n, m, T):
    """Per input and per time, one side infinite here and there."""
    g = torch.Generator().manual_seed(100 + seed)
    given, (Q, p), x = matrices(g, n, m, radius=1.1), weights(g, n + m, (T,)), 2 * draw(g, n)
    low, high = -0.4 * draw(g, T, m).abs(), 0.4 * draw(g, T, m).abs()
    low[draw(g, T, m) > 1], high[draw(g, T, m) > 1] = -INF, INF
    plan = pp.MPC(pp.LTI(*given), Q, p, T).solve(None, x, u_lower=low, u_upper=high)
    A, B, _, _, c1, _ = (z.expand(T, *z.shape) for z in given)
    programme = DenseQP(A, B, c1, Q, p, x)
    close(plan.u, programme.solve_within(low, high), 1e-6)
    assert plan.converged and plan.iterations <= 15
    assert_kkt((programme.H @ plan.u.flatten() + programme.h).reshape(T, m), plan.u, low, high)


def test_inputs_that_fight_over_a_bound_find_the_right_ones_to_clamp():
    """Strongly coupled inputs: the free solution, clipped, is far from the best in the box."""
    g = torch.Generator().manual_seed(3)
    W = draw(g, 4, 4)
    Q = torch.block_diag(torch.eye(1), W @ W.mT + 0.01 * torch.eye(4))
    p = torch.cat([torch.zeros(1), 3 * draw(g, 4)])
    given = torch.eye(1), torch.ones(1, 4), torch.eye(1), torch.zeros(1, 4)
    plan = pp.MPC(pp.LTI(*given), Q, p, 1).solve(None, torch.ones(1), u_lower=-1.0, u_upper=1.0)
    best = min(
        (float(total_cost(plan.x, u[None], Q, p)), tuple(u.tolist()))
        for u in map(torch.tensor, candidates(Q[1:, 1:].numpy(), p[1:].numpy()))
    )
    assert plan.converged and float(plan.cost) == pytest.approx(best[0], abs=1e-9)
    close(plan.u[0], torch.tensor(best[1]), 1e-7)
    assert (
        plan.u[0].clamp(-1, 1) - torch.linalg.solve(Q[1:, 1:], -p[1:]).clamp(-1, 1)
    ).abs().max() > 0.1


def candidates(H, h):
    """The best point of every face of the box [-1, 1]^m that lies in it."""
    for sides in np.ndindex(*[3] * len(h)):
        at = np.array(sides) - 1.0
        free = at == 0
        u = at.copy()
        if free.any():
            u[free] = np.linalg.solve(H[np.ix_(free, free)], -(h + H @ at)[free])
        if (np.abs(u) <= 1 + 1e-12).all():
            yield u


# --- nonlinear systems: Karush, Kuhn, Tucker, and SciPy


@pytest.mark.parametrize("T", [8, 20])
def test_on_the_infinity_the_bounded_plan_satisfies_kkt_and_equals_scipys(T):
    mpc, w = pp.infinity.controller(T=T), pp.infinity.waypoints()
    low, high = torch.tensor([-0.2, -1.5]), torch.tensor([0.9, 1.5])
    plan = mpc.solve(0.1, w[2], w[4], u_lower=low, u_upper=high)
    at_bound = ((plan.u == low) | (plan.u == high)).sum()
    assert plan.converged and 0 < at_bound < 2 * T
    assert_kkt(slope(mpc.system, w[2], plan.u, mpc.Q, None, w[4]), plan.u, low, high)

    def cost(u):
        u = torch.tensor(u).reshape(T, 2).requires_grad_()
        value = total_cost(rollout(mpc.system, w[2], u), u, mpc.Q, None, w[4])
        return value.item(), torch.autograd.grad(value, u)[0].flatten().numpy()

    box = list(zip(low.tolist() * T, high.tolist() * T))
    found = scipy.optimize.minimize(
        cost, np.zeros(2 * T), jac=True, bounds=box, options={"ftol": 1e-14, "gtol": 1e-9}
    )
    assert plan.cost.item() == pytest.approx(found.fun, rel=1e-6)


@pytest.mark.parametrize("kind", [pp.Pendulum, pp.CartPole])
def test_from_many_starts_bounded_swings_are_minima_found_downhill(g, kind):
    system, n = kind(), kind.sizes["n"]
    Q = torch.diag(torch.tensor([1, 0.1, 1, 0.1][:n] + [0.01]))
    x = 1.5 * draw(g, 40, n)
    plan = pp.MPC(system, Q, None, 20).solve(None, x, u_lower=-3.0, u_upper=2.0)
    rise = plan.history.diff(dim=0) / plan.history[:-1]
    assert plan.converged.all() and rise.max() <= 1e-13
    assert ((plan.u == -3) | (plan.u == 2)).any()
    for i in range(0, 40, 8):
        assert_kkt(slope(system, x[i], plan.u[i], Q), plan.u[i], -3.0, 2.0)


@pytest.mark.parametrize("copies", [1, 16], ids=["few", "many"])
def test_a_bounded_batch_goes_the_way_of_each_alone(copies):
    """Also past models without a minimum, to which solvers of a batch give gains as they please."""
    x = pp.infinity.waypoints()
    target, bounds = x[torch.arange(17) * 5 % 17], {"u_lower": -2.0, "u_upper": 2.0}
    mpc = pp.infinity.controller(T=20)
    plans = mpc.solve(None, x.repeat(copies, 1), target.repeat(copies, 1), **bounds)
    for i in range(0, 17, 2):
        one = mpc.solve(None, x[i], target[i], **bounds)
        assert (plans.iterations[i::17] == one.iterations).all()
        close(plans.history[: len(one.history), i], one.history, 1e-9)
        close(plans.u[i], one.u, 1e-7)


def test_each_member_input_and_time_may_have_its_own_bounds(g):
    Q, p = weights(g, 3)
    mpc, x = pp.MPC(Clockwork(3.0).reset(2), Q, p, 5), 2 * draw(g, 4, 2)
    low, high = -0.3 * draw(g, 4, 5, 1).abs(), 0.3 * draw(g, 4, 5, 1).abs()
    low[1], high[2] = -INF, INF
    plan = mpc.solve(None, x, u_lower=low, u_upper=high)
    assert plan.converged.all()
    for i in range(4):
        assert_kkt(slope(mpc.system, x[i], plan.u[i], Q, p), plan.u[i], low[i], high[i])
        alone = mpc.solve(None, x[i], u_lower=low[i], u_upper=high[i])
        close(plan.u[i], alone.u, 1e-9)


@pytest.mark.parametrize(
    "shape", [None, (), (1,), (5, 1), (1, 5, 1), (3, 1, 1)], ids=lambda shape: str(shape)
)
def test_a_bound_may_be_given_in_many_forms(g, shape):
    Q, p = weights(g, 3)
    bound = 0.3 if shape is None else torch.full(shape, 0.3)
    mpc, x = pp.MPC(Clockwork(3.0), Q, p, 5), 2 * draw(g, 3, 2)
    want = mpc.solve(None, x, u_upper=torch.full((3, 5, 1), 0.3))
    close(mpc.solve(None, x, u_upper=bound).u, want.u, 0)
    assert (want.u == 0.3).any()


# --- what bounds do not do


def test_bounds_that_are_infinite_or_far_change_nothing(g):
    (Q, p), x = weights(g, 3), draw(g, 3, 2)
    mpc = pp.MPC(Clockwork(), Q, p, 5)
    free = mpc.solve(None, x)
    for far in (INF, 1e3):
        plan = mpc.solve(None, x, u_lower=-far, u_upper=far)
        close(plan.u, free.u, 1e-9)
        close(plan.iterations, free.iterations, 0)
    close(mpc.solve(None, x, u_upper=INF).u, free.u, 1e-9)


def test_equal_bounds_leave_no_choice(g):
    (Q, p), x, u = weights(g, 3), draw(g, 2), draw(g, 5, 1)
    plan = pp.MPC(Clockwork(), Q, p, 5).solve(None, x, u_lower=u, u_upper=u)
    close(plan.u, u, 0)
    assert plan.converged


def test_bounds_hold_exactly_after_every_sweep_and_from_a_start_outside():
    w, low, high = pp.infinity.waypoints(), torch.tensor([-0.1, -1.0]), torch.tensor([0.7, 1 / 3])
    start = torch.full((10, 2), 5.0)
    mpc = pp.infinity.controller()
    for k in range(1, 6):
        mpc.stepper = pp.utils.ReduceToBason(steps=k, tol=0)
        u = mpc.solve(0.1, w[0], w[1], start, low, high).u
        assert (u >= low).all() and (u <= high).all()
    assert ((u == low) | (u == high)).any()


def test_a_warm_start_at_the_bounds_needs_few_sweeps():
    mpc, w = pp.infinity.controller(), pp.infinity.waypoints()
    box = {"u_lower": -0.8, "u_upper": 0.8}
    plan = mpc.solve(0.1, w[0], w[1], **box)
    again = mpc.solve(0.1, w[0], w[1], plan.u, **box)
    assert again.iterations <= 1 and again.converged
    close(again.u, plan.u, 1e-9)


def test_bounds_that_cross_are_refused_wherever_they_do():
    mpc, x = pp.infinity.controller(T=3), pp.infinity.waypoints()
    low, high = torch.zeros(3, 2), torch.ones(3, 2)
    low[2, 1] = 1.5
    with pytest.raises(ValueError, match="u_lower: expected no more than u_upper"):
        mpc.solve(0.1, x[0], x[1], u_lower=low, u_upper=high)
