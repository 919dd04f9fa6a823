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
# # Dynamic systems
#
# Nobody steers a Mars rover with a joystick: a radio signal needs between 3 and 22 minutes to
# reach it. The drivers send the commands of a whole day at once, and choose them by predicting
# where each of them will take the rover. The lane assistant of a car, a crane that must not swing
# its load and a drone in a gust of wind ask the same question many times a second: *if I do this
# now, what happens next?* What answers this question is a model of a
# {term}`dynamic system <dynamical system>`. <!-- given: 3 and 22 minutes, 22 minutes -->
#
# In this chapter you write such a model for a small car, in three equations and a few lines of
# torch. All other chapters use it. After this one you can
#
# - name the state, the input and the observation of a system, and the time step of each;
# - turn a differential equation into a model in discrete time, and write it as a class;
# - linearise a model, and test that its Jacobians are right;
# - say whether a linear model can be steered everywhere, and whether an equilibrium is stable.
#
# You need Python, a first acquaintance with torch tensors, matrices and eigenvalues, and
# derivatives. Take about 60 minutes. The chapter follows section III-A of the paper
# {cite}`pypose06`: its equations (1) and (2), its first two listings, and the two panels of its
# Fig. 2, still without a controller. <!-- given: 60 minutes -->

# %% tags=["setup"]
import inspect
import math
import textwrap

import ipywidgets
import matplotlib.pyplot as plt
import torch
from IPython.display import Code, display
from matplotlib.patches import Arc

import pypose_lite as pp
from pypose_lite import infinity
from pypose_lite.teaching import claim, plotting, sketches, table, widgets

plotting.use_style()
torch.set_default_dtype(torch.float64)  # so that no error that we see is rounding
torch.set_printoptions(precision=3, sci_mode=False)

# %% [markdown]
# This is the example of the whole book. Two circles of radius 1 m touch at the origin. A car
# starts there, facing down. It drives around the right circle counter-clockwise and then around
# the left one clockwise, and so draws an infinity sign. Each circle takes 64 steps of 0.1 s. The
# car must therefore turn by $2\pi$ in $64 \cdot 0.1$ s. On a circle of radius 1 m its speed in m/s
# is the same number as its turn rate in rad/s. <!-- given: 64 steps, 0.1 s -->

# %%
dt = 0.1  # s, the length of one time step
steps = 64  # for once around a circle
turn_rate = 2 * math.pi / (steps * dt)  # rad/s
speed = 1.0 * turn_rate  # m/s, on a circle of radius 1 m
right_circle = torch.tensor([[speed, turn_rate]] * steps)
left_circle = torch.tensor([[speed, -turn_rate]] * steps)
inputs = torch.cat([right_circle, left_circle])
start = infinity.waypoints()[0]


def drive(car, state, inputs):
    """Returns the states of a car that is given the inputs one after the other."""
    states = [state]
    for u in inputs:
        state, observation = car(state, u)
        states.append(state)
    return torch.stack(states, dim=-2)


ideal = drive(pp.DubinsCar(dt), start, inputs)

# %% tags=["hide-input"]
fig, (top, bottom) = plt.subplots(2, 1, figsize=(7, 6), height_ratios=[1.8, 1])
plotting.plot_states(plotting.plot_course(top), ideal, label="car, one dot a step")
top.legend(loc="upper center", bbox_to_anchor=(0.5, 1.17), ncols=3)
time = dt * torch.arange(len(inputs))
bottom.step(time, inputs[:, 0], where="post", label="speed (m/s)")
bottom.step(time, inputs[:, 1], "--", where="post", label="turn rate (rad/s)")
bottom.set(xlabel="time (s)", ylabel="input", ylim=(-1.3, 1.6))
bottom.legend(loc="lower left")
plotting.show(
    fig,
    "Above: a car drives along two touching circles, past 17 waypoints, dot by "
    "dot. Below: its speed is constant, its turn rate changes sign after half of "
    "the time.",
)

# %% tags=["claims"]
claim("hand_error", infinity.tracking_error(ideal).max(), below=0.06, unit="m")
claim("hand_end", ideal[-1, :2].norm(), below=1e-9, unit="m")
places = torch.unique(infinity.waypoints()[:, :2].round(decimals=6) + 0.0, dim=0)
claim("dots", len(places), equals=15)

# %% [markdown]
# The broad curve is the path. The large dots are the 17 waypoints of the paper, 45 degrees apart.
# The first, the middle and the last one lie on each other, so that you see only {claim}`dots` of
# them. At its steps the car is at most {claim}`hand_error` from the path. Remember that number: we
# computed the inputs exactly, so why is it not zero?

# %% [markdown]
# ## It fails: the same inputs, a car that slips
#
# We fixed the inputs before the car started and never looked where it went. Such control is called
# {term}`open loop`. It works as long as the car behaves exactly as we assumed. Now let the wheels
# slip a little, so that the car loses 5 % of each turn rate. <!-- given: 5 % -->
#
# **Predict.** After the lap, how far from its start does the slipping car stop: about 5 cm, about
# 30 cm, or more than half a metre? <!-- given: 5 cm, 30 cm, half a metre, half -->

# %% tags=["answer", "hide-input"]
slipping = drive(pp.DubinsCar(dt, slip=0.05), start, inputs)
fig, ax = plt.subplots(figsize=(7, 4.2))
plotting.plot_course(ax).set_ylim(-1.3, 2.4)
plotting.plot_states(ax, slipping, label="car with 5 % slip")
ax.legend(loc="upper center", ncols=3)
plotting.show(
    fig,
    "The slipping car leaves the path in its first circle and stops far away.",
)

# %% tags=["answer", "claims"]
claim("slip_end", slipping[-1, :2].norm(), above=0.5, unit="m")
c, s = slipping[64, 2:]
heading_error = (torch.atan2(s, c) + math.pi / 2).abs().rad2deg()
claim("slip_heading", heading_error, equals=18, within=0.01, unit="degrees")

# %% [markdown] tags=["answer"]
# More than half a metre: {claim}`slip_end`. A small error of the turn rate adds up. After the
# first circle the heading is wrong by {claim}`slip_heading`, and the car drives all the rest of
# its lap in a wrong direction. <!-- given: half a metre, half -->

# %% [markdown]
# The cure is {term}`feedback`: inputs that are computed from where the car is. Chapters 2 and 3
# are about feedback, and both compute it from a model that says what each possible input would do.
# This chapter is about that model.

# %% [markdown]
# ## The idea: state, input and observation
#
# What do we have to know about the car *now* to predict where it will be? Its position $(i, j)$ in
# metres and its heading $\theta$ in radians, counter-clockwise from the $i$ axis. How it came
# there does not matter any more. Numbers with this property are called the {term}`state` of a
# system. The {term}`input` is what we choose: for the car its speed $v$ in m/s and its turn rate
# $\varphi$ in rad/s. The {term}`observation` is what the sensors report. For the moment they
# report all of the state.

# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 4.2))
sketches.car(ax, 1.5, 0.9, theta=0.6)
ax.plot([1.5, 1.5, 0, 3.1], [0, 0.9, 0.9, 0.9], ":", color="black")
ax.add_patch(Arc((1.5, 0.9), 1.8, 1.8, theta2=math.degrees(0.6), lw=1.5))
sketches.arrow(ax, (1.5, 0.9), (2.57, 1.63), plotting.BLUE)
sketches.arrow(ax, (1.84, 0.40), (2.25, 0.8), plotting.RED, bend=0.35)
sketches.arrow(ax, (1.22, 1.31), (0.94, 1.73), plotting.GREY)
ax.plot(1.09, 1.5, "x", ms=16, mew=3, color=plotting.RED, zorder=6)
ax.plot(1.5, 0.9, "o", color="black", zorder=6)
sketches.word(ax, 2.47, 1.08, r"heading $\theta$")
sketches.word(ax, 2.0, 1.75, "speed $v$", plotting.BLUE)
sketches.word(ax, 2.25, 0.5, r"turn rate $\varphi$", plotting.RED)
sketches.word(ax, 0.1, 1.85, "never sideways", plotting.GREY)
ax.set(aspect="equal", xlim=(0, 3.6), ylim=(0, 2.2), xlabel="i (m)", ylabel="j (m)")
plotting.show(
    fig,
    "A car seen from above at a point (i, j). Its heading theta is the angle from "
    "the i axis to its nose. Its speed v points along the heading, its turn rate phi "
    "around its centre. An arrow to its side is crossed out.",
)

# %% [markdown]
# The velocity of the car always points along its heading: the car cannot slide sideways. Still it
# can reach every position with every heading if it manoeuvres, as drivers do when they park. A
# constraint of this kind, which forbids velocities but no positions, is called
# {term}`nonholonomic <nonholonomic system>`.
#
# The paper calls the model `DubinsCar`. Strictly, a Dubins car {cite}`dubins1957` only drives
# forward, and its circles have a smallest radius. Ours may also drive backward and turn on the
# spot, which makes it a {term}`unicycle`; we keep the paper's name.

# %% tags=["claims"]
on_the_spot, _ = pp.DubinsCar(dt)(start, torch.tensor([0.0, 1.0]))
claim("spot_way", (on_the_spot - start)[:2].norm(), equals=0, unit="m")
claim("spot_turn", (on_the_spot - start)[2:].norm(), above=0.09)
backward, _ = pp.DubinsCar(dt)(start, torch.tensor([-1.0, 0.0]))
claim("backward", backward[1] - start[1], equals=0.1, within=1e-12, unit="m")

# %% [markdown]
# Computers read sensors and send commands at fixed times, so we count steps, $k = 0, 1, 2, \dots$
# All systems of this book are {term}`state-space models <state-space model>` in discrete time, the
# paper's equation (1):
#
# $$
# \begin{aligned}
# x_{k+1} &= f(x_k, u_k, t_k) + w_k \\
# y_k &= g(x_k, u_k, t_k) + n_k
# \end{aligned}
# $$ (eq-1-system)
#
# Here $x_k$ is the state, $u_k$ the input and $y_k$ the observation in step $k$. The
# *transition* $f$ says how the state moves on, and the *observation function* $g$ says what
# the sensors see of it. Both may depend on the time $t_k$; those of the car do not. The
# {term}`process noise` $w_k$ and the {term}`observation noise` $n_k$ stand for all that the model
# does not know. (The paper writes $v_k$ for $n_k$; our $v$ is the speed.)

# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 3.2))
sketches.state_space(ax)
plotting.show(
    fig,
    "Block diagram. Input and state enter f; process noise is added; the sum is the "
    "next state, which becomes the state one step later. Input and state also enter "
    "g; observation noise is added; the sum is the observation.",
)

# %% [markdown]
# Follow the state through the diagram. In step $k$ both $f$ and $g$ receive the *same* state
# $x_k$, so the observation $y_k$ belongs to the state before the step. Chapters 4 and 5 rely on
# this.

# %% [markdown]
# ## Derived: three equations for the car
#
# We begin in continuous time. A dot stands for the derivative with respect to time. The heading
# changes at the turn rate, and the position changes at the speed $v$ in the direction of the
# heading:
#
# $$ \dot\theta = \varphi, \quad \dot i = v \cos\theta, \quad \dot j = v \sin\theta $$ (eq-1-rates)
#
# A computer holds the input constant during each step of length $\Delta t$. The heading then
# changes by exactly $\varphi \, \Delta t$. The position moves by $v \, \Delta t$ along the
# heading, but the heading changes on the way. The simplest choice takes one heading for the whole
# step, and the paper takes the new one. These are its equations (2):
#
# $$ \theta_{k+1} = \theta_k + \varphi_k \, \Delta t $$ (eq-1-turn)
#
# $$ i_{k+1} = i_k + v_k \cos\theta_{k+1} \, \Delta t $$ (eq-1-i)
#
# $$ j_{k+1} = j_k + v_k \sin\theta_{k+1} \, \Delta t $$ (eq-1-j)
#
# Replacing a differential equation by such steps is called {term}`discretisation`. It has a price.
# A real car turns *while* it drives, and its mean direction lies halfway between the old heading
# and the new one. Ours differs from that by $\varphi \, \Delta t / 2$, here {claim}`half_turn`.
# Every step is rotated by this angle, so the whole circle is rotated about the point where it
# starts, and its centre, 1 m away, moves by about {claim}`centre_shift`. That explains the
# {claim}`hand_error` of the first figure. With steps of half the length the error is also halved:
# it becomes {claim}`short_step_error`. Such a discretisation is called first-order.
# <!-- given: half the length, half, halved -->

# %% tags=["claims"]
half_steps = inputs.repeat_interleave(2, dim=0)
short_steps = drive(pp.DubinsCar(dt / 2), start, half_steps)
short_step_error = infinity.tracking_error(short_steps).max()
claim("half_turn", turn_rate * dt / 2, equals=0.0491, within=1e-4, unit="rad")
centre = ideal[:64, :2].mean(0)
shift = (centre - torch.tensor([1.0, 0.0])).norm()
claim("centre_shift", shift, equals=0.049, within=1e-3, unit="m")
claim("short_step_error", short_step_error, below=0.03, unit="m")
ratio = infinity.tracking_error(ideal).max() / short_step_error
claim("first_order", ratio, equals=2, within=0.05)

# %% [markdown]
# ## From scratch: a system and its clock
#
# All systems have the form {eq}`eq-1-system`, so we write that form once: two functions and a
# clock. Calling the system takes one step. It evaluates both functions at the present state and
# time, and then advances the clock.


# %%
class SmallSystem:
    """A state-space model; a subclass defines state_transition and observation."""

    def __init__(self):
        self.t = 0

    def __call__(self, x, u):
        x_next = self.state_transition(x, u, self.t)
        y = self.observation(x, u, self.t)
        self.t = self.t + 1
        return x_next, y


# %% [markdown]
# The car is a subclass. The numbers at the ends of its lines are those of the equations.


# %%
class SmallCar(SmallSystem):
    def state_transition(self, x, u, t):
        i, j, theta = x
        v, phi = u
        theta_next = theta + phi * dt  # (1.3)
        i_next = i + v * torch.cos(theta_next) * dt  # (1.4)
        j_next = j + v * torch.sin(theta_next) * dt  # (1.5)
        return torch.stack([i_next, j_next, theta_next])

    def observation(self, x, u, t):
        return x


# %% [markdown]
# Our own class drives the lap of the first figure:

# %%
small_car = SmallCar()
small_start = torch.tensor([0.0, 0.0, -math.pi / 2])  # at the origin, facing down
small_states = drive(small_car, small_start, inputs)
print("the clock shows", small_car.t)
print("the last state is", small_states[-1])

# %% tags=["claims"]
i, j, theta = small_states.unbind(-1)
small_ideal = torch.stack([i, j, theta.cos(), theta.sin()], dim=-1)
claim("small_clock", small_car.t, equals=128)
claim("agrees_with_ours", (small_ideal - ideal).abs().max(), below=1e-12)

# %% [markdown]
# ## Linearisation: the car near one state
#
# Mathematics can answer most questions about linear systems, and near one point every smooth $f$
# is almost linear. Change the state by a small $\delta x$ and the input by a small $\delta u$.
# Taylor's theorem says
#
# $$
# \begin{aligned}
# & f(x + \delta x, u + \delta u) \\
# & \quad \approx f(x, u) + A \, \delta x + B \, \delta u
# \end{aligned}
# $$ (eq-1-linear)
#
# $A$ and $B$ are {term}`Jacobians <Jacobian>`, matrices of first derivatives: $A$ with
# respect to the state, $B$ with respect to the input. Each has a row for each component of the
# next state and a column for each variable. Computing them is called {term}`linearisation`. We do
# it for the car by hand, with $c = \cos\theta_{k+1}$ and $s = \sin\theta_{k+1}$.
#
# The third row holds the derivatives of $\theta_{k+1}$. By {eq}`eq-1-turn`, they are 1 with
# respect to $\theta_k$ and $\Delta t$ with respect to $\varphi_k$; the others are zero. The first
# row holds those of $i_{k+1}$. By {eq}`eq-1-i`, they are 1 with respect to $i_k$ and
# $c \, \Delta t$ with respect to $v_k$. The heading $\theta_{k+1}$ enters through the cosine, with
# the derivative $-v s \, \Delta t$. The chain rule multiplies it by 1 for $\theta_k$ and by
# $\Delta t$ for $\varphi_k$. The second row follows from {eq}`eq-1-j` in the same way:
#
# $$
# \begin{aligned}
# A &= \begin{pmatrix} 1 & 0 & -v s \, \Delta t \\ 0 & 1 & v c \, \Delta t \\
# 0 & 0 & 1 \end{pmatrix} \\
# B &= \begin{pmatrix} c \, \Delta t & -v s \, \Delta t^2 \\ s \, \Delta t & v c \, \Delta t^2 \\
# 0 & \Delta t \end{pmatrix}
# \end{aligned}
# $$ (eq-1-jacobians)


# %%
def jacobians_by_hand(theta, v, phi):
    """Returns A and B of the car with the state [i, j, theta]."""
    c = math.cos(theta + phi * dt)
    s = math.sin(theta + phi * dt)
    A = torch.eye(3)
    A[0, 2] -= v * s * dt
    A[1, 2] += v * c * dt
    B = torch.zeros(3, 2)
    B[0, 0] += c * dt
    B[1, 0] += s * dt
    B[0, 1] -= v * s * dt**2
    B[1, 1] += v * c * dt**2
    B[2, 1] += dt
    return A, B


A, B = jacobians_by_hand(theta=0.0, v=1.0, phi=0.0)
print("A =", A, "B =", B, sep="\n")

# %% [markdown]
# These matrices belong to a car that drives along the $i$ axis at 1 m/s. Read the second row of
# $A$: in each step, a tenth of the error of the heading is added to the error of $j$. That is
# what carried the slipping car away. <!-- given: a tenth -->

# %% [markdown]
# ## The library's `System`
#
# In the library, a model is a subclass of `pp.module.NLS`, a nonlinear system. The two functions
# are the same; only the base class changes:


# %%
class PoseCar(pp.module.NLS):
    def state_transition(self, x, u, t):
        i, j, theta = x.unbind(-1)
        v, phi = u.unbind(-1)
        theta_next = theta + phi * dt
        i_next = i + v * torch.cos(theta_next) * dt
        j_next = j + v * torch.sin(theta_next) * dt
        return torch.stack([i_next, j_next, theta_next], dim=-1)

    def observation(self, x, u, t):
        return x


pose_car = PoseCar()
pose_states = drive(pose_car, small_start, inputs)
print("the clock shows", pose_car.systime.item())
pose_car.reset()
print("after reset it shows", pose_car.systime.item())

# %% [markdown]
# Calling the library's system does what calling ours did, and it checks the shapes first. Only a
# call advances the clock. The library also linearises for us, by automatic differentiation:

# %%
x = torch.tensor([0.0, 0.0, 0.0])
u = torch.tensor([1.0, 0.0])
A, B, C, D, c1, c2 = pose_car.linearize(x, u)
print("A =", A, "B =", B, sep="\n")

# %% tags=["claims"]
_, first_observation = pose_car(small_start, inputs[0])
claim("observes_old_state", torch.equal(first_observation, small_start), equals=True)
difference = (pose_states - small_states).abs().max()
claim("library_equals_ours", difference, below=1e-12)
by_hand = jacobians_by_hand(theta=2.0, v=0.7, phi=0.5)
elsewhere = torch.tensor([1.0, 2.0, 2.0])
by_library = pose_car.linearize(elsewhere, torch.tensor([0.7, 0.5]))[:2]
pairs = zip(by_hand, by_library)
largest = max((ours - theirs).abs().max() for ours, theirs in pairs)
claim("jacobians_equal_ours", largest, below=1e-12)

# %% [markdown]
# These are our matrices. $C$ and $D$ are the Jacobians of the observation $g$ with respect
# to state and input. The two constants complete the linear model, $f \approx A x + B u + c_1$ and
# $g \approx C x + D u + c_2$.
#
# **The heading as cosine and sine.** One detail of our car is unpleasant. The headings
# $\theta = \pi$ and $\theta = -\pi$ are the same, but the numbers differ by $2\pi$, and a
# controller that compares the numbers would order a full turn. The paper therefore keeps the
# cosine and the sine of the heading, so that the state $x = [i, j, \cos\theta, \sin\theta]$ has no
# jump. The library's car does this. Here is its transition, whole. The lines (1), (2) and (3) are
# our equations {eq}`eq-1-turn`, {eq}`eq-1-i` and {eq}`eq-1-j`.

# %% tags=["hide-input"]
source = inspect.getsource(pp.DubinsCar.state_transition)
Code(textwrap.dedent(source), language="python")

# %% [markdown]
# `unbind(-1)` takes a tensor apart along its last dimension and leaves the others alone. A tensor
# of shape `(1000, 4)` is therefore a {term}`batch`: a thousand cars, and one call moves them all
# by one step. Batch dimensions come first and vectors last, everywhere in the library.

# %% [markdown]
# ## On the infinity: a thousand cars and noise
#
# A car differs from its model by a slip, or by chance. We now disturb every component of the state
# in every step by a random number with the standard deviation 0.005, the process noise of the
# whole book.


# %%
def drive_with_noise(car, state, inputs, noise=0.005):
    """Returns the states of cars that are disturbed in every step."""
    generator = torch.Generator().manual_seed(1)
    states = [state]
    for u in inputs:
        state, observation = car(state, u)
        state = state + noise * torch.randn(state.shape, generator=generator)
        states.append(state)
    return torch.stack(states, dim=-2)


cars = start.expand(1000, 4)
noisy = drive_with_noise(pp.DubinsCar(dt), cars, inputs)

# %% tags=["hide-input"]
fig, panels = plt.subplots(2, 1, figsize=(7, 7), sharex=True)
titles = ["(a) ideal car", "(b) car with noise, among 30 others"]
for ax, title in zip(panels, titles):
    plotting.infinity_axes(ax, title)
    plotting.plot_waypoints(ax, infinity.waypoints())
plotting.plot_states(panels[0], ideal, label="car")
i, j = noisy[1:31, :, :2].permute(2, 1, 0)
others = panels[1].plot(i, j, color=plotting.GREY, lw=0.5)
others[0].set_label("30 other cars")
plotting.plot_states(panels[1], noisy[0], label="car")
for ax in panels:
    ax.legend(loc="upper center", ncols=3)
    ax.set_ylim(-1.25, 1.7)
panels[0].set_xlabel("")
plotting.show(
    fig,
    "Two panels with the 17 waypoints. (a) The ideal car follows the infinity "
    "sign. (b) Cars with noise drift away from it, each another way.",
)

# %% tags=["hide-input"]
rows = []
runs = {"ideal": ideal[None], "5 % slip": slipping[None], "1000 with noise": noisy}
for name, states in runs.items():
    error = infinity.tracking_error(states)
    end = states[:, -1, :2].norm(dim=-1)
    mean, largest = error.mean(), error.amax(1).mean()
    rows.append(f"{name} | {mean:.3f} | {largest:.3f} | {end.mean():.3f}")
display(table("car | mean error (m) | largest (m) | end to start (m)", rows))

# %% tags=["claims"]
largest = infinity.tracking_error(noisy).amax(1)
claim("noise_error", largest.mean(), above=0.12, below=0.18, unit="m")
outside = 100 * (largest > infinity.TOLERANCE).double().mean()
claim("beyond_tolerance", outside, above=60, unit="%")

# %% [markdown]
# These are the two panels of the paper's Fig. 2, where a controller steers the car; chapter 3
# draws them with that controller. The error of a state is its distance from the nearer circle. The
# largest error of a noisy car in its lap is {claim}`noise_error`, in the mean over a thousand
# cars, and {claim}`beyond_tolerance` of the cars stray further than the 0.1 m within which this
# book counts a waypoint as reached. <!-- given: a thousand cars, 0.1 m -->

# %% [markdown]
# Now you steer. The slider sets the turn rate, to the left in the first circle and to the right in
# the second. It starts with a car that turns too slowly.


# %% tags=["hide-input"]
def steer(turn_rate, speed=0.98, slip=0.0):
    left = torch.tensor([[speed, turn_rate]] * 64)
    right = torch.tensor([[speed, -turn_rate]] * 64)
    states = drive(pp.DubinsCar(dt, slip), start, torch.cat([left, right]))
    fig, ax = plt.subplots(figsize=(7, 4.2))
    plotting.infinity_axes(ax, margin=1.3).set_ylim(-2.4, 3)
    plotting.plot_waypoints(ax, infinity.waypoints())
    plotting.plot_states(ax, states, label="car")
    ax.legend(loc="lower left")
    return fig


widgets.panels(
    steer,
    [0.85, 0.92, 0.98, 1.1, 1.5],
    "turn rate (rad/s)",
    alt="The way of the car for the chosen turn rate. In the middle of the "
    "slider it passes the waypoints; at smaller rates its circles do not "
    "close, at larger ones it turns too far.",
)

# %% tags=["remove-cell"]
widgets.live(
    steer,
    alt="The way of the car for the chosen turn rate, speed and slip.",
    turn_rate=ipywidgets.FloatSlider(0.98, min=0.2, max=2.0, step=0.01),
    speed=ipywidgets.FloatSlider(0.98, min=0.2, max=1.5, step=0.01),
    slip=ipywidgets.FloatSlider(0.0, min=0.0, max=0.2, step=0.01),
)

# %% [markdown]
# ## Controllability: the parked car
#
# A waypoint lies half a metre to the left of a parked car. Can the linearised car reach it?
# <!-- given: half a metre, half -->
#
# Near the parked car the deviations of state and input follow a linear model,
# $x_{k+1} = A x_k + B u_k$. Start it at zero. After three steps it is at
# $x_3 = B u_2 + A B u_1 + A^2 B u_0$. The inputs are ours to choose, so we can reach all
# combinations of the columns of $B$, $AB$ and $A^2B$, and nothing else. If these columns span
# the whole space, the model can reach every state. This property is called {term}`controllability`
# {cite}`kalman1960control`. For a state of three numbers, further steps add no direction (the
# theorem of Cayley and Hamilton). So the test is the rank of one matrix:
# <!-- given: three steps -->


# %%
def reachable_directions(A, B):
    """Returns [B, AB, A²B], the controllability matrix for three states."""
    return torch.cat([B, A @ B, A @ A @ B], dim=-1)


# %% [markdown]
# **Predict.** The state $[i, j, \theta]$ has three numbers. What is the rank for the car that
# drives at 1 m/s along the $i$ axis, and what for the car that stands: 1, 2 or 3?

# %% tags=["answer"]
for v in (1.0, 0.0):
    A, B = jacobians_by_hand(theta=0.0, v=v, phi=0.0)
    rank = torch.linalg.matrix_rank(reachable_directions(A, B)).item()
    print("speed", v, "m/s: rank", rank)

# %% tags=["answer"]
generator = torch.Generator().manual_seed(1)
scale = torch.tensor([2.0, 6.0])  # m/s and rad/s
random_inputs = scale * torch.randn(8, 3000, 2, generator=generator)
nonlinear_end = drive(PoseCar(), torch.zeros(3000, 3), random_inputs)[:, -1]

A, B = jacobians_by_hand(theta=0.0, v=0.0, phi=0.0)
linear_end = torch.zeros(3000, 3)
for u in random_inputs:
    linear_end = linear_end @ A.T + u @ B.T

# %% tags=["answer", "hide-input"]
quarter = math.pi / 2 / dt  # rad/s: a quarter turn in one step
manoeuvre = torch.tensor([[0.0, quarter]] + [[1.0, 0.0]] * 5 + [[0.0, -quarter]])
parking = drive(PoseCar(), torch.zeros(3), manoeuvre)
fig, ax = plt.subplots(figsize=(7, 4.4))
sketches.car(ax, 0.0, 0.0, theta=0.0)
ax.plot(*nonlinear_end[:, :2].T, ".", ms=3, c=plotting.SKY, label="nonlinear car")
ax.plot(*linear_end[:, :2].T, "k|", ms=8, label="linearised car", zorder=4)
ax.plot(*parking[:, :2].T, ".-", c=plotting.GREEN, label="manoeuvre", zorder=5)
ax.plot(0, 0.5, "o", ms=8, color=plotting.RED, label="waypoint", zorder=6)
ax.set(aspect="equal", xlim=(-1.6, 1.6), ylim=(-0.9, 1.5))
ax.set(xlabel="i (m)", ylabel="j (m)")
ax.legend(loc="upper center", ncols=2, frameon=True)
plotting.show(
    fig,
    "A parked car, a waypoint beside it. The ends of random drives of the "
    "linearised car lie on one line through the car; those of the nonlinear car "
    "fill the plane.",
)

# %% tags=["answer", "claims"]
pairs = [jacobians_by_hand(theta=0.0, v=v, phi=0.0) for v in (1.0, 0.0)]
driving, parked = [reachable_directions(*pair) for pair in pairs]
claim("rank_driving", torch.linalg.matrix_rank(driving), equals=3)
claim("rank_parked", torch.linalg.matrix_rank(parked), equals=2)
claim("linear_sideways", linear_end[:, 1].abs().max(), equals=0, unit="m")
claim("nonlinear_sideways", nonlinear_end[:, 1].abs().max(), above=0.5, unit="m")
target = torch.tensor([0.0, 0.5, 0.0])
claim("parking_miss", (parking[-1] - target).abs().max(), below=1e-12, unit="m")

# %% [markdown] tags=["answer"]
# The rank is {claim}`rank_driving` for the driving car and {claim}`rank_parked` for the parked
# one. The driving car changes its heading, and then its speed carries it sideways. For the parked
# car we have $v = 0$ in {eq}`eq-1-jacobians`: driving moves $i$, turning moves $\theta$, and
# nothing moves $j$. The picture shows where random inputs lead in eight steps. All ends of the
# linearised car lie on one line. The nonlinear car leaves that line: it turns, drives, and turns
# back. <!-- given: eight steps -->

# %% [markdown]
# Sideways motion comes from the *product* of turning and driving, and a linear model has no
# products. Keep this in mind for chapters 2 and 3: a controller that linearises the car at rest
# does not know how to reach a waypoint beside it.

# %% [markdown]
# ## An unstable equilibrium: the pendulum
#
# In one respect the infinity is too kind: a car to which we do nothing stays where it is. A state
# that stays under a constant input, $f(x, u) = x$, is called an {term}`equilibrium`. A pendulum
# without torque has two of them, hanging and standing upright. Its state is the angle from upright
# and the angular velocity, $x = [\theta, \omega]$, and its input is a torque at the hinge.
#
# Near an equilibrium, {eq}`eq-1-linear` multiplies a deviation by $A$ in every step, so that
# $\delta x_k = A^k \, \delta x_0$. A deviation along an eigenvector with the eigenvalue $\lambda$
# becomes $\lambda^k$ times as large. If all $|\lambda|$ are below 1, every small deviation dies
# out, and the equilibrium is asymptotically {term}`stable <stability>`. If one is above 1, some
# deviations grow exponentially, and it is unstable.

# %%
pendulum = pp.Pendulum(dt=0.05)
no_torque = torch.zeros(1)
for name, angle in (("upright", 0.0), ("hanging", math.pi)):
    rest = torch.tensor([angle, 0.0])
    A = pendulum.linearize(rest, no_torque).A
    size = torch.linalg.eigvals(A).abs().max()
    print(f"{name}: largest absolute eigenvalue {size:.4f}")

# %% [markdown]
# **Predict.** Let the pendulum go at 0.01 rad from upright, about half a degree. After two
# seconds, is it still within 0.1 rad, at about 0.5 rad, or has it fallen past the horizontal?
# <!-- given: 0.01 rad, half a degree, half, two seconds, 0.1 rad, 0.5 rad -->

# %% tags=["answer", "hide-input"]
away = torch.tensor([0.01, 0.0])
hanging = torch.tensor([math.pi, 0.0])
A_upright = pendulum.linearize(torch.zeros(2), no_torque).A
falling = drive(pendulum, away, torch.zeros(50, 1))
swinging = drive(pendulum, hanging + away, torch.zeros(50, 1))
powers = [torch.linalg.matrix_power(A_upright, k) for k in range(51)]
linear = torch.stack(powers) @ away
time = 0.05 * torch.arange(51)
fig, ax = plt.subplots(figsize=(7, 3.8))
ax.plot(time, falling[:, 0], label="upright, let go")
ax.plot(time, linear[:, 0], "--", label="upright, linearised")
ax.plot(time, swinging[:, 0] - math.pi, "-.", label="hanging, let go")
ax.axhline(math.pi / 2, color=plotting.GREY, ls=":", label="horizontal")
ax.set(xlabel="time (s)", ylabel="angle from\nequilibrium (rad)", ylim=(-0.3, 5.2))
ax.legend(loc="upper left")
plotting.show(
    fig,
    "The upright pendulum falls faster and faster; its linear model agrees at "
    "first and then runs away. The hanging pendulum stays where it is.",
)

# %% tags=["answer", "claims"]
eigenvalue = torch.linalg.eigvals(A_upright).abs().max()
claim("upright_eigenvalue", eigenvalue, equals=1.167, within=0.001)
claim("fallen_angle", falling[40, 0], above=math.pi / 2, unit="rad")
claim("fall_factor", falling[20, 0] / away[0], above=10, below=14)
agrees = (linear[30, 0] / falling[30, 0] - 1) * 100
claim("linear_agrees_at", falling[30, 0], above=0.5, below=0.6, unit="rad")
claim("linear_agrees", agrees, above=0, below=1, unit="%")
largest_swing = (swinging[:, 0] - math.pi).abs().max()
claim("hanging_stays", largest_swing, below=0.011, unit="rad")

# %% [markdown] tags=["answer"]
# It has fallen past the horizontal, to {claim}`fallen_angle`. Each step of 0.05 s multiplies the
# growing part of the deviation by {claim}`upright_eigenvalue`, so that after one second the angle
# is {claim}`fall_factor` times as large. The linear model describes the fall well for a long time:
# at {claim}`linear_agrees_at` it is off by {claim}`linear_agrees`. Then it runs away, while the
# nonlinear pendulum swings around. The hanging pendulum never deviates by more than
# {claim}`hanging_stays`. <!-- given: 0.05 s, one second -->

# %% [markdown]
# For the car all eigenvalues of $A$ are 1, as {eq}`eq-1-jacobians` shows. Its errors grow
# slowly, and open loop works for a while. It cannot hold an unstable equilibrium, because the
# smallest deviation grows. Chapter 2 holds the pendulum upright, by feedback.

# %% [markdown]
# ## How we know: two tests, and a fault that one of them misses
#
# A wrong model raises no error; it only drives a little differently. How do we know that $f$,
# $A$ and $B$ are right? The first test is for the Jacobians. Equation {eq}`eq-1-linear` leaves
# out terms of second order. If a change becomes ten times smaller, the error of the linear model
# must become a hundred times smaller. On logarithmic axes that is a line of slope 2. A matrix with
# one wrong entry leaves an error of first order, a line of slope 1.
# <!-- given: ten times, a hundred times -->

# %%
car = pp.DubinsCar(dt)
x = ideal[32]  # in the middle of the first circle
u = inputs[32]
A, B = car.linearize(x, u)[:2]

generator = torch.Generator().manual_seed(3)
direction = torch.randn(6, generator=generator)
sizes = torch.logspace(-4, 0, 20)
dx = sizes[:, None] * direction[:4]
du = sizes[:, None] * direction[4:]
exact = car.transition(x + dx, u + du)  # f alone: no clock advances


# %%
def linear_error(A, B):
    """Returns the error of the linear model for changes of all sizes."""
    linear = car.transition(x, u) + dx @ A.T + du @ B.T
    return (exact - linear).norm(dim=-1)


wrong = A.clone()
wrong[0, 2] = 0.0  # the change of i with the cosine is lost

# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 3.8))
ax.loglog(sizes, linear_error(A, B), ".-", label="A of linearize")
ax.loglog(sizes, linear_error(wrong, B), "s--", ms=5, label="A with one entry lost")
ax.set(xlabel="size of the change", ylabel="error of the\nlinear model")
ax.legend()
plotting.show(
    fig,
    "The error of the linear model falls with slope 2 for the right matrix and "
    "with slope 1 for the matrix that has lost an entry.",
)


# %% tags=["claims"]
def slope(error):
    """Returns the slope on logarithmic axes, over the smaller changes."""
    return (error[8] / error[0]).log() / (sizes[8] / sizes[0]).log()


claim("taylor_slope", slope(linear_error(A, B)), equals=2, within=0.05)
claim("wrong_slope", slope(linear_error(wrong, B)), equals=1, within=0.1)

# %% [markdown]
# The slopes are {claim}`taylor_slope` and {claim}`wrong_slope`. The second test needs a recorded
# drive. Predict each state from the one before it. What remains is the {term}`one-step residual`,
# $x_{k+1} - f(x_k, u_k)$, and for the right model without noise it is zero.
#
# Now try both tests on the paper's first listing, which runs word for word:


# %% tags=["as-printed"]
class DubinsCar(pp.module.NLS):
    # A 2-D DubinsCar kinematic model.
    def __init__(self, dt=0.1):
        super().__init__()
        self.dt = dt

    def state_transition(self, x, u, t=None):
        v, phi = u[..., 0], u[..., 1]
        c, s = x[..., 2], x[..., 3]
        theta = torch.atan2(s, c) + phi * dt

        i = x[..., 0] + v * c * dt
        j = x[..., 1] + v * s * dt
        c, s = theta.cos(), theta.sin()
        return torch.stack([i, j, c, s], dim=-1)

    def observation(self, x, u, t):
        return x


# %% [markdown]
# And so does the second listing, but for the letter that counts the steps:

# %%
N = len(inputs) + 1
listing = DubinsCar()
listing_states = torch.zeros(N, 4)
listing_states[0] = start
y = torch.zeros(N - 1, 4)
for k in range(N - 1):
    listing_states[k + 1], y[k] = listing(listing_states[k], inputs[k])

# %% [markdown]
# **Predict.** Compare the listing with {eq}`eq-1-turn` to {eq}`eq-1-j`: where does it differ? We
# record a drive of the library's car. Which test shows that the listing is another model: the
# slope, the residual, or both?

# %% tags=["answer", "hide-input"]
residual = (ideal[1:] - listing.transition(ideal[:-1], inputs))[:, :2]
own_residual = ideal[1:] - car.transition(ideal[:-1], inputs)
fig, ax = plt.subplots(figsize=(7, 3.9))
plotting.plot_course(ax).set_ylim(-1.4, 1.8)
i, j = ideal[1::4, :2].T
di, dj = 30 * residual[::4].T
in_metres = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.004}
arrows = ax.quiver(i, j, di, dj, color=plotting.BLUE, zorder=5, **in_metres)
arrows.set_label("residual, 30 times as long")
ax.legend(loc="upper center", ncols=2)
plotting.show(
    fig,
    "The residual of the listing as arrows along the path: all have the same "
    "length and point to the inside of the circle on which the car drives.",
)

# %% tags=["answer", "claims"]
length = residual.norm(dim=-1)
claim("residual_level", length.mean(), above=0.009, below=0.01, unit="m")
claim("residual_spread", length.max() - length.min(), below=1e-9, unit="m")
centre = torch.tensor([[1.0, 0.0]] * 64 + [[-1.0, 0.0]] * 64)
inside = (residual * (centre - ideal[1:, :2])).sum(-1) > 0
claim("residual_inside", 100 * inside.double().mean(), equals=100, unit="%")
claim("residual_sum", residual.sum(0).norm(), below=1e-9, unit="m")
claim("right_residual", own_residual.abs().max(), below=1e-12)
A_listing, B_listing = listing.linearize(x, u)[:2]
linear = listing.transition(x, u) + dx @ A_listing.T + du @ B_listing.T
error = (listing.transition(x + dx, u + du) - linear).norm(dim=-1)
claim("listing_slope", slope(error), equals=2, within=0.05)
listing_error = infinity.tracking_error(listing_states).max()
claim("listing_error", listing_error, below=0.06, unit="m")
claim("y_is_old_state", torch.equal(y, listing_states[:-1]), equals=True)
other_step, _ = DubinsCar(dt=5.0)(start, inputs[0])
claim("dt_ignored", torch.equal(other_step, listing_states[1]), equals=True)

# %% [markdown] tags=["answer"]
# Only the residual shows it. The listing drives along the *old* heading, because it computes `c`
# and `s` anew only after `i` and `j`. (It also ignores its own `dt`: it keeps `self.dt` and
# then uses the global one.) Its Jacobians are the exact derivatives of its own $f$, so its slope
# is {claim}`listing_slope`. The residual has the same length in all steps,
# {claim}`residual_level`, about $v \varphi \, \Delta t^2$, and it always points to the inside of
# the curve. Along a full circle these residuals cancel. That is why a lap hides the fault: at its
# steps the listing's car is at most {claim}`listing_error` from the path, no further than ours.

# %% [markdown]
# Know what each test can see. The slope finds a wrong derivative of *this* $f$, even if $f$
# itself is wrong. The comparison with our own small car finds a wrong $f$, unless we made the
# same mistake twice. Only the residual on a recorded drive compares the model with the world.
# <!-- given: twice -->

# %% [markdown]
# ## Summary
#
# - A dynamic system is $x_{k+1} = f(x_k, u_k, t_k)$ with $y_k = g(x_k, u_k, t_k)$; the library's
#   car equals our own to {claim}`agrees_with_ours`, and its observation belongs to the state
#   before the step.
# - Open loop does not forgive: a slip of 5 % ends {claim}`slip_end` from the start, and with noise
#   the largest error in a lap is {claim}`noise_error` in the mean.
# - The discretisation is of first order: it costs {claim}`hand_error` on the lap, and
#   {claim}`short_step_error` with steps of half the length.
# - The controllability matrix of the linearised car has rank {claim}`rank_driving` while it
#   drives, but only {claim}`rank_parked` when it is parked; the upright pendulum is unstable, with
#   an eigenvalue of {claim}`upright_eigenvalue`.
# - Right Jacobians leave an error of slope {claim}`taylor_slope`; the old heading in $f$ leaves
#   a residual of {claim}`residual_level` in every step, which the slope does not show.
#   <!-- given: 5 %, half the length, half -->
#
# | | paper | here |
# |:--|:--|:--|
# | first two listings | run in PyPose | run word for word; drive along the old heading |
# | ideal car, Fig. 2 (a) | steered by MPC | open loop, {claim}`hand_error` at most |
# | noisy car, Fig. 2 (b) | steered by MPC | open loop, {claim}`noise_error` at most, in the mean |
#
# **What differs from PyPose.** In PyPose 0.9.5, `A` of a nonlinear system has four dimensions
# for a batch and carries no gradient to the model's parameters; ours is `(..., n, n)` and does.
# There a reference point that is set without a time moves with the clock; ours stays. There `LTI`
# takes no time argument; here every system does.
#
# **Words of this chapter.** {term}`dynamic system <dynamical system>`, {term}`state`,
# {term}`input`, {term}`observation`, {term}`state-space model`, {term}`process noise`,
# {term}`observation noise`, {term}`open loop`, {term}`feedback`, {term}`unicycle`,
# {term}`nonholonomic <nonholonomic system>`, {term}`discretisation`, {term}`linearisation`,
# {term}`Jacobian`, {term}`batch`, {term}`controllability`, {term}`equilibrium`, {term}`stability`,
# {term}`one-step residual`.
#
# **Further reading.** {cite:t}`astrom2021` introduce models, stability and controllability, with
# examples from biology to aircraft. {cite:t}`lavalle2006` treats cars that cannot move sideways in
# his chapter 13. {cite:t}`kalman1960control` introduced controllability.
#
# **In the lab** you compute a Jacobian by hand, find the bug in a clock, write the model of a
# bicycle, write a test that tells two models apart, design a model to a given accuracy, and send
# the inputs of this chapter to a simulated Go1.
#
# Next: [chapter 2](02_lqr.py) uses $A$ and $B$ to compute feedback.
