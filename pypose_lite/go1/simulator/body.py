"""What every body of the simulated robot has, whether a point with a lag or legs with physics.

A `Dog` is asked by commands, moves on in steps, and says how it is in states. There are two:
`point.PointDog`, whose velocities follow the command with a lag, and `legs.dog.LeggedDog`, which
walks on four legs by MuJoCo's physics. `Numbers` names every number that they share or assume.
"""

import math
import random
from abc import ABC, abstractmethod
from dataclasses import dataclass

from ..wire.protocol import BmsState, HighCmd, HighState, Imu

STEP = 0.005  # s, of the integration
SERIAL = {"edu": 3, "pro": 2}  # byte 1 of the serial number, by model
GRAVITY = 9.81  # m/s^2

Triple = tuple[float, float, float]


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


class Dog(ABC):
    """A body that lives behind the robot's packets.

    Args:
        numbers: of the body.
        seed: of every random draw.
        model: "edu" or "pro", for the serial number.

    Attributes:
        pose: where it truly is, (x, y, heading) in m and rad, from (0, 0, 0) at power-on.
        command: what it was asked last.
        remote: what its remote control says, 40 bytes.
    """

    pose: Triple

    def __init__(self, numbers: Numbers, seed: int = 0, model: str = "edu") -> None:
        if model not in SERIAL:
            raise ValueError(f"model: expected one of {[*SERIAL]}, got {model!r}")
        self.numbers, self.command, self.remote = numbers, HighCmd(), bytes(40)
        self._random = random.Random(seed)
        draw = self._random.uniform  # the odometry starts anywhere: the robot was walked before
        self._odometry = (draw(-5, 5), draw(-5, 5), draw(-math.pi, math.pi))
        self._charge, self._serial = numbers.charge, (4 | SERIAL[model] << 8, 0)

    @abstractmethod
    def ask(self, command: HighCmd) -> None:
        """Takes a command."""

    @abstractmethod
    def step(self) -> None:
        """Moves on by `STEP` seconds."""

    @abstractmethod
    def state(self) -> HighState:
        """What the robot reports: everything as its own sensors see it."""

    def _discharge(self) -> None:
        """Takes from the battery what a step costs."""
        self._charge = max(self._charge - self.numbers.discharge * STEP, 0.0)

    def _battery(self) -> BmsState:
        return BmsState(soc=int(self._charge), current=-2000, cell_vol=(3800,) * 10)

    def _imu(self, rpy: Triple, gyroscope: Triple, accelerometer: Triple) -> Imu:
        """The inertial sensor, whose noise is in every state a new one."""
        roll, pitch, yaw = *rpy[:2], math.remainder(rpy[2], 2 * math.pi)
        noise = [self._noise(self.numbers.sensor) for _ in range(6)]
        return Imu(
            quaternion=quaternion(roll, pitch, yaw),
            gyroscope=tuple(rate + more for rate, more in zip(gyroscope, noise[:3])),
            accelerometer=tuple(pull + more for pull, more in zip(accelerometer, noise[3:])),
            rpy=(roll, pitch, yaw),
            temperature=40,
        )

    def _noise(self, size: float) -> float:
        """A draw of a sensor's noise."""
        return self._random.gauss(0.0, size)


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


def moved(pose: Triple, forward: float, left: float, turn: float) -> Triple:
    """A pose after `STEP` seconds at those velocities, with the heading of half the step."""
    x, y, heading = pose
    middle = heading + turn * STEP / 2
    c, s = math.cos(middle), math.sin(middle)
    return (
        x + (c * forward - s * left) * STEP,
        y + (s * forward + c * left) * STEP,
        heading + turn * STEP,
    )
