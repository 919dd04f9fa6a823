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
# The loop that drove a car now walks a four-legged robot, the Unitree Go1. Not one line of it
# changes. What changes is the world: legs answer late, packets get lost, and a program that dies
# leaves a machine of 12 kg walking. This chapter is about the distance between a loop that works
# and a loop that you may let near a robot. <!-- given: 12 kg -->
#
# After it you can
#
# - draw a control loop from what it really calls;
# - write a command of the Go1 byte by byte, and say what protects it on its way;
# - say what a watchdog is for, and which one you need where;
# - find lag and delay in a log by gradient descent, and plan with them;
# - say why no filter removes the drift of odometry, and what does.
#
# You need [chapter 3](03_mpc.py), and [chapter 4](04_ekf.py) for the drift. Take about 90 minutes.
# The chapter reproduces the paper's flow chart and the trajectory that it recorded on its robot
# {cite}`pypose06`. **Nothing in this book was tried on a real robot.** Ours is simulated, behind
# the robot's own packets. <!-- given: 90 minutes -->

# %%
import inspect
import math
import struct
import subprocess
import sys
import tempfile
import time
from collections import Counter
from functools import partial

import ipywidgets
import matplotlib.pyplot as plt
import torch
from IPython.display import display

import pypose_lite as pp
from pypose_lite import go1, infinity
from pypose_lite.go1.wire import layout, protocol, transport
from pypose_lite.teaching import animate, claim, plotting, table, widgets
from pypose_lite.teaching.dog import from_above

# %%
plotting.use_style()
torch.set_default_dtype(torch.float64)
dt, W, START = 0.1, infinity.waypoints(), (0.0, 0.0, -math.pi / 2)  # s; m, m, rad
low, trot = torch.tensor([[0.0, -1.5], [1.2, 1.5]])  # m/s, rad/s
mpc = infinity.controller()
mpc.stepper = pp.utils.ReduceToBason(steps=2)  # sweeps a plan
walks = partial(mpc, u_lower=low, u_upper=trot)  # chapter 3's planner, at a trot


class Watched:  # a robot whose calls are noted, and where it truly is
    def __init__(self, robot):
        self.robot, self.calls, self.truth = robot, [], []

    def __getattr__(self, name):
        if name == "wait":
            x, y, heading = self.robot.simulator.dog.pose  # since switched on
            self.truth.append([y, -x, math.sin(heading), -math.cos(heading)])
        self.calls.append(name)
        return getattr(self.robot, name)


# %% tags=["hide-input"]
def picture():
    fig, ax = plt.subplots(figsize=(7, 4.2))
    plotting.plot_waypoints(plotting.infinity_axes(ax), W, "targets").set_zorder(1)
    show = from_above(ax)
    fig.legend(loc="outside lower center", ncols=2)
    plt.close(fig)
    return fig, show


with go1.connect("sim", start=START) as robot:
    dog = Watched(robot)
    lap = infinity.drive(walks, infinity.RealRobot(dog), tolerance=0.15)
fig, show = picture()
display(animate(lambda k: show(lap.x[: 4 * k + 1]) or fig, lap.steps // 4 + 1, 0.3))
near = torch.cdist(W[:, :2], lap.x[:, :2]).amin(1)  # of each target to the way
claim("visited", (near <= 0.15).sum(), equals=17)
claim("lap_error", infinity.tracking_error(lap.x).mean(), below=0.05, unit="m")
claim("lap_time", dt * lap.steps, below=13, unit="s")

# %% [markdown]
# The dog from above, every fourth step. It visits {claim}`visited` targets in {claim}`lap_time`,
# {claim}`lap_error` from the path on average. The folded cell has the loop of chapter 3, with a dog
# in the car's place:
#
# ```
# with go1.connect("sim", start=START) as robot:
#     infinity.drive(walks, infinity.RealRobot(robot), tolerance=0.15)
# ```
#
# For a real dog, `"sim"` becomes `"udp://192.168.123.161:8082"`; why that is not all, this chapter
# is about. (`Watched` only takes notes.) In JupyterLab you can walk the dog yourself: press play,
# and move the sliders.

# %% tags=["remove-cell"]
mine, (fig, show) = go1.connect("sim", start=START), picture()
way = [[0.0, 0.0, 0.0, -1.0]]


def by_hand(tick, speed, turn):
    mine.move(speed, turn)
    mine.wait(0.2)
    x, y, heading = mine.pose()
    way.append([x, y, math.cos(heading), math.sin(heading)])
    show(torch.tensor(way))
    return fig


slider = partial(ipywidgets.FloatSlider, 0.5, step=0.1)
widgets.live(
    by_hand,
    tick=ipywidgets.Play(max=500, interval=300),
    speed=slider(min=-1, max=1.2, description="speed (m/s)"),
    turn=slider(min=-1.5, max=1.5, description="turn (rad/s)"),
)

# %% [markdown]
# ## See it fail
#
# That dog lived in this program, without a network. Now there is one: each packet takes 50 ms, and
# one in twenty is lost, each way. That is no bad Wi-Fi. <!-- given: 50 ms -->
#
# **Predict.** A lap over this line: much the same, wider but whole, or will the dog not arrive?

# %%
wifi = go1.Simulation(faults=go1.Faults(loss=0.05, delay=0.05))
with go1.connect("sim", start=START, simulation=wifi) as robot:
    world = infinity.RealRobot(robot)
    stuck = infinity.drive(walks, world, tolerance=0.15, steps=100)
fig, (left, right) = plt.subplots(1, 2, figsize=(7, 2.7), width_ratios=[1.6, 1])
plotting.plot_waypoints(plotting.infinity_axes(left), W, "targets")
plotting.plot_states(left, stuck.x, label="observations")
for run, name, style in [(lap, "no network", "-"), (stuck, "Wi-Fi", "--")]:
    away = (run.x[:-1] - W[run.goal.clamp(max=16)])[:, :2].norm(dim=-1)
    right.plot(dt * torch.arange(len(away)), away, style, label=name)
right.set(xlabel="time (s)", ylabel="distance to the target (m)", ylim=(0, 1.4))
right.legend(loc="upper center", ncols=2)
plt.show()
claim("stuck_reached", stuck.goal[-1] - 1, below=16)
claim("stuck_speed", stuck.u[-10:, 0].max(), below=0.02, unit="m/s")

# %% [markdown]
# <details><summary>Answer</summary>
#
# It does not arrive. After {claim}`stuck_reached` of 16 targets it stands, told to walk at
# {claim}`stuck_speed`.
#
# </details>
#
# The flat line on the right says *parked*, as in chapter 3. The way there is new. The car did what
# it was told in the step in which it was told. The dog does so about a quarter of a second later,
# while the planner steers a dog that is no longer where it was. It swings wide, passes a target
# outside the tolerance, and from there knows no way back.

# %% [markdown]
# ## The loop, drawn from its calls
#
# What is this loop, exactly? The paper shows a flow chart. A chart drawn by hand shows what its
# author believes. `Watched` has noted every call of the lap in the film, so let us draw those: an
# arrow is a call followed by another, with the number of times; in each box stands its source line.

# %% tags=["hide-input"]
arrows = Counter(pair for pair in zip(dog.calls, dog.calls[1:]) if pair[0] != pair[1])
source = inspect.getsource(infinity.drive) + inspect.getsource(infinity.RealRobot)
boxes = {"pose": (0.42, 2), "move": (0.42, 1), "wait": (0.42, 0), "stop": (0.9, 2)}
fig, ax = plt.subplots(figsize=(7, 2.8))
frame = {"boxstyle": "round,pad=0.7", "fc": "white", "ec": plotting.BLUE}
for name, at in boxes.items():
    line = next(x.strip() for x in source.splitlines() if f"robot.{name}(" in x)
    ax.text(*at, line, bbox=frame, family="monospace", ha="center", va="center")
for (a, b), count in arrows.items():
    (xa, ya), (xb, yb) = boxes[a], boxes[b]
    back, right = yb > ya, xb > xa  # back: left of the other boxes
    x, y = 0.06 if back else (xa + xb) / 2, (ya + yb) / 2
    way = [xa, x, x, x, xb], [ya, ya, y, yb, yb]
    ax.plot(*way, "k-" + "v>^"[right + 2 * back], markevery=[2], lw=1, ms=7, zorder=0)
    ax.text(x + 0.02, y + 0.18 * right, f"{count} ×", size=9, va="center")
ax.set(xlim=(0, 1), ylim=(-0.4, 2.5), frame_on=False, xticks=[], yticks=[])
plt.show()
claim("turns", arrows["wait", "pose"], equals=int(lap.steps))
claim("ways_out", arrows["pose", "stop"], equals=1)
claim("arrows", len(arrows), equals=4)

# %% [markdown]
# It is the paper's chart: ask where the robot is, send it a motion, wait for a step,
# {claim}`turns` times; and when the last target is reached, stop. There are {claim}`arrows` kinds
# of arrows, and no others. (The planner, which is no robot, thinks between `pose` and `move`.)
#
# Now see what is *not* there. While the planner thinks, nobody speaks to the robot. If the planner
# hangs, or dies, nobody ever says "stop".

# %% [markdown]
# ## From scratch
#
# A motion travels as 129 bytes in one UDP packet, which needs no connection and promises nothing.
# Numbers lie in it at fixed places, lowest byte first. The last four bytes are a checksum, so that
# a robot does not walk by a packet that was damaged on its way. It is the remainder of a division,
# bit by bit, of polynomials whose coefficients are 0 and 1.


# %%
def remainder_by_hand(data):
    """CRC-32/MPEG-2 over words of four bytes."""
    register = 0xFFFFFFFF
    for (word,) in struct.iter_unpack("<I", data):
        register ^= word
        for _ in range(32):
            carry = register >> 31
            register = (register << 1 & 0xFFFFFFFF) ^ (0x04C11DB7 * carry)
    return register


packet = bytearray(125)
packet[0:3] = b"\xfe\xef\xee"  # a packet begins; a high-level command
packet[22:24] = 2, 1  # mode: walk; gait: trot
struct.pack_into("<fff", packet, 53, 0.3, 0.0, 0.5)  # m/s, m/s, rad/s
packet += struct.pack("<I", remainder_by_hand(packet[:124]))  # all whole words
command = protocol.HighCmd(mode=2, gait_type=1, velocity=(0.3, 0.0), yaw_speed=0.5)
claim("same_bytes", bytes(packet) == protocol.encode_command(command), equals=True)

# %% [markdown]
# The same bytes as the library's. The library's tests hold both against packets of the vendor's own
# program. Here they are, one square each. Below, to another scale, the answer: the robot's state in
# {claim}`state_bytes` bytes, most of which are its motors.

# %% tags=["hide-input"]
GROUPS = ["head, level_flag", "mode, gait_type", "velocity, yaw_speed", "position"]
GROUPS += ["foot_raise_height, body_height, euler, imu"]
GROUPS += ["motor_state, foot_force, foot_position2body", "checksum"]
kinds = (protocol.HighCmd, 129, 16, 225), (protocol.HighState, 1087, 80, 20)
fig, (top, below) = plt.subplots(2, 1, figsize=(7, 5.2), height_ratios=[9, 5])
for ax, (kind, size, width, area) in zip((top, below), kinds):  # of a square
    byte, starts = torch.arange(size), range(0, size, 2 * width)
    fields = layout.places(kind) | {"checksum": slice(size - 4, size)}
    ax.scatter(byte % width, byte // width, area, "0.93", marker="s")
    for names in GROUPS:
        at = torch.cat([byte[fields.get(n, slice(0))] for n in names.split(", ")])
        ax.scatter(at % width, at // width, area, marker="s", alpha=0.5, label=names)
    ax.set(xlabel="byte in the row", ylabel="row from byte")
    ax.set_yticks([start // width for start in starts], starts)
    ax.invert_yaxis()
    ax.grid(False)
for k, byte in enumerate(packet):
    top.text(k % 16, k // 16, f"{byte:02x}", ha="center", va="center", size=8)
fig.legend(*top.get_legend_handles_labels(), loc="outside lower center", ncols=2)
plt.show()

# %% [markdown]
# **Predict.** Flip one bit of the packet's 1032, each in turn. How many damaged packets does the
# robot take for good: none, a few, or most?


# %%
def taken(data):
    try:
        return bool(protocol.decode_command(data))
    except protocol.ProtocolError:
        return False


good = int.from_bytes(packet, "little")
damaged = [(good ^ 1 << bit).to_bytes(129, "little") for bit in range(8 * 129)]
got_through = [bit // 8 for bit, data in enumerate(damaged) if taken(data)]
print("bytes whose damage is not seen:", sorted(set(got_through)))
claim("state_bytes", protocol.STATE_SIZE, equals=1087)
motors = layout.places(protocol.HighState)["motor_state"]
share = 100 * (motors.stop - motors.start) / protocol.STATE_SIZE
claim("motor_share", share, above=60, unit="%")
claim("flips_taken", len(got_through), equals=8)
claim("only_uncovered", set(got_through) == {124}, equals=True)

# %% [markdown]
# <details><summary>Answer</summary>
#
# {claim}`flips_taken`: the bits of byte 124. The checksum runs over whole words of four bytes, and
# a command has one byte too many. That byte is reserved, so no harm is done.
#
# </details>
#
# A checksum finds damage, not age. There is no number and no time in these packets. One that was
# held up, or came twice, looks as good as new: remember that for "Break it".

# %% [markdown]
# ## The library's version
#
# A robot forgets, and packets get lost, so a command is not sent once but 200 times a second, by a
# thread of its own. *What* goes out is decided anew each time, by the function printed below. It is
# a *watchdog*: a clock that runs towards "stop", and that the planner has to wind up in every step.
# `_patience` is a little less than 0.4 s; `_rest` turns a walk into zero velocity, and after half a
# second of that into a stand. The robot may have a watchdog, too; ours has, with 0.5 s, but for the
# real Go1 none is documented. <!-- given: 200 times, 0.4 s, half a second, 0.5 s -->
#
# To try it, `send` gives a simulated dog a motion in every step, or none, and returns how far it
# came by each step, how many commands it refused, how old its state is, and what was raised first.


# %%
def send(motions, setup=None, mishap=None, **options):
    way, raised = [], "nothing"
    with go1.connect("sim", simulation=setup, **options) as robot:
        for motion in motions:
            if mishap and len(way) == 20:
                setattr(robot.simulator.dog, *mishap)
            try:
                if motion:
                    robot.move(*motion)
            except (go1.RobotTimeout, go1.RobotStopped) as error:
                raised = error if raised == "nothing" else raised
            robot.wait(dt)
            way.append(robot.simulator.dog.pose[0])
        return way, robot.simulator.refused, robot.age, raised


gone = [(0.8, 0.0)] * 30 + [None] * 30  # m/s, rad/s; then silence
deaths = {"the planner hangs": math.inf, "the cable is pulled": 3.0}  # s, to silence
lasting = go1.Simulation(vanish=3.0, numbers=go1.Numbers(watchdog=math.inf))
print(inspect.getsource(go1.Pilot.command))

# %% [markdown]
# Two ways to go wrong, after 3 s of walking: the planner hangs, while the sender lives; or the
# cable is pulled. <!-- given: 3 s -->
#
# **Predict.** Why 0.4 s? With 0.1 s the dog would stop four times as soon. Is that better?
# <!-- given: 0.4 s, 0.1 s -->

# %%
t, loose = dt * torch.arange(1, 61), [send(gone[:30] * 2)[0], send(gone, lasting)[0]]


def stops(timeout):
    fig, panels = plt.subplots(1, 2, figsize=(7, 2.7), sharey=True)
    for ax, (title, vanish), bare in zip(panels, deaths.items(), loose):
        way, *_ = send(gone, go1.Simulation(vanish=vanish), command_timeout=timeout)
        ax.plot(t, bare, "--", label="no watchdog")
        ax.plot(t, way, label="watchdog")
        ax.axvline(3, color=plotting.GREY, ls=":", label="death")
        ax.set(title=title, xlabel="time (s)", ylabel="walked (m)", ylim=(0, 5))
    panels[0].legend()
    return fig


display(widgets.panels(stops, [0.4, 0.2, 0.1, 0.8], "the sender's watchdog (s)"))
hung, hasty = (send(gone, command_timeout=timeout)[0] for timeout in (0.4, 0.1))
claim("hung_walks", hung[-1] - hung[29], below=0.45, unit="m")
claim("loose_walks", loose[0][-1] - loose[0][29], above=2.2, unit="m")
claim("hasty_share", 100 * hasty[29] / hung[29], below=80, unit="%")

# %% [markdown]
# <details><summary>Answer</summary>
#
# No: move the slider. A watchdog of 0.1 s, as long as a step, bites a planner that is in good
# health, and in three seconds the dog gets {claim}`hasty_share` of the way. A watchdog has to be
# longer than the longest pause of a planner that works, and shorter than what you can bear.
# <!-- given: 0.1 s, three seconds -->
#
# </details>
#
# Without, the dog walks on: {claim}`loose_walks` in three seconds, as far as you care to plot. With
# it, {claim}`hung_walks` more. But see the right panel: a watchdog can only stop what it can reach.
# Against a pulled cable the sender's is of no use, that has to be the robot's own.
# <!-- given: three seconds -->
#
# And what if the whole program dies, sender and all? We try that in earnest: a second program walks
# a dog that lives here, over real UDP, and is killed with no chance to say goodbye.

# %%
server = transport.UdpServer("127.0.0.1", 0, protocol.COMMAND_SIZE, silence=2.0)
witness, heard = go1.SimulatedRobot(server, go1.Simulation()), []
witness.apply = lambda command: heard.append((time.monotonic(), command.velocity[0]))
program = f"""from pypose_lite import go1
robot = go1.connect("udp://127.0.0.1:{server.port}")
for _ in range(400):
    robot.move(0.4, 0.3)
    robot.wait(0.1)"""
child = subprocess.Popen([sys.executable, "-c", program])
while child.poll() is None:
    witness.step(0.005)
    if sum(speed > 0 for _, speed in heard) > 100:
        child.kill()
killed = time.monotonic()
while time.monotonic() < killed + 1:
    witness.step(0.005)
server.close()
zero = min(at for at, speed in heard if at > killed and speed == 0)
claim("zero_after_kill", zero - killed, below=0.7, unit="s", varies=True)
claim("no_motion_after", max(at for at, v in heard if v > 0) < zero, equals=True)

# %% [markdown]
# {claim}`zero_after_kill` after the kill came the first zero, and no motion any more. Who sent it?
# `connect` starts a small second process, the *guardian*, which does nothing while it hears the
# sender's heartbeat, and says "stop" when it does not. It also catches a program that is paused, or
# stuck in a C function. (On Windows there is none, and the robot simply hears no more.)

# %% [markdown]
# ## Differentiate through it
#
# Back to the dog that got stuck. The planner has to know two numbers: how fast the legs follow, and
# how late everything is. Both are in any recording. Let the dog walk at changing speeds over the
# bad line, and keep the log (`log=` writes a CSV file: what was seen, what was told).
#
# If legs follow as $\dot v = (u - v) / \tau$, then every change of a command starts an exponential,
# and they add up. What is seen at time $t$ happened $d$ earlier:
#
# $$
# v(t) = u_0 + \sum_j \Delta u_j \left(1 - e^{-(t - d - t_j)/\tau}\right), \qquad t - d > t_j
# $$ (eq-9-lag)
#
# $\tau$ is the *lag*, $d$ the *delay*, there and back; $\Delta u_j$ is the change of the command at
# time $t_j$. The sum is smooth in both, also in $d$, so gradient descent finds them.


# %%
def record(path, setup=wifi):
    """12 s at speeds that change every second; the log's rows."""
    speeds = torch.rand(12, 2, generator=torch.Generator().manual_seed(0))
    motions = [(v, 2 * w - 1) for v, w in speeds.repeat_interleave(10, 0).tolist()]
    send(motions, setup, log=path)
    return torch.tensor(go1.read_log(path))


folder = tempfile.TemporaryDirectory()
log = record(f"{folder.name}/walk.csv")
t, seen, told = log[:, 0], log[:, [4, 6]], log[:, [7, 9]]  # s; m/s and rad/s
change = told.diff(dim=0)


def follow(lag, delay):
    since = (t[:, None] - delay - t[1:]).clamp(min=0)
    return told[0] + (1 - (-since / lag).exp()) @ change


# %%
def misfit():
    loss = (follow(*unknown.exp()) - seen).square().mean()
    (unknown.grad,) = torch.autograd.grad(loss, unknown)
    steps.append(unknown.detach().exp())
    return loss.detach()


unknown, steps = torch.tensor([0.5, 0.2]).log().requires_grad_(), []
torch.optim.LBFGS([unknown], max_iter=25, line_search_fn="strong_wolfe").step(misfit)
lag, delay = unknown.detach().exp()

# %% tags=["hide-input"]
fig, (left, right) = plt.subplots(1, 2, figsize=(7, 2.8), width_ratios=[1.4, 1])
left.step(t, told[:, 0], where="post", color=plotting.GREY, lw=1, label="told")
left.plot(t, seen[:, 0], ".", ms=3, color=plotting.SKY, label="seen")
left.plot(t, follow(lag, delay)[:, 0], color=plotting.RED, lw=1, label="model")
left.set(xlabel="time (s)", ylabel="speed (m/s)", xlim=(0, 6.5), ylim=(-0.05, 1.3))
left.legend(ncols=3, loc="upper center")
a, b = torch.linspace(0.02, 0.6, 16), torch.linspace(0, 0.3, 13)
heights = [[(follow(p, q) - seen).square().mean().sqrt() for p in a] for q in b]
right.contour(a, b, heights, 15, colors=plotting.GREY, linewidths=0.7)
right.plot(*torch.stack(steps).mT, ".-", color=plotting.BLUE, label="descent")
right.plot(0.15, 0.1, "*", ms=12, color=plotting.RED, label="true")
right.set(xlabel="lag (s)", ylabel="delay (s)", xlim=(0.02, 0.6), ylim=(0, 0.3))
right.legend()
plt.show()
claim("lag", lag, equals=0.15, within=0.01, unit="s")
claim("delay", delay, equals=0.1, within=0.015, unit="s")
noise = (follow(lag, delay) - seen).square().mean().sqrt()
claim("misfit", noise, below=0.012)

# %% [markdown]
# Lag {claim}`lag`, delay {claim}`delay`; 0.15 s and twice 50 ms is what was set. The misfit that is
# left, {claim}`misfit`, is the noise of the dog's sensors. <!-- given: 0.15 s, 50 ms -->

# %% [markdown]
# ## On the infinity
#
# Put both numbers into the planner. The legs get two states of their own, the speed and the turn
# rate that they have by now, as the library's `Legs` has them, and chapter 3's MPC takes the longer
# model as it is. The delay becomes a list of the plans so far, which begins with plans to stand:
# the first inputs of the latest were sent, and have not shown yet. The next plan starts where those
# will have led.


# %%
print(inspect.getsource(pp.Legs.state_transition))
weights = torch.tensor([1, 1, 0.3, 0.3, 0, 0, 0.01, 0.01])
legs = pp.MPC(pp.Legs(dt, lag=lag), weights.diag(), None, 10, mpc.stepper)


def knows(robot, plans, late, dt, x, target):
    state = robot.state
    z = torch.cat([x, torch.tensor([state.velocity[0], state.yaw_speed])])
    for plan in plans[len(plans) - late :]:  # on its way
        z = legs.system.state_transition(z, plan[0])
    plan = legs(dt, z, torch.cat([target, 0 * low]), plans[-1].roll(-1, 0), low, trot)
    plans.append(plan[1])
    return plan


# %% mystnb={"markdown_format": "myst"}
tape, late = f"{folder.name}/lap.csv", round(delay.item() / dt)  # a file; steps
with go1.connect("sim", start=START, simulation=wifi, log=tape) as robot:
    dog, guide = Watched(robot), partial(knows, robot, [torch.zeros(10, 2)] * 9, late)
    known = infinity.drive(guide, infinity.RealRobot(dog), tolerance=0.15, steps=160)
true = torch.tensor(dog.truth)
fig, ax = plt.subplots(figsize=(7, 4.2))
plotting.plot_states(plotting.infinity_axes(ax), known.x, label="observations")
ax.plot(*W[:, :2].mT, "o", ms=9, mfc="none", color=plotting.RED, label="targets")
ax.plot(*true[:, :2].mT, color="black", lw=1, label="where the dog was")
fig.legend(loc="outside lower center", ncols=3)
plt.show()
runs, rows = {"no network": lap, "Wi-Fi": stuck, "Wi-Fi, and it knows": known}, []
for on, run in runs.items():
    e, n = infinity.tracking_error(run.x), run.goal[-1] - 1 + run.finished
    rows.append(f"{on} | {n} | {dt * run.steps:.1f} | {e.mean():.3f} | {e.max():.3f}")
display(table("lap | targets, of 16 | time (s) | mean error (m) | largest (m)", rows))
near = torch.cdist(W[:, :2], known.x[:, :2]).amin(1)
claim("knows_visited", (near <= 0.15).sum(), equals=17)
claim("knows_error", e.mean(), below=0.03, unit="m")
claim("knows_true_error", infinity.tracking_error(true).mean(), below=0.06, unit="m")

# %% [markdown]
# The paper's recorded trajectory: observations, connected, through all {claim}`knows_visited`
# targets, over the line on which the other planner got stuck. It is {claim}`knows_error` off, less
# than without a network; the legs' lag was there, too. `python -m pypose_lite.go1 walk` does all
# this for you, with a smoother path to follow, at 0.4 m/s. <!-- given: 0.4 m -->
#
# The black line is a little beside the blue one. Where does that come from?

# %% [markdown]
# ## Drift
#
# The blue dots are what the dog *believes*. It counts its steps from where it was switched on, and
# every miscounted step stays. Ours makes a metre 1 % too long and turns slightly; let us be
# less kind: 3 %, and one degree a second. <!-- given: 1 %, 3 % -->
#
# **Predict.** Give the odometry to the EKF of chapter 4 as its observation. Does it take out most
# of the drift, some of it, or nothing?
#
# And then use it another way: odometry as the *input*, which says how the dog has moved, and as the
# observation a camera on the ceiling, twice a second, 5 cm of noise. <!-- given: 5 cm -->


# %%
class Seen(Watched):
    """Odometry says how it has moved, and now and then a camera where it is."""

    q, r = torch.tensor([[0.01, 0.01, 0.02, 0.02], [0.05, 0.05, 1, 1]]).square()
    ekf = pp.EKF(pp.DubinsCar(dt), q.diag(), r.diag())
    x, P = W[0], 1e-4 * torch.eye(4)

    def pose(self):
        return *self.x[:2].tolist(), math.atan2(self.x[3], self.x[2])

    def wait(self, dt):
        before = torch.tensor(self.robot.pose())
        Watched.__getattr__(self, "wait")(dt)
        moved = torch.tensor(self.robot.pose()) - before
        u = torch.tensor([moved[:2].norm(), math.remainder(moved[2], math.tau)]) / dt
        y = torch.full((4,), torch.nan)  # not seen
        if len(self.truth) % 5 == 1:
            y[:2] = torch.tensor(self.truth[-1][:2])
            y[:2] += 0.05 * torch.randn(2, generator=camera)
        self.x, self.P = self.ekf(self.x, y, u, self.P)


drifts = go1.Simulation(numbers=go1.Numbers(scale=1.03, yaw_drift=math.radians(1)))


# %%
laps, (camera, first) = [], (torch.Generator().manual_seed(seed) for seed in (0, 1))
noise = {"process_noise": 0.01, "observation_noise": 0.01, "generator": first}
for kind, ekf in [(Watched, None), (Seen, None), (Watched, pp.EKF(pp.DubinsCar(dt)))]:
    with go1.connect("sim", start=START, simulation=drifts) as robot:
        dog, guide = kind(robot), partial(knows, robot, [torch.zeros(10, 2)], 0)
        world = infinity.RealRobot(dog, dt, **noise)
        run = infinity.drive(guide, world, ekf, tolerance=0.15)
    laps.append((run, torch.tensor(dog.truth)))
fig, panels = plt.subplots(1, 2, figsize=(7, 2.9), sharey=True)
for ax, title, (run, true) in zip(panels, ["odometry alone", "camera and EKF"], laps):
    plotting.plot_waypoints(plotting.infinity_axes(ax, title), W, "targets")
    plotting.plot_states(ax, run.x, label="what the loop believes")
    ax.plot(*true[:, :2].mT, color="black", lw=1, label="where the dog is")
fig.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=3)
plt.show()
off = [(run.estimate - true)[:, :2].norm(dim=-1) for run, true in laps]
claim("odometry_off", off[0].mean(), above=0.1, unit="m")
claim("odometry_end", off[0][-1], below=0.06, unit="m")
claim("camera_off", off[1].mean(), below=0.07, unit="m")
claim("ekf_off", off[2].mean() / off[0].mean(), above=0.8, below=1.2)

# %% [markdown]
# <details><summary>Answer</summary>
#
# Nothing: its mean error is {claim}`ekf_off` times that of the odometry. A filter weighs what it is
# told, and the drift is in every pose that it was told. It cannot see what nobody says.
#
# </details>
#
# On the left the loop sees a fine lap, while the dog is {claim}`odometry_off` from where it thinks,
# on average. No look at the log would tell. Nor would a mark on the floor at the end: there the two
# are {claim}`odometry_end` apart. What an infinity's first half drifts, its second half undoes, for
# it is the first half turned around. Choose a test that your fault cannot pass.
#
# With the camera it is {claim}`camera_off`, although each look of the camera alone is no better:
# odometry for the short run, the camera for the long. Filters average out noise; against drift you
# need a second witness.

# %% [markdown]
# ## Break it
#
# Faults that look like health: packets come in, at full rate, with valid checksums.
#
# - **The wrong level flag.** Byte 2 has to be `00` for the models Air and Pro. With `EE` they
#   discard every command, and answer all the same.
# - **A frozen robot.** Its program hangs, while something goes on sending its last state.
# - **A robot that does something else,** after two seconds: it falls, somebody presses a button of
#   its remote, or its odometry stays where it is. <!-- given: two seconds -->

# %% mystnb={"markdown_format": "myst"}
straight, pro = [(0.5, 0.0)] * 40, go1.Simulation(model="pro")
trials = {
    "nothing": send(straight),
    "Pro, flag EE": send(straight, pro),
    "Pro, flag 00": send(straight, pro, level_flag=0x00),
    "frozen after 2 s": send(straight, go1.Simulation(freeze=2.0)),
    "falls": send(straight, None, ("leaning", (1.6, 0.0))),
    "remote": send(straight, None, ("remote", b"\0\0\0\1" + bytes(36))),  # A
    "odometry stays": send(straight, None, ("numbers", go1.Numbers(scale=0))),
}
rows, walked = [], {name: way[-1] for name, (way, *_) in trials.items()}
for name, (_, refused, age, raised) in trials.items():
    why = str(raised).split(" (")[0]  # in parentheses: what to do
    rows.append(f"{name} | {refused} | {age:.2f} | {walked[name]:.2f} | {why}")
display(table("fault | refused | age of the state (s) | walked (m) | raises", rows))
claim("pro_walks", walked["Pro, flag EE"], below=0.001, unit="m")
claim("pro_age", trials["Pro, flag EE"][2], below=0.05, unit="s")
claim("pro_with_00", walked["Pro, flag 00"], above=1.5, unit="m")
claim("frozen_age", trials["frozen after 2 s"][2], above=1.5, unit="s")
claim("frozen_walks", walked["frozen after 2 s"], below=1.4, unit="m")
claim("raised", sum(raised != "nothing" for *_, raised in trials.values()), equals=5)

# %% [markdown]
# Whoever measures age by the last *packet* finds all of them healthy. The library measures it by
# the last new *content*: a robot that stands still has noise in its sensors, and no two states are
# alike byte for byte. So the frozen robot is {claim}`frozen_age` old, `pose()` raises, and zeros go
# out.
#
# For the others there is no such sign: their states are new. A pilot who only speaks would walk on.
# So `Pilot` compares every new state with what was asked, by a handful of rules, each a function
# of states and times (`safety/rules.py`). What one state shows stops the dog at once; that motion
# asked and motion seen part has to last a second, longer than a network is late. Who is stopped
# stays so until you have looked, and said `go_on()`. Every limit is assumed, and wide: a dog to
# which nothing happens must walk on. <!-- given: a second -->

# %% [markdown]
# ## Verify
#
# A log can be played back *as a robot*: `connect("replay:lap.csv")`. And a simulated robot lives in
# simulated time, so that two runs are equal to the bit. Both make a bad day repeatable.

# %%
recorded = torch.tensor(go1.read_log(tape))
with go1.connect(f"replay:{tape}", start=START) as robot:
    again = []
    for _ in range(100):
        robot.wait(dt)
        again.append(robot.pose())
nearest = torch.cdist(torch.tensor(again)[:, :2], recorded[:, 1:3]).amin(1)
claim("replay_error", nearest.max(), below=1e-5, unit="m")
repeated = record(f"{folder.name}/again.csv")
claim("repeats", torch.equal(repeated, log), equals=True)
other = record(f"{folder.name}/other.csv", go1.Simulation(seed=1, faults=wifi.faults))
claim("another_seed_differs", torch.equal(other, log), equals=False)
folder.cleanup()

# %% [markdown]
# What can they see? A replay shows what your program *thinks* of a recording, and finds a parser, a
# filter or a chart that changed. It does not answer: what you would have done differently, it does
# not know. The simulator answers, by its model. That model is in one file, `Numbers`, each with its
# source, and for most of them the source is "assumed". Nothing here can tell whether they are
# right. Only the robot can.

# %% [markdown]
# ## On a real robot
#
# ```
# python -m pypose_lite.go1 walk --robot udp://192.168.123.161:8082
# ```
#
# says what will happen, looks at battery and state, asks, and keeps to 0.4 m/s. It was run against
# the simulator's program, and never against a robot. Before you are the first, read
# [On the real robot](on_the_real_robot.md), which is a checklist. <!-- given: 0.4 m -->

# %% [markdown]
# ## Summary
#
# - The same call, another robot: {claim}`visited` targets in {claim}`lap_time`.
# - A checksum finds damage ({claim}`flips_taken` of 1032 flips get through, all in one byte that
#   does not count), not age.
# - A watchdog makes the dead stop: {claim}`hung_walks` instead of {claim}`loose_walks`. Each link
#   needs its own; after a kill, the first zero took {claim}`zero_after_kill`.
# - Lag {claim}`lag` and delay {claim}`delay` stand in any log. A planner that knows them visits
#   {claim}`knows_visited` targets where the other got stuck after {claim}`stuck_reached`.
# - No filter removes drift that all its sources share. With a second witness, belief and truth are
#   {claim}`camera_off` apart instead of {claim}`odometry_off`.
#
# | | paper | here, simulated |
# |:--|:--|:--|
# | flow chart | ask, plan, send, until reached | the same, {claim}`turns` times around |
# | recorded trajectory | through all targets | {claim}`knows_visited`, {claim}`knows_error` off |
#
# **What differs from PyPose.** PyPose has no robot in it; the paper's was a program of its own.
#
# **Further reading.** The vendor's `unitree_legged_sdk`, branch `go1`, `comm.h`, for the packets;
# Åström and Murray {cite}`astrom2021` on delays; the source of `pypose_lite/go1/`, beginning with
# `safety/pilot.py`.
