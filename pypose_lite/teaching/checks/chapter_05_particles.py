"""What the answers of lab 5 must do: particles, their weights, and a car that is lost."""

import math

import torch
from torch import Tensor

from . import expect, lost_car
from .exercise import Exercise

effective_sample_size = Exercise(
    "5.3", "How many particles count?", minutes=10, takes="log_weights"
)


def size(answer, log_weights: Tensor) -> Tensor:
    """The effective sample size that an answer gives."""
    return expect.tensor("the effective sample size", answer(log_weights), ())


@effective_sample_size.must("be N where all weights are equal")
def all_equal(answer, given):
    for N in (5, 40):
        hint = "Weights are normalised first: they need not sum to one."
        mistakes = {hint: 1 / N}
        came = size(answer, torch.zeros(N).double())
        expect.close("it", came, float(N), "1 / sum w^2.", mistakes)
        expect.close("it", size(answer, torch.full((N,), -3.0).double()), float(N), hint)


@effective_sample_size.must("be that of other weights, too")
def some_weights(answer, given):
    w = given.uniform(0.1, 1.0, 30)
    w = w / w.sum()
    want = 1 / w.square().sum()
    logs = w.log()
    mistakes = {
        "Weights are the exponentials of the logarithms.": logs.sum() ** 2 / logs.square().sum(),
        "This is the sum of the squares: take one over it.": 1 / want,
        "This is the entropy's number. The effective size is 1 / sum w^2.": (
            -(w * logs).sum()
        ).exp(),
    }
    expect.close("it", size(answer, logs + 2.0), want, "1 / sum w^2, of normalised w.", mistakes)


@effective_sample_size.must("work where the exponentials of all logarithms are zero, or infinite")
def far_away(answer, given):
    w = given.uniform(0.1, 1.0, 20)
    want = w.sum() ** 2 / w.square().sum()
    for shift in (-1e4, 1e4):
        hint = "Subtract the largest logarithm before you take exponentials."
        came = torch.as_tensor(answer(w.log() + shift))
        expect.that(came.isfinite().all(), f"{want:.4g}", "nan or inf", hint)
        expect.close("it", came, want, hint, tolerance=1e-5)


@effective_sample_size.must("count a logarithm of minus infinity as the weight 0")
def no_weight(answer, given):
    logs = torch.tensor([0.0, -math.inf, 0.0, -math.inf]).double()
    expect.close("it", size(answer, logs), 2.0, "exp(-inf) is 0, and that is right.")


systematic = Exercise("5.4", "The resampling comb", minutes=15, takes="weights, r", points=2)


def comb(answer, weights: Tensor, r: float) -> list[int]:
    """The indices that an answer returns."""
    N = len(weights)
    taken = expect.tensor("the indices", answer(weights, r), (N,))
    whole = bool((taken == taken.round()).all() and (taken >= 0).all())
    expect.that(whole, "indices from 0 on", "other numbers", "Return indices, not positions.")
    top = int(taken.max())
    hint = "The last tooth may fall behind the last end: rounding makes the sum less than one."
    expect.that(top < N, f"indices below {N}", f"{top}", hint)
    return [int(k) for k in taken]


def by_walking(weights: Tensor, r: float) -> list[int]:
    """The same by another route: walk along the line, from tooth to tooth."""
    N, k, taken = len(weights), 0, []
    w = (weights / weights.sum()).tolist()
    end = w[0]
    for tooth in range(N):
        while k < N - 1 and (tooth + r) / N >= end:
            k += 1
            end += w[k]
        taken.append(k)
    return taken


@systematic.must("take the particles on which the teeth fall")
def teeth(answer, given):
    for N, r in [(6, 0.3), (11, 0.85), (40, 0.02)]:
        w = given.uniform(0.05, 1.0, N)
        w = w / w.sum()
        came, want = comb(answer, w, r), by_walking(w, r)
        hint = "Tooth i is at (i + r) / N. Which particle covers that place?"
        shifted = by_walking(w.roll(1), r)
        if came == [k + 1 for k in want] or came == shifted:
            hint = "You are one particle too far."
        elif sorted(came) != came:
            hint = "The teeth are in order, and so are the particles: do not draw at random."
        elif came == by_walking(w, 0.0):
            hint = "The comb is moved by r."
        expect.that(came == want, f"{want[:8]}", f"{came[:8]}", hint)


@systematic.must("never take a particle without weight")
def without_weight(answer, given):
    w = torch.tensor([0.0, 0.5, 0.0, 0.5, 0.0]).double()
    for r in (0.0, 0.5, 0.999):
        came = comb(answer, w, r)
        hint = "A tooth exactly on an end belongs to the next particle: right=True."
        expect.that(not {0, 2, 4} & set(came), "only particles 1 and 3", f"{came}", hint)


@systematic.must("not run over the end where the weights sum to a little less than one")
def over_the_end(answer, given):
    w = torch.full((1000,), 1e-3).double() * (1 - 1e-9)
    came = comb(answer, w, 1 - 1e-12)
    most = max(came.count(k) for k in came)
    expect.that(most <= 2, "each about once", f"one {most} times", "All weights are equal.")


is_unbiased = Exercise(
    "5.5", "Which resampling is biased?", minutes=20, takes="resample", points=2, seconds=90
)


def draws(weights, generator):
    """Independent draws."""
    return torch.multinomial(weights, len(weights), replacement=True, generator=generator)


def moved_comb(weights, generator):
    """The comb."""
    r = float(torch.rand((), generator=generator, dtype=torch.float64))
    return torch.tensor(by_walking(weights, r))


def stratified(weights, generator):
    """A comb each of whose teeth is moved on its own."""
    N = len(weights)
    places = (torch.arange(N) + torch.rand(N, generator=generator, dtype=torch.float64)) / N
    return torch.searchsorted(weights.cumsum(0) / weights.sum(), places).clamp(max=N - 1)


def best_only(weights, generator):
    """Takes the heaviest one N times."""
    return torch.full((len(weights),), int(weights.argmax()))


def rounded(weights, generator):
    """As often as N w rounded, the rest the heaviest."""
    counts = (len(weights) * weights).round().long()
    taken = torch.repeat_interleave(torch.arange(len(weights)), counts)
    best = torch.full((len(weights),), int(weights.argmax()))
    return torch.cat([taken, best])[: len(weights)]


def without_light_ones(weights, generator):
    """Draws, but only among those above the mean weight."""
    kept = torch.where(weights > 1 / len(weights), weights, 0)
    return torch.multinomial(kept, len(kept), replacement=True, generator=generator)


def squared(weights, generator):
    """Draws by the squares of the weights."""
    return draws(weights**2, generator)


def all_alike(weights, generator):
    """Draws as if all weights were equal."""
    return draws(torch.ones_like(weights), generator)


def without_the_lightest(weights, generator):
    """Draws, but never the lightest one."""
    kept = weights.clone()
    kept[weights.argmin()] = 0
    return draws(kept, generator)


RIGHT = {"draws independently": draws, "lays a comb": moved_comb, "draws by strata": stratified}
WRONG = {
    "always takes the best": best_only,
    "rounds N w": rounded,
    "drops those below the mean weight": without_light_ones,
    "squares the weights": squared,
    "ignores the weights": all_alike,
    "never takes the lightest": without_the_lightest,
}


def says(answer, resample) -> bool:
    """What a test says of a way to resample."""
    return bool(expect.tensor("True or False", answer(resample), ()))


@is_unbiased.must("accept ways of resampling that are unbiased")
def accepts(answer, given):
    for words, resample in RIGHT.items():
        hint = "Mean counts are random, too: more calls, or a larger tolerance."
        expect.that(says(answer, resample), f"True of one that {words}", "False", hint)


@is_unbiased.must("refuse ways of resampling that are biased")
def refuses(answer, given):
    for words, resample in WRONG.items():
        hint = "Compare the mean counts of all particles with N w, light ones as well."
        expect.that(not says(answer, resample), f"False of one that {words}", "True", hint)


locate = Exercise(
    "5.6",
    "A car that hears how far posts are",
    minutes=30,
    takes="y, u",
    points=3,
    seconds=120,
    random=True,
)


def located(answer, seed: int) -> tuple[Tensor, Tensor]:
    """The true positions of a car, and where an answer has it."""
    truth, u, y = lost_car.drive(seed)
    return truth[:, :2], expect.tensor("the positions", answer(y, u), (len(y), 2))


@locate.must("return a position for each step")
def positions(answer, given):
    located(answer, 1)


@locate.must("find cars that it has not seen, to within 0.1 m in the second half")
def finds(answer, given):
    for seed in (2, 3, 4, 5):
        truth, came = located(answer, seed)
        half = len(truth) // 2
        error = float((came - truth)[half:].norm(dim=-1).mean())
        mirrored = float((came + truth)[half:].norm(dim=-1).mean())
        hint = "Do the particles keep a spread: noise after the move, and enough of them?"
        if mirrored < error / 3:
            hint = "The car is on the other side: a sign of the turn, or of the heading."
        elif error > 1:
            hint = "It is lost. Are the headings of the particles all around at the start?"
        expect.that(error < 0.1, "a mean error below 0.1 m", f"{error:.2f} m", hint)
