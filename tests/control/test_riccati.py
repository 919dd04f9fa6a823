"""One Riccati step against the minimum it promises; `dlqr` against SciPy and the long horizon."""

import numpy as np
import pytest
import scipy.linalg
import torch
from oracles import BATCHES, close, draw, matrices, weights
from scipy.optimize import lsq_linear
from torch.autograd import gradcheck

import pypose_lite as pp
from pypose_lite.control.riccati import (
    homogeneous_cost,
    homogeneous_dynamics,
    riccati,
    riccati_step,
)

pytestmark = pytest.mark.usefixtures("float64")


def step_problem(g, n, m, lead=()):
    """V, M, G of one step; the quadratics in u and x have minima."""
    A, B, _, _, c, _ = matrices(g, n, m, lead)
    V, M = homogeneous_cost(*weights(g, n, lead)), homogeneous_cost(*weights(g, m + n, lead))
    return V, M, homogeneous_dynamics(A, B, c)


def value(V, M, G, x, u):
    """The cost of one step and of what follows, of one sample."""
    z = torch.cat([u, x, torch.ones(1)])
    after = G @ z
    return (z @ M @ z + after @ V @ after) / 2


@pytest.mark.parametrize("lead", [(), (3,), (2, 3)], ids=str)
def test_constants_ride_along(g, lead):
    A, B, _, _, c, _ = matrices(g, 3, 2, lead)
    Q, q = weights(g, 5, lead)
    u, x = draw(g, *lead, 2), draw(g, *lead, 3)
    w = torch.cat([u, x], -1)
    z = torch.cat([w, torch.ones(*lead, 1)], -1)
    after = pp.bmv(homogeneous_dynamics(A, B, c), z)
    close(after[..., :-1], pp.bmv(A, x) + pp.bmv(B, u) + c)
    close(after[..., -1], torch.ones(lead), 0)
    close(pp.bmv(homogeneous_dynamics(A, B), z)[..., :-1], pp.bmv(A, x) + pp.bmv(B, u))
    close(pp.bvmv(z, homogeneous_cost(Q, q), z) / 2, pp.bvmv(w, Q, w) / 2 + pp.bvv(q, w))


@pytest.mark.parametrize("n, m", [(1, 1), (2, 1), (4, 3), (2, 5)])
def test_a_step_gives_the_least_cost_and_the_input_that_attains_it(g, n, m):
    V, M, G = step_problem(g, n, m)
    before, K, failed = riccati_step(V, M, G)
    assert not failed
    for _ in range(3):
        x = draw(g, n)
        one = torch.cat([x, torch.ones(1)])
        best = value(V, M, G, x, K @ one)
        close(best, one @ before @ one / 2, 1e-11)
        u = (K @ one).requires_grad_()
        close(torch.autograd.grad(value(V, M, G, x, u), u)[0], torch.zeros(m), 1e-11)
        assert all(value(V, M, G, x, K @ one + 0.1 * draw(g, m)) > best for _ in range(5))


def test_the_cost_to_go_is_that_of_the_gains_also_where_a_box_clamps_them(g):
    """So that a sweep knows what to promise; and it stays symmetric, in float32 as well."""
    V, M, G = step_problem(g, 3, 2)
    before, K, _ = riccati_step(V, M, G, (torch.full((2,), -0.1), torch.full((2,), 0.1)))
    close(K[:, -1].abs(), torch.full((2,), 0.1))
    for _ in range(3):
        one = torch.cat([x := draw(g, 3), torch.ones(1)])
        close(value(V, M, G, x, K @ one), one @ before @ one / 2)
    V, M, G = (z.float() for z in (V, M, G))
    for _ in range(1000):
        V, _, failed = riccati_step(V, M, G)
        assert not failed
    assert (V - V.mT)[:3, :3].abs().max() <= 1e-6 * V[:3, :3].abs().max()


@pytest.mark.parametrize("lead", BATCHES[1:], ids=str)
def test_a_batched_run_is_the_stack_of_single_runs(g, lead):
    _, M, G = step_problem(g, 2, 1, (4, *lead))
    box = (-draw(g, 4, *lead, 1).abs(), draw(g, 4, *lead, 1).abs())
    for bounds in (None, box):
        K, V, failed = riccati(M, G, bounds)
        assert failed.shape == (4, *lead)
        for i in np.ndindex(lead):
            i = (slice(None), *i)
            one = riccati(M[i], G[i], None if bounds is None else (box[0][i], box[1][i]))
            close(K[i], one[0])
            close(V[i[1:]], one[1])


def test_a_step_whose_inputs_have_no_minimum_says_so(g):
    V, M, G = step_problem(g, 2, 2, (3,))
    M[1, :2, :2] -= 100 * torch.eye(2)
    box = torch.full((3, 2), -0.1), torch.full((3, 2), 0.1)
    for bounds in (None, box):
        failed = riccati_step(V, M, G, bounds)[2]
        assert (failed != 0).tolist() == [False, True, False]
    _, _, failed = riccati(torch.stack([M, M]), torch.stack([G, G]))
    assert failed.shape == (2, 3) and failed[1, 1] and not failed[:, 0].any()


def test_a_wide_box_changes_nothing(g):
    V, M, G = step_problem(g, 3, 2, (4,))
    wide = torch.full((4, 2), torch.inf)
    for a, b in zip(riccati_step(V, M, G, (-wide, wide)), riccati_step(V, M, G)):
        close(a.double(), b.double(), 1e-11)


def test_inputs_that_do_not_disturb_each_other_are_clipped_into_their_box(g):
    """With H_uu diagonal the box's solution is the free one, clipped; clamped ones hear no x."""
    V, M, G = step_problem(g, 3, 4)
    V, M[:4, :4] = torch.zeros_like(V), torch.diag(torch.tensor([0.5, 1.0, 2.0, 3.0]))
    free = riccati_step(V, M, G)[1]
    u = free[:, -1]
    lower, upper = u - torch.tensor([1, -0.5, 1, -3.0]), u + torch.tensor([1, 1, -0.5, 4.0])
    K = riccati_step(V, M, G, (lower, upper))[1]
    close(K[:, -1], torch.minimum(torch.maximum(u, lower), upper))
    close(K[[0], :-1], free[[0], :-1])
    close(K[1:, :-1], torch.zeros(3, 3), 0)


@pytest.mark.parametrize("side", [-1, 1])
def test_an_input_that_is_clamped_leaves_the_others_the_best_of_the_rest(g, side):
    """One is bounded, short of where it would go: the others are solved for with it held."""
    V, M, G = step_problem(g, 3, 3)
    H = M + G.mT @ V @ G
    free = riccati_step(V, M, G)[1][:, -1]
    bound = free[1] - side * 0.7
    low, high = torch.full((3,), -torch.inf), torch.full((3,), torch.inf)
    (high if side > 0 else low)[1] = bound
    K = riccati_step(V, M, G, (low, high))[1]
    rest = [0, 2]
    want = -torch.linalg.solve(H[rest][:, rest], H[rest, -1] + H[rest, 1] * bound)
    close(K[rest, -1], want), close(K[1, -1], bound)
    assert (K[rest, -1] - free[rest]).abs().min() > 1e-3


@pytest.mark.parametrize("seed", [0, 1, 3, 4, 5])
def test_a_step_from_the_boxs_solution_stays_there(seed):
    """The solution by SciPy is a fixed point: no input moves, clamped ones get no feedback."""
    g = torch.Generator().manual_seed(seed)
    V, M, G = step_problem(g, 3, 4)
    H = M + G.mT @ V @ G
    lower, upper = -0.4 * draw(g, 4).abs(), 0.4 * draw(g, 4).abs()
    L = torch.linalg.cholesky(H[:4, :4])
    rhs = -torch.linalg.solve(L, H[:4, -1])
    found = lsq_linear(L.mT.numpy(), rhs.numpy(), (lower.numpy(), upper.numpy()), method="bvls")
    u = torch.tensor(found.x)
    u = torch.where((u - lower) < 1e-9, lower, torch.where((upper - u) < 1e-9, upper, u))
    move = torch.eye(8)
    move[:4, -1] = u  # the same problem in the change of u
    K = riccati_step(V, move.mT @ M @ move, G @ move, (lower - u, upper - u))[1]
    close(K[:, -1], torch.zeros(4), 1e-9)
    at_bound = (u == lower) | (u == upper)
    assert at_bound.any() and not at_bound.all()
    close(K[at_bound, :-1], torch.zeros_like(K[at_bound, :-1]), 0)
    assert K[~at_bound, :-1].abs().min() > 0


# --- the endless horizon


def plant(g, n, m, lead=()):
    """An unstable system, and costs."""
    A, B, _, _, _, _ = matrices(g, n, m, lead, radius=1.3)
    return A, B, weights(g, n, lead)[0], weights(g, m, lead)[0]


def residual(A, B, Q, R, K, P):
    """What is left of P = Q + A' P (A - B K), with K from its own equation."""
    K_of_P = torch.linalg.solve(R + B.mT @ P @ B, B.mT @ P @ A)
    return (P - Q - A.mT @ P @ (A - B @ K)).abs().max() + (K - K_of_P).abs().max()


@pytest.mark.parametrize("n, m", [(1, 1), (2, 1), (4, 2), (6, 3), (2, 3)])
def test_dlqr_is_scipys_solution_and_satisfies_the_riccati_equation(g, n, m):
    A, B, Q, R = plant(g, n, m)
    K, P = pp.dlqr(A, B, Q, R)
    want = scipy.linalg.solve_discrete_are(*(z.numpy() for z in (A, B, Q, R)))
    close(P, torch.tensor(want), 1e-10 * P.abs().max())
    assert residual(A, B, Q, R, K, P) < 1e-10
    assert torch.linalg.eigvals(A - B @ K).abs().max() < 1
    close(P, P.mT, 0)


def test_dlqr_takes_the_symmetric_part_of_its_weights(g):
    A, B, Q, R = plant(g, 3, 2)
    skew = draw(g, 3, 3)
    for a, b in zip(pp.dlqr(A, B, Q + skew - skew.mT, R), pp.dlqr(A, B, Q, R)):
        close(a, b)


@pytest.mark.parametrize("which", ["A", "B", "Q", "R", "AB", "BR", "ABQR"])
@pytest.mark.parametrize("lead", BATCHES, ids=str)
def test_a_batched_dlqr_is_the_stack_of_single_ones(g, which, lead):
    """Any of the four may be batched, also in as many members as there are states."""
    single = dict(zip("ABQR", plant(g, 2, 2)))
    given = single | {k: z for k, z in zip("ABQR", plant(g, 2, 2, lead)) if k in which}
    K, P = pp.dlqr(*given.values())
    assert K.shape == P.shape == (*lead, 2, 2)
    for i in np.ndindex(lead):
        one = pp.dlqr(*(z[i] if k in which else z for k, z in given.items()))
        close(K[i], one[0], 1e-11)
        close(P[i], one[1], 1e-11 * P.abs().max())


def test_dlqr_is_the_limit_of_lqr_as_the_horizon_grows(g):
    A, B, Q, R = plant(g, 3, 2)
    system = pp.LTI(A, B, torch.eye(3), torch.zeros(3, 2))
    K, P = pp.dlqr(A, B, Q, R)
    errors = []
    for T in (5, 20, 100):
        lqr = pp.LQR(system, torch.block_diag(Q, R), None, T)
        errors.append((lqr.lqr_backward(draw(g, 3))[0][0] + K).abs().max())
    assert errors[0] > errors[1] > errors[2] and errors[2] < 1e-10
    x = draw(g, 3)
    close(lqr(x)[2], x @ P @ x / 2, 1e-9)


def test_dlqr_has_exact_gradients(g):
    given = [z.requires_grad_() for z in plant(g, 2, 1, (2,))]
    assert gradcheck(pp.dlqr, given)


def test_dlqr_in_float32_stays_float32_and_is_close(g):
    given = plant(g, 4, 2)
    want = pp.dlqr(*given)
    for a, b in zip(pp.dlqr(*(z.float() for z in given)), want):
        assert a.dtype == torch.float32
        torch.testing.assert_close(a.double(), b, rtol=1e-4, atol=1e-4)


ONE, ZERO = [[1.0]], [[0.0]]


@pytest.mark.parametrize(
    "A, B, Q, R, words",
    [
        ([[2, 0], [0, 0.5]], [[0], [1.0]], [[1, 0], [0, 1]], ONE, "cannot be stabilised"),
        ([[1.0]], ZERO, ONE, ONE, "cannot be stabilised"),
        ([[1.1]], ONE, ZERO, ONE, "Q gives an unstable motion no cost"),
        ([[1.1]], ZERO, ZERO, ONE, "cannot be stabilised"),
        ([[0.5]], ONE, ONE, ZERO, "R: expected a positive definite matrix"),
        ([[0.5]], ONE, ONE, [[-1.0]], "R: expected a positive definite matrix"),
        ([[0.5]], ONE, [[-9.0]], ONE, "Q: the cost has no minimum"),
        ([[0.5, 1.0]], ONE, ONE, ONE, r"A: expected \(..., n, n\), got \(1, 2\)"),
        ([[0.5]], [[1.0], [1.0]], ONE, ONE, r"B: expected \(..., n=1, m\), got \(2, 1\)"),
        ([[0.5]], ONE, [[1.0, 0], [0, 1]], ONE, r"Q: expected \(..., n=1, n=1\), got \(2, 2\)"),
        ([[0.5]], [[1.0, 1]], ONE, ONE, r"R: expected \(..., m=2, m=2\), got \(1, 1\)"),
        ([[float("nan")]], ONE, ONE, ONE, "A: expected finite numbers, got nan"),
    ],
)
def test_a_problem_without_a_stable_solution_is_a_clear_error(A, B, Q, R, words):
    given = [torch.tensor(z).double() for z in (A, B, Q, R)]
    with pytest.raises(ValueError, match=words):
        pp.dlqr(*given)


def test_one_bad_member_of_a_batch_is_enough_for_an_error():
    A = torch.tensor([[[0.5]], [[2.0]]])
    with pytest.raises(ValueError, match="cannot be stabilised"):
        pp.dlqr(A, torch.zeros(1, 1), torch.eye(1), torch.eye(1))
