"""Roll, pitch and yaw: three turns in place of a quaternion, for people and file formats.

A rotation is a turn by roll about x, then by pitch about y, then by yaw about z, all about the
axes of the outer frame. At a pitch of 90 degrees roll and yaw turn about the same axis (gimbal
lock): only their difference matters there, and no formula can tell them apart.
"""

import torch
from torch import Tensor

from ..shapes import check
from .space import so3_compose, so3_exp
from .taylor import safe_norm


def so3_from_euler(angles: Tensor) -> Tensor:
    """The quaternion ``exp(yaw e_z) exp(pitch e_y) exp(roll e_x) (..., 4)``.

    Args:
        angles: roll, pitch and yaw (..., 3), rad.
    """
    check("angles: n", angles, n=3)
    axes = torch.eye(3, dtype=angles.dtype, device=angles.device)
    roll, pitch, yaw = (so3_exp(angles[..., i : i + 1] * axes[i]) for i in range(3))
    return so3_compose(yaw, so3_compose(pitch, roll))


def so3_euler(q: Tensor, eps: float = 2e-4) -> Tensor:
    """The roll, pitch and yaw ``(..., 3)``, rad, with `so3_from_euler` of them equal to ``q``.

    Pitch lies in [-pi/2, pi/2]. Where ``abs(sin(pitch)) >= 1 - eps``, the roll is set to 0, as
    in PyPose: the angles then give back a rotation that is up to 0.03 rad off for the default.

    Args:
        q: unit quaternions x, y, z, w (..., 4).
        eps: how near to the gimbal lock roll is given up.
    """
    check("q: n", q, n=4)
    x, y, z, w = q.unbind(-1)
    # the first column and the last row of the matrix: cos(pitch) times cosines and sines
    yaw_cos, yaw_sin = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z)
    roll_cos, roll_sin = 1 - 2 * (x * x + y * y), 2 * (y * z + w * x)
    sin = 2 * (w * y - x * z)
    locked = sin.abs() >= 1 - eps
    pitch = torch.atan2(sin, safe_norm(torch.stack([yaw_cos, yaw_sin], -1)))
    roll = torch.atan2(torch.where(locked, 0, roll_sin), torch.where(locked, 1, roll_cos))
    # the angle not taken is that of (0, 1): atan2 has no gradient at (0, 0)
    both = -2 * sin.sign() * torch.atan2(torch.where(locked, x, 0), torch.where(locked, w, 1))
    alone = torch.atan2(torch.where(locked, 0, yaw_sin), torch.where(locked, 1, yaw_cos))
    return torch.stack([roll, pitch, torch.where(locked, both, alone)], -1)
