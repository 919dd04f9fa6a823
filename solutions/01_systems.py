# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Lab 1: dynamic systems
#
# This lab belongs to [chapter 1](../book/01_systems.py). You write a model of a bicycle and its
# Jacobians, you repair a clock, you write a test and a lap without an error, and you learn a
# number of a model from a recording. Together that takes about 90 minutes.
# <!-- given: 90 minutes -->
#
# Each exercise has three hints, to be opened one after the other, and ends in a check. The check
# tries your answer on numbers that you have not seen. If something is missing, it says what was
# expected, what came, and gives a hint. The exercises do not depend on each other.

# %% tags=["setup"]
import math

import matplotlib.pyplot as plt
import torch

import pypose_lite as pp
from pypose_lite import infinity
from pypose_lite.teaching import check, plotting, progress

plotting.use_style()
torch.set_default_dtype(torch.float64)  # so that no error that we see is rounding
torch.set_printoptions(precision=3, sci_mode=False)

# %% [markdown]
# ## Exercise 1.1: The shorter way around
#
# *5 minutes. Warm-up.*
#
# A car has the heading $\theta$ and should have $\theta_{\text{ref}}$. By how much does it have to
# be turned back? The difference $\theta - \theta_{\text{ref}}$ is not the answer: for a heading
# just below $\pi$ and a reference just above $-\pi$ it is almost a full turn, though the two
# headings are nearly the same. Write the function that returns the difference by the shorter way
# around, between $-\pi$ and $\pi$, positive where the car looks to the left of the reference. Both
# headings may lie on any lap, and both may be batches.
#
# :::{dropdown} Hint 1
# Adding a full turn, $2\pi$, to a heading changes nothing. Which functions do not notice it?
# :::
#
# :::{dropdown} Hint 2
# Cosine and sine do not. `torch.atan2(s, c)` returns the angle of the vector $[c, s]$, between
# $-\pi$ and $\pi$.
# :::
#
# :::{dropdown} Hint 3
# Take the cosine and the sine of the difference, then the angle of that vector.
# :::


# %%
def heading_error(theta, theta_ref):
    """Returns theta - theta_ref by the shorter way around, in radians."""
    ### BEGIN SOLUTION
    difference = theta - theta_ref
    return torch.atan2(difference.sin(), difference.cos())
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# The vector $[\cos, \sin]$ of the difference forgets all full turns, and `atan2` returns the one
# angle between $-\pi$ and $\pi$ that belongs to it. The remainder of a division does it as well:
# `(difference + math.pi) % (2 * math.pi) - math.pi`. It works because Python's and torch's `%`
# return a remainder that is never negative; `torch.fmod` would return one with the sign of the
# difference.

# %%
check("1.1", heading_error)

# %% [markdown]
# ## Exercise 1.2: A bicycle
#
# *10 minutes. Warm-up.*
#
# The car of the chapter may turn on the spot. A bicycle cannot: it turns only while it drives, and
# it is steered by the angle $\delta$ of its front wheel. Let $(i, j)$ be the place where its rear
# wheel touches the ground, $\theta$ its heading, $v$ its speed, and $L$ its wheelbase, the
# distance between the wheels. The input is the acceleration $a$ and the steering angle $\delta$.
# The rates are
#
# $$
# \begin{aligned}
# \dot i &= v \cos\theta, & \dot\theta &= \tfrac{v}{L} \tan\delta, \\
# \dot j &= v \sin\theta, & \dot v &= a.
# \end{aligned}
# $$
#
# Write `state_transition` for the state $[i, j, \theta, v]$ and the input $[a, \delta]$ by Euler's
# explicit method: each number of the state, plus $\Delta t$ times its rate, where all rates are
# taken at the *old* state. It should work for batches: vectors are last.
#
# :::{dropdown} Hint 1
# `state.unbind(-1)` returns four tensors, one for each number, whatever dimensions come before.
# :::
#
# :::{dropdown} Hint 2
# Compute four new numbers. On the right of each line stand only old ones.
# :::
#
# :::{dropdown} Hint 3
# The third line is `theta + v / self.wheelbase * torch.tan(delta) * self.dt`. Put the four together
# by `torch.stack([...], dim=-1)`.
# :::


# %%
class Bicycle(pp.module.NLS):
    def __init__(self, dt=0.1, wheelbase=1.0):
        super().__init__()
        self.dt = dt  # s
        self.wheelbase = wheelbase  # m

    def state_transition(self, state, input, t=None):
        ### BEGIN SOLUTION
        i, j, theta, v = state.unbind(-1)
        a, delta = input.unbind(-1)
        i_next = i + v * torch.cos(theta) * self.dt
        j_next = j + v * torch.sin(theta) * self.dt
        theta_next = theta + v / self.wheelbase * torch.tan(delta) * self.dt
        v_next = v + a * self.dt
        return torch.stack([i_next, j_next, theta_next, v_next], dim=-1)
        ### END SOLUTION

    def observation(self, state, input, t=None):
        return state


# %% [markdown] tags=["solution"]
# Four rates, four lines. The chapter's car takes the *new* heading in its second and third line;
# Euler's explicit method takes the old one. Neither is exact, and both are of first order. What
# must not happen is that a program says one and does the other, as the paper's listing does.
#
# Where does $\tan\delta$ come from? The rear wheel rolls along the heading, the front wheel along
# $\theta + \delta$. Each turns about a point on its axle; both turn about the point where the two
# axles meet. That point, the rear wheel and the front wheel make a right triangle with the sides
# $L$ and $R$, so that $\tan\delta = L / R$, and the heading changes by $v / R$ in a second.

# %%
check("1.2", Bicycle)

# %% [markdown]
# ## Exercise 1.3: The clock that ticks too often
#
# *10 minutes. A bug, found by its symptom.*
#
# Here is a system with a clock, and a function that asks "what if?" without taking a step. It was
# tested for a car, whose model does not depend on the time, and every test passed.


# %%
class TestedSystem:
    """A state-space model: x_next = f(x, u, t) and y = g(x, u, t)."""

    def __init__(self, f, g):
        self.f = f
        self.g = g
        self.t = 0

    def __call__(self, x, u):
        """Takes one step: returns the next state and the observation."""
        self.t = self.t + 1
        x_next = self.f(x, u, self.t)
        y = self.g(x, u, self.t)
        return x_next, y

    def predict(self, x, u):
        """Returns what the next state would be."""
        x_next, y = self(x, u)
        return x_next


# %% [markdown]
# Then somebody used it for a pump that fills a tank: in even steps it raises the level by $u$, in
# odd steps it rests. Before each step a controller asks what the step would do. The level should
# rise in the steps 0, 2 and 4. <!-- given: 0, 2, 4 -->


# %%
def pump(x, u, t):
    """Returns the water level after one step; the pump rests in odd steps."""
    return x + u if t % 2 == 0 else x


def gauge(x, u, t):
    """Returns what a gauge shows: the level itself."""
    return x


system = TestedSystem(pump, gauge)
level = 0
for k in range(6):
    planned = system.predict(level, 1)
    level, shown = system(level, 1)
    print("step", k, " planned", planned, " came", level, " clock", system.t)

# %% [markdown]
# The plan is never what comes, and the clock is wrong. Find the two faults, and write the system
# anew without them.
#
# :::{dropdown} Hint 1
# Look at the column "clock": by how much does it grow in a step, and by how much should it?
# :::
#
# :::{dropdown} Hint 2
# Who else ticks the clock? And which time does the very first step see?
# :::
#
# :::{dropdown} Hint 3
# `predict` should call `f` and nothing else. In a step the clock ticks last.
# :::


# %%
class MendedSystem:
    def __init__(self, f, g):
        self.f = f
        self.g = g
        self.t = 0

    def __call__(self, x, u):
        ### BEGIN SOLUTION
        x_next = self.f(x, u, self.t)
        y = self.g(x, u, self.t)
        self.t = self.t + 1
        return x_next, y
        ### END SOLUTION

    def predict(self, x, u):
        ### BEGIN SOLUTION
        return self.f(x, u, self.t)
        ### END SOLUTION


# %% [markdown] tags=["solution"]
# The clock ticked before $f$ and $g$ were called, so that the first step was taken at time 1. And
# `predict` took a step to answer a question, so that each question cost a tick. With a car nobody
# can see either fault, because its $f$ does not look at the time. A test that could see them needs
# a system in which the time counts, and a number that it can recognise.
#
# In the library only a call ticks. `transition`, `observe` and `linearize` leave the clock alone,
# and every plan of chapter 3 rests on that.

# %%
check("1.3", MendedSystem)

# %% [markdown]
# ## Exercise 1.4: Jacobians by hand
#
# *15 minutes. A derivation, checked numerically.*
#
# Derive the Jacobians of the bicycle of exercise 1.2 with paper and pencil, and write them as a
# function of one state $x = [i, j, \theta, v]$ and one input $u = [a, \delta]$: $A$ with respect to
# the state, $B$ with respect to the input. Only a few of their numbers are not 0 or 1.
#
# :::{dropdown} Hint 1
# $A$ has a row for each number of the next state and a column for each number of the old one. Since
# each new number is an old one plus something, begin with the identity.
# :::
#
# :::{dropdown} Hint 2
# In $A$, the rows of $i$ and $j$ depend on $\theta$ and $v$, and the row of $\theta$ on $v$.
# :::
#
# :::{dropdown} Hint 3
# In $B$, only $v$ depends on $a$, and only $\theta$ on $\delta$. The derivative of $\tan\delta$ is
# $1 / \cos^2\delta$.
# :::


# %%
def bicycle_jacobians(x, u, dt, wheelbase):
    """Returns A (4, 4) and B (4, 2) of the bicycle at one state and one input."""
    ### BEGIN SOLUTION
    i, j, theta, v = x
    a, delta = u
    A = torch.eye(4)
    A[0, 2] = -v * torch.sin(theta) * dt
    A[0, 3] = torch.cos(theta) * dt
    A[1, 2] = v * torch.cos(theta) * dt
    A[1, 3] = torch.sin(theta) * dt
    A[2, 3] = torch.tan(delta) / wheelbase * dt
    B = torch.zeros(4, 2)
    B[2, 1] = v / wheelbase / torch.cos(delta) ** 2 * dt
    B[3, 0] = dt
    return A, B
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# $$
# A = \begin{pmatrix}
# 1 & 0 & -v \sin\theta \, \Delta t & \cos\theta \, \Delta t \\
# 0 & 1 & v \cos\theta \, \Delta t & \sin\theta \, \Delta t \\
# 0 & 0 & 1 & \tfrac{\tan\delta}{L} \Delta t \\
# 0 & 0 & 0 & 1
# \end{pmatrix}
# $$
#
# $$
# B = \begin{pmatrix}
# 0 & 0 \\ 0 & 0 \\ 0 & \tfrac{v}{L \cos^2\delta} \Delta t \\ \Delta t & 0
# \end{pmatrix}
# $$
#
# The first two rows of $B$ are zero. In a single step no input moves the bicycle, because Euler's
# explicit method drives on with the old speed and the old heading. It takes two steps until an
# input is seen in the position. <!-- given: two steps -->

# %%
check("1.4", bicycle_jacobians)

# %% [markdown]
# ## Exercise 1.5: A test for Jacobians
#
# *15 minutes. Verification.*
#
# Somebody gives you a function $f$, a point $x$, and a matrix $A$, and says that $A$ is the
# Jacobian of $f$ at $x$. Write the test that says whether it is: `True` for a right one, `False` if
# only a single entry is wrong by a tenth. $f$ takes a vector and returns a vector, perhaps of
# another length. Its values may be small or in the thousands. <!-- given: a tenth, thousands -->
#
# :::{dropdown} Hint 1
# For a small $\delta x$, $f(x + \delta x) - f(x)$ is nearly $A \, \delta x$. If $\delta x$ has one
# number that is not zero, this looks at one column of $A$.
# :::
#
# :::{dropdown} Hint 2
# Central differences are more accurate: $f(x + \delta x) - f(x - \delta x)$ is nearly
# $2 A \, \delta x$. With $\delta x$ of about $10^{-6}$ neither the curvature of $f$ nor rounding is
# seen.
# :::
#
# :::{dropdown} Hint 3
# Compute all columns like this and compare them with $A$. What counts is the difference beside the
# size of the entries: `torch.allclose(estimate, A, rtol=1e-4, atol=1e-4 * A.abs().max())`.
# :::


# %%
def is_jacobian(f, A, x):
    """Returns whether A is the Jacobian of f at x."""
    ### BEGIN SOLUTION
    h = 1e-6
    columns = []
    for direction in torch.eye(len(x)):
        change = f(x + h * direction) - f(x - h * direction)
        columns.append(change / (2 * h))
    estimate = torch.stack(columns, dim=-1)
    size = estimate.abs().max().item()
    return torch.allclose(estimate, A, rtol=1e-4, atol=1e-4 * size)
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# Each direction looks at one column of $A$, so that there have to be as many directions as columns.
# A single direction along an axis, the usual mistake, looks at one column and believes the others.
# Random directions do it as well, if there are several: one of them may hardly change the number
# whose column is wrong.
#
# The tolerance is relative to the size of the derivatives. A fixed one of $10^{-6}$ would refuse a
# right Jacobian of a function with values in the thousands, whose differences are rounded more
# coarsely, and a fixed one of 1 would accept anything if the values are small.
# <!-- given: thousands -->
#
# The chapter's test is another one: it makes the change smaller and smaller and looks at the slope
# of the error. It needs no tolerance, but it needs a plot or a fit.

# %%
check("1.5", is_jacobian)

# %% [markdown]
# ## Exercise 1.6: A lap without an error
#
# *15 minutes. Design, by a threshold.*
#
# The chapter's car is off its path by some centimetres, though its inputs were computed exactly:
# it turns first and then drives straight on, so that it drives along a polygon. And if its wheels
# slip by 5 %, it misses the path altogether. Both can be computed beforehand. Choose 128 inputs
# $[v, \varphi]$, with steps of 0.1 s, that keep the car *with* slip within 0.1 mm of the two
# circles at all its steps. As in the chapter, it has 64 steps for each circle, and it is at a
# waypoint in every eighth step.
# <!-- given: 5 %, 128 inputs, 0.1 s, 0.1 mm, 64 steps, eighth -->
#
# :::{dropdown} Hint 1
# The states shall be the corners of a regular polygon with 64 corners on each circle. How long is
# one of its sides? By how much does the direction change from one side to the next?
# <!-- given: 64 corners -->
# :::
#
# :::{dropdown} Hint 2
# A side is a chord: $2 \sin(\alpha / 2)$ long on a circle of radius 1 m, where $\alpha$ is the
# angle of one step. The first side leaves the tangent by $\alpha / 2$ only.
# :::
#
# :::{dropdown} Hint 3
# Where the circles touch, the last side of the first and the first side of the second lie on one
# line. And a car that loses 5 % of its turn rate has to be told $1 / 0.95$ of it.
# <!-- given: 5 % -->
# :::

# %%
### BEGIN SOLUTION
dt = 0.1
angle = 2 * math.pi / 64
speed = 2 * math.sin(angle / 2) / dt
left = [angle / 2] + [angle] * 63
right = [0.0] + [-angle] * 63
turn_rate = torch.tensor(left + right) / dt / 0.95
lap = torch.stack([torch.full_like(turn_rate, speed), turn_rate], dim=-1)
### END SOLUTION

# %% [markdown] tags=["solution"]
# The corners lie exactly on the circles. The car starts along the tangent, and a chord makes half
# of the step's angle with the tangent at its end, so the first step turns by half. At the end of
# the first circle the car looks along its last chord, half a step's angle away from the tangent,
# and that is the direction of the first chord of the second circle: no turn.
#
# This is a computation that knows the car exactly. It would be useless for a car whose slip is
# 4 % or 6 %, or changes with the ground. That is what feedback is for. <!-- given: 4 %, 6 % -->

# %%
check("1.6", lap)

# %% tags=["hide-input"]
state = infinity.waypoints()[0]
states = [state]
for u in lap:
    state, observation = pp.DubinsCar(0.1, slip=0.05)(state, u)
    states.append(state)
fig, ax = plt.subplots(figsize=(7, 4))
plotting.plot_course(ax).set_ylim(-1.3, 1.8)
plotting.plot_states(ax, torch.stack(states), label="car with 5 % slip")
ax.legend(loc="upper center", ncols=3)
plotting.show(fig, "The lap of your inputs, driven by the car that slips.")

# %% [markdown]
# ## Exercise 1.7: Learn the length of a pendulum
#
# *20 minutes. Differentiate through it.*
#
# A camera has recorded a swinging pendulum: `states` holds its angle and its angular velocity,
# one row a step of `dt` seconds, with a little noise. There was no torque. Everything of the
# pendulum is known but its length. Write the function that learns the length from the recording.
#
# The length of `pp.Pendulum(dt, length=...)` may be a tensor that requires a gradient. So predict
# each state from the one before it, by the transition of a pendulum whose length you guess, and
# go downhill: the mean square of the one-step residual is the loss.
#
# :::{dropdown} Hint 1
# `pp.Pendulum(dt, length=length).transition(states[:-1], torch.zeros(1))` predicts all states but
# the first, in one call.
# :::
#
# :::{dropdown} Hint 2
# A length has to stay positive. Learn its logarithm, and take the exponential.
# :::
#
# :::{dropdown} Hint 3
# `torch.optim.Adam([log_length], lr=0.05)` chooses its steps by itself. In each of 300 rounds: set
# the gradients to zero, compute the loss, `loss.backward()`, `optimizer.step()`.
# <!-- given: 300 rounds -->
# :::


# %%
def learn_length(states, dt):
    """Returns the length of the pendulum in metres."""
    ### BEGIN SOLUTION
    log_length = torch.zeros((), requires_grad=True)
    optimizer = torch.optim.Adam([log_length], lr=0.05)
    no_torque = torch.zeros(1)
    for _ in range(300):
        pendulum = pp.Pendulum(dt, length=log_length.exp())
        predicted = pendulum.transition(states[:-1], no_torque)
        loss = (states[1:] - predicted).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return log_length.exp().item()
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# The loss compares the model with the recording, and its gradient passes through the model as if
# that were any other function. Nothing was derived by hand. Adam divides the gradient by its own
# usual size, which is why one step size serves for short and long pendulums.
#
# Predicting one step from a state that carries noise makes a small systematic error, because
# the noise enters on both sides. With the noise of the recording it does not matter. With more of
# it one predicts many steps from a single start, and learns that start, too.

# %%
check("1.7", learn_length)

# %%
progress()
