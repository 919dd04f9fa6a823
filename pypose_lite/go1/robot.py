"""A robot for the closed loop: real, simulated, or recorded, all through the same few methods."""

import contextlib
import math
from collections.abc import Callable
from typing import NamedTuple, Self

from .log import Log, Row
from .safety.clocks import SteppedClock, WallClock
from .safety.guardian import Guardian
from .safety.limits import Gait, Mode, still
from .safety.pilot import Pilot, RobotTimeout
from .simulator.simulated_robot import SimulatedRobot
from .wire.protocol import HighCmd, HighState, encode_command
from .wire.transport import Transport

PATIENCE = 3.0  # s, for the first state to come
FAREWELL = 0.5  # s of zero velocity at the end: longer than a network is late
UPRIGHT = 0.2  # m, the body's height between lying and standing; assumed


class Line(NamedTuple):
    """What lies between the robot and this program."""

    transport: Transport
    clock: WallClock | SteppedClock
    guardian: Guardian | None = None
    simulator: SimulatedRobot | None = None


class Robot:
    """What the closed loop drives; made by `connect`, closed by `close` or a `with` block.

    A sender repeats the command of the moment at a fixed rate, by the rules of `Pilot`: zero
    velocity goes out when nobody renews the command, when the state is stale, and for `FAREWELL`
    seconds when the robot is closed, by whatever way the program ends.

    Attributes:
        address: what it was connected to.
        simulator: the simulated robot, where it lives in this program, else None.
        pilot: the rules, and what it counted: `news`, `refused`.
        sent: how many commands went out.
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
        self._transport, self._clock, self._guardian = line.transport, line.clock, line.guardian
        self._gait, self._log, self._closers = gait, log, closers
        self._began = 0.0  # when the first state came
        idle = HighCmd(level_flag=pilot.level_flag)
        self._packets = (idle, encode_command(idle), encode_command(idle))

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

    def pose(self) -> tuple[float, float, float]:
        """Where it is, (x, y, heading) in m and rad, in the frame where it stood at connect.

        Its own odometry is behind this: it drifts. A `start` given to `connect` is where it stood.

        Raises:
            RobotTimeout: the state is stale.
        """
        return self.pilot.pose(self._clock.now())

    def move(self, v: float, yaw_rate: float, left: float = 0.0) -> tuple[float, float]:
        """Walks at `v` m/s forward, `left` m/s sideways, turning by `yaw_rate` rad/s.

        To be called again before `command_timeout` has passed, or the robot stands.

        Returns:
            The v and the yaw rate that go out: those asked for, clamped to the gait's limits,
            and both slowed down alike where a speed limit asks for it.

        Raises:
            RobotTimeout: the state is stale.
            RuntimeError: the robot is closed, lies or is limp.
            ValueError: NaN or infinity.
        """
        velocity = (float(v), float(left))
        asked = HighCmd(
            mode=Mode.WALK, gait_type=self._gait, velocity=velocity, yaw_speed=float(yaw_rate)
        )
        sent = self.send(asked)
        return sent.velocity[0], sent.yaw_speed

    def send(self, command: HighCmd) -> HighCmd:
        """Repeats that command from now on, clamped; see `Pilot.ask` for what is refused."""
        return self.pilot.ask(command, self._clock.now())

    def stop(self) -> None:
        """Zero velocity from now on."""
        self.pilot.halt()

    def damp(self) -> None:
        """The emergency: the legs go limp and the robot sinks; only `stand_up` ends that."""
        self.pilot.halt(Mode.DAMP)

    def stand_up(self) -> None:
        """Stands up, and returns when it stands; RobotTimeout if it does not."""
        self._posture(Mode.STAND_UP, lambda height: height > UPRIGHT)
        self.send(HighCmd(mode=Mode.STAND))

    def lie_down(self) -> None:
        """Comes to a stand, lies down, and returns when it lies; RobotTimeout if it does not."""
        self.stop()
        self.wait(FAREWELL)
        self._posture(Mode.LIE_DOWN, lambda height: height < UPRIGHT)

    def wait(self, dt: float) -> None:
        """Waits for the next tick of a loop of `dt` seconds.

        A robot on the wall clock sleeps until `dt` after the last tick; a stepped one is simulated
        for `dt` seconds, as fast as the computer goes.
        """
        if not 0 <= dt < math.inf:
            raise ValueError(f"dt: expected seconds, got {dt!r}")
        if self._log is not None:
            self._log.flush()
        self._clock.wait(dt)

    def close(self) -> None:
        """Sends zero velocity for `FAREWELL` seconds and lets go of the robot."""
        self.pilot.halt(for_good=True)
        self._closers.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _posture(self, mode: Mode, done: Callable[[float], bool]) -> None:
        """Asks for a posture until the body's height says that it is taken."""
        for _ in range(50):
            self.send(HighCmd(mode=mode))
            self.wait(0.1)
            if done(self.state.body_height):
                return
        raise RobotTimeout(f"{mode.name}: not done within 5 s")

    def begin(self) -> None:
        """Starts to send, and waits for the first state; RobotTimeout if none comes.

        `connect` calls this, once.
        """
        self._closers.callback(self._clock.stop, FAREWELL)
        self._clock.start(self._beat)
        for _ in range(math.ceil(PATIENCE / 0.05)):
            self._clock.wait(0.05)
            if self.pilot.news:
                return
        raise RobotTimeout(f"{self.address}: no state came within {PATIENCE:g} s; is it on?")

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
        """Sends a command, and tells the guardian what would be its zero velocity."""
        if command != self._packets[0]:
            self._packets = command, encode_command(command), encode_command(still(command))
        self._transport.send(self._packets[1])
        self.sent += 1
        if self._guardian is not None and not self._guardian.beat(self._packets[2]):
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
            self._began = now
        if self._log is not None:
            state, command = self.pilot.state(now), self._packets[0]
            measured = (*state.velocity[:2], state.yaw_speed)
            asked = (*command.velocity, command.yaw_speed)
            rest = (state.mode, state.body_height, state.bms.soc)
            time = now - self._began
            self._log.add(Row._make((time, *self.pilot.pose(now), *measured, *asked, *rest)))
