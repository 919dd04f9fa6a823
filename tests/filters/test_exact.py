"""On a linear system every filter is the exact one: against dense Gaussians and a textbook loop."""

import numpy as np
import pytest
from filter_helpers import close, linear, record, textbook, whole_log_likelihood, whole_run

from pypose_lite.filters import EKF, PF, UKF, smooth

K = [None, -2.5, -1.0, 0.0, 2.0, 30.0]  # the weight of the UKF's centre, any above -n = -3


@pytest.mark.parametrize("n, m, p", [(1, 1, 1), (2, 1, 2), (3, 2, 1), (5, 1, 3)])
@pytest.mark.parametrize("kind", [EKF, UKF])
def test_300_steps_are_the_textbooks(g, kind, n, m, p):
    system = linear(g, n, m, p)
    _, u, y = system.run(g, 300)
    x, P = record(kind(system.model, system.Q, system.R), system.x, system.P, y, u)
    want_x, want_P = textbook(system, u, y)
    close(x, want_x, 1e-9)
    close(P, want_P, 1e-9)


@pytest.mark.parametrize("k", K)
def test_the_ukf_is_exact_whatever_its_centre_weighs(g, k):
    system = linear(g, 3, 2, 2)
    _, u, y = system.run(g, 300)
    x, P = record(UKF(system.model, system.Q, system.R), system.x, system.P, y, u, k=k)
    want_x, want_P = textbook(system, u, y)
    close(x, want_x, 1e-9)
    close(P, want_P, 1e-9)


@pytest.mark.parametrize("kind", [EKF, UKF])
def test_each_step_is_the_run_given_the_observations_so_far(g, kind):
    system = linear(g, 3, 1, 2)
    _, u, y = system.run(g, 8)
    x, P = record(kind(system.model, system.Q, system.R), system.x, system.P, y, u)
    for i in range(9):
        means, covariances = whole_run(system, u, y, known=i)
        close(x[i], means[i], 1e-10)
        close(P[i], covariances[i], 1e-10)


@pytest.mark.parametrize("kind", [EKF, UKF])
def test_an_update_alone_adds_the_observation_of_the_same_state(g, kind):
    system = linear(g, 3, 1, 2)
    _, u, y = system.run(g, 5)
    filter = kind(system.model, system.Q, system.R)
    x, P = record(filter, system.x, system.P, y[:4], u[:4])
    x, P = filter.update(x[4], y[4], u[4], P[4])
    means, covariances = whole_run(system, u, y, known=5)
    close(x, means[4], 1e-10)
    close(P, covariances[4], 1e-10)
    x, P = filter.predict(x, u[4], P)
    close(x, means[5], 1e-10)
    close(P, covariances[5], 1e-10)


@pytest.mark.parametrize("kind", [EKF, UKF])
@pytest.mark.parametrize("lead", [(), (4,), (2, 3)])
def test_the_smoother_is_the_run_given_all_observations(g, kind, lead):
    system = linear(g, 3, 1, 2)
    _, u, y = system.run(g, 8, lead)
    filter = kind(system.model, system.Q, system.R)
    x, P = record(filter, system.x.expand(*lead, 3), system.P.expand(*lead, 3, 3), y, u)
    x, P = smooth(filter, x, P, y, u)
    for i in np.ndindex(lead):
        means, covariances = whole_run(system, u[i], y[i], known=8)
        close(x[i], means, 1e-9)
        close(P[i], covariances, 1e-9)


def test_the_smoother_broadcasts_inputs_and_takes_its_own_noise(g):
    system = linear(g, 2, 1, 2)
    _, u, y = system.run(g, 6, (5,))
    u, filter = u[0], EKF(system.model)  # one input for five records of observations
    x, P = record(filter, system.x.expand(5, 2), system.P.expand(5, 2, 2), y, u, *system[6:8])
    x, P = smooth(filter, x, P, y, u, *system[6:8])
    means, covariances = whole_run(system, u, y[3], known=6)
    close(x[3], means, 1e-9)
    close(P[3], covariances, 1e-9)


@pytest.mark.filterwarnings("error")
def test_particles_come_close_to_the_exact_filter(g):
    system = linear(g, 2, 1, 2)
    _, u, y = system.run(g, 8)
    pf = PF(system.model, system.Q, system.R, particles=200_000)
    x, P = record(pf, system.x, system.P, y, u, generator=g)
    for i in range(9):
        means, covariances = whole_run(system, u, y, known=i)
        close(x[i], means[i], 0.02)
        close(P[i], covariances[i], 0.02)


@pytest.mark.filterwarnings("error")
def test_particles_that_are_kept_come_close_too(g):
    system = linear(g, 2, 1, 2)
    _, u, y = system.run(g, 8)
    pf = PF(system.model, system.Q, system.R, particles=200_000)
    particles = pf.draw(system.x, system.P, generator=g)
    for i in range(8):
        particles = pf.step(particles, y[i], u[i], generator=g)
        means, covariances = whole_run(system, u, y, known=i + 1)
        close(particles.mean, means[i + 1], 0.03)
        close(particles.covariance, covariances[i + 1], 0.03)


@pytest.mark.filterwarnings("ignore:PF")
def test_the_particles_error_falls_as_the_root_of_their_number(g):
    system = linear(g, 2, 1, 2)
    _, u, y = system.run(g, 5)
    want = textbook(system, u, y)[0][-1]
    sizes, errors = [100, 400, 1600], []
    for N in sizes:
        pf = PF(system.model, system.Q, system.R, particles=N)
        x, _ = record(pf, system.x.expand(100, 2), system.P.expand(100, 2, 2), y, u, generator=g)
        errors.append((x[:, -1] - want).square().mean().sqrt().item())
    slope = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert -0.6 < slope < -0.4


@pytest.mark.parametrize("kind", [EKF, UKF])
def test_the_log_likelihood_of_a_run_is_that_of_its_dense_gaussian(g, kind):
    system = linear(g, 2, 1, 2)
    _, u, y = system.run(g, 6)
    filter = kind(system.model, system.Q, system.R)
    x, P = record(filter, system.x, system.P, y, u)
    got = filter.innovation(x[:-1], y, u, P[:-1]).log_likelihood.sum()
    assert got.item() == pytest.approx(whole_log_likelihood(system, u, y), abs=1e-9)


def test_the_particles_log_likelihood_comes_close(g):
    system = linear(g, 2, 1, 2)
    _, u, y = system.run(g, 6)
    pf = PF(system.model, system.Q, system.R, particles=100_000)
    particles, total = pf.draw(system.x, system.P, generator=g), 0
    for i in range(6):
        total = total + pf.log_likelihood(particles, y[i], u[i])
        particles = pf.step(particles, y[i], u[i], generator=g)
    assert total.item() == pytest.approx(whole_log_likelihood(system, u, y), abs=0.05)
