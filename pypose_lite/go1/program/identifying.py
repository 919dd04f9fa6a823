"""How a robot responds, from the command line: it walks to be identified, and the numbers are told.

A walk that knows them plans better: `walk --identified LOG`. A simulated dog with legs is
identified before it walks, in a run of its own, as that costs nothing.
"""

import argparse
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory

from ..connection import connect
from ..identification import SECONDS, Response, excite, identify
from ..log import read_log
from ..robot import Robot
from .description import as_json
from .questions import agreed, say

AREA = (-2.0, 4.5, -2.5, 2.5)  # m, which it may not leave while it is identified


def command(robot: Robot, options: argparse.Namespace) -> int:
    """Announces, asks, and lets the robot walk so that its log tells how it responds."""
    if reasons := robot.reasons_to_stay():
        say(options, "it does not walk: " + "; ".join(reasons))
        return 1
    if not agreed(robot, options, announcement(robot, options)):
        return 1
    excite(robot, options.speed)
    return 0


def announcement(robot: Robot, options: argparse.Namespace) -> str:
    """What will happen, in the numbers with which it will."""
    return (
        f"{robot.address}: battery {robot.state.bms.soc} %, state {robot.age:.2f} s old.\n"
        f"It will walk ahead in pulses, turn on the spot, and walk in circles, at up to\n"
        f"{options.speed:g} m/s, for about {SECONDS:.0f} s. It needs a free floor: "
        f"{AREA[1]:g} m ahead, {-AREA[0]:g} m behind,\n"
        f"{AREA[3]:g} m to each side; beyond that it is stopped."
    )


def tell(options: argparse.Namespace) -> None:
    """Says how the robot of the log responds."""
    found = identify(read_log(options.log))
    print(as_json(asdict(found)) if options.json else as_text(found))
    say(options, f"log: {options.log} (walk --identified plans with it)")


def as_text(found: Response) -> str:
    """A response in words."""
    (forward, left, turn), trim = found.drift, ",".join(f"{more:.3f}" for more in found.trim)
    return (
        f"delay     {found.delay:.2f} s\n"
        f"lag       {found.lag[0]:.2f} s forward, {found.lag[1]:.2f} s in turns\n"
        f"dead band {found.dead_band[0]:.3f} m/s, {found.dead_band[1]:.2f} rad/s on the spot\n"
        f"gain      {found.gain[0]:.2f} forward, {found.gain[1]:.2f} in turns\n"
        f"drift     {forward:.3f} m/s forward, {left:.3f} m/s left, {turn:.3f} rad/s\n"
        f"axle      {found.axle:.3f} m behind its middle\n"
        f"trim      {trim} (against the drift)"
    )


def response(options: argparse.Namespace) -> Response | None:
    """What a walk is to plan with, or None where nothing but --delay and --lag is known."""
    if options.identified is not None:
        return identify(read_log(options.identified))
    if options.robot != "sim:legs":
        return None
    say(options, "how a dog with legs responds is identified first, in a run of its own")
    with TemporaryDirectory() as folder:
        log = Path(folder) / "identified.csv"
        with connect(options.robot, options.level_flag, options.rate, log=log) as robot:
            excite(robot)
        return identify(read_log(log))
