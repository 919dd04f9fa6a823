"""The warning of a function that has to be called for one member of a batch after the other."""

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
_told: weakref.WeakSet[Callable] = weakref.WeakSet()


def warn_once(system, name: str, error: Exception) -> None:
    """Warns, once for each function, at the line of it that ``torch.vmap`` cannot map."""
    function = written_by_user(system, name)
    function = getattr(function, "__func__", function)
    if function in _told:
        return
    _told.add(function)
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
