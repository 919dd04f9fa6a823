"""What follows from how a sweep went: damping, the next model, and when a plan has converged."""

import pytest
import torch
from oracles import draw

import pypose_lite as pp
from pypose_lite.control.iterate import Iterate
from pypose_lite.control.sweep import Sweep
from pypose_lite.control.verdict import at_same_bounds
from pypose_lite.control.verdict import judge as verdict

pytestmark = pytest.mark.usefixtures("float64")

BEFORE = {"cost": 10.0, "promised": 0.0, "size": 1e-2, "damping": 0.0, "exact": True}
REST = {"converged": False, "iterations": 3}
SWEEP = {"cost": 9.0, "change": -1.0, "size": 1e-2, "failed": False, "helped": True}
NAMES = ("promised", "size", "damping", "exact", "converged")


def judge(same=True, last=1e-2, damping=0.0, exact=True, **change):
    """What the verdict on a sweep says, by name; ``last`` is the size of the step before."""
    state = BEFORE | REST | {"size": last, "damping": damping, "exact": exact}
    plan = {"X": 0.0, "U": 0.0, "K": 0.0}
    before = Iterate(**{name: torch.tensor(z) for name, z in (plan | state).items()})
    new = Sweep(**{name: torch.tensor(z) for name, z in (plan | SWEEP | change).items()})
    after = verdict(before, new, torch.tensor(1.0), torch.tensor(same))
    assert after.iterations == 4 and after.cost == new.cost
    return {name: getattr(after, name).item() for name in NAMES}


def test_damping_follows_the_share_of_the_promise_that_was_kept():
    assert judge(cost=9.9)["damping"] == 1e-3  # a tenth: the first damping
    assert judge(cost=9.9, damping=0.5)["damping"] == 5
    assert judge(cost=9.5, damping=0.5)["damping"] == 0.5  # half
    assert judge(cost=9.1, damping=0.5)["damping"] == 0.05  # nine tenths
    assert judge(cost=9.1, damping=1e-7)["damping"] == 0


def test_newtons_model_is_tried_near_the_end_and_where_gauss_newtons_misled():
    assert not judge(size=0.5, cost=9.0)["exact"]
    assert judge(size=0.5, cost=9.5)["exact"]
    assert judge(size=0.2, cost=9.0)["exact"]


def test_a_plan_has_converged_when_a_step_is_tiny_or_the_next_one_will_be():
    assert judge(size=1e-9)["converged"]
    assert not judge(size=1e-7, exact=False)["converged"]
    assert judge(size=1e-6, last=1e-2)["converged"]  # the next one: 1e-12
    assert not judge(size=1e-4, last=1e-2)["converged"]  # 1e-8
    assert not judge(size=1e-6, last=1e-5)["converged"]  # 1e-8, as they shrink slowly


@pytest.mark.parametrize(
    "doubt",
    [{"exact": False}, {"damping": 0.1}, {"same": False}, {"helped": False}, {"cost": 9.5}],
    ids=lambda doubt: next(iter(doubt)),
)
def test_only_a_sweep_that_went_as_newtons_do_foretells_the_next(doubt):
    assert judge(size=1e-6)["converged"]
    assert not judge(size=1e-6, **doubt)["converged"]


@pytest.mark.parametrize("last, exact", [(0.5, True), (0.5, False), (1e-2, True), (1e-2, False)])
def test_after_a_model_without_a_minimum_another_one_is_tried(last, exact):
    """Far from the solution Gauss-Newton's, near it Newton's, and if it comes again, damped."""
    again = exact == (last < 0.1)
    went = judge(size=0.0, change=0.0, cost=10.0, failed=True, last=last, exact=exact, damping=0.5)
    assert went == {
        "promised": float("inf"),
        "size": last,  # of the latest step that there was
        "damping": 5 if again or last < 0.1 else 0.5,
        "exact": last < 0.1,
        "converged": False,
    }


def test_a_sweep_that_is_held_back_has_not_converged():
    assert not judge(size=1e-9, damping=2.0)["converged"]


def test_an_input_that_meets_or_leaves_a_bound_is_seen(g):
    mpc, bounds = pp.infinity.controller(T=3), {"u_lower": -1.0, "u_upper": 2.0}
    problem = mpc._state(draw(g, 2, 4), None, None, *bounds.values(), None).problem
    U = torch.tensor([[[0.0, -1], [2, 0]], [[0, 0], [0, 0]], [[0, 0], [0, 0]]])
    assert at_same_bounds(problem, U, U + 0.1 * U * (U.abs() < 1)).tolist() == [True, True]
    for value, member in ((-1.0, 0), (2.0, 0), (-1.0, 1), (2.0, 1)):
        V = U.clone()
        V[1, member, 1] = value
        for pair in ((U, V), (V, U)):
            assert at_same_bounds(problem, *pair).tolist() == [member == 1, member == 0]


@pytest.mark.parametrize("bound", [None, 2.0], ids=["free", "bounded"])
def test_the_sweep_that_is_saved_would_have_changed_nothing(g, bound):
    """Newton's steps square: what is left is far below what a step of 1e-6 would be."""
    path, i = pp.infinity.waypoints(), torch.arange(64) % 15
    x, target = path[i] + 0.16 * draw(g, 64, 4), path[i + 2]
    bounds = {} if bound is None else {"u_lower": -bound, "u_upper": bound}
    mpc = pp.infinity.controller()
    plan = mpc.solve(0.1, x, target, **bounds)
    further = mpc.solve(0.1, x, target, plan.u, **bounds)
    assert plan.converged.all()
    assert (further.u - plan.u).abs().max() < 1e-8
    last = plan.history.diff(dim=0).abs() > 1e-9 * plan.cost  # sweeps that changed the cost
    spent = plan.iterations - last.sum(0)
    assert spent.double().mean() < 1.5  # each squares 1e-9, and one more would find nothing
