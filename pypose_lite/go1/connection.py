"""`connect`: from an address to a robot."""

import atexit
import contextlib
import math
import os
import threading
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

from .log import Log, read_log
from .robot import Line, Robot
from .safety import signals
from .safety.clocks import SteppedClock, WallClock
from .safety.guardian import Guardian
from .safety.limits import Gait
from .safety.pilot import Pilot
from .simulator.body import STEP
from .simulator.recorded_robot import RecordedRobot
from .simulator.simulated_robot import SimulatedRobot, Simulation
from .wire.protocol import COMMAND_SIZE, HIGH_LEVEL
from .wire.transport import Udp, pair

MARGIN = 0.05  # s, by which a command expires early: a busy computer may keep the sender waiting


def connect(
    address: str = "sim",
    level_flag: int = HIGH_LEVEL,
    rate: float = 200.0,
    command_timeout: float = 0.4,
    *,
    gait: str = "trot",
    speed_limit: float | None = None,
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
    log: str | Path | None = None,
    realtime: bool | None = None,
    simulation: Simulation | None = None,
) -> Robot:
    """A robot that stands still and has told where it is.

    Args:
        address: "sim", a simulated robot in this program; "udp://host:port", a real one or the
            simulator's program; "replay:run.csv", a recorded run.
        level_flag: of the commands; 0x00 for an Air or a Pro, which else hears no command.
        rate: commands a second, 100 to 500.
        command_timeout: s, after which a command that is not renewed is zero velocity, and a state
            that is not renewed is stale.
        gait: "trot", "run" or "stairs": whose limits hold.
        speed_limit: m/s, a further limit.
        start: (x, y, heading) in m and rad that `pose` says where the robot stands now.
        log: a CSV file to write the run to.
        realtime: whether a simulated or recorded robot lives by the wall clock. If not (as by
            default), its time passes in `wait` alone, as fast as the computer goes and the same
            every time.
        simulation: of "sim": its model, seed, numbers and faults.

    Raises:
        RobotTimeout: no state came.
        ValueError: an argument that does not fit.
    """
    _check(address, level_flag, rate, command_timeout, gait, speed_limit)
    if simulation is not None and address != "sim":
        raise ValueError(f"simulation: only for 'sim', not for {address!r}")
    if realtime is False and address.startswith("udp:"):
        raise ValueError("realtime: a robot on UDP lives by the wall clock")
    if not all(map(math.isfinite, start)):
        raise ValueError(f"start: expected finite numbers, got {start!r}")
    pilot = Pilot(level_flag, command_timeout, MARGIN, speed_limit, start)
    closers = contextlib.ExitStack()
    try:
        if address.startswith("udp:"):
            line = _on_udp(address, rate, command_timeout, closers)
        else:
            line = _in_memory(address, rate, bool(realtime), simulation, closers)
        book = None if log is None else closers.enter_context(contextlib.closing(Log(log)))
        robot = Robot(address, line, pilot, Gait[gait.upper()], book, closers)
        if line.guardian is not None:  # a real robot: it is stopped however the program ends
            atexit.register(robot.close)
            closers.callback(atexit.unregister, robot.close)
        robot.begin()
    except BaseException:
        closers.close()
        raise
    return robot


def _on_udp(address: str, rate: float, timeout: float, closers: contextlib.ExitStack) -> Line:
    """A robot at "udp://host:port", with a guardian where the system allows one."""
    parts = urlsplit(address)
    try:
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise ValueError(f"address: {address!r}: {error}") from None
    if not host or not port or parts.path or parts.query:
        raise ValueError(f"address: expected 'udp://host:port', got {address!r}")
    transport = closers.enter_context(contextlib.closing(Udp(host, port)))
    signals.arm()
    closers.callback(signals.disarm)
    guardian = None
    if os.name == "posix":
        guardian = Guardian(transport.socket, COMMAND_SIZE, 1.0 / rate, timeout / 2.0)
        closers.callback(guardian.close)
    return Line(transport, WallClock(rate), guardian)


def _in_memory(
    address: str,
    rate: float,
    realtime: bool,
    simulation: Simulation | None,
    closers: contextlib.ExitStack,
) -> Line:
    """A simulated or a recorded robot in this program."""
    here, there = pair()
    clock = WallClock(rate) if realtime else SteppedClock(rate)
    simulator = None
    if address == "sim":
        simulator = SimulatedRobot(there, simulation or Simulation(), clock.now)
        live = simulator.step
    else:
        live = RecordedRobot(there, read_log(address.removeprefix("replay:")), clock.now).step
    if isinstance(clock, SteppedClock):
        clock.peer = live
    else:
        stopped = threading.Event()
        threading.Thread(target=_live, args=(live, stopped), daemon=True).start()
        closers.callback(stopped.set)
    return Line(here, clock, simulator=simulator)


def _live(step: Callable[[float], None], stopped: threading.Event) -> None:
    """The life of a robot in a thread of its own."""
    while not stopped.is_set():
        step(STEP)


def _check(
    address: str,
    level_flag: int,
    rate: float,
    timeout: float,
    gait: str,
    speed_limit: float | None,
) -> None:
    """Raises ValueError where an argument of `connect` does not fit."""
    if address != "sim" and not address.startswith(("udp:", "replay:")):
        expected = "'sim', 'udp://host:port' or 'replay:run.csv'"
        raise ValueError(f"address: expected {expected}, got {address!r}")
    if level_flag not in (HIGH_LEVEL, 0):
        raise ValueError(f"level_flag: expected 0xEE or 0x00, got {level_flag!r}")
    if not 100 <= rate <= 500:
        raise ValueError(f"rate: expected 100 to 500 Hz, got {rate!r}")
    if not 0.1 <= timeout <= 1.0:
        raise ValueError(f"command_timeout: expected 0.1 to 1 s, got {timeout!r}")
    if gait not in ("trot", "run", "stairs"):
        raise ValueError(f"gait: expected 'trot', 'run' or 'stairs', got {gait!r}")
    if speed_limit is not None and not 0 < speed_limit < math.inf:
        raise ValueError(f"speed_limit: expected m/s above 0, got {speed_limit!r}")
