"""The systems of the book: a Dubins car, one on legs, a pendulum, a cart with a pole.

Each parameter may be a number, a tensor or an ``nn.Parameter``, and may then be learned.
"""

import torch

from .nonlinear import NLS


class DubinsCar(NLS):
    """A car in the plane: state ``[i, j, cos, sin]`` (m, m, heading), input ``[v, phi]``.

    Its speed v (m/s) and its turn rate phi (rad/s) are what it is told; its heading theta is kept
    as cosine and sine, so that it has no jump. One step turns first and then drives ahead:

        theta' = theta + (1 - slip) phi dt      (1)
        i' = i + v cos(theta') dt               (2)
        j' = j + v sin(theta') dt               (3)

    Args:
        dt: seconds a step takes.
        slip: the share of the turn rate that the wheels lose; 0 is the ideal car.

    Source: "PyPose v0.6", equations (2); its listing drives with the old heading instead.
    """

    vectorized = True
    sizes = {"n": 4, "m": 2}

    def __init__(self, dt=0.1, slip=0.0):
        super().__init__()
        self.dt, self.slip = dt, slip

    def state_transition(self, state, input, t=None):
        """Returns the state ``(..., 4)`` after one step."""
        i, j, c, s = state.unbind(-1)
        v, phi = input.unbind(-1)
        theta = torch.atan2(s, c) + (1 - self.slip) * self.dt * phi  # (1)
        c, s, way = theta.cos(), theta.sin(), v * self.dt
        i = i + way * c  # (2)
        j = j + way * s  # (3)
        return torch.stack([i, j, c, s], dim=-1)

    def observation(self, state, input, t=None):
        """Returns the state itself: all of it is seen."""
        return state


class Legs(DubinsCar):
    """A car whose speeds follow what it is told late, as legs do: ``[i, j, cos, sin, v, w]``.

    The input ``[v, phi]`` says where its speed v (m/s) and its turn rate w (rad/s) are on their way
    to, along a straight line each, by ``lag`` dv/dt = a - v; with the speeds at the end of the step
    the car then moves, and in a turn it slides to its left besides:

        a = gain u + drift      (1)
        v' = a + exp(-dt / lag) (v - a)      (2)
        i', j', theta' = car(i, j, theta, v')      (3)
        (i', j') += axle w' dt (-sin(theta'), cos(theta'))      (4)

    Args:
        dt: seconds a step takes.
        slip: as of the car.
        lag: the time constant, seconds, > 0; one, or ``(2,)`` for speed and turn rate.
        gain: the share of what it is told that it does; one, or ``(2,)``.
        drift: m/s and rad/s that it does unasked; one, or ``(2,)``.
        axle: m, how far behind its middle the point is that does not slide.
    """

    sizes = {"n": 6, "m": 2}

    def __init__(self, dt=0.1, slip=0.0, lag=0.15, gain=1.0, drift=0.0, axle=0.0):
        super().__init__(dt, slip)
        self.lag, self.gain, self.drift, self.axle = lag, gain, drift, axle

    def state_transition(self, state, input, t=None):
        """Returns the state ``(..., 6)`` after one step."""
        a = self.gain * input + self.drift  # (1)
        rest = torch.exp(-self.dt / torch.as_tensor(self.lag, dtype=state.dtype))
        v = a + rest * (state[..., 4:] - a)  # (2)
        i, j, c, s = super().state_transition(state[..., :4], v).unbind(-1)  # (3)
        slide = self.axle * v[..., 1] * self.dt
        moved = torch.stack([i - slide * s, j + slide * c, c, s], dim=-1)  # (4)
        return torch.cat([moved, v], dim=-1)


class Pendulum(NLS):
    """A rod with a motor at its hinge: state ``[theta, omega]`` (rad from upright, rad/s).

    The input is a torque tau (N m) on a bob of mass m at the end of a weightless rod:

        m l^2 domega/dt = m g l sin(theta) - b omega + tau      (1)

    Args:
        dt: seconds a step takes (the angle moves with the new rate).
        length: l, m.
        mass: m, kg.
        damping: b, N m s.
        gravity: g, m/s^2.
    """

    vectorized = True
    sizes = {"n": 2, "m": 1}

    def __init__(self, dt=0.05, length=1.0, mass=1.0, damping=0.1, gravity=9.81):
        super().__init__()
        self.dt, self.length, self.mass = dt, length, mass
        self.damping, self.gravity = damping, gravity

    def state_transition(self, state, input, t=None):
        """Returns the state ``(..., 2)`` after one step."""
        theta, omega = state.unbind(-1)
        inertia = self.mass * self.length**2
        weight = self.mass * self.gravity * self.length * theta.sin()
        torque = weight - self.damping * omega + input[..., 0]
        omega = omega + torque / inertia * self.dt  # (1)
        return torch.stack([theta + omega * self.dt, omega], dim=-1)

    def observation(self, state, input, t=None):
        """Returns the angle ``(..., 1)`` alone."""
        return state[..., :1]


class CartPole(NLS):
    """A pole on a cart: state ``[x, dx, theta, dtheta]`` (m, m/s, rad from upright, rad/s).

    The input is a force F (N) on the cart. With a = (F + m l dtheta^2 sin(theta)) / (M + m):

        ddtheta = (g sin(theta) - a cos(theta)) / (l (4/3 - m cos(theta)^2 / (M + m)))    (1)
        ddx = a - m l ddtheta cos(theta) / (M + m)                                        (2)

    Args:
        dt: seconds a step takes (explicit Euler).
        length: l, half of the pole's length, m.
        cart: M, kg.
        pole: m, kg.
        gravity: g, m/s^2.

    Source: Barto, Sutton, Anderson, "Neuronlike adaptive elements that can solve difficult
    learning control problems" (1983), without friction.
    """

    vectorized = True
    sizes = {"n": 4, "m": 1}

    def __init__(self, dt=0.02, length=0.5, cart=1.0, pole=0.1, gravity=9.81):
        super().__init__()
        self.dt, self.length, self.cart, self.pole, self.gravity = dt, length, cart, pole, gravity

    def state_transition(self, state, input, t=None):
        """Returns the state ``(..., 4)`` after one step."""
        _, dx, theta, dtheta = state.unbind(-1)
        c, s, total, ml = theta.cos(), theta.sin(), self.cart + self.pole, self.pole * self.length
        a = (input[..., 0] + ml * dtheta**2 * s) / total
        lever = self.length * (4 / 3 - self.pole * c**2 / total)
        ddtheta = (self.gravity * s - a * c) / lever  # (1)
        ddx = a - ml * ddtheta * c / total  # (2)
        return state + self.dt * torch.stack([dx, ddx, dtheta, ddtheta], dim=-1)

    def observation(self, state, input, t=None):
        """Returns where the cart is and how the pole stands, ``(..., 2)``."""
        return state[..., 0::2]
