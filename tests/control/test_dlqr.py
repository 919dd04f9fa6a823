"""The regulator of the endless horizon against SciPy, and as the limit of ever longer plans."""

import numpy as np
import pytest
import scipy.linalg
import torch
from oracles import BATCHES, close, draw, matrices, weights
from torch.autograd import gradcheck

import pypose_lite as pp

pytestmark = pytest.mark.usefixtures("float64")


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


def test_a_cross_term_is_scipys(g):
    A, B, Q, R = plant(g, 4, 2)
    N = 0.2 * draw(g, 4, 2)
    K, P = pp.dlqr(A, B, Q, R, N)
    want = scipy.linalg.solve_discrete_are(*(z.numpy() for z in (A, B, Q, R)), s=N.numpy())
    close(P, torch.tensor(want), 1e-10 * P.abs().max())
    close(K, torch.linalg.solve(R + B.mT @ P @ B, B.mT @ P @ A + N.mT), 1e-10)
    plan = pp.LQR(
        pp.LTI(A, B, torch.eye(4), torch.zeros(4, 2)),
        torch.cat([torch.cat([Q, N], 1), torch.cat([N.mT, R], 1)]),
        None,
        200,
    )
    x = draw(g, 4)
    close(plan(x)[1][0], -K @ x, 1e-9)


@pytest.mark.parametrize("transform", ["vmap", "grad", "jacrev"])
def test_torchs_transforms_pass_through(g, transform):
    A, B, Q, R = plant(g, 2, 1, (3,))
    if transform == "vmap":
        for a, b in zip(torch.vmap(pp.dlqr)(A, B, Q, R), pp.dlqr(A, B, Q, R)):
            close(a, b, 1e-10)
        return

    def cost(Q):
        return pp.dlqr(A[0], B[0], Q, R[0])[1].sum()

    M = Q[0].clone().requires_grad_()
    (want,) = torch.autograd.grad(cost(M), M)
    close(
        {"grad": torch.func.grad, "jacrev": torch.func.jacrev}[transform](cost)(Q[0]), want, 1e-10
    )
