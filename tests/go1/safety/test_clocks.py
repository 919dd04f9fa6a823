import sys

import pytest

from pypose_lite.go1.safety import clocks
from pypose_lite.go1.safety.clocks import SteppedClock, WallClock


class Clock:
    """A wall clock on which sleeping is all that takes time."""

    def __init__(self):
        self.time, self.slept = 100.0, []

    def monotonic(self):
        return self.time

    def sleep(self, seconds):
        self.slept.append(seconds)
        self.time += seconds


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(clocks, "time", clock)
    return clock


def test_waiting_takes_off_what_the_planner_took(clock):
    real = WallClock(200.0)
    for thinking in (0.03, 0.0, 0.09):
        clock.time += thinking
        real.wait(0.1)
        assert clock.slept[-1] == pytest.approx(0.1 - thinking)


def test_a_planner_that_is_too_slow_is_not_made_to_wait(clock):
    real = WallClock(200.0)
    for thinking in (0.15, 0.12, 0.19):
        clock.time += thinking
        real.wait(0.1)
        assert clock.slept[-1] == 0.0


def test_after_a_long_pause_a_wait_is_a_whole_one(clock):
    real = WallClock(200.0)
    clock.time += 10.0
    real.wait(0.1)
    assert clock.slept[-1] == pytest.approx(0.1)
    real.wait(0.1)
    assert clock.slept[-1] == pytest.approx(0.1)


def beats(clock, costs, period=0.005):
    """[(time, late, seconds left)] of beats that take so long."""
    real, seen = WallClock(1.0 / period), []

    def beat(late, left):
        seen.append((clock.time, late, left()))
        clock.time += costs[len(seen) - 1]

    real._last = len(costs)
    real._run(beat)
    return seen


def test_beats_come_at_the_rate_whatever_they_cost(clock):
    seen = beats(clock, [0.001, 0.004, 0.0, 0.003])
    assert [at for at, _, _ in seen] == pytest.approx([100.0, 100.005, 100.010, 100.015])
    assert [left for _, _, left in seen] == pytest.approx([0.005] * 4)
    assert not any(late for _, late, _ in seen)


def test_missed_beats_are_not_caught_up_in_a_burst(clock):
    seen = beats(clock, [0.05, 0.0, 0.0])
    assert [at for at, _, _ in seen] == pytest.approx([100.0, 100.05, 100.055], abs=0.0051)
    assert seen[2][0] - seen[1][0] < 0.0051 and not seen[1][1]


def test_a_beat_after_a_long_sleep_knows_that_it_is_late(clock):
    seen = beats(clock, [0.5, 0.0, 0.0])
    assert [late for _, late, _ in seen] == [False, True, False]


def test_a_stepped_time_beats_before_the_far_end_lives():
    stepped, order = SteppedClock(100.0), []
    stepped.start(lambda late, left: order.append(("beat", stepped.now(), late, left())))
    stepped.peer = lambda: order.append(("peer", stepped.now()))
    stepped.wait(0.02)
    assert order == [
        ("beat", 0.01, False, 0.0),
        ("peer", 0.01),
        ("beat", 0.02, False, 0.0),
        ("peer", 0.02),
    ]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_who_stops_waits_for_the_last_beats_also_if_they_fail():
    for failing, complete in ((False, True), (True, False)):
        real, beats = WallClock(500.0), []

        def beat(late, left, failing=failing, beats=beats):
            beats.append(left)
            if failing and len(beats) > 3:
                sys.exit()  # ends the thread without a word

        real.start(beat)
        assert real.stop(0.1) == complete
        assert len(beats) == 4 or len(beats) >= 50
