"""Loops over time: the same in torch and in numpy, and nothing of it shows."""

import warnings

import numpy as np
import pytest
import torch
from oracles import close, draw, weights
from torch.autograd import gradcheck

import pypose_lite as pp
from pypose_lite import ilqr, scan
from pypose_lite.riccati import homogeneous_cost, homogeneous_dynamics, riccati, riccati_step
from pypose_lite.scan import Steps, in_numpy

pytestmark = pytest.mark.usefixtures("float64")
ARITHMETIC = [False, True]


def horizon(g, n=3, m=2, T=6, dtype=torch.float64):
    """Costs and dynamics of T steps, and bounds of which some clamp."""
    W, w = weights(g, n + m, (T,))
    G = homogeneous_dynamics(draw(g, T, n, n), draw(g, T, n, m), draw(g, T, n))
    low, high = -0.5 * draw(g, T, m).abs(), 0.5 * draw(g, T, m).abs()
    return [z.to(dtype) for z in (homogeneous_cost(W, w), G, low, high)]


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("arithmetic", ARITHMETIC)
def test_a_loop_carries_and_gives_in_the_order_of_time(g, reverse, arithmetic):
    x, w = draw(g, 5, 2), draw(g, 5)

    def body(total, count, x, w):
        return (total + w * x, count + 1), (total, count * w)

    steps = Steps((x, w), 0, reverse)
    (total, count), (before, weighed) = steps.scan(
        body, torch.zeros(2), torch.zeros(()), arithmetic=arithmetic
    )
    order = [4, 3, 2, 1, 0] if reverse else [0, 1, 2, 3, 4]
    sums = (w[order, None] * x[order]).cumsum(0)
    close(total, sums[-1])
    close(before[order], torch.cat([torch.zeros(1, 2), sums[:-1]]))
    close(weighed[order], torch.arange(5) * w[order])
    assert count == 5


def test_what_a_loop_gives_comes_first_and_it_reads_no_more_than_it_says(g):
    x = draw(g, 4, 2)
    seen = []

    def body(total, x):
        seen.append(x)
        return (total + x,), (total,)

    steps = Steps((x,), 0).map(lambda x: (2 * x, "no tensor"))
    sums, doubled, kept = steps.accumulate(body, torch.zeros(2), reads=1).known
    close(sums, (2 * x).cumsum(0) - 2 * x)
    close(doubled, 2 * x)
    assert kept == "no tensor" and len(seen) == 4


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32], ids=str)
@pytest.mark.parametrize("bounded", [False, True])
def test_a_riccati_run_in_numpy_is_that_in_torch(g, monkeypatch, bounded, dtype):
    M, G, *box = horizon(g, dtype=dtype)
    box = tuple(box) if bounded else None
    quick = riccati(M, G, box)
    monkeypatch.setattr(scan, "_shared_with_numpy", lambda z: False)
    for a, b in zip(quick, riccati(M, G, box)):
        assert a.shape == b.shape
        size = b.abs().max().clamp(min=1)
        close(a.to(b.dtype) / size, b / size, 1e-12 if dtype is torch.float64 else 1e-5)
    assert all(z.dtype == dtype for z in quick[:2])


def test_a_riccati_run_without_a_minimum_says_where_and_is_silent(g):
    M, G, *_ = horizon(g)
    M[2, 0, 0] = -1e3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        K, _, failed = riccati(M, G)
        riccati(1e300 * M, 1e300 * G)  # overflows
    assert failed[3:].tolist() == [0, 0, 0] and failed[2] != 0
    assert K[3:].isfinite().all()


@pytest.mark.parametrize("arithmetic", ARITHMETIC)
def test_gradients_go_through_a_loop(g, arithmetic):
    def run(x):
        def body(total, x):
            return (total * x,), (total,)

        return Steps((x,), 0).scan(body, torch.ones(()), arithmetic=arithmetic)[0][0]

    assert gradcheck(run, draw(g, 4).requires_grad_())


def kind(z):
    """in_numpy's function: notes what it was given."""
    kind.seen = type(z)
    return (z,)


def test_numpy_gets_what_it_can_compute_and_nothing_else():
    in_numpy(kind, torch.zeros(2))
    assert kind.seen is np.ndarray
    in_numpy(kind, torch.zeros(2, requires_grad=True))
    assert kind.seen is torch.Tensor
    in_numpy(kind, torch.zeros(2, dtype=torch.bfloat16))
    assert kind.seen is torch.Tensor
    in_numpy(kind, torch.zeros(2, device="meta"))
    assert kind.seen is torch.Tensor
    torch.vmap(lambda z: in_numpy(kind, z)[0])(torch.zeros(3, 2))
    assert kind.seen is torch.Tensor


def test_a_plan_under_a_transform_is_the_plan(g):
    M, G, *_ = horizon(g)
    with torch.no_grad():
        runs = torch.vmap(lambda c: riccati(c * M, G)[0])(torch.tensor([1.0, 2.0]))
    close(runs[1], riccati(2 * M, G)[0], 1e-10)


# --- what follows from how a sweep went

STATE = {"was": 10.0, "last": 1e-2, "damping": 0.0, "exact": True}
SWEEP = {"cost": 9.0, "gain": -1.0, "failed": False, "helped": True}
REST = {"size": 1e-2, "unit": 1.0, "same": True}


def judge(**change):
    """What `ilqr.judge` says in torch and, the same, in numpy."""
    given = [torch.tensor(z) for z in ({**STATE, **SWEEP, **REST} | change).values()]
    names = ("promised", "size", "damping", "exact", "converged")
    slow = ilqr.judge(2**-52, *given)
    quick = in_numpy(lambda *z: ilqr.judge(2**-52, *z), *given)
    for a, b in zip(slow, quick):
        assert a.dtype == b.dtype and a.shape == b.shape == () and a == b
    return dict(zip(names, (z.item() for z in quick)))


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
    went = judge(size=0.0, gain=0.0, cost=10.0, failed=True, last=last, exact=exact, damping=0.5)
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
    problem, *_ = mpc._pose(draw(g, 2, 4), None, None, *bounds.values(), None)
    U = torch.tensor([[[0.0, -1], [2, 0]], [[0, 0], [0, 0]], [[0, 0], [0, 0]]])
    assert ilqr.same_bounds(problem, U, U + 0.1 * U * (U.abs() < 1)).tolist() == [True, True]
    for value, member in ((-1.0, 0), (2.0, 0), (-1.0, 1), (2.0, 1)):
        V = U.clone()
        V[1, member, 1] = value
        for pair in ((U, V), (V, U)):
            assert ilqr.same_bounds(problem, *pair).tolist() == [member == 1, member == 0]


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


def test_riccati_step_takes_numpys_arrays(g):
    M, G, low, high = (z[0] for z in horizon(g))
    V = torch.eye(4)
    for box in (None, (low, high)):
        quick = riccati_step(V.numpy(), M.numpy(), G.numpy(), box and tuple(z.numpy() for z in box))
        for a, b in zip(quick, riccati_step(V, M, G, box)):
            close(torch.as_tensor(a).to(b.dtype), b)
