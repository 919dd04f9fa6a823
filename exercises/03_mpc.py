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
# # Lab 3: MPC
#
# This lab belongs to [chapter 3](../book/03_mpc.py). You write the parts of a planner, find the
# fault in another one, test plans for being optimal, choose a terminal cost, learn what a driver
# believes, and walk the simulated Go1. Each exercise says how long it takes, has three hints to
# open one after the other, and ends in a check. All of them together take about 110 minutes.
# <!-- given: 110 minutes -->

# %% tags=["setup"]
import math

import matplotlib.pyplot as plt
import torch

import pypose_lite as pp
from pypose_lite import go1, infinity
from pypose_lite.teaching import check, plotting, progress

plotting.use_style()
torch.set_default_dtype(torch.float64)

# %% [markdown]
# The car, the weights and the planner are those of the chapter:

# %%
dt = 0.1  # s
Q = torch.diag(torch.tensor([1, 1, 0.3, 0.3, 0.01, 0.01]))  # of [x, u]
car = pp.DubinsCar(dt)
waypoints = infinity.waypoints()
mpc = pp.MPC(car, Q, None, T=10)

# %% [markdown]
# ## Exercise 3.1: A warm start
#
# *5 minutes. Warm-up.*
#
# At time $t$ the planner has found inputs $u_0, \dots, u_{T-1}$. One step later it plans again and
# needs a first guess. Write the function that makes it of the last plan: every input moves one step
# earlier, and the last one is repeated, so that there are again $T$ of them. `u` is $(T, m)$.
#
# :::{dropdown} Hint 1
# The first input of the plan has been used. Which input is the first one now?
# :::
#
# :::{dropdown} Hint 2
# `u[1:]` are all but the first.
# :::
#
# :::{dropdown} Hint 3
# `u[-1:]` is the last one, as a matrix of one row; `torch.cat` puts matrices below each other.
# :::


# %%
def warm_start(u):
    """Returns the first guess (T, m) for the next plan."""
    raise NotImplementedError("3.1 A warm start")


# %%
check("3.1", warm_start)

# %% [markdown]
# ## Exercise 3.2: A line search
#
# *10 minutes. Warm-up.*
#
# A sweep proposes a change of the plan. `cost_after(alpha)` drives the plan with the share `alpha`
# of that change and returns what it really costs. The plan without a change costs `cost_now`. Write
# the line search: among the step lengths in `alphas`, return the one with the least cost, or `0.0`
# if none of them costs less than `cost_now`.
#
# A cost may be `nan` or `inf`, where the step leads to states that the model does not know. Such a
# step must not be taken.
#
# :::{dropdown} Hint 1
# Begin with the best that you know: the step 0, which costs `cost_now`. Then look at one length
# after the other.
# :::
#
# :::{dropdown} Hint 2
# Keep two variables, the best length and its cost, and change both where a cost is lower.
# :::
#
# :::{dropdown} Hint 3
# Every comparison with `nan` is false: `cost < best_cost` refuses it. `min` of a list does not.
# :::


# %%
def line_search(cost_after, cost_now, alphas):
    """Returns the step length with the least cost, or 0.0 where none helps."""
    raise NotImplementedError("3.2 A line search")


# %%
check("3.2", line_search)

# %% [markdown]
# ## Exercise 3.3: A recursion with a fault
#
# *20 minutes. A fault, to be found and mended.*
#
# Along a plan, changes obey $\delta x_{t+1} = A_t\, \delta x_t + B_t\, \delta u_t$, and each step
# costs $\tfrac12 \delta z_t^\top Q\, \delta z_t + q_t^\top \delta z_t$ with
# $\delta z_t = [\delta x_t, \delta u_t]$. The state after the last step costs nothing. A colleague
# has written the backward recursion below. The figure shows what a planner that uses it does: its
# cost settles far above the best one. Find the fault, say to yourself which of the two results it
# spoils, and write the function as it should be. (There is only one fault. The chapter's `backward`
# is the same recursion; try without it first.)
#
# `A` is $(T, n, n)$, `B` is $(T, n, m)$, `Q` is $(n+m, n+m)$, `q` is $(T, n+m)$. Return `k`
# $(T, m)$ and `K` $(T, m, n)$ of $\delta u_t = k_t + K_t\, \delta x_t$.


# %%
def faulty_backward(A, B, Q, q):
    T, n, m = B.shape
    V = torch.zeros(n, n)
    v = torch.zeros(n)
    k = [None] * T
    K = [None] * T
    for t in reversed(range(T)):
        F = torch.cat([A[t], B[t]], dim=-1)
        H = Q + F.mT @ V @ F
        h = q[t] + F.mT @ v
        k[t] = -torch.linalg.solve(H[n:, n:], h[n:])
        K[t] = -torch.linalg.solve(H[n:, n:], H[n:, :n])
        V = H[:n, :n] + H[n:, :n].mT @ K[t]
        v = h[:n]
    return torch.stack(k), torch.stack(K)


# %% tags=["hide-input"]
def planned_with(backward, sweeps=40):
    x = waypoints[0].expand(11, 4)
    u = torch.zeros(10, 2)
    costs = []
    for _ in range(sweeps):
        away = torch.cat([x[:-1] - waypoints[2], u], dim=-1)
        costs.append((away @ Q * away).sum() / 2)
        A, B = car.linearize(x[:-1], u)[:2]
        k, K = backward(A, B, Q, away @ Q)
        new = [x[0]]
        for t in range(10):
            change = 0.5 * k[t] + K[t] @ (new[t] - x[t])
            u = u.index_copy(0, torch.tensor([t]), (u[t] + change)[None])
            new.append(car.transition(new[t], u[t]))
        x = torch.stack(new)
    return torch.stack(costs)


fig, ax = plt.subplots(figsize=(7, 3))
ax.plot(planned_with(faulty_backward), ".-", label="with the faulty recursion")
best = mpc.solve(dt, waypoints[0], waypoints[2]).cost
ax.axhline(best, color="black", ls=":", label="the best cost")
ax.set(xlabel="sweep", ylabel="cost of the plan")
ax.legend()
plotting.show(fig, "The cost of the plan settles far above the best one.")

# %% [markdown]
# :::{dropdown} Hint 1
# $V$ and $v$ describe the same bowl: what the future costs *if the best input is used*. Look at the
# lines that compute them.
# :::
#
# :::{dropdown} Hint 2
# Put $\delta u = k + K \delta x$ into the quadratic with $H$ and $h$, and collect the terms that
# are linear in $\delta x$.
# :::
#
# :::{dropdown} Hint 3
# $v = h_x + H_{ux}^\top k$: the change $k$ of the input moves the slope of the state, too.
# :::


# %%
def backward(A, B, Q, q):
    """Returns k (T, m) and K (T, m, n)."""
    raise NotImplementedError("3.3 A recursion with a fault")


# %%
check("3.3", backward)

# %% [markdown]
# ## Exercise 3.4: A test for plans with bounds
#
# *10 minutes. Verification.*
#
# A plan with bounds is optimal only if a small step downhill, clipped to the bounds, leads nowhere.
# Write the function that says how far it leads: the largest component of
# $|\text{clip}(u - g, u_{\min}, u_{\max}) - u|$, where $g = dJ/du$ is the slope of the cost. `u`
# and `slope` are $(T, m)$, `lower` and `upper` are $(m)$ and may be infinite. Return one number.
#
# :::{dropdown} Hint 1
# Downhill is the direction $-g$.
# :::
#
# :::{dropdown} Hint 2
# `torch.clamp(z, lower, upper)` clips each column to its own bounds.
# :::
#
# :::{dropdown} Hint 3
# Take the absolute value before the maximum: a step down counts as much as a step up.
# :::


# %%
def kkt_residual(u, slope, lower, upper):
    """Returns how far a small, clipped step downhill leads: 0 for an optimal plan."""
    raise NotImplementedError("3.4 A test for plans with bounds")


# %%
check("3.4", kkt_residual)

# %% [markdown]
# ## Exercise 3.5: Which of these plans is not optimal?
#
# *10 minutes. Verification, with your function.*
#
# Here are three plans from the start to the first waypoint. All of them keep the bounds, speed 0
# to 2 m/s and turn rate at most 1.5 rad/s. One of them fails the test of Exercise 3.4, and so
# cannot be optimal. Which one?
# <!-- given: 2 m, 1.5 rad -->

# %%
lower = torch.tensor([0.0, -1.5])
upper = torch.tensor([2.0, 1.5])
guess = torch.tensor([1.0, 1.0]).expand(10, 2)
plans = {
    "a": mpc.solve(dt, waypoints[0], waypoints[1], None, lower, upper).u,
    "b": mpc.solve(dt, waypoints[0], waypoints[1]).u.clamp(lower, upper),
    "c": mpc.solve(dt, waypoints[0], waypoints[1], guess, lower, upper).u,
}


def slope_of(u):
    """Returns the slope of the cost of a plan, (T, m)."""
    u = u.detach().requires_grad_()
    x = [waypoints[0]]
    cost = 0
    for t in range(len(u)):
        away = torch.cat([x[t] - waypoints[1], u[t]])
        cost = cost + away @ Q @ away / 2
        x.append(car.transition(x[t], u[t]))
    return torch.autograd.grad(cost, u)[0]


# %% [markdown]
# Write its letter as `answer_35`, a text such as `"a"`.
#
# :::{dropdown} Hint 1
# Call your `kkt_residual` with each plan, its slope and the bounds.
# :::
#
# :::{dropdown} Hint 2
# An optimal plan has a residual of $10^{-6}$ or less; the other one is far from it.
# :::
#
# :::{dropdown} Hint 3
# Look at how the three plans were made. One of them did not know its bounds while it was planned.
# :::

# %%
raise NotImplementedError("3.5 Which of these plans is not optimal?")

# %%
check("3.5", answer_35)

# %% [markdown]
# ## Exercise 3.6: A terminal cost
#
# *15 minutes. Design.*
#
# With a horizon of two steps the car of the chapter parks. Choose a terminal cost $Q_f$ with which
# it drives the whole infinity in at most 60 steps and, at its steps, is never more than 0.03 m
# from the path. `Qf` is $(4, 4)$ and weighs the last state $[i, j, \cos, \sin]$. Too little is not
# enough to arrive, and too much is not right, either.
# <!-- given: two steps, 0.03 m, 60 steps -->
#
# :::{dropdown} Hint 1
# Try it: `infinity.drive(pp.MPC(car, Q, None, 2, Qf=Qf), steps=60)` drives the lap, and
# `infinity.tracking_error(run.x).max()` is the largest error.
# :::
#
# :::{dropdown} Hint 2
# The chapter took ten times the weights of a step, which is enough to arrive. What stands for a
# longer future has to weigh more.
# :::
#
# :::{dropdown} Hint 3
# A multiple of the identity, or of `Q[:4, :4]`, will do. Go up in factors of three.
# :::

# %%
raise NotImplementedError("3.6 A terminal cost")

# %%
check("3.6", Qf)

# %% [markdown]
# ## Exercise 3.7: What does the driver believe?
#
# *30 minutes. Differentiate through it.*
#
# A driver plans as the chapter does, with a car whose wheels slip, so that it loses the share
# `slip` of each turn rate: `pp.DubinsCar(dt, slip)`. We see where the driver was (`x`, $(N, 4)$),
# which waypoint came next (`target`, $(N, 4)$), and what they did (`u`, $(N, 2)$): the first input
# of each plan, with a little noise. Find the slip that they believe in, to within 0.01. It lies
# between 0 and 0.5. <!-- given: 0.01, 0.5, 0.2 -->
#
# A plan is differentiable: make `slip` a tensor with `requires_grad`, plan, compare with what the
# driver did, and go downhill. The cell below makes the data of a driver who believes in a slip of
# 0.2, so that you can try your function; steps of 0.1 times the slope are a good size.
#
# :::{dropdown} Hint 1
# The planner is `pp.MPC(pp.DubinsCar(dt, slip), Q, None, 10)`, and all plans can be made in one
# call: `planner(dt, x, target)` returns `(states, inputs, cost)` for a batch.
# :::
#
# :::{dropdown} Hint 2
# The loss is the mean square of `inputs[:, 0] - u`. `torch.autograd.grad(loss, slip)` is its slope.
# :::
#
# :::{dropdown} Hint 3
# Begin at `slip = torch.tensor(0.1, requires_grad=True)`. A dozen steps
# `slip = (slip - 0.1 * slope).detach().requires_grad_()` are enough.
# :::

# %%
seen_x = waypoints[:12]
seen_target = waypoints[1:13]
driver = pp.MPC(pp.DubinsCar(dt, slip=0.2), Q, None, 10)
seen_u = driver(dt, seen_x, seen_target)[1][:, 0]


# %%
def believed_slip(x, target, u):
    """Returns the slip with which the driver plans."""
    raise NotImplementedError("3.7 What does the driver believe?")


# %%
check("3.7", believed_slip)

# %% [markdown]
# ## Exercise 3.8: Walk the dog
#
# *15 minutes. On the robot, simulated.*
#
# The Go1 takes the place of the car: `go1.connect("sim")` is a simulated dog that is sent real
# packets. Its trot reaches 1.2 m/s and 1.5 rad/s, its legs answer late, and the plan knows nothing
# of that. Choose bounds of the planner's inputs $[v, \varphi]$, `dog_lower` and `dog_upper`,
# tensors of two numbers that the dog can keep. With them it shall finish the lap within 20 s and
# be less than 0.06 m from the path on average, as it sees itself. (The planner makes three sweeps,
# and a waypoint counts within 0.15 m. The last cell of this exercise is the walk; a try takes some
# seconds.)
# <!-- given: 1.2 m, 1.5 rad, 20 s, 0.06 m, 0.15 m, three sweeps, two numbers -->
#
# :::{dropdown} Hint 1
# Bounds that the dog cannot keep are no bounds: the plan then relies on inputs that never happen.
# :::
#
# :::{dropdown} Hint 2
# Both circles have to be walked: the dog must be able to turn in both directions.
# :::
#
# :::{dropdown} Hint 3
# The lower bound of the turn rate is a negative number. May the speed be negative, too? Try both.
# :::

# %%
raise NotImplementedError("3.8 Walk the dog")

# %%
check("3.8", (dog_lower, dog_upper))

# %% tags=["hide-input"]
planner = pp.MPC(car, Q, None, 10, pp.utils.ReduceToBason(steps=3))
with go1.connect("sim", start=(0.0, 0.0, -math.pi / 2)) as robot:
    world = infinity.RealRobot(robot, dt)
    bounds = {"u_lower": dog_lower, "u_upper": dog_upper}
    walk = infinity.drive(planner, world, tolerance=0.15, **bounds)
fig, ax = plt.subplots(figsize=(7, 3.6))
plotting.plot_waypoints(plotting.infinity_axes(ax), waypoints)
plotting.plot_states(ax, walk.x, label="the dog, as it says")
fig.legend(loc="outside lower center", ncols=2)
plotting.show(fig, "The way of the simulated dog around the infinity sign.")

# %%
progress()
