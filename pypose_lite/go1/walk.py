"""The walk of the infinity, by the same closed loop that drives the simulated car.

The robot is asked for its pose, the MPC plans along the curve at walking speed, the first motion of
the plan is sent. What is sent now shows in the pose only later: packets take their `delay`, and
legs follow with a `lag`. So the planner has the legs in its model (`systems.Legs`), and begins
where the robot will be when the motion that it plans arrives: with the pose and the speeds that the
robot reports, moved on by what was sent meanwhile. Chapter 9 finds both numbers in a log, and shows
what happens without them. What else `identification` finds in a log (a dead band, a drift, a slide
in turns) is in the model, too.
"""

import contextlib
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .identification import Response
from .log import Row
from .robot import Robot

if TYPE_CHECKING:  # torch and the control code are loaded when a walk begins
    from torch import Tensor

    from ..infinity import Run

START = (0.0, 0.0, -math.pi / 2)  # where the infinity begins, and which way
AREA = (-2.75, 2.75, -1.75, 1.75)  # m: the infinity and 0.75 m around it
LENGTH = 4 * math.pi  # m
FASTEST_TURN = 1.2  # rad/s
STEP = 0.1  # s, of the loop
SLOWEST, LONGEST = 0.02, 3.0  # m/s and s: who plans no more than that for so long is stuck
HEADING = 0.1  # the weight of the heading, beside 1 of the place


def walk(
    robot: Robot,
    speed: float = 0.4,
    delay: float = 0.1,
    lag: float = 0.15,
    report: Callable[[int], None] = lambda waypoint: None,
    *,
    response: Response | None = None,
    tolerance: float = 0.1,
) -> "Run":
    """Walks once around the infinity, and returns the run as the robot itself saw it.

    Args:
        robot: stands where the curve begins (`connect(start=START)`); where it was given no
            area, it is kept in `AREA`.
        speed: m/s, along the curve, and never faster.
        delay: s, from a motion sent to a pose that knows of it, there and back.
        lag: s, the time constant with which the legs follow.
        report: told the number of the next waypoint, 1 to 16, in every step.
        response: of the robot to commands, from its log (`identify`); its delay and lag then
            count, and it is never asked for a speed in its dead band.
        tolerance: m, how near a waypoint counts as reached.

    Raises:
        RobotTimeout: the robot fell silent.
        RobotStopped: a safety rule has stopped it.
        Stuck: the plan is to stand, and it is not there yet.
    """
    import torch

    from .. import infinity

    response = Response(delay, (lag, lag)) if response is None else response
    slowest = response.dead_band[0]
    if not slowest < speed:
        raise ValueError(f"speed: expected more than the dead band, {slowest:g} m/s, got {speed!r}")
    guide = Guide(robot, speed, response, report)
    with torch.no_grad(), _fenced(robot):
        return infinity.drive(
            guide,
            infinity.RealRobot(robot, STEP),
            aim=guide.aim,
            tolerance=tolerance,
            steps=math.ceil(3 * LENGTH / (speed * STEP)),
            u_lower=torch.tensor([slowest, -FASTEST_TURN]),
            u_upper=torch.tensor([speed, FASTEST_TURN]),
        )


@contextlib.contextmanager
def _fenced(robot: Robot) -> Iterator[None]:
    """Keeps a robot that has no area of its own in that of the infinity, for a walk."""
    watcher = robot.pilot.watcher
    before, watcher.area = watcher.area, watcher.area or AREA
    try:
        yield
    finally:
        watcher.area = before


class Stuck(RuntimeError):
    """The robot has passed a waypoint by too far, and its planner knows no way back."""


class Guide:
    """What `infinity.drive` asks for where to aim, and then for a plan.

    Args:
        robot: which says how fast it is.
        speed: as of `walk`.
        response: of the robot to commands.
        report: told the next waypoint.
    """

    def __init__(
        self, robot: Robot, speed: float, response: Response, report: Callable[[int], None]
    ) -> None:
        import torch

        from .. import control, infinity, utils

        self._robot, self._report = robot, report
        self._spacing = STEP * speed
        self._axle, self._slowest = response.axle, response.dead_band[0] + SLOWEST
        weights = torch.diag(torch.tensor([1, 1, HEADING, HEADING, 0, 0, 0.01, 0.01]))
        steps = utils.ReduceToBason(steps=2)  # a plan that starts from the last one is soon good
        self._mpc = control.MPC(response.model(STEP), weights, None, 10, steps)
        self._path, self._late = infinity.waypoints(), round(response.delay / STEP)
        self._sent: list[Tensor] = []
        self._plan = torch.zeros(self._mpc.T, 2)
        self._resting = 0  # plans in a row

    def aim(self, x: "Tensor", waypoint: "Tensor") -> "Tensor":
        """The states to follow, from where the robot will be when the next motion arrives."""
        import torch

        from ..splines import local_plan

        self._robot.target = int(waypoint)
        self._report(int(waypoint))
        state = self._robot.state
        self._from = torch.cat([x, x.new_tensor([state.velocity[0], state.yaw_speed])])
        for sent in self._sent[len(self._sent) - self._late :]:  # on their way
            self._from = self._mpc.system.state_transition(self._from, sent)
        ahead = local_plan(self._from[:4], self._path, waypoint, self._spacing, self._mpc.T)
        return torch.cat([self._looking(ahead), torch.zeros(self._mpc.T, 2)], dim=-1)

    def _looking(self, ahead: "Tensor") -> "Tensor":
        """The states to follow (T, 4), each with the heading of a body that slides in turns.

        On a curve that bends by kappa = dtheta/ds a body moves to the left of where it looks by the
        angle beta, so that it has to look so much to the right of the way:

            tan(beta) = axle w / v = axle kappa      (1)
        """
        import torch

        i, j, c, s = ahead.unbind(-1)
        bends = torch.asin(c[:-1] * s[1:] - s[:-1] * c[1:]) / self._spacing
        beta = torch.atan(self._axle * torch.cat([bends, bends[-1:]]))  # (1)
        theta = torch.atan2(s, c) - beta
        return torch.stack([i, j, theta.cos(), theta.sin()], dim=-1)

    def __call__(self, dt: float, x: "Tensor", target: "Tensor", **bounds: Any) -> tuple:
        """The plan that follows the target: states, inputs and cost."""
        from ..control import shift

        plan = self._mpc(dt, self._from, target, shift(self._plan), **bounds)
        self._plan = plan[1]
        self._sent.append(self._plan[0])
        self._resting = self._resting + 1 if self._plan[0, 0] < self._slowest else 0
        if self._resting > LONGEST / STEP:
            raise Stuck(
                "it is stuck: a waypoint was passed by too far. Walk slower, or mend --delay"
            )
        return plan


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
