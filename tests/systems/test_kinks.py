"""Where a function has no derivative, an error says so; the derivatives next to there are right."""

import math
import warnings

import numpy as np
import pytest
import torch
from oracles import central, close, draw

import pypose_lite as pp
from pypose_lite.systems.kinks import nodes_between

pytestmark = pytest.mark.usefixtures("float64")

# Each maps x (2,) to a number that is finite at `at`, where it has no derivative by x[0].
KINKS = {
    "a root": (lambda x: (x[0] ** 2 + x[1] ** 2).sqrt(), [0.0, 0.0]),
    "a power": (lambda x: x[0] ** 0.5, [0.0, 1.0]),
    "an angle": (lambda x: torch.atan2(x[0], x[1]), [0.0, 0.0]),
    "a norm": (lambda x: torch.linalg.vector_norm(x), [0.0, 0.0]),
    "a norm of a method": (lambda x: x.norm(), [0.0, 0.0]),
    "a norm of rows": (lambda x: torch.linalg.norm(x[None], dim=-1)[0], [0.0, 0.0]),
    "a distance": (lambda x: torch.dist(x, torch.tensor([1.0, 2.0])), [1.0, 2.0]),
    "a complex size": (lambda x: torch.complex(x[0], x[1]).abs(), [0.0, 0.0]),
    "a hypotenuse": (lambda x: torch.hypot(x[0], x[1]), [0.0, 0.0]),
    "a range to a beacon": (lambda x: (x - torch.tensor([1.0, 2.0])).norm(), [1.0, 2.0]),
    "a bearing": (lambda x: torch.atan2(x[0] - 1, x[1] - 2), [1.0, 2.0]),
    "acos": (lambda x: x[0].acos(), [1.0, 0.0]),
    "asin": (lambda x: x[0].asin(), [-1.0, 0.0]),
    "a where trap": (lambda x: torch.where(x[0] > 0, x[0].sqrt(), 0), [0.0, 1.0]),
    "x log x": (lambda x: torch.xlogy(x[0], x[0]), [0.0, 1.0]),
    "a quotient": (lambda x: torch.where(x[0] == 0, 0, x[1] / x[0]), [0.0, 1.0]),
}
# Finite slopes there, but no second derivative by x[0].
CURVED = {
    "a power": (lambda x: x[0].abs() ** 1.5, [0.0, 1.0]),
    "drag": (lambda x: x.norm() * x[0], [0.0, 0.0]),
    "a root cubed": (lambda x: (x @ x) ** 1.5, [0.0, 0.0]),
}
# Derivatives that torch has right, though an angle or a norm stands at 0.
SMOOTH = {
    "drag": (lambda x: x.norm() * x[0], [0.0, 0.0]),
    "an angle that is dropped": (lambda x: torch.where(x[1] > 0, torch.atan2(*x), x[0]), [0.0] * 2),
    "a norm that is not used": (lambda x: x[0] + 0 * x.norm().detach(), [0.0, 0.0]),
    "a smoothed root": (lambda x: (x @ x + 1e-6).sqrt(), [0.0, 0.0]),
    "an angle elsewhere": (lambda x: torch.atan2(x[0], x[1]), [0.0, 1.0]),
}


def system(function):
    """Its third component is the function of the first two."""

    class Kinked(pp.NLS):
        def state_transition(self, state, input, t):
            return torch.cat([state[:2] + input, function(state[:2])[None]])

        def observation(self, state, input, t):
            return torch.cat([state, function(state[:2])[None]])

    return Kinked()


@pytest.mark.parametrize("name", KINKS)
def test_a_slope_that_is_not_finite_where_the_function_is_names_the_entry(name):
    function, at = KINKS[name]
    kinked, x, u = system(function), torch.tensor([*at, 3.0]), torch.zeros(1)
    assert kinked.transition(x, u, 4).isfinite().all()
    f = r"state_transition of Kinked: its derivative df\[2\]/dx\[0\] is \S+ at t=4, where f itself"
    g = r"observation of Kinked: its derivative dg\[3\]/dx\[0\] is \S+ at t=4, where g itself"
    for call, words in (
        (kinked.linearize, f),
        (kinked.linearize_transition, f),
        (kinked.expand_transition, f),
        (kinked.linearize_observation, g),
    ):
        with pytest.raises(ValueError, match=words):
            call(x, u, 4)
    with pytest.raises(ValueError, match=f):
        kinked.set_refpoint(x, u, 4).A  # noqa: B018
    with pytest.raises(ValueError, match=f):
        kinked.linearize_transition(x, u, 4, wrt="x")


def slope_of_an_angle():
    """What torch itself answers for the slope of ``atan2(0, 0)``: NaN in old ones, else 0."""
    w = torch.zeros(2, requires_grad=True)
    return torch.autograd.grad(torch.atan2(*w), w)[0]


ANSWERS_0 = pytest.mark.skipif(bool(slope_of_an_angle().isnan().any()), reason="torch says NaN")


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[ANSWERS_0] * ("angle" in name)) for name in SMOOTH],
)
def test_a_slope_that_is_right_passes(name):
    function, at = SMOOTH[name]
    smooth, x, u = system(function), torch.tensor([*at, 3.0]), torch.zeros(1)
    close(smooth.linearize(x, u).A, central(lambda x: smooth.transition(x, u), x), 1e-5)


@pytest.mark.parametrize("name", CURVED)
def test_a_second_derivative_that_is_not_finite_is_named(name):
    function, at = CURVED[name]
    kinked, x, u = system(function), torch.tensor([*at, 3.0]), torch.zeros(1)
    close(kinked.linearize(x, u).A, central(lambda x: kinked.transition(x, u), x), 1e-2)
    curve = kinked.expand_transition(x, u, 2)[3]
    with pytest.raises(ValueError, match=r"derivative d2f/dx\[0\]dx\[0\] is \S+ at t=2, where f"):
        curve(torch.ones(3))
    close(kinked.expand_transition(x + 1, u)[3](torch.zeros(3)), torch.zeros(4, 4), 0)


def test_of_a_second_derivative_the_component_itself_is_named_not_those_it_spoils():
    kinked = system(lambda x: x[1].abs() ** 1.5 * x[0].cos())
    with pytest.raises(ValueError, match=r"derivative d2f/dx\[1\]dx\[1\] is"):
        kinked.expand_transition(torch.tensor([1.0, 0, 0]), torch.zeros(1))[3](torch.ones(3))


def test_a_slope_by_an_input_is_named():
    class Thrust(pp.NLS):
        def state_transition(self, state, input):
            return state + torch.stack([input[0], input[1].sqrt()])

        def observation(self, state, input):
            return state

    with pytest.raises(ValueError, match=r"df\[1\]/du\[1\] is inf at t=0, where f itself"):
        Thrust().linearize(torch.zeros(2), torch.zeros(2))


def test_the_member_of_a_batch_and_its_time_are_named(g):
    kinked = system(KINKS["a root"][0])
    x, u, t = draw(g, 5, 4, 3), draw(g, 5, 4, 1), torch.arange(5)[:, None]
    x[3, 2] = 0
    with pytest.raises(ValueError, match=r"is nan at t=0 in member \(3, 2\) of the batch"):
        kinked.linearize(x, u)
    with pytest.raises(ValueError, match=r"is nan at t=3 in member \(2,\) of the batch"):
        kinked.linearize(x, u, t)
    with pytest.raises(ValueError, match=r"d2f/dx\[0\]dx\[0\] is nan at t=3 in member \(2,\) of"):
        system(CURVED["drag"][0]).expand_transition(x, u, t)[3](torch.ones(3))
    with pytest.raises(ValueError, match="is nan at t=3, where"):
        kinked.linearize(x[:, 2], u[:, 2], torch.arange(5))


def test_where_the_function_itself_is_not_finite_nothing_is_said_of_slopes():
    class Logarithm(pp.NLS):
        def state_transition(self, state, input):
            return state.log() + input

        def observation(self, state, input):
            return state

    x, u = torch.tensor([0.0, 1.0]), torch.zeros(2)
    f, A, _ = Logarithm().linearize_transition(x, u)
    assert f.isinf().tolist() == [True, False] and not A.isfinite().all()
    Logarithm().expand_transition(x, u)[3](torch.ones(2))


# Each maps x (2,) to numbers that torch has lost sight of.
DETACHED = {
    "a new tensor": lambda x: torch.tensor([x[0] + x[1], 2 * x[1]]),
    "a float": lambda x: torch.tensor([math.sin(x[0]), 0.0]),
    "NumPy": lambda x: torch.from_numpy(np.sin(x.detach().numpy())),
    "no_grad": torch.no_grad()(lambda x: x.sin()),
}


@pytest.mark.filterwarnings("ignore:.*slow for batches", "ignore:Converting a tensor")
@pytest.mark.parametrize("name", DETACHED)
def test_derivatives_that_torch_has_lost_warn_once(name):
    class Detached(pp.NLS):
        def state_transition(self, state, input):
            return DETACHED[name](state)

    x, u = torch.tensor([[0.3, 1.0], [0.0, 2.0]]), torch.zeros(1)
    with pytest.warns(UserWarning, match="state_transition of Detached has lost its derivatives"):
        Detached().linearize_transition(x[0], u)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Detached().linearize_transition(x[0], u)


# Derivatives of 0 that torch has right, or for which it has a convention.
FLAT = {
    "a constant": lambda x: torch.ones(2),
    "a minimum": lambda x: x**2,
    "a saddle": lambda x: x**3,
    "a ramp": torch.relu,
    "a size": lambda x: x.abs(),
    "a whole number": lambda x: (x + 0.2).round(),
}


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("name", FLAT)
def test_where_a_function_does_not_move_zeros_are_right(name, dtype):
    class Flat(pp.NLS):
        def state_transition(self, state, input):
            return FLAT[name](state).to(dtype)

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        A = Flat().linearize_transition(torch.zeros(3, 2, dtype=dtype), torch.zeros(1).to(dtype))[1]
    close(A, torch.zeros(3, 2, 2, dtype=dtype), 0)


def test_slopes_whose_sum_overflows_are_finite_all_the_same():
    class Steep(pp.NLS):
        def state_transition(self, state, input):
            return 1.5e308 * state + input

        def observation(self, state, input):
            return state

    A = Steep().linearize(torch.zeros(2), torch.zeros(2)).A
    close(A, 1.5e308 * torch.eye(2), 0)


@ANSWERS_0
def test_gradients_that_a_caller_takes_stay_torchs(g):
    """What is made NaN for a linearisation is not so in the caller's own graph."""
    kinked, x = system(KINKS["an angle"][0]), torch.zeros(3, requires_grad=True)
    angle = kinked.transition(x, torch.zeros(1))[2]
    with pytest.raises(ValueError, match="df"):
        kinked.linearize(x, torch.zeros(1))
    close(torch.autograd.grad(angle, x)[0], torch.zeros(3), 0)


@ANSWERS_0
def test_gradients_to_what_a_system_was_made_of_stay_torchs(g):
    w = torch.zeros(2, requires_grad=True)
    car = pp.DubinsCar(slip=torch.atan2(*w))
    car.linearize(draw(g, 4), draw(g, 2)).A.sum().backward()
    close(w.grad, torch.zeros(2), 0)


def test_of_a_long_run_only_the_latest_step_is_looked_through(g):
    x = draw(g, 4).requires_grad_()
    y = x.sin().cos()
    history = list(nodes_between(y, [x]))
    assert len(list(nodes_between(y.exp(), [y]))) == 1 and len(history) > 1


# --- whoever asks a system for its derivatives says so, too


Q, P, R = torch.eye(4).double(), torch.eye(3).double(), torch.eye(4).double()


@pytest.mark.parametrize("name", ["a root", "an angle", "a norm", "a power"])
def test_regulators_and_filters_say_it(name):
    function, at = KINKS[name]
    kinked, x, u = system(function), torch.tensor([*at, 3.0]), torch.zeros(1)
    ekf, y = pp.EKF(kinked, P, R), torch.zeros(4)
    words = r"derivative (df\[2\]|dg\[3\])/dx\[0\] is \S+ at t="
    for call in (
        lambda: pp.LQR(kinked, Q, None, 3)(x),
        lambda: pp.MPC(kinked, Q, None, 3)(None, x),
        lambda: ekf.predict(x, u, P),
        lambda: pp.smooth(ekf, x.expand(4, 3), P.expand(4, 3, 3), y.expand(3, 4), u.expand(3, 1)),
    ):
        with pytest.raises(ValueError, match=words):
            call()
    with pytest.raises(ValueError, match=r"derivative dg\[3\]/dx\[0\] is"):
        ekf.update(x, y, u, P)


def test_a_plan_names_the_member_of_its_batch(g):
    kinked = system(KINKS["a root"][0])
    x = draw(g, 3, 3)
    x[1] = 0
    with pytest.raises(ValueError, match=r"at t=0 in member \(1,\) of the batch"):
        pp.MPC(kinked, Q, None, 2)(None, x)
