"""Answers to lab 8 on noise and lag, as students give them."""

import math

import numpy as np
import torch
from answers_08_learned import minimise, on_a_grid
from graders import right, wrong

import pypose_lite as pp
from pypose_lite import infinity
from pypose_lite.teaching.checks import chapter_08_learned as lab

# --- 8.7


@right("8.7")
def by_likelihood(y, u):
    def loss(logs):
        return lab.innovation_loss(logs, y, u) / y.numel()

    return minimise(loss, torch.tensor([0.1, 0.1]).log()).exp()


@right("8.7")
def on_two_grids(y, u):
    """q by the ratio on a grid, and the scale in closed form."""
    ratios = torch.logspace(-1.2, 0.2, 29)
    best, found = math.inf, None
    with torch.no_grad():
        for ratio in ratios:
            e, S = innovations(ratio, torch.tensor(1.0), y, u)
            squares = (e * torch.linalg.solve(S, e)).sum(-1)
            r = (squares.mean() / 4).sqrt()
            value = torch.logdet(S).mean() + 4 * (r**2).log()
            if value < best:
                best, found = value, [float(ratio * r), float(r)]
    return found


def innovations(q, r, y, u):
    ekf, eye = pp.EKF(pp.DubinsCar()), torch.eye(4)
    X, P = infinity.waypoints()[0].expand(len(y), 4), 1e-6 * eye.expand(len(y), 4, 4)
    e, S = [], []
    for i in range(y.shape[1]):
        e_i, S_i, _ = ekf.innovation(X, y[:, i], u[:, i], P, r**2 * eye)
        e.append(e_i)
        S.append(S_i)
        X, P = ekf(X, y[:, i], u[:, i], P, q**2 * eye, r**2 * eye)
    return torch.stack(e[1:]), torch.stack(S[1:])


def by_the_library(y, u):
    return torch.tensor(on_two_grids(y, u))


@wrong("8.7", "take their square roots")
def as_variances(y, u):
    return by_the_library(y, u) ** 2


@wrong("8.7", "These are logarithms")
def logarithms_of_noise(y, u):
    return by_the_library(y, u).log()


@wrong("8.7", "First q, of the motion")
def r_before_q(y, u):
    return by_the_library(y, u).flip(0)


@wrong("8.7", "without log det S")
def without_the_determinant(y, u):
    def loss(logs):
        e, S = innovations(*logs.exp(), y, u)
        return (e * torch.linalg.solve(S, e)).sum(-1).mean() / 2

    return minimise(loss, torch.tensor([0.1, 0.1]).log()).exp()


@wrong("8.7", "Their ratio is right")
def on_a_scale_of_its_own(y, u):
    return 0.5 * by_the_library(y, u)


@wrong("8.7", "-log p(e)")
def of_the_observations_alone(y, u):
    return torch.tensor([0.005, float((y[:, 1:] - y[:, :-1]).std())])


@wrong("8.7", "[q, r] of shape (2,)")
def a_covariance(y, u):
    return torch.eye(4)


# --- 8.8


def late(lag, x, u, dt=0.1):
    rest, v, states = torch.exp(-dt / lag), torch.zeros(2), [x]
    for told in u:
        mean, v = told + (v - told) * (1 - rest) * lag / dt, told + (v - told) * rest
        heading = torch.atan2(x[3], x[2])
        middle, heading = heading + dt * mean[1] / 2, heading + dt * mean[1]
        i, j = x[0] + dt * mean[0] * middle.cos(), x[1] + dt * mean[0] * middle.sin()
        x = torch.stack([i, j, heading.cos(), heading.sin()])
        states.append(x)
    return torch.stack(states)


@right("8.8")
def lag_by_lbfgs(x, u):
    def loss(log_lag):
        return (late(log_lag.exp(), x[0], u) - x).square().mean()

    return minimise(loss, torch.tensor(0.1).log()).exp()


@right("8.8")
def lag_on_a_grid(x, u):
    return on_a_grid(lambda lag: (late(lag, x[0], u) - x).square().mean(), 0.02, 0.5)


@right("8.8")
def lag_of_the_heading(x, u):
    """From the heading alone, with its scale and its drift."""
    turns = torch.atan2(x[:, 3], x[:, 2])
    seen = torch.tensor(np.unwrap(turns.numpy()))

    def loss(lag):
        states = late(lag, x[0], u)
        simulated = torch.tensor(np.unwrap(torch.atan2(states[:, 3], states[:, 2]).numpy()))
        return (seen - simulated - (seen - simulated).mean()).square().mean()

    return on_a_grid(loss, 0.02, 0.5)


@wrong("8.8", "at the end of a step")
def by_legs(x, u):
    def loss(log_lag):
        car, z, total = pp.Legs(0.1, lag=log_lag.exp()), torch.cat([x[0], torch.zeros(2)]), 0.0
        for i in range(len(u)):
            z = car.transition(z, u[i])
            total = total + (z[:4] - x[i + 1]).square().sum()
        return total

    return minimise(loss, torch.tensor(0.1).log()).exp()


@wrong("8.8", "This is the logarithm")
def the_logarithm(x, u):
    return lag_by_lbfgs(x, u).log()


@wrong("8.8", "In seconds, not in steps")
def in_steps(x, u):
    return 10 * lag_by_lbfgs(x, u)


@wrong("8.8", "learn its logarithm")
def a_negative_one(x, u):
    return -0.2


@wrong("8.8", "Compare the simulated states")
def the_rate(x, u):
    return 0.5


@wrong("8.8", "the lag")
def one_for_each_axis(x, u):
    return [0.1, 0.2]
