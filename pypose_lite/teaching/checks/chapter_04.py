"""What the answers of lab 4 must do: corrections, gaps, and a sensor that is late."""

import math

import torch
from torch import Tensor

from ...filters import EKF, angles
from ...systems import DubinsCar
from . import expect, recordings
from .exercise import Exercise


def by_information(x, P, y, C, R) -> tuple[Tensor, Tensor]:
    """The correction by another route: informations, which are inverse covariances, add up."""
    information = P.inverse() + C.mT @ R.inverse() @ C
    after = information.inverse()
    return after @ (P.inverse() @ x + C.mT @ R.inverse() @ y), after


def corrected(answer, *given, n: int) -> tuple[Tensor, Tensor]:
    """The x and the P of an answer, of the right shapes."""
    x, P = expect.parts(answer(*given), "x", "P")
    return expect.tensor("x", x, (n,)), expect.tensor("P", P, (n, n))


kalman_update = Exercise("4.1", "One correction", minutes=10, takes="x, P, y, C, R")
SIZES = [(2, 1), (3, 2), (2, 3), (1, 1)]
LOOSE = 1e-3  # for answers that invert matrices in float32


def belief(given, n: int, p: int) -> tuple[Tensor, ...]:
    """A belief, a measurement, and how it was measured."""
    return given.randn(n), given.positive(n), given.randn(p), given.randn(p, n), given.positive(p)


@kalman_update.must("return x of shape (n) and P of shape (n, n)")
def shapes(answer, given):
    for n, p in SIZES:
        corrected(answer, *belief(given, n, p), n=n)


@kalman_update.must("move the mean to what Bayes' rule says")
def mean(answer, given):
    for n, p in SIZES:
        x, P, y, C, R = belief(given, n, p)
        want, _ = by_information(x, P, y, C, R)
        S = C @ P @ C.mT + R
        mistakes = {
            "The innovation has the wrong sign: it is y - C x.": 2 * x - want,
            "S has lost R.": x + P @ C.mT @ torch.linalg.pinv(S - R) @ (y - C @ x),
            "The gain has lost the inverse of S.": x + P @ C.mT @ (y - C @ x),
            "The mean has not moved.": x,
            "K e is missing its x: the correction is added to x.": want - x,
        }
        came, _ = corrected(answer, x, P, y, C, R, n=n)
        hint = "x + K (y - C x), with K = P C' S^-1."
        expect.close("x", came, want, hint, mistakes, LOOSE)


@kalman_update.must("leave the covariance that Bayes' rule leaves")
def covariance(answer, given):
    for n, p in SIZES:
        x, P, y, C, R = belief(given, n, p)
        _, want = by_information(x, P, y, C, R)
        mistakes = {
            "P has not changed: a measurement makes it smaller.": P,
            "P has grown: it is (I - K C) P.": 2 * P - want,
            "Joseph's form needs K R K', too.": want @ P.inverse() @ want,
        }
        _, came = corrected(answer, x, P, y, C, R, n=n)
        expect.close("P", came, want, "(I - K C) P, or Joseph's form.", mistakes, LOOSE)


sighting_update = Exercise(
    "4.2", "A post behind the car", minutes=15, takes="x, P, y, post, R", points=2
)


def sight(post: Tensor):
    """The function g of a sensor that sees a post."""

    def g(state):
        away = post - state[..., :2]
        to_post = torch.atan2(away[..., 1], away[..., 0])
        heading = torch.atan2(state[..., 3], state[..., 2])
        return torch.stack([away.norm(dim=-1), to_post - heading], dim=-1)

    return g


def sighting(given, behind: bool):
    """A belief, what is seen of a post, where the post is, and R."""
    heading = given.uniform(-1, 1, 1)[0]
    x = torch.cat([given.randn(2), torch.stack([heading.cos(), heading.sin()])])
    P = 0.01 * given.positive(4)
    post = x[:2] + (-2.0 if behind else 2.0) * x[2:] + 0.02 * given.randn(2)
    R = torch.diag(torch.tensor([0.01, 0.002]))
    expected = sight(post)(x)
    direction = math.remainder(float(expected[1]), 2 * math.pi)
    over = -math.copysign(0.08, direction) if not behind else math.copysign(0.08, direction)
    seen = math.remainder(direction + over, 2 * math.pi)
    return x, P, torch.tensor([float(expected[0]) + 0.05, seen]), post, R


def by_library(x, P, y, post, R, residual=None, g=None) -> tuple[Tensor, Tensor]:
    """The correction of the library's filter, which knows which number is an angle."""
    ekf = EKF(DubinsCar(0.1), torch.eye(4), torch.eye(4))
    return ekf.update(x, y, None, P, R, g=g or sight(post), residual=residual)


def blind_to_heading(post: Tensor):
    """A g that forgets where the car is heading."""

    def g(state):
        away = post - state[..., :2]
        return torch.stack([away.norm(dim=-1), torch.atan2(away[..., 1], away[..., 0])], dim=-1)

    return g


@sighting_update.must("return x of shape (4) and P of shape (4, 4)")
def sighting_shapes(answer, given):
    corrected(answer, *sighting(given, behind=False), n=4)


@sighting_update.must("use what a post ahead of the car says")
def ahead(answer, given):
    for _ in range(3):
        x, P, y, post, R = sighting(given, behind=False)
        want, P_want = by_library(x, P, y, post, R, angles(1))
        forgot = by_library(x, P, y, post, R, angles(1), blind_to_heading(post))[0]
        turned = by_library(x, P, y * torch.tensor([1.0, -1.0]), post, R, angles(1))[0]
        mistakes = {
            "The direction is relative to the heading: subtract it.": forgot,
            "The innovation has the wrong sign.": 2 * x - want,
            "The direction has the wrong sign: positive is to the left.": turned,
        }
        came, P_came = corrected(answer, x, P, y, post, R, n=4)
        expect.close("x", came, want, "Compare your g and its Jacobian by hand.", mistakes)
        hint = "C is the Jacobian of g at x; P is then corrected as in Exercise 4.1."
        expect.close("P", P_came, P_want, hint, {"P has not changed.": P})


@sighting_update.must("take the short way around for a post behind the car")
def behind(answer, given):
    for _ in range(4):
        x, P, y, post, R = sighting(given, behind=True)
        want, _ = by_library(x, P, y, post, R, angles(1))
        mistakes = {
            "The innovation is nearly a full turn: wrap it.": by_library(x, P, y, post, R)[0],
        }
        came, _ = corrected(answer, x, P, y, post, R, n=4)
        hint = "Bring the innovation's angle between -pi and pi, after the subtraction."
        expect.close("x", came, want, hint, mistakes)


update_with_gaps = Exercise("4.3", "Measurements with gaps", minutes=10, takes="x, P, y, C, R")


@update_with_gaps.must("be the usual correction where nothing is missing")
def no_gap(answer, given):
    x, P, y, C, R = belief(given, 3, 2)
    want, P_want = by_information(x, P, y, C, R)
    came, P_came = corrected(answer, x, P, y, C, R, n=3)
    expect.close("x", came, want, "Here no row is missing.")
    expect.close("P", P_came, P_want, "Here no row is missing.")


@update_with_gaps.must("use the rows that are there")
def some_rows(answer, given):
    for missing in ([0], [2], [0, 1]):
        x, P, y, C, R = belief(given, 3, 3)
        y[missing] = torch.nan
        rows = [k for k in range(3) if k not in missing]
        known = y[rows], C[rows], R[rows][:, rows]
        want, P_want = by_information(x, P, *known)
        loose = by_information(x, P, y[rows], C[rows], torch.diag(R.diagonal()[rows]))[0]
        mistakes = {
            "A missing number is not zero.": by_information(x, P, y.nan_to_num(), C, R)[0],
            "A row is missing, not the whole measurement.": x,
            "R has correlations between its rows: R[known][:, known].": loose,
        }
        came, P_came = corrected(answer, x, P, y.clone(), C, R, n=3)
        expect.close("x", came, want, "Leave out rows of y and C, rows and columns of R.", mistakes)
        whole = by_information(x, P, y.nan_to_num(), C, R)[1]
        mistakes = {"P became smaller by rows that were not measured.": whole}
        expect.close("P", P_came, P_want, "Only known rows make P smaller.", mistakes)


@update_with_gaps.must("leave the belief as it is where all rows are missing")
def all_missing(answer, given):
    x, P, y, C, R = belief(given, 3, 2)
    came, P_came = corrected(answer, x, P, torch.full((2,), torch.nan), C, R, n=3)
    whole = by_information(x, P, C @ x, C, R)[1]
    expect.close("x", came, x, "Nothing was measured.")
    expect.close("P", P_came, P, "Nothing was measured.", {"P must not become smaller.": whole})


find_delay = Exercise("4.4", "Which sensor is late?", minutes=15, takes="y, u", seconds=60)


@find_delay.must("return a whole number from 0 to 4")
def whole_number(answer, given):
    came = expect.tensor("the delay", answer(*recordings.cart_run(11, 1)), ())
    fits = came == came.round() and 0 <= came <= 4
    expect.that(fits, "0, 1, 2, 3 or 4", f"{came:g}", "Return the delay itself, in steps.")


@find_delay.must("find the delay of recordings that it has not seen")
def unseen(answer, given):
    for late in (3, 0, 4, 1, 2):
        came = int(expect.tensor("the delay", answer(*recordings.cart_run(20 + late, late)), ()))
        hint = "Compare the mean NIS of all five ways to pair measurements with inputs."
        if late == 3 and came == 0:
            hint = "The measurements move, not the inputs: y[d] belongs to u[0]."
        elif late == 3 and came == 1:
            hint = "The right delay has the least NIS of the shifted recordings."
        elif came == 4:
            hint = "This one has the largest NIS, or is merely the last: take the least."
        expect.that(came == late, f"{late}", f"{came}", hint)
