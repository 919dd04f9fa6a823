"""Angles in the state: a filter across the cut is the same filter on the unwrapped line."""

import math

import pytest
import torch
from filter_helpers import FILTERS, close, draw, record, spd
from torch.autograd import gradcheck

import pypose_lite as pp
from pypose_lite.filters import EKF, PF, UKF, Particles, angles, nees, smooth, wrap

pytestmark = pytest.mark.filterwarnings("ignore:PF")
every = pytest.mark.parametrize("kind", FILTERS.values(), ids=FILTERS)
gaussian = pytest.mark.parametrize("kind", [EKF, UKF])
TURN = 2 * math.pi


def near(a, b, atol=1e-9):
    """Equal but for whole turns of the first two of four numbers, which are angles."""
    d = a - b
    turns = (d[..., :2] / TURN).round()
    close(torch.cat([d[..., :2] - TURN * turns, d[..., 2:]], -1), torch.zeros_like(d), atol)


class Arm(pp.NLS):
    """Two joint angles and their rates, seen as an angle, a rate and an angle; wraps or not."""

    vectorized = True

    def __init__(self, wraps):
        super().__init__()
        self.wraps = wraps

    def cut(self, angle):
        return torch.atan2(angle.sin(), angle.cos()) if self.wraps else angle

    def state_transition(self, state, input, t=None):
        a, b, da, db = state.unbind(-1)
        rates = da + 0.1 * (a + b).sin() + input[..., 0], db + 0.1 * a.cos()
        return torch.stack([self.cut(a + rates[0]), self.cut(b + rates[1]), *rates], -1)

    def observation(self, state, input, t=None):
        a, b, da, db = state.unbind(-1)
        return torch.stack([self.cut(a + b), db + 0.3 * da, self.cut(a)], -1)


def make(kind, wraps, **options):
    noise = spd(torch.Generator().manual_seed(3), 4, scale=0.01), 0.05 * torch.eye(3)
    if wraps:
        options |= {"residual": angles(0, 2), "residual_x": angles(0, 1)}
    extra = {"particles": 64} if kind is PF else {}
    return kind(Arm(wraps), *noise, **extra, **options)


def runs(g, lead=(), T=12):
    """A belief, inputs, and observations of the line; the same observations within pi."""
    x = torch.tensor([3.0, -3.0, 0.4, -0.3]) + 0.1 * draw(g, *lead, 4)
    P, u, arm = spd(g, 4, lead, 0.02), 0.2 * draw(g, *lead, T, 1), Arm(wraps=False)
    state, y = x + 0.1 * draw(g, *lead, 4), []
    for i in range(T):
        y.append(arm.observe(state, u[..., i, :]) + 0.1 * draw(g, *lead, 3))
        state = arm.transition(state, u[..., i, :]) + 0.05 * draw(g, *lead, 4)
    y = torch.stack(y, -2)
    assert (y[..., 0].abs() > math.pi).any() or (y[..., 2].abs() > math.pi).any()
    return x, P, u, y, torch.where(torch.tensor([True, False, True]), wrap(y), y)


def seeded(kind):
    return {"generator": torch.Generator().manual_seed(1)} if kind is PF else {}


@every
@pytest.mark.parametrize("lead", [(), (5,), (2, 3)])
def test_a_run_across_the_cut_is_the_run_on_the_line(g, kind, lead):
    x, P, u, line, cut = runs(g, lead)
    want = record(make(kind, False), x, P, line, u, **seeded(kind))
    got = record(make(kind, True), x, P, cut, u, **seeded(kind))
    assert (want[0][..., :2].abs() > math.pi).any()  # it does cross
    near(got[0], want[0])
    close(got[1], want[1], 1e-9)


def of_one_pair(*which):
    """As users write it: for two vectors, filled in place."""

    def difference(a, b):
        d = a - b
        for i in which:
            d[i] = torch.atan2(d[i].sin(), d[i].cos())
        return d

    return difference


def of_one_set(points, w):
    a, b = (torch.atan2(w @ points[:, i].sin(), w @ points[:, i].cos()) for i in (0, 1))
    return torch.cat([torch.stack([a, b]), w @ points[:, 2:]])


@every
@pytest.mark.parametrize("lead", [(), (5,), (2,), (3,), (2, 3)])
def test_differences_and_means_may_be_written_for_one_vector(g, kind, lead):
    x, P, u, _, cut = runs(g, lead)
    written = {"residual": of_one_pair(0, 2), "residual_x": of_one_pair(0, 1)}
    noise = make(kind, True).Q, make(kind, True).R
    extra = {"particles": 64} if kind is PF else {}
    for y, u_i in ((cut[..., 0, :], u[..., 0, :]), (None, u[..., 0, :])):
        want = make(kind, True)(x, y, u_i, P, **seeded(kind))
        got = kind(Arm(True), *noise, **extra, **written)(x, y, u_i, P, **seeded(kind))
        near(got[0], want[0])
        close(got[1], want[1], 1e-9)
        own = kind(Arm(True), *noise, **extra, **written, mean_x=of_one_set)
        near(own(x, y, u_i, P, **seeded(kind))[0], want[0], 0.02)  # another mean, nearly the same
    filter = kind(Arm(True), *noise, **written)
    if kind is not PF:
        want = smooth(make(kind, True), *record(make(kind, True), x, P, cut, u), cut, u)
        got = smooth(filter, *record(filter, x, P, cut, u), cut, u)
        near(got[0], want[0])
        close(got[1], want[1], 1e-9)


@every
def test_a_belief_from_another_turn_is_the_same(g, kind):
    x, P, u, line, cut = runs(g)
    want = record(make(kind, True), x, P, cut, u, **seeded(kind))
    shifted = x + TURN * torch.tensor([3.0, -2.0, 0.0, 0.0])
    got = record(make(kind, True), shifted, P, cut, u, **seeded(kind))
    near(got[0], want[0])
    close(got[1], want[1], 1e-9)


@every
@pytest.mark.parametrize("method", ["update", "innovation"])
def test_updates_and_innovations_are_those_of_the_line(g, kind, method):
    x, P, u, line, cut = runs(g, (4,))
    args = u[:, 0], P
    want = getattr(make(kind, False), method)(x, line[:, 0], *args, **seeded(kind))
    got = getattr(make(kind, True), method)(x, cut[:, 0], *args, **seeded(kind))
    close(got[0], want[0], 1e-9)
    close(got[1], want[1], 1e-9)


@pytest.mark.parametrize("lead", [(), (3,)])
def test_particles_that_are_kept_are_those_of_the_line(g, lead):
    x, P, u, line, cut = runs(g, lead)
    beliefs = []
    for wraps, y in ((False, line), (True, cut)):
        pf, generator = make(PF, wraps), torch.Generator().manual_seed(1)
        particles, belief = pf.draw(x, P, generator), []
        for i in range(12):
            particles = pf.step(particles, y[..., i, :], u[..., i, :], generator=generator)
            moments = pf.moments(particles)
            close(moments[0], particles.mean)
            close(moments[1], particles.covariance)
            belief.append(moments)
        beliefs.append([torch.stack(part) for part in zip(*belief, strict=True)])
    (want_x, want_P), (got_x, got_P) = beliefs
    near(got_x, want_x)
    close(got_P, want_P, 1e-9)


@gaussian
@pytest.mark.parametrize("lead", [(), (4,)])
def test_the_smoother_across_the_cut_is_that_of_the_line(g, kind, lead):
    x, P, u, line, cut = runs(g, lead)
    want = smooth(one := make(kind, False), *record(one, x, P, line, u), line, u)
    got = smooth(one := make(kind, True), *record(one, x, P, cut, u), cut, u)
    near(got[0], want[0])
    close(got[1], want[1], 1e-9)


@gaussian
def test_a_run_whose_estimates_were_wrapped_by_hand_is_smoothed_all_the_same(g, kind):
    """The recorded means may be whole turns away from where the filter would have put them."""
    x, P, u, _, cut = runs(g, (4,))
    filter = make(kind, True)
    xs, Ps = record(filter, x, P, cut, u)
    turns = torch.randint(-2, 3, (4, 13, 2), generator=g).double()
    moved = xs + TURN * torch.cat([turns, 0 * turns], -1)
    want, got = smooth(filter, xs, Ps, cut, u), smooth(filter, moved, Ps, cut, u)
    near(got[0], want[0])
    close(got[1], want[1], 1e-9)


def test_the_error_of_an_estimate_does_not_see_the_cut(g):
    x, P = draw(g, 5, 4), spd(g, 4, (5,))
    truth = x + 0.1 * draw(g, 5, 4)
    want = nees(x, P, truth)
    turns = TURN * torch.tensor(
        [[1.0, 0, 0, 0], [0, -2, 0, 0], [1, 1, 0, 0], [0, 0, 0, 0], [5, 0, 0, 0]]
    )
    close(nees(x + turns, P, truth, angles(0, 1)), want, 1e-9)
    close(nees(x + turns, P, truth, of_one_pair(0, 1)), want, 1e-9)
    assert (nees(x + turns, P, truth) > 5 * want)[[0, 1, 2, 4]].all()


class Dial(pp.NLS):
    """One angle that is turned by the input, seen as it is."""

    def state_transition(self, state, input, t=None):
        return wrap(state + input)

    def observation(self, state, input, t=None):
        return state


@every
def test_the_dial_at_the_cut(kind):
    """3.0, turned by 0.14, is 3.14, and half of the belief is beyond the cut."""
    numbers = (torch.tensor([z]) for z in (3.0, 3.0, 0.14))
    one = torch.eye(1)
    filter = kind(Dial(), 0.01 * one, 0.1 * one, residual=angles(0), residual_x=angles(0))
    x, P = filter(*numbers, 0.1 * one, **seeded(kind))
    tolerance = 0.02 if kind is PF else 1e-12
    close(x, torch.tensor([3.14]), tolerance)
    close(P, torch.tensor([[0.06]]), tolerance)


@pytest.mark.parametrize("kind", [UKF, PF])
def test_a_mean_of_ones_own_is_taken(g, kind):
    """A circular mean in closed form: of a narrow belief nearly the default's."""
    asked = []

    def circular(points, w):
        asked.append((points.shape, w.shape))
        s, c = ((w.unsqueeze(-1) * part).sum(-2) for part in (points.sin(), points.cos()))
        return torch.atan2(s, c)

    noise = 1e-6 * torch.eye(1), 0.1 * torch.eye(1)
    differences = {"residual": angles(0), "residual_x": angles(0)}
    args = (torch.tensor([[z]] * 3) for z in (3.0, 3.0, 0.14))
    P = 1e-4 * torch.eye(1)
    args = (*args, P)
    want = kind(Dial(), *noise, **differences)(*args, **seeded(kind))
    got = kind(Dial(), *noise, **differences, mean_x=circular)(*args, **seeded(kind))
    k = 3 if kind is UKF else 1000
    assert asked == [((k, 1), (k,))]  # mapped over the batch of 3
    near(got[0], want[0], 1e-6)
    close(got[1], want[1], 1e-6)


def test_particles_on_both_sides_of_the_cut_have_their_mean_between():
    pf = PF(Dial(), residual=angles(0), residual_x=angles(0))
    x = torch.tensor([[3.1], [-3.1], [3.0], [-3.0]])
    mean, P = pf.moments(Particles(x, torch.zeros(4)))
    close(wrap(mean - math.pi), torch.zeros(1))
    off = torch.tensor([math.pi - 3.1, math.pi - 3.0])
    close(P, off.square().mean().reshape(1, 1), 1e-12)
    weighed = pf.weigh(Particles(x, torch.zeros(4)), x[0], x[0], torch.eye(1))
    close(wrap(weighed.x - x), torch.zeros(4, 1))
    assert weighed.x.max() - weighed.x.min() < 0.3


@pytest.mark.parametrize("first", [0, 1, 2, 3])
@pytest.mark.parametrize("width", [0.1, 1.0])
def test_a_mean_of_angles_does_not_depend_on_the_turn_or_the_point_it_starts_from(g, first, width):
    line = 3.0 + width * draw(g, 200, 1)
    line = line.clamp(3.0 - 3.1, 3.0 + 3.1)
    start = [line.argmax().item(), line.argmin().item(), 7, 8][first]
    line = torch.cat([line[start : start + 1], line])
    w = torch.rand(201, generator=g).softmax(-1)
    pf = PF(Dial(), residual_x=angles(0))
    mean, _ = pf.moments(Particles(wrap(line), w.log()))
    far = (line - mean).abs() > math.pi  # those count on the other side
    close(wrap(mean - w @ line), torch.zeros(1), 1e-9 if not far.any() else 0.2)
    rest = w @ angles(0)(line, mean)
    close(rest, torch.zeros(1), 1e-9)


@every
def test_gradients_pass_the_cut(g, kind):
    x, P, u, _, cut = runs(g)
    args = [x, cut[0], u[0], P, 0.01 * torch.eye(4), 0.05 * torch.eye(3)]

    def step(*args):
        return make(kind, True)(*args, **seeded(kind))

    assert gradcheck(step, [a.clone().requires_grad_() for a in args])


def test_gradients_pass_particles_that_are_kept(g):
    x, P, u, _, cut = runs(g)
    pf = make(PF, True)

    def run(x, P):
        particles = pf.draw(x, P, torch.Generator().manual_seed(1))
        return pf.moments(pf.weigh(particles, cut[0], u[0]))

    assert gradcheck(run, [x.requires_grad_(), P.requires_grad_()])


def test_without_residual_x_the_cut_tears_the_belief_apart():
    numbers = [torch.tensor([z]) for z in (3.0, 3.0, 0.14)]
    one = torch.eye(1)
    x, _ = UKF(Dial(), 0.01 * one, 0.1 * one)(*numbers, 0.1 * one)
    assert abs(x.item() - 3.14) > 1


def test_wrapped_angles_stay_exactly_and_others_move_by_turns(g):
    inside = 3.14 * (2 * torch.rand(1000, generator=g) - 1)
    assert torch.equal(wrap(inside), inside)
    far = 100 * draw(g, 1000)
    assert wrap(far).abs().max() <= math.pi + 1e-12
    close(wrap(far).sin(), far.sin())
    close(wrap(far).cos(), far.cos())


def test_angles_count_from_the_end_and_an_index_outside_is_named():
    a, b = torch.tensor([3.0, 3.0, 3.0]), torch.tensor([-3.0, -3.0, -3.0])
    close(angles(-1, 0)(a, b), torch.tensor([6 - TURN, 6, 6 - TURN]))
    with pytest.raises(
        ValueError, match="angles: expected indices of a vector of 3 entries, got 3"
    ):
        angles(3)(a, b)


@every
def test_a_mean_without_a_difference_is_refused(kind):
    with pytest.raises(ValueError, match="mean_x: expected residual_x beside it"):
        kind(Dial(), mean_x=lambda points, w: points[..., 0, :])
