"""The remote control as the robot reports it: 40 bytes of a state, `HighState.wireless_remote`.

Known: the layout (two bytes of head, sixteen buttons as bits, five floats), which is that of the
vendor's header `unitree_joystick.h`. Assumed: that a Go1's high-level state carries it, that a
robot without a remote in reach reports zeros, and what the sticks' signs mean. The checklist in
the book ("On the real robot") tries each button before anything walks.
"""

import struct
from typing import NamedTuple

# bit 0 first, bytes 2 and 3
BUTTONS = "R1 L1 start select R2 L2 F1 F2 A B X Y up right down left".split()
LAYOUT = struct.Struct("<2xH5f16x")


class Remote(NamedTuple):
    """Which buttons are pressed, in the order of the bits, and where the sticks are, -1 to 1."""

    buttons: tuple[str, ...]
    left_x: float
    right_x: float
    right_y: float
    l2: float  # how far L2 is pressed, where the remote measures that
    left_y: float


def decode_remote(data: bytes) -> Remote:
    """What the 40 bytes of `wireless_remote` say.

    Raises:
        ValueError: their number is another.
    """
    if len(data) != LAYOUT.size:
        raise ValueError(f"wireless_remote: expected {LAYOUT.size} bytes, got {len(data)}")
    bits, *sticks = LAYOUT.unpack(data)
    pressed = tuple(name for bit, name in enumerate(BUTTONS) if bits >> bit & 1)
    return Remote(pressed, *sticks)


def encode_remote(*buttons: str) -> bytes:
    """The 40 bytes of a remote with those buttons pressed, for simulated robots."""
    return LAYOUT.pack(sum(1 << BUTTONS.index(name) for name in buttons), *[0.0] * 5)
