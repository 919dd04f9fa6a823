"""Products and solves for each member: the same whether a batch is few matrices or many rows."""

import pytest
import torch
from oracles import Clockwork, close, draw, weights
from torch.autograd import gradcheck

import pypose_lite as pp
from pypose_lite import batched

pytestmark = pytest.mark.usefixtures("float64")


@pytest.fixture(params=["BLAS", "rows", "compiled"])
def way(request, monkeypatch):
    """How a batch is treated; what would be compiled runs in Python here."""
    monkeypatch.setattr(batched, "MANY", 10**6 if request.param == "BLAS" else 1)
    monkeypatch.setattr(torch.compiler, "is_compiling", lambda: request.param == "compiled")


def positive(g, *lead):
    half = draw(g, *lead, 3, 3)
    return half @ half.mT + torch.eye(3)


@pytest.mark.parametrize("lead", [(), (3,), (2, 3), (2, 1)], ids=str)
def test_products_are_einsums(g, way, lead):
    M, N, x, y = (draw(g, *lead, *core) for core in ((2, 4), (4, 5), (4,), (2,)))
    close(batched.bmm(M, N), torch.einsum("...ij,...jk->...ik", M, N))
    close(pp.bmv(M, x), torch.einsum("...ij,...j->...i", M, x))
    close(pp.bvv(x, x), torch.einsum("...i,...i->...", x, x))
    close(pp.bvmv(y, M, x), torch.einsum("...i,...ij,...j->...", y, M, x))
    close(batched.cat([M, M[..., :1]], -1), torch.cat([M, M[..., :1]], -1), 0)
    close(batched.cat([M, M[..., :1, :]], -2), torch.cat([M, M[..., :1, :]], -2), 0)
    close(batched.settled(M, 2), M, 0)


def test_one_matrix_serves_a_whole_batch(g, way):
    M, N, x = draw(g, 3, 2, 4), draw(g, 4, 5), draw(g, 2, 3, 4)
    close(batched.bmm(M, N), torch.einsum("bij,jk->bik", M, N))
    close(batched.bmm(N.mT, M.mT), torch.einsum("jk,bij->bki", N, M))
    close(pp.bmv(M, x), torch.einsum("bij,abj->abi", M, x))


@pytest.mark.parametrize("lead", [(), (3,), (2, 3)], ids=str)
def test_a_solve_gives_the_solution_and_half_of_the_way(g, way, lead):
    H, R = positive(g, *lead), draw(g, *lead, 3, 2)
    X, W, failed = batched.solve_positive(H, R)
    close(X, torch.linalg.solve(H, R))
    close(W.mT @ W, R.mT @ torch.linalg.solve(H, R))
    assert failed.shape == lead and not failed.any()


def test_only_members_that_are_not_positive_fail(g, way):
    H = positive(g, 4)
    H[1], H[3, 2, 2] = -H[1], -9.0
    assert (batched.solve_positive(H, draw(g, 4, 3, 1))[2] != 0).tolist() == [False, True] * 2


def test_gradients_go_through_rows(g, way):
    M, N, R = (draw(g, 2, 3, 3).requires_grad_() for _ in range(3))

    def chain(M, N, R):
        H = batched.bmm(M, M.mT) + torch.eye(3)
        return batched.solve_positive(H, batched.cat([batched.bmm(M, N), R], -1))[:2]

    assert gradcheck(chain, (M, N, R))


def test_sizes_that_do_not_fit_are_an_error(g, way):
    with pytest.raises((RuntimeError, ValueError)):
        batched.bmm(draw(g, 3, 2, 4), draw(g, 3, 5, 2))


@pytest.mark.parametrize("bounds", [(None, None), (-0.2, 0.3)], ids=["free", "bounded"])
def test_plans_of_rows_are_the_plans_of_each_member(g, monkeypatch, bounds):
    Q, p = weights(g, 3)
    x, u = draw(g, 5, 2), draw(g, 5, 4, 1).clamp(-0.2, 0.3)
    lqr, mpc = pp.LQR(Clockwork(), Q, p, 4), pp.MPC(Clockwork(), Q, p, 4)
    alone = [
        [lqr(one, None, start, *bounds), mpc(None, one, None, start, *bounds)]
        for one, start in zip(x, u)
    ]
    monkeypatch.setattr(batched, "MANY", 1)
    together = lqr(x, None, u, *bounds), mpc(None, x, None, u, *bounds)
    for i in range(5):
        for plan, plans in zip(alone[i], together):
            for z, zs in zip(plan, plans):
                close(zs[i], z, 1e-9)
