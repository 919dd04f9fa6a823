"""The safety rules: what goes out now, and whether what came in is fresh and plausible.

No socket, no clock and no thread of its own: the caller says what time it is. Those who ask share
a lock. The one who sends and hears needs none, so that nobody can hold it up: whatever it reads
is written in one assignment.
"""

import math
import threading
from collections import Counter, deque
from collections.abc import Collection
from dataclasses import replace

from ..wire.protocol import (
    HIGH_LEVEL,
    HighCmd,
    HighState,
    ProtocolError,
    decode_state,
    encode_command,
)
from . import rules
from .limits import Mode, motion, settled, slower, still, trimmed, vet
from .rules import Area, Motion, Pose
from .watcher import Watcher

REMEMBERED = 1024  # contents of states, 20 s of them: one that comes again is old, not news
SETTLING = 0.5  # s of zero velocity, after which a walk ends in a stand


class RobotTimeout(TimeoutError):
    """Nothing new has been heard of the robot: its state is too old to act on."""


class RobotStopped(RuntimeError):
    """A safety rule has stopped the robot; it walks again after `Robot.go_on`."""


class Pilot:
    """Between the one who asks for a motion and the one who sends it.

    - A command that is not renewed becomes zero velocity before `timeout` seconds have passed.
    - So does any command once the state is that old. It is not taken up again by itself.
    - Zero velocity in walking mode becomes a stand after `SETTLING` seconds.
    - A state is as old as its content: the same bytes again, late or repeated for ever by a
      robot that hangs, are not news. (A robot that stands still has noise in its sensors.)
    - A pose that no dog can have reached is refused.
    - A robot that does not do what it is told, or must not walk (`rules`), is stopped, and stays
      stopped until `go_on`.

    Args:
        level_flag: of the commands; 0x00 for an Air or a Pro.
        timeout: s, after which a command expires and a state is stale.
        margin: s, by which a command expires earlier, so that zero is out in time.
        speed_limit: m/s, or None for the limits of the gait alone.
        start: (x, y, heading) in m and rad, what `pose` says where the robot first stood.
        area: (least x, greatest x, least y, greatest y) in m that it may not leave, or None.
        ignore: names of rules that do not count, of `rules.NAMES`.
        trim: forward, left and turn added to every motion, against a robot that drifts.

    Attributes:
        stopped: why a rule has stopped the robot, or None.
        events: the latest (time, text) of all that went another way than asked.
        news: how many states with a new content were heard.
        refusals: how many datagrams were no good state, by reason.
    """

    def __init__(
        self,
        level_flag: int = HIGH_LEVEL,
        timeout: float = 0.4,
        margin: float = 0.0,
        speed_limit: float | None = None,
        start: Pose = (0.0, 0.0, 0.0),
        area: Area | None = None,
        ignore: Collection[str] = (),
        trim: Motion = (0.0, 0.0, 0.0),
    ) -> None:
        self.level_flag, self.timeout, self.speed_limit = level_flag, timeout, speed_limit
        self.trim, self.watcher = trim, Watcher(area, ignore)
        self.stopped: str | None = None
        self.events: deque[tuple[float, str]] = deque(maxlen=1000)
        self.news, self.refusals = 0, Counter[str]()
        self._patience = timeout - margin
        self._lock = threading.Lock()  # of those who ask
        self._asked = (HighCmd(level_flag=level_flag), -math.inf)
        self._notes: list[str] = []
        self._over = False
        self._frame = (0.0, 0.0, 0.0), start  # the odometry somewhere, and the pose there
        self._rebase = False  # whether the next state tells anew where the odometry is
        self._heard: tuple[HighState, float] | None = None  # from here on: of who sends and hears
        self._recent: dict[bytes, None] = {}  # in the order of their coming
        self._sent: Motion = (0.0, 0.0, 0.0)
        self._stale_at = -math.inf  # when the state was last seen stale
        self._resting: float | None = None  # since when zero velocity goes out instead

    def ask(self, command: HighCmd, now: float) -> HighCmd:
        """The command that goes out from now on, clamped to the limits; `events` says where.

        Raises:
            RobotTimeout: the state is stale.
            RobotStopped: a rule has stopped the robot, or would; commands that move it alone.
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
            held, clamped = vet(trimmed(slow, self.trim))
            encode_command(held)  # what does not fit is refused here, not in the sender's thread
            if any(motion(held)):
                self._may_move(now)
            self._asked = held, now
            self._report(notes + clamped, now)
        return held

    def halt(self, mode: int | None = None, for_good: bool = False) -> None:
        """Zero velocity from now on, whatever the state is, in that mode or the present one."""
        with self._lock:
            command = still(self._asked[0])
            self._asked = (command if mode is None else replace(command, mode=mode)), -math.inf
            self._over = self._over or for_good

    def go_on(self) -> None:
        """Lets the robot walk again after a rule has stopped it; what was asked before is void.

        After a jump of the pose, the next state counts as where the robot last was.
        """
        self.halt()
        self.watcher.forget()
        self.stopped = None

    def reset_origin(self, start: Pose, now: float) -> None:
        """Counts the pose from here on: the robot is at `start` now; RobotTimeout if stale."""
        self._frame = odometry(self.state(now)), start

    def may_not_walk(self, now: float) -> str | None:
        """Why the robot should not begin to walk, or None; RobotTimeout if the state is stale."""
        state = self.state(now)
        return self.stopped or self.watcher.fitness(state, self.pose(now), 0.0)

    def command(self, now: float) -> HighCmd:
        """What goes out now."""
        command, given = self._asked
        if self.age(now) >= self._patience:
            self._stale_at = now
        fresh = now - given < self._patience and given > self._stale_at
        if not fresh or (self.stopped and any(motion(command))):
            command = self._rest(command, given, now)
        else:
            self._resting = None
        self._sent = motion(command)
        return command

    def hear(self, data: bytes, now: float) -> bool:
        """Whether a datagram is news: a good state with a content not heard lately."""
        if data in self._recent:
            return False
        try:
            state = decode_state(data)
        except ProtocolError as error:
            return self._refuse(str(error))
        numbers = (*state.position, *state.imu.rpy, *state.velocity, state.yaw_speed)
        if not all(map(math.isfinite, numbers)):
            return self._refuse("a number is not finite")
        if not self._plausible(state, now):
            return self._refuse("the pose jumped")
        self._recent[data] = None
        if len(self._recent) > REMEMBERED:
            del self._recent[next(iter(self._recent))]
        self._heard = state, now
        self.news += 1
        reason = self.watcher.see(state, self.pose(now), self._sent, now, self.level_flag)
        if reason and not self.stopped:
            self._stop(reason, now)
        return True

    def age(self, now: float) -> float:
        """Seconds since the last news; infinity before any."""
        heard = self._heard
        return math.inf if heard is None else now - heard[1]

    @property
    def refused(self) -> int:
        """How many datagrams were no good state."""
        return self.refusals.total()

    @property
    def origin(self) -> Pose:
        """The odometry's (x, y, heading) where the pose is counted from."""
        return self._frame[0]

    def state(self, now: float) -> HighState:
        """The last good state; RobotTimeout if it is stale."""
        heard = self._heard
        if heard is None:
            raise RobotTimeout("no state has come from the robot")
        if now - heard[1] >= self.timeout:
            why = f"; {self.stopped}" if self.stopped else ""
            raise RobotTimeout(f"no new state from the robot for {now - heard[1]:.2f} s{why}")
        return heard[0]

    def pose(self, now: float) -> Pose:
        """Where it is, (x, y, heading) in m and rad, counted from `start`."""
        return seen_from(self._frame, odometry(self.state(now)))

    def _may_ask(self, mode: int) -> None:
        """Raises RuntimeError where that mode cannot follow the present one."""
        if self._over:
            raise RuntimeError("the robot is closed")
        down = self._asked[0].mode in (Mode.LIE_DOWN, Mode.DAMP)
        if down and mode in (Mode.IDLE, Mode.STAND, Mode.WALK):
            raise RuntimeError("the robot lies or is limp: stand_up() first")

    def _may_move(self, now: float) -> None:
        """Raises RobotStopped where a rule forbids a motion."""
        if reason := self.may_not_walk(now):
            if not self.stopped:
                self._stop(reason, now)
            raise RobotStopped(f"{reason} (go_on() lets it walk again)")

    def _stop(self, reason: str, now: float) -> None:
        """Stops the robot until `go_on`."""
        self.stopped = reason
        self.events.append((now, f"{reason}: zero velocity goes out"))

    def _report(self, notes: list[str], now: float) -> None:
        """Adds to the events what was held back: once for a row of commands."""
        if notes and not self._notes:
            self.events.append((now, "; ".join(notes)))
        self._notes = notes

    def _rest(self, command: HighCmd, given: float, now: float) -> HighCmd:
        """What goes out instead of a command that does not count (any more)."""
        if self._resting is None:
            self._resting = now
            if any(motion(command)) and not self.stopped:
                late = given > self._stale_at
                why = "no command came in time" if late else "the state is stale"
                self.events.append((now, f"{why}: zero velocity goes out"))
        return settled(command) if now - self._resting >= SETTLING else still(command)

    def _plausible(self, state: HighState, now: float) -> bool:
        """Whether a dog can be there; the first state, and one after `go_on`, says where it is."""
        heard, place = self._heard, odometry(state)
        if heard is None:
            self._frame = place, self._frame[1]
            return True
        if "jump" in self.watcher.ignore:
            return True
        before, seen = odometry(heard[0]), place
        if rules.leans(state) or rules.leans(heard[0]):  # who topples over looks back: no jump
            seen = *place[:2], before[2]
        reason = rules.jumped(before, seen, now - heard[1])
        if reason and self._rebase and not self.stopped:
            self._frame = place, seen_from(self._frame, before)
            reason = None
        self._rebase = bool(reason)
        if reason and not self.stopped:
            self._stop(reason, now)
        return not reason

    def _refuse(self, reason: str) -> bool:
        """Counts a datagram that is no good state, and returns False."""
        self.refusals[reason] += 1
        return False


def odometry(state: HighState) -> Pose:
    """The robot's own (x, y, heading), counted from where it was switched on."""
    return state.position[0], state.position[1], state.imu.rpy[2]


def seen_from(frame: tuple[Pose, Pose], place: Pose) -> Pose:
    """The pose of a place of the odometry, where `frame` is (origin of the odometry, its pose)."""
    (x0, y0, heading0), (xs, ys, heading_s) = frame
    turn = heading_s - heading0
    c, s, dx, dy = math.cos(turn), math.sin(turn), place[0] - x0, place[1] - y0
    heading = math.remainder(place[2] + turn, 2 * math.pi)
    return xs + c * dx - s * dy, ys + s * dx + c * dy, heading
