"""Slow, plain answers to compare the core with: loops, dense matrices, differences."""

import copy

import torch

import pypose_lite as pp

BATCHES = [(), (1,), (3,), (2,), (5,), (2, 3)]  # with n = 2: (), (1,), (3,), (n,), (2n+1,), (2, 3)


def close(a, b, atol=1e-12):
    torch.testing.assert_close(a, b, atol=atol, rtol=0)


def draw(g, *shape, dtype=torch.float64):
    return torch.randn(shape, generator=g, dtype=dtype)


def matrices(g, n, m, lead=(), radius=0.9):
    """``A B C D c1 c2`` with p = n, and A of the given size."""
    A, B, C, D = (
        draw(g, *lead, n, n),
        draw(g, *lead, n, m),
        draw(g, *lead, n, n),
        draw(g, *lead, n, m),
    )
    A = radius * A / torch.linalg.matrix_norm(A, 2)[..., None, None]
    return A, B, C, D, draw(g, *lead, n), draw(g, *lead, n)


def weights(g, k, lead=()):
    """A symmetric Q > 0 with cross terms, and p."""
    W = draw(g, *lead, k, k)
    return W @ W.mT / k + 0.3 * torch.eye(k, dtype=W.dtype), draw(g, *lead, k)


class Affine(pp.NLS):
    """An LTI's equations, for one sample, as a user would write them."""

    def __init__(self, A, B, C, D, c1, c2):
        super().__init__()
        for name, value in zip(("a", "b", "c", "d", "e", "h"), (A, B, C, D, c1, c2)):
            setattr(self, name, value)

    def state_transition(self, state, input):
        return self.a @ state + self.b @ input + self.e

    def observation(self, state, input):
        return self.c @ state + self.d @ input + self.h


class Clockwork(pp.NLS):
    """A nonlinear system of n = 2, m = 1 that changes with time."""

    def __init__(self, gain=1.0):
        super().__init__()
        self.gain = gain

    def state_transition(self, state, input, t):
        a, b = state
        push = self.gain * (1 + 0.5 * torch.sin(0.7 * t)) * input[0]
        return torch.stack([a + 0.2 * b, b + 0.2 * (torch.sin(a) + push) + 0.05 * t.cos()])

    def observation(self, state, input, t):
        return torch.stack([state[0] * state[1] + t, input[0] ** 2, state[1] * input[0]])


def rollout(system, x, u):
    """The states that one sample's inputs lead to, by a copy of the system, step by step."""
    system, xs = copy.deepcopy(system), [x]
    for t in range(len(u)):
        xs.append(system(xs[-1], u[t])[0])
    return torch.stack(xs)


def total_cost(x, u, Q, p=None, target=None):
    """``sum 1/2 z' Q z + p' z`` of one sample, a term at a time."""
    cost = 0
    for t in range(len(u)):
        z = torch.cat([x[t], u[t]])
        Qt = Q if Q.ndim == 2 else Q[t]
        away = z if target is None else z - torch.cat([target, torch.zeros_like(u[t])])
        cost = cost + 0.5 * away @ Qt @ away
        if p is not None:
            cost = cost + (p if p.ndim == 1 else p[t]) @ z
    return cost


class DenseQP:
    """One sample's problem as ``min 1/2 u' H u + h' u``, its states eliminated.

    ``x = X0 + XU u`` for all states at once; A, B, c, Q, p have one entry for each step.
    """

    def __init__(self, A, B, c, Q, p, x_init):
        T, n, m = B.shape
        self.T, self.m = T, m
        x0, xu = x_init, torch.zeros(n, T * m, dtype=B.dtype)
        self.H, self.h = torch.zeros(T * m, T * m, dtype=B.dtype), torch.zeros(T * m, dtype=B.dtype)
        for t in range(T):
            pick = torch.zeros(m, T * m, dtype=B.dtype)
            pick[:, t * m : (t + 1) * m] = torch.eye(m, dtype=B.dtype)
            z0, zu = torch.cat([x0, torch.zeros_like(pick[:, 0])]), torch.cat([xu, pick])
            S = (Q[t] + Q[t].mT) / 2
            self.H, self.h = self.H + zu.mT @ S @ zu, self.h + zu.mT @ (S @ z0 + p[t])
            x0, xu = A[t] @ x0 + c[t], A[t] @ xu + B[t] @ pick

    def solve(self):
        return -torch.linalg.solve(self.H, self.h).reshape(self.T, self.m)

    def solve_within(self, lower, upper):
        """The box-constrained solution, by scipy: a least-squares problem with bounds."""
        from scipy.optimize import lsq_linear

        L = torch.linalg.cholesky(self.H)
        rhs = -torch.linalg.solve_triangular(L, self.h[:, None], upper=False)[:, 0]
        box = (lower.expand(self.T, self.m).flatten(), upper.expand(self.T, self.m).flatten())
        found = lsq_linear(L.mT.numpy(), rhs.numpy(), box, method="bvls", tol=1e-14)
        return torch.tensor(found.x).reshape(self.T, self.m)


def central(f, x, step=1e-6):
    """The Jacobian of f at x, ``(*f.shape, *x.shape)``, by central differences."""
    columns = []
    for i in range(x.numel()):
        e = torch.zeros(x.numel(), dtype=x.dtype)
        e[i] = step
        e = e.reshape(x.shape)
        columns.append((f(x + e) - f(x - e)).detach() / (2 * step))
    return torch.stack(columns, -1).reshape(*columns[0].shape, *x.shape)


def jacobian(f, x):
    """The same by one backward pass for each number that f returns."""
    x = x.detach().clone().requires_grad_()
    y = f(x)
    rows = [torch.autograd.grad(v, x, retain_graph=True)[0] for v in y.flatten()]
    return torch.stack(rows).reshape(*y.shape, *x.shape)
