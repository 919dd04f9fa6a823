"""A run written to a file, and a file played back as a robot."""

import bisect
import csv
import math
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from .protocol import BmsState, HighState, Imu, ProtocolError, decode_command, encode_state
from .transport import Transport


class Row(NamedTuple):
    """One state with a new content, and the command that was going out when it came."""

    t: float  # s since connect
    x: float  # m, in the frame where the robot stood at connect
    y: float  # m
    heading: float  # rad
    v: float  # m/s, forward
    left: float  # m/s
    yaw_rate: float  # rad/s
    command_v: float  # m/s
    command_left: float  # m/s
    command_yaw_rate: float  # rad/s
    mode: float
    body_height: float  # m
    soc: float  # %


class Log:
    """A CSV file of rows. `add` may be called from any thread; only `flush` touches the disk."""

    def __init__(self, path: str | Path) -> None:
        self._file = open(path, "w", newline="")
        self._writer = csv.writer(self._file)
        self._writer.writerow(Row._fields)
        self._rows: deque[Row] = deque(maxlen=50_000)  # 15 minutes at 50 Hz without a flush

    def add(self, row: Row) -> None:
        """Notes a row."""
        self._rows.append(row)

    def flush(self) -> None:
        """Writes what was noted."""
        while self._rows:
            self._writer.writerow([f"{number:.6f}" for number in self._rows.popleft()])
        self._file.flush()

    def close(self) -> None:
        """Writes what was noted, and closes the file."""
        self.flush()
        self._file.close()


def read_log(path: str | Path) -> list[Row]:
    """The rows of a file that `Log` wrote.

    Raises:
        ValueError: naming the line that is no row of numbers, or the times that go backwards.
    """
    with open(path, newline="") as file:
        lines = list(csv.reader(file))
    if not lines or tuple(lines[0]) != Row._fields:
        raise ValueError(f"{path}: expected a first line {','.join(Row._fields)}")
    rows: list[Row] = []
    for number, line in enumerate(lines[1:], 2):
        try:
            row = Row(*map(float, line))
        except (ValueError, TypeError) as error:
            raise ValueError(f"{path}: line {number} is no row of {len(Row._fields)}") from error
        if not all(map(math.isfinite, row)):
            raise ValueError(f"{path}: line {number}: expected finite numbers")
        if rows and row.t < rows[-1].t:
            raise ValueError(f"{path}: line {number}: the time goes back")
        rows.append(row)
    if not rows:
        raise ValueError(f"{path}: no rows")
    return rows


class Tape:
    """A recorded run at the far end of a transport: it reports what was recorded, at its time.

    What it is told does not move it. After its last row it says nothing new.
    """

    def __init__(
        self, transport: Transport, rows: list[Row], now: Callable[[], float] = time.monotonic
    ) -> None:
        self._transport, self._rows, self._now = transport, rows, now
        self._times = [row.t - rows[0].t for row in rows]
        self._start: float | None = None  # when the first command came
        self._shown, self._content = -1, b""

    def step(self, timeout: float = 0.0) -> None:
        """Hears what has come (waits up to `timeout` s for it), and answers."""
        data = self._transport.receive(timeout)
        while data is not None:
            try:
                decode_command(data)
                self._transport.send(self._state(self._now()))
            except ProtocolError:
                pass
            data = self._transport.receive(0.0)

    def _state(self, now: float) -> bytes:
        """The packet of that moment."""
        self._start = now if self._start is None else self._start
        index = max(bisect.bisect_right(self._times, now - self._start + 1e-9) - 1, 0)
        if index != self._shown:
            self._shown, self._content = index, encode_state(_recorded(self._rows[index]))
        return self._content


def _recorded(row: Row) -> HighState:
    """A state with what a row holds; its time, in a reserved field, keeps rows apart."""
    return HighState(
        imu=Imu(
            quaternion=(math.cos(row.heading / 2), 0.0, 0.0, math.sin(row.heading / 2)),
            rpy=(0.0, 0.0, row.heading),
        ),
        bms=BmsState(soc=int(row.soc)),
        mode=int(row.mode),
        progress=row.t,
        position=(row.x, row.y, row.body_height),
        body_height=row.body_height,
        velocity=(row.v, row.left, 0.0),
        yaw_speed=row.yaw_rate,
    )
