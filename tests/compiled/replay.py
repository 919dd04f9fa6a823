"""Arithmetic that was written down, computed again by torch, one number at a time."""

import torch

from pypose_lite.compiled.scalars import LEAVES

FUNCTIONS = """abs acos add asin atan atan2 ceil cos cosh div erf exp expm1 floor log log1p maximum
minimum mul neg pow remainder round sign sin sinh sqrt sub tan tanh trunc""".split()


def order(name):
    return lambda a, b: getattr(torch, name)(a, b) + 0.0


IN_TORCH = {name: getattr(torch, name) for name in FUNCTIONS}
IN_TORCH |= {name: order(name) for name in ("eq", "ne", "lt", "le", "gt", "ge")}
IN_TORCH["where"] = lambda c, a, b: torch.where(c != 0, a, b)


def replay(arithmetic, places, **leaves):
    """Returns the numbers at some places; leaves are x, u, l, number, and t."""
    known = []
    for op, *args in arithmetic.entries:
        if op in LEAVES:
            z = args[0] if op == "constant" else leaves[op]
            z = z[args[0]] if op in ("x", "u", "l", "number") else z
            known.append(torch.as_tensor(z, dtype=torch.float64))
        else:
            known.append(IN_TORCH[op](*(known[a] for a in args)))
    return torch.stack([known[at] for at in places])
