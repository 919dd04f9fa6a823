"""What the answers of lab 1 must do: Jacobians, a lap, a pendulum."""

import math

import torch

from ... import infinity
from ...systems import DubinsCar, Pendulum
from . import expect
from .chapter_01 import bicycle_step, ride
from .exercise import Exercise

jacobians = Exercise("1.4", "Jacobians by hand", minutes=15, takes="x, u, dt, wheelbase", points=3)


def by_differences(function, z):
    """Returns the Jacobian by central differences, column by column."""
    steps = 1e-6 * torch.eye(len(z))
    return torch.stack([(function(z + h) - function(z - h)) / 2e-6 for h in steps], dim=-1)


@jacobians.must("return A of shape (4, 4) and B of shape (4, 2)")
def jacobian_shapes(answer, given):
    A, B = expect.parts(answer(*ride(given)), "A", "B")
    expect.tensor("A", A, (4, 4))
    expect.tensor("B", B, (4, 2))


@jacobians.must("return the A whose columns are the derivatives with respect to i, j, theta, v")
def state_jacobian(answer, given):
    x, u, dt, wheelbase = ride(given)
    A = by_differences(lambda z: bicycle_step(z, u, dt, wheelbase), x)
    signs = A.clone()
    signs[:2, 2] *= -1
    no_turn = A.clone()
    no_turn[2, 3] = 0
    mistakes = {
        "A is transposed: a row for each number of the next state.": A.mT,
        "The old state is missing: its derivative is the identity.": A - torch.eye(4),
        "The rates are multiplied by dt.": torch.eye(4) + (A - torch.eye(4)) / dt,
        "The derivative of the cosine is minus the sine.": signs,
        "theta depends on v, too.": no_turn,
    }
    came = expect.parts(answer(x, u, dt, wheelbase), "A", "B")[0]
    hint = "Compare with `torch.func.jacfwd` of the transition, entry by entry."
    expect.close("A", came, A, hint, mistakes, tolerance=1e-5)


@jacobians.must("return the B whose columns are the derivatives with respect to a, delta")
def input_jacobian(answer, given):
    x, u, dt, wheelbase = ride(given)
    B = by_differences(lambda z: bicycle_step(x, z, dt, wheelbase), u)
    plain, cosine = B.clone(), B.clone()
    plain[2, 1] *= u[1].cos() ** 2
    cosine[2, 1] *= u[1].cos()
    mistakes = {
        "The derivative of tan(delta) is 1 / cos(delta)^2.": plain,
        "The cosine in the derivative of tan(delta) is squared.": cosine,
        "The columns have changed places: a first, then delta.": B.flip(1),
        "The rates are multiplied by dt.": B / dt,
    }
    came = expect.parts(answer(x, u, dt, wheelbase), "A", "B")[1]
    hint = "Only v depends on a, and only theta depends on delta."
    expect.close("B", came, B, hint, mistakes, tolerance=1e-5)


verification = Exercise(
    "1.5", "A test for Jacobians", minutes=15, takes="f, A, x", random=True, points=3
)


def smooth(given, rows, columns, scale=1.0):
    """Returns a smooth function, a point, and the Jacobian there by the chain rule."""
    W, V, x = given.randn(rows, 5), given.randn(5, columns), given.randn(columns)
    A = scale * W @ torch.diag(1 - torch.tanh(V @ x) ** 2) @ V
    return lambda x: scale * W @ torch.tanh(V @ x), A, x


def verdict_is(answer, f, A, x, right, hint, case):
    """Sees to what the test says of a matrix."""
    came = answer(f, A, x)
    is_bool = isinstance(came, bool) or (hasattr(came, "dtype") and came.shape == ())
    expect.that(is_bool and came in (0, 1), "True or False", expect.kind(came))
    expect.that(bool(came) is right, f"{right} for {case}", f"{bool(came)}", hint)


@verification.must("say True of the right Jacobian")
def accepts(answer, given):
    for case, sizes in {
        "a right Jacobian": (3, 3, 1.0),
        "a right one with two rows and four columns": (2, 4, 1.0),
        "a right one of a function with values in the thousands": (3, 3, 3000.0),
        "a right one of a function with tiny values": (3, 3, 0.01),
    }.items():
        hint = "The linear model is not exact. How large may its error be, and for which dx?"
        f, A, x = smooth(given, *sizes)
        verdict_is(answer, f, A, x, True, hint, case)


@verification.must("say False of a matrix with one wrong entry, whichever it is")
def refuses_each_entry(answer, given):
    f, A, x = smooth(given, 3, 3)
    for row in range(3):
        for column in range(3):
            for error in (0.1, -0.1):
                wrong = A.clone()
                wrong[row, column] += error
                case = f"A with {error:+} in row {row}, column {column}"
                hint = f"Does a direction that you try change x[{column}]? Is each row looked at?"
                verdict_is(answer, f, wrong, x, False, hint, case)


@verification.must("say False of the transpose, and of zero")
def refuses_others(answer, given):
    f, A, x = smooth(given, 3, 3)
    verdict_is(answer, f, A.mT, x, False, "Columns belong to x, rows to f.", "the transpose")
    verdict_is(answer, f, 0 * A, x, False, "For a small dx, f changes by A dx.", "zeros")


lap = Exercise("1.6", "A lap without an error", minutes=15, points=3)


@lap.must("be a tensor of 128 inputs [v, phi]")
def lap_shape(answer, given):
    expect.tensor("the inputs", answer, (128, 2))


@lap.must("take the slipping car to waypoint k in step 8k, to within 20 cm")
def in_time(answer, given):
    apart = (slipping_lap(answer)[::8, :2] - infinity.waypoints()[:, :2]).norm(dim=-1)
    k = int(apart.argmax())
    expect.that(
        apart[k] < 0.2,
        "at most 0.2 m at each waypoint",
        f"{apart[k]:.3f} m at waypoint {k}",
        "Does each turn rate make up for the 5 % that the wheels lose?",
    )


@lap.must("keep the slipping car within 0.1 mm of the circles at all its steps")
def on_the_circles(answer, given):
    error = infinity.tracking_error(slipping_lap(answer))
    k = int(error.argmax())
    hints = {
        True: "A step of the circle is a chord, which is shorter than its arc: 2 sin(angle / 2).",
        False: "The first chord leaves the tangent by half of the angle between two chords.",
    }
    came = f"{1000 * error[k]:.3f} mm in step {k}"
    expect.that(error[k] < 1e-4, "at most 0.1 mm", came, hints[bool(error[k] < 2e-3)])


def slipping_lap(inputs):
    """The states of the car with 5 % slip that is given these inputs."""
    car, states = DubinsCar(0.1, slip=0.05), [infinity.waypoints()[0].double()]
    for u in expect.tensor("the inputs", inputs, (128, 2)):
        states.append(car.transition(states[-1], u))
    return torch.stack(states)


length = Exercise(
    "1.7", "Learn the length of a pendulum", minutes=20, takes="states, dt", seconds=60, points=3
)


def recording(given, rod, dt):
    """States of a swinging pendulum, seen with noise."""
    pendulum, states = Pendulum(dt, length=rod), [torch.tensor([2.0, 0.0])]
    for _ in range(150):
        states.append(pendulum.transition(states[-1], torch.zeros(1)))
    return torch.stack(states) + 0.002 * given.randn(151, 2)


@length.must("return one positive number")
def one_number(answer, given):
    came = expect.tensor("the length", answer(recording(given, 1.1, 0.05), 0.05), ())
    hint = "Learn the logarithm of the length: its exponential is positive."
    expect.that(came > 0, "a positive length", expect.kind(float(came)), hint)


@length.must("find the length, to within 3 %, whatever it is and whatever dt is")
def finds(answer, given):
    for rod, dt in [(0.6, 0.05), (1.5, 0.05), (1.2, 0.02)]:
        mistakes = {
            "This is a first guess that has not moved: is the gradient used?": 1.0,
            "This is 1 / length: what you learned is its inverse.": 1 / rod,
            "This is the logarithm of the length: return its exponential.": math.log(rod),
        }
        hint = "Plot the loss: does it fall, and has it come to rest? Try smaller or more steps."
        came = answer(recording(given, rod, dt), dt)
        expect.close("the length", came, rod, hint, mistakes, tolerance=0.03)
