"""A bad line: a transport that loses, delays, doubles, reorders and garbles datagrams, seeded."""

import heapq
import random
import time
from collections.abc import Callable
from dataclasses import dataclass

from ..wire.transport import Transport


@dataclass(frozen=True)
class Faults:
    """What goes wrong on a line, in each of its two directions.

    Attributes:
        loss: share of datagrams lost, 0 to 1.
        delay: seconds that every datagram takes.
        duplicates: share of datagrams that arrive a second time, up to `lateness` later.
        reordering: share of datagrams held back by up to `lateness`, so that others overtake them.
        garbage: share of datagrams followed by one of random bytes, or by one of its own with a
            single bit flipped.
        lateness: seconds, the most that a doubled or held-back datagram is late.
    """

    loss: float = 0.0
    delay: float = 0.0
    duplicates: float = 0.0
    reordering: float = 0.0
    garbage: float = 0.0
    lateness: float = 0.05

    def __post_init__(self) -> None:
        for name in ("loss", "duplicates", "reordering", "garbage"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name}: expected a share, 0 to 1, got {getattr(self, name)}")
        for name in ("delay", "lateness"):
            if not 0.0 <= getattr(self, name) < float("inf"):
                raise ValueError(f"{name}: expected seconds, got {getattr(self, name)}")


class FaultyLine:
    """A transport with faults on the way out and on the way in.

    Args:
        inner: the transport that it spoils.
        faults: what goes wrong.
        seed: of the random draws.
        now: the clock, seconds.
    """

    def __init__(
        self,
        inner: Transport,
        faults: Faults,
        seed: int = 0,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._inner, self._now = inner, now
        self._outward, self._inward = _Way(faults, 2 * seed), _Way(faults, 2 * seed + 1)

    def send(self, data: bytes) -> None:
        """Sends one datagram down the bad line."""
        self._outward.put(data, self._now())
        self._move()

    def receive(self, timeout: float) -> bytes | None:
        """The next datagram that survived, or None when none came within `timeout` seconds."""
        end = self._now() + timeout
        self._move()
        while (data := self._inward.take(self._now())) is None:
            left = end - self._now()
            wait = min(left, *(way.due() - self._now() for way in (self._outward, self._inward)))
            late = self._inner.receive(max(wait, 0.0))
            if late is not None:
                self._inward.put(late, self._now())
            self._move()
            if late is None and left <= wait:
                return self._inward.take(self._now())
        return data

    def close(self) -> None:
        """Closes the transport inside; what was still under way is lost."""
        self._inner.close()

    def _move(self) -> None:
        """Lets arrive whatever is due."""
        while (data := self._outward.take(self._now())) is not None:
            self._inner.send(data)
        while (data := self._inner.receive(0.0)) is not None:
            self._inward.put(data, self._now())


class _Way:
    """One direction: datagrams under way, by the time at which they arrive."""

    def __init__(self, faults: Faults, seed: int) -> None:
        self._faults, self._random = faults, random.Random(seed)
        self._under_way: list[tuple[float, int, bytes]] = []
        self._count = 0  # keeps the order of datagrams that arrive at the same time

    def put(self, data: bytes, now: float) -> None:
        """One datagram sets out."""
        faults, chance = self._faults, self._random.random
        if chance() >= faults.loss:
            held = chance() < faults.reordering
            self._add(data, now + (faults.lateness * chance() if held else 0.0))
            if chance() < faults.duplicates:
                self._add(data, now + faults.lateness * chance())
        if chance() < faults.garbage:
            self._add(self._garbled(data), now)

    def take(self, now: float) -> bytes | None:
        """The next datagram that has arrived."""
        if self._under_way and self.due() <= now:
            return heapq.heappop(self._under_way)[-1]
        return None

    def due(self) -> float:
        """When the next datagram arrives; infinity if none is under way."""
        return self._under_way[0][0] if self._under_way else float("inf")

    def _add(self, data: bytes, now: float) -> None:
        self._count += 1
        heapq.heappush(self._under_way, (now + self._faults.delay, self._count, data))

    def _garbled(self, data: bytes) -> bytes:
        """Random bytes of a random length, or the datagram with one bit flipped."""
        if self._random.random() < 0.5:
            return self._random.randbytes(self._random.randrange(1500))
        bit = self._random.randrange(8 * len(data))
        flipped = int.from_bytes(data, "little") ^ (1 << bit)
        return flipped.to_bytes(len(data), "little")
