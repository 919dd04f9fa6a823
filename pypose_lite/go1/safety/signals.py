"""Lets a program that is told to end run its `with` and `finally` blocks first.

Without this, `kill -TERM` or a closed terminal ends Python on the spot.
"""

import contextlib
import signal
from types import FrameType
from typing import Any, NoReturn

ENDINGS = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
_before: dict[int, Any] = {}
_robots = 0


def arm() -> None:
    """From now on those signals raise SystemExit; one that the program handles itself is left."""
    global _robots
    _robots += 1
    for number in ENDINGS:
        if number not in _before and signal.getsignal(number) == signal.SIG_DFL:
            with contextlib.suppress(ValueError):  # only the main thread may; others do without
                _before[number] = signal.signal(number, _leave)


def disarm() -> None:
    """Puts the signals back as they were when the last robot is closed."""
    global _robots
    _robots -= 1
    for number in [*_before] if _robots == 0 else []:
        with contextlib.suppress(ValueError):
            if signal.getsignal(number) == _leave:
                signal.signal(number, _before[number])
            del _before[number]


def _leave(number: int, frame: FrameType | None) -> NoReturn:
    raise SystemExit(128 + number)
