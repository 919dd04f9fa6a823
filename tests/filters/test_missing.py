"""What was not measured does not count: no y, rows of y, and angles that wrap."""

import math

import pytest
import scipy.stats
import torch
from filter_helpers import FILTERS, Bend, Still, close, draw, linear, one_step

import pypose_lite as pp
from pypose_lite.filters import EKF, PF, UKF

pytestmark = pytest.mark.filterwarnings("ignore:PF")
every = pytest.mark.parametrize("kind", FILTERS.values(), ids=FILTERS)
NAN = torch.nan


def run(filter, *args, method="__call__"):
    seed = {"generator": torch.Generator().manual_seed(1)} if isinstance(filter, PF) else {}
    return getattr(filter, method)(*args, **seed)


@every
def test_no_observation_predicts_only(g, kind):
    x, _, u, P, Q, R = one_step(g, (3,))
    want = run(kind(Bend(), Q), x, u, P, method="predict")
    for y in (None, torch.full((3, 2), NAN)):
        got = run(kind(Bend()), x, y, u, P, Q, R)
        close(got[0], want[0])
        close(got[1], want[1])


@every
@pytest.mark.parametrize("rows", [[0], [1], [2], [0, 2], [1, 2], [0, 1, 2]])
def test_rows_that_are_nan_are_as_if_they_did_not_exist(g, kind, rows):
    system = linear(g, 2, 1, 3)
    y, u = draw(g, 3), draw(g, 1)
    holes = torch.full((3,), NAN)
    holes[rows] = y[rows]
    A, B, C, D, c1, c2, Q, R, x, P = system
    small = pp.LTI(A, B, C[rows], D[rows], c1, c2[rows])
    want = run(kind(small), x, y[rows], u, P, Q, R[rows][:, rows])
    got = run(kind(system.model), x, holes, u, P, Q, R)
    close(got[0], want[0])
    close(got[1], want[1])


@every
def test_in_a_batch_each_member_has_its_own_rows(g, kind):
    x, y, u, P, Q, R = one_step(g, (4,))
    y = y.masked_fill(torch.tensor([[0, 0], [0, 1], [1, 0], [1, 1]]).bool(), NAN)
    filter = PF(Bend(), particles=16) if kind is PF else kind(Bend())
    got = run(filter, x, y, u, P, Q, R)
    g = {"generator": torch.Generator().manual_seed(1)} if kind is PF else {}
    for i in range(4):
        want = filter(x[i], y[i], u[i], P[i], Q[i], R[i], **g)
        close(got[0][i], want[0])
        close(got[1][i], want[1])


@pytest.mark.parametrize("kind", [EKF, UKF])
@pytest.mark.parametrize("rows", [[0], [0, 2], [0, 1, 2]])
def test_innovation_and_likelihood_are_those_of_the_rows_that_were_seen(g, kind, rows):
    system = linear(g, 2, 1, 3)
    y, u, holes = draw(g, 3), draw(g, 1), torch.full((3,), NAN)
    holes[rows] = y[rows]
    got = kind(system.model).innovation(system.x, holes, u, system.P, system.R)
    C, D, c2, P, R = system.C, system.D, system.c2, system.P, system.R
    e, S = y - C @ system.x - D @ u - c2, C @ P @ C.mT + R
    close(got.value[rows], e[rows])
    close(got.covariance[rows][:, rows], S[rows][:, rows])
    assert got.known.tolist() == [i in rows for i in range(3)]
    want = scipy.stats.multivariate_normal(None, S[rows][:, rows]).logpdf(e[rows])
    assert got.log_likelihood.item() == pytest.approx(want, abs=1e-12)
    unseen = kind(system.model).innovation(system.x, NAN * y, u, P, R)
    assert unseen.log_likelihood == 0


def test_the_particles_innovation_and_likelihood_skip_rows_too(g):
    system = linear(g, 2, 1, 3)
    A, B, C, D, c1, c2, Q, R, x, P = system
    u, y = draw(g, 1), torch.tensor([0.3, NAN, -0.2])
    pf, rows = PF(system.model, R=R, particles=100_000), [0, 2]
    got = run(pf, x, y, u, P, method="innovation")
    S, e = (C @ P @ C.mT + R)[rows][:, rows], (y - C @ x - D @ u - c2)[rows]
    close(got.value[rows], e, 1e-9)
    close(got.covariance[rows][:, rows], S, 1e-9)  # the draws have exactly the covariance P
    likelihood = pf.log_likelihood(pf.draw(x, P, g), y, u)
    want = scipy.stats.multivariate_normal(None, S).logpdf(e)
    assert likelihood.item() == pytest.approx(want, abs=0.02)


def test_kept_particles_without_an_observation_are_only_moved(g):
    x, _, u, P, Q, R = one_step(g)
    pf = PF(Bend(), Q, R)
    particles = pf.draw(x, P, g)
    for y in (None, torch.full((2,), NAN)):
        close(pf.step(particles, y, u, generator=g).effective, torch.tensor(1000.0), 1e-9)


class Compass(Still):
    """A heading that may have any size, seen as an angle within pi of zero."""

    def observation(self, state, input, t=None):
        return torch.atan2(state.sin(), state.cos())


def wrapped(y, z):
    return torch.atan2((y - z).sin(), (y - z).cos())


@every
@pytest.mark.parametrize("heading", [math.pi - 0.01, -math.pi + 0.01, 3 * math.pi - 0.02])
@pytest.mark.parametrize("turn", [0.3, -0.3])
def test_a_residual_that_wraps_sees_angles_across_the_cut(g, kind, heading, turn):
    """The same step as that of a heading far from the cut, seen as it is."""
    x, u, P, Q, R = (
        torch.tensor([heading]),
        torch.zeros(1),
        *(torch.eye(1) * s for s in (0.04, 0, 0.1)),
    )
    y = wrapped(x + turn, torch.zeros(1))
    got = run(kind(Compass(), Q, R, residual=wrapped), x, y, u, P)
    want = run(kind(Still(), Q, R), 0 * x, torch.tensor([turn]), u, P)
    close(got[0] - heading, want[0], 1e-9)
    close(got[1], want[1], 1e-9)
    e = run(kind(Compass(), Q, R, residual=wrapped), x, y, u, P, method="innovation")
    close(e.value, torch.tensor([turn]), 1e-9)
    close(e.covariance, P + R, 1e-9)


@pytest.mark.parametrize("kind", [EKF, UKF])
def test_without_it_they_are_a_turn_apart(kind):
    x, P, R = torch.tensor([math.pi - 0.01]), 1e-6 * torch.eye(1), 0.1 * torch.eye(1)
    e = kind(Compass(), R=R).innovation(x, -x, torch.zeros(1), P)
    assert abs(e.value.item()) > 6
