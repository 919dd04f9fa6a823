"""P36: on unstable systems plans stay right, however long the horizon.

The oracle is the endless horizon, by SciPy: a plan of hundreds of steps begins as it does.
"""

import numpy as np
import pytest
import scipy.linalg
import torch
from oracles import Affine, close, draw

import pypose_lite as pp

pytestmark = pytest.mark.usefixtures("float64")
KINDS = ["LTI", "LTV", "NLS"]
CLOSE = {torch.float64: 1e-9, torch.float32: 1e-3}


def plant(g, radius, n=3, m=1, dtype=torch.float64):
    """A with its largest eigenvalue of the given size, B, Q, R, and a first state."""
    A = draw(g, n, n)
    A = A * radius / torch.linalg.eigvals(A).abs().max()
    Q, x = torch.diag(torch.rand(n, generator=g, dtype=torch.float64) + 0.5), draw(g, n)
    return [z.to(dtype) for z in (A, draw(g, n, m), Q, torch.eye(m), x)]


def system_of(kind, A, B):
    n, m = B.shape
    C, D = torch.eye(n, dtype=A.dtype), torch.zeros(n, m, dtype=A.dtype)
    if kind == "LTI":
        return pp.LTI(A, B, C, D)
    if kind == "LTV":
        return pp.LTV(*(torch.stack([z, z]) for z in (A, B, C, D)))
    zero = A.new_zeros(n)
    return Affine(A, B, C, D, zero, zero)


def endless(A, B, Q, R, x):
    """The cost and the first input of the endless horizon."""
    A, B, Q, R, x = (z.double().numpy() for z in (A, B, Q, R, x))
    P = scipy.linalg.solve_discrete_are(A, B, Q, R)
    u = -np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A @ x)
    return torch.tensor(x @ P @ x / 2), torch.tensor(u)


@pytest.mark.parametrize("dtype", CLOSE, ids=str)
@pytest.mark.parametrize("radius", [1.05, 1.2, 1.5])
@pytest.mark.parametrize("kind", KINDS)
def test_lqr_is_the_endless_horizons(g, kind, radius, dtype):
    A, B, Q, R, x = plant(g, radius, dtype=dtype)
    cost, u = endless(A, B, Q, R, x)
    for T in (100, 200, 300, 1000):
        lqr = pp.LQR(system_of(kind, A, B), torch.block_diag(Q, R), None, T)
        plan = lqr(x)
        assert plan[2].dtype == dtype
        close(plan[2].double() / cost, torch.ones(()), CLOSE[dtype])
        close(plan[1][0].double() / u, torch.ones_like(u), CLOSE[dtype])
        assert plan[0][-1].abs().max() < 1e-3 * x.abs().max()


@pytest.mark.parametrize("dtype", CLOSE, ids=str)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("bounded", [False, True])
def test_mpc_is_the_endless_horizons_and_says_so_rightly(g, kind, dtype, bounded):
    A, B, Q, R, x = plant(g, 1.5, dtype=dtype)
    cost, u = endless(A, B, Q, R, x)
    bounds = {"u_lower": -100.0, "u_upper": 100.0} if bounded else {}
    for T in (20, 40, 100, 300):
        mpc = pp.MPC(system_of(kind, A, B), torch.block_diag(Q, R), None, T)
        plan = mpc.solve(None, x, **bounds)
        assert plan.converged
        if T > 40:
            close(plan.cost.double() / cost, torch.ones(()), CLOSE[dtype])
            close(plan.u[0].double() / u, torch.ones_like(u), CLOSE[dtype])


def test_members_of_a_batch_are_planned_for_as_alone(g):
    """One explodes when rolled out, another does not."""
    A, B, Q, R, x = plant(g, 1.5, dtype=torch.float32)
    x = torch.stack([x, 0 * x, 1e-30 * x])
    for kind in KINDS:
        system, weights = system_of(kind, A, B), torch.block_diag(Q, R)
        for controller in (pp.LQR(system, weights, None, 150), pp.MPC(system, weights, None, 150)):
            before = (None,) if isinstance(controller, pp.MPC) else ()
            many = controller(*before, x)
            for i in range(3):
                size = x[i].abs().max()
                for z, alone, power in zip(many, controller(*before, x[i]), (1, 1, 2)):
                    close(z[i], alone, 1e-4 * size**power)


def balanced(T):
    """A pendulum held upright: its eigenvalues are far outside the circle for hundreds of steps."""
    return pp.MPC(pp.Pendulum(dt=0.1), torch.diag(torch.tensor([1.0, 0.1, 0.01])), None, T)


@pytest.mark.parametrize("T", [50, 400])
def test_the_gradient_of_a_long_plan_is_that_of_differences(T):
    mpc, x = balanced(T), torch.tensor([0.4, -0.2], requires_grad=True)
    plan = mpc.solve(0.1, x)
    assert plan.converged
    values = {"cost": lambda p: p.cost, "u": lambda p: p.u[0, 0], "x": lambda p: p.x[5, 1]}
    for value in values.values():
        (slope,) = torch.autograd.grad(value(plan), x, retain_graph=True)
        for i, step in enumerate(1e-5 * torch.eye(2)):
            up, down = (value(mpc.solve(0.1, x.detach() + s * step)) for s in (1, -1))
            close(slope[i] / ((up - down) / 2e-5), torch.ones(()), 1e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_the_gradient_on_a_linear_system_is_that_of_the_endless_horizon(g, kind):
    """``d cost / dx = P x`` and ``du/dx = -K``, after 300 steps of an eigenvalue of 1.5."""
    A, B, Q, R, x = plant(g, 1.5)
    K, P = pp.dlqr(A, B, Q, R)
    mpc = pp.MPC(system_of(kind, A, B), torch.block_diag(Q, R), None, 300)
    x.requires_grad_()
    plan = mpc.solve(None, x)
    close(torch.autograd.grad(plan.cost, x, retain_graph=True)[0], (P @ x).detach(), 1e-7)
    close(torch.autograd.grad(plan.u[0, 0], x)[0], -K[0], 1e-7)
