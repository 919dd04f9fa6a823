"""Two kinds of sliders: one that works on the page without a kernel, one that computes anew.

Both show pictures, which are plain values: a slider's picture can be tested like a number.
"""

from collections.abc import Callable, Sequence
from typing import Any

import ipywidgets
from matplotlib.figure import Figure

from .pictures import Picture, png


def panels(
    draw: Callable[[Any], Figure], values: Sequence[Any], label: str, *, alt: str = ""
) -> ipywidgets.VBox:
    """Returns a slider over pictures drawn beforehand; it moves on the page, without a kernel.

    Args:
        draw: makes the figure for one value.
        values: four or five of them, in the order of the slider.
        label: what the values are, with the unit.
        alt: what the pictures show, in words; each picture's own value is added.
    """
    pictures = []
    for value in values:
        text = f"{alt} ({label}: {value})" if alt else ""
        pictures.append(_shown(Picture(png(draw(value)), text)))
    stack = ipywidgets.Stack(pictures, selected_index=0)
    slider = ipywidgets.SelectionSlider(
        options=[str(value) for value in values],
        description=label,
    )
    stretch(slider)
    ipywidgets.jslink((slider, "index"), (stack, "selected_index"))
    return ipywidgets.VBox([slider, stack])


def live(
    draw: Callable[..., Figure], *, alt: str = "", **sliders: ipywidgets.ValueWidget
) -> ipywidgets.VBox:
    """Returns sliders over a picture that ``draw`` makes anew when one of them is let go.

    Args:
        draw: makes the figure from the sliders' values, by their names.
        alt: what the picture shows, in words.
        sliders: ``horizon=ipywidgets.IntSlider(10, 2, 20)`` and the like.
    """
    picture = ipywidgets.HTML()

    def redraw(_change: object = None) -> None:
        figure = draw(**{name: slider.value for name, slider in sliders.items()})
        picture.value = Picture(png(figure), alt).html

    for name, slider in sliders.items():
        slider.description = slider.description or name
        stretch(slider)
        slider.continuous_update = False  # one drawing a move, not one a pixel
        slider.observe(redraw, names="value")
    redraw()
    return ipywidgets.VBox([*sliders.values(), picture])


def _shown(picture: Picture) -> ipywidgets.HTML:
    """The picture as a widget: the Image of ipywidgets has no alternative text."""
    return ipywidgets.HTML(picture.html)


def stretch(slider: ipywidgets.ValueWidget) -> None:
    """Gives a slider room for all of its label, and a track long enough to move along."""
    slider.style.description_width = "initial"
    slider.layout.width, slider.layout.max_width = "30em", "100%"
