"""Somebody else's function, and somebody else's exceptions."""

import contextlib
import inspect
import linecache
import sysconfig
import traceback
from pathlib import Path
from types import FrameType
from typing import Any

import torch
from torch import Tensor

from .exercise import Exercise, Failure
from .words import kind

OURS = Path(__file__).parents[2]  # pypose_lite
PLACES = OURS, *(Path(sysconfig.get_path(name)) for name in ("stdlib", "purelib", "platlib"))
CELLS = "<ipython-input", "<stdin>"  # where code has no file


class Answer:
    """A function as a student wrote it, which is called as a check has to call one.

    Each call sees to it that the arguments stay as they were; the first one is made twice, to see
    whether the same arguments give the same result.
    """

    def __init__(self, function: Any, random: bool = False) -> None:
        self.function, self.repeat = function, not random

    def __call__(self, *args: Any) -> Any:
        """Returns what the function returns."""
        before = [_copy(argument) for argument in args]
        result = self.function(*args)
        for name, argument, old in zip(self.names(len(args)), args, before):
            if not _same(argument, old):
                raise _changed(name)
        if self.repeat:
            self.repeat = False
            first, again = _copy(result), self.function(*args)
            if not _same(first, again):
                raise _another()
        return result

    def names(self, count: int) -> list[str]:
        """The names of the arguments, as their author calls them."""
        numbered = [f"argument {k + 1}" for k in range(count)]
        try:
            names = list(inspect.signature(self.function).parameters)
        except (TypeError, ValueError):
            return numbered
        return names[:count] if len(names) >= count else numbered


def called(value: Any, exercise: Exercise) -> Any:
    """Returns an answer ready for its properties: a function to call, or the value as it is."""
    if not exercise.takes:
        return value
    names = exercise.takes.split(", ")
    wanted = f"a function of {exercise.takes}"
    sentence = f"be {wanted}"
    if not callable(value):
        raise Failure(wanted, kind(value), "", sentence)
    with contextlib.suppress(ValueError):  # some functions that are written in C do not say
        try:
            inspect.signature(value).bind(*names)
        except TypeError:
            raise Failure(wanted, f"one of {_arguments(value)}", "", sentence) from None
    return Answer(value, exercise.random)


def _arguments(function: Any) -> str:
    return ", ".join(inspect.signature(function).parameters) or "no arguments"


def _changed(name: str) -> Failure:
    mend = f"Work on {name}.clone(), or make a new tensor: `{name} += ...` and `{name}[...] =`"
    sentence = "leave its arguments as they are"
    return Failure(f"{name} as it was", "one that was changed", f"{mend} write into it.", sentence)


def _another() -> Failure:
    sentence = "give the same result for the same arguments"
    hint = "It depends on something else, too: a random number, a clock, a global variable."
    return Failure("the same result from a second call", "another one", hint, sentence)


def _copy(value: Any) -> Any:
    """A value that stays, whatever happens to the tensors in the first one."""
    if isinstance(value, Tensor):
        return value.detach().clone()
    if isinstance(value, list | tuple):
        return [_copy(part) for part in value]
    return value


def _same(value: Any, old: Any) -> bool:
    """Whether a value equals its copy; what is neither number nor tensor counts as equal."""
    if isinstance(value, list | tuple) and isinstance(old, list | tuple):
        return len(value) == len(old) and all(map(_same, value, old))
    if isinstance(value, Tensor) and isinstance(old, Tensor):
        return value.shape == old.shape and torch.allclose(value.detach(), old, equal_nan=True)
    if isinstance(value, float | int) and isinstance(old, float | int):
        return value == old or value != value
    return True


def own_frames(error: BaseException) -> list[traceback.FrameSummary]:
    """The places in the student's own code where an exception passed, the innermost one last."""
    frames = [(frame, line) for frame, line in traceback.walk_tb(error.__traceback__)]
    return [_summary(frame, line) for frame, line in frames if _is_own(frame)]


def raised_in_own_code(error: BaseException) -> bool:
    """Whether the innermost place is the student's own: a ``raise`` that they wrote, or a stub."""
    *_, (frame, _) = traceback.walk_tb(error.__traceback__)
    return _is_own(frame)


def _is_own(frame: FrameType) -> bool:
    path = frame.f_code.co_filename
    if path.startswith("<"):
        return path.startswith(CELLS)
    return not any(Path(path).is_relative_to(place) for place in PLACES)


def _summary(frame: FrameType, line: int) -> traceback.FrameSummary:
    path = frame.f_code.co_filename
    text = linecache.getline(path, line).strip()
    return traceback.FrameSummary(path, line, frame.f_code.co_name, line=text)
