"""The smoother's own promises: noises of every step and member, angles, long runs, messages."""

import itertools

import pytest
import torch
from filter_helpers import Bend, close, draw, linear, one_step, record, spd

import pypose_lite as pp
from pypose_lite.filters import EKF, UKF, smooth

gaussian = pytest.mark.parametrize("kind", [EKF, UKF])
T = 4


def run_of(g, lead):
    x, _, _, P, _, _ = one_step(g, lead)
    return x, P, draw(g, *lead, T, 2), draw(g, *lead, T, 1)


def recorded(filter, x, P, y, u, Q, R):
    """The loop of the book, with another Q and R at every step."""
    xs, Ps = [x], [P]
    for i in range(T):
        x, P = filter(x, y[..., i, :], u[..., i, :], P, Q[..., i, :, :], R[..., i, :, :])
        xs.append(x)
        Ps.append(P)
    return torch.stack(xs, -2), torch.stack(Ps, -3)


def by_hand(filter, xs, Ps, y, u, Q, R):
    """One member at a time, one step at a time."""
    x, P = xs[T], Ps[T]
    means, covariances = [x], [P]
    for i in reversed(range(T)):
        mean, cov = filter.update(xs[i], y[i], u[i], Ps[i], R[i])
        ahead, G, left = filter.reverse(mean, u[i], cov, Q[i])
        x, P = mean + pp.bmv(G, x - ahead), left + G @ P @ G.mT
        means.append(x)
        covariances.append(P)
    return torch.stack(means[::-1]), torch.stack(covariances[::-1])


LAYOUTS = {
    "one for all": (),
    "one a step": (T,),
    "one a member": "batch",
    "one a step and member": "both",
    "one a member, said so": "batch, 1",
    "one a step, said so": "1, T",
}


@gaussian
@pytest.mark.parametrize("lead", [(), (3,), (2, 3), (T,), (3, 2)])
@pytest.mark.parametrize("layouts", itertools.combinations_with_replacement(LAYOUTS, 2))
def test_q_and_r_may_be_of_every_step_and_every_member(g, kind, lead, layouts):
    given = []
    for layout in layouts:
        shape = {"batch": lead, "both": (*lead, T), "batch, 1": (*lead, 1)}.get(LAYOUTS[layout])
        shape = (*[1] * len(lead), T) if LAYOUTS[layout] == "1, T" else shape
        given.append(spd(g, 2, LAYOUTS[layout] if shape is None else shape))
    x, P, y, u = run_of(g, lead)
    filter = kind(Bend())
    ambiguous = len(lead) > 0 and lead[-1] == T
    if ambiguous and any(layout in ("one a step", "one a member") for layout in layouts):
        with pytest.raises(ValueError, match=r"[QR]: \(4, 2, 2\) may be T=4 steps or a batch"):
            smooth(filter, *record(filter, x, P, y, u, *2 * [torch.eye(2)]), y, u, *given)
        return
    whole = [full(z, lead, layout) for z, layout in zip(given, layouts, strict=True)]
    xs, Ps = recorded(filter, x, P, y, u, *whole)
    got = smooth(filter, xs, Ps, y, u, *given)
    for i in itertools.product(*map(range, lead)):
        want = by_hand(filter, *(z[i] for z in (xs, Ps, y, u, *whole)))
        close(got[0][i], want[0])
        close(got[1][i], want[1])


def full(value, lead, layout):
    """The same noise with a batch and steps, whatever was left out."""
    if layout == "one a member":
        value = value.unsqueeze(-3)
    return value.expand(*lead, T, 2, 2)


@gaussian
def test_what_does_not_fit_is_named_as_it_was_given(g, kind):
    x, P, y, u = run_of(g, (3,))
    filter = kind(Bend(), torch.eye(2), torch.eye(2))
    run = (*record(filter, x, P, y, u), y, u)
    with pytest.raises(
        ValueError, match=r"Q: expected \(..., T=4, 2, 2\) for a batch \(3,\), got \(5, 2, 2\)"
    ):
        smooth(filter, *run, torch.eye(2).expand(5, 2, 2))
    with pytest.raises(
        ValueError, match=r"R: expected \(..., T=4, 2, 2\) for a batch \(3,\), got \(7, 4, 2, 2\)"
    ):
        smooth(filter, *run, R=torch.eye(2).expand(7, 4, 2, 2))
    with pytest.raises(
        ValueError, match=r"Q: expected \(..., T=4, 2, 2\) for a batch \(3,\), got \(3, 3\)"
    ):
        smooth(filter, *run, torch.eye(3))
    with pytest.raises(ValueError, match="Q: expected a tensor, got NoneType"):
        smooth(kind(Bend(), R=torch.eye(2)), *run)


@gaussian
def test_covariances_stay_symmetric_and_positive_on_long_runs(g, kind):
    """A stable system with little noise: going back, the gain grows what is not symmetric."""
    system = linear(g, 3, 1, 1, radius=0.7)
    system = system._replace(Q=1e-12 * system.Q, R=1e-6 * system.R)
    _, u, y = system.run(g, 40)
    filter = kind(system.model, system.Q, system.R)
    x, P = smooth(filter, *record(filter, system.x, system.P, y, u), y, u)
    assert torch.equal(P, P.mT)
    assert torch.linalg.eigvalsh(P).min() > 0


@gaussian
def test_a_certain_next_state_is_an_error(g, kind):
    system = linear(g)
    filter = kind(system.model, 0 * system.Q, system.R)
    x, P = torch.zeros(3, 2), torch.zeros(3, 2, 2)
    with pytest.raises(ValueError, match="expected positive definite"):
        smooth(filter, x, P, torch.zeros(2, 2), torch.zeros(2, 1))
