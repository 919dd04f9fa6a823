"""Which commands may go to the robot: its modes, its gaits and their limits.

Source: the vendor's header and documentation; the vendor's SDK itself clamps nothing.
"""

import math
from dataclasses import fields, replace
from enum import IntEnum

from ..wire.protocol import HighCmd


class Mode(IntEnum):
    """What the robot is asked to do; 3, 4 and 9 are reserved, 10 to 13 are stunts: never sent."""

    IDLE = 0
    STAND = 1  # leaning by `euler` and `body_height`
    WALK = 2  # by `velocity` and `yaw_speed`
    LIE_DOWN = 5
    STAND_UP = 6
    DAMP = 7  # the legs go limp and the robot sinks
    RECOVER = 8  # gets up after a fall


class Gait(IntEnum):
    """How it walks; the limits of gait 4, over obstacles, are not documented: never sent."""

    IDLE = 0
    TROT = 1
    RUN = 2
    STAIRS = 3


# forward m/s, left m/s, counter-clockwise rad/s
SPEEDS = {
    Gait.IDLE: ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0)),
    Gait.TROT: ((-1.1, 1.5), (-1.0, 1.0), (-4.0, 4.0)),
    Gait.RUN: ((-2.5, 3.5), (-1.0, 1.0), (-4.0, 4.0)),
    Gait.STAIRS: ((-0.2, 0.25), (-0.15, 0.15), (-0.7, 0.7)),
}
EULER = ((-0.75, 0.75), (-0.75, 0.75), (-0.6, 0.6))  # rad: roll, pitch, yaw
BODY_HEIGHT = (-0.13, 0.03)  # m, a change of it
FOOT_RAISE_HEIGHT = (-0.06, 0.03)  # m, a change of it
NUMBERS = ("velocity", "yaw_speed", "euler", "body_height", "foot_raise_height")
FREE = ("level_flag", "mode", "gait_type", *NUMBERS)  # every other field is reserved


def vet(command: HighCmd) -> tuple[HighCmd, list[str]]:
    """A command that may be sent, and what had to be clamped for it.

    Raises:
        ValueError: a reserved mode or gait, a reserved field that is not zero, the battery's off
            switch, NaN or infinity.
    """
    _refuse(command)
    notes: list[str] = []
    forward, left, turn = SPEEDS[Gait(command.gait_type)]

    def clamp(name: str, value: float, limits: tuple[float, float]) -> float:
        low, high = limits
        held = min(max(value, low), high)
        if held != value:
            notes.append(f"{name}: {value:g} clamped to {held:g}")
        return held

    def clamps(name: str, values: tuple, limits: tuple) -> tuple:
        pairs = enumerate(zip(values, limits, strict=True))
        return tuple(clamp(f"{name}[{i}]", value, limit) for i, (value, limit) in pairs)

    held = replace(
        command,
        velocity=clamps("velocity", command.velocity, (forward, left)),
        yaw_speed=clamp("yaw_speed", command.yaw_speed, turn),
        euler=clamps("euler", command.euler, EULER),
        body_height=clamp("body_height", command.body_height, BODY_HEIGHT),
        foot_raise_height=clamp("foot_raise_height", command.foot_raise_height, FOOT_RAISE_HEIGHT),
    )
    return held, notes


def slower(command: HighCmd, limit: float) -> HighCmd:
    """The same arc, walked no faster than `limit` m/s: speed and turn shrink together."""
    speed = math.hypot(*command.velocity)
    if not speed > limit * (1 + 1e-6):  # a packet's numbers are no more precise
        return command
    velocity = tuple(v * limit / speed for v in command.velocity)
    return replace(command, velocity=velocity, yaw_speed=command.yaw_speed * limit / speed)


def motion(command: HighCmd) -> tuple[float, float, float]:
    """The motion that a command asks for: forward and left in m/s, turn in rad/s."""
    return (*command.velocity, command.yaw_speed)


def trimmed(command: HighCmd, trim: tuple[float, float, float]) -> HighCmd:
    """The same motion with `trim` added, against a robot that drifts; a stand stays a stand."""
    if not any(motion(command)):
        return command
    forward, left, turn = (asked + more for asked, more in zip(motion(command), trim))
    return replace(command, velocity=(forward, left), yaw_speed=turn)


def still(command: HighCmd) -> HighCmd:
    """The same command at zero velocity: what goes out when nobody renews it."""
    return replace(command, velocity=(0.0, 0.0), yaw_speed=0.0)


def settled(command: HighCmd) -> HighCmd:
    """What goes out when zero velocity has ended a walk: a stand. Other modes stay as they are."""
    if command.mode != Mode.WALK:
        return still(command)
    return HighCmd(level_flag=command.level_flag, mode=Mode.STAND)


def _refuse(command: HighCmd) -> None:
    """Raises ValueError where a command must not reach a robot at all."""
    for name, number, known in (
        ("mode", command.mode, Mode),
        ("gait_type", command.gait_type, Gait),
    ):
        if number not in list(known):
            raise ValueError(f"{name}: expected one of {[*map(int, known)]}, got {number!r}")
    blank = HighCmd()
    for name in (f.name for f in fields(command) if f.name not in FREE):
        value = getattr(command, name)
        if value != getattr(blank, name):
            raise ValueError(f"{name}: reserved, must stay {getattr(blank, name)!r}, got {value!r}")
    for name in NUMBERS:
        value = getattr(command, name)
        numbers = value if isinstance(value, tuple | list) else (value,)
        if not all(math.isfinite(number) for number in numbers):
            raise ValueError(f"{name}: expected finite numbers, got {value!r}")
