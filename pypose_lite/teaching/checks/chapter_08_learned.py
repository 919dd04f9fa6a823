"""What the answers of lab 8 must do: numbers that are learned, and those that cannot be."""

import math

import torch

from ... import go1, infinity
from ...control import MPC
from ...filters import EKF
from ...systems import DubinsCar
from . import expect
from .exercise import Exercise

time_step = Exercise("8.4", "The time step of a record", 15, takes="y, u", points=2, seconds=60)


def number(name, came):
    """A single finite number."""
    return expect.tensor(name, came, ()).detach().item()


def about(name, came, want, share, hint):
    """Sees to it that a number is right up to a share of itself."""
    says = f"{name} = {want:.3g}, to within {100 * share:g} %"
    expect.that(abs(came - want) <= share * want, says, f"{came:.3g}", hint)


@time_step.must("find the time step of a record, to within 2 %")
def step_found(answer, given):
    for dt in (0.062, 0.147):
        t = torch.arange(50)
        phase = given.uniform(0, 3)
        u = torch.stack([1.5 + 0.5 * torch.sin(t / 4 + phase), 1.5 * torch.cos(t / 6)], -1)
        x = [infinity.waypoints()[0]]
        for u_t in u:
            x.append(DubinsCar(dt).transition(x[-1], u_t))
        y = torch.stack(x) + 0.05 * given.randn(51, 4)
        y[0] = x[0]
        came = number("the time step", answer(y, u))
        moved = (y[1:] - y[:-1])[:, :2].norm(dim=-1)
        hint = "Simulate the whole record with your time step, and compare all states."
        if abs(came - 0.1) < 1e-4:
            hint = "The guess of 0.1 has not moved: does the loss depend on it, and is it updated?"
        elif abs(came * dt - 1) < 0.1:
            hint = "This is one over the time step."
        elif abs(came - (moved.sum() / u[:, 0].sum()).item()) < 1e-3 * dt or came > 1.1 * dt:
            hint = "Noise makes each distance longer, and it does not cancel: simulate instead."
        elif abs(came - dt) < 0.1 * dt:
            hint = "Close. Make more steps, and use the turns of the car as well."
        about("dt", came, dt, 0.02, hint)


expert = Exercise("8.5", "Weights from an expert", 25, takes="x, target, u", points=3, seconds=180)


def lesson_of(given, speed, turn):
    """Where an expert was, where they were going, and what they did."""
    path = infinity.waypoints()
    x = path[:12] + 0.1 * given.randn(12, 4)
    x[:, 2:] = x[:, 2:] / x[:, 2:].norm(dim=-1, keepdim=True)
    Q = torch.diag(torch.tensor([1, 1, 0.3, 0.3, speed, turn]))
    with torch.no_grad():
        u = MPC(DubinsCar(), Q, None, 8)(0.1, x, path[1:13])[1][:, 0]
    return x, path[1:13], u + 0.01 * given.randn(12, 2)


@expert.must("find the weights of speed and turn rate, to within 10 %")
def weights_found(answer, given):
    for speed, turn in [(0.03, 0.012), (0.008, 0.05)]:
        came = expect.tensor("the weights", answer(*lesson_of(given, speed, turn)), (2,)).detach()
        want = torch.tensor([speed, turn])
        hint = "Compare the first input of each plan with what the expert did, and go downhill."
        if expect.near(came.exp(), want, 0.1):
            hint = "These are the logarithms of the weights."
        elif expect.near(came.flip(0), want, 0.1):
            hint = "First the weight of the speed, then that of the turn rate."
        elif expect.near(came.square(), want, 0.1) or expect.near(came, want / 2, 0.1):
            hint = "A weight w costs w u^2 / 2, as the planner's Q has it."
        elif expect.near(came / came.sum(), want / want.sum(), 0.03):
            hint = "Their ratio is right. The weights of the state are given, and fix the scale."
        elif (came <= 0).any():
            hint = "A weight is positive: learn its logarithm."
        elif expect.near(came, torch.tensor([0.02, 0.02]), 1e-3):
            hint = "The guess has not moved: do the plans depend on the weights in the graph?"
        says = f"{[speed, turn]}, to within 10 %"
        off = (came / want - 1).abs().max()
        expect.that(off < 0.1, says, f"{[round(w, 4) for w in came.tolist()]}", hint)


silent = Exercise("8.6", "What the data do not say", 20, takes="predict, theta", points=2)


def direction(answer, predict, theta):
    """A direction, of length 1."""
    d = expect.tensor("the direction", answer(predict, theta.clone()), (len(theta),)).detach()
    length = d.norm().item()
    expect.that(abs(length - 1) < 1e-4, "a direction of length 1", f"{length:.4g}", "Divide by it.")
    return d


@silent.must("return a direction of length 1, with an entry for each parameter")
def unit_length(answer, given):
    M = given.randn(5, 3)
    M[:, 2] = M[:, 0] - 2 * M[:, 1]
    direction(answer, lambda theta: torch.tanh(M @ theta), given.randn(3) / 3)


def holds(answer, predict, theta, J, hint):
    """Sees to it that predictions do not change in the direction of an answer."""
    d = direction(answer, predict, theta)
    change, largest = (J @ d).norm().item(), torch.linalg.matrix_norm(J, 2).item()
    if change > 0.99 * largest:
        hint = "This is the direction in which the predictions change the most."
    says = "a change of the predictions of 0"
    expect.that(change < 1e-4 * largest, says, f"{change / largest:.2g} of the largest", hint)


@silent.must("be a direction in which no prediction changes")
def nothing_changes(answer, given):
    for outputs in (5, 2):
        M = given.randn(outputs, 3)
        M[:, 2] = M[:, 0] - 2 * M[:, 1]
        theta = given.randn(3) / 3
        J = (1 - torch.tanh(M @ theta) ** 2)[:, None] * M
        hint = "J d = 0: d belongs to the smallest singular value of the Jacobian J."
        holds(answer, lambda theta, M=M: torch.tanh(M @ theta), theta, J, hint)
    mean, theta = given.randn(6, 2), given.randn(2)
    J = torch.stack([mean[:, 0], mean[:, 0]], -1)  # only the sum counts
    hint = "Which of all predictions, not their sum or mean, must not change?"
    holds(answer, lambda z: mean[:, 0] * z.sum() + mean[:, 1], theta, J, hint)


@silent.must("find that a planner's weights have no scale")
def no_scale(answer, given):
    path = infinity.waypoints()

    def predict(logs):
        return MPC(DubinsCar(), logs.exp().diag(), None, 4)(0.1, path[0], path[1])[1].ravel()

    logs = torch.tensor([1, 1, 0.3, 0.3, 0.05, 0.02]).log() + 0.1 * given.randn(6)
    d = direction(answer, predict, logs)
    hint = "All logarithms together: twice all weights is the same plan."
    off = (d.abs() - 1 / math.sqrt(6)).abs().max().item()
    expect.that(off < 1e-3, "six equal entries", f"{[round(z, 3) for z in d.tolist()]}", hint)


noises = Exercise("8.7", "R and Q end to end", 20, takes="y, u", points=3, seconds=240)


def recorded(given, q, r, cars=16, steps=30):
    """Observations (cars, steps, 4) and inputs (cars, steps, 2) of cars from the origin."""
    x = infinity.waypoints()[0].expand(cars, 4)
    u = torch.stack([given.uniform(0.5, 1.5, cars, steps), given.randn(cars, steps)], -1)
    y = []
    for i in range(steps):
        y.append(x + r * given.randn(cars, 4))
        x = DubinsCar().transition(x, u[:, i]) + q * given.randn(cars, 4)
    return torch.stack(y, 1), u


@noises.must("find both standard deviations, q to within 25 % and r to within 10 %")
def both_noises(answer, given):
    for q, r in [(0.05, 0.1), (0.03, 0.2)]:
        y, u = recorded(given, q, r)
        came = expect.tensor("[q, r]", answer(y, u), (2,)).detach()
        want = torch.tensor([q, r])
        hint = "Add -log p(e) of all innovations: (log det S + e' S^-1 e) / 2."
        if expect.near(came, want.square(), 0.3) or expect.near(came.sqrt(), want, 0.15):
            hint = "These are variances: take their square roots."
        elif expect.near(came.exp(), want, 0.25):
            hint = "These are logarithms."
        elif expect.near(came.flip(0), want, 0.25):
            hint = "First q, of the motion, then r, of the sensor."
        elif (came > 0.9).any():
            hint = "It has run away: without log det S the largest noise explains everything."
        elif abs(came[0] / came[1] - q / r) < 0.25 * q / r:
            hint = "Their ratio is right. It alone decides the estimates; the scale is in S."
        elif (came <= 0).any():
            hint = "A standard deviation is positive: learn its logarithm."
        off = (came / want - 1).abs()
        says = f"[q, r] = {[q, r]}"
        got = f"{[round(z, 4) for z in came.tolist()]}"
        expect.that(off[0] < 0.25 and off[1] < 0.1, says, got, hint)


lag = Exercise("8.8", "The robot's lag", 20, takes="x, u", points=2, seconds=120)


def walked(given, lag, steps=40):
    """What a simulated Go1 says of where it was (steps + 1, 4), and what it was told."""
    hold = torch.arange(steps) // 5
    v, phi = given.uniform(0.3, 1.0, 8)[hold], given.uniform(-1.2, 1.2, 8)[hold]
    u = torch.stack([v, phi], -1)
    x = []
    simulation = go1.Simulation(numbers=go1.Numbers(lag=lag))
    with go1.connect("sim", simulation=simulation) as robot:
        for u_t in [*u.tolist(), None]:
            i, j, heading = robot.pose()
            x.append([i, j, math.cos(heading), math.sin(heading)])
            if u_t is not None:
                robot.move(*u_t)
                robot.wait(0.1)
    return torch.tensor(x), u


@lag.must("find the time constant of the legs, to within 0.03 s")
def lag_found(answer, given):
    for true in (0.1, 0.25):
        x, u = walked(given, true)
        came = number("the lag", answer(x, u))
        hint = "Compare the simulated states with the record, and go downhill."
        if abs(math.exp(min(came, 5.0)) - true) < 0.03:
            hint = "This is the logarithm of the lag."
        elif came <= 0:
            hint = "A time constant is positive: learn its logarithm."
        elif abs(came / 10 - true) < 0.03:
            hint = "In seconds, not in steps."
        elif 0.03 < came - true < 0.06:
            hint = "Does your robot move with the speed at the end of a step? `late` does not."
        expect.that(abs(came - true) <= 0.03, f"{true} s", f"{came:.3g} s", hint)


def innovation_loss(logs, y, u):
    """The negative log-likelihood of a record, by its innovations; logs = [log q, log r]."""
    ekf, eye = EKF(DubinsCar()), torch.eye(4)
    Q, R = logs.exp().square()[:, None, None] * eye
    X, P, total = infinity.waypoints()[0].expand(len(y), 4), 1e-6 * eye.expand(len(y), 4, 4), 0.0
    for i in range(y.shape[1]):
        e, S, _ = ekf.innovation(X, y[:, i], u[:, i], P, R)
        inside = (e * torch.linalg.solve(S, e)).sum(-1)
        total = total + (torch.logdet(S) + inside).sum() / 2
        X, P = ekf(X, y[:, i], u[:, i], P, Q, R)
    return total
