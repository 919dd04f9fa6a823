"""Answers to lab 2, as students give them: a Riccati step, a sign, an endless sum, an integral."""

from typing import NamedTuple

import numpy as np
import torch
from graders import right, wrong

import pypose_lite as pp


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

# --- 2.3


@right("2.3")
def repeated(A, B, Q, R, K):
    F, W = A + B @ K, Q + K.T @ R @ K
    P = torch.zeros_like(Q)
    for _ in range(5000):
        P = W + F.T @ P @ F
    return P


@right("2.3")
def as_equations(A, B, Q, R, K):
    A, B, Q, R, K = (matrix.numpy() for matrix in (A, B, Q, R, K))
    F, n = A + B @ K, len(A)
    left = np.eye(n * n) - np.kron(F.T, F.T)
    return np.linalg.solve(left, (Q + K.T @ R @ K).reshape(-1)).reshape(n, n)


@right("2.3")
def by_eigenvectors_in_complex_numbers(A, B, Q, R, K):
    values, axes = torch.linalg.eig(A + B @ K)
    W = axes.mT @ (Q + K.mT @ R @ K).to(axes) @ axes
    back = torch.linalg.inv(axes)
    return (back.mT @ (W / (1 - values[:, None] * values)) @ back).real


def sum_of(F, W, terms=5000):
    P = W
    for _ in range(terms - 1):
        P = W + F.mT @ P @ F
    return P


@wrong("2.3", "The inputs cost something, too")
def without_inputs(A, B, Q, R, K):
    return sum_of(A + B @ K, Q)


@wrong("2.3", "This is the cost of the first step alone")
def one_term(A, B, Q, R, K):
    return Q + K.mT @ R @ K


@wrong("2.3", "The first step is missing")
def from_the_next_state(A, B, Q, R, K):
    return repeated(A, B, Q, R, K) - Q - K.mT @ R @ K


@wrong("2.3", "have changed places")
def transposed_loop(A, B, Q, R, K):
    return sum_of((A + B @ K).mT, Q + K.mT @ R @ K)


@wrong("2.3", "It has a half too many")
def with_a_half(A, B, Q, R, K):
    return repeated(A, B, Q, R, K) / 2


@wrong("2.3", "This is what the best gain costs")
def of_the_best_gain(A, B, Q, R, K):
    return pp.dlqr(A, B, Q, R)[1]


@wrong("2.3", "finite numbers; got nan or inf")
def sign_of_dlqr(A, B, Q, R, K):
    return sum_of(A - B @ K, Q + K.mT @ R @ K)


@wrong("2.3", "a hundred steps are too few")
def a_hundred_terms(A, B, Q, R, K):
    return sum_of(A + B @ K, Q + K.mT @ R @ K, 100)


# --- 2.4


def larger(A, B, C, old=1.0):
    n = len(A)
    A_sum = torch.block_diag(A, old * torch.eye(1))
    A_sum[n:, :n] = C
    return A_sum, torch.cat([B, torch.zeros(1, 1)])


def gain_of(A_sum, B_sum, Q, R, weight):
    return -pp.dlqr(A_sum, B_sum, torch.block_diag(Q, torch.tensor([[weight]])), R)[0]


@right("2.4")
def by_dlqr(A, B, C, Q, R, weight):
    return gain_of(*larger(A, B, C), Q, R, weight)


@right("2.4")
def with_the_sum_first_and_back(A, B, C, Q, R, weight):
    n = len(A)
    A_sum = torch.eye(n + 1)
    A_sum[1:, 1:], A_sum[0, 1:] = A, C[0]
    B_sum = torch.cat([torch.zeros(1, 1), B])
    P = torch.block_diag(torch.tensor([[weight]]), Q)
    Q_sum = P
    for _ in range(3000):
        P, K = solved(A_sum, B_sum, Q_sum, R, P)
    return torch.cat([K[:, 1:], K[:, :1]], dim=1)


@wrong("2.4", "the gain of `dlqr` is for u = -K x")
def with_the_sign_of_dlqr(A, B, C, Q, R, weight):
    return -by_dlqr(A, B, C, Q, R, weight)


@wrong("2.4", "is the old s kept")
def that_forgets_the_old_sum(A, B, C, Q, R, weight):
    return gain_of(*larger(A, B, C, old=0.0), Q, R, weight)


@wrong("2.4", "The weight of s is not used")
def without_its_weight(A, B, C, Q, R, weight):
    return by_dlqr(A, B, C, Q, R, 1.0)


@wrong("2.4", "not its square")
def with_its_square(A, B, C, Q, R, weight):
    return by_dlqr(A, B, C, Q, R, weight**2)


@wrong("2.4", "The weight of u is R, not the identity")
def without_the_weight_of_u(A, B, C, Q, R, weight):
    return by_dlqr(A, B, C, Q, torch.eye(1), weight)


@wrong("2.4", "K of shape (1, 3); got one of shape (1, 2)")
def without_the_sum(A, B, C, Q, R, weight):
    return -pp.dlqr(A, B, Q, R)[0]


@wrong("2.4", "Does s come last")
def with_the_sum_first(A, B, C, Q, R, weight):
    return by_dlqr(A, B, C, Q, R, weight).roll(1, -1)


@wrong("2.4", "Does s come last")
def without_weight(A, B, C, Q, R, weight):
    return torch.cat([-pp.dlqr(A, B, Q, R)[0], torch.zeros(1, 1)], dim=1)
