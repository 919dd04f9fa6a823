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
# A robot that carries boxes through a warehouse has a program that estimates where it is, one that
# plans a path, and one that steers along the path. Often three people wrote them, and each part
# passes its own tests. Then the robot takes a corner too wide. Whose fault is it, and which part is
# worth a week of work? In this chapter the filter, the spline and the planner of the last chapters
# drive the car in one loop, and we answer these two questions with numbers.
#
# After this chapter you can
#
# - close a loop of filter, spline and MPC, and draw it as a block diagram;
# - split an error into what the control, the estimate and the delay between them cause;
# - compare two loops fairly: at equal tolerance, equal lap time and equal noise;
# - say for which sensor, tolerance and horizon a filter or a plan pays.
#
# You need [chapter 3](03_mpc.py) (MPC), [chapter 4](04_ekf.py) (the Kalman filter) and
# [chapter 6](06_splines.py) (splines). Take about 60 minutes. The chapter reproduces Fig. 4 (b) of
# the paper {cite}`pypose06`. <!-- given: 60 minutes -->

# %% tags=["setup"]
from functools import partial

import ipywidgets
import matplotlib.pyplot as plt
import torch
from IPython.display import display

import pypose_lite as pp
from pypose_lite import filters, infinity, splines
from pypose_lite.teaching import animate, claim, plotting, sketches, table, widgets

plotting.use_style()
torch.set_default_dtype(torch.float64)

# %% [markdown]
# The car, its noise and the weights of the MPC are those of chapters 3 and 4, but for one: the
# weight of the inputs, `price`, is chosen anew for each loop. A local plan of chapter 6, `ahead`,
# has ten states, 0.25 m apart, from the car through the waypoints that lie before it.
# <!-- given: 0.25 m -->

# %%
dt = 0.1  # s
car = pp.DubinsCar(dt)
ekf = pp.module.EKF(car)
waypoints = infinity.waypoints()
sensor_noise = infinity.OBSERVATION_NOISE  # 0.163 on each component


def controller(price, horizon=10, sweeps=3):
    weights = torch.tensor([1, 1, 0.3, 0.3, price, price])
    stepper = pp.utils.ReduceToBason(sweeps)
    return pp.module.MPC(car, weights.diag(), None, horizon, stepper)


def ahead(x, goal, count=10):
    return pp.local_plan(x, waypoints, goal, spacing=0.25, count=count)


# %% [markdown]
# `drive` sends a batch of 64 cars around the infinity. `aim` says what the MPC gets as its target:
# `ahead` gives it a local plan, and `None` the next waypoint. All loops of this chapter meet the
# *same* noise: car number 5 is disturbed in the same way in each of them.


# %%
def drive(aim, price, filter=ekf, noise=sensor_noise, tolerance=0.2, cars=64, **mpc):
    generator = torch.Generator().manual_seed(0)
    start = waypoints[0].expand(cars, 4)
    disturbed = infinity.PROCESS_NOISE  # 0.005 on each component
    world = infinity.SimulatedCar(car, start, disturbed, noise, generator)
    planner = controller(price, **mpc)
    return infinity.drive(planner, world, filter, aim, tolerance, steps=70)


def distance(run):
    """Returns the distance of each car from the circles in each step, in metres."""
    return infinity.tracking_error(run.x[:, :-1])


along_plan = drive(ahead, price=0.001)

# %% tags=["hide-input"]
steps = int(along_plan.steps[0])
fig, ax = plt.subplots(figsize=(7, 4.3))
plotting.plot_course(ax)
[way] = plotting.plot_states(ax, along_plan.estimate[0, :1], label="estimates")
[plan] = ax.plot([], [], "kx--", ms=5, lw=1, label="local plan")
fig.legend(loc="outside lower center", ncols=4)


def think(frame):
    k = 3 * frame
    x = along_plan.estimate[0, : k + 1]
    way.set_data(*x[:, :2].mT)
    plan.set_data(*ahead(x[-1], along_plan.goal[0, k])[:, :2].mT)
    return fig


alt = "A film: a car on the infinity sign, and the smooth plan ahead of it."
display(animate(think, steps // 3, seconds=0.4, alt=alt))

# %% tags=["claims"]
claim("all_finish", along_plan.finished.sum(), equals=64)
plan_mean = distance(along_plan)[along_plan.running].mean()
claim("plan_mean", plan_mean, below=0.038, unit="m")

# %% [markdown]
# In every step the car asks its filter where it is (the dot), draws a curve from there through the
# next waypoints (the crosses), and lets the MPC follow this curve for one step. Then it throws the
# curve away and begins again. Every third step is shown. All {claim}`all_finish` cars finish, and
# are {claim}`plan_mean` from the two circles on average. <!-- given: Every third -->

# %% [markdown]
# ## It fails: the best estimate, and one waypoint to aim at
#
# What we have so far is the MPC of chapter 3, which aims at the next waypoint, with a filter of
# chapter 4 or 5 that tells it where the car is. The paths of its cars still look uneven. Perhaps
# the estimate is to blame? A simulation can find out, since it can do what no robot can: give the
# car its true state.

# %%
to_waypoint = drive(None, price=0.02)
with_truth = drive(None, price=0.02, filter=None, noise=0.0)

# %% [markdown]
# **Predict.** How far does the mean distance from the circles fall if the car knows its true state:
# to almost nothing, to about half of it, or not at all? <!-- given: half -->

# %% tags=["answer", "hide-input"]
fig, panels = plotting.stacked(3, height=2.9, height_ratios=[3, 3, 2])
both = [("with the filter", to_waypoint), ("with its true state", with_truth)]
for ax, (title, run) in zip(panels, both):
    n = int(run.steps[0])
    plotting.plot_course(ax, title)
    plotting.plot_states(ax, run.x[0, : n + 1], label="car")
    panels[2].step(dt * torch.arange(n), run.u[0, :n, 0], where="post", label=title)
panels[2].set(xlabel="time (s)", ylabel="speed (m/s)", ylim=(0, 7))
panels[2].legend(loc="upper right", ncols=2)
legend = panels[0].get_legend_handles_labels()
fig.legend(*legend, loc="outside upper center", ncols=3)
plotting.show(
    fig,
    "Two maps and a plot of the speed. With its true state the car is nearer to "
    "the circles than with the filter, but it cuts the arcs, and its speed jumps.",
)

# %% tags=["answer", "claims"]
filter_mean = distance(to_waypoint)[to_waypoint.running].mean()
truth_mean = distance(with_truth)[with_truth.running].mean()
claim("waypoint_mean", filter_mean, below=0.042, unit="m")
claim("truth_mean", truth_mean, below=0.03, unit="m")
claim("truth_share", truth_mean / filter_mean, above=0.4, below=0.65)
i, j = with_truth.x[:, :-1, :2].unbind(-1)
signed = torch.hypot(i.abs() - 1, j) - 1  # both circles, folded onto the right one
inside = (signed[with_truth.running] < 0).double().mean()
claim("inside_share", 100 * inside, above=70, unit="%")
truth_speeds = with_truth.u[..., 0][with_truth.running]
claim("truth_fastest", truth_speeds.max(), above=4, unit="m/s")
claim("truth_slowest", truth_speeds.min(), below=1.3, unit="m/s")

# %% [markdown] tags=["answer"]
# To about half of it: from {claim}`waypoint_mean` to {claim}`truth_mean`, a factor of
# {claim}`truth_share`. So the estimate is not the only cause. The car that knows everything still
# drives badly, between {claim}`truth_slowest` and {claim}`truth_fastest`, and inside the circle in
# {claim}`inside_share` of its steps. A waypoint is a place to be at *as soon as possible*. The cost
# says nothing about the way to it, so the car rushes along the chord, brakes, and rushes on.
# <!-- given: half -->

# %% [markdown]
# ## The idea: four blocks and a loop
#
# A plan says where to be *and when*. So we put chapter 6's local plan between the waypoints and the
# MPC.

# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 3.4))
ax.set(xlim=(-0.4, 11.3), ylim=(-0.5, 4.8), aspect="equal")
ax.axis("off")
sketches.box(ax, 1.6, 3.2, "plan\n(spline)", width=2.2, height=1.3)
sketches.box(ax, 5.4, 3.2, "MPC", width=1.8, height=1.3)
sketches.box(ax, 9.6, 3.2, "car", width=1.8, height=1.3)
sketches.box(ax, 5.4, 0.6, "filter", width=2.2, height=1.1)
sketches.box(ax, 9.6, 0.6, "sensor", width=2.0, height=1.1)
sketches.wire(ax, (1.6, 4.7), (1.6, 3.85))  # waypoints
sketches.wire(ax, (2.7, 3.2), (4.5, 3.2))  # ten states ahead
sketches.wire(ax, (6.3, 3.2), (8.7, 3.2))  # the input
sketches.wire(ax, (7.0, 3.2), (7.0, 1.9), (5.9, 1.9), (5.9, 1.15))  # to the filter
sketches.wire(ax, (9.6, 2.55), (9.6, 1.15))  # the true state
sketches.wire(ax, (8.6, 0.6), (6.5, 0.6))  # the observation
sketches.wire(ax, (4.3, 0.6), (1.6, 0.6), (1.6, 2.55))  # the estimate
sketches.wire(ax, (1.6, 1.9), (4.9, 1.9), (4.9, 2.55))
ax.plot([7.0, 1.6], [3.2, 1.9], "ko", ms=5)
words = [(1.8, 4.25, "waypoints"), (2.75, 3.4, "target"), (7.15, 3.4, "$u_i$")]
words += [(9.75, 1.7, "$x_i$"), (7.4, 0.75, "$y_i$"), (2.4, 0.75, "$X_i$")]
for i, j, text in words:
    sketches.word(ax, i, j, text)
plotting.show(
    fig,
    "Block diagram. Waypoints enter the plan, which gives a target to the MPC, which "
    "gives the input to the car. A sensor observes the car. The filter makes an "
    "estimate of the observation and the input, and plan and MPC start from it.",
)

# %% tags=["claims"]
plan_error = (along_plan.estimate - along_plan.x[:, :-1])[..., :2].norm(dim=-1)
claim("plan_knows", plan_error[along_plan.running].mean(), below=0.065, unit="m")

# %% [markdown]
# Each block has one task and knows little of the others. The *filter* makes an estimate $X_i$ of
# the true state $x_i$ from the observations $y_i$ and the inputs $u_i$, here with a mean error of
# {claim}`plan_knows`. The *plan* is a curve from
# $X_i$ through the next waypoints. The *MPC* finds the input that follows it. Neither plan nor MPC
# asks how sure the filter is: both treat $X_i$ as if it were the truth. This is called
# {term}`certainty equivalence`. For linear systems with quadratic costs and normally distributed
# noise nothing is lost by it {cite}`anderson1990`: the best controller is the best one for a known
# state, fed with the best estimate. This is the {term}`separation principle`. Our car is not
# linear, so here it is an approximation, and a good one.

# %% [markdown]
# ## Derived: what an error is made of
#
# The car is at the distance $t$ from the circle: positive outside, negative inside. (In this
# chapter $t$ is not the time.) Which block is the cause of it? Let us look at one step, in the
# order in which things happen.

# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 3.4))
ax.set(xlim=(-0.6, 10.4), ylim=(-0.9, 4.3))
ax.axis("off")
ax.axhline(0, color=plotting.ORANGE, lw=3, alpha=0.6, xmin=0.05, xmax=0.97)
sketches.word(ax, 7.6, -0.7, "the circle")
heights = [0.0, 1.4, 2.2, 3.8]
colors = [plotting.ORANGE, plotting.PURPLE, plotting.SKY]
letters = ["$c$: control", "$j$: jump", "$e$: estimation"]
places = [2.0, 4.3, 6.6]
for k, (i, color, letter) in enumerate(zip(places, colors, letters)):
    sketches.arrow(ax, (i, heights[k]), (i, heights[k + 1]), color, width=3)
    sketches.word(ax, i + 0.2, (heights[k] + heights[k + 1]) / 2 - 0.15, letter)
    ax.plot([i, i + 2.3], [heights[k + 1]] * 2, color="black", lw=0.8, ls=":")
sketches.arrow(ax, (9.4, 0), (9.4, 3.8), "black", width=3)
sketches.word(ax, 9.6, 1.8, "$t$")
ax.plot([8.9, 9.4], [3.8, 3.8], color="black", lw=0.8, ls=":")
points = [(1.4, 1.4, "where $u_i$ leads"), (3.7, 2.2, "$X_{i+1}$")]
points += [(6.0, 3.8, "$x_{i+1}$")]
for (i, j, text), marker in zip(points, "xso"):
    ax.plot(i + 0.6, j, marker, color="black", ms=8)
    sketches.word(ax, i - 0.1 if j > 2 else i - 1.0, j + 0.25, text)
plotting.show(
    fig,
    "Three arrows, one on top of the other: from the circle to where the input "
    "leads, from there to the estimate, and from there to the true place of the car.",
)

# %% tags=["claims"]
innovations = (along_plan.y - along_plan.estimate)[along_plan.running][:, :2]
claim("innovation_size", innovations.abs().mean(), above=0.05, unit="m")
claim("innovation_mean", innovations.mean(dim=0).abs().max(), below=0.015, unit="m")

# %% [markdown]
# 1. The MPC chooses $u_i$, knowing $X_i$. The input leads, as far as the car can know, to
#    $f(X_i, u_i)$. Let $c$ be the distance of this place from the circle. It is the only part that
#    plan and MPC can choose.
# 2. Meanwhile the filter takes in $y_i$. Its new estimate is not $f(X_i, u_i)$ but
#    $X_{i+1} = f(X_i + K \nu_i, u_i)$, where $\nu_i = y_i - X_i$ is the {term}`innovation`
#    (chapter 4's letter for it was $e$), and $K$ is the filter's gain. So the believed distance is
#    $c + j$, with a jump $j$ that nobody could know when $u_i$ was chosen.
# 3. The car is not where the filter believes it to be. Let $e$ be the difference between the true
#    distance and the believed one. Then
#
# $$ t = c + j + e $$ (eq-7-parts)
#
# Square it, and take the mean over all cars and steps:
#
# $$
# \begin{aligned}
# \overline{t^2} &= \overline{c^2} + \overline{j^2} + \overline{e^2} \\
# &\quad + 2\, (\overline{cj} + \overline{ce} + \overline{je})
# \end{aligned}
# $$ (eq-7-split)
#
# This is algebra and always holds. The products in the second line depend on the filter. If it is
# right, its estimate is the mean of the state, given all that it has seen. So whatever the filter
# has seen, $e$ is zero on average. But $c$ and $j$ are computed from what it has seen, so for each
# of their values $e$ is zero on average, and the means of $ce$ and $je$ are zero. This is the
# {term}`orthogonality principle`: the error of a best estimate is uncorrelated with everything that
# the estimate was made of {cite}`barshalom2001`. In the same way the innovation of $y_i$ is zero on
# average, whatever was seen before $y_i$. And $c$ was computed from what was seen before, so the
# mean of $cj$ is zero as well. (In our laps an innovation has a size of {claim}`innovation_size`,
# and all of them together a mean of {claim}`innovation_mean`.) What is left is
#
# $$ \overline{t^2} = \overline{c^2} + \overline{j^2} + \overline{e^2} $$ (eq-7-three)
#
# up to three cross terms that ought to be zero, and that we shall compute all the same. The car is
# not linear, 64 laps are a sample, and a filter may be wrong. <!-- given: 64 laps -->
#
# With this we know what each block can do. A better plan or controller can reduce
# $\overline{c^2}$, to zero if everything goes well. No plan and no controller can reduce
# $\overline{j^2} + \overline{e^2}$: that takes a better filter or sensor.

# %% [markdown]
# ## From scratch: the loop, and the split
#
# One car, and the paper's lines in the order of the block diagram: plan, MPC, filter, car.


# %%
Q = infinity.PROCESS_NOISE**2 * torch.eye(4)
R = sensor_noise**2 * torch.eye(4)
mpc = controller(price=0.001)

# %%


def loop(steps, P, guess=None, goal=1):
    """Returns where one car was, step by step."""
    generator = torch.Generator().manual_seed(0)
    x = [waypoints[0]]
    X = waypoints[0] + infinity.PRIOR * torch.randn(4, generator=generator)
    for i in range(steps):
        v = sensor_noise * torch.randn(4, generator=generator)
        y = car.observation(x[i], None) + v
        if (X - waypoints[goal])[:2].norm() <= 0.2:
            goal = goal + 1
        target = ahead(X, goal)
        inputs = mpc(dt, X, target, guess)[1]
        X, P = ekf(X, y, inputs[0], P, Q, R)
        w = infinity.PROCESS_NOISE * torch.randn(4, generator=generator)
        x.append(car.transition(x[i], inputs[0]) + w)
        guess = pp.shift(inputs)  # the warm start of the next plan
    return torch.stack(x)


# %% [markdown]
# The order of the lines matters: `target` and `inputs` are made from the estimate *before* the
# observation $y_i$ is used. The car decides first, and takes in what it saw while it moves.
#
# The split needs three distances. We compute each for both circles, and in the end take the circle
# that is nearer to the true place.


# %%
def radial(place):
    """Returns how far outside each of the circles a place is, (..., 2), in metres."""
    centres = torch.tensor([1.0, -1.0])
    return torch.hypot(place[..., :1] - centres, place[..., 1:2]) - 1


def parts(run):
    """Returns c, j and e of each car in each step, (cars, steps, 3), in metres."""
    led_to = car.transition(run.estimate[:, :-1], run.u[:, :-1])
    c = radial(led_to)
    believed = radial(run.estimate[:, 1:])
    t = radial(run.x[:, 1:-1])
    all_parts = torch.stack([c, believed - c, t - believed], dim=-2)  # (..., 3, 2)
    nearer = t.abs().argmin(dim=-1)[..., None, None]  # which circle: 0 or 1
    return all_parts.take_along_dim(nearer, dim=-1)[..., 0]


# %% [markdown]
# `infinity.drive`, with our `ahead` as its `aim`, is the same loop for a batch of cars:

# %%
alone = drive(ahead, price=0.001, cars=1)
same = loop(steps=20, P=infinity.PRIOR**2 * torch.eye(4))
print("largest difference:", (same - alone.x[0, :21]).abs().max().item())

# %% tags=["claims"]
claim("same_lap", (same - alone.x[0, :21]).abs().max(), below=1e-8)

# %% [markdown]
# ## The infinity, with everything in the loop
#
# How is a loop with a plan compared with one without? A car that drives more slowly always looks
# better, and one that need not come close to its waypoints may cut its corners. So all loops below
# count a waypoint as reached at 0.2 m, and take about as long for a lap. What sets the pace
# differs. Along a plan it is the spacing, 0.25 m a step. On the way to a waypoint it is the price
# of the inputs: with 0.02 the lap takes as long. Along a plan the price should be low. The plan
# already says how fast to go, and a price for speed only makes the car lag behind it.
# <!-- given: 0.2 m, 0.25 m, 0.02 -->
#
# The paper writes `points = pp.chspline(waypoints, interval=0.2)`, and does not say which points
# go in. Chapter 6's `ahead` uses the headings of the waypoints, which `chspline` does not take. So
# we try two readings of the paper as well. In the first one, the curve is made anew in every step,
# from the car through the next three places.


# %%
def states_along(curve, start=0.0):
    """Returns ten states on a curve, 0.25 m apart."""
    t = splines.parameter_at(curve, start + 0.25 * torch.arange(10))
    direction = splines.heading(curve(t, derivative=1), still=waypoints[16, 2:])
    return torch.cat([curve(t), direction], dim=-1)


def chspline_from_car(x, goal):
    number = (goal[..., None] + torch.arange(3)).clamp(max=16)
    places = torch.cat([x[..., None, :2], waypoints[number, :2]], dim=-2)
    return states_along(splines.hermite(places))  # the curve that chspline samples


# %% [markdown]
# In the second one, a single curve is made through all 17 places, before the lap begins, and the
# target is the part of it ahead of the point that is nearest to the car. (Its code is folded.)

# %% tags=["hide-input"]
whole = splines.hermite(waypoints[:, :2])
track = whole(splines.evenly_spaced(whole, 1248))  # a point a centimetre
a_piece = len(track) / 16


def chspline_once(x, goal):
    first = (a_piece * (goal - 1)).long() - 10  # just before the last waypoint
    window = first[..., None] + torch.arange(int(a_piece) + 20)  # to the next one
    window = window.clamp(0, len(track) - 1)
    away = (track[window] - x[..., None, :2]).norm(dim=-1)
    nearest = window.take_along_dim(away.argmin(-1, keepdim=True), -1)[..., 0]
    number = (nearest[..., None] + 25 * torch.arange(10)).clamp(max=len(track) - 2)
    place = track[number]
    way = track[number + 1] - place
    return torch.cat([place, way / way.norm(dim=-1, keepdim=True)], dim=-1)


runs = {"waypoints": to_waypoint}
runs["chspline once"] = drive(chspline_once, price=0.001)
runs["chspline from car"] = drive(chspline_from_car, price=0.001)
runs["headings"] = along_plan

# %% [markdown]
# The paper's Fig. 4 (b), and above it for comparison its Fig. 3 (b), which has a filter and no
# spline.

# %% tags=["hide-input"]
fig, panels = plotting.stacked(3, height=3.2)
shown = {"EKF, aims at waypoints": to_waypoint}
shown["EKF, chspline from the car"] = runs["chspline from car"]
shown["EKF, plan with headings"] = along_plan
for ax, (title, run) in zip(panels, shown.items()):
    plotting.plot_course(ax, title)
    ax.plot(*run.x[1:16].permute(2, 1, 0)[:2], color=plotting.GREY, lw=0.4)
    ax.lines[1].set_label("15 other cars")
    plotting.plot_states(ax, run.x[0, : run.steps[0] + 1], label="car")
legend = panels[0].get_legend_handles_labels()
fig.legend(*legend, loc="outside lower center", ncols=4)
plotting.show(
    fig,
    "Three maps of sixteen cars. Without a spline the paths are uneven. With "
    "chspline they lie inside the circles; with a plan they lie on them.",
)

# %% tags=["hide-input"]
fig, (top, bottom) = plotting.stacked(2, height=2.3, sharex=True)
for (title, run), style in zip(shown.items(), ["-", ":", "--"]):
    u = run.u[0, : run.steps[0]]
    time = dt * torch.arange(len(u))
    top.step(time, u[:, 0], style, where="post", label=title)
    bottom.step(time, u[:, 1], style, where="post", label=title)
top.set(ylabel="speed (m/s)")
bottom.set(ylabel="turn rate (rad/s)", xlabel="time (s)")
fig.legend(*top.get_legend_handles_labels(), loc="outside lower center", ncols=2)
plotting.show(
    fig,
    "Speed and turn rate of one car in three loops. Without a spline the speed "
    "jumps at each waypoint; with a plan it hardly changes.",
)


# %% [markdown]
# Now in numbers, over 64 cars. *Changes* are from one step to the next, as root mean squares.
# *Bends* is the mean squared curvature of the true path, $\int \kappa^2 ds / \int ds$, which is 1
# on the circles.


# %% tags=["hide-input"] mystnb={"markdown_format": "myst"}
def bending(run):
    """Mean squared curvature (1/m^2) of the true paths, weighted by length."""
    leg = run.x[..., :2].diff(dim=1)
    before, after = leg[:, :-1], leg[:, 1:]
    cross = before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0]
    angle = torch.atan2(cross, (before * after).sum(-1))[run.running[:, 1:]]
    length = (before.norm(dim=-1) + after.norm(dim=-1))[run.running[:, 1:]] / 2
    return (angle.square() / length).sum() / length.sum()


rows, means, changes, bends, laps = [], {}, {}, {}, {}
for name, run in runs.items():
    means[name] = distance(run)[run.running].mean()
    steps_between = run.u.diff(dim=1)[run.running[:, 1:]]
    changes[name] = steps_between.square().mean(dim=0).sqrt()
    bends[name] = bending(run)
    laps[name] = run.steps.double().mean()
    numbers = [means[name], *changes[name], bends[name]]
    text = " | ".join(f"{float(number):.3g}" for number in numbers)
    rows.append(f"{name} | {laps[name]:.1f} | {text}")
head = "loop | steps | distance (m) | speed changes (m/s) | turn rate changes (rad/s)"
display(table(f"{head} | bends (1/m²)", rows))

# %% tags=["claims"]
base, once, from_car, planned = runs
claim("slowest_lap", max(laps.values()) / laps[base], below=1.05)
claim("fastest_lap", min(laps.values()) / laps[base], above=0.93)
claim("speed_smoother", changes[base][0] / changes[planned][0], above=15)
claim("speed_smoother_chspline", changes[base][0] / changes[from_car][0], above=4)
claim("turn_smoother", changes[base][1] / changes[planned][1], above=2)
claim("turn_rougher_from_car", changes[from_car][1] / changes[base][1], above=1.1)
claim("turn_smoother_once", changes[base][1] / changes[once][1], above=1.5)
claim("bends_planned", bends[planned], equals=1, within=0.07, unit="1/m²")
claim("bends_waypoint", bends[base], above=1.06, unit="1/m²")
claim("closer", 100 * (1 - means[planned] / means[base]), above=7, unit="%")
claim("once_distance", means[once] / means[base], above=0.93, below=1.1)
claim("from_car_distance", means[from_car] / means[base], above=1.08)
claim("plan_distance", means[planned] / means[base], below=0.93)

# %% [markdown]
# "The inclusion of `chspline` noticeably smooths the trajectory and brings it closer to the desired
# path", says the paper.
#
# *Smooths* holds for the speed in each of the readings. It changes {claim}`speed_smoother` times
# less with the plan that has headings, and {claim}`speed_smoother_chspline` times less with
# `chspline` from the car. The paths bend {claim}`bends_planned`, hardly more than a circle, where
# the loop without a plan bends {claim}`bends_waypoint`.
#
# *Closer* depends on the construction. With headings the mean distance is {claim}`closer` smaller.
# With `chspline` through all places it is {claim}`once_distance` times that of the loop without a
# plan, and with `chspline` from the car {claim}`from_car_distance` times. That curve leaves the car
# towards the next waypoint, along the chord, in every step anew, and so its turn rate is rougher,
# too ({claim}`turn_rougher_from_car` times as much change). The paper may well have used another
# construction than these two. What we can say is that headings are enough to make its sentence
# true.

# %% [markdown]
# ## Who owes what?
#
# Why is the gain not larger, when the path looks so much better? The split {eq}`eq-7-three` answers
# it.
#
# **Predict.** In the loop along the plan, which part of $\overline{t^2}$ is the largest: control,
# jump or estimation?


# %% tags=["answer", "hide-input"]
def mean_squares(run):
    """Returns c2, j2, e2, t2 and the cross terms of a run, in cm²."""
    on = run.running[:, 1:].clone()
    on[:, :10] = False  # the first second remembers how the car began
    cje = 100 * parts(run)[on]
    squares = cje.square().mean(dim=0)
    total = cje.sum(dim=-1).square().mean()
    return torch.cat([squares, torch.stack([total, total - squares.sum()])])


strict = drive(None, price=0.01, tolerance=0.1)  # as chapter 4 drives
owed = {"waypoints, reached at 0.1 m": mean_squares(strict)}
owed["waypoints, reached at 0.2 m"] = mean_squares(to_waypoint)
owed["chspline from car"] = mean_squares(runs["chspline from car"])
owed["chspline once"] = mean_squares(runs["chspline once"])
owed["plan with headings"] = mean_squares(along_plan)
squares = torch.stack(list(owed.values()))
fig, ax = plt.subplots(figsize=(7, 3.4))
colors = [plotting.ORANGE, plotting.PURPLE, plotting.SKY]
letters = ["control, c²", "jump, j²", "estimation, e²"]
left = torch.zeros(len(owed))
for k, (letter, color) in enumerate(zip(letters, colors)):
    ax.barh(list(owed), squares[:, k], left=left, color=color, label=letter)
    left = left + squares[:, k]
ax.plot(squares[:, 3], list(owed), "D", color="black", ms=6, label="measured, t²")
ax.invert_yaxis()
ax.set(xlabel="mean squared distance from the circles (cm²)")
fig.legend(loc="outside lower center", ncols=4)
plotting.show(
    fig,
    "Bars for five loops, each in three parts. The part of estimation is the same in "
    "all, that of the jump is small, and that of control is smallest with a plan.",
)

# %% tags=["answer", "claims"]
plan_c2, plan_j2, plan_e2, plan_t2, plan_cross = owed["plan with headings"]
waypoint_c2 = owed["waypoints, reached at 0.2 m"][0]
claim("plan_c2", plan_c2, below=3, unit="cm²")
claim("plan_j2", plan_j2, above=0.6, below=1.2, unit="cm²")
claim("plan_e2", plan_e2, above=11, below=17, unit="cm²")
claim("waypoint_c2", waypoint_c2, above=8, unit="cm²")
claim("control_share", 100 * plan_c2 / plan_t2, below=20, unit="%")
claim("paid_back", 100 * (1 - plan_c2 / waypoint_c2), above=70, unit="%")
claim("tight_ratio", plan_t2 / squares[0, 3], below=0.9)
claim("plan_cross", plan_cross.abs(), below=2.5, unit="cm²")
crossed = (squares[:, 4] / squares[:, 3]).abs().max()
claim("adds_up", 100 * crossed, below=15, unit="%")

# %% [markdown] tags=["answer"]
# Estimation, by far: {claim}`plan_e2` of it, beside {claim}`plan_c2` for control and
# {claim}`plan_j2` for the jump. The plan has reduced the part of control from {claim}`waypoint_c2`
# to {claim}`plan_c2`, by {claim}`paid_back`. The first bar is the best that we found without a plan
# for this lap time, with a tolerance of 0.1 m; with the plan $\overline{t^2}$ is
# {claim}`tight_ratio` times as large. A still better plan or controller could remove at most the
# part of control, {claim}`control_share` of the squared error. The diamonds are the measured
# $\overline{t^2}$; they differ from the bars by the cross terms, at most {claim}`adds_up`.
# <!-- given: 0.1 m -->

# %% [markdown]
# Without the jump in the split, one would take the whole believed distance $c + j$ for a fault of
# the plan, and try to improve the plan further. But $\overline{j^2}$ cannot vanish as long as $y_i$
# is used one step late.
#
# The split also explains why so much better control looks like a small gain: a distance grows with
# the *root* of the sum, and the sum is mostly $\overline{e^2}$. Where the sensor is better, the
# same plan counts for more. We look at this next.

# %% [markdown]
# ## When does each part pay?
#
# A filter and a plan cost work and computing time. Here are four loops, with and without each of
# the two, for four sensors. Without a filter the car takes each observation for the truth.
#
# **Predict.** With a sensor of 0.02 m, which of the two brings the car closer: the filter, the
# plan, or both? <!-- given: 0.02 m -->

# %% tags=["answer", "hide-input"]
sensors = [0.02, 0.08, 0.163, 0.25]
names = ["neither", "plan alone", "filter alone", "filter and plan"]
kinds = [(None, 0.02, None), (ahead, 0.001, None)]
kinds += [(None, 0.02, ekf), (ahead, 0.001, ekf)]
found = torch.zeros(4, len(sensors))
arrived = torch.zeros(4, len(sensors))
for row, (aim, price, used) in enumerate(kinds):
    for column, noise in enumerate(sensors):
        lost = used is None and noise > 0.2  # few of these cars arrive; 16 will do
        run = drive(aim, price, used, noise, cars=16 if lost else 64)
        found[row, column] = 100 * distance(run)[run.running].mean()
        arrived[row, column] = run.finished.double().mean()
fig, ax = plt.subplots(figsize=(7, 3.6))
for row, (name, style) in enumerate(zip(names, ["v:", "s-.", "^--", "o-"])):
    all_there = arrived[row] == 1
    [line] = ax.plot(sensors, found[row], style, ms=6, label=name)
    ax.plot(
        [noise for noise, there in zip(sensors, all_there) if not there],
        found[row][~all_there],
        line.get_marker(),
        ms=6,
        mfc="white",
        mec=line.get_color(),
    )
ax.set(xlabel="noise of the sensor (m)", ylabel="mean distance (cm)", ylim=(0, None))
ax.legend(loc="upper left", title="hollow: not all cars arrive")
plotting.show(
    fig,
    "Mean distance against the noise of the sensor, for four loops. With a good "
    "sensor the plan lowers it and the filter does not; with a bad one both do.",
)

# %% tags=["answer", "claims"]
neither, plan_alone, filter_alone, both_parts = found
claim("good_plan", 100 * (1 - plan_alone[0] / neither[0]), above=15, unit="%")
claim("good_filter", filter_alone[0] / neither[0], above=0.9, below=1.15)
claim("usual_filter", 100 * (1 - filter_alone[2] / neither[2]), above=35, unit="%")
usual_plan = 1 - both_parts[2] / filter_alone[2]
claim("usual_plan", 100 * usual_plan, above=6, below=22, unit="%")
claim("bad_plan", 100 * (1 - both_parts[3] / filter_alone[3]), below=14, unit="%")
claim("noise_into_plan", plan_alone[2] / neither[2], above=1.05)
claim("neither_arrived", 100 * arrived[0, 3], below=40, unit="%")
claim("filter_arrived", 100 * arrived[2:].min(), equals=100, unit="%")

# %% [markdown] tags=["answer"]
# The plan. With the best of these sensors it reduces the mean distance by {claim}`good_plan`, while
# the filter leaves it at {claim}`good_filter` times its value. With the book's sensor it is the
# other way around: the filter reduces it by {claim}`usual_filter`, and a plan on top of it by
# {claim}`usual_plan`; with the worst sensor that is {claim}`bad_plan`. And without a filter a plan
# does *harm* there, {claim}`noise_into_plan` times the distance: the curve begins exactly where the
# sensor says, in exactly the direction that it says, and both are noise.

# %% [markdown]
# Two more settings decide: how close the car has to come to a waypoint (the tolerance), and how far
# the MPC looks ahead (the horizon). Without a plan, prices of 0.01, 0.02 and 0.03 give the three
# tolerances about the same lap time. <!-- given: 0.01, 0.02, 0.03 -->

# %% tags=["hide-input"] mystnb={"markdown_format": "myst"}
settings = {"tolerance 0.1 m": (0.01, {"tolerance": 0.1})}
settings["the usual ones"] = 0.02, {}
settings["tolerance 0.3 m"] = 0.03, {"tolerance": 0.3}
settings["horizon 5 steps"] = 0.02, {"horizon": 5}
settings["horizon 3 steps"] = 0.02, {"horizon": 3}
pairs = {"the usual ones": (to_waypoint, along_plan)}
rows = []
for name, (price, how) in settings.items():
    plan = partial(ahead, count=how.get("horizon", 10))
    if name not in pairs:
        without = drive(None, price, cars=32, **how)
        pairs[name] = without, drive(plan, 0.001, cars=32, **how)
    line = [name]
    for run in pairs[name]:
        mean = 100 * distance(run)[run.running].mean()
        line += [f"{mean:.2f}", f"{run.finished.sum()} of {len(run.finished)}"]
    rows.append(" | ".join(line))
head = "setting | to the waypoint (cm) | arrive | along the plan (cm) | arrive"
display(table(head, rows))

# %% tags=["claims"]
tight = [run.finished.sum() for run in pairs["tolerance 0.1 m"]]
claim("tight_waypoint_arrives", tight[0], above=29)
claim("tight_plan_arrives", tight[1], below=12)
loose = [distance(run)[run.running].mean() for run in pairs["tolerance 0.3 m"]]
claim("loose_gain", 100 * (1 - loose[1] / loose[0]), above=4, unit="%")
laps_without = [pair[0].steps.double().mean() for pair in list(pairs.values())[:4]]
claim("longest_without", max(laps_without), below=50)
claim("shortest_without", min(laps_without), above=44)
short = [run.finished.sum() for run in pairs["horizon 3 steps"]]
claim("short_waypoint_arrives", short[0], equals=0)
claim("short_plan_arrives", short[1], above=30)

# %% [markdown]
# With a *tight* tolerance the plan fails: {claim}`tight_plan_arrives` of 32 cars arrive. The plan
# asks for 0.25 m a step and steps over the waypoint; a car that aims at the point homes in on it.
# With a *loose* tolerance the car without a plan cuts its corners, and the plan reduces the
# distance by {claim}`loose_gain`. (The laps of cars that arrive without a plan take from
# {claim}`shortest_without` to {claim}`longest_without` steps.) With a *short* horizon a car that
# aims at waypoints parks, as in chapter 3, and {claim}`short_waypoint_arrives` arrive; along a
# plan, which always has a next state close by, {claim}`short_plan_arrives` do.
# <!-- given: 0.25 m -->
#
# | If you have ... | then ... |
# |:--|:--|
# | a good sensor | plan: control is the largest part |
# | a bad sensor | filter first; a plan without one does harm |
# | a filter, a bad sensor, a plan | look for a better sensor: what is left is $e$ |
# | waypoints that must be hit exactly | aim at them, or let the plan end there |
# | little time for planning | plan: a short horizon and few sweeps suffice |
#
# Move the slider to see a lap of one car with each sensor.


# %% tags=["hide-input"]
def two_maps(noise):
    fig, panels = plotting.stacked(2, height=3)
    loops = [("filter, to the waypoint", None, 0.02)]
    loops += [("filter and plan", ahead, 0.001)]
    for ax, (title, aim, price) in zip(panels, loops):
        run = drive(aim, price, noise=noise, cars=8, sweeps=2)
        mean = 100 * distance(run)[run.running].mean()
        plotting.plot_course(ax, f"{title}: {mean:.1f} cm (mean of 8 cars)")
        plotting.plot_states(ax, run.x[0, : run.steps[0] + 1], label="car")
    legend = ax.get_legend_handles_labels()
    fig.legend(*legend, loc="outside lower center", ncols=3)
    return fig


alt = "Two maps of a car with a filter, without and with a plan."
amounts = [0.02, 0.08, 0.163, 0.3]
display(widgets.panels(two_maps, amounts, "sensor noise (m)", alt=alt))

# %% tags=["remove-cell"]
amount = ipywidgets.FloatSlider(0.16, min=0.02, max=0.4, step=0.02)
amount.description = "sensor noise (m)"
widgets.live(two_maps, alt="Two maps for the chosen noise.", noise=amount)

# %% [markdown]
# ### What does it cost to compute?
#
# "The dense waypoints could decrease the computing cost of MPC and overshoot probability", says the
# paper. A plan changes little from step to step, and so the last solution is a good first guess. We
# allow each loop a single sweep in each step instead of three, and count how often a car is more
# than 0.1 m from the circles. <!-- given: 0.1 m -->

# %%
quick_waypoint = drive(None, price=0.02, sweeps=1)
quick_plan = drive(ahead, price=0.001, sweeps=1)

# %% tags=["claims"]
quick_mean = distance(quick_waypoint)[quick_waypoint.running].mean()
claim("one_sweep_waypoint", quick_mean / filter_mean, above=1.15)
quick_plan_mean = distance(quick_plan)[quick_plan.running].mean()
claim("one_sweep_plan", quick_plan_mean / plan_mean, below=1.12)
claim("one_sweep_arrive", quick_plan.finished.sum(), equals=64)
far = distance(to_waypoint)[to_waypoint.running] > 0.1
far_along_plan = distance(along_plan)[along_plan.running] > 0.1
overshoot = far_along_plan.double().mean() / far.double().mean()
claim("overshoot", overshoot, below=0.7)

# %% [markdown]
# With one sweep the loop without a plan strays {claim}`one_sweep_waypoint` times as far as with
# three, the loop with a plan {claim}`one_sweep_plan` times. So the MPC can indeed be cheaper. (The
# plan itself takes time, too.) And the car is that far away {claim}`overshoot` times as often.

# %% [markdown]
# ### How far ahead, and how often?
#
# (You may skip this part.) Our plan reaches as far as the MPC looks, and is made anew in each step.
# Here are two that do less. One ends at the next waypoint. The other one is kept for twelve steps,
# and the car, which may drive at most at 2 m/s here, meets it at two paces: 2.5 m/s and 1.8 m/s.
# <!-- given: twelve steps, 2 m, 2.5 m, 1.8 m -->

# %% tags=["hide-input"] mystnb={"markdown_format": "myst"}
most = torch.tensor([2.0, 4.0])  # m/s and rad/s


def to_next_only(x, goal):
    return pp.local_plan(x, waypoints[goal][..., None, :], 0, spacing=0.25, count=10)


def kept_for_twelve(spacing):
    plans = []

    def aim(x, goal):
        i = len(plans) % 12
        new = pp.local_plan(x, waypoints, goal, spacing, count=22)
        plans.append(plans[-1] if i else new)
        return plans[-1][..., i : i + 10, :]

    return aim


def limited(spacing):
    generator = torch.Generator().manual_seed(0)
    start = waypoints[0].expand(32, 4)
    noise = infinity.PROCESS_NOISE, sensor_noise
    world = infinity.SimulatedCar(car, start, *noise, generator)
    aim = kept_for_twelve(spacing)
    how = {"u_lower": -4.0, "u_upper": most, "steps": 30}
    return infinity.drive(controller(0.001), world, ekf, aim, 0.2, **how)


tried = {"the chapter's plan": along_plan}
tried["to the next waypoint"] = drive(to_next_only, 0.001)
tried["kept, at 2.5 m/s"] = limited(0.25)
tried["kept, at 1.8 m/s"] = limited(0.18)
figures = {}
for name, run in tried.items():
    between = run.u[..., 0].diff(dim=1)[run.running[:, 1:]]
    figures[name] = distance(run)[run.running].mean(), between.square().mean().sqrt()
rows = [f"{name} | {a:.3f} | {b:.3f}" for name, (a, b) in figures.items()]
display(table("plan | distance (m) | speed changes (m/s)", rows))

# %% tags=["claims"]
ours, next_only, kept_fast, kept_slow = figures.values()
claim("next_only_distance", next_only[0] / ours[0], above=0.8, below=1.4)
claim("next_only_speed", next_only[1] / ours[1], above=2)
claim("kept_fast_distance", kept_fast[0], above=0.08, unit="m")
claim("kept_slow_distance", kept_slow[0], below=0.06, unit="m")

# %% [markdown]
# The short plan does not show on the map: its distance is {claim}`next_only_distance` times ours.
# But the speed changes {claim}`next_only_speed` times as much, since the car slows down whenever
# the end of the plan comes into the MPC's sight. A plan should reach further than the horizon. The
# kept plan fails at a pace that the car cannot drive: it runs away, and the car takes a short cut
# after it ({claim}`kept_fast_distance`). At a pace that it can drive, a plan that is twelve steps
# old is good enough ({claim}`kept_slow_distance`). These waypoints stand still. Where they move, or
# something else does, one has to plan more often. <!-- given: twelve steps -->

# %% [markdown]
# ## How we know: the same noise for both
#
# The plan with headings reduces the mean distance by a few millimetres. Single cars differ by more
# than that. Could it be luck? Each car met the same noise in both loops. This is called
# {term}`common random numbers`, and allows us to compare car by car, a *paired comparison*. How far
# may the mean of 64 differences be off by chance? Its standard deviation is that of one difference,
# divided by $\sqrt{64}$, and 95 % of a Gaussian lie within 1.96 standard deviations of its mean.
# <!-- given: 64 differences, 95 %, 1.96 -->


# %%
def mean_of_each_car(run):
    """Returns the mean distance of each car from the circles, in cm."""
    total = (distance(run) * run.running).sum(dim=1)
    return 100 * total / run.steps


per_car = mean_of_each_car(to_waypoint), mean_of_each_car(along_plan)

# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 4))
ax.plot(*per_car, "o", ms=5, label="a car")
ends = torch.tensor([1.5, 6.5])
ax.plot(ends, ends, color="black", lw=1, ls=":", label="no difference")
ax.set(xlabel="mean distance to the waypoint (cm)", ylabel="along the plan (cm)")
ax.set(aspect="equal", xlim=(1.5, 6.5), ylim=(1.5, 6.5))
ax.legend(loc="upper left")
plotting.show(
    fig,
    "A dot for each of the 64 cars: its mean distance in the two loops. Most dots "
    "lie below the diagonal, where the plan is better.",
)

# %%
difference = per_car[0] - per_car[1]  # cm, of each car
mean_difference = difference.mean()
half_width = 1.96 * difference.std() / 64**0.5
print(f"{mean_difference:.2f} cm, plus or minus {half_width:.2f} cm")

# %% tags=["claims"]
claim("mean_difference", mean_difference, above=0.2, unit="cm")
claim("half_width", half_width, below=0.25, unit="cm")
claim("surely_closer", mean_difference - half_width, above=0, unit="cm")
apart = 1.96 * (per_car[0].var() / 64 + per_car[1].var() / 64).sqrt()
claim("unpaired_width", apart / half_width, above=1.1)
claim("plan_wins", (difference > 0).sum(), above=38)

# %% [markdown]
# The difference is {claim}`mean_difference` on average, with a 95 % {term}`confidence interval` of
# $\pm$ {claim}`half_width`, which does not contain zero. {claim}`plan_wins` of the 64 cars are
# better off with the plan. With other noise for each loop the interval would be
# {claim}`unpaired_width` times as wide.
#
# And the filter? The split assumed that it is right. Its NEES in this loop tests that. So do the
# cross terms: if $e$ were correlated with what the filter believes, {eq}`eq-7-three` would not add
# up.

# %%
truth = along_plan.x[:, :-1]
nees = filters.nees(along_plan.estimate, along_plan.P, truth)
nees_of_a_car = (nees * along_plan.running).sum(dim=1) / along_plan.steps
nees_mean = nees_of_a_car.mean()
nees_half = 1.96 * nees_of_a_car.std() / 64**0.5
print(f"NEES: {nees_mean:.2f}, plus or minus {nees_half:.2f}; 4 is right")

# %% tags=["claims"]
claim("nees", nees_mean, equals=4, within=0.6)
ideal = drive(ahead, price=0.001, filter=None, noise=0.0)
claim("ideal_plan", distance(ideal)[ideal.running].mean(), below=0.014, unit="m")
old_price = drive(ahead, price=0.01)
old_c2 = mean_squares(old_price)
claim("old_price_c2", old_c2[0], above=15, unit="cm²")
claim("old_price_e2", old_c2[2] / plan_e2, above=0.8, below=1.2)

# %% [markdown]
# NEES is {claim}`nees`, where 4 is right. With its true state the car along the plan is
# {claim}`ideal_plan` from the circles, so the plan and the controller are right, too.
#
# The split is also a tool to find a fault. Suppose somebody puts the plan into the loop and keeps
# chapter 3's price of 0.01. On the map one sees a car that strays. The split says where to look:
# the part of control is {claim}`old_price_c2` instead of {claim}`plan_c2`, and that of estimation
# {claim}`old_price_e2` times the usual. The filter is not to blame. <!-- given: 0.01 -->

# %% [markdown]
# ## Summary
#
# 1. Filter, plan and MPC form a loop of twenty lines. Plan and MPC treat the estimate as if it were
#    the truth: certainty equivalence.
# 2. An error has three parts, control, jump and estimation, whose mean squares add up to the whole,
#    within {claim}`adds_up`. Only the first one, {claim}`control_share` here, is left to plan and
#    control.
# 3. At equal tolerance and lap time the plan with headings changes the speed
#    {claim}`speed_smoother` times less and reduces the mean distance by {claim}`closer`; a
#    `chspline` without headings makes it {claim}`once_distance` or {claim}`from_car_distance` times
#    what it was.
# 4. A good sensor calls for a plan ({claim}`good_plan`), a bad one for a filter
#    ({claim}`usual_filter`); a plan made from raw observations does harm.
# 5. Compare loops on the same noise and give the interval: {claim}`mean_difference` $\pm$
#    {claim}`half_width`.
#
# | the paper says of Fig. 4 (b), without numbers | `chspline`, two readings | plan with headings |
# |:--|:--|:--|
# | "smooths": speed changes less, by | {claim}`speed_smoother_chspline` | {claim}`speed_smoother` |
# | "closer": distance in units of EKF alone | {claim}`once_distance` | {claim}`plan_distance` |
# | "closer", the other reading | {claim}`from_car_distance` | |
# | "overshoot probability", likewise | | {claim}`overshoot` |
# | "computing cost": distance with one sweep, in units of three | | {claim}`one_sweep_plan` |
#
# **What differs from PyPose.** `chspline`, `EKF` and `MPC` have the same names there. In PyPose
# 0.9.5 no planner knows headings, the third argument of an MPC's call is not a target, its bounds
# are not used, and an EKF takes one state at a time.
#
# **Words of this chapter.** {term}`Certainty equivalence`, {term}`separation principle`,
# {term}`innovation`, {term}`orthogonality principle`, {term}`common random numbers`,
# {term}`confidence interval`.
#
# **Further reading.** Anderson and Moore {cite}`anderson1990`, chapter 8, on the separation of
# estimation and control; Bar-Shalom, Li and Kirubarajan {cite}`barshalom2001` on the errors of
# estimators; Law {cite}`law2015`, chapter 11, on common random numbers.
#
# **In [the lab](../exercises/07_all_together.py)** you compare two loops and say how many laps that
# takes, split an error, find the faulty block of a loop from its log, tune a loop at equal lap
# time, send a gradient once around all of it, walk the simulated Go1, and spend a budget where it
# pays.
