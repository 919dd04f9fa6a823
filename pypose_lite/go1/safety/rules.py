"""The rules by which a walk is stopped: pure functions of what was seen and asked, and when.

Each returns why the robot has to stop, in words, or None. `Pilot` asks them for every new state
while a motion goes out. Their names, for whoever has to do without one: "jump", "area", "motion",
"lean", "posture", "battery", "remote".

Every limit here is assumed: none was tried on a robot. They are wide, so that a bad network, a
slow start and a little slip are no reason to stop, and a robot that does something else is.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from ..wire.protocol import HIGH_LEVEL, HighState, model
from ..wire.remote import decode_remote
from .limits import Mode

NAMES = ("jump", "area", "motion", "lean", "posture", "battery", "remote")

Pose = tuple[float, float, float]  # x and y in m, heading in rad
Motion = tuple[float, float, float]  # forward and left in m/s, turn in rad/s
Area = tuple[float, float, float, float]  # least and greatest x, least and greatest y, m

JUMP, FASTEST = 0.25, 3.5  # m, m/s: how far a pose may be from the last one
TWIST, FASTEST_TURN = 0.5, 4.0  # rad, rad/s: likewise
WINDOW = 1.0  # s, for which motion asked and motion seen have to part
LATENCY = 0.6  # s, by which what is seen may be behind what was asked
PATIENCE = 2.0  # s, for which a robot may be told to move and not move
TILT = 0.6  # rad of roll or pitch: on its way to fall, or fallen
UPRIGHT, TALLEST = 0.2, 0.4  # m, the body's height between lying, standing, and held up
LOWEST_CHARGE = 20  # %
MODES = {Mode.IDLE, Mode.STAND, Mode.WALK}  # what a robot that walks may call what it does
SETTLING = 1.0  # s, that it may take to get to such a mode


class Moment(NamedTuple):
    """What was asked and seen at a time."""

    time: float
    asked: Motion
    pose: Pose


def jumped(before: Pose, after: Pose, seconds: float) -> str | None:
    """A change of the pose that no dog can make: the odometry restarted, or a stranger speaks."""
    way = math.dist(before[:2], after[:2])
    turn = abs(math.remainder(after[2] - before[2], 2 * math.pi))
    if way <= JUMP + FASTEST * seconds and turn <= TWIST + FASTEST_TURN * seconds:
        return None
    return (
        f"the pose jumped by {way:.2f} m and {math.degrees(turn):.0f} degrees "
        f"in {seconds:.2f} s, as no dog can"
    )


def left_area(pose: Pose, area: Area | None) -> str | None:
    """A robot that is not where it was announced to be."""
    if area is None:
        return None
    x, y, _ = pose
    if area[0] <= x <= area[1] and area[2] <= y <= area[3]:
        return None
    return f"it left the area: x {x:.2f} m, y {y:.2f} m"


def leans(state: HighState) -> str | None:
    """A body that is about to fall, or has fallen."""
    roll, pitch, _ = state.imu.rpy
    if max(abs(roll), abs(pitch)) <= TILT:
        return None
    degrees = f"{math.degrees(roll):.0f} and {math.degrees(pitch):.0f} degrees"
    return f"it leans, roll and pitch {degrees}: has it fallen?"


def not_walking(state: HighState, seconds: float) -> str | None:
    """A mode or a height of the body that is not walking's, `seconds` after the first motion."""
    if state.mode in (Mode.DAMP, Mode.LIE_DOWN) or (state.mode not in MODES and seconds > SETTLING):
        name = Mode(state.mode).name if state.mode in list(Mode) else "unknown"
        return f"its mode is {state.mode} ({name}), set by another program or its remote"
    if not UPRIGHT <= state.body_height <= TALLEST:
        does = "lies" if state.body_height < UPRIGHT else "does not stand on the floor"
        return f"the body is {state.body_height:.2f} m above the ground: it {does}"
    return None


def battery_low(state: HighState) -> str | None:
    """A battery that may not last; 0 % may also be one whose board is silent."""
    if state.bms.soc >= LOWEST_CHARGE:
        return None
    silent = " (or its board is silent)" if state.bms.soc == 0 else ""
    return f"the battery is at {state.bms.soc} %{silent}, below {LOWEST_CHARGE} %"


def remote_used(state: HighState) -> str | None:
    """Somebody presses a button of the remote: whoever holds it has the last word."""
    buttons = decode_remote(state.wireless_remote).buttons
    return f"the remote's {' and '.join(buttons)} is pressed" if buttons else None


def wrong_flag(state: HighState, level_flag: int) -> str | None:
    """A level flag that the model, by its serial number, does not take: it will not move."""
    name = model(state)
    if name in ("Air", "Pro") and level_flag == HIGH_LEVEL:
        return f"this is a Go1 {name}, which takes level_flag=0x00, not 0xEE"
    return None


def disagrees(moments: Sequence[Moment]) -> str | None:
    """Motion asked and motion seen have parted for `WINDOW` seconds.

    What is seen may lie anywhere between the least and the greatest of what was asked lately, and
    beside that by a share of it and a little more: gaits turn where they should not. A trained one,
    in simulation, turned by 0.15 rad/s when told to go straight on, by 0.3 when told 0.1.
    """
    lately, window = _last(moments, WINDOW + LATENCY), _last(moments, WINDOW)
    if not lately or len(window) < 2:
        return None
    seen = seen_motion(window)
    forward, left, turn = zip(*(moment.asked for moment in lately))
    speed = max(math.hypot(f, s) for f, s in zip(forward, left))
    margins = 0.1 + 0.5 * speed, 0.1 + 0.5 * speed, 0.25 + 0.25 * max(map(abs, turn))
    names = ("forward", "m/s"), ("left", "m/s"), ("turn", "rad/s")
    for (name, unit), asked, margin, value in zip(names, (forward, left, turn), margins, seen):
        if not min(asked) - margin <= value <= max(asked) + margin:
            mean = sum(asked) / len(asked)
            return f"{name}: asked for {mean:.2f} {unit}, seen {value:.2f} {unit} for a second"
    return None


def why_still(state: HighState, level_flag: int) -> str:
    """What may keep a robot that speaks from moving, the usual cause first."""
    flag = wrong_flag(state, level_flag) or f"level_flag={level_flag:#04x} may not be its model's"
    others = "another program or the app may command it", "the speed may be too small to walk"
    return "; ".join((flag, *others))


def does_not_move(moments: Sequence[Moment]) -> str | None:
    """Told to move for `PATIENCE` seconds, it is where it was."""
    lately = _last(moments, PATIENCE)
    if not lately:
        return None
    way = PATIENCE * min(math.hypot(*moment.asked[:2]) for moment in lately)
    turn = PATIENCE * min(abs(moment.asked[2]) for moment in lately)
    first, last = lately[0].pose, lately[-1].pose
    turned = abs(math.remainder(last[2] - first[2], 2 * math.pi))
    if max(way, turn) < 0.1 or math.dist(first[:2], last[:2]) > 0.1 * way + 0.01:
        return None
    if turned > 0.1 * turn + 0.02:
        return None
    return f"told to move for {PATIENCE:g} s, it does not"


def seen_motion(moments: Sequence[Moment]) -> Motion:
    """The mean motion over those moments, as the body sees it: forward, left, turn."""
    forward = left = turn = 0.0
    for before, after in zip(moments, moments[1:]):
        turned = math.remainder(after.pose[2] - before.pose[2], 2 * math.pi)
        heading = before.pose[2] + turned / 2
        dx, dy = after.pose[0] - before.pose[0], after.pose[1] - before.pose[1]
        forward += math.cos(heading) * dx + math.sin(heading) * dy
        left += math.cos(heading) * dy - math.sin(heading) * dx
        turn += turned
    seconds = moments[-1].time - moments[0].time
    return forward / seconds, left / seconds, turn / seconds


def _last(moments: Sequence[Moment], seconds: float) -> list[Moment]:
    """The moments of the last so many seconds; none while they do not reach back so far."""
    end = moments[-1].time if moments else 0.0
    found = [moment for moment in moments if moment.time >= end - seconds - 1e-9]
    return found if len(found) < len(moments) else []
