"""The walk from the command line: what is announced, asked, told on the way, and at the end."""

import argparse
import math
import sys
import time
from typing import Any

from ..identification import Response
from ..log import read_log
from ..robot import Robot
from ..walk import AREA, LENGTH, STEP, draw, walk
from .description import as_json, describe
from .questions import agreed, is_real, say

WAYPOINTS = 17


def command(robot: Robot, options: argparse.Namespace, known: Response | None = None) -> int:
    """Announces, asks, walks and reports; returns the exit status."""
    if not options.stand_up and not _fit(robot, options):
        return 1
    from ... import control, infinity  # noqa: F401  (it takes seconds: not between yes and walking)

    if not agreed(robot, options, announcement(robot, options)):
        return 1
    if options.stand_up:
        robot.stand_up()
        robot.wait(1.0)
    if not _fit(robot, options):
        return 1
    progress, run = Progress(robot, options.json), None
    try:
        numbers = options.speed, options.delay, options.lag, progress
        run = walk(robot, *numbers, response=known, tolerance=options.tolerance)
    except (RuntimeError, TimeoutError) as error:
        say(options, f"\n{error}: zero velocity goes out")
    found = report(robot, progress, run)
    print(as_json(found) if options.json else as_text(found))
    return 0 if found["finished"] else 1


def announcement(robot: Robot, options: argparse.Namespace) -> str:
    """What will happen, in the numbers with which it will."""
    first = "It will stand up. " if options.stand_up else ""
    speed, seconds = options.speed, LENGTH / options.speed
    return (
        f"{robot.address}: battery {robot.state.bms.soc} %, state {robot.age:.2f} s old.\n"
        f"{first}It will walk an infinity of 4 m by 2 m, first around to its left, then to its\n"
        f"right, at {speed:g} m/s, for about {seconds:.0f} s. It needs a free floor: 3 m to each\n"
        f"side, 2 m ahead and behind. It is stopped when its middle is {AREA[1]:g} m to a side or\n"
        f"{AREA[3]:g} m ahead or behind, by Ctrl-C, and by any button of its remote (assumed)."
    )


def report(robot: Robot, progress: "Progress", run: Any) -> dict[str, Any]:
    """What became of the walk: waypoints, time, distance from the curve, late steps, events."""
    finished = run is not None and bool(run.finished)
    found = {
        "finished": finished,
        "waypoints": WAYPOINTS if finished else progress.waypoint,
        "seconds": robot.now() - progress.began,
        "simulated": not is_real(robot),
        "steps": progress.steps,
        "late": progress.late,
        "events": [(at - progress.began, text) for at, text in robot.events],
    }
    if run is not None:
        from ...infinity import tracking_error

        error = tracking_error(run.x)
        found |= {"mean_error": float(error.mean()), "largest_error": float(error.max())}
    return found


def as_text(found: dict[str, Any]) -> str:
    """A report in words."""
    clock = " of the robot's simulated time" if found["simulated"] else ""
    lines = [f"\n{found['waypoints']} of {WAYPOINTS} waypoints in {found['seconds']:.1f} s{clock}"]
    if "mean_error" in found:
        mean, largest = found["mean_error"], found["largest_error"]
        lines.append(f"off the curve, as the robot believes: {mean:.3f} m, at most {largest:.3f} m")
    slow = ": this computer plans too slowly" if found["late"] else ""
    lines.append(f"{found['late']} of {found['steps']} steps came late{slow}")
    lines += [f"at {at:.1f} s: {text}" for at, text in found["events"]] or ["no events"]
    return "\n".join(lines)


def tell(options: argparse.Namespace) -> None:
    """Says what the walk has left behind."""
    say(options, f"log: {options.log}")
    if options.picture:
        draw(read_log(options.log), options.picture)
        say(options, f"picture: {options.picture}")


class Progress:
    """Says how the walk goes: one line that is rewritten, or a line for every waypoint."""

    def __init__(self, robot: Robot, json: bool = False) -> None:
        self._robot, self._json = robot, json
        self._live = sys.stdout.isatty() and not json
        self._paced = is_real(robot)  # whether a step that takes long is late
        self._before, self.began = math.inf, robot.now()
        self.waypoint = self.late = self.steps = 0

    def __call__(self, waypoint: int) -> None:
        """Called in every step with the number of the next waypoint."""
        now = time.monotonic()
        self.late += self._paced and now - self._before > 1.5 * STEP
        self._before, self.steps = now, self.steps + 1
        if not self._live and waypoint == self.waypoint:
            return
        self.waypoint = waypoint
        if self._json:
            print(as_json(describe(self._robot) | {"waypoint": waypoint}), flush=True)
        else:
            text = self._line()
            print(f"\r{text}" if self._live else text, end="" if self._live else "\n", flush=True)

    def _line(self) -> str:
        """Where the robot is, in a line."""
        (x, y, heading), state = self._robot.pose(), self._robot.state
        bar = "#" * self.waypoint + "." * (WAYPOINTS - self.waypoint)
        return (
            f"[{bar}] waypoint {self.waypoint + 1:2d} of {WAYPOINTS}   x {x:+.2f} m  y {y:+.2f} m  "
            f"heading {math.degrees(heading):+4.0f} deg  v {state.velocity[0]:+.2f} m/s  "
            f"battery {state.bms.soc} %  age {1000 * self._robot.age:3.0f} ms"
        )


def _fit(robot: Robot, options: argparse.Namespace) -> bool:
    """Whether it may walk; if not, that is said."""
    if reasons := robot.reasons_to_stay():
        say(options, "it does not walk: " + "; ".join(reasons))
    return not reasons
