"""The UKF's own promises: points of any covariance, roots of either kind, no negative weight."""

import math

import pytest
import torch
from filter_helpers import Still, close, draw, one_step, spd

import pypose_lite as pp
from pypose_lite.filters import EKF, UKF, sigma_points


@pytest.mark.parametrize("n", range(1, 21))
@pytest.mark.parametrize("k", [None, 1.0, -0.5])
def test_sigma_points_have_the_mean_and_the_correlated_covariance(g, n, k):
    P = spd(g, n, (3,))
    dx, w = sigma_points(P, k)
    assert dx.shape == (3, n, 2 * n + 1) and w.shape == (2 * n + 1,)
    close(w.sum(), torch.tensor(1.0))
    close(dx @ w, torch.zeros(3, n))
    close((w * dx) @ dx.mT, P)


def test_points_that_were_changed_or_made_without_gradients_do_not_come_back(g):
    P = spd(g, 7)
    with torch.inference_mode():
        dx, w = sigma_points(P)
        w.zero_(), dx.zero_()
    dx, w = sigma_points(P.requires_grad_())
    close((w * dx) @ dx.mT, P)
    ((w * dx) @ dx.mT).sum().backward()
    close(P.grad, torch.ones(7, 7), 1e-10)


@pytest.mark.parametrize("scaled", [(1.0, 0.0, 2.0), (0.5, -0.75, 1.0), (2.0, 3.0, -1.0)])
def test_scaled_sigma_points_are_these_with_another_k(scaled):
    """Wan and van der Merwe's weights, where beta = alpha^2 - 1."""
    alpha, beta, kappa = scaled
    n = 3
    k = alpha**2 * (n + kappa) - n
    mean = torch.tensor([k / (n + k)] + 6 * [1 / (2 * (n + k))])
    second = mean + torch.tensor([1 - alpha**2 + beta] + 6 * [0.0])
    dx, w = sigma_points(torch.eye(3), k)
    close(w, mean)
    close(w, second)
    close(dx[:, 1], torch.tensor([math.sqrt(n + k), 0, 0]))


@pytest.mark.parametrize("n", [1, 2, 3, 4, 10])
def test_no_weight_is_negative_by_default(n):
    _, w = sigma_points(torch.eye(n))
    assert (w >= 0).all()


@pytest.mark.parametrize("n", [1, 2, 3])
def test_up_to_three_states_the_fourth_moments_are_a_gaussians(n):
    dx, w = sigma_points(torch.eye(n))
    close(dx**4 @ w, torch.full((n,), 3.0))


@pytest.mark.parametrize("n", [1, 2, 5, 20])
@pytest.mark.parametrize("k", [None, 3.0])
def test_a_step_that_does_nothing_leaves_the_covariance(g, n, k):
    x, P = draw(g, n), spd(g, n)
    got = UKF(Still()).predict(x, torch.zeros(1), P, torch.zeros(n, n), k=k)
    close(got[0], x)
    close(got[1], P)


@pytest.mark.parametrize("kind", [EKF, UKF])
@pytest.mark.parametrize(
    "P",
    [
        torch.zeros(4, 4),
        torch.diag(torch.tensor([1.0, 0.0, 2.0, 0.0])),
        torch.ones(4, 4),
        torch.outer(torch.arange(4.0), torch.arange(4.0))
        + torch.diag(torch.tensor([0.0, 0, 1, 0])),
    ],
    ids=["zero", "diagonal", "rank one", "rank two"],
)
def test_a_covariance_without_full_rank_is_updated_as_its_limit(g, kind, P):
    P, R, x, y = P.double(), spd(g, 4), draw(g, 4), draw(g, 4)
    mean, left = kind(Still()).update(x, y, torch.zeros(1), P, R)
    K = P @ torch.linalg.inv(P + R)
    close(mean, x + K @ (y - x))
    close(left, P - K @ P)


@pytest.mark.parametrize("kind", [EKF, UKF])
def test_in_a_batch_only_the_singular_ones_take_the_slow_way(g, kind):
    P = torch.stack([spd(g, 3), torch.zeros(3, 3), torch.ones(3, 3)])
    R, x, y = spd(g, 3), draw(g, 3, 3), draw(g, 3, 3)
    mean, left = kind(Still()).update(x, y, torch.zeros(1), P, R)
    K = P @ torch.linalg.inv(P + R)
    close(mean, x + pp.bmv(K, y - x))
    close(left, P - K @ P)


def test_ten_states_and_a_quadratic_step_run(g):
    class Quadratic(Still):
        def state_transition(self, state, input, t=None):
            return state + 0.1 * state**2

    x, P = draw(g, 10), spd(g, 10)
    ukf = UKF(Quadratic())
    for _ in range(20):
        x, P = ukf(x, torch.zeros(10), torch.zeros(1), P, 0.01 * torch.eye(10), torch.eye(10))
        assert torch.linalg.eigvalsh(P).min() > 0


def test_the_moments_of_a_quadratic_are_exact(g):
    """Mean and variance of x^2 for a Gaussian x: with n = 1 the points have the right kurtosis."""

    class Square(Still):
        def state_transition(self, state, input, t=None):
            return state**2

    m, s2 = 0.7, 0.4
    x, P = UKF(Square()).predict(
        torch.tensor([m]), torch.zeros(1), torch.tensor([[s2]]), torch.zeros(1, 1)
    )
    close(x, torch.tensor([m * m + s2]))
    close(P, torch.tensor([[2 * s2**2 + 4 * m * m * s2]]))


def symmetric_root(P):
    values, vectors = torch.linalg.eigh(P)
    return vectors * values.sqrt().unsqueeze(-2) @ vectors.mT


@pytest.mark.parametrize(
    "msqrt",
    [torch.linalg.cholesky, lambda P: torch.linalg.cholesky(P).mT, symmetric_root],
    ids=["lower", "upper", "symmetric"],
)
def test_any_root_gives_the_exact_step_of_a_linear_system(g, msqrt):
    args = one_step(g, (3,))
    want, got = EKF(Still())(*args), UKF(Still(), msqrt=msqrt)(*args)
    close(got[0], want[0])
    close(got[1], want[1])


def test_a_negative_weight_that_breaks_a_covariance_is_said_so(g):
    class Bowl(Still):
        def observation(self, state, input, t=None):
            return (state**2).sum(-1, keepdim=True)

    x, P, R = torch.zeros(4), torch.eye(4), torch.tensor([[0.1]])
    with pytest.raises(ValueError, match="innovation's covariance: expected positive definite"):
        UKF(Bowl())(x, torch.zeros(1), torch.zeros(1), P, 0 * P, R, k=-3.5)
    assert math.isfinite(UKF(Bowl())(x, torch.zeros(1), torch.zeros(1), P, 0 * P, R)[1].sum())
