"""Compiled plans are the core's, sweep by sweep, or it is said why there are none."""

import copy
import pickle
import platform
import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
import torch
from oracles import Affine, Clockwork, close, draw, matrices, weights

import pypose_lite as pp
from pypose_lite import infinity
from pypose_lite.compiled import library, program, source

pytestmark = pytest.mark.usefixtures("float64", "compiler")


@pytest.fixture
def compiler():
    try:
        library.compiler()
    except RuntimeError as error:
        pytest.skip(str(error))


@pytest.fixture
def once(monkeypatch):
    """Makes another compilation an error, from when it is called on."""

    def refuse(text, what):
        raise AssertionError(f"compiled again: {what}")

    return lambda: monkeypatch.setattr(program, "load", refuse)


def pair(system, *args, **kwargs):
    """Two controllers of a system, of which the second is compiled."""
    slow, fast = (pp.MPC(system, *args, **kwargs) for _ in range(2))
    fast.compile()
    return slow, fast


def same_plans(pair, *args, tolerance=1e-8, **kwargs):
    """Returns the compiled plan, having held it to the core's, sweep by sweep."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*converged.*")
        slow, fast = (mpc.solve(*args, **kwargs) for mpc in pair)
    assert torch.equal(fast.iterations, slow.iterations)
    assert torch.equal(fast.converged, slow.converged)
    size = slow.u.abs().amax().clamp(min=1)
    close(fast.u / size, slow.u / size, tolerance)
    close(fast.x, slow.x, tolerance * (1 + slow.x.abs().amax().item()))
    close(fast.history, slow.history, tolerance * (1 + slow.history.abs().amax().item()))
    for a, b in zip(fast, slow):
        assert a.dtype == b.dtype and a.shape == b.shape
    return fast


# --- random problems


class Pushed(pp.NLS):
    """A system as users write them: of one sample, by assignments, by the time's value."""

    def state_transition(self, state, input, t):
        new = torch.zeros_like(state)
        new[0] = state[0] + 0.1 * state[1]
        new[1] = 0.9 * state[1] + 0.1 * torch.tanh(input[0]) * self.push(int(t))
        return new

    def push(self, t):
        return 1.0 if t < 2 else 1.5 + 0.1 * t

    def observation(self, state, input, t):
        return state


def systems(g):
    return {
        "car": (pp.DubinsCar(), 4, 2),
        "pendulum": (pp.Pendulum(), 2, 1),
        "cart-pole": (pp.CartPole(), 4, 1),
        "LTI": (pp.LTI(*matrices(g, 3, 2)), 3, 2),
        "LTV": (pp.LTV(*matrices(g, 3, 2, (5,))), 3, 2),
        "affine": (Affine(*matrices(g, 2, 2)), 2, 2),
        "time": (Clockwork(), 2, 1),
        "time's value": (Pushed(), 2, 1),
    }


@pytest.mark.parametrize("name", systems(torch.Generator().manual_seed(0)))
def test_random_problems_have_the_same_plans(g, name, once):
    system, n, m = systems(g)[name]
    for i, (T, batch) in enumerate([(1, ()), (4, (17,)), (6, ()), (5, (2, 3)), (6, (1,))]):
        W, w = weights(g, n + m, (T,) if i % 2 else ())
        mpc = pair(system, W, 0.1 * w, T)
        x, target, u = (0.5 * draw(g, *batch, *core) for core in ((n,), (n,), (T, m)))
        system.reset(i)
        same_plans(mpc, None, x)
        bounds = {"u_lower": -0.1 - draw(g, m).abs(), "u_upper": 0.2, "du": 0.3 if i > 2 else None}
        plan = same_plans(mpc, None, x, target, u, **bounds)
        assert (plan.u >= bounds["u_lower"]).all() and (plan.u <= 0.2).all()
        if i == 1 and name != "time's value":
            once()  # whatever the horizon, the clock, the bounds and the size of the batch


@pytest.mark.parametrize("lead", [(), (9,)], ids=["one", "many"])
def test_float32_has_the_same_plans_to_its_own_rounding(g, lead):
    Q = torch.eye(6, dtype=torch.float32)
    x, target = (draw(g, *lead, 4, dtype=torch.float32) for _ in range(2))
    plans = [mpc.solve(None, x, target) for mpc in pair(pp.DubinsCar(), Q, None, 5)]
    assert plans[1].u.dtype == torch.float32
    close(plans[1].cost, plans[0].cost, 1e-4)
    close(plans[1].u, plans[0].u, 2e-2)


def test_every_member_may_have_its_own_problem(g):
    Q, p = weights(g, 3, (5, 1))
    mpc = pair(Clockwork(), Q, p, 4)
    target, start = draw(g, 5, 4, 2), draw(g, 5, 4, 1)
    bounds = {"u_lower": -draw(g, 5, 4, 1).abs(), "u_upper": draw(g, 5, 4, 1).abs()}
    same_plans(mpc, None, draw(g, 5, 2), target, start, **bounds)
    same_plans(mpc, None, draw(g, 3, 5, 2), target.expand(3, 5, 4, 2), start, **bounds)
    same_plans(mpc, None, draw(g, 2), target[0], start)


def test_the_last_state_may_have_a_cost_and_everything_a_target(g, once):
    Q, p = weights(g, 3)
    Qf, pf = weights(g, 2)
    x, target, u_target = draw(g, 5, 2), draw(g, 5, 5, 2), draw(g, 5, 4, 1)
    same_plans(pair(Clockwork(), Q, p, 4), None, x[0])
    same_plans(pair(Clockwork(), Q, p, 4), None, x)
    once()
    mpc = pair(Clockwork(), Q, p, 4, Qf=Qf, pf=pf)
    same_plans(mpc, None, x[0], target[0], u_target=u_target[0])
    same_plans(mpc, None, x, target, u_target=u_target, u_lower=-0.3)
    own = pair(Clockwork(), Q, p, 4, Qf=Qf.expand(5, 2, 2) * torch.rand(5, 1, 1), pf=draw(g, 5, 2))
    same_plans(own, None, x, target, u_target=u_target)


@pytest.mark.parametrize("bound", [None, 0.5], ids=["free", "bounded"])
def test_plans_of_an_unstable_system_begin_with_its_regulator(g, bound):
    A, B, C, D, *_ = matrices(g, 3, 2)
    A = A / torch.linalg.eigvals(A).abs().max() * 1.4
    Q, p = weights(g, 5)
    mpc = pair(pp.LTI(A, B, C, D), Q, 0.1 * p, 60)
    bounds = {} if bound is None else {"u_lower": -bound, "u_upper": bound}
    x = 0.01 * draw(g, 9, 3)
    same_plans(mpc, None, x[0], **bounds)
    same_plans(mpc, None, x, **bounds)


def test_parameters_may_have_a_batch_of_their_own(g, once):
    length = torch.tensor([[0.8], [1.0], [1.3]])
    system = pp.Pendulum(length=length)
    mpc = pair(system, torch.eye(3), None, 4)
    same_plans(mpc, None, draw(g, 2))
    once()
    same_plans(mpc, None, draw(g, 3, 7, 2), u_upper=0.5)
    length += 0.1
    same_plans(mpc, None, draw(g, 3, 7, 2))
    numbers = pair(pp.Pendulum(length=length.tolist()[0][0]), torch.eye(3), None, 4)
    close(mpc[1].solve(None, X := draw(g, 2)).u[0, 0], numbers[0].solve(None, X).u, 1e-9)


@pytest.mark.parametrize("options", ["-march=x86-64", "-march=x86-64-v3"], ids=["SSE", "AVX"])
def test_other_processors_have_fewer_lanes(g, monkeypatch, options, tmp_path):
    """On AVX-512 there are eight of float64; a function of all lanes exists from AVX2 on."""
    if platform.machine() != "x86_64":
        pytest.skip("another kind of processor")
    monkeypatch.setattr(library, "OPTIONS", [*library.OPTIONS, options])
    monkeypatch.setattr(program, "_libraries", {})
    for dtype, tolerance in ((torch.float64, 1e-8), (torch.float32, 1e-2)):
        Q, x = torch.eye(3, dtype=dtype), draw(g, 11, 2, dtype=dtype)
        plans = [mpc.solve(None, x, u_lower=-0.3).u for mpc in pair(pp.Pendulum(), Q, None, 4)]
        close(plans[1], plans[0], tolerance)


def test_threads_share_a_batch(g, monkeypatch):
    mpc, x = pair(Clockwork(), *weights(g, 3), 3), draw(g, 400, 2)
    plans = []
    for count in (1, 3):
        monkeypatch.setattr(torch, "get_num_threads", lambda count=count: count)
        plans.append(mpc[1].solve(None, x))
    for a, b in zip(*plans):
        assert torch.equal(a, b)


# --- the infinity


@pytest.fixture(scope="module")
def controllers():
    """The infinity's controller in Python, and a compiled one."""
    slow, fast = (infinity.controller(T=6, dtype=torch.float64) for _ in range(2))
    fast.compile()
    return slow, fast


@pytest.mark.parametrize("i, j", [(0, 2), (0, 4), (3, 9), (8, 1), (5, 5), (4, 14)])
def test_a_plan_goes_the_same_way_where_full_steps_mislead_too(controllers, i, j):
    """Also where Newton's model has no minimum, and where sweeps find nothing better."""
    W = infinity.waypoints(torch.float64)
    same_plans(controllers, 0.1, W[i], W[j])


@pytest.mark.parametrize("noise, bound", [(0.2, torch.inf), (0, 2.0)], ids=["free", "bounded"])
def test_members_of_a_batch_go_the_way_of_each_alone(controllers, noise, bound):
    """Some need shorter steps, some damping, and they end after very different sweeps.

    Noisy bounded ones are left out: now and then one of them meets a bound by a rounding error
    more or less, and reaches the same plan in other sweeps.
    """
    W, g = infinity.waypoints(torch.float64), torch.Generator().manual_seed(1)
    x = (W[:15] + noise * draw(g, 15, 4)).repeat(8, 1)
    target = W[2:].repeat(8, 1)[torch.randperm(120, generator=g)]
    bounds = {"u_lower": -bound, "u_upper": bound} if bound < torch.inf else {}
    plan = same_plans(controllers, 0.1, x, target, **bounds)
    assert len(plan.iterations.unique()) > 3, "all were equally hard"


def test_noisy_bounded_members_reach_the_plans_of_the_core(controllers):
    W, g = infinity.waypoints(torch.float64), torch.Generator().manual_seed(1)
    x = (W[:15] + 0.2 * draw(g, 15, 4)).repeat(8, 1)
    target = W[2:].repeat(8, 1)[torch.randperm(120, generator=g)]
    slow, fast = (mpc.solve(0.1, x, target, u_lower=-1.0, u_upper=1.0) for mpc in controllers)
    close(fast.u, slow.u, 1e-8)
    assert (fast.iterations == slow.iterations).double().mean() > 0.9


def test_gradients_are_the_cores(controllers):
    W = infinity.waypoints(torch.float64)
    target = W[2].clone().requires_grad_()
    plans = [mpc.solve(0.1, W[0], target) for mpc in controllers]
    slopes = [torch.autograd.grad(plan.u.sum(), target)[0] for plan in plans]
    close(slopes[1], slopes[0], 1e-8)


@pytest.mark.parametrize("rows", [0, slice(0, 5)], ids=["one", "many"])
def test_a_stepper_ends_compiled_sweeps(controllers, monkeypatch, rows):
    W = infinity.waypoints(torch.float64)
    for mpc in controllers:
        monkeypatch.setattr(mpc, "stepper", pp.utils.ReduceToBason(steps=3))
    plan = same_plans(controllers, 0.1, W[rows], W[2:][rows])
    assert len(plan.history) == 4 and not plan.converged.any()


def test_a_diverging_rollout_is_refused_as_in_python(controllers):
    W = infinity.waypoints(torch.float64)
    for u in (torch.full((6, 2), 1e308), torch.full((2, 6, 2), 1e308)):
        with pytest.raises(ValueError, match="the rollout from it diverges"):
            controllers[1].solve(0.1, W[0], W[2], u)


def test_arguments_stay_as_they_were(controllers):
    W = infinity.waypoints(torch.float64)
    u, lower = torch.ones(6, 2), torch.full((2,), -0.3)
    first = controllers[1].solve(0.1, W[0], W[2], u, u_lower=lower)
    again = controllers[1].solve(0.1, W[0], W[2], u, u_lower=lower)
    assert torch.equal(u, torch.ones(6, 2)) and torch.equal(first.u, again.u)


# --- what a system reads may change

PULL, SHAPE = 1.0, torch.sin


class Pulled(Clockwork):
    def __init__(self):
        super().__init__()
        self.weight = torch.nn.Parameter(torch.tensor([0.5, 1.0]))

    def state_transition(self, state, input, t):
        return PULL * SHAPE(self.weight * super().state_transition(state, input, t))


def train(system):
    with torch.no_grad():
        system.weight += 0.25


CHANGES = {  # and whether another code is needed
    "parameter in place": (train, False),
    "parameter": (lambda s: setattr(s, "weight", torch.nn.Parameter(torch.ones(2))), False),
    "number": (lambda s: setattr(s, "gain", 0.3), True),
    "another number": (lambda s: setattr(s, "gain", 0.8), False),
    "global": (lambda s: globals().update(PULL=1.3), True),
    "function": (lambda s: globals().update(SHAPE=torch.tanh), True),
    "method": (lambda s: setattr(Pulled, "state_transition", Clockwork.state_transition), True),
}


def test_what_a_system_reads_may_change(g, monkeypatch):
    """No change goes unseen, and numbers but 0, 1 and 2 need no other code."""
    for name in ("PULL", "SHAPE"):
        monkeypatch.setitem(globals(), name, globals()[name])
    monkeypatch.setattr(Pulled, "state_transition", Pulled.state_transition)
    mpc, x = pair(Pulled(), *weights(g, 3), 3), draw(g, 2)
    same_plans(mpc, None, x)
    made = []
    monkeypatch.setattr(program, "load", lambda *args: made.append(1) or library.load(*args))
    for change, again in CHANGES.values():
        change(mpc[0].system)
        made.clear()
        before = mpc[1].solve(None, x).u
        assert torch.equal(before, same_plans(mpc, None, x).u)
        assert again or not made, change


def test_copies_are_compiled_for_themselves(g):
    mpc = pair(Clockwork(), *weights(g, 3), 3)
    x = draw(g, 2)
    same_plans(mpc, None, x)
    for twin in (copy.deepcopy(mpc[1]), pickle.loads(pickle.dumps(mpc[1]))):
        twin.system.gain = 0.5
        slow = pp.MPC(twin.system, twin.Q, twin.p, 3)
        same_plans((slow, twin), None, x)
    same_plans(mpc, None, x)


# --- what cannot be compiled


class Branching(Clockwork):
    def state_transition(self, state, input, t):
        return super().state_transition(state, input, t) if state[0] > 0 else state


class Drawing(Clockwork):
    def state_transition(self, state, input, t):
        return super().state_transition(state, input, t) + torch.rand(2)


class Outside(Clockwork):
    def state_transition(self, state, input, t):
        return state * sum(state.tolist())


class Sorting(Clockwork):
    def state_transition(self, state, input, t):
        return state.sort().values


REFUSED = {
    "branches on a state": Branching(),
    "draws random numbers": Drawing(),
    "computes with values outside of torch": Outside(),
    "uses sort, which has no rule here": Sorting(),
}


@pytest.mark.parametrize("why", REFUSED)
def test_a_system_that_cannot_be_compiled_is_named(g, why):
    _, fast = pair(REFUSED[why], *weights(g, 3), 2)
    name = type(fast.system).__name__
    with pytest.raises(RuntimeError, match=f"{name} cannot be compiled: it {why}"):
        fast.solve(None, draw(g, 2))


class Twofold(Clockwork):
    """Says that it takes batches, and does something else with them."""

    vectorized = True

    def state_transition(self, state, input, t):
        return state * (2 if state.ndim > 1 else 1) + input


@pytest.mark.parametrize("lead", [(), (3,)], ids=["one", "many"])
def test_a_compiled_step_that_is_not_the_systems_is_refused(g, lead):
    _, fast = pair(Twofold(), *weights(g, 3), 3)
    with pytest.raises(RuntimeError, match="Twofold cannot be compiled: it reads more than"):
        fast.solve(None, draw(g, *lead, 2))


def test_too_large_a_system_is_refused_before_it_is_compiled(g, monkeypatch):
    monkeypatch.setattr(source, "LARGEST", 20)
    monkeypatch.setattr(program, "_libraries", {})
    _, fast = pair(Clockwork(), *weights(g, 3), 3)
    why = "it has more than 20 operations on single numbers, slopes included"
    with pytest.raises(RuntimeError, match=f"Clockwork cannot be compiled: {why}"):
        fast.solve(None, draw(g, 2))


@pytest.mark.parametrize("version", ["2.3.1", "2.15.0+cpu", "3.0.0"])
def test_a_torch_that_was_not_tested_is_named_and_the_core_plans(monkeypatch, version):
    slow, fast = (pp.MPC(Clockwork(), torch.eye(3), None, 3) for _ in range(2))
    monkeypatch.setattr(torch, "__version__", version)
    monkeypatch.setattr(library, "load", None)
    with pytest.warns(
        UserWarning, match=f"tested with torch 2.4 to 2.14, not with {re.escape(version)}"
    ):
        fast.compile()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert torch.equal(fast.solve(None, torch.ones(2)).u, slow.solve(None, torch.ones(2)).u)


def test_torchs_private_names_stand_in_the_engine_and_in_one_other_place():
    library_code = Path(pp.__file__).parent
    private = re.compile(r"\btorch(\.\w+)*\._(?!_)|\bis_compiling\b")
    found = [
        path.relative_to(library_code).as_posix()
        for path in library_code.rglob("*.py")
        if private.search(path.read_text(encoding="utf-8"))
    ]
    assert {path for path in found if not path.startswith("compiled/")} == {"shapes.py"}


def test_the_engine_is_loaded_by_compile_alone():
    code = """
import sys, pypose_lite as pp, torch
mpc = pp.MPC(pp.Pendulum(), torch.eye(3), None, 2)
mpc(None, torch.zeros(2))
assert not [m for m in sys.modules if m.startswith("pypose_lite.compiled")]
assert "torch._inductor" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True)
