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
# # Curves and poses
#
# A robot is often given a few places and has to find a smooth way through them: a machine tool
# along an edge, a camera drone along a wall, a delivery robot down a street. The usual answer is a
# {term}`spline`, a curve made of simple pieces that fit together. The outlines of the letters that
# you are reading are splines, too. In this chapter you build them for points, and then for *poses*,
# which are places with a direction. With them our car gets a way back to its path when something
# has pushed it aside.
#
# After this chapter you can
#
# - draw a smooth curve through waypoints, in a few short functions of your own;
# - say what a continuous curvature costs, and choose between the four usual splines;
# - plan from where the car is, and merge with the path that it should be on;
# - compute with poses: hat, exponential, logarithm and adjoint, in the plane and in space;
# - measure the order at which a spline converges, and explain the result.
#
# You need [chapter 1](01_systems.py) (the car) and [chapter 3](03_mpc.py) (the loop). Take about 60
# minutes, and 20 more for "Poses in space" and "Uncertain poses", which you may skip at first; the
# latter takes up the covariance of [chapter 4](04_ekf.py). The chapter reproduces Fig. 4 (a) of the
# paper {cite}`pypose06`. <!-- given: 60 minutes -->

# %% tags=["setup"]
import math

import ipywidgets
import matplotlib.pyplot as plt
import torch
from IPython.display import display

import pypose_lite as pp
from pypose_lite import infinity, lie, splines
from pypose_lite.splines import planner
from pypose_lite.teaching import claim, plotting, sketches, table, widgets

plotting.use_style()
torch.set_default_dtype(torch.float64)

# %% [markdown]
# The planner of this chapter gets the state of the car, the waypoints of the infinity, which are
# places with headings, and the number of the next waypoint. It returns `count` states along a
# curve, `spacing` metres apart:

# %%
waypoints = infinity.waypoints()  # (17, 4): i, j, cos, sin
places = waypoints[:, :2]
pushed = waypoints[0] + torch.tensor([-0.3, 0.2, 0.0, 0.0])  # the first one, moved
blue = pp.local_plan(waypoints[0], waypoints, 1, spacing=0.1, count=126)
red = pp.local_plan(pushed, waypoints, 1, spacing=0.1, count=20)

# %% tags=["hide-input"]
circles = infinity.reference(torch.linspace(0, infinity.LENGTH, 200))
fig, ax = plt.subplots(figsize=(7, 4.3))
plotting.plot_reference(plotting.infinity_axes(ax), circles, label="two circles")
plotting.plot_states(ax, blue, label="plan")
plotting.plot_states(ax, red, "plan of a car that was pushed aside", plotting.RED)
plotting.plot_heading(ax, waypoints, length=0.3)
ax.plot(*pushed[:2], "s", color=plotting.RED, ms=8, label="the car")
fig.legend(loc="outside lower center", ncols=2)
plotting.show(
    fig,
    "The infinity sign with its waypoints as arrows. One plan follows the circles; "
    "another one starts beside the path and joins the first at the next waypoint.",
)

# %% tags=["claims"]
off = infinity.tracking_error
claim("plan_off_circles", 1e6 * off(blue).max(), below=10, unit="µm")
claim("pushed_off", off(red[0]), above=0.1, unit="m")
claim("merged_off", 1e6 * off(red[-5:]).max(), below=10, unit="µm")

# %% [markdown]
# The arrows are the waypoints with their headings. The blue plan lies on the orange circles, to
# {claim}`plan_off_circles`. The red one starts at the square, {claim}`pushed_off` beside the path.
# It leaves in the car's direction, bends, and from the next waypoint on it *is* the blue one.
# Nobody told the planner that there are circles.

# %% [markdown]
# ## It fails: points without a curve
#
# The loop of chapter 3 aims at the next waypoint until the car is there, and then at the one after
# it.

# %%
mpc = infinity.controller()
mpc.stepper = pp.utils.ReduceToBason(steps=3)  # three sweeps a plan, as in chapter 3
hops = infinity.drive(mpc)


# %% tags=["hide-input"]
def plot_laps(laps, dt=0.1):
    """Draws the ways of some laps, and below them the inputs."""
    fig, axes = plt.subplots(3, 1, figsize=(7, 7.4), height_ratios=[1.5, 1, 1])
    plotting.plot_waypoints(plotting.infinity_axes(axes[0]), waypoints)
    for (name, run), color in zip(laps.items(), [plotting.GREY, plotting.BLUE]):
        plotting.plot_states(axes[0], run.x, label=name, color=color)
        for ax, column in zip(axes[1:], run.u.mT):
            time = dt * torch.arange(len(column))
            ax.plot(time, column, ".-", color=color, ms=4)
    axes[1].set(xlabel="time (s)", ylabel="speed (m/s)")
    axes[2].set(xlabel="time (s)", ylabel="turn rate (rad/s)")
    handles, labels = axes[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=3)
    return fig


fig = plot_laps({"aims at points": hops})
plotting.show(
    fig,
    "A lap on the map, and below it the speed and the turn rate, which rise and "
    "fall at every waypoint.",
)

# %% tags=["claims"]
claim("slowest_hop", hops.u[1:, 0].min(), below=1, unit="m/s")
claim("fastest_hop", hops.u[:, 0].max(), above=4, unit="m/s")
middles = (places[1:] + places[:-1]) / 2
claim("chord_off", 1000 * off(middles).max(), above=70, below=80, unit="mm")

# %% [markdown]
# The car hops. Its speed rises to {claim}`fastest_hop`, falls to {claim}`slowest_hop` and rises
# again, and its turn rate swings. No passenger would stand it. The first remedy that comes to mind
# is more points, on the straight lines between the waypoints. But the middle of each line lies
# {claim}`chord_off` inside its circle, and at every waypoint the direction turns by 45 degrees on
# the spot, which no car can do. We want points as dense as we like, on a curve that has *one*
# direction everywhere.

# %% [markdown]
# ## The idea: pieces that share their ends
#
# Join neighbouring waypoints by short pieces of a simple form. Where two pieces meet, give them the
# same point and the same derivative; then the whole curve has no corner. The derivative at a
# waypoint is called a {term}`tangent`. Here are three points $p_k$ with their tangents $m_k$:

# %% tags=["hide-input"]
ends = torch.tensor([[0.0, 0.0], [3.0, 1.2], [6.0, 0.0]])
arrows = torch.tensor([[1.5, 2.6], [3.0, -0.6], [1.8, -2.4]])
sketch = splines.hermite(ends, arrows)
fig, ax = plt.subplots(figsize=(7, 3.6))
t = torch.linspace(0, 1, 50)
ax.plot(*sketch(t).mT, lw=3, label="first piece")
ax.plot(*sketch(1 + t).mT, "--", lw=3, color=plotting.GREEN, label="second piece")
inner = [ends[0] + arrows[0] / 3, ends[1] - arrows[1] / 3]
polygon = torch.stack([ends[0], *inner, ends[1]])
label = "control polygon of the first piece"
ax.plot(*polygon.mT, "s:", color=plotting.GREY, label=label)
for k in range(3):
    sketches.arrow(ax, ends[k], ends[k] + 0.5 * arrows[k], color=plotting.RED)
    sketches.word(ax, *(ends[k] + torch.tensor([-0.25, -0.4])), f"$p_{k}$")
    tip = ends[k] + 0.5 * arrows[k] + torch.tensor([0.1, 0.1])
    sketches.word(ax, *tip, f"$m_{k}$", plotting.RED)
ax.plot(*ends.mT, "ko", ms=7)
ax.set(xlabel="i (m)", ylabel="j (m)", aspect="equal")
ax.set(xlim=(-0.4, 7.6), ylim=(-1.6, 2))
ax.legend(loc="upper right")
plotting.show(
    fig,
    "Two pieces of a curve through three points. The tangents are arrows, drawn at "
    "half their length; both pieces share the one in the middle. A polygon of four "
    "corners encloses the first piece.",
)

# %% tags=["claims"]
before = sketch(torch.tensor([1 - 1e-9]), derivative=1)
after = sketch(torch.tensor([1.0]), derivative=1)
claim("sketch_fits", (after - before).abs().max(), below=1e-7)

# %% [markdown]
# (The arrows are drawn at half their length.) The dotted line is the {term}`control polygon` of
# the first piece: its inner corners lie a third of a tangent away from the ends. The piece stays
# within the polygon's convex hull, the shape of a rubber band around its corners. Drawing programs
# let you pull at these corners; the same piece, given by its polygon, is called a
# *cubic {term}`Bézier curve`*. <!-- given: half, a third -->

# %% [markdown]
# ## Derived: Hermite's cubic
#
# A piece leads from a point $p_0$ to a point $p_1$ while a parameter $u$ runs from 0 to 1. (In this
# chapter $u$ is not an input.) At the ends we also want the tangents $m_0$ and $m_1$. These are
# four wishes, so take a polynomial with four coefficients, $p(u) = a + b u + c u^2 + d u^3$. The
# wishes are
#
# $$
# \begin{aligned}
# p(0) &= a = p_0, & p(1) &= a + b + c + d = p_1, \\
# p'(0) &= b = m_0, & p'(1) &= b + 2c + 3d = m_1.
# \end{aligned}
# $$ (eq-6-wishes)
#
# The left column gives $a$ and $b$. Write $\Delta = p_1 - p_0$. The right column says
# $c + d = \Delta - m_0$ and $2c + 3d = m_1 - m_0$. The first multiplied by 3, minus the second,
# is $c$; the rest is $d$:
#
# $$
# \begin{aligned}
# c &= 3 \Delta - 2 m_0 - m_1 \\
# d &= m_0 + m_1 - 2 \Delta
# \end{aligned}
# $$ (eq-6-hermite)
#
# This is a piece of a {term}`cubic Hermite spline`. Sorted by the data instead of by powers of $u$,
# it is a sum of four fixed functions, the *Hermite basis*, each times one of $p_0$, $m_0$, $p_1$,
# $m_1$. You find them in the lab.
#
# **Which tangents?** Where nothing is known but the points, a natural choice is the direction from
# the last point to the next:
#
# $$ m_i = \tfrac12 (p_{i+1} - p_{i-1}) $$ (eq-6-central)
#
# and at both ends, where a neighbour is missing, the only difference that there is. This is the
# {term}`Catmull-Rom spline`. PyPose calls it `chspline`.

# %% [markdown]
# ## From scratch: the Catmull-Rom spline


# %%
def hermite_piece(p0, p1, m0, m1, u):
    """Returns the points at u (k,) between p0 and p1, (k, d)."""
    u = u[:, None]
    step = p1 - p0
    c = 3 * step - 2 * m0 - m1  # (6.2)
    d = m0 + m1 - 2 * step
    return p0 + m0 * u + c * u**2 + d * u**3


def catmull_rom(p):
    """Returns the tangents (N, d) at the points p (N, d)."""
    leg = p.diff(dim=0)
    inner = (leg[1:] + leg[:-1]) / 2  # (6.3)
    return torch.cat([leg[:1], inner, leg[-1:]])


# %%
def my_chspline(p, k):
    """Returns k samples of each piece, and the last point."""
    m = catmull_rom(p)
    u = torch.arange(k) / k
    pieces = []
    for i in range(len(p) - 1):
        pieces.append(hermite_piece(p[i], p[i + 1], m[i], m[i + 1], u))
    return torch.cat([*pieces, p[-1:]])


# %% [markdown]
# ## The library's splines
#
# `pp.chspline` gives the samples of `my_chspline`, for batches of point sequences, too. The call
# with `interval` is the paper's: 0.2 means five samples a piece. <!-- given: 0.2 -->

# %%
points = pp.chspline(places, interval=0.2)
difference = (points - my_chspline(places, 5)).abs().max()
print("largest difference to ours (m):", difference.item())

# %% tags=["claims"]
claim("same_points", difference, below=1e-14)
generator = torch.Generator().manual_seed(0)
many = places + 0.1 * torch.randn(64, 17, 2, generator=generator)
one_by_one = torch.stack([pp.chspline(each, 0.2) for each in many])
apart = pp.chspline(many, 0.2) - one_by_one
claim("batch", apart.abs().max(), below=1e-12, unit="m")

# %% [markdown]
# Behind it stands the class `splines.Spline`. It keeps, for each piece, a start and *three steps*
# $s_1, s_2, s_3$, the sides of the control polygon, and the shares $\lambda$ of them that are done
# at $u$: <!-- given: three steps -->
#
# $$
# \begin{aligned}
# p(u) = \text{start} &+ \lambda_1(u)\, s_1 + \lambda_2(u)\, s_2 \\
# &+ \lambda_3(u)\, s_3
# \end{aligned}
# $$ (eq-6-steps)
#
# For Hermite's cubic $s_1 = m_0/3$, $s_3 = m_1/3$ and $s_2$ is what remains of $\Delta$. The shares
# rise from 0 to 1: $\lambda_1 = 1 - (1 - u)^3$, $\lambda_2 = 3 u^2 - 2 u^3$ and $\lambda_3 = u^3$.
# Why steps and not a sum of points? A step still makes sense for poses, where a sum does not. Here
# is where our functions are in the library's folder `splines`:
#
# | ours | the library's | in the file |
# |:--|:--|:--|
# | `catmull_rom` | `catmull_rom`, for points at any times | `cubic_hermite.py` |
# | `hermite_piece` | `hermite_segments`, which returns a `Spline` | `cubic_hermite.py` |
# | its line with `u` | `Spline.local`, with two derivatives | `curve.py` |
# | `my_chspline` | `hermite(points).sample(interval)` | `cubic_hermite.py` |
#
# A `Spline` is evaluated anywhere: `curve(t)` gives points, `curve(t, derivative=1)` velocities
# $(i', j')$ and `curve(t, derivative=2)` accelerations $(i'', j'')$. The direction of the velocity
# is the heading. How much the heading turns per metre is the {term}`curvature` $\kappa$, the
# inverse radius of the turn. Differentiate the heading, the angle of $(i', j')$, by the parameter,
# and divide by the metres per parameter, $\sqrt{i'^2 + j'^2}$:
#
# $$ \kappa = \frac{i' j'' - j' i''}{(i'^2 + j'^2)^{3/2}} . $$ (eq-6-curvature)
#
# At speed $v$ a car has to turn at the rate $v \kappa$. Where the curvature jumps, so must its
# turn rate.

# %% [markdown]
# ## What a continuous curvature costs
#
# Railways know this: where a straight track meets a circular one directly, the curvature jumps, and
# everybody on board is thrown to the side. The Catmull-Rom spline has such jumps at its points, for
# only its first derivative is continuous. Can the second one be continuous, too? It can, in two
# ways, and each of them loses something.
#
# ### Through the points: the natural cubic spline
#
# Keep Hermite's pieces, and choose the tangents so that the second derivative does not jump. A
# piece ends with $p'' = 2c + 6d$, and the next one starts with $p'' = 2c$, with a $c$ of its own.
# By {eq}`eq-6-hermite` the first is $-6 (p_i - p_{i-1}) + 2 m_{i-1} + 4 m_i$, and the second is
# $6 (p_{i+1} - p_i) - 4 m_i - 2 m_{i+1}$. They are equal if
#
# $$ m_{i-1} + 4 m_i + m_{i+1} = 3 (p_{i+1} - p_{i-1}) . $$ (eq-6-natural)
#
# That is one equation for each inner point. At both ends we ask for a second derivative of zero:
# $2 m_0 + m_1 = 3 (p_1 - p_0)$, and the like at the last point. Together they are a linear system
# for all tangents, and its solution is the {term}`natural cubic spline`. The name spline comes from
# the flexible strip that draughtsmen bent around pins; beyond the last pin it is straight.


# %%
def natural_spline(p):
    """Returns the spline through the points p (N, d), by its tangents."""
    N = len(p)
    ones = torch.ones(N - 1)
    M = 4 * torch.eye(N) + ones.diag(1) + ones.diag(-1)  # (6.6)
    M[0, 0] = 2  # the two ends
    M[-1, -1] = 2
    leg = 3 * p.diff(dim=0)
    right = torch.cat([leg[:1], leg[1:] + leg[:-1], leg[-1:]])
    return splines.hermite(p, torch.linalg.solve(M, right))


t = torch.linspace(0, 16, 1601)
library = splines.cubic_spline(places)
print("difference (m):", (natural_spline(places)(t) - library(t)).abs().max().item())

# %% tags=["claims"]
apart = natural_spline(places)(t) - library(t)
claim("same_natural", apart.abs().max(), below=1e-12, unit="m")

# %% [markdown]
# What is lost is *locality*: the system couples all tangents, so every point is felt along the
# whole curve. A planner that gets a new waypoint has to change the path under its wheels.
#
# ### With few neighbours: the B-spline
#
# Now give up passing the points. Take {eq}`eq-6-steps` and let the three steps of a piece be the
# three legs between four neighbouring points. Step 2 of a piece is then step 1 of the next. What is
# done of it, $\lambda_2$, must go over into the next piece's $\lambda_1$ without a jump in value,
# first and second derivative, and $\lambda_3$ into $\lambda_2$ likewise. Before its first piece a
# step is not begun (0), after its last one it is done (1). These are four transitions, from 0 to
# $\lambda_3$, to $\lambda_2$, to $\lambda_1$ and to 1. Each has three conditions, which makes
# twelve equations for the twelve coefficients of the three cubics. There is exactly one solution,
# the uniform {term}`B-spline` {cite}`deboor2001`. <!-- given: three steps -->

# %%
# Value, first and second derivative of c0 + c1 u + c2 u^2 + c3 u^3, at u = 0 and 1
at_start = torch.tensor([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 2, 0]])
at_end = torch.tensor([[1.0, 1, 1, 1], [0, 1, 2, 3], [0, 0, 2, 6]])
M = torch.zeros(4, 3, 3, 4)  # transition, condition, lambda, coefficient
for j in range(4):
    if j < 3:
        M[j, :, j] = at_end  # lambda_(j+1) ends ...
    if j > 0:
        M[j, :, j - 1] = -at_start  # ... as lambda_j starts
right = torch.zeros(12)
right[0] = 1  # lambda_1 ends with value 1: the step is done
coefficients = torch.linalg.solve(M.reshape(12, 12), right).reshape(3, 4)
print((6 * coefficients).round().int())

# %% tags=["claims"]
uniform = torch.tensor(splines.b_spline.UNIFORM)
claim("same_table", (coefficients - uniform).abs().max(), below=1e-12)

# %% [markdown]
# These are the coefficients of $\lambda_1$, $\lambda_2$, $\lambda_3$, multiplied by 6. Look at the
# first column: as a piece starts, five sixths of its first step are done already, and one sixth of
# its second. So the curve does not pass its points.
#
# ### The bump of a single point
#
# All three curves depend linearly on their points. So look at what *one* point does: put all points
# on a line, and lift one of them by 1. The response is the point's *basis function*, or bump; a
# curve is a sum of such bumps, each times its point.
#
# **Predict.** Three bumps: chspline, natural, B-spline. Which of them reaches the lifted point,
# which of them is smooth, and which of them ends?

# %% tags=["answer", "hide-input"]
lifted = torch.zeros(21, 1)
lifted[10] = 1
bumps = {
    "chspline": (splines.hermite(lifted), plotting.RED, "--", 0),
    "natural": (splines.cubic_spline(lifted), plotting.PURPLE, "-", 0),
    "B-spline": (splines.uniform_bspline(lifted), plotting.GREEN, "-.", -1),
}
fig, (top, middle, bottom) = plotting.stacked(3, height=2.3)
for name, (curve, color, style, shift) in bumps.items():
    t = torch.linspace(0, curve.segments - 1e-9, 4001)
    here = t - shift - 10  # the B-spline's first piece belongs to points 0 to 3
    look = {"color": color, "ls": style, "label": name}
    top.plot(here, curve(t), **look)
    middle.plot(here, curve(t, 2), **look)
    size = curve(t).abs()
    bottom.semilogy(here, size.where(size > 1e-9, torch.nan), **look)
top.plot(range(-10, 11), lifted, "ko", ms=5, label="points")
top.set(ylabel="bump")
middle.set(ylabel="second derivative")
bottom.set(ylabel="size of the bump")
bottom.set(xlabel="distance from the lifted point (pieces)")
for ax in (top, middle, bottom):
    ax.set(xlim=(-4.2, 4.2))
bottom.set(ylim=(1e-4, 2))
fig.legend(*top.get_legend_handles_labels(), loc="outside lower center", ncols=4)
plotting.show(
    fig,
    "Three bumps, their second derivatives and their sizes with a logarithmic axis. "
    "The B-spline stays below the lifted point, the chspline's second derivative "
    "jumps, and the natural spline's bump never ends.",
)

# %% tags=["answer", "claims"]
claim("bspline_top", bumps["B-spline"][0](9.0)[0], equals=2 / 3, within=1e-9)
ripple = splines.cubic_spline(lifted)(torch.arange(11.0, 14.0) + 0.5).abs().flatten()
claim("natural_fades", (ripple[1:] / ripple[:-1]).mean(), above=0.25, below=0.29)
whole = torch.arange(1.0, 20.0)
chspline_bump = splines.hermite(lifted)
bent = chspline_bump(whole, 2) - chspline_bump(whole - 1e-9, 2)
claim("chspline_bends", bent.abs().max(), above=1)

# %% [markdown] tags=["answer"]
# The first two reach the lifted point. The last two are smooth, while the second derivative of
# chspline jumps, by up to {claim}`chspline_bends`. chspline and the B-spline end after two pieces
# on each side. The natural spline's bump never ends; on each further piece it is
# {claim}`natural_fades` of what it was before, with changing sign. And the B-spline reaches a
# height of {claim}`bspline_top` only. Of three wishes (a continuous second derivative, passing the
# points, locality) cubic splines can grant two.

# %% [markdown]
# ## Four curves through the infinity
#
# There is a fourth curve, which uses what the others ignore: the headings. *path*, the library's
# `planner.path`, is a Hermite spline whose tangents have the directions of the headings. For
# neighbours at a distance $C$, with headings $h$ and $k$ (unit vectors), both are as long as
#
# $$ L = \frac{4\, C}{2 + |h + k|} . $$ (eq-6-length)
#
# With this length the middle of the piece, $\frac12 (p_0 + p_1) + \frac18 (m_0 - m_1)$, lies on
# the circle if both waypoints do. (Let the circle have the radius $\rho$ and the headings differ by
# $2 \alpha$. Then $C = 2 \rho \sin\alpha$, $|h + k| = 2 \cos\alpha$, $|h - k| = 2 \sin\alpha$. The
# middle has to lie $\rho\, (1 - \cos\alpha)$ beside the chord, and it lies $\frac18 L\, |h - k|$
# beside it.) Neighbouring pieces may have tangents of different lengths, so the derivative may jump
# in size at a waypoint, but not in direction.


# %%
def b_spline(p):
    """Returns the B-spline with one more point at each end, so that it ends on p."""
    first = 2 * p[:1] - p[1:2]
    last = 2 * p[-1:] - p[-2:-1]
    return splines.uniform_bspline(torch.cat([first, p, last]))


def curvature(curve, t):
    return splines.curvature(curve(t, derivative=1), curve(t, derivative=2))


curves = {
    "chspline": splines.hermite(places),
    "natural": natural_spline(places),
    "B-spline": b_spline(places),
    "path": planner.path(waypoints),
}

# %% tags=["hide-input"]
t = torch.linspace(0, 16, 2561)
looks = dict(zip(curves, [(plotting.RED, "--"), (plotting.PURPLE, ":")]))
looks |= {"B-spline": (plotting.GREEN, "-."), "path": (plotting.BLUE, "-")}
fig, (top, bottom) = plotting.stacked(2, height=3.3)
plotting.plot_reference(plotting.infinity_axes(top), circles, label="circles")
plotting.plot_waypoints(top, waypoints)
top.set(xlim=(-0.3, 2.15), ylim=(-1.15, 1.15))
for name, curve in curves.items():
    color, style = looks[name]
    top.plot(*curve(t).mT, style, color=color, lw=1.6, label=name)
    bottom.plot(t, curvature(curve, t), style, color=color, lw=1.6)
bottom.set(xlabel="waypoint", ylabel="curvature (1/m)", xlim=(0, 16))
fig.legend(*top.get_legend_handles_labels(), loc="outside lower center", ncols=3)
plotting.show(
    fig,
    "The right circle with four curves through its waypoints, and their curvatures. "
    "The B-spline cuts the corners; the curvature of chspline jumps and has peaks "
    "beside the crossing; that of path is almost the circles' own.",
)

# %% tags=["hide-input"] mystnb={"markdown_format": "myst"}
seen = {}
for name, curve in curves.items():
    kappa = curvature(curve, t[1:])
    jumps = (kappa - curvature(curve, t[1:] - 1e-9)).abs().max()
    missed = torch.cdist(places, curve(t)).amin(-1).max()
    seen[name] = 1000 * off(curve(t)).max(), 1000 * missed, kappa.abs().max(), jumps
head = "curve | off circles (mm) | off waypoints (mm) "
head += "| curvature (1/m) | its jump (1/m)"
formats = ".3f", ".1f", ".2f", ".2f"
rows = []
for name, values in seen.items():
    rows.append(" | ".join([name, *map(format, map(float, values), formats)]))
display(table(head, rows))

# %% tags=["claims"]
claim("chspline_off", seen["chspline"][0], below=60, unit="mm")
claim("chspline_curvature", seen["chspline"][2], above=2, unit="1/m")
claim("chspline_jump", seen["chspline"][3], above=1, unit="1/m")
claim("natural_off", seen["natural"][0], below=60, unit="mm")
claim("bspline_missed", seen["B-spline"][1], above=80, unit="mm")
claim("bspline_curvature", seen["B-spline"][2], below=1.2, unit="1/m")
claim("no_jump", max(seen["B-spline"][3], seen["natural"][3]), below=1e-6, unit="1/m")
claim("path_off", 1000 * seen["path"][0], below=10, unit="µm")
claim("path_jump", seen["path"][3], equals=2, within=0.1, unit="1/m")

# %% [markdown]
# (All values in the table are the largest along the curve.) The circles' own curvature is 1, and -1
# on the second one. chspline is up to {claim}`chspline_off` off the circles and bends with up to
# {claim}`chspline_curvature`, beside the crossing and at the ends, where {eq}`eq-6-central` guesses
# a wrong direction; its curvature jumps by up to {claim}`chspline_jump`. The B-spline never bends
# more than {claim}`bspline_curvature`, without a jump, and misses waypoints by up to
# {claim}`bspline_missed`. The natural spline passes them without a jump, and strays up to
# {claim}`natural_off`. path stays within {claim}`path_off`. At the crossing its curvature jumps by
# {claim}`path_jump`, as that of the two circles does.

# %% [markdown]
# ## On the infinity: from where the car is
#
# Now the paper's Fig. 4 (a). A car stands beside the first waypoint. Put its state in the place of
# that waypoint, and draw the curve again. Above is the paper's `chspline`, which knows only places,
# and below is path, which `pp.local_plan` samples at equal distances.


# %% tags=["hide-input"]
def push(side, ahead=0.0, turn=0.0):
    states = waypoints.clone()
    states[0] = torch.tensor([side, -ahead, math.sin(turn), -math.cos(turn)])
    plans = {
        "chspline": [splines.hermite(x[:, :2]) for x in (waypoints, states)],
        "path": [planner.path(x) for x in (waypoints, states)],
    }
    fig, panels = plotting.stacked(2, height=3.3)
    for ax, (name, both) in zip(panels, plans.items()):
        as_planned, after = (curve.sample(interval=0.2) for curve in both)
        plotting.plot_reference(plotting.infinity_axes(ax, name), circles, "circles")
        plotting.plot_states(ax, as_planned, "plan")
        plotting.plot_states(ax, after[:13], "plan of the pushed car", plotting.RED)
        plotting.plot_heading(ax, waypoints, length=0.2)
        ax.plot(side, -ahead, "s", color=plotting.RED, ms=7)
        ax.set(xlim=(-0.7, 2.2), ylim=(-1.2, 0.6))
        differs = (after != as_planned).any(-1).nonzero()
        merges[name] = differs.max() // 5 + 1 if len(differs) else torch.tensor(0)
    fig.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return fig


merges = {}
alt = "Plans of a car beside its first waypoint; with headings they merge earlier."
sides = [-0.4, -0.2, 0.1, 0.2, 0.3]
display(widgets.panels(push, sides, "pushed aside by (m)", alt=alt))

# %% tags=["claims"]
claim("chspline_merges", merges["chspline"], equals=2)
claim("plan_merges", merges["path"], equals=1)
gaps = 1000 * points.diff(dim=0).norm(dim=-1)
claim("gap_min", gaps.min(), above=130, unit="mm")
claim("gap_max", gaps.max(), below=180, unit="mm")
spacing = 1000 * blue[:-1, :2].diff(dim=0).norm(dim=-1)
claim("plan_gap_min", spacing.min(), above=99, unit="mm")
claim("plan_gap_max", spacing.max(), below=100.1, unit="mm")
knots = torch.arange(1.0, 16.0)
chspline = curves["chspline"]
first_jump = chspline(knots, derivative=1) - chspline(knots - 1e-12, derivative=1)
claim("first_jump", 1000 * first_jump.abs().max(), below=1e-6, unit="mm per piece")
turns = (blue[1:, 2:] * blue[:-1, 2:]).sum(-1).clamp(max=1).acos()
claim("turn_a_step", turns.max().rad2deg(), below=6, unit="degrees")

# %% tags=["remove-cell"]
options = {"step": 0.05, "min": -1.0, "max": 1.0}
side = ipywidgets.FloatSlider(0.3, description="side (m)", **options)
ahead_of = ipywidgets.FloatSlider(0.0, description="ahead (m)", **options)
turned = ipywidgets.FloatSlider(0.0, min=-3.0, max=3.0, description="turn (rad)")
alt = "Plans of a car in the chosen place, with the chosen heading."
widgets.live(push, alt=alt, side=side, ahead=ahead_of, turn=turned)

# %% [markdown]
# The paper says that the blue line has "a high degree of alignment" with the circles (the table
# above says how high), that the red one "eventually merges" with it, and that the points are
# "evenly distributed":
#
# | | merged at waypoint | shortest gap | longest gap |
# |:--|--:|--:|--:|
# | chspline | {claim}`chspline_merges` | {claim}`gap_min` | {claim}`gap_max` |
# | path | {claim}`plan_merges` | {claim}`plan_gap_min` | {claim}`plan_gap_max` |
#
# (A gap is the distance from one sample to the next.)
#
# Merged means *the same numbers*, and that is locality again. With path the pushed car bends only
# the piece that it is on. Without headings its place also changes the tangent at the next waypoint,
# and chspline needs a piece more. The paper's "continuous first derivative" holds: that of chspline
# jumps by {claim}`first_jump`, which is rounding, and the heading of the plan turns by at most
# {claim}`turn_a_step` from one state to the next. "Evenly distributed" is true of the parameter and
# not of the distance: equal steps of $u$ are longer where the curve is faster. `pp.local_plan`
# measures the curve's length, the integral of its speed, and takes states at equal distances.
#
# ### Follow the plan
#
# In each step the car now plans from where it is, and aims at the state 0.3 m ahead on its plan.
# Because it never aims farther, it drives more slowly than when it hops. To compare fairly, we give
# the hopping car a speed limit with which its lap takes equally long. <!-- given: 0.3 m -->


# %%
def ahead(x, goal, distance=0.3):
    """Returns the state that lies the distance ahead, on a plan from x."""
    plan = pp.local_plan(x, waypoints, goal, spacing=distance, count=2)
    return plan[..., 1, :]


limit = torch.tensor([1.775, math.inf])  # m/s, rad/s
slow_hops = infinity.drive(mpc, u_lower=-limit, u_upper=limit)
followed = infinity.drive(mpc, aim=ahead)

# %% tags=["hide-input"]
laps = {"aims at points, speed limit": slow_hops, "follows its plan": followed}
fig = plot_laps(laps)
plotting.show(
    fig,
    "Two laps of equal duration, on the map, and their speeds and turn rates. With "
    "the plan the turn rate is almost constant; with points it swings at every "
    "waypoint.",
)

# %% tags=["claims"]
slow_steps = slow_hops.u[:, 1].diff().square().mean()
claim("hop_time", 0.1 * slow_hops.steps, above=6.7, below=7.2, unit="s")
claim("plan_time", 0.1 * followed.steps, above=6.7, below=7.2, unit="s")
claim("same_time", (slow_hops.steps - followed.steps).abs(), below=3)
claim("calmer_plan", slow_steps / followed.u[:, 1].diff().square().mean(), above=20)
claim("off_slow_hops", 1000 * off(slow_hops.x).mean(), above=50, unit="mm")
claim("off_plan", 1000 * off(followed.x).mean(), below=12, unit="mm")
claim("most_off_plan", 1000 * off(followed.x).max(), below=50, unit="mm")
claim("most_off_hops", 1000 * off(hops.x).max(), above=50, unit="mm")
exhaustive = infinity.controller()  # sweeps until nothing changes
hop_plans = exhaustive.solve(0.1, hops.x[:-1], waypoints[hops.goal])
aims = ahead(followed.x[:-1], followed.goal)
on_plan = exhaustive.solve(0.1, followed.x[:-1], aims)
claim("sweeps_hops", hop_plans.iterations.double().mean(), above=4, below=6)
claim("sweeps_plan", on_plan.iterations.double().mean(), below=6)
start = waypoints[0].repeat(256, 1)
start[:, :2] += 0.2 * torch.randn(256, 2, generator=torch.Generator().manual_seed(1))
world = infinity.SimulatedCar(x_init=start)
many_cars = infinity.drive(mpc, world, aim=ahead, steps=90)
arrived = many_cars.finished
claim("arrive", 100 * arrived.double().mean(), above=95, unit="%")
later = many_cars.running & (many_cars.goal > 2) & arrived[:, None]
claim("later_off", 1000 * off(many_cars.x[:, :-1])[later].max(), below=60, unit="mm")
ahead_by = -start[:, 1]  # how far each car was pushed towards the first waypoint
claim("stuck_ahead", ahead_by[~arrived].min(), above=0.1, unit="m")
far = infinity.drive(mpc, aim=lambda x, goal: ahead(x, goal, 0.5), steps=90)
claim("far_finishes", far.finished, equals=False)

# %% [markdown]
# Both laps take the same time, {claim}`hop_time` and {claim}`plan_time`. The limit calms the speed
# of the hopping car, but not its steering: with the plan the mean square of the changes of the
# turn rate is {claim}`calmer_plan` times smaller. And the car with the plan stays
# {claim}`off_plan` from the circles on average, the other one {claim}`off_slow_hops`: it turns to
# the next waypoint as soon as it is within the tolerance of the last, and so keeps to the inside
# of the circles.
#
# The paper adds that dense waypoints "could decrease the computing cost of MPC and overshoot
# probability". Overshoot, yes: the farthest point of the lap is {claim}`most_off_plan` off the
# circles, and {claim}`most_off_hops` in the lap of "It fails". The cost, hardly: a plan takes
# {claim}`sweeps_plan` sweeps on average instead of {claim}`sweeps_hops`. Of 256 cars that are
# pushed aside at the start {claim}`arrive` arrive, and past the second waypoint none of them is
# more than {claim}`later_off` off the circles. The others were pushed forward by at least
# {claim}`stuck_ahead`: too near to the first waypoint to turn towards it in time, they miss it and
# park beside it, as in chapter 3. For the same reason keep the look-ahead short, so that overshoot
# stays within the tolerance of a waypoint: with 0.5 m the car passes the first one too far away,
# and turns round for it. <!-- given: 0.5 m -->

# %% [markdown]
# ## Poses: from the hat to the exponential
#
# A {term}`pose` is a place and a direction. What is half way between two poses? Not the mean of
# their numbers: the mean of two headings $(\cos, \sin)$ is shorter than 1, and the mean of the
# angles 179° and -179° looks the other way. Ask a car instead: how would it drive from one to the
# other? <!-- given: 179°, half way -->
#
# **Poses as matrices.** Let $R$ be the rotation by the heading and $p$ the place. A point that the
# car sees at $a$ in its own frame lies at $R a + p$ in the world. With a 1 below the coordinates
# this is one product with the matrix
#
# $$ T = \begin{bmatrix} R & p \\ 0 & 1 \end{bmatrix} . $$
#
# One pose after another is the product of their matrices. Such matrices form the group
# {term}`SE(2)`; products and inverses of poses are poses, sums are not.
#
# **The hat.** In its own frame the car has the velocity $(v_x, v_y)$ and the turn rate $\omega$.
# (An ordinary car has $v_y = 0$.) These three numbers are its {term}`twist`, $\xi$. During a short
# time $dt$ the car moves by $(v_x, v_y)\, dt$ and turns by $\omega\, dt$, seen from where it was.
# Up to terms of order $dt^2$ that is the pose $I + \hat\xi\, dt$, where the *hat* puts the three
# numbers into a matrix:
#
# $$
# \hat\xi = \begin{bmatrix} 0 & -\omega & v_x \\ \omega & 0 & v_y \\ 0 & 0 & 0 \end{bmatrix}
# $$ (eq-6-hat)
#
# (A rotation by a small angle $\epsilon$ has $\cos \epsilon \approx 1$ and
# $\sin \epsilon \approx \epsilon$.) So $T(t + dt) = T(t)\, (I + \hat\xi\, dt)$. Subtract $T(t)$,
# and divide by $dt$:
#
# $$ T' = T\, \hat\xi . $$ (eq-6-motion)
#
# **The exponential.** For a constant twist this linear differential equation has the solution
# $T(t) = T(0) \exp(t\, \hat\xi)$ with the matrix exponential
# $\exp(A) = I + A + \frac12 A^2 + \dots$: differentiate the series of $\exp(t\, \hat\xi)$ term by
# term, and a factor $\hat\xi$ comes out. We write $\exp(\xi)$ for the pose $\exp(\hat\xi)$: where a
# constant twist leads in time 1, seen from where it began.
#
# **A closed form.** In time 1 the heading turns by $\theta = \omega$, so $R$ is known. The place is
# the sum of all small moves, each turned by the angle reached by then:
# $\int_0^1 R(s\, \theta)\, v\, ds$. Take vectors of the plane as complex numbers; in the next
# formula $i$ is the imaginary unit. Then $R(s\theta)$ is the factor $e^{i s \theta}$. Because
# $e^{i\theta} - 1 = e^{i\theta/2} (e^{i\theta/2} - e^{-i\theta/2})$, where the bracket is
# $2 i \sin(\theta/2)$,
#
# $$
# \int_0^1 e^{i s \theta} ds = \frac{e^{i\theta} - 1}{i \theta}
# = \frac{\sin(\theta/2)}{\theta/2}\; e^{i \theta/2} .
# $$ (eq-6-chord)
#
# In words: a constant twist drives an arc. Its chord has the direction of $v$ turned by
# $\theta/2$, and is shorter than $|v|$ by the factor $\sin(\theta/2) / (\theta/2)$.

# %% tags=["hide-input"]
xi = torch.tensor([4.0, 0.0, 1.5])
along = lie.se2_exp(torch.linspace(0, 1, 50)[:, None] * xi)
fig, ax = plt.subplots(figsize=(7, 4))
ax.plot(*along[:, :2].mT, lw=3, label=r"the arc, $\exp(u \xi)$")
ax.plot(*along[[0, -1], :2].mT, "--", color=plotting.GREY, lw=2, label="its chord")
for u in (0.0, 0.5, 1.0):
    i, j, c, s = lie.se2_exp(u * xi).tolist()
    sketches.car(ax, i, j, math.atan2(s, c))
sketches.arrow(ax, (0, 0), (1.8, 0), color=plotting.RED)
sketches.word(ax, 1.3, -0.45, "$v$", plotting.RED)
bow = torch.linspace(0, 0.75, 20)
ax.plot(bow.cos(), bow.sin(), color="black", lw=1)
sketches.word(ax, 1.02, 0.42, r"$\theta / 2$")
sketches.word(ax, -0.4, -0.75, "u = 0")
end = along[-1]
sketches.word(ax, *(end[:2] + torch.tensor([0.5, -0.1])), "u = 1")
ax.set(xlabel="i (m)", ylabel="j (m)", aspect="equal", xlim=(-1, 4.6), ylim=(-1, 3.2))
ax.legend(loc="upper left")
plotting.show(
    fig,
    "A car drives an arc with constant speed and turn rate; it is drawn at three "
    "times. The chord from start to end is at half the total angle to the first "
    "direction.",
)

# %% tags=["claims"]
direction = torch.atan2(along[-1, 1], along[-1, 0])
claim("chord_half_angle", direction / xi[2], equals=0.5, within=1e-9)

# %% [markdown]
# In code, with `torch.sinc(x)`, which is $\sin(\pi x) / (\pi x)$ and knows that it is 1 at 0:


# %%
def se2_exp(xi):
    """Returns the pose [x, y, cos, sin] of a twist [v_x, v_y, theta]."""
    theta = xi[2]
    half = theta / 2
    turn = torch.stack([half.cos(), -half.sin(), half.sin(), half.cos()])
    chord = torch.sinc(half / math.pi) * turn.reshape(2, 2) @ xi[:2]  # (6.10)
    return torch.stack([chord[0], chord[1], theta.cos(), theta.sin()])


xi = torch.tensor([4.0, 0.0, 1.5])
hat = torch.tensor([[0, -xi[2], xi[0]], [xi[2], 0, xi[1]], [0, 0, 0]])
matrix = torch.linalg.matrix_exp(hat)
print("ours:       ", se2_exp(xi))
print("the library:", lie.se2_exp(xi))
print("exp(hat):\n", matrix)

# %% tags=["claims"]
claim("same_exp", (se2_exp(xi) - lie.se2_exp(xi)).abs().max(), below=1e-14)
by_matrix = (matrix - lie.se2_matrix(se2_exp(xi))).abs().max()
claim("exp_of_hat", by_matrix, below=1e-12)

# %% [markdown]
# The other way round, the twist that leads to a given pose is its {term}`logarithm <logarithm (of a
# pose)>`: read $\theta$ from the heading, then undo {eq}`eq-6-chord`. So the natural way from $T_0$
# to $T_1$ is a constant twist,
#
# $$
# \begin{aligned}
# T(u) &= T_0 \exp(u\, \xi), \\
# \xi &= \log(T_0^{-1} T_1) .
# \end{aligned}
# $$ (eq-6-way)
#
# **Predict.** Waypoints 4 and 7 lie on the first circle. Is this way between them a straight line,
# the circle, or neither?

# %% tags=["answer"]
first = waypoints[4]
last = waypoints[7]
u = torch.linspace(0, 1, 9)[:, None]
twist = lie.se2_log(lie.se2_compose(lie.se2_inverse(first), last))
by_twist = lie.se2_compose(first, lie.se2_exp(u * twist))  # (6.11)
by_numbers = (1 - u) * first + u * last
print("twist:", twist)

# %% tags=["answer", "hide-input"]
fig, panels = plotting.stacked(2, height=2.7)
ways = {"means of the numbers": by_numbers, "constant twist": by_twist}
for ax, (name, way) in zip(panels, ways.items()):
    plotting.plot_reference(plotting.infinity_axes(ax, name), circles, "circles")
    between = plotting.plot_heading(ax, way, length=0.4, color=plotting.BLUE)
    between.set_label("between")
    given = plotting.plot_heading(ax, waypoints[[4, 7]], length=0.4)
    given.set_label("given")
    ax.set(xlim=(-0.3, 2.9), ylim=(-0.4, 1.3))
    ax.legend(loc="center right")
plotting.show(
    fig,
    "Arrows between two waypoints of a circle. The means of the numbers lie on the "
    "chord and shrink in the middle; those of a constant twist lie on the circle.",
)

# %% tags=["answer", "claims"]
claim("shortest_heading", by_numbers[:, 2:].norm(dim=-1).min(), below=0.5)
claim("on_the_circle", off(by_twist).max(), below=1e-12, unit="m")
claim("turn_rate_of_way", twist[2] / twist[0], equals=1, within=1e-9)

# %% [markdown] tags=["answer"]
# The circle, to {claim}`on_the_circle`: going round at constant speed *is* a constant twist, here
# with no sideways part and equal speed and turn rate, as the radius is 1 m. Among poses a circle is
# what a straight line is among points. The means of the numbers leave the circle, and their
# headings shrink to a length of {claim}`shortest_heading`.

# %% [markdown]
# ### The adjoint: one motion, seen from two frames
#
# The camera on the roof of a turning car has the car's turn rate, but another velocity. Let $a$ and
# $b$ be two frames that are fixed to one body, and $T$ the pose of $b$ seen from $a$. If the body's
# motion has the twist $\xi$ seen from $b$, then seen from $a$ it has the twist $\text{Ad}_T\, \xi$,
# a matrix times $\xi$. This matrix is the {term}`adjoint` of $T$, defined by
#
# $$
# \begin{aligned}
# T \exp(\xi)\, T^{-1} &= \exp(\text{Ad}_T\, \xi), \\
# \text{Ad}_T &= \begin{bmatrix} R & (p_y, -p_x)^\top \\ 0 & 1 \end{bmatrix} .
# \end{aligned}
# $$ (eq-6-adjoint)
#
# (In the series of the exponential all inner $T^{-1} T$ cancel, which leaves
# $\exp(T \hat\xi\, T^{-1})$. Multiply out: the turn rate is as it was, and the last column is
# $R v - \omega\, (-p_y, p_x)$.) The order of two motions matters, and the adjoint says what changes
# when they swap places: $\exp(\eta) \exp(\xi) = \exp(\xi) \exp(\eta')$ with
# $\eta' = \text{Ad}_{\exp(-\xi)}\, \eta$. (Take $T = \exp(-\xi)$ in {eq}`eq-6-adjoint`, and
# multiply by $\exp(\xi)$ from the left.)


# %% [markdown]
# ## Poses in space
#
# In space the same ideas take three numbers more; [an appendix](mathematics.py) goes through them
# step by step. A rotation has an axis and an angle; their product is the *rotation vector* $\phi$
# with three components and length $\theta = |\phi|$. Its hat is the matrix of the cross product,
# $\hat\phi\, a = \phi \times a$. Because $\hat\phi^3 = -\theta^2 \hat\phi$, all higher powers in
# the series of $\exp(\hat\phi)$ are multiples of the first two, and their factors add up to sine
# and cosine. This is {term}`Rodrigues' formula`:
#
# $$
# R = I + \frac{\sin\theta}{\theta}\, \hat\phi + \frac{1 - \cos\theta}{\theta^2}\, \hat\phi^2
# $$ (eq-6-rodrigues)
#
# The library keeps rotations not as nine numbers but as four, a unit {term}`quaternion`
#
# $$
# q = \left[ \sin(\theta/2)\, \frac{\phi}{\theta},\; \cos(\theta/2) \right] ,
# $$ (eq-6-quaternion)
#
# which takes fewer operations to multiply and is easily brought back to length 1 after rounding.
# Because of the half angle, a full turn, $\theta = 2\pi$, changes the sign of $q$ and not the
# rotation: *$q$ and $-q$ are the same rotation.* At $\theta = 0$ both formulas are 0/0, and one
# needs their series; you write one in the lab.
#
# A pose in space is a place and a quaternion, `pp.SE3`, seven numbers. A twist has six, velocity
# first. And a spline of poses is {eq}`eq-6-steps`, with twists as steps and products instead of
# sums {cite}`kim1995`:
#
# $$
# \begin{aligned}
# T(u) = T_0 &\exp(\lambda_1 s_1) \exp(\lambda_2 s_2) \\
# &\exp(\lambda_3 s_3)
# \end{aligned}
# $$ (eq-6-poses)
#
# `pp.chspline` and `pp.bspline` do this when they get an `SE3`. (For those who need the derivative:
# it is $v = \lambda_1' s_1$ after the first factor; each further factor $A_j = \exp(\lambda_j s_j)$
# shows it from a new frame and adds its own,
# $v \leftarrow \text{Ad}_{A_j^{-1}} v + \lambda_j' s_j$.) Here is the body of a dog that walks the
# first circle over a hill, with its nose along the slope, leaning into the turn.

# %%
s = torch.arange(9) * math.pi / 4  # m, along the circle
stand = torch.zeros(9, 7)
stand[:, :2] = places[:9]
stand[:, 2] = 0.6 - 0.4 * s.cos()  # the hill
stand[:, 6] = 1  # the w of the quaternion: no rotation
yaw = torch.zeros(9, 6)
yaw[:, 5] = s - math.pi / 2
tilt = torch.zeros(9, 6)
tilt[:, 3] = -0.6 * (s / 2).sin() ** 2  # leaning
tilt[:, 4] = -(0.4 * s.sin()).atan()  # up and down the slope
body = pp.SE3(stand) @ pp.se3(yaw).Exp() @ pp.se3(tilt).Exp()
way = pp.chspline(body, 0.05)

# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 5.2), subplot_kw={"projection": "3d", "azim": -70})
axes = {"forward": plotting.RED, "left": plotting.GREEN, "up": plotting.BLUE}
for poses, size, width in [(way[::5].matrix(), 0.16, 0.8), (body.matrix(), 0.4, 2.2)]:
    for k, (name, color) in enumerate(axes.items()):
        label = name if size > 0.2 else None
        arrow = size * poses[:, :3, k].mT
        ax.quiver(*poses[:, :3, 3].mT, *arrow, color=color, lw=width, label=label)
ax.plot(*way.translation().mT, color="black", label="spline of poses")
ground = circles[:101, :2].mT
ax.plot(*ground, 0, color=plotting.ORANGE, lw=3, label="circle on the ground")
ax.set(xlabel="i (m)", ylabel="j (m)", zlabel="height (m)", zlim=(0, 1.3))
ax.set(xlim=(-0.3, 2.3), ylim=(-1.3, 1.3))
ax.set_box_aspect((2, 2, 1), zoom=1.1)
fig.legend(loc="outside lower center", ncols=3)
plotting.show(
    fig,
    "Nine poses on a hilly circle as long axes forward, left and up, and many short "
    "ones between them on a smooth curve.",
)

# %% tags=["claims"]
claim("poses_passed", (way[::20] - body).abs().max(), below=1e-12)
level = torch.zeros(9, 7)
level[:, :2] = places[:9]
level[:, 6] = 1
flat = pp.SE3(level) @ pp.se3(yaw).Exp()
claim("flat_off", off(pp.bspline(flat, 0.1)).max(), below=1e-12, unit="m")
pose_curve = splines.uniform_bspline(body)
inner = torch.arange(1.0, pose_curve.segments)
rate_jump = pose_curve(inner, 2) - pose_curve(inner - 1e-12, 2)
claim("rate_jump", rate_jump.abs().max(), below=1e-9)

# %% [markdown]
# The long axes are the nine given poses; the curve passes them, to {claim}`poses_passed`. Nobody
# gave it tangents: poses know where they look. On level ground even the B-spline of the poses is
# the circle itself, to {claim}`flat_off`, although that of the *places* missed its waypoints by
# {claim}`bspline_missed`. All steps of the poses are the same twist, and whatever shares of equal
# twists are done, the product stays on the circle.

# %% [markdown]
# ## Uncertain poses
#
# The filter of chapter 4 has a covariance $P$ of the four numbers $[i, j, \cos, \sin]$. But a
# heading is *one* number. Let its angle have the standard deviation $\sigma$. A small error
# $\epsilon$ of the angle changes $(\cos\theta, \sin\theta)$ by
# $(-\sin\theta, \cos\theta)\, \epsilon$, hence the covariance of the two is
#
# $$
# P_{\cos,\sin} = \sigma^2 \begin{bmatrix} -\sin\theta \\ \cos\theta \end{bmatrix}
# \begin{bmatrix} -\sin\theta & \cos\theta \end{bmatrix} .
# $$ (eq-6-rank)
#
# It has rank 1: to first order a heading can turn, but not grow. For a whole pose, let the true one
# be $\bar T \exp(\eta)$ with a random twist $\eta$ of covariance $\Sigma$ (3, 3). Then
# $P = J \Sigma J^\top$, with the Jacobian $J$ (4, 3) of the four numbers with respect to $\eta$, is
# *rank-deficient*, of rank 3. Chapter 4 adds noise to $\cos$ and $\sin$ separately, which fills the
# fourth direction: convenient, but such headings do not exist.
#
# Now let cars start at the first waypoint with an uncertain pose and drive half of the circle,
# with the twist $\xi$. When $\exp(\eta)$ and $\exp(\xi)$ swap places, the error $\eta$ at the
# start becomes $\text{Ad}_{\exp(-\xi)}\, \eta$ at the end, *exactly*. So a Gaussian twist stays
# Gaussian, with the covariance $\text{Ad}\, \Sigma\, \text{Ad}^\top$. It is the prediction of a
# Kalman filter, without an approximation. <!-- given: half -->

# %%
deviations = torch.tensor([0.05, 0.05, 0.4])  # m, m, rad, in the car's frame
half_circle = torch.tensor([math.pi, 0.0, math.pi])
Ad = lie.se2_adjoint(lie.se2_exp(-half_circle))
Sigma = Ad @ deviations.square().diag() @ Ad.mT
mean = lie.se2_compose(waypoints[0], lie.se2_exp(half_circle))
J = torch.zeros(4, 3)  # of [i, j, cos, sin] with respect to eta
J[:2, :2] = lie.se2_matrix(mean)[:2, :2]
J[2:, 2] = torch.stack([-mean[3], mean[2]])
P = J @ Sigma @ J.mT
print("eigenvalues of P:", torch.linalg.eigvalsh(P))

# %% [markdown]
# **Predict.** Four thousand cars drive. Of their places, how many lie in the ellipse of $P$ that
# should hold 95 %: about 95 %, 80 % or 60 %? And how many of their twists lie in the ellipsoid of
# $\Sigma$ that should hold 95 %? <!-- given: 80 %, 60 % -->

# %% tags=["answer", "hide-input"]
generator = torch.Generator().manual_seed(0)
errors = deviations * torch.randn(4000, 3, generator=generator)
cars = lie.se2_compose(waypoints[0], lie.se2_exp(errors))
cars = lie.se2_compose(cars, lie.se2_exp(half_circle))
fig, ax = plt.subplots(figsize=(7, 4.6))
ax.plot(*cars[:, :2].mT, ".", ms=2, color=plotting.GREY, label="4000 cars")
ellipse = plotting.plot_covariance(ax, mean, P, color=plotting.BLUE)
ellipse.set(lw=2, label="95 % by P, of the numbers")
angle = torch.linspace(0, 2 * math.pi, 200)
variance, axes = torch.linalg.eigh(Sigma)
ring = torch.stack([angle.cos(), angle.sin()], -1)
ring = (ring * variance[1:].sqrt()) @ axes[:, 1:].mT  # the largest section
ring = math.sqrt(7.815) * ring  # of the ellipsoid that holds 95 %, chi-square, 3
banana = lie.se2_compose(mean, lie.se2_exp(ring))
label = "95 % by Σ, of the twist"
ax.plot(*banana[:, :2].mT, "--", color=plotting.RED, lw=2, label=label)
start = waypoints[0, :2]
ax.plot(*start, "k*", ms=11, label="start")
ax.set(xlabel="i (m)", ylabel="j (m)", aspect="equal", xlim=(-0.2, 2.4))
fig.legend(loc="outside lower center", ncols=2)
plotting.show(
    fig,
    "The places of many cars form a bent cloud, a banana, around the start. The "
    "ellipse of the numbers is straight and leaves the ends of the cloud outside; "
    "the image of an ellipsoid of twists is bent like the cloud.",
)

# %% tags=["answer", "claims"]
away = (cars - mean)[:, :2]
inside = (away @ torch.linalg.inv(P[:2, :2]) * away).sum(-1) <= 5.991  # chi-square, 2
claim("ellipse_holds", 100 * inside.double().mean(), below=65, unit="%")
eta = lie.se2_log(lie.se2_compose(lie.se2_inverse(mean), cars))
within = (eta @ torch.linalg.inv(Sigma) * eta).sum(-1) <= 7.815  # chi-square, 3
claim("banana_holds", 100 * within.double().mean(), equals=95, within=1.5, unit="%")
values = torch.linalg.eigvalsh(P)
claim("rank", (values > 1e-12 * values[-1]).sum(), equals=3)

# %% [markdown] tags=["answer"]
# The ellipse holds {claim}`ellipse_holds`, for the cloud bends around the start and the ellipse
# cannot. In twists {claim}`banana_holds` lie inside, as they should: the cloud is exactly Gaussian
# there, and its bent image is known as the *banana distribution* {cite}`long2012`. (The dashed
# line is the image of the largest section of the ellipsoid.) The rank of $P$ is {claim}`rank`. A
# filter on poses keeps $\Sigma$ and corrects by $T \leftarrow T \exp(K r)$, where $K r$ (gain
# times residual) is a twist; it has no fourth direction.

# %% [markdown]
# ## How we know: orders of convergence
#
# Take $N$ points of a known curve, at equal steps, and then twice as many. The error of a spline
# falls by its own power of the step: halve the step, and an error of {term}`order <order of
# convergence>` 3 is divided by 8. A wrong coefficient spoils the power, so the order is a sharp
# test. That the error falls proves little, since almost any curve comes nearer when its points do.
# <!-- given: twice, half -->
#
# **Predict.** We measure on a sine and on a circle, away from the ends. Both are smooth. Will the
# orders be the same?


# %% tags=["answer"]
def sine(N):
    """Returns N + 1 states on one period of the sine."""
    x = torch.linspace(0, 2 * math.pi, N + 1)
    direction = torch.stack([torch.ones(N + 1), x.cos()], dim=-1)
    direction = direction / direction.norm(dim=-1, keepdim=True)
    return torch.cat([x[:, None], x.sin()[:, None], direction], dim=-1)


def circle(N):
    return infinity.reference(torch.linspace(0, 2 * math.pi, N + 1))


makers = {
    "chspline": lambda states: splines.hermite(states[:, :2]),
    "natural": lambda states: natural_spline(states[:, :2]),
    "B-spline": lambda states: b_spline(states[:, :2]),
    "path": planner.path,
}


# %% tags=["answer", "hide-input"]
def above_sine(p):
    return (p[:, 1] - p[:, 0].sin()).abs()


tests = {"sine": (sine, above_sine), "circle": (circle, off)}
counts = [8, 16, 32, 64]
orders = {}
fig, panels = plotting.stacked(2, height=3.2)
for ax, (shape, (states, distance)) in zip(panels, tests.items()):
    for name, make in makers.items():
        errors = []
        for N in counts:
            t = torch.linspace(0.3 * N, 0.7 * N, 12 * N + 1)  # away from the ends
            errors.append(distance(make(states(N))(t)).max())
        orders[shape, name] = (errors[-2] / errors[-1]).log2()
        color, style = looks[name]
        label = f"{name}: order {orders[shape, name]:.1f}"
        ax.loglog(counts, errors, "o" + style, color=color, ms=5, label=label)
    ax.set(title=f"on a {shape}", xlabel="pieces", ylabel="largest error (m)")
    ax.set_xticks(counts, counts, minor=False)
    ax.minorticks_off()
    ax.set_ylim(bottom=min(errors) / 1000)
    ax.legend(loc="lower left", ncols=2)
plotting.show(
    fig,
    "The errors of four splines against the number of pieces, on a sine and on a "
    "circle, with logarithmic axes. They are straight lines; chspline and path fall "
    "more steeply on the circle.",
)

# %% tags=["answer", "claims"]
expected = {"chspline": (3, 4), "natural": (4, 4), "B-spline": (2, 2), "path": (4, 6)}
for name, powers in expected.items():
    short = name.lower().replace("-", "")
    for shape, power in zip(tests, powers):
        claim(f"order_{short}_{shape}", orders[shape, name], equals=power, within=0.2)

# %% [markdown] tags=["answer"]
# They are not. On the sine chspline has order {claim}`order_chspline_sine`, natural
# {claim}`order_natural_sine`, the B-spline {claim}`order_bspline_sine` (it never reaches its
# points), and path {claim}`order_path_sine`. These are the orders on smooth curves in general. On
# the circle they are {claim}`order_chspline_circle`, {claim}`order_natural_circle`,
# {claim}`order_bspline_circle` and {claim}`order_path_circle`. The circle makes a gift to two of
# them, because it is symmetric about every point and about the middle of every piece:
#
# - *chspline.* By Taylor, $\frac12 (p_{i+1} - p_{i-1})$ is $h p' + \frac16 h^3 p'''$ for a step
#   $h$: the tangent has an error of order 3, in the direction of $p'''$. On a circle $p'''$ is
#   parallel to $p'$. So this error makes points early or late *along* the circle, and what leads
#   off it is of order 4. On the sine $p'''$ has another direction.
# - *path.* On a unit circle $e(u) = |p(u) - \text{centre}|^2 - 1$ is a polynomial of degree 6. It
#   has double zeros at both ends, where place and direction are right, and a zero in the middle, by
#   {eq}`eq-6-length`; by symmetry that one is double, too. So $e(u) = |d|^2 u^2 (1 - u)^2
#   (u - \frac12)^2$, where $|d|^2$ is the leading coefficient. By {eq}`eq-6-hermite` $d$ is of
#   order 3, like $h^3 p'''$, and its square of order 6.
#
# A test on the infinity alone would have given 4 and 6, which is wrong for paths that are not made
# of circles.

# %% [markdown]
# Two more tests guard the library. Derivatives are continuous where they should be: the second ones
# of the pose B-spline above jump by {claim}`rate_jump`. And gradients agree with differences,
# through a whole local plan with its lengths, up to {claim}`gradient_error`.

# %% tags=["claims"]
w = waypoints[:4].clone().requires_grad_()
weights = torch.linspace(-1, 1, 20)[:, None]


def weighed(w):
    return (weights * pp.local_plan(w[0], w, 1)).sum()


(slope,) = torch.autograd.grad(weighed(w), w)
steps = 1e-6 * torch.eye(16).reshape(16, 4, 4)
differences = [(weighed(w + h) - weighed(w - h)) / 2e-6 for h in steps]
error = (slope.flatten() - torch.stack(differences)).abs().max() / slope.abs().max()
claim("gradient_error", error, below=1e-6)

# %% [markdown]
# ## Summary
#
# 1. A Hermite piece is two points and two tangents; with central differences it is the Catmull-Rom
#    spline, PyPose's `chspline`, within {claim}`chspline_off` of the circles. With the waypoints'
#    headings it is the local plan, within {claim}`path_off`.
# 2. Of a continuous second derivative, passing the points and locality, cubics have two: the
#    natural spline is felt everywhere, and the B-spline misses its points by up to
#    {claim}`bspline_missed`.
# 3. After a push the plan has merged at waypoint {claim}`plan_merges`, exactly. At equal lap time a
#    car that follows its plan stays {claim}`off_plan` from the circles, and one that aims at points
#    {claim}`off_slow_hops`.
# 4. Between poses a constant twist leads, by exponential and logarithm; on it, uncertain poses stay
#    Gaussian, and {claim}`banana_holds` lie where they should, compared with {claim}`ellipse_holds`
#    in the ellipse of the numbers.
# 5. The orders are {claim}`order_chspline_sine`, {claim}`order_natural_sine`,
#    {claim}`order_bspline_sine` and {claim}`order_path_sine` for chspline, natural, B-spline and
#    path; on a circle the first is {claim}`order_chspline_circle` and the last
#    {claim}`order_path_circle`.
#
# | Fig. 4 (a) | paper | chspline | local plan |
# |:--|:--|--:|--:|
# | blue, off the circles | "high degree of alignment" | {claim}`chspline_off` | {claim}`path_off` |
# | red merges at waypoint | "eventually" | {claim}`chspline_merges` | {claim}`plan_merges` |
#
# **What differs from PyPose.** In PyPose 0.9.5 `chspline` interpolates the numbers of poses,
# `bspline` takes only poses, neither gives derivatives or lengths, and an interval such as 1/49
# gives a sample too many in each piece, by rounding.
#
# **Words of this chapter.** {term}`Spline`, {term}`tangent`, {term}`control polygon`,
# {term}`Bézier curve`, {term}`cubic Hermite spline`, {term}`Catmull-Rom spline`, {term}`natural
# cubic spline`, {term}`B-spline`, {term}`curvature`, {term}`order of convergence`, {term}`pose`,
# {term}`SE(2)`, {term}`twist`, {term}`logarithm (of a pose)`, {term}`adjoint`,
# {term}`Rodrigues' formula`, {term}`quaternion`.
#
# **Further reading.** de Boor {cite}`deboor2001` on splines; Solà, Deray and Atchuthan
# {cite}`sola2018` on poses, in few pages; Long and others {cite}`long2012` on the banana; Sommer
# and others {cite}`sommer2020` on derivatives of splines of poses.
#
# **In [the lab](../exercises/06_splines.py)** you write the Hermite basis, splines through given
# times, a curve's length, the exponential of a rotation with its small angles, and the logarithm of
# a pose; find two faults in an interpolation of rotations, measure an order of convergence, move
# waypoints by gradient until a car can follow them, and smooth a track for the simulated Go1.
#
# Next: [chapter 7](07_all_together.py) puts filter, spline and controller together.
