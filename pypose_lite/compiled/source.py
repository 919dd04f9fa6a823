"""A system's step as C++: the functions that `ilqr.cpp` calls, each a list of assignments.

A *kind* is what a step does, whatever its numbers; a system whose steps do different things at
different times has several. The whole text is what a compiled library is kept under, so whatever
has an influence on it stands in it.
"""

import math
from collections.abc import Sequence
from functools import cache, reduce
from pathlib import Path

import torch

from .places import Unsupported
from .scalars import LEAVES, Arithmetic

LARGEST = 50_000  # operations of a step and its derivatives: half a minute of compiling
REALS = {torch.float32: "float", torch.float64: "double"}
INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/"}
ORDERS = {"eq": "==", "ne": "!=", "lt": "<", "le": "<=", "gt": ">", "ge": ">="}
GIVEN = "const vec *x, const vec *u, vec t, const vec *numbers"

Kind = tuple[tuple, tuple[int, ...]]  # the entries of an arithmetic, and the next state's places


def source(kinds: Sequence[Kind], n: int, m: int, dtype: torch.dtype, many: bool) -> str:
    """Returns a whole program that plans for a system of these kinds of steps.

    Args:
        kinds: what a step does.
        n: how many states.
        m: how many inputs.
        dtype: of all numbers.
        many: whether it plans for as many at a time as the processor has room for, or for one.
    """
    sizes = f"// {n} states, {m} inputs\nconstexpr int n = {n}, m = {m};\n"
    sizes += f"#define DOUBLE {int(dtype == torch.float64)}\n#define MANY {int(many)}\n"
    numbers = {entry for entries, _ in kinds for entry in entries if entry[0] == "number"}
    sizes += f"#define COUNT {len(numbers)}\n"
    lanewise, ilqr = (_text(name) for name in ("lanes.h", "ilqr.cpp"))
    functions = [_kind(i, *kind, n, m) for i, kind in enumerate(kinds)]
    calls = [
        _choice(len(kinds), "transition", "vec *y"),
        _choice(len(kinds), "slopes", "vec *F"),
        _choice(len(kinds), "curvature", "const vec *l, vec *S"),
    ]
    return "\n".join([sizes, lanewise, *functions, *calls, ilqr])


@cache
def _text(name: str) -> str:
    return (Path(__file__).parent / name).read_text(encoding="utf-8")


def _kind(kind: int, entries: tuple, next_state: Sequence[int], n: int, m: int) -> str:
    """Returns the next state of one kind of step, F = df/d[x, u] and d2 (l' f) / d[x, u]2."""
    arithmetic = Arithmetic(entries)
    z = [arithmetic.leaf("x", i) for i in range(n)] + [arithmetic.leaf("u", i) for i in range(m)]
    terms = (arithmetic.do("mul", arithmetic.leaf("l", i), y) for i, y in enumerate(next_state))
    total = reduce(lambda a, b: arithmetic.do("add", a, b), terms)
    gradient = arithmetic.gradient(total, z)
    F = [slope for row in arithmetic.slopes(next_state, z) for slope in row]
    S = [slope for row in arithmetic.slopes(gradient, z) for slope in row]
    if len(arithmetic.entries) > LARGEST:
        raise Unsupported(f"has more than {LARGEST} operations on single numbers, slopes included")
    return "\n".join(
        [
            _function(f"transition{kind}", GIVEN, arithmetic, "y", next_state),
            _function(f"slopes{kind}", GIVEN, arithmetic, "F", F),
            _function(f"curvature{kind}", f"{GIVEN}, const vec *l", arithmetic, "S", S),
        ]
    )


def _choice(kinds: int, name: str, more: str) -> str:
    """Returns the function that calls that of a step's kind."""
    called = ", ".join(part.split()[-1].lstrip("*") for part in f"{GIVEN}, {more}".split(", "))
    cases = "".join(f"    case {i}: return {name}{i}({called});\n" for i in range(1, kinds))
    cases += f"    default: return {name}0({called});\n"
    return (
        f"static void {name}(int kind, {GIVEN}, {more}) {{\n  switch (kind) {{\n{cases}  }}\n}}\n"
    )


def _function(name: str, given: str, of: Arithmetic, result: str, places: Sequence[int]) -> str:
    lines = [f"static inline void {name}({given}, vec *{result}) {{"]
    for at in sorted(of.needs(places)):
        if of.entries[at][0] not in ("x", "u", "l", "t"):
            lines.append(f"  const vec v{at} = {_expression(of, at)};")
    lines += [f"  {result}[{i}] = {_name(of, at)};" for i, at in enumerate(places)]
    return "\n".join([*lines, "}"])


def _name(of: Arithmetic, at: int) -> str:
    op, *args = of.entries[at]
    return {"t": "t"}.get(op) or (f"{op}[{args[0]}]" if op in ("x", "u", "l") else f"v{at}")


def _expression(of: Arithmetic, at: int) -> str:
    op, *args = of.entries[at]
    if op == "constant":
        return f"splat({_literal(args[0])})"
    if op == "number":
        return f"numbers[{args[0]}]"
    assert op not in LEAVES
    names = [_name(of, a) for a in args]
    if op in INFIX:
        return f"{names[0]} {INFIX[op]} {names[1]}"
    if op in ORDERS:
        return f"where({names[0]} {ORDERS[op]} {names[1]}, splat(1), splat(0))"
    if op == "where":
        return f"where({names[0]} != splat(0), {names[1]}, {names[2]})"
    return f"-{names[0]}" if op == "neg" else f"v_{op}({', '.join(names)})"


def _literal(value: float) -> str:
    if math.isfinite(value):
        return repr(value)
    return "NAN" if math.isnan(value) else f"{'-' if value < 0 else ''}INFINITY"
