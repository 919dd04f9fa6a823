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
# # Learning through the loop
#
# A robot that plans and filters is full of numbers that somebody has set: how much its wheels slip,
# how noisy its sensor is, what a fast turn costs. In practice an engineer drives, looks, changes a
# number and drives again, for days, and does it again after the tyres have been changed. This
# chapter lets the car do it: from a record of one lap, and then from nothing but how well it drove.
# The tool for both is a gradient. The new part of it is the derivative of a *decision*: how does
# the best plan change when a number in the planner changes?
#
# After this chapter you can
#
# - differentiate the solution of an optimisation problem by the implicit function theorem;
# - identify a parameter of a car from a recorded run;
# - tune a planner and a filter together, through the closed loop;
# - say what a gradient cannot find, and test whether a gradient is right.
#
# You need [chapter 3](03_mpc.py) (plans, sweeps, bounds), [chapter 4](04_ekf.py) (the filter) and
# the chain rule. Take about 60 minutes. <!-- given: 60 minutes -->
#
# The paper {cite}`pypose06` says that all its functions "are fully differentiable, which makes an
# attractive starting point for the development of more advanced end-to-end robot learning
# systems". It has no example of it and no number. Here is one, with its tests.

# %% tags=["setup"]
import math
import warnings

import matplotlib.pyplot as plt
import torch
from IPython.display import display
from torch.autograd.functional import jacobian
from torch.func import grad, hessian, jacfwd, jvp

import pypose_lite as pp
from pypose_lite import filters, infinity
from pypose_lite.teaching import claim, plotting, sketches, table, widgets

plotting.use_style()
torch.set_default_dtype(torch.float64)

# %% [markdown]
# The wheels of this chapter's car lose a fifth of every turn: its *slip* is 0.2. An ideal car has
# no slip. The noise is that of the chapters before; its standard deviations are called $q$ and $r$
# here, and $Q$ is again the weights of the cost, as in chapter 3. <!-- given: a fifth, 0.2 -->

# %%
dt = 0.1  # s, the length of one time step
T = 10  # steps to plan
weights = torch.tensor([1, 1, 0.3, 0.3, 0.01, 0.01])  # of i, j, cos, sin, v, phi
Q = torch.diag(weights)
waypoints = infinity.waypoints()
q = infinity.PROCESS_NOISE  # standard deviation of every component, in every step
r = infinity.OBSERVATION_NOISE  # likewise, of what is seen
ideal = pp.DubinsCar(dt)
real = pp.DubinsCar(dt, slip=0.2)

# %% [markdown]
# A lap has two models of the car in it. The planner plans with one, the filter predicts with the
# other. `lap` drives 16 noisy, slipping cars, with the models that we give to planner and filter:


# %%
def lap(planner_car, filter_car):
    """Returns a lap of 16 real cars, by what planner and filter believe."""
    three_sweeps = pp.utils.ReduceToBason(steps=3)
    mpc = pp.MPC(planner_car, Q, None, T, three_sweeps)
    generator = torch.Generator().manual_seed(0)
    start = waypoints[0].expand(16, 4)
    world = infinity.SimulatedCar(real, start, q, r, generator)
    return infinity.drive(mpc, world, pp.EKF(filter_car), steps=60)


# %% [markdown]
# On the first lap both believe in an ideal car. Then the first car looks at its record, the inputs
# and the noisy observations of this lap, once. On the second lap planner and filter use the slip
# that it found there.

# %% tags=["hide-input"]
blind = lap(ideal, ideal)
guesses = torch.linspace(0, 0.4, 401)
x = waypoints[0].expand(401, 4)
misfit = torch.zeros(401)
for k in range(59):
    x = pp.DubinsCar(dt, guesses).transition(x, blind.u[0, k].expand(401, 2))
    misfit = misfit + (x - blind.y[0, k + 1]).square().sum(-1)
found = pp.DubinsCar(dt, guesses[misfit.argmin()])
informed = lap(found, found)
fig, panels = plotting.stacked(2, height=2.7)
for ax, run, title in zip(panels, [blind, informed], ["first lap", "second lap"]):
    plotting.plot_waypoints(plotting.infinity_axes(ax, title, margin=0.6), waypoints)
    ax.plot(*run.x[1:].permute(2, 1, 0)[:2], color=plotting.GREY, lw=0.4)
    ax.lines[0].set_label("15 other cars")
    plotting.plot_states(ax, run.x[0], label="the car that learned")
handles, labels = panels[0].get_legend_handles_labels()
fig.legend(handles, labels, loc="outside lower center", ncols=3)
plotting.show(
    fig,
    "Two maps. On the first lap all cars leave the infinity sign and lose their way; "
    "on the second lap they follow it.",
)

# %% tags=["claims"]
claim("slip_from_one", found.slip, equals=0.2, within=0.04)
claim("blind_finished", blind.finished.sum(), equals=0)
claim("informed_finished", informed.finished.sum(), above=11)

# %% [markdown]
# On the first lap {claim}`blind_finished` of the 16 cars finish, on the second
# {claim}`informed_finished`. The record of one car was enough to find a slip of
# {claim}`slip_from_one`. <!-- given: 16 -->

# %% [markdown]
# ## It fails: one wrong number, in two places
#
# Feedback forgives much: in [chapter 2](02_lqr.py) a car that slipped a little stayed beside its
# path. This one slips more and sees badly, and it does not get around. The model is wrong in two
# places.
#
# **Predict.** We may tell the true slip to one of them only. Which one should it be: the planner,
# which decides; the filter, which only watches; or does one alone not help?

# %% tags=["answer", "hide-input"] mystnb={"markdown_format": "myst"}
runs = {
    "ideal | ideal": blind,
    "real | ideal": lap(real, ideal),
    "ideal | real": lap(ideal, real),
    "real | real": lap(real, real),
}
stray = {}
nees = {}
rows = []
for who, run in runs.items():
    truth = run.x[:, :-1]
    stray[who] = infinity.tracking_error(truth)[run.running].mean()
    nees[who] = filters.nees(run.estimate, run.P, truth)[run.running].mean()
    done = run.finished.sum()
    rows.append(f"{who} | {stray[who]:.3f} | {nees[who]:.1f} | {done} of 16")
head = "planner's car | filter's car | mean error (m) | NEES | finished"
display(table(head, rows))

# %% tags=["answer", "claims"]
claim("blind_stray", stray["ideal | ideal"], above=0.18, unit="m")
claim("planner_told", stray["real | ideal"], above=0.2, unit="m")
claim("filter_told", stray["ideal | real"], below=0.12, unit="m")
claim("both_told", stray["real | real"], below=0.06, unit="m")
claim("blind_nees", nees["ideal | ideal"], above=30)
claim("both_nees", nees["real | real"], below=9)

# %% [markdown] tags=["answer"]
# The filter. With the planner alone the cars stray {claim}`planner_told` from the path, which is no
# better than the {claim}`blind_stray` of before; with the filter alone {claim}`filter_told`. The
# planner gets a new estimate in every step, so its errors do not add up. The filter's do: each of
# its predictions turns too far, and the next one begins there. NEES, chapter 4's test of a filter,
# should be 4 for four states and is {claim}`blind_nees`: this filter is far too sure of itself. A
# better planner then only follows a wrong estimate more exactly. With both told, the cars stray
# {claim}`both_told`.

# %% [markdown]
# Nobody knows the slip of a real car, so it has to be learned. For that we need a derivative: how
# what the car does changes with the slip.

# %% [markdown]
# ## The idea: the minimum moves
#
# A small example first, with one input and one parameter. A robot is to move one metre in one
# second. We tell it a speed $u$, and it moves with the speed $\theta u$; call $\theta$ its grip.
# The cost is the square of the distance that is left, and that of the speed with the weight
# $\rho = 0.1$: <!-- given: one metre, one second -->
#
# $$ J(u, \theta) = \tfrac12 (\theta u - 1)^2 + \tfrac12 \rho\, u^2 $$ (eq-8-small)
#
# The decision is the $u$ of least cost. There the slope of the cost vanishes; this is the
# {term}`stationarity condition`
#
# $$
# g(u, \theta) = \frac{\partial J}{\partial u} = \theta\, (\theta u - 1) + \rho\, u = 0
# $$ (eq-8-stationary)
#
# Now the grip becomes a little worse. What happens to the decision?

# %% tags=["hide-input"]
rho = 0.1
speeds = torch.linspace(0.6, 1.7, 100)


def small_cost(u, theta):
    return (theta * u - 1) ** 2 / 2 + rho * u**2 / 2


def small_slope(u, theta):
    return theta * (theta * u - 1) + rho * u


fig, (top, bottom) = plotting.stacked(2, height=2.5, sharex=True)
for theta, style, color in [(0.8, "-", plotting.BLUE), (0.7, "--", plotting.RED)]:
    best = theta / (theta**2 + rho)
    look = {"color": color, "label": f"grip {theta}"}
    top.plot(speeds, small_cost(speeds, theta), style, **look)
    top.plot(best, small_cost(best, theta), "o", color=color)
    bottom.plot(speeds, small_slope(speeds, theta), style, **look)
    bottom.plot(best, 0, "o", color=color)
bottom.axhline(0, color="black", lw=0.8)
old = 0.8 / (0.8**2 + rho)
new = 0.7 / (0.7**2 + rho)
sketches.arrow(bottom, (old, 0), (old, small_slope(old, 0.7)), plotting.GREY)
bottom.annotate("1", (old - 0.04, -0.06), color=plotting.GREY, size=13)
sketches.arrow(bottom, (old, small_slope(old, 0.7)), (new, 0), plotting.GREY)
bottom.annotate("2", (new, -0.07), color=plotting.GREY, size=13)
top.set(ylabel="cost J", ylim=(0, 0.25))
bottom.set(xlabel="speed u (m/s)", ylabel="slope g of the cost", ylim=(-0.2, 0.25))
top.legend(loc="upper center")
plotting.show(
    fig,
    "Two parabolas, and below them their slopes, two rising lines. With less grip "
    "the line lies lower at the old minimum, and its zero is further to the right.",
)

# %% tags=["claims"]
claim("old_minimum", old, equals=1.081, within=1e-3, unit="m/s")
claim("new_minimum", new, above=old, unit="m/s")

# %% [markdown]
# The best speed rises from {claim}`old_minimum` to {claim}`new_minimum`. The lower picture shows
# why. At the old decision the slope was zero. With less grip the slope there is negative (arrow 1):
# the cost now falls to the right. So the decision moves to the right until the slope is zero again
# (arrow 2). How far it has to move depends on how steeply the line rises:
#
# $$
# \text{move} = -\frac{\text{how } g \text{ changes with } \theta}
# {\text{how } g \text{ changes with } u}
# $$ (eq-8-words)

# %% [markdown]
# ## Derived: how a decision moves
#
# **One input.** Let $u(\theta)$ be the decision for each $\theta$. The slope at the decision is
# zero for *all* $\theta$, so its derivative with respect to $\theta$ is zero, too. By the chain
# rule
#
# $$
# \frac{\partial g}{\partial u}\, \frac{du}{d\theta} + \frac{\partial g}{\partial \theta} = 0
# $$ (eq-8-chain)
#
# (The decision $u$ depends on $\theta$, and $g$ depends on $\theta$ also directly.) Solve it for
# $du/d\theta$, and it says what {eq}`eq-8-words` says. In the example
# $\partial g / \partial u = \theta^2 + \rho$ and $\partial g / \partial \theta = 2 \theta u - 1$.
# Here we can compare, since {eq}`eq-8-stationary` has the solution
# $u = \theta / (\theta^2 + \rho)$:

# %%
rho = 0.1
theta = 0.8
u = theta / (theta**2 + rho)
g_u = theta**2 + rho
g_theta = 2 * theta * u - 1
small_implicit = -g_theta / g_u  # (8.4)
print("by the stationarity condition:", small_implicit)

h = 1e-5
above = (theta + h) / ((theta + h) ** 2 + rho)
below = (theta - h) / ((theta - h) ** 2 + rho)
small_difference = (above - below) / (2 * h)
print("by differences of the solution:", small_difference)

# %% tags=["claims"]
claim("small_slope", small_implicit, below=-0.9)
claim("small_error", abs(small_implicit - small_difference), below=1e-8)

# %% [markdown]
# **A whole plan.** A plan of $T$ steps has $2T$ inputs. Put them below each other in one vector
# $u$. Then $g$, the gradient of the total cost, has $2T$ entries, and so {eq}`eq-8-chain` is a
# system of $2T$ equations. The matrix $H = \partial g / \partial u$ in it holds the second
# derivatives of the cost and is called its {term}`Hessian`. Solved for the derivative of the plan,
#
# $$
# \frac{du}{d\theta} = -H^{-1}\, \frac{\partial g}{\partial \theta}
# $$ (eq-8-implicit)
#
# That such a derivative exists is the {term}`implicit function theorem`. It asks for one thing: $H$
# can be inverted, which holds where all its eigenvalues are positive, as at the bottom of a bowl.
# (The [appendix](mathematics.py) has its statement.)
# Note what the formula does *not* contain: how the plan was found. Three sweeps or 200, from
# whichever guess, none of them has to be differentiated. But the plan has to *be* a minimum.
# <!-- given: 200, three sweeps -->
#
# **With bounds.** An input that stands at its bound, and would like to go beyond, does not move
# when $\theta$ changes a little. It is *clamped*: its derivative is zero. The others are free, and
# for them {eq}`eq-8-implicit` holds with the rows and columns of the free inputs only.
#
# **A loss on top.** We do not want the derivative of a plan for its own sake. We have a *loss*
# $L(u(\theta))$, such as the distance between what a car did and what it should have done, and look
# for the $\theta$ with the least loss. An optimisation whose every evaluation contains another
# optimisation is called {term}`bilevel optimisation`: the plan is the *lower* problem, and learning
# is the *upper* one. By the chain rule
#
# $$
# \frac{dL}{d\theta} = -\frac{\partial L}{\partial u}\, H^{-1}\, \frac{\partial g}{\partial \theta}
# $$ (eq-8-loss)
#
# Multiply from the left: solve $H \lambda = (\partial L / \partial u)^\top$ once, and the gradient
# is $-\lambda^\top\, \partial g / \partial \theta$ ($H$ is symmetric), for one parameter or a
# thousand. This is what torch's `backward` does with a plan of the library.
#
# **The one loss that needs none of it** is the cost itself. If $L = J$, the chain rule gives
# $dJ/d\theta = g^\top\, du/d\theta + \partial J / \partial \theta$. The first part is zero, since
# $g$ is zero for free inputs and $du/d\theta$ for clamped ones. What is left,
#
# $$
# \frac{d}{d\theta} \min_u J(u, \theta) = \frac{\partial J}{\partial \theta}
# $$ (eq-8-envelope)
#
# is the {term}`envelope theorem`: to first order, the least cost changes as if the decision stayed
# where it is. It is convenient, and it is a trap. Whoever tests the gradient of a planner on the
# planner's own cost gets the right number even if $du/d\theta$ is wrong.
#
# **The paper's authors** cite two systems that learn in this way: iPlanner {cite}`yang2023iplanner`
# trains a network through a planner, iSLAM {cite}`fu2024islam` trains one through the optimiser of
# a graph of poses. They call it {term}`imperative learning` {cite}`wang2025imperative`. The
# *imperative* in the title of our paper is another word: it means that you write the loop yourself,
# as ordinary Python. The two fit together, for a loop in ordinary Python is recorded by autograd as
# it runs.

# %% [markdown]
# ## From scratch: the derivative of one plan
#
# How would the plan from the first waypoint to the second change if the car slipped a little more?
# The cost of chapter 3 is a weighted sum of squares. `deviations` returns what is squared: in each
# step, the differences of the state from the target, and the inputs.


# %%
def deviations(u, slip, x, target):
    """Returns [x - target, u] of every step, (T, 6), for inputs (T, 2) from x."""
    rows = []
    for t in range(len(u)):
        rows.append(torch.cat([x - target[t], u[t]]))
        x = pp.DubinsCar(dt, slip).transition(x, u[t])
    return torch.stack(rows)


aim = waypoints[1].expand(T, 4)


def cost(u, slip):
    """Returns J of inputs in one vector, (20,)."""
    away = deviations(u.reshape(T, 2), slip, waypoints[0], aim)
    return (weights * away.square()).sum() / 2


# %% [markdown]
# `torch.func` has the derivatives that we need, as functions: `grad`, `hessian`, and `jacfwd` for
# the derivative of a vector.

# %%
slip = torch.tensor(0.2)
plan = pp.MPC(real, Q, None, T)(dt, waypoints[0], waypoints[1])[1]
u = plan.flatten()

g = grad(cost)(u, slip)
H = hessian(cost)(u, slip)
g_slip = jacfwd(grad(cost), argnums=1)(u, slip)
by_hand = -torch.linalg.solve(H, g_slip).reshape(T, 2)  # (8.5)

print("largest slope of the cost:", g.abs().max().item())
print("first input by slip:", by_hand[0].tolist())

# %% [markdown]
# The last number is the derivative of the first turn rate. If the slip rises by 0.01, the first
# turn rate of the plan rises by a hundredth of this number. Is it right? Make two whole plans, for
# a little more and a little less slip, and take the difference.
# <!-- given: 0.01, a hundredth -->


# %%
def plan_with(slip, **bounds):
    mpc = pp.MPC(pp.DubinsCar(dt, slip), Q, None, T)
    return mpc(dt, waypoints[0], waypoints[1], **bounds)[1]


h = 1e-5
differences = (plan_with(slip + h) - plan_with(slip - h)) / (2 * h)
print("the same by differences:", differences[0].tolist())

# %% tags=["claims"]
claim("plan_is_flat", g.abs().max(), below=1e-6)
by_hand_error = (by_hand - differences).abs().max() / differences.abs().max()
claim("by_hand_error", by_hand_error, below=1e-6)
claim("turn_by_slip", by_hand[0, 1], above=2, unit="rad/s")

# %% [markdown]
# They agree to {claim}`by_hand_error` of the largest entry.
#
# ### A shortcut, and what it forgets
#
# There is a way that looks simpler. Collect the deviations in a vector $d$, their derivatives by
# the inputs in a matrix $D = \partial d / \partial u$, and the weights on the diagonal of $S$.
# Then $J = \tfrac12 d^\top S\, d$, and by the product rule its slope and its Hessian are
#
# $$
# \begin{aligned}
# g &= D^\top S\, d \\
# H &= D^\top S\, D + \sum_k S_{kk}\, d_k\, \frac{\partial^2 d_k}{\partial u^2}
# \end{aligned}
# $$ (eq-8-gauss)
#
# A sweep of chapter 3 is one step of the {term}`Gauss-Newton method`: it drops the sum, and moves
# the inputs by $-(D^\top S D)^{-1} D^\top S\, d$. A plan that has converged is not changed by one
# more sweep. So it is tempting to record just that last sweep, with its linear model $D$ held
# fixed, and to differentiate it:


# %%
def one_more_sweep(u, slip, weights, x, target):
    """Returns a plan (T, 2) as it was, with the gradient of one more sweep."""
    u = u.detach()
    D = jacfwd(deviations)(u, slip.detach(), x.detach(), target)
    D = D.reshape(6 * len(u), 2 * len(u))
    S = weights.repeat(len(u))
    d = deviations(u, slip, x, target).flatten()
    slope = D.mT @ (S * d)
    curvature = D.mT @ (S.detach()[:, None] * D)  # without the sum
    step = -torch.linalg.solve(curvature, slope).reshape(u.shape)
    return u + step - step.detach()


# %% [markdown]
# (`u + step - step.detach()` has the value of `u` and the gradient of `step`.)
#
# **Predict.** The plan has converged to all digits. How far off is this gradient for the first turn
# rate: not at all, by less than a hundredth, or by more than a tenth?

# %% tags=["answer", "hide-input"]
shortcut = jacfwd(lambda s: one_more_sweep(plan, s, weights, waypoints[0], aim))(slip)
time = dt * torch.arange(T)
fig, ax = plt.subplots(figsize=(7, 3.2))
ax.plot(time, by_hand[:, 1], label="implicit function theorem")
ax.plot(time, shortcut[:, 1], "--", label="one more sweep")
ax.plot(time, differences[:, 1], "ko", mfc="none", label="differences of plans")
ax.set(xlabel="time in the plan (s)", ylabel="turn rate by slip (rad/s)")
ax.legend()
plotting.show(
    fig,
    "The derivative of each turn rate of the plan by the slip. The curve of the "
    "theorem runs through the differences, the one of the shortcut beside them.",
)

# %% tags=["answer", "claims"]
shortcut_error = 100 * (shortcut / differences - 1)[0, 1]
claim("shortcut_error", shortcut_error, above=15, below=30, unit="%")
pypose = 3.9456887237  # of PyPose 0.9.5, as a test of this repository finds it
claim("pypose_agrees", (shortcut[0, 1] - pypose).abs(), below=1e-8)


def least_cost(s):
    u = one_more_sweep(plan, s, weights, waypoints[0], aim)
    return cost(u.flatten(), s)


at_plan = grad(lambda s: cost(plan.flatten(), s))(slip)
claim("envelope", (jacfwd(least_cost)(slip) - at_plan).abs(), below=1e-8)

# %% [markdown] tags=["answer"]
# By more than a tenth: {claim}`shortcut_error`. It forgets that the linear model $D$ itself depends
# on the slip. The derivative of $g = D^\top S\, d$ has two terms, one for each factor, and holding
# $D$ fixed loses one of them; and the curvature lacks its sum. To *find* a plan neither matters:
# where the slope $g$ is zero, the step is zero, whatever curvature it is divided by. (In the small
# example the deviation is $\theta u - 1$, and $D$ is the factor $\theta$ before the bracket in
# {eq}`eq-8-stationary`. With it held fixed, $\partial g / \partial \theta$ would be $\theta u$
# instead of $2 \theta u - 1$.)

# %% [markdown]
# The shortcut is often used. It is what PyPose 0.9.5 computes: we ran its planner on this problem,
# and its derivative equals that of `one_more_sweep` to {claim}`pypose_agrees`. And it is easy to
# overlook: the derivative of the least cost is right with the shortcut, too, to {claim}`envelope`,
# by the envelope theorem. We shall see what it does to learning.

# %% [markdown]
# ## The library's gradient: one more Riccati pass
#
# `pp.MPC` makes its plans differentiable whenever a number in the problem asks for a gradient.
# Autograd then does the rest. `jacobian` calls it once for each input of the plan:

# %%
by_library = jacobian(plan_with, slip)
print("largest difference to ours:", (by_library - by_hand).abs().max().item())

# %% [markdown]
# And with bounds, where the clamped inputs have no derivative. Let the car drive at 2 m/s and turn
# at 1.5 rad/s at most: <!-- given: 2 m, 1.5 rad -->

# %%
box = {
    "u_lower": torch.tensor([0.0, -1.5]),
    "u_upper": torch.tensor([2.0, 1.5]),
}

u = plan_with(slip, **box)
free = ((u > box["u_lower"]) & (u < box["u_upper"])).flatten()
H = hessian(cost)(u.flatten(), slip)[free][:, free]
g_slip = jacfwd(grad(cost), argnums=1)(u.flatten(), slip)[free]
bounded_by_hand = torch.zeros(2 * T)
bounded_by_hand[free] = -torch.linalg.solve(H, g_slip)

bounded_by_library = jacobian(lambda s: plan_with(s, **box), slip).flatten()
largest = (bounded_by_library - bounded_by_hand).abs().max()
print("clamped inputs:", (~free).sum().item())
print("largest difference to ours:", largest.item())

# %% tags=["claims"]
claim("same_gradient", (by_library - by_hand).abs().max(), below=1e-8)
claim("same_with_bounds", largest, below=1e-8)
claim("clamped_inputs", (~free).sum(), above=2, below=18)

# %% [markdown]
# {claim}`clamped_inputs` of the 20 inputs are clamped, and the others agree to
# {claim}`same_with_bounds`.
#
# The library does not build $H$, which has $(2T)^2$ entries. It needs one product
# $H^{-1} v$, where $v = (\partial L / \partial u)^\top$. This product is the $w$ that minimises
# $\tfrac12 w^\top H\, w - v^\top w$: a quadratic cost of inputs that move a linear system, the one
# along the plan. Chapter 3 solved such a problem in each sweep. So the gradient of a plan is one
# more Riccati pass, with the full curvature, the slope $-v$, and the clamped inputs held. It costs
# the same after three sweeps and after 200. <!-- given: three sweeps, 200 -->
#
# | what happens | where |
# |:--|:--|
# | which inputs are clamped; has the plan converged? | `differentiable` in `gradient.py` |
# | the slope $g$, with a graph to all that made the problem | the same function |
# | $-H^{-1} v$, when `backward` comes by | `newton_step` in `gradient.py` |
# | its Riccati pass | `riccati` in `riccati.py` |

# %% [markdown]
# ## On the infinity: a slip from a record
#
# Back to the first figure. Of the first lap we have the inputs and the noisy observations. We guess
# a slip, drive the same inputs in a simulation, and compare with what was observed. This is
# {term}`system identification`. `simulate` drives a batch of pieces of a record:


# %%
def simulate(slip, x, u):
    """Returns the states after each of the inputs (..., L, 2), from x (..., 4)."""
    car = pp.DubinsCar(dt, slip)
    states = []
    for k in range(u.shape[-2]):
        x = car.transition(x, u[..., k, :])
        states.append(x)
    return torch.stack(states, dim=-2)


def pieces(run, length):
    """Cuts records into pieces: their first states, their inputs, what was seen."""
    count = (run.u.shape[1] - 1) // length
    used = count * length
    start = waypoints[0].expand(len(run.y), 1, 4)  # it is known
    seen = torch.cat([start, run.y[:, 1 : used + 1]], dim=1)
    u = run.u[:, :used].unflatten(1, (count, length))
    y = seen[:, 1:].unflatten(1, (count, length))
    return seen[:, :used:length], u, y


# %% [markdown]
# To correct the guess we need to know how each simulated state moves with the slip,
# $s = dx/d\,\text{slip}$, its *sensitivity*. `jvp` of `torch.func` (a Jacobian times a vector, here
# the vector of ones) computes it along with the simulation. If the slip changes by $\delta$, the
# states change by about $s\, \delta$. The change that explains most of the difference to the
# observations is the least-squares solution $\delta = \sum s\, (y - x) \,/ \sum s^2$. Six such
# steps are plenty; this is again the Gauss-Newton method, for one unknown.
# <!-- given: six steps -->


# %%
def learn_slip(x, u, y, guess=0.0):
    """Returns the slip of each car (cars,), from the pieces of its record."""
    slip = torch.full((len(x), 1), guess)
    for _ in range(6):

        def simulated(slip):
            return simulate(slip, x, u)

        one = torch.ones_like(slip)
        states, s = jvp(simulated, (slip,), (one,))
        change = (s * (y - states)).sum((1, 2, 3)) / s.square().sum((1, 2, 3))
        slip = slip + change[:, None]
    return slip[:, 0]


# %% [markdown]
# **Predict.** We may simulate the whole lap from its known start. Or we may cut it into pieces of
# one step, begin each at an observation, and predict only the next observation. Both use all the
# data. Which one is more precise: the whole lap, the single steps, or are they equal?

# %% tags=["answer", "hide-input"]
lengths = [1, 2, 4, 8, 16, 29, 59]
learned = {n: learn_slip(*pieces(blind, n)) for n in lengths}
fig, ax = plt.subplots(figsize=(7, 3.2))
for n, slips in learned.items():
    ax.plot(torch.full((16,), n), slips, "o", color=plotting.BLUE, alpha=0.5)
ax.lines[0].set_label("one of 16 cars")
ax.axhline(0.2, color=plotting.GREEN, ls="--", label="true slip")
ax.set(xscale="log", xlabel="steps in a piece", ylabel="learned slip")
ax.set_xticks(lengths, [str(n) for n in lengths])
ax.minorticks_off()
ax.legend()
plotting.show(
    fig,
    "The slips that 16 cars learn, for pieces of 1 to 59 steps. For single steps "
    "they scatter widely, for whole laps they are close to the true one.",
)

# %% tags=["answer", "claims"]
claim("slip_one_step", learned[1].std(), above=0.07)
claim("slip_whole_run", learned[59].std(), below=0.025)
claim("slip_mean", learned[59].mean(), equals=0.2, within=0.02)
claim("same_slip", (learned[59][0] - found.slip).abs(), below=0.002)
turned = (0.2 * dt * blind.u[..., 1]).abs().rad2deg()
claim("turn_lost", turned.mean(), above=0.3, below=2, unit="degrees")
heading = torch.atan2(blind.y[..., 3], blind.y[..., 2])
true_heading = torch.atan2(blind.x[:, :-1, 3], blind.x[:, :-1, 2])
off = heading - true_heading
seen_error = torch.atan2(off.sin(), off.cos()).rad2deg()
claim("heading_seen", seen_error.std(), above=6, unit="degrees")

# %% [markdown] tags=["answer"]
# The whole lap, by far: over the 16 cars the learned slips have a standard deviation of
# {claim}`slip_whole_run`, against {claim}`slip_one_step` for single steps. In one step the slip
# turns the car by {claim}`turn_lost` on average, and the heading that the sensor sees has an error
# with a standard deviation of {claim}`heading_seen`. In a long simulation the lost turns add up, to
# 72 degrees over a full circle, and carry the car far away. The mean over the cars is
# {claim}`slip_mean`. <!-- given: 72 degrees -->

# %% [markdown]
# A long simulation also adds up the noise of the motion, which is small here. Where it is large,
# pieces of a middle length do best, or a filter, whose gain decides how much an old observation
# still counts: lab exercise 8.7 learns the noise itself in this way. <!-- given: 8.7 -->

# %% [markdown]
# ## On the infinity: planner and filter, end to end
#
# Now everything at once. Planner and filter drive the slipping car, and the score is only how far
# the car truly is from where it should be. The gradient of this score runs backward through
# everything that happened: the motion, the plan, the estimate, the step before, and so on to the
# start. This is called {term}`end-to-end learning`.

# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 2.9))
ax.set(xlim=(-0.2, 10.6), ylim=(-0.6, 3.6), aspect="equal")
ax.axis("off")
for i, j, text in ((1.2, 2.2, "filter"), (4.4, 2.2, "planner"), (7.6, 2.2, "car")):
    sketches.box(ax, i, j, text, width=1.8, height=1.0)
sketches.box(ax, 7.6, 0.2, "distance, squared", width=3.4, height=0.8)
for tail, tip in (((2.1, 2.35), (3.5, 2.35)), ((5.3, 2.35), (6.7, 2.35))):
    sketches.arrow(ax, tail, tip)
    (i, j), (i_tip, _) = tail, tip
    sketches.arrow(ax, (i_tip, j - 0.4), (i, j - 0.4), plotting.RED)
sketches.arrow(ax, (7.4, 1.7), (7.4, 0.6))
sketches.arrow(ax, (7.8, 0.6), (7.8, 1.7), plotting.RED)
sketches.wire(ax, (8.5, 2.4), (9.6, 2.4), (9.6, 3.3), (1.2, 3.3), (1.2, 2.7))
sketches.word(ax, 3.7, 3.0, "observation, with noise")
for i, text in ((2.35, "$X$, $P$"), (5.6, "$u$")):
    sketches.word(ax, i, 2.55, text)
for i, text in ((0.3, "slip,\nsensor's noise"), (3.6, "slip,\nweights")):
    sketches.word(ax, i, 0.9, text, plotting.BLUE)
sketches.word(ax, 8.0, 1.0, "gradient", plotting.RED)
plotting.show(
    fig,
    "Block diagram. The filter gives an estimate to the planner, the planner gives "
    "an input to the car, which is scored and observed. Red arrows lead back.",
)

# %% [markdown]
# Four numbers are to be learned: the slip that both believe in, the noise of the sensor that the
# filter believes in, and the planner's weights of speed and turn rate. The last three have to be
# positive, so we learn their logarithms. Each of the 32 cars gets a copy of its own, a row of
# `theta`, so that we can later look at the gradient of each car alone.


# %%
cars = 32
N = 12  # steps of a drive
horizon = 5


def all_weights(theta):
    """Returns the weights of [x, u] (cars, 6): those of the state are known."""
    known = weights[:4].expand(cars, 4)
    return torch.cat([known, theta[:, 2:].exp()], dim=-1)


def plan_for(theta, x, target, guess):
    """Returns the plans of all cars, (cars, horizon, 2)."""
    Q = all_weights(theta).diag_embed()
    every_step = Q[:, None].expand(cars, horizon, 6, 6)
    car = pp.DubinsCar(dt, theta[:, 0])
    return pp.MPC(car, every_step, None, horizon)(dt, x, target, guess)[1]


# %% [markdown]
# A waypoint that is just reached, or just not, makes a jump in the score, and a jump has no
# gradient. So the target moves along the path, at 1.3 m/s. The cars start all around the infinity.
# All the noise of a drive is drawn beforehand, as standard normal numbers; we shall see why.
# <!-- given: 1.3 m -->


# %%
start_at = infinity.LENGTH * torch.arange(cars)[:, None] / cars
targets = infinity.reference(start_at + 1.3 * dt * torch.arange(N + horizon))


def draw_noise(seed):
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(N + 1, 2, cars, 4, generator=generator)


# %%
def drive(theta, noise, planner=plan_for):
    """Returns the true states (cars, N+1, 4) of cars that believe in theta."""
    ekf = pp.EKF(pp.DubinsCar(dt, theta[:, 0]))
    R = theta[:, 1].exp()[:, None, None] ** 2 * torch.eye(4)
    P = infinity.PRIOR**2 * torch.eye(4)
    x = [targets[:, 0]]
    X = x[0] + infinity.PRIOR * noise[N, 0]
    guess = None
    for i in range(N):
        u = planner(theta, X, targets[:, i : i + horizon], guess)
        guess = pp.shift(u)
        y = x[i] + r * noise[i, 0]
        X, P = ekf(X, y, u[:, 0], P, q**2 * torch.eye(4), R)
        x.append(real.transition(x[i], u[:, 0]) + q * noise[i, 1])
    return torch.stack(x, dim=1)


# %% [markdown]
# The loss is the mean square of the distance to the target. `descend` gives it and its gradient to
# an optimiser, {term}`L-BFGS`. One *iteration* of this optimiser chooses a direction and searches a
# step length along it; each length that it tries is one *evaluation* of the loss, with its
# gradient. We record every evaluation, and the iteration that it belongs to.


# %%
def loss_of_cars(theta, noise, planner=plan_for):
    """Returns the mean square of the distance (m^2) of each car."""
    x = drive(theta.expand(cars, 4), noise, planner)
    away = (x - targets[:, : N + 1])[..., :2]
    return away.square().sum(-1).mean(-1)


# %%
def descend(loss, theta, iterations):
    """Returns a record of (iteration, loss, theta) for every evaluation."""
    theta = theta.clone().requires_grad_()
    search = {"max_iter": iterations, "max_eval": 3 * iterations}
    optimizer = torch.optim.LBFGS([theta], line_search_fn="strong_wolfe", **search)
    record = []

    def evaluate():
        value = loss(theta)
        (theta.grad,) = torch.autograd.grad(value, theta)
        iteration = optimizer.state[theta].get("n_iter", 0)
        record.append((iteration, value.detach(), theta.detach().clone()))
        return value

    optimizer.step(evaluate)
    return record


# %% [markdown]
# We start badly: no slip, a sensor that is believed to be better than it is, with a noise of 0.03
# instead of 0.163, and weights of the inputs ten times those of chapter 3. The noise is the same in
# each evaluation. <!-- given: 0.03, ten times -->

# %%
start = torch.tensor([0.0, math.log(0.03), math.log(0.1), math.log(0.1)])
noise = draw_noise(seed=0)


def loss(theta):
    return loss_of_cars(theta, noise).mean()


record = descend(loss, start, iterations=16)
best = min(record, key=lambda entry: entry[1])[2]
print("learned slip:", best[0].item())
print("learned noise of the sensor:", best[1].exp().item())
print("learned weights of speed and turn rate:", best[2:].exp().tolist())

# %% [markdown]
# **Predict.** Nobody told the car its slip or its sensor's noise, only how well it drove. On drives
# with other noise we compare it with a car that is told the true numbers and has the weights of
# chapter 3. Is the learned one much worse, about equal, or much better?

# %% tags=["answer", "hide-input"]
told = torch.tensor([0.2, math.log(r), math.log(0.01), math.log(0.01)])
others = [draw_noise(seed) for seed in (101, 102, 103)]
rms = {}
for name, theta in (("start", start), ("learned", best), ("told", told)):
    losses = [loss_of_cars(theta, other).mean() for other in others]
    rms[name] = torch.stack(losses).mean().sqrt()
iterations = torch.tensor([entry[0] for entry in record])
falling = torch.stack([entry[1] for entry in record]).sqrt()
last = torch.cat([iterations.diff() > 0, torch.tensor([True])])
ends = last.nonzero()[:, 0]


def lesson(k):
    theta = record[k][2]
    fig, (top, bottom) = plotting.stacked(2, height=2.6)
    title = f"believed: slip {theta[0]:.2f}, noise {theta[1].exp():.3f}"
    plotting.infinity_axes(top, title)
    path = infinity.reference(torch.linspace(0, infinity.LENGTH, 99))
    plotting.plot_reference(top, path, label="the path")
    with torch.no_grad():
        x = drive(theta.expand(cars, 4), noise)
    top.plot(*x.permute(2, 1, 0)[:2], color=plotting.BLUE, lw=0.7)
    bottom.semilogy(falling, ".-", color="black", label="evaluation")
    bottom.semilogy(ends, falling[ends], "s", ms=4, label="end of an iteration")
    bottom.semilogy(k, falling[k], "o", ms=11, mfc="none", label="shown")
    bottom.set(xlabel="evaluation", ylabel="root mean square (m)")
    bottom.locator_params(axis="x", integer=True)
    bottom.legend(loc="lower left")
    return fig


alt = "The drives of 32 cars, and the falling loss against the evaluation."
shown = [0, 2, 3, 5, len(record) - 1]
display(widgets.panels(lesson, shown, "evaluation", alt=alt))

# %% tags=["answer", "claims"]
claim("loop_start", rms["start"], above=0.25, unit="m")
claim("loop_learned", rms["learned"], below=0.08, unit="m")
claim("loop_ratio", rms["learned"] / rms["told"], above=0.9, below=1.1)
claim("loop_iterations", iterations.max(), below=17)
claim("loop_evaluations", len(record), above=12, below=40)
claim("loop_slip", best[0], equals=0.2, within=0.1)
claim("loop_sensor", best[1].exp(), above=0.08, below=0.3)

# %% [markdown] tags=["answer"]
# About equal. On drives with other noise the root mean square of the distance falls from
# {claim}`loop_start` to {claim}`loop_learned`, which is {claim}`loop_ratio` times that of the car
# with the true numbers. The optimiser made {claim}`loop_iterations` iterations and needed
# {claim}`loop_evaluations` evaluations for them. And although nobody asked for the truth, the slip
# comes out near it, at {claim}`loop_slip` (0.2), and so, roughly, does the noise of the sensor, at
# {claim}`loop_sensor` (0.163): to drive well, this filter has to be nearly right about both. They
# are as near as 32 short drives allow; with another noise to learn from they come out a little
# differently. (The noise of the motion was given. Both together could not have been learned from
# driving alone: the estimates depend on their ratio only, as the lab shows.) <!-- given: 0.2 -->

# %% [markdown]
# ## What goes wrong with a gradient
#
# ### The wrong sign
#
# The same loop with the shortcut: the plans are the same, only their gradient is that of
# `one_more_sweep`.


# %%
def plan_by_shortcut(theta, x, target, guess):
    u = plan_for(theta.detach(), x.detach(), target, guess)
    each_car = torch.vmap(one_more_sweep)
    return each_car(u, theta[:, 0], all_weights(theta), x, target)


def loss_by_shortcut(theta):
    return loss_of_cars(theta, noise, plan_by_shortcut).mean()


at = start.clone().requires_grad_()
(exact,) = torch.autograd.grad(loss(at), at)
(swept,) = torch.autograd.grad(loss_by_shortcut(at), at)
print("exact:   ", exact.tolist())
print("shortcut:", swept.tolist())

# %% tags=["hide-input"]
misled = descend(loss_by_shortcut, start, iterations=3)
fig, ax = plt.subplots(figsize=(7, 3.2))
both = [(record, "o-", "exact gradient"), (misled, "s--", "shortcut")]
for entries, style, name in both:
    values = torch.stack([entry[1] for entry in entries]).sqrt()
    ax.semilogy(values, style, ms=5, label=name)
ax.set(xlabel="evaluation", ylabel="root mean square (m)")
ax.locator_params(axis="x", integer=True)
ax.legend()
plotting.show(
    fig,
    "The loss against the evaluation. With the exact gradient it falls; with the "
    "shortcut it jumps up and down and stays far above.",
)

# %% tags=["claims"]
claim("loop_slope", exact[0], above=0.02, unit="m²")
claim("loop_slope_swept", swept[0], below=-0.01, unit="m²")
claim("loop_swept_error", (swept - exact).norm() / exact.norm(), above=0.3)
claim("loop_misled", min(entry[1] for entry in misled).sqrt(), above=0.15, unit="m")
after_three = min(entry[1] for entry in record if entry[0] <= 3).sqrt()
claim("loop_not_misled", after_three, below=0.14, unit="m")

# %% [markdown]
# For the slip the shortcut has the wrong *sign*: {claim}`loop_slope_swept` instead of
# {claim}`loop_slope`. The errors of twelve plans do not cancel, since each plan acts on all that
# come after. After three iterations the exact gradient has brought the cars to
# {claim}`loop_not_misled`, the shortcut at best to {claim}`loop_misled`: its line search expects a
# descent that is not there. (By the exact gradient the loss falls when the slip moves *away* from
# the true one. At this start that is right: while the weights of the inputs are too high, planning
# with a wrong slip helps.) <!-- given: twelve plans, three iterations -->
#
# ### Luck instead of learning
#
# Each evaluation used the same noise. **Predict.** Suppose every evaluation drew noise of its own,
# as the real world does. We estimate the derivative of the loss by the slip at the start, by
# differences with a step $h$ to both sides. What happens as $h$ becomes small: does the estimate
# become better, worse, or does it not matter?

# %% tags=["answer", "hide-input"]
steps = [0.1, 0.03, 0.01]
seeds = range(1, 11)
estimates = {}


def by_seed(theta):
    with torch.no_grad():
        losses = [loss_of_cars(theta, draw_noise(seed)).mean() for seed in seeds]
    return torch.stack(losses)


for h in steps:
    aside = h * torch.eye(4)[0]
    up = by_seed(start + aside)
    down = by_seed(start - aside)
    estimates[h] = (up - down) / (2 * h), (up - down.roll(1)) / (2 * h)
fig, ax = plt.subplots(figsize=(7, 3.2))
for k, (fixed, fresh) in enumerate(estimates.values()):
    ax.plot([k - 0.1] * 10, fixed, "o", color=plotting.BLUE, label="the same noise")
    ax.plot([k + 0.1] * 10, fresh, "x", color=plotting.RED, label="fresh noise")
ax.axhline(exact[0], color="black", lw=0.8, label="exact slope")
ax.axhline(0, color="black", lw=0.8, ls=":")
ax.set_xticks(range(3), [f"h = {h}" for h in steps])
ax.set(ylabel="estimated slope (m²)", xlim=(-0.5, 2.5))
handles, labels = ax.get_legend_handles_labels()
ax.legend([handles[0], handles[1], handles[-1]], [labels[0], labels[1], labels[-1]])
plotting.show(
    fig,
    "Ten estimates of a slope for each step width. With the same noise they agree; "
    "with fresh noise they scatter the more the smaller the step.",
)

# %% tags=["answer", "claims"]
claim("slope_fixed", estimates[0.01][0].std(), below=0.01, unit="m²")
claim("slope_fresh", estimates[0.01][1].std(), above=0.04, unit="m²")
claim("slope_fresh_wide", estimates[0.1][1].std(), below=0.06, unit="m²")
each = start.expand(cars, 4).clone().requires_grad_()
(slopes,) = torch.autograd.grad(loss_of_cars(each, noise).sum(), each)
claim("agree_start", (slopes[:, 0] > 0).sum(), above=26)
each = best.expand(cars, 4).clone().requires_grad_()
(slopes,) = torch.autograd.grad(loss_of_cars(each, noise).sum(), each)
claim("agree_end", (slopes[:, 0] > 0).sum(), above=7, below=25)

# %% [markdown] tags=["answer"]
# Worse. With the same noise on both sides the luck cancels, and for $h = 0.01$ the estimates have a
# standard deviation of {claim}`slope_fixed`. With fresh noise it is {claim}`slope_fresh`, where
# the slope itself is {claim}`loop_slope`: the two losses differ by chance, and dividing by a small
# $2h$ makes that large. A line search, which compares losses, cannot tell better from luckier.

# %% [markdown]
# So hold the noise fixed while you learn ({term}`common random numbers`), and test with another, as
# we did. But a fixed noise can be learned by heart, which is called *overfitting*. At the start the
# derivative by the slip is positive for {claim}`agree_start` of the 32 cars. At the end it is
# positive for {claim}`agree_end` and negative for the others: only its mean vanishes. From there on
# one learns these 32 drives and not the car. More cars help then; more iterations do not.
#
# ### The wrong valley
#
# A gradient leads into the next valley, a *local minimum*, which may not be the deepest. Here is
# the misfit of the second lap's record for all slips, and for pieces of several lengths.

# %% tags=["hide-input"]
guesses = torch.linspace(-1.2, 1.2, 97)


def valleys(length):
    x, u, y = pieces(informed, length)
    states = simulate(guesses[:, None, None], x, u)
    misfit = (states - y).square().sum(-1).mean((-2, -1))
    fig, ax = plt.subplots(figsize=(7, 3))
    ax.semilogy(guesses, misfit, color=plotting.GREY, lw=0.5)
    ax.semilogy(guesses, misfit[:, 0], label="one car")
    ax.axvline(0.2, color=plotting.GREEN, ls="--", label="true slip")
    ax.set(xlabel="guessed slip", ylabel="mean square", ylim=(0.05, 20))
    ax.legend(loc="lower left")
    return fig


whole = informed.y.shape[1] - 1
alt = "The misfit against the guessed slip; long pieces have several valleys."
display(widgets.panels(valleys, [1, 6, 12, 24, whole], "steps in a piece", alt=alt))

# %% tags=["claims"]
from_zero = learn_slip(*pieces(informed, whole))
from_below = learn_slip(*pieces(informed, whole), guess=-0.3)
claim("from_zero", (from_zero - 0.2).abs().max(), below=0.05)
claim("from_below", from_below.mean(), below=-0.5)
claim("from_below_all", (from_below < -0.4).sum(), above=12)

# %% [markdown]
# Started from 0, the slip of every car comes out right, to {claim}`from_zero`. Started from $-0.3$,
# {claim}`from_below_all` of 16 cars end near {claim}`from_below`: in a whole simulated lap, a car
# that turns far too much comes out better than one that turns a little too much. Short pieces have
# one valley, but a shallow one, which noise moves. The symptom is: start elsewhere, end elsewhere.
# The remedy is to begin with short pieces and to lengthen them.
#
# ### No slope at a bound, and a plan that is not finished
#
# Give the planner bounds, vary its weight of the turn rate, and ask for the slope of the first turn
# rate. And end the sweeps of a plan early, so that it is no minimum.

# %%
turn_weights = torch.logspace(-3, 1, 41).requires_grad_()
known = weights[:5].expand(41, 5)
each_Q = torch.cat([known, turn_weights[:, None]], dim=-1).diag_embed()
mpc = pp.MPC(ideal, each_Q[:, None].expand(41, T, 6, 6), None, T)
here = waypoints[0].expand(41, 4)
there = waypoints[1].expand(41, 4)
turn_free = mpc(dt, here, there)[1][:, 0, 1]
turn_bounded = mpc(dt, here, there, **box)[1][:, 0, 1]
(slope_free,) = torch.autograd.grad(turn_free.sum(), turn_weights)
(slope_bounded,) = torch.autograd.grad(turn_bounded.sum(), turn_weights)

once = pp.utils.ReduceToBason(steps=1)
asks = slip.clone().requires_grad_()
with warnings.catch_warnings(record=True, action="always") as heard:
    hasty = pp.MPC(pp.DubinsCar(dt, asks), Q, None, T, once)
    half = hasty(dt, waypoints[0], waypoints[1])[1]
print("warning:", heard[0].message)

# %% tags=["claims"]
claim("no_slope_free", (slope_free == 0).sum(), equals=0)
claim("no_slope_bounded", (slope_bounded == 0).sum(), above=15)
(half_slope,) = torch.autograd.grad(half[0, 1], asks)
claim("half_a_plan", half_slope / by_hand[0, 1], below=0.8)
claim("warned", len(heard), equals=1)

# %% [markdown]
# - **At a bound** the slope is not small but exactly zero, here for {claim}`no_slope_bounded` of 41
#   weights. With such a weight the car turns as hard as it may. The loss may be large, but the
#   gradient does not say in which direction it would become smaller. The symptom is a gradient of
#   exactly 0. Start where inputs are free, or use more of a lap than the steps at the bound.
# - **A plan that is not finished.** After one sweep the slope of the cost is not zero,
#   {eq}`eq-8-chain` does not hold, and the gradient is {claim}`half_a_plan` times the right one.
#   The library warns. Where you want to learn, let the sweeps converge.
#
# There is a fifth difficulty, the worst one: numbers that the loss *cannot* tell apart, whatever
# the gradient is. They are not {term}`identifiable <identifiability>`. The lab shows it.

# %% [markdown]
# ## How we know that a gradient is right
#
# By differences of the loss, along a direction in which all four numbers change. They need two more
# evaluations and make no use of how the gradient was computed.

# %%
way = torch.tensor([1.0, 0.5, -0.5, 0.3])
h = 1e-5
with torch.no_grad():
    difference = (loss(start + h * way) - loss(start - h * way)) / (2 * h)
print("by differences:", difference.item())
print("by gradient:   ", (exact @ way).item())
print("by shortcut:   ", (swept @ way).item())

# %% tags=["claims"]
claim("loop_gradient", (exact @ way / difference - 1).abs(), below=1e-5)
claim("loop_shortcut", (swept @ way / difference - 1).abs(), above=0.1)

# %% [markdown]
# Through twelve plans and twelve filter steps the gradient agrees to {claim}`loop_gradient`. Such a
# test takes a minute to write and finds a wrong or a lost derivative. It does not find a wrong
# loss, a second valley, or a number that the data say nothing about. For that, learn from data that
# you made yourself, with numbers that you know, as this chapter does. <!-- given: a minute -->

# %% [markdown]
# ## Summary
#
# 1. At a minimum the slope is zero for every parameter; differentiating that gives the derivative
#    of a decision, $-H^{-1}\, \partial g / \partial \theta$. It equals differences of plans to
#    {claim}`by_hand_error`, with bounds as well.
# 2. By the envelope theorem the derivative of the least cost does not depend on how the decision
#    moves, so a planner's own cost cannot test its gradient.
# 3. From the record of one lap comes a slip of {claim}`slip_mean` (0.2), and
#    {claim}`informed_finished` of 16 cars finish where {claim}`blind_finished` did. The filter
#    needed it more than the planner.
# 4. From driving alone, through planner and filter, four numbers are learned: the cars stray
#    {claim}`loop_learned` instead of {claim}`loop_start`.
# 5. A gradient is local and can mislead: a shortcut has the wrong sign ({claim}`loop_slope_swept`
#    instead of {claim}`loop_slope`), {claim}`from_below_all` of 16 cars end in a wrong valley, and
#    at a bound {claim}`no_slope_bounded` of 41 slopes are exactly zero.
#
# <!-- given: 0.2 -->
#
# | | paper | here |
# |:--|:--|:--|
# | gradient of a plan | "fully differentiable", no number | exact to {claim}`same_gradient` |
# | gradient through the loop | named, no number | exact to {claim}`loop_gradient` |
#
# **What differs from PyPose.** In PyPose 0.9.5 the gradient of a plan is that of one more
# Gauss-Newton sweep, off by {claim}`shortcut_error` in our example; `A` and `B` of a nonlinear
# system carry no gradient, which an EKF feels, too; bounds are accepted and not used; and a
# nonlinear planner takes no batch, so that these loops would run one car at a time.
#
# **Words of this chapter.** {term}`Stationarity condition`, {term}`Hessian`,
# {term}`implicit function theorem`, {term}`envelope theorem`, {term}`bilevel optimisation`,
# {term}`imperative learning`, {term}`system identification`, {term}`end-to-end learning`,
# {term}`L-BFGS`.
#
# **Further reading.** Amos and others {cite}`amos2018` on differentiable MPC; Blondel and others
# {cite}`blondel2022` on implicit differentiation in general; Ljung {cite}`ljung1999`, chapters 7
# and 10, on identification; Wang and others {cite}`wang2025imperative` on imperative learning.
#
# **In [the lab](../exercises/08_learning.py)** you differentiate a minimiser, write a test for
# gradients, find the place where a gradient was cut, learn a time step from a record and weights
# from an expert, find out what data cannot say, and learn a filter's noise and a robot's lag. Next:
# [chapter 9](09_go1.py) takes the loop to the robot.
