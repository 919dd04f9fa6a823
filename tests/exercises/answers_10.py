"""Answers to lab 10 on batches, laps, intervals and rare events, as students give them."""

import math

import numpy as np
import torch
from graders import right, wrong

from pypose_lite import infinity

# --- 10.1


def outside(x, lane):
    return infinity.tracking_error(x) > lane


@right("10.1")
def by_counting(x, lane):
    return (outside(x, lane).cumsum(-1) == 0).sum(-1)


@right("10.1")
def by_argmax(x, lane):
    out = outside(x, lane)
    return torch.where(out.any(-1), out.int().argmax(-1), x.shape[-2])


@right("10.1")
def by_a_loop_over_the_steps(x, lane):
    out = outside(x, lane)
    first = torch.full(out.shape[:-1], out.shape[-1])
    for k in reversed(range(out.shape[-1])):
        first = torch.where(out[..., k], k, first)
    return first


@right("10.1")
def with_numpy(x, lane):
    numbers = np.arange(x.shape[-2])
    return np.where(outside(x, lane).numpy(), numbers, x.shape[-2]).min(-1)


@wrong("10.1", "argmax says 0")
def argmax_alone(x, lane):
    return outside(x, lane).int().argmax(-1)


@wrong("10.1", "A lap that never leaves has 20, the number of its states")
def minus_one_for_none(x, lane):
    out = outside(x, lane)
    return torch.where(out.any(-1), out.int().argmax(-1), -1)


@wrong("10.1", "the state after the last one")
def the_last_for_none(x, lane):
    return by_counting(x, lane).clamp(max=x.shape[-2] - 1)


@wrong("10.1", "the first one is wanted")
def the_last_exit(x, lane):
    numbers = torch.arange(x.shape[-2])
    last = torch.where(outside(x, lane), numbers, -1).amax(-1)
    return torch.where(last < 0, x.shape[-2], last)


@wrong("10.1", "counted from 0")
def counted_from_one(x, lane):
    return by_counting(x, lane) + 1


@wrong("10.1", "those after the first exit do not matter")
def all_states_inside(x, lane):
    return (~outside(x, lane)).sum(-1)


@wrong("10.1", "few operations for 2000 cars")
def a_loop_over_the_cars(x, lane):
    if x.ndim == 2:
        return by_counting(x, lane)
    return torch.stack([a_loop_over_the_cars(car, lane) for car in x])


@wrong("10.1", "of shape (6,)")
def of_the_whole_batch(x, lane):
    out = outside(x, lane).flatten(0, -2).any(0)
    return (out.cumsum(-1) == 0).sum(-1)


@wrong("10.1", "as a single number; got one of shape (20,)")
def for_one_dimension_only(x, lane):
    return torch.stack([by_counting(car, lane) for car in x]).reshape(len(x))


# --- 10.2


@right("10.2")
def by_the_formula(z, share):
    return math.ceil((1.96 * z.std() / (share * z.mean())) ** 2)


@right("10.2")
def with_the_exact_quantile(z, share):
    z = z.numpy()
    return int(np.ceil((1.959964 * z.std() / share / abs(z.mean())) ** 2))


@right("10.2")
def by_searching(z, share):
    low, high = 1, 10**9
    while low < high:
        middle = (low + high) // 2
        enough = 1.96 * z.std() / middle**0.5 <= share * z.mean().abs()
        low, high = (low, middle) if enough else (middle + 1, high)
    return low


@wrong("10.2", "Squared: the standard error")
def not_squared(z, share):
    return math.ceil(1.96 * z.std() / (share * z.mean().abs()))


@wrong("10.2", "the root of the variance")
def with_the_variance(z, share):
    return math.ceil((1.96 * z.var() / (share * z.mean())) ** 2)


@wrong("10.2", "The half-width is 1.96 standard errors")
def one_standard_error(z, share):
    return math.ceil((z.std() / (share * z.mean())) ** 2)


@wrong("10.2", "The half-width counts")
def whole_width_of_twice_the_share(z, share):
    return math.ceil((1.96 * z.std() / (2 * share * z.mean())) ** 2)


@wrong("10.2", "To each side")
def half_of_the_share(z, share):
    return math.ceil((1.96 * z.std() / (share / 2 * z.mean())) ** 2)


@wrong("10.2", "relative to its size")
def absolute(z, share):
    return math.ceil((1.96 * z.std() / share) ** 2)


@wrong("10.2", "Round up")
def not_a_whole_number(z, share):
    return ((1.96 * z.std() / (share * z.mean())) ** 2).item()


# --- 10.3


@right("10.3")
def by_the_quadratic_equation(k, n):
    c = 1.96**2 / n
    b, p = 2 * k / n + c, k / n
    d = math.sqrt(b * b - 4 * (1 + c) * p * p)
    return (b - d) / 2 / (1 + c), (b + d) / 2 / (1 + c)


@right("10.3")
def as_in_books(k, n):
    p, z = k / n, 1.959964
    centre = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * math.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    return [max(0.0, centre - half), min(1.0, centre + half)]


@right("10.3")
def by_numpy_roots(k, n):
    c, p = 1.96**2 / n, k / n
    return torch.tensor(np.sort(np.roots([1 + c, -(2 * p + c), p * p]).real))


@wrong("10.3", "That is the simple interval")
def the_simple_one(k, n):
    p = k / n
    half = 1.96 * math.sqrt(p * (1 - p) / n)
    return p - half, p + half


@wrong("10.3", "The lower end comes first")
def the_wrong_way_around(k, n):
    return by_the_quadratic_equation(k, n)[::-1]


@wrong("10.3", "Divide by twice the factor")
def without_the_factor(k, n):
    c = 1.96**2 / n
    low, high = by_the_quadratic_equation(k, n)
    return low * (1 + c), high * (1 + c)


@wrong("10.3", "Divide by 2 (1 + c), not by (1 + c)")
def without_the_two(k, n):
    low, high = by_the_quadratic_equation(k, n)
    return 2 * low, 2 * high


@wrong("10.3", "one standard deviation")
def one_standard_deviation(k, n):
    p = k / n
    half = math.sqrt(p * (1 - p) / n)
    return p - half, p + half


@wrong("10.3", "2 results: the lower end, the upper end")
def only_the_upper_end(k, n):
    return by_the_quadratic_equation(k, n)[1]


# --- 10.4


def values_of(fails, mu, w):
    s = w + mu
    return fails(s) * torch.exp(mu @ mu / 2 - s @ mu)


def with_its_error(values):
    return values.mean(), values.std() / math.sqrt(len(values))


@right("10.4")
def by_weights(fails, mu, w):
    return with_its_error(values_of(fails, mu, w))


@right("10.4")
def by_distributions(fails, mu, w):
    true = torch.distributions.MultivariateNormal(torch.zeros_like(mu), torch.eye(len(mu)))
    used = torch.distributions.MultivariateNormal(mu, torch.eye(len(mu)))
    s = used.mean + w
    return with_its_error(fails(s) * (true.log_prob(s) - used.log_prob(s)).exp())


@right("10.4")
def lap_by_lap(fails, mu, w):
    values = []
    for row in w:
        s = row + mu
        quotient = math.exp(-float(mu @ row) - float(mu @ mu) / 2)
        values.append(quotient if fails(s[None])[0] else 0.0)
    return np.mean(values), np.std(values) / len(values) ** 0.5


@wrong("10.4", "among the w hardly any fails")
def plainly(fails, mu, w):
    return with_its_error(fails(w).double())


@wrong("10.4", "fail far too often: weigh them")
def without_weights(fails, mu, w):
    return with_its_error(fails(w + mu).double())


@wrong("10.4", "not the reverse")
def the_reverse_weight(fails, mu, w):
    s = w + mu
    return with_its_error(fails(s) / torch.exp(mu @ mu / 2 - s @ mu))


@wrong("10.4", "the draw that was used")
def the_weight_of_w(fails, mu, w):
    return with_its_error(fails(w + mu) * torch.exp(mu @ mu / 2 - w @ mu))


@wrong("10.4", "leave a factor in the weight")
def without_the_square(fails, mu, w):
    return with_its_error(fails(w + mu) * torch.exp(-(w + mu) @ mu))


@wrong("10.4", "halved in the exponent")
def without_the_half(fails, mu, w):
    return with_its_error(fails(w + mu) * torch.exp(mu @ mu - (w + mu) @ mu))


@wrong("10.4", "not by the sum of the weights")
def by_the_sum_of_the_weights(fails, mu, w):
    weights = torch.exp(mu @ mu / 2 - (w + mu) @ mu)
    chance = (fails(w + mu) * weights).sum() / weights.sum()
    return chance, chance / math.sqrt(len(w))


@wrong("10.4", "one lap; divide by the root of n")
def the_standard_deviation(fails, mu, w):
    values = values_of(fails, mu, w)
    return values.mean(), values.std()


@wrong("10.4", "the standard error of plain simulation")
def the_error_of_a_coin(fails, mu, w):
    p = values_of(fails, mu, w).mean()
    return p, (p * (1 - p) / len(w)).sqrt()


@wrong("10.4", "1.96 of them")
def the_half_width(fails, mu, w):
    p, error = by_weights(fails, mu, w)
    return p, 1.96 * error
