"""Functions of one sample as people write them: a batch is a loop, without a loop."""

import math
import warnings

import numpy as np
import pytest
import torch
from oracles import close, draw
from torch.autograd import gradcheck

import pypose_lite as pp

pytestmark = pytest.mark.usefixtures("float64")

TABLE = torch.linspace(-1, 1, 20, dtype=torch.float64).reshape(10, 2)
NUMBERS = [0.1, -0.4, 0.3, 0.9, -0.2, 0.6]
NAMED = {0: 0.5, 1: -0.5, 2: 0.1, 3: 0.7, 4: 0.2}


def rows(state, input):
    return torch.stack([state[0] + 0.1 * state[1].sin(), state[1] + 0.1 * input[0]])


def looks_up(state, input, t):
    return rows(state, input) + TABLE[t]


def looks_up_by_a_number(state, input, t):
    return rows(state, input) + TABLE[int(t)]


def reads_a_list(state, input, t):
    return rows(state, input) * NUMBERS[t]


def reads_a_dictionary(state, input, t):
    return rows(state, input) * NAMED[t.item()]


def reads_an_array(state, input, t):
    return rows(state, input) + np.arange(6.0)[t] * input


def takes_a_sine(state, input, t):
    return rows(state, input) * math.sin(t)


def takes_numpys_sine(state, input, t):
    return rows(state, input) * float(np.sin(float(t)))


def branches_on_the_time(state, input, t):
    return rows(state, input) if t < 2 else 2 * state


def counts_to_the_time(state, input, t):
    for _ in range(int(t)):
        state = rows(state, input)
    return state


def writes_a_matrix_of_the_time(state, input, t):
    A = torch.tensor([[1.0, math.cos(t)], [0.0, 1.0 + 0.1 * t]])
    return A @ state + input


def fills_zeros(state, input, t):
    n = torch.zeros(2)
    n[0] = state[0] + 0.1 * state[1].sin()
    n[1] = state[1] + input[0] * t
    return n


def fills_zeros_and_branches(state, input, t):
    n = torch.empty(2)
    n[:] = state
    if t > 1:
        n[1] += input[0]
    return n


def fills_a_view(state, input, t):
    A = torch.eye(2)
    first = A[0]
    first[1] = state[0].cos()
    return A @ state + input


def fills_a_copy(state, input, t):
    A = TABLE[:2].clone()
    A[0, 1] += state[0] ** 2
    return A @ state


def fills_what_it_stacked(state, input, t):
    n = torch.stack([torch.tensor(1.0), torch.tensor(2.0)])
    n[1] = state[1] * input[0]
    return n


def fills_with_its_method(state, input, t):
    n = TABLE.new_zeros(2)
    n[0] = state[0] * state[1]
    return n


def draws_a_mask(state, input, t):
    seen = torch.zeros(2, dtype=torch.bool)
    seen[0] = state[0] > 0
    return torch.where(seen, state, 2 * state) + input


def writes_into_its_state(state, input, t):
    state[0] = state[0] + 0.1 * state[1]
    state[1] += 0.1 * input[0]
    return state


def changes_its_input_and_time(state, input, t):
    input *= 2
    t += 1
    return state + input * t


MAPPED = [f for name, f in list(globals().items()) if getattr(f, "__module__", "") == __name__]
MAPPED.remove(rows)


def system(function):
    class Written(pp.NLS):
        def state_transition(self, state, input, t):
            return function(state, input, t)

        def observation(self, state, input, t):
            return function(state, input, t)[:1]

    return Written()


@pytest.mark.parametrize("function", MAPPED, ids=lambda f: f.__name__)
def test_a_batch_of_steps_and_linearisations_is_a_loop_without_a_warning(function, g):
    written, x, u = system(function), draw(g, 5, 3, 2), draw(g, 5, 3, 1)
    given = x.clone(), u.clone()
    for t in (torch.tensor(3), torch.arange(5)[:, None], torch.randint(0, 5, (5, 3), generator=g)):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = written.transition(x, u, t), *written.linearize(x, u, t)
        times = t.expand(5, 3)
        for i in np.ndindex(5, 3):
            alone = x[i].clone(), u[i].clone(), times[i].clone()
            close(found[0][i], function(*alone))
            for got, want in zip(found[1:], written.linearize(x[i], u[i], times[i])):
                close(got[i], want)
    close(x, given[0], 0), close(u, given[1], 0)
    assert written.systime == 0


@pytest.mark.parametrize("function", MAPPED, ids=lambda f: f.__name__)
def test_no_function_is_called_for_each_member(function, g):
    calls = []

    def counted(state, input, t):
        calls.append(1)
        return function(state, input, t)

    written, t = system(counted), torch.arange(4)[:, None]
    written.linearize_transition(draw(g, 4, 100, 2), draw(g, 4, 100, 1), t)
    assert len(calls) <= 4 * 2 * (2 + 4)  # two passes, at most two tries for each time


@pytest.mark.parametrize("function", [fills_zeros, takes_a_sine, fills_a_copy])
def test_gradients_pass_through_what_is_filled_in_place(function, g):
    written, t = system(function), torch.arange(3)
    x, u = draw(g, 3, 2).requires_grad_(), draw(g, 3, 1).requires_grad_()
    assert gradcheck(lambda x, u: written.transition(x, u, t), (x, u))
    assert gradcheck(lambda x, u: tuple(written.linearize(x, u, t)), (x, u))


def test_the_clock_shows_each_member_its_time(g):
    class Looks(pp.NLS):
        def state_transition(self, state, input):
            return state * math.cos(self.systime) + TABLE[int(self.systime)]

        def observation(self, state, input):
            return state

    looks, x, u, t = Looks(), draw(g, 3, 2), draw(g, 3, 1), torch.tensor([4, 0, 4])
    after = looks.transition(x, u, t)
    for i in range(3):
        close(after[i], x[i] * math.cos(t[i]) + TABLE[t[i]])
    assert looks.systime == 0


# --- what has to be looped over says so


def branches_on_the_state(state, input, t):
    if state[0] > 0:
        return state + input
    return state - input


def takes_a_number_out(state, input, t):
    return state * float(state[0])


def takes_numbers_to_a_tensor(state, input, t):
    return torch.tensor([state[1], state[0]])


def takes_numbers_to_numpy(state, input, t):
    return torch.as_tensor(np.sin(state.numpy(force=True)))


def picks_by_a_mask(state, input, t):
    return state + state[state > -10].sum() + input


def asks_what_is_in_its_state(state, input, t):
    return state + input if 0.5 in state else state - input


LOOPED = {
    asks_what_is_in_its_state: ("return state + input if 0.5 in", "takes a number out of"),
    branches_on_the_state: ("if state[0] > 0:", "it branches on numbers that differ"),
    takes_a_number_out: ("return state * float(state[0])", "takes a number out of a tensor"),
    takes_numbers_to_a_tensor: ("return torch.tensor(", "takes a number out of a tensor"),
    takes_numbers_to_numpy: ("return torch.as_tensor(np.sin(", "takes numbers out of torch"),
    picks_by_a_mask: ("return state + state[", "size of what it picks depends on numbers"),
}


@pytest.mark.parametrize("function", LOOPED, ids=lambda f: f.__name__)
def test_what_cannot_be_mapped_warns_once_and_names_the_line_and_the_reason(function, g):
    written, x, u = system(function), draw(g, 4, 2), draw(g, 4, 1)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        after = written.transition(x, u)
        written.transition(x, u), written.linearize_transition(x, u, torch.arange(4))
    close(after, torch.stack([function(*row, 0) for row in zip(x, u)]))
    own = [w for w in caught if "is slow for batches" in str(w.message)]
    assert len(own) == 1 and issubclass(own[0].category, UserWarning)
    assert own[0].filename == __file__
    text, line, reason = str(own[0].message), *LOOPED[function]
    number = open(__file__, encoding="utf-8").read().splitlines().index("    " + line_of(line)) + 1
    assert "state_transition of Written" in text and reason in text
    assert f"line {number} of test_mapping.py, `{line}" in text and own[0].lineno == number


def line_of(start):
    lines = (line.strip() for line in open(__file__, encoding="utf-8"))
    return next(line for line in lines if line.startswith(start))


def test_a_step_of_one_sample_is_no_slow_way(g):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        system(branches_on_the_state).transition(draw(g, 2), draw(g, 1))


def test_a_function_that_fails_fails_by_itself_and_without_a_warning(g):
    class Fails(pp.NLS):
        def state_transition(self, state, input, t):
            raise KeyError("a name of its own")

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(KeyError, match="a name of its own"):
            Fails().transition(draw(g, 3, 2), draw(g, 3, 1), torch.arange(3))
