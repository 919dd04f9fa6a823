"""The running example: a car traces an infinity sign through 17 waypoints.

Two circles of radius 1 m touch at the origin, centred at (1, 0) and (-1, 0). The path goes
around the first counter-clockwise, then around the second clockwise. States are those of the
Dubins car, ``[i, j, cos, sin]``.

Source: "PyPose v0.6", figures 2 to 4. The paper does not state its noise; ours is fixed below so
that the raw observation's mean position error is the paper's 0.2045 m.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from .control import MPC, shift
from .shapes import check
from .systems import DubinsCar

LENGTH = 4 * math.pi  # m, of the whole path
PROCESS_NOISE = 0.005  # standard deviation of every state component, every step
OBSERVATION_NOISE = 0.163  # standard deviation of every component; its mean length is 0.2045 m
PRIOR = 0.05  # standard deviation of the first estimate, every component
TOLERANCE = 0.1  # m, how near a waypoint counts as reached


def reference(s: Tensor) -> Tensor:
    """Returns the state ``(..., 4)`` on the path after ``s (...)`` metres; s wraps around."""
    s = s % LENGTH
    first = s < LENGTH / 2
    side = torch.where(first, 1.0, -1.0).to(s)  # which circle, and which way around
    angle = torch.where(first, s, s - LENGTH / 2)
    i, j = side * (1 - angle.cos()), -angle.sin()
    return torch.stack([i, j, side * angle.sin(), -angle.cos()], dim=-1)


def waypoints(dtype: torch.dtype | None = None, device=None) -> Tensor:
    """Returns the 17 waypoints ``(17, 4)``, 45 degrees apart; start, middle and end coincide."""
    s = torch.arange(17, dtype=dtype or torch.get_default_dtype(), device=device)
    return reference(s * math.pi / 4)


def tracking_error(x: Tensor) -> Tensor:
    """Returns how far each state ``(..., 4)`` is from the path, in metres ``(...)``."""
    right, left = (torch.hypot(x[..., 0] - c, x[..., 1]) - 1 for c in (1, -1))
    return torch.minimum(right.abs(), left.abs())


def controller(car: DubinsCar | None = None, T: int = 10, dtype: torch.dtype | None = None) -> MPC:
    """Returns the book's MPC: weights 1, 1, 0.3, 0.3 on the state and 0.01, 0.01 on the input."""
    Q = torch.diag(torch.tensor([1, 1, 0.3, 0.3, 0.01, 0.01], dtype=dtype))
    return MPC(car or DubinsCar(), Q, None, T)


class Run(NamedTuple):
    """One lap of N steps, for a car or for a batch of cars."""

    x: Tensor  # true states, (..., N+1, 4); a robot's observations, where it is all we have
    u: Tensor  # inputs, (..., N, 2)
    y: Tensor  # observations, (..., N, 4); y[i] is of x[i]
    estimate: Tensor  # what the controller was told, (..., N, 4)
    P: Tensor | None  # the covariance of the estimate, (..., N, 4, 4)
    goal: Tensor  # index of the waypoint aimed at, (..., N)
    running: Tensor  # whether the car was still on its way, (..., N)
    finished: Tensor  # whether the last waypoint was reached, (...)

    @property
    def steps(self) -> Tensor:
        """How many steps each car took, ``(...)``."""
        return self.running.sum(-1)


class World:
    """What a lap is driven in: where it begins, how noisy it is, and how long a step takes.

    A lap calls ``start``, then in every step ``look`` and ``move``, and at the end ``stop``.

    Args:
        dt: seconds a step takes.
        x_init: where the cars start, ``(..., 4)``; None is the first waypoint.
        process_noise: standard deviation of w, every component; a filter's Q is made of it.
        observation_noise: standard deviation of v, every component; a filter's R is made of it.
        generator: for all that is drawn.
    """

    x: Tensor  # the state now, (..., 4)

    def __init__(self, dt, x_init=None, process_noise=0.0, observation_noise=0.0, generator=None):
        x_init = waypoints()[0] if x_init is None else x_init
        check("x_init: n", x_init, n=4)
        self.dt, self.x_init, self.generator = dt, x_init, generator
        self.process_noise, self.observation_noise = process_noise, observation_noise
        eye = torch.eye(4, dtype=x_init.dtype, device=x_init.device)
        self.Q, self.R = process_noise**2 * eye, observation_noise**2 * eye

    def start(self) -> tuple[Tensor, Tensor]:
        """Puts the cars where they start; returns a first estimate, and its covariance."""
        self.x = self.x_init
        P = PRIOR**2 * torch.eye(4, dtype=self.x.dtype, device=self.x.device)
        return self.x + self.noise(PRIOR), P.expand(*self.x.shape, 4)

    def look(self) -> Tensor:
        """Returns an observation of the state now, ``(..., 4)``."""
        raise NotImplementedError

    def move(self, u: Tensor, running: Tensor) -> Tensor:
        """Moves those that are running one step by inputs ``(..., 2)``; returns the states."""
        raise NotImplementedError

    def stop(self) -> None:
        """Ends the lap, also after an error."""

    def noise(self, size: float) -> Tensor:
        """Returns noise of a standard deviation, for every component of every car."""
        if size == 0:
            return torch.zeros_like(self.x_init)
        like = {"dtype": self.x_init.dtype, "device": self.x_init.device}
        return size * torch.randn(self.x_init.shape, generator=self.generator, **like)


class SimulatedCar(World):
    """A car, or a batch of cars, that move as a model does and are seen with noise.

    Args:
        car: the model, and whose dt counts; None is the ideal car.
        x_init: and the others, as in :class:`World`.
        process_noise: of every step.
        observation_noise: of every look.
        generator: for both, and for the first estimate.
    """

    def __init__(
        self,
        car: DubinsCar | None = None,
        x_init: Tensor | None = None,
        process_noise: float = 0.0,
        observation_noise: float = 0.0,
        generator: torch.Generator | None = None,
    ):
        self.car = DubinsCar() if car is None else car
        super().__init__(self.car.dt, x_init, process_noise, observation_noise, generator)

    def start(self) -> tuple[Tensor, Tensor]:
        """Remembers the clock, and does what :meth:`World.start` does."""
        self.began = self.car.systime
        return super().start()

    def look(self) -> Tensor:
        """Returns an observation of the state now, ``y = x + v``."""
        return self.x + self.noise(self.observation_noise)

    def move(self, u: Tensor, running: Tensor) -> Tensor:
        """Moves the cars that are running one step, ``x' = f(x, u) + w``, and returns x'."""
        moved = self.car(self.x, u)[0] + self.noise(self.process_noise)
        self.x = torch.where(running[..., None], moved, self.x)
        return self.x

    def stop(self) -> None:
        """Puts the car's clock back."""
        self.car.reset(self.began)


class RealRobot(World):
    """A robot in the car's place: it is asked for its pose and sent velocities.

    Args:
        robot: has ``pose() -> (i, j, heading)``, ``move(v, phi)``, ``wait(dt)`` and ``stop()``, as
            ``go1.Robot`` does.
        dt: seconds a step takes.
        x_init: gives dtype and device, and where an estimate begins; None is the first waypoint.
        process_noise: as a filter is to assume it; the robot's own noise is not known.
        observation_noise: likewise.
        generator: for the first estimate.
    """

    def __init__(self, robot, dt: float = 0.1, x_init: Tensor | None = None, **noise):
        super().__init__(dt, x_init, **noise)
        self.robot = robot

    def start(self) -> tuple[Tensor, Tensor]:
        """Asks for the first pose, and does what :meth:`World.start` does."""
        x = self.look()
        estimate = super().start()
        self.x = x
        return estimate

    def look(self) -> Tensor:
        """Returns where the robot says it is, as a state ``(4,)``."""
        i, j, heading = self.robot.pose()
        return self.x_init.new_tensor([i, j, math.cos(heading), math.sin(heading)])

    def move(self, u: Tensor, running: Tensor) -> Tensor:
        """Sends ``[v, phi]``, waits for one time step, and returns where the robot then is."""
        self.robot.move(*u.tolist())
        self.robot.wait(self.dt)
        return self.look()

    def stop(self) -> None:
        """Stops the robot."""
        self.robot.stop()


def drive(
    mpc: Callable,
    world: World | None = None,
    estimator: Callable | None = None,
    aim: Callable | None = None,
    tolerance: float = TOLERANCE,
    steps: int = 200,
    u_lower: Tensor | float | None = None,
    u_upper: Tensor | float | None = None,
) -> Run:
    """Returns one lap through the waypoints, by the paper's loop: look, plan, estimate, move.

        y[i] = g(x[i]) + v                                              (1)
        u[i] = first input of mpc(dt, X[i], target)                     (2)
        X[i+1], P = estimator(X[i], y[i], u[i], P, Q, R)                (3)
        x[i+1] = f(x[i], u[i]) + w                                      (4)

    Without an estimator X[i] is y[i]. A waypoint counts as reached when X[i] is within the
    tolerance, as on a robot, which knows no more. Each car of a batch has its own waypoint.

    Args:
        mpc: called as in the paper, ``xt, u, cost = mpc(dt, x, target)``; an :class:`MPC` also
            gets its last plan, shifted, to start from.
        world: a :class:`SimulatedCar`, a :class:`RealRobot`, or what has their methods; None is
            the ideal car.
        estimator: a filter with PyPose's call (3), or None.
        aim: returns the target from ``X[i] (..., 4)`` and the next waypoint's index ``(...)``;
            None aims at the waypoint itself.
        tolerance: metres.
        steps: how many at most.
        u_lower: lower bound of u, as :meth:`MPC.solve` takes it; a controller of one's own gets
            it as a keyword. None is not passed on.
        u_upper: upper bound of u, likewise.

    The car's clock is put back and the robot is stopped at the end, also after an error.
    """
    if steps < 1:
        raise ValueError(f"steps: expected at least one, got {steps}")
    world = SimulatedCar() if world is None else world
    bounds = {"u_lower": u_lower, "u_upper": u_upper}
    bounds = {name: bound for name, bound in bounds.items() if bound is not None}
    try:
        X, P = world.start()
        path = waypoints(X.dtype, X.device)
        last = len(path) - 1
        goal = torch.ones(X.shape[:-1], dtype=torch.int64, device=X.device)
        warm, xs, log = list[Tensor](), [world.x], list[tuple[Tensor, ...]]()
        for _ in range(steps):
            y = world.look()  # (1)
            X = y if estimator is None else X
            off = (X - path[goal.clamp(max=last)])[..., :2]
            reached = torch.linalg.vector_norm(off, dim=-1) <= tolerance
            goal = goal + (reached & (goal <= last))
            running = goal <= last
            if not running.any():
                break
            ahead = goal.clamp(max=last)
            target = path[ahead] if aim is None else aim(X, ahead)
            plan = mpc(world.dt, X, target, *warm, **bounds)[1]
            warm = [shift(plan)] if isinstance(mpc, MPC) else []
            u = torch.where(running[..., None], plan[..., 0, :], 0)  # (2)
            log.append((u, y, X, P, goal, running))
            if estimator is not None:
                X, P = estimator(X, y, u, P, world.Q, world.R)  # (3)
            xs.append(world.move(u, running))  # (4)
    finally:
        world.stop()
    return _run(xs, log, estimator is not None, ~running)


def _run(xs: list[Tensor], log: list[tuple[Tensor, ...]], estimated: bool, finished) -> Run:
    u, y, X, P, goal, running = (torch.stack(z, dim=len(finished.shape)) for z in zip(*log))
    x = torch.stack(xs, dim=-2)
    return Run(x, u, y, X, P if estimated else None, goal, running, finished)
