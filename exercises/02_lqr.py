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
# # Lab 2: LQR
#
# This lab belongs to [chapter 2](../book/02_lqr.py). You write the step that everything in LQR
# repeats, find a fault by its symptom, add up a sum without end, remove a constant error, balance a
# pole on a cart, write a test, learn what a driver wants, and walk a simulated robot to a line.
# Together that takes about 110 minutes. <!-- given: 110 minutes -->
#
# Each exercise has three hints, to be opened one after the other, and ends in a check. The check
# tries your answer on numbers that you have not seen. If something is missing, it says what was
# expected, what came, and gives a hint. The exercises do not depend on each other.

# %% tags=["setup"]
import matplotlib.pyplot as plt
import torch

import pypose_lite as pp
from pypose_lite import go1
from pypose_lite.teaching import check, plotting, progress

plotting.use_style()
torch.set_default_dtype(torch.float64)
torch.set_printoptions(precision=3, sci_mode=False)

# %% [markdown]
# ## Exercise 2.1: One Riccati step
#
# *10 minutes. Warm-up.*
#
# From a state $x$, the input $u$ leads to $x' = A x + B u$. The step costs
# $x^\top Q x + u^\top R u$, and all steps after it cost $x'^\top V x'$ if they are done as well as
# possible. Write the function that returns
#
# - the cost-to-go one step earlier: the matrix with which $x^\top V_{\text{before}}\, x$ is the
#   least cost from $x$ on, and
# - the gain `K` of the input that achieves it, $u = K x$.
#
# `A` is $(n, n)$, `B` is $(n, m)$, `Q` and `V` are $(n, n)$, `R` is $(m, m)$; `Q`, `R` and `V` are
# symmetric and positive definite.
#
# :::{dropdown} Hint 1
# Put $x' = A x + B u$ into the cost. What remains is a parabola in $u$. Where is its minimum?
# :::
#
# :::{dropdown} Hint 2
# The derivative with respect to $u$ is zero where $(R + B^\top V B)\, u = -B^\top V A\, x$. A
# system of equations is solved by `torch.linalg.solve(left, right)`.
# :::
#
# :::{dropdown} Hint 3
# With that $K$ the next state is $(A + B K)\, x$, and most terms of the cost cancel:
# $V_{\text{before}} = Q + A^\top V (A + B K)$.
# :::


# %%
def riccati_step(A, B, Q, R, V):
    """Returns V (n, n), the cost-to-go one step earlier, and K (m, n) of u = K x."""
    raise NotImplementedError("2.1 One Riccati step")


# %%
check("2.1", riccati_step)

# %% [markdown]
# ## Exercise 2.2: A car that flees the line
#
# *10 minutes. A fault, found by its symptom.*
#
# A colleague lets the car of the chapter steer to a line that is half a metre to its side. The car
# drives at 1 m/s; only its offset from the line and its heading count. The figure shows what
# happens with their gain, and with a right one.
# <!-- given: half a metre, 1 m/s -->

# %% tags=["hide-input"]
A, B = torch.tensor([[1, 0.1], [0, 1]]), torch.tensor([[0.01], [0.1]])
gains = {"the right gain": (-2.4, -2.5), "the colleague's gain": (2.4, 2.5)}
fig, ax = plt.subplots(figsize=(7, 3))
for name, gain in gains.items():
    x = [torch.tensor([0.5, 0.0])]
    for _ in range(20):
        x.append(A @ x[-1] + B @ (torch.tensor([gain]) @ x[-1]))
    ax.plot(0.1 * torch.arange(21), torch.stack(x)[:, 0].abs(), ".-", label=name)
ax.set(xlabel="time (s)", ylabel="distance from the line (m)")
ax.set(yscale="log", ylim=(1e-3, 1e3))
ax.legend()
alt = "On a logarithmic axis one distance falls in a line, the other rises in one."
plotting.show(fig, alt)

# %% [markdown]
# What is wrong with the colleague's gain? Choose one, and write its letter, as in
# `answer_22 = "a"`.
#
# - (a) The price of the input is a hundred times too high.
# - (b) It is used as $u = K x$, and was made for $u = -K x$.
# - (c) The weights of offset and heading have changed places.
# - (d) It was computed for a single step ahead.
#
# <!-- given: a hundred times -->
#
# :::{dropdown} Hint 1
# The axis is logarithmic. What does a straight line on it say about the distance?
# :::
#
# :::{dropdown} Hint 2
# Three of the four make a controller that is worse. Which of them can make the car leave the line
# faster than it would without any steering?
# :::
#
# :::{dropdown} Hint 3
# Compute `torch.linalg.eigvals(A + B @ K)` for a gain of each sign. An eigenvalue outside of the
# unit circle grows from step to step.
# :::

# %%
raise NotImplementedError("2.2 A car that flees the line")

# %%
check("2.2", answer_22)

# %% [markdown]
# ## Exercise 2.3: What comes after the plan
#
# *15 minutes. A derivation, checked numerically.*
#
# A plan ends after a few steps, but the system does not. Suppose that after the plan it is steered
# by some gain for ever, $u = K x$, which need not be the best one. Each step costs
# $x^\top Q x + u^\top R u$. Derive what all these steps together cost from a state $x$. It is
# $x^\top P x$ with a matrix $P$. Write the function that returns $P$. The gain is stable: all
# eigenvalues of $A + B K$ lie inside the unit circle, some perhaps close to it.
#
# :::{dropdown} Hint 1
# From one step to the next the state is multiplied by $F = A + B K$. What does the very first step
# cost, as $x^\top W x$?
# :::
#
# :::{dropdown} Hint 2
# $W = Q + K^\top R K$. The step after it costs $(F x)^\top W (F x)$, and so on:
# $P = W + F^\top W F + F^\top F^\top W F F + \dots$
# :::
#
# :::{dropdown} Hint 3
# Take the first term away from the sum; what is left is $F^\top P F$. So $P = W + F^\top P F$.
# Begin with $P = W$ and repeat this line until $P$ no longer changes.
# :::


# %%
def cost_of_gain(A, B, Q, R, K):
    """Returns P (n, n): x'Px is what all steps from x on cost if u = K x."""
    raise NotImplementedError("2.3 What comes after the plan")


# %%
check("2.3", cost_of_gain)

# %% [markdown]
# Here is what such a terminal cost does, for the upright pendulum of the chapter. A plan of three
# steps that forgets what comes after it hardly moves the motor. With the $P$ of `dlqr` as terminal
# cost its three inputs are those of the endless plan. <!-- given: three steps -->

# %%
pendulum = pp.Pendulum(dt=0.05)
A_up, B_up = pendulum.linearize(torch.zeros(2), torch.zeros(1))[:2]
Q_up = torch.diag(torch.tensor([1, 0.1]))
R_up = torch.tensor([[0.01]])
K_up, P_up = pp.dlqr(A_up, B_up, Q_up, R_up)
upright = pp.LTI(A_up, B_up, torch.eye(2), torch.zeros(2, 1))
leaning = torch.tensor([0.1, 0.0])
weights = torch.block_diag(Q_up, R_up)
for name, Qf in {"without": None, "with": P_up}.items():
    x_plan, u_plan, cost = pp.LQR(upright, weights, None, T=3, Qf=Qf)(leaning)
    print(name, "terminal cost:", u_plan[:, 0])

x = leaning
endless = []
for _ in range(3):
    endless.append(-K_up @ x)
    x = A_up @ x + B_up @ endless[-1]
print("the endless plan begins with", torch.cat(endless))

# %% [markdown]
# ## Exercise 2.4: Integral action
#
# *15 minutes. A controller with a memory.*
#
# A ship drifts in a steady wind, a heater loses a constant amount of heat: to the input something
# is added that nobody knows, $x' = A x + B (u + d)$ with a constant $d$. The number $C x$ should
# nevertheless become zero. In the chapter the remedy was to add up the errors:
#
# $$ s' = s + C x, \qquad u = K \begin{pmatrix} x \\ s \end{pmatrix} $$
#
# Write the function that returns the best gain $K$ for the weights $Q$ of $x$, `weight` of $s$ (a
# number), and $R$ of $u$, without an end. $A$ is $(n, n)$, $B$ is $(n, 1)$, $C$ is $(1, n)$, and
# $K$ is $(1, n + 1)$, with the gain of $s$ last. You may use `pp.dlqr`.
#
# :::{dropdown} Hint 1
# $[x, s]$ is the state of a larger linear system. What are its $A$ and $B$? Leave $d$ out: LQR does
# not know it.
# :::
#
# :::{dropdown} Hint 2
# The last row of the larger $A$ says how $s'$ depends on $x$ and $s$: it is $[C, 1]$. The last
# column is zero otherwise, and so is the last row of the larger $B$.
# :::
#
# :::{dropdown} Hint 3
# The weights of the larger state are `torch.block_diag(Q, torch.tensor([[weight]]))`. And
# remember the sign: `pp.dlqr` returns a gain for $u = -K x$.
# :::


# %%
def integral_gain(A, B, C, Q, R, weight):
    """Returns K (1, n+1) of u = K [x, s], where s is the sum of all C x so far."""
    raise NotImplementedError("2.4 Integral action")


# %%
check("2.4", integral_gain)

# %% [markdown]
# ## Exercise 2.5: A pole on a cart
#
# *15 minutes. Design, by a threshold.*
#
# A pole stands on a cart. You push the cart with a force $F$; the state is
# $[x, \dot x, \theta, \dot\theta]$, the position of the cart and the angle of the pole from
# upright. The cart stands at 1 m and shall come to 0 without dropping the pole. The gain is that of
# `pp.dlqr`, for the system linearised upright, and it drives the nonlinear system. You choose the
# five weights. The requirements are:
#
# - the force stays below 5 N, and the pole within 0.1 rad of upright;
# - from 2.5 s on the cart is within 5 cm of 0.
#
# <!-- given: 1 m, 5 N, 0.1 rad, 2.5 s, 5 cm -->
#
# Write your weights as a tensor `cart_weights`, in the order of the state, that of the force last.
# With all weights equal the cart is much too slow. The functions below let you see what weights do,
# `report(cart_weights)`.


# %%
def carry(weights):
    """Returns states and forces of the cart, 6 s long, for five weights."""
    cart = pp.CartPole(dt=0.02)
    A, B = cart.linearize(torch.zeros(4), torch.zeros(1))[:2]
    K, _ = pp.dlqr(A, B, torch.diag(weights[:4]), weights[4:, None])
    states = [torch.tensor([1.0, 0.0, 0.0, 0.0])]
    forces = []
    for _ in range(300):
        forces.append(-K @ states[-1])
        states.append(cart.transition(states[-1], forces[-1]))
    return torch.stack(states), torch.stack(forces)[:, 0]


# %%
def report(weights):
    """Prints what is required."""
    states, forces = carry(weights)
    print(f"largest force {forces.abs().max():.2f} N")
    print(f"largest angle {states[:, 2].abs().max():.3f} rad")
    print(f"largest distance after 2.5 s {states[125:, 0].abs().max():.3f} m")


report(torch.ones(5))

# %% [markdown]
# :::{dropdown} Hint 1
# Begin with Bryson's rule: which values of the five numbers would be just acceptable on the way?
# :::
#
# :::{dropdown} Hint 2
# Too slow: raise the weight of $x$. Too wild: raise the weight of $F$. Only ratios count, so
# leave one of the weights at 1.
# :::
#
# :::{dropdown} Hint 3
# A cart that is 0.3 m away, or a pole that leans by 0.3 rad, is just acceptable; so are 1 m/s,
# 1 rad/s and 1 N. Take one over the squares. <!-- given: 0.3 m, 0.3 rad, 1 m, 1 rad -->
# :::

# %%
raise NotImplementedError("2.5 A pole on a cart")

# %%
check("2.5", cart_weights)

# %% [markdown]
# Look at the first half second in the figure. The cart has to go to the left, and it starts to the
# *right*. Only so does the pole lean to the left, and only a pole that leans to the left can be
# carried there. Nobody told LQR; it follows from the model. A system that has to begin in the wrong
# direction is called *non-minimum phase*. <!-- given: half second -->

# %% tags=["hide-input"]
states, forces = carry(cart_weights)
time = 0.02 * torch.arange(301)
fig, (top, bottom) = plotting.stacked(2, height=2.4, sharex=True)
top.plot(time, states[:, 0], label="position of the cart (m)")
top.plot(time, 10 * states[:, 2], "--", label="angle of the pole (0.1 rad)")
bottom.plot(time[:-1], forces, color=plotting.GREEN, label="force (N)")
top.axhline(0, color="black", lw=0.8)
top.fill_between([2.5, 6], -0.05, 0.05, color=plotting.GREY, alpha=0.4)
top.collections[-1].set_label("required")
top.set(ylabel="position, angle")
bottom.set(xlabel="time (s)", ylabel="force (N)")
top.legend(loc="upper right")
plotting.show(
    fig,
    "Position of the cart, angle of the pole and force. The cart moves away from its "
    "goal at first, then to it; the pole leans to the goal and back.",
)

# %% [markdown]
# ## Exercise 2.6: A test for an LQR
#
# *15 minutes. Verification.*
#
# Two colleagues have written the Riccati recursion. One of them forgot a transpose.


# %%
def first_lqr(A, B, Q, R, T):
    """Returns the gains K (T, m, n) of u = K x, the first one first."""
    V = torch.zeros_like(Q)
    gains = []
    for _ in range(T):
        K = -torch.linalg.solve(R + B.mT @ V @ B, B.mT @ V @ A)
        V = Q + A.mT @ V @ (A + B @ K)
        gains.insert(0, K)
    return torch.stack(gains)


def second_lqr(A, B, Q, R, T):
    """Returns the gains K (T, m, n) of u = K x, the first one first."""
    V = torch.zeros_like(Q)
    gains = []
    for _ in range(T):
        K = -torch.linalg.solve(R + B.mT @ V @ B, B.mT @ V @ A)
        V = Q + A @ V @ (A + B @ K)
        gains.insert(0, K)
    return torch.stack(gains)


# %% [markdown]
# They tried both on a system of theirs, and the gains were the same:

# %%
A_try = torch.tensor([[1.0, 0.1], [0.1, 1.0]])
B_try = torch.tensor([[0.0], [0.1]])
first_gains = first_lqr(A_try, B_try, torch.eye(2), torch.eye(1), 50)
second_gains = second_lqr(A_try, B_try, torch.eye(2), torch.eye(1), 50)
print("gains differ by", (first_gains - second_gains).abs().max().item())

# %% [markdown]
# Write a test that is not deceived: a function that is given an LQR, `lqr(A, B, Q, R, T)`, and
# returns `True` if its gains are right and `False` if not. Each step costs
# $x^\top Q x + u^\top R u$, and the state after the last step nothing. You choose the systems on
# which to try it. The check gives your test several right LQRs and several wrong ones, the second
# colleague's among them. You may use this function, which adds up what inputs cost:


# %%
def total_cost(u, x, A, B, Q, R):
    """Returns the cost of the inputs u (T, m) from a state x on."""
    cost = 0
    for t in range(len(u)):
        cost = cost + x @ Q @ x + u[t] @ R @ u[t]
        x = A @ x + B @ u[t]
    return cost


# %% [markdown]
# :::{dropdown} Hint 1
# Why could the colleagues' system not see the fault? Which other faults could it not see, in $R$,
# in $Q$, in the order of the gains?
# :::
#
# :::{dropdown} Hint 2
# Take numbers without any symmetry: $A$ and $B$ from `torch.randn`, more than one input, several
# steps, and $Q$ and $R$ symmetric and positive with no zeros, such as `torch.eye(3) + 0.5`.
# :::
#
# :::{dropdown} Hint 3
# And what is right? Drive the system by the gains. The total cost of these inputs is a minimum, so
# its gradient is zero: `torch.func.grad(total_cost)(u, x, A, B, Q, R)`, from every start. (Or, if
# you trust it, compare with `pp.LQR(system, torch.block_diag(Q, R), None, T).lqr_backward(x)`.)
# :::


# %%
def is_lqr(lqr):
    """Returns whether lqr(A, B, Q, R, T) returns the best gains K (T, m, n)."""
    raise NotImplementedError("2.6 A test for an LQR")


# %%
check("2.6", is_lqr)

# %% [markdown]
# ## Exercise 2.7: What a driver wants
#
# *20 minutes. Differentiate through it.*
#
# Somebody drives the chapter's car from half a metre beside a line onto it. We see the states, an
# offset and a heading in each of 50 steps, with a little noise. We know $A$, $B$ and the weights
# $Q$ of the state, and assume that the driver steers by the best endless gain. Which weight $R$, a
# single number, do they put on the turn rate? <!-- given: half a metre, half, 50 steps -->
#
# `pp.dlqr` is differentiable: a gradient passes from the gain to $R$. So guess $R$, compare what
# the gain does with what was seen, and go downhill. To find what somebody wants from what they do
# is called *inverse optimal control*.
#
# :::{dropdown} Hint 1
# For a guess of $R$, `K, _ = pp.dlqr(A, B, Q, R)` with $R$ of shape $(1, 1)$. The driver's next
# state would be $(A - B K)\, x$.
# :::
#
# :::{dropdown} Hint 2
# A weight has to stay positive. Learn its logarithm: `log_R.exp().reshape(1, 1)`. The loss is the
# mean square of `states[1:] - states[:-1] @ (A - B @ K).mT`.
# :::
#
# :::{dropdown} Hint 3
# `torch.optim.Adam([log_R], lr=0.2)` and 60 rounds: set the gradients to zero, compute the loss,
# `loss.backward()`, `optimizer.step()`. <!-- given: 60 rounds -->
# :::


# %%
def learn_weight(states, A, B, Q):
    """Returns the weight R, one number, of a driver seen at states (51, 2)."""
    raise NotImplementedError("2.7 What a driver wants")


# %%
check("2.7", learn_weight)

# %% [markdown]
# ## Exercise 2.8: The dog walks to a line
#
# *10 minutes. On the robot, simulated.*
#
# A Go1 walks ahead at 0.5 m/s, and a line runs beside it, half a metre to its left. As in the
# chapter, its turn rate is a gain times the offset from the line and the heading. But its legs
# answer late, which no model of ours knows, and they can turn at 1.5 rad/s at most. Find a gain of
# two numbers with which the simulated dog
#
# - asks for no more than 1.5 rad/s,
# - crosses the line by no more than 1 cm,
# - and is within 2 cm of it from 5 s on.
#
# <!-- given: 0.5 m, half a metre, half, 1.5 rad, 1 cm, 2 cm, 5 s -->
#
# Write it as a tensor `dog_gain`, that of the offset first; the turn rate is
# `dog_gain @ [offset, heading]`. You may guess, or let `pp.dlqr` guess for a model without legs. At
# 0.5 m/s its matrices are the following. <!-- given: 0.5 m -->

# %%
dt = 0.1
A_dog = torch.tensor([[1.0, 0.5 * dt], [0.0, 1.0]])
B_dog = torch.tensor([[0.5 * dt**2], [dt]])

# %% [markdown]
# :::{dropdown} Hint 1
# At the start the offset is $-0.5$ m and the heading zero. What does the limit of the turn rate say
# about the first number?
# :::
#
# :::{dropdown} Hint 2
# Give the offset, the heading and the turn rate weights, for example by Bryson's rule, and see what
# comes. With a higher weight of the turn rate the gain becomes smaller.
# :::
#
# :::{dropdown} Hint 3
# Acceptable are 0.1 m, 0.3 rad and 0.3 rad/s. `pp.dlqr` returns the gain for $u = -K x$.
# <!-- given: 0.1 m, 0.3 rad -->
# :::

# %%
raise NotImplementedError("2.8 The dog walks to a line")

# %%
check("2.8", dog_gain)

# %% tags=["hide-input"]
with go1.connect("sim") as robot:
    poses = [robot.pose()]
    for _ in range(80):
        ahead, left, heading = poses[-1]
        turn = dog_gain @ torch.tensor([left - 0.5, heading])
        robot.move(0.5, turn.item())
        robot.wait(dt)
        poses.append(robot.pose())
poses = torch.tensor(poses)
fig, ax = plt.subplots(figsize=(7, 2.8))
ax.axhline(0.5, color=plotting.ORANGE, lw=3, alpha=0.6, label="line")
ax.plot(poses[:, 0], poses[:, 1], ".-", label="the dog, as it says")
ax.set(xlabel="ahead (m)", ylabel="left (m)")
ax.legend(loc="lower right")
plotting.show(fig, "The simulated dog walks to the line and stays on it.")

# %%
progress()
