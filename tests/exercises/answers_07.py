"""Answers to lab 7, as students give them: comparing loops, and taking errors apart."""

import math

import numpy as np
import torch
from graders import right, wrong

import pypose_lite as pp

car = pp.DubinsCar(0.1)

# --- 7.1


@right("7.1")
def with_statistics(a, b):
    import statistics

    gaps = [float(x - y) for x, y in zip(a, b)]
    return statistics.fmean(gaps), 1.96 * statistics.stdev(gaps) / len(gaps) ** 0.5


@right("7.1")
def in_numpy(a, b):
    d = a.numpy() - b.numpy()
    return d.mean(), 1.96 * d.std(ddof=1) / np.sqrt(len(d))


@right("7.1")
def in_float32(a, b):
    d = (a - b).float()
    return d.mean(), 1.96 * (d.var() / len(d)).sqrt()


@wrong("7.1", "This is b - a")
def the_other_way(a, b):
    return in_numpy(b, a)


@wrong("7.1", "take a - b first")
def unpaired(a, b):
    return (a - b).mean(), 1.96 * ((a.var() + b.var()) / len(a)) ** 0.5


@wrong("7.1", "spread of single laps")
def of_single_laps(a, b):
    return (a - b).mean(), 1.96 * (a - b).std()


@wrong("7.1", "This is one standard error")
def a_standard_error(a, b):
    return (a - b).mean(), (a - b).std() / len(a) ** 0.5


@wrong("7.1", "divides by n - 1")
def of_a_population(a, b):
    return (a - b).mean(), 1.96 * (a - b).std(unbiased=False) / len(a) ** 0.5


@wrong("7.1", "the whole width")
def both_sides(a, b):
    mean, half = in_numpy(a, b)
    return mean, 2 * half


@wrong("7.1", "not by n")
def over_n(a, b):
    return (a - b).mean(), 1.96 * (a - b).std() / len(a)


@wrong("7.1", "2 results")
def the_mean_alone(a, b):
    return (a - b).mean()


# --- 7.2


@right("7.2")
def by_counting(differences, half_width):
    n = 1
    while 1.96 * differences.std() / n**0.5 > half_width:
        n += 1
    return n


@right("7.2")
def by_the_variance(differences, half_width):
    return torch.ceil(1.96**2 * differences.var() / half_width**2)


@wrong("7.2", "round up")
def rounded_down(differences, half_width):
    return max(int((1.96 * differences.std() / half_width) ** 2), 1)


@wrong("7.2", "the square root of n")
def not_squared(differences, half_width):
    return math.ceil(1.96 * differences.std() / half_width)


@wrong("7.2", "1.96 standard errors")
def one_standard_error(differences, half_width):
    return math.ceil((differences.std() / half_width) ** 2)


@wrong("7.2", "the 30 laps that you have do not count")
def times_those_there_are(differences, half_width):
    return len(differences) * by_counting(differences, half_width)


@wrong("7.2", "is a whole number")
def not_rounded(differences, half_width):
    return max((1.96 * differences.std() / half_width) ** 2, torch.tensor(1.0))


# --- 7.3


def outside(place):
    return torch.hypot(place[..., 0] - 1, place[..., 1]) - 1


def from_distances(t, b, c, cross=2.0):
    j, e = b - c, t - b
    return (*(z.square().mean() for z in (c, j, e)), cross * (c * j + c * e + j * e).mean())


def places(x, X, u):
    return outside(x[1:]), outside(X[1:]), outside(car.transition(X[:-1], u))


@right("7.3")
def by_the_sum(x, X, u):
    t, b, c = places(x, X, u)
    parts = [z.square().mean() for z in (c, b - c, t - b)]
    return [*parts, t.square().mean() - sum(parts)]


@right("7.3")
def step_by_step(x, X, u):
    rows = []
    for i in range(len(u)):
        c = math.dist(car.transition(X[i], u[i])[:2].tolist(), (1, 0)) - 1
        j = math.dist(X[i + 1, :2].tolist(), (1, 0)) - 1 - c
        e = math.dist(x[i + 1, :2].tolist(), (1, 0)) - 1 - c - j
        rows.append([c * c, j * j, e * e, 2 * (c * j + c * e + j * e)])
    return np.array(rows).mean(0)


@wrong("7.3", "a sum")
def cross_terms_once(x, X, u):
    return from_distances(*places(x, X, u), cross=1.0)


@wrong("7.3", "u[i] leads to state i + 1")
def one_step_early(x, X, u):
    return from_distances(outside(x[:-1]), outside(X[:-1]), outside(car.transition(X[:-1], u)))


@wrong("7.3", "The cross terms are not zero here")
def without_cross_terms(x, X, u):
    return from_distances(*places(x, X, u), cross=0.0)


@wrong("7.3", "the MPC knew X[i]")
def from_the_truth(x, X, u):
    return from_distances(outside(x[1:]), outside(X[1:]), outside(car.transition(x[:-1], u)))


@wrong("7.3", "This is the believed distance")
def without_the_jump(x, X, u):
    return from_distances(outside(x[1:]), outside(X[1:]), outside(X[1:]))


@wrong("7.3", "before the step")
def before_the_step(x, X, u):
    return from_distances(outside(x[1:]), outside(X[1:]), outside(X[:-1]))


@wrong("7.3", "Distances have signs")
def without_signs(x, X, u):
    t, b, c = places(x, X, u)
    c2, j2, e2 = (z.square().mean() for z in (c, b.abs() - c.abs(), t - b))
    return c2, j2, e2, t.square().mean() - c2 - j2 - e2


@wrong("7.3", "have changed places")
def in_another_order(x, X, u):
    c2, j2, e2, cross = by_the_sum(x, X, u)
    return c2, e2, j2, cross


@wrong("7.3", "4 results")
def three_of_them(x, X, u):
    return by_the_sum(x, X, u)[:3]


# --- 7.4

ANSWER = {"a": "MPC", "b": "sensor", "c": "plan", "d": "filter"}
right("7.4", "as asked")(ANSWER)
right("7.4", "in small letters")({letter: block.lower() for letter, block in ANSWER.items()})
wrong("7.4", "the car does not get there", "plan for MPC")(ANSWER | {"a": "plan", "c": "MPC"})
wrong("7.4", "has a mean that is not 0", "filter for sensor")(
    ANSWER | {"b": "filter", "d": "sensor"}
)
wrong("7.4", "targets themselves", "all MPC but two")(ANSWER | {"c": "MPC"})
wrong("7.4", "believes itself too much", "sensor twice")(ANSWER | {"d": "sensor"})
wrong("7.4", "One entry for each", "three entries")({"a": "MPC", "b": "sensor", "c": "plan"})
wrong("7.4", "one of plan, MPC", "another word")(ANSWER | {"a": "car"})
wrong("7.4", "a dictionary", "a list")(["MPC", "sensor", "plan", "filter"])
