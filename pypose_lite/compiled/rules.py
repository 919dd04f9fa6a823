"""What each of torch's operations does to the places of numbers, for `recorder`.

What only moves numbers is done to places by the operation itself (MOVES); what treats every number
alike has the same name in C++ (ALIKE) or a formula (RULES); what makes new tensors makes constants.
Anything else torch decomposes into these, or it is refused.
"""

import math
from collections.abc import Callable
from functools import reduce
from typing import Any

import torch
from torch import Tensor

from .places import Places, Unsupported, address, flat
from .scalars import power

MOVES = """_unsafe_view cat clone constant_pad_nd diagonal_scatter flip gather index_select
lift_fresh_copy repeat roll select_scatter slice_scatter stack take""".split()
NEW = """empty_like full_like new_empty new_empty_strided new_full new_ones new_zeros ones_like
zeros_like""".split()
ALIKE = """abs acos add asin atan atan2 ceil cos cosh div eq erf exp expm1 floor ge gt le log log1p
lt maximum minimum mul ne neg remainder round sign sin sinh sqrt sub tan tanh trunc where""".split()
WRITES = ("copy_", "fill_", "index_put_", "zero_")
BY_INDEX = ("gather", "index_select", "take")


def knows(places: Places, func, name: str, given: list[Tensor]) -> bool:
    """Returns whether there is a rule: also for views, and for what is made of constants alone."""
    view = any(argument.alias_info for argument in func._schema.arguments)
    named = name in RULES or name in MOVES or name in ALIKE or name in NEW
    return view or named or all(places.is_constant(z) for z in given)


def origin(places: Places, func, name: str, args, kwargs, result: Tensor, i: int) -> Any:
    """Returns the places of the i-th result of an operation, a new tensor."""
    given = [z for z in flat((args, kwargs)) if isinstance(z, Tensor)]
    if name in NEW or i > 0 or all(places.is_constant(z) for z in given):
        return [places.arithmetic.constant(value) for value in result.flatten().tolist()]
    if name in MOVES:
        return _moved(places, func, name, args, kwargs)
    if name in ALIKE:
        return _alike(places, name, args, dict(kwargs))
    return RULES[name](places, *args, **kwargs)


def write(places: Places, func, name: str, args) -> None:
    """Does to the places of a tensor what an operation in WRITES does to its numbers."""
    target = args[0]
    if any(address(z) == address(target) for z in places.parameters):
        raise Unsupported("writes into a tensor that it keeps")
    if name == "index_put_":
        func(
            places.of(target),
            [_index(places, index) for index in args[1]],
            places.of(args[2]),
            *args[3:],
        )
    else:
        value = 0 if name == "zero_" else args[1]
        places.of(target).copy_(number(places, value).expand(target.shape))


# --- what moves numbers


def _moved(places: Places, func, name: str, args, kwargs) -> Tensor:
    """Returns places, moved as an operation moves numbers."""
    first, *rest = args
    if name in BY_INDEX:
        rest = [_index(places, z) if isinstance(z, Tensor) else z for z in rest]
    elif name == "constant_pad_nd":
        rest = [rest[0], number(places, rest[1] if len(rest) > 1 else 0).item()]
    else:
        rest = [places.of(z) if isinstance(z, Tensor) else z for z in rest]
    first = [places.of(z) for z in first] if isinstance(first, list | tuple) else places.of(first)
    return func(first, *rest, **{key: kwargs[key] for key in kwargs if key != "memory_format"})


def _index(places: Places, z: Tensor | None) -> Tensor | None:
    """Returns an index, having made sure that it is the same whatever x, u and t are."""
    if z is not None:
        places.ask(z, "indexes a tensor by what it has computed of a state or an input")
    return z


def _picked(places: Places, z: Tensor, indices: list) -> Tensor:
    """Returns what an index picks; a computed one, of the first dimension, when the code runs."""
    if len(indices) > 1 or indices[0].dtype == torch.bool or not places.depends(indices[0]):
        return torch.ops.aten.index(places.of(z), [_index(places, i) for i in indices])
    columns = places.of(z).reshape(len(z), -1).unbind(1)
    at = places.of(indices[0]).flatten().tolist()
    core = [_pick(places, i, column.tolist()) for i in at for column in columns]
    return torch.tensor(core).reshape(*indices[0].shape, *z.shape[1:])


def _pick(places: Places, at: int, choices: list[int]) -> int:
    """Returns the place of one of some numbers, chosen by a whole number; NaN outside of them."""
    do, constant = places.arithmetic.do, places.arithmetic.constant
    size = constant(len(choices))
    at = do("where", do("lt", at, constant(0)), do("add", at, size), at)
    inside = do("mul", do("ge", at, constant(0)), do("lt", at, size))

    def between(low: int, high: int) -> int:
        if high - low == 1:
            return choices[low]
        middle = (low + high) // 2
        left = do("lt", at, constant(middle))
        return do("where", left, between(low, middle), between(middle, high))

    return do("where", inside, between(0, len(choices)), constant(math.nan))


def _to_type(places: Places, z: Tensor, dtype: torch.dtype | None = None, **_: Any) -> Tensor:
    rounds = z.is_floating_point() and dtype is not None and not dtype.is_floating_point
    if dtype is torch.bool:
        return each(places, "ne", places.of(z), number(places, 0))
    return each(places, "trunc", places.of(z)) if rounds else places.of(z).clone()


# --- what treats every number alike


def number(places: Places, z: Any) -> Tensor:
    """Returns the places of an argument that may be a plain number."""
    return (
        places.of(z)
        if isinstance(z, Tensor)
        else torch.tensor(places.arithmetic.constant(float(z)))
    )


def each(places: Places, op: str, *zs: Tensor) -> Tensor:
    """Returns the places of ``op`` of every number of some tensors that broadcast."""
    zs = torch.broadcast_tensors(*zs)
    made = [places.arithmetic.do(op, *args) for args in zip(*(z.flatten().tolist() for z in zs))]
    return torch.tensor(made, dtype=torch.int64).reshape(zs[0].shape)


def _alike(places: Places, name: str, args, kwargs: dict) -> Tensor:
    zs = [number(places, z) for z in args]
    if name in ("add", "sub"):
        zs[1] = each(places, "mul", zs[1], number(places, kwargs.pop("alpha", 1)))
    rounding = kwargs.pop("rounding_mode", None)
    if kwargs:
        raise Unsupported(f"uses {name} with {', '.join(kwargs)}")
    made = each(places, name, *zs)
    return each(places, rounding, made) if rounding else made


def formula(write: Callable[..., Tensor]) -> Callable[..., Tensor]:
    """Returns the rule of an operation: a formula ``write(do, *args)`` of numbers and tensors."""

    def rule(places: Places, *args: Any) -> Tensor:
        def do(op: str, *zs: Any) -> Tensor:
            return each(
                places, op, *(z if isinstance(z, Tensor) else number(places, z) for z in zs)
            )

        return write(do, *(number(places, z) for z in args))

    return rule


def _power(places: Places, a: Any, b: Any) -> Tensor:
    if isinstance(b, Tensor):
        return each(places, "pow", number(places, a), places.of(b))
    made = [power(places.arithmetic, place, float(b)) for place in places.of(a).flatten().tolist()]
    return torch.tensor(made).reshape(a.shape)


def _clamp(places: Places, a: Tensor, low: Any = None, high: Any = None) -> Tensor:
    within = places.of(a)
    for bound, order in ((low, "lt"), (high, "gt")):
        if bound is not None:
            bound = number(places, bound)
            within = each(places, "where", each(places, order, within, bound), bound, within)
    return within


# --- sums, products, and what is made of them


def _fold(op: str) -> Callable[..., Tensor]:
    """Returns the rule of sums, products or extremes along some dimensions."""

    def rule(places: Places, a: Tensor, dim: Any = None, keepdim=False, dtype=None) -> Tensor:
        dims = range(a.ndim) if dim is None or dim == [] else [dim] if isinstance(dim, int) else dim
        dims = [d % a.ndim for d in dims]
        rest = [d for d in range(a.ndim) if d not in dims]
        rows = places.of(a).permute(*rest, *dims).reshape(-1, math.prod(a.shape[d] for d in dims))
        made = [reduce(lambda i, j: places.arithmetic.do(op, i, j), row) for row in rows.tolist()]
        kept = [1 if d in dims else s for d, s in enumerate(a.shape) if keepdim or d not in dims]
        return torch.tensor(made, dtype=torch.int64).reshape(kept)

    return rule


def _mean(places: Places, a: Tensor, dim: Any = None, keepdim=False, dtype=None) -> Tensor:
    total = _fold("add")(places, a, dim, keepdim)
    return each(places, "div", total, number(places, a.numel() / total.numel()))


def _cumsum(places: Places, a: Tensor, dim: int, dtype=None) -> Tensor:
    sums = list(places.of(a).unbind(dim))
    for i in range(1, len(sums)):
        sums[i] = each(places, "add", sums[i - 1], sums[i])
    return torch.stack(sums, dim)


def product(places: Places, A: Tensor, B: Tensor) -> Tensor:
    """Returns the product of two matrices of places, ``(..., i, j)`` and ``(..., j, k)``."""
    terms = each(places, "mul", A.unsqueeze(-1), B.unsqueeze(-3)).unbind(-2)
    return reduce(lambda a, b: each(places, "add", a, b), terms)


def _addmm(
    places: Places, c: Tensor, a: Tensor, b: Tensor, beta: Any = 1, alpha: Any = 1
) -> Tensor:
    if (beta, alpha) != (1, 1):
        raise Unsupported("uses addmm with factors")
    return each(places, "add", places.of(c), product(places, places.of(a), places.of(b)))


def _solve(places: Places, A: Tensor, B: Tensor, left: bool = True, **_: Any) -> Tensor:
    """Gauss's elimination; rows are swapped by choices between numbers, the largest first."""
    if not left or A.ndim != 2:
        raise Unsupported("solves from the right, or for a batch")
    return eliminate(places, places.of(A), places.of(B).reshape(len(A), -1)).reshape(B.shape)


def _inverse(places: Places, A: Tensor, **_: Any) -> Tensor:
    if A.ndim != 2:
        raise Unsupported("inverts a batch of matrices")
    one, zero = number(places, 1), number(places, 0)
    return eliminate(places, places.of(A), torch.where(torch.eye(len(A)) > 0, one, zero))


def eliminate(places: Places, A: Tensor, B: Tensor) -> Tensor:
    """Returns the solution of ``A X = B``, matrices of places."""
    rows, size = list(torch.cat([A, B], 1)), len(A)

    def less(i: int, j: int) -> Tensor:  # row i without what row j has in column j
        return each(places, "sub", rows[i], each(places, "mul", rows[i][j], rows[j]))

    for j in range(size):
        for i in range(j + 1, size):
            a, b = rows[i], rows[j]
            swap = each(places, "gt", each(places, "abs", a[j]), each(places, "abs", b[j]))
            rows[j], rows[i] = each(places, "where", swap, a, b), each(places, "where", swap, b, a)
        rows[j] = each(places, "div", rows[j], rows[j][j])
        for i in range(j + 1, size):
            rows[i] = less(i, j)
    for j in reversed(range(size)):
        for i in range(j):
            rows[i] = less(i, j)
    return torch.stack(rows)[:, size:]


RULES: dict[str, Callable[..., Any]] = {
    "_linalg_solve_ex": _solve,
    "_to_copy": _to_type,
    "addmm": _addmm,
    "amax": _fold("maximum"),
    "amin": _fold("minimum"),
    "bitwise_and": formula(lambda do, a, b: do("mul", a, b)),
    "bitwise_not": formula(lambda do, a: do("eq", a, 0)),
    "bitwise_or": formula(lambda do, a, b: do("maximum", a, b)),
    "bmm": lambda places, a, b: product(places, places.of(a), places.of(b)),
    "clamp": _clamp,
    "clamp_max": lambda places, a, high: _clamp(places, a, None, high),
    "clamp_min": _clamp,
    "cumsum": _cumsum,
    "dot": lambda places, a, b: product(places, places.of(a)[None], places.of(b)[:, None])[0, 0],
    "floor_divide": formula(lambda do, a, b: do("floor", do("div", a, b))),
    "hypot": formula(lambda do, a, b: do("sqrt", do("add", do("mul", a, a), do("mul", b, b)))),
    "index": _picked,
    "linalg_inv_ex": _inverse,
    "logical_and": formula(lambda do, a, b: do("mul", do("ne", a, 0), do("ne", b, 0))),
    "logical_not": formula(lambda do, a: do("eq", a, 0)),
    "logical_or": formula(lambda do, a, b: do("maximum", do("ne", a, 0), do("ne", b, 0))),
    "masked_fill": formula(lambda do, a, mask, value: do("where", mask, value, a)),
    "mean": _mean,
    "mm": lambda places, a, b: product(places, places.of(a), places.of(b)),
    "mv": lambda places, a, b: product(places, places.of(a), places.of(b)[:, None])[:, 0],
    "pow": _power,
    "prod": _fold("mul"),
    "reciprocal": formula(lambda do, a: do("div", 1, a)),
    "relu": formula(lambda do, a: do("where", do("gt", a, 0), a, 0)),
    "rsqrt": formula(lambda do, a: do("div", 1, do("sqrt", a))),
    "sgn": formula(lambda do, a: do("sign", a)),
    "sigmoid": formula(lambda do, a: do("div", 1, do("add", 1, do("exp", do("neg", a))))),
    "square": formula(lambda do, a: do("mul", a, a)),
    "sum": _fold("add"),
}
