"""The functions that users write: what they are called with, and what their mistakes mean.

``state_transition`` and ``observation`` may be methods, or any callable that a system is given as
an attribute: a function, a lambda, a partial, an ``nn.Module``. The time is passed to those that
ask for it.
"""

import functools
import inspect
import re
import weakref
from collections.abc import Callable

from torch import Tensor, nn

TIME = ("t", "time")  # what an argument with a default is called that is meant for the time
THIRD = "the third argument"
# What torch and Python say where a function of one sample takes it for a batch.
OF_A_BATCH = re.compile(
    "too many indices|iteration over a 0-d|Dimension out of range|invalid index of a 0-dim|"
    "tuple index out of range|not enough values to unpack|must be a (2|3|matrix)|"
    "only supported on matrices|dimension 0 with size 0"
)
_KNOWN = {bound: weakref.WeakKeyDictionary[Callable, str | None]() for bound in (True, False)}


def written(system: nn.Module, name: str) -> Callable:
    """Returns ``(x, u, t) -> y``: the system's function of that name, whatever it is written as.

    Where it is ``vectorized``, t is passed on as ``(..., 1)``, like a state.

    Raises:
        ValueError: for a function that does not take a state and an input, and, once it is
            called, for a result that is no tensor.
    """
    function, time = written_by_user(system, name), time_argument(system, name)

    def call(x: Tensor, u: Tensor, t: Tensor) -> Tensor:
        t = t.unsqueeze(-1) if system.vectorized else t
        try:
            if time is None:
                y = function(x, u)
            elif time == THIRD:
                y = function(x, u, t)
            else:
                y = function(x, u, **{time: t})
        except (IndexError, RuntimeError, TypeError, ValueError) as error:
            if system.vectorized or x.ndim > 1 or not OF_A_BATCH.search(str(error)):
                raise
            raise _of_one_sample(error, _whose(system, name), x, u) from error
        if not isinstance(y, Tensor):
            kind = type(y).__name__
            raise ValueError(f"{_whose(system, name)}: expected a tensor as its result, got {kind}")
        return y

    return call


def time_argument(system: nn.Module, name: str) -> str | None:
    """Returns how the system's function of that name is given the time; None where it takes none.

    The time is an argument called ``t`` or ``time``, or a third one without a default. So
    ``state_transition(self, state, input, noise=0.0)`` takes none.

    Raises:
        ValueError: for other arguments without a default, and for ``*args`` alone.
    """
    function = written_by_user(system, name)
    known = _KNOWN[inspect.ismethod(function)]
    key = getattr(function, "__func__", function)
    if key not in known:
        known[key] = _time_argument(function, _whose(system, name))
    return known[key]


def written_by_user(system: nn.Module, name: str) -> Callable:
    """Returns the function as it is; torch keeps an ``nn.Module`` apart from other attributes."""
    return system._modules.get(name) or getattr(system, name)


def _time_argument(function: Callable, whose: str) -> str | None:
    if not callable(function):
        raise ValueError(f"{whose}: expected a function, got {type(function).__name__}")
    try:
        signature = _signature(function.forward if isinstance(function, nn.Module) else function)
    except ValueError:  # some of torch's own functions do not say
        return None
    taken = [p for p in signature.parameters.values() if p.kind != p.VAR_KEYWORD]
    places = [p for p in taken if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    fixed = function.keywords if isinstance(function, functools.partial) else {}
    others = [p for p in taken if p not in places[:2] and p.kind != p.VAR_POSITIONAL]
    third = [p for p in places[2:3] if p.name in TIME or p.default is p.empty]
    times = third or [p for p in others if p.name in TIME and p.name not in fixed]
    rest = [p for p in others if p not in times[:1] and p.default is p.empty]
    if len(places) < 2 or rest:
        wraps = "; a decorator says by functools.wraps what it wraps" if not places else ""
        raise ValueError(
            f"{whose}: expected the arguments (state, input) or (state, input, t), "
            f"got {signature}{wraps}"
        )
    return None if not times else THIRD if third else times[0].name


def _signature(function: Callable) -> inspect.Signature:
    """Returns what a function takes; of a decorator's ``*args``, what the function inside takes."""
    if hasattr(function, "__wrapped__"):
        wrapper = getattr(function, "__func__", function)
        code = getattr(wrapper, "__code__", None)
        if code is not None and not code.co_flags & inspect.CO_VARARGS:
            return inspect.signature(function, follow_wrapped=False)
    return inspect.signature(function)


def _whose(system: nn.Module, name: str) -> str:
    return f"{name} of {type(system).__name__}"


def _of_one_sample(error: Exception, whose: str, x: Tensor, u: Tensor) -> Exception:
    """Returns the user's error with a hint, as an error of the same kind where that can be made."""
    kind = type(error) if type(error) in (IndexError, TypeError, ValueError) else RuntimeError
    return kind(
        f"{whose} gets one sample at a time, a state {tuple(x.shape)} and an input "
        f"{tuple(u.shape)}, and seems to be written for a batch: {error}. Write it for one sample, "
        "or for any leading dimensions, as state[..., 0] is, with `vectorized = True` in the class"
    )
