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
# # A sample
#
# The error is {claim}`error`. Given: 0.3 m, and 3 Hz. <!-- given: 0.3 m, 3 Hz -->
#
# <details><summary>Answer</summary>
#
# Inside, $x^2$ and **bold** with {claim}`error`.
#
# </details>

# %%
import ipywidgets
import matplotlib.pyplot as plt
import torch

from pypose_lite.teaching import animate, claim, plotting, widgets

plotting.use_style()

# %%
fig, ax = plt.subplots()
plotting.infinity_axes(ax)
t = torch.linspace(0, 6.28, 50)
x = torch.stack([t.cos() + 1, t.sin(), -t.sin(), t.cos()], -1)
plotting.plot_reference(ax, x)
plotting.plot_states(ax, x[::2] + 0.05, label="car")
plotting.plot_waypoints(ax, x[::10])
plotting.plot_heading(ax, x[::10])
plotting.plot_covariance(ax, x[0], torch.diag(torch.tensor([0.04, 0.01, 1, 1])))
_ = ax.legend()

# %%
claim("error", torch.tensor(0.0543), below=0.058, unit="m", paper=0.1803)


# %% [markdown]
# ## It moves


# %%
def draw(k: int):
    """One frame."""
    fig, ax = plt.subplots()
    plotting.infinity_axes(ax)
    plotting.plot_reference(ax, x)
    plotting.plot_states(ax, x[: k + 1], label="car")
    return fig


widgets.panels(draw, [1, 10, 30, 40], "steps")

# %% tags=["remove-cell"]
widgets.live(draw, k=ipywidgets.IntSlider(10, 1, 40))

# %%
animate(draw, 50)

# %%
claim("points", len(x), equals=50)
