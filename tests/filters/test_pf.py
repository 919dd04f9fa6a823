"""The particle filter's own promises: draws, weights, resampling, and beliefs of two humps."""

import warnings

import pytest
import torch
from filter_helpers import Still, close, draw, one_step, spd

from pypose_lite.filters import PF, Particles, multinomial, resample, systematic

TOP = 1 - 2**-24  # the largest float32 below 1, which torch.rand may return


def no_noise(n):
    return torch.zeros(n, n)


@pytest.mark.parametrize("n", [2, 4, 8])
def test_a_step_that_does_nothing_keeps_the_covariance(g, n):
    x, P = draw(g, n), spd(g, n)
    got = PF(Still(), particles=200_000)(x, None, torch.zeros(1), P, no_noise(n), generator=g)
    close(got[0], x, 1e-9)
    torch.testing.assert_close(got[1], P, rtol=0.01, atol=0)


def test_draws_are_normal_beyond_their_covariance(g):
    x, P = draw(g, 2), spd(g, 2)
    z = torch.linalg.solve_triangular(
        torch.linalg.cholesky(P),
        (PF(Still(), particles=100_000).draw(x, P, g).x - x).mT,
        upper=False,
    )
    close((z**3).mean(-1), torch.zeros(2), 0.05)
    close((z**4).mean(-1), torch.full((2,), 3.0), 0.1)
    inside = (z.square().sum(0) < 2).double().mean()  # chi-square: 1 - exp(-1)
    close(inside, 1 - torch.exp(torch.tensor(-1.0)), 0.01)


@pytest.mark.filterwarnings("ignore:PF")
def test_the_same_generator_gives_the_same_answer_and_another_does_not(g):
    args, pf = one_step(g), PF(Still())
    runs = [pf(*args, generator=torch.Generator().manual_seed(s))[0] for s in (1, 1, 2)]
    assert torch.equal(runs[0], runs[1]) and not torch.equal(runs[0], runs[2])
    steps = []
    for seed in (1, 1, 2):
        g = torch.Generator().manual_seed(seed)
        steps.append(pf.step(pf.draw(args[0], args[3], g), *args[1:3], *args[4:], generator=g).x)
    assert torch.equal(steps[0], steps[1]) and not torch.equal(steps[0], steps[2])


@pytest.mark.filterwarnings("ignore:PF")
def test_weights_are_the_likelihoods(g):
    x, y, u, _, _, R = one_step(g)
    pf, points = PF(Still(), R=R), draw(g, 7, 2)
    prior = draw(g, 7).log_softmax(-1)
    got = pf.weigh(Particles(points, prior), y, u).w
    like = torch.distributions.MultivariateNormal(points, R).log_prob(y)
    close(got, (prior + like).softmax(-1))
    close(pf.log_likelihood(Particles(points, prior), y, u), (prior + like).logsumexp(-1))


def test_mean_covariance_and_effective_number_are_weighted():
    x, w = torch.tensor([[0.0], [1.0], [4.0]]), torch.tensor([0.5, 0.25, 0.25])
    particles = Particles(x, w.log() + 3)  # weights need not be normalised
    close(particles.mean, torch.tensor([1.25]))
    close(particles.covariance, torch.tensor([[0.5 * 1.5625 + 0.25 * 0.0625 + 0.25 * 7.5625]]))
    close(particles.effective, torch.tensor(1 / 0.375))
    close(Particles(x, torch.zeros(3)).effective, torch.tensor(3.0))


def shares(scheme, w, r):
    """How often each particle is taken, of all that are."""
    particles = Particles(torch.arange(len(w)).double().unsqueeze(-1), w.log())
    taken = resample(Particles(*(p.expand(len(r), *p.shape) for p in particles)), scheme(r))
    return torch.stack([(taken.x == i).double().mean() for i in range(len(w))])


def test_systematic_resampling_is_unbiased(g):
    w = torch.rand(50, generator=g).softmax(-1)
    offsets = ((torch.arange(2000) + 0.5) / 2000).unsqueeze(-1).expand(2000, 50)
    close(shares(systematic, w, offsets), w, 1e-4)


def test_multinomial_resampling_is_unbiased(g):
    w = torch.rand(50, generator=g).softmax(-1)
    close(shares(multinomial, w, torch.rand(20_000, 50, generator=g)), w, 1e-3)


def test_systematic_resampling_takes_each_as_often_as_its_weight_says_or_once_more(g):
    w = torch.rand(100, 30, generator=g).softmax(-1)
    x = torch.arange(30.0).expand(100, 30).unsqueeze(-1)
    taken = resample(Particles(x, w.log()), systematic(torch.rand(100, 30, generator=g)))
    counts = torch.stack([(taken.x == i).sum((-1, -2)) for i in range(30)], -1)
    assert ((counts - 30 * w).abs() < 1 + 1e-9).all()


@pytest.mark.parametrize("scheme", [systematic, multinomial])
@pytest.mark.parametrize("r", [0.0, TOP])
def test_no_draw_points_past_the_end_or_at_a_particle_without_weight(g, monkeypatch, scheme, r):
    """Weights that sum to less than 1 in float32, the largest and the least draw there is."""
    log_w = torch.randn(2000, 1000, generator=g).float()
    log_w[:, [0, 1, -2, -1]] = -1e4
    particles = Particles(torch.arange(1000.0).float().expand(2000, 1000).unsqueeze(-1), log_w)
    monkeypatch.setattr(torch, "rand", lambda *size, **kw: torch.full(*size, r).float())
    pf = PF(Still(), no_noise(1).float())
    after = pf.step(particles, None, torch.zeros(1).float(), scheme=scheme).x
    if scheme is multinomial and r == TOP:
        assert (after == 2).all()
    assert after.min() >= 2 and after.max() <= 997


def test_few_effective_particles_are_resampled_and_many_are_kept(g):
    pf, x = PF(Still(), no_noise(1)), draw(g, 2, 100, 1)
    log_w = torch.stack([torch.zeros(100), -torch.arange(100.0)])
    after = pf.step(Particles(x, log_w), None, torch.zeros(1), generator=g)
    assert torch.equal(after.x[0], x[0])
    close(after.w[1], torch.full((100,), 0.01))
    assert after.x[1].unique().numel() < 15
    close(after.effective, torch.full((2,), 100.0))


@pytest.mark.parametrize("N", [1000, 200_000])
@pytest.mark.parametrize("r", [0.1, 1.0, 10.0])
def test_an_observation_35_sigma_away_warns(g, N, r):
    far = torch.tensor([35 * (1 + r**2) ** 0.5, 0.0])
    args = torch.zeros(2), far, torch.zeros(1), torch.eye(2), no_noise(2), r**2 * torch.eye(2)
    with pytest.warns(UserWarning, match=rf"PF: \d+\.\d of {N} particles are effective"):
        PF(Still(), particles=N)(*args, generator=g)


@pytest.mark.parametrize("r", [1.0, 10.0])
def test_an_observation_three_sigma_away_does_not(g, r):
    near = torch.tensor([3 * (1 + r**2) ** 0.5, 0.0])
    args = torch.zeros(2), near, torch.zeros(1), torch.eye(2), no_noise(2), r**2 * torch.eye(2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        PF(Still())(*args, generator=g)


class Distance(Still):
    """Sees how far the state is from zero, not on which side."""

    def observation(self, state, input, t=None):
        return state.abs()


def test_a_belief_of_two_humps_stays_two_humps(g):
    pf = PF(Distance(), 0.01**2 * torch.eye(1), 0.1**2 * torch.eye(1), particles=2000)
    particles, x, P = pf.draw(torch.zeros(1), torch.eye(1), g), torch.zeros(1), torch.eye(1)
    for _ in range(50):
        y = 1 + 0.1 * draw(g, 1)
        particles = pf.step(particles, y, torch.zeros(1), generator=g)
        x, P = pf(x, y, torch.zeros(1), P, generator=g)
    right = particles.w[particles.x[:, 0] > 0].sum().item()
    assert 0.3 < right < 0.7
    close(particles.x.abs().mean(), torch.tensor(1.0), 0.05)
    assert particles.x.abs().std() < 0.1
    assert particles.x.abs().min() > 0.5
    redrawn = pf.draw(x, P, g).x  # with mean and covariance alone, most are where nothing is
    assert ((redrawn.abs() - 1).abs() > 0.3).double().mean() > 0.4


def test_fewer_particles_than_states_still_draw(g):
    particles = PF(Still(), particles=2).draw(torch.zeros(3), torch.eye(3), g)
    assert particles.x.shape == (2, 3) and particles.x.isfinite().all()
