"""PyPose's gradients of a plan, beside ours and beside differences of PyPose's own plans.

No speed here: the numbers that chapter 8 states of PyPose 0.9.5. Its gradient is that of one more
Gauss-Newton sweep with the linearisation held still, so it equals what chapter 8 makes by hand.
`pytest tests/bench/bench_gradients.py` takes half a minute.
"""

import pytest
import torch

import pypose_lite
from pypose_lite import infinity

pypose = pytest.importorskip("pypose")

T, SLIP = 10, 0.2
WEIGHTS = (1.0, 1.0, 0.3, 0.3, 0.01, 0.01)


class Car(pypose.module.NLS):
    """The Dubins car, as a user of PyPose writes it."""

    def __init__(self, slip):
        super().__init__()
        self.slip = slip

    def state_transition(self, state, input, t=None):
        i, j, c, s = state.clone().unbind(-1)
        v, phi = input.unbind(-1)
        theta = torch.atan2(s, c) + (1 - self.slip) * phi * 0.1
        c, s = theta.cos(), theta.sin()
        return torch.stack([i + 0.1 * v * c, j + 0.1 * v * s, c, s], dim=-1)

    def observation(self, state, input, t=None):
        return state


@pytest.fixture(scope="module")
def plan():
    """Slip and weights, PyPose's plan, and differences of its plans."""
    dtype = torch.get_default_dtype()
    torch.set_default_dtype(torch.float64)
    theta = torch.tensor([SLIP, *WEIGHTS])
    _, u = pypose_turn(theta)
    yield theta, u, differences(lambda theta: pypose_turn(theta, u, sweeps=8)[0], theta)
    torch.set_default_dtype(dtype)


def pypose_turn(theta, start=None, sweeps=25):
    """PyPose's first turn rate from the first waypoint to the second, and all inputs.

    ``theta`` is the slip and the six weights.
    """
    path = infinity.waypoints()
    Q = torch.diag(theta[1:]).expand(1, T, 6, 6)
    p = -(Q[..., :4] @ path[1]).reshape(1, T, 6)
    goes_on = {"patience": sweeps, "decreasing": -1.0, "tol": -1e9}  # for all its sweeps
    stepper = pypose.utils.ReduceToBason(steps=sweeps, **goes_on)
    mpc = pypose.module.MPC(Car(theta[0]), Q, p, T, stepper=stepper)
    u = mpc(0.1, path[:1], start)[1]
    return u[0, 0, 1], u.detach()


def our_turn(theta):
    car, path = pypose_lite.DubinsCar(slip=theta[0]), infinity.waypoints()
    return pypose_lite.MPC(car, torch.diag(theta[1:]), None, T)(0.1, path[0], path[1])[1][0, 1]


def gradient(turn, theta):
    theta = theta.clone().requires_grad_()
    return torch.autograd.grad(turn(theta), theta)[0]


def differences(turn, theta, h=1e-5):
    steps = h * torch.eye(len(theta))
    return torch.stack([(turn(theta + d) - turn(theta - d)) / (2 * h) for d in steps]).detach()


def one_more_sweep(theta, u):
    """The gradient of one Gauss-Newton sweep from u, of all inputs in theta, by dense matrices."""
    path = infinity.waypoints()

    def deviations(u, slip):
        car, x, rows = pypose_lite.DubinsCar(slip=slip), path[0], []
        for u_t in u.reshape(T, 2):
            rows.append(torch.cat([x - path[1], u_t]))
            x = car.state_transition(x, u_t)
        return torch.cat(rows)

    D = torch.func.jacfwd(deviations)(u.flatten(), theta[0])

    def slope(theta):
        return D.mT @ (theta[1:].repeat(T) * deviations(u.flatten(), theta[0]))

    H = D.mT @ torch.diag(theta[1:].repeat(T)) @ D
    return -torch.linalg.solve(H, torch.func.jacfwd(slope)(theta))


def test_pypose_differentiates_one_more_sweep_and_misses_by_a_fifth(plan):
    theta, u, exact = plan
    again = gradient(lambda theta: pypose_turn(theta, u, sweeps=2)[0], theta)
    torch.testing.assert_close(again, one_more_sweep(theta, u[0])[1], rtol=1e-8, atol=1e-8)
    assert float(again[0]) == pytest.approx(3.9456887237, abs=1e-9)  # as chapter 8 says
    assert 1.15 < float(again[0] / exact[0]) < 1.3
    assert (again - exact).norm() > 0.03 * exact.norm()


def test_ours_is_that_of_pyposes_own_plans(plan):
    theta, _, exact = plan
    assert (gradient(our_turn, theta) - exact).norm() < 1e-4 * exact.norm()
