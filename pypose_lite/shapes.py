"""One-line shape contracts for what users pass, and where modules keep it.

Vectors come last and batches first: a state is ``(..., n)``, a sequence ``(..., T, n)``.
"""

import functools
import math
import re
from contextvars import ContextVar

import torch
from torch import Tensor, nn

RECORDING = ContextVar("RECORDING", default=False)  # whether `compiled` writes a step down


def check(spec: str, *tensors: Tensor | None, **sizes: int) -> dict[str, int]:
    """Returns the sizes that the letters of a contract stand for, or says what does not fit.

    ``check("A: n n, B: n m", A, B)`` asks for ``A (..., n, n)`` and ``B (..., n, m)`` of one
    floating dtype, on one device, finite, with leading dimensions that broadcast. A tensor that
    is None is passed over.

    Args:
        spec: one ``name: letters`` for each tensor, separated by commas.
        tensors: the tensors, in that order.
        sizes: letters that are known beforehand, such as ``n=4``.

    Raises:
        ValueError: naming the argument, what was expected, where that comes from, and what came.
    """
    known, origin = dict(sizes), dict.fromkeys(sizes, "")
    first: tuple[str, Tensor] | None = None
    batch: tuple[int, ...] = ()
    for (name, letters), x in zip(_parse(spec), tensors, strict=True):
        if x is None:
            continue
        if not isinstance(x, Tensor):
            raise ValueError(f"{name}: expected a floating-point tensor, got {type(x).__name__}")
        shape, k = tuple(x.shape), len(letters)
        core = shape[len(shape) - k :]
        fits = len(shape) >= k and all(known.get(c, s) == s for c, s in zip(letters, core))
        for c, s in zip(letters, core) if fits else ():
            if known.setdefault(c, s) != s:  # the same letter twice, as in "A: n n"
                fits = False
            origin.setdefault(c, name)
        if not fits:
            raise ValueError(_mismatch(name, letters, shape, known, origin))
        first = first or (name, x)
        alike(name, x, first[1], first[0])
        batch = join(name, shape[: len(shape) - k], batch)
    return known


def join(name: str, lead: tuple, batch: tuple) -> tuple:
    """Returns the batch that ``lead`` and ``batch`` make together; ValueError where they cannot."""
    if not lead or lead == batch:
        return batch
    try:
        return tuple(torch.broadcast_shapes(batch, lead))
    except RuntimeError:
        raise ValueError(f"{name}: its batch {lead} does not broadcast with {batch}") from None


def over_time(name: str, value: Tensor, sizes: tuple[int, ...], T: int, batch: tuple) -> Tensor:
    """Returns ``value`` with time first, ``(T, ..., *sizes)``, however a user left it out.

    A ``Q`` of T steps for a batch may come as ``sizes``, ``(T, *sizes)``, ``(*batch, *sizes)`` or
    ``(*batch, T, *sizes)``.

    Raises:
        ValueError: for a shape that is none of these, or more than one of them.
    """
    lead = tuple(value.shape[: value.ndim - len(sizes)])
    if value.ndim < len(sizes) or tuple(value.shape[len(lead) :]) != sizes:
        lead, in_time, in_batch = (), False, False
    elif all(s == 1 for s in lead) and len(lead) <= 1:
        return value.reshape(1, *sizes).expand(T, *sizes)
    else:
        in_time = lead[-1] in (1, T) and _broadcast(lead[:-1], batch)
        in_batch = len(lead) <= len(batch) and _broadcast(lead, batch)
    core = ", ".join(map(str, sizes))
    if in_time and in_batch:
        raise ValueError(
            f"{name}: {tuple(value.shape)} may be T={T} steps or a batch {tuple(batch)}; "
            f"give ({'1, ' * len(batch)}{T}, {core}) or (*batch, 1, {core})"
        )
    if in_batch:
        value, lead = value.unsqueeze(-len(sizes) - 1), (*lead, 1)
    elif not in_time:
        whose = f" for a batch {tuple(batch)}" if batch else ""
        raise ValueError(f"{name}: expected (..., T={T}, {core}){whose}, got {tuple(value.shape)}")
    return value.movedim(len(lead) - 1, 0).expand(T, *lead[:-1], *sizes)


def alike(name: str, x: Tensor | None, other: Tensor, whose="x_init", infinite=False) -> None:
    """Raises ValueError where x is not floating, on another device, not finite, or unlike other.

    NaN never passes; infinity does where ``infinite`` allows it. Inside ``torch.vmap`` and while
    torch compiles there are no numbers to look at, and only dtype and device are compared.
    """
    if x is None:
        return
    if not isinstance(x, Tensor) or not x.is_floating_point():
        kind = x.dtype if isinstance(x, Tensor) else type(x).__name__
        raise ValueError(f"{name}: expected a floating-point tensor, got {kind}")
    if (x.dtype, x.device) != (other.dtype, other.device):
        raise ValueError(
            f"{name}: expected {other.dtype} on {other.device} like {whose}, "
            f"got {x.dtype} on {x.device}"
        )
    if not has_numbers(x):
        return
    if math.isfinite(x.detach().sum()):  # quicker than to ask every number
        return
    bad = torch.isnan(x) if infinite else ~torch.isfinite(x)
    if bad.any():
        where = tuple(bad.nonzero()[0].tolist())
        raise ValueError(f"{name}: expected finite numbers, got {x[where].item()} at {where}")


def has_numbers(x: Tensor) -> bool:
    """Returns whether the numbers in x can be asked for, as ``float(x)`` and ``if x > 0:`` do.

    They cannot inside ``torch.vmap``, where x stands for all members of a batch at once, nor while
    torch compiles, or `compiled` writes a system's step down.
    """
    if torch.compiler.is_compiling() or RECORDING.get():
        return False
    while torch._C._functorch.is_functorch_wrapped_tensor(x):
        if torch._C._functorch.is_batchedtensor(x):
            return False
        x = torch._C._functorch.get_unwrapped(x)
    return True


def inside_transform(x: Tensor) -> bool:
    """Returns whether x is inside ``torch.vmap``, ``torch.func.grad`` or another such transform.

    There derivatives are taken by transforms, too, even with respect to an x that no transform
    knows. torch has no public name for this question: this function and :func:`has_numbers` are
    the one place for the private ones.
    """
    wrapped = torch._C._functorch.is_functorch_wrapped_tensor(x)
    return wrapped or torch._C._functorch.maybe_current_level() is not None


def register(module: nn.Module, name: str, value: Tensor | None) -> None:
    """Keeps a value as ``module.name``: an ``nn.Parameter`` is learned, other tensors are buffers.

    Either moves with ``module.to()`` and stands in its ``state_dict``; None stands in neither. A
    value that the module has kept under this name before is replaced.
    """
    if name in module._parameters or name in module._buffers:
        delattr(module, name)
    if isinstance(value, nn.Parameter):
        module.register_parameter(name, value)
    else:
        module.register_buffer(name, value)


@functools.cache
def _parse(spec: str) -> tuple[tuple[str, list[str]], ...]:
    """``"A: n n, b: n" -> (("A", ["n", "n"]), ("b", ["n"]))``."""
    pairs = (re.fullmatch(r"\s*(\w+):\s*([\w\s]*)", part) for part in spec.split(","))
    return tuple((pair[1], pair[2].split()) for pair in pairs if pair)


def _broadcast(lead: tuple, batch: tuple) -> bool:
    return all(a == b or 1 in (a, b) for a, b in zip(lead[::-1], batch[::-1]))


def _mismatch(name: str, letters: list[str], shape: tuple, known: dict, origin: dict) -> str:
    """``B: expected (..., n=4, m), got (3, 1); n=4 comes from A``."""
    fixed = {c: known[c] for c in letters if c in known and origin.get(c) != name}
    want = ", ".join(f"{c}={fixed[c]}" if c in fixed else c for c in letters)
    whence = [f"{c}={s} comes from {origin[c]}" for c, s in fixed.items() if origin.get(c)]
    return f"{name}: expected (..., {want}), got {shape}" + "".join(f"; {w}" for w in whence)
