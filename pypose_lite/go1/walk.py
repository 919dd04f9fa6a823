"""The walk of the infinity, by the same closed loop that drives the simulated car.

The robot is asked for its pose, the MPC plans along the curve at walking speed, the first motion of
the plan is sent. What is sent now shows in the pose only later (network, legs, sensors), so the
MPC is told where the robot will be by then: the pose, rolled forward by what was sent meanwhile.
Chapter 9 shows what happens without that.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .log import Row
from .robot import Robot

if TYPE_CHECKING:  # torch and the control code are loaded when a walk begins
    from torch import Tensor

    from ..infinity import Run

START = (0.0, 0.0, -math.pi / 2)  # where the infinity begins, and which way
FASTEST_TURN = 1.2  # rad/s
STEP = 0.1  # s, of the loop
SLOWEST, LONGEST = 0.02, 3.0  # m/s and s: who plans no more than that for so long is stuck


def walk(
    robot: Robot,
    speed: float = 0.4,
    delay: float = 0.2,
    report: Callable[[int], None] = lambda waypoint: None,
) -> "Run":
    """Walks once around the infinity, and returns the run as the robot itself saw it.

    Args:
        robot: stands where the curve begins (`connect(start=START)`).
        speed: m/s, along the curve.
        delay: s, from a motion sent to a pose that shows it: network, lag and loop.
        report: told the number of the next waypoint, 1 to 16, in every step.

    Raises:
        RobotTimeout: the robot fell silent.
        Stuck: the plan is to stand, and it is not there yet.
    """
    import torch

    from .. import infinity
    from ..splines import local_plan
    from ..systems import DubinsCar
    from ..utils import ReduceToBason

    car = DubinsCar(dt=STEP)
    path, mpc = infinity.waypoints(), infinity.controller(car)
    mpc.stepper = ReduceToBason(steps=2)  # a plan that starts from the last one is soon good
    spacing = speed * STEP

    def aim(x: "Tensor", waypoint: "Tensor") -> "Tensor":
        report(int(waypoint))
        return local_plan(x, path, waypoint, spacing, mpc.T + 1)[..., 1:, :]

    mpc.register_forward_hook(Patience())
    fastest = torch.tensor([1.25 * speed, FASTEST_TURN], dtype=path.dtype)
    with torch.no_grad():
        return infinity.drive(
            mpc,
            infinity.RealRobot(robot, STEP),
            estimator=Ahead(car, 1 + round(delay / STEP)),
            aim=aim,
            steps=math.ceil(3 * infinity.LENGTH / spacing),
            u_lower=fastest * torch.tensor([0.0, -1.0]),
            u_upper=fastest,
        )


class Stuck(RuntimeError):
    """The robot has passed a waypoint by too far, and its planner knows no way back."""


class Ahead:
    """Where a car will be when what is sent now shows: an estimator for `infinity.drive`.

    Args:
        car: the system that moves.
        steps: how many inputs are on their way, the present one among them, 1 or more.
    """

    def __init__(self, car: Any, steps: int) -> None:
        self._car, self._steps, self._sent = car, steps, list[Any]()

    def __call__(self, x: Any, y: Any, u: Any, P: Any, Q: Any, R: Any) -> tuple[Any, Any]:
        """The observation y, rolled forward by the inputs on their way; P as it is."""
        self._sent = [*self._sent, u][-self._steps :]
        for sent in self._sent:
            y = self._car.state_transition(y, sent)
        return y, P


class Patience:
    """A hook of an MPC: raises Stuck when every plan of the last seconds was to rest."""

    def __init__(self) -> None:
        self._resting = 0  # plans in a row

    def __call__(self, mpc: Any, asked: tuple, plan: tuple) -> None:
        """Sees the plan's states, inputs and cost."""
        self._resting = self._resting + 1 if plan[1][0, 0] < SLOWEST else 0
        if self._resting > LONGEST / STEP:
            raise Stuck(
                "it is stuck: a waypoint was passed by too far. Walk slower, or mend --delay"
            )


def draw(rows: list[Row], path: str | Path) -> None:
    """Draws a recorded walk: blue connected poses every 0.1 s, red targets; needs matplotlib.

    Source: "PyPose v0.6", the figure of the trajectory recorded on the robot.
    """
    from matplotlib.figure import Figure

    from .. import infinity

    targets, seen = infinity.waypoints(), rows[::5]
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    ax = figure.add_subplot()
    ax.plot([row.x for row in seen], [row.y for row in seen], ".-b", lw=0.8, ms=4, label="pose")
    ax.plot(targets[:, 0], targets[:, 1], "or", ms=7, mfc="none", label="target")
    ax.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    ax.legend(loc="upper center")
    figure.savefig(path, dpi=120)
