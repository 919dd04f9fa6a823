"""One Riccati step against the minimum it promises: free, in a box, in a batch."""

import numpy as np
import pytest
import torch
from oracles import BATCHES, close, draw, matrices, weights
from scipy.optimize import lsq_linear

import pypose_lite as pp
from pypose_lite.control.riccati import CostToGo, riccati, riccati_step

pytestmark = pytest.mark.usefixtures("float64")


def step_problem(g, n, m, lead=()):
    """The cost-to-go after a step, and the step: the quadratics in x and u have minima."""
    A, B, *_ = matrices(g, n, m, lead)
    after = CostToGo(*weights(g, n, lead), draw(g, *lead))
    return after, *weights(g, n + m, lead), A, B


def pay(cost: CostToGo, x):
    """The cost-to-go of one sample's state."""
    return x @ cost.V @ x / 2 + cost.v @ x + cost.c


def value(after, Q, q, A, B, x, u):
    """The cost of one step and of what follows, of one sample."""
    z = torch.cat([x, u])
    return z @ Q @ z / 2 + q @ z + pay(after, A @ x + B @ u)


def model_of(after, Q, q, A, B):
    """``Huu, Hux, hu`` by differentiating the value."""
    n, m = B.shape

    def of(z):
        return value(after, Q, q, A, B, z[:n], z[n:])

    H = torch.autograd.functional.hessian(of, torch.zeros(n + m))
    h = torch.autograd.functional.jacobian(of, torch.zeros(n + m))
    return H[n:, n:], H[n:, :n], h[n:]


@pytest.mark.parametrize("n, m", [(1, 1), (2, 1), (4, 3), (2, 5)])
def test_a_step_gives_the_least_cost_and_the_input_that_attains_it(g, n, m):
    given = step_problem(g, n, m)
    before, K, k, failed = riccati_step(*given)
    assert not failed
    for _ in range(3):
        x = draw(g, n)
        best = value(*given, x, K @ x + k)
        close(best, pay(before, x), 1e-11)
        u = (K @ x + k).requires_grad_()
        close(torch.autograd.grad(value(*given, x, u), u)[0], torch.zeros(m), 1e-11)
        assert all(value(*given, x, u + 0.1 * draw(g, m)) > best for _ in range(5))


def test_the_cost_to_go_can_be_told_from_elsewhere(g):
    after, *_ = step_problem(g, 3, 1)
    d, x = draw(g, 3), draw(g, 3)
    close(pay(after.from_origin(d), x - d), pay(after, x))


def test_the_cost_to_go_is_that_of_the_gains_also_where_a_box_clamps_them(g):
    """So that a sweep knows what to promise."""
    given = step_problem(g, 3, 2)
    before, K, k, _ = riccati_step(*given, (torch.full((2,), -0.1), torch.full((2,), 0.1)))
    close(k.abs(), torch.full((2,), 0.1))
    for _ in range(3):
        x = draw(g, 3)
        close(value(*given, x, K @ x + k), pay(before, x))


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32], ids=str)
def test_the_cost_to_go_stays_symmetric_and_right_on_an_unstable_system(g, dtype):
    """P36: without (V + V')/2 what is not symmetric grows by 1.5^2 with every step."""
    Q, q = weights(g, 4)
    A, B = torch.tensor([[1.5, 0.4, 0], [0, 1.3, 0.2], [0, 0, 1.2]]), draw(g, 3, 1)
    given = [z.to(dtype) for z in (Q, 0 * q, A, B)]
    after = CostToGo(torch.zeros(3, 3, dtype=dtype), *torch.zeros(2, 3, dtype=dtype)[:, 0:3])
    after = after._replace(c=torch.zeros((), dtype=dtype))
    for _ in range(1000):
        after, _, _, failed = riccati_step(after, *given)
        assert not failed and (after.V == after.V.mT).all()
    P = pp.dlqr(A, B, Q[:3, :3], Q[3:, 3:], Q[:3, 3:])[1]
    close(
        after.V.double() / P.abs().max(),
        P / P.abs().max(),
        1e-12 if dtype == torch.float64 else 1e-4,
    )


@pytest.mark.parametrize("lead", BATCHES[1:], ids=str)
@pytest.mark.parametrize("bounded", [False, True])
def test_a_batched_pass_is_the_stack_of_single_passes(g, lead, bounded):
    last, *given = step_problem(g, 2, 1, (4, *lead))
    last = CostToGo(*(z[0] for z in last))
    box = (-draw(g, 4, *lead, 1).abs(), draw(g, 4, *lead, 1).abs()) if bounded else None
    d = draw(g, 4, *lead, 2)
    K, k, c, failed = riccati(last, *given, box, d)
    assert failed.shape == (4, *lead)
    for i in np.ndindex(lead):
        j = (slice(None), *i)
        alone = CostToGo(*(z[i] for z in last)), *(z[j] for z in given)
        one = riccati(*alone, box and (box[0][j], box[1][j]), d[j])
        for a, b in zip((K[j], k[j], c[i]), one):
            close(a, b)


def test_a_step_whose_inputs_have_no_minimum_says_so(g):
    after, Q, q, A, B = step_problem(g, 2, 2, (3,))
    Q[1, 2:, 2:] -= 100 * torch.eye(2)
    box = torch.full((3, 2), -0.1), torch.full((3, 2), 0.1)
    for bounds in (None, box):
        failed = riccati_step(after, Q, q, A, B, bounds)[3]
        assert (failed != 0).tolist() == [False, True, False]
    failed = riccati(after, *(torch.stack([z, z]) for z in (Q, q, A, B)))[3]
    assert failed.shape == (2, 3) and failed[1, 1] and not failed[:, 0].any()


def test_a_wide_box_changes_nothing(g):
    given = step_problem(g, 3, 2, (4,))
    wide = torch.full((4, 2), torch.inf)
    (boxed, *gains), (free, *others) = riccati_step(*given, (-wide, wide)), riccati_step(*given)
    for a, b in zip([*boxed, *gains], [*free, *others]):
        close(a.double(), b.double(), 1e-11)


def test_inputs_that_do_not_disturb_each_other_are_clipped_into_their_box(g):
    """With Huu diagonal the box's solution is the free one, clipped; clamped ones hear no x."""
    after, Q, q, A, B = step_problem(g, 3, 4)
    after = CostToGo(*(torch.zeros_like(z) for z in after))
    Q[3:, 3:] = torch.diag(torch.tensor([0.5, 1.0, 2.0, 3.0]))
    _, free, u, _ = riccati_step(after, Q, q, A, B)
    lower, upper = u - torch.tensor([1, -0.5, 1, -3.0]), u + torch.tensor([1, 1, -0.5, 4.0])
    _, K, k, _ = riccati_step(after, Q, q, A, B, (lower, upper))
    close(k, torch.minimum(torch.maximum(u, lower), upper))
    close(K[0], free[0])
    close(K[1:], torch.zeros(3, 3), 0)


@pytest.mark.parametrize("side", [-1, 1])
def test_an_input_that_is_clamped_leaves_the_others_the_best_of_the_rest(g, side):
    """One is bounded, short of where it would go: the others are solved for with it held."""
    given = step_problem(g, 3, 3)
    Huu, _, hu = model_of(*given)
    free = riccati_step(*given)[2]
    bound = free[1] - side * 0.7
    low, high = torch.full((3,), -torch.inf), torch.full((3,), torch.inf)
    (high if side > 0 else low)[1] = bound
    k = riccati_step(*given, (low, high))[2]
    rest = [0, 2]
    want = -torch.linalg.solve(Huu[rest][:, rest], hu[rest] + Huu[rest, 1] * bound)
    close(k[rest], want), close(k[1], bound)
    assert (k[rest] - free[rest]).abs().min() > 1e-3


@pytest.mark.parametrize("seed", [0, 1, 3, 4, 5])
def test_a_step_from_the_boxs_solution_stays_there(seed):
    """The solution by SciPy is a fixed point: no input moves, clamped ones get no feedback."""
    g = torch.Generator().manual_seed(seed)
    after, Q, q, A, B = step_problem(g, 3, 4)
    Huu, _, hu = model_of(after, Q, q, A, B)
    lower, upper = -0.4 * draw(g, 4).abs(), 0.4 * draw(g, 4).abs()
    L = torch.linalg.cholesky(Huu)
    rhs = -torch.linalg.solve(L, hu)
    found = lsq_linear(L.mT.numpy(), rhs.numpy(), (lower.numpy(), upper.numpy()), method="bvls")
    u = torch.tensor(found.x)
    u = torch.where((u - lower) < 1e-9, lower, torch.where((upper - u) < 1e-9, upper, u))
    moved = q + Q[:, 3:] @ u  # the same problem in the change of u
    _, K, k, _ = riccati_step(after.from_origin(B @ u), Q, moved, A, B, (lower - u, upper - u))
    close(k, torch.zeros(4), 1e-9)
    at_bound = (u == lower) | (u == upper)
    assert at_bound.any() and not at_bound.all()
    close(K[at_bound], torch.zeros_like(K[at_bound]), 0)
    assert K[~at_bound].abs().min() > 0
