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
# # The linear quadratic regulator
#
# A tanker's autopilot keeps it on course with the rudder. Every movement of the rudder brakes the
# ship and costs fuel. Steering too little costs fuel as well, because the ship then wanders and its
# way becomes longer. In the 1970s engineers wrote both losses as squares, of the error of the
# course and of the rudder's angle, and asked for the steering with the least sum. The same question
# stands behind the control of satellites, of rockets and of walking robots. Its answer is the
# {term}`linear quadratic regulator <LQR>`, LQR. <!-- given: 1970s -->
#
# In this chapter it steers the car along the infinity. After it you can
#
# - say what you want by a cost, and choose its weights by a rule;
# - derive the best feedback by dynamic programming, and compute it in a few lines;
# - follow a curve, remove a constant error by integral action, and hold a pendulum upright;
# - test that a regulator is right, and say when it is the wrong tool.
#
# You need [chapter 1](01_systems.py): the car, its matrices $A$ and $B$, eigenvalues, and the
# upright pendulum. Take about 60 minutes. The paper introduces LQR {cite}`pypose06` and shows no
# figure of it; we draw the panels of its Fig. 2. <!-- given: 60 minutes -->

# %% tags=["setup"]
import contextlib
import math

import ipywidgets
import matplotlib.pyplot as plt
import torch
from IPython.display import display

import pypose_lite as pp
from pypose_lite import infinity
from pypose_lite.teaching import claim, plotting, table, widgets

plotting.use_style()
torch.set_default_dtype(torch.float64)
torch.set_printoptions(precision=3, sci_mode=False)

# %% [markdown]
# The car shall follow a *reference*: states that lie exactly on the two circles, and the inputs
# that lead from each to the next. Chapter 1's car turned before it drove, and left the circles a
# little. Here the first step turns by half as much as the others, and the step from one circle to
# the next not at all. Then every step begins and ends on a circle. A *policy* says what the input
# is in step $t$ if the state is $x$. <!-- given: half -->

# %%
dt = 0.1  # s, the length of one time step
T = 128  # steps for the lap
turn_rate = 2 * math.pi / (64 * dt)  # rad/s
speed = 2 * math.sin(turn_rate * dt / 2) / dt  # m/s, from point to point on a circle
turns = [turn_rate / 2] + [turn_rate] * 63 + [0.0] + [-turn_rate] * 63
u_ref = torch.stack([torch.full((T,), speed), torch.tensor(turns)], dim=-1)


def drive(car, policy, x, noise=0.0):
    """Returns the states and the inputs of a car that follows a policy."""
    generator = torch.Generator().manual_seed(1)
    states = [x]
    inputs = []
    for t in range(T):
        inputs.append(policy(t, states[t]))
        moved, observation = car(states[t], inputs[t])
        states.append(moved + noise * torch.randn(x.shape, generator=generator))
    return torch.stack(states, dim=-2), torch.stack(inputs, dim=-2)


# %%
def open_loop(t, x):
    return u_ref[t].expand(*x.shape[:-1], 2)


ideal_car = pp.DubinsCar(dt)
slipping_car = pp.DubinsCar(dt, slip=0.05)
x_ref, _ = drive(ideal_car, open_loop, infinity.waypoints()[0])


# %% tags=["hide-input"]
def library_policy():
    weights = torch.diag(torch.tensor([1, 1, 0.3, 0.3, 0.01, 0.01]))
    regulator = pp.LQR(ideal_car, weights, None, T)
    aims = {"target": x_ref[:-1], "u_target": u_ref}
    gains, _ = regulator.lqr_backward(x_ref[0], dt, u_ref, **aims)
    return lambda t, x: u_ref[t] + pp.bmv(gains[t], x - x_ref[t])


first_look = {"open loop": open_loop, "LQR": library_policy()}
fig, panels = plt.subplots(2, 1, figsize=(7, 7.5), height_ratios=[1.3, 1])
for ax, (name, policy) in zip(panels, first_look.items()):
    first_states, _ = drive(slipping_car, policy, x_ref[0], noise=0.005)
    plotting.plot_course(ax, name).set_ylim(-1.3, 2.6 if name == "open loop" else 1.3)
    plotting.plot_states(ax, first_states, label="car with slip and noise")
fig.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=3)
plotting.show(
    fig,
    "Two panels with the infinity sign. In open loop the car with slip and noise "
    "drifts away from it. With LQR the same car stays on it.",
)

# %% tags=["claims"]
claim("reference_error", infinity.tracking_error(x_ref).max(), below=1e-9, unit="m")
result_error = infinity.tracking_error(first_states).max()
claim("result_error", result_error, below=0.06, unit="m")

# %% [markdown]
# Both cars lose 5 % of each turn rate and are shaken by the same noise, and neither of them was
# told. The first one plays back `u_ref`. The second one adds a correction in each step: a matrix
# $K_t$ times the difference between its state and the reference. This chapter computes that matrix.
# <!-- given: 5 % -->

# %% [markdown]
# ## It fails: steering by feel
#
# Take the simplest task. The car drives at 1 m/s along the $i$ axis, but half a metre to the left
# of it. Two numbers matter, the offset from the line in metres and the heading in radians, and the
# only input is the turn rate. Their $A$ and $B$ are the rows and columns of $j$ and $\theta$ in
# chapter 1's matrices. <!-- given: half a metre, half -->

# %%
A_line = torch.tensor([[1.0, dt], [0.0, 1.0]])
B_line = torch.tensor([[dt**2], [dt]])
beside = torch.tensor([0.5, 0.0])  # m and rad


def steer(K, x, steps=60):
    """Returns all states [offset, heading] if the turn rate is K x."""
    states = [x]
    for t in range(steps):
        u = K @ states[t]
        states.append(A_line @ states[t] + B_line @ u)
    return torch.stack(states)


by_feel = torch.tensor([[-1.0, 0.0]])
swinging = steer(by_feel, beside)

# %% [markdown]
# The gain `by_feel` is common sense: who is left of the line steers to the right, the more the
# further away.
#
# **Predict.** What does the car do: does it settle on the line, swing for ever across it, or swing
# wider and wider?

# %% tags=["answer", "hide-input"]
fig, ax = plt.subplots(figsize=(7, 3))
with_heading = steer(torch.tensor([[-1.0, -1.0]]), beside)
ax.plot(dt * torch.arange(61), swinging[:, 0], ".-", label="by the offset")
ax.plot(dt * torch.arange(61), with_heading[:, 0], "--", label="and by the heading")
ax.axhline(0, color="black", lw=0.8)
ax.set(xlabel="time (s)", ylabel="offset (m)", ylim=(-0.6, 0.8))
ax.legend(loc="upper right", ncols=2)
plotting.show(
    fig,
    "Offset against time. Steered by the offset alone, the car swings across the "
    "line for ever; steered by the heading, too, it overshoots and settles.",
)

# %% tags=["answer", "claims"]
eigenvalues = torch.linalg.eigvals(A_line + B_line @ by_feel)
claim("by_feel_eigenvalue", eigenvalues.abs().max(), equals=1, within=1e-9)
claim("by_feel_late", swinging[31:, 0].abs().max(), above=0.49, below=0.51, unit="m")
overshoot = -with_heading[:, 0].min()
claim("with_heading_overshoot", overshoot, above=0.05, unit="m")

# %% [markdown] tags=["answer"]
# It swings for ever. When it reaches the line its heading is largest, and so it crosses. In the
# last three seconds it still strays {claim}`by_feel_late`: the closed loop $A + B K$ has
# eigenvalues of absolute value {claim}`by_feel_eigenvalue`. The steering must depend on the
# heading, too. The dashed curve tries a gain of the same size for it, and overshoots by
# {claim}`with_heading_overshoot`. <!-- given: three seconds -->

# %% [markdown]
# How much of each is best? By feel one can find two numbers. On the infinity the gain has eight
# numbers, and others in every step. We need a method.

# %% [markdown]
# ## The idea: a cost, and the bowl of what is still to pay
#
# First we say what we want. Collect state and input in $z = [x, u]$ and let each step cost
# $\tfrac12 z^\top Q z$. Over $T$ steps that is
#
# $$ J = \sum_{t=0}^{T-1} \tfrac12 z_t^\top Q\, z_t $$ (eq-2-cost)
#
# The diagonal of $Q$ holds the *weights*: prices for a squared metre, a squared radian, and so on.
# Its block for the state, $Q_{xx}$, may be zero for what does not matter but never negative, or
# straying would be rewarded: $Q_{xx} \ge 0$. The block of the input must be positive,
# $Q_{uu} > 0$, or inputs of any size would be free. Textbooks call the two blocks $Q$ and $R$.
#
# A good first choice is {term}`Bryson's rule`: write down which value of each quantity would be
# just acceptable, and take one over its square. All of them then cost the same when they are just
# acceptable.

# %%
acceptable = torch.tensor([0.1, 0.3, 0.3])  # offset (m), heading (rad), rate (rad/s)
Q_line = torch.diag(1 / acceptable**2)
print(Q_line)

# %% [markdown]
# Second, how do we find the best inputs? Not by searching through all sequences, but by thinking
# from the end. Let $J_t(x)$ be the least that the steps from $t$ on can cost if the state is $x$
# now. It is called the {term}`cost-to-go`. After the last step nothing is paid any more, so
# $J_T(x) = 0$. And whoever knows $J_{t+1}$ can find $J_t$ by looking only one step ahead:
#
# $$
# \begin{aligned}
# J_t(x) = \min_u \; & \tfrac12 z^\top Q\, z \\
# & + J_{t+1}(A x + B u)
# \end{aligned}
# $$ (eq-2-bellman)
#
# Pay for this step, and then whatever the next state costs. This is the
# {term}`Bellman equation`, and solving it from the last step to the first is called
# {term}`dynamic programming`. It works for every system and every cost, if one can store the
# function $J_t$. A table of it for the four numbers of the car's state, with 100 values of each,
# would have $100^4$ entries. In our case it is easier: $J_t$ is always a *bowl*, a quadratic
# function.

# %% tags=["hide-input"]
gain_for_bowl, bowl = pp.dlqr(A_line, B_line, Q_line[:2, :2], Q_line[2:, 2:])
offsets = torch.linspace(-0.6, 0.6, 61)
headings = torch.linspace(-1.2, 1.2, 61)
points = torch.cartesian_prod(offsets, headings)
heights = (pp.bvmv(points, bowl, points) / 2).reshape(61, 61)
rolling = [steer(-gain_for_bowl, torch.tensor(x)) for x in ([0.5, 0], [-0.3, -1])]

# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 4.4))
lines = ax.contour(offsets, headings, heights.mT, levels=[5, 20, 50, 100, 200, 350])
ax.clabel(lines, fmt="%g")
for path, style in zip(rolling, ["o-", "s-"]):
    label = f"a car that starts at {path[0, 0]:g} m, {path[0, 1]:g} rad"
    ax.plot(*path.mT, style, ms=4, label=label)
ax.plot(0, 0, "k*", ms=12, label="on the line")
ax.set(xlabel="offset (m)", ylabel="heading (rad)", ylim=(-1.2, 1.7))
ax.legend(loc="upper right")
plotting.show(
    fig,
    "The cost-to-go as a bowl, drawn by contour lines over offset and heading. They "
    "are tilted ellipses around the origin. Two cars run down across them into the "
    "origin.",
)

# %% tags=["claims"]
tilted, away = torch.tensor([[0.3, -0.6], [0.3, 0.6]])
claim("towards", tilted @ bowl @ tilted / 2, below=50)
claim("away", away @ bowl @ away / 2, above=100)

# %% [markdown]
# The lines connect states from which the same sum is still to pay. The bowl is tilted, and with
# good reason: a car at 0.3 m that already looks towards the line, by 0.6 rad, has only
# {claim}`towards` to pay, and one that looks away from it {claim}`away`. Every step of the best car
# leads down into the bowl. <!-- given: 0.3 m, 0.6 rad -->

# %% [markdown]
# ## Derived: one step, by completing the square
#
# **With numbers first.** Let the state be one number, $x' = x + u$, and each step cost
# $\tfrac12 x^2 + \tfrac12 u^2$. Suppose that the next state costs $\tfrac12 V x'^2$. What is the
# best $u$? Collect the terms with $u$ and complete the square:
#
# $$
# \begin{aligned}
# & \tfrac12 x^2 + \tfrac12 u^2 + \tfrac12 V (x + u)^2 \\
# & = \tfrac12 (1 + V) \Bigl(u + \frac{V}{1 + V}\, x\Bigr)^2 \\
# & \quad + \tfrac12 \Bigl(1 + \frac{V}{1 + V}\Bigr) x^2
# \end{aligned}
# $$ (eq-2-scalar)
#
# The square is never negative, and $u = -\tfrac{V}{1 + V} x$ makes it zero. What is left is again
# a number times $\tfrac12 x^2$. So the numbers run from the end to the beginning, $V = 0$ and then
# $1, \tfrac32, \tfrac85, \dots$, and they approach the golden ratio, {claim}`golden`.
#
# **With matrices** it is the same. With $F = [A \; B]$ the next state is $x' = F z$. If it costs
# $\tfrac12 x'^\top V x'$, this step and the future together cost $\tfrac12 z^\top H z$ with
#
# $$ H = Q + F^\top V F $$ (eq-2-curvature)
#
# Split $H$ into blocks, as $Q$ before. The terms with $u$ are $\tfrac12 u^\top H_{uu} u$ and
# $u^\top H_{ux} x$. With
#
# $$ K = -H_{uu}^{-1} H_{ux} $$ (eq-2-gain)
#
# the sum becomes a complete square in $u - K x$ and a rest without $u$:
#
# $$
# \begin{aligned}
# & \tfrac12 z^\top H z \\
# & = \tfrac12 (u - K x)^\top H_{uu} (u - K x) \\
# & \quad + \tfrac12 x^\top (H_{xx} + H_{ux}^\top K)\, x
# \end{aligned}
# $$ (eq-2-square)
#
# (Multiply out to check it. Since $H_{uu} K = -H_{ux}$, the mixed terms are right, and
# $K^\top H_{uu} K = -H_{ux}^\top K$ cancels.) $H_{uu}$ is positive because $Q_{uu}$ is, so the best
# input is $u = K x$, and the cost-to-go one step earlier is again a bowl, with
#
# $$ V_t = H_{xx} + H_{ux}^\top K $$ (eq-2-riccati)
#
# This is the {term}`Riccati equation`, published for control by {cite:t}`kalman1960control`. The
# best input turned out to be linear in the state, a feedback, although we never asked for one.

# %% [markdown]
# ## From scratch: the Riccati recursion
#
# One step is the three equations, and the recursion repeats it from the last step to the first.


# %%
def riccati_step(V, Q, A, B):
    """Returns the cost-to-go one step earlier and the gain of u = K x."""
    n = A.shape[-1]
    F = torch.cat([A, B], dim=-1)
    H = Q + F.mT @ V @ F  # (2.4)
    Hxx = H[:n, :n]
    Hux = H[n:, :n]
    Huu = H[n:, n:]
    K = -torch.linalg.solve(Huu, Hux)  # (2.5)
    V_before = Hxx + Hux.mT @ K  # (2.7)
    return (V_before + V_before.mT) / 2, K  # symmetric, whatever rounding does


def riccati_recursion(V, Q, A, B):
    """Returns the gains of all steps, the first one first, and its cost-to-go."""
    gains = []
    for t in reversed(range(len(A))):
        V, K = riccati_step(V, Q, A[t], B[t])
        gains.insert(0, K)
    return torch.stack(gains), V


# %%
steps = 60
A_steps = A_line.expand(steps, 2, 2)
B_steps = B_line.expand(steps, 2, 1)
gains, V_first = riccati_recursion(torch.zeros(2, 2), Q_line, A_steps, B_steps)
print("first gain:", gains[0])
print("last gain:", gains[-1])
print("from half a metre the least cost is", (beside @ V_first @ beside / 2).item())

# %% [markdown]
# The first gain answers our question: how much of the offset, and how much of the heading. The last
# one is zero, since after the last step nothing is paid.

# %% tags=["hide-input"]
best_line = steer(gains[0], beside)
pose = torch.tensor([0.0, 0.5, 1.0, 0.0])
real_offsets = [pose[1]]
for _ in range(steps):
    looks = torch.stack([pose[1], torch.atan2(pose[3], pose[2])])
    pose, _ = ideal_car(pose, torch.cat([torch.ones(1), gains[0] @ looks]))
    real_offsets.append(pose[1])
real_offsets = torch.stack(real_offsets)

# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 3))
seconds = dt * torch.arange(steps + 1)
ax.plot(seconds, swinging[:, 0], "--", color=plotting.GREY, label="by feel")
ax.plot(seconds, best_line[:, 0], color=plotting.ORANGE, lw=4, alpha=0.6)
ax.lines[-1].set_label("LQR, linear model")
ax.plot(seconds, real_offsets, ".-", label="LQR, nonlinear car")
ax.axhline(0, color="black", lw=0.8)
ax.set(xlabel="time (s)", ylabel="offset (m)", ylim=(-0.6, 0.8))
ax.legend(loc="upper right", ncols=3)
plotting.show(
    fig,
    "Offset against time. With the gain of LQR the car settles on the line within "
    "two seconds, and the nonlinear car agrees with the linear model.",
)

# %% tags=["claims"]
golden = 0.0
for _ in range(30):
    golden = 1 + golden / (1 + golden)
claim("golden", golden, equals=(1 + math.sqrt(5)) / 2, within=1e-9)
claim("last_gain", gains[-1].abs().max(), equals=0)
claim("lqr_overshoot", -best_line[:, 0].min(), below=0.03, unit="m")
claim("lqr_two_seconds", best_line[20, 0].abs(), below=0.05, unit="m")
difference = (best_line[:, 0] - real_offsets).abs().max()
claim("promise_kept", difference, below=0.02, unit="m")
claim("real_on_the_line", real_offsets[-1].abs(), below=0.01, unit="m")

# %% [markdown]
# After two seconds the car is {claim}`lqr_two_seconds` from the line, and it overshoots by only
# {claim}`lqr_overshoot`. The nonlinear car, with its sines and cosines, differs from the linear
# model by {claim}`promise_kept` at most. <!-- given: two seconds -->

# %% [markdown]
# ## The endless horizon: the algebraic Riccati equation
#
# The gain depends on how many steps are left.
#
# **Predict.** How many steps before the end does the gain begin to differ by more than 1 % from
# what it would be if there were no end: about 5, 25, or 60? <!-- given: 1 % -->

# %% tags=["answer", "hide-input"]
K_endless, _ = pp.dlqr(A_line, B_line, Q_line[:2, :2], Q_line[2:, 2:])
to_go = torch.arange(steps, 0, -1)
fig, ax = plt.subplots(figsize=(7, 3))
for column, (name, style) in enumerate([("offset", ".-"), ("heading", "s-")]):
    [curve] = ax.plot(to_go, gains[:, 0, column], style, ms=4, label=f"of the {name}")
    level = -K_endless[0, column]
    ax.axhline(level, color=curve.get_color(), ls="--", lw=1)
ax.plot([], color=plotting.GREY, ls="--", lw=1, label="without an end")
ax.set(xlabel="steps to go", ylabel="gain (rad/s per m or rad)")
ax.invert_xaxis()
ax.legend(loc="upper left")
plotting.show(
    fig,
    "The two numbers of the gain against the steps to go. Far from the end they are "
    "constant; near it they go to zero.",
)

# %% tags=["answer", "claims"]
apart = ((gains + K_endless) / K_endless).abs().amax((1, 2))
claim("settled_after", (apart > 0.01).sum(), above=20, below=28)
claim("same_at_sixty", apart[0], below=1e-4)

# %% [markdown] tags=["answer"]
# About 25: {claim}`settled_after` steps. Further away from the end the car steers as if it drove
# for ever.

# %% [markdown]
# So the recursion has a limit, a matrix $P$ that one more step does not change. Written with the
# textbooks' $R = Q_{uu}$, {eq}`eq-2-riccati` with $V = V_t = P$ is the
# {term}`algebraic Riccati equation`:
#
# $$
# \begin{aligned}
# P = {} & Q_{xx} + A^\top P A \\
# & - A^\top P B\, S^{-1} B^\top P A \\
# S = {} & R + B^\top P B
# \end{aligned}
# $$ (eq-2-are)
#
# Two conditions guarantee a solution with a stable closed loop, and only one. The system has to be
# {term}`stabilisable <stabilisability>`: whatever the input cannot influence dies out by itself.
# And the cost has to make it {term}`detectable <detectability>`: whatever costs nothing dies out by
# itself, too. Chapter 1's {term}`controllability` is more than stabilisability. The parked car has
# neither. Its sideways offset stays for ever, at the same price in each step, and so there is no
# $P$.
#
# The library solves {eq}`eq-2-are` by `dlqr`, and raises an error where there is no solution, as
# for the parked car. Mind the sign: by custom, its gain is for $u = -K x$.

# %%
K_line, P_line = pp.dlqr(A_line, B_line, Q_line[:2, :2], Q_line[2:, 2:])
print("K =", K_line)
one_more, _ = riccati_step(P_line, Q_line, A_line, B_line)
print("one more step changes P by", (one_more - P_line).abs().max().item())
closed_loop = A_line - B_line @ K_line
print("eigenvalues:", torch.linalg.eigvals(closed_loop).abs())

# %% tags=["claims"]
claim("riccati_residual", (one_more - P_line).abs().max(), below=1e-10)
claim("line_eigenvalue", torch.linalg.eigvals(closed_loop).abs().max(), below=0.9)
short_gains, _ = riccati_recursion(P_line, Q_line, A_steps[:3], B_steps[:3])
claim("terminal_is_endless", (short_gains + K_line).abs().max(), below=1e-10)
parked_A, parked_B = torch.eye(3), torch.tensor([[dt, 0], [0, 0], [0, dt]])
refused = True
with contextlib.suppress(ValueError):
    pp.dlqr(parked_A, parked_B, torch.eye(3), torch.eye(2))
    refused = False
claim("parked_refused", refused, equals=True)

# %% [markdown]
# **Terminal cost.** Our recursion began with $V = 0$: after the last step nothing matters. One can
# begin with any other bowl, a {term}`terminal cost` on the last state. If it is $P$, then even a
# plan of three steps has the gain of the endless one in each of them, up to
# {claim}`terminal_is_endless`. Chapter 3 plans a short way ahead and comes back to this.
# <!-- given: three steps -->

# %% [markdown]
# ## The library's `LQR` and `dlqr`
#
# `pp.LQR` is our recursion, followed by a drive along the gains. It takes a system, the weights $Q$
# of $z = [x, u]$, linear weights or `None`, and the number of steps.

# %%
line = pp.LTI(A_line, B_line, C=torch.eye(2), D=torch.zeros(2, 1))
x_plan, u_plan, cost = pp.LQR(line, Q_line, None, steps)(beside)
library_gains, _ = pp.LQR(line, Q_line, None, steps).lqr_backward(beside)
print("gains differ by", (library_gains - gains).abs().max().item())
promised = beside @ V_first @ beside / 2
print("promised and paid:", promised.item(), cost.item())

# %% tags=["claims"]
claim("same_gains", (library_gains - gains).abs().max(), below=1e-10)
claim("same_cost", (cost - promised).abs(), below=1e-10)

# %% [markdown]
# The files stand in `pypose_lite/control/`. All that is linear-quadratic in the library goes
# through one function, `riccati_step` in `riccati.py`. Its lines (1), (3) and (5) are our
# {eq}`eq-2-curvature`, {eq}`eq-2-gain` and {eq}`eq-2-riccati`; the others carry linear terms, which
# chapter 3 needs.
#
# | you call | it calls | which |
# |:--|:--|:--|
# | `pp.LQR` | `riccati` | repeats `riccati_step` from the end |
# | `pp.MPC` | `sweep` | calls `riccati` along a guess, chapter 3 |
# | `pp.dlqr` | `doubled` | doubles the horizon in each round |

# %% [markdown]
# ## On the infinity: another gain in every step
#
# Along the reference the car is nearly linear, with other matrices in each step. The deviations
# $\delta x = x - x_{\text{ref}}$ and $\delta u = u - u_{\text{ref}}$ obey
#
# $$ \delta x_{t+1} = A_t\, \delta x_t + B_t\, \delta u_t $$ (eq-2-along)
#
# One call of `linearize` returns all $A_t$ and $B_t$, and our recursion takes matrices that change.
# The weights are those of the whole book: 1 for a squared metre, 0.3 for cosine and sine of the
# heading, 0.01 for speed and turn rate. <!-- given: 0.3, 0.01 -->

# %%
Q = torch.diag(torch.tensor([1, 1, 0.3, 0.3, 0.01, 0.01]))
A, B = ideal_car.linearize(x_ref[:-1], u_ref)[:2]
K, V = riccati_recursion(torch.zeros(4, 4), Q, A, B)
print("A:", tuple(A.shape), "B:", tuple(B.shape), "K:", tuple(K.shape))


def feedback(K):
    """Returns the policy that corrects the reference by K."""
    return lambda t, x: u_ref[t] + pp.bmv(K[t], x - x_ref[t])


a_little_off = x_ref[0] + torch.tensor([0.35, 0.25, 0, 0])
ideal, _ = drive(ideal_car, feedback(K), a_little_off)
noisy, _ = drive(slipping_car, feedback(K), x_ref[0], noise=0.005)

# %% tags=["hide-input"]
fig, panels = plotting.stacked(2, height=3.6)
runs = {"(a) ideal, started beside": ideal, "(b) with slip and noise": noisy}
for ax, (title, x) in zip(panels, runs.items()):
    plotting.plot_course(ax, title).set_ylim(-1.3, 1.3)
    plotting.plot_states(ax, x, label="car")
fig.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=3)
plotting.show(
    fig,
    "Two panels. (a) A car that starts beside the path joins it within a quarter of "
    "the first circle and stays on it. (b) A car with slip and noise stays near it.",
)

# %% tags=["claims"]
plan = pp.LQR(ideal_car, Q, None, T)
aims = {"target": x_ref[:-1], "u_target": u_ref}
K_library, k_library = plan.lqr_backward(x_ref[0], dt, u_ref, **aims)
claim("same_on_the_infinity", (K_library - K).abs().max(), below=1e-10)
claim("nothing_to_improve", k_library.abs().max(), below=1e-10)
merged = (ideal - x_ref)[:, :2].norm(dim=-1)
claim("merged", merged[16:].max(), below=0.05, unit="m")

# %% [markdown]
# These are the panels of the paper's Fig. 2, drawn by LQR along a reference. Car (a) starts beside
# the path; after a quarter of the first circle it stays within {claim}`merged` of the reference.
# The gains equal those of `pp.LQR`, to {claim}`same_on_the_infinity`.
# <!-- given: a quarter -->
#
# **Predict.** LQR knows nothing of the slip. Without noise, does its slipping car end up exactly on
# the path, about 1 cm beside it, or about 10 cm? <!-- given: 1 cm, 10 cm -->

# %% tags=["answer", "hide-input"]
cars = x_ref[0].expand(200, 4)
largest = {}
rows = []
for name, (slip, noise) in {"slip": (0.05, 0.0), "noise": (0.0, 0.005)}.items():
    for kind, policy in {"open": open_loop, "LQR": feedback(K)}.items():
        x, _ = drive(pp.DubinsCar(dt, slip), policy, cars, noise)
        largest[kind, name] = infinity.tracking_error(x).amax(-1).mean()
    rows.append(f"{name} | {largest['open', name]:.3f} | {largest['LQR', name]:.3f}")
display(table("largest error in a lap (m), mean of 200 cars | open loop | LQR", rows))

# %% tags=["answer", "claims"]
claim("lqr_slip", largest["LQR", "slip"], above=0.005, below=0.02, unit="m")
claim("lqr_noise", largest["LQR", "noise"], below=0.035, unit="m")
claim("open_slip", largest["open", "slip"], above=0.5, unit="m")
claim("open_noise", largest["open", "noise"], above=0.1, unit="m")

# %% [markdown] tags=["answer"]
# About a centimetre: {claim}`lqr_slip` at most, compared with {claim}`open_slip` in open loop. The
# correction is proportional to the error. To turn more than the reference does, the car needs an
# error that it can answer. It settles where the correction just makes up for the slip.

# %% [markdown]
# **How hard should it steer?** That is the price of the input against that of the state. Only the
# ratio counts: all weights times ten change no gain. The slider multiplies the weights of the
# input. <!-- given: times ten, ten -->


# %% tags=["hide-input"]
def priced(price):
    Q_price = torch.diag(torch.tensor([1, 1, 0.3, 0.3, price, price]))
    K_price, _ = riccati_recursion(torch.zeros(4, 4), Q_price, A, B)
    x, u = drive(slipping_car, feedback(K_price), a_little_off, noise=0.005)
    fig, (top, bottom) = plt.subplots(2, 1, figsize=(7, 6), height_ratios=[1.5, 1])
    plotting.plot_course(top, f"weight of the input: {price:g}")
    plotting.plot_states(top, x, label="car with slip and noise")
    top.set_ylim(-1.3, 1.3)
    bottom.step(dt * torch.arange(T), u[:, 1], label="turn rate of the car")
    bottom.plot(dt * torch.arange(T), u_ref[:, 1], "--", label="of the reference")
    bottom.set(xlabel="time (s)", ylabel="turn rate (rad/s)", ylim=(-3.5, 3.5))
    bottom.legend(loc="upper right")
    return fig


prices = [0.001, 0.01, 0.1, 1.0, 10.0]
alt = "The way of a car with slip and noise and its turn rate, for the chosen weight."
display(widgets.panels(priced, prices, "weight of the input", alt=alt))

# %% tags=["remove-cell"]
slider = ipywidgets.FloatLogSlider(0.01, min=-4, max=2, step=0.1)
slider.description = "weight"
widgets.live(priced, alt=alt, price=slider)

# %% tags=["claims"]
K_ten, _ = riccati_recursion(torch.zeros(4, 4), 10 * Q, A, B)
claim("only_the_ratio", (K_ten - K).abs().max(), below=1e-10)
trembling, late = {}, {}
for price in (0.001, 10.0):
    Q_price = torch.diag(torch.tensor([1, 1, 0.3, 0.3, price, price]))
    K_price, _ = riccati_recursion(torch.zeros(4, 4), Q_price, A, B)
    x, u = drive(slipping_car, feedback(K_price), cars[:20], noise=0.005)
    trembling[price] = (u - u_ref)[..., 1].std(-1).mean()
    late[price] = infinity.tracking_error(x).mean()
claim("trembles", trembling[0.001] / trembling[10.0], above=2, below=5)
claim("strays", late[10.0] / late[0.001], above=4, below=12)

# %% [markdown]
# A low weight gives a car that jumps back to the path and answers every bit of noise with the
# wheel. A high weight gives a smooth and late one. Between the ends of the slider the wheel
# trembles {claim}`trembles` times as much on the left, and the car strays {claim}`strays` times as
# far on the right.

# %% [markdown]
# ## Integral action: the last centimetre
#
# The slip is a constant error, so a constant correction must remain, and no weights will bring one
# about without an error. The remedy is {term}`integral action`: the car remembers the *sum* of its
# sideways errors. We make this sum $s$ a fifth state. With $n_t$ the unit vector to the left of the
# reference,
#
# $$ s_{t+1} = s_t + \Delta t\, n_t^\top \delta x_t $$ (eq-2-integral)
#
# It has a weight of its own. If an error remained, $s$ would grow, and with it the correction. So
# the car can rest only where the error is zero. LQR finds all five gains as before:

# %%
n_left = torch.stack([-x_ref[:-1, 3], x_ref[:-1, 2]], dim=-1)
A_sum = torch.zeros(T, 5, 5)
A_sum[:, :4, :4] = A
A_sum[:, 4, :2] = dt * n_left  # (2.10)
A_sum[:, 4, 4] = 1
B_sum = torch.cat([B, torch.zeros(T, 1, 2)], dim=1)
Q_sum = torch.diag(torch.tensor([1, 1, 0.3, 0.3, 10, 0.01, 0.01]))
K_sum, _ = riccati_recursion(torch.zeros(5, 5), Q_sum, A_sum, B_sum)

x = x_ref[0]
s = torch.zeros(1)
with_sum = [x]
for t in range(T):
    dx = x - x_ref[t]
    u = u_ref[t] + K_sum[t] @ torch.cat([dx, s])
    s = s + dt * n_left[t] @ dx[:2]
    x, _ = slipping_car(x, u)
    with_sum.append(x)
with_sum = torch.stack(with_sum)

# %% tags=["hide-input"]
plain, _ = drive(slipping_car, feedback(K), x_ref[0])
fig, ax = plt.subplots(figsize=(7, 3))
for label, path, style in (("LQR", plain, "--"), ("with integral", with_sum, "-")):
    sideways = (n_left * (path - x_ref)[:-1, :2]).sum(-1)
    ax.plot(dt * torch.arange(T), 1000 * sideways, style, label=label)
ax.axhline(0, color="black", lw=0.8)
ax.axvline(6.4, color=plotting.GREY, ls=":", label="the circles meet")
ax.set(xlabel="time (s)", ylabel="error to the left (mm)", ylim=(-12, 19))
ax.legend(loc="upper right", ncols=3)
plotting.show(
    fig,
    "The sideways error of a slipping car in a lap. With LQR it is constant on each "
    "circle, with opposite signs. With integral action it goes to zero on each.",
)

# %% tags=["claims"]
plain_error = infinity.tracking_error(plain)[40:64].mean()
sum_error = infinity.tracking_error(with_sum)[40:64].mean()
claim("plain_error", 1000 * plain_error, above=5, below=8, unit="mm")
claim("sum_error", 1000 * sum_error, below=0.3, unit="mm")
claim("sum_largest", infinity.tracking_error(with_sum).max(), below=0.008, unit="m")

# %% [markdown]
# Late on the first circle LQR alone leaves {claim}`plain_error`, and integral action
# {claim}`sum_error`. Where the circles meet, the slip changes its side. There the sum is wrong at
# first and has to be unlearned, which is its price. In the last second both errors rise, because
# near the end the gains go to zero; a terminal cost would prevent it.

# %% [markdown]
# ## An unstable system: the pendulum held upright
#
# A car without feedback strays slowly. Chapter 1's upright pendulum falls within two seconds. We
# linearise it there and ask `dlqr` for a gain. Its motor has at most 5 N m, about half of what it
# takes to hold the pendulum horizontally. <!-- given: two seconds, 5 N m, half -->

# %%
pendulum = pp.Pendulum(dt=0.05)
A_up, B_up = pendulum.linearize(torch.zeros(2), torch.zeros(1))[:2]
Q_up = torch.diag(torch.tensor([1, 0.1]))  # of angle and rate
R_up = torch.tensor([[0.01]])  # of the torque
K_up, P_up = pp.dlqr(A_up, B_up, Q_up, R_up)


def balance(angle):
    """Returns angles and torques of a pendulum let go at an angle from upright."""
    x = torch.tensor([angle, 0.0])
    angles = [x[0]]
    torques = []
    for _ in range(80):
        u = (-K_up @ x).clamp(-5, 5)  # the sign of dlqr
        x, _ = pendulum(x, u)
        angles.append(x[0])
        torques.append(u[0])
    return torch.stack(angles), torch.stack(torques)


# %% [markdown]
# **Predict.** It is let go at rest at 0.1, at 0.5 or at 0.6 rad from upright. From which of these
# does it stand up: from all, from the first two, or only from the first?
# <!-- given: 0.1, 0.5, 0.6 rad -->

# %% tags=["answer", "hide-input"]
fig, (top, bottom) = plotting.stacked(2, height=2.4)
pendulum_time = 0.05 * torch.arange(81)
for angle, style in ((0.1, "-."), (0.5, "-"), (0.6, "--")):
    angles, torques = balance(angle)
    top.plot(pendulum_time, angles, style, label=f"from {angle} rad")
    bottom.step(pendulum_time[:-1], torques, style, label=f"from {angle} rad")
top.set(xlabel="time (s)", ylabel="angle from upright (rad)", ylim=(-0.3, 4.5))
bottom.set(xlabel="time (s)", ylabel="torque (N m)")
top.legend(loc="upper left")
plotting.show(
    fig,
    "Angle and torque of three pendulums. Two return to upright. The third falls, "
    "with the motor at its limit.",
)

# %% tags=["answer", "claims"]
of_upright = torch.linalg.eigvals(A_up - B_up @ K_up).abs().max()
claim("up_eigenvalue", of_upright, below=0.9)
claim("up_near", balance(0.1)[0][-1].abs(), below=1e-3, unit="rad")
claim("up_far", balance(0.5)[0][-1].abs(), below=1e-3, unit="rad")
claim("up_lost", balance(0.6)[0].max(), above=math.pi / 2, unit="rad")
claim("up_limit", math.asin(5 / 9.81), above=0.5, below=0.6, unit="rad")

# %% [markdown] tags=["answer"]
# From the first two. Feedback turned the eigenvalue {claim}`01_systems.upright_eigenvalue` of
# chapter 1 into {claim}`up_eigenvalue`. From 0.6 rad the pendulum falls, with its motor at the
# limit. At rest 5 N m hold it up to {claim}`up_limit`. Beyond that it falls, whatever the
# controller does, and can only swing up again from below. LQR knows nothing of limits. Chapter 3
# plans with them, and swings the pendulum up. <!-- given: 0.6 rad, 5 N m -->

# %% [markdown]
# ## How we know, and where it ends
#
# **Another way to the same inputs.** $J$ is a quadratic function of all inputs together. Its
# minimum follows from one large system of equations, without any recursion:


# %%
def total_cost(inputs):
    x = beside
    cost = 0
    for u in inputs:
        z = torch.cat([x, u])
        cost = cost + z @ Q_line @ z / 2
        x = A_line @ x + B_line @ u
    return cost


zeros = torch.zeros(steps, 1)
slope = torch.func.grad(total_cost)(zeros)[:, 0]
curvature = torch.func.hessian(total_cost)(zeros)[:, 0, :, 0]
dense = -torch.linalg.solve(curvature, slope)
print("inputs differ by", (u_plan[:, 0] - dense).abs().max().item())
print("slope at ours:", torch.func.grad(total_cost)(u_plan).abs().max().item())
print("cost minus promise:", (total_cost(u_plan) - promised).item())

# %% tags=["claims"]
claim("equals_dense", (u_plan[:, 0] - dense).abs().max(), below=1e-10)
claim("gradient_zero", torch.func.grad(total_cost)(u_plan).abs().max(), below=1e-10)
claim("promise_is_cost", (total_cost(u_plan) - promised).abs(), below=1e-10)
claim("curvature_positive", torch.linalg.eigvalsh(curvature).min(), above=0)

# %% [markdown]
# The inputs agree, the slope of $J$ there is zero, and $J$ is what the bowl promised,
# $\tfrac12 x_0^\top V x_0$. The recursion needs no matrix of $60 \times 60$ numbers. And it gives
# more than inputs: a rule for every state.
#
# **Is the loop stable?** For matrices that do not change, the eigenvalues of $A + BK$ decide. On
# the infinity they change, and the eigenvalues of single steps decide *nothing*: two matrices whose
# eigenvalues are all 0.5 can have a product with the eigenvalue {claim}`frozen_product`. Multiply
# the matrices of the whole lap: <!-- given: 0.5 -->


# %%
def over_the_lap(K):
    """Returns what a deviation at the start becomes at the end, as a matrix."""
    product = torch.eye(4)
    for t in range(T):
        product = (A[t] + B[t] @ K[t]) @ product
    return product


for name, gain in {"right": K, "wrong sign": -K}.items():
    largest_factor = torch.linalg.matrix_norm(over_the_lap(gain), ord=2)
    print(f"{name}: a deviation becomes {largest_factor:.0e} times as large at most")

# %% tags=["claims"]
first_half = torch.tensor([[0.5, 2.0], [0.0, 0.5]])
product = torch.linalg.eigvals(first_half.mT @ first_half).abs().max()
claim("frozen_product", product, above=4, below=5)
of_lap = torch.linalg.matrix_norm(over_the_lap(K), ord=2)
of_wrong = torch.linalg.matrix_norm(over_the_lap(-K), ord=2)
claim("lap_factor", of_lap, below=1e-9)
claim("wrong_sign_factor", of_wrong, above=1e20)
alone = torch.zeros(4, 4)
for t in reversed(range(T)):
    F = torch.cat([A[t], B[t]], dim=-1)
    H = Q + F.mT @ alone @ F
    K_alone = -torch.linalg.solve(H[4:, 4:], H[4:, :4])
    alone = H[:4, :4] + H[4:, :4].mT @ K_alone
claim("rounding_grows", (K_alone - K[0]).abs().max(), above=1)

# %% [markdown]
# Of a deviation at the start at most the share {claim}`lap_factor` is left at the end. With the
# wrong sign of the gain, as when those of `dlqr` and `LQR` are mixed up, no error is raised, and
# the factor is {claim}`wrong_sign_factor`.
#
# (Rounding can grow, too. Without the last line of `riccati_step`, which keeps $V$ symmetric, the
# first gain of the lap is wrong by {claim}`rounding_grows`.)
#
# **How far does it reach?** The model is linear *at the reference*. Let the car start in the right
# place and look the wrong way.
#
# **Predict.** It looks nearly backwards. Will LQR turn it around slowly, let it stand still, or do
# something else?

# %% tags=["answer", "hide-input"]
turned_by = torch.arange(5, 161, 5).deg2rad()
start_angle = turned_by - math.pi / 2
there = torch.zeros_like(start_angle)
turned = torch.stack([there, there, start_angle.cos(), start_angle.sin()], dim=-1)
turned_x, turned_u = drive(ideal_car, feedback(K), turned)
dz = torch.cat([turned_x[:, :-1] - x_ref[:-1], turned_u - u_ref], dim=-1)
paid = pp.bvmv(dz, Q, dz).sum(-1) / 2
expected = pp.bvmv(dz[:, 0, :4], V, dz[:, 0, :4]) / 2
kept = paid / expected
fig, ax = plt.subplots(figsize=(7, 3))
ax.semilogy(turned_by.rad2deg(), kept, ".-", label="nonlinear car")
ax.axhline(1, color=plotting.GREY, ls="--", label="promise of the linear model")
ax.set(xlabel="heading at the start is wrong by (degrees)")
ax.set(ylabel="cost / promised cost")
ax.legend(loc="upper left")
plotting.show(
    fig,
    "The cost of the nonlinear car, relative to what the linear model promised. It "
    "is one for small angles and grows steeply beyond a right angle.",
)

# %% tags=["answer", "claims"]
claim("promise_small", kept[0], equals=1, within=0.02)
claim("promise_turned", kept[-1], above=10)
claim("wild_speed", turned_u[-1, :, 0].max(), above=3, unit="m/s")

# %% [markdown] tags=["answer"]
# Something else: it asks for a speed of up to {claim}`wild_speed`. In the linear model more speed
# carries the car forward along the reference. This car looks backwards, so more speed carries it
# away, and LQR asks for still more. At small angles the cost is what $V$ promised, the ratio being
# {claim}`promise_small`; at the last one it is {claim}`promise_turned` times as much.

# %% [markdown]
# The remedy is to linearise where the car *is*, again and again. That is
# [chapter 3](03_mpc.py).

# %% [markdown]
# ## Summary
#
# - The best feedback for a linear system and a quadratic cost is $u = K_t x$, by dynamic
#   programming from the end; it equals the solution of one large system of equations, to
#   {claim}`equals_dense`.
# - {claim}`settled_after` steps before the end the gain has settled; without an end it follows from
#   the algebraic Riccati equation, which `dlqr` solves.
# - Around the infinity a slipping car strays {claim}`lqr_slip` with LQR and {claim}`open_slip` in
#   open loop. Integral action takes what remains from {claim}`plain_error` to {claim}`sum_error`.
# - The pendulum is held upright, with an eigenvalue of {claim}`up_eigenvalue`, as long as its motor
#   is strong enough.
# - Multiply the matrices of a lap to see what is left of a deviation: {claim}`lap_factor`. Far from
#   the reference the promise breaks, {claim}`promise_turned` times over.
#
# | | paper | here |
# |:--|:--|:--|
# | LQR | named, no number | equals a dense solution, {claim}`equals_dense` |
# | noise, Fig. 2 (b) | steered by MPC | LQR, largest error {claim}`lqr_noise` |
#
# **What differs from PyPose.** In PyPose 0.9.5 `LQR` accepts bounds on the input and ignores them,
# needs a batch dimension and a `p`, and ticks the system's clock while it plans. Ours keeps bounds,
# takes any batch or none, and leaves the system as it was. There is no `dlqr` there. On linear
# systems the plans agree.
#
# **Words of this chapter.** {term}`LQR`, {term}`cost-to-go`, {term}`dynamic programming`,
# {term}`Bellman equation`, {term}`Riccati equation`, {term}`algebraic Riccati equation`,
# {term}`stabilisability`, {term}`detectability`, {term}`terminal cost`, {term}`Bryson's rule`,
# {term}`integral action`.
#
# **Further reading.** {cite:t}`anderson1990`, chapters 2 to 4; the first lecture of
# {cite:t}`boyd_ee363`, which is this chapter; {cite:t}`astrom2021` on integral action.
#
# **In [the lab](../exercises/02_lqr.py)** you write the Riccati step for $Q$ and $R$, find a wrong
# sign by its symptom, make a short plan as good as an endless one, remove a constant error, balance
# a pole on a cart, write a test that catches a wrong transpose, learn what a driver wants, and walk
# the simulated Go1 to a line.
#
# Next: [chapter 3](03_mpc.py) linearises where the car is, and plans anew in every step.
