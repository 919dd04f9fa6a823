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
    ### BEGIN SOLUTION
    out = infinity.tracking_error(x) > lane
    return (out.cumsum(-1) == 0).sum(-1)
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# The `return` in the loop became a count, the `if` a comparison of all numbers at once. Another way
# is `argmax` of `out`, which finds the first of the largest; but it is 0 for a car that never
# leaves, and needs a `torch.where`. A batch computes more than the loop, since it does not stop at
# the first one. It is still far quicker. (The lane below is narrower than the chapter's, so that
# there is something to see. The peak at the end is where the gains fade.)

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
    ### BEGIN SOLUTION
    half_width = share * z.mean().abs()
    return math.ceil((1.96 * z.std() / half_width) ** 2)
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# Ten times the precision costs a hundred times the laps. And a mean near zero costs endlessly many:
# a relative precision is then the wrong thing to ask for.

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
    ### BEGIN SOLUTION
    share = k / n
    c = 1.96**2 / n
    middle = 2 * share + c
    root = math.sqrt(middle**2 - 4 * (1 + c) * share**2)
    return (middle - root) / (2 + 2 * c), (middle + root) / (2 + 2 * c)
    ### END SOLUTION


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

# %% [markdown] tags=["solution"]
# The simple interval fails where we need it most, for events that are rare: with a probability of
# 0.01 most studies of 64 laps see none, and their interval is the single number 0. Wilson's is
# sometimes a little too narrow, sometimes a little too wide, since $k$ is a whole number.
# <!-- given: 0.01 -->

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
    ### BEGIN SOLUTION
    shifted = w + mu
    weights = torch.exp(mu @ mu / 2 - shifted @ mu)
    values = fails(shifted) * weights
    return values.mean(), values.std() / math.sqrt(len(w))
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# Every draw counts with a weight that knows nothing of the failure, only of the two densities. Do
# not divide by the sum of the weights, as a particle filter does: the densities are known here with
# their factors, and the few draws that lie far on the other side would spoil the sum.

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

# %% [markdown] tags=["solution"]
# This is less than the chapter's probability of leaving the lane, because the car can leave it
# before, and to the other side. A single shift sees only the failures on its own side: those
# elsewhere are drawn hardly ever, and would have huge weights. An estimate that misses them looks
# perfectly sure. That is why the chapter draws from a mixture of shifts.

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
    ### BEGIN SOLUTION
    mixed = numpy.random.SeedSequence([seed, task]).generate_state(1)
    generator = torch.Generator().manual_seed(int(mixed[0]))
    return torch.randn(n, generator=generator)
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# The first colleague's tasks all draw the same numbers, and every other part of the program draws
# them again. The second one's studies overlap: task 1 of study 0 is task 0 of study 1. The third
# one's overlap where the digits do. `seed * 2**20 + task` is right as well, with room for a million
# tasks. `seed * 2**32 + task` looks even safer, and is not: of any seed torch's generator keeps the
# lower 32 bits, in which all studies are then the same. It also means that there are only four
# billion sets of draws. If seeds are drawn at random, as here, two of a hundred thousand tasks
# probably share one; so the chapter's `study.generator` counts them instead.

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
    ### BEGIN SOLUTION
    results = []
    for task in tasks:
        path = folder / f"{task}.pt"
        if not path.exists():
            part = folder / f"{task}.part"
            save(work(task), part)
            os.replace(part, path)
        results.append(load(path))
    return results
    ### END SOLUTION


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

# %% [markdown] tags=["solution"]
# Starting and resuming are the same call, so there is no second path through the program that is
# never tested. The kill itself goes through: whoever catches it cannot be stopped any more. The
# chapter's `study.run` adds two things: workers, and a file with the settings, so that results of
# one study are not taken for those of another.

# %%
check("10.6", resume)

# %%
progress()
