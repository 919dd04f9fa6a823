"""Process noise that is correlated with the observation's: against the dense Gaussian of a run."""

from typing import NamedTuple

import numpy as np
import pytest
import torch
from filter_helpers import Bend, Linear, close, draw, linear, one_step, record, spd
from torch.autograd import gradcheck

import pypose_lite as pp
from pypose_lite.filters import EKF, PF, UKF, smooth

gaussian = pytest.mark.parametrize("kind", [EKF, UKF])


class Noises(NamedTuple):
    """Covariances of w[i] and v[i], and of the one with the other."""

    Q: torch.Tensor
    R: torch.Tensor
    S: torch.Tensor


def noises(g, n, p, lead=()):
    joint = spd(g, n + p, lead, 0.5)
    return Noises(joint[..., :n, :n], joint[..., n:, n:], joint[..., :n, n:])


def whole_run(system, noise, u, y, known):
    """Mean and covariance of all states given ``y[:known]``, in one dense Gaussian.

    All that is random is one vector: the first state, then w[i] and v[i] of each step together.
    """
    A, B, C, D, c1, c2 = (part.numpy() for part in system[:6])
    n, p, T = len(A), len(C), len(u)
    Q, R, S = (part.numpy() for part in noise)
    joint = np.block([[Q, S], [S.T, R]])
    prior = np.zeros((n + T * (n + p),) * 2)
    prior[:n, :n] = system.P.numpy()
    for i in range(T):
        at = slice(n + i * (n + p), n + (i + 1) * (n + p))
        prior[at, at] = joint
    mean, map_x = system.x.numpy(), np.eye(n, len(prior))
    X, Y = [(mean, map_x)], []
    for i, now in enumerate(u.numpy()):
        at = n + i * (n + p)
        w, v = np.eye(n, len(prior), at), np.eye(p, len(prior), at + n)
        Y.append((C @ mean + D @ now + c2, C @ map_x + v))
        mean, map_x = A @ mean + B @ now + c1, A @ map_x + w
        X.append((mean, map_x))
    means, maps, expected, seen = (
        np.concatenate(z) for z in (*zip(*X, strict=True), *zip(*Y, strict=True))
    )
    rows = ~np.isnan(y.numpy().ravel()) & (np.arange(T * p) < known * p)
    seen, e = seen[rows], y.numpy().ravel()[rows] - expected[rows]
    gain = np.linalg.solve(seen @ prior @ seen.T, seen @ prior @ maps.T).T
    means, P = means + gain @ e, maps @ prior @ maps.T - gain @ seen @ prior @ maps.T
    blocks = np.stack([P[i : i + n, i : i + n] for i in range(0, len(P), n)])
    return torch.tensor(means.reshape(-1, n)), torch.tensor(blocks)


SIZES = [(1, 1, 1), (2, 1, 2), (3, 2, 1), (2, 1, 4)]


@gaussian
@pytest.mark.parametrize("n, m, p", SIZES)
def test_each_step_is_the_run_given_the_observations_so_far(g, kind, n, m, p):
    system, noise = linear(g, n, m, p), noises(g, n, p)
    _, u, y = system.run(g, 8)
    filter = kind(system.model, noise.Q, noise.R, S=noise.S)
    x, P = record(filter, system.x, system.P, y, u)
    for i in range(9):
        means, covariances = whole_run(system, noise, u, y, known=i)
        close(x[i], means[i], 1e-10)
        close(P[i], covariances[i], 1e-10)


@gaussian
def test_the_step_that_the_observation_belongs_to_is_the_one_after_it(g, kind):
    """Not the one before it: with S a step too early or too late the run is another."""
    system, noise = linear(g), noises(g, 2, 2)
    _, u, y = system.run(g, 8)
    means, _ = whole_run(system, noise, u, y, known=8)
    filter, x, P = kind(system.model, noise.Q, noise.R), system.x, system.P
    for i in range(8):  # S forgotten, then S with the observation of the step before
        x, P = filter(x, y[i], u[i], P, S=noise.S if i % 2 else None)
    assert (x - means[8]).abs().max() > 1e-3


@gaussian
def test_update_and_predict_are_the_two_halves(g, kind):
    system, noise = linear(g, 3, 1, 2), noises(g, 3, 2)
    y, u = draw(g, 2), draw(g, 1)
    filter = kind(system.model, noise.Q, noise.R, S=noise.S)
    x, P = filter.update(system.x, y, u, system.P)
    means, covariances = whole_run(system, noise, u[None], y[None], known=1)
    close(x, means[0], 1e-10)
    close(P, covariances[0], 1e-10)
    x, P = filter.predict(x, u, P, y=y)
    close(x, means[1], 1e-10)
    close(P, covariances[1], 1e-10)
    got = kind(system.model).predict(system.x, u, system.P, noise.Q)
    want = filter(system.x, None, u, system.P)  # without an observation S says nothing
    close(got[0], want[0])
    close(got[1], want[1])


@gaussian
@pytest.mark.parametrize("lead", [(), (3,), (2, 2)])
def test_the_smoother_is_the_run_given_all_observations(g, kind, lead):
    system, noise = linear(g, 3, 1, 2), noises(g, 3, 2)
    _, u, y = system.run(g, 8, lead)
    filter = kind(system.model, noise.Q, noise.R, S=noise.S)
    x, P = record(filter, system.x.expand(*lead, 3), system.P.expand(*lead, 3, 3), y, u)
    own = smooth(filter, x, P, y, u)
    given = smooth(kind(system.model), x, P, y, u, noise.Q, noise.R, S=noise.S)
    for i in np.ndindex(lead):
        means, covariances = whole_run(system, noise, u[i], y[i], known=8)
        for xs, Ps in (own, given):
            close(xs[i], means, 1e-9)
            close(Ps[i], covariances, 1e-9)


@gaussian
def test_rows_without_a_measurement_say_nothing_of_the_step_either(g, kind):
    system, noise = linear(g, 2, 1, 3), noises(g, 2, 3)
    _, u, y = system.run(g, 6)
    y[torch.rand(6, 3, generator=g) < 0.5] = torch.nan
    y[2], y[4, 1] = torch.nan, 0.3
    filter = kind(system.model, noise.Q, noise.R, S=noise.S)
    x, P = record(filter, system.x, system.P, y, u)
    for i in range(7):
        means, covariances = whole_run(system, noise, u, y, known=i)
        close(x[i], means[i], 1e-10)
        close(P[i], covariances[i], 1e-10)
    xs, Ps = smooth(filter, x, P, y, u)
    close(xs, means, 1e-9)
    close(Ps, covariances, 1e-9)


@gaussian
def test_in_a_batch_every_member_has_its_own(g, kind):
    x, y, u, P, _, _ = one_step(g, (4,))
    Q, R, S = noises(g, 2, 2, (4,))
    got = kind(Bend())(x, y, u, P, Q, R, S=S)
    only_S = kind(Bend())(x[0], y[0], u[0], P[0], 5 * Q[0], 5 * R[0], S=S)
    for i in range(4):
        want = kind(Bend())(x[i], y[i], u[i], P[i], Q[i], R[i], S=S[i])
        close(got[0][i], want[0])
        close(got[1][i], want[1])
        want = kind(Bend())(x[0], y[0], u[0], P[0], 5 * Q[0], 5 * R[0], S=S[i])
        close(only_S[0][i], want[0])


@gaussian
def test_noises_that_are_not_correlated_change_nothing(g, kind):
    args = one_step(g)
    want, got = kind(Bend())(*args), kind(Bend())(*args, S=torch.zeros(2, 2))
    close(got[0], want[0])
    close(got[1], want[1])


@gaussian
def test_a_step_that_the_observation_tells_wholly_leaves_no_noise(g, kind):
    """w = G v: the next state is as uncertain as this one and the observation make it."""
    system, G, R = linear(g), draw(g, 2, 2), spd(g, 2)
    noise = Noises(G @ R @ G.mT, R, G @ R)
    y, u = draw(g, 2), draw(g, 1)
    x, P = kind(system.model)(system.x, y, u, system.P, noise.Q, R, S=noise.S)
    means, covariances = whole_run(system, noise, u[None], y[None], known=1)
    close(x, means[1], 1e-9)
    close(P, covariances[1], 1e-9)


@gaussian
def test_gradients_reach_it(g, kind):
    x, y, u, P, _, _ = one_step(g)
    args = [a.clone().requires_grad_() for a in (x, y, u, P, *noises(g, 2, 2))]
    assert gradcheck(lambda *a: kind(Bend())(*a[:6], S=a[6]), args)


@gaussian
def test_it_is_a_parameter_like_q_and_r(g, kind):
    noise = noises(g, 2, 2)
    filter = kind(Bend(), noise.Q, noise.R, S=torch.nn.Parameter(noise.S))
    assert "S" in dict(filter.named_parameters()) and "S" in filter.state_dict()
    filter.set_uncertainty(S=torch.zeros(2, 2))
    assert "S" not in dict(filter.named_parameters())
    close(filter.Q, noise.Q, 0)
    assert filter.float().S.dtype == torch.float32


@gaussian
def test_what_cannot_be_is_named(g, kind):
    args, noise = one_step(g), noises(g, 2, 2)
    with pytest.raises(ValueError, match=r"S: expected \(..., n=2, p=2\), got \(3, 2\)"):
        kind(Bend())(*args, S=torch.zeros(3, 2))
    with pytest.raises(ValueError, match=r"\[\[R, S'\], \[S, Q\]\]: expected no negative eigenv"):
        kind(Bend())(*args[:4], noise.Q, noise.R, S=10 * noise.S)


def test_particles_refuse_it_by_name(g):
    with pytest.raises(ValueError, match="S: a PF takes no correlated noises; EKF and UKF do"):
        PF(Bend(), S=torch.zeros(2, 2))
    with pytest.raises(TypeError, match="S"):
        PF(Bend())(*one_step(g), S=torch.zeros(2, 2))


def test_float32_stays_float32(g):
    system, noise = linear(g), noises(g, 2, 2)
    small = Linear(*(part.float() for part in system))
    want = EKF(system.model, *noise[:2], S=noise.S)(
        system.x, draw(g, 2) * 0, torch.zeros(1), system.P
    )
    filter = EKF(pp.LTI(*small[:6]), *noise[:2], S=noise.S).float()
    x, P = filter(small.x, torch.zeros(2).float(), torch.zeros(1).float(), small.P)
    assert x.dtype == P.dtype == torch.float32
    close(x.double(), want[0], 1e-4)
    close(P.double(), want[1], 1e-4)
