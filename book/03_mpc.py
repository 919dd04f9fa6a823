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
# # Model predictive control
#
# <!-- given: 1970s -->
# An oil refinery has hundreds of valves. Each of them has a lowest and a highest position, and its
# effect shows only minutes later. Since the 1970s many such plants have been run by one simple
# idea {cite}`rawlings2017`: predict with a model, plan a short way ahead, carry out the first step
# of the plan, look again, and plan anew. The same idea now places the feet of walking robots. It
# is called {term}`model predictive control <MPC>`, MPC. In this chapter the car uses it to drive
# the infinity by itself.
#
# After this chapter you can
#
# - plan for a nonlinear system by iterative LQR, in a few short functions of your own;
# - close the loop around the plan, and choose a horizon, a warm start and a terminal cost;
# - give the planner limits for its inputs, and test whether a plan is optimal;
# - say what this method can do, and when another one is the better choice.
#
# You need [chapter 1](01_systems.py) (the car and its linearisation) and [chapter 2](02_lqr.py)
# (the cost-to-go and the Riccati recursion). Take about 60 minutes. The chapter reproduces Fig. 2
# (a) and (b) of the paper {cite}`pypose06`. <!-- given: 60 minutes -->

# %% tags=["setup"]
import math

import ipywidgets
import matplotlib.pyplot as plt
import torch
from IPython.display import display

import pypose_lite as pp
from pypose_lite import infinity
from pypose_lite.teaching import animate, claim, plotting, sketches, table, widgets

plotting.use_style()
torch.set_default_dtype(torch.float64)

# %% [markdown]
# The car is that of chapter 1. Its *cost* weighs the distance of each state from the next
# waypoint, position and heading, and lightly the inputs. The last line is the paper's.

# %%
dt = 0.1  # s, the length of one time step
T = 10  # steps to plan
p = None  # no linear weights
weights = [1, 1, 0.3, 0.3, 0.01, 0.01]  # of i, j, cos, sin, v, phi
Q = torch.diag(torch.tensor(weights))
car = pp.DubinsCar(dt)
waypoints = infinity.waypoints()
mpc = pp.module.MPC(car, Q, p, T)

# %% [markdown]
# This drives one lap, and then makes all the plans of the lap once more, in one batch, so that we
# can look at them:

# %%
lap = infinity.drive(mpc)
plans = mpc.solve(dt, lap.x[:-1], waypoints[lap.goal])

# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 4.3))
plotting.plot_waypoints(plotting.infinity_axes(ax), waypoints)
[way] = plotting.plot_states(ax, lap.x[:1], label="car")
[ahead] = ax.plot([], [], "kx--", ms=5, lw=1, label="plan, a second ahead")
[aim] = ax.plot([], [], "o", ms=13, mfc="none", color=plotting.GREEN, label="aim")
fig.legend(loc="outside lower center", ncols=4)


def think(frame):
    k = 3 * frame
    paths = lap.x[: k + 1], plans.x[k], waypoints[lap.goal[k], None]
    for line, x in zip([way, ahead, aim], paths):
        line.set_data(*x[:, :2].mT)
    return fig


alt = "A film: a car on the infinity sign, and its plan, which moves on with it."
display(animate(think, len(plans.x) // 3, seconds=0.4, alt=alt))

# %% tags=["claims"]
claim("lap_steps", lap.steps, below=60)
visits = lap.x[torch.searchsorted(lap.goal, torch.arange(17), right=True)]  # in order
near = (visits - waypoints)[:, :2].norm(dim=-1) <= 0.1
claim("visited", near.sum(), equals=17, paper=17)
plan_ends = (plans.x[:, -1] - waypoints[lap.goal])[:, :2].norm(dim=-1)
claim("plan_end", plan_ends.max(), below=0.1, unit="m")

# %% [markdown]
# Every third step is shown. The crosses are the *plan*: ten steps, one second, that bring the car
# to the waypoint in the ring, up to {claim}`plan_end`. The car takes the first step of it and
# throws the others away. Then it looks where it is, and plans anew. The end of the plan moves on
# with the car like a horizon, which is why one also speaks of a {term}`receding horizon`. After
# {claim}`lap_steps` steps the car has visited all {claim}`visited` waypoints. <!-- given: ten
# steps, one second, Every third -->

# %% [markdown]
# ## It fails: a model that is linear once
#
# The LQR of chapter 2 needs a linear model, and the car's is different in every heading. Here are
# two ways to use it all the same. `one_gain` linearises the car once, at the start, where it
# drives at 1 m/s, and keeps the gain of `dlqr`. `one_sweep` calls `pp.LQR` anew in every step,
# with a model that is linear around the car as it stands there. <!-- given: 1 m -->

# %%
forward = torch.tensor([1.0, 0.0])
A, B = car.linearize(waypoints[0], forward)[:2]
gain, _ = pp.dlqr(A, B, Q[:4, :4], Q[4:, 4:])


def one_gain(dt, x, target):
    u = forward - gain @ (x - target)  # dlqr's gain is for u = -K x
    return None, u[None], None


def one_sweep(dt, x, target):
    return pp.LQR(car, Q, None, T)(x, dt, target=target)


# %% [markdown]
# **Predict.** How far do they get: both around the infinity, only the second one, or neither?

# %% tags=["answer", "hide-input"]
stuck = {"one_gain": infinity.drive(one_gain, steps=60)}
stuck["one_sweep"] = infinity.drive(one_sweep, steps=60)
fig, panels = plotting.stacked(2, height=2.5)
for ax, (name, run) in zip(panels, stuck.items()):
    plotting.plot_waypoints(plotting.infinity_axes(ax, name), waypoints)
    plotting.plot_states(ax, run.x, label="car")
handles, labels = panels[0].get_legend_handles_labels()
fig.legend(handles, labels, loc="outside lower center", ncols=2)
plotting.show(fig, "Two maps: with one gain and with one sweep the car stops early.")

# %% tags=["answer", "claims"]
claim("one_gain_reached", stuck["one_gain"].goal.max() - 1, below=16)
claim("one_sweep_reached", stuck["one_sweep"].goal.max() - 1, below=16)
last_moves = [(run.x[-1] - run.x[-2]).norm() for run in stuck.values()]
claim("stand_still", max(last_moves), below=1e-3)

# %% [markdown] tags=["answer"]
# Neither. Of the 16 waypoints after the start `one_gain` reaches {claim}`one_gain_reached` and
# `one_sweep` {claim}`one_sweep_reached`. Then the car stands still. The gain was made for a car
# that looks down; in another heading its correction cancels the forward speed, and nothing is left
# of it. The sweep has a subtler fault. For a car that *stands*, a small turn changes no position,
# and a small drive changes only the position ahead. That turning *now* helps driving *later* is a
# product of two changes, and a linear model has no products. Beside a waypoint whose heading it
# already has, such a car has no reason to move: chapter 1 called it parked. <!-- given: 16
# waypoints -->

# %% [markdown]
# ## The idea: linear along a guess
#
# The car has to be linearised not where it stands but along the way that it is *going to take*. We
# do not know this way; it is what we want to plan. So we guess a plan, linearise along it, solve
# the LQR problem that results, and get a better plan. Then we linearise along the better one, and
# so on. This is {term}`iterative LQR <iLQR>` {cite}`li2004ilqr`; one round of it is called a
# *sweep*.

# %% tags=["hide-input"]
after_sweeps = []
for count in (1, 2, 3, 16):
    limit = pp.utils.ReduceToBason(steps=count, decreasing=0, tol=0)
    found = pp.MPC(car, Q, p, T, limit).solve(dt, waypoints[0], waypoints[3])
    after_sweeps.append((count, found))
fig, ax = plt.subplots(figsize=(7, 3.6))
colors = [plotting.SKY, plotting.GREEN, plotting.PURPLE, plotting.BLUE]
styles = ["v:", "s-.", "^--", "o-"]
for (count, found), style, color in zip(after_sweeps, styles, colors):
    label = f"after {count} sweeps" if count > 1 else "after 1 sweep"
    ax.plot(*found.x[:, :2].mT, style, ms=4, color=color, label=label)
ax.plot(0, 0, "k*", ms=11, label="start, and the first guess")
plotting.plot_waypoints(ax, waypoints[3:4], label="target")
ax.set(xlabel="i (m)", ylabel="j (m)", aspect="equal", ylim=(-0.95, 0.1))
ax.legend(loc="upper right")
plotting.show(
    fig,
    "Plans from the start to the third waypoint after 1, 2, 3 and 16 sweeps. The "
    "first guess stands still at the start; the later plans end near the target.",
)

# %% tags=["claims"]
ends = [(found.x[-1] - waypoints[3])[:2].norm() for _, found in after_sweeps]
claim("planned_end", ends[-1], below=0.1, unit="m")
claim("first_guess_end", (waypoints[0] - waypoints[3])[:2].norm(), above=1, unit="m")

# %% [markdown]
# The first guess here is to stand still, {claim}`first_guess_end` away from the target. The last
# plan ends {claim}`planned_end` from it. To get there we need three things: the LQR problem along a
# guess, its solution, and care about how far to follow it.

# %% [markdown]
# ## Derived: the sweep of iterative LQR
#
# We look for the inputs $u_0, \dots, u_{T-1}$ with the least total cost
#
# $$
# J = \sum_{t=0}^{T-1} \tfrac12 (z_t - r)^\top Q\, (z_t - r)
# $$ (eq-3-cost)
#
# subject to $x_{t+1} = f(x_t, u_t)$. Here $z_t = [x_t, u_t]$ is state and input, and $r$ is the
# target, with zeros for the inputs.
#
# **The problem along a guess.** Let $x_t, u_t$ be the guess, and $\delta x_t$, $\delta u_t$ small
# changes of it. To first order they obey
#
# $$ \delta x_{t+1} = A_t\, \delta x_t + B_t\, \delta u_t = F_t\, \delta z_t $$ (eq-3-linear)
#
# with the Jacobians of chapter 1 and $F_t = [A_t \; B_t]$. The start is given, so $\delta x_0 = 0$.
# Each step of {eq}`eq-3-cost` becomes, up to a constant that no change can influence,
#
# $$
# \tfrac12\, \delta z_t^\top Q\, \delta z_t + (Q\, (z_t - r))^\top \delta z_t
# $$ (eq-3-expanded)
#
# So the changes have a *linear* system and a quadratic cost, as in chapter 2. One thing is new: the
# second term, a slope. Changing the guess a little makes it a little better or worse.
#
# **The solution.** By {term}`dynamic programming`, assume that we know what all steps after step
# $t$ cost, as a function of the change of the next state: a bowl with curvature $V$ and slope $v$,
#
# $$
# \tfrac12\, \delta x_{t+1}^\top V\, \delta x_{t+1} + v^\top \delta x_{t+1}
# $$ (eq-3-value)
#
# After the last step nothing more is paid, so $V = 0$ and $v = 0$ there. Insert
# $\delta x_{t+1} = F_t\, \delta z_t$: the bowl becomes
# $\tfrac12 \delta z_t^\top F_t^\top V F_t\, \delta z_t + v^\top F_t\, \delta z_t$. Add the step
# itself, {eq}`eq-3-expanded`. Together they are a quadratic in $\delta z_t$ with the curvature $H$
# and the slope $h$,
#
# $$
# \begin{aligned}
# H &= Q + F_t^\top V F_t \\
# h &= Q\, (z_t - r) + F_t^\top v
# \end{aligned}
# $$ (eq-3-model)
#
# Split both into the part of the state and the part of the input: $H_{xx}$, $H_{ux}$, $H_{uu}$ and
# $h_x$, $h_u$. $H_{uu}$ is positive definite, since the weights of the input are and $V$ is a bowl.
# For a given $\delta x_t$ the cost is least where its derivative with respect to $\delta u_t$
# vanishes, $H_{uu}\, \delta u_t + H_{ux}\, \delta x_t + h_u = 0$. Hence
# $\delta u_t = k_t + K_t\, \delta x_t$ with
#
# $$
# \begin{aligned}
# k_t &= -H_{uu}^{-1} h_u \\
# K_t &= -H_{uu}^{-1} H_{ux}
# \end{aligned}
# $$ (eq-3-gains)
#
# $K_t$ is the feedback that we know from chapter 2. $k_t$ is new: it is the change of the input
# that improves the guess. Insert this $\delta u_t$ and collect the terms in $\delta x_t$. Those
# with $H_{uu} k_t + h_u$ vanish, by {eq}`eq-3-gains`, and the bowl one step earlier has
#
# $$
# \begin{aligned}
# V_{\text{before}} &= H_{xx} + H_{ux}^\top K_t \\
# v_{\text{before}} &= h_x + H_{ux}^\top k_t
# \end{aligned}
# $$ (eq-3-back)
#
# So the recursion runs from the last step to the first.
#
# **Care.** The new plan drives the *real* model, not the linear one, and the linear one may promise
# too much if the change is large. So only a share $\alpha$ of the change is made, a *step length*
# between 0 and 1:
#
# $$
# \begin{aligned}
# u_t^{\text{new}} &= u_t + \alpha\, k_t \\
# & \quad + K_t\, (x_t^{\text{new}} - x_t)
# \end{aligned}
# $$ (eq-3-step)
#
# ($K_t$ needs no share: it reacts to how far the states have really moved.) For a small $\alpha$
# the linear model is right, and the cost falls. Try $\alpha = 1$, then smaller ones, and keep the
# plan that really costs least, or the old one if none is cheaper. This is a {term}`line search`.
# The cost then never rises from one sweep to the next.

# %% [markdown]
# ## From scratch: a planner in three functions
#
# First, what a plan costs, and how a new one is driven. The numbers are those of the equations.


# %%
def cost_of(x, u, target):
    away = torch.cat([x[:-1] - target, u], dim=-1)
    return (away @ Q * away).sum() / 2  # (3.1)


def follow(x, u, k, K, alpha):
    """Returns states and inputs of a new plan, driven by the real model."""
    x_new = [x[0]]
    u_new = []
    for t in range(len(u)):
        change = alpha * k[t] + K[t] @ (x_new[t] - x[t])
        u_new.append(u[t] + change)  # (3.8)
        x_new.append(car.transition(x_new[t], u_new[t]))
    return torch.stack(x_new), torch.stack(u_new)


# %% [markdown]
# Second, the recursion. It is chapter 2's with the slopes $h$, $v$ and $k$ added.


# %%
def backward(x, u, target):
    """Returns k and K of all steps, from the linear model along a plan."""
    A, B = car.linearize(x[:-1], u)[:2]
    away = torch.cat([x[:-1] - target, u], dim=-1)
    V = torch.zeros(4, 4)
    v = torch.zeros(4)
    k = [None] * len(u)
    K = [None] * len(u)
    for t in reversed(range(len(u))):
        F = torch.cat([A[t], B[t]], dim=-1)
        H = Q + F.mT @ V @ F  # (3.5)
        h = Q @ away[t] + F.mT @ v
        Hux = H[4:, :4]
        k[t] = -torch.linalg.solve(H[4:, 4:], h[4:])  # (3.6)
        K[t] = -torch.linalg.solve(H[4:, 4:], Hux)
        V = H[:4, :4] + Hux.mT @ K[t]  # (3.7)
        v = h[:4] + Hux.mT @ k[t]
    return k, K


# %% [markdown]
# Third, the sweep: linearise and solve, then search along the change.


# %%
def sweep(x, u, target):
    """Returns a plan that costs no more than the one given."""
    k, K = backward(x, u, target)
    best = cost_of(x, u, target), x, u
    for alpha in (1.0, 0.5, 0.25, 0.1):
        x_new, u_new = follow(x, u, k, K, alpha)
        cost = cost_of(x_new, u_new, target)
        if cost < best[0]:
            best = cost, x_new, u_new
    return best


# %%
x = waypoints[0].expand(T + 1, 4)  # the first guess: stand still
u = torch.zeros(T, 2)
costs = [cost_of(x, u, waypoints[3])]
for _ in range(16):
    cost, x, u = sweep(x, u, waypoints[3])
    costs.append(cost)
costs = torch.stack(costs)
print("cost of the guess:", costs[0].item())
print("after 1 and 16 sweeps:", costs[1].item(), costs[16].item())

# %% tags=["claims"]
claim("never_rises", (costs.diff() <= 0).all(), equals=True)
claim("first_cost", costs[0], above=10)
claim("last_cost", costs[-1], below=5)

# %% [markdown]
# The cost falls from {claim}`first_cost` to {claim}`last_cost`, and never rises on the way.

# %% [markdown]
# ## The library's plan, and Newton's curvature
#
# `mpc.solve` does the same, and also says whether the plan has converged, after how many sweeps,
# and what each of them cost.

# %%
solved = mpc.solve(dt, waypoints[0], waypoints[3])
print("converged:", solved.converged.item())
print("sweeps:", solved.iterations.item())
print("largest difference to ours:", (solved.u - u).abs().max().item())

# %% tags=["claims"]
claim("same_plan", (solved.u - u).abs().max(), below=1e-6)

# %% [markdown]
# **Predict.** Near the end each of our sweeps leaves a certain share of the gap to the best cost.
# After how many sweeps is the library's gap below $10^{-10}$, if ours needs ten: also after ten,
# after about six, or after two? <!-- given: ten -->

# %% tags=["answer", "hide-input"]
gaps = {"ours": costs - solved.cost, "library": solved.history - solved.cost}
gaps = {name: gap.where(gap > 2e-15, torch.nan) for name, gap in gaps.items()}
fig, ax = plt.subplots(figsize=(7, 3.2))
ax.semilogy(gaps["ours"], "s--", ms=5, label="ours: Gauss-Newton")
ax.semilogy(gaps["library"], "o-", ms=5, label="library: Newton near the end")
ax.set(xlabel="sweep", ylabel="cost above the best")
ax.legend()
plotting.show(
    fig,
    "The cost above the best against the sweep, with a logarithmic axis. Ours falls "
    "on a straight line, the library's bends down steeply.",
)

# %% tags=["answer", "claims"]
share = (gaps["ours"][9] / gaps["ours"][5]) ** (1 / 4)
claim("left_by_a_sweep", share, above=0.02, below=0.1)
claim("sweeps_by_hand", (gaps["ours"] > 1e-10).sum(), equals=10)
claim("sweeps_of_library", (gaps["library"] > 1e-10).sum(), below=9)
ratio = gaps["library"][6].log() / gaps["library"][5].log()  # of the gaps' digits
claim("digits_grow", ratio, above=1.5, below=2.6)

# %% [markdown] tags=["answer"]
# After about six: {claim}`sweeps_of_library`, compared with {claim}`sweeps_by_hand`. With the
# logarithmic axis ours is a straight line: each sweep leaves about {claim}`left_by_a_sweep` of the
# gap. That is *linear convergence*. Our $H$ knows the curvature of the cost but treats $f$ as
# linear, which is the {term}`Gauss-Newton method`. Near the end the library adds the curvature of
# $f$ to $H$, as {term}`Newton's method` does, and the number of zeros in the gap grows by a factor
# of about {claim}`digits_grow` in a sweep. Far from the solution that curvature may mislead, and
# the library does without it, as we did. <!-- given: six -->

# %% [markdown]
# With the curvature of $f$ in $H$, the sweep is known as {term}`differential dynamic programming`.
# These are the places of our functions in the library, in the folder `control`:
#
# | ours | the library's | in the file |
# |:--|:--|:--|
# | `backward` | `riccati`, and `riccati_step` for one step | `riccati.py` |
# | `follow` | `follow` | `sweep.py` |
# | `sweep`, with its line search | `sweep` and `line_search` | `sweep.py` |
# | the loop of sixteen sweeps | `optimize`, until nothing changes | `ilqr.py` |
#
# A last file, `verdict.py`, compares what each sweep promised with what it kept, and makes the next
# one more cautious where that was too little. <!-- given: sixteen sweeps -->

# %% [markdown]
# ## The infinity, driven from waypoint to waypoint
#
# Now we close the loop. Two lines of it are the paper's, word for word: the noise, and the call of
# `mpc`. A waypoint counts as reached when the car sees itself within a *tolerance* of it;
# then the next one becomes the target.

# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 3))
sketches.planning_loop(ax)
plotting.show(
    fig,
    "Block diagram of a loop. The planner gets a target and what the car sees, and "
    "gives its first input to the car. What is seen of the car, with noise, goes "
    "back to the planner, and to a box that asks whether the target is reached.",
)


# %%
def drive(q, tolerance, steps=200):
    x = [waypoints[0]]
    y = []
    goal = 1
    for i in range(steps):
        y.append(car.observation(x[i], None))
        v = q * torch.randn(4)  # observation noise
        if (y[i] + v - waypoints[goal])[:2].norm() <= tolerance:
            goal = goal + 1
        if goal == len(waypoints):
            break
        target = waypoints[goal]
        xt, u, cost = mpc(dt, y[i] + v, target)
        x.append(car.transition(x[i], u[0]))
    return torch.stack(x)


ideal = drive(q=0.0, tolerance=0.1)

# %% tags=["claims"]
claim("same_lap", (ideal - lap.x).abs().max(), below=1e-8)
claim("end_error", lap.x[-1, :2].norm(), below=0.1, unit="m")
speeds = lap.u[:, 0]
claim("fastest", speeds.max(), above=4, unit="m/s")
claim("slowest", speeds.min(), below=1, unit="m/s")

# %% [markdown]
# `infinity.drive(mpc)` is the same loop for a batch of cars, and for robots; it also begins each
# plan with the last one. Below is the paper's figure. In panel (b) sixteen cars are disturbed by
# the book's noise: a standard deviation of 0.005 on each component of the state in every step, and
# of 0.163 on each component of what they see. A car that sees so badly may stand at a waypoint and
# not know it, so the tolerance is 0.3 m here, and each plan gets three sweeps: it need not be more
# exact than what it knows about the car. <!-- given: 0.1 m, 0.3 m, three sweeps, sixteen cars -->

# %%
stepper = pp.utils.ReduceToBason(steps=3)  # ends the sweeps of a plan after three
three_sweeps = pp.module.MPC(car, Q, p, T, stepper)

# %% tags=["hide-input"]
usual = infinity.OBSERVATION_NOISE


def noisy_laps(noise=usual, controller=three_sweeps, cars=16):
    generator = torch.Generator().manual_seed(0)
    start = waypoints[0].expand(cars, 4)
    disturbed = infinity.PROCESS_NOISE
    world = infinity.SimulatedCar(car, start, disturbed, noise, generator)
    return infinity.drive(controller, world, tolerance=0.3, steps=60)


# %% tags=["hide-input"]
noisy = noisy_laps()
fig, (a, b) = plotting.stacked(2, height=2.7)
for ax, title in [(a, "(a) ideal"), (b, "(b) with observation noise")]:
    plotting.plot_waypoints(plotting.infinity_axes(ax, title), waypoints)
b.plot(*noisy.x[1:].permute(2, 1, 0)[:2], color=plotting.GREY, lw=0.4)
b.lines[0].set_label("15 other cars")
plotting.plot_states(a, lap.x, label="car")
plotting.plot_states(b, noisy.x[0], label="car")
fig.legend(*b.get_legend_handles_labels(), loc="outside lower center", ncols=3)
plotting.show(
    fig,
    "The paper's figure 2. In panel (a) the car follows the infinity sign through "
    "all waypoints. In panel (b) sixteen noisy cars fluctuate around it.",
)

# %% tags=["hide-input"]
in_time = infinity.drive(three_sweeps, tolerance=0.3)
runs = {"ideal, tolerance 0.1 m": lap, "ideal, tolerance 0.3 m": in_time}
runs["16 with noise, tolerance 0.3 m"] = noisy
rows = []
means = {}
for name, run in runs.items():
    error = infinity.tracking_error(run.x[..., :-1, :])[run.running]
    means[name] = error.mean()
    count = run.steps.double().mean()
    rows.append(f"{name} | {count:.0f} | {error.mean():.3f} | {error.max():.3f}")
display(table("car | steps | mean error (m) | largest (m)", rows))

# %% tags=["claims"]
claim("mean_error", means["ideal, tolerance 0.1 m"], below=0.03, unit="m")
claim("largest_error", infinity.tracking_error(lap.x).max(), below=0.1, unit="m")
claim("all_finish", noisy.finished.all(), equals=True)
seen_error = (noisy.y - noisy.x[:, :-1])[..., :2].norm(dim=-1)[noisy.running].mean()
claim("raw_error", seen_error, equals=0.2045, within=0.01, unit="m", paper=0.2045)
claim("wildest_speed", noisy.u[..., 0].abs().max(), above=6, unit="m/s")
fluctuates = means["16 with noise, tolerance 0.3 m"] / means["ideal, tolerance 0.3 m"]
claim("fluctuates", fluctuates, above=2)

# %% [markdown]
# The ideal car ends {claim}`end_error` from the centre. At its steps it is {claim}`mean_error` from
# the path on average and {claim}`largest_error` at most. The dots bunch before every waypoint. The
# cost weighs the distance to the target and hardly the speed, so the car rushes towards a new
# target, at up to {claim}`fastest`, and slows down to {claim}`slowest` as it comes near.
#
# With noise all cars arrive as well, but the path *fluctuates*, in the paper's word: the mean error
# is {claim}`fluctuates` times as large as without. The car sees itself {claim}`raw_error` from
# where it is and believes it. We chose our noise so that the expected value of this number is the
# paper's raw error, which stands in a comment of the paper's source; it is calibrated, not
# reproduced. Chapter 4 takes the noise out.
#
# Move the slider to see a single lap with more observation noise, and what the car was told to do.


# %% tags=["hide-input"]
def plot_inputs(ax, u):
    time = dt * torch.arange(len(u))
    ax.step(time, u[:, 0], "-", where="post", label="speed (m/s)")
    ax.step(time, u[:, 1], "--", where="post", label="turn rate (rad/s)")
    ax.set(xlabel="time (s)", ylabel="input", ylim=(-12, 16))
    ax.legend(loc="upper right", ncols=2)


def one_lap(noise, horizon=10):
    controller = pp.MPC(car, Q, p, horizon, stepper)
    run = noisy_laps(noise, controller, cars=1)
    fig, (top, bottom) = plotting.stacked(2, height=2.5)
    title = f"noise {noise} m, horizon {horizon}, tolerance 0.3 m"
    plotting.plot_waypoints(plotting.infinity_axes(top, title), waypoints)
    plotting.plot_states(top, run.x[0], label="car")
    plot_inputs(bottom, run.u[0])
    return fig


# %% tags=["hide-input"]
amounts = [0.0, 0.05, 0.1, 0.163]
alt = "A lap of one car, and its inputs; with more noise both become wilder."
display(widgets.panels(one_lap, amounts, "observation noise (m)", alt=alt))

# %% tags=["remove-cell"]
amount = ipywidgets.FloatSlider(0.16, min=0.0, max=0.3, step=0.01)
amount.description = "noise (m)"
length = ipywidgets.IntSlider(10, min=2, max=20, description="horizon")
alt = "A lap of one car and its inputs, for the chosen noise and horizon."
widgets.live(one_lap, alt=alt, noise=amount, horizon=length)

# %% [markdown]
# ### Warm start and real-time iteration
#
# The last plan, moved on by one step (`pp.shift`), is almost the plan of now: a much better first
# guess than standing still. Beginning with it is called a {term}`warm start`.

# %%
moved_on = pp.shift(plans.u[:-1])
warm = mpc.solve(dt, lap.x[1:-1], waypoints[lap.goal[1:]], u_init=moved_on)
same_aim = lap.goal.diff() == 0
sweeps_cold = plans.iterations[1:][same_aim].double().mean()
sweeps_warm = warm.iterations[same_aim].double().mean()
print("mean number of sweeps, cold:", sweeps_cold.item())
print("mean number of sweeps, warm:", sweeps_warm.item())

# %% tags=["claims"]
claim("same_plans", (warm.u - plans.u[1:]).abs().max(), below=1e-6)
claim("sweeps_cold", sweeps_cold, above=3, below=6)
claim("sweeps_warm", sweeps_warm, below=4)
one = pp.MPC(car, Q, p, T, pp.utils.ReduceToBason(steps=1))
once_lap = infinity.drive(one, steps=60)
claim("once_error", infinity.tracking_error(once_lap.x).mean(), below=0.07, unit="m")
guess = None
costs_once = []
for x_now, goal in zip(once_lap.estimate, once_lap.goal):
    quick = one.solve(dt, x_now, waypoints[goal], u_init=guess)
    guess = pp.shift(quick.u)
    costs_once.append(quick.cost)
best = mpc.solve(dt, once_lap.estimate, waypoints[once_lap.goal])
worse = 100 * (torch.stack(costs_once) / best.cost - 1)[1:]
kept_aim = once_lap.goal.diff() == 0
claim("once_same_aim", worse[kept_aim].max(), below=3, unit="%")
claim("once_new_aim", worse[~kept_aim].max(), above=1, below=20, unit="%")

# %% [markdown]
# While the target stays the same, a warm start needs {claim}`sweeps_warm` sweeps on average, a
# cold one {claim}`sweeps_cold`. If time is short, make a single sweep in each step:
# {term}`real-time iteration` {cite}`diehl2005`. While the target stays the same, a plan of such a
# lap costs at most {claim}`once_same_aim` more than the best one, and just after a new target at
# most {claim}`once_new_aim`. The lap strays {claim}`once_error` from the path on average, compared
# with {claim}`mean_error`.

# %% [markdown]
# ## How far to look: horizon and terminal cost
#
# **Predict.** Plans of 2, 3, 4 and 20 steps: which of them bring the car around?
# <!-- given: 20 steps -->

# %% tags=["answer", "hide-input"]
laps = {10: lap}
for horizon in [2, 3, 4, 5, 6, 8, 20]:
    laps[horizon] = infinity.drive(pp.MPC(car, Q, p, horizon), steps=60)
finished = {}
for horizon in sorted(laps):
    if laps[horizon].finished:
        finished[horizon] = infinity.tracking_error(laps[horizon].x).max()


# %% tags=["answer", "hide-input"]
def look_ahead(horizon):
    fig, (top, bottom) = plotting.stacked(2, height=2.5)
    plotting.infinity_axes(top, f"horizon {horizon}")
    plotting.plot_waypoints(top, waypoints)
    plotting.plot_states(top, laps[horizon].x, label="car")
    errors = finished.values()
    bottom.plot(finished.keys(), errors, "o-", color=plotting.GREY, label="finished")
    bottom.axvline(horizon, ls="--", label="this horizon")
    bottom.set(xlabel="horizon (steps)", ylabel="largest error (m)", ylim=(0, 0.1))
    bottom.set_xticks(range(2, 21, 2))
    bottom.legend(loc="lower right")
    return fig


alt = "A lap for each horizon, and the largest error against the horizon."
display(widgets.panels(look_ahead, [2, 3, 4, 10, 20], "horizon (steps)", alt=alt))

# %% tags=["answer", "claims"]
claim("shortest", min(finished), equals=4)
claim("error_4", finished[4], below=0.1, unit="m")
claim("error_20", finished[20], below=0.07, unit="m")
falls = torch.stack(list(finished.values())).diff()
claim("longer_is_better", (falls < 0).all(), equals=True)
means_by_horizon = [infinity.tracking_error(laps[h].x).mean() for h in finished]
rises = (torch.stack(means_by_horizon).diff() > 0).any()
claim("mean_rises", rises, equals=True)
one_step, _, _ = pp.MPC(car, Q, p, 1)(dt, waypoints[0], waypoints[1])
claim("one_step_moves", (one_step - waypoints[0]).norm(), below=1e-9, unit="m")

# %% [markdown] tags=["answer"]
# Those of 4 and 20 steps: {claim}`shortest` is the shortest horizon that gets around, with this
# tolerance. With a shorter one the car parks. To come nearer it would have to turn away from the
# heading that it already has; that costs something now, and a short plan counts the smaller
# distance too few times to pay for it. The largest error falls from {claim}`error_4` to
# {claim}`error_20` as the horizon grows. (The *mean* error does not fall steadily, since it is not
# what the plans minimise: their cost knows the next waypoint and nothing of the circles between.)
# <!-- given: 20 steps -->

# %% [markdown]
# Chapter 2's gain settled only {claim}`02_lqr.settled_after` steps before the end. A horizon of 10
# steps gives another gain than the endless one, but a good enough one: only the first input of each
# plan is used, and the plan is renewed in every step. <!-- given: 10 steps -->
#
# In {eq}`eq-3-cost` the sum ends with step $T - 1$: as in PyPose, the state after the last step
# costs nothing. So the last input has nothing to gain, and a plan of one step does not move at all.
# The remedy is a {term}`terminal cost`, a weight $Q_f$ of the last state,
#
# $$ \tfrac12\, (x_T - r)^\top Q_f\, (x_T - r) $$ (eq-3-terminal)
#
# where $r$ is the target without the inputs. It stands for everything that comes after the horizon.
# Our recursion then begins with $V = Q_f$ and $v = Q_f (x_T - r)$ instead of zeros, and `cost_of`
# gains the new term.

# %%
short = pp.MPC(car, Q, p, T=2, Qf=10 * Q[:4, :4])
short_lap = infinity.drive(short, steps=60)
print("finished:", short_lap.finished.item(), "steps:", short_lap.steps.item())

# %% tags=["claims"]
claim("short_finished", short_lap.finished, equals=True)
claim("short_error", infinity.tracking_error(short_lap.x).max(), below=0.1, unit="m")
claim("short_plain_finished", laps[2].finished, equals=False)

# %% [markdown]
# With ten times the weights of a step as terminal cost, even two steps are enough: the largest
# error is {claim}`short_error`. In general the best choice is the cost-to-go that we do not know.
# For a linear system it is the $P$ of `dlqr`, and a short plan with $Q_f = P$ equals the endless
# one, as chapter 2 showed. With constraints, many proofs of stability rest on a terminal cost
# together with a *terminal set* {cite}`rawlings2017`. And there is a warning. For a car with such
# quadratic weights, however long the horizon, there are starts beside the target, and close to it,
# from which the car does not move {cite}`mueller2017`. <!-- given: ten times, two steps -->

# %% [markdown]
# ## A second system: the pendulum swings up
#
# The car is kind: it stops when we do nothing. A pendulum is not. It hangs at rest, shall stand
# upright, and its motor is limited to 5 N m, about half of what would lift it directly. It has to
# swing. <!-- given: 5 N m, half -->

# %%
pendulum = pp.Pendulum(dt=0.05)
swing_Q = torch.diag(torch.tensor([1, 0.1, 0.01]))  # of angle, rate, torque
hanging = torch.tensor([math.pi, 0.0])  # the angle is measured from upright
nudge = torch.full((60, 1), 0.1)  # a first guess, N m
plain = pp.MPC(pendulum, swing_Q, None, T=60)
farsighted = pp.MPC(pendulum, swing_Q, None, T=60, Qf=10 * swing_Q[:2, :2])
plain_plan = plain.solve(0.05, hanging, None, nudge, u_lower=-5.0, u_upper=5.0)
plan = farsighted.solve(0.05, hanging, None, nudge, u_lower=-5.0, u_upper=5.0)
again = plain.solve(0.05, hanging, None, plan.u, u_lower=-5.0, u_upper=5.0)

# %% tags=["hide-input"]
time = 0.05 * torch.arange(61)
fig, (top, bottom) = plotting.stacked(2, height=2.4)
for result, style, name in [(plan, "-", "with"), (plain_plan, "--", "without")]:
    top.plot(time, result.x[:, 0], style, label=f"{name} terminal cost")
    torque = result.u[:, 0]
    bottom.step(time[:-1], torque, style, where="post", label=f"{name} terminal cost")
top.axhline(0, color="black", lw=0.8, ls=":")
top.set(ylabel="angle from upright (rad)", xlabel="time (s)")
bottom.set(ylabel="torque (N m)", xlabel="time (s)")
top.legend(loc="lower left")
plotting.show(
    fig,
    "Angle and torque of two plans. With a terminal cost the pendulum swings up, "
    "almost upright; without it, it is pushed to one side and stays low.",
)

# %% tags=["claims"]
claim("swing_converged", (plan.converged & plain_plan.converged).all(), equals=True)
claim("swing_sweeps", plan.iterations, below=80)
claim("swing_end", plan.x[-1, 0].abs(), below=0.4, unit="rad")
claim("plain_end", plain_plan.x[-1, 0].abs(), above=1.5, unit="rad")
squares = torch.cat([plan.x[:-1], plan.u], dim=-1).square()
swing_cost = (squares @ swing_Q.diag()).sum() / 2
claim("swing_cost", swing_cost, below=190)
claim("plain_cost", plain_plan.cost, above=200)
claim("again_cost", again.cost, below=190)

# %% [markdown]
# With a terminal cost, {claim}`swing_sweeps` sweeps find the swing-up, which ends
# {claim}`swing_end` from upright. Without it the planner finds a plan that ends {claim}`plain_end`
# from upright, and that plan has converged, too: no small change makes it cheaper. But a large one
# does. The steps of the swing-up cost {claim}`swing_cost`, those of the other plan
# {claim}`plain_cost`. Started from the swing-up, even the planner without a terminal cost keeps
# it, at {claim}`again_cost`: it was there all the time. Iterative LQR finds a *local* minimum.
# Which one depends on the first guess, and a terminal cost can lead the way to a better one.

# %% [markdown]
# ## Bounds, and how we know that a plan is optimal
#
# With noise, the planner asked for up to {claim}`wildest_speed`; even the ideal lap asks for
# {claim}`fastest`. No small robot can do that. Let this one only drive forward, at 2 m/s at most,
# and turn at 1.5 rad/s at most. One planner knows these bounds. Another one plans as before, and
# its inputs are clipped afterwards. <!-- given: 2 m, 1.5 rad -->

# %%
lower = torch.tensor([0.0, -1.5])
upper = torch.tensor([2.0, 1.5])
bounds = {"u_lower": lower, "u_upper": upper}


def clipped(dt, x, target):
    xt, u, cost = three_sweeps(dt, x, target)
    return xt, u.clamp(lower, upper), cost


knowing_lap = infinity.drive(three_sweeps, tolerance=0.15, steps=100, **bounds)
clipped_lap = infinity.drive(clipped, tolerance=0.15, steps=100)

# %% tags=["hide-input"]
fig, panels = plotting.stacked(2, height=2.5)
both = [("knows its bounds", knowing_lap), ("clipped", clipped_lap)]
for ax, (title, run) in zip(panels, both):
    plotting.plot_waypoints(plotting.infinity_axes(ax, title), waypoints)
    plotting.plot_states(ax, run.x, label="car")
handles, labels = panels[0].get_legend_handles_labels()
fig.legend(handles, labels, loc="outside lower center", ncols=2)
plotting.show(
    fig,
    "Two laps with limited inputs. The planner that knows its bounds gets around; "
    "the clipped one misses its turns and stops.",
)

# %% tags=["claims"]
reached = knowing_lap.goal.max() - 1 + knowing_lap.finished
claim("knows_reached", reached, equals=16)
claim("clipped_reached", clipped_lap.goal.max() - 1, below=16)
tolerances = [0.1, 0.2, 0.3]
knows = [infinity.drive(three_sweeps, tolerance=t, **bounds) for t in tolerances]
clips = [infinity.drive(clipped, tolerance=t, steps=100) for t in tolerances]
claim("knows_finishes", sum(run.finished for run in knows), equals=3)
claim("clipped_finishes", sum(run.finished for run in clips), equals=0)

# %% [markdown]
# <!-- given: 16 waypoints, 0.15 m -->
# Of the 16 waypoints the planner that knows reaches {claim}`knows_reached`, the clipped one
# {claim}`clipped_reached`; then it parks. (The tolerance is 0.15 m here. With three others, the
# first one finishes {claim}`knows_finishes` times and the second one {claim}`clipped_finishes`
# times.) What the clipped planner planned never happens: it counts on a speed and on turns that the
# car does not have. No error message warned us. In the sweep of the other one, an input that stands
# at its bound and is pushed outward is held there and gets no feedback; the others are free
# {cite}`tassa2014`.
#
# What must hold at the best plan? It is something about the slope of the cost, $g = dJ/du$, and
# can be tested without a second solver. A free input needs $g = 0$. An input at its bound may have
# a slope if going downhill, the direction of $-g$, leads out of the box. These are the {term}`KKT
# conditions` of Karush, Kuhn and Tucker, and for a box they fit in one line: a step downhill,
# clipped, must lead nowhere.
#
# $$ \text{clip}(u - g,\, u_{\min},\, u_{\max}) - u = 0 $$ (eq-3-kkt)


# %%
def kkt_residual(u, target, lower, upper):
    """Returns how far a step downhill leads, for a plan from the first waypoint."""
    u = u.detach().requires_grad_()
    states = [waypoints[0]]
    for t in range(T):
        states.append(car.transition(states[t], u[t]))
    cost = cost_of(torch.stack(states), u, target)
    (slope,) = torch.autograd.grad(cost, u)
    return ((u - slope).clamp(lower, upper) - u).abs().max()


bounded = mpc.solve(dt, waypoints[0], waypoints[1], u_lower=lower, u_upper=upper)
cut = mpc.solve(dt, waypoints[0], waypoints[1]).u.clamp(lower, upper)
print("bounded plan:", kkt_residual(bounded.u, waypoints[1], lower, upper).item())
print("clipped plan:", kkt_residual(cut, waypoints[1], lower, upper).item())

# %% tags=["claims"]
claim("kkt_bounded", kkt_residual(bounded.u, waypoints[1], lower, upper), below=1e-6)
claim("kkt_clipped", kkt_residual(cut, waypoints[1], lower, upper), above=0.01)
claim("at_bounds", ((bounded.u == lower) | (bounded.u == upper)).sum(), above=0)
infinite = torch.full((2,), math.inf)
lost = mpc.solve(dt, waypoints[0], waypoints[4])
nudged = mpc.solve(dt, waypoints[0], waypoints[4], u_init=torch.full((T, 2), 0.1))
claim("kkt_lost", kkt_residual(lost.u, waypoints[4], -infinite, infinite), below=1e-6)
claim("lost_moves", (lost.x - waypoints[0]).abs().max(), below=1e-6, unit="m")
claim("nudged_cost", nudged.cost / lost.cost, below=0.5)

# %% [markdown]
# The bounded plan passes, with {claim}`at_bounds` of its 20 inputs at a bound; the clipped one does
# not. But the test sees only slopes. Ask for a plan from the start to the fourth waypoint, which
# lies exactly to the side and faces backwards: the planner *stands still*, converges, and passes.
# A nudge as first guess finds a plan with {claim}`nudged_cost` of its cost. KKT tells a flat place
# from a slope. It does not tell a valley from a ridge, nor the deepest valley from another.

# %% [markdown]
# ## Where this method stands
#
# iLQR is one of several ways to solve the planning problem. It treats the inputs as unknowns and
# lets the model compute the states, a *single shooting* method, and its time grows only linearly
# with the horizon. It handles bounds of inputs well and has no place for constraints on states,
# such as walls. {term}`Collocation` {cite}`rawlings2017` makes states and inputs unknowns side by
# side, with the model as a constraint. A general solver then also accepts walls and obstacles, and
# a first guess of the states. For linear models with linear constraints the problem is a quadratic
# programme, for which there are special solvers.

# %% [markdown]
# ## Summary
#
# 1. MPC plans $T$ steps ahead, takes the first, and plans again; with it the car visits
#    {claim}`visited` waypoints and strays {claim}`mean_error` on average, {claim}`largest_error` at
#    most.
# 2. Iterative LQR linearises along a guess, solves backward for $k$ and $K$, and searches along the
#    change; ours needs {claim}`sweeps_by_hand` sweeps, with Newton's curvature it is
#    {claim}`sweeps_of_library`.
# 3. A horizon of {claim}`shortest` steps is the shortest that gets around; a terminal cost stands
#    for what lies beyond it.
# 4. Bounds belong in the plan: {claim}`knows_reached` waypoints against {claim}`clipped_reached`;
#    the KKT residual tells them apart, {claim}`kkt_bounded` against {claim}`kkt_clipped`.
# 5. Noise makes the error {claim}`fluctuates` times as large; a plan is a local minimum, and
#    where one is found depends on the first guess.
#
# | | paper | here |
# |:--|:--|:--|
# | ideal, Fig. 2 (a) | visits 17 waypoints in order | {claim}`visited`, in order |
# | noise, Fig. 2 (b) | "fluctuates", no number | error times {claim}`fluctuates` |
# | raw observation | 0.2045 m, in a comment | {claim}`raw_error`, calibrated |
#
# <!-- given: 0.2045 m -->
#
# **What differs from PyPose.** In PyPose 0.9.5 the third argument of the call is a first guess of
# the inputs; the paper's call with a target runs as printed only here. There `u_lower`, `u_upper`
# and `du` are accepted and not used, sweeps have no line search, and there is no terminal cost.
#
# **Words of this chapter.** {term}`Model predictive control <MPC>`, {term}`receding horizon`,
# {term}`iterative LQR <iLQR>`, {term}`Gauss-Newton method`, {term}`Newton's method`,
# {term}`differential dynamic programming`, {term}`line search`, {term}`warm start`,
# {term}`real-time iteration`, {term}`terminal cost`, {term}`KKT conditions`.
#
# **Further reading.** Rawlings, Mayne and Diehl {cite}`rawlings2017`, chapters 1 and 8, for the
# theory; Tassa, Mansard and Todorov {cite}`tassa2014` for bounds; Müller and Worthmann
# {cite}`mueller2017` for cars and terminal costs.
#
# **In [the lab](../exercises/03_mpc.py)** you write a line search and a test for bounded plans,
# mend a recursion with a fault, choose a terminal cost, learn the slip that a driver believes in
# by the gradient of a plan, and walk the simulated Go1 with the loop of this chapter.
