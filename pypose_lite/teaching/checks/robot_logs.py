"""Logs of short walks: with robots that have something (9.6), and in pulses (9.8)."""

import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy
import torch
from torch import Tensor

from ... import go1

SECONDS, STEP = 6, 0.1  # of a walk, and of its loop
PULSES = [0.25, 0.1, 0.4, 0.15, 0.5, 0.05, 0.3, 0.2, 0.45, 0.35]  # m/s
PULSE, REST = 2.0, 1.0  # s, of a pulse, and of the stand before it
RECORDED = Path(__file__).parent.parent / "recordings" / "legs_pulses.csv"
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


def pulses(simulation: go1.Simulation) -> WalkLog:
    """Returns the log of walks straight on from a stand, at ten speeds, the larger not the later.

    Args:
        simulation: of the robot. The rule that stops one that does not follow is switched off.
    """
    with tempfile.TemporaryDirectory() as folder:
        path, address = (
            Path(folder) / "pulses.csv",
            "sim:legs" if simulation.body == "legs" else "sim",
        )
        with go1.connect(address, simulation=simulation, ignore=("motion",), log=path) as robot:
            for speed in PULSES:
                for told, seconds in [(0.0, REST), (speed, PULSE)]:
                    for _ in range(round(seconds / STEP)):
                        robot.move(told, 0.0)
                        robot.wait(STEP)
            end = robot.now()
        rows = torch.tensor(go1.read_log(path), dtype=torch.float64)
    rows = rows[rows[:, 0] < end]
    return WalkLog(rows[:, 0], rows[:, 7], rows[:, 4], rows[:, 19])


def recorded_pulses() -> WalkLog:
    """Returns the log of `pulses` with the dog with legs, which is recorded: it needs MuJoCo."""
    rows = numpy.loadtxt(RECORDED, delimiter=",", skiprows=1)
    return WalkLog(*torch.from_numpy(rows).unbind(-1))
