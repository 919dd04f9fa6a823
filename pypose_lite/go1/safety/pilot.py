"""The safety rules: what goes out now, and whether what came in is fresh.

No socket, no clock and no thread of its own: the caller says what time it is. Those who ask share
a lock. The one who sends and hears needs none, so that nobody can hold it up: whatever it reads
is written in one assignment.
"""

import math
import threading
from collections import deque
from dataclasses import replace

from ..wire.protocol import (
    HIGH_LEVEL,
    HighCmd,
    HighState,
    ProtocolError,
    decode_state,
    encode_command,
)
from .limits import Mode, slower, still, vet

REMEMBERED = 32  # contents of states, 0.6 s of them: one that comes again is old, not news


class RobotTimeout(TimeoutError):
    """Nothing new has been heard of the robot: its state is too old to act on."""


class Pilot:
    """Between the one who asks for a motion and the one who sends it.

    - A command that is not renewed becomes zero velocity before `timeout` seconds have passed.
    - So does any command once the state is that old. It is not taken up again by itself.
    - A state is as old as its content: the same bytes again, late or repeated for ever by a
      robot that hangs, are not news. (A robot that stands still has noise in its sensors.)

    Args:
        level_flag: of the commands; 0x00 for an Air or a Pro.
        timeout: s, after which a command expires and a state is stale.
        margin: s, by which a command expires earlier, so that zero is out in time.
        speed_limit: m/s, or None for the limits of the gait alone.
        start: (x, y, heading) in m and rad, what `pose` says where the robot first stood.

    Attributes:
        origin: the odometry's (x, y, heading) there.
        events: the latest (time, text) of all that went another way than asked.
        news: how many states with a new content were heard.
        refused: how many datagrams were no good state.
    """

    def __init__(
        self,
        level_flag: int = HIGH_LEVEL,
        timeout: float = 0.4,
        margin: float = 0.0,
        speed_limit: float | None = None,
        start: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        self.level_flag, self.timeout, self.speed_limit = level_flag, timeout, speed_limit
        self.start, self.origin = start, (0.0, 0.0, 0.0)
        self.events: deque[tuple[float, str]] = deque(maxlen=1000)
        self.news = self.refused = 0
        self._patience = timeout - margin
        self._lock = threading.Lock()  # of those who ask
        self._asked = (HighCmd(level_flag=level_flag), -math.inf)
        self._notes: list[str] = []
        self._over = False
        self._heard: tuple[HighState, float] | None = None  # from here on: of who sends and hears
        self._recent: deque[bytes] = deque(maxlen=REMEMBERED)
        self._stale_at = -math.inf  # when the state was last seen stale
        self._held = False  # whether a motion is being held back

    def ask(self, command: HighCmd, now: float) -> HighCmd:
        """The command that goes out from now on, clamped to the limits; `events` says where.

        Raises:
            RobotTimeout: the state is stale.
            RuntimeError: the robot is closed, or it lies or is limp and has to stand up first.
            ValueError: see `limits.vet`.
        """
        with self._lock:
            self._may_ask(command.mode)
            self.state(now)
            command, notes = replace(command, level_flag=self.level_flag), []
            slow = command if self.speed_limit is None else slower(command, self.speed_limit)
            if slow != command:
                notes.append(f"speed: held to the limit of {self.speed_limit:g} m/s")
            held, clamped = vet(slow)
            encode_command(held)  # what does not fit is refused here, not in the sender's thread
            self._asked = held, now
            self._report(notes + clamped, now)
        return held

    def halt(self, mode: int | None = None, for_good: bool = False) -> None:
        """Zero velocity from now on, whatever the state is, in that mode or the present one."""
        with self._lock:
            command = still(self._asked[0])
            self._asked = (command if mode is None else replace(command, mode=mode)), -math.inf
            self._over = self._over or for_good

    def _may_ask(self, mode: int) -> None:
        """Raises RuntimeError where that mode cannot follow the present one."""
        if self._over:
            raise RuntimeError("the robot is closed")
        down = self._asked[0].mode in (Mode.LIE_DOWN, Mode.DAMP)
        if down and mode in (Mode.IDLE, Mode.STAND, Mode.WALK):
            raise RuntimeError("the robot lies or is limp: stand_up() first")

    def _report(self, notes: list[str], now: float) -> None:
        """Adds to the events what was held back: once for a row of commands."""
        if notes and not self._notes:
            self.events.append((now, "; ".join(notes)))
        self._notes = notes

    def command(self, now: float) -> HighCmd:
        """What goes out now."""
        command, given = self._asked
        if self.age(now) >= self._patience:
            self._stale_at = now
        if now - given < self._patience and given > self._stale_at:
            self._held = False
            return command
        stopped = still(command)
        if not self._held and stopped != command:
            late = given > self._stale_at
            why = "no command came in time" if late else "the state is stale"
            self.events.append((now, f"{why}: zero velocity goes out"))
        self._held = True
        return stopped

    def hear(self, data: bytes, now: float) -> bool:
        """Whether a datagram is news: a good state with a content not heard lately."""
        if data in self._recent:
            return False
        try:
            state = decode_state(data)
        except ProtocolError:
            self.refused += 1
            return False
        numbers = (*state.position, *state.imu.rpy, *state.velocity, state.yaw_speed)
        if not all(map(math.isfinite, numbers)):
            self.refused += 1
            return False
        if self._heard is None:
            self.origin = odometry(state)
        self._recent.append(data)
        self._heard = state, now
        self.news += 1
        return True

    def age(self, now: float) -> float:
        """Seconds since the last news; infinity before any."""
        heard = self._heard
        return math.inf if heard is None else now - heard[1]

    def state(self, now: float) -> HighState:
        """The last good state; RobotTimeout if it is stale."""
        heard = self._heard
        if heard is None:
            raise RobotTimeout("no state has come from the robot")
        if now - heard[1] >= self.timeout:
            raise RobotTimeout(f"no new state from the robot for {now - heard[1]:.2f} s")
        return heard[0]

    def pose(self, now: float) -> tuple[float, float, float]:
        """Where it is, (x, y, heading) in m and rad, counted from `start`."""
        x, y, heading = odometry(self.state(now))
        (x0, y0, heading0), (xs, ys, heading_s) = self.origin, self.start
        turn = heading_s - heading0
        c, s, dx, dy = math.cos(turn), math.sin(turn), x - x0, y - y0
        return (
            xs + c * dx - s * dy,
            ys + s * dx + c * dy,
            math.remainder(heading + turn, 2 * math.pi),
        )


def odometry(state: HighState) -> tuple[float, float, float]:
    """The robot's own (x, y, heading), counted from where it was switched on."""
    return state.position[0], state.position[1], state.imu.rpy[2]
