"""Logs of loops in which one block is at fault.

Do not read on before you have solved exercise 7.4: `FAULTS` is its answer.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from ... import infinity
from ...control import MPC
from ...filters import EKF
from ...splines import local_plan
from ...systems import DubinsCar
from ...utils import ReduceToBason

FAULTS = {"a": "MPC", "b": "sensor", "c": "plan", "d": "filter"}


class Log(NamedTuple):
    """What a loop of 32 cars has recorded, in N steps of 0.1 s each."""

    x: Tensor  # true states [i, j, cos, sin], (32, N+1, 4)
    X: Tensor  # estimates, (32, N, 4)
    P: Tensor  # their covariances, as the filter says, (32, N, 4, 4)
    y: Tensor  # observations, (32, N, 4)
    u: Tensor  # inputs, (32, N, 2)
    target: Tensor  # the plan that the MPC was given, (32, N, 10, 4)


class Shifted(infinity.SimulatedCar):
    """A car whose sensor is mounted wrongly: it says that the car is further along i."""

    shift = 0.1  # m

    def look(self) -> Tensor:
        """Returns an observation of a place beside the car."""
        return super().look() + self.shift * torch.eye(4)[0].to(self.x)


def planner(price: float) -> MPC:
    """Returns the chapter's MPC with a price of the inputs."""
    weights = torch.tensor([1, 1, 0.3, 0.3, price, price], dtype=torch.float64)
    return MPC(DubinsCar(0.1), weights.diag(), None, 10, ReduceToBason(steps=2))


def faulty_logs() -> dict[str, Log]:
    """Returns the logs of the four loops, by their letters."""
    return {letter: loop_log(block) for letter, block in FAULTS.items()}


def loop_log(fault: str = "", cars: int = 32, steps: int = 40) -> Log:
    """Returns the log of a loop.

    Args:
        fault: the block that is at fault; "" is none.
        cars: how many.
        steps: of 0.1 s, so few that no car has finished.
    """
    path = infinity.waypoints(torch.float64)
    wrong_map = torch.tensor([0.94, 0.94, 1, 1], dtype=torch.float64)
    believed = path * wrong_map if fault == "plan" else path
    targets = list[Tensor]()

    def aim(x: Tensor, goal: Tensor) -> Tensor:
        targets.append(local_plan(x, believed, goal, 0.25, count=10))
        return targets[-1]

    trust = 1 / 100 if fault == "filter" else 1
    ekf = EKF(DubinsCar(0.1))

    def estimator(x, y, u, P, Q, R):
        return ekf(x, y, u, P, Q, trust * R)

    kind_of_world = Shifted if fault == "sensor" else infinity.SimulatedCar
    noise = infinity.PROCESS_NOISE, 0.1
    generator = torch.Generator().manual_seed(7)
    world = kind_of_world(DubinsCar(0.1), path[0].expand(cars, 4), *noise, generator)
    mpc = planner(0.01 if fault == "MPC" else 0.001)
    run = infinity.drive(mpc, world, estimator, aim, 0.3, steps)
    assert run.P is not None  # there is an estimator
    return Log(run.x, run.estimate, run.P, run.y, run.u, torch.stack(targets, dim=1))
