"""Answers to lab 3, as students give them."""

import math

import numpy as np
import torch
from graders import right, wrong

import pypose_lite as pp

Q = torch.diag(torch.tensor([1, 1, 0.3, 0.3, 0.01, 0.01], dtype=torch.float64))

# --- 3.1


@right("3.1")
def in_a_loop(u):
    return torch.stack([*list(u)[1:], u[-1]])


@right("3.1")
def in_numpy(u):
    u = u.numpy()
    return np.concatenate([u[1:], u[-1:]])


@right("3.1")
def by_an_index(u):
    return u[[*range(1, len(u)), len(u) - 1]]


@wrong("3.1", "has come back at the end")
def rolled(u):
    return u.roll(-1, 0)


@wrong("3.1", "moved one step later")
def rolled_the_other_way(u):
    return u.roll(1, 0)


@wrong("3.1", "the last one is lost")
def the_first_one_twice(u):
    return torch.cat([u[:1], u[:-1]])


@wrong("3.1", "The new last input is zero")
def a_zero_at_the_end(u):
    return torch.cat([u[1:], torch.zeros_like(u[:1])])


@wrong("3.1", "Nothing has moved")
def as_it_was_planned(u):
    return u.clone()


@wrong("3.1", "of shape (5, 2)")
def one_too_few(u):
    return u[1:]


@wrong("3.1", "leave its arguments as they are")
def writes_into_the_plan(u):
    u[:-1] = u[1:].clone()
    return u


# --- 3.2


@right("3.2")
def by_a_list(cost_after, cost_now, alphas):
    costs = [(cost_now, 0.0), *((float(cost_after(a)), a) for a in alphas)]
    return min(pair for pair in costs if not math.isnan(pair[0]))[1] if costs else 0.0


@right("3.2")
def by_argmin(cost_after, cost_now, alphas):
    costs = torch.tensor([cost_now, *(cost_after(a) for a in alphas)]).nan_to_num(math.inf)
    return torch.tensor([0.0, *alphas])[costs.argmin()]


@wrong("3.2", "largest cost")
def the_dearest(cost_after, cost_now, alphas):
    return max(alphas, key=cost_after)


@wrong("3.2", "Do not stop at the first length that helps")
def the_first_that_helps(cost_after, cost_now, alphas):
    return next((a for a in alphas if cost_after(a) < cost_now), 0.0)


@wrong("3.2", "compare with cost_now")
def without_the_plan_as_it_is(cost_after, cost_now, alphas):
    return min(alphas, key=lambda a: math.inf if math.isnan(cost_after(a)) else cost_after(a))


@wrong("3.2", "not its place in the list")
def the_place(cost_after, cost_now, alphas):
    costs = [cost_after(a) for a in alphas]
    return costs.index(min(costs))


@wrong("3.2", "nor stay as it is")
def at_equal_cost(cost_after, cost_now, alphas):
    best, cost = 0.0, cost_now
    for alpha in alphas:
        if cost_after(alpha) <= cost:
            best, cost = alpha, cost_after(alpha)
    return best


@wrong("3.2", "Every comparison with nan is false")
def with_min_of_a_list(cost_after, cost_now, alphas):
    costs = [cost_after(a) for a in alphas]
    best = min(costs)
    return 0.0 if best >= cost_now else alphas[costs.index(best)]


@wrong("3.2", "Here a step does help")
def never_moves(cost_after, cost_now, alphas):
    return 0.0


@wrong("3.2", "only step lengths of alphas")
def another_length(cost_after, cost_now, alphas):
    return 0.7 if cost_after(0.7) < cost_now else 0.0


# --- 3.3


def recursion(A, B, Q, q, slope, sign=1, swap=False):
    T, n, m = B.shape
    V, v, k, K = torch.zeros(n, n), torch.zeros(n), [], []
    for t in reversed(range(T)):
        F = torch.cat([A[t], B[t]], -1)
        H, h = Q + F.mT @ V @ F, q[t] + F.mT @ v
        if swap:  # V and v of this step are used before they are known
            h = q[t] + F.mT @ (v * 0)
        k.insert(0, -sign * torch.linalg.solve(H[n:, n:], h[n:]))
        K.insert(0, -torch.linalg.solve(H[n:, n:], H[n:, :n]))
        V, v = H[:n, :n] + H[n:, :n].mT @ K[0], slope(h, H, k[0], K[0], n)
    return torch.stack(k), torch.stack(K)


@right("3.3")
def with_the_transpose_of_K(A, B, Q, q):
    """``v = h_x + K' h_u``: the same, as both are ``h_x - Hux' Huu^-1 hu``."""
    return recursion(A, B, Q, q, lambda h, H, k, K, n: h[:n] + K.mT @ h[n:])


@right("3.3")
def by_the_library(A, B, Q, q):
    from pypose_lite.control.riccati import CostToGo, riccati

    n = A.shape[-1]
    last = CostToGo(torch.zeros(n, n), torch.zeros(n), torch.zeros(()))
    K, k, *_ = riccati(last, Q.expand(len(A), *Q.shape), q, A, B)
    return k, K


@right("3.3")
def in_float32_as_lists(A, B, Q, q):
    A, B, Q, q = (z.double() for z in (A, B, Q, q))
    k, K = recursion(A, B, Q, q, lambda h, H, k, K, n: h[:n] + H[n:, :n].mT @ k)
    return [list(k.float()), list(K.float())]


@wrong("3.3", "v has lost what k changes")
def as_it_was(A, B, Q, q):
    return recursion(A, B, Q, q, lambda h, H, k, K, n: h[:n])


@wrong("3.3", "the slope of the future is forgotten")
def without_v(A, B, Q, q):
    return recursion(A, B, Q, q, lambda h, H, k, K, n: 0 * h[:n])


@wrong("3.3", "H_ux' k has the wrong sign")
def wrong_sign_in_v(A, B, Q, q):
    return recursion(A, B, Q, q, lambda h, H, k, K, n: h[:n] - H[n:, :n].mT @ k)


@wrong("3.3", "downhill is -h")
def uphill(A, B, Q, q):
    return recursion(A, B, Q, q, lambda h, H, k, K, n: h[:n] + H[n:, :n].mT @ k, sign=-1)


@wrong("3.3", "K has the opposite sign")
def opposite_gain(A, B, Q, q):
    k, K = by_the_library(A, B, Q, q)
    return k, -K


@wrong("3.3", "Expected k of shape (4, 2)")
def in_the_other_order(A, B, Q, q):
    return by_the_library(A, B, Q, q)[::-1]


@wrong("3.3", "best for it alone")
def from_the_first_step(A, B, Q, q):
    k, K = by_the_library(A.flip(0), B.flip(0), Q, q.flip(0))
    return k.flip(0), K.flip(0)


# --- 3.4


@right("3.4")
def with_minimum_and_maximum(u, slope, lower, upper):
    return torch.max(torch.abs(torch.minimum(torch.maximum(u - slope, lower), upper) - u))


@right("3.4")
def input_by_input(u, slope, lower, upper):
    found = [
        min(abs(g), (high - v) if g < 0 else (v - low))
        for row, slopes in zip(u.tolist(), slope.tolist())
        for v, g, low, high in zip(row, slopes, lower.tolist(), upper.tolist())
    ]
    return max(found)


@right("3.4")
def in_numpys_clip(u, slope, lower, upper):
    u, slope, lower, upper = (z.numpy() for z in (u, slope, lower, upper))
    return np.abs(np.clip(u - slope, lower, upper) - u).max()


@wrong("3.4", "Mind the sign of the step")
def uphill_step(u, slope, lower, upper):
    away = (u + slope).clamp(lower, upper) - u
    inside = (u > lower) & (u < upper)
    return torch.where(inside, slope.abs(), away.abs() * 0).max()


@wrong("3.4", "-g, leads into the box")
def slope_alone(u, slope, lower, upper):
    return slope.abs().max()


@wrong("3.4", "absolute value before the maximum")
def without_the_absolute_value(u, slope, lower, upper):
    return ((u - slope).clamp(lower, upper) - u).max()


@wrong("3.4", "the largest component was asked for")
def the_sum(u, slope, lower, upper):
    return ((u - slope).clamp(lower, upper) - u).abs().sum()


@wrong("3.4", "with the bounds of its own column")
def with_the_widest_bounds(u, slope, lower, upper):
    at_bound = ((u == lower) & (slope >= 0)) | ((u == upper) & (slope <= 0))
    return torch.where(at_bound, 0, slope.abs().minimum(torch.tensor(100.0))).max()


@wrong("3.4", "the residual")
def for_each_input(u, slope, lower, upper):
    return ((u - slope).clamp(lower, upper) - u).abs()


# --- 3.5

right("3.5")("b")
right("3.5")("(b)")
wrong("3.5", "it knew its bounds")("a")
wrong("3.5", "ended at the same plan")("c")
wrong("3.5", "one of the letters")("d")
wrong("3.5", "one of the letters")(2)

# --- 3.6

right("3.6")(30 * Q[:4, :4])
right("3.6")(100 * torch.eye(4).numpy())
wrong("3.6", "The car parks")(torch.zeros(4, 4))
wrong("3.6", "The car parks")(Q[:4, :4])
wrong("3.6", "has to weigh more")(10 * Q[:4, :4])
wrong("3.6", "pays the car for being far away")(-30 * Q[:4, :4])
wrong("3.6", "of shape (4, 4)")(30 * Q)
wrong("3.6", "symmetric matrix")(30 * torch.eye(4).roll(1, 0) + 60 * torch.eye(4))

# --- 3.7


def planned(x, target, slip):
    return pp.MPC(pp.DubinsCar(0.1, slip), Q, None, 10)(0.1, x, target)[1][:, 0]


@right("3.7")
def by_a_golden_section(x, target, u):
    low, high, share = 0.0, 0.5, (math.sqrt(5) - 1) / 2
    for _ in range(14):
        a, b = high - share * (high - low), low + share * (high - low)
        with torch.no_grad():
            left, right = ((planned(x, target, s) - u).square().mean() for s in (a, b))
        low, high = (low, b) if left < right else (a, high)
    return (low + high) / 2


@right("3.7")
def by_gauss_newton(x, target, u):
    slip = torch.tensor(0.1, requires_grad=True)
    for _ in range(6):
        inputs = planned(x, target, slip)[:, 1]
        slope = torch.stack([torch.autograd.grad(z, slip, retain_graph=True)[0] for z in inputs])
        step = slope @ (u[:, 1] - inputs.detach()) / (slope @ slope)
        slip = (slip + step).clamp(0, 0.5).detach().requires_grad_()
    return slip.item()


@wrong("3.7", "does the loss have a gradient")
def that_stays(x, target, u):
    slip = torch.tensor(0.2)
    for _ in range(2):
        (planned(x, target, slip) - u).square().mean()
    return slip


@wrong("3.7", "has run away")
def uphill_for_slip(x, target, u):
    slip = torch.tensor(0.2, requires_grad=True)
    for _ in range(6):
        loss = (planned(x, target, slip) - u).square().mean()
        slip = (slip + 0.3 * torch.autograd.grad(loss, slip)[0]).detach()
        if not -0.3 < slip < 0.9:
            break
        slip.requires_grad_()
    return slip.detach()


@wrong("3.7", "make more steps")
def too_few_steps(x, target, u):
    return by_gauss_newton(x, target, u) + 0.03


@wrong("3.7", "This is 1 - slip")
def what_is_left(x, target, u):
    return 1 - by_gauss_newton(x, target, u)


@wrong("3.7", "the slip")
def one_for_each(x, target, u):
    return u[:, 0]


@wrong("3.7", "Compare the first input")
def a_number_from_elsewhere(x, target, u):
    return 0.45


# --- 3.8

right("3.8")((torch.tensor([0.0, -1.5]), torch.tensor([1.2, 1.5])))
right("3.8")([[0.0, -1.4], [1.0, 1.4]])
wrong("3.8", "no bounds")((torch.tensor([0.0, -5.0]), torch.tensor([5.0, 5.0])))
wrong("3.8", "First the least speed")((torch.tensor([1.2, 1.5]), torch.tensor([0.0, -1.5])))
wrong("3.8", "enough turn rate in both directions")((torch.zeros(2), torch.tensor([1.2, 1.5])))
wrong("3.8", "enough speed")((torch.tensor([0.0, -1.5]), torch.tensor([0.2, 1.5])))
wrong("3.8", "2 results")(torch.tensor([1.2, 1.5, 0.0]))
