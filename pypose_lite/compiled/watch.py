"""Notices that a system would do something else by now than what was written down.

What a system does depends on its attributes, on its class, and on what its functions name:
globals, closures, defaults, and other functions with all of theirs. :func:`watch` goes through
these once and notes what stands where; :func:`changed` looks whether the same things still stand
there, which takes microseconds. Lists, dictionaries and objects are gone into. Of a tensor it
matters which it is, not what numbers it has: those are told whenever code runs. What belongs to
torch, to Python or to this library stays as it is.
"""

import sys
import types
from collections.abc import Callable, Hashable, Iterator, Set
from functools import partial
from typing import Any

import numpy as np
import torch

from ..systems import NLS, System

LIBRARIES = {"builtins", "numpy", "pypose_lite", "torch", *sys.stdlib_module_names}
VALUES = (int, float, complex, str, bytes, type(None), torch.Tensor, types.ModuleType)
UNREAD = vars(NLS()).keys() - {"_parameters", "_buffers", "_modules"}  # and a system's clock
MISSING = object()
_interned: dict[Hashable, Any] = {}  # one object for what is equal

Look = Callable[[Any, Any], Any]  # look(key, default): what stands at a key of something
Noted = list[tuple[Look, Any, Any]]  # and what stood there


def watch(system: System) -> Noted:
    """Returns what a system's transition depends on."""
    noted: Noted = []
    seen: dict[int, Any] = {}  # what was gone into, kept so that no id is used again
    todo: list[Any] = [system]
    while todo:
        thing = todo.pop()
        if id(thing) in seen or isinstance(thing, VALUES):
            continue
        seen[id(thing)] = thing
        for look, key in _inside(thing):
            value = look(key, MISSING)
            noted.append((look, key, value))
            todo.append(value)
        if not isinstance(thing, type | types.FunctionType):
            todo.extend(type(thing).__mro__)
    return noted


def changed(noted: Noted) -> bool:
    """Returns whether anything stands where something else stood."""
    return any(look(key, MISSING) is not value for look, key, value in noted)


def _inside(thing: Any) -> Iterator[tuple[Look, Any]]:
    """Yields where everything stands that a thing consists of."""
    if isinstance(thing, types.FunctionType):
        yield from _of_function(thing)
    elif isinstance(thing, type):
        if _is_users(thing.__module__):
            yield from ((vars(thing).get, key) for key in list(vars(thing)) if key != "__doc__")
    elif isinstance(thing, list | tuple):
        yield partial(_length, thing), None
        yield from ((partial(_item, thing), i) for i in range(len(thing)))
    elif isinstance(thing, np.ndarray):
        yield partial(_numbers, thing), None
    elif isinstance(thing, dict):
        yield from _of_dict(thing, {"_t"})
    else:
        yield from _of_object(thing)


def _of_object(thing: Any) -> Iterator[tuple[Look, Any]]:
    """Yields the attributes of an object, and its class."""
    names = ["__class__"]
    if isinstance(thing, types.MethodType | property | staticmethod | classmethod | partial):
        names += ["__func__", "__self__", "fget", "func", "args", "keywords"]
    for cls in type(thing).__mro__:
        slots = vars(cls).get("__slots__", ())
        names += [slots] if isinstance(slots, str) else slots
    yield from ((partial(getattr, thing), name) for name in names)
    if hasattr(thing, "__dict__"):
        yield from _of_dict(vars(thing), UNREAD if isinstance(thing, torch.nn.Module) else set())


def _of_dict(thing: dict, unread: Set) -> Iterator[tuple[Look, Any]]:
    """Yields the entries of a dictionary, and how many there are."""
    yield partial(_length, thing), None
    yield from ((thing.get, key) for key in thing if key not in unread)


def _length(thing: Any, key: None, default: Any) -> int:
    return _interned.setdefault(len(thing), len(thing))


def _item(thing: list | tuple, i: int, default: Any) -> Any:
    return thing[i] if i < len(thing) else default


def _numbers(thing: np.ndarray, key: None, default: Any) -> bytes:
    return _interned.setdefault(thing.tobytes(), thing.tobytes())


def _of_function(function: types.FunctionType) -> Iterator[tuple[Look, Any]]:
    """Yields what a function's code, and the code in it, may read."""
    if not _is_users(function.__module__):
        return
    names = "__code__", "__defaults__", "__kwdefaults__"
    yield from ((partial(getattr, function), name) for name in names)
    yield from ((partial(getattr, cell), "cell_contents") for cell in function.__closure__ or ())
    codes = [function.__code__]
    for code in codes:
        codes.extend(c for c in code.co_consts if isinstance(c, types.CodeType))
        yield from ((function.__globals__.get, name) for name in code.co_names)


def _is_users(module: str | None) -> bool:
    return (module or "").split(".")[0] not in LIBRARIES
