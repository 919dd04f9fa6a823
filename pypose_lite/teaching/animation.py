"""A picture that moves: an animated GIF needs no script, no kernel and no network."""

import io
from collections.abc import Callable

from matplotlib.figure import Figure
from PIL import Image

from .pictures import Picture, png


def animate(
    draw: Callable[[int], Figure],
    frames: int,
    seconds: float = 0.1,
    dpi: int = 90,
    *,
    alt: str = "",
) -> Picture:
    """Returns the animation of ``draw(0) .. draw(frames - 1)``, the same bytes on every run.

    Args:
        draw: makes the figure for one frame.
        frames: how many; a second of waiting follows the last one.
        seconds: that one frame stays.
        dpi: pixels per inch.
        alt: what the film shows, in words.
    """
    if frames < 1:
        raise ValueError(f"frames: expected at least 1, got {frames}")
    first, *rest = [_frame(png(draw(k), dpi)) for k in range(frames)]
    times = [round(1000 * seconds)] * (frames - 1) + [1000]
    buffer = io.BytesIO()
    first.save(buffer, "gif", save_all=True, append_images=rest, duration=times, loop=0)
    return Picture(buffer.getvalue(), alt, "gif")


def _frame(image: bytes) -> Image.Image:
    """The picture in so few shades that 256 colours hold it, with no flicker between frames."""
    return Image.open(io.BytesIO(image)).convert("RGB").point(lambda v: 15 * round(v / 15))
