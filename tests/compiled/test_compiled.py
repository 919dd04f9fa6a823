"""Compiled sweeps lead to the plans of those in Python, or say why they cannot."""

import contextlib
import shutil

import pytest
import torch
from oracles import Clockwork, close, draw, weights

import pypose_lite as pp
from pypose_lite import infinity
from pypose_lite.compiled.sweep import improve as fused
from pypose_lite.control.ilqr import improve

pytestmark = [
    pytest.mark.usefixtures("float64"),
    pytest.mark.skipif(shutil.which("g++") is None, reason="torch compiles with g++: none here"),
    pytest.mark.filterwarnings("ignore::FutureWarning"),
]


def compiled(mpc):
    mpc.compile()
    return mpc


@pytest.fixture
def once():
    """Makes another compilation an error, from when it is called on."""
    with contextlib.ExitStack() as stack:
        no_more = torch._dynamo.config.patch(error_on_recompile=True)
        yield lambda: stack.enter_context(no_more)


@pytest.fixture(scope="module")
def pair():
    """The infinity's controller in Python, and a compiled one; what takes long is done once."""
    slow, fast = (infinity.controller(T=6, dtype=torch.float64) for _ in range(2))
    return slow, compiled(fast)


def test_a_plan_and_its_gradient_are_the_same(pair):
    W = infinity.waypoints(torch.float64)
    target = W[2].clone().requires_grad_()
    plans = [mpc.solve(0.1, W[0], target) for mpc in pair]
    close(plans[1].u, plans[0].u, 1e-9)
    assert plans[0].iterations == plans[1].iterations and plans[1].converged
    slopes = [torch.autograd.grad(plan.u.sum(), target)[0] for plan in plans]
    close(slopes[1], slopes[0], 1e-8)


def test_batches_of_any_size_are_compiled_once_and_keep_their_bounds(g, once):
    Q, p = weights(g, 3)
    slow, fast = pp.MPC(Clockwork(), Q, p, 4), compiled(pp.MPC(Clockwork(), Q, p, 4))
    for lead in ((1,), (6,), (11,), (1,), (2,), (2, 3)):
        x, target = draw(g, *lead, 2), draw(g, *lead, 2)
        plans = [mpc.solve(None, x, target, u_lower=-0.2, u_upper=0.3) for mpc in (slow, fast)]
        close(plans[1].u, plans[0].u, 1e-9)
        assert plans[1].converged.all()
        assert plans[1].u.min() >= -0.2 and plans[1].u.max() <= 0.3
        if lead == (6,):
            once()
    assert (plans[1].u == -0.2).any() or (plans[1].u == 0.3).any()
    slow, fast = (pp.MPC(pp.CartPole(), torch.eye(5), None, 3) for _ in range(2))
    x = draw(g, 6, 4)  # of other sizes, which is no recompilation of the other's code
    close(compiled(fast).solve(None, x).u, slow.solve(None, x).u, 1e-9)


def test_single_plans_are_compiled_once_and_go_the_same_way_sweep_by_sweep(pair, once, monkeypatch):
    """Also where a full step misleads, Newton's model has no minimum, or a stepper ends them."""
    W, (slow, fast) = infinity.waypoints(torch.float64), pair
    for i, j in ((0, 2), (0, 4), (3, 9), (8, 1), (5, 5), (4, 14)):
        plans = [mpc.solve(0.1, W[i], W[j]) for mpc in (slow, fast)]
        assert plans[0].iterations == plans[1].iterations
        close(plans[1].history, plans[0].history, 1e-9)
        close(plans[1].u, plans[0].u, 1e-7)
        if (i, j) == (0, 2):
            once()
    with monkeypatch.context() as patch:
        for mpc in pair:
            patch.setattr(mpc, "stepper", pp.utils.ReduceToBason(steps=3))
        plans = [mpc.solve(0.1, W[0], W[2]) for mpc in pair]
        only = fast.solve(0.1, W[:1], W[2:3])  # of a batch, and as quick
    assert plans[1].iterations == 3 and not plans[1].converged
    close(plans[1].history, plans[0].history, 1e-9)
    close(only.history[:, 0], plans[1].history, 0)
    with pytest.raises(ValueError, match="the rollout from it diverges"):
        fast.solve(0.1, W[0], W[2], torch.full((6, 2), 1e308))


def test_members_that_a_full_step_misleads_try_shorter_ones(monkeypatch):
    """The way is that of Python, sweep by sweep; here the compiled sweep is Python's, too."""
    W = infinity.waypoints(torch.float64)
    x, target = W[[0, 0, 3, 8, 5, 4]], W[[2, 4, 9, 1, 5, 14]]
    slow, fast = (infinity.controller(T=6, dtype=torch.float64) for _ in range(2))
    plans = [slow.solve(0.1, x, target)]
    fast = compiled(fast)
    lengths = []

    def sweep(problem, at, newton, length):
        lengths.append(length)
        return fused(problem, at, newton, length)

    monkeypatch.setattr(fast._optimize, "sweep", sweep)
    monkeypatch.setattr("pypose_lite.compiled.optimizer.AT_ONCE", 4)
    plans.append(fast.solve(0.1, x, target))
    assert (plans[0].iterations == plans[1].iterations).all() and plans[1].converged.all()
    close(plans[1].history, plans[0].history, 1e-9)
    close(plans[1].u, plans[0].u, 1e-7)
    assert [len(length) for length in lengths[:2]] == [3, 3], "a batch comes in equal shares"
    assert torch.cat(lengths).min() < 1, "none had to try a shorter step"


PULL, SHAPE = 1.0, torch.sin


class Pulled(Clockwork):
    def state_transition(self, state, input, t):
        return PULL * SHAPE(super().state_transition(state, input, t))


def test_what_a_system_reads_may_change(g, monkeypatch, once):
    """A number or a function, its own or global: what was compiled for another one is not used.

    Here matrices count as too large to be made entries, which changes no plan either.
    """
    monkeypatch.setattr("pypose_lite.compiled.entries.LARGEST", 0)
    Q, p = weights(g, 3)
    system, x = Pulled(), draw(g, 2)
    fast = compiled(pp.MPC(system, Q, p, 2))
    close(fast.solve(None, x).u, pp.MPC(Pulled(), Q, p, 2).solve(None, x).u, 1e-9)
    once()
    fast.solve(None, x)
    changes = (globals(), "SHAPE", torch.tanh), (globals(), "PULL", 2), (vars(system), "gain", 2)
    for of, name, value in changes:
        with monkeypatch.context() as patch, pytest.raises(torch._dynamo.exc.RecompileError):
            patch.setitem(of, name, value)
            fast.solve(None, x)


def test_a_system_with_a_batch_of_several_dimensions_is_named(g):
    mpc = compiled(pp.MPC(pp.Pendulum(length=1 + torch.rand(2, 3)), torch.eye(3), None, 2))
    with pytest.raises(RuntimeError, match=r"Pendulum cannot be compiled for a batch \(2, 3\)"):
        mpc.solve(None, draw(g, 2))


def test_a_torch_that_is_too_old_is_named(monkeypatch):
    monkeypatch.setattr(torch, "__version__", type(torch.__version__)("2.12.1"))
    with pytest.raises(RuntimeError, match="expected torch 2.13, got 2.12.1"):
        infinity.controller().compile()


class Branching(Clockwork):
    def state_transition(self, state, input, t):
        return super().state_transition(state, input, t) if state[0] > 0 else state


def test_a_system_that_branches_on_its_state_is_named(g):
    Q, p = weights(g, 3)
    with pytest.raises(RuntimeError, match="Branching cannot be compiled"):
        compiled(pp.MPC(Branching(), Q, p, 2)).solve(None, draw(g, 2))


def test_a_compiled_sweep_that_disagrees_is_refused(g):
    """As of a system that reads ``self.systime``, which compiled code cannot see."""
    Q, p = weights(g, 3)
    mpc = compiled(pp.MPC(Clockwork(), Q, p, 3))

    def late(problem, at, *rest):
        return improve(problem._replace(t=problem.t + 1), at, True)

    mpc._optimize.sweep, mpc._optimize.sweeps = late, lambda *args: (late(*args), None)
    for x in (draw(g, 2), draw(g, 3, 2)):
        with pytest.raises(RuntimeError, match="Clockwork.*it reads more than its arguments"):
            mpc.solve(None, x)
