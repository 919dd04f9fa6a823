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
# # Lab 4: The Kalman filter
#
# This lab belongs to [chapter 4](../book/04_ekf.py). You write the filter's correction, for a
# measurement with an angle and for one with gaps, find out by the NIS that a sensor is late, write
# a test that tells right filters from wrong ones, tune $Q$ and $R$, learn them from recordings, and
# filter a walk of the simulated Go1. Each exercise says how long it takes, has three hints to open
# one after the other, and ends in a check. All of them together take about 120 minutes.
# <!-- given: 120 minutes -->

# %% tags=["setup"]

import matplotlib.pyplot as plt
import torch

import pypose_lite as pp
from pypose_lite import filters
from pypose_lite.teaching import check, plotting, progress
from pypose_lite.teaching.checks import recordings

plotting.use_style()
torch.set_default_dtype(torch.float64)

# %% [markdown]
# ## Exercise 4.1: One correction
#
# *10 minutes. Warm-up.*
#
# Write the correction of the Kalman filter. `x` $(n)$ and `P` $(n, n)$ are the belief, its mean and
# covariance. `y` $(p)$ is a measurement $y = C x + v$, `C` is $(p, n)$, and `R` $(p, p)$ is the
# covariance of the noise $v$. Return the new `x` and `P`.
#
# :::{dropdown} Hint 1
# The innovation is $e = y - C x$, and its covariance is $S = C P C^\top + R$.
# :::
#
# :::{dropdown} Hint 2
# $K = P C^\top S^{-1}$ is `torch.linalg.solve(S, C @ P).mT`, since $P$ and $S$ are symmetric.
# :::
#
# :::{dropdown} Hint 3
# $x + K e$ and $(I - K C) P$, or Joseph's form of the latter.
# :::


# %%
def kalman_update(x, P, y, C, R):
    """Returns x (n) and P (n, n) once y is known."""
    raise NotImplementedError("4.1 One correction")


# %%
check("4.1", kalman_update)

# %% [markdown]
# ## Exercise 4.2: A post behind the car
#
# *15 minutes. The extended Kalman filter.*
#
# The state is $[i, j, \cos\theta, \sin\theta]$. A sensor sees a post at a known place and measures
# `y` $= [r, \beta]$: the distance, and the direction relative to the car's heading, in radians
# between $-\pi$ and $\pi$. Write the correction. `post` is $(2)$ and `R` is $(2, 2)$. A post that
# is straight behind the car may be seen at $+3.1$ rad and be expected at $-3.1$ rad. That is a
# small surprise, and has to be treated as one. <!-- given: 3.1 rad -->
#
# :::{dropdown} Hint 1
# Write $g$ as a function of the state, and take `torch.autograd.functional.jacobian(g, x)`.
# :::
#
# :::{dropdown} Hint 2
# $\beta$ is the direction to the post, by `torch.atan2`, minus the heading, by `torch.atan2` of
# sine and cosine.
# :::
#
# :::{dropdown} Hint 3
# Bring the second number of the innovation between $-\pi$ and $\pi$: `filters.wrap(e[1])`, or
# `torch.atan2(e[1].sin(), e[1].cos())`.
# :::


# %%
def sighting_update(x, P, y, post, R):
    """Returns x (4) and P (4, 4) once the post has been seen."""

    raise NotImplementedError("4.2 A post behind the car")


# %%
check("4.2", sighting_update)

# %% [markdown]
# ## Exercise 4.3: Measurements with gaps
#
# *10 minutes. A common case on robots.*
#
# Some numbers of a measurement may be missing; they are `nan` then. Write the correction so that it
# uses the rows that are there. If all are missing, the belief stays as it is. You may call
# `kalman_update`.
#
# :::{dropdown} Hint 1
# `known = ~y.isnan()` says which rows are there.
# :::
#
# :::{dropdown} Hint 2
# `y[known]` and `C[known]` are the known rows. Of `R` take the known rows *and* columns.
# :::
#
# :::{dropdown} Hint 3
# `R[known][:, known]`. With no row left, all of these are empty, and most solvers accept that; if
# not, return early.
# :::


# %%
def update_with_gaps(x, P, y, C, R):
    """Returns x (n) and P (n, n); rows of y that are nan are left out."""
    raise NotImplementedError("4.3 Measurements with gaps")


# %%
check("4.3", update_with_gaps)

# %% [markdown]
# ## Exercise 4.4: Which sensor is late?
#
# *15 minutes. A fault, found by the NIS.*
#
# The state of a cart is its position and its speed. It is driven by accelerations `u` $(T, 1)$, and
# its position is measured, `y` $(T, 1)$. The sensor may be late: `y[i]` may belong to the state of
# 0, 1, 2, 3 or 4 steps before. The error of the estimate is not known on a real cart, but the NIS
# is. Here is the filter of the cart, which takes `y[i]` for a measurement of the state in which
# `u[i]` is given: <!-- given: 4 steps -->

# %%
A = recordings.A
B = recordings.B
C = recordings.C
Q = recordings.Q
R = recordings.R
cart = pp.LTI(A, B, C, torch.zeros(1, 1))


def mean_nis(y, u):
    """Returns the mean NIS of the cart's filter over a recording."""
    f = pp.EKF(cart, Q, R)
    x = torch.zeros(2)
    P = 0.01 * torch.eye(2)
    values = []
    for yi, ui in zip(y, u):
        values.append(filters.nis(f.innovation(x, yi, ui, P)))
        x, P = f(x, yi, ui, P)
    return torch.stack(values).mean()


# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 2.8))
late_means = [mean_nis(*recordings.cart_run(0, late)) for late in range(5)]
ax.bar(range(5), late_means)
ax.axhline(1, color="black", ls="--", label="as it should be")
ax.set(xlabel="the sensor's delay (steps)", ylabel="mean NIS", yscale="log")
ax.legend(loc="upper left")
alt = "The mean NIS is near one without a delay and grows with the delay."
plotting.show(fig, alt)

# %% [markdown]
# Write `find_delay(y, u)`, which returns the delay in steps, for recordings that you have not seen.
#
# :::{dropdown} Hint 1
# If the delay is $d$, which of the measurements belongs to the state in which `u[0]` was given?
# :::
#
# :::{dropdown} Hint 2
# It is `y[d]`. Shift the measurements by $d$, shorten the inputs by as much, and look at the NIS.
# :::
#
# :::{dropdown} Hint 3
# `mean_nis(y[d:], u[: len(u) - d])` for $d$ from 0 to 4: the least of them is that of the right
# delay.
# :::


# %%
def find_delay(y, u):
    """Returns by how many steps the measurements are late: 0, 1, 2, 3 or 4."""
    raise NotImplementedError("4.4 Which sensor is late?")


# %%
check("4.4", find_delay)

# %% [markdown]
# ## Exercise 4.5: A test for filters
#
# *20 minutes. Verification.*
#
# Somebody hands you a filter of the cart, `f(x, P, y, u)`, which returns the belief about the next
# state: `x` $(2)$ and `P` $(2, 2)$. Write the test that says whether it is the Kalman filter. The
# check hands it right filters, which compute the same in different ways, and wrong ones, each with
# one fault: a missing $Q$, a sign, a transpose, a measurement that is used at the wrong time, ...
# `A`, `B`, `C`, `Q` and `R` are those of the cell above.
#
# :::{dropdown} Hint 1
# One step with numbers of your own is enough, if you know what it must give. You have written the
# correction in Exercise 4.1.
# :::
#
# :::{dropdown} Hint 2
# Take a `P` that is not diagonal, and a `u` and an `x` that are not zero: a fault that is
# multiplied by zero does not show.
# :::
#
# :::{dropdown} Hint 3
# After the correction the mean is $A x^+ + B u$ and the covariance $A P^+ A^\top + Q$. Compare
# both, with a tolerance for rounding.
# :::


# %%
def is_kalman_filter(f):
    """Returns whether f(x, P, y, u) is the Kalman filter of the cart."""
    raise NotImplementedError("4.5 A test for filters")


# %%
check("4.5", is_kalman_filter)

# %% [markdown]
# ## Exercise 4.6: Tune Q and R
#
# *15 minutes. Design.*
#
# A car drives a circle 64 times. Neither the noise of its motion nor that of its sensor is known.
# Both have the same standard deviation in each of the four numbers. Choose `process` and `sensor`
# so that the filter is as sure as it should be: its mean NIS between 3.6 and 4.4, and its mean NEES
# between 3.4 and 4.6, also for recordings of the same car that you have not seen. `scores` computes
# both. <!-- given: 64 times, four, 3.6, 4.4, 3.4, 4.6 -->

# %%
car = pp.DubinsCar(0.1)
truth, looks, inputs, first_guess = recordings.car_laps(0)


def scores(process, sensor):
    """Returns the mean NIS and the mean NEES of a filter with these noises."""
    f = pp.EKF(car, process**2 * torch.eye(4), sensor**2 * torch.eye(4))
    x = first_guess
    P = 0.05**2 * torch.eye(4).expand(64, 4, 4)
    nis = []
    nees = []
    for i, u in enumerate(inputs):
        nis.append(filters.nis(f.innovation(x, looks[:, i], u, P)))
        x, P = f(x, looks[:, i], u, P)
        nees.append(filters.nees(x, P, truth[:, i + 1]))
    return torch.stack(nis).mean().item(), torch.stack(nees).mean().item()


print("mean NIS and NEES:", scores(process=0.005, sensor=0.163))

# %% [markdown]
# :::{dropdown} Hint 1
# A value that is too large says that the filter is too sure. Which of the two noises is too small?
# :::
#
# :::{dropdown} Hint 2
# The NIS depends mostly on the sensor's noise, and the NEES on that of the motion. Change one at a
# time, and return to the other.
# :::
#
# :::{dropdown} Hint 3
# Begin with `sensor = 0.12`, and try values of `process` between 0.01 and 0.05.
# <!-- given: 0.12, 0.01, 0.05 -->
# :::

# %%
raise NotImplementedError("4.6 Tune Q and R")
print("mean NIS and NEES:", scores(process, sensor))

# %%
check("4.6", (process, sensor))

# %% [markdown]
# ## Exercise 4.7: Learn the noise
#
# *25 minutes. Differentiate through the filter.*
#
# A number moves at random, $x_{i+1} = x_i + w_i$, and is measured, $y_i = x_i + v_i$. You get 32
# recordings of 60 steps, `y` $(32, 60)$, and look for the standard deviations of $w$ and $v$. If a
# filter is right, its innovations are Gaussian with mean zero and variance $S_i$. So choose the
# noises for which the innovations that did occur are most likely, which is called *maximum
# likelihood*. The logarithm of a Gaussian's density, with its sign changed and without a constant,
# is
#
# $$ \tfrac12 \Bigl( \frac{e_i^2}{S_i} + \log S_i \Bigr) $$
#
# Minimise its mean. The first part becomes small with a large $S$, and the second keeps $S$ from
# growing. The loss is differentiable, through all 60 steps of the filter. Return both standard
# deviations to within 20 %. Begin with $x = 0$ and $P = \sigma_w^2$, the variance of $w$.
# <!-- given: 32 recordings, 60 steps, 20 % -->
#
# :::{dropdown} Hint 1
# Standard deviations are positive: learn their logarithms, `log = torch.zeros(2,
# requires_grad=True)`, and use `log.exp()`.
# :::
#
# :::{dropdown} Hint 2
# Per step: $S = P + R$, $e = y_i - x$, add to the loss, then correct with $K = P / S$ and predict
# with $P + Q$. All 32 recordings have the same $P$.
# :::
#
# :::{dropdown} Hint 3
# `torch.optim.Adam([log], lr=0.1)` with 100 steps is enough.
# :::


# %%
def learn_noise(y):
    """Returns the standard deviations (of w, of v) of recordings (32, 60)."""
    raise NotImplementedError("4.7 Learn the noise")


# %%
check("4.7", learn_noise)

# %% [markdown]
# ## Exercise 4.8: A walk of the dog
#
# *15 minutes. The robot.*
#
# The simulated Go1 walks a bend to the left and one to the right. In each step of 0.1 s its pose is
# recorded as `y` $(T, 4)$, off by 0.1 m and 0.1 rad (standard deviations), and so is the command
# `u` $(T, 2)$ that it was then given, a speed in m/s and a turn rate in rad/s. Return estimates of
# the states $(T, 4)$ whose mean position error is less than half that of `y`, also for walks that
# you have not seen. The estimate of step $i$ may use `y[0]` to `y[i]` and `u[0]` to `u[i - 1]`,
# which is what a walking robot knows at that time. <!-- given: 0.1 s, 0.1 m, 0.1 rad, half -->

# %%
seen_x, seen_y, seen_u = recordings.dog_walk(0)

# %% [markdown]
# :::{dropdown} Hint 1
# The filter of the chapter, with the car as the model of the dog, will do. Begin at `y[0]` with
# $P = R$.
# :::
#
# :::{dropdown} Hint 2
# Cosine and sine of an angle that is off by 0.1 rad are off by about 0.1. So `R = 0.1**2 *
# torch.eye(4)`.
# :::
#
# :::{dropdown} Hint 3
# A small `Q` trusts the commands, a large one the poses. Try standard deviations from 0.005 to
# 0.05. Correct with `y[i]`, keep the estimate, then predict with `u[i]`.
# :::


# %%
def filter_walk(y, u):
    """Returns estimates (T, 4) of the states in which y (T, 4) was measured."""
    raise NotImplementedError("4.8 A walk of the dog")


# %%
check("4.8", filter_walk)

# %% tags=["hide-input"]
estimates = filter_walk(seen_y, seen_u)
fig, ax = plt.subplots(figsize=(7, 4))
ax.plot(*seen_y[:, :2].mT, "x", color=plotting.GREY, label="measured")
ax.plot(*seen_x[:, :2].mT, color="black", label="where the dog was")
ax.plot(*estimates[:, :2].mT, ".-", label="filtered")
ax.set(xlabel="i (m)", ylabel="j (m)", aspect="equal")
fig.legend(loc="outside lower center", ncols=3)
alt = "Scattered crosses around the dog's way, and the filtered way near it."
plotting.show(fig, alt)

# %%
progress()

# %% [markdown]
# ## For the open end: a recording of your own
#
# *As long as you like. No check.* Many phones record their position and acceleration with a free
# app. Walk around a block, read the file, and write a filter with the state $[i, j, v_i, v_j]$. You
# have done well if you can say: where your $R$ comes from (a recording at rest), how you chose $Q$,
# what the mean NIS is and in which interval it should lie, and what the filter does when you leave
# out half a minute of positions. <!-- given: half a minute -->
