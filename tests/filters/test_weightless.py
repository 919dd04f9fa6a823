"""Particles that explain nothing have weight 0, and a belief without any other is an error."""

import math

import pytest
import torch
from filter_helpers import Still, close, draw, linear
from torch.autograd import gradcheck

import pypose_lite as pp
from pypose_lite.filters import PF, Particles, multinomial, resample, systematic

pytestmark = pytest.mark.filterwarnings("ignore:PF")
INF, NAN = math.inf, math.nan
ONE = torch.eye(1, dtype=torch.float64)


class Partial(Still):
    """Seen through a function that is not defined everywhere, moved by one that is, or is not."""

    def __init__(self, see=torch.log, move=lambda x: x):
        super().__init__()
        self.see, self.move_by = see, move

    def state_transition(self, state, input, t=None):
        return self.move_by(state)

    def observation(self, state, input, t=None):
        return self.see(state)


FUNCTIONS = {
    "log": torch.log,  # NaN below 0
    "root": torch.sqrt,  # NaN below 0, and its slope, too
    "inverse root": lambda x: 1 / x.clamp(min=0).sqrt(),  # infinite below 0
    "gap": lambda x: torch.where(x > 0, x, torch.nan),
}
undefined = pytest.mark.parametrize("see", FUNCTIONS.values(), ids=FUNCTIONS)


def cloud(g, N=1000, below=8, lead=()):
    """Particles of different weights, some of them below 0, at random places."""
    x = 0.2 + torch.rand(*lead, N, 1, generator=g)
    places = torch.rand(*lead, N, generator=g).argsort(-1) < below
    x = torch.where(places.unsqueeze(-1), -x, x)
    return Particles(x, draw(g, *lead, N)), places


def only(particles, kept):
    return Particles(particles.x[kept], particles.log_w[kept])


@undefined
@pytest.mark.parametrize("below", [0, 1, 8, 999])
def test_where_g_is_not_defined_particles_have_weight_0(g, see, below):
    """And all others the weights that they have without them."""
    particles, lost = cloud(g, below=below)
    pf, args = PF(Partial(see), R=0.5 * ONE), (torch.zeros(1), torch.zeros(1))
    got, want = pf.weigh(particles, *args), pf.weigh(only(particles, ~lost), *args)
    assert (got.w[lost] == 0).all() and got.w[~lost].min() > 0
    close(got.w[~lost], want.w)
    close(got.mean, want.mean)
    close(got.covariance, want.covariance)
    close(got.effective, want.effective, 1e-9)
    prior = particles.w[~lost].sum().log()
    like = pf.log_likelihood(only(particles, ~lost), *args)
    close(pf.log_likelihood(particles, *args), prior + like)


def test_a_difference_that_is_not_defined_counts_as_none(g):
    """The residual, not g, is NaN: beyond half a turn, say."""

    def close_by(y, z):
        return torch.where((y - z).abs() < 0.6, y - z, torch.nan)

    particles = Particles(torch.rand(50, 1, generator=g), draw(g, 50))
    kept, zero = particles.x[:, 0] < 0.6, torch.zeros(1)
    pf = PF(Still(), R=ONE, residual=close_by)
    got, want = pf.weigh(particles, zero, zero), pf.weigh(only(particles, kept), zero, zero)
    assert 0 < kept.sum() < 50 and (got.w[~kept] == 0).all()
    close(got.w[kept], want.w)
    with pytest.raises(ValueError, match="y has no density at any of them"):
        pf.weigh(particles, zero - 9, zero)


@undefined
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_call_is_that_of_the_particles_that_count(g, see, dtype):
    """With the same draws, weighed and averaged by hand."""
    pf, seed = PF(Partial(see), 0.01 * ONE.to(dtype), 0.1 * ONE.to(dtype)), torch.Generator()
    x, y, P = torch.ones(1).to(dtype), see(torch.full((1,), 1.2)).to(dtype), 0.18 * ONE.to(dtype)
    points = pf.draw(x, P, seed.manual_seed(4)).x[:, 0]
    kept = points[points > 0]
    assert 0 < (points <= 0).sum() < 100
    like = torch.exp(-((y - see(kept)) ** 2) / 0.2)
    mean = (like @ kept) / like.sum()
    P_after = (like @ (kept - mean) ** 2) / like.sum()
    got = pf(x, y, x, P, generator=seed.manual_seed(4))
    tolerance = 1e-5 if dtype == torch.float32 else 1e-12
    assert got[0].dtype == dtype
    close(got[0], mean.reshape(1), tolerance)
    close(got[1], (P_after + 0.01).reshape(1, 1), tolerance)
    got = pf.update(x, y, x, P, generator=seed.manual_seed(4))
    close(got[0], mean.reshape(1), tolerance)
    close(got[1], P_after.reshape(1, 1), tolerance)
    e = pf.innovation(x, y, x, P, generator=seed.manual_seed(4))
    z = see(kept)
    close(e.value, y - z.mean(), 10 * tolerance)
    close(e.covariance, (z - z.mean()).square().mean().reshape(1, 1) + 0.1, 10 * tolerance)


@undefined
@pytest.mark.parametrize("scheme", [systematic, multinomial])
@pytest.mark.parametrize("below", [8, 700, 999])
def test_a_step_leaves_them_behind(g, see, scheme, below):
    particles, _ = cloud(g, below=below)
    pf = PF(Partial(see), 0 * ONE, 0.5 * ONE)
    after = pf.step(particles, torch.zeros(1), torch.zeros(1), generator=g, scheme=scheme)
    assert (after.x[after.w > 0] > 0).all()
    assert after.mean.isfinite().all() and after.covariance.isfinite().all()


@undefined
def test_in_a_batch_every_member_has_its_own(g, see):
    particles, lost = cloud(g, N=40, below=5, lead=(2, 3))
    lost[0, 1], particles.x[0, 1] = False, particles.x[0, 1].abs()  # one member is whole
    pf, zero = PF(Partial(see), R=0.5 * ONE), torch.zeros(1)
    got = pf.weigh(particles, zero, zero)
    for i in [(i, j) for i in range(2) for j in range(3)]:
        want = pf.weigh(Particles(particles.x[i], particles.log_w[i]), zero, zero)
        close(got.w[i], want.w)
        assert (got.w[i][lost[i]] == 0).all()


def test_rows_of_y_that_are_missing_need_no_g(g):
    """g's second row is NaN, but it was not measured."""
    model = Partial(lambda x: torch.cat([x, torch.full_like(x, NAN)], -1))
    pf, x, P = PF(model, 0 * ONE, torch.eye(2)), torch.ones(1), ONE
    got = pf(x, torch.tensor([1.3, NAN]), x, P, generator=torch.Generator().manual_seed(1))
    want = PF(Still(), 0 * ONE, ONE)(
        x, torch.tensor([1.3]), x, P, generator=torch.Generator().manual_seed(1)
    )
    close(got[0], want[0])
    close(got[1], want[1])


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_weights_of_minus_infinity_are_taken_and_stay(g, dtype):
    particles, lost = cloud(g, below=300)
    x, log_w = particles.x.abs().to(dtype), particles.log_w.masked_fill(lost, -INF).to(dtype)
    particles, pf, zero = Particles(x, log_w), PF(Still(), ONE.to(dtype), ONE.to(dtype)), x[0]
    weighed = pf.weigh(particles, zero, zero)
    assert (weighed.w[lost] == 0).all()
    close(weighed.w[~lost], pf.weigh(only(particles, ~lost), zero, zero).w, 1e-7)
    moved = pf.move(particles, zero, 0 * ONE.to(dtype))
    assert torch.equal(moved.log_w, log_w)
    like = pf.log_likelihood(particles, zero, zero)
    close(like, pf.log_likelihood(only(particles, ~lost), zero, zero), 1e-6)
    for scheme in (systematic, multinomial):
        r = 1 - torch.rand(1000, generator=g).to(dtype)
        taken = resample(particles, scheme(r))
        assert torch.isin(taken.x, x[~lost]).all() and not torch.isin(taken.x, x[lost]).any()
        assert pf.step(particles, None, zero, generator=g, scheme=scheme).x.isfinite().all()


def test_a_step_whose_f_is_not_defined_where_particles_have_no_weight(g):
    particles, lost = cloud(g)
    pf, zero = PF(Partial(torch.log, torch.sqrt), 0 * ONE, ONE), torch.zeros(1)
    weighed = pf.weigh(particles, zero, zero)
    moved = pf.move(weighed, zero)
    close(moved.x[~lost], particles.x[~lost].sqrt())
    close(moved.mean, weighed.w[~lost] @ particles.x[~lost].sqrt())
    mean, P = pf(torch.ones(1), zero, zero, 0.2 * ONE, generator=g)
    assert mean.isfinite().all() and P.isfinite().all()


def test_a_step_whose_f_is_not_defined_where_they_have_is_an_error(g):
    pf, one = PF(Partial(torch.exp, torch.log), 0 * ONE, ONE), torch.ones(1)
    for call in (
        lambda: pf(one, one, one, ONE, generator=g),
        lambda: pf.predict(one, one, ONE, generator=g),
        lambda: pf.move(pf.draw(one, ONE, g), one),
    ):
        with pytest.raises(ValueError, match="state_transition: expected finite numbers, got nan"):
            call()


CALLS = {
    "the call": lambda pf, c, y: pf(c.x.mean(-2), y, y, 1e-4 * ONE),
    "update": lambda pf, c, y: pf.update(c.x.mean(-2), y, y, 1e-4 * ONE),
    "innovation": lambda pf, c, y: pf.innovation(c.x.mean(-2), y, y, 1e-4 * ONE),
    "weigh": lambda pf, c, y: pf.weigh(c, y, y),
    "step": lambda pf, c, y: pf.step(c, y, y),
    "log_likelihood": lambda pf, c, y: pf.log_likelihood(c, y, y),
}


@undefined
@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_where_g_is_nowhere_defined_the_error_says_so(g, see, name, dtype):
    pf = PF(Partial(see), ONE.to(dtype), ONE.to(dtype), particles=50)
    particles = Particles(-torch.ones(50, 1).to(dtype), torch.zeros(50).to(dtype))
    args = pf, particles, torch.zeros(1).to(dtype)
    with pytest.raises(ValueError, match=r"all 50 particles have weight 0 \(g is not finite there"):
        CALLS[name](*args) if dtype == torch.float64 or name in ("weigh", "step") else _f32(*args)


def _f32(pf, particles, y):
    pf.weigh(particles, y, y)


@pytest.mark.parametrize("name", ["weigh", "step", "log_likelihood"])
@pytest.mark.parametrize("member", [(0,), (2,)])
def test_the_error_names_the_member_of_the_batch(g, name, member):
    pf = PF(Partial(torch.log), ONE, ONE)
    particles, _ = cloud(g, N=30, lead=(3,))
    particles.x[member] = -1.0
    text = rf"all 30 particles of member \({member[0]},\) of the batch have weight 0"
    with pytest.raises(ValueError, match=text):
        CALLS[name](pf, particles, torch.zeros(1))


@pytest.mark.parametrize("lead", [(), (2,), (2, 3)])
def test_no_weight_at_all_is_refused_by_name(g, lead):
    pf, zero = PF(Still(), ONE, ONE), torch.zeros(1)
    log_w = torch.zeros(*lead, 20)
    log_w[tuple(size - 1 for size in lead)] = -INF
    gone = Particles(draw(g, *lead, 20, 1), log_w)
    calls = [
        lambda: pf.weigh(gone, zero, zero),
        lambda: pf.step(gone, zero, zero),
        lambda: pf.step(gone, None, zero),
        lambda: pf.move(gone, zero),
        lambda: pf.log_likelihood(gone, zero, zero),
        lambda: pf.moments(gone),
        lambda: resample(gone, systematic(torch.ones(20))),
        lambda: resample(gone, multinomial(torch.rand(20, generator=g))),
        lambda: gone.w,
        lambda: gone.mean,
        lambda: gone.covariance,
        lambda: gone.effective,
    ]
    for call in calls:
        with pytest.raises(ValueError, match=r"weights: all 20 particles.* have weight 0 \(log_w"):
            call()


@pytest.mark.parametrize("bad", [NAN, INF])
def test_weights_that_are_no_numbers_are_refused_by_name(g, bad):
    log_w = torch.zeros(20)
    log_w[3] = bad
    pf, zero, odd = PF(Still(), ONE, ONE), torch.zeros(1), Particles(draw(g, 20, 1), log_w)
    for call in (
        lambda: pf.weigh(odd, zero, zero),
        lambda: pf.step(odd, None, zero),
        lambda: resample(odd, systematic(torch.ones(20))),
        lambda: odd.mean,
    ):
        with pytest.raises(ValueError, match=rf"weights: expected finite numbers, got {bad} at"):
            call()


@pytest.mark.parametrize("dtype, far", [(torch.float32, 1e25), (torch.float64, 1e200)])
def test_an_observation_whose_density_is_zero_everywhere_is_an_error(g, dtype, far):
    """The square of the distance is beyond the largest number."""
    pf = PF(Still(), ONE.to(dtype), ONE.to(dtype))
    x, y = torch.zeros(1).to(dtype), torch.full((1,), far).to(dtype)
    with pytest.raises(ValueError, match="y has no density at any of them"):
        pf(x, y, x, ONE.to(dtype), generator=g)


@pytest.mark.parametrize("positions", [1.5, -0.1, NAN])
def test_positions_outside_of_the_weights_are_refused(g, positions):
    particles = Particles(draw(g, 5, 1), torch.zeros(5))
    with pytest.raises(ValueError, match=r"positions: expected numbers in \(0, 1\]"):
        resample(particles, torch.full((5,), positions))


def test_a_position_of_zero_falls_on_the_first_that_has_a_weight():
    particles = Particles(torch.arange(3.0).unsqueeze(-1), torch.tensor([-INF, 0.0, 0.0]))
    assert (resample(particles, torch.zeros(3)).x == 1).all()


@undefined
def test_gradients_do_not_see_what_has_no_weight(g, see):
    """Neither where g is not defined, nor where its slope is not."""
    particles, _ = cloud(g, N=12, below=4)
    pf, zero = PF(Partial(see), particles=12), torch.zeros(1)

    def run(x, log_w, y, Q, R):
        weighed = pf.weigh(Particles(x, log_w), y, zero, R)
        return (*pf.moments(pf.move(weighed, zero, Q, generator=torch.Generator())), weighed.w)

    args = (*particles, torch.zeros(1), ONE, ONE)
    assert gradcheck(run, [a.clone().requires_grad_() for a in args])


@undefined
def test_gradients_of_the_call_are_finite_and_right(g, see):
    pf = PF(Partial(see), particles=40)

    def call(x, y, P, Q, R):
        return pf(x, y, x, P, Q, R, generator=torch.Generator().manual_seed(6))

    args = torch.full((1,), 0.6), see(torch.ones(1)), 0.2 * ONE, 0.1 * ONE, 0.3 * ONE
    points = pf.draw(args[0], args[2], torch.Generator().manual_seed(6)).x
    assert (points < 0).any() and points.abs().min() > 1e-3
    assert gradcheck(call, [a.clone().requires_grad_() for a in args])


def test_the_sum_over_particles_with_a_weight_is_still_the_exact_filter(g):
    """Half of the particles are cut off by a sensor that works on one side only."""
    system = linear(g, 1, 1, 1)
    pf = PF(pp.LTI(*system[:6]), system.Q, system.R, particles=200_000)
    particles = pf.draw(system.x, system.P, g)
    y = torch.zeros(1)

    def half(state):
        return torch.where(state > system.x, system.C[0] * state, torch.nan)

    got = pf.weigh(particles, y, torch.zeros(1), system.R, g=half).mean
    grid = torch.linspace(0, 8, 20001) * system.P[0].sqrt() + system.x
    e = y - system.C[0] * grid
    density = torch.exp(-((grid - system.x) ** 2) / system.P[0] / 2 - e**2 / system.R[0] / 2)
    density[0] = density[0] / 2
    close(got, ((density @ grid) / density.sum()).reshape(1), 0.01)
