"""`connect`: from an address to a robot.

Three kinds of robots speak the same packets, so that nothing behind `Robot` knows which it has:

    "udp://host:port"   a real one, or the simulator's program: a socket, the wall clock, a guardian
    "sim"               a simulated one in this program: a pair of ends in memory, stepped time
    "sim:legs"          the same with a Go2's body and legs, moved by physics
    "replay:run.csv"    a recorded one: the same, and it does not obey

`connect` puts the parts together (transport, clock, guardian, pilot, log), hands them to a `Robot`,
and waits for the first state. Each part tells an `ExitStack` how it is closed; it runs backwards,
so that the farewell goes out first and the socket is closed last, also when `connect` itself fails
half way. One program has one robot at an address: a second `connect` closes the first.
"""

import atexit
import contextlib
import math
import os
import sys
import threading
import warnings
import weakref
from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit

from .log import Log, read_log
from .robot import Line, Robot
from .safety import rules, signals
from .safety.clocks import SteppedClock, WallClock
from .safety.guardian import Guardian
from .safety.limits import Gait, Mode
from .safety.pilot import Pilot
from .safety.rules import Area, Motion, Pose
from .simulator.body import STEP
from .simulator.recorded_robot import RecordedRobot
from .simulator.simulated_robot import SimulatedRobot, Simulation
from .wire.protocol import COMMAND_SIZE, HIGH_LEVEL
from .wire.transport import Udp, pair

SIMULATED = ("sim", "sim:legs")
MARGIN = 0.05  # s, by which a command expires early: a busy computer may keep the sender waiting
_robots: weakref.WeakValueDictionary[str, Robot] = weakref.WeakValueDictionary()


def connect(
    address: str = "sim",
    level_flag: int = HIGH_LEVEL,
    rate: float = 200.0,
    command_timeout: float = 0.4,
    *,
    gait: str = "trot",
    speed_limit: float | None = None,
    start: Pose = (0.0, 0.0, 0.0),
    area: Area | None = None,
    trim: Motion = (0.0, 0.0, 0.0),
    ignore: Collection[str] = (),
    log: str | Path | None = None,
    overwrite: bool = False,
    realtime: bool | None = None,
    simulation: Simulation | None = None,
    limp: bool = False,
) -> Robot:
    """A robot that stands still and has told where it is.

    Args:
        address: "sim", a simulated robot in this program; "sim:legs", one with legs and physics;
            "udp://host:port", a real one or the simulator's program; "replay:run.csv", a recorded
            run.
        level_flag: of the commands; 0x00 for an Air or a Pro, which else hears no command.
        rate: commands a second, 100 to 500.
        command_timeout: s, after which a command that is not renewed is zero velocity, and a state
            that is not renewed is stale.
        gait: "trot", "run" or "stairs": whose limits hold.
        speed_limit: m/s, a further limit.
        start: (x, y, heading) in m and rad that `pose` says where the robot stands now.
        area: (least x, greatest x, least y, greatest y) in m, which it may not leave.
        trim: m/s forward, m/s left, rad/s, added to every motion of a robot that drifts.
        ignore: safety rules to do without, by their names (`safety.rules.NAMES`): "battery" where
            its board is silent, "motion" and "posture" on a stand.
        log: a CSV file to write the run to, made when the robot has spoken.
        overwrite: whether that file may be there already, and is lost.
        realtime: whether a simulated or recorded robot lives by the wall clock. If not (as by
            default), its time passes in `wait` alone, as fast as the computer goes and the same
            every time.
        simulation: of "sim" and "sim:legs": its model, seed, numbers and faults.
        limp: the emergency: the legs are to go limp from the first packet on, before any answer.

    Raises:
        RobotTimeout: no state came; it says what did come.
        FileExistsError: the log is there already.
        ValueError: an argument that does not fit.
    """
    _check_line(address, level_flag, rate, command_timeout, realtime, simulation)
    _check_walk(gait, speed_limit, start, area, trim)
    pilot = Pilot(level_flag, command_timeout, MARGIN, speed_limit, start, area, ignore, trim)
    closers = contextlib.ExitStack()
    try:
        book = None if log is None else closers.enter_context(_log(address, log, overwrite))
        if address.startswith("udp:"):
            line = _on_udp(address, rate, command_timeout, closers)
        else:
            line = _in_memory(address, rate, bool(realtime), simulation, closers)
        if limp:
            pilot.halt(Mode.DAMP)
        robot = Robot(address, line, pilot, Gait[gait.upper()], book, closers)
        if line.guardian is not None:  # a real robot: it is stopped however the program ends
            atexit.register(robot.close)
            closers.callback(atexit.unregister, robot.close)
        robot.begin()
    except BaseException:
        closers.close()
        raise
    if address.startswith("udp:"):
        _robots[address] = robot
        if reason := rules.wrong_flag(robot.state, level_flag):
            warnings.warn(f"{reason}: it will not move", stacklevel=2)
    return robot


def _log(address: str, path: str | Path, overwrite: bool) -> contextlib.closing[Log]:
    """The log of a run, which may not be the recording that is played back."""
    log = Log(path, overwrite)
    recording = Path(address.removeprefix("replay:"))
    if recording.exists() and Path(path).exists() and recording.samefile(path):
        raise ValueError(f"log: {path} is the recording that is played back")
    return contextlib.closing(log)


def _on_udp(address: str, rate: float, timeout: float, closers: contextlib.ExitStack) -> Line:
    """A robot at "udp://host:port", with a guardian where the system allows one."""
    parts = urlsplit(address)
    try:
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise ValueError(f"address: {address!r}: {error}") from None
    if not host or not port or parts.path or parts.query:
        raise ValueError(f"address: expected 'udp://host:port', got {address!r}")
    transport = closers.enter_context(contextlib.closing(Udp(host, port, _leave(address))))
    signals.arm()
    closers.callback(signals.disarm)
    guardian = None
    if os.name == "posix":
        guardian = Guardian(transport.socket, COMMAND_SIZE, 1.0 / rate, timeout / 2.0)
        closers.callback(guardian.close)
    return Line(transport, WallClock(rate), guardian)


def _leave(address: str) -> int:
    """Closes this program's earlier robot there; its port, for the robot knows that one."""
    earlier = _robots.pop(address, None)
    if earlier is None or earlier.closed:
        return 0
    transport = earlier._transport
    port = transport.port if isinstance(transport, Udp) else 0
    warnings.warn(f"{address}: the robot of an earlier connect is closed", stacklevel=4)
    earlier.close()
    return port


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
    if address in SIMULATED:
        setup = simulation or Simulation()
        setup = replace(setup, body="legs") if address == "sim:legs" else setup
        simulator = SimulatedRobot(there, setup, clock.now)
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
    try:
        while not stopped.is_set():
            step(STEP)
    except RuntimeError as error:  # the robot is dead, and its state will soon be stale
        print(error, file=sys.stderr, flush=True)


def _check_line(
    address: str,
    level_flag: int,
    rate: float,
    timeout: float,
    realtime: bool | None,
    simulation: Simulation | None,
) -> None:
    """Raises ValueError where an argument that says how to speak to the robot does not fit."""
    if address not in SIMULATED and not address.startswith(("udp:", "replay:")):
        expected = "'sim', 'sim:legs', 'udp://host:port' or 'replay:run.csv'"
        raise ValueError(f"address: expected {expected}, got {address!r}")
    if level_flag not in (HIGH_LEVEL, 0):
        raise ValueError(f"level_flag: expected 0xEE or 0x00, got {level_flag!r}")
    if not 100 <= rate <= 500:
        raise ValueError(f"rate: expected 100 to 500 Hz, got {rate!r}")
    if not 0.1 <= timeout <= 1.0:
        raise ValueError(f"command_timeout: expected 0.1 to 1 s, got {timeout!r}")
    if simulation is not None and address not in SIMULATED:
        raise ValueError(f"simulation: only for 'sim' and 'sim:legs', not for {address!r}")
    if realtime is False and address.startswith("udp:"):
        raise ValueError("realtime: a robot on UDP lives by the wall clock")


def _check_walk(
    gait: str, speed_limit: float | None, start: Pose, area: Area | None, trim: Motion
) -> None:
    """Raises ValueError where an argument that says how it may walk does not fit."""
    if gait not in ("trot", "run", "stairs"):
        raise ValueError(f"gait: expected 'trot', 'run' or 'stairs', got {gait!r}")
    if speed_limit is not None and not 0 < speed_limit < math.inf:
        raise ValueError(f"speed_limit: expected m/s above 0, got {speed_limit!r}")
    if len(start) != 3 or not all(map(math.isfinite, start)):
        raise ValueError(f"start: expected three finite numbers, got {start!r}")
    if len(trim) != 3 or not all(map(math.isfinite, trim)):
        raise ValueError(f"trim: expected three finite numbers, got {trim!r}")
    if area is not None and not (len(area) == 4 and area[0] < area[1] and area[2] < area[3]):
        raise ValueError(f"area: expected (least x, most x, least y, most y) in m, got {area!r}")
