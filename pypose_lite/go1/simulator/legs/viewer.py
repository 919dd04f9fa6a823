"""MuJoCo's viewer: a window in which a simulated dog with legs is seen while it walks."""

import contextlib
import sys
import warnings
from collections.abc import Iterator

from ..body import Dog
from . import parts
from .dog import LeggedDog


class NoDisplay(RuntimeError):
    """There is no screen on which a window could open."""


@contextlib.contextmanager
def shown(dog: Dog) -> Iterator[None]:
    """Opens the viewer on that dog, and keeps it up to date until the block ends.

    Whoever closes the window ends nothing but the view.

    Args:
        dog: which lives by the wall clock, or it is a very fast film.

    Raises:
        NoDisplay: there is no display, or on macOS the program does not run under `mjpython`.
        ValueError: the dog has no legs.
        parts.MissingParts: MuJoCo is not installed.
    """
    check()
    if not isinstance(dog, LeggedDog):
        raise ValueError("view: only a dog with legs can be looked at, --robot sim:legs")
    from mujoco import viewer

    body = dog.physics
    try:
        window = viewer.launch_passive(
            body.model, body.data, show_left_ui=False, show_right_ui=False
        )
    except RuntimeError as error:
        raise NoDisplay(f"the viewer cannot be opened: {' '.join(str(error).split())}") from None
    before, dog.on_picture = dog.on_picture, window.sync
    try:
        yield
    finally:
        dog.on_picture = before
        window.close()


def check() -> None:
    """Raises `NoDisplay` where no window can open; there MuJoCo itself would wait for ever."""
    parts.package("mujoco")
    if sys.platform == "darwin":  # another way to the screen, and MuJoCo says what it lacks
        return
    glfw = parts.package("glfw")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it is told here
        if not glfw.init():
            raise NoDisplay("the viewer needs a display, and there is none: leave out --view")
