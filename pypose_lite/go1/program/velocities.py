"""Velocities from another program, a line of JSON each: {"v": 0.2, "yaw_rate": 0.1, "left": 0}.

Each line is a motion for the next 0.4 s, as `Robot.move` takes it: a program that falls silent is
a robot that stands. {"stop": true} is zero velocity at once, and {"go_on": true} lets a robot walk
again that a safety rule has stopped.
"""

import json
import math
import queue
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from typing import IO

from ..robot import Robot

LONGEST = 1000  # characters of a line
MOTION = ("v", "yaw_rate", "left")
ORDERS = ("stop", "go_on")


def obey(robot: Robot, line: str) -> None:
    """Does what a line says.

    Raises:
        ValueError: the line is none of these.
        RobotStopped, RobotTimeout, RuntimeError: as `Robot.move`.
    """
    said = _parsed(line)
    if said.get("go_on"):
        robot.go_on()
    elif said.get("stop"):
        robot.stop()
    elif set(said) & set(MOTION):
        robot.move(*(said.get(name, 0.0) for name in MOTION))


def _parsed(line: str) -> dict:
    """The object in a line; ValueError if it is not one of those that are obeyed."""
    try:
        said = json.loads(line) if len(line) <= LONGEST else None
    except (ValueError, RecursionError):
        said = None
    if not isinstance(said, dict) or not said or set(said) - {*MOTION, *ORDERS}:
        raise ValueError(f'expected {{"v": 0.2, "yaw_rate": 0.1, "left": 0}}, got {line[:80]!r}')
    for name, value in said.items():
        kind = bool if name in ORDERS else (int, float)
        right = isinstance(value, kind) and (name in ORDERS) == isinstance(value, bool)
        if not right or (name in MOTION and not math.isfinite(value)):
            expected = "true or false" if name in ORDERS else "a finite number"
            raise ValueError(f"{name}: expected {expected}, got {value!r}")
    return said


class Source:
    """Lines that come while the robot is driven: `next` gives one, or None when none came.

    Args:
        where: "-" for standard input, or the number of a UDP port of this computer, which hears
            this computer alone.
    """

    def __init__(self, where: str, stream: IO[str] | None = None) -> None:
        self.over = False
        self._lines: queue.Queue[str | None] = queue.Queue(100)
        self._close: Callable[[], None] = lambda: None
        if where == "-":
            lines = iter(sys.stdin if stream is None else stream)
        else:
            ear = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            ear.bind(("127.0.0.1", int(where)))
            self._close, lines = ear.close, _datagrams(ear)
        threading.Thread(target=self._read, args=(lines,), daemon=True).start()

    def next(self, timeout: float) -> str | None:
        """The next line that came within that time, or None; `over` says that no more will."""
        try:
            line = self._lines.get(timeout=timeout)
        except queue.Empty:
            return None
        self.over = self.over or line is None
        return line

    def close(self) -> None:
        """Frees the port."""
        self._close()

    def _read(self, lines: Iterator[str]) -> None:
        """Puts lines where `next` finds them; what comes too fast is lost, oldest first."""
        for line in lines:
            if line.strip():
                self._put(line)
        self._put(None)

    def _put(self, line: str | None) -> None:
        while True:
            try:
                return self._lines.put_nowait(line)
            except queue.Full:
                self._lines.get_nowait()


def _datagrams(ear: socket.socket) -> Iterator[str]:
    """The lines that come to a socket, until it is closed."""
    while True:
        try:
            data = ear.recv(2048)
        except OSError:
            return
        yield from data.decode("utf-8", "replace").splitlines()
