"""The particle filters: a belief of any shape, as many weighted guesses of the state.

There are two. ``pf(x, y, u, P)``, PyPose's call, is the *Gaussian particle filter*: in every step
it draws particles anew from a mean and a covariance, and returns such a pair. ``pf.draw`` and then
``pf.step`` are the *bootstrap filter*: particles are kept from step to step, weighed by each
observation, resampled where most have lost their weight, and moved with noise of their own. Only
the second keeps a belief that is no Gaussian, such as one of two humps.

A particle at which g is not defined (``log`` of a negative number, NaN) explains nothing: it has
weight 0, see ``particles.py``. Where states have angles, particles are kept beside their mean,
so that one at -3.1 beside others at 3.1 becomes 3.18, and plain means of them are right.
"""

import math
import warnings
from numbers import Integral

import torch
from torch import Tensor

from ..shapes import has_numbers
from .base import Filter
from .function import Function, all_finite, finite, measured
from .gaussian import Innovation, covariance, factor, log_density
from .particles import Particles, check_weights, resample, stand_ins, systematic

FEW, RARE = 10, 0.001  # fewer effective particles, or a smaller share, are no sample of a belief


class PF(Filter):
    """Particle filter: ``x[i+1], P = pf(x[i], y[i], u[i], P, Q, R)``.

    Draws N particles, weighs each by how well it explains y, moves each through f, and returns
    their mean and covariance:

        x_k = x + L z_k,  z_k ~ N(0, I),  L L' = P                        (1)
        log w_k = log N(y - g(x_k, u, t); 0, R) + a constant              (2)
        x' = sum w_k f(x_k, u, t)                                         (3)
        P' = sum w_k (f(x_k, u, t) - x')(f(x_k, u, t) - x')' + Q          (4)

    This is the Gaussian particle filter. The bootstrap filter keeps its particles:
    ``particles = pf.draw(x, P)``, then ``particles = pf.step(particles, y[i], u[i])``.

    Gradients are those of (1) to (4) with the draws z held fixed: exact for the estimate that is
    returned, at the price of one backward pass; they tend to those of the true mean and
    covariance as 1/sqrt(N). :func:`resample` says how gradients pass ``step``.

    Args:
        model: the system; no Jacobian is taken.
        Q: process noise covariance ``(..., n, n)``, symmetric >= 0.
        R: observation noise covariance ``(..., p, p)``, symmetric > 0.
        particles: their number N.
        S: refused, as noises are independent here; EKF and UKF take correlated ones.
        residual: the difference of two observations, where they have angles.
        residual_x: the difference of two states, where they have angles.
        mean_x: the mean of weighted states; None follows from ``residual_x``.

    ``update``, ``innovation``, ``weigh`` and ``log_likelihood`` take a sensor of its own as ``g``,
    with its R and its ``residual``; the other arguments, too, are those of :class:`GaussianFilter`.
    Random numbers come from ``generator``, None being torch's own. Inside ``torch.vmap``, say
    ``randomness="different"`` there. Warns where fewer than 10 particles, or one in a thousand,
    are effective.

    Raises:
        ValueError: as a :class:`GaussianFilter`, and where no particle is left of any weight.

    Source: J. Kotecha, P. Djuric, "Gaussian particle filtering" (2003), for the call; N. Gordon,
    D. Salmond, A. Smith, "Novel approach to nonlinear/non-Gaussian Bayesian state estimation"
    (1993), for ``step``; D. Simon, "Optimal State Estimation" (2006), section 15.2.
    """

    def __init__(
        self,
        model,
        Q=None,
        R=None,
        particles=1000,
        *,
        S=None,
        residual=None,
        residual_x=None,
        mean_x=None,
    ):
        super().__init__(model, Q, R, residual=residual, residual_x=residual_x, mean_x=mean_x)
        if S is not None:
            raise ValueError("S: a PF takes no correlated noises; EKF and UKF do")
        if not isinstance(particles, Integral) or particles < 1:
            raise ValueError(f"particles: expected at least 1, got {particles!r}")
        self.particles = int(particles)

    def forward(self, x, y, u, P, Q=None, R=None, t=None, generator=None):
        """Returns x and P of the next state: corrected with y, then predicted.

        ``y=None`` predicts only.
        """
        if y is None:
            return self.predict(x, u, P, Q, t, generator)
        x, y, u, P, Q, R = self._inputs(x=x, y=y, u=u, P=P, Q=Q, R=R)
        particles = self._weigh(self._draw(x, P, generator), y, R, self._g(u, t, y.shape[-1]))
        return self._moments(particles, self._f(u, t, x.shape[-1]), Q)

    def update(self, x, y, u, P, R=None, t=None, generator=None, *, g=None, residual=None):
        """Returns x and P of the same state, once y is known."""
        (x, P), y, R, look = self._look(y, u, R, t, g, residual, x=x, P=P)
        return self.moments(self._weigh(self._draw(x, P, generator), y, R, look))

    def predict(self, x, u, P, Q=None, t=None, generator=None) -> tuple[Tensor, Tensor]:
        """Returns x and P of the next state."""
        x, u, P, Q = self._inputs(x=x, u=u, P=P, Q=Q)
        return self._moments(self._draw(x, P, generator), self._f(u, t, x.shape[-1]), Q)

    def innovation(self, x, y, u, P, R=None, t=None, generator=None, *, g=None, residual=None):
        """Returns what y says beyond the expected, and its covariance, as N particles see it."""
        (x, P), y, R, look = self._look(y, u, R, t, g, residual, x=x, P=P)
        known = ~y.isnan()
        look, y, R, *_ = measured(look, y, R)
        particles, _ = _images(look, self._draw(x, P, generator))
        z, dz = look.spread(stand_ins(*particles), particles.w)
        e, w = look.difference(y, z), particles.w.unsqueeze(-2)
        return Innovation(e, (w * dz) @ dz.mT + R, known.expand(e.shape))

    def draw(self, x, P, generator=None) -> Particles:
        """Returns N particles of equal weight from N(x, P)."""
        x, P = self._inputs(x=x, P=P)
        return self._draw(x, P, generator)

    def weigh(self, particles, y, u, R=None, t=None, *, g=None, residual=None) -> Particles:
        """Returns the particles with the weights that they have once y is known."""
        particles, y, R, look = self._look(y, u, R, t, g, residual, **_named(particles))
        return self._beside_mean(self._weigh(Particles(*particles), y, R, look))

    def log_likelihood(self, particles, y, u, R=None, t=None, *, g=None, residual=None) -> Tensor:
        """Returns the logarithm of y's density ``(...)``, the mean over the particles."""
        (x, log_w), y, R, look = self._look(y, u, R, t, g, residual, **_named(particles))
        return _explain(Particles(x, log_w.log_softmax(-1)), y, R, look).log_w.logsumexp(-1)

    def move(self, particles, u, Q=None, t=None, generator=None) -> Particles:
        """Returns the particles one step later, each with process noise of its own."""
        x, log_w, u, Q = self._inputs(**_named(particles), u=u, Q=Q)
        x, _ = _moved(Particles(x, log_w), self._f(u, t, x.shape[-1]))
        z = torch.randn(x.shape, generator=generator, dtype=x.dtype, device=x.device)
        return self._beside_mean(Particles(x + z @ factor(Q, "Q").mT, log_w))

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

    def moments(self, particles: Particles) -> tuple[Tensor, Tensor]:
        """Returns mean and covariance of particles by the filter's ``mean_x`` and ``residual_x``.

        Of particles that come from this filter, ``particles.mean`` and ``particles.covariance``
        are the same, unless a ``mean_x`` defines another mean.
        """
        particles = particles.whole
        w = particles.w
        x = self.mean_x(particles.x, w)
        e = self.residual_x(particles.x, x.unsqueeze(-2))
        return x, covariance((w.unsqueeze(-1) * e).mT @ e)

    def _draw(self, x, P, generator) -> Particles:
        size = (*x.shape[:-1], self.particles, x.shape[-1])
        z = _matched(torch.randn(size, generator=generator, dtype=x.dtype, device=x.device))
        return Particles(x.unsqueeze(-2) + z @ factor(P).mT, z.new_zeros(size[:-1]))  # (1)

    def _weigh(self, particles: Particles, y, R, g: Function) -> Particles:
        particles = _explain(particles, y, R, g)
        if has_numbers(particles.log_w):
            _refuse_none_and_warn_of_few(particles.log_w)
        return particles

    def _beside_mean(self, particles: Particles) -> Particles:
        """Returns the particles with angles that are within half a turn of their mean."""
        if not self.wraps:
            return particles
        particles = particles.whole
        mean = self.mean_x(particles.x, particles.w).unsqueeze(-2)
        return particles._replace(x=mean + self.residual_x(particles.x, mean))

    def _moments(self, particles: Particles, f: Function, Q) -> tuple[Tensor, Tensor]:
        x, P = self.moments(_moved(particles, f))  # (3)
        return x, covariance(P + Q)  # (4)


def _images(g: Function, particles: Particles) -> tuple[Particles, Tensor]:
    """Returns g at each particle, and the particles: without weight where g is not defined."""
    z = g.each(particles.x)
    if all_finite(z):
        return particles, z
    x, log_w = particles
    lost = ~z.isfinite().all(-1)
    log_w = torch.where(lost, -torch.inf, log_w)
    check_weights(log_w, "g is not finite there")
    return Particles(x, log_w), g.each(stand_ins(x, log_w))


def _explain(particles: Particles, y, R, g: Function) -> Particles:
    """Returns the particles, each of whose weights counts how well it explains y."""
    g, y, R, _, rows = measured(g, y, R)
    particles, z = _images(g, particles)
    e = g.difference(y.unsqueeze(-2), z)
    like = log_density(e.mT, R, rows, "R")
    like = like.nan_to_num(-torch.inf, torch.inf, -torch.inf)
    return particles._replace(log_w=particles.log_w + like)  # (2)


def _moved(particles: Particles, f: Function) -> Particles:
    x = f.each(particles.x)
    if not all_finite(x):
        x = f.each(stand_ins(*particles))
        finite(f.name, x)
    return particles._replace(x=x)


def _refuse_none_and_warn_of_few(log_w: Tensor) -> None:
    least, N = (1 / log_w.softmax(-1).square().sum(-1)).min().item(), log_w.shape[-1]
    if math.isnan(least):
        check_weights(log_w, "y has no density at any of them")
    if least < min(max(FEW, RARE * N), N / 2):
        warnings.warn(
            f"PF: {least:.1f} of {N} particles are effective: y is far from nearly all",
            stacklevel=4,
        )


def _named(particles: Particles) -> dict[str, Tensor]:
    return {"particles": particles.x, "weights": particles.log_w}


def _matched(z: Tensor) -> Tensor:
    """Returns the draws z ``(..., N, n)`` moved and stretched to have mean 0 and covariance I."""
    N, n = z.shape[-2:]
    if N <= n:
        return z
    z = z - z.mean(-2, keepdim=True)
    L = torch.linalg.cholesky(z.mT @ z / N)
    return torch.linalg.solve_triangular(L, z.mT, upper=False).mT
