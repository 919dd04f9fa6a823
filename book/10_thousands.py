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
# # Thousands of cars
#
# A warehouse has two hundred robots, and each of them drives a thousand rounds a day. A fault that
# shows in one round of a hundred thousand is never seen in the laboratory, and in the warehouse it
# happens twice a day. Before such a fleet is released, its engineers drive it in simulation, as
# often as they need to be sure. So they have to know how to simulate many robots at little cost,
# what a number of simulated rounds can prove, and how to find what hardly ever happens. This
# chapter does all three with the car of the infinity. <!-- given: a thousand, twice -->
#
# After this chapter you can
#
# - drive thousands of cars in one batch, and say when a larger batch no longer pays;
# - say how many laps a claim needs, and write an honest interval around a mean or a share;
# - find the probability of an event that plain simulation never shows;
# - spread a study over processes or machines, so that nothing is lost and no digit changes.
#
# You need [chapter 2](02_lqr.py) (the gains that steer the car) and what a normal distribution is;
# [chapter 5](05_ukf_pf.py) has met importance weights before. Take about 60 minutes. The paper
# {cite}`pypose06` has no such study; its library, like ours, works on batches.
# <!-- given: 60 minutes -->

# %% tags=["setup"]
import math
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import torch
from IPython.display import display

import pypose_lite as pp
from pypose_lite import infinity, teaching
from pypose_lite.teaching import batches, claim, plotting, sketches, study, table

plotting.use_style()
torch.set_default_dtype(torch.float64)


def seed(number):
    return torch.Generator().manual_seed(number)


# %% [markdown]
# The car is chapter 2's. It drives the two circles in 128 steps, corrected in each by the gains
# $K_t$ of LQR, which are computed once. This makes a lap so cheap that we can afford a hundred
# thousand. <!-- given: 128 steps, a hundred thousand -->

# %%
dt = 0.1  # s, the length of one time step
T = 128  # steps for the lap
turn = 2 * math.pi / (64 * dt)  # rad/s
speed = 2 * math.sin(turn * dt / 2) / dt  # m/s, from point to point on a circle
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

# %% [markdown]
# The real car has a slip of 0.05 that the gains do not know of, and drives on rough ground: in each
# step its state is disturbed by noise with a standard deviation of 0.01 in every component, twice
# the book's. It must stay in a *lane* that reaches 0.12 m to both sides of the path. The draws `w`
# are standard normal numbers; we keep them apart from the car, because we shall want to choose
# them. <!-- given: 0.01, twice, 0.12 m -->

# %%
slipping = pp.DubinsCar(dt, slip=0.05)
lane = 0.12  # m


def drive(w, gains=K, car=slipping, noise=0.01):
    """Returns the states (..., T+1, 4) of laps with the draws w (..., T, 4)."""
    aim, ahead, gain = (z.to(w.device) for z in (x_ref, u_ref, gains))
    x = aim[0].expand(*w.shape[:-2], 4)
    states = [x]
    for t in range(T):
        u = ahead[t] + (x - aim[t]) @ gain[t].mT
        x = car.transition(x, u) + noise * w[..., t, :]
        states.append(x)
    return torch.stack(states, dim=-2)


def largest(w, gains=K):
    """Returns the largest distance from the path (...), in metres, of each lap."""
    return infinity.tracking_error(drive(w, gains)).amax(-1)


# %%
many = torch.randn(4096, T, 4, generator=seed(0))
laps = drive(many)
errors = infinity.tracking_error(laps).amax(-1)

# %% tags=["hide-input"]
fig, (top, bottom) = plt.subplots(2, 1, figsize=(7, 7), height_ratios=[1.4, 1])
plotting.infinity_axes(top)
angle = torch.linspace(0, 2 * math.pi, 200)
for radius in (1 - lane, 1 + lane):
    for centre in (-1, 1):
        top.plot(centre + radius * angle.cos(), radius * angle.sin(), "k:", lw=1)
top.lines[0].set_label("edges of the lane")
top.plot(*laps[:200, :, :2].permute(2, 1, 0), color=plotting.SKY, lw=0.2)
top.lines[4].set_label("200 of the cars")
worst = errors.argmax()
top.plot(*laps[worst, :, :2].mT, color=plotting.RED, lw=1.2, label="the worst of all")
for line in top.legend(loc="upper center", ncols=3).get_lines():
    line.set_linewidth(1.5)
bottom.hist(errors, bins=60, color=plotting.BLUE, log=True, label="4096 cars")
bottom.axvline(lane, color="black", ls=":", label="edge of the lane")
bottom.set(xlabel="largest distance from the path in a lap (m)", ylabel="cars")
bottom.legend(loc="lower center", bbox_to_anchor=(0.5, 1), ncols=2)
plotting.show(
    fig,
    "Above, thin lines of many cars fill a band along the infinity sign, inside the "
    "edges of a lane. Below, a histogram of their largest distances, which falls "
    "steeply to the right and ends before the edge of the lane.",
)

# %% tags=["claims"]
claim("cars_out", (errors > lane).sum(), equals=0)
claim("mean_largest", errors.mean(), above=0.05, below=0.058, unit="m")
claim("std_largest", errors.std(), above=0.009, below=0.011, unit="m")
claim("worst", errors.max(), above=0.09, below=0.12, unit="m")

# %% [markdown]
# All these laps were one call. In the mean over 4096 cars the largest distance from the path in a
# lap is {claim}`mean_largest`, and the worst car strays {claim}`worst`. Of all of them
# {claim}`cars_out` left the lane. Is the lane then wide enough? That is a question about the thin
# right end of the histogram, and we cannot answer it yet.

# %% [markdown]
# ## It fails: sixteen cars
#
# The chapters before drove 16 cars, or 64, and claimed numbers with wide margins. Now somebody asks
# for the mean of the largest distance to within 1 percent, and we drive 16 cars again.
# <!-- given: 1 percent -->
#
# **Predict.** How often is the mean of 16 cars within 1 percent of the true mean: nearly always,
# every second time, or once in six? <!-- given: 1 percent -->

# %% tags=["answer", "hide-input"]
truth = errors.mean()
groups = errors.unflatten(0, (256, 16)).mean(-1)  # 256 times sixteen cars
fig, ax = plt.subplots(figsize=(7, 2.6))
ax.hist(groups, bins=40, color=plotting.BLUE, label="means of 16 cars")
band = {"color": plotting.GREEN, "alpha": 0.3, "label": "within 1 percent"}
ax.axvspan(0.99 * truth, 1.01 * truth, **band)
ax.set(xlabel="mean of the largest distance (m)", ylabel="times", ylim=(0, 22))
ax.legend()
plotting.show(
    fig,
    "A histogram of the means of sixteen cars. It is several times as wide as a band "
    "of one percent to both sides of the true mean.",
)

# %% tags=["answer", "claims"]
close = ((groups / truth - 1).abs() < 0.01).double().mean()
claim("sixteen_close", 100 * close, above=8, below=27, unit="%")
claim("sixteen_low", groups.min(), above=0.044, below=0.051, unit="m")
claim("sixteen_high", groups.max(), above=0.057, below=0.065, unit="m")

# %% [markdown] tags=["answer"]
# About once in six: in {claim}`sixteen_close` of the cases. The means of 16 cars lie between
# {claim}`sixteen_low` and {claim}`sixteen_high`. Whoever drives 16 cars and changes the design
# until the mean has fallen by a tenth may have improved nothing but the luck.

# %% [markdown]
# ## The idea: one more dimension
#
# More cars are needed, and a loop over them is slow. In torch each operation on a tensor has a
# fixed price: Python calls it, torch looks at shapes and types and finds the right routine. Then
# come the numbers themselves, and they are cheap. A loop pays the fixed price for each car; a
# {term}`batch <Batch>` pays it once.

# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 3.2))
ax.set(xlim=(0, 10.4), ylim=(-0.1, 4.6), aspect="equal")
ax.axis("off")
for k in range(4):
    sketches.box(ax, 1.3, 3.6 - k, "call", width=1.2, height=0.7)
    sketches.box(ax, 2.6, 3.6 - k, "car", width=1.0, height=0.7)
sketches.word(ax, 0.7, 4.25, "a loop")
sketches.box(ax, 5.6, 3.6, "call", width=1.2, height=0.7)
for k in range(4):
    sketches.box(ax, 7.0 + 0.9 * k, 3.6, "car", width=0.9, height=0.7)
sketches.word(ax, 5.0, 4.25, "a batch")
sketches.word(ax, 5.0, 2.2, "shape of one state: (4,)")
sketches.word(ax, 5.0, 1.4, "of a batch: (cars, 4)")
sketches.word(ax, 5.0, 0.6, "of a map: (slips, noises, cars, 4)")
plotting.show(
    fig,
    "Sketch. A loop over four cars has four calls, each followed by one car. A batch "
    "has one call, followed by the four cars.",
)

# %% [markdown]
# The function `drive` works for one lap, `w` of shape $(T, 4)$, and for a batch of any shape in
# front of it, since it indexes from the right (`w[..., t, :]`) and asks no car an `if`. When a
# function is written for one car only, `torch.vmap` turns it into one for a batch: it calls the
# function once, with stand-ins for the numbers, and every operation inside sees the whole batch.


# %%
def last_place(w):
    """Returns where one lap (T, 4) ends, and how far from the start."""
    i, j, c, s = drive(w)[-1]  # works for one lap only
    return torch.stack([i, j]), torch.hypot(i, j)


places, distances = torch.vmap(last_place)(many[:64])
one_by_one = torch.stack([last_place(w)[0] for w in many[:64]])
print("shapes:", tuple(places.shape), tuple(distances.shape))
print("largest difference to a loop:", (places - one_by_one).abs().max().item())

# %% tags=["claims"]
claim("vmap_is_loop", (places - one_by_one).abs().max(), below=1e-12, unit="m")
in_batch = laps[:64, -1, :2]
claim("batch_is_loop", (in_batch - one_by_one).abs().max(), below=1e-12, unit="m")

# %% [markdown]
# ## What a batch buys, and when it stops
#
# If the fixed price of a step is $a$ and each car adds $b$, then $n$ cars take the time $a + b n$,
# and each of them
#
# $$ \text{time per car} = \frac{a}{n} + b $$ (eq-10-price)
#
# Up to about $n = a / b$ cars the first term rules, and twice as many cars cost hardly more. Beyond
# it the second one rules, and a larger batch buys nothing. The figure shows times that were
# *recorded* on one thread of one machine, not measured now: the step of a car with a gain, and
# plans of chapter 3, three sweeps each. <!-- given: twice, three sweeps -->

# %%
record = batches.record()
step_times = {int(n): seconds for n, seconds in record["step"].items()}
a = step_times[1]
b = step_times[100_000] / 100_000
print(f"a = {1e6 * a:.0f} us, b = {1e9 * b:.0f} ns, a / b = {a / b:.0f} cars")

# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 4))
plan_times = {}
for horizon, row in record["plan"].items():
    plan_times[horizon] = {int(n): seconds for n, seconds in row.items()}
marks = iter("sv^D")
for horizon, row in plan_times.items():
    each = [1e6 * z / n for n, z in row.items()]
    name = f"plan of {horizon} steps"
    ax.loglog(list(row), each, f"{next(marks)}-", ms=4, label=name)
sizes = list(step_times)
each = [1e6 * z / n for n, z in step_times.items()]
ax.loglog(sizes, each, "o-", ms=4, color="black", label="step of a car with a gain")
model = [1e6 * (a / n + b) for n in sizes]
ax.loglog(sizes, model, "--", color=plotting.GREY, label="a / n + b")
ax.set(xlabel="cars in the batch", ylabel="time per car (us)", ylim=(0.05, 1e5))
ax.legend(ncols=2, loc="upper right")
plotting.show(
    fig,
    "Time per car against the size of the batch, both axes logarithmic. All curves "
    "fall in straight lines at first and become level at some hundreds of cars.",
)
rows = []
for n in (1, 64, 4096, 100_000):
    seconds = plan_times["10"].get(n)
    plan = f"{1e6 * seconds / n:.0f}" if seconds else "not recorded"
    rows.append(f"{n} | {1e6 * step_times[n] / n:.3f} | {plan}")
display(table("cars | a step, per car (us) | a plan of 10 steps, per car (us)", rows))
print(f"Recorded on {record['date']}: {record['machine']}.")

# %% tags=["claims"]
claim("price_ratio", a / b, above=50, varies=True)
claim("gain_4096", 4096 * a / step_times[4096], above=50, varies=True)
plans = plan_times["10"]
claim("gain_plans", 4096 * plans[1] / plans[4096], above=20, varies=True)
per_step = plan_times["50"][4096] / 50 / (plan_times["5"][4096] / 5)
claim("longer_plans", per_step, above=0.5, below=3, varies=True)

# %% [markdown]
# In this record $a / b$ is {claim}`price_ratio` cars. A batch of 4096 makes a car's step
# {claim}`gain_4096` times as cheap as a car alone, and a hundred thousand are hardly better. A plan
# of 10 steps becomes {claim}`gain_plans` times as cheap. Its steps come one after the other, and
# no batch helps with that: a plan of 50 steps costs, per step and car, {claim}`longer_plans` times
# as much as one of 5. [Speed](benchmarks.md) shows batches beside other libraries.
# <!-- given: 10 steps, 50 steps, a hundred thousand -->
#
# Three things end the gain. The arithmetic itself, $b$, is the first. *Memory* is the second: all
# states of 100,000 cars are $100\,000 \cdot 129 \cdot 4$ numbers of 8 bytes, 0.4 GB. For the large
# numbers below we drive ten thousand cars at a time, and keep one number of each. The third are the
# *stragglers*: a batch that iterates goes on until its last member is done. Here 256 plans of
# chapter 3 run until each has converged. <!-- given: 0.4, ten thousand -->

# %%
goals = 1 + torch.arange(256) % 16
waypoints = infinity.waypoints()
starts = waypoints[goals - 1] + 0.163 * torch.randn(256, 4, generator=seed(1))
plans_256 = infinity.controller().solve(dt, starts, waypoints[goals])
sweeps = plans_256.iterations.double()
print("sweeps of a plan, mean:", sweeps.mean().item(), "most:", sweeps.max().item())

# %% tags=["claims"]
claim("sweeps_mean", sweeps.mean(), above=3, below=12)
claim("sweeps_most", sweeps.max(), above=1.2 * sweeps.mean().item())

# %% [markdown]
# A plan needs {claim}`sweeps_mean` sweeps in the mean, but the batch makes {claim}`sweeps_most`,
# the number of its slowest member. A limit such as "three sweeps" is the usual remedy.
# <!-- given: three sweeps -->
#
# ### Compilers and other devices
#
# The fixed price can be lowered, too. `torch.compile` records the operations of a function, writes
# one C++ routine for all of them, and compiles it. Numbers then pass through memory once, not once
# for each operation:
#
# ```python
# quick = torch.compile(turned)  # a sum of sines, cosines and exponentials
# quick(theta)                   # the first call compiles: it needs a C++ compiler, and time
# quick(theta)                   # all others run the compiled routine
# ```
#
# We do not run this here, because a reader may have no compiler. The next cell reads what it took
# in the record, for a hundred thousand numbers. <!-- given: a hundred thousand -->

# %%
plain = record["compiled"]["plain"]
quick = record["compiled"]["compiled"]
compiler = record["compiled"]["compiler"]
print(f"a call: {1e6 * plain:.0f} us plain, {1e6 * quick:.0f} us compiled")
calls = compiler / (plain - quick)
print(f"the compiler: {compiler:.1f} s, repaid after {calls:.0f} calls")

# %% [markdown]
# So it pays for a function that is called very often. (`mpc.compile()` of this library compiles a
# whole planner in the same spirit; its times are on the page [Speed](benchmarks.md).) A graphics
# processor, GPU, is the other way: its fixed price is higher, its price for each number far lower,
# so it needs larger batches. Draws that live on the GPU are all that `drive` needs:

# %%
if torch.cuda.is_available():
    w = many.to("cuda")
    apart = (drive(w).cpu() - laps).abs().max()
    print("4096 laps on", torch.cuda.get_device_name())
    print("largest difference to the CPU (m):", apart.item())
else:
    print("torch finds no GPU on this machine, so nothing was run here.")

# %% [markdown]
# ## Derived: how many laps for a claim
#
# Let $z_1, \dots, z_n$ be the results of $n$ laps with independent noise, such as the largest
# distances, with the true mean $\mu$ and the standard deviation $\sigma$. Variances of independent
# numbers add up, and a number that is divided by $n$ has its variance divided by $n^2$. So for
# their mean $\bar z$
#
# $$
# \text{var}(\bar z) = \frac{1}{n^2}\, n \sigma^2 = \frac{\sigma^2}{n}
# $$ (eq-10-variance)
#
# Its root $\sigma / \sqrt n$ is the {term}`standard error`. Half of the error needs four times the
# laps. By the central limit theorem $\bar z$ is nearly normally distributed, whatever the laps'
# own distribution is, and a normal number is within 1.96 standard deviations of its mean in 95 %
# of all cases. So the {term}`confidence interval`
# <!-- given: half, four times, 1.96 -->
#
# $$ \bar z \pm 1.96\, \frac{\sigma}{\sqrt n} $$ (eq-10-interval)
#
# contains $\mu$ in 95 % of all studies. We do not know $\sigma$ and use the sample's. For a claim
# of 1 percent, the half-width has to be $0.01\, \mu$; solved for $n$, <!-- given: 1 percent -->
#
# $$ n = \left( \frac{1.96\, \sigma}{0.01\, \mu} \right)^2 $$ (eq-10-laps)

# %%
mean = errors[:64].mean()  # a first look, at 64 laps
sigma = errors[:64].std()
needed = (1.96 * sigma / (0.01 * mean)) ** 2  # (10.4)
print("laps for a claim of 1 percent:", math.ceil(needed))

# %% [markdown]
# Is it true that 95 % of such intervals contain the mean? We drive 100,000 cars, put them into
# groups of 64, and look.

# %%
generator = seed(2)
pieces = []
for _ in range(10):
    w = torch.randn(10_000, T, 4, generator=generator)
    pieces.append(largest(w))
all_errors = torch.cat(pieces)
mu = all_errors.mean()

group = all_errors[:99_968].unflatten(0, (1562, 64))
means = group.mean(-1)
half_width = 1.96 * group.std(-1) / 64**0.5  # (10.3)
contains = (means - mu).abs() < half_width

# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 3))
k = torch.arange(60)
names = {True: "contains the mean", False: "misses it"}
colors = {True: plotting.BLUE, False: plotting.RED}
for hit in (True, False):
    which = contains[:60] == hit
    look = {"color": colors[hit], "label": names[hit], "fmt": "o" if hit else "s"}
    centres = means[:60][which]
    ax.errorbar(k[which], centres, half_width[:60][which], ms=3, lw=1, **look)
ax.axhline(mu, color="black", lw=0.8, ls="--", label="mean of 100,000 laps")
ax.set(xlabel="group of 64 laps", ylabel="mean, with interval (m)")
ax.set_ylim(0.047, 0.064)
ax.legend(ncols=3, loc="upper center")
plotting.show(
    fig,
    "Sixty intervals, each from 64 laps, around a dashed line. Nearly all of them "
    "cross the line; a few, in another colour, miss it.",
)

# %% tags=["claims"]
claim("laps_needed", math.ceil(needed), above=600, below=2200)
claim("coverage", 100 * contains.double().mean(), above=92, below=97, unit="%")
of_1500 = all_errors[:99_000].unflatten(0, (66, 1500)).mean(-1)
within_one = ((of_1500 / mu - 1).abs() < 0.01).double().mean()
claim("within_one", 100 * within_one, above=88, unit="%")
other = torch.diag(torch.tensor([1, 1, 0.3, 0.3, 0.02, 0.02]))
K_other, _ = pp.LQR(ideal, other, None, T).lqr_backward(x_ref[0], dt, u_ref, **aims)
changed = largest(many, K_other)
saving = (changed.var() + errors.var()) / (changed - errors).var()
claim("pairs", saving, above=10)

# %% [markdown]
# {claim}`coverage` of the intervals do. (It is a little less than 95 %, because 64 cars do not know
# $\sigma$ exactly.) And the first look is a good guide: it asks for {claim}`laps_needed` laps, and
# with 1500 of them {claim}`within_one` of the means were within 1 percent. An interval is a
# statement about the procedure: any single one either contains the mean or does not.
# <!-- given: 1 percent -->
#
# Two designs are best compared on the *same* draws, lap by lap: {term}`common random numbers`. What
# is bad luck for one is bad luck for the other and cancels in the difference. For gains with
# another price of the input this saves a factor of {claim}`pairs` in laps.

# %% [markdown]
# ## An honest interval for a share
#
# How many laps leave the lane is a share, $\hat p = k / n$. Its mean is the probability $p$, and
# its variance $p\,(1 - p) / n$, that of a coin. The simplest interval puts $\hat p$ in the place of
# $p$. But if no car has left the lane, $\hat p = 0$ and the interval is $0 \pm 0$: we would be
# sure that nothing can happen. Wilson's way {cite}`wilson1927` is to keep the unknown $p$ and to
# ask which $p$ would make our $\hat p$ a likely result:
#
# $$ (\hat p - p)^2 \le z^2\, \frac{p\,(1 - p)}{n}, \quad z = 1.96 $$ (eq-10-wilson)
#
# Collect the powers of $p$. It is a quadratic inequality,
#
# $$
# \left(1 + \tfrac{z^2}{n}\right) p^2 - \left(2 \hat p + \tfrac{z^2}{n}\right) p + \hat p^2 \le 0
# $$ (eq-10-quadratic)
#
# and holds between its two roots: the {term}`Wilson interval`.


# %%
def wilson(k, n, z=1.96):
    """Returns the interval of a probability, after k of n."""
    share = k / n
    square = 1 + z**2 / n  # (10.6): the factor of p squared
    linear = 2 * share + z**2 / n  # and that of p
    root = math.sqrt(linear**2 - 4 * square * share**2)
    return (linear - root) / (2 * square), (linear + root) / (2 * square)


# %% [markdown]
# **Predict.** None of our 4096 cars left the lane. What is the largest probability that still fits:
# one in a million, one in ten thousand, or one in a thousand?

# %% tags=["answer"]
low, high = wilson(0, 4096)
print("between", low, "and", high)

# %% tags=["answer", "claims"]
claim("none_of_4096", high, above=5e-4, below=2e-3)
something = 100 * (1 - (1 - 3 / 4096) ** 4096)
claim("three_over_n", something, above=94, below=96, unit="%")

# %% [markdown] tags=["answer"]
# One in a thousand: {claim}`none_of_4096`. For no event at all the roots are 0 and about $4 / n$.
# (A sharper argument gives $3 / n$, the *rule of three*: with $p = 3/n$ something would have
# happened in {claim}`three_over_n` of all studies.) "We saw none" is a weak statement. With two
# hundred thousand rounds a day, it allows for more than a hundred accidents a day. <!-- given: two
# hundred thousand -->

# %% [markdown]
# ## Rare events: drive where it happens
#
# For a rare event the standard error of the share is about $\sqrt{p / n}$, and relative to $p$
# itself $1 / \sqrt{p\, n}$. A probability of $10^{-5}$ to within 10 percent, at 1.96 standard
# errors, needs about 38 million laps, nearly all of which are spent on cars that are in no danger.
# Can we drive only the dangerous ones? <!-- given: 10 percent, 1.96 -->
#
# A small example first. What is the probability that a standard normal number $w$ exceeds 4? Draw
# from a normal distribution that is *shifted* by $\mu = 4$: about every second draw then exceeds 4.
# This makes the event far too frequent, but we know how much too frequent each draw is: by the
# quotient of the two densities, the new one over the old one. So we count each draw with the
# inverse quotient, its {term}`importance weight`:
#
# $$
# \frac{e^{-w^2/2}}{e^{-(w - \mu)^2/2}} = e^{\mu^2/2 - \mu w}
# $$ (eq-10-weight)
#
# A draw that exceeds 4 has its weight as value, any other draw has the value 0, and the mean over
# *all* draws is the probability. For the mean is an integral of value times density of the draws.
# In the product of this density and the weight, their quotient, it cancels, and the true density is
# left. This is {term}`importance sampling`.

# %%
w = torch.randn(1000, generator=seed(3))
plainly = (w > 4).double().mean()

shifted = w + 4
weights = torch.exp(4**2 / 2 - 4 * shifted)  # (10.7)
values = (shifted > 4) * weights
print("plain:     ", plainly.item())
error = 1.96 * values.std() / 1000**0.5
print("importance:", values.mean().item(), "+-", error.item())
print("exact:     ", torch.special.ndtr(torch.tensor(-4.0)).item())

# %% tags=["claims"]
exact = torch.special.ndtr(torch.tensor(-4.0))
claim("plain_sees", plainly, equals=0)
claim("shift_error", 100 * (values.mean() / exact - 1).abs(), below=20, unit="%")

# %% [markdown]
# A thousand plain draws see nothing. With the shift they give the probability to within
# {claim}`shift_error`.
#
# ### Where does a lap leave its lane?
#
# A lap has $4T = 512$ draws. Into which direction do we shift them? Ask for the *least unlikely*
# way to the edge: the draws of the smallest norm that bring the car there, the
# {term}`design point`. To first order the distance from the path after step $t$ is
# $e_t + g_t^\top w$, where $e_t$ is the distance without noise and $g_t$ its gradient by all draws.
# All $w$ with $e_t + g_t^\top w = b$ form a plane, and its point nearest to the origin is
#
# $$ \mu_t = \frac{b - e_t}{\lVert g_t \rVert^2}\, g_t $$ (eq-10-design)
#
# The gradients of all steps come from one call, since the whole lap can be differentiated:


# %%
def linear_model(gains):
    """Returns the e (T, 1) of all steps, and the gradients g (T, 4T)."""

    def distances(w):
        return infinity.tracking_error(drive(w, gains))[1:]  # after each step

    no_noise = torch.zeros(T, 4)
    g = torch.func.jacrev(distances)(no_noise)
    return distances(no_noise)[:, None], g.flatten(1)


# %%
def design_points(b, model):
    """Returns the shifts (2T, 4T) to the edge b, for every step and both sides."""
    e, g = model
    square = g.square().sum(-1, keepdim=True)
    this_side = g * (b - e) / square  # (10.8)
    other_side = -g * (b + e) / square
    return torch.cat([this_side, other_side])


model = linear_model(K)
points = design_points(lane, model)


# %% tags=["hide-input"]
nearest = points.norm(dim=-1).argmin()
fig, (top, bottom) = plotting.stacked(2, height=2.6, sharex=True)
time = dt * torch.arange(1, T + 1)
top.plot(time, points[:T].norm(dim=-1), label="this side")
top.plot(time, points[T:].norm(dim=-1), "--", label="other side")
top.set(ylabel="norm of the shift", ylim=(3, 12))
top.legend(loc="upper right")
along = infinity.tracking_error(drive(points[nearest].unflatten(0, (T, 4))))
bottom.plot(time, along[1:], label="with the nearest shift")
bottom.plot(time, model[0], ":", color=plotting.GREY, label="without noise")
bottom.axhline(lane, color="black", ls=":", lw=1, label="edge of the lane")
bottom.set(xlabel="time (s)", ylabel="distance from the path (m)", ylim=(0, 0.145))
bottom.legend(loc="upper left", ncols=3)
plotting.show(
    fig,
    "Above, the norm of the shift that brings the car to the edge at each time: "
    "large at the start, then nearly level, and smaller at the end. Below, the lap "
    "with the nearest shift rises to the edge of the lane in its last steps.",
)

# %% tags=["claims"]
claim("nearest_norm", points[nearest].norm(), above=4, below=5)
claim("reaches", along.max(), equals=lane, within=0.006, unit="m")
claim("left_at", time[nearest % T], above=12.5, unit="s")

# %% [markdown]
# The nearest shift has a norm of {claim}`nearest_norm`, and with it the car strays
# {claim}`reaches`: the linear model is good. It leads out of the lane after {claim}`left_at`, at
# the very end. There the gains of LQR fade, as chapter 2 has shown, since no cost follows. We keep
# this in mind.
#
# A lap can leave its lane at any time and to either side, though. So we draw from a *mixture*:
# choose one of the $2T$ shifts at random, a near one more often, and add standard normal numbers.
# The density of the draws is then a sum over all shifts, with the probabilities $\alpha_m$ of the
# choice. By {eq}`eq-10-weight`, for each term of the sum, the weight of a lap is
#
# $$
# \frac{1}{\sum_m \alpha_m\, e^{\mu_m^\top w - \lVert \mu_m \rVert^2/2}}
# $$ (eq-10-mixture)
#
# For $\alpha_m$ we take the probabilities to be beyond the planes, divided by their sum
# {cite}`owen2019`. Along the direction of $\mu_m$ the draws are a single standard normal number,
# and beyond the plane it exceeds $\lVert \mu_m \rVert$: the probability is
# $\Phi(-\lVert \mu_m \rVert)$, where $\Phi$ is the normal distribution function (`ndtr` in torch).
# If the linear model were wrong, the weights would still be right: it only decides where to look.


# %%
def rare(b, laps, generator, gains=K, model=model):
    """Returns a value for each lap; their mean is the probability to exceed b."""
    mu = design_points(b, model)
    norm = mu.norm(dim=-1)
    alpha = torch.special.ndtr(-norm)
    alpha = alpha / alpha.sum()
    chosen = torch.multinomial(alpha, laps, replacement=True, generator=generator)
    w = mu[chosen] + torch.randn(laps, 4 * T, generator=generator)
    weight = 1 / (torch.exp(w @ mu.mT - norm**2 / 2) @ alpha)  # (10.9)
    return (largest(w.unflatten(-1, (T, 4)), gains) > b) * weight


values = rare(lane, 4096, seed(4))
error = 1.96 * values.std() / 4096**0.5
print("probability to leave the lane:", values.mean().item(), "+-", error.item())

# %% tags=["hide-input"]
bounds = torch.arange(0.06, 0.1501, 0.01)
plain_low = []
plain_high = []
found = []
spread = []
for b in bounds:
    k = (all_errors > b).sum().item()
    low, high = wilson(k, 100_000)
    plain_low.append(low)
    plain_high.append(high)
    each = rare(b, 2048, seed(5))
    found.append(each.mean())
    spread.append(1.96 * each.std() / 2048**0.5)
found = torch.stack(found)
spread = torch.stack(spread)
fig, ax = plt.subplots(figsize=(7, 4))
for k, b in enumerate(bounds):
    tip = [max(plain_low[k], 1e-9), plain_high[k]]
    ax.plot([b, b], tip, color=plotting.RED, lw=4, alpha=0.5)
ax.lines[0].set_label("100,000 plain laps, Wilson interval")
bars = {"fmt": "o-", "ms": 4, "color": plotting.BLUE, "capsize": 3}
ax.errorbar(bounds, found, spread, label="2048 laps, importance sampling", **bars)
ax.axvline(lane, color="black", ls=":", lw=1, label="edge of the lane")
ax.set(yscale="log", ylim=(1e-9, 2))
ax.set(xlabel="bound (m)", ylabel="probability to exceed it in a lap")
ax.legend(loc="lower left")
plotting.show(
    fig,
    "The probability that a lap exceeds a bound, against the bound, on a logarithmic "
    "axis. Importance sampling gives a smooth curve down to a hundred millionth. The "
    "plain intervals lie on it at first, and then reach down to zero.",
)
rows = []
for k in (2, 4, 6, 9):
    low = f"{plain_low[k]:.1e}" if plain_low[k] > 1e-9 else "0"
    interval = f"{low} to {plain_high[k]:.1e}"
    rows.append(f"{bounds[k]:.2f} | {interval} | {found[k]:.2e} | {spread[k]:.0e}")
head = "bound (m) | 100,000 plain laps | importance sampling | its error"
display(table(head, rows))

# %% tags=["claims"]
lane_chance = values.mean()
claim("leaves", lane_chance, above=6.5e-6, below=9.5e-6)
claim("leaves_error", 100 * error / lane_chance, below=14, unit="%")
agree = []
for k, b in enumerate(bounds[:5]):
    low, high = wilson((all_errors > b).sum().item(), 100_000, z=4)
    agree.append(low < found[k] + 2 * spread[k] and found[k] - 2 * spread[k] < high)
claim("agree", sum(agree), equals=5)
claim("plain_out", (all_errors > lane).sum(), below=6)
union = torch.special.ndtr(-points.norm(dim=-1)).sum()
claim("below_the_sum", lane_chance / union, above=0.5, below=1)
claim("rarest", found[-1], above=1e-8, below=2.2e-8)
relative = values.std() / lane_chance
saved = (1 - lane_chance) / lane_chance / relative**2
claim("saved", saved, above=5000)

# %% [markdown]
# A lap leaves the lane with a probability of {claim}`leaves`, up to {claim}`leaves_error`. The
# fleet of the beginning, with two hundred thousand rounds a day, would see it once or twice a day.
# In the 100,000 plain ones it happened {claim}`plain_out` times. For the same error plain
# simulation would need {claim}`saved` times as many laps; where both can be compared, at the first
# five bounds, they agree. And there is a check from above: the sum of the probabilities of all
# planes counts a lap that is out for several steps several times. Our number is
# {claim}`below_the_sum` of it. Move the slider to see the laps that decide.
# <!-- given: two hundred thousand, twice -->


# %% tags=["hide-input"]
def leavers(b):
    mu = design_points(b, model)
    alpha = torch.special.ndtr(-mu.norm(dim=-1))
    chosen = torch.multinomial(alpha / alpha.sum(), 60, True, generator=seed(6))
    w = mu[chosen] + torch.randn(60, 4 * T, generator=seed(7))
    distance = infinity.tracking_error(drive(w.unflatten(-1, (T, 4))))
    out = distance.amax(-1) > b
    fig, ax = plt.subplots(figsize=(7, 3.4))
    time = dt * torch.arange(T + 1)
    ax.plot(time, distance[~out].mT, color=plotting.GREY, lw=0.5, alpha=0.6)
    ax.plot(time, distance[out].mT, color=plotting.RED, lw=0.8)
    ax.plot([], [], color=plotting.RED, label="exceeds the bound")
    ax.plot([], [], color=plotting.GREY, label="does not")
    ax.axhline(b, color="black", ls=":", label="bound")
    ax.set(xlabel="time (s)", ylabel="distance from the path (m)", ylim=(0, 0.2))
    ax.legend(loc="upper left", ncols=3)
    return fig


# %% tags=["hide-input"]
alt = "The distance from the path over time, of laps that were drawn for a bound."
edges = [0.08, 0.1, 0.12, 0.15]
display(teaching.widgets.panels(leavers, edges, "bound (m)", alt=alt))

# %% [markdown]
# Now to the end of the lap. A terminal cost keeps the gains alive (chapter 3). What is it worth?

# %%
caring = pp.LQR(ideal, Q, None, T, Qf=10 * Q[:4, :4])
K_caring, _ = caring.lqr_backward(x_ref[0], dt, u_ref, **aims)
mended = rare(lane, 4096, seed(9), K_caring, linear_model(K_caring))
error = 1.96 * mended.std() / 4096**0.5
print("with a terminal cost:", mended.mean().item(), "+-", error.item())

# %% tags=["claims"]
claim("mended", mended.mean(), above=6e-7, below=1.3e-6)
claim("safer", lane_chance / mended.mean(), above=4)
many_caring = largest(many, K_caring)
change = 100 * (1 - many_caring.mean() / errors.mean())
claim("mean_change", change, above=-5, below=10, unit="%")

# %% [markdown]
# The probability falls to {claim}`mended`, by a factor of {claim}`safer`. The mean of the largest
# distance falls by {claim}`mean_change`: in the mean one hardly sees what decides about accidents.

# %% [markdown]
# ## A map of noise and slip
#
# One more use of a batch. How does the share of cars that leave the lane depend on slip and noise?
# A grid of both is two more dimensions in front, and the whole map is one call. All places of the
# map share their draws, so that it is smooth.

# %%
slips = torch.linspace(0, 0.4, 9)
noises = torch.linspace(0.004, 0.04, 10)
w = torch.randn(128, T, 4, generator=seed(8)).expand(9, 10, 128, T, 4)
cars = pp.DubinsCar(dt, slips[:, None, None])
everywhere = drive(w, car=cars, noise=noises[:, None, None])
out = infinity.tracking_error(everywhere).amax(-1) > lane  # (9, 10, 128)
share_out = out.double().mean(-1)
del w, everywhere

# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 4))
look = {"shading": "nearest", "cmap": "Blues", "vmin": 0, "vmax": 1, "alpha": 0.6}
mesh = ax.pcolormesh(noises, slips, share_out, **look)
levels = [0.05, 0.5, 0.95]
lines = ax.contour(noises, slips, share_out, levels, colors="black", linewidths=1)
ax.clabel(lines, fmt=lambda level: f"{100 * level:.0f} %")
ours = {"ms": 14, "color": plotting.ORANGE, "label": "the car of this chapter"}
ax.plot(0.01, 0.05, "*", **ours)
ax.set(xlabel="noise of a step (standard deviation)", ylabel="slip")
fig.legend(loc="outside upper center")
ax.grid(False)
fig.colorbar(mesh, ax=ax, label="share of laps that leave the lane")
plotting.show(
    fig,
    "A map with noise to the right and slip upward. The share of laps that leave the "
    "lane rises from none in the lower left to all at the right and at the top.",
)

# %% tags=["claims"]
claim("map_laps", out.numel(), equals=11520)
claim("map_corner", share_out[0, 0], equals=0)
claim("map_far", share_out[-1, -1], above=0.95)
falls = min(share_out.diff(dim=0).min(), share_out.diff(dim=1).min())
claim("map_falls", falls, above=-0.05)

# %% [markdown]
# The map is made of {claim}`map_laps` laps. It shows at a glance what single numbers hide: noise
# and slip do harm together, and the lines bend. With 128 cars a place the map can show a share of 5
# percent, and not one of a millionth. <!-- given: 5 percent -->

# %% [markdown]
# ## More than one process, and more than one machine
#
# A batch uses one process. To use more of them, cut the study into *tasks*. Four rules make it safe
# to do so:
#
# 1. **A task is a number.** All that it draws comes from a generator that is made of the study's
#    seed and this number, so a task gives the same result wherever and whenever it is done.
# 2. **A result is a file** that is written whole or not at all: under another name first, which is
#    then changed. Such a file is a {term}`checkpoint`.
# 3. **What is there is not done again.** Starting a study and resuming it are the same call.
# 4. **A folder belongs to its settings**, and refuses the results of others.
#
# Dask {cite}`rocklin2015dask` hands tasks to *workers*, which are processes on this machine or on
# others. Its *scheduler* notices when one dies, and gives its tasks to another one.

# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 3.2))
ax.set(xlim=(0, 10.6), ylim=(-0.2, 4.4), aspect="equal")
ax.axis("off")
sketches.box(ax, 1.4, 2.2, "study.run", width=2.3)
sketches.box(ax, 1.4, 0.4, "files", width=2.3)
sketches.box(ax, 5.0, 2.2, "scheduler", width=2.3)
for k in range(3):
    sketches.box(ax, 8.9, 3.8 - 1.6 * k, "worker", width=2.0)
    sketches.arrow(ax, (6.15, 2.4 - 0.1 * k), (7.9, 3.8 - 1.6 * k), width=1.2)
sketches.arrow(ax, (2.55, 2.4), (3.85, 2.4))
sketches.arrow(ax, (3.85, 2.0), (2.55, 2.0), plotting.BLUE)
sketches.arrow(ax, (1.4, 1.8), (1.4, 0.8), plotting.BLUE)
sketches.word(ax, 2.55, 2.75, "tasks")
sketches.word(ax, 2.5, 1.35, "results", plotting.BLUE)
plotting.show(
    fig,
    "Block diagram. The function study.run sends tasks to a scheduler, which hands "
    "them to three workers; results come back and are written into files.",
)


# %% [markdown]
# First without workers. The study stops half way, as if the power had failed, and is called again:


# %%
def laps_of(task, seed, laps):
    """Returns the largest distances of the laps of one task."""
    generator = study.generator(seed, task)
    return largest(torch.randn(laps, T, 4, generator=generator))


# %%
def power_cut(done):
    if done == 4:
        raise InterruptedError("the power has failed")


settings = {"seed": 7, "laps": 500}
folder = Path(tempfile.mkdtemp())
try:
    study.run(laps_of, range(8), settings, folder / "here", progress=power_cut)
except InterruptedError:
    print("files that are left:", len(list((folder / "here").glob("*.pt"))))
done_now = []
again = {"settings": settings, "folder": folder / "here", "progress": done_now.append}
here = study.run(laps_of, range(8), **again)
print("tasks that were done after that:", len(done_now))

# %% [markdown]
# Now with two worker processes, one of which is killed after three results.


# %%
def accident(done):
    if done == 3:
        study.kill_a_worker(client)
        print("a worker was killed")


with study.workers(2) as client:
    there = study.run(laps_of, range(8), settings, folder / "there", client, accident)

same = [torch.equal(a, b) for a, b in zip(here, there)]
print("results that are equal to the last bit:", sum(same), "of", len(same))

# %% tags=["claims"]
claim("done_again", len(done_now), equals=4)
claim("equal_bits", sum(same), equals=8)
claim("different_tasks", torch.stack(here).unique(dim=0).shape[0], equals=8)

# %% [markdown]
# After the power cut only {claim}`done_again` tasks were left to do. And with other processes, in
# another order, and with one of them killed, {claim}`equal_bits` of 8 results are the same to the
# last bit. For this a task computes on one thread: with more of them a sum may be added up in
# another order, and its last digits change. (Another kind of processor may round differently, too;
# there the results agree up to rounding.)
#
# For many machines, start a scheduler on one of them and workers on all, and give `study.workers`
# the address:
#
# ```
# dask scheduler                          # prints its address
# dask worker tcp://10.0.0.5:8786         # on each machine, with this library installed
# ```
#
# ```python
# with study.workers(address="tcp://10.0.0.5:8786") as client:
#     results = study.run(laps_of, range(1000), settings, folder, client)
# ```
#
# The files are written by the process that calls `run`, so the machines share no disk. A scheduler
# asks nobody for a password, and whoever reaches it can run programs on its workers. Start it in a
# network that you trust, or with the certificates that Dask's documentation describes.

# %% [markdown]
# ## What goes wrong: a seed that is shared
#
# **Predict.** A study of 8 tasks gives each of them the generator `seed(7)`. Everything runs, each
# result looks right, and we compute {eq}`eq-10-interval` from all of the 4000 cars. Is the interval
# too wide, too narrow, or right?

# %% tags=["answer"]
copies = []
for _ in range(8):
    copies.append(largest(torch.randn(500, T, 4, generator=seed(7))))
copies = torch.cat(copies)
claimed = copies.std() / 4000**0.5
actual = copies[:500].std() / 500**0.5
print("different laps:", len(copies.unique()))
print("true standard error, divided by the claimed one:", (actual / claimed).item())

# %% tags=["answer", "claims"]
claim("different_laps", len(copies.unique()), equals=500)
claim("too_narrow", actual / claimed, above=2.7, below=2.95)
claim("own_seeds", torch.cat(here).unique().numel(), equals=4000)

# %% [markdown] tags=["answer"]
# Too narrow, by a factor of {claim}`too_narrow`: there are only {claim}`different_laps` different
# laps. With a seed for each task there are {claim}`own_seeds`. Nothing warns, because each result
# is right by itself. A test that asks for different draws finds it at once. (Seeds drawn at random
# would not be safe either: torch's generator keeps 32 bits of a seed, and of a hundred thousand
# such numbers two are probably equal. `study.generator` counts them.)

# %% [markdown]
# Two more mistakes of this kind are common. *Stopping when it looks good*: if you look at the
# interval after every ten laps and stop at the first one that suits you, it no longer has its 95 %.
# Decide the number of laps before. And *one number for two purposes*: a seed that was chosen
# because its picture is nice must not be the seed of the claim. <!-- given: ten laps -->

# %% [markdown]
# ## Summary
#
# 1. A batch pays Python's fixed price once: in our record a car's step in a batch of 4096 is
#    {claim}`gain_4096` times as cheap as alone. Beyond a few hundred cars the gain ends.
# 2. The standard error is $\sigma / \sqrt n$. A claim of 1 percent about the mean needs
#    {claim}`laps_needed` laps here, and 16 cars give it in {claim}`sixteen_close` of the cases.
# 3. A share needs Wilson's interval: after none of 4096 cars the probability may still be
#    {claim}`none_of_4096`.
# 4. Importance sampling drives where it happens, at the design points that a gradient finds: a lap
#    leaves the lane with a probability of {claim}`leaves`, found with {claim}`saved` times fewer
#    laps than plainly.
# 5. With a seed for each task and a file for each result, a study survives killed workers, and
#    {claim}`equal_bits` of 8 results keep every bit. <!-- given: 1 percent -->
#
# **Against the paper.** There is no number to compare with: the paper has no study of this kind.
#
# **What differs from PyPose.** In PyPose 0.9.5 matrices, poses and linear systems take batches. Its
# `MPC` plans for one car at a time where the system is nonlinear, and its EKF takes one state at a
# time ([the appendix](to_pypose.py) shows it).
#
# **Words of this chapter.** {term}`Monte Carlo method`, {term}`standard error`,
# {term}`confidence interval`, {term}`common random numbers`, {term}`Wilson interval`,
# {term}`importance sampling`, {term}`importance weight`, {term}`design point`, {term}`checkpoint`.
#
# **Further reading.** Owen's book on Monte Carlo {cite}`owen2013`, chapters 2, 8 and 9, is free to
# read; Rubino and Tuffin {cite}`rubino2009` treat rare events; the page on
# [Dask's futures](https://docs.dask.org/en/stable/futures.html) has all that `study.py` uses.
#
# **In [the lab](../exercises/10_thousands.py)** you turn a loop into a batch, say how many
# laps a claim needs, write an interval for a share, find a rare event, give each task its seed, and
# resume a study that was killed.
