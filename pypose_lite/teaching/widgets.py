"""Two kinds of sliders: one that works on the page without a kernel, one that computes anew.

Both show pictures, which are plain values: a slider's picture can be tested like a number.
"""

import io
from collections.abc import Callable, Sequence
from typing import Any

import ipywidgets
import matplotlib.pyplot as plt
from matplotlib.figure import Figure


def png(figure: Figure, dpi: int = 110) -> bytes:
    """Returns the figure as PNG bytes, the same ones on every run, and closes it."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
    plt.close(figure)
    return buffer.getvalue()


def panels(draw: Callable[[Any], Figure], values: Sequence[Any], label: str) -> ipywidgets.VBox:
    """Returns a slider over pictures drawn beforehand; it moves on the page, without a kernel.

    Args:
        draw: makes the figure for one value.
        values: four or five of them, in the order of the slider.
        label: what the values are, with the unit.
    """
    pictures = [ipywidgets.Image(value=png(draw(value)), format="png") for value in values]
    for picture in pictures:
        picture.layout.max_width = "100%"
    stack = ipywidgets.Stack(pictures, selected_index=0)
    slider = ipywidgets.SelectionSlider(
        options=[str(value) for value in values],
        description=label,
    )
    stretch(slider)
    ipywidgets.jslink((slider, "index"), (stack, "selected_index"))
    return ipywidgets.VBox([slider, stack])


def live(draw: Callable[..., Figure], **sliders: ipywidgets.ValueWidget) -> ipywidgets.VBox:
    """Returns sliders over a picture that ``draw`` makes anew when one of them is let go.

    Args:
        draw: makes the figure from the sliders' values, by their names.
        sliders: ``horizon=ipywidgets.IntSlider(10, 2, 20)`` and the like.
    """
    picture = ipywidgets.Image(format="png")
    picture.layout.max_width = "100%"

    def redraw(_change: object = None) -> None:
        picture.value = png(draw(**{name: slider.value for name, slider in sliders.items()}))

    for name, slider in sliders.items():
        slider.description = slider.description or name
        stretch(slider)
        slider.continuous_update = False  # one drawing a move, not one a pixel
        slider.observe(redraw, names="value")
    redraw()
    return ipywidgets.VBox([*sliders.values(), picture])


def stretch(slider: ipywidgets.ValueWidget) -> None:
    """Gives a slider room for all of its label, and a track long enough to move along."""
    slider.style.description_width = "initial"
    slider.layout.width, slider.layout.max_width = "30em", "100%"
