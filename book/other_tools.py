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
# # The same infinity with other tools
#
# This book plans with its own library, because you can read it. There are others, older and larger,
# and for many tasks they are the better choice. Here one plan of the infinity is stated in the
# idiom of each of them, so that you can see how they think: CasADi, do-mpc, HILO-MPC, NeuroMANCER,
# PyPose, and ours.
#
# You need [chapter 3](03_mpc.py). The programs are whole, and stand in the folder
# `pypose_lite/teaching/other_tools` of the repository. `make other-tools` installs the tools into
# an environment beside the project's own, runs all programs one after the other, and records their
# answers. This page is built from the record, so that it can be read, and built, without the tools.

# %% tags=["setup"]
import torch
from IPython.display import display

import pypose_lite as pp
from pypose_lite import infinity
from pypose_lite.teaching import claim, other_tools, table

torch.set_default_dtype(torch.float64)
record = other_tools.record()
answers = {answer["tool"]: answer for answer in record["answers"]}

# %% [markdown]
# ## The problem
#
# The car starts at the first waypoint and plans 10 steps of 0.1 s towards the second one. It must
# not drive backwards nor faster than 2 m/s, and must not turn faster than 4 rad/s. The cost is that
# of chapter 3: half the weighted squares of the distance to the target and of the inputs, summed
# over the steps. <!-- given: 10 steps, 0.1 s, 2 m, 4 rad, half -->

# %% tags=["hide-input"]
display(other_tools.program("problem.py"))

# %% [markdown]
# ## The answers
#
# One of the answers is computed here and now, by the library of this book. The others come from the
# record.

# %%
weights = torch.diag(torch.tensor([1.0, 1.0, 0.3, 0.3, 0.01, 0.01]))
mpc = pp.MPC(pp.DubinsCar(0.1), weights, None, T=10)
start, target = infinity.waypoints()[:2]
lower = torch.tensor([0.0, -4.0])
upper = torch.tensor([2.0, 4.0])
x, u, cost = mpc(0.1, start, target, u_lower=lower, u_upper=upper)
print(f"first input {u[0].tolist()}, cost {cost.item():.6f}")

# %% tags=["hide-input"]
head = "tool | version | v (m/s) | phi (rad/s) | cost | time of a plan (ms)"
rows = []
for name, found in answers.items():
    first = " | ".join(f"{value:.6f}" for value in found["u0"])
    numbers = f"{found['cost']:.5f} | {found['ms']:.2f}"
    rows.append(f"{name} | {found['version']} | {first} | {numbers}")
display(table(head, rows))
print(f"Recorded on {record['date']}: {record['machine']}.")

# %% tags=["claims"]
solvers = ["CasADi, ipopt", "CasADi, fatrop", "do-mpc", "HILO-MPC"]
agree = [*solvers, "pypose_lite, compiled"]
firsts = torch.tensor([answers[name]["u0"] for name in agree])
claim("agreement", (firsts - u[0]).abs().max(), below=1e-6)
costs = torch.tensor([answers[name]["cost"] for name in agree])
claim("cost_agreement", (costs - cost).abs().max(), below=1e-7)
beyond = 1e9 * (answers["CasADi, ipopt"]["u0"][0] - 2)
claim("ipopt_beyond", beyond, above=1, below=100, unit="nm/s")
claim("pypose_speed", answers["PyPose"]["u0"][0], above=2.5, unit="m/s")
learned = answers["NeuroMANCER"]["cost"] / cost.item()
claim("learned_cost", 100 * (learned - 1), above=0, below=15, unit="%")
plain = answers["pypose_lite"]["ms"] / answers["CasADi, ipopt"]["ms"]
claim("plain_slower", plain, above=1, varies=True)
faster = answers["CasADi, fatrop"]["ms"] / answers["pypose_lite, compiled"]["ms"]
claim("compiled_faster", faster, above=1, varies=True)

# %% [markdown]
# Four tools agree with ours: no number of their first inputs differs by more than
# {claim}`agreement`, although they use different solvers. That is the best test of a planner that
# there is. The other two answer another question. <!-- given: four, two -->
#
# - PyPose accepts bounds and does not use them. Its car drives off at {claim}`pypose_speed`. Its
#   cost is the lowest of the table because it is that of a problem without bounds.
# - NeuroMANCER does not plan but learns a *policy*, a network that says what to do in a state. Once
#   trained, it answers without solving anything. Its cost is {claim}`learned_cost` above the best
#   after the training shown here, and would come closer with more.
#
# The times are those of a plan without a good first guess, after everything has been set up: models
# built, code compiled, networks trained. Our plain library, which is written to be read, takes
# {claim}`plain_slower` times as long as CasADi with IPOPT. Compiled, it is {claim}`compiled_faster`
# times as fast as the quickest of the others. The page [Speed](benchmarks.md) measures this with
# more care, for other horizons and for batches.

# %% [markdown]
# ## pypose_lite
#
# A plan is a call of `mpc`, and the bounds are arguments of it. Nothing is set up beforehand, and
# each of the arguments may be a batch and may carry gradients.

# %% tags=["hide-input"]
display(other_tools.program("ours.py"))

# %% [markdown]
# ## CasADi
#
# [CasADi](https://web.casadi.org) is the base of many other tools. A problem is written in symbols,
# as variables, constraints and a cost. CasADi differentiates them and hands them to a solver, here
# IPOPT or Fatrop. All states are unknowns beside the inputs, and the motion is a constraint, as in
# the collocation of chapter 3. Everything that can be written as an equation or an inequality can
# be asked for: obstacles, a final state, limits of the state.

# %% tags=["hide-input"]
display(other_tools.program("casadi_.py"))

# %% [markdown]
# **Traps.** IPOPT relaxes bounds by a tiny amount while it solves, and its answer may stay there:
# the speed is {claim}`ipopt_beyond` above the bound. A robot does not mind, a test that compares
# with `<=` does. Fatrop finds the steps of a plan by the order of the constraints: write those of a
# step together, the motion first.

# %% [markdown]
# ## do-mpc
#
# [do-mpc](https://www.do-mpc.com) wraps CasADi for those who want to control a plant rather than to
# write a nonlinear program. Model, controller, simulator and estimator are objects of their own. It
# knows uncertain parameters (as a tree of scenarios), soft constraints, and estimation over a
# moving horizon.

# %% tags=["hide-input"]
display(other_tools.program("do_mpc_.py"))

# %% [markdown]
# **Traps.** `set_rterm` prices the *changes* of the input. The price of the input itself belongs
# into the stage cost. The last state has a cost of its own, `mterm`, which is zero here, as our
# cost does not weigh the state after the last step.

# %% [markdown]
# ## HILO-MPC
#
# [HILO-MPC](https://github.com/hilo-mpc/hilo-mpc) wraps CasADi, too, and brings models that are
# learned from data, such as Gaussian processes and networks, into the controller. Weights are given
# by the names of states and inputs.

# %% tags=["hide-input"]
display(other_tools.program("hilo_mpc_.py"))

# %% [markdown]
# **Traps.** It needs a numpy older than 2, so that it cannot share an environment with this book.
# Its quadratic cost has no factor of one half: our weights are halved. <!-- given: half, halved -->

# %% [markdown]
# ## NeuroMANCER
#
# [NeuroMANCER](https://github.com/pnnl/neuromancer) is written in PyTorch, like this book's
# library. It learns policies and models by sending gradients through the motion. A whole batch of
# starts is trained at once; here it is one start, since the other tools plan from one.

# %% tags=["hide-input"]
display(other_tools.program("neuromancer_.py"))

# %% [markdown]
# **Traps.** An objective is the mean over all entries of a tensor, not a sum over steps, and so a
# weight means something else when the horizon changes. Bounds are penalties and hold only nearly.
# Every constraint needs a name of its own. It imports a tracking service, `wandb`, whether or not
# it is used; a stand-in module is enough.

# %% [markdown]
# ## PyPose
#
# [PyPose](https://pypose.org) is what this book leads to. Its controller has the same arguments as
# ours but for the target: its cost pulls towards zero, so the state is measured from the target.
# [From pypose_lite to PyPose](to_pypose.py) shows what to watch for.

# %% tags=["hide-input"]
display(other_tools.program("pypose_.py"))

# %% [markdown]
# ## What each of them can do
#
# As their documentation says, but for the last two rows, which this book checks.

# %% tags=["hide-input"]
head = "tool | input bounds | state limits | gradient of a plan | batches | torch"
rows = [
    "CasADi | yes | yes | by its derivatives of solvers | no | no",
    "do-mpc | yes | yes, soft ones too | yes, of the solution | no | no",
    "HILO-MPC | yes | yes | no | no | for learned models",
    "NeuroMANCER | as penalties | as penalties | through the policy | yes | yes",
    "PyPose | accepted, not used | no | of the last sweep | linear systems | yes",
    "pypose_lite | yes | as a cost | exact, also with bounds | yes | yes",
]
display(table(head, rows))

# %% [markdown]
# When to take which? For one plant with limits on its states, take do-mpc, or CasADi if you want to
# see the program. For a policy that shall answer within microseconds, and for plants of which you
# have data rather than equations, NeuroMANCER or HILO-MPC. For gradients through planner, filter
# and robot together, and for many plans at once, a library in PyTorch: ours while you learn and
# where bounds matter, PyPose for its larger world of optimisers and SLAM.

# %% [markdown]
# ## What the paper says of them
#
# The paper's section on related work names five tools. We quote it in parts and add what we saw.
# <!-- given: five -->
#
# - *"Ipopt is a C++-based solver targeting non-linear programming."* That is so. Three of the
#   programs above use it. <!-- given: three -->
# - *"CasADi is a non-linear optimization tool and implements forward mode algorithmic
#   differentiation through a symbolic interface."* It has the reverse mode, too. *"However, both
#   Ipopt and CasADi are not designed to work with robot learning methods."* They do not take part
#   in PyTorch's graph. CasADi can differentiate its solvers, so that one can build the bridge.
# - *"While HILO-MPC based on CasADi attempts to integrate machine learning with optimal control
#   models, it does not provide easy-to-use native PyTorch support, and the control loop needs to be
#   explicitly defined."* We found its models of torch in an optional part, and the loop was ours to
#   write. The same holds for this book's `MPC`, and for the paper's.
# - *"NeuroMANCER is an open-source library that leverages PyTorch for differentiable programming,
#   focusing on constrained optimization, dynamic system formulation, and parametric model-based
#   optimal control."* That is so.
# - *"PyPose is a pioneering PyTorch-based library offering a comprehensive interface for robotics
#   such as perception, SLAM, and control involving optimization."* Its Lie groups and optimisers
#   are what other libraries in PyTorch lack. Of the planner's bounds, which the call accepts, it
#   makes no use.
