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
# A robot that plans has to know what its commands will do. In this chapter you write that down for
# a small car, in three lines of mathematics and a few of torch, and everything in this book stands
# on those lines.
#
# After it you can
#
# - say what a state, an input and an observation are, and which time step each belongs to;
# - write a system as the paper {cite}`pypose06` does, and step one car or a thousand in one call;
# - make it linear at a point, and test that the matrices are right;
# - find three common faults by one plot;
# - learn an unknown number of the car from a recorded drive.
#
# You need Python, a first acquaintance with torch tensors, and what a derivative is. Take about
# 90 minutes. The chapter reproduces the paper's equations (1) and (2) and its first two listings.
# <!-- given: 90 minutes -->

# %%
import inspect
import math

import ipywidgets
import matplotlib.pyplot as plt
import torch
from IPython.display import display

import pypose_lite as pp
from pypose_lite import go1, infinity
from pypose_lite.teaching import claim, plotting, table, widgets

plotting.use_style()
torch.set_default_dtype(torch.float64)  # so that no error we see is rounding
dt = 0.1  # s, one time step


# %% tags=["hide-input"]
def roll(car, x, u):
    """The states of a car that is given the inputs u one after the other."""
    states = [x]
    for i in range(u.shape[-2]):
        states.append(car(states[-1], u[..., i, :])[0])
    return torch.stack(states, dim=-2)


turn = 2 * math.pi / (64 * dt)  # rad/s: once around in 64 steps
u = torch.tensor([[turn, turn]] * 64 + [[turn, -turn]] * 64)  # speed = 1 m x turn
fig, (left, right) = plt.subplots(1, 2, figsize=(7, 2.8), width_ratios=[1.5, 1])
x = roll(pp.DubinsCar(dt), infinity.waypoints()[0], u)
plotting.plot_states(plotting.plot_course(left), x, label="car")
fig.legend(*left.get_legend_handles_labels(), loc="outside lower left", ncols=3)
right.plot(dt * torch.arange(128), u, label=["speed (m/s)", "turn rate (rad/s)"])
right.set(xlabel="time (s)", ylabel="input", ylim=(-1.2, 1.7))
right.legend(loc="upper right")
plt.show()
claim("hand_error", infinity.tracking_error(x).max(), below=0.06, unit="m")
claim("hand_end", x[-1, :2].norm(), below=1e-9, unit="m")

# %% [markdown]
# This is the example of the whole book: a car that draws an infinity sign. Two circles of radius
# 1 m touch at the origin. The car starts there, facing down, goes around the right circle
# counter-clockwise, then around the left one clockwise. The 17 red waypoints are 45 degrees apart;
# the first, the middle and the last lie on each other.
#
# No computer was needed for the inputs on the right. Once around in 64 steps of 0.1 s takes a turn
# rate of $2\pi / (64 \cdot 0.1)$ rad/s. On a circle of radius 1 m the speed in m/s is the same
# number. Unfold the code above the figure: `u` holds these inputs, and `roll` gives them to a car
# one after the other. Both will be used again and again.
#
# The car is at most {claim}`hand_error` from the path. Hold on to that number: the inputs were
# exact, so why is it not zero?

# %% [markdown]
# ## See it fail
#
# Nobody looked where the car went. Inputs that are fixed beforehand are called *open loop*, and
# they work as long as the car is exactly the one that we thought of. Let its wheels slip, so that
# they lose 5 % of the turn rate. <!-- given: 5 % -->
#
# **Predict.** After the lap, how far from the start does the slipping car stop: about 5 cm, about
# 30 cm, or more than half a metre? <!-- given: 5 cm, 30 cm -->

# %%
slipping = roll(pp.DubinsCar(dt, slip=0.05), x[0], u)
fig, ax = plt.subplots(figsize=(7, 3.6))
plotting.infinity_axes(ax).set_ylim(-1.3, 2.2)
curve = infinity.reference(torch.linspace(0, infinity.LENGTH, 200))
plotting.plot_reference(ax, curve)
plotting.plot_waypoints(ax, infinity.waypoints())
plotting.plot_states(ax, slipping, label="5 % slip")
ax.legend(loc="upper center", ncols=3)
plt.show()
claim("slip_end", slipping[-1, :2].norm(), above=0.5, unit="m")
claim("slip_error", infinity.tracking_error(slipping).max(), above=0.5, unit="m")

# %% [markdown]
# <details><summary>Answer</summary>
#
# More than half a metre: {claim}`slip_end`. A turn rate that is a little too small is not a small
# error in position. The missing angle grows step by step, and the car drives along the wrong
# heading ever after.
#
# </details>
#
# Chance does it too. Disturb every component of the state by a random number in every step, with a
# standard deviation of 0.005: this is the book's *process noise*, and it never stops.
#
# **Predict.** A thousand cars drive four laps with noise instead of one. Does their mean distance
# from the noiseless car become twice, four times or eight times as large?


# %%
def shaken(u):
    """States of 1000 noisy cars, and their mean distance from the noiseless one."""
    car, states = pp.DubinsCar(dt), [x[0].expand(1000, 4)]
    generator = torch.Generator().manual_seed(1)
    for i in range(len(u)):
        w = 0.005 * torch.randn(1000, 4, generator=generator)
        states.append(car(states[-1], u[i])[0] + w)
    states = torch.stack(states, dim=1)
    return states, (states - roll(car, x[0], u))[..., :2].norm(dim=-1).mean(0)


laps = torch.cat([u] * 4)
noisy, on_laps = shaken(laps)
_, on_road = shaken(laps * torch.tensor([1, 0]))  # the same speed, straight ahead
claim("noise_one_lap", on_laps[128], above=0.08, below=0.12, unit="m")
claim("noise_growth", on_laps[512] / on_laps[128], above=1.7, below=2.4)
claim("noise_growth_straight", on_road[512] / on_road[128], above=6, below=9)

# %% [markdown]
# <details><summary>Answer</summary>
#
# About twice ({claim}`noise_growth`, from {claim}`noise_one_lap` after one lap). Independent errors
# partly cancel: their sum grows like the square root of their number. But whoever said eight knew
# something too. On a straight road the factor is {claim}`noise_growth_straight`, because a wrong
# heading, itself such a sum, leads ever further aside. On circles it leads around and back.
#
# </details>
#
# Inputs that look at the car are the cure, and chapters 2 and 3 are about them. Both need a model
# of the car that they can ask "what if?". That model is our subject here.

# %% [markdown]
# ## From scratch
#
# What happens to the car in a tenth of a second? It turns a little, then it drives a little in the
# direction in which it now looks. That is the whole model.


# %%
def step(i, j, theta, v, phi):
    theta = theta + phi * dt  # turn,
    i = i + v * math.cos(theta) * dt  # then drive along the new heading
    j = j + v * math.sin(theta) * dt
    return i, j, theta


pose = (0.0, 0.0, 0.0)  # at the origin, looking along i
for _ in range(16):
    pose = step(*pose, v=turn, phi=turn)
print("after a quarter circle: i = {:.3f}, j = {:.3f}, theta = {:.3f}".format(*pose))
claim("quarter_offset", math.hypot(pose[0] - 1, pose[1] - 1), below=0.08, unit="m")

# %% [markdown]
# With the three lines in front of us, the equations, with $k$ counting the steps:
#
# $$ \theta_{k+1} = \theta_k + \varphi_k \, \Delta t $$ (eq-1-turn)
#
# $$ i_{k+1} = i_k + v_k \cos\theta_{k+1} \, \Delta t $$ (eq-1-i)
#
# $$ j_{k+1} = j_k + v_k \sin\theta_{k+1} \, \Delta t $$ (eq-1-j)
#
# $i$ and $j$ are the position in metres, $\theta$ is the heading in radians, counter-clockwise from
# the $i$ axis. Together they are the *state*: all that we have to know of the past to predict the
# future. $v$ is the speed in m/s and $\varphi$ the turn rate in rad/s. Together they are the
# *input*: what we may choose. $\Delta t$ is `dt`. A car like this is named after Dubins
# {cite}`dubins1957`; it cannot go sideways and has to turn to get anywhere but straight ahead.
#
# The quarter of a circle missed the point $(1, 1)$ by {claim}`quarter_offset`, and here is the
# answer to the question from above. A real car turns *while* it drives; ours turns first. So its
# circle is rotated by half of one step's turn. Models with time steps have such errors. Feedback
# forgives them, as we shall see; a sharper model or a smaller $\Delta t$ would shrink them.
#
# One thing is still unpleasant: $\theta = \pi$ and $\theta = -\pi$ are the same heading but
# different numbers. The mean of 179° and -179° is 0°, the opposite of what is meant.
# <!-- given: 179°, -179°, 0° -->
# The paper therefore keeps $\cos\theta$ and $\sin\theta$ in the place of $\theta$. The state
# becomes $x = [i, j, \cos\theta, \sin\theta]$, four numbers without a jump, and the input
# $u = [v, \varphi]$.
#
# Every system of this book then has the same form:
#
# $$ x_{k+1} = f(x_k, u_k, t_k) + w_k, \qquad y_k = g(x_k, u_k, t_k) + v_k $$ (eq-1-system)
#
# $f$ is the *transition*: for the car, equations {eq}`eq-1-turn` to {eq}`eq-1-j`. $g$ is the
# *observation*: what sensors see of the state, here all of it. $t_k$ is the time, for systems that
# change with it. $w_k$ is the process noise that you have met, $v_k$ the noise of the sensors (the
# paper's letter, not our speed); chapter 4 is about living with both.

# %% [markdown]
# ## The library's version
#
# In the library a system is a class with two functions, $f$ and $g$. Here is the car's $f$, whole.
# The numbers at the ends of the lines are those of the equations in its docstring. `unbind(-1)`
# takes the state apart along its last dimension, so that any number of dimensions may come before
# it.

# %%
print(inspect.getsource(pp.DubinsCar.state_transition))

mine = [(0.0, 0.0, -math.pi / 2)]
for v, phi in u.tolist():
    mine.append(step(*mine[-1], v, phi))
i, j, theta = torch.tensor(mine).unbind(-1)
difference = torch.stack([i, j, theta.cos(), theta.sin()], dim=-1) - x
claim("agrees_with_ours", difference.abs().max(), below=1e-12)

# %% [markdown]
# Calling the car takes one step: `x_next, y = car(x, u)`. This is all that a call does:

# %%
print(inspect.getsource(pp.System.forward).split('"""')[2])
print(inspect.getsource(pp.System._tick))

# %% [markdown]
# It checks the shapes, calls $f$ and $g$, and then the clock ticks. Nothing else ticks it. Note
# which state the observation is made of: the *old* one. `y[i]` belongs to `x[i]`, not to `x[i+1]`.
# All filters of chapters 4 and 5 rest on this, and "Break it" shows what an error here costs.
#
# Your own system is a subclass. This is the paper's listing, word for word:


# %%
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
# Read it closely before you run it; two things differ from the equations {eq}`eq-1-turn` to
# {eq}`eq-1-j`.
#
# **Predict.** Which two? And over the lap, does the listing's car part from ours more and more, or
# does their distance stay below some bound?

# %%
N = len(x)
states, y = torch.zeros(N, 4), torch.zeros(N - 1, 4)
states[0] = x[0]
car = DubinsCar()
for i in range(N - 1):
    states[i + 1], y[i] = car(states[i], u[i])

print("the clock shows", car.systime.item())
claim("y_is_old_state", torch.equal(y, states[:-1]), equals=True)
apart = (states - x)[:, :2].norm(dim=-1).max()
claim("parted", apart, equals=2 * turn * dt, within=1e-6, unit="m")
claim("listing_error", infinity.tracking_error(states).max(), below=0.06, unit="m")
other, _ = DubinsCar(dt=5.0)(x[0], u[0])
claim("dt_ignored", torch.equal(other, states[1]), equals=True)

# %% [markdown]
# <details><summary>Answer</summary>
#
# The listing drives along the *old* heading: `c` and `s` are only renewed after `i` and `j`. And it
# keeps `self.dt` but uses the global `dt`, so that `DubinsCar(dt=5.0)` drives like any other.
# <!-- given: 5.0 -->
#
# The distance stays bounded. The two cars use the same headings, one step apart: only the first and
# the last one differ, which makes at most $2 v \, \Delta t$ (here {claim}`parted`). Neither is
# nearer to the true circle: both are off by {claim}`listing_error` at most, rotated by half a step
# in opposite directions. The library follows the paper's equations.
#
# </details>
#
# ### A thousand cars in one call
#
# The noisy cars above were a *batch*: a tensor of shape `(1000, 4)` went in and the same shape came
# out. Batch dimensions come first, vectors last, everywhere in the library. A batch gives what a
# loop over its members gives; it is only faster.

# %%
car, cars = pp.DubinsCar(dt), noisy[:, 128]
batch = car(cars, u[0])[0]
loop = torch.stack([car(one, u[0])[0] for one in cars])
print(tuple(cars.shape), "->", tuple(batch.shape))
claim("batch_equals_loop", (batch - loop).abs().max(), below=1e-12)

# %% [markdown]
# ### The car, made linear
#
# Near a point, any smooth $f$ is nearly a matrix times the change:
#
# $$ f(x + \delta x, u + \delta u) \approx f(x, u) + A \, \delta x + B \, \delta u $$ (eq-1-linear)
#
# $A$ has a row for each component of the next state and a column for each one of this state; $B$
# has a column for each input. They are the derivatives of $f$, and torch works them out:
# `linearize` pulls one unit vector after the other back through $f$. Here the car is in the middle
# of the first circle, looking up.

# %%
x_mid, u_mid = x[32], u[32]
A, B, C, D, c1, c2 = pp.DubinsCar(dt).linearize(x_mid, u_mid)
torch.set_printoptions(precision=3, sci_mode=False)
print("A =", A, "\nB =", B, sep="\n")
claim("forgotten_length", A[2:, 2:].det(), equals=0, within=1e-12)

h, f = 1e-6, pp.DubinsCar(dt).transition  # f ticks no clock
rows = f(x_mid + h * torch.eye(4), u_mid) - f(x_mid - h * torch.eye(4), u_mid)
claim("finite_differences", (rows.mT / (2 * h) - A).abs().max(), below=1e-8)

# %% [markdown]
# Read $B$'s first column: a faster car gets further up, by nearly $\Delta t$ for each m/s. Read the
# lower right quarter of $A$: its determinant is zero, because each step forgets the length of the
# vector $[\cos, \sin]$. Only its direction counts.

# %% [markdown]
# ## On the infinity
#
# The paper's Fig. 2 has two panels, the ideal car and the car with noise, and so has ours. There a
# controller steers; here still nobody looks. Chapter 3 draws them with its controller.

# %%
fig, panels = plt.subplots(1, 2, figsize=(7, 2.6), sharey=True)
for ax, title in zip(panels, ["(a) ideal", "(b) with noise"]):
    plotting.infinity_axes(ax, title)
    plotting.plot_waypoints(ax, infinity.waypoints())
    ax.label_outer()
i, j = noisy[1:31, :129, :2].permute(2, 1, 0)
others = panels[1].plot(i, j, color=plotting.GREY, lw=0.4)
others[0].set_label("30 other cars")
plotting.plot_states(panels[0], x)
plotting.plot_states(panels[1], noisy[0, :129], label="car")
handles, _ = panels[1].get_legend_handles_labels()
_ = fig.legend(handles=handles, loc="outside lower center", ncols=3)

# %% mystnb={"markdown_format": "myst"}
one_lap, rows = noisy[:, :129], []
runs = {"ideal": x[None], "slips": slipping[None], "1000 with noise": one_lap}
for name, run in runs.items():
    error, end = infinity.tracking_error(run), run[:, -1, :2].norm(dim=-1)
    cells = error.mean(), error.amax(1).mean(), end.mean()
    rows.append(" | ".join([name, *(f"{cell:.3f}" for cell in cells)]))
display(table("car | mean error (m) | largest (m) | end to start (m)", rows))
largest = infinity.tracking_error(one_lap).amax(1)
claim("noise_error", largest.mean(), above=0.12, below=0.18, unit="m")
claim("beyond_tolerance", 100 * (largest > 0.1).double().mean(), above=60, unit="%")

# %% [markdown]
# The error of a state is its distance from the nearer circle (`infinity.tracking_error`). On
# average a noisy car strays {claim}`noise_error` at its worst, and {claim}`beyond_tolerance` of all
# cars leave the band of 0.1 that this book allows around a waypoint.
#
# Now you steer. The slider sets the turn rate: to the left for the first half of the lap, to the
# right for the second.


# %%
def steer(turn_rate, speed=turn, slip=0.0):
    inputs = torch.tensor([[speed, turn_rate]] * 64 + [[speed, -turn_rate]] * 64)
    states = roll(pp.DubinsCar(dt, slip), infinity.waypoints()[0], inputs)
    fig, ax = plt.subplots(figsize=(7, 3.8))
    plotting.infinity_axes(ax, margin=1.3).set_ylim(-2.4, 3)
    plotting.plot_waypoints(ax, infinity.waypoints())
    plotting.plot_states(ax, states, label="car")
    ax.legend(loc="lower left")
    return fig


widgets.panels(steer, [0.85, 0.92, 0.98, 1.1, 1.5], "turn rate (rad/s)")

# %% [markdown]
# In JupyterLab there are three more sliders below. Give the car a slip, then find the turn rate
# that brings it back onto the waypoints. Then you have done by eye what "Differentiate through it"
# does by gradient.

# %% tags=["remove-cell"]
widgets.live(
    steer,
    turn_rate=ipywidgets.FloatSlider(0.98, min=0.2, max=2.0, step=0.01),
    speed=ipywidgets.FloatSlider(0.98, min=0.2, max=1.5, step=0.01),
    slip=ipywidgets.FloatSlider(0.0, min=0.0, max=0.2, step=0.01),
)

# %% [markdown]
# ## Break it
#
# A wrong model does not crash. It drives, a little differently. But there is one plot that shows
# most faults: take a recorded drive, predict each state from the one before, and plot what is left,
# the *one-step residual* $x_{k+1} - f(x_k, u_k)$. For the right model it is zero. Three faults: the
# paper's old heading; inputs that are paired with the states one step late; and a heading kept as
# an angle that a sensor wraps into $(-\pi, \pi]$.

# %%
old, late = x[1:] - DubinsCar().transition(x[:-1], u), x[2:] - f(x[1:-1], u[:-1])
faults = {
    "old heading (m)": old[:, :2].norm(dim=-1),
    "inputs one step late (rad)": late[:, 2:].norm(dim=-1),
    "wrapped (rad)": (torch.atan2(x[:, 3], x[:, 2]).diff() - u[:, 1] * dt).abs(),
}
fig, panels = plt.subplots(1, 3, figsize=(7, 2.2))
for ax, (title, residual) in zip(panels, faults.items()):
    ax.plot(dt * torch.arange(128)[-len(residual) :], residual, label="faulty model")
    ax.axhline(0, color=plotting.GREY, ls="--", lw=1, label="right model")
    ax.set(xlabel="time (s)")
    ax.set_title(title, size=9)
panels[0].set(ylabel="residual", ylim=(-0.001, 0.014))
panels[0].legend(loc="center")
plt.show()
level, late, wrapped = faults.values()
claim("old_heading_level", level.mean(), above=0.009, below=0.01, unit="m")
claim("late_spikes", (late > 1e-9).sum(), equals=1)
claim("wrap_spikes", (wrapped > 3).sum(), equals=2)
claim("right_residual", (x[1:] - f(x[:-1], u)).abs().max(), below=1e-12)

# %% [markdown]
# - **Old heading.** A constant level, $v \varphi \, \Delta t^2$ = {claim}`old_heading_level`: small
#   in each step and always in the same direction. Fix: renew the heading before it is used.
# - **One step late.** Nothing at all, but for {claim}`late_spikes` spike, where the turn rate
#   changes its sign. As long as the input is constant, nobody sees that it is the wrong one. Fix:
#   pair `y[i]` with `u[i]` and `x[i]`, and test on drives whose inputs change.
# - **Wrapped angle.** {claim}`wrap_spikes` spikes of $2\pi$, one on each circle, where the heading
#   crosses $\pi$. A controller would answer them with a full turn. Fix: keep cosine and sine.

# %% [markdown]
# ## Verify
#
# The matrices $A$ and $B$ will be used by everything that follows, so test them. Equation
# {eq}`eq-1-linear` leaves out terms of second order: if the change is ten times smaller, its error
# has to be a hundred times smaller. On logarithmic axes that is a line of slope 2. A matrix with
# one wrong entry leaves a part of first order, slope 1.

# %%
direction = torch.randn(6, generator=torch.Generator().manual_seed(3))
sizes = torch.logspace(-4, 0, 20)[:, None]
dx, du = (sizes * direction).split([4, 2], dim=-1)
exact = f(x_mid + dx, u_mid + du)
wrong = A * (torch.arange(16).reshape(4, 4) != 2)  # loses di'/dcos
fig, ax = plt.subplots(figsize=(7, 3))
slopes = []
for matrix, name in ((A, "A of linearize"), (wrong, "A with one entry lost")):
    linear = f(x_mid, u_mid) + pp.bmv(matrix, dx) + pp.bmv(B, du)
    error = (exact - linear).norm(dim=-1)
    slopes.append((error[8] / error[0]).log() / (sizes[8] / sizes[0]).log())
    ax.loglog(sizes, error, ".-" if matrix is A else "s--", ms=5, label=name)
ax.set(xlabel="size of the change", ylabel="error of the linear model")
ax.legend()
plt.show()
claim("taylor_slope", slopes[0], equals=2, within=0.05)
claim("wrong_slope", slopes[1], equals=1, within=0.1)

# %% [markdown]
# Know what each test can see. The slope finds a wrong derivative of *this* $f$; the listing's car
# would pass it too, for its derivatives are right and its $f$ is another. The comparison with our
# own `step` finds a wrong $f$, unless we made the same mistake twice. "A batch equals a loop" finds
# mixed-up members and nothing else. Only the residual on a recorded drive compares the model with
# the world.

# %% [markdown]
# ## Differentiate through it
#
# Back to the slipping car. All we have now is a recording: one lap of open-loop driving, seen by a
# sensor with noise of 0.02 in each component. What is its slip? Every number of a model may be a
# tensor that wants a gradient; so drive the model, compare, go downhill.
# <!-- given: 0.02 -->

# %%
noise = 0.02 * torch.randn(slipping.shape, generator=torch.Generator().manual_seed(2))
recorded = slipping + noise
slip = torch.tensor(0.3, requires_grad=True)  # a bad guess
path = []
for _ in range(20):
    loss = (roll(pp.DubinsCar(dt, slip), x[0], u) - recorded).square().mean()
    path.append((slip.item(), loss.item()))
    (gradient,) = torch.autograd.grad(loss, slip)
    slip = (slip - 0.006 * gradient).detach().requires_grad_()
claim("slip_learned", slip, equals=0.05, within=0.003)

# %%
grid = torch.linspace(-0.2, 0.3, 51)
with torch.no_grad():  # 51 cars, each with a slip of its own
    drives = roll(pp.DubinsCar(dt, grid), x[0].expand(51, 4), u.expand(51, 128, 2))
losses = (drives - recorded).square().mean((-1, -2))
fig, ax = plt.subplots(figsize=(7, 3))
ax.plot(grid, losses, color=plotting.GREY, label="loss of 51 cars, in one batch")
ax.plot(*zip(*path), "o-", color=plotting.RED, ms=4, label="gradient descent")
ax.axvline(0.05, color=plotting.GREEN, ls="--", label="true slip")
ax.set(xlabel="slip", ylabel="mean squared error")
_ = ax.legend()

# %% [markdown]
# The slip comes out as {claim}`slip_learned`. The gradient went backwards through 128 steps of the
# car, and nothing had to be derived by hand. The grey curve is a second use of batches: 51 cars
# with 51 slips, in one call. It also shows the limit of the method: downhill leads to the *next*
# valley, and here we started in the right one, if far up its slope.

# %% [markdown]
# ## On the robot
#
# The same inputs, given to a simulated Unitree Go1. `go1.connect` takes an address; with `"sim"`
# the robot lives in this program, and with another address it is a real one. Nothing in this book
# was tried on a real robot.
#
# **Predict.** The dog follows each command with a lag, of which our model knows nothing. Will it
# leave the path, or only be late on it?

# %%
with go1.connect("sim") as robot:
    poses, truth = [robot.pose()], [robot.simulator.dog.pose]
    for v, phi in u.tolist():
        robot.move(v, phi)
        robot.wait(dt)
        poses.append(robot.pose())
        truth.append(robot.simulator.dog.pose)
ahead, left, heading = torch.tensor(poses).unbind(-1)  # from where it stood
dog = torch.stack([left, -ahead, heading.sin(), -heading.cos()], dim=-1)
wander = (torch.tensor(truth) - torch.tensor(poses))[:, :2].norm(dim=-1)
fig, ax = plt.subplots(figsize=(7, 3.4))
plotting.plot_waypoints(plotting.infinity_axes(ax), infinity.waypoints())
plotting.plot_states(ax, dog, label="the dog, as it says")
ax.legend(loc="upper center", ncols=2)
plt.show()
claim("dog_error", infinity.tracking_error(dog).max(), below=0.08, unit="m")
claim("dog_short", dog[-1, :2].norm(), above=0.1, below=0.25, unit="m")
claim("dog_wander", wander.max(), above=0.01, below=0.1, unit="m")

# %% [markdown]
# <details><summary>Answer</summary>
#
# It is late: at the end of the lap it is {claim}`dog_short` short of the start, but never more than
# {claim}`dog_error` from the path. A curve is drawn by the ratio of turn rate and speed, and the
# lag delays both alike.
#
# </details>
#
# "As it says" is meant. The figure shows where the dog's odometry believes it is. The simulator
# knows better: the two differ by up to {claim}`dog_wander`, and open loop cannot even notice.
# Chapter 9 returns to this.

# %% [markdown]
# ## Summary
#
# - A system is $x_{k+1} = f(x_k, u_k, t_k)$ and $y_k = g(x_k, u_k, t_k)$. The library's car equals
#   our three lines to {claim}`agrees_with_ours`; `y[i]` belongs to `x[i]`.
# - Open loop, a slip of 5 % ends {claim}`slip_end` away, and noise leads {claim}`noise_one_lap`
#   away in a lap. <!-- given: 5 % -->
# - The paper's listing and its equations part by {claim}`parted` at most: old heading, new heading.
# - `linearize` gives $A$ and $B$; the error of the linear car falls with slope
#   {claim}`taylor_slope`.
# - One number of the car, learned through 128 steps: {claim}`slip_learned`, where 0.05 is true.
#
# | | paper | here |
# |:--|:--|:--|
# | the listing | runs in PyPose | runs word for word; drives with the old heading |
# | ideal car, Fig. 2 (a) | steered by MPC | steered by hand, {claim}`hand_error` at most |
#
# **What differs from PyPose.** In PyPose 0.9.5, `A` of a nonlinear system has four dimensions for a
# batch and carries no gradient to the model's parameters; ours is `(..., n, n)` and does. There a
# reference point set without a time moves with the clock; ours stays. There `LTI` takes no time
# argument; here every system does.
#
# **Further reading.** Åström and Murray {cite}`astrom2021` on models and feedback; LaValle
# {cite}`lavalle2006`, chapter 13, on cars like this one; the source of `pypose_lite/systems.py`.
#
# Next: [chapter 2](02_lqr.py) uses $A$ and $B$ to steer with open eyes.
