"""Answers to lab 1, as students give them: headings, a bicycle, a clock."""

import math

import torch
from graders import right, wrong

import pypose_lite as pp

# --- 1.1


@right("1.1")
def by_atan2(theta, theta_ref):
    return torch.atan2((theta - theta_ref).sin(), (theta - theta_ref).cos())


@right("1.1")
def by_remainder(a, b):
    return (a - b + math.pi) % (2 * math.pi) - math.pi


@right("1.1")
def by_rounding_in_float32(theta, theta_ref):
    difference = (theta - theta_ref).float()
    return difference - 2 * math.pi * torch.round(difference / (2 * math.pi))


@wrong("1.1", "Full turns do not change a heading")
def plain(theta, theta_ref):
    return theta - theta_ref


@wrong("1.1", "The sign is the other way round")
def sign(theta, theta_ref):
    return by_atan2(theta_ref, theta)


@wrong("1.1", "A turn to the right has to be negative.")
def no_sign(theta, theta_ref):
    return by_atan2(theta, theta_ref).abs()


@wrong("1.1", "not almost a full turn to the left")
def between_0_and_2_pi(theta, theta_ref):
    return (theta - theta_ref) % (2 * math.pi)


@wrong("1.1", "One full turn was taken off")
def once(theta, theta_ref):
    d = theta - theta_ref
    d = torch.where(d > math.pi, d - 2 * math.pi, d)
    return torch.where(d < -math.pi, d + 2 * math.pi, d)


@wrong("1.1", "fmod keeps the sign")
def fmod(theta, theta_ref):
    return torch.fmod(theta - theta_ref, 2 * math.pi)


@wrong("1.1", "Your code raised")
def unbatched(theta, theta_ref):
    d = float(theta - theta_ref)
    return math.atan2(math.sin(d), math.cos(d))


@wrong("1.1", "Radians are wanted")
def degrees(theta, theta_ref):
    return by_atan2(theta, theta_ref).rad2deg()


# --- 1.2


class Base(pp.module.NLS):
    """A right bicycle, of which the others change one line."""

    def __init__(self, dt=0.1, wheelbase=1.0):
        super().__init__()
        self.dt, self.wheelbase = dt, wheelbase

    def rates(self, theta, v, a, delta):
        return v * theta.cos(), v * theta.sin(), v / self.wheelbase * delta.tan(), a

    def state_transition(self, state, input, t=None):
        rates = self.rates(state[..., 2], state[..., 3], input[..., 0], input[..., 1])
        return state + self.dt * torch.stack(rates, dim=-1)

    def observation(self, state, input, t=None):
        return state


@right("1.2")
class WithRates(Base):
    pass


@right("1.2")
class WithAMatrix:
    def __init__(self, dt, wheelbase):
        self.dt, self.L = dt, wheelbase

    def state_transition(self, x, u):
        i, j, theta, v = x[..., 0], x[..., 1], x[..., 2], x[..., 3]
        a, delta = u[..., 0], u[..., 1]
        turn = torch.sin(delta) / torch.cos(delta) * v / self.L
        new = [i + v * torch.sin(theta + math.pi / 2) * self.dt]
        new += [j + v * torch.sin(theta) * self.dt, theta + turn * self.dt, v + a * self.dt]
        return torch.cat([each[..., None] for each in new], dim=-1)


@wrong("1.2", "The heading on the right of an equation is the old one")
class NewHeading(Base):
    def rates(self, theta, v, a, delta):
        turn = v / self.wheelbase * delta.tan()
        new = theta + self.dt * turn
        return v * new.cos(), v * new.sin(), turn, a


@wrong("1.2", "The speed on the right of an equation is the old one")
class NewSpeed(Base):
    def rates(self, theta, v, a, delta):
        return super().rates(theta, v + self.dt * a, a, delta)


@wrong("1.2", "Cosine belongs to i, sine to j")
class Swapped(Base):
    def rates(self, theta, v, a, delta):
        return v * theta.sin(), v * theta.cos(), v / self.wheelbase * delta.tan(), a


@wrong("1.2", "its tangent is wanted")
class WithoutTangent(Base):
    def rates(self, theta, v, a, delta):
        return v * theta.cos(), v * theta.sin(), v / self.wheelbase * delta, a


@wrong("1.2", "The wheelbase divides")
class TimesWheelbase(Base):
    def rates(self, theta, v, a, delta):
        return v * theta.cos(), v * theta.sin(), v * self.wheelbase * delta.tan(), a


@wrong("1.2", "a bicycle that stands does not turn")
class TurnsOnTheSpot(Base):
    def rates(self, theta, v, a, delta):
        return v * theta.cos(), v * theta.sin(), delta.tan() / self.wheelbase, a


@wrong("1.2", "a positive delta turns to the left")
class OtherSide(Base):
    def rates(self, theta, v, a, delta):
        return super().rates(theta, v, a, -delta)


@wrong("1.2", "A rate is multiplied by dt")
class WithoutDt(Base):
    def state_transition(self, state, input, t=None):
        return state + (super().state_transition(state, input) - state) / self.dt


@wrong("1.2", "a changes the speed; it is not the speed")
class SpeedAsInput(Base):
    def state_transition(self, state, input, t=None):
        new = super().state_transition(state, input)
        return torch.cat([new[..., :3], input[..., :1]], dim=-1)


@wrong("1.2", "move a batch of states as it moves each of them")
class Unbatched(Base):
    def state_transition(self, state, input, t=None):
        i, j, theta, v = state[:4]
        return torch.stack([*Base.state_transition(self, torch.stack([i, j, theta, v]), input)])


@wrong("1.2", "cut the graph")
class Detached(Base):
    def state_transition(self, state, input, t=None):
        return super().state_transition(state.detach(), input)


@wrong("1.2", "leave its arguments as they are")
class InPlace(Base):
    def state_transition(self, state, input, t=None):
        state.copy_(super().state_transition(state, input))
        return state


# --- 1.3


class Mended:
    """A right system, of which the others change one method."""

    def __init__(self, f, g):
        self.f, self.g, self.t = f, g, 0

    def __call__(self, x, u):
        result = self.f(x, u, self.t), self.g(x, u, self.t)
        self.t += 1
        return result

    def predict(self, x, u):
        return self.f(x, u, self.t)


@right("1.3")
class TicksLast(Mended):
    pass


@right("1.3")
class PutsTheClockBack(Mended):
    def __call__(self, x, u):
        t = self.t
        self.t = torch.tensor(t + 1)
        return [self.f(x, u, t), self.g(x, u, t)]

    def predict(self, x, u):
        before = self.t
        x_next, _ = self(x, u)
        self.t = before
        return x_next


@wrong("1.3", "The clock has ticked before f was called")
class TicksFirst(Mended):
    def __call__(self, x, u):
        self.t += 1
        return self.f(x, u, self.t), self.g(x, u, self.t)


@wrong("1.3", "Call f, not the system")
class PredictTicks(Mended):
    def predict(self, x, u):
        return self(x, u)[0]


@wrong("1.3", "y belongs to x, and this is x_next's")
class ObservesTheNext(Mended):
    def __call__(self, x, u):
        x_next = self.f(x, u, self.t)
        y = self.g(x_next, u, self.t)
        self.t += 1
        return x_next, y


@wrong("1.3", "The clock has ticked before g was called")
class TicksBetween(Mended):
    def __call__(self, x, u):
        x_next = self.f(x, u, self.t)
        self.t += 1
        return x_next, self.g(x, u, self.t)


@wrong("1.3", "Expected t after 1 steps = 1; got 0.")
class NeverTicks(Mended):
    def __call__(self, x, u):
        return self.f(x, u, self.t), self.g(x, u, self.t)

    def predict(self, x, u):
        self.asked = getattr(self, "asked", -1) + 1
        return self.f(x, u, self.asked // 2)


@wrong("1.3", "The clock belongs to self")
class OneClockForAll(Mended):
    clock = [0]

    def __init__(self, f, g):
        self.f, self.g, self.start = f, g, None

    @property
    def t(self):
        return self.clock[0] - self.start if self.start else self.clock[0]

    def __call__(self, x, u):
        result = self.f(x, u, self.t), self.g(x, u, self.t)
        self.clock[0] += 1
        return result


@wrong("1.3", "a WithoutPredict without predict")
class WithoutPredict:
    def __init__(self, f, g):
        self.f, self.g, self.t = f, g, 0

    __call__ = Mended.__call__
