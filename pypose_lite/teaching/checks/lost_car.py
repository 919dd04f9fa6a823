"""Recordings for lab 5: of a car that hears how far three posts are."""

import math

import torch
from torch import Tensor

from ...systems import DubinsCar

POSTS = torch.tensor([[0.0, 2.0], [2.5, -1.0], [-2.5, -1.0]], dtype=torch.float64)  # m


def drive(seed: int, steps: int = 60) -> tuple[Tensor, Tensor, Tensor]:
    """Returns states ``(steps, 4)``, inputs ``(steps, 2)`` and distances ``(steps, 3)``.

    Args:
        seed: another one makes another car: another heading, other bends, other noise.
        steps: of 0.1 s each.
    """
    g = torch.Generator().manual_seed(2000 + seed)
    heading = 2 * math.pi * torch.rand((), generator=g, dtype=torch.float64)
    bends = 0.6 + 0.6 * torch.rand(2, generator=g, dtype=torch.float64)
    turn = torch.cat([bends[0].expand(steps // 2), -bends[1].expand(steps - steps // 2)])
    u = torch.stack([torch.full_like(turn, 1.0), turn], dim=-1)
    car = DubinsCar(0.1)
    x = [torch.stack([0 * heading, 0 * heading, heading.cos(), heading.sin()])]
    for given in u[:-1]:
        w = 0.005 * torch.randn(4, generator=g, dtype=torch.float64)
        x.append(car.transition(x[-1], given) + w)
    states = torch.stack(x)
    distances = (states[:, None, :2] - POSTS).norm(dim=-1)
    heard = distances + 0.1 * torch.randn(steps, 3, generator=g, dtype=torch.float64)
    return states, u, heard
