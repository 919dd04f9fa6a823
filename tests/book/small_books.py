"""Parts of small chapters, for the tests of what becomes of a chapter."""

HEADER = """\
# ---
# jupyter:
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---
"""
CLAIM = """\
# %% tags=["setup"]
from pypose_lite.teaching.claims import claim
# %% tags=["claims"]
claim('a', {}, below=1, unit='m')
"""
PROSE = "# %% [markdown]\n# It is 0.21 m.\n"
ERROR = "# %%\n1 / 0\n"
FIGURE = """\
# %% [markdown]
# # Look
# %%
from IPython.display import HTML
HTML("<img alt='A cross.' src='x'>")
"""
LESSON = (
    HEADER
    + """\
# %% [markdown]
# # A small lesson
#
# It takes {claim}`steps` steps {cite}`li2004ilqr`, by {eq}`eq-1-square` and
# [another](01_systems.py).
# %% tags=["setup"]
import ipywidgets
import matplotlib.pyplot as plt
import torch
from pypose_lite.teaching import claim, plotting, widgets
# %% [markdown]
# ## The square: a curve
#
# $$ y = x^2 $$ (eq-1-square)
#
# The *state* is the word here ({term}`state`). <!-- given: 1 m -->
#
# :::{dropdown} Hint
# Think of $x$.
# :::
# %%
steps = 11
x = torch.linspace(0, 1, steps)
# %% tags=["hide-input"]
def draw(power=2):
    fig, ax = plt.subplots(figsize=(4, 2))
    ax.plot(x, x**power)
    ax.set(xlabel="x (m)", ylabel="y (m)")
    return fig
plotting.show(draw(), "A parabola through the origin.")
# %% tags=["claims"]
claim("steps", len(x), equals=11)
# %% [markdown]
# **Predict.** Is the cube above or below the square?
# %% tags=["answer"]
print((x**3 - x**2).mean())
# %% tags=["answer", "claims"]
claim("below", (x**3 <= x**2).all(), equals=True)
# %% [markdown] tags=["answer"]
# It is below it: {claim}`below`.
# %% [markdown]
# A slider follows.
# %% tags=["remove-cell"]
widgets.live(draw, alt="The curve.", power=ipywidgets.IntSlider(1, 1, 5))
"""
)
