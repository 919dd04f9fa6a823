"""The floor on which a simulated dog with legs walks."""

import math
from dataclasses import dataclass, fields


@dataclass(frozen=True)
class Floor:
    """A level floor with good grip, unless it is said otherwise.

    Attributes:
        slope: rad, by which it rises ahead.
        friction: of a foot on it; the robot's model has 0.8, wet tiles about 0.3, ice 0.05.
        step: m, the height of a step up, across the way.
        distance: m, how far ahead of the robot the step is.
    """

    slope: float = 0.0
    friction: float = 0.8
    step: float = 0.0
    distance: float = 1.0

    def __post_init__(self) -> None:
        limits = {"slope": (-0.7, 0.7), "friction": (0.01, 2), "step": (0, 0.5)}
        for name in (field.name for field in fields(self)):
            low, high = limits.get(name, (0.5, 100))
            value = getattr(self, name)
            if not (math.isfinite(value) and low <= value <= high):
                raise ValueError(f"{name}: expected {low:g} to {high:g}, got {value}")
