"""float32: covariances stay covariances, and a precise sensor keeps its digits."""

import pytest
import torch
from filter_helpers import close

import pypose_lite as pp
from pypose_lite.filters import EKF, UKF
from pypose_lite.filters.gaussian import covariance, factor

KINDS = [EKF, UKF]


def chain(n, p, dt):
    """A chain of n integrators whose first p states are seen."""
    A = torch.eye(n) + dt * torch.diag(torch.ones(n - 1), 1)
    return pp.LTI(A, torch.zeros(n, 1), torch.eye(n)[:p], torch.zeros(p, 1)).float()


def turned_chains(n, p, dt):
    """Eight such chains with their axes a little off, so that a sensor sees a bit of everything."""
    g, one = torch.Generator().manual_seed(0), chain(n, p, dt).double()
    A = one.A + 0.02 * torch.randn(8, n, n, generator=g)
    A = A / torch.linalg.eigvals(A).abs().amax(-1)[:, None, None].clamp(min=1)
    return pp.LTI(A, one.B, one.C + 0.1 * torch.randn(8, p, n, generator=g), one.D).float()


def covariances(filter, n, p, T):
    P, Ps = 1e4 * torch.eye(n).float(), []
    x, y, u = torch.zeros(n).float(), torch.zeros(p).float(), torch.zeros(1).float()
    for _ in range(T):
        P = filter(x, y, u, P)[1]
        Ps.append(P)
    return torch.stack(Ps)


def noise(n, p):
    return 1e-6 * torch.eye(n).float(), 1e-6 * torch.eye(p).float()


@pytest.mark.parametrize("kind, T", [(EKF, 10_000), (UKF, 1_000)])
def test_a_vague_start_and_precise_sensors_leave_every_covariance_positive(kind, T):
    P = covariances(kind(chain(2, 1, 0.1), *noise(2, 1)), 2, 1, T)
    assert torch.equal(P, P.mT)
    assert torch.linalg.eigvalsh(P.double()).min() > 0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n, p, dt", [(2, 1, 0.01), (3, 1, 0.1), (4, 2, 1.0), (6, 2, 0.1)])
def test_so_do_sensors_that_see_a_bit_of_everything(kind, n, p, dt):
    P = covariances(kind(turned_chains(n, p, dt), *noise(n, p)), n, p, 200)
    assert torch.equal(P, P.mT)
    assert torch.linalg.eigvalsh(P.double()).min() > 0


@pytest.mark.parametrize("kind", KINDS)
def test_the_steady_covariance_is_that_of_float64(kind):
    model, Q, R = turned_chains(2, 1, 0.1), *noise(2, 1)
    small = covariances(kind(model, Q, R), 2, 1, 500)[-1]
    P = 1e4 * torch.eye(2)
    model, Q, R = model.double(), Q.double(), R.double()
    for _ in range(500):
        K = P @ model.C.mT @ torch.linalg.inv(model.C @ P @ model.C.mT + R)
        P = model.A @ (P - K @ model.C @ P) @ model.A.mT + Q
    torch.testing.assert_close(small.double(), P, rtol=1e-3, atol=0)


@pytest.mark.parametrize("kind", KINDS)
def test_a_precise_sensor_beside_a_vague_one_keeps_its_digits(kind):
    one = torch.eye(2).float()
    model = pp.LTI(one, one, one, 0 * one)
    R, P = (
        torch.diag(torch.tensor([1, 1e-6])).float(),
        torch.diag(torch.tensor([1e4, 1e-4])).float(),
    )
    x, P = kind(model).update(
        torch.zeros(2).float(), torch.tensor([3.0, 0.01]).float(), one[0], P, R
    )
    want = [3 * 1e4 / (1e4 + 1), 0.01 * 1e-4 / (1e-4 + 1e-6)]
    torch.testing.assert_close(x.double(), torch.tensor(want), rtol=1e-6, atol=0)
    want = [1e4 / (1e4 + 1), 1e-10 / (1e-4 + 1e-6)]
    torch.testing.assert_close(P.diagonal().double(), torch.tensor(want), rtol=1e-5, atol=0)


@pytest.mark.parametrize("n", [1, 2, 4, 10])
def test_a_covariance_moves_by_n_roundings_and_no_more(n):
    P = torch.randn(3, n, n, generator=torch.Generator().manual_seed(0))
    P = P @ P.mT
    rounded = covariance(P)
    assert torch.equal(rounded, rounded.mT)
    torch.testing.assert_close(rounded, P, rtol=4 * n * 2.2e-16, atol=1e-15)


@pytest.mark.parametrize("n", [1, 2, 5, 20])
def test_the_factor_of_a_singular_covariance_gives_it_back(n):
    g = torch.Generator().manual_seed(0)
    for rank in range(n):
        W = torch.randn(4, n, rank, generator=g)
        L = factor(W @ W.mT)
        close(L @ L.mT, W @ W.mT, 1e-6)  # the root of a rounding
        assert torch.equal(L, L.tril())


def test_a_tiny_variance_beside_a_large_one_is_no_rounding():
    P = torch.diag(torch.tensor([1e8, 1e-8, 0.0]))
    close(factor(P).diagonal(), torch.tensor([1e4, 1e-4, 0.0]))


@pytest.mark.parametrize(
    "P", [[[1.0, 2.0], [2.0, 1.0]], [[0.0, 1.0], [1.0, 0.0]], [[-1e-9, 0.0], [0.0, 1.0]]]
)
def test_what_is_not_a_covariance_has_no_factor(P):
    with pytest.raises(ValueError, match="P: expected no negative eigenvalue, got -"):
        factor(torch.tensor(P))


def test_variances_that_vanish_below_the_smallest_number_are_zero():
    P = torch.diag(torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64))
    P[0, 1] = P[1, 0] = 5e-324
    L = factor(P)
    torch.testing.assert_close(L @ L.mT, P, atol=1e-300, rtol=0)
