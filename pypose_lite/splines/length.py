"""How long a curve is, and the parameters at given distances along it.

The parameter of a spline says nothing of metres: between two points that are close together the
curve is slow. The length is the integral of the speed, for which there is no formula. Where the
curve nearly stops and turns back, at a cusp, the speed has a sharp bend that no smooth rule
sees. So `_mesh` first halves the worst piece of each segment until two rules of different
precision agree on all of them: adaptive quadrature. The pieces found, a length is a fixed
weighted sum of speeds, which can be differentiated and batched. `parameter_at` looks up the
piece that a distance falls into, and searches in that piece by Newton's method.

Source: Piessens et al., "QUADPACK", 1983: the rules of Gauss (10 nodes) and Kronrod (21).
"""

import numpy as np
import torch
from torch import Tensor

from ..lie import is_SE3
from ..lie.taylor import safe_norm
from ..shapes import check, has_numbers
from .curve import Spline

# Kronrod's rule on [-1, 1]: half of its nodes, from the outermost to the middle, and weights.
HALF_NODES = [
    *(0.995657163025808080735527280689003, 0.973906528517171720077964012084452),
    *(0.930157491355708226001207180059508, 0.865063366688984510732096688423493),
    *(0.780817726586416897063717578345042, 0.679409568299024406234327365114874),
    *(0.562757134668604683339000099272694, 0.433395394129247190799265943165784),
    *(0.294392862701460198131126603103866, 0.148874338981631210884826001129720),
    0.0,
]
HALF_WEIGHTS = [
    *(0.011694638867371874278064396062192, 0.032558162307964727478818972459390),
    *(0.054755896574351996031381300244580, 0.075039674810919952767043140916190),
    *(0.093125454583697605535065465083366, 0.109387158802297641899210590325805),
    *(0.123491976262065851077958109831074, 0.134709217311473325928054001771707),
    *(0.142775938577060080797094273138717, 0.147739104901338491374841515972068),
    0.149445554002916905664936468389821,
]
# The same on [0, 1], in rising order; every second node is one of Gauss's.
NODES = torch.tensor([-x for x in HALF_NODES] + HALF_NODES[-2::-1], dtype=torch.float64) / 2 + 0.5
KRONROD = torch.tensor(HALF_WEIGHTS + HALF_WEIGHTS[-2::-1], dtype=torch.float64) / 2
GAUSS = torch.zeros_like(KRONROD)
GAUSS[1::2] = torch.from_numpy(np.polynomial.legendre.leggauss(10)[1]) / 2

AGREED = 1e-10  # of a segment's length, or 32 units of rounding: there two rules agree
HALVINGS = 24  # of each segment's worst piece; an exact cusp needs about 13
SEARCH = 60  # bisections, at the worst, to find a length; Newton needs about 5


def arc_length(spline: Spline) -> Tensor:
    """The distance ``(..., S + 1)`` along the curve from its start to every knot.

    For poses it is the distance that the translation travels, for rotations the angle, rad.
    """
    each = _pieces(spline)[1].sum(-1)
    return torch.cat([torch.zeros_like(each[..., :1]), each.cumsum(-1)], -1)


def parameter_at(spline: Spline, distance: Tensor) -> Tensor:
    """The parameters ``(..., M)`` at which the curve has gone the ``distance`` (M,) or (..., M).

    Distances before the start or beyond the end give the ends. The gradient, and that of the
    gradient, are those of the implicit function; they are 0 where the curve rests.
    """
    check("distance: M", distance)
    segment, low, high, rest = _look_up(spline, distance)
    pieces = spline.take(segment)
    with torch.no_grad():
        u = _search(pieces, low, high, rest)
    for _ in range(2):  # from the root, two of Newton's steps carry two derivatives
        speed = _speed(pieces, u)
        slope = torch.where(speed > 0, speed, 1)
        u = u - torch.where(speed > 0, (_length(pieces, low, u) - rest) / slope, 0)
    return spline.parameter(segment, u.clamp(0, 1))


def evenly_spaced(spline: Spline, count: int) -> Tensor:
    """The parameters ``(..., count)`` of points at equal distances, both ends included."""
    if count < 2:
        raise ValueError(f"count: expected at least 2, got {count}")
    total = arc_length(spline)[..., -1:]
    share = torch.linspace(0, 1, count, dtype=total.dtype, device=total.device)
    return parameter_at(spline, total * share)


def _look_up(spline: Spline, distance: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """For each distance the segment, where its piece begins and ends, and what is left in it."""
    mesh, length = _pieces(spline)
    batch = torch.broadcast_shapes(length.shape[:-2], distance.shape[:-1])
    gone = torch.cat([torch.zeros_like(length[..., 0, :1]), length.flatten(-2).cumsum(-1)], -1)
    gone = gone.expand(*batch, -1)
    distance = distance.expand(*batch, -1).clamp(min=0).minimum(gone[..., -1:])
    ends = gone[..., 1:].detach().contiguous()
    piece = torch.searchsorted(ends, distance.detach().contiguous()).clamp(max=ends.shape[-1] - 1)
    low, high, before = (
        x.expand(*batch, -1).take_along_dim(piece, -1)
        for x in (mesh[..., :-1].flatten(-2), mesh[..., 1:].flatten(-2), gone)
    )
    return piece // length.shape[-1], low, high, distance - before


def _search(pieces: Spline, low: Tensor, high: Tensor, rest: Tensor) -> Tensor:
    """The u in [low, high] where ``rest`` is gone: Newton's steps, or halving where they leave."""
    start, whole = low, _length(pieces, low, high)
    u = torch.where(whole > 0, low + (high - low) * rest / whole, low)  # exact at both ends
    for _ in range(SEARCH):
        excess = _length(pieces, start, u) - rest
        low, high = torch.where(excess < 0, u, low), torch.where(excess < 0, high, u)
        newton = u - excess / _speed(pieces, u)  # outside, or NaN, where the curve rests
        inside = (newton >= low) & (newton <= high)
        before, u = u, torch.where(inside, newton, (low + high) / 2)
        settled = (u - before).abs() < torch.finfo(u.dtype).eps ** 0.5  # the next would square it
        if has_numbers(settled) and settled.all():
            break
    return u


def _pieces(spline: Spline) -> tuple[Tensor, Tensor]:
    """The mesh of every segment ``(..., S, P + 1)``, and how long each piece is, (..., S, P)."""
    mesh = _mesh(spline)
    return mesh, _length(spline.spread(), mesh[..., :-1], mesh[..., 1:])


@torch.no_grad()
def _mesh(spline: Spline) -> Tensor:
    """The u between which the speed is smooth, from 0 to 1: ``(..., S, P + 1)``.

    All segments have as many pieces as the one that needs most; where the rules agree, the others'
    are empty. Inside ``torch.vmap``, where nobody can look, the loop runs as long as it may.
    """
    speed = _speed(spline, spline.start.new_zeros(spline.segments))
    low, high = torch.zeros_like(speed)[..., None], torch.ones_like(speed)[..., None]
    length, doubt = _estimate(spline, low, high)
    agreed = max(AGREED, 32 * torch.finfo(speed.dtype).eps)
    for _ in range(HALVINGS):
        done = (doubt <= agreed * length.sum(-1, keepdim=True)).all(-1, keepdim=True)
        if has_numbers(done) and done.all():
            break
        worst = doubt.argmax(-1, keepdim=True)
        a, b = low.take_along_dim(worst, -1), high.take_along_dim(worst, -1)
        middle = torch.where(done, b, (a + b) / 2)
        halves = _estimate(spline, torch.cat([a, middle], -1), torch.cat([middle, b], -1))
        chosen = torch.arange(low.shape[-1], device=worst.device) == worst
        low, high = torch.cat([low, middle], -1), torch.where(chosen, middle, high)
        high = torch.cat([high, b], -1)
        length, doubt = (
            torch.cat([torch.where(chosen, new[..., :1], old), new[..., 1:]], -1)
            for old, new in zip((length, doubt), halves)
        )
    return torch.cat([low.sort(-1).values, torch.ones_like(low[..., :1])], -1)


def _estimate(spline: Spline, low: Tensor, high: Tensor) -> tuple[Tensor, Tensor]:
    """The lengths of pieces (..., S, P), and by how much the two rules disagree on them."""
    gap = high - low
    speed = _speed(spline.spread().spread(), low[..., None] + gap[..., None] * NODES.to(low))
    length, rough = (gap * (speed @ weights.to(low)) for weights in (KRONROD, GAUSS))
    return length, (length - rough).abs()


def _length(pieces: Spline, low: Tensor, high: Tensor) -> Tensor:
    """The distance gone from ``low (...)`` to ``high (...)``, one pair for each of the pieces."""
    gap = high - low
    speed = _speed(pieces.spread(), low[..., None] + gap[..., None] * NODES.to(low))
    return gap * (speed @ KRONROD.to(low))


def _speed(pieces: Spline, u: Tensor) -> Tensor:
    """The length of the first derivative with respect to u."""
    velocity = pieces.local(u, 1)
    return safe_norm(velocity[..., :3] if is_SE3(pieces.start) else velocity)
