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
# # From pypose_lite to PyPose
#
# The library of this book has the names and the arguments of PyPose {cite}`pypose06`. After the
# book you can change one import and go on with PyPose, whose world is larger: optimisers for
# nonlinear least squares, preintegration of inertial sensors, bundle adjustment, and more groups of
# poses. This page shows what stays the same and where the two libraries answer differently. You
# need the chapters that the sections name.
#
# Every example is a function of the library, `pp`, and is run with both. So one line of your own
# program changes, and nothing else: `import pypose_lite as pp` becomes `import pypose as pp`.

# %% tags=["setup"]
import math

import torch
from IPython.display import display

from pypose_lite.teaching import claim, table
from pypose_lite.teaching.other_tools.both import both, provenance

torch.set_default_dtype(torch.float64)


def show(answers, form="{}"):
    """Prints an answer of each library."""
    print("pypose_lite:", form.format(answers.ours))
    print("PyPose:     ", form.format(answers.theirs))


# %%
print(provenance())

# %% [markdown]
# ## What stays the same
#
# Systems, linear quadratic control, splines and rotations have the same calls and the same answers
# (chapters [1](01_systems.py), [2](02_lqr.py) and [6](06_splines.py)). A cart on a line, with steps
# of 0.1 s, serves as the example. <!-- given: 0.1 s -->

# %%
A = torch.tensor([[1.0, 0.1], [0.0, 1.0]])
B = torch.tensor([[0.0], [0.1]])
C = torch.tensor([[1.0, 0.0]])
D = torch.zeros(1, 1)
T = 20
Q = torch.eye(3).tile(1, T, 1, 1)  # PyPose wants the batch and all steps
p = torch.zeros(1, T, 3)
start = torch.tensor([[1.0, 0.0]])


# %%
def regulator(pp):
    cart = pp.module.LTI(A, B, C, D)
    x, u, cost = pp.module.LQR(cart, Q, p, T)(start, 1)
    return cost[0]


def step(pp):
    cart = pp.module.LTI(A, B, C, D)
    after, observation = cart(torch.tensor([1.0, 2.0]), torch.tensor([0.5]))
    return after


def curve(pp):
    points = torch.tensor([[0.0, 0.0], [1.0, 1.0], [2.0, 0.0], [3.0, 1.0]])
    return pp.chspline(points, 0.25)


def rotation(pp):
    quaternion = torch.tensor([0.0, 0.0, math.sin(0.1), math.cos(0.1)])
    return pp.SO3(quaternion).Act(torch.tensor([1.0, 0.0, 0.0]))


# %%
examples = [step, regulator, curve, rotation]
same = {example.__name__: both(example) for example in examples}
for name, answers in same.items():
    equal = torch.allclose(torch.tensor(answers.ours), torch.tensor(answers.theirs))
    print(f"{name:10} equal: {equal}")

# %% tags=["claims"]
apart = [torch.tensor(ours) - torch.tensor(theirs) for ours, theirs in same.values()]
largest_gap = max(gap.abs().max().item() for gap in apart)
claim("same_answers", largest_gap, below=1e-9)

# %% [markdown]
# The largest difference between any two numbers is {claim}`same_answers`. What follows are the
# differences. Each of them is made on purpose, and for each we say what to do about it in PyPose.

# %% [markdown]
# ## Bounds of inputs
#
# *Chapter [3](03_mpc.py).* Both libraries take `u_lower` and `u_upper`. The cart may accelerate by
# at most 0.2 m/s² either way. What is the largest acceleration of the plan? <!-- given: 0.2 m -->


# %%
def bounded(pp):
    cart = pp.module.LTI(A, B, C, D)
    bound = 0.2 * torch.ones(1)
    x, u, cost = pp.module.LQR(cart, Q, p, T)(start, 1, u_lower=-bound, u_upper=bound)
    return u.abs().max()


largest = both(bounded)
show(largest, "{:.3f} m/s²")

# %% tags=["claims"]
claim("bound_ours", largest.ours, below=0.2 + 1e-12, unit="m/s²")
claim("bound_theirs", largest.theirs, above=0.5, unit="m/s²")

# %% [markdown]
# PyPose accepts bounds and does not read them: its plan uses {claim}`bound_theirs`. In PyPose, let
# the model itself limit the input, for instance by `torch.tanh`, or clip what is sent and know that
# the plan assumed something else.

# %% [markdown]
# ## Targets
#
# *Chapter [3](03_mpc.py).* The paper's listing calls `mpc(dt, x, target)`. In PyPose the third
# argument is the first guess of the inputs, and its cost pulls to zero. Measure the state from the
# target, as the program in [The same infinity with other tools](other_tools.py) does.

# %% [markdown]
# ## Which observation belongs to which state
#
# *Chapters [4](04_ekf.py) and [5](05_ukf_pf.py).* Here all filters agree: `x, P = f(x, y[i], u[i],
# P)` first corrects with the observation of the state before the step, and then predicts. In a
# linear system with Gaussian noise all of them have to agree with the Kalman filter. The example
# turns by 1 rad in each step, loses 5 % of its length, and is shaken; one of its two numbers is
# measured. We compare the root mean square error of the estimate over 400 steps, and the mean NEES,
# which should be
# 2. <!-- given: 1 rad, 5 %, 400 steps, two, 2 -->


# %%
cos = math.cos(1.0)
sin = math.sin(1.0)
turning = 0.95 * torch.tensor([[cos, sin], [-sin, cos]])
noise = torch.Generator().manual_seed(0)
w = 0.2 * torch.randn(400, 2, generator=noise)
v = 0.5 * torch.randn(400, 1, generator=noise)


def wheel(pp):
    class Wheel(pp.module.NLS):
        def state_transition(self, state, input, t=None):
            return pp.bmv(turning, state) + input

        def observation(self, state, input, t=None):
            return pp.bmv(C, state)

    return Wheel()


# %%
def follow(f):
    """Returns the root mean square error of a filter, and its mean NEES."""
    x = estimate = torch.tensor([0.0, 1.0])
    P = 0.01 * torch.eye(2)
    squares = []
    nees = []
    for i in range(400):
        y = C @ x + v[i]
        x = turning @ x + w[i]
        estimate, P = f(estimate, y, torch.zeros(2), P)
        e = estimate - x
        squares.append(e @ e)
        nees.append(e @ torch.linalg.solve(P, e))
    return [torch.stack(squares).mean().sqrt(), torch.stack(nees).mean()]


# %%
def errors(pp):
    Qw = 0.2**2 * torch.eye(2)
    Rv = 0.5**2 * torch.eye(1)
    return {
        "EKF": follow(pp.module.EKF(wheel(pp), Qw, Rv)),
        "UKF": follow(pp.module.UKF(wheel(pp), Qw, Rv)),
        "PF": follow(pp.module.PF(wheel(pp), Qw, Rv, particles=2000)),
    }


found = both(errors)

# %% tags=["hide-input"]
head = "filter | error, here | error, PyPose | NEES, here | NEES, PyPose"
rows = []
for name in found.ours:
    pairs = zip(found.ours[name], found.theirs[name])
    rows.append(f"{name} | " + " | ".join(f"{a:.3f} | {b:.3f}" for a, b in pairs))
display(table(head, rows))

# %% tags=["claims"]
error_of = {name: torch.tensor(found.ours[name])[0] for name in found.ours}
claim("filters_agree", (error_of["UKF"] - error_of["EKF"]).abs(), below=1e-6)
pf_apart = 100 * (error_of["PF"] / error_of["EKF"] - 1).abs()
claim("pf_agrees", pf_apart, below=5, unit="%")
claim("nees_ours", found.ours["EKF"][1], above=1.7, below=2.3)
claim("ekf_theirs", found.theirs["EKF"][0] / error_of["EKF"], above=1.1)
claim("ukf_theirs", found.theirs["UKF"][0] / error_of["UKF"], above=1.3)
claim("nees_theirs", found.theirs["EKF"][1], above=3)

# %% [markdown]
# Ours agree, the PF but for its draws, and their NEES is near its expectation. PyPose's three
# filters assume different times. Its UKF predicts first and then corrects, so it expects the
# observation *after* the step; given this one, its error is {claim}`ukf_theirs` times ours. Its EKF
# mixes the two: it compares the observation with the state before the step, and weighs it with the
# covariance after it. Its error is {claim}`ekf_theirs` times ours, and it is overconfident, with a
# NEES of {claim}`nees_theirs`. In PyPose, test a filter by its NEES, as chapter 4 does, before you
# trust it. <!-- given: three, two -->

# %% [markdown]
# ## A step that does nothing
#
# *Chapter [5](05_ukf_pf.py).* The state stays as it is, there is no noise, and the observation is
# worthless. So the covariance has to stay as it is, too, whatever it was.


# %%
P_before = torch.tensor([[2.0, 0.9], [0.9, 0.5]])
nothing = 1e-9 * torch.eye(2)
worthless = 1e9 * torch.eye(2)
zero = torch.zeros(2)


def still(pp):
    class Still(pp.module.NLS):
        def state_transition(self, state, input, t=None):
            return state + 0 * input

        def observation(self, state, input, t=None):
            return state

    return Still()


# %%
def no_step(pp):
    ukf = pp.module.UKF(still(pp), nothing, worthless)
    pf = pp.module.PF(still(pp), nothing, worthless, particles=100_000)
    return [ukf(zero, zero, zero, P_before)[1], pf(zero, zero, zero, P_before)[1]]


stayed = both(no_step)
for name, k in {"UKF": 0, "PF": 1}.items():
    print(name, "pypose_lite", stayed.ours[k])
    print(name, "PyPose     ", stayed.theirs[k])

# %% tags=["claims"]
ours_ukf, ours_pf = torch.tensor(stayed.ours) - P_before
claim("still_ours_ukf", ours_ukf.abs().max(), below=1e-6)
claim("still_ours_pf", ours_pf.abs().max(), below=0.05)
theirs_ukf, theirs_pf = torch.tensor(stayed.theirs)
claim("still_ukf", (theirs_ukf - P_before).abs().max(), above=0.3)
claim("still_pf", theirs_pf[0, 0] / P_before[0, 0], above=1.9, below=2.1)

# %% [markdown]
# PyPose's UKF takes the rows of a lower Cholesky factor where its columns are meant. A covariance
# without correlations does not show it; one with correlations comes out as another matrix. Its PF
# draws from the covariance times the dimension, so that the variance is {claim}`still_pf` times as
# large after the step. Both can be helped from outside: give the UKF an upper factor, and the PF a
# covariance divided by the dimension.


# %%
def upper(P):
    return torch.linalg.cholesky(P).mT


def helped(pp):
    ukf = pp.module.UKF(still(pp), nothing, worthless, msqrt=upper)
    pf = pp.module.PF(still(pp), nothing, worthless, particles=100_000)
    return [ukf(zero, zero, zero, P_before)[1], pf(zero, zero, zero, P_before / 2)[1]]


helped_answers = both(helped)
print("PyPose, helped:", helped_answers.theirs)

# %% tags=["claims"]
after_ukf, after_pf = torch.tensor(helped_answers.theirs)
claim("helped_ukf", (after_ukf - P_before).abs().max(), below=1e-6)
claim("helped_pf", (after_pf - P_before).abs().max(), below=0.05)

# %% [markdown]
# ## Gradients through a nonlinear model
#
# *Chapter [8](08_learning.py).* How does the first input of a plan change with the length of a
# pendulum? The difference quotient is the judge.


# %%
def pendulum(pp, length):
    class Pendulum(pp.module.NLS):
        def state_transition(self, state, input, t=None):
            angle = state[..., :1].clone()
            rate = state[..., 1:].clone()
            rate = rate + 0.1 * (9.81 / length * torch.sin(angle) + input)
            return torch.cat([angle + 0.1 * rate, rate], -1)

        def observation(self, state, input, t=None):
            return state

    return Pendulum()


def first_input(pp, length):
    weights = torch.diag(torch.tensor([10.0, 1.0, 0.1])).tile(1, 10, 1, 1)
    stepper = pp.utils.ReduceToBason(steps=30)
    no_slope = torch.zeros(1, 10, 3)
    mpc = pp.module.MPC(pendulum(pp, length), weights, no_slope, 10, stepper)
    return mpc(0.1, torch.tensor([[0.6, 0.0]]))[1].flatten()[0]


# %%
def slope(pp):
    length = torch.tensor(1.0, requires_grad=True)
    (gradient,) = torch.autograd.grad(first_input(pp, length), length)
    with torch.no_grad():
        change = first_input(pp, length + 1e-5) - first_input(pp, length - 1e-5)
    return [gradient, change / 2e-5]


slopes = both(slope)
show(slopes, "gradient {0[0]:.4f}, difference quotient {0[1]:.4f}")

# %% tags=["claims"]
claim("slope_ours", slopes.ours[0] / slopes.ours[1], equals=1, within=1e-6)
missing = 100 * (1 - slopes.theirs[0] / slopes.theirs[1])
claim("slope_theirs", missing, above=5, unit="%")

# %% [markdown]
# PyPose's gradient misses {claim}`slope_theirs`: its matrices $A$ and $B$ of a nonlinear model
# carry no graph, and only the last sweep is differentiated. The derivative of the *cost* is right
# nevertheless, by the {term}`envelope theorem`. In PyPose, use LTI systems or differentiate the
# cost.

# %% [markdown]
# ## The clock
#
# *Chapters [1](01_systems.py) and [3](03_mpc.py).* The paper's systems have a clock that ticks with
# every call. Here only the call of a system itself advances it; planners and filters leave it
# alone. Plan three times for a system that changes with time, from the same state:
# <!-- given: three -->


# %%
def swinging(pp):
    class Swinging(pp.module.NLS):
        def state_transition(self, state, input, t=None):
            wave = torch.sin(torch.as_tensor(t, dtype=state.dtype))
            return state * (1 + 0.5 * wave) + input

        def observation(self, state, input, t=None):
            return state

    return Swinging()


# %%
def three_plans(pp, reset=False):
    system = swinging(pp)
    weights = torch.eye(2).tile(1, 8, 1, 1)
    mpc = pp.module.MPC(system, weights, torch.zeros(1, 8, 2), 8)
    found = []
    for _ in range(3):
        if reset:
            system.reset()
        found.append(mpc(1, torch.ones(1, 1))[2].item())
    return found


# %%
costs = both(three_plans)
show(costs)

# %% tags=["claims"]
claim("clock_ours", max(costs.ours) - min(costs.ours), equals=0)
claim("clock_theirs", max(costs.theirs) - min(costs.theirs), above=0.05)

# %% [markdown]
# In PyPose, reset the clock of the system before each plan:


# %%
def three_plans_with_reset(pp):
    return three_plans(pp, reset=True)


reset_costs = both(three_plans_with_reset)
show(reset_costs)

# %% tags=["claims"]
claim("reset_theirs", max(reset_costs.theirs) - min(reset_costs.theirs), equals=0)
claim("reset_above", min(reset_costs.theirs) / costs.ours[0], above=1.1)

# %% [markdown]
# The three costs are now equal. They are still {claim}`reset_above` times that of our plan, which
# evaluates the model at the time of each of its steps. <!-- given: three -->

# %% [markdown]
# ## Batches, missing measurements, counts
#
# Three smaller ones. A batch of states goes through every class here; PyPose's EKF takes one state
# at a time. A measurement that is missing is NaN here and is left out; there it makes the estimate
# NaN for ever. And a spline with the interval 1/49 has 49 pieces from knot to knot here, while
# rounding adds some there. <!-- given: three, 49 -->


# %%
def rolling(pp):
    class Cart(pp.module.NLS):
        def state_transition(self, state, input, t=None):
            return pp.bmv(A, state) + pp.bmv(B, input)

        def observation(self, state, input, t=None):
            return pp.bmv(C, state)

    return Cart()


# %%
def smaller(pp):
    ekf = pp.module.EKF(rolling(pp), torch.eye(2), torch.eye(1))
    missing = torch.tensor([torch.nan])
    estimate, P = ekf(torch.zeros(2), missing, torch.zeros(1), torch.eye(2))
    points = torch.tensor([[0.0], [1.0], [0.0], [1.0]])
    return [len(pp.chspline(points, 1 / 49)), estimate.isnan().any().item()]


def many(pp):
    ekf = pp.module.EKF(rolling(pp), torch.eye(2), torch.eye(1))
    P = torch.eye(2).expand(3, 2, 2)
    x, P = ekf(torch.zeros(3, 2), torch.zeros(3, 1), torch.zeros(3, 1), P)
    return list(x.shape)


small = both(smaller)
show(small, "{0[0]} points, NaN after a missing measurement: {0[1]}")
batch = both(many)
show(batch)

# %% tags=["claims"]
claim("points_ours", small.ours[0], equals=148)
claim("points_theirs", small.theirs[0], above=148.5)
claim("nan_ours", small.ours[1], equals=False)
claim("nan_theirs", small.theirs[1], equals=True)
claim("batch_ours", batch.ours[0], equals=3)
claim("batch_theirs", "Error" in batch.theirs, equals=True)

# %% [markdown]
# ## Gradients of poses
#
# *Chapter [6](06_splines.py).* A rotation is stored in four numbers but has three degrees of
# freedom. Ask for the derivative of a rotated point by its rotation. <!-- given: four, three -->


# %%
def pose_gradient(pp):
    quaternion = torch.tensor([0.0, 0.0, math.sin(0.1), math.cos(0.1)])
    R = pp.SO3(quaternion).requires_grad_(True)
    rotated = R.Act(torch.tensor([1.0, 0.0, 0.0]))
    (gradient,) = torch.autograd.grad(rotated[1], R)
    return gradient


poses = both(pose_gradient)
show(poses)

# %% tags=["claims"]
turn = poses.theirs[2]
claim("tangent_theirs", turn, equals=math.cos(0.2), within=1e-9)
along = poses.ours[2] * math.cos(0.1) / 2 - poses.ours[3] * math.sin(0.1) / 2
claim("same_slope", along, equals=turn, within=1e-9)

# %% [markdown]
# Both are right. Ours is the derivative by the four numbers, as PyTorch means it. PyPose returns
# the derivative by a small rotation, three numbers and a zero, which is what its optimisers need.
# Along the same small rotation both say {claim}`same_slope`. Do not mix the two: an optimiser of
# PyTorch that steps along PyPose's gradient leaves the unit quaternions unless it knows what they
# are. <!-- given: four, three -->

# %% [markdown]
# ## What you find only there
#
# This book stops where PyPose's own tutorials begin: Levenberg-Marquardt with robust kernels,
# preintegration of inertial sensors, camera models and bundle adjustment, similarity transforms,
# and solvers for sparse systems. When you go there, take one habit along: before you trust a
# number, find a second way to compute it.
