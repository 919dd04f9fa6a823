"""A cost of the last state, and references: each stated once more, as a longer plan or by hand."""

import pytest
import torch
from oracles import BATCHES, Clockwork, DenseQP, central, close, draw, matrices, total_cost, weights
from scipy.optimize import minimize

import pypose_lite as pp

pytestmark = pytest.mark.usefixtures("float64")


def last_cost(x, Qf, pf, target=None):
    off = x[-1] if target is None else x[-1] - target
    return off @ Qf @ off / 2 + pf @ x[-1]


def dense(A, B, c, Q, p, Qf, pf, x):
    """The plan by a dense solve: one step more, whose input does nothing and whose state costs."""
    T, n, m = B.shape
    S = torch.block_diag((Qf + Qf.mT) / 2, torch.eye(m))
    qp = DenseQP(
        *(torch.cat([z, torch.zeros_like(z[:1])]) for z in (A, B, c)),
        torch.cat([Q, S[None]]),
        torch.cat([p, torch.cat([pf, torch.zeros(m)])[None]]),
        x,
    )
    return qp


@pytest.mark.parametrize("n, m, T", [(1, 1, 1), (2, 1, 4), (4, 2, 5)])
@pytest.mark.parametrize("bounded", [False, True])
def test_a_linear_plan_is_the_quadratic_programme_with_one_step_more(g, n, m, T, bounded):
    A, B, C, D, c, _ = matrices(g, n, m)
    Q, p = weights(g, n + m, (T,))
    Qf, pf = weights(g, n)
    Qf = 3 * Qf + 0.2 * draw(g, n, n)  # not symmetric: its symmetric part counts
    x = draw(g, n)
    qp = dense(*(z.expand(T, *z.shape) for z in (A, B, c)), Q, p, Qf, pf, x)
    bounds = {"u_lower": -0.3, "u_upper": 0.4} if bounded else {}
    box = (torch.full((T + 1, m), -0.3), torch.full((T + 1, m), 0.4))
    want = (qp.solve_within(*box) if bounded else qp.solve())[:T]
    system = pp.LTI(A, B, C, D, c)
    for plan in (
        pp.LQR(system, Q, p, T, Qf, pf)(x, **bounds),
        pp.MPC(system, Q, p, T, Qf=Qf, pf=pf)(None, x, **bounds),
    ):
        close(plan[1], want, 1e-6 if bounded else 1e-10)
        close(plan[2], total_cost(plan[0], plan[1], Q, p) + last_cost(plan[0], Qf, pf))


def test_a_nonlinear_plan_costs_what_scipys_does(g):
    system, x, target = Clockwork().reset(2), draw(g, 2), draw(g, 2)
    Q, Qf, pf = torch.diag(torch.tensor([1, 0.5, 0.1])), 5 * torch.eye(2), 0.3 * draw(g, 2)
    plan = pp.MPC(system, Q, None, 6, Qf=Qf, pf=pf).solve(None, x, target)

    def price(u):
        u = torch.tensor(u)[:, None]
        xs = [x]
        for t in range(6):
            xs.append(system.transition(xs[-1], u[t], 2 + t))
        xs = torch.stack(xs)
        cost = total_cost(xs, u, Q, None, target) + last_cost(xs, Qf, pf, target)
        return float(cost)

    found = minimize(price, torch.zeros(6).numpy(), method="BFGS", options={"gtol": 1e-7})
    assert plan.converged
    close(plan.cost, torch.tensor(found.fun), 1e-8)
    close(plan.u[:, 0], torch.tensor(found.x), 1e-3)


@pytest.mark.parametrize("kind", ["LQR", "MPC", "bounded LQR", "bounded MPC"])
def test_gradients_with_respect_to_the_last_cost_are_differences(g, kind):
    x, bounds = draw(g, 2), {"u_lower": -0.4, "u_upper": 0.4} if "bounded" in kind else {}
    Q, weigh = weights(g, 3)[0], draw(g, 5)

    def run(theta):
        Qf, pf, target = theta[:4].reshape(2, 2), theta[4:6], theta[6:]
        Qf = Qf @ Qf.mT
        if "LQR" in kind:
            return pp.LQR(Clockwork(), Q, None, 5, Qf, pf)(x, target=target, **bounds)
        return pp.MPC(Clockwork(), Q, None, 5, Qf=Qf, pf=pf)(None, x, target, **bounds)

    def value(theta):
        _, u, cost = run(theta)
        return weigh @ u[:, 0] + cost

    theta = draw(g, 8).requires_grad_()
    (slope,) = torch.autograd.grad(value(theta), theta)
    close(slope, central(value, theta.detach(), 1e-5), 1e-6)
    assert (slope[:6].abs() > 1e-6).all()


@pytest.mark.parametrize("lead", BATCHES[1:], ids=str)
def test_a_batch_is_the_stack_of_single_plans(g, lead):
    x, target = draw(g, *lead, 2), draw(g, *lead, 2)
    Q, (Qf, pf) = weights(g, 3)[0], weights(g, 2, lead)
    many = pp.MPC(Clockwork(), Q, None, 4, Qf=Qf, pf=pf).solve(None, x, target)
    flat = zip(*(z.reshape(-1, *z.shape[len(lead) :]) for z in (x, target, Qf, pf)))
    for i, (x, target, Qf, pf) in enumerate(flat):
        one = pp.MPC(Clockwork(), Q, None, 4, Qf=Qf, pf=pf).solve(None, x, target)
        for name, core in (("x", 2), ("u", 2), ("cost", 0)):
            z = getattr(many, name)
            close(z.reshape(-1, *z.shape[z.ndim - core :])[i], getattr(one, name), 1e-9)


def test_a_target_for_each_state_may_count_the_last_one(g):
    targets, x = draw(g, 5, 2), draw(g, 2)
    Q, Qf = weights(g, 3)[0], 4 * torch.eye(2)
    mpc = pp.MPC(Clockwork(), Q, None, 4, Qf=Qf)
    plan = mpc.solve(None, x, targets)
    far = mpc.solve(None, x, torch.cat([targets[:4], targets[4:] + 1]))
    assert (far.u - plan.u).abs().max() > 1e-3
    same = mpc.solve(None, x, targets[:4])  # the last state then has the last of them
    close(same.u, mpc.solve(None, x, torch.cat([targets[:4], targets[3:4]])).u, 0)


def test_inputs_have_a_reference_of_their_own(g):
    """To stay where it is, a leaking tank needs an input: with it as reference, staying is free."""
    tank = pp.LTI(0.9 * torch.eye(1), torch.eye(1), torch.eye(1), torch.zeros(1, 1))
    x, hover = torch.tensor([2.0]), torch.tensor([0.2])
    Q = torch.eye(2)
    for plan in (
        pp.LQR(tank, Q, None, 5)(x, target=x, u_target=hover),
        pp.MPC(tank, Q, None, 5)(None, x, x, u_target=hover),
        pp.MPC(tank, Q, None, 5)(None, x, x, u_target=hover.expand(5, 1)),
    ):
        close(plan[0], x.expand(6, 1))
        close(plan[1], hover.expand(5, 1))
        close(plan[2], torch.zeros(()))
    assert pp.MPC(tank, Q, None, 5)(None, x, x)[2] > 0.01


def test_a_target_for_lqr_is_a_linear_weight(g):
    A, B, C, D, c, _ = matrices(g, 3, 2)
    Q, x, target, u_target = weights(g, 5)[0], draw(g, 3), draw(g, 3), draw(g, 2)
    r = torch.cat([target, u_target])
    aimed = pp.LQR(pp.LTI(A, B, C, D, c), Q, None, 4)(x, target=target, u_target=u_target)
    plain = pp.LQR(pp.LTI(A, B, C, D, c), Q, -Q @ r, 4)(x)
    close(aimed[1], plain[1], 1e-11)
    close(aimed[2], plain[2] + 4 * r @ Q @ r / 2, 1e-11)


def test_with_the_endless_horizons_cost_a_short_plan_is_the_endless_one(g):
    """What a terminal cost is for."""
    A, B, C, D, *_ = matrices(g, 3, 1, radius=1.3)
    Q, R, x = weights(g, 3)[0], torch.eye(1), draw(g, 3)
    K, P = pp.dlqr(A, B, Q, R)
    for T in (1, 4):
        xs, us, cost = pp.LQR(pp.LTI(A, B, C, D), torch.block_diag(Q, R), None, T, P)(x)
        close(us, -(xs[:-1] @ K.mT), 1e-11)
        close(cost, x @ P @ x / 2, 1e-10)


@pytest.mark.parametrize(
    "given, words",
    [
        ({"Qf": torch.eye(3)}, r"Qf: expected \(..., n=2, n=2\), got \(3, 3\)"),
        ({"Qf": torch.zeros(2, 3)}, r"Qf: expected"),
        ({"pf": torch.zeros(3)}, r"pf: expected \(..., n=2\), got \(3,\)"),
        ({"Qf": torch.eye(2).float()}, "Qf: expected torch.float64"),
        ({"Qf": torch.full((2, 2), torch.nan)}, "Qf: expected finite numbers"),
        ({"Qf": 1.0}, "Qf: expected a floating-point tensor, got float"),
    ],
)
def test_a_last_cost_that_does_not_fit_is_refused(g, given, words):
    kept = "float64" in words or not isinstance(given.get("Qf", given.get("pf")), torch.Tensor)
    given = given if kept else {name: value.double() for name, value in given.items()}
    with pytest.raises(ValueError, match=words):
        pp.MPC(Clockwork(), torch.eye(3), None, 4, **given)(None, draw(g, 2))


@pytest.mark.parametrize(
    "given, words",
    [
        ({"target": torch.zeros(7, 2)}, r"target: expected a state or T=4 of them"),
        ({"u_target": torch.zeros(2)}, r"u_target: expected \(..., m=1\), got \(2,\)"),
        ({"u_target": torch.zeros(3, 1)}, r"u_target: expected an input or T=4 of them"),
        ({"u_target": torch.tensor([torch.nan])}, "u_target: expected finite numbers"),
    ],
)
def test_a_reference_that_does_not_fit_is_refused(g, given, words):
    given = {name: value.double() for name, value in given.items()}
    with pytest.raises(ValueError, match=words):
        pp.MPC(Clockwork(), torch.eye(3), None, 4)(None, draw(g, 2), **given)


def test_the_last_cost_moves_and_is_saved_with_the_controller(g):
    Qf = torch.nn.Parameter(2 * torch.eye(2))
    mpc = pp.MPC(Clockwork(), torch.eye(3), None, 4, Qf=Qf, pf=torch.ones(2))
    assert {"Qf", "pf"} <= set(mpc.state_dict()) and Qf in list(mpc.parameters())
    assert mpc.float().Qf.dtype == mpc.pf.dtype == torch.float32
