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
# # Lab 7: All together
#
# This lab belongs to [chapter 7](../book/07_all_together.py). You compare two loops and say how
# many laps that takes, take an error apart, find the faulty block of a loop from its log, tune a
# loop at equal lap time, send a gradient once around all of it, walk the simulated Go1, and spend a
# budget where it pays. Each exercise says how long it takes, has three hints to open one after the
# other, and ends in a check. All of them together take about 115 minutes.
# <!-- given: 115 minutes -->

# %% tags=["setup"]
import math

import matplotlib.pyplot as plt
import torch

import pypose_lite as pp
from pypose_lite import filters, go1, infinity
from pypose_lite.teaching import check, plotting, progress
from pypose_lite.teaching.checks.chapter_07_logs import faulty_logs, loop_log

plotting.use_style()
torch.set_default_dtype(torch.float64)

# %% [markdown]
# The car, the plan and the loop are those of the chapter. `distance` is how far each car is from
# the circles in each step, in metres.

# %%
dt = 0.1  # s
car = pp.DubinsCar(dt)
ekf = pp.module.EKF(car)
waypoints = infinity.waypoints()
sensor_noise = infinity.OBSERVATION_NOISE


def ahead(x, goal, spacing=0.25):
    return pp.local_plan(x, waypoints, goal, spacing, count=10)


# %%
def drive(aim, price, filter=ekf, noise=sensor_noise, tolerance=0.2, cars=32):
    weights = torch.tensor([1, 1, 0.3, 0.3, price, price])
    mpc = pp.MPC(car, weights.diag(), None, 10, pp.utils.ReduceToBason(steps=2))
    generator = torch.Generator().manual_seed(0)
    start = waypoints[0].expand(cars, 4)
    disturbed = infinity.PROCESS_NOISE
    world = infinity.SimulatedCar(car, start, disturbed, noise, generator)
    return infinity.drive(mpc, world, filter, aim, tolerance, steps=70)


def distance(run):
    return infinity.tracking_error(run.x[:, :-1])


# %% [markdown]
# ## Exercise 7.1: A paired comparison
#
# *10 minutes. Warm-up.*
#
# Two loops were driven with the same noise, so that lap $k$ of one belongs to lap $k$ of the other.
# `a` and `b` are the mean distances of each lap, both $(n)$. Write the function that returns the
# mean of $a - b$ and half the width of its 95 % confidence interval: 1.96 standard errors, where
# the standard error is the standard deviation of the differences (with $n - 1$) over $\sqrt n$.
# <!-- given: 1.96 -->
#
# :::{dropdown} Hint 1
# First make one number of each pair. Everything else is done with these numbers.
# :::
#
# :::{dropdown} Hint 2
# `tensor.std()` divides by $n - 1$, as it should here.
# :::
#
# :::{dropdown} Hint 3
# `1.96 * d.std() / len(d) ** 0.5`, where `d` are the differences.
# :::


# %%
def paired_interval(a, b):
    """Returns the mean of a - b, and half the width of its 95 % interval."""
    ### BEGIN SOLUTION
    differences = a - b
    half_width = 1.96 * differences.std() / len(differences) ** 0.5
    return differences.mean(), half_width
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# What the two laps of a pair have in common, such as a first estimate that is far off, disappears
# in the difference. If the interval contains zero, the laps do not show which loop is better. The
# factor 1.96 belongs to the normal distribution, which a mean of many numbers follows; for fewer
# than twenty laps Student's $t$ would give a somewhat wider interval.
# <!-- given: 1.96, twenty laps -->

# %%
check("7.1", paired_interval)

# %% [markdown]
# ## Exercise 7.2: How many laps are enough?
#
# *5 minutes. Warm-up.*
#
# A few laps were driven, and `differences` are those of their pairs. Before you drive more: how
# many laps are needed until half the width of the interval is at most `half_width`? Return the
# smallest such number, an integer.
#
# :::{dropdown} Hint 1
# The standard deviation of the differences hardly changes when more laps are driven. Only $n$ does.
# :::
#
# :::{dropdown} Hint 2
# Solve $1.96\, s / \sqrt n \le h$ for $n$.
# :::
#
# :::{dropdown} Hint 3
# `math.ceil` rounds up.
# :::


# %%
def laps_needed(differences, half_width):
    """Returns how many laps make half the interval at most half_width wide."""
    ### BEGIN SOLUTION
    return math.ceil((1.96 * differences.std() / half_width) ** 2)
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# For half the width one needs four times as many laps. This is why one drives a few laps first,
# looks at their spread, and then decides.

# %%
check("7.2", laps_needed)

# %% [markdown]
# ## Exercise 7.3: Take an error apart
#
# *15 minutes. From the derivation to code.*
#
# One car drove on the right circle, with its centre at (1, 0) and a radius of 1 m. `x` are its true
# states $x_0, \dots, x_N$, `X` the estimates $X_0, \dots, X_N$, both $(N+1, 4)$, and `u` the
# inputs, $(N, 2)$. Write the function that returns four numbers for the states $1$ to $N$: the mean
# squares of control, jump and estimation, $\overline{c^2}$, $\overline{j^2}$, $\overline{e^2}$, and
# what the cross terms add to them, $2\, (\overline{cj} + \overline{ce} + \overline{je})$.
#
# `car.transition(x, u)` makes a step, also for a batch. Distances are positive outside the circle
# and negative inside.
#
# :::{dropdown} Hint 1
# Three places belong to one step: $f(X_i, u_i)$, $X_{i+1}$ and $x_{i+1}$. Compute the distance of
# each from the circle; the parts are differences of these.
# :::
#
# :::{dropdown} Hint 2
# `torch.hypot(place[:, 0] - 1, place[:, 1]) - 1` is the distance. `X[:-1]` are the estimates from
# which a step begins, `X[1:]` those in which one ends.
# :::
#
# :::{dropdown} Hint 3
# The cross terms are the mean square of $c + j + e$, less the other three numbers.
# :::


# %%
def split(x, X, u):
    """Returns the mean squares of c, j and e, and the sum of the cross terms."""

    ### BEGIN SOLUTION
    def outside(place):
        return torch.hypot(place[:, 0] - 1, place[:, 1]) - 1

    c = outside(car.transition(X[:-1], u))
    j = outside(X[1:]) - c
    e = outside(x[1:]) - outside(X[1:])
    cross = 2 * (c * j + c * e + j * e).mean()
    return c.square().mean(), j.square().mean(), e.square().mean(), cross
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# The four numbers add up to the mean square of the true distance, whatever the filter does: this is
# algebra. That the fourth one is small is a statement about the filter. With the wrong index, $X_i$
# instead of $X_{i+1}$, the sum is still right and the parts are not: a test of the sum alone would
# not notice.

# %%
check("7.3", split)

# %% [markdown]
# ## Exercise 7.4: Which block is at fault?
#
# *20 minutes. A fault, to be found from a log.*
#
# Four loops of 32 cars were recorded, with a sensor of 0.1 m. In each of them one block is at
# fault: the plan, the MPC, the filter or the sensor, a different one in each log. All four stray
# more than `healthy`, in which everything is right. Find out which is which. A log has the true
# states `x` $(32, N+1, 4)$, the estimates `X` $(32, N, 4)$ and their covariances `P`, the
# observations `y`, the inputs `u`, and in `target` $(32, N, 10, 4)$ the plan that the MPC was given
# in each step. <!-- given: 0.1 m -->

# %%
logs = faulty_logs()
healthy = loop_log()

# %% tags=["hide-input"]
fig, axes = plotting.stacked(4, height=3)
for ax, (letter, log) in zip(axes, logs.items()):
    plotting.plot_course(ax, f"log {letter}")
    plotting.plot_states(ax, log.x[0], label="car")
fig.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
plotting.show(fig, "Four maps of cars that stray from the circles, each in its way.")

# %% [markdown]
# Give the block of each log in a dictionary, `{"a": "plan", "b": "MPC", ...}`, with the words
# `"plan"`, `"MPC"`, `"filter"` and `"sensor"`.
#
# :::{dropdown} Hint 1
# Ask one block after the other whether it does what it should, given what the others hand it. Do
# the targets lie on the circles? Does the car get to its target? Is $X - x$ zero on average? Is it
# as large as $P$ says?
# :::
#
# :::{dropdown} Hint 2
# `infinity.tracking_error(log.target)` is the distance of the targets from the circles,
# `(log.X - log.x[:, :-1]).mean(dim=(0, 1))` the mean error, and
# `filters.nees(log.X, log.P, log.x[:, :-1]).mean()` the NEES, which should be 4.
# :::
#
# :::{dropdown} Hint 3
# Two logs have a NEES that is far too large. In one of them the mean error is not zero: something
# is displaced. In the other one the estimates only scatter more than the filter admits.
# :::

# %%
### BEGIN SOLUTION
for letter, log in {"healthy": healthy, **logs}.items():
    off_circle = infinity.tracking_error(log.target[:, 10:, 3:]).mean()
    error = (log.X - log.x[:, :-1])[:, 10:].mean(dim=(0, 1))
    nees = filters.nees(log.X, log.P, log.x[:, :-1])[:, 10:].mean()
    print(f"{letter}: targets off {off_circle:.3f} m, ", end="")
    print(f"mean error {error[0]:.3f} m, {error[1]:.3f} m, NEES {nees:.1f}")
answer_74 = {"a": "MPC", "b": "sensor", "c": "plan", "d": "filter"}
### END SOLUTION

# %% [markdown] tags=["solution"]
# In log (c) the targets are off the circles: the map of the planner is too small. In (b) the mean
# error is large along $i$, and zero along $j$: the sensor is mounted in the wrong place. In (d)
# errors are zero on average, but NEES is far above 4: the filter believes in a sensor that is
# better than it is, and follows its noise. In (a) all of this is in order, and yet the car strays:
# the MPC has a price of the inputs that lets it lag behind its targets. A map alone shows that
# something is wrong, and not what. On a robot, where the truth is not known, (d) would show in the
# NIS, and (b) in nothing that this sensor says: only a second sensor can tell.

# %%
check("7.4", answer_74)

# %% [markdown]
# ## Exercise 7.5: Faster, and as close
#
# *15 minutes. Design, at equal lap time.*
#
# The car gets a better sensor, of 0.05 m, and shall be faster: 40 steps for a lap on average, with
# a tolerance of 0.3 m. Choose the spacing of the plan (m) and the price of the inputs so that all
# of 32 cars arrive in time and are within 0.028 m of the circles on average. The check uses noise
# that you have not seen. <!-- given: 0.05 m, 40 steps, 0.3 m, 0.028 m -->
#
# :::{dropdown} Hint 1
# `drive(lambda x, goal: ahead(x, goal, spacing), price, noise=0.05, tolerance=0.3)` drives them;
# `run.steps.double().mean()` are the steps, `distance(run)[run.running].mean()` is the distance.
# :::
#
# :::{dropdown} Hint 2
# A lap is $4 \pi$ m long. Which spacing takes 40 steps, and which one takes fewer than needed?
# :::
#
# :::{dropdown} Hint 3
# With the right pace, lower the price until the distance falls no more.
# :::

# %%
### BEGIN SOLUTION
spacing = 0.3
price = 0.0005
### END SOLUTION

# %% [markdown] tags=["solution"]
# The spacing is set by the lap time, with a little to spare; each centimetre more costs accuracy. A
# low price costs nothing here: the model is right, so the MPC may use the inputs freely.
# Exercise 7.7 shows a car whose model is not right.

# %%
check("7.5", (spacing, price))

# %% [markdown]
# ## Exercise 7.6: A gradient around the loop
#
# *25 minutes. Differentiate through it.*
#
# The estimate depends on the input, the plan on the estimate, the input on the plan and on the
# price, and the next state on the input. All of it is differentiable. Write `loss(log_price)`, the
# root mean square of the distances from the circles when 8 cars drive 12 steps along the plan
# `ahead`, with a price of $\exp$ of `log_price`, a scalar tensor. The gradient has to go through
# all of it.
#
# So that everybody gets the same number: 8 cars at `waypoints[0]`, the book's two noises, a
# generator with the seed 0, the EKF, a tolerance of 0.3 m, an MPC with horizon 10 and no stepper
# (its plans have to converge), and all states `run.x`. <!-- given: 0.3 m, 12 steps -->
#
# :::{dropdown} Hint 1
# It is `drive` from above with three changes. The first: `torch.tensor([1, ..., price])` makes a
# new tensor that knows nothing of `log_price`.
# :::
#
# :::{dropdown} Hint 2
# `torch.cat([torch.tensor([1, 1, 0.3, 0.3]), price.expand(2)])` keeps the graph, and so does
# `.diag()`.
# :::
#
# :::{dropdown} Hint 3
# `infinity.tracking_error(run.x).square().mean().sqrt()`, with
# `infinity.drive(mpc, world, ekf, ahead, 0.3, steps=12)`.
# :::


# %%
def loss(log_price):
    """Returns the root mean square of the distances, with a gradient."""
    ### BEGIN SOLUTION
    price = log_price.exp()
    weights = torch.cat([torch.tensor([1, 1, 0.3, 0.3]), price.expand(2)])
    mpc = pp.MPC(car, weights.diag(), None, 10)
    generator = torch.Generator().manual_seed(0)
    start = waypoints[0].expand(8, 4)
    noise = infinity.PROCESS_NOISE, sensor_noise
    world = infinity.SimulatedCar(car, start, *noise, generator)
    run = infinity.drive(mpc, world, ekf, ahead, 0.3, steps=12)
    return infinity.tracking_error(run.x).square().mean().sqrt()
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# At chapter 3's price, 0.01, the slope is positive: a lower price brings the car closer, as the
# chapter found by trying. The gradient does not see everything. A waypoint counts as reached in one
# step or in the next, and over this jump no gradient leads. With the same noise and a small change
# of the price nothing jumps. Chapter 8 learns in this way. The cell below goes one step downhill.
# <!-- given: 0.01 -->

# %% tags=["solution"]
log_price = torch.tensor(0.01).log().requires_grad_()
before = loss(log_price)
(slope,) = torch.autograd.grad(before, log_price)
after = loss(log_price.detach() - 30 * slope)
print(f"slope {slope:.3f} m; loss before and after: {before:.4f} m, {after:.4f} m")

# %%
check("7.6", loss)

# %% [markdown]
# ## Exercise 7.7: The dog's legs answer late
#
# *15 minutes. On the robot, simulated.*
#
# The Go1 takes the place of the car, with filter and plan. Its trot reaches 1.2 m/s and 1.5 rad/s,
# and its legs reach a new speed only some time after they are told to; the MPC knows the limits and
# not the delay. Choose the spacing of the plan (m) and the price of the inputs, so that the dog
# finishes within 13 s and is less than 0.03 m from the path on average, as it says itself.
# <!-- given: 1.2 m, 1.5 rad, 13 s, 0.03 m -->
#
# :::{dropdown} Hint 1
# A lap of $4 \pi$ m in 13 s: how many metres is that in a step of 0.1 s?
# :::
#
# :::{dropdown} Hint 2
# At the limit of its speed the dog has nothing left to catch up with. Do not choose more than the
# lap time asks for.
# :::
#
# :::{dropdown} Hint 3
# With a low price the MPC answers each deviation at once, and strongly. What does that do when the
# legs answer late? Try higher prices.
# :::

# %%
### BEGIN SOLUTION
dog_spacing = 0.1
dog_price = 0.01
### END SOLUTION

# %% [markdown] tags=["solution"]
# Here a *higher* price is better, other than for the car. An MPC to which inputs are cheap corrects
# in one step what it sees. The legs carry the correction out when the next one has already been
# sent, and the dog swings to the other side. A price on the inputs makes the loop slower and so
# more robust against a delay that the model does not have. Chapter 9 puts the legs into the model
# instead.

# %%
check("7.7", (dog_spacing, dog_price))

# %% tags=["hide-input"]
weights = torch.tensor([1, 1, 0.3, 0.3, dog_price, dog_price])
mpc = pp.MPC(car, weights.diag(), None, 10, pp.utils.ReduceToBason(steps=2))
trot = torch.tensor([1.2, 1.5])
believed = {"process_noise": 0.02, "observation_noise": 0.02}
believed["generator"] = torch.Generator().manual_seed(0)
with go1.connect("sim", start=(0.0, 0.0, -math.pi / 2)) as robot:
    world = infinity.RealRobot(robot, dt, **believed)
    bounds = {"u_lower": -trot, "u_upper": trot}

    def dog_plan(x, goal):
        return ahead(x, goal, dog_spacing)

    walk = infinity.drive(mpc, world, ekf, dog_plan, tolerance=0.3, **bounds)
fig, ax = plt.subplots(figsize=(7, 4.3))
plotting.plot_course(ax)
plotting.plot_states(ax, walk.x, label="the dog, as it says")
fig.legend(loc="outside lower center", ncols=3)
plotting.show(fig, "The way of the simulated dog around the infinity sign.")

# %% [markdown]
# ## Exercise 7.8: Ten points to spend
#
# *10 minutes. Design, by measuring.*
#
# You have ten points. A filter costs 3 of them and a plan 2. A sensor of 0.25 m is free, one of
# 0.163 m costs 2, one of 0.08 m costs 5, and one of 0.02 m costs 8. Buy a loop whose 32 cars all
# arrive, with a tolerance of 0.2 m, and are within 0.018 m of the circles on average. (With a plan
# the price of the inputs is 0.001, without one 0.02, so that a lap takes as long. Without a filter,
# observations are taken for the truth.)
# <!-- given: ten points, 0.25 m, 0.163 m, 0.08 m, 0.02 m, 0.2 m, 0.018 m, 0.001, 0.02 -->
#
# :::{dropdown} Hint 1
# Before you measure: look at the chapter's figure with the noise of the sensor on its axis.
# :::
#
# :::{dropdown} Hint 2
# `drive(ahead, 0.001, noise=0.08)` has filter and plan, `drive(None, 0.02, filter=None,
# noise=0.08)` neither. `run.finished.sum()` are the cars that arrive.
# :::
#
# :::{dropdown} Hint 3
# The most expensive sensor leaves two points. For what do you use them?
# :::

# %%
### BEGIN SOLUTION
purchase = {"sensor": 0.02, "filter": False, "plan": True}
### END SOLUTION

# %% [markdown] tags=["solution"]
# With the best sensor estimation is a small part of the error, so a filter has little to improve,
# and control is the largest part, which the plan reduces. The sensor of 0.08 m with filter and plan
# costs as much and leaves the car farther away. With other costs another purchase is the best one.
# What remains is the way to find it: measure which part of the error is the largest, and spend on
# that. <!-- given: 0.08 m -->

# %%
check("7.8", purchase)

# %% [markdown]
# ## To go on: look, then plan
#
# An open task without a check. The loop of the chapter plans from $X_i$ and takes in the
# observation $y_i$ only while it moves. Write a loop that looks first: `ekf.update` with $y_i$,
# then the plan, then `ekf.predict` with the input. You have succeeded when your `paired_interval`
# of 64 cars shows which of the two loops is closer, and when you can say from the split why the
# difference is small. (What you win is at most the jump. And a car that learns earlier that it is
# beside its path still needs many steps to get back.)

# %%
progress()
