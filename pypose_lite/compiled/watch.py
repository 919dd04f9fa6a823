"""Notices that a system would do something else by now than what was written down.

What a system does depends on its attributes, on its class, and on what its functions name:
globals, closures, defaults, and other functions with all of theirs. :func:`watch` goes through
these once and notes what stands where; :func:`changed` looks whether the same things still stand
there, which takes microseconds. Tensors may change their numbers: those are told whenever code
runs. A list, a dictionary or an object is gone into; what belongs to torch, to Python or to this
library stays as it is.
"""

import sys
import types
from collections.abc import Iterator
from typing import Any

import torch

from ..systems import NLS, System

LIBRARIES = {"torch", "pypose_lite", "numpy", *sys.stdlib_module_names, "builtins"}
VALUES = (int, float, complex, str, bytes, bool, type(None), torch.Tensor, types.ModuleType)
UNREAD = vars(NLS()).keys() - {"_parameters", "_buffers", "_modules"}  # of a module, and the clock
MISSING = object()

Noted = list[tuple[Any, Any, Any]]  # a container, where in it, and what stands there


def watch(system: System) -> Noted:
    """Returns what a system's transition depends on."""
    noted: Noted = []
    seen: set[int] = set()
    todo: list[Any] = [system]
    while todo:
        thing = todo.pop()
        if id(thing) in seen or isinstance(thing, VALUES):
            continue
        seen.add(id(thing))
        for place in _inside(thing):
            value = _look(*place)
            noted.append((*place, value))
            if value is not MISSING:
                todo.append(value)
    return noted


def changed(noted: Noted) -> bool:
    """Returns whether anything stands where something else stood."""
    return any(_look(container, key) is not value for container, key, value in noted)


def _look(container: Any, key: Any) -> Any:
    if key is None:  # how much there is
        return _Length.of(container)
    if isinstance(container, dict | types.MappingProxyType):
        return container.get(key, MISSING)
    if isinstance(container, types.CellType):
        return getattr(container, "cell_contents", MISSING)
    if isinstance(container, list | tuple):
        return container[key] if key < len(container) else MISSING
    return getattr(container, key, MISSING)


class _Length:
    """Lengths that are the same object where they are equal."""

    known: dict[int, "_Length"] = {}

    @classmethod
    def of(cls, container: Any) -> "_Length":
        """Returns the object of a container's length."""
        return cls.known.setdefault(len(container), cls())


def _inside(thing: Any) -> Iterator[tuple[Any, Any]]:
    """Yields where everything stands that a thing consists of."""
    if isinstance(thing, types.MethodType):
        yield thing, "__func__"
        yield thing, "__self__"
    elif isinstance(thing, types.FunctionType):
        yield from _of_function(thing)
    elif isinstance(thing, property | staticmethod | classmethod):
        yield thing, "fget" if isinstance(thing, property) else "__func__"
    elif isinstance(thing, dict):
        yield thing, None
        yield from ((thing, key) for key in thing if not (thing and key == "_t"))
    elif isinstance(thing, list | tuple):
        yield thing, None
        yield from ((thing, i) for i in range(len(thing)))
    elif isinstance(thing, type):
        if _is_users(thing.__module__):
            yield from ((vars(thing), key) for key in list(vars(thing)) if key != "__doc__")
    elif hasattr(thing, "__dict__"):
        unread = UNREAD if isinstance(thing, torch.nn.Module) else ()
        yield from ((vars(thing), key) for key in list(vars(thing)) if key not in unread)
        yield thing, "__class__"
        yield from ((tuple(type(thing).__mro__), i) for i in range(len(type(thing).__mro__)))


def _of_function(function: types.FunctionType) -> Iterator[tuple[Any, Any]]:
    """Yields what a function's code, and the code in it, may read."""
    yield function, "__code__"
    if not _is_users(function.__module__):
        return
    yield function, "__defaults__"
    yield function, "__kwdefaults__"
    yield from ((cell, "contents") for cell in function.__closure__ or ())
    codes = [function.__code__]
    for code in codes:
        codes.extend(c for c in code.co_consts if isinstance(c, types.CodeType))
        yield from ((function.__globals__, name) for name in code.co_names)


def _is_users(module: str | None) -> bool:
    return (module or "").split(".")[0] not in LIBRARIES
