"""Functions of an angle that are 0/0 at angle 0, right for values and gradients everywhere.

All take the squared angle ``x = theta^2 (...)``: a norm has no gradient at 0, its square has.
"""

from collections.abc import Callable
from math import factorial

import torch
from torch import Tensor

# Below this angle (0.5 rad) the series is exact to rounding; above it the closed forms lose
# at most two digits to cancellation, in factors that are multiplied by theta^2.
NEAR = 0.25
TERMS = {torch.float32: 5, torch.float64: 9}  # so that the first two derivatives are exact too

# The coefficients of 1, x, x^2, ...
_ORDERS = range(9)
SINC_HALF = tuple((-1) ** k / (2 * 4**k * factorial(2 * k + 1)) for k in _ORDERS)
COS_HALF = tuple((-1) ** k / (4**k * factorial(2 * k)) for k in _ORDERS)
SINE_DEFECT = tuple((-1) ** k / factorial(2 * k + 3) for k in _ORDERS)
COT_DEFECT = (  # |B_2n| / (2n)!, B the Bernoulli numbers
    1 / 12,
    1 / 720,
    1 / 30240,
    1 / 1209600,
    1 / 47900160,
    691 / 1307674368000,
    1 / 74724249600,
    3617 / 10670622842880000,
    43867 / 5109094217170944000,
)
ATAN_OVER = tuple((-1) ** k / (2 * k + 1) for k in _ORDERS)


def sinc_half(x: Tensor) -> Tensor:
    """``sin(theta / 2) / theta``, which is 1/2 at 0."""
    return _piecewise(x, SINC_HALF, lambda theta: (theta / 2).sin() / theta)


def cos_half(x: Tensor) -> Tensor:
    """``cos(theta / 2)``."""
    return _piecewise(x, COS_HALF, lambda theta: (theta / 2).cos())


def sine_defect(x: Tensor) -> Tensor:
    """``(theta - sin theta) / theta^3``, which is 1/6 at 0."""
    return _piecewise(x, SINE_DEFECT, lambda theta: (theta - theta.sin()) / theta**3)


def cot_defect(x: Tensor) -> Tensor:
    """``(1 - (theta / 2) cot(theta / 2)) / theta^2``, which is 1/12 at 0 and 1/pi^2 at pi."""

    def closed(theta: Tensor) -> Tensor:
        return (1 - theta / 2 * (theta / 2).cos() / (theta / 2).sin()) / theta**2

    return _piecewise(x, COT_DEFECT, closed)


def angle_over_sine(square: Tensor, cosine: Tensor) -> Tensor:
    """``atan2(n, c) / n`` for ``n^2 = square`` and ``c = cosine >= 0``, which is 1/c at n = 0."""
    small = square < 0.01 * cosine**2
    ratio = torch.where(small, square, 0) / torch.where(small, cosine, 1) ** 2
    n = torch.where(small, 1, square).sqrt()
    series = _polynomial(ratio, ATAN_OVER) / torch.where(small, cosine, 1)
    return torch.where(small, series, torch.atan2(n, cosine) / n)


def safe_norm(v: Tensor, keepdim: bool = False) -> Tensor:
    """The length of ``v (..., n)``, with gradient 0 instead of NaN where it is 0."""
    square = (v * v).sum(-1, keepdim=keepdim)
    zero = square == 0
    return torch.where(zero, 0, torch.where(zero, 1, square).sqrt())


def _piecewise(x: Tensor, series: tuple, closed: Callable[[Tensor], Tensor]) -> Tensor:
    """The series near 0 and the closed form elsewhere.

    Each branch sees only arguments that it can take (1 where they are the other's): the
    gradient of ``where`` is 0 times that of the branch not taken, and 0 times infinity is NaN.
    """
    near = x < NEAR
    theta = torch.where(near, 1, x).sqrt()
    return torch.where(near, _polynomial(torch.where(near, x, 0), series), closed(theta))


def _polynomial(x: Tensor, coefficients: tuple) -> Tensor:
    """Horner's rule, with as many terms as the dtype can hold."""
    total = torch.zeros_like(x)
    for c in reversed(coefficients[: TERMS.get(x.dtype, len(coefficients))]):
        total = total * x + c
    return total
