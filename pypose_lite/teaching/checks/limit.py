"""A limit of time for somebody else's code, in the thread that runs it.

A notebook runs its cells in the main thread of its kernel, and Python cannot end a thread. But it
can raise an exception in one, on every system, and a watchdog does so when the time is over. Code
that swallows it, by ``except:`` in a loop, gets one that strikes in the ``except:`` as well.

Python raises between two of its own instructions. A single call that stays in C for ever, such as
``time.sleep(1e9)``, cannot be ended like this: interrupt or restart the kernel.
"""

import contextlib
import ctypes
import signal
import sys
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any, TypeVar

Result = TypeVar("Result")
AGAIN = 0.2  # s between two attempts


class TimeLimit(BaseException):
    """The time is over. No Exception, so that ``except Exception`` lets it pass."""


class Insistent(TimeLimit):
    """Strikes again at the next line: whoever catches it gets another one while doing so."""

    def __init__(self) -> None:
        """Runs in the thread that is to end, before the exception is raised there."""
        frame, frames = sys._getframe(1), []
        while frame.f_back is not None and frame.f_code is not limited.__code__:
            frames.append(frame)
            frame = frame.f_back
        if all(each.f_code is not _Watchdog.stop.__code__ for each in frames):
            for each in frames:
                each.f_trace = _strike
            sys.settrace(_pass)


def _strike(frame: FrameType, event: str, arg: Any) -> None:
    raise TimeLimit


def _pass(frame: FrameType, event: str, arg: Any) -> None:
    """Leaves calls that begin from now on alone."""


def limited(function: Callable[[], Result], seconds: float) -> Result:
    """Returns ``function()``, or raises TimeLimit in it once ``seconds`` have passed."""
    watchdog = _Watchdog(seconds)
    try:
        try:
            watchdog.thread.start()
            return function()
        finally:
            watchdog.stop()
    except TimeLimit:
        watchdog.stop()  # in case that it struck while it was being stopped
        raise


class _Watchdog:
    """Raises TimeLimit in the thread that made it, again and again, until it is stopped."""

    def __init__(self, seconds: float) -> None:
        self.seconds, self.owner, self.trace = seconds, threading.get_ident(), sys.gettrace()
        self.on_watch = threading.Lock()
        self.on_watch.acquire()
        self.thread = threading.Thread(target=self._watch, daemon=True)

    def _watch(self) -> None:
        wait: float = self.seconds
        exception: type[TimeLimit] = TimeLimit
        while not self.on_watch.acquire(timeout=wait):
            pointer = ctypes.c_ulong(self.owner), ctypes.py_object(exception)
            ctypes.pythonapi.PyThreadState_SetAsyncExc(*pointer)
            wait, exception = AGAIN, Insistent

    def stop(self) -> None:
        """Ends the watch. An exception that is still on its way strikes here, and not later."""
        while self.thread.ident is not None:
            try:
                with contextlib.suppress(RuntimeError):  # it was stopped before
                    self.on_watch.release()
                self.thread.join()
                self.thread.is_alive()  # a call, at which one strikes at the latest
                break
            except TimeLimit:
                continue
        sys.settrace(self.trace)


class Interrupts:
    """Tells a reader's Ctrl-C from a KeyboardInterrupt that an answer raised by itself."""

    def __init__(self) -> None:
        self.real = False
        self.before: Any = None

    def __enter__(self) -> "Interrupts":
        """Listens to the signal where one can: in the main thread."""
        if threading.current_thread() is threading.main_thread():
            self.before = signal.getsignal(signal.SIGINT)
            if callable(self.before):
                signal.signal(signal.SIGINT, self._note)
        else:
            self.real = True
        return self

    def __exit__(self, *_: object) -> None:
        """Hands the signal back."""
        if callable(self.before):
            signal.signal(signal.SIGINT, self.before)

    def _note(self, number: int, frame: Any) -> None:
        self.real = True
        self.before(number, frame)
