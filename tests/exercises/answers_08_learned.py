"""Answers to lab 8 on what is learned from records, as students give them."""

import numpy as np
import torch
from graders import right, wrong
from torch.autograd.functional import jacobian

import pypose_lite as pp


def minimise(loss, z, iterations=15):
    z = z.clone().requires_grad_()
    optimizer = torch.optim.LBFGS([z], max_iter=iterations, line_search_fn="strong_wolfe")

    def evaluate():
        value = loss(z)
        (z.grad,) = torch.autograd.grad(value, z)
        return value

    optimizer.step(evaluate)
    return z.detach()


def on_a_grid(loss, low, high, rounds=6, count=21):
    """The best of a grid that becomes finer."""
    with torch.no_grad():
        for _ in range(rounds):
            grid = torch.linspace(low, high, count)
            best = grid[torch.stack([loss(z) for z in grid]).argmin()].item()
            width = (high - low) / 8
            low, high = max(best - width, low), min(best + width, high)
    return best


# --- 8.4


def misfit(step, y, u):
    x, total = y[0], 0.0
    for i in range(len(u)):
        x = pp.DubinsCar(step).transition(x, u[i])
        total = total + (x - y[i + 1]).square().sum()
    return total


@right("8.4")
def step_by_lbfgs(y, u):
    return minimise(lambda step: misfit(step, y, u), torch.tensor(0.1))


@right("8.4")
def step_on_a_grid(y, u):
    return on_a_grid(lambda step: misfit(step, y, u), 0.05, 0.2)


@right("8.4")
def step_by_gauss_newton(y, u):
    def states(step):
        x = [y[0]]
        for u_i in u:
            x.append(pp.DubinsCar(step).transition(x[-1], u_i))
        return torch.stack(x)

    step = torch.tensor(0.1)
    for _ in range(15):
        x, s = torch.func.jvp(states, (step,), (torch.tensor(1.0),))
        change = (s * (y - x)).sum() / s.square().sum()
        step = step + change.clamp(-0.02, 0.02)
    return [step.item()]


@wrong("8.4", "Noise makes each distance longer")
def of_the_distances(y, u):
    return (y[1:] - y[:-1])[:, :2].norm(dim=-1).sum() / u[:, 0].sum()


@wrong("8.4", "does the loss depend on it")
def that_does_not_move(y, u):
    return torch.tensor(0.1)


@wrong("8.4", "This is one over the time step")
def the_frequency(y, u):
    return 1 / step_by_lbfgs(y, u)


@wrong("8.4", "Make more steps")
def a_little_off(y, u):
    return 0.95 * step_by_lbfgs(y, u)


@wrong("8.4", "Simulate the whole record")
def something_else(y, u):
    return 0.02


@wrong("8.4", "the time step")
def one_step_each(y, u):
    return u[:, 0]


# --- 8.5


def first_inputs(pair, x, target):
    Q = torch.cat([torch.tensor([1, 1, 0.3, 0.3]), pair]).diag()
    return pp.MPC(pp.DubinsCar(), Q, None, 8)(0.1, x, target)[1][:, 0]


@right("8.5")
def weights_by_lbfgs(x, target, u):
    def loss(logs):
        return (first_inputs(logs.exp(), x, target) - u).square().mean()

    return minimise(loss, torch.tensor([0.02, 0.02]).log(), 8).exp()


@right("8.5")
def weights_by_gauss_newton(x, target, u):
    logs = torch.tensor([0.02, 0.02]).log()
    for _ in range(8):
        J = jacobian(lambda z: first_inputs(z.exp(), x, target).ravel(), logs)
        rest = (u - first_inputs(logs.exp(), x, target)).ravel()
        logs = logs + torch.linalg.lstsq(J, rest[:, None]).solution[:, 0].clamp(-0.7, 0.7)
    return logs.exp().tolist()


@wrong("8.5", "These are the logarithms")
def as_logarithms(x, target, u):
    return weights_by_lbfgs(x, target, u).log()


@wrong("8.5", "First the weight of the speed")
def in_the_other_order(x, target, u):
    return weights_by_lbfgs(x, target, u).flip(0)


@wrong("8.5", "Their ratio is right")
def on_another_scale(x, target, u):
    return 3 * weights_by_lbfgs(x, target, u)


@wrong("8.5", "w u^2 / 2")
def with_their_roots(x, target, u):
    return weights_by_lbfgs(x, target, u).sqrt()


@wrong("8.5", "The guess has not moved")
def as_they_were_guessed(x, target, u):
    return torch.tensor([0.02, 0.02])


@wrong("8.5", "learn its logarithm")
def below_zero(x, target, u):
    return torch.tensor([-0.01, 0.02])


@wrong("8.5", "go downhill")
def too_few_iterations(x, target, u):
    def loss(logs):
        return (first_inputs(logs.exp(), x, target) - u).square().mean()

    return minimise(loss, torch.tensor([0.02, 0.02]).log(), 1).exp()


@wrong("8.5", "of shape (2,)")
def all_six(x, target, u):
    return torch.ones(6)


# --- 8.6


@right("8.6")
def by_the_svd(predict, theta):
    return torch.linalg.svd(jacobian(predict, theta)).Vh[-1]


@right("8.6")
def by_eigenvectors(predict, theta):
    J = jacobian(predict, theta).numpy()
    return -np.linalg.eigh(J.T @ J)[1][:, 0]


@right("8.6")
def by_differences(predict, theta):
    with torch.no_grad():
        columns = [predict(theta + h) - predict(theta - h) for h in 1e-5 * torch.eye(len(theta))]
    return torch.linalg.svd(torch.stack(columns, -1)).Vh[-1]


@wrong("8.6", "in which the predictions change the most")
def the_loudest(predict, theta):
    return torch.linalg.svd(jacobian(predict, theta)).Vh[0]


@wrong("8.6", "a direction of length 1")
def without_its_length(predict, theta):
    return 2 * by_the_svd(predict, theta)


@wrong("8.6", "the direction of shape (3,)")
def of_the_predictions(predict, theta):
    return torch.linalg.svd(jacobian(predict, theta)).U[:, -1]


@wrong("8.6", "smallest singular value")
def a_column_of_Vh(predict, theta):
    return torch.linalg.svd(jacobian(predict, theta)).Vh[:, -1]


@wrong("8.6", "smallest singular value")
def of_a_thin_svd(predict, theta):
    return torch.linalg.svd(jacobian(predict, theta), full_matrices=False).Vh[-1]


@wrong("8.6", "smallest singular value")
def that_keeps_the_sum(predict, theta):
    g = jacobian(lambda theta: predict(theta).sum(), theta)
    return torch.linalg.svd(g[None]).Vh[-1]


@wrong("8.6", "smallest singular value")
def along_an_axis(predict, theta):
    return torch.eye(len(theta))[0]
