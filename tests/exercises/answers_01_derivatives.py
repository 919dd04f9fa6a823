"""Answers to lab 1, as students give them: Jacobians, a lap, a pendulum."""

import math

import torch
from graders import right, wrong

import pypose_lite as pp

# --- 1.4


def one_step(x, u, dt, wheelbase):
    _, _, theta, v = x
    rates = v * theta.cos(), v * theta.sin(), v / wheelbase * u[1].tan(), u[0]
    return x + dt * torch.stack(rates)


@right("1.4")
def by_jacrev(x, u, dt, wheelbase):
    return torch.func.jacrev(one_step, (0, 1))(x, u, dt, wheelbase)


@right("1.4")
def as_lists(x, u, dt, wheelbase):
    _, _, theta, v = x.tolist()
    _, delta = u.tolist()
    c, s, t = math.cos(theta), math.sin(theta), math.tan(delta)
    A = [[1, 0, -v * s * dt, c * dt], [0, 1, v * c * dt, s * dt], [0, 0, 1, dt * t / wheelbase]]
    return [[*A, [0, 0, 0, 1]], [[0, 0], [0, 0], [0, v * (1 + t * t) * dt / wheelbase], [dt, 0]]]


def named(name, says, A=lambda A, **_: A, B=lambda B, **_: B):
    """Adds a wrong answer: a right one of which one matrix is changed."""

    def answer(x, u, dt, wheelbase):
        right_A, right_B = by_jacrev(x, u, dt, wheelbase)
        return A(right_A, u=u, dt=dt), B(right_B, u=u, dt=dt)

    wrong("1.4", says, name)(answer)


def minus_sine(A, **_):
    return A * torch.tensor([[1, 1, -1, 1], [1, 1, -1, 1], [1] * 4, [1] * 4])


def no_cosine(B, u, **_):
    return B * torch.tensor([[1, 1], [1, 1], [1, u[1].cos() ** 2], [1, 1]])


named("transposed", "A is transposed", A=lambda A, **_: A.mT)
named("no identity", "its derivative is the identity", A=lambda A, **_: A - torch.eye(4))
named("sign of the sine", "The derivative of the cosine is minus the sine", A=minus_sine)
named("no 1/cos^2", "is 1 / cos(delta)^2", B=no_cosine)
named("swapped columns", "The columns have changed places", B=lambda B, **_: B.flip(1))
named("without dt", "The rates are multiplied by dt", B=lambda B, dt, **_: B / dt)
named("B transposed", "Its transpose has that shape", B=lambda B, **_: B.mT)


@wrong("1.4", "Expected 2 results: A, B; got a tensor of shape (4, 4)")
def without_B(x, u, dt, wheelbase):
    return by_jacrev(x, u, dt, wheelbase)[0]


# --- 1.5


def differences(f, x, h=1e-5):
    return torch.stack([(f(x + d) - f(x - d)) / (2 * h) for d in h * torch.eye(len(x))], -1)


@right("1.5")
def against_autograd(f, A, x):
    return torch.allclose(torch.func.jacfwd(f)(x), A)


@right("1.5")
def relative_differences(f, A, x):
    return (differences(f, x) - A).norm() < 1e-5 * A.norm()


@right("1.5")
def slopes_of_random_directions(f, A, x):
    directions = torch.randn(20, len(x), generator=torch.Generator().manual_seed(0))
    for direction in directions:
        errors = []
        for size in (1e-3, 1e-4):
            dx = size * direction
            errors.append((f(x + dx) - f(x) - A @ dx).norm())
        if errors[1] > errors[0] / 50:
            return False
    return True


@wrong("1.5", "False for A with +0.1 in row 0, column 0")
def always(f, A, x):
    return True


@wrong("1.5", "True for a right Jacobian")
def never(f, A, x):
    return False


@wrong("1.5", "column 1")
def along_the_first_axis(f, A, x):
    dx = 1e-5 * torch.eye(len(x))[0]
    return torch.allclose(f(x + dx) - f(x - dx), 2 * A @ dx, rtol=1e-4, atol=1e-9)


@wrong("1.5", "row 1")
def in_the_first_row(f, A, x):
    return torch.allclose(differences(f, x)[0], A[0], rtol=1e-4, atol=1e-4)


@wrong("1.5", "How large may its error be")
def exactly_linear(f, A, x):
    dx = 0.1 * torch.ones(len(x))
    return torch.allclose(f(x + dx), f(x) + A @ dx)


@wrong("1.5", "True or False; got a tensor of shape (3, 3)")
def entry_by_entry(f, A, x):
    return (differences(f, x) - A).abs() < 1e-6


@wrong("1.5", "Your code raised RuntimeError")
def square_ones_only(f, A, x):
    return torch.allclose(differences(f, x) @ torch.eye(3), A)


@wrong("1.5", "False for A with")
def much_too_patient(f, A, x):
    return torch.allclose(differences(f, x), A, atol=0.2 * float(A.abs().max()))


# --- 1.6


def inputs(first=0.5, slip=0.05, chord=True, switch=0.0):
    """The inputs of a lap; its arguments leave out one thought each."""
    dt, angle = 0.1, math.tau / 64
    side = 2 * math.sin(angle / 2) if chord else angle
    turns = [first * angle] + [angle] * 63 + [switch * angle] + [-angle] * 63
    return torch.tensor([[side / dt, turn / dt / (1 - slip)] for turn in turns])


def from_the_corners():
    """The same lap by another route: from the positions that are wanted."""
    k = torch.arange(65) * math.tau / 64
    right_circle = torch.stack([1 - k.cos(), -k.sin()], -1)
    left_circle = torch.stack([k.cos() - 1, -k.sin()], -1)
    way = torch.cat([right_circle, left_circle[1:]]).diff(dim=0)
    heading = torch.atan2(way[:, 1], way[:, 0])
    turn = heading.diff(prepend=torch.tensor([-math.pi / 2]))
    turn = torch.atan2(turn.sin(), turn.cos()) / 0.95
    return torch.stack([way.norm(dim=-1), turn], -1) / 0.1


right("1.6", "computed")(inputs())
right("1.6", "in a list")(inputs().tolist())
right("1.6", "from the corners")(from_the_corners())
wrong("1.6", "Does each turn rate make up for the 5 %", "without slip")(inputs(slip=0.0))
wrong("1.6", "which is shorter than its arc", "arcs")(inputs(chord=False))
wrong("1.6", "by half of the angle", "first step whole")(inputs(first=1.0, switch=-1.0))
wrong("1.6", "at most 0.2 m at each waypoint", "other way round")(-inputs())
wrong("1.6", "Its transpose has that shape", "transposed")(inputs().mT)
wrong("1.6", "of shape (64, 2)", "half of it")(inputs()[:64])
wrong("1.6", "got a function, inputs", "not called")(inputs)

# --- 1.7


@right("1.7")
def by_least_squares(states, dt):
    theta, omega = states[:-1].unbind(-1)
    rate = states[1:, 1] - omega
    terms = torch.stack([theta.sin(), -omega], -1) * dt
    gravity_by_length, _ = torch.linalg.lstsq(terms, rate[:, None]).solution
    return 9.81 / gravity_by_length


@right("1.7")
def by_trying_many(states, dt):
    lengths = torch.linspace(0.3, 3, 2701)
    pendulums = pp.Pendulum(dt, length=lengths[:, None])
    predicted = pendulums.transition(states[:-1].expand(2701, -1, 2), torch.zeros(1))
    loss = (states[1:] - predicted).square().sum((-1, -2))
    return lengths[loss.argmin()]


def descend(states, dt, steps=300, rate=0.05, direction=1):
    log_length = torch.zeros((), requires_grad=True)
    optimizer = torch.optim.Adam([log_length], lr=rate, maximize=direction < 0)
    for _ in range(steps):
        predicted = pp.Pendulum(dt, length=log_length.exp()).transition(states[:-1], torch.zeros(1))
        loss = (states[1:] - predicted).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return log_length


@right("1.7")
def by_adam(states, dt):
    return descend(states, dt).exp()


@wrong("1.7", "a first guess that has not moved")
def first_guess(states, dt):
    return torch.ones((), requires_grad=True)


@wrong("1.7", "return its exponential")
def logarithm(states, dt):
    return descend(states, dt)


@wrong("1.7", "what you learned is its inverse")
def inverse(states, dt):
    return 1 / by_least_squares(states, dt)


@wrong("1.7", "does it fall")
def uphill(states, dt):
    return descend(states, dt, steps=20, direction=-1).exp()


@wrong("1.7", "has it come to rest")
def too_early(states, dt):
    return descend(states, dt, steps=10, rate=0.005).exp()


@wrong("1.7", "does it fall")
def with_its_own_dt(states, dt):
    return by_least_squares(states, 0.1)


@wrong("1.7", "Expected the length as a single number; got one of shape (150,)")
def one_in_each_step(states, dt):
    return by_least_squares(states, dt) * torch.ones(150)
