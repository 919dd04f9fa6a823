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
# # Lab 2: LQR
#
# This lab belongs to [chapter 2](../book/02_lqr.py). You write the step that everything in LQR
# repeats, and you find a fault by its symptom. Each exercise says how long it takes, has three
# hints to open one after the other, and ends in a check. A check tries your answer on numbers
# that you have not seen, and says which property it lacks, if any.

# %% tags=["setup"]
import matplotlib.pyplot as plt
import torch

from pypose_lite.teaching import check, plotting, progress

plotting.use_style()
torch.set_default_dtype(torch.float64)

# %% [markdown]
# ## Exercise 2.1: One Riccati step
#
# *10 minutes. Warm-up.*
#
# From a state $x$, the input $u$ leads to $x' = A x + B u$. The step costs
# $x^\top Q x + u^\top R u$, and all steps after it cost $x'^\top V x'$ if they are done as well as
# possible. Write the function that returns
#
# - the cost-to-go one step earlier: the matrix with which $x^\top V_{\text{before}}\, x$ is the
#   least cost from $x$ on, and
# - the gain `K` of the input that achieves it, $u = K x$.
#
# `A` is $(n, n)$, `B` is $(n, m)$, `Q` and `V` are $(n, n)$, `R` is $(m, m)$; `Q`, `R` and `V` are
# symmetric and positive definite.
#
# :::{dropdown} Hint 1
# Put $x' = A x + B u$ into the cost. What remains is a parabola in $u$. Where is its minimum?
# :::
#
# :::{dropdown} Hint 2
# The derivative with respect to $u$ is zero where $(R + B^\top V B)\, u = -B^\top V A\, x$. A
# system of equations is solved by `torch.linalg.solve(left, right)`.
# :::
#
# :::{dropdown} Hint 3
# With that $K$ the next state is $(A + B K)\, x$, and most terms of the cost cancel:
# $V_{\text{before}} = Q + A^\top V (A + B K)$.
# :::


# %%
def riccati_step(A, B, Q, R, V):
    """Returns V (n, n), the cost-to-go one step earlier, and K (m, n) of u = K x."""
    raise NotImplementedError("2.1 One Riccati step")


# %%
check("2.1", riccati_step)

# %% [markdown]
# ## Exercise 2.2: A car that flees the line
#
# *10 minutes. A fault, found by its symptom.*
#
# A colleague lets the car of the chapter steer to a line that is half a metre to its side. The car
# drives at 1 m/s; only its offset from the line and its heading count. The figure shows what
# happens with their gain, and with a right one.
# <!-- given: half a metre, 1 m/s -->

# %% tags=["hide-input"]
A, B = torch.tensor([[1, 0.1], [0, 1]]), torch.tensor([[0.01], [0.1]])
gains = {"the right gain": (-2.4, -2.5), "the colleague's gain": (2.4, 2.5)}
fig, ax = plt.subplots(figsize=(7, 3))
for name, gain in gains.items():
    x = [torch.tensor([0.5, 0.0])]
    for _ in range(20):
        x.append(A @ x[-1] + B @ (torch.tensor([gain]) @ x[-1]))
    ax.plot(0.1 * torch.arange(21), torch.stack(x)[:, 0].abs(), ".-", label=name)
ax.set(xlabel="time (s)", ylabel="distance from the line (m)")
ax.set(yscale="log", ylim=(1e-3, 1e3))
ax.legend()
alt = "On a logarithmic axis one distance falls in a line, the other rises in one."
plotting.show(fig, alt)

# %% [markdown]
# What is wrong with the colleague's gain? Choose one, and write its letter.
#
# - (a) The price of the input is a hundred times too high.
# - (b) It is used as $u = K x$, and was made for $u = -K x$.
# - (c) The weights of offset and heading have changed places.
# - (d) It was computed for a single step ahead.
#
# <!-- given: a hundred times -->
#
# :::{dropdown} Hint 1
# The axis is logarithmic. What does a straight line on it say about the distance?
# :::
#
# :::{dropdown} Hint 2
# Three of the four make a controller that is worse. Which of them can make the car leave the line
# faster than it would without any steering?
# :::
#
# :::{dropdown} Hint 3
# Compute `torch.linalg.eigvals(A + B @ K)` for a gain of each sign. An eigenvalue outside of the
# unit circle grows from step to step.
# :::

# %%
raise NotImplementedError("2.2 A car that flees the line")

# %%
check("2.2", answer_22)

# %%
progress()
