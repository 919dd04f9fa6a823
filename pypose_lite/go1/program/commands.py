"""The commands: each connects, does one thing, and says in its last packets that it goes."""

import argparse
import contextlib
import sys
from collections.abc import Callable

from ..connection import connect
from ..log import read_log
from ..robot import Robot
from ..safety.pilot import RobotTimeout
from ..walk import AREA, START, draw
from . import identifying, walking
from .description import as_json, as_table, describe
from .questions import agreed
from .velocities import Source, obey

REFRESH = 0.2  # s, between two looks at a robot that is listened to
HOME = "\x1b[H\x1b[J"  # back to the terminal's first line, and empty it


def run(options: argparse.Namespace) -> int:
    """Does what was asked for, and returns the exit status."""
    return COMMANDS[options.command](options)


def status(options: argparse.Namespace) -> int:
    """Says once what the robot says."""
    with _connected(options) as robot:
        robot.wait(0.5)  # so that there is something to count
        _show(robot, options)
    return 0


def listen(options: argparse.Namespace) -> int:
    """Says what the robot says until Ctrl-C; lets another program drive it."""
    more = {"log": options.log, "overwrite": options.overwrite, "trim": options.trim}
    more |= {"area": options.area, "speed_limit": options.speed_limit}
    with _connected(options, realtime=True, **more) as robot:
        if options.cmd_vel is None:
            _watch(robot, options)
            return 0
        says = f"{robot.address}: it will walk as the lines from {options.cmd_vel} say,\n"
        says += f"at up to {options.speed_limit:g} m/s. Ctrl-C stops it."
        if not agreed(robot, options, says):
            return 1
        with contextlib.closing(Source(options.cmd_vel)) as source:
            _drive(robot, source, options)
    return 0


def stand(options: argparse.Namespace) -> int:
    """Lets it stand up."""
    return _posture(options, "stand up", Robot.stand_up)


def lie(options: argparse.Namespace) -> int:
    """Lets it lie down."""
    return _posture(options, "lie down", Robot.lie_down)


def damp(options: argparse.Namespace) -> int:
    """Makes its legs go limp, whether it says anything or not."""
    try:
        with _connected(options, limp=True) as robot:
            robot.wait(1.0)
            _show(robot, options)
    except RobotTimeout as error:
        print(f"the order to go limp was sent, but nobody answered: {error}", file=sys.stderr)
        return 1
    return 0


def walk(options: argparse.Namespace) -> int:
    """Walks the infinity."""
    if options.view:
        from ..simulator.legs import viewer

        viewer.check()
    known = identifying.response(options)
    more = {"log": options.log, "overwrite": options.overwrite, "trim": options.trim}
    more |= {"start": START, "area": AREA, "speed_limit": options.speed}
    realtime = options.realtime or options.view or None
    with _connected(options, realtime=realtime, **more) as robot, _viewed(robot, options):
        result = walking.command(robot, options, known)
    walking.tell(options)
    return result


def identify(options: argparse.Namespace) -> int:
    """Lets it walk so that its log tells how it responds, and says that."""
    more = {"log": options.log, "overwrite": options.overwrite, "area": identifying.AREA}
    with _connected(options, speed_limit=options.speed, **more) as robot:
        result = identifying.command(robot, options)
    if result == 0:
        identifying.tell(options)
    return result


def replay(options: argparse.Namespace) -> int:
    """Plays a recorded run back."""
    rows = read_log(options.file)
    with connect(f"replay:{options.file}", realtime=options.realtime or None) as robot:
        while robot.now() < rows[-1].t - rows[0].t:
            _show(robot, options, sys.stdout.isatty())
            robot.wait(REFRESH)
    if options.picture:
        draw(rows, options.picture)
        print(f"picture: {options.picture}")
    return 0


COMMANDS: dict[str, Callable[[argparse.Namespace], int]] = {
    "status": status,
    "listen": listen,
    "stand": stand,
    "lie": lie,
    "damp": damp,
    "identify": identify,
    "walk": walk,
    "replay": replay,
}


def _connected(options: argparse.Namespace, **more) -> Robot:
    """The robot that the options name."""
    return connect(options.robot, options.level_flag, options.rate, ignore=options.ignore, **more)


def _viewed(robot: Robot, options: argparse.Namespace) -> contextlib.AbstractContextManager:
    """A window on the robot's body, where one is asked for."""
    if not options.view:
        return contextlib.nullcontext()
    from ..simulator.legs import viewer

    assert robot.simulator is not None  # options allow --view for sim:legs alone
    return viewer.shown(robot.simulator.dog)


def _posture(options: argparse.Namespace, what: str, do: Callable[[Robot], None]) -> int:
    """Announces a posture, asks, and lets it be taken."""
    with _connected(options) as robot:
        if not agreed(robot, options, f"{robot.address}: it will {what}."):
            return 1
        do(robot)
        robot.wait(1.0)
        _show(robot, options)
    return 0


def _show(robot: Robot, options: argparse.Namespace, live: bool = False) -> None:
    """Prints what is known of a robot."""
    told = describe(robot)
    text = as_json(told) if options.json else as_table(told)
    print(text if options.json else f"{HOME}{text}" if live else f"{text}\n", flush=True)


def _watch(robot: Robot, options: argparse.Namespace) -> None:
    """Shows the robot again and again; a pose that jumped is shown, and counted on from there."""
    end = float("inf") if options.seconds is None else robot.now() + options.seconds
    while robot.now() < end:
        _show(robot, options, sys.stdout.isatty())
        if robot.pilot.stopped:
            robot.go_on()
        robot.wait(REFRESH)


def _drive(robot: Robot, source: Source, options: argparse.Namespace) -> None:
    """Obeys the lines as they come; what cannot be obeyed is told, and drives nothing."""
    end = float("inf") if options.seconds is None else robot.now() + options.seconds
    told, shown = "", 0.0
    while robot.now() < end and not source.over:
        line = source.next(0.05)
        try:
            if line is not None:
                obey(robot, line)
                told = ""
        except (ValueError, RuntimeError, RobotTimeout) as error:
            if str(error) != told:  # once for a row of them
                print(told := str(error), file=sys.stderr, flush=True)
        if robot.now() - shown > REFRESH:
            shown = robot.now()
            _show(robot, options, sys.stdout.isatty())
            robot.wait(0.0)  # writes the log
