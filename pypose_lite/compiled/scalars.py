"""Arithmetic on single numbers: what a system computes, as a list of operations, and its slopes.

A tensor's operation is a black box to a C++ compiler; this is what stands in it. `recorder` writes
a system's step down as an :class:`Arithmetic`, here it is differentiated, and `source` turns it
into C++. What is known to be 0 or 1, as much of a Jacobian is, costs nothing, and what is computed
twice stands once.

A number is named by its place in the list. Its entry is an operation and the places of what it is
made of, or one of the leaves ``("x", i)``, ``("u", i)``, ``("l", i)``, ``("t",)``,
``("constant", value)`` and ``("number", i)``; the latter are told when the code runs.
"""

import math
from collections.abc import Callable, Iterable, Sequence

LEAVES = {"x", "u", "l", "t", "constant", "number"}
PLAIN = (-1.0, 0.0, 1.0)  # constants that stay in the code; other numbers are told when it runs
FOLDED: dict[str, Callable] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "neg": lambda a: -a,
}


class Arithmetic:
    """A list of operations on numbers, each of them once."""

    def __init__(self, entries: Iterable[tuple] = ()) -> None:
        self.entries: list[tuple] = []
        self.places: dict[tuple, int] = {}
        for op, *args in entries:
            self.leaf(op, *args) if op in LEAVES else self._append((op, *args), (op, *args))

    def leaf(self, *entry) -> int:
        """Returns the place of a leaf."""
        if entry[0] == "constant":
            entry = ("constant", float(entry[1]))
        key = (*entry, str(entry[-1]))  # tells -0.0 from 0.0
        return self._append(key, entry)

    def _append(self, key: tuple, entry: tuple) -> int:
        """Returns the place of an entry, a new one where it does not stand yet."""
        if key not in self.places:
            self.places[key] = len(self.entries)
            self.entries.append(entry)
        return self.places[key]

    def constant(self, value: float) -> int:
        """Returns the place of a constant."""
        return self.leaf("constant", value)

    def value(self, place: int) -> float | None:
        """Returns what a number is where that is known, else None."""
        entry = self.entries[place]
        return entry[1] if entry[0] == "constant" else None

    def do(self, op: str, *args: int) -> int:
        """Returns the place of ``op(*args)``, where it is not known to be something simpler."""
        values = [self.value(a) for a in args]
        if op in FOLDED and None not in values:
            return self.constant(FOLDED[op](*values))
        simpler = self._simpler(op, args, values)
        if simpler is not None:
            return simpler
        args = tuple(sorted(args)) if op in ("add", "mul") else args
        return self._append((op, *args), (op, *args))

    def _simpler(self, op: str, args: Sequence[int], values: Sequence[float | None]) -> int | None:
        """Returns the place of an operation with 0, 1 or a known condition, or None.

        So 0 times anything is 0, also what is not finite.
        """
        a, b, c = (*args, None, None)[:3]
        x, y, _ = (*values, None, None)[:3]
        if op == "mul" and 0 in (x, y) or op == "div" and x == 0:
            return self.constant(0)
        if op == "mul" and x == 1 or op == "add" and x == 0:
            return b
        if op in ("mul", "div") and y == 1 or op in ("add", "sub") and y == 0:
            return a
        if op in ("mul", "div") and -1 in (x if op == "mul" else None, y):
            return self.do("neg", b if y != -1 else a)  # type: ignore[arg-type]
        if op == "sub" and x == 0:
            return self.do("neg", b)  # type: ignore[arg-type]
        if op == "neg" and self.entries[a][0] == "neg":  # type: ignore[index]
            return self.entries[a][1]  # type: ignore[index]
        if op == "where" and (x is not None or b == c):
            return b if x is None or x else c
        return None

    def canonical(self, results: Iterable[int]) -> tuple["Arithmetic", list[int], list]:
        """Returns what results are made of alone, their places, and the numbers that it takes.

        Two steps that do the same with other numbers have the same arithmetic. A number is a
        constant's value or the name of a parameter.
        """
        new = Arithmetic()
        numbers: list = []
        place: dict[int, int] = {}
        stack = list(results)[::-1]
        results = stack[::-1]
        while stack:
            at = stack[-1]
            op, *args = self.entries[at]
            todo = [] if op in LEAVES else [a for a in args if a not in place]
            if at in place or todo:
                stack.pop() if at in place else stack.extend(todo[::-1])
                continue
            if op == "number" or (op == "constant" and args[0] not in PLAIN):
                place[at] = new.leaf("number", len(numbers))
                numbers.append(args[0])
            elif op in LEAVES:
                place[at] = new.leaf(op, *args)
            else:
                place[at] = new.do(op, *(place[a] for a in args))
            stack.pop()
        return new, [place[r] for r in results], numbers

    # --- slopes

    def slopes(self, results: Sequence[int], by: Sequence[int]) -> list[list[int]]:
        """Returns the derivative of each result by each of the leaves ``by``: ``d[result][by]``."""
        needed = sorted(self.needs(results))
        columns = []
        for leaf in by:
            slope = {leaf: self.constant(1)}
            for at in needed:
                if at not in slope:
                    slope[at] = self._slope_of(at, slope)
            columns.append([slope[r] for r in results])
        return [list(row) for row in zip(*columns)]

    def gradient(self, result: int, by: Sequence[int]) -> list[int]:
        """Returns the derivative of one result by each of the leaves ``by``."""
        zero = self.constant(0)
        push = {result: self.constant(1)}
        for at in sorted(self.needs([result]), reverse=True):
            for arg, partial in self.partials(at) if at in push else ():
                part = self.do("mul", push[at], partial)
                push[arg] = self.do("add", push[arg], part) if arg in push else part
        return [push.get(leaf, zero) for leaf in by]

    def _slope_of(self, at: int, slope: dict[int, int]) -> int:
        total = self.constant(0)
        for arg, partial in self.partials(at):
            total = self.do("add", total, self.do("mul", partial, slope[arg]))
        return total

    def needs(self, results: Iterable[int]) -> set[int]:
        """Returns all places that results are made of, their own included."""
        seen: set[int] = set()
        stack = list(results)
        while stack:
            at = stack.pop()
            if at not in seen:
                seen.add(at)
                op, *args = self.entries[at]
                stack.extend(() if op in LEAVES else args)
        return seen

    def partials(self, at: int) -> list[tuple[int, int]]:
        """Returns what an operation is made of, each with the derivative by it."""
        op, *args = self.entries[at]
        if op in LEAVES or op not in PARTIALS:
            return []
        partials = PARTIALS[op](_Formula(self), at, *args)
        return [
            (arg, p if isinstance(p, int) else self.constant(p)) for arg, p in zip(args, partials)
        ]


class _Formula:
    """Lets a formula be written as calls: ``f.mul(a, f.cos(b))``; numbers are constants."""

    def __init__(self, arithmetic: Arithmetic):
        self.arithmetic = arithmetic

    def __getattr__(self, op: str) -> Callable[..., int]:
        def do(*args: int | float) -> int:
            to = self.arithmetic
            return to.do(op, *(to.constant(a) if isinstance(a, float) else a for a in args))

        return do


def _power(f, y, a, b):
    """The slopes of a^b: b a^(b-1), and a^b log(a)."""
    exponent = f.arithmetic.value(b)
    if exponent is not None:
        return [f.mul(b, power(f.arithmetic, a, exponent - 1))]
    return f.mul(b, f.pow(a, f.sub(b, 1.0))), f.where(f.eq(y, 0.0), 0.0, f.mul(y, f.log(a)))


def _half_of_a_tie(order: str):
    """The slopes of an extreme: where both are equal each counts half, as in torch."""

    def partials(f, y, a, b):
        first = f.where(f.eq(a, b), 0.5, f.where(getattr(f, order)(a, b), 1.0, 0.0))
        return first, f.sub(1.0, first)

    return partials


# The derivatives of an operation by what it is made of; y is its own place. What does not stand
# here has none: comparisons, roundings, signs, and what is picked by an index.
PARTIALS: dict[str, Callable] = {
    "add": lambda f, y, a, b: (1.0, 1.0),
    "sub": lambda f, y, a, b: (1.0, -1.0),
    "mul": lambda f, y, a, b: (b, a),
    "div": lambda f, y, a, b: (f.div(1.0, b), f.neg(f.div(y, b))),
    "neg": lambda f, y, a: (-1.0,),
    "sin": lambda f, y, a: (f.cos(a),),
    "cos": lambda f, y, a: (f.neg(f.sin(a)),),
    "tan": lambda f, y, a: (f.add(1.0, f.mul(y, y)),),
    "asin": lambda f, y, a: (f.div(1.0, f.sqrt(f.sub(1.0, f.mul(a, a)))),),
    "acos": lambda f, y, a: (f.neg(f.div(1.0, f.sqrt(f.sub(1.0, f.mul(a, a))))),),
    "atan": lambda f, y, a: (f.div(1.0, f.add(1.0, f.mul(a, a))),),
    "atan2": lambda f, y, a, b: (
        f.div(b, f.add(f.mul(a, a), f.mul(b, b))),
        f.neg(f.div(a, f.add(f.mul(a, a), f.mul(b, b)))),
    ),
    "sinh": lambda f, y, a: (f.cosh(a),),
    "cosh": lambda f, y, a: (f.sinh(a),),
    "tanh": lambda f, y, a: (f.sub(1.0, f.mul(y, y)),),
    "exp": lambda f, y, a: (y,),
    "expm1": lambda f, y, a: (f.add(y, 1.0),),
    "log": lambda f, y, a: (f.div(1.0, a),),
    "log1p": lambda f, y, a: (f.div(1.0, f.add(1.0, a)),),
    "sqrt": lambda f, y, a: (f.div(0.5, y),),
    "erf": lambda f, y, a: (f.mul(2 / math.sqrt(math.pi), f.exp(f.neg(f.mul(a, a)))),),
    "abs": lambda f, y, a: (f.sign(a),),
    "pow": _power,
    "remainder": lambda f, y, a, b: (1.0, f.neg(f.floor(f.div(a, b)))),
    "maximum": _half_of_a_tie("gt"),
    "minimum": _half_of_a_tie("lt"),
    "where": lambda f, y, c, a, b: (0.0, f.where(c, 1.0, 0.0), f.where(c, 0.0, 1.0)),
}


def power(to: Arithmetic, a: int, exponent: float) -> int:
    """Returns a^exponent, by products where that is a small whole number."""
    if exponent == 0.5:
        return to.do("sqrt", a)
    if exponent != int(exponent) or abs(exponent) > 8:
        return to.do("pow", a, to.constant(exponent))
    result = to.constant(1)
    for _ in range(abs(int(exponent))):
        result = to.do("mul", result, a)
    return result if exponent >= 0 else to.do("div", to.constant(1), result)
