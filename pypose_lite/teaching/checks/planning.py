"""Plans by another route, for the checks of labs: dense problems, and what usual mistakes give."""

import torch

from . import expect
from .exercise import Failure

ALPHAS = (0.8, 0.4, 0.2, 0.1)  # step lengths, none of which is the place of one


def least_cost(A, B, Q, q):
    """Returns k of all steps another way: all inputs at once, from a dense quadratic problem."""
    T, n, m = B.shape

    def cost(flat):
        u, x, total = flat.reshape(T, m), torch.zeros(n), 0.0
        for t in range(T):
            z = torch.cat([x, u[t]])
            total = total + z @ Q @ z / 2 + q[t] @ z
            x = A[t] @ x + B[t] @ u[t]
        return total

    zero = torch.zeros(T * m)
    H = torch.autograd.functional.hessian(cost, zero)
    return -torch.linalg.solve(H, torch.autograd.functional.jacobian(cost, zero)).reshape(T, m)


def driven(A, B, k, K):
    """The inputs that gains lead to, from no change of the first state."""
    x, inputs = torch.zeros(A.shape[-1]), []
    for t in range(len(k)):
        inputs.append(k[t] + K[t] @ x)
        x = A[t] @ x + B[t] @ inputs[-1]
    return torch.stack(inputs)


def with_slope(A, B, Q, q, slope):
    """The recursion with any rule for v: what usual mistakes give."""
    T, n, m = B.shape
    V, v = torch.zeros(n, n), torch.zeros(n)
    k, K = list[torch.Tensor](), list[torch.Tensor]()
    for t in reversed(range(T)):
        F = torch.cat([A[t], B[t]], -1)
        H, h = Q + F.mT @ V @ F, q[t] + F.mT @ v
        k.insert(0, -torch.linalg.solve(H[n:, n:], h[n:]))
        K.insert(0, -torch.linalg.solve(H[n:, n:], H[n:, :n]))
        V, v = H[:n, :n] + H[n:, :n].mT @ K[0], slope(h, H, k[0], K[0], n)
    return torch.stack(k), torch.stack(K)


def by_cases(u, slope, lower, upper):
    """The residual input by input, without clipping."""
    largest = 0.0
    for inputs, slopes in zip(u.tolist(), slope.tolist()):
        for value, g, low, high in zip(inputs, slopes, lower.tolist(), upper.tolist()):
            room = high - value if g < 0 else value - low
            largest = max(largest, min(abs(g), room))
    return largest


def searched(answer, costs, now):
    """What a line search returns for given costs of the step lengths."""
    table = dict(zip(ALPHAS, costs))

    def cost_after(alpha):
        key = round(float(alpha), 9)
        if key not in table:
            raise Failure(f"only step lengths of alphas, {ALPHAS}", f"cost_after({key})")
        return table[key]

    return expect.tensor("the step length", answer(cost_after, now, ALPHAS), ()).item()
