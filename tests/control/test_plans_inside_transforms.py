"""torch's transforms over the controllers, and arguments as people have them."""

import numpy as np
import pytest
import torch
from oracles import Clockwork, central, close, draw, weights

import pypose_lite as pp
from pypose_lite import infinity

pytestmark = pytest.mark.usefixtures("float64")


def regulators(g):
    Q, p = weights(g, 3)
    A, B = draw(g, 2, 2), draw(g, 2, 1)
    linear = pp.LTI(A, B, torch.eye(2), torch.zeros(2, 1))
    return [pp.LQR(system, Q, p, 4, torch.eye(2)) for system in (linear, Clockwork())]


def test_lqr_is_mapped_over_a_batch(g):
    x, targets = draw(g, 5, 2), draw(g, 5, 2)
    for lqr in regulators(g):
        mapped = torch.vmap(lambda x, r, lqr=lqr: lqr(x, target=r))(x, targets)
        for a, b in zip(mapped, lqr(x, target=targets)):
            close(a, b, 1e-10)


@pytest.mark.parametrize("which", [0, 1], ids=["linear", "nonlinear"])
def test_lqr_is_differentiated_by_transforms(g, which):
    lqr, x = regulators(g)[which], draw(g, 2)
    for part in (1, 2):  # inputs, cost
        want = central(lambda x, part=part: lqr(x)[part], x)
        close(torch.func.jacrev(lambda x, part=part: lqr(x)[part])(x), want, 1e-6)
    close(torch.func.grad(lambda x: lqr(x)[2])(x), want, 1e-6)


@pytest.mark.parametrize("transform", [torch.vmap, torch.func.grad, torch.func.jacrev])
def test_mpc_says_to_pass_the_batch_itself(g, transform):
    Q, x = weights(g, 3)[0], draw(g, 3, 2)
    bounded = pp.LQR(Clockwork(), Q, None, 4)
    mpc = pp.MPC(Clockwork(), Q, None, 4)
    x = x if transform is torch.vmap else x[0]
    for plan in (lambda x: mpc(None, x)[2], lambda x: bounded(x, u_upper=1.0)[2]):
        with pytest.raises(RuntimeError, match="pass the batch itself"):
            transform(plan)(x)


@pytest.mark.parametrize(
    "dt", [np.float64(0.1), np.float32(0.1), np.array(0.1), np.array([0.1]), torch.tensor([0.1])]
)
def test_a_time_step_may_be_any_number(dt):
    x = infinity.waypoints()[0]
    controller = infinity.controller(T=3)
    close(controller(dt, x)[1], controller(0.1, x)[1], 0)


@pytest.mark.parametrize(
    "dt, words",
    [
        (torch.full((2, 1), 0.1), r"one time step for all, got shape \(2, 1\)"),
        (np.full(3, 0.1), r"one time step for all, got shape \(3,\)"),
        ("0.1", "positive time step, got '0.1'"),
        (np.float64(-1), "positive time step"),
        (torch.tensor(torch.nan), "positive time step"),
        ([0.1, 0.1], "positive time step"),
        (0.2, "the system steps by 0.1, got 0.2"),
    ],
)
def test_a_time_step_that_is_none_is_refused(dt, words):
    x = infinity.waypoints()[0].expand(2, 4)
    with pytest.raises(ValueError, match=f"dt: .*{words}"):
        infinity.controller(T=3)(dt, x)


def test_a_horizon_may_be_numpys_integer():
    assert infinity.controller(T=np.int64(3)).T == 3
    for T in (0, -1, 2.0, True, "3", None, np.float64(3)):
        with pytest.raises(ValueError, match="T: expected a number of steps"):
            infinity.controller(T=T)
