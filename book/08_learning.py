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
# A planner has prices, a filter has noises, both have a model. Somebody has to set all these
# numbers. This chapter lets the car do it: from a recorded lap, from an expert, and at last from
# nothing but how well it drove. One tool serves for all three, the gradient.
#
# After it you can
#
# - identify a parameter of the car from a recorded run;
# - differentiate a plan exactly, by hand, and say what is lost by a shortcut;
# - learn a planner's prices from what an expert did;
# - tune planner and filter together, through the closed loop;
# - tell when a gradient will not help: in a wrong valley, at a bound, in noise.
#
# You need chapters [3](03_mpc.py) and [4](04_ekf.py), and the chain rule. Take about 90 minutes.
# The paper says that its modules are differentiable {cite}`pypose06` and shows no example; here are
# three. <!-- given: 90 minutes -->

# %%
import inspect
import warnings
from functools import partial

import matplotlib.pyplot as plt
import torch
from IPython.display import display
from torch.autograd.functional import jacobian
from torch.func import grad, hessian, jacfwd, jvp

import pypose_lite as pp
from pypose_lite import filters, go1, infinity
from pypose_lite.control import gradient
from pypose_lite.teaching import claim, plotting, table, widgets

plotting.use_style()
torch.set_default_dtype(torch.float64)
dt, T, W, I = 0.1, 10, infinity.waypoints(), torch.eye(4)
ideal, real = pp.DubinsCar(dt), pp.DubinsCar(dt, slip=0.2)  # what we believe; what is

# %% tags=["hide-input"]
q, r = infinity.PROCESS_NOISE, infinity.OBSERVATION_NOISE
few = pp.utils.ReduceToBason(steps=2)  # sweeps a plan


def lap(planner, estimator):
    """A lap of 16 slipping cars, by what planner and filter believe of the car."""
    mpc = pp.MPC(planner, infinity.controller().Q, None, T, few)
    generator = torch.Generator().manual_seed(0)
    world = infinity.SimulatedCar(real, W[0].expand(16, 4), q, r, generator)
    return infinity.drive(mpc, world, pp.EKF(estimator), steps=60)


def rollout(slip, u):
    """Where a car that slips gets from the start, (..., N+1, 4)."""
    states = [W[0].expand(*u.shape[:-2], 4)]
    for u_t in u.unbind(-2):
        states.append(pp.DubinsCar(dt, slip).transition(states[-1], u_t))
    return torch.stack(states, dim=-2)


# %% tags=["hide-input"]
def learn_slip(y, u, slip, iterations=6):
    """The slip of each car (...), from its observations and its inputs alone."""
    for _ in range(iterations):
        x, dx = jvp(partial(rollout, u=u[..., :-1, :]), (slip,), (0 * slip + 1,))
        slip = slip - ((x - y) * dx).sum((-2, -1)) / dx.square().sum((-2, -1))
    return slip


blind, zero = lap(ideal, ideal), torch.zeros(())
learned = pp.DubinsCar(dt, learn_slip(blind.y[0], blind.u[0], zero))
laps = {("ideal", "ideal"): blind, ("learned", "learned"): lap(learned, learned)}
fig, panels = plt.subplots(1, 2, figsize=(7, 2.9), sharey=True)
for ax, run, title in zip(panels, laps.values(), ["before", "after one lap"]):
    plotting.plot_waypoints(plotting.infinity_axes(ax, title, margin=0.8), W)
    ax.plot(*run.x[1:].permute(2, 1, 0)[:2], color=plotting.GREY, lw=0.4)
    plotting.plot_states(ax, run.x[0], label="car")
    ax.label_outer()
fig.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=2)
plt.show()
claim("slip_from_one", learned.slip, equals=0.2, within=0.04)

# %% [markdown]
# The wheels of this car lose a fifth of every turn. On the left, planner and filter think that they
# lose nothing. On the right is the next lap, after the car has looked once at the first one.

# %% [markdown]
# ## See it fail
#
# Feedback forgives: in [chapter 2](02_lqr.py) a car that slipped a little stayed beside its path.
# This one slips more, it has noise, and it does not get around. The model is wrong in two places,
# the planner's and the filter's.
#
# **Predict.** We may tell the slip to one of them only. Which: the planner, which decides; the
# filter, which only watches; or does one alone not help?

# %% mystnb={"markdown_format": "myst"}
laps["learned", "ideal"] = lap(learned, ideal)
laps["ideal", "learned"] = lap(ideal, learned)
stray, nees, done, rows = {}, {}, {}, []
for who, run in laps.items():
    on, truth = run.running, run.x[:, :-1]
    stray[who] = infinity.tracking_error(truth)[on].mean()
    nees[who] = filters.nees(run.estimate, run.P, truth)[on].mean()
    done[who] = run.finished.sum()
    told = " | ".join(who)
    rows.append(f"{told} | {stray[who]:.3f} | {nees[who]:.1f} | {done[who]} of 16")
display(table("planner | filter | straying (m) | NEES | finished", rows))
claim("blind_finished", done["ideal", "ideal"], equals=0)
claim("learned_finished", done["learned", "learned"], above=13)
claim("blind_stray", stray["ideal", "ideal"], above=0.18, unit="m")
claim("planner_told", stray["learned", "ideal"], above=0.2, unit="m")
claim("filter_told", stray["ideal", "learned"], below=0.12, unit="m")
claim("learned_stray", stray["learned", "learned"], below=0.055, unit="m")
claim("blind_nees", nees["ideal", "ideal"], above=30)
claim("learned_nees", nees["learned", "learned"], below=9)

# %% [markdown]
# <details><summary>Answer</summary>
#
# The filter. With the planner alone the cars stray {claim}`planner_told`, no better than the
# {claim}`blind_stray` of before; with the filter alone {claim}`filter_told`. The planner looks at
# the car anew in every step, and its errors do not add up. The filter's do: each prediction turns
# too far, and NEES, {claim}`blind_nees`, says so loudly. A better planner then only follows a wrong
# estimate more faithfully.
#
# </details>
#
# Both told: {claim}`learned_stray`, and {claim}`learned_finished` of 16 finish.

# %% [markdown]
# ## From scratch
#
# To learn from decisions we need the derivative of a *decision*. The simplest case is one plan,
# from the first waypoint to the second: how would its inputs move if the car slipped a little more?
# Here is the cost of a plan once more, as a sum of squares. `deviations` are all the numbers in
# which a plan differs from standing at the target without effort.

# %%
prices = torch.tensor([1, 1, 0.3, 0.3, 0.01, 0.01])  # of [x, u], the book's


def deviations(u, slip, x, target):
    """[x - target, u] of every step, (T, 6)."""
    rows = []
    for u_t, target_t in zip(u, target.expand(len(u), 4)):
        rows.append(torch.cat([x - target_t, u_t]))
        x = pp.DubinsCar(dt, slip).transition(x, u_t)
    return torch.stack(rows)


def cost(u, slip):
    return (prices * deviations(u.reshape(T, 2), slip, W[0], W[1]).square()).sum() / 2


u, slip = pp.MPC(real, prices.diag(), None, T)(dt, W[0], W[1])[1], torch.tensor(0.2)
J_uu, J_us = (d(u.flatten(), slip) for d in (hessian(cost), jacfwd(grad(cost), 1)))
by_hand = -torch.linalg.solve(J_uu, J_us).reshape(T, 2)
claim("plan_is_flat", grad(cost)(u.flatten(), slip).abs().max(), below=1e-6)

# %% [markdown]
# That is all. At a plan $u$ of least cost $J$ the slope is zero, $J_u(u, \theta) = 0$. When the
# parameter $\theta$ moves a little, $u$ moves along, so that the slope stays zero:
#
# $$ J_{uu}\, du + J_{u\theta}\, d\theta = 0 \quad\Rightarrow\quad
#    \frac{du}{d\theta} = -J_{uu}^{-1} J_{u\theta} $$ (eq-8-implicit)
#
# $J_{uu}$ is the curvature of the cost in all inputs, $J_{u\theta}$ says how its slope reacts to
# the parameter. How the plan was found does not matter. That it *is* the best does.
#
# Now a shortcut. With $d$ for the deviations, $D = \partial d / \partial u$, and the prices on the
# diagonal of $S$, the cost is $\tfrac12 d^\top S d$, its slope $D^\top S d$, and its curvature
#
# $$ J_{uu} = D^\top S D + \sum_k S_{kk}\, d_k\, \frac{\partial^2 d_k}{\partial u^2} $$ (eq-8-curve)
#
# The sweeps of chapter 3 may drop the second part: Gauss and Newton's model. To *find* a plan that
# is fine, and the last sweep changes nothing any more. So it is tempting to differentiate just that
# sweep, with $D$ held still, and to forget all others.
#
# **Predict.** The plan has converged to all digits. How far off is the gradient of one more sweep:
# not at all, a little, or a lot?


# %%
def one_more_sweep(u, slip, prices, x, target):
    """A batch of plans (B, T, 2) once more, with the gradient of a last sweep."""

    def flat(u, slip, x, target):
        return deviations(u, slip, x, target).flatten()

    each = partial(torch.vmap, in_dims=(0, None, 0, 0))
    D = each(jacfwd(flat))(u.detach(), slip.detach(), x.detach(), target).flatten(-2)
    S = prices.repeat(u.shape[1])
    slope = pp.bmv(D.mT, S * each(flat)(u.detach(), slip, x, target))
    step = torch.linalg.solve(D.mT * S.detach() @ D, slope.detach() - slope)
    return u.detach() + step.unflatten(-1, (-1, 2))


# %%
def plan_with(slip, stepper=None):
    mpc = pp.MPC(pp.DubinsCar(dt, slip), prices.diag(), None, T, stepper)
    return mpc(dt, W[0], W[1])[1]


h, at = 1e-5, W[:2].unsqueeze(1)
central = (plan_with(slip + h) - plan_with(slip - h)) / (2 * h)
sweep = jacfwd(lambda s: one_more_sweep(u[None], s, prices, *at)[0])(slip)
fig, ax = plt.subplots(figsize=(7, 2.8))
ax.plot(dt * torch.arange(T), by_hand[:, 1], label="exact")
ax.plot(dt * torch.arange(T), sweep[:, 1], "--", label="one more sweep")
ax.plot(dt * torch.arange(T), central[:, 1], "ko", mfc="none", label="differences")
ax.set(xlabel="time (s)", ylabel="d turn rate / d slip (rad/s)")
ax.legend()
plt.show()
pypose = 3.9456887237  # PyPose 0.9.5, tests/bench/bench_gradients.py
off = (by_hand - central).abs().max() / central.abs().max()
claim("by_hand_error", off, below=1e-6)
claim("sweep_error", 100 * (sweep / central - 1)[0, 1], above=15, below=30, unit="%")
claim("pypose_agrees", (sweep[0, 1] - pypose).abs(), below=1e-8)

# %% [markdown]
# <details><summary>Answer</summary>
#
# A lot: for the first turn rate {claim}`sweep_error`. The exact one agrees with differences of
# whole plans to {claim}`by_hand_error`.
#
# </details>
#
# This is not a straw man. It is what PyPose 0.9.5 does: we ran it on this plan, in November 2026,
# and its number is in the last cell. It is that of `one_more_sweep`, to {claim}`pypose_agrees`.
# The cost of a plan hides the fault: at a minimum its derivative does not depend on $du$ at all.

# %% [markdown]
# ## The library's version
#
# A dense $J_{uu}$ has $(2T)^2$ entries and is the same for every parameter. A gradient needs one
# product with its inverse, and an inverse times a vector is the minimum of a parabola: an LQR
# around the plan. So the library makes one Riccati run more, with the full curvature. It is printed
# below. And since all that follows learns in the same way, here is that way, once: `descend` gives
# a loss and its gradient to an optimiser, L-BFGS, and keeps a diary.


# %%
def descend(loss, start, iterations=20):
    """What is learned, and the losses and the numbers of every evaluation."""
    z, losses, path = start.clone().requires_grad_(), [], []

    def evaluate():
        value = loss(z)
        (z.grad,) = torch.autograd.grad(value, z)
        losses.append(value.detach())
        path.append(z.detach().clone())
        return losses[-1]

    wolfe = {"line_search_fn": "strong_wolfe"}
    torch.optim.LBFGS([z], max_iter=iterations, **wolfe).step(evaluate)
    return z.detach(), torch.stack(losses), torch.stack(path)


print(inspect.getsource(gradient.newton_step).split('"""')[2])
s = slip.clone().requires_grad_()
rows = [torch.autograd.grad(z, s, retain_graph=True)[0] for z in plan_with(s).ravel()]
claim("same_gradient", (torch.stack(rows) - by_hand.ravel()).abs().max(), below=1e-8)

# %% [markdown]
# `model` makes the car linear along the plan; its `Q` is the full curvature, with the second part
# of {eq}`eq-8-curve`. `v` is what the inverse is to be multiplied by.
#
# In one point the library differs from our formula: it drives the plan with feedback,
#
# $$ u = U + w + K\, (x - X) $$ (eq-8-feedback)
#
# where $U$ and $X$ are the plan and $K$ the gains of its last sweep, and asks how $w$ moves, not
# $u$. For small changes $w = du - K\, dx$: so a slope in $w$ is one in $x$, too (`slope`), and the
# walk at the end takes $K\, dx$ off again. On paper nothing is different, for $w$ tells $u$. In the
# computer it is: on a system that falls over, a change of an early input without feedback grows
# from step to step, until a long plan's derivatives are nothing but rounding.
#
# An input that stands at its bound is `clamped`: it does not move, and does not react. Of the
# sweeps that found the plan only these gains are kept, and they are numbers, so a gradient costs
# the same after 3 sweeps and after 200.

# %% [markdown]
# ## On the infinity
#
# ### The car: a slip from a recorded run
#
# Back to the first figure. What is recorded of a lap: the inputs and the noisy observations. Guess
# a slip, drive the inputs again in the computer, compare with what was observed. `learn_slip` also
# computes, for each state, how it would move with the slip (`jvp`), and takes the change of slip
# that would explain most of the difference; six times over.
#
# **Predict.** There is a simpler way, which needs no long simulation: from each observation predict
# *one* step, and compare. Both use all the data. Which is more precise, and by how much?


# %%
def misfit(slip, run, length):
    """Mean squares (S, cars) over pieces of a run, each from its own start."""
    u, y = run.u, run.y
    starts = torch.arange(0, y.shape[1] - length, length)
    x, total = y[:, starts], 0
    x[:, 0] = W[0]  # the start is known
    for k in range(length):
        x = pp.DubinsCar(dt, slip[:, None, None]).transition(x, u[:, starts + k])
        total = total + (x - y[:, starts + k + 1]).square().sum(-1).mean(-1)
    return total / length


guesses = torch.linspace(-1.2, 1.2, 49)
one_step = guesses[misfit(guesses, blind, 1).argmin(0)]
whole_run = learn_slip(blind.y, blind.u, torch.zeros(16))
claim("slip_one_step", one_step.std(), above=0.07)
claim("slip_whole_run", whole_run.std(), below=0.025)
claim("slip_mean", whole_run.mean(), equals=0.2, within=0.02)

# %% [markdown]
# <details><summary>Answer</summary>
#
# The whole run, by far: over the 16 cars the slips scatter by {claim}`slip_whole_run`, against
# {claim}`slip_one_step`. In one step a slip turns the car by less than two degrees, and the sensor
# is much worse than that. Over a circle the same slip adds up to nearly a right
# angle, and carries the car far away. <!-- given: two degrees -->
#
# </details>
#
# The mean over the cars is {claim}`slip_mean`, where 0.2 is true. Noise on the motion adds up in a
# long simulation, too; were it larger, the best length would lie between, and a filter, which
# forgets as much as it has to, would do best. <!-- given: 0.2 -->
#
# ### The driver: prices from an expert
#
# An expert drives the infinity with prices of their own: they turn the wheel less, and care more
# for their heading. We see where they were and what they did, the inputs with some noise. Nobody
# has to drive: each step of their lap is one planning problem, and all are solved in one batch.
#
# **Predict.** Three prices are unknown: of heading, of speed and of turning. We start each of them
# two to five times too low. After a few iterations the loss has nearly stopped falling. Are the
# prices then right, all three?


# %%
def weigh(logs):
    return torch.cat([torch.ones(2), logs.exp()[[0, 0, 1, 2]]])


def unlike(logs, sweep=False):
    u = pp.MPC(ideal, weigh(logs).diag(), None, T)(dt, seen, aims)[1]
    u = one_more_sweep(u, 0 * slip, weigh(logs), seen, aims[:, None]) if sweep else u
    return (u[:, 0] - did).square().mean()


true_prices, first = torch.tensor([[0.6, 0.02, 0.05], [0.3, 0.01, 0.01]])
expert = infinity.drive(pp.MPC(ideal, weigh(true_prices.log()).diag(), None, T))
seen, aims, g = expert.x[:-1], W[expert.goal], torch.Generator().manual_seed(0)
did = expert.u + 0.05 * torch.randn(expert.u.shape, generator=g)
logs, losses, path = descend(unlike, first.log(), 11)
claim("loss_early", 100 * losses[3] / losses[0], below=6, unit="%")
claim("heading_early", path[3, 0].exp(), below=0.35)
claim("heading_learned", path[-1, 0].exp(), equals=0.6, within=0.15)
claim("speed_learned", path[-1, 1].exp(), equals=0.02, within=0.002)
claim("turn_learned", path[-1, 2].exp(), equals=0.05, within=0.01)

# %% tags=["hide-input"]
both = torch.stack([weigh(z).diag().expand(T, 6, 6) for z in path[[0, -1]]])
pair = infinity.SimulatedCar(ideal, W[:1].expand(2, 4))
twins = infinity.drive(pp.MPC(ideal, both, None, T, few), pair)
before, after = (u[:n, 0] for u, n in zip(twins.u, twins.steps))
fig, (left, right) = plt.subplots(1, 2, figsize=(7, 2.9))
for k, name in enumerate(["heading", "speed", "turning"]):
    left.semilogy(path[:, k].exp() / true_prices[k], "osv"[k] + "-", ms=4, label=name)
left.semilogy(losses / losses[0], "k--", label="loss / first loss")
left.set(xlabel="evaluation", ylabel="price / true price")
left.legend(fontsize=8)
right.plot(expert.u[:, 0], color=plotting.ORANGE, lw=4, alpha=0.6, label="expert")
right.plot(before, "k:", label="before")
right.plot(after, label="learned")
right.set(xlabel="step of a lap", ylabel="speed (m/s)", xlim=(0, 30), ylim=(0, 7))
right.legend(fontsize=8)
plt.show()
claim("steps_before", len(before), below=55)
claim("steps_learned", len(after) - len(expert.u), equals=0, within=8)

# %% [markdown]
# <details><summary>Answer</summary>
#
# Only that of speed. After three iterations the loss has fallen to {claim}`loss_early` of the first
# one, and the price of heading has gone the *wrong* way, to {claim}`heading_early`. Heading and
# turning trade against each other: a driver who cares less and pays less does nearly the same. The
# loss has a long valley with a flat floor, and most of the work is to walk along it.
#
# </details>
#
# At the end the prices are {claim}`heading_learned`, {claim}`speed_learned` and
# {claim}`turn_learned`, where 0.6, 0.02 and 0.05 are true. The novice, with low prices, races
# around in {claim}`steps_before` steps. Expert and pupil take their time, and the lengths of their
# laps differ by {claim}`steps_learned` only. *Small loss* is not *right parameters*, but it is
# enough to drive alike.
# <!-- given: 0.6, 0.02, 0.05 -->

# %% [markdown]
# ## Break it
#
# **The wrong valley.** The loss of the first part, for all slips, and pieces of several lengths
# (the second lap, 16 cars). Move the slider and count the valleys.


# %%
second = laps["learned", "learned"]


def valleys(length):
    loss = misfit(guesses, second, length)
    fig, ax = plt.subplots(figsize=(7, 2.8))
    ax.semilogy(guesses, loss, color=plotting.GREY, lw=0.5)
    ax.semilogy(guesses, loss[:, 0], label="one car")
    ax.axvline(0.2, color=plotting.GREEN, ls="--", label="true slip")
    ax.set(xlabel="slip, guessed", ylabel="mean square", ylim=(0.05, 20))
    ax.legend(loc="lower left")
    return fig


whole = second.y.shape[1] - 1
display(widgets.panels(valleys, [1, 6, 12, 24, whole], "steps in a piece"))
ends = [learn_slip(second.y, second.u, torch.full((16,), s)) for s in (0.0, -0.3)]
claim("from_zero", (ends[0] - 0.2).abs().max(), below=0.05)
claim("from_below", ends[1].mean(), below=-0.5)
claim("from_below_all", (ends[1] < -0.5).sum(), equals=16)

# %% [markdown]
# Started from 0 the slip comes out right for all cars, from $-0.3$ for none: all 16 end near
# {claim}`from_below`, a car that turns too much. Driven in open loop for a lap, a car that
# turns far too much looks better than one that turns a little too much. Short pieces have one
# valley, but it is shallow, and noise moves it. The symptom: start elsewhere, end elsewhere. The
# fix: begin with short pieces, and lengthen them.
#
# **At a bound.** Give the planner limits of 2 m/s and 1.5 rad/s, and vary its price of turning.
# **Half a plan.** Stop its sweeps early. <!-- given: 2 m, 1.5 rad -->

# %%
fig, ax = plt.subplots(figsize=(7, 2.6))
steep = torch.logspace(-3, 1, 41).requires_grad_()
S = torch.stack([*prices[:5, None].expand(5, 41), steep], dim=-1).diag_embed()
hurried, slopes = pp.MPC(ideal, S[:, None].expand(41, T, 6, 6), None, T), {}
box = {"u_lower": torch.tensor([0.0, -1.5]), "u_upper": torch.tensor([2.0, 1.5])}
for name, limits, style in [("free", {}, "--"), ("bounded", box, "-")]:
    turn = hurried(dt, *W[:2, None].expand(2, 41, 4), **limits)[1][:, 0, 1]
    (slopes[name],) = torch.autograd.grad(turn.sum(), steep)
    ax.semilogx(steep.detach(), turn.detach(), style, label=name)
ax.set(xlabel="price of turning", ylabel="first turn rate (rad/s)")
ax.legend()
plt.show()
claim("no_slope_free", (slopes["free"] == 0).sum(), equals=0)
claim("no_slope_bounded", (slopes["bounded"] == 0).sum(), above=15)
with warnings.catch_warnings(record=True, action="always") as heard:
    half = plan_with(s, pp.utils.ReduceToBason(steps=1))
print(*[w.message for w in heard])
(hasty,) = torch.autograd.grad(half[0, 1], s)
claim("half_a_plan", hasty / by_hand[0, 1], below=0.8)
claim("warned", len(heard), equals=1)

# %% [markdown]
# - **At a bound** the slope is not small but exactly zero, for {claim}`no_slope_bounded` of the 41
#   prices. An expert who turns at 1 rad/s has a price near 0.25; a pupil who starts at the book's
#   0.01 turns as hard as allowed, the loss is large, and nothing tells them to turn less. The
#   symptom: a gradient of exactly 0. The fix: start where inputs are free, or use more of the lap
#   than the steps at the bound. <!-- given: 1 rad, 0.25, 0.01 -->
# - **Half a plan.** After one sweep the slope is not zero, {eq}`eq-8-implicit` does not hold, and
#   the gradient is {claim}`half_a_plan` times what it should be. The library warns. The fix: more
#   sweeps, where you want to learn.
#
# The third enemy, noise, comes with the loop.

# %% [markdown]
# ## Verify
#
# Finite differences, for both parts, and for the shortcut on the same loss.


# %%
def central_differences(loss, at, h=1e-5):
    steps = h * torch.eye(at.numel())
    return torch.stack([(loss(at + d) - loss(at - d)) / (2 * h) for d in steps])


misfit_of = partial(misfit, run=blind, length=59)
d, exact = (way(misfit_of, slip[None]) for way in (central_differences, jacobian))
claim("slip_gradient", (exact[..., 0] - d[0]).norm() / d.norm(), below=1e-6)
at = path[0].clone().requires_grad_()
d = central_differences(unlike, path[0])
exact, swept = [torch.autograd.grad(unlike(at, z), at)[0] for z in (False, True)]
claim("price_gradient", (exact - d).norm() / d.norm(), below=1e-6)
claim("price_by_sweep", 100 * (swept - d).norm() / d.norm(), above=0.5, unit="%")

# %% [markdown]
# The slip's gradient agrees to {claim}`slip_gradient`, the prices' to {claim}`price_gradient`. One
# more sweep is {claim}`price_by_sweep` off, and would still learn: where the residuals vanish, so
# does any gradient built on them. Do not count on that when the best loss is not zero.
#
# Differences see a wrong derivative. They do not see a wrong loss, a second valley, or a parameter
# that the data say nothing about; for that, learn from data made with parameters you know, as all
# of this chapter does.

# %% [markdown]
# ## Differentiate through it
#
# Now everything at once. Planner and filter drive the slipping car, and all that we score is how
# far it is, truly, from where it should be. Four numbers are to be learned: the slip that both
# believe in, the sensor's noise that the filter believes in, and the prices of speed and turning.
# The gradient runs from the score back through the car, the plan, the estimate, the step before,
# and so on to the start.
#
# A waypoint that is reached or not makes a jump, and jumps have no gradient. So the target moves
# along the path at 1.3 m/s. 32 cars start all around the infinity and drive 12 steps each.
# <!-- given: 1.3 m -->


# %%
def drive(theta, seed=0, sweep=False, N=12, H=5):
    """States (32, N+1, 4) by [slip, log noise, log prices]; their mean squares."""
    metres = infinity.LENGTH * torch.arange(32)[:, None] / 32
    targets = infinity.reference(metres + 1.3 * dt * torch.arange(N + H))
    slip, sensor, known = theta[..., 0], theta[..., 1].exp(), theta[..., :1] * 0
    S = torch.cat([prices[:4] + known, theta[..., 2:].exp()], dim=-1)
    Q, car = torch.stack([S.diag_embed()] * H, dim=-3), pp.DubinsCar(dt, slip)
    mpc, ekf = pp.MPC(car, Q, None, H), pp.EKF(car)
    R, g = sensor[..., None, None] ** 2 * I, torch.Generator().manual_seed(seed)
    x, warm, P = [targets[:, 0]], None, 0.05**2 * I
    X = x[0] + 0.05 * torch.randn(32, 4, generator=g)
    for i in range(N):
        v, w = torch.randn(2, 32, 4, generator=g)
        u = mpc(dt, X, aim := targets[:, i : i + H], warm)[1]
        warm, u = pp.shift(u), one_more_sweep(u, slip, S, X, aim) if sweep else u
        X, P = ekf(X, x[i] + r * v, u[:, 0], P, q**2 * I, R)
        x.append(real.transition(x[i], u[:, 0]) + q * w)
    x = torch.stack(x, dim=1)
    return x, (x - targets[:, : N + 1])[..., :2].square().sum(-1).mean(-1)


# %% [markdown]
# We start badly: no slip, a sensor believed to be five times better than it is, and prices ten
# times the book's. The noise is the same in each evaluation; you will see why.
#
# **Predict.** Nobody tells the car its slip or its sensor's noise, only how well it drove. Compare
# it, with fresh noise, with a car that is told all true numbers, and has the book's prices. Will
# it be much worse, about equal, or much better?

# %%
truth, start = torch.tensor([[0.2, r, 0.01, 0.01], [0, 0.03, 0.1, 0.1]])
truth, start = (torch.cat([z[:1], z[1:].log()]) for z in (truth, start))
best, losses, zs = descend(lambda z: drive(z)[1].mean(), start, 9)


def lesson(k):
    fig, (left, right) = plt.subplots(1, 2, figsize=(7, 2.7), width_ratios=[1.6, 1])
    plotting.infinity_axes(left, f"slip {zs[k, 0]:.2f}, noise {zs[k, 1].exp():.2f} m")
    plotting.plot_reference(left, infinity.reference(torch.linspace(0, 12.56, 99)))
    left.plot(*drive(zs[k])[0].permute(2, 1, 0)[:2], color=plotting.BLUE, lw=0.7)
    right.semilogy(losses.sqrt(), ".-k", k, losses[k].sqrt(), "o")
    right.set(xlabel="evaluation", ylabel="root mean square (m)", xticks=[0, 5, 10])
    return fig


told, taught = (drive(z, seed=1)[1].mean().sqrt() for z in (truth, best))
display(widgets.panels(lesson, [0, 2, 3, 6, len(losses) - 1], "evaluation"))
claim("loop_before", losses[0].sqrt(), above=0.25, unit="m")
claim("loop_taught", taught, below=0.08, unit="m")
claim("loop_ratio", taught / told, below=1.15)

# %% [markdown]
# <details><summary>Answer</summary>
#
# About equal: it began with {claim}`loop_before` and ends with {claim}`loop_taught`, which is
# {claim}`loop_ratio` times the error with all true numbers. And although nobody asked for the
# truth, the slip comes out near it, {claim}`loop_slip` (0.2), and so, roughly, does the noise,
# {claim}`loop_sensor` (0.163). To drive well, a filter has to be honest. <!-- given: 0.2, 0.163 -->
#
# </details>
#
# Is this gradient right, through twelve plans and twelve filter steps? And what would the
# shortcut say? Then the noise: each of the 32 cars has a gradient of its own. We get them in one
# call, by giving each car its own copy of the numbers.


# %%
def mean_square(theta, **options):
    return drive(theta, **options)[1].mean()


leaf = start.clone().requires_grad_()
exact = torch.autograd.grad(mean_square(leaf), leaf)[0]
swept = torch.autograd.grad(mean_square(leaf, sweep=True), leaf)[0]
way = torch.tensor([1.0, 0.5, -0.5, 0.3])  # any way through the four numbers
d = (mean_square(start + 1e-5 * way) - mean_square(start - 1e-5 * way)) / 2e-5
misled = descend(partial(mean_square, sweep=True), start, 4)[1].sqrt()
claim("loop_slip", best[0], equals=0.2, within=0.05)
claim("loop_sensor", best[1].exp(), above=0.08, below=0.3, unit="m")
claim("loop_gradient", (exact @ way / d - 1).abs(), below=1e-5)
claim("loop_by_sweep", (swept - exact).norm() / exact.norm(), above=0.3)
claim("loop_slope", exact[0], above=0)
claim("loop_slope_by_sweep", swept[0], below=0)
claim("loop_misled", misled[-1], above=0.15, unit="m")
claim("loop_not_misled", losses[len(misled) - 1].sqrt(), below=0.13, unit="m")

# %%
fig, panels = plt.subplots(1, 2, figsize=(7, 2.5))
own = []
for ax, z, title in zip(panels, (start, best), ("at the start", "at the end")):
    leaf = z.expand(32, 4).clone().requires_grad_()
    own.append(torch.autograd.grad(drive(leaf)[1].sum(), leaf)[0][:, 0])
    ax.hist(own[-1], bins=12, color=plotting.SKY)
    ax.axvline(own[-1].mean(), label="mean of 32 cars")
    ax.axvline(0, color="black", lw=1)
    ax.set(title=title, xlabel="slope by the slip (m²)", ylabel="cars")
    ax.locator_params(axis="x", nbins=5)
panels[0].legend()
plt.show()
h = 1e-3 * torch.eye(4)[0]
fresh = (mean_square(best + h, seed=1) - mean_square(best - h, seed=2)) / 2e-3
claim("agree_start", (own[0] > 0).sum(), above=26)
claim("agree_end", (own[1] > 0).sum(), above=7, below=25)
claim("fresh_noise", fresh.abs() / own[1].mean().abs(), above=20)

# %% [markdown]
# The gradient of the whole loop is that of differences, to {claim}`loop_gradient`. The shortcut is
# off by {claim}`loop_by_sweep` of its length, and for the slip it has the wrong *sign*:
# {claim}`loop_slope_by_sweep` against {claim}`loop_slope`. The errors of twelve plans do not
# cancel. The same optimiser, fed with it, is still at {claim}`loop_misled` after four iterations,
# when the exact gradient has brought it to {claim}`loop_not_misled`: its line search looks for a
# descent that is not there.
#
# At the start {claim}`agree_start` of 32 cars agree on where to go. (Away from the truth, by the
# way: while the prices are bad, a wrong slip helps.) At the end {claim}`agree_end` say up and the
# others down; only the mean is near zero. From there on one learns the noise of these 32 drives,
# not the car. More cars help, more iterations do not. And with fresh noise in each evaluation,
# differences are {claim}`fresh_noise` times what they should be, and a line search cannot tell
# better from luckier. So: hold the noise fixed while you learn, and test with another.

# %% [markdown]
# ## On the robot
#
# The same first step with a simulated Go1: it walks a lap by chapter 3's planner, and we ask its
# record for what the planner did not know. Its legs do not slip, they are late: the velocities
# follow the command with a time constant, the *lag*. In a step they change by
# $1 - e^{-\Delta t / \text{lag}}$ of what is missing.


# %%
def late(lag, x, u):
    """The states of a robot whose velocities are late by lag (s), (N+1, 4)."""
    (i, j, c, s), v, k = x, torch.zeros(2), (-dt / lag).exp()
    heading, states = torch.atan2(s, c), [x]
    for w in u:
        mean, v = w + (v - w) * (1 - k) * lag / dt, w + (v - w) * k
        middle, heading = heading + dt * mean[1] / 2, heading + dt * mean[1]
        i, j = i + dt * mean[0] * middle.cos(), j + dt * mean[0] * middle.sin()
        states.append(torch.stack([i, j, heading.cos(), heading.sin()]))
    return torch.stack(states)


walks = pp.MPC(ideal, prices.diag(), None, T, few)
box = {"u_lower": torch.tensor([0.0, -1.5]), "u_upper": torch.tensor([1.2, 1.5])}
with go1.connect("sim", start=(0.0, 0.0, -torch.pi / 2)) as robot:
    walk = infinity.drive(walks, infinity.RealRobot(robot), tolerance=0.15, **box)


# %%
def stray_dog(log_lag):
    return (late(log_lag.exp(), walk.x[0], walk.u) - walk.x).square().mean()


lag = descend(stray_dog, torch.tensor(0.03).log())[0].exp()
fig, ax = plt.subplots(figsize=(7, 2.5))
for z, name, style in [(lag, "lag learned", "-"), (lag / 1e3, "no lag", "--")]:
    error = (late(z, walk.x[0], walk.u) - walk.x)[:, :2].norm(dim=-1)
    ax.plot(dt * torch.arange(len(error)), error, style, label=name)
ax.set(xlabel="time (s)", ylabel="distance from the record (m)")
ax.legend()
plt.show()
claim("dog_lag", lag, equals=0.15, within=0.02, unit="s")
claim("dog_without", error.max(), above=0.1, unit="m")

# %% [markdown]
# {claim}`dog_lag`, from one walk. The simulator was built with 0.15 s. Without a lag the copy
# strays by up to {claim}`dog_without`. What remains in the figure is the odometry: it counts a
# little too much for a metre, and its heading drifts. Chapter 9 comes back to the lag. Nothing in
# this book was tried on a real robot. <!-- given: 0.15 s -->

# %% [markdown]
# ## Summary
#
# - A decision has a derivative: the curvature of its cost, inverted, times the change of its slope.
#   By hand and in the library it equals differences to {claim}`by_hand_error`.
# - From one lap, a slip of {claim}`slip_mean` (0.2), and {claim}`learned_finished` of 16 cars
#   finish where {claim}`blind_finished` did. The filter needed it more than the planner.
# - From an expert's decisions, their prices: turning {claim}`turn_learned` (0.05).
# - From tracking alone, through planner and filter: {claim}`loop_taught` instead of
#   {claim}`loop_before`, and the sensor's noise, {claim}`loop_sensor` (0.163).
# - A gradient is local: from $-0.3$, the slip of {claim}`from_below_all` cars ends in the wrong
#   valley; at a bound, {claim}`no_slope_bounded` of 41 slopes are exactly zero; in noise, the cars
#   disagree.
#
# <!-- given: 0.2, 0.05, 0.163 -->
#
# | | paper | here |
# |:--|:--|:--|
# | gradient through the planner | "differentiable", no number | exact to {claim}`price_gradient` |
# | gradient through the loop | named, no number | exact to {claim}`loop_gradient` |
#
# **What differs from PyPose.** In PyPose 0.9.5 the gradient of a plan is that of one more
# Gauss-Newton sweep, {claim}`sweep_error` off in our first example; `A` and `B` of a nonlinear
# system carry no gradient, which the EKF feels, too; and a nonlinear planner takes no batch. There
# this chapter's loops would run one car at a time.
#
# **Further reading.** Amos and others {cite}`amos2018` on differentiable MPC; Ljung
# {cite}`ljung1999` on identification, chapters 7 and 10; Blondel and others {cite}`blondel2022` on
# implicit differentiation at large; the source of `pypose_lite/control/gradient.py`.
#
# Next: chapter 9 takes it to the robot.
