"""Undoes what a submission has changed in its process before its answers are judged."""

import builtins
import math
import sys
from importlib import import_module
from types import ModuleType
from typing import Any

import torch

PACKAGE = "pypose_lite"
CHECKS = f"{PACKAGE}.teaching.checks"
CHECKERS_TOOLS = builtins, math, torch, torch.linalg, torch.nn.functional


class Trusted:
    """The modules and classes that checks rely on, as they are now.

    A submission that replaces ``check``, an oracle of the library, ``torch.allclose`` or ``len``
    harms itself only until ``restore``. Code that changes the objects themselves (the code of a
    function, the memory of the interpreter) is not held off.
    """

    def __init__(self, chapters: set[int]) -> None:
        """Imports the checks of these chapters, and remembers them with all that they use."""
        for number in chapters:
            import_module(CHECKS).chapter(number)
        ours = [m for name, m in sys.modules.items() if name.split(".")[0] == PACKAGE]
        modules: list[ModuleType] = [*CHECKERS_TOOLS, *ours]
        found = [thing for module in ours for thing in vars(module).values()]
        classes = {thing for thing in found if isinstance(thing, type) and _is_ours(thing)}
        kept: list[Any] = [*modules, torch.Tensor, *classes]
        self.kept = [(thing, dict(vars(thing))) for thing in kept]

    def restore(self) -> ModuleType:
        """Puts everything back, and returns the checks, read from their files again."""
        for thing, names in self.kept:
            for name, value in names.items():
                if vars(thing).get(name) is not value:
                    setattr(thing, name, value)
            if isinstance(thing, type):  # what was added there may hide what a base has
                for name in vars(thing).keys() - names.keys():
                    delattr(thing, name)
        for name in [name for name in sys.modules if name.startswith(CHECKS)]:
            del sys.modules[name]
        return import_module(CHECKS)


def _is_ours(thing: type) -> bool:
    return thing.__module__.split(".")[0] == PACKAGE
