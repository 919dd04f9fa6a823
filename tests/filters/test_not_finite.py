"""Where f or g is not finite, an estimate is refused with their name; never a NaN that goes on."""

import pytest
import torch
from filter_helpers import Still, record

from pypose_lite.filters import EKF, UKF, smooth

gaussian = pytest.mark.parametrize("kind", [EKF, UKF])
BAD = {"log": torch.log, "root": torch.sqrt, "inverse": lambda x: 1 / (x + 1)}


class Model(Still):
    def __init__(self, f=lambda x: x, g=lambda x: x):
        super().__init__()
        self.move, self.see = f, g

    def state_transition(self, state, input, t=None):
        return self.move(state)

    def observation(self, state, input, t=None):
        return self.see(state)


def arguments(lead=()):
    x = -torch.ones(*lead, 1)
    one = torch.eye(1)
    return x, x, x, one, one, one


@gaussian
@pytest.mark.parametrize("bad", BAD.values(), ids=BAD)
def test_an_observation(kind, bad):
    x, y, u, P, Q, R = arguments()
    filter = kind(Model(g=bad), Q, R)
    for call in (filter, filter.update, filter.innovation):
        with pytest.raises(ValueError, match="observation: .*(nan|inf)"):
            call(x, y, u, P)


@gaussian
@pytest.mark.parametrize("bad", BAD.values(), ids=BAD)
def test_a_next_state(kind, bad):
    x, y, u, P, Q, R = arguments()
    filter = kind(Model(f=bad), Q, R)
    for call in (
        lambda: filter(x, y, u, P),
        lambda: filter.predict(x, u, P),
        lambda: filter.reverse(x, u, P),
        lambda: filter(x, None, u, P),
    ):
        with pytest.raises(ValueError, match="state_transition: .*(nan|inf)"):
            call()


@gaussian
def test_a_run_that_is_smoothed(kind):
    x, _, u, P, Q, R = arguments()
    filter = kind(Model(), Q, R)
    y = torch.zeros(3, 1)
    xs, Ps = record(filter, x, P, y, u.expand(3, 1))
    with pytest.raises(ValueError, match="state_transition: .*(nan|inf)"):
        smooth(kind(Model(f=torch.log), Q, R), xs, Ps, y, u.expand(3, 1))


def test_a_kink_of_the_observation_or_of_the_step():
    """The value is finite, and its slope is not."""
    _, _, u, P, Q, R = arguments()
    zero = torch.zeros(1)
    with pytest.raises(ValueError, match="observation of Model: its derivative"):
        EKF(Model(g=torch.sqrt), Q, R)(zero, zero, u, P)
    with pytest.raises(ValueError, match="state_transition of Model: its derivative"):
        EKF(Model(f=torch.sqrt), Q, R)(zero, zero, u, P)
