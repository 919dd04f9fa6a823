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
# # Lab 10: Thousands of cars
#
# This lab belongs to [chapter 10](../book/10_thousands.py). You turn a loop into a batch,
# say how many laps a claim needs, write an honest interval for a share, find the probability of a
# rare event, give each task of a study its own numbers, and resume a study that was killed. Each
# exercise says how long it takes, has three hints to open one after the other, and ends in a check.
# All of them together take about 100 minutes. <!-- given: 100 minutes -->

# %% tags=["setup"]
import math
import os
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy
import torch

import pypose_lite as pp
from pypose_lite import infinity
from pypose_lite.teaching import check, plotting, progress

plotting.use_style()
torch.set_default_dtype(torch.float64)

# %% [markdown]
# The car and its lane are those of the chapter:

# %%
dt = 0.1  # s
T = 128  # steps for the lap
lane = 0.12  # m, to each side
turn = 2 * math.pi / (64 * dt)  # rad/s
speed = 2 * math.sin(turn * dt / 2) / dt  # m/s
turns = [turn / 2] + [turn] * 63 + [0.0] + [-turn] * 63
u_ref = torch.stack([torch.full((T,), speed), torch.tensor(turns)], dim=-1)
ideal = pp.DubinsCar(dt)
states = [infinity.waypoints()[0]]
for u in u_ref:
    states.append(ideal.transition(states[-1], u))
x_ref = torch.stack(states)
Q = torch.diag(torch.tensor([1, 1, 0.3, 0.3, 0.01, 0.01]))
aims = {"target": x_ref[:-1], "u_target": u_ref}
K, _ = pp.LQR(ideal, Q, None, T).lqr_backward(x_ref[0], dt, u_ref, **aims)
slipping = pp.DubinsCar(dt, slip=0.05)


# %%
def drive(w, noise=0.01):
    """Returns the states (..., T+1, 4) of laps with the draws w (..., T, 4)."""
    x = x_ref[0].expand(*w.shape[:-2], 4)
    states = [x]
    for t in range(T):
        u = u_ref[t] + (x - x_ref[t]) @ K[t].mT
        x = slipping.transition(x, u) + noise * w[..., t, :]
        states.append(x)
    return torch.stack(states, dim=-2)


# %%
one = drive(torch.randn(T, 4, generator=torch.Generator().manual_seed(0)))
strays = infinity.tracking_error(one).max()
print(f"one lap strays {strays:.3f} m from the path at most")

# %% [markdown]
# ## Exercise 10.1: A loop becomes a batch
#
# *10 minutes. Warm-up.*
#
# When does a car leave its lane? This function says it for one lap, the states `x` $(N, 4)$. It
# returns the number of the first state that is farther from the path than the lane reaches, and $N$
# if there is none. It cannot work for a batch: it asks one car, and returns as soon as it knows.


# %%
def first_exit_of_one(x, lane):
    for k in range(len(x)):
        if infinity.tracking_error(x[k]) > lane:
            return k
    return len(x)


# %% [markdown]
# Write the function for laps `x` $(\dots, N, 4)$ with any number of dimensions in front, also none.
# It returns whole numbers, of shape $(\dots)$. No loop over the cars, please; the check counts the
# operations.
#
# :::{dropdown} Hint 1
# `infinity.tracking_error(x)` works on every batch: all distances of all cars at once,
# $(\dots, N)$.
# :::
#
# :::{dropdown} Hint 2
# The answer is how many states come *before* the first one that is out. Which of them have seen
# none that is out, up to and with themselves?
# :::
#
# :::{dropdown} Hint 3
# `out.cumsum(-1)` counts, for each state, how many were out up to there. Count the zeros in it.
# :::


# %%
def first_exit(x, lane):
    """Returns the first state (...) of laps x (..., N, 4) that is out of the lane."""
    raise NotImplementedError("10.1 A loop becomes a batch")


# %% tags=["hide-input"]
laps = drive(torch.randn(2000, T, 4, generator=torch.Generator().manual_seed(0)))
exits = first_exit(laps, 0.06)
fig, ax = plt.subplots(figsize=(7, 2.8))
ax.hist(dt * exits[exits <= T], bins=64, range=(0, dt * T), label="first exit")
ax.set(xlabel="time (s)", ylabel="cars")
ax.legend()
plotting.show(
    fig,
    "A histogram of the times of the first exit: even over most of the lap, and a "
    "tall peak at its end.",
)

# %%
check("10.1", first_exit)

# %% [markdown]
# ## Exercise 10.2: How many laps?
#
# *10 minutes. Warm-up.*
#
# A first look at some laps gave the results `z` $(n)$. Somebody wants the mean to within a share of
# itself, say `share = 0.01` for 1 percent, with 95 % confidence: the *half*-width of the interval
# shall be `share` times the size of the mean. Return how many laps that needs, a whole number.
# <!-- given: 1 percent -->
#
# :::{dropdown} Hint 1
# The half-width of the interval with $N$ laps is $1.96\, \sigma / \sqrt N$.
# :::
#
# :::{dropdown} Hint 2
# Solve $1.96\, \sigma / \sqrt N = \text{share} \cdot |\bar z|$ for $N$.
# :::
#
# :::{dropdown} Hint 3
# `z.std()` estimates $\sigma$, and `math.ceil` rounds up.
# :::


# %%
def laps_needed(z, share):
    """Returns the number of laps for a mean to within a share of itself, at 95 %."""
    raise NotImplementedError("10.2 How many laps?")


# %%
check("10.2", laps_needed)

# %% [markdown]
# ## Exercise 10.3: An interval for a share
#
# *15 minutes. Derivation.*
#
# Of `n` laps `k` left the lane. Return the two ends of Wilson's interval at 95 %, `low, high`. They
# are the two numbers $p$ for which the observed share $\hat p = k / n$ is just 1.96 standard
# deviations away from $p$, where the standard deviation is the one that a share has *if p is true*:
#
# $$ (\hat p - p)^2 = 1.96^2\; \frac{p\,(1 - p)}{n} $$
# <!-- given: 1.96 -->
#
# :::{dropdown} Hint 1
# Multiply out, and collect the terms with $p^2$, with $p$, and without: a quadratic equation.
# :::
#
# :::{dropdown} Hint 2
# With $c = 1.96^2 / n$ it is $(1 + c)\, p^2 - (2 \hat p + c)\, p + \hat p^2 = 0$.
# :::
#
# :::{dropdown} Hint 3
# The roots of $a p^2 - b p + d = 0$ are $(b \mp \sqrt{b^2 - 4 a d}) / 2a$.
# :::


# %%
def interval(k, n):
    """Returns the ends of the interval of a probability, after k of n."""
    raise NotImplementedError("10.3 An interval for a share")


# %% [markdown]
# How good is it? For a given $p$ we can add up the probabilities of all $k$ whose interval contains
# $p$. It should be 0.95. The cell compares with the simple interval, in which the observed share
# takes the place of $p$. <!-- given: 0.95 -->

# %% tags=["hide-input"]
n = 64
counts = torch.arange(n + 1.0)
chances = torch.linspace(0.002, 0.3, 150)
binomial = torch.distributions.Binomial(n, chances[:, None])
likely = binomial.log_prob(counts).exp()  # of each k, for each p
wilson = torch.tensor([interval(k, n) for k in range(n + 1)])
spread = 1.96 * (counts / n * (1 - counts / n) / n).sqrt()
simple = torch.stack([counts / n - spread, counts / n + spread], dim=-1)
fig, ax = plt.subplots(figsize=(7, 3.2))
for ends, style, name in [(wilson, "-", "yours"), (simple, "--", "the simple one")]:
    inside = (ends[:, 0] <= chances[:, None]) & (chances[:, None] <= ends[:, 1])
    ax.plot(chances, (likely * inside).sum(-1), style, label=name)
ax.axhline(0.95, color="black", lw=0.8, ls=":")
ax.set(xlabel="true probability", ylabel="contained with probability", ylim=(0, 1.02))
ax.legend()
plotting.show(
    fig,
    "The probability that an interval from 64 laps contains the true one. Wilson's "
    "stays near 0.95; the simple one falls to zero for small probabilities.",
)

# %%
check("10.3", interval)

# %% [markdown]
# ## Exercise 10.4: A rare event
#
# *25 minutes. Design.*
#
# `fails(w)` says for each row of `w` $(n, d)$ whether a lap with these standard normal draws fails.
# Failures are rare, and most likely near `mu` $(d)$. You are given $n$ rows of standard normal
# numbers `w`. Draw around `mu` instead of zero, weigh what you find, and return the probability of
# a failure and its standard error.
#
# :::{dropdown} Hint 1
# `w + mu` are draws around `mu`. Ask `fails` about these.
# :::
#
# :::{dropdown} Hint 2
# The weight of a draw $s$ is the true density divided by the one it was drawn from,
# $e^{-\lVert s \rVert^2/2} / e^{-\lVert s - \mu \rVert^2/2}$. Which $s$ stands in it?
# :::
#
# :::{dropdown} Hint 3
# The quotient is $e^{\lVert \mu \rVert^2/2 - \mu^\top s}$. Every lap gives a value: its weight if
# it fails, else 0. The probability is their mean, and the standard error that of a mean.
# :::


# %%
def rare(fails, mu, w):
    """Returns the probability of a failure, and its standard error."""
    raise NotImplementedError("10.4 A rare event")


# %% [markdown]
# Now the car: how likely is it outside its lane at the end of the lap? The nearest draws that bring
# it there come from a gradient, as in the chapter.


# %%
def outside(w):
    """Returns whether laps with draws w (n, 4 T) end outside the lane."""
    ends = drive(w.unflatten(-1, (T, 4)))[..., -1, :]
    return infinity.tracking_error(ends) > lane


def end_error(w):
    return infinity.tracking_error(drive(w.unflatten(-1, (T, 4)))[-1])


slope = torch.func.grad(end_error)(torch.zeros(4 * T))
nearest = slope * (lane - end_error(torch.zeros(4 * T))) / slope.square().sum()
w = torch.randn(4096, 4 * T, generator=torch.Generator().manual_seed(1))
chance, error = rare(outside, nearest, w)
print(f"plain: {outside(w).sum()} of 4096, norm of the shift: {nearest.norm():.2f}")
print(f"yours: {chance:.2e}, with a standard error of {error:.0e}")

# %%
check("10.4", rare)

# %% [markdown]
# ## Exercise 10.5: Numbers for each task
#
# *15 minutes. A fault, to be avoided.*
#
# A study is cut into tasks, which workers do in any order. Write the function that draws the
# numbers of a task: `n` standard normal numbers, which depend on the study's `seed` and the number
# of the `task` and on nothing else. Two tasks must not share their numbers, nor two studies. And
# the task must not disturb the generator that everybody else uses.
#
# This is how colleagues have done it. Find out what is wrong with each:
#
# ```python
# torch.manual_seed(seed)                                  # the first
# torch.Generator().manual_seed(seed + task)               # the second
# torch.Generator().manual_seed(int(f"{seed}{task}"))      # the third
# ```
#
# :::{dropdown} Hint 1
# `torch.Generator()` makes a generator of your own. It needs one whole number as its seed, a
# different one for each pair.
# :::
#
# :::{dropdown} Hint 2
# A sum is the same for other pairs, and so are digits written one after the other: study 1 with
# task 23, and study 12 with task 3. Leave room between two studies, or mix the two numbers.
# :::
#
# :::{dropdown} Hint 3
# `numpy.random.SeedSequence([seed, task]).generate_state(1)[0]` mixes two numbers into one.
# :::


# %%
def draws(seed, task, n):
    """Returns n standard normal numbers of a task, (n,)."""
    raise NotImplementedError("10.5 Numbers for each task")


# %%
check("10.5", draws)

# %% [markdown]
# ## Exercise 10.6: A study that was killed
#
# *25 minutes. Design.*
#
# A study does `work(task)` for each number in `tasks`, which takes hours. It may be killed at any
# moment. Write the function that returns the list of all results, in the order of `tasks`, and that
# can be called again after it was killed: no task whose result had been saved is done again, and
# the results are right. `folder` is a `Path` that exists. `save(result, path)` writes a file, and
# `load(path)` reads it; here they are `torch.save` and `torch.load`.
#
# Think of a kill *in the middle of* `save`: it leaves half of a file.
#
# :::{dropdown} Hint 1
# One file for each task, named by its number: `folder / f"{task}.pt"`. If `path.exists()`, there is
# nothing to do but to load it.
# :::
#
# :::{dropdown} Hint 2
# Half of a file must never have the name that you look for. Save under another name first.
# :::
#
# :::{dropdown} Hint 3
# `os.replace(part, path)` gives a file its final name in one go: there is no moment at which half
# of it is there.
# :::


# %%
def resume(work, tasks, folder, save, load):
    """Returns the results of all tasks; what is in the folder is not done again."""
    raise NotImplementedError("10.6 A study that was killed")


# %%
folder = Path(tempfile.mkdtemp())


def shaky(task):
    """Returns a number of a task, and fails at the third one at first."""
    if task == 3 and not (folder / "warned").exists():
        (folder / "warned").touch()
        raise InterruptedError("killed at task 3")
    print("task", task)
    return torch.randn(1000, generator=torch.Generator().manual_seed(task)).mean()


try:
    resume(shaky, range(5), folder, torch.save, torch.load)
except InterruptedError as error:
    print(error)
print(torch.stack(resume(shaky, range(5), folder, torch.save, torch.load)))

# %%
check("10.6", resume)

# %%
progress()
