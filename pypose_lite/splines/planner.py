"""A local plan: from where the car is, a smooth path through the waypoints that lie ahead.

It is what the closed loop aims at: an MPC is given the states of `local_plan`, in every step anew.
First `_ahead` puts the car's state before the waypoints that are left; then `path` joins them by
cubic Hermite segments that leave the car in the car's direction and pass every waypoint in the
waypoint's; last, states are taken from the path at equal distances.

A tangent belongs to one place only. So a shift of the car bends the path up to the next waypoint,
and there it has merged, exactly, into the path of a car without a shift. Chapter 6 of the book
draws both.
"""

import torch
from torch import Tensor

from ..lie.taylor import safe_norm
from ..shapes import check, has_numbers
from .cubic_hermite import hermite_segments
from .curve import Spline
from .geometry import heading
from .length import parameter_at


def local_plan(
    x: Tensor, waypoints: Tensor, index: Tensor | int, spacing: float = 0.1, count: int = 20
) -> Tensor:
    """The states ``(..., count, 4)`` ahead of each car, equally far apart along its path.

    The first is where the car is; where the path is shorter, the last waypoint is repeated.

    Args:
        x: the cars' states [i, j, cos, sin] (..., 4), m; an estimate's (cos, sin) may have any
            length.
        waypoints: states (K, 4) or (..., K, 4), in the order of the visits.
        index: the number (...) of each car's next waypoint, 0 to K - 1.
        spacing: the distance from one state to the next, m, > 0.
        count: how many states, > 0.

    Raises:
        ValueError: no such waypoint, or a spacing or count that is not positive.
    """
    if not (spacing > 0 and count > 0):
        raise ValueError(f"spacing, count: expected both > 0, got {spacing} and {count}")
    states = _ahead(x, waypoints, index)
    curve = path(states)
    t = parameter_at(curve, spacing * torch.arange(count, dtype=x.dtype, device=x.device))
    segment, _ = curve.locate(t)
    arriving = states[..., 1:, 2:].take_along_dim(segment[..., None], -2)
    return torch.cat([curve(t), heading(curve(t, derivative=1), still=arriving)], -1)


def path(states: Tensor) -> Spline:
    """The planar curve through ``states (..., K, 4)`` in the directions that they have.

    Between two states a chord c apart, with headings h and k, both tangents are as long as

        4 c / (2 + |h + k|),                                                        (1)

    which is what makes a cubic follow an arc: for the turn theta between the headings it equals
    c / cos(theta / 4)^2, and the cubic is within 4e-6 of the radius of a circle for 45 degrees.
    The direction is continuous at the states; the speed, which depends on the chord, may jump.
    """
    check("states: K n", states, n=4)
    place, direction = states[..., :2], heading(states[..., 2:])
    h, k = direction[..., :-1, :], direction[..., 1:, :]
    c = safe_norm(place[..., 1:, :] - place[..., :-1, :], keepdim=True)
    length = 4 * c / (2 + safe_norm(h + k, keepdim=True))  # (1)
    return hermite_segments(place, length * h, length * k)


def _ahead(x: Tensor, waypoints: Tensor, index: Tensor | int) -> Tensor:
    """Each car's state and the waypoints before it (..., M, 4), the last one repeated."""
    index = torch.as_tensor(index, device=x.device)
    K = check("waypoints: K n, x: n, index:", waypoints, x, index.to(x.dtype), n=4)["K"]
    known = has_numbers(index)
    if index.is_floating_point() or known and ((index < 0) | (index >= K)).any():
        raise ValueError(f"index: expected whole numbers from 0 to {K - 1}, got {index.tolist()}")
    batch = torch.broadcast_shapes(x.shape[:-1], waypoints.shape[:-2], index.shape)
    left = K - int(index.min()) if known else K
    number = (index[..., None] + torch.arange(left, device=index.device)).clamp(0, K - 1)
    number = number.expand(*batch, left)[..., None]
    chosen = waypoints.expand(*batch, K, 4).take_along_dim(number, -2)
    return torch.cat([x.expand(*batch, 4)[..., None, :], chosen], -2)
