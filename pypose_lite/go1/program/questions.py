"""Whoever stands beside a real robot is asked before it moves."""

import argparse
import sys

from ..robot import Robot


def is_real(robot: Robot) -> bool:
    """Whether the robot lives outside of this program, and by the wall clock."""
    return robot.address.startswith("udp:")


def agreed(robot: Robot, options: argparse.Namespace, announcement: str) -> bool:
    """Whether the robot may move: it was announced, and nobody said no."""
    say(options, announcement)
    if options.yes or not is_real(robot):
        return True
    print("Do it? [y/N] ", end="", file=sys.stderr, flush=True)
    try:
        if input().strip().lower() in ("y", "yes"):
            return True
    except EOFError:
        say(options, "\nnobody answers; --yes does it without asking")
        return False
    say(options, "it does not move: you said no")
    return False


def say(options: argparse.Namespace, text: str) -> None:
    """Says something to people; where a program reads the output, beside it."""
    print(text, file=sys.stderr if options.json else sys.stdout, flush=True)
