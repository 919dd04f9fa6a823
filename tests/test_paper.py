"""The listings of "PyPose v0.6: The Imperative Programming Interface for Robotics", run verbatim.

Those of sections III-A and III-B; what their prose says of the result is checked.
"""

import pytest
import torch

import pypose_lite as pp

dt, T, N, q = 0.1, 10, 30, 0.05  # the paper's listing reads a global dt


# Section III-A, first listing
# fmt: off
class DubinsCar(pp.module.NLS):
    # A 2-D DubinsCar kinematic model.
    def __init__(self, dt=0.1):
        super().__init__()
        self.dt = dt

    def state_transition(self, x, u, t=None):
        v, phi = u[..., 0], u[..., 1]
        c, s = x[..., 2], x[..., 3]
        theta = torch.atan2(s, c) + phi * dt

        i = x[..., 0] + v * c * dt
        j = x[..., 1] + v * s * dt
        c, s = theta.cos(), theta.sin()
        return torch.stack([i, j, c, s], dim=-1)

    def observation(self, x, u, t):
        return x
# fmt: on


Q = torch.diag(torch.tensor([1, 1, 0.3, 0.3, 0.01, 0.01]))
p = torch.zeros(6)


def loop(x, y, u):
    # Section III-A, second listing
    car = DubinsCar()
    for i in range(N - 1):
        x[i+1], y[i] = car(x[i], u[i])  # fmt: skip
    return car


def start():
    x, y = torch.zeros(N, 4), torch.zeros(N, 4)
    x[0] = torch.tensor([0.5, -0.2, 0.6, 0.8])
    return x, y, torch.randn(N, 2, generator=torch.Generator().manual_seed(0))


def test_the_loop_moves_the_car_and_observes_it_before_each_step():
    x, y, u = start()
    car = loop(x, y, u)
    heading = torch.atan2(x[0, 3], x[0, 2]) + dt * u[:-1, 1].cumsum(0)
    torch.testing.assert_close(x[1:, 2:], torch.stack([heading.cos(), heading.sin()], -1))
    moved = dt * u[:-1, :1] * x[:-1, 2:]  # with the old heading, unlike equations (2)
    torch.testing.assert_close(x[1:, :2], x[0, :2] + moved.cumsum(0))
    torch.testing.assert_close(y[:-1], x[:-1], rtol=0, atol=0)
    assert car.systime == N - 1


def test_the_loop_can_be_differentiated_although_it_writes_into_one_tensor():
    x, y, u = (z.double() for z in start())
    u.requires_grad_()
    loop(x, y, u)
    (gradient,) = torch.autograd.grad((x**2).sum() + y.sum(), u)
    way = torch.randn(N, 2, generator=torch.Generator().manual_seed(1)).double()

    def loss(u):
        x, y = (z.double() for z in start()[:2])
        loop(x, y, u)
        return (x**2).sum() + y.sum()

    with torch.no_grad():
        want = (loss(u + 1e-6 * way) - loss(u - 1e-6 * way)) / 2e-6
    torch.testing.assert_close((gradient * way).sum(), want, rtol=1e-7, atol=0)


def test_the_controller_drives_through_all_17_waypoints_with_noise():
    """Section III-B, both listings: each target until it is reached, of states seen with noise."""
    torch.manual_seed(0)
    car = DubinsCar()
    mpc = pp.module.MPC(car, Q, p, T)
    x, i, steps = [pp.infinity.waypoints()[0]], 0, 0
    y = [x[0]]
    for target in pp.infinity.waypoints()[1:]:
        while (x[i][:2] - target[:2]).norm() > 0.1:
            v = q * torch.randn(4)  # observation noise  # fmt: skip
            xt, u, cost = mpc(dt, y[i] + v, target)
            after, now = car(x[i], u[0])
            x.append(after), y.append(after)
            i, steps = i + 1, steps + 1
            assert steps < 200
    assert xt.shape == (T + 1, 4) and u.shape == (T, 2) and cost.shape == ()
    assert xt.dtype == torch.float32
    assert x[-1][:2].norm() <= 0.1
    assert pp.infinity.tracking_error(torch.stack(x)).mean() < 0.1


@pytest.mark.parametrize("name", ["System", "LTI", "LTV", "NLS", "LQR", "MPC"])
def test_the_module_holds_the_same_classes(name):
    assert getattr(pp.module, name) is getattr(pp, name)
