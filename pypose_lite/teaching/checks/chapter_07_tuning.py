"""What the answers of lab 7 must do: tuning, differentiating, walking and buying a loop."""

import math

import torch

from ... import go1, infinity
from ...control import MPC
from ...filters import EKF
from ...splines import local_plan
from ...systems import DubinsCar
from ...utils import ReduceToBason
from . import expect
from .exercise import Exercise, Failure
from .words import kind


def weighed(price):
    """The chapter's weights, with a price of both inputs that may carry a gradient."""
    price = torch.as_tensor(price, dtype=torch.float64)
    return torch.cat([torch.tensor([1, 1, 0.3, 0.3]), price.expand(2)]).diag()


def along(spacing):
    """An aim: the local plan with a spacing."""
    return lambda x, goal: local_plan(x, infinity.waypoints(), goal, spacing, count=10)


def driven(aim, price, noise, seed, cars=32, tolerance=0.3, steps=70, used=True):
    """A lap of the chapter's loop."""
    car = DubinsCar(0.1)
    generator = torch.Generator().manual_seed(seed)
    start = infinity.waypoints()[0].expand(cars, 4)
    world = infinity.SimulatedCar(car, start, infinity.PROCESS_NOISE, noise, generator)
    mpc = MPC(car, weighed(price), None, 10, ReduceToBason(steps=2))
    return infinity.drive(mpc, world, EKF(car) if used else None, aim, tolerance, steps)


def mean_distance(run):
    """The mean distance from the circles of all cars on their way, m."""
    return infinity.tracking_error(run.x[:, :-1])[run.running].mean().item()


def two_settings(answer):
    """Spacing and price, as numbers within reason."""
    numbers = answer.tolist() if isinstance(answer, torch.Tensor) else answer
    spacing, price = expect.parts(numbers, "spacing", "price")
    spacing = expect.tensor("the spacing", spacing, ()).item()
    price = expect.tensor("the price", price, ()).item()
    fits = 0.02 <= spacing <= 1 and 1e-6 <= price <= 1
    hint = "First the spacing in metres, then the price; both are positive."
    expect.that(fits, "0.02 to 1 m, and a price of 1e-6 to 1", f"{spacing:g} and {price:g}", hint)
    return spacing, price


faster = Exercise("7.5", "Faster, and as close", minutes=15, points=2, seconds=60)


@faster.must("be two numbers, a spacing and a price")
def spacing_and_price(answer, given):
    two_settings(answer)


@faster.must("bring all cars around in 40 steps on average, within 0.028 m of the circles")
def fast_and_close(answer, given):
    spacing, price = two_settings(answer)
    seed = int(given.uniform(10, 1000, 1))
    run = driven(along(spacing), price, 0.05, seed, steps=60)
    there = int(run.finished.sum())
    hint = "Some cars lose their plan: it is too fast, or the inputs are too dear."
    expect.that(there == 32, "32 of 32 cars to arrive", f"{there}", hint)
    steps = run.steps.double().mean().item()
    hint = "A slower car is always closer. The spacing sets the pace."
    expect.that(steps <= 40, "40 steps at most", f"{steps:.1f}", hint)
    error = mean_distance(run)
    hint = "It is fast enough. Does the car lag behind its plan, and cut the curve? Make u cheaper."
    if price < 0.0015:
        hint = "The inputs are cheap enough. Is the car faster than it has to be?"
    expect.that(error < 0.028, "a mean distance below 0.028 m", f"{error:.4f} m", hint)


gradient = Exercise(
    "7.6", "A gradient around the loop", 25, takes="log_price", points=3, seconds=120
)


def reference_loss(log_price, cars=8, power=2):
    """The loss by the library's loop; ``power`` 1 is the mean distance instead."""
    car = DubinsCar(0.1)
    generator = torch.Generator().manual_seed(0)
    start = infinity.waypoints()[0].expand(cars, 4)
    noise = infinity.PROCESS_NOISE, infinity.OBSERVATION_NOISE
    world = infinity.SimulatedCar(car, start, *noise, generator)
    mpc = MPC(car, weighed(log_price.exp()), None, 10)
    run = infinity.drive(mpc, world, EKF(car), along(0.25), 0.3, steps=12)
    return infinity.tracking_error(run.x).pow(power).mean().pow(1 / power)


@gradient.must("return the root mean square of the distances, for a price of exp(log_price)")
def value_of_loss(answer, given):
    log_price = given.uniform(-6, -4.8, 1)[0]
    came = expect.tensor("the loss", answer(log_price), ())
    want = reference_loss(log_price).detach()
    mistakes = {
        "This is the mean distance; take the root of the mean of squares.": reference_loss(
            log_price, power=1
        ).detach(),
        "This is the mean square: take its root.": want**2,
    }
    hint = "8 cars, 12 steps, the plan `ahead`, tolerance 0.3, generator with seed 0, states run.x."
    expect.close("the loss", came, want, hint, mistakes, tolerance=1e-4)


@gradient.must("have the gradient that differences of the loss show")
def slope_of_loss(answer, given):
    log_price = given.uniform(-5.5, -4.8, 1)[0].requires_grad_()
    value = answer(log_price)
    hint = "`torch.tensor([..., price])` cuts the graph; `torch.cat` and `torch.stack` keep it."
    if not (isinstance(value, torch.Tensor) and value.requires_grad):
        raise Failure("a loss with a gradient", "one without", hint)
    (slope,) = torch.autograd.grad(value, log_price, allow_unused=True)
    if slope is None:
        raise Failure("a loss that depends on log_price", "one that does not", hint)
    step = 1e-3
    with torch.no_grad():
        ends = [reference_loss(log_price + sign * step) for sign in (1, -1)]
    want = ((ends[0] - ends[1]) / (2 * step)).item()
    hint = "A part of the loop is cut out of the graph, or its plans end too early."
    expect.that(
        math.isclose(slope.item(), want, rel_tol=0.01), f"{want:.5f}", f"{slope.item():.5f}", hint
    )


dog = Exercise("7.7", "The dog's legs answer late", minutes=15, points=2, seconds=120)


@dog.must("be two numbers, a spacing and a price")
def dog_settings(answer, given):
    two_settings(answer)


@dog.must("bring the dog around within 13 s, 0.03 m from the path on average")
def dog_walked(answer, given):
    spacing, price = two_settings(answer)
    trot = torch.tensor([1.2, 1.5])
    mpc = MPC(DubinsCar(0.1), weighed(price), None, 10, ReduceToBason(steps=2))
    believed = {"process_noise": 0.02, "observation_noise": 0.02}
    believed["generator"] = torch.Generator().manual_seed(0)
    with go1.connect("sim", start=(0.0, 0.0, -math.pi / 2)) as robot:
        world = infinity.RealRobot(robot, 0.1, **believed)
        ekf, aim = EKF(DubinsCar(0.1)), along(spacing)
        walk = infinity.drive(mpc, world, ekf, aim, 0.3, 131, -trot, trot)
    reached = int(walk.goal.max()) - 1 + int(walk.finished)
    hint = "It is too slow: a step of the plan, in 0.1 s, may be longer."
    if spacing > 0.12:
        hint = "Its trot reaches 1.2 m/s: from which spacing on does the plan run away?"
    expect.that(walk.finished, "all 16 waypoints within 13 s", f"{reached} of them", hint)
    error = infinity.tracking_error(walk.x).mean().item()
    hint = "It is fast enough. What does a planner do that thinks that inputs are free?"
    if price > 0.005:
        hint = "Is the plan faster than the dog can be in a curve? Or are the inputs too dear?"
    expect.that(error < 0.03, "a mean distance below 0.03 m", f"{error:.4f} m", hint)


budget = Exercise("7.8", "Ten points to spend", minutes=10, points=2, seconds=60)
SENSORS = {0.25: 0, 0.163: 2, 0.08: 5, 0.02: 8}  # noise (m), and what it costs
FILTER, PLAN, POINTS = 3, 2, 10


@budget.must("say which sensor it buys, and whether a filter and a plan")
def bought(answer, given):
    wanted = '{"sensor": 0.163, "filter": True, "plan": False} or the like'
    if not isinstance(answer, dict) or set(answer) != {"sensor", "filter", "plan"}:
        raise Failure(wanted, kind(answer), "A dictionary with these three words.")
    if answer["sensor"] not in SENSORS:
        raise Failure(f"one of the sensors {[*SENSORS]}", repr(answer["sensor"]))
    for name in ("filter", "plan"):
        if not isinstance(answer[name], bool):
            raise Failure(f"True or False for the {name}", repr(answer[name]))


@budget.must("cost 10 points at most")
def affordable(answer, given):
    cost = SENSORS[answer["sensor"]] + FILTER * answer["filter"] + PLAN * answer["plan"]
    expect.that(cost <= POINTS, "10 points at most", f"{cost}", "Leave something out.")


@budget.must("bring all cars around, within 0.018 m of the circles on average")
def well_spent(answer, given):
    aim, price = (along(0.25), 0.001) if answer["plan"] else (None, 0.02)
    seed = int(given.uniform(10, 1000, 1))
    run = driven(aim, price, answer["sensor"], seed, 32, 0.2, used=answer["filter"])
    there = int(run.finished.sum())
    hint = "With this sensor, what does the car need first?"
    expect.that(there == 32, "32 of 32 cars to arrive", f"{there}", hint)
    error = mean_distance(run)
    hint = "Which part of the error is the largest here: control, or estimation?"
    if answer["sensor"] == 0.02:
        hint = "With this sensor, estimation is a small part. What reduces the other one?"
    expect.that(error < 0.018, "a mean distance below 0.018 m", f"{error:.4f} m", hint)
