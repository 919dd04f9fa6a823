"""The body as a point: how it moves when asked, and what it then reports.

A model to test programs with, not one of the real robot's legs: velocities follow the command
with a lag, and the odometry drifts. `Numbers` (body.py) names every number of it.
"""

import math
from dataclasses import replace

from ..safety.limits import Mode
from ..wire.protocol import HighCmd, HighState, Imu
from .body import GRAVITY, STEP, Dog, Numbers, moved


class PointDog(Dog):
    """A body that walks on a plane.

    Attributes:
        leaning: roll and pitch in rad that have befallen it.
    """

    def __init__(self, numbers: Numbers, seed: int = 0, model: str = "edu") -> None:
        super().__init__(numbers, seed, model)
        self.pose, self.leaning = (0.0, 0.0, 0.0), (0.0, 0.0)
        self._velocity = (0.0, 0.0, 0.0)  # forward m/s, left m/s, turn rad/s
        self._height, self._up = numbers.height, True

    def step(self) -> None:
        """Moves on by `STEP` seconds."""
        numbers = self.numbers
        follow = 1.0 - math.exp(-STEP / numbers.lag) if numbers.lag > 0 else 1.0
        wanted = self._wanted()
        forward, left, turn = (v + follow * (w - v) for v, w in zip(self._velocity, wanted))
        self._velocity = forward, left, turn
        self.pose = moved(self.pose, forward, left, turn)
        self._odometry = moved(
            self._odometry, numbers.scale * forward, numbers.scale * left, turn + numbers.yaw_drift
        )
        rise = numbers.rise * STEP
        self._height += min(max(self._aim() - self._height, -rise), rise)
        self._discharge()

    def ask(self, command: HighCmd) -> None:
        """Takes a command; how the legs change between lying and standing is told by its mode."""
        self.command = command
        if command.mode in (Mode.STAND_UP, Mode.RECOVER):
            self._up = True
        elif command.mode in (Mode.LIE_DOWN, Mode.DAMP):
            self._up = False

    def state(self) -> HighState:
        """What the robot reports: everything as its own sensors see it."""
        x, y, _ = self._odometry
        numbers, command = self.numbers, self.command
        forward, left, turn = (v + self._noise(numbers.jitter) for v in self._velocity)
        return replace(
            _BLANK,
            sn=self._serial,
            imu=self._inertia(),
            bms=self._battery(),
            foot_force=(30, 30, 30, 30),
            mode=command.mode,
            gait_type=command.gait_type,
            foot_raise_height=numbers.foot_raise_height + command.foot_raise_height,
            position=(x, y, self._height),
            body_height=self._height,
            velocity=(forward, left, 0.0),
            yaw_speed=turn,
            wireless_remote=self.remote,
        )

    def _inertia(self) -> Imu:
        """What the inertial sensor feels."""
        lean = self.command.euler[:2] if self.command.mode == Mode.STAND else self.leaning
        turn = self._velocity[2]
        return self._imu((*lean, self._odometry[2]), (0.0, 0.0, turn), (0.0, 0.0, GRAVITY))

    def _wanted(self) -> tuple[float, float, float]:
        """The velocities that the command asks for: none unless it stands and is told to walk."""
        command, standing = (
            self.command,
            self._height > (self.numbers.height + self.numbers.lying) / 2,
        )
        if not (standing and self._up and command.mode == Mode.WALK and command.gait_type):
            return 0.0, 0.0, 0.0
        forward, left = command.velocity
        slow = math.hypot(forward, left) < self.numbers.dead_band
        return (0.0, 0.0, command.yaw_speed) if slow else (forward, left, command.yaw_speed)

    def _aim(self) -> float:
        """The height to which the body is on its way."""
        return self.numbers.height + self.command.body_height if self._up else self.numbers.lying


_BLANK = HighState()
