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
# # Stopping at a line
#
# A cart in a warehouse has to stop at a line on the floor. Where it stops decides whether the
# gripper behind it can reach the parcel. Its wheels slip a little, and nobody knows by how much.
#
# In this lesson the cart looks where it is. After it you can
#
# - say why a cart that does not look misses its line;
# - derive how fast the error of a cart that looks shrinks, and when it grows instead;
# - choose a gain, and test that the simulation is right.
#
# You need sequences and powers of numbers. Take about 20 minutes. No figure of a paper is
# reproduced here; where one is, its number stands in the claim, as `paper=`.
# <!-- given: 20 minutes -->

# %% tags=["setup"]
import matplotlib.pyplot as plt
import numpy
from IPython.display import display

from pypose_lite.teaching import claim, figures, table, widgets

figures.use_style()

# %% tags=["hide-input"]
k = numpy.arange(41)
fig, ax = plt.subplots(figsize=(7, 3))
ax.axhline(0, color=figures.ORANGE, lw=3, alpha=0.6, label="the line")
does_not_look = numpy.maximum(1 - 0.045 * k, 0.1)
looks = 0.82**k
ax.plot(0.1 * k, does_not_look, ".-", color=figures.RED, label="does not look")
ax.plot(0.1 * k, looks, ".-", color=figures.BLUE, label="looks")
ax.set(xlabel="time (s)", ylabel="distance to the line (m)")
ax.legend()
figures.show(fig, "The cart that looks ends at the line, the other one before it.")

# %% tags=["claims"]
claim("looks_nearer", looks[-1] / does_not_look[-1], below=0.01)

# %% [markdown]
# ## See it fail: a cart that does not look
#
# The cart begins at a distance of 1 m, and shall drive at a known speed for as long as it takes.
# This is {term}`open loop` control. Its wheels turn as told, and slip: of each step, a tenth is
# lost. <!-- given: 1 m, a tenth -->

# %%
dt = 0.1  # s, the length of a step
slip = 0.1  # the share of each step that is lost
start = 1.0  # m, the distance to the line
steps = 40


def drive(policy, delay=0):
    """Returns a cart's distances to the line, in metres, at each step."""
    distances = [start]
    for k in range(steps):
        seen = distances[max(0, k - delay)]
        speed = policy(k, seen)
        distances.append(distances[k] - (1 - slip) * dt * speed)
    return numpy.array(distances)


# %%
def open_loop(k, distance):
    speed = 0.5  # m/s
    return speed if k * dt < start / speed else 0.0


missed = drive(open_loop)

# %% tags=["hide-input"]
time = dt * numpy.arange(steps + 1)


def drawn(distances, label, color=figures.BLUE):
    """Returns a figure of one drive, with the line at which it should end."""
    fig, ax = plt.subplots(figsize=(7, 3))
    ax.axhline(0, color=figures.ORANGE, lw=3, alpha=0.6, label="the line")
    ax.plot(time, distances, ".-", color=color, label=label)
    ax.set(xlabel="time (s)", ylabel="distance to the line (m)", ylim=(-1.1, 1.7))
    ax.legend(loc="upper right")
    return fig


figures.show(
    drawn(missed, "open loop", figures.RED),
    "The distance falls, and then stays above zero: the cart stops early.",
)

# %% tags=["claims"]
claim("missed", missed[-1], equals=0.1, within=1e-9, unit="m")

# %% [markdown]
# It stops {claim}`missed` before the line. With other floors it would stop elsewhere, and with
# wheels that do not slip exactly on it.
#
# ## Measure and correct: the idea, and how fast it is
#
# A cart that measures its distance can drive faster while it is far away, and slower when it is
# near. This is {term}`feedback`. The block diagram has one arrow that open loop control has not:
# the one that leads back.

# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 2))
ax.set(xlim=(0, 7), ylim=(0, 2))
ax.axis("off")
arrow = {"arrowstyle": "-|>", "lw": 2}
frame = {"fc": "white", "pad": 8}
for x, text in ((2.0, "gain k"), (5.0, "cart")):
    ax.text(x, 1.3, text, size=13, ha="center", va="center", bbox=frame)
ax.annotate("", (4.4, 1.3), (2.7, 1.3), arrowprops=arrow)
ax.text(3.1, 1.5, "speed", size=13)
ax.plot([5.6, 6.5, 6.5, 0.5, 0.5], [1.3, 1.3, 0.3, 0.3, 1.3], color="black", lw=2)
ax.annotate("", (1.3, 1.3), (0.45, 1.3), arrowprops=arrow)
ax.text(2.8, 0.45, "measured distance", size=13)
figures.show(fig, "A loop: the gain sets the speed from the measured distance.")

# %% [markdown]
# We want to know for which gains the cart arrives.
#
# Let $d_k$ be the distance in metres at step $k$, $\Delta t$ the length of a step in seconds and
# $s$ the share that is lost. The cart is told the speed $v_k$. It moves by what is left of the
# step:
#
# $$ d_{k+1} = d_k - (1 - s)\, \Delta t\, v_k $$ (eq-NAME-cart)
#
# The speed shall be proportional to the distance, with a gain $k_p$ in 1/s: $v_k = k_p d_k$. We put
# this into {eq}`eq-NAME-cart` and take $d_k$ out:
#
# $$ d_{k+1} = \bigl(1 - (1 - s)\, k_p\, \Delta t\bigr)\, d_k = (1 - g)\, d_k $$ (eq-NAME-step)
#
# Here $g = (1 - s)\, k_p\, \Delta t$ is the share of the error that one step takes away. Each step
# multiplies by the same number, so that after $k$ steps
#
# $$ d_k = (1 - g)^k\, d_0 . $$ (eq-NAME-power)
#
# The error goes to zero where $|1 - g| < 1$, which is where $0 < g < 2$. The slip $s$ changes how
# fast that is, and not where the cart stops.

# %%
gain = 2.0  # 1/s


def feedback(k, distance):
    return gain * distance


g = (1 - slip) * gain * dt
stopped = drive(feedback)
predicted = (1 - g) ** numpy.arange(steps + 1) * start

# %% tags=["claims"]
claim("largest_difference", abs(stopped - predicted).max(), below=1e-12, unit="m")
claim("last_error", abs(stopped[-1]), below=0.001, unit="m")

# %% [markdown]
# The simulation follows {eq}`eq-NAME-power` to {claim}`largest_difference`, and ends
# {claim}`last_error` from the line, although the feedback knows nothing of the slip.
#
# ## The gain on the cart
#
# **Predict.** The gain is multiplied by ten. Does the cart (a) arrive sooner, (b) swing around the
# line and arrive, or (c) never arrive?

# %% tags=["answer", "hide-input"]
gains = [1, 2, 10, 20, 24]  # 1/s
errors = {k: abs(drive(lambda _, d, k=k: k * d)[-1]) for k in gains}
rows = [f"{k} | {(1 - slip) * k * dt:.2f} | {errors[k]:.1e}" for k in gains]
display(table("gain (1/s) | g | last error (m)", rows))

# %% tags=["answer", "claims"]
claim("share_at_twenty", (1 - slip) * 20 * dt, above=1, below=2)
claim("error_at_twenty", errors[20], below=0.001, unit="m")
claim("error_at_twenty_four", errors[24], above=start, unit="m")

# %% [markdown] tags=["answer"]
# It is (b): with a gain of 20, $g$ is {claim}`share_at_twenty`. Each step goes past the line, and
# the error changes its sign and shrinks, to {claim}`error_at_twenty`. With a gain of 24, $g$ is
# beyond the bound, and the last error, {claim}`error_at_twenty_four`, is larger than the first.

# %% [markdown]
# Move the slider to see each of them.

# %% tags=["hide-input"]
widgets.panels(
    lambda k: drawn(drive(lambda _, distance: k * distance), f"gain {k} per second"),
    gains,
    "gain (1/s)",
    alt="The distance to the line over time.",
)

# %% tags=["claims"]
claim("error_at_one", errors[1], below=0.05, unit="m")

# %% [markdown]
# ## What goes wrong: an old measurement
#
# The second example has a camera that needs time: the cart acts on the distance of an earlier step.
# Then {eq}`eq-NAME-power` no longer holds, and a gain that was good lets the cart swing.


# %%
def fast(k, distance):
    return 9.0 * distance


fresh = drive(fast)
old = drive(fast, delay=2)

# %% tags=["hide-input"]
figures.show(
    drawn(numpy.clip(old, -1.1, 1.1), "gain 9, with a delay", figures.RED),
    "The distance swings from one side of the line to the other, farther each time.",
)

# %% tags=["claims"]
claim("fresh_error", abs(fresh[-1]), below=1e-6, unit="m")
claim("old_error", abs(old[-1]), above=start, unit="m")

# %% [markdown]
# Without the delay the same gain ends {claim}`fresh_error` from the line, with it
# {claim}`old_error`. How do we know that the simulation is right, and not its delay wrong? The test
# above compared it with a formula that was derived by hand, and a simulation without a delay is the
# same code.
#
# ## Summary
#
# - A cart that does not look stops {claim}`missed` before the line, because its wheels slip.
# - With feedback each step takes the same share of the error away, and it ends {claim}`last_error`
#   from the line.
# - The error shrinks where that share is between 0 and 2; at {claim}`share_at_twenty` the cart
#   swings.
# - The formula and the simulation agree to {claim}`largest_difference`.
# - A delay makes a good gain a bad one: the last error is {claim}`old_error`.
#
# The words of this lesson: {term}`open loop`, {term}`feedback`.
#
# ## Further reading
#
# {cite:t}`astrom2021` introduce feedback, and treat delays. A lab on this lesson would ask for the
# largest gain that a delay allows, and for a test that tells a slipping cart from a slow one.
