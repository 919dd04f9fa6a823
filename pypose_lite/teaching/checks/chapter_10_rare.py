"""What the answers of lab 10 must do: a rare event."""

import math

import torch
from torch import Tensor

from . import expect
from .chapter_10 import apart
from .exercise import Exercise, Failure
from .words import kind

rare = Exercise("10.4", "A rare event", minutes=25, takes="fails, mu, w", points=3)


def event(given, size: int = 3000, d: int = 6):
    """A plane that few draws are behind, the shift to it, draws, and its probability."""
    normal = given.randn(d)
    normal = normal / normal.norm()
    b = given.uniform(3.2, 4).item()

    def fails(w: Tensor) -> Tensor:
        if not (isinstance(w, Tensor) and w.shape[-1:] == (d,)):
            raise Failure(f"fails to be called with draws (n, {d})", kind(w), "With w + mu.")
        return w.to(normal.dtype) @ normal > b

    return fails, b * normal, given.randn(size, d), 0.5 * math.erfc(b / math.sqrt(2))


def both(answer, fails, mu: Tensor, w: Tensor) -> tuple[Tensor, Tensor]:
    """The probability and the standard error that an answer gives."""
    names = ("the probability", "the standard error")
    chance, error = expect.parts(apart(answer(fails, mu, w)), *names)
    return expect.tensor(names[0], chance, ()), expect.tensor(names[1], error, ())


def densities(s: Tensor, mu: Tensor) -> Tensor:
    """The true density of draws over the shifted one, from torch's distributions."""
    normal = torch.distributions.Normal
    return (normal(0.0, 1.0).log_prob(s) - normal(mu, 1.0).log_prob(s)).sum(-1).exp()


@rare.must("give the mean of the weights of the draws around mu that fail")
def right_mean(answer, given):
    fails, mu, w, _ = event(given)
    s, half = w + mu, torch.exp(mu @ mu / 2)
    weights, failed = densities(s, mu), fails(s).double()
    mistakes = {
        "Ask about the draws around mu, w + mu: among the w hardly any fails.": (
            fails(w).double().mean()
        ),
        "Draws around mu fail far too often: weigh them.": failed.mean(),
        "The weight is the true density over the other one, not the reverse.": (
            (failed / weights).mean()
        ),
        "The weight belongs to the draw that was used, w + mu, not to w.": (
            (failed * torch.exp(mu @ mu / 2 - w @ mu)).mean()
        ),
        "The squares of mu leave a factor in the weight, exp(|mu|^2 / 2).": (
            (failed * weights / half).mean()
        ),
        "The square of mu is halved in the exponent.": (failed * weights * half).mean(),
        "Divide by the number of draws, not by the sum of the weights.": (
            (failed * weights).sum() / weights.sum()
        ),
        "Divide by the number of all draws, not of those that fail.": (
            (failed * weights).sum() / failed.sum()
        ),
        "The mean over the draws, not the sum.": (failed * weights).sum(),
    }
    came, _ = both(answer, fails, mu, w)
    right = (failed * weights).mean()
    # as shares of the right one: a probability of a millionth is no rounding error of 0
    shares = {hint: wrong / right for hint, wrong in mistakes.items()}
    hint = "Every draw has a value: its weight if it fails, else 0. Take their mean."
    if not expect.near(came / right, torch.tensor(1.0), 1e-4):
        hints = [h for h, z in shares.items() if expect.near(came / right, z, 1e-4)]
        raise Failure(f"{right:.3e}", f"{came:.3e}", hints[0] if hints else hint)


@rare.must("give the standard error of that mean")
def right_error(answer, given):
    fails, mu, w, _ = event(given, 500)
    values = fails(w + mu) * densities(w + mu, mu)
    p, n = values.mean(), len(w)
    right = values.std() / n**0.5
    mistakes = {
        "That is the standard deviation of one lap; divide by the root of n.": values.std(),
        "Divide by the root of n, not by n.": values.std() / n,
        "That is the standard error of plain simulation; take the values with weights.": (
            (p * (1 - p) / n).sqrt()
        ),
        "That is the half-width, 1.96 of them.": 1.96 * right,
        "That is the variance.": values.var() / n,
    }
    _, came = both(answer, fails, mu, w)
    if not expect.near(came / right, torch.tensor(1.0), 2e-3):
        hints = [h for h, z in mistakes.items() if expect.near(came / right, z / right, 2e-3)]
        hint = hints[0] if hints else "The standard deviation of the values over the root of n."
        raise Failure(f"{right:.3e}", f"{came:.3e}", hint)


@rare.must("find the probability of an event that plain simulation does not see")
def finds_it(answer, given):
    for _ in range(3):
        fails, mu, w, exact = event(given)
        chance, error = both(answer, fails, mu, w)
        off = abs(chance.item() - exact)
        expect.that(off < 5 * error, f"{exact:.2e}", f"{chance:.2e}", "Is every draw weighed?")
