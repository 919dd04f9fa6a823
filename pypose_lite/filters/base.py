"""What all filters share: a model, the covariances of its two noises, and arguments that fit.

A filter keeps a belief about the state of ``x[i+1] = f(x[i], u[i]) + w[i]`` from observations
``y[i] = g(x[i], u[i]) + v[i]``, where w and v have the covariances Q and R. Its call takes what is
known of x[i] before y[i] came to what is known of x[i+1] after it, in the two steps of Bayes:

    update:   p(x[i] | y[0..i]) = p(y[i] | x[i]) p(x[i] | y[0..i-1]) / p(y[i] | y[0..i-1])
    predict:  p(x[i+1] | y[0..i]) = the integral of p(x[i+1] | x[i]) p(x[i] | y[0..i]) over x[i]

:class:`Filter` holds the parameters, and has the checks that every public method begins with. It
also hands out f and g with the step's input and time filled in (see ``function.py``), so that what
a filter computes is written in f, g, x, P, Q and R alone. EKF and UKF share the public methods of
``gaussian_filter.py``; the particle filter has its own in ``pf.py``.

What holds for all: nothing that a filter is given is changed, model and clock included; arguments
broadcast, and a batch is filtered as its members would be; results are differentiable in every
argument. What does not fit is a ValueError that names it. Inside ``torch.vmap`` nobody can see the
numbers of a member, so no number is refused there: a P that is no covariance makes its member NaN.
"""

import functools
import math
from collections.abc import Callable

import torch
from torch import Tensor, nn

from ..shapes import check, has_numbers, register
from ..systems import System
from .differences import Difference, difference_and_mean
from .function import Function, Sensor, observation, transition, what_it_asks
from .gaussian import factor
from .particles import check_weights

LETTERS = {"x": "n", "y": "p", "u": "m", "P": "n n", "Q": "n n", "R": "p p", "S": "n p"}
LETTERS |= {"particles": "N n", "weights": "N"}


class Filter(nn.Module):
    """The parameters of a filter, each of which a call may override.

    Args:
        model: the system whose state is estimated; it is never changed.
        Q: process noise covariance ``(..., n, n)``, added after f, symmetric >= 0.
        R: observation noise covariance ``(..., p, p)``, symmetric > 0.
        residual: ``residual(y, z)``, the difference of two observations ``(p,)``; None is
            ``y - z``. Where y has angles it has to wrap, see :func:`angles`.
        residual_x: ``residual_x(a, b)``, the difference of two states ``(n,)``, likewise.
        mean_x: ``mean_x(points, w)``, the mean ``(n,)`` of states ``(k, n)`` with weights
            ``(k,)`` of sum 1. None follows from ``residual_x``: the point from which the
            weighted differences of all points cancel, which is the mean of angles, too.
    """

    model: System
    Q: Tensor | None
    R: Tensor | None

    def __init__(
        self,
        model,
        Q=None,
        R=None,
        *,
        residual: Difference | None = None,
        residual_x: Difference | None = None,
        mean_x: Callable[[Tensor, Tensor], Tensor] | None = None,
    ):
        super().__init__()
        if mean_x is not None and residual_x is None:
            raise ValueError("mean_x: expected residual_x beside it, from which P is computed")
        self.model = model
        self.residual, self.mean_y = difference_and_mean(residual)
        self.residual_x, self.mean_x = difference_and_mean(residual_x, mean_x, "residual_x")
        self.wraps = residual_x is not None
        for name in ("Q", "R"):
            register(self, name, None)
        self.set_uncertainty(Q, R)

    def set_uncertainty(self, Q=None, R=None) -> None:
        """Sets Q and R; what is None stays as it is. An ``nn.Parameter`` is learned."""
        check("Q: n n, R: p p", Q, R)
        for name, value in (("Q", Q), ("R", R)):
            if value is not None:
                factor(value, name)  # says where it is no covariance
                register(self, name, value)

    def _f(self, u: Tensor, t, n: int) -> Function:
        """Returns f of the state alone."""
        return transition(self.model, u, t, n, self.residual_x, self.mean_x)

    def _g(self, u: Tensor, t, p: int, g=None, residual=None) -> Function:
        """Returns g of the state alone: the model's, or that of a sensor of its own."""
        if g is None:
            return observation(self.model, u, t, p, self.residual, self.mean_y)
        t = self.model.systime if t is None else t
        return observation(Sensor(g), u, t, p, *difference_and_mean(residual))

    def _look(self, y, u, R, t, g, residual, **belief) -> tuple[list, Tensor, Tensor, Function]:
        """Returns a belief, y and R, checked, and the g of whoever looks: the model or a sensor."""
        if g is not None:
            u = _sensor_input(g, next(iter(belief.values())), u, R)
        *parts, y, u, R = self._inputs(**belief, y=y, u=u, R=R)
        return parts, y, R, self._g(u, t, y.shape[-1], g, residual)

    def _inputs(self, **given) -> list:
        """Returns the arguments, checked; Q, R and S filled in; the first with the whole batch."""
        values: dict = {name: self._value(name, value) for name, value in given.items()}
        known = {name: value for name, value in values.items() if value is not None}
        kinds = tuple((v.shape, v.dtype, v.device) for v in known.values())
        batch, core = _agree(tuple(known), kinds)
        for name, value in known.items():
            if has_numbers(value) and not math.isfinite(value.sum().item()):
                _say_what_is_not_finite(name, value)
        first, *rest = values.values()
        return [first.expand(*batch, *core), *rest]

    def _value(self, name: str, value) -> Tensor | None:
        value = getattr(self, name) if value is None and name in "QRS" else value
        if value is None and name == "S":
            return None
        if not isinstance(value, Tensor):
            raise ValueError(f"{name}: expected a tensor, got {type(value).__name__}")
        return value.reshape(1) if value.ndim == 0 and name in "xyu" else value


def _sensor_input(g: Callable, x: Tensor, u: Tensor | None, R: Tensor | None) -> Tensor | None:
    """Returns an input where a sensor needs none; ValueError where it misses one, or its noise."""
    if R is None:
        raise ValueError("R: expected the noise of g's sensor; the filter's is the model's own")
    if u is None and "input" in what_it_asks(g):
        raise ValueError("u: g takes (state, input), so an input has to be given")
    return x.new_zeros(1) if u is None and isinstance(x, Tensor) else u


@functools.cache
def _agree(names: tuple[str, ...], kinds: tuple) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Returns the batch of arguments of such kinds, and the size of the first without it."""
    spec = ", ".join(f"{name}: {LETTERS[name]}" for name in names)
    check(spec, *(torch.zeros((), dtype=d, device=v).expand(s) for s, d, v in kinds))
    cores = [len(LETTERS[name].split()) for name in names]
    batch = torch.broadcast_shapes(*(kind[0][:-core] for kind, core in zip(kinds, cores)))
    return batch, kinds[0][0][-cores[0] :]


def _say_what_is_not_finite(name: str, value: Tensor) -> None:
    """Raises ValueError, unless NaN means a row without a measurement, or -inf a weight of 0."""
    if name == "y":
        value = value.masked_fill(value.isnan(), 0)
    if name == "weights":
        check_weights(value)
    else:
        check(f"{name}: {LETTERS[name]}", value)
