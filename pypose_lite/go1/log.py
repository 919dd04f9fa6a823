"""A run as a CSV file: written while a robot moves, and read again."""

import csv
import math
from collections import deque
from pathlib import Path
from typing import NamedTuple


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
