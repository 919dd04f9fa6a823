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


def knows(r: Places, func, name: str, given: list[Tensor]) -> bool:
    """Returns whether there is a rule: also for views, and for what is made of constants alone."""
    view = any(argument.alias_info for argument in func._schema.arguments)
    named = name in RULES or name in MOVES or name in ALIKE or name in NEW
    return view or named or all(r.is_constant(z) for z in given)


def origin(r: Places, func, name: str, args, kwargs, result: Tensor, i: int) -> Any:
    """Returns the places of the i-th result of an operation, a new tensor."""
    given = [z for z in flat((args, kwargs)) if isinstance(z, Tensor)]
    if name in NEW or i > 0 or all(r.is_constant(z) for z in given):
        return [r.arithmetic.constant(value) for value in result.flatten().tolist()]
    if name in MOVES:
        return _moved(r, func, name, args, kwargs)
    if name in ALIKE:
        return _alike(r, name, args, dict(kwargs), result)
    return RULES[name](r, *args, **kwargs)


def write(r: Places, func, name: str, args) -> None:
    """Does to the places of a tensor what an operation in WRITES does to its numbers."""
    target = args[0]
    if any(address(z) == address(target) for z in r.parameters):
        raise Unsupported("writes into a tensor that it keeps")
    if name == "index_put_":
        func(r.of(target), [_index(r, index) for index in args[1]], r.of(args[2]), *args[3:])
    else:
        value = 0 if name == "zero_" else args[1]
        r.of(target).copy_(number(r, value).expand(target.shape))


# --- what moves numbers


def _moved(r: Places, func, name: str, args, kwargs) -> Tensor:
    """Returns places, moved as an operation moves numbers."""
    first, *rest = args
    if name in BY_INDEX:
        rest = [_index(r, z) if isinstance(z, Tensor) else z for z in rest]
    elif name == "constant_pad_nd":
        rest = [rest[0], number(r, rest[1] if len(rest) > 1 else 0).item()]
    else:
        rest = [r.of(z) if isinstance(z, Tensor) else z for z in rest]
    first = [r.of(z) for z in first] if isinstance(first, list | tuple) else r.of(first)
    return func(first, *rest, **{key: kwargs[key] for key in kwargs if key != "memory_format"})


def _index(r: Places, z: Tensor | None) -> Tensor | None:
    """Returns an index, having made sure that it is the same whatever x, u and t are."""
    if z is not None:
        r.ask(z, "indexes a tensor by what it has computed of a state or an input")
    return z


def _picked(r: Places, z: Tensor, indices: list) -> Tensor:
    """Returns what an index picks; a computed one, of the first dimension, when the code runs."""
    if len(indices) > 1 or indices[0].dtype == torch.bool or not r.depends(indices[0]):
        return torch.ops.aten.index(r.of(z), [_index(r, i) for i in indices])
    columns = r.of(z).reshape(len(z), -1).unbind(1)
    at = r.of(indices[0]).flatten().tolist()
    core = [_pick(r, i, column.tolist()) for i in at for column in columns]
    return torch.tensor(core).reshape(*indices[0].shape, *z.shape[1:])


def _pick(r: Places, at: int, choices: list[int]) -> int:
    """Returns the place of one of some numbers, chosen by a whole number; NaN outside of them."""
    do, constant = r.arithmetic.do, r.arithmetic.constant
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


def _to_type(r: Places, z: Tensor, dtype: torch.dtype | None = None, **_: Any) -> Tensor:
    rounds = z.is_floating_point() and dtype is not None and not dtype.is_floating_point
    if dtype is torch.bool:
        return each(r, "ne", r.of(z), number(r, 0))
    return each(r, "trunc", r.of(z)) if rounds else r.of(z).clone()


# --- what treats every number alike


def number(r: Places, z: Any) -> Tensor:
    """Returns the places of an argument that may be a plain number."""
    return r.of(z) if isinstance(z, Tensor) else torch.tensor(r.arithmetic.constant(float(z)))


def each(r: Places, op: str, *zs: Tensor) -> Tensor:
    """Returns the places of ``op`` of every number of some tensors that broadcast."""
    zs = torch.broadcast_tensors(*zs)
    made = [r.arithmetic.do(op, *args) for args in zip(*(z.flatten().tolist() for z in zs))]
    return torch.tensor(made, dtype=torch.int64).reshape(zs[0].shape)


def _alike(r: Places, name: str, args, kwargs: dict, result: Tensor) -> Tensor:
    zs = [number(r, z) for z in args]
    if name in ("add", "sub"):
        zs[1] = each(r, "mul", zs[1], number(r, kwargs.pop("alpha", 1)))
    rounding = kwargs.pop("rounding_mode", None)
    if kwargs:
        raise Unsupported(f"uses {name} with {', '.join(kwargs)}")
    made = each(r, name, *zs)
    return each(r, rounding, made) if rounding else made


def formula(write: Callable[..., Tensor]) -> Callable[..., Tensor]:
    """Returns the rule of an operation: a formula ``write(do, *args)`` of numbers and tensors."""

    def rule(r: Places, *args: Any) -> Tensor:
        def do(op: str, *zs: Any) -> Tensor:
            return each(r, op, *(z if isinstance(z, Tensor) else number(r, z) for z in zs))

        return write(do, *(number(r, z) for z in args))

    return rule


def _power(r: Places, a: Any, b: Any) -> Tensor:
    if isinstance(b, Tensor):
        return each(r, "pow", number(r, a), r.of(b))
    made = [power(r.arithmetic, place, float(b)) for place in r.of(a).flatten().tolist()]
    return torch.tensor(made).reshape(a.shape)


def _clamp(r: Places, a: Tensor, low: Any = None, high: Any = None) -> Tensor:
    places = r.of(a)
    for bound, order in ((low, "lt"), (high, "gt")):
        if bound is not None:
            bound = number(r, bound)
            places = each(r, "where", each(r, order, places, bound), bound, places)
    return places


# --- sums, products, and what is made of them


def _fold(op: str) -> Callable[..., Tensor]:
    """Returns the rule of sums, products or extremes along some dimensions."""

    def rule(r: Places, a: Tensor, dim: Any = None, keepdim=False, dtype=None) -> Tensor:
        dims = range(a.ndim) if dim is None or dim == [] else [dim] if isinstance(dim, int) else dim
        dims = [d % a.ndim for d in dims]
        rest = [d for d in range(a.ndim) if d not in dims]
        rows = r.of(a).permute(*rest, *dims).reshape(-1, math.prod(a.shape[d] for d in dims))
        made = [reduce(lambda i, j: r.arithmetic.do(op, i, j), row) for row in rows.tolist()]
        kept = [1 if d in dims else s for d, s in enumerate(a.shape) if keepdim or d not in dims]
        return torch.tensor(made, dtype=torch.int64).reshape(kept)

    return rule


def _mean(r: Places, a: Tensor, dim: Any = None, keepdim=False, dtype=None) -> Tensor:
    total = _fold("add")(r, a, dim, keepdim)
    return each(r, "div", total, number(r, a.numel() / total.numel()))


def _cumsum(r: Places, a: Tensor, dim: int, dtype=None) -> Tensor:
    sums = list(r.of(a).unbind(dim))
    for i in range(1, len(sums)):
        sums[i] = each(r, "add", sums[i - 1], sums[i])
    return torch.stack(sums, dim)


def product(r: Places, A: Tensor, B: Tensor) -> Tensor:
    """Returns the product of two matrices of places, ``(..., i, j)`` and ``(..., j, k)``."""
    terms = each(r, "mul", A.unsqueeze(-1), B.unsqueeze(-3)).unbind(-2)
    return reduce(lambda a, b: each(r, "add", a, b), terms)


def _addmm(r: Places, c: Tensor, a: Tensor, b: Tensor, beta: Any = 1, alpha: Any = 1) -> Tensor:
    if (beta, alpha) != (1, 1):
        raise Unsupported("uses addmm with factors")
    return each(r, "add", r.of(c), product(r, r.of(a), r.of(b)))


def _solve(r: Places, A: Tensor, B: Tensor, left: bool = True, **_: Any) -> Tensor:
    """Gauss's elimination; rows are swapped by choices between numbers, the largest first."""
    if not left or A.ndim != 2:
        raise Unsupported("solves from the right, or for a batch")
    return eliminate(r, r.of(A), r.of(B).reshape(len(A), -1)).reshape(B.shape)


def _inverse(r: Places, A: Tensor, **_: Any) -> Tensor:
    if A.ndim != 2:
        raise Unsupported("inverts a batch of matrices")
    one, zero = number(r, 1), number(r, 0)
    return eliminate(r, r.of(A), torch.where(torch.eye(len(A)) > 0, one, zero))


def eliminate(r: Places, A: Tensor, B: Tensor) -> Tensor:
    """Returns the solution of ``A X = B``, matrices of places."""
    rows, size = list(torch.cat([A, B], 1)), len(A)

    def less(i: int, j: int) -> Tensor:  # row i without what row j has in column j
        return each(r, "sub", rows[i], each(r, "mul", rows[i][j], rows[j]))

    for j in range(size):
        for i in range(j + 1, size):
            a, b = rows[i], rows[j]
            swap = each(r, "gt", each(r, "abs", a[j]), each(r, "abs", b[j]))
            rows[j], rows[i] = each(r, "where", swap, a, b), each(r, "where", swap, b, a)
        rows[j] = each(r, "div", rows[j], rows[j][j])
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
    "bmm": lambda r, a, b: product(r, r.of(a), r.of(b)),
    "clamp": _clamp,
    "clamp_max": lambda r, a, high: _clamp(r, a, None, high),
    "clamp_min": _clamp,
    "cumsum": _cumsum,
    "dot": lambda r, a, b: product(r, r.of(a)[None], r.of(b)[:, None])[0, 0],
    "floor_divide": formula(lambda do, a, b: do("floor", do("div", a, b))),
    "hypot": formula(lambda do, a, b: do("sqrt", do("add", do("mul", a, a), do("mul", b, b)))),
    "index": _picked,
    "linalg_inv_ex": _inverse,
    "logical_and": formula(lambda do, a, b: do("mul", do("ne", a, 0), do("ne", b, 0))),
    "logical_not": formula(lambda do, a: do("eq", a, 0)),
    "logical_or": formula(lambda do, a, b: do("maximum", do("ne", a, 0), do("ne", b, 0))),
    "masked_fill": formula(lambda do, a, mask, value: do("where", mask, value, a)),
    "mean": _mean,
    "mm": lambda r, a, b: product(r, r.of(a), r.of(b)),
    "mv": lambda r, a, b: product(r, r.of(a), r.of(b)[:, None])[:, 0],
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
