"""What every filter has: a model, its two noise covariances, and arguments that are checked."""

import functools
import math
from collections.abc import Callable

import torch
from torch import Tensor, nn

from ..linalg import bmv
from ..shapes import check
from ..systems import System
from .gaussian import Innovation, Joint, condition, covariance, factor, innovation, observed

LETTERS = {"x": "n", "y": "p", "u": "m", "P": "n n", "Q": "n n", "R": "p p"}
LETTERS |= {"particles": "N n", "weights": "N"}


class Filter(nn.Module):
    """The parameters of a filter, each of which a call may override.

    Args:
        model: the system whose state is estimated; it is never changed.
        Q: process noise covariance ``(..., n, n)``, added after f, symmetric >= 0.
        R: observation noise covariance ``(..., p, p)``, symmetric > 0.
        residual: ``residual(y, z)``, the difference of two observations; for angles one that
            wraps. None is ``y - z``.
    """

    model: System
    Q: Tensor | None
    R: Tensor | None

    def __init__(self, model, Q=None, R=None, *, residual: Callable | None = None):
        super().__init__()
        self.model, self.residual = model, residual or torch.sub
        for name in ("Q", "R"):
            self.register_buffer(name, None)
        self.set_uncertainty(Q, R)

    def set_uncertainty(self, Q=None, R=None) -> None:
        """Sets Q and R; what is None stays as it is. An ``nn.Parameter`` is learned."""
        check("Q: n n, R: p p", Q, R)
        for name, value in (("Q", Q), ("R", R)):
            if value is None:
                continue
            factor(value, name)  # says where it is no covariance
            delattr(self, name)
            if isinstance(value, nn.Parameter):
                self.register_parameter(name, value)
            else:
                self.register_buffer(name, value)

    def _inputs(self, **given: Tensor | None) -> list[Tensor]:
        """Returns the arguments, checked; Q and R filled in; the first with the whole batch."""
        values = [self._value(name, value) for name, value in given.items()]
        names, kinds = tuple(given), tuple((v.shape, v.dtype, v.device) for v in values)
        batch, core = _agree(names, kinds)
        for name, value in zip(names, values):
            if not math.isfinite((value.nansum() if name == "y" else value.sum()).item()):
                missing = value.isnan() & (name == "y")
                check(f"{name}: {LETTERS[name]}", value.masked_fill(missing, 0))
        return [values[0].expand(*batch, *core), *values[1:]]

    def _value(self, name: str, value) -> Tensor:
        value = getattr(self, name) if value is None and name in "QR" else value
        if not isinstance(value, Tensor):
            raise ValueError(f"{name}: expected a tensor, got {type(value).__name__}")
        return value.reshape(1) if value.ndim == 0 and name in "xyu" else value


class GaussianFilter(Filter):
    """A filter whose belief is a mean x ``(..., n)`` and a covariance P ``(..., n, n)``.

        x <- x + K (y - mean of g),  P <- what is left of it      (1)
        x' = mean of f,  P' = covariance of f + Q                 (2)

    A subclass says how it sees f and g near x: ``joint_transition`` and ``joint_observation``;
    K and what is left of P come from ``gaussian.condition``. In all methods ``u (..., m)`` is the
    input, and ``y (..., p)`` observes the state before the step, NaN in rows without a measurement.
    Q and R override the filter's own. ``t`` is the time step, None the model's clock now. (A car
    that has just taken step i shows i + 1: with a model that depends on time, pass ``t=i``.)

    Raises:
        ValueError: for arguments that do not fit, or covariances that are none.
    """

    def joint_transition(self, x, u, P, t) -> Joint:
        """Returns how x and f(x, u, t) vary together; a subclass writes it."""
        raise NotImplementedError

    def joint_observation(self, x, u, P, t) -> Joint:
        """Returns how x and g(x, u, t) vary together; a subclass writes it."""
        raise NotImplementedError

    def forward(self, x, y, u, P, Q=None, R=None, t=None, **spread) -> tuple[Tensor, Tensor]:
        """Returns x and P of the next state: corrected with y, then predicted.

        ``y=None`` predicts only.
        """
        if y is None:
            return self.predict(x, u, P, Q, t, **spread)
        x, y, u, P, Q, R = self._inputs(x=x, y=y, u=u, P=P, Q=Q, R=R)
        x, P = self._update(x, y, u, P, R, t, **spread)
        return self._predict(x, u, P, Q, t, **spread)

    def update(self, x, y, u, P, R=None, t=None, **spread) -> tuple[Tensor, Tensor]:
        """Returns x and P of the same state, once y is known."""
        x, y, u, P, R = self._inputs(x=x, y=y, u=u, P=P, R=R)
        x, P = self._update(x, y, u, P, R, t, **spread)
        return x, covariance(P)

    def predict(self, x, u, P, Q=None, t=None, **spread) -> tuple[Tensor, Tensor]:
        """Returns x and P of the next state."""
        x, u, P, Q = self._inputs(x=x, u=u, P=P, Q=Q)
        return self._predict(x, u, P, Q, t, **spread)

    def innovation(self, x, y, u, P, R=None, t=None, **spread) -> Innovation:
        """Returns what y says beyond the expected, its covariance, and its log-likelihood."""
        x, y, u, P, R = self._inputs(x=x, y=y, u=u, P=P, R=R)
        joint = self.joint_observation(x, u, P, t, **spread)
        return innovation(y, joint, R, self.residual)

    def reverse(self, x, u, P, Q=None, t=None, **spread) -> tuple[Tensor, Tensor, Tensor]:
        """Returns what the next state x' will say of this one: its mean, the gain, a covariance.

        Given x', this state has mean ``x + G (x' - mean)`` and the covariance that is returned.
        """
        x, u, P, Q = self._inputs(x=x, u=u, P=P, Q=Q)
        joint = self.joint_transition(x, u, P, t, **spread)
        G, P = condition(joint, Q)
        return joint.mean, G, covariance(P)

    def _update(self, x, y, u, P, R, t, **spread):
        joint = self.joint_observation(x, u, P, t, **spread)
        e, joint, R = observed(y, joint, R, self.residual)
        K, P = condition(joint, R)
        return x + bmv(K, e), P  # (1)

    def _predict(self, x, u, P, Q, t, **spread):
        joint = self.joint_transition(x, u, P, t, **spread)
        if joint.mean.shape[-1] != Q.shape[-1]:
            n, got = Q.shape[-1], tuple(joint.mean.shape)
            raise ValueError(f"state_transition: expected a state (..., n={n}), got {got}")
        return joint.mean, covariance(joint.covariance + Q)  # (2)


@functools.cache
def _agree(names: tuple[str, ...], kinds: tuple) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Returns the batch of arguments of such kinds, and the size of the first without it."""
    spec = ", ".join(f"{name}: {LETTERS[name]}" for name in names)
    check(spec, *(torch.zeros((), dtype=d, device=v).expand(s) for s, d, v in kinds))
    cores = [len(LETTERS[name].split()) for name in names]
    batch = torch.broadcast_shapes(*(kind[0][:-core] for kind, core in zip(kinds, cores)))
    return batch, kinds[0][0][-cores[0] :]
