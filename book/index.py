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
# # Robot motion on one infinity
#
# This book builds one thing, piece by piece: a small car that drives a figure of eight. Its drive
# is planned, seen through noise, estimated, smoothed and learned, and in the end the same loop
# walks a four-legged robot. Every piece is a few lines of [PyTorch](https://pytorch.org), and every
# piece is differentiable. Each number in the text was computed by a cell that also checks it.
#
# ## What you will build
#
# Two circles of 1 m touch in the middle. The car starts there, drives around the right circle,
# comes back to the middle, drives around the left one, and ends in the middle. On its way it has to
# visit 17 waypoints in order. The middle is three of them, so there are {claim}`points` points.
#
# The car visits {claim}`waypoints` waypoints in {claim}`steps` steps of 0.1 s, and ends
# {claim}`end_error` from the middle. The whole drive is one line of code.

# %% tags=["setup"]
import matplotlib.pyplot as plt
import torch

from pypose_lite import infinity
from pypose_lite.teaching import animate, claim, plotting
from pypose_lite.teaching.legged import pictures

plotting.use_style()

# %%
run = infinity.drive(infinity.controller())

# %% tags=["hide-input"]
path = infinity.reference(torch.linspace(0, infinity.LENGTH, 200))
fig, ax = plt.subplots()
plotting.infinity_axes(ax)
plotting.plot_reference(ax, path, label="path")
plotting.plot_waypoints(ax, infinity.waypoints())
[line] = plotting.plot_states(ax, run.x[:1], label="steps of the car")
car = plotting.plot_heading(ax, run.x[:1], length=0.35)
_ = ax.legend(loc="upper center", ncols=3)
plt.close(fig)


def draw(k: int):
    """The figure after 2k steps: the car's way so far, an arrow where it is."""
    way = run.x[: 2 * k + 1]
    line.set_data(*way[:, :2].mT)
    car.set_offsets(way[-1:, :2])
    car.set_UVC(*way[-1:, 2:].mT)
    return fig


film = "A car drives a figure of eight through all waypoints, close to the path."
animate(draw, len(run.x) // 2 + 1, seconds=0.2, alt=film)

# %% tags=["claims"]
places = infinity.waypoints()[:, :2]
distance = torch.cdist(places, run.x[:, :2])  # to each step
in_order = run.finished & (run.goal.diff() >= 0).all()
between = torch.linspace(0, 1, 21)[:, None, None]
driven = run.x[:-1, :2] + between * run.x[:, :2].diff(dim=0)  # straight lines
claim("points", len(places.round(decimals=3).unique(dim=0)), equals=15)
claim("waypoints", (distance.amin(1) <= infinity.TOLERANCE).sum(), equals=17)
claim("in_order", in_order, equals=True)
claim("end_error", run.x[-1, :2].norm(), below=0.1, unit="m")
claim("steps", run.steps, below=60)
claim("mean_error", infinity.tracking_error(driven).mean(), below=0.05, unit="m")
claim("largest_error", infinity.tracking_error(driven).max(), below=0.1, unit="m")

# %% [markdown]
# The broad line is the path that the car should follow, the large points are the waypoints, and the
# small dots are the car's steps. It drives straight from one dot to the next. On this way it is
# {claim}`mean_error` from the path on average and {claim}`largest_error` at most.
#
# In the end the same loop walks a robot with four legs. Here it is a Unitree Go2's body and gait in
# simulated physics, by snapshots of one walk in one picture. The blue dots are the way as the robot
# recorded it.

# %% tags=["hide-input"]
pictures.on_infinity()

# %% [markdown]
# ## How the book goes on
#
# The example is that of the paper *PyPose v0.6: The Imperative Programming Interface for Robotics*
# {cite}`pypose06`, and so are the names: after `import pypose_lite as pp` its listings run as
# they are printed. One loop holds everything together:
#
# ```
# look:      y[i]      = g(x[i], u[i]) + v          # a noisy observation
# plan:      u[i]      = mpc(dt, X[i], target)      # a second ahead; the first input counts
# estimate:  X[i+1], P = ekf(X[i], y[i], u[i], P)   # where the car probably is
# move:      x[i+1]    = f(x[i], u[i]) + w          # where it really is
# ```
#
# A chapter is a lesson, which you read, and a lab, in which you solve exercises.
#
# | Lesson and lab | Their question |
# |:--|:--|
# | [1 Systems](01_systems.py), [lab](../exercises/01_systems.py) | How is a system linearised? |
# | [2 LQR](02_lqr.py), [lab](../exercises/02_lqr.py) | What is best if everything is linear? |
# | [3 MPC](03_mpc.py), [lab](../exercises/03_mpc.py) | And if it is not? The first lap. |
# | [4 Kalman filter](04_ekf.py), [lab](../exercises/04_ekf.py) | Where is a car in noise? |
# | [5 UKF, PF](05_ukf_pf.py), [lab](../exercises/05_ukf_pf.py) | And if one bell is not enough? |
# | [6 Curves, poses](06_splines.py), [lab](../exercises/06_splines.py) | How does a car get back? |
# | [7 All together](07_all_together.py), [lab](../exercises/07_all_together.py) | What pays? |
# | [8 Learning](08_learning.py), [lab](../exercises/08_learning.py) | What do gradients find? |
# | [9 The Go1](09_go1.py), [lab](../exercises/09_go1.py) | Does the same loop walk a robot? |
# | [10 Thousands of cars](10_thousands.py), [lab](../exercises/10_thousands.py) | How sure is it? |
#
# Three appendices go further: [from pypose_lite to PyPose](to_pypose.py),
# [the same infinity with other tools](other_tools.py), and [the mathematics used](mathematics.py).
#
# [How to read and run this book](how_to_read.md) says how lessons, labs and JupyterLab work. The
# [scoreboard](scoreboard.md) lists every number that the book claims, beside the paper's.
