"""Answers to lab 5, as students give them."""

import math

import torch
from graders import right, wrong

import pypose_lite as pp
from pypose_lite.teaching.checks import lost_car

# --- 5.1


def points_with(x, P, k, root, scale=None, w=None):
    n = len(x)
    step = (math.sqrt(n + k) if scale is None else scale) * root
    weights = torch.full((2 * n + 1,), 0.5 / (n + k), dtype=P.dtype) if w is None else w
    weights = weights.clone()
    if w is None:
        weights[0] = k / (n + k)
    return torch.cat([x[None], x + step, x - step]), weights


@right("5.1")
def by_cholesky(x, P, k):
    return points_with(x, P, k, torch.linalg.cholesky(P).T)


@right("5.1")
def by_eigenvectors(x, P, k):
    values, vectors = torch.linalg.eigh(P)
    return points_with(x, P, k, (vectors * values.sqrt()).T)


@right("5.1")
def in_a_loop(x, P, k):
    n, L = len(x), torch.linalg.cholesky(P)
    points, weights = [x], [k / (n + k)]
    for j in range(n):
        for sign in (1, -1):
            points.append(x + sign * math.sqrt(n + k) * L[:, j])
            weights.append(0.5 / (n + k))
    return torch.stack(points), torch.tensor(weights, dtype=torch.float64)


@wrong("5.1", "These are the rows of L")
def rows_of_the_root(x, P, k):
    return points_with(x, P, k, torch.linalg.cholesky(P))


@wrong("5.1", "The steps are too short")
def steps_without_a_factor(x, P, k):
    return points_with(x, P, k, torch.linalg.cholesky(P).T, scale=1.0)


@wrong("5.1", "not n + k times")
def steps_too_long(x, P, k):
    return points_with(x, P, k, torch.linalg.cholesky(P).T, scale=len(x) + k)


@wrong("5.1", "P itself was taken for its root")
def without_a_root(x, P, k):
    return points_with(x, P, k, P)


@wrong("5.1", "a weight of its own")
def equal_weights(x, P, k):
    N = 2 * len(x) + 1
    w = torch.full((N,), 1 / N, dtype=P.dtype)
    return points_with(x, P, k, torch.linalg.cholesky(P).T, w=w)


@wrong("5.1", "half of 1 / (n + k)")
def weights_twice_as_large(x, P, k):
    points, w = by_cholesky(x, P, k)
    return points, torch.cat([w[:1], 2 * w[1:]])


# --- 5.2


@right("5.2")
def images_of_points(f, x, P, k):
    points, w = by_cholesky(x, P, k)
    z = f(points)
    mean = (w[:, None] * z).sum(0)
    return mean, sum(wi * torch.outer(zi - mean, zi - mean) for wi, zi in zip(w, z))


@right("5.2")
def by_second_moments(f, x, P, k):
    points, w = by_eigenvectors(x, P, k)
    z = f(points)
    mean = w @ z
    return mean, (w * z.T) @ z - torch.outer(mean, mean)


@wrong("5.2", "This is f of the mean")
def f_of_the_mean(f, x, P, k):
    _, covariance = images_of_points(f, x, P, k)
    return f(x[None])[0], covariance


@wrong("5.2", "not the image of the mean")
def spread_around_the_image(f, x, P, k):
    points, w = by_cholesky(x, P, k)
    z = f(points)
    away = z - f(x[None])[0]
    return w @ z, (w * away.T) @ away


@wrong("5.2", "not equal ones")
def covariance_with_equal_weights(f, x, P, k):
    points, w = by_cholesky(x, P, k)
    z = f(points)
    away = z - w @ z
    return w @ z, away.T @ away / len(z)


@wrong("5.2", "of shape (2,)")
def covariance_first(f, x, P, k):
    return images_of_points(f, x, P, k)[::-1]


# --- 5.3


@right("5.3")
def by_softmax(log_weights):
    return 1 / log_weights.softmax(0).pow(2).sum()


@right("5.3")
def by_logsumexp(log_weights):
    return (2 * log_weights.logsumexp(0) - (2 * log_weights).logsumexp(0)).exp()


@right("5.3")
def with_the_largest_removed(log_weights):
    w = (log_weights - log_weights.max()).exp()
    return (w.sum() ** 2 / (w**2).sum()).item()


@wrong("5.3", "Subtract the largest logarithm")
def exponentials_alone(log_weights):
    w = log_weights.exp()
    return w.sum() ** 2 / w.square().sum()


@wrong("5.3", "Weights are normalised first")
def not_normalised(log_weights):
    w = log_weights.exp()
    return 1 / w.square().sum()


@wrong("5.3", "Weights are normalised first")
def without_the_inverse(log_weights):
    return log_weights.softmax(0).square().sum()


@wrong("5.3", "the entropy's number")
def by_entropy(log_weights):
    w = log_weights.softmax(0)
    return (-(w * w.clamp(min=1e-300).log()).sum()).exp()


@wrong("5.3", "Expected it = 5")
def number_of_heavy_ones(log_weights):
    return (log_weights.softmax(0) > 1 / len(log_weights)).sum().double()


# --- 5.4


@right("5.4")
def walked(weights, r):
    N, k, taken = len(weights), 0, []
    w = (weights / weights.sum()).tolist()
    end = w[0]
    for i in range(N):
        while (i + r) / N >= end and k < N - 1:
            k += 1
            end += w[k]
        taken.append(k)
    return taken


@right("5.4")
def clamped(weights, r):
    N = len(weights)
    last = int(weights.nonzero().max())
    teeth = (torch.arange(N, dtype=torch.float64) + r) / N
    return torch.searchsorted(weights.cumsum(0), teeth, right=True).clamp(max=last)


@wrong("5.4", "The last tooth may fall behind the last end")
def over_the_end(weights, r):
    N = len(weights)
    teeth = (torch.arange(N, dtype=torch.float64) + r) / N
    return torch.searchsorted(weights.cumsum(0), teeth, right=True)


@wrong("5.4", "right=True")
def the_empty_one_at_zero(weights, r):
    N = len(weights)
    ends = weights.cumsum(0)
    teeth = (torch.arange(N, dtype=torch.float64) + r) / N
    return torch.searchsorted(ends / ends[-1], teeth)


@wrong("5.4", "The comb is moved by r")
def comb_that_stands_still(weights, r):
    return walked(weights, 0.0)


@wrong("5.4", "do not draw at random")
def independent_draws(weights, r):
    g = torch.Generator().manual_seed(0)
    return torch.multinomial(weights, len(weights), replacement=True, generator=g)


@wrong("5.4", "Return indices, not positions")
def positions_of_the_teeth(weights, r):
    return (torch.arange(len(weights)) + r) / len(weights)


# --- 5.5

TRIAL = torch.tensor([0.03, 0.04, 0.05, 0.03, 0.3, 0.05, 0.25, 0.08, 0.1, 0.07]).double()


def mean_counts(resample, calls=1500, weights=TRIAL):
    g = torch.Generator().manual_seed(1)
    counts = torch.zeros(len(weights)).double()
    for _ in range(calls):
        counts += torch.bincount(torch.as_tensor(resample(weights, g)), minlength=len(weights))
    return counts / calls


@right("5.5")
def by_mean_counts(resample):
    return ((mean_counts(resample) - 10 * TRIAL).abs() < 0.15).all()


@right("5.5")
def by_standard_errors(resample):
    tolerance = 5 * (10 * TRIAL / 1500).sqrt() + 0.01
    return bool(((mean_counts(resample) - 10 * TRIAL).abs() < tolerance).all())


@wrong("5.5", "False of one that")
def accepts_all(resample):
    return True


@wrong("5.5", "Mean counts are random, too")
def with_one_call(resample):
    return ((mean_counts(resample, calls=1) - 10 * TRIAL).abs() < 0.15).all()


@wrong("5.5", "light ones as well")
def by_the_heaviest_alone(resample):
    return (mean_counts(resample)[4] - 3).abs() < 0.2


@wrong("5.5", "False of one that rounds N w")
def with_equal_weights(resample):
    even = torch.full((10,), 0.1).double()
    return ((mean_counts(resample, weights=even) - 1).abs() < 0.15).all()


@wrong("5.5", "True or False")
def returns_nothing(resample):
    by_mean_counts(resample)


# --- 5.6


def particle_filter(y, u, N=2000, noise=0.01, spread=2 * math.pi, resample=True, seed=0, car=None):
    g = torch.Generator().manual_seed(seed)
    car = car or pp.DubinsCar(0.1)
    heading = spread * torch.rand(N, generator=g, dtype=torch.float64)
    zero = torch.zeros_like(heading)
    X = torch.stack([zero, zero, heading.cos(), heading.sin()], 1)
    logs, found = torch.zeros_like(heading), []
    for yi, ui in zip(y, u):
        d = (X[:, None, :2] - lost_car.POSTS).norm(dim=-1)
        logs = logs - ((yi - d) ** 2).sum(-1) / (2 * 0.1**2)
        w = logs.softmax(0)
        found.append(w @ X[:, :2])
        if resample:
            X = X[torch.multinomial(w, N, replacement=True, generator=g)]
            logs = torch.zeros_like(logs)
        w = noise * torch.randn(N, 4, generator=g, dtype=torch.float64)
        X = car.transition(X, ui) + w
    return torch.stack(found)


@right("5.6")
def with_independent_draws(y, u):
    return particle_filter(y, u)


@right("5.6")
def by_the_library(y, u):
    class Listener(pp.DubinsCar):
        def observation(self, state, input, t=None):
            return (state[..., None, :2] - state.new_tensor(lost_car.POSTS.tolist())).norm(dim=-1)

    one = torch.eye(4, dtype=torch.float64)
    R = 0.01 * torch.eye(3, dtype=torch.float64)
    pf = pp.PF(Listener(0.1), 0.01**2 * one, R, particles=3000)
    g = torch.Generator().manual_seed(0)
    zero = torch.zeros(4, dtype=torch.float64)
    around = torch.tensor([0.001, 0.001, 1.0, 1.0], dtype=torch.float64).square().diag()
    cloud = pf.draw(zero, around, g)
    states = cloud.x.clone()
    states[:, 2:] = states[:, 2:] / states[:, 2:].norm(dim=-1, keepdim=True)
    cloud, found = cloud._replace(x=states), []
    for yi, ui in zip(y, u):
        found.append(pf.weigh(cloud, yi, ui).mean[:2])
        cloud = pf.step(cloud, yi, ui, generator=g)
    return torch.stack(found)


@wrong("5.6", "headings of the particles all around")
def one_heading(y, u):
    return particle_filter(y, u, spread=0.01)


@wrong("5.6", "Do the particles keep a spread")
def too_few_particles(y, u):
    return particle_filter(y, u, N=20, noise=0.0)


@wrong("5.6", "mean error below")
def the_commands_alone(y, u):
    car, x = pp.DubinsCar(0.1), torch.tensor([0.0, 0, 1, 0]).double()
    found = []
    for ui in u:
        found.append(x[:2])
        x = car.transition(x, ui)
    return torch.stack(found)


@wrong("5.6", "mean error below")
def without_resampling_or_noise(y, u):
    return particle_filter(y, u, N=12, noise=0.0, resample=False)


@wrong("5.6", "of shape (60, 2)")
def whole_states(y, u):
    found = particle_filter(y, u)
    return torch.cat([found, found], dim=1)
