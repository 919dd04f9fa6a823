"""Compiled sweeps lead to the plans of those in Python, or say why they cannot."""

import shutil

import pytest
import torch
from oracles import Clockwork, close, draw, weights

import pypose_lite as pp
from pypose_lite import infinity
from pypose_lite.ilqr import improve

pytestmark = [
    pytest.mark.usefixtures("float64"),
    pytest.mark.skipif(shutil.which("g++") is None, reason="torch compiles with g++: none here"),
    pytest.mark.filterwarnings("ignore::FutureWarning"),
]


def compiled(mpc):
    mpc.compile()
    return mpc


@pytest.fixture
def once(monkeypatch):
    """Makes another compilation, after the first, an error."""

    def from_now_on():
        monkeypatch.setattr(torch._dynamo.config, "error_on_recompile", True)

    return from_now_on


def test_a_plan_and_its_gradient_are_the_same():
    W = infinity.waypoints(torch.float64)
    target = W[2].clone().requires_grad_()
    slow = infinity.controller(T=5, dtype=torch.float64)
    fast = compiled(infinity.controller(T=5, dtype=torch.float64))
    plans = [mpc.solve(0.1, W[0], target) for mpc in (slow, fast)]
    close(plans[1].u, plans[0].u, 1e-9)
    assert plans[0].iterations == plans[1].iterations and plans[1].converged
    slopes = [torch.autograd.grad(plan.u.sum(), target)[0] for plan in plans]
    close(slopes[1], slopes[0], 1e-8)


def test_batches_of_any_size_are_compiled_once_and_keep_their_bounds(g, once):
    Q, p = weights(g, 3)
    slow, fast = pp.MPC(Clockwork(), Q, p, 4), compiled(pp.MPC(Clockwork(), Q, p, 4))
    for count in (6, 11, 1, 2):
        x, target = draw(g, count, 2), draw(g, count, 2)
        plans = [mpc.solve(None, x, target, u_lower=-0.2, u_upper=0.3) for mpc in (slow, fast)]
        close(plans[1].u, plans[0].u, 1e-9)
        assert plans[1].converged.all()
        assert plans[1].u.min() >= -0.2 and plans[1].u.max() <= 0.3
        once()
    assert (plans[1].u == -0.2).any() or (plans[1].u == 0.3).any()


def test_where_the_full_step_does_not_help_the_sweep_in_python_goes_on(g, monkeypatch):
    """A compiled sweep that never gets anywhere: every step is made in Python."""
    Q, p = weights(g, 3)
    slow, fast = pp.MPC(Clockwork(), Q, p, 4), compiled(pp.MPC(Clockwork(), Q, p, 4))
    monkeypatch.setattr(fast._sweep, "compiled", lambda problem, at, newton: at)
    x = draw(g, 5, 2)
    close(fast.solve(None, x).u, slow.solve(None, x).u)
    close(fast.solve(None, x[0]).u, slow.solve(None, x[0]).u)


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

    def late(problem, at, newton):
        return improve(problem._replace(t=problem.t + 1), at, newton)

    mpc._sweep.compiled = late
    with pytest.raises(RuntimeError, match="Clockwork.*it reads more than its arguments"):
        mpc.solve(None, draw(g, 2))
