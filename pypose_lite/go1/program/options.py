"""What `python -m pypose_lite.go1` takes; everything is checked before a robot hears of it."""

import argparse
import math
import time
from collections.abc import Sequence
from pathlib import Path

PICTURES = (".png", ".pdf", ".svg", ".jpg")
WHAT = {
    "status": "what the robot says of itself, once",
    "listen": "what it says, until Ctrl-C; drives it for another program with --cmd-vel",
    "stand": "let it stand up",
    "lie": "let it lie down",
    "damp": "the emergency: the legs go limp and it sinks, at once and without a question",
    "identify": "walk in pulses and circles, and say how it responds to commands",
    "walk": "walk the infinity",
    "replay": "play a recorded walk back",
}


def parsed(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """The options of a command; what does not fit ends the program with a line."""
    parser = argparse.ArgumentParser(
        prog="python -m pypose_lite.go1",
        description="Speaks to a Go1, or to a simulated one. Nothing here was tried on a robot.",
    )
    commands = parser.add_subparsers(required=True, dest="command", metavar="command")
    for name, what in WHAT.items():
        command = commands.add_parser(
            name, help=what, formatter_class=argparse.ArgumentDefaultsHelpFormatter
        )
        _ADD[name](command)
    options = parser.parse_args(arguments)
    _check(parser, options)
    return options


def _line(command: argparse.ArgumentParser) -> None:
    """Options of every command that speaks to a robot."""
    add = command.add_argument
    add("--robot", default="sim", help="sim, sim:legs, udp://host:port, or replay:run.csv")
    add("--level-flag", type=_flag, default=0xEE, help="0 for an Air or a Pro")
    add("--rate", type=_between(100, 500), default=200.0, help="commands a second")
    add("--ignore", nargs="+", default=[], metavar="RULE", help="safety rules to do without")
    _form(command)


def _form(command: argparse.ArgumentParser) -> None:
    command.add_argument("--json", action="store_true", help="for other programs: JSON, by lines")


def _moves(command: argparse.ArgumentParser) -> None:
    """Options of commands that move a robot."""
    _line(command)
    command.add_argument("--yes", action="store_true", help="move a robot on UDP without asking")


def _listens(command: argparse.ArgumentParser) -> None:
    _moves(command)
    add = command.add_argument
    add("--seconds", type=_between(0, math.inf), help="end after so long")
    add("--log", help="file to write the run to")
    add("--overwrite", action="store_true", help="the file may be there, and is lost")
    add("--cmd-vel", metavar="FROM", help='lines {"v": 0.2, "yaw_rate": 0, "left": 0} to drive by: '
        "- for standard input, or a UDP port of this computer")  # fmt: skip
    add("--speed-limit", type=_between(0.0, 3.5), default=0.5, help="m/s")
    add("--trim", type=_numbers(3), default=(0.0, 0.0, 0.0), help="m/s, m/s, rad/s; see walk")
    add("--area", type=_numbers(4), help="m: least x, most x, least y, most y, from its start")


def _identifies(command: argparse.ArgumentParser) -> None:
    _moves(command)
    add = command.add_argument
    add("--speed", type=_between(0.4, 1.0), default=0.5, help="m/s, the greatest")
    add("--log", default=time.strftime("identify-%Y%m%d-%H%M%S.csv"), help="file to write it to")
    add("--overwrite", action="store_true", help="the file may be there, and is lost")


def _walks(command: argparse.ArgumentParser) -> None:
    _moves(command)
    add, stem = command.add_argument, time.strftime("walk-%Y%m%d-%H%M%S")
    add("--speed", type=_between(0.05, 1.0), default=0.4, help="m/s, along the curve")
    add("--delay", type=_between(0, 1), default=0.1, help="s, from a motion sent to a pose with it")
    add("--lag", type=_between(0.01, 1), default=0.15, help="s, with which its legs follow")
    add("--trim", type=_numbers(3), default=(0.0, 0.0, 0.0),
        help="added to every motion, against drift: m/s forward, m/s left, rad/s")  # fmt: skip
    add("--identified", metavar="LOG", help="log of identify: how it responds, instead of --delay "
        "and --lag; sim:legs is identified first where there is none")  # fmt: skip
    add("--tolerance", type=_between(0.02, 0.5), default=0.1, help="m, to reach a waypoint")
    add("--view", action="store_true", help="open MuJoCo's viewer on sim:legs, in real time")
    add("--stand-up", action="store_true", help="let it stand up first, after the question")
    add("--realtime", action="store_true", help="let a simulated robot live by the wall clock")
    add("--log", default=f"{stem}.csv", help="file to write the run to")
    add("--overwrite", action="store_true", help="the file may be there, and is lost")
    add("--picture", default=f"{stem}.png", help="file to draw the run to")
    add("--no-picture", dest="picture", action="store_const", const=None, help="draw nothing")


def _replays(command: argparse.ArgumentParser) -> None:
    command.add_argument("file", help="a log that walk or listen wrote")
    command.add_argument("--realtime", action="store_true", help="as fast as it happened")
    command.add_argument("--picture", help="file to draw the run to")
    _form(command)


_ADD = {
    "status": _line,
    "listen": _listens,
    "stand": _moves,
    "lie": _moves,
    "damp": _line,
    "identify": _identifies,
    "walk": _walks,
    "replay": _replays,
}


def _check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Ends the program where an option could fail only after a robot has moved."""
    if picture := getattr(options, "picture", None):
        from importlib.util import find_spec

        if find_spec("matplotlib") is None:
            parser.error(
                "the picture needs matplotlib: pip install 'pypose_lite[book]', or --no-picture"
            )
        if Path(picture).suffix.lower() not in PICTURES:
            parser.error(f"--picture: expected a name that ends in {PICTURES}, got {picture!r}")
    for name in ("picture", "log"):
        path = getattr(options, name, None)
        if path and not Path(path).absolute().parent.is_dir():
            parser.error(f"--{name}: there is no folder for {path!r}")
        if path and Path(path).is_dir():
            parser.error(f"--{name}: {path!r} is a folder")
    if getattr(options, "view", False) and options.robot != "sim:legs":
        parser.error(f"--view: only --robot sim:legs has a body to look at, got {options.robot!r}")
    source = getattr(options, "cmd_vel", None)
    if source not in (None, "-") and not (source.isdecimal() and 0 < int(source) < 65536):
        parser.error(f"--cmd-vel: expected - or a port, got {source!r}")


def _flag(text: str) -> int:
    """A level flag, 0xEE or 0."""
    value = int(text, 0)
    if value not in (0, 0xEE):
        raise argparse.ArgumentTypeError(f"expected 0xEE or 0, got {text}")
    return value


def _between(low: float, high: float):  # noqa: ANN202
    """A type of options: numbers from low to high, finite."""

    def number(text: str) -> float:
        value = float(text)
        if not (low <= value <= high and math.isfinite(value)):
            raise argparse.ArgumentTypeError(f"expected {low:g} to {high:g}, got {text}")
        return value

    return number


def _numbers(count: int):  # noqa: ANN202
    """A type of options: so many finite numbers with commas between them."""

    def numbers(text: str) -> tuple[float, ...]:
        values = tuple(map(float, text.split(",")))
        if len(values) != count or not all(map(math.isfinite, values)):
            raise argparse.ArgumentTypeError(f"expected {count} numbers with commas, got {text}")
        return values

    return numbers
