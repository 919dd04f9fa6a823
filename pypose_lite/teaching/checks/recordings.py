"""Recordings for lab 4: of a cart, a car and the simulated dog, with noise to be found."""

import math

import torch
from torch import Tensor

from ... import go1
from ...systems import DubinsCar

DT = 0.1  # s
A = torch.tensor([[1.0, DT], [0.0, 1.0]], dtype=torch.float64)  # the cart: position and speed
B = torch.tensor([[DT**2 / 2], [DT]], dtype=torch.float64)
C = torch.tensor([[1.0, 0.0]], dtype=torch.float64)
Q = torch.diag(torch.tensor([0.01, 0.02], dtype=torch.float64)) ** 2
R = torch.tensor([[0.02**2]], dtype=torch.float64)


def _generator(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(1000 + seed)


def _randn(g: torch.Generator, *shape: int) -> Tensor:
    return torch.randn(shape, generator=g, dtype=torch.float64)


def cart_run(seed: int, delay: int = 0, steps: int = 200) -> tuple[Tensor, Tensor]:
    """Returns positions ``y (steps, 1)`` of a cart, in m, and its accelerations ``u (steps, 1)``.

    Args:
        seed: another one makes another recording.
        delay: ``y[i]`` is of the state of ``delay`` steps before.
        steps: of 0.1 s each.
    """
    g = _generator(seed)
    u = 2 * _randn(g, steps, 1)
    x = [torch.zeros(2, dtype=torch.float64)]
    for i in range(steps):
        x.append(A @ x[i] + B @ u[i] + Q.sqrt() @ _randn(g, 2))
    states = torch.stack([x[max(i - delay, 0)] for i in range(steps)])
    return states @ C.mT + R.sqrt() * _randn(g, steps, 1), u


def walks(seed: int, process: float, sensor: float, runs: int = 32, steps: int = 60) -> Tensor:
    """Returns observations ``(runs, steps)`` of numbers that move at random, in m."""
    g = _generator(seed)
    x = _randn(g, runs, steps).cumsum(-1) * process
    return x + sensor * _randn(g, runs, steps)


def car_laps(seed: int, runs: int = 64, steps: int = 64) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Returns ``x (runs, steps+1, 4)``, ``y (runs, steps, 4)``, ``u (steps, 2)`` and a first guess.

    A car drives a circle. What disturbs it and how noisy its sensor is, is to be found. The guess
    ``(runs, 4)`` is off by 0.05 in each number.
    """
    g = _generator(seed)
    car = DubinsCar(DT)
    turn = 2 * math.pi / 64 / DT
    u = torch.tensor([1.0, turn], dtype=torch.float64).expand(steps, 2)
    start = torch.tensor([0.0, 0.0, 0.0, -1.0], dtype=torch.float64)
    x = [start.expand(runs, 4)]
    for i in range(steps):
        x.append(car.transition(x[i], u[i]) + 0.02 * _randn(g, runs, 4))
    truth = torch.stack(x, dim=1)
    y = truth[:, :-1] + 0.11 * _randn(g, runs, steps, 4)
    return truth, y, u, truth[:, 0] + 0.05 * _randn(g, runs, 4)


def dog_walk(seed: int, steps: int = 80) -> tuple[Tensor, Tensor, Tensor]:
    """Returns ``x (steps, 4)``, ``y (steps, 4)``, ``u (steps, 2)`` of a walk of the simulated Go1.

    Its odometry is too good for this lab, so noise of 0.1 m and 0.1 rad is added to each pose.
    """
    g = _generator(seed)
    faster = 0.1 * float(_randn(g, 1).clamp(-1, 1))
    x, y, u = [], [], []
    with go1.connect("sim") as dog:
        for i in range(steps):
            pose = torch.tensor(dog.pose(), dtype=torch.float64)
            u.append([0.5 + faster, 0.8 if i < steps // 2 else -0.8])
            x.append(_state(pose))
            y.append(_state(pose + 0.1 * _randn(g, 3)))
            dog.move(*u[-1])
            dog.wait(DT)
        dog.stop()
    return torch.stack(x), torch.stack(y), torch.tensor(u, dtype=torch.float64)


def _state(pose: Tensor) -> Tensor:
    i, j, heading = pose
    return torch.stack([i, j, heading.cos(), heading.sin()])
