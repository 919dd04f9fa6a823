"""A batched call is the stack of single calls, whichever argument has the batch."""

import itertools

import pytest
import torch
from filter_helpers import BATCHES, FILTERS, Bend, close, draw, linear, one_step, record, spd

import pypose_lite as pp
from pypose_lite.filters import EKF, PF, UKF, smooth

pytestmark = pytest.mark.filterwarnings("ignore:PF")
NAMES = ["x", "y", "u", "P", "Q", "R"]


def call(name, model, args, seed=1):
    """One step; 16 particles of 2 numbers draw from a generator what 16 single calls would."""
    if name != "PF":
        return FILTERS[name](model)(*args)
    g = torch.Generator().manual_seed(seed) if isinstance(seed, int) else seed
    return PF(model, particles=16)(*args, generator=g)


def members(lead, args):
    """The arguments of each member of the batch."""
    cores = [1, 1, 1, 2, 2, 2]
    full = [a.expand(*lead, *a.shape[a.ndim - core :]) for a, core in zip(args, cores)]
    for i in itertools.product(*map(range, lead)):
        yield [a[i] for a in full]


def compare(name, model, lead, args, single_model=None):
    x, P = call(name, model, args)
    assert x.shape == (*lead, 2)
    assert P.shape == (*lead, 2, 2)
    g = torch.Generator().manual_seed(1)
    singles = [call(name, single_model or model, member, g) for member in members(lead, args)]
    close(x.reshape(-1, 2), torch.stack([x for x, _ in singles]))
    close(P.reshape(-1, 2, 2), torch.stack([P for _, P in singles]))


@pytest.mark.parametrize("lead", BATCHES)
@pytest.mark.parametrize("name", FILTERS)
def test_a_batch_is_the_stack_of_single_calls(g, name, lead):
    compare(name, Bend(), lead, one_step(g, lead))


@pytest.mark.parametrize("which", NAMES)
@pytest.mark.parametrize("name", ["EKF", "UKF"])
def test_any_argument_alone_may_have_the_batch(g, name, which):
    args, batched = one_step(g), one_step(g, (5,))
    i = NAMES.index(which)
    compare(name, Bend(), (5,), [*args[:i], batched[i], *args[i + 1 :]])


@pytest.mark.parametrize("which", ["x", "P"])
def test_particles_are_drawn_for_a_batch_of_beliefs(g, which):
    args, batched = one_step(g), one_step(g, (5,))
    i = NAMES.index(which)
    compare("PF", Bend(), (5,), [*args[:i], batched[i], *args[i + 1 :]])


@pytest.mark.parametrize("name", FILTERS)
def test_batches_of_different_arguments_broadcast(g, name):
    x, y, u, P, Q, R = one_step(g)
    x, P, y = draw(g, 2, 1, 2), spd(g, 2, (3,), 0.1), draw(g, 3, 2)
    compare(name, Bend(), (2, 3), [x, y, u, P, Q, R])


@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("size", [2, 5, 16])
def test_a_models_own_batch_is_not_mistaken_for_the_points(g, name, size):
    """2 is n, 5 the number of sigma points, 16 that of the particles."""
    systems = [linear(g) for _ in range(size)]
    together = pp.LTI(*(torch.stack(parts) for parts in list(zip(*systems, strict=True))[:6]))
    x, y, u, P, Q, R = one_step(g)
    if name == "PF":  # so that each member has draws of its own
        x = x.expand(size, 2)
    got_x, got_P = call(name, together, (x, y, u, P, Q, R))
    g = torch.Generator().manual_seed(1)
    for i, system in enumerate(systems):
        want_x, want_P = call(name, system.model, (x[i] if x.ndim > 1 else x, y, u, P, Q, R), g)
        close(got_x[i], want_x)
        close(got_P[i], want_P)


def test_particles_shared_by_a_batch_of_models_go_through_each(g):
    systems = [linear(g) for _ in range(16)]
    together = pp.LTI(*(torch.stack(parts) for parts in list(zip(*systems, strict=True))[:6]))
    x, _, u, P, Q, _ = one_step(g)
    got_x, _ = PF(together, particles=16).predict(x, u, P, Q, generator=g)
    for i, system in enumerate(systems):
        close(got_x[i], system.model.transition(x, u))  # the draws have exactly the mean x


@pytest.mark.parametrize("lead", [(3,), (2, 3)])
def test_kept_particles_of_a_batch_are_those_of_single_runs(g, lead):
    pf = PF(Bend(), particles=16)
    x, y, u, P, Q, R = one_step(g, lead)
    particles = pf.draw(x, P, generator=torch.Generator().manual_seed(1))
    after = pf.step(particles, y, u, Q, R, generator=torch.Generator().manual_seed(2))
    weighed, g = pf.weigh(particles, y, u, R), torch.Generator().manual_seed(1)
    for i in itertools.product(*map(range, lead)):
        single = pf.draw(x[i], P[i], generator=g)
        close(single.x, particles.x[i])
        single = pf.weigh(single, y[i], u[i], R[i])
        close(single.w, weighed.w[i])
        close(single.mean, weighed.mean[i])
        close(single.covariance, weighed.covariance[i])
        likelihood = pf.log_likelihood(pf.draw(x[i], P[i]), y[i], u[i], R[i])
        assert likelihood.shape == ()
    assert after.x.shape == (*lead, 16, 2)
    assert pf.log_likelihood(particles, y, u, R).shape == lead


@pytest.mark.parametrize("kind", [EKF, UKF])
def test_smoothing_a_batch_is_smoothing_each(g, kind):
    filter, T = kind(Bend()), 4
    x, _, _, P, Q, R = one_step(g, (3,))
    u, y = draw(g, 3, T, 1), draw(g, 3, T, 2)
    xs, Ps = record(filter, x, P, y, u, Q, R)
    got_x, got_P = smooth(filter, xs, Ps, y, u, Q, R)
    for i in range(3):
        want_x, want_P = smooth(filter, xs[i], Ps[i], y[i], u[i], Q[i], R[i])
        close(got_x[i], want_x)
        close(got_P[i], want_P)


class Swing(pp.NLS):
    """Another model at every time step."""

    def state_transition(self, state, input, t=None):
        return state * (0.3 * t).cos() + input

    def observation(self, state, input, t=None):
        return state + t * input


@pytest.mark.parametrize("name", FILTERS)
def test_a_time_for_each_member(g, name):
    x, y, u, P, Q, R = one_step(g, (3,))
    steps = torch.tensor([0, 4, 9])
    filter = PF(Swing(), particles=16) if name == "PF" else FILTERS[name](Swing())
    seed = {"generator": torch.Generator().manual_seed(1)} if name == "PF" else {}
    got, _ = filter(x, y, u, P, Q, R, t=steps, **seed)
    if seed:
        seed["generator"].manual_seed(1)
    for i, t in enumerate(steps):
        want, _ = filter(x[i], y[i], u[i], P[i], Q[i], R[i], t=t, **seed)
        close(got[i], want)


@pytest.mark.parametrize("lead", [(), (2,)])
@pytest.mark.parametrize("kind", [EKF, UKF])
def test_a_run_is_smoothed_at_its_own_time_steps(g, kind, lead):
    x, _, _, P, Q, R = one_step(g, lead)
    u, y, filter = draw(g, *lead, 3, 1), draw(g, *lead, 3, 2), kind(Swing(), Q, R)
    xs, Ps = [x], [P]
    for i in range(3):
        x, P = filter(xs[i], y[..., i, :], u[..., i, :], Ps[i], t=7 + i)
        xs.append(x)
        Ps.append(P)
    got_x, got_P = smooth(filter, torch.stack(xs, -2), torch.stack(Ps, -3), y, u, t=7)
    x, P = xs[3], Ps[3]
    for i in (2, 1, 0):
        mean, cov = filter.update(xs[i], y[..., i, :], u[..., i, :], Ps[i], t=7 + i)
        ahead, G, left = filter.reverse(mean, u[..., i, :], cov, t=7 + i)
        x, P = mean + pp.bmv(G, x - ahead), left + G @ P @ G.mT
        close(got_x[..., i, :], x)
        close(got_P[..., i, :, :], P)
