"""Logs of short walks with robots that have something, for exercise 9.6."""

import tempfile
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor

from ... import go1

SECONDS, STEP = 6, 0.1  # of a walk, and of its loop
KINDS = {
    "healthy": lambda seed: go1.Simulation(seed=seed),
    "deaf": lambda seed: go1.Simulation(seed=seed, model="pro"),  # the flag is not its model's
    "frozen": lambda seed: go1.Simulation(seed=seed, freeze=2.2 + 0.3 * (seed % 5)),
    "lossy": lambda seed: go1.Simulation(seed=seed, faults=go1.Faults(loss=0.7)),
    "late": lambda seed: go1.Simulation(seed=seed, faults=go1.Faults(delay=0.15)),
}


class WalkLog(NamedTuple):
    """What a walk of 6 s has recorded; a row for each state that came and was new."""

    t: Tensor  # s, (N,)
    told: Tensor  # m/s, the speed that was being told when the state came
    seen: Tensor  # m/s, the speed in the state
    age: Tensor  # s, how old the state before had become


def walk_log(kind: str, seed: int = 0) -> WalkLog:
    """Returns the log of a walk straight on, at a speed that changes every second.

    Args:
        kind: what the robot has, one of `KINDS`.
        seed: of the speeds and the noise.
    """
    speeds = 0.3 + 0.5 * torch.rand(SECONDS, generator=torch.Generator().manual_seed(seed))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "walk.csv"
        with go1.connect("sim", simulation=KINDS[kind](seed), log=path) as robot:
            try:
                for k in range(round(SECONDS / STEP)):
                    robot.move(float(speeds[int(k * STEP)]), 0.0)
                    robot.wait(STEP)
            except (go1.RobotTimeout, go1.RobotStopped):
                pass
            end = robot.now()
        rows = torch.tensor(go1.read_log(path), dtype=torch.float64)
    rows = rows[rows[:, 0] < end]
    return WalkLog(rows[:, 0], rows[:, 7], rows[:, 4], rows[:, 19])
