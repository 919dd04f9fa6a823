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
# # Lab 6: Curves and poses
#
# This lab belongs to [chapter 6](../book/06_splines.py). You write the parts of splines and of
# poses, find the faults in an interpolation of rotations, measure an order of convergence, move
# waypoints until a car can follow them, and smooth a recorded track for the simulated Go1. Each
# exercise says how long it takes, has three hints to open one after the other, and ends in a check.
# All of them together take about 115 minutes. <!-- given: 115 minutes -->

# %% tags=["setup"]
import math

import matplotlib.pyplot as plt
import torch

import pypose_lite as pp
from pypose_lite import go1, infinity, lie, splines
from pypose_lite.teaching import check, plotting, progress

plotting.use_style()
torch.set_default_dtype(torch.float64)

# %% [markdown]
# The waypoints are those of the chapter:

# %%
waypoints = infinity.waypoints()  # (17, 4): i, j, cos, sin
places = waypoints[:, :2]

# %% [markdown]
# ## Exercise 6.1: The Hermite basis
#
# *5 minutes. Warm-up.*
#
# The chapter derived Hermite's cubic by powers of $u$: with $\Delta = p_1 - p_0$ it is
#
# $$
# p(u) = p_0 + m_0 u + (3 \Delta - 2 m_0 - m_1)\, u^2 + (m_0 + m_1 - 2 \Delta)\, u^3 .
# $$
#
# Sort it by the data instead. Write the function that returns the four factors of $p_0$, $m_0$,
# $p_1$ and $m_1$, in this order, for a tensor `u` of any shape $(\dots)$: a tensor $(\dots, 4)$.
#
# :::{dropdown} Hint 1
# Replace $\Delta$ by $p_1 - p_0$, and collect everything that is multiplied by $p_1$.
# :::
#
# :::{dropdown} Hint 2
# The factor of $p_1$ is $3u^2 - 2u^3$. That of $p_0$ makes the sum of the two 1, at every $u$.
# :::
#
# :::{dropdown} Hint 3
# The factor of $m_0$ is $u - 2u^2 + u^3$, that of $m_1$ is $u^3 - u^2$. `torch.stack` with `dim=-1`
# puts the four next to each other.
# :::


# %%
def hermite_basis(u):
    """Returns the factors (..., 4) of p0, m0, p1 and m1 at u (...)."""
    raise NotImplementedError("6.1 The Hermite basis")


# %%
check("6.1", hermite_basis)

# %% tags=["hide-input"]
u = torch.linspace(0, 1, 101)
basis = splines.hermite(torch.eye(4)[[0, 2]], torch.eye(4)[[1, 3]])(u)
fig, ax = plt.subplots(figsize=(7, 3))
names = ["$p_0$", "$m_0$", "$p_1$", "$m_1$"]
for column, name, style in zip(basis.mT, names, ["-", "--", "-.", ":"]):
    ax.plot(u, column, style, label=f"factor of {name}")
ax.set(xlabel="u", ylabel="factor")
ax.legend()
plotting.show(
    fig,
    "The four functions of the Hermite basis. Those of the points lead from 1 to "
    "0 and from 0 to 1, those of the tangents are 0 at both ends.",
)

# %% [markdown]
# ## Exercise 6.2: A spline through given times
#
# *10 minutes. A derivation, checked numerically.*
#
# A recording says when each point was passed: point $p_i$ at the time $t_i$, and the times are not
# equally spaced. Catmull and Rom's tangent is then the derivative, at $t_i$, of the *parabola*
# through a point and its two neighbours. Let $a$ be the slope (metres a second) from the point
# before to $p_i$, which took the time $g$, and $b$ the slope to the next point, which takes the
# time $h$. Derive the tangent from $a$, $b$, $g$, $h$, and write the function that returns all
# tangents. The first and the last are the slope of the only leg that there is. `p` is $(N, d)$ with
# $N \ge 2$, `t` is $(N)$.
#
# :::{dropdown} Hint 1
# The derivative of a parabola is a straight line. In the middle of a leg it is exactly the leg's
# slope.
# :::
#
# :::{dropdown} Hint 2
# So the derivative is $a$ at the time $t_i - g/2$, and $b$ at $t_i + h/2$. Interpolate to $t_i$.
# :::
#
# :::{dropdown} Hint 3
# $t_i$ lies at the share $g / (g + h)$ of the way from the first to the second:
# $m = (h\, a + g\, b) / (g + h)$. The shorter leg counts more.
# :::


# %%
def tangents(p, t):
    """Returns the tangents (N, d) of points p (N, d), passed at times t (N,)."""
    raise NotImplementedError("6.2 A spline through given times")


# %%
check("6.2", tangents)

# %% [markdown]
# ## Exercise 6.3: How long is a curve?
#
# *10 minutes. Warm-up.*
#
# Equal steps of the parameter are not equal distances. To place points 0.1 m apart, a planner has
# to know how long a curve is: $\int_a^b |p'(t)|\, dt$. `velocity` is a function that returns
# $p'(t)$ as a tensor $(k, 2)$ for a tensor of parameters $(k)$. Write the function that returns the
# length between the parameters `a` and `b`, to at least four digits. (For most curves there is no
# formula, so add up.) <!-- given: 0.1 m, four digits -->
#
# :::{dropdown} Hint 1
# Cut the interval into many short parts. On each of them the distance is speed times time.
# :::
#
# :::{dropdown} Hint 2
# The speed is the norm of the velocity, `velocity(t).norm(dim=-1)`. Take the norm first, then sum.
# :::
#
# :::{dropdown} Hint 3
# Take the speed in the *middle* of each part: `t = a + (torch.arange(n) + 0.5) / n * (b - a)`. A
# thousand parts are enough.
# :::


# %%
def arc_length(velocity, a, b):
    """Returns the length of the curve from the parameter a to b."""
    raise NotImplementedError("6.3 How long is a curve?")


# %%
check("6.3", arc_length)

# %% [markdown]
# ## Exercise 6.4: From a rotation vector to a quaternion
#
# *15 minutes. Derivatives where a formula is 0/0.*
#
# Write the exponential of rotations: for rotation vectors `phi` $(\dots, 3)$ the quaternions
# $(\dots, 4)$ in the order x, y, z, w,
#
# $$ q = \left[ \frac{\sin(\theta/2)}{\theta}\, \phi,\; \cos(\theta/2) \right],
# \qquad \theta = |\phi| . $$
#
# It has to be right for any angle, also for 0 and near 0, and so does its *gradient*: a filter or
# an optimiser differentiates through it, and often starts at no rotation at all.
#
# :::{dropdown} Hint 1
# At $\theta = 0$ the fraction is 0/0, although its limit is 1/2. `torch.where` can choose a series
# there: $\sin(\theta/2)/\theta = 1/2 - \theta^2/48 + \theta^4/3840 - \dots$
# :::
#
# :::{dropdown} Hint 2
# The gradient of `torch.where` is the sum of that of one branch and that of the other multiplied
# by 0, and 0 multiplied by infinity is `nan`. So *both* branches must be given numbers that they
# can take: put 1 in the place of the small angles before dividing. The norm itself has no gradient
# at 0; its square has.
# :::
#
# :::{dropdown} Hint 3
# `square = (phi * phi).sum(-1, keepdim=True)`, `small = square < 1e-4`, then
# `theta = torch.where(small, 1.0, square).sqrt()`. For $\cos(\theta/2)$ a series is
# $1 - \theta^2/8 + \theta^4/384$.
# :::


# %%
def so3_exp(phi):
    """Returns quaternions x, y, z, w (..., 4) of rotation vectors (..., 3)."""
    raise NotImplementedError("6.4 From a rotation vector to a quaternion")


# %%
check("6.4", so3_exp)

# %% [markdown]
# ## Exercise 6.5: The logarithm of a pose
#
# *10 minutes. The inverse of the chapter's `se2_exp`.*
#
# A constant twist $[v_x, v_y, \theta]$ leads in time 1 to a pose `T` $= [x, y, \cos, \sin]$: its
# chord $(x, y)$ is $(v_x, v_y)$ turned by $\theta/2$ and shortened by the factor
# $\sin(\theta/2) / (\theta/2)$. Write the function that returns the twist, a tensor of three
# numbers with $\theta$ between $-\pi$ and $\pi$, for one pose `T` of four numbers.
#
# :::{dropdown} Hint 1
# `torch.atan2(sine, cosine)` is the angle, with the right sign.
# :::
#
# :::{dropdown} Hint 2
# Undo what the exponential did: turn the chord *back* by $\theta/2$, and divide by the factor.
# :::
#
# :::{dropdown} Hint 3
# `torch.sinc(theta / (2 * math.pi))` is the factor, also at 0. Turning back by $\theta/2$ is the
# matrix with rows $(c, s)$ and $(-s, c)$.
# :::


# %%
def se2_log(T):
    """Returns the twist [v_x, v_y, theta] of a pose T = [x, y, cos, sin]."""
    raise NotImplementedError("6.5 The logarithm of a pose")


# %%
check("6.5", se2_log)

# %% [markdown]
# ## Exercise 6.6: A robot that turns the long way round
#
# *15 minutes. Two faults, to be found and mended.*
#
# A colleague interpolates rotations, unit quaternions x, y, z, w, at constant turn rate. The
# function passed a test with two turns about the same axis. On a robot the hand does not arrive,
# and sometimes it turns the long way round. The figure shows the angle between the interpolated
# rotation and the goal.


# %%
def faulty_between(q0, q1, u):
    turn = lie.so3_compose(q1, lie.so3_inverse(q0))
    angle = 2 * torch.acos(turn[3].clamp(-1, 1))
    axis = turn[:3] / turn[:3].norm()
    return lie.so3_compose(q0, lie.so3_exp(u * angle * axis))


# %% tags=["hide-input"]
first = lie.so3_exp(torch.tensor([0.9, 0.2, -0.4]))
second = lie.so3_exp(torch.tensor([0.1, 1.2, 0.3]))
shares = torch.linspace(0, 1, 41)
fig, ax = plt.subplots(figsize=(7, 3))
for goal, name, style in [(second, "goal $q$", "-"), (-second, "goal $-q$", "--")]:
    way = torch.stack([faulty_between(first, goal, u) for u in shares])
    left = lie.so3_log(lie.so3_compose(lie.so3_inverse(way), second))
    ax.plot(shares, left.norm(dim=-1).rad2deg(), style, label=name)
ax.set(xlabel="u", ylabel="angle to the goal (degrees)", ylim=(0, None))
ax.legend()
plotting.show(
    fig,
    "The angle to the goal along two interpolations. Neither of them arrives at "
    "0, and the one whose goal has the other sign turns away first.",
)

# %% [markdown]
# There are two faults: one has to do with the frame that a turn is seen from, the other with the
# sign of a quaternion. Say to yourself which test shows each of them, and write the function as it
# should be: `between(q0, q1, u)` starts at `q0` for `u = 0`, ends at the rotation `q1` for `u = 1`,
# turns at a constant rate, and takes the shorter way. You may use what the package `lie` has, or
# not.
#
# :::{dropdown} Hint 1
# `q1 = turn q0` for the `turn` above. And the last line multiplies by it from the other side. Does
# the order matter if both turns have the same axis?
# :::
#
# :::{dropdown} Hint 2
# Either see the turn from the body, $q_0^{-1} q_1$, and multiply from the right, or see it from the
# world, $q_1 q_0^{-1}$, and multiply from the left.
# :::
#
# :::{dropdown} Hint 3
# $q$ and $-q$ are the same rotation. For one of them the cosine of half the angle is negative, and
# the turn is longer than half a turn. Where `turn[3]` is negative, take `-turn`; `lie.so3_log`
# does that.
# :::


# %%
def between(q0, q1, u):
    """Returns the rotation at the share u of the way from q0 to q1."""
    raise NotImplementedError("6.6 A robot that turns the long way round")


# %%
check("6.6", between)

# %% [markdown]
# ## Exercise 6.7: Which order is it?
#
# *15 minutes. Verification.*
#
# Write a test for splines: `order(make)` measures the order of convergence of a spline and returns
# it, as a number. `make(p)` takes points `p` $(N + 1, 2)$ and returns the curve, a function that
# gives the points $(k, 2)$ at the parameters $(k)$ between 0 and $N$; the points belong to the
# parameters 0, 1, 2, ... Choose a curve without the symmetry of a circle, such as the sine over one
# period; take $N$ points of it at equal steps and then $2N$, compare the spline with it *between*
# the points and away from the ends, and return the power of the step with which the error falls.
#
# Here are two splines to try it on; their orders on smooth curves are 3 and 4.

# %%
splines_to_try = {"chspline": splines.hermite, "natural": splines.cubic_spline}

# %% [markdown]
# :::{dropdown} Hint 1
# With `x = torch.linspace(0, 2 * math.pi, N + 1)` the points are `torch.stack([x, x.sin()], -1)`.
# :::
#
# :::{dropdown} Hint 2
# The error at the parameters `t` is `curve(t)[:, 1] - curve(t)[:, 0].sin()`, in absolute value.
# Take many `t` between 0.3 N and 0.7 N, and the largest error. <!-- given: 0.3, 0.7 -->
# :::
#
# :::{dropdown} Hint 3
# If the error with $N$ is $e_1$ and with $2N$ it is $e_2$, the order is $\log_2(e_1 / e_2)$. With
# $N = 32$ the powers are clear and rounding does not yet count.
# :::


# %%
def order(make):
    """Returns the order of convergence of a spline."""
    raise NotImplementedError("6.7 Which order is it?")


# %%
check("6.7", order)

# %% [markdown]
# ## Exercise 6.8: Waypoints that a car can follow
#
# *20 minutes. Differentiate through it.*
#
# A car cannot turn more tightly than with a radius of half a metre: its curvature stays below
# 2 1/m. Through the waypoints of the infinity `chspline` asks for more. But a waypoint counts as
# reached within 0.1 m, so nobody minds if we *move* each of them a little. Which way? The gradient
# of the curvature says so. Write `gentle(p)`, which returns points $(N, 2)$, each at most 0.1 m
# from its own in `p`, through which chspline has a curvature below 2 everywhere. `bends` below
# returns the absolute curvature at eleven places of each piece, both ends included.
# <!-- given: 0.1 m, half a metre, half -->


# %%
def bends(p):
    """Returns the absolute curvature (N - 1, 11) of chspline through p (N, 2)."""
    pieces = splines.hermite(p).spread()
    u = torch.linspace(0, 1, 11)
    return splines.curvature(pieces.local(u, 1), pieces.local(u, 2)).abs()


print("largest curvature (1/m):", bends(places).max().item())

# %% [markdown]
# :::{dropdown} Hint 1
# Only one place feels the gradient of a maximum. A high power, averaged, is nearly the maximum, and
# smooth: `(bends(moved) ** 16).mean() ** (1 / 16)`.
# :::
#
# :::{dropdown} Hint 2
# Let `z` be $(N, 2)$ free numbers, and move each point by
# $0.1\, z / \sqrt{1 + |z|^2}$. That is less than 0.1 m, whatever `z` is. <!-- given: 0.1, 0.1 m -->
# :::
#
# :::{dropdown} Hint 3
# `optimizer = torch.optim.Adam([z], lr=0.1)`, and a hundred times `optimizer.zero_grad()`, the
# loss, `loss.backward()`, `optimizer.step()`. Return the moved points, detached.
# <!-- given: a hundred times -->
# :::


# %%
def gentle(p):
    """Returns points (N, 2) near those of p, with a curvature below 2."""
    raise NotImplementedError("6.8 Waypoints that a car can follow")


# %%
check("6.8", gentle)

# %% tags=["hide-input"]
moved = gentle(places)
fig, (top, bottom) = plotting.stacked(2, height=3.2)
t = torch.linspace(0, 16, 1601)
both = [("as given", places, plotting.GREY, "--")]
both.append(("moved", moved, plotting.BLUE, "-"))
plotting.infinity_axes(top)
for name, p, color, style in both:
    curve = splines.hermite(p)
    top.plot(*curve(t).mT, style, color=color, label=f"chspline, points {name}")
    top.plot(*p.mT, "o" if name == "moved" else "s", color=color, ms=5)
    bottom.plot(t, splines.curvature(curve(t, 1), curve(t, 2)), style, color=color)
shift = moved - places
arrows = {"angles": "xy", "scale_units": "xy", "scale": 0.25, "width": 0.006}
arrows |= {"color": plotting.RED, "label": "move, drawn 4 times as long"}
top.quiver(*places.mT, *shift.mT, **arrows)
for bound in (-2, 2):
    bottom.axhline(bound, color="black", ls=":")
bottom.set(xlabel="waypoint", ylabel="curvature (1/m)")
fig.legend(*top.get_legend_handles_labels(), loc="outside lower center", ncols=3)
plotting.show(
    fig,
    "The curves through the waypoints before and after they were moved, with "
    "arrows for the moves, and both curvatures. After the moves the curvature "
    "keeps its bounds.",
)

# %% [markdown]
# ## Exercise 6.9: Smooth a track for the robot
#
# *15 minutes. On the robot, simulated. Open: many ways are right.*
#
# Somebody has led the Go1 around the infinity by its handle, and recorded its place every 0.1 m,
# with an error of 0.05 m in each coordinate: `recorded` $(126, 2)$. It shall walk the track by
# itself. Write `smooth_track(points)`, which returns states $(M, 4)$, $[i, j, \cos, \sin]$, along
# a smooth curve *near* the points, such that
#
# - the track leads from the first point to the last, to within 0.2 m, and its states are 0.02 to
#   0.2 m apart;
# - the headings have length 1 and are the directions of travel, and turn by at most 5 rad a metre;
# - its states are within 0.035 m of the two circles on average (the recording is within 0.04 m);
# - the simulated dog walks it, less than 0.06 m from the circles on average, within 25 s.
#
# You may not use the circles themselves; another recording will be tried as well.
# <!-- given: 0.1 m, 0.05 m, 0.2 m, 0.02, 5 rad, 0.035 m, 0.04 m, 0.06 m, 25 s -->
#
# :::{dropdown} Hint 1
# A curve that passes noisy points is as noisy as they are. A curve with fewer points to steer it
# than there are measurements has to average.
# :::
#
# :::{dropdown} Hint 2
# A B-spline is a sum of bumps: `splines.uniform_bspline(torch.eye(n))(t)` is the matrix of all
# bumps at the parameters `t`. Which points make the curve fit the recording best, in the sense of
# least squares?
# :::
#
# :::{dropdown} Hint 3
# `torch.linalg.lstsq(matrix, points).solution` with about 16 bumps, for parameters spread evenly
# from 0 to `n - 3`. Then `splines.evenly_spaced(curve, 126)` gives parameters at equal distances,
# and `splines.heading` the direction of the velocity. <!-- given: 16 -->
# :::

# %%
distance = torch.linspace(0, infinity.LENGTH, 126)
generator = torch.Generator().manual_seed(6)
noise = 0.05 * torch.randn(126, 2, generator=generator)
recorded = infinity.reference(distance)[:, :2] + noise


# %%
def smooth_track(points):
    """Returns states (M, 4) along a smooth curve near the points (N, 2)."""
    raise NotImplementedError("6.9 Smooth a track for the robot")


# %%
check("6.9", smooth_track)


# %% tags=["hide-input"]
def along(track):
    """Returns what to aim at: the third state after the one that is nearest."""
    place = 0

    def aim(x, goal):
        nonlocal place
        window = track[place : place + 10, :2]
        place = place + (window - x[:2]).norm(dim=-1).argmin().item()
        return track[min(place + 3, len(track) - 1)]

    return aim


# %% tags=["hide-input"]
track = smooth_track(recorded)
planner = infinity.controller()
planner.stepper = pp.utils.ReduceToBason(steps=3)
trot = torch.tensor([1.2, 1.5])  # m/s, rad/s
bounds = {"u_lower": torch.tensor([0.0, -1.5]), "u_upper": trot, "tolerance": 0.2}
with go1.connect("sim", start=(0.0, 0.0, -math.pi / 2)) as robot:
    world = infinity.RealRobot(robot)
    walk = infinity.drive(planner, world, aim=along(track), steps=250, **bounds)
fig, ax = plt.subplots(figsize=(7, 4))
plotting.infinity_axes(ax)
ax.plot(*recorded.mT, ".", color=plotting.GREY, label="recorded")
ax.plot(*track[:, :2].mT, color=plotting.GREEN, lw=2, label="smooth track")
plotting.plot_states(ax, walk.x, label="the dog, as it says")
fig.legend(loc="outside lower center", ncols=3)
alt = "Noisy places around the infinity, a smooth track, and the dog's way."
plotting.show(fig, alt)

# %%
progress()
