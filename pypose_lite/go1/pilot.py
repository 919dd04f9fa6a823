"""The safety rules: what goes out now, and whether what came in is fresh.

No socket, no clock and no thread: the caller says what time it is. One thread may ask and
another send and hear, without a lock: every attribute is written by one of them alone.
"""

import math
from collections import deque
from dataclasses import replace

from .commands import Mode, slower, still, vet
from .protocol import HIGH_LEVEL, HighCmd, HighState, ProtocolError, decode_state

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
        self._asked = (HighCmd(level_flag=level_flag), -math.inf)  # written by who asks
        self._notes: list[str] = []  # by who asks
        self._heard: tuple[HighState, float] | None = None  # by who hears
        self._recent: deque[bytes] = deque(maxlen=REMEMBERED)  # by who hears
        self._stale_at = -math.inf  # by who sends: when the state was last seen stale
        self._held = False  # by who sends: whether a motion is being held back

    def ask(self, command: HighCmd, now: float) -> HighCmd:
        """The command that goes out from now on, clamped to the limits; `events` says where.

        Raises:
            RobotTimeout: the state is stale.
            RuntimeError: the robot lies or is limp, and has to stand up first.
            ValueError: see `commands.vet`.
        """
        self.state(now)
        down = self._asked[0].mode in (Mode.LIE_DOWN, Mode.DAMP)
        if down and command.mode in (Mode.IDLE, Mode.STAND, Mode.WALK):
            raise RuntimeError("the robot lies or is limp: stand_up() first")
        command, notes = replace(command, level_flag=self.level_flag), []
        if self.speed_limit is not None and (slow := slower(command, self.speed_limit)) != command:
            notes.append(f"speed: held to the limit of {self.speed_limit:g} m/s")
            command = slow
        held, clamped = vet(command)
        notes += clamped
        if notes and not self._notes:  # once for a row of them
            self.events.append((now, "; ".join(notes)))
        self._notes = notes
        self._asked = held, now
        return held

    def halt(self, mode: int | None = None) -> None:
        """Zero velocity from now on, whatever the state is, in that mode or the present one."""
        command = still(self._asked[0])
        self._asked = (command if mode is None else replace(command, mode=mode)), -math.inf

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
            why = "the state is stale" if given <= self._stale_at else "no command came in time"
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
