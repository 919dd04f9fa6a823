"""The usual properties: a shape, a number, a batch that is a loop, a gradient.

Each returns what came, as plain float64 tensors, or raises ``Failure`` with what a reader needs:
what was expected, what came, one hint. Numbers may come as tensors of any dtype, as numbers, lists,
tuples or arrays.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy
import torch
from torch import Tensor

from .exercise import Failure
from .words import compared, kind, shaped

TOLERANCE, FLOAT32 = 1e-6, 1e-4  # of the largest number that is expected
NO_RETURN = "A function without `return` returns None."
DETACHED = "`.detach()`, `.item()`, `float(...)` and `torch.tensor(...)` cut the graph."


def tensor(name: str, came: Any, shape: tuple[int, ...] | None = None) -> Tensor:
    """Returns ``came`` in float64 with its graph, or says which numbers were expected instead."""
    wanted = f"{name} {'in numbers' if shape is None else shaped(shape)}"
    value = _as_tensor(came)
    if value is None:
        raise Failure(wanted, kind(came), NO_RETURN if came is None else "")
    if shape is not None and value.shape != shape:
        if value.numel() == 1 == torch.Size(shape).numel():
            return value.reshape(shape)
        turned = value.ndim > 1 and value.mT.shape == shape
        hint = "Its transpose has that shape." if turned else ""
        raise Failure(wanted, f"one {shaped(value.shape)}", hint)
    if not value.isfinite().all():
        raise Failure(f"{name}, finite numbers", "nan or inf", "Is something divided by zero?")
    return value


def parts(came: Any, *names: str) -> tuple[Any, ...]:
    """Returns the results of a function that has several: a tuple, a list, a NamedTuple."""
    wanted = ", ".join(names)
    if isinstance(came, Tensor | str) or not hasattr(came, "__len__"):
        raise Failure(f"{len(names)} results: {wanted}", kind(came), NO_RETURN * (came is None))
    if len(came) != len(names):
        raise Failure(f"{len(names)} results: {wanted}", f"{len(came)} of them")
    return tuple(came)


def close(
    name: str,
    came: Any,
    expected: Tensor | float,
    hint: str = "",
    mistakes: Mapping[str, Tensor | float] | None = None,
    tolerance: float = TOLERANCE,
) -> Tensor:
    """Sees to it that ``came`` is ``expected``, up to rounding.

    Args:
        name: of the number, as the exercise calls it.
        came: what the answer gave.
        expected: what another route gives.
        hint: where nothing better is known.
        mistakes: what a known mistake would give, by the hint that mends it.
        tolerance: relative to the largest number expected; more is allowed in float32.
    """
    expected = torch.as_tensor(expected, dtype=torch.float64).detach()
    tolerance = max(tolerance, FLOAT32) if _is_float32(came) else tolerance
    value = tensor(name, came, tuple(expected.shape))
    if near(value, expected, tolerance):
        return value
    for advice, wrong in (mistakes or {}).items():
        if near(value, torch.as_tensor(wrong, dtype=torch.float64), tolerance):
            hint = advice
            break
    raise Failure(*compared(name, expected, value), hint)


def near(value: Tensor, other: Tensor, tolerance: float = TOLERANCE) -> bool:
    """Whether two tensors of one shape agree, relative to the largest number of the second."""
    if value.shape != other.shape:
        return False
    scale = other.detach().abs().amax().clamp(min=1e-2) if other.numel() else 1.0
    return bool(((value - other).detach().abs() <= tolerance * scale).all())


def that(holds: bool | Tensor, expected: str, came: str, hint: str = "") -> None:
    """Sees to anything else: ``holds`` says whether it is so."""
    if not bool(holds):
        raise Failure(expected, came, hint)


def batched(answer: Callable, *args: Tensor, names: tuple[str, ...] = (), hint: str = "") -> None:
    """Sees to it that a batch gives what a loop over its members gives.

    Args:
        answer: a function of tensors that returns one result, or as many as there are ``names``.
        args: with one batch dimension in front of each.
        names: of the results.
        hint: where it does not.
    """
    results = names or ("the result",)
    whole = _results(answer(*args), results)
    loop = [_results(answer(*members), results) for members in zip(*args)]
    for name, together, alone in zip(results, whole, zip(*loop)):
        close(f"{name} of a batch", together, torch.stack(alone), hint)


def gradient(function: Callable[[Tensor], Tensor], x: Tensor, name: str, hint: str = "") -> None:
    """Sees to it that autograd and central differences agree on the gradient of a scalar.

    Args:
        function: of one tensor; its result is a single number.
        x: where, in float64.
        name: of that number.
        hint: where they do not agree.
    """
    x = x.detach().clone().requires_grad_()
    value = function(x)
    if not (isinstance(value, Tensor) and value.requires_grad):
        raise Failure(f"{name} with a gradient", "one without", DETACHED)
    found = torch.autograd.grad(value, x, allow_unused=True)[0]
    if found is None:
        raise Failure(f"{name} with a gradient", "one without", DETACHED)
    steps = 1e-6 * torch.eye(x.numel(), dtype=x.dtype).reshape(-1, *x.shape)
    with torch.no_grad():
        slopes = [(function(x + h) - function(x - h)) / 2e-6 for h in steps]
    wanted = torch.stack(slopes).reshape(x.shape)
    close(f"the gradient of {name}", found, wanted, hint or DETACHED, tolerance=1e-5)


def choice(came: Any, right: str, wrong: Mapping[str, str]) -> None:
    """Sees to the answer of a multiple choice; ``wrong`` says why another letter is not right."""
    letters = sorted([right, *wrong])
    listed = f"{', '.join(map(repr, letters[:-1]))} or {letters[-1]!r}"
    letter = came.strip(" .()").lower() if isinstance(came, str) else None
    if letter not in letters:
        raise Failure(f"one of the letters {listed}", kind(came))
    if letter != right:
        raise Failure("another letter", repr(letter), wrong[letter])


def _as_tensor(came: Any) -> Tensor | None:
    """The numbers as float64, with their graph, or None where they are none."""
    if isinstance(came, Tensor):
        return None if came.is_complex() else came.to("cpu", torch.float64)
    if came is None or isinstance(came, str | bytes | dict | set):
        return None
    try:
        if isinstance(came, list | tuple) and any(isinstance(part, Tensor) for part in came):
            return torch.stack([torch.as_tensor(part, dtype=torch.float64) for part in came])
        return torch.as_tensor(numpy.asarray(came, dtype=numpy.float64))
    except (TypeError, ValueError, RuntimeError):
        return None


def _is_float32(came: Any) -> bool:
    """Whether numbers came in float32 or less: then they have fewer digits."""
    if isinstance(came, list | tuple):
        return any(map(_is_float32, came))
    return str(getattr(came, "dtype", "")).split(".")[-1] in ("float32", "float16", "bfloat16")


def _results(came: Any, names: tuple[str, ...]) -> list[Tensor]:
    return [
        tensor(*pair) for pair in zip(names, [came] if len(names) == 1 else parts(came, *names))
    ]
