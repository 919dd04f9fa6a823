"""Answers to lab 4, as students give them: corrections, gaps, and a sensor that is late."""

import math

import torch
from graders import right, wrong

import pypose_lite as pp
from pypose_lite import filters
from pypose_lite.teaching.checks import recordings

# --- 4.1


@right("4.1")
def in_the_short_form(x, P, y, C, R):
    K = P @ C.T @ torch.linalg.inv(C @ P @ C.T + R)
    return x + K @ (y - C @ x), P - K @ C @ P


@right("4.1")
def by_information(x, P, y, C, R):
    after = torch.linalg.inv(torch.linalg.inv(P) + C.T @ torch.linalg.inv(R) @ C)
    return after @ (torch.linalg.solve(P, x) + C.T @ torch.linalg.solve(R, y)), after


@right("4.1")
def in_float32(x, P, y, C, R):
    x, P, y, C, R = (z.float() for z in (x, P, y, C, R))
    return in_the_short_form(x, P, y, C, R)


@wrong("4.1", "The innovation has the wrong sign")
def sign_of_the_innovation(x, P, y, C, R):
    K = P @ C.T @ torch.linalg.inv(C @ P @ C.T + R)
    return x - K @ (y - C @ x), P - K @ C @ P


@wrong("4.1", "lost the inverse of S")
def gain_without_S(x, P, y, C, R):
    K = P @ C.T
    return x + K @ (y - C @ x), P - K @ C @ P


@wrong("4.1", "S has lost R")
def without_R(x, P, y, C, R):
    K = P @ C.T @ torch.linalg.pinv(C @ P @ C.T)
    return x + K @ (y - C @ x), P - K @ C @ P


@wrong("4.1", "P has not changed")
def same_covariance(x, P, y, C, R):
    return in_the_short_form(x, P, y, C, R)[0], P


@wrong("4.1", "P has grown")
def larger_covariance(x, P, y, C, R):
    K = P @ C.T @ torch.linalg.inv(C @ P @ C.T + R)
    return x + K @ (y - C @ x), P + K @ C @ P


@wrong("4.1", "needs K R K'")
def half_of_joseph(x, P, y, C, R):
    K = P @ C.T @ torch.linalg.inv(C @ P @ C.T + R)
    rest = torch.eye(len(x), dtype=P.dtype) - K @ C
    return x + K @ (y - C @ x), rest @ P @ rest.T


@wrong("4.1", "2 results: x, P")
def the_mean_only(x, P, y, C, R):
    return in_the_short_form(x, P, y, C, R)[0]


# --- 4.2


def seen(state, post):
    away = post - state[:2]
    heading = torch.atan2(state[3], state[2])
    return torch.stack([away.norm(), torch.atan2(away[1], away[0]) - heading])


def sighted(x, P, y, post, R, g=seen, wrap=filters.wrap, sign=1.0):
    C = torch.func.jacrev(lambda state: g(state, post))(x)
    e = y - g(x, post)
    e = sign * torch.stack([e[0], wrap(e[1])])
    K = P @ C.T @ torch.linalg.inv(C @ P @ C.T + R)
    return x + K @ e, P - K @ C @ P


@right("4.2")
def wrapped_by_atan2(x, P, y, post, R):
    return sighted(x, P, y, post, R, wrap=lambda a: torch.atan2(a.sin(), a.cos()))


@right("4.2")
def by_the_library(x, P, y, post, R):
    eye = torch.eye(4, dtype=torch.float64)
    ekf = pp.EKF(pp.DubinsCar(0.1), eye, eye)

    def g(state):
        return seen(state, post)

    return ekf.update(x, y, None, P, R, g=g, residual=filters.angles(1))


@right("4.2")
def with_a_jacobian_by_hand(x, P, y, post, R):
    i, j = (post - x[:2]).tolist()
    c, s = x[2:].tolist()
    r2 = i * i + j * j
    r, h2 = math.sqrt(r2), c * c + s * s
    C = [[-i / r, -j / r, 0, 0], [j / r2, -i / r2, s / h2, -c / h2]]
    C = torch.tensor(C, dtype=torch.float64)
    e = y - torch.tensor([r, math.atan2(j, i) - math.atan2(s, c)], dtype=torch.float64)
    e[1] = math.remainder(float(e[1]), 2 * math.pi)
    K = P @ C.T @ torch.linalg.inv(C @ P @ C.T + R)
    return x + K @ e, P - K @ C @ P


@wrong("4.2", "nearly a full turn: wrap it")
def not_wrapped(x, P, y, post, R):
    return sighted(x, P, y, post, R, wrap=lambda a: a)


@wrong("4.2", "relative to the heading")
def without_the_heading(x, P, y, post, R):
    def g(state, post):
        away = post - state[:2]
        return torch.stack([away.norm(), torch.atan2(away[1], away[0])])

    return sighted(x, P, y, post, R, g=g)


@wrong("4.2", "The innovation has the wrong sign")
def the_other_sign(x, P, y, post, R):
    return sighted(x, P, y, post, R, sign=-1.0)


@wrong("4.2", "The direction has the wrong sign")
def direction_to_the_right(x, P, y, post, R):
    def g(state, post):
        return torch.tensor([1.0, -1.0]) * seen(state, post)

    return sighted(x, P, y, post, R, g=g)


@wrong("4.2", "P has not changed")
def covariance_as_it_was(x, P, y, post, R):
    return sighted(x, P, y, post, R)[0], P


# --- 4.3


@right("4.3")
def rows_by_index(x, P, y, C, R):
    rows = [k for k in range(len(y)) if not math.isnan(y[k])]
    if not rows:
        return x, P
    return in_the_short_form(x, P, y[rows], C[rows], R[rows][:, rows])


@right("4.3")
def with_empty_matrices(x, P, y, C, R):
    known = ~torch.isnan(y)
    S = C[known] @ P @ C[known].T + R[known][:, known]
    K = torch.linalg.solve(S, C[known] @ P).T
    return x + K @ (y[known] - C[known] @ x), P - K @ C[known] @ P


@wrong("4.3", "A missing number is not zero")
def gaps_are_zero(x, P, y, C, R):
    return in_the_short_form(x, P, y.nan_to_num(), C, R)


@wrong("4.3", "not the whole measurement")
def all_or_nothing(x, P, y, C, R):
    return (x, P) if y.isnan().any() else in_the_short_form(x, P, y, C, R)


@wrong("4.3", "correlations between its rows")
def only_variances(x, P, y, C, R):
    known = ~y.isnan()
    if not known.any():
        return x, P
    if known.all():
        return in_the_short_form(x, P, y, C, R)
    return in_the_short_form(x, P, y[known], C[known], R.diagonal()[known].diag())


@wrong("4.3", "Here no row is missing")
def never_corrects(x, P, y, C, R):
    return x, P


@wrong("4.3", "by rows that were not measured")
def sure_of_gaps(x, P, y, C, R):
    mean, _ = rows_by_index(x, P, y, C, R)
    return mean, in_the_short_form(x, P, y.nan_to_num(), C, R)[1]


@wrong("4.3", "finite numbers")
def nan_everywhere(x, P, y, C, R):
    return in_the_short_form(x, P, y, C, R)


# --- 4.4


def mean_nis(y, u):
    cart = pp.LTI(recordings.A, recordings.B, recordings.C, torch.zeros(1, 1).double())
    f = pp.EKF(cart, recordings.Q, recordings.R)
    x, P, found = torch.zeros(2).double(), 0.01 * torch.eye(2).double(), []
    for yi, ui in zip(y, u):
        found.append(filters.nis(f.innovation(x, yi, ui, P)))
        x, P = f(x, yi, ui, P)
    return torch.stack(found).mean().item()


@right("4.4")
def least_nis(y, u):
    return min(range(5), key=lambda d: mean_nis(y[d:], u[: len(u) - d]))


@right("4.4")
def by_an_observer(y, u):
    """With fixed gains, and the mean square of the innovations instead of their NIS."""
    A, B, K = recordings.A, recordings.B, torch.tensor([0.6, 1.5]).double()
    squares = []
    for d in range(5):
        x, total = torch.zeros(2).double(), 0.0
        for yi, ui in zip(y[d:], u):
            e = yi[0] - x[0]
            total += float(e**2)
            x = A @ (x + K * e) + B @ ui
        squares.append(total / (len(y) - d))
    return torch.tensor(squares).argmin()


@wrong("4.4", "The measurements move, not the inputs")
def the_inputs_move(y, u):
    return min(range(5), key=lambda d: mean_nis(y[: len(y) - d], u[d:]))


@wrong("4.4", "take the least")
def largest_nis(y, u):
    return 4


@wrong("4.4", "0, 1, 2, 3 or 4")
def the_nis_itself(y, u):
    return min(mean_nis(y[d:], u[: len(u) - d]) for d in range(5))


@wrong("4.4", "Expected 3; got 4")
def one_too_many(y, u):
    return min(least_nis(y, u) + 1, 4)


@wrong("4.4", "as a single number")
def a_list_of_all(y, u):
    return [mean_nis(y[d:], u[: len(u) - d]) for d in range(5)]
