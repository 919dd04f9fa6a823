"""One plan of the infinity, cold and warm, and thousands at once, beside PyPose and CasADi.

All sides minimise the same cost over the same car. PyPose and ours plan in torch; CasADi with
IPOPT solves the same nonlinear programme by multiple shooting, compiled once beforehand. A side
that stops at a worse plan fails instead of winning: costs agree to a relative 1e-4.
`pytest tests/bench/bench_mpc.py --benchmark-group-by=group` compares within each group.
"""

import pytest
import torch

from pypose_lite import infinity, shift
from pypose_lite.models import DubinsCar

WEIGHTS = (1, 1, 0.3, 0.3, 0.01, 0.01)
HORIZONS = (10, 20, 50)
BATCH = 4096


@pytest.fixture(autouse=True)
def one_thread():
    threads, dtype = torch.get_num_threads(), torch.get_default_dtype()
    torch.set_num_threads(1)
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_num_threads(threads)
    torch.set_default_dtype(dtype)


@pytest.fixture(scope="module")
def compiled():
    """Our controllers with compiled sweeps, one for each horizon, compiled when first asked."""
    kept = {}

    def get(T):
        if T not in kept:
            kept[T] = controller(T)
            kept[T].compile()
        return kept[T]

    return get


def problems(count=1):
    """Noisy starts on the path, and for each the waypoint after the next: (count, 4) twice."""
    g = torch.Generator().manual_seed(0)
    path, i = infinity.waypoints(), torch.arange(count) % 15
    noise = infinity.OBSERVATION_NOISE * torch.randn(count, 4, generator=g)
    return path[i] + noise, path[i + 2]


def ipopt(T, warm=False, tol=1e-8):
    """CasADi's solver of one problem: (x, target, inputs to start from) -> cost, inputs."""
    casadi = pytest.importorskip("casadi")
    X, U = casadi.SX.sym("X", 4, T + 1), casadi.SX.sym("U", 2, T)
    start, goal = casadi.SX.sym("start", 4), casadi.SX.sym("goal", 4)
    gap, cost = [X[:, 0] - start], 0
    for t in range(T):
        (i, j, c, s), (v, phi) = casadi.vertsplit(X[:, t]), casadi.vertsplit(U[:, t])
        theta = casadi.atan2(s, c) + 0.1 * phi
        C, S = casadi.cos(theta), casadi.sin(theta)
        gap.append(X[:, t + 1] - casadi.vertcat(i + 0.1 * v * C, j + 0.1 * v * S, C, S))
        z = casadi.vertcat(X[:, t] - goal, U[:, t])
        cost += casadi.dot(casadi.DM(WEIGHTS) * z, z) / 2
    variables = casadi.veccat(U, X)
    programme = {
        "x": variables,
        "f": cost,
        "g": casadi.veccat(*gap),
        "p": casadi.veccat(start, goal),
    }
    quiet = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": tol}
    if warm:
        quiet |= {"ipopt.warm_start_init_point": "yes", "ipopt.mu_init": 1e-6}
    solver = casadi.nlpsol("solver", "ipopt", programme, quiet)

    def solve(x, target, u=None):
        first = torch.zeros(T, 2) if u is None else u
        states = rollout(x, first) if u is not None else x.expand(T + 1, 4)
        guess = torch.cat([first.reshape(-1), states.reshape(-1)]).numpy()
        result = solver(x0=guess, p=torch.cat([x, target]).numpy(), lbg=0, ubg=0)
        u = torch.tensor(result["x"][: 2 * T].full()).reshape(T, 2)
        return float(result["f"]), u

    return solve


def rollout(x, u):
    states, car = [x], DubinsCar()
    for step in u:
        states.append(car.state_transition(states[-1], step))
    return torch.stack(states)


def pypose_mpc(T):
    """PyPose's controller of the same car and cost, as its documentation calls it."""
    pypose = pytest.importorskip("pypose")

    class Car(pypose.module.NLS):
        def state_transition(self, state, input, t=None):
            return DubinsCar.state_transition(ours, state, input)

        def observation(self, state, input, t=None):
            return state

    ours = DubinsCar()
    Q = torch.diag(torch.tensor(WEIGHTS)).expand(1, T, 6, 6)

    def solve(x, target, u=None):
        p = -(Q[..., :4] @ target).reshape(1, T, 6)
        stepper = pypose.utils.ReduceToBason(steps=10)
        mpc = pypose.module.MPC(Car(), Q, p, T, stepper=stepper)
        x, u, cost = mpc(0.1, x[None], None if u is None else u[None])
        return float(cost) + T * float(target @ Q[0, 0, :4, :4] @ target) / 2, u[0]

    return solve


def controller(T):
    return infinity.controller(T=T, dtype=torch.float64)


def eager(T):
    return planner(controller(T))


def planner(mpc):
    def solve(x, target, u=None):
        plan = mpc.solve(0.1, x, target, u)
        return plan.cost, plan.u

    return solve


SIDES = {"ours": eager, "PyPose": pypose_mpc, "IPOPT": ipopt}


def compare(benchmark, side, solve, T, warm):
    (x,), (target,) = problems()
    best, u = eager(T)(x, target)
    start = shift(u) if warm else None
    x = rollout(x, u)[1] if warm else x
    benchmark.group = f"one plan of {T} steps, {'warm' if warm else 'cold'}"
    benchmark.extra_info["side"] = side
    cost, _ = benchmark(solve, x, target, start)
    expected = eager(T)(x, target, start)[0]
    assert float(cost) == pytest.approx(float(expected), rel=1e-4)


@pytest.mark.parametrize("warm", [False, True], ids=["cold", "warm"])
@pytest.mark.parametrize("T", HORIZONS)
@pytest.mark.parametrize("side", SIDES)
def test_one_plan(benchmark, side, T, warm):
    solve = ipopt(T, warm) if side == "IPOPT" else SIDES[side](T)
    compare(benchmark, side, solve, T, warm)


@pytest.mark.parametrize("warm", [False, True], ids=["cold", "warm"])
@pytest.mark.parametrize("T", HORIZONS)
def test_one_plan_compiled(benchmark, compiled, T, warm):
    compare(benchmark, "ours, compiled", planner(compiled(T)), T, warm)


@pytest.mark.parametrize("count", [1, 16, 256, BATCH])
@pytest.mark.parametrize("side", ["ours", "ours, compiled", "IPOPT"])
def test_a_batch(benchmark, compiled, side, count):
    """IPOPT solves one after another: 16 of the problems, for the time of all."""
    x, target = problems(count)
    benchmark.group = f"{count} plans of 10 steps, cold"
    benchmark.extra_info["side"] = side
    if side == "IPOPT":
        solve, pairs = ipopt(10), list(zip(x[:16], target[:16]))
        benchmark.extra_info["share"] = len(pairs) / count
        return benchmark.pedantic(lambda: [solve(*pair) for pair in pairs], rounds=5)
    mpc = compiled(10) if side == "ours, compiled" else controller(10)
    plan = benchmark.pedantic(mpc.solve, (0.1, x, target), rounds=3, warmup_rounds=1)
    assert plan.converged.all()
