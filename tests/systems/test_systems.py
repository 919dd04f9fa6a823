"""Systems: steps, the clock, linearisation, and user functions as people write them."""

import copy
import math
import pickle
from functools import partial

import numpy as np
import pytest
import torch
from oracles import BATCHES, Affine, Clockwork, central, close, draw, matrices
from torch.autograd import gradcheck
from torch.autograd.functional import jacobian

import pypose_lite as pp

pytestmark = pytest.mark.usefixtures("float64")


class Unpacks(pp.NLS):
    def state_transition(self, state, input, t=None):
        a, b = state
        return torch.stack([a + 0.1 * b, b + 0.1 * (input[0] * a - a.sin())])

    def observation(self, state, input):
        return state[:1] * input[0]


class Squeezes(pp.NLS):
    def state_transition(self, state, input, t=None):
        a, b = state.squeeze()
        change = torch.stack([b, input.squeeze() * a - a.sin()])
        return (state.squeeze() + 0.1 * change).unsqueeze(0)

    def observation(self, state, input, t):
        return (state.squeeze() * input.squeeze()).unsqueeze(0)


class Branches(pp.NLS):
    def state_transition(self, state, input):
        a, b = state
        push = input[0] * a if a > 0 else input[0] ** 3
        return torch.stack([a + 0.1 * b, b + 0.1 * push])

    def observation(self, state, input):
        return state.prod()


class AsksForTheNumber(pp.NLS):
    def state_transition(self, state, input, t):
        k = math.cos(t.item())
        return state + k * torch.stack([state[1], input[0] * state[0]])

    def observation(self, state, input, t):
        return t.item() * state * input


class WritesMatrices(pp.NLS):
    def state_transition(self, state, input, t):
        c, s = t.cos(), t.sin()
        A = torch.tensor([[1.0, c / 10], [c / 10, 1.0]])
        B = torch.tensor([[s], [1.0]])
        return pp.bmv(A, state) + pp.bmv(B, input)

    def observation(self, state, input, t):
        return state + t


class ForBatches(pp.NLS):
    vectorized = True

    def state_transition(self, state, input, t):
        return state * (1 + 0.1 * t.cos()) + 0.1 * torch.sin(state.flip(-1) * input)

    def observation(self, state, input):
        return state[..., :1] * input


STYLES = [Unpacks, Squeezes, Branches, AsksForTheNumber, WritesMatrices, ForBatches, Clockwork]
STEP = 4


def lti(g, lead=(), n=2, m=1):
    return pp.LTI(*matrices(g, n, m, lead))


def ltv(g, lead=(), n=2, m=1, T=6):
    return pp.LTV(*matrices(g, n, m, (*lead, T)))


def one(function, x, u, t=STEP):
    """A user's function of one sample, called by hand with what it takes."""
    t = torch.tensor([t]) if type(function.__self__).vectorized else torch.tensor(t)
    takes_time = "t" in function.__code__.co_varnames[: function.__code__.co_argcount]
    y = function(x, u, t) if takes_time else function(x, u)
    return y.reshape(-1)


@pytest.fixture(params=[*STYLES, lti, ltv], ids=lambda kind: kind.__name__)
def system(request, g):
    return request.param(g) if request.param in (lti, ltv) else request.param()


@pytest.fixture(params=STYLES, ids=lambda kind: kind.__name__)
def nonlinear(request):
    return request.param()


# --- steps, and batches of them


@pytest.mark.parametrize("lead", BATCHES, ids=str)
def test_a_batched_step_is_the_stack_of_single_steps(system, g, lead):
    x, u = draw(g, *lead, 2), draw(g, *lead, 1)
    system.reset(3)
    after, y = system(x, u)
    assert after.shape == x.shape and y.shape[:-1] == lead
    for i in np.ndindex(lead):
        alone = system.reset(3)(x[i], u[i])
        close(after[i], alone[0])
        close(y[i], alone[1])


@pytest.mark.parametrize("xs, us", [((3,), ()), ((), (3,)), ((2, 1), (3,))], ids=str)
def test_states_and_inputs_broadcast(system, g, xs, us):
    x, u = draw(g, *xs, 2), draw(g, *us, 1)
    lead = torch.broadcast_shapes(xs, us)
    want = system.reset(3)(x.expand(*lead, 2), u.expand(*lead, 1))
    for got, full in zip(system.reset(3)(x, u), want, strict=True):
        close(got, full, 0)


@pytest.mark.parametrize("lead", BATCHES[1:], ids=str)
@pytest.mark.parametrize("make", [lti, ltv])
def test_a_batch_of_linear_systems_steps_one_state_each(g, make, lead):
    systems, x, u = make(g, lead).reset(2), draw(g, *lead, 2), draw(g, *lead, 1)
    A, B, C, D, c1, c2 = (
        z if make is lti else z.select(-2 if z is systems._c1 or z is systems._c2 else -3, 2)
        for z in systems.buffers()
        if z.ndim
    )
    after, y = systems(x, u)
    close(
        after, torch.einsum("...ij,...j->...i", A, x) + torch.einsum("...ij,...j->...i", B, u) + c1
    )
    close(y, torch.einsum("...ij,...j->...i", C, x) + torch.einsum("...ij,...j->...i", D, u) + c2)


def test_a_number_is_a_state_of_one(g):
    system = pp.LTI(*matrices(g, 1, 1))
    after, y = system(torch.tensor(2.0), torch.tensor(3.0))
    assert after.shape == y.shape == (1,)
    close(after, 2 * system.A[0] + 3 * system.B[0] + system.c1)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_results_keep_the_dtype_of_the_state(dtype, g):
    torch.set_default_dtype(dtype)  # of sines of the time, too
    for kind in STYLES:
        system, x, u = kind(), draw(g, 2, dtype=dtype), draw(g, 1, dtype=dtype)
        assert {z.dtype for z in (*system(x, u), *system.linearize(x, u, STEP))} == {dtype}


# --- the clock


def test_the_clock_ticks_by_one_for_each_step_and_never_otherwise(system, g):
    x, u = draw(g, 3, 2), draw(g, 3, 1)
    for step in range(3):
        assert system.systime == step and system.systime.ndim == 0
        system(x, u)
    system.transition(x, u), system.observe(x, u, 1), system.linearize(x, u), system.systime
    system.linearize(x, u, 2), system.expand_transition(x, u, 1)[3](x)
    system.set_refpoint(x[0], u[0])
    assert system.systime == 3


def test_a_step_that_fails_does_not_tick():
    system = Unpacks()
    with pytest.raises(ValueError, match="not enough values to unpack"):
        system(torch.zeros(1), torch.zeros(1))
    with pytest.raises(ValueError, match="too many values to unpack"):
        system(torch.zeros(3), torch.zeros(1))
    assert system.systime == 0


def test_the_clock_may_be_set(g):
    system = Clockwork().reset(t=8)
    assert system.systime == 8
    system.systime = torch.tensor(5)
    assert system.systime == 5 and system.reset().systime == 0
    close(system.reset(5)(draw(g, 2), draw(g, 1))[0].isfinite().sum(), torch.tensor(2))


@pytest.mark.parametrize("t", [0.5, 2.7, float("nan"), float("inf")])
def test_a_time_that_is_no_step_is_refused(t):
    with pytest.raises(ValueError, match=f"t: expected a whole number of steps, got {t}"):
        Clockwork().systime = t


@pytest.mark.parametrize("kind", [Clockwork, WritesMatrices, AsksForTheNumber, ForBatches, ltv])
def test_a_step_is_taken_at_the_time_that_the_clock_shows(kind, g):
    system = ltv(g) if kind is ltv else kind()
    x, u = draw(g, 2), draw(g, 1)
    now, later = system.transition(x, u, 0), system.transition(x, u, 7)
    assert not torch.allclose(now, later)
    close(system(x, u)[0], now, 0)
    close(system.reset(7)(x, u)[0], later, 0)
    close(system.transition(x, u, torch.tensor(0)), now, 0)


def test_a_stack_of_matrices_is_counted_modulo_its_length(g):
    system, x, u = ltv(g, T=4), draw(g, 2), draw(g, 1)
    for t in range(9):
        A, B, c1 = system._A[t % 4], system._B[t % 4], system._c1[t % 4]
        close(system(x, u)[0], A @ x + B @ u + c1)


def test_a_system_may_read_the_clock_instead_of_an_argument(g):
    class Reads(pp.LTV):
        A = property(lambda self: torch.eye(2) * (1 + self.systime))
        B = property(lambda self: torch.ones(2, 1) * self._t)

    system, x, u = Reads(C=None), draw(g, 2), draw(g, 1)
    for t in (0, 3):
        close(system.transition(x, u, t), (1 + t) * x + t * u)
        close(system.linearize_transition(x, u, t)[1], (1.0 + t) * torch.eye(2))
    assert system.systime == 0


# --- linearisation


@pytest.mark.parametrize("lead", BATCHES, ids=str)
def test_a_linearisation_is_every_samples_jacobian(nonlinear, g, lead):
    x, u = draw(g, *lead, 2), draw(g, *lead, 1)
    A, B, C, D, c1, c2 = nonlinear.linearize(x, u, STEP)
    f, h = (
        (lambda x, u: one(nonlinear.state_transition, x, u)),
        (lambda x, u: one(nonlinear.observation, x, u)),
    )
    for i in np.ndindex(lead):
        (a, b), (c, d) = jacobian(f, (x[i], u[i])), jacobian(h, (x[i], u[i]))
        for got, want in ((A, a), (B, b), (C, c), (D, d)):
            assert got.shape == (*lead, *want.shape)
            close(got[i], want)
        close(a @ x[i] + b @ u[i] + c1[i], f(x[i], u[i]))
        close(c @ x[i] + d @ u[i] + c2[i], h(x[i], u[i]))


def test_a_linearisation_equals_central_differences(nonlinear, g):
    x, u = draw(g, 2), draw(g, 1)
    A, B, C, D, _, _ = nonlinear.linearize(x, u, STEP)
    close(A, central(lambda x: nonlinear.transition(x, u, STEP), x), 1e-8)
    close(B, central(lambda u: nonlinear.transition(x, u, STEP), u), 1e-8)
    close(C, central(lambda x: nonlinear.observe(x, u, STEP), x), 1e-8)
    close(D, central(lambda u: nonlinear.observe(x, u, STEP), u), 1e-8)


def test_a_linear_systems_matrices_are_its_linearisation(g):
    system = ltv(g, (3,))
    x, u = draw(g, 3, 2), draw(g, 3, 1)
    found = system.linearize(x, u, 9)
    for got, stack in zip(found, [z for z in system.buffers() if z.ndim], strict=True):
        close(got, stack[:, 3])


def test_a_linearisation_at_many_times_is_that_at_each(system, g):
    x, u, t = draw(g, 5, 3, 2), draw(g, 5, 3, 1), torch.tensor([2, 0, 5, 5, 1])
    for got, each in zip(
        system.linearize(x, u, t[:, None]),
        zip(*(system.linearize(x[i], u[i], int(t[i])) for i in range(5))),
        strict=True,
    ):
        close(got, torch.stack(each))


def test_each_member_of_a_batch_may_have_its_own_time(g):
    x, u, t = draw(g, 2, 3, 2), draw(g, 2, 3, 1), torch.tensor([[0, 4, 1], [2, 3, 3]])
    for system in (Clockwork(), ltv(g), ForBatches()):
        A = system.linearize(x, u, t).A
        for i, j in torch.cartesian_prod(torch.arange(2), torch.arange(3)).tolist():
            close(A[i, j], system.linearize(x[i, j], u[i, j], int(t[i, j])).A)


def test_parameters_of_a_vectorized_system_may_have_a_batch_of_their_own(g):
    slips, x, u = torch.tensor([0.0, 0.1, 0.5]), draw(g, 4), draw(g, 2)
    cars = pp.DubinsCar(slip=slips)
    for got, each in zip(
        (*cars(x, u), *cars.linearize(x, u)),
        zip(
            *(
                (*car(x, u), *car.linearize(x, u))
                for car in map(lambda s: pp.DubinsCar(slip=s), slips)
            )
        ),
        strict=True,
    ):
        close(got.expand_as(torch.stack(each)), torch.stack(each))


def test_a_vectorized_system_that_spreads_the_time_over_its_batch_is_told_so(g):
    class Spreads(ForBatches):
        def state_transition(self, state, input, t):
            return torch.stack([state[..., 0] * t, state[..., 1] * t], -1)

    with pytest.raises(ValueError, match=r"expected a batch \(3,\), got \(3, 3\); t comes as"):
        Spreads().linearize(draw(g, 3, 2), draw(g, 3, 1), torch.arange(3))


@pytest.mark.parametrize("lead", [(), (2,)], ids=str)
def test_the_curvature_is_the_hessian_of_the_costate_times_f(nonlinear, g, lead):
    x, u, costate = draw(g, *lead, 2), draw(g, *lead, 1), draw(g, *lead, 2)
    found = nonlinear.expand_transition(x, u, STEP)[3](costate)

    def f(z, l):
        return l @ one(nonlinear.state_transition, z[:2], z[2:])

    for i in np.ndindex(lead):
        z = torch.cat([x[i], u[i]])
        close(found[i], torch.autograd.functional.hessian(partial(f, l=costate[i]), z))


@pytest.mark.parametrize("slip", [(), (3,), (2, 1)], ids=str)
def test_taylors_expansion_goes_on_from_the_jacobians_and_has_no_graph(g, slip):
    """Also where the system's parameters have a batch of their own."""
    car = pp.DubinsCar(slip=draw(g, *slip).requires_grad_())
    x, u, costate = draw(g, 3, 4), draw(g, 3, 2), draw(g, 3, 4)
    *linear, curve = car.expand_transition(x, u)
    with torch.no_grad():
        wanted = car.linearize_transition(x, u)
    for found, want in zip(linear, wanted, strict=True):
        close(found, want)
        assert not found.requires_grad
    lead = torch.broadcast_shapes(slip, (3,))
    xs, us, costates = (z.expand(*lead, -1) for z in (x, u, costate))
    found, size = curve(costates), 1e-6
    assert found.shape == (*lead, 6, 6) and not found.requires_grad
    for j, step in enumerate(size * torch.eye(6)):
        slopes = [
            torch.cat(car.linearize_transition(xs + s * step[:4], us + s * step[4:])[1:], -1)
            for s in (1, -1)
        ]
        change = (slopes[0] - slopes[1]) / (2 * size)
        close(found[..., j], torch.einsum("...i,...ik->...k", costates, change).detach(), 1e-7)


def test_a_linear_system_has_no_curvature(g):
    for system in (lti(g, (3,)), ltv(g, (3,))):
        curve = system.expand_transition(draw(g, 2), draw(g, 1))[3]
        close(curve(draw(g, 3, 2)), torch.zeros(3, 3, 3), 0)


@pytest.mark.parametrize("lead", [(), (2,)], ids=str)
def test_steps_and_linearisations_have_exact_gradients(nonlinear, g, lead):
    x, u = draw(g, *lead, 2).requires_grad_(), draw(g, *lead, 1).requires_grad_()
    assert gradcheck(lambda x, u: nonlinear.reset(STEP)(x, u), (x, u))
    assert gradcheck(lambda x, u: tuple(nonlinear.linearize(x, u, STEP)), (x, u))


def test_gradients_reach_the_parameters_of_a_linear_system(g):
    x, u = draw(g, 2, 2), draw(g, 2, 1)
    given = [z.requires_grad_() for z in matrices(g, 2, 1)]
    assert gradcheck(lambda *given: pp.LTI(*given)(x, u), given)
    assert gradcheck(lambda *given: tuple(pp.LTI(*given).linearize(x, u)), given)
    stacks = [z.requires_grad_() for z in matrices(g, 2, 1, (3,))]
    t = torch.tensor([2, 0])
    assert gradcheck(lambda *given: tuple(pp.LTV(*given).linearize(x, u, t)), stacks)


def test_gradients_of_a_linearisation_reach_the_parameters_of_a_nonlinear_system(g):
    x, u, gain = draw(g, 3, 2), draw(g, 3, 1), torch.tensor(1.3, requires_grad=True)

    def linear(gain):
        system = Clockwork(gain).set_refpoint(x, u, STEP)
        return system.A, system.B, system.c1

    assert gradcheck(linear, (gain,))


# --- the reference point


def test_the_reference_point_stays_where_and_when_it_was_set(g):
    x, u = draw(g, 2), draw(g, 1)
    system = Clockwork().reset(3)
    assert system.set_refpoint(x, u) is system
    before = [z.clone() for z in (system.A, system.B, system.C, system.D, system.c1, system.c2)]
    for want, got in zip(system.linearize(x, u, 3), before):
        close(got, want, 0)
    for _ in range(2):
        system(draw(g, 2), draw(g, 1))
    for got, name in zip(before, ("A", "B", "C", "D", "c1", "c2")):
        close(getattr(system, name), got, 0)


def test_the_reference_point_is_the_latest_step_where_nothing_is_given(g):
    system, x, u = Clockwork(), draw(g, 2), draw(g, 1)
    system(x, u)
    close(system.set_refpoint().A, system.linearize(x, u, 1).A, 0)
    close(system.set_refpoint(t=torch.tensor(6.0)).A, system.linearize(x, u, 6).A, 0)
    close(system.set_refpoint(state=2 * x).C, system.linearize(2 * x, u, 1).C, 0)


def test_asking_too_early_says_what_to_do(g):
    for name in ("A", "B", "C", "D", "c1", "c2"):
        with pytest.raises(RuntimeError, match=r"call set_refpoint\(state, input, t\) first"):
            getattr(Clockwork(), name)
    with pytest.raises(RuntimeError, match="no step was taken yet, so give state and input"):
        Clockwork().set_refpoint()


def test_a_linear_system_is_its_own_reference(g):
    system = lti(g)
    A = system.A
    close(system.set_refpoint(draw(g, 2), draw(g, 1), t=3).A, A, 0)
    assert system.systime == 0
    later = ltv(g).set_refpoint(t=4)
    close(later.A, later._A[4], 0)


# --- errors of the user's code, and wrong arguments


@pytest.mark.parametrize("lead", [(), (3,)], ids=str)
@pytest.mark.parametrize(
    "error", [RuntimeError("mine"), AttributeError("mine"), ZeroDivisionError("mine")], ids=repr
)
def test_the_users_own_errors_arrive_unmasked(error, lead):
    class Broken(Unpacks):
        def state_transition(self, state, input):
            raise error

    system, x, u = Broken(), torch.zeros(*lead, 2), torch.zeros(*lead, 1)
    for call in (lambda: system(x, u), lambda: system.set_refpoint(x, u).A):
        with pytest.raises(type(error), match="mine"):
            call()


def test_a_misspelt_attribute_is_named_also_inside_a_property():
    class Misspelt(pp.LTV):
        A = property(lambda self: self.lenght * torch.eye(2))

    with pytest.raises(AttributeError, match="'Misspelt' object has no attribute 'lenght'"):
        Misspelt().A  # noqa: B018


def test_a_function_that_is_missing_or_returns_another_size_is_named(g):
    class Short(Unpacks):
        def state_transition(self, state, input):
            return state[:1]

    with pytest.raises(ValueError, match=r"state_transition: expected a state \(..., n=2\), got"):
        Short()(draw(g, 3, 2), draw(g, 3, 1))
    with pytest.raises(NotImplementedError, match="NLS has to define state_transition"):
        pp.NLS()(draw(g, 2), draw(g, 1))
    with pytest.raises(NotImplementedError, match="NLS has to define observation"):
        pp.NLS().observe(draw(g, 2), draw(g, 1))


@pytest.mark.parametrize(
    "change, words",
    [
        ({"A": (3, 2)}, "A: expected (..., n, n), got (3, 2)"),
        ({"B": (2, 1)}, "B: expected (..., n=3, m), got (2, 1); n=3 comes from A"),
        ({"C": (4, 2)}, "C: expected (..., p, n=3), got (4, 2); n=3 comes from A"),
        ({"D": (2, 2)}, "D: expected (..., p=3, m=2), got (2, 2); p=3 comes from C"),
        ({"c1": (2,)}, "c1: expected (..., n=3), got (2,); n=3 comes from A"),
        ({"c2": (2,)}, "c2: expected (..., p=3), got (2,); p=3 comes from C"),
        ({"A": (2, 3, 3), "B": (4, 3, 2)}, "B: its batch (4,) does not broadcast with (2,)"),
    ],
    ids=str,
)
def test_matrices_that_do_not_fit_together_are_named(g, change, words):
    given = dict(zip(("A", "B", "C", "D", "c1", "c2"), matrices(g, 3, 2)))
    given |= {name: torch.zeros(shape) for name, shape in change.items()}
    with pytest.raises(ValueError) as error:
        pp.LTI(**given)
    assert words in str(error.value)


@pytest.mark.parametrize(
    "x, u, words",
    [
        ((4,), (1,), "state: expected (..., n=2), got (4,)"),
        ((2,), (3,), "input: expected (..., m=1), got (3,)"),
        ((3, 2), (4, 1), "input: its batch (4,) does not broadcast with (3,)"),
    ],
    ids=str,
)
def test_states_and_inputs_that_do_not_fit_are_named(g, x, u, words):
    for system in (lti(g), ltv(g), pp.Pendulum()):
        with pytest.raises(ValueError) as error:
            system(torch.zeros(x), torch.zeros(u))
        assert words in str(error.value)


@pytest.mark.parametrize("bad", [None, 1.0, [0.0, 1.0]], ids=repr)
def test_states_and_inputs_have_to_be_floating_tensors(g, bad):
    for system in (lti(g), Unpacks()):
        with pytest.raises(ValueError, match="state: expected a floating-point tensor, got"):
            system(bad, torch.zeros(1))
        with pytest.raises(ValueError, match="input: expected a floating-point tensor, got"):
            system(torch.zeros(2), bad)
        with pytest.raises(ValueError, match="expected a floating-point tensor, got torch.int64"):
            system(torch.tensor([1, 2]), torch.zeros(1))


@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
def test_numbers_that_are_not_finite_or_of_another_dtype_are_refused(g, kind):
    system, x, u = Unpacks(), torch.zeros(2, dtype=kind), torch.zeros(1, dtype=kind)
    with pytest.raises(ValueError, match=r"state: expected finite numbers, got nan at \(0,\)"):
        system(x * torch.nan, u)
    with pytest.raises(ValueError, match=r"input: expected finite numbers, got inf at \(0,\)"):
        system(x, u + torch.inf)
    other = torch.float64 if kind == torch.float32 else torch.float32
    with pytest.raises(ValueError, match=f"input: expected {kind} on cpu like state"):
        system(x, u.to(other))


# --- modules


def test_parameters_are_learned_and_move_with_the_module(g):
    A, B, C, D, c1, _ = (z.float() for z in matrices(g, 2, 1))
    system = pp.LTI(torch.nn.Parameter(A), B, torch.nn.Parameter(C), D, torch.nn.Parameter(c1))
    assert {name for name, _ in system.named_parameters()} == {"_A", "_C", "_c1"}
    system = system.double()
    y = system(draw(g, 2), draw(g, 1))
    assert {z.dtype for z in y} == {torch.float64} and system.systime.dtype == torch.int64
    sum(z.sum() for z in y).backward()
    assert all(p.grad is not None for p in system.parameters())


def test_a_parameter_may_be_a_state(g):
    for system in (lti(g), Unpacks()):
        x = torch.nn.Parameter(draw(g, 2))
        system(x, draw(g, 1))[0].sum().backward()
        assert x.grad is not None
        system(draw(g, 2), draw(g, 1))
        assert "state" not in dict(system.named_parameters())


def test_a_state_dict_brings_back_matrices_and_clock(g):
    first, second = lti(g), lti(g)
    first.reset(5)
    second.load_state_dict(first.state_dict())
    assert second.systime == 5
    x, u = draw(g, 2), draw(g, 1)
    close(second(x, u)[0], first(x, u)[0], 0)
    first(x, u)
    assert second.systime == 6


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda s: pickle.loads(pickle.dumps(s))])
def test_copies_work_also_after_a_backward_and_live_apart(g, duplicate):
    system = pp.DubinsCar(slip=torch.nn.Parameter(torch.tensor(0.2)))
    x, u = draw(g, 4).requires_grad_(), draw(g, 2)
    system(x, u)[0].sum().backward()
    system.set_refpoint(x * 2, u).A.sum().backward()
    other = duplicate(system)
    assert other.systime == 1
    other(x, u)
    assert (system.systime, other.systime) == (1, 2)
    close(other.A, system.A, 0)
    assert other.slip.requires_grad and other.slip is not system.slip


def test_arguments_stay_as_they_were_and_equal_calls_give_equal_answers(system, g):
    x, u = draw(g, 3, 2), draw(g, 3, 1)
    before = x.clone(), u.clone(), copy.deepcopy(system.state_dict())
    first, second = (system.linearize(x, u, STEP) for _ in range(2))
    for a, b in zip(first, second):
        close(a, b, 0)
    close(system.reset(STEP)(x, u)[0], system.reset(STEP)(x, u)[0], 0)
    close(x, before[0], 0), close(u, before[1], 0)
    for name, value in system.reset().state_dict().items():
        close(value, before[2][name], 0)


def test_an_affine_nonlinear_system_is_the_linear_one(g):
    given = matrices(g, 3, 2)
    linear, written = pp.LTI(*given), Affine(*given)
    x, u = draw(g, 4, 3), draw(g, 4, 2)
    for a, b in zip(
        (*linear(x, u), *linear.linearize(x, u)), (*written(x, u), *written.linearize(x, u))
    ):
        close(a, b)
