"""The simulated robot's body: how it moves when asked, and what it then reports.

A model to test programs with, not one of the real robot's legs: velocities follow the command
with a lag, and the odometry drifts. `Numbers` names every number of it.
"""

import math
import random
from dataclasses import dataclass, replace

from ..safety.limits import Mode
from ..wire.protocol import BmsState, HighCmd, HighState, Imu

STEP = 0.005  # s, of the integration
SERIAL = {"edu": 3, "pro": 2}  # byte 1 of the serial number, by model


@dataclass(frozen=True)
class Numbers:
    """Every number of the simulated robot; "assumed" where no source was found.

    Attributes:
        lag: s, time constant with which velocities follow the command; assumed.
        dead_band: m/s, a slower command starts no walk; users of the robot report 0.1 to 0.2,
            none by default.
        scale: metres of odometry a metre walked; assumed.
        yaw_drift: rad/s by which the reported heading turns away; assumed.
        jitter: standard deviation of the reported velocities, m/s and rad/s; assumed.
        sensor: standard deviation of the inertial sensor, rad/s and m/s^2; assumed.
        height: m, of the body when it stands; the vendor's header ("about 0.28 m").
        lying: m, of the body when it lies; assumed.
        rise: m/s, with which it stands up and lies down; assumed.
        foot_raise_height: m; the vendor's header ("about 0.08 m").
        charge: % in the battery at the start; assumed.
        discharge: % a second; assumed (about an hour and a half of walking).
        content_rate: Hz, at which the content of the state changes; users of the robot.
        watchdog: s without a command after which it stands still; assumed, and a real robot may
            have none.
        silence: s without a word after which another client may take over; assumed.
    """

    lag: float = 0.15
    dead_band: float = 0.0
    scale: float = 1.01
    yaw_drift: float = 0.001
    jitter: float = 0.01
    sensor: float = 0.01
    height: float = 0.28
    lying: float = 0.08
    rise: float = 0.2
    foot_raise_height: float = 0.08
    charge: float = 90.0
    discharge: float = 0.018
    content_rate: float = 50.0
    watchdog: float = 0.5
    silence: float = 2.0


class Dog:
    """A body that walks on a plane.

    Attributes:
        pose: where it truly is, (x, y, heading) in m and rad, from (0, 0, 0) at power-on.
        command: what it was asked last.
        leaning: roll and pitch in rad that have befallen it.
        remote: what its remote control says, 40 bytes.
    """

    def __init__(self, numbers: Numbers, seed: int = 0, model: str = "edu") -> None:
        if model not in SERIAL:
            raise ValueError(f"model: expected one of {[*SERIAL]}, got {model!r}")
        self.numbers, self.pose, self.command = numbers, (0.0, 0.0, 0.0), HighCmd()
        self.leaning, self.remote = (0.0, 0.0), bytes(40)
        self._random = random.Random(seed)
        draw = self._random.uniform  # the odometry starts anywhere: the robot was walked before
        self._odometry = (draw(-5, 5), draw(-5, 5), draw(-math.pi, math.pi))
        self._velocity = (0.0, 0.0, 0.0)  # forward m/s, left m/s, turn rad/s
        self._height, self._charge, self._up = numbers.height, numbers.charge, True
        self._serial = (4 | SERIAL[model] << 8, 0)

    def step(self) -> None:
        """Moves on by `STEP` seconds."""
        numbers = self.numbers
        follow = 1.0 - math.exp(-STEP / numbers.lag) if numbers.lag > 0 else 1.0
        wanted = self._wanted()
        forward, left, turn = (v + follow * (w - v) for v, w in zip(self._velocity, wanted))
        self._velocity = forward, left, turn
        self.pose = _moved(self.pose, forward, left, turn)
        self._odometry = _moved(
            self._odometry, numbers.scale * forward, numbers.scale * left, turn + numbers.yaw_drift
        )
        rise = numbers.rise * STEP
        self._height += min(max(self._aim() - self._height, -rise), rise)
        self._charge = max(self._charge - numbers.discharge * STEP, 0.0)

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
        draw, numbers, command = self._random.gauss, self.numbers, self.command
        forward, left, turn = (v + draw(0.0, numbers.jitter) for v in self._velocity)
        return replace(
            _BLANK,
            sn=self._serial,
            imu=self._imu(),
            bms=BmsState(soc=int(self._charge), current=-2000, cell_vol=(3800,) * 10),
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

    def _imu(self) -> Imu:
        """The inertial sensor, whose noise is in every state a new one."""
        yaw = math.remainder(self._odometry[2], 2 * math.pi)
        roll, pitch = self.command.euler[:2] if self.command.mode == Mode.STAND else self.leaning
        noise = [self._random.gauss(0.0, self.numbers.sensor) for _ in range(6)]
        return Imu(
            quaternion=quaternion(roll, pitch, yaw),
            gyroscope=(noise[0], noise[1], self._velocity[2] + noise[2]),
            accelerometer=(noise[3], noise[4], 9.81 + noise[5]),
            rpy=(roll, pitch, yaw),
            temperature=40,
        )

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


def _moved(pose: tuple, forward: float, left: float, turn: float) -> tuple[float, float, float]:
    """A pose after `STEP` seconds at those velocities, with the heading of half the step."""
    x, y, heading = pose
    middle = heading + turn * STEP / 2
    c, s = math.cos(middle), math.sin(middle)
    return (
        x + (c * forward - s * left) * STEP,
        y + (s * forward + c * left) * STEP,
        heading + turn * STEP,
    )


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """(w, x, y, z) of a rotation by yaw, then pitch, then roll, about the moving axes."""
    cr, sr, cp, sp = (
        math.cos(roll / 2),
        math.sin(roll / 2),
        math.cos(pitch / 2),
        math.sin(pitch / 2),
    )
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
