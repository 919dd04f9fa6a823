"""Answers to lab 8 on derivatives, as students give them."""

import numpy as np
import torch
from graders import right, wrong
from torch.autograd.functional import hessian, jacobian

from pypose_lite.teaching.checks import chapter_08 as lab

# --- 8.1


def second_derivatives(J, w, theta):
    """H and the mixed ones, out of one large matrix."""
    n = len(w)
    both = hessian(lambda z: J(z[:n], z[n:]), torch.cat([w, theta]))
    return both[:n, :n], both[:n, n:]


@right("8.1")
def out_of_one_large_hessian(J, w, theta):
    H, mixed = second_derivatives(J, w, theta)
    return -torch.linalg.inv(H) @ mixed


@right("8.1")
def row_by_row(J, w, theta):
    w, theta = w.clone().requires_grad_(), theta.clone().requires_grad_()
    (g,) = torch.autograd.grad(J(w, theta), w, create_graph=True)
    rows = [
        torch.autograd.grad(each, [w, theta], retain_graph=True, materialize_grads=True)
        for each in g
    ]
    H, mixed = (torch.stack(z).numpy() for z in zip(*rows))
    return -np.linalg.solve(H, mixed)


@right("8.1")
def by_minimising_again(J, w, theta):
    def minimum(theta):
        z = w
        for _ in range(8):
            H, _ = second_derivatives(J, z, theta)
            z = z - torch.linalg.solve(H, jacobian(lambda z: J(z, theta), z))
        return z

    sides = [minimum(theta + h) - minimum(theta - h) for h in 1e-5 * torch.eye(len(theta))]
    return torch.stack(sides, -1) / 2e-5


@wrong("8.1", "The sign: the equation is H dw + dg = 0")
def without_the_minus(J, w, theta):
    return -out_of_one_large_hessian(J, w, theta)


@wrong("8.1", "how far w moves depends on how steep g is. And mind the sign")
def only_the_mixed_ones(J, w, theta):
    return second_derivatives(J, w, theta)[1]


@wrong("8.1", "how far w moves depends on how steep g is")
def minus_the_mixed_ones(J, w, theta):
    return -second_derivatives(J, w, theta)[1]


@wrong("8.1", "H is not diagonal")
def divided_by_the_diagonal(J, w, theta):
    H, mixed = second_derivatives(J, w, theta)
    return -mixed / H.diagonal()[:, None]


@wrong("8.1", "do not multiply by it")
def multiplied_by_H(J, w, theta):
    H, mixed = second_derivatives(J, w, theta)
    return H @ H @ out_of_one_large_hessian(J, w, theta)


@wrong("8.1", "Its transpose has that shape")
def transposed(J, w, theta):
    return out_of_one_large_hessian(J, w, theta).mT


@wrong("8.1", "dw/dtheta of shape (3, 2)")
def of_the_cost_itself(J, w, theta):
    return jacobian(lambda theta: J(w, theta), theta)


@wrong("8.1", "Nothing moves")
def with_w_held_fixed(J, w, theta):
    return jacobian(lambda theta: w + 0 * theta.sum(), theta)


@wrong("8.1", "at the given w and theta")
def at_the_wrong_place(J, w, theta):
    H, mixed = second_derivatives(J, 0 * w, 0 * theta)
    return -torch.linalg.solve(H, mixed)


# --- 8.2


def slopes_of(f, x, h=1e-5):
    return torch.stack([(f(x + d) - f(x - d)) / (2 * h) for d in h * torch.eye(len(x))])


@right("8.2")
def with_allclose(f, x, gradient):
    slopes = slopes_of(f, x)
    return torch.allclose(gradient, slopes, rtol=1e-2, atol=1e-3 * slopes.norm().item() + 1e-8)


@right("8.2")
def by_forward_differences(f, x, gradient):
    h = 1e-6
    slopes = [(float(f(x + d)) - float(f(x))) / h for d in h * torch.eye(len(x))]
    allowed = 0.02 * max(abs(slope) for slope in slopes) + 1e-5
    return all(abs(slope - float(g)) < allowed for slope, g in zip(slopes, gradient))


@right("8.2")
def by_autograd(f, x, gradient):
    exact = jacobian(f, x)
    return (gradient - exact).abs().max() <= 0.001 * exact.abs().max()


@wrong("8.2", "your step is too small")
def with_a_tiny_step(f, x, gradient):
    slopes = slopes_of(f, x, 1e-11)
    return bool(((gradient - slopes).abs() < 0.01 * slopes.abs().max() + 1e-6).all())


@wrong("8.2", "it is too wide")
def with_a_wide_step(f, x, gradient):
    slopes = slopes_of(f, x, 0.1)
    return bool(((gradient - slopes).abs() < 0.01 * slopes.abs().max() + 1e-6).all())


@wrong("8.2", "a relative error divides by zero")
def by_the_relative_error(f, x, gradient):
    slopes = slopes_of(f, x)
    return bool((gradient - slopes).norm() / slopes.norm() < 0.01)


@wrong("8.2", "Compare entry by entry, not a norm or a sum")
def by_the_norm(f, x, gradient):
    return bool((slopes_of(f, x).norm() - gradient.norm()).abs() < 0.001 * gradient.norm() + 1e-8)


@wrong("8.2", "Compare every entry, with a tolerance below 1 %")
def too_generous(f, x, gradient):
    slopes = slopes_of(f, x)
    return bool((gradient - slopes).norm() < 0.1 * slopes.norm() + 1e-8)


@wrong("8.2", "Compare entry by entry")
def along_all_of_them(f, x, gradient):
    d = 1e-5 * torch.ones_like(x)
    slope = (f(x + d) - f(x - d)) / 2e-5
    off = (slope - gradient.sum()).abs()
    return bool(off < 1e-3 * gradient.abs().sum() + 1e-8)


@wrong("8.2", "Compare the numbers, not their sizes")
def by_the_sizes(f, x, gradient):
    slopes = slopes_of(f, x).abs()
    return bool(((gradient.abs() - slopes).abs() < 0.01 * slopes.max() + 1e-8).all())


@wrong("8.2", "Not only the direction counts")
def by_the_direction(f, x, gradient):
    slopes = slopes_of(f, x)
    if slopes.norm() == 0:
        return bool(gradient.norm() == 0)
    return bool(slopes @ gradient / (slopes.norm() * gradient.norm()) > 0.9999)


@wrong("8.2", "is your test the other way")
def refuses_what_is_larger(f, x, gradient):
    slopes = slopes_of(f, x)
    return not bool(((gradient - slopes).abs() > 0.01 * slopes.abs().max() + 1e-8).any())


@wrong("8.2", "must fit the size of the gradient")
def by_an_absolute_tolerance(f, x, gradient):
    return bool(((gradient - slopes_of(f, x)).abs() < 1e-2).all())


@wrong("8.2", "True or False")
def the_error_itself(f, x, gradient):
    return (gradient - slopes_of(f, x)).abs().max() + 0.5


# --- 8.3


@right("8.3")
def as_it_should_be(theta, noise):
    return lab.loop_loss(theta, noise)


@right("8.3")
def with_its_gradient_by_differences(theta, noise):
    """Another way to the same: a loss whose gradient is that of differences."""
    with torch.no_grad():
        value = lab.loop_loss(theta, noise)
        slopes = slopes_of(lambda theta: lab.loop_loss(theta, noise), theta.detach())
    return value + slopes @ (theta - theta.detach())


@right("8.3")
def car_by_car(theta, noise):
    """A sum over the steps in another order."""
    return sum([lab.loop_loss(theta, noise) / 4 for _ in range(4)])


@wrong("8.3", "still the gradient of the faulty function")
def as_it_was(theta, noise):
    return lab.loop_loss(theta, noise, keep=["estimate", "state"])


@wrong("8.3", "The estimate is cut off before the planner")
def cut_elsewhere(theta, noise):
    return lab.loop_loss(theta, noise, keep=["sent", "state"])


@wrong("8.3", "the state is cut off before the sensor")
def cut_at_the_sensor(theta, noise):
    return lab.loop_loss(theta, noise, keep=["sent", "estimate"])


@wrong("8.3", "one without")
def without_any_graph(theta, noise):
    return torch.tensor(lab.loop_loss(theta, noise).item())


@wrong("8.3", "Change the graph and not the loop")
def another_loop(theta, noise):
    return lab.loop_loss(theta, 0.9 * noise)


@wrong("8.3", "Follow each tensor")
def doubled_gradient(theta, noise):
    value = lab.loop_loss(theta, noise)
    return 2 * value - value.detach()
