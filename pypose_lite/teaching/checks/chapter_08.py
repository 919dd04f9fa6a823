"""What the answers of lab 8 must do: derivatives. What is learned with them: chapter_08_learned."""

import torch

from ... import infinity
from ...control import MPC
from ...filters import EKF
from ...systems import DubinsCar
from . import expect
from .exercise import Exercise, Failure

minimiser = Exercise("8.1", "The slope of a minimiser", minutes=10, takes="J, w, theta", points=2)


def slope_of(answer, J, w, theta):
    """The derivative that an answer gives, of the right shape."""
    return expect.tensor("dw/dtheta", answer(J, w, theta), (len(w), len(theta)))


@minimiser.must("return a matrix with a row for each unknown and a column for each parameter")
def shape_of_slope(answer, given):
    for n, p in [(3, 2), (1, 3), (2, 1)]:
        M = given.randn(n, p)

        def cost(w, theta, M=M):
            return (w - M @ theta).square().sum() / 2

        slope_of(answer, cost, M.sum(-1), torch.ones(p))


@minimiser.must("be right for a quadratic cost")
def quadratic_cost(answer, given):
    A, B, theta = given.positive(3), given.randn(3, 2), given.randn(2)
    want = torch.linalg.inv(A) @ B
    mistakes = {
        "The sign: the equation is H dw + dg = 0.": -want,
        "Solve with H: how far w moves depends on how steep g is.": B,
        "Solve with H: how far w moves depends on how steep g is. And mind the sign.": -B,
        "H is not diagonal: the unknowns pull at each other.": B / A.diagonal()[:, None],
        "Solve with H, do not multiply by it.": A @ B,
        "Nothing moves: is w held fixed where g is differentiated?": 0 * B,
    }
    came = slope_of(answer, lambda w, theta: w @ A @ w / 2 - w @ B @ theta, want @ theta, theta)
    hint = "H is the matrix of second derivatives by w, and dg/dtheta the mixed ones."
    expect.close("dw/dtheta", came, want, hint, mistakes)


@minimiser.must("be right for any smooth cost, at its minimum")
def any_cost(answer, given):
    for _ in range(2):
        S, M, theta = given.positive(3), given.randn(3, 2), given.randn(2)

        def cost(w, theta, S=S, M=M):
            return torch.cosh(S @ (w - torch.sin(M @ theta))).sum() + theta.square().sum()

        w = torch.sin(M @ theta)  # where the cost is least, whatever S is
        want = torch.cos(M @ theta)[:, None] * M
        hint = "Take all second derivatives at the given w and theta."
        came = slope_of(answer, cost, w, theta)
        expect.close("dw/dtheta", came, want, hint, {"The sign.": -want}, tolerance=1e-4)


tester = Exercise("8.2", "A test for gradients", minutes=15, takes="f, x, gradient", points=2)


def says(answer, f, x, gradient):
    """What a test says of a gradient: True or False."""
    came = answer(f, x.clone(), gradient.clone())
    if isinstance(came, bool):
        return came
    value = expect.tensor("True or False", came, ())
    expect.that(value in (0, 1), "True or False", f"{value.item():g}", "Compare, and return it.")
    return bool(value)


def curved(x):
    """A function whose third derivative is large."""
    return torch.sin(20 * x).sum() + x.square().sum()


def curved_slope(x):
    """Its gradient."""
    return 20 * torch.cos(20 * x) + 2 * x


def far_up(x):
    """A function whose values are large beside their differences."""
    return 1e5 + torch.exp(x).sum()


def valley(x):
    """A function with the minimum 0 at 0."""
    return (x.square() * (1 + torch.arange(len(x)))).sum() / 2


def accepts(answer, f, x, gradient, hint):
    """Sees to it that a test accepts a right gradient."""
    expect.that(says(answer, f, x, gradient), "True, for a right gradient", "False", hint)


@tester.must("accept right gradients")
def accepts_right(answer, given):
    x = given.randn(4)
    M = given.positive(4)
    accepts(answer, lambda x: x @ M @ x, x, 2 * M @ x, "Here any sensible step would do.")
    hint = "The function bends within your step: it is too wide. Take a smaller one."
    x = torch.tensor([0.0, 0.31, -0.62, 0.15]) + given.uniform(-0.01, 0.01, 4)
    accepts(answer, curved, x, curved_slope(x), hint)
    hint = "The difference of two large values is mostly rounding: your step is too small."
    x = given.uniform(-0.5, 0.5, 4)
    accepts(answer, far_up, x, torch.exp(x), hint)


@tester.must("accept a gradient of zeros where the function is stationary")
def accepts_zero(answer, given):
    x = torch.zeros(3)
    hint = "Here all slopes are 0: a relative error divides by zero. Allow a small absolute one."
    accepts(answer, valley, x, x, hint)


@tester.must("refuse wrong gradients, also where one entry is 5 % off")
def refuses_wrong(answer, given):
    x = given.uniform(-0.5, 0.5, 4)
    right = torch.exp(x)
    off = right * torch.tensor([1, 1, 1.05, 1])
    swapped = right[[1, 0, 2, 3]]
    shifted = right + torch.tensor([0.2, -0.2, 0, 0])
    wrong = {
        "one entry 5 % too large": (off, "Compare every entry, with a tolerance below 1 %."),
        "two entries exchanged": (swapped, "Compare entry by entry, not a norm or a sum."),
        "errors that cancel in the sum": (shifted, "Compare entry by entry, not their sum."),
        "the opposite sign": (-right, "Compare the numbers, not their sizes."),
        "nothing but zeros": (0 * right, "A gradient that was cut off is 0: it must not pass."),
        "a size that is half of what it should be": (right / 2, "Not only the direction counts."),
        "nan": (right * torch.nan, "A comparison with nan is false: is your test the other way?"),
    }
    for name, (gradient, hint) in wrong.items():
        expect.that(not says(answer, far_up, x, gradient), f"False, for {name}", "True", hint)
    hint = "An absolute tolerance must fit the size of the gradient."
    for scale in (1e-3, 1.0):
        gradient = 1.05 * scale * curved_slope(x)
        came = says(answer, lambda x, scale=scale: scale * curved(x), x, gradient)
        expect.that(not came, "False, for entries 5 % too large", "True", hint)


cut = Exercise("8.3", "A gradient that was cut", 20, takes="theta, noise", points=2, seconds=120.0)
CARS, STEPS, AHEAD = 8, 6, 4


def loop_loss(theta, noise, keep=frozenset(["sent", "estimate", "state"])):
    """The loss of the lab's loop; what is not kept is cut out of the graph."""

    def passed(name, z):
        return z if name in keep else z.detach()

    weights = torch.tensor([1, 1, 0.3, 0.3, 0.01, 0.01])
    metres = infinity.LENGTH * torch.arange(CARS)[:, None] / CARS
    targets = infinity.reference(metres + 0.13 * torch.arange(STEPS + AHEAD))
    car, real, eye = DubinsCar(0.1, theta[0]), DubinsCar(0.1, 0.2), torch.eye(4)
    mpc, ekf, P = MPC(car, torch.diag(weights), None, AHEAD), EKF(car), 0.05**2 * eye
    x, guess, total = targets[:, 0], None, 0.0
    X = x + 0.05 * noise[STEPS, 0]
    for i in range(STEPS):
        u = mpc(0.1, passed("estimate", X), targets[:, i : i + AHEAD], guess)[1]
        guess, sent = u.detach(), passed("sent", u[:, 0])
        y = passed("state", x) + 0.163 * noise[i, 0]
        X, P = ekf(X, y, sent, P, 0.005**2 * eye, theta[1].exp() ** 2 * eye)
        x = real.transition(x, u[:, 0]) + 0.005 * noise[i, 1]
        total = total + (x - targets[:, i + 1])[:, :2].square().sum(-1).mean()
    return total / STEPS


def drawn(given):
    """Numbers that planner and filter believe in, and the noise of a drive."""
    theta = torch.stack([given.uniform(-0.1, 0.3), given.uniform(-3, -2)])
    return theta, given.randn(STEPS + 1, 2, CARS, 4)


@cut.must("give the loss that the faulty function gives: its value was right")
def same_value(answer, given):
    theta, noise = drawn(given)
    with torch.no_grad():
        want = loop_loss(theta, noise)
    expect.close("the loss", answer(theta, noise), want, "Change the graph and not the loop.")


def gradient_of(loss, theta, noise):
    """The gradient of a loss by the two numbers."""
    leaf = theta.clone().requires_grad_()
    value = loss(leaf, noise)
    if not (isinstance(value, torch.Tensor) and value.requires_grad):
        raise Failure("a loss with a gradient", "one without", expect.DETACHED)
    found = torch.autograd.grad(value, leaf, allow_unused=True)[0]
    return torch.zeros(2) if found is None else found


@cut.must("have the gradient that differences of the loss have")
def same_gradient(answer, given):
    theta, noise = drawn(given)
    found, h = gradient_of(answer, theta, noise), 1e-5
    with torch.no_grad():
        sides = [
            (loop_loss(theta + d, noise), loop_loss(theta - d, noise)) for d in h * torch.eye(2)
        ]
    want = torch.stack([(up - down) / (2 * h) for up, down in sides])
    cuts = {
        "It is still the gradient of the faulty function.": ["estimate", "state"],
        "The estimate is cut off before the planner: no step hears of the one before.": ["sent"],
        "Now the state is cut off before the sensor.": ["sent", "estimate"],
    }
    mistakes = {
        hint: gradient_of(lambda *z, keep=keep: loop_loss(*z, keep=keep), theta, noise)
        for hint, keep in cuts.items()
    }
    hint = "Follow each tensor of the loop: where do its numbers go on without their graph?"
    expect.close("the gradient", found, want, hint, mistakes, tolerance=1e-4)
