"""What all filters share: a model, the covariances of its two noises, and arguments that fit.

A filter keeps a belief about the state of ``x[i+1] = f(x[i], u[i]) + w[i]`` from observations
``y[i] = g(x[i], u[i]) + v[i]``, where w and v have the covariances Q and R. Its call takes the
belief about x[i], given y up to i-1, to that about x[i+1], given y up to i. That is Bayes' rule,
then the law of total probability:

    p(x[i] | y[0..i])   ~ p(y[i] | x[i]) p(x[i] | y[0..i-1])             update
    p(x[i+1] | y[0..i]) = integral of p(x[i+1] | x[i]) p(x[i] | y[0..i])   predict

A Gaussian filter, EKF or UKF, keeps a mean x and a covariance P, and its two equations stand in
``_update`` and ``_predict`` of its own file. :class:`GaussianFilter` gives it its public methods:
each checks the arguments, prepares the two functions (``function.py`` says how) and calls those
two. The particle filter shares the parameters and the checks of :class:`Filter` alone.

What holds for all: nothing that a filter is given is changed, model and clock included; arguments
broadcast, and a batch is filtered as its members would be; P comes back symmetric; results are
differentiable in every argument. Errors are about numbers; inside ``torch.vmap``, where numbers
cannot be asked for, a covariance that is none makes the member's result NaN.
"""

import functools
import math
from collections.abc import Callable

import torch
from torch import Tensor, nn

from ..shapes import check, has_numbers, register
from ..systems import System
from .differences import Difference, difference_and_mean
from .function import (
    Function,
    Sensor,
    count_arguments,
    decorrelated,
    measured,
    observation,
    transition,
)
from .gaussian import Correction, Innovation, covariance, factor
from .particles import check_weights

LETTERS = {"x": "n", "y": "p", "u": "m", "P": "n n", "Q": "n n", "R": "p p", "S": "n p"}
LETTERS |= {"particles": "N n", "weights": "N"}


class Filter(nn.Module):
    """The parameters of a filter, each of which a call may override.

    Args:
        model: the system whose state is estimated; it is never changed.
        Q: process noise covariance ``(..., n, n)``, added after f, symmetric >= 0.
        R: observation noise covariance ``(..., p, p)``, symmetric > 0.
        residual: ``residual(y, z)``, the difference of two observations ``(..., p)``; None is
            ``y - z``. Where y has angles it has to wrap, see :func:`angles`.
        residual_x: ``residual_x(a, b)``, the difference of two states ``(..., n)``, likewise.
        mean_x: ``mean_x(points, w)``, the mean ``(..., n)`` of states ``(..., k, n)`` with weights
            ``(..., k)`` of sum 1. None follows from ``residual_x``: the point from which the
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
        self.residual, self.mean = difference_and_mean(residual)
        self.residual_x, self.mean_x = difference_and_mean(residual_x, mean_x)
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
            return observation(self.model, u, t, p, self.residual, self.mean)
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


class GaussianFilter(Filter):
    """A filter whose belief is a mean x ``(..., n)`` and a covariance P ``(..., n, n)``.

    A subclass writes ``_update`` and ``_predict``. In all methods ``u (..., m)`` is the input, and
    ``y (..., p)`` observes the state before the step; it is NaN in rows without a measurement.
    Q, R and S override the filter's own. ``t`` is the time step, None the model's clock now. (A car
    that has just taken step i shows i + 1: with a model that depends on time, pass ``t=i``.)

    **Correlated noises.** ``S (..., n, p)`` is the covariance of w[i] and v[i]: of what disturbs
    the step from x[i] to x[i+1], and of the error of y[i], which belongs to x[i]. An observation
    then corrects the step, too. In a loop of one's own, ``predict`` has to know it: pass it the
    same ``y`` as ``update``.

    **Sensors of different rates.** ``update(x, y, u, P, R=..., g=...)`` takes in one sensor: its
    observation y, its noise R, and its g as a function of (state), (state, input) or
    (state, input, t). Call it once for each sensor that has spoken, then ``predict``.

    Args:
        model: as in :class:`Filter`, like Q, R, residual, residual_x and mean_x.
        S: covariance of process and observation noise of the same step, ``(..., n, p)``; None is 0.

    Raises:
        ValueError: for arguments that do not fit, covariances that are none, or an f or g that is
            not finite where it is asked.
    """

    S: Tensor | None

    def __init__(
        self, model, Q=None, R=None, *, S=None, residual=None, residual_x=None, mean_x=None
    ):
        super().__init__(model, Q, R, residual=residual, residual_x=residual_x, mean_x=mean_x)
        register(self, "S", None)
        self.set_uncertainty(S=S)

    def set_uncertainty(self, Q=None, R=None, S=None) -> None:
        """Sets Q, R and S; what is None stays as it is. An ``nn.Parameter`` is learned."""
        check("Q: n n, R: p p, S: n p", Q, R, S)
        super().set_uncertainty(Q, R)
        if S is not None:
            register(self, "S", S)

    def _update(self, g: Function, x, y, P, R) -> Correction:
        """Returns the belief about x once y is known; a subclass writes it."""
        raise NotImplementedError

    def _predict(self, f: Function, x, P, Q) -> tuple[Tensor, Tensor]:
        """Returns mean and covariance of f(x) + w; a subclass writes it."""
        raise NotImplementedError

    def forward(self, x, y, u, P, Q=None, R=None, t=None, *, S=None, **spread):
        """Returns x and P of the next state: corrected with y, then predicted.

        ``y=None`` predicts only.
        """
        if y is None:
            return self.predict(x, u, P, Q, t, **spread)
        x, y, u, P, Q, R, S = self._inputs(x=x, y=y, u=u, P=P, Q=Q, R=R, S=S)
        f, g = self._f(u, t, x.shape[-1]), self._g(u, t, y.shape[-1])
        g, y, R, S, _ = measured(g, y, R, S)
        x, P, *_ = self._update(g, x, y, P, R, **spread)
        f, Q = (f, Q) if S is None else decorrelated(f, g, y, Q, R, S)
        x, P = self._predict(f, x, P, Q, **spread)
        return x, covariance(P)

    def update(self, x, y, u, P, R=None, t=None, *, g=None, residual=None, **spread):
        """Returns x and P of the same state, once y is known.

        Args:
            x: mean ``(..., n)``.
            y: observation ``(..., p)``, the model's or the sensor's.
            u: input ``(..., m)``; may be None for a g of (state) alone.
            P: covariance ``(..., n, n)``.
            R: noise covariance ``(..., p, p)``; needed where g is given.
            t: time step.
            g: a sensor's own observation, for one sample or any batch; None is the model's.
            residual: the difference of two observations of that sensor; None is ``y - z``, also
                where the filter has a residual, which is for the model's own observation.
            spread: ``k`` for the UKF.
        """
        x, P, *_ = self._correct(x, y, u, P, R, t, g, residual, **spread)[0]
        return x, covariance(P)

    def innovation(self, x, y, u, P, R=None, t=None, *, g=None, residual=None, **spread):
        """Returns the :class:`Innovation`: what y says beyond the expected, and its covariance.

        Arguments are those of :meth:`update`.
        """
        corrected, known = self._correct(x, y, u, P, R, t, g, residual, **spread)
        e, S = corrected.e, corrected.S
        return Innovation(e, (S + S.mT) / 2, known.expand(e.shape))

    def predict(self, x, u, P, Q=None, t=None, *, y=None, R=None, S=None, **spread):
        """Returns x and P of the next state.

        ``y`` and R are what ``update`` has taken in; they matter only where noises are correlated.
        """
        x, P, f, Q = self._next(x, u, P, Q, t, y, R, S)
        x, P = self._predict(f, x, P, Q, **spread)
        return x, covariance(P)

    def reverse(self, x, u, P, Q=None, t=None, *, y=None, R=None, S=None, **spread):
        """Returns what the next state x' will say of this one: its mean, the gain, a covariance.

        Given x', this state has mean ``x + G (x' - mean)`` and the covariance that is returned.
        It is an update in which f stands for g, and the next state for the observation.
        """
        x, P, f, Q = self._next(x, u, P, Q, t, y, R, S)
        corrected = self._update(f, x, x, P, Q, **spread)  # mean and gain are those of any x'
        return corrected.z, corrected.K, covariance(corrected.P)

    def _correct(self, x, y, u, P, R, t, g, residual, **spread) -> tuple[Correction, Tensor]:
        """Returns the belief once y is known, and which rows of y are."""
        (x, P), y, R, look = self._look(y, u, R, t, g, residual, x=x, P=P)
        look, y_known, R, *_ = measured(look, y, R)
        return self._update(look, x, y_known, P, R, **spread), ~y.isnan()

    def _next(self, x, u, P, Q, t, y, R, S) -> tuple[Tensor, Tensor, Function, Tensor]:
        """Returns x, P, f and Q, checked; f and Q know of y where noises are correlated."""
        if y is None:
            x, u, P, Q = self._inputs(x=x, u=u, P=P, Q=Q)
            return x, P, self._f(u, t, x.shape[-1]), Q
        x, y, u, P, Q, R, S = self._inputs(x=x, y=y, u=u, P=P, Q=Q, R=R, S=S)
        f, g = self._f(u, t, x.shape[-1]), self._g(u, t, y.shape[-1])
        g, y, R, S, _ = measured(g, y, R, S)
        return (x, P, f, Q) if S is None else (x, P, *decorrelated(f, g, y, Q, R, S))


def _sensor_input(g: Callable, x: Tensor, u: Tensor | None, R: Tensor | None) -> Tensor | None:
    """Returns an input where a sensor needs none; ValueError where it misses one, or its noise."""
    if R is None:
        raise ValueError("R: expected the noise of g's sensor; the filter's is the model's own")
    if u is None and count_arguments(g) > 1:
        raise ValueError("u: g takes (state, input), so an input has to be given")
    return x.new_zeros(1) if u is None else u


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
