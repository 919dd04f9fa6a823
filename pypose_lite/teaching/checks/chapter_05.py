"""What the answers of lab 5 must do: sigma points. Particles: chapter_05_particles."""

import math

import torch
from torch import Tensor

from . import expect
from .exercise import Exercise

sigma_points = Exercise("5.1", "Sigma points", minutes=10, takes="x, P, k")


def drawn(answer, given, n: int, k: float) -> tuple[Tensor, ...]:
    """A belief, and the points and weights that an answer makes of it."""
    x, P = given.randn(n), given.positive(n)
    points, weights = expect.parts(answer(x, P, k), "the points", "the weights")
    shape = (2 * n + 1, n)
    points = expect.tensor("the points", points, shape)
    return x, P, points, expect.tensor("the weights", weights, (2 * n + 1,))


SIZES = [(3, 1.0), (2, 0.5), (1, 2.0), (4, 0.0)]


@sigma_points.must("return 2n + 1 points as rows, and a weight for each")
def shapes(answer, given):
    for n, k in SIZES:
        drawn(answer, given, n, k)


@sigma_points.must("give weights that sum to one, the first of them k / (n + k)")
def weights_of_points(answer, given):
    for n, k in SIZES:
        *_, weights = drawn(answer, given, n, k)
        want = torch.full((2 * n + 1,), 0.5 / (n + k))
        want[0] = k / (n + k)
        even = torch.full((2 * n + 1,), 1 / (2 * n + 1))
        whole = torch.full((2 * n + 1,), 1 / (n + k))
        whole[0] = k / (n + k)
        mistakes = {
            "The centre has a weight of its own, k / (n + k).": even,
            "There are two points for each column: half of 1 / (n + k) for each.": whole,
        }
        hint = "The outer points share what is left: 1 / (2 (n + k)) for each."
        expect.close("the weights", weights, want, hint, mistakes)


@sigma_points.must("make the weighted mean of the points the mean of the belief")
def mean_of_points(answer, given):
    for n, k in SIZES:
        x, P, points, weights = drawn(answer, given, n, k)
        hint = "Each step is taken in both directions, so that they cancel."
        expect.close("their mean", weights @ points, x, hint)


@sigma_points.must("make the weighted covariance of the points that of the belief")
def covariance_of_points(answer, given):
    for n, k in SIZES:
        x, P, points, weights = drawn(answer, given, n, k)
        away = points - x
        L = torch.linalg.cholesky(P)
        mistakes = {
            "These are the rows of L. Its columns are the rows of L.mT.": L.mT @ L,
            "The steps are too short: they are sqrt(n + k) times the columns.": P / (n + k),
            "The steps are sqrt(n + k) times the columns, not n + k times.": (n + k) * P,
            "P itself was taken for its root.": P @ P,
        }
        came = (weights * away.mT) @ away
        expect.close("their covariance", came, P, "P = L L', and sqrt(n + k) L.", mistakes)


unscented = Exercise("5.2", "The unscented transform", minutes=10, takes="f, x, P, k")


def transformed(answer, f, x, P, k, m: int) -> tuple[Tensor, Tensor]:
    """The mean and the covariance that an answer gives."""
    mean, covariance = expect.parts(answer(f, x, P, k), "the mean", "the covariance")
    mean = expect.tensor("the mean", mean, (m,))
    return mean, expect.tensor("the covariance", covariance, (m, m))


@unscented.must("be exact for a linear function")
def linear(answer, given):
    for n, m, k in [(3, 2, 0.5), (2, 3, 1.0)]:
        x, P, A, b = given.randn(n), given.positive(n), given.randn(m, n), given.randn(m)
        mean, covariance = transformed(answer, lambda z, A=A, b=b: z @ A.mT + b, x, P, k, m)
        expect.close("the mean", mean, A @ x + b, "The mean of A x + b is A m + b.")
        even = A @ P @ A.mT * 2 * (n + k) / (2 * n + 1)
        hint = "Subtract the mean of the images, and use the weights."
        mistakes = {"Use the weights of the points, not equal ones.": even}
        expect.close("the covariance", covariance, A @ P @ A.mT, hint, mistakes)


@unscented.must("be exact for the mean of a parabola")
def parabola(answer, given):
    for n, k in [(2, 1.0), (3, 0.5)]:
        x, P, H = given.randn(n), given.positive(n), given.positive(n)

        def f(z, H=H):
            return ((z @ H) * z).sum(-1, keepdim=True)

        came, _ = transformed(answer, f, x, P, k, 1)
        flat = (x @ H @ x)[None]
        want = flat + (H @ P).trace()
        mistakes = {"This is f of the mean. Take the weighted mean of the images.": flat}
        expect.close("the mean", came, want, "The weighted mean of the images.", mistakes)


@unscented.must("measure the spread around the mean of the images")
def spread(answer, given):
    x, P = torch.tensor([0.3]).double(), torch.tensor([[0.49]]).double()
    mean, covariance = transformed(answer, lambda z: z**2, x, P, 2.0, 1)
    points = x + torch.tensor([0.0, 1.0, -1.0]).double() * math.sqrt(3 * 0.49)
    weights = torch.tensor([2 / 3, 1 / 6, 1 / 6]).double()
    images = points**2
    want = weights @ (images - weights @ images) ** 2
    around = weights @ (images - x**2) ** 2
    mistakes = {"Subtract the mean of the images, not the image of the mean.": around[None, None]}
    hint = "away = images - mean, and weights in the sum."
    expect.close("the covariance", covariance, want[None, None], hint, mistakes)
