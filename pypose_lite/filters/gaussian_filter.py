"""The public methods of the filters whose belief is a mean and a covariance: EKF and UKF.

They differ in how they look at f and g, so each writes two methods: ``_update``, what an
observation leaves of a belief, and ``_predict``, what a step makes of it. All the rest is here,
and is the same three moves each time: check the arguments, prepare f and g, call those two.
Preparing takes out of the equations what is not always there. Where rows of y are missing, g, y
and R are replaced by such that say nothing in those rows. Where noises are correlated, f and Q are
replaced by such whose noise is independent. And the smoother's gain is an update in which the next
state stands for the observation.
"""

from collections.abc import Callable

from torch import Tensor

from ..shapes import check, register
from .base import Filter
from .function import Function, decorrelated, measured
from .gaussian import Correction, Innovation, covariance


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
    _update: Callable[..., Correction]  # (g, x, y, P, R): the belief about x once y is known
    _predict: Callable[..., tuple[Tensor, Tensor]]  # (f, x, P, Q): mean and covariance of f(x) + w

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
