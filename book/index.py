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
# This book builds one thing, piece by piece: a small car that drives a figure of eight. It is
# planned, seen through noise, estimated, smoothed, learned, and in the end the very same loop walks
# a four-legged robot. Every piece is a few lines of [PyTorch](https://pytorch.org), every piece is
# differentiable, and nothing is claimed here that a cell does not check.
#
# ## What you will build
#
# Two circles, eight waypoints on each, one more where they meet: the car visits all
# {claim}`waypoints` in order and comes back to the middle, {claim}`end_error` from it. It takes
# {claim}`steps` steps of a tenth of a second. The whole drive is one line, the second below.

# %% tags=["hide-input"]
import matplotlib.pyplot as plt
import torch

from pypose_lite import infinity
from pypose_lite.teaching import animate, claim, plotting

plotting.use_style()
path = infinity.reference(torch.linspace(0, infinity.LENGTH, 200))

# %%
run = infinity.drive(infinity.controller())


# %% tags=["hide-input"]
fig, ax = plt.subplots()
plotting.infinity_axes(ax)
plotting.plot_reference(ax, path)
plotting.plot_waypoints(ax, infinity.waypoints())
[line] = plotting.plot_states(ax, run.x[:1], label="car")
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


animate(draw, len(run.x) // 2 + 1, seconds=0.2)

# %%
distance = torch.cdist(infinity.waypoints()[:, :2], run.x[:, :2])  # to each step
claim("waypoints", (distance.amin(1) <= infinity.TOLERANCE).sum(), equals=17)
claim("in_order", run.finished & (run.goal.diff() >= 0).all(), equals=True)
claim("end_error", run.x[-1, :2].norm(), below=0.1, unit="m")
claim("steps", run.steps, below=60)
claim("mean_error", infinity.tracking_error(run.x).mean(), below=0.03, unit="m")
claim("largest_error", infinity.tracking_error(run.x).max(), below=0.1, unit="m")

# %% [markdown]
# Orange is the path it should follow, red are the waypoints it has to visit, and each blue dot is
# one step of the car. On average it is {claim}`mean_error` off the path, and never more than
# {claim}`largest_error`.
#
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
# | Chapter | Its question |
# |---|---|
# | 1 Dynamic systems | What is a system, and what does it look like from nearby? |
# | 2 LQR | What is the best input when everything is linear? |
# | 3 MPC | And when it is not? The car drives its first lap. |
# | 4 EKF | The car is seen through noise: where is it? |
# | 5 UKF and PF | What if one bell curve is not enough? |
# | 6 Splines | How does a car that was pushed aside get back, smoothly? |
# | 7 All together | What does each part add? |
# | 8 Learning through the loop | What can gradients through all of it find out? |
# | 9 The Go1 | Does the same loop walk a robot? |
#
# [How to read and run this book](how_to_read.md) is the next page. The [scoreboard](scoreboard.md)
# lists every number that the book claims, beside the paper's.
