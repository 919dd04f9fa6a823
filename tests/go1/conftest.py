import threading
import time

import pytest
from go1_helpers import Watched


class Busy(Exception):
    """The machine kept the test waiting, so that what it saw of time says nothing."""


class Metronome(threading.Thread):
    """Beats every few milliseconds, and notes how long it had to wait for a beat."""

    beat = 0.005  # s

    def __init__(self):
        super().__init__(daemon=True)
        self.over, self.waits = threading.Event(), []

    def run(self):
        while not (self.waits and self.over.is_set()):
            began = time.monotonic()
            time.sleep(self.beat)
            self.waits.append(time.monotonic() - began)

    def busy(self):
        """How it was held up, in words, or None."""
        self.over.set()
        self.join()
        mean, worst = sum(self.waits) / len(self.waits), max(self.waits)
        if worst > 0.05 or mean > 1.5 * self.beat:
            return f"a wait of {self.beat} s took {mean:.4f} s on average, {worst:.4f} s at most"


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem):
    """A failure on the wall clock counts where the machine had time; else it is `Busy`."""
    if pyfuncitem.get_closest_marker("wall_clock") is None:
        return (yield)
    metronome = Metronome()
    metronome.start()
    try:
        return (yield)
    except (Exception, pytest.fail.Exception) as error:
        reason = metronome.busy()
        if reason:
            raise Busy(reason) from error
        raise
    finally:
        metronome.over.set()


@pytest.fixture
def watch():
    """A factory of watched robots, closed at the end."""
    watched = []

    def make(**options):
        watched.append(Watched(**options))
        return watched[-1]

    yield make
    for one in watched:
        one.robot.close()
