"""What a system's functions may be, which of their arguments is the time, and what misuse says."""

import copy
import functools

import pytest
import torch
from oracles import close, draw

import pypose_lite as pp

pytestmark = pytest.mark.usefixtures("float64")


class Stays(pp.NLS):
    """What is tried takes the place of its transition."""

    def observation(self, state, input):
        return state


def made(function):
    """A system whose class has the function, and one that was given it as an attribute."""

    class Written(Stays):
        state_transition = staticmethod(function)

    given = Stays()
    given.state_transition = function
    return Written(), given


def plain(state, input):
    return state + input


def timed(state, input, t):
    return state + input * t


def timed_by_its_name(state, input, time=None):
    return state + input * time


def timed_by_its_place(state, input, k):
    return state + input * k


def noisy(state, input, noise=0.0):
    return state + input + noise


def noisy_and_timed(state, input, noise=0.0, t=None):
    return state + input * t + noise


def timed_by_keyword(state, input, *, t, gain=1.0):
    return gain * (state + input * t)


def open_ended(state, input, *args, **kwargs):
    return state + input + len(args) + len(kwargs)


def timed_and_open_ended(state, input, t, *args, **kwargs):
    return state + input * t + len(args) + len(kwargs)


def places_only(state, input, k, /):
    return state + input * k


WITH_TIME = [timed, timed_by_its_name, timed_by_its_place, timed_by_keyword, noisy_and_timed]
WITH_TIME += [timed_and_open_ended, places_only]
WITHOUT = [plain, noisy, open_ended]


@pytest.mark.parametrize("lead", [(), (3,)], ids=str)
@pytest.mark.parametrize("function", WITH_TIME + WITHOUT, ids=lambda f: f.__name__)
def test_the_time_is_an_argument_of_that_name_or_a_third_one_without_a_default(function, lead, g):
    x, u = draw(g, *lead, 2), draw(g, *lead, 2)
    want = x + u * (4 if function in WITH_TIME else 1)
    for system in made(function):
        close(system.transition(x, u, 4), want)
        close(system.reset(4)(x, u)[0], want)
        close(system.linearize(x, u, 4).B, (want - x)[..., None] / u[..., None] * torch.eye(2))


class Net(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.gain = torch.nn.Parameter(torch.tensor(2.0))

    def forward(self, state, input):
        return self.gain * state + input


class TimedNet(Net):
    def forward(self, state, input, t):
        return self.gain * state + input * t


@pytest.mark.parametrize("net, steps", [(Net, 1), (TimedNet, 4)])
def test_a_module_as_a_function_is_called_and_learned(net, steps, g):
    system = Stays()
    system.state_transition = net().double()
    x, u = draw(g, 3, 2), draw(g, 3, 2)
    close(system.transition(x, u, 4), 2 * x + steps * u)
    system(x, u)[0].sum().backward()
    assert [name for name, _ in system.named_parameters()] == ["state_transition.gain"]
    close(next(system.parameters()).grad, x.sum())
    other = copy.deepcopy(system)
    close(other.transition(x, u, 4), system.transition(x, u, 4), 0)


def decorated(function):
    @functools.wraps(function)
    def inner(*args, **kwargs):
        return function(*args, **kwargs)

    return inner


def decorated_without_wraps(function):
    def inner(*args):
        return function(*args)

    return inner


def decorated_with_arguments_of_its_own(function):
    @functools.wraps(function)
    def inner(state, input):
        return function(state, input, 7)

    return inner


class Methods(Stays):
    gain = 3.0

    @classmethod
    def of_the_class(cls, state, input, t):
        return cls.gain * state + input * t

    @staticmethod
    def static(state, input, t):
        return 3.0 * state + input * t

    @decorated
    def wrapped(self, state, input, t):
        return self.gain * state + input * t

    in_one_line = lambda self, state, input, t: self.gain * state + input * t  # noqa: E731

    def with_a_gain(self, gain, state, input, t=None):
        return gain * state + input * t

    by_half = functools.partialmethod(with_a_gain, 3.0)


@pytest.mark.parametrize("name", ["of_the_class", "static", "wrapped", "in_one_line", "by_half"])
def test_methods_of_any_kind_work(name, g):
    class Named(Methods):
        state_transition = Methods.__dict__[name]

    given, x, u = Methods(), draw(g, 3, 2), draw(g, 3, 2)
    given.state_transition = getattr(given, name)
    for system in (Named(), given):
        close(system.transition(x, u, 4), 3 * x + 4 * u)


def scaled(gain, state, input, t=5.0):
    return gain * state + input * t


@pytest.mark.parametrize(
    "function, steps",
    [
        (functools.partial(scaled, 3.0), 4),
        (functools.partial(scaled, 3.0, t=7.0), 7),
        (lambda x, u: 3 * x + u, 1),
        (lambda x, u, t: 3 * x + u * t, 4),
        (decorated(lambda x, u, t: 3 * x + u * t), 4),
        (decorated_with_arguments_of_its_own(lambda x, u, t: 3 * x + u * t), 7),
        (functools.cache(lambda x, u, t: 3 * x + u * t), 4),
    ],
    ids=["partial", "fixed time", "lambda", "timed", "wrapped", "other arguments", "cached"],
)
def test_partials_lambdas_and_callables_work(function, steps, g):
    x, u = draw(g, 2), draw(g, 2)
    for system in made(function):
        close(system.transition(x, u, 4), 3 * x + steps * u)


def test_torchs_own_functions_work(g):
    system, x, u = Stays(), draw(g, 3, 2), draw(g, 3, 2)
    system.state_transition = torch.add
    close(system.transition(x, u), x + u)


def test_a_class_may_be_given_its_functions_later(g):
    class Later(Stays):
        pass

    system, x, u = Later(), draw(g, 2), draw(g, 2)
    Later.state_transition = lambda self, state, input, t: state + input * t
    close(system.transition(x, u, 3), x + 3 * u)
    Later.state_transition = lambda self, state, input: state - input
    close(system.transition(x, u, 3), x - u)


def test_one_function_may_be_a_method_here_and_an_attribute_there(g):
    def three(first, second, third):
        return third + 0 * second  # an input, or the time

    class Method(Stays):
        state_transition = three

    system, x, u = Stays(), draw(g, 2), draw(g, 2)
    close(Method().transition(x, u, 3), u + 0 * x)
    system.state_transition = three
    close(system.transition(x, u, 3), 3 + 0 * x)


def two_more(state, input, t, gain):
    return state


def state_alone(state):
    return state


def keyword_without_default(state, input, *, gain):
    return state


@pytest.mark.parametrize(
    "function, got",
    [
        (two_more, r"\(state, input, t, gain\)"),
        (state_alone, r"\(state\)"),
        (keyword_without_default, r"\(state, input, \*, gain\)"),
        (decorated_without_wraps(timed), r"\(\*args\); a decorator says by functools.wraps what"),
        (torch.nn.Linear(2, 2), r"\(input: torch.Tensor\)"),
    ],
    ids=lambda value: value if isinstance(value, str) else type(value).__name__,
)
def test_a_function_with_other_arguments_is_refused_by_name(function, got, g):
    words = (
        r"state_transition of \w+: expected the arguments \(state, input\) or \(state, input, t\)"
    )
    system = Stays()
    system.state_transition = function
    for call in (system.transition, system.linearize, system):
        with pytest.raises(ValueError, match=rf"{words}, got {got}"):
            call(draw(g, 2), draw(g, 2))


def test_what_is_no_function_is_refused_by_name(g):
    system = Stays()
    system.state_transition = torch.eye(2)
    with pytest.raises(
        ValueError, match="state_transition of Stays: expected a function, got Tens"
    ):
        system(draw(g, 2), draw(g, 2))


@pytest.mark.parametrize("result", [None, 1.0, (torch.ones(2),), [1.0, 2.0]], ids=repr)
def test_a_result_that_is_no_tensor_is_refused_by_name(result, g):
    system, kind = Stays(), type(result).__name__
    system.state_transition = lambda x, u: result
    for lead in ((), (3,)):
        with pytest.raises(
            ValueError, match=f"state_transition of Stays: expected a .* got {kind}"
        ):
            system(draw(g, *lead, 2), draw(g, *lead, 2))


# --- a function of one sample that is written for a batch


def indexes_rows(state, input):
    return torch.stack([state[:, 0] + input[:, 0], state[:, 1]], -1)


def unpacks_a_row(state, input):
    x, y = state[0]
    return torch.stack([x, y])


def unpacks_columns(state, input):
    B, n = state.shape
    return state


def joins_columns(state, input):
    return torch.cat([state, state], dim=1)


def asks_for_columns(state, input):
    return state * state.shape[1]


def asks_for_its_size(state, input):
    return state * state.size(1)


def multiplies_batches(state, input):
    return torch.bmm(torch.eye(2).expand(3, 2, 2), state)


def indexes_a_number(state, input):
    return state[0][1] + input


OF_A_BATCH = [indexes_rows, unpacks_a_row, unpacks_columns, joins_columns, asks_for_columns]
OF_A_BATCH += [asks_for_its_size, multiplies_batches, indexes_a_number]


@pytest.mark.parametrize("lead", [(), (3,)], ids=str)
@pytest.mark.parametrize("function", OF_A_BATCH, ids=lambda f: f.__name__)
def test_a_function_that_takes_one_sample_for_a_batch_is_told_so(function, lead, g):
    system, x, u = Stays(), draw(g, *lead, 2), draw(g, *lead, 1)
    system.state_transition = function
    for call in (system, system.linearize):
        with pytest.raises((IndexError, RuntimeError, TypeError, ValueError)) as error:
            call(x, u)
        text, cause = str(error.value), error.value.__cause__
        assert r"gets one sample at a time, a state (2,) and an input (1,)" in text
        assert "`vectorized = True`" in text and str(cause) in text
        assert isinstance(error.value, type(cause))


def test_errors_that_have_to_do_with_something_else_arrive_as_they_are(g):
    system = Stays()
    for error in (IndexError("list index"), TypeError("no"), ValueError("mine"), RuntimeError("a")):

        def fails(state, input, error=error):
            raise error

        system.state_transition = fails
        for lead in ((), (3,)):
            with pytest.raises(type(error)) as caught:
                system(draw(g, *lead, 2), draw(g, *lead, 1))
            assert caught.value is error


def test_a_function_for_batches_that_takes_its_batch_for_another_is_not_told_of_one_sample(g):
    class Wrong(Stays):
        vectorized = True

        def state_transition(self, state, input):
            return state[:, :, 0]

    with pytest.raises(IndexError) as error:
        Wrong()(draw(g, 3, 2), draw(g, 3, 1))
    assert "one sample" not in str(error.value)
