"""What the answers of lab 2 must do."""

import torch

from . import expect
from .exercise import Exercise

riccati_step = Exercise("2.1", "One Riccati step", minutes=10, takes="A, B, Q, R, V", points=2)


def one_step(given, n=3, m=2):
    """A, B, Q, R and V of some step."""
    A, B = given.randn(n, n), given.randn(n, m)
    return A, B, given.positive(n), given.positive(m), given.positive(n)


def by_least_squares(A, B, Q, R, V):
    """Returns V and K another way: the weighted input and next state have the least square."""
    half_R, half_V = (torch.linalg.cholesky(weight).mT for weight in (R, V))
    of_input = torch.cat([half_R, half_V @ B])
    of_state = torch.cat([torch.zeros_like(B.mT), half_V @ A])
    K = torch.linalg.lstsq(of_input, -of_state).solution
    left = of_state + of_input @ K
    return Q + left.mT @ left, K


@riccati_step.must("return V of shape (n, n) and K of shape (m, n), for any n and m")
def shapes(answer, given):
    for n, m in [(3, 2), (1, 1), (2, 4)]:
        V, K = expect.parts(answer(*one_step(given, n, m)), "V", "K")
        expect.tensor("V", V, (n, n))
        expect.tensor("K", K, (m, n))


@riccati_step.must("return the K whose input u = K x costs least, in this step and after it")
def best_input(answer, given):
    A, B, Q, R, V = one_step(given)
    _, K = by_least_squares(A, B, Q, R, V)
    solve = torch.linalg.solve
    mistakes = {
        "K has the opposite sign: the input is u = K x here, not u = -K x.": -K,
        "R is missing: input is not free.": -solve(B.mT @ V @ B, B.mT @ V @ A),
        "What follows costs V, not Q.": -solve(R + B.mT @ Q @ B, B.mT @ Q @ A),
    }
    hint = "Where the derivative with respect to u is zero: (R + B'VB) u = -B'VA x."
    came = expect.parts(answer(A, B, Q, R, V), "V", "K")
    expect.close("K", came[1], K, hint, mistakes)


@riccati_step.must("return the V with which x'Vx is what the best input costs, from any x")
def cost_to_go(answer, given):
    A, B, Q, R, V = one_step(given)
    before, K = by_least_squares(A, B, Q, R, V)
    after = A + B @ K
    mistakes = {
        "Q is missing: being at x costs x'Qx in this step.": before - Q,
        "This V is what u = 0 costs: put u = K x in.": Q + A.mT @ V @ A,
        "The input's own cost is missing: K'RK.": Q + after.mT @ V @ after,
        "Here u = -K x was put in: the next state is (A + BK) x.": Q + A.mT @ V @ (A - B @ K),
        "This V has not changed: return the new one.": V,
    }
    hint = "Put u = K x into the cost: V = Q + A'V(A + BK), in which V on the right is the old one."
    came = expect.parts(answer(A, B, Q, R, V), "V", "K")
    expect.close("V", came[0], before, hint, mistakes)


wrong_sign = Exercise("2.2", "A car that flees the line", minutes=10)


@wrong_sign.must("name the one fault that explains what the figure shows")
def diagnosis(answer, given):
    wrong = {
        "a": "A price that is too high makes the car slow to return, and it still returns.",
        "c": "With weights in the wrong order the car returns, if worse.",
        "d": "A short horizon makes small gains, whose sign is right: the car does not flee.",
    }
    expect.choice(answer, "b", wrong)
