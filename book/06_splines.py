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
# # Splines
#
# Waypoints say where to be, not how to get there. A spline does: a smooth curve through a few
# points, made of pieces simple enough to write down. And when the car is pushed aside, a new one
# leads back.
#
# After this chapter you can
#
# - draw a smooth curve through waypoints, in ten lines of your own;
# - say what a continuous second derivative costs, and choose between Hermite and B-spline;
# - plan from where the car *is*, and merge with the path it should be on;
# - interpolate poses in space, and say why their numbers must not be interpolated;
# - differentiate through a curve, to make it gentler.
#
# You need [chapter 1](01_systems.py) (the car) and [chapter 3](03_mpc.py) (the loop). The chapter
# reproduces Fig. 4 (a) of the paper {cite}`pypose06`. Take about 90 minutes for it.
# <!-- given: 90 minutes -->

# %%
import inspect
import math
from functools import partial

import ipywidgets
import matplotlib.pyplot as plt
import torch
from IPython.display import Markdown, display
from torch.autograd import gradcheck

import pypose_lite as pp
from pypose_lite import go1, infinity, lie, splines
from pypose_lite.splines import planner
from pypose_lite.teaching import claim, plotting, widgets

plotting.use_style()
torch.set_default_dtype(torch.float64)
W = infinity.waypoints()  # 17 states [i, j, cos, sin]
P, off = W[:, :2], infinity.tracking_error  # their places; how far from the circles
circles = infinity.reference(torch.linspace(0, infinity.LENGTH, 200))

# %% tags=["hide-input"]
shifted = W[0] + torch.tensor([-0.3, 0.2, 0, 0])
blue = pp.local_plan(W[0], W, 1, spacing=0.1, count=126)
red = pp.local_plan(shifted, W, 1, spacing=0.1, count=20)
fig, ax = plt.subplots(figsize=(7, 4.3))
plotting.plot_reference(plotting.infinity_axes(ax), circles, label="two circles")
plotting.plot_states(ax, blue, label="plan")
plotting.plot_states(ax, red, label="plan after a shift", color=plotting.RED)
plotting.plot_heading(ax, W, length=0.3)
ax.plot(*shifted[:2], "s", color=plotting.RED, ms=7)
fig.legend(loc="outside lower center", ncols=3)
plt.show()
turns = (blue[1:, 2:] * blue[:-1, 2:]).sum(-1).clamp(max=1).acos()
claim("turn_a_step", turns.max(), below=0.11, unit="rad")
claim("plan_off_circles", off(blue).max(), below=1e-5, unit="m")
claim("shift_off_circles", off(red[0]), above=0.1, unit="m")
claim("merged_off_circles", off(red[-5:]).max(), below=1e-5, unit="m")

# %% [markdown]
# The black arrows are the waypoints with their headings, and all that the planner gets. The blue
# plan starts at the origin and lies on the orange circles, to {claim}`plan_off_circles`. The red
# one starts beside the path, at the square. It leaves in the car's direction, bends, and at the
# next waypoint it *is* the blue one. Nobody told the planner that there are circles.

# %% [markdown]
# ## See it fail
#
# The loop of chapter 3 always aims at the next waypoint. Here is how fast it drives. And here is
# the first cure that comes to mind, more points: `on_lines` aims 0.3 m ahead, on the straight line
# to the next waypoint. <!-- given: 0.3 m -->
#
# **Predict.** What do the lines make better: the ride, the path, or both?


# %%
def on_lines(x, goal):
    way = W[goal, :2] - x[..., :2]
    far = way.norm(dim=-1, keepdim=True)
    return torch.cat([x[..., :2] + way / far * far.clamp(max=0.3), way / far], -1)


mpc = infinity.controller()
mpc.stepper = pp.utils.ReduceToBason(steps=3)  # sweeps a plan, as in chapter 3
hops, lines = infinity.drive(mpc), infinity.drive(mpc, aim=on_lines)
fig, (left, right) = plt.subplots(1, 2, figsize=(7, 2.9), width_ratios=[1.4, 1])
plotting.plot_waypoints(plotting.infinity_axes(left), W)
for aim, run, color in [("points", hops, plotting.GREY), ("lines", lines, "C0")]:
    plotting.plot_states(left, run.x, label=f"aims at {aim}", color=color)
    right.plot(0.1 * torch.arange(len(run.u)), run.u[:, 0], ".-", color=color)
right.set(xlabel="time (s)", ylabel="speed (m/s)", ylim=(0, None))
fig.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3)
plt.show()
claim("slowest_hop", hops.u[1:, 0].min(), below=1, unit="m/s")
claim("fastest_hop", hops.u[:, 0].max(), above=4, unit="m/s")
claim("chord_off", off((P[1:] + P[:-1]) / 2).max(), above=0.07, below=0.08, unit="m")

# %% [markdown]
# <details><summary>Answer</summary>
#
# The ride. Aiming at points the car hops: every three steps it falls from {claim}`fastest_hop` to
# {claim}`slowest_hop` and starts again. On the lines its inputs change {claim}`smoother_lines`
# times less (mean square of the change per step). The path is hardly better, {claim}`strays_lines`
# from the circles on average instead of {claim}`strays_hops`: a chord passes {claim}`chord_off`
# inside its circle.
#
# </details>
#
# Worse, at every waypoint the lines turn by 45 degrees on the spot, which no car can do. We want
# points as dense as we like, on a curve that has one direction everywhere.

# %% [markdown]
# ## From scratch
#
# Take one piece, from a point $p_0$ to a point $p_1$. Besides the points we choose the derivatives
# $m_0$ and $m_1$ at both ends, called *tangents*. Four wishes; a cubic in $u$, running from 0 to 1,
# has four coefficients:
#
# $$
# p(u) = p_0 + m_0 u + (3 d - 2 m_0 - m_1)\, u^2 + (m_0 + m_1 - 2 d)\, u^3, \qquad d = p_1 - p_0
# $$ (eq-6-hermite)
#
# Put in $u = 0$ and $u = 1$, here and in the derivative: all four come true. This is Hermite's
# cubic. The directions we know, they are the headings of the waypoints. Their length is ours to
# choose.
#
# **Predict.** From the start to the second waypoint the car turns by a right angle. Tangents half
# as long as the chord, as long, or twice as long: which is closest to the circle?


# %%
def piece(p0, p1, m0, m1, u):
    d, u = p1 - p0, u[:, None]
    return p0 + m0 * u + (3 * d - 2 * m0 - m1) * u**2 + (m0 + m1 - 2 * d) * u**3


u, chord = torch.linspace(0, 1, 41), (P[2] - P[0]).norm()
fig, (left, right) = plt.subplots(1, 2, figsize=(7, 3))
arc = infinity.reference(torch.linspace(0, math.pi / 2, 50))
plotting.plot_reference(left, arc, label="circle")
ratios = torch.linspace(0.2, 2.6, 49)
h, k = chord * W[[0, 2], 2:]  # along the headings
tries = [piece(P[0], P[2], r * h, r * k, u) for r in ratios]
for index, style in [(6, ":"), (16, "--"), (36, "-.")]:
    left.plot(*tries[index].mT, style, color="C0", label=f"{ratios[index]:.1f} chord")
left.set(xlabel="i (m)", ylabel="j (m)", aspect="equal")
left.legend(loc="upper right")
right.plot(ratios, worst := torch.stack([off(z).max() for z in tries]))
right.set(xlabel="tangent / chord", ylabel="farthest off (m)", ylim=(0, None))
plt.show()
claim("best_tangent", ratios[worst.argmin()], above=1.0, below=1.3)

# %% [markdown]
# <details><summary>Answer</summary>
#
# As long, or a little longer: {claim}`best_tangent` is best. Short tangents give nearly the chord,
# long ones overshoot. For an arc there is a closed form: with headings $h$, $k$ and chord $c$, the
# length
#
# $$ \frac{4\, c}{2 + |h + k|} $$ (eq-6-length)
#
# puts the middle of the piece exactly on the circle.
#
# </details>
#
# And without headings? Let the curve pass each point in the direction from the last point to the
# next, $m_i = (p_{i+1} - p_{i-1}) / 2$; at the ends, take the only leg there is. That is
# `my_chspline`. Two pieces that meet share a tangent, so the first derivative is continuous.

# %% [markdown]
# ## The library's version
#
# `my_chspline`, in ten lines, and the library's. The line with `interval` is the paper's.


# %%
def my_chspline(p, k):
    """k points a piece, and the last one."""
    leg = p.diff(dim=0)
    m = torch.cat([leg[:1], (leg[1:] + leg[:-1]) / 2, leg[-1:]])
    u = torch.arange(k) / k
    pieces = [piece(*ends, u) for ends in zip(p, p[1:], m, m[1:])]
    return torch.cat([*pieces, p[-1:]])


waypoints = P
points = pp.chspline(waypoints, interval=0.2)
claim("same_points", (points - my_chspline(P, 5)).abs().max(), below=1e-14)
many = P + 0.1 * torch.randn(64, 17, 2, generator=torch.Generator().manual_seed(0))
apart = pp.chspline(many, 0.2) - torch.stack([pp.chspline(p, 0.2) for p in many])
claim("batch", apart.abs().max(), below=1e-12, unit="m")
gaps = points.diff(dim=0).norm(dim=-1)
claim("gap_smallest", gaps.min(), above=0.13, unit="m")
claim("gap_largest", gaps.max(), below=0.18, unit="m")
tangents = splines.cubic_hermite.catmull_rom
for function in (tangents, splines.hermite_segments, splines.Spline.local):
    print(inspect.getsource(function).split('"""')[2])

# %% [markdown]
# The first function chooses the tangents, the second makes pieces of them, the third says where the
# curve is. Points may have times of their own; without them every piece takes 1 (`h` and `time`),
# and a slope is a leg. The lines with a group are for poses, later.
#
# The library keeps a curve as a `Spline`. Each piece has a start and *three steps*, and three
# functions say how much of each step is done at $u$ (the weights, in `local`):
#
# $$
# p(u) = \text{start} + \lambda_1(u)\, s_1 + \lambda_2(u)\, s_2 + \lambda_3(u)\, s_3
# $$ (eq-6-steps)
#
# For Hermite's cubic the steps are $m_0/3$, $d - m_0/3 - m_1/3$ and $m_1/3$. (They join Bézier's
# control points. Insert $\lambda_1 = 3u - 3u^2 + u^3$, $\lambda_2 = 3u^2 - 2u^3$,
# $\lambda_3 = u^3$, and {eq}`eq-6-hermite` comes out.) Why steps? Because a step makes sense where
# a sum of points does not: on poses, later.
#
# Derivatives come from the same functions. The velocity $p' = (x', y')$ gives the heading, and with
# the acceleration the curvature, the inverse radius of the turn:
#
# $$ \kappa = \frac{x' y'' - y' x''}{|p'|^3} $$ (eq-6-curvature)
#
# At speed $v$ a car turns at the rate $v \kappa$. Where the curvature jumps, so must its steering.
#
# ### What continuity costs
#
# Can the second derivative be continuous, too? Let us take the legs between the points as the
# steps. Step 2 of a piece is then step 1 of the next. So what is done of it, $\lambda_2$, must go
# over into the next piece's $\lambda_1$ without a jump, and both derivatives as well; before its
# first piece a step is not begun (0), after its third it is done (1). Four transitions, three
# conditions each: twelve equations for twelve coefficients. There is exactly one such curve, the
# uniform *B-spline* {cite}`deboor2001`, `pp.bspline`.

# %%
# Value, first and second derivative of c0 + c1 u + c2 u^2 + c3 u^3 at u = 0 and 1.
start = torch.tensor([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 2, 0]])
end = torch.tensor([[1.0, 1, 1, 1], [0, 1, 2, 3], [0, 0, 2, 6]])
M, b = torch.zeros(4, 3, 3, 4), torch.zeros(12)
for j in range(4):  # lambda_{j+1} ends as lambda_j starts
    if j < 3:
        M[j, :, j] = end
    if j > 0:
        M[j, :, j - 1] = -start
b[0] = 1  # the first step ends done
table = torch.linalg.solve(M.reshape(12, 12), b).reshape(3, 4)
print((6 * table).round().int())
library = torch.tensor(splines.b_spline.UNIFORM)
claim("same_table", (table - library).abs().max(), below=1e-12)

# %% [markdown]
# These are six times the coefficients. Look at the first row: at the start of a piece five sixths
# of its first step are done already. The curve never goes *through* a point.
#
# **Predict.** There is a third way: Hermite's pieces, and tangents for which the second derivative
# does not jump. One linear system gives them all. The curve passes all points and has two
# continuous derivatives. What do we lose?
#
# ## On the infinity
#
# Four curves. *global* is the third way, in the library `splines.cubic_spline`. *path*, the
# library's `planner.path`, is Hermite's cubic with the waypoints' own headings and the length
# {eq}`eq-6-length`.


# %%
def global_spline(p):
    """The tangents solve m[i-1] + 4 m[i] + m[i+1] = 3 (p[i+1] - p[i-1])."""
    ones, leg = torch.ones(len(p) - 1), 3 * p.diff(dim=0)
    M = 4 * torch.eye(len(p)) + ones.diag(1) + ones.diag(-1)
    M[0, 0] = M[-1, -1] = 2  # no bend at the ends
    right = torch.cat([leg[:1], leg[1:] + leg[:-1], leg[-1:]])
    return splines.hermite(p, torch.linalg.solve(M, right))


def b_spline(p):
    ends = 2 * p[:1] - p[1:2], 2 * p[-1:] - p[-2:-1]  # so that it ends on p
    return splines.uniform_bspline(torch.cat([ends[0], p, ends[1]]))


curves = {
    "chspline": (lambda w: splines.hermite(w[:, :2]), plotting.RED, "--"),
    "bspline": (lambda w: b_spline(w[:, :2]), plotting.GREEN, "-."),
    "global": (lambda w: global_spline(w[:, :2]), plotting.PURPLE, ":"),
    "path": (planner.path, plotting.BLUE, "-"),
}


# %%
def bend(curve, t):
    return splines.curvature(curve(t, 1), curve(t, 2))


t = torch.linspace(0, 16, 2561)
fig, (left, right) = plt.subplots(1, 2, figsize=(7, 3.5), width_ratios=[1, 1.3])
plotting.plot_reference(plotting.infinity_axes(left), circles, label="circles")
plotting.plot_waypoints(left, W)
left.set(xlim=(-0.65, 1.1), ylim=(-1.15, 1.15))
for name, (make, color, style) in curves.items():
    left.plot(*make(W)(t).mT, style, color=color, lw=1.4, label=name)
    right.plot(t, bend(make(W), t), style, color=color, lw=1.4)
right.set(xlabel="waypoint", ylabel="curvature (1/m)", xlim=(0, 16))
_ = fig.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=6)

# %% mystnb={"markdown_format": "myst"}
head = "| | off the circles (m) | off the points (m) | curvature (1/m) | its jumps |"
table, seen = head + "\n|:--|--:|--:|--:|--:|", {}
for name, (make, _, _) in curves.items():
    curve = make(W)
    kappa, before = bend(curve, t[1:]), bend(curve, t[1:] - 1e-9)
    missed = torch.cdist(P, curve(t)).amin(-1).max()
    jumps = (kappa - before).abs().max()
    seen[name] = off(curve(t)).max(), missed, kappa.abs().max(), jumps
    table += f"\n| {name} |" + "".join(f" {value:.4f} |" for value in seen[name])
display(Markdown(table))
claim("chspline_off", seen["chspline"][0], below=0.06, unit="m")
claim("chspline_curvature", seen["chspline"][2], above=2, unit="1/m")
claim("chspline_jump", seen["chspline"][3], above=1, unit="1/m")
claim("bspline_missed", seen["bspline"][1], above=0.08, unit="m")
claim("bspline_curvature", seen["bspline"][2], below=1.2, unit="1/m")
claim("no_jump", max(seen["bspline"][3], seen["global"][3]), below=1e-6)
claim("path_off", seen["path"][0], below=1e-5, unit="m")
apart = global_spline(P)(t) - splines.cubic_spline(P)(t)
claim("same_global", apart.abs().max(), below=1e-12, unit="m")

# %% [markdown]
# The circles' own curvature is 1, then -1. *chspline* is {claim}`chspline_off` off, with a
# curvature of {claim}`chspline_curvature`, beside the crossing and at both ends: central
# differences guess a wrong direction there. At its points the curvature jumps, by up to
# {claim}`chspline_jump`. *bspline* never bends more than {claim}`bspline_curvature`, without a
# jump, and cuts every corner: it misses waypoints by {claim}`bspline_missed`. *global* passes, and
# does not jump. *path* is {claim}`path_off` off; at the crossing it has to jump, as the circles do.
#
# So what does *global* lose? Move one waypoint, and see which pieces notice.


# %%
def move(i=0.3, j=0.0, number=4):
    fig, (left, right) = plt.subplots(1, 2, figsize=(7, 3.2), width_ratios=[1.3, 1])
    w = W + torch.eye(17)[number, :, None] * torch.tensor([i, j, 0, 0])
    plotting.plot_waypoints(plotting.infinity_axes(left, margin=0.75), w)
    for name, (make, color, style) in curves.items():
        change = (make(w)(middles) - make(W)(middles)).norm(dim=-1)
        here = change > 1e-12
        felt[name] = int(here.sum())
        right.semilogy(middles[here], change[here], "o" + style, color=color, ms=4)
        left.plot(*make(w)(t).mT, style, color=color, label=name)
    right.set(xlabel="waypoint", ylabel="the piece moves by (m)", xlim=(0, 16))
    fig.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=5)
    return fig


felt, middles = {}, torch.arange(16) + 0.5  # of the pieces
display(widgets.panels(move, [-0.4, -0.2, 0.2, 0.4, 0.6], "waypoint 4 moves by (m)"))
for name, pieces in {"chspline": 4, "bspline": 4, "global": 16, "path": 2}.items():
    claim(f"felt_{name}", felt[name], equals=pieces)

# %% [markdown]
# <details><summary>Answer</summary>
#
# Locality. A waypoint is felt by {claim}`felt_path` pieces of path, by {claim}`felt_chspline` of
# chspline, by {claim}`felt_bspline` of bspline, and by all {claim}`felt_global` of *global*, fading
# from one to the next. Of three wishes (two continuous derivatives, passing the points, being left
# alone by points far away) cubics grant two. A planner gets new waypoints all the time, and gives
# up the first.
#
# </details>
#
# ### From where the car is
#
# Now the paper's Fig. 4 (a), close up. The car is beside the first waypoint; put its state in the
# waypoint's place. On the left is the paper's `chspline`, which knows only places; on the right
# *path*, which `pp.local_plan` samples at equal distances.


# %%
def shift(side, ahead=0.0, turn=0.0):
    w = W.clone()
    w[0] = torch.tensor([side, -ahead, math.sin(turn), -math.cos(turn)])
    fig, panels = plt.subplots(1, 2, figsize=(7, 4.2), sharey=True)
    for ax, name in zip(panels, ["chspline", "path"]):
        blue, red = (curves[name][0](z).sample(interval=0.2) for z in (W, w))
        plotting.plot_reference(plotting.infinity_axes(ax, name), circles, "circles")
        plotting.plot_states(ax, blue, "plan")
        plotting.plot_states(ax, red[:13], "plan after a shift", plotting.RED)
        plotting.plot_heading(ax, W, length=0.2)
        ax.set(xlim=(-0.7, 1.2), ylim=(-1.2, 0.6))
        merges[name] = (red != blue).any(-1).nonzero().max() // 5 + 1
    fig.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return fig


merges = {}
display(widgets.panels(shift, [-0.4, -0.2, 0.1, 0.2, 0.3], "shift to the side (m)"))
claim("chspline_merges", merges["chspline"], equals=2)
claim("plan_merges", merges["path"], equals=1)


# %% tags=["remove-cell"]
def slider(name, value=0.0, end=1.0):
    options = {"min": -end, "max": end, "step": 0.05, "description": name}
    return ipywidgets.FloatSlider(value, **options)


which = ipywidgets.IntSlider(4, 0, 16, description="waypoint")
display(widgets.live(move, i=slider("i (m)", 0.3), j=slider("j (m)"), number=which))
beside = {"side": slider("side (m)", 0.3), "ahead": slider("ahead (m)")}
display(widgets.live(shift, **beside, turn=slider("turn (rad)", end=3.0)))

# %% [markdown]
# | the paper on Fig. 4 (a) | chspline | path |
# |:--|:--|:--|
# | blue: "high degree of alignment" | {claim}`chspline_off` off | {claim}`path_off` off |
# | red "eventually merges smoothly" | waypoint {claim}`chspline_merges` | {claim}`plan_merges` |
# | "continuous first derivative" | jumps by {claim}`first_jump` | {claim}`turn_a_step` a step |
# | "evenly distributed" | {claim}`gap_smallest` to {claim}`gap_largest` | as asked for |
# | 64 sequences in one call | off by {claim}`batch` | "Follow the plan" |
#
# Merged means *the same numbers*: locality again. Without headings the shifted point also bends the
# tangent at the next one, and chspline needs a piece more. In JupyterLab, sliders above move any
# waypoint, and the car.
#
# ### Follow the plan
#
# Close the loop: in each step the car plans from where it is, and aims at the point 0.3 m ahead on
# its plan. Sixteen cars, fifteen of them shifted, in one call. <!-- given: 0.3 m -->


# %%
def ahead(x, goal, distance=0.3):
    return pp.local_plan(x, W, goal, spacing=distance, count=2)[..., 1, :]


start = W[0].repeat(16, 1)
start[1:, :2] += 0.2 * torch.randn(15, 2, generator=torch.Generator().manual_seed(0))
run = infinity.drive(mpc, infinity.SimulatedCar(x_init=start), aim=ahead, steps=90)
fig, (left, right) = plt.subplots(1, 2, figsize=(7, 2.9), width_ratios=[1.4, 1])
plotting.plot_reference(plotting.infinity_axes(left), circles, label="circles")
plotting.plot_states(left, run.x[1:], label="15 shifted cars", color=plotting.RED)
plotting.plot_states(left, run.x[0], label="the car")
for u, name in [(hops.u, "the car, aims at points"), (run.u[0], None)]:
    color = plotting.GREY if name else plotting.BLUE
    right.plot(0.1 * torch.arange(len(u)), u[:, 0], ".-", color=color, label=name)
right.set(xlabel="time (s)", ylabel="speed (m/s)", ylim=(0, None))
fig.legend(loc="outside lower center", ncols=4)
plt.show()
far = off(run.x[:, :-1])
claim("all_arrive", run.finished.all(), equals=True)
claim("shifted_later", far[run.running & (run.goal > 2)].max(), below=0.06, unit="m")


# %%
def restless(u):
    return u.diff(dim=0).square().mean()


x, u, goal = (z[0, : run.steps[0]] for z in (run.x, run.u, run.goal))
claim("smoother_lines", restless(hops.u) / restless(lines.u), above=4)
claim("smoother_plan", restless(hops.u) / restless(u), above=50)
for name, path in [("hops", hops.x), ("lines", lines.x), ("plan", x)]:
    claim(f"strays_{name}", off(path).mean(), below=0.025, unit="m")
claim("overshoot_hops", off(hops.x).max(), above=0.05, unit="m")
claim("overshoot_plan", off(x).max(), below=0.05, unit="m")
whole = infinity.controller()  # sweeps until it has converged
from_hops = whole.solve(0.1, hops.x[:-1], W[hops.goal]).iterations.double()
claim("sweeps_hops", from_hops.mean(), above=4, below=6)
from_plan = whole.solve(0.1, x, ahead(x, goal)).iterations.double()
claim("sweeps_plan", from_plan.mean(), below=6)
half = infinity.drive(infinity.controller(T=5), aim=ahead, steps=90)
claim("strays_half", off(half.x).mean(), below=0.0185, unit="m")
farther = infinity.drive(mpc, aim=partial(ahead, distance=0.5), steps=30)
claim("reached_farther", farther.goal.max() - 1, below=4)

# %% [markdown]
# All arrive. The unshifted car's inputs change {claim}`smoother_plan` times less than when it hops,
# and it strays {claim}`strays_plan` on average. The others are pulled back: past the second
# waypoint none is farther off than {claim}`shifted_later`. The paper adds that dense waypoints
# "could decrease the computing cost of MPC and overshoot probability". Overshoot, yes:
# {claim}`overshoot_plan` at most, {claim}`overshoot_hops` before. The cost: a plan takes
# {claim}`sweeps_plan` sweeps, hardly fewer than {claim}`sweeps_hops`, but *half the horizon* will
# do. With five steps the car strays {claim}`strays_half`.
#
# Aim 0.5 m ahead, and in 30 steps it reaches {claim}`reached_farther` waypoints. It drives faster,
# passes the first waypoint by more than the tolerance, and its plan turns round for it. Do not look
# farther than you can miss. <!-- given: 0.5 m -->

# %% [markdown]
# ## Poses
#
# A *pose* is a place and a direction: $[x, y, \cos, \sin]$ in the plane; in space three coordinates
# and a unit quaternion. What is half way between two poses? Not the mean of the numbers: headings
# of 179° and -179° are neighbours, and their mean looks the other way. <!-- given: 179° -->
#
# Ask a car instead. With a constant *twist* $\xi = [v_x, v_y, \omega]$, speed and turn rate in its
# own frame, it drives an arc. Its pose after time 1, seen from where it started, is called
# $\exp(\xi)$; seen from the world it is $T_0 \exp(\xi)$, for poses are composed like matrices. The
# twist that leads from one pose to another is the *logarithm*. So the way from $T_0$ to $T_1$ is
#
# $$ T(u) = T_0 \exp(u\, \xi), \qquad \xi = \log(T_0^{-1} T_1) $$ (eq-6-geodesic)
#
# **Predict.** Take waypoints 4 and 7. Is the way between them a straight line, the circle, or
# neither?

# %%
u, (A, B) = torch.linspace(0, 1, 9)[:, None], W[[4, 7]]
xi = lie.se2_log(lie.se2_compose(lie.se2_inverse(A), B))
along = lie.se2_compose(A, lie.se2_exp(u * xi))
mixed = (1 - u) * A + u * B
angle = (1 - u) * torch.atan2(A[3], A[2]) + u * torch.atan2(B[3], B[2])
turned = torch.cat([mixed[:, :2], angle.cos(), angle.sin()], -1)
fig, panels = plt.subplots(1, 3, figsize=(7, 2.5), sharey=True)
ways = {"numbers: cos, sin": mixed, "numbers: angle": turned, "exp and log": along}
for ax, (name, x) in zip(panels, ways.items()):
    plotting.plot_reference(plotting.infinity_axes(ax, name), circles)
    plotting.plot_heading(ax, x, length=0.5, color=plotting.BLUE).width = 0.012
    plotting.plot_heading(ax, torch.stack([A, B]), length=0.5).width = 0.012
    ax.set(xlim=(-0.2, 2.4), ylim=(-0.5, 1.4))
    ax.label_outer()
plt.show()
claim("shortest_arrow", mixed[:, 2:].norm(dim=-1).min(), below=0.5)
claim("on_the_circle", off(along).max(), below=1e-12, unit="m")
hat = torch.tensor([[0, -xi[2], xi[0]], [xi[2], 0, xi[1]], [0, 0, 0]])
by_matrix = lie.se2_matrix(A) @ torch.linalg.matrix_exp(hat)
claim("matrix_exp", (by_matrix - lie.se2_matrix(B)).abs().max(), below=1e-12)

# %% [markdown]
# <details><summary>Answer</summary>
#
# The circle, to {claim}`on_the_circle`: going round at constant speed *is* a constant twist. Mixed
# cosines and sines shrink to {claim}`shortest_arrow`. Mixed angles turn the long way round.
#
# </details>
#
# The name is earned (the last claim): it is the exponential of the matrix
#
# $$ \begin{bmatrix} 0 & -\omega & v_x \\ \omega & 0 & v_y \\ 0 & 0 & 0 \end{bmatrix} . $$
#
# In space a twist has six numbers, and a spline of poses is {eq}`eq-6-steps` with twists as steps
# {cite}`kim1995`:
#
# $$ T(u) = T_0 \exp(\lambda_1 s_1) \exp(\lambda_2 s_2) \exp(\lambda_3 s_3) $$ (eq-6-poses)
#
# `pp.chspline` and `pp.bspline` do this when they are given an `SE3`. Here is the body of a dog
# that walks the first circle over a hill: nose along the slope, leaning into the turn.


# %%
s, stand = torch.arange(9) * math.pi / 4, torch.zeros(9, 7)
stand[:, :2], stand[:, 6] = P[:9], 1
yaw, tilt = torch.zeros(2, 9, 6)  # twists, m and rad
yaw[:, 5] = s - math.pi / 2
tilt[:, 3], tilt[:, 4] = -0.6 * (s / 2).sin() ** 2, -(0.4 * s.sin()).atan()
flat = pp.SE3(stand) @ pp.se3(yaw).Exp()
stand[:, 2] = 0.6 - 0.4 * s.cos()  # the hill
body = pp.SE3(stand) @ pp.se3(yaw).Exp() @ pp.se3(tilt).Exp()
way = pp.chspline(body, 0.05)
fig, ax = plt.subplots(figsize=(7, 4.6), subplot_kw={"projection": "3d", "azim": -70})
for M, size, w in [(way[::5].matrix(), 0.16, 0.8), (body.matrix(), 0.4, 2.2)]:
    for axis, c in enumerate([plotting.RED, plotting.GREEN, plotting.BLUE]):
        ax.quiver(*M[:, :3, 3].mT, *size * M[:, :3, axis].mT, color=c, lw=w)
ax.plot(*way.translation().mT, color="black")
ax.plot(*circles[:101, :2].mT, 0, color=plotting.ORANGE, lw=3)
ax.set(xlabel="i (m)", ylabel="j (m)", zlabel="height (m)", zlim=(0, 1.3))
ax.set(xlim=(-0.3, 2.3), ylim=(-1.3, 1.3))
ax.set_box_aspect((2, 2, 1), zoom=1.2)
claim("poses_passed", (way[::20] - body).abs().max(), below=1e-12)
claim("flat_off", off(pp.bspline(flat, 0.1)).max(), below=1e-12, unit="m")

# %% [markdown]
# Red is forwards, green left, blue up; the long axes are the nine poses, the circle is the ground.
# The curve passes all nine, to {claim}`poses_passed`. Without the hill even the bspline of the
# poses is the circle itself, to {claim}`flat_off`. That of the *places* cut every corner; but to a
# spline of poses, a circle is as straight as a line. And nobody gave it tangents: poses know where
# they look.

# %% [markdown]
# ## Break it
#
# - **By parameter.** Six waypoints, the last two far apart; samples at equal steps of the
#   parameter.
# - **Numbers.** The dog's quaternions, given to `chspline` as plain numbers. All have $w \ge 0$, as
#   many sensors deliver them.
# - **Rounding.** `interval=1/k`, and `math.ceil(1 / interval)` samples a piece.
#
# **Predict.** Which of the three can be seen on a map of the places?

# %%
curve = splines.hermite(P[[0, 1, 2, 3, 4, 8]])
ways = torch.linspace(0, 5, 31), splines.evenly_spaced(curve, 31)
uneven, even = (curve(t).diff(dim=0).norm(dim=-1) for t in ways)
fig, (one, two, three) = plt.subplots(1, 3, figsize=(7, 2.6))
one.plot(uneven, "s-", ms=3, label="by parameter")
one.plot(even, "o-", ms=3, label="by distance")
one.set(title="by parameter", xlabel="sample", ylabel="way to the next (m)")
one.legend(loc="upper left")
q = body.rotation()
as_numbers = pp.chspline(q.where(q[:, 3:] > -1e-9, -q), 0.05)  # w is not negative
length = torch.stack([as_numbers, way.rotation()]).norm(dim=-1)
two.plot(0.05 * torch.arange(161), length.mT)
two.set(title="numbers", xlabel="pose", ylabel="length of quaternion", ylim=(0, 1.3))
broken = [k for k in range(1, 201) if math.ceil(1 / (1 / k)) > k]
three.vlines(broken, 0, 1, color=plotting.BLUE)
three.set(title="rounding", xlabel="k", ylabel="samples too many", yticks=[0, 1])
claim("uneven", uneven.max() / uneven.min(), above=2)
claim("shrunk", length[0].min(), below=0.5)
claim("unit", (length[1] - 1).abs().max(), below=1e-12)
claim("surplus_intervals", len(broken), equals=6)

# %% [markdown]
# <details><summary>Answer</summary>
#
# Only the first, as dots that spread out. In the second the places are right, and in the third two
# dots lie on top of each other.
#
# </details>
#
# - **By parameter.** One sample a step, and the car would have to speed up {claim}`uneven` times.
#   The parameter knows no metres. How long a curve is has no formula; `splines.arc_length` adds up
#   $|p'|$ (Gauss's quadrature, on shorter pieces where a second rule does not agree), and
#   `splines.evenly_spaced` and `pp.local_plan` turn the question round by Newton's method.
# - **Numbers.** $q$ and $-q$ are the same rotation. Where the sign changes, numbers go through the
#   middle: a length of {claim}`shrunk`. Scaled back to 1, the dog somersaults. Plot the length; fix
#   by {eq}`eq-6-poses`, that is, by `pp.SE3(...)` (the red line, 1 to {claim}`unit`).
# - **Rounding.** In floating point $1 / (1/49)$ is a little more than 49. For
#   {claim}`surplus_intervals` of 200 values of $k$ a piece gets one sample too many, $10^{-16}$
#   before its end, and a heading from differences is noise. Fix: round; and take headings from the
#   derivative.

# %% [markdown]
# ## Verify
#
# *Order.* Take $N$ points of a circle, then twice as many: the error has to fall by the curve's own
# power of the spacing. A wrong coefficient spoils the power. That the error falls proves nothing.
# *Continuity.* Both sides of the knots, for points and poses. It sees tables that do not fit
# together, and is blind to those that fit and lead elsewhere. *Gradients,* as ever, against
# differences.


# %%
def errors(N):
    ring = infinity.reference(torch.linspace(0, 2 * math.pi, N + 1))
    t = torch.linspace(0.3 * N, 0.7 * N, 12 * N)  # far from the ends
    return torch.stack([off(make(ring)(t)).max() for make, _, _ in curves.values()])


for name, order, power in zip(curves, (errors(32) / errors(64)).log2(), [4, 2, 4, 6]):
    claim(f"order_{name}", order, equals=power, within=0.2)


def jump(curve, derivative):
    t = torch.arange(1.0, curve.segments)
    return (curve(t, derivative) - curve(t - 1e-12, derivative)).abs().max()


claim("first_jump", jump(splines.hermite(P), 1), below=1e-9)
claim("poses_jump", jump(splines.hermite(body), 1), below=1e-9)
claim("bspline_jump", jump(splines.uniform_bspline(body), 2), below=1e-9)
w = W[:4].clone().requires_grad_()
claim("gradcheck", gradcheck(lambda w: pp.local_plan(w[0], w, 1), w), equals=True)

# %% [markdown]
# The orders: chspline {claim}`order_chspline`, bspline {claim}`order_bspline` (it never reaches its
# points), global {claim}`order_global`, path {claim}`order_path`. Poses are as smooth as points:
# chspline's first derivatives jump by {claim}`poses_jump`, bspline's second ones by
# {claim}`bspline_jump`. `gradcheck` goes through a whole plan, lengths and Newton's method
# included.

# %% [markdown]
# ## Differentiate through it
#
# Suppose this car cannot turn tighter than half a metre: $|\kappa| \le 2$. chspline asks for
# {claim}`chspline_curvature`. But a waypoint counts as reached within 0.1 m, so nobody minds if we
# *move* the waypoints a little. Which way? The gradient of the curvature says so.
# <!-- given: 0.1 m -->
#
# A maximum has a poor gradient: only one place feels it. A high power of $\kappa$, averaged, is
# nearly the same, and smooth. And mind the knots, where the curvature jumps: look at *both* ends of
# a piece.


# %%
def bends(p):
    pieces = splines.hermite(p).spread()  # many u for each piece, 0 and 1 included
    u = torch.linspace(0, 1, 11)
    return splines.curvature(pieces.local(u, 1), pieces.local(u, 2)).abs()


def moved(z):  # by less than 0.1 m, whatever z is
    return P + 0.1 * z / (1 + z.square().sum(-1, keepdim=True)).sqrt()


def rough():
    total = (bends(moved(z)) ** 16).mean() ** (1 / 16)
    (z.grad,) = torch.autograd.grad(total, z)
    return total.detach()


z = torch.zeros(17, 2, requires_grad=True)
torch.optim.LBFGS([z], max_iter=100, line_search_fn="strong_wolfe").step(rough)
claim("gentler", bends(moved(z.detach())).max(), below=1.8, unit="1/m")

# %% [markdown]
# The largest curvature falls to {claim}`gentler`, and the car can drive it. We needed no formula
# for good waypoints, only that every line from the waypoints to the curvature can be
# differentiated.

# %% [markdown]
# ## On the robot
#
# "Follow the plan" with a simulated Go1 in the car's place. It starts 0.3 m off the path; its trot
# has limits, of which the planner knows. Nothing in this book was tried on a real robot.
# <!-- given: 0.3 m -->

# %%
low, trot = torch.tensor([0.0, -1.5]), torch.tensor([1.2, 1.5])  # m/s, rad/s
limits = {"u_lower": low, "u_upper": trot, "tolerance": 0.15, "steps": 150}
with go1.connect("sim", start=(0.0, 0.3, -math.pi / 2)) as robot:
    walk = infinity.drive(mpc, infinity.RealRobot(robot), aim=ahead, **limits)
claim("dog_finished", walk.finished, equals=True)
claim("dog_error", off(walk.x).mean(), below=0.04, unit="m")

# %% [markdown]
# The dog merges, too, and strays {claim}`dog_error` on average, its start included.

# %% [markdown]
# ## Summary
#
# - A Hermite piece is two points and two tangents. With central differences it is `chspline`,
#   within {claim}`chspline_off` of the circles; with headings it is the local plan, within
#   {claim}`path_off`.
# - A continuous second derivative, passing the points, locality: cubics have two of them. The
#   B-spline misses by {claim}`bspline_missed`.
# - After a shift the plan has merged at waypoint {claim}`plan_merges`, exactly. A car that follows
#   its plan changes its inputs {claim}`smoother_plan` times less.
# - The way between poses is a constant twist. Numbers do not know that: they make a quaternion of
#   length {claim}`shrunk`.
# - By gradient the waypoints found a curve with a largest curvature of {claim}`gentler`.
#
# | Fig. 4 (a) | paper | chspline | local plan |
# |:--|:--|--:|--:|
# | blue, off the circles | "high degree of alignment" | {claim}`chspline_off` | {claim}`path_off` |
# | red has merged at waypoint | "eventually" | {claim}`chspline_merges` | {claim}`plan_merges` |
#
# **What differs from PyPose.** In PyPose 0.9.5 `chspline` takes poses for numbers, `bspline` takes
# only poses, neither gives derivatives or distances, and intervals such as 1/49 give a sample too
# many a piece.
#
# **Further reading.** de Boor {cite}`deboor2001` on splines; Solà, Deray and Atchuthan
# {cite}`sola2018` on poses, in few pages; Sommer et al. {cite}`sommer2020` on derivatives of
# splines of poses; the source of `pypose_lite/splines/`.
#
# Next: chapter 7 puts filter, spline and controller together.
