import math
from dataclasses import replace

import pytest

from pypose_lite import go1
from pypose_lite.go1.safety.limits import Gait, Mode, still
from pypose_lite.go1.safety.pilot import Pilot
from pypose_lite.go1.wire.protocol import BmsState, HighCmd, HighState, Imu, encode_state

WALK = HighCmd(mode=Mode.WALK, gait_type=Gait.TROT, velocity=(0.3, 0.0), yaw_speed=0.5)
STILL = replace(WALK, velocity=(0.0, 0.0), yaw_speed=0.0)


STANDS = replace(HighCmd(), mode=Mode.STAND)
FIT = {"bms": BmsState(soc=80), "body_height": 0.28, "mode": Mode.WALK}


def packet(x=0.0, y=0.0, heading=0.0, **fields):
    imu = Imu(rpy=(0.0, 0.0, heading))
    return encode_state(HighState(position=(x, y, 0.28), imu=imu, **FIT | fields))


def heard(until, start=0.0, pilot=None, **options):
    """A pilot who has heard a new state every 20 ms, of a robot that walks as `WALK` asks."""
    pilot = pilot or Pilot(**options)
    for tick in range(round((until - start) * 50) + 1):
        now = start + tick / 50
        pilot.hear(walked(now), now)
    return pilot


def walked(seconds):
    """A packet of a robot that has followed `WALK` so long: an arc of radius 0.6 m."""
    turn = 0.5 * seconds
    return packet(0.6 * math.sin(turn), 0.6 * (1 - math.cos(turn)), turn)


class Watched:
    """A stepped robot, what it sent and what its body was told, with the times of both."""

    def __init__(self, **options):
        faults = {name: options.pop(name) for name in [*options] if hasattr(go1.Faults, name)}
        setup = {
            n: options.pop(n) for n in [*options] if n in ("freeze", "vanish", "seed", "model")
        }
        numbers = options.pop("numbers", go1.Numbers())
        simulation = go1.Simulation(faults=go1.Faults(**faults), numbers=numbers, **setup)
        self.sent, self.told = [], []
        self.robot = go1.connect("sim", simulation=simulation, **options)
        self.now = self.robot._clock.now
        self._tap(self.robot.simulator, "apply", self.told)
        self._tap(self.robot, "_speak", self.sent)

    def _tap(self, owner, name, notes):
        inner = getattr(owner, name)

        def outer(command):
            notes.append((self.now(), command))
            return inner(command)

        setattr(owner, name, outer)


def moving(command):
    return command != still(command)


def velocity(command):
    return (*command.velocity, command.yaw_speed)


def same(command, other):
    """Equal but for the rounding to the packet's float32."""
    blank = {"velocity": (0.0, 0.0), "yaw_speed": 0.0}
    alike = replace(command, **blank) == replace(other, **blank)
    return alike and velocity(command) == pytest.approx(velocity(other), rel=1e-6)


BAD_LINES = {
    "a good line": {},
    "30 % loss": {"loss": 0.3},
    "200 ms delay": {"delay": 0.2},
    "duplicates": {"duplicates": 0.5, "lateness": 0.1},
    "reordering": {"reordering": 0.5, "lateness": 0.1},
    "garbage": {"garbage": 0.5},
    "all of it": {
        **{"loss": 0.3, "delay": 0.2, "duplicates": 0.3, "reordering": 0.3, "garbage": 0.3},
        **{"lateness": 0.1},
    },
}
