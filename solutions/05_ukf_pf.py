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
# # Lab 5: Beyond one Gaussian
#
# This lab belongs to [chapter 5](../book/05_ukf_pf.py). You write sigma points and the unscented
# transform, weights that do not vanish, and the resampling comb, find out which ways of resampling
# are biased, and locate a car that hears only how far three posts are. Each exercise says how long
# it takes, has three hints to open one after the other, and ends in a check. All of them together
# take about 100 minutes. <!-- given: three, 100 minutes -->

# %% tags=["setup"]
import math

import matplotlib.pyplot as plt
import torch

import pypose_lite as pp
from pypose_lite.teaching import check, plotting, progress
from pypose_lite.teaching.checks import lost_car

plotting.use_style()
torch.set_default_dtype(torch.float64)

# %% [markdown]
# The car of the last exercise hears how far it is from three posts. Here is where they stand:
# <!-- given: three -->

# %%
print("posts at (m):", lost_car.POSTS.tolist())

# %% [markdown]
# ## Exercise 5.1: Sigma points
#
# *10 minutes. Warm-up.*
#
# Write the function that returns the $2n + 1$ sigma points of a belief as rows, $(2n+1, n)$, and
# their weights $(2n+1)$. `x` $(n)$ is the mean, `P` $(n, n)$ the covariance, and `k` a number above
# $-n$. The first point is the mean, with the weight $k / (n + k)$. The others are
# $x \pm \sqrt{n + k}\, L_j$ with the columns $L_j$ of a root of $P$, $P = L L^\top$, and share the
# rest of the weight equally.
#
# :::{dropdown} Hint 1
# `torch.linalg.cholesky(P)` is such a root. Any other one is right as well.
# :::
#
# :::{dropdown} Hint 2
# The *columns* of `L` are the rows of `L.mT`. With rows of `L` the points have another covariance.
# :::
#
# :::{dropdown} Hint 3
# `torch.cat([x[None], x + step, x - step])` with `step = math.sqrt(n + k) * L.mT`; each of the
# $2n$ outer points weighs $1 / (2 (n + k))$.
# :::


# %%
def sigma_points(x, P, k):
    """Returns the points (2n+1, n) and their weights (2n+1)."""
    ### BEGIN SOLUTION
    n = len(x)
    step = math.sqrt(n + k) * torch.linalg.cholesky(P).mT
    points = torch.cat([x[None], x + step, x - step])
    weights = torch.full((2 * n + 1,), 0.5 / (n + k))
    weights[0] = k / (n + k)
    return points, weights
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# The check computes the weighted mean and covariance of your points. If they are `x` and `P`, the
# points are right, whichever root of $P$ you took. PyPose takes the rows of the lower factor: with
# a diagonal $P$ that makes no difference, and so a test with a diagonal $P$ does not see it.

# %%
check("5.1", sigma_points)

# %% [markdown]
# ## Exercise 5.2: The unscented transform
#
# *10 minutes. One idea, used.*
#
# `f` maps points $(\dots, n)$ to $(\dots, m)$. Return the mean $(m)$ and the covariance $(m, m)$ of
# `f` of a belief with mean `x` and covariance `P`, by the images of its sigma points.
#
# :::{dropdown} Hint 1
# The mean of the images is their *weighted* mean, not `f(x)`.
# :::
#
# :::{dropdown} Hint 2
# For the covariance subtract the mean of the images, not the image of the mean.
# :::
#
# :::{dropdown} Hint 3
# `away = images - mean`, and the covariance is `(weights * away.mT) @ away`.
# :::


# %%
def unscented(f, x, P, k):
    """Returns the mean (m) and the covariance (m, m) of f."""
    ### BEGIN SOLUTION
    points, weights = sigma_points(x, P, k)
    images = f(points)
    mean = weights @ images
    away = images - mean
    return mean, (weights * away.mT) @ away
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# For a linear function both results are exact. For a parabola the mean is exact: if $x$ has the
# mean $m$, the mean of $x^\top H x$ is $m^\top H m$ plus the trace of $H P$, and the points have
# the covariance $P$. The tangent would lose the trace.

# %%
check("5.2", unscented)

# %% [markdown]
# ## Exercise 5.3: How many particles count?
#
# *10 minutes. Numbers that vanish.*
#
# A particle's weight is a product of many likelihoods, and such products are too small for a float:
# $e^{-800}$ is 0. So weights are kept as logarithms, and are not normalised. Write the
# effective sample size $1 / \sum w_k^2$ of normalised weights $w_k$, from `log_weights` $(N)$. Some
# may be `-inf`, which is the weight 0. Return one number.
#
# :::{dropdown} Hint 1
# Weights do not change if all logarithms are moved by the same number. Which number is good?
# :::
#
# :::{dropdown} Hint 2
# Subtract the largest one. The exponential function then gives 1 at the most, and never only zeros.
# :::
#
# :::{dropdown} Hint 3
# `torch.softmax` does this and normalises.
# :::


# %%
def effective_sample_size(log_weights):
    """Returns 1 / sum w^2 of the normalised weights."""
    ### BEGIN SOLUTION
    weights = torch.softmax(log_weights, dim=-1)
    return 1 / weights.square().sum()
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# It is $N$ if all weights are equal, and 1 if one particle has all the weight. It cannot say
# whether the particles are at the right place: copies of a wrong guess agree perfectly.

# %%
check("5.3", effective_sample_size)

# %% [markdown]
# ## Exercise 5.4: The resampling comb
#
# *15 minutes. An index at the edge.*
#
# `weights` $(N)$ are normalised, up to rounding. Put them end to end, and lay a comb of $N$ teeth
# over them, at $(0 + r) / N$, $(1 + r) / N$, and so on, where `r` is a number in $[0, 1)$. Return
# the indices $(N)$ of the particles on which the teeth fall, in ascending order. Two things go
# wrong in practice. Rounding may make the sum of the weights a little less than one, so that the
# last tooth falls behind all of them. And a particle with weight zero must never be taken.
#
# :::{dropdown} Hint 1
# `torch.cumsum` gives where each particle ends on the line.
# :::
#
# :::{dropdown} Hint 2
# `torch.searchsorted(ends, teeth)` finds the first end that is not before a tooth. What if a tooth
# falls exactly on an end, at 0 for instance? Look at `right=True`.
# :::
#
# :::{dropdown} Hint 3
# Divide the ends by the last of them, so that they end at exactly one; or `clamp` the indices to
# the last particle that has a weight.
# :::


# %%
def systematic(weights, r):
    """Returns the indices (N) of the particles that the comb takes."""
    ### BEGIN SOLUTION
    N = len(weights)
    ends = weights.cumsum(0)
    teeth = (torch.arange(N) + r) / N
    return torch.searchsorted(ends / ends[-1], teeth, right=True)
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# A tooth at $t$ belongs to the particle that covers the half-open interval from its beginning to
# its end, so a tooth exactly on an end belongs to the next particle: `right=True`. Then a particle
# of weight zero, which begins where it ends, covers nothing. After the division the last end is
# one, and no tooth reaches it. With `float32` and thousands of particles the sum of the weights
# really does end at 0.99999. <!-- given: 0.99999 -->

# %%
check("5.4", systematic)

# %% [markdown]
# ## Exercise 5.5: Which resampling is biased?
#
# *20 minutes. Verification.*
#
# A way to resample is a function `resample(weights, generator)` that returns $N$ indices. It is
# *unbiased* if each particle is taken in proportion to its weight *on average*: particle $k$
# appears $N w_k$ times. A single call cannot show that. Write the test that says whether a way of
# resampling is unbiased. The check hands it right ones, such as independent draws and the comb, and
# wrong ones, such as one that always takes the best.
#
# :::{dropdown} Hint 1
# Call it many times with fixed weights, and count how often each particle is taken.
# :::
#
# :::{dropdown} Hint 2
# With independent draws the mean count of a particle after $M$ calls has a standard deviation of
# about $\sqrt{N w_k / M}$. Your tolerance has to be larger than that, and smaller than the bias
# that you want to see.
# :::
#
# :::{dropdown} Hint 3
# With ten particles, some light and some heavy, $M = 2000$ calls and a tolerance of 0.15 in the
# mean count will do. Seed a generator once, before the calls. <!-- given: 0.15 -->
# :::


# %%
def is_unbiased(resample):
    """Returns whether resample(weights, generator) takes particles in proportion."""
    ### BEGIN SOLUTION
    weights = torch.tensor([0.03, 0.04, 0.05, 0.03, 0.3, 0.05, 0.25, 0.08, 0.1, 0.07])
    generator = torch.Generator().manual_seed(0)
    counts = torch.zeros(10)
    for _ in range(2000):
        taken = torch.as_tensor(resample(weights, generator))
        counts += torch.bincount(taken, minlength=10)
    return bool(((counts / 2000 - 10 * weights).abs() < 0.15).all())
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# An unbiased way may still be a bad one: independent draws add more noise than the comb, which
# takes each particle at least as often as the integer part of $N w_k$. A biased one changes the
# belief itself, in every step, and no number of particles mends that.

# %%
check("5.5", is_unbiased)

# %% [markdown]
# ## Exercise 5.6: A car that hears how far posts are
#
# *30 minutes. The bootstrap filter.*
#
# A car begins at the origin and knows nothing of its heading. In each step it is given `u`
# $(T, 2)$, speed and turn rate, and hears its distances to three posts, `y` $(T, 3)$ in metres,
# each with a standard deviation of `0.1`. The process noise is 0.005 in each number of the state
# $[i, j, \cos, \sin]$. Return estimates of the *positions* $(T, 2)$ in which the distances were
# heard, also for cars that you have not seen. The mean error over the second half of a run has to
# be less than 0.1 m. A Kalman filter that starts with a wrong heading gets lost.
# <!-- given: 0.1, 0.005, 0.1 m -->

# %%
seen_truth, seen_u, seen_y = lost_car.drive(0)
posts = lost_car.POSTS
car = pp.DubinsCar(0.1)

# %% [markdown]
# :::{dropdown} Hint 1
# Draw about 2000 particles at the origin, with headings all around, and give them all the same
# weight.
# :::
#
# :::{dropdown} Hint 2
# In each step: log weights by the distances, the weighted mean of the positions is the estimate,
# resample by `systematic`, move by `car.transition(particles, u[i])`, add noise.
# :::
#
# :::{dropdown} Hint 3
# $\log w = -\tfrac12 \sum (y - d)^2 / 0.1^2$ with the distances $d$ of a particle to the three
# posts, `(particles[:, None, :2] - posts).norm(dim=-1)`. A little more process noise than the car
# has helps. <!-- given: three -->
# :::


# %%
def locate(y, u):
    """Returns the positions (T, 2) in which the distances y (T, 3) were heard."""
    ### BEGIN SOLUTION
    generator = torch.Generator().manual_seed(0)
    heading = 2 * math.pi * torch.rand(3000, generator=generator)
    zero = torch.zeros(3000)
    particles = torch.stack([zero, zero, heading.cos(), heading.sin()], dim=1)
    estimates = []
    for heard, given in zip(y, u):
        distances = (particles[:, None, :2] - posts).norm(dim=-1)
        log_weights = -((heard - distances) ** 2).sum(-1) / (2 * 0.1**2)
        weights = torch.softmax(log_weights, dim=0)
        estimates.append(weights @ particles[:, :2])
        r = torch.rand((), generator=generator)
        particles = car.transition(particles[systematic(weights, r)], given)
        noise = 0.01 * torch.randn(3000, 4, generator=generator)
        particles = particles + noise
    return torch.stack(estimates)
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# For the first steps the particles are a ring around the origin, and their mean is its centre. As
# the car drives, the distances single out the piece of the ring that is right. The extra noise
# keeps the copies apart that resampling makes; without it, soon all particles would be copies of a
# few (*impoverishment*).

# %%
check("5.6", locate)

# %% tags=["hide-input"]
found = locate(seen_y, seen_u)
fig, ax = plt.subplots(figsize=(7, 4))
ax.plot(*seen_truth[:, :2].mT, color="black", label="the car")
ax.plot(*found.mT, ".", color=plotting.BLUE, label="located")
ax.plot(*posts.mT, "^", color=plotting.RED, ms=10, label="posts")
ax.set(xlabel="i (m)", ylabel="j (m)", aspect="equal")
fig.legend(loc="outside lower center", ncols=3)
alt = "The way of the car, three posts, and the located positions near it."
plotting.show(fig, alt)

# %%
progress()

# %% [markdown]
# ## For the open end: a filter for two humps
#
# *As long as you like. No check.* Take away two of the three posts. How long does your filter keep
# both places where the car may be, and how does that depend on the number of particles? You have
# done well if you can say by which chance one of two equal humps dies although nothing spoke
# against it, and how to delay it. <!-- given: two, three -->
