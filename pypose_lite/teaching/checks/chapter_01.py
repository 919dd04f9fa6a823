"""What the answers of lab 1 must do: headings, a bicycle, a clock."""

import math

import torch

from . import expect
from .exercise import Exercise
from .student import Answer

TURN = 2 * math.pi

heading_error = Exercise(
    "1.1", "The shorter way around", minutes=5, takes="theta, theta_ref", points=1
)


def headings(given, *shape):
    """Two headings, each on any lap, and by how much the first lies to the left of the second."""
    apart, reference = given.uniform(-3.1, 3.1, *shape), given.uniform(-9, 9, *shape)
    laps = given.uniform(-3, 3, *shape).round()
    return reference + apart + TURN * laps, reference, apart


@heading_error.must("return theta - theta_ref where neither heading is close to the jump")
def plain_difference(answer, given):
    theta, reference = given.uniform(-1, 1, 20), given.uniform(-1, 1, 20)
    apart = theta - reference
    mistakes = {
        "The sign is the other way round: theta - theta_ref.": -apart,
        "A turn to the right has to be negative.": apart.abs(),
        "A turn to the right has to be negative, not almost a full turn to the left.": apart % TURN,
        "Radians are wanted, not degrees.": apart.rad2deg(),
        "The sine of the angle is not the angle.": apart.sin(),
    }
    expect.close("the error", answer(theta, reference), apart, "", mistakes)


@heading_error.must("take the shorter way, between -pi and pi, for headings on any lap")
def shorter_way(answer, given):
    theta, reference, apart = headings(given, 30)
    once = theta - reference
    once = torch.where(once > math.pi, once - TURN, once)
    once = torch.where(once < -math.pi, once + TURN, once)
    mistakes = {
        "Full turns do not change a heading: take them off.": theta - reference,
        "One full turn was taken off, and there may be several.": once,
        "fmod keeps the sign of its argument: the results lie between -2 pi and 2 pi.": torch.fmod(
            theta - reference, TURN
        ),
    }
    hint = "The angle of the vector [cos(difference), sin(difference)] lies between -pi and pi."
    expect.close("the error", answer(theta, reference), apart, hint, mistakes)


@heading_error.must("work on single numbers and on batches of any shape")
def any_shape(answer, given):
    for shape in [(), (4,), (2, 3)]:
        theta, reference, apart = headings(given, *shape)
        expect.close("the error", answer(theta, reference), apart)


bicycle = Exercise("1.2", "A bicycle", minutes=10, takes="dt, wheelbase", points=2)


def bicycle_step(x, u, dt, wheelbase):
    """Returns the next state by way of the circle on which a bicycle drives."""
    i, j, theta, v = x.unbind(-1)
    a, delta = u.unbind(-1)
    radius = wheelbase / torch.tan(delta)
    place = torch.complex(i, j) + dt * v * torch.exp(1j * theta)
    return torch.stack([place.real, place.imag, theta + dt * v / radius, v + dt * a], -1)


def ride(given, *batch):
    """Some state and input."""
    x, u = given.randn(*batch, 4), given.uniform(-0.6, 0.6, *batch, 2)
    return x, u, 0.2, 0.4


def transition(answer, dt, wheelbase):
    """The student's transition, called as carefully as any function."""
    system = answer(dt, wheelbase)
    method = getattr(system, "state_transition", None)
    expect.that(callable(method), "a class with state_transition", expect.kind(system))
    return Answer(method)


@bicycle.must("return the next state, of shape (4,)")
def four_numbers(answer, given):
    x, u, dt, wheelbase = ride(given)
    expect.tensor("the state", transition(answer, dt, wheelbase)(x, u), (4,))


@bicycle.must("drive at the old speed, along the old heading")
def position(answer, given):
    x, u, dt, wheelbase = ride(given)
    right = bicycle_step(x, u, dt, wheelbase)
    i, j, theta, v = x
    c, s = right[2].cos(), right[2].sin()
    way = dt * torch.stack([theta.cos(), theta.sin()])
    mistakes = {
        "The heading on the right of an equation is the old one.": x[:2]
        + dt * v * torch.stack([c, s]),
        "The speed on the right of an equation is the old one.": x[:2] + right[3] * way,
        "Cosine belongs to i, sine to j.": x[:2] + v * way.flip(0),
        "A rate is multiplied by dt.": x[:2] + v * way / dt,
        "The speed is missing.": x[:2] + way,
        "The front wheel has the angle theta + delta; this model follows the rear wheel.": x[:2]
        + dt * v * torch.stack([(theta + u[1]).cos(), (theta + u[1]).sin()]),
    }
    came = expect.tensor("the state", transition(answer, dt, wheelbase)(x, u), (4,))
    expect.close("[i, j]", came[:2], right[:2], "", mistakes)


@bicycle.must("turn by v tan(delta) / wheelbase in a second")
def heading(answer, given):
    x, u, dt, wheelbase = ride(given)
    right, (v, theta), delta = bicycle_step(x, u, dt, wheelbase)[2], (x[3], x[2]), u[1]
    rate = v * delta.tan()
    mistakes = {
        "delta is an angle: its tangent is wanted.": theta + dt * v * delta / wheelbase,
        "The wheelbase divides: a long bicycle turns slowly.": theta + dt * rate * wheelbase,
        "The wheelbase is missing.": theta + dt * rate,
        "A rate is multiplied by dt.": theta + rate / wheelbase,
        "The speed is missing: a bicycle that stands does not turn.": theta
        + dt * delta.tan() / wheelbase,
        "delta is an angle, not a turn rate.": theta + dt * delta,
        "The sign: a positive delta turns to the left.": 2 * theta - right,
        "The speed on the right of an equation is the old one.": theta
        + dt * (v + dt * u[0]) * delta.tan() / wheelbase,
    }
    came = expect.tensor("the state", transition(answer, dt, wheelbase)(x, u), (4,))
    expect.close("theta", came[2], right, "", mistakes)


@bicycle.must("speed up by a in a second")
def speed(answer, given):
    x, u, dt, wheelbase = ride(given)
    mistakes = {
        "A rate is multiplied by dt.": x[3] + u[0],
        "a changes the speed; it is not the speed.": u[0],
        "The speed is a part of the state, and changes.": x[3],
    }
    came = expect.tensor("the state", transition(answer, dt, wheelbase)(x, u), (4,))
    expect.close("v", came[3], x[3] + dt * u[0], "", mistakes)


@bicycle.must("move a batch of states as it moves each of them")
def batches(answer, given):
    x, u, dt, wheelbase = ride(given, 5)
    hint = "`x.unbind(-1)` and `torch.stack([...], dim=-1)` leave the other dimensions alone."
    expect.batched(transition(answer, dt, wheelbase), x, u, hint=hint)


@bicycle.must("be differentiable with respect to the state")
def differentiable(answer, given):
    x, u, dt, wheelbase = ride(given)
    step, weights = transition(answer, dt, wheelbase), given.randn(4)
    expect.gradient(lambda x: (weights * step(x, u)).sum(), x, "the next state")


clock = Exercise("1.3", "The clock that ticks too often", minutes=10, takes="f, g", points=2)


def moves(x, u, t):
    """A system in which the time counts."""
    return x + 10 * u + 100 * t


def sees(x, u, t):
    """What its sensor sees."""
    return x - 1000 * t


def built(answer):
    """A system of the student's, with f and g from above."""
    system = answer(moves, sees)
    missing = [name for name in ("__call__", "predict", "t") if not hasattr(system, name)]
    wanted = "a class with __call__, predict and the clock t"
    expect.that(not missing, wanted, f"{expect.kind(system)} without {', '.join(missing)}")
    return system


def stepped(system):
    """The state and the observation after one step from x = 1 with u = 2."""
    return expect.parts(system(1.0, 2.0), "x_next", "y")


@clock.must("begin at time 0: the first step is f(x, u, 0)")
def begins_at_zero(answer, given):
    x_next, _ = stepped(built(answer))
    mistakes = {"The clock has ticked before f was called: this is f(x, u, 1).": 121.0}
    expect.close("x_next", x_next, 21.0, "", mistakes)


@clock.must("give each system a clock of its own")
def own_clock(answer, given):
    first, second = built(answer), built(answer)
    stepped(first)
    hint = "The clock belongs to self, not to the class or to a global variable."
    expect.close("the other one's x_next", stepped(second)[0], 21.0, hint)


@clock.must("observe the state and the time before the step: y = g(x, u, t)")
def observes_before(answer, given):
    system = built(answer)
    mistakes = {
        "y belongs to x, and this is x_next's.": 21.0,
        "The clock has ticked before g was called.": 1.0 - 1000,
        "This is x_next's, at the next time.": 21.0 - 1000,
    }
    expect.close("y", stepped(system)[1], 1.0, "", mistakes)


@clock.must("answer predict(x, u) without a step: the clock stays")
def predicts(answer, given):
    system = built(answer)
    for k in range(3):
        for _ in range(2):
            hint = "predict asks `what if?`. Call f, not the system."
            came = system.predict(1.0, 2.0)
            expect.close(f"predict at time {k}", came, 21.0 + 100 * k, hint)
        stepped(system)


@clock.must("tick once in each step")
def ticks(answer, given):
    system = built(answer)
    for k in range(4):
        expect.close(f"t after {k} steps", system.t, float(k), "It counts calls of the system.")
        x_next, _ = stepped(system)
        expect.close(f"x_next of step {k}", x_next, 21.0 + 100 * k)
