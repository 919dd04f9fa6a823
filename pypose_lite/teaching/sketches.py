"""Sketches of ideas: a car seen from above, arrows, and the boxes and wires of a block diagram.

As in :mod:`~pypose_lite.teaching.plotting`, a function takes an ``ax`` and returns what it drew.
"""

import math
from collections.abc import Sequence

import torch
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon, Rectangle
from matplotlib.text import Annotation, Text

from .plotting import GREY

BODY = [[-0.4, -0.2], [0.2, -0.2], [0.5, 0.0], [0.2, 0.2], [-0.4, 0.2]]  # m, with a pointed nose
RIGHT = [[-0.1, -0.29], [0.1, -0.29], [0.1, -0.21], [-0.1, -0.21]]  # the wheels
LEFT = [[-0.1, 0.21], [0.1, 0.21], [0.1, 0.29], [-0.1, 0.29]]
SIZE = 13  # points: letters in sketches are larger than those of axes, for phones

Point = Sequence[float] | torch.Tensor


def car(ax: Axes, i: float, j: float, theta: float) -> list[Polygon]:
    """Returns the body and the two wheels of a car at (i, j) in metres, with heading theta."""
    c, s = math.cos(theta), math.sin(theta)
    turned = torch.tensor([[c, s], [-s, c]], dtype=torch.float64)
    here = torch.tensor([i, j], dtype=torch.float64)
    patches = []
    for outline, alpha in ((BODY, 0.35), (RIGHT, 1.0), (LEFT, 1.0)):
        corners = torch.tensor(outline, dtype=torch.float64) @ turned + here
        patches.append(Polygon(corners, fc=GREY, ec="black", alpha=alpha, zorder=3))
        ax.add_patch(patches[-1])
    return patches


def arrow(
    ax: Axes, tail: Point, tip: Point, color: str = "black", bend: float = 0.0, width: float = 2.0
) -> Annotation:
    """Returns an arrow from one point to another; where ``bend`` is positive it turns left."""
    look = {"arrowstyle": "-|>", "mutation_scale": 16, "lw": width, "shrinkA": 0, "shrinkB": 0}
    look |= {"color": color, "connectionstyle": f"arc3,rad={bend}"}
    (i, j), (i_tip, j_tip) = ([float(x) for x in point] for point in (tail, tip))
    return ax.annotate("", (i_tip, j_tip), (i, j), arrowprops=look, zorder=5)


def word(ax: Axes, i: float, j: float, text: str, color: str = "black") -> Text:
    """Returns a word or a letter that begins at (i, j), as large as all of a sketch."""
    return ax.text(i, j, text, size=SIZE, color=color)


def box(
    ax: Axes, i: float, j: float, text: str, width: float = 1.5, height: float = 0.8
) -> Rectangle:
    """Returns a block of a diagram with a text in it, and with its centre at (i, j)."""
    corner = i - width / 2, j - height / 2
    block = Rectangle(corner, width, height, fc="white", ec="black", zorder=3)
    ax.add_patch(block)
    ax.text(i, j, text, size=SIZE, ha="center", va="center", zorder=4)
    return block


def plus(ax: Axes, i: float, j: float) -> Text:
    """Returns the circle of a diagram at (i, j) in which signals are added."""
    frame = {"boxstyle": "circle,pad=0.15", "fc": "white", "ec": "black"}
    return ax.text(i, j, "+", size=SIZE, ha="center", va="center", bbox=frame, zorder=6)


def wire(ax: Axes, *corners: Point) -> Line2D:
    """Returns a line of a diagram through its corners, with an arrowhead at the last of them."""
    i, j = zip(*[(float(x), float(y)) for x, y in corners])
    [line] = ax.plot(i, j, color="black", lw=1.5, zorder=2)
    arrow(ax, corners[-2], corners[-1], width=1.5)
    return line


def state_space(ax: Axes) -> Axes:
    """Returns ax with the block diagram of ``x[k+1] = f(x, u) + w`` and ``y[k] = g(x, u) + n``."""
    ax.set(xlim=(-0.1, 9.8), ylim=(0, 3.9), aspect="equal")
    ax.axis("off")
    for i, j, text in ((2, 2.6, "$f$"), (6.4, 2.6, "one step\nlater"), (6.4, 0.6, "$g$")):
        box(ax, i, j, text)
    wire(ax, (0, 2.8), (1.25, 2.8))  # the input, to f and to g
    wire(ax, (0.6, 2.8), (0.6, 0.6), (5.65, 0.6))
    wire(ax, (2.75, 2.6), (3.78, 2.6))  # f and the noise, to the next state
    wire(ax, (4, 3.7), (4, 2.82))
    wire(ax, (4.22, 2.6), (5.65, 2.6))
    wire(ax, (6.4, 2.2), (6.4, 1.0))  # the state, to g and back to f
    wire(ax, (6.4, 1.55), (0.9, 1.55), (0.9, 2.4), (1.25, 2.4))
    wire(ax, (7.15, 0.6), (7.98, 0.6))  # g and the noise, to the observation
    wire(ax, (8.2, 1.6), (8.2, 0.82))
    wire(ax, (8.42, 0.6), (9.6, 0.6))
    ax.plot([0.6, 6.4], [2.8, 1.55], "ko", ms=5)
    for i, j in ((4, 2.6), (8.2, 0.6)):
        plus(ax, i, j)
    names = [(0, 3.0, "u_k"), (3.5, 3.5, "w_k"), (4.4, 2.85, "x_{k+1}"), (3, 1.7, "x_k")]
    for i, j, name in [*names, (8.35, 1.4, "n_k"), (9.1, 0.8, "y_k")]:
        word(ax, i, j, f"${name}$")
    return ax


def planning_loop(ax: Axes) -> Axes:
    """Returns ax with the loop of model predictive control: plan, drive one step, look, plan."""
    ax.set(xlim=(-0.2, 10.2), ylim=(-0.3, 3.9), aspect="equal")
    ax.axis("off")
    box(ax, 1.1, 3.2, "reached?", width=2.2)
    box(ax, 4.6, 2.6, "plan\n$T$ steps", width=2.0, height=1.2)
    box(ax, 8.4, 2.6, "car", width=1.6, height=1.2)
    wire(ax, (2.2, 3.2), (2.9, 3.2), (2.9, 2.9), (3.6, 2.9))  # the target
    wire(ax, (5.6, 2.6), (7.6, 2.6))  # the first input
    wire(ax, (8.4, 2.0), (8.4, 0.62))  # what is seen of the car, and noise
    wire(ax, (9.9, 0.4), (8.62, 0.4))
    wire(ax, (8.18, 0.4), (2.9, 0.4), (2.9, 2.3), (3.6, 2.3))  # to the planner
    wire(ax, (2.9, 0.4), (1.1, 0.4), (1.1, 2.8))  # and to the list of waypoints
    ax.plot(2.9, 0.4, "ko", ms=5)
    plus(ax, 8.4, 0.4)
    words = [(2.3, 3.4, "target"), (5.7, 2.75, "first input"), (9.1, 0.6, "noise")]
    for i, j, text in [*words, (4.2, 0.6, "what the car sees")]:
        word(ax, i, j, text)
    return ax
