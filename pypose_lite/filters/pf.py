"""The particle filter: a belief of any shape, kept as many weighted guesses of the state."""

import warnings
from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from .base import Filter
from .gaussian import (
    Innovation,
    covariance,
    each,
    factor,
    innovation,
    known_rows,
    log_density,
    spread,
)

FEW, RARE = 10, 0.001  # fewer effective particles, or a smaller share, are no sample of a belief


class Particles(NamedTuple):
    """A belief: N states ``x (..., N, n)`` and the logarithms of their weights ``(..., N)``."""

    x: Tensor
    log_w: Tensor

    @property
    def w(self) -> Tensor:
        """The weights, of sum 1, ``(..., N)``."""
        return self.log_w.softmax(-1)

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

    Source: A. Scibior, F. Wood, "Differentiable particle filtering without modifying the forward
    pass" (2021); R. Douc, O. Cappe, "Comparison of resampling schemes" (2005).
    """
    log_w = particles.log_w.log_softmax(-1)
    x = particles.x.expand(*log_w.shape, -1)
    ends = log_w.detach().double().exp().cumsum(-1)
    ends = ends / ends[..., -1:]  # the last is 1 whatever was rounded
    taken = torch.searchsorted(ends, positions.double().expand(ends.shape).contiguous())
    log_w = log_w.gather(-1, taken)
    return Particles(x.gather(-2, taken.unsqueeze(-1).expand(x.shape)), log_w - log_w.detach())


class PF(Filter):
    """Particle filter: ``x[i+1], P = pf(x[i], y[i], u[i], P, Q, R)``.

    Draws N particles, weighs each by how well it explains y, moves each through f, and returns
    their mean and covariance:

        x_k = x + L z_k,  z_k ~ N(0, I),  L L' = P                        (1)
        log w_k = log N(y - g(x_k, u, t); 0, R) + a constant              (2)
        x' = sum w_k f(x_k, u, t)                                         (3)
        P' = sum w_k (f(x_k, u, t) - x')(f(x_k, u, t) - x')' + Q          (4)

    A belief that is no Gaussian, such as one of two humps, lives only in the particles. Keep
    them: ``particles = pf.draw(x, P)``, then ``particles = pf.step(particles, y[i], u[i])``.

    Gradients are those of (1) to (4) with the draws z held fixed: exact for the estimate that is
    returned, at the price of one backward pass; they tend to those of the true mean and
    covariance as 1/sqrt(N). :func:`resample` says how gradients pass ``step``.

    Args:
        model: the system; no Jacobian is taken.
        Q: process noise covariance ``(..., n, n)``, symmetric >= 0.
        R: observation noise covariance ``(..., p, p)``, symmetric > 0.
        particles: their number N.
        residual: the difference of two observations, for angles.

    Arguments and errors are those of :class:`GaussianFilter`; random numbers come from
    ``generator``, None being torch's own. Warns where fewer than
    10 particles, or one in a thousand, are effective.

    Source: D. Simon, "Optimal State Estimation" (2006), section 15.2.
    """

    def __init__(self, model, Q=None, R=None, particles=1000, *, residual=None):
        super().__init__(model, Q, R, residual=residual)
        if particles < 1:
            raise ValueError(f"particles: expected at least 1, got {particles}")
        self.particles = particles

    def forward(self, x, y, u, P, Q=None, R=None, t=None, generator=None):
        """Returns x and P of the next state: corrected with y, then predicted.

        ``y=None`` predicts only.
        """
        if y is None:
            return self.predict(x, u, P, Q, t, generator)
        x, y, u, P, Q, R = self._inputs(x=x, y=y, u=u, P=P, Q=Q, R=R)
        particles = self._weigh(self._draw(x, P, generator), y, u, R, t)
        return self._moments(particles, u, Q, t)

    def update(self, x, y, u, P, R=None, t=None, generator=None) -> tuple[Tensor, Tensor]:
        """Returns x and P of the same state, once y is known."""
        x, y, u, P, R = self._inputs(x=x, y=y, u=u, P=P, R=R)
        particles = self._weigh(self._draw(x, P, generator), y, u, R, t)
        return particles.mean, particles.covariance

    def predict(self, x, u, P, Q=None, t=None, generator=None) -> tuple[Tensor, Tensor]:
        """Returns x and P of the next state."""
        x, u, P, Q = self._inputs(x=x, u=u, P=P, Q=Q)
        return self._moments(self._draw(x, P, generator), u, Q, t)

    def innovation(self, x, y, u, P, R=None, t=None, generator=None) -> Innovation:
        """Returns what y says beyond the expected, and its covariance, as N particles see it."""
        x, y, u, P, R = self._inputs(x=x, y=y, u=u, P=P, R=R)
        dx = (self._draw(x, P, generator).x - x.unsqueeze(-2)).mT
        w = dx.new_full(dx.shape[-1:], 1 / self.particles)
        joint = spread(lambda x: self.model.observe(x, u, t), x, dx, w, self.residual)
        return innovation(y, joint, R, self.residual)

    def draw(self, x, P, generator=None) -> Particles:
        """Returns N particles of equal weight from N(x, P)."""
        x, P = self._inputs(x=x, P=P)
        return self._draw(x, P, generator)

    def weigh(self, particles, y, u, R=None, t=None) -> Particles:
        """Returns the particles with the weights that they have once y is known."""
        x, log_w, y, u, R = self._inputs(
            particles=particles.x, weights=particles.log_w, y=y, u=u, R=R
        )
        return self._weigh(Particles(x, log_w), y, u, R, t)

    def log_likelihood(self, particles, y, u, R=None, t=None) -> Tensor:
        """Returns the logarithm of y's density ``(...)``, the mean over the particles."""
        x, log_w, y, u, R = self._inputs(
            particles=particles.x, weights=particles.log_w, y=y, u=u, R=R
        )
        return (log_w.log_softmax(-1) + self._explain(x, y, u, R, t)).logsumexp(-1)

    def move(self, particles, u, Q=None, t=None, generator=None) -> Particles:
        """Returns the particles one step later, each with process noise of its own."""
        x, log_w, u, Q = self._inputs(particles=particles.x, weights=particles.log_w, u=u, Q=Q)
        x = self._each(self.model.transition, x, u, t)
        z = torch.randn(x.shape, generator=generator, dtype=x.dtype, device=x.device)
        return Particles(x + z @ factor(Q, "Q").mT, log_w)

    def step(self, particles, y, u, Q=None, R=None, t=None, generator=None, scheme=systematic):
        """Returns the particles of the next state: weighed, resampled if need be, moved.

        They are resampled where fewer than half are effective. ``y=None`` only moves them.
        """
        if y is not None:
            particles = self.weigh(particles, y, u, R, t)
        x, log_w = particles
        r = torch.rand(log_w.shape, generator=generator, dtype=x.dtype, device=x.device)
        fresh = resample(particles, scheme(1 - r))
        few = (particles.effective < x.shape[-2] / 2).unsqueeze(-1)
        x = torch.where(few.unsqueeze(-1), fresh.x, x)
        return self.move(Particles(x, torch.where(few, fresh.log_w, log_w)), u, Q, t, generator)

    def _draw(self, x, P, generator):
        size = (*x.shape[:-1], self.particles, x.shape[-1])
        z = _matched(torch.randn(size, generator=generator, dtype=x.dtype, device=x.device))
        return Particles(x.unsqueeze(-2) + z @ factor(P).mT, z.new_zeros(size[:-1]))  # (1)

    def _weigh(self, particles, y, u, R, t):
        log_w = particles.log_w + self._explain(particles.x, y, u, R, t)  # (2)
        particles = particles._replace(log_w=log_w)
        least, N = particles.effective.min().item(), log_w.shape[-1]
        if least < min(max(FEW, RARE * N), N / 2):
            warnings.warn(
                f"PF: {least:.1f} of {N} particles are effective: y is far from nearly all",
                stacklevel=3,
            )
        return particles

    def _explain(self, x, y, u, R, t):
        """Returns the log-likelihood of y for each particle, ``(..., N)``."""
        z = self._each(self.model.observe, x, u, t)
        e, R, known = known_rows(y.unsqueeze(-2), z, R.unsqueeze(-3), self.residual)
        rows = R.shape[-1] if known is None else known.squeeze(-2).sum(-1, keepdim=True)
        return log_density(e.mT, R.squeeze(-3), rows, "R")

    def _moments(self, particles, u, Q, t):
        moved = particles._replace(x=self._each(self.model.transition, particles.x, u, t))
        x = moved.mean  # (3)
        return x, covariance(moved.covariance + Q)  # (4)

    def _each(self, function: Callable, x: Tensor, u: Tensor, t) -> Tensor:
        """Returns function at each particle, ``(..., N, n) -> (..., N, p)``."""
        return each(lambda x: function(x, u, t), x.movedim(-2, 0)).movedim(0, -2)


def _matched(z: Tensor) -> Tensor:
    """Returns the draws z ``(..., N, n)`` moved and stretched to have mean 0 and covariance I."""
    N, n = z.shape[-2:]
    if N <= n:
        return z
    z = z - z.mean(-2, keepdim=True)
    L = torch.linalg.cholesky(z.mT @ z / N)
    return torch.linalg.solve_triangular(L, z.mT, upper=False).mT
