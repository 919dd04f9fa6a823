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
# # LQR: the best linear steering
#
# Chapter 1 ended with a car that does not look where it goes. Now it looks. This chapter answers
# one question: if the model is linear and the cost is quadratic, which input is best? The answer is
# a matrix, found in one sweep from the last step to the first. It is the engine of chapter 3.
#
# After it you can
#
# - write a cost that says what you want, and what you are willing to pay;
# - derive and code the Riccati step, and check it in four independent ways;
# - make a car follow a curve by LQR around a trajectory;
# - say when LQR is the wrong tool, and show it by a number;
# - learn what somebody wants from what they do.
#
# You need [chapter 1](01_systems.py), matrix products, and the minimum of a parabola. Take about
# 90 minutes. The paper introduces LQR {cite}`pypose06` but shows no figure of it; we draw the
# panels of its Fig. 2. <!-- given: 90 minutes -->

# %%
import inspect
import math

import ipywidgets
import matplotlib.pyplot as plt
import torch
from IPython.display import display

import pypose_lite as pp
from pypose_lite import go1, infinity
from pypose_lite.control import riccati
from pypose_lite.teaching import claim, plotting, table, widgets

plotting.use_style()
torch.set_default_dtype(torch.float64)
dt = 0.1  # s, one time step


# %% tags=["hide-input"]
def drive(car, policy, x, noise=0.0):
    """States and inputs of a car, or a batch of them, steered by policy(i, x)."""
    generator, states, inputs = torch.Generator().manual_seed(1), [x], []
    for i in range(len(u_ref)):
        w = noise * torch.randn(x.shape, generator=generator)
        inputs.append(policy(i, states[-1]))
        states.append(car(states[-1], inputs[-1])[0] + w)
    return torch.stack(states, dim=-2), torch.stack(inputs, dim=-2)


def open_loop(i, x):
    return u_ref[i].expand(*x.shape[:-1], 2)


turn = 2 * math.pi / (64 * dt)  # rad/s
phi = torch.tensor([turn / 2] + [turn] * 63 + [0.0] + [-turn] * 63)
speed = 2 * math.sin(turn * dt / 2) / dt  # m/s
u_ref = torch.stack([torch.full_like(phi, speed), phi], dim=-1)
x_ref, _ = drive(pp.DubinsCar(dt), open_loop, infinity.waypoints()[0])


# %% tags=["hide-input"]
def feedback(K):
    return lambda i, x: u_ref[i] + pp.bmv(K[i], x - x_ref[i])


Q = torch.diag(torch.tensor([1, 1, 0.3, 0.3, 0.01, 0.01]))  # weights of [x, u]
z_ref = torch.cat([x_ref[:-1], u_ref], dim=-1)
controller = pp.LQR(pp.DubinsCar(dt), Q, -z_ref @ Q, T=len(u_ref))
K, k = controller.lqr_backward(x_ref[0], dt, u_ref)
bad_car = pp.DubinsCar(dt, slip=0.05)
policies = {"open loop": open_loop, "LQR": feedback(K)}
fig, panels = plt.subplots(1, 2, figsize=(7, 2.9), sharey=True)
for ax, (name, policy) in zip(panels, policies.items()):
    x, _ = drive(bad_car, policy, x_ref[0], noise=0.005)
    plotting.plot_waypoints(plotting.infinity_axes(ax, name), infinity.waypoints())
    plotting.plot_states(ax, x, label="car with slip and noise")
    ax.set_ylim(-1.3, 1.9)
    ax.label_outer()
fig.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=2)
plt.show()
claim("result_error", infinity.tracking_error(x).max(), below=0.06, unit="m")

# %% [markdown]
# Both cars slip by 5 % and are shaken by the same noise. The left one plays back its inputs. The
# right one adds a correction in each step: a matrix $K_i$ times its distance from where it should
# be. This chapter is about that matrix. <!-- given: 5 % -->
#
# The folded cells make the reference: states `x_ref` that lie exactly on the circles, and the
# inputs `u_ref` that produce them. Chapter 1's inputs were off by half a step's turn; here the
# first step turns by half, and the step between the circles not at all. `drive` lets a car be
# steered by any function of the step and the state.

# %% [markdown]
# ## See it fail
#
# Chapter 1's tool was the open loop. Two hundred cars, one lap, with slip, noise, or both:
#
# **Predict.** LQR knows nothing of the slip. Will its slipping car, without noise, end up exactly
# on the path, about 1 cm beside it, or about 10 cm? <!-- given: 1 cm, 10 cm -->

# %% mystnb={"markdown_format": "myst"}
cars, largest, rows = x_ref[0].expand(200, 4), {}, []
troubles = {"slip": (0.05, 0.0), "noise": (0.0, 0.005), "both": (0.05, 0.005)}
for name, (slip, noise) in troubles.items():
    for kind, policy in policies.items():
        x, _ = drive(pp.DubinsCar(dt, slip), policy, cars, noise)
        largest[kind, name] = infinity.tracking_error(x).amax(-1).mean()
    open_error, lqr_error = largest["open loop", name], largest["LQR", name]
    rows.append(f"{name} | {open_error:.3f} | {lqr_error:.3f}")
display(table("largest error in a lap (m) | open loop | LQR", rows))
claim("open_both", largest["open loop", "both"], above=0.5, unit="m")
claim("lqr_both", largest["LQR", "both"], below=0.04, unit="m")
claim("lqr_slip", largest["LQR", "slip"], above=0.005, below=0.02, unit="m")
claim("lqr_noise", largest["LQR", "noise"], below=0.035, unit="m")

# %% [markdown]
# <details><summary>Answer</summary>
#
# About a centimetre: {claim}`lqr_slip`. The correction is proportional to the error. To keep
# turning more than the reference, the car needs an error to react to. What remains is the error at
# which the correction just makes up for the slip.
#
# </details>
#
# With both, the open loop strays {claim}`open_both` at its worst, LQR {claim}`lqr_both`: means over
# the cars.

# %% [markdown]
# ## From scratch
#
# Take the simplest case. The car drives along a straight line at 1 m/s, but half a metre beside it.
# Only two numbers matter: the offset from the line and the heading. For small headings a step of
# chapter 1's car is linear in them, $x' = A x + B u$, with the turn rate as the only input.
#
# What do we want? To be on the line, without violent steering. We say it by prices: 1 for a squared
# metre of offset, 0.1 for a squared radian of heading, 0.1 for the square of the turn rate, in each
# step. <!-- given: 0.5 m -->
#
# Now think from the end. In the last step no input can help any more: zero is best. In the step
# before, we know what each next state will cost, so the best input is the minimum of a parabola.
# And then the step before that. Five lines:


# %%
def by_hand(A, B, Q, R):
    """All gains, u = K x, and the cost-to-go of the first step, 1/2 x' V x."""
    V, gains = torch.zeros_like(Q), []
    for t in reversed(range(len(A))):
        H = R + B[t].mT @ V @ B[t]
        K = -torch.linalg.solve(H, B[t].mT @ V @ A[t])
        V = Q + A[t].mT @ V @ (A[t] + B[t] @ K)
        gains.append(K)
    return torch.stack(gains[::-1]), V


def sideways(speed):
    """How [offset, heading] changes in a step, and what a turn rate does to it."""
    A = torch.tensor([[1, speed * dt], [0, 1]])
    return A, torch.tensor([[speed * dt**2], [dt]])


A, B = sideways(speed=1.0)
T, Q_side, R_side = 60, torch.diag(torch.tensor([1, 0.1])), torch.tensor([[0.1]])
gains, V = by_hand(A.expand(T, 2, 2), B.expand(T, 2, 1), Q_side, R_side)

# %% [markdown]
# Does the real car, with its sines and cosines, do what the linear model promises?

# %%
line, real = [torch.tensor([0.5, 0.0])], [torch.tensor([0.0, 0.5, 1.0, 0.0])]
for K_t in gains:
    line.append(A @ line[-1] + B @ (K_t @ line[-1]))
    i, j, c, s = real[-1]
    (turn_rate,) = K_t @ torch.stack([j, torch.atan2(s, c)])
    u = torch.stack([torch.ones(()), turn_rate])
    real.append(pp.DubinsCar(dt)(real[-1], u)[0])
line, real = torch.stack(line), torch.stack(real)
fig, ax = plt.subplots(figsize=(7, 2.8))
ax.plot(dt * torch.arange(T + 1), line[:, 0], color=plotting.ORANGE, lw=3, alpha=0.6)
ax.plot(dt * torch.arange(T + 1), real[:, 1], ".-")
ax.legend(["linear model", "real car"])
ax.set(xlabel="time (s)", ylabel="offset from the line (m)")
plt.show()
claim("promise_kept", (line[:, 0] - real[:, 1]).abs().max(), below=0.02, unit="m")
claim("on_the_line", real[-1, 1].abs(), below=0.01, unit="m")

# %% [markdown]
# It does, to within {claim}`promise_kept`. Now the equations. The cost of $T$ steps is
#
# $$ J = \sum_{t=0}^{T-1} \tfrac12 x_t^\top Q\, x_t + \tfrac12 u_t^\top R\, u_t $$ (eq-2-cost)
#
# $x_t$ is the state, $u_t$ the input; $Q$ holds the prices of the state, $R$ those of the input.
# The halves are there because derivatives then look nicer. Let $\tfrac12 x^\top V_{t+1} x$ be the
# *cost-to-go*: what the steps from $t+1$ on cost if we do our best. In step $t$ we pay for $x$ and
# $u$, and then for the next state $x' = A x + B u$:
#
# $$ \tfrac12 x^\top Q x + \tfrac12 u^\top R u + \tfrac12 x'^\top V_{t+1}\, x' $$ (eq-2-bellman)
#
# In $u$ this is a parabola with curvature $H = R + B^\top V_{t+1} B$. Its minimum is linear in $x$:
#
# $$ u = K_t x, \qquad K_t = -H^{-1} B^\top V_{t+1} A $$ (eq-2-gain)
#
# Put this $u$ back. Since $H K_t + B^\top V_{t+1} A = 0$, most terms cancel, and the cost is again
# a quadratic in $x$, with
#
# $$ V_t = Q + A^\top V_{t+1} (A + B K_t), \qquad V_T = 0 $$ (eq-2-riccati)
#
# That is all. {eq}`eq-2-gain` and {eq}`eq-2-riccati` are the *Riccati recursion*, published for
# control by Kalman {cite}`kalman1960control`, and they are the lines of `by_hand`.

# %% [markdown]
# ## The library's version
#
# `by_hand` cannot say "be further left", or "there is a side wind": linear terms and constants. The
# library lets them ride along. With $z = [u, x, 1]$, a step $x' = A x + B u + c$ is one matrix,
# $[x', 1] = G z$, and any quadratic cost, linear terms included, is $\tfrac12 z^\top M z$. Then one
# step of the recursion is four numbered lines, and everything linear-quadratic in this library is
# this function:

# %%
print(inspect.getsource(riccati.riccati_step).split('"""')[2])

G = riccati.homogeneous_dynamics(A, B)
M = riccati.homogeneous_cost(torch.block_diag(R_side, Q_side), torch.zeros(3))
V1, library_gains = torch.zeros(3, 3), []
for _ in range(T):
    V1, K1, failed = riccati.riccati_step(V1, M, G)
    library_gains.insert(0, K1[:, :2])
claim("same_gains", (torch.stack(library_gains) - gains).abs().max(), below=1e-12)
claim("same_cost_to_go", (V1[:2, :2] - V).abs().max(), below=1e-12)

# %% [markdown]
# $H$ is now the curvature in $[u, x, 1]$ together; its corner $H_{uu}$ is ours. Cholesky writes it
# as $L L^\top$, and half of the solve, $W = -L^{-1} H_{u[x,1]}$, serves twice: (3) goes the other
# half to the gain, and (4) takes off what the best input saves,
# $\tfrac12 \lVert W [x, 1] \rVert^2$. That is {eq}`eq-2-riccati` again, but $W^\top W$ stays
# symmetric under rounding. The lines for a `box` are chapter 3's: they price any $K$, also one that
# was cut at a bound.
#
# `pp.LQR` is this step in a loop, with PyPose's signature: one $Q$ for $z = [x, u]$, in this order,
# and a linear term `p`.
#
# Is there a second opinion? Nothing forces us to go backwards. $2J$ is a sum of squares of numbers
# that are linear in all inputs at once: an ordinary least-squares problem with $T$ unknowns. Any
# textbook of statistics solves it, without a word about control.


# %%
def weighted(inputs):
    """The sum of the squares of these numbers is 2 J."""
    x, terms = torch.tensor([0.5, 0.0]), []
    for u in inputs.split(1):
        terms += [Q_side.sqrt() @ x, R_side[0].sqrt() * u]
        x = A @ x + B @ u
    return torch.cat(terms)


zeros = torch.zeros(T)
jacobian = torch.func.jacrev(weighted)(zeros)
least_squares = torch.linalg.lstsq(jacobian, -weighted(zeros)[:, None]).solution
system = pp.LTI(A, B, C=torch.eye(2), D=torch.zeros(2, 1))
lqr = pp.LQR(system, torch.block_diag(Q_side, R_side), None, T)
x_plan, u_plan, cost = lqr(torch.tensor([0.5, 0.0]))
claim("equals_least_squares", (u_plan - least_squares).abs().max(), below=1e-10)

# %% [markdown]
# Same inputs. The least-squares matrix has $3T \times T$ entries; the recursion touches each step
# once, and it gives more: not inputs but a *rule*, good for any state.
#
# **Predict.** The rule depends on the time that is left. How many steps before the end does the
# gain begin to differ by more than 1 % from what it would be if there were no end: about 5, 25, or
# 60? <!-- given: 1 % -->

# %%
K_inf, P = pp.dlqr(A, B, Q_side, R_side)  # u = -K_inf x: the sign is the custom there
to_go = torch.arange(T, 0, -1)
fig, ax = plt.subplots(figsize=(7, 2.8))
for column, name in enumerate(["on the offset", "on the heading"]):
    (curve,) = ax.plot(to_go, -gains[:, 0, column], ".-", label=name)
    ax.axhline(K_inf[0, column], color=curve.get_color(), ls="--", lw=1)
ax.plot([], color=plotting.GREY, ls="--", lw=1, label="no end (dlqr)")
ax.set(xlabel="steps to go", ylabel="gain, turned positive")
ax.invert_xaxis()
ax.legend(loc="lower left")
plt.show()
apart = ((gains + K_inf) / K_inf).abs().amax((1, 2))
claim("end_matters", (apart > 0.01).sum(), above=15, below=35)
claim("dlqr_is_the_limit", apart[0], below=1e-4)

# %% [markdown]
# <details><summary>Answer</summary>
#
# {claim}`end_matters` steps. Further from the end, the car steers as if it drove for ever. That is
# why chapter 3 may plan a short way ahead, again and again.
#
# </details>

# %% [markdown]
# ## On the infinity
#
# The infinity is no straight line. But *along the reference* the car is nearly linear, with other
# matrices in each step: chapter 1's `linearize`, at all 128 reference points in one call. In the
# deviations $\delta x = x - x_{\text{ref}}$ and $\delta u = u - u_{\text{ref}}$ it is
# $\delta x' = A_t \delta x + B_t \delta u$, and our `by_hand` takes matrices that change. In the
# library such a system is an `LTV`, and `pp.LQR` makes the same step from the car itself; all three
# agree. The prices are those of the whole book: 1 for a squared metre, 0.3 for $\cos$ and $\sin$,
# 0.01 for the inputs. <!-- given: 0.3, 0.01 -->

# %%
A_t, B_t = pp.DubinsCar(dt).linearize(x_ref[:-1], u_ref)[:2]
K_hand, V_hand = by_hand(A_t, B_t, Q[:4, :4], Q[4:, 4:])
print("A:", tuple(A_t.shape), " B:", tuple(B_t.shape), " K:", tuple(K.shape))
claim("same_on_the_infinity", (K_hand - K).abs().max(), below=1e-10)
K_ten, _ = by_hand(A_t, B_t, 10 * Q[:4, :4], 10 * Q[4:, 4:])
claim("only_the_ratio", (K_ten - K).abs().max(), below=1e-10)
claim("no_constant_part", k.abs().max(), below=1e-10)

ltv = pp.LTV(A_t, B_t, torch.eye(4).expand(128, 4, 4), torch.zeros(128, 4, 2))
K_ltv, _ = pp.LQR(ltv, Q, None, T=128).lqr_backward(torch.zeros(4))
claim("same_as_ltv", (K_ltv - K).abs().max(), below=1e-10)

# %%
beside = x_ref[0] + torch.tensor([0.35, 0.25, 0, 0])
runs = {
    "(a) ideal, started beside": drive(pp.DubinsCar(dt), feedback(K), beside)[0],
    "(b) with slip and noise": drive(bad_car, feedback(K), x_ref[0], 0.005)[0],
}
fig, panels = plt.subplots(1, 2, figsize=(7, 2.6), sharey=True)
for ax, (title, x) in zip(panels, runs.items()):
    plotting.plot_waypoints(plotting.infinity_axes(ax, title), infinity.waypoints())
    plotting.plot_states(ax, x, label="car")
    ax.label_outer()
fig.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=2)
plt.show()
merged, followed = [(x - x_ref)[:, :2].norm(dim=-1) for x in runs.values()]
claim("merged", merged[25:].max(), below=0.01, unit="m")
claim("followed", followed.max(), below=0.05, unit="m")

# %% [markdown]
# `pp.LQR` got the reference through its linear term: $\tfrac12 (z - r)^\top Q (z - r)$ is
# $\tfrac12 z^\top Q z - (Q r)^\top z$ and a constant, so `p` was `-z_ref @ Q`. Its constant part
# `k` is zero, because the reference is already the best way to follow itself.
#
# How hard should it steer? That is one number, the price of the input against the state. Move it:


# %%
def price(r):
    Q_r = torch.diag(torch.tensor([1, 1, 0.3, 0.3, r, r]))
    K_r, _ = by_hand(A_t, B_t, Q_r[:4, :4], Q_r[4:, 4:])
    x, u = drive(bad_car, feedback(K_r), beside, noise=0.005)
    fig, (left, right) = plt.subplots(1, 2, figsize=(7, 2.8), width_ratios=[1.4, 1])
    plotting.plot_waypoints(plotting.infinity_axes(left), infinity.waypoints())
    plotting.plot_states(left, x, label="car")
    left.legend(loc="upper center", ncols=2)
    left.set_ylim(-1.4, 1.7)
    right.plot(dt * torch.arange(128), u[:, 1], label="turn rate")
    right.plot(dt * torch.arange(128), u_ref[:, 1], "--", label="of the reference")
    right.set(xlabel="time (s)", ylabel="turn rate (rad/s)", ylim=(-3.5, 3.5))
    right.legend(loc="upper right")
    return fig


widgets.panels(price, [0.001, 0.01, 0.1, 1.0, 10.0], "price of the input")

# %% [markdown]
# A low price gives a car that jumps back to the path and answers every bit of noise with the wheel.
# A high price gives a smooth drive that is late and keeps the slip's error. Only the ratio of the
# prices counts: all of them times ten, and nothing changes.

# %% tags=["remove-cell"]
slider = ipywidgets.FloatLogSlider(0.01, min=-4, max=2, step=0.1, description="price")
widgets.live(price, r=slider)

# %% [markdown]
# ## Break it
#
# Two slips of the pen, and a limit. **The sign:** `dlqr` returns $K$ with $u = -Kx$, as is the
# custom, and `LQR` gains with $u = +Kx$, as in the paper's library. Mix them up. **The order:** $Q$
# is for $[x, u]$; write the weights for $[u, x]$. Nothing complains, the shapes fit. **The limit:**
# start further and further from where the car was made linear, by turning it on the spot.
#
# **Predict.** The car starts in the right place, but looks nearly backwards. Will LQR turn it
# around, slowly; stand still; or do something else?

# %%
Q_wrong = Q.roll((2, 2), (0, 1))
K_order, _ = by_hand(A_t, B_t, Q_wrong[:4, :4], Q_wrong[4:, 4:])
angles = torch.arange(5, 161, 5).deg2rad()
heading = angles - math.pi / 2
turned = torch.stack([0 * heading, 0 * heading, heading.cos(), heading.sin()], dim=-1)
x, u = drive(pp.DubinsCar(dt), feedback(K), turned)
dz = torch.cat([x[:, :-1], u], dim=-1) - z_ref
dx = dz[:, 0, :4]
kept = pp.bvmv(dz, Q, dz).sum(-1) / pp.bvmv(dx, V_hand, dx)
fig, (left, right) = plt.subplots(1, 2, figsize=(7, 2.9))
errors = []
for name, gain in [("right", K), ("wrong order", K_order), ("wrong sign", -K)]:
    runs, _ = drive(bad_car, feedback(gain), cars, noise=0.005)
    errors.append((runs - x_ref)[..., :2].norm(dim=-1).mean(0)[1:])
    left.semilogy(dt * torch.arange(1, 129), errors[-1], label=name)
left.set(xlabel="time (s)", ylabel="distance from the reference (m)")
left.legend()
right.semilogy(angles.rad2deg(), kept, ".-")
right.set(xlabel="start turned by (°)", ylabel="real cost / promised cost")
_ = right.axhline(1, color=plotting.GREY, ls="--")

# %%
claim("wrong_sign", errors[2][19], above=1, unit="m")
claim("wrong_order", errors[1].mean() / errors[0].mean(), above=2.5)
claim("promise_small", kept[0], equals=1, within=0.02)
claim("promise_turned", kept[-1], above=10)
claim("wild_speed", u[-1, :, 0].max(), above=3, unit="m/s")

# %% [markdown]
# - **Wrong sign.** After two seconds the car is {claim}`wrong_sign` away. The plot: a rise that is
#   straight on a logarithmic axis is an unstable loop. The fix: look at the eigenvalues of the
#   closed loop, $A + B K$; all have to lie inside the unit circle, and "Verify" claims it.
# - **Wrong order.** Worse, because it works: the error is only {claim}`wrong_order` times as large.
#   The fix: double one weight and see whether the right thing moves.
# - **Too far.** At small angles the cost is what $V$ promised (ratio {claim}`promise_small`); at
#   the last one it is {claim}`promise_turned` times as much.
#
# <details><summary>Answer</summary>
#
# Something else: it asks for a speed of up to {claim}`wild_speed`. In the linear model more speed
# carries the car forward along the reference. This car looks backwards, so more speed carries it
# further away, and LQR asks for still more. The fix is to make the car linear where it *is*, again
# and again. That is [chapter 3](03_mpc.py).
#
# </details>

# %% [markdown]
# ## Verify
#
# Three tests that need no second implementation. The *residual*: $P$ of `dlqr` has to reproduce
# itself under {eq}`eq-2-riccati`. The *gradient*: at a minimum the derivative of $J$ with respect
# to every input is zero, whatever method found it. The *promise*: $\tfrac12 x_0^\top V x_0$ is the
# cost of the rollout.

# %%
residual = Q_side + A.mT @ P @ (A - B @ K_inf) - P
U = u_plan.detach().requires_grad_()
x, J = torch.tensor([0.5, 0.0]), 0
for u in U:
    J = J + x @ Q_side @ x / 2 + u @ R_side @ u / 2
    x = A @ x + B @ u
(gradient,) = torch.autograd.grad(J, U)
promised = line[0] @ V @ line[0] / 2

claim("riccati_residual", residual.abs().max(), below=1e-10)
claim("gradient_zero", gradient.abs().max(), below=1e-10)
claim("promise_is_cost", (promised - J).abs(), below=1e-12)
claim("stable", torch.linalg.eigvals(A - B @ K_inf).abs().max(), below=1)

# %% [markdown]
# The residual sees a wrong $P$, but not whether $P$ belongs to your problem. The gradient sees any
# wrong input, and since $J$ is a bowl, zero means best; but it trusts $A$, $B$ and $J$. The promise
# ties $V$ to the world, and on the real car it becomes the diagnosis that you have just seen.

# %% [markdown]
# ## Differentiate through it
#
# We watch an expert steer to the line and see only where they go, with a sensor noise of 2 mm. What
# price do they put on steering? `pp.LQR` is differentiable: from the price to the gains to the
# path. So guess a price, drive, compare, go downhill. The logarithm keeps it positive.
# <!-- given: 2 mm -->

# %%
start, true_price = torch.tensor([0.5, 0.0]), 0.05


def path(price):
    Q_price = torch.diag(torch.cat([torch.tensor([1, 0.1]), price.reshape(1)]))
    return pp.LQR(system, Q_price, None, 50)(start)[0]


noise = 0.002 * torch.randn(51, 2, generator=torch.Generator().manual_seed(0))
expert = path(torch.tensor(true_price)) + noise
log_price, guesses = torch.zeros((), requires_grad=True), []
for _ in range(20):
    guesses.append(log_price.exp().item())
    loss = (path(log_price.exp()) - expert).square().sum()
    (gradient,) = torch.autograd.grad(loss, log_price)
    log_price = (log_price - gradient).detach().requires_grad_()
claim("price_learned", log_price.exp(), equals=true_price, within=0.003)

# %%
fig, (left, right) = plt.subplots(1, 2, figsize=(7, 2.8))
time = dt * torch.arange(51)
left.plot(time, expert[:, 0], "o", ms=3, color=plotting.GREY, label="expert, as seen")
first, learned = path(torch.ones(())), path(log_price.exp().detach())
left.plot(time, first[:, 0], "--", color=plotting.RED, label="first guess")
left.plot(time, learned[:, 0], color=plotting.BLUE, label="learned")
left.set(xlabel="time (s)", ylabel="offset (m)")
left.legend()
right.semilogy(guesses, ".-", label="learned price")
right.axhline(true_price, color=plotting.GREEN, ls="--", label="true price")
right.set(xlabel="iteration", ylabel="price of steering")
_ = right.legend()

# %% [markdown]
# The price comes out as {claim}`price_learned`, where 0.05 is true. Only the ratio of prices could
# be learned, and only while the car was on its way: on the line, all prices drive the same.

# %% [markdown]
# ## On the robot
#
# The same rule, with `dlqr`'s gain for half the speed, walks a simulated Go1 to a line half a metre
# to its left. The loop is the one from above: look, multiply, move.

# %%
A_dog, B_dog = sideways(speed=0.5)
K_dog, _ = pp.dlqr(A_dog, B_dog, Q_side, R_side)
with go1.connect("sim") as robot:
    poses = [robot.pose()]
    for _ in range(80):
        ahead, left, heading = poses[-1]
        (turn_rate,) = -K_dog @ torch.tensor([left - 0.5, heading])
        robot.move(0.5, turn_rate)
        robot.wait(dt)
        poses.append(robot.pose())
poses = torch.tensor(poses)
fig, ax = plt.subplots(figsize=(7, 2.6))
ax.axhline(0.5, color=plotting.ORANGE, lw=3, alpha=0.6, label="line")
ax.plot(poses[:, 0], poses[:, 1], ".-", label="dog, by its odometry")
ax.set(xlabel="ahead (m)", ylabel="left (m)")
ax.legend(loc="lower right")
plt.show()
claim("dog_on_the_line", (poses[-1, 1] - 0.5).abs(), below=0.02, unit="m")
claim("dog_overshoot", poses[:, 1].max() - 0.5, below=0.03, unit="m")

# %% [markdown]
# Its legs answer late and LQR was not told, yet it ends {claim}`dog_on_the_line` from the line,
# after an overshoot of {claim}`dog_overshoot`. Feedback forgives a model that is a little wrong.
# Nothing in this book was tried on a real robot.

# %% [markdown]
# ## Summary
#
# - With a linear model and a quadratic cost the best input is $u = K_t x$, by a recursion from the
#   end.
# - It equals one big least-squares problem (to {claim}`equals_least_squares`) and has zero gradient
#   ({claim}`gradient_zero`).
# - More than {claim}`end_matters` steps before the end, the gain is that of an endless drive.
# - Around the infinity, a slipping, noisy car strays {claim}`lqr_both` in a lap with LQR, and
#   {claim}`open_both` in open loop.
# - An expert's price of steering, learned from a path: {claim}`price_learned`.
# - Far from the reference its promise breaks, {claim}`promise_turned` times over.
#
# | | paper | here |
# |:--|:--|:--|
# | LQR | named, no number | equals least squares to {claim}`equals_least_squares` |
# | noise, Fig. 2 (b) | by MPC, no number | by LQR, largest error {claim}`lqr_noise` |
#
# **What differs from PyPose.** In PyPose 0.9.5, `LQR` accepts bounds on the input and ignores them,
# needs a batch dimension and a `p`, and ticks the system's clock while it plans. Ours keeps bounds,
# takes any batch or none, and leaves the system as it was. On linear systems the plans agree.
#
# **Further reading.** Anderson and Moore {cite}`anderson1990`, chapters 2 to 4; Boyd's lectures
# {cite}`boyd_ee363`, the first of which is this chapter; the source of `pypose_lite/riccati.py`.
#
# Next: [chapter 3](03_mpc.py) makes the car linear where it is, and plans anew in every step.
