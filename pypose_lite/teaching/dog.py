"""The dog from above: one picture for a film on the page and for a live view in JupyterLab."""

import math
from collections.abc import Callable

import torch
from matplotlib.axes import Axes
from torch import Tensor

from ..shapes import check
from . import plotting

RIGHT = [[0.34, -0.06], [0.27, -0.06], [0.24, -0.11], [-0.32, -0.11]]  # head to tail
BODY = torch.tensor([*RIGHT, *([x, -y] for x, y in RIGHT[::-1])])  # m, about a Go1's
FEET = torch.tensor([[0.19, -0.16], [0.19, 0.16], [-0.19, -0.16], [-0.19, 0.16]])  # FR FL RR RL
TROT = torch.tensor([[0.06, 0.0], [-0.06, 0.0], [-0.06, 0.0], [0.06, 0.0]])  # crosswise, in pairs
STRIDE = 0.2  # rad of the gait for each centimetre walked


def from_above(ax: Axes, label: str = "observations") -> Callable[[Tensor], None]:
    """Returns a function that shows states ``(T, 4)``: a dog where the last is, and its way there.

    Its feet move with the way that it has walked; how is decoration, not a model.

    Args:
        ax: where to draw, in metres.
        label: of the way, in a legend.
    """
    [trail] = ax.plot([], [], ".-", lw=1, ms=5, color=plotting.BLUE, label=label)
    [body] = ax.fill(*BODY.mT, color=plotting.GREY, alpha=0.85, zorder=5)
    forward, left = FEET.mT
    feet = ax.scatter(forward, left, s=22, color="black", zorder=4)

    def show(x: Tensor) -> None:
        check("x: T n", x, n=4)
        way = x.detach().cpu().double()
        walked = torch.linalg.vector_norm(way[:, :2].diff(dim=0), dim=-1).sum()
        swing = TROT.double() * math.sin(100 * STRIDE * walked)
        trail.set_data(*way[:, :2].mT)
        body.set_xy(_placed(BODY.double(), way[-1]))
        feet.set_offsets(_placed(FEET.double() + swing, way[-1]))

    return show


def _placed(points: Tensor, state: Tensor) -> Tensor:
    """Points ``(N, 2)`` of the body (forward, left) in the plane, for a state [i, j, cos, sin]."""
    i, j, c, s = state
    forward, left = points.unbind(-1)
    return torch.stack([i + c * forward - s * left, j + s * forward + c * left], dim=-1)
