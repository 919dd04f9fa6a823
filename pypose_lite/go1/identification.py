"""How a robot responds to commands, identified from its own log: dead band, delay, lag, drift.

`excite` lets a robot walk in pulses and turns, and `identify` fits to the log of it, for forward
speed and turn rate alike, a straight line behind a lag and a delay:

    lag ds/dt = u(t - delay) - s      (1)
    seen = gain s + drift      (2)

A command in the dead band starts no walk, so the lines hold above it. In turns a body also slides
to the left by `axle` metres a radian: it turns about a point so far behind its middle.

The fit is by least squares over a grid of lags and delays, as in Ljung, "System Identification"
(1999), section 7.2 (prediction errors of an output-error model). It needs no other package.
"""

import bisect
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from statistics import fmean, linear_regression, pvariance
from typing import TYPE_CHECKING, NamedTuple

from .log import Row
from .robot import Robot

if TYPE_CHECKING:  # torch is loaded when a model is asked for
    from ..systems import Legs

PULSE, REST = 1.2, 0.8  # s, of a motion from a stand, and of the stand after it
SPEEDS = tuple(k / 20 for k in range(1, 9))  # m/s, of pulses straight ahead
TURNS = tuple(k / 10 for k in range(1, 6))  # rad/s, of pulses on the spot
WALK = (  # s, share of the speed, rad/s: changes of both, in circles to its left, then its right
    *((1.5, 1.0, 0.8), (1.2, 0.6, 0.8), (1.4, 1.0, 0.4), (1.2, 0.8, 0.9), (1.5, 1.0, 0.6)),
    *((1.2, 0.6, 0.9), (1.0, 0.9, 0.0), (1.3, 1.0, 0.7), (1.2, 0.8, -0.6), (1.5, 1.0, -0.8)),
    *((1.2, 0.6, -0.8), (1.4, 1.0, -0.4), (1.2, 0.8, -0.9), (1.0, 0.9, -0.6), (1.5, 1.0, -0.9)),
)
SECONDS = sum(piece[0] for piece in WALK) + (len(SPEEDS) + len(TURNS)) * (PULSE + REST) + REST
FOLLOWED = 1 / 3  # the share of a pulse that has to be seen, for a robot that follows it
DELAYS = tuple(k / 50 for k in range(26))  # s, that are tried
LAGS = tuple(0.02 * 1.12**k for k in range(33))  # s, that are tried: 0.02 to 0.75
UNDER_WAY = PULSE + 0.1  # s of a walk that has left its start behind, and is no pulse
FEWEST, CHANGE = 100, 0.05  # rows of a walk that a fit needs; m/s and rad/s of change in them


@dataclass(frozen=True)
class Response:
    """How a robot answers commands; as it stands, one that does as it is told, a little late.

    Attributes:
        delay: s, from a command sent to a state that knows of it, there and back.
        lag: time constants of forward speed and turn rate, s.
        gain: m/s forward a m/s asked for, and rad/s a rad/s.
        drift: forward and left in m/s, and turn in rad/s, that are there unasked.
        axle: m, by which it slides to the left for each radian that it turns to the left.
        dead_band: m/s and rad/s; a slower pulse starts no walk, or no turn on the spot.
    """

    delay: float = 0.1
    lag: tuple[float, float] = (0.15, 0.15)
    gain: tuple[float, float] = (1.0, 1.0)
    drift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axle: float = 0.0
    dead_band: tuple[float, float] = (0.0, 0.0)

    @property
    def trim(self) -> tuple[float, float, float]:
        """What `connect(trim=)` has to add against the drift: m/s left and rad/s of turn.

        The forward drift is no such thing: a slower robot is not one that goes astray.
        """
        return 0.0, -self.drift[1], -self.drift[2] / self.gain[1]

    def model(self, dt: float) -> "Legs":
        """The response as a model to plan with, whose step takes `dt` seconds."""
        import torch

        from ..systems import Legs

        lag, gain = torch.tensor(self.lag), torch.tensor(self.gain)
        drift = torch.tensor([self.drift[0], self.drift[2]])
        return Legs(dt, lag=lag, gain=gain, drift=drift, axle=self.axle)


def excite(robot: Robot, speed: float = 0.5) -> None:
    """Lets a robot walk so that its log tells how it responds; takes `SECONDS` s.

    Pulses straight ahead and on the spot come first, each from a stand, and then a walk whose speed
    and turn change every second or so. It needs a free floor: 4 m ahead, 1 m behind, 2 m to each
    side.

    Args:
        robot: which stands, and writes a log (`connect(log=)`).
        speed: m/s, the greatest.

    Raises:
        ValueError: the speed is slower than the pulses are.
        RobotTimeout, RobotStopped, RuntimeError: as `Robot.move`.
    """
    if not speed >= SPEEDS[-1]:
        raise ValueError(f"speed: expected at least {SPEEDS[-1]:g} m/s, got {speed!r}")
    robot.stop()
    robot.wait(REST)
    for v, turn in (*((v, 0.0) for v in SPEEDS), *((0.0, turn) for turn in TURNS)):
        _hold(robot, PULSE, v, turn)
        robot.stop()
        robot.wait(REST)
    for seconds, share, turn in WALK:
        _hold(robot, seconds, share * speed, turn)
    robot.stop()


def identify(rows: Sequence[Row]) -> Response:
    """The response of the robot whose log this is.

    Args:
        rows: of a run that `excite` drove (`read_log`), or of another one that has pulses from a
            stand, and a walk with changes of speed and turn.

    Raises:
        ValueError: what the log lacks.
    """
    ahead = _dead_band("straight ahead", _pulses(rows, "command_v", "v"))
    spot = _dead_band("on the spot", _pulses(rows, "command_yaw_rate", "yaw_rate"))
    walks = _walking(rows, ahead)
    pairs = [
        (_fit(rows, walks, "v", delay), _fit(rows, walks, "yaw_rate", delay)) for delay in DELAYS
    ]
    delay, (forward, turn) = min(zip(DELAYS, pairs), key=lambda pair: sum(f.left for f in pair[1]))
    turns, slides = [rows[k].yaw_rate for k in walks], [rows[k].left for k in walks]
    axle, left = linear_regression(turns, slides)
    return Response(
        delay=delay,
        lag=(forward.lag, turn.lag),
        gain=(forward.gain, turn.gain),
        drift=(forward.drift, left, turn.drift),
        axle=axle,
        dead_band=(ahead, spot),
    )


class _Fit(NamedTuple):
    """A lag, a straight line, and the share of what was seen that they do not explain."""

    left: float
    lag: float
    gain: float
    drift: float


def _fit(rows: Sequence[Row], walks: Sequence[int], name: str, delay: float) -> _Fit:
    """The best lag and line for what was seen in the rows `walks`, with that delay."""
    times = [row.t for row in rows]
    asked = [getattr(row, f"command_{name}") for row in rows]
    late = [asked[max(bisect.bisect_right(times, t - delay) - 1, 0)] for t in times]
    seen = [getattr(rows[k], name) for k in walks]
    around = pvariance(seen)
    fits = []
    for lag in LAGS:
        follows = _behind_lag(times, late, lag)
        s = [follows[k] for k in walks]
        gain, drift = linear_regression(s, seen)
        errors = fmean((gain * x + drift - y) ** 2 for x, y in zip(s, seen))  # (2)
        fits.append(_Fit(errors / around, lag, gain, drift))
    return min(fits)


def _behind_lag(times: Sequence[float], asked: Sequence[float], lag: float) -> list[float]:
    """What a first-order lag makes of the commands, from rest."""
    follows = [0.0]
    for (before, now), u in zip(pairwise(times), asked[1:]):
        s = follows[-1]
        follows.append(u + math.exp((before - now) / lag) * (s - u))  # (1)
    return follows


def _walking(rows: Sequence[Row], slowest: float) -> list[int]:
    """The numbers of the rows in which it has walked for longer than in a pulse."""
    found, began = [], math.inf
    for k, row in enumerate(rows):
        began = min(began, row.t) if row.command_v > slowest else math.inf
        if row.t - began > UNDER_WAY:
            found.append(k)
    if len(found) < FEWEST:
        raise ValueError(f"rows: expected {FEWEST} of a walk, got {len(found)}: let it walk longer")
    for name in ("command_v", "command_yaw_rate"):
        asked = [getattr(rows[k], name) for k in found]
        if max(asked) - min(asked) < CHANGE:
            raise ValueError(f"rows: {name} hardly changes in the walk, so nothing can be fitted")
    return found


def _dead_band(where: str, pulses: Sequence[tuple[float, float]]) -> float:
    """Half way between the fastest pulse that was not followed and the next; 0 if all were."""
    still = [asked for asked, seen in pulses if seen < FOLLOWED * asked]
    if len(still) == len(pulses):
        raise ValueError(f"rows: of {len(pulses)} pulses {where} none was followed")
    faster = [asked for asked, _ in pulses if asked > max(still, default=math.inf)]
    if still and not faster:
        raise ValueError(f"rows: the fastest pulse {where}, of {still[-1]:g}, was not followed")
    return (max(still) + min(faster)) / 2 if still else 0.0


def _pulses(rows: Sequence[Row], command: str, seen: str) -> list[tuple[float, float]]:
    """Pulses from a stand along one axis alone: what was asked, and seen in the second half."""
    pieces = [[*piece] for _, piece in groupby(rows, key=_asked)]
    found = []
    for before, piece in pairwise(pieces):
        first, last = piece[0], piece[-1]
        asked = getattr(first, command)
        alone = asked > 0 and [*map(abs, _asked(first))].count(0.0) == 2
        if alone and not any(_asked(before[0])) and last.t - first.t > 0.8 * PULSE:
            values = [getattr(row, seen) for row in piece[len(piece) // 2 :]]
            found.append((asked, fmean(values)))
    return found


def _asked(row: Row) -> tuple[float, float, float]:
    """The motion that was going out: forward, left, turn."""
    return row.command_v, row.command_left, row.command_yaw_rate


def _hold(robot: Robot, seconds: float, v: float, turn: float) -> None:
    """Asks for a motion again and again, for so long."""
    for _ in range(round(seconds / 0.1)):
        robot.move(v, turn)
        robot.wait(0.1)
