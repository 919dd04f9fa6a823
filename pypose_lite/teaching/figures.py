"""Figures of the book's style: fonts, colours, sizes, and an alternative text for each.

The colours are those of Okabe and Ito, which colour-blind readers can tell apart. Nothing here
needs torch: tutorials elsewhere use it as well.
"""

from typing import Any

import matplotlib.pyplot as plt
from IPython.display import display
from matplotlib.figure import Figure

from .pictures import Picture, png

BLUE, RED, ORANGE = "#0072B2", "#D55E00", "#E69F00"
GREEN, PURPLE, SKY, GREY = "#009E73", "#CC79A7", "#56B4E9", "#666666"


def use_style() -> None:
    """Sets fonts, sizes and the order of colours for all figures of a chapter, 7 inches wide."""
    plt.rcParams.update(
        {
            "figure.figsize": (7, 4),
            "figure.dpi": 120,
            "figure.constrained_layout.use": True,
            "font.size": 10,
            "legend.fontsize": 9,
            "xtick.labelsize": 9,
            "ytick.labelsize": 9,
            "axes.grid": True,
            "grid.alpha": 0.3,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "legend.frameon": False,
            "axes.prop_cycle": plt.cycler(color=[BLUE, RED, GREEN, ORANGE, PURPLE, SKY, GREY]),
        }
    )


def show(fig: Figure, alt: str) -> None:
    """Shows a figure, and closes it.

    Args:
        fig: it is the last that the cell does with it.
        alt: what a reader who cannot see it should know, in a sentence: what is drawn, and what
            is to be seen in it. Numbers belong into the text, where claims fill them in.

    Raises:
        ValueError: there is no alternative text.
    """
    if not alt.strip():
        raise ValueError("alt: expected a sentence that says what the figure shows, got nothing")
    display(Picture(png(fig), alt))


def stacked(panels: int = 2, height: float = 2.6, **options: Any) -> tuple[Figure, Any]:
    """Returns a figure with panels one above the other, each as wide as the page.

    Side by side, panels are half as wide, and too small to read on a phone.

    Args:
        panels: how many.
        height: of each, in inches.
        options: of ``plt.subplots``, ``sharex=True`` and the like.
    """
    return plt.subplots(panels, 1, figsize=(7, panels * height), **options)
