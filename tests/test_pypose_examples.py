"""PyPose's documented usage, with one import changed, and its answers checked.

Restated from PyPose 0.9.5: the docstrings of System, LTI, LTV, NLS, LQR, MPC and ReduceToBason,
and its folder examples/module.
"""

import math
import warnings

import pytest
import torch
from oracles import DenseQP, close

import pypose_lite as pp

DTYPES = [torch.float32, torch.float64]


@pytest.fixture(autouse=True, params=DTYPES, ids=["float32", "float64"])
def dtype(request):
    before = torch.get_default_dtype()
    torch.set_default_dtype(request.param)
    torch.manual_seed(0)
    yield request.param
    torch.set_default_dtype(before)


@pytest.fixture
def tol(dtype):
    return 1e-4 if dtype == torch.float32 else 1e-10


# --- LTI, LTV


def test_lti(tol):
    b, n, m, p = 2, 3, 2, 2
    A, B = torch.randn(b, n, n), torch.randn(b, n, m)
    C, D = torch.randn(b, p, n), torch.randn(b, p, m)
    c1, c2 = torch.randn(b, n), torch.randn(b, p)
    lti = pp.module.LTI(A, B, C, D, c1, c2).to(torch.device("cpu"))
    state, input = torch.randn(b, n), torch.randn(b, m)
    after, observation = lti(state, input)
    for i in range(b):
        close(after[i], A[i] @ state[i] + B[i] @ input[i] + c1[i], tol)
        close(observation[i], C[i] @ state[i] + D[i] @ input[i] + c2[i], tol)


def test_ltv_from_stacked_matrices(tol):
    """A subclass that picks from what it was constructed with, by its own clock."""
    b, n, m, T = 2, 4, 3, 5
    A, B = torch.randn(b, T, n, n), torch.randn(b, T, n, m)
    C, D = torch.eye(n).tile(b, T, 1, 1), torch.zeros(n, m).tile(b, T, 1, 1)

    class MyLTV(pp.module.LTV):
        def __init__(self, A, B, C, D, T):
            super().__init__(A, B, C, D)
            self.T = T

        @property
        def A(self):
            return self._A[..., self._t % self.T, :, :]

        @property
        def B(self):
            return self._B[..., self._t % self.T, :, :]

        @property
        def C(self):
            return self._C[..., self._t % self.T, :, :]

        @property
        def D(self):
            return self._D[..., self._t % self.T, :, :]

    x, u = torch.randn(n), torch.randn(2 * T, m)
    ltv, alike = MyLTV(A, B, C, D, T), pp.LTV(A, B, C, D)
    for t in range(2 * T):
        before = x.expand(b, n)
        x, y = ltv(x, u[t])
        close(x, pp.bmv(A[:, t % T], before) + pp.bmv(B[:, t % T], u[t]), 1e3 * tol)
        close(y, before, 1e3 * tol)
        close(alike(before, u[t])[0], x, 1e3 * tol)
    Q, x = torch.eye(n + m), torch.randn(n)
    for a, b in zip(pp.LQR(ltv, Q, None, 7)(x), pp.LQR(alike, Q, None, 7)(x)):
        close(a, b, 1e2 * tol)


def test_ltv_made_from_the_time(tol):
    class MyLTV(pp.module.LTV):
        @property
        def A(self):
            return torch.eye(4, 4) * self._t.cos()

        @property
        def B(self):
            return torch.eye(4, 3) * self._t.sin()

        @property
        def C(self):
            return torch.eye(4, 4) * self._t.tan()

        @property
        def D(self):
            return torch.eye(4, 3)

    x, u, ltv = torch.randn(4), torch.randn(5, 3), MyLTV()
    for t in range(5):
        padded = torch.cat([u[t], torch.zeros(1)])
        after, want = math.cos(t) * x + math.sin(t) * padded, math.tan(t) * x + padded
        x, y = ltv(x, u[t])
        close(x, after, 1e-5), close(y, want, 1e-4)
    assert ltv.systime == 5
    assert pp.LQR(ltv, torch.eye(7), None, 4)(x)[0].isfinite().all()


# --- NLS


class Floquet(pp.module.NLS):
    def state_transition(self, state, input, t):
        angle = 2 * math.pi * t / 100
        c, s = angle.cos(), angle.sin()
        A = torch.tensor([[1.0, c / 10], [c / 10, 1.0]], device=t.device)
        B = torch.tensor([[s], [1.0]], device=t.device)
        return pp.bmv(A, state) + pp.bmv(B, input)

    def observation(self, state, input, t):
        return state + t


def floquet(t):
    c, s = math.cos(2 * math.pi * t / 100), math.sin(2 * math.pi * t / 100)
    return torch.tensor([[1, c / 10], [c / 10, 1]]), torch.tensor([[s], [1.0]])


def test_floquet_steps_from_a_given_time_and_is_linearised_at_the_latest(tol):
    step, current = 8, torch.tensor([1.0, 1.0])
    input = torch.tensor(2 * math.pi / 50 * step).sin()
    system = Floquet().reset(t=step)
    after, observation = system(current, input)
    system.set_refpoint()
    A, B = floquet(8)
    close(after, A @ current + B[:, 0] * input, 1e-5)
    close(observation, torch.tensor([9.0, 9.0]), tol)
    close(system.A, floquet(9)[0], 1e-6), close(system.B, floquet(9)[1], 1e-6)


def test_floquets_trajectory_and_its_linearisation_at_any_step():
    N = 40
    time = torch.arange(0, N)
    input = (2 * math.pi * time / 50).sin()
    state, seen = torch.zeros(N, 2), torch.zeros(N, 2)
    state[0] = torch.tensor([1.0, 1.0])
    model = Floquet()
    for i in range(N - 1):
        state[i + 1], seen[i] = model(state[i], input[i])
    for i in (0, 7, N - 2):
        A, B = floquet(i)
        torch.testing.assert_close(state[i + 1], A @ state[i] + B[:, 0] * input[i])
        torch.testing.assert_close(seen[i], state[i] + i)
        model.set_refpoint(state=state[i], input=input[i], t=time[i])
        close(model.A, A, 1e-6), close(model.B, B, 1e-6)
        close(model.C, torch.eye(2), 0), close(model.D, torch.zeros(2, 1), 0)
        close(model.c1, torch.zeros(2), 1e-4), close(model.c2, torch.full((2,), 1.0 * i), 1e-4)


class CartPole(pp.module.NLS):
    """The examples' own, written for one sample, with or without a dimension of batch."""

    def __init__(self, dt, length, cartmass, polemass, gravity):
        super().__init__()
        self.tau, self.length, self.gravity = dt, length, gravity
        self.polemass, self.totalMass = polemass, cartmass + polemass

    def state_transition(self, state, input, t=None):
        x, xDot, theta, thetaDot = state.squeeze()
        force, s, c = input.squeeze(), torch.sin(theta), torch.cos(theta)
        poleml = self.polemass * self.length
        temp = (force + poleml * thetaDot**2 * s) / self.totalMass
        swing = self.length * (4.0 / 3.0 - self.polemass * c**2 / self.totalMass)
        thetaAcc = (self.gravity * s - c * temp) / swing
        xAcc = temp - poleml * thetaAcc * c / self.totalMass
        change = torch.stack((xDot, xAcc, thetaDot, thetaAcc))
        return (state.squeeze() + torch.mul(change, self.tau)).unsqueeze(0)

    def observation(self, state, input, t=None):
        return state


def test_cart_poles_trajectory_and_its_linearisation_at_the_end():
    N, dt = 50, 0.01
    time = torch.arange(0, N) * dt
    input, state = torch.sin(time), torch.zeros(N, 4)
    state[0] = torch.tensor([0, 0, math.pi, 0])
    model, ours = CartPole(dt, 1.5, 20, 10, 9.81), pp.CartPole(dt, 1.5, 20, 10, 9.81)
    for i in range(N - 1):
        state[i + 1], _ = model(state[i], input[i])
        torch.testing.assert_close(state[i + 1], ours(state[i], input[i])[0])
    model.set_refpoint(state=state[-1, :], input=input[-1], t=time[-1])
    want = ours.linearize(state[-1], input[-1:])
    close(model.A, want.A, 1e-5), close(model.B, want.B, 1e-5), close(model.c1, want.c1, 1e-5)
    close(model.C, torch.eye(4), 0), close(model.c2, torch.zeros(4), 1e-6)


def test_a_network_as_dynamics():
    class NNDynamics(pp.module.NLS):
        def __init__(self, hidden):
            super().__init__()
            self.net = torch.nn.Sequential(
                torch.nn.Linear(2, hidden[0]), torch.nn.ReLU(), torch.nn.Linear(hidden[0], 2)
            )

        def state_transition(self, state, input, t=None):
            return self.net(state) + input

        def observation(self, state, input, t=None):
            return state

    model, state = NNDynamics([5]), torch.zeros(20, 2)
    state[0] = torch.tensor([1.0, 1.0])
    for i in range(19):
        state[i + 1], _ = model(state[i], torch.sin(torch.tensor(0.01 * i)))
    state.square().sum().backward()
    assert all(z.grad.isfinite().all() for z in model.parameters())
    plan = pp.MPC(model, torch.eye(4), None, 4)(None, torch.randn(2))
    assert plan[2].isfinite()


# --- LQR


def test_lqr(tol):
    b, T, n, m = 2, 5, 4, 3
    k = n + m
    Q = torch.randn(b, T, k, k)
    Q = torch.matmul(Q.mT, Q)
    p = torch.randn(b, T, k)
    A = torch.tile(torch.eye(n) + 0.2 * torch.randn(n, n), (b, 1, 1))
    B = torch.randn(b, n, m)
    C, D = torch.tile(torch.eye(n), (b, 1, 1)), torch.tile(torch.zeros(n, m), (b, 1, 1))
    c1, c2 = torch.tile(torch.randn(n), (b, 1)), torch.tile(torch.zeros(n), (b, 1))
    x_init = torch.randn(b, n)
    lti, dt = pp.module.LTI(A, B, C, D, c1, c2), 1
    LQR = pp.module.LQR(lti, Q, p, T)
    x, u, cost = LQR(x_init, dt)
    assert (x.shape, u.shape, cost.shape) == ((b, T + 1, n), (b, T, m), (b,))
    for i in range(b):
        steps = (z[i].double().expand(T, *z[i].shape) for z in (A, B, c1))
        want = DenseQP(*steps, Q[i].double(), p[i].double(), x_init[i].double()).solve()
        close(u[i].double(), want, 1e3 * tol)
    again = LQR(x_init, dt, torch.zeros(b, T, m))
    close(again[1], u, 0)


# --- MPC


def cart_pole_problem():
    b, T, n, m = 1, 5, 4, 1
    Q = torch.tile(torch.eye(n + m), (b, T, 1, 1))
    p = torch.randn(b, T, n + m)
    time = torch.arange(0, T) * 0.01
    current_u = torch.sin(time).unsqueeze(1).unsqueeze(0)
    return Q, p, T, current_u


def test_mpc_of_a_cart_pole(dtype, tol):
    Q, p, T, current_u = cart_pole_problem()
    x_init = torch.tensor([[0, 0, torch.pi, 0]])
    stepper = pp.utils.ReduceToBason(steps=15, verbose=True)
    solver = CartPole(0.01, 1.5, 20, 10, 9.81).to(x_init.device)
    MPC = pp.module.MPC(solver, Q, p, T, stepper=stepper).to(x_init.device)
    x, u, cost = MPC(0.01, x_init, u_init=current_u)
    assert (x.shape, u.shape, cost.shape) == ((1, T + 1, 4), (1, T, 1), (1,))
    assert {z.dtype for z in (x, u, cost)} == {dtype}
    ours = pp.CartPole(0.01, 1.5, 20, 10, 9.81)
    v = u[0].double().requires_grad_()
    xs = [x_init[0].double()]
    for t in range(T):
        close(xs[-1].to(dtype), x[0, t], 1e-5)
        xs.append(ours(xs[-1], v[t])[0])
    z = torch.cat([torch.stack(xs[:-1]), v], -1)
    total = (z**2).sum() / 2 + (z * p[0].double()).sum()
    close(total.detach().to(dtype)[None], cost, 1e-5)
    assert torch.autograd.grad(total, v)[0].abs().max() < (1e-4 if dtype == torch.float32 else 1e-7)
    assert vars(stepper) == vars(pp.utils.ReduceToBason(steps=15, verbose=True))


def test_learning_a_linear_model_from_an_experts_plans(dtype):
    """With a stepper of one step: on a linear system that is exact, and nothing is to warn of."""
    b, n, m, T = 5, 3, 3, 5
    Q = torch.eye(n + m).tile(b, T, 1, 1)
    p = torch.randn(n + m).tile(b, T, 1)
    C, D, c1, c2 = torch.eye(n), torch.zeros(n, m), torch.zeros(n), torch.zeros(n)
    expert = torch.eye(n) + 0.1 * torch.randn(n, n), torch.eye(n, m) + 0.3 * torch.randn(n, m)
    A = (expert[0] + 0.1 * torch.randn(n, n)).requires_grad_()
    B = (expert[1] + 0.1 * torch.randn(n, m)).requires_grad_()
    optimizer, losses = torch.optim.RMSprop((A, B), lr=1e-2), []
    for _ in range(20):
        x_init, plans = torch.randn(b, n), []
        for matrices in (expert, (A, B)):
            lti = pp.module.LTI(*matrices, C, D, c1, c2)
            stepper = pp.utils.ReduceToBason(steps=1, verbose=False)
            mpc = pp.module.MPC(lti, Q, p, T, stepper=stepper)
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                plans.append(mpc.forward(1, x_init))
        (x, u, _), (x_agent, u_agent, _) = plans
        loss = torch.mean((u - u_agent) ** 2) + torch.mean((x - x_agent) ** 2)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert sum(losses[-3:]) < 0.2 * sum(losses[:3])


@pytest.mark.parametrize("dtype", [torch.float64], indirect=True)
def test_learning_a_poles_length_and_mass_from_an_experts_plans():
    """The gradient is that of differences; PyPose's is a fifth off."""
    Q, p, T, current_u = cart_pole_problem()
    x_init = torch.tensor([[0, 0, torch.pi + 0.1, 0]])

    def plan(length, mass):
        stepper = pp.utils.ReduceToBason(steps=15, tol=1e-15)
        mpc = pp.module.MPC(CartPole(0.01, length, 20.0, mass, 9.81), Q, p, T, stepper=stepper)
        return mpc(0.01, x_init, u_init=current_u)

    x, u, _ = plan(torch.tensor(1.5), torch.tensor(10.0))

    def loss(length, mass):
        found = plan(length, mass)
        return 1e6 * (((u - found[1]) ** 2).mean() + ((x - found[0]) ** 2).mean())

    at = torch.tensor([2.0, 11.1], requires_grad=True)
    gradient = torch.autograd.grad(loss(*at), at)[0]
    for i, e in enumerate(torch.eye(2)):
        with torch.no_grad():
            want = (loss(*(at + 1e-4 * e)) - loss(*(at - 1e-4 * e))) / 2e-4
        assert gradient[i].item() == pytest.approx(want.item(), rel=1e-5)


# --- ReduceToBason


def test_a_stepper_in_a_loop():
    x, taken = 0.9, []
    stepper = pp.utils.ReduceToBason(steps=5, patience=2, decreasing=0.1, verbose=True)
    while stepper.continual():
        x = x**2
        stepper.step(x)
        taken.append(x)
    assert len(taken) == 5 and taken[-1] == pytest.approx(0.9**32)
