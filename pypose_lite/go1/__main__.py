"""`python -m pypose_lite.go1 walk --robot udp://127.0.0.1:8082`: walks the infinity."""

import argparse
import importlib.util
import math
import sys
import time
from collections.abc import Sequence

from . import RobotTimeout, connect, read_log
from .robot import Robot
from .walk import START, STEP, Stuck, draw, walk


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command and returns the program's exit status."""
    options = _parser().parse_args(arguments)
    if options.picture and importlib.util.find_spec("matplotlib") is None:
        print("the picture needs matplotlib: pip install 'pypose_lite[book]', or --no-picture")
        return 2
    try:
        with _connected(options) as robot:
            status = _walk(robot, options)
    except (RobotTimeout, ValueError, OSError) as error:
        print(f"\n{error}")
        return 1
    if status is None:
        return 1
    _tell(options)
    return status


def _connected(options: argparse.Namespace) -> Robot:
    realtime = True if options.realtime else None
    return connect(
        options.robot,
        options.level_flag,
        options.rate,
        speed_limit=options.speed_limit,
        start=START,
        log=options.log,
        realtime=realtime,
    )


def _walk(robot: Robot, options: argparse.Namespace) -> int | None:
    """The exit status of a walk, or None if there was none."""
    if options.stand_up:
        robot.stand_up()
    if not _agreed(robot, options):
        return None
    progress, begun = Progress(robot), time.monotonic()
    try:
        run = walk(robot, 0.8 * options.speed_limit, options.delay, progress)
    except KeyboardInterrupt:
        print("\nstopped")
        return 130
    except (RobotTimeout, Stuck) as error:
        print(f"\n{error}: zero velocity goes out")
        return 1
    finished = bool(run.finished)
    reached = 17 if finished else int(run.goal[-1])
    print(f"\n{reached} of 17 waypoints in {time.monotonic() - begun:.1f} s")
    if progress.late and (options.realtime or robot.address.startswith("udp:")):
        print(f"{progress.late} steps came late: this computer plans too slowly for the loop")
    return 0 if finished else 1


def _agreed(robot: Robot, options: argparse.Namespace) -> bool:
    """Whether the robot may walk: it is fit, and who stands beside it has been asked."""
    if reasons := robot.reasons_to_stay():
        print("it does not walk: " + "; ".join(reasons))
        return False
    seconds = 4 * math.pi / (0.8 * options.speed_limit)
    print(
        f"{robot.address}: battery {robot.state.bms.soc} %, state {robot.age:.2f} s old.\n"
        f"It will walk an infinity of 4 m by 2 m, first around to its left, then to its right,\n"
        f"at up to {options.speed_limit:g} m/s, for about {seconds:.0f} s. It needs a free floor:\n"
        f"3 m to each side, 2 m ahead and behind. Ctrl-C stops it."
    )
    if options.yes or not robot.address.startswith("udp:"):
        return True
    try:
        agreed = input("Walk? [y/N] ").strip().lower() in ("y", "yes")
    except EOFError:
        print("\nnobody answers; --yes walks without asking")
        return False
    reasons = robot.reasons_to_stay() if agreed else ["you said no"]
    if reasons:
        print("it does not walk: " + "; ".join(reasons))
    return not reasons


class Progress:
    """Says how the walk goes: one line that is rewritten, or a line for every waypoint."""

    def __init__(self, robot: Robot) -> None:
        self._robot, self._waypoint, self._live = robot, 0, sys.stdout.isatty()
        self._before, self.late = math.inf, 0  # the time of the last step; how many were late

    def __call__(self, waypoint: int) -> None:
        """Called in every step with the number of the next waypoint."""
        now = time.monotonic()
        self.late += now - self._before > 1.5 * STEP
        self._before = now
        if not self._live and waypoint == self._waypoint:
            return
        self._waypoint = waypoint
        (x, y, heading), state = self._robot.pose(), self._robot.state
        bar = "#" * waypoint + "." * (17 - waypoint)
        line = (
            f"[{bar}] waypoint {waypoint + 1:2d} of 17   x {x:+.2f} m  y {y:+.2f} m  "
            f"heading {math.degrees(heading):+4.0f} deg  v {state.velocity[0]:+.2f} m/s  "
            f"battery {state.bms.soc} %  age {1000 * self._robot.age:3.0f} ms"
        )
        print(f"\r{line}" if self._live else line, end="" if self._live else "\n", flush=True)


def _tell(options: argparse.Namespace) -> None:
    """Says what the walk has left behind."""
    print(f"log: {options.log}")
    if options.picture:
        draw(read_log(options.log), options.picture)
        print(f"picture: {options.picture}")


def _parser() -> argparse.ArgumentParser:
    """What `python -m pypose_lite.go1` takes."""
    parser = argparse.ArgumentParser(prog="python -m pypose_lite.go1", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="walk")
    command = commands.add_parser(
        "walk",
        help="walk the infinity",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    add, stem = command.add_argument, time.strftime("walk-%Y%m%d-%H%M%S")
    add("--robot", default="sim", help="sim, udp://host:port, or replay:run.csv")
    add("--level-flag", type=lambda text: int(text, 0), default=0xEE, help="0 for an Air or a Pro")
    add("--rate", type=float, default=200.0, help="commands a second")
    add("--speed-limit", type=float, default=0.5, help="m/s")
    add("--delay", type=float, default=0.2, help="s, from a motion sent to a pose that shows it")
    add("--stand-up", action="store_true", help="stand up first")
    add("--realtime", action="store_true", help="let a simulated robot live by the wall clock")
    add("--yes", action="store_true", help="walk a robot on UDP without asking")
    add("--log", default=f"{stem}.csv", help="file to write the run to")
    add("--picture", default=f"{stem}.png", help="file to draw the run to")
    add("--no-picture", dest="picture", action="store_const", const=None, help="draw nothing")
    return parser


if __name__ == "__main__":
    sys.exit(main())
