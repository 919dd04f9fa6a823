"""Values in a few words, for the lines of a verdict."""

from typing import Any

import numpy
from torch import Tensor

FEW = 6  # numbers are shown whole, of more only the one that is most wrong


def kind(value: Any) -> str:
    """What a value is, in a few words: ``None``, ``the string 'abc'``, ``a list of 3``."""
    if value is None:
        return "None"
    if isinstance(value, str):
        return f"the string {value!r}" if len(value) <= 20 else f"the string {value[:20]!r}..."
    if isinstance(value, Tensor):
        return f"a tensor of shape {tuple(value.shape)}"
    if isinstance(value, list | tuple | dict):
        return f"a {type(value).__name__} of {len(value)}"
    if isinstance(value, bool | int | float):
        return f"the number {value!r}"
    return f"a function, {value.__name__}" if _is_function(value) else f"a {type(value).__name__}"


def _is_function(value: Any) -> bool:
    return callable(value) and hasattr(value, "__name__")


def shaped(shape: Any) -> str:
    """A shape in words: ``of shape (2, 3)``, ``as a single number``."""
    return f"of shape {tuple(shape)}" if shape else "as a single number"


def compared(name: str, expected: Tensor, value: Tensor) -> tuple[str, str]:
    """Both numbers as a reader sees them: whole where they are few, else where they differ most."""
    if expected.numel() <= FEW:
        return f"{name} = {digits(expected)}", digits(value)
    worst = int((value - expected).detach().abs().argmax())
    place = [int(k) for k in numpy.unravel_index(worst, tuple(expected.shape))]
    index = f"{name}[{', '.join(map(str, place))}]"
    return f"{index} = {digits(expected.flatten()[worst])}", digits(value.flatten()[worst])


def digits(value: Any) -> str:
    """Numbers with four digits: ``0.3142``, ``[0.5, -1.25]``."""
    if isinstance(value, Tensor):
        value = value.detach().tolist()
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(digits, value))}]"
    return f"{value:.4g}"
