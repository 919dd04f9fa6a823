"""Contracts: what fits passes and says its sizes; what does not is named, with what was wanted."""

import pytest
import torch
from oracles import close, draw

from pypose_lite.shapes import (
    alike,
    check,
    has_numbers,
    inside_transform,
    join,
    over_time,
    register,
)

pytestmark = pytest.mark.usefixtures("float64")


def test_check_returns_the_sizes_that_the_letters_stand_for():
    A, B = torch.zeros(5, 3, 3), torch.zeros(3, 2)
    assert check("A: n n, B: n m", A, B) == {"n": 3, "m": 2}
    assert check("A: n n, c: n, B: n m", A, None, B, m=2) == {"n": 3, "m": 2}


@pytest.mark.parametrize(
    "spec, shapes, sizes, words",
    [
        ("A: n n", [(3, 4)], {}, r"A: expected (..., n, n), got (3, 4)"),
        ("A: n n", [(4,)], {}, r"A: expected (..., n, n), got (4,)"),
        (
            "A: n n, B: n m",
            [(4, 4), (3, 1)],
            {},
            "B: expected (..., n=4, m), got (3, 1); n=4 comes from A",
        ),
        (
            "C: p n, B: n m, D: p m",
            [(2, 4), (4, 1), (2, 2)],
            {},
            "D: expected (..., p=2, m=1), got (2, 2); p=2 comes from C; m=1 comes from B",
        ),
        ("x: n", [(3,)], {"n": 4}, "x: expected (..., n=4), got (3,)"),
        ("x: n", [()], {}, "x: expected (..., n), got ()"),
        ("x: n, u: m", [(2, 4), (3, 1)], {}, "u: its batch (3,) does not broadcast with (2,)"),
        ("x: n", [(2, 4, 5, 3)], {"n": 2}, "x: expected (..., n=2), got (2, 4, 5, 3)"),
    ],
)
def test_a_shape_that_does_not_fit_is_named_with_what_was_expected_and_why(
    spec, shapes, sizes, words
):
    with pytest.raises(ValueError) as error:
        check(spec, *(torch.zeros(shape) for shape in shapes), **sizes)
    assert str(error.value) == words


@pytest.mark.parametrize(
    "x, words",
    [
        ([1.0, 2.0], "x: expected a floating-point tensor, got list"),
        (torch.tensor([1, 2]), "x: expected a floating-point tensor, got torch.int64"),
        (torch.zeros(2, dtype=torch.float32), "expected torch.float64 on cpu like y"),
        (torch.zeros(2, device="meta").double(), "x: expected torch.float64 on cpu like y, got"),
        (
            torch.tensor([[0, 1], [2, torch.nan]]).double(),
            "expected finite numbers, got nan at (1, 1)",
        ),
        (torch.tensor([1, -torch.inf]).double(), "x: expected finite numbers, got -inf at (1,)"),
        (
            torch.tensor([torch.inf, -torch.inf]).double(),
            "expected finite numbers, got inf at (0,)",
        ),
    ],
)
def test_a_tensor_of_the_wrong_kind_is_named(x, words):
    with pytest.raises(ValueError) as error:
        check("y: n, x: m", torch.zeros(2), x)
    assert words in str(error.value)


def test_numbers_whose_sum_overflows_are_finite_all_the_same():
    check("x: n", torch.full((3,), 1e308))


def test_bounds_may_be_infinite_but_never_nan():
    alike("u", torch.tensor([torch.inf, -torch.inf, 0]), torch.zeros(1), infinite=True)
    with pytest.raises(ValueError, match="u: expected finite numbers, got nan"):
        alike("u", torch.tensor([torch.inf, torch.nan]), torch.zeros(1), infinite=True)


def test_a_contract_may_stand_inside_vmap(g):
    def first(x):
        check("x: n", x, n=3)
        return x[0]

    x = draw(g, 4, 3)
    close(torch.vmap(first)(x), x[:, 0])


@pytest.mark.parametrize("lead, batch, both", [((), (2,), (2,)), ((3, 1), (2,), (3, 2))])
def test_batches_join(lead, batch, both):
    assert join("x", lead, batch) == both


@pytest.mark.parametrize(
    "lead", [(), (1,), (4,), (1, 4), (3, 4), (3, 1), (1, 1), (3,)], ids=lambda lead: str(lead)
)
def test_a_sequence_has_time_first_however_it_was_given(g, lead):
    """T = 4 steps for a batch of 3."""
    value = draw(g, *lead, 2, 2)
    full = value[:, None] if lead == (3,) else value
    want = full.expand(3, 4, 2, 2).movedim(1, 0)
    got = over_time("Q", value, (2, 2), 4, (3,))
    got = got if got.ndim == 4 else got[:, None]
    close(got.expand_as(want), want, 0)


@pytest.mark.parametrize("lead", [(2,), (5,), (4, 3), (2, 4), (3, 2, 4)], ids=str)
def test_a_sequence_of_another_length_or_batch_is_refused(lead):
    with pytest.raises(ValueError) as error:
        over_time("p", torch.zeros(*lead, 2), (2,), 4, (3,))
    assert str(error.value) == f"p: expected (..., T=4, 2) for a batch (3,), got {(*lead, 2)}"


@pytest.mark.parametrize("batch", [(4,), (1,), (2, 4)], ids=str)
def test_what_may_be_a_batch_or_steps_is_refused_and_what_the_error_advises_works(g, batch):
    value = draw(g, 4, 2, 2)
    with pytest.raises(ValueError, match="may be T=4 steps or a batch") as error:
        over_time("Q", value, (2, 2), 4, batch)
    steps = value.reshape(*[1] * len(batch), 4, 2, 2)
    assert f"give {tuple(steps.shape)}" in str(error.value)
    close(over_time("Q", steps, (2, 2), 4, batch).reshape(4, 2, 2), value, 0)
    members = value.expand(*batch[:-1], 4, 2, 2).unsqueeze(-3)
    close(over_time("Q", members, (2, 2), 4, batch)[0], members.squeeze(-3), 0)


# --- numbers that cannot be asked for


def test_numbers_can_be_asked_for_but_in_vmap_and_while_torch_compiles():
    seen = {}

    def note(where):
        def function(x):
            seen[where] = has_numbers(x), inside_transform(x)
            return x.sum()

        return function

    x = torch.ones(2, 3)
    note("outside")(x), torch.vmap(note("vmap"))(x), torch.func.grad(note("grad"))(x)
    torch.vmap(torch.func.grad(note("grad in vmap")))(x)
    torch.func.grad(lambda x: torch.vmap(note("vmap in grad"))(x).sum())(x)
    torch.func.jacrev(note("jacrev"))(x), torch.func.jvp(note("jvp"), (x,), (x,))
    asked = {"outside": (True, False), "grad": (True, True), "jacrev": (True, True)}
    mapped = dict.fromkeys(("vmap", "grad in vmap", "vmap in grad"), (False, True))
    assert seen == asked | mapped | {"jvp": (True, True)}
    torch.vmap(lambda other: note("beside vmap")(x) + other)(x)
    assert seen["beside vmap"] == (True, True)  # x itself is as it was, requires_grad_ is refused
    compiled = torch.compile(lambda x: x * 2 if has_numbers(x) else x, backend="eager")
    close(compiled(x), x, 0)


# --- what modules keep


@pytest.mark.parametrize("first", [None, torch.ones(2), torch.nn.Parameter(torch.ones(2))])
@pytest.mark.parametrize("then", [None, torch.zeros(2), torch.nn.Parameter(torch.zeros(2))])
def test_what_a_module_keeps_is_a_parameter_or_a_buffer_and_may_be_replaced(first, then):
    module = torch.nn.Module()
    register(module, "Q", first)
    register(module, "Q", then)
    learned, kept = isinstance(then, torch.nn.Parameter), then is not None
    assert module.Q is then
    assert [name for name, _ in module.named_parameters()] == ["Q"] * learned
    assert list(module.state_dict()) == ["Q"] * kept
    assert not kept or module.to(torch.float32).Q.dtype == torch.float32
