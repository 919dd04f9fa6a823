"""Answers to lab 2, as students give them: a pole on a cart, a test, a driver, a dog."""

import torch
from graders import right, wrong

import pypose_lite as pp

# --- 2.5

right("2.5", "by Bryson's rule")(1 / torch.tensor([0.3, 1, 0.3, 1, 1]) ** 2)
right("2.5", "a list, and rates for nothing")([10, 0, 0, 0, 1])
right("2.5", "another scale, float32")(torch.tensor([60.0, 6, 0, 0, 6]))
wrong("2.5", "It is slow", "all equal")(torch.ones(5))
wrong("2.5", "keep the force below 5 N", "a force for next to nothing")([1, 1, 1, 1, 0.001])
wrong("2.5", "keep the pole within 0.1 rad", "in a hurry")([20, 1, 1, 1, 1])
wrong("2.5", "It is slow", "mostly the angle")([10, 1, 1000, 1, 1])
wrong("2.5", "a positive weight of F", "a free force")([10, 1, 10, 1, 0])
wrong("2.5", "A negative weight rewards", "a negative one")([10, -1, 10, 1, 1])
wrong("2.5", "of shape (5,); got one of shape (4,)", "without F")([10, 1, 10, 1])
wrong("2.5", "dlqr's error", "blind for the position")([0, 1, 1, 1, 1])

# --- 2.6


def numbers(n=3, m=2):
    generator = torch.Generator().manual_seed(5)
    A, B = torch.randn(n, n, generator=generator), torch.randn(n, m, generator=generator)
    L, M = torch.randn(n, n, generator=generator), torch.randn(m, m, generator=generator)
    return A, B, L @ L.mT + torch.eye(n), M @ M.mT + torch.eye(m)


def of_library(A, B, Q, R, T):
    n, m = B.shape
    system = pp.LTI(A, B, torch.eye(n), torch.zeros(n, m))
    return pp.LQR(system, torch.block_diag(Q, R), None, T).lqr_backward(torch.ones(n))[0]


def agrees(lqr, A, B, Q, R, T=6):
    return torch.allclose(lqr(A, B, Q, R, T), of_library(A, B, Q, R, T), atol=1e-8)


@right("2.6")
def beside_the_library(lqr):
    return agrees(lqr, *numbers())


@right("2.6")
def nothing_is_cheaper_than_the_inputs(lqr):
    A, B, Q, R = numbers()
    gains = lqr(A, B, Q, R, 5)

    def cost(x, changes):
        total = 0.0
        for K, change in zip(gains, changes):
            u = K @ x + change
            total, x = total + x @ Q @ x + u @ R @ u, A @ x + B @ u
        return total

    for start in torch.eye(3):
        none = torch.zeros(5, 2)
        for k in range(10):
            change = none.clone()
            change.view(-1)[k] = 1e-3
            least = cost(start, none)
            if cost(start, change) < least - 1e-9 or cost(start, -change) < least - 1e-9:
                return torch.tensor(False)
    return torch.tensor(True)


@right("2.6")
def on_random_numbers_each_time(lqr):
    A, B = torch.randn(3, 3), torch.randn(3, 2)
    return agrees(lqr, A, B, torch.eye(3) + 0.5, torch.eye(2) + 0.5)


@wrong("2.6", "False for A transposed in the gain")
def on_a_symmetric_system(lqr):
    A, B, Q, R = numbers()
    return agrees(lqr, A + A.mT, B, Q, R)


@wrong("2.6", "False for A transposed in the cost-to-go")
def of_two_steps_only(lqr):
    return agrees(lqr, *numbers(), T=2)


@wrong("2.6", "Is your R a matrix")
def with_one_input(lqr):
    return agrees(lqr, *numbers(3, 1))


@wrong("2.6", "Is your Q a diagonal matrix?")
def with_a_diagonal_Q(lqr):
    A, B, Q, R = numbers()
    return agrees(lqr, A, B, torch.eye(3), R)


@wrong("2.6", "Is each gain used in its own step")
def of_the_gain_in_the_middle(lqr):
    problem = numbers()
    return torch.allclose(lqr(*problem, 7)[3], of_library(*problem, 7)[3])


@wrong("2.6", "It shows in the last gain")
def without_a_look_at_the_last_gain(lqr):
    A, B, Q, R = numbers()
    K, P = lqr(A, B, Q, R, 200), pp.dlqr(A, B, Q, R)[0]
    return torch.allclose(K[0], -P) and not torch.allclose(K[-1], -P)


@wrong("2.6", "compare with a tolerance")
def to_the_last_digit(lqr):
    A, B, Q, R = numbers()
    V, gains = torch.zeros_like(Q), []
    for _ in range(6):
        K = -torch.linalg.solve(R + B.mT @ V @ B, B.mT @ V @ A)
        V = Q + A.mT @ V @ (A + B @ K)
        V = (V + V.mT) / 2
        gains.insert(0, K)
    return torch.equal(lqr(A, B, Q, R, 6), torch.stack(gains))


@wrong("2.6", "Which input costs less")
def of_shapes_alone(lqr):
    return lqr(*numbers(), 6).shape == (6, 2, 3)


@wrong("2.6", "Expected True or False; got None")
def that_asserts(lqr):
    assert lqr(*numbers(), 6).shape == (6, 2, 3)


@wrong("2.6", "True for the recursion of the chapter; got False")
def for_gains_of_minus(lqr):
    A, B, Q, R = numbers()
    return torch.allclose(lqr(A, B, Q, R, 6), -of_library(A, B, Q, R, 6))


# --- 2.7


def going_downhill(states, A, B, Q, weight_of=torch.exp, rounds=60, rate=0.2):
    guess = torch.zeros((), requires_grad=True)
    optimizer = torch.optim.Adam([guess], lr=rate)
    for _ in range(rounds):
        K, _ = pp.dlqr(A, B, Q, weight_of(guess).reshape(1, 1))
        loss = (states[1:] - states[:-1] @ (A - B @ K).mT).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return guess


@right("2.7")
def by_one_step_residuals(states, A, B, Q):
    return going_downhill(states, A, B, Q).exp()


@right("2.7")
def by_a_search_of_whole_paths(states, A, B, Q):
    def loss(R):
        F = A - B @ pp.dlqr(A, B, Q, torch.tensor([[R]]))[0]
        path = [torch.linalg.matrix_power(F, t) @ states[0] for t in range(len(states))]
        return (torch.stack(path) - states).square().mean().item()

    return min((0.01 * 1.05**k for k in range(140)), key=loss)


@wrong("2.7", "its exponential is positive")
def logarithm(states, A, B, Q):
    return going_downhill(states, A, B, Q)


@wrong("2.7", "This is a first guess that has not moved")
def first_guess(states, A, B, Q):
    return going_downhill(states, A, B, Q, rounds=0).exp()


@wrong("2.7", "has it come to rest?")
def too_few_rounds(states, A, B, Q):
    return going_downhill(states, A, B, Q, rounds=3).exp()


@wrong("2.7", "This is 1 / weight")
def inverse(states, A, B, Q):
    return 1 / going_downhill(states, A, B, Q).exp()


@wrong("2.7", "This is the square root of the weight")
def square_root(states, A, B, Q):
    return going_downhill(states, A, B, Q).exp().sqrt()


@wrong("2.7", "R: expected a positive definite matrix")
def without_the_logarithm(states, A, B, Q):
    return going_downhill(states, A, B, Q, weight_of=lambda guess: guess)


# --- 2.8

right("2.8", "of dlqr")(torch.tensor([-2.73, -1.82]))
right("2.8", "guessed")((-3, -2))
right("2.8", "as dlqr returns it")(torch.tensor([[-3.0, -2.0]]))
wrong("2.8", "ask for no more than the 1.5 rad/s", "too strong")(torch.tensor([-8.0, -3.6]))
wrong("2.8", "left of the line it has to turn right", "of dlqr, sign")(torch.tensor([2.73, 1.82]))
wrong("2.8", "The heading counts too little", "too little heading")(torch.tensor([-2.0, -1.0]))
wrong("2.8", "It is slow", "too much heading")([-3.0, -3.0])
wrong("2.8", "two negative numbers", "offset alone")([-1.0, 0.0])
wrong("2.8", "the gain of shape (2,); got one of shape (3,)", "with an ahead")([0.0, -3.0, -2.0])
