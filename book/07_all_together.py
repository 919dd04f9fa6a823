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
# # All together
#
# The car can plan, it can estimate, and it can draw a smooth curve through waypoints. In this
# chapter it does all three in one loop, ten times a second. The paper says what should come out: a
# smoother lap, and one closer to the path. We shall see that the first is easily had, that the
# second is not, and why. <!-- given: ten times -->
#
# After this chapter you can
#
# - close a loop of filter, spline and MPC, and say what each part contributes;
# - split a tracking error into what the planner owes and what the filter owes;
# - compare two loops fairly: same noise, same time for a lap, many seeds;
# - recognise a plan that is made from noise, ends too soon, or is too old;
# - send a gradient once around the whole loop.
#
# You need [chapter 3](03_mpc.py), [chapter 4](04_ekf.py) and [chapter 6](06_splines.py). Take about
# 90 minutes. The chapter reproduces Fig. 4 (b) of the paper {cite}`pypose06`.
# <!-- given: 90 minutes -->

# %%
import inspect
import math
from functools import partial
from time import process_time

import ipywidgets
import matplotlib.pyplot as plt
import torch
from IPython.display import display

import pypose_lite as pp
from pypose_lite import filters, go1, infinity, splines
from pypose_lite.splines import planner
from pypose_lite.teaching import animate, claim, plotting, table, widgets

plotting.use_style()
torch.set_default_dtype(torch.float64)
dt, W, I, car = 0.1, infinity.waypoints(), torch.eye(4), pp.DubinsCar()
q, r = infinity.PROCESS_NOISE, infinity.OBSERVATION_NOISE
Q, R, wander = q**2 * I, r**2 * I, infinity.tracking_error
circles = infinity.reference(torch.linspace(0, infinity.LENGTH, 200))


# %%
def steering(price, sweeps=2):
    weights = torch.cat([torch.tensor([1, 1, 0.3, 0.3]), price * torch.ones(2)])
    stepper = sweeps and pp.utils.ReduceToBason(sweeps)
    return pp.module.MPC(car, weights.diag(), None, 10, stepper)


def lap(aim=None, price=0.01, cars=64, estimator=True, sweeps=2, noise=(q, r), **how):
    mpc, ekf = steering(price, sweeps), pp.module.EKF(car) if estimator else None
    generator = torch.Generator().manual_seed(0)
    world = infinity.SimulatedCar(car, W[0].expand(cars, 4), *noise, generator)
    return infinity.drive(mpc, world, ekf, aim, **{"steps": 60} | how)


def ahead(x, goal, spacing=0.25):
    """Chapter 6's local plan: ten states, from the car through what lies ahead."""
    return pp.local_plan(x, W, goal, spacing, count=10)


def stray(run):
    return wander(run.x[..., :-1, :])[run.running].mean()


# %% tags=["hide-input"]
def record(name, *args, **options):
    began, run = process_time(), lap(*args, sweeps=3, **options)
    runs[name], took[name] = run, 1000 * (process_time() - began) / run.u.shape[1]
    return run


def think(k):
    fig, ax = plt.subplots(figsize=(7, 4.3))
    x, goal = planned.estimate[0, : 3 * k + 1], planned.goal[0, 3 * k]
    plotting.plot_states(plotting.plot_course(ax), x, label="estimates")
    ax.plot(*ahead(x[-1], goal)[:, :2].mT, "kx--", ms=5, lw=1, label="local plan")
    fig.legend(loc="outside lower center", ncols=4)
    return fig


runs, took, cheap = {}, {}, {"price": 0.001, "tolerance": 0.3}
plain, planned = record("filter"), record("filter + plan", ahead, **cheap)
display(animate(think, int(planned.steps[0]) // 3, seconds=0.3))
claim("all_finish", planned.finished.all(), equals=True)
claim("closer", 100 * (1 - stray(planned) / stray(plain)), above=4, unit="%")

# %% [markdown]
# In every step the car asks its filter where it is, draws a curve from there through the next
# waypoints (the crosses), and lets the MPC follow that curve for one step. Then it throws the curve
# away. Every third step is shown. Over 64 cars it is {claim}`closer` closer to the circles than the
# car of chapter 4, which aims at the waypoints themselves. That does not sound like much. It is
# nearly all there was to gain, and most of the chapter is about how we know.

# %% [markdown]
# ## See it fail
#
# Chapter 6 ended with a plan that lies on the circles to less than a hair's breadth. So put it into
# chapter 4's loop and change nothing else: `aim=ahead`.
#
# **Predict.** What do the cars do: arrive and stray less, arrive and stray more, or not arrive?

# %%
strict, wide = lap(ahead, cars=16, steps=50), lap(ahead, tolerance=0.3)
silent = {"noise": (0, 0), "cars": 1, "estimator": False}
clear = lap(ahead, tolerance=0.3, **silent)
fig, panels = plt.subplots(1, 2, figsize=(7, 2.9), sharey=True)
titles = "reached at 0.1 m", "reached at 0.3 m"
for ax, title, run in zip(panels, titles, (strict, wide)):
    plotting.plot_course(ax, title)
    plotting.plot_states(ax, run.x[1, : run.steps[1] + 1], label="car")
    ax.label_outer()
fig.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=3)
plt.show()
claim("strict_finished", strict.finished.sum(), below=8)
claim("wide_finished", wide.finished.sum(), equals=64)
claim("strays_plain", stray(plain), below=0.045, unit="m")
claim("strays_wide", stray(wide), above=0.05, unit="m")
claim("strays_clear", stray(clear), above=0.05, unit="m")

# %% [markdown]
# <details><summary>Answer</summary>
#
# They hardly ever arrive: of 16 cars {claim}`strict_finished`. And if we let them arrive, by
# calling a waypoint reached at 0.3 m, they stray more: {claim}`strays_wide` on average, where the
# same loop without a plan strays {claim}`strays_plain`. <!-- given: 0.3 m -->
#
# </details>
#
# Two faults, and neither is the plan's.
#
# - **Stepping over.** The plan asks for 0.25 m a step. A car that comes by a waypoint may be beside
#   it before and after the step, and within 0.1 m never. From then on the plan leads *back*. A car
#   that aims at the point homes in on it; one that follows a curve passes. But then it need not hit
#   the point either: 0.3 m will do. <!-- given: 0.25 m, 0.1 m, 0.3 m -->
# - **The price.** A car without any noise strays {claim}`strays_clear`, nearly as much: so it is
#   not noise, it is *bias*. MPC pays for inputs. On the way to a waypoint that price is all that
#   keeps the car from jumping there in one step. Along a plan, which says itself how fast to go, it
#   only makes the car lag behind, and cut the corner.
#
# So let the plan have a cheaper price. Would that not have helped the old loop, too?

# %% mystnb={"markdown_format": "myst"}
hasty = lap(price=0.001, sweeps=3)
four = [("the waypoint", 0.01, plain), ("the waypoint", 0.001, hasty)]
four, rows = [*four, ("a plan", 0.01, wide), ("a plan", 0.001, planned)], []
for name, price, run in four:
    steps, speed = run.steps.double().mean(), run.u[..., 0][run.running].mean()
    rows.append(f"{name} | {price} | {steps:.1f} | {speed:.2f} | {stray(run):.4f}")
display(table("aims at | price | steps | mean speed (m/s) | strays (m)", rows))
claim("hasty_speed", hasty.u[..., 0][hasty.running].mean(), above=5, unit="m/s")
claim("hasty_strays", stray(hasty) / stray(plain), above=0.95)
claim("strays_planned", stray(planned), below=0.038, unit="m")
same_time = planned.steps.sum() / plain.steps.sum()
claim("same_time", same_time, above=0.93, below=1.03)

# %% [markdown]
# It would not. At the low price the old loop hops from waypoint to waypoint at {claim}`hasty_speed`
# and is no closer, {claim}`hasty_strays` times as far away as before. With a plan,
# {claim}`strays_planned`. The spacing of the plan, 0.25 m, was chosen so that a lap takes as long
# as it does without one ({claim}`same_time` times as many steps): a slow car always looks better.
# <!-- given: 0.25 m -->

# %% [markdown]
# ## From scratch
#
# One car, and the whole loop, with the paper's three lines in it: `chspline` makes the plan, `mpc`
# follows it, `ekf` finds out where that led. The spline has five points a piece however long the
# piece is; the car wants one every 0.25 m. `by_metres` walks along the points and says where it is
# after each. <!-- given: 0.25 m -->


# %%
def by_metres(points, spacing=0.25, count=10):
    leg = points.diff(dim=0)
    length = leg.norm(dim=-1, keepdim=True)
    s = torch.cat([torch.zeros(1), length[:, 0].cumsum(0)])
    at = (spacing * torch.arange(count)).clamp(max=s[-1])
    k = torch.searchsorted(s[1:], at).clamp(max=len(leg) - 1)
    direction = leg[k] / length[k]
    place = points[k] + (at - s[k])[:, None] * direction
    return torch.cat([place, direction], dim=-1)


def chspline_plan(x, goal):
    waypoints = torch.cat([x[None, :2], W[goal : goal + 3, :2]])
    points = pp.chspline(waypoints, interval=0.2)
    return by_metres(points)


# %%
def by_hand(plan, steps=60):
    generator, goal, warm = torch.Generator().manual_seed(0), 1, None
    ekf, mpc, P = pp.module.EKF(car), steering(0.001), infinity.PRIOR**2 * I
    x, u, y = {0: W[0]}, {}, {}
    X = {0: W[0] + infinity.PRIOR * torch.randn(4, generator=generator)}
    for i in range(steps):
        v = r * torch.randn(4, generator=generator)
        y[i] = car.observation(x[i], None) + v
        goal += int((X[i] - W[goal])[:2].norm() <= 0.3)
        if goal == 17:
            break
        xt, us, cost = mpc(dt, X[i], plan(X[i], goal), warm)
        u[i], warm = us[0], pp.shift(us)
        X[i + 1], P = ekf(X[i], y[i], u[i], P, Q, R)
        w = q * torch.randn(4, generator=generator)
        x[i + 1] = car.transition(x[i], u[i]) + w
    return torch.stack(list(x.values()))


# %% [markdown]
# Where do the goal and the filter meet? `X[i]` is the estimate *before* the observation `y[i]` is
# used, as in chapter 4: the car decides first, and looks at what it saw while it moves.
#
# ## The library's version
#
# `infinity.drive` is this loop for a batch, and its `aim` is our `plan`. Chapter 6's planner
# differs from ours in one point that will matter: it also uses the directions, of the waypoints and
# of the car. `places_only` is our plan again, for a batch and with exact lengths.

# %%
print(inspect.getsource(planner.local_plan).split('"""')[2])


def places_only(x, goal):
    goal = torch.as_tensor(goal)
    following = W[(goal[..., None] + torch.arange(3)).clamp(max=16), :2]
    curve = splines.hermite(torch.cat([x[..., None, :2], following], dim=-2))
    t = splines.parameter_at(curve, 0.25 * torch.arange(10))
    direction = splines.heading(curve(t, derivative=1), still=W[16, 2:])
    return torch.cat([curve(t), direction], dim=-1)


alone, mine = lap(ahead, cars=1, steps=20, **cheap).x[0], by_hand(ahead, steps=20)
claim("same_lap", (mine - alone).abs().max(), below=1e-8, unit="m")
ours, theirs = (plan(alone[5], 2)[:, :2] for plan in (chspline_plan, places_only))
claim("plans_apart", (ours - theirs).abs().max(), below=0.02, unit="m")
claim("chspline_steps", len(by_hand(chspline_plan)) - 1, below=60)

# %% [markdown]
# Our loop with `local_plan` and the library's drive the same lap, to {claim}`same_lap`. With
# `chspline_plan` it takes {claim}`chspline_steps` steps; a plan of its is {claim}`plans_apart` from
# one of `places_only`, since `by_metres` goes along chords.
#
# ## On the infinity
#
# The paper's Fig. 4 (b), below its Fig. 3 (b), in which there is no spline. The second row is
# `places_only`, the third `local_plan`; on the right is what the controller asked of the car.

# %%
raw = record("raw", estimator=False, tolerance=0.3)
places = record("filter + chspline", places_only, **cheap)
names = ["EKF", "EKF + chspline", "EKF + local plan"]
fig, panels = plt.subplots(3, 2, figsize=(7, 6.9), width_ratios=[5, 4], sharex="col")
for (left, right), name, run in zip(panels, names, (plain, places, planned)):
    plotting.plot_course(left, name)
    left.plot(*run.x[1:16].permute(2, 1, 0)[:2], color=plotting.GREY, lw=0.4)
    left.lines[1].set_label("15 other cars")
    plotting.plot_states(left, run.x[0, : run.steps[0] + 1], label="car")
    u = run.u[0, : run.steps[0]]
    for k, what in enumerate(["speed (m/s)", "turn rate (rad/s)"]):
        right.step(dt * torch.arange(len(u)), u[:, k], "-:"[k], lw=1.2, label=what)
    right.set(ylabel="input", ylim=(-8, 8))
    left.label_outer()
right.set(xlabel="time (s)")
panels[0, 1].legend(loc="lower left")
_ = fig.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4)

# %% [markdown]
# Now in numbers, over 64 cars, and with two more rows. *Raw* has neither filter nor plan, and its
# waypoints count at 0.3 m, or it would not arrive. The *smoother* of chapter 4 looks back over the
# recordings of the row above; it cannot steer, but no loop can know more than it does.
# <!-- given: 0.3 m -->
#
# - *Strays*: the mean distance between car and circles. *Knows*: that between the car and where it
#   believes to be.
# - *Bends*: the mean squared curvature of the way the car went, $\int \kappa^2 ds / \int ds$. On
#   the circles it is 1.
# - *Changes*: the mean squared change of speed, and of turn rate, from one step to the next.
# - *Time*: CPU time for one step of all 64 cars.


# %%
def bending(x, on):
    """Mean squared curvature (1/m^2) of ways (B, N, 2), weighted by length."""
    leg = x.diff(dim=1)
    a, b = leg[:, :-1], leg[:, 1:]
    cross = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    angle = torch.atan2(cross, (a * b).sum(-1))[on]
    length = (a.norm(dim=-1) + b.norm(dim=-1))[on] / 2
    return (angle.square() / length).sum() / length.sum()


N, began = planned.steps.min(), process_time()  # as long as all are driving
X, P = planned.estimate[:, :N], planned.P[:, :N]
y, u = planned.y[:, : N - 1], planned.u[:, : N - 1]
xs, Ps = filters.smooth(pp.EKF(car, Q, R), X, P, y, u)
took["smoother"] = 1000 * (process_time() - began) / N
knows = (xs - planned.x[:, :N])[..., :2].norm(dim=-1).mean()
bends = bending(xs[..., :2], torch.full((64, N - 2), True))
smoother = f"smoother | | {knows:.3g} | {bends:.3g} | | | | {took['smoother']:.0f}"
claim("knows_smoother", knows, below=0.05, unit="m")

# %% mystnb={"markdown_format": "myst"}
seen, rows = {}, []
for name in ("raw", "filter", "filter + chspline", "filter + plan"):
    run, on = runs[name], runs[name].running
    off = (run.estimate - run.x[:, :-1])[..., :2].norm(dim=-1)[on].mean()
    changes = run.u.diff(dim=1)[on[:, 1:]].square().mean(0)
    way = bending(run.x[..., :2], on[:, 1:])
    seen[name] = [stray(run), off, way, *changes, run.steps.double().mean()]
    cells = [name, *(f"{z:.3g}" for z in seen[name]), f"{took[name]:.0f}"]
    rows.append(" | ".join(cells))
head = "loop | strays (m) | knows (m) | bends (1/m²) | speed changes | turn changes"
display(table(head + " | steps | time (ms)", [*rows, smoother]))
before, bare, after = list(seen.values())[1:]
claim("smoother_speed", before[3] / after[3], above=100)
claim("smoother_turn", before[4] / after[4], above=4)
claim("smoother_way", before[2] / after[2], above=1.1)
claim("bends_planned", after[2], equals=1, within=0.05, unit="1/m²")
claim("bare_speed", before[3] / bare[3], above=30)
claim("bare_turn", bare[4] / before[4], above=1)
claim("bare_strays", bare[0] / before[0], above=1.1)
claim("plan_strays", after[0] / before[0], below=0.96)

# %% [markdown]
# "The inclusion of `chspline` noticeably smooths the trajectory and brings it closer to the desired
# path", says the paper.
#
# *Smooths* holds, and more than noticeably: the speed changes {claim}`smoother_speed` times less,
# the turn rate {claim}`smoother_turn` times, the way bends {claim}`smoother_way` times less, and
# with {claim}`bends_planned` hardly more than a circle. The reason is simple. A waypoint is a place
# to get to as soon as possible; a plan also says *when*.
#
# *Closer* depends on the plan. With `chspline` alone, through the places, the car is
# {claim}`bare_strays` times as far away as without any plan, and turns no more smoothly
# ({claim}`bare_turn` times as much change). Such a curve does not know the car's heading. It leaves
# towards the next waypoint, along the chord, in every step anew. With the headings the car is
# closer by {claim}`closer`.
#
# ### Who owes what
#
# Why so little? Split the error. Let $b$ be how far off the circle the car *believes* to be, and
# $e$ how far it is from where it believes to be, both measured along the radius. Then its true
# distance is $t = b + e$. The planner sees $b$ and can work on it. Nobody sees $e$. And if the
# filter is right, $e$ is independent of all that the filter says, so of $b$:
#
# $$ \overline{t^2} = \overline{b^2} + \overline{e^2} $$ (eq-7-split)
#
# where the bar is the mean over cars and steps. Planning can bring $b$ to zero. Below $e$ only a
# better filter gets, or a better sensor.
#
# **Predict.** In the lap with a plan, which is larger: what the planner owes, or what the filter
# owes?


# %%
def split(x, told, on):
    """The mean squares of t, b and e (m^2)."""
    circle = torch.tensor([1.0, -1.0])
    t, b = (torch.hypot(z[..., :1] - circle, z[..., 1:2]) - 1 for z in (x, told))
    near = t.abs().argmin(-1, keepdim=True)
    t, b = (z.take_along_dim(near, -1)[..., 0][on] for z in (t, b))
    return [z.square().mean() for z in (t, b, t - b)]


started = torch.arange(60) >= 10  # the first second remembers how we started
shares = {}
for name in ("filter", "filter + chspline", "filter + plan"):
    run = runs[name]
    on = run.running & started[: run.u.shape[1]]
    shares[name] = split(run.x[:, :-1], run.estimate, on)
shares["smoother"] = split(planned.x[:, :N], xs, started[:N].expand(64, N))
t2, b2, e2 = torch.tensor(list(shares.values())).T
miss = (t2 / (b2 + e2) - 1)[:3].abs().max()
claim("adds_up", 100 * miss, below=15, unit="%")

# %%
fig, ax = plt.subplots(figsize=(7, 2.8))
names, b, e = list(shares), 1e4 * b2, 1e4 * e2  # in cm^2
ax.barh(names, b, color=plotting.ORANGE, label="believed, b²: the planner's")
ax.barh(names, e, left=b, color=plotting.SKY, label="not known, e²: the filter's")
ax.plot(1e4 * t2[:3], names[:3], "D", color="black", ms=6, label="true, t²")
ax.invert_yaxis()
ax.set(xlabel="mean squared distance from the circles (cm²)")
ax.legend(loc="lower right")
plt.show()
claim("planner_owes", 100 * b2[2] / (b2 + e2)[2], below=30, unit="%")
claim("planner_owed", 100 * b2[0] / (b2 + e2)[0], above=25, unit="%")
claim("paid_back", 100 * (1 - b2[2] / b2[0]), above=40, unit="%")
claim("hindsight", (e2[3] / e2[2]).sqrt(), below=0.9)

# %% [markdown]
# <details><summary>Answer</summary>
#
# The filter, by far: the planner owes {claim}`planner_owes`.
#
# </details>
#
# Without a plan it was {claim}`planner_owed`. The plan has paid back {claim}`paid_back` of it; what
# is left is nearly all the filter's. Bars and diamonds agree to {claim}`adds_up`. The last bar is
# the bound: with hindsight the unknown part is {claim}`hindsight` times as large, but hindsight
# does not steer. So a better plan can hardly help this car any more. Better eyes would.
#
# ### Better eyes, worse eyes
#
# Eight cars each, one of them drawn, and how far they stray. In JupyterLab, the controls below set
# the noise and switch the plan on and off.


# %%
def eyes(noise, plan=None):
    shown = [False, True] if plan is None else [plan]
    fig, panels = plt.subplots(1, len(shown), figsize=(7, 2.9), squeeze=False)
    for ax, on in zip(panels[0], shown):
        if (noise, on) not in laps:
            how = {"aim": ahead} | cheap if on else {}
            laps[noise, on] = lap(cars=8, noise=(q, noise), **how)
        run, name = laps[noise, on], "with a plan" if on else "without a plan"
        plotting.infinity_axes(ax, f"{name}: {stray(run):.3f} m", margin=0.5)
        plotting.plot_reference(ax, circles)
        plotting.plot_states(ax, run.x[0, : run.steps[0] + 1])
        ax.label_outer()
    return fig


laps = {(0.163, False): plain, (0.163, True): planned}
display(widgets.panels(eyes, [0.02, 0.08, 0.163, 0.3], "observation noise (m)"))
good, bad = (1 - stray(laps[z, True]) / stray(laps[z, False]) for z in (0.02, 0.3))
claim("good_eyes", 100 * good, above=20, unit="%")
claim("bad_eyes", 100 * bad, below=20, unit="%")

# %% tags=["remove-cell"]
widgets.live(
    eyes,
    noise=ipywidgets.FloatSlider(0.16, min=0.02, max=0.4, step=0.02),
    plan=ipywidgets.Checkbox(True, description="plan"),
)

# %% [markdown]
# With good eyes the plan brings {claim}`good_eyes`, with bad ones {claim}`bad_eyes`. Smooth it is
# in every case.
#
# ### What it costs
#
# "The dense waypoints could decrease the computing cost of MPC and overshoot probability." A plan
# that hardly changes makes the last solution a fine first guess. So both loops again, with a
# *single* sweep of the MPC in every step. And how often is a car more than 0.1 m off?
# <!-- given: 0.1 m -->

# %%
one = [lap(sweeps=1), lap(ahead, sweeps=1, **cheap)]
claim("one_sweep_plain", stray(one[0]) / stray(plain), above=1.2)
claim("one_sweep_planned", stray(one[1]) / stray(planned), below=1.15)
claim("one_sweep_arrive", one[1].finished.all(), equals=True)
often = [(wander(z.x[:, :-1]) > 0.1)[z.running].sum() for z in (plain, planned)]
claim("overshoot", often[1] / often[0] / same_time, below=0.85)
claim("time_planned", took["filter + plan"] / took["filter"], below=2, varies=True)

# %% [markdown]
# With one sweep instead of three the old loop strays {claim}`one_sweep_plain` times as far, the new
# one {claim}`one_sweep_planned` times. So the paper is right: MPC becomes cheaper. But the plan has
# to be made, too; with three sweeps each, a step with a plan takes {claim}`time_planned` times as
# long. The car is far off {claim}`overshoot` times as often.

# %% [markdown]
# ## Break it
#
# Three faults, sixteen cars each.
#
# - **Plan from noise.** The filter is left out; the plan starts at the raw observation.
# - **Short plan.** It ends at the next waypoint, and waits there.
# - **Old plan.** A new one is made only in every twelfth step, and the car cannot do more than 2
#   m/s. Its MPC knows (`drive` hands the bounds on), but the plan goes on at 2.5 m/s.
#   <!-- given: 2 m, 2.5 m -->
#
# **Predict.** One of them cannot be seen on the map. Which?


# %%
def next_only(x, goal):
    return pp.local_plan(x, W[goal][..., None, :], 0, 0.25, count=10)


def every_twelfth(spacing, x, goal):
    """The plan of up to eleven steps ago, from where it should have led by now."""
    i = len(gaps[spacing]) % 12
    if i == 0:
        plans[spacing] = pp.local_plan(x, W, goal, spacing, count=22)
    plan = plans[spacing][..., i : i + 10, :]
    gaps[spacing].append((x - plan[..., 0, :])[..., :2].norm(dim=-1))
    return plan


slow = {"u_lower": -4.0, "u_upper": torch.tensor([2.0, 4.0]), "steps": 26}
few, plans, gaps = {"cars": 16} | cheap, {}, {0.25: [], 0.18: []}
noisy, brief = lap(ahead, estimator=False, **few), lap(next_only, **few)
old, cured = (lap(partial(every_twelfth, spacing), **slow | few) for spacing in gaps)
jolts = [z.u.diff(dim=1)[z.running[:, 1:]].square().mean(0) for z in (noisy, brief)]
claim("cured_strays", stray(cured), below=0.045, unit="m")

# %% tags=["hide-input"]
fig, panels = plt.subplots(2, 3, figsize=(7, 4.2), height_ratios=[1.1, 1])
faults = {"plan from noise": noisy, "short plan": brief, "old plan": old}
for ax, (name, run) in zip(panels[0], faults.items()):
    plotting.plot_reference(plotting.infinity_axes(ax, name), circles)
    plotting.plot_states(ax, run.x[0, : run.steps[0] + 1])
    ax.label_outer()
pairs = {"turn rate (rad/s)": (noisy.u[0, :, 1], planned.u[0, :, 1])}
pairs["speed (m/s)"] = brief.u[0, :, 0], planned.u[0, :, 0]
pairs["car to plan (m)"] = [torch.stack(gap)[:, 0] for gap in gaps.values()]
for ax, (name, (broken, right)) in zip(panels[1], pairs.items()):
    lines = ax.plot(broken[:26], "-", right[:26], "--", lw=1.2)
    ax.set(xlabel="step", ylabel=name)
fig.legend(lines, ["broken", "right"], loc="outside lower center", ncols=2)
plt.show()
claim("noisy_turning", jolts[0][1] / after[4], above=50)
claim("noisy_strays", stray(noisy), above=0.07, unit="m")
claim("brief_strays", stray(brief) / stray(planned), above=0.8, below=1.4)
claim("brief_jolts", jolts[1][0] / after[3], above=3)
claim("old_gap", torch.stack(gaps[0.25]).amax(0).mean(), above=0.2, unit="m")
claim("old_strays", stray(old), above=0.1, unit="m")

# %% [markdown]
# <details><summary>Answer</summary>
#
# The short plan: it strays {claim}`brief_strays` times as far as the right one.
#
# </details>
#
# - **Plan from noise.** A spline is no filter. It passes through its first point *exactly*, in
#   exactly the direction it is told, and both are noise here. Symptom: the turn rate changes
#   {claim}`noisy_turning` times as much. Fix: estimate first, then plan.
# - **Short plan.** The speed drops before each waypoint, as the end of the plan comes into the
#   MPC's sight; its changes are {claim}`brief_jolts` times as large. Fix: plan further than the
#   horizon looks.
# - **Old plan.** The plan runs away from the car, up to {claim}`old_gap`, and the car takes the
#   short cut after it: it strays {claim}`old_strays`. Fix: not, in the first place, a newer plan,
#   but one that the car can follow. With 0.18 m a step, and still only one plan in twelve steps, it
#   is {claim}`cured_strays`: the MPC follows an old plan as well as a new one, if it can.
#   <!-- given: 0.18 m -->
#
# So how often must we plan? With these waypoints, which stand still, hardly ever. Where they move,
# or something else does, as often as that.

# %% [markdown]
# ## Verify
#
# The loop has many parts, and each can hide the fault of another. So every one has its own test:
# the filter its NEES, the plan its ends, the MPC its convergence, and the split {eq}`eq-7-split`
# the filter and the bookkeeping together.

# %%
inside = planned.running
truth = planned.x[:, :-1]
nees = filters.nees(planned.estimate, planned.P, truth)[inside].mean()
low, high = filters.chi_square_interval(4, runs=64)
claim("nees", nees, above=low, below=high)
X, goal = planned.estimate[:, :N:4], planned.goal[:, :N:4].clamp(max=16)
plans = ahead(X, goal)
starts = (plans[..., 0, :2] - X[..., :2]).abs().max()
claim("starts_at_the_car", starts, below=1e-12, unit="m")
gap = plans[..., :2].diff(dim=-2).norm(dim=-1)
claim("longest_step", gap.max(), below=0.25 + 1e-9, unit="m")
claim("merged", wander(plans[:, :, -3:]).max(), below=1e-5, unit="m")
solved = steering(0.001, sweeps=None).solve(dt, X, plans)
claim("converged", solved.converged.all(), equals=True)
claim("early_stop", (solved.u[:, :, 0] - planned.u[:, :N:4]).abs().max(), below=0.4)
claim("unbiased", stray(lap(ahead, **cheap | silent)), below=0.015, unit="m")

# %% [markdown]
# NEES is {claim}`nees`, where 4 is right: the filter is honest in this loop, too. It would be as
# honest about a car that drives in the wrong direction. The plans start at the car and have merged
# with the circles 2 m ahead, to {claim}`merged`; that says nothing about whether the car follows.
# That it does, is what the car without noise shows: it strays {claim}`unbiased`, where it was
# {claim}`strays_clear` at the old price. Three sweeps a plan were enough: to the end, the first
# inputs would have differed by {claim}`early_stop` at most. And `same_lap` shows only that two of
# us wrote the same loop. <!-- given: 2 m -->

# %% [markdown]
# ## Differentiate through it
#
# The low price was chosen by hand. But a lap is one long differentiable function: the estimate
# depends on the input, the plan on the estimate, the MPC's answer on both and on the price, the
# next state on that. So ask: by how much would the cars stray less if the price fell a little? The
# noise is kept the same; the gradient goes back through filter, spline, MPC and car, 12 steps of
# them.


# %%
def loss(log_price):
    """The root mean square of the distance to the circles (m)."""
    run = lap(ahead, log_price.exp(), 8, sweeps=None, steps=12, tolerance=0.3)
    return wander(run.x).square().mean().sqrt()


log_price, h = torch.tensor(0.01).log().requires_grad_(), 1e-4
errors, slopes = [], []
for _ in range(2):
    errors.append(loss(log_price))
    slopes.extend(torch.autograd.grad(errors[-1], log_price))
    log_price = (log_price - 30 * slopes[-1]).detach().requires_grad_()
print("errors:", *(f"{error.item():.4f} m" for error in errors), sep="  ")
start = torch.tensor(0.01).log()
with torch.no_grad():
    central = (loss(start + h) - loss(start - h)) / (2 * h)
claim("gradient_error", (slopes[0] / central - 1).abs(), below=1e-5)
claim("slope", slopes[0], above=0, unit="m")
claim("learned_price", log_price.exp().detach(), below=0.008)
claim("learned_error", errors[-1].detach() / errors[0].detach(), below=0.97)

# %% [markdown]
# The gradient equals central differences to {claim}`gradient_error`. It says that the price is too
# high, as we found by looking at a car without noise, and after one step of descent the error is
# {claim}`learned_error` of what it was. It cannot see everything: a waypoint counts as reached at
# one step or at the next, and over such a jump no gradient leads. With the same noise and a small
# step, nothing jumps. Chapter 8 goes on from here.

# %% [markdown]
# ## On the robot
#
# The simulated Go1, within the limits of its trot. A step of the plan is 0.11 m, which a trot of
# 1.2 m/s can keep up with. Its odometry is good, and the filter is told so. Nothing in this book
# was tried on a real robot. <!-- given: 0.11 m, 1.2 m -->

# %%
trot, plan = torch.tensor([1.2, 1.5]), partial(ahead, spacing=0.11)
noise = {"process_noise": 0.02, "observation_noise": 0.02}
noise["generator"] = torch.Generator().manual_seed(0)
options = {"tolerance": 0.3, "u_lower": -trot, "u_upper": trot}
with go1.connect("sim", start=(0.0, 0.0, -math.pi / 2)) as robot:
    mpc, ekf = steering(0.001), pp.module.EKF(car)
    world = infinity.RealRobot(robot, dt, **noise)
    walk = infinity.drive(mpc, world, ekf, plan, **options)
fig, ax = plt.subplots(figsize=(7, 3.2))
plotting.plot_states(plotting.plot_course(ax), walk.x, label="the dog, as it says")
ax.set_ylim(-1.3, 1.8)
ax.legend(loc="upper center", ncols=3)
plt.show()
claim("dog_finished", walk.finished, equals=True)
claim("dog_strays", wander(walk.x).mean(), below=0.07, unit="m")

# %% [markdown]
# The dog comes around, {claim}`dog_strays` from the path on average. Without noise the car strayed
# {claim}`unbiased`. One difference is the dog's legs: they answer late, and a plan that begins as
# if it could turn at once does not know. Chapter 9 does.

# %% [markdown]
# ## Summary
#
# - Filter, spline and MPC in one loop of 20 lines; the library's is the same to {claim}`same_lap`.
# - *Smoother* holds: speed changes {claim}`smoother_speed` times less, turn rate
#   {claim}`smoother_turn` times, and the way bends like a circle, {claim}`bends_planned`.
# - *Closer* holds for a plan with headings and a price to match: {claim}`strays_planned` after
#   {claim}`strays_plain`. For `chspline` through the places it does not: {claim}`bare_strays`
#   times.
# - The error is the planner's plus the filter's, in squares. The plan pays back {claim}`paid_back`
#   of the planner's share, and {claim}`planner_owes` of the error is left to it.
# - A gradient goes around the whole loop, right to {claim}`gradient_error`.
#
# | the paper says of Fig. 4 (b) | `chspline` | local plan |
# |:--|:--|:--|
# | "smooths": speed changes less, by | {claim}`bare_speed` | {claim}`smoother_speed` |
# | "smooths": turn rate changes | more, by {claim}`bare_turn` | less, by {claim}`smoother_turn` |
# | "closer": distance, EKF alone = 1 | {claim}`bare_strays` | {claim}`plan_strays` |
# | "overshoot probability", likewise | | {claim}`overshoot` |
# | "computing cost": distance with one sweep, with three = 1 | | {claim}`one_sweep_planned` |
#
# **What differs from PyPose.** `chspline`, `EKF` and `MPC` have the same names there. In PyPose
# 0.9.5 no planner knows headings, the third argument of an MPC's call is not a target, its bounds
# are not used, and an EKF takes one state at a time; chapters 3, 4 and 6 say more.
#
# **Further reading.** Bar-Shalom, Li and Kirubarajan {cite}`barshalom2001` on why an estimator's
# error is independent of its estimate; Anderson and Moore {cite}`anderson1990`, chapter 8, on what
# that means for control: the separation of planning and estimating, which is exact for linear
# systems, and here nearly so; the source of `pypose_lite/splines/planner.py`.
#
# Next: chapter 8 learns through this loop.
