"""Answers to lab 2, as students give them."""

from typing import NamedTuple

import numpy as np
import torch
from graders import right, wrong


class Step(NamedTuple):
    cost_to_go: torch.Tensor
    gain: torch.Tensor


def solved(A, B, Q, R, V):
    K = -torch.linalg.solve(R + B.mT @ V @ B, B.mT @ V @ A)
    return Q + A.mT @ V @ (A + B @ K), K


@right("2.1")
def joseph_form_and_inverse(A, B, Q, R, V):
    K = -torch.linalg.inv(R + B.T @ V @ B) @ B.T @ V @ A
    F = A + B @ K
    return Step(Q + K.T @ R @ K + F.T @ V @ F, K)


@right("2.1")
def in_float32_as_a_list(A, B, Q, R, V):
    return list(solved(A.float(), B.float(), Q.float(), R.float(), V.float()))


@right("2.1")
def in_numpy(A, B, Q, R, V):
    A, B, Q, R, V = (matrix.numpy() for matrix in (A, B, Q, R, V))
    W = np.linalg.inv(V) + B @ np.linalg.inv(R) @ B.T  # the matrix inversion lemma
    before = Q + A.T @ np.linalg.inv(W) @ A
    return before, -np.linalg.inv(R) @ B.T @ np.linalg.inv(W) @ A


@right("2.1")
def by_gradient_descent_with_prints(A, B, Q, R, V):
    K = torch.zeros_like(B.mT)
    for _ in range(2000):
        K = K - 0.02 * ((R + B.mT @ V @ B) @ K + B.mT @ V @ A)
    print(K)
    F = A + B @ K
    return Q + K.mT @ R @ K + F.mT @ V @ F, K


@wrong("2.1", "K has the opposite sign")
def opposite_sign(A, B, Q, R, V):
    V, K = solved(A, B, Q, R, V)
    return V, -K


@wrong("2.1", "Its transpose has that shape")
def transposed_gain(A, B, Q, R, V):
    V, K = solved(A, B, Q, R, V)
    return V, K.mT


@wrong("2.1", "Q is missing")
def without_Q(A, B, Q, R, V):
    before, K = solved(A, B, Q, R, V)
    return before - Q, K


@wrong("2.1", "R is missing")
def without_R(A, B, Q, R, V):
    return solved(A, B, Q, 0 * R, V)


@wrong("2.1", "What follows costs V, not Q")
def Q_for_V(A, B, Q, R, V):
    return solved(A, B, Q, R, Q)


@wrong("2.1", "The input's own cost is missing")
def without_the_cost_of_the_input(A, B, Q, R, V):
    K = solved(A, B, Q, R, V)[1]
    return Q + (A + B @ K).mT @ V @ (A + B @ K), K


@wrong("2.1", "Here u = -K x was put in")
def sign_in_V_alone(A, B, Q, R, V):
    K = solved(A, B, Q, R, V)[1]
    return Q + A.mT @ V @ (A - B @ K), K


@wrong("2.1", "This V has not changed")
def old_V(A, B, Q, R, V):
    return V, solved(A, B, Q, R, V)[1]


@wrong("2.1", "Expected V of shape (3, 3); got one of shape (2, 3)")
def in_the_other_order(A, B, Q, R, V):
    return solved(A, B, Q, R, V)[::-1]


@wrong("2.1", "leave its arguments as they are")
def writes_into_V(A, B, Q, R, V):
    before, K = solved(A, B, Q, R, V)
    V.copy_(before)
    return V, K


@wrong("2.1", "Where the derivative with respect to u is zero")
def half_of_V(A, B, Q, R, V):
    return solved(A, B, Q, R, V.tril())


right("2.2")("b")
right("2.2")(" (B)")
wrong("2.2", "slow to return")("a")
wrong("2.2", "if worse")("c")
wrong("2.2", "whose sign is right")("d")
wrong("2.2", "one of the letters 'a', 'b', 'c' or 'd'; got the number 2")(2)
