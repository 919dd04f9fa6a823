"""The trained gait: fifty times a second, 45 numbers that the body feels become 12 joint angles."""

import numpy as np

from . import parts
from .physics import Array, Physics

EVERY = 4  # steps of the physics between two of the policy's: 50 Hz
GAINS = 20.0, 0.5  # of the joints, N m/rad and N m s/rad, with which it was trained
STANCE = np.array([0.0, 0.8, -1.5] * 4)  # rad
ACTION = np.array([0.125, 0.25, 0.25] * 4)  # rad, for an action of 1
SLEW = np.array([0.05, 0.04, 0.10])  # m/s, m/s, rad/s: the most a command changes in 20 ms


class Gait:
    """Walks as it is told, as well as it has learned to."""

    def __init__(self) -> None:
        self._policy = parts.policy()
        self.begin()

    def begin(self) -> None:
        """Begins to walk anew, from a stand."""
        self._action, self._told, self._count = np.zeros(12), np.zeros(3), 0
        self._target = STANCE

    def torques(self, physics: Physics, told: tuple[float, float, float]) -> Array:
        """The joints' torques (12,) for forward m/s, left m/s and turn rad/s."""
        if self._count % EVERY == 0:
            self._told = self._told + np.clip(np.array(told) - self._told, -SLEW, SLEW)
            self._target = STANCE + ACTION * self._act(physics)
        self._count += 1
        return pull(physics, self._target, GAINS)

    def _act(self, physics: Physics) -> Array:
        """What the policy does about what the body feels, (12,)."""
        feels = [
            0.25 * physics.gyroscope,
            -physics.rotation[2],  # which way is down
            self._told,
            physics.joints - STANCE,
            0.05 * physics.speeds,
            self._action,
        ]
        row = np.concatenate(feels).astype(np.float32)[None]
        [actions] = self._policy.run(["actions"], {"obs": row})
        self._action = actions[0].astype(np.float64)
        return self._action


def pull(physics: Physics, target: Array, gains: tuple[float, float]) -> Array:
    """Torques (12,) towards those angles, by the joints' stiffness and damping."""
    stiffness, damping = gains
    return stiffness * (target - physics.joints) - damping * physics.speeds
