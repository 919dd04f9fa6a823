"""A picture that moves: an animated GIF needs no script, no kernel and no network."""

import io
from collections.abc import Callable

from IPython.display import Image
from matplotlib.figure import Figure
from PIL import Image as Picture

from .widgets import png


def animate(
    draw: Callable[[int], Figure], frames: int, seconds: float = 0.1, dpi: int = 90
) -> Image:
    """Returns the animation of ``draw(0) .. draw(frames - 1)``, the same bytes on every run.

    Args:
        draw: makes the figure for one frame.
        frames: how many; a second of waiting follows the last one.
        seconds: that one frame stays.
        dpi: pixels per inch.
    """
    if frames < 1:
        raise ValueError(f"frames: expected at least 1, got {frames}")
    pictures = [Picture.open(io.BytesIO(png(draw(k), dpi))).convert("RGB") for k in range(frames)]
    # One palette for all, from the last frame, which shows the most; dithering would flicker.
    palette = pictures[-1].quantize(64, dither=Picture.Dither.NONE)
    first, *rest = (p.quantize(palette=palette, dither=Picture.Dither.NONE) for p in pictures)
    times = [round(1000 * seconds)] * (frames - 1) + [1000]
    buffer = io.BytesIO()
    first.save(buffer, "gif", save_all=True, append_images=rest, duration=times, loop=0)
    return Image(buffer.getvalue(), format="gif")
