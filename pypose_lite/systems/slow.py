"""Warnings, once each, of functions that torch cannot map over a batch, or not differentiate."""

import os
import traceback
import warnings
import weakref
from collections.abc import Callable
from pathlib import Path

import torch

from .functions import written_by_user

REASONS = {
    "control flow": "it branches on numbers that differ, where torch.where computes both ways",
    ".item()": "it takes a number out of a tensor, which leaves no derivative either",
    "data pointer": "it takes numbers out of torch, which leaves no derivative either",
    "dynamic shape": "the size of what it picks depends on numbers",
}
LIBRARIES = tuple(
    f"{Path(file).parents[n]}{os.sep}" for file, n in ((torch.__file__, 0), (__file__, 1))
)
_slow: weakref.WeakSet[Callable] = weakref.WeakSet()
_lost: weakref.WeakSet[Callable] = weakref.WeakSet()


def warn_once(system, name: str, error: Exception) -> None:
    """Warns, once for each function, at the line of it that ``torch.vmap`` cannot map."""
    if not _first_time(system, name, _slow):
        return
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if not frame.filename.startswith(LIBRARIES)]
    line = (own or list(frames))[-1]
    text = str(error)
    found = [reason for words, reason in REASONS.items() if words in text]
    reason = found[0] if found else f"torch.vmap says: {text.strip().splitlines()[0]}"
    warnings.warn_explicit(
        f"{name} of {type(system).__name__} is slow for batches, as its members are taken one "
        f"after the other: line {line.lineno} of {Path(line.filename).name}, `{line.line}`, "
        f"cannot be mapped over them: {reason}",
        UserWarning,
        line.filename,
        line.lineno or 0,
    )


def warn_of_lost_slopes(system, name: str) -> None:
    """Warns, once for each function, that torch finds derivatives of 0 where there are others."""
    if _first_time(system, name, _lost):
        warnings.warn(
            f"{name} of {type(system).__name__} has lost its derivatives: torch finds 0 for all of "
            "them. It takes its numbers out of torch, as torch.tensor([state[0], ...]), .item(), "
            "math, NumPy and torch.no_grad do: write torch.stack([state[0], ...]), torch.sin",
            stacklevel=2,
        )


def _first_time(system, name: str, told: weakref.WeakSet[Callable]) -> bool:
    function = written_by_user(system, name)
    function = getattr(function, "__func__", function)
    first = function not in told
    told.add(function)
    return first
