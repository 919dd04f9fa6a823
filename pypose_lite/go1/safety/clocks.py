"""Two ways for time to pass: by the wall clock, or in steps as fast as the computer goes.

Both beat at a fixed rate, and in every beat the robot speaks and hears. On the wall clock a thread
does that, whatever the program does meanwhile; in steps it happens while the program waits.
"""

import math
import threading
import time
from collections.abc import Callable

DROWSY = 0.1  # s; a beat that is so late shows that the whole program slept
Beat = Callable[[bool, Callable[[], float]], None]  # (late, seconds left until the next beat)


class WallClock:
    """The wall clock, and a thread that beats at a fixed rate, in Hz."""

    now = staticmethod(time.monotonic)

    def __init__(self, rate: float) -> None:
        self._period = 1.0 / rate
        self._last = math.inf  # beats from the order to end to the end
        self._waited = time.monotonic()
        self._thread: threading.Thread | None = None
        self._ended = threading.Event()  # not `join`, which a Ctrl-C leaves in disorder

    def start(self, beat: Beat) -> None:
        """Begins to beat."""
        self._thread = threading.Thread(target=self._run, args=(beat,), daemon=True)
        self._thread.start()

    def wait(self, dt: float) -> None:
        """Sleeps until `dt` seconds after it last returned; `dt` in full after a long pause."""
        now, due = time.monotonic(), self._waited + dt
        if now > due + dt:
            due = now + dt
        time.sleep(max(due - now, 0.0))
        self._waited = max(due, now)

    def stop(self, after: float) -> bool:
        """Ends when it has gone on for `after` seconds; whether all those beats came."""
        self._last = math.ceil(after / self._period)
        return self._thread is None or self._ended.wait(2.0 * after + 1.0)

    def _run(self, beat: Beat) -> None:
        due, last = time.monotonic(), 0
        while last < self._last:
            now = time.monotonic()
            late = now - due > DROWSY
            due = max(due, now - self._period) + self._period  # and nothing is caught up
            beat(late, lambda until=due: until - time.monotonic())  # type: ignore[misc]
            time.sleep(max(due - time.monotonic(), 0.0))
            last += self._last < math.inf
        self._ended.set()


class SteppedClock:
    """Simulated time: it passes in `wait` alone, one beat after the other, the same every time.

    Args:
        rate: beats a second.
    """

    def __init__(self, rate: float) -> None:
        self._rate, self._beats, self._end = rate, 0, 0.0
        self._beat: Beat | None = None
        self.peer: Callable[[], None] = lambda: None  # what lives at the far end

    def now(self) -> float:
        """Seconds since it began."""
        return self._beats / self._rate

    def start(self, beat: Beat) -> None:
        """Sets what is done in every beat."""
        self._beat = beat

    def wait(self, dt: float) -> None:
        """Lets `dt` seconds pass."""
        self._end += dt
        while (self._beats + 1) / self._rate <= self._end + 1e-9:
            self._tick()

    def stop(self, after: float) -> bool:
        """Ends when it has gone on for `after` seconds; True, as all those beats came."""
        self.wait(after)
        self._beat = None
        return True

    def _tick(self) -> None:
        self._beats += 1
        if self._beat is not None:
            self._beat(False, lambda: 0.0)
        self.peer()
