"""A run as a CSV file: written while a robot moves, and read again.

`Log` takes rows from the thread that hears the robot, and writes them when the program waits, so
that a slow disk holds up nobody. It does not touch the file before the robot has spoken, and no
file that is there already, unless told so: what is recorded stays recorded. `read_log` reads what
a spreadsheet may have made of it, too, and says which line of which file it cannot read.
"""

import csv
import math
import warnings
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, NamedTuple

from .wire.protocol import HighCmd, HighState


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
    roll: float = 0.0  # rad
    pitch: float = 0.0  # rad
    foot_fr: float = 0.0  # the feet's forces, in the robot's own unit
    foot_fl: float = 0.0
    foot_rr: float = 0.0
    foot_rl: float = 0.0
    age: float = 0.0  # s, how old the state before had become
    refused: float = 0.0  # datagrams so far that were no good state
    target: float = 0.0  # number of the waypoint aimed at; 0 for none


OLD_FIELDS = Row._fields[:13]  # of files that were written before there were more
NEEDED = 10  # columns that have to be finite: time, pose, motion and command
BYTES = ("mode", "soc")  # columns that stand in one byte of a packet


def row(
    times: tuple[float, float],
    pose: tuple[float, float, float],
    state: HighState,
    command: HighCmd,
    counts: tuple[int, int],
) -> Row:
    """The row of a state: its time and age, what it says, what went out, refusals and target."""
    time, age = times
    seen = (*state.velocity[:2], state.yaw_speed)
    asked = (*command.velocity, command.yaw_speed)
    body = state.mode, state.body_height, state.bms.soc
    rest = (*state.imu.rpy[:2], *state.foot_force)
    return Row._make((time, *pose, *seen, *asked, *body, *rest, age, *counts))


class Log:
    """A CSV file of rows. `add` may be called from any thread; only `flush` touches the disk.

    Args:
        path: of the file, which `open` makes.
        overwrite: whether a file that is there may be lost.

    Raises:
        FileExistsError: there is one, and it may not.
    """

    def __init__(self, path: str | Path, overwrite: bool = False) -> None:
        self.path, self._mode = Path(path), "w" if overwrite else "x"
        if self.path.exists() and not overwrite:
            raise FileExistsError(f"log: {path} is there already; overwrite=True replaces it")
        self._file: IO[str] | None = None
        self._rows: deque[Row] = deque(maxlen=50_000)  # 15 minutes at 50 Hz without a flush

    def open(self) -> None:
        """Makes the file."""
        self._file = file = open(self.path, self._mode, newline="", encoding="utf-8")
        self._writer = csv.writer(file)
        self._writer.writerow(Row._fields)

    def add(self, row: Row) -> None:
        """Notes a row."""
        self._rows.append(row)

    def flush(self) -> None:
        """Writes what was noted, if the file is open."""
        if self._file is None:
            return
        while self._rows:
            self._writer.writerow([f"{number:.6f}" for number in self._rows.popleft()])
        self._file.flush()

    def close(self) -> None:
        """Writes what was noted, and closes the file."""
        self.flush()
        if self._file is not None:
            self._file.close()


def read_log(path: str | Path) -> list[Row]:
    """The rows of a file that `Log` wrote.

    A last row that was cut off (the computer lost its power) is left out, with a warning.

    Raises:
        ValueError: naming the file and the line that is no row of numbers, or the times that go
            backwards.
    """
    with open(path, newline="", encoding="utf-8-sig") as file:
        text = file.read()
    lines = _lines(path, text)
    head = tuple(next(lines, (0, []))[1])
    if head not in (Row._fields, OLD_FIELDS):
        raise ValueError(f"{path}: expected a first line {','.join(Row._fields)}")
    rows: list[Row] = []
    whole = text.endswith(("\n", "\r"))
    numbered = [*lines]
    for place, (number, cells) in enumerate(numbered):
        try:
            rows.append(_row(f"{path}: line {number}", cells, len(head), rows))
        except ValueError as error:
            if whole or place < len(numbered) - 1:
                raise
            warnings.warn(f"{error}: it was cut off, and is left out", stacklevel=2)
    if not rows:
        raise ValueError(f"{path}: no rows")
    return rows


def _lines(path: str | Path, text: str) -> Iterator[tuple[int, list[str]]]:
    """The numbered lines that are not blank, as cells, split at commas or at semicolons."""
    first = text.partition("\n")[0]
    reader = csv.reader(text.splitlines(), delimiter=";" if ";" in first else ",")
    try:
        for cells in reader:
            if any(cells):
                yield reader.line_num, cells
    except csv.Error as error:
        raise ValueError(f"{path}: line {reader.line_num}: {error}") from None


def _row(where: str, cells: list[str], width: int, before: list[Row]) -> Row:
    """The row in those cells; ValueError that begins with `where` if there is none."""
    try:
        numbers: list[Any] = [*map(float, cells)]
    except ValueError as error:
        raise ValueError(f"{where} is no row of {width} numbers ({error})") from None
    if len(numbers) != width:
        raise ValueError(f"{where} is no row of {width} numbers, it has {len(numbers)}")
    row = Row(*numbers)
    if not all(map(math.isfinite, row[:NEEDED])):
        raise ValueError(f"{where}: expected finite numbers")
    for name in BYTES:
        if not 0 <= getattr(row, name) <= 255:
            raise ValueError(f"{where}: {name}: expected 0 to 255, got {getattr(row, name):g}")
    if before and row.t < before[-1].t:
        raise ValueError(f"{where}: the time goes back")
    return row
