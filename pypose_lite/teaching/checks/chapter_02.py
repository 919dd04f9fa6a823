"""What the answers of lab 2 must do: a Riccati step, a sign, a sum without end, an integral."""

import torch

from ...control import dlqr
from . import expect
from .exercise import Exercise

riccati_step = Exercise("2.1", "One Riccati step", minutes=10, takes="A, B, Q, R, V", points=2)


def one_step(given, n=None, m=None):
    """A, B, Q, R and V of some step."""
    n, m = n or given.size(3), m or given.size(2)
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


gain_cost = Exercise(
    "2.3", "What comes after the plan", minutes=15, takes="A, B, Q, R, K", points=2
)


def stable_loop(given, n=None, m=None):
    """A, B, Q, R and a K that is stable and not the best."""
    n, m = n or given.size(3), m or given.size(2)
    A, B, Q, R = given.randn(n, n), given.randn(n, m), given.positive(n), given.positive(m)
    K = -dlqr(A, B, Q, R)[0]
    change = given.randn(m, n)
    for _ in range(30):
        if torch.linalg.eigvals(A + B @ (K + change)).abs().max() < 0.9:
            break
        change = change / 1.5
    return A, B, Q, R, K + change


def summed(F, W):
    """Returns the sum over all t of F'^t W F^t; each round doubles the number of its terms."""
    for _ in range(12):
        W, F = W + F.mT @ W @ F, F @ F
    return W


@gain_cost.must("return P of shape (n, n), for any n and m")
def shape_of_cost(answer, given):
    for n, m in [(3, 2), (1, 1), (2, 3)]:
        expect.tensor("P", answer(*stable_loop(given, n, m)), (n, n))


@gain_cost.must("return the P with which x'Px is the sum over all steps, from any x")
def endless_sum(answer, given):
    A, B, Q, R, K = stable_loop(given)
    F, W = A + B @ K, Q + K.mT @ R @ K
    P = summed(F, W)
    best = dlqr(A, B, Q, R)[1]
    mistakes = {
        "The inputs cost something, too: u'Ru with u = K x.": summed(F, Q),
        "This is the cost of the first step alone.": W,
        "This is the cost of the first two steps alone.": W + F.mT @ W @ F,
        "The first step is missing: the sum begins with x itself.": P - W,
        "F and its transpose have changed places: the cost of the next state is F'PF.": summed(
            F.mT, W
        ),
        "The sum has no halves: x'Px, not 1/2 x'Px.": 2 * P,
        "It has a half too many: x'Px is the sum.": P / 2,
        "This is what the best gain costs. The car steers by the K that is given.": best,
    }
    hint = "P = Q + K'RK + F'PF with F = A + BK: solve it, or repeat it until P stays as it is."
    expect.close("P", answer(A, B, Q, R, K), P, hint, mistakes)


@gain_cost.must("add up enough steps where the loop is slow")
def slow_loop(answer, given):
    A, B, Q, R, _ = stable_loop(given, 2, 1)
    K = torch.zeros(1, 2)
    A = 0.99 * A / torch.linalg.eigvals(A).abs().max()
    hint = "With an eigenvalue of 0.99 a hundred steps are too few: stop when P stays as it is."
    expect.close("P", answer(A, B, Q, R, K), summed(A, Q), hint)


integral = Exercise("2.4", "Integral action", minutes=15, takes="A, B, C, Q, R, weight", points=2)


def offset_system(given, n=2):
    """A, B, C, Q, R and a weight of a system that is not too fast, with one output."""
    A = torch.eye(n) + 0.2 * given.randn(n, n)
    B, C = given.randn(n, 1), given.randn(1, n)
    return A, B, C, given.positive(n), given.positive(1), 0.7


def with_sum(A, B, C):
    """A and B of the state [x, s] with s' = s + C x."""
    n = len(A)
    longer = torch.eye(n + 1)
    longer[:n, :n], longer[n, :n] = A, C[0]
    return longer, torch.cat([B, torch.zeros(1, B.shape[1])])


def endless(A, B, Q, R):
    """Returns the best gain of u = K x, as the limit of many steps."""
    V = 1e-3 * torch.eye(len(A))
    for _ in range(500):
        V, K = by_least_squares(A, B, Q, R, V)
    return K


@integral.must("return K of shape (1, n + 1), for any n")
def shape_of_integral_gain(answer, given):
    for n in (2, 1, 3):
        expect.tensor("K", answer(*offset_system(given, n)), (1, n + 1))


@integral.must("make the loop stable")
def stable(answer, given):
    A, B, C, Q, R, weight = offset_system(given)
    K = expect.tensor("K", answer(A, B, C, Q, R, weight), (1, 3)).detach()
    A_sum, B_sum = with_sum(A, B, C)
    size = torch.linalg.eigvals(A_sum + B_sum @ K).abs().max().item()
    turned = torch.linalg.eigvals(A_sum - B_sum @ K).abs().max().item()
    hint = "Does s come last, is the old s kept in s' = s + C x, and has it a weight?"
    if turned < 1:
        hint = "The input is u = K [x, s] here; the gain of `dlqr` is for u = -K x."
    expect.that(size < 1, "eigenvalues inside the unit circle", f"one of {size:.3f}", hint)


@integral.must("bring C x to 0, whatever constant is added to the input")
def removes_constant(answer, given):
    A, B, C, Q, R, weight = offset_system(given)
    K = expect.tensor("K", answer(A, B, C, Q, R, weight), (1, 3)).detach()
    for constant in (1.0, -3.0):
        x, s = torch.zeros(2), torch.zeros(1)
        for _ in range(1000):
            u = K @ torch.cat([x, s]) + constant
            x, s = A @ x + B @ u, s + C @ x
        hint = "The gain of s is 0: has s a weight?"
        expect.that(abs(C @ x) < 1e-3, "C x = 0 at the end", f"{(C @ x).item():.3g}", hint)


@integral.must("be the best gain for the weights Q of x, weight of s, and R of u")
def best_integral_gain(answer, given):
    A, B, C, Q, R, weight = offset_system(given)
    A_sum, B_sum = with_sum(A, B, C)

    def gain(w, Q=Q, R=R):
        return endless(A_sum, B_sum, torch.block_diag(Q, torch.tensor([[w]])), R)

    mistakes = {
        "The weight of s is not used.": gain(1.0),
        "The weight of s is the number itself, not its square.": gain(weight**2),
        "The weight of x is Q, not the identity.": gain(weight, Q=torch.eye(2)),
        "The weight of u is R, not the identity.": gain(weight, R=torch.eye(1)),
    }
    hint = "Q of the longer state: `torch.block_diag(Q, weight)`, with weight as a (1, 1) tensor."
    came = answer(A, B, C, Q, R, weight)
    expect.close("K", came, gain(weight), hint, mistakes, tolerance=1e-5)
