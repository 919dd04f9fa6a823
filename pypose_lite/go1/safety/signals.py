"""What Ctrl-C, `kill -TERM` and a closed terminal do to a program that drives a robot.

`arm` lets a program that is told to end run its `with` and `finally` blocks first: without, a
TERM or HUP ends Python on the spot. `postponed` keeps whatever comes then from cutting the
farewell short: one impatient Ctrl-C after another is still one complete farewell.
"""

import contextlib
import signal
from collections.abc import Iterator
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


@contextlib.contextmanager
def postponed() -> Iterator[None]:
    """Runs a block to its end; a signal that comes meanwhile does its work afterwards.

    Of several, an order to end goes before a Ctrl-C. In another thread than the main one, where
    no signal arrives, this does nothing.
    """
    came: list[int] = []
    found: dict[int, Any] = {}
    with contextlib.suppress(ValueError):
        for number in (signal.SIGINT, *ENDINGS):
            if signal.getsignal(number) not in (None, signal.SIG_IGN):
                found[number] = signal.signal(number, lambda n, frame: came.append(n))
    try:
        yield
    finally:
        for number, handler in found.items():
            signal.signal(number, handler)
    if came:
        signal.raise_signal(next((n for n in came if n != signal.SIGINT), came[0]))


def _leave(number: int, frame: FrameType | None) -> NoReturn:
    raise SystemExit(128 + number)
