"""Particles: a belief of any shape, as N weighted guesses of the state, and their resampling.

Weights are kept as logarithms, since a product of many likelihoods is too small for a float. A
particle with ``log_w = -inf`` has weight 0: it counts for nothing and is never taken, but there
must be others. If a member of a batch has no particle of any weight, its belief is gone, and that
is a ValueError, as no number can be returned for it.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from ..shapes import check, has_numbers
from .gaussian import covariance


class Particles(NamedTuple):
    """A belief: N states ``x (..., N, n)`` and the logarithms of their weights ``(..., N)``."""

    x: Tensor
    log_w: Tensor

    @property
    def w(self) -> Tensor:
        """The weights, of sum 1, ``(..., N)``."""
        w = self.log_w.softmax(-1)
        if has_numbers(w) and math.isnan(w.sum().item()):
            check_weights(self.log_w)
        return w

    @property
    def whole(self) -> "Particles":
        """The same particles, states and weights expanded to the batch that they make together."""
        if self.x.shape[:-1] == self.log_w.shape:
            return self
        lead = torch.broadcast_shapes(self.x.shape[:-1], self.log_w.shape)
        return Particles(self.x.expand(*lead, -1), self.log_w.expand(lead))

    @property
    def mean(self) -> Tensor:
        """The mean, ``(..., n)``."""
        return (self.w.unsqueeze(-2) @ self.x).squeeze(-2)

    @property
    def covariance(self) -> Tensor:
        """The covariance, ``(..., n, n)``."""
        e = self.x - self.mean.unsqueeze(-2)
        return covariance((self.w.unsqueeze(-1) * e).mT @ e)

    @property
    def effective(self) -> Tensor:
        """The effective sample size ``1 / sum w^2``, from 1 to N, ``(...)``."""
        return 1 / self.w.square().sum(-1)


def systematic(r: Tensor) -> Tensor:
    """Returns N evenly spaced positions in (0, 1], moved by the first of ``r (..., N)``."""
    N = r.shape[-1]
    return (torch.arange(N, dtype=r.dtype, device=r.device) + r[..., :1]) / N


def multinomial(r: Tensor) -> Tensor:
    """Returns the N independent positions ``r (..., N)``, which are noisier."""
    return r


def resample(particles: Particles, positions: Tensor) -> Particles:
    """Returns N particles of equal weight: at each position, a copy of the one it falls on.

    The weights, cumulated, divide (0, 1]; a position falls on the particle whose part holds it,
    never on one without weight, never beyond the last.

    A new weight has the value 1/N and the gradient of the old one: the choice is made with the
    old weights, so it is right on average that its gradient is theirs. Such gradients are those
    of the true mean as N grows, but noisy, the more so the more often particles are resampled.

    Args:
        particles: N of them.
        positions: ``(..., N)`` in (0, 1], see :func:`systematic`.

    Raises:
        ValueError: where all particles have weight 0, or a weight is not a number.

    Source: A. Scibior, F. Wood, "Differentiable particle filtering without modifying the forward
    pass" (2021); R. Douc, O. Cappe, "Comparison of resampling schemes" (2005).
    """
    log_w = particles.log_w.log_softmax(-1)
    x = particles.x.expand(*log_w.shape, -1)
    ends = log_w.detach().double().exp().cumsum(-1)
    if has_numbers(ends) and not math.isfinite(ends[..., -1].sum().item()):
        check_weights(particles.log_w)
    if has_numbers(positions) and not (0 <= positions.min() and positions.max() <= 1):
        raise ValueError("positions: expected numbers in (0, 1]")
    ends = ends / ends[..., -1:]  # the last is 1 whatever was rounded
    positions = positions.double().clamp(min=torch.finfo(torch.float64).tiny)
    taken = torch.searchsorted(ends, positions.expand(ends.shape).contiguous())
    log_w = log_w.gather(-1, taken)
    return Particles(x.gather(-2, taken.unsqueeze(-1).expand(x.shape)), log_w - log_w.detach())


def stand_ins(x: Tensor, log_w: Tensor) -> Tensor:
    """Returns the states ``(..., N, n)``, each without weight replaced by the heaviest.

    A function may not be defined where a particle has weight 0. Asked there all the same, it would
    return NaN, and 0 times NaN is NaN, in a mean as in a gradient.
    """
    if has_numbers(log_w) and math.isfinite(log_w.sum().item()):
        return x
    x = x.expand(*log_w.shape, -1)
    heaviest = log_w.argmax(-1)[..., None, None].expand(*log_w.shape[:-1], 1, x.shape[-1])
    return torch.where(log_w.isneginf().unsqueeze(-1), x.gather(-2, heaviest), x)


def check_weights(log_w: Tensor, why: str = "log_w is -inf") -> None:
    """Raises ValueError for a weight that is no number, and where all of a member are 0."""
    if not has_numbers(log_w) or math.isfinite(log_w.sum().item()):
        return
    check("weights: N", log_w.masked_fill(log_w.isneginf(), 0))
    gone = log_w.isneginf().all(-1)
    if gone.any():
        member = f" of member {tuple(gone.nonzero()[0].tolist())} of the batch" * (gone.ndim > 0)
        raise ValueError(
            f"weights: all {log_w.shape[-1]} particles{member} have weight 0 ({why}), so that no "
            "belief is left; draw particles where g is defined and y is likely, or pass y=None"
        )
