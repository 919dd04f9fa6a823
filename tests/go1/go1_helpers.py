from dataclasses import replace

import pytest

from pypose_lite import go1
from pypose_lite.go1.safety.limits import still


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
