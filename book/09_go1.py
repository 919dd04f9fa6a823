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
# # The Go1: the same loop walks a robot
#
# The loop that drove a car now walks a robot dog, the Unitree Go1. Not one line of it changes. What
# changes is the world around it: legs answer late, packets get lost, and a program that dies may
# leave a machine of 12 kg walking. Whoever has written a controller that works in simulation, and
# wants to put it on a machine, meets exactly these three. This chapter is about them.
# <!-- given: 12 kg -->
#
# After this chapter you can
#
# - draw a control loop as a flow chart from what it really calls;
# - write a command of the Go1 byte by byte, and say what its checksum finds and what it does not;
# - say what a watchdog is for, and which one you need where;
# - find lag and delay in a recorded log, and plan with them;
# - say why no filter removes the drift of odometry, and what does.
#
# You need [chapter 3](03_mpc.py) (plans) and [chapter 4](04_ekf.py) (the filter) for the drift.
# Take about 60 minutes; on a first reading you may leave out the two sections after the drift, on
# faults that look like health and on a dog with legs. <!-- given: 60 minutes -->
#
# The chapter reproduces the last section of the paper {cite}`pypose06`: its flow chart and the
# trajectory that it recorded on its robot. **Nothing in this book was tried on a real robot.** Ours
# is simulated, behind the packets of the real one.

# %% tags=["setup"]
import math
import struct
import subprocess
import sys
import tempfile
import time
from collections import Counter

import ipywidgets
import matplotlib.pyplot as plt
import torch
from IPython.display import display
from matplotlib.patches import Rectangle

import pypose_lite as pp
from pypose_lite import go1, infinity
from pypose_lite.go1.walk import walk
from pypose_lite.go1.wire import layout, protocol, transport
from pypose_lite.teaching import animate, claim, plotting, sketches, table, widgets
from pypose_lite.teaching.dog import from_above
from pypose_lite.teaching.legged import pictures

plotting.use_style()
torch.set_default_dtype(torch.float64)

# %% [markdown]
# The planner is that of chapter 3, with bounds: this dog trots at up to 1.2 m/s.
# <!-- given: 1.2 m -->

# %%
dt = 0.1  # s, the length of one time step
waypoints = infinity.waypoints()
start = (0.0, 0.0, -math.pi / 2)  # i and j in m, heading in rad
bounds = {
    "u_lower": torch.tensor([0.0, -1.5]),  # m/s, rad/s
    "u_upper": torch.tensor([1.2, 1.5]),
}
two_sweeps = pp.utils.ReduceToBason(steps=2)
weights = torch.tensor([1, 1, 0.3, 0.3, 0.01, 0.01])  # of i, j, cos, sin, v, phi
planner = pp.MPC(pp.DubinsCar(dt), weights.diag(), None, 10, two_sweeps)

# %% [markdown]
# `go1.connect` gives a robot, which can be asked for its pose, told a motion, and stopped.
# `RealRobot` puts it in the car's place, and `infinity.drive` is the loop of all chapters before:

# %%
with go1.connect("sim", start=start) as robot:
    world = infinity.RealRobot(robot, dt)
    lap = infinity.drive(planner, world, tolerance=0.15, **bounds)


# %% tags=["hide-input"]
def plane():
    """A figure of the infinity and its waypoints, and what shows a dog in it."""
    fig, ax = plt.subplots(figsize=(7, 4.2))
    plotting.plot_waypoints(plotting.infinity_axes(ax), waypoints).set_zorder(1)
    show_dog = from_above(ax)
    fig.legend(loc="outside lower center", ncols=2)
    plt.close(fig)
    return fig, show_dog


fig, show_dog = plane()


def frame(k):
    show_dog(lap.x[: 4 * k + 1])
    return fig


alt = "A film: a dog, seen from above, walks once around the infinity sign."
display(animate(frame, lap.steps // 4 + 1, 0.3, alt=alt))

# %% tags=["claims"]
near = torch.cdist(waypoints[:, :2], lap.x[:, :2]).amin(1)  # each waypoint to the way
claim("visited", (near <= 0.15).sum(), equals=17)
claim("lap_error", infinity.tracking_error(lap.x).mean(), below=0.05, unit="m")
claim("lap_time", dt * lap.steps, below=13, unit="s")

# %% [markdown]
# The dog from above, in every fourth step. It visits all {claim}`visited` waypoints in
# {claim}`lap_time`, and is {claim}`lap_error` from the path on average.
#
# Replace `"sim"` by `"udp://192.168.123.161:8082"`, the robot's address, and these lines would
# command a real dog, at up to 1.2 m/s and without anything that this chapter is about. Do not. The
# program for a real robot walks at 0.4 m/s, with the planner that we shall build, and comes with
# a checklist: [On the real robot](on_the_real_robot.md). <!-- given: 1.2 m, 0.4 m -->
#
# In JupyterLab you can walk the simulated dog yourself: press play, and move the sliders.

# %% tags=["remove-cell"]
mine = go1.connect("sim", start=start)
hand_fig, show_mine = plane()
hand_way = [[0.0, 0.0, 0.0, -1.0]]


def by_hand(tick, speed, turn):
    mine.move(speed, turn)
    mine.wait(0.2)
    x, y, heading = mine.pose()
    hand_way.append([x, y, math.cos(heading), math.sin(heading)])
    show_mine(torch.tensor(hand_way))
    return hand_fig


slider = ipywidgets.FloatSlider
widgets.live(
    by_hand,
    alt="A dog from above, and the way that it has walked by the sliders.",
    tick=ipywidgets.Play(max=500, interval=300),
    speed=slider(0.5, min=-1, max=1.2, step=0.1, description="speed (m/s)"),
    turn=slider(0.5, min=-1.5, max=1.5, step=0.1, description="turn (rad/s)"),
)

# %% [markdown]
# ## It fails: the same lap over a bad network
#
# That dog lived in this program, and heard each command at once. Now there is a network, a bad
# Wi-Fi: each packet takes 50 ms, and one of twenty is lost, on the way there and on the way back.
# <!-- given: 50 ms -->

# %%
wifi = go1.Simulation(faults=go1.Faults(loss=0.05, delay=0.05))

# %% [markdown]
# **Predict.** A lap over this line: much the same, wider but whole, or will the dog not arrive?

# %% tags=["answer"]
with go1.connect("sim", start=start, simulation=wifi) as robot:
    world = infinity.RealRobot(robot, dt)
    stuck = infinity.drive(planner, world, tolerance=0.15, steps=100, **bounds)

# %% tags=["answer", "hide-input"]
fig, (top, bottom) = plotting.stacked(2, height=3)
plotting.plot_waypoints(plotting.infinity_axes(top), waypoints)
plotting.plot_states(top, stuck.x, label="over the bad network")
top.legend(loc="lower center", ncols=2, bbox_to_anchor=(0.5, 1.0))
for run, name, style in [(lap, "no network", "-"), (stuck, "bad network", "--")]:
    aimed_at = waypoints[run.goal.clamp(max=16)]
    away = (run.x[:-1] - aimed_at)[:, :2].norm(dim=-1)
    bottom.plot(dt * torch.arange(len(away)), away, style, label=name)
bottom.set(xlabel="time (s)", ylabel="distance to the waypoint (m)", ylim=(0, 1.4))
bottom.legend(loc="upper center", ncols=2)
plotting.show(
    fig,
    "Above, the way of the dog, which ends beside a waypoint half way around. "
    "Below, its distance to the waypoint aimed at: it falls and jumps up 16 times "
    "without a network; with it, it stays constant from some moment on.",
)

# %% tags=["answer", "claims"]
claim("stuck_reached", stuck.goal[-1] - 1, below=16)
claim("stuck_speed", stuck.u[-10:, 0].max(), below=0.02, unit="m/s")

# %% [markdown] tags=["answer"]
# It does not arrive. After {claim}`stuck_reached` of the 16 it stands, told to walk at
# {claim}`stuck_speed`. Chapter 3 had such a car, too, and called it *parked*: it has passed a
# waypoint by a little more than the tolerance, and its best plan is to stay there.

# %% [markdown]
# Why did it pass the waypoint? The car of chapter 3 did what it was told in the step in which it
# was told. The dog does it about a quarter of a second later. The planner does not know that, and
# steers a dog that is no longer where it was. <!-- given: a quarter -->

# %% [markdown]
# ## The idea: draw the loop, then see what is late in it
#
# What exactly is this loop? A chart drawn by hand shows what its author believes. So we put a
# witness between loop and robot, who notes each call. Python calls `__getattr__` for every name
# that the class itself does not have, such as `pose` or `move`; the witness writes it down and
# hands on the robot's own. And since this robot is simulated, it notes before each wait where the
# dog *truly* is.


# %%
class Witness:
    """A robot whose calls are noted, and where it truly is in each step."""

    def __init__(self, robot):
        self.robot = robot
        self.calls = []
        self.truth = []  # rows [x, y, heading], from where it was switched on

    def __getattr__(self, name):
        self.calls.append(name)
        if name == "wait":
            self.truth.append(self.robot.simulator.dog.pose)
        return getattr(self.robot, name)

    def true_states(self):
        """Returns rows [i, j, cos, sin]: it started with its x-axis along -j."""
        x, y, heading = torch.tensor(self.truth).unbind(-1)
        return torch.stack([y, -x, heading.sin(), -heading.cos()], dim=-1)


# %%
with go1.connect("sim", start=start) as robot:
    witness = Witness(robot)
    world = infinity.RealRobot(witness, dt)
    again = infinity.drive(planner, world, tolerance=0.15, **bounds)
print(Counter(witness.calls))
print("the same lap as before:", torch.equal(again.x, lap.x))

# %% [markdown]
# Now the chart, with the number of times that each arrow was taken. It is the paper's: ask where
# the robot is; is the waypoint reached? Then take the next one; plan; send the first motion of the
# plan; wait for a time step, and ask again. When the last waypoint is reached, stop.

# %% tags=["hide-input"]
taken = Counter(zip(witness.calls, witness.calls[1:]))
turns = taken["wait", "pose"]
reached = int(lap.goal[-1] - 1 + lap.finished)
fig, ax = plt.subplots(figsize=(7, 4.4))
ax.set(xlim=(-0.2, 10.3), ylim=(-0.4, 6.1), aspect="equal")
ax.axis("off")
boxes = [(1.5, 5.4, "ask for\nthe pose"), (5, 5.4, "waypoint\nreached?")]
boxes += [(8.8, 5.4, "the last\none?"), (8.8, 2.9, "stop"), (5, 2.9, "plan\n(MPC)")]
boxes += [(5, 0.5, "send the\nfirst motion"), (1.5, 0.5, "wait for\na time step")]
for i, j, text in boxes:
    sketches.box(ax, i, j, text, width=2.3, height=1.2)
sketches.wire(ax, (2.65, 5.4), (3.85, 5.4))
sketches.wire(ax, (6.15, 5.4), (7.65, 5.4))
sketches.wire(ax, (8.8, 4.8), (8.8, 3.5))
sketches.wire(ax, (5, 4.8), (5, 3.5))
sketches.wire(ax, (7.65, 5.0), (6.6, 5.0), (6.6, 3.1), (6.15, 3.1))
sketches.wire(ax, (5, 2.3), (5, 1.1))
sketches.wire(ax, (3.85, 0.5), (2.65, 0.5))
sketches.wire(ax, (1.5, 1.1), (1.5, 4.8))
words = [(6.35, 5.55, f"yes, {reached} x"), (9, 4.1, "yes, 1 x"), (3.2, 4.1, "no")]
words += [(6.75, 3.9, "no: the next")]
words += [(5.2, 1.6, f"{turns} x"), (1.7, 2.8, f"{turns} x")]
for i, j, text in words:
    sketches.word(ax, i, j, text)
plotting.show(
    fig,
    "A flow chart: ask for the pose; if the waypoint is reached and is the last, "
    "stop; else plan, send the first motion, wait for a time step, and ask again.",
)

# %% tags=["claims"]
claim("turns", taken["move", "wait"], equals=int(lap.steps))
claim("as_many_poses", taken["wait", "pose"], equals=int(lap.steps))
claim("ways_out", taken["pose", "stop"], equals=1)
claim("reached", reached, equals=16)
claim("same_lap", torch.equal(again.x, lap.x), equals=True)

# %% [markdown]
# {claim}`turns` times around, and one way out. (In the code the loop also looks once more after
# each wait; nothing moves in between.) Now see what is *not* in the chart.
#
# - **Time.** The arrows from "send" to "ask" look as if they took none. Between them lie a network
#   and four legs.
# - **An end that nobody planned.** While the planner thinks, nobody speaks to the robot. If it
#   hangs or dies, the arrow to "stop" is never taken.
#
# Let us look at the first. We tell the dog to walk, over the bad network, and draw three lines:
# what it was told, what it does, and what this program sees of it.

# %%
with tempfile.TemporaryDirectory() as folder:
    path = f"{folder}/step.csv"
    truly = []
    with go1.connect("sim", simulation=wifi, log=path) as robot:
        for k in range(60):
            robot.move(0.0 if k < 10 else 0.8, 0.0)
            robot.wait(0.02)
            truly.append((robot.now(), robot.simulator.dog.pose[0]))
    rows = torch.tensor(go1.read_log(path))

# %% tags=["hide-input"]
t_true, x_true = torch.tensor(truly).mT
t_true = t_true - t_true[9]  # from when it was first told to walk
does = x_true.diff() / t_true.diff()
told = rows[:, 7]
t_seen = rows[:, 0] - rows[told > 0][0, 0]
fig, ax = plt.subplots(figsize=(7, 3.2))
ax.step(t_seen, told, where="post", color=plotting.GREY, label="told")
ax.plot(t_true[1:], does, color="black", label="does")
ax.plot(t_seen, rows[:, 4], ".", color=plotting.BLUE, label="seen")
ax.axhline(0.8 * (1 - math.exp(-1)), color=plotting.GREY, lw=0.8, ls=":")
ax.set(xlabel="time since it was told to walk (s)", ylabel="speed (m/s)")
ax.set_xlim(-0.1, 0.8)
ax.legend()
plotting.show(
    fig,
    "Three curves against time. What the dog is told jumps to 0.8 m/s at once; what "
    "it does begins a little later and rises smoothly; what is seen is the same, "
    "later still.",
)

# %% tags=["claims"]
rise = 0.8 * (1 - math.exp(-1))
late_true = t_true[1:][does > rise][0]
late_seen = t_seen[rows[:, 4] > rise][0]
claim("late_true", late_true, equals=0.2, within=0.05, unit="s")
claim("late_seen", late_seen, equals=0.26, within=0.06, unit="s")

# %% [markdown]
# Two things are late, and they are not the same.
#
# - The {term}`delay` is pure: nothing happens, and then everything as before. Here it is the
#   packets' time, once for the command and once more for the state.
# - The {term}`lag` is a rounding: the legs begin at once, and approach what they were told. They
#   pass 63 % of it (the dotted line) after one *time constant*. <!-- given: 63 % -->
#
# From the command to the dotted line pass {claim}`late_true` for the dog, and {claim}`late_seen`
# for who watches it. At 1.2 m/s that is a good part of the distance between two waypoints.
# <!-- given: 1.2 m, two waypoints -->

# %% [markdown]
# ## From scratch: a motion as 129 bytes
#
# What goes over this network? A motion travels as 129 bytes in one *UDP packet*. UDP needs no
# connection and promises nothing: a packet arrives or it does not, and nobody is told. The numbers
# lie in the packet at fixed places, the lowest byte of each first (*little-endian*). Most stay
# zero. Python's `struct` writes them: `"<fff"` is three numbers of four bytes.

# %%
packet = bytearray(125)
packet[0:3] = b"\xfe\xef\xee"  # a packet begins; the level: high-level commands
packet[22] = 2  # mode: walk
packet[23] = 1  # gait: trot
struct.pack_into("<fff", packet, 53, 0.3, 0.0, 0.5)  # m/s, m/s, rad/s

# %% [markdown]
# The last four bytes are a checksum, so that no robot walks by a packet that was damaged on its
# way. It is a {term}`cyclic redundancy check` (CRC), and its idea is division. Read the bits of the
# packet as the coefficients, 0 or 1, of a polynomial $p(x)$, and divide it by a fixed polynomial
# $g(x)$ of degree 32. The remainder has 32 bits, and is what is sent along. Coefficients are added
# without carry, $1 + 1 = 0$, so adding and subtracting are both *exclusive or*, `^` in Python.
#
# Why does this find damage? A damaged packet is $p(x) + e(x)$, where $e$ has a 1 for each bit that
# was flipped. The remainder of a sum is the sum of the remainders. So damage goes unseen exactly if
# $g$ divides $e$ without a remainder. A single flipped bit is $e = x^k$. Since $g$ begins and ends
# with a 1, it does not divide $x^k$, whatever $k$: every single flip is found.
#
# The division is done as on paper, from the highest bit on: where the leading bit is 1, subtract
# $g$, then go on to the next bit. The Go1 reads the packet in words of four bytes, and starts with
# a register full of ones:


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


packet += struct.pack("<I", checksum(packet[:124]))  # all whole words
print(len(packet), "bytes:", packet[:24].hex(" "), "...")

# %% [markdown]
# The library writes the same packet with `encode_command`. Its tests hold it against packets that
# the robot vendor's own program sent and took.

# %%
command = protocol.HighCmd(mode=2, gait_type=1, velocity=(0.3, 0.0), yaw_speed=0.5)
ours = bytes(packet)
theirs = protocol.encode_command(command)
print("the same bytes:", ours == theirs)

# %% tags=["hide-input"]
LOOK = {
    "begin, level": ("head level_flag", plotting.GREY),
    "mode, gait": ("mode gait_type", plotting.ORANGE),
    "speeds": ("velocity yaw_speed", plotting.BLUE),
    "postures": ("foot_raise_height body_height position euler", plotting.GREEN),
    "checksum": ("checksum", plotting.RED),
}


def draw_map(ax, kind, size, width, looks):
    """A packet as squares, a byte each, width of them in a row."""
    fields = layout.places(kind) | {"checksum": slice(size - 4, size)}
    colors = dict.fromkeys(range(size), ("0.93", 1.0))
    for names, color in looks.values():
        for name in names.split():
            part = fields.get(name, slice(0, 0))
            colors |= dict.fromkeys(range(part.start, part.stop), (color, 0.5))
    for k, (color, alpha) in colors.items():
        place = (k % width, k // width)
        ax.add_patch(Rectangle(place, 0.92, 0.9, fc=color, alpha=alpha))
    rows = range(0, -(-size // width), 1 if size < 200 else 4)
    ax.set_yticks([row + 0.45 for row in rows], [row * width for row in rows])
    ax.set(xlim=(-0.2, width), ylim=(-(-size // width), -0.1), ylabel="row from byte")
    ax.set_xticks([])
    ax.grid(False)
    for label, (_, color) in looks.items():
        ax.add_patch(Rectangle((0, -9), 0, 0, fc=color, alpha=0.5, label=label))


# %% tags=["hide-input"]
fig, ax = plt.subplots(figsize=(7, 4.6))
draw_map(ax, protocol.HighCmd, 129, 16, LOOK)
for k, byte in enumerate(packet):
    place = (k % 16 + 0.46, k // 16 + 0.47)
    ax.text(*place, f"{byte:02x}", ha="center", va="center", size=10)
fig.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=5)
plotting.show(
    fig,
    "The 129 bytes of the command as squares, 16 in a row, with their values; "
    "beginning, mode and gait, speeds, postures and the checksum at the end have a "
    "colour each.",
)

# %% tags=["claims"]
claim("same_bytes", ours == theirs, equals=True)
claim("command_bytes", len(packet), equals=129)

# %% [markdown]
# **Predict.** Flip one bit of the packet's 1032, each in turn. How many of these damaged packets
# does the robot take for good: none, a few, or most?


# %% tags=["answer"]
def is_taken(data):
    """Whether a robot would walk by these bytes."""
    try:
        protocol.decode_command(data)
        return True
    except protocol.ProtocolError:
        return False


good = int.from_bytes(packet, "little")
unseen = []
for bit in range(8 * 129):
    damaged = (good ^ (1 << bit)).to_bytes(129, "little")
    if is_taken(damaged):
        unseen.append(bit)
print("bytes whose damage is not seen:", {bit // 8 for bit in unseen})

# %% tags=["answer", "claims"]
claim("flips_taken", len(unseen), equals=8)
claim("only_uncovered", {bit // 8 for bit in unseen} == {124}, equals=True)

# %% [markdown] tags=["answer"]
# {claim}`flips_taken`: the bits of byte 124. The checksum runs over whole words of four bytes, and
# the command has 125 bytes before it, one too many. That byte is reserved for later use, so no harm
# is done.

# %% [markdown]
# A checksum finds damage, not age. There is no number and no time in these packets. One that was
# held up on its way, or came a second time, looks as good as new.
#
# The robot answers each command with its state, 1087 bytes, most of which are about its twenty
# motors (twelve are used). Of all this the loop needs the pose, and a planner that knows about legs
# needs the speeds. <!-- given: twelve -->

# %% tags=["hide-input"]
FEET = "foot_force foot_force_est foot_position2body foot_speed2body"
STATE = {
    "begin, level": ("head level_flag", plotting.GREY),
    "inertial sensor": ("imu", plotting.PURPLE),
    "motors": ("motor_state", plotting.SKY),
    "battery": ("bms", plotting.ORANGE),
    "feet": (FEET, plotting.GREEN),
    "pose, speeds": ("position body_height velocity yaw_speed", plotting.BLUE),
    "remote": ("wireless_remote", "black"),
    "checksum": ("checksum", plotting.RED),
}
fig, ax = plt.subplots(figsize=(7, 3.6))
draw_map(ax, protocol.HighState, protocol.STATE_SIZE, 64, STATE)
fig.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=4)
plotting.show(
    fig,
    "The 1087 bytes of a state, 64 in a row. Motors fill more than half of them; "
    "inertial sensor, battery, feet, pose and speeds, remote and checksum take a "
    "row or two each.",
)

# %% tags=["claims"]
motors = layout.places(protocol.HighState)["motor_state"]
share = 100 * (motors.stop - motors.start) / protocol.STATE_SIZE
claim("state_bytes", protocol.STATE_SIZE, equals=1087)
claim("motor_share", share, above=60, unit="%")

# %% [markdown]
# ## Who says stop? Watchdogs
#
# Packets get lost, and a robot forgets what it was told. So a command is not sent once but, by a
# thread of its own, 200 times a second. That is good against the network, and dangerous: if the
# planner hangs, the thread goes on sending the last motion for ever. It needs a {term}`watchdog`, a
# clock that runs towards "stop", and that the planner has to wind up in every step. The pose may be
# too old as well: then the planner plans for a dog that is elsewhere. This is the whole of ours:
# <!-- given: 200 times -->
#
# ```
# fresh = now - asked_at < patience   # is the motion new enough?
# heard = now - heard_at < patience   # and what we know of the robot?
# send(motion if fresh and heard else zero)
# ```
#
# In the library it is `Pilot.command`, in `pypose_lite/go1/safety/pilot.py`; there, half a second
# of zero velocity becomes a stand. Here is a dog that walks for three seconds, after which one of
# two things goes wrong: the planner hangs while its sender lives, or the cable is pulled.
# <!-- given: half, three seconds -->


# %%
def walk_then_silence(simulation=None, goes_on=False, **options):
    """Returns the way (m) after each of 60 steps; after 30 no motion is asked for."""
    way = []
    with go1.connect("sim", simulation=simulation, **options) as robot:
        for k in range(60):
            if k < 30 or goes_on:
                robot.move(0.8, 0.0)
            robot.wait(dt)
            way.append(robot.simulator.dog.pose[0])
    return torch.tensor(way)


def pulled(watchdog):
    """A robot that hears nothing after 3 s, and stops watchdog seconds later."""
    return go1.Simulation(vanish=3.0, numbers=go1.Numbers(watchdog=watchdog))


# %% [markdown]
# A cable that is pulled cannot be helped from this end. Only the robot itself can then stop.
# Whether a Go1 does, *is not documented*. Ours is assumed to, after 0.5 s, and both cases are
# drawn. <!-- given: 0.5 s -->
#
# **Predict.** The sender's watchdog waits for 0.4 s. With 0.1 s the dog would stop four times as
# soon. Is that better? <!-- given: 0.4 s, 0.1 s, four times -->

# %% tags=["answer", "hide-input"]
seconds = dt * torch.arange(1, 61)
loose = walk_then_silence(goes_on=True)
cases = {
    "the planner hangs": (None, "sender's watchdog"),
    "cable pulled, robot with a watchdog (assumed)": (pulled(0.5), "both watchdogs"),
    "cable pulled, robot without one": (pulled(math.inf), "sender's watchdog"),
}


def stops(timeout):
    fig, panels = plotting.stacked(3, height=1.9, sharex=True)
    for ax, (title, (simulation, label)) in zip(panels, cases.items()):
        way = walk_then_silence(simulation, command_timeout=timeout)
        ax.plot(seconds, loose, "--", color=plotting.RED, label="no watchdog")
        ax.plot(seconds, way, color=plotting.BLUE, label=label)
        ax.axvline(3, color=plotting.GREY, ls=":")
        ax.set(title=title, ylabel="walked (m)", ylim=(0, 5))
        ax.legend(loc="upper left")
    panels[2].set_xlabel("time (s)")
    return fig


alt = "Way against time in three cases, with and without watchdogs from 3 s on."
label = "the sender's watchdog (s)"
display(widgets.panels(stops, [0.1, 0.2, 0.4, 0.8], label, alt=alt))

# %% tags=["answer", "claims"]
hung = walk_then_silence(command_timeout=0.4)
hasty = walk_then_silence(command_timeout=0.1)
own = walk_then_silence(pulled(0.5))
none = walk_then_silence(pulled(math.inf))
claim("loose_walks", loose[-1] - loose[29], above=2.2, unit="m")
claim("hung_walks", hung[-1] - hung[29], below=0.45, unit="m")
claim("own_walks", own[-1] - own[29], below=0.55, unit="m")
claim("none_walks", none[-1] - none[29], above=2.2, unit="m")
claim("hasty_share", 100 * hasty[29] / hung[29], below=80, unit="%")

# %% [markdown] tags=["answer"]
# No: move the slider. A watchdog of 0.1 s is as long as a step. It bites a planner that is in good
# health, and in the first three seconds the dog gets only {claim}`hasty_share` of the way. A
# watchdog has to be longer than the longest pause of a planner that works, and shorter than what
# you can bear. <!-- given: 0.1 s, three seconds -->
#
# Without any, a dog whose planner hangs walks on, {claim}`loose_walks` in the next three seconds.
# With the sender's it is {claim}`hung_walks`. But a watchdog can only stop what it can reach. When
# the cable is pulled, everything depends on the robot's own: {claim}`own_walks` with one, and
# {claim}`none_walks` without. The first thing to find out about a robot is which of the two it is.

# %% [markdown]
# ### The whole program dies
#
# A watchdog that lives in the program dies with it. So `connect` starts a second, small process,
# the *guardian*. It does nothing while it hears the heartbeat of the first, and says "stop" when it
# does not. We try it in earnest: a program walks a dog that lives here, over real UDP on this
# computer, and is killed with no chance to say goodbye.

# %%
server = transport.UdpServer("127.0.0.1", 0, protocol.COMMAND_SIZE, silence=2.0)
victim = go1.SimulatedRobot(server, go1.Simulation())
heard = []  # times, and speeds that it was told


def note(command):
    heard.append((time.monotonic(), command.velocity[0]))
    victim.dog.ask(command)


victim.apply = note
program = f"""
from pypose_lite import go1
robot = go1.connect("udp://127.0.0.1:{server.port}")
for _ in range(400):
    robot.move(0.4, 0.3)
    robot.wait(0.1)
"""
child = subprocess.Popen([sys.executable, "-c", program])

# %%
while len(heard) < 400 and child.poll() is None:  # two seconds
    victim.step(0.005)
alive = child.poll() is None
killed = time.monotonic()
child.kill()
while time.monotonic() < killed + 1:
    victim.step(0.005)
child.wait()
server.close()
zeros = [at - killed for at, speed in heard if at > killed and speed == 0]
print(f"the first zero came {1000 * zeros[0]:.1f} ms after the kill")

# %% tags=["claims"]
last_motion = max(at for at, speed in heard if speed > 0) - killed
claim("alive", alive, equals=True)
motions = sum(speed > 0 for _, speed in heard)
claim("it_walked", motions, above=100, varies=True)
claim("zero_after_kill", zeros[0], below=0.7, unit="s", varies=True)
claim("no_motion_after", last_motion < zeros[0], equals=True)

# %% [markdown]
# {claim}`zero_after_kill` after the kill came the first zero, and no motion any more. The guardian
# also helps against a program that is paused, or stuck in a function of C. (On Windows there is
# none, and the robot simply hears no more.)

# %% [markdown]
# ## Derived: lag and delay from a log
#
# Back to the dog that got stuck. Its planner has to know two numbers: how fast the legs follow, and
# how late everything is. Both can be found in any recording of a walk, if it changes its speed.
#
# **The model.** Legs that are told the speed $u$ speed up by the more, the further they are from
# it:
#
# $$ \dot v = \frac{u - v}{\tau} $$ (eq-9-legs)
#
# The time constant $\tau$ is the lag. While $u$ stays the same, the difference $v - u$ decays
# exponentially, as you can check by differentiating:
#
# $$ v(t) = u + e^{-t/\tau}\, \bigl(v(0) - u\bigr) $$ (eq-9-decay)
#
# **A command that changes.** Let $u$ change at times $t_1, t_2, \dots$ by
# $\Delta u_1, \Delta u_2, \dots$ The equation is linear, so the answers to these changes add up.
# Each begins at its own time:
#
# $$
# v(t) = u_0 + \sum_{t_j < t} \Delta u_j \left(1 - e^{-(t - t_j)/\tau}\right)
# $$ (eq-9-lag)
#
# **The delay.** What a log calls "seen at $t$" happened earlier, by the delay $d$ there and back.
# So put $t - d$ in place of $t$. We look for the $\tau$ and $d$ whose $v(t - d)$ is nearest to what
# was seen, in the least mean square. In the code, terms that have not begun are made zero by
# `clamp`.
#
# **The record.** Let the dog walk over the bad network at speeds that change every second. The log
# has a row for each new state: the time, what was seen, and what was being told.


# %%
def record(path, simulation):
    """Walks 12 s at random speeds; returns times, seen (N, 2) and told (N, 2)."""
    generator = torch.Generator().manual_seed(0)
    speeds = torch.rand(12, 2, generator=generator)
    with go1.connect("sim", simulation=simulation, log=path) as robot:
        for k in range(120):
            v, w = speeds[k // 10].tolist()
            robot.move(v, 2 * w - 1)  # m/s, rad/s
            robot.wait(dt)
    rows = torch.tensor(go1.read_log(path))
    return rows[:, 0], rows[:, [4, 6]], rows[:, [7, 9]]


with tempfile.TemporaryDirectory() as folder:
    t, seen, told = record(f"{folder}/walk.csv", wifi)


# %%
def speeds_of(lag, delay):
    """Returns v(t - d) of every row, (N, 2)."""
    since = (t[:, None] - delay - t[1:]).clamp(min=0)  # s since each change began
    return told[0] + (1 - torch.exp(-since / lag)) @ told.diff(dim=0)  # (9.3)


def misfit(lag, delay):
    """Returns the mean square of the difference to what was seen."""
    return (speeds_of(lag, delay) - seen).square().mean()


# %% [markdown]
# Both numbers have to stay positive, so we look for their logarithms. The misfit is continuous in
# both. In $d$ it has a kink wherever $t - d$ passes one of the $t_j$, because there an exponential
# begins; with hundreds of rows these kinks are small, and the optimiser of
# [chapter 8](08_learning.py) does not mind them.

# %%
unknown = torch.tensor([0.5, 0.2]).log().requires_grad_()  # a first guess, s
steps = []


def evaluate():
    loss = misfit(*unknown.exp())
    (unknown.grad,) = torch.autograd.grad(loss, unknown)
    steps.append(unknown.detach().exp())
    return loss.detach()


optimizer = torch.optim.LBFGS([unknown], max_iter=25, line_search_fn="strong_wolfe")
optimizer.step(evaluate)
lag, delay = unknown.detach().exp()
print(f"lag {lag:.3f} s, delay {delay:.3f} s")

# %% tags=["hide-input"]
fig, (top, bottom) = plotting.stacked(2, height=2.9)
top.step(t, told[:, 0], where="post", color=plotting.GREY, lw=1, label="told")
top.plot(t, seen[:, 0], ".", ms=3, color=plotting.SKY, label="seen")
top.plot(t, speeds_of(lag, delay)[:, 0], color=plotting.RED, lw=1, label="model")
top.set(xlabel="time (s)", ylabel="speed (m/s)", xlim=(0, 6.5), ylim=(-0.05, 1.3))
top.legend(ncols=3, loc="upper center")
lags = torch.linspace(0.02, 0.6, 30)
delays = torch.linspace(0, 0.3, 25)
heights = [[misfit(p, q).sqrt() for p in lags] for q in delays]
look = {"colors": plotting.GREY, "linewidths": 0.7}
lines = bottom.contour(lags, delays, heights, 12, **look)
bottom.clabel(lines, lines.levels[1::4], fmt="%.2f m/s", fontsize=8)
bottom.plot(*torch.stack(steps).mT, ".-", color=plotting.BLUE, label="evaluations")
bottom.plot(0.15, 0.1, "*", ms=12, color=plotting.RED, label="true")
bottom.set(xlabel="lag (s)", ylabel="delay (s)", xlim=(0.02, 0.6), ylim=(0, 0.3))
bottom.legend()
plotting.show(
    fig,
    "Above, the speed that was told, seen, and predicted by the model: seen and "
    "predicted agree. Below, lines of equal misfit over lag and delay, and the "
    "optimiser's way to the true point.",
)

# %% tags=["claims"]
claim("lag", lag, equals=0.15, within=0.01, unit="s")
claim("delay", delay, equals=0.1, within=0.015, unit="s")
claim("misfit", misfit(lag, delay).sqrt(), below=0.012, unit="m/s")

# %% [markdown]
# The lag is {claim}`lag`, the delay {claim}`delay`. What was set in the simulator is 0.15 s and 50
# ms each way. (What is seen is renewed 50 times a second, which adds a little to the delay.) What
# the model does not explain, {claim}`misfit`, is the noise of the dog's sensors.
# <!-- given: 0.15 s, 50 ms, 50 times -->

# %% [markdown]
# ## A planner that knows
#
# Two changes to the planner of chapter 3, one for each number.
#
# **The lag goes into the model.** The state gets two more entries, the speed $v$ and the turn rate
# $\omega$ that the legs have by now. In a time step they follow {eq}`eq-9-decay`, and then the car
# moves with them:
#
# $$
# v' = u + e^{-\Delta t/\tau} (v - u)
# $$ (eq-9-step)
#
# In the library this system is `pp.Legs`.
#
# **The delay goes into where the plan begins.** A motion that we plan now will act when the last
# few have acted: they are sent, and are still on their way. So we let the model walk by these, and
# plan from where they will have led. (This is called *delay compensation* by prediction, and goes
# back to Smith {cite}`smith1957`.)


# %%
def state_of(robot, x):
    """Returns [i, j, cos, sin, v, w]: where it is, and the speeds that it reports."""
    state = robot.state
    return torch.cat([x, torch.tensor([state.velocity[0], state.yaw_speed])])


def planner_for_legs(lag):
    """Returns chapter 3's planner with legs in its model; speeds have no weight."""
    weights = torch.tensor([1, 1, 0.3, 0.3, 0, 0, 0.01, 0.01])
    return pp.MPC(pp.Legs(dt, lag=lag), weights.diag(), None, 10, two_sweeps)


# %%
class Ahead:
    """Plans from where the robot will be when the next motion acts."""

    def __init__(self, robot, lag, late):
        self.robot = robot
        self.late = late
        self.mpc = planner_for_legs(lag)
        self.plan = torch.zeros(10, 2)
        self.sent = []

    def __call__(self, dt, x, target, **bounds):
        z = state_of(self.robot, x)
        for u in self.sent[len(self.sent) - self.late :]:  # on their way
            z = self.mpc.system.state_transition(z, u)  # (9.4)
        goal = torch.cat([target, torch.zeros(2)])
        plan = self.mpc(dt, z, goal, pp.shift(self.plan), **bounds)
        self.plan = plan[1]
        self.sent.append(self.plan[0])
        return plan


# %% [markdown]
# `infinity.drive` asks it for a plan as it asked the other. The line is the one on which that one
# got stuck.

# %%
late = round(delay.item() / dt)  # steps
with go1.connect("sim", start=start, simulation=wifi) as robot:
    witness = Witness(robot)
    ahead = Ahead(robot, lag, late)
    world = infinity.RealRobot(witness, dt)
    known = infinity.drive(ahead, world, tolerance=0.15, steps=160, **bounds)
print("finished:", known.finished.item(), "in", known.steps.item(), "steps")

# %% [markdown]
# **The library's version** is `go1.walk.walk`, which the program `python -m pypose_lite.go1 walk`
# calls. It is the same loop and the same planner. It aims not at the next waypoint but along the
# curve of [chapter 6](06_splines.py) through the waypoints, at a speed that you give. It also keeps
# the robot within an area, and says when it is stuck.

# %%
smooth = {}
for speed in (0.4, 0.8):  # m/s
    with go1.connect("sim", start=start, simulation=wifi) as robot:
        smooth[speed] = walk(robot, speed, delay.item(), lag.item())

# %% [markdown]
# ## On the infinity: the recorded trajectory
#
# This is the paper's last figure, as our dog gives it: each blue dot is an observation, one a time
# step, and they are connected.

# %% tags=["hide-input"]
true = witness.true_states()
fig, ax = plt.subplots(figsize=(7, 4.6))
plotting.plot_states(plotting.infinity_axes(ax), known.x, label="observations")
look = {"ms": 9, "mfc": "none", "color": plotting.RED}
ax.plot(*waypoints[:, :2].mT, "o", **look, label="waypoints")
ax.plot(*true[:, :2].mT, color="black", lw=1, label="where the dog was")
fig.legend(loc="outside lower center", ncols=3)
plotting.show(
    fig,
    "The trajectory of the dog over the bad network: connected blue dots through "
    "all waypoints of the infinity sign. A black line, where it truly was, runs a "
    "little beside them.",
)
runs = {
    "no network": lap,
    "bad network": stuck,
    "bad network, known": known,
    "along the curve, 0.8 m/s": smooth[0.8],
    "along the curve, 0.4 m/s": smooth[0.4],
}
rows = []
for name, run in runs.items():
    e = infinity.tracking_error(run.x)
    done = run.goal[-1] - 1 + run.finished
    numbers = f"{dt * run.steps:.1f} | {e.mean():.3f} | {e.max():.3f}"
    rows.append(f"{name} | {done} | {numbers}")
head = "lap | waypoints, of 16 | time (s) | mean error (m) | largest (m)"
display(table(head, rows))

# %% tags=["claims"]
near = torch.cdist(waypoints[:, :2], known.x[:, :2]).amin(1)
claim("knows_visited", (near <= 0.15).sum(), equals=17)
claim("knows_error", infinity.tracking_error(known.x).mean(), below=0.03, unit="m")
claim("knows_true_error", infinity.tracking_error(true).mean(), below=0.06, unit="m")
walk_error = infinity.tracking_error(smooth[0.8].x).mean()
claim("walk_error", walk_error, below=0.015, unit="m")
claim("walk_finished", all(run.finished for run in smooth.values()), equals=True)

# %% [markdown]
# Laps one and two of the table are by chapter 3's planner. The one that knows visits all
# {claim}`knows_visited` waypoints on the line on which the other got stuck. It is
# {claim}`knows_error` from the path, less than the other was without a network: the legs' lag was
# there, too, and nobody had told it. Along the curve at 0.8 m/s it is {claim}`walk_error`.
# <!-- given: 0.8 m -->
#
# The black line is a little beside the blue dots. Where does that come from?

# %% [markdown]
# ## What goes wrong: drift, which no log shows
#
# The blue dots are what the dog *believes*. It counts its steps from where it was switched on
# ({term}`odometry`), and every miscounted step stays. Ours takes a metre for 1 % more, and turns
# slightly in its own opinion. Let us be less kind: 3 %, and one degree a second.
# <!-- given: 1 %, 3 %, one degree -->
#
# The tool of chapter 4 is at hand, and there are two ways to use it. The first is obvious: the
# odometry's pose is a noisy observation, so give it to the EKF. The second takes the odometry as
# the *input*, which says how far the dog has moved, and as observation a camera on the ceiling,
# that sees the dog twice a second with a noise of 5 cm. Then the filter runs in the robot's place:
# who asks for the pose gets the estimate. <!-- given: 5 cm, twice -->


# %%
def odometry_in(robot, dt):
    """Waits for a step; returns the speed and turn rate in it, by the odometry."""
    before = torch.tensor(robot.pose())
    robot.wait(dt)
    change = torch.tensor(robot.pose()) - before
    turn = math.remainder(change[2], math.tau)
    return torch.tensor([change[:2].norm(), turn]) / dt


def camera(state, generator):
    """Returns an observation of [i, j, cos, sin] that has the position alone."""
    noise = 0.05 * torch.randn(2, generator=generator)
    return torch.tensor([*(state[:2] + noise), math.nan, math.nan])


# %% [markdown]
# An entry that is not a number was not observed; the library's filters leave it out.


# %%
class WithCamera(Witness):
    """Odometry says how it has moved, and now and then a camera where it is."""

    Q = torch.tensor([0.01, 0.01, 0.02, 0.02]).square().diag()  # of one step
    R = torch.tensor([0.05, 0.05, 1, 1]).square().diag()
    ekf = pp.EKF(pp.DubinsCar(dt), Q, R)
    x = waypoints[0]
    P = 1e-4 * torch.eye(4)
    generator = torch.Generator().manual_seed(0)

    def pose(self):
        return *self.x[:2].tolist(), math.atan2(self.x[3], self.x[2])

    def wait(self, dt):
        self.truth.append(self.robot.simulator.dog.pose)
        y = torch.full((4,), math.nan)
        if len(self.truth) % 5 == 1:
            y = camera(self.true_states()[-1], self.generator)
        u = odometry_in(self.robot, dt)
        self.x, self.P = self.ekf(self.x, y, u, self.P)


# %% [markdown]
# **Predict.** A lap by odometry alone is our measure. Does the EKF that observes the odometry take
# out most of the drift, some of it, or nothing?

# %% tags=["answer"]
drifts = go1.Numbers(scale=1.03, yaw_drift=math.radians(1))
strays = go1.Simulation(numbers=drifts)


def lap_as(witness_class, estimator=None):
    """Returns what the loop believes and where the dog is, both as states."""
    noise = {"process_noise": 0.01, "observation_noise": 0.01}
    with go1.connect("sim", start=start, simulation=strays) as robot:
        witness = witness_class(robot)
        world = infinity.RealRobot(witness, dt, **noise)
        ahead = Ahead(robot, lag, late=0)
        run = infinity.drive(ahead, world, estimator, tolerance=0.15, **bounds)
    return run.estimate, witness.true_states()


torch.manual_seed(1)
laps = {
    "odometry alone": lap_as(Witness),
    "EKF that observes the odometry": lap_as(Witness, pp.EKF(pp.DubinsCar(dt))),
    "EKF with odometry and camera": lap_as(WithCamera),
}

# %% tags=["answer", "hide-input"]
fig, panels = plotting.stacked(3, height=2.7)
for ax, (title, (believed, truth)) in zip(panels, laps.items()):
    plotting.plot_waypoints(plotting.infinity_axes(ax, title), waypoints)
    plotting.plot_states(ax, believed, label="what the loop believes")
    ax.plot(*truth[:, :2].mT, color="black", lw=1, label="where the dog is")
fig.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=3)
plotting.show(
    fig,
    "Three laps. By odometry alone, and by a filter that observes the odometry, "
    "what the loop believes follows the infinity while the dog walks beside it. "
    "With the camera both agree.",
)

# %% tags=["answer", "claims"]
off = {name: (a - b)[:, :2].norm(dim=-1) for name, (a, b) in laps.items()}
odometry_off, ekf_off, camera_off = off.values()
claim("odometry_off", odometry_off.mean(), above=0.1, unit="m")
claim("odometry_end", odometry_off[-1], below=0.06, unit="m")
claim("ekf_off", ekf_off.mean() / odometry_off.mean(), above=0.8, below=1.2)
claim("camera_off", camera_off.mean(), below=0.07, unit="m")

# %% [markdown] tags=["answer"]
# Nothing: its mean error is {claim}`ekf_off` times that of the odometry alone. A filter weighs what
# it is told. The drift is in every pose that it was told, so there is nothing to weigh it against.

# %% [markdown]
# By odometry alone the loop sees a fine lap, while the dog is {claim}`odometry_off` from where it
# is thought to be, on average. No look at the log tells. Nor does a mark on the floor at the end:
# there the two are only {claim}`odometry_end` apart, because the second circle of an infinity is
# the first one turned around, and undoes its drift. A test for a fault has to be one that the fault
# cannot pass.
#
# With the camera it is {claim}`camera_off`, although each look of the camera alone is no better
# than that: odometry is good over the short run, the camera over the long one. Filters average out
# noise. Against drift one needs a second sensor that does not share it.

# %% [markdown]
# ## Faults that look like health
#
# In each of these, packets come in at full rate, with valid checksums. We walk the dog straight on
# at 0.5 m/s for four seconds. <!-- given: 0.5 m, four seconds -->
#
# - **The wrong level flag.** Byte 2 has to be `00` for the models Air and Pro. With `EE` they
#   discard every command, and answer all the same.
# - **A frozen robot.** Its program hangs, while something goes on sending its last state.
# - **A robot that does something else:** after two seconds it falls, or somebody presses a button
#   of its remote control, or its odometry stays where it is. <!-- given: two seconds -->


# %%
def straight_on(simulation=None, mishap=None, **options):
    """Returns metres walked, age of the state, refusals, and what was raised."""
    raised = "nothing"
    with go1.connect("sim", simulation=simulation, **options) as robot:
        for k in range(40):
            if k == 20 and mishap:
                setattr(robot.simulator.dog, *mishap)
            try:
                robot.move(0.5, 0.0)
            except (go1.RobotTimeout, go1.RobotStopped) as error:
                raised = str(error) if raised == "nothing" else raised
            robot.wait(dt)
        way = robot.simulator.dog.pose[0]
        return way, robot.age, robot.simulator.refused, raised


# %%
button_a = b"\0\0\0\1" + bytes(36)  # the remote's 40 bytes, with A pressed
faults = {
    "nothing": straight_on(),
    "Pro, flag EE": straight_on(go1.Simulation(model="pro")),
    "Pro, flag 00": straight_on(go1.Simulation(model="pro"), level_flag=0x00),
    "frozen after 2 s": straight_on(go1.Simulation(freeze=2.0)),
    "falls": straight_on(mishap=("leaning", (1.6, 0.0))),
    "remote": straight_on(mishap=("remote", button_a)),
    "odometry stays": straight_on(mishap=("numbers", go1.Numbers(scale=0))),
}

# %% tags=["hide-input"]
rows = []
for name, (way, age, refused, raised) in faults.items():
    why = raised.split(" (")[0]  # in parentheses: what to do about it
    rows.append(f"{name} | {way:.2f} | {age:.2f} | {refused} | {why}")
display(table("fault | walked (m) | state's age (s) | refused | raised", rows))

# %% tags=["claims"]
claim("pro_walks", faults["Pro, flag EE"][0], below=0.001, unit="m")
claim("pro_age", faults["Pro, flag EE"][1], below=0.05, unit="s")
claim("pro_with_00", faults["Pro, flag 00"][0], above=1.5, unit="m")
claim("frozen_age", faults["frozen after 2 s"][1], above=1.5, unit="s")
claim("frozen_walks", faults["frozen after 2 s"][0], below=1.4, unit="m")
claim("raised", sum(fault[3] != "nothing" for fault in faults.values()), equals=5)

# %% [markdown]
# Whoever measures age by the last *packet* finds all of them healthy. The library measures it by
# the last new *content*: a robot that stands still has noise in its sensors, and no two of its
# states are alike byte for byte. So the frozen robot's state is {claim}`frozen_age` old, `pose()`
# raises, and zeros go out.
#
# For the others there is no such sign, for their states are new. So the library compares every new
# state with what was asked, by a handful of rules (in `pypose_lite/go1/safety/rules.py`). What one
# state shows, such as a body that leans, stops the dog at once. That motion asked and motion seen
# part has to last for a second, longer than a network is late. Whoever was stopped stays so until
# you have looked, and called `go_on()`. Every limit in these rules is assumed, and wide, because a
# dog to which nothing happens must walk on. <!-- given: a second -->

# %% [markdown]
# ## Four legs: the same loop on a body with physics
#
# The paper's first figure shows its robot on the infinity. Nobody here has a Go1, and every number
# of the dog so far is assumed. The nearest thing that one can have at home is physics: the body of
# a *Go2*, the Go1's successor, and a gait that was trained for it, in the simulator MuJoCo
# {cite}`todorov2012`. It feels its feet touch the floor, and reports where it thinks it is from the
# angles of its joints. To our loop it speaks the Go1's packets, so it is just another address:
# `"sim:legs"`. (It needs the extra `legs`; `make` has installed it.)
#
# **Predict.** The first planner of this chapter, without a network, now at up to 0.5 m/s: will this
# dog walk the lap much like the other, walk it in wider circles, or not arrive?
# <!-- given: 0.5 m -->

# %% tags=["answer"]
slow = {
    "u_lower": torch.tensor([0.0, -1.2]),  # m/s, rad/s
    "u_upper": torch.tensor([0.5, 1.2]),
}
with go1.connect("sim:legs", start=start, ignore=["motion"]) as robot:
    witness = Witness(robot)
    world = infinity.RealRobot(witness, dt)
    parked = infinity.drive(planner, world, tolerance=0.15, steps=200, **slow)
parked_at = witness.true_states()

# %% tags=["answer", "hide-input"]
fig, (top, bottom) = plotting.stacked(2, height=3)
plotting.plot_waypoints(plotting.infinity_axes(top), waypoints)
plotting.plot_states(top, parked_at, label="where the dog was")
top.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
heading = torch.atan2(parked_at[:, 3], parked_at[:, 2])
turned = torch.sin(heading.diff()) / dt
seconds = dt * torch.arange(len(turned))
told = parked.u[: len(turned), 1]
bottom.step(seconds, told, where="post", color=plotting.GREY, label="told")
bottom.plot(seconds, turned, ".", ms=4, color=plotting.BLUE, label="does")
bottom.set(xlabel="time (s)", ylabel="turn rate (rad/s)", xlim=(0, 10))
bottom.legend(ncols=2)
plotting.show(
    fig,
    "Above, the short way of a dog with legs, which ends beside the first waypoint. "
    "Below, its turn rate: after some seconds it is told to turn slowly, and does "
    "not turn.",
)

# %% tags=["answer", "claims"]
claim("legs_reached", parked.goal[-1] - 1, below=16)
claim("legs_told_speed", parked.u[-50:, 0].mean(), below=0.05, unit="m/s")
told_turn = parked.u[-50:, 1].mean()
claim("legs_told_turn", told_turn, above=0.08, below=0.25, unit="rad/s")
claim("legs_turned", turned[-50:].mean().abs(), below=0.05, unit="rad/s")

# %% [markdown] tags=["answer"]
# It does not arrive. It reaches {claim}`legs_reached` of the 16, since it walks past the first one:
# its legs are late, and, as we shall see, its body slides in turns. There the planner wants to turn
# on the spot, slowly: it asks for {claim}`legs_told_speed` and {claim}`legs_told_turn`. But this
# gait has a {term}`dead band`: told so little, it steps in place, and turns by
# {claim}`legs_turned`. The next plan is the same as this one.

# %% [markdown]
# So we ask this robot, too, what it does with commands. `go1.excite` lets it walk in pulses and
# turns for about 50 s, on a free floor, and `go1.identify` fits to the log, beside lag and delay,
# what {eq}`eq-9-legs` leaves out: the share of a command that it does (the *gain*), a motion that
# it makes unasked (the *drift*), and its *axle*: how far behind its middle the point lies about
# which it turns, so that its middle slides. The dog that is asked is another one than that of the
# lap. <!-- given: 50 s -->

# %%
with tempfile.TemporaryDirectory() as folder:
    path = f"{folder}/pulses.csv"
    setup = {"simulation": go1.Simulation(body="legs", seed=100), "log": path}
    with go1.connect("sim:legs", ignore=["motion"], **setup) as robot:
        go1.excite(robot)
    response = go1.identify(go1.read_log(path))
for name in ("dead_band", "lag", "delay", "gain", "drift", "axle"):
    numbers = torch.tensor(getattr(response, name))
    print(f"{name}: {numbers.numpy().round(3)}")

# %% [markdown]
# All of these go into the planner. Lag, gain, drift and axle are numbers of the model `pp.Legs`,
# and on a curve the dog is to look a little away from where it goes. The dead band is a lower bound
# of the speed: until the last waypoint, the planner may not ask for less. The *trim* is added to
# every motion against a drift to one side.

# %%
with go1.connect("sim:legs", start=start, trim=response.trim) as robot:
    witness = Witness(robot)
    legs_lap = walk(witness, 0.5, response=response, tolerance=0.15)
    walked = pictures.walked(robot, start, seconds=float(dt * legs_lap.steps))

# %% tags=["hide-input"]
alt = (
    "A dog with legs, drawn many times along the infinity sign as it walked, with "
    "the waypoints on the floor and its recorded way as connected dots."
)
display(pictures.snapshots(walked, legs_lap.x, alt=alt))

# %% tags=["claims"]
legs_true = witness.true_states()
claim("legs_finished", legs_lap.finished, equals=True)
claim("legs_error", infinity.tracking_error(legs_lap.x).mean(), below=0.05, unit="m")
legs_true_error = infinity.tracking_error(legs_true).mean()
claim("legs_true_error", legs_true_error, below=0.06, unit="m")
claim("legs_time", dt * legs_lap.steps, below=35, unit="s")
claim("legs_dead_band", response.dead_band[0], above=0.1, below=0.35, unit="m/s")

# %% [markdown]
# This is the picture of the paper's first figure, by physics instead of a camera. The dog finishes
# in {claim}`legs_time`; by its own odometry it is {claim}`legs_error` from the path, and truly
# {claim}`legs_true_error`. The library's tests drive this lap with ten dogs, no two of them built
# alike, and hold each to 0.06 m. The same walk as a film, in its own time: <!-- given: 0.06 m -->

# %% tags=["hide-input"]
alt = "A film: a dog with legs walks once around the infinity sign."
display(pictures.film(walked, legs_lap.x, alt=alt, every=10))

# %% [markdown]
# What has been shown with it: the loop, the packets and the safety rules do not depend on the body.
# What has *not* been shown is how a Go1 walks. Its dead band, lag and drift are other numbers,
# found in the same way, from its own log.

# %% [markdown]
# ## On a real robot
#
# ```
# python -m pypose_lite.go1 walk --robot udp://192.168.123.161:8082
# ```
#
# says what will happen, looks at battery and state, asks, and walks at 0.4 m/s. It was run against
# the simulator's program, and never against a robot. Before you are the first, read
# [On the real robot](on_the_real_robot.md). <!-- given: 0.4 m -->

# %% [markdown]
# ## Summary
#
# 1. The loop that drove a car walks a dog: {claim}`visited` waypoints in {claim}`lap_time`, and
#    {claim}`turns` times around its chart.
# 2. A checksum finds damage ({claim}`flips_taken` of 1032 single flips get through, all in a byte
#    that is not used), but not age.
# 3. A watchdog turns silence into a stop: {claim}`hung_walks` instead of {claim}`loose_walks`. Each
#    link needs its own; after a kill, the first zero took {claim}`zero_after_kill`.
# 4. Lag {claim}`lag` and delay {claim}`delay` can be found in any log. A planner that knows them
#    visits {claim}`knows_visited` waypoints where the other got stuck after {claim}`stuck_reached`.
# 5. No filter removes a drift that all its sources share. With a second sensor, belief and truth
#    are {claim}`camera_off` apart instead of {claim}`odometry_off`.
#
# | | paper | here, simulated |
# |:--|:--|:--|
# | flow chart | ask, plan, send, until reached | the same, {claim}`turns` times around |
# | Fig. 1, a dog on the infinity | photographs | by physics, {claim}`legs_true_error` off |
# | recorded trajectory | through all waypoints | {claim}`knows_visited`, {claim}`knows_error` off |
#
# **What differs from PyPose.** PyPose has no robot in it; the paper's was a program of its own.
#
# **Words of this chapter.** {term}`Cyclic redundancy check`, {term}`dead band`, {term}`delay`,
# {term}`lag`, {term}`odometry`, {term}`watchdog`.
#
# **Further reading.** The vendor's `unitree_legged_sdk`, branch `go1`, `comm.h`, for the packets;
# Åström and Murray {cite}`astrom2021` on delays and on models from data; Smith {cite}`smith1957` on
# planning with a delay; and the source of `pypose_lite/go1/`, beginning with `safety/pilot.py`.
#
# **In [the lab](../exercises/09_go1.py)** you read a state byte by byte, seal a command, write a
# watchdog, bring a robot to a stop from every kind of failure, and find faults, lag and delay in
# logs of robots that you have not seen.
