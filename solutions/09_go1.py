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
# # Lab 9: The Go1
#
# This lab belongs to [chapter 9](../book/09_go1.py). You read a state of the robot byte by byte and
# write a command, construct damage that no checksum of this kind finds, write a watchdog and a loop
# that stops the robot whatever happens, and find out from logs what is wrong with a robot, how late
# it is, and which commands it does not follow. Each exercise says how long it takes, has three
# hints to open one after the other, and ends in a check. All of them together take about 130
# minutes. <!-- given: 130 minutes -->

# %% tags=["setup"]
import math
import struct

import matplotlib.pyplot as plt
import torch

from pypose_lite import go1
from pypose_lite.go1.wire import protocol
from pypose_lite.teaching import check, plotting, progress
from pypose_lite.teaching.checks.robot_logs import KINDS, recorded_pulses, walk_log

plotting.use_style()
torch.set_default_dtype(torch.float64)

# %% [markdown]
# The chapter's checksum, which you may use everywhere:


# %%
def checksum(data):
    """Returns the remainder of the words in data: CRC-32/MPEG-2."""
    g = 0x04C11DB7  # the divisor without its leading 1
    register = 0xFFFFFFFF
    for (word,) in struct.iter_unpack("<I", data):
        register ^= word
        for _ in range(32):
            leading_bit = register >> 31
            register = (register << 1) & 0xFFFFFFFF
            if leading_bit:
                register ^= g
    return register


# %% [markdown]
# ## Exercise 9.1: A state, byte by byte
#
# *10 minutes. Warm-up.*
#
# The robot's state is 1087 bytes. These are some of its fields; offsets count from 0, and a number
# of four bytes is a `float`, its lowest byte first.
#
# | field | from byte | bytes | what it is |
# |:--|--:|--:|:--|
# | `imu.quaternion` | 22 | 16 | $w, x, y, z$ |
# | `imu.rpy` | 62 | 12 | roll, pitch, heading, rad |
# | `bms.status` | 837 | 1 | the battery's status |
# | `bms.soc` | 838 | 1 | the battery's charge, % |
# | `position` | 895 | 12 | $x, y, z$ of the odometry, m |
# | `velocity` | 911 | 12 | forward, left, unclear, m/s |
# | `yaw_speed` | 923 | 4 | turn rate, rad/s |
#
# Write a function that returns six numbers: the charge, $x$, $y$, the heading, the forward speed
# and the turn rate. Here is a state to try it on:

# %%
with go1.connect("sim", start=(0.0, 0.0, 0.0)) as robot:
    robot.move(0.5, 0.2)
    robot.wait(1.0)
    data = protocol.encode_state(robot.state)
print(len(data), "bytes, beginning with", data[:8].hex(" "))

# %% [markdown]
# :::{dropdown} Hint 1
# `data[838]` is a number already: bytes are numbers from 0 to 255.
# :::
#
# :::{dropdown} Hint 2
# `struct.unpack_from("<ff", data, 895)` returns a tuple of two floats.
# :::
#
# :::{dropdown} Hint 3
# The heading is the third of the three angles, so it lies at byte 62 + 8.
# :::


# %%
def read_state(data):
    """Returns charge (%), x, y (m), heading (rad), speed (m/s), turn rate (rad/s)."""
    ### BEGIN SOLUTION
    charge = data[838]
    x, y = struct.unpack_from("<ff", data, 895)
    (heading,) = struct.unpack_from("<f", data, 70)
    (speed,) = struct.unpack_from("<f", data, 911)
    (turn,) = struct.unpack_from("<f", data, 923)
    return charge, x, y, heading, speed, turn
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# With a wrong byte order the numbers are absurd, like $10^{-40}$, and are seen at once. With a
# wrong offset they are often plausible, and are not. That is why the library does not count offsets
# by hand: it lists the fields once, in the order of the vendor's header, and computes all places.

# %%
print("charge, x, y, heading, speed, turn rate:", read_state(data))
check("9.1", read_state)

# %% [markdown]
# ## Exercise 9.2: A command, sealed
#
# *15 minutes. Warm-up.*
#
# Write the packet of 129 bytes that tells the robot to walk at a trot, forward with `v` m/s and
# turning with `turn` rad/s. All that the table does not name is 0.
#
# | from byte | bytes | what it is |
# |--:|--:|:--|
# | 0 | 2 | `FE EF`, a packet begins |
# | 2 | 1 | `EE`, the level |
# | 22 | 1 | mode, 2 is walk |
# | 23 | 1 | gait, 1 is trot |
# | 53 | 12 | speed forward, speed to the left, turn rate |
# | 125 | 4 | checksum of the first 124 bytes |
#
# :::{dropdown} Hint 1
# A `bytearray(129)` is full of zeros and can be written to.
# :::
#
# :::{dropdown} Hint 2
# `struct.pack_into("<fff", packet, 53, ...)` writes three floats. Yours does not walk sideways.
# :::
#
# :::{dropdown} Hint 3
# `struct.pack_into("<I", packet, 125, ...)` writes the checksum. It comes last, when all the rest
# is in its place.
# :::


# %%
def command_packet(v, turn):
    """Returns the 129 bytes of a command to trot with v (m/s) and turn (rad/s)."""
    ### BEGIN SOLUTION
    packet = bytearray(129)
    packet[0:3] = b"\xfe\xef\xee"
    packet[22] = 2
    packet[23] = 1
    struct.pack_into("<fff", packet, 53, v, 0.0, turn)
    struct.pack_into("<I", packet, 125, checksum(packet[:124]))
    return bytes(packet)
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# Whoever forgets the mode or the gait gets a packet that the robot takes, with a right checksum,
# and that does nothing. A checksum says that a packet arrived as it was sent, not that it makes
# sense.

# %%
check("9.2", command_packet)

# %% [markdown]
# ## Exercise 9.3: Damage that goes unseen
#
# *20 minutes. A derivation, checked by numbers.*
#
# The chapter says that damage $e(x)$ goes unseen exactly if the divisor $g(x)$ divides it.
# Construct such damage: return 124 bytes that differ from `data` in some bits and have the same
# checksum, whatever `data` is.
#
# Two things to mind. The constant `0x04C11DB7` holds 32 bits of $g$, all but the leading 1. And the
# robot reads words of four bytes, lowest byte first, and then each word from its highest bit on.
#
# :::{dropdown} Hint 1
# The simplest multiple of $g$ is $g$ itself, and $g$ times a power of $x$ is $g$ moved to another
# place. As a row of 33 bits it is a 1, followed by the 32 bits of the constant.
# :::
#
# :::{dropdown} Hint 2
# In the order of reading, the last bit of one word is followed by the 32 bits of the next.
# :::
#
# :::{dropdown} Hint 3
# Unpack the data into 31 words with `struct.unpack("<31I", data)`. Flip the lowest bit of a word,
# `^= 1`, and add the constant to the next one.
# :::


# %%
def unseen_damage(data):
    """Returns other data (124 bytes) with the same checksum."""
    ### BEGIN SOLUTION
    words = list(struct.unpack("<31I", data))
    words[5] ^= 1
    words[6] ^= 0x04C11DB7
    return struct.pack("<31I", *words)
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# These are 15 flipped bits, spread over 33. A *burst* of damage that is 32 bits long or shorter is
# always found: as a polynomial its degree, after dividing by a power of $x$, is below that of $g$,
# so $g$ cannot divide it. Longer damage by chance goes unseen once in $2^{32}$ times. Damage on
# purpose, like yours, always can: against an adversary a checksum is no protection, that takes a
# *message authentication code* with a secret key. The Go1 has none.

# %%
check("9.3", unseen_damage)

# %% [markdown]
# ## Exercise 9.4: A watchdog
#
# *15 minutes. The robot.*
#
# The sender calls this function 200 times a second, and sends what it returns. `motion` is the last
# one that the planner asked for, $[v, \dot\theta]$, at the time `asked_at`; something new was last
# heard of the robot at `heard_at`. All times are in seconds. <!-- given: 200 times -->
#
# - The motion goes out while both are younger than `patience`, else $[0, 0]$.
# - Neither a clock that was set back, nor a time or a motion that is no number, may keep the dog
#   walking.
#
# :::{dropdown} Hint 1
# The two ages are `now - asked_at` and `now - heard_at`. Each has to be small enough, by itself.
# :::
#
# :::{dropdown} Hint 2
# An age below zero is no age. And every comparison with `nan` is false, so ask in such a way that
# "false" means "stop".
# :::
#
# :::{dropdown} Hint 3
# `0 <= now - asked_at < patience`; and `math.isfinite` for both numbers of the motion.
# :::


# %%
def goes_out(now, motion, asked_at, heard_at, patience):
    """Returns the motion [v, turn] to be sent now."""
    ### BEGIN SOLUTION
    asked = 0 <= now - asked_at < patience
    heard = 0 <= now - heard_at < patience
    sane = all(math.isfinite(number) for number in motion)
    return motion if asked and heard and sane else (0.0, 0.0)
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# The rule behind it: *stop* must be what happens when anything is not known to be well. `if age >
# patience: stop` lets a `nan` through; `if not age < patience: stop` does not. On a real robot take
# the time from `time.monotonic()`, which is never set back.

# %%
check("9.4", goes_out)

# %% [markdown]
# ## Exercise 9.5: A stop, whatever happens
#
# *15 minutes. The robot.*
#
# Write the loop. `plan(pose)` returns the next motion `(v, turn)`, or `None` when the way is done.
# Ask the robot for its `pose()`, plan, `move(v, turn)`, `wait(dt)`, and so on. At the end, and
# however it comes, the robot's last call has to be `stop()`: when the way is done, when the planner
# or the robot raises an error, and when somebody presses Ctrl-C. An error has to go on to whoever
# called, after the stop.
#
# :::{dropdown} Hint 1
# Write the loop first, without any mishap.
# :::
#
# :::{dropdown} Hint 2
# Python has a statement for "in any case": `try: ... finally: ...`. It does not swallow errors.
# :::
#
# :::{dropdown} Hint 3
# The whole loop belongs into the `try`, also the first `pose()`; `robot.stop()` is all that belongs
# into the `finally`.
# :::


# %%
def walk_along(robot, plan, dt):
    """Walks until plan returns None; stops the robot in any case."""
    ### BEGIN SOLUTION
    try:
        motion = plan(robot.pose())
        while motion is not None:
            robot.move(*motion)
            robot.wait(dt)
            motion = plan(robot.pose())
    finally:
        robot.stop()
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# Ctrl-C arrives in Python as a `KeyboardInterrupt`, which is deliberately no `Exception`: whoever
# writes `except Exception: robot.stop()` has a robot that stops for every error but this one. What
# `finally` does not help against: `kill -9`, a computer without power, a pulled cable. For these
# the chapter has a guardian, and a watchdog in the robot, if it has one.

# %%
check("9.5", walk_along)

# %% [markdown]
# ## Exercise 9.6: What does this robot have?
#
# *20 minutes. A fault, to be found in logs.*
#
# Five dogs walked straight on for 6 s, at a speed that changes every second. One is well, the
# others have something each:
#
# - `"deaf"`: it is a Pro, and the level flag is not the one that it takes;
# - `"frozen"`: its program hangs after a while;
# - `"lossy"`: most of the packets are lost;
# - `"late"`: packets take 0.15 s each way, three times as long as on the chapter's bad network.
#
# A log has four columns: `t`, `told`, `seen` and `age`. There is a row for each new state that
# came, 50 a second if all is well. `age` says how old the state before had become by then.
# <!-- given: 6 s, 0.15 s, three times -->

# %% tags=["hide-input"]
fig, panels = plotting.stacked(5, height=1.7, sharex=True)
for ax, kind in zip(panels, KINDS):
    log = walk_log(kind)
    ax.step(log.t, log.told, where="post", color=plotting.GREY, label="told")
    ax.plot(log.t, log.seen, ".", ms=3, label="seen")
    ax.set(title=kind, ylabel="m/s", ylim=(-0.1, 1))
panels[-1].set(xlabel="time (s)", xlim=(-0.1, 6.6))
panels[0].legend(loc="upper right", ncols=2)
plotting.show(
    fig,
    "Speeds told and seen against time, for five robots. Deaf: seen stays at zero. "
    "Frozen: the rows end. Lossy: rows are missing everywhere. Late: seen follows "
    "long after told.",
)
ages = {kind: walk_log(kind).age for kind in KINDS}
for kind, age in ages.items():
    print(f"{kind}: mean age {age.mean():.3f} s, {len(age)} rows")

# %% [markdown]
# Write a function that looks at a log and says one of the five words: `"healthy"`, `"deaf"`,
# `"frozen"`, `"lossy"` or `"late"`. The check tries it on logs of other walks.
#
# :::{dropdown} Hint 1
# Ask in an order in which each question is safe: does it move at all? Does the log end early? Do
# rows come at their rate? What is left is well or late.
# :::
#
# :::{dropdown} Hint 2
# The dog that is told and does not move is stopped by the library after a while. So look at `seen`
# first, and at the end of the log only afterwards.
# :::
#
# :::{dropdown} Hint 3
# For the last question shift `seen` by 15 rows (0.3 s) and compare: does it fit `told` better or
# worse than shifted by 5? <!-- given: 0.3 s -->
# :::


# %%
def diagnose(log):
    """Returns "healthy", "deaf", "frozen", "lossy" or "late"."""

    ### BEGIN SOLUTION
    def misfit(rows):
        return (log.seen[rows:] - log.told[:-rows]).square().mean()

    if log.seen.max() < 0.1 < log.told.max():
        return "deaf"
    if log.t[-1] < 5:
        return "frozen"
    if log.age.mean() > 0.03:
        return "lossy"
    return "late" if misfit(20) < misfit(6) else "healthy"
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# Each fault has its own trace, but not each column shows it: packets come from the deaf dog at full
# rate, and the speed of the frozen one is perfect while it lasts. That is why a log has to hold
# more than positions: what was told beside what was seen, and how old things were.

# %%
check("9.6", diagnose)

# %% [markdown]
# ## Exercise 9.7: Lag and delay of a stranger
#
# *20 minutes. Design.*
#
# A log of 10 s: times `t` $(N)$, and what was seen and told, both $(N, 2)$ with a speed in m/s and
# a turn rate in rad/s. The legs may have a lag of 0.05 to 0.4 s, the line a delay of up to 0.3 s,
# there and back. Return `lag, delay`, both to 0.02 s.
# <!-- given: 10 s, 0.05, 0.4 s, 0.3 s, 0.02 s -->
#
# :::{dropdown} Hint 1
# The model is the chapter's: every change of what was told starts an exponential, `delay` later.
# :::
#
# :::{dropdown} Hint 2
# Only two numbers are unknown. The mean square of the misfit on a grid of 0.02 s is 16 by 16
# numbers, and needs no derivative. <!-- given: 0.02 s -->
# :::
#
# :::{dropdown} Hint 3
# Around the best of the grid try a finer one.
# :::


# %%
def find_lag_and_delay(t, seen, told):
    """Returns the lag and the delay (s) that explain what was seen."""

    ### BEGIN SOLUTION
    def misfit(lag, delay):
        since = (t[:, None] - delay - t[1:]).clamp(min=0)
        v = told[0] + (1 - torch.exp(-since / lag)) @ told.diff(dim=0)
        return (v - seen).square().mean()

    def best(lags, delays):
        pairs = [(lag, delay) for lag in lags for delay in delays]
        return min(pairs, key=lambda pair: misfit(*pair))

    near = torch.linspace(-0.02, 0.02, 9)
    lag, delay = best(torch.linspace(0.04, 0.42, 20), torch.linspace(0, 0.32, 17))
    return best((lag + near).clamp(min=0.01), delay + near)
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# With two unknowns a grid is a good method: it cannot end in a wrong valley, and a picture of it
# shows how well each number is known. The descent of the chapter needs a tenth of the evaluations,
# and goes on to work where there are ten unknowns and no grid is possible.

# %%
check("9.7", find_lag_and_delay)

# %% [markdown]
# ## Exercise 9.8: The dead band of a dog with legs
#
# *15 minutes. Identification.*
#
# The dogs so far were points with a lag. The library has one with legs, too: a Go2's body and a
# gait that was trained for it, moved by physics. It does not follow slow commands: below some speed
# it steps in place or shuffles. Such a range is called a *dead band*.
#
# The log is of ten pulses. For 1 s it was told to stand, then for 2 s a speed, then to stand again,
# and so on. We say that the dog *follows* a pulse if it walks, once it is on its way, at more than
# a third of the speed that it was told. <!-- given: 1 s, 2 s, a third -->

# %%
log = recorded_pulses()

# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 3))
ax.step(log.t, log.told, where="post", color=plotting.GREY, label="told")
ax.plot(log.t, log.seen, ".", ms=2, color=plotting.BLUE, label="seen")
ax.set(xlabel="time (s)", ylabel="speed (m/s)")
ax.legend(ncols=2)
plotting.show(
    fig,
    "Ten pulses of speed that a dog with legs was told, and its own speed. It "
    "follows the larger ones almost, those of a middle size by half, and the "
    "smallest hardly at all.",
)

# %% [markdown]
# Write a function that returns the speed below which the dog does not follow. Any number between
# the largest speed that it does not follow and the smallest that it does is right. If it follows
# all, that is any number between 0 and the smallest of them.
#
# :::{dropdown} Hint 1
# `log.told.unique()` has the ten speeds, and 0.
# :::
#
# :::{dropdown} Hint 2
# For one speed, `log.seen[log.told == speed]` is what was seen meanwhile. Its beginning, in which
# the dog is still getting on its way, should not count.
# :::
#
# :::{dropdown} Hint 3
# Compare the mean of the second half of a pulse with a third of its speed.
# :::


# %%
def dead_band(log):
    """Returns the speed (m/s) below which the robot does not follow."""
    ### BEGIN SOLUTION
    ignored = [0.0]
    for speed in log.told.unique():
        seen = log.seen[log.told == speed]
        if speed > 0 and seen[len(seen) // 2 :].mean() < speed / 3:
            ignored.append(speed.item())
    return max(ignored)
    ### END SOLUTION


# %% [markdown] tags=["solution"]
# It is between 0.15 and 0.2 m/s for this gait; users of the real Go1 report 0.1 to 0.2. A planner
# that does not know it parks: near a waypoint it slows down, its plan says 0.1 m/s, the dog stands,
# and the next plan is the same. Against that helps a smallest speed, which the planner is not
# allowed to go below before the end, or the inverse of what was found: tell the dog more than you
# want. <!-- given: 0.15, 0.2, 0.2 m, 0.1 m -->

# %%
check("9.8", dead_band)

# %% [markdown]
# ## To go on
#
# Start a robot in one terminal, and walk it from another:
#
# ```
# python -m pypose_lite.go1.simulator --port 8082 --loss 0.05 --delay 0.05
# python -m pypose_lite.go1 walk --robot udp://127.0.0.1:8082 --log walk.csv
# ```
#
# Make the line worse, with `--loss` and `--delay`, until the walk fails. Then find out from
# `walk.csv` alone, by what you have written here, why it failed. A good answer names the first row
# in which something is wrong, says which rule stopped the dog, if one did, and what the planner
# believed at that moment.

# %%
progress()
