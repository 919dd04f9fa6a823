"""A robot for the closed loop: real, simulated, or recorded, all through the same few methods.

Three things happen, each at its own pace, and none waits for another:

    ask      a loop calls `move` when it has thought: the `Pilot` vets the command and keeps it
    beat     a clock ticks 100 to 500 times a second, in a thread of its own on the wall clock
    bytes    in each beat the pilot says what goes out *now* (the command, or zero velocity if it
             has expired), which is sent as 129 bytes; then what has come is heard until the next
             beat is due, and each new state of 1087 bytes is the pilot's, and the log's

So a loop that hangs cannot keep a robot walking, and a network that stalls cannot hold up a loop.
Whoever made a `Robot` (`connect` does) closes it: half a second of zero velocity, then a stand.
What holds at any time: no command goes out that the pilot did not let pass, and no state is served
that is older than the pilot's `timeout`.
"""

import contextlib
import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, Self

from .log import Log, row
from .safety import rules, signals
from .safety.clocks import SteppedClock, WallClock
from .safety.guardian import Guardian
from .safety.limits import Gait, Mode, settled, still
from .safety.pilot import SETTLING, Pilot, RobotTimeout
from .simulator.simulated_robot import SimulatedRobot
from .wire.protocol import HighCmd, HighState, encode_command
from .wire.transport import Transport

PATIENCE = 3.0  # s, for the first state to come
FAREWELL = SETTLING + 0.2  # s at the end: zero velocity, longer than a network is late; a stand
OLDEST_STATE = 0.1  # s, at the beginning of a walk


class Line(NamedTuple):
    """What lies between the robot and this program."""

    transport: Transport
    clock: WallClock | SteppedClock
    guardian: Guardian | None = None
    simulator: SimulatedRobot | None = None


class Robot:
    """What the closed loop drives; made by `connect`, closed by `close` or a `with` block.

    Zero velocity goes out when nobody renews a command, when the state is stale, when the robot
    does not do what it is told, and when it is closed, by whatever way the program ends.

    Attributes:
        address: what it was connected to.
        simulator: the simulated robot, where it lives in this program, else None.
        pilot: the rules, and what it counted: `news`, `refused`, `refusals`.
        sent: how many commands went out.
        target: the number of the waypoint aimed at, for the log; 0 for none.
    """

    def __init__(
        self,
        address: str,
        line: Line,
        pilot: Pilot,
        gait: Gait,
        log: Log | None,
        closers: contextlib.ExitStack,
    ) -> None:
        self.address, self.pilot, self.simulator, self.sent = address, pilot, line.simulator, 0
        self.target, self.closed = 0, False
        self._transport, self._clock, self._guardian = line.transport, line.clock, line.guardian
        self._gait, self._log, self._closers = gait, log, closers
        self._began = self._heard = 0.0  # when the first state came, and the last one
        self._packets = _packets(HighCmd(level_flag=pilot.level_flag))

    @property
    def state(self) -> HighState:
        """The last state; RobotTimeout if it is stale."""
        return self.pilot.state(self._clock.now())

    @property
    def events(self) -> list[tuple[float, str]]:
        """The latest (time, text) of all that went another way than asked."""
        return list(self.pilot.events)

    @property
    def age(self) -> float:
        """Seconds since the robot last said something new."""
        return self.pilot.age(self._clock.now())

    def now(self) -> float:
        """The time in seconds on the robot's clock, which for a simulated one is simulated."""
        return self._clock.now()

    def pose(self) -> tuple[float, float, float]:
        """Where it is, (x, y, heading) in m and rad, in the frame where it stood at connect.

        Its own odometry is behind this: it drifts. A `start` given to `connect` is where it stood.

        Raises:
            RobotTimeout: the state is stale.
        """
        return self.pilot.pose(self._clock.now())

    def reset_origin(self, start: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        """Says where the robot stands now; `pose` counts from there. The odometry itself goes on.

        Raises:
            RobotTimeout: the state is stale.
            ValueError: a number that is not finite.
        """
        if not all(map(math.isfinite, start)):
            raise ValueError(f"start: expected finite numbers, got {start!r}")
        self.pilot.reset_origin(start, self._clock.now())

    def move(self, v: float, yaw_rate: float, left: float = 0.0) -> tuple[float, float]:
        """Walks at `v` m/s forward, `left` m/s sideways, turning by `yaw_rate` rad/s.

        To be called again before `command_timeout` has passed, or the robot stands.

        Returns:
            The v and the yaw rate that go out: those asked for, with the trim, clamped to the
            gait's limits, and both slowed down alike where a speed limit asks for it.

        Raises:
            RobotTimeout: the state is stale.
            RobotStopped: a safety rule has stopped the robot; `go_on` lets it walk again.
            RuntimeError: the robot is closed, lies or is limp.
            ValueError: NaN or infinity.
        """
        velocity = float(v), float(left)
        asked = HighCmd(mode=Mode.WALK, gait_type=self._gait, velocity=velocity)
        sent = self.send(replace(asked, yaw_speed=float(yaw_rate)))
        return sent.velocity[0], sent.yaw_speed

    def send(self, command: HighCmd) -> HighCmd:
        """Repeats that command from now on, clamped; see `Pilot.ask` for what is refused."""
        return self.pilot.ask(command, self._clock.now())

    def stop(self) -> None:
        """Zero velocity from now on; after half a second of it the robot is told to stand."""
        self.pilot.halt()

    def go_on(self) -> None:
        """Lets the robot walk again, after a safety rule has stopped it and you have looked."""
        self._must_be_open()
        self.pilot.go_on()

    def reasons_to_stay(self) -> list[str]:
        """Why the robot should not begin to walk now; empty if it may."""
        pilot, now = self.pilot, self._clock.now()
        state, age = pilot.state(now), pilot.age(now)
        old = f"its state is {age:.2f} s old, more than {OLDEST_STATE} s"
        reasons = pilot.may_not_walk(now), rules.wrong_flag(state, pilot.level_flag)
        return [reason for reason in (*reasons, old if age > OLDEST_STATE else None) if reason]

    def damp(self) -> None:
        """The emergency: the legs go limp and the robot sinks; only `stand_up` ends that."""
        self._must_be_open()
        self.pilot.halt(Mode.DAMP)

    def stand_up(self) -> None:
        """Stands up, and returns when it stands; RobotTimeout if it does not."""
        self._posture(Mode.STAND_UP, lambda height: height > rules.UPRIGHT)
        self.send(HighCmd(mode=Mode.STAND))

    def lie_down(self) -> None:
        """Comes to a stand, lies down, and returns when it lies; RobotTimeout if it does not."""
        self.stop()
        self.wait(FAREWELL)
        self._posture(Mode.LIE_DOWN, lambda height: height < rules.UPRIGHT)

    def wait(self, dt: float) -> None:
        """Waits for the next tick of a loop of `dt` seconds.

        On the wall clock it sleeps until `dt` after the last tick; in stepped time the robot is
        simulated for `dt` seconds, as fast as the computer goes.
        """
        if not 0 <= dt < math.inf:
            raise ValueError(f"dt: expected seconds, got {dt!r}")
        self._must_be_open()
        if self._log is not None:
            self._log.flush()
        self._clock.wait(dt)

    def close(self) -> None:
        """Zero velocity for half a second, then a stand; then the robot is let go of.

        A signal that comes meanwhile (Ctrl-C, TERM, HUP) waits until that is done.
        """
        self.pilot.halt(for_good=True)
        self.closed = True
        self._closers.close()

    def begin(self) -> None:
        """Starts to send, and waits for the first state; RobotTimeout if none comes.

        `connect` calls this, once.
        """
        self._closers.callback(self._farewell)
        self._clock.start(self._beat)
        for _ in range(math.ceil(PATIENCE / 0.05)):
            self._clock.wait(0.05)
            if self.pilot.news:
                break
        else:
            came = self._what_came()
            raise RobotTimeout(f"{self.address}: no state came within {PATIENCE:g} s; {came}")
        if self._log is not None:
            self._log.open()
        if reason := rules.wrong_flag(self.state, self.pilot.level_flag):
            self.pilot.events.append((self._clock.now(), f"{reason}: it will not move"))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _must_be_open(self) -> None:
        if self.closed:
            raise RuntimeError("the robot is closed")

    def _posture(self, mode: Mode, done: Callable[[float], bool]) -> None:
        """Asks for a posture until the body's height says that it is taken."""
        for _ in range(50):
            self.send(HighCmd(mode=mode))
            self.wait(0.1)
            if done(self.state.body_height):
                return
        raise RobotTimeout(f"{mode.name}: not done within 5 s")

    def _farewell(self) -> None:
        """The last packets; the guardian may go when all of them are out."""
        with signals.postponed():
            complete = self._clock.stop(FAREWELL)
            if self._guardian is not None:
                self._guardian.close(complete)

    def _what_came(self) -> str:
        """What did come, where no state did."""
        if not self.pilot.refusals:
            nobody = getattr(self._transport, "failures", 0) > 0
            return "nobody listens there" if nobody else "is it on, and does it hear no other?"
        told = (f"{count} times {why}" for why, count in self.pilot.refusals.most_common(3))
        return "what came was refused: " + ", ".join(told)

    def _beat(self, late: bool, left: Callable[[], float]) -> None:
        """Sends the command of this moment, and hears what comes until the next one is due."""
        if late:  # what waited while the program slept is old, not to be taken for fresh
            self._drop()
        self._speak(self.pilot.command(self._clock.now()))
        try:
            self._hear(left)
        except Exception as error:  # whatever it is, the next command has to go out
            self.pilot.events.append((self._clock.now(), f"hearing failed: {error!r}"))

    def _speak(self, command: HighCmd) -> None:
        """Sends a command, and tells the guardian what would stop the robot."""
        if command != self._packets[0]:
            self._packets = _packets(command)
        self._transport.send(self._packets[1])
        self.sent += 1
        if self._guardian is not None and not self._guardian.beat(*self._packets[2:]):
            self.pilot.events.append((self._clock.now(), "the guardian process is dead"))
            self._guardian = None

    def _hear(self, left: Callable[[], float]) -> None:
        """Hears what comes until no time is left."""
        for _ in range(64):  # a flood does not keep the next command from going out
            data = self._transport.receive(left())
            if data is None:
                break
            now = self._clock.now()
            if self.pilot.hear(data, now):
                self._note(now)

    def _drop(self) -> None:
        """Forgets what is waiting to be heard."""
        for _ in range(1000):
            if self._transport.receive(0.0) is None:
                break

    def _note(self, now: float) -> None:
        """Adds the state that has just come to the log."""
        if self.pilot.news == 1:
            self._began = self._heard = now
        if self._log is not None:
            times = now - self._began, now - self._heard
            counts = self.pilot.refused, self.target
            state, command = self.pilot.state(now), self._packets[0]
            self._log.add(row(times, self.pilot.pose(now), state, command, counts))
        self._heard = now


def _packets(command: HighCmd) -> tuple[HighCmd, bytes, bytes, bytes]:
    """A command, its bytes, and those that bring the robot to a stop: zero velocity, a stand."""
    ends = encode_command(still(command)), encode_command(settled(command))
    return command, encode_command(command), *ends
