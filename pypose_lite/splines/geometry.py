"""Where a planar curve heads and how tightly it turns, from its first two derivatives."""

import torch
from torch import Tensor

from ..lie.taylor import safe_norm
from ..shapes import check


def heading(velocity: Tensor, still: Tensor | None = None) -> Tensor:
    """The direction ``[cos, sin] (..., 2)`` of a planar curve.

    Args:
        velocity: its first derivative (..., 2) with respect to any parameter.
        still: what to return (..., 2) where the velocity is zero; ``[1, 0]`` if None.
    """
    ahead = torch.tensor([1, 0], dtype=velocity.dtype, device=velocity.device)
    still = ahead if still is None else still
    check("velocity: n, still: n", velocity, still, n=2)
    speed = safe_norm(velocity, keepdim=True)
    return torch.where(speed > 0, velocity / torch.where(speed > 0, speed, 1), still)


def curvature(velocity: Tensor, acceleration: Tensor) -> Tensor:
    """The curvature ``(...)`` of a planar curve, 1/m: positive to the left.

    At a cusp, where the curve rests for a moment and turns back, it has none; 0 stands there.

    Args:
        velocity: its first derivative (..., 2) with respect to any parameter.
        acceleration: its second derivative (..., 2).
    """
    check("velocity: n, acceleration: n", velocity, acceleration, n=2)
    (dx, dy), (ddx, ddy) = velocity.unbind(-1), acceleration.unbind(-1)
    speed = safe_norm(velocity)
    moving = speed > 0
    speed = torch.where(moving, speed, 1)
    turning = dx / speed * ddy - dy / speed * ddx  # a cube of a small speed would be lost
    return torch.where(moving, turning / speed**2, 0)
